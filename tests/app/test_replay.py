"""Sessions done again: the same answers, and where they are not, a sentence that says so."""

import json

import numpy as np
import pytest
from served import serving

from pulsewright import Job, open_board
from pulsewright.app.replay import diff, replay
from pulsewright.boards import rapcores, usc
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError
from pulsewright.transport.recording import Recorder, Recording


def session(path, board, *, rate=1000.0, link="twin:"):
    """Record a little work on a board."""
    with open_board(board, link=link, record=path) as driver:
        if board == "rapcores":
            driver.initialise(pulse_width=2e-6, pulse_space=2e-6, direction_setup=5e-6)
            driver.release_estop()
            driver.move(round(0.01 * driver.tick_rate), [driver.increment(rate), 0, 0, 0])
            driver.wait_idle()
            driver.read_steps()
        elif board == "s3g":
            driver.initialise()
            driver.identify()
        else:
            driver.initialise()
            driver.release_estop()
            driver.set_step_rate(0, rate)
            driver.set_step_rate(0, 0.0)


def altered(path, number, change):
    """Write a recording again, with the content of one event changed."""
    recording = Recording.load(path)
    recorder = Recorder(path, recording.opened)
    for n, event in enumerate(recording.events):
        recorder.keep(event.kind, event.at, change(event.content) if n == number else event.content)
    recorder.close()


def without(path, unwanted):
    """Write a recording again without some of its events."""
    recording = Recording.load(path)
    recorder = Recorder(path, recording.opened)
    for event in recording.events:
        if not unwanted(event):
            recorder.keep(event.kind, event.at, event.content)
    recorder.close()


def flipped(at):
    return lambda content: content[:at] + bytes((content[at] ^ 1,)) + content[at + 1 :]


@pytest.mark.parametrize("board", ["usc", "pluto_step", "s3g", "rapcores"])
def test_a_session_on_a_twin_is_the_same_again(tmp_path, board):
    session(tmp_path / "first", board)
    session(tmp_path / "second", board)
    result = replay(tmp_path / "first", edges=tmp_path / "edges.npz")
    assert result.passed, result.difference
    assert EdgeTrace.load(tmp_path / "edges.npz").end > 0
    # tags of requests are drawn by lot
    assert diff(tmp_path / "first", tmp_path / "second").passed == (board != "s3g")


@pytest.mark.rtl
@pytest.mark.parametrize("board", ["usc", "rapcores"])
def test_and_on_the_gateware(tmp_path, board):
    session(tmp_path / "session", board)
    replay(tmp_path / "session", edges=tmp_path / "twin.npz")
    result = replay(tmp_path / "session", engine="rtl", edges=tmp_path / "rtl.npz")
    assert result.passed, result.difference
    twin, rtl = (EdgeTrace.load(tmp_path / f"{engine}.npz") for engine in ("twin", "rtl"))
    for pin in set(twin.pins) & set(rtl.pins) - {"cipo"}:  # of the bus, which twins leave out
        assert np.array_equal(twin[pin], rtl[pin]), pin


def test_the_edges_of_a_job_are_those_of_its_recording(tmp_path, examples):
    Job.from_gcode(examples / "square.ngc").run(out=tmp_path, record=tmp_path / "session")
    replay(tmp_path / "session", edges=tmp_path / "again.npz")
    run, again = (EdgeTrace.load(tmp_path / f"{name}.npz") for name in ("trace", "again"))
    for pin in run.pins:  # the recording goes on to the stop at the end
        assert run[pin].tolist() == again[pin][: len(run[pin])].tolist()
    assert sum(map(len, run.cycles)) > 50_000


def test_a_session_with_a_served_board_is_the_same_again(tmp_path):
    path = tmp_path / "bus"
    with serving("usc", listen=f"epp+unix:{path}"):
        session(tmp_path / "session", "usc", link=f"epp+unix:{path}")
    recording = Recording.load(tmp_path / "session")
    assert recording.opened["link"] == f"epp+unix:{path}"
    result = replay(tmp_path / "session")
    assert result.passed, result.difference


def test_an_access_that_is_answered_otherwise(tmp_path):
    session(tmp_path / "a", "usc")
    session(tmp_path / "b", "usc")
    events = Recording.load(tmp_path / "b").events
    number, read = next(
        (n, k)
        for n, event in enumerate(events)
        if event.kind == "access"
        for k, op in enumerate(event.accesses["op"].tolist())
        if op == ord("R")
    )
    altered(tmp_path / "b", number, flipped(16 * read + 9))  # the value
    value = int(events[number].accesses["value"][read])
    cycle = int(events[number].accesses["cycle"][read])
    where = f"at {cycle / 40e6:.6f} s, access "
    for result, names in (
        (diff(tmp_path / "a", tmp_path / "b"), ("first", "second")),
        (replay(tmp_path / "b"), ("now", "recorded")),
    ):
        assert not result.passed
        assert result.difference.startswith(where)
        assert f"{names[0]} data read {value:02X}h" in result.difference
        assert f"{names[1]} data read {value ^ 1:02X}h" in result.difference
        assert f"after address {usc.registers.R_IDENT:02X}h" in result.difference


def test_a_frame_and_bytes_that_are_answered_otherwise(tmp_path):
    session(tmp_path / "spi", "rapcores")
    events = Recording.load(tmp_path / "spi").events
    number = next(n for n, e in enumerate(events) if e.kind == "transfer" and any(e.frame[2]))
    altered(tmp_path / "spi", number, lambda content: flipped(len(content) - 1)(content))
    result = replay(tmp_path / "spi")
    assert f"at {events[number].at / rapcores.registers.CLOCK_HZ:.6f} s: the answer" in (
        result.difference
    )
    session(tmp_path / "serial", "s3g")
    events = Recording.load(tmp_path / "serial").events
    number = next(n for n, event in enumerate(events) if event.kind == "read" and event.answer[3])
    altered(tmp_path / "serial", number, flipped(16))
    assert "byte 0 of the answers was d4, now d5" in replay(tmp_path / "serial").difference


def test_answers_that_do_not_come_any_more(tmp_path):
    session(tmp_path / "serial", "s3g")
    events = Recording.load(tmp_path / "serial").events
    heard = sum(len(event.answer[3]) for event in events if event.kind == "read")
    last = max(n for n, event in enumerate(events) if event.kind == "read")
    altered(tmp_path / "serial", last, lambda content: content + b"\x99")
    difference = replay(tmp_path / "serial").difference
    assert difference == f"at the end: answers lack byte {heard} and on: 99"


def test_time_that_passes_between_calls_passes_again(tmp_path):
    """As in recordings of hardware, which need no call to wait."""
    path = tmp_path / "session"
    with open_board("rapcores", record=path) as driver:
        driver.initialise(pulse_width=2e-6, pulse_space=2e-6, direction_setup=5e-6)
        driver.release_estop()
        driver.move(round(0.01 * driver.tick_rate), [driver.increment(1000.0), 0, 0, 0])
        driver.bus.sleep(0.02)
        assert driver.read_steps().tolist() == [9, 0, 0, 0]
    without(path, lambda event: event.kind == "sleep")
    result = replay(path)
    assert result.passed, result.difference


def test_a_recording_without_its_end_is_replayed_up_to_there(tmp_path):
    path = tmp_path / "session"
    session(path, "usc")
    path.write_bytes(path.read_bytes()[:-3])
    result = replay(path)
    assert result.passed
    assert "whose end is cut off" in result.what


def test_recordings_of_other_sessions(tmp_path):
    session(tmp_path / "a", "usc")
    session(tmp_path / "b", "usc", rate=2000.0)
    session(tmp_path / "c", "pluto_step")
    assert "data write" in diff(tmp_path / "a", tmp_path / "b").difference
    assert diff(tmp_path / "a", tmp_path / "c").difference == "board: usc and pluto_step"
    for board in ("usc", "s3g"):
        session(tmp_path / "long", board)
        session_of = Recording.load(tmp_path / "long")
        (tmp_path / "short").write_bytes((tmp_path / "long").read_bytes())
        without(tmp_path / "short", lambda event, last=session_of.events[-1]: event == last)
        assert "are equal" in diff(tmp_path / "long", tmp_path / "short").difference


def test_what_cannot_be_compared(tmp_path, examples):
    session(tmp_path / "a", "usc")
    replay(tmp_path / "a", edges=tmp_path / "a.npz")
    with pytest.raises(UsageError, match="two recordings or two traces"):
        diff(tmp_path / "a", tmp_path / "a.npz")
    with pytest.raises(UsageError, match="there are twin and rtl"):
        replay(tmp_path / "a", engine="board")
    with pytest.raises(UsageError, match="is no recording"):
        replay(examples / "square.ngc")
    assert diff(tmp_path / "a.npz", tmp_path / "a.npz").passed
    summary = json.loads(json.dumps(diff(tmp_path / "a", tmp_path / "a").summary()))
    assert summary["passed"]
