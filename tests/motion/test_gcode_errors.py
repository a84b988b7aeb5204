"""Every refusal names the line, the column and the words."""

from __future__ import annotations

import pytest

from pulsewright.errors import GcodeError, UsageError
from pulsewright.motion.gcode import InterpreterSettings, interpret, interpret_text

FEED = "F100\n"

# program, line, column, offending text, part of the message
CASES = [
    # words and values
    ("G0 X1 Y", 1, 7, "Y", "a number is missing after Y"),
    ("G0 XY2", 1, 4, "X", "a number is missing after X"),
    ("G0 X1.2.3", 1, 5, "1.2.3", "not a number"),
    ("G0 X.", 1, 5, ".", "not a number"),
    ("G0 X1e3", 1, 6, "e3", "exponents"),
    ("G0 X" + "9" * 400, 1, 5, "9" * 57 + "...", "too large"),
    ("G0 X1 X2", 1, 7, "X2", "a second X word"),
    ("G0 ?1", 1, 4, "?", "unexpected character '?'"),
    ("G0 X1 /", 1, 7, "/", "unexpected character"),
    ("G0 N5 X1", 1, 4, "N", "at the beginning"),
    ("G0 X1 (open", 1, 7, "(", "not closed"),
    ("G0 X1 (a (b)", 1, 7, "(", "holds another"),
    ("G0 X1 )", 1, 7, ")", "no comment begins"),
    ("G0 X٣", 1, 4, "X", "a number is missing"),
    ("\u017f100", 1, 1, "\u017f", "unexpected character"),  # the long s, whose capital is S
    # expressions and parameters
    ("G0 X[1+", 1, 7, "+", "a number is missing after +"),
    ("G0 X[1+2", 1, 5, "[1+2", "] is missing"),
    ("G0 X[2 [3]]", 1, 5, "[2", "an operator or ] is missing"),
    ("G0 X[1/0]", 1, 7, "/0", "division by zero"),
    ("G0 X[5 MOD 0]", 1, 8, "MOD 0", "no result"),
    ("G0 X sqrt[-1]", 1, 6, "sqrt[-1]", "no result for -1"),
    ("G0 X[[0-8]**[1/3]]", 1, 11, "**[1/3]", "no result"),
    ("G0 Xfoo[2]", 1, 5, "foo", "unknown function"),
    ("G0 Xatan[1]", 1, 5, "atan[1]", "ATAN[y]/[x]"),
    ("G0 Xexp[1000]", 1, 5, "exp[1000]", "no result"),
    ("G0 X" + "[" * 60, 1, 54, "[", "nested deeper"),
    ("G0 X#<depth>", 1, 5, "#<depth>", "#<depth> has not been set"),
    ("G0 X#6000", 1, 5, "#6000", "1 to 5601"),
    ("G0 X#0", 1, 5, "#0", "1 to 5601"),
    ("G0 X#1.5", 1, 5, "#1.5", "whole number"),
    ("#1 5", 1, 1, "#1 5", "= is missing"),
    ("#<a=1", 1, 1, "#<a=1", "> is missing"),
    ("#5420=1", 1, 1, "#5420", "cannot be set"),
    ("#<_feed>=1", 1, 1, "#<_feed>", "cannot be set"),
    ("#6000=1", 1, 1, "#6000", "1 to 5601"),
    ("G0 X#<_nothing>", 1, 5, "#<_nothing>", "#<_nothing> has not been set"),
    # the flow of control
    ("O100 sub", 1, 1, "O100 sub", "not closed by o100 endsub"),
    ("o1 sub\no1 endsub\no1 sub\no1 endsub", 3, 1, "o1 sub", "o1 sub is in line 1 already"),
    ("O100 if [1]\nG0 X1", 1, 1, "O100 if [1]", "not closed by o100 endif"),
    ("o100 do\no100 endwhile", 1, 1, "o100 do", "not closed by o100 while"),
    ("G0 X1\no<a> endwhile", 2, 1, "o<a> endwhile", "belongs to nothing before it"),
    ("o1 if [1]\no2 else\no1 endif", 2, 1, "o2 else", "belongs to nothing before it"),
    ("o5 break", 1, 1, "o5 break", "belongs to nothing before it"),
    ("N1 o<x> call", 1, 4, "o<x> call", "there is no o<x> sub in this program, and no x.ngc"),
    ("o100 call [1/0]", 1, 13, "/0", "division by zero"),
    ("o100 if", 1, 1, "o100 if", "if needs a value"),
    ("o100 while [1] [2]", 1, 16, "[2]", "does not belong to while"),
    ("o100 else [2]", 1, 11, "[2]", "does not belong to else"),
    ("o1 if [0]\no1 else G0 X1\nX2\no1 endif", 2, 9, "G0 X1", "does not belong to else"),
    ("o1 if [0]\nX1\no1 elseif [#1 eq 0\nX2\no1 endif", 3, 11, "[#1 eq 0", "] is missing"),
    ("o<else> if [0]\no<else> elseif\no<else> endif", 2, 1, "o<else> elseif", "needs a value"),
    ("o100 wile [1]", 1, 1, "o100 wile [1]", "there is no sub, call, return"),
    ("o100.5 sub", 1, 1, "o100.5", "whole"),
    ("o sub", 1, 1, "o", "missing after O"),
    ("o<x sub", 1, 1, "o<x sub", "> is missing"),
    ("o#1 sub", 1, 1, "o#1 sub", "with call alone"),
    ("o[1.5] call", 1, 1, "o[1.5] call", "whole number, not 1.5"),
    ("G0 X1 o100 sub", 1, 7, "o", "at the beginning"),
    ("G0 X1\no1 return", 2, 1, "o1 return", "outside of a running subroutine"),
    ("M98 P7", 1, 1, "M98 P7", "no subprogram O7"),
    ("M98", 1, 1, "M98", "needs P"),
    ("o1 sub\nM72\no1 endsub\no1 call", 2, 1, "M72", "without M70"),
    # codes
    ("G5.5", 1, 1, "G5.5", "unknown code G5.5"),
    ("G1.55 X1", 1, 1, "G1.55", "one decimal"),
    ("M77", 1, 1, "M77", "unknown code M77"),
    ("M1.5", 1, 1, "M1.5", "whole number"),
    ("G-1", 1, 1, "G-1", "unknown code"),
    # splines
    ("F1 G5 X1 Y1", 1, 4, "G5", "G5 needs P"),
    ("F1 G5 X1 Y1 P1 Q1", 1, 4, "G5", "needs I and J"),
    ("F1 G5 X1 I1 P1 Q1", 1, 10, "I1", "both I and J"),
    ("F1 G5 X1 Z1 I1 J1 P1 Q1", 1, 10, "Z1", "X and Y alone"),
    ("F1 G18 G5 X1 I1 J1 P1 Q1", 1, 8, "G5", "plane of G17"),
    ("G93 G5 X1 I1 J1 P1 Q1 F1", 1, 5, "G5", "inverse time"),
    ("G5 X1 I1 J1 P1 Q1", 1, 1, "G5", "the feed is 0"),
    ("F1 G5 X1 I1 J[10**9] P1 Q1", 1, 7, "X1", "more than 1e+09 mm"),
    ("F1 G41.1 D.1\nG5.1 X9 I1 J1", 2, 1, "G5.1", "with cutter compensation"),
    ("F1 G5.1 X1 I1", 1, 4, "G5.1", "G5.1 needs J"),
    ("F1 G5.2 X1", 1, 9, "X1", "both X and Y"),
    ("F1 G5.2 X1 Y1 P0", 1, 15, "P0", "above 0"),
    ("F1 G5.2 X1 Y1\nX2 Y2", 2, 1, "X2 Y2", "needs P"),
    ("F1 G5.2 X1 Y1 L1.5", 1, 15, "L1.5", "2 or more"),
    ("F1 G5.2 X1 Y1\nG5.3", 2, 1, "G5.3", "at least 3 control points"),
    ("F1 G5.2 X1 Y1\nG0 X2\nG5.3", 3, 1, "G5.3", "other motion"),
    ("G5.3", 1, 1, "G5.3", "that G5.2 has begun"),
    ("F1 G5.2 X1 Y1\nM2", 2, 1, "M2", "between G5.2 and G5.3"),
    ("G71", 1, 1, "G71", "lathe cycles"),
    ("M100", 1, 1, "M100", "user-defined codes"),
    ("G0 G1 X1", 1, 4, "G1", "G0 and G1 exclude each other"),
    ("G17\nG90 X0 G91", 2, 8, "G91", "one of G90 G91"),
    ("M3 M5", 1, 4, "M5", "one of M3 M4 M5"),
    ("M0 M2", 1, 4, "M2", "exclude each other"),
    ("M3 M8 M48 M62 P1 M0", 1, 18, "M0", "may hold 4 M codes, not 5"),
    ("G53 G4 P1", 1, 5, "G4", "exclude each other"),
    ("G28 X1 G0", 1, 8, "G0", "would both use the axis words"),
    ("G92 X1 G1", 1, 8, "G1", "would both use the axis words"),
    # letters without a code that uses them
    ("P1", 1, 1, "P1", "G2, G3, G4, G5, G5.2, G10, G64"),
    ("G0 X1 R3", 1, 7, "R3", "nothing in this line uses the R word"),
    ("G1 F1 X1 I2", 1, 10, "I2", "G2, G3"),
    ("G61 Q1", 1, 5, "Q1", "G64"),
    ("G49 H1", 1, 5, "H1", "G43"),
    ("L2", 1, 1, "L2", "G10"),
    ("D1", 1, 1, "D1", "cutter compensation"),
    ("G43.1 Z1 H1", 1, 10, "H1", "G43, G43.2, G76"),
    # axes and motion
    ("X1", 1, 1, "X1", "without a motion mode"),
    ("G0 X1\nG80\n Y2", 3, 2, "Y2", "without a motion mode"),
    ("G80 X1", 1, 5, "X1", "without a motion mode"),
    ("G4 P1 X3", 1, 7, "X3", "without a motion mode"),
    ("G0 X1\nG0 A5", 2, 4, "A5", "it has X Y Z"),
    ("G0 U5", 1, 4, "U5", "it has X Y Z"),
    ("G1 X1", 1, 1, "G1", "the feed is 0"),
    ("G17 G1 X1", 1, 5, "G1", "the feed is 0"),
    ("F0 G1 X1", 1, 1, "F0", "the feed is 0"),
    (FEED + "G93\nG94\nG1 X1", 4, 1, "G1", "the feed is 0"),
    ("F1 G95 G1 X1", 1, 8, "G1", "the spindle, whose speed is 0"),
    ("F1 G95 G3 I1", 1, 8, "G3", "the spindle, whose speed is 0"),
    ("G93 G1 X1", 1, 5, "G1", "G93 needs F"),
    ("G93 G1 X1 F2\nX2", 2, 1, "X2", "G93 needs F"),
    ("F-1", 1, 1, "F-1", "negative"),
    ("S-1", 1, 1, "S-1", "negative"),
    ("G0 X[10**12]", 1, 4, "X[10**12]", "more than 1e+09 mm"),
    ("G53 G2 X1 I0.5 F1", 1, 1, "G53", "G0 and G1 only"),
    ("G91 G53 G0 X1", 1, 5, "G53", "use G90"),
    # arcs
    (FEED + "G2 X10", 2, 1, "G2", "I and J or R is missing"),
    (FEED + "G3 X10 K5", 2, 8, "K5", "plane of G17 the centre is given by I and J"),
    (FEED + "G18 G3 X10 J5", 2, 12, "J5", "given by K and I"),
    (FEED + "G19 G3 Y10 I5", 2, 12, "I5", "given by J and K"),
    (FEED + "G3 X10 R5 I5", 2, 8, "R5", "not both"),
    (FEED + "G2 R5", 2, 4, "R5", "full circle"),
    (FEED + "G2 X0 Y0 R5", 2, 10, "R5", "full circle"),
    (FEED + "G2 X10 R4.99", 2, 8, "R4.99", "must be 5 or more"),
    (FEED + "G2 X10 R0", 2, 8, "R0", "does not reach"),
    (FEED + "G2 I0 J0", 2, 4, "I0", "radius of the arc is 0"),
    (FEED + "G3 X10 I4", 2, 8, "I4", "is 4 at its start and 6 at its end"),
    (FEED + "G90.1 G2 X10 I5", 2, 7, "G2", "J or R is missing"),
    (FEED + "G3 X10 I5 P0", 2, 11, "P0", "1 or more"),
    (FEED + "G3 X10 I5 P1.5", 2, 11, "P1.5", "whole number"),
    ("G2 X10 I5", 1, 1, "G2", "the feed is 0"),
    # polar coordinates, cutter compensation, cycles, threads, pins
    ("G0 @5", 1, 4, "@5", "at the origin"),
    ("G0 @5 X1 ^2", 1, 4, "@5", "stand in for X and Y"),
    ("G18 G0 @5 ^30", 1, 8, "@5", "plane of G17"),
    ("G41 D1\nG42", 2, 1, "G42", "already on"),
    ("G19 G41", 1, 5, "G41", "G17 and G18"),
    ("G41.1", 1, 1, "G41.1", "needs D"),
    ("G41.1 D1\nG92 X1", 2, 1, "G92", "with cutter compensation"),
    ("G41.1 D1\nG20", 2, 1, "G20", "with cutter compensation"),
    (FEED + "G41.1 D3\nG1 X1", 3, 1, "G1 X1", "1 long; it must be longer than the tool's radius"),
    (
        FEED + "G41.1 D3\nG1 X5\nY2\nX0",
        5,
        1,
        "X0",
        "too short for the tool to go from one inside corner to the next",
    ),
    (FEED + "G42.1 D4\nG1 X9\nG2 X10 Y-1 J-1", 4, 1, "G2 X10 Y-1 J-1", "would gouge"),
    ("G81 X1 Z1 R1", 1, 1, "G81", "the feed is 0"),
    (FEED + "G81 X1 Z-1", 2, 1, "G81", "G81 needs R"),
    (FEED + "G82 X1 Z-1 R1", 2, 1, "G82", "G82 needs P"),
    (FEED + "G82 X1 Z-1 R1 P-1", 2, 15, "P-1", "must not be negative"),
    (FEED + "M3 G84 X1 Z-1 R1 P-1", 2, 18, "P-1", "must not be negative"),
    (FEED + "G83 X1 Z-1 R1 Q0", 2, 15, "Q0", "above 0"),
    (FEED + "G81 X1 Z3 R1", 2, 8, "Z3", "R is 1, below Z, which is 3"),
    (FEED + "G84 X1 Z-1 R1", 2, 1, "G84", "clockwise (M3)"),
    (FEED + "G81 X1 Z-1 R1 L0", 2, 15, "L0", "1 or more"),
    ("G33 Z1 K1", 1, 1, "G33", "needs a turning spindle"),
    ("M3 S1 G33 Z1", 1, 7, "G33", "needs K"),
    ("G76 P1", 1, 1, "G76", "G18"),
    ("M3 S1 G18 G76 P1 Z-5 I-1 J2 K1", 1, 26, "J2", "deeper than the thread"),
    ("M3 S1 G18 G76 P1 Z-5 I-1 J1 K1 Y5", 1, 32, "Y5", "G76 moves along Z"),
    ("M66", 1, 1, "M66", "needs a digital pin"),
    ("M66 P1 L3", 1, 1, "M66", "needs Q"),
    ("M62", 1, 1, "M62", "needs P"),
    ("M67 E1", 1, 1, "M67", "needs Q"),
    ("M19", 1, 1, "M19", "needs R"),
    ("M19 R400", 1, 5, "R400", "0 to 360"),
    ("M61", 1, 1, "M61", "needs Q"),
    ("G96 D10", 1, 1, "G96", "needs S"),
    # what canonical calls can say, and planned motion cannot
    ("F1 G38.2 X1", 1, 1, "F1 G38.2 X1", "cannot be planned"),
    ("G96 S1 D1", 1, 1, "G96 S1 D1", "G97"),
    ("F1 G95 G81 Z-1 R1", 1, 1, "F1 G95 G81 Z-1 R1", "its speed is 0"),
    ("G4 P[10**7]", 1, 1, "G4 P[10**7]", "more than 100000 s"),
    (
        FEED + "G10 L2 P1 R30\nG18 G2 X1 R1",
        3,
        1,
        "G18 G2 X1 R1",
        "rotated",
    ),
    # one use of a word, one code of a group
    ("M48 M50", 1, 5, "M50", "one of M48 M49 M50"),
    ("M61 Q1 M6", 1, 8, "M6", "one of M6 M61"),
    ("G92.1 G92.2", 1, 7, "G92.2", "one of G92.1 G92.2 G92.3"),
    ("G0 X1 $0", 1, 7, "$0", "it belongs to G33"),
    ("M3 $1 S10", 1, 4, "$1", "there is one spindle"),
    ("G43 I1", 1, 5, "I1", "it belongs to G2"),
    ("G10 L2 P1 X1 I3", 1, 14, "I3", "angles of a tool"),
    ("G10 L1 P0 Z1", 1, 8, "P0", "1 or more"),
    ("M98 P1 G0 X1", 1, 1, "M98", "stands alone"),
    ("o1 sub\nM99\no1 endsub\no1 call", 2, 1, "M99", "o1 is a subroutine"),
    # what needs an axis word, and which
    ("G53", 1, 1, "G53", "G0 and G1 only"),
    ("G0 X1\nG81", 2, 1, "G81", "needs an axis word"),
    ("M3 S1 G33 K1", 1, 7, "G33", "needs an axis word"),
    (FEED + "G38.2 X0", 2, 7, "X0", "a probe has to move"),
    ("G93 G38.2 X1 F1", 1, 5, "G38.2", "feed per minute"),
    ("S1 G95 G38.2 X1 F1", 1, 8, "G38.2", "feed per minute"),
    ("G53 G0 @5 ^30", 1, 8, "@5", "do not work with G53"),
    ("G28 @5 ^30", 1, 5, "@5", "not for G28"),
    # around cutter compensation
    (FEED + "G41.1 D2\nG1 X1", 3, 1, "G1 X1", "longer than the tool's radius"),
    (FEED + "G41.1 D2\nG1 Z1", 3, 1, "G1 Z1", "longer than the tool's radius"),
    (FEED + "G41.1 D2\nG3 X1.5 I.75", 3, 1, "G3 X1.5 I.75", "too small for the tool's radius"),
    (FEED + "G41.1 D2\nG43.1 Z1", 3, 1, "G43.1", "with cutter compensation"),
    (FEED + "G41.1 D2\nG53 G0 X9", 3, 1, "G53", "with cutter compensation"),
    ("G41.1 D2\nG28.1", 2, 1, "G28.1", "with cutter compensation"),
    (FEED + "G41.1 D2\nG1 X9\nG40\nG2 X20 I5", 5, 1, "G2", "must be straight"),
    (FEED + "G41.1 D2\nG1 X9\nG40\nG5 X20 I5 J0 P-1 Q0", 5, 1, "G5", "must be straight"),
    ("G41.1 D1\nM70\nG40\nM72", 4, 1, "M72", "on again"),
    ("G41.1 D1 L3", 1, 10, "L3", "works in G18"),
    # settings
    ("G4", 1, 1, "G4", "needs its time"),
    ("G4 P-1", 1, 4, "P-1", "0 seconds or more"),
    ("T1.5", 1, 1, "T1.5", "whole number"),
    ("T-1", 1, 1, "T-1", "0 or more"),
    ("G43 H-1", 1, 5, "H-1", "0 or more"),
    ("G64 P-.1", 1, 5, "P-.1", "negative"),
    ("G64 P.1 Q-1", 1, 9, "Q-1", "negative"),
    ("G92", 1, 1, "G92", "needs an axis word"),
    ("G10 P1 X3", 1, 1, "G10", "one of G10 L2"),
    ("G10 L3 P1 X3", 1, 5, "L3", "one of G10 L2"),
    ("G10 L20 P1 X1 R30", 1, 15, "R30", "set with G10 L2"),
    ("G10 L1 Z3", 1, 1, "G10", "needs P"),
    ("G10 L2 X1", 1, 1, "G10", "needs its coordinate system"),
    ("G10 L2 P10 X1", 1, 8, "P10", "0 to 9"),
]


@pytest.mark.parametrize(("text", "line", "column", "words", "message"), CASES)
def test_a_refusal_names_its_place(text, line, column, words, message):
    with pytest.raises(GcodeError) as refusal:
        interpret_text(text, "part.ngc")
    error = refusal.value
    assert (error.path, error.line, error.column) == ("part.ngc", line, column)
    assert error.text == words
    assert message in str(error)
    place = f"part.ngc:{line}:{column}: " if column else f"part.ngc:{line}: "
    assert str(error).startswith(place)


def test_columns_count_what_the_line_shows():
    """Spaces, tabs and comments before and within a word keep their columns."""
    with pytest.raises(GcodeError) as refusal:
        interpret_text("\n(first) N7  g 0\t(x) x 1 . 2 . 3 (y)")
    assert (refusal.value.line, refusal.value.column) == (2, 9)  # N after a comment
    with pytest.raises(GcodeError) as refusal:
        interpret_text("\n N7  g 0\t(x) x 1 . 2 . 3 (y)")
    error = refusal.value
    assert (error.line, error.column, error.text) == (2, 16, "1 . 2 . 3")


def test_lines_count_alike_with_all_line_ends():
    for end in ("\n", "\r\n", "\r"):
        with pytest.raises(GcodeError) as refusal:
            interpret_text(end.join(["(a)", "", "G0 X1", "M77", ""]))
        assert refusal.value.line == 4


@pytest.mark.parametrize("length", [65_535, 65_536, 65_537, 131_072, 200_001])
def test_lines_of_long_programs_are_counted(length):
    """Line ends are found in parts of 65 536 bytes: no one is lost where two parts meet."""
    lines = length // 10
    text = "G0 X1.000\n" * (lines - 1) + "G0 X2.000".ljust(10 + length % 10 - 1) + "\n"
    assert len(text) == length
    with pytest.raises(GcodeError) as refusal:
        interpret_text(text + "M77\n")
    assert (refusal.value.line, refusal.value.text) == (lines + 1, "M77")


def test_tools_must_be_in_the_table():
    settings = InterpreterSettings(tools={1: 10.0, 4: 3.0})
    for text, column, words in (("G43 H2", 5, "H2"), ("M6 T2", 4, "T2"), ("T2", 1, "T2")):
        with pytest.raises(
            GcodeError, match="tool 2 is not in the tool table, which has 1, 4"
        ) as e:
            interpret_text(text, settings=settings)
        assert (e.value.line, e.value.column, e.value.text) == (1, column, words)


def test_axis_errors_name_the_axes_of_the_machine():
    with pytest.raises(GcodeError, match="it has X Z A"):
        interpret_text("G0 Y1", settings=InterpreterSettings(axes="XZA"))


@pytest.mark.parametrize("text", ["", "\n\n", "(only a comment)\n; another", "%\n%", "%"])
def test_an_empty_program_is_refused(text):
    with pytest.raises(GcodeError):
        interpret_text(text)


def test_a_program_cut_off_before_its_closing_percent_is_refused():
    with pytest.raises(GcodeError, match="cut short") as refusal:
        interpret_text("%\nG0 X1\nG0 X2")
    assert refusal.value.line == 3


def test_files_that_are_no_programs_are_refused(tmp_path):
    with pytest.raises(GcodeError, match="no such file"):
        interpret(tmp_path / "missing.ngc")
    with pytest.raises(GcodeError, match="directory"):
        interpret(tmp_path)
    for name, data, message in (
        ("nul.ngc", b"G0 X1\0", "NUL"),
        ("utf16.ngc", "G0 X1".encode("utf-16"), "NUL"),
        ("latin.ngc", b"G0 X1\nG0 \xe4 X2", "unexpected character"),
        ("empty.ngc", b"", "empty"),
    ):
        path = tmp_path / name
        path.write_bytes(data)
        with pytest.raises(GcodeError, match=message) as refusal:
            interpret(path)
        assert refusal.value.path == str(path)


def test_comments_of_old_encodings_are_read(tmp_path):
    path = tmp_path / "old.ngc"
    path.write_bytes(b"\xef\xbb\xbfG0 X1 (M\xc3\xbcll)")
    assert interpret(path).moves.end[0, 0] == 1
    path.write_bytes(b"G0 X2 (M\xfcll)")
    assert interpret(path).moves.end[0, 0] == 2


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"axes": ""}, "axes"),
        ({"axes": "XYX"}, "axes"),
        ({"axes": "XU"}, "axes"),
        ({"start": (0, 0, 0)}, "start must be 6"),
        ({"home": (0, 0, 0, 0, 0, float("nan"))}, "home"),
        ({"work_offsets": {"G53": (0,) * 6}}, "unknown work offset G53"),
        ({"work_offsets": {"G55": (0, 0)}}, "G55 must be 6"),
        ({"path_tolerance": 0}, "path_tolerance"),
        ({"exact_tolerance": -1}, "exact_tolerance"),
    ],
)
def test_settings_are_checked(setting, message):
    with pytest.raises(UsageError, match=message):
        InterpreterSettings(**setting)
