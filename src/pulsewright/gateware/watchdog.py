"""Watchdog: something that must be fed, or it expires."""

from __future__ import annotations

from amaranth import Module, Signal
from amaranth.lib.wiring import Component, In, Out

from pulsewright.gateware.arithmetic import increment


class Watchdog(Component):
    """Counter of ticks since the last feed.

    Parameters
    ----------
    ticks : int
        Ticks after a feed until it expires.
    starts_expired : bool
        After reset it is expired until it is fed; otherwise reset counts as a feed.

    Members
    -------
    tick : In(1)
        Count one tick at this edge.
    feed : In(1)
        Start again at this edge; wins over a tick.
    expired : Out(1)
        High from the edge of the last tick until a feed.
    """

    def __init__(self, *, ticks: int, starts_expired: bool = False) -> None:
        if ticks < 1:
            raise ValueError(f"ticks must be at least 1, not {ticks}")
        self._ticks = ticks
        self._starts_expired = starts_expired
        super().__init__({"tick": In(1), "feed": In(1), "expired": Out(1)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        count = Signal(range(self._ticks + 1), init=self._ticks if self._starts_expired else 0)
        m.d.comb += self.expired.eq(count == self._ticks)
        with m.If(self.feed):
            m.d.sync += count.eq(0)
        with m.Elif(self.tick & ~self.expired):
            m.d.sync += count.eq(increment(count))
        return m
