"""The way back to a plan, against hand arithmetic: limits, continuity, the same path."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pulsewright.motion.rejoin import rejoin
from pulsewright.motion.trajectory import Trajectory

SPEED, ACCELERATION, JERK = 100.0, 1000.0, 40_000.0
RISE = math.sqrt(SPEED / JERK)  # 0.05 s, to 2000 mm/s^2; so the plan below takes half of the jerk


def circle(jerk=JERK / 4):
    """Return 400 mm on a circle of radius 50: up to 100 mm/s in 0.2 s, along, and down again."""
    build = math.sqrt(SPEED / jerk)
    cruise = 400 / SPEED - 2 * build
    laws, ends, state = [], [0.0], (0.0, 0.0, 0.0)
    for time, j in [(build, jerk), (build, -jerk), (cruise, 0), (build, -jerk), (build, jerk)]:
        s, v, a = state
        laws.append([s, v, a / 2, j / 6])
        ends.append(ends[-1] + time)
        s += v * time + a * time**2 / 2 + j * time**3 / 6
        state = (s, v + a * time + j * time**2 / 2, a + j * time)
    poly, cosine, sine = np.zeros((1, 4, 2)), np.array([[50.0, 0.0]]), np.array([[0.0, 50.0]])
    element, move = np.zeros(len(laws), np.int32), np.zeros(1, np.int32)
    omega, length = np.array([1 / 50]), np.array([400.0])
    return Trajectory(
        poly, cosine, sine, omega, length, move, element, np.array(ends), np.array(laws)
    )


def joined(plan, time, offset, *, rate=SPEED, acceleration=ACCELERATION, jerk=JERK):
    place = plan.at(time)[0] + offset
    return rejoin(
        plan, time, place, rates=[rate] * 2, accelerations=[acceleration] * 2, jerks=[jerk] * 2
    )


@pytest.mark.parametrize(
    ("distance", "duration"),
    [
        # to 100 mm/s in 0.1 + 0.025 s and as long down again, at half of it in the mean
        (62.5, 0.625 + 0.125),
        # up to v and down again, at 1000 mm/s^2 for a while: v (v / 1000 + 0.025) = 5 mm
        (5.0, 2 * (0.025 + (-0.0125 + math.hypot(0.0125, math.sqrt(0.005))))),
        # the acceleration is not reached: a quarter of the time each of 40 000 mm/s^3
        (0.01, 4 * (0.01 / (2 * JERK)) ** (1 / 3)),
    ],
)
def test_way_back_is_the_fastest_within_limits(distance, duration):
    plan = circle()
    back = joined(plan, plan.duration, [distance, 0.0])
    assert back.duration == pytest.approx(duration, rel=1e-12)
    time = np.linspace(0, back.duration, 10_001)
    for n, limit in enumerate([SPEED, ACCELERATION, JERK], start=1):
        assert abs(back.at(time, n)).max() <= limit * (1 + 1e-9)
    assert back.at(0.0)[0] == pytest.approx(plan.at(plan.duration)[0] + [distance, 0.0])
    assert back.at(back.duration)[0] == pytest.approx(plan.at(plan.duration)[0])


@pytest.mark.parametrize("time", [0.0, 0.05, 0.1, 1.2345, 2.0, 3.8, 4.1])
def test_nothing_jumps_up_to_acceleration(time):
    motion = joined(circle(), time, [3.0, -1.0])
    before, after = np.nextafter(motion.start[1:-1], 0), motion.start[1:-1]
    for n, most in enumerate([1e-9, 1e-8, 1e-4]):
        assert abs(motion.at(after, n) - motion.at(before, n)).max() <= most
    assert (np.diff(motion.start) > 0).all()
    assert abs(motion.at([0.0, motion.duration], 1)).max() <= 1e-9
    assert abs(motion.at([0.0, motion.duration], 2)).max() <= 1e-4


@pytest.mark.parametrize("time", [0.05, 1.2345, 2.0])
def test_speeding_up_takes_a_tenth_of_acceleration_and_jerk(time):
    plan = circle()
    motion = joined(plan, time, [0.0, 0.0])
    t = np.linspace(0, motion.duration, 20_001)
    own = np.linspace(0, plan.duration, 20_001)
    for n, limit in [(1, 0.0), (2, ACCELERATION), (3, JERK)]:
        own_most = abs(plan.at(own, n)).max() * (1 + 1e-6)
        assert abs(motion.at(t, n)).max() <= own_most + 0.1 * limit


def test_the_time_of_the_plan_begins_to_pass_smoothly():
    # 1.5 * 100 / (0.1 * 1000) s by acceleration; the jerk would do with 1.13 s
    plan, warp, time = circle(), 1.5, 1.0
    motion = joined(plan, time, [0.0, 0.0])
    assert motion.duration == pytest.approx(plan.duration - time + warp / 2)
    share = np.linspace(0, 1, 1000)
    passed = time + warp * (share**3 - share**4 / 2)
    assert np.allclose(motion.at(warp * share), plan.at(passed), atol=1e-6, rtol=0)
    rest = np.linspace(0, 1, 100)
    assert np.allclose(motion.at(warp + rest), plan.at(passed[-1] + rest), atol=1e-9, rtol=0)


def test_a_low_limit_of_jerk_takes_more_time():
    # jerk of 1000 mm/s^3: 100 T^2 - 4500 T - 600 = 0
    warp = (4500 + math.sqrt(4500**2 + 4 * 100 * 600)) / 200
    plan = circle()
    motion = joined(plan, plan.duration / 2, [0.0, 0.0], jerk=1000.0)
    share = np.linspace(0, 1, 100)
    left = plan.duration / 2 / warp  # the plan comes to its end before that time is over
    r = next(r for r in np.linspace(0, 1, 100_001) if r**3 - r**4 / 2 >= left)
    assert motion.duration == pytest.approx(warp * r, rel=1e-4)
    passed = plan.duration / 2 + warp * ((share * r) ** 3 - (share * r) ** 4 / 2)
    ends = np.minimum(passed, plan.duration)
    assert np.allclose(motion.at(warp * r * share), plan.at(ends), atol=1e-2, rtol=0)


def test_nothing_is_left_of_a_plan_joined_at_its_end():
    plan = circle()
    motion = joined(plan, 99.0, [0.0, 0.0])
    assert motion.duration == 0
    assert motion.at(0.0)[0] == pytest.approx(plan.at(plan.duration)[0])


def test_a_plan_that_is_left_again_and_again_is_still_the_same_plan():
    plan = circle()
    limits = {"rates": [SPEED] * 2, "accelerations": [ACCELERATION] * 2, "jerks": [JERK] * 2}
    motion = joined(plan, 1.0, [0.5, -0.5])
    pieces = len(motion.element)
    for _ in range(20):  # in the middle of speeding up
        time = motion.back + 0.5 * motion.warp
        place = motion.at(time)[0]
        # half of the time, (1/2)^3 - (1/2)^4 / 2 of it in the plan's time
        assert motion.plan_time(time) == pytest.approx(motion.joined + 3 / 32 * motion.warp)
        assert place == pytest.approx(plan.at(motion.plan_time(time))[0], abs=1e-6)
        motion = rejoin(motion, time, place + 0.01, **limits)
        assert len(motion.element) < 1.1 * pieces
    assert motion.at(motion.back + motion.warp + 0.1) == pytest.approx(
        plan.at(motion.joined + motion.warp / 2 + 0.1), abs=1e-9
    )
    assert motion.at(motion.duration) == pytest.approx(plan.at(plan.duration), abs=1e-9)


def test_a_way_back_that_is_left_goes_to_where_it_would_have_gone():
    plan = circle()
    motion = joined(plan, 1.0, [5.0, 0.0])
    place = motion.at(0.5 * motion.back)[0]
    again = rejoin(
        motion, 0.5 * motion.back, place, rates=[SPEED] * 2, accelerations=[ACCELERATION] * 2,
        jerks=[JERK] * 2,
    )  # fmt: skip
    assert again.at(again.back)[0] == pytest.approx(plan.at(1.0)[0], abs=1e-9)
    assert again.at(0.0)[0] == pytest.approx(place)
