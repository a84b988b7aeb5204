"""The certificate must fail where a promise is broken, and by how much."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from test_plan import MACHINE, program

from pulsewright.compiled import compiled
from pulsewright.errors import UsageError
from pulsewright.motion import certificate as module
from pulsewright.motion import certificate_kernels
from pulsewright.motion.certificate import Certifier, certify
from pulsewright.motion.plan import plan

CORNER = program([((50, 0), 50), ((50, 50), 50), 0.5, ((0, 50), 50)], tolerance=0.1)


def faster(factor):
    """Return the corner's trajectory, run ``factor`` times as fast."""
    trajectory = plan(CORNER, MACHINE)
    law = trajectory.law * factor ** np.arange(4)
    return dataclasses.replace(trajectory, law=law, start=trajectory.start / factor)


def changed(**columns):
    """Return moves like the corner's but for some columns."""
    return dataclasses.replace(CORNER, **columns)


def test_planned_motion_passes():
    certificate = certify(plan(CORNER, MACHINE), CORNER, MACHINE)
    assert certificate.passed
    assert certificate.deviation == pytest.approx(0.1)
    assert "100.00 % of the programmed feed" in certificate.text()


def test_exact_shares_of_the_limits():
    # steadily at 50 of 60 mm/s, after 300 of 500 mm/s^2, built up with 10 of 20 m/s^3
    moves = program([((0, 100), 50)])
    trajectory = plan(moves, MACHINE)
    law = np.array([[0, 0, 0, 1e4 / 6], [0.045, 4.5, 150, 0], [0, 50, 0, 0]])
    time = np.array([0, 0.03, 0.1, 0.2])
    piece = dataclasses.replace(
        trajectory,
        poly=trajectory.poly[:1],
        cosine=trajectory.cosine[:1],
        sine=trajectory.sine[:1],
        omega=np.zeros(1),
        length=np.array([100.0]),
        move=np.zeros(1, np.int32),
        element=np.zeros(3, np.int32),
        start=time,
        law=law,
    )
    certificate = certify(piece, moves, MACHINE)
    assert [worst.ratio for worst in certificate.velocity] == pytest.approx([0, 5 / 6, 0, 0])
    assert [worst.ratio for worst in certificate.acceleration] == pytest.approx([0, 0.6, 0, 0])
    assert [worst.ratio for worst in certificate.jerk] == pytest.approx([0, 0.5, 0, 0])
    assert (certificate.velocity[1].what, certificate.velocity[1].time) == ("Y", 0.1)
    assert certificate.acceleration_jump == pytest.approx(300)


def test_speed_beyond_feed_and_limits_is_found():
    certificate = certify(faster(1.5), CORNER, MACHINE)
    assert certificate.feed.ratio == pytest.approx(1.5)
    assert certificate.velocity[0].ratio == pytest.approx(1.25)
    assert certificate.acceleration[0].ratio == pytest.approx(2.25, rel=0.01)
    assert certificate.jerk[0].ratio > 2  # of about 0.85, times 1.5^3
    assert certificate.dwell_error == pytest.approx(0.5 - 0.5 / 1.5)
    assert not certificate.passed
    assert "acceleration of X reaches 2.2" in str(certificate)


def test_acceleration_inside_an_arc_is_found():
    # r = 20 mm at 50 mm/s: 125 mm/s^2 in cruise, on X when passing (20, 0) after a full turn
    moves = program([((20, 0), 50, ((0, 0), 4 * np.pi))], start=(20, 0))
    trajectory = plan(moves, MACHINE)
    cruise = np.argmax(np.diff(trajectory.start))
    assert trajectory.law[cruise, 2] == 0
    slow = MACHINE.model_copy(
        update={
            "axis": {
                **MACHINE.axis,
                "X": MACHINE.axis["X"].model_copy(update={"acceleration": 100.0}),
            }
        }
    )
    assert certify(trajectory, moves, slow).acceleration[0].ratio >= 1.25


def test_velocity_inside_a_cubic_is_found():
    # x = s^3 - 1.5 s^2 at a steady 10 mm/s: x' = 3 s^2 - 3 s is 0 at both ends, -0.75 between
    moves = program([((-0.5, 0), 100)])
    cubic = dataclasses.replace(
        plan(moves, MACHINE),
        poly=np.array([[[0.0] * 6, [0.0] * 6, [-1.5] + [0.0] * 5, [1.0] + [0.0] * 5]]),
        length=np.ones(1),
        element=np.zeros(1, np.int32),
        start=np.array([0, 0.1]),
        law=np.array([[0, 10.0, 0, 0]]),
    )
    assert certify(cubic, moves, MACHINE).velocity[0].ratio == pytest.approx(7.5 / 60, rel=2e-3)


def test_acceleration_inside_a_cubic_is_found():
    # x = s^3 - 2.5 s^2 from rest at 100 mm/s^2: b = 200 s, x'' b + 100 x' = 1500 (s^2 - s), which
    # is 0 at both ends and -375 mm/s^2 between; x' v is most at s = 1, 2 sqrt(200) mm/s
    moves = program([((-1.5, 0), 100)])
    trajectory = plan(moves, MACHINE)
    cubic = dataclasses.replace(
        trajectory,
        poly=np.array([[[0.0] * 6, [0.0] * 6, [-2.5] + [0.0] * 5, [1.0] + [0.0] * 5]]),
        length=np.ones(1),
        element=np.zeros(1, np.int32),
        start=np.array([0, np.sqrt(0.02)]),
        law=np.array([[0, 0, 50.0, 0]]),
    )
    certificate = certify(cubic, moves, MACHINE)
    assert certificate.acceleration[0].ratio == pytest.approx(375 / 500, rel=2e-3)
    assert certificate.velocity[0].ratio == pytest.approx(2 * np.sqrt(200) / 60, rel=2e-3)
    # at s = 1, the third derivative times v^3, and the second times 3 v a
    jerk = 6 * 200**1.5 + 300 * np.sqrt(200)
    assert certificate.jerk[0].ratio == pytest.approx(jerk / 20_000, rel=2e-3)
    assert not certificate.passed


def test_tighter_tolerance_is_violated():
    certificate = certify(plan(CORNER, MACHINE), changed(tolerance=CORNER.tolerance / 2), MACHINE)
    assert certificate.path.ratio == pytest.approx(2)
    assert certificate.path.line in (1, 2)  # the corner between them


def test_missed_rest_is_found():
    certificate = certify(plan(CORNER, MACHINE), changed(tolerance=np.zeros(4)), MACHINE)
    assert certificate.missed_rests == 1


def test_wrong_end_and_wrong_path_are_found():
    end = CORNER.end.copy()
    end[-1, 1] += 0.02
    certificate = certify(plan(CORNER, MACHINE), changed(end=end), MACHINE)
    assert certificate.end_error == pytest.approx(0.02)
    assert certificate.deviation >= 0.02 - 1e-9
    assert not certificate.passed


def test_wrong_radius_of_an_arc_is_found():
    moves = program([((20, 0), 50, ((0, 0), 2 * np.pi))], start=(20, 0))
    trajectory = plan(moves, MACHINE)
    bent = dataclasses.replace(trajectory, sine=trajectory.sine * 1.001)
    assert certify(bent, moves, MACHINE).deviation >= 0.02 - 1e-9


def test_jumps_are_found():
    trajectory = plan(CORNER, MACHINE)
    law = trajectory.law.copy()
    law[1, 1] += 0.5
    law[2, 0] += 0.25
    law[3, 2] += 20
    certificate = certify(dataclasses.replace(trajectory, law=law), CORNER, MACHINE)
    assert certificate.velocity_jump >= 0.5 - 1e-6
    assert certificate.position_jump >= 0.25 - 1e-6
    assert certificate.acceleration_jump >= 40 - 1e-6


def test_chord_across_more_than_the_tolerance_is_found():
    # a straight line from 0 to 20 mm, certified against a path with a bump of 0.3 mm between
    straight = program([((10, 0), 50), ((20, 0), 50)], tolerance=0.1)
    bump = program([((10, 0.3), 50), ((20, 0), 50)], tolerance=0.1)
    trajectory = plan(program([((20, 0), 50)]), MACHINE)
    trajectory = dataclasses.replace(trajectory, move=np.ones(1, np.int32))
    assert certify(trajectory, straight, MACHINE).deviation == pytest.approx(0, abs=1e-9)
    certificate = certify(trajectory, bump, MACHINE)
    assert (certificate.deviation, certificate.path.ratio) == pytest.approx((0.3, 3))
    # but feeds may be collapsed within 0.4 mm; not rapids, nor where the machine should rest
    wide = dataclasses.replace(bump, collapse=np.full(2, 0.4))
    assert certify(trajectory, wide, MACHINE).path.ratio == pytest.approx(0.75)
    rapid = dataclasses.replace(wide, rapid=np.ones(2, bool))
    assert certify(trajectory, rapid, MACHINE).path.ratio == pytest.approx(3)
    rest = dataclasses.replace(wide, tolerance=np.array([0.0, 0.1]))
    assert certify(trajectory, rest, MACHINE).path.ratio == np.inf


def test_a_loose_corner_beside_a_chord_does_not_loosen_it():
    # 10 mm straight on, then a chord of 10 mm beside a corner that is 0.3 mm off
    bump = program([((10, 0), 50), ((15, 0.3), 50), ((20, 0), 50)], tolerance=0.1)
    bump = dataclasses.replace(bump, tolerance=np.array([0.5, 0.1, 0.1]))
    trajectory = plan(program([((10, 0), 50), ((20, 0), 50)]), MACHINE)
    trajectory = dataclasses.replace(trajectory, move=np.array([0, 2], np.int32))
    assert certify(trajectory, bump, MACHINE).path.ratio == pytest.approx(3)


def test_chord_may_not_replace_a_path_that_runs_back():
    there_and_back = program([((15, 0), 50), ((5, 0), 50), ((20, 0), 50)], tolerance=0.1)
    trajectory = plan(program([((20, 0), 50)]), MACHINE)
    trajectory = dataclasses.replace(trajectory, move=np.full(1, 2, np.int32))
    assert not certify(trajectory, there_and_back, MACHINE).passed


def test_other_coordinates_are_refused():
    trajectory = plan(CORNER, MACHINE)
    with pytest.raises(UsageError, match="4 coordinates"):
        certify(trajectory.mapped(MACHINE.motor_matrix()), CORNER, MACHINE)


def test_elements_in_another_order_than_their_moves_are_refused():
    trajectory = plan(CORNER, MACHINE)
    move = trajectory.move.copy()
    move[-1] = 0
    trajectory = dataclasses.replace(trajectory, move=move)
    with pytest.raises(UsageError, match=f"element {len(move) - 1} is of move 0"):
        certify(trajectory, CORNER, MACHINE)


def straight(*legs):
    """Return motion along X on elements of 10 mm, one per leg, and their moves.

    A leg is the path coordinates to go to: from rest to rest, with jerk of one size in four parts
    of half a second.
    """
    moves = program([((10.0 * (n + 1), 0), 50) for n in range(len(legs))], tolerance=0)
    law, element = [], []
    for n, places in enumerate(legs):
        for begin, end in pairwise(places):
            jerk = (end - begin) / (2 * 0.5**3)
            s, v, a = begin, 0.0, 0.0
            for j in (jerk, -jerk, -jerk, jerk):
                law.append([s, v, a / 2, j / 6])
                element.append(n)
                s, v, a = s + v / 2 + a / 8 + j / 48, v + a / 2 + j / 8, a + j / 2
    poly = np.zeros((len(legs), 4, 6))
    poly[:, 0, 0], poly[:, 1, 0] = 10.0 * np.arange(len(legs)), 1.0
    trajectory = dataclasses.replace(
        plan(moves, MACHINE),
        poly=poly,
        cosine=np.zeros((len(legs), 6)),
        sine=np.zeros((len(legs), 6)),
        omega=np.zeros(len(legs)),
        length=np.full(len(legs), 10.0),
        move=np.arange(len(legs), dtype=np.int32),
        element=np.array(element, np.int32),
        start=0.5 * np.arange(len(law) + 1),
        law=np.array(law),
    )
    return trajectory, moves


def test_straight_motion_passes():
    trajectory, moves = straight((0, 10), (0, 4, 10))
    assert certify(trajectory, moves, MACHINE).passed


def test_motion_beyond_the_end_of_a_move_is_found():
    trajectory, moves = straight((0, 10.5), (0.5, 10))  # rests at X10.5 instead of X10
    certificate = certify(trajectory, moves, MACHINE)
    assert certificate.deviation == pytest.approx(0.5)
    assert certificate.end_error == pytest.approx(0.5)
    assert not certificate.passed


@pytest.mark.parametrize("places", [(0, 10.5, 10), (0, -0.5, 10), (0, 6, 3, 10)])
def test_motion_backwards_is_found(places):
    certificate = certify(*straight(places), MACHINE)
    assert certificate.feed.ratio == math.inf
    assert (certificate.deviation >= 0.5) == (min(places) < 0 or max(places) > 10)
    assert not certificate.passed


@pytest.mark.parametrize("portion", [1, 2, 100])
@pytest.mark.parametrize("moves", [2, 3])
def test_a_circle_that_is_left_out_is_found(portion, moves, monkeypatch):
    monkeypatch.setattr(module, "PORTION", portion)
    circle = ((10, 0), 50, ((10, 10), 2 * np.pi))
    asked = program([((10, 0), 50), circle, ((20, 0), 50)][:moves], tolerance=0)
    trajectory = plan(asked, MACHINE)
    assert certify(trajectory, asked, MACHINE).passed
    kept = trajectory.move[trajectory.element] != 1
    time = np.diff(trajectory.start)[kept]
    trajectory = trajectory.timed(
        trajectory.element[kept], np.append(0, time.cumsum()), trajectory.law[kept]
    )
    certificate = certify(trajectory, asked, MACHINE)
    assert max(certificate.position_jump, certificate.end_error) >= 20 * np.pi * (1 - 1e-9)
    assert not certificate.passed


@pytest.mark.parametrize("column", ["poly", "omega", "length", "start", "law"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused(column, value):
    trajectory = plan(CORNER, MACHINE)
    values = getattr(trajectory, column).copy()
    values[2] = value
    trajectory = dataclasses.replace(trajectory, **{column: values})
    with pytest.raises(UsageError, match=rf"trajectory.{column}\[2.*must be finite"):
        certify(trajectory, CORNER, MACHINE)
    certifier = Certifier(MACHINE, CORNER.start)
    certifier.add(CORNER)
    with pytest.raises(UsageError, match="must be finite"):
        certifier.check(trajectory)


@pytest.mark.parametrize("portion", [1, 2, 5])
def test_portions_of_a_plan_are_certified_as_the_whole(portion, monkeypatch):
    monkeypatch.setattr(module, "PORTION", portion)
    trajectory = plan(CORNER, MACHINE)
    certificate = certify(trajectory, CORNER, MACHINE)
    assert certificate.passed
    assert certificate.deviation == pytest.approx(0.1)
    # Y is at its fastest on the second side, so after the piece that gets it there
    assert certificate.velocity[1].time > 1.0
    assert certificate.velocity[1].line == CORNER.line[1]


@pytest.mark.parametrize("portion", [1, 2, 5])
def test_portions_hide_no_gap_and_no_missing_rest(portion, monkeypatch):
    monkeypatch.setattr(module, "PORTION", portion)
    trajectory = plan(CORNER, MACHINE)
    for element in range(1, len(trajectory.length)):
        poly = trajectory.poly.copy()
        poly[element:, 0, 2] += 1.0  # Z
        certificate = certify(dataclasses.replace(trajectory, poly=poly), CORNER, MACHINE)
        assert certificate.position_jump == pytest.approx(1.0)
    stops = changed(tolerance=np.zeros(len(CORNER)))
    assert certify(trajectory, stops, MACHINE).missed_rests == 1
    assert certify(plan(stops, MACHINE), stops, MACHINE).missed_rests == 0


@compiled(error_model="numpy")
def interval(along, w: float, law, low: float, high: float) -> tuple:
    """Return what the certificate says of velocity, acceleration, jerk and its derivative."""
    return certificate_kernels._interval(along, 0, w, law, 0, low, high)


def rates(along, w, law, t):
    """Return the first four derivatives of position over time, from its series around ``t``."""
    ahead = np.polynomial.Polynomial([t, 1.0])
    s = np.polynomial.Polynomial(law)(ahead)
    turn = w * (s - s(0))
    cos, sin = math.cos(w * s(0)), math.sin(w * s(0))
    even, odd = 1 - turn**2 / 2 + turn**4 / 24, turn - turn**3 / 6  # exact up to t^4
    p1, p2, p3, c, d = along
    x = np.polynomial.Polynomial([0, p1, p2, p3])(s)
    x += c * (cos * even - sin * odd) + d * (sin * even + cos * odd)
    return [abs(x.deriv(k)(0)) for k in (1, 2, 3, 4)]


@pytest.mark.parametrize("seed", range(40))
def test_bounds_are_exact_at_a_time_and_hold_on_a_stretch(seed):
    random = np.random.default_rng(seed)
    along = random.normal(size=5) * ([1, 1, 1, 0, 0] if seed % 2 else 1)
    w = 0.0 if seed % 2 else random.uniform(0.2, 2)
    law = np.array([random.uniform(0, 1), 5.0, *random.normal(size=2)])  # forwards up to t = 1
    at = random.uniform(0, 0.9)
    found = interval(along[None], w, law[None], at, at)
    assert found == pytest.approx(rates(along, w, law, at), rel=1e-9)
    bounds = np.array(interval(along[None], w, law[None], at, at + 0.1))
    for t in np.linspace(at, at + 0.1, 50):
        assert (rates(along, w, law, t) <= bounds * (1 + 1e-12)).all()
