"""SPI over a socket: the wire format, and what a server does with the bytes of a client.

Request: u32 length, u32 flags, both little endian, then ``length`` bytes to send. Reply: as many
bytes received. One request is one frame; `KEEP_SELECTED` leaves CS low behind it. Flags 15:0 carry
the client's SPI mode word and mean nothing here: the board knows mode 0 with CS active low,
whatever a client asks for.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Final, Protocol

from pulsewright.transport.server import Connection, ProtocolError

HEADER: Final = struct.Struct("<II")
KEEP_SELECTED: Final = 1 << 31
LONGEST: Final = 4096  # bytes of a request, as with spidev; a longer one is a protocol error


class Port(Protocol):
    """What carries out frames."""

    def transfer(self, data: bytes, keep_selected: bool) -> bytes:
        """Send bytes, at least one, and return as many."""

    def delay(self) -> float:
        """Return how much later than usual the reply comes that was just made [s]."""


class SpiSession:
    """Frames of one client."""

    def __init__(self, connection: Connection, port: Port) -> None:
        self._connection, self._port = connection, port
        self._rest = b""

    def received(self, data: memoryview) -> None:
        """Carry out the frames that are complete; see `transport.server.Session`."""
        block = self._rest + data
        while len(block) >= HEADER.size:
            length, flags = HEADER.unpack_from(block)
            if length > LONGEST:
                raise ProtocolError
            if len(block) < (end := HEADER.size + length):
                break
            if length:
                reply = self._port.transfer(block[HEADER.size : end], bool(flags & KEEP_SELECTED))
                if delay := self._port.delay():
                    self._connection.hold(delay)
                self._connection.send(reply)
            block = block[end:]
        self._rest = block

    def closed(self) -> None:
        """Do nothing: the board does not know of clients."""


def listener(port: Port) -> Callable[[Connection], SpiSession]:
    """Return what makes a session for each client of a port."""
    return lambda connection: SpiSession(connection, port)
