"""A trajectory played on a board: prepare it, stream it in portions, bring it to rest."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.playing import Drives, UpdatePlayer
from pulsewright.boards.servoing import ServoPlayer
from pulsewright.boards.usc import registers as reg
from pulsewright.boards.usc.burst import AXES
from pulsewright.boards.usc.commands import Converter, PulseTiming, Updates
from pulsewright.boards.watching import Feedback, require_encoders, require_inputs
from pulsewright.errors import UsageError

if TYPE_CHECKING:
    from pulsewright.boards.usc.driver import UscDriver
    from pulsewright.edges.timing import DriveTiming
    from pulsewright.motion.trajectory import Trajectory

INPUTS: Final = (reg.R_INPUTS_HIGH_INPUTS_MASK << 8 | reg.R_INPUTS_LOW_INPUTS_MASK).bit_count()
LEAD: Final = 1e-3  # from the end of preparation to the first update [s]
BLAME: Final = (
    "steps were lost, an encoder does not count as it should, or bytes on the way to the board "
    "were spoilt"
)


def player(driver: UscDriver, trajectory: Trajectory, drives: Drives) -> UscPlayer | UscServo:
    """Return what plays motor positions on a USC: in closed loop, where the host may be late.

    Without encoders no loop can be closed.
    """
    closed = drives.feedback is not None or driver.switches["loopback"]
    if driver.bus.in_real_time and closed:
        return UscServo(driver, trajectory, drives)
    return UscPlayer(driver, trajectory, drives)


def _pulse_times(timing: DriveTiming) -> tuple[float, float]:
    """Return the pulse width and setup time that drives need of the board [s]."""
    width = max(timing.width, 1 / reg.TICK_HZ)
    # the hold time counts from the active edge; the board waits from the other one on
    return width, max(timing.setup, timing.hold - width, 1 / reg.TICK_HZ)


class UscPlayer(UpdatePlayer[Updates]):
    """Play motor positions on a USC. Creating one sends nothing; see `prepare`.

    Parameters
    ----------
    driver : UscDriver
        Of the board; nothing else may use it while this plays.
    trajectory : Trajectory
        Motor positions [step].
    drives : Drives
    """

    def __init__(
        self,
        driver: UscDriver,
        trajectory: Trajectory,
        drives: Drives,
    ) -> None:
        super().__init__(driver, trajectory, drives)
        require_inputs("usc", drives.switches, INPUTS)
        require_encoders("usc", drives.feedback, min(trajectory.axes, AXES))
        if driver.switches["loopback"] and self._feedback is None:  # then it counts its own steps
            self._feedback = Feedback((1.0,) * trajectory.axes, following_error=0.5)
        self.rate, self.acceleration = max(drives.rates), max(drives.accelerations)
        self.pulse_width, self.setup_time = _pulse_times(drives.timing)
        self.pulse_space = drives.timing.space

    def _prepare(self) -> None:
        """Bring the board from any state out of emergency stop, at rest."""
        driver = self.driver
        driver.initialise(pulse_width=self.pulse_width, setup_time=self.setup_time)
        driver.require_position()  # the board may just have told that it is unknown
        timing = PulseTiming(
            width=driver.width_ticks,
            space=max(driver.space_ticks, math.ceil(self.pulse_space * reg.TICK_HZ - 1e-6)),
            setup=driver.setup_ticks,
            div_offset=driver.div_offset,
            access=driver.bus.access_cycles,
        )
        update = timing.update_period(self.rate, self.acceleration)
        if self._feedback is not None:
            self._measure(driver.read_encoders)
        driver.release_estop()
        lead = math.ceil(LEAD * reg.TICK_HZ) * reg.TICK_CYCLES
        first = -(-driver.bus.now() // reg.TICK_CYCLES) * reg.TICK_CYCLES + lead
        self._converter = Converter(self.trajectory, timing, first_cycle=first, update=update)
        self._begin = self._converter.count

    _blame = BLAME

    def _off(self) -> NDArray[np.float64] | None:
        """Compare the encoders, which were 0 as the plan began."""
        if self._feedback is None:
            return None
        converter, scale = self.converter, np.asarray(self._feedback.counts_per_step, np.float64)
        assert isinstance(converter, Converter)
        measured = self.driver.read_encoders()[: len(scale)] / scale
        return np.asarray(measured - (converter.count - self._begin)[: len(scale)])


class UscServo(ServoPlayer):
    """Play motor positions on a USC in closed loop with its encoders; see `ServoPlayer`.

    Parameters
    ----------
    driver : UscDriver
        Of the board; nothing else may use it while this plays, but for outputs.
    trajectory : Trajectory
        Motor positions [step].
    drives : Drives
        With ``feedback`` of all motors; without it, steps have to count in the encoders, as they
        do with the board's switch ``loopback``.
    """

    _cause = BLAME

    def __init__(self, driver: UscDriver, trajectory: Trajectory, drives: Drives) -> None:
        motors = trajectory.axes
        feedback = drives.feedback or Feedback((1.0,) * motors, following_error=0.5)
        super().__init__(driver, trajectory, drives, feedback.following_error)
        require_inputs("usc", drives.switches, INPUTS)
        require_encoders("usc", feedback, min(motors, AXES))
        if len(feedback.counts_per_step) < motors:
            raise UsageError(
                f"usc: {len(feedback.counts_per_step)} encoders given for {motors} motors; on this "
                f"link a plan is played in closed loop, which takes one on each"
            )
        self._scale = np.asarray(feedback.counts_per_step, np.float64)
        self._grain = float(0.5 / abs(self._scale).min())
        self._timing, self._zero = drives.timing, np.zeros(motors)

    def _start(self) -> float:
        driver, (width, setup) = self.driver, _pulse_times(self._timing)
        driver.initialise(pulse_width=width, setup_time=setup)
        self._zero = np.floor(self.trajectory.at(0.0)[0] + 0.5)
        return float(min(driver.max_step_rate(), 1 / (width + self._timing.space)))

    def _place(self) -> NDArray[np.float64]:
        counts = self.driver.read_encoders()[: len(self._scale)]  # 0 as the plan began
        return np.asarray(self._zero + counts / self._scale)
