"""A trajectory played on a board: moves, streamed such that one follows the other without a gap."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Final, TypedDict

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.driving import Stop
from pulsewright.boards.playing import LOOK, Drives, PacedPlayer
from pulsewright.boards.rapcores import registers as reg
from pulsewright.boards.rapcores.commands import (
    Converter,
    Moves,
    PulseTiming,
    grid_ticks,
    tick_period,
)
from pulsewright.boards.watching import (
    Feedback,
    check_positions,
    require_encoders,
    require_inputs,
)
from pulsewright.errors import (
    BusError,
    FollowingError,
    MotionLimitError,
    RegisterValueError,
    StarvedError,
    UsageError,
)
from pulsewright.motion.rejoin import rejoin
from pulsewright.transport.spi_bus import CS_HIGH, SpiBus, VirtualSpiBus

if TYPE_CHECKING:
    from pulsewright.boards.rapcores.driver import RapcoresDriver
    from pulsewright.boards.rapcores.messages import Telemetry
    from pulsewright.motion.trajectory import Trajectory

LEAD: Final = 0.2  # first move, at rest: the host fills the buffer and sets up what it needs [s]
SOON: Final = 0.01  # between two looks at whether a new plan is made [s]
CONVERTED: Final = 4096  # grid steps at once
ACTS: Final = 5  # from the end of the last bit of a word to its effect [clock]
COUNTS: Final = 1 << 32  # of the counters of moves
LOOKED_AT: Final = 16  # registers in a look beside the positions
BULGE: Final = 2.0  # by which a motor may be beyond both ends of its moves [step]
DEPTH: Final = reg.R_BUFFER_STATE_DEPTH_MASK
DEPTH_LSB: Final = reg.R_BUFFER_STATE_DEPTH_LSB
HALT: Final = reg.R_BUFFER_STATE_HALTED_MASK | reg.R_BUFFER_STATE_HALT_SEEN_MASK

Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Told:
    """What a move was told by the board about an earlier one.

    Parameters
    ----------
    move : int
        Number of the move that was executing, from 0 on.
    time : float
        Time of the plan as it began [s]; negative before the plan.
    position : (motors,) float64
        Where the motors of the plan were commanded to be as it began [step].
    telemetry : Telemetry
        Encoders as it began.
    """

    move: int
    time: float
    position: NDArray[np.float64]
    telemetry: Telemetry

    def following_error(self, counts_per_step: Sequence[float]) -> NDArray[np.float64]:
        """Return commanded minus measured position of motors with an encoder [step].

        Parameters
        ----------
        counts_per_step : sequence of float
            Of encoder i, on motor i; it read 0 where the motor was at position 0.
        """
        n = min(len(counts_per_step), len(self.telemetry.positions), len(self.position))
        measured = np.array(self.telemetry.positions[:n]) / np.asarray(counts_per_step[:n])
        return np.asarray(self.position[:n] - measured)


@dataclass(frozen=True)
class _Pace:
    """What stays the same from one trajectory to the next.

    Parameters
    ----------
    tick : int
        Length of a tick [clock].
    ticks : int
        Length of a grid step [tick].
    phase : int
        Cycle of a tick, and of all that are whole ticks later.
    read, message : int
        Time that the link takes to read a register, and for a move with what is asked with it
        [clock].
    """

    tick: int
    ticks: int
    phase: int
    read: int
    message: int


class _Times(TypedDict):
    """Minima of the drives [s]."""

    pulse_width: float
    pulse_space: float
    direction_setup: float
    direction_hold: float


class RapcoresPlayer(PacedPlayer):
    """Play motor positions on a RAPcores board. Creating one sends nothing; see `prepare`.

    If the board gets no move in time it stands still at once, without a ramp; `play` raises
    `StarvedError` then, and knows where it stands, if no step was lost. `resume` goes back to the
    plan and completes it.

    Moves that the board has cannot be taken back but by a halt, which is no ramp. So `stop` lets
    them be made, and leaves the plan behind them.

    Parameters
    ----------
    driver : RapcoresDriver
        Of the board; nothing else may use it while this plays.
    trajectory : Trajectory
        Motor positions [step].
    drives : Drives
    """

    def __init__(
        self,
        driver: RapcoresDriver,
        trajectory: Trajectory,
        drives: Drives,
    ) -> None:
        super().__init__(driver, trajectory, drives)
        self.rates, self.accelerations = drives.rates, drives.accelerations
        self.jerks = drives.jerks
        timing = drives.timing
        self._times: _Times = {
            "pulse_width": timing.width,
            "pulse_space": timing.space,
            "direction_setup": timing.setup,
            # it counts from the active edge; the board waits from the other one on
            "direction_hold": max(timing.hold - timing.width, 0.0),
        }
        self._feedback = drives.feedback
        require_encoders("rapcores", drives.feedback, min(driver.encoders, trajectory.axes))
        require_inputs("rapcores", drives.switches, 0)
        self._job: _Job | None = None
        self._stopped: StarvedError | None = None
        self._next_look = 0  # cycle

    def _prepare(self) -> None:
        """Bring the board from any state to rest, and start; the plan's time 0 is `LEAD` later.

        The board is reset, if the link can do that. Otherwise its accumulators are brought to whole
        steps, wherever another program has left them.
        """
        driver, bus, motors = self.driver, self.driver.bus, self.trajectory.axes
        if driver.profile != "document":
            raise UsageError(
                f"rapcores: profile '{driver.profile}' cannot play plans, for its moves lose ticks "
                f"and it makes no step pulses of a set width; take profile 'document'"
            )
        if motors > driver.motors:
            raise MotionLimitError(
                f"rapcores: the plan has {motors} motors, the board has {driver.motors}"
            )
        self._initialise()
        driver.require_position()  # the board may just have told that it is unknown
        timing, rate = PulseTiming(**asdict(driver.timing)), max(self.rates)
        tick, read = tick_period(timing, rate), self._longest(driver.steps_lost)
        message = read * (1 + driver.motors + 2)
        frame = driver.codec.nop() * (driver.codec.move_words + 4)  # a move and a question
        # links in real time take it at once
        carried = min(message, self._longest(lambda: bus.transfer(frame)))
        ticks = grid_ticks(
            timing, tick=tick, message_cycles=carried, acceleration=max(self.accelerations)
        )
        driver.release_estop()
        # with a tick in every clock the divider's counter stays 0; so its phase is known afterwards
        driver.set_tick_rate(bus.clock_hz)
        driver.set_tick_rate(bus.clock_hz / tick)
        phase = _sent_at(bus) + ACTS - 1
        driver.check_configuration()
        self._pace = _Pace(tick, ticks, phase, read, message)
        self._job = _Job(driver, self.trajectory, self._pace, None, self._feedback)

    def resume(self) -> Trajectory:
        """Go back to the plan after `StarvedError`, and play the rest; return what is played now.

        That is a motion of its own, with its own time: from where the motors rest straight to where
        the plan was left, and on along the plan. `trajectory`, `start_cycle` and `play` are about
        it from now on.

        Raises
        ------
        UsageError
            If the job has not been stopped by that error.
        PositionUnknownError
            If motors were stopped from more than the driver's ``start_stop_rate``. Call its
            ``reference`` if it is known that they have lost no step, from encoders for instance.
        """
        if self._stopped is None:
            raise UsageError("rapcores: nothing to resume; the job did not run out of moves")
        self.driver.require_position()
        self.trajectory = rejoin(
            self.trajectory,
            self._stopped.time,
            self._stopped.position,
            rates=self.rates,
            accelerations=self.accelerations,
            jerks=self.jerks,
        )
        self._stopped = None
        self._job = _Job(
            *(self.driver, self.trajectory, self._pace, self._playing.accumulators),
            self._feedback,
        )
        self.driver.begin_plan(self)
        return self.trajectory

    @property
    def update(self) -> float:
        """Grid step of the moves [s]: two of them after a stop, each step has been made."""
        return self._playing.converter.grid

    @property
    def start_cycle(self) -> int:
        """Clock cycle of the plan's second 0; exact on a link to a twin."""
        return self._playing.start_cycle

    @property
    def done(self) -> bool:
        """Whether the whole plan has been made."""
        return self._job is not None and self._job.finished

    @property
    def evidence(self) -> tuple[str, ...]:
        """What has been compared with the plan without error, by what the board tells."""
        counted = (
            "counters of the board: all moves made, none refused, no message damaged, no step lost",
            "steps that the board has made, at the end of the plan",
        )
        encoders = "encoders, now and then, and at the end of the plan"
        return counted if self._feedback is None else (*counted, encoders)

    @property
    def told(self) -> Told | None:
        """The latest telemetry, if the board has told any."""
        return self._playing.told

    def _play(self, until: float) -> None:
        """Stream the plan, and return when the board is at ``until`` [s].

        The buffer is kept full. At the end of the plan everything has come to rest, and is where
        the model says.
        """
        if self._stopped is not None:
            raise self._stopped
        job, bus = self._playing, self.driver.bus
        end: float = math.inf
        if until < self.trajectory.duration:
            end = job.start_cycle + math.ceil(until * bus.clock_hz)
        while job.waiting:
            left = end - bus.now()
            if left <= 0 or self._interrupted():
                return
            self._look()
            wait = job.cycles_to_room() if job.full else 0
            if wait and (wait >= left or not isinstance(bus, VirtualSpiBus)):
                bus.sleep(min(left, wait) / bus.clock_hz)
                job.ask()
            elif job.over or not job.send(wait):  # a twin's time is exact: no need to ask
                self._starved()
        if end < math.inf:
            bus.sleep(max(end - bus.now(), 0) / bus.clock_hz)
        elif not job.finished:
            job.rest()
            job.finished = True
            bus.sleep(self.update)  # the last pulse goes out

    def _stop(self) -> Stop | None:
        job = self._playing
        end = self.trajectory.duration
        time = self._leave(self._hold)
        self._play(math.inf)
        return (
            Stop(end if time is None else time, tuple(job.accumulators[0].tolist()))
            if job.finished
            else None
        )

    @property
    def free_from(self) -> float:
        """Time behind the moves that are sent [s]: from then on the plan may be another one."""
        return self._playing.free_from

    @property
    def _soon(self) -> float:
        bus: SpiBus = self.driver.bus
        return (bus.now() - self.start_cycle) / bus.clock_hz + SOON

    def _follow(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory
        self._playing.follow(trajectory)

    def speed(self) -> float:
        """Return the highest commanded rate of a motor about now [step/s]."""
        job, bus = self._playing, self.driver.bus
        about = np.array([-1, 0, 1]) * job.converter.grid
        times = (bus.now() - job.start_cycle) / bus.clock_hz + about
        return float(abs(self.trajectory.at(times, 1)).max())

    def _lost(self, error: BaseException) -> None:
        if not isinstance(error, StarvedError):
            super()._lost(error)
            return
        about = np.array([error.time - self.update, error.time])
        if abs(self.trajectory.at(about, 1)).max() > self.driver.start_stop_rate:
            self.driver.lose_position()
        self.driver.end_plan()

    @property
    def _playing(self) -> _Job:
        if self._job is None:
            raise RuntimeError("call prepare() first")
        return self._job

    def _initialise(self) -> None:
        """Set the board's times, and its accumulators to whole steps: by a reset, if possible."""
        try:
            try:
                self.driver.initialise(**self._times, reset=True)
            except UsageError:  # no such pin on this link
                self.driver.initialise(**self._times)
                self.driver.level()
        except RegisterValueError as error:
            raise MotionLimitError(str(error)) from error

    def _longest(self, access: Callable[[], object]) -> int:
        """Return how long an access takes on this link, the longest of a few [clock]."""
        bus, longest = self.driver.bus, 0
        for _ in range(3):
            start = bus.now()
            access()
            longest = max(longest, bus.now() - start)
        return longest

    def _look(self) -> None:
        """See now and then that the board does what it was told, if there is time before a move."""
        job, now = self._playing, self.driver.bus.now()
        if now >= self._next_look and job.full and job.cycles_to_room() > job.look_cycles:
            self._next_look = now + round(LOOK * self.driver.bus.clock_hz)
            job.look()

    def _starved(self) -> None:
        """Wait until everything rests; tell where."""
        job = self._playing
        job.rest()
        place = job.place.tolist()
        self._stopped = StarvedError(
            f"rapcores: got no move in time and stood still at once, without a ramp, so that fast "
            f"motors may have lost steps: the plan is done up to {job.time:.3f} s, the board is at "
            f"steps {', '.join(f'{p:.1f}' for p in place)}; resume() goes back to the plan. The "
            f"link or this computer was too slow; do less beside, or take a deeper buffer",
            time=job.time,
            position=tuple(place),
        )
        raise self._stopped


class _Job:
    """One trajectory on its way: conversion, what is sent, and what the board said to it.

    Creating one sends its first moves.

    Parameters
    ----------
    driver : RapcoresDriver
    trajectory : Trajectory
    pace : _Pace
    accumulators : tuple of (motors,) int64, optional
        Where the board is: steps and fractions of the trajectory. Default: at its start, rounded.
    feedback : Feedback, optional
        Encoders to be compared; they agree with the motors as the job begins.

    Attributes
    ----------
    start_cycle : int
        Clock cycle of time 0 of the trajectory.
    accumulators : tuple of (motors,) int64
        Steps and fractions after the moves sent.
    finished : bool
        For the player.
    """

    def __init__(
        self,
        driver: RapcoresDriver,
        trajectory: Trajectory,
        pace: _Pace,
        accumulators: tuple[Ints, Ints] | None,
        feedback: Feedback | None,
    ) -> None:
        self._driver, self._bus, self._pace = driver, driver.bus, pace
        self._feedback = feedback
        registers = LOOKED_AT + driver.motors
        if feedback is not None:
            registers += driver.motors + 2 * driver.encoders + 1
        self.look_cycles = registers * pace.read
        position, fraction = accumulators or (None, None)
        self.converter = Converter(
            trajectory,
            ticks=pace.ticks,
            tick=pace.tick,
            word_bits=driver.word_bits,
            position=position,
            fraction=fraction,
        )
        self.accumulators = self.converter.position, self.converter.fraction
        self.finished = False
        # number of a move, ticks and accumulators as it began, what the board told of that moment
        self._telemetry: tuple[int, int, tuple[Ints, Ints], bytes] | None = None
        self._question = b"".join(
            driver.codec.status_read(address) for address in (reg.R_TICKS_LEFT, reg.R_BUFFER_STATE)
        )
        self._offset = driver.read_steps()[: trajectory.axes] - self.accumulators[0]
        self._encoder_offset = 0.0 if feedback is None else self._following(feedback)
        self._completed = driver.counters().moves_completed
        self._waiting: deque[tuple[bytes, int, Ints, Ints]] = deque()
        # duration, ticks of the conversion before, and accumulators then, of the moves that may not
        # be completed
        self._open: deque[tuple[int, int, tuple[Ints, Ints]]] = deque(maxlen=driver.depth + 1)
        self._sent = self._used = self._ticks_left = self._ticks = 0
        self._all_converted = False
        self.start_cycle = self._start()

    @property
    def free_from(self) -> float:
        """Time behind the moves that are sent [s]."""
        return max(self.converter.time(self._ticks), 0.0)

    def follow(self, trajectory: Trajectory) -> None:
        """Go on behind the moves that are sent with a trajectory that is the same up to there."""
        pace = self._pace
        self.converter = Converter(
            trajectory,
            ticks=pace.ticks,
            tick=pace.tick,
            word_bits=self._driver.word_bits,
            position=self.accumulators[0],
            fraction=self.accumulators[1],
            at=self._ticks // pace.ticks,
        )
        self._waiting.clear()
        self._all_converted = False

    @property
    def waiting(self) -> bool:
        """Whether there are moves to send."""
        if not self._waiting and not self._all_converted:
            self._append(self.converter.convert(CONVERTED))
            if self.converter.done:
                self._append(self.converter.finish())
                self._all_converted = True
        return bool(self._waiting)

    @property
    def full(self) -> bool:
        """Whether the board took no further move when it was asked last."""
        return self._used >= self._driver.depth

    @property
    def told(self) -> Told | None:
        """The latest telemetry."""
        if self._telemetry is None:
            return None
        move, ticks, accumulators, reply = self._telemetry
        time, place = self.converter.time(ticks), self._place(accumulators)
        return Told(move, time, place, self._driver.codec.telemetry(reply))

    @property
    def place(self) -> NDArray[np.float64]:
        """Where the motors are after the moves sent [step], shape (motors,)."""
        return self._place(self.accumulators)

    @property
    def time(self) -> float:
        """Time of the trajectory after the moves sent [s]."""
        return min(max(self.converter.time(self._ticks), 0.0), self.converter.trajectory.duration)

    @property
    def over(self) -> bool:
        """Whether all moves sent are over by now: another one would begin without a ramp."""
        return self._bus.now() > self._origin + self._ticks * self._pace.tick

    def cycles_to_room(self) -> int:
        """Return in how much time the executing move is over [clock]; at least that of asking.

        What is left of it was asked first, so the time that the second answer took is over.
        """
        return max((self._ticks_left + 1) * self._pace.tick - self._pace.read, self._pace.read)

    def send(self, wait: int = 0) -> bool:
        """Send the next move; return whether it came before the one ahead of it was over.

        Parameters
        ----------
        wait : int
            So long from now, on links to twins [clock].

        Raises
        ------
        EstopError
            If the board was halted.
        """
        frame, duration, *accumulators = self._waiting.popleft()
        reply = self._bus.transfer(frame + self._question, self._bus.now() + wait)
        self._open.append((duration, self._ticks, self.accumulators))
        self.accumulators = accumulators[0], accumulators[1]
        self._sent += 1
        self._ticks += duration
        self._note(reply)
        self._take(reply[: len(frame)])
        # Two moves now: the one ahead is not over. The last one, of a tick, may come at any time.
        return self._used > 1 or not self._waiting

    def ask(self) -> None:
        """Ask whether there is room."""
        if self._bus.level("buffer_dtr"):
            self._used = self._driver.depth - 1
        else:
            self._note(self._bus.transfer(self._question))

    def look(self) -> None:
        """Check what the board holds and counts, and that it is on its way.

        Raises
        ------
        BusError
            If it has counted errors, or does not hold what was written.
        FollowingError
            If it is not between the moves that it has, or an encoder does not follow.
        """
        driver = self._driver
        driver.check_configuration()
        driver.check_counters()
        steps = driver.read_steps()[: len(self._offset)] - self._offset
        ends = np.array([before[0] for _, _, before in self._open] + [self.accumulators[0]])
        off = (steps - np.clip(steps, ends.min(axis=0), ends.max(axis=0))).astype(np.float64)
        check_positions("rapcores", off, np.full(len(off), BULGE), "bytes were spoilt on the way")
        self._check_encoders(BULGE)
        self._note(self._bus.transfer(self._question))

    def _following(self, feedback: Feedback) -> NDArray[np.float64]:
        """Return by how much each encoder is off its motor [step]."""
        return -self._driver.following_error([1 / scale for scale in feedback.counts_per_step])

    def _check_encoders(self, more: float) -> None:
        """Check that the encoders follow, by ``more`` than at rest [step]."""
        feedback, driver = self._feedback, self._driver
        if feedback is None:
            return
        used = (1 << len(feedback.counts_per_step)) - 1
        if faults := driver.encoder_faults() & used:
            raise FollowingError(
                f"rapcores: encoder {(faults & -faults).bit_length() - 1} has changed both signals "
                f"at once, so that counts are lost: it is noisy, too fast or badly wired; look for "
                f"the cause, and reference the machine again"
            )
        off = self._following(feedback) - self._encoder_offset
        bounds = np.full(len(off), feedback.following_error + more)
        check_positions("rapcores", off, bounds, "steps were lost, or an encoder does not count")

    def rest(self) -> None:
        """Wait until all moves sent are made; check that the board is where the model is.

        Raises
        ------
        BusError
            If it is not, has counted errors, or does not hold what was written.
        FollowingError
            If an encoder is not there.
        """
        driver = self._driver
        driver.wait_idle()
        driver.check_configuration()
        driver.check_counters()
        made = (driver.counters().moves_completed - self._completed) % COUNTS
        steps = driver.read_steps()[: len(self._offset)]
        if made != self._sent or (steps != self.accumulators[0] + self._offset).any():
            raise BusError(
                f"rapcores: the board made {made} moves and is at {steps.tolist()}, it was sent "
                f"{self._sent} that lead to {(self.accumulators[0] + self._offset).tolist()}; "
                f"bytes were spoilt on the way, or something else has moved it"
            )
        self._check_encoders(0.0)

    def _start(self) -> int:
        """Send a move at rest, and fill the buffer behind it; return the cycle of time 0."""
        pace = self._pace
        lead = math.ceil(LEAD * reg.CLOCK_HZ / pace.tick)
        none = np.zeros((1, len(self._offset)), np.int64)
        position, fraction = self.accumulators
        self._append(Moves(np.array([lead], np.uint32), none, none, position[None], fraction[None]))
        frame, duration, *_ = self._waiting.popleft()
        more = self.waiting  # what comes next is converted before time counts
        self._bus.transfer(frame)
        self._open.append((duration, -lead, self.accumulators))
        self._sent = self._used = 1
        loaded = _sent_at(self._bus) + ACTS
        first_tick = loaded + 1 + (pace.phase - loaded - 1) % pace.tick
        self._origin = first_tick + lead * pace.tick
        while more and not self.full:
            self.send()
            more = self.waiting
        return self.converter.start_cycle(first_tick + lead * pace.tick)

    def _append(self, moves: Moves) -> None:
        """Take in the next moves."""
        shape = len(moves), self._driver.motors
        increment, incinc = np.zeros(shape, np.int64), np.zeros(shape, np.int64)
        motors = moves.increment.shape[1]
        increment[:, :motors], incinc[:, :motors] = moves.increment, moves.incinc
        frames = self._driver.codec.moves(moves.duration, increment, incinc)
        columns = (moves.duration.tolist(), moves.position, moves.fraction)
        self._waiting.extend(zip(frames, *columns, strict=True))

    def _note(self, reply: bytes) -> None:
        """Take in what the board answers to the question at the end of a frame."""
        size = self._driver.codec.word_bytes
        state = int.from_bytes(reply[-size:], "little")
        if (state & DEPTH) >> DEPTH_LSB != self._driver.depth:
            self._driver.buffer()  # asks again; raises if no board answers
            reply = self._bus.transfer(self._question)
            state = int.from_bytes(reply[-size:], "little")
        self._used = state & reg.R_BUFFER_STATE_USED_MASK
        # no more than the move that executes has, whatever noise makes of it
        known = 0 < self._used <= len(self._open)
        most = self._open[-self._used][0] if known else 0
        self._ticks_left = min(int.from_bytes(reply[-3 * size : -2 * size], "little"), most)
        if state & HALT:
            self._driver.check_running()

    def _take(self, reply: bytes) -> None:
        """Keep the telemetry that came with a move, if it is known of which move it is."""
        if not 0 < self._used <= len(self._open):
            return
        duration, ticks, accumulators = self._open[-self._used]
        pace = self._pace
        # it began before the header of this move, and was not over between the two answers
        since, left = (duration - self._ticks_left) * pace.tick, self._ticks_left * pace.tick
        if since > pace.message - 2 * pace.read and left > 2 * pace.read:
            self._telemetry = self._sent - self._used, ticks, accumulators, reply

    def _place(self, accumulators: tuple[Ints, Ints]) -> NDArray[np.float64]:
        position, fraction = accumulators
        return np.asarray(position + fraction / self._driver.one_step - 0.5)


def _sent_at(bus: SpiBus) -> int:
    """Return the cycle at which the last bit of the frame sent last ended; else the present."""
    if not isinstance(bus, VirtualSpiBus):
        return bus.now()
    return bus.now() - bus.half - max(2 * bus.half, CS_HIGH)
