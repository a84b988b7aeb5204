"""Small programs about odd corners of the dialect, with what LinuxCNC 2.9 says to them.

Each ``NAME.txt`` of the folder is the output of ``rs274 -t tools.tbl -g NAME.ngc``; where there is
a ``NAME.tbl``, that is the tool table.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import oracle
import pytest
from test_gcode_canonical import assert_same, normal, run

FOLDER = Path(__file__).with_name("recorded")
NAMES = sorted(path.stem for path in FOLDER.glob("*.ngc"))
COUNT = re.compile(r"^ *\d+ (?=N)", re.MULTILINE)


def table(name):
    """Return the tool table of a program."""
    own = FOLDER / f"{name}.tbl"
    return own if own.exists() else FOLDER / "tools.tbl"


def calls(text):
    """Return canonical calls, without their count and what versions do differently."""
    text = re.sub(r".*START_CHANGE\(.*\n", "", text)
    text = re.sub(r"CHANGE_TOOL\(\d*\)", "CHANGE_TOOL()", text)
    return normal(COUNT.sub("", text))


@pytest.mark.parametrize("name", NAMES)
def test_the_calls_are_those_recorded(name):
    ours = calls(run(FOLDER / f"{name}.ngc", table(name)))
    assert_same(ours, calls((FOLDER / f"{name}.txt").read_text()))


@pytest.mark.parametrize("name", NAMES)
def test_the_records_are_those_of_rs274(tmp_path, name):
    oracle.require_rs274()
    shutil.copy(FOLDER / f"{name}.ngc", tmp_path)
    shutil.copy(table(name), tmp_path / "tools.tbl")
    done = oracle.rs274(f"{name}.ngc", tmp_path, "-t", "tools.tbl")
    assert done.stderr.split() == ["executing"]
    assert calls(done.stdout) == calls((FOLDER / f"{name}.txt").read_text())
