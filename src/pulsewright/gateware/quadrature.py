"""Quadrature encoder: decoder and position counter."""

from __future__ import annotations

from amaranth import Module, Mux, Signal
from amaranth.lib.wiring import Component, In, Out


class QuadratureDecoder(Component):
    """Counts every edge of two signals in quadrature (x4).

    Members
    -------
    a, b : In(1)
        Synchronised to the clock. A leads B while the position rises.
    count : Out(1)
        One of them changed since the edge before. A change of both at once is ignored: which way
        it went cannot be known.
    up : Out(1)
        With ``count``: the position rises.
    """

    def __init__(self) -> None:
        super().__init__({"a": In(1), "b": In(1), "count": Out(1), "up": Out(1)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        a, b = Signal(), Signal()
        m.d.sync += [a.eq(self.a), b.eq(self.b)]
        m.d.comb += [
            self.count.eq((a ^ self.a) ^ (b ^ self.b)),
            self.up.eq(self.a ^ b),
        ]
        return m


class EncoderCounter(Component):
    """Position counter with a holding register.

    Parameters
    ----------
    width : int
        Size of the counter [bit]; it wraps.

    Members
    -------
    count, up : In(1)
        Count by one at this edge.
    load : In(1), value : In(width)
        While ``load``, the counter shows ``value`` and goes on from there: resets and counts are
        lost.
    reset : In(1)
        The counter becomes 0 at this edge; wins over a count.
    latch : In(1)
        The holding register takes the counter at this edge, as it is before it.
    position, held : Out(width)
        Counter and holding register.
    """

    def __init__(self, *, width: int) -> None:
        super().__init__(
            {
                "count": In(1),
                "up": In(1),
                "load": In(1),
                "value": In(width),
                "reset": In(1),
                "latch": In(1),
                "position": Out(width),
                "held": Out(width),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        count = Signal.like(self.value)
        m.d.comb += self.position.eq(Mux(self.load, self.value, count))
        with m.If(self.latch):
            m.d.sync += self.held.eq(self.position)
        with m.If(self.load):
            m.d.sync += count.eq(self.value)
        with m.Elif(self.reset):
            m.d.sync += count.eq(0)
        with m.Elif(self.count):
            m.d.sync += count.eq(count + Mux(self.up, 1, -1))
        return m
