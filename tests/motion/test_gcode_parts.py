"""Programs whose moves are taken while they are read: the same moves and events."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from pulsewright.errors import GcodeError
from pulsewright.motion.gcode import InterpreterSettings, bulk, interpret, recorder
from pulsewright.motion.moves import Moves

SETTINGS = InterpreterSettings(axes="XYZABC", start=(1.0, 2.0, 3.0, 0.0, 0.0, 0.0))
EVERYTHING = """G21 G90 G64 P0.1 Q0.02
M3 S1000 (MSG,one)
G0 X1 Y2 Z3.0000000001
G0 X10
G2 X20 Y2 I5 F600
G18 G3 X30 I5 F300
G17 M7
G1 X31
X31
G4 P0.5
G61 X32
M62 P1
X33 A10
A20
G61.1 X34
G64
G20 F5 X1
X2 M8
G21 G54 X60
G10 L2 P1 X5 R10
X61
G43.1 Z5
X62 Z1
G33 K2 Z0
G0 Z5
M5
(MSG,two)
X63
X63
M2
"""


def in_parts(path, many, monkeypatch, settings=SETTINGS):
    """Return all moves and the events, and how many parts were taken."""
    monkeypatch.setattr(recorder, "MANY", many)
    monkeypatch.setattr(bulk, "ROWS", many)
    parts = []
    program = interpret(path, settings=settings, take=parts.append)
    whole = parts[0] if parts else program.moves
    for part in [*parts[1:], program.moves][: len(parts)]:
        assert np.array_equal(part.start, whole.end[-1])
        whole = whole.followed_by(part)
    return whole, program.events, len(parts)


def check_same(moves, events, expected):
    for column in fields(Moves):
        ours, theirs = getattr(moves, column.name), getattr(expected.moves, column.name)
        assert np.array_equal(ours, theirs), column.name
        assert ours.dtype == theirs.dtype, column.name
    assert events == expected.events


@pytest.mark.parametrize("many", [1, 2, 3, 5, 11])
def test_every_kind_of_move_and_event(tmp_path, monkeypatch, many):
    path = tmp_path / "program.ngc"
    path.write_text(EVERYTHING)
    expected = interpret(path, settings=SETTINGS)
    assert len(expected.moves) == 17
    assert {event.kind for event in expected.events} >= {"spindle", "message", "mist", "output"}
    moves, events, parts = in_parts(path, many, monkeypatch)
    assert parts >= 16 // (many + 3)
    check_same(moves, events, expected)


@pytest.mark.parametrize(
    "name", ["wheels.ngc", "vcarve.ngc", "cds.ngc", "flowsnake.ngc", "spiral.ngc"]
)
def test_programs_of_the_corpus(corpus, monkeypatch, name):
    settings = InterpreterSettings(axes="XYZA")
    moves, events, parts = in_parts(corpus / name, 100, monkeypatch, settings)
    assert parts > 1
    check_same(moves, events, interpret(corpus / name, settings=settings))


def test_an_error_in_moves_that_were_to_be_taken_has_its_line(tmp_path, monkeypatch):
    path = tmp_path / "program.ngc"
    path.write_text("G95 F0.1\nG0 X1\nG81 X2 Z-1 R1\n" + "".join(f"X{n}\n" for n in range(3, 9)))
    monkeypatch.setattr(recorder, "MANY", 5)
    with pytest.raises(GcodeError, match="its speed is 0") as found:
        interpret(path, settings=SETTINGS, take=lambda _: None)
    assert found.value.line == 3
