"""Plans changed while they are played: looked at densely, by arithmetic of its own."""

import numpy as np
import pytest
from test_plan import MACHINE, program, random_program

from pulsewright.errors import CheckFailedError, UsageError
from pulsewright.motion.certificate import Certificate
from pulsewright.motion.live import LivePlan
from pulsewright.motion.plan import plan

V, A, J = 60.0, 500.0, 20_000.0  # of X, Y, Z


SEEDS = (2, 3, 5, 7, 11, 13)


def live(moves):
    return LivePlan(plan(moves, MACHINE), moves, MACHINE)


def check_limits(trajectory, begin, end, start):
    """Check velocity, acceleration and jerk by differences of positions 0.1 ms apart."""
    h = 1e-4
    time = np.arange(begin, end, h)
    x = trajectory.at(time)[:, :3]
    v, a = np.diff(x, axis=0) / h, np.diff(x, 2, axis=0) / h**2
    assert abs(v).max() <= V * (1 + 1e-6)
    assert abs(a).max() <= A * (1 + 1e-5)
    # rounding of positions of 100 mm: 1e-14 / h^3 = 1e-2
    assert abs(np.diff(a, axis=0)).max() / h <= J + 1.0
    assert abs(x[0] - start[:3]).max() < 0.01


def pieces_before(trajectory, time):
    return int(np.searchsorted(trajectory.start, time, "right")) - 1


def check_same_before(old, new, time):
    """Check that the past is the same, number by number."""
    k = pieces_before(old, time)
    assert np.array_equal(old.start[: k + 1], new.start[: k + 1])
    assert np.array_equal(old.law[: k + 1], new.law[: k + 1])
    assert np.array_equal(old.element[: k + 1], new.element[: k + 1])


def test_a_hold_rests_as_soon_as_the_limits_allow_and_goes_on_from_there():
    moves = program([((100, 0), 50)])
    it = live(moves)
    before = it.trajectory
    held = it.hold(1.0)
    check_same_before(before, held, 1.0)
    # from 50 mm/s in 50 / A and A / J at the least: 125 ms
    assert not it.at_rest(1.1249)
    assert it.at_rest(1.145)
    rest = held.at([1.145, 50.0, 9e5])
    assert np.ptp(rest[:, 0]) == 0
    assert rest[0, 0] - held.at(1.0)[0, 0] == pytest.approx(50 * 0.125 / 2, rel=0.2)
    resumed = it.resume(7.0)
    check_same_before(held, resumed, 7.0)
    assert resumed.at(7.0)[0, 0] == rest[0, 0]
    # the way of half the time to rest is made then, and that of half the time back is lost
    assert resumed.duration == pytest.approx(before.duration + 6.0, abs=0.01)
    end = resumed.at(resumed.duration)[0]
    assert end == pytest.approx(np.array([100, 0, 0, 0, 0, 0]), abs=1e-9)
    check_limits(resumed, 0.0, resumed.duration, moves.start)
    assert it.certificate().passed


def test_an_override_changes_the_feed_and_no_rapid():
    moves = program([((60, 0), 30), ((60, 60), None)])
    it = live(moves)
    slow = it.set_override(0.5, 0.5)
    assert 0.75 * 15 < slow.at(1.5, 1)[0, 0] <= 15 * (1 + 1e-9)
    assert abs(slow.at(np.arange(0, slow.duration, 0.01), 1)[:, 1]).max() == pytest.approx(V)
    assert (it.override[pieces_before(slow, 1.5)], it.override[0]) == (0.5, 1.0)
    fast = it.set_override(10.0, 2.0)
    assert abs(fast.at(np.arange(2, 3, 0.001), 1)[:, 0]).max() == pytest.approx(V)  # its limit
    check_limits(fast, 0.0, fast.duration, moves.start)
    assert it.certificate().passed


@pytest.mark.parametrize("seed", range(6))
def test_changes_at_random_times_keep_path_and_limits(seed):
    rng = np.random.default_rng(seed)
    moves = random_program(SEEDS[seed])
    it = live(moves)
    untouched, time = it.trajectory, 0.0
    for _ in range(30):
        time += rng.uniform(0.0, 0.3)
        if time >= it.trajectory.duration:
            break
        old = it.trajectory
        kind = rng.integers(3)
        if it.held and kind:
            it.resume(time)
        elif kind == 0:
            it.hold(time)
        else:
            it.set_override(float(rng.choice([0.2, 0.6, 1.0, 1.7])), time)
        check_same_before(old, it.trajectory, time)
    if it.held:
        it.resume(time + 1.0)
    end = it.trajectory.duration
    assert it.certificate().passed
    check_limits(it.trajectory, 0.0, end, moves.start)
    assert it.trajectory.at(end)[0] == pytest.approx(untouched.at(untouched.duration)[0], abs=1e-9)
    # along the same elements, never back
    element, law = it.trajectory.element, it.trajectory.law
    assert (np.diff(element) >= 0).all()
    assert (np.diff(law[:, 0])[np.diff(element) == 0] >= -1e-9).all()


def test_a_dwell_whose_override_changes_lasts_as_long_as_programmed_when_it_is_held():
    changed = live(program([((0.5, 0, 0), 10.0), 0.4, ((2, 0, 0), 10.0)]))
    rest = np.flatnonzero((changed.trajectory.law[:, 1:] == 0).all(axis=1))[0]
    begin = changed.trajectory.start[rest]
    changed.set_override(0.5, begin + 0.3)
    changed.hold(begin + 0.1)
    changed.resume(begin + 1.1)
    assert changed.certificate().passed, changed.certificate()  # the dwell is part of it
    still = (changed.trajectory.law[:, 1:] == 0).all(axis=1)
    assert np.diff(changed.trajectory.start)[still].sum() == pytest.approx(0.4 + 1.0)


def test_a_dwell_that_is_held_lasts_as_long_as_programmed_in_all():
    moves = program([((10, 0), 50), 2.0, ((0, 0), 50)])
    it = live(moves)
    before = it.trajectory
    begin = float(before.start[np.flatnonzero(before.law[:, 1:].any(axis=1) == 0)[0]])
    it.hold(begin + 0.5)
    after = it.resume(begin + 3.5)
    assert after.duration == pytest.approx(before.duration + 3.0, abs=1e-9)
    assert it.certificate().passed


@pytest.mark.parametrize("early", [1e-4, 5e-5, 2e-5, 1e-5, 1e-6, 0.0])
@pytest.mark.parametrize("corner", [0, 1])
def test_a_change_just_before_a_rest_comes_to_it_first(corner, early):
    # J early^3 / 6 before the rest, less than a billionth of a move, with an acceleration J early
    moves = program([((20, 0), 50), ((0, 0), 50)], tolerance=0)
    whole = plan(moves, MACHINE).duration
    rests, ends = [whole / 2, whole], [20, 0]
    rest, end = rests[corner], ends[corner]
    time = rest - early
    for change in ("hold", "set_override"):
        it = live(moves)
        before = it.trajectory
        changed = it.hold(time) if change == "hold" else it.set_override(0.5, time)
        check_same_before(before, changed, time - 1e-7)
        assert it.certificate().passed
        assert changed.at(rest)[0, 0] == pytest.approx(end, abs=1e-9)
        if change == "hold":
            assert it.at_rest(rest + 1e-9)
            assert changed.at(1e5)[0, 0] == pytest.approx(end, abs=1e-9)
            over = whole + 1 + (whole - rest)
            assert it.resume(whole + 1).duration == pytest.approx(over, abs=1e-3)


def test_held_from_the_begin_nothing_moves():
    it = live(program([((10, 0), 50)]))
    before = it.trajectory.duration
    assert not it.hold(0.0).law[:, 1:].any()
    assert it.at_rest(0.0)
    it.set_override(0.5, 3.0)  # felt when it goes on
    assert it.resume(4.0).duration == pytest.approx(4.0 + 2 * before, rel=0.2)


def test_an_override_must_be_positive():
    it = live(program([((10, 0), 50)]))
    for factor in (0.0, -1.0, float("inf"), float("nan")):
        with pytest.raises(UsageError, match=r"must be positive; 0 is hold"):
            it.set_override(factor, 0.1)


def test_a_plan_that_fails_its_certificate_is_not_taken(monkeypatch):
    it = live(program([((10, 0), 50)]))
    before = it.trajectory
    monkeypatch.setattr(Certificate, "passed", False)
    with pytest.raises(CheckFailedError, match="fails its certificate"):
        it.set_override(0.5, 0.1)
    with pytest.raises(CheckFailedError, match="fails its certificate"):
        it.hold(0.1)
    assert it.trajectory is before
    assert (it.factor, it.held) == (1.0, False)


def test_a_program_without_motion_can_be_held():
    it = live(program([]))
    it.hold(0.0)
    assert it.at_rest(0.0)
    assert it.resume(2.0).duration == 2.0
    assert it.certificate().passed
