"""The board of profile ``document``: messages, registers, moves, motors and encoders.

Sections 2 to 4 of the specification.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import Component, In, Out

from pulsewright.boards.rapcores import registers as reg
from pulsewright.boards.rapcores.gateware_bridge import CURRENT_BITS, LEGS, PHASE_BITS, HBridges
from pulsewright.boards.rapcores.gateware_encoder import Encoder
from pulsewright.boards.rapcores.gateware_motion import Dda, Sequencer, TickDivider
from pulsewright.boards.rapcores.gateware_pulse import TIMER_BITS, Deadlines, PulseFormer
from pulsewright.gateware.spi import SpiWordPort

COUNT_BITS: Final = 32
TIMES: Final = {
    "width": reg.W_STEP_WIDTH,
    "low": reg.W_STEP_LOW,
    "setup": reg.W_DIR_SETUP,
    "hold": reg.W_DIR_HOLD,
}
# Counters, which one bit of the clear register clears: name and address.
COUNTERS: Final = {
    "completed": reg.R_MOVES_COMPLETED,
    "refused": reg.R_MOVES_REFUSED,
    "framing": reg.R_FRAMING_ERRORS,
    "aborted": reg.R_ABORTED_MESSAGES,
    "unknown": reg.R_UNKNOWN_HEADERS,
}


class Message(Enum):
    """What the words after a header are."""

    IDLE = 0  # there are none
    IGNORED = 1
    SWAP = 2
    MOVE = 3


class DocumentCore(Component):
    """All of the board but its reset.

    Parameters
    ----------
    motors, encoders, word_bits, depth, times : see `Rapcores`
    halt_pin, cs_reset_message, v020_info : bool
    h_bridge : bool
        Windings are driven, too.

    Members
    -------
    clear : In(1), clear_address : In(8)
        Clear memories: to be there while the rest is in reset, with every address in turn.
    cs, sck, copi, halt : In(1), enc_a, enc_b : In(encoders)
        Pins, asynchronous.
    cipo, cipo_oe, buffer_dtr, move_done : Out(1), step, dir, en : Out(motors)
    phase_a1, phase_a2, phase_b1, phase_b2 : Out(motors)
        With ``h_bridge``.
    """

    def __init__(
        self,
        *,
        motors: int,
        encoders: int,
        word_bits: int,
        depth: int,
        halt_pin: bool,
        cs_reset_message: bool,
        v020_info: bool,
        h_bridge: bool = False,
    ) -> None:
        self._motors, self._encoders = motors, encoders
        self._word_bits, self._depth = word_bits, depth
        self._halt_pin, self._cs_reset_message = halt_pin, cs_reset_message
        self._v020_info, self._h_bridge = v020_info, h_bridge
        super().__init__(
            {
                "clear": In(1),
                "clear_address": In(8),
                "cs": In(1),
                "sck": In(1),
                "copi": In(1),
                "halt": In(1),
                "enc_a": In(encoders),
                "enc_b": In(encoders),
                "cipo": Out(1),
                "cipo_oe": Out(1),
                "buffer_dtr": Out(1),
                "move_done": Out(1),
                "step": Out(motors),
                "dir": Out(motors),
                "en": Out(motors),
                **({f"phase_{leg}": Out(motors) for leg in LEGS} if h_bridge else {}),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        self._channel_info = reg.R_CHANNEL_INFO_RESET & ~0xFFFF | self._encoders << 8 | self._motors
        self._halted, self._halt_seen = Signal(), Signal()
        self._accept = Signal()
        self._idle = Signal()  # the next word is a header
        self._write = Signal()  # configuration, at the end of this cycle
        self._address = Signal(8)
        self._events = {name: Signal(name=name) for name in COUNTERS}
        m.submodules.spi = self._spi = SpiWordPort(word_bits=self._word_bits, drop_partial=True)
        m.submodules.sequencer = self._sequencer = Sequencer(depth=self._depth)
        self._pending, self._lost = Signal(self._motors), Signal(self._motors)
        self._encoder_fault = Signal(max(self._encoders, 1))
        self._formers = [PulseFormer() for _ in range(self._motors)]
        self._number = Signal(range(2 * self._motors + 2))  # of the word to come in a move
        self._telling = Signal()  # it is one of a move
        self._moving = Signal()  # ... that is accepted
        self._ready = Signal()  # for the next tick
        # Configuration, as it is used.
        self._divider, self._control = Signal(8), Signal()
        m.submodules.deadlines = self._deadlines = Deadlines()
        self._one = {name: Signal(name=f"{name}_one") for name in TIMES}  # that time is one cycle
        self._step_polarity, self._dir_polarity = Signal(self._motors), Signal(self._motors)
        self._brake = Signal(self._motors)
        self._current = [
            Signal(CURRENT_BITS, name=f"current{n}") for n in range(self._motors * self._h_bridge)
        ]
        self._motion(m)
        self._ticks(m)
        self._configuration(m)
        self._encoder_blocks(m)
        self._halting(m)
        self._motors_blocks(m)
        if self._h_bridge:
            self._bridges(m)
        self._counters(m)
        self._replies(m)
        self._messages(m)
        return m

    def _cleared(self, bit: int) -> Value:
        """Return whether a bit of the clear register is written in this cycle."""
        return self._write & (self._address == reg.W_CLEAR) & self._spi.word[bit]

    def _latch(self, m: Module, latch: Value, event: Value, bit: int) -> None:
        """Set a latch at an event, and clear it with a bit of the clear register."""
        with m.If(event):
            m.d.sync += latch.eq(1)
        with m.Elif(self._cleared(bit)):
            m.d.sync += latch.eq(0)

    def _configuration(self, m: Module) -> None:
        """Add configuration registers."""
        self._stored: dict[int, Signal] = {}

        def register(address: int, bits: int, init: int = 0) -> Signal:
            value = Signal(bits, init=init, name=f"config{address:02x}")
            with m.If(self._write & (self._address == address)):
                m.d.sync += value.eq(self._spi.word)
            self._stored[address] = value
            return value

        m.d.comb += [
            self._brake.eq(register(reg.W_BRAKE, 32)),
            self.en.eq(register(reg.W_ENABLE, 32)),
            self._divider.eq(register(reg.W_DIVIDER, 32, reg.W_DIVIDER_RESET)),
            self._control.eq(register(reg.W_CONTROL, 1)),
            self._step_polarity.eq(register(reg.W_STEP_POLARITY, self._motors)),
            self._dir_polarity.eq(register(reg.W_DIR_POLARITY, self._motors)),
        ]
        for name, address in TIMES.items():
            value = register(address, TIMER_BITS, reg.W_STEP_WIDTH_RESET)
            m.d.comb += [
                self._one[name].eq(value[1:] == 0),
                getattr(self._deadlines, name).eq(Mux(value == 0, 1, value)),
            ]
        for address, current in zip(reg.W_CURRENT, self._current, strict=False):
            m.d.comb += current.eq(register(address, CURRENT_BITS))

    def _ticks(self, m: Module) -> None:
        """Add the tick divider."""
        m.submodules.ticks = ticks = TickDivider()
        m.d.comb += [
            ticks.divider.eq(self._divider),
            ticks.ready.eq(self._ready | ~self._sequencer.run),
            self._sequencer.tick.eq(ticks.tick),
        ]

    def _motion(self, m: Module) -> None:
        """Add DDAs, each with registers of its own, and the countdown of ticks."""
        spi, sequencer, number = self._spi, self._sequencer, self._number
        m.submodules.dda = dda = Dda(
            motors=self._motors, depth=self._depth, word_bits=self._word_bits
        )
        self._left = Signal(32)  # ticks of the executing move
        load_slot = Signal.like(sequencer.slot)
        duration = [Signal(32, name=f"duration{n}") for n in range(self._depth)]
        m.d.comb += [
            load_slot.eq(sequencer.slot + sequencer.run),
            dda.write.eq(spi.strobe & self._moving & (number[1:] != 0)),
            dda.write_slot.eq(sequencer.write_slot),
            dda.motor.eq(number[1:] - 1),
            dda.second.eq(number[0]),
            dda.word.eq(spi.word),
            dda.load.eq(sequencer.load),
            dda.load_slot.eq(load_slot),
            dda.integrate.eq(sequencer.integrate),
            dda.halted.eq(self._halted),
            sequencer.empty.eq(self._left == 0),
            sequencer.last.eq(self._left == 1),
            self._ready.eq(1),
        ]
        self._position = [dda.position[n] for n in range(self._motors)]
        for n, former in enumerate(self._formers):
            now, seen = self._position[n], Signal(2, name=f"seen{n}")
            m.d.sync += seen.eq(Mux(self._halted, now - former.excess, now))
            m.d.comb += [  # the difference is 1 or 3, or there is none
                former.moved.eq(now[0] ^ seen[0]),
                former.down.eq(now[1] ^ seen[1] ^ seen[0]),
                former.blocked.eq(self._halted),
                former.forget.eq(self._halted),
                dda.excess[n].eq(former.excess),
                self._pending[n].eq(former.owed != 0),
            ]
        with m.If(sequencer.integrate):
            m.d.sync += self._left.eq(self._left - 1)
        for n, value in enumerate(duration):
            with m.If(spi.strobe & self._moving & (number == 1) & (sequencer.write_slot == n)):
                m.d.sync += value.eq(spi.word)
            with m.If(sequencer.load & (load_slot == n)):
                m.d.sync += self._left.eq(value)

    def _encoder_blocks(self, m: Module) -> None:
        """Add encoders, and telemetry: their state at the start of the executing move."""
        self._encoder: list[Encoder] = []
        self._telemetry: list[Signal] = []
        update = ~self._sequencer.run | self._sequencer.load
        for n in range(self._encoders):
            m.submodules[f"encoder{n}"] = encoder = Encoder()
            self._encoder.append(encoder)
            m.d.comb += [encoder.a.eq(self.enc_a[n]), encoder.b.eq(self.enc_b[n])]
            self._latch(m, self._encoder_fault[n], encoder.fault, reg.W_CLEAR_ENCODER_FAULT_LSB)
            if n < self._motors:
                for value in (encoder.position, encoder.velocity):
                    register = Signal(32, name=f"telemetry{len(self._telemetry)}")
                    with m.If(update):
                        m.d.sync += register.eq(value)
                    self._telemetry.append(register)

    def _halting(self, m: Module) -> None:
        """Add the halt, and what remembers it."""
        pin = Signal(init=1)
        if self._halt_pin:
            m.submodules.halt = FFSynchronizer(self.halt, pin, init=1, reset_less=False)
        m.d.comb += [
            self._halted.eq(~pin | self._control),
            self._sequencer.halted.eq(self._halted),
            self.buffer_dtr.eq(
                (self._sequencer.used < self._depth) & ~self._halted & ~self._halt_seen
            ),
            self.move_done.eq(self._sequencer.done),
        ]
        self._latch(m, self._halt_seen, self._halted, reg.W_CLEAR_HALT_SEEN_LSB)

    def _motors_blocks(self, m: Module) -> None:
        """Add pulse formers, and what they lose."""
        deadlines = self._deadlines
        for n, former in enumerate(self._formers):
            m.submodules[f"pulse{n}"] = former
            for name in TIMES:
                end, one = f"{name}_end", f"{name}_one"
                m.d.comb += getattr(former, end).eq(getattr(deadlines, end))
                m.d.comb += getattr(former, one).eq(self._one[name])
            m.d.comb += [
                former.halted.eq(self._halted),
                former.now.eq(deadlines.now),
                self.step[n].eq(former.step ^ self._step_polarity[n]),
                self.dir[n].eq(former.dir ^ self._dir_polarity[n]),
            ]
            self._latch(m, self._lost[n], former.lost, reg.W_CLEAR_STEP_LOST_LSB)

    def _bridges(self, m: Module) -> None:
        """Add the drive of windings."""
        m.submodules.bridges = bridges = HBridges(motors=self._motors)
        phases = self._phases(m)
        with m.Switch(bridges.motor):
            for n, (phase, current) in enumerate(zip(phases, self._current, strict=True)):
                with m.Case(n):
                    m.d.comb += [bridges.phase.eq(phase), bridges.current.eq(current)]
        m.d.comb += [
            bridges.en.eq(self.en),
            bridges.brake.eq(self._brake),
            *(getattr(self, f"phase_{leg}").eq(getattr(bridges, leg)) for leg in LEGS),
        ]

    def _phases(self, m: Module) -> list[Value]:
        """Return the phase angles of motors."""
        return [position[:PHASE_BITS] for position in self._position]

    def _counters(self, m: Module) -> None:
        """Add counters of events."""
        self._counter = {name: Signal(COUNT_BITS, name=f"{name}_count") for name in COUNTERS}
        cleared = self._cleared(reg.W_CLEAR_COUNTERS_LSB)
        for name, count in self._counter.items():
            m.d.sync += count.eq(Mux(cleared, 0, count) + self._events[name])

    def _messages(self, m: Module) -> None:
        """Add what acts on words."""
        spi, sequencer, number = self._spi, self._sequencer, self._number
        last_word = 2 * self._motors + 1
        message = Signal(Message)
        header, address = spi.word[-8:], spi.word[:8]
        m.d.comb += [
            *(getattr(spi, name).eq(getattr(self, name)) for name in ("cs", "sck", "copi")),
            *(getattr(self, name).eq(getattr(spi, name)) for name in ("cipo", "cipo_oe")),
            self._idle.eq(message == Message.IDLE),
            self._write.eq(spi.strobe & (message == Message.SWAP)),
            self._events["completed"].eq(sequencer.finish),
            self._events["framing"].eq(spi.ended & spi.partial),
            self._telling.eq(message == Message.MOVE),
            self._moving.eq(self._telling & self._accept),
        ]
        with m.If(spi.strobe):
            self._reply_nothing(m)
            with m.Switch(message):
                with m.Case(Message.IDLE):
                    m.d.sync += [number.eq(1), self._address.eq(address)]
                    self._header(m, message, header, address)
                with m.Case(Message.MOVE):
                    m.d.sync += number.eq(number + 1)
                    with m.If(number == last_word):
                        m.d.sync += message.eq(Message.IDLE)
                        m.d.comb += [
                            sequencer.arm.eq(self._accept & ~self._halted),
                            self._events["refused"].eq(~sequencer.arm),
                        ]
                    with m.Else():
                        self._reply_telemetry(m)
                with m.Default():
                    m.d.sync += message.eq(Message.IDLE)
        if self._cs_reset_message:
            with m.If(spi.ended & (message != Message.IDLE)):
                m.d.sync += message.eq(Message.IDLE)
                m.d.comb += self._events["aborted"].eq(1)
                self._reply_nothing(m)
        with m.If(self._halted):
            m.d.sync += self._accept.eq(0)

    def _header(self, m: Module, message: Signal, header: Value, address: Value) -> None:
        """Add what acts on a header."""
        with m.Switch(header):
            with m.Case(reg.HEADER_NOP):
                pass
            with m.Case(reg.HEADER_MOVE):
                m.d.sync += [message.eq(Message.MOVE), self._accept.eq(self.buffer_dtr)]
                self._snapshot(m)
            with m.Case(reg.HEADER_STATUS_READ):
                m.d.sync += message.eq(Message.IGNORED)
                self._reply_status(m, address)
            with m.Case(reg.HEADER_CONFIG_SWAP, reg.HEADER_CONFIG_READ):
                m.d.sync += message.eq(
                    Mux(header == reg.HEADER_CONFIG_SWAP, Message.SWAP, Message.IGNORED)
                )
                self._reply_configuration(m, address)
            if self._v020_info:
                self._header_v020(m, message)
            with m.Default():
                m.d.sync += message.eq(Message.IGNORED)
                m.d.comb += self._events["unknown"].eq(1)

    def _header_v020(self, m: Module, message: Signal) -> None:
        """Add headers of the original 0.2."""
        with m.Case(reg.HEADER_V020_CHANNEL_INFO):
            m.d.sync += self._reply.eq(self._channel_info)
        with m.Case(reg.HEADER_V020_VERSION):
            m.d.sync += [message.eq(Message.IGNORED), self._reply.eq(reg.VERSION_V020)]
        with m.Case(reg.HEADER_V020_ENCODER):
            m.d.sync += message.eq(Message.IGNORED)
            with m.Switch(self._spi.word[48:56]):
                for n, encoder in enumerate(self._encoder):
                    with m.Case(n):
                        m.d.sync += self._reply.eq(Cat(encoder.position, encoder.velocity))

    def _replies(self, m: Module) -> None:
        """Add the reply, and the telemetry of the open message."""
        self._reply = Signal(self._word_bits)
        self._open = Signal(32 * max(len(self._telemetry), 1))
        m.d.comb += self._spi.reply.eq(self._reply.word_select(self._spi.byte, 8))

    def _reply_nothing(self, m: Module) -> None:
        m.d.sync += self._reply.eq(0)

    def _snapshot(self, m: Module) -> None:
        m.d.sync += self._open.eq(Cat(self._telemetry))

    def _reply_telemetry(self, m: Module) -> None:
        m.d.sync += [self._open.eq(self._open >> 32), self._reply.eq(self._open[:32].as_signed())]

    def _reply_status(self, m: Module, address: Value) -> None:
        with m.Switch(address):
            for place, value in self._status().items():
                with m.Case(place):
                    m.d.sync += self._reply.eq(value)

    def _reply_configuration(self, m: Module, address: Value) -> None:
        with m.Switch(address):
            for place, value in self._stored.items():
                with m.Case(place):
                    m.d.sync += self._reply.eq(value)

    def _flags(self) -> dict[int, Value]:
        """Return status registers of flags, by address."""
        sequencer, faults = self._sequencer, self._encoder_fault
        return {
            reg.R_ENCODER_FAULT: faults,
            reg.R_ENCODER_FAULT_HI: faults[32:],
            reg.R_MOTOR_FAULT: self._lost,
            reg.R_BUFFER_STATE: Cat(
                sequencer.used,
                Const(0, 8 - len(sequencer.used)),
                Const(self._depth, 8),
                sequencer.run,
                self._halted,
                self._halt_seen,
            ),
            reg.R_STEP_LOST: self._lost,
            reg.R_PULSES_PENDING: self._pending,
        }

    def _constants(self) -> dict[int, int]:
        """Return status registers that never change, by address."""
        return {
            reg.R_VERSION: reg.VERSION,
            reg.R_CHANNEL_INFO: self._channel_info,
            reg.R_BUILD_PARAMETERS: self._word_bits
            | reg.INTEGER_BITS << reg.R_BUILD_PARAMETERS_INTEGER_BITS_LSB
            | self._h_bridge << reg.R_BUILD_PARAMETERS_MOTOR_DRIVER_LSB,
            reg.R_BUILD_ID: reg.BUILD_ID,
        }

    def _status(self) -> dict[int, Value]:
        """Return all status registers by address; signed ones as signed values."""
        found = self._flags()
        found |= {address: Const(value, 32) for address, value in self._constants().items()}
        found |= {address: self._counter[name] for name, address in COUNTERS.items()}
        found[reg.R_TICKS_LEFT] = Mux(self._sequencer.run, self._left, 0)
        for n, encoder in enumerate(self._encoder):
            found[reg.R_ENCODER_POSITION[n]] = encoder.position.as_signed()
            found[reg.R_ENCODER_VELOCITY[n]] = encoder.velocity.as_signed()
        for n in range(self._motors):
            found[reg.R_PHASE_ANGLE[n]] = self._position[n][:10]
            found[reg.R_STEP_POSITION[n]] = self._position[n].as_signed()
        return found
