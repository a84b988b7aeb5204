"""Cells of a path: where its speed may change, and the largest derivatives of position there.

They are groups of short elements, or parts of long ones; see `cell_law.Cells`.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from pulsewright.compiled import compiled, inlined, inner
from pulsewright.motion.cell_law import Cells, top_square
from pulsewright.motion.path import Elements, Flags, Floats, Ints, Limits, component, peaks

GROUP = 0.25  # of the time in which acceleration builds up: elements passed in it make one cell
SPREAD = 6.0  # of it, from where speed changes without a limit of jerk to where with one
STEP = 0.4  # of that time, in the first cell of a long element
GROWTH = 1.6  # of cells, at least, from where the acceleration changes
WIDEST = 0.2  # of a cell on an arc [rad]
PARTS = 4096  # cells of one element at most

_Arc: TypeAlias = tuple[float, float, float, float]


class Pace(NamedTuple):
    """Rough second-order speeds along the path."""

    cap: Floats  # (m,) largest square of the speed on each element
    ramp: Floats  # (m,) path acceleration there
    speed: Floats  # (m + 1,) square of the speed at the ends of elements
    busy: Floats  # (m,) distance to elements where the speed changes; -1 for these
    sizes: Floats  # (m, r, 3) largest derivatives of position along the rows of limits
    bent: Flags  # (m,) whether the element is not a line


@inlined
def _sizes(
    path: Elements, limits: Limits, e: int, r: int, begin: float, end: float, arc: _Arc
) -> tuple[float, float, float]:
    """Return the largest derivatives of position along a row, on a part of element ``e``.

    ``arc`` are cosine and sine of the angles there, see `_arc`.
    """
    w, h = path.omega[e], end - begin
    p1, p2 = component(limits, r, path.poly[e, 1]), component(limits, r, path.poly[e, 2])
    p3 = component(limits, r, path.poly[e, 3])
    c, s = component(limits, r, path.cosine[e]), component(limits, r, path.sine[e])
    third = abs(6.0 * p3)
    bend = 2.0 * p2 + 6.0 * p3 * begin
    second = max(abs(bend), abs(bend + 6.0 * p3 * h))
    e0 = p1 + (2.0 * p2 + 3.0 * p3 * begin) * begin
    e1 = p1 + (2.0 * p2 + 3.0 * p3 * end) * end
    first = max(abs(e0), abs(e1))
    if p3 != 0.0:
        first = max(first, abs(e0 + 0.5 * bend * h))
    if c != 0.0 or s != 0.0:
        along, inward = peaks(c, s, arc[0], arc[1], arc[2], arc[3], w * h)
        first += w * along
        second += w * w * inward
        third += w * w * w * along
    return first, second, third


@inlined
def _arc(path: Elements, e: int, begin: float, end: float) -> _Arc:
    """Return cosine and sine of the angles where a part of element ``e`` begins and ends."""
    w = path.omega[e]
    if w == 0.0:
        return 1.0, 0.0, 1.0, 0.0
    c0, s0 = 1.0, 0.0
    if begin > 0.0:
        c0, s0 = math.cos(w * begin), math.sin(w * begin)
    return c0, s0, math.cos(w * end), math.sin(w * end)


@inlined
def _bound(path: Elements, limits: Limits, e: int, sizes: Floats, share: Floats, p: int) -> None:
    """Raise shares, ``share[p]``, to those of the part of element ``e`` that has ``sizes[e]``."""
    share[p, 0, 0] = max(share[p, 0, 0], 1.0 / path.feed[e])
    for r in range(limits.velocity.size):
        first, second, third = sizes[e, r, 0], sizes[e, r, 1], sizes[e, r, 2]
        per_acceleration, per_jerk = limits.per_acceleration[r], limits.per_jerk[r]
        share[p, 0, 0] = max(share[p, 0, 0], first * limits.per_velocity[r])
        share[p, r, 1] = max(share[p, r, 1], first * per_acceleration)
        share[p, r, 2] = max(share[p, r, 2], first * per_jerk)
        share[p, r, 3] = max(share[p, r, 3], second * per_acceleration)
        share[p, r, 4] = max(share[p, r, 4], 3.0 * second * per_jerk)
        share[p, r, 5] = max(share[p, r, 5], third * per_jerk)


@inner
def _graded(
    begin: float,
    end: float,
    step: float,
    square: float,
    slope: float,
    pace: float,
    widest: float,
    back: bool,
    out: Floats,
    n: int,
) -> int:
    """Put where to cut begin..end after ``out[n]``; return the new n.

    Cells grow from the start, or with ``back`` from the end: from ``step`` on, by `GROWTH`, or with
    the speed if that grows faster; its square is ``square`` + ``slope`` times the distance.
    """
    first, size, x = n, end - begin, 0.0
    step = min(step, widest)
    while size - x > 1.5 * step and n < first + PARTS // 8:
        x += step
        n += 1
        out[n] = end - x if back else begin + x
        step = min(max(GROWTH * step, pace * math.sqrt(square + slope * x)), widest)
    if back:
        for i in range((n - first) // 2):
            out[first + 1 + i], out[n - i] = out[n - i], out[first + 1 + i]
    n += 1
    out[n] = end
    return n


@inner
def _cut(
    total: float,
    from_: float,
    to: float,
    peak: float,
    ramp: float,
    delay: float,
    widest: float,
    flat: bool,
    straight: bool,
    out: Floats,
) -> int:
    """Put where to cut an element into ``out``, from 0 to ``total``; return how many cells.

    Squares of its speed without a limit of jerk are ``from_`` and ``to`` at the ends and ``peak``
    between, which is kept there if ``flat``. Where it is ``straight``, few cells do, see
    `line_law`.
    """
    pace = STEP * delay
    least = 0.01 * delay * delay * ramp  # from rest, 0.4 of the delay
    begin, finish = max(pace * math.sqrt(from_), least), max(pace * math.sqrt(to), least)
    inside, rise = pace * math.sqrt(peak), 2.0 * ramp
    up, down = (peak - from_) / rise, total - (peak - to) / rise
    n, x, y = 0, 0.0, total
    out[0] = 0.0
    if straight and total > 8.0 * (begin + finish):
        first, final = max(up, 2.0 * begin), max(total - down, 2.0 * finish)
        if first + final < total:
            out[1], out[2], out[3] = 0.5 * first, first, total - final
            out[4], out[5] = total - 0.5 * final, total
            return 5
        first *= total / (first + final)
        out[1], out[2], out[3], out[4] = 0.5 * first, first, 0.5 * (first + total), total
        return 4
    if up > begin and total - up > 0.5 * finish:
        n = _graded(0.0, 0.5 * up, begin, from_, rise, pace, widest, False, out, n)
        n = _graded(0.5 * up, up, inside, peak, 0.0, pace, widest, True, out, n)
        x, begin, from_ = up, inside, peak
    falls = total - down > 0.5 * finish and (x > 0.0 or down > 0.5 * inside)
    if falls:
        y = down if down - x > 0.5 * inside else x
    step, square = (inside, peak) if falls else (finish, to)
    wide = SPREAD * delay * math.sqrt(peak)
    if y == x:
        pass
    elif flat and y - x > 3.0 * wide:
        n = _graded(x, x + wide, begin, from_, 0.0, pace, widest, False, out, n)
        n += 1
        out[n] = y - wide
        n = _graded(y - wide, y, step, square, 0.0, pace, widest, True, out, n)
    else:
        grow = rise if from_ < peak else 0.0
        fall = rise if square < peak else 0.0
        middle = 0.5 * (x + y)
        if y - x > 1.2 * (begin + step):
            n = _graded(x, middle, begin, from_, grow, pace, widest, False, out, n)
            n = _graded(middle, y, step, square, fall, pace, widest, True, out, n)
        else:
            n += 1
            out[n] = y
    if falls:
        middle = 0.5 * (y + total)
        n = _graded(y, middle, inside, peak, 0.0, pace, widest, False, out, n)
        n = _graded(middle, total, finish, to, rise, pace, widest, True, out, n)
    return n


@compiled(error_model="numpy")
def cells(path: Elements, limits: Limits, square: float) -> Cells:
    """Cut the path into cells: fine where the speed may change, coarse elsewhere.

    ``square`` is that of the speed at the start.
    """
    m, rows = path.length.size, limits.velocity.size
    sizes, bent = np.empty((m, rows, 3)), np.empty(m, np.bool_)
    pace = Pace(np.empty(m), np.empty(m), np.empty(m + 1), np.empty(m), sizes, bent)
    delay = _rough(path, limits, square, pace)
    size = m + 2 * PARTS
    element, offset, length = np.empty(size, np.int64), np.empty(size), np.empty(size)
    cut = np.empty(PARTS)
    n, used, e = _group(path, pace, delay, cut, element, offset, length, 0, 0, 0)
    while e < m:
        size *= 2
        old = element, offset, length
        element, offset, length = np.empty(size, np.int64), np.empty(size), np.empty(size)
        for c in range(n):  # a loop, as assigning slices takes seconds to compile
            element[c], offset[c], length[c] = old[0][c], old[1][c], old[2][c]
        n, used, e = _group(path, pace, delay, cut, element, offset, length, n, used, e)
    rest, row = np.empty(n, np.bool_), np.empty(n, np.int64)
    share, matter = np.empty((used, rows, 6)), np.empty(used, np.int64)
    found = Cells(element[:n], offset[:n], length[:n], rest, row, share, matter)
    _finish(path, pace, limits, found)
    return found


@inner
def _rough(path: Elements, limits: Limits, square: float, pace: Pace) -> float:
    """Find the second-order speeds, roughly; return how long acceleration takes to build up."""
    m, cap, ramp, speed, busy = path.length.size, pace.cap, pace.ramp, pace.speed, pace.busy
    sizes, delay = pace.sizes, 0.0
    for r in range(limits.velocity.size):
        delay = max(delay, limits.acceleration[r] / limits.jerk[r])
    for e in range(m):
        end = path.length[e]
        cap[e], ramp[e], speed[e] = 0.0, 0.0, square if e == 0 else 0.0
        pace.bent[e] = _is_bent(path, e)
        if end == 0.0:
            continue
        arc = _arc(path, e, 0.0, end)
        slow, steep, bend, twist = 1.0 / path.feed[e], 0.0, 0.0, 0.0
        for r in range(limits.velocity.size):
            first, second, third = _sizes(path, limits, e, r, 0.0, end, arc)
            sizes[e, r, 0], sizes[e, r, 1], sizes[e, r, 2] = first, second, third
            slow = max(slow, first * limits.per_velocity[r])
            steep = max(steep, first * limits.per_acceleration[r])
            bend = max(bend, second * limits.per_acceleration[r])
            twist = max(twist, third * limits.per_jerk[r])
        cap[e], ramp[e] = top_square(slow, bend, twist), 1.0 / steep
        if e > 0 and not path.rest[e - 1]:
            speed[e] = min(
                cap[e - 1], cap[e], speed[e - 1] + 2.0 * ramp[e - 1] * path.length[e - 1]
            )
    speed[m] = 0.0
    near = math.inf
    for e in range(m - 1, -1, -1):
        speed[e] = min(speed[e], speed[e + 1] + 2.0 * ramp[e] * path.length[e])
        busy[e] = near
        near += path.length[e]
        most = min(speed[e], speed[e + 1], path.feed[e] * path.feed[e])
        if most < 0.999 * cap[e] or cap[e] == 0.0:
            busy[e], near = -1.0, 0.0
    near = math.inf
    for e in range(m):
        if busy[e] < 0.0:
            near = 0.0
        else:
            busy[e] = min(busy[e], near)
            near += path.length[e]
    return delay


@inner
def _group(
    path: Elements,
    pace: Pace,
    delay: float,
    cut: Floats,
    element: Ints,
    offset: Floats,
    length: Floats,
    n: int,
    used: int,
    e: int,
) -> tuple[int, int, int]:
    """Choose cells from element ``e`` on, after ``n`` others, as long as there is room for them.

    Each is one of several elements, or one of a few of one element. The new ``n`` is returned, how
    many rows of shares they need, and the next element.
    """
    m, cap, ramp, speed, busy = path.length.size, pace.cap, pace.ramp, pace.speed, pace.busy
    quick = GROUP * delay
    while e < m and n + PARTS <= element.size:
        total, top, low = path.length[e], cap[e], min(speed[e], speed[e + 1])
        starts, ends, straight = e == 0 or path.rest[e - 1], path.rest[e], not pace.bent[e]
        steady = busy[e] >= SPREAD * delay * path.feed[e]  # at the programmed feed
        count, parts = 1, 1
        while total > 0.0 and e + count < m and not starts and not path.rest[e + count - 1]:
            j = e + count
            if path.rest[j]:  # the first and the last element of a run stay by themselves
                break
            if steady and busy[j] >= SPREAD * delay * path.feed[j] and path.feed[j] == path.feed[e]:
                total += path.length[j]
                count += 1
                continue
            slow, fast = min(low, speed[j + 1]), min(top, cap[j])
            if total + path.length[j] > quick * math.sqrt(max(slow, 0.05 * fast)):
                break
            low, top = slow, fast
            total += path.length[j]
            count += 1
        cut[0], cut[1] = 0.0, total
        easy = straight or busy[e] < SPREAD * delay * math.sqrt(top)
        if total > 0.0 and count == 1 and easy:
            widest = WIDEST / path.omega[e] if path.omega[e] > 0.0 else math.inf
            peak = min(0.5 * (speed[e] + speed[e + 1]) + ramp[e] * total, top)
            parts = _cut(
                *(total, speed[e], speed[e + 1], peak, ramp[e], delay, widest, peak == top),
                straight,
                cut,
            )
            if parts == 1 and starts and ends:
                parts, cut[1], cut[2] = 2, 0.5 * total, total
        for i in range(parts):
            element[n], offset[n], length[n] = e, cut[i], cut[i + 1] - cut[i]
            n += 1
        used += 1 if straight else parts
        e += count
    return n, used, e


@inner
def _finish(path: Elements, pace: Pace, limits: Limits, cells: Cells) -> None:
    """Find where cells end at rest, their shares, and how many rows of these matter."""
    n, p, bent, sizes = cells.size.size, -1, pace.bent, pace.sizes
    for c in range(n):
        e = cells.element[c]
        after = cells.element[c + 1] if c + 1 < n else path.length.size
        cells.rest[c] = path.length[e] == 0.0 or (after > e and path.rest[after - 1])
        if c > 0 and cells.element[c - 1] == e and not bent[e]:
            cells.row[c] = p
            continue
        p += 1
        cells.row[c] = p
        for r in range(cells.share.shape[1]):
            for k in range(6):
                cells.share[p, r, k] = 0.0
        if bent[e] and cells.size[c] < path.length[e]:  # then all its cells are parts
            begin, end = cells.offset[c], cells.offset[c] + cells.size[c]
            arc = _arc(path, e, begin, end)
            for r in range(limits.velocity.size):
                sizes[e, r, 0], sizes[e, r, 1], sizes[e, r, 2] = _sizes(
                    path, limits, e, r, begin, end, arc
                )
        for j in range(e, max(after, e + 1)):
            if path.length[j] > 0.0:
                _bound(path, limits, j, sizes, cells.share, p)
        cells.rows[p] = _compacted(cells.share, p)


@inlined
def _is_bent(path: Elements, e: int) -> bool:
    """Return whether element ``e`` is not a line."""
    bent: bool = path.omega[e] != 0.0
    for axis in range(6):
        bent |= path.poly[e, 2, axis] != 0.0 or path.poly[e, 3, axis] != 0.0
    return bent


@inlined
def _compacted(share: Floats, p: int) -> int:
    """Put the rows of ``share[p]`` that matter first; return how many: one on a straight path."""
    rows: int = share.shape[1]
    n = 0
    for r in range(rows):
        if share[p, r, 3] > 0.0 or share[p, r, 5] > 0.0:
            n = rows
    if n == 0:
        for r in range(1, rows):
            share[p, 0, 1] = max(share[p, 0, 1], share[p, r, 1])
            share[p, 0, 2] = max(share[p, 0, 2], share[p, r, 2])
        return 1
    n = 0
    for r in range(rows):
        if share[p, r, 1] > 0.0:
            for k in range(1, 6):
                share[p, n, k] = share[p, r, k]
            n += 1
    return n
