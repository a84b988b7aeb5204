"""Planned motion to moves: what a RAPcores board runs natively.

A *move* lasts a number of ticks; in each of them the accumulator of every motor grows by an
increment, and the increment by another one: after n ticks the motor is at
p + n inc + n (n - 1) / 2 incinc, exactly. Moves follow each other without a gap; so a plan becomes
a chain of parabolas of all motors. They begin and end on a grid of time steps of length T.

The law: the parabola that starts where the model's accumulator is, passes the plan in the middle of
the move and ends at the plan. The increment is rounded last, such that the end is met to half a
unit per tick; the rest is in the model's accumulator, so nothing accumulates. A parabola is at most
0.038 a T^2 off a plan whose acceleration stays within +-a, and j T^3 / 125 off a jerk j; where that
is constant, neighbouring parabolas join without a jump of velocity. Where the plan allows, a move
takes two, four or eight grid steps: then the host has more time, and the link less to carry.

The board is at step floor(accumulator). The accumulator is half a step beyond the plan, so that a
step comes where the plan passes the middle between two positions. Rounding makes no step that the
plan does not make: where the plan rests, the accumulator keeps away from the crossings, on the
plan's side of them; parabolas do not turn where the plan does not; and a distance that is only
rounding makes no motion at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pulsewright.boards.rapcores import registers as reg
from pulsewright.errors import MotionLimitError
from pulsewright.motion.trajectory import Trajectory

LONGEST: Final = 8  # grid steps of a move, a power of 2
QUARTERS: Final = 4  # of a grid step: where the plan is looked at
DEVIATION: Final = 0.6  # what the conversion promises [step]: half a step of counting, and ...
BEND: Final = 0.04  # ... what the plan may leave a parabola,
NEAR: Final = 0.02  # ... as seen at quarters of the grid, in moves of several grid steps,
LATE: Final = 0.01  # ... wait for a change of direction,
JITTER: Final = 0.1  # ... and, half of it, move within a tick [step]
SHAPE: Final = 0.1  # a parabola, kept from turning, is so many a T^2 off an acceleration within +-a
MARGIN: Final = 1.25  # shortest grid step over what its messages take on the link
LONGEST_TICK: Final = 41  # [clock]: that of the board after reset
LONGEST_GRID: Final = 0.005  # [s]
SHOWN: Final = 3  # from a tick to the step pulse that it causes [clock]


@dataclass(frozen=True)
class PulseTiming:
    """What the pulse formers keep between edges [clock], each at least 1.

    Parameters
    ----------
    width, low : int
        Time the step pin is active, and at least inactive.
    setup : int
        From a change of direction to the next step.
    hold : int
        From the end of a step pulse to a change of direction.
    """

    width: int
    low: int
    setup: int
    hold: int

    @property
    def spacing(self) -> int:
        """Shortest time between two steps in one direction [clock]."""
        return self.width + self.low

    @property
    def reversal(self) -> int:
        """Shortest time between two steps in different directions [clock]."""
        return self.width + max(self.hold + self.setup, self.low)

    @property
    def max_rate(self) -> float:
        """Highest step rate that can be planned [step/s]: steps come up to a tick too early."""
        return reg.CLOCK_HZ / (self.spacing + 1)


def tick_period(timing: PulseTiming, rate: float) -> int:
    """Return how long a tick may be [clock], 1 .. `LONGEST_TICK`.

    No pulse former ever owes a step for the sake of spacing, and a motor makes at most `JITTER`
    steps per tick.

    Parameters
    ----------
    timing : PulseTiming
    rate : float
        The most that any motor does [step/s].

    Raises
    ------
    MotionLimitError
        If ``rate`` is more than the pulses allow.
    """
    if rate > timing.max_rate:
        us = 1e6 / reg.CLOCK_HZ
        raise MotionLimitError(
            f"rapcores: {rate:.0f} step/s asked; with {timing.spacing * us:g} us from step to step "
            f"the board follows a plan up to {timing.max_rate:.0f} step/s; lower the axis velocity "
            f"or the steps per mm, or shorten the drive's times"
        )
    period = reg.CLOCK_HZ / max(rate, 1.0)
    return max(1, min(LONGEST_TICK, int(JITTER * period), int(period - timing.spacing)))


def grid_ticks(
    timing: PulseTiming, *, tick: int, message_cycles: float, acceleration: float
) -> int:
    """Return the length of the grid steps of a job [tick], a multiple of 4.

    As long as the plan's acceleration allows: long moves need few messages, and let the host be
    late.

    Parameters
    ----------
    timing : PulseTiming
    tick : int
        Length of a tick [clock].
    message_cycles : float
        Time that the link takes for a move, and to ask whether there is room for it [clock].
    acceleration : float
        The most that any motor does [step/s^2].

    Raises
    ------
    MotionLimitError
        If the board cannot follow ``acceleration`` over this link or with these pulses.
    """
    shortest = MARGIN * message_cycles
    bend = reg.CLOCK_HZ * math.sqrt(BEND / (SHAPE * max(acceleration, 1.0)))
    us = 1e6 / reg.CLOCK_HZ
    if bend < shortest + QUARTERS * tick:
        most = BEND / SHAPE * (reg.CLOCK_HZ / (shortest + QUARTERS * tick)) ** 2
        raise MotionLimitError(
            f"rapcores: {acceleration:.3g} step/s^2 asked; this link carries a move each "
            f"{shortest * us:.0f} us, and such moves follow up to {most:.3g} step/s^2; lower the "
            f"axis acceleration or the steps per mm, or take a faster link or fewer motors"
        )
    late = reg.CLOCK_HZ * math.sqrt(2 * LATE / max(acceleration, 1.0))
    if timing.reversal > late:
        raise MotionLimitError(
            f"rapcores: a change of direction takes {timing.reversal * us:g} us with these pulses; "
            f"at {acceleration:.3g} step/s^2 allowed are {late * us:.3g} us; shorten the drive's "
            f"times or lower the axis acceleration"
        )
    return int(min(bend, LONGEST_GRID * reg.CLOCK_HZ) / tick) // QUARTERS * QUARTERS


@dataclass(frozen=True)
class Moves:
    """Native commands in columns: n moves of all motors of a plan, and where they lead.

    Parameters
    ----------
    duration : (n,) uint32
        [tick]
    increment : (n, motors) int64
        [2^-(W - 1) step per tick]
    incinc : (n, motors) int64
        Increment of the increment [2^-(W - 1) step per tick^2].
    position : (n, motors) int64
        Step that the board is at after each.
    fraction : (n, motors) int64
        What its accumulator has beyond that [2^-(W - 1) step].
    """

    duration: NDArray[np.uint32]
    increment: NDArray[np.int64]
    incinc: NDArray[np.int64]
    position: NDArray[np.int64]
    fraction: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.duration)


class Converter:
    """Convert a trajectory to moves, in portions of any size, with the exact integer model.

    Parameters
    ----------
    trajectory : Trajectory
        Motor positions [step].
    ticks : int
        Length of a grid step, from `grid_ticks` [tick].
    tick : int
        Length of a tick [clock].
    lead : int
        Grid steps before time 0 of the plan, at least 1.
    longest : int
        Grid steps that a move may take, a power of 2.
    word_bits : int
        Of the board's words, W: 64 or 32.
    position, fraction : (motors,) int, optional
        Accumulators: step of the plan's motors, and what is beyond it [2^-(W - 1) step]. Default:
        those of a board that was reset where the motors are at the start of the plan.
    at : int
        Grid steps of the job that are over already.

    Attributes
    ----------
    at : int
        Grid steps converted so far.
    total : int
        Grid steps of the job, to the end of the last step and some rest.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        *,
        ticks: int,
        tick: int,
        lead: int = 1,
        longest: int = LONGEST,
        word_bits: int = reg.WORD_BITS,
        position: ArrayLike | None = None,
        fraction: ArrayLike | None = None,
        at: int = 0,
    ) -> None:
        self.trajectory, self.ticks, self.tick = trajectory, ticks, tick
        self.lead, self.longest, self.word_bits = lead, longest, word_bits
        self.at = at
        # one more to see the last step out and rest
        self.total = lead + math.ceil(trajectory.duration / self.grid) + 1
        self._state = np.zeros((trajectory.axes, 2), np.int64)
        start = np.floor(trajectory.at(0.0)[0] + 0.5).astype(np.int64)
        self._state[:, 0] = start if position is None else position
        self._state[:, 1] = 0 if fraction is None else fraction

    @property
    def grid(self) -> float:
        """Length of a grid step [s]."""
        return self.ticks * self.tick / reg.CLOCK_HZ

    @property
    def done(self) -> bool:
        """Whether the trajectory is converted to its end."""
        return self.at >= self.total

    @property
    def position(self) -> NDArray[np.int64]:
        """Step that each motor is at after the moves converted so far, shape (motors,)."""
        return self._state[:, 0].copy()

    @property
    def fraction(self) -> NDArray[np.int64]:
        """What the accumulators have beyond that [2^-(W - 1) step], shape (motors,)."""
        return self._state[:, 1].copy()

    def start_cycle(self, first_tick: int) -> int:
        """Return the cycle of time 0 of a plan whose first tick is at cycle ``first_tick``.

        The tick after which the accumulator has to be where the plan is comes half a tick after a
        crossing on average, and `SHOWN` later the step is at the pins.
        """
        lead = (self.lead * self.ticks - 1) * self.tick
        return first_tick + lead + SHOWN + self.tick // 2

    def time(self, ticks: int) -> float:
        """Return the time of the plan after some ticks of the job [s]."""
        return (ticks - self.lead * self.ticks) * self.tick / reg.CLOCK_HZ

    def convert(self, steps: int) -> Moves:
        """Return the moves of at least the next ``steps`` grid steps, fewer at the end.

        Raises
        ------
        MotionLimitError
            If the board would be further than `DEVIATION` from the plan, or a motor would need more
            than a step per tick.
        """
        from pulsewright.boards.rapcores.commands_kernel import (  # numba: on first use only
            FASTEST,
            convert,
        )

        n = max(min(steps, self.total - self.at), 0)
        motors, first = self.trajectory.axes, self.at - self.lead
        # from half a quarter before the first point
        plan = self.trajectory.between(
            (first - 1) * self.grid, (first + n + self.longest + 1) * self.grid
        )
        length = np.zeros(n, np.int64)
        columns = [np.zeros((n, motors), np.int64) for _ in range(4)]
        rest = self.total - self.at
        used, converted, bend, rate, motor, when = convert(
            (plan.poly, plan.cosine, plan.sine, plan.omega),
            (plan.element, plan.start, plan.law),
            np.array([first, n, rest, self.longest, self.ticks, self.word_bits - 1], np.int64),
            self.grid / QUARTERS,
            np.empty((1 + motors, QUARTERS * (n + self.longest + 1) + 1)),
            self._state,
            np.empty(motors),
            length,
            *columns,
        )
        if rate > FASTEST or bend > BEND + LATE:
            what = f"misses the plan by {0.5 + bend:.2f} steps"
            if rate > FASTEST:
                what = f"needs {rate:.3g} steps per tick, the board makes one"
            raise MotionLimitError(
                f"rapcores motor {motor}: {what} at {max((first + when) * self.grid, 0.0):.4f} s; "
                f"lower the velocity or acceleration of its axis"
            )
        self.at += converted
        duration = (length[:used] * self.ticks).astype(np.uint32)
        return Moves(duration, *(column[:used] for column in columns))

    def finish(self) -> Moves:
        """Return the moves that end a job: back to whole steps, without a step.

        So accumulators are as after a reset, where the next job starts. They cannot be read.
        """
        whole, rest = np.divmod(self._state[:, 1], self.ticks)
        increment = np.stack([-whole, -rest])
        fraction = np.stack([rest, 0 * rest])
        self._state[:, 1] = 0
        position = np.broadcast_to(self.position, fraction.shape)
        duration = np.array([self.ticks, 1], np.uint32)
        return Moves(duration, increment, np.zeros_like(increment), position, fraction)
