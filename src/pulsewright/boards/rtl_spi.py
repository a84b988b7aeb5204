"""The gateware of a board on an SPI bus in simulation, in the place of its twin."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Protocol

import numpy as np
from amaranth.lib.wiring import Component
from numpy.typing import ArrayLike, NDArray

from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError
from pulsewright.gateware.rtl import RtlSimulation, pin_changes
from pulsewright.transport.spi_bus import CS_HIGH

IDLE: Final = {"cs": 1, "rst_n": 1, "halt": 1}  # inputs that are not 0 by themselves

Pins = Mapping[str, tuple[str, int]]  # name: port and bit


class SpiBoard(Protocol):
    """What a board says of its pins, besides its ports ``cs``, ``sck``, ``copi`` and ``cipo``."""

    @property
    def input_pins(self) -> Pins:
        """Inputs by name."""

    @property
    def output_pins(self) -> Pins:
        """Outputs to record, by name."""


class RtlSpiBoard:
    """One board on an SPI bus, simulated clock by clock; a `SpiTwin`.

    Parameters
    ----------
    component : Component
        The board, which is a `SpiBoard`.
    clock_hz : int
        Its clock [Hz].
    listens : int
        Cycles from a reset until the board takes a frame.
    """

    def __init__(self, component: Component, *, clock_hz: int, listens: int) -> None:
        self.clock_hz, self._listens = clock_hz, listens
        self._inputs: Pins = component.input_pins
        self._outputs: Pins = component.output_pins
        self._simulation = RtlSimulation(component)
        self.restart()

    @property
    def now(self) -> int:
        """Present cycle: its edge is done."""
        return self._simulation.cycle - 1

    def restart(self) -> None:
        """Start again: edge 0 is done, and all registers have their reset values."""
        self._simulation.reset()
        self._levels = {port: 0 for port, _ in self._inputs.values()}
        # Changes of inputs to come, in the order in which they were asked for: cycle, pin, level.
        self._changes: list[tuple[NDArray[np.int64], str, NDArray[np.uint8]]] = []
        self._rows: list[NDArray[np.void]] = []
        self._start = 0
        for pin in self._inputs:
            if IDLE.get(pin):
                self._add([0], pin, [1])
        self.advance(0)
        last = self._rows[0][0]
        self._before = np.array([last[p] >> b & 1 for p, b in self._outputs.values()], np.uint8)

    def reset(self) -> None:
        """Pulse ``rst_n``, and let time pass until the board listens again."""
        start = self.now + 1
        self.schedule([start, start + 1], "rst_n", [0, 1])
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
        self._rows.append(self._simulation.run(cycle + 1, self._stimulus(cycle)))
        if len(self._rows[-1]):
            self._present = self._rows[-1][-1:]

    def schedule(self, cycle: ArrayLike, pin: ArrayLike, level: ArrayLike) -> None:
        """Set input pins from a cycle on; arrays of the same length, or one of each.

        Raises
        ------
        UsageError
            If a cycle is over, or there is no such pin.
        """
        cycles, pins, levels = np.broadcast_arrays(
            np.atleast_1d(np.asarray(cycle, np.int64)),
            np.atleast_1d(np.asarray(pin, np.str_)),
            np.atleast_1d(np.asarray(level, np.uint8)),
        )
        if len(cycles) and cycles.min() <= self.now:
            raise UsageError(
                f"rtl: a level from cycle {cycles.min()} on, but it is already {self.now}"
            )
        for name in np.unique(pins):
            self._pin(str(name), self._inputs)
            mine = pins == name
            self._add(cycles[mine], str(name), levels[mine])

    def level(self, pin: str) -> int:
        """Return the level of an output pin now."""
        port, bit = self._pin(pin, self._outputs)
        return int(self._present[port][0]) >> bit & 1

    def transfer(self, cycle: int, data: bytes, half: int) -> tuple[bytes, int]:
        """Send one frame; see `SpiTwin.transfer`."""
        if cycle <= self.now:
            raise UsageError(f"rtl: a frame at cycle {cycle}, but it is already {self.now}")
        bits = np.unpackbits(np.frombuffer(data, np.uint8))
        start = cycle + half
        period = 2 * half * np.arange(len(bits) + 1)
        rises, falls = start + half + period[:-1], start + period[1:]
        end = int(falls[-1]) + half
        self._add([cycle, end], "cs", [0, 1])
        self._add(np.ravel([rises, falls], "F"), "sck", np.tile([1, 0], len(bits)))
        self._add(start + period, "copi", np.append(bits, 0))
        before = self._present
        self.advance(end)
        # The last cycle before an edge shows what the edge before that one made.
        rows = np.concatenate([before, self._rows[-1]])
        port, bit = self._outputs["cipo"]
        seen = rows[port][np.searchsorted(rows["cycle"], rises - 2, "right") - 1] >> bit & 1
        return np.packbits(seen.astype(np.uint8)).tobytes(), end + max(2 * half, CS_HIGH)

    def drain(self) -> EdgeTrace:
        """Return all level changes of the output pins since the last call."""
        # The present edge is part of the next trace, as on twins.
        start, end = self._start, self.now
        rows = np.concatenate(self._rows)
        self._rows = [rows[rows["cycle"] >= end]]
        rows = rows[rows["cycle"] < end]
        first = self._before
        cycles, self._before = pin_changes(rows, tuple(self._outputs.values()), first)
        self._start = end
        return EdgeTrace(self.clock_hz, tuple(self._outputs), first, cycles, start, end)

    def _pin(self, pin: str, among: Pins) -> tuple[str, int]:
        if pin not in among:
            raise UsageError(f"rtl: no pin '{pin}' there; there are {', '.join(among)}")
        return among[pin]

    def _add(self, cycle: ArrayLike, pin: str, level: ArrayLike) -> None:
        self._changes.append((np.asarray(cycle, np.int64), pin, np.asarray(level, np.uint8)))

    def _stimulus(self, end: int) -> NDArray[np.void]:
        """Take the changes up to edge ``end`` out of those to come, as rows of inputs."""
        changes, self._changes = self._changes, []
        due: dict[str, list[tuple[NDArray[np.int64], NDArray[np.uint8]]]] = {}
        for cycles, pin, levels in changes:
            now = cycles <= end
            if now.any():
                due.setdefault(pin, []).append((cycles[now], levels[now]))
            if not now.all():
                self._changes.append((cycles[~now], pin, levels[~now]))
        at = np.unique(np.concatenate([[], *(c for parts in due.values() for c, _ in parts)]))
        rows = np.zeros(len(at), self._simulation.inputs)
        rows["cycle"] = at
        for port, level in self._levels.items():
            rows[port] = level
        for pin, parts in due.items():
            port, bit = self._inputs[pin]
            cycles = np.concatenate([c for c, _ in parts])
            order = np.argsort(cycles, kind="stable")
            before = np.array([self._levels[port] >> bit & 1], np.uint8)
            levels = np.concatenate([before, np.concatenate([part for _, part in parts])[order]])
            value = levels[np.searchsorted(cycles[order], at, "right")].astype(rows[port].dtype)
            one = rows[port].dtype.type(1 << bit)
            rows[port] = (rows[port] & ~one) | value * one
        if len(rows):
            self._levels = {port: int(rows[port][-1]) for port in self._levels}
        return rows
