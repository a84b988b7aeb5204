"""What the report says of a plan, against hand arithmetic."""

from __future__ import annotations

import re

import numpy as np
import pytest

from pulsewright.app.plan_view import PlanView
from pulsewright.motion.gcode import interpret_text
from pulsewright.motion.machine import Machine
from pulsewright.motion.plan import plan

MACHINE = Machine.default()  # X, Y, Z: 60 mm/s, 500 mm/s^2, 20 000 mm/s^3


def view(text):
    moves = interpret_text(text).moves
    return PlanView(plan(moves, MACHINE), moves, MACHINE)


def test_possible_speed_is_that_of_feed_and_axes():
    # 20 mm/s; a rapid at 60 mm/s on both axes; a feed of 100 mm/s along X; a dwell
    shown = view("G61.1\nG1 F1200 X10\nG0 X20 Y10\nG1 F6000 X30\nG4 P1")
    assert shown.possible_speed() == pytest.approx([20, 60 * np.sqrt(2), 60, np.inf])


def test_time_is_lost_where_speed_changes():
    # 0.04 s + 0.025 s up and down again, at half of 20 mm/s in the mean; a dwell loses none
    shown = view("G1 F1200 X10\nG4 P1\nX20 F600")
    ((first, lost, spent), (second, less, _)) = shown.places()
    assert (first, second) == (1, 3)
    assert lost == pytest.approx(0.04 + 0.025, rel=0.1)
    assert spent == pytest.approx(0.5 + lost, rel=1e-6)
    # to 10 mm/s by jerk alone, twice
    assert 2 * np.sqrt(10 / 20_000) <= less <= 1.4 * 2 * np.sqrt(10 / 20_000)
    assert shown.lost().sum() == pytest.approx(lost + less)


def test_the_section_shows_the_lines_that_lose_most():
    section = view("G1 F1200 X10\nY10\nG0 X0 Y0").section(["G1 F1200 X10 (<a>)", "Y10", "G0"])
    assert "&lt;a&gt;" in section
    assert section.count("<svg") == 1
    assert re.search(r"[0-9.]+ s, [0-9.]+% of the time", section)


def test_a_plan_without_motion_has_a_section():
    assert "0.000 s, 0.0% of the time" in view("G4 P0.5").section([])
    assert view("M2").places() == []
