"""The main job on programs made for one point each."""

import math

import numpy as np
import pytest

from pulsewright.app.run import Job
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import EstopError, UsageError
from pulsewright.motion import motors
from pulsewright.motion.machine import Machine

MACHINE = Machine.default()


def job(folder, text, machine=MACHINE):
    path = folder / "part.ngc"
    path.write_text(text)
    return Job.from_gcode(path, machine=machine)


def test_a_circle_of_short_chords_is_driven_as_one_curve_and_passes(tmp_path):
    # chords of 0.02 mm: far shorter than the blends, so the planner merges many into one element
    angle = np.linspace(0, 2 * math.pi, 3142)[1:]
    lines = [f"G1 X{10 - 10 * math.cos(a):.5f} Y{10 * math.sin(a):.5f}" for a in angle]
    result = job(tmp_path, "G21 G64 P0.01 F2400\n" + "\n".join(lines)).run()
    assert result.passed, result.text()
    # 20 pi mm at 40 mm/s; 40 / 500 s for speeding up and slowing down, and 25 ms for the
    # acceleration to build up
    assert result.job.duration == pytest.approx(20 * math.pi / 40 + 0.08 + 0.025, rel=0.04)


def test_spindle_and_coolant_are_outputs_switched_at_their_time(tmp_path):
    result = job(tmp_path, "M3 S1000 M8\nG1 X10 F600\nM5 M9\nG1 X0\n").run(out=tmp_path / "out")
    trace = EdgeTrace.load(tmp_path / "out/trace.npz")
    steps = trace.edges("step0", 1)
    spindle_on, spindle_off = trace.edges("out0", 1), trace.edges("out0", 0)
    assert result.passed
    assert (len(spindle_on), len(trace.edges("out2", 1)), len(trace.edges("out1", 1))) == (1, 1, 0)
    assert spindle_on[0] < steps[0]
    assert steps[3199] < spindle_off[0] < steps[3200]


def test_a_board_without_outputs_runs_and_says_what_it_did_not_switch(tmp_path):
    part = job(tmp_path, "M3 S1000 M8\nG1 X1 F600\nM5 M9\nM2\n")
    result = part.run(board="rapcores", out=tmp_path / "out")
    assert result.passed
    assert result.not_switched == ("flood", "spindle")
    assert "no digital outputs: the program's flood, spindle was not switched" in result.text()
    assert "not switched, for want of outputs" in (tmp_path / "out/report.html").read_text()
    assert part.run(board="pluto_step").not_switched == ()


def test_an_estop_in_the_middle_ends_the_job_and_leaves_nothing(tmp_path, monkeypatch):
    from pulsewright.boards.usc.player import UscPlayer

    play = UscPlayer.play

    def interrupted(self, until):
        play(self, until)
        self.driver.bus.twin.set_estop_chain(False)

    monkeypatch.setattr(UscPlayer, "play", interrupted)
    with pytest.raises(EstopError, match="estop chain"):
        job(tmp_path, "G1 X100 F600\nG1 X0\n").run(out=tmp_path / "new/out")
    assert not (tmp_path / "new").exists()


def test_an_interrupt_while_the_report_is_written_leaves_the_one_before(tmp_path, monkeypatch):
    def content(folder):
        return {path.name: path.read_bytes() for path in folder.rglob("*")}

    (tmp_path / "out/.killed").mkdir(parents=True)
    summary = job(tmp_path, "G1 X1 F600\n").run(out=tmp_path / "out").summary()
    (tmp_path / "out/.killed").rmdir()
    before = content(tmp_path / "out")
    assert set(before) == {
        *("certificate.json", "path.png", "report.html", "report.json", "trace.npz")
    }
    assert summary["files"] == sorted(str(tmp_path / "out" / name) for name in before)

    def interrupted(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("pulsewright.app.report.write_report", interrupted)
    for out in ("out", "new/out"):
        with pytest.raises(KeyboardInterrupt):
            job(tmp_path, "G1 X2 F600\n").run(out=tmp_path / out)
    assert content(tmp_path / "out") == before
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("out", ["file", "file/out", "file/new/out"])
def test_reports_that_cannot_be_written_are_refused_before_anything_moves(tmp_path, out):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=f"{tmp_path / 'file'}: is a file"):
        job(tmp_path, "G1 X1 F600\n").run(out=tmp_path / out, record=tmp_path / "link")
    assert not (tmp_path / "link").exists()  # nothing went over the link


@pytest.mark.parametrize("profile", ["document", "linuxcnc"])
def test_both_profiles_give_the_same_steps(profile, tmp_path):
    result = job(tmp_path, "G1 X7.3 Y-2.1 F1800\nG3 X3 Y3 R8\nG0 X0 Y0\n").run(profile=profile)
    assert result.passed, result.text()
    assert [m.steps for m in result.verdict.motors] == [
        motor.steps
        for motor in job(tmp_path, "G1 X7.3 Y-2.1 F1800\nG3 X3 Y3 R8\nG0 X0 Y0\n")
        .run(profile="document")
        .verdict.motors
    ]


@pytest.mark.parametrize("text", ["(nothing)\nM2\n", "G4 P0.2\n", "G1 X0 F100\n"])
def test_programs_without_motion_run(text, tmp_path):
    result = job(tmp_path, text).run(out=tmp_path / "out")
    assert result.passed, result.text()
    assert result.verdict.steps == 0


@pytest.mark.parametrize("board", ["usc", "pluto_step", "s3g", "rapcores"])
def test_a_board_gets_the_same_by_a_window_on_the_plan_as_by_the_whole(
    board, tmp_path, monkeypatch, examples
):
    # curves and corners, a dwell, and a way back
    text = "G64 P0.1 F1800\nG1 X4\nG2 X8 Y4 J4\nG1 Y5\nG4 P0.05\nG3 X6 Y5 R1\nG0 X0 Y0 Z1\n"
    part = job(tmp_path, text, Machine.load(examples / "machines" / "corexy_engraver.toml"))
    edges = []
    for window in (1, len(part.trajectory.element)):
        monkeypatch.setattr(motors, "WINDOW", window)
        result = part.run(board=board, link="twin:", out=tmp_path / "out")
        assert result.passed
        trace = EdgeTrace.load(tmp_path / "out/trace.npz")
        edges.append([cycles.tolist() for cycles in trace.cycles])
    assert edges[0] == edges[1]
