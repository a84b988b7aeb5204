"""Step rate generators: they say when a step is due."""

from __future__ import annotations

from amaranth import Module, signed
from amaranth.lib.wiring import Component, In, Out


class PhaseAccumulator(Component):
    """Position that grows by a velocity at every tick (DDA).

    Parameters
    ----------
    width : int
        Size of ``position`` [bit]; it wraps.
    velocity_width : int
        Size of ``velocity`` [bit].

    Members
    -------
    run : In(1)
        Add ``velocity`` at this edge.
    velocity : In(signed(velocity_width))
    position : Out(width)
        Sum so far; 0 after reset.
    """

    def __init__(self, *, width: int, velocity_width: int) -> None:
        super().__init__(
            {
                "run": In(1),
                "velocity": In(signed(velocity_width)),
                "position": Out(width),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        with m.If(self.run):
            m.d.sync += self.position.eq(self.position + self.velocity)
        return m
