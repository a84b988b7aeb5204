"""A program interpreted, planned and certified, but not run; in bounded memory."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pulsewright.app.progress import Progress, silent
from pulsewright.errors import CheckFailedError
from pulsewright.motion.certificate import Certificate, Certifier
from pulsewright.motion.gcode import InterpreterSettings, interpret
from pulsewright.motion.gcode.tools import Tool
from pulsewright.motion.machine import WORK_OFFSETS, Machine
from pulsewright.motion.stream import Planner
from pulsewright.verify.verdict import plain

if TYPE_CHECKING:
    from pulsewright.motion.moves import Moves


@dataclass
class Clock:
    """CPU time of the process by stage [s]."""

    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def total(self) -> float:
        """CPU time of all stages [s]."""
        return sum(self.seconds.values())

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the CPU time of a ``with`` block to stage ``name``."""
        start = time.process_time()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.process_time() - start


def interpreter_settings(machine: Machine) -> InterpreterSettings:
    """Return what a program takes from the machine."""
    return InterpreterSettings(
        axes=machine.axes,
        wrapped=machine.wrapped,
        start=machine.start_position().tolist(),
        work_offsets={name: machine.offset(name).tolist() for name in WORK_OFFSETS},
        tools={
            number: Tool(number, number, (0.0, 0.0, tool.length, 0.0, 0.0, 0.0), tool.diameter)
            for number, tool in machine.tools.items()
        }
        or None,
        path_tolerance=machine.path.tolerance or machine.exact_tolerance,
        exact_tolerance=machine.exact_tolerance,
    )


@dataclass(frozen=True)
class Outline:
    """What is known of a planned program before it is run.

    Parameters
    ----------
    program, machine : str
    moves : int
    duration : float
        [s]
    elements, pieces : int
        Of the trajectory.
    certificate : Certificate
    messages : tuple of str
        What the program says.
    clock : Clock
    """

    program: str
    machine: str
    moves: int
    duration: float
    elements: int
    pieces: int
    certificate: Certificate
    messages: tuple[str, ...]
    clock: Clock

    def summary(self) -> dict[str, Any]:
        """Return it in plain types."""
        return {
            "program": self.program,
            "machine": self.machine,
            "moves": self.moves,
            "duration": self.duration,
            "elements": self.elements,
            "pieces": self.pieces,
            "certificate": plain(asdict(self.certificate)),
            "messages": list(self.messages),
            "cpu_seconds": dict(self.clock.seconds),
        }

    def text(self) -> str:
        """Return it for people."""
        return (
            f"{self.program}: {self.moves} moves on '{self.machine}', "
            f"{clock_time(self.duration)} of machine time\n{self.certificate.text()}"
        )


def chosen_machine(machine: Machine | Path | str | None) -> Machine:
    """Return a machine, the one of a file, or the built-in one.

    Raises
    ------
    MachineError
        If the file is wrong.
    """
    if machine is None:
        return Machine.default()
    return machine if isinstance(machine, Machine) else Machine.load(machine)


def require_certificate(program: Path | str, certificate: Certificate) -> None:
    """Check that a plan keeps its limits.

    Raises
    ------
    CheckFailedError
        If not.
    """
    if not certificate.passed:
        raise CheckFailedError(f"{program}: the plan fails its certificate: {certificate}")


def plan_file(
    path: Path | str, *, machine: Machine | Path | str | None = None, progress: Progress = silent
) -> Outline:
    """Interpret, plan and certify a program of any length.

    Parameters
    ----------
    path : Path or str
        The program.
    machine : Machine, Path or str, optional
        Or the machine's file; default is the built-in machine.

    Raises
    ------
    GcodeError, MachineError, MotionLimitError
        If the program cannot be done on this machine.
    CheckFailedError
        If the plan breaks a limit: a defect of the planner, caught by its certificate.
    """
    machine = chosen_machine(machine)
    job = _Planning(machine, str(path))
    progress("plan", 0.0)
    begin = time.process_time()
    program = interpret(path, settings=interpreter_settings(machine), take=job.take)
    spent = time.process_time() - begin
    job.clock.seconds["interpret"] = spent - job.clock.total  # some has been planned meanwhile
    job.take(program.moves)
    certificate = job.finish()
    progress("plan", 1.0)
    return Outline(
        program=program.path,
        machine=machine.name,
        moves=job.moves,
        duration=job.duration,
        elements=job.elements,
        pieces=job.pieces,
        certificate=certificate,
        messages=tuple(event.text for event in program.events if event.kind == "message"),
        clock=job.clock,
    )


class _Planning:
    """A program on its way through planner and certificate; only sums are kept."""

    def __init__(self, machine: Machine, path: str) -> None:
        self.clock = Clock()
        self.moves = self.elements = self.pieces = 0
        self.duration = 0.0
        self._path, self._last = path, -1
        self._planner = Planner(machine)
        self._certifier = Certifier(machine, machine.start_position())

    def take(self, moves: Moves) -> None:
        """Plan as much as is sure with these moves."""
        with self.clock.stage("plan"):
            self.moves += len(moves)
            self._planner.add(moves)
            self._certifier.add(moves)
            self._plan()

    def finish(self) -> Certificate:
        """Plan to the end; return the certificate of all."""
        with self.clock.stage("plan"):
            self._planner.finish()
            self._plan()
            certificate = self._certifier.finish()
        require_certificate(self._path, certificate)
        return certificate

    def _plan(self) -> None:
        while part := self._planner.take():
            t = part.trajectory
            require_certificate(self._path, self._certifier.check(t))
            self.duration += t.duration
            self.elements += int((t.move > self._last).sum())
            self.pieces += len(t.element)
            self._last = int(t.move[-1])


def clock_time(seconds: float) -> str:
    """Return a time for people: 1:02:03.4."""
    minutes, rest = divmod(seconds, 60)
    hours, minutes = divmod(int(minutes), 60)
    return f"{hours}:{minutes:02}:{rest:04.1f}"
