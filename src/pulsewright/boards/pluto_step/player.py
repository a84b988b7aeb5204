"""A trajectory played on a board: prepare it, stream it in portions, bring it to rest."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.playing import Drives, UpdatePlayer
from pulsewright.boards.pluto_step import registers as reg
from pulsewright.boards.pluto_step.commands import Converter, PulseTiming, Updates
from pulsewright.boards.pluto_step.limits import units_per_step
from pulsewright.boards.watching import require_encoders, require_inputs
from pulsewright.errors import MotionLimitError, RegisterValueError

if TYPE_CHECKING:
    from pulsewright.boards.pluto_step.driver import PlutoStepDriver
    from pulsewright.motion.trajectory import Trajectory

INPUTS: Final = reg.R_INPUTS_INPUTS_MASK.bit_count()
LEAD: Final = 625  # from the end of preparation to the first update [tick]


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
        timing = drives.timing
        self.pulse_width, self.pulse_space = timing.width, timing.space
        # the hold time counts from the active edge; the board waits from the other one on
        self.direction_time = max(timing.setup, timing.hold - timing.width)

    def _prepare(self) -> None:
        """Bring the board from any state to rest, with its watchdog on."""
        driver = self.driver
        try:
            driver.initialise(
                step_time=self.pulse_width,
                step_space=self.pulse_space,
                direction_time=self.direction_time,
                max_rate=self.rate,
            )
        except RegisterValueError as error:
            raise MotionLimitError(str(error)) from error
        for what, (asked, real) in driver.clamped.items():
            raise RegisterValueError(
                f"pluto_step: the drive asks for a {what} of {asked * 1e6:g} us, the most the "
                f"board can do is {real * 1e6:g} us"
            )
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
