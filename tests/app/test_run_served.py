"""Programs on boards behind a link that shows no step edges: served ones, in real time."""

import json
import time
from threading import Thread

import pytest
from served import Control, Process, slow_machine

from pulsewright.app.feed import FeedControl
from pulsewright.app.run import UNSEEN, Job
from pulsewright.errors import (
    EstopError,
    FollowingError,
    MotionLimitError,
    PositionUnknownError,
    StarvedError,
    UsageError,
)

BUSY = EstopError, MotionLimitError, StarvedError  # what a computer is told that does too much
TRIES = 5
OPTIONS = {"usc": {"watchdog_us": 0, "loopback": 1}, "rapcores": {"depth": 16}}
END = [503, -247]  # X 5.03, Y -2.47
TOLD = {
    "usc": "positions that the board tells, every millisecond",
    "pluto_step": "positions that the board tells, every millisecond",
    "rapcores": "steps that the board has made, at the end of the plan",
    "s3g": "its program ended where the plan does",
}


@pytest.fixture
def program(tmp_path):
    path = tmp_path / "part.ngc"
    path.write_text("G21 G90 G64 P0.01\nG1 X3 Y1 F600\nX5.03 Y-2.47\nM2\n")
    return path


def served(board, folder):
    """Return a server in a process of its own, and the link to it."""
    place = folder / "bus"
    listen = {"rapcores": f"spi+unix:{place}", "s3g": f"pty:{place}"}.get(
        board, f"epp+unix:{place}"
    )
    switches = [word for n, v in OPTIONS.get(board, {}).items() for word in ("--set", f"{n}={v}")]
    process = Process(board, "--listen", listen, "--control", f"unix:{folder / 'c'}", *switches)
    return process, f"serial:{place}?baud=500000" if board == "s3g" else listen


@pytest.mark.campaign  # in real time, which busy computers do not keep
@pytest.mark.parametrize("board", TOLD)
def test_a_program_on_a_served_board(board, program, tmp_path):
    job = Job.from_gcode(program, machine=slow_machine(board, **OPTIONS.get(board, {})))
    server, link = served(board, tmp_path)
    with server:
        control = Control(tmp_path / "c")
        for attempt in range(TRIES):
            before = control("steps")["steps"][:2]
            try:
                result = job.run(link=link, out=tmp_path / "out", referenced=attempt > 0)
                break
            except BUSY:
                if attempt == TRIES - 1 and board == "pluto_step":
                    pytest.skip("this computer is too busy for a watchdog of 6.4 ms")
                if attempt == TRIES - 1:
                    raise
                if board == "rapcores":
                    control("reset")
        after = control("steps")["steps"][:2]
    assert [b - a for a, b in zip(before, after, strict=True)] == END
    assert result.passed
    assert result.verdict is None
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["passed"]
    assert any(TOLD[board] in what for what in report["verified"])
    assert report["not_verified"] == list(UNSEEN)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "certificate.json",
        "report.json",
    ]
    text = result.text()
    assert "PLAYED; this link shows no step edges to verify" in text
    assert f"not verified: {UNSEEN[0]}" in text
    assert "PASSED" not in text


@pytest.mark.campaign  # in real time
def test_a_wrong_count_on_the_way_is_no_good_run(program, tmp_path):
    program.write_text("G21 G90\nG1 X90 F600\nM2\n")
    job = Job.from_gcode(program, machine=slow_machine("usc", **OPTIONS["usc"]))
    server, link = served("usc", tmp_path)
    with server:
        control = Control(tmp_path / "c")

        def slip():
            while abs(control("steps")["steps"][0]) < 200:
                time.sleep(0.01)
            control("enc", n=0, value=5000)

        moving = Thread(target=slip)
        moving.start()
        with pytest.raises(FollowingError, match="steps from where it was commanded to be"):
            job.run(link=link, out=tmp_path / "out")
        moving.join(60)
        assert control("get")["estop"]
        before = control("steps")["steps"]
        with pytest.raises(PositionUnknownError, match="steps from where"):
            job.run(link=link, out=tmp_path / "out")
        assert control("steps")["steps"] == before
    assert not (tmp_path / "out").exists()


def test_edges_cannot_be_written_that_nobody_sees(program, tmp_path):
    job = Job.from_gcode(program, machine=slow_machine("rapcores"))
    server, link = served("rapcores", tmp_path)
    with server, pytest.raises(UsageError, match=r"does not record step edges.*trace\.vcd"):
        job.run(link=link, out=tmp_path / "out", vcd=True)
    assert not (tmp_path / "out").exists()


@pytest.mark.campaign  # in real time, which busy computers do not keep
@pytest.mark.parametrize("board", TOLD)
def test_a_program_on_a_served_board_is_held_and_overridden(board, tmp_path):
    path = tmp_path / "part.ngc"
    path.write_text("G21 G90 G64 P0.01\nG1 X23 Y1 F600\nX5.03 Y-2.47\nM2\n")
    job = Job.from_gcode(path, machine=slow_machine(board, **OPTIONS.get(board, {})))
    server, link = served(board, tmp_path)
    with server:
        control = Control(tmp_path / "c")
        for attempt in range(TRIES):
            before = control("steps")["steps"][:2]
            feed, results = FeedControl(), []
            thread = Thread(target=run_to, args=(results, job, link, feed, attempt > 0))
            thread.start()
            try:
                while feed.state.time < 1.0 and feed.wait("running", 60):
                    time.sleep(0.01)
                asked = feed.state.time
                feed.hold()
                assert feed.wait("held", 60) or not thread.is_alive()
                since = feed.state.time
                time.sleep(0.5)  # the motors follow within that
                places = []
                for _ in range(2):
                    places.append(control("steps")["steps"][:2])
                    time.sleep(0.3)
                feed.override(2.0)
                feed.resume()
            finally:
                thread.join(60)
            (result,) = results
            if not isinstance(result, BUSY):
                break
            if attempt == TRIES - 1 and board == "pluto_step":
                pytest.skip("this computer is too busy for a watchdog of 6.4 ms")
            if attempt == TRIES - 1:
                raise result
            if board == "rapcores":
                control("reset")
        after = control("steps")["steps"][:2]
    assert not isinstance(result, BaseException), repr(result)
    # 0.12 s of making the plan or some buffer, 0.15 s of braking, and looks at what is asked
    assert since - asked < 2.0
    assert places[0] == places[1]
    assert 500 < places[0][0] - before[0] < 2300
    assert [b - a for a, b in zip(before, after, strict=True)] == END
    assert [c.command for c in result.changes] == ["hold", "override", "resume"]
    assert result.job.certificate.passed


def run_to(results, job, link, feed, referenced):
    """Keep what a run returns or raises."""
    try:
        results.append(job.run(link=link, feed=feed, referenced=referenced))
    except Exception as error:
        results.append(error)
