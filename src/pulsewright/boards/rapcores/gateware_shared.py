"""The DDA of all motors with one adder, 16 bits wide, and everything wide in block RAM.

What the next tick makes of an accumulator is worked out ahead. In memory there are two sets of
accumulators and increments, the present ones and those after the next tick, and in the cycle of the
tick the sets change places. With the tick in which a move ends, or while none executes, the next
tick is the first of the next slot, so its increments are taken from there.

The ticks of a move are counted down as one more increment, the first one, which grows by -1.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib.memory import Memory, ReadPort, WritePort
from amaranth.lib.wiring import Component, In, Out

SLICE_BITS: Final = 16
DURATION: Final = 0  # entry; that of motor n is n + 1
DURATION_SLICES: Final = 2
# Of memories; no word is used that is read in the cycle in which it is written.
BLOCK_RAM: Final = {"ram_style": "block", "no_rw_check": 1}
LATENCY: Final = 4  # cycles from a slice's addresses until its result is in memory


def cycles(motors: int, word_bits: int) -> int:
    """Return how many cycles after a tick the next one can be."""
    return (motors + 1) * (word_bits // SLICE_BITS) + LATENCY


class SharedDda(Component):
    """Fractions of accumulators, and ticks of moves, for all motors.

    Parameters
    ----------
    motors, depth : int
        Motors and move slots, the latter a power of two.
    word_bits : int
        Of increments.

    Members
    -------
    write : In(1), write_slot : In(range(depth)), number : In(range(2 * motors + 2)),
    index : In(range(word_bits // 8)), byte : In(8)
        Write a byte of a word of the move message into a slot.
    slot : In(range(depth))
        Of the move that executes, or is next.
    first : In(1)
        Its first tick is the next one.
    restart : In(1)
        Something of that has changed, or words of ``slot`` have.
    integrate : In(1)
        The tick; only while ``ready``.
    ready : Out(1)
        The next tick is worked out.
    last : Out(1)
        With ``ready``: it is the last of its move.
    moved, down : Out(motors)
        With ``ready``: the next tick changes the step position of a motor, downwards.
    """

    def __init__(self, *, motors: int, depth: int, word_bits: int) -> None:
        self._motors, self._depth = motors, depth
        self._slices = word_bits // SLICE_BITS
        super().__init__(
            {
                "write": In(1),
                "write_slot": In(range(depth)),
                "number": In(range(2 * motors + 2)),
                "index": In(range(word_bits // 8)),
                "byte": In(8),
                "slot": In(range(depth)),
                "first": In(1),
                "restart": In(1),
                "integrate": In(1),
                "ready": Out(1),
                "last": Out(1),
                "moved": Out(motors),
                "down": Out(motors),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        entries, slices = self._motors + 1, self._slices
        bank = Signal()  # of the present set
        with m.If(self.integrate):
            m.d.sync += bank.eq(~bank)

        # Slices of all entries, from the lowest one on: their addresses, a cycle later slices of
        # increments, then the sums of these, and at last those of the accumulators.
        piece, entry = Signal(range(slices)), Signal(range(entries))
        busy = Signal()
        working = Signal(4)  # stages
        places = [
            Signal(len(piece) + len(entry), name=f"place{n}", reset_less=n > 0) for n in range(4)
        ]
        m.d.comb += [places[0].eq(Cat(piece, entry)), working[0].eq(busy)]
        end = (piece == slices - 1) & (entry == entries - 1)
        with m.If(busy):
            m.d.sync += piece.eq(piece + 1)
            with m.If(piece == slices - 1):
                m.d.sync += entry.eq(entry + 1)
            with m.If(end):
                m.d.sync += busy.eq(0)
        m.d.sync += [later.eq(place) for place, later in pairwise(places)]
        restart = self.integrate | self.restart
        m.d.sync += Cat(working[1:]).eq(Mux(restart, 0, working))
        m.d.sync += self.ready.eq(~restart & ~working[:3].any())
        with m.If(restart):
            m.d.sync += [busy.eq(1), piece.eq(0), entry.eq(DURATION)]
        bottom = [place[: len(piece)] == 0 for place in places]
        top = [place[: len(piece)] == slices - 1 for place in places]

        # Block RAM takes most of a cycle to give a word, so that sums begin with registers.
        given = self._slots(m, Cat(places[0], self.slot, ~self.first))
        increment, growth, added, fraction = (
            Signal(SLICE_BITS, name=name, reset_less=True)
            for name in ("increment", "growth", "added", "fraction")
        )
        total, carry = Signal(SLICE_BITS + 1), Signal()
        written, read = self._memory(m, "increments", len(places[0]))
        m.d.comb += [
            read.addr.eq(Cat(places[0], bank)),
            total.eq(add(increment, growth, carry & ~bottom[2])),
            written.addr.eq(Cat(places[3], ~bank)),
            written.data.eq(added),
            written.en.eq(working[3]),
        ]
        m.d.sync += [
            *(increment.eq(read.data), growth.eq(given)),
            carry.eq(total[-1]),
            added.eq(total),
        ]
        with m.If(self.first):
            m.d.sync += increment.eq(0)

        result, overflow = Signal(SLICE_BITS + 1), Signal()
        unused = Signal(init=1)  # since the reset: accumulators are 0, whatever is in memory
        with m.If(self.integrate):
            m.d.sync += unused.eq(0)
        written, read = self._memory(m, "accumulators", len(places[0]))
        m.d.comb += [
            read.addr.eq(Cat(places[1], bank)),
            # the highest one has a bit less
            result.eq(add(fraction, Cat(added[:-1], added[-1] & ~top[3]), overflow & ~bottom[3])),
            written.addr.eq(Cat(places[3], ~bank)),
            written.data.eq(Cat(result[:-2], result[-2] & ~top[3])),
            written.en.eq(working[3]),
        ]
        m.d.sync += [fraction.eq(read.data), overflow.eq(result[-1])]
        with m.If(unused):
            m.d.sync += fraction.eq(0)

        here = places[3][len(piece) :]
        with m.If(working[3] & top[3]), m.Switch(here):
            for n in range(self._motors):
                with m.Case(n + 1):
                    m.d.sync += [
                        self.moved[n].eq(result[-2] ^ added[-1]),
                        self.down[n].eq(added[-1]),
                    ]
        with m.If(working[3] & (here == DURATION)):
            with m.If(bottom[3]):
                m.d.sync += self.last.eq(added == 1)
            with m.Elif(places[3][: len(piece)] < DURATION_SLICES):
                m.d.sync += self.last.eq(self.last & (added == 0))
        return m

    def _slots(self, m: Module, place: Value) -> Value:
        """Add move slots: what an entry has first, and then what is added to it; return a slice."""
        half = 1 << len(place) - 1
        entry = half // self._depth
        grows = [0xFFFF if n < self._slices else 0 for n in range(entry)] * self._depth
        m.submodules.slots = memory = Memory(
            shape=SLICE_BITS, depth=2 * half, init=[0] * half + grows, attrs=BLOCK_RAM
        )
        written, read = memory.write_port(granularity=8), memory.read_port()
        second = self.number[0] & (self.number != 1)
        m.d.comb += [
            written.addr.eq(Cat(self.index[1:], self.number[1:], self.write_slot, second)),
            written.data.eq(self.byte.replicate(2)),
            written.en.eq(self.write.replicate(2) & Cat(~self.index[0], self.index[0])),
            read.addr.eq(place),
        ]
        return read.data

    def _memory(self, m: Module, name: str, place_bits: int) -> tuple[WritePort, ReadPort]:
        """Add two sets of slices of all entries; return the ports."""
        m.submodules[name] = memory = Memory(
            shape=SLICE_BITS, depth=2 << place_bits, init=[], attrs=BLOCK_RAM
        )
        return memory.write_port(), memory.read_port()


def add(a: Value, b: Value, carry: Value) -> Signal:
    """Return the sum of two numbers and a bit, one bit longer."""
    return (Cat(1, a) + Cat(carry, b))[1:]
