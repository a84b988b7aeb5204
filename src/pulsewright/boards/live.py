"""Twins whose clock follows the computer's, for boards that do more than answer.

What the computer is late with, the twin catches up, in pieces whose edges fit into little memory.
But a board that makes more edges than the computer can follow would be later each time: then time
stands still for it meanwhile, and clients are served.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from pulsewright.edges.trace import EdgeTrace
from pulsewright.transport.faults import FLOATING, Faults
from pulsewright.transport.server import Connection

PIECE_S: Final = 0.002  # [s]
EFFORT_S: Final = 0.01  # computing time for catching up at once [s]
EFFORT_SHARE: Final = 9  # and in the long run, per time for anything else
LINE_AHEAD_S: Final = 0.2  # of bytes that wait for a serial line [s]


class LivePort:
    """A board in real time, from `start` on.

    Parameters
    ----------
    twin : SerialTwin or SpiTwin
        In its reset state; with ``drain`` and ``state``.
    edges : callable, optional
        Gets the changes of all pins in pieces, each valid during the call only.
    clock : callable
        Monotonic time [s].
    effort : callable
        Computing time of this thread [s].

    Attributes
    ----------
    faults : Faults
        Of the link.
    link_pins : tuple of str
        Inputs of the board that the link drives.
    lost : float
        Time that stood still for the board, as this computer was too slow for it [s].
    """

    link_pins: tuple[str, ...] = ()
    fault_kinds: Final = ("mute", "lose", "double", "flip", "delay", "power", "cut", "none")

    def __init__(
        self,
        twin: Any,
        edges: Callable[[EdgeTrace], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
        effort: Callable[[], float] = time.thread_time,
    ) -> None:
        self.twin, self._edges, self._clock, self._effort = twin, edges, clock, effort
        self.faults, self._powered = Faults(), True
        self.lost = 0.0
        self.start()

    def start(self) -> None:
        """Let time begin."""
        self._start = self._caught_up = self._clock()
        self._credit = EFFORT_S

    @property
    def cycle(self) -> int:
        """What the clock says the twin's cycle should be."""
        return int((self._clock() - self._start) * self.twin.clock_hz)

    def catch_up(self) -> None:
        """Bring the twin to the present, or let time stand still for it.

        However busy the board is, a tenth of the time is left for serving its clients.
        """
        twin, cycle, begin = self.twin, self.cycle, self._effort()
        between = self._clock() - self._caught_up
        self._credit = min(EFFORT_S, self._credit + EFFORT_SHARE * between)
        piece = round(PIECE_S * twin.clock_hz)
        if twin.now >= cycle:
            self._look()  # at what transfers did, which may be ahead
        while twin.now < cycle:
            twin.advance(min(cycle, twin.now + piece))
            self._look()
            if self._effort() - begin > self._credit:  # and what this took does not count either
                late = max(self.cycle - twin.now, 0) / twin.clock_hz
                self._start += late
                self.lost += late
                break
        self._credit -= self._effort() - begin
        self._caught_up = self._clock()

    def reset(self) -> None:
        """Pulse the reset pin of the board."""
        self.twin.reset()
        self._look()

    def power(self, on: bool) -> None:
        """Switch the board off, which then forgets everything, or on."""
        if self._powered != on:
            self.reset()
            self.faults.inject("power", on=on)
            self._powered = on

    def delay(self) -> float:
        """Return how much later than usual the reply comes that was just made [s]."""
        return self.faults.delay()

    def _look(self) -> None:
        chunk = self.twin.drain(copy=False)
        if self._edges is not None:
            self._edges(chunk)


class SerialPort(LivePort):
    """The first serial port of a board, with any number of programs at its other end.

    All of them hear what the board sends. Bytes take the time that they take on the wire; a client
    that sends faster has to wait.
    """

    link_pins = ("avr_tx", "ext_tx")

    def __init__(
        self,
        twin: Any,
        edges: Callable[[EdgeTrace], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(twin, edges, clock)
        self._sessions: list[SerialSession] = []
        self._free = 0  # cycle from which on the line is

    def session(self, connection: Connection) -> SerialSession:
        """Return a session for a client."""
        self._sessions.append(SerialSession(connection, self))
        return self._sessions[-1]

    def forget(self, session: SerialSession) -> None:
        """Serve a client no longer."""
        self._sessions.remove(session)

    def send(self, data: bytes) -> None:
        """Put bytes on the wire."""
        data, _ = self.faults.spoil(data, "write")
        if data:
            self._free = self.twin.send(1, data)
        self._pause()

    def tick(self) -> None:
        """Bring the twin to the present, and the clients what it sent."""
        self.catch_up()
        reply, _ = self.faults.spoil(self.twin.receive(1), "read")
        if reply:
            late = self.delay()
            for session in list(self._sessions):
                if late:
                    session.connection.hold(late)
                session.connection.send(reply)
        self._pause()

    def _pause(self) -> None:
        full = self._free - self.twin.now > LINE_AHEAD_S * self.twin.clock_hz
        for session in self._sessions:
            session.connection.pause(full)


class SerialSession:
    """Bytes of one client."""

    def __init__(self, connection: Connection, port: SerialPort) -> None:
        self.connection, self._port = connection, port

    def received(self, data: memoryview) -> None:
        """Put bytes on the wire; see `transport.server.Session`."""
        self._port.send(bytes(data))

    def closed(self) -> None:
        """Leave the port."""
        self._port.forget(self)


class SpiPort(LivePort):
    """The SPI port of a board.

    Parameters
    ----------
    half : int
        Half a period of SCK [cycle].
    listens : int
        Cycles from the board's start until it can take a frame.
    """

    link_pins = ("cs", "sck", "copi", "rst_n")

    def __init__(
        self,
        twin: Any,
        half: int,
        listens: int,
        edges: Callable[[EdgeTrace], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(twin, edges, clock)
        self._half, self._free = half, listens
        self._selected = False  # CS was left low

    def reset(self) -> None:
        """Pulse the reset pin of the board, and let CS be high."""
        if self._selected:
            self.twin.schedule([self.twin.now + 1], "cs", 1)
            self._selected = False
        super().reset()
        self._free = self.twin.now + 1

    def transfer(self, data: bytes, keep_selected: bool = False) -> bytes:
        """Send a frame now and return what the board sent meanwhile.

        Parameters
        ----------
        data : bytes
            At least one.
        keep_selected : bool
            Leave CS low: the next frame goes on with this one.
        """
        self.catch_up()
        reply = self.faults.frame(data, lambda sent: self._carry_out(sent, keep_selected))
        return bytes([FLOATING]) * len(data) if reply is None else reply

    def _carry_out(self, data: bytes, keep_selected: bool) -> bytes:
        begin = max(self._free, self.twin.now + 1)
        if not keep_selected and not self._selected:
            reply, self._free = self.twin.transfer(begin, data, self._half)
            return bytes(reply)
        return self._piece(begin, data, keep_selected)

    def _piece(self, begin: int, data: bytes, keep_selected: bool) -> bytes:
        """Send a part of a frame, bit by bit; times as in `SpiTwin.transfer`."""
        twin, half = self.twin, self._half
        bits = np.unpackbits(np.frombuffer(data, np.uint8))
        setup = begin + half + 2 * half * np.arange(len(bits))
        rises = setup + half
        end = int(rises[-1]) + 2 * half
        if not self._selected:
            twin.schedule([begin], "cs", 0)
        if not keep_selected:
            twin.schedule([end], "cs", 1)
        twin.schedule(rises, "sck", 1)
        twin.schedule(rises + half, "sck", 0)
        twin.schedule(setup, "copi", bits)
        reply = []
        for rise in rises.tolist():
            twin.advance(rise - 2)
            reply.append(twin.level("cipo"))
        twin.advance(end)
        self._selected = keep_selected
        self._free = end + 2 * half
        return np.packbits(np.array(reply, np.uint8)).tobytes()
