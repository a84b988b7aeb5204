"""A twin behind a real interface, in real time: other programs take it for the board.

A serial board listens at a pseudo-terminal, which any program opens like ``/dev/ttyUSB0``. The
twin's clock follows the computer's: bytes take the time they take on the wire, and what the
computer is late with, the twin catches up.
"""

from __future__ import annotations

import os
import select
import signal
import time
import tty
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any, Final

from pulsewright import boards
from pulsewright.edges.writer import TraceWriter
from pulsewright.errors import UsageError

PERIOD: Final = 1e-3  # how often the twin is brought up to the present [s]
BLOCK: Final = 4096  # bytes taken from the terminal at once
PTY: Final = "pty:"


def serve(
    board: str,
    *,
    listen: str,
    profile: str | None = None,
    trace: Path | None = None,
    ready: Callable[[str], None] = print,
    stop: Callable[[], bool] = lambda: False,
    options: Mapping[str, int] | None = None,
) -> dict[str, Any]:
    """Serve a twin until interrupted, terminated or told to stop.

    Parameters
    ----------
    board : str
        One with a serial bus.
    listen : str
        ``pty:PATH``: a pseudo-terminal, with a link to it at ``PATH``.
    profile : str, optional
        Default: the board's.
    trace : Path, optional
        File that gets every change of every pin at the end: ``*.npz``.
    ready : callable
        Gets a line of text once clients can come.
    stop : callable
        Asked every millisecond.
    options : mapping of str to int, optional
        Profile switches and parameters of the board: channels, baud1.

    Returns
    -------
    dict
        ``board``, ``profile``, ``seconds`` served, ``received`` and ``sent`` bytes, and the twin's
        ``state``.

    Raises
    ------
    UsageError
        If the board has no serial bus, or something is at ``PATH`` already, or an option is wrong.
    """
    room = boards.get(board)
    if room.bus != "serial":
        raise UsageError(
            f"serve: {board} is on an {room.bus.upper()} bus, and only boards with a serial one "
            f"can be served at a terminal: "
            f"{', '.join(b.name for b in boards.BOARDS.values() if b.bus == 'serial')}"
        )
    if not listen.startswith(PTY) or listen == PTY:
        raise UsageError(f"serve: listen at 'pty:PATH', a link that is made, not at '{listen}'")
    profile = room.default_profile if profile is None else profile
    options = options or {}
    room.switches(profile, **options)
    twin = room.twin(profile, **options)
    received = sent = 0
    with ExitStack() as stack:
        host = stack.enter_context(_terminal(Path(listen.removeprefix(PTY))))
        stopped = stack.enter_context(_signals())
        first = twin.drain()
        keep = None
        if trace is not None:
            keep = stack.enter_context(
                TraceWriter(trace, first.clock_hz, first.pins, first.initial, first.start)
            )
            keep.append(first)
        _warm_up(room.twin(profile, **options))
        start = time.monotonic()
        ready(f"{board}, profile {profile}, listens at {listen.removeprefix(PTY)}")
        while not stopped() and not stop():
            if select.select([host], [], [], PERIOD)[0]:
                data = os.read(host, BLOCK)
                received += len(data)
                twin.send(1, data)
            cycle = max(int((time.monotonic() - start) * twin.clock_hz), twin.now)
            twin.advance(cycle)
            if reply := twin.receive(1):
                sent += len(reply)
                _write(host, reply)
            chunk = twin.drain(copy=False)
            if keep is not None:
                keep.append(chunk)
        seconds = time.monotonic() - start
    return {
        "board": board,
        "profile": profile,
        "seconds": seconds,
        "received": received,
        "sent": sent,
        "state": twin.state(),
    }


def text(served: dict[str, Any]) -> str:
    """Return what was served for people."""
    state = served["state"]
    lines = [
        f"{served['board']}, profile {served['profile']}: {served['seconds']:.1f} s, "
        f"{served['received']} bytes in, {served['sent']} out"
    ]
    for n, (pulses, lost) in enumerate(zip(state["pulses"], state["lost"], strict=True)):
        lines.append(f"motor {n}: {pulses} steps, {lost} lost")
    return "\n".join(lines)


def _warm_up(twin: Any) -> None:
    """Have all kernels compiled, on a twin that nobody sees."""
    twin.send(1, b"\xd5")
    twin.advance(twin.now + 1)
    twin.receive(1)
    twin.drain(copy=False)


def _write(host: int, data: bytes) -> None:
    """Give bytes to the terminal; where nobody reads they are lost at last, as on a wire."""
    with suppress(BlockingIOError):
        os.write(host, data)


@contextmanager
def _terminal(link: Path) -> Iterator[int]:
    """Make a raw pseudo-terminal with a link to it; yield the host's side."""
    if link.is_symlink() and not link.exists():
        link.unlink()  # of a server that was killed
    if link.is_symlink() or link.exists():
        raise UsageError(f"serve: {link} exists; give another path, or remove it")
    host, terminal = os.openpty()  # our own end stays open, or a client that leaves closes it
    try:
        tty.setraw(terminal)
        os.set_blocking(host, False)
        try:
            link.symlink_to(os.ttyname(terminal))
        except OSError as error:
            raise UsageError(f"serve: {link} cannot be made ({error.strerror})") from error
        try:
            yield host
        finally:
            link.unlink(missing_ok=True)
    finally:
        os.close(host)
        os.close(terminal)


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
