"""Compiled refinement of a time law: an interior-point method on the states between cells.

The first plan of a run has magnitudes as bounds of a cell: they are added as if the largest ones of
all terms met, and with the same sign. Here the terms of each limit row have their signs,

    x'' v^2 + x' a               within the acceleration,
    x''' v^3 + 3 x'' v a + x' j  within the jerk,

at some places of each of the two pieces of a cell. Between two places, they exceed the larger value
of the two by at most 1/8 of the time squared times the second derivative, whose terms are bounded
by magnitudes. So a law that keeps limits here keeps them everywhere.

States at the ends of a window of cells stay; b and a at the nodes inside are changed to make it
faster. Over them, the acceleration is linear, and the jerk divided by the speed nearly is. Each
limit that is near has a *slack*, which is to be what is left of it, and a *force*, by which it
pushes back: at the optimum one of the two is 0, and the forces hold the balance to the time that
could be saved. Newton's method solves that with the product of the two at a weight, which goes to 0
(a primal-dual method; slacks of limits that are broken at first are too large until they fit).
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from pulsewright.compiled import compiled, inlined, inner
from pulsewright.motion.cell_law import ROUNDING, Cells, extremes, is_bent, two_pieces
from pulsewright.motion.path import Elements, Floats, Limits

WINDOW = 192  # cells at once
STEPS = 20  # of Newton's method
BARRIER = 0.04  # weight of barriers at first, over the mean time of a cell
LEAST = 2e-4  # the same at last
SOFTER = 0.85  # by which part a whole step makes it less
CLOSE = 1e-3  # of the time: so little is not worth another step
NEAR = 0.35  # of a limit: so much before it the barrier begins
SLACK = 0.3  # of that, at least, where a limit is met the first time
BOUNDARY = 0.95  # of slacks and forces, used up in a step at most
FARTHEST = 0.8  # of b, the same
RESTRAINT = 5.0  # weight against changes of the jerk, over that of barriers
LITTLE = 1e-6  # part of a step: less is none
JAMMED = 0.03  # part of a step: something is in the way
PATIENCE = 4  # such steps one after another: it stays there
GAP = 0.0005  # of limits, always kept free
MARGIN = 1.03  # over what limits may be exceeded by between places
AGAIN = 0.7  # of what limits were broken by: kept free besides
BACK = (0.0, 0.1, 0.2, 0.4, 0.8)  # of the way to states that keep limits, until others do, too
SLOW = 0.3  # of the speed in a cell: from there on, jerks are compared with the speed
TURN = 0.08  # of a cell that has places at the ends of its pieces only [rad]
PLACES = 12  # of a piece, besides its begin, at most

# Columns of a cell of a window
SIGNED = 0  # 1 if terms have signs, 0 if they are magnitudes
SIDES = 1  # 2 if magnitudes are those of both signs of the acceleration, 1 elsewhere
PARTS = 2  # between the places of a piece
ROWS = 3
SIZE, SPLIT, PACE = 4, 5, 6  # the last is 1 / the largest speed
ROOM = 7  # 3: of speed, acceleration and jerk, kept free, as they may be more between places
FREE = 10  # 3: how much more that is now
EXTRA = 13  # kept free besides, where limits were broken
USED = 14  # of limits, at most
BEGIN = 15  # the first of its limits that are near
SLOPE = 16  # 4: of time and barriers, over b, a, b, a at the ends
CURVE = 20  # (4, 4): the same twice
COLUMNS = 36

# Rows of b and a: as they are, before the last step, and the best ones that keep limits
NOW, BEFORE, GOOD = 0, 2, 4

Quad: TypeAlias = tuple[float, float, float, float]  # derivatives over b, a, b, a at a cell's ends


class Window(NamedTuple):
    """Scratch for a window: few arrays, as all of them are handed on at each call."""

    cell: Floats  # (w, COLUMNS)
    # (w, r, 6): derivatives of position at the begin of the cell, magnitudes of the second and the
    # third on it, all over the jerk of the row; and its jerk over its acceleration
    terms: Floats
    state: Floats  # (6, w + 1), see NOW
    step: Floats  # (w + 1, 5): the inverse of a block of Newton's equations, and the step
    # (w * k, 8), limits that are near: what is left over NEAR, its derivatives (then the changes of
    # slack and force), slack, force, and which limit of the cell it is
    near: Floats
    hold: Floats  # (w, k, 2) slack and force of each limit of a cell; 0 if it was not near


class Law(NamedTuple):
    """The time law of a cell, and its derivatives."""

    time: float
    v0: float
    vm: float  # where the two pieces meet
    v1: float
    a0: float
    am: float
    a1: float
    j0: float
    j1: float
    top: float  # largest speed
    of_v0: float  # derivative of v0 over its square
    of_v1: float
    of_time: Quad
    of_am: Quad
    of_vm: Quad


@compiled(error_model="numpy")
def window_of(rows: int) -> Window:
    """Return a window for a number of limit rows."""
    most = 3 + 4 * (PLACES + 1) * rows
    return Window(
        np.empty((WINDOW, COLUMNS)),
        np.empty((WINDOW, rows, 6)),
        np.empty((6, WINDOW + 1)),
        np.empty((WINDOW + 1, 5)),
        np.empty((WINDOW * most, 8)),
        np.empty((WINDOW, most, 2)),
    )


@inner
def refine(
    w: Window,
    path: Elements,
    limits: Limits,
    cells: Cells,
    split: Floats,
    b: Floats,
    a: Floats,
    first: int,
    last: int,
) -> bool:
    """Make cells ``first`` to ``last`` - 1 faster, and return whether nothing was in the way."""
    n, state = last - first, w.state
    for i in range(n):
        _prepare(w.cell[i], w.terms[i], path, limits, cells, split, first + i)
        for k in range(w.hold.shape[1]):
            w.hold[i, k, 1] = 0.0
    for i in range(n + 1):
        state[NOW, i] = state[BEFORE, i] = state[GOOD, i] = b[first + i]
        state[NOW + 1, i] = state[BEFORE + 1, i] = state[GOOD + 1, i] = a[first + i]
    before = _time(w, n, NOW)
    if not before < math.inf:
        return False
    best, weight, least, jams = before, BARRIER * before / n, LEAST * before / n, 0
    for _ in range(STEPS):
        time, slope, part = _stepped(w, n, weight)
        if time < best and _worst(w, n) <= 1.0 + ROUNDING:
            best = time
            _copy(state, n, BEFORE, GOOD)
        jams = jams + 1 if part < JAMMED else 0
        if jams == PATIENCE:
            break
        if weight == least and -slope < CLOSE * time:
            _time(w, n, NOW)
            if _worst(w, n) <= 1.0 + ROUNDING:
                break
            for i in range(n):
                w.cell[i, EXTRA] += max(0.0, AGAIN * (w.cell[i, USED] - 1.0))
        weight = max(weight * (1.0 - SOFTER * part), least)
    _copy(state, n, NOW, BEFORE)
    at = GOOD
    for share in BACK:
        for i in range(1, n):
            for k in range(2):
                far, good = state[BEFORE + k, i], state[GOOD + k, i]
                state[NOW + k, i] = far + share * (good - far)
        if _time(w, n, NOW) < best and _worst(w, n) <= 1.0 + ROUNDING:
            at = NOW
            break
    if at == GOOD and best == before:
        return False
    for i in range(1, n):
        b[first + i], a[first + i] = state[at, i], state[at + 1, i]
    return jams < PATIENCE


@inner
def _copy(state: Floats, n: int, source: int, target: int) -> None:
    """Copy states inside of a window."""
    for i in range(1, n):
        state[target, i], state[target + 1, i] = state[source, i], state[source + 1, i]


@inner
def _prepare(
    x: Floats, terms: Floats, path: Elements, limits: Limits, cells: Cells, split: Floats, c: int
) -> None:
    """Put what does not change into a cell of a window.

    Terms have signs where the cell is a part of one element that is no arc.
    """
    e, share = cells.element[c], cells.share[cells.row[c]]
    begin, size = cells.offset[c], cells.size[c]
    after = cells.element[c + 1] if c + 1 < cells.size.size else path.length.size
    x[SIZE], x[SPLIT], x[PACE] = size, split[c], share[0, 0]
    x[ROOM] = x[ROOM + 1] = x[ROOM + 2] = x[EXTRA] = 0.0
    k, turn, bent = 0, 0.0, is_bent(cells, c)
    if not (bent and after <= e + 1 and path.omega[e] == 0.0):
        for r in range(cells.rows[cells.row[c]]):
            terms[r, 0], terms[r, 1], terms[r, 2] = share[r, 2], share[r, 4] * (1 / 3), share[r, 5]
            terms[r, 5] = share[r, 1] / share[r, 2]
            k += 1
        x[SIGNED], x[SIDES], x[PARTS], x[ROWS] = 0.0, 2.0 if bent else 1.0, 1.0, k
        return
    for r in range(limits.velocity.size):
        d1, d2, d3 = 0.0, 0.0, 0.0
        for axis in range(limits.begin[r], limits.end[r]):
            part = limits.rows[r, axis]
            p2, p3 = part * path.poly[e, 2, axis], part * path.poly[e, 3, axis]
            d1 += part * path.poly[e, 1, axis] + (2.0 * p2 + 3.0 * p3 * begin) * begin
            d2 += 2.0 * p2 + 6.0 * p3 * begin
            d3 += 6.0 * p3
        if d1 == 0.0 and d2 == 0.0 and d3 == 0.0:
            continue
        bend, scale = max(abs(d2), abs(d2 + d3 * size)), limits.per_jerk[r]
        turn = max(turn, bend * size)
        terms[k, 0], terms[k, 1], terms[k, 2] = d1 * scale, d2 * scale, d3 * scale
        terms[k, 3], terms[k, 4] = bend * scale, abs(d3) * scale
        terms[k, 5] = limits.jerk[r] * limits.per_acceleration[r]
        k += 1
    x[SIGNED], x[SIDES], x[ROWS] = 1.0, 1.0, k
    x[PARTS] = 1.0 + min(math.floor(turn / TURN), PLACES - 1.0)


@inner
def _time(w: Window, n: int, at: int) -> float:
    """Return the time of all cells with the states in rows ``at``; find what limits they use."""
    b, a, time = w.state[at], w.state[at + 1], 0.0
    for i in range(n):
        x = w.cell[i]
        law = _law(x[SIZE], x[SPLIT], b[i], a[i], b[i + 1], a[i + 1], False)
        if law.time == math.inf:
            return math.inf
        _limits(x, w.terms[i], w.hold[i], w.near, 0, law, False, False, False)
        time += law.time
    return time


@inner
def _worst(w: Window, n: int) -> float:
    """Return the largest share of a limit."""
    worst = 0.0
    for i in range(n):
        worst = max(worst, w.cell[i, USED])
    return worst


@inner
def _stepped(w: Window, n: int, weight: float) -> tuple[float, float, float]:
    """Do a step of Newton's method.

    Return the time before it, the slope of time and barriers along it, and which part of it was
    possible.
    """
    state, near = w.state, w.near
    b, a = state[NOW], state[NOW + 1]
    time, k = 0.0, 0
    for i in range(n):
        x = w.cell[i]
        for j in range(3):
            room = MARGIN * x[FREE + j] + (GAP if j > 0 else 0.0)
            x[ROOM + j] = min(room + x[EXTRA], 0.5)
        law = _law(x[SIZE], x[SPLIT], b[i], a[i], b[i + 1], a[i + 1], True)
        time += law.time
        x[BEGIN] = k
        k = _limits(x, w.terms[i], w.hold[i], near, k, law, True, i == 0, i == n - 1)
        _assemble(x, w.terms[i], w.hold[i], near, k, law, weight)
    slope = _direction(w, n)
    part, dual = _possible(w, n, k, weight)
    _copy(state, n, NOW, BEFORE)
    while not _moved(w, n, part):
        part *= 0.5
        if not part > LITTLE:
            part = 0.0
            _copy(state, n, BEFORE, NOW)
            break
    for i in range(n):
        after = int(w.cell[i + 1, BEGIN]) if i + 1 < n else k
        for p in range(int(w.cell[i, BEGIN]), after):
            which = int(near[p, 7])
            w.hold[i, which, 0] = near[p, 5] + part * near[p, 1]
            w.hold[i, which, 1] = near[p, 6] + dual * near[p, 2]
    return time, slope, min(part, dual)


@inner
def _moved(w: Window, n: int, part: float) -> bool:
    """Go a part of a step, and return whether all cells have a law then."""
    state, found = w.state, True
    for i in range(1, n):
        state[NOW, i] = state[BEFORE, i] + part * w.step[i, 3]
        state[NOW + 1, i] = state[BEFORE + 1, i] + part * w.step[i, 4]
    b, a = state[NOW], state[NOW + 1]
    for i in range(n):
        x = w.cell[i]
        law = _law(x[SIZE], x[SPLIT], b[i], a[i], b[i + 1], a[i + 1], False)
        found = found and law.time < math.inf
    return found


@inner
def _possible(w: Window, n: int, k: int, weight: float) -> tuple[float, float]:
    """Return which parts of a step states and slacks, and forces can go.

    How much all of them would change is put into the list of limits.
    """
    near, step, part, dual = w.near, w.step, 1.0, 1.0
    for i in range(n):
        d0, d1, d2, d3 = step[i, 3], step[i, 4], step[i + 1, 3], step[i + 1, 4]
        if d0 < -FARTHEST * w.state[NOW, i]:
            part = min(part, -FARTHEST * w.state[NOW, i] / d0)
        after = int(w.cell[i + 1, BEGIN]) if i + 1 < n else k
        for p in range(int(w.cell[i, BEGIN]), after):
            slack, force = near[p, 5], near[p, 6]
            more = near[p, 1] * d0 + near[p, 2] * d1 + near[p, 3] * d2 + near[p, 4] * d3
            more += near[p, 0] - slack
            push = (weight - force * more) / slack - force
            near[p, 1], near[p, 2] = more, push
            if more < -BOUNDARY * slack:
                part = min(part, -BOUNDARY * slack / more)
            if push < -BOUNDARY * force:
                dual = min(dual, -BOUNDARY * force / push)
    return part, dual


@inner
def _direction(w: Window, n: int) -> float:
    """Solve Newton's equations; return the slope of time and barriers along the step.

    They are block tridiagonal, as a cell ties the nodes at its ends only. A node whose equations
    have no solution, but for rounding, stays.
    """
    cell, step = w.cell, w.step
    for i in range(1, n):
        x, y = cell[i - 1], cell[i]
        d0, d1 = x[CURVE + 10] + y[CURVE], x[CURVE + 11] + y[CURVE + 1]
        d2 = x[CURVE + 15] + y[CURVE + 5]
        r0, r1 = -x[SLOPE + 2] - y[SLOPE], -x[SLOPE + 3] - y[SLOPE + 1]
        if i > 1:
            l0, l1, l2, l3 = x[CURVE + 2], x[CURVE + 6], x[CURVE + 3], x[CURVE + 7]
            i0, i1, i2 = step[i - 1, 0], step[i - 1, 1], step[i - 1, 2]
            x0, x1 = l0 * i0 + l1 * i1, l0 * i1 + l1 * i2
            x2, x3 = l2 * i0 + l3 * i1, l2 * i1 + l3 * i2
            d0 -= x0 * l0 + x1 * l1
            d1 -= x0 * l2 + x1 * l3
            d2 -= x2 * l2 + x3 * l3
            r0 -= x0 * step[i - 1, 3] + x1 * step[i - 1, 4]
            r1 -= x2 * step[i - 1, 3] + x3 * step[i - 1, 4]
        det = d0 * d2 - d1 * d1
        step[i, 0] = step[i, 1] = step[i, 2] = 0.0
        if d0 > 0.0 and det > 1e-14 * d0 * d2:
            det = 1.0 / det
            step[i, 0], step[i, 1], step[i, 2] = d2 * det, -d1 * det, d0 * det
        step[i, 3], step[i, 4] = r0, r1
    step[0, 3] = step[0, 4] = step[n, 3] = step[n, 4] = 0.0
    slope = 0.0
    for i in range(n - 1, 0, -1):
        x, y = cell[i - 1], cell[i]
        s0, s1 = step[i + 1, 3], step[i + 1, 4]
        r0 = step[i, 3] - y[CURVE + 2] * s0 - y[CURVE + 3] * s1
        r1 = step[i, 4] - y[CURVE + 6] * s0 - y[CURVE + 7] * s1
        s0, s1 = step[i, 0] * r0 + step[i, 1] * r1, step[i, 1] * r0 + step[i, 2] * r1
        step[i, 3], step[i, 4] = s0, s1
        slope += s0 * (x[SLOPE + 2] + y[SLOPE]) + s1 * (x[SLOPE + 3] + y[SLOPE + 1])
    return slope


@inlined
def _assemble(
    x: Floats, terms: Floats, hold: Floats, near: Floats, end: int, law: Law, weight: float
) -> None:
    """Find slope and curvature of time and barriers of a cell.

    Slacks and forces of its limits go into the list, which ``end`` is the end of.
    """
    t, m, none = law.of_time, law.of_am, (0.0, 0.0, 0.0, 0.0)
    b0, b1, per_time = law.v0 * law.v0, law.v1 * law.v1, 1.0 / law.time
    y = law.time / ((b0 + b1) * (b0 + b1))  # about what the time is, over b
    slope, row0, row1 = t, (y, 0.0, 0.5 * y, 0.0), none
    row2, row3 = (0.5 * y, 0.0, y, 0.0), none
    begin, strongest = int(x[BEGIN]), 0.0
    for r in range(int(x[ROWS])):
        strongest = max(strongest, abs(terms[r, 0]))
    for p in range(begin - 2, end):
        if p < begin:  # against changes of the jerk of a piece, where no limit is near
            ahead = p == begin - 2
            y = strongest * per_time / (x[SPLIT] if ahead else x[SPLIT] - 1.0)
            z = -strongest * per_time * (law.j0 if ahead else law.j1)
            d = _mix((0.0, -y if ahead else 0.0, 0.0, 0.0 if ahead else -y), y, m, z, t)
            first, second = 0.0, RESTRAINT * weight
        else:
            which = int(near[p, 7])
            room, slack, force = near[p, 0], hold[which, 0], hold[which, 1]
            slack = max(room, slack if force > 0.0 else SLACK)
            if force == 0.0:
                force = weight / slack
            near[p, 5], near[p, 6] = slack, force
            second = force / slack
            first = weight - weight / slack + second * (room - slack)
            d = near[p, 1], near[p, 2], near[p, 3], near[p, 4]
        slope = _plus(slope, first, d)
        row0 = _plus(row0, second * d[0], d)
        row1 = _plus(row1, second * d[1], d)
        row2 = _plus(row2, second * d[2], d)
        row3 = _plus(row3, second * d[3], d)
    for k in range(4):
        x[SLOPE + k] = slope[k]
        x[CURVE + k], x[CURVE + 4 + k] = row0[k], row1[k]
        x[CURVE + 8 + k], x[CURVE + 12 + k] = row2[k], row3[k]


@inlined
def _law(size: float, s: float, b0: float, a0: float, b1: float, a1: float, derive: bool) -> Law:
    """Return the law of a cell between two states; its time is infinite if there is none.

    Derivatives are 0 without ``derive``.
    """
    v0, v1, q, none = math.sqrt(b0), math.sqrt(b1), 1.0 - s, (0.0, 0.0, 0.0, 0.0)
    time, am, vm, root = two_pieces(v0, v1, a0, a1, size, s)
    if not time > 0.0:
        return Law(math.inf, v0, v0, v1, a0, a0, a1, 0.0, 0.0, v0, 0.0, 0.0, none, none, none)
    per_time, t0, t1 = 1.0 / time, s * time, q * time
    j0, j1 = (am - a0) / t0, (a1 - am) / t1
    top, low = extremes(v0, vm, v1, a0, am, a1, t0, t1)
    if not low > 0.0:
        time = math.inf
    if not derive or time == math.inf:
        return Law(time, v0, vm, v1, a0, am, a1, j0, j1, top, 0.0, 0.0, none, none, none)
    k0, k1 = 0.5 / v0 if v0 > 0.0 else 0.0, 0.5 / v1 if v1 > 0.0 else 0.0
    y = -time / (3.0 * root)
    t = y * (1.0 + s) * k0, 0.5 * y * s * time, y * (1.0 + q) * k1, -0.5 * y * q * time
    z = 2.0 * per_time
    m = _plus((-z * k0, -s, z * k1, -q), -z * (v1 - v0) * per_time, t)
    z = 0.5 * t0
    u = _mix((k0, z, 0.0, 0.0), 0.5 * s * (a0 + am), t, z, m)
    return Law(time, v0, vm, v1, a0, am, a1, j0, j1, top, k0, k1, t, m, u)


@inlined
def _plus(x: Quad, p: float, y: Quad) -> Quad:
    """Return x + p y."""
    return x[0] + p * y[0], x[1] + p * y[1], x[2] + p * y[2], x[3] + p * y[3]


@inlined
def _times(p: float, x: Quad) -> Quad:
    """Return p x."""
    return p * x[0], p * x[1], p * x[2], p * x[3]


@inlined
def _mix(x: Quad, p: float, y: Quad, q: float, z: Quad) -> Quad:
    """Return x + p y + q z."""
    return (
        x[0] + p * y[0] + q * z[0],
        x[1] + p * y[1] + q * z[1],
        x[2] + p * y[2] + q * z[2],
        x[3] + p * y[3] + q * z[3],
    )


@inlined
def _listed(near: Floats, k: int, which: int, room: float, x: Quad) -> int:
    """Put a limit, its room and the derivatives of that into the list; return the new end."""
    near[k, 0], near[k, 1], near[k, 2], near[k, 3], near[k, 4] = room, x[0], x[1], x[2], x[3]
    near[k, 7] = which
    return k + 1


@inlined
def _limits(
    x: Floats,
    terms: Floats,
    hold: Floats,
    near: Floats,
    k: int,
    law: Law,
    derive: bool,
    begins: bool,
    ends: bool,
) -> int:
    """Find what a cell uses of limits; with ``derive``, list those that are near, from ``k`` on.

    Return the end of the list. Where a window begins and ends, the state stays.
    """
    s, v0, vm, v1, top = x[SPLIT], law.v0, law.vm, law.v1, law.top
    a0, am, a1, j0, j1 = law.a0, law.am, law.a1, law.j0, law.j1
    t0, t1, none = s * law.time, (1.0 - s) * law.time, (0.0, 0.0, 0.0, 0.0)
    signed, parts, rows = x[SIGNED] > 0.0, int(x[PARTS]), int(x[ROWS])
    limit_a, limit_j, which = 1.0 - x[ROOM + 1], 1.0 - x[ROOM + 2], 1
    if derive:
        pace = x[PACE] * (1.0 / NEAR)
        slopes = (
            (-pace * law.of_v0, 0.0, 0.0, 0.0),
            _times(-pace, law.of_vm),
            (0.0, 0.0, -pace * law.of_v1, 0.0),
        )
        for i, (v, fixed) in enumerate(((v0, begins), (vm, False), (v1, ends))):
            room = (1.0 - x[ROOM]) * (1.0 / NEAR) - v * pace
            if room < 1.0 and not fixed:
                k = _listed(near, k, i, room, slopes[i])
            else:
                hold[i, 1] = 0.0
    most_a, most_j, share, compared = 0.0, 0.0, 1.0 / parts, 1.0 / vm
    for piece in range(2):
        span, begin, v, a, j, last = t0, 0.0, v0, a0, j0, am
        if piece == 1:
            span, v, a, j, last = t1, vm, am, j1, a1
            begin = (v0 + (a0 * (1 / 3) + am * (1 / 6)) * t0) * t0
        for place in range(parts + 1):
            z = place * share
            now, fast = a + z * (last - a), v + span * z * (a + 0.5 * z * (last - a))
            square, scale = fast * fast, fast * compared
            at, way_a, way_j = 0.0, 1.0, 1.0
            if signed:
                at = begin + span * z * (v + span * z * (0.5 * a + z * (1 / 6) * (last - a)))
            else:  # of the worst signs
                way_a, way_j = math.copysign(1.0, now), math.copysign(1.0, j)
            slow = scale < SLOW
            if slow:
                scale = 1.0
            near_a, near_j = limit_a - NEAR, limit_j - NEAR * scale
            if piece == 1 and place == 0:  # the end of the first has the same acceleration
                near_a = math.inf
            known, of_s, of_v, of_a, of_j = False, none, none, none, none
            for i in range(int(x[SIDES]) * rows):
                r = i
                if i >= rows:  # next to an acceleration of 0, both signs may matter
                    r = i - rows
                    way_a = -math.copysign(1.0, now)
                d1, d2, d3, ratio = terms[r, 0], terms[r, 1], terms[r, 2], terms[r, 5]
                if signed:
                    d1, d2 = d1 + (d2 + 0.5 * d3 * at) * at, d2 + d3 * at
                f_a = ratio * (d2 * square + way_a * d1 * now)
                f_j = way_j * d1 * j + (3.0 * way_a * d2 * now + d3 * square) * fast
                most_a, most_j = max(most_a, abs(f_a)), max(most_j, abs(f_j))
                if not derive:
                    continue
                which += 2
                is_near_a, is_near_j = abs(f_a) > near_a, abs(f_j) > near_j
                if not is_near_a:
                    hold[which, 1] = 0.0
                if not is_near_j:
                    hold[which + 1, 1] = 0.0
                if not known and (is_near_a or is_near_j):
                    known = True
                    of_s, of_v, of_a, of_j = _there(law, s, piece, z)
                if is_near_a:
                    y = math.copysign(ratio * (1.0 / NEAR), -f_a)
                    room = (limit_a - abs(f_a)) * (1.0 / NEAR)
                    slope = _plus(_times(2.0 * y * d2 * fast, of_v), y * way_a * d1, of_a)
                    if signed:
                        slope = _plus(slope, y * (d3 * square + d2 * now), of_s)
                    k = _listed(near, k, which, room, slope)
                if is_near_j:
                    close = 1.0 / (NEAR * scale)
                    y = math.copysign(close, -f_j)
                    room = (limit_j - abs(f_j)) * close
                    z_v = 3.0 * y * (way_a * d2 * now + d3 * square)
                    if not slow:
                        z_v -= room / fast
                    slope = _plus(_times(z_v, of_v), 3.0 * y * way_a * d2 * fast, of_a)
                    z_s = y * (d2 * j + 3.0 * d3 * fast * now) if signed else 0.0
                    slope = _mix(slope, y * way_j * d1, of_j, z_s, of_s)
                    k = _listed(near, k, which + 1, room, slope)
    free_a, free_j = _margins(terms, rows, law, max(t0, t1) * share, signed)
    if not signed:  # all terms are at their worst together
        free_a, free_j = max(0.0, free_a - most_a), max(0.0, free_j - most_j)
    x[USED] = max(top * x[PACE], most_a + free_a, most_j + free_j)
    x[FREE] = (top - max(v0, v1, vm)) * x[PACE]
    x[FREE + 1], x[FREE + 2] = free_a, free_j
    return k


@inner
def _margins(terms: Floats, rows: int, law: Law, span: float, signed: bool) -> tuple[float, float]:
    """Return by how much acceleration and jerk may exceed those at places ``span`` seconds apart.

    Without signs, it is the largest that there can be of both.
    """
    top, rate = law.top, max(abs(law.a0), abs(law.am), abs(law.a1))
    jerk, square = max(abs(law.j0), abs(law.j1)), top * top
    free_a, free_j, part = 0.0, 0.0, 0.125 * span * span
    for r in range(rows):
        if signed:
            d2, d3 = terms[r, 3], terms[r, 4]
            over = 4.0 * d2 * top * jerk + 3.0 * (2.0 * d3 * square + d2 * rate) * rate
            free_a = max(free_a, over * terms[r, 5] * part)
            over = 10.0 * (d3 * square + d2 * rate) * jerk + 15.0 * d3 * top * rate * rate
            free_j = max(free_j, over * part)
        else:
            d1, d2, d3 = terms[r, 0], terms[r, 1], terms[r, 2]
            free_a = max(free_a, terms[r, 5] * (d2 * square + d1 * rate))
            free_j = max(free_j, d1 * jerk + (3.0 * d2 * rate + d3 * square) * top)
    return free_a, free_j


@inlined
def _there(law: Law, s: float, piece: int, z: float) -> tuple[Quad, Quad, Quad, Quad]:
    """Return the derivatives of place, speed, acceleration and jerk at part ``z`` of a piece."""
    t, m, u = law.of_time, law.of_am, law.of_vm
    q, t0 = 1.0 - s, s * law.time
    if piece == 0:
        span, v, a, more, per = t0, law.v0, law.a0, law.am - law.a0, 1.0 / t0
    else:
        span, v, a, more = q * law.time, law.vm, law.am, law.a1 - law.am
        per = 1.0 / span
    y = span * z
    gain, f = z * (a + 0.5 * z * more), z * (v + y * (a + z * (1 / 3) * more))
    g, h = (0.5 - z * (1 / 6)) * y * y, z * (1 / 6) * y * y
    early, late = y * (1.0 - 0.5 * z), 0.5 * y * z
    if piece == 0:
        k0 = law.of_v0
        return (
            _mix((y * k0, g, 0.0, 0.0), s * f, t, h, m),
            _mix((k0, early, 0.0, 0.0), s * gain, t, late, m),
            _plus((0.0, 1.0 - z, 0.0, 0.0), z, m),
            _mix((0.0, -per, 0.0, 0.0), -s * law.j0 * per, t, per, m),
        )
    f = q * f + s * (law.v0 + t0 * (law.a0 * (2 / 3) + law.am * (1 / 3)))
    begin = t0 * law.of_v0, (1 / 3) * t0 * t0, 0.0, h
    return (
        _plus(_mix(begin, f, t, g + (1 / 6) * t0 * t0, m), y, u),
        _plus(_mix((0.0, 0.0, 0.0, late), q * gain, t, early, m), 1.0, u),
        _plus((0.0, 0.0, 0.0, z), 1.0 - z, m),
        _mix((0.0, 0.0, 0.0, per), -q * law.j1 * per, t, -per, m),
    )
