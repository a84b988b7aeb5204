"""Servers for programs that want to talk to a board: sockets and pseudo-terminals, one event loop.

What bytes mean is a `Session`'s business, one per connection. Buffers are bounded: a connection
whose replies are not taken is not read from, one that may have to wait (`Connection.hold`) neither.
"""

from __future__ import annotations

import ipaddress
import os
import select
import socket
import stat
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from pulsewright.errors import UsageError
from pulsewright.transport.address import host_and_port
from pulsewright.transport.pollfd import POLL

BLOCK: Final = 4096  # bytes taken from a connection at once
CONNECTIONS: Final = 32  # at a listener; further ones are closed at once
PATIENCE: Final = 0.05  # how often `stop` is asked when nothing happens [s]
PTY, UNIX, TCP = "pty:", "unix:", "tcp:"


class ProtocolError(Exception):
    """What a session raises to have its connection closed."""


class Session(Protocol):
    """What one client says, and what it is told."""

    def received(self, data: memoryview) -> None:
        """Take bytes, valid during the call, 1 to `BLOCK` of them; reply by `Connection.send`.

        Raises
        ------
        ProtocolError
            To have the connection closed.
        """

    def closed(self) -> None:
        """Note that the connection is over."""


class Connection:
    """One client; a session gets it to reply."""

    def __init__(
        self, server: Server, channel: socket.socket | Terminal, listener: Listener | None
    ) -> None:
        self._server, self._channel, self._listener = server, channel, listener
        self._backlog = b""
        self._held_until = 0.0
        self._paused = False
        self.fd = channel.fileno()
        self.session: Session

    def send(self, data: bytes) -> None:
        """Send bytes; what the client does not take at once waits, and nothing is read from it."""
        self._server.sent += len(data)
        if self._backlog or self._held_until:
            self._backlog += data
            return
        try:
            done = self._channel.send(data)
        except BlockingIOError:
            done = 0
        except OSError:  # gone; its end of file follows
            return
        if done < len(data):
            if isinstance(self._channel, Terminal):
                return  # where nobody reads, bytes are lost at last, as on a wire
            self._backlog = data[done:]
            self._watch()

    def hold(self, seconds: float) -> None:
        """Let the client wait: for so long it gets nothing, and nothing is read from it [s]."""
        self._held_until = time.monotonic() + seconds
        self._server.held.add(self)
        self._watch()

    def pause(self, on: bool) -> None:
        """Read nothing from the client, or go on."""
        if on != self._paused:
            self._paused = on
            self._watch()

    def close(self) -> None:
        """Close the connection; a second call does nothing."""
        if self.fd < 0:
            return
        self._server.forget(self)
        self._channel.close()
        self.fd = -1
        if self._listener is not None:
            self._listener.connections.discard(self)
        self.session.closed()

    def release(self, now: float) -> None:
        """End a hold that is over."""
        if self.fd >= 0 and now < self._held_until:
            return
        self._server.held.discard(self)
        self._held_until = 0.0
        if self.fd >= 0:
            self._flush()

    @property
    def polls(self) -> NDArray[np.void]:
        """All file descriptors that the server looks at, and for what: (n,) `POLL`."""
        return self._server.polls

    @property
    def can_end(self) -> bool:
        """Whether it is a socket's; a terminal outlives its clients."""
        return not isinstance(self._channel, Terminal)

    @property
    def held_until(self) -> float:
        """Monotonic time at which a hold ends [s]."""
        return self._held_until

    def ready(self, events: int) -> None:
        """Do what the operating system says can be done."""
        if self._held_until or self._paused:  # only its end can be the reason
            self.close()
            return
        if self._backlog:
            self._flush()
            return
        try:
            data = self._channel.recv(BLOCK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self.close()
            return
        self._server.taken += len(data)
        try:
            self.session.received(memoryview(data))
        except ProtocolError:
            self.close()

    def _flush(self) -> None:
        data, self._backlog = self._backlog, b""
        self._server.sent -= len(data)
        self.send(data)
        self._watch()

    def _watch(self) -> None:
        if self.fd < 0:
            return
        if self._held_until:
            events = 0
        elif self._backlog:
            events = select.POLLOUT
        else:
            events = 0 if self._paused else select.POLLIN
        self._server.watch(self.fd, events)


class Listener:
    """A socket at which clients come.

    Parameters
    ----------
    make : callable
        Makes the `Session` of a `Connection`.
    most : int
        Clients at the same time.
    """

    def __init__(
        self,
        server: Server,
        channel: socket.socket,
        make: Callable[[Connection], Session],
        most: int,
    ) -> None:
        self._server, self._channel, self._make, self._most = server, channel, make, most
        self.connections: set[Connection] = set()

    def ready(self, events: int) -> None:
        """Take a client."""
        try:
            channel, _ = self._channel.accept()
        except OSError:  # gone before it was taken, or no file descriptors left
            return
        if len(self.connections) >= self._most:
            channel.close()
            return
        channel.setblocking(False)
        if channel.family != socket.AF_UNIX:
            channel.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connections.add(self._server.connect(channel, self._make, self))


class Terminal:
    """The host's side of a pseudo-terminal, with the methods of a socket."""

    def __init__(self, fd: int) -> None:
        self._fd = fd

    def fileno(self) -> int:
        """Return the file descriptor."""
        return self._fd

    def recv(self, count: int) -> bytes:
        """Return bytes that a client has written."""
        return os.read(self._fd, count)

    def send(self, data: bytes) -> int:
        """Write bytes; return how many there was room for."""
        return os.write(self._fd, data)

    def close(self) -> None:
        """Do nothing: the terminal outlives its clients."""


class Server:
    """The event loop.

    Attributes
    ----------
    sent, taken : int
        Bytes of all clients up to now.
    """

    def __init__(self) -> None:
        self.sent = self.taken = 0
        self._stopped = False
        self.held: set[Connection] = set()
        self._poll = select.poll()
        self._events: dict[int, int] = {}
        self._polls: NDArray[np.void] | None = None
        self._ready: dict[int, Callable[[int], None]] = {}
        self._connections: set[Connection] = set()

    def run(
        self,
        stop: Callable[[], bool] = lambda: False,
        tick: Callable[[], None] | None = None,
        period: float = PATIENCE,
    ) -> None:
        """Serve until told to stop.

        Parameters
        ----------
        stop : callable
            Asked after every event, and every ``period``.
        tick : callable, optional
            Called as often.
        period : float
            How long to wait for events [s].
        """
        poll, ready = self._poll, self._ready
        while not self._stopped and not stop():
            wait = period
            if self.held:
                now = time.monotonic()
                for connection in list(self.held):
                    connection.release(now)
                wait = min([period, *(max(0.0, c.held_until - now) for c in self.held)])
            for fd, events in poll.poll(wait * 1e3):
                if fd in ready:  # not closed by what another one asked for
                    ready[fd](events)
            if tick is not None:
                tick()

    def connect(
        self,
        channel: socket.socket | Terminal,
        make: Callable[[Connection], Session],
        listener: Listener | None = None,
    ) -> Connection:
        """Serve a client."""
        connection = Connection(self, channel, listener)
        connection.session = make(connection)
        self._ready[connection.fd] = connection.ready
        self.watch(connection.fd, select.POLLIN)
        self._connections.add(connection)
        return connection

    def stop(self) -> None:
        """End `run`."""
        self._stopped = True

    def cut(self) -> None:
        """Close the connections of all clients at sockets, but not control channels."""
        for connection in list(self._connections):
            if connection.can_end and not isinstance(connection.session, LineSession):
                connection.close()

    @property
    def polls(self) -> NDArray[np.void]:
        """All file descriptors, and what is looked for: (n,) `POLL`."""
        if self._polls is None:
            self._polls = np.array([(fd, e, 0) for fd, e in self._events.items()], POLL)
        return self._polls

    def watch(self, fd: int, events: int) -> None:
        """Look for these events at a file descriptor from now on."""
        self._poll.register(fd, events)
        self._events[fd], self._polls = events, None

    def _unwatch(self, fd: int) -> None:
        self._poll.unregister(fd)
        del self._ready[fd], self._events[fd]
        self._polls = None

    def forget(self, connection: Connection) -> None:
        """Serve a client no longer."""
        self._unwatch(connection.fd)
        self._connections.discard(connection)

    @contextmanager
    def listen(
        self,
        url: str,
        make: Callable[[Connection], Session],
        *,
        most: int = CONNECTIONS,
        remote: bool = False,
    ) -> Iterator[str]:
        """Listen while the context lasts.

        Parameters
        ----------
        url : str
            ``unix:PATH``, a socket that every user may connect to; ``tcp:HOST:PORT``, port 0 for a
            free one; ``pty:PATH``, a pseudo-terminal with a link to it.
        make : callable
            Makes the `Session` of a `Connection`.
        most : int
            Clients at the same time; at a terminal there is one.
        remote : bool
            Allow addresses that other computers can reach.

        Yields
        ------
        str
            The address, with the real port.

        Raises
        ------
        UsageError
            If that cannot be.
        """
        if url.startswith(PTY) and url != PTY:
            with _terminal(Path(url.removeprefix(PTY))) as host:
                connection = self.connect(Terminal(host), make)
                try:
                    yield url
                finally:
                    connection.close()
            return
        if url.startswith(UNIX) and url != UNIX:
            opened = _unix_socket(Path(url.removeprefix(UNIX)))
        elif url.startswith(TCP):
            opened = _tcp_socket(url, remote)
        else:
            raise UsageError(
                f"serve: '{url}' is no place to listen at; there are unix:PATH, tcp:HOST:PORT and "
                "pty:PATH"
            )
        with opened as channel:
            channel.setblocking(False)
            channel.listen()
            listener = Listener(self, channel, make, most)
            self._ready[channel.fileno()] = listener.ready
            self.watch(channel.fileno(), select.POLLIN)
            try:
                if channel.family == socket.AF_UNIX:
                    yield url
                else:
                    yield f"{url.rpartition(':')[0]}:{channel.getsockname()[1]}"
            finally:
                for connection in list(listener.connections):
                    connection.close()
                self._unwatch(channel.fileno())


@contextmanager
def _unix_socket(path: Path) -> Iterator[socket.socket]:
    """Make a socket at a path; one that is left of a server that was killed makes room."""
    with socket.socket(socket.AF_UNIX) as channel:
        if _abandoned(path):
            path.unlink()
        try:
            channel.bind(str(path))
        except OSError as error:
            raise UsageError(
                f"serve: no socket can be made at {path} ({error.strerror or error}); give another "
                "path, or remove what is there"
            ) from error
        try:
            path.chmod(0o666)  # drivers change their user; the folder limits access
            yield channel
        finally:
            path.unlink(missing_ok=True)


def _abandoned(path: Path) -> bool:
    """Tell whether there is a socket at which nobody listens."""
    try:
        if not stat.S_ISSOCK(path.lstat().st_mode):
            return False
    except OSError:
        return False
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            return True
        except OSError:
            pass
    return False


@contextmanager
def _tcp_socket(url: str, remote: bool) -> Iterator[socket.socket]:
    """Make a socket at ``tcp:HOST:PORT``."""
    place = host_and_port(url.removeprefix(TCP))
    if place is None:
        raise UsageError(f"serve: '{url}' should be tcp:HOST:PORT, with a port of 0..65535")
    host, port = place
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise UsageError(f"serve: no computer '{host}' is known ({error})") from error
    if not remote and not ipaddress.ip_address(address[0]).is_loopback:
        raise UsageError(
            f"serve: other computers could reach {host}; listen at 127.0.0.1, or say --remote if "
            "they are to"
        )
    with socket.socket(family, kind) as channel:
        channel.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            channel.bind(address)
        except OSError as error:
            raise UsageError(f"serve: {url} is not free ({error.strerror})") from error
        yield channel


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
            with suppress(OSError):
                link.unlink(missing_ok=True)
    finally:
        os.close(host)
        os.close(terminal)


class LineSession:
    """Lines of text in, a line of text out for each; for control channels.

    Parameters
    ----------
    connection : Connection
    answer : callable
        Gets a line without its end, returns the reply or None.
    longest : int
        Bytes of a line; a client with a longer one is closed.
    """

    def __init__(
        self,
        connection: Connection,
        answer: Callable[[bytes], bytes | None],
        longest: int = 1 << 16,
    ) -> None:
        self._connection, self._answer, self._longest = connection, answer, longest
        self._rest = b""

    def received(self, data: memoryview) -> None:
        """Answer the lines that are complete; see `Session.received`."""
        *lines, self._rest = (self._rest + bytes(data)).split(b"\n")
        if len(self._rest) > self._longest:
            raise ProtocolError
        for line in lines:
            if line.strip() and (reply := self._answer(line)) is not None:
                self._connection.send(reply + b"\n")

    def closed(self) -> None:
        """Do nothing."""
