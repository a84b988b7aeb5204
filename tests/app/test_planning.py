"""`pulsewright plan`: what the whole job says of a program, in parts and with little memory."""

from __future__ import annotations

import subprocess
import sys

import pytest

from pulsewright.app import planning
from pulsewright.app.planning import plan_file
from pulsewright.app.run import Job
from pulsewright.errors import CheckFailedError, MotionLimitError
from pulsewright.motion import stream
from pulsewright.motion.gcode import bulk, recorder
from pulsewright.motion.machine import Machine, Tool


@pytest.mark.parametrize("many", [100, 1 << 14])
def test_a_program_is_planned_as_for_a_run(examples, monkeypatch, many):
    monkeypatch.setattr(recorder, "MANY", many)
    monkeypatch.setattr(bulk, "ROWS", many)
    monkeypatch.setattr(stream, "WINDOW", many)
    outline = plan_file(examples / "rosette.ngc").summary()
    job = Job.from_gcode(examples / "rosette.ngc").summary()
    for key in ("program", "machine", "moves", "elements", "messages"):
        assert outline[key] == job[key], key
    assert outline["duration"] == pytest.approx(job["duration"], rel=0.01)
    assert outline["certificate"]["deviation"] == pytest.approx(job["certificate"]["deviation"])
    assert outline["pieces"] >= outline["elements"]


def test_a_program_without_motion_has_an_outline(tmp_path):
    path = tmp_path / "none.ngc"
    path.write_text("(MSG,hello)\nM2\n")
    outline = plan_file(path)
    assert (outline.moves, outline.duration, outline.messages) == (0, 0.0, ("hello",))
    assert outline.certificate.passed
    assert "0 moves" in outline.text()


def test_a_move_beyond_the_travel_is_refused(tmp_path):
    path = tmp_path / "far.ngc"
    path.write_text("G0 X10\nG1 F600 X5000\n")
    with pytest.raises(MotionLimitError, match="line 2: X reaches 5000 mm"):
        plan_file(path)


def test_a_plan_that_breaks_a_limit_is_an_error(examples, monkeypatch):
    look = stream.Planner.take

    def hasty(planner, seconds=float("inf")):
        part = look(planner, seconds)
        if part is not None:
            part.trajectory.start[:] /= 1.1
        return part

    monkeypatch.setattr(planning.Planner, "take", hasty)
    with pytest.raises(CheckFailedError, match="the plan fails its certificate"):
        plan_file(examples / "square.ngc")


def test_memory_of_a_long_program_is_that_of_a_short_one(tmp_path):
    def peak(lines):
        path = tmp_path / f"{lines}.ngc"
        zigzag = (f"X{n % 50} Y{n / 1000:.3f}\n" for n in range(lines))
        path.write_text("G64 P0.05\nG1 F3000\n" + "".join(zigzag))
        code = (
            "import sys\n"
            "from pulsewright.app.memory import peak_memory\n"
            "from pulsewright.app.planning import plan_file\n"
            "outline = plan_file(sys.argv[1])\n"
            "print(outline.moves, peak_memory())"
        )
        command = [sys.executable, "-c", code, str(path)]
        output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        moves, memory = output.split()
        assert int(moves) >= lines - 1
        return float(memory)

    peak(500)  # compiles
    # all moves and their trajectory would take 100 MB more
    assert peak(100_000) < peak(40_000) + 30


def test_cutter_compensation_takes_the_diameter_of_the_machine_file(tmp_path):
    program = tmp_path / "part.ngc"
    program.write_text("T1 M6\nF600 G41\nG1 X10\nX20\n")
    tools = {1: Tool(diameter=3.0)}
    job = Job.from_gcode(program, machine=Machine.default().model_copy(update={"tools": tools}))
    # left of +X is +Y, by half the diameter
    assert job.program.moves.end[:, :2].tolist() == [[10, 1.5], [20, 1.5]]
