"""Step rate generators: they say when a step is due."""

from __future__ import annotations

from amaranth import Module, Signal, signed
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
        # Counts from 0, after `offset` - 1 ticks, so that the comparison needs no sum and registers
        # start at 0, which is small on an FPGA. Without an offset it counts from 1.
        first = 0 if self._offset else 1
        count = Signal(len(self.divisor), init=first)
        lead, counting = Signal(range(max(1, self._offset))), Signal()
        m.d.comb += [
            counting.eq(lead == max(0, self._offset - 1)),
            self.due.eq(self.enable & counting & (count >= self.divisor)),
        ]
        with m.If(self.tick):
            with m.If(~self.enable | self.due & self.ready):
                m.d.sync += [count.eq(first), lead.eq(0)]
            with m.Elif(~counting):
                m.d.sync += lead.eq(lead + 1)
            with m.Elif(~self.due):
                m.d.sync += count.eq(count + 1)
        return m
