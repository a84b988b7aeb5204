"""EPP over a socket: the wire format, and what a server does with the bytes of a client.

A request is 10 bytes, a reply is flags and data. Requests are those accesses of `transport.bus`
that have the same letter, and two more: nINIT and one byte of configuration. What they mean is in
``docs/clients.md``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

import numpy as np

from pulsewright.transport.server import Connection, ProtocolError

NINIT: Final = ord("I")
CONFIGURE: Final = ord("P")
TIMEOUT: Final = 0x01  # flag: a cycle since the last reply was not acknowledged

# One request. ``arg``: byte to write, number of reads 1..255, or level. ``t``: client's monotonic
# time [ns].
REQUEST: Final = np.dtype([("op", "u1"), ("arg", "u1"), ("t", "<u8")])
REQUEST_BYTES: Final = REQUEST.itemsize


class Port(Protocol):
    """What carries out requests."""

    def exchange(self, data: bytes) -> tuple[bytes, bool]:
        """Carry out whole requests; return replies, and False if there was a wrong one."""

    def delay(self) -> float:
        """Return how much later than usual the replies come that were just made [s]."""


class EppSession:
    """Requests of one client."""

    def __init__(self, connection: Connection, port: Port) -> None:
        self._connection, self._port = connection, port
        self._rest = b""

    def received(self, data: memoryview) -> None:
        """Carry out the requests that are complete; see `transport.server.Session`."""
        block = self._rest + data
        whole = len(block) - len(block) % REQUEST_BYTES
        self._rest = block[whole:]
        replies, good = self._port.exchange(block[:whole])
        if replies:
            if delay := self._port.delay():
                self._connection.hold(delay)
            self._connection.send(replies)
        if not good:
            raise ProtocolError

    def closed(self) -> None:
        """Do nothing: the boards do not know of clients."""


def listener(port: Port) -> Callable[[Connection], EppSession]:
    """Return what makes a session for each client of a port."""
    return lambda connection: EppSession(connection, port)
