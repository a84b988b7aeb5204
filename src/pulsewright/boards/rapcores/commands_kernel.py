"""The compiled loop of `commands.Converter`."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.rapcores.registers import CLOCK_HZ
from pulsewright.motion.evaluate import position_at
from pulsewright.twin.kernel import inlined, kernel

SECONDS_PER_CYCLE: Final = 1.0 / CLOCK_HZ
FASTEST: Final = 0.999  # [step per tick]
CLEAR: Final = 1.0 / 1024  # what keeps from a crossing where the plan rests [step]
NOISE: Final = 1e-9  # of positions [step]
POSITION, FRACTION = 0, 1  # columns of the state

Ints = NDArray[np.int64]


@inlined
def goal(before: float, here: float, ahead: float) -> float:
    """Return where the accumulator should be [step].

    ``before``, ``here`` and ``ahead`` are where the plan is half a move earlier, now and later.
    """
    x = here + 0.5
    if before == here or here == ahead:  # at rest: keep clear of the crossings
        step = math.floor(x)
        x = min(max(x, step + CLEAR), step + 1 - CLEAR)
    return x


@inlined
def parabola(speed: float, bow: float, ticks: float) -> float:
    """Return how far a motor is after some ticks [step]."""
    return ticks * (speed + 0.5 * (ticks - 1.0) * bow)


@kernel
def convert(
    geometry: Any,
    law: Any,
    parameters: Ints,
    piece: int,
    state: Ints,
    increment: Ints,
    incinc: Ints,
    position: Ints,
    fraction: Ints,
) -> tuple[float, float, int, int, int]:
    """Fill the columns of moves; advance ``state``.

    Parameters
    ----------
    geometry, law
        The plan, as in `position_at`.
    parameters : (4,) int64
        Number of the first move, where 0 begins at time 0 of the plan; length of a move [tick] and
        of a tick [clock]; fraction bits.
    piece : int
        A piece of the plan at or before the first move.
    state : (motors, 2) int64
        Accumulator: step, and fraction.
    increment, incinc, position, fraction : (n, motors) int64
        As in `commands.Moves`.

    Returns
    -------
    tuple
        Largest distance of the plan from a parabola [step], highest rate [step per tick], the motor
        and the move of that distance, or of a rate above `FASTEST`, which ends the conversion, and
        a piece at or before the next move.
    """
    first, ticks, tick, bits = parameters
    n, unit = float(ticks), 2.0**bits
    top = np.int64((np.uint64(1) << np.uint64(bits)) - np.uint64(1))  # largest fraction
    pairs = np.uint64(ticks) * np.uint64(ticks - 1) // np.uint64(2)
    half = ticks * tick * SECONDS_PER_CYCLE / 2
    worst, fastest, motor, when = 0.0, 0.0, 0, 0
    following = piece
    for i in range(state.shape[0]):
        before, k = position_at(geometry, law, i, 2 * first * half, piece)
        middle, _ = position_at(geometry, law, i, (2 * first + 1) * half, k)
        for j in range(increment.shape[0]):
            h = 2 * (first + j)  # beginning of the move [half a move]
            early, _ = position_at(geometry, law, i, (h + 0.5) * half, k)
            late, k = position_at(geometry, law, i, (h + 1.5) * half, k)
            end, k = position_at(geometry, law, i, (h + 2) * half, k)
            later, _ = position_at(geometry, law, i, (h + 3) * half, k)

            step, rest = state[i, POSITION], state[i, FRACTION]
            target = goal(middle, end, later)
            target_step = math.floor(target)
            target_rest = np.int64((target - target_step) * unit)
            way = float(target_step - step) + (target_rest - rest) / unit  # [step]
            half_way = goal(before, middle, end) - step - rest / unit
            bow = 4.0 * (way - 2.0 * half_way) / (n * n)  # [step per tick^2]
            if min(way, 0.0) - NOISE <= half_way <= max(way, 0.0) + NOISE:  # it does not turn
                most = 2.0 * abs(way) / (n * (n - 1.0))
                bow = min(max(bow, -most), most)
            speed = way / n - 0.5 * (n - 1.0) * bow
            rate = max(abs(speed), abs(speed + (n - 1.0) * bow))
            fastest = max(fastest, rate)
            if rate > FASTEST:
                return worst, fastest, i, j, piece
            if first + j >= 0:  # before, there is no plan to follow
                here = step + rest / unit - 0.5
                bend = max(
                    abs(here + parabola(speed, bow, 0.25 * n) - early),
                    abs(here + parabola(speed, bow, 0.75 * n) - late),
                )
                if bend > worst:
                    worst, motor, when = bend, i, j

            # Floats are off by more than a unit, but what they leave is small: exact modulo 2^64.
            left = np.uint64(target_step - step) << np.uint64(bits)
            left += np.uint64(target_rest) - np.uint64(rest)
            v, c = np.int64(0), np.int64(0)
            if abs(way) * unit > n:  # more than rounding has left
                v, c = np.int64(speed * unit), np.int64(bow * unit)
                left -= np.uint64(v) * np.uint64(ticks) + np.uint64(c) * pairs
                more = (2 * np.int64(left) + ticks) // (2 * ticks)
                v += more
                left -= np.uint64(more) * np.uint64(ticks)
            missing = np.int64(left)  # [unit], n at most
            if missing > target_rest:
                target_step -= 1
                rest = target_rest - missing + top + 1
            elif -missing > top - target_rest:
                target_step += 1
                rest = target_rest - top - 1 - missing
            else:
                rest = target_rest - missing
            increment[j, i], incinc[j, i] = v, c
            state[i, POSITION] = position[j, i] = target_step
            state[i, FRACTION] = fraction[j, i] = rest
            before, middle = end, later
        following = k
    return worst, fastest, motor, when, following
