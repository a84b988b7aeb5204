"""What docs/clients.md says to start for each client starts."""

import re
import shlex
from pathlib import Path

import pytest
from served import Process

PAGE = Path(__file__).resolve().parents[2] / "docs" / "clients.md"
SERVE = "pulsewright serve "


def commands():
    """Return the command lines of the table; a row that only adds to one is that one and more."""
    found = []
    for cell in re.findall(r"^\|[^|]*\|[^|]*\| (.*?) \|", PAGE.read_text(), re.M):
        if cell.startswith(f"`{SERVE}"):
            found.append(cell.strip("`"))
        elif cell.startswith("add `"):
            found.append(f"{found[0]} {cell.removeprefix('add ').strip('`')}")
    return found


def test_each_client_has_its_command():
    assert len(commands()) == 8


@pytest.mark.campaign  # each in a process of its own
@pytest.mark.parametrize("command", commands())
def test_what_is_to_be_started_starts(command, tmp_path):
    words = shlex.split(command.removeprefix(SERVE).replace("/tmp/", f"{tmp_path}/"))
    where = words[words.index("--listen") + 1]
    with Process(*words) as server:
        assert f"listens at {where}" in server.line
    assert server.served["board"] == words[0]
