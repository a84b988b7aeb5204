"""The board of profile ``document`` with one adder for the DDAs of all motors."""

from __future__ import annotations

from typing import Final

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib.memory import Memory

from pulsewright.boards.rapcores import registers as reg
from pulsewright.boards.rapcores.gateware_bridge import PHASE_BITS
from pulsewright.boards.rapcores.gateware_document import COUNTERS, TIMES, DocumentCore
from pulsewright.boards.rapcores.gateware_encoder import EncoderInputs
from pulsewright.boards.rapcores.gateware_pulse import TIMER_BITS
from pulsewright.boards.rapcores.gateware_registers import (
    ADDRESS_BITS,
    INDEX_BITS,
    ZERO,
    Block,
    CountingRegisters,
    Event,
    copied_address,
    memory_address,
)
from pulsewright.boards.rapcores.gateware_shared import SharedDda, cycles

COUNTS_BASE: Final = reg.R_STEP_POSITION[0]
CONFIGURATION: Final = 0x30  # from here on in block COUNTS; status registers here are constants
# Configuration registers that are stored, and bits of each; None: one per motor.
STORED: Final = (
    *((reg.W_ENABLE, 32), (reg.W_BRAKE, 32), (reg.W_DIVIDER, 32)),
    *((place, TIMER_BITS) for place in TIMES.values()),
    (reg.W_CONTROL, 1),
    *((reg.W_STEP_POLARITY, None), (reg.W_DIR_POLARITY, None)),
)
# Those that are not 0 after a reset.
DEFAULTS: Final = {reg.W_DIVIDER: reg.W_DIVIDER_RESET} | dict.fromkeys(
    TIMES.values(), reg.W_STEP_WIDTH_RESET
)


class CompactCore(DocumentCore):
    """As `DocumentCore`, with the same parameters and members."""

    def _motion(self, m: Module) -> None:
        """Add the DDA of all motors, and their step positions."""
        spi, sequencer, number = self._spi, self._sequencer, self._number
        m.submodules.dda = dda = SharedDda(
            motors=self._motors, depth=self._depth, word_bits=self._word_bits
        )
        # Words that the first tick of a move depends on.
        arrived = spi.strobe & self._moving & ~(number[0] & number[1:].any())
        first = Signal(init=1)
        with m.If(sequencer.integrate):
            m.d.sync += first.eq(0)
        with m.If(sequencer.finish | self._halted):
            m.d.sync += first.eq(1)
        m.d.comb += [
            dda.write.eq(spi.byte_strobe & self._moving),
            dda.write_slot.eq(sequencer.write_slot),
            dda.number.eq(number),
            dda.index.eq(spi.byte),
            dda.byte.eq(spi.received),
            dda.slot.eq(sequencer.slot),
            dda.first.eq(first),
            dda.integrate.eq(sequencer.integrate),
            dda.restart.eq(sequencer.finish | self._halted | (~sequencer.run & arrived)),
            self._ready.eq(dda.ready),
            sequencer.last.eq(dda.last),
        ]
        # Whether a move has no ticks has to be known as it starts.
        m.submodules.empty = memory = Memory(shape=1, depth=self._depth, init=[])
        written, read = memory.write_port(), memory.read_port(domain="comb")
        m.d.comb += [
            written.addr.eq(sequencer.write_slot),
            written.data.eq(spi.word[:32] == 0),
            written.en.eq(spi.strobe & self._moving & (number == 1)),
            read.addr.eq(sequencer.slot),
            sequencer.empty.eq(read.data),
        ]
        self._positions(m, dda)

    def _positions(self, m: Module, dda: SharedDda) -> None:
        """Add registers, and tell them and pulse formers of changes of step positions."""
        sequencer = self._sequencer
        m.submodules.registers = self._registers = registers = CountingRegisters(
            encoders=self._encoders,
            motors=self._motors,
            copied=min(self._encoders, self._motors),
            events=self._counted(),
            depth=self._depth,
            tick_cycles=cycles(self._motors, self._word_bits),
            contents={
                memory_address(Block.FIXED, _fixed(place)): value
                for place, value in self._constants().items()
            },
            defaults={
                memory_address(Block.COUNTS, CONFIGURATION + place % 8 + 8 * (place < 0x80)): value
                for place, value in DEFAULTS.items()
            },
        )
        m.d.comb += [
            registers.clear.eq(self.clear),
            registers.clear_address.eq(self.clear_address),
            registers.tick.eq(sequencer.integrate),
            registers.restart.eq(sequencer.load | sequencer.finish | self._halted),
            registers.run.eq(sequencer.run),
            registers.slot.eq(sequencer.slot),
        ]
        self._take = [Signal(name=f"take{n}") for n in range(self._motors)]
        for n, (former, take) in enumerate(zip(self._formers, self._take, strict=True)):
            moved = Signal(name=f"moved{n}")
            m.d.comb += [
                moved.eq(sequencer.integrate & dda.moved[n]),
                registers.moved[n].eq(moved),
                registers.down[n].eq(dda.down[n]),
                registers.owed[n].eq(former.owed),
                registers.take[n].eq(take),
                former.blocked.eq(self._halted | take),
                former.forget.eq(registers.taken[n]),
                self._pending[n].eq((former.owed != 0) & ~take),
            ]
            m.d.sync += [former.moved.eq(moved), former.down.eq(dda.down[n])]
            # What is owed as a halt begins is taken back in the turn of the motor.
            with m.If(self._halted):
                m.d.sync += take.eq(1)
            with m.Elif(registers.taken[n]):
                m.d.sync += take.eq(0)

    def _phases(self, m: Module) -> list[Value]:
        """Return the phase angles of motors: copies of what is in memory."""
        registers, found = self._registers, []
        for n, (former, take) in enumerate(zip(self._formers, self._take, strict=True)):
            counted = Signal(PHASE_BITS, name=f"counted{n}")
            phase = Signal(PHASE_BITS, name=f"phase{n}")
            owed = former.owed.as_signed()
            m.d.comb += phase.eq(counted - Mux(take, owed, 0))
            with m.If(registers.taken[n]):
                m.d.sync += counted.eq(phase)
            with m.Elif(registers.moved[n]):
                m.d.sync += counted.eq(counted + Cat(1, registers.down[n]).as_signed())
            found.append(phase)
        return found

    def _counted(self) -> list[Event]:
        """Return events, and how often each can be."""
        word = 2 * self._word_bits  # cycles
        found = {name: Event(place - COUNTS_BASE, word) for name, place in COUNTERS.items()}
        found["framing"] = Event(found["framing"].place, 4)  # frames of one bit
        # Moves without ticks end one after the other.
        found["completed"] = Event(
            found["completed"].place, cycles(self._motors, self._word_bits), self._depth
        )
        return list(found.values())

    def _configuration(self, m: Module) -> None:
        """Add what configuration does; what is read is in memory."""
        word, registers, motors = self._spi.word, self._registers, self._motors
        self._fetch = Signal()  # the next word is one that reads memory
        # Bits of the reply that are not in memory, in the first cycle after the one in which a word
        # acts; in the second one what is stored.
        wide = self._encoders > 32 and self._word_bits > 32
        self._added = added = Signal(64 if wide else 32, reset_less=True)
        m.d.sync += added.eq(0)
        known = Signal()  # the address is that of a register in memory: it was read with the header
        with m.If(self._spi.strobe & self._idle):
            m.d.sync += known.eq(self._fetch)
        write, duration = Signal(), Signal()
        slot = self._sequencer.write_slot
        self._store = write | duration
        m.d.sync += [
            write.eq(self._write & known),
            duration.eq(self._spi.strobe & self._moving & (self._number == 1)),
        ]
        m.d.comb += [
            registers.write.eq(self._store),
            registers.write_address.eq(
                Mux(
                    duration,
                    Cat(slot, Const(0, INDEX_BITS - len(slot)), Const(Block.DURATION, 3)),
                    _configuration_place(self._address),
                )
            ),
        ]
        ends = sorted({1, TIMER_BITS, min(motors, 32), 32})
        for first, end in zip([0, *ends], ends, strict=False):
            with m.If((write & _stored(self._address, first, motors)) | duration):
                m.d.sync += added[first:end].eq(word[first:end])
        m.d.comb += registers.added.eq(added[:32])

        def register(target: Value, place: int, value: Value, init: int = 0) -> None:
            # Set by the reset, but 0 at configuration: flip-flops of the iCE40 cannot be 1 then.
            stored = Signal(len(target), reset_less=True, name=f"config{place:02x}")
            with m.If(self._write & (self._address == place)):
                m.d.sync += stored.eq(value)
            with m.If(self.clear):
                m.d.sync += stored.eq(init)
            m.d.comb += target.eq(stored)

        register(self.en, reg.W_ENABLE, word)
        register(self._divider, reg.W_DIVIDER, word, reg.W_DIVIDER_RESET)
        register(self._control, reg.W_CONTROL, word)
        register(self._step_polarity, reg.W_STEP_POLARITY, word)
        register(self._dir_polarity, reg.W_DIR_POLARITY, word)
        if self._h_bridge:
            register(self._brake, reg.W_BRAKE, word)
        for address, current in zip(reg.W_CURRENT, self._current, strict=False):
            register(current, address, word)
        one = Signal()
        m.d.comb += one.eq(word[1:TIMER_BITS] == 0)
        time = Cat(word[0] | one, word[1:TIMER_BITS])
        for name, place in TIMES.items():
            register(getattr(self._deadlines, name), place, time, reg.W_STEP_WIDTH_RESET)
            register(self._one[name], place, one)

    def _encoder_blocks(self, m: Module) -> None:
        """Add the inputs of encoders."""
        for n in range(self._encoders):
            m.submodules[f"encoder{n}"] = encoder = EncoderInputs()
            m.d.comb += [
                encoder.a.eq(self.enc_a[n]),
                encoder.b.eq(self.enc_b[n]),
                self._registers.count[n].eq(encoder.count),
                self._registers.up[n].eq(encoder.up),
            ]
            self._latch(m, self._encoder_fault[n], encoder.fault, reg.W_CLEAR_ENCODER_FAULT_LSB)

    def _counters(self, m: Module) -> None:
        """Count events."""
        m.d.comb += [
            self._registers.event.eq(Cat(self._events.values())),
            self._registers.zero.eq(self._cleared(reg.W_CLEAR_COUNTERS_LSB)),
        ]

    def _replies(self, m: Module) -> None:
        """Add the reply: 32 bits, and what they become in a longer word."""
        spi, registers, sequencer = self._spi, self._registers, self._sequencer
        # It comes from the memory of registers, if only a 0, a cycle late, the bits to show first;
        # and the others two cycles late.
        late, later, self._nothing = Signal(), Signal(), Signal()
        # Of no matter while the reply is 0.
        self._extend, self._short_reply = Signal(reset_less=True), Signal(reset_less=True)
        # Cleared by a reset and without a reply in the same way: a flip-flop has one reset.
        reply = Signal(len(self._added), reset_less=True)
        inverted = Signal(reset_less=True)
        m.d.sync += [late.eq(spi.strobe), later.eq(late & ~self._nothing)]
        with m.If(spi.strobe | self._nothing):
            m.d.sync += [self._extend.eq(0), self._short_reply.eq(0)]
        with m.If(self.clear | self._nothing):
            m.d.sync += [reply.eq(0), inverted.eq(0)]
        with m.Elif(late):
            m.d.sync += [
                reply[6:8].eq(registers.low[6:]),
                reply[32:].eq(self._added[32:]),
                inverted.eq(registers.low_inverted),
            ]
        with m.Elif(later):
            m.d.sync += [reply[:6].eq(registers.value), reply[8:32].eq(registers.value[8:])]
        bit, byte = spi.bit, spi.byte
        shown, upper, none = Signal(), Signal(), Signal()  # the bit to show
        m.d.comb += shown.eq(reply.bit_select(Cat(bit, byte)[: len(reply).bit_length() - 1], 1))
        if self._word_bits > len(reply):
            m.d.comb += upper.eq(byte[2])
        m.d.comb += none.eq(
            (self._short_reply & (byte[1] | (byte[0] & bit[1:].any()))) | (upper & ~self._extend)
        )
        with m.If(upper):
            m.d.comb += shown.eq(reply[31])
        with m.If(late):  # it is the highest one, or with a fast SCK the next
            m.d.comb += spi.reply.eq(
                (
                    Mux(bit[0], registers.low[7], registers.low[6]) ^ registers.low_inverted
                ).replicate(8)
            )
        with m.Else():
            m.d.comb += spi.reply.eq((~none & (shown ^ inverted)).replicate(8))

        soon = Signal()
        m.d.sync += soon.eq(spi.soon)
        m.d.comb += [
            registers.block.eq(spi.soon | soon | spi.strobe | self._store),
            registers.choose.eq(soon),
            registers.read.eq(spi.strobe),
        ]
        self._bank, self._snap = Signal(), Signal()  # of the open message; its header
        self._places(m, spi.received, spi.word[8:16])
        # Telemetry is that of the start of the executing move, or, without one, of the cycle before
        # a header: remembered then, and copied if the header is that of a message with telemetry.
        bank, newest, target, copy_bank = self._bank, Signal(), Signal(), Signal()
        executing, use, copy = Signal(), Signal(), Signal()
        m.d.sync += executing.eq(sequencer.run)
        m.d.comb += [
            use.eq(self._snap & executing),
            copy.eq(self._snap & ~executing),
            registers.capture.eq(sequencer.load | (soon & ~sequencer.run)),
            registers.copy.eq(sequencer.load | copy),
            registers.copy_bank.eq(copy_bank),
            target.eq(Mux(registers.copying, copy_bank, ~Mux(use, newest, bank))),
        ]
        with m.If(registers.copy):
            m.d.sync += [copy_bank.eq(target), newest.eq(target)]
        with m.If(use):
            m.d.sync += bank.eq(newest)
        with m.If(copy):
            m.d.sync += bank.eq(target)

    def _reply_nothing(self, m: Module) -> None:
        m.d.comb += self._nothing.eq(~self._spi.strobe)

    def _snapshot(self, m: Module) -> None:
        m.d.comb += self._snap.eq(1)

    def _reply_telemetry(self, m: Module) -> None:
        m.d.sync += self._extend.eq(1)

    def _reply_status(self, m: Module, address: Value) -> None:
        block, _ = _relative(address)
        with m.If((block == 2) & ~address[6:].all()):
            m.d.sync += self._short_reply.eq(1)
        m.d.sync += self._extend.eq(~((block == 2) & ~address[6:].all()) & ~address[5:].all())
        with m.Switch(address):
            for flags, value in self._flags().items():
                with m.Case(flags):
                    m.d.sync += [self._added[: len(value)].eq(value), self._extend.eq(0)]

    def _reply_configuration(self, m: Module, address: Value) -> None:
        with m.Switch(address):
            for place, current in zip(reg.W_CURRENT, self._current, strict=False):
                with m.Case(place):
                    m.d.sync += self._added[: len(current)].eq(current)

    def _places(self, m: Module, header: Value, address: Value) -> None:
        """Find out where in memory a reply is, a cycle before the word before it is complete."""
        block, index = _relative(address)
        place, fetch = Signal(ADDRESS_BITS, init=ZERO), Signal()
        m.d.sync += [
            self._registers.read_address.eq(Mux(fetch, place, ZERO)),
            self._fetch.eq(fetch),
        ]
        with m.If(address[4:].all() | ~address[2:].any()):
            m.d.comb += place.eq(
                Cat(address[:4], address[7], Const(0, INDEX_BITS - 5), Const(Block.FIXED, 3))
            )
        with m.Elif(address[6:].all()):
            m.d.comb += place.eq(Cat(address[:6], Const(Block.COUNTS, 3)))
        with m.Elif(block == 0):
            m.d.comb += place.eq(Cat(index, Const(Block.POSITION, 3)))
        with m.Elif(block == 1):
            m.d.comb += place.eq(Cat(index, Const(Block.VELOCITY, 3)))
        with m.Elif((block == 2) & ~index[5]):
            m.d.comb += place.eq(Cat(index, Const(Block.COUNTS, 3)))
        with m.If(header[1]):
            m.d.comb += place.eq(_configuration_place(address))
        stored = Cat(address == n for n, _ in STORED).any()
        flags = Cat(address == n for n in self._flags()).any()
        with m.If(self._telling):
            entry = self._number - 1
            m.d.comb += [
                place.eq(copied_address(entry[0], entry[1:], self._bank)),
                fetch.eq(self._number < 2 * min(self._encoders, self._motors) + 1),
            ]
        with m.Elif(self._idle), m.Switch(header):
            with m.Case(reg.HEADER_STATUS_READ):
                m.d.comb += fetch.eq(~flags)
            with m.Case(reg.HEADER_CONFIG_SWAP, reg.HEADER_CONFIG_READ):
                m.d.comb += fetch.eq(stored)


def _relative(address: Value) -> tuple[Value, Value]:
    """Return which block of 64 a status register is in, from encoder positions on, and where."""
    relative = address - reg.R_ENCODER_POSITION[0]
    return relative[6:8], relative[:6]


def _stored(address: Value, bit: int, motors: int) -> Value:
    """Return whether a bit is stored, as in `STORED`, by the register of an address there."""
    if bit == 0:
        return Const(1)
    found = ~address[7]
    if bit < TIMER_BITS:
        found |= ~address[2]
    if bit < motors:
        found |= address[1] & address[2]
    return found


def _configuration_place(address: Value) -> Value:
    """Return where in memory a configuration register is."""
    return Cat(
        *(address[:3], ~address[7], Const(CONFIGURATION >> 4, 2)),
        Const(Block.COUNTS, ADDRESS_BITS - INDEX_BITS),
    )


def _fixed(place: int) -> int:
    """Return the index in block FIXED of a constant status register, of the first 4 or last 16."""
    return place & 15 | place >> 7 << 4
