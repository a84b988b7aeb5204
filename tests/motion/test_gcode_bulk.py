"""The compiled reader of plain lines gives what the interpreter gives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pulsewright.errors import GcodeError
from pulsewright.motion.gcode import InterpreterSettings, interpret, run
from pulsewright.motion.gcode.bulk import ROWS, Bulk
from pulsewright.motion.gcode.interpreter import Interpreter
from pulsewright.motion.gcode.recorder import Recorder
from pulsewright.motion.gcode.source import Source
from pulsewright.motion.moves import AXES


def outcome(text, bulk_lines):
    """Return the columns and events of a program, or its error."""
    before, run.BULK_LINES = run.BULK_LINES, bulk_lines
    try:
        program = run.interpret_text(text, settings=InterpreterSettings(axes="XYZAB"))
    except GcodeError as error:
        return str(error), error.line, error.column
    finally:
        run.BULK_LINES = before
    moves = program.moves
    columns = [getattr(moves, name).tolist() for name in moves.__dataclass_fields__]
    return columns, program.events


def both(text):
    assert outcome(text, 0) == outcome(text, 10**9), text


def taken(text):
    """Return how many lines of a text the compiled reader takes."""
    source = Source(text.encode(), "text")
    recorder = Recorder((0.0,) * 6)
    interpreter = Interpreter(InterpreterSettings(axes=AXES), recorder)
    interpreter.parameters.set("SIZE", 2.5)
    interpreter.parameters.set("_WORLD", 4.0)
    interpreter.modal.feed = 100.0
    return Bulk(interpreter, recorder, source).run(0)


@pytest.mark.parametrize(
    "line",
    [
        "G1 X1 Y-2.5 Z.5 F300",
        "g01x1y2",
        "N10 G0 X1",
        "N10.5G0X+1.",
        "  \t G 1 X 1 Y\t2  ",
        "",
        "G0 X1 ; and (what) follows",
        "G1 X[1+2*3] Y[[1-2]/4] Z-[3]",
        "G1 X[#<size>*2] Y-#< Si ze > Z[-[#<_world>-1]*-2]",
        "F200",
        "G0",
        "G1 A5 B-7 C12.25",
        "G1 X123456789.123456",
    ],
)
def test_plain_lines_are_taken(line):
    assert taken(f"{line}\nM2\n") == 1


@pytest.mark.parametrize(
    "line",
    [
        "G2 X1 I1",
        "G90",
        "G0 X1 (comment)",
        "M3",
        "/G0 X1",
        "%",
        "G1 X1 X2",
        "G1 G0 X1",
        "G1.5 X1",
        "G1 X",
        "G1 X1.2.3",
        "G1 X1 2",
        "G1 X--1",
        "G1 X[1/0]",
        "G1 X[2**3]",
        "G1 X[1+2",
        "G1 X1]",
        "G1 X#1",
        "G1 X#<nothing>",
        "G1 XSIN[1]",
        "G1 F-1",
        "G1 X1e3",
        "G0 X99999999999",
        "G1 X1.12345678901234567890",
        "#1=2",
        "o1 sub",
        "G0 U1",
        "G1 X1 P2",
        "G0 ä",
    ],
)
def test_other_lines_are_left(line):
    assert taken(f"{line}\nM2\n") == 0


def test_motion_without_mode_or_feed_is_left():
    assert taken("X1\n") == 0
    assert taken("F0\nG1 X1\n") == 1


NUMBER = st.from_regex(r"\A[+-]?([0-9]{1,5}(\.[0-9]{0,5})?|\.[0-9]{1,4})\Z")
ATOM = NUMBER | st.sampled_from(["#<a>", "-#<B b>", "#1", "[#<a>]", "#<_world>"])
EXPRESSION = st.recursive(
    ATOM,
    lambda inner: st.builds(
        "{}[{}{}{}]".format,
        st.sampled_from(["", "-", "+"]),
        inner,
        st.sampled_from(["+", "-", "*", "/", " - ", "*-", "**"]),
        inner,
    ),
    max_leaves=6,
)
WORD = st.builds("{}{}".format, st.sampled_from("XYZABFxyzf"), NUMBER | EXPRESSION)
PLAIN = st.lists(WORD, min_size=1, max_size=4, unique_by=lambda word: word[0].upper()).map(" ".join)
MOTION = st.builds(
    "{}{} {}".format, st.sampled_from(["", "N5 ", "n7.5"]), st.sampled_from(["", "G0", "g1"]), PLAIN
)
OTHER = st.sampled_from(
    [
        "",
        "G20",
        "G21 F100",
        "G90",
        "G91",
        "#1=7",
        "#<a>=3.5",
        "#<_world>=[#<a>+1]",
        "(msg, hello)",
        "G55",
        "G10 L2 P2 X1 R30",
        "G92 X2",
        "G2 X1 Y1 I.5 J.5 F50",
        "G4 P1",
        "M3 S100",
        "G93",
        "G94",
        "G61",
        "G64 P.1",
        "o9 repeat [2]\nG1 X5 F9\no9 endrepeat",
        "G41.1 D1",
        "G40",
        "G5.2 X1 Y2 P1",
        "X4 Y1 P2",
        "G5.3",
        "G5 X3 Y3 I1 J0 P-1 Q0",
        "G53 G0 X1",
        "G80",
        "%",
        "X",
    ]
)
HEAD = "G21 G90 F100\n#<a>=2 #<bb>=0.25 #<_world>=1\nG0 X1\n"


def test_the_head_of_random_programs_is_right():
    assert outcome(HEAD, 10**9)[0][5] == [[1.0, 0, 0, 0, 0, 0]]  # ends


@settings(max_examples=120, deadline=None)
@given(st.lists(MOTION | MOTION | MOTION | OTHER, max_size=14).map("\n".join))
def test_programs_are_the_same_either_way(text):
    both(HEAD + text)


def test_more_lines_than_fit_at_once():
    n = 2 * ROWS + 5
    text = "G1 F60\n" + "".join(f"X{i}\n" for i in range(1, n + 1))
    before, run.BULK_LINES = run.BULK_LINES, 0
    try:
        moves = run.interpret_text(text).moves
    finally:
        run.BULK_LINES = before
    assert len(moves) == n
    assert moves.end[:, 0].tolist() == list(range(1, n + 1))
    assert moves.line.tolist() == list(range(2, n + 2))
    assert set(moves.feed) == {1.0}


@pytest.mark.parametrize("name", ["3D_Chips.ngc", "contour.ngc", "trochoidal.ngc", "wheels.ngc"])
def test_corpus_programs_are_the_same_either_way(corpus, name, monkeypatch):
    fast = interpret(corpus / name)
    monkeypatch.setattr(run, "BULK_LINES", 10**9)
    slow = interpret(corpus / name)
    assert fast.events == slow.events
    for column in fast.moves.__dataclass_fields__:
        mine, other = getattr(fast.moves, column), getattr(slow.moves, column)
        assert np.array_equal(mine, other), column
