"""The gateware of an EPP board in simulation, in the place of its twin: same calls, same traces."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from amaranth.lib.wiring import Component
from numpy.typing import NDArray

from pulsewright.edges.trace import EdgeTrace
from pulsewright.gateware.rtl import RtlSimulation, pin_changes
from pulsewright.transport.bus import ASAP

ACCESS_NS: Final = 1500  # time of one access, as on the virtual bus
FAR_BACK: Final = -(1 << 62)


class RtlEppBoard:
    """One board on an EPP bus, simulated clock by clock.

    Parameters
    ----------
    component : Component
        The board, with the ports of an `EppPort`.
    clock_hz : int
        Its clock [Hz].
    nwait_idle : int
        Level of nWait between cycles.
    idle : mapping of str to int
        Inputs other than the bus that are not 0: reset lines, a closed estop chain.
    pins : mapping of str to str
        Output ports to record, with the names of their pins; ports of several bits are numbered.
    """

    def __init__(
        self,
        component: Component,
        *,
        clock_hz: int,
        nwait_idle: int,
        idle: Mapping[str, int],
        pins: Mapping[str, str],
    ) -> None:
        self.clock_hz = clock_hz
        self.access_cycles = clock_hz // 1000 * ACCESS_NS // 1_000_000
        self._nwait_idle = nwait_idle
        self._simulation = RtlSimulation(component)
        self._inputs = np.zeros(1, self._simulation.inputs)
        for port in ("nwrite", "ndatastr", "naddrstr"):
            self._inputs[port] = 1
        for port, level in idle.items():
            self._inputs[port] = level
        widths = {port: len(getattr(component, port)) for port in pins}
        self._bits = [(port, bit) for port, width in widths.items() for bit in range(width)]
        self.pins = tuple(
            f"{pins[port]}{bit}" if widths[port] > 1 else pins[port] for port, bit in self._bits
        )
        self.restart()

    @property
    def now(self) -> int:
        """Cycle up to which time has passed."""
        return max(self._simulation.cycle - 1, 0)

    def restart(self) -> None:
        """Start again: clock edge 0 is the next one, and all registers have their reset values."""
        self._simulation.reset()
        self._inputs["cycle"] = 0
        self._rows = [self._simulation.run(1, self._inputs)]
        self._free = 0  # cycle from which on the bus is free
        self._start, self._levels = 0, np.zeros(len(self.pins), np.uint8)

    def reset(self) -> None:
        """Bring all registers to their reset values, as power-up does, while time goes on."""
        self._apply(rst=1)
        self._apply(rst=0)

    def set_input(self, port: str, level: int) -> None:
        """Set an input port other than the bus, from the next clock edge on."""
        self._apply(**{port: level})

    def _apply(self, **levels: int) -> None:
        for port, level in levels.items():
            self._inputs[port] = level
        self._inputs["cycle"] = cycle = self._simulation.cycle
        self._rows.append(self._simulation.run(cycle + 1, self._inputs))

    def advance(self, cycle: int) -> None:
        """Run through clock edge ``cycle`` without bus access."""
        self._rows.append(self._simulation.run(cycle + 1))

    def transact(self, accesses: NDArray[np.void]) -> None:
        """Carry out an array of `EPP_ACCESS`, see `EppBus.transact`.

        The handshake takes 10 cycles; the rest of the time of an access passes before the next one.
        """
        if not len(accesses):
            return
        gaps = self.access_cycles * np.arange(len(accesses))
        wanted = np.where(accesses["cycle"] == ASAP, FAR_BACK, accesses["cycle"]) - gaps
        planned = np.maximum.accumulate(np.maximum(wanted, self._free)) + gaps
        accesses["cycle"] = planned
        self._rows.append(self._simulation.transact(accesses, self._nwait_idle))
        late = int(accesses["cycle"][-1]) - int(planned[-1])
        # one strobe fills three edges, so nothing acts before edge 2: that is no delay
        self._free = int(planned[-1]) + self.access_cycles + (late if late > 2 else 0)

    def drain(self) -> EdgeTrace:
        """Return all level changes of the pins since the last call."""
        rows = np.concatenate([np.zeros(0, self._simulation.outputs), *self._rows])
        self._rows = []
        start, end = self._start, self._simulation.cycle
        cycles, final = pin_changes(rows, self._bits, self._levels)
        trace = EdgeTrace(self.clock_hz, self.pins, self._levels, cycles, start, end)
        self._start, self._levels = end, final
        return trace
