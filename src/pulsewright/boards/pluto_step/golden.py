"""Recordings of the original controller in the format ``pluto-golden-1``."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.golden import Golden
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError

FORMAT: Final = "pluto-golden-1"
# Input word: pin, lowest bit, bits.
INPUTS: Final = (
    ("nwrite", 0, 1),
    ("ndatastr", 1, 1),
    ("naddrstr", 2, 1),
    ("ninit", 3, 1),
    ("data", 4, 8),
    *((f"din{n}", 16 + n, 1) for n in range(16)),
)
IDLE: Final = 0xF  # input word before the first row
# Output word, from bit 0 up.
OUTPUTS: Final = (
    *(f"step{axis}" for axis in range(4)),
    *(f"dir{axis}" for axis in range(4)),
    *(f"out{n}" for n in range(14)),
    *("led", "tristate", "nwait", "nconfig", "drive"),
    *(f"data{n}" for n in range(8)),
)
HIGH: Final = ("nwait", "nconfig")  # before edge 0


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
            cycle, pin, level = _stimulus(data["in_delta"], data["in_word"])
            return Golden(
                name=meta["name"],
                description=meta["description"],
                cycle=cycle,
                pin=pin,
                level=level,
                expected=_response(
                    meta["clock_hz"], meta["n_cycles"], data["out_delta"], data["out_word"]
                ),
                transactions=len(data["txn"]),
            )
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        if isinstance(error, UsageError):
            raise
        raise UsageError(f"{path}: not a recording of pluto-step ({error})") from error


def _stimulus(
    delta: NDArray[np.uint32], word: NDArray[np.uint32]
) -> tuple[NDArray[np.int64], NDArray[np.str_], NDArray[np.int64]]:
    """Return the changes of the input pins as columns, by cycle."""
    at = np.cumsum(delta, dtype=np.int64)
    words = np.concatenate([[IDLE], word]).astype(np.int64)
    cycle, pin, level = [], [], []
    for number, (_, lsb, width) in enumerate(INPUTS):
        value = words >> lsb & ((1 << width) - 1)
        rows = np.flatnonzero(np.diff(value))
        cycle.append(at[rows])
        pin.append(np.full(len(rows), number))
        level.append(value[1:][rows])
    cycles, pins, levels = (np.concatenate(column) for column in (cycle, pin, level))
    order = np.argsort(cycles, kind="stable")
    names = np.array([name for name, _, _ in INPUTS])
    return cycles[order], names[pins[order]], levels[order]


def _response(
    clock_hz: int, end: int, delta: NDArray[np.uint32], word: NDArray[np.uint64]
) -> EdgeTrace:
    at = np.cumsum(delta, dtype=np.int64)
    initial = np.array([pin in HIGH for pin in OUTPUTS], np.uint8)
    cycles = []
    for n, first in enumerate(initial):
        level = np.concatenate([[first], word >> np.uint64(n) & np.uint64(1)]).astype(np.int8)
        cycles.append(at[np.flatnonzero(np.diff(level))])
    return EdgeTrace(clock_hz, OUTPUTS, initial, tuple(cycles), 0, end)
