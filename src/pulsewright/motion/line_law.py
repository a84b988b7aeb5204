"""The fastest law of a line: up to seven pieces of constant jerk from one of its ends to the other.

The limits are the same everywhere on it, so that law is known. Nodes are put where its jerk
changes.
"""

from __future__ import annotations

import math

from pulsewright.compiled import inner
from pulsewright.motion.cell_law import ROUNDING, Task, is_bent, keeps_limits
from pulsewright.motion.cells import STEP
from pulsewright.motion.path import Floats

LINE_SHARE = 0.999  # of the acceleration on lines
LEAST_PIECE = 1e-5  # of the longest one on a line: what is shorter is left out
LINE_JERK = 0.9999  # of the jerk on lines


@inner
def straighten(task: Task, b: Floats, a: Floats, first: int, last: int, soft: float) -> None:
    """Give lines between two nodes the fastest law from one of their ends to the other."""
    row, begin = task.cells.row, first
    while begin < last:
        end = begin + 1
        while end < last and row[end] == row[begin]:
            end += 1
        straight = end > begin + 1 and not is_bent(task.cells, begin)
        if straight and not _line(task, b, a, begin, end, soft):
            _line(task, b, a, begin, end, LINE_JERK)
        begin = end


@inner
def _line(task: Task, b: Floats, a: Floats, first: int, last: int, soft: float) -> bool:
    """Give the cells of a line the fastest law between two nodes, whose values stay.

    ``soft`` is the share of the jerk. Nothing changes, and the result is False, if there is none.
    """
    share, row = task.cells.share, task.cells.row[first]
    most, ramp = 1.0 / share[row, 0, 0], LINE_SHARE / share[row, 0, 1]
    jerk = soft / share[row, 0, 2]
    v0, a0, v1, a1 = math.sqrt(b[first]), a[first], math.sqrt(b[last]), -a[last]
    total = 0.0
    for c in range(first, last):
        total += task.cells.size[c]
    short = (1.0 - LINE_SHARE) * ramp / jerk  # so short a piece is none
    ramp0 = a0 if a0 > LINE_SHARE * ramp else ramp
    ramp1 = a1 if a1 > LINE_SHARE * ramp else ramp
    times = _fastest(v0, a0, v1, a1, total, most, ramp0, ramp1, jerk, short)
    if 0.0 < times[1] < short or 0.0 < times[5] < short:
        ramp0 = math.inf if times[1] < short else ramp0
        ramp1 = math.inf if times[5] < short else ramp1
        times = _fastest(v0, a0, v1, a1, total, most, ramp0, ramp1, jerk, short)
    longest, n, longer = 0, 0, 0
    for i in range(7):
        if times[i] > times[longest]:
            longest = i
    lasting, change = task.work[0], task.work[1]
    jerks = (jerk, 0.0, -jerk, 0.0, -jerk, 0.0, jerk)
    for i in range(7):
        if times[i] > LEAST_PIECE * times[longest]:
            lasting[n], change[n] = times[i], jerks[i]
            if i == longest:
                longer = n
            n += 1
    return n > 0 and _put(task, b, a, first, last, n, longer, STEP * ramp / jerk)


@inner
def _fastest(
    v0: float,
    a0: float,
    v1: float,
    a1: float,
    total: float,
    most: float,
    ramp0: float,
    ramp1: float,
    jerk: float,
    short: float,
) -> tuple[float, float, float, float, float, float, float]:
    """Return how long the jerk is positive, 0, negative, 0, negative, 0, positive; all 0: no way.

    The first three are from ``v0`` and ``a0`` to the largest speed, and the last three from there
    to ``v1`` and an acceleration of ``-a1``. On a short line the acceleration is never 0; then
    there is no largest speed inside, see `_onward`. A time of largest speed is not ``short``.
    """
    least0, least1 = v0 + 0.5 * a0 * abs(a0) / jerk, v1 + 0.5 * a1 * abs(a1) / jerk
    low, none = max(least0, least1), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if min(least0, least1) < 0.0 or low > most * (1.0 + ROUNDING):
        return none
    _, _, way = _faster(v0, a0, low, 0.0, ramp0, jerk)
    _, _, back = _faster(v1, a1, low, 0.0, ramp1, jerk)
    if way + back > total:
        if least0 < least1:
            rate, top, hold = _onward(v0, a0, v1, -a1, total, ramp0, jerk)
            times = (
                (top - a0) / jerk,
                hold,
                (top - rate) / jerk,
                0.0,
                0.0,
                0.0,
                -(a1 + rate) / jerk,
            )
        else:
            rate, top, hold = _onward(v1, a1, v0, -a0, total, ramp1, jerk)
            times = (
                -(a0 + rate) / jerk,
                0.0,
                0.0,
                0.0,
                (top - rate) / jerk,
                hold,
                (top - a1) / jerk,
            )
        return times if rate >= 0.0 else none
    peak, high, cruise = max(most, low), max(most, low), 0.0
    top0, hold0, top1, hold1 = 0.0, 0.0, 0.0, 0.0
    for trial in range(60):
        top0, hold0, way = _faster(v0, a0, peak, 0.0, ramp0, jerk)
        top1, hold1, back = _faster(v1, a1, peak, 0.0, ramp1, jerk)
        over = way + back - total
        if trial == 0 and over <= 0.0:
            cruise = -over / peak
            slower = peak - short * max(top0, top1)
            if cruise >= short or slower <= low:
                break
            peak = slower  # that takes longer, and leaves a longer time at it
            top0, hold0, way = _faster(v0, a0, peak, 0.0, ramp0, jerk)
            top1, hold1, back = _faster(v1, a1, peak, 0.0, ramp1, jerk)
            cruise = (total - way - back) / peak
            break
        if abs(over) <= 1e-14 * total:
            break
        if over > 0.0:
            high = peak
        else:
            low = peak
        peak -= over / (peak / top0 + peak / top1 + 0.5 * (top0 + top1) / jerk)
        if not low < peak < high:
            peak = 0.5 * (low + high)
    down, up = top0 / jerk, top1 / jerk
    if cruise == 0.0:
        down, up = down + up, 0.0
    return (top0 - a0) / jerk, hold0, down, cruise, up, hold1, (top1 - a1) / jerk


@inner
def _faster(
    v: float, a: float, speed: float, rate: float, ramp: float, jerk: float
) -> tuple[float, float, float]:
    """Return the largest acceleration on the way to a speed, how long it stays, and the distance.

    From ``v`` and ``a``; the acceleration is ``rate``, 0 or more, at the end.
    """
    per_jerk, sixth = 1.0 / jerk, jerk * (1 / 6)
    top = math.sqrt(max(jerk * (speed - v) + 0.5 * (a * a + rate * rate), 0.0))
    top, hold = max(top, a, rate), 0.0
    if top > ramp:
        top = ramp
        hold = max((speed - v - (top * top - 0.5 * (a * a + rate * rate)) * per_jerk) / top, 0.0)
    begin, end = (top - a) * per_jerk, (top - rate) * per_jerk
    rising = v + 0.5 * (a + top) * begin
    way = (v + (0.5 * a + sixth * begin) * begin) * begin
    way += (rising + 0.5 * top * hold) * hold
    return top, hold, way + (speed - (0.5 * rate + sixth * end) * end) * end


@inner
def _onward(
    v: float, a: float, speed: float, rate: float, total: float, ramp: float, jerk: float
) -> tuple[float, float, float]:
    """Return the least and the largest acceleration to a faster state, and how long that stays.

    From ``v`` and ``a`` the acceleration rises to the largest, then it falls to the least, and then
    it rises to ``rate``. A least one of 0 makes it too far. The least one is negative if there is
    no such way.
    """
    low, high = 0.0, rate
    least, top, hold = rate, 0.0, 0.0
    for trial in range(60):
        end = (rate - least) / jerk
        between = speed - 0.5 * (rate + least) * end
        top, hold, way = _faster(v, a, between, least, ramp, jerk)
        over = way + (speed - (0.5 * rate - jerk * (1 / 6) * end) * end) * end - total
        if trial == 0 and not over <= 0.0:
            return -1.0, 0.0, 0.0
        if abs(over) <= 1e-14 * total:
            break
        if over > 0.0:
            low = least
        else:
            high = least
        least = 0.5 * (low + high)
    return least, top, hold


@inner
def _part(total: float, pace: float, i: int, count: int) -> float:
    """Return part ``i`` of a time: about ``pace`` at its ends, and longer between."""
    middle, left, time = (count - 1) // 2, total, 0.0
    for k in range(min(i, count - 1 - i) + 1):
        left -= 2.0 * time
        time = min(pace, total / count) if k < middle else left / (1 + (count + 1) % 2)
        pace *= 3.0
    return time


@inner
def _put(
    task: Task,
    b: Floats,
    a: Floats,
    first: int,
    last: int,
    n: int,
    longest: int,
    pace: float,
) -> bool:
    """Lead ``n`` pieces of constant jerk over the cells of a line, if that keeps the limits.

    Their times and jerks are in ``task.work``. The longest piece gets more than one cell if cells
    are left, see `_part`; and some cells get two pieces, at the ends of the line, if there are too
    few.
    """
    size, split, lasting, change = task.cells.size, task.split, task.work[0], task.work[1]
    k = last - first
    pairs, extra = max(n - k, 0), max(k - n, 0)
    if 2 * pairs > n:
        return False
    lead, tail = pairs - pairs // 2, pairs // 2
    if longest < 2 * lead:
        meet = longest // 2
    elif longest >= n - 2 * tail:
        meet = k - 1 - (n - 1 - longest) // 2
    else:
        meet = longest - lead + extra
    kept = (task.work[2], task.work[3], task.work[4], task.work[5])
    total = 0.0
    for q in range(k):
        c = first + q
        kept[0][q], kept[1][q], kept[2][q], kept[3][q] = size[c], split[c], b[c], a[c]
        total += size[c]
    left = total
    for way in range(2):  # from both ends, to the cell with the longest piece
        at = first if way == 0 else last
        v, rate = math.sqrt(b[at]), a[at]
        for count in range(meet + 1 if way == 0 else k - meet):
            q = count if way == 0 else k - 1 - count
            c = first + q
            if q < lead:
                i, pieces = 2 * q, 2
            elif k - 1 - q < tail:
                i, pieces = n - 2 * (k - q), 2
            else:
                i, pieces = min(q, max(longest, q - extra)) if extra > 0 else q + lead, 1
            split[c] = 0.5
            if pieces == 2:
                split[c] = min(max(lasting[i] / (lasting[i] + lasting[i + 1]), 1e-3), 0.999)
            if q == meet:
                break
            length = 0.0
            for p in range(pieces):
                piece = i + p if way == 0 else i + pieces - 1 - p
                t, j = lasting[piece], change[piece]
                if extra > 0 and piece == longest:
                    t = _part(t, pace, q - longest, extra + 1)
                if way == 1:
                    t = -t
                length += (v + (0.5 * rate + j * (1 / 6) * t) * t) * t
                v += (rate + 0.5 * j * t) * t
                rate += j * t
            size[c] = abs(length)
            left -= size[c]
            at = c + 1 if way == 0 else c
            b[at], a[at] = v * v, rate
    size[first + meet] = left
    fine = left > 0.0
    for c in range(first, last):
        fine = fine and size[c] > 0.0 and keeps_limits(task.cells, b, a, c, split[c])
    for q in range(k):
        c = first + q
        if not fine:
            size[c], split[c] = kept[0][q], kept[1][q]
            if q > 0:
                b[c], a[c] = kept[2][q], kept[3][q]
        if q > 0:
            task.cells.offset[c] = task.cells.offset[c - 1] + size[c - 1]
    return fine
