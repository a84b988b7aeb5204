"""Registers that count, in block RAM: encoders, step positions and events, with one adder.

What changes a register is kept beside it, a few bits wide, until its turn comes: a scan goes round
all of them. A read takes its register out of turn, so that it gives what the register is in the
cycle of the read.

An encoder has three numbers: its position, its velocity, and the time since its last count, as it
was at its last turn, less 1. In memory a velocity of a falling position is the complement of what
it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import Component, In, Out

from pulsewright.boards.rapcores.gateware_shared import BLOCK_RAM

WORD_BITS: Final = 32
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


class Kind(IntEnum):
    """What has its turn."""

    POSITION = 0  # of an encoder
    TIME = 1  # its velocity, and the time since its last count
    MOTOR = 2
    EVENT = 3
    FIXED = 4


class Job(IntEnum):
    """What the adder does in a cycle."""

    NONE = 0
    POSITION = 1
    COUNT = 2  # a position of a motor, or an event counter
    VELOCITY = 3
    SINCE = 4  # after it


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
        What registers in other blocks are after a reset, by address, if not 0.

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
    value : Out(32), inverted : Out(1)
        In the cycle after ``read``: its register. If ``inverted``, the complement is meant.
    added : In(32)
        Bits of ``value`` besides those of the register, which are 0 there; only then, and after
        ``write``.
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
        """Return the cycles from one turn of a register to the next, at most."""
        turns = 3 * self._encoders + self._motors + 1 + len(self._events)
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
        job, more = Signal(Job), Signal()
        free, copies, turn = Signal(), Signal(), Signal()
        start, chosen = Signal(), Signal()  # chosen: a copy
        m.d.comb += [
            free.eq(~more & ~self.block & ~self.clear),
            turn.eq(free & ~self.copying & ~chosen),
            start.eq(self.read | turn | (free & chosen & copies)),
        ]

        # Whose turn it is: that of the read, of a copy, or the next one of the scan. Decided a
        # cycle before, as it takes long to find what has changed.
        first = Kind.POSITION if self._encoders else Kind.MOTOR
        kind, index = Signal(3, init=first), Signal(INDEX_BITS)
        scan_kind, scan_index = self._scan(m, turn, first)
        copy_time, copy_index = self._copy_scan(m, free & chosen, copies)
        m.d.sync += chosen.eq(self.copying & ~self.choose)
        with m.If(self.choose):
            m.d.sync += index.eq(self.read_address)
            with m.Switch(self.read_address[INDEX_BITS:]):
                with m.Case(Block.POSITION):
                    m.d.sync += kind.eq(Kind.POSITION)
                with m.Case(Block.VELOCITY):
                    m.d.sync += kind.eq(Kind.TIME)
                with m.Case(Block.COUNTS):
                    m.d.sync += kind.eq(
                        Mux(self.read_address[INDEX_BITS - 1], Kind.EVENT, Kind.MOTOR)
                    )
                with m.Default():
                    m.d.sync += kind.eq(Kind.FIXED)
        with m.Elif(self.copying):
            m.d.sync += [
                kind.eq(Mux(copy_time, Kind.TIME, Kind.POSITION)),
                index.eq(copy_index),
            ]
        with m.Else():
            m.d.sync += [kind.eq(scan_kind), index.eq(scan_index)]

        # What had its turn in the cycle of a capture has not changed since.
        turned, last_kind, last_index = Signal(), Signal(), Signal(range(max(self._encoders, 1)))
        unchanged = turned & (kind[0] == last_kind) & (index == last_index)
        with m.If(self.capture):
            m.d.sync += [
                turned.eq(turn & ~kind[1] & ~kind[2]),
                *(last_kind.eq(kind[0]), last_index.eq(index)),
            ]
        changes = self._changes(m, turn, ~chosen, chosen & ~unchanged, kind, index)
        counted, often = changes[1:3]
        # Kept for the jobs of the turn.
        kept = [Signal.like(value, name=f"kept{n}") for n, value in enumerate(changes)]
        kept_delta, kept_counted, _, kept_gap, kept_time, kept_falling = kept
        kept_own = Signal()
        with m.If(start):
            m.d.sync += [
                *(old.eq(new) for old, new in zip(kept, changes, strict=True)),
                kept_own.eq(~self.read),
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

        # The job of a turn, or the next one: its register, and what is read for it. The register is
        # written in the next cycle; also in the one after a reset.
        next_job = Signal(Job)
        place, target = Signal(ADDRESS_BITS), Signal(ADDRESS_BITS, reset_less=True)
        clearing = Signal(reset_less=True)
        m.d.sync += [target.eq(place), clearing.eq(self.clear)]
        block = Cat(kind[:2].any(), kind[1] | ~kind[0])
        m.d.comb += [place.eq(Cat(index, block, 0)), read.addr.eq(place)]
        with m.If(chosen):
            m.d.sync += target.eq(copied_address(kind[0], index, self.copy_bank))
        with m.If(self.clear):
            m.d.comb += [place.eq(self.clear_address), read.addr.eq(ZERO)]
            m.d.sync += target.eq(place)
        with m.Elif(self.write):
            m.d.comb += [place.eq(self.write_address), read.addr.eq(ZERO)]
            m.d.sync += target.eq(place)
        with m.Elif(more):
            m.d.sync += [more.eq(0), target.eq(place)]
            m.d.comb += [
                next_job.eq(Job.SINCE),
                place.eq(_place(Block.SINCE, target[:INDEX_BITS])),
                read.addr.eq(Mux(kept_counted, MINUS_ONE, place)),
            ]
        with m.Elif(start):
            m.d.sync += more.eq(turn & (kind == Kind.TIME))
            with m.If(self.read):
                m.d.comb += place.eq(self.read_address)
            with m.Switch(kind):
                with m.Case(Kind.POSITION):
                    m.d.comb += next_job.eq(Job.POSITION)
                with m.Case(Kind.TIME):
                    m.d.comb += next_job.eq(Job.VELOCITY)
                    with m.If(counted):
                        since = Cat(place[:INDEX_BITS], Const(Block.SINCE, 3))
                        m.d.comb += read.addr.eq(Mux(often, MINUS_ONE, since))
                with m.Case(Kind.MOTOR):
                    m.d.comb += next_job.eq(Job.COUNT)
                with m.Case(Kind.EVENT):
                    duration = self.run & (index == self._events[0].place - 1)
                    m.d.comb += next_job.eq(Job.COUNT)
                    with m.If(often):
                        m.d.comb += read.addr.eq(
                            Mux(duration, _place(Block.DURATION, self.slot), ZERO)
                        )
        m.d.sync += job.eq(next_job)

        stored = Signal()
        m.d.sync += stored.eq(self.write)
        operand, one = Signal(self._delta_bits), Signal()
        total = Signal(WORD_BITS)
        m.d.comb += [
            total.eq(
                (Cat(1, read.data[:WORD_BITS]) + Cat(one, operand).as_signed())[1 : WORD_BITS + 1]
                | self.added
            ),
            self.value.eq(total),
            self.inverted.eq(read.data[WORD_BITS]),
            written.addr.eq(target),
            written.data.eq(total),
            written.en.eq(((job != Job.NONE) & kept_own) | stored | clearing),
        ]
        with m.Switch(job):
            with m.Case(Job.COUNT, Job.POSITION):
                m.d.comb += operand.eq(kept_delta)
            with m.Case(Job.VELOCITY), m.If(kept_counted):
                m.d.comb += [
                    operand.eq(kept_gap),
                    one.eq(~kept_falling),
                    self.inverted.eq(kept_falling),
                ]
            with m.Case(Job.SINCE):
                m.d.comb += operand.eq(kept_time)
        m.d.comb += written.data[WORD_BITS].eq((job == Job.VELOCITY) & self.inverted)
        with m.If(clearing):
            with m.If(target[INDEX_BITS:] == Block.SINCE):
                m.d.comb += operand.eq(-1)
            with m.Switch(target):
                for address, value in self._defaults.items():
                    with m.Case(address):
                        m.d.comb += operand.eq(value)
        return m

    def _scan(self, m: Module, turn: Value, first: Kind) -> tuple[Signal, Signal]:
        """Add the scan; return whose turn is next, in the next cycle."""
        kind, index = Signal(3, init=first), Signal(INDEX_BITS)
        next_kind, next_index = Signal.like(kind), Signal.like(index)
        m.d.comb += [next_kind.eq(kind), next_index.eq(index)]
        m.d.sync += [kind.eq(next_kind), index.eq(next_index)]
        ends = {
            Kind.POSITION: (self._encoders - 1, Kind.TIME, 0),
            Kind.TIME: (self._encoders - 1, Kind.MOTOR, 0),
            Kind.MOTOR: (self._motors - 1, Kind.EVENT, self._events[0].place - 1),
            Kind.EVENT: (self._events[-1].place, first, 0),
        }
        with m.If(turn):
            m.d.comb += next_index.eq(index + 1)
            with m.Switch(kind):
                for now, (last, then, at) in ends.items():
                    with m.Case(now), m.If(index == last):
                        m.d.comb += [next_kind.eq(then), next_index.eq(at)]
        return next_kind, next_index

    def _copy_scan(self, m: Module, free: Value, copies: Signal) -> tuple[Signal, Signal]:
        """Add the scan of a copy; return what is next. ``copies``: the turn of a copy may be."""
        time, index = Signal(), Signal(max(self._copied - 1, 0).bit_length())
        next_time, next_index = Signal.like(time), Signal.like(index)
        if not self._copied:
            return time, index
        # In the first cycle the result of a turn before may not be in memory.
        wait = Signal()
        m.d.sync += wait.eq(self.copy)
        m.d.comb += [copies.eq(self.copying & ~wait), next_time.eq(time), next_index.eq(index)]
        m.d.sync += [time.eq(next_time), index.eq(next_index)]
        with m.If(free & copies):
            m.d.comb += next_index.eq(index + 1)
            with m.If(index == self._copied - 1):
                m.d.comb += [next_index.eq(0), next_time.eq(1)]
                m.d.sync += self.copying.eq(~time)
        with m.If(self.copy):
            m.d.comb += [next_index.eq(0), next_time.eq(0)]
            m.d.sync += self.copying.eq(1)
        return next_time, next_index

    def _changes(
        self, m: Module, turn: Value, live: Value, captured: Value, kind: Value, index: Value
    ) -> tuple[Signal, ...]:
        """Add what has changed since the last turns.

        Returns
        -------
        delta, counted, often, gap, time, falling
            Of the one with an index: now if ``live``, or, if ``captured``, of an encoder at the
            last capture.
        """
        bits = self._time_bits
        found = [Signal(n) for n in (bits + 1, 1, 1, bits, bits, 1)]  # of encoders
        parts: list[tuple[Value, Sequence[Value]]] = []
        for n in range(self._encoders):
            here = ~kind[1] & (index == n)
            turns = [turn & here & (kind[0] == time) for time in range(2)]
            now = self._encoder_changes(m, n, *turns)
            if n >= self._copied:
                parts.append((here, now))
                continue
            then = [Signal.like(value, name=f"then{k}") for k, value in enumerate(now)]
            with m.If(self.capture):  # but for the time, which is not copied
                m.d.sync += [
                    old.eq(new)
                    for k, (old, new) in enumerate(zip(then, now, strict=True))
                    if k != 4
                ]
            parts += [(here & live, now), (here & captured, then)]
        for k, value in enumerate(found):
            m.d.comb += value.eq(_either((here, mine[k]) for here, mine in parts))
        delta, often = Signal(self._delta_bits), Signal()

        steps, owed = Signal(self._step_bits), Signal(OWED_BITS)
        stepped, take = [], []
        for n in range(self._motors):
            here = (kind[:2] == Kind.MOTOR) & (index == n)
            my_steps = Signal(self._step_bits, name=f"steps{n}")
            change = Cat(self.moved[n], (self.moved[n] & self.down[n]).replicate(len(steps) - 1))
            m.d.sync += my_steps.eq(Mux(turn & here, change, my_steps + change))
            m.d.comb += self.taken[n].eq(turn & here & self.take[n])
            stepped.append((here, my_steps))
            take.append((here & self.take[n], self.owed[n]))
        m.d.comb += [steps.eq(_either(stepped)), owed.eq(_either(take))]

        counts, zeroed = [], []
        for n, event in enumerate(self._events):
            here = (kind[:2] == Kind.EVENT) & (index == event.place)
            most = event.burst + self._cycles // event.spacing + 1
            events, zero = Signal(range(most + 1), name=f"events{n}"), Signal(name=f"zeroed{n}")
            m.d.sync += [
                events.eq(Mux((turn & here) | self.zero, self.event[n], events + self.event[n])),
                zero.eq(self.zero | (zero & ~(turn & here))),
            ]
            counts.append((here, events))
            zeroed.append((here, zero))
        here = (kind[:2] == Kind.EVENT) & (index == self._events[0].place - 1)
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
        return delta, found[1], often, *found[3:]

    def _encoder_changes(
        self, m: Module, n: int, turn_position: Value, turn_time: Value
    ) -> tuple[Signal, ...]:
        """Add what has changed of an encoder."""
        bits = self._time_bits
        delta, time = Signal(bits + 1), Signal(bits)
        counted, often = Signal(), Signal()
        # used after a count only
        gap, falling = Signal(bits, reset_less=True), Signal(reset_less=True)
        count, up = self.count[n], self.up[n]
        before = counted & ~turn_time
        change = Cat(count, (count & ~up).replicate(bits))
        m.d.sync += [
            delta.eq(Mux(turn_position, change.as_signed(), delta + change.as_signed())),
            counted.eq(count | before),
            often.eq(Mux(count, before, often & ~turn_time)),
            # cycles from the last count or turn
            time.eq(Mux(count, 0, Mux(turn_time, 1, time + 1))),
        ]
        with m.If(count):
            m.d.sync += [gap.eq(Mux(turn_time, 0, time)), falling.eq(~up)]
        return delta, counted, often, gap, time, falling


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
