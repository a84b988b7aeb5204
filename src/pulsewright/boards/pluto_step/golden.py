"""Recordings of the original controller (format ``pluto-golden-1``), and what replays them."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from pulsewright.boards.golden import Golden, Recordings, Words, changes_of_words
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError

if TYPE_CHECKING:
    from pulsewright.gateware.rtl import RtlSimulation

FORMAT: Final = "pluto-golden-1"
# Pins of an input word: name, lowest bit, bits.
INPUTS: Final = (
    ("nwrite", 0, 1),
    ("ndatastr", 1, 1),
    ("naddrstr", 2, 1),
    ("ninit", 3, 1),
    ("data", 4, 8),
    *((f"din{n}", 16 + n, 1) for n in range(16)),
)
IDLE: Final = 0xF  # input word before the first row
# Pins of an output word, from bit 0 up. Those that are high-Z, and data not driven, are 0.
OUTPUTS: Final = (
    *(f"step{axis}" for axis in range(4)),
    *(f"dir{axis}" for axis in range(4)),
    *(f"out{n}" for n in range(14)),
    *("led", "tristate", "nwait", "nconfig", "drive"),
    *(f"data{n}" for n in range(8)),
)
HIGH: Final = ("nwait", "nconfig")  # before edge 0
# The same words as ports of the gateware: name, lowest bit, bits.
INPUT_PORTS: Final = (
    *(("nwrite", 0, 1), ("ndatastr", 1, 1), ("naddrstr", 2, 1), ("nreset", 3, 1)),
    *(("data_i", 4, 8), ("din", 16, 16)),
)
OUTPUT_PORTS: Final = (
    *(("step", 0, 4), ("dir", 4, 4), ("dout", 8, 14), ("led", 22, 1), ("tristate", 23, 1)),
    *(("nwait", 24, 1), ("nconfig", 25, 1), ("data_oe", 26, 1), ("data_o", 27, 8)),
)
HIGH_Z: Final = 0x7FFFFF  # of an output word, while tristate
DATA: Final = 0xFF << 27  # while not driven


def load(path: Path | str) -> Golden:
    """Read a recording.

    Raises
    ------
    UsageError
        If the file is missing or is no such recording.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            meta = json.loads(str(data["meta"]))
            if meta["format"] != FORMAT:
                raise UsageError(f"{path}: format {meta['format']}, expected {FORMAT}")
            cycle, pin, level = changes_of_words(
                INPUTS,
                np.cumsum(data["in_delta"], dtype=np.int64),
                data["in_word"].astype(np.int64),
                IDLE,
            )
            return Golden(
                name=meta["name"],
                description=meta["description"],
                cycle=cycle,
                pin=pin,
                level=level,
                expected=_trace(
                    meta["clock_hz"],
                    meta["n_cycles"],
                    np.cumsum(data["out_delta"], dtype=np.int64),
                    data["out_word"].astype(np.int64),
                ),
                transactions=len(data["txn"]),
            )
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        if isinstance(error, UsageError):
            raise
        raise UsageError(f"{path}: not a recording of pluto-step ({error})") from error


def _replay_twin(golden: Golden) -> EdgeTrace:
    from pulsewright.boards.pluto_step.twin import PlutoStepTwin

    twin = PlutoStepTwin(bus_pins=True)
    twin.schedule(golden.cycle, golden.pin, golden.level)
    twin.advance(golden.expected.end)
    return twin.drain()


def _replay_rtl(golden: Golden) -> EdgeTrace:
    from pulsewright.boards.pluto_step.gateware import PlutoStep
    from pulsewright.gateware.rtl import RtlSimulation

    return replay_on(RtlSimulation(PlutoStep()), golden)


def replay_on(simulation: RtlSimulation, golden: Golden) -> EdgeTrace:
    """Give the inputs of a recording to gateware that is at its cycle 0; return as `replay`."""
    at, words = _input_words(golden)
    stimulus = np.zeros(len(at), simulation.inputs)
    stimulus["cycle"] = at
    for port, lsb, width in INPUT_PORTS:
        stimulus[port] = words >> lsb & ((1 << width) - 1)
    rows = simulation.run(golden.expected.end, stimulus)
    word = np.zeros(len(rows), np.int64)
    for port, lsb, _ in OUTPUT_PORTS:
        word |= rows[port].astype(np.int64) << lsb
    word[rows["tristate"] == 1] &= ~HIGH_Z
    word[rows["data_oe"] == 0] &= ~DATA
    return _trace(golden.expected.clock_hz, golden.expected.end, rows["cycle"], word)


RECORDINGS: Final = Recordings("pluto_step", load, {"twin": _replay_twin, "rtl": _replay_rtl})


def _input_words(golden: Golden) -> tuple[Words, Words]:
    """Return cycles and input words, from cycle 0 on; the inverse of `changes_of_words`."""
    at = np.unique(np.concatenate([[0], golden.cycle]))
    words = np.zeros(len(at), np.int64)
    for name, lsb, width in INPUTS:
        words |= golden.levels(name, IDLE >> lsb & ((1 << width) - 1), at) << lsb
    return at, words


def _trace(clock_hz: int, end: int, at: Words, word: Words) -> EdgeTrace:
    """Return the changes of the output pins from words after the edges ``at``."""
    initial = np.array([pin in HIGH for pin in OUTPUTS], np.uint8)
    cycles = []
    for n, first in enumerate(initial):
        level = np.concatenate([[first], word >> n & 1])
        cycles.append(at[np.flatnonzero(np.diff(level))])
    return EdgeTrace(clock_hz, OUTPUTS, initial, tuple(cycles), 0, end)
