"""Boards behind a socket, as `pulsewright serve` offers them: the client's side."""

from __future__ import annotations

import socket
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.errors import BusError, UsageError
from pulsewright.transport.address import host_and_port
from pulsewright.transport.bus import (
    ADDRESS_READ,
    ADDRESS_WRITE,
    ASAP,
    DATA_READ,
    EppBus,
)
from pulsewright.transport.epp_wire import NINIT, REQUEST, TIMEOUT
from pulsewright.transport.host_clock import HostClock
from pulsewright.transport.spi_bus import SpiBus, check_frame, check_time
from pulsewright.transport.spi_socket import HEADER, LONGEST

PATIENCE: Final = 5.0  # a server that says nothing for so long is gone [s]
ACCESS_NS: Final = 1500  # time that an EPP access takes, as servers count it [ns]
PORTION: Final = 256  # accesses that are sent before replies are taken
_READS: Final = (DATA_READ, ADDRESS_READ)


class _Channel:
    """A stream socket, connected.

    Parameters
    ----------
    address : str
        ``unix:PATH`` or ``tcp:HOST:PORT``.

    Raises
    ------
    UsageError
        If that is no address, or nobody listens there.
    """

    def __init__(self, address: str) -> None:
        kind, _, place = address.partition(":")
        network = host_and_port(place) if kind == "tcp" else None
        if kind == "tcp" and network is None:
            raise UsageError(f"link '{address}': expected tcp:HOST:PORT, with a port of 0..65535")
        self._address = address
        try:
            if network is not None:
                self._socket = socket.create_connection(network, PATIENCE)
                self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            else:
                self._socket = socket.socket(socket.AF_UNIX)
                self._socket.settimeout(PATIENCE)
                self._socket.connect(place)
        except OSError as error:
            raise UsageError(
                f"nobody serves at {address} ({error.strerror or error}); start 'pulsewright serve "
                f"BOARD --listen ...' first, and give the same address"
            ) from error

    def send(self, data: bytes) -> None:
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise self._lost(error) from error

    def receive(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            try:
                block = self._socket.recv(count - len(data))
            except OSError as error:
                raise self._lost(error) from error
            if not block:
                raise self._lost("the server has closed the connection")
            data += block
        return data

    def close(self) -> None:
        self._socket.close()

    def _lost(self, error: OSError | str) -> BusError:
        if isinstance(error, TimeoutError):
            error = f"no reply for {PATIENCE:g} s"
        return BusError(f"server at {self._address}: {error}; the link is lost")


class SocketEppBus(EppBus):
    """EPP boards behind a socket.

    An access happens when its cycle has come by the host's clock, at that time to the nanosecond if
    the server takes its clients' time (``--time wall``). Writes are posted: what was not
    acknowledged since the last reply shows in all accesses since then, or if there is no read
    behind them, in those up to the next read.

    Parameters
    ----------
    address : str
        ``unix:PATH`` or ``tcp:HOST:PORT``.
    clock_hz : int
        Unit of `now` and of the cycles of accesses [Hz].

    Raises
    ------
    UsageError
        If that is no address, or nobody listens there.
    """

    in_real_time = True

    def __init__(self, address: str, clock_hz: int) -> None:
        self.clock_hz = clock_hz
        self.access_cycles = -(-ACCESS_NS * clock_hz // 1_000_000_000)
        self._channel = _Channel(address)
        self._clock = HostClock(clock_hz)
        self._free = 0  # cycle of the next access

    def transact(self, accesses: NDArray[np.void]) -> None:
        """Carry out accesses, each not before its cycle by the host's clock; see `EppBus`."""
        for first in range(0, len(accesses), PORTION):
            self._portion(accesses[first : first + PORTION])

    def _portion(self, accesses: NDArray[np.void]) -> None:
        cycles = np.maximum(accesses["cycle"], max(self._free, self._clock.now()))
        steps = self.access_cycles * np.arange(len(cycles))
        accesses["cycle"] = np.maximum.accumulate(cycles - steps) + steps
        accesses["timeout"] = 0
        requests = np.zeros(len(accesses), REQUEST)
        requests["op"] = accesses["op"]
        reads = np.isin(accesses["op"], _READS)
        requests["arg"] = np.where(reads, 1, accesses["value"])
        requests["t"] = [self._clock.nanoseconds(cycle) for cycle in accesses["cycle"].tolist()]
        gaps = np.flatnonzero(np.diff(accesses["cycle"]) > self.access_cycles) + 1
        for first, behind in pairwise([0, *gaps.tolist(), len(accesses)]):
            self._clock.wait(int(accesses["cycle"][behind - 1]))
            self._channel.send(requests[first:behind].tobytes())
        self._free = int(accesses["cycle"][-1]) + self.access_cycles
        begin = 0
        for at in np.flatnonzero(reads).tolist():
            flags, accesses["value"][at] = self._channel.receive(2)
            if flags & TIMEOUT:
                since = accesses[begin : at + 1]
                since["timeout"] = since["op"] != ADDRESS_WRITE
            begin = at + 1

    def reset(self) -> None:
        """Pulse nINIT."""
        requests = np.zeros(2, REQUEST)
        requests["op"], requests["arg"] = NINIT, (0, 1)
        requests["t"] = self._clock.nanoseconds(max(self._free, self._clock.now()))
        self._channel.send(requests.tobytes())

    def now(self) -> int:
        """Return the time since the link was opened, by the clock of the host."""
        return max(self._free, self._clock.now())

    def close(self) -> None:
        """Leave the server; a second call does nothing."""
        self._channel.close()


class SocketSpiBus(SpiBus):
    """A board with SPI behind a socket.

    Parameters
    ----------
    address : str
        ``unix:PATH`` or ``tcp:HOST:PORT``.
    clock_hz : int
        Unit of `now` [Hz].

    Raises
    ------
    UsageError
        If that is no address, or nobody listens there.
    """

    in_real_time = True

    def __init__(self, address: str, clock_hz: int) -> None:
        self.clock_hz = clock_hz
        self._channel = _Channel(address)
        self._clock = HostClock(clock_hz)

    def transfer(self, data: bytes, cycle: int = ASAP) -> bytes:
        """Send bytes in one frame, not before ``cycle`` by the host's clock; see `SpiBus`."""
        check_frame(data)
        if len(data) > LONGEST:
            raise UsageError(f"spi link: a frame of {len(data)} bytes; servers take {LONGEST}")
        self._clock.wait(cycle)
        self._channel.send(HEADER.pack(len(data), 0) + data)
        return self._channel.receive(len(data))

    def now(self) -> int:
        """Return the time since the link was opened, by the clock of the host."""
        return self._clock.now()

    def sleep(self, seconds: float) -> None:
        """Let time pass [s]."""
        check_time(seconds)
        self._clock.wait(self._clock.now() + int(seconds * self.clock_hz) + 1)

    def reset(self) -> None:
        """Refuse: the link has no reset pin."""
        raise UsageError(
            "spi link: a served board is reset at its control channel, not over this link"
        )

    def close(self) -> None:
        """Leave the server; a second call does nothing."""
        self._channel.close()
