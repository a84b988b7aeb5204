"""Compiled bounds of the certificate: branch and bound over time, with intervals.

On a part of a piece, the path coordinate and its rates, and the derivatives of the geometry, lie in
intervals; so do velocity, acceleration and jerk along a row, and the derivative of that. None of
them exceeds a value near by more than its derivative allows. A part whose upper bound could be the
worst of all is halved until upper bound and actual values agree.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import compiled, inner

Floats = NDArray[np.float64]

DEPTH = 40  # halvings of a piece at most, where a limit is in question
FINE = 12  # where the limit holds
CLOSE = 1e-3  # of the bound: upper bound and actual value agree
PARTS = 64  # of a cubic whose control points lie too far out


@inner
def _product(a: float, b: float, c: float, d: float) -> tuple[float, float]:
    """Return the interval of products of a..b and c..d."""
    p, q, r, s = a * c, a * d, b * c, b * d
    return min(p, q, r, s), max(p, q, r, s)


@inner
def _wave(c: float, d: float, low: float, high: float) -> tuple[float, float]:
    """Return the interval of ``c cos(u) + d sin(u)`` for u in low..high."""
    size, phase = math.hypot(c, d), math.atan2(d, c)
    first = c * math.cos(low) + d * math.sin(low)
    last = c * math.cos(high) + d * math.sin(high)
    least, most = min(first, last), max(first, last)
    turn = 2.0 * math.pi
    if math.ceil((low - phase) / turn) * turn + phase <= high:
        most = size
    if math.ceil((low - phase - math.pi) / turn) * turn + phase + math.pi <= high:
        least = -size
    return least, most


@inner
def _quadratic(a: float, b: float, c: float, low: float, high: float) -> tuple[float, float]:
    """Return the interval of ``a + b u + c u^2`` for u in low..high."""
    first, last = a + (b + c * low) * low, a + (b + c * high) * high
    least, most = min(first, last), max(first, last)
    if c != 0.0:
        at = -0.5 * b / c
        if low < at < high:
            value = a + 0.5 * b * at
            least, most = min(least, value), max(most, value)
    return least, most


@inner
def _interval(
    along: Floats, r: int, w: float, law: Floats, k: int, low: float, high: float
) -> tuple[float, float, float, float]:
    """Return upper bounds of velocity, acceleration, jerk and its derivative along a row.

    That is from the time ``low`` to ``high`` of a piece.

    ``along`` (rows, 5) has the derivatives of the polynomial along each row, and cosine and sine;
    ``law`` (k, 4) is that of all pieces.
    """
    p1, p2, p3, cosine, sine = along[r, 0], along[r, 1], along[r, 2], along[r, 3], along[r, 4]
    c0, c1, c2, c3 = law[k, 0], law[k, 1], law[k, 2], law[k, 3]
    s0 = c0 + (c1 + (c2 + c3 * low) * low) * low
    s1 = c0 + (c1 + (c2 + c3 * high) * high) * high
    v0, v1 = _quadratic(c1, 2.0 * c2, 3.0 * c3, low, high)
    a0, a1 = 2.0 * c2 + 6.0 * c3 * low, 2.0 * c2 + 6.0 * c3 * high
    if a0 > a1:
        a0, a1 = a1, a0
    j = 6.0 * c3
    if v0 < 0.0:  # not monotonic, or so by rounding
        s0, s1 = min(s0, s1) + v0 * (high - low), max(s0, s1) - v0 * (high - low)
    d0, d1 = _quadratic(p1, 2.0 * p2, 3.0 * p3, s0, s1)
    e0, e1 = 2.0 * p2 + 6.0 * p3 * s0, 2.0 * p2 + 6.0 * p3 * s1
    if e0 > e1:
        e0, e1 = e1, e0
    f0 = f1 = 6.0 * p3
    g0 = g1 = 0.0
    if w != 0.0 and (cosine != 0.0 or sine != 0.0):
        least, most = _wave(w * sine, -w * cosine, w * s0, w * s1)
        d0, d1 = d0 + least, d1 + most
        f0, f1 = f0 - w * w * most, f1 - w * w * least
        least, most = _wave(-w * w * cosine, -w * w * sine, w * s0, w * s1)
        e0, e1 = e0 + least, e1 + most
        g0, g1 = -w * w * most, -w * w * least
    velocity = max(abs(d0), abs(d1)) * max(abs(v0), abs(v1))
    square0, square1 = _product(v0, v1, v0, v1)
    square0 = max(square0, 0.0)
    x0, x1 = _product(e0, e1, square0, square1)
    y0, y1 = _product(d0, d1, a0, a1)
    acceleration = max(abs(x0 + y0), abs(x1 + y1))
    q0, q1 = _product(square0, square1, v0, v1)
    x0, x1 = _product(f0, f1, q0, q1)
    q0, q1 = _product(v0, v1, a0, a1)
    y0, y1 = _product(e0, e1, 3.0 * q0, 3.0 * q1)
    z0, z1 = _product(d0, d1, j, j)
    jerk = max(abs(x0 + y0 + z0), abs(x1 + y1 + z1))
    q0, q1 = _product(square0, square1, square0, square1)
    x0, x1 = _product(g0, g1, q0, q1)
    q0, q1 = _product(square0, square1, a0, a1)
    y0, y1 = _product(f0, f1, 6.0 * q0, 6.0 * q1)
    q0, q1 = _product(a0, a1, a0, a1)
    u0, u1 = _product(v0, v1, 4.0 * j, 4.0 * j)
    z0, z1 = _product(e0, e1, 3.0 * max(q0, 0.0) + u0, 3.0 * q1 + u1)
    change = max(abs(x0 + y0 + z0), abs(x1 + y1 + z1))
    return velocity, acceleration, jerk, change


@inner
def _enough(actual: float, most: float, deep: int) -> float:
    """Return the upper bound that need not be made sharper, as a share of the limit."""
    if actual > 1.0:  # broken for certain: by how much need not be known better
        return max(actual * (1.0 + CLOSE), most)
    if deep >= FINE:
        return 1.0
    return min(max(actual * (1.0 + CLOSE), most), 1.0)


@compiled(error_model="numpy")
def worst(
    poly: Floats,
    cosine: Floats,
    sine: Floats,
    omega: Floats,
    element: NDArray[np.int32],
    start: Floats,
    law: Floats,
    rows: Floats,
    limit: Floats,
) -> tuple[Floats, NDArray[np.int64]]:
    """Return how far each limit is used at most, and on which piece, both (3, r).

    ``limit`` (3, r) has those of velocity, acceleration and jerk along ``rows`` (r, axes).
    """
    count, axes = rows.shape
    most, actual = np.zeros((3, count)), np.zeros((3, count))
    where = np.zeros((3, count), np.int64)
    along, moves = np.zeros((count, 5)), np.zeros(count, np.bool_)  # of one element, per row
    value, peak = np.empty(3), np.empty(3)
    begin, end, depth = np.empty(2 * DEPTH), np.empty(2 * DEPTH), np.empty(2 * DEPTH, np.int64)
    for k in range(element.size):
        e, time = element[k], start[k + 1] - start[k]
        if k == 0 or e != element[k - 1]:
            for r in range(count):
                p1, p2, p3, c, s = 0.0, 0.0, 0.0, 0.0, 0.0
                for axis in range(axes):
                    row = rows[r, axis]
                    if row != 0.0:
                        p1 += row * poly[e, 1, axis]
                        p2 += row * poly[e, 2, axis]
                        p3 += row * poly[e, 3, axis]
                        c += row * cosine[e, axis]
                        s += row * sine[e, axis]
                along[r, 0], along[r, 1], along[r, 2], along[r, 3], along[r, 4] = p1, p2, p3, c, s
                still = p1 == 0.0 and p2 == 0.0 and p3 == 0.0 and c == 0.0 and s == 0.0
                moves[r] = not still
        if law[k, 1] == 0.0 and law[k, 2] == 0.0 and law[k, 3] == 0.0:
            continue
        for r in range(count):
            if not moves[r]:
                continue
            n = 0
            begin[0], end[0], depth[0] = 0.0, time, 0
            while n >= 0:
                low, high, deep = begin[n], end[n], depth[n]
                n -= 1
                bound = _interval(along, r, omega[e], law, k, low, high)
                settled = True
                for q in range(3):
                    value[q] = bound[q] / limit[q, r]
                    settled &= value[q] <= _enough(actual[q, r], most[q, r], deep)
                if not settled and deep < DEPTH:
                    middle = 0.5 * (low + high)
                    for q in range(3):
                        peak[q] = 0.0
                    for at in (low, middle, high):
                        here = _interval(along, r, omega[e], law, k, at, at)
                        for q in range(3):
                            peak[q] = max(peak[q], here[q])
                    settled = True
                    for q in range(3):
                        actual[q, r] = max(actual[q, r], peak[q] / limit[q, r])
                        # a quarter of the time from one of the three, at most
                        far = peak[q] + 0.25 * (high - low) * bound[q + 1]
                        value[q] = min(value[q], far / limit[q, r])
                        settled &= value[q] <= _enough(actual[q, r], most[q, r], deep)
                    if not settled:
                        n += 1
                        begin[n], end[n], depth[n] = low, middle, deep + 1
                        n += 1
                        begin[n], end[n], depth[n] = middle, high, deep + 1
                        continue
                for q in range(3):
                    if not value[q] <= most[q, r]:
                        most[q, r], where[q, r] = value[q], k
    return most, where


@compiled(error_model="numpy")
def jumps(
    poly: Floats,
    cosine: Floats,
    sine: Floats,
    omega: Floats,
    element: NDArray[np.int32],
    start: Floats,
    law: Floats,
    before: Floats,
) -> Floats:
    """Return the largest jumps of position, velocity and acceleration between pieces, (3,).

    ``before`` (3, axes) has these before the first piece, and then those after the last one.
    """
    axes = poly.shape[2]
    largest, after = np.zeros(3), np.zeros((3, axes))
    for k in range(element.size):
        _state(poly, cosine, sine, omega, element[k], law, k, 0.0, after)
        for q in range(3):
            for axis in range(axes):
                jump = abs(after[q, axis] - before[q, axis])
                if not jump <= largest[q]:
                    largest[q] = jump
        _state(poly, cosine, sine, omega, element[k], law, k, start[k + 1] - start[k], before)
    return largest


@inner
def _state(
    poly: Floats,
    cosine: Floats,
    sine: Floats,
    omega: Floats,
    e: int,
    law: Floats,
    k: int,
    t: float,
    out: Floats,
) -> None:
    """Put position, velocity and acceleration at a time on piece ``k`` into ``out``."""
    c1, c2, c3 = law[k, 1], law[k, 2], law[k, 3]
    s = law[k, 0] + (c1 + (c2 + c3 * t) * t) * t
    v = c1 + (2.0 * c2 + 3.0 * c3 * t) * t
    a = 2.0 * c2 + 6.0 * c3 * t
    w = omega[e]
    cos, sin = 1.0, 0.0
    if w != 0.0:
        cos, sin = math.cos(w * s), math.sin(w * s)
    for axis in range(poly.shape[2]):
        p1, p2, p3 = poly[e, 1, axis], poly[e, 2, axis], poly[e, 3, axis]
        c, d = cosine[e, axis], sine[e, axis]
        if p1 == 0.0 and p2 == 0.0 and p3 == 0.0 and c == 0.0 and d == 0.0:
            out[0, axis], out[1, axis], out[2, axis] = poly[e, 0, axis], 0.0, 0.0
            continue
        first = p1 + (2.0 * p2 + 3.0 * p3 * s) * s + w * (d * cos - c * sin)
        second = 2.0 * p2 + 6.0 * p3 * s - w * w * (c * cos + d * sin)
        out[0, axis] = poly[e, 0, axis] + (p1 + (p2 + p3 * s) * s) * s + c * cos + d * sin
        out[1, axis] = first * v
        out[2, axis] = second * v * v + first * a


@compiled(error_model="numpy")
def distance(
    poly: Floats,
    cosine: Floats,
    sine: Floats,
    omega: Floats,
    length: Floats,
    run: NDArray[np.int64],
    base: Floats,
    along: Floats,
    cosines: Floats,
    sines: Floats,
    omegas: Floats,
    chord: Floats,
    allowed: Floats,
) -> Floats:
    """Return bounds of the distance of elements from the runs that they stand for, (m,).

    Elements of a ``run`` (m,) follow each other. Runs are straight, ``base`` + ``along`` s, besides
    ``cosines``, ``sines`` and ``omegas``; ``chord`` is what lies between them and what is
    programmed. A bound of more than ``allowed`` is made sharper. These are (runs,) or (runs, 6).
    """
    bound, c = np.empty(length.size), np.empty((4, 6))
    at = 0.0  # where on its run an element begins
    for e in range(length.size):
        q, h = run[e], length[e]
        at = at + length[e - 1] if e > 0 and run[e - 1] == q else 0.0
        w = omegas[q]
        cos, sin = (math.cos(w * at), math.sin(w * at)) if w > 0.0 else (0.0, 0.0)
        turn, across, around = 0.0, 0.0, 0.0  # squares of what is left of cosine, sine; cosine
        for part in range(2):  # X, Y, Z and A, B, C
            x, y, z = 0.0, 0.0, 0.0
            for axis in range(3 * part, 3 * part + 3):
                c[0, axis] = poly[e, 0, axis] - base[q, axis] - along[q, axis] * at
                c[1, axis] = poly[e, 1, axis] - along[q, axis]
                c[2, axis], c[3, axis] = poly[e, 2, axis], poly[e, 3, axis]
                x += (cosine[e, axis] - cosines[q, axis] * cos - sines[q, axis] * sin) ** 2
                y += (sine[e, axis] - sines[q, axis] * cos + cosines[q, axis] * sin) ** 2
                z += cosine[e, axis] ** 2
            turn, across, around = max(turn, x), max(across, y), max(around, z)
        rest = math.sqrt(turn) + math.sqrt(across) + chord[q]
        rest += abs(omega[e] - w) * h * math.sqrt(around)
        bound[e] = _hull(c, 0.0, h) + rest
        if bound[e] > allowed[q]:  # control points lie outside of curves
            largest = 0.0
            for part in range(PARTS):
                largest = max(largest, _hull(c, part * h / PARTS, h / PARTS))
            bound[e] = largest + rest
    return bound


@inner
def _hull(c: Floats, at: float, h: float) -> float:
    """Bound the length of the cubic with coefficients ``c`` (4, 6) over at..at + h.

    By the largest of its control points; of X, Y, Z or of A, B, C.
    """
    largest = 0.0
    for part in range(2):
        q0, q1, q2, q3 = 0.0, 0.0, 0.0, 0.0
        for axis in range(3 * part, 3 * part + 3):
            c1, c2, c3 = c[1, axis], c[2, axis], c[3, axis]
            first = c[0, axis] + (c1 + (c2 + c3 * at) * at) * at
            second = (c1 + (2.0 * c2 + 3.0 * c3 * at) * at) * h
            third, fourth = (c2 + 3.0 * c3 * at) * h * h, c3 * h * h * h
            q0 += first**2
            q1 += (first + second / 3.0) ** 2
            q2 += (first + (2.0 * second + third) / 3.0) ** 2
            q3 += (first + second + third + fourth) ** 2
        largest = max(largest, q0, q1, q2, q3)
        if not q3 >= 0.0:  # what is not a number is no bound
            largest = math.inf
    return math.sqrt(largest)
