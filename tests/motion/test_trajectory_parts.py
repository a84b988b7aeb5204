"""Parts of a trajectory, and looking at it in other coordinates."""

import numpy as np
import pytest

from pulsewright.motion.trajectory import Trajectory

# X is t up to 1 s; then X stands at 1 and Y is (t - 1)^2 up to 3 s; then half a turn about (0, 4),
# from (1, 4) to (-1, 4), in pi seconds
NONE = [0.0, 0.0]
WAY = Trajectory(
    poly=np.array(
        [
            [[0, 0], [1, 0], NONE, NONE],
            [[1, 0], [0, 1], NONE, NONE],
            [[0, 4], [0, 0], NONE, NONE],
        ]
    ),
    cosine=np.array([NONE, NONE, [1, 0]]),
    sine=np.array([NONE, NONE, [0, 1]]),
    omega=np.array([0.0, 0.0, 1.0]),
    length=np.array([1.0, 4.0, np.pi]),
    move=np.array([0, 1, 2], np.int32),
    element=np.array([0, 1, 1, 2], np.int32),
    start=np.array([0.0, 1.0, 2.0, 3.0, 3.0 + np.pi]),
    law=np.array([[0, 1, 0, 0], [0, 0, 1, 0], [1, 2, 1, 0], [0, 1, 0, 0.0]]),
)
TIME = np.array([0.5, 1.5, 2.5, 3.0 + np.pi / 2])
PLACE = [[0.5, 0], [1, 0.25], [1, 2.25], [0, 5]]
MOTORS = np.array([[10.0, 10.0], [10.0, -10.0], [0.0, 2.0]])
STEPS = [[5, 5, 0], [12.5, 7.5, 0.5], [32.5, -12.5, 4.5], [50, -50, 10]]


def test_a_part_is_where_the_whole_is_at_its_times():
    part = WAY.part(1, 3)
    assert (part.length.tolist(), part.element.tolist()) == ([4.0], [0, 0])
    assert part.start.tolist() == [1.0, 2.0, 3.0]
    assert part.at(TIME[1:3]).tolist() == PLACE[1:3]
    assert WAY.part(2, 4).at(TIME[2:]) == pytest.approx(np.array(PLACE[2:]), abs=1e-15)


def test_looking_by_a_matrix_maps_what_is_looked_at():
    assert WAY.at(TIME, matrix=MOTORS) == pytest.approx(np.array(STEPS), abs=1e-12)
    # on the arc at its top X runs back by 1, and bends down by 1
    assert WAY.at(TIME[3], 1, MOTORS)[0] == pytest.approx([-10, -10, 0])
    assert WAY.at(TIME[3], 2, MOTORS)[0] == pytest.approx([-10, 10, -2])


def test_pieces_hold_their_start_and_not_their_end():
    assert WAY.piece(np.array([-1.0, 0.0, 1.0, 2.999, 3.0, 99.0])).tolist() == [0, 0, 1, 2, 3, 3]
