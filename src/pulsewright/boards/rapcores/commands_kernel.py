"""The compiled loops of `commands.Converter`."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.rapcores.commands import NEAR, QUARTERS
from pulsewright.compiled import inner
from pulsewright.motion.evaluate import sample
from pulsewright.twin.kernel import inlined, kernel

FASTEST: Final = 0.999  # [step per tick]
CLEAR: Final = 1.0 / 1024  # what keeps from a crossing where the plan rests [step]
NOISE: Final = 1e-9  # of positions [step]
POSITION, FRACTION = 0, 1  # columns of the state

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@inlined
def goal(plan: Floats, i: int, q: int) -> float:
    """Return where the accumulator of motor ``i`` should be at quarter ``q`` [step]."""
    x: float = plan[i, q] + 0.5
    if plan[i, q - 2] == plan[i, q] or plan[i, q] == plan[i, q + 2]:  # at rest
        step = math.floor(x)
        x = min(max(x, step + CLEAR), step + 1 - CLEAR)  # clear of the crossings
    return x


@inlined
def parabola(speed: float, bow: float, ticks: float) -> float:
    """Return how far a motor is after some ticks [step]."""
    return ticks * (speed + 0.5 * (ticks - 1.0) * bow)


@inlined
def straight(way: float, half_way: float) -> bool:
    """Tell whether the plan does not turn, as far as three points say."""
    return min(way, 0.0) - NOISE <= half_way <= max(way, 0.0) + NOISE


@inlined
def through(
    plan: Floats, i: int, q: int, here: float, length: int, n: float
) -> tuple[float, float, float, float]:
    """Return half and all of the way from ``here`` [step], and speed and bow of the parabola.

    The move takes ``length`` grid steps or ``n`` ticks from quarter ``q`` on; the speed is that of
    its first tick [step per tick], the bow the change of that from tick to tick.
    """
    half = QUARTERS // 2 * length
    way, half_way = goal(plan, i, q + 2 * half) - here, goal(plan, i, q + half) - here
    bow = 4.0 * (way - 2.0 * half_way) / (n * n)
    return half_way, way, way / n - 0.5 * (n - 1.0) * bow, bow


@inner
def fits(plan: Floats, q: int, here: Floats, length: int, ticks: int) -> bool:
    """Tell whether one move of some grid steps from quarter ``q`` on holds the plan of all motors.

    Every motor must rest all the time, or move all the time, and not turn where the plan does not.
    """
    n, points = float(ticks * length), QUARTERS * length
    for i in range(here.size):
        resting = 0
        for p in range(q, q + points):
            resting += plan[i, p] == plan[i, p + 1]
        half_way, way, speed, bow = through(plan, i, q, here[i], length, n)
        if resting:
            if resting < points or abs(way) > NOISE:
                return False
            continue
        last = speed + (n - 1.0) * bow
        if max(abs(speed), abs(last)) > FASTEST or (straight(way, half_way) and speed * last < 0):
            return False
        off = 0  # points: counting them all is faster than to leave at the first
        for p in range(1, points):
            x = here[i] - 0.5 + parabola(speed, bow, p * (n / points))
            off += abs(x - plan[i, q + p]) > NEAR
        if off:
            return False
    return True


@inner
def put(
    state: Ints, i: int, target: float, ticks: int, bits: int, speed: float, bow: float
) -> tuple[np.int64, np.int64]:
    """Bring an accumulator to ``target`` [step] as closely as a move can; return its increments.

    Floats are off by more than a unit, but what they leave is small, and so exact modulo 2^64.
    """
    unit = 2.0**bits
    top = np.int64((np.uint64(1) << np.uint64(bits)) - np.uint64(1))  # largest fraction
    pairs = np.uint64(ticks) * np.uint64(ticks - 1) // np.uint64(2)
    step, rest = state[i, POSITION], state[i, FRACTION]
    target_step = math.floor(target)
    target_rest = np.int64((target - target_step) * unit)
    left = np.uint64(target_step - step) << np.uint64(bits)
    left += np.uint64(target_rest) - np.uint64(rest)
    v, c = np.int64(0), np.int64(0)
    way = float(target_step - step) + (target_rest - rest) / unit
    if abs(way) * unit > ticks:  # more than rounding has left
        v, c = np.int64(speed * unit), np.int64(bow * unit)
        left -= np.uint64(v) * np.uint64(ticks) + np.uint64(c) * pairs
        more = (2 * np.int64(left) + ticks) // (2 * ticks)
        v += more
        left -= np.uint64(more) * np.uint64(ticks)
    missing = np.int64(left)  # [unit], ``ticks`` at most
    if missing > target_rest:
        target_step -= 1
        rest = target_rest - missing + top + 1
    elif -missing > top - target_rest:
        target_step += 1
        rest = target_rest - top - 1 - missing
    else:
        rest = target_rest - missing
    state[i, POSITION], state[i, FRACTION] = target_step, rest
    return v, c


@kernel
def convert(
    geometry: Any,
    law: Any,
    parameters: Ints,
    quarter: float,
    places: Floats,
    state: Ints,
    here: Floats,
    length: Ints,
    increment: Ints,
    incinc: Ints,
    position: Ints,
    fraction: Ints,
) -> tuple[int, int, float, float, int, int]:
    """Fill the columns of moves; advance ``state``.

    Parameters
    ----------
    geometry, law
        As of `sample`.
    parameters : (6,) int64
        Present grid point, where 0 is time 0; grid steps to convert, at least, and of the rest of
        the plan; most that a move may take; length of a grid step [tick]; fraction bits.
    quarter : float
        Of a grid step [s].
    places : (1 + motors, q) float64
        To work with: from `sample`, from half a grid step before the present grid point on.
    state : (motors, 2) int64
        Accumulator: step, and fraction.
    here : (motors,) float64
        To work with.
    length : (m,) int64
        Of each move [grid step].
    increment, incinc, position, fraction : (m, motors) int64
        As in `commands.Moves`.

    Returns
    -------
    tuple
        Moves, grid steps that they take, largest distance of the plan from a parabola [step],
        highest rate [step per tick], the motor and the grid step of that distance, or of a rate
        above `FASTEST`, which ends the conversion.
    """
    first, total, rest, longest, ticks, bits = parameters
    sample(geometry, law, 0, QUARTERS * first - QUARTERS // 2, 1, quarter, places)
    plan = places[1:]
    unit = 2.0**bits
    worst, fastest, motor, when = 0.0, 0.0, 0, 0
    used, at = 0, 0
    while at < total:
        q = QUARTERS // 2 + QUARTERS * at
        for i in range(here.size):
            here[i] = state[i, POSITION] + state[i, FRACTION] / unit
        size = longest if first + at >= 0 else 1
        while size > 1 and (size > rest - at or not fits(plan, q, here, size, ticks)):
            size //= 2
        n = float(size * ticks)
        for i in range(here.size):
            half_way, way, speed, bow = through(plan, i, q, here[i], size, n)
            if straight(way, half_way):
                most = 2.0 * abs(way) / (n * (n - 1.0))
                bow = min(max(bow, -most), most)
                speed = way / n - 0.5 * (n - 1.0) * bow
            rate = max(abs(speed), abs(speed + (n - 1.0) * bow))
            fastest = max(fastest, rate)
            if rate > FASTEST:
                return used, at, worst, fastest, i, at
            for p in range(1, QUARTERS * size, 2):
                x = here[i] - 0.5 + parabola(speed, bow, p * (n / (QUARTERS * size)))
                bend = abs(x - plan[i, q + p])
                if bend > worst and first + at >= 0:  # before, there is no plan to follow
                    worst, motor, when = bend, i, at
            target = goal(plan, i, q + QUARTERS * size)
            v, c = put(state, i, target, size * ticks, bits, speed, bow)
            increment[used, i], incinc[used, i] = v, c
            position[used, i], fraction[used, i] = state[i, POSITION], state[i, FRACTION]
        length[used] = size
        used += 1
        at += size
    return used, at, worst, fastest, motor, when
