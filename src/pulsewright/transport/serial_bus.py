"""Serial ports: what a driver may ask of any link with bytes in a row, and a link to a twin.

Bytes have no times of their own: what a driver knows is when it has written and when it has read.
All waiting is in `SerialBus.read` and `SerialBus.sleep`. On a link to a twin just these let board
time pass, so that time-outs are exact and cost nothing, and a program runs the same way each time.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from contextlib import suppress
from typing import Protocol

from pulsewright.errors import BusError, UsageError


class SerialBus(Protocol):
    """One serial port (8N1) with a board behind it."""

    clock_hz: int  # unit of `now` [Hz]

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Send bytes, behind those that are still to be sent.

        May return before they are sent.

        Raises
        ------
        BusError
            If the link is lost.
        """

    @abstractmethod
    def read(self, max_bytes: int, timeout_s: float, *, min_bytes: int = 1) -> bytes:
        """Return bytes that the board has sent, waiting for them if need be.

        Parameters
        ----------
        max_bytes : int
            Return no more than these, at least ``min_bytes``; further ones stay for the next call.
        timeout_s : float
            Time to wait, 0 or more [s].
        min_bytes : int
            Return as soon as so many bytes are there, at least 1. A reader that knows the length of
            what it waits for saves calls.

        Returns
        -------
        bytes
            Fewer than ``min_bytes`` only after ``timeout_s``; then what is there, maybe nothing.

        Raises
        ------
        UsageError
            If the numbers of bytes or the time are not as above.
        BusError
            If the link, or bytes that nobody has read in time, are lost.
        """

    @abstractmethod
    def sleep(self, seconds: float) -> None:
        """Let time pass, 0 or more [s]; bytes of both directions go on."""

    @abstractmethod
    def now(self) -> int:
        """Return the present time [board cycle].

        A link to a twin knows the board's own cycle; any other one counts from its opening on, with
        the clock of the host.
        """

    @abstractmethod
    def reset_input(self) -> None:
        """Forget the bytes that the board has sent up to now and that were not read."""

    @abstractmethod
    def close(self) -> None:
        """Release the link; a second call does nothing."""


def check_read(max_bytes: int, timeout_s: float, min_bytes: int) -> None:
    """Check the arguments of `SerialBus.read`.

    Raises
    ------
    UsageError
        If one is not allowed.
    """
    if not 1 <= min_bytes <= max_bytes:
        raise UsageError(
            f"serial link: read at least {min_bytes} and at most {max_bytes} bytes; allowed are 1 "
            "or more, and no less at most than at least"
        )
    check_time(timeout_s)


def check_time(seconds: float) -> None:
    """Check a time to wait.

    Raises
    ------
    UsageError
        If it is negative or no number.
    """
    if not 0 <= seconds < math.inf:
        raise UsageError(f"serial link: wait {seconds} s; allowed are 0 or more")


class SerialTwin(Protocol):
    """What a twin, or a simulation of gateware, offers to a link; ports are numbered from 1."""

    @property
    def clock_hz(self) -> int:
        """Board clock [Hz]."""

    @property
    def now(self) -> int:
        """Present cycle: its edge is done."""

    def advance(self, cycle: int) -> None:
        """Let time pass through edge ``cycle``, which is not before ``now``."""

    def send(self, port: int, data: bytes) -> int:
        """Put bytes on a serial input, back to back at the baud rate of the port.

        The first one starts after ``now``, after the bytes that were sent before, and not before
        the board listens. Time does not pass. Return the first cycle in which another byte can
        start.
        """

    def receive(self, port: int, until: int | None = None, count: int = 1) -> bytes:
        """Let time pass until ``count`` bytes are there, and return all bytes that are.

        A byte is there as soon as its stop bit is sampled, in its middle. Time passes through cycle
        ``until`` at most, and not at all if it is None or over.

        Raises
        ------
        BusError
            If bytes are lost, because too many were left unread. The next call goes on behind them.
        """


class VirtualSerialBus(SerialBus):
    """A link to a twin in this process; time is that of the board.

    `write` takes no time: bytes wait for the wire. `read` and `sleep` let time pass, `read` just up
    to the cycle in which the bytes are there, or exactly ``timeout_s``.

    Parameters
    ----------
    twin : SerialTwin
        Kept as ``twin``, so that a program can reach its pins and its recording.
    port : int
        Port of the board, from 1 on.

    Examples
    --------
    >>> from pulsewright.boards.s3g.twin import S3GTwin
    >>> bus = VirtualSerialBus(S3GTwin())
    >>> bus.write(bytes.fromhex("d503010000ab"))  # version, tag 1
    >>> bus.read(8, timeout_s=0.01, min_bytes=8).hex()
    'd505010081bace34'
    """

    def __init__(self, twin: SerialTwin, port: int = 1) -> None:
        self.twin, self.port = twin, port
        self.clock_hz = twin.clock_hz
        self._unread = b""

    def write(self, data: bytes) -> None:
        """Send bytes, behind those that are still to be sent; see `SerialBus.write`."""
        self.twin.send(self.port, data)

    def read(self, max_bytes: int, timeout_s: float, *, min_bytes: int = 1) -> bytes:
        """Return bytes that the board has sent; see `SerialBus.read`."""
        check_read(max_bytes, timeout_s, min_bytes)
        missing = min_bytes - len(self._unread)
        if missing > 0:
            self._unread += self.twin.receive(self.port, self._after(timeout_s), missing)
        data, self._unread = self._unread[:max_bytes], self._unread[max_bytes:]
        return data

    def sleep(self, seconds: float) -> None:
        """Let board time pass [s]."""
        check_time(seconds)
        self.twin.advance(self._after(seconds))

    def now(self) -> int:
        """Return the present cycle of the board."""
        return self.twin.now

    def reset_input(self) -> None:
        """Forget the bytes that the board has sent up to now and that were not read."""
        self._unread = b""
        with suppress(BusError):  # lost ones shall be forgotten, too
            self.twin.receive(self.port)
        self.twin.receive(self.port)

    def close(self) -> None:
        """Do nothing: the twin stays, with its recording."""

    def _after(self, seconds: float) -> int:
        return self.twin.now + math.ceil(seconds * self.clock_hz)
