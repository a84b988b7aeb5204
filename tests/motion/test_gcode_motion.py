"""Programs to moves: ends, arcs, frames, feeds, tolerances, events; expected by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pulsewright.errors import GcodeError, UsageError
from pulsewright.motion.gcode import InterpreterSettings, interpret, interpret_text
from pulsewright.motion.moves import Event, MoveKind, Plane

PROGRAMS = __file__.rsplit("/", 1)[0] + "/programs"
TAU = math.tau


def moves(text, **settings):
    return interpret_text(text, settings=InterpreterSettings(**settings)).moves


def ends(text, axes=3, **settings):
    return np.round(moves(text, **settings).end[:, :axes], 9).tolist()


def events(text, **settings):
    program = interpret_text(text, settings=InterpreterSettings(**settings))
    return [(e.at, e.line, e.kind, e.value, e.text) for e in program.events]


# Straight moves


def test_lines_and_rapids_in_columns():
    m = moves("G0 X10 Y5\nG1 Z-2 F300\n\nX20\nG0 Z5")
    assert m.end[:, :3].tolist() == [[10, 5, 0], [10, 5, -2], [20, 5, -2], [20, 5, 5]]
    assert m.rapid.tolist() == [True, False, False, True]
    assert m.feed.tolist() == [math.inf, 5, 5, math.inf]  # 300 mm/min
    assert m.line.tolist() == [1, 2, 4, 5]
    assert m.kind.tolist() == [MoveKind.LINE] * 4
    assert m.start.tolist() == [0] * 6


def test_the_start_position_is_kept_by_axes_that_do_not_move():
    assert ends("G0 X1", axes=6, start=(9, 2, 3, 4, 5, 6)) == [[1, 2, 3, 4, 5, 6]]


def test_inches():
    m = moves("G20 G0 X1 Y.5\nG1 X2 F60\nG21 X0")
    assert m.end[:, :2].tolist() == [[25.4, 12.7], [50.8, 12.7], [0, 12.7]]
    # 60 inch/min; a change of units alone leaves the speed as it is
    assert m.feed[1:] == pytest.approx([25.4, 25.4])


def test_feed_is_in_the_units_of_its_own_line():
    assert moves("G20 F60 G1 X1").feed == pytest.approx([25.4])
    assert moves("G20\nF60 G21 G1 X1").feed == pytest.approx([1])


def test_incremental_distances():
    assert ends("G0 X1 Y1\nG91 X1\nX1 Y-3\nG90 X1") == [
        [1, 1, 0],
        [2, 1, 0],
        [3, -2, 0],
        [1, -2, 0],
    ]


def test_moves_of_no_length_are_dropped_with_their_modes_kept():
    m = moves("G0 X1\nX1\nG1 X1 F60\nG91 X0\nG90 X2")
    assert m.end[:, 0].tolist() == [1, 2]
    assert m.feed.tolist() == [math.inf, 1]
    # 0.1 + 0.2 is not 0.3, but by rounding alone
    assert ends("G91 G0 X.1\nX.2\nG90 X.3") == [[0.1, 0, 0], [0.3, 0, 0]]


@pytest.mark.parametrize(
    ("words", "end"),
    [
        ("A350", [350]),
        ("A350\nA10", [350, 370]),  # onwards past 360
        ("A350\nA10\nA-10", [350, 370]),  # is there
        ("A350\nA10\nA-350", [350, 370, 350]),  # backwards
        ("A90\nA-0", [90, 0]),
        ("A90\nA-180", [90, -180]),
        ("A90\nA-180\nA0", [90, -180, 0]),
        ("A90\nA-180\nA200", [90, -180, -160]),
        ("A90\nG91 A720\nG90 A80", [90, 810, 1160]),
        ("A90\nG10 L2 P1 A30\nA90", [90, 120]),
        ("A100\nG10 L2 P1 A30\nG53 G1 A45\nG53 G1 A-20", [100, 405, 380]),
        ("A100\nG92 A10\nA0", [100, 450]),
        ("A100\nG28", [100, 360]),
        ("A-100\nG28.1\nA5\nG28", [-260, 5, 100]),
        (
            "A.1\nA[0.1+0.000000000001]\nA[0.1-0.000000000001]",
            [0.1],
        ),  # rounding is no reason for a turn
    ],
)
def test_a_wrapped_axis_goes_on_to_a_place_within_a_turn_or_back_by_the_sign(words, end):
    m = moves(f"G1 F100 {words}", axes="XYZA", wrapped="A")
    assert m.end[:, 3] == pytest.approx(end, abs=1e-9)


def test_a_wrapped_axis_turns_alike_in_a_long_program():
    turns = "A350 B350\nA10 B10\nA-350 B-350\n" * 1000
    m = moves(f"G1 F100 X1\n{turns}", axes="XYZAB", wrapped="A")
    # on past 360 and back, and to the same place; and as the numbers are
    assert m.end[1:4, 3:5].tolist() == [[350, 350], [370, 10], [350, -350]]
    assert m.end[1:, 3].tolist() == [350, 370, 350] * 1000


@pytest.mark.parametrize("word", ["A360", "A-360", "G53 A360"])
def test_a_wrapped_axis_has_no_place_beyond_a_turn(word):
    with pytest.raises(GcodeError, match=r"axis A is wrapped.*below 360"):
        moves(f"G1 F100 X1\n{word}", axes="XYZA", wrapped="A")


def test_only_rotary_axes_of_the_machine_are_wrapped():
    for wrapped in ("X", "B"):
        with pytest.raises(UsageError, match=f"not {wrapped}"):
            InterpreterSettings(axes="XYZA", wrapped=wrapped)


def test_rotary_axes_are_degrees_in_any_units():
    m = moves("G20 G1 A90 F360\nX1 A0 F60", axes="XYZA")
    assert m.end[:, [0, 3]].tolist() == [[0, 90], [25.4, 0]]
    assert m.feed == pytest.approx([6, 25.4])  # 360 degrees/min, then 60 inch/min along X


def test_inverse_time_feed_sets_the_time_of_each_move():
    # F6: 1/6 min = 10 s for each move
    m = moves("G93 G1 X30 Y40 F6\nA90 F6\nX0 A0 F6\nG3 X0 Y0 I0 J-20 F6", axes="XYZA")
    assert m.feed == pytest.approx([5, 9, 3, 2 * math.pi])  # 50 mm, 90 degrees, 30 mm, 20 pi mm


def test_inverse_time_feed_counts_the_rise_of_a_helix():
    # half a turn of radius 10 and 5 up in 10 s
    m = moves("G93 G2 X20 I10 Z5 F6")
    assert m.feed == pytest.approx([math.sqrt((10 * math.pi) ** 2 + 25) / 10])


def test_g53_moves_in_machine_coordinates_whatever_the_offsets():
    offsets = {"work_offsets": {"G54": (10, 20, 30, 0, 0, 0)}, "tools": {1: 5.0}}
    text = "G43 H1\nG92 X3\nG0 X1 Y1 Z1\nG53 X1 Z1\nG53 G1 Y2 F60"
    assert ends(text, **offsets)[1:] == [[1, 21, 1], [1, 2, 1]]


def test_a_motion_code_alone_only_sets_the_mode():
    assert ends("G1\nF60 X1\nG0\nX2") == [[1, 0, 0], [2, 0, 0]]
    assert moves("G1\nF60 X1\nG0\nX2").rapid.tolist() == [False, True]


# Arcs


def test_quarter_arc_by_its_centre():
    m = moves("G0 X10\nG3 X0 Y10 I-10 J0 F60")
    assert m.kind[1] == MoveKind.ARC
    assert m.plane[1] == Plane.XY
    assert m.center[1, :2].tolist() == [0, 0]
    assert m.sweep[1] == pytest.approx(TAU / 4)
    assert m.end[1, :3].tolist() == [0, 10, 0]
    assert m.feed[1] == 1
    assert moves("G0 X10\nG2 X0 Y10 I-10 F60").sweep[1] == pytest.approx(-TAU * 3 / 4)


@pytest.mark.parametrize(
    ("code", "plane", "text", "end", "center"),
    [
        # a quarter turn counterclockwise seen against Z, Y or X: X to Y, Z to X, Y to Z
        ("G17", Plane.XY, "G0 X5 Y1\nG3 X0 Y6 I-5", (0, 6, 0), (0, 1, 0)),
        ("G18", Plane.ZX, "G0 Z5 X1\nG3 Z0 X6 K-5", (6, 0, 0), (1, 0, 0)),
        ("G19", Plane.YZ, "G0 Y5 Z1\nG3 Y0 Z6 J-5", (0, 0, 6), (0, 0, 1)),
    ],
)
def test_planes(code, plane, text, end, center):
    m = moves(f"{code} F60\n{text}")
    assert m.plane[1] == plane
    assert m.end[1, :3].tolist() == list(end)
    assert m.center[1].tolist() == list(center)
    assert m.sweep[1] == pytest.approx(TAU / 4)


def test_clockwise_in_g18_goes_from_x_to_z():
    m = moves("G18 F60 G0 X5\nG2 X0 Z5 I-5")
    assert m.sweep[1] == pytest.approx(-TAU / 4)


def test_full_circles_turns_and_helices():
    m = moves("F60\nG2 I5\nG3 I5 P3\nG3 X10 I5 Z-6 P2\nJ-4")
    assert m.sweep == pytest.approx([-TAU, 3 * TAU, TAU * 1.5, TAU])
    assert m.end[:, :3].tolist() == [[0, 0, 0], [0, 0, 0], [10, 0, -6], [10, 0, -6]]
    assert m.center[:, :2].tolist() == [[5, 0], [5, 0], [5, 0], [10, -4]]


@pytest.mark.parametrize(
    ("code", "radius", "center", "sweep"),
    [
        # from (0, 0) to (8, 0); a radius of 5 has its centre 3 above or below the chord
        ("G3", 5, (4, 3), 2 * math.asin(0.8)),
        ("G3", -5, (4, -3), TAU - 2 * math.asin(0.8)),
        ("G2", 5, (4, -3), -2 * math.asin(0.8)),
        ("G2", -5, (4, 3), 2 * math.asin(0.8) - TAU),
        ("G3", 4, (4, 0), TAU / 2),
        ("G3", 3.9995, (4, 0), TAU / 2),  # short by rounding: half a circle
    ],
)
def test_arcs_by_radius(code, radius, center, sweep):
    m = moves(f"F60 {code} X8 R{radius}")
    assert m.center[0, :2] == pytest.approx(center)
    assert m.sweep[0] == pytest.approx(sweep)


def test_absolute_centres_follow_the_offsets():
    text = "G90.1 F60\nG3 X2 Y2 I1 J1\nG91.1 G3 I1 J0"
    origin = (10, 0, 0, 0, 0, 0)
    m = moves(text, work_offsets={"G54": origin}, start=origin)
    assert m.center[:, :2].tolist() == [[11, 1], [13, 2]]
    assert m.sweep == pytest.approx([TAU / 2, TAU])


def test_arcs_in_inches_and_increments():
    m = moves("G20 G91 F60\nG3 X1 Y1 J1\nX-1 Y1 I-1 J0\nG2 X-1 Y-1 R1")
    assert m.end[:, :2] == pytest.approx(25.4 * np.array([[1, 1], [0, 2], [-1, 1]]))
    assert m.center[:, :2] == pytest.approx(25.4 * np.array([[0, 1], [0, 1], [-1, 2]]), abs=1e-9)
    assert m.sweep == pytest.approx([TAU / 4, TAU / 4, -TAU / 4])


@pytest.mark.parametrize(
    ("units", "radius", "difference", "accepted"),
    [
        # as rs274 was found to have it by bisection
        # mm: 0.02828, or 0.1 % where that is more, but never more than 2.828
        ("G21", 1, 0.0282, True),
        ("G21", 1, 0.0284, False),
        ("G21", 100, 0.099, True),
        ("G21", 100, 0.101, False),
        ("G21", 5000, 2.82, True),
        ("G21", 5000, 2.84, False),
        # inch: 0.002828, or 0.1 %, never more than 0.2828
        ("G20", 0.1, 0.00282, True),
        ("G20", 0.1, 0.00284, False),
        ("G20", 10, 0.0099, True),
        ("G20", 10, 0.0102, False),
        ("G20", 500, 0.282, True),
        ("G20", 500, 0.284, False),
    ],
)
def test_radii_of_an_arc_may_differ_a_little(units, radius, difference, accepted):
    text = f"{units} F60\nG3 X{2 * radius - difference} I{radius}"
    if accepted:
        assert moves(text).sweep[0] == pytest.approx(math.pi)
    else:
        with pytest.raises(ValueError, match="at its start and"):
            moves(text)


@settings(deadline=None)
@given(
    st.floats(0.5, 100),
    st.floats(0, TAU),
    st.floats(0.01, TAU - 0.01),
    st.booleans(),
    st.booleans(),
)
def test_radius_and_centre_give_the_same_arc(radius, first, angle, clockwise, inches):
    """R with the sign of a short or long arc finds the centre that I and J would have named."""
    turn = -angle if clockwise else angle
    i, j = -radius * math.cos(first), -radius * math.sin(first)
    x, y = i + radius * math.cos(first + turn), j + radius * math.sin(first + turn)
    sign = -1 if angle > math.pi else 1
    if abs(angle - math.pi) < 1e-3:  # nearly half a turn: the centre is not well defined by R
        return
    head = f"{'G20' if inches else 'G21'} F60 {'G2' if clockwise else 'G3'} X{x:.12f} Y{y:.12f}"
    by_radius = moves(f"{head} R{sign * radius:.12f}")
    by_center = moves(f"{head} I{i:.12f} J{j:.12f}")
    assert by_radius.sweep[0] == pytest.approx(turn, abs=1e-6)
    assert by_center.sweep[0] == pytest.approx(turn, abs=1e-9)
    assert by_radius.center[0] == pytest.approx(by_center.center[0], abs=1e-5)


def test_an_arc_may_carry_rotary_axes_along():
    m = moves("F60 G3 X10 I5 A90", axes="XYZA")
    assert m.end[0, [0, 3]].tolist() == [10, 90]


# Frames


def test_coordinate_systems():
    offsets = {"G54": (1, 0, 0, 0, 0, 0), "G55": (0, 2, 0, 0, 0, 0), "G59.3": (0, 0, 3, 0, 0, 0)}
    text = "G0 X1 Y1 Z1\nG55 X1 Y1 Z1\nG59.3 X1 Y1 Z1\nG56 X1 Y1 Z1"
    assert ends(text, work_offsets=offsets) == [[2, 1, 1], [1, 3, 1], [1, 1, 4], [1, 1, 1]]


def test_g10_l2_sets_an_origin_and_l20_the_present_position():
    assert ends("G10 L2 P2 X10\nG0 X1\nG55 X1\nG10 L2 P0 X20\nX1") == [
        [1, 0, 0],
        [11, 0, 0],
        [21, 0, 0],
    ]
    # at machine 7, calling it 2 puts the origin at 5
    assert ends("G0 X7\nG10 L20 P1 X2\nX0") == [[7, 0, 0], [5, 0, 0]]
    # with a G92 offset of 3 as well, the origin is at 2: 7 = 2 + 3 + 2
    assert ends("G92 X-3\nG0 X4\nG10 L20 P3 X2\nG92.1 G56\nX0") == [[7, 0, 0], [2, 0, 0]]


def test_g92_and_its_variants():
    text = "G0 X10\nG92 X2\nX0\nG92.2\nX0\nG92.3\nX1\nG92.1\nX1\nG92.3\nX2"
    assert [x for x, *_ in ends(text)] == [10, 8, 0, 9, 1, 2]


def test_offsets_add_up_and_follow_units():
    text = "G20 G10 L2 P1 X1\nG92 X1\nG21\nG0 X0"
    # origin at 25.4; machine 0 is called 1 inch, so program 0 is at -25.4
    assert ends(text) == [[-25.4, 0, 0]]


def test_tool_length():
    tools = {1: 5.0, 2: 7.5}
    assert ends("G0 Z1\nG43 H1\nZ1\nG43 H2 Z1\nG49 Z2\nG43 H0 Z3", tools=tools) == [
        [0, 0, 1],
        [0, 0, 6],
        [0, 0, 8.5],
        [0, 0, 2],
        [0, 0, 3],
    ]
    assert ends("T2 M6\nG43\nG0 Z0", tools=tools) == [[0, 0, 7.5]]
    assert ends("G43 H9\nG0 Z1") == [[0, 0, 1]]  # no tool table: all lengths are 0


def test_g28_and_g30_return_by_way_of_a_point():
    home = {"home": (1, 2, 3, 0, 0, 0), "second_home": (0, 0, 50, 0, 0, 0)}
    assert ends("G0 X9 Y9 Z9\nG28 Z20", **home)[1:] == [[9, 9, 20], [9, 9, 3]]
    assert ends("G0 X9 Y9 Z9\nG28", **home)[1:] == [[1, 2, 3]]
    assert ends("G0 X9\nG91 G30 Z5", **home)[1:] == [[9, 0, 5], [9, 0, 50]]
    assert ends("G0 X5 Y6\nG28.1\nX0 Y0\nG30.1\nG28\nG30", **home)[2:] == [[5, 6, 0], [0, 0, 0]]
    assert moves("G0 X9\nG1 X8 F60\nG28 X7", **home).rapid.tolist() == [True, False, True, True]


# Splines


def test_a_rational_spline_is_a_quarter_circle():
    """Weights 1, 1/sqrt(2), 1 at the corners of a square make one, exactly."""
    m = moves("F60 G0 X10 Y0\nG5.2 P1 L3\nX10 Y10 P[SQRT[0.5]]\nX0 Y10 P1\nG5.3")
    assert np.hypot(m.end[1:, 0], m.end[1:, 1]) == pytest.approx(10)
    assert m.end[-1, :2].tolist() == [0, 10]
    # of such a chord the middle lies inside by length^2 / 8 / radius
    chords = np.hypot(*np.diff(m.end[:, :2], axis=0).T)
    assert chords.max() ** 2 / 80 < 1e-3
    assert len(m) < 100


def test_cubics_and_quadratics_pass_where_their_control_points_say():
    """In the middle: eighths 1 3 3 1 and quarters 1 2 1 of the control points."""
    m = moves("F60\nG5 X8 Y8 I0 J4 P4 Q0\nG5 X16 Y16 P-4 Q0\nG0 X0 Y0\nG5.1 X4 Y0 I2 J4")
    ends = m.end[:, :2]

    def passes(x, y):
        return np.hypot(ends[:, 0] - x, ends[:, 1] - y).min() < 1e-9

    assert passes((0 + 0 + 36 + 8) / 8, (0 + 12 + 24 + 8) / 8)
    # the second goes on straight: its first control point is (8 - 4, 8)
    assert passes((8 + 12 + 36 + 16) / 8, (8 + 24 + 48 + 16) / 8)
    assert passes((0 + 4 + 4) / 4, (0 + 8 + 0) / 4)


def test_order_two_is_straight_lines_and_stops_are_at_the_end_of_a_spline():
    m = moves("F60 G61.1\nG5.2 X4 Y0 L2\nX4 Y4 P1\nG5.3\nG0 X0 Y4")
    on = (m.end[:-1, 1] == 0) | (m.end[:-1, 0] == 4)
    assert on.all()
    assert (m.tolerance == 0).tolist() == [False] * (len(m) - 2) + [True, True]
    assert moves("G20 F9 G10 L2 P1 R90\nG5 X1 Y0 I1 J1 P-1 Q1").end[-1, :2].tolist() == [0, 25.4]


def test_parameters_in_words_and_position_parameters():
    text = "#1=3\n#<wide>=[#1*2]\nG0 X#1 Y#<wide>\nG91 X#5420\nG20 G90 X[#5420*2]"
    # #5420 is 6 mm in the units in force where it is read, before G20 acts
    assert ends(text) == [[3, 6, 0], [6, 6, 0], [304.8, 6, 0]]


def test_offset_parameters_are_the_offsets():
    text = "G10 L2 P2 X4 Y5\nG0 X#5241 Y#5242\n#5241=7 #5242=0 G55\nX0 Y0\nG92 X1\nX#5211"
    # machine 7 is called 1 by an offset of -1, #5211; program -1 then is machine 5
    assert ends(text) == [[4, 5, 0], [7, 0, 0], [5, 0, 0]]


def test_only_g54_to_g59_3_select_a_coordinate_system():
    text = "G10 L2 P2 X5\nG55 G0 X1\nX#5220\n#5220=77\nG10 L2 P0 X20\nX0"
    assert [x for x, *_ in ends(text)] == [6, 7, 20]


# Path tolerance, stops, events


def tolerances(text):
    return moves(text, path_tolerance=0.05, exact_tolerance=0.001).tolerance.tolist()


def test_path_control_sets_the_tolerance_of_what_follows():
    lines = "G0 X1\nG64 P.1\nX2\nG61\nX3\nG61.1\nX4\nG64\nX5\nG20 G64 P.01 Q.02\nX6\nG64 P0\nX7\nX8"
    assert tolerances(lines) == pytest.approx([0.05, 0.1, 0.001, 0, 0.05, 0.254, 0.05, 0])


@pytest.mark.parametrize("stop", ["M0", "M1", "M3", "M4", "M5", "T1 M6", "G4 P0"])
def test_the_machine_rests_where_it_must_stop(stop):
    t = tolerances(f"G0 X1\nX2\n{stop}\nX3\nX4")
    assert t[1] == 0
    assert t[0] == t[-2] == 0.05
    assert t[-1] == 0


@pytest.mark.parametrize("code", ["M7", "M8", "M9", "M48", "S100", "(MSG,x)", "T1", "G54", "G17"])
def test_other_codes_do_not_stop_the_motion(code):
    assert tolerances(f"G0 X1\n{code}\nX2") == [0.05, 0]


def test_a_dwell_is_a_move_of_its_own():
    m = moves("G4 P.5\nG0 X1\nG4 P2 X3")
    assert m.kind.tolist() == [MoveKind.DWELL, MoveKind.LINE, MoveKind.DWELL, MoveKind.LINE]
    assert m.dwell.tolist() == [0.5, 0, 2, 0]
    assert m.end[:, 0].tolist() == [0, 1, 1, 3]
    assert m.tolerance.tolist() == [0, 0, 0, 0]
    assert m.rapid.tolist() == [False, True, False, True]
    assert m.feed[0] == 0


def test_events_stand_before_the_move_that_follows():
    text = """T3 M6
M3 S1000
G0 X1
(MSG, half way)
M8
S1500
X2
M7
M9
M4
M5
M0
M1
M30
G0 X99 and what follows is not read"""
    assert events(text) == [
        (0, 1, "tool", 3, ""),
        (0, 2, "spindle", 1000, ""),
        (1, 4, "message", 0, "half way"),
        (1, 5, "flood", 1, ""),
        (1, 6, "spindle", 1500, ""),
        (2, 8, "mist", 1, ""),
        (2, 9, "mist", 0, ""),
        (2, 9, "flood", 0, ""),
        (2, 10, "spindle", -1500, ""),
        (2, 11, "spindle", 0, ""),
        (2, 12, "pause", 0, "M0"),
        (2, 13, "pause", 0, "M1"),
        (2, 14, "end", 0, "M30"),
    ]


def test_a_tool_change_stops_the_spindle_first():
    assert [e[2:4] for e in events("M3 S10\nT1 M6")] == [
        ("spindle", 10),
        ("spindle", 0),
        ("tool", 1),
    ]


def test_a_speed_beside_its_spindle_code_is_one_event():
    assert [e[3] for e in events("M3 S10\nM4 S20\nS30\nM5 S40\nS50")] == [10, -20, -30, 0]


def test_the_order_of_a_line_is_that_of_the_standard():
    """F, S, T, tool, spindle, coolant, dwell, units, offsets, motion, stop; however written."""
    program = interpret_text("M1 G4 P1 X1 G1 G20 M8 M3 M6 T1 S5 F60 (MSG,a)")
    assert [e.kind for e in program.events] == ["message", "tool", "spindle", "flood", "pause"]
    assert [e.at for e in program.events] == [0, 0, 0, 0, 2]
    assert program.moves.kind.tolist() == [MoveKind.DWELL, MoveKind.LINE]
    assert program.moves.end[1, 0] == 25.4


def test_messages_see_parameters_and_position():
    texts = [e[4] for e in events("G0 X2\n#1=4 (debug, %d#1 at #5420)\n(MSG,#1)")]
    assert texts == ["4 at 2", "#1"]


# Whole programs


def test_percent_lines_enclose_the_program():
    assert ends("%\nG0 X1\n % \nG0 X2 nonsense") == [[1, 0, 0]]
    assert ends("G0 X1\n%\nnonsense") == [[1, 0, 0]]


def test_block_delete():
    text = "G0 X1\n/X2\nX3"
    assert len(moves(text)) == 3
    assert ends(text, block_delete=True) == [[1, 0, 0], [3, 0, 0]]


def test_codes_without_effect_are_accepted():
    text = "G17 G21 G40 G49 G54 G80 G90 G91.1 G94 G97 G98\nM48\nM49\nG0 X1\nM2"
    assert ends(text) == [[1, 0, 0]]
    assert events(text) == [(1, 5, "end", 0, "M2")]


def test_a_program_without_motion():
    program = interpret_text("M2")
    assert len(program.moves) == 0
    assert program.moves.end.shape == (0, 6)
    assert program.moves.starts().shape == (0, 6)
    assert program.events == (Event(0, 1, "end", 0.0, "M2"),)


def test_every_column_has_its_declared_type():
    m = moves("G0 X1\nG4 P1\nG2 I1 F1")
    types = {name: getattr(m, name).dtype.name for name in ("kind", "plane", "rapid", "line")}
    assert types == {"kind": "int8", "plane": "int8", "rapid": "bool", "line": "int32"}
    for name in ("start", "end", "center", "sweep", "feed", "dwell", "tolerance"):
        assert getattr(m, name).dtype == np.float64
    assert m.end.shape == (3, 6)
    assert m.center.shape == (3, 3)


def test_a_program_of_everything():
    program = interpret(f"{PROGRAMS}/everything.ngc")
    m = program.moves
    assert program.path.endswith("everything.ngc")
    expected = [
        [0, 0, 10],  # line 6
        [10, 10, 10],  # 7
        [10, 10, -1],  # 8
        [30, 10, -1],  # 9
        [35, 15, -1],  # 10, arc about (30, 15)
        [35, 30, -1],  # 11
        [30, 35, -1],  # 12, arc about (30, 30)
        [30, 35, -1],  # 13, dwell
        [30, 35, 4],  # 14
        [55.4, 35, 4],  # 16, one inch on
        [155.4, 35, 4],  # 18, machine 100 on from G55
        [100, 0, 4],  # 19
    ]
    assert np.round(m.end[:, :3], 9).tolist() == expected
    assert m.line.tolist() == [6, 7, 8, 9, 10, 11, 12, 13, 14, 16, 18, 19]
    assert np.flatnonzero(m.kind == MoveKind.ARC).tolist() == [4, 6]
    assert m.center[[4, 6], :2].tolist() == [[30, 15], [30, 30]]
    assert m.sweep[[4, 6]] == pytest.approx([TAU / 4] * 2)


@pytest.mark.parametrize("name", ["rosette.ngc", "square.ngc"])
def test_examples(examples, name):
    m = interpret(examples / name).moves
    assert m.end[:, :3].min(axis=0).tolist() >= [0, 0, -10]
    assert m.end[:, :2].max() <= 200
    assert m.end[:, 2].max() <= 20
    assert m.end[-1, :2].tolist() == [0, 0]
    cut = ~m.rapid & (m.kind != MoveKind.DWELL)
    assert set(np.round(m.feed[cut] * 60).astype(int)) <= {300, 600, 900, 1200, 1500, 2100, 2400}


def test_the_rosette_is_smooth_around_its_rim(examples):
    """Each arc of the rim leaves in the direction in which the one before it arrives."""
    m = interpret(examples / "rosette.ngc").moves
    starts = m.starts()
    rim = [i for i in np.flatnonzero(m.kind == MoveKind.ARC) if m.end[i, 2] == -2]
    assert len(rim) == 24

    def heading(i, point):
        radius = (point - m.center[i])[:2]
        return np.array([-radius[1], radius[0]]) / np.hypot(*radius) * np.sign(m.sweep[i])

    for i in rim[1:]:
        before, after = heading(i - 1, m.end[i - 1, :3]), heading(i, starts[i, :3])
        assert before == pytest.approx(after, abs=1e-4)
