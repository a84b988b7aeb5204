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


def test_the_optimum_of_a_circle_is_that_of_its_radial_acceleration():
    # 200 mm/s on a radius of 5 mm would be 8000 mm/s^2; sqrt(5 * 3000) = 122 mm/s
    around = (10 * math.pi + 5 / 2) / math.sqrt(15_000)  # v^2 / (2 a) more, to speed up and down
    assert around <= least("F12000\nG2 X0 Y0 I5 J0", 128) <= 1.2 * around


def test_a_plan_takes_the_rise_of_its_acceleration_longer():
    moves = interpret_text("G1 F3000 X100").moves
    result = bench_plan.measured(moves, MACHINE)
    best = 100 / 50 + 50 / 3000
    assert result.second == pytest.approx(best, rel=1e-5)
    assert result.time == pytest.approx(best + 3000 / 1e6, rel=1e-3)
    assert result.spent > 0


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
