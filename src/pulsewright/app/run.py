"""The main job: a program file becomes verified steps of a board."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pulsewright import boards
from pulsewright.app.feed import Change, FeedControl, Feeding
from pulsewright.app.planning import (
    Clock,
    Outline,
    chosen_machine,
    clock_time,
    interpreter_settings,
    require_certificate,
)
from pulsewright.app.progress import Progress, silent
from pulsewright.app.rehearsal import rehearsed
from pulsewright.app.standing import Standing
from pulsewright.boards.board import Board
from pulsewright.boards.playing import Drives, Player
from pulsewright.boards.watching import Feedback, LimitSwitches
from pulsewright.edges.path import numbered_pins
from pulsewright.edges.timing import DriveTiming
from pulsewright.edges.trace import EdgeTrace
from pulsewright.edges.writer import TraceWriter
from pulsewright.errors import MachineError, UsageError
from pulsewright.files import appearing, replacing
from pulsewright.motion.certificate import Certificate, certify
from pulsewright.motion.gcode import interpret
from pulsewright.motion.hold import AxisLimits
from pulsewright.motion.live import LivePlan
from pulsewright.motion.machine import Machine
from pulsewright.motion.motors import MotorPlan
from pulsewright.motion.moves import AXES
from pulsewright.motion.plan import begin_times
from pulsewright.motion.plan import plan as plan_moves
from pulsewright.units import MICROSECOND
from pulsewright.verify import Tolerances, Verifier
from pulsewright.verify.verdict import Verdict, plain

if TYPE_CHECKING:
    from pulsewright.motion.moves import Program
    from pulsewright.motion.trajectory import Trajectory
    from pulsewright.transport.faults import Faults

TRACE: Final = "trace.npz"
CERTIFICATE: Final = "certificate.json"
REPORT: Final = "report.json"
UNSEEN: Final = (
    "the path and its deviation from the program",
    "following of the plan between the moments at which the board told",
    "velocity and acceleration of the motors",
    "pulse width, space, direction setup and hold at the pins, and steps lost behind them",
)
UNKNOWN: Final = "the position is unknown: reference the machine before it runs on"
SAY_SO: Final = "and say so with --referenced"
CHUNK: Final = 5.0  # machine time handled at once [s]: bounds the memory of a job of any length


@dataclass(frozen=True)
class Job:
    """A program planned for a machine, ready to run.

    Examples
    --------
    >>> from pulsewright import Job
    >>> job = Job.from_gcode("examples/rosette.ngc")
    >>> result = job.run(out="out/rosette")
    >>> result.passed
    True
    """

    program: Program
    machine: Machine
    trajectory: Trajectory
    certificate: Certificate
    clock: Clock

    @classmethod
    def from_gcode(
        cls,
        path: Path | str,
        *,
        machine: Machine | Path | str | None = None,
        progress: Progress = silent,
    ) -> Job:
        """Interpret, plan and certify a program.

        Parameters
        ----------
        path : Path or str
            The program.
        machine : Machine, Path or str, optional
            Or the machine's file; default is the built-in machine.

        Raises
        ------
        GcodeError, MachineError, MotionLimitError
            If program or machine file are wrong, or the program leaves the machine's travel.
        CheckFailedError
            If the plan breaks a limit: a defect of the planner, caught by its certificate.
        """
        machine = chosen_machine(machine)
        clock = Clock()
        with clock.stage("interpret"):
            progress("interpret", 0.0)
            program = interpret(path, settings=interpreter_settings(machine))
            progress("interpret", 1.0)
        with clock.stage("plan"):
            progress("plan", 0.0)
            trajectory = plan_moves(program.moves, machine)
            progress("plan", 0.7)
            certificate = certify(trajectory, program.moves, machine)
            progress("plan", 1.0)
        require_certificate(path, certificate)
        return cls(program, machine, trajectory, certificate, clock)

    def run(
        self,
        *,
        board: str | None = None,
        profile: str | None = None,
        link: str | None = None,
        out: Path | str | None = None,
        vcd: bool = False,
        record: Path | str | None = None,
        faults: Faults | None = None,
        referenced: bool = False,
        feed: FeedControl | None = None,
        progress: Progress = silent,
    ) -> Result:
        """Run on a board and verify the step edges; write reports to ``out`` unless None.

        They appear there all at once; without them, as after an error, what was there stays.
        Whatever ends it early, Ctrl-C and SIGTERM included, lets the machine come to rest on its
        path within its limits, if the link lives; the error has a note of where that is.

        Parameters
        ----------
        board, profile, link : str, optional
            Default to what the machine says.
        out : Path or str, optional
            Folder for report.json, report.html, path.png and trace.npz; made if missing.
        vcd : bool
            Write trace.vcd too.
        record : Path or str, optional
            File that keeps all that goes over the link, for `pulsewright replay`.
        faults : Faults, optional
            What goes wrong on the link; see `transport.faults`.
        referenced : bool
            The machine has been referenced since it moved the last time. To be said where a run on
            this link has ended, or was killed, with the position unknown.
        feed : FeedControl, optional
            By which another thread holds, resumes, overrides and stops the run.

        Raises
        ------
        StoppedError
            If ``feed`` has stopped the run.
        UsageError
            If board, profile or link cannot be used as asked, or files cannot be written.
        MotionLimitError
            If the board cannot follow the machine's rates.
        PositionUnknownError
            If the position of the machine is unknown, from an earlier run on this link or by what
            the board tells of itself.
        BusError, EstopError
            If the link failed, or the board stopped by itself.
        FollowingError, LimitSwitchError
            If a motor is not where it should be, or a limit switch is hit, as far as the machine
            has ``encoders`` and ``switches`` and the board can tell.
        """
        settings, machine = self.machine.board, self.machine
        name, link = board or settings.name, link or machine.link.url
        room = boards.get(name)
        # what the machine file says holds for its own board only
        own = machine if name == settings.name else None
        folder = None if out is None else Path(out)
        with nullcontext() if folder is None else appearing(folder) as written:
            standing = Standing(link, self.program.path, referenced=referenced)
            with self._fed(feed) as feeding, standing:
                standing.driver = driver = boards.open_board(
                    name,
                    link,
                    profile=profile or (settings.profile if own else None),
                    record=record,
                    faults=faults,
                    **room.parameters_for(machine.motors) | _switches(own),
                )
                if vcd and not hasattr(driver.bus, "twin"):
                    driver.close()
                    raise UsageError(
                        f"link '{link}' does not record step edges, which trace.vcd holds; leave "
                        f"it out, or use twin:"
                    )
                result = self._run_on(driver, room, _watched(own), feeding, written, progress)
            del driver, standing, feeding  # and the memory they take
            if written is not None:
                with self.clock.stage("write"):
                    progress("report", 0.0)
                    result.write(written, vcd=vcd)
                    progress("report", 1.0)
        return replace(result, folder=folder)

    @contextmanager
    def _fed(self, feed: FeedControl | None) -> Iterator[Feeding]:
        """Yield the plan as ``feed`` changes it; what was asked before is done."""
        machine, moves = self.machine, self.program.moves
        plan = None if feed is None else LivePlan(self.trajectory, moves, machine)
        matrix = machine.motor_matrix()

        def mapped(plan: Trajectory) -> Trajectory:
            return MotorPlan(plan, matrix)

        with Feeding(feed, plan, self.trajectory, mapped, self._place) as feeding:
            feeding.begin()
            yield feeding

    def _run_on(
        self,
        driver: Any,
        room: Board,
        watched: Mapping[str, Any],
        feeding: Feeding,
        folder: Path | None,
        progress: Progress,
    ) -> Result:
        machine = self.machine
        matrix = machine.motor_matrix()
        rows, _, acceleration = limits = machine.limit_rows()
        rates, accelerations, jerks = machine.motor_limits().tolist()
        drive = DriveTiming(
            width=machine.drive.pulse_width_us * MICROSECOND,
            space=machine.drive.pulse_space_us * MICROSECOND,
            setup=machine.drive.direction_setup_us * MICROSECOND,
            hold=machine.drive.direction_hold_us * MICROSECOND,
        )
        with self._place_told(driver, feeding), driver:
            recorder = getattr(driver.bus, "twin", None)
            feeding.simulated = recorder is not None
            held = AxisLimits(rows @ np.linalg.pinv(matrix), acceleration, machine.jerk_limits())
            player = room.player(
                driver,
                feeding.motors,
                Drives(rates, accelerations, jerks, drive, held, **watched),
            )
            with self.clock.stage("convert and run"):
                player.prepare()
            switched = driver if room.digital_outputs else None
            outputs = _Outputs(switched, machine, self.program, feeding)
            if recorder is None:
                for until in self._played(player, outputs, feeding):
                    progress("run", min(until / max(self.duration, 1e-9), 1.0))
                return self._result(driver, player, outputs, feeding, None)
            verifier = Verifier(
                trajectory=self.trajectory,
                moves=self.program.moves,
                motor_matrix=matrix,
                limits=limits,
                clock_hz=driver.bus.clock_hz,
                motors=numbered_pins(len(matrix), room.positive_direction, *room.motor_pins),
                drives=[drive] * len(matrix),
                start_cycle=player.start_cycle,
                tolerances=Tolerances(settle=2 * player.update),
            )
            feeding.followed_by(verifier.follow)
            prepared = recorder.drain()
            verifier.feed(prepared)
            with _trace_file(folder, prepared) as keep:
                for until in self._played(player, outputs, feeding):
                    with self.clock.stage("convert and run"):
                        recorder.advance(driver.bus.now())  # see the last access take effect
                        chunk = recorder.drain()
                    with self.clock.stage("verify"):
                        verifier.feed(chunk)
                    with self.clock.stage("write"):
                        keep(chunk)
                    progress("run", min(until / max(self.duration, 1e-9), 1.0))
                with self.clock.stage("verify"):
                    verdict = verifier.finish()
        return self._result(driver, player, outputs, feeding, verdict)

    def _played(self, player: Player, outputs: _Outputs, feeding: Feeding) -> Iterator[float]:
        """Play in portions of `CHUNK` at most; yield the time up to which has been played [s]."""
        reached = 0.0
        while reached < math.inf:
            until = min((math.floor(reached / CHUNK + 1e-9) + 1) * CHUNK, outputs.next)
            if until >= feeding.trajectory.duration:
                until = math.inf
            with self.clock.stage("convert and run"):
                reached = feeding.play(player, until)
                outputs.switch(reached)
            yield reached

    def _result(
        self,
        driver: Any,
        player: Player,
        outputs: _Outputs,
        feeding: Feeding,
        verdict: Verdict | None,
    ) -> Result:
        job = self
        if feeding.changes:
            job = replace(self, trajectory=feeding.trajectory, certificate=feeding.certificate())
            require_certificate(self.program.path, job.certificate)
        return Result(
            job,
            driver.registers.board,
            driver.profile,
            verdict,
            1 / player.update,
            None,
            outputs.not_switched,
            player.evidence,
            tuple(feeding.changes),
        )

    @contextmanager
    def _place_told(self, driver: Any, feeding: Feeding) -> Iterator[None]:
        """Add to what ends a ``with`` block early a note of where the machine stands."""
        try:
            yield
        except BaseException as error:
            stop = driver.stopped_at
            if not driver.position_known:
                error.add_note(UNKNOWN if hasattr(driver.bus, "twin") else f"{UNKNOWN}, {SAY_SO}")
            elif stop is not None:
                line, place = self._place(feeding.trajectory, stop.time)
                axes = [f"{axis} {x:.3f}" for axis, x in place.items()]
                error.add_note(
                    f"stopped within its limits on its path at {stop.time:.3f} s of the plan, "
                    f"line {line}: {' '.join(axes)}"
                )
            raise

    def _place(self, plan: Trajectory, time: float) -> tuple[int, dict[str, float]]:
        """Return the line of the program and the position by axis at a time of a plan [s]."""
        k = np.clip(np.searchsorted(plan.start, time, "right") - 1, 0, len(plan.element) - 1)
        place, lines = plan.at(time)[0], self.program.moves.line
        line = int(lines[plan.move[plan.element[k]]]) if len(lines) else 0
        return line, {axis: float(place[AXES.index(axis)]) for axis in self.machine.axes}

    def summary(self) -> dict[str, Any]:
        """Return what is known before running, in plain types."""
        return self._outline.summary()

    def text(self) -> str:
        """Return the summary for people."""
        return self._outline.text()

    @property
    def _outline(self) -> Outline:
        trajectory, events = self.trajectory, self.program.events
        return Outline(
            program=self.program.path,
            machine=self.machine.name,
            moves=len(self.program.moves),
            duration=self.duration,
            elements=len(trajectory.length),
            pieces=len(trajectory.element),
            certificate=self.certificate,
            messages=tuple(event.text for event in events if event.kind == "message"),
            clock=self.clock,
        )

    @property
    def duration(self) -> float:
        """Planned time [s]."""
        return self.trajectory.duration


@dataclass(frozen=True)
class Result:
    """A job that has run, and what its step edges say, or at least the board.

    Parameters
    ----------
    job : Job
    board, profile : str
    verdict : Verdict or None
        None on links that show no step edges: see `evidence`.
    update_rate : float
        How often the board got new commands [Hz].
    folder : Path or None
        Where the reports are.
    not_switched : tuple of str
        What the program switches and the machine wires, but the board has no outputs for.
    evidence : tuple of str
        What the board told, and was as it should be. Anything else would have been an error.
    changes : tuple of Change
        What a `FeedControl` asked, and when it was done; ``job`` has the plan and the certificate
        of what was really played.
    """

    job: Job
    board: str
    profile: str
    verdict: Verdict | None
    update_rate: float
    folder: Path | None
    not_switched: tuple[str, ...] = ()
    evidence: tuple[str, ...] = ()
    changes: tuple[Change, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether every check passed; without step edges, whether the board told nothing amiss."""
        return self.verdict is None or self.verdict.passed

    @property
    def not_verified(self) -> tuple[str, ...]:
        """What nobody has seen."""
        return UNSEEN if self.verdict is None else ()

    @property
    def real_time_ratio(self) -> float:
        """Machine time over CPU time of all stages but the writing of reports."""
        spent = sum(t for stage, t in self.job.clock.seconds.items() if stage != "write")
        return self.job.duration / max(spent, 1e-9)

    def write(self, folder: Path, *, vcd: bool = False) -> None:
        """Write the report and certificate.json beside trace.npz, and trace.vcd if asked.

        The report is report.json, report.html and path.png; without step edges report.json alone.
        """
        job = self.job
        with replacing(folder / CERTIFICATE) as temporary:
            temporary.write_text(json.dumps(job.certificate.to_json(), indent=2) + "\n")
        if self.verdict is None:
            with replacing(folder / REPORT) as temporary:
                content = {"passed": self.passed, **plain(self.context())}
                temporary.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n")
            return
        from pulsewright.app.plan_view import PlanView
        from pulsewright.app.report import write_report

        plan = PlanView(job.trajectory, job.program.moves, job.machine)
        write_report(self.verdict, self.context(), folder, plan=plan)
        if vcd:
            from pulsewright.edges.vcd import write_vcd

            write_vcd(folder / "trace.vcd", EdgeTrace.load(folder / TRACE))

    def context(self) -> dict[str, Any]:
        """Return program, machine and board, for reports."""
        job = self.job
        return {
            **job.summary(),
            "board": self.board,
            "profile": self.profile,
            "update_rate": self.update_rate,
            "real_time_ratio": self.real_time_ratio,
            "not_switched": list(self.not_switched),
            **({"feed_changes": [asdict(c) for c in self.changes]} if self.changes else {}),
        } | (
            {}
            if self.verdict is not None
            else {"verified": list(self.evidence), "not_verified": list(self.not_verified)}
        )

    def summary(self) -> dict[str, Any]:
        """Return everything but the path in plain types."""
        # hidden ones are of runs that write just now, or were killed
        files = sorted(map(str, self.folder.glob("[!.]*"))) if self.folder else []
        verdict = None if self.verdict is None else self.verdict.to_json()
        return {**self.context(), "passed": self.passed, "files": files, "verdict": verdict}

    def text(self) -> str:
        """Return the result for people: each check, its worst value and its bound."""
        verdict = self.verdict
        steps = "" if verdict is None else f"{verdict.steps} steps, "
        lines = [
            f"{self.job.program.path} on {self.board} ({self.profile}): "
            f"{clock_time(self.job.duration)} of machine time, {steps}"
            f"{self.job.clock.total:.1f} s of CPU"
        ]
        if verdict is None:
            lines += [f"  ok   {what}" for what in self.evidence]
            lines += [f"  not verified: {what}" for what in self.not_verified]
        for check in () if verdict is None else verdict.checks:
            worst = "-" if check.worst is None else f"{check.worst:.4g}"
            sign = "<=" if check.limit == "most" else ">="
            place = f"  line {check.line}" if check.line else ""
            where = "" if check.where in check.title else f" {check.where}"
            lines.append(
                f"  {'ok  ' if check.passed else 'FAIL'} {check.title}{where}: "
                f"{worst} {sign} {check.bound:.4g} {check.unit}{place}"
            )
        if self.not_switched:
            lines.append(
                f"  note {self.board} has no digital outputs: the program's "
                f"{', '.join(self.not_switched)} was not switched"
            )
        if verdict is None:
            lines.append("PLAYED; this link shows no step edges to verify")
            if self.folder:
                lines.append(f"report: {self.folder / REPORT}")
            return "\n".join(lines)
        lines.append("PASSED" if self.passed else "FAILED")
        if self.folder:
            lines.append(f"report: {self.folder / 'report.html'}")
            lines.append(f"picture: {self.folder / 'path.png'}")
        return "\n".join(lines)


class _Outputs:
    """Spindle and coolant on the board's digital outputs, switched while the machine rests.

    Without a driver nothing is switched; `not_switched` says what should be.
    """

    def __init__(self, driver: Any, machine: Machine, program: Program, feeding: Feeding) -> None:
        wired = machine.outputs.model_dump(exclude_none=True)
        events = [event for event in program.events if event.kind in wired]
        self._driver, self._wired, self._feeding = driver, wired, feeding
        self._moves = len(program.moves)
        self._waiting = [] if driver is None else events
        kinds = {event.kind for event in events if event.value}
        self.not_switched = tuple(sorted(kinds)) if driver is None else ()
        self._plan: Trajectory | None = None
        self._begin = np.zeros(0)

    @property
    def next(self) -> float:
        """When the next output is switched, by the plan as it is now [s]."""
        if not self._waiting:
            return math.inf
        if self._plan is not self._feeding.trajectory:
            self._plan = self._feeding.trajectory
            self._begin = begin_times(self._plan, self._moves)
        return float(self._begin[self._waiting[0].at])

    def switch(self, until: float) -> None:
        """Set the outputs of all events up to time ``until`` [s]."""
        while self._waiting and self.next <= until:
            event = self._waiting.pop(0)
            self._driver.write_output(self._wired[event.kind], event.value != 0)


def run_file(
    path: Path,
    *,
    machine: Path | None = None,
    board: str | None = None,
    profile: str | None = None,
    link: str | None = None,
    out: Path | None = None,
    vcd: bool = False,
    record: Path | None = None,
    referenced: bool = False,
    feed: FeedControl | None = None,
    progress: Progress = silent,
) -> Result:
    """Do the main job as the command line does: reports go to out/<program> unless told."""
    chosen = chosen_machine(machine)
    name, url = board or chosen.board.name, link or chosen.link.url
    boards.get(name)
    with rehearsed(name if url.startswith("twin:") else None):
        job = Job.from_gcode(path, machine=chosen, progress=progress)
        return job.run(
            board=board,
            profile=profile,
            link=link,
            out=out if out is not None else Path("out") / path.stem,
            vcd=vcd,
            record=record,
            referenced=referenced,
            feed=feed,
            progress=progress,
        )


def _switches(machine: Machine | None) -> dict[str, int]:
    """Return the profile switches and parameters that a machine file sets."""
    switches: dict[str, int] = {}
    for name, value in (machine.board.options if machine else {}).items():
        if not isinstance(value, int):
            raise MachineError(
                f"{value!r} given; profile switches are whole numbers, true or false",
                key=f"board.options.{name}",
            )
        switches[name] = int(value)
    return switches


def _watched(machine: Machine | None) -> dict[str, Any]:
    """Return what a machine file says of encoders and limit switches at its board."""
    watched: dict[str, Any] = {}
    if machine is not None and machine.encoders is not None:
        encoders = machine.encoders
        watched["feedback"] = Feedback(encoders.counts_per_step, encoders.following_error)
    if machine is not None and machine.switches is not None:
        watched["switches"] = LimitSwitches(machine.switches.inputs, machine.switches.active)
    return watched


@contextmanager
def _trace_file(folder: Path | None, first: EdgeTrace) -> Iterator[Callable[[EdgeTrace], None]]:
    """Yield a function that appends to the trace file, or forgets where there is no folder."""
    if folder is None:
        yield lambda chunk: None
        return
    with TraceWriter(
        folder / TRACE, first.clock_hz, first.pins, first.initial, first.start
    ) as writer:
        writer.append(first)
        yield writer.append
