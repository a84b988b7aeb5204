"""Benches for the step generator of pluto_step, written from `pluto_step.md` 4.2 and 6.2."""

from amaranth import Cat, Const, Elaboratable, Module, Mux, Signal, Value, signed
from amaranth.lib.wiring import Component, In, Out
from formal_harness import Bench

from pulsewright.boards.pluto_step import gateware
from pulsewright.gateware import serial_timer

FAR = 31  # counters of ticks stop here, above every time that can be programmed


class SpecifiedAxis(Elaboratable):
    """The step generator as the specification tabulates it, in the names of `StepGenerator`.

    Beside them: ``tap`` before the edge, and ``steptime`` and ``dirtime`` as whole values.
    """

    def __init__(self, *, clean_cancel, enforce_space):
        self.clean_cancel, self.enforce_space = clean_cancel, enforce_space
        self.tick, self.drop, self.moved_tap = Signal(), Signal(), Signal()
        self.velocity = Signal(signed(12))
        self.steptime, self.dirtime, self.space = Signal(4), Signal(4), Signal(4)
        self.tap, self.next_tap = Signal(2), Signal(2)
        self.position = Signal(21)
        self.step, self.dir, self.missed = Signal(), Signal(), Signal()
        self.holding, self.setting_up = Signal(), Signal()  # modes; RUN is neither

    def elaborate(self, platform):
        m = Module()
        last, timer, space = Signal(), Signal(4), Signal(4)
        bit = self.position.bit_select(11 + self.tap, 1)
        negative = self.velocity[-1]
        want, pend = self.dir != negative, bit != last
        fires, falls = Signal(), Signal()  # a pulse starts or ends at this tick
        m.d.comb += falls.eq(self.tick & self.step & (timer == 0) & ~self.setting_up & ~fires)
        with m.If(self.tick):
            with m.If(want & ~pend):  # case A
                with m.If(timer > 0):
                    m.d.sync += timer.eq(timer - 1)
                with m.Elif(self.holding):
                    m.d.sync += [self.dir.eq(negative), timer.eq(self.dirtime)]
                    m.d.sync += [self.holding.eq(0), self.setting_up.eq(1)]
                with m.Else():
                    m.d.sync += [self.step.eq(0), timer.eq(self.dirtime)]
                    m.d.sync += [self.holding.eq(1), self.setting_up.eq(0)]
            with m.Elif(self.setting_up):  # case B
                with m.If(timer > 0):
                    m.d.sync += timer.eq(timer - 1)
                with m.Else():
                    m.d.sync += self.setting_up.eq(0)
            with m.Else():  # case C
                cancelled = self.holding if self.clean_cancel else Const(0)
                with m.If((timer > 0) & ~cancelled):
                    m.d.sync += timer.eq(timer - 1)
                with m.Else():
                    m.d.sync += [timer.eq(0), self.step.eq(0)]
                    if self.clean_cancel:
                        m.d.sync += self.holding.eq(0)
                    with m.If(pend & (~self.step & (space == 0) if self.enforce_space else 1)):
                        m.d.comb += fires.eq(1)
                        m.d.sync += [last.eq(bit), self.step.eq(1), timer.eq(self.steptime)]
                with m.If(~want):
                    m.d.sync += self.position.eq(self.position + self.velocity)
        with m.If(self.drop):
            m.d.sync += last.eq(self.position.bit_select(11 + self.next_tap, 1))
        if self.enforce_space:
            with m.If(falls):
                m.d.sync += space.eq(self.space)
            with m.Elif(self.tick & ~self.step & (space > 0)):
                m.d.sync += space.eq(space - 1)
            waited = Signal()  # pending at the last tick, without a pulse and the same tap since
            m.d.comb += self.missed.eq(self.tick & waited & ~pend)
            with m.If(self.tick):
                m.d.sync += waited.eq(pend & ~fires)
            with m.If(self.moved_tap):
                m.d.sync += waited.eq(0)
        return m


class StepBench(Bench):
    """A step generator between free inputs; velocity, times and tap may change at any edge.

    Parameters
    ----------
    module : module
        Where the step generator comes from; None for `SpecifiedAxis`, with a tick at every edge.
        Otherwise ticks are at least six edges apart; the board has 64.
    fixed_tap : int, optional
        The tap stays as it is.
    extended : bool
        The profile.
    """

    TICK_EDGES = 6

    def __init__(self, module=gateware, *, fixed_tap=None, extended=True):
        self.switches = dict.fromkeys(("clean_cancel", "enforce_space"), extended)
        self.fixed_tap = fixed_tap
        self.specified = module is None
        self.axis = (
            SpecifiedAxis(**self.switches)
            if module is None
            else module.StepGenerator(**self.switches)
        )
        self.tap_sync = extended
        super().__init__()

    def build(self, m: Module) -> None:
        m.submodules.axis = axis = self.axis
        self.velocity, self.space = self.free(signed(12), "velocity"), self.free(4, "space")
        self.times = {name: self.free(4, name) for name in ("steptime", "dirtime")}
        m.d.comb += [axis.velocity.eq(self.velocity), axis.space.eq(self.space)]

        if self.specified:
            self.tick = Const(1)
            m.d.comb += [getattr(axis, name).eq(value) for name, value in self.times.items()]
        else:
            self.tick = self.free(1, "tick")
            self.spread_times(m)
        m.d.comb += axis.tick.eq(self.tick)

        # The tap register, and the bus that may change it at any edge.
        self.tap = tap = Signal(2, init=self.fixed_tap or 0)
        self.next_tap = tap if self.fixed_tap is not None else self.free(2, "tap_written")
        self.moved_tap = self.next_tap != tap
        m.d.sync += tap.eq(self.next_tap)
        m.d.comb += [
            axis.next_tap.eq(self.next_tap),
            axis.moved_tap.eq(self.moved_tap),
            axis.drop.eq(self.moved_tap if self.tap_sync else 0),
        ]
        if self.specified:
            m.d.comb += axis.tap.eq(tap)
        self.observe(m)

    def spread_times(self, m: Module) -> None:
        """Send the bits of the times, as each tick finds them, after the tick as the board does."""
        age = Signal(range(self.TICK_EDGES + 1))  # edges since the tick
        with m.If(self.tick):
            m.d.sync += age.eq(1)
        with m.Elif(age != 0):
            m.d.sync += age.eq(Mux(age == self.TICK_EDGES - 1, 0, age + 1))
        self.assume(~self.tick | (age == 0))
        shift = age.matches(2, 3, 4, 5)
        m.d.comb += self.axis.shift.eq(shift)
        for name, value in self.times.items():
            held = Signal(4, name=f"{name}_held")
            with m.If(self.tick):
                m.d.sync += held.eq(value)
            with m.If(shift):
                m.d.comb += getattr(self.axis, name).eq(held.bit_select((age - 2)[:2], 1))

    def observe(self, m: Module) -> None:
        raise NotImplementedError

    def before(self, value, init=0):
        """Return what ``value`` was at the last tick."""
        kept = Signal(Value.cast(value).shape(), init=init)
        with self.module.If(self.tick):
            self.module.d.sync += kept.eq(value)
        return kept


class TableBench(StepBench):
    """The step generator does what the table of the specification says, at every clock edge."""

    def observe(self, m: Module) -> None:
        m.submodules.table = table = SpecifiedAxis(**self.switches)
        m.d.comb += [
            table.tick.eq(self.tick),
            table.velocity.eq(self.velocity),
            table.space.eq(self.space),
            table.steptime.eq(self.times["steptime"]),
            table.dirtime.eq(self.times["dirtime"]),
            table.tap.eq(self.tap),
            table.next_tap.eq(self.next_tap),
            table.moved_tap.eq(self.moved_tap),
            table.drop.eq(self.moved_tap if self.tap_sync else 0),
        ]
        for name in ("position", "step", "dir", "missed"):
            self.always(name, getattr(self.axis, name) == getattr(table, name))
        self.possible("a reversal after another", table.holding & table.dir)


class Timer(Component):
    """What `SerialTimer` promises, as a counter that is loaded bit by bit into its place."""

    def __init__(self, *, width):
        super().__init__(
            {"tick": In(1), "clear": In(1), "shift": In(1), "bit": In(1), "idle": Out(1)}
        )
        self.width = width

    def elaborate(self, platform):
        m = Module()
        count, place = Signal(self.width), Signal(range(self.width))
        m.d.comb += self.idle.eq(count == 0)
        with m.If(self.tick):
            m.d.sync += [count.eq(Mux(self.clear | self.idle, 0, count - 1)), place.eq(0)]
        with m.If(self.shift):
            m.d.sync += [count.eq(count | self.bit << place), place.eq(place + 1)]
        return m


class PinBench(StepBench):
    """What a drive may rely on, seen at the pins and at ticks only.

    Values are looked at in the cycle that ends with a tick: they are as the last tick left them,
    and ``x_before`` as the one before it did.
    """

    def observe(self, m: Module) -> None:
        axis, tick = self.axis, self.tick
        step, direction = axis.step, axis.dir
        step_before, dir_before = self.before(step), self.before(direction)
        rises, falls = step & ~step_before, ~step & step_before
        flips = direction != dir_before
        T, S, SP = self.times["dirtime"], self.times["steptime"], self.space
        T_before, S_before, SP_before = self.before(T), self.before(S), self.before(SP)
        quiet_edge = self.past(~self.tick) if not self.specified else Const(0)
        outputs = Cat(step, direction, axis.position)
        self.always(
            "pins and position change at ticks only",
            ~quiet_edge | (outputs == self.past(outputs)),
        )

        # Pulse width: S and one more ticks, S as found by the tick that started the pulse.
        high = Signal(4)  # ticks that step must stay high beyond this one
        with m.If(tick):
            m.d.sync += high.eq(Mux(rises, S_before, Mux(high > 0, high - 1, 0)))
        self.always("width", ~tick | (high == 0) | step)
        self.always("width is exact", ~tick | (high > 0) | ~step | rises)
        low = Signal(4)
        with m.If(tick):
            m.d.sync += low.eq(Mux(falls, SP_before, Mux(low > 0, low - 1, 0)))
        self.always("space", ~tick | (low == 0) | ~step)

        # Direction: hold after the end of a pulse, for the shortest time programmed since, and
        # set-up before the next one, for the time found by the tick that changed the direction.
        quiet = Signal(range(FAR + 1), init=FAR)  # ticks since the one that ended a pulse
        shortest = Signal(4, init=15)
        with m.If(tick):
            m.d.sync += shortest.eq(Mux(step | (shortest > T), T, shortest))
            m.d.sync += quiet.eq(Mux(step, 0, Mux(quiet == FAR, FAR, quiet + 1)))
        self.always("dir changes while step is low", ~tick | ~flips | ~step & ~step_before)
        self.always("hold", ~tick | ~flips | (quiet > shortest))
        since, setup = Signal(range(FAR + 1), init=FAR), Signal(4)
        with m.If(tick & flips):
            m.d.sync += [since.eq(1), setup.eq(T_before)]
        with m.Elif(tick & (since < FAR)):
            m.d.sync += since.eq(since + 1)
        self.always("set-up", ~tick | ~rises | (since >= setup + 3))
        self.always("set-up while the tap changes", ~tick | ~rises | (since >= setup + 2))

        # Position: it moves only the way that the direction pin points.
        velocity_negative = self.before(self.velocity[-1])
        moves = axis.position != self.before(axis.position)
        self.always(
            "position moves along dir",
            ~tick | ~moves | (velocity_negative == dir_before) & ~flips,
        )

        # Steps out against whole steps of position: what is due is at most one, along dir.
        whole = (
            axis.position.shift_right(11)
            if self.fixed_tap is None
            else axis.position[11 + self.fixed_tap : 13 + self.fixed_tap]
        )
        whole = whole[:2]
        moved = Signal(signed(2))
        m.d.comb += moved.eq(whole - self.before(whole))
        due, now = Signal(signed(4)), Signal(signed(4))
        along = Mux(direction, Const(-1, signed(2)), Const(1, signed(2)))
        m.d.comb += now.eq(due + moved - Mux(rises, along, 0) - Mux(axis.missed, along << 1, 0))
        with m.If(tick):
            m.d.sync += due.eq(now)
        self.always("steps out are position counted", ~tick | (now == 0) | (now == along))
        self.always("no step is missed", ~axis.missed)

        # Reversals that are called off: what the quirk of the original needs.
        reverse = self.velocity[-1] != direction
        asked = Signal()  # the last tick wanted to reverse, and the direction is still the old one
        with m.If(tick):
            m.d.sync += asked.eq(reverse)
        self.calls_off = tick & asked & ~flips & ~reverse
        self.possible("dir changes while step is high", tick & flips & step)
        self.possible("dir changes", tick & flips & ~step)
        self.possible("dir changes back", tick & flips & dir_before)
        self.possible("a step is missed", axis.missed)
        self.possible("a reversal is called off", self.calls_off & (quiet < 2))


class TimerBench(Bench):
    """The serial timer and its promise, used as the step generator uses it."""

    def __init__(self, module=serial_timer):
        self.timer = module.SerialTimer(width=4)
        super().__init__()

    def build(self, m: Module) -> None:
        m.submodules.timer, m.submodules.promise = timer, promise = self.timer, Timer(width=4)
        tick, clear, bit = (self.free(1, name) for name in ("tick", "clear", "bit"))
        age, loadable = Signal(range(7)), Signal()
        with m.If(tick):
            m.d.sync += [age.eq(1), loadable.eq(timer.idle | clear)]
        with m.Elif(age != 0):
            m.d.sync += age.eq(Mux(age == 5, 0, age + 1))
        self.assume(~tick | (age == 0))
        for block in timer, promise:
            m.d.comb += [
                block.tick.eq(tick),
                block.clear.eq(clear),
                block.shift.eq(age.matches(2, 3, 4, 5)),
                block.bit.eq(bit & loadable),
            ]
        self.always("idle at ticks", ~tick | (timer.idle == promise.idle))
        self.possible("runs out after 15 ticks", tick & timer.idle & ~self.past(timer.idle))


class SteadyBench(PinBench):
    """Nobody calls off a reversal that has begun: the quirk of the original cannot happen."""

    def observe(self, m: Module) -> None:
        super().observe(m)
        self.assume(~self.calls_off)


class SpeedBench(PinBench):
    """A client keeps to the speed limit of a pulse and a space that it does not change.

    In profile ``exact`` it calls off no reversal either.
    """

    def __init__(self, module=None, *, steptime, space, extended=True, limit=None):
        self.pulse, self.gap = steptime, space
        ticks = steptime + 2 + (space if extended else 0)
        self.limit = 2048 // ticks if limit is None else limit
        super().__init__(module, fixed_tap=0, extended=extended)

    def observe(self, m: Module) -> None:
        super().observe(m)
        self.assume(self.times["steptime"] == self.pulse)
        self.assume(self.space == self.gap)
        if not self.switches["clean_cancel"]:
            self.assume(~self.calls_off)
        self.assume((self.velocity <= self.limit) & (self.velocity >= -self.limit))
