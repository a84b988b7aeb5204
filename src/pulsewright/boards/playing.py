"""What playing a plan takes, whatever the board; and converting it to updates at even times."""

from __future__ import annotations

import math
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from threading import Thread
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.driving import Stop
from pulsewright.boards.watching import Feedback, LimitSwitches, check_positions, check_switches
from pulsewright.edges.timing import DriveTiming
from pulsewright.errors import (
    BusError,
    EstopError,
    LateError,
    MotionLimitError,
    UsageError,
)
from pulsewright.interrupts import kept_back
from pulsewright.motion.hold import AxisLimits, hold

if TYPE_CHECKING:
    from pulsewright.motion.trajectory import Trajectory

U = TypeVar("U")  # updates: native commands in columns, of one board
# Gets the time from which on a plan may be another one [s]. Returns that one, which is the same up
# to then, piece by piece; and another time, which is passed on.
Replan = Callable[[float], tuple["Trajectory", float]]

LOOK: Final = 0.1  # of a plan, from one look at the board's positions to the next [s]
WATCH: Final = 0.02  # the same where there are switches or encoders to look at [s]
ROUNDING: Final = 1.0  # by which a position in motion may differ beside the way of an update [step]
PORTION: Final = 16  # updates that are streamed at once, at first
QUICK: Final = 0.01  # portions that take less time of the host are doubled [s], ...
SLOW: Final = 0.04  # ... and those that take more are halved
CLOSED: Final = (
    "with an encoder on each motor (a machine file's [encoders]), or the steps looped back to the "
    "encoder inputs (loopback in its [board.options]), a plan is played in closed loop, where the "
    "host may be late"
)
AHEAD: Final = 0.1  # from now on, in which a new plan is made while the old one is played [s]
SWITCH: Final = 2e-4  # meanwhile, after so long another thread has its turn [s]
BESIDE: Final = 4  # updates before and after those that are converted, which may be looked at
SETTLED: Final = 2  # updates ahead of the next one, up to which a plan may have been looked at


@dataclass(frozen=True)
class Drives:
    """What the motors of a machine may do, and what their drives need to see.

    Parameters
    ----------
    rates, accelerations, jerks : (motors,) float
        The most that each motor may do [step/s, step/s^2, step/s^3].
    timing : DriveTiming
    limits : AxisLimits, optional
        What holds for a plan that is left in its middle; default is what holds for the motors.
    feedback : Feedback, optional
        Without it nobody notices that a motor did not follow.
    switches : LimitSwitches, optional
        Without it the emergency stop chain has to have them.
    """

    rates: Sequence[float]
    accelerations: Sequence[float]
    jerks: Sequence[float]
    timing: DriveTiming
    limits: AxisLimits | None = None
    feedback: Feedback | None = None
    switches: LimitSwitches | None = None


class Player(ABC):
    """A plan played on a board, and left on a ramp. `prepare` comes first.

    Ctrl-C and SIGTERM wait for the end of the commands that are being sent. Leaving the driver's
    ``with`` block, for whatever reason, calls `stop`.

    Parameters
    ----------
    driver
        Of the board; nothing else may use it while this plays, but for outputs.
    trajectory : Trajectory
        Motor positions [step].
    drives : Drives

    Attributes
    ----------
    trajectory : Trajectory
        What is played: after `stop`, with its way to rest.
    stopped_at : Stop or None
        What `stop` returned.
    """

    def __init__(self, driver: Any, trajectory: Trajectory, drives: Drives) -> None:
        self.driver, self.trajectory = driver, trajectory
        self.limits = drives.limits or AxisLimits.of_motors(drives.accelerations, drives.jerks)
        self.stopped_at: Stop | None = None
        self._interrupted: Callable[[], bool] = lambda: False

    def prepare(self) -> None:
        """Bring the board from any state to rest, ready to move.

        Raises
        ------
        PositionUnknownError
            If the motors may have lost steps before: reference the machine, and call the driver's
            ``reference``.
        MotionLimitError
            If the board cannot follow the motors' rates or accelerations with these pulses on this
            link.
        RegisterValueError, UsageError
            If a pulse time is more than the board can make, its profile cannot play plans, or the
            trajectory cannot be as it is, see `Trajectory.require_sound`.
        BusError, EstopError
            If there is no such board, the link fails, or emergency stop is not left.
        """
        self.driver.require_position()
        self.trajectory.require_sound()
        # what a stop needs is compiled now, and not when it is urgent
        hold(self.trajectory, self.trajectory.duration / 2, self.limits)
        self._prepare()
        self.driver.require_position()  # that may have halted something
        self.driver.begin_plan(self)

    def play(self, until: float) -> None:
        """Stream the plan up to ``until`` [s], and see that the board ran all the time.

        Raises
        ------
        EstopError
            If the board stopped, or its watchdog expired: the position is unknown.
        FollowingError, LimitSwitchError
            If a motor is not where it should be, or a limit switch is hit; see `Drives`.
        StarvedError
            If a board that buffers motion got none in time, and has stopped by itself.
        BusError
            If the link failed, or commands came late: the position is unknown.
        UsageError
            If the plan was left by `stop`.
        """
        if self.stopped_at is not None:
            raise UsageError(
                f"this plan was left at {self.stopped_at.time:.3f} s; play a new one from there"
            )
        with kept_back() as self._interrupted:
            try:
                self._play(until)
            except BaseException as error:
                self._lost(error)
                raise
        if self.done:
            self.driver.end_plan()

    def stop(self) -> Stop | None:
        """Leave the plan, and come to rest on its path within the machine's limits.

        Acceleration and jerk are those of `Drives`; the path is the plan's. The motors stay
        enabled, and the position is known, unless commands came late, before or now. Returns None
        if the plan was not under way.

        A second Ctrl-C meanwhile stops at once, by emergency stop.

        Raises
        ------
        EstopError, BusError
            If the board has stopped or the link failed; the position is unknown.
        """
        if not self.driver.plays(self):
            return self.stopped_at
        with kept_back() as self._interrupted:
            try:
                self.stopped_at = self._stop()
            except BaseException as error:
                self._lost(error)
                self.driver.end_plan()
                raise
            if self._interrupted():
                self.driver.estop()
        self.driver.end_plan()
        self.driver.stopped_at = self.stopped_at
        return self.stopped_at

    def change(self, replan: Callable[[float], Trajectory]) -> float | None:
        """Go on with another plan, from as soon as the board can leave the one it has.

        Parameters
        ----------
        replan : callable
            Gets the time of that [s]; returns a plan that is the same up to then, piece by piece.
            On links in real time it is called in another thread, while the old plan goes on, and
            again for a later time if it took too long. If it raises, the plan stays.

        Returns
        -------
        float or None
            That time [s]; None if the plan ends before, and stays.

        Raises
        ------
        UsageError
            If the plan is not under way: it has ended, or was left by `stop`.
        EstopError, BusError
            If the board has stopped or the link failed; the position is unknown.
        """
        if not self.driver.plays(self):
            raise UsageError("this plan is not under way: there is nothing to change")
        with kept_back() as self._interrupted:
            try:
                return self._change(replan)
            except (BusError, EstopError) as error:
                self._lost(error)
                raise

    def speed(self) -> float:
        """Return the highest commanded rate of a motor now [step/s]; 0 where it is not known."""
        return 0.0

    def _hold(self, time: float) -> tuple[Trajectory, float]:
        """Return the plan left at ``time`` [s], with its way to rest, and where that is."""
        return hold(self.trajectory, time, self.limits)

    def _change(self, replan: Callable[[float], Trajectory]) -> float | None:
        """Do what `change` says."""
        return self._leave(lambda time: (replan(time), time))

    def _lost(self, error: BaseException) -> None:
        """Note that an error has ended the motion, or that it is not as planned any more."""
        self.driver.lose_position()
        if not isinstance(error, LateError):
            self.driver.end_plan()

    @property
    @abstractmethod
    def update(self) -> float:
        """Time between commands [s]: two of them after a stop, every step of it has been made."""

    @property
    @abstractmethod
    def start_cycle(self) -> int:
        """Clock cycle of the plan's second 0."""

    @property
    @abstractmethod
    def done(self) -> bool:
        """Whether the whole plan has been played."""

    @property
    @abstractmethod
    def evidence(self) -> tuple[str, ...]:
        """What has been compared with the plan without error, by what the board tells."""

    @abstractmethod
    def _prepare(self) -> None:
        """Do what `prepare` says."""

    @abstractmethod
    def _play(self, until: float) -> None:
        """Do what `play` says; return early when interrupted."""

    @abstractmethod
    def _stop(self) -> Stop | None:
        """Do what `stop` says; return None, early, when interrupted."""

    @abstractmethod
    def _leave(self, replan: Replan) -> float | None:
        """Leave the plan as soon as possible for another one; return the time that came with it.

        None if the plan ends before.
        """


class PacedPlayer(Player):
    """A plan whose commands go out at their time, so that none may wait for a new plan.

    Parameters as `Player`.
    """

    @property
    @abstractmethod
    def free_from(self) -> float:
        """Time from which on the plan may be another one, if it is there at once [s]."""

    @abstractmethod
    def _follow(self, trajectory: Trajectory) -> None:
        """Go on with a plan that is the same up to `free_from`, piece by piece."""

    @property
    def _soon(self) -> float:
        """Time up to which to play before it is seen whether a new plan is made [s]."""
        return self.free_from

    def _leave(self, replan: Replan) -> float | None:
        if self.free_from >= self.trajectory.duration:
            return None
        trajectory, time = replan(self.free_from)
        self._follow(trajectory)
        return time

    def _change(self, replan: Callable[[float], Trajectory]) -> float | None:
        if not self.driver.bus.in_real_time:
            return super()._change(replan)
        ahead = AHEAD
        while (time := self.free_from + ahead) < self.trajectory.duration:
            made = self._meanwhile(partial(replan, time))
            if made is None:
                return None
            if self.free_from <= time:
                self._follow(made)
                return time
            ahead *= 2
        return None

    def _meanwhile(self, make: Callable[[], Trajectory]) -> Trajectory | None:
        """Play on while a plan is made; return that, or None when interrupted."""
        before = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH)
        try:
            made: Future[Trajectory] = Future()
            Thread(target=_fill, args=(made, make), daemon=True).start()
            while not made.done():
                if self._interrupted():
                    return None
                self._play(self._soon)
            return made.result()
        finally:
            sys.setswitchinterval(before)


class UpdateConverter(ABC, Generic[U]):
    """The updates of a plan in time: how many there are, when each acts, how many are converted.

    Parameters
    ----------
    trajectory : Trajectory
        Motor positions [step].
    board : str
        Its name, for errors.
    axes : int
        Motors that the board can drive.
    clock_hz : int
        Clock of the board [Hz].
    first_cycle : int
        Clock cycle of the first update. Time 0 of the plan is one update later.
    update_cycles : int
        Time between updates [cycle].

    Raises
    ------
    MotionLimitError
        If the plan has more motors than the board.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        *,
        board: str,
        axes: int,
        clock_hz: int,
        first_cycle: int,
        update_cycles: int,
    ) -> None:
        if trajectory.axes > axes:
            raise MotionLimitError(
                f"{board}: the plan has {trajectory.axes} motors, one board drives {axes}"
            )
        self.trajectory = trajectory
        self.update_cycles = update_cycles
        self.start_cycle = first_cycle + update_cycles
        self.position = 0
        self.way = np.zeros(trajectory.axes, np.int64)  # of each motor in the last update [step]
        self._clock_hz, self._first_cycle = clock_hz, first_cycle
        self.total = self._updates(trajectory)

    @property
    def free_from(self) -> float:
        """Time from which on the plan may be another one [s]; up to it, it may have been used."""
        cycle = self._first_cycle + (self.position + SETTLED) * self.update_cycles
        return max(self._seconds(cycle), 0.0)

    def follow(self, trajectory: Trajectory) -> None:
        """Go on with a plan that is the same up to `free_from`, piece by piece."""
        self.trajectory = trajectory
        self.total = self._updates(trajectory)

    @property
    def done(self) -> bool:
        """Whether the trajectory is converted to its end."""
        return self.position >= self.total

    def updates_until(self, time: float) -> int:
        """Return how many more updates reach ``time`` [s]; at the end of the plan, all."""
        if time >= self.trajectory.duration:
            return self.total - self.position
        cycle = math.ceil(time * self._clock_hz) + self.start_cycle
        reach = -(-(cycle - self._first_cycle) // self.update_cycles)
        return max(min(reach, self.total) - self.position, 0)

    @abstractmethod
    def convert(self, count: int) -> U:
        """Return the next ``count`` updates, fewer at the end."""

    @property
    def next_cycle(self) -> int:
        """Clock cycle of the next update."""
        return self._first_cycle + self.position * self.update_cycles

    @property
    @abstractmethod
    def count(self) -> NDArray[np.int64]:
        """Position of each motor after the updates converted so far [step], shape (motors,)."""

    def _updates(self, trajectory: Trajectory) -> int:
        """Return how many updates a plan takes."""
        duration = math.ceil(trajectory.duration * self._clock_hz)
        # one update before time 0, and three to see the last step out and rest
        return -(-duration // self.update_cycles) + 4

    def _next_cycles(self, count: int) -> NDArray[np.int64]:
        """Return the cycles of the next ``count`` updates, of fewer at the end."""
        n = max(min(count, self.total - self.position), 0)
        first, step = self.next_cycle, self.update_cycles
        return np.arange(first, first + n * step, step, dtype=np.int64)

    def _near(self, count: int) -> Trajectory:
        """Return what is the plan as far as the next ``count`` updates may look at it."""
        begin, end = self.next_cycle, self.next_cycle + count * self.update_cycles
        beside = BESIDE * self.update_cycles
        return self.trajectory.between(self._seconds(begin - beside), self._seconds(end + beside))

    def _note_way(self, before: NDArray[np.int64], counts: NDArray[np.int64]) -> None:
        """Keep how far the last update goes: ``counts`` (n, axes) follow ``before``."""
        if len(counts):
            ahead = counts[-2, : len(before)] if len(counts) > 1 else before
            self.way = np.abs(counts[-1, : len(before)] - ahead)

    def _seconds(self, cycle: int) -> float:
        """Return the time of the plan at a clock cycle [s]."""
        return (cycle - self.start_cycle) / self._clock_hz


class UpdatePlayer(PacedPlayer, Generic[U]):
    """A plan streamed to a board in portions. ``_prepare`` sets ``_converter``.

    Parameters as `Player`.
    """

    def __init__(self, driver: Any, trajectory: Trajectory, drives: Drives) -> None:
        super().__init__(driver, trajectory, drives)
        self._feedback, self._switches = drives.feedback, drives.switches
        self._converter: UpdateConverter[U] | None = None
        self._portion = PORTION
        self._looked = 0  # updates sent since the positions were looked at
        self._look_cycles = 0  # time that `_off` takes on this link

    _blame = "bytes on the way to the board were spoilt, or something else has moved it"

    def prepare(self) -> None:
        """Bring the board from any state to rest, ready to move; see `Player.prepare`.

        Raises
        ------
        UsageError
            Also if the link does not keep the times of updates.
        """
        if not self.driver.bus.exact:
            raise UsageError(
                f"{self.driver.registers.board}: this link carries out commands when the host gets "
                f"to them, not at their clock cycle, and a plan would lose its place by the "
                f"difference; {CLOSED}; without that it takes a link that keeps times: a simulated "
                f"or served board"
            )
        super().prepare()

    @property
    def converter(self) -> UpdateConverter[U]:
        """The conversion, its model and its position; after `prepare`."""
        if self._converter is None:
            raise RuntimeError("call prepare() first")
        return self._converter

    @property
    def update(self) -> float:
        """Time between updates [s]: two of them after a stop, every step of it has been made."""
        return self.converter.update_cycles / float(self.driver.bus.clock_hz)

    @property
    def start_cycle(self) -> int:
        """Clock cycle of the plan's second 0."""
        return self.converter.start_cycle

    @property
    def done(self) -> bool:
        """Whether the whole plan has been sent."""
        return self.converter.done

    @property
    def evidence(self) -> tuple[str, ...]:
        """What has been compared with the plan without error, by what the board tells."""
        ran = "the board was not stopped on the way"
        if self._off() is None:
            return (ran,)
        return (ran, "positions that the board tells, now and then, and at the end of the plan")

    def _lost(self, error: BaseException) -> None:
        super()._lost(error)
        if isinstance(error, LateError) and self.driver.bus.in_real_time:
            error.add_note(f"this computer was too late; {CLOSED}")

    def _play(self, until: float) -> None:
        left = self.converter.updates_until(until)
        watched = self._feedback is not None or self._switches is not None
        look = max(math.ceil((WATCH if watched else LOOK) / self.update), 1)
        while left > 0 and not self._interrupted():
            count = self._stream(min(left, look - self._looked))
            left -= count
            self._looked += count
            if self._looked == look:
                self._looked = 0
                self.check()
        self.check()

    def _stop(self) -> Stop | None:
        converter, end = self.converter, self.trajectory.duration
        time = self._leave(self._hold)
        while not converter.done:
            if self._interrupted():
                return None
            try:
                self._stream(converter.total)
            except LateError:  # a ramp that is not exact is better than none
                self.driver.lose_position()
        self.check()
        return Stop(end if time is None else time, tuple(converter.count.tolist()))

    @property
    def free_from(self) -> float:
        """Time from which on the plan may be another one, if it is there at once [s]."""
        return self.converter.free_from

    def _follow(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory
        self.converter.follow(trajectory)

    def check(self) -> None:
        """See that the board runs, no limit switch is hit, and motors are where they should be.

        In motion a motor may be off by the way of an update; and where the next one is due before
        the board could answer, positions are not looked at.

        Raises
        ------
        EstopError, BusError
            As `play`.
        LimitSwitchError, FollowingError
            If not.
        """
        self.driver.check_running()
        if self._switches is not None:
            check_switches(self.driver, self._switches)
        converter, bus = self.converter, self.driver.bus
        done = converter.done
        if not done and bus.now() + self._look_cycles > converter.next_cycle:
            return
        off = self._off()
        if off is None:
            return
        bounds = np.full(
            len(off), 0.5 if self._feedback is None else self._feedback.following_error
        )
        if not done:
            bounds += converter.way[: len(off)] + ROUNDING
        check_positions(self.driver.registers.board, off, bounds, self._blame)

    def _off(self) -> NDArray[np.float64] | None:
        """Return by how much each motor is off where the updates sent lead it [step], if known.

        Of the first motors; as the converter has them, when the next update takes effect.
        """
        return None

    def _measure(self, look: Callable[[], object]) -> None:
        """Note how long it takes on this link to look at the positions."""
        begin = self.driver.bus.now()
        look()
        self._look_cycles = self.driver.bus.now() - begin

    def _stream(self, most: int) -> int:
        """Convert and stream the next updates; return how many.

        They take the host little time, so that signals are seen soon: on links where they are sent
        at their time, and on others.
        """
        count, begin = min(most, self._portion), time.monotonic()
        try:
            self.driver.stream(self.converter.convert(count))
        finally:
            spent = time.monotonic() - begin
            if spent < QUICK and count == self._portion:
                self._portion *= 2
            elif spent > SLOW:
                self._portion = max(self._portion // 2, 1)
        return count


def _fill(future: Future[Trajectory], make: Callable[[], Trajectory]) -> None:
    """Give a future what ``make`` returns or raises."""
    try:
        future.set_result(make())
    except BaseException as error:  # raised again where the result is asked for
        future.set_exception(error)
