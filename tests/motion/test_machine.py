"""Machine files: what they give, and how their mistakes are explained."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from pulsewright.errors import MachineError, MotionLimitError
from pulsewright.motion.machine import Machine, move_extents
from pulsewright.motion.moves import MoveKind, Moves, Plane

MINIMAL = """
name = "one axis"
[axis.X]
motor = 0
steps_per_mm = 100
min = -10
max = 20
velocity = 50
acceleration = 400
"""


def moves(ends, *, start=(0,) * 6, kind=None, plane=Plane.XY, center=(0, 0, 0), sweep=0.0):
    """Return moves through ``ends``; one arc if ``kind`` says so."""
    n = len(ends)
    return Moves(
        start=np.array(start, float),
        kind=np.full(n, MoveKind.LINE if kind is None else kind, np.int8),
        plane=np.full(n, plane, np.int8),
        rapid=np.zeros(n, bool),
        line=np.arange(10, 10 + n, dtype=np.int32),
        end=np.array(ends, float),
        center=np.tile(np.array(center, float), (n, 1)),
        sweep=np.full(n, sweep),
        feed=np.full(n, 10.0),
        dwell=np.zeros(n),
        tolerance=np.zeros(n),
    )


def test_default_machine_is_a_four_axis_mill():
    machine = Machine.default()
    assert (machine.axes, machine.motors) == ("XYZA", 4)
    rows, velocity, acceleration = machine.limit_rows()
    assert rows.tolist() == np.eye(6)[:4].tolist()
    assert velocity.tolist() == [60, 60, 60, 180]
    assert acceleration.tolist() == [500, 500, 500, 1000]
    # 200 x 8 steps on 5 mm; 200 x 8 x 20 steps on 360 degrees
    assert machine.axis["X"].steps_per_unit == 320
    assert machine.axis["A"].steps_per_unit == Fraction(800, 9)
    assert machine.exact_tolerance == pytest.approx(0.1 / 320)
    assert (machine.board.name, machine.link.url) == ("usc", "twin:")


@pytest.mark.parametrize("name", ["mill", "inch_router", "corexy_engraver", "five_axis"])
def test_example_machines_load(examples, name):
    assert "XYZ" in Machine.load(examples / "machines" / f"{name}.toml").axes


@pytest.mark.parametrize(
    ("given", "exact"),
    [
        ("320", Fraction(320)),
        ("78.74", Fraction(3937, 50)),
        ('"3200/1.27"', Fraction(320000, 127)),
        ('"200*16/5"', Fraction(640)),
        ('" 200 * 16 / 5 / 2 "', Fraction(320)),
    ],
)
def test_scales_are_exact(given, exact):
    machine = Machine.parse(MINIMAL.replace("steps_per_mm = 100", f"steps_per_mm = {given}"))
    assert machine.axis["X"].steps_per_unit == exact
    assert machine.motor_matrix()[0, 0] == float(exact)


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ("velocity", "velocty", "axis.X.velocty", ["did you mean 'velocity'", "acceleration"]),
        ("velocity = 50", "", "axis.X.velocity", ["missing"]),
        ("velocity = 50", "velocity = -1", "axis.X.velocity", ["-1", "greater than 0"]),
        ("velocity = 50", "velocity = '50'", "axis.X.velocity", ["'50'", "number"]),
        ("velocity = 50", "velocity = inf", "axis.X.velocity", ["inf", "finite"]),
        ("= 100", "= '3+4'", "axis.X.steps_per_mm", ["3+4", "200*16/5"]),
        ("= 100", "= '1/0'", "axis.X.steps_per_mm", ["divides by zero"]),
        ("= 100", "= 0", "axis.X.steps_per_mm", ["0 given", "above 0"]),
        ("= 100", "= true", "axis.X.steps_per_mm", ["True", "number"]),
        ("steps_per_mm", "steps_per_degree", "axis.X.steps_per_degree", ["linear", "per_mm"]),
        ("[axis.X]", "[axis.Q]", "axis.Q", ["'Q'", "X, Y, Z, A, B, C"]),
        ("max = 20", "max = -10", "axis.X.max", ["-10", "axis.X.min"]),
        ("motor = 0", "motor = 2", "axis.X.motor", ["without gaps", "0 is missing"]),
        ("motor = 0", "motor = -1", "axis.X.motor", ["-1", "index from 0"]),
        ("motor = 0", "motor = [0, 0]", "axis.X.motor", ["twice"]),
        ("[axis.X]", "[axs.X]", "axs", ["did you mean 'axis'"]),
        ("name", "start.X = 21\nname", "start.X", ["21", "-10..20"]),
        ("name", "start.Y = 0\nname", "start.Y", ["no axis Y"]),
        ("name", "offsets.G53.X = 1\nname", "offsets.G53", ["G54", "G59.3"]),
        ("name", "tools.one.length = 1\nname", "tools.one", ["integer"]),
        ("name", "kinematics.type = 'delta'\nname", "kinematics.type", ["delta", "corexy"]),
        ("name", "kinematics.type = 'corexy'\nname", "kinematics.type", ["X and Y"]),
        ("name", "board.option.x = 1\nname", "board.option", ["did you mean 'options'"]),
        ("min = -10", "", "axis.X.min", ["missing", "rotary"]),
        ("max = 20", "", "axis.X.max", ["missing", "rotary"]),
        ("min", "wrapped = true\nmin", "axis.X.wrapped", ["rotary", "min and max"]),
        ("min", "wrapped = 1\nmin", "axis.X.wrapped", ["1 given", "bool"]),
        ("min", "reversed = 1\nmin", "axis.X.reversed", ["1 given", "true and false"]),
        ("min", "reversed = []\nmin", "axis.X.reversed", ["true and false"]),
        ("min", "reversed = [true, false]\nmin", "axis.X.reversed", ["2 flags", "1 motors"]),
        ("[axis.X]", "[axis.X", "", ["TOML", "line 3"]),
    ],
)
def test_mistakes_are_explained(old, new, key, words):
    with pytest.raises(MachineError) as caught:
        Machine.parse(MINIMAL.replace(old, new), "my.toml")
    assert caught.value.key == key
    message = str(caught.value)
    assert message.startswith(f"my.toml: {key}" if key else "my.toml: ")
    assert all(word in message for word in words), message


ROTARY = """
[axis.A]
motor = 1
steps_per_degree = 50
velocity = 90
acceleration = 900
"""


def test_a_rotary_axis_without_limits_turns_without_end():
    machine = Machine.parse(MINIMAL + ROTARY)
    assert machine.wrapped == ""
    machine.check_travel(moves([(0, 0, 0, 1e6, 0, 0), (0, 0, 0, -1e6, 0, 0)]))
    with pytest.raises(MotionLimitError, match=r"A reaches -91 degrees.*axis\.A\.min = -90"):
        Machine.parse(MINIMAL + ROTARY + "min = -90").check_travel(moves([(0, 0, 0, -91, 0, 0)]))


def test_only_a_rotary_axis_without_limits_is_wrapped():
    assert Machine.parse(MINIMAL + ROTARY + "wrapped = true").wrapped == "A"
    for limit in ("min = 0", "max = 360"):
        with pytest.raises(MachineError, match=r"axis\.A\.wrapped: true given; only a rotary"):
            Machine.parse(MINIMAL + ROTARY + f"wrapped = true\n{limit}")


def test_two_axes_cannot_share_a_motor():
    second = MINIMAL.split("\n", 2)[2].replace("axis.X", "axis.Y")
    with pytest.raises(MachineError, match=r"axis\.Y\.motor: motor 0 is that of axis X already"):
        Machine.parse(MINIMAL + second)


def test_unreadable_files_are_explained(tmp_path):
    with pytest.raises(
        MachineError, match=r"none\.toml: cannot read the machine file: No such file"
    ):
        Machine.load(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(MachineError, match=r"binary\.toml: not a text file"):
        Machine.load(tmp_path / "binary.toml")


def test_a_byte_order_mark_is_no_part_of_the_file(tmp_path):
    (tmp_path / "marked.toml").write_bytes(b"\xef\xbb\xbf" + MINIMAL.encode())
    assert Machine.load(tmp_path / "marked.toml") == Machine.parse(MINIMAL)


def test_settings_for_the_interpreter():
    machine = Machine.parse(
        "start = {x = 1}\noffsets.G54 = {x = 2.5}\ntools.3 = {length = 12}\n" + MINIMAL
    )
    assert machine.start_position().tolist() == [1, 0, 0, 0, 0, 0]
    assert machine.offset("G54").tolist() == [2.5, 0, 0, 0, 0, 0]
    assert machine.offset("G55").tolist() == [0] * 6
    assert machine.tools[3].length == 12


def test_travel_allows_its_ends():
    Machine.parse(MINIMAL).check_travel(moves([[20, 0, 0, 0, 0, 0], [-10, 0, 0, 0, 0, 0]]))


def test_travel_error_names_line_axis_coordinate_and_limit():
    with pytest.raises(
        MotionLimitError, match=r"line 11: X reaches -10\.5 mm .*axis\.X\.min = -10"
    ):
        Machine.parse(MINIMAL).check_travel(moves([[20, 0, 0, 0, 0, 0], [-10.5, 0, 0, 0, 0, 0]]))


def test_absent_axes_cannot_move():
    with pytest.raises(MotionLimitError, match="line 10: moves axis B"):
        Machine.default().check_travel(moves([[0, 0, 0, 0, 1, 0]]))


def test_arc_is_checked_where_it_bulges():
    # From (300, 0) to (0, 300) about the origin counterclockwise by 90 degrees: inside. Clockwise
    # by 270 degrees it passes (-300, 0), beyond X = -200.
    ends, start = [[0, 300, 0, 0, 0, 0]], (300, 0, 0, 0, 0, 0)
    Machine.default().check_travel(moves(ends, start=start, kind=MoveKind.ARC, sweep=np.pi / 2))
    with pytest.raises(MotionLimitError, match=r"X reaches -300 mm"):
        Machine.default().check_travel(
            moves(ends, start=start, kind=MoveKind.ARC, sweep=-3 * np.pi / 2)
        )


@pytest.mark.parametrize("plane", list(Plane))
@pytest.mark.parametrize("sweep", [0.3, -0.3, 2.0, -4.0, 2 * np.pi, -9.0])
def test_extents_of_arcs_contain_every_point_and_no_more(plane, sweep):
    first, second = plane.axes
    center = np.array([3.0, -2.0, 5.0])
    angle = 0.7 + sweep * np.linspace(0, 1, 20_001)
    points = np.zeros((len(angle), 6))
    points[:, first] = center[first] + 2 * np.cos(angle)
    points[:, second] = center[second] + 2 * np.sin(angle)
    arc = moves(
        points[-1:], start=points[0], kind=MoveKind.ARC, plane=plane, center=center, sweep=sweep
    )
    low, high = move_extents(arc)
    assert low[0] == pytest.approx(points.min(axis=0), abs=1e-6)
    assert high[0] == pytest.approx(points.max(axis=0), abs=1e-6)


# ------------------------------------------------------------------- encoders and limit switches


def test_encoders_and_switches_are_read():
    machine = Machine.parse(
        MINIMAL
        + "[encoders]\ncounts_per_step = [4, -0.5]\nfollowing_error = 3\n"
        + "[switches]\ninputs = [0, 14]\nactive = 0\n"
    )
    assert machine.encoders is not None
    assert machine.encoders.counts_per_step == (4, -0.5)
    assert machine.encoders.following_error == 3
    assert machine.switches is not None
    assert (machine.switches.inputs, machine.switches.active) == ((0, 14), 0)


def test_encoders_and_switches_may_be_left_out_and_have_defaults():
    machine = Machine.parse(MINIMAL)
    assert (machine.encoders, machine.switches) == (None, None)
    machine = Machine.parse(
        MINIMAL + "[encoders]\ncounts_per_step = [1]\n[switches]\ninputs = [3]\n"
    )
    assert machine.encoders is not None
    assert machine.encoders.following_error == 2
    assert machine.switches is not None
    assert machine.switches.active == 1  # a cut cable is a switch that is hit


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ("[encoders]", r"encoders\.counts_per_step"),
        ("[encoders]\ncounts_per_step = []", r"encoders\.counts_per_step.*1"),
        ("[encoders]\ncounts_per_step = [1, 0]", r"encoders\.counts_per_step.*0"),
        ("[encoders]\ncounts_per_step = 4", r"encoders\.counts_per_step"),
        ("[encoders]\ncounts_per_step = ['four']", r"encoders\.counts_per_step.*four"),
        ("[encoders]\ncounts_per_step = [1]\nfollowing_error = 0", r"encoders\.following_error.*0"),
        ("[encoders]\ncounts_per_step = [1]\ncounts = 1", r"encoders\.counts\b"),
        ("[switches]", r"switches\.inputs"),
        ("[switches]\ninputs = []", r"switches\.inputs"),
        ("[switches]\ninputs = [-1]", r"switches\.inputs.*-1"),
        ("[switches]\ninputs = [1.5]", r"switches\.inputs.*1\.5"),
        ("[switches]\ninputs = [1]\nactive = 2", r"switches\.active.*2"),
        ("[switches]\ninputs = [1]\nactive = true", r"switches\.active"),
        ("[switches]\ninputs = [1]\npull_up = 1", r"switches\.pull_up"),
    ],
)
def test_mistakes_in_encoders_and_switches_are_named(table, says):
    with pytest.raises(MachineError, match=says):
        Machine.parse(MINIMAL + table, "mill.toml")
