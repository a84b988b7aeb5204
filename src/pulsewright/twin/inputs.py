"""Changes of input pins that are still to come, as the kernels take them: (cycle, pin, level)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pulsewright.errors import UsageError


class InputPins:
    """Names and levels of the input pins of a twin.

    Parameters
    ----------
    twin : str
        For messages: ``usc twin``.
    pins : tuple of str
        Names; a pin's number is its place here.
    most : mapping of str to int
        Highest level of pins that are wider than one bit.
    """

    def __init__(self, twin: str, pins: tuple[str, ...], most: Mapping[str, int]) -> None:
        self.twin, self.pins = twin, pins
        self._number = {pin: n for n, pin in enumerate(pins)}
        self._most = np.array([most.get(pin, 1) for pin in pins], np.int64)

    def events(
        self,
        cycles: ArrayLike,
        pins: str | Sequence[str] | ArrayLike,
        levels: ArrayLike,
        done: int,
    ) -> NDArray[np.int64]:
        """Return changes as an array (n, 3) of cycle, pin number and level, checked.

        Parameters
        ----------
        cycles : (n,) int
            First edge that samples the new level, after ``done``, the last edge that is over.
        pins : (n,) str or int, or one of them for all
            Names or numbers.
        levels : (n,) int, or one for all

        Raises
        ------
        UsageError
            If a pin is unknown, a level not possible or a cycle over.
        """
        cycle = np.atleast_1d(np.asarray(cycles))
        pin, level = np.atleast_1d(self._numbers(pins)), np.atleast_1d(np.asarray(levels))
        events = np.empty((len(cycle), 3), np.int64)
        for column, values in zip(events.T, (cycle, pin, level), strict=True):
            column[:] = values
        if len(events):
            self._check(cycle, pin, level, done)
        return events

    def _numbers(self, pins: str | Sequence[str] | ArrayLike) -> NDArray[np.int64]:
        array = np.asarray(pins)
        if array.dtype.kind != "U":
            return array.astype(np.int64, copy=False)
        names, place = np.unique(array, return_inverse=True)
        unknown = [str(name) for name in names if str(name) not in self._number]
        if unknown:
            raise UsageError(
                f"{self.twin}: no input pin '{unknown[0]}'; the pins are {', '.join(self.pins)}"
            )
        return np.array([self._number[str(name)] for name in names], np.int64)[place]

    def _check(
        self, cycle: NDArray[Any], pin: NDArray[np.int64], level: NDArray[Any], done: int
    ) -> None:
        """Check changes, of which pins and levels may be one for all."""
        if cycle.min() <= done:
            raise UsageError(
                f"{self.twin}: an input change at cycle {cycle.min()}, but that is over; cycles "
                f"from {done + 1} on are allowed"
            )
        if not 0 <= pin.min() <= pin.max() < len(self.pins):
            raise UsageError(
                f"{self.twin}: input pin numbers {pin.min()}..{pin.max()}; allowed are "
                f"0..{len(self.pins) - 1}"
            )
        if level.min() >= 0 and level.max() <= self._most.min():  # as nearly always
            return
        pin, level = (np.broadcast_to(part, len(cycle)) for part in (pin, level))
        wrong = np.flatnonzero((level < 0) | (level > self._most[pin]))
        if len(wrong):
            first = int(wrong[0])
            raise UsageError(
                f"{self.twin}: level {level[first]} for input pin {self.pins[pin[first]]}; allowed "
                f"are 0..{self._most[pin[first]]}"
            )


def merged(queue: NDArray[np.int64], events: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return both in order of cycles; of several changes of a pin at a cycle, the last one."""
    if _follows(queue, events):
        return np.concatenate([queue, events]) if len(queue) else np.ascontiguousarray(events)
    queue = np.concatenate([queue, events])
    queue = queue[np.lexsort((queue[:, 1], queue[:, 0]))]  # stable
    last = np.append(np.any(queue[1:, :2] != queue[:-1, :2], axis=1), True)[: len(queue)]
    return np.ascontiguousarray(queue[last])


def _follows(queue: NDArray[np.int64], events: NDArray[np.int64]) -> bool:
    """Tell whether events are in order and after all of the queue, so that nothing is to sort."""
    if len(queue) and len(events) and events[0, 0] <= queue[-1, 0]:
        return False
    cycle, pin = events[:, 0], events[:, 1]
    step = cycle[1:] - cycle[:-1]
    later = step > 0
    if not later.all():
        later |= (step == 0) & (pin[1:] > pin[:-1])
    return bool(later.all())
