"""Step pulse former: pulse width, space and direction setup, driven by a step rate generator.

Between two changes of its registers an axis makes pulses of one width at one period: they go to the
edge buffer in closed form.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from pulsewright.twin.kernel import hot
from pulsewright.twin.recorder import RESERVE, Rows, pulses, toggle
from pulsewright.twin.step_rate import count_before, due_tick

# State of one axis before tick ``tick``; all 0 at reset. ``count``: counter of the rate generator.
# ``step``, ``direction``: pins. ``fall``: tick at which the present pulse ends. First ticks at
# which something may follow: ``space``, a pulse after a pulse; ``hold``, a change of direction
# after a pulse; ``setup``, a pulse after a change of direction. ``position`` [step] counts pulses
# with their sign, ``pulses`` without.
STEP_AXIS: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            *("tick", "count", "step", "direction", "fall", "space", "hold", "setup"),
            *("position", "pulses"),
        )
    ]
)


@hot
def advance(
    axis: Any,
    end: int,
    active: bool,
    direction: int,
    period: int,
    width: int,
    space: int,
    setup: int,
    at_fall: bool,
    clock: tuple[int, int],
    rows: Rows,
    pins: tuple[int, int],
) -> bool:
    """Run one axis up to, not including, tick ``end``; record its pins.

    Parameters
    ----------
    axis : record of `STEP_AXIS`
    end : int
        First tick not run.
    active : bool
        The rate generator runs.
    direction : int
        Wanted level of the direction pin.
    period, width, space, setup : int
        Step period, pulse width, least space between pulses, time between the end of a pulse and a
        change of direction and between that and the next pulse; all at least 1 [tick].
    at_fall : bool
        The direction changes as the step pin falls, or at once while it is low, and no setup time
        is kept.
    clock : (int, int)
        Cycle of tick 0, cycles per tick.
    rows : Rows
        Edge buffers.
    pins : (int, int)
        Rows of the step and the direction pin.

    Returns
    -------
    bool
        False if a buffer is full up to its reserve: the axis then stands at an earlier tick, and
        the call can be repeated once there is room.
    """
    origin, tick_cycles = clock
    step_pin, direction_pin = pins
    low = axis.tick  # first tick not run yet
    if low >= end:
        return True
    tick, count = low, axis.count  # the counter before this tick
    done = True
    while True:
        room = rows.pins[step_pin].room - rows.pins[step_pin].used - RESERVE
        if room < 2 or rows.pins[direction_pin].room - rows.pins[direction_pin].used < RESERVE:
            done = False
            break
        if axis.step == 1:
            if axis.fall >= end:
                low = end
                break
            toggle(rows, step_pin, origin + axis.fall * tick_cycles)
            axis.step = 0
            axis.space = axis.fall + space
            if not at_fall:
                axis.hold = axis.fall + setup
            elif axis.direction != direction:
                toggle(rows, direction_pin, origin + axis.fall * tick_cycles)
                axis.direction = direction
            low = axis.fall + 1
        elif axis.direction != direction:
            change = max(low, axis.hold)
            if change >= end:
                low = end
                break
            toggle(rows, direction_pin, origin + change * tick_cycles)
            axis.direction = direction
            if not at_fall:
                axis.setup = change + setup
            low = change + 1
        elif not active:
            low = end
            break
        else:
            start = max(low, due_tick(count, tick, period), axis.space, axis.setup)
            if start >= end:
                low = end
                break
            apart = max(period, width + space)
            # pulses that also end before tick ``end``
            whole = (end - 1 - width - start) // apart + 1
            whole = min(whole, room // 2)
            if whole <= 0:
                toggle(rows, step_pin, origin + start * tick_cycles)
                axis.step = 1
                axis.fall = start + width
                whole = 1
                low = start + 1
            else:
                cycle = origin + start * tick_cycles
                pulses(rows, step_pin, cycle, apart * tick_cycles, width * tick_cycles, whole)
                start += (whole - 1) * apart
                axis.space = start + width + space
                if not at_fall:
                    axis.hold = start + width + setup
                low = start + width + 1
            axis.pulses += whole
            axis.position += whole if direction else -whole
            tick, count = start + 1, 0
    axis.count = count_before(low, count, tick, period, active)
    axis.tick = low
    return done
