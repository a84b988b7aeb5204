"""What converting and playing a plan by updates at even times takes, whatever the board."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from pulsewright.edges.timing import DriveTiming
from pulsewright.errors import MotionLimitError

if TYPE_CHECKING:
    from pulsewright.motion.trajectory import Trajectory

U = TypeVar("U")  # updates: native commands in columns, of one board


@dataclass(frozen=True)
class Drives:
    """What the motors of a machine may do, and what their drives need to see.

    Parameters
    ----------
    rates, accelerations, jerks : (motors,) float
        The most that each motor may do [step/s, step/s^2, step/s^3].
    timing : DriveTiming
    """

    rates: Sequence[float]
    accelerations: Sequence[float]
    jerks: Sequence[float]
    timing: DriveTiming


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
        self._clock_hz, self._first_cycle = clock_hz, first_cycle
        duration = math.ceil(trajectory.duration * clock_hz)
        # one update before time 0, and three to see the last step out and rest
        self.total = -(-duration // update_cycles) + 4

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

    def _next_cycles(self, count: int) -> NDArray[np.int64]:
        """Return the cycles of the next ``count`` updates, of fewer at the end."""
        n = max(min(count, self.total - self.position), 0)
        numbers = self.position + np.arange(n, dtype=np.int64)
        return self._first_cycle + numbers * self.update_cycles

    def _seconds(self, cycle: int) -> float:
        """Return the time of the plan at a clock cycle [s]."""
        return (cycle - self.start_cycle) / self._clock_hz


class UpdatePlayer(ABC, Generic[U]):
    """A plan streamed to a board in portions. `prepare` comes first and sets ``_converter``.

    Parameters
    ----------
    driver
        Of the board; nothing else may use it while this plays.
    trajectory : Trajectory
        Motor positions [step].
    """

    def __init__(self, driver: Any, trajectory: Trajectory) -> None:
        self.driver = driver
        self.trajectory = trajectory
        self._converter: UpdateConverter[U] | None = None

    @abstractmethod
    def prepare(self) -> None:
        """Bring the board from any state to rest, ready to move."""

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

    def play(self, until: float) -> None:
        """Stream the plan up to ``until`` [s], and see that the board ran all the time.

        Raises
        ------
        EstopError
            If the board stopped, or its watchdog expired: the position is lost.
        BusError
            If the link failed.
        """
        self.driver.stream(self.converter.convert(self.converter.updates_until(until)))
        self.driver.check_running()
