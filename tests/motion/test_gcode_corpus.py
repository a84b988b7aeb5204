"""Real programs, and the same programs through another interpreter of the dialect."""

from __future__ import annotations

import math
import random
import re

import numpy as np
import oracle
import pytest

from pulsewright.motion.gcode import InterpreterSettings, interpret
from pulsewright.motion.moves import AXES, MoveKind, Plane
from pulsewright.units import INCH

# All programs without O-words.
PROGRAMS = [
    "3D_Chips.ngc",
    "arcspiral.ngc",
    "cds.ngc",
    "circle_small_segments_ncd.ngc",
    "contour.ngc",
    "tiger.nc",
    "tort.ngc",
    "trochoidal.ngc",
    "vcarve.ngc",
    "wave.gcode",
    "wheels.ngc",
    "zigzag_0.002_0.001.ngc",
]


@pytest.mark.parametrize("name", PROGRAMS)
def test_corpus_programs_are_interpreted(corpus, name):
    m = interpret(corpus / name).moves
    assert len(m) > 200
    assert np.isfinite(m.end).all()
    assert (m.feed > 0).all() or (m.kind[m.feed == 0] == MoveKind.DWELL).all()
    assert (np.diff(m.line) >= 0).all()
    moved = np.abs(m.end - m.starts()).max(axis=1) > 0
    assert (moved | (m.kind != MoveKind.LINE)).all()


@pytest.mark.parametrize("name", PROGRAMS)
def test_arcs_of_the_corpus_end_where_their_sweep_ends(corpus, name):
    m = interpret(corpus / name).moves
    starts = m.starts()
    for i in np.flatnonzero(m.kind == MoveKind.ARC):
        a, b = Plane(m.plane[i]).axes
        first, last = (
            complex(p[a] - m.center[i, a], p[b] - m.center[i, b]) for p in (starts[i], m.end[i])
        )
        turned = first * complex(math.cos(m.sweep[i]), math.sin(m.sweep[i]))
        # within what the radii may differ by: 0.0005 inch, the wider of the two limits
        assert abs(turned - last) <= max(0.0128, 1.01e-3 * abs(first))


@pytest.mark.parametrize(("name", "moves"), [("daisy.ngc", 54), ("flowsnake.ngc", 3076)])
def test_programs_with_o_words_are_interpreted(corpus, name, moves):
    program = interpret(corpus / name, settings=InterpreterSettings(axes=AXES))
    # daisy: 51 notes, a dwell and two moves back; flowsnake: 3 * 4**5 leaves and 4 moves around
    assert len(program.moves) == moves


# Another interpreter's canonical commands

CALL = re.compile(r"(?:\d+|N\S*)\s+([A-Z_0-9]+)\((.*)\)\s*$")


def canonical(text):
    """Return ends in machine coordinates [mm, degrees] and (plane, centre, turns) of arcs.

    Every canonical move is listed, also one of no length; centres are None for straight moves.
    """
    scale, plane = 1.0, Plane.XY
    system, shift, position = np.zeros(6), np.zeros(6), np.zeros(6)
    found = []
    for call in text.splitlines():
        match = CALL.search(call)
        if match is None:
            continue
        name, arguments = match.groups()
        units = np.array([scale] * 3 + [1.0] * 3)
        if name == "USE_LENGTH_UNITS":
            scale = INCH if "INCHES" in arguments else 1.0
        elif name == "SELECT_PLANE":
            plane = {"XY": Plane.XY, "XZ": Plane.ZX, "YZ": Plane.YZ}[arguments[-2:]]
        elif name in ("SET_G5X_OFFSET", "SET_G92_OFFSET"):
            values = np.array([float(v) for v in arguments.split(",")][-6:]) * units
            system, shift = (values, shift) if name == "SET_G5X_OFFSET" else (system, values)
        elif name in ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED"):
            values = np.array([float(v) for v in arguments.split(",")])
            position = values * units + system + shift
            found.append((position, None))
        elif name == "ARC_FEED":
            u, v, cu, cv, turns, w, *abc = (float(v) for v in arguments.split(","))
            a, b = plane.axes
            position = np.array([0.0, 0, 0, *abc])
            position[[a, b, int(plane)]] = u, v, w
            position = position * units + system + shift
            center = np.array([cu, cv]) * scale + (system + shift)[[a, b]]
            found.append((position, (plane, center, round(turns))))
    return found


def compare(program, found, tolerance):
    """Compare moves in order.

    The other interpreter also reports moves of no length, and those look like our shortest. So
    ``counts`` holds every number of our moves that may correspond to what it reported so far.
    """
    m = program.moves
    ours = [i for i in range(len(m)) if m.kind[i] != MoveKind.DWELL]
    previous, counts = m.start, {0}
    for position, arc in found:
        after = {
            k + 1 for k in counts if k < len(ours) and same(m, ours[k], position, arc, tolerance)
        }
        if arc is None and np.abs(position - previous).max() <= tolerance:
            after |= counts
        assert after, f"line {m.line[ours[min(counts)]]}: {position} expected"
        previous, counts = position, after
    assert len(ours) in counts


def same(m, i, position, arc, tolerance):
    """Whether move ``i`` is the canonical move."""
    if np.abs(m.end[i] - position).max() > tolerance or (m.kind[i] == MoveKind.ARC) != bool(arc):
        return False
    if arc is None:
        return True
    plane, center, turns = arc
    return (
        m.plane[i] == plane
        and np.abs(m.center[i, list(plane.axes)] - center).max() <= 4 * tolerance
        and math.copysign(math.ceil(abs(m.sweep[i]) / math.tau - 1e-9), m.sweep[i]) == turns
    )


@pytest.fixture(scope="module")
def rs274(tmp_path_factory):
    """Return what LinuxCNC's interpreter makes of a program."""
    oracle.require_rs274()
    return lambda path: oracle.rs274(path, tmp_path_factory.mktemp("rs274")).stdout


@pytest.mark.parametrize("name", [*PROGRAMS, "daisy.ngc", "flowsnake.ngc", "spiral.ngc"])
def test_corpus_agrees_with_rs274(corpus, rs274, name):
    found = canonical(rs274(corpus / name))
    program = interpret(corpus / name, settings=InterpreterSettings(axes=AXES))
    inches = "g20" in (corpus / name).read_text().lower()
    compare(program, found, 0.6e-4 * (INCH if inches else 1))  # rs274 prints 4 decimals


@pytest.mark.parametrize("name", ["rosette.ngc", "square.ngc"])
def test_examples_agree_with_rs274(examples, rs274, name):
    compare(interpret(examples / name), canonical(rs274(examples / name)), 0.6e-4)


def random_program(rng):
    """Return a program of all modes, with every arc possible."""

    def number(low, high):
        return round(rng.uniform(low, high), 4)

    lines = ["G21 G90 G64 F1000", "G0 X1 Y2 Z3"]
    for _ in range(400):
        kind = rng.randrange(12)
        axes = "".join(f" {a}{number(-50, 50)}" for a in "XYZ" if rng.random() < 0.6)
        if kind < 3 and axes:
            lines.append(f"G{rng.randrange(2)}{axes}")
        elif kind < 8:
            number_of_plane = rng.randrange(3)
            (u, v, w), (i, j) = [
                ("XYZ", "IJ"),
                ("ZXY", "KI"),
                ("YZX", "JK"),
            ][number_of_plane]
            radius, first, angle = number(1, 40), number(0, 6), number(0.1, 6)
            clockwise = rng.random() < 0.5
            turn = -angle if clockwise else angle
            cu, cv = -radius * math.cos(first), -radius * math.sin(first)
            du = cu + radius * math.cos(first + turn)
            dv = cv + radius * math.sin(first + turn)
            words = f"{u}{du:.5f} {v}{dv:.5f} "
            if rng.random() < 0.3 and abs(angle - math.pi) > 0.3:
                words += f"R{radius if angle < math.pi else -radius}"
            else:
                words += f"{i}{cu:.5f} {j}{cv:.5f}"
            if rng.random() < 0.3:
                words += f" {w}{number(-5, 5)}"
            if rng.random() < 0.2:
                words += f" P{rng.randrange(1, 4)}"
            code = "G2" if clockwise else "G3"
            lines += [f"G{17 + number_of_plane} G91 {code} {words}", "G90"]
        elif kind == 8:
            lines.append(rng.choice(["G20 F40", "G21 F1000"]))
        elif kind == 9:
            lines.append(f"G10 L{rng.choice([2, 20])} P{rng.randrange(10)}{axes}")
        elif kind == 10:
            lines.append(rng.choice(["G54", "G55", "G57", "G59.2", "G92.1", "G92.2", "G92.3"]))
        else:
            lines.append(f"G92{axes}" if axes else "G4 P0.1")
    return "\n".join([*lines, "M2", ""])


@pytest.mark.parametrize("seed", range(4))
def test_random_programs_agree_with_rs274(rs274, tmp_path, seed):
    path = tmp_path / "random.ngc"
    path.write_text(random_program(random.Random(seed)))
    found = canonical(rs274(path))
    assert len(found) > 200
    compare(interpret(path), found, 4e-3)  # offsets print with 4 decimals of an inch
