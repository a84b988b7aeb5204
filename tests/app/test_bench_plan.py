"""The yardstick of planned times, against hand arithmetic."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pulsewright.app import bench_plan
from pulsewright.app.bench_optimum import bound, optimum
from pulsewright.motion.gcode import interpret_text
from pulsewright.motion.plan import blended_path

MACHINE = bench_plan.bench_machine(1e6)  # 200 mm/s, 3000 mm/s^2 along each axis


def least(text, parts=bench_plan.PARTS):
    return optimum(*blended_path(interpret_text(text).moves, MACHINE), parts)


@pytest.mark.parametrize(
    ("text", "time"),
    [
        ("G1 F3000 X100", 100 / 50 + 50 / 3000),
        ("G0 X100", 100 / 200 + 200 / 3000),
        ("G0 X3", 2 * math.sqrt(3 / 3000)),  # too short for 200 mm/s
        ("G1 F3000 X100\nG4 P0.5\nG1 X0", 0.5 + 2 * (100 / 50 + 50 / 3000)),
        ("G61.1\nG1 F3000 X100\nY100", 2 * (100 / 50 + 50 / 3000)),
        # from 50 to 20 mm/s on the first 100 mm
        ("G1 F3000 X100\nF1200 X200", 2 + 5 + 50 / 6000 + 30**2 / (2 * 3000 * 50) + 20 / 6000),
    ],
)
def test_the_optimum_of_simple_programs(text, time):
    assert least(text) == pytest.approx(time, rel=1e-5)


def test_on_a_circle_one_axis_at_a_time_uses_its_acceleration():
    # Let phi be the angle from where an axis reverses. In an octant from there, what matters is
    # the other reversal, behind or ahead of it: with X at its limit from phi = 0 on, where its
    # velocity is 0, v^2 sin^2(phi) = 2 A R (1 - cos(phi)), so v^2 = 2 A R / (1 + cos(phi)).
    # An octant takes v_x / A then, 2 sqrt(R / A) sin(pi / 8). At 45 degrees v is 132 mm/s.
    octant = 2 * math.sqrt(5 / 3000) * math.sin(math.pi / 8)
    # From rest, Y is at its limit: v_y^2 = 2 A R sin(phi). X follows as v_x = v_y tan(phi), with
    # an acceleration of A (3 tan(phi) + 2 tan(phi)^3); that is A at tan(phi) = 0.313.
    begin = math.atan(np.roots([2, 0, 3, -1])[-1].real)
    y = math.sqrt(2 * 3000 * 5 * math.sin(begin))
    x = y * math.tan(begin)

    # From there on X is at its limit, until Y has to slow down to its reversal at 90 degrees.
    def excess(phi):
        square = (x**2 + 2 * 3000 * 5 * (math.cos(begin) - math.cos(phi))) / math.sin(phi) ** 2
        return square - 2 * 3000 * 5 / (1 + math.sin(phi))

    low, high = math.pi / 8, math.pi / 2
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) < 0 else (low, middle)
    square = 2 * 3000 * 5 / (1 + math.sin(low))
    first = (y + math.sqrt(square) * (math.sin(low) + math.cos(low)) - x) / 3000
    assert least("F12000\nG2 X0 Y0 I5 J0", 256) == pytest.approx(2 * first + 4 * octant, rel=1e-4)


def test_to_the_middle_of_a_corner_one_axis_slows_down_with_all_its_acceleration():
    # X then Y, blended over l of each: x' = 1 - s^2 / (2 l^2), in the middle 1/2; x'' = -s / l^2,
    # there -1 / l; y is its mirror image. The middle is l / 6 away from the corner in X and Y.
    # There X slows down and Y speeds up by A, which needs b = A l, so v_x^2 = A l / 4. Before it,
    # x'' b and x' a add up to -A, while y'' b and y' a, of different signs, are less than A.
    size = 6 * 0.1 / math.sqrt(2)
    slow = math.sqrt(3000 * size) / 2
    peak = math.sqrt(3000 * (2 - size / 6) + slow**2 / 2)
    time = 2 * (2 * peak - slow) / 3000
    assert least("G64 P0.1\nF12000\nG1 X2\nY2") == pytest.approx(time, rel=1e-5)


@pytest.mark.parametrize("seed", [0, 1, 5, 7, 10])  # 7 has slow reversals
def test_the_optimum_of_a_walk_is_that_of_reachable_speeds(seed):
    walk = np.random.default_rng(seed).normal(0, 0.3, (8, 2)).cumsum(axis=0)
    path, _ = blended_path(interpret_text(lines(walk)).moves, MACHINE)
    assert 1 - 2e-4 <= least(lines(walk)) / reachable(path) <= 1 + 1e-4


def reachable(path, cells=400):
    """Return the time by passes of the most controllable and the fastest speeds, lines only.

    Limits of velocity, of both axes and of feed, and of acceleration hold in the middle of cells.
    """
    sizes, shapes = [], []
    for poly, length in zip(path.poly, path.length, strict=True):
        s = (np.arange(cells) + 0.5)[:, None] * length / cells
        slope = poly[1] + (2 * poly[2] + 3 * poly[3] * s) * s
        sizes += [length / cells] * cells
        shapes += zip(slope[:, :2], 2 * poly[2, :2] + 6 * poly[3, :2] * s, strict=True)

    def interval(n):  # lower and upper bounds of b after n, both as sums of c0 + c1 times b before
        (slope, bend), size = shapes[n], sizes[n]
        after, before = bend / 2 + slope / (2 * size), bend / 2 - slope / (2 * size)
        sign = np.where(after < 0, -1.0, 1.0)
        after, before = sign * after + 1e-12, sign * before
        return (-3000 - 0 * after) / after, 3000 / after, -before / after

    count = len(sizes)
    most = np.array([min(200.0 / abs(slope).max(), 200.0) ** 2 for slope, _ in shapes])
    top = np.concatenate([[0.0], np.minimum(most[1:], most[:-1]), [0.0]])
    top[cells * (np.flatnonzero(path.rest) + 1)] = 0.0
    for n in range(count - 1, -1, -1):
        low, high, share = interval(n)
        low, high = np.append(low, 0.0), np.append(high, top[n + 1])
        share = np.append(share, 0.0)
        # low_i + share_i b <= high_j + share_j b
        room, steep = high[None] - low[:, None], share[:, None] - share[None]
        with np.errstate(divide="ignore", invalid="ignore"):
            top[n] = min(top[n], np.where(steep > 0, room / steep, np.inf).min())
    time, b = 0.0, 0.0
    for n in range(count):
        _, high, share = interval(n)
        after = min(top[n + 1], (high + share * b).min())
        time += 2 * sizes[n] / (math.sqrt(b) + math.sqrt(after))
        b = after
    return time


def test_a_plan_takes_the_rise_of_its_acceleration_longer():
    moves = interpret_text("G1 F3000 X100").moves
    result = bench_plan.measured(moves, MACHINE)
    best = 100 / 50 + 50 / 3000
    assert result.second == pytest.approx(best, rel=1e-5)
    assert result.time == pytest.approx(best + 3000 / 1e6, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "time"),
    [
        # by jerk alone: at its ends the acceleration would be 1e6 * 4.93e-3 / 2, less than 3000
        ("G1 F12000 X0.01", (12 * 0.01 / 1e6) ** (1 / 3)),
        # 3000 mm/s^2 to and fro, from one to the other in 6 ms: 3 mm + 9 um = 3000 T^2 / 4
        ("G1 F12000 X3", math.sqrt(4 * 3.009 / 3000)),
        # to and fro: the acceleration goes on through the reversal
        ("G64 P1\nG1 F12000 X0.01\nX0\nX0.01", 3 * (12 * 0.01 / 1e6) ** (1 / 3)),
        ("G1 F12000 X0.01\nG4 P0.5\nX0", 0.5 + 2 * (12 * 0.01 / 1e6) ** (1 / 3)),
    ],
)
def test_jerk_takes_its_time(text, time):
    assert bound(*blended_path(interpret_text(text).moves, MACHINE), 64) == pytest.approx(time)


@pytest.mark.parametrize("jerk", [1e6, 3e5])
def test_no_plan_is_faster_than_its_bound(jerk):
    machine = bench_plan.bench_machine(jerk)
    # 0.05 mm to and fro, rounded: Y is as good as alone, and X moves on
    zigzag = [(0.05 * n, 0.05 * (n % 2)) for n in range(1, 60)]
    result = bench_plan.measured(interpret_text(lines(zigzag)).moves, machine)
    assert 1.05 * result.second < result.third <= result.time < 1.3 * result.third
    for seed in range(10):
        walk = np.random.default_rng(seed).normal(0, 0.3, (60, 2)).cumsum(axis=0)
        result = bench_plan.measured(interpret_text(lines(walk)).moves, machine)
        assert result.second <= result.third <= result.time


def lines(points):
    return "G64 P0.02\nF12000\n" + "".join(f"G1 X{x:.6f} Y{y:.6f}\n" for x, y in points)


def test_a_circle_in_chords_is_driven_like_one():
    assert bench_plan._chorded(MACHINE) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    ("name", "jerk", "most"),
    [
        ("trochoidal.ngc", 1e6, 1.10),
        ("trochoidal.ngc", 3e5, 1.20),
        ("contour.ngc", 1e6, 1.10),
        ("contour.ngc", 3e5, 1.20),
        ("vcarve.ngc", 1e6, 1.10),
        ("vcarve.ngc", 3e5, 1.07),  # 1.08 and more without refinement
        ("wheels.ngc", 1e6, 1.10),
        ("wheels.ngc", 3e5, 1.05),  # the same
    ],
)
def test_real_programs_are_planned_near_the_optimum(corpus, name, jerk, most):
    moves = bench_plan.blended(bench_plan._moves(corpus / name), 0.02)
    result = bench_plan.measured(moves, bench_plan.bench_machine(jerk))
    assert result.time <= most * result.second
