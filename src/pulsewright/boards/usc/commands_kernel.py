"""The compiled loop of `commands.Converter`."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.usc import registers
from pulsewright.boards.usc.burst import CONTROL_ACCESS, DIVISOR_ACCESS
from pulsewright.boards.usc.commands import DEVIATION
from pulsewright.motion.evaluate import sample
from pulsewright.twin.kernel import kernel

TICK_CYCLES: Final = registers.TICK_CYCLES
SECONDS_PER_CYCLE: Final = 1.0 / registers.CLOCK_HZ
# a halted counter keeps no phase, a counter near its end steps by itself: halt well before
LONGEST_PERIOD: Final = (1 << 24) - 1 - 20_000

BASE, PULSE, SETTLED, COUNT, DIRECTION, RUN = range(6)  # columns of the state


@kernel
def convert(
    geometry: Any,
    law: Any,
    parameters: NDArray[np.int64],
    state: NDArray[np.int64],
    plan: NDArray[np.float64],
    divisor: NDArray[np.uint32],
    control: NDArray[np.uint8],
    count: NDArray[np.int64],
) -> tuple[float, int, int]:
    """Fill ``divisor``, ``control`` and ``count`` for n updates; advance ``state``.

    Bits of the motors in ``control`` have to be 0 before.
    ``plan`` (2, n + 2) is to work with: from `sample`, where a motor is when updates act. Stops
    where the board falls behind the plan by more than `DEVIATION`; returns by how much [step], the
    axis and the index of the update, or 0 if it does not.
    """
    cycle, origin, update, width, setup, shortest, offset, access = parameters
    ticks = update // TICK_CYCLES
    settled_at = (cycle + CONTROL_ACCESS * access) // TICK_CYCLES + 1  # run, direction act
    for i in range(state.shape[0]):
        base, pulse, settled = state[i, BASE], state[i, PULSE], state[i, SETTLED]
        # whole numbers, but they meet the plan only
        counted, direction = float(state[i, COUNT]), float(state[i, DIRECTION])
        run = state[i, RUN]
        commit = (cycle + DIVISOR_ACCESS[i] * access) // TICK_CYCLES + 1  # divisor acts
        later = settled_at - commit
        first_cycle = commit * TICK_CYCLES - origin
        sample(geometry, law, i, first_cycle, update, SECONDS_PER_CYCLE, plan)
        now, target = plan[1, 0], plan[1, 1]
        for j in range(divisor.shape[0]):
            settle, end = commit + later, commit + ticks  # the next divisor acts at the end
            ahead = plan[1, j + 2]
            change = ahead - target

            phase = direction * (target - counted) + 0.5
            if phase < 0.0 or (phase < 1.0 and direction * change < 0.0):
                direction = -direction
                phase = 1.0 - phase
                # the board changes the pin when the last pulse is over for the setup time, and
                # holds pulses back for the setup time after that
                free = max(settle, pulse + width + setup)
                settled = free + setup + 1
            whole = np.floor(phase)
            steps = int(whole)

            first = commit  # first tick under the new command
            if run == 0:
                first = base = settle
            elapsed = end - base
            period = LONGEST_PERIOD + 1  # halt
            even = False
            if steps >= 1:
                # the last step falls when the plan passes its half step, the others evenly before
                before = direction * (now - counted) + 0.5
                share = (whole - before) / (phase - before) if phase > before else 0.0
                last = commit + int(min(max(share, 0.0), 1.0) * ticks)
                period = (last - base + (steps >> 1) + 1) // steps
                if period * (steps + 1) <= elapsed:
                    period = elapsed // (steps + 1) + 1
                if period * steps > elapsed:
                    period = elapsed // steps
                earliest = max(first, settled, pulse + shortest)
                even = base + period > earliest and shortest <= period <= LONGEST_PERIOD
                if even and period * (steps + 1) > elapsed:  # the usual case: no more divisions
                    base += steps * period
                    pulse = base - 1
                    counted += direction * whole
                else:
                    even = False
                    if base + period <= earliest:
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
                run = 0
                divisor[j, i] = (1 << 24) - 1
            else:
                run = 1
                divisor[j, i] = period - offset
                if not even:
                    following = max(first, base + period - 1)
                    if following < end:
                        pulses = 1 + (end - 1 - following) // period
                        pulse = following + (pulses - 1) * period
                        base = pulse + 1
                        counted += direction * pulses
            byte = 2 * run + (direction > 0)
            control[j] |= byte << 2 * i
            count[j, i] = int(counted)
            if abs(target - counted) > DEVIATION:
                return abs(target - counted), i, j
            now, target, commit = target, ahead, end
        state[i, BASE], state[i, PULSE], state[i, SETTLED] = base, pulse, settled
        state[i, COUNT], state[i, DIRECTION] = int(counted), int(direction)
        state[i, RUN] = run
    return 0.0, 0, 0
