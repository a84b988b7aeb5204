"""Gateware of the board: serial side, output registers, program memory, motion and pins.

Everything takes its new value from old ones, at one clock edge. All but the baud generators is in
reset until the board is ready, and memories keep their contents.
"""

from __future__ import annotations

from typing import Final

from amaranth import Cat, ClockDomain, ClockSignal, DomainRenamer, Module, Mux, Signal, Value
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import Component, In, Out

from pulsewright.boards.board import resolve_switches
from pulsewright.boards.s3g import registers
from pulsewright.boards.s3g.gateware_motion import (
    LOAD_BITS,
    AccelerationSteps,
    Profiles,
    PulseFormer,
)
from pulsewright.boards.s3g.gateware_program import (
    INTERRUPTS,
    STROBES,
    Interrupts,
    ProgramExecutor,
    picked,
    placed,
)
from pulsewright.boards.s3g.gateware_serial import PacketReceiver, PacketSender, SerialExecutor
from pulsewright.boards.s3g.gateware_shared import SharedProfiles
from pulsewright.errors import UsageError
from pulsewright.gateware.uart import BaudGenerator, UartReceiver, UartTransmitter

WORD_BITS: Final = 8 * registers.PROG_WORD_BYTES
PROG_WORDS_MAX: Final = 1 << 16
BAUD_MAX: Final = registers.BAUD_UNIT * registers.BAUD_LIMIT
CONTROL_CHANNELS: Final = 3  # that the first control register has room for


def pins(channels: int) -> dict[str, tuple[str, int]]:
    """Return the output pins of a board, serial ones excepted: output port and bit of each."""
    motor = ("step", "dir", "enable")
    return {f"led{n}": ("led", n) for n in range(8)} | {
        f"mot{c}_{name}": (f"mot_{name}", c) for c in range(channels) for name in motor
    }


class _Core(Component):
    """All of the board that is reset until it is ready."""

    def __init__(
        self,
        channels: int,
        ints_timer: int,
        prog_words: int,
        shared: bool,
        switches: dict[str, int],
    ) -> None:
        self._channels, self._ints_timer, self._prog_words = channels, ints_timer, prog_words
        self._shared, self._switches = shared, switches
        super().__init__(
            {
                "clear": In(1),
                "clear_address": In(7),
                "enable": In(2),
                "rx": In(2),
                "tx": Out(2, init=3),
                "led": Out(8),
                "mot_step": Out(channels),
                "mot_dir": Out(channels),
                "mot_enable": Out(channels, init=(1 << channels) - 1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        address_bits = (self._prog_words - 1).bit_length()
        m.submodules.executor = executor = SerialExecutor(
            address_bits=address_bits,
            length_check=bool(self._switches["length_check"]),
            reply_to_asker=bool(self._switches["reply_port"]),
        )
        m.submodules.program = program = ProgramExecutor()
        m.submodules.interrupts = interrupts = Interrupts(repeat=self._ints_timer)
        m.submodules.steps = steps = AccelerationSteps(
            abort_dt_latched=bool(self._switches["abort_dt_latched"]), paced=self._shared
        )
        self._serial(m, executor)

        m.submodules.memory = memory = Memory(shape=WORD_BITS, depth=self._prog_words, init=[])
        written, read = memory.write_port(), memory.read_port()
        m.d.comb += [
            written.en.eq(executor.program_write),
            written.addr.eq(executor.program_address),
            written.data.eq(executor.program_word),
            read.addr.eq(program.read_address),
            program.word.eq(read.data),
        ]

        # A strobe is true in the cycle after the command that gives it.
        strobes = Signal(len(STROBES))
        load, start, abort, loop_back = strobes
        m.d.sync += strobes.eq(
            Mux(executor.strobe, picked(executor.mask, STROBES), 0)
            | Mux(program.strobe, picked(program.value, STROBES), 0)
        )
        m.d.comb += [
            program.start.eq(start),
            program.abort.eq(abort),
            program.pending.eq(interrupts.pending),
            program.stall.eq(executor.write),
            interrupts.sources.eq(Cat(steps.done, steps.abort, program.complete, loop_back)),
            interrupts.clear.eq(
                Mux(executor.clear, picked(executor.mask, INTERRUPTS), 0)
                | Mux(program.clear, picked(program.value, INTERRUPTS), 0)
            ),
            interrupts.set_mask.eq(executor.set_mask),
            interrupts.mask.eq(picked(executor.mask, INTERRUPTS)),
            interrupts.rearm.eq(executor.set_mask | executor.clear),
            interrupts.report.eq(executor.report),
            executor.due.eq(interrupts.due),
            executor.pending.eq(placed(interrupts.pending, INTERRUPTS)),
            executor.status.eq(program.status),
            executor.dt.eq(steps.dt),
            executor.steps.eq(steps.steps),
        ]
        profiles = m.submodules.profiles = self._profiles(m, load, steps)
        self._registers(m, executor, program, steps, profiles)
        return m

    def _profiles(
        self, m: Module, load: Value, steps: AccelerationSteps
    ) -> Profiles | SharedProfiles:
        """Add profiles; shared ones take loads and acceleration steps when they have time."""
        if not self._shared:
            m.d.comb += steps.load.eq(load)
            return Profiles(self._channels)
        profiles = SharedProfiles(self._channels)
        held = Signal()
        m.d.sync += held.eq((load | held) & ~profiles.free)
        m.d.comb += [
            steps.load.eq((load | held) & profiles.free),
            steps.ready.eq(profiles.ready),
            profiles.clear.eq(self.clear),
            profiles.clear_address.eq(self.clear_address),
        ]
        return profiles

    def _serial(self, m: Module, executor: SerialExecutor) -> None:
        """Add ports, packets and the receive buffer."""
        switches = self._switches
        m.submodules.receiver = receiver = PacketReceiver(
            timeout=switches["rx_timeout"],
            empty_frames=bool(switches["length_check"]),
            hold=bool(switches["req_queue"]),
        )
        m.submodules.sender = sender = PacketSender()
        for n in range(2):
            m.submodules[f"rx{n}"] = rx = UartReceiver()
            m.submodules[f"tx{n}"] = tx = UartTransmitter()
            m.d.comb += [
                rx.enable.eq(self.enable[n]),
                rx.line.eq(self.rx[n]),
                receiver.valid[n].eq(rx.valid),
                (receiver.data0, receiver.data1)[n].eq(rx.data),
                tx.enable.eq(self.enable[n]),
                tx.write.eq(sender.write[n]),
                tx.data.eq(sender.data),
                sender.busy[n].eq(tx.busy),
                self.tx[n].eq(tx.line),
            ]
        m.submodules.buffer = buffer = Memory(shape=8, depth=256, init=[])
        written, read = buffer.write_port(), buffer.read_port()
        m.d.comb += [
            written.en.eq(receiver.store),
            written.addr.eq(receiver.index),
            written.data.eq(receiver.byte),
            read.addr.eq(executor.buffer_index),
            executor.buffer_byte.eq(read.data),
            receiver.release.eq(executor.release),
            receiver.deaf.eq(executor.copying if switches["hold_buffer"] else 0),
            executor.idle.eq(sender.idle),
            executor.position.eq(sender.position),
            sender.start.eq(executor.start),
            sender.ports.eq(executor.ports),
            sender.size.eq(executor.reply_size),
            sender.byte.eq(executor.byte),
        ]
        for name in ("done", "error", "port", "size", "payload", "intact"):
            m.d.comb += getattr(executor, name).eq(getattr(receiver, name))

    def _registers(
        self,
        m: Module,
        executor: SerialExecutor,
        program: ProgramExecutor,
        steps: AccelerationSteps,
        profiles: Profiles | SharedProfiles,
    ) -> None:
        """Add output registers and what they control."""
        write, address, data = Signal(), Signal(6), Signal(32)
        m.d.comb += [
            write.eq(executor.write | program.write),
            address.eq(Mux(executor.write, executor.address, program.address)),
            data.eq(Mux(executor.write, executor.value, program.value)),
        ]

        def register(number: int, bits: int, name: str) -> Signal:
            value = Signal(bits, name=name)
            with m.If(write & (address == number)):
                m.d.sync += value.eq(data)
            return value

        channels = self._channels
        control = register(
            registers.W_ASG_CONTROL, 8 + 8 * min(channels, CONTROL_CHANNELS), "control"
        )
        selects: list[Value] = [control[8 * c + 8 :][:LOAD_BITS] for c in range(CONTROL_CHANNELS)]
        if channels > CONTROL_CHANNELS:
            more = register(registers.W_ASG_CONTROL2, 8 * (channels - CONTROL_CHANNELS), "control2")
            selects += [more[8 * c :][:LOAD_BITS] for c in range(channels - CONTROL_CHANNELS)]
        enable = register(registers.W_MSG_CONTROL, channels, "motor_enable")
        pre = register(registers.W_MSG_ALL_PRE_N, 32, "pre")
        pulse = register(registers.W_MSG_ALL_PULSE_N, 32, "pulse")
        post = register(registers.W_MSG_ALL_POST_N, 32, "post")
        m.d.comb += [
            self.led.eq(register(registers.W_LEDS, 8, "leds")),
            self.mot_enable.eq(~enable),
            program.first.eq(register(registers.W_BE_START_ADDR, 16, "start_address")),
            executor.loop_back.eq(register(registers.W_SE_REG_LB, 32, "loop_back")),
            steps.steps_value.eq(register(registers.W_ASG_STEPS_VAL, 32, "steps_value")),
            steps.dt_value.eq(register(registers.W_ASG_DT_VAL, 32, "dt_value")),
            Cat(steps.set_steps, steps.set_dt, steps.reset_steps, steps.reset_dt).eq(control[:4]),
        ]

        m.d.comb += [
            profiles.write.eq(write),
            profiles.address.eq(address),
            profiles.data.eq(data),
            profiles.load.eq(steps.load),
            profiles.select.eq(Cat(selects[:channels])),
            profiles.step.eq(steps.step),
            profiles.aborting.eq(steps.aborting),
            profiles.done.eq(steps.done),
        ]
        for c in range(channels):
            m.submodules[f"pulse{c}"] = former = PulseFormer()
            m.d.comb += [
                former.strobe.eq(profiles.strobe[c]),
                former.up.eq(profiles.up[c]),
                former.pre.eq(pre),
                former.pulse.eq(pulse),
                former.post.eq(post),
                self.mot_step[c].eq(former.step),
                self.mot_dir[c].eq(former.dir),
            ]


class S3G(Component):
    """The board, without pads: clock domain ``sync``, whose reset is that of configuration.

    Parameters
    ----------
    profile : str
        ``exact`` or ``robust``.
    channels : int
        1 to 6.
    baud1, baud2 : int
        Bit rates of the serial ports [baud]: 100 to 3 125 000; less than a hundred is dropped.
    ints_timer : int
        Between reports of interrupts that stay pending [cycle], at least 1.
    prog_words : int
        Size of program memory [word]: a power of two, 2 to 65 536. Addresses wrap.
    shared_arithmetic : int
        1: one adder works out the profiles of all channels, see `SharedProfiles`: a fraction of the
        logic per channel. Every clock is the same, provided that acceleration steps come at least
        15 * ``channels`` + 1 cycles after the one before and after writes of an abort deceleration
        in an abort, and 22 * ``channels`` + 1 cycles after a load, and loads 7 * ``channels`` + 1
        cycles after the one before. What comes earlier waits until then.
    **switches : int
        Profile switches that differ from the profile.

    Members
    -------
    rst_n, cclk : In(1)
        The board is in reset while either is 0, and 1024 cycles more.
    avr_tx, ext_tx : In(1)
        Serial inputs; asynchronous.
    avr_rx, ext_rx : Out(1)
        Serial outputs.
    led : Out(8)
    mot_step, mot_dir, mot_enable : Out(channels)
        Pins of the motor drivers; enable is active low.

    Raises
    ------
    UsageError
        If a parameter is not allowed.
    """

    def __init__(
        self,
        profile: str = registers.DEFAULT_PROFILE,
        *,
        channels: int = registers.CHANNELS,
        baud1: int = registers.BAUD1,
        baud2: int = registers.BAUD2,
        ints_timer: int = registers.INTS_TIMER,
        prog_words: int = registers.PROG_WORDS,
        shared_arithmetic: int = 0,
        **switches: int,
    ) -> None:
        self.switches = resolve_switches(registers.MAP, profile, switches)
        most = registers.MAX_CHANNELS
        if not 1 <= channels <= most:
            raise UsageError(
                f"s3g gateware: {channels} channels; allowed are 1..{most}, as the registers have "
                f"no room for more"
            )
        for name, baud in (("baud1", baud1), ("baud2", baud2)):
            if not registers.BAUD_UNIT <= baud <= BAUD_MAX:
                raise UsageError(
                    f"s3g gateware: {name} = {baud} baud; allowed are "
                    f"{registers.BAUD_UNIT}..{BAUD_MAX}"
                )
        if shared_arithmetic not in (0, 1):
            raise UsageError(
                f"s3g gateware: shared_arithmetic = {shared_arithmetic}; allowed are 0 and 1"
            )
        if ints_timer < 1:
            raise UsageError(f"s3g gateware: ints_timer = {ints_timer} cycles; at least 1")
        if not 2 <= prog_words <= PROG_WORDS_MAX or prog_words & (prog_words - 1):
            raise UsageError(
                f"s3g gateware: prog_words = {prog_words}; allowed are powers of two, "
                f"2..{PROG_WORDS_MAX}"
            )
        self._channels, self._bauds = channels, (baud1, baud2)
        self._ints_timer, self._prog_words = ints_timer, prog_words
        self._shared = bool(shared_arithmetic)
        super().__init__(
            {
                "rst_n": In(1),
                "cclk": In(1),
                "avr_tx": In(1),
                "ext_tx": In(1),
                "avr_rx": Out(1, init=1),
                "ext_rx": Out(1, init=1),
                "led": Out(8),
                "mot_step": Out(channels),
                "mot_dir": Out(channels),
                "mot_enable": Out(channels, init=(1 << channels) - 1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        ready, count = Signal(), Signal(range(registers.READY_CYCLES))
        with m.If(~(self.rst_n & self.cclk)):
            m.d.sync += [count.eq(0), ready.eq(0)]
        with m.Elif(count == registers.READY_CYCLES - 1):
            m.d.sync += ready.eq(1)
        with m.Else():
            m.d.sync += count.eq(count + 1)

        core = _Core(
            self._channels, self._ints_timer, self._prog_words, self._shared, self.switches
        )
        m.d.comb += [core.clear.eq(~ready), core.clear_address.eq(count)]
        # A domain of its own, so that its flip-flops have one reset and not two.
        domain = ClockDomain("board", local=True)
        m.domains += domain
        m.d.comb += [domain.clk.eq(ClockSignal()), domain.rst.eq(~ready)]
        m.submodules.core = DomainRenamer("board")(core)
        for n, baud in enumerate(self._bauds):
            m.submodules[f"baud{n + 1}"] = generator = BaudGenerator(
                step=baud // registers.BAUD_UNIT, limit=registers.BAUD_LIMIT
            )
            m.d.comb += core.enable[n].eq(generator.enable)
        m.d.comb += [
            core.rx.eq(Cat(self.avr_tx, self.ext_tx)),
            Cat(self.avr_rx, self.ext_rx).eq(core.tx),
        ]
        for name in ("led", "mot_step", "mot_dir", "mot_enable"):
            m.d.comb += getattr(self, name).eq(getattr(core, name))
        return m
