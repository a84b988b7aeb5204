"""What every room owes to the floors above it."""

import dataclasses
import doctest
import importlib
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pulsewright
from pulsewright import boards
from pulsewright.boards.board import Board
from pulsewright.boards.playing import Drives
from pulsewright.edges.timing import DriveTiming
from pulsewright.errors import PulsewrightError, UsageError
from pulsewright.motion.trajectory import Trajectory

HEAVY = ("numba", "amaranth", "systemrdl", "matplotlib", "pydantic")
ROOM = Path(boards.__file__).parent
DRIVES = Drives([32e3] * 2, [160e3] * 2, [6.4e6] * 2, DriveTiming(2e-6, 2e-6, 5e-6, 5e-6))

each_board = pytest.mark.parametrize("room", boards.BOARDS.values(), ids=lambda room: room.name)
each_profile = pytest.mark.parametrize(
    ("room", "profile"),
    [(room, profile) for room in boards.BOARDS.values() for profile in room.profiles],
    ids=lambda value: getattr(value, "name", value),
)


def modules_after(code):
    """Return the modules that a new interpreter holds after ``code``."""
    code += "\nimport json, sys; print(json.dumps(sorted(sys.modules)))"
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    return set(json.loads(out.stdout))


# ----------------------------------------------------------------------------------- the registry


def test_the_usc_is_a_board():
    assert isinstance(boards.get("usc"), Board)
    assert boards.get("usc").default_profile == "document"


def test_an_unknown_board_is_answered_with_those_there_are():
    with pytest.raises(UsageError, match=r"no board 'usb'; the boards are .*usc"):
        boards.get("usb")
    with pytest.raises(UsageError, match="no board 'usb'"):
        boards.open_board("usb")


@pytest.mark.parametrize("link", ["spi:/dev/spidev0.0", "twin", "twin:2", ""])
def test_a_link_that_cannot_be_opened_is_answered_with_those_that_can(link):
    with pytest.raises(UsageError, match=rf"link '{link}' .*usable are 'twin:'"):
        boards.open_board("usc", link)


class Opened:
    """A link that notes whether it is open."""

    clock_hz, access_cycles, exact, in_real_time, closed = 40_000_000, 60, True, False, 0

    def close(self):
        self.closed += 1


@each_board
def test_a_board_that_cannot_be_opened_leaves_no_link_open(room, monkeypatch, tmp_path):
    """The recording cannot be written, or the driver takes something amiss: the port is free."""
    bus = Opened()
    monkeypatch.setattr(boards.links, "open_bus", lambda *_: bus)
    with pytest.raises(UsageError, match="cannot be written"):
        boards.open_board(room.name, record=tmp_path / "none" / "session")
    assert bus.closed == 1

    def refuse(*_, **__):
        raise UsageError("not with this link")

    refused = dataclasses.replace(room, driver=refuse)
    monkeypatch.setitem(boards.BOARDS, room.name, refused)
    with pytest.raises(UsageError, match="not with this link"):
        boards.open_board(room.name, record=tmp_path / "session")
    assert bus.closed == 2
    monkeypatch.setitem(boards.BOARDS, room.name, room)
    boards.open_board(room.name)
    assert bus.closed == 2


def test_public_names_are_found_and_others_are_not():
    assert pulsewright.open_board is boards.open_board
    assert "open_board" in dir(pulsewright)
    with pytest.raises(AttributeError, match="no attribute 'open_bord'"):
        pulsewright.open_bord  # noqa: B018


def test_importing_the_package_imports_nothing_else():
    loaded = modules_after("import pulsewright")
    assert {name for name in loaded if name.startswith("pulsewright")} == {"pulsewright"}
    assert "numpy" not in loaded


def test_listing_boards_loads_no_twin_no_driver_and_no_compiler():
    loaded = modules_after("from pulsewright.boards import BOARDS; print(end='' if BOARDS else 1)")
    assert not loaded & set(HEAVY)
    parts = re.compile(r"pulsewright\.boards\.\w+\.(twin|driver|commands|player)")
    assert not [name for name in loaded if parts.match(name)]


# ----------------------------------------------------------------------------------- every room


@each_board
def test_a_room_describes_itself(room):
    registers = room.registers()
    assert registers.board == room.name
    assert room.title == registers.title
    assert room.document
    assert room.profiles == registers.profiles
    assert room.default_profile == room.profiles[0]


@each_board
def test_the_readme_names_document_profiles_and_every_switch(room):
    text = (ROOM / room.name / "README.md").read_text()
    words = " ".join(text.split())
    assert text.startswith(f"# {room.title}\n")
    assert all(part in words.replace("*", "") for part in room.document.split(", "))
    for profile in room.profiles:
        assert f"`{profile}`" in text
    for name in room.switches():
        cells = r" (\S+) \|" * len(room.profiles)
        row = re.search(rf"^\| `{name}` \|.*\|{cells}$", text, re.MULTILINE)
        assert row, f"no row for {name}"
        values = [int(cell, 0) for cell in row.groups()]
        assert values == [room.switches(profile)[name] for profile in room.profiles]


@each_board
def test_examples_of_the_readme_run_and_print_what_they_say(room, capsys):
    text = (ROOM / room.name / "README.md").read_text()
    examples = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert examples
    for example in examples:
        exec(example, {})
        said = re.findall(r"print\(.*\)  # (.*)$", example, re.MULTILINE)
        printed = capsys.readouterr().out.splitlines()
        assert said
        for line, comment in zip(printed, said, strict=True):
            assert comment == line or comment.startswith(line + ":")


@each_board
def test_examples_of_the_docstrings_hold(room):
    assert doctest.testmod(boards).attempted
    driver = doctest.testmod(importlib.import_module(f"pulsewright.boards.{room.name}.driver"))
    assert driver.attempted
    assert not driver.failed + doctest.testmod(boards).failed


@each_profile
def test_every_profile_opens_initialises_and_runs(room, profile):
    with boards.open_board(room.name, profile=profile) as driver:
        assert driver.profile == profile
        driver.identify()
        driver.initialise()
        assert not driver.running
        driver.release_estop()
        assert driver.running
        driver.check_running()
        driver.estop()
        assert not driver.running


@each_board
@pytest.mark.parametrize(
    ("column", "at", "value", "found"),
    [
        ("law", (0, 1), np.nan, r"trajectory.law\[0, 1\] is nan; it must be finite"),
        ("poly", (0, 1, 0), np.inf, r"trajectory.poly\[0, 1, 0\] is inf"),
        ("element", 0, 1, r"trajectory.element\[0\] is 1; they must be from 0 to 0"),
        ("start", 1, -1.0, r"trajectory.start\[1\] is -1.0; they must be 0 and then"),
        ("start", 0, 0.5, r"trajectory.start\[0\] is 0.5"),
    ],
)
def test_trajectories_made_by_hand_that_mean_nothing_are_not_played(room, column, at, value, found):
    steps = straight()
    getattr(steps, column)[at] = value
    with boards.open_board(room.name) as board:
        player = room.player(board, steps, DRIVES)
        with pytest.raises(UsageError, match=found):
            player.prepare()


@each_board
def test_trajectories_of_uneven_columns_are_not_played(room):
    steps = dataclasses.replace(straight(), start=np.zeros(3))
    with boards.open_board(room.name) as board:
        player = room.player(board, steps, DRIVES)
        with pytest.raises(UsageError, match=r"trajectory.start has the shape \(3,\)"):
            player.prepare()


def straight():
    """Return 100 steps of the first of two motors in 1 s, from rest to rest."""
    poly = np.zeros((1, 4, 2))
    poly[0, 1, 0] = 100.0
    none, first = np.zeros((1, 2)), np.zeros(1, np.int32)
    law = np.array([[0.0, 0.0, 3.0, -2.0]])
    ends = np.array([0.0, 1.0])
    return Trajectory(poly, none, none, np.zeros(1), np.ones(1), first, first, ends, law)


@each_board
def test_opening_sends_nothing(room):
    driver = boards.open_board(room.name)
    assert driver.bus.now() == 0


@each_board
def test_boards_opened_apart_are_apart(room):
    first, second = (boards.open_board(room.name) for _ in range(2))
    first.initialise()
    first.release_estop()
    assert first.running
    assert not second.running


@each_board
def test_a_twin_records_its_pins(room):
    twin = room.twin(room.default_profile)
    trace = twin.drain()
    assert {pin.format(0) for pin in room.motor_pins} <= set(trace.pins)
    assert trace.clock_hz == twin.clock_hz
    assert np.asarray(trace.initial).shape == (len(trace.pins),)


@each_board
def test_wrong_profiles_and_switches_are_refused_by_name(room):
    with pytest.raises(
        UsageError, match=f"{room.name} has no profile 'x'; it has .*{room.default_profile}"
    ):
        boards.open_board(room.name, profile="x")
    with pytest.raises(UsageError, match=f"{room.name} has no profile switch 'x'; it has "):
        boards.open_board(room.name, x=1)
    for switch in room.registers().switches:
        for value in (switch.minimum - 1, switch.maximum + 1):
            with pytest.raises(UsageError, match=f"{switch.name} = {value} .*allowed are"):
                room.switches(**{switch.name: value})
        for value in (switch.minimum, switch.maximum):
            assert room.switches(**{switch.name: value})[switch.name] == value


@each_board
def test_a_driver_over_a_given_bus_loads_no_compiler(room):
    loaded = modules_after(
        f"from pulsewright.boards import get\n"
        f"class Bus:\n"
        f"    clock_hz, access_cycles = 40_000_000, 60\n"
        f"get('{room.name}').driver(Bus())"
    )
    assert f"pulsewright.boards.{room.name}.driver" in loaded
    assert not loaded & set(HEAVY)


@each_board
def test_errors_are_of_one_tree(room):
    driver = boards.open_board(room.name)
    with pytest.raises(PulsewrightError):
        driver.check_running()
