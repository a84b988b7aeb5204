"""Recordings of the original controller, and what replays them.

A recording gives the level of a pin in cycle n; the last edge before it is n - 1, so that is where
an `EdgeTrace` has the change. While the original is in reset, and while a pin of it is not driven
or not known, nothing is to be compared: there both traces have level 0.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.golden import Golden, Recordings, Words, changes_of_words
from pulsewright.boards.rapcores.registers import CLOCK_HZ, RESET_CYCLES
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError

if TYPE_CHECKING:
    from pulsewright.gateware.rtl import RtlSimulation

FORMAT: Final = "pulsewright-rapcores-golden/1"
VARIANTS: Final[dict[str, tuple[str, dict[str, int]]]] = {
    "head": ("upstream", {}),
    "headfix": ("upstream", {"fixed": 1}),
    "v020": ("v020", {}),
}
START: Final = RESET_CYCLES  # edges from here on are compared
CHANNELS: Final = 4  # motors, and encoders, of every recording
# Pins of an input word and of an output word: name, bit.
INPUTS: Final = (
    *((f"enc{e}_{pin}", e + 4 * n) for n, pin in enumerate("ab") for e in range(CHANNELS)),
    *(("copi", 8), ("sck", 9), ("cs", 10)),
)
OUTPUTS: Final = (
    *((f"{pin}{i}", i + 4 * n) for n, pin in enumerate(("step", "dir", "en")) for i in range(4)),
    *(("move_done", 12), ("buffer_dtr", 13), ("cipo", 14)),
)
IDLE: Final = 1 << 10  # input word at first
POSITIONS: Final = "positions"  # toggles where the recorded accumulators change


@dataclass(frozen=True)
class Message:
    """One word of a message.

    Parameters
    ----------
    cycle : int
        Its first bit is set up there.
    half : int
        Half a period of SCK [cycle].
    sent, reply : int
        Of 64 bits.
    unknown : int
        Mask of the bits of the reply that are not known.
    """

    cycle: int
    half: int
    sent: int
    reply: int
    unknown: int


@dataclass(frozen=True)
class RapcoresGolden(Golden):
    """A recording, with the board that made it and what of it is to be compared.

    Parameters
    ----------
    profile : str
        Of the twin or gateware that it belongs to.
    switches : dict of str to int
        That differ from the profile.
    known : tuple of ((n,) int64, (n,) int64), one per pin of ``expected``
        Edges from which on the level of the pin is known (1) or not (0).
    probe : tuple of (cycle, positions)
        Positions of all motors from a cycle on; empty if they were not recorded.
    messages : tuple of tuple of Message
    """

    profile: str
    switches: dict[str, int]
    known: tuple[tuple[Words, Words], ...]
    probe: tuple[tuple[int, tuple[int, ...]], ...]
    messages: tuple[tuple[Message, ...], ...]


def load(path: Path | str) -> RapcoresGolden:
    """Read a recording.

    Raises
    ------
    UsageError
        If the file is missing or is no such recording.
    """
    try:
        with gzip.open(path, "rt", encoding="utf-8") as file:
            head, *rest = (json.loads(line) for line in file)
        if head["format"] != FORMAT:
            raise UsageError(f"{path}: format {head['format']}, expected {FORMAT}")
        data = {key: value for part in rest for key, value in part.items()}
        profile, switches = VARIANTS[head["variant"]]
        end = head["cycles"] - 1
        cycle, pin, level = _stimulus(data["in"], head["cycles"])
        at, word, unknown = (np.array(column, np.int64) for column in _columns(data["out"]))
        probe = tuple(_probe(data["probe"] or []))
        known = tuple(_known(at - 1, unknown >> bit & 1) for _, bit in OUTPUTS)
        levels = [_changes(at - 1, word >> bit & ~(unknown >> bit) & 1) for _, bit in OUTPUTS]
        names = tuple(name for name, _ in OUTPUTS)
        if probe:
            names += (POSITIONS,)
            levels.append(np.array([c - 1 for c, _ in probe[1:]], np.int64))
        return RapcoresGolden(
            name=f"{head['variant']}__{head['name']}",
            description=head["desc"],
            cycle=cycle,
            pin=pin,
            level=level,
            expected=_trace(names, levels, end),
            transactions=sum(map(len, data["msgs"])),
            profile=profile,
            switches=switches,
            known=known,
            probe=probe,
            messages=tuple(tuple(_message(*entry) for entry in words) for words in data["msgs"]),
        )
    except (OSError, EOFError, KeyError, ValueError, TypeError) as error:
        if isinstance(error, UsageError):
            raise
        raise UsageError(f"{path}: not a recording of rapcores ({error})") from error


def _replay_twin(golden: RapcoresGolden) -> EdgeTrace:
    from pulsewright.boards.rapcores.twin import RapcoresTwin

    twin = RapcoresTwin(golden.profile, bus_pins=True, **golden.switches)
    return replay_on_twin(twin, golden)


def replay_on_twin(twin: Any, golden: RapcoresGolden) -> EdgeTrace:
    """Give the inputs of a recording to a twin that is at its cycle 0; return as `replay`."""
    twin.schedule(golden.cycle, golden.pin, golden.level)
    moved, before = [], golden.probe[0][1] if golden.probe else ()
    for cycle, positions in golden.probe[1:]:
        twin.advance(cycle - 2)
        late = tuple(twin.positions()) == before
        twin.advance(cycle - 1)
        if late and tuple(twin.positions()) == positions:
            moved.append(cycle - 1)
        before = positions
    twin.advance(golden.expected.end)
    return compared(twin.drain(), golden, np.array(moved, np.int64))


def _replay_rtl(golden: RapcoresGolden) -> EdgeTrace:
    from pulsewright.boards.rapcores.gateware import Rapcores
    from pulsewright.gateware.rtl import RtlSimulation

    return replay_on(RtlSimulation(Rapcores(golden.profile, **golden.switches)), golden)


def replay_on(simulation: RtlSimulation, golden: RapcoresGolden) -> EdgeTrace:
    """Give the inputs of a recording to gateware that is at its cycle 0; return as `replay`."""
    from pulsewright.gateware.rtl import pin_changes

    at = np.unique(np.concatenate([[0], golden.cycle]))
    stimulus = np.zeros(len(at), simulation.inputs)
    stimulus["cycle"] = at
    for pin in ("rst_n", "halt"):
        stimulus[pin] = 1
    for pin, _ in INPUTS:
        now = golden.levels(pin, int(pin == "cs"), at).astype(np.uint64)
        port, bit = _port(pin)
        stimulus[port] |= (now << np.uint64(bit)).astype(stimulus[port].dtype)
    rows = simulation.run(golden.expected.end, stimulus)
    names = tuple(name for name, _ in OUTPUTS)
    initial = np.array([name == "buffer_dtr" for name in names], np.uint8)
    cycles, _ = pin_changes(rows, [_port(name) for name in names], initial)
    seen = EdgeTrace(CLOCK_HZ, names, initial, cycles, 0, golden.expected.end)
    return compared(seen, golden, None)


def compared(seen: EdgeTrace, golden: RapcoresGolden, moved: Words | None) -> EdgeTrace:
    """Return what is to be compared of a trace, as `Golden.expected` has it.

    Parameters
    ----------
    seen : EdgeTrace
        From cycle 0 on, with all pins.
    golden : RapcoresGolden
    moved : (n,) int64 or None
        Edges at which the positions were seen to change as recorded; None if they were not seen.
    """
    levels = []
    for (name, _), (edges, known) in zip(OUTPUTS, golden.known, strict=True):
        at = np.unique(np.concatenate([[START], seen[name], edges]))
        toggles = np.searchsorted(seen[name], at, side="right")
        level = (seen.level_at_start(name) + toggles) & 1
        shown = known[np.maximum(np.searchsorted(edges, at, side="right") - 1, 0)]
        levels.append(_changes(at, level & shown))
    if golden.probe:
        levels.append(golden.expected[POSITIONS] if moved is None else moved)
    return _trace(golden.expected.pins, levels, golden.expected.end)


RECORDINGS: Final = Recordings("rapcores", load, {"twin": _replay_twin, "rtl": _replay_rtl})


def _port(pin: str) -> tuple[str, int]:
    """Return the port of the gateware that has a pin, and its bit."""
    if pin.startswith("enc"):
        return f"enc_{pin[-1]}", int(pin[3])
    name = pin.rstrip("0123456789")
    return name, int(pin[len(name) :] or 0)


def _trace(names: Sequence[str], levels: list[Words], end: int) -> EdgeTrace:
    """Return a trace of pins that are low at first, without the edges that are not compared."""
    cycles = []
    for changes in levels:
        late = changes[changes > START]
        # the level at the first edge that counts is a change of its own
        first = [START] if np.count_nonzero(changes <= START) & 1 else []
        kept = np.concatenate([np.array(first, np.int64), late])
        cycles.append(kept[kept < end])
    return EdgeTrace(
        CLOCK_HZ, tuple(names), np.zeros(len(names), np.uint8), tuple(cycles), START, end
    )


def _changes(at: Words, level: Words) -> Words:
    """Return where a level changes, that is 0 at first."""
    return at[np.flatnonzero(np.diff(np.concatenate([[0], level])))]


def _known(at: Words, unknown: Words) -> tuple[Words, Words]:
    rows = np.flatnonzero(np.diff(unknown, prepend=-1))
    return at[rows], 1 - unknown[rows]


def _columns(entries: list[list[int]]) -> tuple[tuple[int, ...], ...]:
    """Return cycles, and the other columns, of a list with differences of cycles."""
    first, *others = zip(*entries, strict=True)
    return tuple(accumulate(first)), *others


def _stimulus(entries: list[list[int]], cycles: int) -> tuple[Words, NDArray[np.str_], Words]:
    """Return the changes of the input pins as columns, by cycle."""
    at, words = (np.array(column, np.int64) for column in _columns(entries))
    fields = ((name, bit, 1) for name, bit in INPUTS)
    return changes_of_words(fields, at[at < cycles], words[at < cycles], IDLE)


def _probe(entries: list[list[Any]]) -> list[tuple[int, tuple[int, ...]]]:
    """Return the positions from the first edge that is compared on."""
    cycles = accumulate(entry[0] for entry in entries)
    rows = [(cycle, tuple(entry[1:])) for cycle, entry in zip(cycles, entries, strict=True)]
    early = [row for row in rows if row[0] <= START + 1]
    return [*early[-1:], *(row for row in rows if row[0] > START + 1)]


def _message(cycle: int, half: int, sent: str, reply: str, unknown: str = "0") -> Message:
    return Message(cycle, half, int(sent, 16), int(reply, 16), int(unknown, 16))
