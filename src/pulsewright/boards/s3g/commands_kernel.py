"""The compiled loops of `commands.Converter`."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.s3g.commands import LONGEST
from pulsewright.boards.s3g.registers import CLOCK_HZ, STEP_UNITS
from pulsewright.motion.evaluate import sample as positions
from pulsewright.twin.kernel import hot, inlined, kernel

SECONDS_PER_CYCLE: Final = 1.0 / CLOCK_HZ
POSITION, CROSSED, SIGN = range(3)  # columns of the state
FAR: Final = 1 << 40  # a crossing that does not come [clock]
LOST: Final = 1 << 40  # distance where a step would be lost [unit]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def sample(
    geometry: Any, law: Any, first: int, grid: int, places: Floats, plan: Ints, goal: Ints
) -> None:
    """Fill ``plan`` and ``goal``, both (n, motors), for grid points from ``first`` on [unit].

    The plan is half a step up, so that its crossings are those of a position. The goal is the plan,
    but it keeps so far from crossings that the plan does not make, from the grid point before to
    the one after, that no rounding reaches them; and from all where the plan rests. While the plan
    does not go back, no goal does.

    ``places`` (1 + motors, n + 2) is to work with.
    """
    margin = grid // 2 + 1  # more than rounding is off
    positions(geometry, law, 0, (first - 1) * grid, grid, SECONDS_PER_CYCLE, places)
    for i in range(plan.shape[1]):
        before = math.floor((places[1 + i, 0] + 0.5) * STEP_UNITS)
        here = math.floor((places[1 + i, 1] + 0.5) * STEP_UNITS)
        for j in range(plan.shape[0]):
            ahead = math.floor((places[1 + i, j + 2] + 0.5) * STEP_UNITS)
            least = most = here
            if before != here != ahead:
                least, most = min(before, here, ahead), max(before, here, ahead)
            low = least // STEP_UNITS * STEP_UNITS + margin
            high = (most // STEP_UNITS + 1) * STEP_UNITS - margin
            plan[j, i], goal[j, i] = here, min(max(here, low), high)
            before, here = here, ahead


@inlined
def nearest(distance: int, cycles: int) -> int:
    """Return the velocity that comes closest to a distance; of two, the slower.

    So nothing goes back while its goal does not: it is never off by more than half of a unit.
    """
    speed = (2 * abs(distance) + cycles - 1) // (2 * cycles)
    return -speed if distance < 0 else speed


@inlined
def first_crossing(x: int, v: int) -> int:
    """Return how many cycles after a border, at ``x``, velocity ``v`` makes a step."""
    if v == 0:
        return FAR
    into = x % STEP_UNITS
    return (STEP_UNITS - into + v - 1) // v if v > 0 else into // -v + 1


@inlined
def since_crossing(x: int, v: int) -> int:
    """Return how many cycles before a border, at ``x``, velocity ``v`` made its last step."""
    into = x % STEP_UNITS
    return into // v if v > 0 else (STEP_UNITS - 1 - into) // -v


@hot
def fits(goals: Ints, state: Ints, i: int, at: int, n: int, v: int, parameters: Ints) -> bool:
    """Tell whether velocity ``v`` of motor ``i`` holds the plan for ``n`` grid steps.

    It does not if a step comes too early: its first one after the last one before, or the next
    load's first one after its last. That is where the motor reverses.
    """
    first, _, grid, limit, least = parameters
    if abs(v) > limit:
        return False
    x, now = state[i, POSITION], (first + at) * grid
    for j in range(1, n + 1 if n > 1 else 0):
        if 2 * abs(x + j * v * grid - goals[at + j, i]) > grid:
            return False
    if v * state[i, SIGN] < 0 and now - state[i, CROSSED] + first_crossing(x, v) < least:
        return False
    end = x + v * n * grid
    if end // STEP_UNITS == x // STEP_UNITS:
        return True  # what comes after this load is late enough
    following = nearest(goals[at + n + 1, i] - end, grid)
    return following * v >= 0 or since_crossing(end, v) + first_crossing(end, following) >= least


@kernel
def convert(
    plan: Ints,
    goals: Ints,
    parameters: Ints,
    state: Ints,
    steps: Ints,
    velocity: Ints,
    position: Ints,
) -> tuple[int, int, int, int, int]:
    """Fill ``steps``, ``velocity`` and ``position`` with loads; advance ``state``.

    Parameters
    ----------
    plan, goals : (n + LONGEST + 1, motors) int64
        From `sample`, from the present grid point on [unit].
    parameters : (5,) int64
        Present grid point, grid steps to convert, length of one [clock], largest velocity, shortest
        time between steps [clock].
    state : (motors, 3) int64
        Position [unit], cycle and sign of the last step.

    Returns
    -------
    tuple of int
        Loads, grid steps that they take, largest distance of the plan from the step that a motor
        is at [unit], that motor and the grid point.
    """
    first, total, grid, limit, _ = parameters
    motors = state.shape[0]
    worst, worst_motor, worst_at = 0, 0, 0
    used, at = 0, 0
    while at < total:
        n = LONGEST
        while n > 1:
            good = True
            for i in range(motors):
                v = nearest(goals[at + n, i] - state[i, POSITION], n * grid)
                if not fits(goals, state, i, at, n, v, parameters):
                    good = False
                    break
                velocity[used, i] = v
            if good:
                break
            n //= 2
        if n == 1:
            for i in range(motors):
                v = nearest(goals[at + 1, i] - state[i, POSITION], grid)
                v = min(max(v, -limit), limit)
                sign = 1 if goals[at + 1, i] > state[i, POSITION] + v * grid else -1
                # of velocities about as close, one that loses no step
                for change in (0, sign, -sign):
                    if fits(goals, state, i, at, 1, v + change, parameters):
                        break
                else:
                    return used, at, LOST, i, first + at
                velocity[used, i] = v + change
        now = (first + at + n) * grid
        for i in range(motors):
            v, x = velocity[used, i], state[i, POSITION]
            end = x + v * n * grid
            if end // STEP_UNITS != x // STEP_UNITS:
                state[i, CROSSED] = now - since_crossing(end, v)
                state[i, SIGN] = 1 if v > 0 else -1
            state[i, POSITION] = position[used, i] = end
            here = end // STEP_UNITS * STEP_UNITS
            distance = max(here - plan[at + n, i], plan[at + n, i] - here - STEP_UNITS)
            if distance > worst:
                worst, worst_motor, worst_at = distance, i, first + at + n
        steps[used] = n
        used += 1
        at += n
    return used, at, worst, worst_motor, worst_at
