"""Step pulses of one motor, made from its step position.

Times are kept as their ends on a clock that all motors share, so that a motor needs no counters.
"""

from __future__ import annotations

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib.wiring import Component, In, Out

TIMER_BITS = 16
TIMES = ("width", "low", "setup", "hold")


class Deadlines(Component):
    """The clock that all pulse formers share, and the ends of times that begin now.

    Members
    -------
    width, low, setup, hold : In(16)
        Of a pulse, between pulses, and of the direction before and after a pulse [cycle]; not 0.
    now : Out(17)
        The next cycle.
    width_end, low_end, setup_end, hold_end : Out(17)
        The cycle in which such a time ends, if it begins with the next one; complemented.
    """

    def __init__(self) -> None:
        super().__init__(
            {name: In(TIMER_BITS) for name in TIMES}
            | {"now": Out(TIMER_BITS + 1)}
            | {f"{name}_end": Out(TIMER_BITS + 1) for name in TIMES}
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        now = Signal(TIMER_BITS + 1)
        m.d.comb += self.now.eq(now + 1)
        m.d.sync += now.eq(self.now)
        m.d.comb += [
            getattr(self, f"{name}_end").eq(~(now + getattr(self, name))) for name in TIMES
        ]
        return m


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
    now : In(17), width_end, low_end, setup_end, hold_end : In(17)
        As of `Deadlines`.
    width_one, low_one, setup_one, hold_one : In(1)
        That time is one cycle.
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
                "now": In(TIMER_BITS + 1),
                "step": Out(1),
                "dir": Out(1),
                "owed": Out(9),
                "excess": Out(9),
                "lost": Out(1),
            }
            | {f"{name}_end": In(TIMER_BITS + 1) for name in TIMES}
            | {f"{name}_one": In(1) for name in TIMES}
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        owed = self.owed
        # Pulse and low time follow each other, and so do hold and setup time of the direction: two
        # ends do for the four times.
        setting_up = Signal()
        turn, start, fall = Signal(), Signal(), Signal()
        negative = owed[-1]
        due = Signal()
        low_begins = self.step
        pulse_ended = self._timer(
            m,
            start | fall,
            Mux(low_begins, self.low_end, self.width_end),
            Mux(low_begins, self.low_one, self.width_one),
        )
        dir_ended = self._timer(
            m,
            turn | fall,
            Mux(low_begins, self.hold_end, self.setup_end),
            Mux(low_begins, self.hold_one, self.setup_one),
        )
        m.d.comb += [
            due.eq(~self.blocked & ~self.step & (owed != 0)),
            turn.eq(due & (negative ^ self.dir) & (setting_up | dir_ended)),
            start.eq(due & ~(negative ^ self.dir) & pulse_ended & (~setting_up | dir_ended)),
            fall.eq(self.step & pulse_ended),
        ]
        with m.If(fall):
            m.d.sync += [self.step.eq(0), setting_up.eq(0)]
        with m.If(start):
            m.d.sync += self.step.eq(1)
        with m.If(turn):
            m.d.sync += [self.dir.eq(negative), setting_up.eq(1)]

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

    def _timer(self, m: Module, start: Value, end: Value, one: Value) -> Signal:
        """Add a timer; return whether it is over."""
        kept, over, past = Signal(TIMER_BITS + 1), Signal(init=1), Signal(TIMER_BITS + 1)
        m.d.comb += past.eq((Cat(1, self.now) + Cat(1, kept))[1:])
        with m.If(start):
            m.d.sync += [kept.eq(end), over.eq(one)]
        with m.Elif(~past[-1]):
            m.d.sync += over.eq(1)
        return over
