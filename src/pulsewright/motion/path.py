"""Compiled geometry of the planner: from moves to segments, and with blended corners to elements.

Moves too short to matter are dropped. Where short moves would force the machine to slow down at
each of their noisy corners, a few of them are replaced by their chord, within the tolerance. At
corners with tolerance the path is blended: a displacement is added to it on both sides of the
corner, cubic on each piece, such that position, tangent and curvature have no jump. The path stays
what it is further away. Displacements from both ends of a line may overlap, so that a curve made of
short chords becomes nearly the cubic spline through it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import compiled, inlined, inner, making

NOTHING = 1e-8  # motion shorter than this is none [mm, degrees]
TANGENT = 1e-9  # tangents that differ less are equal; the jump in velocity is rounding
REVERSAL = -0.98  # cosine between tangents below which the machine stops in the corner
MERGE_SHARE = 0.42  # of the tolerance, for chords; the rest is for blends
LONGEST_RUN = 64  # moves that one chord may replace
BLEND_SHARE = 0.1  # of acceleration and jerk at full speed; a blend need not take less
SLIVER = 1e-13  # of a segment: so small a part is none; what it bends is rounding
OVERLAP = 1e-8  # of the smaller one of two blends on a segment: such a part of it is none, too
MARGIN = 1e-7  # of feeds and limits, for rounding on the shortest pieces and in late times
ROUNDING = 1e-11  # of positions, left of tolerances [mm, degrees]
DOUBT = 4e-15  # of positions: so far from there, nobody knows how long a segment is
LEAST_BLEND = 1e-7  # of a segment: in a smaller one, rounding would be felt; the machine rests
SHORT_BLEND = 0.1  # of the stopping distance: so short a blend hinders no change of speed
WIDEST_ARC = 0.5  # of an arc that a blend may bend [rad]
ARC_SHARE = 0.95  # of the acceleration for bending on arcs; the rest changes speed
ARC_JERK = 0.5  # of the jerk for bending on arcs
HASTY = 0.7  # of the square of the speed that the jerk allows: it may be near to a limit
UNEVEN = 1.25  # ratio of the sizes of a blend on both sides of a corner, at most
CORNER_PART = 1 / 6  # deviation of a corner by tangents, over their difference and the size
CURVE_PART = 0.0084  # deviation by curvatures, over their difference and the size squared
ARC, DWELL = 1, 2  # as MoveKind

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Limits(NamedTuple):
    """Bounds on the magnitudes of ``rows`` times the derivatives of position over time."""

    rows: Floats  # (r, 6)
    begin: Ints  # (r,) the first column that is not 0
    end: Ints  # (r,) the one after the last
    velocity: Floats  # (r,)
    acceleration: Floats  # (r,)
    jerk: Floats  # (r,)
    per_velocity: Floats  # (r,) 1 over it
    per_acceleration: Floats  # (r,) the same
    per_jerk: Floats  # (r,) the same


class Segments(NamedTuple):
    """Lines, arcs and rests, each from where the one before it ends.

    Geometry is that of a trajectory's elements, of degree 1. The path coordinate is the length in
    X, Y, Z, or in A, B, C [degrees] where only those move; so its rate is the programmed feed.
    """

    poly: Floats  # (s, 2, 6)
    cosine: Floats  # (s, 6)
    sine: Floats  # (s, 6)
    omega: Floats  # (s,)
    length: Floats  # (s,); 0 for a rest
    move: Ints  # (s,) the last move that the segment stands for
    feed: Floats  # (s,)
    dwell: Floats  # (s,) [s]
    tolerance: Floats  # (s,) left for a blend at the end; 0: rest there
    top: Floats  # (s,) about the largest square of the speed
    ramp: Floats  # (s,) path acceleration possible up to it; 0 for a rest
    collapse: Floats  # (s,) how far a chord may be from the moves that it replaces, if that is more
    short: Flags  # (s,) whether a chord may replace it: a line too short to stop in, or loose


class Elements(NamedTuple):
    """The blended path in pieces of one form: geometry of a trajectory, and what is asked there."""

    poly: Floats  # (m, 4, 6)
    cosine: Floats  # (m, 6)
    sine: Floats  # (m, 6)
    omega: Floats  # (m,)
    length: Floats  # (m,); 0 for a rest
    move: NDArray[np.int32]  # (m,)
    dwell: Floats  # (m,)
    feed: Floats  # (m,)
    rest: Flags  # (m,) whether the machine comes to rest at the end


class Blends(NamedTuple):
    """What happens at the end of each segment."""

    size: Floats  # (s, 2) path coordinate that a blend takes of it and of the next; 0: none
    turn: Floats  # (s, 6) jump of the tangent
    bend: Floats  # (s, 6) jump of the curvature
    wanted: Floats  # (s,) size that the blend would have if there were room; infinite: none
    curved: Flags  # (s,) whether one of the two is an arc
    halved: Flags  # (s,) whether the blend changes in the middle of its sides
    rest: Flags  # (s,) whether the machine comes to rest


@inner
def _square(x: float) -> float:
    """Return the square: ``x ** 2`` of Python is not always rounded like the compiled one."""
    return x * x


@inner
def _squared(v: Floats, first: int) -> float:
    """Return the square of the length of a vector's linear (first = 0) or rotary (3) part."""
    return _square(v[first]) + _square(v[first + 1]) + _square(v[first + 2])


@inner
def _length(v: Floats, first: int) -> float:
    """Return that length."""
    return math.sqrt(_squared(v, first))


@inner
def _norm(v: Floats) -> float:
    """Return the larger of the linear and the rotary length."""
    return math.sqrt(max(_squared(v, 0), _squared(v, 3)))


@inlined
def component(limits: Limits, r: int, x: Floats) -> float:
    """Return that of a vector (6,) along row ``r``: their product."""
    axis = limits.begin[r]
    product: float = limits.rows[r, axis] * x[axis]
    for other in range(axis + 1, limits.end[r]):  # rarely any: most rows are axes
        product += limits.rows[r, other] * x[other]
    return product


class Columns(NamedTuple):
    """Columns of `Moves`, and where the first one begins."""

    start: Floats
    kind: NDArray[np.int8]
    plane: NDArray[np.int8]
    rapid: Flags
    end: Floats
    center: Floats
    sweep: Floats
    feed: Floats
    dwell: Floats
    tolerance: Floats
    collapse: Floats
    pitch: Floats


@compiled(error_model="numpy")
def blended(
    moves: Columns, rows: Floats, velocity: Floats, acceleration: Floats, jerk: Floats
) -> tuple[Elements, Limits, Ints, Ints]:
    """Return the blended path, and the limits on it.

    Parameters
    ----------
    moves : Columns
    rows : (r, 6) float64
        Combinations of axes that the machine limits.
    velocity, acceleration, jerk : (r,) float64
        Limits along them.

    Returns
    -------
    path : Elements
    limits : Limits
        Those along rows with axes that move.
    kept : (k,) int64
        The moves that do something.
    last : (s,) int64
        Those of them at whose ends there may be a blend: the last one of each segment. Chords have
        replaced runs of short lines.
    """
    n = moves.kind.size
    kept, tolerance, moving = np.empty(n, np.int64), np.empty(n), np.empty(6, np.bool_)
    n = _keep(moves, kept, tolerance, moving)
    kept, tolerance = kept[:n], tolerance[:n]
    limits = _limited(rows, velocity, acceleration, jerk, moving)
    work = np.empty((4, max(6, limits.velocity.size)))
    s = _untraced(kept, tolerance)
    _trace(moves, s)
    _find_limits(moves, s, limits, work)
    last, tolerance = _merged(s, limits)
    if last.size < n:
        s = _untraced(last, tolerance)
        _trace(moves, s)
        _find_limits(moves, s, limits, work)
    n = last.size
    blends = Blends(
        size=np.empty((n, 2)),
        turn=np.empty((n, 6)),
        bend=np.empty((n, 6)),
        wanted=np.empty(n),
        curved=np.empty(n, np.bool_),
        halved=np.empty(n, np.bool_),
        rest=np.empty(n, np.bool_),
    )
    _find_corners(s, limits, blends, work)
    m = _fit_blends(s, limits, blends)
    poly, cosine, sine = np.empty((m, 4, 6)), np.empty((m, 6)), np.empty((m, 6))
    omega, length, dwell, feed = np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    move, rest = np.empty(m, np.int32), np.empty(m, np.bool_)
    path = Elements(poly, cosine, sine, omega, length, move, dwell, feed, rest)
    e = _split(s, blends, path, work[0])
    path = Elements(
        poly[:e],
        cosine[:e],
        sine[:e],
        omega[:e],
        length[:e],
        move[:e],
        dwell[:e],
        feed[:e],
        rest[:e],
    )
    return path, limits, kept, last


@making
def _limited(
    rows: Floats, velocity: Floats, acceleration: Floats, jerk: Floats, moving: Flags
) -> Limits:
    """Return limits along the rows with axes that move."""
    n, size = 0, velocity.size
    kept, begin, end = np.empty((size, 6)), np.empty(size, np.int64), np.empty(size, np.int64)
    v, a, j = np.empty(size), np.empty(size), np.empty(size)
    per_v, per_a, per_j = np.empty(size), np.empty(size), np.empty(size)
    for r in range(size):
        used = False
        begin[n], end[n] = 6, 0
        for axis in range(6):
            kept[n, axis] = rows[r, axis]
            if rows[r, axis] != 0.0:
                used |= moving[axis]
                begin[n], end[n] = min(begin[n], axis), axis + 1
        v[n], a[n] = velocity[r] * (1.0 - MARGIN), acceleration[r] * (1.0 - MARGIN)
        j[n] = jerk[r] * (1.0 - MARGIN)
        per_v[n], per_a[n], per_j[n] = 1.0 / v[n], 1.0 / a[n], 1.0 / j[n]
        n += used
    return Limits(
        *(kept[:n], begin[:n], end[:n], v[:n], a[:n], j[:n], per_v[:n], per_a[:n], per_j[:n])
    )


@making
def _untraced(move: Ints, tolerance: Floats) -> Segments:
    """Return segments that end with the moves ``move``, to be traced."""
    n = move.size
    return Segments(
        poly=np.empty((n, 2, 6)),
        cosine=np.empty((n, 6)),
        sine=np.empty((n, 6)),
        omega=np.empty(n),
        length=np.empty(n),
        move=move,
        feed=np.empty(n),
        dwell=np.empty(n),
        tolerance=tolerance,
        top=np.empty(n),
        ramp=np.empty(n),
        collapse=np.empty(n),
        short=np.empty(n, np.bool_),
    )


@inner
def _keep(moves: Columns, kept: Ints, tolerance: Floats, moving: Flags) -> int:
    """Find the moves that do something, and the tolerance at the end of each; return how many.

    Moves without motion pass on their demand to rest. ``moving`` becomes true for axes that move.
    """
    kind, end = moves.kind, moves.end
    last = before = moves.start
    for axis in range(6):
        moving[axis] = False
    n = 0
    for i in range(kind.size):
        keep = moves.sweep[i] != 0.0 if kind[i] == ARC else moves.dwell[i] > 0.0
        if kind[i] == DWELL:
            if n > 0:
                tolerance[n - 1] = 0.0
        else:
            for axis in range(6):
                keep |= abs(end[i, axis] - last[axis]) > NOTHING
        for axis in range(6):
            moving[axis] |= end[i, axis] != before[axis]
        before = end[i]
        if kind[i] == ARC:
            moving[(moves.plane[i] + 1) % 3] = moving[(moves.plane[i] + 2) % 3] = True
        if keep:
            kept[n], tolerance[n] = i, moves.tolerance[i]
            n += 1
            if kind[i] == DWELL:
                tolerance[n - 1] = 0.0
            else:
                last = end[i]
        elif n > 0:
            tolerance[n - 1] = min(tolerance[n - 1], moves.tolerance[i])
    return n


@inner
def _trace(moves: Columns, s: Segments) -> None:
    """Fill in the segments, whose last moves and tolerances are known.

    Where the ends of an arc differ in radius, the difference is spread evenly over the arc.
    """
    x = moves.start
    for k in range(s.move.size):
        i = s.move[k]
        kind, end, center, sweep = moves.kind[i], moves.end[i], moves.center[i], moves.sweep[i]
        poly, cosine, sine = s.poly[k], s.cosine[k], s.sine[k]
        delta = poly[1]
        for axis in range(6):
            poly[0, axis], delta[axis] = x[axis], end[axis] - x[axis]
            cosine[axis] = sine[axis] = 0.0
        s.length[k] = s.omega[k] = s.feed[k] = s.dwell[k] = 0.0
        s.collapse[k] = moves.collapse[i]
        if moves.rapid[i] or moves.pitch[i] != 0.0:
            s.collapse[k] = 0.0
        if kind == DWELL:
            s.dwell[k] = moves.dwell[i]
            for axis in range(6):
                delta[axis] = 0.0
            continue
        turn = 0.0
        if kind == ARC:
            a, b = (moves.plane[i] + 1) % 3, (moves.plane[i] + 2) % 3
            u, v = x[a] - center[a], x[b] - center[b]
            c, d = math.cos(sweep), math.sin(sweep)
            delta[a] = end[a] - (center[a] + u * c - v * d)
            delta[b] = end[b] - (center[b] + v * c + u * d)
            sign = math.copysign(1.0, sweep)
            poly[0, a], poly[0, b] = center[a], center[b]
            cosine[a], cosine[b] = u, v
            sine[a], sine[b] = -sign * v, sign * u
            turn = abs(sweep)
            around = math.hypot(u, v) * turn + math.hypot(delta[a], delta[b])
            length = math.hypot(around, delta[moves.plane[i]])
        else:
            length = _length(delta, 0)
        if length < NOTHING:
            length = _length(delta, 3)
        per_length = 1.0 / length
        for axis in range(6):
            delta[axis] *= per_length
        x = end
        s.length[k], s.omega[k] = length, turn / length
        s.feed[k] = math.inf if moves.rapid[i] else moves.feed[i] * (1.0 - MARGIN)


@compiled(error_model="numpy")
def peaks(
    cosine: float, sine: float, c0: float, s0: float, c1: float, s1: float, turn: float
) -> tuple[float, float]:
    """Return the largest sizes of the slope of a wave and of the wave itself.

    The wave is ``cosine`` cos(u) + ``sine`` sin(u), over ``turn`` from the angle with cosine ``c0``
    and sine ``s0`` to that with ``c1`` and ``s1``.
    """
    slope0, slope1 = sine * c0 - cosine * s0, sine * c1 - cosine * s1
    wave0, wave1 = cosine * c0 + sine * s0, cosine * c1 + sine * s1
    slope, wave = max(abs(slope0), abs(slope1)), max(abs(wave0), abs(wave1))
    if turn >= math.pi or slope0 * slope1 < 0.0:
        wave = math.hypot(cosine, sine)
    if turn >= math.pi or wave0 * wave1 < 0.0:
        slope = math.hypot(cosine, sine)
    return slope, wave


@inner
def _find_limits(moves: Columns, s: Segments, limits: Limits, work: Floats) -> None:
    """Find the largest speeds, and the lines that may become part of chords; ``work`` is (4, r)."""
    line, swing = work[0], work[1]  # parts of x' along each row
    along, bend = work[2], work[3]  # largest x' and x'' along each row
    count = limits.velocity.size
    for k in range(s.length.size):
        s.top[k], s.ramp[k], s.short[k] = 0.0, 0.0, False
        if s.length[k] == 0.0:
            continue
        straight, cosine, sine, omega = s.poly[k, 1], s.cosine[k], s.sine[k], s.omega[k]
        turn, cos, sin = 0.0, 1.0, 0.0
        if omega > 0.0:
            turn = abs(moves.sweep[s.move[k]])
            cos, sin = math.cos(turn), math.sin(turn)
        top = s.feed[k] * s.feed[k]
        for r in range(count):
            swing[r], bend[r] = 0.0, 0.0
            line[r] = along[r] = abs(component(limits, r, straight))
            if turn > 0.0:
                c, d = component(limits, r, cosine), component(limits, r, sine)
                swing[r] = omega * math.hypot(c, d)
                slope, wave = peaks(c, d, 1.0, 0.0, cos, sin, turn)
                along[r] += omega * slope
                bend[r] = omega * omega * wave
            if along[r] > 0.0:
                top = min(top, _square(limits.velocity[r] / along[r]))
            if bend[r] > 0.0:
                top = min(top, ARC_SHARE * limits.acceleration[r] / bend[r])
            if swing[r] > 0.0:
                twist = _square(omega) * swing[r]
                top = min(top, (ARC_JERK * limits.jerk[r] / twist) ** (2 / 3))
        ramp = math.inf
        for r in range(count):
            if along[r] > 0.0:
                limit = limits.acceleration[r]
                best = (limit - bend[r] * top) / along[r]  # both at their worst at once
                full = omega * swing[r] * top
                if 0.0 < full < limit:  # x'' and x' of a turning point are a quarter turn apart
                    free = limit * limit - full * full
                    wider = _square(swing[r]) - _square(line[r])
                    root = _square(limit * line[r]) + wider * free
                    best = max(best, free / (limit * line[r] + math.sqrt(root)))
                ramp = min(ramp, best)
        s.top[k], s.ramp[k] = top, ramp
        loose = s.collapse[k] > s.tolerance[k] > 0.0
        s.short[k] = turn == 0.0 and (loose or 2.0 * ramp * s.length[k] < top)
        for axis in range(3, 6):
            s.short[k] &= straight[axis] == 0.0


@inlined
def _size_needed(s: Segments, k: int, limits: Limits) -> float:
    """Return the size of a blend after segment ``k`` that takes all acceleration or jerk there."""
    size, top = 0.0, s.top[k]
    cube = top * math.sqrt(top)
    for r in range(limits.acceleration.size):
        turn = abs(component(limits, r, s.poly[k + 1, 1]) - component(limits, r, s.poly[k, 1]))
        size = max(size, 0.5 * turn * top * limits.per_acceleration[r])
        size = max(size, math.sqrt(turn * cube * limits.per_jerk[r]))
    return size


@making
def _merged(s: Segments, limits: Limits) -> tuple[Ints, Floats]:
    """Choose runs of lines to replace by their chords, in X, Y, Z and of one feed.

    Within the tolerance, runs that would slow the machine down, and of lines too short to stop in:
    longer ones have room to change speed. Where more is allowed by the moves' ``collapse``, all
    runs that lie so near to their chord; what it allows beyond the tolerance is the chords' alone.

    Returns
    -------
    last : (k,) int64
        The last move of each run; runs of single segments stay what they are.
    tolerance : (k,) float64
        What is left of the tolerance for the blend after each run.
    """
    poly, feed, tolerance, length = s.poly, s.feed, s.tolerance, s.length
    n = length.size
    last, used, left = np.empty(n, np.int64), np.empty(n + 1), np.empty(n)
    wide = np.empty(n + 1)  # what all deviations of a run together may be
    short, collapse = s.short, s.collapse
    k, i = 0, 0
    while i < n:
        j = i
        more = collapse[i] - tolerance[i] if collapse[i] > tolerance[i] > 0.0 else 0.0
        worst, tight = 0.0, more > 0.0
        while (
            j + 1 < n
            and j - i < LONGEST_RUN
            and short[j]
            and short[j + 1]
            and feed[j + 1] == feed[i]
            and tolerance[j] == tolerance[i]
            and collapse[j + 1] == collapse[i]
        ):
            far = _chord_distance(poly, length, i, j + 1)
            if far < 0.0 or far > more + MERGE_SHARE * tolerance[i]:
                break
            room = 0.5 * min(length[j], length[j + 1])
            tight |= room < _size_needed(s, j, limits)
            worst = far
            j += 1
        if tight:
            last[k], used[k] = j, worst
            wide[k] = more + tolerance[i] if j > i else math.inf
            k += 1
            i = j + 1
        else:
            for single in range(i, max(j, i + 1)):
                last[k], used[k], wide[k] = single, 0.0, math.inf
                k += 1
            i = max(j, i + 1)
    used[k], wide[k] = 0.0, math.inf
    for q in range(k):
        left[q] = tolerance[last[q]]
        if left[q] > 0.0:
            for run in range(q, q + 2):
                left[q] = min(left[q], wide[run] - used[run])
        last[q] = s.move[last[q]]
    return last[:k], left[:k]


@inner
def _chord_distance(poly: Floats, length: Floats, first: int, last: int) -> float:
    """Return how far corners lie from the chord of a run; -1 where the run turns back on it."""
    end = length[last]
    x = poly[last, 0, 0] + poly[last, 1, 0] * end - poly[first, 0, 0]
    y = poly[last, 0, 1] + poly[last, 1, 1] * end - poly[first, 0, 1]
    z = poly[last, 0, 2] + poly[last, 1, 2] * end - poly[first, 0, 2]
    size = math.sqrt(x * x + y * y + z * z)
    worst = 0.0
    for k in range(first, last + 1):
        if poly[k, 1, 0] * x + poly[k, 1, 1] * y + poly[k, 1, 2] * z <= 0.0:
            return -1.0
        u = poly[k, 0, 0] - poly[first, 0, 0]
        v = poly[k, 0, 1] - poly[first, 0, 1]
        w = poly[k, 0, 2] - poly[first, 0, 2]
        far = _square(v * z - w * y) + _square(w * x - u * z) + _square(u * y - v * x)
        worst = max(worst, far)
    return math.sqrt(worst) / size


@inlined
def _tangent(s: Segments, k: int, at: float, out: Floats, bend: Floats) -> None:
    """Put the first two derivatives of segment ``k`` at ``at`` into ``out`` and ``bend``."""
    w = s.omega[k]
    c, d = 1.0, 0.0
    if w != 0.0:
        c, d = math.cos(w * at), math.sin(w * at)
    for axis in range(6):
        out[axis] = s.poly[k, 1, axis] + w * (s.sine[k, axis] * c - s.cosine[k, axis] * d)
        bend[axis] = -w * w * (s.cosine[k, axis] * c + s.sine[k, axis] * d)


@inlined
def _of_use(turn: Floats, bend: Floats, top: float, ramp: float, limits: Limits) -> float:
    """Return the size of a blend that hinders little: a larger one is of no use.

    ``turn`` and ``bend`` are the jumps of the first two derivatives, ``top`` the square of speed.
    """
    bent, twisted, changed = 0.0, 0.0, 0.0  # what the jumps take of acceleration and jerk
    for r in range(limits.acceleration.size):
        first, per_jerk = abs(component(limits, r, turn)), limits.per_jerk[r]
        bent = max(bent, first * limits.per_acceleration[r])
        twisted = max(twisted, first * per_jerk)
        changed = max(changed, abs(component(limits, r, bend)) * per_jerk)
    bent, twisted, changed = bent / BLEND_SHARE, twisted / BLEND_SHARE, changed / BLEND_SHARE
    cube = top * math.sqrt(top)
    least = max(SHORT_BLEND * top / (2.0 * ramp), bent * top)
    return max(least, math.sqrt(twisted * cube), 7.0 / 6.0 * changed * cube)


@inlined
def _is_hasty(turn: Floats, size: float, top: float, limits: Limits) -> bool:
    """Return whether the jerk limits the speed on a blend, or is near to it.

    ``turn`` is the jump of the tangent, ``top`` the square of the speed beside the blend.
    """
    bent, twisted = top, math.inf  # square of the speed, and its cube
    for r in range(limits.acceleration.size):
        first = abs(component(limits, r, turn))
        if first > 0.0:
            bent = min(bent, limits.acceleration[r] * size / first)
            twisted = min(twisted, limits.jerk[r] * size * size / first)
    hasty: bool = HASTY * twisted ** (2 / 3) < bent
    return hasty


@inner
def _find_corners(s: Segments, limits: Limits, found: Blends, work: Floats) -> None:
    """Find the corners, and the sizes wanted of blends there; ``work`` is (4, 6).

    Blends are as large as the tolerance allows, but not larger than of use, so that lines remain to
    change speed on.
    """
    n, turn, bend = s.length.size, found.turn, found.bend
    wanted, curved, rest = found.wanted, found.curved, found.rest
    e1, e2, c1, c2 = work[0], work[1], work[2], work[3]
    for k in range(n):
        found.size[k, 0] = found.size[k, 1] = 0.0
        wanted[k], curved[k], found.halved[k] = math.inf, False, False
        rest[k] = k + 1 == n or s.tolerance[k] <= 2.0 * ROUNDING
        if rest[k]:
            continue
        _tangent(s, k, s.length[k], e1, c1)
        _tangent(s, k + 1, 0.0, e2, c2)
        dot = 0.0
        for axis in range(6):
            turn[k, axis] = e2[axis] - e1[axis]
            bend[k, axis] = c2[axis] - c1[axis]
            dot += e1[axis] * e2[axis]
        s1, s2 = _squared(e1, 0) + _squared(e1, 3), _squared(e2, 0) + _squared(e2, 3)
        angle, more = _norm(turn[k]), _norm(bend[k])
        curved[k] = s.omega[k] > 0.0 or s.omega[k + 1] > 0.0
        rest[k] = dot <= REVERSAL * math.sqrt(s1 * s2)
        if rest[k] or (angle <= TANGENT and more <= TANGENT):
            continue
        away = max(_length(s.poly[k, 0], 0), _length(s.poly[k + 1, 0], 0))
        free = s.tolerance[k] * (1.0 - 1e-9) - ROUNDING
        free -= DOUBT * away * math.sqrt(max(s1, s2))
        if free < ROUNDING:
            rest[k] = True
            continue
        top, ramp = min(s.top[k], s.top[k + 1]), min(s.ramp[k], s.ramp[k + 1])
        first, second = CORNER_PART * angle, CURVE_PART * more
        wanted[k] = 2.0 * free / (first + math.sqrt(first * first + 4.0 * second * free))
        wanted[k] = min(wanted[k], _of_use(turn[k], bend[k], top, ramp, limits))
        widest = max(s.omega[k], s.omega[k + 1])
        if widest > 0.0:
            wanted[k] = min(wanted[k], WIDEST_ARC / widest)


@inner
def _fit_blends(s: Segments, limits: Limits, found: Blends) -> int:
    """Choose the sizes of blends such that there is room; return how many elements that makes.

    The sizes on both sides of a corner are equal, but where the jerk limits the speed and the lines
    there are of nearly one length: then the blend takes all of both. So it ends where the next
    blends have their peaks, as on the chords of a curve whose lengths differ by rounding: ever so
    short a part that only one of them bends would allow no more speed than a corner.
    """
    wanted, size, turn, curved = found.wanted, found.size, found.turn, found.curved
    count = s.length.size
    for k in range(s.length.size - 1):
        if wanted[k] == math.inf:
            continue
        for side in range(2):
            room, other = s.length[k + side], k - 1 + 2 * side
            if curved[k] or (other >= 0 and curved[other]):  # only those of lines may overlap
                apart = wanted[other] if other >= 0 else math.inf
                room = max(0.5 * room, room - apart)
            size[k, side] = min(wanted[k], room)
        least, most = min(size[k, 0], size[k, 1]), max(size[k, 0], size[k, 1])
        uneven = (1.0 + OVERLAP) * least < most <= UNEVEN * least and most < wanted[k]
        if curved[k] or not (uneven and _is_hasty(turn[k], least, s.top[k], limits)):
            size[k, 0] = size[k, 1] = least
        if least < LEAST_BLEND * max(s.length[k], s.length[k + 1]):
            size[k, 0] = size[k, 1] = 0.0
            found.rest[k] = True
            continue
        found.halved[k] = curved[k] or size[k, 0] != size[k, 1]
        count += 4 if found.halved[k] else 2
    return count


@inner
def _displace(
    x: Floats,
    turn: Floats,
    bend: Floats,
    d: float,
    other: float,
    at: float,
    side: float,
    inner: bool,
) -> None:
    """Add the displacement of a blend to the cubic ``x`` (4, 6).

    ``d`` is its size on this side of the corner, ``other`` that on the other side; ``at`` is the
    distance from the corner where the cubic begins, ``side`` -1 before the corner, 1 after it. The
    distance grows after the corner and shrinks before it. ``inner`` tells whether the cubic is
    within half the size.

    The curvature, over the jump in tangent, is linear in pieces: 0 at the ends, ``peak`` at the
    corner, and ``half`` between, where it has a kink if the sizes differ. So it ends where the
    blends of the next corners have their peaks, its integral is 1, and it leads from one line to
    the other.
    """
    w, h, per_d = d - at, 0.5 * d, 1.0 / d
    peak = 2.0 / (d + other)
    more = peak * (other - d) * (2 / 3) * per_d
    half = 0.5 * peak + more
    if inner and d != other:
        t0, t1 = peak * d * other / 6.0, -h * (peak + more)  # at the corner
        t2, t3 = 0.5 * peak, (half - peak) * (1 / 3) * per_d
        t0 += at * (t1 + at * (t2 + at * t3))
        t1 += at * (2.0 * t2 + 3.0 * at * t3)
        t2 += 3.0 * at * t3
    else:
        f = half * (1 / 3) * per_d
        t0, t1, t2, t3 = f * w * w * w, -3.0 * f * w * w, 3.0 * f * w, -f
    if inner:  # of the curvature: its piece next to the corner
        k3 = 7.0 / 36.0 * per_d
        k0 = at * (h * (1 / 6) - 0.25 * at + k3 * at * at)
        k1 = h * (1 / 6) - 0.5 * at + 3.0 * k3 * at * at
        k2 = -0.25 + 3.0 * k3 * at
    else:
        f = per_d / 36.0
        k0, k1, k2, k3 = f * w * w * w, -3.0 * f * w * w, 3.0 * f * w, -f
    for axis in range(6):
        t, k = turn[axis], side * bend[axis]
        x[0, axis] += t * t0 + k * k0
        x[1, axis] += side * (k * k1 + t * t1)
        x[2, axis] += t * t2 + k * k2
        x[3, axis] += side * (k * k3 + t * t3)


@inner
def _split(s: Segments, blends: Blends, path: Elements, cut: Floats) -> int:
    """Fill in the elements; return how many there are. ``cut`` is (6,)."""
    x, cosine, sine = path.poly, path.cosine, path.sine
    size, turn, bend, halved = blends.size, blends.turn, blends.bend, blends.halved
    e = 0
    for k in range(s.length.size):
        w, full = s.omega[k], s.length[k]
        before = size[k - 1, 1] if k > 0 else 0.0
        after = size[k, 0]
        sliver = max(SLIVER * full, OVERLAP * min(before, after))
        cut[0], count = 0.0, 1
        if before > 0.0:
            if halved[k - 1]:
                cut[count] = 0.5 * before
                count += 1
            cut[count] = before
            count += 1
        if after > 0.0:
            cut[count] = full - after
            count += 1
            if halved[k]:
                cut[count] = full - 0.5 * after
                count += 1
        for i in range(2, count):  # sort them: blends of lines may overlap
            for j in range(i, 1, -1):
                if cut[j] < cut[j - 1]:
                    cut[j - 1], cut[j] = cut[j], cut[j - 1]
        cut[count] = full
        begin = 0.0
        for i in range(1, count + 1):
            end = cut[i]
            if i < count and (end - begin <= sliver or full - end <= sliver):
                continue
            c, d = 1.0, 0.0
            for axis in range(6):
                cosine[e, axis] = sine[e, axis] = 0.0
            if w > 0.0:
                c, d = math.cos(w * begin), math.sin(w * begin)
                for axis in range(6):
                    cosine[e, axis] = s.cosine[k, axis] * c + s.sine[k, axis] * d
                    sine[e, axis] = s.sine[k, axis] * c - s.cosine[k, axis] * d
            for axis in range(6):
                x[e, 0, axis] = s.poly[k, 0, axis] + s.poly[k, 1, axis] * begin
                x[e, 1, axis] = s.poly[k, 1, axis]
                x[e, 2, axis] = x[e, 3, axis] = 0.0
            middle = 0.5 * (begin + end)
            if middle < before:
                near = middle < 0.5 * before
                _displace(x[e], turn[k - 1], bend[k - 1], before, size[k - 1, 0], begin, 1.0, near)
            if middle > full - after:
                near = full - middle < 0.5 * after
                at = min(full - begin, after)
                _displace(x[e], turn[k], bend[k], after, size[k, 1], at, -1.0, near)
            path.omega[e], path.length[e], path.dwell[e] = w, end - begin, s.dwell[k]
            path.move[e], path.feed[e], path.rest[e] = s.move[k], s.feed[k], False
            begin = end
            e += 1
        path.rest[e - 1] = blends.rest[k]
    return e
