"""What a recording is compared with: plan, programmed moves, machine and tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.edges.path import MotorPins
from pulsewright.errors import UsageError
from pulsewright.motion.moves import AXES, MoveKind, Moves
from pulsewright.motion.trajectory import Trajectory

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FAR: Final = 1 << 62  # a cycle that no recording reaches
ROUNDING: Final = 1e-6  # of programs and their geometry [mm, degrees]
PORTION: Final = 4096  # instants of a plan that are looked at together, for little memory


@dataclass(frozen=True)
class Tolerances:
    """What the verifier allows, and how it looks.

    Parameters
    ----------
    following : float
        Largest difference of count and planned motor position at any instant [step].
    settle : float
        Time after the plan has come to rest by which the counts must be exact, and so long before
        it moves on they may change [s].
    passing : float
        Closest approach to a stop at which the plan rests for less than twice ``settle`` [step].
    tie : float
        A stop so close to half a step may be rounded either way [step].
    share : float
        Velocities and accelerations are measured over windows so long that steps blur the limit
        by about this share of it, 0 .. 1.
    sampling : float
        Time between the instants at which path, velocity and acceleration are measured [s].
    samples : int
        Most points kept for pictures.
    """

    following: float = 1.1
    settle: float = 2e-3
    passing: float = 0.75
    tie: float = 1e-6
    share: float = 0.15
    sampling: float = 1e-3
    samples: int = 100_000


class Reference:
    """What every part of the verifier needs to know.

    Parameters
    ----------
    trajectory, moves, motor_matrix, clock_hz, motors, start_cycle, start_counts, tolerances
        As in `Verifier`.

    Attributes
    ----------
    plan : Trajectory
        In machine axes.
    matrix : (motors, 6) float64
        The motor matrix.
    inverse : (6, motors) float64
        Axis units per step of each motor, by the pseudo-inverse: two motors of a gantry count half.
    start, grid : int
        Cycle of the plan's time 0; cycles between the instants looked at.
    dt : float
        Time between these [s].
    runs : Runs
    """

    def __init__(
        self,
        trajectory: Trajectory,
        moves: Moves,
        motor_matrix: Floats,
        clock_hz: int,
        motors: Sequence[MotorPins],
        start_cycle: int,
        start_counts: Ints | None,
        tolerances: Tolerances,
    ) -> None:
        self.tolerances, self.clock, self.start = tolerances, clock_hz, start_cycle
        self.motors, self.moves = tuple(motors), moves
        self.plan = _with_rest(trajectory, moves)
        self.matrix = matrix = np.asarray(motor_matrix, float)
        if matrix.shape != (len(self.motors), len(AXES)):
            raise UsageError(
                f"the motor matrix must be {(len(self.motors), len(AXES))} for "
                f"{len(self.motors)} motors, not {matrix.shape}"
            )
        self.inverse = np.linalg.pinv(matrix)
        # No edge can tell what an axis without a motor of its own does.
        self.moving = np.ptp(_corners(moves), axis=0) > 0
        alone = np.isclose(self.inverse @ matrix, np.eye(len(AXES)), atol=1e-9).all(axis=1)
        orphans = [AXES[i] for i in np.flatnonzero(self.moving & ~alone)]
        if orphans:
            raise UsageError(
                f"the program moves axis {', '.join(orphans)}, but the motors do not determine "
                f"where it is: check motors and kinematics of the machine"
            )
        self.home = self.plan.at(0.0)[0]
        self.home_steps = matrix @ self.home
        counts = np.floor(self.home_steps + 0.5) if start_counts is None else start_counts
        self.start_counts = np.asarray(counts, np.int64)
        self.grid = max(1, round(tolerances.sampling * clock_hz))
        self.dt = self.grid / clock_hz
        self.runs = Runs(self.plan, moves)

    def follow(self, plan: Trajectory, override: Floats) -> None:
        """Go on with another law of time on the same elements; see `Verifier.follow`."""
        self.plan = self.plan.timed(plan.element, plan.start, plan.law)
        self.runs = Runs(self.plan, self.moves, override)

    def motors_at(self, time: Floats) -> Floats:
        """Return planned positions of the motors at times, (n, motors) [step]."""
        portions = np.array_split(time, len(time) // PORTION + 1)
        return np.concatenate([self.plan.at(t, matrix=self.matrix) for t in portions])

    def tool(self, steps: NDArray[Any]) -> Floats:
        """Return tool positions (n, 6) of motor positions (n, motors)."""
        moved = np.ascontiguousarray(steps, float) - self.home_steps
        return np.asarray(moved @ self.inverse.T + self.home)

    def cycle(self, time: float) -> float:
        """Return the cycle at a time of the plan [s]."""
        return self.start + time * self.clock

    def place(self, cycle: float) -> dict[str, Any]:
        """Return time, program line and position of the plan at ``cycle``, as `Check` has them."""
        time = min(max((cycle - self.start) / self.clock, 0.0), self.plan.duration)
        x, y, z = self.plan.at(time)[0, :3].tolist()
        line = None
        if len(self.moves):
            line = int(self.moves.line[self.runs.move[self.runs.at(np.array([time]))[0]]])
        return {"time": float(time), "line": line, "position": (x, y, z)}


class Runs:
    """Stretches of time in which the plan is in one move, and what holds in and around each.

    Attributes
    ----------
    move : (r,) int64
        The last move that the run stands for.
    start : (r + 1,) float64
        When it begins, and the last one ends [s].
    tolerance : (r,) float64
        Largest tolerance of the corners that the run touches, or of chords for short lines [mm].
    rapid : (r,) bool
    feed : dict of (r,) float64
        Highest feed of the moves it stands for: ``XYZ`` [mm/s], ``ABC`` [degrees/s].
    lent : dict of (r,) float64
        The same on blends: a blend carries motion on into the next run, whose feed may say nothing
        of it.
    entered, left : (r,) float64
        When the blend at its start ends, and when the one at its end begins [s].
    """

    def __init__(self, plan: Trajectory, moves: Moves, override: Floats | None = None) -> None:
        self._begin = plan.start[:-1]
        self._override = override
        move = plan.move[plan.element]
        first = np.flatnonzero(np.diff(move, prepend=np.int32(-1)))
        self.move = move[first].astype(np.int64)
        self.start = np.append(plan.start[first], plan.duration)
        straight = (plan.poly[:, 2:] == 0).all(axis=(1, 2))[plan.element]
        self.entered = np.minimum.reduceat(np.where(straight, plan.start[:-1], np.inf), first)
        self.left = np.maximum.reduceat(np.where(straight, plan.start[1:], -np.inf), first)
        self.feed, self.lent = dict[str, Floats](), dict[str, Floats]()
        if not len(moves):
            self.tolerance, self.rapid = np.zeros(1), np.zeros(1, bool)
            self.feed = self.lent = {"XYZ": np.zeros(1), "ABC": np.zeros(1)}
            return
        if (np.diff(self.move) < 0).any() or not 0 <= self.move[0] <= self.move[-1] < len(moves):
            raise UsageError(
                f"plan and moves do not belong together: the plan visits moves "
                f"{self.move.min()}..{self.move.max()} or goes back, there are {len(moves)}"
            )
        # An element's move is the last one that it stands for; so a run stands for all moves after
        # that of the run before it, and touches the corners at both ends of each of them.
        before, after = np.append(-1, self.move[:-1]), self.move + 1
        allowed = np.maximum(moves.tolerance, moves.collapse * (moves.tolerance > 0))
        self.tolerance = largest(allowed, np.maximum(before, 0), after)
        self.rapid = moves.rapid[self.move]
        delta = np.abs(moves.end - moves.starts())
        linear = (delta[:, :3] > 0).any(axis=1) | (moves.kind == MoveKind.ARC)
        rotary = (delta[:, 3:] > 0).any(axis=1)
        feed = np.where(moves.rapid, np.inf, moves.feed)
        # A feed is along X Y Z where one of them moves, and then says nothing of A B C.
        linear_feed = np.where(linear, feed, 0.0)
        rotary_feed = np.where(rotary, np.where(linear, np.inf, feed), 0.0)
        # Nothing is said of what no move of its own does, nor of A B C beside a run where they go
        # along with X Y Z at any rate.
        moving, together = (
            largest(which.astype(float), before + 1, after)
            for which in (linear | rotary, linear & rotary)
        )
        rounded = moves.tolerance[self.move] > 0
        for group, column in (("XYZ", linear_feed), ("ABC", rotary_feed)):
            feed = largest(column, before + 1, after)
            foreign = feed == 0
            if group == "ABC":
                foreign |= _beside(together, rounded) > 0
            most = np.maximum(feed, _beside(feed, rounded))
            self.feed[group] = feed
            self.lent[group] = np.where((moving > 0) & foreign, most, feed)

    def allowed(self, group: str, run: Ints, time: Floats) -> Floats:
        """Return the highest feed at each time, and in all pieces since the time before it.

        ``time`` (n,) is in the runs ``run`` (n,) [s].
        """
        before = np.append(run[:1], run[:-1])
        feed = largest(self.feed[group], before, run + 1)
        lent = largest(self.lent[group], before, run + 1)
        blended = (time < self.entered[run]) | (time > self.left[run])
        most = np.where(blended, lent, feed)
        if self._override is None:
            return np.asarray(most)
        piece = np.maximum(np.searchsorted(self._begin, time, "right") - 1, 0)
        ahead = np.append(piece[:1], piece[:-1])
        factor = largest(self._override, ahead, piece + 1)
        with np.errstate(invalid="ignore"):
            return np.asarray(np.where(np.isinf(most), most, most * factor))

    def at(self, time: Floats) -> Ints:
        """Return the run at each time [s]."""
        found = np.searchsorted(self.start[:-1], time, side="right") - 1
        return np.maximum(found, 0).astype(np.int64)

    def since(self, run: Ints) -> Ints:
        """Return the first move that each of some runs stands for."""
        return np.where(run > 0, self.move[run - 1] + 1, 0)

    def until(self, run: Ints) -> Ints:
        """Return the last move that the blend at the end of each of some runs may reach."""
        return self.move[np.minimum(run + 1, len(self.move) - 1)]


def largest(values: Floats, begin: Ints, end: Ints) -> Floats:
    """Return the largest of ``values[begin[i]:end[i]]`` for each i; no range may be empty."""
    pairs = np.stack([begin, end], axis=1).ravel()
    return np.asarray(np.maximum.reduceat(np.append(values, -np.inf), pairs)[::2])


def _beside(values: Floats, rounded: NDArray[np.bool_]) -> Floats:
    """Return the larger of the values before and after each; 0 where no rounded corner joins them.

    ``rounded`` is for the corner after each.
    """
    before = np.where(rounded, values, 0.0)[:-1]
    after = np.where(rounded[:-1], values[1:], 0.0)
    return np.asarray(np.maximum(np.append(0.0, before), np.append(after, 0.0)))


def _corners(moves: Moves) -> Floats:
    """Return start and ends of all moves, and the far points of arcs, to see which axes move."""
    points = [moves.start[None], moves.end]
    for plane in range(3):
        arcs = (moves.kind == MoveKind.ARC) & (moves.plane == plane)
        turning = [c for c in range(3) if c != plane]
        far = moves.end[arcs]  # a full circle ends where it starts
        far[:, turning] = 2 * moves.center[arcs][:, turning] - far[:, turning]
        points.append(far)
    return np.concatenate(points)


def _with_rest(plan: Trajectory, moves: Moves) -> Trajectory:
    """Return ``plan``, or a standstill in its place if it has no piece at all."""
    if len(plan.element):
        return plan
    poly = np.zeros((1, 4, len(AXES)))
    poly[0, 0] = moves.start
    none, zero = np.zeros((1, len(AXES))), np.zeros(1)
    first = np.zeros(1, np.int32)
    return Trajectory(poly, none, none, zero, zero, first, first, np.zeros(2), np.zeros((1, 4)))
