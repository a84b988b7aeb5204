"""Recordings of the original controller, and what replays them."""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pulsewright.boards.golden import Golden, Recordings, Words, stimulus
from pulsewright.boards.s3g.registers import CHANNELS
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError

if TYPE_CHECKING:
    from pulsewright.gateware.rtl import RtlSimulation

INPUTS: Final = ("rst_n", "cclk", "avr_tx", "ext_tx")
LEDS: Final = 8
AXES: Final = "xy"  # names of the channels in a recording
MOTOR: Final = ("step", "dir", "enable")
OUTPUTS: Final = (
    *(f"led{n}" for n in range(LEDS)),
    *(f"mot{c}_{pin}" for c in range(CHANNELS) for pin in MOTOR),
    *("avr_rx", "ext_rx"),
)


@dataclass(frozen=True)
class S3GGolden(Golden):
    """A recording, with the settings of the board that made it.

    Parameters
    ----------
    baud1, baud2, ints_timer : int
        As of `S3GTwin`.
    """

    baud1: int
    baud2: int
    ints_timer: int

    @property
    def settings(self) -> dict[str, Any]:
        """Settings as keywords of twin and gateware."""
        return {"baud1": self.baud1, "baud2": self.baud2, "ints_timer": self.ints_timer}


def load(path: Path | str) -> S3GGolden:
    """Read a recording.

    A recording gives the level of a pin in cycle n; the last edge before it is n - 1, so that is
    where an `EdgeTrace` has the change.

    Raises
    ------
    UsageError
        If the file is missing or is no such recording.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            meta = json.loads(bytes(data["meta"]))
            cycle, pin, level = stimulus((pin, *changes(data, f"in_{pin}")) for pin in INPUTS)
            return S3GGolden(
                name=meta["name"],
                description=meta["doc"],
                cycle=cycle,
                pin=pin,
                level=level,
                expected=_expected(data, meta["clk_hz"], meta["cycles"] - 1),
                transactions=len(data["int_tx_pkt__dc"]) if "int_tx_pkt__dc" in data else 0,
                baud1=meta["avr_baud"],
                baud2=meta["ext_baud"],
                ints_timer=meta["ints_timer"],
            )
    except (OSError, KeyError, ValueError, TypeError, zipfile.BadZipFile) as error:
        raise UsageError(f"{path}: not a recording of s3g ({error})") from error


def changes(data: Any, name: str) -> tuple[Words, Words]:
    """Return cycles and values of a list in a recording; empty if it has none of that name."""
    if f"{name}__dc" not in data:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    return np.cumsum(data[f"{name}__dc"], dtype=np.int64), data[f"{name}__v"].astype(np.int64)


def _replay_twin(golden: S3GGolden) -> EdgeTrace:
    from pulsewright.boards.s3g.twin import S3GTwin

    twin = S3GTwin(bus_pins=True, **golden.settings)
    twin.schedule(golden.cycle, golden.pin, golden.level)
    twin.advance(golden.expected.end)
    return twin.drain()


def _replay_rtl(golden: S3GGolden) -> EdgeTrace:
    from pulsewright.boards.s3g.gateware import S3G
    from pulsewright.gateware.rtl import RtlSimulation

    return replay_on(RtlSimulation(S3G(**golden.settings)), golden)


def replay_on(simulation: RtlSimulation, golden: Golden) -> EdgeTrace:
    """Give the inputs of a recording to gateware that is at its cycle 0; return as `replay`."""
    from pulsewright.gateware.rtl import pin_changes

    at = np.unique(np.concatenate([[0], golden.cycle]))
    inputs = np.zeros(len(at), simulation.inputs)
    inputs["cycle"] = at
    for pin in INPUTS:
        inputs[pin] = golden.levels(pin, 1, at)
    rows = simulation.run(golden.expected.end, inputs)
    expected = golden.expected
    cycles, _ = pin_changes(rows, [_port(name) for name in OUTPUTS], expected.initial)
    return EdgeTrace(expected.clock_hz, OUTPUTS, expected.initial, cycles, 0, expected.end)


RECORDINGS: Final = Recordings("s3g", load, {"twin": _replay_twin, "rtl": _replay_rtl})


def _port(pin: str) -> tuple[str, int]:
    """Return the port of the gateware that has a pin, and its bit."""
    if pin.startswith("led"):
        return "led", int(pin.removeprefix("led"))
    if pin.startswith("mot"):
        channel, name = pin.removeprefix("mot").split("_")
        return f"mot_{name}", int(channel)
    return pin, 0


def _expected(data: Any, clock_hz: int, end: int) -> EdgeTrace:
    """Return the changes of the output pins as a trace."""
    initial, cycles = [], []
    for pin in OUTPUTS:
        at, level = _levels(data, pin)
        initial.append(level[0])
        cycles.append(at[1:][np.flatnonzero(np.diff(level))] - 1)
    return EdgeTrace(clock_hz, OUTPUTS, np.array(initial, np.uint8), tuple(cycles), 0, end)


def _levels(data: Any, pin: str) -> tuple[Words, Words]:
    """Return cycles and levels of an output pin."""
    if pin.startswith("led"):
        at, value = changes(data, "pin_led")
        return at, value >> int(pin.removeprefix("led")) & 1
    if pin.startswith("mot"):
        channel, name = pin.removeprefix("mot").split("_")
        return changes(data, f"pin_mot_{AXES[int(channel)]}_{name}")
    return changes(data, f"pin_{pin}")
