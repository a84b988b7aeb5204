"""Step pulses of one motor, made from its step position."""

from __future__ import annotations

from amaranth import Cat, Module, Signal
from amaranth.lib.wiring import Component, In, Out

TIMER_BITS = 16


class PulseFormer(Component):
    """Gives a pulse for each change of a position, in its direction, as fast as the times allow.

    Steps that cannot be given yet are owed, up to 128 of either direction; steps of both directions
    that are owed cancel. Section 4.5 of the specification.

    Members
    -------
    moved, down : In(1)
        The position has changed by one, downwards.
    halted : In(1)
        All that is owed and comes now is to be taken back; nothing is lost.
    blocked : In(1)
        No new pulse, and no change of ``dir``.
    forget : In(1)
        What is owed has been taken back.
    width, low, setup, hold : In(16)
        Of a pulse, between pulses, and of the direction before and after a pulse; less 1 [cycle].
    step, dir : Out(1)
        ``dir`` is 1 while the position falls.
    owed, excess : Out(9), signed
        Pulses owed in this cycle, and in the next one unless a step is lost or all is forgotten.
    lost : Out(1)
        A step is lost in this cycle, as 128 are owed.
    """

    def __init__(self) -> None:
        super().__init__(
            {
                "moved": In(1),
                "down": In(1),
                "halted": In(1),
                "blocked": In(1),
                "forget": In(1),
                "width": In(TIMER_BITS),
                "low": In(TIMER_BITS),
                "setup": In(TIMER_BITS),
                "hold": In(TIMER_BITS),
                "step": Out(1),
                "dir": Out(1),
                "owed": Out(9),
                "excess": Out(9),
                "lost": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        owed = self.owed
        # Pulse and low time follow each other, and so do hold and setup time of the direction: two
        # timers do for the four times.
        pulse_timer, dir_timer, setting_up = Signal(TIMER_BITS), Signal(TIMER_BITS), Signal()
        turn, start = Signal(), Signal()
        negative = owed[-1]
        pulse_ended, dir_ended, due = Signal(), Signal(), Signal()
        m.d.comb += [
            pulse_ended.eq(pulse_timer == 0),
            dir_ended.eq(dir_timer == 0),
            due.eq(~self.blocked & ~self.step & (owed != 0)),
            turn.eq(due & (negative ^ self.dir) & (setting_up | dir_ended)),
            start.eq(due & ~(negative ^ self.dir) & pulse_ended & (~setting_up | dir_ended)),
        ]
        with m.If(~pulse_ended):
            m.d.sync += pulse_timer.eq(pulse_timer - 1)
        with m.Elif(self.step):
            m.d.sync += [self.step.eq(0), pulse_timer.eq(self.low)]
        with m.If(start):
            m.d.sync += [self.step.eq(1), pulse_timer.eq(self.width)]

        with m.If(self.step & pulse_ended):
            m.d.sync += [dir_timer.eq(self.hold), setting_up.eq(0)]
        with m.Elif(turn):
            m.d.sync += [self.dir.eq(negative), dir_timer.eq(self.setup), setting_up.eq(1)]
        with m.Elif(~dir_ended):
            m.d.sync += dir_timer.eq(dir_timer - 1)

        # One pulse given, one step more: at most two up or down in all.
        step, given, total, overflow = Signal(2), Signal(2), Signal(9), Signal()
        m.d.comb += [
            step.eq(Cat(self.moved, self.moved & self.down)),
            given.eq(Cat(start, start & negative)),
            total.eq(owed.as_signed() + (step.as_signed() - given.as_signed())),
            overflow.eq(~self.halted & (total[8] ^ total[7])),
            self.excess.eq(total),
            self.lost.eq(overflow),
        ]
        with m.If(self.forget):
            m.d.sync += owed.eq(0)
        with m.Elif(~overflow):  # otherwise without the step; no pulse is given then
            m.d.sync += owed.eq(total)
        return m
