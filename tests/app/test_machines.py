"""Machines of all kinds through the main job: every motor's step edges, counted by hand."""

import numpy as np
import pytest

from pulsewright import boards
from pulsewright.app.run import Job
from pulsewright.edges.path import numbered_pins, step_signs
from pulsewright.edges.trace import EdgeTrace
from pulsewright.motion.certificate import certify
from pulsewright.motion.machine import Machine
from pulsewright.motion.plan import begin_times

# How far two motors of one axis are apart as they step [step]: where a board gets their rates, one
# gets its own after the other, and they are rounded; where it gets moves, both are in the same one.
APART = {"usc": 0.02, "pluto_step": 0.1, "s3g": 0.0, "rapcores": 0.0}
BOARDS = list(APART)
SOME = [pytest.param(board, marks=pytest.mark.campaign) for board in BOARDS[1:3]]
SOME += [BOARDS[0], BOARDS[3]]  # one that gets rates, and one that gets moves


def edges(folder, text, machine, board):
    """Run a program; return times [s] and signs of the step edges of each motor."""
    (folder / "part.ngc").write_text(text)
    result = Job.from_gcode(folder / "part.ngc", machine=machine).run(
        board=board, out=folder / board
    )
    assert result.passed, result.text()
    trace, room = EdgeTrace.load(folder / board / "trace.npz"), boards.get(board)
    pins = numbered_pins(machine.motors, room.positive_direction, *room.motor_pins)
    found = [step_signs(trace, motor) for motor in pins]
    return [(cycles / trace.clock_hz, signs) for cycles, signs in found]


@pytest.mark.parametrize("board", BOARDS)
def test_both_motors_of_a_gantry_step_together(board, tmp_path, examples):
    machine = Machine.load(examples / "machines" / "inch_router.toml")
    x, left, z, right = edges(tmp_path, "G61.1\nG1 Y2.54 X1.27 F1200\nY0\n", machine, board)
    # 2000 steps per inch: 200 of Y there and back, 100 of X; Z stands
    assert left[1].tolist() == [1] * 200 + [-1] * 200
    assert np.array_equal(left[1], right[1])
    before = np.diff(left[0], prepend=-np.inf)
    period = np.minimum(before, np.append(before[1:], np.inf))
    assert (np.abs(left[0] - right[0]) / period).max() <= APART[board]
    assert (x[1].tolist(), z[1].tolist()) == ([1] * 100, [])


@pytest.mark.parametrize("board", SOME)
def test_a_motor_that_faces_the_other_steps_with_it_the_other_way(board, tmp_path, examples):
    text = (examples / "machines" / "inch_router.toml").read_text()
    machine = Machine.parse(text.replace("# gantry", "\nreversed = [false, true]"))
    _, left, _, right = edges(tmp_path, "G61.1\nG1 Y2.54 F1200\nY0\n", machine, board)
    assert left[1].tolist() == [1] * 200 + [-1] * 200
    assert right[1].tolist() == [-1] * 200 + [1] * 200
    # the same moments but for what rounding does on either side of half a step
    assert np.abs(left[0] - right[0]).max() <= 2e-3


@pytest.mark.parametrize("board", SOME)
def test_corexy_turns_one_motor_alone_on_a_diagonal(board, tmp_path, examples):
    machine = Machine.load(examples / "machines" / "corexy_engraver.toml")
    a, b, z = edges(tmp_path, "G61.1\nG1 X2 F1200\nX3 Y1\nX4 Y0\nG0 X0\n", machine, board)
    # 80 steps/mm. X2: both 160. (1, 1): a 160, b none. (1, -1): b 160. Back by 4: both 320.
    assert a[1].tolist() == [1] * 320 + [-1] * 320
    assert b[1].tolist() == [1] * 320 + [-1] * 320
    assert a[0][160] < b[0][160]
    assert a[0][319] < b[0][160]
    assert z[1].tolist() == []


FIVE = ["rapcores", pytest.param("s3g", marks=pytest.mark.campaign)]


@pytest.mark.parametrize("board", FIVE)
def test_five_axes_with_a_gantry_on_six_motors(board, tmp_path, examples):
    machine = Machine.load(examples / "machines" / "five_axis.toml")
    text = (examples / "five_axis.ngc").read_text()
    x, left, right, z, a, c = edges(tmp_path, text, machine, board)
    assert [len(motor[1]) for motor in (left, right)] == [160 * (20 + 20 + 10 + 10 + 20 + 80)] * 2
    assert (left[1] + right[1]).tolist() == [0] * len(left[1])
    # X, Y and A return to where they were; Z rests 10 mm higher
    assert [int(motor[1].sum()) for motor in (x, left, z, a)] == [0, 0, 3200, 0]
    # 400 steps per degree: C turns on to 360 + 30, and back by its sign to 360
    assert int(c[1].sum()) == 360 * 400
    assert abs(int((c[1] > 0).sum()) - 390 * 400) <= 0.02 * 400


def test_feeds_of_rotary_axes(tmp_path, examples):
    machine = Machine.load(examples / "machines" / "five_axis.toml")
    (tmp_path / "part.ngc").write_text(
        "G61.1\nG1 A-20 F300\nG1 X5 A-40\nG93 X0 A-20 F15\nC80 F30\nG94 G20 G1 A0 F300\n"
    )
    job = Job.from_gcode(tmp_path / "part.ngc", machine=machine)
    begin = begin_times(job.trajectory, 5)
    # 20 degrees at 5 degrees/s; 5 mm at 5 mm/s; the same way back in 1/15 min; 80 degrees in 1/30
    # min; 20 degrees at 5 degrees/s, also in inches
    ideal = np.array([4, 1, 4, 2, 4])
    velocity = [[0, -5, 0], [5, -20, 0], [-1.25, 5, 0], [0, 0, 40], [0, 5, 0]]
    middle = job.trajectory.at((begin[:-1] + begin[1:]) / 2, 1)[:, [0, 3, 5]]
    assert middle == pytest.approx(np.array(velocity), abs=1e-5)
    # to 300 degrees/s^2 in 25 ms and back: v / 300 + 0.025 s more if all of it is used
    ramps = abs(middle[:, 1:]).max(axis=1) / 300 + 0.025
    took = np.diff(begin)
    assert (took > ideal).all()
    assert (took < ideal + 1.5 * ramps).all()


@pytest.mark.parametrize("axis", ["A", "C"])
@pytest.mark.parametrize("limit", ["velocity", "acceleration", "jerk"])
def test_the_certificate_bounds_rotary_axes(axis, limit, tmp_path, examples):
    machine = Machine.load(examples / "machines" / "five_axis.toml")
    (tmp_path / "part.ngc").write_text("G61.1\nG0 A-60\nG0 C100\n")
    job = Job.from_gcode(tmp_path / "part.ngc", machine=machine)
    assert job.certificate.passed
    # both axes reach their velocity and acceleration, and more than half of their jerk
    drive = machine.axis[axis]
    full = {"velocity": drive.velocity, "acceleration": 300.0, "jerk": 300 / 0.025}
    half = drive.model_copy(update={**full, limit: full[limit] / 2})
    slower = machine.model_copy(update={"axis": {**machine.axis, axis: half}})
    (found,) = certify(job.trajectory, job.program.moves, slower).violations()
    ratio = float(found.removeprefix(f"{limit} of {axis} reaches ").split()[0])
    assert ratio == pytest.approx(2, abs=1e-6 if limit == "velocity" else 0.01) or (
        limit == "jerk" and 1 < ratio <= 2
    )
