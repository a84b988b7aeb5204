"""Motors and axes."""

from __future__ import annotations

import numpy as np

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
