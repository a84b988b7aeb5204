"""Timer for events that are many clock cycles apart."""

from __future__ import annotations

from amaranth import Cat, Module, Signal
from amaranth.lib.wiring import Component, In, Out


class SerialTimer(Component):
    """Down counter of ticks that works one bit at a time in the cycles between two ticks.

    Parameters
    ----------
    width : int
        Size of the counter [bit].

    Members
    -------
    tick : In(1)
        After this edge the counter counts down by one, unless it is 0.
    clear : In(1)
        Sampled at ticks: the counter becomes 0 instead.
    shift : In(1)
        High in ``width`` cycles between two ticks, in which the bits of the counter pass, the
        lowest first.
    bit : In(1)
        Bit of a value to load, in these cycles; 0 to load nothing. Only a timer that was idle or
        cleared at the tick can be loaded.
    idle : Out(1)
        The counter is 0. Valid at ticks.
    """

    def __init__(self, *, width: int) -> None:
        self._width = width
        super().__init__(
            {
                "tick": In(1),
                "clear": In(1),
                "shift": In(1),
                "bit": In(1),
                "idle": Out(1, init=1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        count = Signal(self._width)
        borrow, cleared = Signal(), Signal()
        changed = Signal()
        m.d.comb += changed.eq(self.bit | (count[0] ^ borrow) & ~cleared)
        with m.If(self.tick):
            m.d.sync += [
                borrow.eq(~self.idle & ~self.clear),
                cleared.eq(self.clear),
                self.idle.eq(1),
            ]
        with m.If(self.shift):
            m.d.sync += [
                count.eq(Cat(count[1:], changed)),
                borrow.eq(borrow & ~count[0]),
                self.idle.eq(self.idle & ~changed),
            ]
        return m
