"""Moves: the sequencer, and the DDA of all motors with registers of its own for each.

Section 4.3 of the specification. Times are in ticks of the DDA clock divider.
"""

from __future__ import annotations

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib.data import ArrayLayout
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import Component, In, Out

INTEGER_BITS = 32


class TickDivider(Component):
    """A tick in every ``divider + 1`` cycles.

    Members
    -------
    divider : In(8)
        If the cycles since the last tick are more than a new value, the tick is at once.
    ready : In(1)
        Otherwise the tick waits.
    tick : Out(1)
    """

    def __init__(self) -> None:
        super().__init__({"divider": In(8), "ready": In(1), "tick": Out(1)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        count, due = Signal(8), Signal()
        m.d.comb += [due.eq(count >= self.divider), self.tick.eq(due & self.ready)]
        with m.If(self.tick):
            m.d.sync += count.eq(0)
        with m.Elif(~due):
            m.d.sync += count.eq(count + 1)
        return m


class Sequencer(Component):
    """Which move executes, and for how long.

    Parameters
    ----------
    depth : int
        Slots, a power of two.

    Members
    -------
    tick : In(1)
    halted : In(1)
        Drop all moves.
    arm : In(1)
        Slot ``write_slot`` is complete; not while ``halted``.
    empty, last : In(1)
        The executing move has no ticks, or the next one is its last.
    write_slot, slot : Out(range(depth))
        The next one to arm, and the one that executes or is next.
    load : Out(1)
        At the end of this cycle a move starts: in ``slot``, or while ``run`` the one behind.
    integrate : Out(1)
        A tick that counts.
    finish : Out(1)
        The executing move ends with this cycle.
    run : Out(1)
    used : Out(range(depth + 1))
        Slots that are armed and not finished.
    done : Out(1)
        Toggles at the end of each move.
    """

    def __init__(self, *, depth: int) -> None:
        self._depth = depth
        super().__init__(
            {
                "tick": In(1),
                "halted": In(1),
                "arm": In(1),
                "empty": In(1),
                "last": In(1),
                "write_slot": Out(range(depth)),
                "slot": Out(range(depth)),
                "load": Out(1),
                "integrate": Out(1),
                "finish": Out(1),
                "run": Out(1),
                "used": Out(range(depth + 1)),
                "done": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.comb += [
            self.integrate.eq(~self.halted & self.run & self.tick & ~self.empty),
            self.finish.eq(~self.halted & self.run & (self.empty | (self.tick & self.last))),
            self.load.eq(
                ~self.halted & Mux(self.run, self.finish & (self.used > 1), self.used != 0)
            ),
        ]
        m.d.sync += self.used.eq(self.used + self.arm - self.finish)
        with m.If(self.arm):
            m.d.sync += self.write_slot.eq(self.write_slot + 1)
        with m.If(self.finish):
            m.d.sync += [self.slot.eq(self.slot + 1), self.run.eq(0), self.done.eq(~self.done)]
        with m.If(self.load):
            m.d.sync += self.run.eq(1)
        with m.If(self.halted):
            m.d.sync += [self.run.eq(0), self.used.eq(0), self.slot.eq(self.write_slot)]
        return m


class Dda(Component):
    """Accumulators of all motors: at each tick, add an increment, which grows by another.

    An accumulator has 32 integer bits, the step position, above ``word_bits - 1`` fraction bits.

    Parameters
    ----------
    motors, depth : int
        Motors and move slots.
    word_bits : int
        Of increments.

    Members
    -------
    write : In(1), write_slot : In(range(depth)), motor : In(range(motors)), second : In(1),
    word : In(word_bits)
        Write the increment (``second`` = 0) or the increment-increment of a slot.
    load : In(1), load_slot : In(range(depth))
        Take increments from a slot.
    integrate : In(1)
    halted : In(1)
        Reduce the position by ``excess``.
    excess : In(9) signed, array
    position : Out(32), array
    """

    def __init__(self, *, motors: int, depth: int, word_bits: int) -> None:
        self._motors, self._depth, self._word_bits = motors, depth, word_bits
        super().__init__(
            {
                "write": In(1),
                "write_slot": In(range(depth)),
                "motor": In(range(motors)),
                "second": In(1),
                "word": In(word_bits),
                "load": In(1),
                "load_slot": In(range(depth)),
                "integrate": In(1),
                "halted": In(1),
                "excess": In(9).array(motors),
                "position": Out(INTEGER_BITS).array(motors),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        bits = self._word_bits
        for n in range(self._motors):
            # increment, increment-increment
            words = self._slots(m, n)
            fraction = Signal(bits - 1, name=f"fraction{n}")
            increments = [Signal(bits, name=f"{name}{n}") for name in ("inc", "incinc")]
            inc, incinc = increments
            position = self.position[n]
            accumulator = Cat(fraction, position)
            with m.If(self.halted):
                m.d.sync += position.eq(position - self.excess[n].as_signed())
            with m.Elif(self.integrate):
                m.d.sync += [
                    accumulator.eq(accumulator + inc.as_signed()),
                    inc.eq(inc + incinc),
                ]
            with m.If(self.load):
                m.d.sync += [
                    register.eq(word) for register, word in zip(increments, words, strict=True)
                ]
        return m

    def _slots(self, m: Module, motor: int) -> tuple[Value, Value]:
        """Add the words of a motor in all slots; return those of ``load_slot``."""
        bits = self._word_bits
        memory = Memory(shape=ArrayLayout(bits, 2), depth=self._depth, init=[])
        m.submodules[f"slots{motor}"] = memory
        written, read = memory.write_port(granularity=1), memory.read_port(domain="comb")
        m.d.comb += [
            written.addr.eq(self.write_slot),
            written.data[0].eq(self.word),
            written.data[1].eq(self.word),
            written.en.eq(
                (self.write & (self.motor == motor)).replicate(2) & Cat(~self.second, self.second)
            ),
            read.addr.eq(self.load_slot),
        ]
        return read.data[0], read.data[1]
