"""A twin behind a real interface: other programs take it for the board.

A board on an EPP bus answers requests of the EPP socket protocol, in the time of its clients or in
lockstep with their servo cycles. A serial or SPI board runs in real time: its clock follows the
computer's, bytes take the time they take on the wire, and what the computer is late with, the twin
catches up. ``docs/clients.md`` shows what to start for which program.
"""

from __future__ import annotations

import signal
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Final

from pulsewright import boards
from pulsewright.boards.board import Board
from pulsewright.boards.links import constant
from pulsewright.edges.trace import EdgeTrace
from pulsewright.edges.writer import TraceWriter
from pulsewright.errors import UsageError
from pulsewright.transport import epp_socket, spi_socket
from pulsewright.transport.server import LineSession, Server
from pulsewright.transport.spi_bus import HALF_PERIOD

TICK: Final = 1e-3  # how often a board in real time is brought up to the present [s]
LOCKSTEP: Final = "lockstep:"
SCHEMES: Final = {
    "epp": ("epp+unix:", "epp+tcp:"),
    "serial": ("pty:", "tcp:"),
    "spi": ("spi+unix:", "spi+tcp:"),
}

BUS_NAMES: Final = {"epp": "an EPP bus", "serial": "a serial port", "spi": "an SPI bus"}


def serve(
    board: str,
    *,
    listen: str,
    profile: str | None = None,
    time: str = "wall",
    access_ns: int = 1500,
    boards_on_bus: int = 1,
    require_config: bool = False,
    control: str | None = None,
    remote: bool = False,
    record: Path | None = None,
    trace: Path | None = None,
    edges: Path | None = None,
    ready: Callable[[str], None] = print,
    stop: Callable[[], bool] = lambda: False,
    options: Mapping[str, int] | None = None,
) -> dict[str, Any]:
    """Serve a twin until interrupted, terminated or told to stop.

    Parameters
    ----------
    board : str
        A key of `boards.BOARDS`.
    listen : str
        ``epp+unix:PATH`` or ``epp+tcp:HOST:PORT`` for a board on an EPP bus; ``pty:PATH`` (a
        pseudo-terminal, with a link to it at ``PATH``) or ``tcp:HOST:PORT`` for one with a serial
        port; ``spi+unix:PATH`` or ``spi+tcp:HOST:PORT`` for one with SPI.
    profile : str, optional
        Default: the board's.
    time : str
        ``wall``, or ``lockstep:US`` with the servo period [us]; EPP only.
    access_ns : int
        Cost of a request in lockstep [ns]; EPP only.
    boards_on_bus : int
        How many boards there are on the bus; USC only.
    require_config : bool
        Let boards answer only after configuration bytes; EPP only.
    control : str, optional
        ``unix:PATH`` of a control channel.
    remote : bool
        Allow addresses that other computers can reach.
    record, trace : Path, optional
        Files that get step positions by servo cycle, and all data writes; EPP only.
    edges : Path, optional
        File that gets every change of every pin at the end: ``*.npz``.
    ready : callable
        Gets a line of text once clients can come.
    stop : callable
        Asked every few milliseconds.
    options : mapping of str to int, optional
        Profile switches and parameters of the board: ident, loopback, channels, baud1.

    Returns
    -------
    dict
        ``board``, ``profile``, ``seconds`` served, ``received`` and ``sent`` bytes and the twin's
        ``state``; of EPP boards also ``frames``, servo ``cycles`` and their ``overruns``.

    Raises
    ------
    UsageError
        If an address cannot be listened at or is for another kind of board, or an option is wrong.
    """
    room = boards.get(board)
    profile = room.default_profile if profile is None else profile
    options = dict(options or {})
    room.switches(profile, **options)
    url = _url(room, listen)
    if room.bus == "epp":
        options["access_cycles"] = 0
    elif time != "wall" or boards_on_bus != 1 or require_config or record or trace:
        raise UsageError(
            f"serve: {board} is not on an EPP bus; --time, --boards, --require-config, --record "
            "and --trace are for boards that are"
        )
    if boards_on_bus != 1:
        if board != "usc":
            raise UsageError(f"serve: there is one {board} at a port; --boards is for usc")
        options["boards"] = boards_on_bus
    with ExitStack() as stack:
        server = Server()
        twin = room.twin(profile, **options)
        keep = stack.enter_context(_edge_file(edges, twin)) if edges is not None else None
        if room.bus == "epp":
            served: _Served = _EppServed(
                stack, twin, _lockstep(time), access_ns, require_config, record, trace, keep
            )
        elif room.bus == "serial":
            served = _SerialServed(room.twin(profile, **options), twin, keep)
        else:
            served = _SpiServed(room, profile, options, twin, keep)
        place = stack.enter_context(
            server.listen(url, served.session, most=served.most, remote=remote)
        )
        if control is not None:
            channel = served.control(server)
            stack.enter_context(
                server.listen(control, lambda c: LineSession(c, channel.answer), remote=remote)
            )
        stopped = stack.enter_context(_signals())
        start = clock.monotonic()
        served.start()
        prefix = listen[: len(listen) - len(url)]
        ready(f"{board}, profile {profile}, listens at {prefix}{place}")
        server.run(lambda: stopped() or stop(), served.tick, TICK if served.tick else 0.05)
        seconds = clock.monotonic() - start
        summary = served.summary()
    return {
        "board": board,
        "profile": profile,
        "seconds": seconds,
        "received": server.taken + summary.pop("received", 0),
        "sent": server.sent + summary.pop("sent", 0),
        **summary,
    }


def options(
    ident: str | None, loopback: str | None, channels: int | None, switches: Sequence[str]
) -> dict[str, int]:
    """Return switches and parameters of a board from words of the command line.

    Parameters
    ----------
    ident : str, optional
        Module ID, hexadecimal.
    loopback : str, optional
        ``on`` or ``off``.
    channels : int, optional
    switches : sequence of str
        ``NAME=N``, with N decimal or, after ``0x``, hexadecimal.

    Raises
    ------
    UsageError
        If a word is none of these.
    """
    found: dict[str, int] = {}
    if ident is not None:
        try:
            found["ident"] = int(ident, 16)
        except ValueError:
            raise UsageError(f"serve: --ident {ident}; it is two hexadecimal digits: 42") from None
    if loopback is not None:
        if loopback not in ("on", "off"):
            raise UsageError(f"serve: --loopback {loopback}; there are on and off")
        found["loopback"] = int(loopback == "on")
    if channels is not None:
        found["channels"] = channels
    for word in switches:
        name, _, value = word.partition("=")
        try:
            found[name] = int(value, 0)
        except ValueError:
            raise UsageError(f"serve: --set {word}; it is NAME=N, with an integer") from None
    return found


def text(served: dict[str, Any]) -> str:
    """Return what was served for people."""
    state = served["state"]
    lines = [
        f"{served['board']}, profile {served['profile']}: {served['seconds']:.1f} s, "
        f"{served['received']} bytes in, {served['sent']} out"
    ]
    if "frames" in served:
        lines.append(
            f"{served['frames']} requests, {served['cycles']} servo cycles, "
            f"{served['overruns']} overruns"
        )
    if served.get("lost"):
        lines.append(
            f"time stood still for {served['lost']:.1f} s: this computer is too slow for that board"
        )
    if "lost" in state and "pulses" in state:
        for n, (pulses, lost) in enumerate(zip(state["pulses"], state["lost"], strict=True)):
            lines.append(f"motor {n}: {pulses} steps, {lost} lost")
    else:
        positions = state["steps"] if "step_edges" in state else state["position"]
        lines.append(f"step positions: {', '.join(map(str, positions))}")
    return "\n".join(lines)


def _url(room: Board, listen: str) -> str:
    """Return the address without the name of the bus, if it is one for the board."""
    schemes = SCHEMES[room.bus]
    for scheme in schemes:
        if listen.startswith(scheme):
            return listen.removeprefix(f"{room.bus}+")
    raise UsageError(
        f"serve: {room.name} is on {BUS_NAMES[room.bus]} and listens at {schemes[0]}PATH or "
        f"{schemes[1]}HOST:PORT, not at '{listen}'"
    )


def _lockstep(time: str) -> int:
    """Return the servo period of a time mode [us]; 0: wall mode."""
    if time == "wall":
        return 0
    period = time.removeprefix(LOCKSTEP)
    if not time.startswith(LOCKSTEP) or not period.isdecimal() or int(period) == 0:
        raise UsageError(
            f"serve: time '{time}'; there are wall and lockstep:US, with the servo period in us"
        )
    return int(period)


class _Served:
    """One kind of bus: what makes its sessions, what happens by time, what is left at the end."""

    most = 32
    tick: Callable[[], None] | None = None
    session: Callable[[Any], Any]
    port: Any

    def start(self) -> None:
        """Begin; nothing needs compiling from here on."""

    def control(self, server: Server) -> Any:
        """Return the commands of a control channel."""
        from pulsewright.boards.control import LiveControl

        return LiveControl(self.port, server.stop, server.cut)

    def summary(self) -> dict[str, Any]:
        """Return what is left at the end."""
        self.port.catch_up()
        return {"lost": self.port.lost, "state": self.port.twin.state()}


class _EppServed(_Served):
    def __init__(
        self,
        stack: ExitStack,
        twin: Any,
        lockstep_us: int,
        access_ns: int,
        require_config: bool,
        record: Path | None,
        trace: Path | None,
        keep: Callable[[EdgeTrace], None] | None,
    ) -> None:
        from pulsewright.boards.epp_port import EppPort

        self.port = EppPort(
            twin,
            lockstep_us=lockstep_us,
            access_ns=access_ns,
            require_config=require_config,
            record=None if record is None else stack.enter_context(_file(record, "wb")),
            trace=None if trace is None else stack.enter_context(_file(trace, "w")),
            edges=keep,
        )
        self.session = epp_socket.listener(self.port)

    def control(self, server: Server) -> Any:
        from pulsewright.boards.control import EppControl

        return EppControl(self.port, server.stop, server.cut)

    def summary(self) -> dict[str, Any]:
        self.port.finish()
        link = self.port.link
        return {
            "received": int(link["bytes_in"]),
            "sent": int(link["bytes_out"]),
            "frames": int(link["frames"]),
            "cycles": int(link["markers"]),
            "overruns": int(link["overruns"]),
            "state": self.port.twin.state(),
        }


class _SerialServed(_Served):
    def __init__(self, spare: Any, twin: Any, keep: Callable[[EdgeTrace], None] | None) -> None:
        from pulsewright.boards.live import SerialPort

        spare.send(1, b"\xd5")  # on a twin that nobody sees, to have all kernels compiled
        spare.advance(spare.now + 1)
        spare.receive(1)
        spare.drain(copy=False)
        self.port = SerialPort(twin, keep)
        self.session = self.port.session
        self.tick = self.port.tick

    def start(self) -> None:
        self.port.start()


class _SpiServed(_Served):
    def __init__(
        self,
        room: Board,
        profile: str,
        options: dict[str, int],
        twin: Any,
        keep: Callable[[EdgeTrace], None] | None,
    ) -> None:
        from pulsewright.boards.live import SpiPort

        listens = constant(room, "RESET_CYCLES")
        spare = SpiPort(room.twin(profile, **options), HALF_PERIOD, listens)
        spare.transfer(bytes(16))  # on a twin that nobody sees, to have all kernels compiled
        spare.transfer(bytes(8), keep_selected=True)
        spare.twin.state()
        self.port = SpiPort(twin, HALF_PERIOD, listens, keep)
        self.session = spi_socket.listener(self.port)
        self.tick = self.port.catch_up

    def start(self) -> None:
        self.port.start()


@contextmanager
def _edge_file(path: Path, twin: Any) -> Iterator[Callable[[EdgeTrace], None]]:
    """Write all pin changes to a file; yield what takes them in pieces."""
    first = twin.drain()
    with TraceWriter(path, first.clock_hz, first.pins, first.initial, first.start) as writer:
        writer.append(first)
        yield writer.append


@contextmanager
def _file(path: Path, mode: str) -> Iterator[Any]:
    try:
        file = path.open(mode)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror})") from error
    with file:
        yield file


@contextmanager
def _signals() -> Iterator[Callable[[], bool]]:
    """Turn interruption and termination into an orderly end; yield whether one came."""
    came: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        came.append(number)

    before = {}
    for number in (signal.SIGINT, signal.SIGTERM):
        try:
            before[number] = signal.signal(number, note)
        except ValueError:  # not the main thread: the caller has `stop`
            break
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
