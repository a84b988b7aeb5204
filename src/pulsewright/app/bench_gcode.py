"""How fast programs are interpreted, beside LinuxCNC's interpreter where it is installed.

Times are CPU time, medians of a few runs with warm kernels. Programs of the corpus are measured
where it lies beside the checkout.
"""

from __future__ import annotations

import math
import resource
import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from pulsewright.motion.gcode import InterpreterSettings

RUNS: Final = 3
ENOUGH: Final = 0.05  # [s]
LINES: Final = 1_000_000
CORPUS: Final = Path(__file__).parents[3].parent / "shared" / "ngc" / "corpus"
TIMEOUT: Final = 300.0  # [s] that the other interpreter may take

Row = tuple[str, float, str, str]  # what, value, unit, aim


def surface(path: Path, lines: int) -> None:
    """Write a surfacing program: rows across a relief of some millimetres, as for a ball mill."""
    _raster(
        path,
        lines,
        lambda _, x, y: (
            2 * math.sin(0.31 * x) * math.cos(0.23 * y) + 0.8 * math.sin(0.9 * x + 0.7 * y)
        ),
    )


def teeth(path: Path, lines: int) -> None:
    """Write the same with a sharp corner at two of three lines, as hard to plan as may be."""
    _raster(path, lines, lambda i, *_: i * 37 % 101 / 100)


def _raster(path: Path, lines: int, height: Callable[[int, float, float], float]) -> None:
    """Write plain motion lines to and fro, with a height of the line and its place [mm]."""
    with path.open("w", encoding="ascii") as file:
        file.write("G21 G90 G94 G64 P0.02\nF1500\nG0 Z5\n")
        for i in range(lines):
            row, column = divmod(i, 500)
            x, y = 0.2 * (column if row % 2 == 0 else 499 - column), 0.1 * (row % 1000)
            file.write(f"G1 X{x:.3f} Y{y:.3f} Z{height(i, x, y):.3f}\n")
        file.write("G0 Z5\nM2\n")


def rows(lines: int = LINES) -> list[Row]:
    """Return what was measured: the plain program, then those of the corpus that are there."""
    from pulsewright.motion.gcode import InterpreterSettings, interpret
    from pulsewright.motion.moves import AXES

    settings = InterpreterSettings(axes=AXES)
    found: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / "surface.ngc"
        surface(plain, 1000)
        interpret(plain, settings=settings)  # loads the kernels
        surface(plain, lines)
        spent = cpu_time(lambda: _parse(plain, settings))
        what = f"plain motion lines to state, {lines / 1e6:g} M lines"
        found.append((what, lines / spent / 1e6, "M lines/s", ">= 5"))
        spent = cpu_time(lambda: interpret(plain, settings=settings))
        found.append(("the same, to planned moves' columns", lines / spent / 1e6, "M lines/s", "-"))
        found += _beside(plain, "plain motion lines", lines, "M lines/s")
    for name, aim, calls in (("3D_Chips.ngc", ">= 0.2", False), ("flowsnake.ngc", ">= 0.1", True)):
        program = CORPUS / name
        if not program.is_file():
            continue
        count = _calls(program) if calls else program.read_bytes().count(b"\n")
        unit = "M calls/s" if calls else "M lines/s"
        spent = cpu_time(lambda program=program: interpret(program, settings=settings))  # type: ignore[misc]
        found.append((name, count / spent / 1e6, unit, aim))
        found += _beside(program, name, count, unit)
    return found


def _parse(path: Path, settings: InterpreterSettings) -> None:
    """Interpret a program to the state at its end, its moves in program coordinates."""
    from pulsewright.motion.gcode.bulk import Bulk
    from pulsewright.motion.gcode.flow import Flow
    from pulsewright.motion.gcode.interpreter import Interpreter
    from pulsewright.motion.gcode.recorder import Recorder
    from pulsewright.motion.gcode.source import Source

    source, recorder = Source.from_file(path), Recorder(settings.start)
    interpreter = Interpreter(settings, recorder)
    Flow(interpreter, source, Bulk(interpreter, recorder, source).run).run()


def _calls(path: Path) -> int:
    """Return how many canonical calls a program makes."""
    from pulsewright.motion.gcode import canonical

    lines: list[str] = []
    canonical(path, lines.append)
    return len(lines)


def cpu_time(run: Callable[[], Any]) -> float:
    """Return CPU time of one run [s]: a median of `RUNS`, or of as many as take `ENOUGH`."""
    spent: list[float] = []
    while len(spent) < RUNS or sum(spent) < ENOUGH:
        start = time.process_time()
        run()
        spent.append(time.process_time() - start)
    return statistics.median(spent)


def _beside(path: Path, what: str, count: int, unit: str) -> list[Row]:
    """Measure LinuxCNC's ``rs274`` on the same program."""
    program = shutil.which("rs274")
    if program is None:
        return []

    def run() -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run(
                [program, "-g", str(path.resolve())],
                cwd=folder,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=TIMEOUT,
                check=False,
            )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    spent = statistics.median(run() for _ in range(RUNS))
    return [(f"{what}: rs274", count / spent / 1e6, unit, "-")]
