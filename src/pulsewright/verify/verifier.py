"""From recorded step edges to a verdict: what the machine did, and whether it kept its limits.

Everything is measured on the pins. The plan says where the machine should be when; the programmed
moves say where the tool may be at all; neither the board's twin nor the conversion is asked.
Recordings come in chunks, and memory does not grow with them but for the picture's samples and two
numbers per stop and motor.

What each bound allows beyond the plan follows from one number, d = `Tolerances.following`: a count
may differ from the planned motor position by d steps (half a step is unavoidable). Whatever moves
by w units per step of each motor can then be off by q = d * sum(abs(w)).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pulsewright.edges.path import MotorPins, require_pins
from pulsewright.edges.timing import KINDS, DriveTiming, TimingMeter, TimingResult
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError
from pulsewright.motion.moves import Moves
from pulsewright.motion.trajectory import Trajectory
from pulsewright.verify.distance import GROUPS, PathCheck
from pulsewright.verify.dynamics import DynamicsCheck
from pulsewright.verify.reference import FAR, Floats, Ints, Reference, Tolerances
from pulsewright.verify.stops import StopCheck
from pulsewright.verify.verdict import Check, MotorSummary, Verdict

_TITLES = {
    "width": "step pulse width",
    "space": "space between step pulses",
    "setup": "direction stable before a step",
    "hold": "direction stable after a step",
    "hold_trailing": "direction stable after a pulse",
}


class Verifier:
    """Check a recording against its plan, chunk after chunk.

    Parameters
    ----------
    trajectory : Trajectory
        The plan, in machine axes [mm, degrees].
    moves : Moves
        What was programmed, before corners were rounded.
    motor_matrix : (motors, 6) float64
        Steps of each motor per mm or degree of each axis.
    limits : tuple of (r, 6), (r,), (r,) float64
        Rows (combinations of axes), largest velocity and largest acceleration along each.
    clock_hz : int
        Cycles of the recording per second of the plan [Hz].
    motors : sequence of MotorPins
    drives : sequence of DriveTiming
        What each motor's drive demands.
    start_cycle : int
        Cycle at which the plan's time 0 is.
    start_counts : (motors,) int64, optional
        Positions before the first step [step]; if not given, the plan's start, rounded.
    tolerances : Tolerances

    Raises
    ------
    UsageError
        If the parts do not fit together.

    Examples
    --------
    >>> verifier = Verifier(trajectory=plan, moves=program.moves, ...)
    >>> for chunk in recording:  # a second of motion or more in each, for speed
    ...     verifier.feed(chunk)
    >>> verifier.finish().passed
    True
    """

    def __init__(
        self,
        *,
        trajectory: Trajectory,
        moves: Moves,
        motor_matrix: Floats,
        limits: tuple[Floats, Floats, Floats],
        clock_hz: int,
        motors: Sequence[MotorPins],
        drives: Sequence[DriveTiming],
        start_cycle: int = 0,
        start_counts: Ints | None = None,
        tolerances: Tolerances | None = None,
    ) -> None:
        from pulsewright.verify import kernels

        self._kernels = kernels
        self._reference = Reference(
            trajectory,
            moves,
            motor_matrix,
            clock_hz,
            motors,
            start_cycle,
            start_counts,
            tolerances or Tolerances(),
        )
        self._timing = TimingMeter(clock_hz, motors, drives)
        self._stops = StopCheck(self._reference)
        turning = self._reference.moving[GROUPS["ABC"]].any()
        self._paths = [
            PathCheck(self._reference, group) for group in (("XYZ", "ABC") if turning else ("XYZ",))
        ]
        self._dynamics = DynamicsCheck(self._reference, limits, self._paths)
        n = len(self._reference.motors)
        self._state = np.zeros((n, kernels.FOLLOW_STATE), np.int64)
        self._state[:, kernels.COUNT] = self._reference.start_counts
        self._state[:, kernels.PREVIOUS] = -FAR
        self._piece = 0  # of the plan, at the end of what was fed
        self._worst = np.zeros((n, 3))
        self._histogram = np.zeros((n, kernels.HISTOGRAM), np.int64)
        self._first: EdgeTrace | None = None
        self._last: EdgeTrace | None = None
        self._edges = 0
        self._stray: dict[str, int] = {}
        self._finished = False

    def feed(self, chunk: EdgeTrace) -> None:
        """Check the next chunk of the recording.

        Raises
        ------
        UsageError
            If the chunk does not follow the last one, or lacks pins of a motor.
        """
        reference = self._reference
        if self._finished:
            raise UsageError("the verdict is made, no more can be fed")
        if self._first is None or self._last is None:
            require_pins(chunk, reference.motors)
            if chunk.clock_hz != reference.clock:
                raise UsageError(
                    f"the recording's clock is {chunk.clock_hz} Hz, the plan's is "
                    f"{reference.clock} Hz"
                )
            self._first = chunk
            used = {motor.step for motor in reference.motors}
            self._stray = {p: 0 for p in chunk.pins if p.startswith("step") and p not in used}
        else:
            chunk.require_after(self._last)
        self._last = chunk
        self._edges += sum(len(cycles) for cycles in chunk.cycles)
        for pin in self._stray:
            self._stray[pin] += len(chunk[pin])
        self._timing.feed(chunk)

        point = int(self._state[0, self._kernels.GRID])
        points = max(0, (chunk.end - 1 - reference.start) // reference.grid + 1 - point)
        n = len(reference.motors)
        steps = self._steps(chunk.end)
        counts = np.empty((n, points), np.int64)
        plan, deviation = np.empty((n, points)), np.empty((n, points))
        for i, motor in enumerate(reference.motors):
            self._kernels.follow(
                np.ascontiguousarray(chunk[motor.step]),
                int(chunk.level_at_start(motor.step) == motor.active),
                np.ascontiguousarray(chunk[motor.direction]),
                int(chunk.level_at_start(motor.direction) == motor.positive),
                chunk.end,
                float(reference.clock),
                reference.start,
                reference.grid,
                reference.tolerances.following,
                steps.poly,
                steps.cosine,
                steps.sine,
                steps.omega,
                steps.element,
                steps.start,
                steps.law,
                i,
                self._stops.window,
                self._stops.seen[i],
                self._state[i],
                self._worst[i],
                self._histogram[i],
                counts[i],
                plan[i],
                deviation[i],
            )
        self._piece += int(self._state[0, self._kernels.PIECE])
        self._state[:, self._kernels.PIECE] = 0
        if points:
            tool = reference.tool(counts.T)
            time = np.arange(point, point + points).astype(np.float64) * reference.dt
            run = reference.runs.at(time)
            cycle = reference.start + point * reference.grid
            distances = [path.feed(tool, run, cycle) for path in self._paths]
            self._dynamics.feed(tool, reference.tool(plan.T), run, deviation.T, distances[0])

    def _steps(self, end: int) -> Trajectory:
        """Return the plan of the motors [step] from where it was followed to, up to a cycle."""
        reference = self._reference
        until = int(reference.plan.piece((end - reference.start) * (1.0 / reference.clock)))
        part = reference.plan.part(self._piece, max(until, self._piece) + 1)
        return part.mapped(reference.matrix)

    def follow(self, trajectory: Trajectory, override: Floats) -> None:
        """Go on with a plan that was changed while it was played: held, resumed, or overridden.

        Parameters
        ----------
        trajectory : Trajectory
            With the same elements, and the same pieces up to some time after all that was fed.
        override : (k,) float64
            Of the feed, on each piece.

        Raises
        ------
        UsageError
            If the elements are others.
        """
        plan = self._reference.plan
        if not np.array_equal(trajectory.length, plan.length):
            raise UsageError("the changed plan has other elements than the one before")
        self._reference.follow(trajectory, override)
        self._stops.follow()
        for path in self._paths:
            path.follow()

    def finish(self) -> Verdict:
        """Return the verdict on all that was fed.

        Raises
        ------
        UsageError
            If nothing was fed, or the verdict was already given.
        """
        if self._first is None or self._last is None:
            raise UsageError("nothing was recorded: feed the trace before asking for a verdict")
        if self._finished:
            raise UsageError("the verdict was already given")
        self._finished = True
        self._dynamics.flush()
        checks = (
            self._following_check(),
            *(path.check() for path in self._paths),
            *(path.coverage_check(self._dynamics.bulge) for path in self._paths),
            *self._stops.checks(),
            *self._dynamics.checks(),
            *self._timing_checks(),
            *self._stray_checks(),
            self._recording_check(self._first, self._last),
        )
        forward, backward = self._kernels.FORWARD, self._kernels.BACKWARD
        bins = np.arange(self._kernels.HISTOGRAM + 1) - self._kernels.HISTOGRAM / 2
        return Verdict(
            passed=all(check.passed for check in checks),
            checks=checks,
            motors=self._summaries(),
            edges=self._edges,
            steps=int(self._state[:, [forward, backward]].sum()),
            duration=self._reference.plan.duration,
            recorded=(self._last.end - self._first.start) / self._reference.clock,
            sample=self._dynamics.sample(),
            histogram={
                "edges": (bins / self._kernels.BINS_PER_STEP).tolist(),
                "counts": self._histogram.sum(axis=0).tolist(),
            },
        )

    def _summaries(self) -> tuple[MotorSummary, ...]:
        k, reference = self._kernels, self._reference
        planned = reference.motors_at(np.array([reference.plan.duration]))[0]
        lost = self._stops.lost().sum(axis=1)
        return tuple(
            MotorSummary(
                name=motor.step,
                steps=int(state[k.FORWARD] + state[k.BACKWARD]),
                forward=int(state[k.FORWARD]),
                backward=int(state[k.BACKWARD]),
                start=int(reference.start_counts[i]),
                end=int(state[k.COUNT]),
                planned_end=float(planned[i]),
                lost=int(lost[i]),
                deviation=float(self._worst[i, 0]),
            )
            for i, (motor, state) in enumerate(zip(reference.motors, self._state, strict=True))
        )

    def _following_check(self) -> Check:
        reference = self._reference
        motor = int(np.argmax(np.abs(self._worst[:, 0])))
        worst, cycle, _ = self._worst[motor].tolist()
        beyond = int(self._worst[:, 2].sum())
        return Check(
            "following",
            "count against plan, before and after every step",
            "step",
            abs(worst),
            reference.tolerances.following,
            "most",
            beyond == 0,
            where=reference.motors[motor].step,
            detail=f"count minus plan is {worst:+.3f} step there; "
            + (f"{beyond} instants beyond the bound" if beyond else "half a step is unavoidable"),
            **reference.place(cycle),
        )

    def _timing_checks(self) -> list[Check]:
        checks = []
        for kind in KINDS:
            results = [r for r in self._timing.results() if r.kind == kind and r.required > 0]
            if not results:
                continue
            worst = min(results, key=_margin)
            short = sum(result.violations for result in results)
            never = worst.measured is None
            checks.append(
                Check(
                    f"timing:{kind}",
                    _TITLES[kind],
                    "us",
                    None if worst.measured is None else worst.measured * 1e6,
                    worst.required * 1e6,
                    "least",
                    short == 0,
                    where=self._reference.motors[worst.motor].step,
                    detail="demanded by the drives' data sheet"
                    + (f"; {short} times shorter" if short else "")
                    + ("; never happened" if never else ""),
                    **({} if worst.cycle is None else self._reference.place(worst.cycle)),
                )
            )
        return checks

    def _stray_checks(self) -> list[Check]:
        if not self._stray:
            return []
        edges = sum(self._stray.values())
        return [
            Check(
                "stray",
                "changes of step pins that belong to no motor",
                "edge",
                float(edges),
                0.0,
                "most",
                edges == 0,
                detail=", ".join(f"{pin} {n}" for pin, n in self._stray.items()),
            )
        ]

    def _recording_check(self, first: EdgeTrace, last: EdgeTrace) -> Check:
        reference = self._reference
        begin = (first.start - reference.start) / reference.clock
        end = (last.end - reference.start) / reference.clock
        needed = reference.plan.duration + reference.tolerances.settle
        return Check(
            "recording",
            "recording reaches to rest after the program's end",
            "s",
            end,
            needed,
            "least",
            begin <= 0 and end >= needed,
            detail=f"recorded from {begin:.6f} s to {end:.6f} s of the plan"
            + ("" if begin <= 0 else ", but it must begin before the plan does"),
        )


def _margin(result: TimingResult) -> float:
    return math.inf if result.measured is None else result.measured - result.required
