"""The compiled loop of `commands.Converter`."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.usc import registers
from pulsewright.boards.usc.burst import CONTROL_ACCESS, DIVISOR_ACCESS
from pulsewright.boards.usc.commands import DEVIATION
from pulsewright.compiled import inner
from pulsewright.motion.evaluate import rests_at, sample
from pulsewright.twin.kernel import kernel

TICK_CYCLES: Final = registers.TICK_CYCLES
SECONDS_PER_CYCLE: Final = 1.0 / registers.CLOCK_HZ
# a halted counter keeps no phase, a counter near its end steps by itself: halt well before
LONGEST_PERIOD: Final = (1 << 24) - 1 - 20_000

BASE, PULSE, SETTLED, COUNT, DIRECTION, RUN = range(6)  # columns of the state
LAST, SHARE, BEFORE, AFTER = range(4)  # rows of what is foreseen
BITS: Final = 36  # of a share: exact until the time times the steps needs as many


@inner
def foresee(places: NDArray[np.float64], ticks: int, foreseen: NDArray[np.int64]) -> None:
    """Fill ``foreseen`` (4, n) for updates of a motor that is where it should be, and goes on.

    ``places`` are where it should be when updates act [step]. Rows are: when the last step of an
    update is due, from its begin on, and half a period later [tick]; the share of a step in that,
    times 2^`BITS`; and the counts of steps before and after.

    No update needs to know what the one before it comes to. So the compiler makes several at once,
    which takes a fraction of the time of the loop that does.
    """
    for j in range(foreseen.shape[1]):
        now, target = places[j], places[j + 1]
        before, after = np.floor(now + 0.5), np.floor(target + 0.5)
        way = 1.0 if after > before else -1.0
        steps = way * (after - before)
        begin, end = way * (now - before) + 0.5, way * (target - before) + 0.5
        # the last step falls when the plan passes its half step, the others evenly before
        due = min(max((steps - begin) / (end - begin), 0.0), 1.0)
        steps = max(steps, 1.0)
        foreseen[LAST, j] = int(due * ticks) + (int(steps) >> 1) + 1
        foreseen[SHARE, j] = int((1 << BITS) / steps + 1.0)
        foreseen[BEFORE, j], foreseen[AFTER, j] = int(before), int(after)


@kernel
def convert(
    geometry: Any,
    law: Any,
    parameters: NDArray[np.int64],
    state: NDArray[np.int64],
    plan: NDArray[np.float64],
    foreseen: NDArray[np.int64],
    divisor: NDArray[np.uint32],
    control: NDArray[np.uint8],
    count: NDArray[np.int64],
) -> tuple[float, int, int]:
    """Fill ``divisor``, ``control`` and ``count`` for n updates; advance ``state``.

    Divisors have to be the largest before, and bits of the motors in ``control`` 0.
    ``plan`` (2, n + 2), from `sample`, where a motor is when updates act, and ``foreseen`` (4, n)
    are to work with. Stops where the board falls behind the plan by more than `DEVIATION`; returns
    by how much [step], the axis and the index of the update, or 0 if it does not.
    """
    cycle, origin, update, width, setup, shortest, offset, access = parameters
    ticks = update // TICK_CYCLES
    settled_at = (cycle + CONTROL_ACCESS * access) // TICK_CYCLES + 1  # run, direction act
    for i in range(state.shape[0]):
        base, pulse, settled = state[i, BASE], state[i, PULSE], state[i, SETTLED]
        counted, direction, run = state[i, COUNT], state[i, DIRECTION], state[i, RUN]
        commit = (cycle + DIVISOR_ACCESS[i] * access) // TICK_CYCLES + 1  # divisor acts
        later = settled_at - commit
        first_cycle = commit * TICK_CYCLES - origin
        if run == 0:
            end_cycle = first_cycle + (plan.shape[1] - 1) * update
            first_time, end_time = first_cycle * SECONDS_PER_CYCLE, end_cycle * SECONDS_PER_CYCLE
            if abs(rests_at(geometry, law, i, first_time, end_time) - counted) < 0.5:
                for j in range(control.size):
                    control[j] |= (direction > 0) << 2 * i
                    count[j, i] = counted
                continue
        sample(geometry, law, i, first_cycle, update, SECONDS_PER_CYCLE, plan)
        foresee(plan[1], ticks, foreseen)
        for j in range(divisor.shape[0]):
            end = commit + ticks  # the next divisor acts then
            after = foreseen[AFTER, j]
            steps = direction * (after - counted)
            period = (foreseen[LAST, j] + commit - base) * foreseen[SHARE, j] >> BITS
            over = base + steps * period
            if (  # what is foreseen, that is nearly always
                run == 1
                and counted == foreseen[BEFORE, j]
                and steps >= 1
                and shortest <= period <= LONGEST_PERIOD
                and over <= end < over + period
                and base + period > max(commit, settled, pulse + shortest)
            ):
                divisor[j, i] = period - offset
                control[j] |= 2 + (direction > 0) << 2 * i
                count[j, i] = counted = after
                base, pulse, commit = over, over - 1, end
                continue

            target = plan[1, j + 1]
            change = plan[1, j + 2] - target
            settle = commit + later
            phase = direction * (target - counted) + 0.5
            if phase < 0.0 or (phase < 1.0 and direction * change < 0.0):
                direction = -direction
                phase = 1.0 - phase
                # the board changes the pin when the last pulse is over for the setup time, and
                # holds pulses back for the setup time after that
                free = max(settle, pulse + width + setup)
                settled = free + setup + 1
            steps = int(np.floor(phase))

            first = commit  # first tick under the new command
            if run == 0:
                first = base = settle
            elapsed = end - base
            period = LONGEST_PERIOD + 1  # halt
            if steps >= 1:  # evenly up to where the last one is due, as in `foresee`
                begin = direction * (plan[1, j] - counted) + 0.5
                due = (steps - begin) / (phase - begin) if phase > begin else 0.0
                last = commit + int(min(max(due, 0.0), 1.0) * ticks)
                period = (last - base + (steps >> 1) + 1) // steps
                if period * (steps + 1) <= elapsed:
                    period = elapsed // (steps + 1) + 1
                if period * steps > elapsed:
                    period = elapsed // steps
                earliest = max(first, settled, pulse + shortest)
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

            run = 0
            if period <= LONGEST_PERIOD:
                run = 1
                divisor[j, i] = period - offset
                following = max(first, base + period - 1)
                if following < end:
                    pulses = 1 + (end - 1 - following) // period
                    pulse = following + (pulses - 1) * period
                    base = pulse + 1
                    counted += direction * pulses
            control[j] |= 2 * run + (direction > 0) << 2 * i
            count[j, i] = counted
            if abs(target - counted) > DEVIATION:
                return abs(target - counted), i, j
            commit = end
        state[i, BASE], state[i, PULSE], state[i, SETTLED] = base, pulse, settled
        state[i, COUNT], state[i, DIRECTION], state[i, RUN] = counted, direction, run
    return 0.0, 0, 0
