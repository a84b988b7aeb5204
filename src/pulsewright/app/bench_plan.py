"""How fast programs are planned, and how near to the second-order optimum of the same path.

An aim for the time over T2 is out of reach where T3 over T2 is more: then no plan of that path with
that limit of jerk is as fast; see `bench_optimum`.

Times are CPU time, medians of a few runs with warm kernels; those of a first result are what a user
waits. Programs are those of the corpus, where it lies beside the checkout. Every plan has to pass
its certificate.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from pulsewright import compiled
from pulsewright.app.bench_gcode import CORPUS, LINES, RUNS, Row, cpu_time, surface, teeth
from pulsewright.app.memory import keep_freed_memory, peak_memory
from pulsewright.errors import UsageError

if TYPE_CHECKING:
    from pulsewright.motion.machine import Machine
    from pulsewright.motion.moves import Moves

SPEED: Final = 200.0  # of every axis [mm/s]; 5 times that of A [degrees/s]
ACCELERATION: Final = 3000.0  # [mm/s^2]
JERKS: Final = {1e6: "<= 1.10", 3e5: "<= 1.20"}  # [mm/s^3], and the aim
TOLERANCES: Final = (0.02, 0.05)  # [mm]
PARTS: Final = 8  # of each blend, for the optimum
TELLING: Final = 1.005  # ratio of T3 to T2 from which on it is told
CHORDS: Final = 1000
PRINTED: Final = 20_000
SURFACED: Final = 20_000
FIRST_LINES: Final = (2, 1000)  # few, which Python plans, and more than that


class Measured(NamedTuple):
    """A plan, and what no plan of the same path can be faster than."""

    time: float  # [s]
    second: float  # T2 [s]
    third: float  # T3 [s]


def rows() -> list[Row]:
    """Return what was measured: time over the optimum, speed, a circle in chords, memory."""
    from pulsewright.motion.plan import plan

    compiled.always()
    programs = {path.name: _moves(path) for path in sorted(CORPUS.glob("*")) if _is_program(path)}
    with tempfile.TemporaryDirectory() as folder:
        surface(program := Path(folder) / "surface.ngc", SURFACED)
        programs[f"{SURFACED:,} lines of a surface"] = _moves(program)
    found: list[Row] = []
    for jerk, aim in JERKS.items():
        machine = bench_machine(jerk)
        for tolerance in TOLERANCES:
            for name, moves in programs.items():
                result = measured(blended(moves, tolerance), machine)
                what = f"{name}, {jerk:g} mm/s^3, {tolerance:g} mm"
                found.append((f"time over T2, {what}", result.time / result.second, "", aim))
                if result.third > TELLING * result.second:
                    least = result.third / result.second
                    found.append((f"least possible: T3 over T2, {what}", least, "", ""))
    machine = bench_machine(max(JERKS))
    for name, moves in programs.items():
        spent = cpu_time(partial(plan, blended(moves, TOLERANCES[0]), machine))
        found.append((f"planning of {name}", len(moves) / spent / 1e6, "M moves/s", ">= 2"))
    for jerk in JERKS:
        ratio = _chorded(bench_machine(jerk))
        found.append((f"circle in chords over the circle, {jerk:g} mm/s^3", ratio, "", "<= 1.03"))
    spent = _board_words(machine)
    what = f"file to board words, 4 axes, usc, {PRINTED:,} lines like those of a print"
    found.append((what, PRINTED / spent / 1e6, "M lines/s", ">= 0.5"))
    for write in (surface, teeth):
        spent, memory = _whole_file(write)
        what = f"interpreting, planning and certifying {LINES:,} lines, {write.__name__}"
        found.append((what, LINES / spent / 1e6, "M lines/s", ""))
        found.append((f"{what}, peak memory", memory, "MB", "< 300"))
    for lines in FIRST_LINES:
        cold, kept = _first_results(lines)
        what = f"first result: plan of {lines:,} lines, a new process"
        found.append((f"{what}, kernels kept on disk", kept, "s", "<= 0.8"))
        found.append((f"{what}, no kernel compiled yet", cold, "s", "<= 6"))
    return found


def bench_machine(jerk: float) -> Machine:
    """Return a fast machine without bounds of travel."""
    from pulsewright.motion.machine import Machine

    machine = Machine.default()
    changes = {"min": -1e6, "max": 1e6, "acceleration": ACCELERATION, "jerk": jerk}
    axes = {
        letter: axis.model_copy(
            update=changes | {"velocity": SPEED * (5 if letter == "A" else 1)},
        )
        for letter, axis in machine.axis.items()
    }
    return machine.model_copy(update={"axis": axes})


def blended(moves: Moves, tolerance: float) -> Moves:
    """Return ``moves`` with another tolerance, where they have one."""
    limit = np.where(moves.tolerance > 0, tolerance, 0.0)
    return replace(moves, tolerance=limit, collapse=np.zeros(len(moves)))


def measured(moves: Moves, machine: Machine) -> Measured:
    """Return the time of a plan, and bounds of it.

    Raises
    ------
    UsageError
        If the plan fails its certificate.
    """
    from pulsewright.app.bench_optimum import bound, optimum
    from pulsewright.motion.plan import blended_path, certify, plan

    trajectory = plan(moves, machine)
    certificate = certify(trajectory, moves, machine)
    if not certificate.passed:
        raise UsageError(f"a plan of the benchmark fails its certificate: {certificate}")
    elements, limits = blended_path(moves, machine)
    return Measured(
        time=trajectory.duration,
        second=optimum(elements, limits, PARTS),
        third=bound(elements, limits, PARTS),
    )


def _is_program(path: Path) -> bool:
    return path.suffix in {".ngc", ".nc", ".gcode"}


def _moves(path: Path) -> Moves:
    from pulsewright.motion.gcode import InterpreterSettings, interpret

    return interpret(path, settings=InterpreterSettings(axes="XYZA")).moves


def _chorded(machine: Machine) -> float:
    """Return the time of a circle in chords over that of the circle itself."""
    from pulsewright.motion.gcode import InterpreterSettings, interpret_text
    from pulsewright.motion.plan import plan

    settings = InterpreterSettings(start=(20.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    angle = np.linspace(0, 2 * np.pi, CHORDS + 1)[1:]
    points = zip(20 * np.cos(angle), 20 * np.sin(angle), strict=True)
    head = f"G64 P{TOLERANCES[0]}\nF{60 * SPEED}\n"
    chords = "".join(f"G1 X{x:.6f} Y{y:.6f}\n" for x, y in points)
    long, short = (
        plan(interpret_text(head + text, settings=settings).moves, machine).duration
        for text in (chords, "G3 X20 Y0 I-20 J0\n")
    )
    return long / short


def printing(path: Path, lines: int) -> None:
    """Write a program like those of slicers, A the extruder: outlines in short chords, infill."""
    chords, infill = 200, 40
    around = np.linspace(0.0, 2 * np.pi, chords, endpoint=False)
    shape = (
        np.stack([np.cos(around), np.sin(around)], axis=1) * (1 + 0.1 * np.cos(5 * around))[:, None]
    )
    across = np.linspace(-11.0, 11.0, infill)
    sides = np.where(np.arange(infill) % 4 < 2, 11.0, -11.0)
    layer = [shape * size for size in (19.6, 19.2, 18.8)] + [np.stack([across, sides], axis=1)]
    points = np.concatenate(layer)
    length = np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=1)
    with path.open("w", encoding="ascii") as file:
        file.write("G21 G90 G94 G64 P0.02\nF6000\n")
        extruded = 0.0
        for n in range(lines):
            k = n % len(points)
            extruded += 5.0 * length[k]
            height = f" Z{0.2 * (n // len(points)):.1f}" if k == 0 else ""
            file.write(f"G1 X{points[k, 0]:.3f} Y{points[k, 1]:.3f}{height} A{extruded:.4f}\n")
        file.write("M2\n")


def _board_words(machine: Machine) -> float:
    """Return CPU time from a print to what is written to a USC [s], its plan not certified."""
    from pulsewright.app.planning import interpreter_settings
    from pulsewright.boards.usc.commands import Converter, PulseTiming
    from pulsewright.motion.gcode import interpret
    from pulsewright.motion.plan import plan

    timing = PulseTiming(width=25, space=25, setup=50, div_offset=0, access=10)
    matrix = machine.motor_matrix()
    rate, acceleration, _ = machine.motor_limits().max(axis=1)
    update = timing.update_period(rate, acceleration)

    def convert(path: Path) -> None:
        moves = interpret(path, settings=interpreter_settings(machine)).moves
        trajectory = plan(moves, machine).mapped(matrix)
        converter = Converter(trajectory, timing, first_cycle=0, update=update)
        while not converter.done:
            converter.convert(10_000)

    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "print.ngc"
        printing(program, PRINTED)
        convert(program)  # compiles
        return cpu_time(partial(convert, program))


def _first_results(lines: int) -> tuple[float, float]:
    """Return the times that a user waits for a first plan, and later ones, a median [s]."""
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "lines.ngc"
        moves = "".join(f"G1 X{10 + n % 2} Y{n % 100}\n" for n in range(lines))
        program.write_text(f"G21 G90 G64 P0.05 F1000\n{moves}M2\n", "ascii")
        command = [sys.executable, "-m", "pulsewright", "plan", str(program)]
        environment = os.environ | {"NUMBA_CACHE_DIR": folder}
        waited = []
        for _ in range(1 + RUNS):
            begin = time.monotonic()
            subprocess.run(command, env=environment, stdout=subprocess.DEVNULL, check=True)
            waited.append(time.monotonic() - begin)
    return waited[0], statistics.median(waited[1:])


def _whole_file(write: Callable[[Path, int], None]) -> tuple[float, float]:
    """Return CPU time [s] and peak memory [MB] of a process that plans a long program."""
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "long.ngc"
        write(program, LINES)
        command = [sys.executable, "-m", "pulsewright.app.bench_plan", str(program)]
        output = subprocess.run(command, capture_output=True, text=True, check=False)
    if output.returncode:
        raise UsageError(f"the benchmark of a long program failed: {output.stderr.strip()}")
    spent, memory = map(float, output.stdout.split())
    return spent, memory


def _plan_process(path: Path) -> None:
    """Plan a program; print CPU time [s] and peak memory of this process [MB]."""
    from pulsewright.app.planning import plan_file

    keep_freed_memory()
    outline = plan_file(path, machine=bench_machine(max(JERKS)))
    print(outline.clock.total, peak_memory())


if __name__ == "__main__":
    _plan_process(Path(sys.argv[1]))
