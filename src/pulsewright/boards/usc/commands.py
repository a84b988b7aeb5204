"""Planned motion to divisors: what a Universal Stepper Controller runs natively.

The board divides 10 MHz by P ticks per axis; the host may set new divisors at any time, here every
*update*. A new divisor does not disturb the phase: the counter has counted E ticks since the last
step and goes on. The phase-exact law: a step is due when the plan passes the middle between two
positions; if n steps are due before the next update and the last of them T ticks from now, then
P = (E + T) / n. Whatever rounding did before is in E and in the count, so nothing accumulates.
Count and plan differ by half a step at most, plus what the plan bends within one update.

The model is integer and exact: it knows the tick of every pulse before the board makes it. It
holds because no command lets a pulse fall due while the board's pulse former would delay it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.playing import UpdateConverter
from pulsewright.boards.usc import registers
from pulsewright.boards.usc.burst import AXES, BURST_ACCESSES
from pulsewright.errors import MotionLimitError
from pulsewright.motion.trajectory import Trajectory

LONGEST_UPDATE: Final = 10_000  # [tick]: 1 ms, well within the watchdog's 10 ms
DEVIATION: Final = 1.1  # what the conversion promises [step]


@dataclass(frozen=True)
class PulseTiming:
    """What board and drive demand of step and direction, in ticks of the rate clock.

    Parameters
    ----------
    width, space : int
        Time the step pin is active, and at least inactive [tick].
    setup : int
        Time by which the board keeps direction changes and pulses apart [tick].
    div_offset : int
        The board's period is the divisor plus this (profile switch) [tick].
    access : int
        Time one bus access takes [clock cycle].
    """

    width: int
    space: int
    setup: int
    div_offset: int
    access: int

    @property
    def shortest_period(self) -> int:
        """Shortest time between two steps of one axis [tick]."""
        return max(self.width + self.space, 1 + self.div_offset)

    @property
    def shortest_update(self) -> int:
        """Shortest time between two updates [tick]: bus bursts and reversals must fit in."""
        burst = -(-BURST_ACCESSES * self.access // registers.TICK_CYCLES)
        return 2 * max(burst, self.width + 2 * self.setup)

    @property
    def max_rate(self) -> float:
        """Highest step rate that open-loop updates hold within `DEVIATION` [step/s].

        Periods are whole ticks. Over an update of U ticks a rounding of half a tick adds up to
        U / (2 P^2) steps, so U must not exceed P^2 / 2, nor fall below what the bus can do.
        """
        period = max(self.shortest_period, math.ceil(math.sqrt(2 * self.shortest_update)))
        return registers.TICK_HZ / period

    def update_period(self, rate: float, acceleration: float) -> int:
        """Return how often to write new divisors [tick].

        Parameters
        ----------
        rate, acceleration : float
            The most that any motor does [step/s, step/s^2].

        Raises
        ------
        MotionLimitError
            If ``rate`` or ``acceleration`` is more than updates can follow.
        """
        if rate > self.max_rate:
            raise MotionLimitError(
                f"usc: {rate:.0f} step/s asked, with these pulse timings (width {self.width}, "
                f"space {self.space}, setup {self.setup} ticks of 0.1 us) the board follows a plan "
                f"up to {self.max_rate:.0f} step/s; lower the axis velocity or the steps per mm, "
                f"or shorten the drive's pulse times"
            )
        period = registers.TICK_HZ / max(rate, 1.0)
        # within an update the plan departs from the constant rate by a U^2 / 8 [step]
        bend = registers.TICK_HZ * math.sqrt(0.8 / max(acceleration, 1.0))
        update = int(min(LONGEST_UPDATE, period * period / 2, bend))
        if update < self.shortest_update:
            if bend < self.shortest_update:
                raise MotionLimitError(
                    f"usc: {acceleration:.3g} step/s^2 asked, updates every "
                    f"{self.shortest_update / 10:g} us follow up to "
                    f"{0.8 * (registers.TICK_HZ / self.shortest_update) ** 2:.3g} step/s^2; lower "
                    f"the axis acceleration or the steps per mm"
                )
            update = self.shortest_update
        return update


@dataclass(frozen=True)
class Updates:
    """Native commands: n bursts of divisors and control bytes, with what they will do.

    Parameters
    ----------
    cycle : (n,) int64
        Clock cycle at which the address write of each burst acts.
    divisor : (n, 4) uint32
        Divisors, 1 .. 2^24 - 1.
    control : (n,) uint8
        Rate generator control: run and direction of all axes.
    count : (n, 4) int64
        Position of each motor [step] when the next update takes effect.
    """

    cycle: NDArray[np.int64]
    divisor: NDArray[np.uint32]
    control: NDArray[np.uint8]
    count: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.cycle)


class Converter(UpdateConverter[Updates]):
    """Convert a trajectory to updates, in portions of any size, with the exact integer model.

    The board must be out of estop, halted, with every direction bit 1 (positive) for at least the
    setup time, and its pulse timing must be ``timing``.

    Parameters
    ----------
    trajectory : Trajectory
        Motor positions [step], at most 4 motors.
    timing : PulseTiming
        Of board and drive.
    first_cycle : int
        Clock cycle of the first burst. Time 0 of the plan is one update later.
    update : int
        Time between updates [tick], from `PulseTiming.update_period`.
    """

    def __init__(
        self, trajectory: Trajectory, timing: PulseTiming, *, first_cycle: int, update: int
    ) -> None:
        super().__init__(
            trajectory,
            board="usc",
            axes=AXES,
            clock_hz=registers.CLOCK_HZ,
            first_cycle=first_cycle,
            update_cycles=update * registers.TICK_CYCLES,
        )
        self.timing = timing
        # phase base, last pulse and earliest settled pulse [tick]; count; direction; run
        self._state = np.zeros((trajectory.axes, 6), np.int64)
        self._state[:, 1] = -(1 << 40)  # no pulse yet
        self._state[:, 3] = np.floor(trajectory.at(0.0)[0] + 0.5)
        self._state[:, 4] = 1

    @property
    def count(self) -> NDArray[np.int64]:
        """Position of each motor after the updates converted so far [step], shape (motors,)."""
        return self._state[:, 3].copy()

    def convert(self, count: int) -> Updates:
        """Return the next ``count`` updates, fewer at the end.

        Raises
        ------
        MotionLimitError
            If the board would fall behind the plan by more than `DEVIATION` steps.
        """
        from pulsewright.boards.usc.commands_kernel import convert  # numba: on first use only

        cycle = self._next_cycles(count)
        n, before = len(cycle), self.count
        updates = Updates(
            cycle=cycle,
            divisor=np.full((n, AXES), (1 << 24) - 1, np.uint32),
            control=np.full(n, 0x55 << 2 * len(before) & 0xFF, np.uint8),
            count=np.zeros((n, AXES), np.int64),
        )
        plan, timing = self._near(n), self.timing
        behind, axis, when = convert(
            (plan.poly, plan.cosine, plan.sine, plan.omega),
            (plan.element, plan.start, plan.law),
            np.array(
                [
                    self.next_cycle,
                    self.start_cycle,
                    self.update_cycles,
                    timing.width,
                    timing.setup,
                    timing.shortest_period,
                    timing.div_offset,
                    timing.access,
                ],
                np.int64,
            ),
            self._state,
            np.empty((2, n + 2)),
            np.empty((4, n), np.int64),
            updates.divisor,
            updates.control,
            updates.count,
        )
        if behind > 0:
            seconds = self._seconds(int(cycle[when]))
            raise MotionLimitError(
                f"usc axis {axis}: falls {behind:.2f} steps behind the plan at {seconds:.4f} s; "
                f"lower the velocity or acceleration of that axis"
            )
        self.position += n
        self._note_way(before, updates.count)
        return updates
