"""``pulsewright program``: a program of the s3g board as words, with what is wrong."""

import json
import subprocess
import sys

import pytest

from pulsewright.app import program
from pulsewright.errors import SourceError, UsageError

# specification of the board, vector 10
GOOD = "main: OUTPUT LEDS, 0x3C\n    DONE 7\n"


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "p.txt"
        path.write_text(text)
        return path

    return write


def test_a_program_is_shown_with_its_addresses_and_words(write):
    path = write(GOOD)
    report = program.run(path)
    assert report.passed
    assert report.text().splitlines()[1:] == [
        "main:",
        "    0  40 0000003C  OUTPUT LEDS, 0x3C",
        "    1  BF 00000007  DONE 7",
        "2 words, PASSED",
    ]
    assert report.summary() == {
        "file": str(path),
        "passed": True,
        "labels": {"main": 0},
        "words": [
            {"address": 0, "word": 0x40_0000003C, "text": "OUTPUT LEDS, 0x3C", "line": 1},
            {"address": 1, "word": 0xBF_00000007, "text": "DONE 7", "line": 2},
        ],
        "findings": [],
        "simulation": None,
    }


def test_warnings_pass_and_errors_do_not(write):
    path = write("OUTPUT V_VAL[2], 1\nDONE 0")
    report = program.run(path)
    assert report.passed
    assert f"{path}:1:1: warning: register V_VAL[2] has no function" in report.text()
    assert program.run(path, channels=3).findings == ()
    report = program.run(write("NOP"))
    assert not report.passed
    assert report.text().endswith("1 word, FAILED")
    assert report.summary()["findings"][0]["severity"] == "error"


def test_what_cannot_be_read_is_explained(write, tmp_path):
    with pytest.raises(SourceError, match=r"none\.txt: cannot be read: No such file"):
        program.run(tmp_path / "none.txt")
    (tmp_path / "binary").write_bytes(b"\xd5\xff\xfe")
    with pytest.raises(SourceError, match="binary: this is not a text file"):
        program.run(tmp_path / "binary")
    for channels in (0, 7):
        with pytest.raises(UsageError, match=rf"{channels} channels; a board has 1\.\.6"):
            program.run(write(GOOD), channels=channels)


# 100 steps of 256 cycles each: 65536 units at 256 units a cycle. The pulse takes 100 of them.
MOVE = """
    OUTPUT MSG_ALL_PRE_N, 10
    OUTPUT MSG_ALL_PULSE_N, 60
    OUTPUT MSG_ALL_POST_N, {post}
    OUTPUT ASG_STEPS_VAL, 1
    OUTPUT ASG_DT_VAL, 25600
    OUTPUT V_VAL[0], -256
    OUTPUT ASG_CONTROL, STEPS_LIMIT | DT_LIMIT | RESET_STEPS | RESET_DT | SET_X[0] | SET_V[0]
    OUTPUT X_VAL_LO[0], 0
    STB ASG_LOAD
    OUTPUT V_VAL[0], 0
    WAIT_ALL ASG_DONE
    CLEAR ASG_DONE
    STB ASG_LOAD
    DONE 9
"""


def test_a_program_can_be_simulated(write):
    done = program.run(write(MOVE.format(post=100)), seconds=1.0).simulation
    assert done.passed
    assert done.ended == "ended at address 13 with code 9"
    # down from 0 the first crossing comes at once; 6 cycles more at the old speed reach no other
    assert done.channels[0] == program.Channel(steps=-101, lost=0, rate=0.0)
    assert done.channels[1] == program.Channel(steps=0, lost=0, rate=0.0)


def test_a_simulation_shows_lost_steps_and_programs_that_hang(write):
    report = program.run(write(MOVE.format(post=300)), seconds=1.0)  # every other step is lost
    assert not report.passed
    assert (report.simulation.channels[0].steps, report.simulation.channels[0].lost) == (-51, 50)
    assert "-51 steps, 50 lost" in report.text()
    report = program.run(write("OUTPUT LEDS, 1\nWAIT_ALL ASG_DONE\nDONE 0"), seconds=0.01)
    assert not report.passed
    assert report.simulation.ended == "still at address 1: WAIT_ALL ASG_DONE"
    assert report.simulation.seconds == pytest.approx(0.01)
    with pytest.raises(UsageError, match="0 s"):
        program.run(write(GOOD), seconds=0)


@pytest.mark.parametrize(("text", "code"), [(GOOD, 0), ("WAIT_ANY 0\nDONE 0", 1), ("JUMP 0", 2)])
def test_the_command_tells_by_its_exit_code(write, text, code):
    source = "from pulsewright.app.cli import main; main()"
    command = [sys.executable, "-c", source, "program", str(write(text)), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == code
    if code == 2:
        assert "p.txt:1:1: no instruction 'JUMP'" in done.stderr
    else:
        assert json.loads(done.stdout)["passed"] is (code == 0)
