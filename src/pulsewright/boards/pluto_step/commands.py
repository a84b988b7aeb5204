"""Planned motion to velocity words: what a pluto-step board runs natively.

The board adds a velocity word to a position at every tick and steps where the position crosses a
multiple of one step. The host may write new words at any time, here every *update*. The law: the
word is what brings the position, which the model knows exactly, to the plan at the next update.
Whatever rounding did before is in the position, so nothing accumulates. A word is rounded to whole
units per tick, so the position misses the plan by half an update at most: U / 2 units of the
2048 x 2^tap in a step, 0.16 steps at tap 0 and 1 kHz, 0.02 steps at tap 3.

Positions of whole steps are half a step beyond a crossing, so that a step comes where the plan
passes the middle between two positions. Where the plan rests close to such a middle, the position
rests as far from the crossing as rounding may be off, on the plan's side: the count is right.

The model is integer and exact. It knows for how many ticks a change of direction freezes the
position, and it holds because no word lets steps come closer than the pulses allow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pulsewright.boards.playing import UpdateConverter
from pulsewright.boards.pluto_step import registers
from pulsewright.boards.pluto_step.burst import AXES, BURST_ACCESSES
from pulsewright.boards.pluto_step.limits import units_per_step, velocity_limit
from pulsewright.errors import MotionLimitError
from pulsewright.motion.trajectory import Trajectory

LONGEST_UPDATE: Final = 625  # [tick]: 1 ms, well within the watchdog's 6.4 ms
DEVIATION: Final = 0.2  # what the conversion promises beyond the half step of the grid [step]
BEND: Final = 0.1  # what the plan may bend within one update [step]


@dataclass(frozen=True)
class PulseTiming:
    """Pulse timing of board and drive, in ticks of 1.6 us.

    Parameters
    ----------
    step, space : int
        Time the step pin is active, and at least inactive [tick].
    direction : int
        Time from the end of a step to a direction change; two more from that to the next step
        [tick].
    tap : int
        Speed range of the board, 0..3.
    access : int
        Time one bus access takes [clock cycle].
    """

    step: int
    space: int
    direction: int
    tap: int
    access: int

    @property
    def limit(self) -> int:
        """Largest velocity word."""
        return velocity_limit(self.tap, self.step, self.space)

    @property
    def longest_freeze(self) -> int:
        """Most ticks for which a change of direction stops the position."""
        return 2 * self.step + 2 * self.direction + 1

    @property
    def shortest_update(self) -> int:
        """Shortest time between two updates [tick]: bus bursts and reversals must fit in."""
        burst = -(-BURST_ACCESSES * self.access // registers.TICK_CYCLES)
        return 2 * max(burst, self.longest_freeze)

    @property
    def max_rate(self) -> float:
        """Highest step rate that can be planned: one velocity word is for corrections [step/s]."""
        return (self.limit - 1) * registers.TICK_HZ / units_per_step(self.tap)

    def update_period(self, rate: float, acceleration: float) -> int:
        """Return how often to write new velocities [tick].

        Parameters
        ----------
        rate, acceleration : float
            The most that any motor does [step/s, step/s^2].

        Raises
        ------
        MotionLimitError
            If ``rate`` or ``acceleration`` is more than updates can follow.
        """
        us = 1e6 / registers.TICK_HZ
        if rate > self.max_rate:
            raise MotionLimitError(
                f"pluto_step: {rate:.0f} step/s asked, with steps of {self.step * us:g} + "
                f"{self.space * us:g} us in speed range {self.tap} the board follows a plan up to "
                f"{self.max_rate:.0f} step/s; lower the axis velocity or the steps per mm, or "
                f"shorten the drive's pulse times"
            )
        # within an update the plan departs from the constant rate by a U^2 / 8 [step]
        bend = registers.TICK_HZ * math.sqrt(8 * BEND / max(acceleration, 1.0))
        update = min(LONGEST_UPDATE, int(bend))
        if update < self.shortest_update:
            most = 8 * BEND * (registers.TICK_HZ / self.shortest_update) ** 2
            raise MotionLimitError(
                f"pluto_step: {acceleration:.3g} step/s^2 asked, updates every "
                f"{self.shortest_update * us:g} us follow up to {most:.3g} step/s^2; lower the "
                f"axis acceleration or the steps per mm"
            )
        return update


@dataclass(frozen=True)
class Updates:
    """Native commands: n bursts of velocity words, with what they will do.

    Parameters
    ----------
    cycle : (n,) int64
        Clock cycle at which the address write of each burst acts.
    velocity : (n, 4) int16
        Velocity words.
    count : (n, 4) int64
        Position of each motor [step] when the next update takes effect.
    """

    cycle: NDArray[np.int64]
    velocity: NDArray[np.int16]
    count: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.cycle)


class Converter(UpdateConverter[Updates]):
    """Convert a trajectory to updates, in portions of any size, with the exact integer model.

    The board must be at rest with every velocity 0 and every direction positive for longer than
    any reversal takes, and its pulse timing must be ``timing``.

    Parameters
    ----------
    trajectory : Trajectory
        Motor positions [step], at most 4 motors.
    timing : PulseTiming
        Of board and drive.
    units : (4,) int
        Position registers of the board [2^-(11 + tap) step].
    first_cycle : int
        Clock cycle of the first burst. Time 0 of the plan is one update later.
    update : int
        Time between updates [tick], from `PulseTiming.update_period`.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        timing: PulseTiming,
        *,
        units: ArrayLike,
        first_cycle: int,
        update: int,
    ) -> None:
        super().__init__(
            trajectory,
            board="pluto_step",
            axes=AXES,
            clock_hz=registers.CLOCK_HZ,
            first_cycle=first_cycle,
            update_cycles=update * registers.TICK_CYCLES,
        )
        self.timing = timing
        motors = trajectory.axes
        unit = units_per_step(timing.tap)
        into = np.asarray(units, np.int64)[:motors] % unit
        # position [unit], direction; last crossing: tick, how far before its end, at which speed
        self._state = np.zeros((motors, 5), np.int64)
        self._state[:, 0] = np.floor(trajectory.at(0.0)[0] + 0.5).astype(np.int64) * unit + into
        self._state[:, 1] = 1
        self._state[:, 2] = -(1 << 40)  # long ago
        self._state[:, 4] = 1

    @property
    def count(self) -> NDArray[np.int64]:
        """Position of each motor after the updates converted so far [step], shape (motors,)."""
        return self._state[:, 0] // units_per_step(self.timing.tap)

    @property
    def units(self) -> NDArray[np.int64]:
        """The same in units of the board's registers, whose zero is the plan's, shape (motors,)."""
        return self._state[:, 0].copy()

    def convert(self, count: int) -> Updates:
        """Return the next ``count`` updates, fewer at the end.

        Raises
        ------
        MotionLimitError
            If the board would miss the plan by more than `DEVIATION` steps and the half step of the
            grid.
        """
        from pulsewright.boards.pluto_step.commands_kernel import convert  # numba: on first use

        cycle = self._next_cycles(count)
        n, before = len(cycle), self.count
        updates = Updates(cycle, np.zeros((n, AXES), np.int16), np.zeros((n, AXES), np.int64))
        plan, timing = self._near(n), self.timing
        missed, axis, when = convert(
            (plan.poly, plan.cosine, plan.sine, plan.omega),
            (plan.element, plan.start, plan.law),
            np.array(
                [
                    self.next_cycle,
                    self.start_cycle,
                    self.update_cycles // registers.TICK_CYCLES,
                    timing.step,
                    timing.direction,
                    timing.limit,
                    units_per_step(timing.tap).bit_length() - 1,  # a power of 2
                    timing.access,
                ],
                np.int64,
            ),
            self._state,
            np.empty((1 + len(before), n + 1)),
            updates.velocity,
            updates.count,
        )
        if missed > 0:
            seconds = self._seconds(int(cycle[when]))
            raise MotionLimitError(
                f"pluto_step axis {axis}: misses the plan by {missed:.2f} steps at "
                f"{seconds:.4f} s; lower the velocity or acceleration of that axis"
            )
        self.position += n
        self._note_way(before, updates.count)
        return updates
