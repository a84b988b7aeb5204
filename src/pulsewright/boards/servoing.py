"""Plans played in closed loop, on boards that take step rates as they come and tell positions.

The host's clock is the time of the plan. In every period the host reads where the motors are, and
sets the rates that the plan has from now on, and what brings the motors back to it. A host that is
late is late by some steps for some milliseconds; nothing accumulates, and the plan's end is exact.
"""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.driving import Stop
from pulsewright.boards.playing import ROUNDING, WATCH, Drives, PacedPlayer
from pulsewright.boards.watching import check_positions, check_switches
from pulsewright.errors import FollowingError, MotionLimitError

if TYPE_CHECKING:
    from pulsewright.motion.trajectory import Trajectory

PERIOD: Final = 1e-3  # of the loop [s]
SOON: Final = 2 * PERIOD  # a plan may be another one [s]
LEAD: Final = 0.02  # from its begin to time 0 of the plan [s]
GAIN: Final = 100.0  # rate for an error of a step [1/s]; watchdogs end times near 1 / GAIN
HEADROOM: Final = 1.25  # of a motor's rate, for corrections
SLOWEST: Final = 1.0  # lower rates are none [step/s]
LOOKS: Final = 2  # of which the first is taken whose time is known ...
SURE: Final = 5e-4  # ... up to this, either way [s]
THERE: Final = 0.4  # so far from where it rests a motor is there [step]
SETTLED: Final = 3  # periods in which all motors are there: the plan is done
SETTLING: Final = 1.0  # that a motor may take to get there [s]


class ServoPlayer(PacedPlayer):
    """Play motor positions in closed loop. Creating one sends nothing; see `prepare`.

    A room defines `_start`, `_place` and ``_cause``.

    Parameters
    ----------
    driver
        Of the board; nothing else may use it while this plays, but for outputs.
    trajectory : Trajectory
        Motor positions [step].
    drives : Drives
    following_error : float
        So far a motor may be from where it should be, at rest [step].

    Attributes
    ----------
    worst : (motors,) float64
        Largest magnitude of the following error so far [step].
    sleep : callable
        Lets time pass, as `time.sleep` does.
    """

    _cause: str
    _grain = 0.0  # error that the board cannot tell from none [step]

    def __init__(
        self, driver: Any, trajectory: Trajectory, drives: Drives, following_error: float
    ) -> None:
        super().__init__(driver, trajectory, drives)
        motors = trajectory.axes
        self.rates = np.asarray(drives.rates, np.float64)[:motors]
        self.sleep = time.sleep
        self.worst = np.zeros(motors)
        self._switches, self._allowed = drives.switches, following_error
        self._accelerations = np.asarray(drives.accelerations, np.float64)[:motors]
        self._fastest, self._lag = np.zeros(motors), np.zeros(motors)  # [step/s], [step]
        self._looked = 0.0  # time of the plan
        self._wanted, self._given = np.zeros(motors), np.zeros(motors)
        self._origin = self._next = self._watched = 0  # cycles
        self._begun = self._finished = False
        self._settled = 0

    @abstractmethod
    def _start(self) -> float:
        """Bring the board from any state to rest, with the motors at time 0 of the plan.

        Returns
        -------
        float
            The highest rate that board and drives allow [step/s].
        """

    @abstractmethod
    def _place(self) -> NDArray[np.float64]:
        """Return where the motors are, as the plan counts [step], shape (motors,)."""

    @property
    def update(self) -> float:
        """Time between rates [s]: two of them after a stop, every step of it has been made."""
        return PERIOD

    @property
    def start_cycle(self) -> int:
        """Time of the link at the plan's second 0, once `play` was called [cycle]."""
        return self._origin

    @property
    def done(self) -> bool:
        """Whether the motors are at the end of the plan, at rest."""
        return self._finished

    @property
    def evidence(self) -> tuple[str, ...]:
        """What was compared while this played."""
        worst = ", ".join(f"{error:.1f}" for error in self.worst)
        return (
            f"positions that the board tells, every millisecond: at most {worst} steps from the "
            f"plan, and at its end",
        )

    def speed(self) -> float:
        """Return the highest rate of a motor that was set [step/s]."""
        return float(abs(self._given).max())

    def _prepare(self) -> None:
        fastest = self._start()
        self.driver.require_position()  # the board may just have told that it is unknown
        if self.rates.max() > fastest:
            raise MotionLimitError(
                f"{self.driver.registers.board}: {self.rates.max():.0f} step/s asked, with these "
                f"pulses the board makes {fastest:.0f}; lower the axis velocity or the steps per "
                f"mm, or shorten the drive's pulse times"
            )
        self._fastest = np.minimum(HEADROOM * self.rates, fastest)
        self.driver.release_estop()

    def _begin(self) -> None:
        """Let time begin; the board may have been left alone for any time at rest."""
        if not self.driver.running:
            self.driver.release_estop()
            self.driver.begin_plan(self)
        self._begun, now = True, self.driver.bus.now()
        self._next = self._watched = now
        self._origin = now + round(LEAD * self.driver.bus.clock_hz)
        self._looked = self._time()

    def _play(self, until: float) -> None:
        if not self._begun:
            self._begin()
        until = until if until < self.trajectory.duration else math.inf
        while not self._finished and not self._interrupted():
            if self._period() >= until:
                return

    def _stop(self) -> Stop | None:
        end = self.trajectory.duration
        if not self._begun:
            return Stop(0.0, self._end())
        at = self._leave(self._hold)
        self._settled = 0
        while not self._finished:
            if self._interrupted():
                return None
            self._period()
        return Stop(end if at is None else min(at, end), self._end())

    @property
    def free_from(self) -> float:
        """Time from which on the plan may be another one, if it is there at once [s]."""
        return max(self._time() + SOON, 0.0) if self._begun else 0.0

    def _follow(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory

    def _end(self) -> tuple[int, ...]:
        """Return the steps at which what is played now ends."""
        return tuple(np.floor(self.trajectory.at(math.inf)[0] + 0.5).astype(int).tolist())

    def _time(self) -> float:
        """Return the present time of the plan [s]."""
        bus = self.driver.bus
        return float((bus.now() - self._origin) / bus.clock_hz)

    def _period(self) -> float:
        """Wait for the next period; compare, set rates; return the time of the plan [s]."""
        driver = self.driver
        self._wait()
        driver.check_running()
        self._watch()
        now, error, rates = self._look()
        known = np.sign(error) * np.maximum(abs(error) - self._grain, 0.0)
        rates += GAIN * known
        # what the board rounds off is in the next rates
        asked = np.clip(rates + self._wanted - self._given, -self._fastest, self._fastest)
        asked[(abs(asked) < SLOWEST) | (rates == 0)] = 0
        others = np.zeros(len(driver.step_rates()) - len(asked))
        driver.check_running()  # a board that has stopped by itself is not started by new rates
        given = driver.set_step_rates(np.concatenate([asked, others]))
        self._wanted, self._given = asked, np.array(given[: len(asked)])
        if now > self.trajectory.duration:
            self._settle(now, error)
        return now

    def _wait(self) -> None:
        """Sleep until the next period; periods that were missed are left out."""
        bus = self.driver.bus
        period = round(PERIOD * bus.clock_hz)
        ahead = self._next - bus.now()
        if ahead > 0:
            self.sleep(ahead / bus.clock_hz)
        self._next = max(self._next + period, bus.now())

    def _watch(self) -> None:
        """Look at the limit switches, now and then."""
        bus = self.driver.bus
        if self._switches is not None and bus.now() >= self._watched:
            self._watched = bus.now() + round(WATCH * bus.clock_hz)
            check_switches(self.driver, self._switches)

    def _look(self) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
        """Compare the motors with the plan.

        Where the plan stands still, a motor is to rest on the nearest step. Corrections of less
        than a step are slow, and would end in a step up to a second after it should be at rest.

        Returns
        -------
        float
            The time of the look [s].
        (motors,) float64
            Planned minus actual position, 0 for a motor that is where it rests [step].
        (motors,) float64
            Rates of the plan in the next period [step/s].

        Raises
        ------
        FollowingError
            If that is more than a late host explains.
        """
        for _ in range(LOOKS):
            before = self._time()
            place = self._place()
            doubt = (self._time() - before) / 2  # when exactly it was
            if doubt <= SURE:
                break
        now = before + doubt
        here, soon = self.trajectory.at(np.array([now, now + PERIOD]))
        still = here == soon
        error = np.where(still, np.floor(here + 0.5), here) - place
        self.worst = np.maximum(self.worst, abs(error))
        # rates were those of the last look all the time, and the loop takes time to make that good
        since, self._looked = now - self._looked, now
        late = max(since, 2 * PERIOD) + 2 * doubt
        speed = np.maximum(abs(self._given), abs(self.trajectory.at(now, 1)[0]))
        lag = late * speed + late * late * self._accelerations / 2
        self._lag = np.maximum(lag, self._lag * math.exp(-GAIN / 2 * since))
        bounds = self._allowed + ROUNDING + self._grain + self._lag
        if (abs(error) > bounds).any():
            self.driver.check_running()  # if it has stopped by itself, that is the cause
            check_positions(self.driver.registers.board, -error, bounds, self._cause)
        error[still & (abs(error) <= THERE)] = 0.0
        return now, error, (soon - here) / PERIOD

    def _settle(self, now: float, error: NDArray[np.float64]) -> None:
        """Note that the motors are at the end of the plan; that has to be so for some periods."""
        there = abs(error) <= self._grain
        resting = not self._given.any()
        self._settled = self._settled + 1 if there.all() and resting else 0
        self._finished = self._settled >= SETTLED
        if now > self.trajectory.duration + SETTLING and not self._finished:
            motor = int(np.argmax(abs(error)))
            raise FollowingError(
                f"{self.driver.registers.board} motor {motor}: is {-error[motor]:+.1f} steps from "
                f"the end of the plan, and does not get there in {SETTLING:g} s; {self._cause}. "
                f"Look for the cause, and reference the machine again"
            )
