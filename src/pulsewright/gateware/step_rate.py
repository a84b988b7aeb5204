"""Step rate generators: they say when a step is due."""

from __future__ import annotations

from amaranth import Module, Signal, signed, unsigned
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


class PeriodCounter(Component):
    """Steps at a divided rate: one every ``divisor + offset`` ticks.

    A step that cannot start waits, and none are saved up. A new divisor that the count has passed
    already gives one step at once, and then the new period from there.

    Parameters
    ----------
    width : int
        Size of ``divisor`` [bit].
    offset : int
        Ticks added to it, at least 0.

    Members
    -------
    tick : In(1)
        High in the cycle that ends with a tick; only ticks count.
    enable : In(1)
        Off at a tick: the count starts again.
    divisor : In(width)
        0 makes a step due at every tick or so: disable it.
    ready : In(1)
        A step that is due starts at this tick.
    due : Out(1)
        A step is due. The first one is at the tick that ends the first period.
    """

    def __init__(self, *, width: int, offset: int) -> None:
        if offset < 0:
            raise ValueError(f"offset must be at least 0, not {offset}")
        self._offset = offset
        super().__init__(
            {
                "tick": In(1),
                "enable": In(1),
                "divisor": In(width),
                "ready": In(1),
                "due": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        first, width = 1 - self._offset, len(self.divisor)  # so the comparison needs no sum
        count = Signal(unsigned(width) if first >= 0 else signed(width + 1), init=first)
        m.d.comb += self.due.eq(self.enable & (count >= self.divisor))
        with m.If(self.tick):
            with m.If(~self.enable | self.due & self.ready):
                m.d.sync += count.eq(first)
            with m.Elif(~self.due):
                m.d.sync += count.eq(count + 1)
        return m
