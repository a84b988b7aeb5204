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

from pulsewright.compiled import compiled, inner

NOTHING = 1e-8  # motion shorter than this is none [mm, degrees]
TANGENT = 1e-9  # tangents that differ less are equal; the jump in velocity is rounding
REVERSAL = -0.98  # cosine between tangents below which the machine stops in the corner
MERGE_SHARE = 0.42  # of the tolerance, for chords; the rest is for blends
LONGEST_RUN = 64  # moves that one chord may replace
BLEND_SHARE = 0.1  # of acceleration and jerk at full speed; a blend need not take less
SLIVER = 1e-13  # of a segment: so small a part is none; what it bends is rounding
OVERLAP = 1e-8  # of the smaller one of two blends on a segment: such a part of it is none, too
ROUNDING = 1e-11  # of positions, left of tolerances [mm, degrees]
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
    velocity: Floats  # (r,)
    acceleration: Floats  # (r,)
    jerk: Floats  # (r,)


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


@inner
def _square(x: float) -> float:
    """Return the square: ``x ** 2`` of Python is not always rounded like the compiled one."""
    return x * x


@inner
def _length(v: Floats, first: int) -> float:
    """Return the length of the linear (first = 0) or rotary (first = 3) part of a vector."""
    return math.sqrt(_square(v[first]) + _square(v[first + 1]) + _square(v[first + 2]))


@inner
def _norm(v: Floats) -> float:
    """Return the larger of the linear and the rotary length."""
    return max(_length(v, 0), _length(v, 3))


@compiled(error_model="numpy")
def kept_moves(
    start: Floats,
    kind: NDArray[np.int8],
    end: Floats,
    sweep: Floats,
    dwell: Floats,
    tolerance: Floats,
) -> tuple[Ints, Floats]:
    """Return the moves that do something, and the tolerance at the end of each of them.

    Moves without motion pass on their demand to rest.
    """
    kept, left = np.empty(kind.size, np.int64), np.empty(kind.size)
    last = start
    n = 0
    for i in range(kind.size):
        keep = sweep[i] != 0.0 if kind[i] == ARC else dwell[i] > 0.0
        if kind[i] == DWELL:
            if n > 0:
                left[n - 1] = 0.0
        else:
            for axis in range(6):
                keep |= abs(end[i, axis] - last[axis]) > NOTHING
        if keep:
            kept[n], left[n] = i, tolerance[i]
            n += 1
            if kind[i] == DWELL:
                left[n - 1] = 0.0
            else:
                last = end[i]
        elif n > 0:
            left[n - 1] = min(left[n - 1], tolerance[i])
    return kept[:n], left[:n]


@compiled(error_model="numpy")
def traced(
    start: Floats,
    kind: NDArray[np.int8],
    plane: NDArray[np.int8],
    end: Floats,
    center: Floats,
    sweep: Floats,
    feed: Floats,
    dwell: Floats,
    move: Ints,
    tolerance: Floats,
    limits: Limits,
) -> Segments:
    """Return the segments that end with each move of ``move``.

    ``start`` (6,) and the columns of the moves, (n,) or (n, axes), are those of `Moves`; ``move``
    and ``tolerance`` are (s,). Where the ends of an arc differ in radius, the difference is spread
    evenly over the arc.
    """
    n = move.size
    poly, cosine, sine = np.zeros((n, 2, 6)), np.zeros((n, 6)), np.zeros((n, 6))
    omega, length = np.zeros(n), np.zeros(n)
    top, ramp, pause, speed = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    delta, work = np.empty(6), np.empty((4, limits.velocity.size))
    x = start.copy()
    for k in range(n):
        i = move[k]
        for axis in range(6):
            delta[axis] = end[i, axis] - x[axis]
            poly[k, 0, axis] = x[axis]
        if kind[i] == DWELL:
            pause[k] = dwell[i]
            continue
        turn = 0.0
        if kind[i] == ARC:
            a, b = (plane[i] + 1) % 3, (plane[i] + 2) % 3
            u, v = x[a] - center[i, a], x[b] - center[i, b]
            c, s = math.cos(sweep[i]), math.sin(sweep[i])
            delta[a] = end[i, a] - (center[i, a] + u * c - v * s)
            delta[b] = end[i, b] - (center[i, b] + v * c + u * s)
            sign = math.copysign(1.0, sweep[i])
            poly[k, 0, a], poly[k, 0, b] = center[i, a], center[i, b]
            cosine[k, a], cosine[k, b] = u, v
            sine[k, a], sine[k, b] = -sign * v, sign * u
            turn = abs(sweep[i])
            around = math.hypot(u, v) * turn + math.hypot(delta[a], delta[b])
            length[k] = math.hypot(around, delta[plane[i]])
        else:
            length[k] = _length(delta, 0)
        if length[k] < NOTHING:
            length[k] = _length(delta, 3)
        for axis in range(6):
            poly[k, 1, axis] = delta[axis] / length[k]
            x[axis] = end[i, axis]
        omega[k] = turn / length[k]
        speed[k] = feed[i]
        top[k], ramp[k] = _limits(
            poly[k, 1], cosine[k], sine[k], omega[k], turn, feed[i], limits, work
        )
    return Segments(poly, cosine, sine, omega, length, move, speed, pause, tolerance, top, ramp)


@compiled(error_model="numpy")
def _peaks(
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
def _limits(
    straight: Floats,
    cosine: Floats,
    sine: Floats,
    omega: float,
    turn: float,
    feed: float,
    limits: Limits,
    work: Floats,
) -> tuple[float, float]:
    """Return the largest square of the speed, and the path acceleration possible up to it."""
    line, swing = work[0], work[1]  # parts of x' along each row
    along, bend = work[2], work[3]  # largest x' and x'' along each row
    count, cos, sin = limits.velocity.size, 1.0, 0.0
    if turn > 0.0:
        cos, sin = math.cos(turn), math.sin(turn)
    top = feed * feed
    for r in range(count):
        line[r], swing[r], bend[r] = 0.0, 0.0, 0.0
        for axis in range(6):
            line[r] += limits.rows[r, axis] * straight[axis]
        line[r] = along[r] = abs(line[r])
        if turn > 0.0:
            c, s = 0.0, 0.0
            for axis in range(6):
                c += limits.rows[r, axis] * cosine[axis]
                s += limits.rows[r, axis] * sine[axis]
            swing[r] = omega * math.hypot(c, s)
            slope, wave = _peaks(c, s, 1.0, 0.0, cos, sin, turn)
            along[r] += omega * slope
            bend[r] = omega * omega * wave
        if along[r] > 0.0:
            top = min(top, _square(limits.velocity[r] / along[r]))
        if bend[r] > 0.0:
            top = min(top, ARC_SHARE * limits.acceleration[r] / bend[r])
        if swing[r] > 0.0:
            top = min(top, (ARC_JERK * limits.jerk[r] / (_square(omega) * swing[r])) ** (2 / 3))
    ramp = math.inf
    for r in range(count):
        if along[r] > 0.0:
            limit = limits.acceleration[r]
            best = (limit - bend[r] * top) / along[r]  # both at their worst at once
            full = omega * swing[r] * top
            if full < limit:  # x'' and x' of a turning point are a quarter turn apart
                free = limit * limit - full * full
                wider = _square(swing[r]) - _square(line[r])
                root = _square(limit * line[r]) + wider * free
                best = max(best, free / (limit * line[r] + math.sqrt(root)))
            ramp = min(ramp, best)
    return top, ramp


@inner
def _size_needed(e1: Floats, e2: Floats, top: float, limits: Limits) -> float:
    """Return the size of a blend that takes all acceleration or jerk at a square of the speed."""
    size, cube = 0.0, top * math.sqrt(top)
    for r in range(limits.acceleration.size):
        turn = 0.0
        for axis in range(6):
            turn += limits.rows[r, axis] * (e2[axis] - e1[axis])
        size = max(size, abs(turn) * top / (2.0 * limits.acceleration[r]))
        size = max(size, math.sqrt(abs(turn) * cube / limits.jerk[r]))
    return size


@compiled(error_model="numpy")
def merged(s: Segments, collapse: Floats, limits: Limits) -> tuple[Ints, Floats]:
    """Choose runs of lines to replace by their chords, in X, Y, Z and of one feed.

    Within the tolerance, runs that would slow the machine down, and of lines too short to stop in:
    longer ones have room to change speed. Where more is allowed by ``collapse`` (s,), all runs that
    lie so near to their chord; what it allows beyond the tolerance is the chords' alone.

    Returns
    -------
    last : (k,) int64
        The last segment of each run; runs of single segments stay what they are.
    tolerance : (k,) float64
        What is left of the tolerance for the blend after each run.
    """
    n = s.length.size
    last, used, left = np.empty(n, np.int64), np.zeros(n + 1), np.empty(n)
    wide = np.full(n + 1, np.inf)  # what all deviations of a run together may be
    short = np.empty(n, np.bool_)
    for j in range(n):
        loose = collapse[j] > s.tolerance[j] > 0.0
        short[j] = s.omega[j] == 0.0 and (loose or 2.0 * s.ramp[j] * s.length[j] < s.top[j])
        for axis in range(3, 6):
            short[j] &= s.poly[j, 1, axis] == 0.0
    k, i = 0, 0
    while i < n:
        j = i
        more = collapse[i] - s.tolerance[i] if collapse[i] > s.tolerance[i] > 0.0 else 0.0
        worst, tight = 0.0, more > 0.0
        while (
            j + 1 < n
            and j - i < LONGEST_RUN
            and short[j]
            and short[j + 1]
            and s.feed[j + 1] == s.feed[i]
            and s.tolerance[j] == s.tolerance[i]
            and collapse[j + 1] == collapse[i]
        ):
            far = _chord_distance(s.poly, s.length, i, j + 1)
            if far < 0.0 or far > more + MERGE_SHARE * s.tolerance[i]:
                break
            room = 0.5 * min(s.length[j], s.length[j + 1])
            tight |= room < _size_needed(s.poly[j, 1], s.poly[j + 1, 1], s.top[j], limits)
            worst = far
            j += 1
        if tight:
            last[k], used[k] = j, worst
            wide[k] = more + s.tolerance[i] if j > i else np.inf
            k += 1
            i = j + 1
        else:
            for single in range(i, max(j, i + 1)):
                last[k] = single
                k += 1
            i = max(j, i + 1)
    for q in range(k):
        left[q] = s.tolerance[last[q]]
        if left[q] > 0.0:
            for run in range(q, q + 2):
                left[q] = min(left[q], wide[run] - used[run])
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


@inner
def _tangent(s: Segments, k: int, at: float, out: Floats, bend: Floats) -> None:
    """Put the first two derivatives of segment ``k`` at ``at`` into ``out`` and ``bend``."""
    w = s.omega[k]
    c, d = 1.0, 0.0
    if w != 0.0:
        c, d = math.cos(w * at), math.sin(w * at)
    for axis in range(6):
        out[axis] = s.poly[k, 1, axis] + w * (s.sine[k, axis] * c - s.cosine[k, axis] * d)
        bend[axis] = -w * w * (s.cosine[k, axis] * c + s.sine[k, axis] * d)


@inner
def _of_use(turn: Floats, bend: Floats, top: float, ramp: float, limits: Limits) -> float:
    """Return the size of a blend that hinders little: a larger one is of no use.

    ``turn`` and ``bend`` are the jumps of the first two derivatives, ``top`` the square of speed.
    """
    size = SHORT_BLEND * top / (2.0 * ramp)
    for r in range(limits.acceleration.size):
        first, second = 0.0, 0.0
        for axis in range(6):
            first += limits.rows[r, axis] * turn[axis]
            second += limits.rows[r, axis] * bend[axis]
        first, second = abs(first) / BLEND_SHARE, abs(second) / BLEND_SHARE
        hasty = top * math.sqrt(top) / limits.jerk[r]
        size = max(size, first * top / limits.acceleration[r], math.sqrt(first * hasty))
        size = max(size, 7.0 / 6.0 * second * hasty)
    return size


@inner
def _is_hasty(turn: Floats, size: float, top: float, limits: Limits) -> bool:
    """Return whether the jerk limits the speed on a blend, or is near to it.

    ``turn`` is the jump of the tangent, ``top`` the square of the speed beside the blend.
    """
    bent, twisted = top, math.inf  # squares of speeds
    for r in range(limits.acceleration.size):
        first = 0.0
        for axis in range(6):
            first += limits.rows[r, axis] * turn[axis]
        first = abs(first)
        if first > 0.0:
            bent = min(bent, limits.acceleration[r] * size / first)
            twisted = min(twisted, (limits.jerk[r] * size * size / first) ** (2 / 3))
    return HASTY * twisted < bent


@compiled(error_model="numpy")
def blends(s: Segments, limits: Limits) -> tuple[Floats, Floats, Floats, Flags]:
    """Choose the blends.

    As large as the tolerance allows, but not larger than of use, so that lines remain to change
    speed on. The sizes on both sides of a corner are equal, but where the jerk limits the speed and
    the lines there are of nearly one length: then the blend takes all of both. So it ends where the
    next blends have their peaks, as on the chords of a curve whose lengths differ by rounding: ever
    so short a part that only one of them bends would allow no more speed than a corner.

    Returns
    -------
    size : (s, 2) float64
        Path coordinate that the blend at the end of each segment takes of it and of the next; 0
        where there is none.
    turn, bend : (s, 6) float64
        Jumps of the first two derivatives there.
    rest : (s,) bool
        Whether the machine comes to rest at the end of the segment.
    """
    n = s.length.size
    # where there is no blend, too, half of the segment is left to others at most: none vanishes
    wanted, size, rest = np.full(n, math.inf), np.zeros((n, 2)), np.zeros(n, np.bool_)
    turn, bend, curved = np.zeros((n, 6)), np.zeros((n, 6)), np.zeros(n, np.bool_)
    work = np.empty((4, 6))
    e1, e2, c1, c2 = work[0], work[1], work[2], work[3]
    for k in range(n):
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
        square = (_square(_length(e1, 0)) + _square(_length(e1, 3))) * (
            _square(_length(e2, 0)) + _square(_length(e2, 3))
        )
        angle, more = _norm(turn[k]), _norm(bend[k])
        curved[k] = s.omega[k] > 0.0 or s.omega[k + 1] > 0.0
        rest[k] = dot <= REVERSAL * math.sqrt(square)
        if rest[k] or (angle <= TANGENT and more <= TANGENT):
            continue
        top, ramp = min(s.top[k], s.top[k + 1]), min(s.ramp[k], s.ramp[k + 1])
        free = s.tolerance[k] * (1.0 - 1e-9) - ROUNDING
        first, second = CORNER_PART * angle, CURVE_PART * more
        wanted[k] = 2.0 * free / (first + math.sqrt(first * first + 4.0 * second * free))
        wanted[k] = min(wanted[k], _of_use(turn[k], bend[k], top, ramp, limits))
        widest = max(s.omega[k], s.omega[k + 1])
        if widest > 0.0:
            wanted[k] = min(wanted[k], WIDEST_ARC / widest)
    for k in range(n - 1):
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
            rest[k] = True
    return size, turn, bend, rest


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
    w, h = d - at, 0.5 * d
    peak = 2.0 / (d + other)
    more = peak * (other - d) / (1.5 * d)
    half = 0.5 * peak + more
    if inner and d != other:
        t0, t1 = peak * d * other / 6.0, -h * (peak + more)  # at the corner
        t2, t3 = 0.5 * peak, (half - peak) / (3.0 * d)
        t0 += at * (t1 + at * (t2 + at * t3))
        t1 += at * (2.0 * t2 + 3.0 * at * t3)
        t2 += 3.0 * at * t3
    else:
        f = half / (3.0 * d)
        t0, t1, t2, t3 = f * w * w * w, -3.0 * f * w * w, 3.0 * f * w, -f
    if inner:  # of the curvature: its piece next to the corner
        k0 = at * (h / 6.0 - 0.25 * at + 7.0 / 72.0 * at * at / h)
        k1 = h / 6.0 - 0.5 * at + 7.0 / 24.0 * at * at / h
        k2, k3 = -0.25 + 7.0 / 24.0 * at / h, 7.0 / 72.0 / h
    else:
        f = 1.0 / (72.0 * h)
        k0, k1, k2, k3 = f * w * w * w, -3.0 * f * w * w, 3.0 * f * w, -f
    for axis in range(6):
        t, k = turn[axis], side * bend[axis]
        x[0, axis] += t * t0 + k * k0
        x[1, axis] += side * (k * k1 + t * t1)
        x[2, axis] += t * t2 + k * k2
        x[3, axis] += side * (k * k3 + t * t3)


@compiled(error_model="numpy")
def elements(s: Segments, size: Floats, turn: Floats, bend: Floats, rest: Flags) -> Elements:
    """Split the segments where blends begin, change or end, and add the displacements."""
    n = s.length.size
    m, halved = n, np.zeros(n, np.bool_)  # blends that change in the middle of their sides
    for k in range(n):
        if size[k, 0] > 0.0:
            halved[k] = s.omega[k] > 0.0 or s.omega[k + 1] > 0.0 or size[k, 0] != size[k, 1]
            m += 4 if halved[k] else 2
    x = np.empty((m, 4, 6))
    cosine, sine = np.zeros((m, 6)), np.zeros((m, 6))
    omega, length, dwell, feed = np.zeros(m), np.empty(m), np.zeros(m), np.empty(m)
    move, still = np.empty(m, np.int32), np.zeros(m, np.bool_)
    cut = np.empty(6)
    e = 0
    for k in range(n):
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
            omega[e], length[e], dwell[e] = w, end - begin, s.dwell[k]
            move[e], feed[e] = s.move[k], s.feed[k]
            begin = end
            e += 1
        still[e - 1] = rest[k]
    return Elements(
        x[:e],
        cosine[:e],
        sine[:e],
        omega[:e],
        length[:e],
        move[:e],
        dwell[:e],
        feed[:e],
        still[:e],
    )
