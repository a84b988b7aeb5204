"""Registers that count, in block RAM: encoders, step positions and events, with one adder.

What changes a register is kept beside it, a few bits wide, until its turn comes: a scan goes round
all of them. A read takes its register out of turn, so that it gives what the register is in the
cycle of the read.

An encoder has three numbers: its position, its velocity, and the time since its last count, as it
was at its last turn. In memory a velocity of a falling position is the complement of what it is.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import Component, In, Out

WORD_BITS: Final = 32
INDEX_BITS: Final = 6
ADDRESS_BITS: Final = 9
SPARE_CYCLES: Final = 16  # in which reads delay a scan
STEP_BITS: Final = 3
OWED_BITS: Final = 9


class Block(IntEnum):
    """Upper bits of an address in the memory."""

    SINCE = 0
    VELOCITY = 1
    POSITION = 2
    COUNTS = 3  # step positions from 0 on, event counters, registers that the host writes
    FIXED = 4  # constants


class Kind(IntEnum):
    """What has its turn."""

    ENCODER = 0
    MOTOR = 1
    EVENT = 2
    FIXED = 3


class Job(IntEnum):
    """What the adder does in a cycle."""

    NONE = 0
    COUNT = 1  # a position of a motor or an event counter
    POSITION = 2
    VELOCITY = 3
    SINCE = 4


def memory_address(block: Block, index: int) -> int:
    """Return where a register is."""
    return block << INDEX_BITS | index


ZERO: Final = memory_address(Block.FIXED, 2)  # a word that is 0


class CountingRegisters(Component):
    """Registers of encoders, motors and events, and others that the host reads or writes.

    Parameters
    ----------
    encoders, motors : int
    copied : int
        Encoders that a copy takes, not more than there are.
    events : sequence of int
        Where event counters are in block `Block.COUNTS`: from 0x20 on.
    burst : int
        How often the first event can come in cycles that follow each other.
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
    block : In(1)
        A read comes within three cycles, or now.
    choose : In(1), read : In(1), read_address : In(9)
        Read a register. ``choose`` is there with ``read``, and not without ``block``; it is apart
        from it as it comes sooner.
    value : Out(32), inverted : Out(1)
        In the cycle after ``read``: its register. If ``inverted``, the complement is meant.
    write : In(1), write_address : In(9), write_data : In(32)
        Write a register, in the cycle after one in which a read could have been.
    copy : In(1), copy_bank : In(1)
        Copy position and velocity of encoders, as they are in the next cycles, one after the other.
    copy_address : In(7), copied_value : Out(33)
        Bank, encoder and which of the two: what was copied, a cycle later; bit 32 is ``inverted``.
    """

    def __init__(
        self,
        *,
        encoders: int,
        motors: int,
        copied: int,
        events: tuple[int, ...],
        burst: int,
        contents: dict[int, int],
        defaults: dict[int, int],
    ) -> None:
        self._encoders, self._motors, self._copied = encoders, motors, copied
        self._events, self._contents, self._defaults = events, contents, defaults
        self._event_bits = max(STEP_BITS, burst.bit_length() + 1)  # of the first event
        self._copy_bits = max(copied - 1, 1).bit_length()
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
                "block": In(1),
                "choose": In(1),
                "read": In(1),
                "read_address": In(ADDRESS_BITS),
                "value": Out(WORD_BITS),
                "inverted": Out(1),
                "write": In(1),
                "write_address": In(ADDRESS_BITS),
                "write_data": In(WORD_BITS),
                "copy": In(1),
                "copy_bank": In(1),
                "copy_address": In(self._copy_bits + 2),
                "copied_value": Out(WORD_BITS + 1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        turns = 3 * self._encoders + self._motors + len(self._events)
        self._time_bits = (turns + SPARE_CYCLES).bit_length()
        self._delta_bits = max(self._time_bits + 1, OWED_BITS + 1)
        job, jobs_left = Signal(3), Signal(2)
        start = Signal()
        m.d.comb += start.eq(self.read | ((jobs_left == 0) & ~self.block & ~self.clear))

        # Whose turn it is: that of the read, or the next one of the scan.
        kind, index = Signal(2), Signal(INDEX_BITS)
        self._scan(m, start & ~self.read, kind, index)
        position_first = Signal(init=1)  # unless a read wants the velocity
        with m.If(self.choose):
            m.d.comb += index.eq(self.read_address)
            with m.Switch(self.read_address[INDEX_BITS:]):
                with m.Case(Block.POSITION):
                    m.d.comb += kind.eq(Kind.ENCODER)
                with m.Case(Block.VELOCITY):
                    m.d.comb += [kind.eq(Kind.ENCODER), position_first.eq(0)]
                with m.Case(Block.COUNTS):
                    m.d.comb += kind.eq(
                        Mux(self.read_address[INDEX_BITS - 1], Kind.EVENT, Kind.MOTOR)
                    )
                with m.Default():
                    m.d.comb += kind.eq(Kind.FIXED)

        delta, counted, often, gap, time, falling = self._changes(m, start, kind, index)
        # Kept for the jobs of the turn.
        kept = [
            Signal.like(value, name=f"kept{n}")
            for n, value in enumerate((delta, counted, often, gap, time, falling))
        ]
        kept_delta, kept_counted, kept_often, kept_gap, kept_time, kept_falling = kept
        kept_kind, kept_index = Signal.like(kind), Signal.like(index)
        with m.If(start):
            m.d.sync += [kept_kind.eq(kind), kept_index.eq(index)]
            m.d.sync += [
                old.eq(new)
                for old, new in zip(kept, (delta, counted, often, gap, time, falling), strict=True)
            ]

        m.submodules.memory = memory = Memory(
            shape=WORD_BITS + 1,
            depth=1 << ADDRESS_BITS,
            init=[self._contents.get(n, 0) for n in range(1 << ADDRESS_BITS)],
            attrs={"ram_style": "block"},
        )
        written, read = memory.write_port(), memory.read_port()

        def place(block: Block, which: Value) -> Value:
            return Cat(which, Const(block, ADDRESS_BITS - INDEX_BITS))

        def velocity_from(who: Value, any_: Value, many: Value) -> Value:
            return Mux(any_, Mux(many, ZERO, place(Block.SINCE, who)), place(Block.VELOCITY, who))

        # The first job of a turn, or the next one.
        next_job = Signal(3)
        m.d.comb += read.addr.eq(ZERO)
        with m.If(start), m.Switch(kind):
            with m.Case(Kind.ENCODER):
                with m.If(position_first):
                    m.d.comb += [
                        next_job.eq(Job.POSITION),
                        read.addr.eq(place(Block.POSITION, index)),
                    ]
                with m.Else():
                    m.d.comb += [
                        next_job.eq(Job.VELOCITY),
                        read.addr.eq(velocity_from(index, counted, often)),
                    ]
                m.d.sync += jobs_left.eq(2)
            with m.Case(Kind.MOTOR, Kind.EVENT):
                m.d.comb += [
                    next_job.eq(Job.COUNT),
                    read.addr.eq(
                        Mux((kind == Kind.EVENT) & often, ZERO, place(Block.COUNTS, index))
                    ),
                ]
                m.d.sync += jobs_left.eq(0)
            with m.Default():
                m.d.comb += read.addr.eq(self.read_address)
                m.d.sync += jobs_left.eq(0)
        with m.Elif(jobs_left != 0):
            m.d.sync += jobs_left.eq(jobs_left - 1)
            with m.Switch(job):
                with m.Case(Job.POSITION):
                    m.d.comb += [
                        next_job.eq(Job.VELOCITY),
                        read.addr.eq(velocity_from(kept_index, kept_counted, kept_often)),
                    ]
                with m.Case(Job.VELOCITY):
                    m.d.comb += [
                        next_job.eq(Job.SINCE),
                        read.addr.eq(Mux(kept_counted, ZERO, place(Block.SINCE, kept_index))),
                    ]
                with m.Default():
                    m.d.comb += [
                        next_job.eq(Job.POSITION),
                        read.addr.eq(place(Block.POSITION, kept_index)),
                    ]
        m.d.sync += job.eq(next_job)

        operand = Signal(self._delta_bits)
        total = Signal(WORD_BITS)
        m.d.comb += [
            total.eq(read.data[:WORD_BITS] + operand.as_signed()),
            self.value.eq(total),
            self.inverted.eq(read.data[WORD_BITS]),
            written.addr.eq(place(Block.COUNTS, kept_index)),
            written.data.eq(total),
            written.en.eq((job != Job.NONE) | self.write | self.clear),
        ]
        with m.Switch(job):
            with m.Case(Job.COUNT):
                m.d.comb += operand.eq(kept_delta)
            with m.Case(Job.POSITION):
                m.d.comb += [
                    operand.eq(kept_delta),
                    written.addr.eq(place(Block.POSITION, kept_index)),
                ]
            with m.Case(Job.VELOCITY):
                m.d.comb += written.addr.eq(place(Block.VELOCITY, kept_index))
                with m.If(kept_counted):
                    m.d.comb += [
                        operand.eq(Cat(kept_gap, Const(0, 1)).as_signed() - kept_falling),
                        self.inverted.eq(kept_falling),
                    ]
            with m.Case(Job.SINCE):
                m.d.comb += [operand.eq(kept_time), written.addr.eq(place(Block.SINCE, kept_index))]
        m.d.comb += written.data[WORD_BITS].eq((job == Job.VELOCITY) & self.inverted)
        with m.If(self.write):
            m.d.comb += [written.addr.eq(self.write_address), written.data.eq(self.write_data)]
        with m.If(self.clear):
            m.d.comb += written.addr.eq(self.clear_address)
            with m.Switch(self.clear_address):
                for address, value in self._defaults.items():
                    with m.Case(address):
                        m.d.comb += operand.eq(value)

        self._copies(m, written.data, kept_index, job)
        return m

    def _scan(self, m: Module, advance: Value, kind: Signal, index: Signal) -> None:
        """Add the scan, which is restarted by a copy."""
        self._copying, self._kept_copying = Signal(), Signal()
        first = Kind.ENCODER if self._encoders else Kind.MOTOR
        scan_kind, scan_index = Signal(2, init=first), Signal(INDEX_BITS)
        m.d.comb += [kind.eq(scan_kind), index.eq(scan_index)]
        ends = {
            Kind.ENCODER: (self._encoders - 1, Kind.MOTOR, 0),
            Kind.MOTOR: (self._motors - 1, Kind.EVENT, self._events[0]),
            Kind.EVENT: (self._events[-1], first, 0),
        }
        with m.If(advance):
            m.d.sync += [scan_index.eq(scan_index + 1), self._kept_copying.eq(self._copying)]
            with m.Switch(scan_kind):
                for now, (last, then, at) in ends.items():
                    with m.Case(now), m.If(scan_index == last):
                        m.d.sync += [scan_kind.eq(then), scan_index.eq(at)]
            with m.If(scan_index == self._copied - 1):
                m.d.sync += self._copying.eq(0)
        if self._copied:
            with m.If(self.copy):
                m.d.sync += [self._copying.eq(1), scan_kind.eq(first), scan_index.eq(0)]

    def _changes(self, m: Module, start: Value, kind: Value, index: Value) -> tuple[Signal, ...]:
        """Add what has changed since the last turns; return that of the one whose turn it is."""
        bits = self._time_bits
        delta = Signal(self._delta_bits)
        counted, often, falling = Signal(), Signal(), Signal()
        gap, time = Signal(bits), Signal(bits)
        for n in range(self._encoders):
            mine = [Signal(bits + 1), Signal(), Signal(), Signal(bits), Signal(bits), Signal()]
            turn = start & (kind == Kind.ENCODER) & (index == n)
            with m.If((kind == Kind.ENCODER) & (index == n)):
                m.d.comb += [
                    delta.eq(mine[0].as_signed()),
                    *(
                        a.eq(b)
                        for a, b in zip((counted, often, gap, time, falling), mine[1:], strict=True)
                    ),
                ]
            count, up = self.count[n], self.up[n]
            my_delta, my_counted, my_often, my_gap, my_time, my_falling = mine
            before = my_counted & ~turn
            change = Cat(count, (count & ~up).replicate(bits))
            m.d.sync += [
                my_delta.eq(Mux(turn, change.as_signed(), my_delta + change.as_signed())),
                my_counted.eq(count | before),
                my_often.eq(Mux(count, before, my_often & ~turn)),
                # cycles from the last count or turn
                my_time.eq(Mux(count, 0, Mux(turn, 1, my_time + 1))),
            ]
            with m.If(count):
                m.d.sync += [my_gap.eq(Mux(turn, 0, my_time)), my_falling.eq(~up)]
        steps, owed = Signal(STEP_BITS), Signal(OWED_BITS)
        for n in range(self._motors):
            mine_now = (kind == Kind.MOTOR) & (index == n)
            turn = start & mine_now
            my_steps = Signal(STEP_BITS, name=f"steps{n}")
            change = Cat(self.moved[n], (self.moved[n] & self.down[n]).replicate(STEP_BITS - 1))
            m.d.sync += my_steps.eq(Mux(turn, change, my_steps + change))
            m.d.comb += self.taken[n].eq(turn & self.take[n])
            with m.If(mine_now):
                m.d.comb += steps.eq(my_steps)
                with m.If(self.take[n]):
                    m.d.comb += owed.eq(self.owed[n])
        with m.If(kind == Kind.MOTOR):
            m.d.comb += delta.eq(steps.as_signed() - owed.as_signed())
        for n, place in enumerate(self._events):
            mine_now = (kind == Kind.EVENT) & (index == place)
            turn = start & mine_now
            bits = STEP_BITS if n else self._event_bits
            events, zeroed = Signal(bits, name=f"events{n}"), Signal(name=f"zeroed{n}")
            m.d.sync += [
                events.eq(Mux(turn | self.zero, self.event[n], events + self.event[n])),
                zeroed.eq(self.zero | (zeroed & ~turn)),
            ]
            with m.If(mine_now):
                m.d.comb += [delta.eq(events), often.eq(zeroed)]
        return delta, counted, often, gap, time, falling

    def _copies(self, m: Module, data: Value, index: Value, job: Value) -> None:
        """Add the memory of copies."""
        if not self._copied:
            return
        m.submodules.copies = memory = Memory(
            shape=WORD_BITS + 1,
            depth=1 << len(self.copy_address),
            init=[],
            attrs={"ram_style": "block"},
        )
        written, read = memory.write_port(), memory.read_port()
        m.d.comb += [
            written.addr.eq(Cat(job == Job.VELOCITY, index[: self._copy_bits], self.copy_bank)),
            written.data.eq(data),
            written.en.eq(self._kept_copying & ((job == Job.POSITION) | (job == Job.VELOCITY))),
            read.addr.eq(self.copy_address),
            self.copied_value.eq(read.data),
        ]
