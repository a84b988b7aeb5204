"""Compiled loops over edges. Imported on first use, since loading a compiler takes time."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import compiled

Ints = NDArray[np.int64]

NEVER: Final = -(1 << 62)  # cycle of what has not happened yet

# Elements of the state that `measure_timing` carries from chunk to chunk: cycles, or `NEVER`.
# The last active and trailing edge and direction change; the first direction change after the last
# active edge; the same if the pulse has not ended since.
ACTIVE, TRAILING, CHANGE, CHANGED, PENDING = 0, 1, 2, 3, 4
STATE_SIZE: Final = 5
# Rows of its results, in the order of `timing.KINDS`
WIDTH, SPACE, SETUP, HOLD, HOLD_TRAILING = 0, 1, 2, 3, 4


@compiled()
def _note(kind: int, value: int, cycle: int, need: Ints, low: Ints, at: Ints, below: Ints) -> None:
    if value < low[kind]:
        low[kind] = value
        at[kind] = cycle
    below[kind] += value < need[kind]


@compiled()
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
        Shortest time of each kind [cycle], where its last edge was, and how many were too short;
        ``low`` is at most ``-NEVER``, so what never happened is never shorter.
    """
    # Local variables, since this runs once per step of a job.
    rise, fall, change = state[ACTIVE], state[TRAILING], state[CHANGE]
    changed, pending = state[CHANGED], state[PENDING]
    width, width_at, narrow, width_need = low[WIDTH], at[WIDTH], 0, need[WIDTH]
    space, space_at, close, space_need = low[SPACE], at[SPACE], 0, need[SPACE]
    setup, setup_at, early, setup_need = low[SETUP], at[SETUP], 0, need[SETUP]
    i = 0
    for j in range(direction.size + 1):
        # A direction change in the cycle of a step edge counts as being before it: setup 0.
        until = direction[j] if j < direction.size else -NEVER
        while i < step.size and step[i] < until:
            now = step[i]
            i += 1
            active = 1 - active
            if active:
                if now - fall < space:
                    space, space_at = now - fall, now
                if now - change < setup:
                    setup, setup_at = now - change, now
                close += now - fall < space_need
                early += now - change < setup_need
                rise, changed = now, NEVER
            else:
                if now - rise < width:
                    width, width_at = now - rise, now
                narrow += now - rise < width_need
                if pending != NEVER:
                    _note(HOLD_TRAILING, pending - now, now, need, low, at, below)
                    pending = NEVER
                fall = now
        if j == direction.size:
            break
        if rise != NEVER and changed == NEVER:
            _note(HOLD, until - rise, until, need, low, at, below)
            changed = until
            if active:
                pending = until
            elif fall != NEVER:
                _note(HOLD_TRAILING, until - fall, until, need, low, at, below)
        change = until
    state[ACTIVE], state[TRAILING], state[CHANGE] = rise, fall, change
    state[CHANGED], state[PENDING] = changed, pending
    low[WIDTH], at[WIDTH], low[SPACE], at[SPACE] = width, width_at, space, space_at
    low[SETUP], at[SETUP] = setup, setup_at
    below[WIDTH] += narrow
    below[SPACE] += close
    below[SETUP] += early
