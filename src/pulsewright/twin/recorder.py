"""Edge buffers: every level change of every pin, in storage that is used again.

Kernels write into one flat array in which each pin owns a row. They stop when a row is nearly full
(`Rows.full`), and the caller makes room (`Recorder.grow`) and goes on: no edge is ever lost.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pulsewright.edges.trace import EdgeTrace
from pulsewright.twin.kernel import hot, kernel

RESERVE: Final = 16  # places that pulse trains leave free in a row
NEARLY_FULL: Final = 2 * RESERVE  # a row with fewer free places is to grow before the next event
FIRST_ROOM: Final = 1024  # edges a row holds at first
_NONE: Final = np.zeros(0, np.int64)

# One pin: where its row begins, how many edges the row can hold and holds, present level.
PIN: Final = np.dtype([(name, np.int64) for name in ("first", "room", "used", "level")])


class Rows(NamedTuple):
    """The buffers as kernels see them, one row per pin.

    Parameters
    ----------
    cycles : (sum of room,) int64
        Cycles of the changes.
    pins : (pins,) PIN
        The rows.
    full : (1,) int64
        1 once a row is nearly full.
    """

    cycles: NDArray[np.int64]
    pins: NDArray[np.void]
    full: NDArray[np.int64]


@kernel
def toggle(rows: Rows, row: int, cycle: int) -> None:
    """Change a pin at ``cycle``; a change back in the same cycle leaves no edge."""
    pin = rows.pins[row]
    end = pin.first + pin.used
    pin.level ^= 1
    if pin.used > 0 and rows.cycles[end - 1] == cycle:
        pin.used -= 1
        return
    rows.cycles[end] = cycle
    pin.used += 1
    if pin.room - pin.used < NEARLY_FULL:
        rows.full[0] = 1


@kernel
def drive(rows: Rows, row: int, level: int, cycle: int) -> None:
    """Bring a pin to ``level`` at ``cycle``."""
    if rows.pins[row].level != level:
        toggle(rows, row, cycle)


@hot
def pulses(rows: Rows, row: int, cycle: int, period: int, width: int, count: int) -> None:
    """Write ``count`` whole pulses of a low pin: up at ``cycle``, down ``width`` cycles later."""
    pin = rows.pins[row]
    at = pin.first + pin.used
    train = rows.cycles[at : at + 2 * count]
    for k in range(count):  # without state from pulse to pulse, so that it becomes vector code
        rise = cycle + k * period
        train[2 * k] = rise
        train[2 * k + 1] = rise + width
    pin.used += 2 * count
    if pin.room - pin.used < NEARLY_FULL:
        rows.full[0] = 1


class Recorder:
    """Edge buffers of some pins.

    Parameters
    ----------
    pins : tuple of str
        Their names, in the order of the rows.
    clock_hz : int
        Clock of the board [Hz].
    high : tuple of str
        Pins that are high at first; the others are low.
    """

    def __init__(self, pins: tuple[str, ...], clock_hz: int, high: tuple[str, ...] = ()) -> None:
        n = len(pins)
        self.pins, self._clock_hz, self._start = pins, clock_hz, 0
        self._initial = np.array([pin in high for pin in pins], np.uint8)
        table = np.zeros(n, PIN)
        table["first"], table["room"] = np.arange(n) * FIRST_ROOM, FIRST_ROOM
        table["level"] = self._initial
        self.rows = Rows(np.empty(n * FIRST_ROOM, np.int64), table, np.zeros(1, np.int64))

    def grow(self) -> None:
        """Double the rows that are nearly full; the others keep their size."""
        old = self.rows
        pins = old.pins.copy()
        free = old.pins["room"] - old.pins["used"]
        pins["room"] = np.where(free < NEARLY_FULL, 2 * old.pins["room"], old.pins["room"])
        pins["first"] = np.cumsum(pins["room"]) - pins["room"]
        cycles = np.empty(int(pins["room"].sum()), np.int64)
        for before, now in zip(old.pins, pins, strict=True):
            used = old.cycles[before["first"] : before["first"] + before["used"]]
            cycles[now["first"] : now["first"] + now["used"]] = used
        self.rows = Rows(cycles, pins, np.zeros(1, np.int64))

    def drain(self, end: int, copy: bool = True) -> EdgeTrace:
        """Return the changes before cycle ``end`` that were not returned yet, and forget them.

        Every change must be at ``end`` or before; those at ``end`` stay for the next time, since
        the cycle may not be over.

        Parameters
        ----------
        end : int
            First cycle not returned.
        copy : bool
            False: the trace looks into the buffers and is valid until they are written to again.
        """
        rows = self.rows
        cycles, kept = [], []
        for first, _, used, _ in rows.pins.tolist():
            if not used:  # as most pins are in a short time
                cycles.append(_NONE)
                kept.append(0)
                continue
            late = int(rows.cycles[first + used - 1] == end)
            whole = rows.cycles[first : first + used - late]
            cycles.append(whole.copy() if copy or late else whole)
            if late:
                rows.cycles[first] = end
            kept.append(late)
        rows.pins["used"] = kept
        trace = EdgeTrace(self._clock_hz, self.pins, self._initial, tuple(cycles), self._start, end)
        self._start, self._initial = end, trace.final()
        rows.full[0] = 0
        return trace
