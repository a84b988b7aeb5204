"""A trajectory played on a board: prepare it, stream it in portions, bring it to rest."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.playing import Drives, UpdatePlayer
from pulsewright.boards.pluto_step import registers as reg
from pulsewright.boards.pluto_step.burst import AXES
from pulsewright.boards.pluto_step.commands import Converter, PulseTiming, Updates
from pulsewright.boards.pluto_step.limits import units_per_step
from pulsewright.boards.servoing import ServoPlayer
from pulsewright.boards.watching import require_encoders, require_inputs
from pulsewright.errors import MotionLimitError, RegisterValueError

if TYPE_CHECKING:
    from pulsewright.boards.pluto_step.driver import PlutoStepDriver
    from pulsewright.edges.timing import DriveTiming
    from pulsewright.motion.trajectory import Trajectory

INPUTS: Final = reg.R_INPUTS_INPUTS_MASK.bit_count()
LEAD: Final = 625  # from the end of preparation to the first update [tick]
BLAME: Final = "bytes on the way to the board were spoilt, or something else has moved it"
TOLERANCE: Final = 0.5  # of positions in closed loop, beside what a late host explains [step]


def player(
    driver: PlutoStepDriver, trajectory: Trajectory, drives: Drives
) -> PlutoStepPlayer | PlutoStepServo:
    """Return what plays motor positions on a board: in closed loop, where the host may be late."""
    if driver.bus.in_real_time:
        return PlutoStepServo(driver, trajectory, drives)
    return PlutoStepPlayer(driver, trajectory, drives)


def _initialise(driver: PlutoStepDriver, timing: DriveTiming, rate: float) -> None:
    """Bring the board from any state to rest, with the times of the drives.

    Raises
    ------
    MotionLimitError
        If it cannot make ``rate`` with them [step/s].
    RegisterValueError
        If it cannot make one of them.
    """
    try:
        driver.initialise(
            step_time=timing.width,
            step_space=timing.space,
            # the hold time counts from the active edge; the board waits from the other one on
            direction_time=max(timing.setup, timing.hold - timing.width),
            max_rate=rate,
        )
    except RegisterValueError as error:
        raise MotionLimitError(str(error)) from error
    for what, (asked, real) in driver.clamped.items():
        raise RegisterValueError(
            f"pluto_step: the drive asks for a {what} of {asked * 1e6:g} us, the most the board "
            f"can do is {real * 1e6:g} us"
        )


class PlutoStepPlayer(UpdatePlayer[Updates]):
    """Play motor positions on a pluto-step board. Creating one sends nothing; see `prepare`.

    Parameters
    ----------
    driver : PlutoStepDriver
        Of the board; nothing else may use it while this plays.
    trajectory : Trajectory
        Motor positions [step].
    drives : Drives
    """

    def __init__(
        self,
        driver: PlutoStepDriver,
        trajectory: Trajectory,
        drives: Drives,
    ) -> None:
        super().__init__(driver, trajectory, drives)
        require_inputs("pluto_step", drives.switches, INPUTS)
        require_encoders("pluto_step", drives.feedback, 0)
        self.rate, self.acceleration = max(drives.rates), max(drives.accelerations)
        self._timing = drives.timing

    def _prepare(self) -> None:
        """Bring the board from any state to rest, with its watchdog on."""
        driver = self.driver
        _initialise(driver, self._timing, self.rate)
        driver.require_position()  # the board may just have told that it is unknown
        timing = PulseTiming(
            step=driver.step_ticks,
            space=driver.space_ticks,
            direction=driver.direction_ticks,
            tap=driver.tap,
            access=driver.bus.access_cycles,
        )
        update = timing.update_period(self.rate, self.acceleration)
        self._measure(driver.read_units)
        self._units = units = driver.read_units()
        driver.release_estop()
        first = (-(-driver.bus.now() // reg.TICK_CYCLES) + LEAD) * reg.TICK_CYCLES
        self._converter = Converter(
            self.trajectory, timing, units=units, first_cycle=first, update=update
        )
        self._begin = self._converter.units

    def _off(self) -> NDArray[np.float64]:
        """Compare the board's own positions, which it tells modulo 2^21 units."""
        converter = self.converter
        assert isinstance(converter, Converter)
        motors, span = self.trajectory.axes, reg.R_POSITION_VALUE_MASK + 1
        commanded = self._units[:motors] + converter.units - self._begin
        off = (self.driver.read_units()[:motors] - commanded + span // 2) % span - span // 2
        return np.asarray(off / units_per_step(self.driver.tap))


class PlutoStepServo(ServoPlayer):
    """Play motor positions on a pluto-step board in closed loop with its position registers.

    Parameters as `PlutoStepPlayer`.
    """

    _cause = BLAME

    def __init__(self, driver: PlutoStepDriver, trajectory: Trajectory, drives: Drives) -> None:
        super().__init__(driver, trajectory, drives, TOLERANCE)
        require_inputs("pluto_step", drives.switches, INPUTS)
        require_encoders("pluto_step", drives.feedback, 0)
        if trajectory.axes > AXES:
            raise MotionLimitError(
                f"pluto_step: the plan has {trajectory.axes} motors, one board drives {AXES}"
            )
        self._timing, self._zero = drives.timing, np.zeros(trajectory.axes)

    def _start(self) -> float:
        _initialise(self.driver, self._timing, float(self.rates.max()))
        # a whole step is in the middle between two crossings
        self._zero = np.floor(self.trajectory.at(0.0)[0] + 0.5) - 0.5
        return float(self.driver.max_step_rate())

    def _place(self) -> NDArray[np.float64]:
        return np.asarray(self._zero + self.driver.read_positions()[: len(self._zero)])
