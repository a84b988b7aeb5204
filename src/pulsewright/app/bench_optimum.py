"""Compiled yardsticks of planned times: what no plan of a blended path can be faster than.

T2, the second-order optimum: velocity, feed and acceleration are limited, jerk is not. Let b be the
square of the speed and x one limit row's coordinate, both functions of the path coordinate. The
row's acceleration is x'' b + x' b' / 2, and times x' it is half the slope of x'^2 b, the square of
the row's velocity. So whatever happens on a part of the path,

    |change of x'^2 b| <= 2 A (integral of |x'|)

Between a reversal of the row, where x'^2 b is 0, and an end of the part, that bounds b there. Two
rows u, v together bound it everywhere, as both have to do with the same b':

    b |u'' v' - v'' u'| <= A_u |v'| + A_v |u'|

All plans keep these bounds, and passes from both ends find the largest b at the ends of parts that
does. Where a row's limit is used all along a part, this is exact, and its time is the row's change
of velocity over A. Elsewhere b may come out a bit too large, and T2 too short: by 0.03 % at most in
programs of the corpus with 8 parts.

T3, a bound for plans that limit jerk, too. Take one limit row, its jerk J, and any stretch of the
path on which the row's coordinate moves by L. Its velocity is v(t), at the ends at most u0 and u1,
the fastest that T2 allows there. As v'' >= -J, v lies below a parabola through these: in a time T,

    L <= (u0 + u1) T / 2 + J T^3 / 12

With u0 = u1 = 0, between two reversals, T >= (12 L / J)^(1/3). If that needs more than the row's
acceleration A at both ends, v rises and falls with A, and changes between them with J:

    L <= (u0 + u1) T / 2 + A T^2 / 4 - (u1 - u0)^2 / (4 A) - A^3 / (3 J^2)

T2 is the fastest everywhere, so its time for a stretch is a bound, too. Stretches that do not
overlap add up; those are chosen that give most.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pulsewright.compiled import compiled, inner, making
from pulsewright.motion.path import Elements, Floats, Ints, Limits

REACH = 12  # slow places, from which a stretch may begin


class _Parts(NamedTuple):
    """Bounds of T2 on each part of the path."""

    size: Floats  # (n,); 0 of a rest
    cap: Floats  # (n, 2) of b at both ends
    link: Floats  # (n, r, 2) x'^2 there, over the change of x'^2 b at most; 0 at a reversal
    delay: Floats  # (n, r, 2) x' there, over the acceleration


class _Work(NamedTuple):
    """What an element's parts are found from."""

    terms: Floats  # (r, 5) factors of 1, s, s^2, cos and sin in x'
    slope: Floats  # (2, r) x' at both ends of a part
    bend: Floats  # (2, r) x'' there


@compiled(error_model="numpy")
def optimum(path: Elements, limits: Limits, parts: int) -> float:
    """Return T2, the least time for a path without a limit of jerk [s]."""
    _, span = _fastest(path, limits, _cut(path, parts))
    return float(path.dwell.sum() + span.sum())


@compiled(error_model="numpy")
def bound(path: Elements, limits: Limits, parts: int) -> float:
    """Return T3, a time that no plan with a limit of jerk comes below [s]."""
    cut = _cut(path, parts)
    b, span = _fastest(path, limits, cut)
    n, rows = span.size, limits.velocity.size
    place, speed = np.zeros((rows, n + 1)), np.zeros((rows, n + 1))  # along each row
    for e in range(path.length.size):
        first, last = cut[e], cut[e + 1]
        for c in range(first, last + 1):
            s, w = (c - first) * path.length[e] / (last - first), path.omega[e]
            cos, sin = math.cos(w * s), math.sin(w * s)
            for r in range(rows):
                place[r, c] = speed[r, c] = 0.0
                for axis in range(limits.begin[r], limits.end[r]):
                    p = path.poly[e, :, axis]
                    swing = path.cosine[e, axis] * cos + path.sine[e, axis] * sin
                    turn = w * (path.sine[e, axis] * cos - path.cosine[e, axis] * sin)
                    x = p[0] + (p[1] + (p[2] + p[3] * s) * s) * s + swing
                    v = p[1] + (2.0 * p[2] + 3.0 * p[3] * s) * s + turn
                    place[r, c] += limits.rows[r, axis] * x
                    speed[r, c] += limits.rows[r, axis] * v
                speed[r, c] = abs(speed[r, c]) * math.sqrt(b[c])
    best = np.zeros(n + 1)
    slow, count = np.zeros((rows, REACH), np.int64), np.ones(rows, np.int64)  # first the start
    for c in range(1, n + 1):
        best[c] = best[c - 1] + span[c - 1]
        for r in range(rows):
            here = speed[r, c]
            if here > speed[r, c - 1] or (c < n and here >= speed[r, c + 1]):
                continue  # not slow
            for i in range(min(count[r], REACH)):
                k = slow[r, i]
                way = abs(place[r, c] - place[r, k])
                time = _stroke(way, speed[r, k], here, limits.acceleration[r], limits.jerk[r])
                best[c] = max(best[c], best[k] + time)
            slow[r, count[r] % REACH] = c
            count[r] += 1
    return float(path.dwell.sum() + best[n])


@inner
def _stroke(way: float, u0: float, u1: float, acceleration: float, jerk: float) -> float:
    """Return the least time for a way along one row, with speeds of at most u0, u1 at its ends."""
    mean = 0.5 * (u0 + u1)
    time: float = (12.0 * way / jerk) ** (1 / 3)
    for _ in range(40):  # from above, as the way is a convex function of time
        over = (mean + jerk / 12.0 * time * time) * time - way
        if not over > 1e-12 * way:
            break
        time -= over / (mean + 0.25 * jerk * time * time)
    more = (u1 - u0) ** 2 / (4.0 * acceleration) + acceleration**3 / (3.0 * jerk * jerk)
    root = math.sqrt(mean * mean + acceleration * (way + more))
    steep = 2.0 * (root - mean) / acceleration
    if steep - abs(u1 - u0) / acceleration >= 2.0 * acceleration / jerk:
        time = max(time, steep)
    return time


@making
def _cut(path: Elements, parts: int) -> Ints:
    """Return the first part of each element, and how many parts there are.

    There are ``parts`` of a blend, as many of a quarter of a circle, and 2 of a line.
    """
    m = path.length.size
    cut = np.zeros(m + 1, np.int64)
    for e in range(m):
        quarters = abs(path.omega[e]) * path.length[e] / (0.5 * math.pi)
        count = max(2, math.ceil(quarters * parts))
        for axis in range(6):
            if path.poly[e, 2, axis] != 0.0 or path.poly[e, 3, axis] != 0.0:
                count = max(count, parts)
        cut[e + 1] = cut[e] + count
    return cut


@making
def _fastest(path: Elements, limits: Limits, cut: Ints) -> tuple[Floats, Floats]:
    """Return the squares of speeds of T2 at the ends of parts, and its time for each [s]."""
    n, rows = cut[-1], limits.velocity.size
    parts = _Parts(np.zeros(n), np.zeros((n, 2)), np.zeros((n, rows, 2)), np.zeros((n, rows, 2)))
    work = _Work(np.empty((rows, 5)), np.empty((2, rows)), np.empty((2, rows)))
    for e in range(path.length.size):
        if path.length[e] > 0.0:
            _find_bounds(path, limits, e, cut[e], cut[e + 1], parts, work)
    b, span = np.zeros(n + 1), np.zeros(n)
    for c in range(1, n):
        b[c] = min(parts.cap[c - 1, 1], parts.cap[c, 0])
    for e in range(path.length.size):
        if path.rest[e]:
            b[cut[e + 1]] = 0.0
    for c in range(n - 1, -1, -1):
        b[c] = min(b[c], _reached(parts, c, b[c + 1], 1))
    for c in range(n):
        if parts.size[c] > 0.0:
            ahead = _reached(parts, c, b[c], 0)
            b[c + 1] = min(b[c + 1], ahead)
            span[c] = _span(parts, c, b[c], b[c + 1], ahead)
    return b, span


@inner
def _find_bounds(
    path: Elements, limits: Limits, e: int, first: int, last: int, parts: _Parts, work: _Work
) -> None:
    """Fill in the parts of an element, from ``first`` up to ``last``."""
    cap, link, slope, bend = parts.cap, parts.link, work.slope, work.bend
    size, w = path.length[e] / (last - first), path.omega[e]
    for r in range(limits.velocity.size):
        for i in range(5):
            work.terms[r, i] = 0.0
        for axis in range(limits.begin[r], limits.end[r]):
            row = limits.rows[r, axis]
            for i in range(3):
                work.terms[r, i] += row * (i + 1) * path.poly[e, i + 1, axis]
            work.terms[r, 3] += row * w * path.sine[e, axis]
            work.terms[r, 4] -= row * w * path.cosine[e, axis]
    top = _top(path, limits, e, 0.0, work, 0)
    for c in range(first, last):
        i = (c - first) % 2  # slope and bend at the begin; the others are at the end
        parts.size[c], cap[c, 0] = size, top
        top = _top(path, limits, e, (c + 1 - first) * size, work, 1 - i)
        cap[c, 1] = top
        for r in range(limits.velocity.size):
            q0, q2 = slope[i, r], slope[1 - i, r]
            q1 = 0.5 * (q0 + q2) + 0.125 * size * (bend[i, r] - bend[1 - i, r])
            parts.delay[c, r, 0] = q0 * limits.per_acceleration[r]
            parts.delay[c, r, 1] = q2 * limits.per_acceleration[r]
            push = 2.0 * limits.acceleration[r] * size
            if q0 * q2 < 0.0:
                cap[c, 0] = min(cap[c, 0], push * _side(q0, q1, q2) / (q0 * q0))
                cap[c, 1] = min(cap[c, 1], push * _side(q2, q1, q0) / (q2 * q2))
            elif q0 != 0.0 or q2 != 0.0:
                share = 6.0 / (push * (abs(q0) + 4.0 * abs(q1) + abs(q2)))
                link[c, r, 0], link[c, r, 1] = q0 * q0 * share, q2 * q2 * share


@inner
def _top(path: Elements, limits: Limits, e: int, s: float, work: _Work, i: int) -> float:
    """Find slopes and bends of rows, ``[i]``; return the largest square of the speed there."""
    terms, slope, bend = work.terms, work.slope, work.bend
    w, cos, sin = path.omega[e], 1.0, 0.0
    if w != 0.0:
        cos, sin = math.cos(w * s), math.sin(w * s)
    top: float = path.feed[e] ** 2
    for r in range(limits.velocity.size):
        slope[i, r] = terms[r, 0] + (terms[r, 1] + terms[r, 2] * s) * s
        slope[i, r] += terms[r, 3] * cos + terms[r, 4] * sin
        bend[i, r] = terms[r, 1] + 2.0 * terms[r, 2] * s
        bend[i, r] += w * (terms[r, 4] * cos - terms[r, 3] * sin)
        if slope[i, r] ** 2 * top > limits.velocity[r] ** 2:
            top = (limits.velocity[r] / slope[i, r]) ** 2
        for k in range(r):
            cross = abs(bend[i, r] * slope[i, k] - bend[i, k] * slope[i, r])
            room = limits.acceleration[r] * abs(slope[i, k])
            room += limits.acceleration[k] * abs(slope[i, r])
            if cross * top > room:
                top = room / cross
    return top


@inner
def _side(q0: float, q1: float, q2: float) -> float:
    """Return the integral of |q| from 0 to its zero, for a parabola.

    At 0, 1/2 and 1 it is ``q0``, ``q1`` and ``q2``, of which the first and the last differ in sign.
    """
    curve = 2.0 * (q0 - 2.0 * q1 + q2)
    slope = q2 - q0 - curve
    root = math.sqrt(slope * slope - 4.0 * curve * q0)
    zero = 2.0 * q0 / (math.copysign(root, q0) - slope)
    return abs((q0 + (0.5 * slope + curve / 3.0 * zero) * zero) * zero)


@inner
def _reached(parts: _Parts, c: int, b: float, end: int) -> float:
    """Return the largest square of the speed at the other end of a part than ``end``."""
    most, per = 1.0, 0.0
    for r in range(parts.link.shape[1]):
        room = 1.0 + parts.link[c, r, end] * b
        if room * per < most * parts.link[c, r, 1 - end]:
            most, per = room, parts.link[c, r, 1 - end]
    return most / per


@inner
def _span(parts: _Parts, c: int, b0: float, b1: float, ahead: float) -> float:
    """Return the time for a part, at whose end b is ``b1``: ``ahead`` but for what follows."""
    v0, v1 = math.sqrt(b0), math.sqrt(b1)
    time = 0.0
    for r in range(parts.delay.shape[1]):  # as its velocity changes
        time = max(time, abs(parts.delay[c, r, 1] * v1 - parts.delay[c, r, 0] * v0))
    if b1 >= ahead:
        return time
    back = _reached(parts, c, b1, 1)
    if b0 >= back:
        return time
    size, cap0, cap1 = parts.size[c], parts.cap[c, 0], parts.cap[c, 1]
    up, down, climb = (ahead - b0) / size, (back - b1) / size, (cap1 - cap0) / size
    begin = (cap0 - b0) / (up - climb) if up > climb else size
    end = (cap1 - b1) / (down + climb) if down > -climb else size
    if begin + end > size:
        begin = (b1 - b0 + down * size) / (up + down)
        end = size - begin
    first, last = b0 + up * begin, b1 + down * end
    ramps = _ramp(begin, b0, first) + _ramp(end, last, b1)
    return max(time, ramps + _ramp(size - begin - end, first, last))


@inner
def _ramp(size: float, b0: float, b1: float) -> float:
    """Return the time for a way on which the square of the speed changes evenly [s]."""
    return 2.0 * size / (math.sqrt(b0) + math.sqrt(b1)) if size > 0.0 else 0.0
