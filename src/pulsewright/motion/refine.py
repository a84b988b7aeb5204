"""Compiled refinement of a time law: an interior-point method on the states between cells.

The first plan of a run has magnitudes as bounds of a cell: they are added as if the largest ones of
all terms met, and with the same sign. Here the terms of each limit row have their signs,

    x'' v^2 + x' a               within the acceleration,
    x''' v^3 + 3 x'' v a + x' j  within the jerk,

at some places of each of the two pieces of a cell. Between two places, they exceed the larger value
of the two by at most 1/8 of the time squared times the second derivative, whose terms are bounded
by magnitudes. So a law that keeps limits here keeps them everywhere.

Newton's method makes a window of cells faster: states at its ends stay; b and a at the nodes inside
change such that the time, and barriers before the limits, get less. Over ``b`` and ``a``, the
acceleration is linear, and the jerk divided by the speed nearly is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pulsewright.compiled import compiled, inner
from pulsewright.motion.cell_law import ROUNDING, Cells, is_bent
from pulsewright.motion.path import Elements, Floats, Limits

WINDOW = 64  # cells at once
MATTERS = 0.005  # of a run's time, lost to the second-order optimum
WORTH = 0.02  # of a window's time, lost the same way
STEPS = 8  # of Newton's method
BARRIER = 0.04  # weight of barriers at first, over the mean time of a cell
CLOSE = 1e-4  # of time and barriers: so little is not worth another step
SOFTER = 0.3  # what a good step leaves of it
LEAST = 1.5e-3  # the same at last
NEAR = 0.5  # of a limit: so much before it the barrier begins
SOFT = 5e-3  # of that: from there on it rises as a parabola
RESTRAINT = 10.0  # weight against changes of the jerk, over that of barriers
HALVINGS = 8  # of a step
GAP = 0.001  # of limits, always kept free
AGAIN = 3  # times, with more distance to limits that were broken
MORE = 2  # steps then
BACK = 0.1  # of the way to the first law, then, until limits hold
FULL = 1.0 - 1e-6  # of the square of the largest speed: such a state stays
SLOW = 0.3  # of the speed in a cell: from there on, jerks are compared with the speed
TURN = 0.08  # of a cell that has places at the ends of its pieces only [rad]
PLACES = 8  # of a piece, besides its begin, at most

# Columns of a cell of a window
SIGNED = 0  # 1 if terms have signs, 0 if they are magnitudes
PARTS = 1  # between the places of a piece
ROWS = 2
SIZE, SPLIT, PACE = 3, 4, 5  # the last is 1 / the largest speed
ROOM = 6  # 3: of speed, acceleration and jerk, kept free, as they may be more between places
FREE = 9  # 3: how much more that is now
EXTRA = 12  # kept free besides, where limits were broken
USED = 13  # of limits, at most
SPEED = 14  # in the middle, which jerks are compared with
SLOPE = 15  # 4: of time and barriers, over b, a, b, a at the ends
CURVE = 19  # 10: the same twice: 00 01 02 03 11 12 13 22 23 33
COLUMNS = 29


class Window(NamedTuple):
    """Scratch for a window: few arrays, as all of them are handed on at each call."""

    cell: Floats  # (w, COLUMNS)
    # (w, r, 6): derivatives of position at the begin of the cell, magnitudes of the second and the
    # third on it, all over the jerk of the row; and its jerk over its acceleration
    terms: Floats
    state: Floats  # (4, w + 1): b and a, and the same as tried
    step: Floats  # (w + 1, 5): the inverse of a block of Newton's equations, and the step


@compiled(error_model="numpy")
def window_of(rows: int) -> Window:
    """Return a window for a number of limit rows."""
    cell, terms = np.empty((WINDOW, COLUMNS)), np.empty((WINDOW, rows, 6))
    return Window(cell, terms, np.empty((4, WINDOW + 1)), np.empty((WINDOW + 1, 5)))


@inner
def refine(
    w: Window,
    path: Elements,
    limits: Limits,
    cells: Cells,
    split: Floats,
    best: Floats,
    b: Floats,
    a: Floats,
    first: int,
    last: int,
) -> None:
    """Make a run faster where b is far below ``best``, its second-order optimum."""
    whole, lost = _loss(cells, best, b, first, last)
    if lost < MATTERS * whole:
        return
    row, share, begin = cells.row, cells.share, first
    while begin < last:
        end = begin + 1
        while end < min(last, begin + WINDOW):
            pace = max(share[row[end - 1], 0, 0], share[row[end], 0, 0])
            if b[end] * pace * pace >= FULL:
                break
            end += 1
        whole, lost = _loss(cells, best, b, begin, end)
        if lost > WORTH * whole:
            _window(w, path, limits, cells, split, b, a, begin, end)
        begin = end


@inner
def _loss(cells: Cells, best: Floats, b: Floats, first: int, last: int) -> tuple[float, float]:
    """Return about the time of some cells, and how much less it is with ``best``."""
    whole, less = 0.0, 0.0
    for c in range(first, last):
        size = 2.0 * cells.size[c]
        whole += size / (math.sqrt(b[c]) + math.sqrt(b[c + 1]))
        less += size / (math.sqrt(best[c]) + math.sqrt(best[c + 1]))
    return whole, whole - less


@inner
def _window(
    w: Window,
    path: Elements,
    limits: Limits,
    cells: Cells,
    split: Floats,
    b: Floats,
    a: Floats,
    first: int,
    last: int,
) -> None:
    """Make cells ``first`` to ``last`` - 1 faster; if nothing better is found, states stay."""
    n, state = last - first, w.state
    for i in range(n):
        _prepare(w.cell[i], w.terms[i], path, limits, cells, split, first + i)
    for i in range(n + 1):
        state[0, i] = state[2, i] = b[first + i]
        state[1, i] = state[3, i] = a[first + i]
    before = _value(w, n, 0, 0.0, math.inf)
    if not before < math.inf:
        return
    weight, after, worst = BARRIER * before / n, math.inf, math.inf
    for trial in range(1 + AGAIN):
        part = 0.5
        for _ in range(STEPS if trial == 0 else MORE):
            part = _stepped(w, n, weight, min(1.0, 2.0 * part), trial > 0)
            if part == 0.0:
                break
            if part >= 0.5:
                weight = max(SOFTER * weight, LEAST * before / n)
        after, worst = _value(w, n, 0, 0.0, math.inf), _worst(w, n)
        if worst <= 1.0 + ROUNDING:
            break
        for i in range(n):
            w.cell[i, EXTRA] = max(0.0, 0.7 * (w.cell[i, USED] - 1.0))
    at, part = 0, 1.0
    while worst > 1.0 + ROUNDING and part > 2.0 * BACK:  # between the first law and this one
        at = 2
        part -= BACK
        for i in range(1, n):
            state[2, i] = b[first + i] + part * (state[0, i] - b[first + i])
            state[3, i] = a[first + i] + part * (state[1, i] - a[first + i])
        after, worst = _value(w, n, 2, 0.0, math.inf), _worst(w, n)
    if after < before and worst <= 1.0 + ROUNDING:
        for i in range(1, n):
            b[first + i], a[first + i] = state[at, i], state[at + 1, i]


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
    x[SIZE], x[SPLIT], x[PACE], x[SPEED] = size, split[c], share[0, 0], 1.0
    x[ROOM] = x[ROOM + 1] = x[ROOM + 2] = x[EXTRA] = 0.0
    k, turn = 0, 0.0
    if not (is_bent(cells, c) and after <= e + 1 and path.omega[e] == 0.0):
        for r in range(cells.rows[cells.row[c]]):
            terms[r, 0], terms[r, 1], terms[r, 2] = share[r, 2], share[r, 4] * (1 / 3), share[r, 5]
            terms[r, 5] = share[r, 1] / share[r, 2]
            k += 1
        x[SIGNED], x[PARTS], x[ROWS] = 0.0, 1.0, k
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
    x[SIGNED], x[PARTS], x[ROWS] = 1.0, 1.0 + min(math.floor(turn / TURN), PLACES - 1.0), k


@inner
def _value(w: Window, n: int, at: int, weight: float, most: float) -> float:
    """Return time and barriers of all cells, with the states in rows ``at`` of the window.

    The value is not complete if it is more than ``most``.
    """
    b, a, value, i = w.state[at], w.state[at + 1], 0.0, 0
    while i < n and value <= most:
        value += _cell(w.cell[i], w.terms[i], b[i], a[i], b[i + 1], a[i + 1], weight, False)
        i += 1
    return value


@inner
def _worst(w: Window, n: int) -> float:
    """Return the largest share of a limit."""
    worst = 0.0
    for i in range(n):
        worst = max(worst, w.cell[i, USED])
    return worst


@inner
def _stepped(w: Window, n: int, weight: float, part: float, again: bool) -> float:
    """Do at most this part of a step of Newton's method; return how much, 0 if it saves nothing.

    With ``again``, limits are what matters: what was kept free of them before, is, and the time
    saved may be little.
    """
    value, state = 0.0, w.state
    b, a = state[0], state[1]
    for i in range(n):
        x = w.cell[i]
        for k in range(3):
            room = 1.1 * x[FREE + k] + (GAP if k > 0 else 0.0)
            if again:
                room = max(room, x[ROOM + k])
            x[ROOM + k] = min(room + x[EXTRA], 0.5)
        value += _cell(x, w.terms[i], b[i], a[i], b[i + 1], a[i + 1], weight, True)
    slope = _direction(w, n)
    if not slope < (0.0 if again else -CLOSE * value):
        return 0.0
    for _ in range(HALVINGS):
        least = math.inf
        for i in range(1, n):
            state[2, i] = b[i] + part * w.step[i, 3]
            state[3, i] = a[i] + part * w.step[i, 4]
            least = min(least, state[2, i])
        if least > 0.0 and _value(w, n, 2, weight, value) <= value + 1e-4 * part * slope:
            for i in range(1, n):
                b[i], a[i] = state[2, i], state[3, i]
            return part
        part *= 0.5
    return 0.0


@inner
def _direction(w: Window, n: int) -> float:
    """Solve Newton's equations; return the slope of the value along the step, 0 if there is none.

    They are block tridiagonal, as a cell ties the nodes at its ends only.
    """
    cell, step = w.cell, w.step
    for i in range(1, n):
        x, y = cell[i - 1], cell[i]
        d0, d1 = x[CURVE + 7] + y[CURVE], x[CURVE + 8] + y[CURVE + 1]
        d2 = x[CURVE + 9] + y[CURVE + 4]
        r0, r1 = -x[SLOPE + 2] - y[SLOPE], -x[SLOPE + 3] - y[SLOPE + 1]
        if i > 1:
            l0, l1, l2, l3 = x[CURVE + 2], x[CURVE + 5], x[CURVE + 3], x[CURVE + 6]
            i0, i1, i2 = step[i - 1, 0], step[i - 1, 1], step[i - 1, 2]
            x0, x1 = l0 * i0 + l1 * i1, l0 * i1 + l1 * i2
            x2, x3 = l2 * i0 + l3 * i1, l2 * i1 + l3 * i2
            d0 -= x0 * l0 + x1 * l1
            d1 -= x0 * l2 + x1 * l3
            d2 -= x2 * l2 + x3 * l3
            r0 -= x0 * step[i - 1, 3] + x1 * step[i - 1, 4]
            r1 -= x2 * step[i - 1, 3] + x3 * step[i - 1, 4]
        det = d0 * d2 - d1 * d1
        if not (d0 > 0.0 and det > 1e-12 * d0 * d2):
            return 0.0
        step[i, 0], step[i, 1], step[i, 2] = d2 / det, -d1 / det, d0 / det
        step[i, 3], step[i, 4] = r0, r1
    step[n, 3], step[n, 4] = 0.0, 0.0
    slope = 0.0
    for i in range(n - 1, 0, -1):
        x, y = cell[i - 1], cell[i]
        s0, s1 = step[i + 1, 3], step[i + 1, 4]
        r0 = step[i, 3] - y[CURVE + 2] * s0 - y[CURVE + 3] * s1
        r1 = step[i, 4] - y[CURVE + 5] * s0 - y[CURVE + 6] * s1
        s0, s1 = step[i, 0] * r0 + step[i, 1] * r1, step[i, 1] * r0 + step[i, 2] * r1
        step[i, 3], step[i, 4] = s0, s1
        slope += s0 * (x[SLOPE + 2] + y[SLOPE]) + s1 * (x[SLOPE + 3] + y[SLOPE + 1])
    return slope


@inner
def _barrier(room: float) -> tuple[float, float, float, float]:
    """Return a barrier but for a logarithm, its argument, and the barrier's two derivatives.

    It is room - 1 - log(room), and a parabola where next to no room is left.
    """
    if room > SOFT:
        return room - 1.0, room, 1.0 - 1.0 / room, 1.0 / (room * room)
    under, first, second = room - SOFT, 1.0 - 1.0 / SOFT, 1.0 / (SOFT * SOFT)
    value = SOFT - 1.0 - math.log(SOFT) + (first + 0.5 * second * under) * under
    return value, 1.0, first + second * under, second


@inner
def _add(
    x: Floats, first: float, second: float, d0: float, d1: float, d2: float, d3: float
) -> None:
    """Add derivatives of a function of one thing, whose derivatives over the states are ``d``."""
    x[SLOPE] += first * d0
    x[SLOPE + 1] += first * d1
    x[SLOPE + 2] += first * d2
    x[SLOPE + 3] += first * d3
    d = second * d0
    x[CURVE] += d * d0
    x[CURVE + 1] += d * d1
    x[CURVE + 2] += d * d2
    x[CURVE + 3] += d * d3
    d = second * d1
    x[CURVE + 4] += d * d1
    x[CURVE + 5] += d * d2
    x[CURVE + 6] += d * d3
    d = second * d2
    x[CURVE + 7] += d * d2
    x[CURVE + 8] += d * d3
    x[CURVE + 9] += second * d3 * d3


@inner
def _cell(
    x: Floats,
    terms: Floats,
    b0: float,
    a0: float,
    b1: float,
    a1: float,
    weight: float,
    derive: bool,
) -> float:
    """Return time and barriers of a cell between two states; inf if there is no law.

    How much of limits is used goes into the cell; with ``derive``, derivatives do, too.
    """
    s, size = x[SPLIT], x[SIZE]
    v0, v1, q = math.sqrt(b0), math.sqrt(b1), 1.0 - s
    linear = (v0 * (1.0 + s) + v1 * (1.0 + q)) * (1 / 3)
    root = linear * linear + (s * a0 - q * a1) * (2 / 3) * size
    if not root > 0.0:
        return math.inf
    root = math.sqrt(root)
    time = 2.0 * size / (linear + root)
    t0, t1 = s * time, q * time
    am = 2.0 * (v1 - v0) / time - (s * a0 + q * a1)
    vm = v0 + 0.5 * t0 * (a0 + am)
    j0, j1 = (am - a0) / t0, (a1 - am) / t1
    top, low = max(v0, v1, vm), vm
    if a0 * am < 0.0:  # an extreme inside the first piece
        inside = v0 - 0.5 * a0 * a0 / j0
        top, low = max(top, inside), min(low, inside)
    if am * a1 < 0.0:
        inside = vm - 0.5 * am * am / j1
        top, low = max(top, inside), min(low, inside)
    if not low > 0.0:
        return math.inf
    rate, jerk = max(abs(a0), abs(am), abs(a1)), max(abs(j0), abs(j1))

    # derivatives over b0, a0, b1, a1: of the speeds at the ends, of the time, and of acceleration
    # and speed where the pieces meet
    k0 = k1 = t00 = t01 = t02 = t03 = m0 = m1 = m2 = m3 = u0 = u1 = u2 = u3 = 0.0
    if derive:
        k0, k1 = 0.5 / v0 if v0 > 0.0 else 0.0, 0.5 / v1 if v1 > 0.0 else 0.0
        y = -time / (3.0 * root)
        t00, t01 = y * (1.0 + s) * k0, 0.5 * y * s * time
        t02, t03 = y * (1.0 + q) * k1, -0.5 * y * q * time
        y, z = -2.0 * (v1 - v0) / (time * time), 2.0 / time
        m0, m1, m2, m3 = y * t00 - z * k0, y * t01 - s, y * t02 + z * k1, y * t03 - q
        y, z = 0.5 * s * (a0 + am), 0.5 * t0
        u0, u1 = k0 + y * t00 + z * m0, y * t01 + z * (1.0 + m1)
        u2, u3 = y * t02 + z * m2, y * t03 + z * m3
        for k in range(SLOPE, COLUMNS):
            x[k] = 0.0
        _add(x, 1.0, 0.0, t00, t01, t02, t03)
        y = time / ((b0 + b1) * (b0 + b1))  # about what the time is, over b
        x[CURVE] += y
        x[CURVE + 2] += 0.5 * y
        x[CURVE + 7] += y
        x[SPEED] = vm

    value: float = time
    product, pace = 1.0, x[PACE] * (1.0 / NEAR)
    for end in range(2):
        room = 1.0 / NEAR - v1 * pace
        if end == 0:
            room = (1.0 - x[ROOM]) * (1.0 / NEAR) - vm * pace
        if room >= 1.0:
            continue
        barrier, factor, first, second = _barrier(room)
        product *= factor
        value += weight * barrier
        if derive:
            first, second = weight * first, weight * second
            if end == 1:
                _add(x, first, second, 0.0, 0.0, -pace * k1, 0.0)
            else:
                _add(x, first, second, -pace * u0, -pace * u1, -pace * u2, -pace * u3)

    # by how much acceleration and jerk may exceed the largest ones at the places
    signed, parts, rows = x[SIGNED] > 0.0, int(x[PARTS]), int(x[ROWS])
    free_a, free_j = 0.0, 0.0
    if signed:
        part = max(t0, t1) / parts
        part = 0.125 * part * part
        square = top * top
        for r in range(rows):
            d2, d3 = terms[r, 3], terms[r, 4]
            over = 4.0 * d2 * top * jerk + 3.0 * (2.0 * d3 * square + d2 * rate) * rate
            free_a = max(free_a, over * terms[r, 5] * part)
            over = 10.0 * (d3 * square + d2 * rate) * jerk + 15.0 * d3 * top * rate * rate
            free_j = max(free_j, over * part)

    limit_a, limit_j = 1.0 - x[ROOM + 1], 1.0 - x[ROOM + 2]
    most_a, most_j, share, compared = 0.0, 0.0, 1.0 / parts, 1.0 / x[SPEED]
    for piece in range(2):
        span, begin, v, a, j, e = t0, 0.0, v0, a0, j0, am
        if piece == 1:
            span, v, a, j, e = t1, vm, am, j1, a1
            begin = (v0 + (a0 * (1 / 3) + am * (1 / 6)) * t0) * t0
        for k in range(parts + 1):
            z = k * share
            gain = z * (a + 0.5 * z * (e - a))  # of speed, over the time of the piece
            now, fast = a + z * (e - a), v + span * gain
            square = fast * fast
            at, way_a, way_j = 0.0, 1.0, 1.0
            if signed:
                at = begin + span * z * (v + span * z * (0.5 * a + z * (1 / 6) * (e - a)))
            else:  # magnitudes are those of the worst signs
                way_a, way_j = math.copysign(1.0, now), math.copysign(1.0, j)
            scale = fast * compared
            slow = scale < SLOW
            if slow:
                scale = 1.0
            near_a, near_j, close = limit_a - NEAR, limit_j - NEAR * scale, 1.0 / (NEAR * scale)
            known = False  # derivatives of what is there: speed, acceleration, jerk, and the place
            v_0 = v_1 = v_2 = v_3 = a_0 = a_1 = a_2 = a_3 = j_0 = j_1 = j_2 = j_3 = 0.0
            s_0 = s_1 = s_2 = s_3 = 0.0
            for r in range(rows):
                d1, d2, d3, ratio = terms[r, 0], terms[r, 1], terms[r, 2], terms[r, 5]
                if signed:
                    d1, d2 = d1 + (d2 + 0.5 * d3 * at) * at, d2 + d3 * at
                f_a = ratio * (d2 * square + way_a * d1 * now)
                f_j = way_j * d1 * j + (3.0 * way_a * d2 * now + d3 * square) * fast
                most_a, most_j = max(most_a, abs(f_a)), max(most_j, abs(f_j))
                if abs(f_a) <= near_a and abs(f_j) <= near_j:
                    continue
                for which in range(2):
                    room = (limit_a - abs(f_a)) * (1.0 / NEAR)
                    if which == 1:
                        room = (limit_j - abs(f_j)) * close
                    if room >= 1.0:
                        continue
                    barrier, factor, first, second = _barrier(room)
                    product *= factor
                    value += weight * barrier
                    if not derive:
                        continue
                    if not known:
                        known = True
                        y, u = span * z * (1.0 - 0.5 * z), 0.5 * span * z * z
                        f = (v + span * z * (a + z * (1 / 3) * (e - a))) * z
                        g, h = (0.5 - z * (1 / 6)) * (span * z), (1 / 6) * span * z * z
                        g, h = g * (span * z), h * (span * z)
                        if piece == 0:
                            f *= s
                            s_0, s_1 = span * z * k0 + f * t00 + h * m0, f * t01 + h * m1 + g
                            s_2, s_3 = f * t02 + h * m2, f * t03 + h * m3
                            h, d = s * gain, -s * j0
                            v_0, v_1 = k0 + h * t00 + u * m0, h * t01 + u * m1 + y
                            v_2, v_3 = h * t02 + u * m2, h * t03 + u * m3
                            a_0, a_1, a_2, a_3 = z * m0, z * m1 + 1.0 - z, z * m2, z * m3
                            j_0, j_1 = (m0 + d * t00) / t0, (m1 - 1.0 + d * t01) / t0
                            j_2, j_3 = (m2 + d * t02) / t0, (m3 + d * t03) / t0
                        else:
                            f = f * q + s * (v0 + t0 * (a0 * (2 / 3) + am * (1 / 3)))
                            g += (1 / 6) * t0 * t0
                            s_0 = span * z * u0 + t0 * k0 + f * t00 + g * m0
                            s_1 = span * z * u1 + (1 / 3) * t0 * t0 + f * t01 + g * m1
                            s_2 = span * z * u2 + f * t02 + g * m2
                            s_3 = span * z * u3 + f * t03 + g * m3 + h
                            h, d = q * gain, -q * j1
                            v_0, v_1 = u0 + h * t00 + y * m0, u1 + h * t01 + y * m1
                            v_2, v_3 = u2 + h * t02 + y * m2, u3 + h * t03 + y * m3 + u
                            j_0, j_1 = (d * t00 - m0) / t1, (d * t01 - m1) / t1
                            j_2, j_3 = (d * t02 - m2) / t1, (1.0 - m3 + d * t03) / t1
                            h = 1.0 - z
                            a_0, a_1, a_2, a_3 = h * m0, h * m1, h * m2, h * m3 + z
                    if which == 0:
                        y = math.copysign(ratio / NEAR, -f_a)
                        of_v, of_a, of_j = 2.0 * y * d2 * fast, y * way_a * d1, 0.0
                        of_s = y * (d3 * square + d2 * now)
                    else:
                        y = math.copysign(close, -f_j)
                        of_v = 3.0 * y * (way_a * d2 * now + d3 * square)
                        if not slow:
                            of_v -= room / fast
                        of_a, of_j = 3.0 * y * way_a * d2 * fast, y * way_j * d1
                        of_s = y * (d2 * j + 3.0 * d3 * fast * now)
                    if not signed:
                        of_s = 0.0
                    _add(
                        *(x, weight * first, weight * second),
                        of_v * v_0 + of_a * a_0 + of_j * j_0 + of_s * s_0,
                        of_v * v_1 + of_a * a_1 + of_j * j_1 + of_s * s_1,
                        of_v * v_2 + of_a * a_2 + of_j * j_2 + of_s * s_2,
                        of_v * v_3 + of_a * a_3 + of_j * j_3 + of_s * s_3,
                    )
    value -= weight * math.log(product)
    if not signed:  # all terms are at their worst together
        for r in range(rows):
            d1, d2, d3 = terms[r, 0], terms[r, 1], terms[r, 2]
            free_a = max(free_a, terms[r, 5] * (d2 * top * top + d1 * rate))
            free_j = max(free_j, d1 * jerk + (3.0 * d2 * rate + d3 * top * top) * top)
        free_a, free_j = max(0.0, free_a - most_a), max(0.0, free_j - most_j)
    x[USED] = max(top * x[PACE], most_a + free_a, most_j + free_j)
    x[FREE] = (top - max(v0, v1, vm)) * x[PACE]
    x[FREE + 1], x[FREE + 2] = free_a, free_j
    if derive:  # curvature where no limit is near
        strongest = 0.0
        for r in range(rows):
            strongest = max(strongest, abs(terms[r, 0]))
        y, z = strongest / t0, -strongest * j0 / time
        _add(
            *(x, 0.0, RESTRAINT * weight, y * m0 + z * t00, y * (m1 - 1.0) + z * t01),
            *(y * m2 + z * t02, y * m3 + z * t03),
        )
        y, z = -strongest / t1, -strongest * j1 / time
        _add(
            *(x, 0.0, RESTRAINT * weight, y * m0 + z * t00, y * m1 + z * t01),
            *(y * m2 + z * t02, y * (m3 - 1.0) + z * t03),
        )
    return value
