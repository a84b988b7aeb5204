"""One motor of the twin: accumulator (DDA) and pulse former, from step to step.

An accumulator is two words, the position [step] and its fraction in units of 2^-63 step; 32-bit
words have their values in the upper half. Increments are signed numbers of the same unit, so that a
tick that carries into the position, or borrows from it, shows in the highest bit of fraction plus
increment. Far from such a crossing, ticks are skipped: a lower bound of their number is known from
floating point, and what they add is exact modulo 2^64, which is all of it while nothing crosses.

Clock edge n ends cycle n. Of a tick in cycle t, the position changes at edge t, the pulse former
sees it in cycle t + 1, its backlog shows it in t + 2.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from pulsewright.boards.rapcores.registers import BACKLOG
from pulsewright.twin.kernel import hot, inlined, kernel
from pulsewright.twin.recorder import NEARLY_FULL, RESERVE, Rows, toggle

FRACTION: Final = (1 << 63) - 1  # mask
WHOLE: Final = float(1 << 63)  # one step
FOREVER: Final = 1 << 40  # ticks: more than a move has
NEAR: Final = 32  # ticks: fewer are not worth skipping
SLOW: Final = (1 << 63) // NEAR  # increments below are worth it
WHOLE_STEP: Final = FRACTION  # one step, less a unit
LIMIT: Final = 1 << 62  # faster ones are not run in batches, so that nothing can wrap
STEEP: Final = LIMIT // 128  # as is more change
BATCH: Final = 128  # ticks that are run without a look at what they do
MARGIN: Final = 1.0 - 2.0**-20  # of the bound, far more than its rounding where a root is near 0

# DDA: ``done`` ticks of the present piece of a move are integrated. Pulse former: cycles before
# ``shown`` are done; ``delta``, a step that it sees in cycle ``seen``; ``backlog``, steps owed;
# ``fall``, the cycle that ends the pulse while ``step`` is 1; first cycles in which something may
# follow: ``low``, a pulse after a pulse, ``hold``, a change of direction after a pulse, ``setup``,
# a pulse after that. ``lost``: a step was dropped.
MOTOR: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            *("position", "fraction", "increment", "change", "done"),
            *("shown", "delta", "seen", "backlog", "step", "direction", "fall"),
            *("low", "hold", "setup", "lost"),
        )
    ]
)


class Times(NamedTuple):
    """Timing registers of the pulse formers, all at least 1 [cycle]."""

    width: int
    low: int
    setup: int
    hold: int


@inlined
def far(distance: float, speed: float, change: float) -> int:
    """Return a number of ticks, at least, in which no step is crossed; 0 if they are few.

    Parameters
    ----------
    distance : float
        To the step ahead, at most 2^63.
    speed : float
        Added by the next tick, at least 0.
    change : float
        What ``speed`` grows by in every tick.
    """
    if speed == 0.0 and change == 0.0:
        return FOREVER
    if change < 0.0:
        # up to the turn it moves ahead, or to the step ahead if that comes first
        speed -= 0.5 * change  # so that ticks * speed + ticks^2 / 2 * change is the exact sum
        square = speed * speed + 2.0 * change * distance
        ticks = speed / -change if square < 0.0 else 2.0 * distance / (speed + math.sqrt(square))
    else:
        root = speed + math.sqrt(speed * speed + 2.0 * change * distance)
        ticks = 2.0 * distance / root if root > 0.0 else 0.0
    return int(min(ticks, float(FOREVER)) * MARGIN) - 2


@inlined
def batch(increment: int, change: int, ticks: int, up: int, times: Times, period: int) -> int:
    """Return how many ticks, up to ``ticks``, go one way and give pulses that delay no other."""
    count = min(ticks, BATCH)
    if not -STEEP < change < STEEP:
        return 0
    last = increment + count * change
    if not (-LIMIT < increment < LIMIT and -LIMIT < last < LIMIT):
        return 0
    if (increment >= 0) != (up == 1) or (last >= 0) != (up == 1):
        return 0
    fastest = max(abs(increment), abs(last))
    if WHOLE_STEP // (fastest + 1) * period < times.width + times.low:
        return 0
    return count


@hot
def run_former(motor: Any, end: int, times: Times, rows: Rows, pins: tuple[int, int]) -> bool:
    """Run the pulse former up to, not including, cycle ``end``, in which it sees no steps.

    False if a buffer is full up to its reserve: it then stands at an earlier cycle.
    """
    steps, directions = rows.pins[pins[0]], rows.pins[pins[1]]
    while True:
        if min(steps.room - steps.used, directions.room - directions.used) < RESERVE:
            rows.full[0] = 1
            return False
        if motor.step:
            cycle = motor.fall
            if cycle >= end:
                break
            motor.step = 0
            motor.low, motor.hold = cycle + times.low, cycle + times.hold
            toggle(rows, pins[0], cycle)
        elif motor.backlog == 0:
            break
        elif (motor.backlog < 0) != (motor.direction == 1):
            cycle = max(motor.shown, motor.hold)
            if cycle >= end:
                break
            motor.direction ^= 1
            motor.setup = cycle + times.setup
            toggle(rows, pins[1], cycle)
        else:
            cycle = max(motor.shown, motor.low, motor.setup)
            if cycle >= end:
                break
            motor.step = 1
            motor.fall = cycle + times.width
            motor.backlog += 1 if motor.backlog < 0 else -1
            toggle(rows, pins[0], cycle)
        motor.shown = cycle + 1
    motor.shown = max(motor.shown, end)
    return True


@kernel
def take_step(motor: Any, times: Times, rows: Rows, pins: tuple[int, int]) -> bool:
    """Let the pulse former see the step that waits for it; False if a buffer is full."""
    if not run_former(motor, motor.seen + 1, times, rows, pins):
        return False
    backlog = motor.backlog + motor.delta
    if -BACKLOG <= backlog < BACKLOG:
        motor.backlog = backlog
    else:
        motor.lost = 1
    motor.delta = 0
    return True


@hot
def advance(
    motor: Any,
    end: int,
    ticks: int,
    first: int,
    period: int,
    times: Times,
    rows: Rows,
    pins: tuple[int, int],
) -> bool:
    """Run one motor up to, not including, cycle ``end``; record its pins.

    Parameters
    ----------
    motor : record of `MOTOR`
    end : int
        First cycle not run.
    ticks : int
        Integrations of the present piece of a move that are due before ``end``.
    first, period : int
        Cycle of the first of them, cycles from each to the next.
    times : Times
    rows : Rows
        Edge buffers.
    pins : (int, int)
        Rows of the step and the direction pin.

    Returns
    -------
    bool
        False if a buffer is full up to its reserve: the motor then stands at an earlier cycle, and
        the call can be repeated once there is room.
    """
    while True:
        if motor.delta:
            if motor.seen >= end:
                break
            if not take_step(motor, times, rows, pins):
                return False
        if motor.done >= ticks:
            break
        # in locals, for the compiler cannot know that edges are written elsewhere
        fraction, increment, change = motor.fraction, motor.increment, motor.change
        position, done, delta = motor.position, motor.done, 0
        train = rows.pins[pins[0]]
        at, room = train.first + train.used, train.first + train.room - RESERVE
        low = max(motor.low, motor.setup, motor.shown)
        simple = motor.step == 0 and motor.backlog == 0
        up = 0 if motor.direction else 1
        while done < ticks:
            if -SLOW < increment < SLOW and -SLOW < NEAR * change < SLOW:
                ahead = increment > 0 or (increment == 0 and change > 0)
                distance = float(FRACTION - fraction if ahead else fraction)
                if ahead:
                    skip = far(distance, float(increment), float(change))
                else:
                    skip = far(distance, -float(increment), -float(change))
                if skip > NEAR:
                    skip = min(skip, ticks - done)
                    fraction += skip * increment + skip * (skip - 1) // 2 * change
                    increment += skip * change
                    done += skip
                    continue
            elif simple:
                cycle = first + done * period + 2
                count = batch(increment, change, ticks - done, up, times, period)
                count = min(count, (room - at) // 2, (end - 1 - times.width - cycle) // period)
                if count > 0 and low <= cycle:
                    # no pulse delays another one; without branches, which could not be predicted
                    begin = at
                    for _ in range(count):
                        total = fraction + increment
                        rows.cycles[at] = cycle
                        rows.cycles[at + 1] = cycle + times.width
                        at += (total >> 62) & 2
                        fraction = total & FRACTION
                        increment += change
                        cycle += period
                    done += count
                    if at > begin:
                        position += (at - begin) // 2 * (2 * up - 1)
                        low = rows.cycles[at - 1] + times.low
                    continue
            # the rest tick by tick, up to a crossing
            total = fraction
            stop = min(ticks, done + 2 * NEAR)
            while done < stop:
                total = fraction + increment
                done += 1
                if total < 0:
                    break
                fraction = total
                increment += change
            if total >= 0:
                continue
            delta = 1 if increment >= 0 else -1
            position += delta
            fraction = total & FRACTION
            increment += change
            cycle = first + (done - 1) * period + 2  # of the pulse, if nothing delays it
            fall = cycle + times.width
            # a whole pulse of its own, as nearly all are
            if not (simple and low <= cycle and fall < end and at < room and delta == 2 * up - 1):
                break
            rows.cycles[at] = cycle
            rows.cycles[at + 1] = fall
            at += 2
            low = fall + times.low
            delta = 0
        if at > train.first + train.used:
            train.used = at - train.first
            fall = rows.cycles[at - 1]
            motor.shown, motor.low, motor.hold = fall + 1, fall + times.low, fall + times.hold
            if train.room - train.used < NEARLY_FULL:
                rows.full[0] = 1
        motor.fraction, motor.increment, motor.position = fraction, increment, position
        motor.done = done
        if delta:
            motor.delta, motor.seen = delta, first + (done - 1) * period + 1
    return run_former(motor, end, times, rows, pins)
