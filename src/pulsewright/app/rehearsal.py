"""Compiling ahead: on a first run, other processes compile what this one needs later.

Kernels are compiled where they are first called, one after the other, and kept on disk for all
processes; see `pulsewright.compiled`. So while the first stages of a job compile theirs here, its
later ones are done elsewhere for one short move: they find their kernels ready, or nearly so.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Final

import numpy as np

from pulsewright import compiled

if TYPE_CHECKING:
    from pulsewright.motion.cell_law import Cells
    from pulsewright.motion.moves import Program
    from pulsewright.motion.path import Elements
    from pulsewright.motion.trajectory import Trajectory

NICE: Final = 5  # what is waited for last comes last
PAUSE: Final = 0.02  # between two looks at whether a kernel is ready [s]
FIRST: Final = "pulsewright.motion.path"  # what the planner needs first
# What other processes compile from then on: parts, and kernels of theirs that are waited for. The
# speeds take as long as all the rest, so their process is as urgent as this one.
PLANNER: Final = {
    "speeds": ("pulsewright.motion.speeds.speeds",),
    "law": ("pulsewright.motion.law.law", "pulsewright.motion.certificate_kernels.worst"),
}


@contextmanager
def rehearsed(board: str | None = None) -> Iterator[None]:
    """Let other processes compile ahead during a ``with`` block, where that is of use.

    Kernels of the planner are, as soon as the block turns out to need them compiled.

    Parameters
    ----------
    board : str, optional
        Whose twin runs what is planned in the block.
    """
    started: dict[str, subprocess.Popen[bytes] | None] = {}

    def start(part: str, *, of_use: bool) -> None:
        started[part] = None
        if of_use:
            command = [sys.executable, "-P", "-m", "pulsewright.app.rehearsal", part]
            quiet = subprocess.DEVNULL
            started[part] = subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet)

    def needed(kernel: compiled.Kernel) -> None:
        for part, names in PLANNER.items():
            if kernel.__module__ == FIRST and part not in started:
                start(part, of_use=not all(_kernel(name).kept() for name in names))
            process = started.get(part)
            if process is not None and kernel in map(_kernel, names):
                _await(kernel, process)

    compiled.watchers.append(needed)
    try:
        if board is not None:
            twin = import_module(f"pulsewright.boards.{board}.twin_kernel")
            start(board, of_use=not compiled.kept(twin))
        yield
    finally:
        compiled.watchers.remove(needed)
        processes = [process for process in started.values() if process is not None]
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


def _kernel(name: str) -> compiled.Kernel:
    module, _, function = name.rpartition(".")
    kernel: compiled.Kernel = getattr(import_module(module), function)
    return kernel


def _await(kernel: compiled.Kernel, process: subprocess.Popen[bytes]) -> None:
    """Wait until a kernel is ready, or its process has ended for another reason."""
    while process.poll() is None and not kernel.kept():
        time.sleep(PAUSE)


def rehearse(part: str) -> None:
    """Do a part of planning, or a run on the twin of a board, with one move."""
    compiled.always()
    if part == "speeds":
        _speeds()
    elif part == "law":
        _law()
    else:
        _verify()  # last in a job, which compiles the rest of a run meanwhile
        _run(part)


def _program() -> Program:
    from pulsewright.motion.gcode import interpret_text

    return interpret_text("F60 G1 X1\n")


def _speeds() -> None:
    """Plan the speeds on a line."""
    from pulsewright.motion.path import Limits
    from pulsewright.motion.speeds import speeds

    one = np.ones(1)
    limits = Limits(np.eye(1, 6), np.zeros(1, np.int64), np.ones(1, np.int64), *(one,) * 6)
    line, cells = _line()
    speeds(line, limits, cells, 0.0, 0.0)


def _law() -> None:
    """Find a time law on a line; certify another one."""
    from pulsewright.motion.certificate import certify
    from pulsewright.motion.law import law
    from pulsewright.motion.machine import Machine

    line, cells = _line()
    b, a, split = np.array([0.0, 1.0, 0.0]), np.zeros(3), np.full(2, 0.5)
    law(line, cells.element, cells.offset, cells.size, b, a, split)
    certify(_by_hand(), _program().moves, Machine.default())


def _line() -> tuple[Elements, Cells]:
    """Return a line of 1 mm, and its two cells."""
    from pulsewright.motion.cell_law import Cells
    from pulsewright.motion.path import Elements

    t = _by_hand()
    line = Elements(
        *(t.poly, t.cosine, t.sine, t.omega, t.length, t.move),
        dwell=np.zeros(1),
        feed=np.ones(1),
        rest=np.ones(1, np.bool_),
    )
    cells = Cells(
        element=np.zeros(2, np.int64),
        offset=np.array([0.0, 0.5]),
        size=np.array([0.5, 0.5]),
        rest=np.array([False, True]),
        row=np.zeros(2, np.int64),
        share=np.full((1, 1, 6), 0.01),
        rows=np.ones(1, np.int64),
    )
    return line, cells


def _verify() -> None:
    """Look at a recording of a machine that did not move."""
    from pulsewright.edges.path import numbered_pins
    from pulsewright.edges.timing import DriveTiming
    from pulsewright.edges.trace import EdgeTrace
    from pulsewright.motion.machine import Machine
    from pulsewright.verify.verifier import Verifier

    machine, plan, clock = Machine.default(), _by_hand(), 1_000_000
    matrix = machine.motor_matrix()
    verifier = Verifier(
        trajectory=plan,
        moves=_program().moves,
        motor_matrix=matrix,
        limits=machine.limit_rows(),
        clock_hz=clock,
        motors=numbered_pins(len(matrix)),
        drives=[DriveTiming(0.0, 0.0, 0.0, 0.0)] * len(matrix),
    )
    pins = tuple(f"{kind}{n}" for n in range(len(matrix)) for kind in ("step", "dir"))
    still = np.zeros(0, np.int64)
    end = round(2 * plan.duration * clock)
    verifier.feed(
        EdgeTrace(clock, pins, np.zeros(len(pins), np.uint8), (still,) * len(pins), 0, end)
    )
    verifier.finish()


def _run(board: str) -> None:
    """Run a line on the twin of a board."""
    from pulsewright.app.planning import Clock
    from pulsewright.app.run import Job
    from pulsewright.motion.certificate import Certifier
    from pulsewright.motion.machine import Machine

    machine, program = Machine.default(), _program()
    certificate = Certifier(machine, program.moves.start).finish()
    Job(program, machine, _by_hand(), certificate, Clock()).run(board=board, link="twin:")


def _by_hand() -> Trajectory:
    """Return a plan that took no planner: 1 mm of X in 1 s."""
    from pulsewright.motion.trajectory import Trajectory

    poly = np.zeros((1, 4, 6))
    poly[0, 1, 0] = 1.0
    none, first = np.zeros((1, 6)), np.zeros(1, np.int32)
    law = np.array([[0.0, 0.0, 3.0, -2.0]])
    ends = np.array([0.0, 1.0])
    return Trajectory(poly, none, none, np.zeros(1), np.ones(1), first, first, ends, law)


if __name__ == "__main__":
    if sys.argv[1] != "speeds":
        os.nice(NICE)
    rehearse(sys.argv[1])
