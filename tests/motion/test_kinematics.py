"""Motors and axes."""

from __future__ import annotations

import numpy as np
import pytest

from pulsewright.motion.machine import Machine


def test_gantry_drives_both_motors_alike(examples):
    machine = Machine.load(examples / "machines" / "inch_router.toml")
    # X on motor 0, Y on motors 1 and 3, Z on motor 2; one inch of Y is 2000 steps of both
    steps = machine.motor_matrix() @ [0, 25.4, 0, 0, 0, 0]
    assert np.allclose(steps, [0, 2000, 0, 2000], rtol=1e-15)
    assert machine.motors == 4


def test_corexy_turns_both_motors_for_one_axis(examples):
    machine = Machine.load(examples / "machines" / "corexy_engraver.toml")
    # 200 x 16 steps on 40 mm: 80 steps/mm. X moves both motors one way, Y against each other.
    matrix = machine.motor_matrix()
    assert (matrix @ [1, 0, 0, 0, 0, 0]).tolist() == [80, 80, 0]
    assert (matrix @ [0, 1, 0, 0, 0, 0]).tolist() == [80, -80, 0]
    assert (matrix @ [0, 0, 1, 0, 0, 0]).tolist() == [0, 0, 400]


def test_motors_do_what_all_axes_ask_at_once(examples):
    machine = Machine.load(examples / "machines" / "corexy_engraver.toml")
    rates, accelerations, jerks = machine.motor_limits()
    assert np.allclose(rates, [80 * (150 + 150), 80 * (150 + 150), 400 * 20], rtol=1e-12)
    assert np.allclose(accelerations, [80 * 6000, 80 * 6000, 400 * 200], rtol=1e-12)
    # by default an axis has all its acceleration after 25 ms
    assert np.allclose(jerks, 40 * accelerations, rtol=1e-12)


def test_a_reversed_motor_turns_the_other_way(examples):
    machine = Machine.load(examples / "machines" / "five_axis.toml")
    # Y on motors 1 and 2, which face each other: 160 steps/mm; C on motor 5: 200 x 8 x 90 steps
    # per turn
    steps = machine.motor_matrix() @ [0, 2, 0, 0, 0, 360]
    assert steps.tolist() == [0, 320, -320, 0, 0, 144_000]


@pytest.mark.parametrize(
    ("x", "y", "first", "second"),
    [("false", "false", [1, 1], [1, -1]), ("true", "false", [-1, -1], [1, -1]),
     ("false", "true", [1, 1], [-1, 1]), ("true", "true", [-1, -1], [-1, 1])],
)  # fmt: skip
def test_motors_of_corexy_may_be_reversed(examples, x, y, first, second):
    text = (examples / "machines" / "corexy_engraver.toml").read_text()
    text = text.replace("motor = 0", f"motor = 0\nreversed = {x}")
    text = text.replace("motor = 1", f"motor = 1\nreversed = {y}")
    matrix = Machine.parse(text).motor_matrix()
    assert (matrix[:2, :2] / 80).tolist() == [first, second]
