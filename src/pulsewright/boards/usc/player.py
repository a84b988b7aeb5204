"""A trajectory played on a board: prepare it, stream it in portions, bring it to rest."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.playing import Drives, UpdatePlayer
from pulsewright.boards.usc import registers as reg
from pulsewright.boards.usc.burst import AXES
from pulsewright.boards.usc.commands import Converter, PulseTiming, Updates
from pulsewright.boards.watching import Feedback, require_encoders, require_inputs

if TYPE_CHECKING:
    from pulsewright.boards.usc.driver import UscDriver
    from pulsewright.motion.trajectory import Trajectory

INPUTS: Final = (reg.R_INPUTS_HIGH_INPUTS_MASK << 8 | reg.R_INPUTS_LOW_INPUTS_MASK).bit_count()
LEAD: Final = 1e-3  # from the end of preparation to the first update [s]


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
        timing = drives.timing
        self.pulse_width = max(timing.width, 1 / reg.TICK_HZ)
        self.pulse_space = timing.space
        # the hold time counts from the active edge; the board waits from the other one on
        self.setup_time = max(timing.setup, timing.hold - self.pulse_width, 1 / reg.TICK_HZ)

    def _prepare(self) -> None:
        """Bring the board from any state out of emergency stop, at rest."""
        driver = self.driver
        driver.initialise(pulse_width=self.pulse_width, setup_time=self.setup_time)
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

    _blame = (
        "steps were lost, an encoder does not count as it should, or bytes on the way to the board "
        "were spoilt"
    )

    def _off(self) -> NDArray[np.float64] | None:
        """Compare the encoders, which were 0 as the plan began."""
        if self._feedback is None:
            return None
        converter, scale = self.converter, np.asarray(self._feedback.counts_per_step, np.float64)
        assert isinstance(converter, Converter)
        measured = self.driver.read_encoders()[: len(scale)] / scale
        return np.asarray(measured - (converter.count - self._begin)[: len(scale)])
