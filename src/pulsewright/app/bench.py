"""Speed against real time, all of it measured in one run on one machine.

Figures are CPU time of one process, so that other work on a shared machine blurs them little;
compiled kernels are warm. Nothing here decides whether a test passes.
"""

from __future__ import annotations

import math
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pulsewright.app.progress import Progress, silent
from pulsewright.errors import UsageError

if TYPE_CHECKING:
    from pulsewright.boards.usc.commands import Updates
    from pulsewright.boards.usc.driver import UscDriver

Figures = list[dict[str, Any]]

TWIN_SECONDS: Final = 60
TWIN_RATE: Final = 50_000  # [step/s] of each of four axes
HOUR: Final = 3600.0


def run(name: str | None = None, *, progress: Progress = silent) -> Figures:
    """Run one benchmark, or all of them.

    Returns
    -------
    list of dict
        ``name``, ``what``, ``value``, ``unit`` and ``aim`` of each figure.

    Raises
    ------
    UsageError
        If there is no benchmark of that name.
    """
    if name is not None and name not in BENCHMARKS:
        raise UsageError(f"no benchmark '{name}'; there are {', '.join(BENCHMARKS)}")
    results: Figures = []
    for key in [name] if name else list(BENCHMARKS):
        progress(key, 0.0)
        results += BENCHMARKS[key]()
        progress(key, 1.0)
    return results


def text(results: Figures) -> str:
    """Return figures for people, one per line."""
    return "\n".join(
        f"{r['name']:<6} {r['value']:>10.4g} {r['unit']:<12} aim {r['aim']:<8} {r['what']}"
        for r in results
    )


def _figure(name: str, what: str, value: float, unit: str, aim: str) -> dict[str, Any]:
    return {"name": name, "what": what, "value": value, "unit": unit, "aim": aim}


def twin() -> Figures:
    """Four axes at 50 k step/s, all divisors rewritten with new values every ms.

    Once the twin alone, from a ready array of bus accesses to edges in its buffers, and once with
    the driver that makes the accesses and a copy of the edges.
    """
    from pulsewright.boards.usc import registers as reg
    from pulsewright.boards.usc.burst import AXES
    from pulsewright.boards.usc.commands import Updates
    from pulsewright.boards.usc.driver import UscDriver
    from pulsewright.boards.usc.twin import UscTwin
    from pulsewright.transport.virtual import VirtualEppBus

    twin = UscTwin()
    driver = UscDriver(VirtualEppBus(twin))
    driver.initialise(pulse_width=2.5e-6, setup_time=5e-6)
    driver.release_estop()
    millisecond = reg.CLOCK_HZ // 1000
    wobble = np.array([-1, 0, 1, 0])  # periods of 199, 200, 201 ticks: every write is a change
    period = reg.TICK_HZ // TWIN_RATE + wobble[(np.arange(1000)[:, None] + np.arange(AXES)) % 4]
    alone, whole, edges = _Stopwatch(), _Stopwatch(), 0
    transact = twin.transact
    first = twin.now + millisecond
    for second in range(2 * TWIN_SECONDS + 2):
        by_itself, warm = second % 2 == 0, second >= 2
        # for the twin alone, the time of the bus call only, and edges are looked at in place
        twin.transact = alone.timing(transact) if by_itself and warm else transact  # type: ignore[method-assign]
        cycle = first + (np.arange(1000) + 1000 * second) * millisecond
        updates = Updates(
            cycle=cycle.astype(np.int64),
            divisor=(period - driver.div_offset).astype(np.uint32),
            control=np.full(1000, 0xFF, np.uint8),
            count=np.zeros((1000, AXES), np.int64),
        )
        if by_itself:
            driver.stream(updates)
            drain = alone.timing(twin.drain) if warm else twin.drain
            chunk = drain(copy=False)
            edges += sum(len(c) for c in chunk.cycles) if warm else 0
        else:
            play = whole.timing(_play) if warm else _play
            play(driver, updates)
    driver.check_running()
    what = f"4 axes x {TWIN_RATE // 1000} k step/s, 1 kHz register writes"
    return [
        _figure(
            "twin",
            f"usc twin alone: {what}",
            TWIN_SECONDS / alone.seconds,
            "x real time",
            ">= 1000",
        ),
        _figure(
            "twin",
            "with its driver, edges copied",
            TWIN_SECONDS / whole.seconds,
            "x real time",
            "-",
        ),
        _figure("twin", "edges recorded by the twin", edges / alone.seconds / 1e6, "M/s", "-"),
    ]


def _play(driver: UscDriver, updates: Updates) -> None:
    driver.stream(updates)
    driver.bus.twin.drain()  # type: ignore[attr-defined]


class _Stopwatch:
    """CPU time of all calls that went through `timing` [s]."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def timing(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return ``function`` with its time counted."""

        def timed(*arguments: Any, **options: Any) -> Any:
            start = time.process_time()
            result = function(*arguments, **options)
            self.seconds += time.process_time() - start
            return result

        return timed


def surfacing(path: Path, seconds: float) -> None:
    """Write a program that scans a wavy surface at 1500 mm/min for about ``seconds``."""
    feed, length, pitch = 25.0, 180.0, 0.4
    rows = math.ceil(seconds * feed / length)
    x = np.linspace(0.0, length, 181)
    with path.open("w", encoding="ascii") as file:
        file.write("G21 G90 G64 P0.01\nG0 X0 Y0 Z5\nF1500\n")
        for row in range(rows):
            y = pitch * abs((row + 400) % 800 - 400)
            z = np.sin(x / 9.0) * np.cos(y / 7.0) * 1.5
            points = zip(x, z, strict=True)
            for px, pz in points if row % 2 == 0 else reversed(list(points)):
                file.write(f"G1 X{px:.3f} Y{y:.3f} Z{pz:.4f}\n")
        file.write("G0 Z5\nM2\n")


def job() -> Figures:
    """Whole main job of an hour: plan, convert, twin, verify and write, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "surface.ngc"
        surfacing(program, HOUR)
        command = [sys.executable, "-m", "pulsewright.app.bench", str(program), folder]
        output = subprocess.run(command, capture_output=True, text=True, check=False)
        if output.returncode:
            raise UsageError(f"the job benchmark failed: {output.stderr.strip()}")
        duration, spent, steps, memory = (float(word) for word in output.stdout.split()[-4:])
    what = f"surfacing, {duration / 60:.0f} min of machine time, {steps / 1e6:.1f} M steps"
    return [
        _figure("job", f"whole main job: {what}", duration / spent, "x real time", ">= 200"),
        _figure("job", "peak memory of that process", memory, "MB", "< 1000"),
    ]


def _job_process(program: Path, folder: Path) -> None:
    """Run a program twice, first a short one for warm kernels; print what `job` reads."""
    from pulsewright.app.run import run_file

    short = folder / "short.ngc"
    surfacing(short, 10.0)
    run_file(short, out=folder / "short")
    start = time.process_time()
    result = run_file(program, out=folder / "whole")
    spent = time.process_time() - start
    if not result.passed:
        raise SystemExit(result.text())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(result.job.duration, spent, result.verdict.steps, peak)


BENCHMARKS: Final[dict[str, Callable[[], Figures]]] = {"twin": twin, "job": job}

if __name__ == "__main__":
    _job_process(Path(sys.argv[1]), Path(sys.argv[2]))
