"""The command line: one function per command, each a thin layer over a call anyone can make."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from pulsewright.errors import (
    BusError,
    CheckFailedError,
    EstopError,
    PulsewrightError,
    StoppedError,
    UsageError,
)

# plain help: rich help costs more time to import than everything else together
app = typer.Typer(
    name="pulsewright",
    help="FPGA motion control from register map to moving machine.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
)

ProgramFile = Annotated[Path, typer.Argument(metavar="FILE", help="G-code program.")]
MachineFile = Annotated[
    Path | None, typer.Option("--machine", metavar="TOML", help="Machine file; default built in.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]


def _print_json(value: Any) -> None:
    print(json.dumps(value, indent=2))


def _show(result: Any, as_json: bool) -> None:
    """Print a result that has ``summary`` and ``text``."""
    if as_json:
        _print_json(result.summary())
    else:
        print(result.text())


def _judge(result: Any, as_json: bool) -> None:
    """Print a result and exit with 1 if it has not passed."""
    _show(result, as_json)
    if not result.passed:
        raise typer.Exit(1)


@contextmanager
def _feed(control: str | None, hold: bool) -> Iterator[Any]:
    """Yield what other programs control the feed of a run by; None if they do not."""
    if control is None:
        if hold:
            raise UsageError("--hold begins held, and nothing could resume: give --control, too")
        yield None
        return
    from pulsewright.app.feed import FeedControl
    from pulsewright.app.feed_channel import listening

    feed = FeedControl()
    if hold:
        feed.hold()
    with listening(feed, control):
        yield feed


@app.command()
def run(
    file: ProgramFile,
    machine: MachineFile = None,
    board: Annotated[
        str | None, typer.Option(help="Board; default as the machine file says.")
    ] = None,
    profile: Annotated[
        str | None, typer.Option(help="Profile of the board's document switches.")
    ] = None,
    link: Annotated[str | None, typer.Option(metavar="URL", help="Link to the board.")] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where reports go; default out/<program>.")
    ] = None,
    vcd: Annotated[bool, typer.Option("--vcd", help="Write trace.vcd too, for GTKWave.")] = False,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Keep all that goes over the link.")
    ] = None,
    referenced: Annotated[
        bool, typer.Option("--referenced", help="The machine was referenced after a failed run.")
    ] = False,
    control: Annotated[
        str | None,
        typer.Option(metavar="URL", help="unix:PATH: JSON commands hold, resume, override, stop."),
    ] = None,
    hold: Annotated[
        bool, typer.Option("--hold", help="Begin held, until `resume` comes by --control.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Interpret, plan, convert, run and verify a program; exit 0 only if every check passes."""
    from pulsewright.app import run as job_module
    from pulsewright.app.memory import keep_freed_memory
    from pulsewright.app.progress import progress

    keep_freed_memory()
    with _feed(control, hold) as feed, progress() as report_progress:
        result = job_module.run_file(
            file,
            machine=machine,
            board=board,
            profile=profile,
            link=link,
            out=out,
            vcd=vcd,
            record=record,
            referenced=referenced,
            feed=feed,
            progress=report_progress,
        )
    _judge(result, as_json)


@app.command()
def plan(
    file: ProgramFile,
    machine: MachineFile = None,
    canon: Annotated[
        bool, typer.Option("--canon", help="Print canonical commands, as rs274 -g does.")
    ] = False,
    tools: Annotated[Path | None, typer.Option(metavar="FILE", help="--canon: tool table.")] = None,
    parameters: Annotated[
        Path | None, typer.Option(metavar="FILE", help="--canon: parameter file.")
    ] = None,
    subroutines: Annotated[
        list[str] | None,
        typer.Option(metavar="FOLDER", help="--canon: folder of subroutine files; repeatable."),
    ] = None,
    block_delete: Annotated[
        bool, typer.Option("--block-delete", help="--canon: skip lines that begin with /.")
    ] = False,
    save: Annotated[
        bool, typer.Option("--save", help="--canon: write parameters and tools back.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Plan a program without running it: time, statistics and the certificate of its limits."""
    if canon:
        from pulsewright.app.canon import print_canonical

        print_canonical(
            file,
            machine=machine,
            tools=tools,
            parameters=parameters,
            subroutines=subroutines or (),
            block_delete=block_delete,
            save=save,
        )
        return
    from pulsewright.app.memory import keep_freed_memory
    from pulsewright.app.planning import plan_file
    from pulsewright.app.progress import progress
    from pulsewright.app.rehearsal import rehearsed

    keep_freed_memory()
    with rehearsed(), progress() as report_progress:
        outline = plan_file(file, machine=machine, progress=report_progress)
    _show(outline, as_json)


@app.command()
def regs(
    board: Annotated[str, typer.Argument(metavar="BOARD", help="For example usc.")],
    output: Annotated[
        str, typer.Option("--format", help="table, md, json, c or html.", metavar="FORMAT")
    ] = "table",
) -> None:
    """Print the register map of a board."""
    from pulsewright.app.regs import render

    print(render(board, output))


@app.command()
def program(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Program text for the executor of an s3g board.")
    ],
    channels: Annotated[int | None, typer.Option(help="Channels of the board; default 2.")] = None,
    simulate: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Run it on a twin, for so long at most.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Assemble, check and simulate a program that an s3g board runs; exit 0 only without errors."""
    from pulsewright.app import program as program_module

    result = program_module.run(file, channels=channels, seconds=simulate)
    _judge(result, as_json)


@app.command()
def serve(
    board: Annotated[str, typer.Argument(metavar="BOARD", help="For example usc.")],
    listen: Annotated[
        str,
        typer.Option(
            metavar="URL",
            help="epp+unix:PATH, epp+tcp:HOST:PORT; pty:PATH, tcp:HOST:PORT; spi+unix:PATH.",
        ),
    ],
    profile: Annotated[
        str | None, typer.Option(help="Profile of the board's document switches.")
    ] = None,
    time: Annotated[
        str, typer.Option(metavar="MODE", help="EPP: wall, or lockstep:US (servo period).")
    ] = "wall",
    access_ns: Annotated[int, typer.Option(help="EPP, lockstep: cost of a request [ns].")] = 1500,
    boards: Annotated[int, typer.Option(help="usc: boards on the bus.")] = 1,
    ident: Annotated[
        str | None, typer.Option(metavar="HEX", help="usc: module ID, 41 or 42.")
    ] = None,
    loopback: Annotated[
        str | None, typer.Option(metavar="on|off", help="usc: steps count in the encoders.")
    ] = None,
    require_config: Annotated[
        bool, typer.Option("--require-config", help="EPP: mute until configuration bytes come.")
    ] = False,
    channels: Annotated[int | None, typer.Option(help="s3g: motors; default 2.")] = None,
    switch: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=N", help="Profile switch or parameter of the board."),
    ] = None,
    control: Annotated[
        str | None, typer.Option(metavar="URL", help="unix:PATH: JSON commands, for tests.")
    ] = None,
    remote: Annotated[
        bool, typer.Option("--remote", help="Allow addresses that other computers can reach.")
    ] = False,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE", help="EPP: step positions by servo cycle.")
    ] = None,
    trace: Annotated[
        Path | None, typer.Option(metavar="FILE", help="EPP: all data writes, as text.")
    ] = None,
    edges: Annotated[
        Path | None, typer.Option(metavar="FILE", help="All pin changes, at the end (.npz).")
    ] = None,
    as_json: Json = False,
) -> None:
    """Put a simulated board behind a real interface, until interrupted.

    Prints 'ready' on standard output once clients can come, and what was served at the end.
    """
    from pulsewright.app import serve as serve_module

    def ready(line: str) -> None:
        print(line, file=sys.stderr, flush=True)
        print("ready", flush=True)

    served = serve_module.serve(
        board,
        listen=listen,
        profile=profile,
        time=time,
        access_ns=access_ns,
        boards_on_bus=boards,
        require_config=require_config,
        control=control,
        remote=remote,
        record=record,
        trace=trace,
        edges=edges,
        ready=ready,
        options=serve_module.options(ident, loopback, channels, switch or []),
    )
    if as_json:
        _print_json(served)
    else:
        print(serve_module.text(served))


@app.command()
def check(
    board: Annotated[str, typer.Argument(metavar="BOARD", help="For example pluto_step.")],
    golden: Annotated[
        list[Path], typer.Option(metavar="PATH", help="Recordings, or folders of them.")
    ],
    engine: Annotated[str, typer.Option(help="twin, rtl or both.")] = "both",
    as_json: Json = False,
) -> None:
    """Replay recordings of the original controller; exit 0 only if every pin change matches."""
    from pulsewright.app import check as check_module
    from pulsewright.app.progress import progress

    with progress() as report_progress:
        result = check_module.check(board, golden, engine, report_progress)
    _judge(result, as_json)


@app.command()
def build(
    board: Annotated[str, typer.Argument(metavar="BOARD", help="For example pluto_step.")],
    platform: Annotated[str | None, typer.Option(help="FPGA board; default ulx3s.")] = None,
    profile: Annotated[
        str | None, typer.Option(help="Profile of the board's document switches.")
    ] = None,
    axes: Annotated[int | None, typer.Option(help="Axes to bring out; default all.")] = None,
    encoders: Annotated[
        int | None, typer.Option(help="Encoders (rapcores); default as many as axes.")
    ] = None,
    motor_driver: Annotated[
        str | None,
        typer.Option(metavar="step_dir|h_bridge", help="rapcores: what drives the motors."),
    ] = None,
    pins: Annotated[
        Path | None, typer.Option(metavar="TOML", help="Which signal is at which pin.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Default out/<board>-<platform>.")
    ] = None,
    verilog: Annotated[bool, typer.Option("--verilog", help="Write Verilog only.")] = False,
    as_json: Json = False,
) -> None:
    """Build a bitstream with tools from pip; a missed timing goal is an error."""
    from pulsewright.app import build as build_module
    from pulsewright.app.progress import progress

    with progress() as report_progress:
        result = build_module.run(
            board,
            platform=platform,
            profile=profile,
            axes=axes,
            encoders=encoders,
            motor_driver=motor_driver,
            out=out,
            verilog=verilog,
            pins=pins,
            progress=report_progress,
        )
    _show(result, as_json)


@app.command()
def bench(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="twin, job, motion, links or area; default: all but the last two.",
        ),
    ] = None,
    page: Annotated[
        Path | None, typer.Option(metavar="FILE", help="For area: write its table as Markdown.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Measure speed against real time, or size and clock of the gateware, in one run."""
    from pulsewright.app import bench as bench_module
    from pulsewright.app.memory import keep_freed_memory
    from pulsewright.app.progress import progress

    keep_freed_memory()
    with progress() as report_progress:
        results = bench_module.run(name, page=page, progress=report_progress)
    if as_json:
        _print_json(results)
    else:
        print(bench_module.text(results))


@app.command()
def replay(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording of a link.")],
    engine: Annotated[str, typer.Option(help="twin or rtl.")] = "twin",
    edges: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write all pin changes (.npz).")
    ] = None,
    as_json: Json = False,
) -> None:
    """Do a recorded session again on a simulated board; exit 0 only if its answers are equal."""
    from pulsewright.app import replay as replay_module
    from pulsewright.app.progress import progress

    with progress() as report_progress:
        result = replay_module.replay(file, engine=engine, edges=edges, progress=report_progress)
    _judge(result, as_json)


@app.command()
def diff(
    first: Annotated[Path, typer.Argument(metavar="FILE", help="Recording, or trace (.npz).")],
    second: Annotated[Path, typer.Argument(metavar="FILE", help="Another one of the kind.")],
    as_json: Json = False,
) -> None:
    """Say where two recordings of links, or two traces of pins, first differ; exit 0 if nowhere."""
    from pulsewright.app import replay as replay_module

    _judge(replay_module.diff(first, second), as_json)


@app.command()
def doctor(as_json: Json = False) -> None:
    """Tell what is installed, which links and tools are usable, and what to do about the rest."""
    from pulsewright.app import doctor as doctor_module

    _show(doctor_module.examine(), as_json)


def _terminate(number: int, frame: object) -> None:
    """Leave by way of all clean-ups."""
    sys.exit(128 + number)


def _complain(message: str, error: BaseException) -> None:
    """Print an error, with notes of where the machine stands."""
    for line in (message, *getattr(error, "__notes__", ())):
        print(f"pulsewright: {line}", file=sys.stderr)


@contextmanager
def _cleanly_ended() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM leave by way of all clean-ups, in the main thread."""
    before = {}
    with suppress(ValueError):  # not in the main thread
        for number in (signal.SIGTERM, signal.SIGINT):  # typer ends on an interrupt without a word
            before[number] = signal.signal(number, _terminate)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@_cleanly_ended()
def main() -> None:
    """Run the command line; errors become one line and an exit code.

    2: unusable request or input; 1: a check failed, the link was lost, the board or a client
    stopped it; 130: interrupted; 143: terminated. Before that boards come to rest on their path and
    are stopped, and files that are not whole are removed.
    """
    try:
        sys.exit(app(standalone_mode=False))
    except PulsewrightError as error:
        _complain(str(error), error)
        failed = CheckFailedError | BusError | EstopError | StoppedError
        sys.exit(1 if isinstance(error, failed) else 2)
    except typer.Abort as error:
        _complain("interrupted", error)
        sys.exit(128 + signal.SIGINT)
    except SystemExit as error:
        ended = {128 + signal.SIGINT: "interrupted", 128 + signal.SIGTERM: "terminated"}
        if error.code in ended:
            _complain(ended[error.code], error)
        raise
    except Exception as error:
        if hasattr(error, "format_message") and hasattr(error, "exit_code"):  # usage, from typer
            print(f"pulsewright: {error.format_message()}", file=sys.stderr)
            sys.exit(int(error.exit_code))
        raise
