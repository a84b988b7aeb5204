"""Feed hold, resume and override while a program runs, on every board.

What is asked for a machine time is done at the same time in every run. The step edges are looked at
once more, besides the verifier.
"""

import json
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from served import Control

from pulsewright import FeedControl, Job, boards
from pulsewright.app.run import Result
from pulsewright.boards.playing import Player
from pulsewright.edges.path import numbered_pins, positions_at
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import StoppedError, UsageError

ROOMS = list(boards.BOARDS)
# from what is asked to a plan that does it [s]: three updates of at most 1 ms; moves in the buffer
# of a rapcores; words that the executor of an s3g is about to come to
LATENCY = {"usc": 0.003, "pluto_step": 0.003, "rapcores": 0.1, "s3g": 0.1}
TEXT = (
    "G21 G90 G64 P0.02 F2400 M3 S1000\nG1 X40\nG3 X60 Y20 J20\nG1 X40 Y45 A30\nG4 P0.3\n"
    "G1 X10 Y40 Z2\nX0 Y0\nM5\nG0 Z0 A0\nM2\n"
)
# hold in mid-move, on the arc, in the dwell
HOLDS = [(0.5, 0.9), (1.6, 1.61), (4.0, 4.7)]


@pytest.fixture
def no_pages(monkeypatch):
    """Let runs leave their trace, but no pages and pictures, which take time."""
    monkeypatch.setattr(Result, "write", lambda self, folder, **options: None)


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    path = tmp_path_factory.mktemp("feed") / "part.ngc"
    path.write_text(TEXT)
    return Job.from_gcode(path)


def steps_at(folder, job, board, result, times):
    """Return the steps of all motors at machine times, counted on the edges."""
    trace = EdgeTrace.load(folder / "trace.npz")
    room, matrix = boards.get(board), job.machine.motor_matrix()
    pins = numbered_pins(len(matrix), room.positive_direction, *room.motor_pins)
    place = job.trajectory.at(0.0)[0]
    origin = np.floor(matrix @ place + 0.5).astype(np.int64)
    # the last second has 2 updates and less behind the end of the plan
    cycles = (np.asarray(times) * trace.clock_hz).astype(np.int64)
    return positions_at(trace, pins, cycles, origin)


@pytest.mark.parametrize("board", ROOMS)
def test_holds_and_overrides_at_given_times(board, job, tmp_path, monkeypatch, no_pages):
    feed, started = FeedControl(), []
    for begin, end in HOLDS:
        feed.hold(at=begin)
        feed.resume(at=end)
    feed.override(0.4, at=1.0)
    feed.override(1.5, at=2.0)
    play = Player.play
    monkeypatch.setattr(
        Player, "play", lambda self, until: (started.append(self.start_cycle), play(self, until))[1]
    )
    result = job.run(board=board, out=tmp_path, feed=feed)
    assert result.passed, result.text()
    asked = [(c.command, c.factor) for c in result.changes]
    assert asked == [
        ("hold", 1.0),
        ("resume", 1.0),
        ("override", 0.4),
        ("hold", 0.4),
        ("resume", 0.4),
        ("override", 1.5),
        ("hold", 1.5),
        ("resume", 1.5),
    ]
    at = [*HOLDS[0], 1.0, *HOLDS[1], 2.0, *HOLDS[2]]
    assert [c.at for c in result.changes] == pytest.approx(at, abs=1e-9)
    assert all(0 <= c.since - c.at <= LATENCY[board] for c in result.changes), result.changes

    # held motors stand still; that was in mid-move, and they are where they should be at the end
    clock = EdgeTrace.load(tmp_path / "trace.npz").clock_hz
    origin = started[0] / clock
    times = origin + np.array([0.45, 0.5, 0.72, 0.9, 1.1, result.job.duration + 0.002])
    x = steps_at(tmp_path, job, board, result, times)
    assert abs(x[1] - x[0]).max() > 0
    assert (x[2] == x[3]).all()
    assert abs(x[4] - x[3]).max() > 0
    ends = np.rint(job.machine.motor_matrix() @ job.program.moves.end[-1]).astype(int).tolist()
    assert x[5].tolist() == ends == [motor.end for motor in result.verdict.motors]
    assert [motor.lost for motor in result.verdict.motors] == [0] * len(ends)
    # 1.1 s held, and 1 s at 0.4; at 1.5 some of it is made good
    assert job.duration + 0.5 < result.job.duration < job.duration + 1.8
    assert result.job.certificate.passed


def test_an_override_is_the_speed_that_the_edges_show(job, tmp_path, monkeypatch, no_pages):
    origin = []
    play = Player.play
    monkeypatch.setattr(
        Player, "play", lambda self, until: (origin.append(self.start_cycle), play(self, until))[1]
    )
    feed = FeedControl()
    feed.override(0.5, at=0.4)
    result = job.run(out=tmp_path, feed=feed)
    clock = EdgeTrace.load(tmp_path / "trace.npz").clock_hz
    x = steps_at(
        tmp_path, job, "usc", result, origin[0] / clock + np.array([0.2, 0.35, 0.8, 0.95])
    )[:, 0]
    scale = job.machine.motor_matrix()[0, 0]
    assert (x[1] - x[0]) / scale / 0.15 == pytest.approx(40, rel=0.01)
    assert 0.7 * 20 < (x[3] - x[2]) / scale / 0.15 <= 20 * 1.01


def test_outputs_are_switched_when_the_changed_plan_is_there(job, tmp_path, no_pages):
    feed = FeedControl()
    feed.hold(at=1.0)
    feed.resume(at=3.0)
    job.run(out=tmp_path / "changed", feed=feed)
    job.run(out=tmp_path / "plain")
    late, off = (EdgeTrace.load(tmp_path / name / "trace.npz") for name in ("changed", "plain"))
    delay = (late.edges("out0", 0)[0] - off.edges("out0", 0)[0]) / late.clock_hz
    assert delay == pytest.approx(2.0, abs=0.05)
    # at the same step
    z = [int((t.edges("step2", 1) < t.edges("out0", 0)[0]).sum()) for t in (late, off)]
    assert z[0] == z[1] > 0


def test_another_thread_holds_waits_and_goes_on(job):
    feed, results = FeedControl(), []
    feed.hold()  # from the begin
    assert feed.state.state == "waiting"
    thread = threading.Thread(target=lambda: results.append(job.run(feed=feed)))
    thread.start()
    assert feed.wait("held", timeout=300)
    assert (feed.state.time, feed.state.position["X"], feed.state.line) == (0.0, 0.0, 2)
    feed.override(0.5)
    feed.hold(at=1.0)
    feed.resume()
    assert feed.wait("running", timeout=60)
    assert feed.wait("held", timeout=60)
    place = feed.state.position["X"]
    assert 5 < place < 25  # about 1 s at 20 mm/s
    time.sleep(0.2)  # nothing moves, and no time passes on a simulated machine
    assert feed.state.position["X"] == place
    assert 1.0 < feed.state.time < 1.5
    feed.resume()
    thread.join(60)
    (result,) = results
    assert result.passed, result.text()
    assert feed.state.state == "ended"
    assert feed.state.time == result.job.duration
    assert feed.state.position == pytest.approx({"X": 0, "Y": 0, "Z": 0, "A": 0}, abs=1e-9)
    assert not feed.wait("held")
    assert [c.command for c in result.changes] == ["hold", "override", "resume", "hold", "resume"]


@pytest.mark.parametrize("board", ROOMS)
def test_a_run_is_stopped_on_its_path(board, job, tmp_path):
    feed = FeedControl()
    feed.stop(at=1.0)
    with pytest.raises(StoppedError, match=r"stopped on request at 1\.000 s") as error:
        job.run(board=board, out=tmp_path / "out", feed=feed)
    assert "stopped within its limits on its path at" in error.value.__notes__[0]
    assert not (tmp_path / "out").exists()
    assert feed.state.state == "ended"


def test_a_hold_that_is_asked_too_late_changes_nothing(job):
    feed = FeedControl()
    feed.hold(at=job.duration - 1e-4)
    feed.resume(at=job.duration + 1.0)
    result = job.run(feed=feed)
    assert result.passed
    assert result.changes == ()
    assert result.job.duration == job.duration


def test_what_is_asked_wrongly(job):
    feed = FeedControl()
    with pytest.raises(UsageError, match="must be positive"):
        feed.override(0)
    feed.resume(at=0.2)  # of what is not held
    feed.override(1.0, at=0.3)  # as it is
    assert job.run(feed=feed).changes == ()


def test_a_run_is_controlled_by_another_program(job, tmp_path):
    command = [sys.executable, "-c", "from pulsewright.app.cli import main; main()", "run"]
    socket = tmp_path / "feed"
    options = [job.program.path, "--control", f"unix:{socket}", "--hold", "--json"]
    process = subprocess.Popen(
        [*command, *options, "--out", str(tmp_path / "out")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    for _ in range(1200):
        if socket.exists() or process.poll() is not None:
            break
        time.sleep(0.05)
    assert socket.stat().st_mode & 0o777 == 0o600
    control = Control(socket)
    while control("get")["state"] == "waiting":
        time.sleep(0.02)
    state = control("get")
    assert (state["state"], state["time"], state["override"]) == ("held", 0.0, 1.0)
    assert control("override", factor=0.5) == {"ok": True}
    assert control("hold", at=1.0) == {"ok": True}
    assert control("override") == {"error": "'factor' should be a number, not None"}
    assert control("override", factor=-1) == {
        "error": "override of -1 asked; it must be positive; 0 is hold()"
    }
    assert control("faster") == {"error": "unknown command"}
    assert control("resume") == {"ok": True}
    while control("get")["time"] < 1.0 or control("get")["state"] != "held":
        time.sleep(0.02)
    state = control("get")
    assert 5 < state["position"]["X"] < 25
    assert state["line"] == 2
    assert control("resume") == {"ok": True}
    said, complaints = process.communicate(timeout=120)
    assert process.returncode == 0, complaints
    result = json.loads(said)
    assert [c["command"] for c in result["feed_changes"]] == [
        *("hold", "override", "resume"),
        *("hold", "resume"),
    ]
    assert not socket.exists()
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["feed_changes"] == result["feed_changes"]
    assert "feed changed while it ran" in (tmp_path / "out" / "report.html").read_text()


def test_holding_from_the_begin_needs_a_way_to_resume(job, capsys, monkeypatch):
    from pulsewright.app import cli

    monkeypatch.setattr(sys, "argv", ["pulsewright", "run", job.program.path, "--hold"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 2
    assert "--hold begins held, and nothing could resume: give --control" in capsys.readouterr().err


mark = pytest.mark
PROGRAMS = ("arcspiral.ngc", "vcarve.ngc", "wheels.ngc", "contour.ngc", "trochoidal.ngc")


@pytest.mark.parametrize(
    ("name", "board"),
    [  # each program on one board, on all of them by hand
        pytest.param(name, board, marks=mark.campaign if i % len(ROOMS) == j else mark.marathon)
        for i, name in enumerate(PROGRAMS)
        for j, board in enumerate(ROOMS)
    ],
)
def test_real_programs_with_changes_at_random_times(name, board, corpus):
    job = Job.from_gcode(corpus / name)
    rng = np.random.default_rng(len(name) + ROOMS.index(board))
    feed, at = FeedControl(), 0.0
    for _ in range(25):
        at += rng.uniform(0.0, job.duration / 40)
        feed.override(float(rng.choice([0.3, 0.7, 1.0, 1.6, 3.0])), at=at)
        at += rng.uniform(0.0, job.duration / 40)
        feed.hold(at=at)
        at += rng.uniform(0.0, 0.5)
        feed.resume(at=at)
    result = job.run(board=board, feed=feed)
    assert result.passed, result.text()
    assert result.job.certificate.passed
    assert len(result.changes) > 40
    ends = [(motor.end, motor.lost) for motor in result.verdict.motors]
    final = job.machine.motor_matrix() @ job.program.moves.end[-1]
    assert ends == [(round(x), 0) for x in final.tolist()]
