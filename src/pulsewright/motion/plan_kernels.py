"""Compiled speeds and time law of the planner.

``b`` is the square of the path speed. Under constant path acceleration ``a`` it is linear in the
path coordinate s, ``db/ds = 2 a``, and every limit is linear in ``b`` and ``a``::

    |rows x'' b + rows x' a| <= acceleration
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import compiled
from pulsewright.motion.path import Elements, Floats, Limits


@compiled(error_model="numpy")
def _hull(
    poly: Floats, rows: Floats, e: int, r: int, h: float
) -> tuple[float, float, float, float]:
    """Return, along row ``r`` of blend ``e``, x' at both ends, and the next two derivatives."""
    first, second, third = 0.0, 0.0, 0.0
    for axis in range(6):
        first += rows[r, axis] * poly[e, 1, axis]
        second += rows[r, axis] * poly[e, 2, axis]
        third += rows[r, axis] * poly[e, 3, axis]
    return first, first + (2.0 * second + 3.0 * third * h) * h, 2.0 * second, 6.0 * third


@compiled(error_model="numpy")
def _couple(
    poly: Floats, e: int, h: float, limits: Limits, x: Floats, y: Floats, limit: Floats
) -> int:
    """Fill in the limits ``|x b0 + y b1| <= limit`` on ``b`` at both ends of blend ``e``.

    The acceleration on the blend is a polynomial in s of degree 1 for parabolas, 2 for cubics;
    within limits if its Bernstein coefficients are.
    """
    n = 0
    q = 0.5 / h  # a = (b1 - b0) q
    for r in range(limits.acceleration.size):
        e1, e2, c0, jerk = _hull(poly, limits.rows, e, r, h)
        c1 = c0 + jerk * h
        x[n], y[n], limit[n] = c0 - q * e1, q * e1, limits.acceleration[r]
        n += 1
        if jerk != 0.0:
            middle = e1 + 0.5 * c0 * h
            x[n], y[n] = 0.5 * c1 - q * middle, 0.5 * c0 + q * middle
            limit[n] = limits.acceleration[r]
            n += 1
        x[n], y[n], limit[n] = -q * e2, c1 + q * e2, limits.acceleration[r]
        n += 1
    return n


@compiled(error_model="numpy")
def _interval(
    x: Floats, y: Floats, limit: Floats, n: int, fixed: float, cap: float
) -> tuple[float, float, float]:
    """Return the range of u in 0..cap with ``|x u + y fixed| <= limit``, and du/dfixed on top.

    The range is empty, low above high, where no u will do.
    """
    low, high, slope = 0.0, cap, 0.0
    for j in range(n):
        if x[j] == 0.0:
            if abs(y[j] * fixed) > limit[j]:
                low = math.inf
            continue
        middle, reach = -y[j] * fixed / x[j], limit[j] / abs(x[j])
        low = max(low, middle - reach)
        if middle + reach < high:
            high, slope = middle + reach, -y[j] / x[j]
    return low, high, slope


@compiled(error_model="numpy")
def highest_entry(
    x: Floats, y: Floats, limit: Floats, n: int, cap: float, exit_cap: float
) -> float:
    """Return the largest b0 in 0..cap for which some b1 in 0..exit_cap keeps all limits.

    A linear program in two variables, solved one constraint after the other.
    """
    low, high, slope = _interval(x, y, limit, n, exit_cap, cap)
    if low <= high and slope >= 0.0:
        return high  # leaving as fast as possible allows the fastest entry: nearly always
    u, v = cap, exit_cap
    for j in range(n):
        value = x[j] * u + y[j] * v
        if abs(value) <= limit[j]:
            continue
        # The optimum lies on this constraint: point (pu, pv) + t (du, dv) with du >= 0.
        square = x[j] * x[j] + y[j] * y[j]
        target = math.copysign(limit[j], value)
        pu, pv = x[j] * target / square, y[j] * target / square
        du, dv = -y[j], x[j]
        if du < 0.0 or (du == 0.0 and dv < 0.0):
            du, dv = -du, -dv
        last = math.inf
        for i in range(-2, j):
            if i < 0:  # 0 <= u <= cap and 0 <= v <= exit_cap
                rate, centre, reach = du, pu - 0.5 * cap, 0.5 * cap
                if i == -1:
                    rate, centre, reach = dv, pv - 0.5 * exit_cap, 0.5 * exit_cap
            else:
                rate, centre, reach = x[i] * du + y[i] * dv, x[i] * pu + y[i] * pv, limit[i]
            if abs(rate) > 1e-14 * math.sqrt(square):
                last = min(last, (-centre + math.copysign(reach, rate)) / rate)
        u, v = pu + last * du, pv + last * dv
    return min(max(u, 0.0), cap)


@compiled(error_model="numpy")
def speeds(path: Elements, limits: Limits) -> Floats:
    """Return ``b`` at the start of each element, and at the end, shape (m + 1,).

    Backwards: the fastest entry from which rest can still be reached within all limits; forwards:
    as fast as the limits allow. On each element the possible pairs of ``b`` are convex and hold
    rest, so the forward pass always finds one.
    """
    m, count = path.length.size, limits.velocity.size
    x, y, limit = np.empty(3 * count), np.empty(3 * count), np.empty(3 * count)
    cap = np.zeros(m + 1)
    before = 0.0
    for e in range(m):
        top, h = path.top[e], path.length[e]
        if path.ramp[e] == 0.0 and h > 0.0:  # the derivative of a blend stays in its hull
            for r in range(count):
                e1, e2, c0, _ = _hull(path.poly, limits.rows, e, r, h)
                fastest = max(abs(e1), abs(e2), abs(e1 + 0.5 * c0 * h))
                if fastest > 0.0:
                    top = min(top, (limits.velocity[r] / fastest) ** 2)
        if e > 0 and not path.rest[e - 1]:
            cap[e] = min(before, top)
        before = top
    b = np.zeros(m + 1)
    for e in range(m - 1, -1, -1):
        if cap[e] == 0.0:
            continue
        if path.ramp[e] > 0.0:
            b[e] = min(cap[e], b[e + 1] + 2.0 * path.ramp[e] * path.length[e])
        else:
            n = _couple(path.poly, e, path.length[e], limits, x, y, limit)
            b[e] = highest_entry(x, y, limit, n, cap[e], b[e + 1])
    for e in range(m):
        if path.ramp[e] > 0.0:
            b[e + 1] = min(b[e + 1], b[e] + 2.0 * path.ramp[e] * path.length[e])
        elif path.length[e] > 0.0:
            n = _couple(path.poly, e, path.length[e], limits, x, y, limit)
            _, high, _ = _interval(y, x, limit, n, b[e], b[e + 1])
            b[e + 1] = max(high, 0.0)
    return b


@compiled(error_model="numpy")
def law(path: Elements, b: Floats) -> tuple[NDArray[np.int32], Floats, Floats]:
    """Return the pieces of the trajectory: element, start and law of each.

    A blend is one piece. On a line or arc the machine speeds up, cruises and slows down.
    """
    m = path.length.size
    element, start = np.empty(3 * m, np.int32), np.zeros(3 * m + 1)
    piece = np.zeros((3 * m, 4))
    span, speed, rate = np.empty(3), np.empty(4), np.zeros(3)
    k, time, lost = 0, 0.0, 0.0  # compensated sum: errors do not grow
    for e in range(m):
        size, ramp = path.length[e], path.ramp[e]
        speed[0], speed[3] = math.sqrt(b[e]), math.sqrt(b[e + 1])
        span[0], span[1], span[2] = 0.0, size, 0.0
        if size == 0.0:
            time += path.dwell[e]
            element[k], start[k + 1] = e, time
            k += 1
            continue
        if ramp > 0.0:
            peak = min(path.top[e], 0.5 * (b[e] + b[e + 1]) + ramp * size)
            span[0] = min(max(peak - b[e], 0.0) / (2.0 * ramp), size)
            span[2] = min(max(peak - b[e + 1], 0.0) / (2.0 * ramp), size - span[0])
            span[1] = size - span[0] - span[2]
            if span[1] <= 1e-12 * size:
                span[1] = 0.0
            speed[1] = speed[2] = math.sqrt(peak)
            rate[0], rate[1], rate[2] = ramp, 0.0, -ramp
        else:
            speed[1], speed[2] = speed[0], speed[3]
            rate[1] = (b[e + 1] - b[e]) / (2.0 * size)
        for i in range(3):
            if span[i] <= 0.0:
                continue
            step = 2.0 * span[i] / (speed[i] + speed[i + 1]) - lost
            now = time + step
            lost = (now - time) - step
            if now > time:  # what rounding makes instantaneous is left out
                element[k] = e
                piece[k, 0] = 0.0 if i == 0 else span[0] if i == 1 else size - span[2]
                piece[k, 1], piece[k, 2] = speed[i], 0.5 * rate[i]
                k += 1
                start[k] = now
            time = now
    return element[:k], start[: k + 1], piece[:k]
