"""The compiled loop of `commands.Converter`."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.pluto_step.burst import VELOCITY_ACCESS
from pulsewright.boards.pluto_step.commands import DEVIATION
from pulsewright.boards.pluto_step.registers import CLOCK_HZ, TICK_CYCLES
from pulsewright.motion.evaluate import sample
from pulsewright.twin.kernel import inlined, kernel

SECONDS_PER_CYCLE: Final = 1.0 / CLOCK_HZ
POSITION, DIRECTION, TICK, BEYOND, SPEED = range(5)  # columns of the state


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
    plan: NDArray[np.float64],
    velocity: NDArray[np.int16],
    count: NDArray[np.int64],
) -> tuple[float, int, int]:
    """Fill ``velocity`` and ``count`` for n updates; advance ``state``.

    ``plan`` (1 + motors, n + 1) is to work with: from `sample`, where motors are at the ends of
    updates. Stops where the board misses the plan by more than `DEVIATION`; returns by how much
    [step], the axis and the index of the update, or 0 if it does not.
    """
    cycle, origin, update, step, direction, limit, bits, access = parameters
    unit = 1 << bits
    margin = update // 2 + 1  # more than half a word in an update [unit]
    for i in range(state.shape[0] - 1, -1, -1):  # `sample` spoils the row before its own
        end = (cycle + VELOCITY_ACCESS[i] * access) // TICK_CYCLES + 1 + update
        # a crossing shows at the pins at the next tick: half a tick late on average
        first = end * TICK_CYCLES + TICK_CYCLES // 2 - origin
        places = plan[i : i + 2]
        sample(geometry, law, i, first, update * TICK_CYCLES, SECONDS_PER_CYCLE, places)
    # all motors in turn: what one waits for, the processor does beside the others
    for j in range(velocity.shape[0]):
        for i in range(state.shape[0]):
            # first tick under the new word, and first under the next one
            commit = (cycle + VELOCITY_ACCESS[i] * access) // TICK_CYCLES + 1 + j * update
            end = commit + update
            position = state[i, POSITION]
            place = plan[1 + i, j]
            target = (place + 0.5) * unit
            if plan[1 + i, j + 1] == place:  # at rest: so far from a crossing that none is reached
                step_below = math.floor(place + 0.5) * unit
                target = min(max(target, step_below + margin), step_below + unit - margin)
            error = target - position

            word = math.floor(error / update + 0.5)
            sign = -1 if word < 0 else 1
            run = update  # ticks that move
            if sign != state[i, DIRECTION]:
                crossing = state[i, TICK] - state[i, BEYOND] // state[i, SPEED]
                run -= freeze(commit, crossing, step, direction)
                word = math.floor(error / run + 0.5)
                word = min(word, -1) if sign < 0 else max(word, 0)
                state[i, DIRECTION] = sign
            word = min(max(word, -limit), limit)

            steps = position >> bits
            position += word * run
            state[i, POSITION] = position
            if position >> bits != steps:
                steps = position >> bits
                into = position & (unit - 1)
                # the last crossing: so far before the end of a tick, at this speed
                state[i, TICK], state[i, SPEED] = end - 1, abs(word)
                state[i, BEYOND] = into if word > 0 else unit - 1 - into
            velocity[j, i] = word
            count[j, i] = steps
            if abs(target - position) > DEVIATION * unit:
                return abs(target - position) / unit, i, j
    return 0.0, 0, 0
