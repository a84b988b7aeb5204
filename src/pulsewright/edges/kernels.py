"""Compiled loops over edges. Imported on first use, since loading a compiler takes time."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

Ints = NDArray[np.int64]

NEVER: Final = -(1 << 62)  # cycle of what has not happened yet

# Elements of the state that `measure_timing` carries from chunk to chunk: cycles, or `NEVER`.
ACTIVE, TRAILING, CHANGE, PENDING, CHANGED = 0, 1, 2, 3, 4
STATE_SIZE: Final = 5
# Rows of its results, in the order of `timing.KINDS`
WIDTH, SPACE, SETUP, HOLD, HOLD_TRAILING = 0, 1, 2, 3, 4


@njit(cache=True, inline="always")
def _note(kind: int, value: int, cycle: int, need: Ints, low: Ints, at: Ints, below: Ints) -> None:
    if value < low[kind]:
        low[kind] = value
        at[kind] = cycle
    if value < need[kind]:
        below[kind] += 1


@njit(cache=True)
def measure_timing(
    step: Ints,
    active: int,
    direction: Ints,
    need: Ints,
    state: Ints,
    low: Ints,
    at: Ints,
    below: Ints,
) -> None:
    """Measure one motor's pulses and direction changes in one chunk, in place.

    Parameters
    ----------
    step, direction : (n,), (m,) int64
        Cycles of the changes of both pins.
    active : int
        1 if the step pin is at its active level before the chunk.
    need : (5,) int64
        Required times [cycle].
    state : (STATE_SIZE,) int64
        Carried on; all `NEVER` before the first chunk.
    low, at, below : (5,) int64
        Shortest time of each kind [cycle], where its last edge was, and how many were too short.
    """
    i, j = 0, 0
    while i < step.size or j < direction.size:
        # A direction change in the cycle of a step edge counts as being before it: setup 0.
        if j < direction.size and (i == step.size or direction[j] <= step[i]):
            now = direction[j]
            j += 1
            if state[ACTIVE] != NEVER and state[CHANGED] == NEVER:
                _note(HOLD, now - state[ACTIVE], now, need, low, at, below)
                state[CHANGED] = now
                if active:
                    state[PENDING] = now
                elif state[TRAILING] != NEVER:
                    _note(HOLD_TRAILING, now - state[TRAILING], now, need, low, at, below)
            state[CHANGE] = now
            continue
        now = step[i]
        i += 1
        active = 1 - active
        if active:
            if state[TRAILING] != NEVER:
                _note(SPACE, now - state[TRAILING], now, need, low, at, below)
            if state[CHANGE] != NEVER:
                _note(SETUP, now - state[CHANGE], now, need, low, at, below)
            state[ACTIVE] = now
            state[CHANGED] = NEVER
        else:
            if state[ACTIVE] != NEVER:
                _note(WIDTH, now - state[ACTIVE], now, need, low, at, below)
            if state[PENDING] != NEVER:
                _note(HOLD_TRAILING, state[PENDING] - now, now, need, low, at, below)
                state[PENDING] = NEVER
            state[TRAILING] = now
