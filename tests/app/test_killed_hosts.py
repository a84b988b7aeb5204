"""Hosts that are killed (-9) while they move a served board, each in a process of its own.

Times are those of the board: how busy this computer is does not matter.
"""

import math
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
from moving_host import DRIVES, drive, plan
from served import Control, Process, limited

from pulsewright import boards, open_board
from pulsewright.edges.path import numbered_pins, step_signs
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import (
    EstopError,
    MotionLimitError,
    PositionUnknownError,
    StarvedError,
)

pytestmark = pytest.mark.campaign  # many processes, in real time

HOST = Path(__file__).with_name("moving_host.py")
PATIENCE = 120  # until a host moves, or a board rests [s]
TRIES = 5
BUSY = EstopError, MotionLimitError, StarvedError  # what a computer is told that does too much
STEPS = 100  # so many before the host is killed
STILL = 0.05  # a board that makes no step for so long rests [s of the board]
OPTIONS = {"s3g": ("prog_words=2048",), "rapcores": ("depth=16",)}


class Served:
    """A board in a process of its own.

    Parameters
    ----------
    board : str
    folder : Path
    """

    def __init__(self, board, folder):
        place, self.board = folder / "bus", board
        self.room, options = boards.get(board), OPTIONS.get(board, ())
        self.options = {name: int(n) for name, _, n in (word.partition("=") for word in options)}
        kind = {"epp": f"epp+unix:{place}", "spi": f"spi+unix:{place}", "serial": f"pty:{place}"}
        listen = kind[self.room.bus]
        self.link = f"serial:{place}?baud=500000" if self.room.bus == "serial" else listen
        self.edges = folder / "edges.npz"
        arguments = [board, "--listen", listen, "--control", f"unix:{folder / 'c'}"]
        arguments += ["--edges", self.edges]
        for option in options:
            arguments += ["--set", option]
        if self.room.bus == "epp":
            self.writes = folder / "writes"
            arguments += ["--trace", self.writes]
        self.process = Process(*arguments)
        self.control = Control(folder / "c")

    @contextmanager
    def host(self, how):
        """Start a host; yield it, and the time between its commands [s]."""
        command = [sys.executable, HOST, self.board, self.link, how, *OPTIONS.get(self.board, ())]
        host = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            with limited(host, PATIENCE):
                word, _, period = host.stdout.readline().partition(" ")
                assert word == "moving", host.stderr.read()
            yield host, float(period)
        finally:
            host.kill()
            host.communicate(timeout=60)

    def moves(self, host):
        """Wait until a host has moved the board."""
        before, limit = np.array(self.control("steps")["steps"]), time.monotonic() + PATIENCE
        while abs(np.array(self.control("steps")["steps"]) - before).max() < STEPS:
            assert host.poll() is None, host.stderr.read()
            assert time.monotonic() < limit, "it does not move"
            time.sleep(0.01)

    def rests(self):
        """Wait until the board has stopped, by what it tells; return its state."""
        limit, since, before = time.monotonic() + PATIENCE, None, None
        while True:
            state = self.control("get")
            steps = state["steps"] if self.room.bus == "epp" else state["position"]
            if steps != before:
                since, before = state["t"], steps
            if state.get("tristate") or state["t"] - since > STILL * 1e9:
                return state
            assert time.monotonic() < limit, "it does not stop"
            time.sleep(0.01)

    def kill(self, how):
        """Let a host move the board, kill it; return states at its death and at rest."""
        with self.host(how) as (host, period):
            self.moves(host)
            host.kill()
            host.wait(60)
            death = self.control("get")
            return death, self.rests(), period

    def last_step(self, state):
        """Return when the last step of a motor was driven before a state was taken [s]."""
        trace, last = EdgeTrace.load(self.edges), 0
        until = state["t"] * trace.clock_hz // 1_000_000_000
        motors = numbered_pins(2, self.room.positive_direction, *self.room.motor_pins)
        for pins in motors:
            cycles, _ = step_signs(trace, pins)
            if "tristate" in trace.pins:  # what is high-Z is no step
                high_z = np.searchsorted(trace["tristate"], cycles, side="right") & 1
                cycles = cycles[(high_z ^ trace.level_at_start("tristate")) == 0]
            last = max([last, *cycles[cycles <= until][-1:].tolist()])
        return last / trace.clock_hz

    def last_write(self, state):
        """Return when a host wrote the last time before a state was taken [s]."""
        times = np.array([int(line.split()[0]) for line in self.writes.read_text().splitlines()])
        return float(times[times <= state["t"]][-1]) / 1e9

    def next_host(self):
        """Return a driver in a new host, at this board."""
        return open_board(self.board, self.link, **self.options)


@pytest.fixture
def served(request, tmp_path):
    board = Served(request.param, tmp_path)
    with board.process:
        yield board


def unknown(served, driver):
    """No plan is played before the machine is referenced."""
    player = served.room.player(driver, plan(1.0, (10.0, 10.0)), DRIVES)
    assert not driver.position_known
    with pytest.raises(PositionUnknownError):
        player.prepare()
    before = served.control("steps")["steps"]
    time.sleep(0.3)
    assert served.control("steps")["steps"] == before
    driver.reference()
    assert driver.position_known


def run(served, driver):
    """Set step rates until motor 0 has made steps; this host may stand still for any time."""
    limit, before = time.monotonic() + PATIENCE, served.control("steps")["steps"][0]
    while served.control("steps")["steps"][0] - before < STEPS:
        assert time.monotonic() < limit, "it does not move"
        drive(driver, (3000.0, 0.0))
    driver.estop()


def play_again(served):
    """Play a plan to its end in a new host, whatever the old one has left; return its steps."""
    before = served.control("steps")["steps"]
    for attempt in range(TRIES):
        with suppress(*(() if attempt == TRIES - 1 else BUSY)), served.next_host() as driver:
            player = served.room.player(driver, plan(0.5, (50.0, -30.0)), DRIVES)
            player.prepare()
            player.play(math.inf)
            break
        before = served.control("steps")["steps"]
    return [b - a for a, b in zip(before[:2], served.control("steps")["steps"][:2], strict=True)]


# What watchdogs leave [s], by docs/faults.md; a pulse that is under way is finished.
WATCHDOGS = {"usc": 10e-3, "pluto_step": 6.51e-3}


@pytest.mark.parametrize("served", WATCHDOGS, indirect=True)
def test_step_rates(served):
    kills = [served.kill("rates") for _ in range(3)]
    for _, rest, _ in kills:
        assert rest["estop"] if served.board == "usc" else rest["tristate"]
    with served.next_host() as driver:
        if served.board == "usc":  # it tells no more of what was than that it is stopped
            with pytest.raises(EstopError):
                driver.check_running()
            driver.initialise()
        else:  # axes move on behind pins that are high-Z
            driver.initialise()
            unknown(served, driver)
        run(served, driver)
    served.process.__exit__()
    left = [served.last_step(rest) - served.last_write(rest) for _, rest, _ in kills]
    most = WATCHDOGS[served.board]
    assert max(left) <= 1.02 * most
    assert max(left) > 0.9 * most  # the board went on: it was in mid-move


@pytest.mark.parametrize("served", ["rapcores"], indirect=True)
def test_moves(served):
    for _ in range(3):
        death, rest, _ = served.kill("plan")
        if death["executing"]:
            break
        served.control("reset")  # it was too busy to play just then
    assert death["executing"]
    assert not rest["executing"]
    assert rest["used"] == 0
    with served.next_host() as driver:
        driver.initialise()
        # it has counted its steps, and nothing else is known: motors may have lost some
        assert driver.read_steps().tolist() == rest["position"]
        driver.release_estop()
        driver.move(round(0.01 * driver.tick_rate), [driver.increment(1000.0), 0, 0, 0])
        driver.wait_idle()
        assert served.control("steps")["steps"][0] - rest["position"][0] in (9, 10)
    assert play_again(served) == [50, -30]
    served.process.__exit__()
    left = served.last_step(rest) - death["t"] / 1e9
    # as many moves of 20 ms as it buffers, and one that may have been on its way
    assert 0 < left < (16 + 1) * 20e-3


@pytest.mark.parametrize("served", ["s3g"], indirect=True)
def test_programs(served):
    for _ in range(3):
        death, rest, period = served.kill("plan")
        if death["asg"] == "working":
            break
    assert death["asg"] == "working"
    with served.next_host() as driver:
        driver.initialise()
        unknown(served, driver)  # its program ended where there was no more of it
        run(served, driver)
    # a host that comes while the board still moves ends that
    with served.host("plan") as (host, _):
        served.moves(host)
        host.kill()
        host.wait(60)
        with served.next_host() as driver:
            driver.initialise()
            unknown(served, driver)
    served.process.__exit__()
    left = served.last_step(rest) - death["t"] / 1e9
    # a program memory full of loads, of five words and up to eight grid steps, and the ramp
    assert 0.05 < left < 2048 / 5 * 8 * period + 0.1
