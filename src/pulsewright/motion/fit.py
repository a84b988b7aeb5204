"""Speeds between two nodes: the second-order optimum, lowered where the jerk does not allow it."""

from __future__ import annotations

import math

from pulsewright.compiled import inner
from pulsewright.motion.cell_law import Cells, Task
from pulsewright.motion.line_law import LINE_JERK, straighten
from pulsewright.motion.path import Floats, Ints

COUPLED_SHARE = 0.5  # of what is left of the jerk, for changing speed where the path bends
RAMP_SHARE = 0.998  # of the acceleration
LEAST_SHARE = 0.1  # of the jerk for changing speed
SECOND = 0.1  # of squares of speeds, lost to the jerk: then a second plan is worth it
DOUBT = 0.7  # of what the jerk took from squares of speeds: it may take less in a second plan
JERK_SHARE = 0.9  # of the jerk; the two pieces of a cell differ a little
FLAT = 0.03  # of the change of acceleration that is possible on a cell: as good as none
TANGENT_SHARE = 0.25  # where a rounded peak ends: its part of a difference in slope


@inner
def best_of(task: Task, best: Floats, b: Floats, first: int, last: int) -> None:
    """Put the second-order optimum from rest to rest into ``best``."""
    for c in range(first, last):
        task.ease[c] = 1.0
    best[first], best[last] = b[first], b[last]
    _envelope(task, best, first, last)


@inner
def fit(task: Task, b: Floats, a: Floats, first: int, last: int) -> None:
    """Plan ``b`` and ``a`` between two nodes, whose values are given.

    Twice: what is left of acceleration and jerk depends on the speeds, which are those of the
    second-order optimum at first, and then such as the first plan has.
    """
    size, ramp, jerk = task.cells.size, task.ramp, task.jerk
    best, guess = task.work[4], task.work[5]
    begin, end = a[first], a[last]
    _envelope(task, b, first, last)
    for i in range(first, last + 1):
        best[i] = guess[i] = b[i]
    for _ in range(2):
        _leave(task, guess, first, last)
        for i in range(first, last + 1):
            b[i], a[i] = best[i], math.nan
        _climb(size, b, a, ramp, jerk, first, last, 1, max(begin, 0.0))
        _climb(size, b, a, ramp, jerk, last, first, -1, max(-end, 0.0))
        _round_peaks(size, b, a, jerk, first, last, task.node, task.work)
        whole, lost = 0.0, 0.0
        for i in range(first, last):
            whole += size[i]
            if b[i] < best[i]:
                lost += size[i] * (1.0 - b[i] / best[i])
        if lost < SECOND * whole:
            break
        for i in range(first, last + 1):
            guess[i] = b[i] + DOUBT * (best[i] - b[i])
    for c in range(first, last):
        task.split[c] = 0.5
    a[first], a[last] = begin, end
    for i in range(first + 1, last):
        if math.isnan(a[i]):
            a[i] = _slope(b, size, jerk, i)
        top = min(ramp[i - 1], ramp[i])
        if i == first + 1 and b[first] == 0.0:  # as constant jerk from rest has it
            top = min(top, b[i] / size[first] * (2 / 3))
        if i == last - 1 and b[last] == 0.0:
            top = min(top, b[i] / size[i] * (2 / 3))
        a[i] = min(max(a[i], -top), top)
    straighten(task, b, a, first, last, LINE_JERK)


@inner
def _envelope(task: Task, b: Floats, first: int, last: int) -> None:
    """Put the second-order optimum between two nodes into ``b``."""
    cells, ease = task.cells, task.ease
    for c in range(first + 1, last):
        b[c] = min(task.cap[c - 1] * ease[c - 1], task.cap[c] * ease[c])
    for c in range(last - 1, first, -1):
        if b[c] > b[c + 1]:
            b[c] = min(b[c], _reach(cells, c, ease[c], b[c + 1]))
    for c in range(first, last - 1):
        if b[c + 1] > b[c]:
            b[c + 1] = min(b[c + 1], _reach(cells, c, ease[c], b[c]))


@inner
def _leave(task: Task, b: Floats, first: int, last: int) -> None:
    """Find what acceleration and jerk the squares of speeds leave free on the cells."""
    cells, ramp, jerk, gain = task.cells, task.ramp, task.jerk, task.work[0]
    for c in range(first, last):
        row, top = cells.row[c], max(b[c], b[c + 1])
        free, j = _free(cells.share[row], cells.rows[row], top)
        ramp[c], jerk[c] = free * task.ease[c], j * task.soft[c]
        gain[c] = jerk[c] * cells.size[c] / math.sqrt(top)
    for c in range(first + 1, last):
        ramp[c] = min(ramp[c], ramp[c - 1] + gain[c])
    for c in range(last - 2, first - 1, -1):
        ramp[c] = min(ramp[c], ramp[c + 1] + gain[c])


@inner
def _reach(cells: Cells, c: int, ease: float, b: float) -> float:
    """Return the largest ``b`` at the other end of a cell, by the acceleration."""
    share, row = cells.share, cells.row[c]
    free, q = math.inf, 0.5 / cells.size[c]
    for r in range(cells.rows[row]):
        x = share[row, r, 1] * q
        if x > 0.0:
            free = min(free, (ease * RAMP_SHARE + x * b) / (share[row, r, 3] + x))
    return max(free, b)


@inner
def _free(share: Floats, rows: int, b: float) -> tuple[float, float]:
    """Return the path acceleration and jerk that a cell allows at the square of speed ``b``."""
    v, least = math.sqrt(b), 0.0
    a, j = math.inf, math.inf
    for r in range(rows):
        if share[r, 1] > 0.0:
            a = min(a, (RAMP_SHARE - share[r, 3] * b) / share[r, 1])
        if share[r, 4] > 0.0:
            a = min(a, COUPLED_SHARE * (1.0 - share[r, 5] * b * v) / (share[r, 4] * v))
    for r in range(rows):
        if share[r, 2] > 0.0:
            used = share[r, 5] * b * v + share[r, 4] * v * a
            j = min(j, (JERK_SHARE - used) / share[r, 2])
            least = max(least, share[r, 2])
    return max(a, 0.0), max(j, LEAST_SHARE / least if least > 0.0 else 0.0)


@inner
def _gain(v: float, a: float, top: float, jerk: float, size: float) -> tuple[float, float]:
    """Return ``b`` and ``a`` after ``size``, as the jerk allows but with a at most ``top``."""
    time = size / v if v > 0.0 else math.inf
    if a > 0.0:
        time = min(time, math.sqrt(2.0 * size / a))
    if v * v * jerk < 36.0 * a * a * a or v * v * v < jerk * size * size:
        time = min(time, (6.0 * size / jerk) ** (1 / 3))
    for _ in range(3):
        rate = v + (a + 0.5 * jerk * time) * time
        over = (v + (0.5 * a + jerk * (1 / 6) * time) * time) * time - size
        time -= over / rate
    after = a + jerk * time
    if after > top:
        time = max(top - a, 0.0) / jerk
        way = (v + (0.5 * a + jerk * (1 / 6) * time) * time) * time
        v += 0.5 * (a + top) * time
        return v * v + 2.0 * top * (size - way), top
    speed = v + 0.5 * (a + after) * time
    return speed * speed, after


@inner
def _climb(
    size: Floats,
    b: Floats,
    a: Floats,
    ramp: Floats,
    jerk: Floats,
    first: int,
    last: int,
    way: int,
    rise: float,
) -> None:
    """Lower ``b`` such that the slope grows no faster than the jerk allows, away from ``first``.

    ``rise`` is the slope at ``first``. Where ``b`` keeps its value, ``a`` does; elsewhere it
    becomes that of the law.
    """  # fmt: skip
    i = first
    while i != last:
        c = i if way > 0 else i - 1
        k = i + way
        rise = min(rise, ramp[c])
        top = ramp[c] if k == last else min(ramp[c], ramp[c + way])
        if b[k] <= b[i]:  # that is less than any slope asks
            rise = 0.0
            i = k
            continue
        after, slope = _gain(math.sqrt(b[i]), rise, top, jerk[c], size[c])
        if k != last and after < b[k]:
            b[k], a[k], rise = after, way * slope, slope
        else:
            rise = max(0.0, min(slope, (b[k] - b[i]) / (2.0 * size[c])))
        i = k


@inner
def _round_peaks(
    size: Floats,
    b: Floats,
    a: Floats,
    jerk: Floats,
    first: int,
    last: int,
    node: Ints,
    work: Floats,
) -> None:
    """Lower ``b`` such that the slope falls no faster than the jerk allows.

    With ``da/ds >= -u`` given, these are convex functions, less one with the curvature -2 u
    everywhere; so the largest one is a lower convex hull.
    """
    span, moment, weight, bend = work[0], work[1], work[2], work[3]
    n = 0
    node[0] = first
    for k in range(first + 1, last + 1):
        c = k - 1
        fast, slow = max(b[c], b[k]), min(b[c], b[k])
        from_rest = 1.5 if slow == 0.0 else 1.0  # then the acceleration falls faster at first
        bend[c] = u = from_rest * jerk[c] / math.sqrt(max(fast, 1e-12))
        # from the node before: distance, integral of u, and integral of that
        x, w, q = size[c], u * size[c], 0.5 * u * size[c] * size[c]
        while n > 0:
            i, j = node[n - 1], node[n]
            before = (b[j] - b[i] + 2.0 * moment[n]) / (2.0 * span[n]) - weight[n]
            after = (b[k] - b[j] + 2.0 * q) / (2.0 * x)
            if before < after:
                break
            q += moment[n] + weight[n] * x
            w += weight[n]
            x += span[n]
            n -= 1
        n += 1
        node[n], span[n], moment[n], weight[n] = k, x, q, w
    for p in range(1, n + 1):
        i, k = node[p - 1], node[p]
        if k == i + 1:
            continue
        rate = (b[k] - b[i] + 2.0 * moment[p]) / (2.0 * span[p])
        if i > first and not math.isnan(a[i]):
            a[i] += TANGENT_SHARE * (rate - a[i])
        here = b[i]
        for j in range(i + 1, k):
            c = j - 1
            u = bend[c]
            here += (2.0 * rate - u * size[c]) * size[c]
            rate -= u * size[c]
            if here < b[j]:
                b[j], a[j] = max(here, 0.0), rate
        rate -= bend[k - 1] * size[k - 1]
        if k < last and not math.isnan(a[k]):
            a[k] += TANGENT_SHARE * (rate - a[k])


@inner
def _slope(b: Floats, size: Floats, jerk: Floats, i: int) -> float:
    """Return ``a`` at a node between cells where ``b`` is at its limit."""
    x, y = size[i - 1], size[i]
    left, right = 0.5 * (b[i] - b[i - 1]) / x, 0.5 * (b[i + 1] - b[i]) / y
    most = FLAT / math.sqrt(b[i]) if b[i] > 0.0 else 0.0
    flat = abs(left) <= most * jerk[i - 1] * x or abs(right) <= most * jerk[i] * y
    if flat or left < 0.0 < right:  # the lowest place: whatever climbs from it, begins so
        return 0.0
    mean: float = (left * y + right * x) / (x + y)
    time = 0.5 / math.sqrt(b[i]) if b[i] > 0.0 else 0.0
    before, after = time * jerk[i - 1] * x, time * jerk[i] * y
    for short in range(2):  # the shorter cell has the last word
        if (before < after) == (short == 1):
            mean = min(max(mean, left - before), left + before)
        else:
            mean = min(max(mean, right - after), right + after)
    return mean
