"""Planned trajectories: times by hand arithmetic, promises on random and real programs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pulsewright.errors import MotionLimitError, UsageError
from pulsewright.motion import path
from pulsewright.motion.cells import cells
from pulsewright.motion.certificate import certify
from pulsewright.motion.gcode import InterpreterSettings, interpret
from pulsewright.motion.law import law
from pulsewright.motion.machine import Machine
from pulsewright.motion.moves import MoveKind, Moves, Plane
from pulsewright.motion.path import peaks
from pulsewright.motion.plan import begin_times, plan
from pulsewright.motion.stream import Planner

# X, Y, Z: 60 mm/s, 500 mm/s^2; A: 180 degrees/s, 1000 degrees/s^2; all in 0.025 s at that
MACHINE = Machine.default()
RISE = 0.025


def program(steps, *, start=(0, 0, 0), tolerance=0.01):
    """Return moves from tuples (end, feed); feed None is a rapid; floats are dwells.

    A third entry (center, sweep) makes an arc in XY.
    """
    position = np.zeros(6)
    position[: len(start)] = start
    columns = {name: [] for name in ("kind", "rapid", "end", "center", "sweep", "feed", "dwell")}
    begin = position.copy()
    for step in steps:
        kind, center, sweep, feed, dwell = MoveKind.LINE, np.zeros(3), 0.0, 0.0, 0.0
        if isinstance(step, float):
            kind, dwell = MoveKind.DWELL, step
        else:
            position = position.copy()
            position[: len(step[0])] = step[0]
            feed = math.inf if step[1] is None else step[1]
            if len(step) > 2:
                kind, sweep = MoveKind.ARC, step[2][1]
                center[:2] = step[2][0]
        row = (kind, math.isinf(feed), position, center, sweep, feed, dwell)
        for column, value in zip(columns.values(), row, strict=True):
            column.append(value)
    n = len(columns["kind"])
    limits = np.zeros(n)
    limits[:] = tolerance
    return Moves(
        start=begin,
        kind=np.array(columns["kind"], np.int8),
        plane=np.full(n, Plane.XY, np.int8),
        rapid=np.array(columns["rapid"], bool),
        line=np.arange(1, n + 1, dtype=np.int32),
        end=np.array(columns["end"], float).reshape(n, 6),
        center=np.array(columns["center"], float).reshape(n, 3),
        sweep=np.array(columns["sweep"], float),
        feed=np.array(columns["feed"], float),
        dwell=np.array(columns["dwell"], float),
        tolerance=limits,
    )


def unbounded():
    """Return the machine with as much travel as anybody wants."""
    wide = {"min": -1e6, "max": 1e6}
    axes = {letter: axis.model_copy(update=wide) for letter, axis in MACHINE.axis.items()}
    return MACHINE.model_copy(update={"axis": axes})


def planned(moves, machine=MACHINE):
    """Plan, and insist on every promise."""
    trajectory = plan(moves, machine)
    certificate = certify(trajectory, moves, machine)
    assert certificate.passed, certificate.text()
    assert (np.diff(trajectory.element) >= 0).all()
    assert (np.diff(trajectory.start) >= 0).all()
    return trajectory


def close(duration, ideal, *, slack):
    """Check that a plan is not faster than physics allow, and hardly slower."""
    assert ideal * (1 - 1e-6) <= duration <= ideal * (1 + slack)


def test_long_move_is_a_trapezoid_with_rounded_corners():
    # to 50 mm/s in 0.1 s + 0.025 s, at half that speed in the mean
    trajectory = planned(program([((100, 0), 50)]))
    close(trajectory.duration, 100 / 50 + 0.1 + RISE, slack=0.005)
    assert trajectory.at(1.0, 1)[0, 0] == pytest.approx(50)
    time = np.linspace(0, trajectory.duration, 1000)
    assert 490 <= trajectory.at(time, 2)[:, 0].max() <= 500
    assert 16_000 <= trajectory.at(time, 3)[:, 0].max() <= 20_000
    assert trajectory.at(9.0)[0] == pytest.approx([100, 0, 0, 0, 0, 0], abs=1e-12)


def test_short_move_reaches_its_acceleration_only():
    # T/2 = x: 2 mm = 500 (x - 0.025) x
    trajectory = planned(program([((2, 0), 50)]))
    half = RISE / 2 + math.hypot(RISE / 2, math.sqrt(2 / 500))
    close(trajectory.duration, 2 * half, slack=0.001)


def test_shorter_move_is_limited_by_jerk_alone():
    # a quarter of the time each: up to some acceleration, down to its opposite, and back
    trajectory = planned(program([((0.1, 0), 50)]))
    close(trajectory.duration, 4 * (0.1 / 2 / 20_000) ** (1 / 3), slack=0.001)


@pytest.mark.parametrize("speed", [20, 60])
@pytest.mark.parametrize("way", [1e-3, 0.03, 0.3, 1.0, 3.0, 10.0, 100.0])
def test_line_takes_the_time_of_seven_pieces_of_constant_jerk(speed, way):
    """However fast and long it is."""

    def change(to):  # the time from rest, or to it
        return to / 500 + RISE if to > 500 * RISE else 2 * math.sqrt(to / 20_000)

    low, top = 0.0, speed  # the largest speed
    for _ in range(60 if speed * change(speed) > way else 0):
        middle = (low + top) / 2
        low, top = (middle, top) if middle * change(middle) < way else (low, middle)
    least = 2 * change(top) + (way - top * change(top)) / top
    close(planned(program([((way, 0), speed)])).duration, least, slack=0.001)


def test_rapid_uses_both_axes_to_their_limits():
    # along the diagonal each axis does 60 mm/s after 0.12 s + 0.025 s
    trajectory = planned(program([((90, 90), None)]))
    close(trajectory.duration, 90 / 60 + 0.12 + RISE, slack=0.005)


def test_slow_axis_limits_a_mixed_move():
    # 10 mm while A turns 180 degrees: A does 180 degrees/s after 0.18 s, X follows at 10 mm/s
    trajectory = planned(program([((10, 0, 0, 180), 50)]))
    close(trajectory.duration, 1 + 0.18 + RISE, slack=0.01)


def test_rotary_feed_is_in_degrees():
    # 90 degrees/s after 0.09 s
    trajectory = planned(program([((0, 0, 0, 180), 90)]))
    close(trajectory.duration, 2 + 0.09 + RISE, slack=0.005)


def test_zero_tolerance_stops_in_every_corner():
    square = [((100, 0), 50), ((100, 100), 50), ((0, 100), 50), ((0, 0), 50)]
    trajectory = planned(program(square, tolerance=0))
    close(trajectory.duration, 4 * (2.1 + RISE), slack=0.005)
    begin = begin_times(trajectory, 4)
    for corner, end in enumerate([(100, 0), (100, 100), (0, 100), (0, 0)], start=1):
        assert trajectory.at(begin[corner])[0, :2] == pytest.approx(end, abs=1e-9)
        assert abs(trajectory.at(begin[corner], 2)).max() < 1e-3


def test_square_corner_takes_all_of_the_tolerance():
    tolerance = 0.1
    trajectory = planned(program([((100, 0), 50), ((100, 100), 50)], tolerance=tolerance))
    corner = trajectory.at(begin_times(trajectory, 2)[1])[0, :2]
    assert math.dist(corner, (100, 0)) == pytest.approx(tolerance, rel=1e-6)
    assert corner[0] == pytest.approx(100 + -corner[1])  # on the bisector
    speed = np.hypot(*trajectory.at(begin_times(trajectory, 2)[1], 1)[0, :2])
    # the middle of the blend turns with 1 / d, d = 6 * 0.1 / sqrt 2, on each axis
    assert 5 <= speed <= math.sqrt(500 * 0.6 / math.sqrt(2))


def test_straight_continuation_keeps_its_speed():
    trajectory = planned(program([((40, 0), 50), ((100, 0), 50)]))
    close(trajectory.duration, 2.1 + RISE, slack=0.005)


def test_feed_changes_before_and_after_the_corner_of_a_straight_line():
    # 50 mm/s, then 20 mm/s: slows down on the fast move
    trajectory = planned(program([((50, 0), 50), ((100, 0), 20)]))
    up, down, stop = 0.1 + RISE, 0.06 + RISE, 0.04 + RISE
    fast = up + (50 - 25 * up - 35 * down) / 50 + down
    slow = (50 - 10 * stop) / 20 + stop
    close(trajectory.duration, fast + slow, slack=0.005)


def test_reversal_stops():
    trajectory = planned(program([((100, 0), 50), ((0, 0), 50)], tolerance=1.0))
    close(trajectory.duration, 4.2 + 2 * RISE, slack=0.005)
    assert trajectory.at(begin_times(trajectory, 2)[1])[0, 0] == pytest.approx(100, abs=1e-9)


def test_dwell_rests_where_it_stands():
    trajectory = planned(program([((10, 0), 50), 0.25, ((20, 0), 50)], tolerance=1.0))
    begin = begin_times(trajectory, 3)
    close(begin[1], 0.3 + RISE, slack=0.03)
    assert begin[2] - begin[1] == pytest.approx(0.25, abs=1e-12)
    assert trajectory.at([begin[1], begin[2]], 0)[:, 0] == pytest.approx([10, 10])
    assert begin[3] == trajectory.duration


def test_programs_without_motion():
    assert plan(program([]), MACHINE).duration == 0
    assert plan(program([]), MACHINE).at(1.0).tolist() == [[0] * 6]
    trajectory = planned(program([0.5, 0.25], start=(1, 2, 3)))
    assert trajectory.duration == 0.75
    assert trajectory.at(0.6).tolist() == [[1, 2, 3, 0, 0, 0]]
    still = planned(program([((1, 2, 3), 10)], start=(1, 2, 3)))
    assert (still.duration, still.at(0.0).tolist()) == (0, [[1, 2, 3, 0, 0, 0]])


def test_full_circle_at_moderate_feed_takes_its_circumference():
    # v^2 / r = 20 mm/s^2 leaves nearly all acceleration: 0.04 s + 0.025 s up and down
    arc = program([((20, 0), 20, ((0, 0), 2 * math.pi))], start=(20, 0))
    close(planned(arc).duration, 40 * math.pi / 20 + 0.04 + RISE, slack=0.005)


def test_helix_ends_at_its_height():
    arc = program([((20, 0, 5), 20, ((0, 0), 4 * math.pi))], start=(20, 0))
    length = math.hypot(80 * math.pi, 5)
    trajectory = planned(arc)
    close(trajectory.duration, length / 20 + 0.04 + RISE, slack=0.005)
    assert trajectory.at(trajectory.duration / 2)[0, 2] == pytest.approx(2.5, rel=0.01)


@pytest.mark.parametrize("chords", [100, 1000, 20_000])
def test_chorded_circle_is_driven_like_a_circle(chords):
    # feed far above the limits: each axis may do 60 mm/s, r = 20 mm needs 180 of 500 mm/s^2
    angle = np.linspace(0, 2 * np.pi, chords + 1)[1:]
    steps = [((20 * math.cos(a), 20 * math.sin(a)), 60) for a in angle]
    chorded = planned(program(steps, start=(20, 0)))
    around = 40 * math.pi / 60 + 60 / 500 + RISE
    assert chorded.duration <= 1.03 * around
    circle = planned(program([((20, 0), 60, ((0, 0), 2 * math.pi))], start=(20, 0)))
    assert circle.duration == pytest.approx(around, rel=0.03)


def test_noise_of_rounded_chords_does_not_slow_the_machine_down():
    # a circle in chords of 0.016 mm, rounded to 0.0001 inch: corners of up to 0.2 rad
    angle = np.linspace(0, 2 * np.pi, 10_001)[1:]
    points = np.round(np.column_stack([np.cos(angle), np.sin(angle)]), 4) * 25.4
    moves = program([(point, 60) for point in points], start=(25.4, 0))
    trajectory = planned(moves)
    assert trajectory.duration <= 1.1 * (25.4 * 2 * math.pi / 60 + 0.12 + RISE)


def fast(jerk):
    """Return a machine of 200 mm/s and 3000 mm/s^2."""
    changes = {"velocity": 200.0, "acceleration": 3000.0, "jerk": jerk}
    axes = {letter: axis.model_copy(update=changes) for letter, axis in MACHINE.axis.items()}
    return MACHINE.model_copy(update={"axis": axes})


@pytest.mark.parametrize("jerk", [1e9, 1e12, 1e300])
def test_a_jerk_limit_out_of_all_proportion_counts_as_a_millisecond(jerk):
    there_and_back = [((100, 0), 200), 10_000.0, ((0, 0), 200)]
    trajectory = planned(program(there_and_back), fast(jerk))
    once = 100 / 200 + 200 / 3000 + 0.001
    assert trajectory.duration - 10_000 == pytest.approx(2 * once, rel=1e-3)
    zigzag = program([((n, n % 2), 50) for n in range(1, 100)], tolerance=0.05)
    assert planned(zigzag, fast(jerk)).duration <= planned(zigzag, fast(3e5)).duration


@pytest.mark.parametrize(
    ("digits", "jerk"), [(3, 3e5), (4, 3e5), (6, 3e5), (12, 3e5), (9, 1e6), (12, 1e6)]
)
def test_chords_that_differ_by_rounding_are_driven_like_their_curve(digits, jerk):
    # on the circle, 7 % of 3e5 mm/s^3 and 2/3 of the acceleration are in use at 200 mm/s
    angle = np.linspace(0, 2 * np.pi, 181)[1:]
    points = np.round(20 * np.column_stack([np.cos(angle), np.sin(angle)]), digits)
    moves = program([(point, 200) for point in points], start=(20, 0), tolerance=0.02)
    trajectory = planned(moves, fast(jerk))
    assert trajectory.duration <= 1.02 * (40 * math.pi / 200 + 200 / 3000 + 3000 / jerk)


def test_blend_of_two_nearly_equal_lines_takes_all_of_them():
    steps = [((1, 0), 200), ((1 + 1.2 * math.cos(0.2), 1.2 * math.sin(0.2)), 200)]
    trajectory = planned(program(steps, tolerance=0.1), fast(3e5))
    assert trajectory.length == pytest.approx([0.5, 0.5, 0.6, 0.6])
    turn = np.array([math.cos(0.2) - 1, math.sin(0.2)])
    # curvature over the turn: a triangle of area 1, with its peak at the corner, ends 0.2 / 3 too
    # far to the right; u more in the middle of the first line and u / 1.2 less in that of the
    # second one keep the area, and move it by u (1 + 1.2) / 4
    peak, u = 2 / 2.2, 4 * 0.2 / 3 / 2.2
    middle = [peak / 2 + u, peak / 2 - u / 1.2]
    bends = np.array([0, middle[0], peak, middle[1]])
    assert 2 * trajectory.poly[:, 2, :2] == pytest.approx(bends[:, None] * turn, abs=1e-12)
    deviation = peak * 1.2**2 / 6 - u / 1.2 * 1.2**2 / 4  # first moment of the right half
    assert trajectory.poly[2, 0, :2] == pytest.approx([1, 0] + deviation * turn, abs=1e-12)


def wavy(count=200, height=0.05):
    """Return 0.5 mm chords along X to and fro by ``height`` on either side of it."""
    points = [(0.5 * n, height * (-1) ** n) for n in range(1, count)]
    return [((0.5, 0), 50), *((point, 50) for point in points[1:]), ((0.5 * count, 0), 50)]


def test_short_lines_collapse_within_q():
    moves = program(wavy(), tolerance=0.03)
    rough = planned(moves)
    line = planned(replace(moves, collapse=np.full(len(moves), 0.15)))
    # 100 mm nearly straight, at 50 mm/s
    close(line.duration, 2.1 + RISE, slack=0.05)
    assert rough.duration > 1.5 * line.duration
    assert len(set(line.move)) < 10
    time = np.linspace(0, line.duration, 10_000)
    assert abs(line.at(time)[:, 1]).max() <= 0.05 + 0.15
    # no more than the tolerance, or of other lines: as if nothing had been said
    for q in (0.03, np.where(np.arange(len(moves)) % 2, 0.15, 0.0)):
        same = planned(replace(moves, collapse=np.broadcast_to(q, len(moves)).copy()))
        assert same.duration == rough.duration


def test_a_loose_corner_beside_a_chord_leaves_the_corners_it_stands_for_where_they_are():
    # a line of 0.018 mm is taken into the next one; 0.2 mm are allowed only where it begins
    moves = program([((10, 0), 10), ((10.018, 0), 10), ((10.018, 1), 10), ((0, 1), 10)])
    moves = replace(
        moves,
        tolerance=np.array([0.2, 0.002, 0.002, 0.0]),
        collapse=np.array([0.2, 0.02, 0.02, 0.02]),
    )
    trajectory = planned(moves)
    assert 1 not in trajectory.move
    x = trajectory.at(np.linspace(0, trajectory.duration, 100_000))[:, :2]
    assert np.hypot(*(x - [10.018, 0]).T).min() <= 0.02


def test_rapids_and_exact_stops_do_not_collapse():
    steps = [(end, None) for end, _ in wavy(20)]
    q = np.full(len(steps), 0.15)
    rapids = planned(replace(program(steps, tolerance=0.03), collapse=q))
    assert rapids.duration == planned(program(steps, tolerance=0.03)).duration
    stops = planned(replace(program(wavy(20), tolerance=0), collapse=q))
    assert stops.duration == planned(program(wavy(20), tolerance=0)).duration


def test_slow_chords_are_left_as_they_are():
    angle = np.linspace(0, np.pi, 101)[1:]
    points = np.column_stack([np.cos(angle), np.sin(angle)])
    trajectory = planned(program([(point, 1) for point in points], start=(1, 0)))
    assert set(trajectory.move) == set(range(100))


def test_half_of_a_blend_belongs_to_the_move_on_its_side_of_the_corner():
    trajectory = planned(program([((10, 0), 50), ((10, 10), 50), ((0, 10), 50)]))
    assert trajectory.move.tolist() == [0, 0, 1, 1, 1, 2, 2]


def test_move_between_two_large_blends_does_not_vanish():
    # the second move is short and continues straight; a blend of 1 mm would swallow it whole
    steps = [((10, 0), 60), ((10, 0.1), 60), ((10, 20), 5)]
    trajectory = planned(program(steps, tolerance=1.0))
    assert set(trajectory.move) == {0, 1, 2}


def test_travel_is_checked():
    with pytest.raises(MotionLimitError, match="line 1: X reaches 401 mm"):
        plan(program([((401, 0), 50)]), MACHINE)


@pytest.mark.parametrize(
    ("column", "value", "rule"),
    [
        ("end", math.nan, r"moves.end\[1\] is .*line 2.*must be finite"),
        ("end", math.inf, "finite"),
        ("center", math.nan, "finite"),
        ("sweep", 0.0, "finite and not 0"),
        ("feed", 0.0, "above 0"),
        ("feed", math.nan, "above 0"),
        ("tolerance", math.inf, "finite, 0 or more"),
        ("dwell", -1.0, "finite, 0 or more"),
        ("kind", 7, "that of a MoveKind"),
        ("plane", 3, "that of a Plane"),
    ],
)
def test_moves_made_by_hand_that_mean_nothing_are_refused(column, value, rule):
    moves = program([((10, 0), 10), ((10, 10), 10, ((10, 5), math.pi))])
    wrong = getattr(moves, column).copy()
    wrong[1] = value
    with pytest.raises(UsageError, match=rule):
        plan(replace(moves, **{column: wrong}), MACHINE)
    planner = Planner(MACHINE)
    with pytest.raises(UsageError, match=rule):
        planner.add(replace(moves, **{column: wrong}))


def test_columns_of_moves_are_arrays_of_one_length_and_their_types():
    moves = program([((10, 0), 10)])
    for wrong, found in [
        ({"feed": np.ones(2)}, r"moves.feed is float64 \(2,\); for 1 moves"),
        ({"feed": [10.0]}, r"moves.feed is list"),
        ({"end": moves.end.astype(np.float32)}, r"must be an array of float64 \(1, 6\)"),
        ({"start": np.full(6, math.nan)}, "positions must be finite"),
    ]:
        with pytest.raises(UsageError, match=found):
            plan(replace(moves, **wrong), MACHINE)


def test_long_programs_do_not_drift():
    # 10 000 moves of 0.25 mm with stops, all alike
    steps = [((0.25 * (n % 2), 0), 50) for n in range(1, 10_001)]
    trajectory = planned(program(steps, tolerance=0))
    alone = planned(program(steps[:1], tolerance=0)).duration
    assert trajectory.duration == pytest.approx(1e4 * alone, rel=1e-9)


def random_program(seed):
    """Return up to 60 moves of every kind, of sizes from 1e-5 to 30 mm, some of them degenerate."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 60))
    size = 10 ** rng.uniform(-5, 1.5)
    kind, plane = np.zeros(n, np.int8), np.full(n, Plane.XY, np.int8)
    center, sweep, dwell = np.zeros((n, 3)), np.zeros(n), np.zeros(n)
    end = np.zeros((n, 6))
    x, heading = np.zeros(6), rng.normal(size=3)
    for i in range(n):
        choice = rng.integers(8)
        if choice == 0:
            x[:3] += rng.normal(0, size, 3)
        elif choice == 1:
            x[rng.integers(4)] += rng.normal(0, size)
        elif choice in (2, 3):
            heading += rng.normal(0, 0.1, 3)
            x[:3] += heading * size
        elif choice == 4:
            x[:4] += rng.normal(0, size, 4)
        elif choice == 5:
            kind[i], dwell[i] = MoveKind.DWELL, rng.choice([0, 0.5])
        elif choice == 6:
            kind[i], plane[i] = MoveKind.ARC, rng.integers(3)
            first, second = Plane(plane[i]).axes
            arm = rng.normal(0, size, 2)
            turn = rng.choice([-1, 1]) * rng.choice([rng.uniform(0.01, 6), np.pi / 2, 4 * np.pi])
            center[i, [first, second]] = x[[first, second]] - arm
            stretch = 1 + rng.choice([0, 1e-3])
            cos, sin = math.cos(turn) * stretch, math.sin(turn) * stretch
            x[first] = center[i, first] + arm[0] * cos - arm[1] * sin
            x[second] = center[i, second] + arm[0] * sin + arm[1] * cos
            x[plane[i]] += rng.choice([0, size])
            sweep[i] = turn
        end[i] = x
        x = x.copy()
    rapid = rng.random(n) < 0.1
    tolerance = rng.choice([0, 1e-3, 0.01, 0.1, 1, 10], n)
    if rng.random() < 0.5:
        tolerance[:] = 0.05
    feed = rng.uniform(1, 100, n) if rng.random() < 0.5 else np.full(n, 50.0)
    line = np.arange(1, n + 1, dtype=np.int32)
    columns = kind, plane, rapid, line, end, center, sweep, feed, dwell, tolerance
    return Moves(np.zeros(6), *columns)


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_every_promise_is_kept_on_random_programs(seed):
    moves, wide = random_program(seed), unbounded()
    trajectory = planned(moves, wide)
    assert math.isfinite(trajectory.duration)
    # the certificate's bounds, sampled
    time = np.linspace(0, trajectory.duration, 2000)
    rows, velocity, acceleration = wide.limit_rows()
    assert (np.abs(trajectory.at(time, 1) @ rows.T) <= velocity).all()
    assert (np.abs(trajectory.at(time, 2) @ rows.T) <= acceleration).all()
    assert (np.abs(trajectory.at(time, 3) @ rows.T) <= wide.jerk_limits()).all()


def test_fast_rotary_motion_keeps_the_tolerance_on_the_smallest_arcs():
    """Far from zero nobody knows the length of such an arc, but to 1e-10 of it: much of A."""
    rng = np.random.default_rng(3)
    for _ in range(30):
        start = place = rng.uniform(-500, 500, 2)
        steps, turned = [], 0.0
        for _ in range(6):
            radius, angle = 10 ** rng.uniform(-4, -2), rng.uniform(0, 2 * math.pi)
            sweep = rng.choice([-1, 1]) * rng.uniform(0.1, 6)
            center = place - radius * np.array([math.cos(angle), math.sin(angle)])
            angle += sweep
            place = center + radius * np.array([math.cos(angle), math.sin(angle)])
            turned += rng.choice([0, rng.uniform(-360, 360), rng.uniform(-5000, 5000)])
            steps.append(((*place, 0.0, turned), 10.0, (center, sweep)))
        tolerance = 10 ** rng.uniform(-5, -1)
        planned(program(steps, start=start, tolerance=tolerance), unbounded())


@pytest.mark.parametrize(
    ("name", "slowest"),  # against length over feed, where no corner needs braking: 1.02; short
    # moves with corners take longest, for 25 ms of building up acceleration go by at each of them
    [
        ("arcspiral.ngc", 1.02),
        ("cds.ngc", 1.05),
        ("circle_small_segments_ncd.ngc", 1.25),
        ("tiger.nc", 1.05),
        ("trochoidal.ngc", 1.5),
        ("wave.gcode", 1.02),
        ("wheels.ngc", 2.1),
        ("3D_Chips.ngc", 1.65),
        ("vcarve.ngc", 1.85),
        ("tort.ngc", math.inf),
        ("zigzag_0.002_0.001.ngc", math.inf),
        ("daisy.ngc", math.inf),
        ("flowsnake.ngc", math.inf),
        ("spiral.ngc", math.inf),
        ("useful-subroutines.ngc", math.inf),
    ],
)
def test_promises_and_speed_on_real_programs(corpus, name, slowest):
    tolerances = {"path_tolerance": 0.01, "exact_tolerance": 0.0003}
    moves = interpret(corpus / name, settings=InterpreterSettings(axes="XYZA", **tolerances)).moves
    trajectory = planned(moves)
    delta = (moves.end - moves.starts())[:, :3]
    length = np.linalg.norm(delta, axis=1)  # of the chords of arcs
    with np.errstate(invalid="ignore"):
        along = np.abs(delta / length[:, None]).max(axis=1)
        ideal = np.nansum(length / np.minimum(moves.feed, 60 / along))
    assert ideal <= 1.2 * trajectory.duration
    assert trajectory.duration <= slowest * ideal


@pytest.mark.parametrize(
    ("begin", "end", "slope", "wave"),
    [
        (0, 90, 1, 1),
        (45, 60, math.sqrt(3) / 2, math.sqrt(1 / 2)),
        (45, 120, 1, math.sqrt(1 / 2)),  # steepest inside, at 90
        (-30, 30, 1 / 2, 1),  # highest inside, at 0
        (30, 230, 1, 1),
    ],
)
def test_a_wave_is_bounded_by_its_ends_and_by_peaks_between_them(begin, end, slope, wave):
    """Of 2 cos(u), from begin to end [degrees]."""
    u, v = math.radians(begin), math.radians(end)
    ends = math.cos(u), math.sin(u), math.cos(v), math.sin(v)
    assert peaks(2.0, 0.0, *ends, v - u) == pytest.approx((2 * slope, 2 * wave))


def test_a_cell_that_speeds_up_and_down_again_is_cut_where_its_elements_meet():
    """Newton's method alone jumped to and fro between the cell's ends, and never met the place."""
    half = 0.0056232693
    poly = np.zeros((2, 4, 6))
    poly[:, 1, 0] = 1.0
    poly[1, 0, 0] = half
    none, zero, one = np.zeros((2, 6)), np.zeros(2), np.ones(2)
    line = path.Elements(
        *(poly, none, none, zero, np.full(2, half), np.arange(2, dtype=np.int32), zero, one),
        rest=np.array([False, True]),
    )
    element, start, piece = law(
        line,
        *(np.zeros(1, np.int64), np.zeros(1), np.array([2 * half])),
        b=np.array([0.0130227488, 0.07405690]) ** 2,
        a=np.array([0.085175884, -7.050759983]),
        split=np.array([0.14274]),
    )
    assert set(element) == {0, 1}
    ends = np.sum(piece * np.diff(start)[:, None] ** np.arange(4), axis=1)
    assert ends[element == 0][-1] == pytest.approx(half, abs=1e-15)
    assert piece[element == 1][0, 0] == 0.0
    assert ends[element == 1][-1] == pytest.approx(half, abs=1e-12)


def test_limits_may_be_along_combinations_of_axes():
    """A mm of the path is sqrt(1/2) mm of X and of Y: together sqrt(2) mm along their sum."""
    moves = program([((10, 10), 100)])
    columns = path.Columns(*(getattr(moves, name) for name in path.Columns._fields))
    rows = np.array([[0.0, 0, 1, 0, 0, 0], [1, 1, 0, 0, 0, 0]])
    limits = np.array([7.0, 2]), np.array([7.0, 30]), np.array([7.0, 400])  # of Z, and of the sum
    elements, along, *_ = path.blended(columns, rows, *limits)
    assert along.rows.tolist() == [[1, 1, 0, 0, 0, 0]]  # Z does not move
    share = cells(elements, along, 0.0).share
    assert share[0, 0, :3] == pytest.approx(math.sqrt(2) / np.array([2, 30, 400]))
