"""Speed against real time and size of gateware, each measured in one run on one machine.

Speeds are CPU time of one process, so that other work on a shared machine blurs them little;
compiled kernels are warm. Nothing here decides whether a test passes.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pulsewright.app.memory import peak_memory
from pulsewright.app.progress import Progress, silent
from pulsewright.errors import UsageError
from pulsewright.files import replacing

if TYPE_CHECKING:
    from numpy.typing import NDArray

Figures = list[dict[str, Any]]

TWIN_SECONDS: Final = 60
TWIN_RATE: Final = 50_000  # [step/s] of each of four axes
TWIN_ACCELERATION: Final = 500_000  # [step/s^2] of the moves of RAPcores
ENCODER_COUNTS: Final = 5_000  # [count/s] of each encoder
HOUR: Final = 3600.0


def run(
    name: str | None = None, *, page: Path | None = None, progress: Progress = silent
) -> Figures:
    """Run one benchmark, or all that need no tools for FPGAs.

    Parameters
    ----------
    name : str, optional
        One of `BENCHMARKS`; None: those of speed.
    page : Path, optional
        For ``area``: also write the table as Markdown.

    Returns
    -------
    list of dict
        ``name``, ``what``, ``value``, ``unit`` and ``aim`` of each figure.

    Raises
    ------
    UsageError
        If there is no benchmark of that name, or no page of it.
    """
    if name is not None and name not in BENCHMARKS:
        raise UsageError(f"no benchmark '{name}'; there are {', '.join(BENCHMARKS)}")
    if page is not None and name != "area":
        raise UsageError("--page is for 'bench area', which can write its table as Markdown")
    if name == "area":
        return area(page, progress)
    if name == "links":
        from pulsewright.app.bench_links import links

        return links()
    results: Figures = []
    for key in [name] if name else list(SPEED):
        progress(key, 0.0)
        results += SPEED[key]()
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
    """Axes at 50 k step/s with new rates every ms, on each board.

    EPP boards: once the twin alone, from a ready array of bus accesses to edges in its buffers, and
    once with the driver that makes the accesses and a copy of the edges. S3G: the board's own
    program sets the rates.
    """
    return _usc_twin() + _pluto_step_twin() + _s3g_twin() + _rapcores_twin()


def _usc_twin() -> Figures:
    from pulsewright.boards import open_board
    from pulsewright.boards.usc import registers as reg
    from pulsewright.boards.usc.burst import AXES
    from pulsewright.boards.usc.commands import Updates

    driver = open_board("usc")
    driver.initialise(pulse_width=2.5e-6, setup_time=5e-6)
    driver.release_estop()
    period = reg.TICK_HZ // TWIN_RATE + _wobble(AXES)  # 199, 200, 201 ticks
    divisor = (period - driver.div_offset).astype(np.uint32)
    control, count = np.full(1000, 0xFF, np.uint8), np.zeros((1000, AXES), np.int64)
    return _twin_figures("usc", driver, lambda cycle: Updates(cycle, divisor, control, count))


def _pluto_step_twin() -> Figures:
    from pulsewright.boards import open_board
    from pulsewright.boards.pluto_step import registers as reg
    from pulsewright.boards.pluto_step.burst import AXES
    from pulsewright.boards.pluto_step.commands import Updates
    from pulsewright.boards.pluto_step.limits import units_per_step

    driver = open_board("pluto_step")
    driver.initialise(step_time=2.5e-6, direction_time=5e-6, max_rate=1.1 * TWIN_RATE)
    driver.release_estop()
    word = round(TWIN_RATE * units_per_step(driver.tap) / reg.TICK_HZ)
    velocity, count = (word + _wobble(AXES)).astype(np.int16), np.zeros((1000, AXES), np.int64)
    return _twin_figures("pluto_step", driver, lambda cycle: Updates(cycle, velocity, count))


def _s3g_twin() -> Figures:
    from pulsewright.boards.s3g import registers as reg
    from pulsewright.boards.s3g.driver import S3GDriver
    from pulsewright.boards.s3g.program import assemble
    from pulsewright.boards.s3g.twin import S3GTwin
    from pulsewright.transport.serial_bus import VirtualSerialBus

    twin = S3GTwin()
    driver = S3GDriver(VirtualSerialBus(twin))
    driver.initialise(pulse_width=2e-6, direction_setup=5e-6)
    driver.release_estop()
    channels = reg.CHANNELS
    word = round(TWIN_RATE * 2**16 / reg.CLOCK_HZ)
    bits = " | ".join(f"SET_V[{c}]" for c in range(channels))
    lines = [
        f"OUTPUT ASG_DT_VAL, {reg.CLOCK_HZ // 1000}",
        f"OUTPUT ASG_CONTROL, STEPS_LIMIT | DT_LIMIT | RESET_STEPS | {bits}",
        "OUTPUT ASG_STEPS_VAL, 1",
    ]
    for n, words in enumerate(word + _wobble(channels)):
        lines += [f"OUTPUT V_VAL[{c}], {v}" for c, v in enumerate(words)]
        # the last one goes on until the program is started again
        lines += ["OUTPUT ASG_STEPS_VAL, 100"] * (n == 999)
        lines += ["STB ASG_LOAD"] + ["WAIT_ALL ASG_DONE", "CLEAR ASG_DONE"] * (n < 999)
    driver.write_program(assemble("\n".join([*lines, "DONE 0"])))
    alone, edges = _Stopwatch(), 0
    advance, drain = alone.timing(twin.advance), alone.timing(twin.drain)
    for second in range(TWIN_SECONDS + 2):
        if second == 2:
            alone.seconds, edges = 0.0, 0
        end = driver.start_program(0) + reg.CLOCK_HZ
        while twin.now < end:
            advance(min(twin.now + reg.CLOCK_HZ // 10, end))
            edges += sum(len(cycles) for cycles in drain(copy=False).cycles)
        driver.clear_interrupts(1 << reg.INT_ASG_DONE)
    what = f"{channels} channels x {TWIN_RATE // 1000} k step/s, 1 kHz loads by its program"
    speed, rate = TWIN_SECONDS / alone.seconds, edges / alone.seconds / 1e6
    return [
        _figure("twin", f"s3g twin alone: {what}", speed, "x real time", ">= 300"),
        _figure("twin", "edges recorded by the twin", rate, "M/s", "-"),
    ]


def _rapcores_twin() -> Figures:
    from pulsewright.boards.rapcores import registers as reg
    from pulsewright.boards.rapcores.twin import RapcoresTwin
    from pulsewright.transport.spi_bus import HALF_PERIOD

    twin = RapcoresTwin()
    motors, moves, ticks = reg.MOTORS, 500, 800  # moves and ticks per move for a second
    period = reg.CLOCK_HZ // (moves * ticks)
    top = reg.HEADER_MOVE << (reg.WORD_BITS - 8)
    words = np.zeros((moves, 2 + 2 * motors), np.int64)
    words[:, 0], words[:, 1] = top, ticks
    rates = TWIN_RATE * np.arange(2, 2 + motors) / (1 + motors)  # 20, 30, 40, 50 k step/s
    steps = rates * (1 + 1e-3 * _wobble(motors)[:moves]) / (moves * ticks)
    words[:, 2::2] = steps * 2.0 ** (reg.WORD_BITS - 1)
    # moves speed up and slow down in turns, by 2 % of the fastest
    change = TWIN_ACCELERATION / (moves * ticks) ** 2 * 2.0 ** (reg.WORD_BITS - 1)
    words[0::2, 3::2], words[1::2, 3::2] = change, -change
    messages = [row.tobytes() for row in words]
    swap = reg.HEADER_CONFIG_SWAP << (reg.WORD_BITS - 8) | reg.W_DIVIDER
    divider = b"".join(word.to_bytes(8, "little") for word in (swap, period - 1))
    turning = np.arange(ENCODER_COUNTS * reg.ENCODERS)  # A and B of all encoders in turns
    pins = len(twin.input_pins) - 2 * reg.ENCODERS + turning % (2 * reg.ENCODERS)
    levels = turning // (2 * reg.ENCODERS) + 1 & 1
    _, begin = twin.transfer(reg.RESET_CYCLES, divider, HALF_PERIOD)
    space = reg.CLOCK_HZ // moves

    def play(first: int, begin: int) -> int:
        """Play a second from ``first`` on, whose first message comes at ``begin``."""
        twin.schedule(first + turning * (reg.CLOCK_HZ // len(turning)), pins, levels)
        edges = 0
        for n, message in enumerate(messages):
            twin.transfer(first + n * space if n else begin, message, HALF_PERIOD)
            if n % 100 == 99:
                edges += sum(len(cycles) for cycles in twin.drain(copy=False).cycles)
        return edges

    alone, edges, first = _Stopwatch(), 0, begin + space
    timed = alone.timing(play)
    for second in range(TWIN_SECONDS + 2):
        if second == 2:
            alone.seconds, edges = 0.0, 0
        # the very first message comes early, so that one move always waits
        edges += timed(first, first if second else begin)
        first += reg.CLOCK_HZ
    if (state := twin.state())["refused"] or state["completed"] < moves * TWIN_SECONDS:
        raise UsageError(f"the benchmark of the rapcores twin went wrong: {state}")
    what = (
        f"{motors} motors at 20 to {TWIN_RATE // 1000} k step/s, {moves} moves/s that accelerate, "
        f"{reg.ENCODERS} encoders at {ENCODER_COUNTS // 1000} k counts/s"
    )
    speed, rate = TWIN_SECONDS / alone.seconds, edges / alone.seconds / 1e6
    return [
        _figure("twin", f"rapcores twin alone: {what}", speed, "x real time", ">= 300"),
        _figure("twin", "edges recorded by the twin", rate, "M/s", "-"),
    ]


def _wobble(axes: int) -> NDArray[np.int64]:
    """Return small numbers for 1000 updates, so that every write is a change."""
    turns = (np.arange(1000)[:, None] + np.arange(axes)) % 4
    return np.array([-1, 0, 1, 0], np.int64).take(turns)


def _twin_figures(board: str, driver: Any, updates: Callable[[NDArray[np.int64]], Any]) -> Figures:
    """Time the twin behind ``driver``; ``updates`` makes a second of them at given cycles."""
    twin = driver.bus.twin
    millisecond = twin.clock_hz // 1000
    alone, whole, edges = _Stopwatch(), _Stopwatch(), 0
    transact = twin.transact

    def play(second: Any) -> None:
        driver.stream(second)
        twin.drain()

    first = twin.now + millisecond
    for second in range(2 * TWIN_SECONDS + 2):
        by_itself, warm = second % 2 == 0, second >= 2
        # for the twin alone, the time of the bus call only, and edges are looked at in place
        twin.transact = alone.timing(transact) if by_itself and warm else transact
        columns = updates(first + (np.arange(1000) + 1000 * second) * millisecond)
        if by_itself:
            driver.stream(columns)
            drain = alone.timing(twin.drain) if warm else twin.drain
            chunk = drain(copy=False)
            edges += sum(len(c) for c in chunk.cycles) if warm else 0
        else:
            (whole.timing(play) if warm else play)(columns)
    driver.check_running()
    what = f"4 axes x {TWIN_RATE // 1000} k step/s, 1 kHz register writes"
    speed, played = TWIN_SECONDS / alone.seconds, TWIN_SECONDS / whole.seconds
    return [
        _figure("twin", f"{board} twin alone: {what}", speed, "x real time", ">= 1000"),
        _figure("twin", "with its driver, edges copied", played, "x real time", "-"),
        _figure("twin", "edges recorded by the twin", edges / alone.seconds / 1e6, "M/s", "-"),
    ]


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
    steps = 0 if result.verdict is None else result.verdict.steps
    print(result.job.duration, spent, steps, peak_memory())


def motion() -> Figures:
    """Programs interpreted, beside LinuxCNC's interpreter where it is installed, and planned."""
    from pulsewright.app import bench_gcode, bench_plan

    return [_figure("motion", *row) for row in bench_gcode.rows() + bench_plan.rows()]


def area(page: Path | None = None, progress: Progress = silent) -> Figures:
    """Size and speed of all gateware on both FPGA families; ``page`` gets the table.

    Raises
    ------
    UsageError
        If a tool is missing, or the page cannot be written.
    """
    from pulsewright.app import build

    rows = build.area(build.DESIGNS, build.SEEDS, progress)
    if page is not None:
        with replacing(page) as temporary:
            temporary.write_text(build.area_page(rows))
    figures = []
    for row in rows:
        what, aim = f"{row.design.name} on {row.device}", row.aim
        lut = "-" if aim.lut is None else f"<= {aim.lut}"
        figures.append(_figure("area", what, row.resources.lut, "LUT", lut))
        if row.clock_mhz is not None:
            clock = "-" if aim.clock_mhz is None else f">= {aim.clock_mhz:g}"
            figures.append(_figure("area", f"{what}, median", row.clock_mhz, "MHz", clock))
    return figures


SPEED: Final[dict[str, Callable[[], Figures]]] = {"twin": twin, "job": job, "motion": motion}
BENCHMARKS: Final = (*SPEED, "links", "area")

if __name__ == "__main__":
    _job_process(Path(sys.argv[1]), Path(sys.argv[2]))
