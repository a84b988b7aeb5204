"""One motor of the twin: accumulator (DDA) and pulse former, from step to step.

An accumulator is two words, the position [step] and its fraction in units of 2^-63 step; 32-bit
words have their values in the upper half. Increments are signed numbers of the same unit.

While an increment keeps its sign, the motor goes from crossing to crossing of a step, not from tick
to tick (`run_ahead`): it is at ``short`` of the next step, a negative number, and moves ahead by
``speed``, whose change per tick is ``gain``, whichever way that is. The number of ticks to the next
crossing is guessed, from the one before or in floating point, and put right by single ticks.

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
STEP: Final = -(1 << 63)  # one step, less than nothing so that it is a signed number
FOREVER: Final = 1 << 40  # ticks: more than a move has
SIGN: Final = 63  # its bit
FEW: Final = 4  # steps: fewer are no train
STEEP: Final = 1 << 55  # more change per tick is run tick by tick, so that nothing can wrap
FASTEST: Final = (1 << 63) - (1 << 58)  # as are faster increments
MARGIN: Final = 1.0 - 2.0**-20  # of the bound, far more than its rounding where a root is near 0
ROUNDING: Final = 2.0**-40  # far more than that of a quotient or two
ONE: Final = 2.0**63  # one step

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
def moved(ticks: int, speed: int, gain: int) -> int:
    """Return what so many ticks add, modulo 2^64."""
    pairs = (ticks >> 1) * (ticks - 1 | 1)  # ticks * (ticks - 1) / 2, of 2^32 ticks too
    total: int = ticks * speed + pairs * gain
    return total


@inlined
def at_least(speed: int) -> int:
    """Return a number of ticks of that speed, at least 1, that are less than a step; or 0.

    It is the greatest, or one less where that is near a whole number.
    """
    return int(ONE / float(speed) * (1.0 - ROUNDING))


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
def take_step(motor: Any, end: int, times: Times, rows: Rows, pins: tuple[int, int]) -> bool:
    """Let the pulse former see the step that waits for it; False if a buffer is full.

    The former stands at the cycle after that, or at ``end`` at most if it gives a whole pulse.
    """
    if not run_former(motor, motor.seen + 1, times, rows, pins):
        return False
    rise = motor.seen + 1
    fall = rise + times.width
    idle = motor.step == 0 and motor.backlog == 0 and motor.delta == 1 - 2 * motor.direction
    if idle and max(motor.shown, motor.low, motor.setup) <= rise and fall < end:
        toggle(rows, pins[0], rise)
        toggle(rows, pins[0], fall)
        motor.shown, motor.low, motor.hold = fall + 1, fall + times.low, fall + times.hold
        motor.delta = 0
        return True
    backlog = motor.backlog + motor.delta
    if -BACKLOG <= backlog < BACKLOG:
        motor.backlog = backlog
    else:
        motor.lost = 1
    motor.delta = 0
    return True


@hot
def run_tick(motor: Any) -> int:
    """Integrate once, at any speed; return the step that is crossed, 0 if none is."""
    increment = motor.increment
    total = motor.fraction + increment  # negative where it crosses
    motor.fraction = total & FRACTION
    motor.increment = increment + motor.change
    motor.done += 1
    delta = 0
    if total < 0:
        delta = 1 if increment >= 0 else -1
    motor.position += delta
    return delta


@hot
def run_ahead(
    motor: Any,
    end: int,
    ticks: int,
    first: int,
    period: int,
    times: Times,
    rows: Rows,
    pins: tuple[int, int],
) -> int:
    """Integrate ticks that go one way and write their pulses, while nothing delays these.

    Parameters are those of `advance`. Return the step that was crossed last if its pulse is not
    written, 0 if there is none.
    """
    # in locals, for the compiler cannot know that edges are written elsewhere
    cycles, step_pin = rows.cycles, rows.pins[pins[0]]
    at = begin = step_pin.first + step_pin.used
    room = step_pin.first + step_pin.room - RESERVE
    done, width = motor.done, times.width
    low = max(motor.low, motor.setup, motor.shown)
    speed, gain, left = motor.increment, motor.change, ticks - done
    ahead = speed > 0 or (speed == 0 and gain > 0)
    # a pulse can follow a step at once: otherwise the first one is left to the former
    simple = motor.step == 0 and motor.backlog == 0 and ahead == (motor.direction == 0)
    short = motor.fraction ^ STEP
    if not ahead:
        speed, gain, short = -speed, -gain, ~motor.fraction
    if gain < 0:
        left = min(left, speed // -gain + 1)
    elif gain > 0:
        left = min(left, (FASTEST - speed) // gain)
    # so many ticks do not wrap, wherever they begin
    most = at_least(max(speed, speed + (left - 1) * gain, 1))
    crossed, missed, guess, tries = 0, 0, 0, 2
    if gain == 0 and speed > 0:
        # even speed: all steps but perhaps the last one, and the ticks behind them
        most += 1 if most * speed <= FRACTION - speed else 0
        span = min(left, (end - 3 - width - first) // period + 1 - done)
        steps = (float(span) * float(speed) + float(short)) / ONE + MARGIN
        count = min(int(max(steps, 0.0)), (room - at) // 2)
        if simple and count >= FEW and most * period >= width + times.low:
            n = int(-float(short) / float(speed) * MARGIN)
            total = short + n * speed
            while total < 0:
                total += speed
                n += 1
            cycle = first + (done + n - 1) * period + 2
            if low <= cycle:
                jump, nearly = most * period, most * speed
                for _ in range(count - 1):  # without branches, which could not be predicted
                    short = total ^ STEP
                    cycles[at] = cycle
                    cycles[at + 1] = cycle + width
                    at += 2
                    total = short + nearly
                    late = total >> SIGN
                    total += speed & late
                    cycle += jump + (period & late)
                short = total ^ STEP
                cycles[at] = cycle
                cycles[at + 1] = cycle + width
                at += 2
                low = cycle + width + times.low
                crossed, guess = count, most - 1
                count = (cycle - first - 2) // period + 1 - done
                done += count
                left -= count
                if left <= most and short + left * speed < 0:
                    short += left * speed
                    done += left
                    left = 0
    while left > 0:
        if at > begin and tries and left > 2 * FEW * guess:
            # a train: from each step to the next it is ``fewest`` ticks, or up to two more
            cycle = cycles[at - 2]
            span = min(left, (end - 1 - width - cycle) // period) >> 2 * (2 - tries)
            last = speed + span * gain
            fewest = at_least(max(speed - gain, last, speed))
            longest = int(ONE / float(max(min(speed, last), 1)) * (1.0 + ROUNDING)) + 1
            count = min(span // longest, (room - at) // 2)
            if longest > fewest + 2:
                tries -= 1
            elif count < FEW or fewest * period < width + times.low:
                tries = 0
            else:
                jump, still = fewest * period, moved(fewest, 0, gain)
                for _ in range(count):  # without branches, which could not be predicted
                    total = short + fewest * speed + still
                    speed += fewest * gain
                    late = total >> SIGN
                    total += speed & late
                    speed += gain & late
                    later = total >> SIGN
                    total += speed & later
                    speed += gain & later
                    short = total ^ STEP
                    cycle += jump + (period & late) + (period & later)
                    cycles[at] = cycle
                    cycles[at + 1] = cycle + width
                    at += 2
                low = cycle + width + times.low
                crossed += count
                count = (cycle - first - 2) // period + 1 - done
                done += count
                left -= count
            continue
        # one tick less than from the step before, and up to two more, without branches as well
        n = min(guess, left)
        total, now = short + moved(n, speed, gain), speed + n * gain
        more = total < 0
        total += now if more else 0
        now += gain if more else 0
        n += 1 if more else 0
        more = total < 0
        total += now if more else 0
        now += gain if more else 0
        n += 1 if more else 0
        if total < 0 or total >= now - gain or n > left:
            n = min(max(far(-float(short), float(speed), float(gain)), 0), left)
            total, now = short + moved(n, speed, gain), speed + n * gain
            while total < 0 and n < left:
                total += now
                now += gain
                n += 1
        left -= n
        done += n
        speed = now
        if total < 0:
            short = total
            break
        short = total ^ STEP
        guess = min(n - 1, most)
        crossed += 1
        cycle = first + (done - 1) * period + 2  # of the pulse, if nothing delays it
        fall = cycle + width
        if not (simple and low <= cycle and fall < end and at < room):
            missed = 1
            break
        cycles[at] = cycle
        cycles[at + 1] = fall
        at += 2
        low = fall + times.low
    if at > begin:
        step_pin.used += at - begin
        fall = cycles[at - 1]
        motor.shown, motor.low, motor.hold = fall + 1, fall + times.low, fall + times.hold
        if step_pin.room - step_pin.used < NEARLY_FULL:
            rows.full[0] = 1
    motor.fraction = short ^ STEP if ahead else ~short
    motor.increment = speed if ahead else -speed
    motor.position += crossed if ahead else -crossed
    motor.done = done
    return missed if ahead else -missed


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
            if not take_step(motor, end, times, rows, pins):
                return False
        if motor.done >= ticks:
            break
        fast = not -FASTEST + STEEP < motor.increment < FASTEST - STEEP
        if fast or not -STEEP < motor.change < STEEP:
            motor.delta = run_tick(motor)
        else:
            motor.delta = run_ahead(motor, end, ticks, first, period, times, rows, pins)
        motor.seen = first + (motor.done - 1) * period + 1
    return run_former(motor, end, times, rows, pins)
