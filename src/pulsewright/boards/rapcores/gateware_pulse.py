"""Step pulses of one motor, made from its step position."""

from __future__ import annotations

from amaranth import Cat, Const, Module, Mux, Signal
from amaranth.lib.wiring import Component, In, Out

TIMER_BITS = 16


class PulseFormer(Component):
    """Gives a pulse for each change of a position, in its direction, as fast as the times allow.

    Steps that cannot be given yet are owed, up to 128 of either direction; steps of both directions
    that are owed cancel. Section 4.5 of the specification.

    Members
    -------
    position : In(2)
        Low bits of the step position, which changes by at most 1 per cycle.
    halted : In(1)
        No new pulse, and what is owed is forgotten: ``excess``.
    width, low, setup, hold : In(16)
        Of a pulse, between pulses, and of the direction before and after a pulse; less 1 [cycle].
    step, dir : Out(1)
        ``dir`` is 1 while the position falls.
    excess : Out(9), signed
        By how much ``position`` is beyond the pulses given; while ``halted``, it has to be reduced
        by that at once.
    pending : Out(1)
        Pulses are owed.
    lost : Out(1)
        A step is lost in this cycle, as 128 are owed.
    """

    def __init__(self) -> None:
        super().__init__(
            {
                "position": In(2),
                "halted": In(1),
                "width": In(TIMER_BITS),
                "low": In(TIMER_BITS),
                "setup": In(TIMER_BITS),
                "hold": In(TIMER_BITS),
                "step": Out(1),
                "dir": Out(1),
                "excess": Out(9),
                "pending": Out(1),
                "lost": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        seen, owed = Signal(2), Signal(8)
        moved, down = Signal(), Signal()
        m.d.comb += [  # the difference is 1 or 3, or there is none
            moved.eq(self.position[0] ^ seen[0]),
            down.eq(self.position[1] ^ seen[1] ^ seen[0]),
        ]

        # Pulse and low time follow each other, and so do hold and setup time of the direction: two
        # timers do for the four times.
        pulse_timer, dir_timer, setting_up = Signal(TIMER_BITS), Signal(TIMER_BITS), Signal()
        turn, start = Signal(), Signal()
        negative = owed[-1]
        m.d.comb += [
            self.pending.eq(owed != 0),
            turn.eq(
                ~self.halted
                & ~self.step
                & self.pending
                & (negative ^ self.dir)
                & (setting_up | (dir_timer == 0))
            ),
            start.eq(
                ~self.halted
                & ~self.step
                & self.pending
                & ~(negative ^ self.dir)
                & (pulse_timer == 0)
                & (~setting_up | (dir_timer == 0))
            ),
        ]
        with m.If(pulse_timer != 0):
            m.d.sync += pulse_timer.eq(pulse_timer - 1)
        with m.Elif(self.step):
            m.d.sync += [self.step.eq(0), pulse_timer.eq(self.low)]
        with m.If(start):
            m.d.sync += [self.step.eq(1), pulse_timer.eq(self.width)]

        with m.If(self.step & (pulse_timer == 0)):
            m.d.sync += [dir_timer.eq(self.hold), setting_up.eq(0)]
        with m.Elif(turn):
            m.d.sync += [self.dir.eq(negative), dir_timer.eq(self.setup), setting_up.eq(1)]
        with m.Elif(dir_timer != 0):
            m.d.sync += dir_timer.eq(dir_timer - 1)

        # One pulse given, one step more: at most one up or down in all.
        change = Signal(9)
        m.d.comb += [
            self.excess.eq(
                Cat(owed, owed[-1]) + Mux(moved, Cat(Const(1, 1), down.replicate(8)), 0)
            ),
            change.eq(self.excess - Mux(start, Cat(Const(1, 1), negative.replicate(8)), 0)),
        ]
        m.d.comb += self.lost.eq(~self.halted & (change[8] ^ change[7]))
        m.d.sync += [seen.eq(self.position), owed.eq(change)]
        with m.If(change[8] ^ change[7]):  # without the step, as a pulse is not given then
            m.d.sync += owed.eq(owed)
        with m.If(self.halted):
            m.d.sync += [owed.eq(0), seen.eq(self.position - self.excess[:2])]
        return m
