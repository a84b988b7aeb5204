"""Dual H-bridge of one motor of the twin: the pins of its two windings, from edge to edge.

Frames of 512 cycles follow each other. In a fixed cycle of each the phase and the current of the
motor are looked at, a sample; what becomes of it is at the pins in a period that begins a little
after the end of that frame. A winding that is driven has one leg high, and the other one low during
a pulse around the middle of the period.

Nobody looks at the pins meanwhile, so a bridge stays behind, as its motor does. It works out by
itself where the motor was in the cycle of each sample, so `advance` comes before the motor moves.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from pulsewright.boards.rapcores.registers import (
    PWM_CYCLES,
    R_PHASE_ANGLE_ANGLE_MASK,
    SINE_AMPLITUDE,
)
from pulsewright.boards.rapcores.twin_motor import FRACTION, STEEP, run_tick
from pulsewright.twin.clock import NEVER
from pulsewright.twin.kernel import hot, inlined, kernel
from pulsewright.twin.recorder import NEARLY_FULL, RESERVE, Rows, drive, toggle

LEGS: Final = ("a1", "a2", "b1", "b2")
TURN: Final = R_PHASE_ANGLE_ANGLE_MASK + 1  # phases of an electrical cycle
LOOK: Final = 16  # cycles from the sample of one motor to that of the next one
LATENCY: Final = 2  # edges from the end of a frame to the beginning of its period
SCALE: Final = 2048  # of sine times current to cycles
HALF: Final = SCALE // 2
KEPT: Final = 4  # samples: a period can end after the sample two frames on
OFF, BRAKED, DRIVEN = range(3)
LOW_BITS: Final = 32  # of a fraction, apart from the others in sums that are long
LOW: Final = (1 << LOW_BITS) - 1
HIGH_BITS: Final = 63 - LOW_BITS
MOST_TICKS: Final = 64  # of one such sum

SINE: Final = np.array(
    [round(SINE_AMPLITUDE * abs(math.sin(math.tau * (k + 0.5) / TURN))) for k in range(TURN)]
)

# Edge ``origin`` is the one before the first frame; frame ``taken`` is the first one without a
# sample. Edges before ``shown`` are written. The bridge is off, braked or driven, and something
# else, ``next``, from the edge ``change_at`` on. The rest is a copy of what a motor has.
BRIDGE: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            *("origin", "offset", "taken", "shown", "drive", "next", "change_at"),
            *("position", "fraction", "increment", "change", "done"),
        )
    ]
    + [("samples", np.int64, (KEPT,))]
)


@inlined
def reset(bridge: Any, cycle: int, behind: int) -> None:
    """Let frames begin with ``cycle``, for the motor with ``behind`` motors behind it."""
    bridge.origin = bridge.shown = cycle
    bridge.offset = PWM_CYCLES - LOOK * (behind + 1)
    bridge.taken = 0
    bridge.drive = bridge.next = OFF
    bridge.change_at = NEVER
    for k in range(KEPT):
        bridge.samples[k] = 0


@inlined
def change(bridge: Any, enabled: int, brake: int, cycle: int) -> None:
    """Enable or disable the bridge at edge ``cycle``: its pins follow an edge later."""
    bridge.next = DRIVEN if enabled else BRAKED if brake else OFF
    bridge.change_at = cycle + 1


@inlined
def period_at(bridge: Any, edge: int) -> int:
    """Return the number of the period that an edge is in; that of sample n is n + 1."""
    return int((edge - LATENCY - bridge.origin) // PWM_CYCLES)


@inlined
def pulse(bridge: Any, period: int, winding: int) -> tuple[int, int, int]:
    """Return the pulse of a winding: the leg that is low, its first edge, the first one after it.

    The leg is 1, or 0 where the winding is driven backwards.
    """
    sample = bridge.samples[period - 1 & KEPT - 1]
    phase = sample + winding * TURN // 4
    on = (SINE[phase & TURN - 1] * (sample // TURN) + HALF) // SCALE
    start = bridge.origin + LATENCY + period * PWM_CYCLES + PWM_CYCLES // 2 - on // 2
    return (0 if phase & TURN // 2 else 1), start, start + on


@inlined
def write_pulse(rows: Rows, row: int, start: int, stop: int) -> None:
    """Write a whole pulse of a high pin."""
    pin = rows.pins[row]
    at = pin.first + pin.used
    rows.cycles[at] = start
    rows.cycles[at + 1] = stop
    pin.used += 2
    if pin.room - pin.used < NEARLY_FULL:
        rows.full[0] = 1


@kernel
def apply(bridge: Any, rows: Rows, row: int) -> None:
    """Bring the pins to what the bridge becomes now."""
    edge = bridge.change_at
    bridge.drive = bridge.next
    bridge.change_at = NEVER
    period = period_at(bridge, edge)
    for winding in range(2):
        low, start, end = pulse(bridge, period, winding)
        inside = bridge.drive == DRIVEN and start <= edge < end
        for leg in range(2):
            level = 0 if bridge.drive == OFF or (inside and leg == low) else 1
            drive(rows, row + 2 * winding + leg, level, edge)
    bridge.shown = edge + 1


@hot
def show(bridge: Any, end: int, rows: Rows, row: int) -> bool:
    """Write edges before ``end``, of which the samples must be there; False if a buffer is full."""
    while bridge.shown < end:
        for leg in range(len(LEGS)):
            if rows.pins[row + leg].room - rows.pins[row + leg].used < RESERVE:
                rows.full[0] = 1
                return False
        if bridge.shown == bridge.change_at:
            apply(bridge, rows, row)
            continue
        first, until = bridge.shown, min(end, bridge.change_at)
        if bridge.drive == DRIVEN:
            period = period_at(bridge, first)
            until = min(until, bridge.origin + LATENCY + (period + 1) * PWM_CYCLES)
            for winding in range(2):
                leg, start, stop = pulse(bridge, period, winding)
                leg += row + 2 * winding
                if start == stop:
                    continue
                if first <= start and stop < until:
                    write_pulse(rows, leg, start, stop)
                elif first <= start < until:
                    toggle(rows, leg, start)
                elif first <= stop < until:
                    toggle(rows, leg, stop)
        bridge.shown = until
    return True


@hot
def integrate(bridge: Any, ticks: int) -> None:
    """Let so many ticks move the copy of the motor, as `twin_motor` says."""
    while ticks > 0:
        n = min(ticks, MOST_TICKS)
        growth = n * bridge.change
        increment = bridge.increment + growth
        wraps = (bridge.increment ^ increment) & (growth ^ increment) < 0
        if wraps or not -STEEP < bridge.change < STEEP:
            bridge.position += run_tick(bridge)
            ticks -= 1
            continue
        pairs = n * (n - 1) // 2
        low = (bridge.fraction & LOW) + n * (bridge.increment & LOW) + pairs * (bridge.change & LOW)
        high = (bridge.fraction >> LOW_BITS) + n * (bridge.increment >> LOW_BITS)
        high += pairs * (bridge.change >> LOW_BITS) + (low >> LOW_BITS)
        bridge.position += high >> HIGH_BITS
        bridge.fraction = (high << LOW_BITS | low & LOW) & FRACTION
        bridge.increment = increment
        bridge.done += n
        ticks -= n


@kernel
def advance(
    bridge: Any,
    motor: Any,
    current: int,
    end: int,
    ticks: int,
    first: int,
    period: int,
    rows: Rows,
    row: int,
) -> bool:
    """Run a bridge up to, not including, cycle ``end``; record its pins.

    Parameters
    ----------
    bridge : record of `BRIDGE`
    motor : record of `MOTOR`
        As it is before it is run to ``end``.
    current : int
        Of the motor, up to there.
    end, ticks, first, period : int
        As for `twin_motor.advance`.
    rows : Rows
        Edge buffers.
    row : int
        That of the first leg.

    Returns
    -------
    bool
        False if a buffer is full up to its reserve; the call can be repeated once there is room,
        and the motor must not be run before.
    """
    bridge.position, bridge.fraction, bridge.done = motor.position, motor.fraction, motor.done
    bridge.increment, bridge.change = motor.increment, motor.change
    due = late = -1  # ticks before the cycle of a sample, and cycles since the last one
    whole, rest = PWM_CYCLES // period, PWM_CYCLES % period
    while True:
        frame = bridge.origin + bridge.taken * PWM_CYCLES
        cycle = frame + bridge.offset
        if not show(bridge, min(end, frame + LATENCY), rows, row):
            return False
        if cycle >= end:
            return show(bridge, end, rows, row)
        if bridge.drive != DRIVEN and bridge.change_at == NEVER:  # few samples are ever shown
            bridge.taken += max((end - 1 - cycle) // PWM_CYCLES - KEPT, 0)
            cycle = bridge.origin + bridge.taken * PWM_CYCLES + bridge.offset
            late = -1
        if late < 0:  # a tick is seen in the cycle after it
            due, late = (cycle - 1 - first) // period + 1, (cycle - 1 - first) % period
        else:
            more = late + rest >= period
            due += whole + more
            late += rest - (period if more else 0)
        integrate(bridge, min(due, ticks) - bridge.done)
        bridge.samples[bridge.taken & KEPT - 1] = current * TURN | bridge.position & TURN - 1
        bridge.taken += 1
