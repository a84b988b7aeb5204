"""The step generator of one axis: tick by tick as specified, pulse trains in closed form.

An axis that runs at constant velocity, fast enough for its pulses not to merge, makes its steps at
the ticks at which an accumulator crosses multiples of one step. Each of them is a division away
from the first, so vector code writes them to the edge buffer. Everything else (reversals, merged
pulses, the ends of a stretch) goes tick by tick.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from pulsewright.boards.pluto_step.registers import TICK_CYCLES, UNITS_PER_STEP
from pulsewright.twin.kernel import inlined, kernel
from pulsewright.twin.recorder import NEARLY_FULL, Rows, toggle

STEP_BIT: Final = UNITS_PER_STEP.bit_length() - 1  # of the position, at tap 0
RUN, HOLD, SETUP = range(3)  # modes
NO_ROW: Final = -1
MANY: Final = 1 << 40

# State of one axis before tick ``tick``; all 0 at reset. ``position`` is not wrapped. ``step`` is
# the pin before polarity. ``pending``: a step was pending at the last tick and got no pulse.
# ``steps`` counts pulses with their sign, ``pulses`` without.
STEPGEN: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            *("tick", "position", "step", "direction", "timer", "mode", "last"),
            *("space", "pending", "missed", "steps", "pulses"),
        )
    ]
)


class Timing(NamedTuple):
    """What all axes share.

    Parameters
    ----------
    step_time, direction_time, space : int
        Fields of `W_TIMING` and `W_SPACE` [tick].
    tap : int
        A step is a toggle of position bit 11 + tap.
    clean_cancel, enforce_space : int
        Profile switches.
    """

    step_time: int
    direction_time: int
    space: int
    tap: int
    clean_cancel: int
    enforce_space: int


class Pins(NamedTuple):
    """Rows of the edge buffers that an axis writes to, `NO_ROW` for none."""

    step: int
    direction: int
    led: int


@inlined
def places(rows: Rows, row: int, reserve: int) -> int:
    """Return how many edges a row can take so that ``reserve`` places stay free; many for none."""
    if row == NO_ROW:
        return MANY
    free: int = rows.pins[row].room - rows.pins[row].used
    return free - reserve


@inlined
def append(rows: Rows, row: int, count: int) -> None:
    """Count ``count`` edges that were written to a row."""
    pin = rows.pins[row]
    pin.used += count
    if pin.room - pin.used < NEARLY_FULL:
        rows.full[0] = 1


@inlined
def step_bit(position: int, tap: int) -> int:
    """Return the bit whose toggles are steps."""
    return (position >> (STEP_BIT + tap)) & 1


@inlined
def pulse_or_space(axis: Any, bit: int, pends: bool, timing: Timing) -> bool:
    """Do what a tick does with an idle timer; return whether a pulse starts."""
    axis.timer = 0
    starts = pends
    if timing.enforce_space:
        starts = pends and axis.step == 0 and axis.space == 0
    if starts:
        axis.last = bit
        axis.step = 1
        axis.timer = timing.step_time
        axis.pulses += 1
        axis.steps += -1 if axis.direction else 1
    else:
        axis.step = 0
    return starts


@kernel
def tick(axis: Any, velocity: int, timing: Timing) -> None:
    """Do one tick."""
    negative = 1 if velocity < 0 else 0
    bit = step_bit(axis.position, timing.tap)
    wants = axis.direction != negative
    pends = bit != axis.last
    step, starts = axis.step, False
    if wants and not pends:
        if axis.timer > 0:
            axis.timer -= 1
        elif axis.mode == HOLD:
            axis.direction, axis.timer, axis.mode = negative, timing.direction_time, SETUP
        else:
            axis.step, axis.timer, axis.mode = 0, timing.direction_time, HOLD
    elif axis.mode == SETUP:
        if axis.timer > 0:
            axis.timer -= 1
        else:
            axis.mode = RUN
    else:
        cancels = timing.clean_cancel and axis.mode == HOLD
        if cancels:
            axis.mode = RUN
        if axis.timer > 0 and not cancels:
            axis.timer -= 1
        else:
            starts = pulse_or_space(axis, bit, pends, timing)
        if not wants:
            axis.position += velocity
    if timing.enforce_space:
        if step:
            axis.space = axis.space if axis.step else timing.space
        else:
            axis.space = max(0, axis.space - 1)
        if axis.pending and not pends:
            axis.missed = 1
        axis.pending = 1 if pends and not starts else 0
    axis.tick += 1


@inlined
def train(axis: Any, first: int, over: int, speed: int, count: int, timing: Timing) -> int:
    """Advance over ``count`` pulses; return the ticks until the last one rises.

    Parameters
    ----------
    first : int
        Ticks from now to the rise of the first pulse.
    over : int
        Units by which the accumulator is then past its crossing, 0 .. speed - 1.
    """
    unit = UNITS_PER_STEP << timing.tap
    # crossing k + 1 comes at the first multiple of ``speed`` that covers k more units
    last = first + -(-((count - 1) * unit - over) // speed)
    axis.last ^= count & 1
    axis.pulses += count
    axis.steps += -count if axis.direction else count
    axis.space = timing.space
    return last


@kernel
def write_train(
    rows: Rows, row: int, cycle: int, over: int, speed: int, count: int, timing: Timing
) -> None:
    """Write the edges of ``count`` pulses of which the first rises at ``cycle``."""
    unit = UNITS_PER_STEP << timing.tap
    width = (timing.step_time + 1) * TICK_CYCLES
    # Pulse k comes ceil((k unit - over) / speed) ticks later, here the floor of
    # (k unit - over + speed - 1/2) / speed: never a whole number, so rounding to double (far
    # finer than the 1 / (2 speed) to the next one) cannot change it. Pulses do not depend on
    # each other, so this becomes vector code.
    ahead = speed - 0.5 - over
    scale = TICK_CYCLES / speed
    at = rows.pins[row].first + rows.pins[row].used
    edges = rows.cycles[at : at + 2 * count]
    for k in range(count):
        rise = cycle + (np.int64((ahead + k * unit) * scale) & -TICK_CYCLES)
        edges[2 * k] = rise
        edges[2 * k + 1] = rise + width
    append(rows, row, 2 * count)


@kernel
def copy_edges(rows: Rows, source: int, target: int, count: int) -> None:
    """Append the last ``count`` edges of one row to another row."""
    begin = rows.pins[source].first + rows.pins[source].used - count
    at = rows.pins[target].first + rows.pins[target].used
    for i in range(count):
        rows.cycles[at + i] = rows.cycles[begin + i]
    append(rows, target, count)


@kernel
def advance(
    axis: Any,
    end: int,
    velocity: int,
    timing: Timing,
    origin: int,
    rows: Rows,
    pins: Pins,
    reserve: int,
) -> bool:
    """Run one axis up to, not including, tick ``end``; record its pins.

    Parameters
    ----------
    axis : record of `STEPGEN`
    end : int
        First tick not run.
    velocity : int
        Signed [2^-11 step per tick at tap 0].
    timing : Timing
    origin : int
        Cycle of tick 0.
    rows, pins : Rows, Pins
        Edge buffers. Pins that are high-Z have no row.
    reserve : int
        Places to leave free in the buffers.

    Returns
    -------
    bool
        False if a buffer is full: the axis then stands at an earlier tick, and the call can be
        repeated once there is room.
    """
    speed = abs(velocity)
    negative = 1 if velocity < 0 else 0
    unit = UNITS_PER_STEP << timing.tap
    shown = pins.step != NO_ROW
    # ticks between steps that leave one low tick at least after each pulse
    apart = timing.step_time + timing.space + 2
    clean = speed * apart <= unit
    while axis.tick < end:
        room = min(places(rows, pins.step, reserve), places(rows, pins.led, reserve))
        if room < 2 or places(rows, pins.direction, reserve) < 1:
            rows.full[0] = 1
            return False
        left = end - axis.tick
        if (
            clean
            and axis.direction == negative
            and axis.timer == 0
            and axis.step == 0
            and axis.pending == 0
            and (axis.mode == RUN or (axis.mode == HOLD and not timing.clean_cancel))
            and step_bit(axis.position, timing.tap) == axis.last
        ):
            if speed == 0:
                axis.space = max(0, axis.space - left)
                axis.tick = end
                break
            into = axis.position & (unit - 1)
            distance = into + 1 if negative else unit - into  # to the next toggle
            first = -(-distance // speed)
            if first >= left:  # the next pulse does not start
                axis.position += velocity * left
                axis.space = max(0, axis.space - left)
                axis.tick = end
                break
            if first >= axis.space:
                travel = (left - timing.step_time - 2) * speed
                count = (
                    ((travel - distance) >> (STEP_BIT + timing.tap)) + 1
                    if travel >= distance
                    else 0
                )
                count = min(count, room // 2)
                ran = first
                if count > 0:
                    over = first * speed - distance
                    if shown:
                        cycle = origin + (axis.tick + first) * TICK_CYCLES
                        write_train(rows, pins.step, cycle, over, speed, count, timing)
                        if pins.led != NO_ROW:
                            copy_edges(rows, pins.step, pins.led, 2 * count)
                    ran = train(axis, first, over, speed, count, timing) + timing.step_time + 2
                else:
                    axis.space = max(0, axis.space - first)
                axis.position += velocity * ran
                axis.tick += ran
                continue
        cycle = origin + axis.tick * TICK_CYCLES
        step, direction = axis.step, axis.direction
        tick(axis, velocity, timing)
        if shown:
            if axis.step != step:
                toggle(rows, pins.step, cycle)
                if pins.led != NO_ROW:
                    toggle(rows, pins.led, cycle)
            if axis.direction != direction:
                toggle(rows, pins.direction, cycle)
                if pins.led != NO_ROW:
                    toggle(rows, pins.led, cycle)
    return True
