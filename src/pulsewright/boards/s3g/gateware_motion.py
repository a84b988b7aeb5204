"""Gateware of the board's motion: acceleration steps, profiles of channels, step pulses."""

from __future__ import annotations

from typing import Final

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib.wiring import Component, In, Out

from pulsewright.boards.s3g import registers

STEP_BIT: Final = registers.STEP_UNITS.bit_length() - 1
MOVE_BITS: Final = STEP_BIT + 1  # of a speed: more make no difference to the fraction of a step
LOAD_BITS: Final = 6  # registers.SET_X to SET_TARGET_V
VALUES: Final = registers.W_X_VAL_LO[1] - registers.W_X_VAL_LO[0]  # registers of a channel
# Where a channel's value registers are, from the first of them on.
X_LOW, X_HIGH, V, A, J, JJ, TARGET_V, ABORT_A = range(8)


class AccelerationSteps(Component):
    """When velocities change; the board's ASG.

    Parameters
    ----------
    abort_dt_latched : bool
        Steps of an abort are as long as those before it, not as ``dt_value`` says at the time.
    paced : bool
        A step that is due waits for ``ready``; otherwise that does nothing.

    Members
    -------
    ready : In(1)
        Steps can be made in this cycle.
    load : In(1)
        Load in this cycle what the following four say.
    set_steps, set_dt : In(1)
        Set a limit.
    reset_steps, reset_dt : In(1)
        Clear a counter.
    steps_value, dt_value : In(32)
        Limits to load.
    step : Out(1)
        Acceleration step in this cycle. Never together with ``load``.
    aborting : Out(1)
        That step is one of an abort.
    done : Out(1)
        It is the last one of its cycle.
    abort : Out(1)
        Interrupt: a step was due after the last one, and there has been no load since.
    steps, dt : Out(32)
        Counters.
    """

    def __init__(self, *, abort_dt_latched: bool = False, paced: bool = False) -> None:
        self._latched, self._paced = abort_dt_latched, paced
        ins = ("ready", "load", "set_steps", "set_dt", "reset_steps", "reset_dt")
        outs = ("step", "aborting", "done", "abort")
        super().__init__(
            dict.fromkeys(ins, In(1))
            | {"steps_value": In(32), "dt_value": In(32)}
            | dict.fromkeys(outs, Out(1))
            | {"steps": Out(32), "dt": Out(32)}
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        steps_limit, dt_limit = Signal(32), Signal(32)
        # One more than the counters, so that nothing is added before a comparison.
        next_steps, next_dt = Signal(32, init=1), Signal(32, init=1)
        working, in_abort = Signal(), Signal()  # neither, and not `aborting`: idle
        goes = Signal()  # the limit is not 0
        hit, last = Signal(), Signal()
        limit = dt_limit if self._latched else Mux(in_abort, self.dt_value, dt_limit)
        m.d.comb += [
            hit.eq((next_dt >= limit) & (self.ready if self._paced else 1)),
            last.eq(working & (next_steps >= steps_limit)),
            self.step.eq(hit & (working & goes | self.aborting) & ~self.load),
            self.done.eq(hit & goes & last & ~self.load),
            self.abort.eq(self.aborting & (hit | in_abort) & ~self.load),
        ]
        with m.If(self.load):
            m.d.sync += [working.eq(1), self.aborting.eq(0), in_abort.eq(0)]
        with m.Elif(working & (~goes | hit & last)):
            m.d.sync += [working.eq(0), self.aborting.eq(goes)]
        with m.Elif(self.aborting & hit):
            m.d.sync += in_abort.eq(1)

        with m.If(self.load & self.set_steps):
            m.d.sync += steps_limit.eq(self.steps_value)
        with m.If(self.load & self.set_dt):
            m.d.sync += [dt_limit.eq(self.dt_value), goes.eq(self.dt_value != 0)]
        with m.If(self.load & self.reset_steps):
            m.d.sync += [self.steps.eq(0), next_steps.eq(1)]
        with m.Elif(self.step):
            m.d.sync += [self.steps.eq(next_steps), next_steps.eq(next_steps + 1)]
        m.d.sync += [self.dt.eq(next_dt), next_dt.eq(next_dt + 1)]
        with m.If(self.step | self.load & self.reset_dt):
            m.d.sync += [self.dt.eq(0), next_dt.eq(1)]
        return m


class Position(Component):
    """Position of one channel, which goes on by a speed in every cycle.

    Of the position only the fraction of a step is there, as nothing shows more.

    Members
    -------
    move : In(17), negative : In(1)
        Speed, without the bits that change whole double steps; and its sign.
    write : In(1), data : In(16)
        Write the register that a load takes the position from.
    load : In(1)
        Take the position that the register has in the next cycle.
    strobe : Out(1)
        A step of the motor, in the cycle after the speed that makes it. A load makes none.
    up : Out(1)
        Its direction, 1 = positive.
    """

    def __init__(self) -> None:
        super().__init__(
            {
                "move": In(MOVE_BITS),
                "negative": In(1),
                "write": In(1),
                "data": In(STEP_BIT),
                "load": In(1),
                "strobe": Out(1),
                "up": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        x, value, loaded = Signal(STEP_BIT), Signal(STEP_BIT), Signal()
        moved = Signal(MOVE_BITS)
        m.d.comb += moved.eq(_sum(self.move, Cat(Mux(loaded, value, x), 0)))
        with m.If(self.write):
            m.d.sync += value.eq(self.data)
        m.d.sync += [
            x.eq(moved),
            loaded.eq(self.load),
            self.strobe.eq(moved[STEP_BIT] & ~self.load),
            self.up.eq(~self.negative),
        ]
        return m


class ProfileGenerator(Component):
    """Position of one channel and its four derivatives; the board's APG.

    Members
    -------
    write : In(8)
        Write ``data`` to a value register, in the order of their numbers; X comes a cycle later
        than the others, with ``late_data``.
    data : In(32), late_data : In(16), negated : In(32)
        ``negated`` is ``data`` with the other sign.
    load : In(1), select : In(6)
        Load the values selected, as they are in this cycle (X: in the next one).
    step, aborting, done : In(1)
        From `AccelerationSteps`.
    strobe : Out(1)
        A step of the motor, two cycles after the velocity that makes it.
    up : Out(1)
        Its direction, 1 = positive.
    """

    def __init__(self) -> None:
        super().__init__(
            {
                "write": In(8),
                "data": In(32),
                "late_data": In(STEP_BIT),
                "negated": In(32),
                "load": In(1),
                "select": In(LOAD_BITS),
                "step": In(1),
                "aborting": In(1),
                "done": In(1),
                "strobe": Out(1),
                "up": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        values = {n: Signal(32, name=f"value{n}") for n in (V, A, J, JJ, TARGET_V, ABORT_A)}
        for n, value in values.items():
            with m.If(self.write[n]):
                m.d.sync += value.eq(self.data)

        loads = Signal(LOAD_BITS)
        m.d.comb += loads.eq(Mux(self.load, self.select, 0))
        self._profile(m, loads, values)
        return m

    def _profile(self, m: Module, loads: Signal, values: dict[int, Signal]) -> None:
        v, a, j, jj = (Signal(32, name=name) for name in ("v", "a", "j", "jj"))
        # In an abort the target is 0: it is cleared by the step before, and can be, as a target
        # lasts until the next load, before which no other step than those of an abort can come.
        target, has_target = Signal(32), Signal()
        limit, opposite = values[ABORT_A], Signal(32)  # and that with the other sign
        with m.If(self.write[ABORT_A]):
            m.d.sync += opposite.eq(self.negated)
        equal = Signal()
        m.d.comb += equal.eq(v == target)

        # Velocities of the next step, if nothing is special, or in an abort if v > limit. Numbers
        # with their sign flipped are those that unsigned comparisons need, and a sum with one
        # flipped operand is flipped itself, which spares a gate between the two carry chains.
        change = Mux(self.aborting, limit, a)
        flipped = _sum(_flip(v), change)[:32]
        faster = _flip(flipped)
        negative = Mux(v[31] ^ change[31], faster[31], v[31])  # v + change, that does not wrap
        slower = v.as_signed() - limit.as_signed()
        remaining = target.as_signed() - v.as_signed()
        above = remaining[32]  # v > target

        # Both comparisons are there for both directions, as the direction is known late.
        not_below = _at_least(_flip(target), flipped)
        beyond = _at_least(_flip(target), flipped, strictly=True)
        past = Mux(above, beyond, ~not_below)

        # In an abort. v = limit > 0 is taken as v > limit, which comes to the same.
        below_limit = slower[32]
        exactly_negative = limit[31] & (v == limit)
        slows = self.aborting & ~below_limit & ~equal & ~exactly_negative
        stops = self.aborting & below_limit & ~negative

        # The target, which is reached early or late in the cycle.
        seeks = has_target & ~self.aborting
        at_once, reached = Signal(), Signal()
        m.d.comb += at_once.eq((seeks | self.aborting) & equal | stops)
        m.d.comb += reached.eq(at_once | seeks & past)
        set_v, set_a, set_j, set_jj, set_target = (
            loads[n]
            for n in (
                registers.SET_V,
                registers.SET_A,
                registers.SET_J,
                registers.SET_JJ,
                registers.SET_TARGET_V,
            )
        )
        twice = Signal()  # v is the velocity of the step before, too
        before = Signal(32)  # otherwise this is
        with m.If(self.step):
            m.d.sync += [before.eq(v), twice.eq(0)]
        with m.Elif(set_v):
            m.d.sync += twice.eq(1)
        with m.If(self.step | set_v):
            special = slows | set_v
            m.d.sync += v.eq(
                Mux(
                    reached | set_v,
                    Mux(special, values[V], target),
                    Mux(special, slower[:32], faster),
                )
            )
        with m.If(self.step | set_a):
            m.d.sync += a.eq(
                Mux(
                    reached | set_a,
                    Mux(set_a, values[A], remaining[:32]),
                    Mux(self.aborting, Mux(slows, opposite, limit), a + j),
                )
            )
        with m.If(self.step | set_j):
            m.d.sync += j.eq(Mux(set_j, values[J], j + jj))
        with m.If(set_jj):
            m.d.sync += jj.eq(values[JJ])
        with m.If(self.step & (at_once | self.aborting) | self.step & seeks & past):
            m.d.sync += [j.eq(0), jj.eq(0)]
        with m.If(self.done):
            m.d.sync += target.eq(0)
        with m.Elif(set_target):
            m.d.sync += target.eq(values[TARGET_V])
        with m.If(self.load):
            m.d.sync += has_target.eq(set_target)

        # Position: half the sum of the velocities before and after the last acceleration step.
        total = v.as_signed() + Mux(twice, v, before).as_signed()
        m.submodules.position = position = Position()
        m.d.comb += [
            position.move.eq(total[1:]),
            position.negative.eq(total[32]),
            position.write.eq(self.write[X_LOW]),
            position.data.eq(self.late_data),
            position.load.eq(loads[registers.SET_X]),
            self.strobe.eq(position.strobe),
            self.up.eq(position.up),
        ]


def profile_members(channels: int) -> dict[str, In | Out]:
    """Return the ports of what makes profiles for so many channels; see `Profiles`."""
    return {
        "write": In(1),
        "address": In(6),
        "data": In(32),
        "load": In(1),
        "select": In(LOAD_BITS * channels),
        "step": In(1),
        "aborting": In(1),
        "done": In(1),
        "strobe": Out(channels),
        "up": Out(channels),
    }


class Profiles(Component):
    """Positions of all channels, each with a `ProfileGenerator`.

    Parameters
    ----------
    channels : int

    Members
    -------
    write : In(1), address : In(6), data : In(32)
        Write a register; those of channels are kept here.
    load : In(1), select : In(6 * channels)
        Load the values that are selected.
    step, aborting, done : In(1)
        From `AccelerationSteps`.
    strobe, up : Out(channels)
        Steps of the motors, and their directions.
    """

    def __init__(self, channels: int) -> None:
        self._channels = channels
        super().__init__(profile_members(channels))

    def elaborate(self, platform: object) -> Module:
        m = Module()
        late_data, late_write = Signal(STEP_BIT), Signal(self._channels)
        m.d.sync += late_data.eq(self.data)
        negated = Signal(32)
        m.d.comb += negated.eq(-self.data)
        for c in range(self._channels):
            m.submodules[f"channel{c}"] = profile = ProfileGenerator()
            here = self.write & (self.address[3:] == registers.W_X_VAL_LO[c] // VALUES)
            for n in range(VALUES):
                m.d.comb += profile.write[n].eq(here & (self.address[:3] == n))
            m.d.sync += late_write[c].eq(here & (self.address[:3] == X_LOW))
            m.d.comb += [
                profile.write[X_LOW].eq(late_write[c]),
                profile.data.eq(self.data),
                profile.late_data.eq(late_data),
                profile.negated.eq(negated),
                profile.load.eq(self.load),
                profile.select.eq(self.select[LOAD_BITS * c :]),
                profile.step.eq(self.step),
                profile.aborting.eq(self.aborting),
                profile.done.eq(self.done),
                self.strobe[c].eq(profile.strobe),
                self.up[c].eq(profile.up),
            ]
        return m


class PulseFormer(Component):
    """Step and direction pins of one channel; the board's MSG.

    A strobe at s changes ``dir`` at s + 1. ``step`` is high from s + 1 + max(pre, 1) up to
    s + 1 + pulse, not included. A strobe before s + 1 + max(1, pre, pulse, post) is lost.

    Members
    -------
    strobe, up : In(1)
        Make a step in this direction.
    pre, pulse, post : In(32)
        Time since the strobe [cycle]; used as they are in each cycle.
    step, dir : Out(1)
        Pins.
    """

    def __init__(self) -> None:
        super().__init__(
            {
                "strobe": In(1),
                "up": In(1),
                "pre": In(32),
                "pulse": In(32),
                "post": In(32),
                "step": Out(1),
                "dir": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        busy, count = Signal(), Signal(32)
        before_pre, before_end, before_post = Signal(), Signal(), Signal()
        m.d.comb += [
            before_pre.eq(count < self.pre),
            before_end.eq(count < self.pulse),
            before_post.eq(count < self.post),
        ]
        m.d.sync += self.step.eq(busy & ~before_pre & before_end)
        with m.If(busy):
            m.d.sync += count.eq(count + 1)
            with m.If(~(before_pre | before_end | before_post)):
                m.d.sync += [count.eq(0), busy.eq(0)]
        with m.Elif(self.strobe):
            m.d.sync += [count.eq(count + 1), busy.eq(1), self.dir.eq(self.up)]
        return m


# What can be carried into a sum is written as the lowest bit of a longer one. Sums are differences,
# as then the first operand alone reaches the carry chain itself, and what selects the second one
# shares a LUT with the sum.


def _sum(a: Value, b: Value) -> Value:
    """Return the sum of two numbers of as many bits; its sign if they are signed."""
    a, b = Cat(a, a[-1]), ~Cat(b, b[-1])
    return (Cat(Const(0, 1), a) - Cat(Const(1, 1), b))[1 : len(a) + 1]


def _flip(a: Value) -> Value:
    """Return a signed number less its lowest value, so that it is not negative."""
    return Cat(a[:-1], ~a[-1])


def _at_least(a: Value, b: Value, strictly: bool = False) -> Value:
    """Return whether a >= b, or with ``strictly`` a > b; unsigned numbers.

    It is the borrow of a - b: a single one, as carry chains are fast while nothing looks inside.
    """
    return ~(Cat(Const(0, 1), a) - Cat(Const(strictly, 1), b))[len(a) + 1]
