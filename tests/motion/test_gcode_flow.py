"""O-words, subprograms, files of subroutines, parameter files, tool tables, and limits."""

from __future__ import annotations

import math

import pytest
from typer.testing import CliRunner

from pulsewright.app.cli import app
from pulsewright.errors import GcodeError, UsageError
from pulsewright.motion.gcode import InterpreterSettings, interpret, interpret_text
from pulsewright.motion.gcode.parameters import KEPT, read_parameters, write_parameters
from pulsewright.motion.gcode.tools import Tool, read_tools, write_tools
from pulsewright.units import INCH


def positions(text, **settings):
    """Return X after each move."""
    return interpret_text(text, settings=InterpreterSettings(**settings)).moves.end[:, 0].tolist()


def messages(text, **settings):
    program = interpret_text(text, settings=InterpreterSettings(**settings))
    return [event.text for event in program.events if event.kind == "message"]


@pytest.mark.parametrize(
    ("value", "expected"), [(1, [1, 9]), (2, [2, 9]), (3, [3, 9]), (4, [4, 9]), (0, [4, 9])]
)
def test_conditions(value, expected):
    text = (
        f"#1={value}\no1 if [#1 eq 1]\nG0 X1\no1 elseif [#1 eq 2]\nG0 X2\n"
        "o1 elseif [#1 eq 3]\nG0 X3\no1 else\nG0 X4\no1 endif\nG0 X9"
    )
    assert positions(text) == expected


def test_loops():
    assert positions("G0 G91\no1 repeat [3]\nX2\no1 endrepeat") == [2, 4, 6]
    assert positions("#1=0\no1 while [#1 lt 3]\n#1=[#1+1]\nG0 X#1\no1 endwhile") == [1, 2, 3]
    assert positions("#1=5\no1 do\n#1=[#1+1]\nG0 X#1\no1 while [#1 lt 3]") == [6]
    assert positions("o1 repeat [0]\nG0 X1\no1 endrepeat\nG0 X2") == [2]


def test_break_and_continue_name_their_loop():
    text = """
o1 repeat [3]
  #1=0
  o2 while [1]
    #1=[#1+1]
    o3 if [#1 eq 2]
      o2 continue
    o3 endif
    o4 if [#1 gt 3]
      o2 break
    o4 endif
    G0 X[#1]
  o2 endwhile
  o5 if [1]
    o1 break
  o5 endif
o1 endrepeat
G0 X9"""
    assert positions(text) == [1, 3, 9]


def test_a_subroutine_has_parameters_of_its_own():
    text = """
#1=5 #<a>=6 #<_world>=7 #31=8
o<sub one> sub
  (debug, %d#1 #2 #30 #31 #<_world> #<a>)
  #1=50 #31=80 #<_world>=70
o<sub one> endsub [#1+1]
o<SubOne> call [1] [2]
(debug, %d#1 #<a> #<_world> #31 #<_value> #<_value_returned>)"""
    assert messages(text) == ["1 2 0 8 7 ######", "5 6 70 80 51 1"]


def test_subroutines_nest_and_return_early():
    text = """
o1 sub
  o2 if [#1 le 0]
    o1 return [0]
  o2 endif
  o1 call [#1-1]
o1 endsub [#<_value>+#1]
o1 call [4]
G0 X#<_value>"""
    assert positions(text) == [10]


def test_subprograms_share_parameters_and_repeat():
    text = "G91\nM98 P7 L3\nG90 G0 X0\nM2\nO7\nG0 X1\n#1=[#1+1]\nM99"
    assert positions(text) == [1, 2, 3, 0]


def test_m73_restores_the_state_of_the_caller():
    text = "G91\no1 sub\nM73\nG90 F7\nG0 X9\no1 endsub\nG0 X1\no1 call\nG0 X1"
    assert positions(text) == [1, 9, 10]


def test_after_m71_the_state_of_the_caller_is_not_restored():
    text = "G0\no1 sub\nM73\nG91\nX1\nM71\n{}\no1 endsub\no1 call\nX2"
    assert positions(text.format("")) == [1, 3]
    # what M70 keeps then is restored on return, as rs274 has it
    assert positions(text.format("M70\nG90 X5")) == [1, 5, 7]


def test_the_motion_mode_is_not_kept():
    """The manual of LinuxCNC says so of M70, and of M73 as it works alike."""
    moves = interpret_text("F60\nG1 X1\nM70\nG0 X2\nM72\nX3").moves
    assert moves.rapid.tolist() == [False, True, True]


def test_coolant_and_compensation_are_restored():
    text = "M7\nM70\nM9\nM8\nM72\nF60 G41.1 D2\nG1 X5\nG40\nM70\nG42.1 D2\nG1 X9\nM72\nX12"
    program = interpret_text(text)
    on = [(event.line, event.kind, event.value) for event in program.events]
    assert on[-3:] == [(5, "mist", 0), (5, "flood", 0), (5, "mist", 1)]
    assert program.moves.end[:, :2].tolist() == [[5, 1], [9, -1], [12, 0]]


def test_a_program_may_end_within_a_subroutine():
    assert positions("o1 sub\nG0 X1\nM2\no1 endsub\no1 call\nG0 X2") == [1]


def test_subroutines_may_be_files(tmp_path):
    library = tmp_path / "library"
    library.mkdir()
    (tmp_path / "near.ngc").write_text("o<near> sub\nG0 X#1\no<near> endsub\nM2\n")
    (library / "far.ngc").write_text("o<far> sub\nG0 X[#1+1]\no<near> call [9]\no<far> endsub\n")
    (library / "12.ngc").write_text("O12\nG0 X7\nM99\n")
    main = tmp_path / "main.ngc"
    main.write_text("o<near> call [1]\no<Far> call [2]\nM98 P12\nM2\n")
    settings = InterpreterSettings(subroutines=(str(library),))
    assert interpret(main, settings=settings).moves.end[:, 0].tolist() == [1, 3, 9, 7]
    with pytest.raises(GcodeError, match=r"no far.ngc in") as refusal:
        interpret(main)
    assert refusal.value.line == 2


def test_faults_within_a_file_of_a_subroutine_name_that_file(tmp_path):
    (tmp_path / "bad.ngc").write_text("o<bad> sub\nG0 X1\nG0 X[1/0]\no<bad> endsub\n")
    main = tmp_path / "main.ngc"
    main.write_text("o<bad> call\n")
    with pytest.raises(GcodeError) as refusal:
        interpret(main)
    assert (refusal.value.path, refusal.value.line) == (str(tmp_path / "bad.ngc"), 3)


@pytest.mark.parametrize("name", ["../main", "/etc/passwd", ".hidden", 300 * "a"])
def test_labels_name_files_of_the_search_path_alone(tmp_path, name):
    (tmp_path / "main.ngc").write_text(f"o<{name}> call\n")
    with pytest.raises(GcodeError, match="there is no"):
        interpret(tmp_path / "main.ngc")


def test_a_subprogram_of_any_number_may_be_missing():
    with pytest.raises(GcodeError, match="there is no"):
        interpret_text(f"M98 P{300 * '9'}\n")


def test_no_program_runs_for_ever():
    for text in (
        "o1 while [1]\no1 endwhile",
        "o1 do\n#1=[#1+1]\no1 while [1]",
        "o1 repeat [1000000000]\no1 endrepeat",
        "M98 P1 L1000000\nM2\nO1\n#1=1\nM99",
    ):
        with pytest.raises(GcodeError, match="has carried out 5000 lines"):
            interpret_text(text, settings=InterpreterSettings(max_lines=5000))
    for text in ("o1 sub\no1 call\no1 endsub\no1 call", "M98 P1\nM2\nO1\nM98 P1\nM99"):
        with pytest.raises(GcodeError, match="each other 100 deep"):
            interpret_text(text)


def test_m99_of_the_main_program_ends_it():
    assert positions("G0 X1\nM99\nG0 X2") == [1]


# Files


def test_parameter_files_are_read_and_replaced_at_once(tmp_path):
    path = tmp_path / "machine.var"
    path.write_text("# offsets\n5221\t10.5\n5222 -2 ; of Y\n\n31 7\n")
    values = read_parameters(path)
    assert values == {5221: 10.5, 5222: -2.0, 31: 7.0}
    write_parameters(path, {**values, 5221: 11.25})
    assert read_parameters(path) == {31: 7.0, 5221: 11.25, 5222: -2.0}
    assert read_parameters(f"{path}.bak")[5221] == 10.5
    assert sorted(p.name for p in tmp_path.iterdir()) == ["machine.var", "machine.var.bak"]
    assert read_parameters(tmp_path / "missing.var") == {}


@pytest.mark.parametrize("line", ["abc 1", "5221", "5221 x", "0 1", "6000 1"])
def test_broken_parameter_files_are_refused(tmp_path, line):
    path = tmp_path / "machine.var"
    path.write_text(f"31 1\n{line}\n")
    with pytest.raises(UsageError, match=r"machine.var:2: "):
        read_parameters(path)
    path.write_text("31 1\n31 2\n")
    with pytest.raises(UsageError, match="stands twice"):
        read_parameters(path)


def test_a_parameter_file_always_holds_the_offsets():
    assert {5161, 5169, 5181, 5189, 5210, 5211, 5219, 5220, 5221, 5230, 5381, 5390} <= KEPT
    assert not KEPT & {31, 5160, 5170, 5231, 5391}


def test_tool_tables_are_read_and_written(tmp_path):
    path = tmp_path / "tool.tbl"
    path.write_text("T1 P3 Z+0.5 D.25 ;end mill\n; nothing\nt2p4 x1 z-2 i10 j20 q3\n")
    tools = read_tools(path, INCH)
    assert tools[1] == Tool(1, 3, (0, 0, 12.7, 0, 0, 0), 6.35, comment="end mill")
    assert tools[2] == Tool(2, 4, (25.4, 0, -50.8, 0, 0, 0), 0.0, 10, 20, 3)
    write_tools(path, tools, INCH)
    assert read_tools(path, INCH) == tools
    assert (tmp_path / "tool.tbl.bak").read_text().startswith("T1 P3 Z+0.5")
    for text in ("P1 Z3", "T1 Z", "T1 ?3", "T1 Z1 Z2", "T1\nT1"):
        path.write_text(text)
        with pytest.raises(UsageError, match=r"tool\.tbl:"):
            read_tools(path)
    with pytest.raises(UsageError, match="cannot be read"):
        read_tools(tmp_path / "missing.tbl")


def test_plan_canon_prints_and_saves(tmp_path):
    program, variables, table = (tmp_path / n for n in ("p.ngc", "p.var", "t.tbl"))
    program.write_text("G21 G10 L2 P2 X25.4\nG55 G10 L1 P1 Z50.8\nG43 H1\n/G0 X3\nG0 X1\nM2\n")
    variables.write_text("5222 4\n31 5\n")
    table.write_text("T1 P1 Z.5\n")
    arguments = ["plan", str(program), "--canon", "--parameters", str(variables)]
    arguments += ["--tools", str(table), "--block-delete"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0
    assert " SET_G5X_OFFSET(1, 0.0000, 101.6000, 0.0000," in result.output
    assert "STRAIGHT_TRAVERSE(1.0000, 0.0000, -50.8000, 0.0000" in result.output
    assert "STRAIGHT_TRAVERSE(3" not in result.output
    assert read_parameters(variables) == {5222: 4, 31: 5}
    CliRunner().invoke(app, [*arguments, "--save"])
    saved = read_parameters(variables)
    assert (saved[5241], saved[5222], saved[31], saved[5220]) == (1, 4, 5, 1)
    assert read_tools(table, INCH)[1].offset[2] == pytest.approx(50.8)


@pytest.mark.parametrize(("system", "x"), [(2, 5), (2.7, 5), (0, 1), (10, 1)])
def test_a_program_begins_in_the_system_of_the_parameter_file(system, x):
    """As rs274 has it: a number that is none of them is the first one."""
    assert positions("G0 X0", parameters={5220: system, 5221: 1, 5241: 5}) == [x]
    turned = {5220: 9, 5381: 3, 5390: 90}
    assert positions("G0 X0 Y2", parameters=turned) == pytest.approx([1])


# What planned motion gets from it


def test_motion_with_the_spindle_has_its_pitch():
    text = "S120 M3 F60\nG1 X1\nG33 X5 K2\nG33.1 Z-3 K.5\nG1 X0"
    moves = interpret_text(text).moves
    assert moves.end[:, [0, 2]].tolist() == [[1, 0], [5, 0], [5, -3], [5, 0], [0, 0]]
    assert moves.pitch.tolist() == [0, 2, 0.5, 0.5, 0]
    assert moves.feed.tolist() == [1, 4, 1, 1, 1]  # 2 turns per second
    assert moves.tolerance[2] == moves.tolerance[3] == 0  # the tap turns around


def test_a_tap_goes_back_as_fast_as_asked():
    moves = interpret_text("S120 M3\nG33.1 Z-3 K.5 I2\nG33 X1 K.5").moves
    assert moves.feed.tolist() == [1, 2, 1]  # 2 turns per second


def test_feed_per_revolution_follows_the_speed():
    moves = interpret_text("S60 G95 F.5\nG1 X1\nS120\nX2\nG94 F30\nX3").moves
    assert moves.feed.tolist() == [0.5, 1, 0.5]


def test_short_segments_may_collapse_within_q():
    moves = interpret_text(
        "G0 X1\nG64 P.1\nX2\nG64 P.1 Q.02\nX3\nG20 G64 P.1 Q.1\nX4\nG61\nX5"
    ).moves
    assert moves.collapse.tolist() == pytest.approx([0, 0.1, 0.02, 2.54, 0])


def test_exact_stop_keeps_q_for_later_and_collapses_nothing():
    text = "F60 G64 P.1 Q.02\nG1 X1\nG61.1 X2\nG81 X3 Z0 R0\nG0 X4"
    assert set(interpret_text(text).moves.collapse[1:]) == {0}


def test_cutter_compensation_and_cycles_reach_the_machine():
    text = "F60\nG41.1 D2\nG1 X5\nY5\nG40 X0\nG81 X0 Y0 Z-2 R1"
    ends = interpret_text(text).moves.end[:, :3].tolist()
    # left of X, then left of Y: 1 above, 1 before; the inside corner is met at (4, 1)
    assert ends == [
        [4, 1, 0],
        [4, 5, 0],
        [0, 5, 0],
        [0, 5, 1],
        [0, 0, 1],
        [0, 0, -2],
        [0, 0, 1],
    ]


def test_a_compensated_rapid_goes_straight_over_an_outside_corner():
    moves = interpret_text("F60\nG42.1 D2\nG1 X5\nG0 Y5\nG1 X0").moves
    assert moves.end[:, :2].tolist() == [[5, -1], [6, 0], [6, 5], [5, 6], [0, 6]]
    assert moves.sweep.tolist() == [0, 0, 0, pytest.approx(math.pi / 2), 0]


def test_the_point_of_a_lathe_tool_keeps_off_a_corner():
    """Left of X+ is Z-; the nose is 1 there, and 1 before Z-: its point is 1 off it along both."""
    moves = interpret_text("F60 G18\nG0 Z9\nG41.1 D2 L3\nG1 X5\nZ0").moves
    assert moves.end[1:, [0, 2]].tolist() == [[5, 7], [5, -1]]


def test_after_compensation_the_tool_leaves_along_a_line():
    text = "F60\nG41.1 D2\nG1 X5\nY5\nG40\nG1 X9\nG2 X11 I1"
    assert interpret_text(text).moves.end[2:, :2].tolist() == [[9, 5], [11, 5]]


def test_straight_back_after_an_arc_that_curves_away_from_the_tool():
    """The tool is 1 outside an arc of 5, then 1 below Y5: it turns where 6 meets Y4."""
    moves = interpret_text("F60\nG0 X6 Y-10\nG42.1 D2\nG1 X5 Y0\nG3 X0 Y5 I-5\nG1 X9").moves
    assert moves.end[2:, :2].tolist() == [pytest.approx([20**0.5, 4]), [9, 4]]


def test_tapping_goes_along_its_axis_in_every_plane():
    moves = interpret_text("S60 M3 F60 G19\nG0 X5\nG84 X1 Y2 Z3 R4").moves
    assert moves.end[-2:, :3].tolist() == [[1, 2, 3], [4, 2, 3]]


def test_rotation_turns_straight_lines_and_arcs():
    moves = interpret_text("F60 G10 L2 P1 X10 R90\nG0 X1 Y0\nG2 X2 Y1 I1 J0").moves
    assert moves.end[:, :2].tolist() == [[10, 1], [9, 2]]
    assert moves.center[1, :2].tolist() == [10, 2]


def test_outputs_are_events():
    program = interpret_text("G0 X1\nM62 P3\nX2\nM65 P1\nM67 E2 Q1.5\nM66 P4 L3 Q9\nM19 R45")
    events = [(e.at, e.kind, e.value, e.text) for e in program.events]
    assert events == [
        (1, "output", 1, "digital 3"),
        (2, "output", 0, "digital 1"),
        (2, "output", 1.5, "analog 2"),
        (2, "input", 3, "digital 4"),
        (2, "orient", 45, ""),
    ]
