"""EPP over a socket: what a server does with the bytes of a client; `epp_wire` has the format."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pulsewright.transport.server import Connection, ProtocolError


class Port(Protocol):
    """What carries out requests."""

    def converse(self, data: bytes, fd: int, polls: NDArray[np.void]) -> tuple[bytes, bytes, bool]:
        """Carry out requests, and go on with the client as long as no other one wants anything.

        Return replies still to be sent, bytes not carried out yet, and False for a wrong request.
        """

    def delay(self) -> float:
        """Return how much later than usual the replies come that were just made [s]."""


class EppSession:
    """Requests of one client."""

    def __init__(self, connection: Connection, port: Port) -> None:
        self._connection, self._port = connection, port
        self._rest = b""

    def received(self, data: memoryview) -> None:
        """Carry out the requests that are complete; see `transport.server.Session`."""
        replies, self._rest, good = self._port.converse(
            self._rest + data, self._connection.fd, self._connection.polls
        )
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
