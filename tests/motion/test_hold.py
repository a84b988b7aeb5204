"""Plans left in their middle: limits, path, and how soon.

Limits are checked on samples of the plan that is played, by derivatives that `Trajectory.at` has.
"""

import math

import numpy as np
import pytest

from pulsewright.motion.gcode import interpret
from pulsewright.motion.hold import AxisLimits, hold
from pulsewright.motion.machine import Machine
from pulsewright.motion.plan import plan as plan_moves
from pulsewright.motion.trajectory import Trajectory

MACHINE = Machine.default()
PROGRAM = (
    "G21 G90 G64 P0.05 F3000\nG1 X12 Y3\nG1 X14 Y12\nG3 X4 Y12 I-5\nG1 X2 Y2 Z-1\nG4 P0.3\n"
    "G0 X40 Y30 Z2\nG0 X0 Y0\nG3 X0 Y0 I0.5 F2500\nG61\nG1 X3\nG1 X3 Y3\nM2\n"
)


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    path = tmp_path_factory.mktemp("part") / "part.ngc"
    path.write_text(PROGRAM)
    return plan_moves(interpret(path).moves, MACHINE)


@pytest.fixture(scope="module")
def limits():
    rows, _, acceleration = MACHINE.limit_rows()
    return AxisLimits(rows, acceleration, MACHINE.jerk_limits())


def line(way, seconds):
    """Return one axis at a constant speed, after and before a moment of any acceleration."""
    poly, none, zero = np.zeros((1, 4, 1)), np.zeros((1, 1)), np.zeros(1, np.int32)
    poly[0, 1] = way
    one, law = np.ones(1), np.array([[0.0, 1 / seconds, 0.0, 0.0]])
    return Trajectory(poly, none, none, np.zeros(1), one, zero, zero, np.array([0, seconds]), law)


def check(plan, held, at, time, limits):
    """Check that ``held`` leaves ``plan`` at ``time`` and rests within limits where it was."""
    before = np.linspace(0, time, 500)
    assert np.array_equal(held.at(before), plan.at(before))
    assert np.allclose(held.at(math.inf), plan.at(at), atol=1e-9)
    if not plan.at(time, 1).any():  # in the dwell
        assert at == time == held.duration
        return
    tail = np.linspace(time, held.duration, 2000)
    motion = [held.at(tail, k) @ limits.rows.T for k in range(4)]
    own = [plan.at(np.linspace(time, at, 2000), k) @ limits.rows.T for k in range(4)]
    assert (abs(motion[1]) <= abs(own[1]).max(axis=0) * (1 + 1e-6) + 1e-9).all()
    assert (abs(motion[2]) <= limits.accelerations * 1.002).all()
    # it is looked at in steps; what is shorter is left out by a difference over 2 ms, or over all
    window = min(max(round(2e-3 / (tail[1] - tail[0])), 1), tail.size - 1)
    jerk = abs(motion[2][window:] - motion[2][:-window]) / (tail[window] - tail[0])
    assert (jerk <= limits.jerks * 1.1).all()
    # velocity and acceleration go on from the plan, and end at rest
    assert np.allclose(held.at(time + 1e-9, 1), plan.at(time, 1), atol=1e-2)
    assert (abs(held.at(held.duration - 1e-9, 1)) < 0.2).all()


def test_a_plan_of_one_piece_is_left_like_any_other():
    """From rest to rest in one cubic: at no piece's begin does it move."""
    plan = line(3000.0, 1.5)
    plan.law[:] = [0.0, 0.0, 3 / 1.5**2, -2 / 1.5**3]
    limits = AxisLimits.of_motors([16_000.0], [6.4e5])
    held, at = hold(plan, 0.75, limits)
    assert plan.at(0.75, 1)[0] == pytest.approx(3000.0)
    assert held.duration > 0.75 + 3000 / 16_000
    check(plan, held, at, 0.75, limits)


@pytest.mark.parametrize("seed", range(40))
def test_any_plan_is_left_at_any_time_within_its_limits(plan, limits, seed):
    time = float(np.random.default_rng(seed).uniform(0.01, plan.duration - 0.01))
    held, at = hold(plan, time, limits)
    check(plan, held, at, time, limits)
    # speed / acceleration, twice the time in which acceleration is built up, and that again where
    # the plan accelerates, or more on a curve, where bending may take nearly all of the jerk
    speed = abs(plan.at(time, 1)[0] / 500).max()
    resting = plan.at(time, 1).any()
    assert held.duration - time <= (speed + 0.15 if resting else 0)
    assert time <= at <= held.duration


def test_positions_lie_on_the_path(plan, limits):
    held, at = hold(plan, 0.7, limits)
    path = plan.at(np.linspace(0.7, at, 20_000))[:, :3]
    for place in held.at(np.linspace(0.7, held.duration, 50))[:, :3]:
        assert np.linalg.norm(path - place, axis=1).min() < 5e-3  # they are so far apart


@pytest.mark.parametrize("jerk", [20_000.0, 5_000.0, math.inf])
def test_a_straight_stop_takes_about_the_shortest_time(jerk):
    plan = line(1000.0, 20.0)  # 50 mm/s
    limits = AxisLimits(np.eye(1), np.array([500.0]), np.array([jerk]))
    held, at = hold(plan, 3.0, limits)
    # v / a + a / j, as acceleration gets so far: v >= a^2 / j
    shortest = 0.1 + (500 / jerk if math.isfinite(jerk) else 0.0)
    assert shortest <= (held.duration - 3.0) * 1.001 <= shortest * 1.12
    assert at == pytest.approx(3.0 + (held.duration - 3.0) / 2, rel=0.02)
    assert held.at(math.inf)[0, 0] == pytest.approx(50 * at)


def test_a_dwell_is_left_at_once(plan, limits):
    dwell = float(plan.start[:-1][(np.diff(plan.start) > 0.29)][0])
    held, at = hold(plan, dwell + 0.1, limits)
    assert held.duration == at == dwell + 0.1
    assert np.array_equal(held.at(math.inf), plan.at(dwell))


def test_a_plan_that_is_over_or_about_to_rest_stays_as_it_is(plan, limits):
    held, at = hold(plan, plan.duration + 1, limits)
    assert held is plan
    assert at == plan.duration
    held, at = hold(plan, plan.duration - 1e-3, limits)
    assert at == pytest.approx(plan.duration, abs=1e-6)
    assert held.duration == pytest.approx(plan.duration, abs=2e-3)


def test_before_its_start_it_stays_there(plan, limits):
    held, at = hold(plan, -1.0, limits)
    assert (at, held.duration) == (0.0, 0.0)
    assert np.array_equal(held.at(1.0), plan.at(0.0))
