"""Proof that a trajectory keeps its limits: bounds over all time, not samples.

Shares no code with the planner. Velocity, acceleration and jerk are bounded by intervals, on ever
smaller parts where they are large: see `certificate_kernels`. The distance from the programmed path
at the same path coordinate is bounded by the control polygon of the difference.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import uncompiled
from pulsewright.errors import UsageError
from pulsewright.motion.machine import Machine
from pulsewright.motion.moves import AXES, MoveKind, Moves
from pulsewright.motion.trajectory import Trajectory

ROUNDING: Final = 1e-6  # allowed in positions, velocities and times [mm, degrees, s]
STILL: Final = 1e-8  # motion shorter than this is none [mm, degrees]
PORTION: Final = 1 << 16  # pieces that are looked at together, for little memory
CLOSE: Final = 1e-3  # jump of acceleration that counts as none [mm/s^2, degrees/s^2]

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
    velocity, acceleration, jerk : tuple of Worst
        One per limit row of the machine.
    feed : Worst
        Path speed over programmed feed, along the path as programmed. The way over a blend is
        shorter at a corner, and a little longer where arcs bend to opposite sides: the tool is
        faster than the feed there (by 0.35 % at most in 1400 random programs).
    path : Worst
        Distance from the programmed path over tolerance.
    deviation : float
        Largest distance from the programmed path, as a bound [mm, degrees].
    velocity_jump : float
        Largest difference of velocities where two pieces meet [mm/s, degrees/s].
    acceleration_jump : float
        Largest difference of accelerations where two pieces meet [mm/s^2, degrees/s^2].
    position_jump : float
        Largest gap where two pieces meet [mm, degrees].
    end_error : float
        Largest distance from the programmed position where the machine has to rest [mm, degrees].
    dwell_error : float
        Largest error of a dwell's time [s].
    missed_rests : int
        Moves at whose end the machine should rest, but does not.
    """

    velocity: tuple[Worst, ...]
    acceleration: tuple[Worst, ...]
    jerk: tuple[Worst, ...]
    feed: Worst
    path: Worst
    deviation: float
    velocity_jump: float
    acceleration_jump: float
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
                ("jerk", self.jerk),
                ("path", (self.feed, self.path)),
            ]
            for worst in group
            if not worst.ratio <= 1 + 1e-9
        ]
        found += [
            f"{what.replace('_', ' ')} of {getattr(self, what):.3g}"
            for what, allowed in [
                ("velocity_jump", ROUNDING),
                ("acceleration_jump", CLOSE),
                ("position_jump", ROUNDING),
                ("end_error", ROUNDING),
                ("dwell_error", ROUNDING),
            ]
            if not getattr(self, what) <= allowed
        ]
        if self.missed_rests:
            found.append(f"no rest after {self.missed_rests} moves that demand it")
        return tuple(found)

    def to_json(self) -> dict[str, Any]:
        """Return the certificate in plain types, with whether it passed and what is not kept."""
        return {"passed": self.passed, "violations": list(self.violations()), **asdict(self)}

    def text(self) -> str:
        """Return the certificate for a person to read."""
        lines = [
            f"{kind:<13} "
            + ", ".join(f"{worst.what} {100 * worst.ratio:.2f} %" for worst in group)
            + " of the limits"
            for kind, group in [
                ("velocity", self.velocity),
                ("acceleration", self.acceleration),
                ("jerk", self.jerk),
            ]
        ]
        lines += [
            f"{'feed':<13} {100 * self.feed.ratio:.2f} % of the programmed feed",
            f"{'path':<13} within {self.deviation:.3g} mm, {100 * self.path.ratio:.2f} % of the "
            f"tolerance; velocity continuous within {self.velocity_jump:.1g} mm/s, acceleration "
            f"within {self.acceleration_jump:.1g} mm/s^2",
            *(f"VIOLATED      {violation}" for violation in self.violations()),
        ]
        return "\n".join(lines)

    def __str__(self) -> str:
        return "; ".join(self.violations()) or "all limits kept"


def certify(trajectory: Trajectory, moves: Moves, machine: Machine) -> Certificate:
    """Bound velocity, acceleration, jerk and deviation of a planned trajectory over all time.

    Raises
    ------
    UsageError
        If the trajectory has other axes than the moves, or them in another order, or cannot be as
        it is, see `Trajectory.require_sound`.
    """
    trajectory.require_sound()
    if not len(moves):
        return _nothing(machine)
    certifier = Certifier(machine, moves.start)
    certifier.add(moves)
    for part in _portions(trajectory):
        certifier.check_sound(part)
    return certifier.finish()


class Certifier:
    """The certificate of a motion that comes in parts; memory is bounded by the parts.

    The machine rests before the first part and after the last one; in between, position, velocity
    and acceleration go on without a jump.

    Parameters
    ----------
    machine : Machine
    start : (6,) float
        Where the motion begins [mm, degrees].
    """

    def __init__(self, machine: Machine, start: Floats) -> None:
        self._machine = machine
        self._limits = machine.limit_rows()
        self._state = np.zeros((3, len(AXES)))  # at the end of the last part
        self._state[0] = start
        self._moves: Moves | None = None  # from the first one of the run in which that part ended
        self._first = 0  # how many moves there were before
        self._run = -1  # the last move of that run
        self._corners = 0.0, 0.0  # tolerance before and after that run
        self._way = self._length = 0.0  # path coordinate reached in that run, and its end
        self._waited = self._due = 0.0  # time at rest in it, and what is programmed [s]
        self._zero = self._end = 0.0  # where the time of a part begins, and where it ends [s]
        self._whole = _nothing(machine)

    def add(self, moves: Moves) -> None:
        """Say which moves follow."""
        self._moves = moves if self._moves is None else self._moves.followed_by(moves)

    def check(self, trajectory: Trajectory, override: Floats | float = 1.0) -> Certificate:
        """Return the certificate of the next part; what it ends in the middle of, goes on later.

        Parameters
        ----------
        trajectory : Trajectory
            Its ``move`` counts from the first move of all; it has all elements of each move that it
            has pieces of. Its time begins with 0, or goes on with that of the part before.
        override : (k,) float or float
            Of the feed, on each piece; moves that keep to the spindle have none.

        Raises
        ------
        UsageError
            If the trajectory has other axes than the moves, or moves that are not known yet or in
            another order, or cannot be as it is, see `Trajectory.require_sound`.
        """
        trajectory.require_sound(begin=None)
        return self.check_sound(trajectory, override)

    def check_sound(self, trajectory: Trajectory, override: Floats | float = 1.0) -> Certificate:
        """Return what `check` does, for a trajectory of which it is known that it is sound."""
        if trajectory.axes != len(AXES):
            raise UsageError(
                f"certify needs positions of {AXES}, not {trajectory.axes} coordinates"
            )
        from pulsewright.motion import certificate_kernels as kernels

        run = self._run
        t, moves, corner = self._local(trajectory)
        rows, velocity, acceleration = self._limits
        columns = (t.poly, t.cosine, t.sine, t.omega, t.element, t.start, t.law)
        limits = np.stack([velocity, acceleration, self._machine.jerk_limits()])
        if t.start[0] == 0:
            self._zero = self._end
        reference, entry = _Reference(t, moves, corner), self._state.copy()
        with uncompiled(len(reference.last)):
            use, where = kernels.worst(*columns, rows, limits)
            jumps = kernels.jumps(*columns, self._state)
            deviation, allowed = reference.deviation()
        motion = _Pieces(t)
        deviation += motion.beyond(t)
        free = moves.pitch[t.move[t.element]] == 0
        feed = motion.fastest / (reference.feed[t.element] * np.where(free, override, 1.0))
        feed[motion.slowest < -ROUNDING] = np.inf  # never backwards
        off = deviation / allowed
        farthest = int(np.searchsorted(t.element, off.argmax()))  # the first piece there
        end_error, missed = reference.rests(motion)
        if trajectory.move[0] > run >= 0 and corner <= 0:  # a rest between two parts
            missed += bool(np.abs(entry[1]).max() > ROUNDING)
        skipped = self._skipped(trajectory, motion)

        def place(use: float, what: str, k: int) -> Worst:
            line = int(moves.line[t.move[t.element[k]]])
            return Worst(float(use), what, line, self._zero + float(t.start[k]))

        def group(n: int) -> tuple[Worst, ...]:
            axes = self._machine.axes
            return tuple(place(*worst) for worst in zip(use[n], axes, where[n], strict=True))

        part = Certificate(
            velocity=group(0),
            acceleration=group(1),
            jerk=group(2),
            feed=place(feed.max(), "feed", int(feed.argmax())),
            path=place(off.max(), "tolerance", min(farthest, len(t.element) - 1)),
            deviation=float(deviation.max()),
            velocity_jump=float(jumps[1]),
            acceleration_jump=float(jumps[2]),
            position_jump=max(float(jumps[0]), skipped),
            end_error=end_error,
            dwell_error=self._dwell_error(t, moves, motion),
            missed_rests=missed,
        )
        self._whole = _worse(self._whole, part)
        self._end = self._zero + t.duration
        begin = int(reference.last[-2]) + 1 if len(reference.last) > 1 else 0
        before = float(reference.corner[-2]) if begin else corner
        self._corners = before, float(reference.corner[-1])
        self._drop(begin)
        return part

    def finish(self) -> Certificate:
        """Return the certificate of all parts, which end with the last move."""
        moves = self._moves
        if moves is None or not len(moves):
            return self._whole
        done = self._run + 1 - self._first
        left = np.abs(moves.end[-1] - self._state[0]).max()
        moving = (np.abs(moves.end - moves.starts()) > ROUNDING).any(axis=1)
        if (moving | (moves.kind == MoveKind.ARC))[done:].any():
            left = np.inf  # moves are missing
        dwells = moves.kind == MoveKind.DWELL
        undone = float(moves.dwell[done:][dwells[done:]].sum())
        ending = replace(
            _nothing(self._machine),
            end_error=float(left),
            velocity_jump=float(np.abs(self._state[1]).max()),
            acceleration_jump=float(np.abs(self._state[2]).max()),
            position_jump=self._length - self._way,
            dwell_error=max(abs(self._waited - self._due), undone),
        )
        self._whole = _worse(self._whole, ending)
        return self._whole

    def _local(self, trajectory: Trajectory) -> tuple[Trajectory, Moves, float]:
        """Return a part and the moves it stands for, both from its first run on.

        The moves go on with those that do not move, which may demand a rest. Also return the
        tolerance before them.
        """
        first, last = int(trajectory.move[0]), int(trajectory.move[-1])
        known = self._first + (0 if self._moves is None else len(self._moves))
        if self._moves is None or not self._first <= first or last >= known:
            raise UsageError(
                f"certify was given moves {self._first} to {known - 1}, and then a trajectory of "
                f"{first} to {last}; add moves first, and check parts in order"
            )
        back = np.flatnonzero(np.diff(trajectory.move) < 0)
        if len(back):
            at = int(back[0]) + 1
            raise UsageError(
                f"certify was given a trajectory whose element {at} is of move "
                f"{trajectory.move[at]}, after one of move {trajectory.move[at - 1]}; elements "
                f"have to follow in the order of their moves"
            )
        corner = self._corners[0]
        if first > self._run >= 0:  # the run before has ended
            self._drop(self._run + 1 - self._first)
            corner = self._corners[1]
        moves, stop = self._moves, last + 1 - self._first
        while stop < len(moves) and moves.kind[stop] != MoveKind.ARC:
            if (np.abs(moves.end[stop] - moves.end[stop - 1]) > STILL).any():
                break
            stop += 1
        local = replace(trajectory, move=trajectory.move - self._first)
        return local, moves.part(0, stop), corner

    def _drop(self, count: int) -> None:
        """Forget the first moves."""
        if self._moves is not None:
            self._moves = self._moves.part(count)
        self._first += count

    def _skipped(self, t: Trajectory, motion: _Pieces) -> float:
        """Return the largest part of the path that is left out between pieces [mm, degrees].

        Where the path crosses itself, position has no jump there.
        """
        way = np.append(0.0, t.length.cumsum())
        begin, end = way[t.element] + motion.s0, way[t.element] + motion.s1
        entry = begin[0] - self._way
        if t.move[0] != self._run:  # another run begins
            entry = max(abs(begin[0]), abs(self._length - self._way))
        here = np.flatnonzero(t.move == t.move[-1])[0]
        self._way, self._length = float(end[-1] - way[here]), float(way[-1] - way[here])
        return max(abs(float(entry)), float(np.abs(begin[1:] - end[:-1]).max(initial=0.0)))

    def _dwell_error(self, t: Trajectory, moves: Moves, motion: _Pieces) -> float:
        """Return the largest difference between a programmed dwell and the time at rest [s].

        A dwell at the end may go on in the next part.
        """
        rest = (motion.v0 == 0) & (motion.v1 == 0)
        time = np.bincount(t.move[t.element[rest]], motion.time[rest], minlength=len(moves))
        dwell = np.where(moves.kind == MoveKind.DWELL, moves.dwell, 0.0)
        first, last = int(t.move[0]), int(t.move[-1])
        error = 0.0
        if first + self._first == self._run:
            time[first] += self._waited
        else:
            error = abs(self._waited - self._due)
        self._run = last + self._first
        self._waited, self._due = float(time[last]), float(dwell[last])
        return max(error, float(np.abs(time - dwell)[:last].max(initial=0.0)))


def _portions(trajectory: Trajectory) -> Iterator[Trajectory]:
    """Yield a trajectory in parts of about `PORTION` pieces, each of whole moves."""
    t = trajectory
    pieces, elements = len(t.element), len(t.move)
    if (np.diff(t.move) < 0).any():  # `Certifier.check` says so
        yield t
        return
    begin = first = 0
    while begin < pieces:
        end, last = pieces, elements
        if begin + PORTION < pieces:
            last = int(np.searchsorted(t.move, t.move[t.element[begin + PORTION]], "right"))
            end = int(np.searchsorted(t.element, last))
        element, start = t.element[begin:end] - np.int32(first), t.start[begin : end + 1]
        yield t.timed(element, start, t.law[begin:end], slice(first, last))
        begin, first = end, last


def _worse(a: Certificate, b: Certificate) -> Certificate:
    """Return the worst of two certificates of parts of a motion."""
    worst: dict[str, Any] = {}
    for field in fields(Certificate):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if field.name == "missed_rests":
            worst[field.name] = x + y
        elif isinstance(x, tuple):
            worst[field.name] = tuple(
                q if not q.ratio <= p.ratio else p for p, q in zip(x, y, strict=True)
            )
        elif isinstance(x, Worst):
            worst[field.name] = y if not y.ratio <= x.ratio else x
        else:
            worst[field.name] = y if not y <= x else x
    return Certificate(**worst)


def _nothing(machine: Machine) -> Certificate:
    """Return the certificate of a program without moves."""
    unused = tuple(Worst(0.0, letter, 0, 0.0) for letter in machine.axes)
    feed, path = Worst(0.0, "feed", 0, 0.0), Worst(0.0, "tolerance", 0, 0.0)
    return Certificate(unused, unused, unused, feed, path, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)


class _Pieces:
    """Path coordinate and its rate at both ends of each piece, and the extremes of the rate."""

    def __init__(self, trajectory: Trajectory) -> None:
        law, time = trajectory.law, np.diff(trajectory.start)
        self.time = time
        self.s0, self.v0 = law[:, 0], law[:, 1]
        self.s1 = self.s0 + (self.v0 + (law[:, 2] + law[:, 3] * time) * time) * time
        self.v1 = self.v0 + (2 * law[:, 2] + 3 * law[:, 3] * time) * time
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = np.nan_to_num(np.clip(-law[:, 2] / (3 * law[:, 3]), 0, time))
        top = self.v0 + (2 * law[:, 2] + 3 * law[:, 3] * turn) * turn
        self.fastest = np.maximum(np.abs(self.v0), np.abs(self.v1))
        np.maximum(self.fastest, np.abs(top), out=self.fastest)
        self.slowest = np.minimum(np.minimum(self.v0, self.v1), top)

    def beyond(self, t: Trajectory) -> Floats:
        """Return how far pieces lead beyond the ends of each element at most, (m,)."""
        back = np.maximum(-self.slowest, 0.0) * self.time
        low, high = np.minimum(self.s0, self.s1) - back, np.maximum(self.s0, self.s1) + back
        far = np.maximum(-low, high - t.length[t.element])
        k = np.flatnonzero(far > STILL)
        e, far = t.element[k], far[k]
        s, p = (t.length[e] + far)[:, None], np.abs(t.poly[e])
        rate = p[:, 1] + (2 * p[:, 2] + 3 * p[:, 3] * s) * s
        rate += np.abs(t.omega[e])[:, None] * (np.abs(t.cosine[e]) + np.abs(t.sine[e]))
        far *= _norm(rate)
        beyond = np.zeros(len(t.length))
        np.maximum.at(beyond, e, np.where(far > ROUNDING, far, 0.0))
        return beyond


def _place(trajectory: Trajectory, element: NDArray[np.int32], s: Floats) -> Floats:
    """Return x at s on elements."""
    s, w = s[:, None], trajectory.omega[element][:, None]
    p, c, d = trajectory.poly[element], trajectory.cosine[element], trajectory.sine[element]
    x = p[:, 0] + (p[:, 1] + (p[:, 2] + p[:, 3] * s) * s) * s + c * np.cos(w * s)
    return np.asarray(x + d * np.sin(w * s))


class _Reference:
    """The programmed path, run by run: a run is the moves that elements of one ``move`` stand for.

    A run is one move, or several lines that one chord stands for; besides moves of no length.
    Geometry is that of a trajectory's elements, of degree 1.
    """

    def __init__(self, trajectory: Trajectory, moves: Moves, corner: float) -> None:
        self.trajectory, self.moves, self.before = trajectory, moves, corner
        new = np.diff(trajectory.move, prepend=trajectory.move[0]) != 0
        self.run = np.cumsum(new)
        self.last = trajectory.move[np.append(0, np.flatnonzero(new))]
        first = np.append(0, self.last[:-1] + 1)
        self.start, self.end = moves.starts()[first], moves.end[self.last]
        self._trace()
        self._merge()
        self.feed = self.slowest[self.run]

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
        known = (np.abs(moves.end - moves.starts()) > STILL).any(axis=1)
        known |= moves.kind == MoveKind.ARC
        known[self.last] = True
        head = np.flatnonzero(known)
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
        # chords may take what straight feeds may be collapsed within
        collapsible = (tolerance > 0) & ~moves.rapid[head]
        wide = np.maximum(tolerance, moves.collapse[head] * collapsible)
        np.minimum.at(self.inner, run[inner], wide[inner])
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
        merged = np.bincount(q[inner], minlength=len(self.last)) > 0
        bent = merged[q] & (moves.kind[head] != MoveKind.LINE)  # nor replace an arc
        skipped = q[inner & (tolerance <= 0)]  # rests
        self.chord[q[back]] = self.chord[q[bent]] = self.chord[skipped] = np.inf

    def deviation(self) -> tuple[Floats, Floats]:
        """Return a bound on the distance from the programmed path, and the tolerance, (m,)."""
        from pulsewright.motion import certificate_kernels as kernels

        t, run = self.trajectory, self.run
        # a blend at either end of the run; a chord with its blends has the corners within to keep
        allowed = np.maximum(self.corner, np.append(self.before, self.corner[:-1]))
        allowed = np.where(np.isinf(self.inner), allowed, self.inner)
        allowed = np.maximum(allowed, ROUNDING)
        motion = t.poly, t.cosine, t.sine, t.omega, t.length
        programmed = self.base, self.along, self.cosine, self.sine, self.omega, self.chord
        return kernels.distance(*motion, run, *programmed, allowed), allowed[run]

    def rests(self, motion: _Pieces) -> tuple[float, int]:
        """Return the largest error of position at rest, and the number of rests not made."""
        t = self.trajectory
        final = np.append(np.flatnonzero(np.diff(t.element)), len(t.element) - 1)
        done, still = np.zeros(len(t.length), bool), np.zeros(len(t.length), bool)
        still[t.element[final]] = motion.v1[final] <= ROUNDING
        done[t.element[final[:-1]]] = True  # the last one may go on in the next part
        reached = np.zeros(len(t.length))
        reached[t.element[final]] = motion.s1[final]
        last = t.element[-1]
        done[last] = still[last] and motion.s1[-1] >= t.length[last] - STILL
        closing = np.append(np.flatnonzero(np.diff(self.run)), len(self.run) - 1)
        demanded = (self.corner <= 0) & done[closing]
        kept = still[closing] & demanded
        x = _place(t, closing[kept].astype(np.int32), reached[closing[kept]])
        error = _norm(x - self.end[kept]).max(initial=0.0)
        return float(error), int((demanded & ~kept).sum())


def _norm(v: Floats) -> Floats:
    """Return the larger of the linear and the rotary length of each vector."""
    x, y, z, a, b, c = (v * v).T
    return np.asarray(np.sqrt(np.maximum(x + y + z, a + b + c)))
