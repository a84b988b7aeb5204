"""Compiled yardsticks of planned times: what no plan of a blended path can be faster than.

T2, the second-order optimum: velocity, feed and acceleration are limited, jerk is not. Each element
is cut into equal parts, and bounds of a part hold for all of it.

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

import numpy as np

from pulsewright.compiled import compiled
from pulsewright.motion.path import Elements, Floats, Limits
from pulsewright.motion.plan_kernels import _bound

REACH = 12  # slow places, from which a stretch may begin


@compiled(error_model="numpy")
def optimum(path: Elements, limits: Limits, parts: int) -> float:
    """Return T2, the least time for a path without a limit of jerk [s]."""
    _, span = _fastest(path, limits, parts)
    return float(path.dwell.sum() + span.sum())


@compiled(error_model="numpy")
def bound(path: Elements, limits: Limits, parts: int) -> float:
    """Return T3, a time that no plan with a limit of jerk comes below [s]."""
    b, span = _fastest(path, limits, parts)
    n, rows = span.size, limits.velocity.size
    place, speed = np.zeros((rows, n + 1)), np.zeros((rows, n + 1))  # along each row
    for c in range(n + 1):
        e = min(c // parts, path.length.size - 1)
        s, w = (c - e * parts) * path.length[e] / parts, path.omega[e]
        cos, sin = math.cos(w * s), math.sin(w * s)
        for axis in range(6):
            p = path.poly[e, :, axis]
            swing = path.cosine[e, axis] * cos + path.sine[e, axis] * sin
            turn = w * (path.sine[e, axis] * cos - path.cosine[e, axis] * sin)
            x = p[0] + (p[1] + (p[2] + p[3] * s) * s) * s + swing
            v = p[1] + (2.0 * p[2] + 3.0 * p[3] * s) * s + turn
            for r in range(rows):
                place[r, c] += limits.rows[r, axis] * x
                speed[r, c] += limits.rows[r, axis] * v
    best = np.zeros(n + 1)
    slow, count = np.zeros((rows, REACH), np.int64), np.zeros(rows, np.int64)
    for r in range(rows):
        for c in range(n + 1):
            speed[r, c] = abs(speed[r, c]) * math.sqrt(b[c])
        count[r] = 1  # the start
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


@compiled(error_model="numpy")
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


@compiled(error_model="numpy")
def _fastest(path: Elements, limits: Limits, parts: int) -> tuple[Floats, Floats]:
    """Return the squares of speeds of T2 at the ends of parts, and its time for each [s]."""
    m, rows = path.length.size, limits.velocity.size
    share = np.zeros((m * parts, rows, 6))
    cap, b = np.zeros(m * parts), np.zeros(m * parts + 1)  # squares of speeds
    span = np.zeros(m * parts)
    for e in range(m):
        size = path.length[e] / parts
        for c in range(e * parts, (e + 1) * parts):
            if size == 0.0:
                continue
            begin = (c - e * parts) * size
            _bound(path, limits, e, begin, begin + size, share, c)
            cap[c] = path.feed[e] ** 2
            for r in range(rows):
                if share[c, r, 0] > 0.0:
                    cap[c] = min(cap[c], share[c, r, 0] ** -2)
                if share[c, r, 3] > 0.0:
                    cap[c] = min(cap[c], 1.0 / share[c, r, 3])
    for c in range(1, m * parts):
        b[c] = min(cap[c - 1], cap[c])
        if c % parts == 0 and path.rest[c // parts - 1]:
            b[c] = 0.0
    for c in range(m * parts - 1, -1, -1):
        b[c] = min(b[c], _reached(share[c], path.length[c // parts] / parts, b[c + 1]))
    for c in range(m * parts):
        size = path.length[c // parts] / parts
        if size == 0.0:
            continue
        b[c + 1] = min(b[c + 1], _reached(share[c], size, b[c]))
        top, a = max(b[c], b[c + 1]), math.inf
        for r in range(rows):
            if share[c, r, 1] > 0.0:
                a = min(a, max(1.0 - share[c, r, 3] * top, 0.0) / share[c, r, 1])
        v0, v1 = math.sqrt(b[c]), math.sqrt(b[c + 1])
        peak = min(cap[c], 0.5 * (b[c] + b[c + 1]) + a * size)
        if a > 0.0 and peak >= top:  # up, along and down
            v = math.sqrt(peak)
            along = size - (peak - 0.5 * (b[c] + b[c + 1])) / a
            span[c] = (2.0 * v - v0 - v1) / a + max(along, 0.0) / v
        else:
            span[c] = 2.0 * size / (v0 + v1)
    return b, span


@compiled(error_model="numpy")
def _reached(share: Floats, size: float, b: float) -> float:
    """Return the largest square of the speed at the other end of a part."""
    most = math.inf
    for r in range(share.shape[0]):
        x = share[r, 1] * 0.5
        if x > 0.0:
            most = min(most, (size + x * b) / (share[r, 3] * size + x))
    return max(most, b)
