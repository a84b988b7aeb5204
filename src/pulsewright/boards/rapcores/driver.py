"""The RAPcores board in engineering units, over SPI.

Names, numbers and fields come from the register map. The driver asks for room before each move, so
that none is refused, and takes what the board counts as refused, damaged or lost for an error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.board import resolve_switches
from pulsewright.boards.driving import Driver
from pulsewright.boards.rapcores import registers as reg
from pulsewright.boards.rapcores.messages import Codec, Telemetry
from pulsewright.errors import (
    BusError,
    BusTimeoutError,
    EstopError,
    MotionLimitError,
    RegisterValueError,
    StarvedError,
    UsageError,
)
from pulsewright.registers.codec import decode, encode
from pulsewright.transport.bus import ASAP
from pulsewright.transport.spi_bus import SpiBus

REGISTER: Final = 0xFFFF_FFFF  # the bits of a register in a word
MAX_DIVIDER: Final = reg.W_DIVIDER_DIVIDER_MASK
MAX_TIME: Final = reg.W_STEP_WIDTH_CYCLES_MASK  # of a pulse [cycle]
DEFAULT_TIME: Final = reg.W_STEP_WIDTH_RESET / reg.CLOCK_HZ  # of the board after reset [s]
FULL_CURRENT: Final = reg.W_CURRENT_CURRENT_MASK
POLL: Final = 20e-6  # between two looks at a pin [s]
LONGEST_SLEEP: Final = 0.1  # between two looks at a move [s]
ROUNDS: Final = 3  # of waiting for a move that should have ended
TIMING: Final = {
    "W_STEP_WIDTH": "pulse width",
    "W_STEP_LOW": "pulse space",
    "W_DIR_SETUP": "direction setup",
    "W_DIR_HOLD": "direction hold",
}


@dataclass(frozen=True)
class Identity:
    """What a board says of itself.

    Parameters
    ----------
    version : str
        Of its protocol, such as ``0.3.0-dev``.
    motors, encoders : int
        What it has.
    position_bits, velocity_bits : int
        Of an encoder.
    build_id : int
        0 for profiles that have none.
    """

    version: str
    motors: int
    encoders: int
    position_bits: int
    velocity_bits: int
    build_id: int = 0


@dataclass(frozen=True)
class StepTiming:
    """Times of the pulse former, each 1..65535 [cycle]; all motors have the same."""

    width: int = reg.W_STEP_WIDTH_RESET
    low: int = reg.W_STEP_LOW_RESET
    setup: int = reg.W_DIR_SETUP_RESET
    hold: int = reg.W_DIR_HOLD_RESET


@dataclass(frozen=True)
class BufferState:
    """The move buffer of a board.

    Parameters
    ----------
    used : int
        Moves in it, the executing one included.
    depth : int
        Moves that it can hold.
    executing : bool
        A move executes.
    halted : bool
        By the HALT input or by `RapcoresDriver.halt`.
    halt_seen : bool
        A halt came since it was cleared: moves are refused.
    ticks_left : int
        Of the executing move [tick].
    """

    used: int
    depth: int
    executing: bool
    halted: bool
    halt_seen: bool
    ticks_left: int = 0

    @property
    def room(self) -> int:
        """Moves that the board takes now."""
        return 0 if self.halted or self.halt_seen else self.depth - self.used


@dataclass(frozen=True)
class Counters:
    """What the board counted since `RapcoresDriver.clear`, modulo 2**32."""

    moves_completed: int
    moves_refused: int
    framing_errors: int
    aborted_messages: int
    unknown_headers: int

    @property
    def errors(self) -> int:
        """All but the moves completed."""
        return (
            self.moves_refused + self.framing_errors + self.aborted_messages + self.unknown_headers
        )


@dataclass(frozen=True)
class MoveTelemetry:
    """Encoders at one moment: the start of a move, or now if none executes.

    Parameters
    ----------
    positions : tuple of int
        Of the first encoders, as many as motors at most, extended beyond 32 bits [count].
    velocities : tuple of int
        Clock cycles between the last two counts, less 1, with the sign of the last one [cycle].
    completed : int or None
        Moves completed at that moment (`Counters.moves_completed`). None where a move ended while
        it was asked, or the board does not count them.
    executing : bool or None
        Whether it is the start of a move, and not now; None as above.
    """

    positions: tuple[int, ...]
    velocities: tuple[int, ...]
    completed: int | None = None
    executing: bool | None = None


class RapcoresDriver(Driver[SpiBus]):
    """One RAPcores board on an SPI link.

    Creating the driver sends nothing. It assumes the reset state until `initialise` has made a
    known one. The parameters must be those of the build; `identify` compares.

    Emergency stop is made of two things that the board has: `estop` halts it, which drops all
    moves, and disables the motors; `release_estop` undoes both. Without a halt, in profiles
    `upstream` and `v020`, moves that the board has go on with disabled motors.

    With dual H-bridges, the windings of a disabled motor are open, and it coasts, unless
    `brake_on_disable` has short-circuited them. A halt without a disable holds them as they are.

    Parameters
    ----------
    bus : SpiBus
        Kept as ``bus``.
    profile : str
        ``document``, ``upstream`` or ``v020``.
    motors : int
        1..32; 1..24 with words of 32 bits.
    encoders : int
        0..64.
    word_bits : int
        64, or 32 in profile `document`.
    depth : int
        Moves that the buffer holds, a power of two from 2 to 64.
    halt_pin : int
        Whether the build has the HALT input, 0 or 1; makes no difference to the driver.
    position_bits : int
        Of an encoder position: 32, or 24 in profile `v020`.
    motor_driver : int
        1, in profile `document`: the build has dual H-bridges. 0: step and direction only.
    **switches : int
        Profile switches that differ from the profile.

    Raises
    ------
    UsageError
        If a parameter is unknown or not allowed.

    Examples
    --------
    >>> from pulsewright import open_board
    >>> with open_board("rapcores") as board:
    ...     board.initialise()
    ...     board.release_estop()
    ...     rate = board.increment(1000.0)  # [step/s]
    ...     _ = board.move(duration=39_024, increments=[rate, -rate, 0, 0])
    ...     board.wait_idle()
    ...     print(board.read_steps())
    [  99 -100    0    0]
    """

    registers = reg.MAP

    def __init__(
        self,
        bus: SpiBus,
        *,
        profile: str = reg.DEFAULT_PROFILE,
        motors: int = reg.MOTORS,
        encoders: int = reg.ENCODERS,
        word_bits: int = reg.WORD_BITS,
        depth: int = reg.DEPTH,
        halt_pin: int = 1,
        position_bits: int = reg.POSITION_BITS,
        motor_driver: int = 0,
        **switches: int,
    ) -> None:
        self.bus = bus
        self.profile = profile
        self.switches = resolve_switches(reg.MAP, profile, switches)
        self.codec = Codec(
            motors=motors, encoders=encoders, word_bits=word_bits, position_bits=position_bits
        )
        _check_build(profile, word_bits, depth, halt_pin, position_bits, motor_driver)
        self.motors, self.encoders, self.depth = motors, encoders, depth
        self.word_bits, self.position_bits = word_bits, position_bits
        self.motor_driver = motor_driver
        self.timing = StepTiming()
        self._divider = reg.W_DIVIDER_RESET
        self._enabled = 0
        self._halted = False
        self._version = 0
        self._busy_until = 0  # cycle at which the moves that were sent are over, at the latest
        self._fastest = 0.0  # of the motors in them [step/s]
        self._counts = np.zeros(encoders, np.int64)
        self._steps = np.zeros(motors, np.int64)

    # ------------------------------------------------------------------------------- the board

    def identify(self) -> Identity:
        """Ask the board what it is, and compare it with the parameters.

        Raises
        ------
        BusError
            If it is another board or build, or none answers.
        """
        self._synchronise()
        if self.profile == "v020":
            info = self.codec.value(self.bus.transfer(self.codec.channel_info()))
        else:
            info = self._read(reg.R_CHANNEL_INFO)
        has = decode(reg.MAP["R_CHANNEL_INFO"], info)
        build_id = 0
        asked = {
            "motors": self.motors,
            "encoders": self.encoders,
            "position_bits": self.position_bits,
            "velocity_bits": reg.VELOCITY_BITS,
        }
        if self.profile == "document":
            parameters, build_id = self._read_all(reg.R_BUILD_PARAMETERS, reg.R_BUILD_ID)
            has |= decode(reg.MAP["R_BUILD_PARAMETERS"], parameters)
            has["depth"] = self._buffer().depth
            asked |= {
                "word_bits": self.word_bits,
                "depth": self.depth,
                "motor_driver": self.motor_driver,
            }
            if build_id != reg.BUILD_ID:
                raise BusError(
                    f"rapcores: the board tells build id {build_id:08X}, expected "
                    f"{reg.BUILD_ID:08X}; an original is driven with profile 'upstream', a build "
                    f"with words of 32 bits with word_bits=32"
                )
        for name, expected in asked.items():
            if has[name] != expected:
                raise BusError(
                    f"rapcores: the board has {name} = {has[name]}, the driver was opened for "
                    f"{expected}; open it with {name}={has[name]}"
                )
        version = decode(reg.MAP["R_VERSION"], self._version)
        return Identity(
            "{major}.{minor}.{patch}".format(**version) + ("-dev" if version["devel"] else ""),
            self.motors,
            self.encoders,
            self.position_bits,
            reg.VELOCITY_BITS,
            build_id,
        )

    def initialise(
        self,
        *,
        tick_rate: float | None = None,
        pulse_width: float = DEFAULT_TIME,
        pulse_space: float = DEFAULT_TIME,
        direction_setup: float = DEFAULT_TIME,
        direction_hold: float = DEFAULT_TIME,
        reset: bool = False,
    ) -> None:
        """Bring the board from any state to a known one: at rest, without moves, motors disabled.

        No counter or fault is left from before; currents are 0, and disabled motors coast.
        Positions of motors and encoders go on; where the motors are is unknown if the board had
        moves of another program. Profiles `upstream` and `v020` cannot drop the moves
        that they have.

        Parameters
        ----------
        tick_rate : float, optional
            See `set_tick_rate` [Hz]; without it, that after reset.
        pulse_width, pulse_space, direction_setup, direction_hold : float
            See `set_times` [s].
        reset : bool
            Pulse the reset pin first, on a link that has it: all positions are 0 then.

        Raises
        ------
        BusError
            As `identify`.
        """
        divider = reg.W_DIVIDER_RESET if tick_rate is None else self._divider_for(tick_rate)
        timing = self._timing_for(pulse_width, pulse_space, direction_setup, direction_hold)
        self._halting(self._moving())
        if reset:
            self.bus.reset()
            self._counts[:] = self._steps[:] = 0
        self.identify()
        if self.profile == "document":
            if not self._moving() and self._buffer().used:  # moves of a host that is gone
                self.lose_position()
            self.halt()
        self.enable(0)
        self._write_divider(divider)
        if self.profile == "document":
            self._set_timing(timing)
            for name in ("W_BRAKE", "W_STEP_POLARITY", "W_DIR_POLARITY"):
                self.write_register(name)
            for motor in range(self.motors * self.motor_driver):
                self.write_register("W_CURRENT", motor)
            self.clear()
            self._end_halt()
            self.check_configuration()

    def _synchronise(self) -> None:
        """Read the version; where a message or word may be open from before, end that first.

        Raises
        ------
        BusError
            If no board answers with the right version.
        """
        expected = reg.VERSION_V020 if self.profile == "v020" else reg.VERSION
        ended_by_cs = self.switches["cs_reset_message"]
        for extra in range(1 if ended_by_cs else self.codec.word_bytes):
            if extra:  # bytes of an open word outlive the frame
                self.bus.transfer(bytes(1))
            if not ended_by_cs:
                self.bus.transfer(self.codec.nop() * self.codec.move_words)
            if self.profile == "v020":
                version = self.codec.value(self.bus.transfer(self.codec.version()))
            else:
                version = self._read(reg.R_VERSION)
            self._version = version & REGISTER
            if self._version == expected:
                return
        raise BusError(
            f"rapcores: the board tells version {self._version:08X}, expected {expected:08X} in "
            f"profile '{self.profile}'; check wiring, SPI mode 0, word_bits, and SCK at "
            f"1/{2 * reg.MIN_HALF_PERIOD} of the board's clock at most"
        )

    # ------------------------------------------------------------------------------- running

    @property
    def running(self) -> bool:
        """Whether motors are enabled and the driver has not halted the board."""
        return self._enabled != 0 and not self._halted

    def release_estop(self) -> None:
        """End a halt and enable all motors.

        Raises
        ------
        EstopError
            If the HALT input still halts the board.
        BusError
            If the board does not hold what was written, in profile `document`.
        """
        if self.profile == "document":
            self.clear_halt()
        self.enable((1 << self.motors) - 1)
        if self.profile == "document":
            self.check_configuration()

    def estop(self) -> None:
        """Halt the board, which drops all moves at once, and disable the motors.

        There is no ramp: the position is unknown then, if a motor ran faster than
        `start_stop_rate`.
        """
        self._halting(self._moving())
        try:
            if self.profile == "document":
                self.halt()
        finally:
            self.enable(0)

    def halt(self) -> None:
        """Stop all motion at once, without a ramp, and drop all moves; motors stay enabled.

        The position is unknown then, if a motor ran faster than `start_stop_rate`.

        Raises
        ------
        UsageError
            In profiles `upstream` and `v020`, which cannot.
        """
        self._require_document("halt")
        self._halting(self._moving())
        self._busy_until = 0
        self._halted = True
        self._write(reg.W_CONTROL, reg.W_CONTROL_HALT_MASK)

    def clear_halt(self) -> None:
        """End a halt, so that moves are taken again. Dropped ones stay dropped.

        Raises
        ------
        UsageError
            As `halt`.
        EstopError
            If the HALT input still halts the board.
        """
        self._require_document("clear_halt")
        if self._moving():
            with suppress(EstopError):
                self._check_halt(self.buffer())
        self._end_halt()
        if self.buffer().halted:
            raise EstopError("rapcores: the HALT input is low; release it, then clear the halt")

    def _end_halt(self) -> None:
        self._write(reg.W_CONTROL, 0)
        self._write(reg.W_CLEAR, reg.W_CLEAR_HALT_SEEN_MASK)
        self._halted = False

    def enable(self, mask: int) -> None:
        """Enable the motors in a mask, one bit each, and disable the others."""
        self._check_mask(mask)
        if self.profile == "v020":
            self.bus.transfer(self.codec.enable(mask))
        else:
            self._write(reg.W_ENABLE, mask)
        self._enabled = mask

    # ------------------------------------------------------------------------------- H-bridges

    def set_current(self, current: float | Sequence[float]) -> NDArray[np.float64]:
        """Set how much the windings of motors get; return what the board will really do.

        It is part of the supply voltage, for nothing measures a current: at rest it makes
        supply / resistance x ``current``. After a reset it is 0, and `initialise` makes it that:
        motors are not driven before they are told how much, then they are braked while enabled.

        Parameters
        ----------
        current : float or sequence of float
            For all motors or one each, at the top of the sine: 0 to 1, which is 255/256 of the
            supply; the board has 255 steps.

        Returns
        -------
        (motors,) array of float
            As `currents`.

        Raises
        ------
        RegisterValueError
            If a value is not within those; none is set then.
        UsageError
            If there is not one for each motor, or the build has no H-bridges.
        """
        self._require_bridges("set_current")
        asked = np.asarray(current, np.float64)
        if asked.ndim and asked.shape != (self.motors,):
            raise UsageError(
                f"rapcores: currents of shape {asked.shape}; give one for all motors, or "
                f"{self.motors}, one for each"
            )
        values = np.broadcast_to(asked, self.motors)
        for motor, value in enumerate(values.tolist()):
            if not 0 <= value <= 1:
                raise RegisterValueError(
                    f"rapcores motor {motor}: current {value:g}; allowed are 0 to 1, which is the "
                    f"whole supply voltage"
                )
        for motor, value in enumerate(values.tolist()):
            self.write_register("W_CURRENT", motor, current=round(value * FULL_CURRENT))
        return self.currents()

    def currents(self) -> NDArray[np.float64]:
        """Return what the board has as the current of each motor, 0 to 1; see `set_current`."""
        self._require_bridges("currents")
        found = [self.read_register("W_CURRENT", motor) for motor in range(self.motors)]
        return np.array([fields["current"] for fields in found]) / FULL_CURRENT

    def brake_on_disable(self, mask: int) -> None:
        """Let the motors in a mask, one bit each, brake while disabled; let the others coast.

        Braked windings are short-circuited: they hold against slow turning only by what the motor
        makes itself.

        Raises
        ------
        RegisterValueError
            If there is no such motor.
        UsageError
            If the build has no H-bridges.
        """
        self._require_bridges("brake_on_disable")
        self._check_mask(mask)
        self._write(reg.W_BRAKE, mask)

    def check_running(self) -> None:
        """Check that motors are enabled and, in profile `document`, that no halt came.

        Raises
        ------
        EstopError
            If not.
        """
        if not self.running:
            raise EstopError("rapcores: the motors are not enabled; call release_estop()")
        if self.profile == "document":
            self._check_halt(self.buffer())

    # ------------------------------------------------------------------------------- ticks, pulses

    @property
    def divider(self) -> int:
        """A tick is one clock cycle longer than this [cycle]."""
        return self._divider

    @property
    def tick_rate(self) -> float:
        """How often the board adds increments: the unit of durations [Hz]."""
        return self.bus.clock_hz / (self._divider + 1)

    @property
    def max_step_rate(self) -> float:
        """Step rate that a motor can keep up [step/s]."""
        if self.profile != "document":
            return self.tick_rate / 2
        return min(self.tick_rate, self.bus.clock_hz / (self._period))

    def set_tick_rate(self, rate: float) -> float:
        """Set how often the board adds increments [Hz]; return what it will really do.

        The nearest of the clock divided by 1..256 (2..256 in profiles `upstream` and `v020`).

        Raises
        ------
        RegisterValueError
            If ``rate`` is not within those.
        """
        self._write_divider(self._divider_for(rate))
        return self.tick_rate

    def set_times(
        self,
        pulse_width: float = DEFAULT_TIME,
        pulse_space: float = DEFAULT_TIME,
        direction_setup: float = DEFAULT_TIME,
        direction_hold: float = DEFAULT_TIME,
    ) -> StepTiming:
        """Set the times of step pulses [s]; return what the board will really do.

        Each is rounded up to clock cycles.

        Parameters
        ----------
        pulse_width, pulse_space : float
            STEP is active for the width, and inactive for the space at least.
        direction_setup, direction_hold : float
            DIR does not change for so long before a pulse starts, and after it has ended.

        Raises
        ------
        RegisterValueError
            If a time is negative or over 65535 cycles.
        UsageError
            In profiles `upstream` and `v020`, which have no such times.
        """
        self._require_document("set_times")
        self._set_timing(
            self._timing_for(pulse_width, pulse_space, direction_setup, direction_hold)
        )
        return self.timing

    # ------------------------------------------------------------------------------- units

    @property
    def one_step(self) -> int:
        """Units of increments in a step."""
        return 1 << self.codec.word_bits if self.profile == "v020" else self.codec.one_step

    def increment(self, rate: float) -> int:
        """Return the increment for a step rate [step/s], signed.

        Raises
        ------
        MotionLimitError
            If ``rate`` is above `max_step_rate`.
        """
        if not abs(rate) <= self.max_step_rate:
            raise MotionLimitError(
                f"rapcores: {rate:g} step/s; allowed are up to {self.max_step_rate:g} with ticks "
                f"of {self.tick_rate:g} Hz and pulses of {self._period} cycles"
            )
        limit = self.codec.one_step
        return min(max(round(rate / self.tick_rate * self.one_step), -limit), limit - 1)

    def increment_increment(self, acceleration: float) -> int:
        """Return the increment-increment for an acceleration [step/s^2], signed.

        Raises
        ------
        MotionLimitError
            If the board cannot hold it.
        """
        raw = acceleration / self.tick_rate**2 * self.one_step
        limit = self.codec.one_step
        if not -limit <= raw < limit:
            raise MotionLimitError(
                f"rapcores: {acceleration:g} step/s^2; allowed are up to "
                f"{limit / self.one_step * self.tick_rate**2:g}"
            )
        return round(raw)

    def step_rate(self, increment: int) -> float:
        """Return the step rate of an increment [step/s]."""
        return increment / self.one_step * self.tick_rate

    def acceleration(self, increment_increment: int) -> float:
        """Return the acceleration of an increment-increment [step/s^2]."""
        return increment_increment / self.one_step * self.tick_rate**2

    # ------------------------------------------------------------------------------- moves

    def move(
        self,
        duration: int,
        increments: Sequence[SupportsIndex],
        increment_increments: Sequence[SupportsIndex] | None = None,
        direction_bits: int = 0,
        *,
        cycle: int = ASAP,
    ) -> MoveTelemetry:
        """Send one move, which begins when those before it have ended.

        Parameters
        ----------
        duration : int
            0..2**32 - 1 [tick].
        increments, increment_increments : sequence of int
            One per motor: steps per tick, and their change per tick, in units of which `one_step`
            makes a step; see `increment`. Motor m moves by n inc + n (n - 1) / 2 incinc in n ticks.
        direction_bits : int
            Levels of the direction pins in profiles `upstream` and `v020`.
        cycle : int
            Clock cycle at which the frame begins, on links to twins; it is not before this.

        Raises
        ------
        EstopError
            If motors are not enabled, or the board halted.
        BusError
            If the buffer has no room (see `wait_room`), or the board refused the move.
        MotionLimitError
            If a motor would need more steps than it can be given.
        """
        self._require_running()
        changes = [0] * self.motors if increment_increments is None else increment_increments
        frame = self.codec.move(duration, increments, changes, direction_bits)
        self._check_rates(
            np.array([duration], np.float64),
            np.array([[*map(float, increments)]]),
            np.array([[*map(float, changes)]]),
        )
        if not self.room():
            raise BusError(
                f"rapcores: no room for a move, all {self.depth} are in use; call wait_room() first"
            )
        refused = self.counters().moves_refused if self.profile == "document" else 0
        _, telemetry = self._send(frame, duration, cycle)
        if self.profile == "document" and self.counters().moves_refused != refused:
            self._check_halt(self.buffer())
            raise BusError("rapcores: the board refused a move; is another host using it?")
        return telemetry

    def stream(
        self,
        durations: NDArray[Any],
        increments: NDArray[Any],
        increment_increments: NDArray[Any],
        direction_bits: NDArray[Any] | None = None,
        *,
        cycle: int = ASAP,
        chained: bool = False,
    ) -> list[MoveTelemetry]:
        """Send many moves, each as soon as there is room, without a pause between them.

        Returns when the last one is sent; see `wait_idle` and `check_counters`.

        Parameters
        ----------
        durations : array of int, shape (n,)
            [tick].
        increments, increment_increments : array of int, shape (n, motors)
            As in `move`.
        direction_bits : array of int, shape (n,), optional
            As in `move`.
        cycle : int
            As in `move`, for the first one.
        chained : bool
            The first one must not come too late either: it goes on from an earlier stream.

        Returns
        -------
        list of MoveTelemetry
            One per move, without the number of moves completed.

        Raises
        ------
        StarvedError
            If the board had no move left before the next one came. All that was sent has been
            executed then; ``time`` is that of these moves.
        EstopError, MotionLimitError
            As in `move`.
        BusTimeoutError
            If a move that should have ended did not.
        """
        self._require_running()
        self._check_rates(durations, increments, increment_increments)
        frames = self.codec.moves(durations, increments, increment_increments, direction_bits)
        told: list[MoveTelemetry] = []
        room = 0
        for k, (frame, duration) in enumerate(zip(frames, durations.tolist(), strict=True)):
            if room <= 0:
                room = self.wait_room()
            before, telemetry = self._send(
                frame, duration, cycle if k == 0 else ASAP, numbered=False
            )
            told.append(telemetry)
            if before is not None:
                self._check_halt(before)
                if (k or chained) and not before.used:
                    self._starved(durations[: k + 1])
                room = before.room
            room -= 1
        return told

    def _starved(self, durations: NDArray[Any]) -> None:
        self.wait_idle()
        time = float(durations.sum(dtype=np.float64)) / self.tick_rate
        raise StarvedError(
            f"rapcores: no move came in time, the motors stopped; {len(durations)} moves of this "
            f"stream, {time:.6g} s, were executed; use longer moves, a faster SCK or a deeper "
            f"buffer",
            time=time,
            position=tuple(map(float, self.read_steps())),
        )

    def room(self) -> int:
        """Return how many moves the board takes now.

        Profiles `upstream` and `v020` tell by their pin BUFFER_DTR only: 1 stands for 1 or more.

        Raises
        ------
        UsageError
            If the link does not have the pin there.
        """
        if self.profile == "document":
            return self.buffer().room
        level = self.bus.level("buffer_dtr")
        if level is None:
            raise UsageError(
                f"rapcores: in profile '{self.profile}' only the pin BUFFER_DTR tells whether the "
                f"board takes a move; the link must have it"
            )
        return level

    def wait_room(self) -> int:
        """Wait until the board takes a move; return how many it takes.

        Raises
        ------
        EstopError
            If it halted.
        BusTimeoutError
            If a move that should have ended did not.
        """
        if self.profile == "document":
            return self._wait(lambda state: state.room > 0).room
        while not (room := self.room()):
            if self.bus.now() > self._busy_until:
                raise BusTimeoutError(
                    "rapcores: BUFFER_DTR is low, although all moves should be over; a divider of "
                    "0 stops the board"
                )
            self.bus.sleep(POLL)
        return room

    def wait_idle(self) -> None:
        """Wait until all moves are executed and all their steps given.

        Profiles `upstream` and `v020` do not tell: the driver waits as long as what it sent takes.

        Raises
        ------
        EstopError
            If the board halted.
        BusTimeoutError
            If a move that should have ended did not.
        """
        if self.profile != "document":
            self.bus.sleep(max(self._busy_until - self.bus.now(), 0) / self.bus.clock_hz)
            return
        self._wait(lambda state: not state.used)
        longest = reg.BACKLOG * (self._period)
        longest += self.timing.setup + self.timing.hold
        for _ in range(ROUNDS):
            if not self._read(reg.R_PULSES_PENDING):
                # the last pulse is not pending any more; it and its pause may not be over
                self.bus.sleep((self._period) / self.bus.clock_hz)
                return
            self.bus.sleep(longest / self.bus.clock_hz)
        raise BusTimeoutError("rapcores: steps stay pending, although all moves are over")

    # ------------------------------------------------------------------------------- state

    def buffer(self) -> BufferState:
        """Return the state of the move buffer, in profile `document`.

        Raises
        ------
        BusError
            If what answers is no buffer of this board: the link is silent or spoils bytes.
        """
        state = self._buffer()
        self._require_depth(state)
        return state

    def _buffer(self) -> BufferState:
        self._require_document("buffer")
        state, ticks = self._read_all(reg.R_BUFFER_STATE, reg.R_TICKS_LEFT)
        return _buffer_state(state, ticks)

    def counters(self) -> Counters:
        """Return what the board counted since `clear`, in profile `document`."""
        self._require_document("counters")
        return Counters(
            *self._read_all(
                reg.R_MOVES_COMPLETED,
                reg.R_MOVES_REFUSED,
                reg.R_FRAMING_ERRORS,
                reg.R_ABORTED_MESSAGES,
                reg.R_UNKNOWN_HEADERS,
            )
        )

    def check_counters(self) -> None:
        """Check that since `clear` no message was refused or damaged, and no step lost.

        Raises
        ------
        BusError
            If one was; the message tells all that was counted.
        """
        counters, lost = self.counters(), self.steps_lost()
        if counters.errors or lost:
            raise BusError(
                f"rapcores: {counters.moves_refused} moves refused, {counters.framing_errors} "
                f"framing errors, {counters.aborted_messages} aborted messages, "
                f"{counters.unknown_headers} unknown headers, steps lost by motors "
                f"{_bits(lost) or 'none'}; check the wiring of SPI and the rates"
            )

    def check_configuration(self) -> None:
        """Check that the board holds what was written: enables, tick rate and pulse times.

        In profile `document`, which can read them.

        Raises
        ------
        BusError
            If not; names the register.
        """
        self._require_document("check_configuration")
        expected = {"W_ENABLE": self._enabled, "W_DIVIDER": self._divider}
        times = (self.timing.width, self.timing.low, self.timing.setup, self.timing.hold)
        expected |= dict(zip(TIMING, times, strict=True))
        frame = b"".join(self.codec.config_read(reg.MAP[name].addresses[0]) for name in expected)
        words = self.codec.to_words(self.bus.transfer(frame))[1::2]
        for (name, value), word in zip(expected.items(), words, strict=True):
            if word & REGISTER != value:
                raise BusError(
                    f"rapcores: register {name} holds {word & REGISTER:#x}, {value:#x} was "
                    f"written: bytes on the way were spoilt, or the board has lost power or was "
                    f"reset; check wiring and supply, and initialise() again"
                )

    def clear(self) -> None:
        """Set counters to 0 and forget encoder faults and lost steps, in profile `document`."""
        self._require_document("clear")
        register = reg.MAP["W_CLEAR"]
        self._write(reg.W_CLEAR, encode(register, counters=1, encoder_fault=1, step_lost=1))

    def encoder_faults(self) -> int:
        """Return the mask of encoders of which both signals changed at once; 1 = fault."""
        mask = (1 << self.encoders) - 1
        if self.profile == "v020":
            return self.codec.value(self.bus.transfer(self.codec.encoder_fault())) & mask
        word = self._words(reg.R_ENCODER_FAULT)[0]
        if self.profile == "upstream":  # 1 = healthy
            return ~word & mask
        if self.word_bits < reg.MAX_ENCODERS:
            word |= self._read(reg.R_ENCODER_FAULT_HI) << self.word_bits
        return word & mask

    def steps_lost(self) -> int:
        """Return the mask of motors that lost steps, in profile `document`."""
        self._require_document("steps_lost")
        return self._read(reg.R_STEP_LOST)

    def read_steps(self) -> NDArray[np.int64]:
        """Return the position of each motor, extended beyond 32 bits [step], in profile `document`.

        Right as long as no motor moves by 2**31 steps between two calls.
        """
        self._require_document("read_steps")
        raw = self._read_all(*reg.R_STEP_POSITION[: self.motors])
        self._steps = _extended(self._steps, np.array(raw), 32)
        return self._steps.copy()

    def level(self) -> None:
        """Bring the accumulators of all motors to whole steps, as after reset; `document` only.

        They cannot be read: how far each is beyond its last step is found bit by bit, by moves of a
        tick that look for that step. Step pins may go to and fro by one, and end where they were.

        Raises
        ------
        UsageError
            If motors are enabled, which would make these steps.
        """
        self._require_document("level")
        if self._enabled:
            raise UsageError("rapcores: level() needs motors that are disabled; call estop() first")
        at, beyond = self.read_steps(), [0] * self.motors
        moved = beyond
        for bit in reversed(range(self.codec.one_step.bit_length() - 1)):
            tried = [low + (1 << bit) for low in beyond]
            self._nudge([there - here for there, here in zip(moved, tried, strict=True)])
            moved, kept = tried, self.read_steps() == at
            beyond = [
                high if fits else low for high, low, fits in zip(tried, beyond, kept, strict=True)
            ]
        self._nudge([there - here for there, here in zip(moved, beyond, strict=True)])

    def _nudge(self, increments: Sequence[int]) -> None:
        """Make a move of a tick with disabled motors."""
        self.bus.transfer(self.codec.move(1, increments, [0] * self.motors, 0))
        self.wait_idle()

    def read_encoders(self) -> NDArray[np.int64]:
        """Return the position of each encoder, extended beyond its bits [count].

        Right as long as none moves by half its range between two calls.

        Raises
        ------
        UsageError
            In profile `upstream` without `fixed`, where velocities are at the same addresses.
        """
        return self._extend_counts([position for position, _ in self._encoder_states()])

    def encoder_rates(self) -> NDArray[np.float64]:
        """Return the rate of each encoder from its last two counts [count/s].

        It holds at standstill: the board has no time-out. Errors as in `read_encoders`.
        """
        return count_rates([velocity for _, velocity in self._encoder_states()], self.bus.clock_hz)

    def following_error(self, steps_per_count: Sequence[float]) -> NDArray[np.float64]:
        """Return position of motor less position of its encoder, for each motor that has one.

        They are read one after the other. At a known moment, `MoveTelemetry` has the encoders at
        the start of a move.

        Parameters
        ----------
        steps_per_count : sequence of float
            One for each of the first encoders [step/count].

        Returns
        -------
        array of float
            As many as ``steps_per_count`` [step].
        """
        n = len(steps_per_count)
        if n > min(self.motors, self.encoders):
            raise UsageError(
                f"rapcores: {n} ratios for {self.motors} motors and {self.encoders} encoders"
            )
        counts, steps = self.read_encoders()[:n], self.read_steps()[:n]
        return np.asarray(steps - counts * np.asarray(steps_per_count, np.float64))

    # ------------------------------------------------------------------------------- registers

    def read_register(self, name: str, instance: int = 0) -> dict[str, int]:
        """Return the raw fields of a register by its name in the register map.

        Registers of the write side are read, too.

        >>> from pulsewright import open_board
        >>> open_board("rapcores").read_register("R_VERSION")
        {'devel': 1, 'major': 0, 'minor': 3, 'patch': 0}
        >>> open_board("rapcores").read_register("W_DIVIDER")
        {'divider': 40}
        """
        self._require_registers()
        if reg.MAP[name].side == "read":
            register, address = self._register("read", name, instance)
            return decode(register, self._read(address))
        register, address = self._register("write", name, instance)
        return decode(register, self._read_config(address))

    def write_register(self, name: str, instance: int = 0, **fields: SupportsIndex) -> None:
        """Write raw fields to a register of the write side by its name; others become 0.

        The methods above do not learn of it.

        >>> from pulsewright import open_board
        >>> open_board("rapcores").write_register("W_BRAKE", brake=0b0001)
        """
        self._require_registers()
        register, address = self._register("write", name, instance)
        self._write(address, encode(register, **fields))

    # ------------------------------------------------------------------------------- parts

    def _words(self, *addresses: int) -> list[int]:
        """Read registers of the read side in one frame; return whole words."""
        frame = b"".join(map(self.codec.status_read, addresses))
        return self.codec.to_words(self.bus.transfer(frame))[1::2]

    def _read_all(self, *addresses: int) -> list[int]:
        """Read registers of the read side in one frame."""
        return [word & REGISTER for word in self._words(*addresses)]

    def _read(self, address: int) -> int:
        """Read a register of the read side."""
        return self._read_all(address)[0]

    def _write(self, address: int, value: int) -> int:
        """Write a register of the write side; return its old value."""
        return self.codec.value(self.bus.transfer(self.codec.config_swap(address, value)))

    def _read_config(self, address: int) -> int:
        if self.profile == "document":
            return self.codec.value(self.bus.transfer(self.codec.config_read(address))) & REGISTER
        # there is no reading without writing: the shortest upset is one of the value it should have
        known = {reg.W_ENABLE: self._enabled, reg.W_DIVIDER: self._divider}.get(address, 0)
        old = self._write(address, known) & REGISTER
        self._write(address, old)
        return old

    def _send(
        self, frame: bytes, duration: int, cycle: int, *, numbered: bool = True
    ) -> tuple[BufferState | None, MoveTelemetry]:
        """Send a move; return the buffer's state just before it, and what the board tells."""
        codec = self.codec
        if self.profile != "document":
            reply = self.bus.transfer(frame, cycle)
            self._note_move(duration)
            read = codec.telemetry_v020 if self.profile == "v020" else codec.telemetry
            return None, self._telemetry(read(reply))
        head = [codec.status_read(reg.R_BUFFER_STATE)]
        tail = []
        if numbered:
            head.append(codec.status_read(reg.R_MOVES_COMPLETED))
            tail.append(codec.status_read(reg.R_MOVES_COMPLETED))
        reply = self.bus.transfer(b"".join([*head, frame, *tail]), cycle)
        self._note_move(duration)
        start = sum(map(len, head))
        words = codec.to_words(reply[:start] + reply[start + len(frame) :])[1::2]
        before = _buffer_state(words[0])
        self._require_depth(before)
        told = codec.telemetry(reply[start : start + len(frame)])
        if not numbered or words[1] != words[2]:
            return before, self._telemetry(told)
        return before, self._telemetry(told, words[1], before.executing)

    def _check_halt(self, state: BufferState) -> None:
        """Check that no halt came.

        Raises
        ------
        EstopError
            If one did.
        """
        if state.halted or state.halt_seen:
            self._halting(self._moving())
            raise EstopError(
                "rapcores: the board was halted and dropped its moves; release HALT, call "
                "clear_halt() or release_estop(), and plan anew from read_steps()"
            )

    def _note_move(self, duration: int) -> None:
        """Remember until when the board moves."""
        begin = max(self._busy_until, self.bus.now())
        self._busy_until = begin + (duration + 2) * (self._divider + 1)

    def _moving(self) -> float:
        """Return the highest rate in the moves that may be under way [step/s]."""
        return self._fastest if self.bus.now() < self._busy_until else 0.0

    def _telemetry(
        self, told: Telemetry, completed: int | None = None, executing: bool | None = None
    ) -> MoveTelemetry:
        n = len(told.positions)
        near = _extended(self._counts[:n], np.array(told.positions, np.int64), self.position_bits)
        return MoveTelemetry(tuple(near.tolist()), told.velocities, completed, executing)

    def _wait(self, done: Callable[[BufferState], bool]) -> BufferState:
        """Wait for the move buffer, from the end of one move to the end of the next."""
        seen: tuple[int, int] | None = None
        rounds = 0
        while True:
            state = self.buffer()
            self._check_halt(state)
            if done(state):
                return state
            now = (state.used, state.ticks_left)
            rounds = rounds + 1 if now == seen else 0
            if rounds > ROUNDS:
                raise BusTimeoutError(
                    f"rapcores: a move with {state.ticks_left} ticks left makes no progress"
                )
            seen = now
            cycles = max(state.ticks_left, 1) * (self._divider + 1)
            self.bus.sleep(min(cycles / self.bus.clock_hz, LONGEST_SLEEP))

    def _encoder_states(self) -> list[tuple[int, int]]:
        """Return position and velocity of each encoder, signed."""
        if self.profile == "v020":
            return [
                self.codec.encoder_state(self.bus.transfer(self.codec.encoder(channel)))
                for channel in range(self.encoders)
            ]
        if self.profile == "upstream" and not self.switches["fixed"]:
            raise UsageError(
                "rapcores: in profile 'upstream' positions and velocities of encoders share their "
                "addresses; use what moves tell"
            )
        if not self.encoders:
            return []
        words = self._read_all(
            *reg.R_ENCODER_POSITION[: self.encoders], *reg.R_ENCODER_VELOCITY[: self.encoders]
        )
        signed = [word - (word >> 31 << 32) for word in words]
        return list(zip(signed[: self.encoders], signed[self.encoders :], strict=True))

    def _extend_counts(self, positions: Sequence[int]) -> NDArray[np.int64]:
        self._counts = _extended(self._counts, np.array(positions, np.int64), self.position_bits)
        return self._counts.copy()

    def _check_rates(
        self, durations: NDArray[Any], increments: NDArray[Any], changes: NDArray[Any]
    ) -> None:
        """Refuse moves in which a motor is asked for more steps than it can be given.

        Rates change evenly, so that their greatest is at the first or at the last tick.
        """
        if not len(durations) or increments.shape != changes.shape:
            return  # the codec refuses what does not fit together
        first = increments.astype(np.float64)
        last = first + (np.maximum(durations.astype(np.float64), 1) - 1)[:, None] * changes
        fastest = np.maximum(np.abs(first), np.abs(last)) / self.one_step * self.tick_rate
        allowed = self.max_step_rate * (1 + 1e-9)
        if (fastest > allowed).any():
            k, motor = np.argwhere(fastest > allowed)[0]
            raise MotionLimitError(
                f"rapcores motor {motor}: move {k} reaches {fastest[k, motor]:g} step/s; allowed "
                f"are {self.max_step_rate:g} with ticks of {self.tick_rate:g} Hz and pulses of "
                f"{self._period} cycles"
            )
        self._fastest = max(self._moving(), float(fastest.max()))

    @property
    def _period(self) -> int:
        """Shortest time from step to step [cycle]."""
        return self.timing.width + self.timing.low

    def _require_depth(self, state: BufferState) -> None:
        """Check that a state has the depth of this build: silent lines read all ones or zeros."""
        if state.depth != self.depth:
            raise BusError(
                f"rapcores: the state of the move buffer reads depth {state.depth}, it has "
                f"{self.depth}: no board answers, or bytes on the way were spoilt; check power and "
                f"wiring, and SCK at 1/{2 * reg.MIN_HALF_PERIOD} of the board's clock at most"
            )

    def _require_running(self) -> None:
        if not self.running:
            raise EstopError("rapcores: the motors are not enabled; call release_estop()")

    def _check_mask(self, mask: int) -> None:
        if not 0 <= mask < 1 << self.motors:
            raise RegisterValueError(
                f"rapcores: motor mask {mask:#x}; allowed are 0..{(1 << self.motors) - 1:#x} with "
                f"{self.motors} motors"
            )

    def _require_bridges(self, what: str) -> None:
        if not self.motor_driver:
            raise UsageError(
                f"rapcores: {what} is for builds with H-bridges; open the board with "
                f'motor_driver="h_bridge" if it is one'
            )

    def _require_document(self, what: str) -> None:
        if self.profile != "document":
            raise UsageError(
                f"rapcores: profile '{self.profile}' has no {what}; only 'document' has"
            )

    def _require_registers(self) -> None:
        if self.profile == "v020":
            raise UsageError("rapcores: profile 'v020' has no registers, only messages")

    def _divider_for(self, rate: float) -> int:
        low = 0 if self.profile == "document" else 1
        divider = round(self.bus.clock_hz / rate) - 1 if rate > 0 else -1
        if not low <= divider <= MAX_DIVIDER:
            clock = self.bus.clock_hz
            raise RegisterValueError(
                f"rapcores: ticks of {rate:g} Hz; allowed are {clock / (MAX_DIVIDER + 1):g} to "
                f"{clock / (low + 1):g}"
            )
        return divider

    def _write_divider(self, divider: int) -> None:
        if self.profile == "v020":
            self.bus.transfer(self.codec.divider(divider))
        else:
            self._write(reg.W_DIVIDER, divider)
        self._divider = divider

    def _timing_for(self, *seconds: float) -> StepTiming:
        clock = self.bus.clock_hz
        cycles = []
        for name, value in zip(TIMING.values(), seconds, strict=True):
            # a whole number of cycles shall stay that, whatever its decimal fraction is as a float
            number = math.ceil(value * clock - 1e-6) if 0 <= value < math.inf else -1
            if not 0 <= number <= MAX_TIME:
                raise RegisterValueError(
                    f"rapcores: {name} of {value:g} s; allowed are 0 to {MAX_TIME / clock:g}"
                )
            cycles.append(max(number, 1))
        return StepTiming(*cycles)

    def _set_timing(self, timing: StepTiming) -> None:
        values = (timing.width, timing.low, timing.setup, timing.hold)
        for name, cycles in zip(TIMING, values, strict=True):
            self.write_register(name, cycles=cycles)
        self.timing = timing


def count_rates(velocities: Sequence[int], clock_hz: int) -> NDArray[np.float64]:
    """Return the rates of encoders from their velocities as the board tells them [count/s].

    A velocity is the number of clock cycles between two counts, less 1, with the sign of the last
    one; 0 is what an encoder without any count has, and gives 0.

    Examples
    --------
    >>> count_rates([15_999, -7_999, 0], 16_000_000).tolist()
    [1000.0, -2000.0, 0.0]
    """
    values = np.asarray(velocities, np.float64)
    rates: NDArray[np.float64] = np.sign(values) * clock_hz / (np.abs(values) + 1)
    return rates


def _check_build(
    profile: str, word_bits: int, depth: int, halt_pin: int, position_bits: int, motor_driver: int
) -> None:
    """Check the parameters of a build that `Codec` does not.

    Raises
    ------
    UsageError
        If one is not allowed.
    """
    if not 2 <= depth <= reg.MAX_DEPTH or depth & (depth - 1):
        raise UsageError(
            f"rapcores: depth = {depth}; allowed are powers of two from 2 to {reg.MAX_DEPTH}"
        )
    if halt_pin not in (0, 1):
        raise UsageError(f"rapcores: halt_pin = {halt_pin}; allowed are 0 and 1")
    if motor_driver not in (0, 1):
        raise UsageError(
            f"rapcores: motor_driver = {motor_driver}; allowed are 0 (step_dir) and 1 (h_bridge)"
        )
    if profile != "document" and motor_driver:
        raise UsageError(
            f"rapcores: motor_driver = 1 in profile '{profile}'; only 'document' has H-bridges"
        )
    if profile != "document" and (word_bits, depth) != (reg.WORD_BITS, reg.DEPTH):
        raise UsageError(
            f"rapcores: word_bits = {word_bits} and depth = {depth} in profile '{profile}'; it has "
            f"{reg.WORD_BITS} and {reg.DEPTH}"
        )
    if profile != "v020" and position_bits != reg.POSITION_BITS:
        raise UsageError(
            f"rapcores: position_bits = {position_bits} in profile '{profile}'; it has "
            f"{reg.POSITION_BITS}"
        )


def _buffer_state(word: int, ticks: int = 0) -> BufferState:
    fields = decode(reg.MAP["R_BUFFER_STATE"], word & REGISTER)
    return BufferState(
        fields["used"],
        fields["depth"],
        bool(fields["executing"]),
        bool(fields["halted"]),
        bool(fields["halt_seen"]),
        ticks,
    )


def _extended(previous: NDArray[np.int64], raw: NDArray[Any], bits: int) -> NDArray[np.int64]:
    """Return the numbers nearest to ``previous`` whose low bits are those of ``raw``."""
    span = np.int64(1) << bits
    result: NDArray[np.int64] = (
        previous + (raw.astype(np.int64) - previous + span // 2) % span - span // 2
    )
    return result


def _bits(mask: int) -> str:
    return ", ".join(str(bit) for bit in range(mask.bit_length()) if mask >> bit & 1)
