"""The motors' plan, of which a part is made where it is asked for."""

import numpy as np
import pytest
from test_trajectory_parts import MOTORS, STEPS, TIME, WAY

from pulsewright.errors import UsageError
from pulsewright.motion import motors
from pulsewright.motion.motors import MotorPlan


@pytest.fixture(params=[1, 2, 4096])
def plan(request, monkeypatch):
    monkeypatch.setattr(motors, "WINDOW", request.param)
    return MotorPlan(WAY, MOTORS)


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (2, 0, 3, 1)])
def test_it_is_where_the_motors_are_in_any_order(plan, order):
    for n in order:
        assert plan.at(TIME[n])[0] == pytest.approx(STEPS[n], abs=1e-12)
        near = plan.between(TIME[n] - 0.1, TIME[n] + 0.1)
        assert near.at(TIME[n])[0] == pytest.approx(STEPS[n], abs=1e-12)


def test_it_rests_before_and_after(plan):
    assert plan.at(-1.0)[0].tolist() == [0, 0, 0]
    assert plan.between(-5.0, -4.0).at(-4.0)[0].tolist() == [0, 0, 0]
    # at the end: X -1, Y 4
    for time in (plan.duration, 100.0, np.inf):
        assert plan.at(time)[0] == pytest.approx([30, -50, 8], abs=1e-12)


def test_between_has_all_that_is_between(plan):
    near = plan.between(0.2, 3.5)
    assert near.at(TIME[:3]) == pytest.approx(np.array(STEPS[:3]), abs=1e-12)
    assert near.start[0] <= 0.2
    assert near.start[-1] > 3.5


def test_only_the_part_in_use_is_made(plan, monkeypatch):
    monkeypatch.setattr(motors, "WINDOW", 1)
    assert len(plan.between(0.5, 0.6).poly) == 1
    part = plan.between(2.1, 2.2)
    assert plan.between(2.5, 2.6) is part


def test_its_geometry_is_whole_where_it_is_asked_for(plan):
    assert plan.axes == 3
    assert plan.poly[1, 1].tolist() == [10, -10, 2]
    assert plan.cosine[2].tolist() == [10, 10, 0]
    assert plan.sine[2].tolist() == [10, -10, 2]
    assert plan.part(1, 3).at(TIME[1])[0].tolist() == STEPS[1]
    assert plan.mapped(np.array([[1.0, 1.0, 0.0]])).at(TIME[1])[0].tolist() == [20]


def test_other_pieces_on_the_same_path(plan):
    slow = plan.timed(WAY.element[:1], np.array([0.0, 2.0]), np.array([[0, 0.5, 0, 0]]))
    assert slow.at(1.0)[0].tolist() == [5, 5, 0]
    assert plan.at(1.0)[0].tolist() == [10, 10, 0]


def test_an_unsound_plan_is_told(plan):
    WAY.require_sound()
    plan.require_sound()
    law = WAY.law.copy()
    law[2, 1] = np.nan
    with pytest.raises(UsageError, match=r"trajectory.law\[2, 1\] is nan"):
        MotorPlan(WAY.timed(WAY.element, WAY.start, law), MOTORS).require_sound()
