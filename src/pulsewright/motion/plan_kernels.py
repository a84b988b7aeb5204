"""Compiled time law of the planner: jerk-limited speeds along the elements of a path.

``b`` is the square of the path speed v, ``a`` the path acceleration: ``db/ds = 2 a``. The path is
cut into *cells*: groups of short elements, or parts of long ones. On a cell, the largest magnitudes
of the derivatives of position along each limited row are known, and limits hold if they hold with
all of them at once::

    first v <= velocity
    second b + first |a| <= acceleration
    third v^3 + 3 second v |a| + first |j| <= jerk

With each inequality over its limit, six coefficients remain, the *shares* of a cell: of ``v``, of
``|a|``, of ``|j|``, of ``b``, of ``v |a|``, of ``v^3``.

What is chosen are ``b`` and ``a`` at the *nodes* between cells. Whatever they are, a time law with
two pieces of constant jerk on every cell has exactly these values at its ends; so the acceleration
is continuous by construction, and limits are checked on the law itself.

On a line the limits are the same everywhere. So the fastest law from one of its ends to the other
is known, of seven pieces at most, and nodes are put where its jerk changes.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import compiled, inlined, inner
from pulsewright.motion.cell_law import (
    ROUNDING,
    Cells,
    is_bent,
    keeps_limits,
    limits_used,
    two_pieces,
)
from pulsewright.motion.path import Elements, Flags, Floats, Ints, Limits, _peaks, component
from pulsewright.motion.refine import WINDOW, Window, refine, window_of

BEND_SHARE = 0.97  # of the acceleration, for bending at constant speed
TWIST_SHARE = 0.9  # of the jerk, for bending at constant speed
COUPLED_SHARE = 0.5  # of what is left of the jerk, for changing speed where the path bends
RAMP_SHARE = 0.998  # of the acceleration
LEAST_SHARE = 0.1  # of the jerk for changing speed
SECOND = 0.1  # of squares of speeds, lost to the jerk: then a second plan is worth it
DOUBT = 0.7  # of what the jerk took from squares of speeds: it may take less in a second plan
JERK_SHARE = 0.9  # of the jerk; the two pieces of a cell differ a little
GROUP = 0.25  # of the time in which acceleration builds up: elements passed in it make one cell
SPREAD = 6.0  # of it, from where speed changes without a limit of jerk to where with one
STEP = 0.4  # of that time, in the first cell of a long element
GROWTH = 1.6  # of cells, at least, from where the acceleration changes
WIDEST = 0.2  # of a cell on an arc [rad]
SHORT = 7  # cells from rest to rest: better tighten limits at first
GENTLE = 3  # rounds of that
PATIENCE = 9  # rounds before the speed is made steady there
REPAIRS = 24  # rounds of tightening the limits where the law breaks them
FLAT = 0.03  # of the change of acceleration that is possible on a cell: as good as none
TANGENT_SHARE = 0.25  # where a rounded peak ends: its part of a difference in slope
SPLITS = (0.35, 0.65, 0.2, 0.8)  # where the two pieces of a cell may meet, besides its middle
BRIDGES = (1, 2, 3, 5)  # cells on both sides of a broken one that change with it
LINE_SHARE = 0.999  # of the acceleration on lines
LEAST_PIECE = 1e-5  # of the longest one on a line: what is shorter is left out
LINE_JERK = 0.9999  # of the jerk on lines
LINE_SOFT = 0.8  # the same while speeds are raised
MATTERS = 0.005  # of a run's time, lost to the second-order optimum
WORTH = 0.03  # of a window's time, lost the same way
SMALLEST = 16  # cells, where larger windows find nothing better
FULL = 1.0 - 1e-6  # of the square of the largest speed: such a state stays
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
        along, inward = _peaks(c, s, arc[0], arc[1], arc[2], arc[3], w * h)
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
def _cap(share: Floats, rows: int) -> float:
    """Return the largest square of the speed on a cell."""
    bend, twist = 0.0, 0.0
    for r in range(rows):
        bend, twist = max(bend, share[r, 3]), max(twist, share[r, 5])
    return _top(share[0, 0], bend, twist)


@inner
def _top(slow: float, bend: float, twist: float) -> float:
    """Return the largest square of the speed by the shares of v, of its square and of its cube."""
    top: float = 1.0 / (slow * slow)
    if bend * top > BEND_SHARE:
        top = BEND_SHARE / bend
    if twist * top * math.sqrt(top) > TWIST_SHARE:
        top = (TWIST_SHARE / twist) ** (2 / 3)
    return top


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
    between, which is kept there if ``flat``. Where it is ``straight``, few cells do: see `_line`.
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
        cap[e], ramp[e] = _top(slow, bend, twist), 1.0 / steep
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


class Task(NamedTuple):
    """What speeds are planned from, and what is tightened on the way."""

    cells: Cells
    cap: Floats  # (n,) largest b on a cell
    ease: Floats  # (n,) share of it and of the acceleration
    soft: Floats  # (n,) share of the jerk
    ramp: Floats  # (n,) path acceleration left
    jerk: Floats  # (n,) path jerk left
    split: Floats  # (n,) of a cell's time, for the first of its two pieces
    node: Ints  # (n + 1,) scratch
    work: Floats  # (6, n + 8) scratch


@compiled(error_model="numpy")
def speeds(
    path: Elements, limits: Limits, grid: Cells, square: float, slope: float
) -> tuple[Floats, Floats, Floats, Ints]:
    """Return ``b`` and ``a`` at the nodes, (n + 1,), splits of cells, and what was repaired.

    From rest to rest: the second-order optimum, then what the jerk takes from it, see `_climb` and
    `_round_peaks`. Where the law of a cell breaks a limit, one law is led over more cells, see
    `_bridged`. If that does not help, limits are tightened there and the speeds around it are
    planned again; a run that does not come to an end is slowed down as a whole. At last, speeds are
    raised where that saves enough, see `refine`: shares of the jerk were estimates. Cells of
    lines change their sizes, see `_line`.

    ``square`` and ``slope`` are b and a at the first node, 0 at rest. What begins in motion cannot
    be slowed down as a whole; where that would be needed, the last number of repairs is negative.
    """
    n = grid.size.size
    b, a = np.zeros(n + 1), np.zeros(n + 1)
    task = Task(
        grid, np.zeros(n), np.ones(n), np.ones(n), np.empty(n), np.empty(n),
        np.full(n, 0.5), np.empty(n + 1, np.int64), np.empty((6, n + 8)),
    )  # fmt: skip
    window = window_of(limits.velocity.size)
    best = np.empty(n + 1)
    repaired = np.zeros(3, np.int64)
    broken = np.zeros(n, np.bool_)
    for c in range(n):
        if grid.size[c] > 0.0:
            task.cap[c] = _cap(grid.share[grid.row[c]], grid.rows[grid.row[c]])
    b[0], a[0] = square, slope
    first = 0
    while first < n:
        last = first
        while not grid.rest[last]:
            last += 1
        last += 1  # nodes first..last, cells first..last - 1
        if grid.size[first] > 0.0:
            short = last - first <= SHORT
            for c in range(first, last):
                broken[c] = True  # nothing is planned yet
            left = last - first
            for trial in range(REPAIRS + 1):
                if left == 0:
                    break
                left = 0
                c = first
                reach = 4 << min(trial, max(5, trial - 8))
                while c < last:
                    if not broken[c]:
                        c += 1
                        continue
                    low, high = max(first, c - reach), c + 1
                    while c < min(last, high + reach):
                        if broken[c]:
                            high = c + 1
                        c += 1
                    high = min(last, high + reach)
                    if trial > 0:
                        repaired[0] += 1
                        repaired[1] += high - low
                    _fit(task, b, a, low, high)
                    bridge = not short or trial > GENTLE
                    left += _check(task, b, a, low, high, broken, trial, bridge)
                    c = high
            if left > 0 and b[first] > 0.0:
                repaired[2] = -1
                break
            if left > 0:
                repaired[2] += 1
                _slow_down(task, b, a, first, last)
            if trial > 1:  # repairs leave lines slower than they can be
                _straight(task, b, a, first, last, LINE_JERK)
            _best(task, best, b, first, last)
            _raise(task, window, path, limits, best, b, a, first, last)
        first = last
    return b, a, task.split, repaired


@inner
def _check(
    task: Task,
    b: Floats,
    a: Floats,
    first: int,
    last: int,
    broken: NDArray[np.bool_],
    trial: int,
    bridge: bool,
) -> int:
    """Find the cells whose law breaks a limit, tighten limits there, and return how many."""
    count, cells, v0 = 0, task.cells, math.sqrt(b[first])
    for c in range(first, last):
        v1 = math.sqrt(b[c + 1])
        _, v, s, j = limits_used(cells, c, v0, v1, a[c], a[c + 1], task.split[c])
        broken[c] = not max(v, s, j) <= 1.0 + ROUNDING
        v0 = v1
    for c in range(first, last):
        if not broken[c]:
            continue
        if bridge and _bridged(task, b, a, first, last, c, broken):
            continue
        count += 1
        if trial >= PATIENCE:  # drive steadily there: that needs neither acceleration nor jerk
            wide = trial - PATIENCE + 2
            begin, end = max(first, c - wide), min(last, c + 1 + wide)
            level = math.inf
            for i in range(begin, end + 1):
                level = min(level, b[i])
            for near in range(begin, end):
                task.soft[near] *= 0.9
                task.ease[near] = min(task.ease[near], max(0.95 * level / task.cap[near], 1e-3))
            continue
        _, v, s, j = limits_used(
            cells, c, math.sqrt(b[c]), math.sqrt(b[c + 1]), a[c], a[c + 1], 0.5
        )
        for near in range(max(first, c - 1), min(last, c + 2)):
            if not j <= 1.0 + ROUNDING:
                task.soft[near] *= max(0.6, 0.95 / j)
                if trial > 1:  # bending alone may take too much of it
                    task.ease[near] *= max(0.9, 0.99 / j)
            else:
                task.ease[near] *= 0.99 / max(v * v, s)
    return count


@inner
def _bridged(
    task: Task,
    b: Floats,
    a: Floats,
    first: int,
    last: int,
    c: int,
    broken: NDArray[np.bool_],
) -> bool:
    """Lead one law of two pieces over ever more cells around a broken one, until limits hold."""
    cells, size, split = task.cells, task.cells.size, task.split
    for share in SPLITS:
        if keeps_limits(cells, b, a, c, share):
            split[c], broken[c] = share, False
            return True
    keep, hold, part = task.work[0], task.work[1], task.work[2]
    for reach in BRIDGES:
        for side in range(3):  # both, or one of them: on the other the feed may be less
            low = max(first, c - reach) if side < 2 else c
            high = min(last, c + 1 + reach) if side != 1 else c + 1
            total = 0.0
            for i in range(low, high):
                total += size[i]
                keep[i], hold[i], part[i] = b[i], a[i], split[i]
            v0, v1 = math.sqrt(b[low]), math.sqrt(b[high])
            for way in range(3):
                share = 0.5 + 0.2 * (way if way < 2 else -1)
                time, middle, _, _ = two_pieces(v0, v1, a[low], a[high], total, share)
                if time > 0.0 and _spread(task, b, a, low, high, time, middle, share):
                    for i in range(low, high):
                        broken[i] = False
                    return True
                for i in range(low, high):
                    b[i], a[i], split[i] = keep[i], hold[i], part[i]
    return False


@inner
def _spread(
    task: Task, b: Floats, a: Floats, low: int, high: int, time: float, middle: float, share: float
) -> bool:
    """Put the states of one law over several cells into their nodes; return whether limits hold."""
    cells, size, split = task.cells, task.cells.size, task.split
    v0, a0 = math.sqrt(b[low]), a[low]
    turn = share * time
    j0, j1 = (middle - a0) / turn, (a[high] - middle) / (time - turn)
    vm = v0 + 0.5 * turn * (a0 + middle)
    x, t = -((v0 + (0.5 * a0 + j0 * (1 / 6) * turn) * turn) * turn), -turn  # from the turn on
    for c in range(low, high):
        x += size[c]
        before, v, j = t, 0.0, j1
        if c + 1 < high:
            j = j0 if x < 0.0 else j1
            v = math.sqrt(b[c])
            t = min(t + (size[c] / v if v > 0.0 else 0.5 * (time - turn - t)), time - turn)
            for _ in range(6):
                v = vm + (middle + 0.5 * j * t) * t
                if v <= 0.0:
                    return False
                over = (vm + (0.5 * middle + j * (1 / 6) * t) * t) * t - x
                t -= over / v
                if abs(over) <= 1e-12 * size[c]:
                    break
            v = vm + (middle + 0.5 * j * t) * t
            if v <= 0.0 or t <= before:
                return False
            b[c + 1], a[c + 1] = v * v, middle + j * t
        else:
            t = time - turn
        split[c] = 0.5
        if before < 0.0 < t:
            split[c] = min(max(-before / (t - before), 0.05), 0.95)
        if not keeps_limits(cells, b, a, c, split[c]):
            return False
    return True


@inner
def _slow_down(task: Task, b: Floats, a: Floats, first: int, last: int) -> None:
    """Let time pass more slowly from rest to rest, such that all limits hold.

    Where a cell has no law from one state to the other, it has none at any speed; then the speed is
    steady at all nodes, between which there is always one.
    """
    for steady in range(2):
        worst, solved = 1.0, True
        if steady == 1:
            for i in range(first + 1, last):
                a[i] = 0.0
        for c in range(first, last):
            task.split[c] = 0.5
            v0, v1 = math.sqrt(b[c]), math.sqrt(b[c + 1])
            time, v, s, j = limits_used(task.cells, c, v0, v1, a[c], a[c + 1], 0.5)
            solved &= time > 0.0
            worst = max(worst, v, math.sqrt(s), j ** (1 / 3))
        if solved:
            break
    for i in range(first, last + 1):
        b[i] /= worst * worst
        a[i] /= worst * worst


@inner
def _best(task: Task, best: Floats, b: Floats, first: int, last: int) -> None:
    """Put the second-order optimum from rest to rest into ``best``."""
    for c in range(first, last):
        task.ease[c] = 1.0
    best[first], best[last] = b[first], b[last]
    _envelope(task, best, first, last)


@inner
def _fit(task: Task, b: Floats, a: Floats, first: int, last: int) -> None:
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
    _straight(task, b, a, first, last, LINE_JERK)


@inner
def _raise(
    task: Task,
    window: Window,
    path: Elements,
    limits: Limits,
    best: Floats,
    b: Floats,
    a: Floats,
    first: int,
    last: int,
) -> None:
    """Raise speeds of a run where b is far below ``best``, its second-order optimum; see `refine`.

    Lines there have less jerk meanwhile: where a limit is used up, there is no way to begin.
    """
    cells, row, share = task.cells, task.cells.row, task.cells.share
    whole, lost = _loss(cells, best, b, first, last)
    if lost < MATTERS * whole:
        return
    begin, most = first, WINDOW
    while begin < last:
        end = begin + 1
        while end < min(last, begin + most):
            pace = max(share[row[end - 1], 0, 0], share[row[end], 0, 0])
            if b[end] * pace * pace >= FULL:
                break
            end += 1
        whole, lost = _loss(cells, best, b, begin, end)
        done = end == begin + 1 or lost <= WORTH * whole
        if not done:
            low, high = begin, end  # and the lines that begin before it, or end after it
            while low > first and row[low - 1] == row[low]:
                low -= 1
            while high < last and row[high - 1] == row[high]:
                high += 1
            _straight(task, b, a, low, high, LINE_SOFT)
            done = refine(window, path, limits, cells, task.split, b, a, begin, end)
            _straight(task, b, a, low, high, LINE_JERK)
        most = WINDOW if done else (end - begin) // 2  # perhaps only some cells are in the way
        if done or most < SMALLEST:
            begin, most = end, WINDOW


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
def _straight(task: Task, b: Floats, a: Floats, first: int, last: int, soft: float) -> None:
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


@compiled(error_model="numpy")
def law(
    path: Elements, at: Ints, offset: Floats, size: Floats, b: Floats, a: Floats, split: Floats
) -> tuple[NDArray[np.int32], Floats, Floats]:
    """Return the pieces of the trajectory: element, start and law of each.

    ``at``, ``offset`` and ``size`` are those of the cells.
    """
    n, m = size.size, path.length.size
    most = 2 * n + m + 1
    element, start, piece = np.empty(most, np.int32), np.empty(most + 1), np.empty((most, 4))
    start[0] = 0.0
    k, time, lost = 0, 0.0, 0.0  # compensated sum: errors do not grow
    for c in range(n):
        e, s = at[c], offset[c]
        if size[c] == 0.0:
            time += path.dwell[e]
            element[k], start[k + 1] = e, time
            piece[k, 0] = piece[k, 1] = piece[k, 2] = piece[k, 3] = 0.0
            k += 1
            continue
        after = at[c + 1] if c + 1 < n else m
        final = max(after - 1, e)  # the last element of the cell
        v0, v1 = math.sqrt(b[c]), math.sqrt(b[c + 1])
        whole, middle, vm, _ = two_pieces(v0, v1, a[c], a[c + 1], size[c], split[c])
        for half in range(2):
            v, x = (v0, a[c]) if half == 0 else (vm, middle)
            end = middle if half == 0 else a[c + 1]
            left = (split[c] if half == 0 else 1.0 - split[c]) * whole
            j = (end - x) / left
            while True:
                room = path.length[e] - s
                step = (v + (0.5 * x + j * (1 / 6) * left) * left) * left
                crossing = e < final and step > room * (1.0 - 1e-13)
                span = left
                if crossing:
                    span = min(room / v, left) if v > 0.0 else left
                    early, late = 0.0, left
                    for _ in range(60):
                        over = (v + (0.5 * x + j * (1 / 6) * span) * span) * span - room
                        if over < 0.0:
                            early = span
                        else:
                            late = span
                        before = span
                        span -= over / (v + (x + 0.5 * j * span) * span)
                        if not early <= span <= late:  # it would jump to and fro
                            span = 0.5 * (early + late)
                        if abs(span - before) <= 1e-15 * left:
                            break
                same = (
                    k > 0
                    and j == 0.0
                    and x == 0.0
                    and element[k - 1] == e
                    and piece[k - 1, 1] == v
                    and piece[k - 1, 2] == 0.0
                    and piece[k - 1, 3] == 0.0
                )
                step = span - lost
                now = time + step
                lost = (now - time) - step
                if same:
                    start[k] = now
                elif now > time:  # what rounding makes instantaneous is left out
                    element[k] = e
                    piece[k, 0], piece[k, 1] = s, v
                    piece[k, 2], piece[k, 3] = 0.5 * x, j * (1 / 6)
                    k += 1
                    start[k] = now
                time = now
                if not crossing:
                    s += (v + (0.5 * x + j * (1 / 6) * span) * span) * span
                    break
                v += (x + 0.5 * j * span) * span
                x += j * span
                left -= span
                e += 1
                s = 0.0
    return element[:k], start[: k + 1], piece[:k]
