"""Recordings of original controllers, replayed by name."""

import dataclasses
from pathlib import Path

import pytest

from pulsewright import boards
from pulsewright.app.check import check
from pulsewright.errors import UsageError

GOLDEN = Path(__file__).parents[1] / "golden"


def test_the_recordings_of_a_board_pass_on_its_twin():
    report = check("pluto_step", [GOLDEN / "pluto_step"])
    assert report.passed
    assert [replay.recording[:3] for replay in report.replays] == [f"p0{n}" for n in range(1, 10)]
    first = report.replays[0]
    # 8 ms at 40 MHz, 21 transactions: the README beside the recordings
    assert (first.cycles, first.transactions, first.engine) == (320_000, 21, "twin")
    assert report.text().endswith("PASSED")
    assert report.summary()["replays"][1]["changes"] == report.replays[1].changes > 1000


def test_a_difference_fails_and_is_named(monkeypatch):
    room = boards.get("pluto_step")
    recordings = room.recordings()
    other = recordings.load(GOLDEN / "pluto_step" / "p01_powerup_idle.npz")
    engines = {"twin": lambda recording: recordings.replay(other, "twin")}
    wrong = dataclasses.replace(
        room, recordings=lambda: dataclasses.replace(recordings, engines=engines)
    )
    monkeypatch.setitem(boards.BOARDS, "pluto_step", wrong)
    report = check("pluto_step", [GOLDEN / "pluto_step" / "p02_dio.npz"])
    assert not report.passed
    lines = report.text().splitlines()
    assert lines[0].startswith("FAIL p02_dio on twin: change 0 of ")
    assert lines[1] == "FAILED"


def test_what_cannot_be_checked_is_explained(tmp_path):
    with pytest.raises(UsageError, match="no board 'x'"):
        check("x", [])
    with pytest.raises(UsageError, match="usc: there are no recordings"):
        check("usc", [tmp_path])
    with pytest.raises(UsageError, match="no recordings given"):
        check("pluto_step", [tmp_path])
    with pytest.raises(UsageError, match="no engine 'fpga'; it has twin, rtl"):
        check("pluto_step", [GOLDEN / "pluto_step"], "fpga")
