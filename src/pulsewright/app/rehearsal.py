"""Compiling ahead: on a first run, other processes compile what this one needs later.

Kernels are compiled where they are first called, one after the other, and kept on disk for all
processes; see `pulsewright.compiled`. So while the first stages of a job compile theirs here, its
later ones are done elsewhere for one short move: they find their kernels ready.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Final

import numpy as np

from pulsewright import compiled

if TYPE_CHECKING:
    from pulsewright.motion.moves import Program
    from pulsewright.motion.trajectory import Trajectory

NICE: Final = 5  # the process that is waited for comes first


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

    def start(part: str, module: str) -> None:
        started[part] = None
        if not compiled.kept(import_module(module)):
            command = [sys.executable, "-P", "-m", "pulsewright.app.rehearsal", part]
            quiet = subprocess.DEVNULL
            started[part] = subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet)

    def needed(module: str) -> None:
        if module == "pulsewright.motion.path" and "plan" not in started:
            start("plan", "pulsewright.motion.plan_kernels")

    compiled.watchers.append(needed)
    try:
        if board is not None:
            start(board, f"pulsewright.boards.{board}.twin_kernel")
        yield
    finally:
        compiled.watchers.remove(needed)
        processes = [process for process in started.values() if process is not None]
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


def rehearse(part: str) -> None:
    """Do ``plan``, or a run on the twin of a board, with one move."""
    compiled.always()
    if part == "plan":
        _plan()
    else:
        _verify()  # last in a job, which compiles the rest of a run meanwhile
        _run(part)


def _program() -> Program:
    from pulsewright.motion.gcode import interpret_text

    return interpret_text("F60 G1 X1\n")


def _plan() -> None:
    """Plan the speeds on a line, and certify them."""
    from pulsewright.motion.cell_law import Cells
    from pulsewright.motion.certificate import certify
    from pulsewright.motion.machine import Machine
    from pulsewright.motion.path import Elements, Limits
    from pulsewright.motion.plan_kernels import law, speeds

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
    one = np.ones(1)
    limits = Limits(
        np.eye(1, 6), np.zeros(1, np.int64), np.ones(1, np.int64), one, one, one, one, one
    )
    b, a, split, _ = speeds(line, limits, cells, 0.0, 0.0)
    pieces = law(line, cells.element, cells.offset, cells.size, b, a, split)
    certify(t.timed(*pieces), _program().moves, Machine.default())


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
    os.nice(NICE)
    rehearse(sys.argv[1])
