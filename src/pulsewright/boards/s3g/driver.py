"""The S3G board in engineering units, over a serial port.

Names, numbers and fields come from the register map. The board tells little of itself: of the
output registers only the loop-back can be read, and of the motion only the counters of acceleration
steps. So the driver remembers what it wrote.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.board import resolve_switches
from pulsewright.boards.driving import Driver
from pulsewright.boards.s3g import packets
from pulsewright.boards.s3g import registers as reg
from pulsewright.boards.s3g.program import Program
from pulsewright.boards.s3g.pulses import PulseTiming
from pulsewright.boards.s3g.words import DRY, RATE_UNIT, SET_VELOCITY, load_control
from pulsewright.errors import (
    BusError,
    BusTimeoutError,
    EstopError,
    RegisterValueError,
    UsageError,
)
from pulsewright.registers.codec import decode, encode
from pulsewright.transport.serial_bus import SerialBus

CLOCK: Final = 1 / reg.CLOCK_HZ  # [s]
OUTPUTS: Final = reg.W_LEDS_LEDS_MASK.bit_count()
ALL: Final = 0xFFFF_FFFF  # interrupts
TIMEOUT: Final = 1.0  # [s]
RETRIES: Final = 3
TAGS: Final = (1000, 65_000)
DEFAULT_PULSE: Final = 2.5e-6  # width and space of pulses [s]
DEFAULT_DIRECTION: Final = 5e-6  # setup and hold [s]
LONGEST_TIME: Final = 1e-3  # of a pulse [s]
FRAME_BITS: Final = 10  # of a byte on the wire
SHORTEST_REPLY: Final = len(packets.frame(bytes(packets.SHORTEST)))
FILLER: Final = bytes(256 + 2)  # completes any packet that the board waits for
QUIET: Final = 0.02  # after that, for the board to answer what was completed [s]


@dataclass(frozen=True)
class Identity:
    """What a board says of itself."""

    version: int
    extended: int


@dataclass(frozen=True)
class ProgramStatus:
    """State of the program executor.

    Parameters
    ----------
    busy : bool
        It runs.
    waiting : bool
        It runs, and waits for interrupts.
    error : int
        A code of table BE of the register map, or of the program's own ``DONE``.
    pc : int
        Address of the instruction, 0..65535.
    """

    busy: bool
    waiting: bool
    error: int
    pc: int

    @property
    def text(self) -> str:
        """The state in words."""
        code = reg.MAP.table("BE").at(self.error)
        name = code.name if code else f"ended with code {self.error:#04x}"
        return f"{'busy' if self.busy else 'idle'} at address {self.pc}: {name}"


class S3GDriver(Driver[SerialBus]):
    """One S3G board on a serial port.

    Creating the driver sends nothing. It assumes the reset state until `initialise` has made a
    known one, and it remembers what it wrote: two drivers for one board, or writes past it, break
    that.

    The board has no emergency stop. The driver offers one that is alike on all boards:
    `release_estop` enables the motors, `estop` stops all motion at once and disables them.

    A request that is not answered, or answered as damaged, is repeated. All requests may be
    repeated but `start_program`, which is not.

    Parameters
    ----------
    bus : SerialBus
        Kept as ``bus``.
    profile : str
        ``exact`` or ``robust``.
    channels : int
        Motors of the board, 1..6.
    prog_words : int
        Size of its program memory, a power of 2.
    baud : int
        Baud rate of the port.
    timeout : float
        Time to wait for a reply [s].
    retries : int
        How often a request is repeated.
    **switches : int
        Profile switches that differ from the profile.

    Raises
    ------
    UsageError
        If a parameter is unknown or out of range.

    Examples
    --------
    >>> from pulsewright import open_board
    >>> with open_board("s3g") as board:
    ...     board.initialise()
    ...     board.release_estop()
    ...     board.set_step_rate(1, -25_000.0)
    -25177.001953125
    """

    registers = reg.MAP

    def __init__(
        self,
        bus: SerialBus,
        *,
        profile: str = reg.DEFAULT_PROFILE,
        channels: int = reg.CHANNELS,
        prog_words: int = reg.PROG_WORDS,
        baud: int = reg.BAUD1,
        timeout: float = TIMEOUT,
        retries: int = RETRIES,
        **switches: int,
    ) -> None:
        self.bus = bus
        self.profile = profile
        self.switches = resolve_switches(reg.MAP, profile, switches)
        if not 1 <= channels <= reg.MAX_CHANNELS:
            raise UsageError(f"s3g: {channels} channels asked; there may be 1..{reg.MAX_CHANNELS}")
        if not 1 <= prog_words <= 1 << 16 or prog_words & (prog_words - 1):
            raise UsageError(
                f"s3g: program memory of {prog_words} words asked; it may have a power of 2 up to "
                f"{1 << 16}"
            )
        self.channels, self.prog_words, self.baud = channels, prog_words, baud
        self.timeout, self.retries = timeout, retries
        self.retried = 0  # requests repeated so far
        self._decoder = packets.Decoder()
        self._random = random.Random()
        self._events: list[int] = []
        self._velocity = np.zeros(channels, np.int64)
        self._timing = PulseTiming(1, 1, 1)
        self._enabled = self._outputs = 0
        self._touched = False

    # ------------------------------------------------------------------------------- the board

    def identify(self) -> Identity:
        """Ask the board what it is.

        Raises
        ------
        BusTimeoutError
            If no board answers.
        BusError
            If what answers is another board.
        """
        version = self.request("VERSION")["version"]
        if version != reg.VERSION:
            raise BusError(
                f"s3g: the board tells version {version:04X}, expected {reg.VERSION:04X}; is this "
                f"the right port?"
            )
        return Identity(version, self.request("EXT_VER")["version"])

    def initialise(
        self,
        *,
        pulse_width: float = DEFAULT_PULSE,
        pulse_space: float = DEFAULT_PULSE,
        direction_setup: float = DEFAULT_DIRECTION,
        direction_hold: float = DEFAULT_DIRECTION,
    ) -> None:
        """Bring the board from any state to a known one: at rest, motors and outputs off.

        A program that runs is ended; no interrupt is pending or reported. The position is unknown
        then, and where the plan of another program ran out before its end.

        Parameters
        ----------
        pulse_width, pulse_space, direction_setup, direction_hold : float
            See `set_times` [s].
        """
        timing = _timing(pulse_width, pulse_space, direction_setup, direction_hold)
        self._halting(max(map(abs, self.step_rates())))
        fresh, status = not self._touched, self.status()
        if status.busy or (fresh and status.error == DRY):
            self.lose_position()  # a plan that was not played to its end
        self.abort_program()
        self.mask_interrupts(0)
        self._enabled = self._outputs = 0
        self._velocity[:] = 0
        self._load()
        self._write(reg.W_MSG_CONTROL, 0)
        self._write(reg.W_LEDS, 0)
        self._set_timing(timing)
        self.clear_interrupts(ALL)
        self._events.clear()

    def close(self) -> None:
        """Stop the program and all motion, if this driver has sent anything; release the bus."""
        try:
            if self._touched:
                self.stop()
        finally:
            self._touched = False
            self.bus.close()

    def _leave(self) -> None:
        """Stop all motion and disable the motors, if this driver has sent anything."""
        if self._touched:
            try:
                self.estop()
            finally:
                self._touched = False  # `close` does not try again

    # ------------------------------------------------------------------------------- motors, estop

    @property
    def running(self) -> bool:
        """Whether motors are enabled."""
        return self._enabled != 0

    def release_estop(self) -> None:
        """Enable all motors."""
        self.enable_motors((1 << self.channels) - 1)

    def estop(self) -> None:
        """Stop the program and all motion at once, without a ramp, and disable the motors.

        The position is unknown then, if a motor ran faster than `start_stop_rate`.
        """
        self.stop()
        self.enable_motors(0)

    def enable_motors(self, mask: int) -> None:
        """Enable the motors in a mask, one bit each, and disable the others. Their pins go low."""
        if not 0 <= mask < 1 << self.channels:
            raise RegisterValueError(
                f"s3g: motor mask {mask:#x} asked; allowed are 0..{(1 << self.channels) - 1:#x} "
                f"with {self.channels} channels"
            )
        self._write(reg.W_MSG_CONTROL, mask)
        self._enabled = mask

    def check_running(self) -> None:
        """Check that the motors are enabled and the board answers.

        Raises
        ------
        EstopError
            If they are not.
        BusTimeoutError
            If it does not.
        """
        if not self.running:
            raise EstopError("s3g: the motors are not enabled; call release_estop()")
        self.status()

    # ------------------------------------------------------------------------------- step rates

    def set_step_rate(self, axis: int, rate: float) -> float:
        """Set the step rate of one channel at once, without a ramp; return the real rate.

        Not while a program moves the channels.

        Parameters
        ----------
        axis : int
            Channel, from 0 on.
        rate : float
            [step/s]; the sign is the direction (direction pin 1 for positive).

        Returns
        -------
        float
            The nearest rate that the board has, a multiple of 763 step/s [step/s].

        Raises
        ------
        RegisterValueError
            If ``rate`` is above `max_step_rate`. Nothing is written then.
        EstopError
            If `release_estop` was not called.
        """
        self._require("axis", axis, self.channels)
        rates = [*self.step_rates()]
        rates[axis] = rate
        return self.set_step_rates(rates)[axis]

    def set_step_rates(self, rates: Sequence[float] | NDArray[np.float64]) -> tuple[float, ...]:
        """Set the step rates of all channels in the same clock; return the real rates.

        Units and errors as in `set_step_rate`.
        """
        if len(rates) != self.channels:
            raise UsageError(
                f"s3g: {len(rates)} step rates given, the board has {self.channels} channels"
            )
        velocity = [self._velocity_for(axis, rate) for axis, rate in enumerate(rates)]
        if any(velocity) and not self.running:
            raise EstopError("s3g: the motors are not enabled; call release_estop()")
        self._velocity[:] = velocity
        self._load()
        return self.step_rates()

    def step_rates(self) -> tuple[float, ...]:
        """Return the rates commanded last, signed [step/s]; those of programs are not known."""
        return tuple((self._velocity * RATE_UNIT).tolist())

    def stop(self) -> None:
        """End the program and halt all channels at once: no ramp. A pulse in flight is finished.

        The position is unknown then, if a motor ran faster than `start_stop_rate`.
        """
        self._halting(max(map(abs, self.step_rates())))
        self.abort_program()
        self._velocity[:] = 0
        self._load()

    def max_step_rate(self) -> float:
        """Return the highest rate with the present pulse times [step/s]."""
        return self._timing.limit * RATE_UNIT

    # ------------------------------------------------------------------------------- pulse shape

    @property
    def timing(self) -> PulseTiming:
        """Thresholds of the pulse formers [clock]."""
        return self._timing

    def set_times(
        self,
        *,
        pulse_width: float,
        pulse_space: float,
        direction_setup: float,
        direction_hold: float,
    ) -> tuple[float, float, float, float]:
        """Set the pulse timing of all channels; return the times that the board will keep [s].

        Parameters
        ----------
        pulse_width, pulse_space : float
            The step pins are active so long, and inactive at least so long [s].
        direction_setup, direction_hold : float
            Least time from a change of direction to a step edge, and from that to the next change
            [s].

        Raises
        ------
        RegisterValueError
            If a time is negative or above 1 ms, or a channel runs too fast for these times.
        """
        timing = _timing(pulse_width, pulse_space, direction_setup, direction_hold)
        fast = np.flatnonzero(abs(self._velocity) > timing.limit)
        if len(fast):
            raise RegisterValueError(
                f"s3g axis {fast[0]}: runs at {abs(self.step_rates()[fast[0]]):g} step/s, these "
                f"times allow {timing.limit * RATE_UNIT:g}; slow it down first"
            )
        self._set_timing(timing)
        width = timing.pulse - timing.pre
        clocks = width, timing.spacing - width, timing.pre, timing.spacing - timing.pre
        width_s, space_s, setup_s, hold_s = (n * CLOCK for n in clocks)
        return width_s, space_s, setup_s, hold_s

    # ------------------------------------------------------------------------------- outputs

    def write_outputs(self, word: int) -> None:
        """Set all outputs, the LED pins: bit i is output i, 0..7."""
        if not 0 <= word <= reg.W_LEDS_LEDS_MASK:
            raise RegisterValueError(
                f"s3g: output word {word:#x} asked, allowed are 0..{reg.W_LEDS_LEDS_MASK:#x}"
            )
        self._write(reg.W_LEDS, word)
        self._outputs = word

    def write_output(self, number: int, level: bool) -> None:
        """Set one output, 0..7."""
        self._require("output", number, OUTPUTS)
        self.write_outputs(self._outputs & ~(1 << number) | bool(level) << number)

    # ------------------------------------------------------------------------------- interrupts

    def strobe(self, mask: int) -> None:
        """Give the strobes in a mask, bits ``STB_`` of the register map."""
        self.request("STB", mask=mask)

    def clear_interrupts(self, mask: int) -> None:
        """Clear pending interrupts, bits ``INT_``. ASG_ABORT comes back while the abort lasts."""
        self.request("CLEAR", mask=mask)

    def mask_interrupts(self, mask: int) -> None:
        """Let the board report the interrupts in a mask, and no others.

        In profile ``exact`` a request is lost if it ends while a report is sent; it is repeated
        then, after the time-out.
        """
        self.request("MASK", mask=mask)

    def events(self, timeout: float = 0.0) -> list[int]:
        """Return the reports that came since the last call: masks of pending interrupts.

        Parameters
        ----------
        timeout : float
            If there are none, wait so long for one [s].
        """
        end = self._after(timeout)
        while True:
            for reply in self._replies(0.0 if self._events else self._seconds_to(end)):
                self._sort(reply)
            if self._events or self.bus.now() >= end:
                events, self._events = self._events, []
                return events

    # ------------------------------------------------------------------------------- programs

    def write_program(self, program: Program) -> None:
        """Write a program to memory. The executor must not be running in these words.

        Raises
        ------
        UsageError
            If it is longer than the memory.
        """
        for address, words in program.pieces():
            if len(words) > self.prog_words:
                raise UsageError(
                    f"s3g: {len(words)} words in a row; the program memory has {self.prog_words}"
                )
            for first in range(0, len(words), packets.MAX_WORDS):
                piece = words[first : first + packets.MAX_WORDS]
                self.write_words((address + first) % (1 << 16), piece)

    def write_words(
        self, address: int, words: Sequence[int], timeout: float | None = None
    ) -> tuple[int, int]:
        """Write up to 49 words to program memory; return error code and PC of the executor then.

        Parameters
        ----------
        address : int
            Of the first word, 0..65535; the memory wraps.
        words : sequence of int
        timeout : float, optional
            Time to wait for the reply, other than usual [s].
        """
        reply = self.request(
            "WRITE_BUFFER", timeout=timeout, count=len(words), address=address, words=words
        )
        return reply["error"], reply["pc"]

    def start_program(self, address: int, timeout: float | None = None) -> int:
        """Start the program at an address; return the cycle in which the start strobe is true.

        The executor must be idle. The cycle is exact on a link to a twin, and an estimate on
        others.

        Raises
        ------
        BusTimeoutError, BusError
            If there is no answer or a wrong one: it may have started or not. Call
            `abort_program` before another try.
        """
        self._write(reg.W_BE_START_ADDR, address)
        strobe = 1 << reg.STB_BE_START
        start = self.bus.now() + 1
        self.request("STB", timeout=timeout, retries=0, mask=strobe)
        length = len(packets.strobe(TAGS[0], strobe))
        return self._done_cycle(start + (length - 1) * FRAME_BITS * reg.CLOCK_HZ // self.baud) + 1

    def abort_program(self) -> None:
        """End the program at once. What it has loaded goes on."""
        self.strobe(1 << reg.STB_BE_ABORT)

    def status(self, timeout: float | None = None) -> ProgramStatus:
        """Return the state of the program executor.

        Parameters
        ----------
        timeout : float, optional
            Time to wait for the reply, other than usual [s].
        """
        word = self.request("INPUT", timeout=timeout, register=reg.R_BE_CONTROL)["value"]
        fields = decode(reg.MAP["R_BE_CONTROL"], word)
        return ProgramStatus(
            bool(fields["busy"]), bool(fields["waiting"]), fields["error"], fields["pc"]
        )

    def wait_program(self, timeout: float, interval: float = 0.01) -> ProgramStatus:
        """Wait for the end of the program; return how it ended.

        Parameters
        ----------
        timeout : float
            Longest time to wait [s].
        interval : float
            Time between two looks [s].

        Raises
        ------
        BusTimeoutError
            If it runs longer.
        """
        end = self._after(timeout)
        while (status := self.status()).busy:
            if self.bus.now() >= end:
                raise BusTimeoutError(
                    f"s3g: the program runs for more than {timeout:g} s ({status.text}); "
                    f"abort_program() ends it"
                )
            self.bus.sleep(min(interval, self._seconds_to(end)))
        return status

    # ------------------------------------------------------------------------------- raw access

    def read_register(self, name: str, instance: int = 0) -> dict[str, int]:
        """Return the raw fields of an input register by its name in the register map.

        >>> from pulsewright import open_board
        >>> open_board("s3g").read_register("R_BE_CONTROL")
        {'busy': 0, 'waiting': 0, 'error': 0, 'pc': 0}
        """
        register, number = self._register("read", name, instance)
        return decode(register, self.request("INPUT", register=number)["value"])

    def write_register(self, name: str, instance: int = 0, **fields: SupportsIndex) -> None:
        """Write raw fields to an output register by its name; others become 0.

        The methods above do not learn of it and overwrite it with what they remember.

        >>> from pulsewright import open_board
        >>> open_board("s3g").write_register("W_V_VAL", instance=1, value=-33)
        """
        register, number = self._register("write", name, instance)
        self._write(number, encode(register, **fields))

    # ------------------------------------------------------------------------------- requests

    def request(
        self,
        command: str,
        *,
        timeout: float | None = None,
        retries: int | None = None,
        **values: SupportsIndex | Sequence[SupportsIndex],
    ) -> dict[str, int]:
        """Send a request and return the arguments of the reply.

        Parameters
        ----------
        command : str
            Name of a command in the register map.
        timeout, retries : optional
            Other than those of the driver.
        **values
            Arguments of the command by name.

        Raises
        ------
        BusTimeoutError
            If no reply comes in time, however often it is sent.
        BusError
            If the board says that the request is damaged as often, or that it is unknown.
        RegisterValueError
            If a value does not fit.
        """
        timeout = self.timeout if timeout is None else timeout
        retries = self.retries if retries is None else retries
        wanted = SHORTEST_REPLY + sum(a.size for a in packets.COMMANDS[command].reply)
        reply = None
        for attempt in range(retries + 1):
            tag = self._random.randint(*TAGS)
            packet = packets.request(command, tag, values)
            self._touched = True
            self.retried += attempt > 0
            reply = self._exchange(packet, tag, wanted, timeout)
            if reply is None:
                self._resynchronise()
            elif reply.code != reg.REPLY_ERROR:
                return reply.values(command)
        if reply is not None:
            return reply.values(command)  # raises
        raise BusTimeoutError(
            f"s3g: no reply to {command} within {timeout:g} s, sent {retries + 1} times; check "
            f"power, cable, port and baud rate ({self.baud})"
        )

    def _exchange(
        self, packet: bytes, tag: int, wanted: int, timeout: float
    ) -> packets.Reply | None:
        """Send a packet; return the reply with its tag, None if none comes in time.

        A damaged request is answered with the tag as it arrived, so any such answer is taken.
        """
        for reply in self._replies(0.0):  # what came since the last time
            self._sort(reply)
        self.bus.write(packet)
        end = self._after(timeout + len(packet) * FRAME_BITS / self.baud)
        read, least = 0, SHORTEST_REPLY
        while (left := self._seconds_to(end)) > 0:
            data = self.bus.read(1 << 16, left, min_bytes=least)
            for reply in self._parsed(data):
                if reply.tag == tag or reply.code == reg.REPLY_ERROR:
                    return reply
                self._sort(reply)
            read += len(data)
            least = max(wanted - read, 1)
        return None

    def _replies(self, timeout: float) -> list[packets.Reply]:
        """Return the packets that the board has sent."""
        return self._parsed(self.bus.read(1 << 16, timeout))

    def _parsed(self, data: bytes) -> list[packets.Reply]:
        """Return the packets that are complete with these bytes."""
        return [packets.Reply.parse(payload) for payload in self._decoder.feed(data)]

    def _sort(self, reply: packets.Reply) -> None:
        """Keep a report; what else nobody waits for is the late answer to a request given up."""
        if reply.is_report:
            self._events.append(reply.pending)

    def _resynchronise(self) -> None:
        """Bring both sides to the beginning of a packet, whatever was lost.

        Without a time-out the board takes what comes next as the rest of a damaged packet.
        """
        if not self.switches["rx_timeout"]:
            self.bus.write(FILLER)
            self.bus.sleep(len(FILLER) * FRAME_BITS / self.baud + QUIET)
        data = self.bus.read(1 << 16, 0.0)
        for payload in self._decoder.feed(data) + self._decoder.flush():
            self._sort(packets.Reply.parse(payload))

    # ------------------------------------------------------------------------------- below

    def _write(self, register: int, value: int) -> None:
        self.request("OUTPUT", register=register, value=value)

    def _load(self) -> None:
        """Load velocities for good: without acceleration steps, whatever the rest of a profile."""
        for c, velocity in enumerate(self._velocity.tolist()):
            self._write(reg.W_V_VAL[c], velocity)
        self._write(reg.W_ASG_DT_VAL, 0)
        control = load_control(reg.W_ASG_CONTROL_DT_LIMIT_MASK, SET_VELOCITY, self.channels)
        for register, value in control.items():
            self._write(register, value)
        self.strobe(1 << reg.STB_ASG_LOAD)

    def _set_timing(self, timing: PulseTiming) -> None:
        self._write(reg.W_MSG_ALL_PRE_N, timing.pre)
        self._write(reg.W_MSG_ALL_PULSE_N, timing.pulse)
        self._write(reg.W_MSG_ALL_POST_N, timing.post)
        self._timing = timing

    def _velocity_for(self, axis: int, rate: float) -> int:
        velocity = round(rate / RATE_UNIT) if math.isfinite(rate) else self._timing.limit + 1
        if abs(velocity) > self._timing.limit:
            raise RegisterValueError(
                f"s3g axis {axis}: {rate:g} step/s asked, allowed are up to "
                f"{self.max_step_rate():g} step/s either way with the present pulse times; change "
                f"feed, steps per mm or pulse times"
            )
        return velocity

    def _done_cycle(self, start: int) -> int:
        """Return the cycle in which the board knows a request whose last byte starts at ``start``.

        The port samples 16 times a bit: the start bit at the first of its enables that sees it,
        the stop bit 154 enables later. Enables are a sum that runs from cycle 0 on.
        """
        step = self.baud // reg.BAUD_UNIT
        seen = start * step // reg.BAUD_LIMIT + 1  # number of the enable
        stop = seen + 10 + 16 * (FRAME_BITS - 1)
        # the enable, the byte, and the packet, one cycle after another
        return (stop * reg.BAUD_LIMIT + step - 1) // step + 1 + 2

    def _after(self, seconds: float) -> int:
        return self.bus.now() + math.ceil(seconds * self.bus.clock_hz)

    def _seconds_to(self, cycle: int) -> float:
        return max(cycle - self.bus.now(), 0) / self.bus.clock_hz


def _timing(width: float, space: float, setup: float, hold: float) -> PulseTiming:
    """Return the thresholds for times [s]."""
    clocks = {}
    times = {"width": width, "space": space, "setup": setup, "hold": hold}
    for name, seconds in times.items():
        if not 0 <= seconds <= LONGEST_TIME:
            raise RegisterValueError(
                f"s3g: a {name} of {seconds * 1e6:g} us asked, allowed are 0.."
                f"{LONGEST_TIME * 1e6:g} us"
            )
        clocks[name] = math.ceil(round(seconds * reg.CLOCK_HZ, 6))
    return PulseTiming.of(**clocks)
