"""Compiled yardstick of planned times: the second-order optimum of a blended path.

Velocity, feed and acceleration are limited, jerk is not. Each element is cut into equal parts, and
bounds of a part hold for all of it.
"""

from __future__ import annotations

import math

import numpy as np

from pulsewright.compiled import compiled
from pulsewright.motion.path import Elements, Floats, Limits
from pulsewright.motion.plan_kernels import _bound


@compiled(error_model="numpy")
def optimum(path: Elements, limits: Limits, parts: int) -> float:
    """Return the least time for a path [s], from ``parts`` of each element."""
    m, rows = path.length.size, limits.velocity.size
    share = np.zeros((m * parts, rows, 6))
    cap, b = np.zeros(m * parts), np.zeros(m * parts + 1)  # squares of speeds
    time = 0.0
    for e in range(m):
        time += path.dwell[e]
        size = path.length[e] / parts
        for c in range(e * parts, (e + 1) * parts):
            if size == 0.0:
                continue
            begin = (c - e * parts) * size
            _bound(path, limits, e, begin, begin + size, share[c])
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
            time += (2.0 * v - v0 - v1) / a + max(along, 0.0) / v
        else:
            time += 2.0 * size / (v0 + v1)
    return time


@compiled(error_model="numpy")
def _reached(share: Floats, size: float, b: float) -> float:
    """Return the largest square of the speed at the other end of a part."""
    most = math.inf
    for r in range(share.shape[0]):
        x = share[r, 1] * 0.5
        if x > 0.0:
            most = min(most, (size + x * b) / (share[r, 3] * size + x))
    return max(most, b)
