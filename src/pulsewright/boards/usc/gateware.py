"""Gateware of the board: bus, registers, rate generators, encoders, estop and pins.

Every register takes its new value from the old ones, at one clock edge; ticks are single edges of
the core clock. The reset of the host (nINIT) reaches all of the board but its input synchronisers
and filters.
"""

from __future__ import annotations

from typing import Final

from amaranth import Cat, Const, Module, Mux, ResetInserter, Signal, Value
from amaranth.lib.wiring import Component, In, Member, Out

from pulsewright.boards.board import resolve_switches
from pulsewright.boards.usc import registers
from pulsewright.errors import UsageError
from pulsewright.gateware.epp import EppPort
from pulsewright.gateware.estop import EstopChain
from pulsewright.gateware.quadrature import EncoderCounter, QuadratureDecoder
from pulsewright.gateware.register_bank import WriteBank
from pulsewright.gateware.step_pulse import StepPulse
from pulsewright.gateware.step_rate import PeriodCounter
from pulsewright.gateware.synchroniser import InputFilter
from pulsewright.gateware.watchdog import Watchdog

AXES: Final = len(registers.W_DIVISOR)
DIVISOR_BITS: Final = registers.W_DIVISOR_VALUE_MASK.bit_length()
COUNT_BITS: Final = registers.R_ENCODER_COUNT_VALUE_MASK.bit_length()
INPUTS: Final = 15
OUTPUTS: Final = registers.W_OUTPUTS_SSR_MASK.bit_count()
BOARDS_MAX: Final = 8
BUS_INPUTS: Final = {"nwrite": 1, "ndatastr": 1, "naddrstr": 1, "ninit": 1, "data_i": 8}
BUS_OUTPUTS: Final = {"data_o": 8, "data_oe": 1, "nwait": 1}


def _board_inputs(axes: int) -> dict[str, int]:
    return {"a": axes, "b": axes, "index": axes, "din": INPUTS, "estop_chain": 1}


def _board_outputs(axes: int) -> dict[str, int]:
    return {"step": axes, "dir": axes, "out": OUTPUTS, "dac": 8, "running": 1}


def _ports(inputs: dict[str, int], outputs: dict[str, int]) -> dict[str, Member]:
    ports = {name: In(bits) for name, bits in inputs.items()}
    return ports | {name: Out(bits) for name, bits in outputs.items()}


class LatchEvents(Component):
    """When the encoder counts of a board are latched: by software, by a timer, by other boards.

    Parameters
    ----------
    tick_cycles : int
        Clock cycles per tick.

    Members
    -------
    tick : In(1)
        High in the cycle that ends with a tick.
    soft : In(1)
        A soft latch at this edge.
    rate : In(4)
        An event every ``rate`` * 1000 ticks, compared by magnitude; 0 stops the timer.
    intr_i : In(1)
        Level of the Intr line that the boards share; its leading edge latches.
    intr_o : Out(1)
        Assert the line: for 1 us from the edge of an event on, the cycle before it included.
    latch : Out(1)
        Latch at this edge.
    """

    def __init__(self, *, tick_cycles: int) -> None:
        self._hold = registers.INTR_TICKS * tick_cycles - 1
        ins = ("tick", "soft", "intr_i")
        super().__init__(
            dict.fromkeys(ins, In(1)) | {"rate": In(4), "intr_o": Out(1), "latch": Out(1)}
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        part = Signal(range(registers.TIMER_UNIT_TICKS))
        units = Signal.like(self.rate)
        full = part == registers.TIMER_UNIT_TICKS - 1
        stopped, elapsed, event = Signal(), Signal(), Signal()
        m.d.comb += [
            stopped.eq(self.rate == 0),
            elapsed.eq(~stopped & (units + full >= self.rate)),
            event.eq(self.soft | self.tick & elapsed),
        ]
        with m.If(self.tick):
            with m.If(stopped | elapsed):
                m.d.sync += [part.eq(0), units.eq(0)]
            with m.Elif(full):
                m.d.sync += [part.eq(0), units.eq(units + 1)]
            with m.Else():
                m.d.sync += part.eq(part + 1)

        hold = Signal(range(self._hold + 1))
        asserted = Signal()  # the line, at the edge before
        m.d.comb += [
            self.intr_o.eq(event | (hold != 0)),
            self.latch.eq(event | self.intr_i & ~asserted),
        ]
        # A board knows what it asserts itself, even if it sees the line later.
        m.d.sync += asserted.eq(self.intr_i | self.intr_o)
        with m.If(event):
            m.d.sync += hold.eq(self._hold)
        with m.Elif(hold != 0):
            m.d.sync += hold.eq(hold - 1)
        return m


class _Core(Component):
    """All of the board that nINIT resets, which is here its reset; inputs are synchronous."""

    def __init__(self, axes: int, tick_cycles: int, nwait_idle: int, switches: dict[str, int]):
        self._axes, self._tick_cycles, self._nwait_idle = axes, tick_cycles, nwait_idle
        self._switches = switches
        inputs = BUS_INPUTS | {"count": axes, "up": axes, "index": axes, "din": INPUTS, "chain": 1}
        outputs = BUS_OUTPUTS | _board_outputs(axes)
        super().__init__(_ports(inputs | {"intr_i": 1}, outputs | {"intr_o": 1}))

    def elaborate(self, platform: object) -> Module:
        m = Module()
        switches = self._switches
        absent = (
            set() if switches["ident"] & registers.R_IDENT_VERSION_MASK >= 2 else {"INDEX_RESET"}
        )
        written = [r.name for r in registers.MAP.registers if r.side == "write"]
        m.submodules.epp = epp = EppPort(base=switches["base"], nwait_idle=self._nwait_idle)
        m.submodules.bank = bank = WriteBank(
            registers.MAP, present=[name for name in written if name not in absent]
        )
        m.d.comb += [
            epp.nwrite.eq(self.nwrite),
            epp.ndatastr.eq(self.ndatastr),
            epp.naddrstr.eq(self.naddrstr),
            epp.data_i.eq(self.data_i),
            self.data_o.eq(epp.data_o),
            self.data_oe.eq(epp.data_oe),
            self.nwait.eq(epp.nwait),
            bank.write.eq(epp.write),
            bank.address.eq(epp.address),
            bank.data.eq(epp.wdata),
        ]

        # Edge 0 is a tick.
        phase = Signal(range(self._tick_cycles))
        tick = Signal()
        m.d.comb += tick.eq(phase == 0)
        m.d.sync += phase.eq(Mux(phase == self._tick_cycles - 1, 0, phase + 1))

        self._estop(m, bank, tick)
        start = self._axes_step(m, bank, tick)
        holding, sense = self._encoders(m, bank, tick, start, epp)

        # The byte of a read: taken at the action, and driven until the next one.
        byte = Signal(8)
        m.d.comb += epp.rdata.eq(byte)
        with m.If(epp.read & ~self.ndatastr):
            m.d.sync += byte.eq(self._read(m, epp.address, holding, sense))
        with m.Elif(epp.read & ~self.naddrstr):
            m.d.sync += byte.eq(Cat(epp.address, Const(switches["base"], 3)))
        return m

    def _estop(self, m: Module, bank: WriteBank, tick: Value) -> None:
        """Add estop, watchdog, and the outputs that both force to 0."""
        m.submodules.estop = estop = EstopChain()
        expired: Value = Const(0)
        if self._switches["watchdog_us"]:
            m.submodules.watchdog = watchdog = Watchdog(
                ticks=self._switches["watchdog_us"] * (registers.TICK_HZ // 1_000_000),
                starts_expired=True,
            )
            fed_by = Signal(AXES)  # axes committed since the last feed
            commits = fed_by | bank.divisor_commit
            feed = (commits & commits >> 1).any()
            m.d.sync += fed_by.eq(Mux(feed, 0, commits))
            m.d.comb += [watchdog.tick.eq(tick), watchdog.feed.eq(feed)]
            expired = watchdog.expired
        m.d.comb += [
            estop.release.eq(bank.outputs.estop_release),
            estop.closed.eq(self.chain | bank.slave.enable),
            estop.fed.eq(~expired),
            self.running.eq(estop.running),
            self.out.eq(Mux(estop.running, bank.outputs.ssr, 0)),
            self.dac.eq(Mux(estop.running, bank.dac.value, 0)),
        ]

    def _axes_step(self, m: Module, bank: WriteBank, tick: Value) -> Signal:
        """Add rate generators and pulse formers; return where pulses start."""
        switches = self._switches
        start = Signal(self._axes)
        nonzero = Signal(self._axes)  # a divisor of 0 halts its axis
        word_nonzero = bank.word.any()
        width = _ticks_but_one(bank.width.code, switches["time_code"])
        setup = _ticks_but_one(bank.setup.code, switches["time_code"])
        for n in range(self._axes):
            m.submodules[f"rate{n}"] = rate = PeriodCounter(
                width=DIVISOR_BITS, offset=switches["div_offset"]
            )
            m.submodules[f"pulse{n}"] = pulse = StepPulse(
                min_space=switches["min_space"], change_at_fall=bool(switches["mariss"])
            )
            with m.If(bank.divisor_commit[n]):
                m.d.sync += nonzero[n].eq(word_nonzero)
            m.d.comb += [
                rate.tick.eq(tick),
                rate.enable.eq(bank.rate_control[f"run{n}"] & nonzero[n] & self.running),
                rate.divisor.eq(bank.divisor[n].value),
                rate.ready.eq(pulse.ready),
                pulse.tick.eq(tick),
                pulse.due.eq(rate.due),
                pulse.direction.eq(bank.rate_control[f"dir{n}"]),
                pulse.width.eq(width),
                pulse.setup.eq(setup),
                start[n].eq(tick & rate.due & pulse.ready),
                self.step[n].eq(pulse.step),
                self.dir[n].eq(pulse.dir),
            ]
        return start

    def _encoders(
        self, m: Module, bank: WriteBank, tick: Value, start: Value, epp: EppPort
    ) -> tuple[list[Value], Signal]:
        """Add counters, latches and index logic; return holding registers and index sense."""
        switches = self._switches
        soft_latch = registers.W_TIMER_SOFT_LATCH_LSB
        m.submodules.events = events = LatchEvents(tick_cycles=self._tick_cycles)
        m.d.comb += [
            events.tick.eq(tick),
            events.soft.eq(bank.timer_commit & bank.data[soft_latch] & ~bank.timer.soft_latch),
            events.rate.eq(Mux(bank.timer.master, bank.timer.rate, 0)),
            events.intr_i.eq(self.intr_i),
            self.intr_o.eq(events.intr_o),
        ]
        counts, up = (start, self.dir) if switches["loopback"] else (self.count, self.up)
        select, load = bank.encoder_control.index_select, bank.encoder_control.load
        clears: Value = Const(0, AXES)
        if hasattr(bank, "index_reset"):
            clears = bank.index_reset.axes
        holding: list[Value] = []
        for n in range(self._axes):
            m.submodules[f"counter{n}"] = counter = EncoderCounter(width=COUNT_BITS)
            m.d.comb += [
                counter.count.eq(counts[n]),
                counter.up.eq(up[n]),
                counter.reset.eq(self.index[n] & clears[n]),
                counter.load.eq(load[n]),
                counter.value.eq(bank.assembly.value),
                counter.latch.eq(Mux(select[n], self.index[n], events.latch)),
            ]
            holding.append(counter.held)

        sense = Signal(self._axes)
        read = epp.read & ~self.ndatastr & (epp.address == registers.R_INDEX_SENSE)
        sensed = self.index & (select | clears) if switches["sense_gate"] else self.index
        m.d.sync += sense.eq(Mux(read, 0, sense) | sensed)
        return holding, sense

    def _read(self, m: Module, address: Value, holding: list[Value], sense: Value) -> Signal:
        """Return the byte at a register address."""
        bytes_: dict[int, Value] = {
            start + k: count.word_select(k, 8)
            for start, count in zip(registers.R_ENCODER_COUNT, holding, strict=False)
            for k in range(COUNT_BITS // 8)
        }
        bytes_ |= {
            registers.R_INDEX_SENSE: sense,
            registers.R_INPUTS_LOW: self.din[:8],
            registers.R_INPUTS_HIGH: Cat(self.din[8:], self.running),
            registers.R_IDENT: Const(self._switches["ident"], 8),
        }
        byte = Signal(8, name="read_byte")
        with m.Switch(address):
            for at, value in bytes_.items():
                with m.Case(at):
                    m.d.comb += byte.eq(value)
        return byte


def _ticks_but_one(code: Value, time_code: int) -> Value:
    """Return the ticks of a time code less one: ``time_code - 1 - code``, not below 0."""
    if time_code > (1 << len(code)) - 1:
        return ~code
    return Mux(code.all(), 0, ~code - 1)[: len(code)]


class Usc(Component):
    """The board, without pads: clock domain ``sync``, whose reset clears every register.

    Parameters
    ----------
    profile : str
        ``document`` or ``linuxcnc``.
    axes : int
        Rate generators and encoders, 1..4. The registers of others are not there: their divisors
        feed the watchdog, and their counts read 0.
    clock_hz : int
        Core clock [Hz], a multiple of 10 MHz.
    nwait_idle : int
        Level of nWait between cycles: 0, as IEEE 1284 has it, or 1.
    **switches : int
        Profile switches that differ from the profile.

    Members
    -------
    nwrite, ndatastr, naddrstr, data_i, data_o, data_oe, nwait
        EPP bus; see `EppPort`.
    ninit : In(1)
        0 resets the board, inputs excepted; the first edge that samples 1 is edge 0. Like the
        strobes it is used as it is.
    a, b, index : In(axes)
        Encoders; synchronised and filtered.
    din : In(15), estop_chain : In(1)
        Digital inputs; estop chain, 1 = closed. Synchronised.
    intr_i, intr_o : In(1), Out(1)
        Intr line: its level, and whether this board asserts it. Boards latch at the same edge if
        ``intr_i`` is the OR of all ``intr_o`` without a register in between.
    step, dir : Out(axes)
    out : Out(7), dac : Out(8)
        Outputs and extra port; 0 in estop.
    running : Out(1)
        Out of estop.

    Raises
    ------
    UsageError
        If a parameter is not allowed.
    """

    def __init__(
        self,
        profile: str = registers.DEFAULT_PROFILE,
        *,
        axes: int = AXES,
        clock_hz: int = registers.CLOCK_HZ,
        nwait_idle: int = 0,
        **switches: int,
    ) -> None:
        self.switches = resolve_switches(registers.MAP, profile, switches)
        if not 1 <= axes <= AXES:
            raise UsageError(f"usc gateware: {axes} axes; allowed are 1..{AXES}")
        if clock_hz < registers.TICK_HZ or clock_hz % registers.TICK_HZ:
            raise UsageError(
                f"usc gateware: core clock {clock_hz} Hz; allowed are multiples of "
                f"{registers.TICK_HZ} Hz"
            )
        if nwait_idle not in (0, 1):
            raise UsageError(f"usc gateware: nwait_idle = {nwait_idle}; allowed are 0 and 1")
        self._axes = axes
        self._tick_cycles = clock_hz // registers.TICK_HZ
        self._nwait_idle = nwait_idle
        inputs = BUS_INPUTS | _board_inputs(axes)
        outputs = BUS_OUTPUTS | _board_outputs(axes)
        super().__init__(_ports(inputs | {"intr_i": 1}, outputs | {"intr_o": 1}))

    def elaborate(self, platform: object) -> Module:
        m = Module()
        core = _Core(self._axes, self._tick_cycles, self._nwait_idle, self.switches)
        m.submodules.core = ResetInserter(~self.ninit)(core)
        for name in (*BUS_INPUTS, "intr_i"):
            m.d.comb += getattr(core, name).eq(getattr(self, name))
        for name in (*BUS_OUTPUTS, *_board_outputs(self._axes), "intr_o"):
            m.d.comb += getattr(self, name).eq(getattr(core, name))

        m.submodules.inputs = inputs = InputFilter(width=INPUTS + 1)
        m.d.comb += [
            inputs.pins.eq(Cat(self.din, self.estop_chain)),
            core.din.eq(inputs.levels),
            core.chain.eq(inputs.before[INPUTS]),  # the estop acts after the edge that uses it
        ]
        for n in range(self._axes):
            m.submodules[f"filter{n}"] = encoder = InputFilter(
                width=3, samples=self.switches["enc_filter"]
            )
            m.submodules[f"decoder{n}"] = decoder = QuadratureDecoder()
            m.d.comb += [
                encoder.pins.eq(Cat(self.a[n], self.b[n], self.index[n])),
                Cat(decoder.a, decoder.b).eq(encoder.levels[:2]),
                core.count[n].eq(decoder.count),
                core.up[n].eq(decoder.up),
                core.index[n].eq(encoder.levels[2] & ~encoder.before[2]),
            ]
        return m


class UscBoards(Component):
    """Several boards on one bus, with the Intr line between them.

    Parameters
    ----------
    profile : str
    boards : int
        The first one answers at ``base``, the others at the next bases; 1 to 8 less ``base``.
    nwait_idle : int
    **options : int
        As for `Usc`; ``base`` is that of the first board.

    Members
    -------
    nwrite, ndatastr, naddrstr, ninit, data_i, data_o, data_oe, nwait
        The bus; see `Usc`.
    a, b, index, din, estop_chain, step, dir, out, dac, running
        One of each per board, named as those of `Usc`.

    Raises
    ------
    UsageError
        If a parameter is not allowed.
    """

    def __init__(
        self,
        profile: str = registers.DEFAULT_PROFILE,
        boards: int = 2,
        *,
        nwait_idle: int = 0,
        **options: int,
    ) -> None:
        base = options.pop("base", registers.PROFILES[registers.DEFAULT_PROFILE]["base"])
        if not 1 <= boards <= BOARDS_MAX - base:
            raise UsageError(
                f"usc gateware: {boards} boards from base {base} on; allowed are "
                f"1..{BOARDS_MAX - base} of them (bases 0..{BOARDS_MAX - 1})"
            )
        self._nwait_idle = nwait_idle
        self._boards = [
            Usc(profile, nwait_idle=nwait_idle, base=base + n, **options) for n in range(boards)
        ]
        axes = options.get("axes", AXES)
        self._inputs, self._outputs = _board_inputs(axes), _board_outputs(axes)
        members = _ports(BUS_INPUTS, BUS_OUTPUTS)
        for name, member in _ports(self._inputs, self._outputs).items():
            members[name] = member.array(boards)
        super().__init__(members)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        boards = self._boards
        intr = Signal()
        for n, board in enumerate(boards):
            m.submodules[f"board{n}"] = board
            m.d.comb += board.intr_i.eq(intr)
            for name in BUS_INPUTS:
                m.d.comb += getattr(board, name).eq(getattr(self, name))
            for name in self._inputs:
                m.d.comb += getattr(board, name).eq(getattr(self, name)[n])
            for name in self._outputs:
                m.d.comb += getattr(self, name)[n].eq(getattr(board, name))
        m.d.comb += [
            intr.eq(Cat(board.intr_o for board in boards).any()),
            self.nwait.eq(
                Cat(board.nwait ^ self._nwait_idle for board in boards).any() ^ self._nwait_idle
            ),
            self.data_oe.eq(Cat(board.data_oe for board in boards).any()),
        ]
        byte: Value = Const(0, 8)
        for board in boards:
            byte |= Mux(board.data_oe, board.data_o, 0)
        m.d.comb += self.data_o.eq(byte)
        return m
