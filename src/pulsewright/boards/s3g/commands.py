"""Planned motion to loads and program words: what an S3G board runs natively.

A *load* gives every channel a velocity for a number of acceleration steps, of equal length on the
whole job: the *grid*. The executor waits for the last of these steps, then loads again, six clocks
later each time; so loads follow each other by exact multiples of the grid, and the position of a
channel is a chain of straight lines that the model knows to the unit.

A velocity is a whole number of units per clock: 763 steps/s, and, over a grid step of 0.8 ms, 0.6
steps. The law: the velocity is what brings the position, which the model knows, closest to the plan
at the end of the load. What rounding missed before is in the position, so nothing accumulates: at
every point of the grid the position is within half a unit times the grid step of its goal. Where
the plan allows, a load stands for two, four or eight grid steps and saves words.

Acceleration, jerk and change of jerk stay 0: a unit of acceleration is a unit of velocity per grid
step, a million steps/s^2 and more than machines can do, so they could only dither as velocities do,
at the cost of words.

Positions of whole steps are half a step beyond a crossing, so that a step comes where the plan
passes the middle between two positions. The goal is the plan, but rounding makes no step that the
plan does not make: where the plan rests or turns close to such a middle, the position stays as far
from the crossing as rounding may be off, on the plan's side, so that the count is right; and it
never goes against the plan.

The pulse former loses a step that comes too early after the last one. In one direction none does,
for velocities are limited; where the plan reverses, the conversion looks one load ahead and rounds
such that none does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pulsewright.boards.s3g import registers as reg
from pulsewright.boards.s3g.pulses import PulseTiming
from pulsewright.boards.s3g.words import (
    FINISHED,
    NEXT_LOAD,
    RATE_UNIT,
    SET_POSITION,
    SET_PROFILE,
    SET_VELOCITY,
    VALUE,
    control,
    load_control,
    output,
)
from pulsewright.errors import MotionLimitError
from pulsewright.motion.trajectory import Trajectory

SHORTEST_GRID: Final = 12_500  # [clock]: finer ones cost words and improve little
LONGEST_GRID: Final = 64_000  # [clock]: half of it in units is just less than half a step
MARGIN: Final = 1.1  # time of the grid over time that its words take on the link
BEND: Final = 0.1  # what the plan may bend within a grid step [step]
DEVIATION: Final = 0.6  # what the conversion promises beyond the half step of counting [step]
LOAD_DELAY: Final = 6  # from the end of the last acceleration step to the next load [clock]
LONGEST: Final = 8  # grid steps of a load, a power of 2
PORTION: Final = 1 << 16  # pieces of a plan that are looked at together, for little memory

STEPS: Final = reg.W_ASG_CONTROL_STEPS_LIMIT_MASK | reg.W_ASG_CONTROL_RESET_STEPS_MASK
RESET_DT: Final = reg.W_ASG_CONTROL_RESET_DT_MASK
DT_LIMIT: Final = reg.W_ASG_CONTROL_DT_LIMIT_MASK


def max_rate(timing: PulseTiming) -> float:
    """Return the highest step rate that can be planned: a unit is for corrections [step/s]."""
    return (timing.limit - 1) * RATE_UNIT


def grid_step(
    timing: PulseTiming, *, motors: int, word_cycles: float, rate: float, acceleration: float
) -> int:
    """Return the grid step for a link [clock].

    It is so long that the link carries a load of all motors that move in each, and then some.

    Parameters
    ----------
    timing : PulseTiming
    motors : int
        That move at a time.
    word_cycles : float
        Time that the link takes for a program word [clock].
    rate, acceleration : float
        The most that any motor does [step/s, step/s^2].

    Raises
    ------
    MotionLimitError
        If ``rate`` or ``acceleration`` is more than the board can follow with these pulses on this
        link.
    """
    us = 1e6 / reg.CLOCK_HZ
    if rate > max_rate(timing):
        raise MotionLimitError(
            f"s3g: {rate:.0f} step/s asked; with {timing.spacing * us:g} us from step to step the "
            f"board follows a plan up to {max_rate(timing):.0f} step/s; lower the axis velocity or "
            f"the steps per mm, or shorten the drive's times"
        )
    words = motors + len(NEXT_LOAD)
    grid = max(SHORTEST_GRID, math.ceil(words * word_cycles * MARGIN))
    if grid > LONGEST_GRID:
        raise MotionLimitError(
            f"s3g: this link takes {grid * us:.0f} us for the {words} words of a load of {motors} "
            f"motors, allowed are {LONGEST_GRID * us:.0f} us; take profile 'robust', a higher baud "
            f"rate or fewer motors"
        )
    if timing.spacing > grid:
        raise MotionLimitError(
            f"s3g: {timing.spacing * us:g} us from step to step asked, allowed are "
            f"{grid * us:g} us; shorten the drive's times"
        )
    most = 8 * BEND * (reg.CLOCK_HZ / grid) ** 2
    if acceleration > most:
        raise MotionLimitError(
            f"s3g: {acceleration:.3g} step/s^2 asked, loads every {grid * us:.0f} us follow up to "
            f"{most:.3g} step/s^2; lower the axis acceleration or the steps per mm"
        )
    return grid


@dataclass(frozen=True)
class Abort:
    """How motion stops by itself where no load comes in time.

    Parameters
    ----------
    dt : int
        Length of an acceleration step of it [clock].
    deceleration : (motors,) int64
        [unit of velocity per acceleration step]
    """

    dt: int
    deceleration: NDArray[np.int64]

    @classmethod
    def of(cls, accelerations: Sequence[float], grid: int, *, latched: bool = False) -> Abort:
        """Return the abort that comes closest to what the motors may do, in whole units.

        Parameters
        ----------
        accelerations : sequence of float
            Most of each motor [step/s^2].
        grid : int
            Length of a grid step [clock].
        latched : bool
            Profile switch: in an abort, too, acceleration steps are as long as grid steps.
        """
        unit = reg.CLOCK_HZ * RATE_UNIT  # of velocity per clock [step/s^2]
        dt = grid if latched else max(grid, math.ceil(unit / max(min(accelerations), 1.0)))
        most = np.floor(np.asarray(accelerations) * dt / unit)
        return cls(dt, np.maximum(most, 1).astype(np.int64))

    def steps(self, velocity: NDArray[np.int64]) -> int:
        """Return after how many acceleration steps all motors rest."""
        return int((-(-abs(velocity) // self.deceleration)).max(initial=0)) + 1

    def way(self, velocity: NDArray[np.int64], grid: int) -> NDArray[np.int64]:
        """Return how far each motor goes after a load that none followed [unit].

        Velocity is constant for another grid step, but for the clocks in which the next load would
        have come, and then falls with every acceleration step of the abort.
        """
        v = velocity
        way = v * (grid - LOAD_DELAY)
        while v.any():
            before, v = v, np.sign(v) * np.maximum(abs(v) - self.deceleration, 0)
            way = way + (v + before) // 2 * self.dt
        return way


@dataclass(frozen=True)
class Segments:
    """Loads in columns.

    Parameters
    ----------
    steps : (n,) int64
        Length [grid step].
    velocity : (n, channels) int64
        [unit per clock]
    position : (n, channels) int64
        Where each channel is as the next one acts [unit of 2^-16 step].
    """

    steps: NDArray[np.int64]
    velocity: NDArray[np.int64]
    position: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.steps)

    def __getitem__(self, rows: slice) -> Segments:
        return Segments(self.steps[rows], self.velocity[rows], self.position[rows])

    def last_steps(self, at: int, grid: int) -> NDArray[np.int64]:
        """Return position [unit], cycle and sign of the last step of each channel, (channels, 3).

        The loads end at grid step ``at``, and cycles count from grid step 0. Where they make no
        step, the last one was long ago.
        """
        ends = (at - self.steps[::-1].cumsum()[::-1] + self.steps) * grid
        state = np.zeros((self.velocity.shape[1], 3), np.int64)
        state[:, 0], state[:, 1] = self.position[-1], -(1 << 40)
        for c, (v, x) in enumerate(zip(self.velocity.T, self.position.T, strict=True)):
            steps = np.flatnonzero(
                x // reg.STEP_UNITS != (x - v * self.steps * grid) // reg.STEP_UNITS
            )
            if len(steps):
                k = steps[-1]
                into = x[k] % reg.STEP_UNITS
                since = into // v[k] if v[k] > 0 else (reg.STEP_UNITS - 1 - into) // -v[k]
                state[c, 1:] = ends[k] - since, np.sign(v[k])
        return state


class Converter:
    """Convert a trajectory to loads, in portions of any size, with the exact integer model.

    Parameters
    ----------
    trajectory : Trajectory
        Motor positions [step].
    timing : PulseTiming
    grid : int
        Length of a grid step, from `PulseTiming.grid` [clock].
    position : (motors,) int, optional
        Where the channels are [unit]. Default: where the motors are at the start of the plan.
    before : Segments, optional
        Loads that the channels have made last, which lead to where they are.
    at : int
        Grid steps of the plan that are over already.

    Attributes
    ----------
    at : int
        Grid steps converted so far.
    total : int
        Grid steps of the plan, to the end of the last step and some rest.
    origin : (motors,) int64
        Positions at time 0 [unit].
    """

    def __init__(
        self,
        trajectory: Trajectory,
        timing: PulseTiming,
        *,
        grid: int,
        position: ArrayLike | None = None,
        before: Segments | None = None,
        at: int = 0,
    ) -> None:
        self.trajectory, self.timing, self.grid = trajectory, timing, grid
        self.at = at
        # two to see the last step out and rest
        self.total = math.ceil(trajectory.duration * reg.CLOCK_HZ / grid) + 2
        motors = trajectory.axes
        # position, cycle and sign of the last crossing
        self._state = np.zeros((motors, 3), np.int64)
        self._state[:, 0] = self._sample(0, 1)[1][0] if position is None else position
        self._state[:, 1] = -(1 << 40)  # long ago
        if before is not None:
            self._state = before.last_steps(at, grid)
        self.origin = self._state[:, 0].copy()

    @property
    def done(self) -> bool:
        """Whether the trajectory is converted to its end."""
        return self.at >= self.total

    @property
    def position(self) -> NDArray[np.int64]:
        """Where each channel is after the loads converted so far [unit]."""
        return self._state[:, 0].copy()

    def convert(self, steps: int) -> Segments:
        """Return loads for at least the next ``steps`` grid steps, fewer at the end.

        Raises
        ------
        MotionLimitError
            If the board would miss the plan by more than `DEVIATION` steps and the half step of
            counting.
        """
        from pulsewright.boards.s3g.commands_kernel import LOST, convert  # numba: on first use

        n = max(min(steps, self.total - self.at), 0)
        motors = self.trajectory.axes
        segments = Segments(
            np.zeros(n, np.int64), np.zeros((n, motors), np.int64), np.zeros((n, motors), np.int64)
        )
        plan, goals = self._sample(self.at, n + LONGEST + 1)
        used, converted, worst, motor, when = convert(
            plan,
            goals,
            np.array([self.at, n, self.grid, self.timing.limit, self.timing.spacing], np.int64),
            self._state,
            segments.steps,
            segments.velocity,
            segments.position,
        )
        if worst > DEVIATION * reg.STEP_UNITS:
            what = f"misses the plan by {worst / reg.STEP_UNITS:.2f} steps"
            if worst >= LOST:
                what = "reverses so fast that a step would be lost"
            raise MotionLimitError(
                f"s3g motor {motor}: {what} at {when * self.grid / reg.CLOCK_HZ:.4f} s; lower the "
                f"velocity or acceleration of its axis"
            )
        self.at += converted
        return Segments(segments.steps[:used], segments.velocity[:used], segments.position[:used])

    def _sample(self, first: int, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return plan and goals of the channels at points of the grid, (count, motors) [unit]."""
        from pulsewright.boards.s3g.commands_kernel import sample

        second = reg.CLOCK_HZ / self.grid  # [grid step]
        # from the point before the first one
        trajectory = self.trajectory.between((first - 2) / second, (first + count + 1) / second)
        plan = np.empty((count, trajectory.axes), np.int64)
        goals = np.empty_like(plan)
        sample(
            (trajectory.poly, trajectory.cosine, trajectory.sine, trajectory.omega),
            (trajectory.element, trajectory.start, trajectory.law),
            first,
            self.grid,
            np.empty((1 + trajectory.axes, count + 2)),
            plan,
            goals,
        )
        return plan, goals


def moving_together(trajectory: Trajectory) -> int:
    """Return how many motors move at the same time, at most; at least 1."""
    pieces, most = len(trajectory.element), 1
    for begin in range(0, pieces, PORTION):
        part = trajectory.part(begin, min(begin + PORTION, pieces))
        moves = (part.poly[:, 1:] != 0).any(axis=1)
        moves |= (part.cosine != 0) | (part.sine != 0)
        most = max(most, int(moves.sum(axis=1).max()))
    return most


@dataclass(frozen=True)
class Words:
    """Program words, and what loads are among them.

    Parameters
    ----------
    words : (n,) int64
    loads : (m,) int64
        Index of each word that loads.
    segments : Segments
        The m loads.
    """

    words: NDArray[np.int64]
    loads: NDArray[np.int64]
    segments: Segments


class Encoder:
    """Make program words of loads; a register is written where its value changes.

    Parameters
    ----------
    motors : int
        Channels that the job uses, from 0 on.
    grid : int
        Length of a grid step [clock].
    lead : int
        Grid steps from the first load to time 0 of the plan.
    abort : Abort
    """

    def __init__(self, motors: int, grid: int, lead: int, abort: Abort) -> None:
        self.motors, self.grid, self.lead, self.abort = motors, grid, lead, abort
        self._velocity = np.zeros(motors, np.int64)
        self._steps = lead

    def start(self, position: NDArray[np.int64], *, known: bool) -> Words:
        """Return the words of the first load: rest.

        It starts the grid and the counting of acceleration steps.

        Parameters
        ----------
        position : (motors,) int64
            Where the channels are [unit].
        known : bool
            The board knows where they are; otherwise it is told.
        """
        words = [output(reg.W_ASG_DT_VAL, self.grid), output(reg.W_ASG_STEPS_VAL, self.lead)]
        for c, x in enumerate(position.tolist()):
            values = {
                reg.W_V_VAL: 0,
                reg.W_A_VAL: 0,
                reg.W_J_VAL: 0,
                reg.W_JJ_VAL: 0,
                reg.W_ABORT_A_VAL: int(self.abort.deceleration[c]),
            }
            if not known:
                values |= {reg.W_X_VAL_LO: x, reg.W_X_VAL_HI: x >> 32}
            words += [output(registers[c], value) for registers, value in values.items()]
        what = SET_PROFILE if known else SET_PROFILE | SET_POSITION
        words += self._control(STEPS | DT_LIMIT | RESET_DT, what)
        words += NEXT_LOAD[1:]
        load = len(words) - 1
        # what an abort reads; loads without the bit for it leave the grid as it is
        words.append(output(reg.W_ASG_DT_VAL, self.abort.dt))
        words += self._control(STEPS, SET_VELOCITY)
        return self._single(words, load, self.lead, position)

    def go_on(self, segments: Segments) -> None:
        """Take the last of some loads for the one before the next."""
        self._steps, self._velocity = int(segments.steps[-1]), segments.velocity[-1].copy()

    def encode(self, segments: Segments) -> Words:
        """Return the words of the next loads."""
        n, motors = segments.velocity.shape
        values = np.concatenate([segments.steps[:, None], segments.velocity], axis=1)
        before = np.concatenate([[self._steps], self._velocity])
        changed = np.diff(values, axis=0, prepend=before[None]) != 0
        registers = np.array([reg.W_ASG_STEPS_VAL, *reg.W_V_VAL[:motors]])
        heads = reg.CLASS_OUTPUT << reg.PROG_CLASS_LSB | registers << reg.PROG_OPCODE_LSB
        table = np.empty((n, 1 + motors + len(NEXT_LOAD)), np.int64)
        table[:, : 1 + motors] = heads | values & VALUE
        table[:, 1 + motors :] = NEXT_LOAD
        kept = np.ones(table.shape, bool)
        kept[:, : 1 + motors] = changed
        if n:
            self.go_on(segments)
        return Words(table[kept], kept.sum(axis=1).cumsum() - 1, segments)

    def finish(self, position: NDArray[np.int64]) -> Words:
        """Return the words that end the job: rest at ``position`` [unit], without an abort."""
        words = [output(reg.W_V_VAL[c], 0) for c in range(self.motors)]
        words.append(output(reg.W_ASG_DT_VAL, 0))
        words += self._control(DT_LIMIT, SET_VELOCITY)
        words += NEXT_LOAD
        load = len(words) - 1
        words.append(control(reg.OP_DONE, FINISHED))
        return self._single(words, load, 0, position)

    def _single(
        self, words: list[int], load: int, steps: int, position: NDArray[np.int64]
    ) -> Words:
        """Return words with one load, at rest."""
        rest = Segments(np.array([steps]), np.zeros((1, self.motors), np.int64), position[None])
        return Words(np.array(words), np.array([load]), rest)

    def _control(self, bits: int, what: int) -> list[int]:
        """Return the words that write the control registers, see `load_control`."""
        values = load_control(bits, what, self.motors)
        return [output(register, value) for register, value in values.items()]
