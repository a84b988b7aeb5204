"""Compiled loops of the verifier. Imported on first use, since loading a compiler takes time."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import compiled
from pulsewright.motion.evaluate import coordinate, path_coordinate

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

# Elements of the state that `follow` carries from chunk to chunk
COUNT, PIECE, GRID, WINDOW, PREVIOUS, FORWARD, BACKWARD = 0, 1, 2, 3, 4, 5, 6
FOLLOW_STATE: Final = 7
BINS_PER_STEP: Final = 20  # histogram of deviations: bins of 0.05 step ...
HISTOGRAM: Final = 81  # ... centred on -2 .. +2 step, the outer ones open

REACH_MOVES: Final = 1000  # the nearest-point search looks no further than so many moves
ENOUGH_NEIGHBOURS: Final = 1  # ... and at least this far, whatever their length


@compiled(allocates=False)
def follow(
    step: Ints,
    active: int,
    direction: Ints,
    positive: int,
    end: int,
    clock: float,
    origin: int,
    grid: int,
    bound: float,
    poly: Floats,
    cosine: Floats,
    sine: Floats,
    omega: Floats,
    element: NDArray[np.int32],
    start: Floats,
    law: Floats,
    motor: int,
    window: Ints,
    seen: Ints,
    state: Ints,
    worst: Floats,
    histogram: Ints,
    grid_count: Ints,
    grid_plan: Floats,
    grid_deviation: Floats,
) -> int:
    """Follow one motor through one chunk and compare it with its plan; return the grid points met.

    The deviation (count minus plan) is taken at every step, both just before and just after it,
    at every grid point and at the end of every piece of the plan.

    Parameters
    ----------
    step, direction : (n,), (m,) int64
        Cycles of the changes of both pins.
    active, positive : int
        1 if the step pin is active and the direction positive before the chunk.
    end : int
        First cycle after the chunk.
    clock : float
        Cycles per second of the plan.
    origin : int
        Cycle of the plan's time 0.
    grid : int
        Grid points are at ``origin + k * grid`` [cycle].
    bound : float
        Deviations above it are counted [step].
    poly, cosine, sine, omega, element, start, law, motor
        The plan in steps, as in `Trajectory`, and the coordinate to follow. A part of the plan
        that reaches as far as the chunk does; ``state[PIECE]`` is a piece of that part.
    window : (windows, 2) int64
        First and last cycle of intervals, by first cycle, in which to note the counts.
    seen : (windows, 2) int64
        Lowest and highest count in each window, in place; empty where lowest > highest.
    state : (FOLLOW_STATE,) int64
        Carried on.
    worst : (3,) float64
        Deviation of largest magnitude with its sign, its cycle, number above ``bound``; in place.
    histogram : (HISTOGRAM,) int64
        Deviations at steps, in place.
    grid_count, grid_plan, grid_deviation : (g,)
        Count and plan at each grid point in the chunk, and the largest deviation since the one
        before it; filled from 0 on.
    """
    count, k, point, first = state[COUNT], state[PIECE], state[GRID], state[WINDOW]
    previous, forward, backward = state[PREVIOUS], 0, 0
    points, last, period = 0, start.size - 2, 1.0 / clock
    finish = start[last + 1]
    most, recent, beyond = abs(worst[0]), 0.0, 0
    opens = window[first, 0]
    # The plan of this motor on piece k: a cubic of time where the element is straight.
    c0, c1, c2, c3, straight = _cubic(poly, omega, law, element[k], k, motor)
    i, j = active, 0  # if the pin is active, the first change is a trailing edge
    while True:
        stepping = i < step.size
        now = step[i] if stepping else end
        i += 2
        # Instants while the count stands still: ends of pieces, grid points, and last ``now``
        # itself, just before the step.
        while True:
            at = origin + point * grid
            on_grid = at < now
            if not on_grid:
                at = now
            t = min(max((at - origin) * period, 0.0), finish)
            ended = k < last and t >= start[k + 1]
            if ended:
                t = start[k + 1]
            tau = t - start[k]
            if straight:
                x = ((c3 * tau + c2) * tau + c1) * tau + c0
            else:
                s = path_coordinate(law, k, tau)
                x = coordinate(poly, cosine, sine, omega, element[k], motor, s)
            deviation = count - x
            size = abs(deviation)
            recent = max(recent, size)
            beyond += size > bound
            if size > most:
                most = size
                worst[0], worst[1] = deviation, origin + t * clock if ended else at
            if ended:
                k += 1
                c0, c1, c2, c3, straight = _cubic(poly, omega, law, element[k], k, motor)
                continue
            if not on_grid:
                break
            grid_count[points] = count
            grid_plan[points] = x
            grid_deviation[points] = recent
            recent = 0.0
            points += 1
            point += 1
        if opens < now:
            while first < window.shape[0] - 1 and window[first, 1] < previous:
                first += 1
            opens = window[first, 0]
            w = first
            while w < window.shape[0] and window[w, 0] < now:
                if window[w, 1] >= previous:
                    seen[w, 0] = min(seen[w, 0], count)
                    seen[w, 1] = max(seen[w, 1], count)
                w += 1
        previous = now
        if not stepping:
            break
        near = math.floor(deviation * BINS_PER_STEP + 0.5) + HISTOGRAM // 2
        histogram[min(max(near, 0), HISTOGRAM - 1)] += 1
        while j < direction.size and direction[j] <= now:
            positive = 1 - positive
            j += 1
        if positive:
            count += 1
            forward += 1
            near += BINS_PER_STEP
        else:
            count -= 1
            backward += 1
            near -= BINS_PER_STEP
        histogram[min(max(near, 0), HISTOGRAM - 1)] += 1
        deviation = count - x
        size = abs(deviation)
        recent = max(recent, size)
        beyond += size > bound
        if size > most:
            most = size
            worst[0], worst[1] = deviation, now
    state[COUNT], state[PIECE], state[GRID], state[WINDOW] = count, k, point, first
    state[PREVIOUS] = previous
    state[FORWARD] += forward
    state[BACKWARD] += backward
    worst[2] += beyond
    return points


@compiled(inline="always")
def _cubic(
    poly: Floats, omega: Floats, law: Floats, e: int, k: int, motor: int
) -> tuple[float, float, float, float, bool]:
    """Return position over time on piece k as a cubic, and whether it is one."""
    slope = poly[e, 1, motor]
    straight = omega[e] == 0.0 and poly[e, 2, motor] == 0.0 and poly[e, 3, motor] == 0.0
    return (
        poly[e, 0, motor] + slope * law[k, 0],
        slope * law[k, 1],
        slope * law[k, 2],
        slope * law[k, 3],
        straight,
    )


@compiled(allocates=False)
def arc_distance2(
    p0: float, p1: float, p2: float, c0: float, c1: float, n0: float, arc: Floats
) -> float:
    """Return the squared distance of a point from an arc, helix or spiral.

    Parameters
    ----------
    p0, p1, p2 : float
        The point: both coordinates in the plane, and along the normal.
    c0, c1, n0 : float
        Centre in the plane; coordinate along the normal where the arc starts.
    arc : (5,) float64
        Angle at the start, sweep [rad], radius at the start, radius at the end, rise.
    """
    begin, sweep, r0, r1, rise = arc[0], arc[1], arc[2], arc[3], arc[4]
    x, y, z = p0 - c0, p1 - c1, p2 - n0
    angle = math.atan2(y, x)
    best = min(_at_arc(0.0, x, y, z, arc), _at_arc(1.0, x, y, z, arc))
    if sweep == 0.0:
        return best
    # Starts for Newton's method on the derivative of the distance: where the arc has the point's
    # angle, in the turns nearest to its height; and where it has its height, for steep helices.
    # On a flat circle the first is the nearest point already.
    turn = 2.0 * math.pi / abs(sweep)
    u = ((angle - begin) / sweep) % turn
    turns = max(0, math.floor((1.0 - u) / turn))
    middle = 0
    if rise != 0.0:
        middle = min(max(round((z / rise - u) / turn), 0), turns)
    for k in range(-1, 3):
        at = u + (middle + k) * turn
        if k == 2:
            at = z / rise if rise != 0.0 else 0.0
        at = min(max(at, 0.0), 1.0)
        for _ in range(8):
            r = r0 + (r1 - r0) * at
            cos, sin = math.cos(begin + sweep * at), math.sin(begin + sweep * at)
            dx = (r1 - r0) * cos - r * sweep * sin
            dy = (r1 - r0) * sin + r * sweep * cos
            ex, ey, ez = r * cos - x, r * sin - y, rise * at - z
            slope = ex * dx + ey * dy + ez * rise
            ddx = -2.0 * (r1 - r0) * sweep * sin - r * sweep * sweep * cos
            ddy = 2.0 * (r1 - r0) * sweep * cos - r * sweep * sweep * sin
            curve = dx * dx + dy * dy + rise * rise + ex * ddx + ey * ddy
            if curve <= 0.0:
                break
            before = at
            at = min(max(at - slope / curve, 0.0), 1.0)
            if abs(at - before) < 1e-12:
                break
        best = min(best, _at_arc(at, x, y, z, arc))
    return best


@compiled(inline="always")
def _at_arc(u: float, x: float, y: float, z: float, arc: Floats) -> float:
    """Return the squared distance of a point from the arc's point at u, 0..1."""
    r = arc[2] + (arc[3] - arc[2]) * u
    angle = arc[0] + arc[1] * u
    dx, dy, dz = r * math.cos(angle) - x, r * math.sin(angle) - y, arc[4] * u - z
    return float(dx * dx + dy * dy + dz * dz)


@compiled(allocates=False)
def segment_distance2(p: Floats, a: Floats, b: Floats, first: int) -> float:
    """Return the squared distance of p from the segment a..b in coordinates first .. first + 2."""
    along, length = 0.0, 0.0
    for c in range(first, first + 3):
        along += (p[c] - a[c]) * (b[c] - a[c])
        length += (b[c] - a[c]) ** 2
    u = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    total = 0.0
    for c in range(first, first + 3):
        total += (p[c] - a[c] - u * (b[c] - a[c])) ** 2
    return total


@compiled(allocates=False)
def move_distance2(
    p: Floats,
    i: int,
    first: int,
    start: Floats,
    finish: Floats,
    plane: NDArray[np.int8],
    center: Floats,
    row: NDArray[np.int32],
    arc: Floats,
) -> float:
    """Return the squared distance of p (6,) from move i, in X Y Z (first = 0) or A B C (3).

    ``start`` (6,) is where the first move begins. ``row`` (n,) is that of an arc in ``arc``, -1
    for a line; A, B, C always run along a line.
    """
    begin = finish[i - 1] if i > 0 else start
    if first == 0 and row[i] >= 0:
        n = plane[i]
        u, v = (n + 1) % 3, (n + 2) % 3
        return arc_distance2(p[u], p[v], p[n], center[i, u], center[i, v], begin[n], arc[row[i]])
    return segment_distance2(p, begin, finish[i], first)


@compiled()
def compare_path(
    position: Floats,
    before: Floats,
    since: Ints,
    move: Ints,
    until: Ints,
    allowed: Floats,
    near: float,
    cycle: int,
    grid: int,
    first: int,
    start: Floats,
    finish: Floats,
    plane: NDArray[np.int8],
    center: Floats,
    row: NDArray[np.int32],
    arc: Floats,
    length: Floats,
    span: Ints,
    state: Ints,
    worst: Floats,
    covered: Floats,
    distance: Floats,
) -> None:
    """Compare positions on the grid with the programmed path, and note which corners they pass.

    Parameters
    ----------
    position : (g, 6) float64
        Tool at grid points ``cycle``, ``cycle + grid``, ...
    before : (6,) float64
        Tool at the grid point before; replaced by the last one.
    since, move, until : (g,) int64
        First move that the plan may be in, last one before the next corner, and last one that the
        blend of that corner may reach; the plan may stand for many moves at once.
    allowed : (g,) float64
        Largest distance allowed.
    near : float
        Distance with which the search is content without looking at moves further away.
    first : int
        0: X, Y, Z; 3: A, B, C.
    start, finish, plane, center, row, arc, length
        The moves; ``length`` (n,) tells how far the search has gone.
    span : (n, 2) int64
        First and last cycle at which the end of each move can be passed; both never decreasing.
    state : (2,) int64
        First move whose end may still be passed; first move whose span has not begun.
    worst : (4,) float64
        Largest distance / allowed, that distance, what was allowed, its cycle; in place.
    covered : (n,) float64
        Square of the distance at which each move's end was passed so far, in place.
    distance : (g,) float64
        Distance of each point from the path, filled.
    """
    n = finish.shape[0]
    for g in range(position.shape[0]):
        p = position[g]
        m = move[g]
        best = move_distance2(p, m, first, start, finish, plane, center, row, arc)
        reach = 4.0 * allowed[g]
        for way in (1, -1):
            gone, i = 0.0, m + way
            while 0 <= i < n:
                steps = i - until[g] if way == 1 else since[g] - i
                if abs(i - m) > ENOUGH_NEIGHBOURS and (
                    best <= near * near
                    or (steps > ENOUGH_NEIGHBOURS and (gone > reach or steps > REACH_MOVES))
                ):
                    break
                here = move_distance2(p, i, first, start, finish, plane, center, row, arc)
                best = min(best, here)
                if steps > 0:
                    gone += length[i]
                i += way
        distance[g] = math.sqrt(best)
        if distance[g] > worst[0] * allowed[g]:
            worst[0], worst[1] = distance[g] / allowed[g], distance[g]
            worst[2], worst[3] = allowed[g], cycle + g * grid

        now = cycle + g * grid
        while state[1] < n and span[state[1], 0] <= now:
            state[1] += 1
        while state[0] < state[1] and span[state[0], 1] < now - grid:
            state[0] += 1
        for i in range(state[0], state[1]):
            covered[i] = min(covered[i], segment_distance2(finish[i], before, p, first))
        for axis in range(p.size):  # a loop, as assigning slices takes seconds to compile
            before[axis] = p[axis]


@compiled()
def row_differences(
    x: Floats, row: Floats, delay: int, velocity_window: int, acceleration_window: int, out: Floats
) -> None:
    """Find the largest first and second difference of ``row`` times position.

    Parameters
    ----------
    x : (n + 2 delay, 6) float64
        Positions; the windows are centred on all but ``delay`` at either end.
    velocity_window, acceleration_window : int
        Length of the first difference, and of either half of the second; at most ``delay``.
    out : (4,) float64
        Filled: magnitude of the largest first difference and its centre from 0, the same of the
        second difference.
    """
    n = x.shape[0] - 2 * delay
    y = np.zeros(x.shape[0])
    for axis in range(row.size):
        if row[axis] != 0.0:
            for k in range(y.size):
                y[k] += row[axis] * x[k, axis]
    low, high = delay - velocity_window // 2, delay - velocity_window // 2 + velocity_window
    out[:] = 0.0
    for k in range(n):
        first = abs(y[k + high] - y[k + low])
        if first > out[0]:
            out[0], out[1] = first, k
    low, high = delay - acceleration_window, delay + acceleration_window
    for k in range(n):
        second = abs(y[k + high] - 2.0 * y[k + delay] + y[k + low])
        if second > out[2]:
            out[2], out[3] = second, k


@compiled()
def first_differences(x: Floats, column: int, delay: int, window: int) -> Floats:
    """Return the length of three columns' first difference over ``window``, (n,).

    ``x`` is (n + 2 delay, 6) as for `row_differences`.
    """
    result = np.empty(x.shape[0] - 2 * delay)
    low, high = delay - window // 2, delay - window // 2 + window
    for k in range(result.size):
        square = 0.0
        for c in range(column, column + 3):
            square += (x[k + high, c] - x[k + low, c]) ** 2
        result[k] = math.sqrt(square)
    return result


@compiled()
def second_differences(x: Floats, column: int, delay: int, window: int) -> Floats:
    """Return the length of three columns' second difference over two ``window``, (n,).

    ``x`` is (n + 2 delay, 6) as for `row_differences`.
    """
    result = np.empty(x.shape[0] - 2 * delay)
    low, high = delay - window, delay + window
    for k in range(result.size):
        square = 0.0
        for c in range(column, column + 3):
            square += (x[k + high, c] - 2.0 * x[k + delay, c] + x[k + low, c]) ** 2
        result[k] = math.sqrt(square)
    return result
