"""Gateware of the board: bus, registers, step generators, watchdog and pins.

Written from the clock-by-clock rules of the original controller. What it does between two ticks,
where nobody can see it, is its own: it uses the 63 cycles to work bit by bit, which is small.
"""

from __future__ import annotations

from typing import Final

from amaranth import Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib.wiring import Component, In, Out

from pulsewright.boards.pluto_step import registers
from pulsewright.gateware.arithmetic import choose, decrement
from pulsewright.gateware.divider import Divider
from pulsewright.gateware.epp import EppPort
from pulsewright.gateware.register_bank import WriteBank
from pulsewright.gateware.serial_timer import SerialTimer
from pulsewright.gateware.step_rate import PhaseAccumulator
from pulsewright.gateware.watchdog import Watchdog

AXES: Final = len(registers.R_POSITION)
POSITION_BITS: Final = registers.R_POSITION_VALUE_MASK.bit_length()
VELOCITY_BITS: Final = registers.W_VELOCITY_VALUE_MASK.bit_length()
STEP_BIT: Final = registers.UNITS_PER_STEP.bit_length() - 1  # toggles once per step at tap 0
TAPS: Final = 4
TIME_BITS: Final = 4  # of steptime, dirtime and space


class StepGenerator(Component):
    """One axis: position, step pulses, and changes of direction with their hold and set-up time.

    Only ticks change anything that can be seen. The step bit is bit ``11 + tap`` of the position; a
    step is pending while it differs from what it was at the last step.

    Parameters
    ----------
    clean_cancel : bool
        A reversal that is cancelled during its hold time ends that time. Otherwise, as on the
        original, the next reversal skips its hold time and DIR may change while STEP is high.
    enforce_space : bool
        Keep a space after each pulse and notice missed steps. Otherwise, as on the original, pulses
        merge above the speed limit.

    Members
    -------
    tick : In(1)
        High in the cycle that ends with a tick.
    velocity : In(signed(12))
        Added to the position at every tick, unless the direction must change first [2^-11 step at
        tap 0]. Its sign is the direction; 0 is positive.
    shift : In(1)
        High in four cycles after each tick, in which these two pass, lowest bit first:
    steptime : In(1)
        Step is high for this many ticks and one more; the value at the tick at which it rises.
    dirtime : In(1)
        Direction hold and set-up time [tick]; the value at the tick at which each starts.
    next_tap : In(2)
        Speed range, as it is after this edge.
    drop : In(1)
        ``next_tap`` differs from the tap before: forget a step that is pending, and make none for
        the change.
    moved_tap : In(1)
        ``next_tap`` differs from the tap before, so a step that is pending may be none.
    space : In(4)
        With ``enforce_space``: step is low for this many ticks and one more.
    position : Out(21)
        Wraps.
    step, dir : Out(1)
        Step rises one tick after the position that demands it. Dir is 1 for negative motion.
    missed : Out(1)
        With ``enforce_space``: high in a cycle that ends with a tick at which two steps vanished.
    """

    def __init__(self, *, clean_cancel: bool = False, enforce_space: bool = False) -> None:
        self._clean_cancel = clean_cancel
        self._enforce_space = enforce_space
        super().__init__(
            {
                "tick": In(1),
                "velocity": In(signed(VELOCITY_BITS)),
                "shift": In(1),
                "steptime": In(1),
                "dirtime": In(1),
                "next_tap": In(range(TAPS)),
                "drop": In(1),
                "moved_tap": In(1),
                "space": In(TIME_BITS),
                "position": Out(POSITION_BITS),
                "step": Out(1),
                "dir": Out(1),
                "missed": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.phase = phase = PhaseAccumulator(
            width=POSITION_BITS, velocity_width=VELOCITY_BITS
        )
        m.submodules.timer = timer = SerialTimer(width=TIME_BITS)
        # Modes of the specification; RUN is neither. HOLD stays, timer or not, until the direction
        # flips; on the original also when the reversal is cancelled.
        holding, setting_up = Signal(), Signal()
        last = Signal()  # step bit at the last step
        pending = Signal()  # registered, as it can only change long before a tick, or with the tap
        loads_steptime, loads_dirtime = Signal(), Signal()

        step_bit = choose(self.next_tap, self.position[STEP_BIT : STEP_BIT + TAPS])
        m.d.sync += pending.eq((step_bit ^ last) & ~self.drop)

        reverse = self.velocity[-1] ^ self.dir
        turn, start, flip, cancel, due = Signal(), Signal(), Signal(), Signal(), Signal()
        fits: Value = Const(1)
        if self._enforce_space:
            space = Signal(TIME_BITS)  # ticks until a pulse may start
            fits = ~self.step & (space == 0)
        m.d.comb += [
            turn.eq(reverse & ~pending),
            start.eq(pending & ~setting_up & fits),
            flip.eq(turn & holding),
            cancel.eq(holding & ~turn if self._clean_cancel else 0),
            due.eq(self.tick & (timer.idle | cancel)),
            phase.run.eq(self.tick & ~reverse & ~setting_up),
            phase.velocity.eq(self.velocity),
            self.position.eq(phase.position),
            timer.tick.eq(self.tick),
            timer.clear.eq(cancel),
            timer.shift.eq(self.shift),
            timer.bit.eq(loads_dirtime & self.dirtime | loads_steptime & self.steptime),
        ]
        next_step = start | self.step & Mux(turn, holding, setting_up)
        with m.If(self.tick):
            m.d.sync += [loads_dirtime.eq(turn & due), loads_steptime.eq(start & due)]
        with m.If(due):
            m.d.sync += [
                self.step.eq(next_step),
                self.dir.eq(self.dir ^ flip),
                last.eq(last ^ start),
                holding.eq((holding ^ turn) & ~cancel),
                setting_up.eq(flip),
            ]
        with m.If(self.drop):
            m.d.sync += last.eq(step_bit)

        if self._enforce_space:
            waiting = Signal()  # a step was pending at the last tick and did not start
            m.d.comb += self.missed.eq(self.tick & waiting & ~pending)
            with m.If(self.tick):
                m.d.sync += waiting.eq(pending & ~(due & start))
                with m.If(due & self.step & ~next_step):
                    m.d.sync += space.eq(self.space)
                with m.Elif(~self.step & (space != 0)):
                    m.d.sync += space.eq(decrement(space))
            with m.If(self.moved_tap):
                m.d.sync += waiting.eq(0)
        return m


class ReadLatch(Component):
    """All bytes of one register, taken at one clock edge and driven one after the other.

    Parameters
    ----------
    present : collection of int
        Addresses of the registers beside the positions and the inputs: 14h, 18h, 1Ch. Reaching the
        address of one that is not present leaves the latch as it is.

    Members
    -------
    read : In(1)
        The bus reads, at ``address``. At the address of a register this loads the latch.
    address : In(5)
        Before its increment at this edge.
    positions : In(21) array
    inputs : In(16)
    status : In(8)
    ticks : In(32)
    load : Out(8)
        Bit n: the register at address 4 n is loaded at this edge.
    rdata : Out(8)
        The byte below ``address``, which has moved on by the time the byte is driven.
    """

    def __init__(self, present: tuple[int, ...] = ()) -> None:
        self._present = present
        super().__init__(
            {
                "read": In(1),
                "address": In(registers.MAP.address_bits),
                "positions": In(POSITION_BITS).array(AXES),
                "inputs": In(16),
                "status": In(8),
                "ticks": In(32),
                "load": Out(8),
                "rdata": Out(8),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        high = {registers.R_INPUTS: self.inputs}
        for address, value in (
            (registers.R_IDENT, Const(registers.R_IDENT_RESET, 32)),
            (registers.R_STATUS, self.status),
            (registers.R_TICKS, self.ticks),
        ):
            if address in self._present:
                high[address] = value
        absent = [a for a in range(registers.R_INPUTS, 32, 4) if a not in high]
        # What an absent register reads does not matter.
        upper = [high.get(a, self.inputs) for a in range(registers.R_INPUTS, 32, 4)]

        latch = Signal(max(POSITION_BITS, *(len(value) for value in high.values())))
        which = self.address[2:4]
        m.d.comb += self.load.eq((self.read & ~self.address[:2].any()) << self.address[2:])
        with m.If(self.read & ~self.address[:2].any() & ~self.address.matches(*absent)):
            for bit in range(len(latch)):
                low = choose(which, [_bit(position, bit) for position in self.positions])
                others = [_bit(value, bit) for value in upper]
                value = choose(which, others) if len(high) > 1 else others[0]
                m.d.sync += latch[bit].eq(Mux(self.address[4], value, low))

        with m.Switch(self.address[:2]):
            for n in range(4):
                with m.Case((n + 1) % 4):
                    m.d.comb += self.rdata.eq(latch[8 * n : 8 * n + 8])
        return m


def _bit(value: Value, bit: int) -> Value:
    return value[bit] if bit < len(value) else Const(0, 1)


class PlutoStep(Component):
    """The board, without pads: 40 MHz clock domain ``sync``, whose reset clears every register.

    Parameters
    ----------
    profile : str
        A key of ``registers.PROFILES``: ``exact`` is the original on every clock.
    **switches : int
        Profile switches that differ from the profile.

    Members
    -------
    nwrite, ndatastr, naddrstr, data_i, data_o, data_oe, nwait
        EPP bus; see `EppPort`.
    nreset : In(1)
        nInit of the host. It drives ``nconfig`` and nothing else here.
    nconfig : Out(1)
        Low reconfigures the FPGA of the original board.
    din : In(16)
        Digital inputs, used as they are.
    step, dir : Out(4)
        One of each per axis; step with its polarity.
    dout : Out(14)
        Digital outputs.
    led : Out(1)
        Step, without polarity, XOR dir of axis 0.
    tristate : Out(1)
        Step, dir, dout and led are high-Z: the watchdog has expired.

    Raises
    ------
    ValueError
        If the profile or a switch is unknown.
    """

    def __init__(self, profile: str = registers.DEFAULT_PROFILE, **switches: int) -> None:
        if profile not in registers.PROFILES:
            raise ValueError(
                f"pluto_step has no profile '{profile}'; it has {', '.join(registers.PROFILES)}"
            )
        self._switches = registers.PROFILES[profile] | switches
        if unknown := switches.keys() - registers.PROFILES[profile].keys():
            raise ValueError(
                f"pluto_step has no profile switch {', '.join(sorted(unknown))}; it has "
                f"{', '.join(registers.PROFILES[profile])}"
            )
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
        on = {name: bool(value) for name, value in self._switches.items()}
        words = ["VELOCITY", "OUTPUTS", "TIMING"]
        if on["enforce_space"]:
            words.append("SPACE")
        if on["joint_commit"] or on["wd_stop"]:
            words.append("CONTROL")
        reads = {"id_reg": "R_IDENT", "status_reg": "R_STATUS", "tick_reg": "R_TICKS"}
        present = tuple(getattr(registers, key) for switch, key in reads.items() if on[switch])

        m.submodules.epp = epp = EppPort(nwait_idle=self._switches["nwait_idle"])
        m.submodules.bank = bank = WriteBank(
            registers.MAP,
            present=words,
            aliases=not on["no_alias"],
            stray_addresses=range(16 if on["no_alias"] else 32),
        )
        m.submodules.latch = latch = ReadLatch(present)
        m.d.comb += [
            epp.nwrite.eq(self.nwrite),
            epp.ndatastr.eq(self.ndatastr),
            epp.naddrstr.eq(self.naddrstr),
            epp.data_i.eq(self.data_i),
            epp.rdata.eq(latch.rdata),
            self.data_o.eq(epp.data_o),
            self.data_oe.eq(epp.data_oe),
            self.nwait.eq(epp.nwait),
            self.nconfig.eq(self.nreset),
            bank.write.eq(epp.write),
            bank.address.eq(epp.address),
            bank.data.eq(epp.wdata),
            latch.read.eq(epp.read),
            latch.address.eq(epp.address),
            latch.inputs.eq(self.din),
            self.dout.eq(bank.outputs.levels),
        ]

        # Time. Edge 0 is a tick; the edge before every 32nd tick is a watchdog tick.
        m.submodules.ticks = ticks = Divider(period=registers.TICK_CYCLES)
        m.submodules.watchdog_ticks = watchdog_ticks = Divider(
            period=registers.WATCHDOG_CYCLES // registers.TICK_CYCLES
        )
        tick = Signal(init=1)
        m.d.sync += tick.eq(ticks.last)
        m.d.comb += [ticks.enable.eq(1), watchdog_ticks.enable.eq(ticks.last)]

        # Watchdog.
        m.submodules.watchdog = watchdog = Watchdog(ticks=registers.WATCHDOG_TICKS)
        enabled, arm = Signal(), Signal()
        m.d.comb += [
            arm.eq(bank.outputs_commit & bank.word[registers.W_OUTPUTS_WATCHDOG_ARM_LSB]),
            watchdog.tick.eq(ticks.last & watchdog_ticks.last),
            watchdog.feed.eq(arm),
            self.tristate.eq(enabled & watchdog.expired),
        ]
        with m.If(arm):
            m.d.sync += enabled.eq(1)

        # The times of this tick, one bit per cycle to all axes.
        times = {"steptime": bank.timing.steptime, "dirtime": bank.timing.dirtime}
        passing = Signal(TIME_BITS)
        shift = Signal()
        bits = {}
        m.d.sync += [passing.eq(Cat(tick, passing)), shift.eq(passing.any())]
        for name, value in times.items():
            held, bits[name] = Signal(TIME_BITS, name=name), Signal(name=f"{name}_bit")
            with m.If(tick):
                m.d.sync += held.eq(value)
            m.d.sync += bits[name].eq((held & passing).any())

        # Axes.
        written = type(bank.timing)(bank.timing.shape(), bank.word)
        next_tap, moved_tap = Signal(range(TAPS)), Signal()
        m.d.comb += [
            next_tap.eq(Mux(bank.timing_commit, written.tap, bank.timing.tap)),
            moved_tap.eq(next_tap != bank.timing.tap),
        ]
        missed = Signal(AXES)
        for n in range(AXES):
            m.submodules[f"axis{n}"] = axis = StepGenerator(
                clean_cancel=on["clean_cancel"], enforce_space=on["enforce_space"]
            )
            m.d.comb += [
                axis.tick.eq(tick),
                axis.velocity.eq(self._velocity(m, bank, n)),
                axis.shift.eq(shift),
                axis.steptime.eq(bits["steptime"]),
                axis.dirtime.eq(bits["dirtime"]),
                axis.next_tap.eq(next_tap),
                axis.drop.eq(moved_tap if on["tap_sync"] else 0),
                axis.moved_tap.eq(moved_tap),
                axis.space.eq(bank.space.space if on["enforce_space"] else 0),
                missed[n].eq(axis.missed),
                latch.positions[n].eq(axis.position),
                self.step[n].eq(axis.step ^ bank.timing.polarity),
                self.dir[n].eq(axis.dir),
            ]
            if n == 0:
                m.d.comb += self.led.eq(axis.step ^ axis.dir)

        # Registers beyond the original's.
        if on["status_reg"]:
            kept = Signal(AXES)  # missed steps, until they are read
            read = latch.load[registers.R_STATUS // 4]
            m.d.sync += kept.eq(kept & ~read.replicate(AXES) | missed)
            m.d.comb += latch.status.eq(
                enabled << registers.R_STATUS_ENABLED_LSB
                | self.tristate << registers.R_STATUS_TRISTATE_LSB
                | kept << registers.R_STATUS_MISSED_LSB
            )
        if on["tick_reg"]:
            count = Signal(32)
            m.d.comb += latch.ticks.eq(count)
            with m.If(tick):
                m.d.sync += count.eq(count + 1)
        return m

    def _velocity(self, m: Module, bank: WriteBank, axis: int) -> Value:
        """Return the velocity that axis ``axis`` runs at."""
        velocity: Value = bank.velocity[axis].value
        if self._switches["joint_commit"]:
            # The register is the staged copy.
            staged, velocity = velocity, Signal(VELOCITY_BITS, name=f"velocity{axis}")
            joint = bank.control.joint
            with m.If(joint & bank.outputs_commit):
                m.d.sync += velocity.eq(staged)
            with m.If(~joint & bank.velocity_commit[axis]):
                m.d.sync += velocity.eq(bank.word)
        if self._switches["wd_stop"]:
            stop = self.tristate & bank.control.watchdog_stop
            velocity = Mux(stop, 0, velocity)
        return velocity.as_signed()
