"""Refined speeds: what a cell says of its limits, against the law itself."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pulsewright.app.bench_plan import bench_machine, measured
from pulsewright.compiled import compiled
from pulsewright.motion import refine
from pulsewright.motion.cell_law import Cells
from pulsewright.motion.cells import cells
from pulsewright.motion.gcode import interpret_text
from pulsewright.motion.path import Elements, Limits

SPEED, ACCELERATION, JERK = (np.array(x) for x in ([90.0, 80], [2000.0, 3000], [3e5, 2e5]))
BEGIN, SIZE, SPLIT = 0.05, 0.25, 0.45  # of the cell on its element, and of its two pieces


def element(seed):
    """Return a cubic of about unit speed, turned by some angle, in X and Y."""
    random = np.random.default_rng(seed)
    angle = random.uniform(0, 2 * math.pi)
    poly = np.zeros((1, 4, 6))
    poly[0, 1, :2] = math.cos(angle), math.sin(angle)
    poly[0, 2, :2] = random.normal(0, 1.2, 2)
    poly[0, 3, :2] = random.normal(0, 1.2, 2)
    return poly


def states(seed):
    """Return speeds and accelerations at the ends of the cell."""
    random = np.random.default_rng(100 + seed)
    v0, v1 = random.uniform(12, 30) + random.uniform(-2, 2, 2)
    return v0, v1, *random.normal(0, 500, 2)


@compiled(error_model="numpy")
def cell_of(
    path: Elements, limits: Limits, cells: Cells, split, b, a, room: float, parts: int
) -> tuple:
    """Return what a cell finds: its columns, time, the derivatives of that, and limits near by."""
    w = refine.window_of(limits.velocity.size)
    cell, terms = w.cell[0], w.terms[0]
    refine._prepare(cell, terms, path, limits, cells, split, 0)
    if parts > 0:
        cell[refine.PARTS] = parts
    for k in range(3):
        cell[refine.ROOM + k] = room
    law = refine._law(cell[refine.SIZE], cell[refine.SPLIT], b[0], a[0], b[1], a[1], True)
    listed = refine._limits(cell, terms, w.hold[0], w.near, 0, law, True, False, False)
    near = w.near[:listed].copy()
    for k in range(listed):  # what jerks are compared with is a constant to a step
        if near[k, 7] > 3 and near[k, 7] % 2 == 0:
            near[k, :5] /= law.vm
    return cell.copy(), law.time, law.of_time, near


def found(poly, b, a, *, room=0.0, parts=0):
    """Return the same for a part of a cubic."""
    zero, one = np.zeros(1), np.ones(1)
    path = Elements(
        *(poly, np.zeros((1, 6)), np.zeros((1, 6)), zero, one, np.zeros(1, np.int32), zero),
        feed=np.array([1e3]),
        rest=np.ones(1, np.bool_),
    )
    limits = Limits(
        *(np.eye(2, 6), np.arange(2), np.arange(1, 3), SPEED, ACCELERATION, JERK),
        *(1 / SPEED, 1 / ACCELERATION, 1 / JERK),
    )
    whole = cells(path, limits, 0.0)
    part = Cells(
        *(np.zeros(1, np.int64), np.array([BEGIN]), np.array([SIZE]), np.ones(1, np.bool_)),
        *(np.zeros(1, np.int64), whole.share[whole.row[:1]], np.array([2])),
    )
    return cell_of(path, limits, part, np.array([SPLIT]), b, a, room, parts)


def sampled(poly, v0, v1, a0, a1):
    """Return time and largest shares of acceleration and jerk of the law, at many places.

    Its two pieces of constant jerk are found from the ends: with the first lasting ``SPLIT`` of the
    time T, and a the acceleration where they meet, the speed grows by
    (SPLIT a0 + a + (1 - SPLIT) a1) T / 2, and both pieces together are ``SIZE`` long.
    """

    def way(time):
        middle = 2 * (v1 - v0) / time - SPLIT * a0 - (1 - SPLIT) * a1
        t0, t1 = SPLIT * time, (1 - SPLIT) * time
        j0, j1 = (middle - a0) / t0, (a1 - middle) / t1
        vm = v0 + (a0 + middle) * t0 / 2
        first = v0 * t0 + a0 * t0**2 / 2 + j0 * t0**3 / 6
        whole = first + vm * t1 + middle * t1**2 / 2 + j1 * t1**3 / 6
        return whole, ((0.0, v0, a0, j0, t0), (first, vm, middle, j1, t1))

    low, high = 0.1 * SIZE / max(v0, v1), 3 * SIZE / min(v0, v1)
    for _ in range(200):
        time = (low + high) / 2
        low, high = (time, high) if way(time)[0] < SIZE else (low, time)
    most = np.zeros(2)
    for x, begin, rate, j, span in way(time)[1]:
        t = np.linspace(0, span, 2001)[:, None]
        s = BEGIN + x + begin * t + rate * t**2 / 2 + j * t**3 / 6
        v, a = begin + rate * t + j * t**2 / 2, rate + j * t
        first = poly[0, 1, :2] + 2 * poly[0, 2, :2] * s + 3 * poly[0, 3, :2] * s**2
        second, third = 2 * poly[0, 2, :2] + 6 * poly[0, 3, :2] * s, 6 * poly[0, 3, :2]
        acceleration = second * v**2 + first * a
        jerk = third * v**3 + 3 * second * v * a + first * j
        shares = (abs(acceleration) / ACCELERATION).max(), (abs(jerk) / JERK).max()
        most = np.maximum(most, shares)
    return time, *most


@pytest.mark.parametrize("seed", range(40))
def test_no_limit_is_used_more_than_a_cell_says(seed):
    poly, (v0, v1, a0, a1) = element(seed), states(seed)
    time, acceleration, jerk = sampled(poly, v0, v1, a0, a1)
    b, a = np.array([v0, v1]) ** 2, np.array([a0, a1])
    cell, seconds, _, _ = found(poly, b, a)
    assert seconds == pytest.approx(time, rel=1e-9)
    worst = max(acceleration, jerk)
    assert worst <= cell[refine.USED] * (1 + 1e-9)
    assert cell[refine.USED] <= 1.6 * worst  # about what is used, not any bound


@pytest.mark.parametrize("seed", range(0, 400, 40))
def test_between_places_there_may_be_more(seed):
    """Where the law is known at three times only, what is added has to be enough."""
    added = 0
    for k in range(seed, seed + 40):
        poly, (v0, v1, a0, a1) = element(k), states(k)
        if k % 2:  # from a low speed on, with next to no jerk
            v0 *= 0.2
            a0 = a1 = (v1**2 - v0**2) / (2 * SIZE) + a0 / 50
        elif k % 4:  # the acceleration falls: on a parabola, the jerk is largest on the way
            poly[0, 3] = 0.0
            v0, a0, a1 = v0 * 0.6, 2500.0, 400.0
            v1 = math.sqrt(v0**2 + SIZE * (a0 + a1))
        _, *worst = sampled(poly, v0, v1, a0, a1)
        b, a = np.array([v0, v1]) ** 2, np.array([a0, a1])
        cell = found(poly, b, a, parts=1)[0]
        assert max(worst) <= cell[refine.USED] * (1 + 1e-9)
        added += cell[refine.USED] - cell[refine.FREE + 2] < max(worst)
    assert added > 0


@pytest.mark.parametrize("seed", range(20))
def test_derivatives_are_those_of_time_and_limits(seed):
    poly, (v0, v1, a0, a1) = element(seed), states(seed)
    b, a, compared = np.array([v0, v1]) ** 2, np.array([a0, a1]), 0
    _, _, of_time, listed = found(poly, b, a, room=0.5)
    for k, step in enumerate((1e-3, 1e-2, 1e-3, 1e-2)):
        times, rooms = [], []
        for way in (-1, 1):
            near_b, near_a = b.copy(), a.copy()
            (near_b if k % 2 == 0 else near_a)[k // 2] += way * step
            _, seconds, _, near = found(poly, near_b, near_a, room=0.5)
            times.append(seconds)
            rooms.append({int(entry[7]): entry[0] for entry in near})
        slope = (times[1] - times[0]) / (2 * step)
        assert of_time[k] == pytest.approx(slope, rel=1e-4, abs=1e-10)
        largest = max(abs(listed[:, 1 + k]))
        for entry in listed:
            if entry[7] in rooms[0] and entry[7] in rooms[1]:
                slope = (rooms[1][entry[7]] - rooms[0][entry[7]]) / (2 * step)
                assert entry[1 + k] == pytest.approx(slope, rel=1e-3, abs=1e-4 * largest)
                compared += 1
    assert compared >= 40


@pytest.mark.parametrize(("jerk", "most"), [(1e6, 1.08), (3e5, 1.53)])
def test_noisy_paths_are_driven_near_the_optimum(jerk, most):
    """Without refinement, they take 1.2 and 1.8 times the second-order optimum."""
    for seed in range(3):
        walk = np.random.default_rng(seed).normal(0, 0.3, (60, 2)).cumsum(axis=0)
        text = "".join(f"G1 X{x:.6f} Y{y:.6f}\n" for x, y in walk)
        moves = interpret_text(f"G64 P0.02\nF12000\n{text}").moves
        result = measured(moves, bench_machine(jerk))  # with its certificate
        assert result.time <= most * result.second
