"""Proof that a trajectory keeps its limits: bounds over all time, not samples.

Shares no code with the planner. Along polynomials the extremes of velocity and acceleration are
found exactly, from the stationary points; along arcs they are bounded by amplitudes. The distance
from the programmed path is bounded by the control polygon of the difference.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.errors import UsageError
from pulsewright.motion.machine import Machine
from pulsewright.motion.moves import AXES, MoveKind, Moves
from pulsewright.motion.trajectory import Trajectory

ROUNDING: Final = 1e-6  # allowed in positions, velocities and times [mm, degrees, s]
STILL: Final = 1e-8  # motion shorter than this is none [mm, degrees]
CHUNK: Final = 1 << 13  # pieces examined at once: bounds the memory, fits the cache

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Worst:
    """Where a limit is used most.

    Parameters
    ----------
    ratio : float
        Used over allowed; at most 1 where the limit holds.
    what : str
        The axis, or what is limited.
    line : int
        Line of the program; 0 for a program without moves.
    time : float
        Start of the piece [s].
    """

    ratio: float
    what: str
    line: int
    time: float


@dataclass(frozen=True)
class Certificate:
    """What a trajectory uses of its limits, at worst.

    Parameters
    ----------
    velocity, acceleration : tuple of Worst
        One per limit row of the machine.
    feed : Worst
        Path speed over programmed feed.
    path : Worst
        Distance from the programmed path over tolerance.
    deviation : float
        Largest distance from the programmed path, as a bound [mm, degrees].
    velocity_jump : float
        Largest difference of velocities where two pieces meet [mm/s, degrees/s].
    position_jump : float
        Largest gap where two pieces meet [mm, degrees].
    end_error : float
        Largest distance from the programmed position where the machine rests [mm, degrees].
    dwell_error : float
        Largest error of a dwell's time [s].
    missed_rests : int
        Moves at whose end the machine should rest, but does not.
    """

    velocity: tuple[Worst, ...]
    acceleration: tuple[Worst, ...]
    feed: Worst
    path: Worst
    deviation: float
    velocity_jump: float
    position_jump: float
    end_error: float
    dwell_error: float
    missed_rests: int

    @property
    def passed(self) -> bool:
        """Whether every promise is kept."""
        return not self.violations()

    def violations(self) -> tuple[str, ...]:
        """Return in words what is not kept."""
        found = [
            f"{kind} of {worst.what} reaches {worst.ratio:.6f} of its limit on line {worst.line} "
            f"at {worst.time:.6f} s"
            for kind, group in [
                ("velocity", self.velocity),
                ("acceleration", self.acceleration),
                ("path", (self.feed, self.path)),
            ]
            for worst in group
            if not worst.ratio <= 1 + 1e-9
        ]
        found += [
            f"{what.replace('_', ' ')} of {getattr(self, what):.3g}"
            for what in ("velocity_jump", "position_jump", "end_error", "dwell_error")
            if not getattr(self, what) <= ROUNDING
        ]
        if self.missed_rests:
            found.append(f"no rest after {self.missed_rests} moves that demand it")
        return tuple(found)

    def text(self) -> str:
        """Return the certificate for a person to read."""
        lines = [
            f"{kind:<13} "
            + ", ".join(f"{worst.what} {100 * worst.ratio:.2f} %" for worst in group)
            + " of the limits"
            for kind, group in [("velocity", self.velocity), ("acceleration", self.acceleration)]
        ]
        lines += [
            f"{'feed':<13} {100 * self.feed.ratio:.2f} % of the programmed feed",
            f"{'path':<13} within {self.deviation:.3g} mm, {100 * self.path.ratio:.2f} % of the "
            f"tolerance; velocity continuous within {self.velocity_jump:.1g} mm/s",
            *(f"VIOLATED      {violation}" for violation in self.violations()),
        ]
        return "\n".join(lines)

    def __str__(self) -> str:
        return "; ".join(self.violations()) or "all limits kept"


def certify(trajectory: Trajectory, moves: Moves, machine: Machine) -> Certificate:
    """Bound velocity, acceleration and deviation of a planned trajectory over all time.

    Raises
    ------
    UsageError
        If the trajectory has other axes than the moves, or pieces or elements of a shape that
        `plan` does not make: acceleration that changes within a piece, arcs of higher degree.
    """
    if not len(moves):
        return _nothing(machine)
    if trajectory.axes != len(AXES):
        raise UsageError(f"certify needs positions of {AXES}, not {trajectory.axes} coordinates")
    if trajectory.law[:, 3].any() or trajectory.poly[trajectory.omega != 0, 2:].any():
        raise UsageError("certify knows constant acceleration and arcs of degree 1 only")
    rows, velocity, acceleration = machine.limit_rows()
    motion = _Pieces(trajectory)
    line = moves.line[trajectory.move[trajectory.element]]
    velocity_use, acceleration_use = _limits(trajectory, motion, rows, velocity, acceleration)
    letters = machine.axes
    reference = _Reference(trajectory, moves)
    position_jump, velocity_jump = _jumps(trajectory, motion)
    feed = np.maximum(motion.v0, motion.v1) / reference.feed[trajectory.element]
    deviation, allowed = reference.deviation()
    use = (deviation / allowed)[trajectory.element]
    end_error, missed = reference.rests(motion)
    return Certificate(
        velocity=_worst(velocity_use, letters, line, trajectory.start),
        acceleration=_worst(acceleration_use, letters, line, trajectory.start),
        feed=_worst(feed[None], ["feed"], line, trajectory.start)[0],
        path=_worst(use[None], ["tolerance"], line, trajectory.start)[0],
        deviation=float(deviation.max()),
        velocity_jump=velocity_jump,
        position_jump=position_jump,
        end_error=end_error,
        dwell_error=reference.dwell_error(motion),
        missed_rests=missed,
    )


def _nothing(machine: Machine) -> Certificate:
    """Return the certificate of a program without moves."""
    unused = tuple(Worst(0.0, letter, 0, 0.0) for letter in machine.axes)
    feed, path = Worst(0.0, "feed", 0, 0.0), Worst(0.0, "tolerance", 0, 0.0)
    return Certificate(unused, unused, feed, path, 0.0, 0.0, 0.0, 0.0, 0.0, 0)


class _Pieces:
    """Path coordinate s and its rate v at both ends of each piece, and its acceleration a."""

    def __init__(self, trajectory: Trajectory) -> None:
        law, time = trajectory.law, np.diff(trajectory.start)
        self.time = time
        self.s0, self.v0, self.a = law[:, 0], law[:, 1], 2 * law[:, 2]
        self.s1 = self.s0 + (self.v0 + law[:, 2] * time) * time
        self.v1 = self.v0 + self.a * time


def _worst(
    use: Floats, names: str | list[str], line: NDArray[np.int32], start: Floats
) -> tuple[Worst, ...]:
    worst = np.argmax(use, axis=1)
    return tuple(
        Worst(float(use[r, k]), name, int(line[k]), float(start[k]))
        for r, (name, k) in enumerate(zip(names, worst, strict=True))
    )


def _limits(
    trajectory: Trajectory, motion: _Pieces, rows: Floats, velocity: Floats, acceleration: Floats
) -> tuple[Floats, Floats]:
    """Return the used share of velocity and acceleration of each row on each piece, (r, k)."""
    count = len(trajectory.element)
    v_use, a_use = np.zeros((len(rows), count)), np.zeros((len(rows), count))
    for first in range(0, count, CHUNK):
        part = slice(first, first + CHUNK)
        e, s0 = trajectory.element[part], motion.s0[part]
        h, a = motion.s1[part] - s0, motion.a[part]
        v0, v1 = motion.v0[part], motion.v1[part]
        p = np.moveaxis(trajectory.poly[e] @ rows.T, 1, 0)  # (4, k, r)
        cosine, sine = trajectory.cosine[e] @ rows.T, trajectory.sine[e] @ rows.T
        omega = trajectory.omega[e]
        s, step = s0[:, None], h[:, None]
        # the polynomial from the start of the piece on
        d1 = p[1] + (2 * p[2] + 3 * p[3] * s) * s
        d2 = 2 * p[2] + 6 * p[3] * s
        d3 = 6 * p[3]
        b0, rate = (v0**2)[:, None], a[:, None]
        # row acceleration f0 + f1 u + f2 u^2, u from the start of the piece
        f0, f1, f2 = d2 * b0 + d1 * rate, d3 * b0 + 3 * d2 * rate, 2.5 * d3 * rate
        speeds, accelerations = [], []
        for u in [np.zeros_like(step), step, *_roots(f0, f1, f2, step)]:
            b = np.maximum(b0 + 2 * rate * u, 0)
            speeds.append(np.abs(d1 + (d2 + 0.5 * d3 * u) * u) * np.sqrt(b))
        for u in [np.zeros_like(step), step, _vertex(f1, f2, step)]:
            accelerations.append(np.abs(f0 + (f1 + f2 * u) * u))
        v_row, a_row = np.max(speeds, axis=0), np.max(accelerations, axis=0)
        arc = np.flatnonzero(omega)
        if len(arc):
            w = omega[arc][:, None]
            swing = np.hypot(cosine[arc], sine[arc])
            span = (w * s[arc], w * (s + step)[arc])
            top = np.maximum(v0, v1)[arc][:, None]
            straight = np.abs(p[1][arc])
            c, d = cosine[arc], sine[arc]
            along = straight + w * swing * _largest_cosine(np.arctan2(-c, d), *span)
            bend = w**2 * swing * _largest_cosine(np.arctan2(d, c), *span)
            size = np.abs(rate[arc])
            apart = bend * top**2 + along * size
            turned = np.hypot(w**2 * swing * top**2, w * swing * size) + straight * size
            v_row[arc], a_row[arc] = along * top, np.minimum(apart, turned)
        v_use[:, part], a_use[:, part] = (v_row / velocity).T, (a_row / acceleration).T
    return v_use, a_use


def _roots(f0: Floats, f1: Floats, f2: Floats, step: Floats) -> tuple[Floats, Floats]:
    """Return both roots of a quadratic, moved into 0..step."""
    root = np.sqrt(np.maximum(f1 * f1 - 4 * f2 * f0, 0))
    q = -0.5 * (f1 + np.copysign(root, f1))
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = q / f2, f0 / q
    return _inside(first, step), _inside(second, step)


def _vertex(f1: Floats, f2: Floats, step: Floats) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        return _inside(-0.5 * f1 / f2, step)


def _inside(u: Floats, step: Floats) -> Floats:
    return np.asarray(np.clip(np.nan_to_num(u, nan=0.0), 0, step))


def _largest_cosine(phase: Floats, low: Floats, high: Floats) -> Floats:
    """Return the largest ``|cos(theta - phase)|`` for theta in low..high."""
    peak = np.floor((high - phase) / np.pi) * np.pi + phase  # the last one not above high
    ends = np.maximum(np.abs(np.cos(low - phase)), np.abs(np.cos(high - phase)))
    return np.where(peak >= low, 1.0, ends)


def _place(trajectory: Trajectory, element: NDArray[np.int32], s: Floats) -> tuple[Floats, Floats]:
    """Return x and dx/ds at s on elements."""
    s, w = s[:, None], trajectory.omega[element][:, None]
    p, c, d = trajectory.poly[element], trajectory.cosine[element], trajectory.sine[element]
    cos, sin = np.cos(w * s), np.sin(w * s)
    x = p[:, 0] + (p[:, 1] + (p[:, 2] + p[:, 3] * s) * s) * s + c * cos + d * sin
    return x, p[:, 1] + (2 * p[:, 2] + 3 * p[:, 3] * s) * s + w * (d * cos - c * sin)


def _jumps(trajectory: Trajectory, motion: _Pieces) -> tuple[float, float]:
    """Return the largest gap and the largest jump of velocity between pieces, and at the ends."""
    gap, jump = 0.0, 0.0
    e = trajectory.element
    for first in range(0, len(e), CHUNK):
        part = slice(first, first + CHUNK)
        after = slice(first + 1, first + 1 + CHUNK)
        x1, d1 = _place(trajectory, e[part], motion.s1[part])
        v1 = d1 * motion.v1[part][:, None]
        x0, d0 = _place(trajectory, e[after], motion.s0[after])
        v0 = d0 * motion.v0[after][:, None]
        n = len(x0)
        gap = max(gap, float(np.abs(x1[:n] - x0).max(initial=0)))
        jump = max(jump, float(np.abs(v1[:n] - v0).max(initial=0)))
        if n < len(x1):
            jump = max(jump, float(np.abs(v1[n:]).max()))
    _, d0 = _place(trajectory, e[:1], motion.s0[:1])
    return gap, max(jump, float(np.abs(d0 * motion.v0[0]).max()))


class _Reference:
    """The programmed path, run by run: a run is the moves that elements of one ``move`` stand for.

    A run is one move, or several lines that one chord stands for; besides moves of no length.
    Geometry is that of a trajectory's elements, of degree 1.
    """

    def __init__(self, trajectory: Trajectory, moves: Moves) -> None:
        self.trajectory, self.moves = trajectory, moves
        self.last, self.run = np.unique(trajectory.move, return_inverse=True)
        first = np.append(0, self.last[:-1] + 1)
        self.start, self.end = moves.starts()[first], moves.end[self.last]
        self.blend: NDArray[np.bool_] = np.asarray(trajectory.poly[:, 2:].any(axis=(1, 2)))
        self._trace()
        self._merge()
        self.feed = self.slowest[self.run]
        self.feed[self.blend] = np.minimum(self.feed[self.blend], self.slowest[self._after()])

    def _after(self) -> NDArray[np.intp]:
        """Return the run after each blend."""
        return np.minimum(self.run[self.blend] + 1, len(self.last) - 1)

    def _trace(self) -> None:
        """Find the geometry of each run from its last move."""
        moves, last = self.moves, self.last
        delta = self.end - self.start
        arc = np.flatnonzero(moves.kind[last] == MoveKind.ARC)
        plane, sweep = moves.plane[last[arc]].astype(np.intp), moves.sweep[last[arc]]
        columns = (plane[:, None] + [1, 2]) % 3
        pick = arc[:, None], columns
        center = moves.center[last[arc][:, None], columns]
        arm = self.start[pick] - center
        normal = arm[:, ::-1] * [-1, 1]
        cos, sin = np.cos(sweep)[:, None], np.sin(sweep)[:, None]
        delta[pick] = drift = self.end[pick] - center - arm * cos - normal * sin
        length = np.linalg.norm(delta[:, :3], axis=1)
        around = np.linalg.norm(arm, axis=1) * np.abs(sweep) + np.linalg.norm(drift, axis=1)
        length[arc] = np.hypot(around, delta[arc, plane])
        still = length < STILL
        length[still] = np.linalg.norm(delta[still, 3:], axis=1)
        self.base, self.along = self.start.copy(), np.zeros_like(delta)
        self.base[pick] = center
        np.divide(delta, length[:, None], out=self.along, where=length[:, None] > 0)
        self.cosine, self.sine = np.zeros_like(delta), np.zeros_like(delta)
        self.cosine[pick], self.sine[pick] = arm, normal * np.sign(sweep)[:, None]
        self.omega, self.length = np.zeros(len(last)), length
        self.omega[arc] = np.abs(sweep) / length[arc]

    def _merge(self) -> None:
        """Find feeds, tolerances, and how far moves lie from the chord that stands for them."""
        moves = self.moves
        moving = (np.abs(moves.end - moves.starts()) > STILL).any(axis=1)
        head = np.union1d(np.flatnonzero(moving | (moves.kind == MoveKind.ARC)), self.last)
        tolerance = np.where(moves.kind == MoveKind.DWELL, 0.0, moves.tolerance)
        tolerance = np.minimum.reduceat(tolerance, head)  # with those of moves of no length
        run = np.searchsorted(self.last, head)
        known = run < len(self.last)  # nothing moves after the last run
        head, tolerance, run = head[known], tolerance[known], run[known]
        inner = head != self.last[run]
        self.corner = tolerance[~inner]
        dwells = np.flatnonzero(moves.kind[self.last] == MoveKind.DWELL)
        self.corner[dwells[dwells > 0] - 1] = 0.0
        self.inner, self.chord = np.full(len(self.last), np.inf), np.zeros(len(self.last))
        np.minimum.at(self.inner, run[inner], tolerance[inner])
        rate = np.where(moves.rapid | (moves.kind == MoveKind.DWELL), np.inf, moves.feed)
        self.slowest = np.full(len(self.last), np.inf)
        np.minimum.at(self.slowest, run, rate[head])
        corner, q = moves.end[head], run
        span = self.end[q] - self.start[q]
        square = np.maximum((span**2).sum(axis=1), STILL**2)
        share = ((corner - self.start[q]) * span).sum(axis=1) / square
        apart = _norm(corner - self.start[q] - np.clip(share, 0, 1)[:, None] * span)
        np.maximum.at(self.chord, q[inner], apart[inner])
        back = np.flatnonzero(inner[:-1] & (np.diff(share) < 0))  # runs back: no chord may do that
        bent = np.isin(q, q[inner]) & (moves.kind[head] != MoveKind.LINE)  # nor replace an arc
        self.chord[q[back]] = self.chord[q[bent]] = np.inf

    def _taylor(self, run: NDArray[np.intp], s: Floats) -> list[Floats]:
        """Return coefficients of degree 0..3 of the reference around s."""
        w = self.omega[run][:, None]
        cos, sin = np.cos(w * s[:, None]), np.sin(w * s[:, None])
        here = self.cosine[run] * cos + self.sine[run] * sin
        turned = self.sine[run] * cos - self.cosine[run] * sin
        x = self.base[run] + self.along[run] * s[:, None] + here
        return [x, self.along[run] + w * turned, -(w**2) * here / 2, -(w**3) * turned / 6]

    def deviation(self) -> tuple[Floats, Floats]:
        """Return a bound on the distance from the programmed path, and the tolerance, (m,)."""
        t, blend, run = self.trajectory, self.blend, self.run
        half = np.where(blend, 0.5 * t.length, 0.0)
        begin = np.append(0.0, half[:-1])  # what the blend before took away
        away = np.zeros(len(run))
        w, cut = self.omega[run][:, None], begin[:, None]
        cos, sin = np.cos(w * cut), np.sin(w * cut)
        base = t.poly[:, 0] - self.base[run] - self.along[run] * cut
        rate = t.poly[:, 1] - self.along[run]
        cosine = t.cosine - np.where(w > 0, self.cosine[run] * cos + self.sine[run] * sin, 0)
        sine = t.sine - np.where(w > 0, self.sine[run] * cos - self.cosine[run] * sin, 0)
        skew = np.abs(t.omega - self.omega[run]) * t.length * _norm(t.cosine)
        away = np.maximum(_norm(base), _norm(base + rate * t.length[:, None]))
        away += _norm(cosine) + _norm(sine) + skew
        allowed = self.inner[run].copy()
        allowed[np.isinf(allowed)] = 0.0
        q, after, d = run[blend], self._after(), half[blend]
        curve = [t.poly[blend, n] for n in range(4)]
        sides = [
            (curve, self._taylor(q, self.length[q] - d), q),
            (_shifted(curve, d), self._taylor(after, np.zeros(len(d))), after),
        ]
        away[blend] = 0.0
        for ours, theirs, of in sides:
            rest = _norm(self.cosine[of]) * (self.omega[of] * d) ** 4 / 24
            far = _hull([a - b for a, b in zip(ours, theirs, strict=True)], d) + rest
            away[blend] = np.maximum(away[blend], far)
        allowed[blend] = self.corner[q]
        chord = self.chord[run].copy()
        chord[blend] = np.maximum(self.chord[q], self.chord[after])
        return away + chord, np.maximum(allowed, ROUNDING)

    def rests(self, motion: _Pieces) -> tuple[float, int]:
        """Return the largest error of position at rest, and the number of rests not made."""
        t = self.trajectory
        final = np.append(np.flatnonzero(np.diff(t.element)), len(t.element) - 1)
        still = np.zeros(len(t.length), bool)
        still[t.element[final]] = motion.v1[final] <= ROUNDING
        x, _ = _place(t, np.arange(len(t.length), dtype=np.int32), t.length)
        error = _norm(x - self.end[self.run])[still & ~self.blend].max(initial=0.0)
        error = max(error, float(_norm(x[-1:] - self.moves.end[-1:])[0]))
        begin, _ = _place(t, t.element[:1], motion.s0[:1])
        error = max(error, float(_norm(begin - self.moves.start)[0]))
        closing = np.append(np.flatnonzero(np.diff(self.run)), len(self.run) - 1)
        demanded = self.corner <= 0
        demanded[-1] = True
        kept = still[closing] & ~self.blend[closing]
        return float(error), int((demanded & ~kept).sum())

    def dwell_error(self, motion: _Pieces) -> float:
        """Return the largest difference between a programmed dwell and the time at rest [s]."""
        rest = (motion.v0 == 0) & (motion.v1 == 0)
        move = self.trajectory.move[self.trajectory.element[rest]]
        time = np.bincount(move, motion.time[rest], minlength=len(self.moves))
        dwell = np.where(self.moves.kind == MoveKind.DWELL, self.moves.dwell, 0.0)
        return float(np.abs(time - dwell).max())


def _norm(v: Floats) -> Floats:
    """Return the larger of the linear and the rotary length of each vector."""
    linear, rotary = np.linalg.norm(v[:, :3], axis=1), np.linalg.norm(v[:, 3:], axis=1)
    return np.asarray(np.maximum(linear, rotary))


def _shifted(c: list[Floats], u: Floats) -> list[Floats]:
    """Return the coefficients of cubics around u."""
    u = u[:, None]
    return [
        c[0] + (c[1] + (c[2] + c[3] * u) * u) * u,
        c[1] + (2 * c[2] + 3 * c[3] * u) * u,
        c[2] + 3 * c[3] * u,
        c[3],
    ]


def _hull(c: list[Floats], size: Floats) -> Floats:
    """Bound the length of cubics over 0..size by their control points."""
    a, b, d = c[1] * size[:, None], c[2] * size[:, None] ** 2, c[3] * size[:, None] ** 3
    points = [c[0], c[0] + a / 3, c[0] + 2 * a / 3 + b / 3, c[0] + a + b + d]
    return np.asarray(np.max([_norm(point) for point in points], axis=0))
