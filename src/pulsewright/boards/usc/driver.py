"""The Universal Stepper Controller in engineering units, over an EPP bus.

Names, addresses and fields come from the register map; "the document" is the board's register
definition by Pico Systems, "the client" the LinuxCNC driver for it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NoReturn, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.board import resolve_switches
from pulsewright.boards.driving import Driver
from pulsewright.boards.usc import registers as reg
from pulsewright.boards.usc.burst import AXES, BURST_ACCESSES, BURST_ADDRESS, RateUpdates
from pulsewright.errors import BusError, EstopError, LateError, RegisterValueError, UsageError
from pulsewright.registers.codec import decode_bytes, encode_bytes
from pulsewright.transport.bus import (
    ADDRESS_WRITE,
    DATA_WRITE,
    EPP_ACCESS,
    EppBus,
    read_accesses,
    require_acknowledge,
    write_accesses,
)

TICK: Final = 1 / reg.TICK_HZ  # [s]
COUNT_RANGE: Final = reg.R_ENCODER_COUNT_VALUE_MASK + 1
MAX_DIVISOR: Final = reg.W_DIVISOR_VALUE_MASK
INPUTS: Final = (reg.R_INPUTS_HIGH_INPUTS_MASK << 8 | reg.R_INPUTS_LOW_INPUTS_MASK).bit_count()
OUTPUTS: Final = reg.W_OUTPUTS_SSR_MASK.bit_count()
DAC_CODES: Final = reg.W_DAC_VALUE_MASK
DAC_FULL_SCALE: Final = 10.0  # [V]
CLIENT_PULSE_WIDTH: Final = 4e-6  # defaults of the client [s]
CLIENT_SETUP_TIME: Final = 10e-6
BYTE_WEIGHTS: Final = np.array([1, 1 << 8, 1 << 16])  # low byte first
LATCH_RETRIES: Final = 4
RATE_SLACK: Final = 1e-9  # rates that were computed from a period may miss it by rounding
STREAM_BURSTS: Final = 4096  # per call of the bus: 0.9 MB of accesses

RUN: Final = (
    reg.W_RATE_CONTROL_RUN0_MASK,
    reg.W_RATE_CONTROL_RUN1_MASK,
    reg.W_RATE_CONTROL_RUN2_MASK,
    reg.W_RATE_CONTROL_RUN3_MASK,
)
FORWARD: Final = (
    reg.W_RATE_CONTROL_DIR0_MASK,
    reg.W_RATE_CONTROL_DIR1_MASK,
    reg.W_RATE_CONTROL_DIR2_MASK,
    reg.W_RATE_CONTROL_DIR3_MASK,
)
ALL_RUN: Final = sum(RUN)
ALL_FORWARD: Final = sum(FORWARD)

# Ticks of setup time and pulse width that a board promises to make, by its profile switch
# ``time_code``. 255: all codes but FF, which the document forbids. 256: what the client uses.
TIME_TICKS: Final = {255: (1, 255), 256: (2, 254)}

USC_TYPE: Final = reg.R_IDENT_RESET >> reg.R_IDENT_TYPE_LSB
TYPES: Final = {
    1: "PPMC encoder card",
    2: "PPMC DAC card",
    3: "PPMC DIO card",
    USC_TYPE: "USC",
    5: "UPC",
}
SLOTS: Final = 16  # places of 16 addresses each
TWO_SLOTS: Final = (USC_TYPE, 5)  # types with 32 addresses


@dataclass(frozen=True)
class FoundBoard:
    """A board that answered.

    Parameters
    ----------
    slot : int
        Upper four bits of its address, 0..15; a USC with base b is in slot 2 b.
    ident : int
        Its module ID byte.
    """

    slot: int
    ident: int

    @property
    def type(self) -> int:
        """Kind of board, 4 = USC."""
        return (self.ident & reg.R_IDENT_TYPE_MASK) >> reg.R_IDENT_TYPE_LSB

    @property
    def version(self) -> int:
        """Version of the board, 0..14."""
        return (self.ident & reg.R_IDENT_VERSION_MASK) >> reg.R_IDENT_VERSION_LSB

    @property
    def name(self) -> str:
        """Name of the kind of board."""
        return TYPES.get(self.type, f"unknown type {self.type:X}h")

    @property
    def is_usc(self) -> bool:
        """Whether `UscDriver` drives it."""
        return self.type == USC_TYPE

    @property
    def base(self) -> int:
        """Board select bits, 0..7."""
        return self.slot >> 1

    @property
    def index_reset(self) -> bool:
        """Whether the board can clear an encoder count at its index: a USC from version 2 on."""
        return self.is_usc and self.version >= 2


def find_boards(bus: EppBus) -> tuple[FoundBoard, ...]:
    """Return all boards on a bus, siblings of the USC included, by slot.

    A slot is empty if it reads 00, FF or a low digit F, which is what an address leaves on an
    undriven bus. (Whether the access timed out does not tell: a link may report the time-out of an
    earlier write here.)
    """
    accesses = np.concatenate([read_accesses(slot << 4 | reg.R_IDENT, 1) for slot in range(SLOTS)])
    bus.transact(accesses)
    found: list[FoundBoard] = []
    for slot, ident in enumerate(accesses["value"][1::2].tolist()):
        behind = found and found[-1].type in TWO_SLOTS and found[-1].slot == slot - 1
        if ident != 0x00 and ident & 0x0F != 0x0F and not behind:
            found.append(FoundBoard(slot, ident))
    return tuple(found)


def extend_counts(previous: NDArray[np.int64], raw: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the 64-bit counts nearest to ``previous`` whose low 24 bits are ``raw``.

    Right as long as a count moves by less than 2^23 between two calls.
    """
    half = COUNT_RANGE // 2
    return previous + (raw - previous % COUNT_RANGE + half) % COUNT_RANGE - half


def _three_bytes(value: int) -> bytes:
    return (value % COUNT_RANGE).to_bytes(3, "little")


class UscDriver(Driver[EppBus]):
    """One Universal Stepper Controller on an EPP bus.

    Creating the driver sends nothing. It assumes the reset state until `initialise` has made a
    known one, and it remembers what it wrote, for most registers cannot be read: two drivers for
    one board, or writes past it, break that.

    Parameters
    ----------
    bus : EppBus
        Kept as ``bus``.
    profile : str
        How the board resolves contradictions in its document: ``document`` or ``linuxcnc``.
    **switches : int
        Profile switches that differ from the profile; ``base`` (0..7) selects the board.

    Raises
    ------
    UsageError
        If the profile or a switch is unknown or out of range.

    Examples
    --------
    >>> from pulsewright import open_board
    >>> with open_board("usc") as board:
    ...     board.initialise(pulse_width=2e-6, setup_time=5e-6)
    ...     board.release_estop()
    ...     board.set_step_rate(1, -25_000.0)
    -25000.0
    """

    registers = reg.MAP

    def __init__(self, bus: EppBus, *, profile: str = reg.DEFAULT_PROFILE, **switches: int) -> None:
        self.bus = bus
        self.profile = profile
        self.switches = resolve_switches(reg.MAP, profile, switches)
        self.base = self.switches["base"]
        self._address = self.base << 5
        # The document has the encoder control register at 0C; the client writes 03 on every board.
        self._encoder_control_at = (
            reg.W_ENCODER_CONTROL if profile == "document" else reg.W_ENCODER_CONTROL_ALIAS
        )
        self._hold = self._accesses_for(reg.LOAD_HOLD_TICKS)
        self._found: FoundBoard | None = None
        self._divisor = np.zeros(AXES, np.uint32)
        self._control = 0
        self._width = self._ticks(reg.W_WIDTH_RESET)
        self._setup = self._ticks(reg.W_SETUP_RESET)
        self._outputs = 0
        self._timer = 0
        self._slave = False
        self._position = np.zeros(AXES, np.int64)
        self._index_select = self._index_reset = self._index_seen = 0  # one bit per axis
        self._burst = np.zeros((0, BURST_ACCESSES), EPP_ACCESS)

    # ------------------------------------------------------------------------------- the board

    def identify(self) -> FoundBoard:
        """Ask the board what it is.

        Raises
        ------
        BusTimeoutError
            If no board answers at this base.
        BusError
            If what answers is no USC.
        """
        ident = self._read(reg.R_IDENT, 1)[0]
        found = FoundBoard(self.base << 1, ident)
        if not found.is_usc or found.version == 0x0F:
            raise BusError(
                f"usc base {self.base}: the module ID reads {ident:02X}h, a USC has 40h..4Eh; "
                f"find_boards(bus) lists what is on the bus"
            )
        self._found = found
        return found

    def initialise(
        self,
        *,
        pulse_width: float = CLIENT_PULSE_WIDTH,
        setup_time: float = CLIENT_SETUP_TIME,
        slave: bool = False,
    ) -> None:
        """Bring the board from any state to a safe, known one.

        In emergency stop, axes halted with direction positive, outputs and DAC off, encoder counts
        zero, latch timer off, no index armed. The position is unknown if another program has left
        it out of emergency stop.

        Parameters
        ----------
        pulse_width, setup_time : float
            See `set_pulse_width` and `set_setup_time` [s]; the defaults are those of the client.
        slave : bool
            Ignore the board's own estop chain: the first board of several guards it.
        """
        self.identify()
        self._halting(self._fastest())
        if not self._outputs & reg.W_OUTPUTS_ESTOP_RELEASE_MASK and self.running:
            self.lose_position()  # another program has released it, and axes may move
        width = self._time_to_ticks("pulse width", pulse_width)
        setup = self._time_to_ticks("setup time", setup_time)
        self._divisor[:] = 0
        self._control = ALL_FORWARD
        self._width, self._setup = width, setup
        self._outputs = self._timer = 0
        self._slave = slave
        self._position[:] = 0
        self._index_select = self._index_reset = self._index_seen = 0
        self._send(
            self._writing(reg.W_OUTPUTS, [0]),  # emergency stop comes first
            self._writing(
                BURST_ADDRESS,
                [*bytes(3 * AXES), self._control, self._code(setup), self._code(width), 0],
            ),
            self._writing(reg.W_DAC, [0]),
            self._writing(reg.W_INDEX_RESET, [0]),
            self._writing(reg.W_SLAVE, [slave]),
            self._writing(reg.W_TIMER, [0]),
            *self._loading((1 << AXES) - 1, 0),
            self._reading(reg.R_INDEX_SENSE, 1),  # discards stale bits
        )

    # ------------------------------------------------------------------------------- step rates

    def set_step_rate(self, axis: int, rate: float) -> float:
        """Set the step rate of one axis; return the rate that the board will run.

        Parameters
        ----------
        axis : int
            0..3.
        rate : float
            [step/s]; the sign is the direction (direction pin 1 for positive and zero), 0 halts.

        Returns
        -------
        float
            The nearest rate that a whole number of ticks gives [step/s].

        Raises
        ------
        RegisterValueError
            If ``rate`` is above `max_step_rate` or too slow for the 24-bit divisor. Nothing is
            written then.
        """
        self._require_axis(axis)
        divisor, control = self._rate_command(axis, rate)
        self._divisor[axis] = divisor
        self._control = control
        self._send(
            self._writing(reg.W_DIVISOR[axis], _three_bytes(divisor)),
            self._writing(reg.W_RATE_CONTROL, [control]),
        )
        return self.step_rates()[axis]

    def set_step_rates(self, rates: Sequence[float] | NDArray[np.float64]) -> tuple[float, ...]:
        """Set the step rates of all four axes in one burst; return the rates the board will run.

        Units and errors as in `set_step_rate`. The burst also feeds the watchdog.
        """
        if len(rates) != AXES:
            raise UsageError(f"usc: {len(rates)} step rates given, the board has {AXES} axes")
        divisors, control = [], self._control
        for axis, rate in enumerate(rates):
            divisor, control = self._rate_command(axis, rate, control)
            divisors.append(divisor)
        self._divisor[:] = divisors
        self._control = control
        self._send(self._rate_burst())
        return self.step_rates()

    def step_rates(self) -> tuple[float, ...]:
        """Return the rates commanded last, signed [step/s]; an axis that is halted has 0."""
        return tuple(
            math.copysign(reg.TICK_HZ / self._period(axis), self._direction(axis))
            if self._runs(axis)
            else 0.0
            for axis in range(AXES)
        )

    def stop(self, axis: int | None = None) -> None:
        """Halt one axis, or all of them, at once: no ramp. A pulse in flight is finished.

        The position is unknown then, if it ran faster than `start_stop_rate`.
        """
        if axis is not None:
            self._require_axis(axis)
        self._halting(self._fastest(axis))
        self._control &= ~(ALL_RUN if axis is None else RUN[axis])
        self._write(reg.W_RATE_CONTROL, [self._control])

    def max_step_rate(self) -> float:
        """Return the highest rate with the present pulse width [step/s]."""
        return reg.TICK_HZ / self._shortest_period(self._width)

    def stream(self, updates: RateUpdates) -> None:
        """Send rate commands for all axes, each burst at its own clock cycle.

        The high byte of axis i acts ``DIVISOR_ACCESS[i]`` accesses after ``updates.cycle``, run and
        direction ``CONTROL_ACCESS`` accesses after it (see `burst`). Whether the board was running
        all the time is for `check_running` to say afterwards.

        Parameters
        ----------
        updates : RateUpdates
            n commands in columns, in rising order of cycles. What is converted with
            `commands.Converter` fits.

        Raises
        ------
        LateError
            If an access acted at another cycle than asked: the motion is not what was planned.
        BusTimeoutError
            If the board did not acknowledge.
        RegisterValueError
            If a divisor does not fit in 24 bits, or lets an axis run faster than `max_step_rate`.
        """
        cycle = np.asarray(updates.cycle, np.int64)
        divisor = np.ascontiguousarray(updates.divisor, "<u4")
        control = np.asarray(updates.control, np.uint8)
        n = len(cycle)
        if divisor.shape != (n, AXES) or control.shape != (n,):
            raise UsageError(
                f"usc: updates with {n} cycles need divisors of shape ({n}, {AXES}) and control "
                f"bytes of shape ({n},), not {divisor.shape} and {control.shape}"
            )
        if n:
            self._require_divisors(divisor, control)
        for first in range(0, n, STREAM_BURSTS):
            part = slice(first, first + STREAM_BURSTS)
            self._stream(cycle[part], divisor[part], control[part])

    # ------------------------------------------------------------------------------- pulse shape

    @property
    def width_ticks(self) -> int:
        """Time the step pin is active [tick of 0.1 us]."""
        return self._width

    @property
    def space_ticks(self) -> int:
        """Shortest time the step pin is inactive between two steps [tick]."""
        return self.switches["min_space"]

    @property
    def setup_ticks(self) -> int:
        """Time the board keeps direction changes and step pulses apart [tick]."""
        return self._setup

    @property
    def div_offset(self) -> int:
        """Step period minus divisor [tick]."""
        return self.switches["div_offset"]

    def set_pulse_width(self, seconds: float) -> float:
        """Set how long the step pins are active, at least ``seconds``; return the real time [s].

        Raises
        ------
        RegisterValueError
            If the time is out of range, or an axis runs too fast for it.
        """
        ticks = self._time_to_ticks("pulse width", seconds)
        shortest = self._shortest_period(ticks)
        for axis in range(AXES):
            if self._runs(axis) and self._period(axis) < shortest:
                raise RegisterValueError(
                    f"usc axis {axis}: runs at {abs(self.step_rates()[axis]):g} step/s, a pulse "
                    f"width of {ticks * TICK * 1e6:g} us allows {reg.TICK_HZ / shortest:g}; slow "
                    f"the axis down first"
                )
        self._width = ticks
        self._write(reg.W_WIDTH, [self._code(ticks)])
        return ticks * TICK

    def set_setup_time(self, seconds: float) -> float:
        """Set the time between a direction change and a step, both ways; return the real time [s].

        Both times are at least ``seconds``.

        Raises
        ------
        RegisterValueError
            If the time is out of range.
        """
        ticks = self._time_to_ticks("setup time", seconds)
        self._setup = ticks
        self._write(reg.W_SETUP, [self._code(ticks)])
        return ticks * TICK

    # ------------------------------------------------------------------------------- encoders

    def read_encoders(self) -> NDArray[np.int64]:
        """Latch all encoder counts at one instant and return them, shape (4,).

        The board counts 24 bits; call this before an encoder moves by 2^23 counts, and the driver
        extends them to 64. An axis whose index is armed keeps the count it had then.
        """
        latch = self._timer | reg.W_TIMER_SOFT_LATCH_MASK
        accesses = self._send(
            *self._held(reg.W_TIMER, latch, self._timer),
            self._reading(reg.R_ENCODER_COUNT[0], 3 * AXES),
        )
        data = bytes(accesses["value"][-3 * AXES :])
        if self._timer:
            data = self._read_settled(data)
        counts = np.frombuffer(data, np.uint8).reshape(AXES, 3).astype(np.int64)
        self._position = extend_counts(self._position, counts @ BYTE_WEIGHTS)
        return self._position.copy()

    def load_position(self, axis: int, count: int) -> None:
        """Set the encoder count of an axis. Counts during the 2 us that this takes are lost.

        Parameters
        ----------
        axis : int
            0..3.
        count : int
            Any 64-bit number; the board gets its low 24 bits.
        """
        self._require_axis(axis)
        limit = 1 << 62
        if not -limit <= count < limit:
            raise RegisterValueError(
                f"usc axis {axis}: position {count} asked, allowed are -2^62..2^62 - 1"
            )
        self._send(*self._loading(1 << axis, count))
        self._position[axis] = count

    def arm_index(self, axis: int, *, reset: bool = False) -> None:
        """Wait for the next index of an encoder; `index_seen` tells when it has come.

        Parameters
        ----------
        axis : int
            0..3.
        reset : bool
            False: the board captures the count, see `index_position`. True: the board sets the
            count to 0 at the index and goes on counting.

        Raises
        ------
        UsageError
            If ``reset`` is asked of a board before version 2.
        """
        self._require_axis(axis)
        bit = 1 << axis
        if reset:
            found = self._found or self.identify()
            if not found.index_reset:
                raise UsageError(
                    f"usc axis {axis}: index reset needs a board of version 2 or later, this one "
                    f"is version {found.version}; use arm_index({axis}) and index_position({axis})"
                )
            self._index_reset |= bit
            self._write(reg.W_INDEX_RESET, [self._index_reset])
        else:
            self._index_select |= bit
            self._write(self._encoder_control_at, [self._index_select])
        # "This register must be read once before the values are meaningful."
        self._sense_index()
        self._index_seen &= ~bit

    def disarm_index(self, axis: int) -> None:
        """Stop waiting for the index of an encoder."""
        self._require_axis(axis)
        bit = 1 << axis
        self._index_select &= ~bit
        self._index_reset &= ~bit
        self._index_seen &= ~bit
        self._write(self._encoder_control_at, [self._index_select])
        self._write(reg.W_INDEX_RESET, [self._index_reset])

    def index_seen(self) -> tuple[bool, ...]:
        """Tell for each axis whether its index has come since it was armed.

        An axis armed with ``reset`` is disarmed when this first says so; its position counts from
        the index then.
        """
        self._sense_index()
        done = self._index_seen & self._index_reset
        if done:
            self._index_reset &= ~done
            self._write(reg.W_INDEX_RESET, [self._index_reset])
            for axis in range(AXES):
                if done >> axis & 1:
                    self._position[axis] = 0
        return tuple(bool(self._index_seen >> axis & 1) for axis in range(AXES))

    def index_position(self, axis: int) -> int:
        """Return the count captured at the index, and disarm it.

        Raises
        ------
        UsageError
            If the index is not armed for capture, or has not been seen.
        """
        self._require_axis(axis)
        if not self._index_select & self._index_seen & 1 << axis:
            raise UsageError(
                f"usc axis {axis}: no index captured; call arm_index({axis}), then wait until "
                f"index_seen()[{axis}]"
            )
        raw = int.from_bytes(self._read(reg.R_ENCODER_COUNT[axis], 3), "little")
        self.disarm_index(axis)
        return int(extend_counts(self._position[axis : axis + 1], np.array([raw]))[0])

    def set_master_timer(self, rate: float) -> float:
        """Let the board latch its encoders by itself; return the real rate [1/s].

        The nearest of 10 kHz / 1 .. 10 kHz / 15; 0 switches the timer off. (The document leaves the
        table of rates empty: this one is ours.)

        Raises
        ------
        RegisterValueError
            If the rate is out of range.
        """
        fastest = reg.TICK_HZ / reg.TIMER_UNIT_TICKS
        slowest = fastest / reg.W_TIMER_RATE_MASK
        code = 0
        if rate != 0:
            if not slowest * (1 - 1e-9) <= rate <= fastest:
                raise RegisterValueError(
                    f"usc: latch timer rate {rate:g} Hz asked, allowed are 0 (off) and "
                    f"{slowest:.6g}..{fastest:g} Hz"
                )
            code = round(fastest / rate)
        self._timer = code | (reg.W_TIMER_MASTER_MASK if code else 0)
        self._write(reg.W_TIMER, [self._timer])
        return fastest / code if code else 0.0

    # ------------------------------------------------------------------------------- in and out

    def read_inputs(self) -> int:
        """Return the 15 digital inputs, input 0 in bit 0."""
        low, high = self._read(reg.R_INPUTS_LOW, 2)
        return low | (high & reg.R_INPUTS_HIGH_INPUTS_MASK) << 8

    def read_input(self, number: int) -> bool:
        """Return one digital input, 0..14."""
        self._require("input", number, INPUTS)
        return bool(self.read_inputs() >> number & 1)

    def write_outputs(self, word: int) -> None:
        """Set the 7 outputs (solid-state relays), output 0 in bit 0. They are off in estop."""
        if not 0 <= word <= reg.W_OUTPUTS_SSR_MASK:
            raise RegisterValueError(
                f"usc: output word {word:#x} asked, allowed are 0..{reg.W_OUTPUTS_SSR_MASK:#x}"
            )
        self._outputs = self._outputs & reg.W_OUTPUTS_ESTOP_RELEASE_MASK | word
        self._write(reg.W_OUTPUTS, [self._outputs])

    def write_output(self, number: int, level: bool) -> None:
        """Set one output, 0..6."""
        self._require("output", number, OUTPUTS)
        others = self._outputs & reg.W_OUTPUTS_SSR_MASK & ~(1 << number)
        self.write_outputs(others | bool(level) << number)

    def set_dac(self, volts: float) -> float:
        """Set the DAC on connector P8, 0..10 V; return the real voltage [V]. It is 0 in estop.

        Rounds down as the client does: 5 V gives code 127. For 8 digital outputs instead of a DAC
        write register ``W_DAC`` with `write_register`.

        Raises
        ------
        RegisterValueError
            If the voltage is out of range; the sign of a spindle command is up to two outputs.
        """
        if not 0 <= volts <= DAC_FULL_SCALE:
            raise RegisterValueError(
                f"usc: DAC voltage {volts:g} V asked, allowed are 0..{DAC_FULL_SCALE:g} V; the DAC "
                f"has no sign, use outputs for the direction"
            )
        code = math.floor(round(volts / DAC_FULL_SCALE * DAC_CODES, 9))
        self._write(reg.W_DAC, [code])
        return code * DAC_FULL_SCALE / DAC_CODES

    # ------------------------------------------------------------------------------- estop

    @property
    def running(self) -> bool:
        """Whether the board is out of emergency stop."""
        return bool(self._read(reg.R_INPUTS_HIGH, 1)[0] & reg.R_INPUTS_HIGH_RUNNING_MASK)

    def estop(self) -> None:
        """Enter emergency stop at once, without a ramp; only `release_estop` leaves it.

        The position is unknown then, if an axis ran faster than `start_stop_rate`.
        """
        self._halting(self._fastest())
        self._outputs &= ~reg.W_OUTPUTS_ESTOP_RELEASE_MASK
        self._write(reg.W_OUTPUTS, [self._outputs])

    def release_estop(self) -> None:
        """Halt all axes, feed the watchdog, leave emergency stop, and make sure of it.

        Directions become positive, as after `initialise`.
        From now on the watchdog wants to be fed: by `set_step_rates`, `stream` or `feed_watchdog`.

        Raises
        ------
        EstopError
            If the board stays in emergency stop; names the likely cause.
        """
        self._halting(self._fastest())
        self._control = ALL_FORWARD
        stopped = self._outputs & reg.W_OUTPUTS_SSR_MASK
        self._outputs = stopped | reg.W_OUTPUTS_ESTOP_RELEASE_MASK
        accesses = self._send(
            self._rate_burst(),
            self._writing(reg.W_OUTPUTS, [stopped]),  # what counts is a rising edge
            self._writing(reg.W_OUTPUTS, [self._outputs]),
            self._reading(reg.R_INPUTS_HIGH, 1),
        )
        if accesses["value"][-1] & reg.R_INPUTS_HIGH_RUNNING_MASK:
            return
        self._outputs = stopped
        self._write(reg.W_OUTPUTS, [stopped])
        since_feed = int(accesses["cycle"][-1] - accesses["cycle"][0]) / self.bus.clock_hz * 1e6
        watchdog = self.switches["watchdog_us"]
        if watchdog and since_feed >= watchdog:
            cause = (
                f"the watchdog time of {watchdog} us is over before the {since_feed:.0f} us that "
                f"the release takes on this link; use a faster link or open the watchdog jumper"
            )
        elif self._slave:
            cause = "the board ignores its own chain as a slave, so the watchdog is the likely one"
        else:
            cause = (
                "the estop chain is most likely open; check its buttons and limit switches, or "
                "initialise(slave=True) where another board guards the chain"
            )
        raise EstopError(f"usc base {self.base}: stays in emergency stop when released: {cause}")

    def check_running(self) -> None:
        """Check that the board is out of emergency stop.

        Raises
        ------
        EstopError
            If not.
        """
        if not self.running:
            if not self._outputs & reg.W_OUTPUTS_ESTOP_RELEASE_MASK:
                cause = "it was not released; call release_estop()"
            else:
                self._halting(self._fastest())
                watchdog = self.switches["watchdog_us"]
                cause = "the estop chain opened" + (
                    f", or no two adjacent axes were written for {watchdog} us (watchdog)"
                    if watchdog
                    else ""
                )
            raise EstopError(f"usc base {self.base}: in emergency stop: {cause}")

    def feed_watchdog(self) -> None:
        """Keep the watchdog satisfied for another period: rewrites the divisors of axes 0 and 1."""
        divisors = b"".join(_three_bytes(int(divisor)) for divisor in self._divisor[:2])
        self._write(reg.W_DIVISOR[0], divisors)

    # ------------------------------------------------------------------------------- raw access

    def read_register(self, name: str, instance: int = 0) -> dict[str, int]:
        """Return the raw fields of a register by its name in the register map.

        >>> from pulsewright import open_board
        >>> open_board("usc").read_register("R_IDENT")
        {'type': 4, 'version': 1}
        """
        register, address = self._register("read", name, instance)
        return decode_bytes(register, self._read(address, register.size))

    def write_register(self, name: str, instance: int = 0, **fields: SupportsIndex) -> None:
        """Write raw fields to a register by its name in the register map; others become 0.

        The methods above do not learn of it and overwrite it with what they remember.

        >>> from pulsewright import open_board
        >>> open_board("usc").write_register("W_DIVISOR", instance=1, value=399)
        """
        register, address = self._register("write", name, instance)
        self._write(address, encode_bytes(register, **fields))

    # ------------------------------------------------------------------------------- below

    def _send(self, *parts: NDArray[np.void]) -> NDArray[np.void]:
        """Carry out accesses in one transaction; return them."""
        accesses = np.concatenate(parts)
        self.bus.transact(accesses)
        require_acknowledge(accesses)
        return accesses

    def _read(self, register: int, count: int) -> bytes:
        return self.bus.read(self._address | register, count)

    def _write(self, register: int, data: bytes | Sequence[int]) -> None:
        self.bus.write(self._address | register, bytes(data))

    def _reading(self, register: int, count: int) -> NDArray[np.void]:
        return read_accesses(self._address | register, count)

    def _writing(self, register: int, data: bytes | Sequence[int]) -> NDArray[np.void]:
        return write_accesses(self._address | register, data)

    def _accesses_for(self, ticks: int) -> int:
        """Return how many accesses take at least ``ticks``."""
        cycles = -(-ticks * self.bus.clock_hz // reg.TICK_HZ)
        return max(2, -(-cycles // max(self.bus.access_cycles, 1)))

    def _held(self, register: int, value: int, after: int) -> list[NDArray[np.void]]:
        """Return accesses that write ``value``, hold it for 2 us, and write ``after``.

        The client holds the soft latch for that time, the document the load position bits. Address
        writes fill the time: they change nothing, on every board and link.
        """
        wait = self._writing(register, [])
        return [
            self._writing(register, [value]),
            *[wait] * (self._hold - 2),
            self._writing(register, [after]),
        ]

    def _loading(self, axes: int, count: int) -> list[NDArray[np.void]]:
        """Return accesses that load the counters of ``axes`` (one bit each) with ``count``."""
        control = axes << reg.W_ENCODER_CONTROL_LOAD_LSB | self._index_select
        return [
            self._writing(reg.W_ASSEMBLY, _three_bytes(count)),
            *self._held(self._encoder_control_at, control, self._index_select),
        ]

    def _read_settled(self, data: bytes) -> bytes:
        """Read the counts until they equal ``data``: the timer may latch between two bytes."""
        for _ in range(LATCH_RETRIES):
            before, data = data, self._read(reg.R_ENCODER_COUNT[0], 3 * AXES)
            if data == before:
                return data
        raise BusError(
            f"usc base {self.base}: the latch timer changes the counts faster than this link reads "
            f"them; set_master_timer to a lower rate or 0"
        )

    def _sense_index(self) -> None:
        """Collect index sense bits: reading clears those of all axes."""
        sense = self._read(reg.R_INDEX_SENSE, 1)[0]
        self._index_seen |= sense & (self._index_select | self._index_reset)

    def _ticks(self, code: int) -> int:
        return max(1, self.switches["time_code"] - code)

    def _code(self, ticks: int) -> int:
        return self.switches["time_code"] - ticks

    def _time_to_ticks(self, what: str, seconds: float) -> int:
        """Return the fewest ticks that last at least ``seconds``."""
        low, high = TIME_TICKS[self.switches["time_code"]]
        exact = round(seconds * reg.TICK_HZ, 6) if math.isfinite(seconds) else math.inf
        if not 0 < exact <= high:
            raise RegisterValueError(
                f"usc: {what} {seconds * 1e6:g} us asked, allowed are {low * TICK * 1e6:g}.."
                f"{high * TICK * 1e6:g} us in steps of 0.1 us (all axes share it)"
            )
        return max(low, math.ceil(exact))

    def _shortest_period(self, width: int) -> int:
        return max(width + self.space_ticks, 1 + self.div_offset)

    def _period(self, axis: int) -> int:
        return int(self._divisor[axis]) + self.div_offset

    def _direction(self, axis: int) -> int:
        return 1 if self._control & FORWARD[axis] else -1

    def _runs(self, axis: int) -> bool:
        return bool(self._control & RUN[axis] and self._divisor[axis])

    def _rate_command(self, axis: int, rate: float, control: int | None = None) -> tuple[int, int]:
        """Return divisor and new control byte for a rate."""
        control = self._control if control is None else control
        control &= ~(RUN[axis] | FORWARD[axis])
        control |= FORWARD[axis] if not rate < 0 else 0
        if rate == 0:
            return int(self._divisor[axis]), control
        slowest = reg.TICK_HZ / (MAX_DIVISOR + self.div_offset)
        fastest = self.max_step_rate()
        if not slowest * (1 - RATE_SLACK) <= abs(rate) <= fastest * (1 + RATE_SLACK):
            raise RegisterValueError(
                f"usc axis {axis}: {rate:g} step/s asked, allowed are 0 and {slowest:.4g}.."
                f"{fastest:.6g} step/s either way with a pulse width of "
                f"{self._width * TICK * 1e6:g} us; change feed, steps per mm or pulse width"
            )
        period = math.floor(reg.TICK_HZ / abs(rate) + 0.5)  # half a tick up, as the client rounds
        return period - self.div_offset, control | RUN[axis]

    def _fastest(self, axis: int | None = None) -> float:
        """Return the highest rate of an axis, or of all [step/s]; 0 in emergency stop."""
        if not self._outputs & reg.W_OUTPUTS_ESTOP_RELEASE_MASK:
            return 0.0
        rates = self.step_rates()
        return max(map(abs, rates if axis is None else rates[axis : axis + 1]))

    def _rate_burst(self) -> NDArray[np.void]:
        divisors = b"".join(_three_bytes(int(divisor)) for divisor in self._divisor)
        return self._writing(BURST_ADDRESS, [*divisors, self._control])

    def _require_axis(self, axis: int) -> None:
        self._require("axis", axis, AXES)

    def _require_divisors(self, divisor: NDArray[np.uint32], control: NDArray[np.uint8]) -> None:
        """Check the divisors of a stream; looks at single ones only where something is wrong."""
        lowest = self._shortest_period(self._width) - self.div_offset
        if divisor.max() > MAX_DIVISOR:
            self._refuse_divisor(divisor, divisor > MAX_DIVISOR, lowest)
        # an unsigned 0 - 1 is large: halted axes (0) pass
        if lowest > 1 and (divisor - np.uint32(1)).min() < lowest - 1:
            runs = (control[:, None] & np.array(RUN, np.uint8)) != 0
            fast = (divisor < lowest) & (divisor > 0) & runs
            if fast.any():
                self._refuse_divisor(divisor, fast, lowest)

    def _refuse_divisor(
        self, divisor: NDArray[np.uint32], wrong: NDArray[np.bool_], lowest: int
    ) -> NoReturn:
        update, axis = (int(k) for k in np.argwhere(wrong)[0])
        raise RegisterValueError(
            f"usc axis {axis}: divisor {divisor[update, axis]} in update {update}, allowed are 0 "
            f"(halt) and {lowest}..{MAX_DIVISOR} with a pulse width of "
            f"{self._width * TICK * 1e6:g} us; plan with the pulse timing of this board"
        )

    def _burst_buffer(self, n: int) -> NDArray[np.void]:
        """Return a reusable array of n bursts; what never changes is filled in already."""
        if len(self._burst) < n:
            self._burst = np.zeros((n, BURST_ACCESSES), EPP_ACCESS)
            self._burst["op"] = DATA_WRITE
            self._burst["op"][:, 0] = ADDRESS_WRITE
            self._burst["value"][:, 0] = self._address | BURST_ADDRESS
        return self._burst[:n]

    def _stream(
        self,
        cycle: NDArray[np.int64],
        divisor: NDArray[np.uint32],
        control: NDArray[np.uint8],
    ) -> None:
        n = len(cycle)
        burst = self._burst_buffer(n)
        asked = cycle[:, None] + np.arange(BURST_ACCESSES) * self.bus.access_cycles
        burst["cycle"] = asked
        burst["timeout"] = 0
        low_bytes = divisor.view(np.uint8).reshape(n, AXES, 4)[:, :, :3]
        burst["value"][:, 1:-1] = low_bytes.reshape(n, 3 * AXES)
        burst["value"][:, -1] = control
        self._divisor[:], self._control = divisor[-1], int(control[-1])
        self.bus.transact(burst.reshape(-1))
        require_acknowledge(burst.reshape(-1))
        late = burst["cycle"] != asked
        if late.any():
            update, access = (int(k) for k in np.argwhere(late)[0])
            by = int(burst["cycle"][update, access] - asked[update, access])
            raise LateError(
                f"usc base {self.base}: {int(late.any(axis=1).sum())} of {n} rate commands came "
                f"late, the first one, for cycle {cycle[update]}, by {by} cycles "
                f"({by / self.bus.clock_hz * 1e6:.3g} us): the motion is not as planned; start "
                f"later after now() or leave more time between commands"
            )
