"""Dual H-bridge outputs: two windings per motor, microstepped by pulse width from a sine table.

Time is in frames of `FRAME` cycles. Of each motor, the phase is looked at once in a frame, and a
table of a quarter wave and an adder, shared by all, make the on-times of its two windings from it,
a winding in 8 cycles. They hold for a whole PWM period, which is a frame of its own, `LATENCY`
cycles late. So a pulse is never cut or joined to another by a motor that moves.
"""

from __future__ import annotations

from itertools import pairwise
from math import pi, sin
from typing import Final

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import Component, In, Out

from pulsewright.boards.rapcores import registers as reg

FRAME: Final = reg.PWM_CYCLES
LATENCY: Final = 2  # cycles from the last table look-up of a frame to the period it is for
PHASE_BITS: Final = 10
CURRENT_BITS: Final = 8
QUARTER_BITS: Final = PHASE_BITS - 2
SINE_BITS: Final = reg.SINE_AMPLITUDE.bit_length()
ON_BITS: Final = FRAME.bit_length() - 1
SLOTS: Final = FRAME >> 4  # of motors in a frame
# Bits of a product below those of an on-time; a half is added, then they are cut off.
CUT_BITS: Final = SINE_BITS + CURRENT_BITS - ON_BITS
# Of sine and cosine, at the middle of a microstep: the quarters mirror each other, without a value
# of their own at the turns.
QUARTER_WAVE: Final = tuple(
    round(reg.SINE_AMPLITUDE * sin(2 * pi * (n + 0.5) / (1 << PHASE_BITS)))
    for n in range(1 << QUARTER_BITS)
)
LEGS: Final = ("a1", "a2", "b1", "b2")


class HBridges(Component):
    """Drives the windings A and B of motors, each by two half bridges.

    A pair of legs is the two logic inputs of an integrated bridge, which keeps its own transistors
    from conducting together: 1, 0 drives the winding forwards, 0, 1 backwards; 1, 1 has both ends
    at the low side (brake, slow decay), 0, 0 is open (coast). A winding is driven for

        on = (round(4095 sin(2 pi (phase + 1/2) / 1024)) current + 1024) // 2048

    cycles of 512, with the cosine for B, around the middle of the period: from cycle
    256 - on // 2 of it on. For the rest of the period it is braked.

    Parameters
    ----------
    motors : int
        1 to 32.

    Members
    -------
    motor : Out(range(motors))
        Of which phase and current are sampled; motor n in cycle 512 - 16 (motors - n) of a frame.
        The period that begins in cycle 2 of the next frame is made from them; the legs are a cycle
        later.
    phase : In(10)
        1024 to an electrical cycle.
    current : In(8)
        Amplitude; 0: not driven.
    en, brake : In(motors)
        Without ``en``, legs are all as ``brake`` says, a cycle later: 1 or 0.
    a1, a2, b1, b2 : Out(motors)
    """

    def __init__(self, *, motors: int) -> None:
        self._motors = motors
        super().__init__(
            {
                "motor": Out(range(motors)),
                "phase": In(PHASE_BITS),
                "current": In(CURRENT_BITS),
                "en": In(motors),
                "brake": In(motors),
                **{leg: Out(motors) for leg in LEGS},
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        clock = Signal(range(FRAME))
        m.d.sync += clock.eq(clock + 1)
        with m.Switch(clock[4:]):
            for n in range(self._motors):
                with m.Case(SLOTS - self._motors + n):
                    m.d.comb += self.motor.eq(n)
        following = self._on_times(m, clock)

        # A carrier that is below an on-time for so many cycles, around the middle: 511, 509 .. 1,
        # 0, 2 .. 510.
        position, carrier = Signal.like(clock), Signal(ON_BITS)
        m.d.comb += [
            position.eq(clock - LATENCY),
            carrier.eq(Cat(~position[-1], Mux(position[-1], position, ~position)[:-1])),
        ]
        for n, following_on in enumerate(following):
            motor, first, second = n >> 1, *(getattr(self, leg) for leg in LEGS[n % 2 * 2 :][:2])
            now = Signal.like(following_on, name=f"now{n}")
            with m.If(clock == LATENCY - 1):
                m.d.sync += now.eq(following_on)
            driven, negative = carrier < now[:-1], now[-1]
            en, brake = self.en[motor], self.brake[motor]
            m.d.sync += [
                first[motor].eq(Mux(en, ~(driven & negative), brake)),
                second[motor].eq(Mux(en, ~(driven & ~negative), brake)),
            ]
        return m

    def _on_times(self, m: Module, clock: Value) -> list[Signal]:
        """Add what makes on-times; return them and above them the sign, of A, B of motor 0, ..."""
        m.submodules.sine = memory = Memory(
            shape=SINE_BITS,
            depth=1 << QUARTER_BITS,
            init=QUARTER_WAVE,
            attrs={"ram_style": "block"},
        )
        sine = memory.read_port()
        # In the first of 8 cycles the table is read, and the winding before is done.
        first, winding_b = clock[:3] == 0, clock[3]
        held, phase = Signal(PHASE_BITS), Signal(PHASE_BITS)
        bits = Signal(CURRENT_BITS)  # of the current, the one whose turn it is lowest
        negative = Signal()
        m.d.comb += [
            phase.eq(Mux(winding_b, held, self.phase)),
            sine.addr.eq(phase[:QUARTER_BITS] ^ (phase[-2] ^ winding_b).replicate(QUARTER_BITS)),
            sine.en.eq(first),
        ]
        m.d.sync += bits.eq(bits.rotate_right(1))
        with m.If(first):
            m.d.sync += [held.eq(phase), negative.eq(phase[-1] ^ (phase[-2] & winding_b))]
            with m.If(~winding_b):
                m.d.sync += bits.eq(self.current)
        # Product of sine and current, from the lowest bit of the current on.
        half = 1 << (CUT_BITS - 1)
        product, total = Signal(SINE_BITS), Signal(SINE_BITS + 1)  # nothing before the first frame
        m.d.comb += total.eq(product + Mux(bits[0], sine.data, 0))
        m.d.sync += product.eq(Mux(first, half, total >> 1))
        # The last on-times of a frame are those of the motors.
        chain = [Signal(ON_BITS + 1, name=f"following{n}") for n in range(2 * self._motors)]
        with m.If(first):
            m.d.sync += chain[-1].eq(Cat(total[-ON_BITS:], negative))
            m.d.sync += [old.eq(new) for old, new in pairwise(chain)]
        return chain
