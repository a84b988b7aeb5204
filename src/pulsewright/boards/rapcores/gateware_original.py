"""The original controllers: profiles ``upstream`` and ``v020``.

Section 4.7 and appendix A of the specification, with what is not known as 0.
"""

from __future__ import annotations

from typing import Final

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib.wiring import Component, In, Out

from pulsewright.boards.rapcores import registers as reg
from pulsewright.boards.rapcores.gateware_encoder import Encoder
from pulsewright.gateware.spi import SpiWordPort

WORD_BITS: Final = 64
FRACTION_BITS: Final = 63  # of an accumulator of `upstream`
ADDRESS_BITS: Final = 33  # of a read
SLOTS: Final = 2
MAPPED: Final = (reg.W_ENABLE, reg.W_BRAKE, reg.W_DIVIDER)
# What `v020` takes off an accumulator that is positive, at a tick without a move.
PAUSE_STEP: Final = (1 << 63) - 101


class OriginalCore(Component):
    """All of the board but its reset.

    Parameters
    ----------
    motors, encoders, position_bits : see `Rapcores`
    v020 : bool
        Profile ``v020``, otherwise ``upstream``.
    fixed : bool
        Switch of ``upstream``.

    Members
    -------
    cs, sck, copi, halt : In(1), enc_a, enc_b : In(encoders)
        Pins, asynchronous.
    cipo, cipo_oe, buffer_dtr, move_done : Out(1), step, dir, en : Out(motors)
    """

    def __init__(
        self, *, motors: int, encoders: int, position_bits: int, v020: bool, fixed: bool
    ) -> None:
        self._motors, self._encoders, self._position_bits = motors, encoders, position_bits
        self._v020, self._fixed = v020, fixed
        super().__init__(
            {
                **{name: In(1) for name in ("cs", "sck", "copi", "halt")},
                **{name: In(encoders) for name in ("enc_a", "enc_b")},
                **{name: Out(1) for name in ("cipo", "cipo_oe", "buffer_dtr", "move_done")},
                **{name: Out(motors) for name in ("step", "dir", "en")},
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.spi = spi = self._spi = SpiWordPort(word_bits=WORD_BITS, drop_partial=False)
        m.d.comb += [
            *(getattr(spi, name).eq(getattr(self, name)) for name in ("cs", "sck", "copi")),
            *(getattr(self, name).eq(getattr(spi, name)) for name in ("cipo", "cipo_oe")),
        ]
        self._encoder_blocks(m)
        # A move in a slot: direction, duration, and an increment and its increment per motor.
        self._word = Signal(range(2 * self._motors + 2))  # of the open move
        self._moving = Signal()  # a move is open
        self._arm, self._write_slot = Signal(), Signal()
        self._directions = [Signal(self._motors, name=f"direction{s}") for s in range(SLOTS)]
        self._slots = [
            [Signal(WORD_BITS, name=f"slot{s}_{k}") for k in range(1, 2 * self._motors + 2)]
            for s in range(SLOTS)
        ]
        self._configuration = {
            reg.W_ENABLE: Signal(32, name="enable"),
            reg.W_BRAKE: Signal(32, name="brake"),
            reg.W_DIVIDER: Signal(32, init=reg.W_DIVIDER_RESET, name="divider"),
        }
        m.d.comb += self.en.eq(self._configuration[reg.W_ENABLE])
        self._motion(m)
        self._messages(m)
        return m

    def _encoder_blocks(self, m: Module) -> None:
        self._encoder: list[Encoder] = []
        self._healthy = Signal(self._encoders, init=(1 << self._encoders) - 1)
        for n in range(self._encoders):
            encoder = Encoder(primed=False, velocity_reset=not self._v020)
            m.submodules[f"encoder{n}"] = encoder
            self._encoder.append(encoder)
            m.d.comb += [encoder.a.eq(self.enc_a[n]), encoder.b.eq(self.enc_b[n])]
            with m.If(encoder.fault):
                m.d.sync += self._healthy[n].eq(0)

    def _motion(self, m: Module) -> None:
        """Add tick divider, sequencer and DDA, with the tick races of the original."""
        divider = self._configuration[reg.W_DIVIDER][:8]
        count, level, before = Signal(8), Signal(), Signal(2)
        m.d.comb += level.eq(count == divider)
        m.d.sync += [count.eq(Mux(level, 0, count + 1)), before.eq(Cat(level, before))]

        ready, finished, slot = Signal(SLOTS), Signal(SLOTS), Signal()
        self._idle = Signal(init=1)
        left, pending, execute = Signal(32), Signal(), Signal()
        waiting = ready ^ finished
        m.d.comb += [
            pending.eq(waiting.bit_select(slot, 1)),
            execute.eq(~self._idle & pending),
            self.buffer_dtr.eq(~waiting.all()),
            self.dir.eq(Mux(slot, self._directions[1], self._directions[0])),
        ]
        with m.If(self._arm):
            m.d.sync += [
                ready.eq(ready ^ Mux(self._write_slot, 2, 1)),
                self._write_slot.eq(~self._write_slot),
            ]
        words = [Mux(slot, one, zero) for zero, one in zip(*self._slots, strict=True)]
        load = self._idle & pending
        with m.If(load):
            m.d.sync += [left.eq(words[0]), self._idle.eq(0)]
        with m.If(execute & before[0] & ~before[1]):
            m.d.sync += left.eq(left - 1)
        with m.If(execute & (left == 0)):
            m.d.sync += [
                self._idle.eq(1),
                self.move_done.eq(~self.move_done),
                slot.eq(~slot),
                finished.eq(finished ^ Mux(slot, 2, 1)),
            ]
        rise = level & ~before[0]
        self._phases = [
            self._motor(m, n, words[1 + 2 * n], words[2 + 2 * n], load, rise, execute)
            for n in range(self._motors)
        ]

    def _motor(
        self,
        m: Module,
        motor: int,
        increment: Value,
        second: Value,
        load: Value,
        rise: Value,
        execute: Value,
    ) -> Value:
        """Add one DDA; return its phase angle."""
        inc = Signal(WORD_BITS, name=f"inc{motor}")
        bits = WORD_BITS if self._v020 else FRACTION_BITS + reg.INTEGER_BITS
        accumulator = Signal(bits, name=f"accumulator{motor}")
        with m.If(rise & execute):
            m.d.sync += [
                accumulator.eq(accumulator + inc.as_signed()),
                inc.eq(inc + (second if self._v020 or self._fixed else increment)),
            ]
        with m.If(load):
            m.d.sync += inc.eq(increment)
        if self._v020:
            positive = ~accumulator[-1] & (accumulator != 0)
            with m.If(rise):
                m.d.sync += self.step[motor].eq(positive)
                with m.If(~execute & positive):
                    m.d.sync += accumulator.eq(accumulator - PAUSE_STEP)
            return Const(0)
        if self._fixed:
            m.d.comb += self.step[motor].eq(accumulator[FRACTION_BITS - 1])
        return accumulator[FRACTION_BITS:][:10]

    def _messages(self, m: Module) -> None:
        """Add what acts on words and replies."""
        spi = self._spi
        header, word = spi.word[-8:], spi.word
        reply = Signal(WORD_BITS)
        last_word = 2 * self._motors + 1
        ignored, swapped, address = Signal(), Signal(), Signal(8)
        m.d.comb += spi.reply.eq(reply.word_select(spi.byte, 8))
        telemetry = self._telemetry(m)
        with m.If(spi.strobe):
            m.d.sync += [reply.eq(0), ignored.eq(0), swapped.eq(0)]
            with m.If(self._moving):
                m.d.sync += self._word.eq(self._word + 1)
                with m.Switch(self._word):
                    for k in range(1, last_word + 1):
                        with m.Case(k):
                            m.d.sync += reply.eq(telemetry[k - 1])
                            for s in range(SLOTS):
                                with m.If(self._write_slot == s):
                                    m.d.sync += self._slots[s][k - 1].eq(word)
                with m.If(self._word == last_word):
                    m.d.sync += self._moving.eq(0)
                    m.d.comb += self._arm.eq(1)
            with m.Elif(swapped), m.Switch(address):
                for place, value in self._configuration.items():
                    with m.Case(place):
                        m.d.sync += value.eq(word)
            with m.Elif(~ignored):
                m.d.sync += address.eq(word)
                with m.If(header == reg.HEADER_MOVE):
                    m.d.sync += [self._moving.eq(1), self._word.eq(1)]
                    for s in range(SLOTS):
                        with m.If(self._write_slot == s):
                            m.d.sync += self._directions[s].eq(word)
                if self._v020:
                    self._header_v020(m, header, word, reply, ignored)
                else:
                    self._header(m, header, word, reply, ignored, swapped)

    def _telemetry(self, m: Module) -> list[Value]:
        """Return the replies to the words of a move, from word 1 on."""
        found: list[Value] = []
        for n in range(max(self._motors + 1, self._encoders)):
            position, velocity = Signal(32, name=f"position{n}"), Signal(32, name=f"velocity{n}")
            if n < self._encoders:
                encoder = self._encoder[n]
                if self._v020:  # as at the header
                    opening = self._spi.strobe & ~self._moving
                    with m.If(opening):
                        m.d.sync += position.eq(encoder.position[: self._position_bits])
                else:
                    with m.If(self._idle):
                        m.d.sync += [
                            position.eq(encoder.position),
                            velocity.eq(encoder.velocity),
                        ]
            if self._v020:
                found += [Const(0, 1), position if n < self._motors else Const(0, 1)]
            else:
                found += [position.as_signed(), velocity.as_signed()]
        return found

    def _header(
        self, m: Module, header: Value, word: Value, reply: Signal, ignored: Signal, swapped: Signal
    ) -> None:
        """Add what acts on other headers of 0.3."""
        with m.Switch(header):
            with m.Case(reg.HEADER_NOP, reg.HEADER_MOVE):
                pass
            with m.Case(reg.HEADER_STATUS_READ):
                m.d.sync += ignored.eq(1)
                with m.Switch(word[:ADDRESS_BITS]):
                    for place, value in self._status().items():
                        with m.Case(place):
                            m.d.sync += reply.eq(value)
            with m.Case(reg.HEADER_CONFIG_SWAP):
                m.d.sync += swapped.eq(1)
                with m.Switch(word[:ADDRESS_BITS]):
                    for place, value in self._configuration.items():
                        with m.Case(place):
                            m.d.sync += reply.eq(value)
            with m.Default():
                m.d.sync += ignored.eq(1)

    def _status(self) -> dict[int, Value]:
        """Return status registers by address; signed ones as signed values."""
        found: dict[int, Value] = {
            reg.R_VERSION: Const(reg.VERSION, 32),
            reg.R_CHANNEL_INFO: Const(self._channel_info, 32),
            reg.R_ENCODER_FAULT: self._healthy,
        }
        for n, encoder in enumerate(self._encoder):
            position, velocity = encoder.position.as_signed(), encoder.velocity.as_signed()
            if self._fixed:
                found[reg.R_ENCODER_POSITION[n]] = position
                found[reg.R_ENCODER_VELOCITY[n]] = velocity
            else:  # both drive the same lines; those that they drive apart are not known
                found[reg.R_ENCODER_POSITION[n]] = position & velocity
        first = reg.R_PHASE_ANGLE if self._fixed else reg.R_ENCODER_VELOCITY
        return found | {first[n]: phase for n, phase in enumerate(self._phases)}

    @property
    def _channel_info(self) -> int:
        of_the_build = self._position_bits << 16 | self._encoders << 8 | self._motors
        return reg.R_CHANNEL_INFO_RESET & ~0xFFFFFF | of_the_build

    def _header_v020(
        self, m: Module, header: Value, word: Value, reply: Signal, ignored: Signal
    ) -> None:
        """Add what acts on other headers of 0.2."""
        motors, configuration = self._motors, self._configuration
        with m.Switch(header):
            with m.Case(reg.HEADER_V020_ENCODER):
                m.d.sync += ignored.eq(1)
                with m.Switch(word[48:56]):
                    for n, encoder in enumerate(self._encoder):
                        with m.Case(n):
                            position = encoder.position[: self._position_bits]
                            m.d.sync += reply.eq(Cat(position, encoder.velocity))
            with m.Case(reg.HEADER_V020_ENABLE):
                m.d.sync += configuration[reg.W_ENABLE].eq(word[:motors])
            with m.Case(reg.HEADER_V020_BRAKE):
                m.d.sync += configuration[reg.W_BRAKE].eq(word[:motors])
            with m.Case(reg.HEADER_V020_DIVIDER):
                m.d.sync += configuration[reg.W_DIVIDER].eq(word[:8])
            with m.Case(reg.HEADER_V020_MOTOR_FAULT):
                m.d.sync += ignored.eq(1)
            with m.Case(reg.HEADER_V020_ENCODER_FAULT):
                m.d.sync += [ignored.eq(1), reply.eq((~self._healthy)[: self._encoders])]
            with m.Case(reg.HEADER_V020_CHANNEL_INFO):
                m.d.sync += reply.eq(self._channel_info)
            with m.Case(reg.HEADER_V020_VERSION):
                m.d.sync += [ignored.eq(1), reply.eq(reg.VERSION_V020)]
