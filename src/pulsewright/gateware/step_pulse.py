"""Step pulse former: width, space, and the set-up time of the direction."""

from __future__ import annotations

from amaranth import Module, Signal
from amaranth.lib.wiring import Component, In, Out


class StepPulse(Component):
    """Makes pulses that a drive can follow, out of steps that are due.

    Parameters
    ----------
    min_space : int
        Ticks between the end of a pulse and the start of the next one, at least 1.
    change_at_fall : bool
        The direction changes as a pulse ends, or at any tick without one, and no set-up time is
        kept. Otherwise it stays for the set-up time after a pulse, and a pulse waits for the set-up
        time after a change.

    Members
    -------
    tick : In(1)
        High in the cycle that ends with a tick; everything below is sampled and changes there.
    due : In(1)
        A step is due.
    ready : Out(1)
        A step that is due starts a pulse at this tick.
    direction : In(1)
        Wanted level of ``dir``.
    width : In(8)
        A pulse is this many ticks wide, and one more; sampled as it starts.
    setup : In(8)
        Set-up time, less one [tick]; sampled as each starts.
    step, dir : Out(1)
    """

    def __init__(self, *, min_space: int = 1, change_at_fall: bool = False) -> None:
        if min_space < 1:
            raise ValueError(f"min_space must be at least 1, not {min_space}")
        self._min_space = min_space
        self._change_at_fall = change_at_fall
        super().__init__(
            {
                "tick": In(1),
                "due": In(1),
                "ready": Out(1),
                "direction": In(1),
                "width": In(8),
                "setup": In(8),
                "step": Out(1),
                "dir": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        # One timer is enough, as one time follows the other: the rest of the pulse, then the time
        # until the direction may change, then, while setting up, the time until a pulse may start.
        timer, setting_up = Signal(8), Signal()
        space = Signal(range(self._min_space))  # ticks until a pulse may start
        ended, turn = Signal(), Signal()
        m.d.comb += [
            ended.eq(timer == 0),
            turn.eq(self.dir ^ self.direction),
            self.ready.eq(~self.step & (space == 0) & ~turn & (ended | ~setting_up)),
        ]
        with m.If(self.tick):
            with m.If(~ended):
                m.d.sync += timer.eq(timer - 1)
            with m.If(self.step):
                m.d.sync += space.eq(self._min_space - 1)
                with m.If(ended):
                    m.d.sync += self.step.eq(0)
                    if self._change_at_fall:
                        m.d.sync += self.dir.eq(self.direction)
                    else:
                        m.d.sync += [timer.eq(self.setup), setting_up.eq(0)]
            with m.Else():
                with m.If(space != 0):
                    m.d.sync += space.eq(space - 1)
                with m.If(self.ready & self.due):
                    m.d.sync += [self.step.eq(1), timer.eq(self.width)]
                if self._change_at_fall:
                    m.d.sync += self.dir.eq(self.direction)
                else:
                    with m.If(turn & (ended | setting_up)):
                        m.d.sync += self.dir.eq(self.direction)
                        m.d.sync += [timer.eq(self.setup), setting_up.eq(1)]
        return m
