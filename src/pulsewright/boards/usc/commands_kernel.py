"""The compiled loop of `commands.Converter`."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.usc import registers
from pulsewright.boards.usc.burst import CONTROL_ACCESS, DIVISOR_ACCESS
from pulsewright.motion.evaluate import position_at
from pulsewright.twin.kernel import kernel

TICK_CYCLES: Final = registers.TICK_CYCLES
SECONDS_PER_CYCLE: Final = 1.0 / registers.CLOCK_HZ
# a halted counter keeps no phase, a counter near its end steps by itself: halt well before
LONGEST_PERIOD: Final = (1 << 24) - 1 - 20_000

BASE, PULSE, SETTLED, COUNT, DIRECTION, RUN, PIECE = range(7)  # columns of the state


@kernel
def convert(
    geometry: Any,
    law: Any,
    parameters: NDArray[np.int64],
    state: NDArray[np.int64],
    ahead: NDArray[np.float64],
    cycle: NDArray[np.int64],
    divisor: NDArray[np.uint32],
    control: NDArray[np.uint8],
    count: NDArray[np.int64],
) -> tuple[float, int, int]:
    """Fill ``divisor``, ``control`` and ``count`` for updates at ``cycle``; advance ``state``.

    ``ahead`` (motors, 2) holds the planned positions when the next two updates act, NaN before the
    first call. Returns the largest distance from the plan at an update [step], its axis and
    the index of its update.
    """
    origin, update, width, setup, shortest, offset, access = parameters
    worst, worst_axis, worst_update = 0.0, 0, 0
    for j in range(cycle.size):
        settle = (cycle[j] + CONTROL_ACCESS * access) // TICK_CYCLES + 1  # run, direction act
        byte = np.int64(0x55)
        for i in range(state.shape[0]):
            commit = (cycle[j] + DIVISOR_ACCESS[i] * access) // TICK_CYCLES + 1  # divisor acts
            end = commit + update // TICK_CYCLES  # and until here
            if math.isnan(ahead[i, 0]):
                time = (commit * TICK_CYCLES - origin) * SECONDS_PER_CYCLE
                ahead[i, 0], state[i, PIECE] = position_at(geometry, law, i, time, state[i, PIECE])
                time = (end * TICK_CYCLES - origin) * SECONDS_PER_CYCLE
                ahead[i, 1], state[i, PIECE] = position_at(geometry, law, i, time, state[i, PIECE])
            now = ahead[i, 0]
            ahead[i, 0] = ahead[i, 1]
            time = (end * TICK_CYCLES + update - origin) * SECONDS_PER_CYCLE
            ahead[i, 1], state[i, PIECE] = position_at(geometry, law, i, time, state[i, PIECE])
            target, change = ahead[i, 0], ahead[i, 1] - ahead[i, 0]

            direction = state[i, DIRECTION]
            phase = direction * (target - state[i, COUNT]) + 0.5
            if phase < 0.0 or (phase < 1.0 and direction * change < 0.0):
                direction = -direction
                phase = 1.0 - phase
                # the board changes the pin when the last pulse is over for the setup time, and
                # holds pulses back for the setup time after that
                free = max(settle, state[i, PULSE] + width + setup)
                state[i, SETTLED] = free + setup + 1
            steps = int(phase)

            active = state[i, RUN] == 1
            first = commit if active else settle  # first tick under the new command
            base = state[i, BASE] if active else settle
            elapsed = end - base
            period = LONGEST_PERIOD + 1  # halt
            if steps >= 1:
                # the last step falls when the plan passes its half step, the others evenly before
                before = direction * (now - state[i, COUNT]) + 0.5
                share = (steps - before) / (phase - before) if phase > before else 0.0
                last = commit + int(min(max(share, 0.0), 1.0) * (end - commit))
                period = (last - base + steps // 2 + 1) // steps
                period = min(max(period, elapsed // (steps + 1) + 1), elapsed // steps)
                earliest = max(first, state[i, SETTLED], state[i, PULSE] + shortest)
                if base + period - 1 < earliest:
                    rest = end - first - 1
                    if steps >= 2 and earliest == first:
                        # overdue: a pulse at once, the others evenly after it
                        period = (last - first) // (steps - 1)
                        period = min(max(period, rest // steps + 1), rest // (steps - 1))
                        period = min(period, first - base + 1)
                    else:
                        period = earliest - base + 1
                period = max(period, shortest)
            elif change != 0.0 and phase * LONGEST_PERIOD > elapsed:
                period = max(math.ceil(elapsed / phase), elapsed + 1)

            if period > LONGEST_PERIOD:
                state[i, RUN] = 0
                divisor[j, i] = (1 << 24) - 1
            else:
                state[i, RUN] = 1
                state[i, BASE] = base
                divisor[j, i] = period - offset
                pulse = max(first, base + period - 1)
                if pulse < end:
                    pulses = 1 + (end - 1 - pulse) // period
                    state[i, PULSE] = pulse + (pulses - 1) * period
                    state[i, BASE] = state[i, PULSE] + 1
                    state[i, COUNT] += direction * pulses
            state[i, DIRECTION] = direction
            byte &= ~(3 << (2 * i))
            byte |= (state[i, RUN] << (2 * i + 1)) | ((direction + 1) >> 1 << (2 * i))
            count[j, i] = state[i, COUNT]
            distance = abs(target - state[i, COUNT])
            if distance > worst:
                worst, worst_axis, worst_update = distance, i, j
        control[j] = byte
    return worst, worst_axis, worst_update
