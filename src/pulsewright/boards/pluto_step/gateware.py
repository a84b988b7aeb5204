"""Gateware of the board: bus, registers, four step generators, watchdog, pins."""

from __future__ import annotations

from typing import Final

from amaranth import Module, Mux, Signal, signed
from amaranth.lib.wiring import Component, In, Out

from pulsewright.boards.pluto_step import registers
from pulsewright.gateware.arithmetic import decrement
from pulsewright.gateware.epp import EppPort
from pulsewright.gateware.register_bank import WriteBank
from pulsewright.gateware.step_rate import PhaseAccumulator
from pulsewright.gateware.watchdog import Watchdog

AXES: Final = len(registers.R_POSITION)
VELOCITY_BITS: Final = registers.W_VELOCITY_VALUE_MASK.bit_length()
POSITION_BITS: Final = registers.R_POSITION_VALUE_MASK.bit_length()
STEP_BIT: Final = registers.UNITS_PER_STEP.bit_length() - 1  # toggles once per step at tap 0


class StepGenerator(Component):
    """One axis: position, step pulses, and the direction change with its hold and set-up time.

    Only ticks change anything. The step bit of ``position`` is bit 11 + ``tap``; a step is pending
    while it differs from what it was at the step before.

    Members
    -------
    tick : In(1)
        High in the cycle that ends with a tick.
    velocity : In(signed(12))
        Added to ``position`` at every tick, unless the direction must change first [2^-11 step at
        tap 0]. Its sign is the direction; 0 is positive.
    steptime : In(4)
        STEP is high for this many ticks and one more; sampled as it rises.
    dirtime : In(4)
        Direction hold and set-up time [tick]; sampled as each of them starts.
    tap : In(2)
        Speed range.
    position : Out(21)
        Where the axis has been told to be; wraps.
    step, dir : Out(1)
        Step rises one tick after the position that demands it. Dir is 1 for negative motion.
    """

    def __init__(self) -> None:
        super().__init__(
            {
                "tick": In(1),
                "velocity": In(signed(VELOCITY_BITS)),
                "steptime": In(4),
                "dirtime": In(4),
                "tap": In(2),
                "position": Out(POSITION_BITS),
                "step": Out(1),
                "dir": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.phase = phase = PhaseAccumulator(
            width=POSITION_BITS, velocity_width=VELOCITY_BITS
        )
        timer = Signal(4)  # ticks until the present pulse, hold or set-up time has passed
        # Neither is the run mode of the specification. Holding survives a reversal that is
        # cancelled, so that the next reversal skips its hold time: a quirk of the original.
        holding = Signal()
        setting_up = Signal()
        last = Signal()  # step bit at the last step

        step_bit = self.position[STEP_BIT : STEP_BIT + 4].bit_select(self.tap, 1)
        reverse = self.velocity[-1] ^ self.dir
        pending = step_bit ^ last
        turn = reverse & ~pending
        start = pending & ~setting_up

        m.d.comb += [
            phase.run.eq(self.tick & ~reverse & ~setting_up),
            phase.velocity.eq(self.velocity),
            self.position.eq(phase.position),
        ]
        with m.If(self.tick):
            with m.If(timer != 0):
                m.d.sync += timer.eq(decrement(timer))
            with m.Else():
                m.d.sync += [
                    timer.eq(Mux(turn, self.dirtime, Mux(start, self.steptime, 0))),
                    setting_up.eq(turn & holding),
                    holding.eq(holding ^ turn),
                    self.dir.eq(self.dir ^ (turn & holding)),
                    last.eq(Mux(setting_up, last, step_bit)),
                    self.step.eq(
                        Mux(turn, holding & self.step, Mux(setting_up, self.step, pending))
                    ),
                ]
        return m


class ReadLatch(Component):
    """All bytes of one register, taken at one clock edge, and driven one at a time."""

    def __init__(self) -> None:
        super().__init__(
            {
                "read": In(1),
                "address": In(5),
                "positions": In(POSITION_BITS).array(AXES),
                "din": In(16),
                "rdata": Out(8),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        latch = Signal(32)
        with m.If(self.read), m.Switch(self.address):
            for address, position in zip(registers.R_POSITION, self.positions, strict=True):
                with m.Case(address):
                    m.d.sync += latch.eq(position)
            with m.Case(registers.R_INPUTS):
                m.d.sync += latch.eq(self.din)
        # The address has moved on by the time the byte is driven.
        m.d.comb += self.rdata.eq(latch.word_select((self.address - 1)[:2], 8))
        return m


class PlutoStep(Component):
    """The board."""

    def __init__(self) -> None:
        super().__init__(
            {
                "nwrite": In(1),
                "ndatastr": In(1),
                "naddrstr": In(1),
                "nreset": In(1),
                "data_i": In(8),
                "data_o": Out(8),
                "data_oe": Out(1),
                "nwait": Out(1),
                "nconfig": Out(1),
                "din": In(16),
                "step": Out(AXES),
                "dir": Out(AXES),
                "dout": Out(14),
                "led": Out(1),
                "tristate": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.epp = epp = EppPort()
        m.submodules.bank = bank = WriteBank(
            registers.MAP, present=("VELOCITY", "OUTPUTS", "TIMING"), stray_addresses=range(32)
        )
        m.submodules.latch = latch = ReadLatch()
        m.submodules.watchdog = watchdog = Watchdog(ticks=registers.WATCHDOG_TICKS)

        time = Signal(range(registers.WATCHDOG_CYCLES))
        tick = Signal()
        m.d.sync += time.eq(time + 1)
        m.d.comb += tick.eq(time % registers.TICK_CYCLES == 0)

        m.d.comb += [
            epp.nwrite.eq(self.nwrite),
            epp.ndatastr.eq(self.ndatastr),
            epp.naddrstr.eq(self.naddrstr),
            epp.data_i.eq(self.data_i),
            self.data_o.eq(epp.data_o),
            self.data_oe.eq(epp.data_oe),
            self.nwait.eq(epp.nwait),
            self.nconfig.eq(self.nreset),
            bank.write.eq(epp.write),
            bank.address.eq(epp.address),
            bank.data.eq(epp.wdata),
            latch.read.eq(epp.read),
            latch.address.eq(epp.address),
            latch.din.eq(self.din),
            epp.rdata.eq(latch.rdata),
        ]
        arm = bank.outputs_commit & bank.word[registers.W_OUTPUTS_WATCHDOG_ARM_LSB]
        enabled = Signal()
        with m.If(arm):
            m.d.sync += enabled.eq(1)
        m.d.comb += [
            watchdog.tick.eq(time == registers.WATCHDOG_CYCLES - 1),
            watchdog.feed.eq(arm),
            self.tristate.eq(enabled & watchdog.expired),
            self.dout.eq(bank.outputs.levels),
        ]
        for n in range(AXES):
            m.submodules[f"axis{n}"] = axis = StepGenerator()
            m.d.comb += [
                axis.tick.eq(tick),
                axis.velocity.eq(bank.velocity[n].value),
                axis.steptime.eq(bank.timing.steptime),
                axis.dirtime.eq(bank.timing.dirtime),
                axis.tap.eq(bank.timing.tap),
                latch.positions[n].eq(axis.position),
                self.step[n].eq(axis.step ^ bank.timing.polarity),
                self.dir[n].eq(axis.dir),
            ]
            if n == 0:
                m.d.comb += self.led.eq(axis.step ^ axis.dir)
        return m
