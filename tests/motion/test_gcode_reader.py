"""Lines to blocks: words, numbers, expressions, parameters, comments."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pulsewright.motion.gcode.faults import Fault
from pulsewright.motion.gcode.parameters import Parameters
from pulsewright.motion.gcode.reader import Comment, _Reader, read_line


@pytest.fixture
def parameters():
    result = Parameters()
    result.position = lambda axis: 10.0 + axis
    return result


def read_block(text, parameters):
    """Return the values of a line; None if it asks for nothing."""
    line = read_line(text)
    return line and line.block(parameters)


def words(text, parameters):
    return read_block(text, parameters).words


def value(expression, parameters):
    return words(f"X{expression}", parameters)["X"]


@pytest.mark.parametrize(
    "text",
    [
        "G1 X1.5 Y-2 F100",
        "g1x1.5y-2f100",
        "  G 1 X 1 . 5\tY - 2 F 1 0 0  ",
        "N120 G01 X+1.5 Y-2. F100",
        "N120.5 g1. X1.5 (there) Y-2 F100; and on (to there",
        "/G1.0X1.50Y-2F0100",
        "X1.5 F100 G1 Y-2",
    ],
)
def test_case_spaces_and_comments_mean_nothing(text, parameters):
    block = read_block(text, parameters)
    assert block.words == {"X": 1.5, "Y": -2.0, "F": 100.0}
    assert block.g == [10]


@pytest.mark.parametrize(
    ("text", "number"),
    [("+.5", 0.5), ("-.1", -0.1), ("1.", 1.0), ("007", 7.0), ("--1", 1.0), ("-[1+1]", -2.0)],
)
def test_numbers(text, number, parameters):
    assert value(text, parameters) == number


def test_words_may_touch(parameters):
    assert words("g1z-.1f24", parameters) == {"Z": -0.1, "F": 24.0}


@pytest.mark.parametrize(
    ("text", "codes"), [("G61.1", [611]), ("G92.3 G0", [923, 0]), ("G[60+1] G91 . 1", [610, 911])]
)
def test_g_codes_count_in_tenths(text, codes, parameters):
    assert read_block(text, parameters).g == codes


@pytest.mark.parametrize(
    ("expression", "result"),
    [
        ("[1+2*3]", 7),
        ("[[1+2]*3]", 9),
        ("[2*3**2]", 18),
        ("[2**3**2]", 64),  # to the left: (2**3)**2
        ("[2**-1]", 0.5),
        ("[-2**2]", 4),  # the sign belongs to the number
        ("[7-2-1]", 4),
        ("[8/4/2]", 1),
        ("[5 MOD 3]", 2),
        ("[-5 mod 3]", 1),
        ("[7 MOD -3]", 1),
        ("[1 LT 2 AND 3]", 1),
        ("[1 GT 2 OR 0]", 0),
        ("[1 XOR 1]", 0),
        ("[1 LE 1 + 1]", 1),
        ("[2 GE 3]", 0),
        ("[1 EQ 1.00005]", 1),  # equal within 0.0001
        ("[1 EQ 1.0002]", 0),
        ("[1 NE 1.0002]", 1),
        ("SQRT[16]", 4),
        ("sqrt[9]", 3),
        ("ABS[-2]", 2),
        ("FIX[2.8]", 2),
        ("FIX[-2.8]", -3),
        ("FUP[2.8]", 3),
        ("FUP[-2.8]", -2),
        ("ROUND[2.5]", 3),
        ("ROUND[-2.5]", -3),
        ("SIN[30]", 0.5),
        ("COS[60]", 0.5),
        ("TAN[45]", 1),
        ("ASIN[1]", 90),
        ("ACOS[0]", 90),
        ("ATAN[1]/[1]", 45),
        ("ATAN[1]/[-1]", 135),
        ("EXP[0]", 1),
        ("LN[EXP[2]]", 2),
        ("[1 + SIN[30] * [2 + 2]]", 3),
    ],
)
def test_expressions(expression, result, parameters):
    assert value(expression, parameters) == pytest.approx(result, abs=1e-12)


def test_parameters_nest(parameters):
    parameters.set(1, 2)
    parameters.set(2, 7)
    parameters.set("WIDTH", 5)
    text = "X#1 Y##1 Z[#2+#[#1]] F#<Wi dth> R-#<width>"
    assert words(text, parameters) == {"X": 2, "Y": 7, "Z": 14, "F": 5, "R": -5}


def test_parameters_are_set_after_the_line_is_read(parameters):
    parameters.set(1, 2)
    line = read_line("#1=3 X#1 #<a>=[#1+1] #1=4")
    assert line.block(parameters).words == {"X": 2}
    line.set_parameters(parameters)
    assert (parameters.get(1), parameters.get("A")) == (4, 3)


def test_position_parameters_ask_the_machine(parameters):
    assert words("X#5420 Y#5425", parameters) == {"X": 10, "Y": 15}


def test_exists_tells_what_is_set(parameters):
    parameters.set("HERE", 0)
    text = "X EXISTS[#<here>] Y EXISTS[#<there>] Z EXISTS[#5] F EXISTS[#99999]"
    assert words(text, parameters) == {"X": 1, "Y": 0, "Z": 1, "F": 0}


@pytest.mark.parametrize("text", ["", "  \t", "; nothing", "/", " / ; nothing"])
def test_a_line_that_holds_nothing(text):
    assert read_line(text) is None


@pytest.mark.parametrize("text", ["(nothing)", "(a)(b) ; c", "N10", "N10.5 (x)"])
def test_a_line_that_asks_for_nothing(text, parameters):
    line = read_line(text)
    assert not line.asks
    assert not line.block(parameters).words


def test_deleted_lines_say_so(parameters):
    assert read_block("/ G0 X1", parameters).words == {"X": 1}
    assert read_line("/ G0 X1").deleted
    assert not read_line("G0 X1 (/)").deleted


@pytest.mark.parametrize(
    ("text", "kind", "what"),
    [
        ("G0 (MSG, Mind the ; gap ) X1", "msg", " Mind the ; gap "),
        ("(debug,#1)", "debug", "#1"),
        ("( print,a,b)", "print", "a,b"),
        ("(logopen,a.txt)", "logopen", "a.txt"),
        ("(debug ,a)", "comment", "debug ,a"),
        ("(msg a)", "comment", "msg a"),
        ("(logclose)", "logclose", ""),
        ("(logclose )", "comment", "logclose "),
        ("( plain )", "comment", "plain "),
        ("(message, x)", "comment", "message, x"),
        ("(msg,first)(second) ; (third)", "comment", "second"),  # the last alone counts
    ],
)
def test_comments(text, kind, what):
    assert read_line(text).comment == Comment(kind, what)


def test_o_words():
    for text, keyword, label, count in (
        ("o100 sub", "SUB", 100, 0),
        ("N5 O 0100 EndSub [1]", "ENDSUB", 100, 1),
        ("o<Some Name> call [1] [#2] [sin[3]]", "CALL", "somename", 3),
        ("o#1 call", "CALL", None, 0),
        ("o[#1+1] call [2]", "CALL", None, 1),
        ("o7 (only a label)", "", 7, 0),
        ("o1 while #1", "WHILE", 1, 1),
        ("o1 repeat [3] (comment)", "REPEAT", 1, 1),
    ):
        flow = read_line(text).flow
        assert (flow.keyword, flow.label, len(flow.values)) == (keyword, label, count)
        assert (flow.node is None) == (label is not None)


def test_messages_show_parameters(parameters):
    parameters.set("V", 1.123456789)
    text = "#<v>, %d#<V> and %f#< v >, %.2fis  #<v>; #1 #<no> #99999"
    expected = "1.123457, 1 and 1.1235, is  1.12; 0.00 ###### ######"
    assert parameters.fill_in(text) == expected


def test_comments_may_hold_any_letters(parameters):
    assert words("X1 (Überlänge ß) Y2 ; µm", parameters) == {"X": 1, "Y": 2}


NUMBER = st.from_regex(r"\A[+-]?([0-9]{1,4}(\.[0-9]{0,4})?|\.[0-9]{1,4})\Z")
WORD = st.tuples(st.sampled_from("GNXYZABIJKRFSTPQLHDEMgxyz%$#[]("), NUMBER | st.just("")).map(
    "".join
)


@settings(deadline=None)
@given(
    st.lists(WORD | st.sampled_from([" ", "\t", "(c)", "(", ")", "=", "/", "*"]), max_size=8).map(
        "".join
    )
)
def test_fast_and_careful_reading_agree(text):
    """The one-expression reader gives what the careful one gives, or leaves the line to it."""

    def outcome(read):
        try:
            line = read()
            block = line and line.block(Parameters())
        except Fault as fault:
            return str(fault), fault.column, fault.text
        return block and (block.words, block.g, block.m, len(line.settings), line.comment)

    assert outcome(lambda: read_line(text)) == outcome(_Reader(text).read)


@settings(deadline=None)
@given(st.text(max_size=40))
def test_any_text_is_read_or_refused_with_its_place(text):
    fault = None
    try:
        read_block(text, Parameters())
    except Fault as refusal:
        fault = refusal
    if fault is not None:
        assert 1 <= fault.column <= len(text) + 1
        assert fault.text in text or fault.text.endswith("...")
