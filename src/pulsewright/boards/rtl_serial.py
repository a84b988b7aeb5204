"""The gateware of a board at serial ports in simulation, in the place of its twin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from amaranth.lib.wiring import Component
from numpy.typing import NDArray

from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError
from pulsewright.gateware.rtl import RtlSimulation, pin_changes

_BITS: Final = 10  # of a byte on the line
_STOP: Final = 9.5  # bits from the start of a byte to the middle of its stop bit


@dataclass(frozen=True)
class SerialPins:
    """One serial port of a board, 8N1.

    Parameters
    ----------
    rx, tx : str
        Ports of the gateware: its serial input and output, idle high.
    baud : int
        Bit rate [baud].
    """

    rx: str
    tx: str
    baud: int


@dataclass
class _Line:
    """A serial output as it has been seen, and the bytes on it."""

    level: int = 1
    levels: list[tuple[int, int]] = field(default_factory=list)  # cycle, level of the open byte
    start: int | None = None  # of the open byte
    data: bytearray = field(default_factory=bytearray)  # complete and not read yet


class RtlSerialBoard:
    """One board behind serial ports, simulated clock by clock; a `SerialTwin`.

    Parameters
    ----------
    component : Component
        The board.
    clock_hz : int
        Its clock [Hz].
    ports : sequence of SerialPins
        Numbered from 1 on.
    idle : mapping of str to int
        Inputs other than the ports that are not 0.
    pins : mapping of str to (str, int)
        Pins to record: output port and bit of each.
    listens : int
        Cycle from which on the board takes bytes.
    """

    def __init__(
        self,
        component: Component,
        *,
        clock_hz: int,
        ports: Sequence[SerialPins],
        idle: Mapping[str, int],
        pins: Mapping[str, tuple[str, int]],
        listens: int,
    ) -> None:
        self.clock_hz = clock_hz
        self._ports, self._listens = tuple(ports), listens
        self._places = tuple(pins.values())
        self._names = tuple(pins)
        self._begin = np.array(
            [getattr(component, port).init >> bit & 1 for port, bit in self._places], np.uint8
        )
        self._simulation = RtlSimulation(component)
        self._idle = dict(idle) | {port.rx: 1 for port in ports}
        self.restart()

    @property
    def now(self) -> int:
        """Present cycle: its edge is done."""
        return self._simulation.cycle - 1

    def restart(self) -> None:
        """Start again: edge 0 is done, and all registers have their reset values."""
        self._simulation.reset()
        self._levels = np.zeros(1, self._simulation.inputs)
        for port, level in self._idle.items():
            self._levels[port] = level
        self._changes: list[tuple[int, str, int]] = [(0, self._ports[0].rx, 1)]
        self._free = [self._listens] * len(self._ports)
        self._lines = [_Line() for _ in self._ports]
        self._rows: list[NDArray[np.void]] = []
        self._start, self._last = 0, self._begin
        self.advance(0)

    def reset(self) -> None:
        """Bring all registers to their reset values, and let time pass until the board listens."""
        start = self.now + 1
        self._changes += [(start, "rst", 1), (start + 1, "rst", 0)]
        self.advance(start + 1 + self._listens)

    def advance(self, cycle: int) -> None:
        """Let time pass through edge ``cycle``.

        Raises
        ------
        UsageError
            If it is over.
        """
        if cycle < self.now:
            raise UsageError(f"rtl: advance to cycle {cycle}, but it is already {self.now}")
        due = sorted((change for change in self._changes if change[0] <= cycle), key=lambda c: c[0])
        self._changes = [change for change in self._changes if change[0] > cycle]
        rows = np.zeros(len(due), self._simulation.inputs)
        for n, (at, name, level) in enumerate(due):
            self._levels[name] = level
            self._levels["cycle"] = at
            rows[n] = self._levels[0]
        seen = self._simulation.run(cycle + 1, rows)
        if len(seen):
            self._rows.append(seen)
        for port, line in zip(self._ports, self._lines, strict=True):
            if len(seen):
                changed = np.diff(seen[port.tx].astype(np.int8), prepend=np.int8(line.level)) != 0
                for at, level in seen[["cycle", port.tx]][changed].tolist():
                    self._edge(port, line, at, level)
            self._complete(port, line, cycle)

    def send(self, port: int, data: bytes) -> int:
        """Put bytes on a serial input; see `SerialTwin.send`."""
        pins = self._port(port)
        start = max(self._free[port - 1], self.now + 1)
        level = 1
        for n, byte in enumerate(data):
            bits = [0, *(byte >> k & 1 for k in range(8)), 1]
            for k, bit in enumerate(bits, _BITS * n):
                if bit != level:
                    self._changes.append((start + k * self.clock_hz // pins.baud, pins.rx, bit))
                level = bit
        self._free[port - 1] = start - (-_BITS * len(data) * self.clock_hz // pins.baud)
        return self._free[port - 1]

    def receive(self, port: int, until: int | None = None, count: int = 1) -> bytes:
        """Return bytes from a serial output; see `SerialTwin.receive`."""
        pins, line = self._port(port), self._lines[port - 1]
        while until is not None and self.now < until and len(line.data) < count:
            # No byte can be complete before these cycles, which are not too far then.
            start = self.now + 1 if line.start is None else line.start
            self.advance(min(self._end(pins, start), until))
        data, line.data = bytes(line.data), bytearray()
        return data

    def drain(self) -> EdgeTrace:
        """Return all level changes of the pins since the last call."""
        # The present edge is part of the next trace, as on twins.
        start, end = self._start, self.now
        rows = np.concatenate(self._rows)
        self._rows = [rows[rows["cycle"] >= end]]
        rows = rows[rows["cycle"] < end]
        first = self._last
        cycles, self._last = pin_changes(rows, self._places, first)
        self._start = end
        return EdgeTrace(self.clock_hz, self._names, first, cycles, start, end)

    def _port(self, port: int) -> SerialPins:
        if not 1 <= port <= len(self._ports):
            raise UsageError(f"rtl: serial port {port}; there are 1..{len(self._ports)}")
        return self._ports[port - 1]

    def _end(self, pins: SerialPins, start: int) -> int:
        """Return the cycle in which a byte is complete: the middle of its stop bit."""
        return start - int(-_STOP * self.clock_hz // pins.baud)

    def _edge(self, port: SerialPins, line: _Line, cycle: int, level: int) -> None:
        self._complete(port, line, cycle - 1)
        line.level = level
        if line.start is None and not level:
            line.start, line.levels = cycle, []
        elif line.start is not None:
            line.levels.append((cycle, level))

    def _complete(self, port: SerialPins, line: _Line, cycle: int) -> None:
        """Take the open byte if its stop bit has been sampled by ``cycle``."""
        if line.start is None or cycle < self._end(port, line.start):
            return
        bits = [0] * _BITS
        for at, level in line.levels:
            first = round((at - line.start) * port.baud / self.clock_hz)
            bits[first:] = [level] * (_BITS - first)
        if bits[-1]:
            line.data.append(sum(bit << k for k, bit in enumerate(bits[1:9])))
        line.start = None
