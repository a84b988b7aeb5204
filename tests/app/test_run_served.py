"""Programs on boards behind a link that shows no step edges: served ones, in real time."""

import json
import threading
import time

import pytest
from served import Control, Process, slow_machine

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

        moving = threading.Thread(target=slip)
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
