"""The pluto-step board in engineering units, over an EPP bus.

Names, addresses and fields come from the register map. The board tells little of itself: most
registers cannot be read, and in profile ``exact`` it has neither identification nor status.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.board import resolve_switches
from pulsewright.boards.driving import Driver
from pulsewright.boards.pluto_step import registers as reg
from pulsewright.boards.pluto_step.burst import (
    AXES,
    BURST_ACCESSES,
    BURST_ADDRESS,
    RateUpdates,
)
from pulsewright.boards.pluto_step.limits import finest_tap, units_per_step, velocity_limit
from pulsewright.errors import BusError, EstopError, LateError, RegisterValueError, UsageError
from pulsewright.registers.codec import decode_bytes, encode_bytes
from pulsewright.registers.model import Register
from pulsewright.transport.bus import (
    ADDRESS_WRITE,
    DATA_WRITE,
    EPP_ACCESS,
    EppBus,
    require_acknowledge,
    write_accesses,
)

TICK: Final = 1 / reg.TICK_HZ  # [s]
MAX_TICKS: Final = reg.W_TIMING_STEPTIME_MASK + 1  # a time field of n lasts n + 1 ticks
OUTPUTS: Final = reg.W_OUTPUTS_LEVELS_MASK.bit_count()
INPUTS: Final = reg.R_INPUTS_INPUTS_MASK.bit_count()
POSITION_RANGE: Final = reg.R_POSITION_VALUE_MASK + 1
DEFAULT_STEP_TIME: Final = 4e-6  # width and space of pulses [s]
DEFAULT_DIRECTION_TIME: Final = 10e-6
# from an arm until the pins go high-Z, at least [s]
WATCHDOG_TIME: Final = (reg.WATCHDOG_TICKS - 1) * reg.WATCHDOG_CYCLES / reg.CLOCK_HZ
STREAM_BURSTS: Final = 4096  # per call of the bus: 0.7 MB of accesses


@dataclass(frozen=True)
class Identity:
    """What a board with an identification register says of itself."""

    version: int
    axes: int


class PlutoStepDriver(Driver[EppBus]):
    """One pluto-step board on an EPP bus.

    Creating the driver sends nothing. It assumes the reset state until `initialise` has made a
    known one, and it remembers what it wrote: two drivers for one board, or writes past it, break
    that.

    The board has no emergency stop, but a watchdog that makes its pins high-Z. The driver offers
    the two alike: `release_estop` starts the watchdog and every write cycle from then on feeds it;
    `estop` halts the axes and feeds it no more.

    Parameters
    ----------
    bus : EppBus
        Kept as ``bus``.
    profile : str
        ``exact`` or ``extended``.
    **switches : int
        Profile switches that differ from the profile.

    Raises
    ------
    UsageError
        If the profile or a switch is unknown or out of range.

    Examples
    --------
    >>> from pulsewright import open_board
    >>> with open_board("pluto_step") as board:
    ...     board.initialise(step_time=2e-6)
    ...     board.release_estop()
    ...     board.set_step_rate(1, -25_000.0)
    -25024.4140625
    """

    registers = reg.MAP

    def __init__(self, bus: EppBus, *, profile: str = reg.DEFAULT_PROFILE, **switches: int) -> None:
        self.bus = bus
        self.profile = profile
        self.switches = resolve_switches(reg.MAP, profile, switches)
        self._velocity = np.zeros(AXES, np.int16)
        self._fastest = np.zeros(AXES, np.int64)  # since the positions were read
        self._step_ticks = self._space_ticks = self._direction_ticks = 1
        self._tap = 0
        self._polarity = 0
        self._outputs = 0
        self._live = self._lapsed = False
        self._fed = 0  # cycle of the last feed
        self._clamped: dict[str, tuple[float, float]] = {}
        self._units = np.zeros(AXES, np.int64)  # positions read last, extended
        self._origin = np.zeros(AXES, np.int64)  # steps made where ``_units // unit`` is 0
        self._read_at = 0  # cycle of that
        self._burst = np.zeros((0, BURST_ACCESSES), EPP_ACCESS)

    # ------------------------------------------------------------------------------- the board

    def identify(self) -> Identity | None:
        """Ask the board what it is; None if it has no identification (profile ``exact``).

        Raises
        ------
        BusTimeoutError
            If no board answers.
        BusError
            If what answers is another board.
        """
        data = self.bus.read(reg.R_IDENT, 4)
        if not self.switches["id_reg"]:
            return None
        fields = decode_bytes(reg.MAP["R_IDENT"], data)
        if fields["magic"] != reg.R_IDENT_RESET >> reg.R_IDENT_MAGIC_LSB:
            raise BusError(
                f"pluto_step: the identification reads {data.hex()}, expected "
                f"{reg.R_IDENT_RESET.to_bytes(4, 'little').hex()}; a board that runs the original "
                f"gateware has none: open it with profile 'exact'"
            )
        return Identity(fields["version"], fields["axes"])

    def initialise(
        self,
        *,
        step_time: float = DEFAULT_STEP_TIME,
        step_space: float = DEFAULT_STEP_TIME,
        direction_time: float = DEFAULT_DIRECTION_TIME,
        max_rate: float | None = None,
        active_low: bool = False,
    ) -> None:
        """Bring the board from any state to a known one: axes at rest, outputs off.

        The positions become 0. They are unknown if another program has left axes moving, as one
        does that is killed. A watchdog that was enabled before is fed no more.

        Parameters
        ----------
        step_time, step_space, direction_time : float
            See `set_times` [s].
        max_rate : float, optional
            Highest rate that will be asked for [step/s]: chooses the finest speed range that
            reaches it. Default: the fastest range.
        active_low : bool
            Polarity of the step pins, all of them.

        Raises
        ------
        RegisterValueError
            If ``max_rate`` cannot be reached with these times.
        """
        if not self._velocity.any() and (self._raw_positions() != self._raw_positions()).any():
            self.lose_position()  # another program has left axes moving, with or without pins
        self._halting(max(map(abs, self.step_rates())))
        self._live = self._lapsed = False
        self._velocity[:] = 0
        self._outputs = 0
        self._polarity = int(active_low)
        self._choose_times(step_time, step_space, direction_time)
        self._tap = 0 if max_rate is None else self._tap_for(max_rate)
        self._send(self._cycle_accesses(), *self._timing_accesses())
        if self.switches["joint_commit"] or self.switches["wd_stop"]:
            stop = self.switches["wd_stop"]
            self._write(
                reg.W_CONTROL, encode_bytes(reg.MAP["W_CONTROL"], joint=0, watchdog_stop=stop)
            )
        self._wait_for_rest()
        self._units = self._raw_positions()
        self._origin = -(self._units // self._unit)

    # ------------------------------------------------------------------------------- step rates

    def set_step_rate(self, axis: int, rate: float) -> float:
        """Set the step rate of one axis; return the rate that the board will run.

        Parameters
        ----------
        axis : int
            0..3.
        rate : float
            [step/s]; the sign is the direction (direction pin 0 for positive and zero).

        Returns
        -------
        float
            The nearest rate that the board has, a multiple of `rate_resolution` [step/s].

        Raises
        ------
        RegisterValueError
            If ``rate`` is above `max_step_rate`. Nothing is written then.
        EstopError
            If `release_estop` was not called: axes move with the watchdog on only.
        """
        self._require("axis", axis, AXES)
        self._require_live()
        self._velocity[axis] = self._velocity_for(axis, rate)
        self._write_cycle()
        return self.step_rates()[axis]

    def set_step_rates(self, rates: Sequence[float] | NDArray[np.float64]) -> tuple[float, ...]:
        """Set the step rates of all four axes in one write cycle; return the real rates.

        Units and errors as in `set_step_rate`. The axes may change on different ticks.
        """
        if len(rates) != AXES:
            raise UsageError(f"pluto_step: {len(rates)} step rates given, the board has {AXES}")
        self._require_live()
        self._velocity[:] = [self._velocity_for(axis, rate) for axis, rate in enumerate(rates)]
        self._write_cycle()
        return self.step_rates()

    def step_rates(self) -> tuple[float, ...]:
        """Return the rates commanded last, signed [step/s]."""
        return tuple((self._velocity * self.rate_resolution).tolist())

    def stop(self, axis: int | None = None) -> None:
        """Halt one axis, or all of them, at once: no ramp. A pulse in flight is finished.

        The position is unknown then, if it ran faster than `start_stop_rate`.
        """
        if axis is not None:
            self._require("axis", axis, AXES)
        axes = slice(None) if axis is None else slice(axis, axis + 1)
        self._halting(max(map(abs, self.step_rates()[axes])))
        self._velocity[axes] = 0
        self._write_cycle()

    def max_step_rate(self) -> float:
        """Return the highest rate with the present times and speed range [step/s]."""
        return self.max_velocity * self.rate_resolution

    @property
    def rate_resolution(self) -> float:
        """Difference between two rates that the board has [step/s]."""
        return reg.TICK_HZ / self._unit

    @property
    def max_velocity(self) -> int:
        """Velocity word of `max_step_rate`."""
        return velocity_limit(self._tap, self._step_ticks, self._space_ticks)

    @property
    def tap(self) -> int:
        """Speed range: 0 the fastest, 3 the finest."""
        return self._tap

    def set_speed_range(self, max_rate: float) -> float:
        """Choose the finest speed range that reaches ``max_rate``; return its highest rate.

        All axes must have been told to halt. A board without switch ``tap_sync`` may make one step
        in positive direction on an axis as the range changes; the driver counts it.

        Raises
        ------
        RegisterValueError
            If an axis moves, or no range reaches this rate with the present times.
        """
        moving = np.flatnonzero(self._velocity)
        if len(moving):
            raise RegisterValueError(
                f"pluto_step axis {moving[0]}: runs at {self.step_rates()[moving[0]]:g} step/s; "
                f"the speed range can change at rest only: stop() first"
            )
        tap = self._tap_for(max_rate)
        self._wait_for_rest()
        units = self._extended(self._raw_positions())
        steps, bit = self._steps(units), self._step_bits(units)
        self._tap = tap
        self._send(*self._timing_accesses())
        self._wait_for_rest()
        if not self.switches["tap_sync"]:
            steps += self._step_bits(units) != bit
        self._origin = steps - units // self._unit
        return self.max_step_rate()

    def stream(self, updates: RateUpdates) -> None:
        """Send rate commands for all axes, each burst at its own clock cycle.

        The high byte of axis i acts ``VELOCITY_ACCESS[i]`` accesses after ``updates.cycle`` (see
        `burst`). Each burst feeds the watchdog, and writes the outputs as they are.

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
        EstopError
            If `release_estop` was not called, or the watchdog has expired since.
        RegisterValueError
            If a velocity is beyond `max_velocity`.
        """
        self._require_live()
        cycle = np.asarray(updates.cycle, np.int64)
        velocity = np.ascontiguousarray(updates.velocity, "<i2")
        n = len(cycle)
        if velocity.shape != (n, AXES):
            raise UsageError(
                f"pluto_step: updates with {n} cycles need velocities of shape ({n}, {AXES}), not "
                f"{velocity.shape}"
            )
        limit = self.max_velocity
        if n and max(int(velocity.max()), -int(velocity.min())) > limit:
            update, axis = np.argwhere((velocity > limit) | (velocity < -limit))[0]
            raise RegisterValueError(
                f"pluto_step axis {axis}: velocity {velocity[update, axis]} in update {update}, "
                f"allowed are -{limit}..{limit} with steps of {self._step_ticks} + "
                f"{self._space_ticks} ticks; plan with the pulse timing of this board"
            )
        if self._since_feed() >= WATCHDOG_TIME:  # another feed would drive the pins again
            self._lapsed = True
            self.check_running()
        for first in range(0, n, STREAM_BURSTS):
            part = slice(first, first + STREAM_BURSTS)
            self._stream(cycle[part], velocity[part])

    # ------------------------------------------------------------------------------- pulse shape

    @property
    def step_ticks(self) -> int:
        """Time the step pins are active [tick of 1.6 us]."""
        return self._step_ticks

    @property
    def space_ticks(self) -> int:
        """Least time that the step pins are inactive, which limits the step rate [tick]."""
        return self._space_ticks

    @property
    def direction_ticks(self) -> int:
        """Time from the end of a step to a direction change; to the next step 2 more [tick]."""
        return self._direction_ticks

    @property
    def clamped(self) -> dict[str, tuple[float, float]]:
        """Times that were beyond what the board can do: name to (asked, real) [s]."""
        return dict(self._clamped)

    def set_times(
        self, *, step_time: float, step_space: float, direction_time: float
    ) -> tuple[float, float, float]:
        """Set the pulse timing of all axes; return the times that the board will keep [s].

        A time beyond 25.6 us is clamped to that, with a warning, and listed in `clamped`.

        Parameters
        ----------
        step_time : float
            The step pins are active at least this long [s].
        step_space : float
            They are inactive at least this long between steps [s]; limits the step rate.
        direction_time : float
            Least time between a step and a direction change, both ways [s].

        Raises
        ------
        RegisterValueError
            If a time is negative, or an axis runs too fast for these times.
        """
        before = self._step_ticks, self._space_ticks, self._direction_ticks
        self._choose_times(step_time, step_space, direction_time)
        fast = np.flatnonzero(abs(self._velocity) > self.max_velocity)
        if len(fast):
            allowed = self.max_step_rate()
            self._step_ticks, self._space_ticks, self._direction_ticks = before
            raise RegisterValueError(
                f"pluto_step axis {fast[0]}: runs at {abs(self.step_rates()[fast[0]]):g} step/s, "
                f"these times allow {allowed:g}; slow the axis down first"
            )
        self._send(*self._timing_accesses())
        return self._step_ticks * TICK, self._space_ticks * TICK, self._direction_ticks * TICK

    # ------------------------------------------------------------------------------- positions

    def read_positions(self) -> NDArray[np.float64]:
        """Return where each axis has been told to be [step], shape (4,), with fractions of a step.

        The motors have made `read_steps` whole steps. The board counts modulo 2^21 units; the
        driver extends that, if it is called before an axis moves by half of it (512, 256, 128 or
        64 steps at taps 0 to 3).

        Raises
        ------
        BusError
            If so much time has passed that the positions may be ambiguous.
        """
        units = self._extended(self._raw_positions())
        return self._origin + units / self._unit

    def read_steps(self) -> NDArray[np.int64]:
        """Return the steps made by each axis, shape (4,); a step in flight counts. As above."""
        return self._steps(self._extended(self._raw_positions()))

    def read_units(self) -> NDArray[np.int64]:
        """Return the position registers, 0 .. 2^21 - 1, shape (4,) [2^-(11 + tap) step]."""
        return self._raw_positions()

    # ------------------------------------------------------------------------------- in and out

    def read_inputs(self) -> int:
        """Return the 16 digital inputs, input 0 in bit 0."""
        return int.from_bytes(self.bus.read(reg.R_INPUTS, 2), "little")

    def read_input(self, number: int) -> bool:
        """Return one digital input, 0..15."""
        self._require("input", number, INPUTS)
        return bool(self.read_inputs() >> number & 1)

    def write_outputs(self, word: int) -> None:
        """Set the 14 outputs, output 0 in bit 0. They are high-Z once the watchdog has expired."""
        if not 0 <= word <= reg.W_OUTPUTS_LEVELS_MASK:
            raise RegisterValueError(
                f"pluto_step: output word {word:#x} asked, allowed are "
                f"0..{reg.W_OUTPUTS_LEVELS_MASK:#x}"
            )
        self._outputs = word
        self._write_outputs()

    def write_output(self, number: int, level: bool) -> None:
        """Set one output, 0..13."""
        self._require("output", number, OUTPUTS)
        self.write_outputs(self._outputs & ~(1 << number) | bool(level) << number)

    # ------------------------------------------------------------------------------- watchdog

    @property
    def running(self) -> bool:
        """Whether the watchdog is fed and has not expired.

        In profile ``exact`` the driver tells by the time of its last feed, with switch
        ``status_reg`` by the board's own word.
        """
        if not self._live or self._lapsed:
            return False
        if self.switches["status_reg"]:
            status = self.bus.read(reg.R_STATUS, 1)[0]
            both = reg.R_STATUS_ENABLED_MASK | reg.R_STATUS_TRISTATE_MASK
            return status & both == reg.R_STATUS_ENABLED_MASK
        return self._since_feed() < WATCHDOG_TIME

    def estop(self) -> None:
        """Halt the axes, switch the outputs off, and let the watchdog expire within 6.5 ms.

        There is no ramp: the position is unknown then, if an axis ran faster than
        `start_stop_rate`.
        Without `release_estop` before, the watchdog may not be enabled: then the pins stay driven.
        """
        self._halting(max(map(abs, self.step_rates())))
        self._live = False
        self._velocity[:] = 0
        self._outputs = 0
        self._write_cycle()

    def release_estop(self) -> None:
        """Halt the axes and start the watchdog; pins that were high-Z are driven again.

        From now on the watchdog wants to be fed every 6.4 ms: every write does it.

        Raises
        ------
        EstopError
            If feeding it takes too long on this link.
        """
        self._halting(max(map(abs, self.step_rates())))
        self._velocity[:] = 0
        self._live = True
        self._write_cycle()
        self._lapsed = False
        if not self.running:
            self._live = False
            raise EstopError(
                f"pluto_step: the watchdog expires before this link can feed it (at the earliest "
                f"after {WATCHDOG_TIME * 1e3:.2f} ms); use a faster link"
            )

    def check_running(self) -> None:
        """Check that the watchdog has been fed in time.

        Raises
        ------
        EstopError
            If not, or if it was not started.
        """
        if self.running:
            return
        if not self._live:
            raise EstopError("pluto_step: in emergency stop: call release_estop()")
        self._halting(max(map(abs, self.step_rates())))
        raise EstopError(
            f"pluto_step: the watchdog expired, so steps are lost: writes must not be more than "
            f"{WATCHDOG_TIME * 1e3:.2f} ms apart; call feed_watchdog() in time, or release_estop()"
        )

    def feed_watchdog(self) -> None:
        """Feed the watchdog, if it was started; rewrites the outputs."""
        self._write_outputs()

    # ------------------------------------------------------------------------------- raw access

    def read_register(self, name: str, instance: int = 0) -> dict[str, int]:
        """Return the raw fields of a register by its name in the register map.

        >>> from pulsewright import open_board
        >>> open_board("pluto_step").read_register("R_POSITION", 2)
        {'value': 0}
        """
        register, address = self._register("read", name, instance)
        return decode_bytes(register, self.bus.read(address, register.size))

    def write_register(self, name: str, instance: int = 0, **fields: SupportsIndex) -> None:
        """Write raw fields to a register by its name in the register map; others become 0.

        The methods above do not learn of it and overwrite it with what they remember.

        >>> from pulsewright import open_board
        >>> open_board("pluto_step").write_register("W_VELOCITY", instance=1, value=-100)
        """
        register, address = self._register("write", name, instance)
        self._write(address, encode_bytes(register, **fields))

    def _register(self, side: str, name: str, instance: int) -> tuple[Register, int]:
        register, address = super()._register(side, name, instance)
        if register.present_with and not any(self.switches[s] for s in register.present_with):
            raise UsageError(
                f"pluto_step register {name} needs switch {' or '.join(register.present_with)}; "
                f"open the board with profile 'extended'"
            )
        return register, address

    # ------------------------------------------------------------------------------- below

    @property
    def _unit(self) -> int:
        return units_per_step(self._tap)

    def _send(self, *parts: NDArray[np.void]) -> None:
        """Carry out accesses in one transaction."""
        accesses = np.concatenate(parts)
        self.bus.transact(accesses)
        require_acknowledge(accesses)

    def _write(self, register: int, data: bytes) -> None:
        self.bus.write(register, data)

    def _output_word(self) -> int:
        return self._outputs | (reg.W_OUTPUTS_WATCHDOG_ARM_MASK if self._live else 0)

    def _cycle_accesses(self) -> NDArray[np.void]:
        outputs = self._output_word().to_bytes(2, "little")
        return write_accesses(BURST_ADDRESS, self._velocity.astype("<i2").tobytes() + outputs)

    def _timing_accesses(self) -> list[NDArray[np.void]]:
        timing = encode_bytes(
            reg.MAP["W_TIMING"],
            polarity=self._polarity,
            dirtime=self._direction_ticks - 1,
            tap=self._tap,
            steptime=self._step_ticks - 1,
        )
        parts = [write_accesses(reg.W_TIMING, timing)]
        if self.switches["enforce_space"]:
            space = self._space_ticks - 1
            parts.append(write_accesses(reg.W_SPACE, encode_bytes(reg.MAP["W_SPACE"], space=space)))
        return parts

    def _write_cycle(self) -> None:
        """Write all velocities and the outputs; feed the watchdog if it was started."""
        self._note_velocities(self._velocity)
        self._send(self._cycle_accesses())
        self._note_feeds(np.array([self.bus.now()]))

    def _write_outputs(self) -> None:
        self._write(reg.W_OUTPUTS, self._output_word().to_bytes(2, "little"))
        self._note_feeds(np.array([self.bus.now()]))

    def _note_feeds(self, cycles: NDArray[np.int64]) -> None:
        """Remember feeds, and that one came too late: the board does not always tell."""
        longest = int(np.diff(cycles, prepend=self._fed).max())
        self._lapsed |= self._live and longest >= WATCHDOG_TIME * self.bus.clock_hz
        self._fed = int(cycles[-1])

    def _since_feed(self) -> float:
        return (self.bus.now() - self._fed) / self.bus.clock_hz

    def _note_velocities(self, velocity: NDArray[np.int16]) -> None:
        speed = abs(velocity.reshape(-1, AXES).astype(np.int64)).max(axis=0)
        self._fastest = np.maximum(self._fastest, speed)

    def _velocity_for(self, axis: int, rate: float) -> int:
        limit = self.max_velocity
        exact = rate / self.rate_resolution if math.isfinite(rate) else math.inf
        if not abs(exact) < limit + 0.5:
            raise RegisterValueError(
                f"pluto_step axis {axis}: {rate:g} step/s asked, allowed are up to "
                f"{self.max_step_rate():.6g} step/s either way with steps of "
                f"{self._step_ticks * TICK * 1e6:g} + {self._space_ticks * TICK * 1e6:g} us in "
                f"speed range {self._tap}; change feed, steps per mm, pulse times or speed range"
            )
        return round(exact)

    def _tap_for(self, max_rate: float) -> int:
        tap = finest_tap(max_rate, self._step_ticks, self._space_ticks)
        if tap is None:
            fastest = velocity_limit(0, self._step_ticks, self._space_ticks) * reg.TICK_HZ
            raise RegisterValueError(
                f"pluto_step: {max_rate:g} step/s asked, steps of "
                f"{self._step_ticks * TICK * 1e6:g} + {self._space_ticks * TICK * 1e6:g} us allow "
                f"{fastest / units_per_step(0):g}; shorten the pulse times or lower the rate"
            )
        return tap

    def _choose_times(self, step: float, space: float, direction: float) -> None:
        self._clamped = {}
        self._step_ticks = self._time_to_ticks("step time", step)
        self._space_ticks = self._time_to_ticks("step space", space)
        self._direction_ticks = self._time_to_ticks("direction time", direction)

    def _time_to_ticks(self, what: str, seconds: float) -> int:
        """Return the fewest ticks that last at least ``seconds``, or the most there are."""
        if not 0 <= seconds < math.inf:
            raise RegisterValueError(
                f"pluto_step: {what} {seconds * 1e6:g} us asked, allowed are 0.."
                f"{MAX_TICKS * TICK * 1e6:g} us"
            )
        exact = round(seconds * reg.TICK_HZ, 6)
        if exact > MAX_TICKS:
            self._clamped[what] = seconds, MAX_TICKS * TICK
            warnings.warn(
                f"pluto_step: {what} {seconds * 1e6:g} us asked, the most the board can do is "
                f"{MAX_TICKS * TICK * 1e6:g} us",
                stacklevel=4,
            )
            return MAX_TICKS
        return max(1, math.ceil(exact))

    def _wait_for_rest(self) -> None:
        """Let steps and direction changes under way come to their end.

        Address writes fill the time: they change nothing, on every link.
        """
        ticks = 4 * MAX_TICKS + 1  # a pulse, a pending one, hold and set-up with their changes
        cycles = ticks * self.bus.clock_hz // reg.TICK_HZ
        count = -(-cycles // max(self.bus.access_cycles, 1))
        self._send(np.tile(write_accesses(BURST_ADDRESS, b""), count))

    def _raw_positions(self) -> NDArray[np.int64]:
        data = self.bus.read(reg.R_POSITION[0], 4 * AXES)
        return np.frombuffer(data, "<u4").astype(np.int64)

    def _extended(self, raw: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the positions nearest to the last ones that equal ``raw`` modulo 2^21."""
        now = self.bus.now()
        ticks = (now - self._read_at) * reg.TICK_HZ // self.bus.clock_hz + 1
        far = np.flatnonzero(self._fastest * ticks >= POSITION_RANGE // 2)
        if len(far):
            allowed = POSITION_RANGE / 2 / self._fastest[far[0]] * TICK
            raise BusError(
                f"pluto_step axis {far[0]}: position is ambiguous {ticks * TICK:.3g} s after it "
                f"was read last; at the rates commanded since, read it every {allowed:.3g} s"
            )
        half = POSITION_RANGE // 2
        self._units = (
            self._units + (raw - self._units % POSITION_RANGE + half) % POSITION_RANGE - half
        )
        self._read_at, self._fastest = now, abs(self._velocity.astype(np.int64))
        return self._units.copy()

    def _steps(self, units: NDArray[np.int64]) -> NDArray[np.int64]:
        return self._origin + units // self._unit

    def _step_bits(self, units: NDArray[np.int64]) -> NDArray[np.int64]:
        return units // self._unit & 1

    def _require_live(self) -> None:
        if not self._live:
            raise EstopError("pluto_step: in emergency stop: call release_estop() first")

    def _burst_buffer(self, n: int) -> NDArray[np.void]:
        """Return a reusable array of n bursts; what never changes is filled in already."""
        if len(self._burst) < n:
            self._burst = np.zeros((n, BURST_ACCESSES), EPP_ACCESS)
            self._burst["op"] = DATA_WRITE
            self._burst["op"][:, 0] = ADDRESS_WRITE
            self._burst["value"][:, 0] = BURST_ADDRESS
        return self._burst[:n]

    def _stream(self, cycle: NDArray[np.int64], velocity: NDArray[np.int16]) -> None:
        n = len(cycle)
        burst = self._burst_buffer(n)
        asked = cycle[:, None] + np.arange(BURST_ACCESSES) * self.bus.access_cycles
        burst["cycle"] = asked
        burst["timeout"] = 0
        burst["value"][:, 1:-2] = velocity.view(np.uint8).reshape(n, 2 * AXES)
        burst["value"][:, -2:] = list(self._output_word().to_bytes(2, "little"))
        self._note_velocities(velocity)
        self._velocity[:] = velocity[-1]
        self.bus.transact(burst.reshape(-1))
        require_acknowledge(burst.reshape(-1))
        self._note_feeds(burst["cycle"][:, -1])
        late = burst["cycle"] != asked
        if late.any():
            update, access = (int(k) for k in np.argwhere(late)[0])
            by = int(burst["cycle"][update, access] - asked[update, access])
            raise LateError(
                f"pluto_step: {int(late.any(axis=1).sum())} of {n} rate commands came late, the "
                f"first one, for cycle {cycle[update]}, by {by} cycles "
                f"({by / self.bus.clock_hz * 1e6:.3g} us): the motion is not as planned; start "
                f"later after now() or leave more time between commands"
            )
