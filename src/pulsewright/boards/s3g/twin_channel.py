"""One channel of the twin: profile generator (APG) and pulse former (MSG), from step to step.

Between two acceleration steps a position grows by the same amount in every cycle. A step is made
where bit 16 of it changes, so only the amount modulo 2^17 counts, and the cycles of the steps have
a closed form. Cycles before ``tick`` are done; clock edge n ends cycle n, so that what a cycle
decides shows at the edge of its number.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from pulsewright.boards.s3g.registers import (
    SET_A,
    SET_J,
    SET_JJ,
    SET_TARGET_V,
    SET_V,
    SET_X,
    STEP_UNITS,
    W_A_VAL,
    W_J_VAL,
    W_JJ_VAL,
    W_TARGET_V_VAL,
    W_V_VAL,
    W_X_VAL_HI,
    W_X_VAL_LO,
)
from pulsewright.twin.kernel import hot, inlined, kernel
from pulsewright.twin.recorder import NEARLY_FULL, RESERVE, Rows, toggle

FRACTION: Final = STEP_UNITS.bit_length() - 1  # the bit of the position that makes steps
CYCLE: Final = 2 * STEP_UNITS  # positions this far apart are the same to the pins
WORD: Final = 1 << 32
SIGN: Final = 1 << 31

# Profile: ``x`` .. ``target_set``, ``sv`` the velocity before the last acceleration step;
# ``stepping``, the step register, and ``up``, the direction beside it. Pulse former: ``start``, the
# cycle in which it took its last step, ``free``, the first one in which it takes the next; the step
# pin is high from edge ``rise`` to edge ``fall``; ``step``, the pin before edge ``shown``, and
# ``direction``, the one before edge ``tick``. ``position``, ``pulses`` and ``lost`` count steps
# taken with their sign, without it, and steps that came too early.
CHANNEL: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            *("tick", "x", "v", "a", "j", "jj", "sv", "target_v", "target_set"),
            *("stepping", "up", "start", "free", "rise", "fall", "shown", "step", "direction"),
            *("position", "pulses", "lost"),
        )
    ]
)


class Times(NamedTuple):
    """Thresholds of the pulse formers [cycle]."""

    pre: int
    pulse: int
    post: int


@inlined
def signed(value: int) -> int:
    """Return the low 32 bits of a value as a signed number."""
    number: int = ((value + SIGN) & (WORD - 1)) - SIGN
    return number


@inlined
def busy_cycles(times: Times) -> int:
    """Return how far behind a step the pulse former counts."""
    longest: int = max(1, times.pre, times.pulse, times.post)
    return longest


# ------------------------------------------------------------------------------------------- pulses


@kernel
def show_pulse(channel: Any, end: int, rows: Rows, row: int) -> None:
    """Record the step pin at edges up to, not including, ``end``."""
    begin, rise, fall = channel.shown, channel.rise, channel.fall
    if begin >= end:
        return
    level = 1 if rise <= begin < fall else 0
    if level != channel.step:
        toggle(rows, row, begin)
    if rise < fall:
        if begin < rise < end:
            toggle(rows, row, rise)
        if begin < fall < end:
            toggle(rows, row, fall)
    channel.step = 1 if rise < end <= fall else 0
    channel.shown = end


@kernel
def retime(channel: Any, cycle: int, times: Times) -> None:
    """Let other thresholds count from ``cycle`` on; the channel must stand there."""
    if channel.free > cycle:
        channel.free = max(cycle, channel.start + busy_cycles(times)) + 1
        channel.rise = max(cycle, channel.start + max(times.pre, 1))
        channel.fall = channel.start + times.pulse


@kernel
def advance(
    channel: Any, end: int, moving: int, carry: int, times: Times, rows: Rows, pins: tuple[int, int]
) -> bool:
    """Run one channel up to, not including, cycle ``end``; record its pins.

    Parameters
    ----------
    channel : record of `CHANNEL`
    end : int
        First cycle not run.
    moving : int
        0: position and step register stand still, as where a position is loaded.
    carry : int
        Added to a position in every cycle of negative velocity; a multiple of 2^32.
    times : Times
    rows : Rows
        Edge buffers.
    pins : (int, int)
        Rows of the step and the direction pin.

    Returns
    -------
    bool
        False if a buffer is full up to its reserve: the channel then stands at an earlier cycle,
        and the call can be repeated once there is room.
    """
    edges = rows.pins[pins[0]]
    while channel.tick < end:
        tick = channel.tick
        doubled = channel.v + channel.sv if moving else 0
        each = doubled >> 1
        stride = ((each + STEP_UNITS) & (CYCLE - 1)) - STEP_UNITS
        # distance covered since the last change of bit 16, and speed, both upwards
        part = channel.x & (STEP_UNITS - 1)
        if stride < 0:
            stride = -stride
            part = STEP_UNITS - 1 - part
        cycles = end - tick
        steps = (part + cycles * stride) >> FRACTION
        if steps or channel.stepping:
            room = (edges.room - edges.used - RESERVE) // 2 - 2
            if room < 1:
                rows.full[0] = 1
                return False
            if steps > room:
                # pulses are as few as the steps or as the times of the pulse former allow
                until = (room * STEP_UNITS - part + stride - 1) // stride
                cycles = min(cycles, max(until, room * busy_cycles(times)))
                steps = (part + cycles * stride) >> FRACTION
            # the pulse former does not see a step of the last cycle yet
            seen = (part + (cycles - 1) * stride) >> FRACTION
            up = 1 if doubled > 0 else 0
            make_steps(channel, tick + cycles, seen, part, stride, up, times, rows, pins)
            channel.stepping = steps - seen
            if steps:
                channel.up = up
        elif channel.step or channel.fall > tick:
            show_pulse(channel, end, rows, pins[0])
        else:
            channel.shown = end
        channel.x += cycles * (each + carry if doubled < 0 else each)
        channel.tick = tick + cycles
    return True


@kernel
def turn(
    channel: Any, cycle: int, direction: int, times: Times, rows: Rows, pins: tuple[int, int]
) -> None:
    """Let the pulse former take a step in ``cycle``, after what it had to show before."""
    show_pulse(channel, cycle + 1, rows, pins[0])
    if channel.direction != direction:
        channel.direction = direction
        toggle(rows, pins[1], cycle)
    channel.start, channel.free = cycle, cycle + busy_cycles(times) + 1
    channel.rise, channel.fall = cycle + max(times.pre, 1), cycle + times.pulse


@hot
def make_steps(
    channel: Any,
    end: int,
    seen: int,
    part: int,
    stride: int,
    up: int,
    times: Times,
    rows: Rows,
    pins: tuple[int, int],
) -> None:
    """Run the pulse former up to, not including, cycle ``end``.

    Parameters
    ----------
    channel : record of `CHANNEL`
    end : int
    seen : int
        Steps that it sees, besides one in the step register. It sees number k of them in cycle
        ``tick + ceil((k * 65536 - part) / stride)``.
    part, stride : int
        Position since the last step, 0..65535, and its growth in every cycle.
    up : int
        Their direction.
    times, rows, pins
        As in `advance`.
    """
    tick = channel.tick
    if channel.stepping:
        if channel.free <= tick:
            turn(channel, tick, channel.up, times, rows, pins)
            channel.pulses += 1
            channel.position += 1 if channel.up else -1
        else:
            channel.lost += 1
    if seen == 0:
        show_pulse(channel, end, rows, pins[0])
        return
    edges = rows.pins[pins[0]]
    first, width, hold = max(times.pre, 1), times.pulse - max(times.pre, 1), busy_cycles(times)
    whole, rest = STEP_UNITS // stride, STEP_UNITS % stride
    free, used, taken = channel.free, 0, 0
    number, after, over = 1, -1, 0  # cycles after ``tick``, -1 if not known; position then, past it
    while number <= seen:
        if after < 0:
            distance = number * STEP_UNITS - part
            after = (distance + stride - 1) // stride
            over = after * stride - distance
        cycle = tick + after
        if cycle < free:
            last = min((part + (free - tick - 1) * stride) >> FRACTION, seen)
            channel.lost += last - number + 1
            number, after = last + 1, -1
            continue
        if taken == 0:
            turn(channel, cycle, up, times, rows, pins)
            used = edges.first + edges.used
        free = cycle + hold + 1
        if 0 < width < end - cycle - first:
            rows.cycles[used] = cycle + first
            rows.cycles[used + 1] = cycle + first + width
            used += 2
        taken += 1
        number += 1
        late = 1 if rest > over else 0
        after += whole + late
        over += stride * late - rest
    if taken:
        edges.used = used - edges.first
        channel.free, channel.start = free, free - hold - 1
        channel.rise, channel.fall = channel.start + first, channel.start + first + width
        # the last pulse may be whole, and then it is recorded
        channel.shown = channel.fall + 1 if 0 < width < end - channel.rise else channel.start + 1
        channel.pulses += taken
        channel.position += taken if up else -taken
    show_pulse(channel, end, rows, pins[0])
    if edges.room - edges.used < NEARLY_FULL:
        rows.full[0] = 1


# ------------------------------------------------------------------------------------------ profile


@kernel
def load(channel: Any, outputs: Any, c: int, control: int) -> None:
    """Load what the control bits say from the registers of channel ``c``, at the end of a cycle."""
    if control >> SET_X & 1:
        channel.x = outputs[W_X_VAL_HI[c]] << 32 | outputs[W_X_VAL_LO[c]]
    if control >> SET_V & 1:
        channel.v = channel.sv = signed(outputs[W_V_VAL[c]])
    if control >> SET_A & 1:
        channel.a = signed(outputs[W_A_VAL[c]])
    if control >> SET_J & 1:
        channel.j = signed(outputs[W_J_VAL[c]])
    if control >> SET_JJ & 1:
        channel.jj = signed(outputs[W_JJ_VAL[c]])
    channel.target_set = control >> SET_TARGET_V & 1
    if channel.target_set:
        channel.target_v = signed(outputs[W_TARGET_V_VAL[c]])


@inlined
def accelerate(channel: Any) -> None:
    """Make an acceleration step, at the end of a cycle."""
    v, target = channel.v, channel.target_v
    following = signed(v + channel.a)
    channel.sv = v
    if channel.target_set and (v == target or v < target < following or v > target > following):
        channel.v, channel.a = target, signed(target - v)
        channel.j = channel.jj = 0
    else:
        channel.v = following
        channel.a = signed(channel.a + channel.j)
        channel.j = signed(channel.j + channel.jj)


@inlined
def brake(channel: Any, deceleration: int) -> None:
    """Make an acceleration step of an abort, at the end of a cycle."""
    v, opposite = channel.v, signed(-deceleration)
    channel.sv = v
    channel.j = channel.jj = 0
    if v == 0:
        channel.a = 0
    elif v > deceleration:
        channel.v, channel.a = signed(v - deceleration), opposite
    elif v >= opposite:
        channel.v, channel.a = 0, signed(-v)
    else:
        channel.v, channel.a = signed(v + deceleration), deceleration
