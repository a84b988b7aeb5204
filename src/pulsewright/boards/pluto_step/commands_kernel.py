"""The compiled loop of `commands.Converter`."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.pluto_step.burst import VELOCITY_ACCESS
from pulsewright.boards.pluto_step.registers import CLOCK_HZ, TICK_CYCLES
from pulsewright.motion.evaluate import position_at
from pulsewright.twin.kernel import inlined, kernel

SECONDS_PER_CYCLE: Final = 1.0 / CLOCK_HZ
POSITION, DIRECTION, CROSSING, PIECE = range(4)  # columns of the state


@inlined
def freeze(commit: int, crossing: int, step: int, direction: int) -> int:
    """Return for how many ticks a change of direction that starts at ``commit`` stops the position.

    The board finishes a pulse, the one that is due at this very tick included, waits for the hold
    time, changes the pin, waits for the set-up time, and lets one more tick pass at each of the
    three.
    """
    started = crossing + 1  # the tick at which the last pulse starts
    return max(0, step - (commit - started)) + 2 * direction + 1


@kernel
def convert(
    geometry: Any,
    law: Any,
    parameters: NDArray[np.int64],
    state: NDArray[np.int64],
    ahead: NDArray[np.float64],
    cycle: NDArray[np.int64],
    velocity: NDArray[np.int16],
    count: NDArray[np.int64],
) -> tuple[float, int, int]:
    """Fill ``velocity`` and ``count`` for updates at ``cycle``; advance ``state``.

    ``ahead`` (motors,) holds the planned position at the end of the next update, NaN before the
    first call. Returns the largest distance from the plan at an update [step], its axis and the
    index of its update.
    """
    origin, update, step, direction, limit, unit, access = parameters
    margin = update // 2 + 1  # more than half a word in an update [unit]
    worst, worst_axis, worst_update = 0.0, 0, 0
    for j in range(cycle.size):
        for i in range(state.shape[0]):
            # first tick under the new word, and first under the next one
            commit = (cycle[j] + VELOCITY_ACCESS[i] * access) // TICK_CYCLES + 1
            end = commit + update
            # a crossing shows at the pins at the next tick: half a tick late on average
            cycles = end * TICK_CYCLES + TICK_CYCLES // 2 - origin
            if math.isnan(ahead[i]):
                time = cycles * SECONDS_PER_CYCLE
                ahead[i], state[i, PIECE] = position_at(geometry, law, i, time, state[i, PIECE])
            planned = ahead[i]
            time = (cycles + update * TICK_CYCLES) * SECONDS_PER_CYCLE
            ahead[i], state[i, PIECE] = position_at(geometry, law, i, time, state[i, PIECE])
            target = (planned + 0.5) * unit
            if ahead[i] == planned:  # at rest: so far from a crossing that no rounding reaches it
                step_below = math.floor(planned + 0.5) * unit
                target = min(max(target, step_below + margin), step_below + unit - margin)
            error = target - state[i, POSITION]

            word = math.floor(error / update + 0.5)
            sign = -1 if word < 0 else 1
            run = update  # ticks that move
            if sign != state[i, DIRECTION]:
                run -= freeze(commit, state[i, CROSSING], step, direction)
                word = math.floor(error / run + 0.5)
                word = min(word, -1) if sign < 0 else max(word, 0)
                state[i, DIRECTION] = sign
            word = min(max(word, -limit), limit)

            position = state[i, POSITION] + word * run
            state[i, POSITION] = position
            if word != 0:
                into = position % unit
                beyond = into if word > 0 else unit - 1 - into  # the last crossing
                since = beyond // abs(word)  # ticks from it to the last one
                if since < run:
                    state[i, CROSSING] = end - 1 - since
            velocity[j, i] = word
            count[j, i] = position // unit
            distance = abs(target - position) / unit
            if distance > worst:
                worst, worst_axis, worst_update = distance, i, j
    return worst, worst_axis, worst_update
