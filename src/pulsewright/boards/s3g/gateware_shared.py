"""Profiles of all channels by one adder, for builds with little logic.

Velocities change at acceleration steps and loads only, many cycles apart. So what an acceleration
step will bring is worked out ahead, channel after channel, and all that happens in the cycle of the
step is that every channel takes its new speed. In memory there are two sets of velocities and their
derivatives: the present ones, and those after the next acceleration step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import Component, In, Out

from pulsewright.boards.s3g import registers
from pulsewright.boards.s3g.gateware_motion import (
    ABORT_A,
    JJ,
    LOAD_BITS,
    MOVE_BITS,
    STEP_BIT,
    TARGET_V,
    VALUES,
    X_LOW,
    A,
    J,
    Position,
    V,
    profile_members,
)

# Values that a load takes, and what selects them.
_LOADED: Final = {
    V: registers.SET_V,
    A: registers.SET_A,
    J: registers.SET_J,
    JJ: registers.SET_JJ,
    TARGET_V: registers.SET_TARGET_V,
}
_PRESENT: Final = False
_NEXT: Final = True
LOAD_CYCLES: Final = 7
STEP_CYCLES: Final = 15
_BANK_WORDS: Final = 64  # channel and variable, 3 bits each


@dataclass(frozen=True)
class _Cycle:
    """What happens in one cycle of the calculation for a channel.

    Parameters
    ----------
    read : (int, bool) or None
        Variable to read, of the present or the next set; it is there in the next cycle.
    keep : int or None
        What goes to the first operand: 1 what was read, 0 nothing.
    add : (str, int) or None
        The result is the first operand and what was read ("state") or a value register ("value"),
        times 1 or -1; with "zero" it is 0.
    write : (int, str) or None
        Variable of the next set that takes the result so far, and when: "always", "down", "not
        down", "reached" or "not reached".
    """

    read: tuple[int, bool] | None = None
    keep: int | None = None
    add: tuple[str, int] | None = None
    write: tuple[int, str] | None = None


# The steps of section 4.5. Results: 2 v + a, 4 target - v, 5 target - (v + a), 7 a + j, 8 j + jj.
_WORKING: Final = (
    _Cycle((A, _PRESENT)),
    _Cycle((V, _PRESENT), keep=1),
    _Cycle((TARGET_V, _PRESENT), add=("state", 1)),
    _Cycle((V, _PRESENT), keep=1, write=(V, "always")),
    _Cycle((V, _NEXT), add=("state", -1)),
    _Cycle((A, _PRESENT), add=("state", -1), write=(A, "always")),
    _Cycle((J, _PRESENT), keep=1),
    _Cycle((JJ, _PRESENT), keep=1, add=("state", 1)),
    _Cycle((JJ, _PRESENT), keep=0, add=("state", 1), write=(A, "not reached")),
    _Cycle((TARGET_V, _PRESENT), add=("state", 1), write=(J, "always")),
    _Cycle((V, _PRESENT), add=("state", 1), write=(JJ, "always")),
    _Cycle(keep=1, write=(V, "reached")),
    _Cycle((V, _NEXT)),
    _Cycle(add=("state", 1)),
    _Cycle(),
)
# Those of section 4.6, with the limit q. Results: 2 v - q, 3 v + q, 5 -q, 6 q, 7 -v.
_ABORTING: Final = (
    _Cycle((V, _PRESENT)),
    _Cycle(keep=1),
    _Cycle(add=("value", -1)),
    _Cycle(add=("value", 1), write=(V, "always")),
    _Cycle(keep=0, write=(V, "not down")),
    _Cycle(add=("value", -1)),
    _Cycle((V, _PRESENT), add=("value", 1), write=(A, "always")),
    _Cycle(add=("state", -1), write=(A, "not down")),
    _Cycle(add=("zero", 1), write=(A, "reached")),
    _Cycle(add=("zero", 1), write=(J, "always")),
    _Cycle((V, _PRESENT), add=("zero", 1), write=(JJ, "always")),
    *_WORKING[11:],
)


class SharedProfiles(Component):
    """Positions of all channels, in the place of `Profiles` and with the same ports.

    A load keeps it busy for 22 cycles per channel, the first 7 of which it takes no other load. An
    acceleration step, or a write of an abort deceleration in an abort, keeps it busy for 15 cycles
    per channel. All is as with `Profiles` if nothing comes while it cannot be taken. ``clear`` is
    to be there while the rest is in reset, with every ``clear_address`` in turn.

    Parameters
    ----------
    channels : int

    Members
    -------
    clear : In(1), clear_address : In(7)
        Clear a word of both memories.
    ready : Out(1)
        An acceleration step can be made in this cycle.
    free : Out(1)
        A load can be made in this cycle.
    write, address, data, load, select, step, aborting, done, strobe, up
        See `Profiles`.
    """

    def __init__(self, channels: int) -> None:
        self._channels = channels
        super().__init__(
            profile_members(channels)
            | {"clear": In(1), "clear_address": In(7), "ready": Out(1), "free": Out(1)}
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        self._cycle, self._channel = Signal(range(STEP_CYCLES)), Signal(3)
        self._busy, self._loading = Signal(), Signal()
        self._bank = Signal()  # of the present set
        self._result = Signal(33)
        self._sequence(m)
        value = self._values(m)
        self._calculate(m, value)
        self._positions(m)
        return m

    def _sequence(self, m: Module) -> None:
        """Go through the cycles of all channels, from the first on after each event."""
        cycle, channel, busy, loading = self._cycle, self._channel, self._busy, self._loading
        m.d.comb += [self.ready.eq(~busy), self.free.eq(~loading)]
        with m.If(busy):
            m.d.sync += cycle.eq(cycle + 1)
            with m.If(cycle == Mux(loading, LOAD_CYCLES - 1, STEP_CYCLES - 1)):
                m.d.sync += [cycle.eq(0), channel.eq(channel + 1)]
                with m.If(channel == self._channels - 1):
                    m.d.sync += [channel.eq(0), loading.eq(0), busy.eq(loading)]
        new_limit = self.write & (self.address[:3] == ABORT_A) & self.aborting
        with m.If(self.step | new_limit | self.load):
            m.d.sync += [busy.eq(1), cycle.eq(0), channel.eq(0), loading.eq(self.load)]
        with m.If(self.step):
            m.d.sync += self._bank.eq(~self._bank)

    def _values(self, m: Module) -> Value:
        """Add value registers; return the one that is asked for, a cycle later.

        Each of them is in two places. A write goes to the place that the last load does not use, so
        that registers can be written again while it is still being carried out.
        """
        m.submodules.values = memory = Memory(
            shape=32, depth=2 * _BANK_WORDS, init=[], attrs={"ram_style": "block"}
        )
        written, read = memory.write_port(), memory.read_port()
        count = len(_LOADED)
        channels = range(self._channels)
        newest = [Signal(count, name=f"newest{c}") for c in channels]
        used = [Signal(count, name=f"used{c}") for c in channels]
        selected = [Signal(count, name=f"selected{c}") for c in channels]
        place, wanted = Signal(), Signal()
        number = Signal(3, init=ABORT_A)  # of the register that is asked for
        for c in channels:
            for n, register in enumerate(_LOADED):
                with m.If(self.address == registers.W_X_VAL_LO[c] + register):
                    m.d.comb += place.eq(~Mux(self.load, newest[c][n], used[c][n]))
                    with m.If(self.write):
                        m.d.sync += newest[c][n].eq(place)
            with m.If(self.load):
                m.d.sync += used[c].eq(newest[c])
                bits = self.select[LOAD_BITS * c :][:LOAD_BITS]
                m.d.sync += selected[c].eq(Cat(bits[bit] for bit in _LOADED.values()))
        here, self._selected = Signal(count), Signal(count)
        with m.Switch(self._channel):
            for c in channels:
                with m.Case(c):
                    m.d.comb += [here.eq(used[c]), self._selected.eq(selected[c])]
        m.d.comb += number.eq(ABORT_A)
        with m.If(self._loading), m.Switch(self._cycle):
            for n, register in enumerate(_LOADED):
                with m.Case(n):
                    m.d.comb += [number.eq(register), wanted.eq(here[n])]
        first = registers.W_X_VAL_LO[0] // VALUES
        m.d.comb += [
            written.en.eq(self.write | self.clear),
            written.addr.eq(Mux(self.clear, self.clear_address, Cat(self.address, place))),
            written.data.eq(self.data),
            read.addr.eq(Cat(number, (self._channel + first)[:3], wanted)),
        ]
        return read.data

    def _calculate(self, m: Module, value: Value) -> None:
        """Add the adder and the memory of velocities and their derivatives."""
        m.submodules.state = memory = Memory(
            shape=32, depth=2 * _BANK_WORDS, init=[], attrs={"ram_style": "block"}
        )
        written, read = memory.write_port(), memory.read_port()
        has_target = Signal(self._channels)
        for c in range(self._channels):
            with m.If(self.load):
                m.d.sync += has_target[c].eq(self.select[LOAD_BITS * c + registers.SET_TARGET_V])

        first = Signal(32)
        result = self._result
        use_value, negate, clear = Signal(), Signal(), Signal()
        variable, next_set = Signal(3), Signal()
        target, write, into_next = Signal(3), Signal(), Signal()
        keep, drop = Signal(), Signal()

        operand = Mux(use_value, value, read.data) ^ negate.replicate(32)
        total = Cat(negate, first, first[31]) - ~Cat(negate, operand, operand[31])
        zero = result[:32] == 0
        # After 4: target - v. After 5: target - (v + a). In an abort, after 2: v - q, after 3:
        # v + q, after 7: -v.
        was_negative, was_zero, down = Signal(), Signal(), Signal()
        reached = Signal()
        crossed = ~zero & (was_negative ^ result[32])
        mine = Signal()
        with m.Switch(self._channel):
            for c in range(self._channels):
                with m.Case(c):
                    m.d.comb += mine.eq(has_target[c])
        stops = zero | ~down & ~was_negative
        with m.If(self.aborting):
            with m.If(self._cycle == 3):
                m.d.sync += down.eq(~result[32] & ~zero)
            with m.If(self._cycle == 4):
                m.d.sync += was_negative.eq(result[32])
            with m.If(self._cycle == 8):
                m.d.sync += reached.eq(stops)
        with m.Else():
            with m.If(self._cycle == 5):
                m.d.sync += [was_negative.eq(result[32]), was_zero.eq(zero)]
            with m.If(self._cycle == 6):
                m.d.sync += reached.eq(mine & (was_zero | crossed))

        conditions = {
            "always": 1,
            "down": down,
            "not down": ~down,
            "reached": Mux(self._cycle == 8, stops, reached),
            "not reached": ~reached,
        }
        m.d.comb += into_next.eq(~self._loading)
        with m.If(self._loading):
            m.d.comb += [use_value.eq(1), drop.eq(1)]
            with m.Switch(self._cycle):
                for n, register in enumerate(_LOADED):
                    with m.Case(n + 2):
                        m.d.comb += [target.eq(register), write.eq(self._selected[n])]
        with m.Else(), m.Switch(Cat(self._cycle, self.aborting)):
            for mode, program in enumerate((_WORKING, _ABORTING)):
                for n, action in enumerate(program):
                    with m.Case(n | mode << len(self._cycle)):
                        if action.read:
                            m.d.comb += [
                                variable.eq(action.read[0]),
                                next_set.eq(action.read[1]),
                            ]
                        if action.keep is not None:
                            m.d.comb += (keep if action.keep else drop).eq(1)
                        if action.add:
                            source, sign = action.add
                            m.d.comb += [
                                use_value.eq(source == "value"),
                                negate.eq(sign < 0),
                                clear.eq(source == "zero"),
                            ]
                        if action.write:
                            m.d.comb += [
                                target.eq(action.write[0]),
                                write.eq(conditions[action.write[1]]),
                            ]
        with m.If(drop):
            m.d.sync += first.eq(0)
        with m.Elif(keep):
            m.d.sync += first.eq(read.data)
        m.d.sync += result.eq(total[1:34])
        with m.If(clear | reached & (self._cycle[1:] == 4) & ~self._loading):
            m.d.sync += result.eq(0)

        def at(which: Value, is_next: Value) -> Value:
            # The target is the same in both sets.
            return Cat(which, self._channel, (self._bank ^ is_next) & (which != TARGET_V))

        m.d.comb += [
            written.en.eq(self._busy & write | self.clear),
            written.addr.eq(Mux(self.clear, self.clear_address, at(target, into_next))),
            written.data.eq(result[:32]),
            read.addr.eq(at(variable, next_set)),
        ]

    def _positions(self, m: Module) -> None:
        """Add what each channel has for itself: its position, and its speeds now and next."""
        late_data, late_write = Signal(STEP_BIT), Signal(self._channels)
        m.d.sync += late_data.eq(self.data)
        ends = self._busy & ~self._loading & (self._cycle == STEP_CYCLES - 1)
        for c in range(self._channels):
            m.submodules[f"position{c}"] = position = Position()
            # Twice the mean speed of an acceleration step, of which this is a half, and the sign.
            now, after, value = (Signal(MOVE_BITS + 1) for _ in range(3))
            base = registers.W_X_VAL_LO[c]
            with m.If(self.write & (self.address == base + V)):
                m.d.sync += value.eq(Cat(self.data[:MOVE_BITS], self.data[31]))
            m.d.sync += late_write[c].eq(self.write & (self.address == base + X_LOW))
            with m.If(ends & (self._channel == c)):
                m.d.sync += after.eq(Cat(self._result[1 : MOVE_BITS + 1], self._result[32]))
            bits = self.select[LOAD_BITS * c :][:LOAD_BITS]
            with m.If(self.step | self.load & bits[registers.SET_V]):
                m.d.sync += now.eq(Mux(self.load, value, after))
            m.d.comb += [
                position.move.eq(now[:MOVE_BITS]),
                position.negative.eq(now[MOVE_BITS]),
                position.write.eq(late_write[c]),
                position.data.eq(late_data),
                position.load.eq(self.load & bits[registers.SET_X]),
                self.strobe[c].eq(position.strobe),
                self.up[c].eq(position.up),
            ]
