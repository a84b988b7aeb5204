"""Whether the position of a machine is known, from one run to the next."""

from types import SimpleNamespace

import pytest
from served import Process, slow_machine

from pulsewright.app.cli import main
from pulsewright.app.run import Job
from pulsewright.app.standing import Standing, account
from pulsewright.errors import (
    BusError,
    EstopError,
    PositionUnknownError,
    PulsewrightError,
    UsageError,
)
from pulsewright.transport.faults import Faults

LINK = "serial:/dev/ttyUSB7?baud=500000"
LOST = SimpleNamespace(position_known=False)
KNOWN = SimpleNamespace(position_known=True)


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    folder = tmp_path / "state"
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    return folder


def play(driver, *, link=LINK, error=None, referenced=False):
    """Go through a run that ends with an error, or without."""
    with Standing(link, "part.ngc", referenced=referenced) as standing:
        standing.driver = driver
        if error:
            raise error


def test_a_run_after_one_that_lost_the_position_has_to_be_told_of_a_reference():
    with pytest.raises(BusError):
        play(LOST, error=BusError("the cable is out"))
    for _ in range(2):  # a refused run changes nothing
        with pytest.raises(PositionUnknownError) as caught:
            play(KNOWN)
        for words in (LINK, "part.ngc, begun at 2", "ended so: the cable is out", "--referenced"):
            assert words in str(caught.value)
    play(KNOWN, referenced=True)
    play(KNOWN)  # which has cleared it


def test_a_run_that_was_killed_leaves_the_position_unknown():
    Standing(LINK, "part.ngc", referenced=False).__enter__()  # and nothing more comes
    with pytest.raises(PositionUnknownError, match="has not come to its end"):
        play(KNOWN)


def test_losing_the_position_once_more_needs_another_reference():
    play(LOST)
    play(LOST, referenced=True)
    with pytest.raises(PositionUnknownError):
        play(KNOWN)


def test_a_run_that_fails_with_the_position_known_leaves_it_so():
    with pytest.raises(EstopError):
        play(KNOWN, error=EstopError("stopped on its ramp"))
    with pytest.raises(UsageError):
        play(None, error=UsageError("the port is in use"))
    play(KNOWN)


def test_each_machine_has_its_own_account(monkeypatch, tmp_path):
    play(LOST)
    play(KNOWN, link="serial:/dev/ttyUSB8?baud=500000")
    with pytest.raises(PositionUnknownError):
        play(KNOWN, link="serial:/dev/ttyUSB7?baud=1000000")  # the same one
    monkeypatch.chdir(tmp_path)
    assert account("spi+unix:bus") == account(f"spi+unix:{tmp_path / 'bus'}")
    assert account("epp+tcp:localhost:80") != account("epp+tcp:localhost:81")


def test_simulated_boards_need_no_account(state):
    for link in ("twin:", "rtl:"):
        play(LOST, link=link)
        play(LOST, link=link)
    assert not state.exists()


def test_a_damaged_account_counts(state):
    play(LOST)
    account(LINK).write_text("{")
    with pytest.raises(PositionUnknownError, match=r"unknown.*--referenced"):
        play(KNOWN)


def test_without_a_place_for_the_account_nothing_moves(state):
    state.write_text("a file")
    with pytest.raises(UsageError, match="XDG_STATE_HOME"):
        play(KNOWN)


@pytest.fixture
def program(tmp_path):
    path = tmp_path / "part.ngc"
    path.write_text("G21 G90\nG1 X90 F600\nM2\n")
    return path


def test_the_command_line_refuses_and_takes_the_word_of_the_user(
    program, tmp_path, monkeypatch, capsys
):
    link = f"serial:{tmp_path / 'port'}"
    play(LOST, link=link)
    words = ["pulsewright", "run", str(program), "--board", "s3g", "--link", link]
    told = []
    for more in ([], ["--referenced"]):
        monkeypatch.setattr("sys.argv", words + more)
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == 2
        told.append(capsys.readouterr().err)
    assert "the position of the machine is unknown" in told[0]
    assert "say so with --referenced" in told[0]
    assert "cannot be opened" in told[1]  # there is no such port


def test_a_job_whose_link_fails_in_mid_move_is_followed_by_none_without_a_reference(
    program, tmp_path
):
    job, faults = Job.from_gcode(program, machine=slow_machine("rapcores", depth=16)), Faults()
    link = f"spi+unix:{tmp_path / 'bus'}"
    with Process("rapcores", "--listen", link, "--set", "depth=16"):
        faults.inject("mute", after=30_000)  # bytes: it moves by then
        with pytest.raises(PulsewrightError) as caught:
            job.run(link=link, faults=faults)
        assert any("say so with --referenced" in note for note in caught.value.__notes__)
        with pytest.raises(PositionUnknownError, match=r"begun at .* --referenced"):
            job.run(link=link)
        with pytest.raises(UsageError, match=r"trace\.vcd"):  # so it is taken at its word
            job.run(link=link, vcd=True, referenced=True)
