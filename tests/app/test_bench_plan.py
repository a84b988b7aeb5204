"""The yardstick of planned times, against hand arithmetic."""

from __future__ import annotations

import math

import pytest

from pulsewright.app import bench_plan
from pulsewright.app.bench_optimum import optimum
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
    ratio, spent = bench_plan.measured(moves, MACHINE)
    best = 100 / 50 + 50 / 3000
    assert ratio == pytest.approx((best + 3000 / 1e6) / best, rel=1e-3)
    assert spent > 0


def test_a_circle_in_chords_is_driven_like_one():
    assert bench_plan._chorded(MACHINE) == pytest.approx(1.0, abs=0.05)
