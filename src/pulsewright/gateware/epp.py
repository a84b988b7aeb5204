"""Board side of an IEEE-1284 EPP bus that is sampled with the board's own clock."""

from __future__ import annotations

from amaranth import Module, Mux, Signal
from amaranth.lib.wiring import Component, In, Out

from pulsewright.gateware.arithmetic import increment


class EppPort(Component):
    """EPP handshake, strobe filter and auto-incrementing address register.

    A strobe passes five flip-flops; no other pin is registered. A is the first edge that samples
    the strobe active, R the first one that samples it inactive again:

    ======  ======================================================================================
    edge    event
    ======  ======================================================================================
    A + 2   the **action**: nWrite, strobes and data are used as they are at this edge
    A + 4   nWait low; the byte read is on the bus while nWrite is high
    R + 4   nWait high, bus released
    ======  ======================================================================================

    A new action needs at least one edge that samples the strobe inactive. A strobe that is gone at
    A + 2 still acts: the address increments and nothing is written.

    Parameters
    ----------
    address_bits : int
        Size of the register address; it wraps.
    base : int or None
        Value of the address bits above ``address_bits`` that selects this board. A board that is
        not selected keeps its register address but does not act, acknowledge or drive the bus.
        None: no such bits, always selected.
    nwait_idle : int
        Level of nWait between cycles: 1, or 0 as IEEE 1284 has it.

    Members
    -------
    nwrite, ndatastr, naddrstr : In(1)
        Pins, active low.
    data_i : In(8)
        Data pins.
    data_o, data_oe : Out(8), Out(1)
        Byte for the data pins; they are driven while ``data_oe``.
    nwait : Out(1)
        Pin.
    action : Out(1)
        High in the cycle that ends with an action edge.
    write : Out(1)
        The action writes ``wdata`` to ``address``.
    read : Out(1)
        The action is a read, of data or of the address register.
    address : Out(address_bits)
        Register address, before the action.
    wdata : Out(8)
        ``data_i``.
    rdata : In(8)
        Byte to drive.
    """

    def __init__(
        self, *, address_bits: int = 5, base: int | None = None, nwait_idle: int = 1
    ) -> None:
        if not 1 <= address_bits <= 8:
            raise ValueError(f"address_bits must be 1 to 8, not {address_bits}")
        if base is not None and not 0 <= base < 1 << (8 - address_bits):
            raise ValueError(
                f"base must be 0 to {(1 << (8 - address_bits)) - 1} beside {address_bits} address "
                f"bits, not {base}"
            )
        if nwait_idle not in (0, 1):
            raise ValueError(f"nwait_idle must be 0 or 1, not {nwait_idle}")
        self._base = base
        self._nwait_idle = nwait_idle
        super().__init__(
            {
                "nwrite": In(1),
                "ndatastr": In(1),
                "naddrstr": In(1),
                "data_i": In(8),
                "data_o": Out(8),
                "data_oe": Out(1),
                "nwait": Out(1),
                "action": Out(1),
                "write": Out(1),
                "read": Out(1),
                "address": Out(address_bits),
                "wdata": Out(8),
                "rdata": In(8),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        stages = Signal(5)  # bit i: the strobe, i edges before the last one
        m.d.sync += stages.eq((stages << 1) | ~(self.ndatastr & self.naddrstr))
        fires = stages[1] & ~stages[2]

        bits = len(self.address)
        selected: Signal | int = 1
        if self._base is not None:
            upper = Signal(8 - bits)
            with m.If(fires & ~self.naddrstr & ~self.nwrite):
                m.d.sync += upper.eq(self.data_i[bits:])
            selected = upper == self._base
        acknowledge = stages[4] & selected
        m.d.comb += [
            self.action.eq(fires & selected),
            self.write.eq(self.action & ~self.ndatastr & ~self.nwrite),
            self.read.eq(self.action & self.nwrite),
            self.wdata.eq(self.data_i),
            self.data_o.eq(self.rdata),
            self.data_oe.eq(acknowledge & self.nwrite),
            self.nwait.eq(acknowledge ^ self._nwait_idle),
        ]
        # An address write loads, even on boards it deselects; an address read leaves it alone.
        with m.If(fires & ~self.naddrstr & ~self.nwrite | self.action & self.naddrstr):
            m.d.sync += self.address.eq(
                Mux(self.naddrstr, increment(self.address), self.data_i[:bits])
            )
        return m
