"""Digital inputs that change at any time."""

from __future__ import annotations

from amaranth import Module, Signal
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import Component, In, Out


class InputFilter(Component):
    """Two-flop synchroniser, and a filter against short pulses.

    Parameters
    ----------
    width : int
        Number of inputs, each with a filter of its own.
    samples : int
        A level is passed on when it was there in this many samples in a row; 1 does not filter.

    Members
    -------
    pins : In(width)
        Asynchronous.
    levels : Out(width)
        Levels to use at the present edge: edge n + 1 + ``samples`` is the first to use a level that
        edges n to n + ``samples`` - 1 sampled.
    before : Out(width)
        Levels used at the edge before; 0 after reset.
    """

    def __init__(self, *, width: int, samples: int = 1) -> None:
        if samples < 1:
            raise ValueError(f"samples must be at least 1, not {samples}")
        self._samples = samples
        super().__init__({"pins": In(width), "levels": Out(width), "before": Out(width)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        sampled, accepted = Signal.like(self.pins), Signal.like(self.pins)
        m.submodules.synchroniser = FFSynchronizer(self.pins, sampled, reset_less=False)
        m.d.comb += self.levels.eq(self.before ^ accepted)
        m.d.sync += self.before.eq(self.levels)
        for n in range(len(self.pins)):
            other = sampled[n] ^ self.before[n]
            count = Signal(range(self._samples), name=f"count{n}")  # samples of the other level
            m.d.comb += accepted[n].eq(other & (count == self._samples - 1))
            with m.If(~other | accepted[n]):
                m.d.sync += count.eq(0)
            with m.Else():
                m.d.sync += count.eq(count + 1)
        return m
