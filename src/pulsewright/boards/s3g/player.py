"""A trajectory played on a board: fill its program memory, keep it filled, bring it to rest."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.driving import Stop
from pulsewright.boards.playing import Drives, Player, Replan
from pulsewright.boards.s3g import registers as reg
from pulsewright.boards.s3g.commands import (
    LOAD_DELAY,
    Abort,
    Converter,
    Encoder,
    grid_step,
    moving_together,
)
from pulsewright.boards.s3g.packets import MAX_WORDS
from pulsewright.boards.s3g.ring import DONE, PORTION, ProgramRing
from pulsewright.boards.s3g.words import FINISHED
from pulsewright.boards.watching import require_encoders, require_inputs
from pulsewright.errors import (
    BusError,
    MotionLimitError,
    RegisterValueError,
    StarvedError,
    UsageError,
)
from pulsewright.motion.rejoin import rejoin

if TYPE_CHECKING:
    from pulsewright.boards.s3g.driver import S3GDriver
    from pulsewright.motion.trajectory import Trajectory

LEAD: Final = 0.2  # from the first load to time 0 of the plan: a failed start is ended before [s]
CONVERTED: Final = 4096  # grid steps at once
AHEAD: Final = 0.04  # of what is written, kept when the plan is left, beside some packets [s]
MAKING: Final = 0.5  # the same where the plan after it has to be made, in real time [s]
PACKETS: Final = 6  # those
NAP: Final = 0.05  # longest wait without a look at signals [s]
MEASURED: Final = 3  # packets, to learn how long they take
REFILL: Final = 8  # packets that should fit when a full memory is looked at again


class S3GPlayer(Player):
    """Play motor positions on an S3G board. Creating one sends nothing; see `prepare`.

    If the board gets no motion in time, it stops by itself, on a ramp; `play` raises `StarvedError`
    then, and knows where it stopped. `resume` goes back to the plan and completes it.

    `stop` replaces the words in program memory that the executor does not come to soon.

    Parameters
    ----------
    driver : S3GDriver
        Of the board; nothing else may use it while this plays, but for its outputs.
    trajectory : Trajectory
        Motor positions [step].
    drives : Drives
    """

    def __init__(
        self,
        driver: S3GDriver,
        trajectory: Trajectory,
        drives: Drives,
    ) -> None:
        super().__init__(driver, trajectory, drives)
        require_encoders("s3g", drives.feedback, 0)
        require_inputs("s3g", drives.switches, 0)
        self.rates, self.accelerations = drives.rates, drives.accelerations
        self.jerks = drives.jerks
        timing = drives.timing
        self._times = {
            "pulse_width": timing.width,
            "pulse_space": timing.space,
            "direction_setup": timing.setup,
            "direction_hold": timing.hold,
        }
        self._job: _Job | None = None
        self._stopped: StarvedError | None = None
        self._rest = np.zeros(trajectory.axes, np.int64)  # where it stopped [unit]

    def _prepare(self) -> None:
        """Bring the board from any state to rest, fill its memory, and start.

        The plan's time 0 is `LEAD` after that.
        """
        driver, motors = self.driver, self.trajectory.axes
        if motors > driver.channels:
            raise MotionLimitError(
                f"s3g: the plan has {motors} motors, the board has {driver.channels} channels"
            )
        try:
            driver.initialise(**self._times)
        except RegisterValueError as error:
            raise MotionLimitError(str(error)) from error
        driver.require_position()  # the board may just have told that it is unknown
        packet = self._measure()
        self._grid = grid_step(
            driver.timing,
            motors=moving_together(self.trajectory),
            word_cycles=packet / PORTION,
            rate=max(self.rates),
            acceleration=max(self.accelerations),
        )
        self._packet = packet
        driver.release_estop()
        self._begin(None)

    def resume(self) -> Trajectory:
        """Go back to the plan after `StarvedError`, and play the rest; return what is played now.

        That is a motion of its own, with its own time: from where the motors rest straight to where
        the plan was left, and on along the plan. `trajectory`, `start_cycle` and `play` are about
        it from now on.

        Raises
        ------
        UsageError
            If the job has not been stopped by that error.
        """
        if self._stopped is None:
            raise UsageError("s3g: nothing to resume; the job was not stopped for lack of motion")
        self.trajectory = rejoin(
            self.trajectory,
            self._stopped.time,
            self._stopped.position,
            rates=self.rates,
            accelerations=self.accelerations,
            jerks=self.jerks,
        )
        self._stopped = None
        self._begin(self._rest)
        self.driver.begin_plan(self)
        return self.trajectory

    @property
    def update(self) -> float:
        """Time between loads, at least [s]: two of them after a stop, each step has been made."""
        return self._grid / reg.CLOCK_HZ

    @property
    def start_cycle(self) -> int:
        """Clock cycle of the plan's second 0; exact on a link to a twin."""
        return self._playing.start_cycle

    @property
    def done(self) -> bool:
        """Whether the whole plan has been made."""
        return self._playing.ring.ended == FINISHED

    @property
    def evidence(self) -> tuple[str, ...]:
        """What has been compared with the plan without error, by what the board tells."""
        return (
            "answers of the board to all packets",
            "its word that its program ended where the plan does, and not for want of motion",
        )

    def _play(self, until: float) -> None:
        """Stream the plan, and return when the board is at ``until`` [s].

        Program memory is kept full, so the board knows motion up to about a second further. At the
        end of the plan everything has come to rest.
        """
        job, bus, ring = self._playing, self.driver.bus, self._playing.ring
        if self._stopped is not None:
            raise self._stopped
        end = math.inf
        if until < self.trajectory.duration:
            end = job.start_cycle + math.ceil(until * bus.clock_hz)
        while ring.ended is None:
            job.convert()
            left = end - bus.now()
            if left <= 0 or self._interrupted():
                return
            if not ring.waiting:
                self._sleep(min(left, max(job.end_cycle - bus.now(), self._packet)))
                ring.poll()
            elif not ring.ready:
                self._sleep(min(left, max(ring.cycles_to_room(REFILL), self._packet)))
                ring.poll()
            elif left <= self._packet:
                self._sleep(left)
            else:
                ring.write()
        if ring.ended != FINISHED:
            self._starved()
        self.driver.bus.sleep(self.update)  # the last pulse goes out

    def _stop(self) -> Stop | None:
        job, end = self._playing, self.trajectory.duration
        time = self._leave(self._hold)
        try:
            self._play(math.inf)
        except StarvedError as error:  # at rest all the same, on the ramp of the board
            place = np.floor(np.asarray(error.position) + 0.5)
            return Stop(error.time, tuple(place.astype(int).tolist()))
        if not self.done:
            return None
        position = tuple((job.converter.position // reg.STEP_UNITS).tolist())
        return Stop(end if time is None else time, position)

    def _leave(self, replan: Replan) -> float | None:
        return self._replaced(replan, AHEAD)

    def _change(self, replan: Callable[[float], Trajectory]) -> float | None:
        simulated = getattr(self.driver.bus, "twin", None) is not None
        ahead = AHEAD if simulated else MAKING
        return self._replaced(lambda time: (replan(time), time), ahead)

    def _replaced(self, replan: Replan, ahead: float) -> float | None:
        """Replace the words that are not given for ``ahead`` seconds and some packets."""
        job = self._playing
        try:
            return job.leave(replan, ahead)
        finally:
            self.trajectory = job.converter.trajectory

    def speed(self) -> float:
        """Return the highest commanded rate of a motor about now [step/s]."""
        job, bus = self._playing, self.driver.bus
        about = np.array([-1, 0, 1]) * self.update
        times = (bus.now() - job.start_cycle) / bus.clock_hz + about
        return float(abs(self.trajectory.at(times, 1)).max())

    def _lost(self, error: BaseException) -> None:
        if isinstance(error, StarvedError):  # it has stopped on a ramp
            self.driver.end_plan()
        else:
            super()._lost(error)

    @property
    def _playing(self) -> _Job:
        if self._job is None:
            raise RuntimeError("call prepare() first")
        return self._job

    def _measure(self) -> int:
        """Return how long a full packet takes on this link as a rule, with its reply [clock].

        Program memory is deep enough for a few that take longer.
        """
        bus = self.driver.bus
        taken: list[int] = []
        for _ in range(MEASURED):
            start = bus.now()
            self.driver.write_words(0, [DONE] * MAX_WORDS)
            taken.append(bus.now() - start)
        return sorted(taken)[MEASURED // 2]

    def _begin(self, position: NDArray[np.int64] | None) -> None:
        """Fill program memory and start; without a position the board is told where it is."""
        self._job = job = _Job(self, position)
        while True:
            job.convert()
            if not job.ring.ready:
                break
            job.ring.write()
        for attempt in range(self.driver.retries + 1):
            try:
                strobe = job.ring.start()
                break
            except BusError:
                self.driver.abort_program()  # before the first motion
                if attempt == self.driver.retries:
                    raise
        job.started(strobe)

    def _starved(self) -> None:
        """Wait until everything rests; tell where."""
        job, driver = self._playing, self.driver
        end, load = job.ring.last_load()
        velocity = load.velocity[0]
        steps = int(load.steps[0]) + job.encoder.abort.steps(velocity)
        longest = (int(load.steps[0]) + 1) * self._grid + steps * job.encoder.abort.dt
        limit = driver.bus.now() + 2 * longest
        while velocity.any() and driver.read_register("R_ASG_STEP")["value"] < steps:
            if driver.bus.now() > limit:
                raise BusError("s3g: the program ended, but motion does not stop as it should")
            self._sleep(job.encoder.abort.dt)
        self._rest = load.position[0] + job.encoder.abort.way(velocity, self._grid)
        time = max(end - job.encoder.lead, 0) * self._grid / reg.CLOCK_HZ
        place = (self._rest / reg.STEP_UNITS - 0.5).tolist()
        self._stopped = StarvedError(
            f"s3g: got no motion in time and has stopped by itself: the plan is done up to "
            f"{time:.3f} s, the motors rest at steps {', '.join(f'{p:.1f}' for p in place)}; "
            f"resume() goes back to the plan. The link or this computer was too slow; do less "
            f"beside, or take a higher baud rate",
            time=time,
            position=tuple(place),
        )
        raise self._stopped

    def _sleep(self, cycles: float) -> None:
        """Let time pass, until a signal comes."""
        left = max(cycles, 0) / self.driver.bus.clock_hz
        while left > NAP and not self._interrupted():
            self.driver.bus.sleep(NAP)
            left -= NAP
        self.driver.bus.sleep(0 if self._interrupted() else left)


class _Job:
    """One trajectory on its way: conversion, encoding, program memory."""

    def __init__(self, player: S3GPlayer, position: NDArray[np.int64] | None) -> None:
        driver, grid = player.driver, player._grid
        self.converter = Converter(player.trajectory, driver.timing, grid=grid, position=position)
        self._timing, self._packet = driver.timing, player._packet
        abort = Abort.of(
            player.accelerations, grid, latched=bool(driver.switches["abort_dt_latched"])
        )
        lead = math.ceil(LEAD * reg.CLOCK_HZ / grid)
        self.encoder = Encoder(player.trajectory.axes, grid, lead, abort)
        self.ring = ProgramRing(driver, grid=grid, packet_cycles=player._packet)
        self._first = self.encoder.start(self.converter.position, known=position is not None)
        self.ring.append(self._first)
        self._finished = False
        self._pre = driver.timing.pre
        self.start_cycle = self.end_cycle = 0

    def convert(self) -> None:
        """See that there are words for a packet, until the plan is at its end."""
        while self.ring.waiting < PORTION and not self._finished:
            self.ring.append(self.encoder.encode(self.converter.convert(CONVERTED)))
            if self.converter.done:
                self.ring.append(self.encoder.finish(self.converter.position))
                self._finished = True

    def leave(self, replan: Replan, ahead: float) -> float | None:
        """Leave the trajectory in ``ahead`` seconds and what the link takes; see `Player`."""
        plan, grid, lead = self.converter.trajectory, self.converter.grid, self.encoder.lead
        self.convert()
        soon = PACKETS * self._packet + round(ahead * reg.CLOCK_HZ)
        kept = self.ring.cut(soon, lead, lead + self.converter.total)
        if kept is None:
            return None
        end, loads = kept
        try:
            plan, time = replan(max((end - lead) * grid / reg.CLOCK_HZ, 0.0))
        finally:  # words are dropped already, and others have to take their place
            self.converter = Converter(
                plan,
                self._timing,
                grid=grid,
                position=loads.position[-1],
                before=loads,
                at=end - lead,
            )
            self.encoder.go_on(loads)
            self._finished = False
            self.end_cycle = self.start_cycle + self.converter.total * grid
        return time

    def started(self, strobe: int) -> None:
        """Learn the cycle of the start strobe."""
        grid, steps = self.encoder.grid, self.encoder.lead
        # two clocks an instruction; a load acts in the clock after its instruction, shows in the
        # next one; its steps show when the pulse former has waited for their direction
        load = strobe + 2 * int(self._first.loads[0]) + 3
        self.start_cycle = load + steps * grid + LOAD_DELAY + 1 + self._pre
        self.end_cycle = self.start_cycle + self.converter.total * grid
