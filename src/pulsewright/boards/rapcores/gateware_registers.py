"""Registers that count, in block RAM: encoders, step positions and events, with one adder.

What changes a register is kept beside it, a few bits wide, until its turn comes: a scan goes round
all of them. A read takes its register out of turn, so that it gives what the register is in the
cycle of the read.

An encoder has three numbers: its position, its velocity, and the time since its last count, as it
was at its last turn, less 1. In memory a velocity of a falling position is the complement of what
it is. Its turn writes the velocity if there was a count, and otherwise the time. It comes twice, so
that the time follows a velocity.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import Component, In, Out

from pulsewright.boards.rapcores.gateware_shared import BLOCK_RAM, add

WORD_BITS: Final = 32
LOW_BITS: Final = 8
INDEX_BITS: Final = 6
ADDRESS_BITS: Final = 9
OWED_BITS: Final = 9


class Block(IntEnum):
    """Upper bits of an address in the memory."""

    SINCE = 0
    VELOCITY = 1
    POSITION = 2
    COUNTS = 3  # step positions from 0 on, event counters, registers that the host writes
    FIXED = 4  # constants
    DURATION = 5  # ticks of the moves in slots
    COPY = 6  # position and velocity of encoders; another one in the block behind


@dataclass(frozen=True)
class Event:
    """What is counted.

    Parameters
    ----------
    place : int
        Of the counter in block `Block.COUNTS`: from 0x20 on.
    spacing : int
        Cycles that are at least from one to the next...
    burst : int
        ... but for so many.
    """

    place: int
    spacing: int
    burst: int = 1


def memory_address(block: Block, index: int) -> int:
    """Return where a register is."""
    return block << INDEX_BITS | index


# Words that are 0, and -1.
ZERO: Final = memory_address(Block.FIXED, 2)
MINUS_ONE: Final = memory_address(Block.FIXED, 3)


class CountingRegisters(Component):
    """Registers of encoders, motors and events, and others that the host reads or writes.

    Parameters
    ----------
    encoders, motors : int
    copied : int
        Encoders that a copy takes, not more than there are.
    events : sequence of Event
        Event counters, in places that follow each other. The place before them is that of ticks
        that are left.
    depth : int
        Move slots: not more moves than that start less than ``tick_cycles`` apart.
    tick_cycles : int
        From one tick to the next, at least.
    contents : mapping of int to int
        Constants in block `Block.FIXED`, by address.
    defaults : mapping of int to int
        What registers in other blocks are after a reset, by address, if not 0; below 256.

    Members
    -------
    clear : In(1), clear_address : In(8)
        Clear registers while the rest is in reset, one per cycle.
    count, up : In(encoders)
        Of each encoder.
    moved, down : In(motors)
        Step positions change.
    take : In(motors), owed : In(9).array(motors)
        To be taken off a step position, signed.
    taken : Out(motors)
        It is, at the end of this cycle.
    event : In(len(events)), zero : In(1)
        Count events; set all counters to 0, or to 1 with an event.
    tick : In(1)
        One tick less is left.
    restart : In(1), run : In(1), slot : In(range(depth))
        After a cycle with ``restart`` ticks left are those of ``slot`` in block `Block.DURATION`,
        or 0 unless ``run``.
    block : In(1)
        A read comes within two cycles, or now.
    choose : In(1), read : In(1), read_address : In(9)
        Read a register, with ``block``; ``choose`` and the address are there a cycle before, too.
    low : Out(8), low_inverted : Out(1)
        In the cycle after ``read``: the lowest byte of its register. If ``low_inverted``, the
        complement is meant.
    value : Out(32), inverted : Out(1)
        A cycle later: all of it.
    added : In(32)
        In the cycle after ``read`` or ``write``: bits of the register besides those in memory,
        which are 0 there. At other times 0.
    write : In(1), write_address : In(9)
        Write what ``added`` is in the next cycle to a register; with ``block``, without ``read``.
    capture : In(1), copy : In(1), copy_bank : In(1)
        Remember what encoders are in this cycle. Copy, from the next cycle on, position and
        velocity as they were then, into one of two blocks.
    copying : Out(1)
        Not all is copied.
    """

    def __init__(
        self,
        *,
        encoders: int,
        motors: int,
        copied: int,
        events: Sequence[Event],
        depth: int,
        tick_cycles: int,
        contents: dict[int, int],
        defaults: dict[int, int],
    ) -> None:
        self._encoders, self._motors, self._copied = encoders, motors, copied
        self._events, self._contents, self._defaults = events, contents, defaults
        self._depth, self._tick_cycles = depth, tick_cycles
        super().__init__(
            {
                "clear": In(1),
                "clear_address": In(8),
                "count": In(encoders),
                "up": In(encoders),
                "moved": In(motors),
                "down": In(motors),
                "take": In(motors),
                "owed": In(OWED_BITS).array(motors),
                "taken": Out(motors),
                "event": In(len(events)),
                "zero": In(1),
                "tick": In(1),
                "restart": In(1),
                "run": In(1),
                "slot": In(range(depth)),
                "block": In(1),
                "choose": In(1),
                "read": In(1),
                "read_address": In(ADDRESS_BITS),
                "low": Out(LOW_BITS),
                "low_inverted": Out(1),
                "value": Out(WORD_BITS),
                "inverted": Out(1),
                "write": In(1),
                "write_address": In(ADDRESS_BITS),
                "added": In(WORD_BITS),
                "capture": In(1),
                "copy": In(1),
                "copying": Out(1),
                "copy_bank": In(1),
            }
        )

    def _round(self) -> int:
        """Return the cycles from one turn of a register to the next, at most.

        Those of a time are from the first one to the second one of the next round.
        """
        turns = 3 * self._encoders + self._motors + 2 + len(self._events)
        copy = 2 * self._copied + 3
        cycles, before = turns, 0
        while cycles != before:
            before = cycles
            copies = min(self._depth + 1, cycles // self._tick_cycles + 2)
            # four cycles of each word of a message are free for a read and a write
            reads = 4 * (cycles // 64 + 1)
            cycles = turns + self._depth + copy * copies + reads
        return cycles

    def elaborate(self, platform: object) -> Module:
        m = Module()
        self._cycles = self._round()
        self._time_bits = self._cycles.bit_length()
        step_bits = (self._cycles // self._tick_cycles + 1).bit_length() + 1
        self._step_bits = step_bits
        self._delta_bits = max(self._time_bits + 1, OWED_BITS + 1, step_bits)
        free, copies, turn = Signal(), Signal(), Signal()
        start, chosen = Signal(), Signal()  # chosen: a copy
        m.d.comb += [
            free.eq(~self.block & ~self.clear),
            turn.eq(free & ~self.copying & ~chosen),
            start.eq(turn | (free & chosen & copies)),
        ]

        # Whose turn it is: that of the read, of a copy, or the next one of the scan. Decided a
        # cycle before, as it takes long to find what has changed.
        first = Block.POSITION if self._encoders else Block.COUNTS
        block, index = Signal(3, init=first.value), Signal(INDEX_BITS)
        second = Signal()
        scan_block, scan_index = self._scan(m, turn, second, first)
        copy_velocity, copy_index = self._copy_scan(m, free & chosen, copies)
        m.d.sync += chosen.eq(self.copying & ~self.choose)
        with m.If(self.choose):
            m.d.sync += Cat(index, block).eq(self.read_address)
        with m.Elif(self.copying):
            m.d.sync += [
                block.eq(Mux(copy_velocity, Block.VELOCITY, Block.POSITION)),
                index.eq(copy_index),
            ]
        with m.Else():
            m.d.sync += [block.eq(scan_block), index.eq(scan_index)]
        velocity, own = Signal(), Signal()
        m.d.comb += [velocity.eq(block == Block.VELOCITY), own.eq(~chosen & ~self.read)]

        # What had its turn in the cycle of a capture has not changed since.
        turned, last_block, last_index = Signal(), Signal(), Signal(range(max(self._encoders, 1)))
        unchanged = turned & (block[0] == last_block) & (index == last_index)
        changes = self._changes(m, turn, second, ~chosen, chosen & ~unchanged, block, index)
        delta, counted, often, time, falling = changes
        idle = second & ~chosen & velocity & ~often
        with m.If(self.capture):
            m.d.sync += [
                turned.eq(turn & (block[0] ^ block[1]) & ~idle),
                *(last_block.eq(block[0]), last_index.eq(index)),
            ]

        m.submodules.memory = memory = Memory(
            shape=WORD_BITS + 1,
            depth=1 << ADDRESS_BITS,
            init=[
                {MINUS_ONE: (1 << WORD_BITS) - 1, **self._contents}.get(n, 0)
                for n in range(1 << ADDRESS_BITS)
            ],
            attrs=BLOCK_RAM,
        )
        written, read = memory.write_port(), memory.read_port()

        # First cycle: the word that is changed, and by how much.
        enabled, target = Signal(2, reset_less=True), Signal(ADDRESS_BITS, reset_less=True)
        clearing = Signal(reset_less=True)
        kept_delta = Signal(self._delta_bits, reset_less=True)
        kept_time = Signal(self._time_bits, reset_less=True)
        up, down = Signal(reset_less=True), Signal(reset_less=True)
        m.d.comb += read.addr.eq(Cat(index, block))
        m.d.sync += [
            clearing.eq(self.clear),
            enabled.eq(Cat((start & ~idle) | self.write | self.clear, enabled)),
            target.eq(Cat(index, block)),
            *(kept_delta.eq(delta), kept_time.eq(time)),
            up.eq(velocity & counted & ~falling & ~self.write),
            down.eq(velocity & counted & falling & ~self.write),
        ]
        with m.If(self.write | ~block[1] | block[2]):
            m.d.sync += kept_delta.eq(0)
        with m.If(self.write | ~velocity | ~(own | counted)):
            m.d.sync += kept_time.eq(0)
        with m.If(velocity):
            with m.If(own | counted):
                m.d.comb += read.addr.eq(Mux(often, MINUS_ONE, index))
            m.d.sync += target.eq(Cat(index, Mux(counted, Block.VELOCITY, Block.SINCE)))
        with m.Elif((block == Block.COUNTS) & often):
            duration = self.run & (index == self._events[0].place - 1)
            m.d.comb += read.addr.eq(Mux(duration, _place(Block.DURATION, self.slot), ZERO))
        with m.If(chosen):
            m.d.sync += target.eq(copied_address(block[0], index, self.copy_bank))
        with m.If(self.clear):
            m.d.comb += read.addr.eq(ZERO)
            m.d.sync += target.eq(self.clear_address)
        with m.Elif(self.write):
            m.d.comb += read.addr.eq(ZERO)
            m.d.sync += target.eq(self.write_address)

        # Second cycle: block RAM takes most of it to give the word, so only a byte is added.
        operand, default = Signal(self._delta_bits), Signal(LOW_BITS)
        change, low = Signal(LOW_BITS), Signal(LOW_BITS + 1)
        m.d.comb += [
            operand.eq(kept_delta | kept_time),
            change.eq(operand | self.added | default),
            low.eq(add(read.data[:LOW_BITS], change, up)),
            self.low.eq(low),
            self.low_inverted.eq(read.data[WORD_BITS] | down),
        ]
        with m.If(clearing), m.Switch(target):
            for address, value in self._defaults.items():
                with m.Case(address):
                    m.d.comb += default.eq(value)

        # Third cycle: the rest, and the register is written.
        lowest, carry = Signal(LOW_BITS, reset_less=True), Signal(reset_less=True)
        upper = Signal(WORD_BITS - LOW_BITS, reset_less=True)
        rest = Signal(self._delta_bits - LOW_BITS, reset_less=True)
        inverted, place = Signal(reset_less=True), Signal(ADDRESS_BITS, reset_less=True)
        m.d.sync += [
            *(lowest.eq(low), carry.eq(low[-1]), rest.eq(operand[LOW_BITS:])),
            upper.eq(read.data[LOW_BITS:WORD_BITS] | self.added[LOW_BITS:]),
            *(inverted.eq(self.low_inverted), place.eq(target)),
        ]
        m.d.comb += [
            self.value.eq(Cat(lowest, add(upper, _extended(rest.as_signed(), len(upper)), carry))),
            self.inverted.eq(inverted),
            *(written.addr.eq(place), written.en.eq(enabled[1])),
            written.data.eq(Cat(self.value, self.inverted)),
        ]
        return m

    def _scan(self, m: Module, turn: Value, second: Signal, first: Block) -> tuple[Signal, Signal]:
        """Add the scan; return whose turn is next, in the next cycle."""
        block, index = Signal(2, init=first.value), Signal(INDEX_BITS)
        next_block, next_index = Signal.like(block), Signal.like(index)
        m.d.comb += [next_block.eq(block), next_index.eq(index)]
        m.d.sync += [block.eq(next_block), index.eq(next_index)]
        ends = (
            (Block.POSITION, self._encoders - 1, Block.VELOCITY, 0),
            (Block.VELOCITY, self._encoders - 1, Block.COUNTS, 0),
            (Block.COUNTS, self._motors - 1, Block.COUNTS, self._events[0].place - 1),
            (Block.COUNTS, self._events[-1].place, first, 0),
        )
        with m.If(turn):
            m.d.sync += second.eq((block == Block.VELOCITY) & ~second)
            with m.If((block != Block.VELOCITY) | second):
                m.d.comb += next_index.eq(index + 1)
                for now, last, then, at in ends:
                    with m.If((block == now) & (index == last)):
                        m.d.comb += [next_block.eq(then), next_index.eq(at)]
        return next_block, next_index

    def _copy_scan(self, m: Module, free: Value, copies: Signal) -> tuple[Signal, Signal]:
        """Add the scan of a copy; return what is next. ``copies``: the turn of a copy may be."""
        time, index = Signal(), Signal(max(self._copied - 1, 0).bit_length())
        next_time, next_index = Signal.like(time), Signal.like(index)
        if not self._copied:
            return time, index
        # In the first two cycles the result of a turn before may not be in memory.
        wait = Signal(2)
        m.d.sync += wait.eq(Cat(self.copy, wait))
        m.d.comb += [
            copies.eq(self.copying & (wait == 0)),
            next_time.eq(time),
            next_index.eq(index),
        ]
        m.d.sync += [time.eq(next_time), index.eq(next_index)]
        with m.If(free & copies):
            m.d.comb += next_index.eq(index + 1)
            with m.If(index == self._copied - 1):
                m.d.comb += [next_index.eq(0), next_time.eq(1)]
                m.d.sync += self.copying.eq(~time)
        with m.If(self.copy):
            m.d.sync += self.copying.eq(1)
        with m.If(wait[0]):
            m.d.comb += [next_index.eq(0), next_time.eq(0)]
        return next_time, next_index

    def _changes(
        self,
        m: Module,
        turn: Value,
        second: Value,
        live: Value,
        captured: Value,
        block: Value,
        index: Value,
    ) -> tuple[Signal, ...]:
        """Add what has changed since the last turns.

        Returns
        -------
        delta, counted, often, time, falling
            Of the one with an index: now if ``live``, or, if ``captured``, of an encoder at the
            last capture.
        """
        bits = self._time_bits
        found = [Signal(n) for n in (bits + 1, 1, 1, 1, bits)]
        parts: list[list[tuple[Value, Value]]] = [[] for _ in found]
        for n in range(self._encoders):
            here = (block[0] ^ block[1]) & (index == n)
            *now, time = self._encoder_changes(m, n, turn & here, block[1], second)
            counted, gap = now[1], now[4]
            for mine, value in zip(parts, now, strict=True):
                mine.append((here & live, value))
            parts[4][-1:] = [(here & live & counted, gap), (here & live & ~counted, time)]
            if n >= self._copied:
                continue
            then = [Signal.like(value, name=f"then{k}") for k, value in enumerate(now)]
            with m.If(self.capture):
                m.d.sync += [old.eq(new) for old, new in zip(then, now, strict=True)]
            for mine, value in zip(parts, then, strict=True):
                mine.append((here & captured, value))
        for value, choices in zip(found, parts, strict=True):
            m.d.comb += value.eq(_either(choices))
        delta, often = Signal(self._delta_bits), Signal()

        steps, owed = Signal(self._step_bits), Signal(OWED_BITS)
        stepped, take = [], []
        for n in range(self._motors):
            here = block[0] & block[1] & (index == n)
            my_steps = Signal(self._step_bits, name=f"steps{n}")
            change = Cat(self.moved[n], (self.moved[n] & self.down[n]).replicate(len(steps) - 1))
            m.d.sync += my_steps.eq(Mux(turn & here, change, my_steps + change))
            m.d.comb += self.taken[n].eq(turn & here & self.take[n])
            stepped.append((here, my_steps))
            take.append((here & self.take[n], self.owed[n]))
        m.d.comb += [steps.eq(_either(stepped)), owed.eq(_either(take))]

        counts, zeroed = [], []
        for n, event in enumerate(self._events):
            here = block[0] & block[1] & (index == event.place)
            most = event.burst + self._cycles // event.spacing + 1
            events, zero = Signal(range(most + 1), name=f"events{n}"), Signal(name=f"zeroed{n}")
            m.d.sync += [
                events.eq(Mux((turn & here) | self.zero, self.event[n], events + self.event[n])),
                zero.eq(self.zero | (zero & ~(turn & here))),
            ]
            counts.append((here, events))
            zeroed.append((here, zero))
        here = block[0] & block[1] & (index == self._events[0].place - 1)
        ticks, again = Signal(self._step_bits), Signal()  # down from 0
        m.d.sync += [
            ticks.eq(Mux(turn & here, 0, ticks) - self.tick),
            again.eq(self.restart | (again & ~(turn & here))),
        ]
        with m.If(self.restart):
            m.d.sync += ticks.eq(0)
        counts.append((here, ticks.as_signed()))
        zeroed.append((here, again))

        m.d.comb += [
            delta.eq(
                _extended(found[0].as_signed(), self._delta_bits)
                | _extended(steps.as_signed() - owed.as_signed(), self._delta_bits)
                | _either(counts, self._delta_bits)
            ),
            often.eq(found[2] | _either(zeroed)),
        ]
        return delta, found[1], often, found[4], found[3]

    def _encoder_changes(
        self, m: Module, n: int, turn: Value, position: Value, second: Value
    ) -> tuple[Signal, ...]:
        """Add what has changed of an encoder.

        Returns
        -------
        delta, counted, often, falling, gap, time
            ``counted``: the velocity is not that of the last count, which came ``gap`` cycles after
            the one before, if ``often``, or the time that is in memory. ``time``: cycles since the
            last count; added to the time in memory unless ``counted`` or ``often``.
        """
        bits = self._time_bits
        delta, time = Signal(bits + 1), Signal(bits)
        # used after a count only
        gap, falling = Signal(bits, reset_less=True), Signal(reset_less=True)
        # Set by the reset, so that the time is that from there; the flip-flop as in configuration.
        counted, often = Signal(), Signal(reset_less=True)
        count, up = self.count[n], self.up[n]
        turn_time, turn_since = Signal(), Signal()
        m.d.comb += [
            turn_time.eq(turn & ~position & (~second | often)),
            turn_since.eq(turn_time & ~counted),
        ]
        change = Cat(count, (count & ~up).replicate(bits))
        m.d.sync += [
            delta.eq(Mux(turn & position, change.as_signed(), delta + change.as_signed())),
            counted.eq(count | (counted & ~turn_time)),
            often.eq(Mux(turn_time, counted, often | (count & counted)) | self.clear),
            time.eq(Mux(count, 0, Mux(turn_since, 1, time + 1))),
        ]
        with m.If(count):
            m.d.sync += [gap.eq(Mux(turn_since, 0, time)), falling.eq(~up)]
        return delta, counted, often, falling, gap, time


def copied_address(velocity: Value, index: Value, bank: Value) -> Value:
    """Return where a copy is."""
    encoder = Cat(index[: INDEX_BITS - 1], Const(0, max(INDEX_BITS - 1 - len(index), 0)))
    return Cat(velocity, encoder, bank, Const(Block.COPY >> 1, 2))


def _place(block: Block, index: Value) -> Value:
    """Return the address of a register."""
    return Cat(
        *(index[:INDEX_BITS], Const(0, INDEX_BITS - len(index))),
        Const(block, ADDRESS_BITS - INDEX_BITS),
    )


def _either(choices: Iterable[tuple[Value, Value]], bits: int | None = None) -> Value:
    """Return the value whose condition is 1, or 0; there is not more than one."""
    found: Value = Const(0)
    for condition, value in choices:
        size = len(value) if bits is None else bits
        found = found | (_extended(value, size) & condition.replicate(size))
    return found


def _extended(value: Value, bits: int) -> Value:
    """Return a number in so many bits, unsigned."""
    top = value[-1] if value.shape().signed else Const(0, 1)
    return Cat(value, top.replicate(max(bits - len(value), 0)))[:bits]
