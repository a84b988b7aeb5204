"""Random programs of the whole dialect through this interpreter and through LinuxCNC's."""

from __future__ import annotations

import math
import os
import random
import re
from dataclasses import replace

import oracle
import pytest

from pulsewright.errors import GcodeError
from pulsewright.motion.gcode import canonical
from pulsewright.motion.gcode.run import STAND_ALONE
from pulsewright.motion.gcode.tools import read_tools
from pulsewright.units import INCH

TABLE = """T1 P1 Z0.5 D0.0625;first tool
T2 P2 Z0.7 X.1 D0.125;
T3 P3 Z0.5 D0.25;
T4 P4 Z0.7 D1.0 I10 J20 Q3;
"""
NUMBER = re.compile(r"-?\d+\.\d+")


@pytest.fixture(scope="module")
def compare(tmp_path_factory):
    """Return a function that runs a text through both and finds the first difference."""
    oracle.require_rs274()

    def run(text):
        folder = tmp_path_factory.mktemp("rs274")  # its parameters are kept there
        (folder / "p.ngc").write_text(text)
        (folder / "t.tbl").write_text(TABLE)
        theirs = oracle.rs274("p.ngc", folder, "-t", "t.tbl", timeout=20)
        lines, failure = [], ""
        tools = read_tools(folder / "t.tbl", INCH)
        try:
            canonical(folder / "p.ngc", lines.append, settings=replace(STAND_ALONE, tools=tools))
        except GcodeError as error:
            failure = str(error)
        refused = [line for line in theirs.stderr.splitlines() if line.strip() != "executing"]
        return difference(calls("".join(lines)), calls(theirs.stdout), failure, refused)

    return run


def calls(text):
    """Return names and numbers of canonical calls, without what versions do differently."""
    text = re.sub(r".*(START_CHANGE|ON_RESET)\(.*\n", "", text)
    text = re.sub(r"CHANGE_TOOL\(\d*\)", "CHANGE_TOOL()", text)
    found = []
    for line in text.splitlines():
        match = re.match(r"\s*\d+ (N.*)", line)
        if match:
            numbers = [float(n) for n in NUMBER.findall(match[1])]
            found.append((" ".join(NUMBER.sub("?", match[1]).split()), numbers))
    return found


def difference(ours, theirs, failure, refused):
    """Return what is different first; None if nothing is."""
    for i, (mine, other) in enumerate(zip(ours, theirs, strict=False)):
        same = mine[0] == other[0] and mine[1] == pytest.approx(other[1], abs=2e-4)
        if not same:
            return f"call {i}: {mine} instead of {other}; {failure}; {refused}"
    if "too short" in failure and not refused:
        return None  # an entry into compensation that gouges, which rs274 lets pass
    if bool(failure) != bool(refused):
        return f"refusal: ours {failure!r}, theirs {refused}"
    if not failure and len(ours) != len(theirs):
        return f"{len(ours)} calls instead of {len(theirs)}"
    return None


class Writer:
    """Writes one random program."""

    def __init__(self, seed):
        self.rng = random.Random(seed)
        self.lines = []
        self.label = 100

    def number(self, low=-20, high=20):
        return round(self.rng.uniform(low, high), 3)

    def value(self, low=-20, high=20, depth=0):
        """Return a number, or an expression with about its value."""
        rng = self.rng
        kind = rng.random()
        if kind < 0.7 or depth > 2:
            return f"{self.number(low, high)}"
        if kind < 0.8:
            a, b = self.number(low / 2, high / 2), self.value(low / 2, high / 2, depth + 1)
            return f"[{a} {rng.choice('+-')} {b}]"
        if kind < 0.9:
            return f"[{self.number(low, high)}*{rng.choice(['COS', 'SIN'])}[{self.number(0, 360)}]]"
        name = rng.choice(["FIX", "FUP", "ROUND", "ABS"])
        return f"[{name}[{self.value(low, high, depth + 1)}] MOD 20]"

    def axes(self, letters="XYZ", chance=0.6):
        return "".join(f" {a}{self.value()}" for a in letters if self.rng.random() < chance)

    def straight(self):
        axes = self.axes("XYZAB" if self.rng.random() < 0.1 else "XYZ")
        feed = f" F{self.number(10, 500)}" if self.rng.random() < 0.2 else ""
        self.lines.append(f"G{self.rng.randrange(2)}{axes}{feed}")

    def arc(self):
        rng = self.rng
        plane = rng.randrange(3)
        (u, v, w), (i, j) = [("XYZ", "IJ"), ("ZXY", "KI"), ("YZX", "JK")][plane]
        radius, first = self.number(1, 10), self.number(0, 6)
        angle = self.number(0.2, 6)
        clockwise = rng.random() < 0.5
        turn = first - angle if clockwise else first + angle
        cu, cv = -radius * math.cos(first), -radius * math.sin(first)
        du, dv = cu + radius * math.cos(turn), cv + radius * math.sin(turn)
        words = f"{u}{du:.6f} {v}{dv:.6f} "
        if rng.random() < 0.3 and abs(angle - math.pi) > 0.3:
            words += f"R{radius if angle < math.pi else -radius}"
        else:
            words += f"{i}{cu:.6f} {j}{cv:.6f}"
        if rng.random() < 0.3:
            words += f" {w}{self.number()}"
        if rng.random() < 0.2:
            words += f" P{rng.randrange(1, 4)}"
        self.lines += ["G91 F100", f"G{17 + plane} G{2 if clockwise else 3} {words}", "G90"]

    def offsets(self):
        rng = self.rng
        self.lines.append(
            rng.choice(
                [
                    f"G10 L2 P{rng.randrange(10)}{self.axes('XYZA')}",
                    f"G10 L20 P{rng.randrange(10)}{self.axes('XYZ')}",
                    f"G10 L1 P{rng.randrange(1, 5)} Z{self.number()} R{self.number(0, 3)}",
                    f"G10 L10 P{rng.randrange(1, 5)}{self.axes('X')} Z1",
                    f"G10 L11 P{rng.randrange(1, 5)}{self.axes('X')} Z1",
                    f"G92{self.axes('XYZ')} X{self.number()}".replace(" X", " A", 1),
                    f"G52 Y{self.number()}",
                    rng.choice(["G54", "G55", "G57", "G59.2", "G59.3"]),
                    rng.choice(["G92.1", "G92.2", "G92.3"]),
                    "G28.1",
                    "G30.1",
                    f"G28{self.axes('XYZ')}",
                    f"G30 Z{self.number()}",
                    f"G53 G0{self.axes('XYZ')}",
                ]
            )
        )

    def tool(self):
        rng, n = self.rng, self.rng.randrange(1, 5)
        # without length, and moved since, or rs274 alone does not know where a change leaves it
        here = f"G49\nG0{self.axes('XYZAB', 1)}\n"
        self.lines.append(
            rng.choice(
                [
                    f"{here}T{n} M6",
                    f"{here}T{n} M6\nG43",
                    f"{here}M61 Q{n}",
                    f"T{n}",
                    f"G43 H{n}",
                    f"G43.2 H{n}",
                    "G43.2 X1 Z.5",
                    f"G43.1 Z{self.number()} X{self.number()}",
                    "G49",
                ]
            )
        )

    def compensation(self):
        rng, side = self.rng, self.rng.choice((41, 42))
        self.lines += ["G40 G21 G90 G17", rng.choice(("G61", "G64")), "F200"]
        self.lines.append(f"G0{self.axes('XY', 1)}")
        diameter = rng.choice(("", f" D{rng.randrange(1, 4)}", f".1 D{self.number(0.2, 3)}"))
        self.lines += [f"G{side}{diameter}", f"G1{self.axes('XY', 1)}"]
        for _ in range(rng.randrange(2, 7)):
            if rng.random() < 0.65:
                self.lines.append(f"G{rng.choice((1, 1, 1, 0))}{self.axes('XY', 1)}")
                self.lines[-1] += self.axes("Z", 0.2)
            else:
                self.simple_arc(self.number(2, 12), self.number(0, 6), self.number(0.3, 5))
        self.lines += ["G40", f"G0{self.axes('XY', 1)} Z5"]

    def lathe(self):
        """A lathe tool's contour, perhaps in diameters; entered along a line."""
        rng, side, scale = self.rng, self.rng.choice((41, 42)), self.rng.choice((1, 1, 2))

        def straight():
            return f"X{scale * self.number()} Z{self.number()}"

        self.lines += ["G40 G21 G90 G18", "G7" if scale == 2 else "G8", "F200", f"G0 {straight()}"]
        diameter = f"D{rng.choice('-+')}{self.number(0.2, 3)} L{rng.randrange(10)}"
        self.lines += [f"G{side}.1 {diameter}", f"G1 {straight()}"]
        for _ in range(rng.randrange(2, 7)):
            kind = rng.random()
            if kind < 0.6:
                self.lines.append(f"G{rng.choice((1, 1, 1, 0))} {straight()}")
            elif kind < 0.8:
                said = rng.choice(("(c)", "(msg,m)", "M8", "F77", "G4 P1", f"Y{self.number()}"))
                self.lines.append(said)
            else:
                radius, first = self.number(2, 12), self.number(0, 6)
                clockwise, angle = rng.random() < 0.5, self.number(0.3, 5)
                turn = first - angle if clockwise else first + angle
                k, i = -radius * math.cos(first), -radius * math.sin(first)
                z, x = k + radius * math.cos(turn), i + radius * math.sin(turn)
                words = f"X{scale * x:.6f} Z{z:.6f} I{i:.6f} K{k:.6f}"
                self.lines += ["G91", f"G{2 if clockwise else 3} {words}", "G1 G90"]
        self.lines += ["G40", f"G0 {straight()}"]

    def series(self):
        """Holes with changes of everything that a series of them keeps."""
        rng = self.rng
        self.lines += ["F10 S10 M3", f"G{rng.choice((17, 17, 18, 19))} G9{rng.choice('89')} G90"]
        plane = self.lines[-1][:3]
        w, u, v = {"G17": "ZXY", "G18": "YZX", "G19": "XYZ"}[plane]
        self.lines.append(f"G0 {w}{rng.randrange(-3, 8)}")
        first = True
        for _ in range(rng.randrange(2, 9)):
            if rng.random() < 0.15:
                self.lines.append(rng.choice((f"G0 {w}{rng.randrange(-3, 8)}", "G80")))
                first = True
                continue
            line = rng.choice(("", "", "", "G90 ", "G91 ", "G98 ", "G99 "))
            bottom, retract = rng.randrange(-6, 2), rng.randrange(1, 5)
            if first or rng.random() < 0.3:
                code, extra = rng.choice(((81, ""), (82, "P1 "), (83, "Q.7 "), (73, "Q1 ")))
                line += f"G{code} {w}{bottom} R{retract} {extra}"
                first = False
            elif rng.random() < 0.5:
                line += rng.choice((f"R{retract} ", f"{w}{bottom} "))
            self.lines.append(f"{line}{u}{rng.randrange(9)} {v}{rng.randrange(9)}")
            self.lines[-1] += rng.choice(("", "", f" L{rng.randrange(1, 4)}"))

    def spline(self):
        x, y, i, j, p, q = (self.number() for _ in range(6))
        points = [f"X{self.number()} Y{self.number()} P{self.number(0.1, 3)}" for _ in range(4)]
        self.lines += self.rng.choice(
            [
                [f"G5 X{x} Y{y} I{i} J{j} P{p} Q{q}", f"G5 X{y} Y{x} P{q} Q{p}"],
                [f"G5.1 X{x} Y{y} I{i} J{j}"],
                [f"G5.2 {points[0]} L{self.rng.randrange(2, 5)}", *points[1:], "G5.3", "G0"],
            ]
        )

    def simple_arc(self, radius, first, angle):
        clockwise = self.rng.random() < 0.5
        turn = first - angle if clockwise else first + angle
        i, j = -radius * math.cos(first), -radius * math.sin(first)
        x, y = i + radius * math.cos(turn), j + radius * math.sin(turn)
        words = f"X{x:.6f} Y{y:.6f} I{i:.6f} J{j:.6f}"
        self.lines += ["G91", f"G{2 if clockwise else 3} {words}", "G90"]

    def modes(self):
        rng = self.rng
        self.lines.append(
            rng.choice(
                [
                    rng.choice(
                        ["G49\nG20 F10\nG64", "G49\nG21 F300\nG64", "G61", "G61.1", "G64 P.1"]
                    ),
                    rng.choice(["G98", "G99", "G17", "G18", "G19", "G80"]),
                    rng.choice(["M3 S100", "M4 S50", "M5", "M7", "M8", "M9", "M48", "M49"]),
                    rng.choice(["M50 P0", "M51", "M52 P1", "M53", "S300", "F77"]),
                    rng.choice(["M62 P1", "M64 P3", "M67 E1 Q2.5", "M68 E0 Q1", "M0", "M1", "M60"]),
                    rng.choice(["G90.1", "G91.1", "G4 P.5", "M19 R30", "G97 S200"]),
                    f"G64 P{self.number(0, 1)} Q{self.number(0, 1)}",
                ]
            )
        )

    def cycle(self):
        rng = self.rng
        plane = rng.randrange(3)
        u, v, w = ["XYZ", "ZXY", "YZX"][plane]
        code, extra, spindle = rng.choice(
            [
                ("73", f"Q{self.number(1, 4)}", 3),
                ("74", "P.1", 4),
                ("81", "", 5),
                ("82", "P.5", 5),
                ("83", f"Q{self.number(1, 4)}", 3),
                ("84", "", 3),
                ("85", "", 3),
                ("86", "P.2", 4),
                ("88", "P.3", 3),
                ("89", "P.4", 5),
            ]
        )
        bottom = self.number(-10, 5)
        retract = bottom + self.number(0.1, 10)
        self.lines += [f"G{17 + plane} F50 S100 M{spindle}", f"G9{rng.choice('89')}"]
        self.lines.append(f"G90 G0 {w}{self.number(-5, 20)}")
        if rng.random() < 0.3:
            depth = self.number(0.1, 5)
            repeat = "L2" if code != "74" else ""  # which version 2.9 refuses there
            line = f"G91 G{code} {u}1 {v}2 {w}-{depth} R{self.number()} {extra} {repeat}"
            self.lines.append(line)
            self.lines.append(f"{u}3 {v}1")
        else:
            line = f"G{code} {u}{self.number()} {v}{self.number()} {w}{bottom} R{retract} {extra}"
            self.lines.append(line)
            self.lines += [f"{u}{self.number()}", f"{v}{self.number()} G99"][: rng.randrange(3)]
        self.lines.append(rng.choice(["G80", "G0", f"G0 {w}20"]))
        self.lines.append("G90 G17")

    def flow(self):
        rng = self.rng
        self.label += 10
        n = self.label
        body = f"G91 G1 X#{n} F100"
        flow = rng.choice(
            [
                [f"#{n}={self.value()}", f"#<v{n}>=[#{n}*2]", f"G0 X#<v{n}>", f"(debug,#{n})"],
                [f"#{n}=0", f"o{n} while [#{n} lt 3]", f"#{n}=[#{n}+1]", body, f"o{n} endwhile"],
                [f"#{n}=0", f"o{n} do", f"#{n}=[#{n}+1]", body, f"o{n} while [#{n} lt 2]"],
                [f"#{n}=1", f"o{n} repeat [{rng.randrange(4)}]", body, f"o{n} endrepeat"],
                [
                    f"#{n}={self.number()}",
                    f"o{n} if [#{n} gt 5]",
                    "G0 X1",
                    f"o{n} elseif [#{n} gt 0]",
                    "G0 X2",
                    f"o{n} else",
                    "G0 X3",
                    f"o{n} endif",
                ],
                [
                    f"o{n} sub",
                    "(print,#1 #2 #<_call_level>)",
                    f"#{n}=[#1+#2]",
                    f"o{n + 1} if [#1 gt 2]",
                    f"o{n} return [#1]",
                    f"o{n + 1} endif",
                    "#1=5",
                    "(debug,#1 #3)",
                    f"o{n} endsub [7]",
                    f"o{n} call [{self.number(0, 5)}] [{self.value()}]",
                    f"(debug,#<_value> #{n} #1)",
                ],
                [
                    f"#{n}=0",
                    f"o{n} while [1]",
                    f"#{n}=[#{n}+1]",
                    f"o{n + 1} if [#{n} eq 2]",
                    f"o{n} continue",
                    f"o{n + 1} endif",
                    f"o{n + 2} if [#{n} gt 4]",
                    f"o{n} break",
                    f"o{n + 2} endif",
                    f"G0 Y#{n}",
                    f"o{n} endwhile",
                ],
            ]
        )
        # after a break, a do loop of rs274 ends in its first round
        if f"o{n} do" in flow and any(" break" in line for line in self.lines):
            return
        self.lines += flow
        self.lines.append("G90")

    def thread(self):
        rng = self.rng
        self.lines += [
            "G18 M3 S100 G90",
            f"G0 X{self.number()} Z{self.number(0, 5)}",
            rng.choice(
                [
                    f"G76 P{self.number(0.2, 2)} Z{self.number(-20, -8)} "
                    f"I{rng.choice('-+')}{self.number(0.1, 2)} J{self.number(0.2, 0.5)} "
                    f"K{self.number(0.6, 2)} R{self.number(1, 2)} Q{self.number(0, 30)} "
                    f"H{rng.randrange(3)} E{self.number(0.1, 1)} L{rng.randrange(4)}",
                    f"G33 Z{self.number()} K{self.number(0.1, 2)}",
                    f"G33.1 Z{self.number()} K{self.number(0.1, 2)}",
                ]
            ),
            "G17",
        ]

    def inverse_time(self):
        self.lines += ["G93", f"G1 X{self.number()} F{self.number(1, 9)}"]
        self.lines += [f"G1 A{self.number()} F2", f"Y{self.number()} Z{self.number()} F.5"]
        self.lines.append("G94 F200")

    def parameters(self):
        self.lines.append(
            "(debug,#5420 #5421 #5422 #5423 #<_x> #<_feed> #<_rpm> #<_plane> #<_metric> "
            "#<_coord_system> #<_absolute> #5220 #<_motion_mode>)"
        )

    def program(self, parts, count):
        self.lines = ["T1 M6", "G21 G90 F100 S10", "G0 X1 Y2 Z3"]
        for _ in range(count):
            getattr(self, self.rng.choice(parts))()
        return "\n".join([*self.lines, "M2", ""])


PARTS = [
    *["straight"] * 3,
    *["arc"] * 2,
    "offsets",
    "modes",
    "cycle",
    "flow",
    "thread",
    "inverse_time",
    "parameters",
]


def rounds():
    return range(int(os.environ.get("PULSEWRIGHT_CAMPAIGN", "40")))


@pytest.mark.campaign
@pytest.mark.parametrize("seed", rounds())
def test_random_programs_have_the_same_canonical_calls(compare, seed):
    text = Writer(seed).program(PARTS, 12)
    assert compare(text) is None, text


@pytest.mark.campaign
@pytest.mark.parametrize("seed", rounds())
def test_random_tools_have_the_same_canonical_calls(compare, seed):
    text = Writer(seed).program(["tool", "tool", "straight", "offsets", "parameters"], 10)
    assert compare(text) is None, text


@pytest.mark.campaign
@pytest.mark.parametrize("seed", rounds())
def test_random_contours_are_compensated_alike(compare, seed):
    text = Writer(seed).program(["compensation"], 1)
    assert compare(text) is None, text


@pytest.mark.campaign
@pytest.mark.parametrize("part", ["lathe", "series", "spline"])
@pytest.mark.parametrize("seed", rounds())
def test_random_programs_of_one_kind_have_the_same_canonical_calls(compare, seed, part):
    text = Writer(seed).program([part], 1 + 2 * (part == "spline"))
    assert compare(text) is None, text


WRAPPED = """[EMC]
VERSION = 1.1
[TRAJ]
COORDINATES = X Y Z A
LINEAR_UNITS = inch
[AXIS_A]
WRAPPED_ROTARY = 1
"""


def test_wrapped_axes_turn_alike(tmp_path):
    oracle.require_rs274()
    rng = random.Random(5)
    lines = ["G90 G1 F100 A0"]
    for _ in range(200):
        angle = rng.choice((0.0, 90.0, 359.5, round(rng.uniform(0, 360), 2)))
        word = f"A{rng.choice(('', '-'))}{angle:g}"
        lines.append(rng.choice([word, word, f"X{angle:g} {word}", f"G91 {word}\nG90"]))
        if rng.random() < 0.1:
            lines.append(rng.choice([f"G92 {word}", f"G10 L2 P1 {word}", f"G52 {word}"]))
    (tmp_path / "p.ngc").write_text("\n".join([*lines, "M2", ""]))
    (tmp_path / "w.ini").write_text(WRAPPED)
    theirs = oracle.rs274("p.ngc", tmp_path, "-i", "w.ini", timeout=20)
    ours = []
    settings = replace(STAND_ALONE, axes="XYZA", wrapped="A")
    canonical(tmp_path / "p.ngc", ours.append, settings=settings)
    found = [call for call in calls("".join(ours)) if "STRAIGHT" in call[0]]
    assert found == [call for call in calls(theirs.stdout) if "STRAIGHT" in call[0]]
    assert len(found) > 200
