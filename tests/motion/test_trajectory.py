"""Where a trajectory is, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pulsewright.compiled import compiled
from pulsewright.motion.evaluate import sample
from pulsewright.motion.trajectory import Trajectory

# 2 mm along X in 1 s, 2 s of rest, and a quarter of a circle about (3, 1) in another second
PLAN = Trajectory(
    poly=np.array([[[1.0, 0], [2, 0], [0, 0], [0, 0]], [[3, 1], [0, 0], [0, 0], [0, 0]]]),
    cosine=np.array([[0.0, 0], [0, -1]]),
    sine=np.array([[0.0, 0], [1, 0]]),
    omega=np.array([0.0, 1]),
    length=np.array([1.0, math.pi / 2]),
    move=np.array([0, 1], np.int32),
    element=np.array([0, 0, 1], np.int32),
    start=np.array([0.0, 1, 3, 4]),
    law=np.array([[0.0, 1, 0, 0], [1, 0, 0, 0], [0, math.pi / 2, 0, 0]]),
)
HALF = math.sqrt(0.5)
# each half second, from half a second before the start to half a second after the end
S = [0, 0, 0.5, 1, 1, 1, 1, 0, math.pi / 4, math.pi / 2, math.pi / 2]
X = [1, 1, 2, 3, 3, 3, 3, 3, 3 + HALF, 4, 4]
Y = [0, 0, 0, 0, 0, 0, 0, 0, 1 - HALF, 1, 1]


@compiled(allocates=False, error_model="numpy")
def sampled(geometry, law, axis, first, step, unit, out):
    sample(geometry, law, axis, first, step, unit, out)


@pytest.mark.parametrize(
    ("axis", "rows", "first", "step"),
    [(0, [S, X, Y], -2, 2), (1, [S, Y], -2, 2), (0, [S, X], 10, 2), (0, [S, X, Y], 0, 4)],
)
def test_samples_are_where_the_trajectory_is(axis, rows, first, step):
    """Times in units of 1/4 s."""
    expected = np.array(rows)[:, first // 2 + 1 :: step // 2]
    out = np.empty(expected.shape)
    geometry = PLAN.poly, PLAN.cosine, PLAN.sine, PLAN.omega
    sampled(geometry, (PLAN.element, PLAN.start, PLAN.law), axis, first, step, 0.25, out)
    assert np.allclose(out, expected, rtol=0, atol=1e-15)
    times = 0.25 * (first + step * np.arange(expected.shape[1]))
    assert np.allclose(PLAN.at(times)[:, axis], expected[1], rtol=0, atol=1e-15)


def test_motors_go_where_the_matrix_says():
    # 10 steps/mm of both axes, as on a CoreXY; 5 steps/mm of Y; a motor of neither
    motors = PLAN.mapped(np.array([[10.0, 10], [10, -10], [0, 5], [0, 0]]))
    assert motors.at([0.5, 4.0]).tolist() == [[20, 20, 0, 0], pytest.approx([50, 30, 5, 0])]
    assert motors.at(3.5)[0] == pytest.approx([40, 20 + 20 * HALF, 5 - 5 * HALF, 0])
    assert motors.poly.flags.c_contiguous
    assert motors.sine.flags.c_contiguous
