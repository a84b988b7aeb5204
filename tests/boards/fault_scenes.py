"""Boards that play a plan while something goes wrong, and what became of it.

Times are those of the board [s]. Positions are counted at the step pins, from power-up on.
"""

import math
import re
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from pulsewright import boards, open_board
from pulsewright.boards.playing import Drives
from pulsewright.boards.watching import Feedback, LimitSwitches
from pulsewright.edges.path import numbered_pins, step_signs
from pulsewright.edges.timing import DriveTiming
from pulsewright.errors import PositionUnknownError, PulsewrightError, UsageError
from pulsewright.motion.trajectory import Trajectory
from pulsewright.transport.faults import Faults

TABLE = Path(__file__).resolve().parents[2] / "docs" / "faults.md"
SECONDS, WAY = 0.6, (1500.0, -900.0)  # of the plan [s], of each motor [step]
HIT_AT = 0.25  # when the fault comes, in the time of the plan [s]
TIMING = DriveTiming(width=2.5e-6, space=2.5e-6, setup=5e-6, hold=5e-6)
MOTORS = len(WAY)


@dataclass(frozen=True)
class Size:
    """How large scenes are at a board.

    Parameters
    ----------
    longer : float
        So many times longer are way and time of the plan: more on boards that know much of it.
    after : float
        Time that is waited for a board to come to rest, after all [s].
    options : dict
        Of the board.
    timeout : float
        Of the driver [s].
    retries : int
        Of the driver.
    share : float
        Of the times in the table, in which such a board comes to rest.
    stall : float
        Time for which a host that stalls does so [s].
    """

    longer: float = 1
    after: float = 0.1
    options: dict = field(default_factory=dict)
    timeout: float = 1.0
    retries: int = 3
    share: float = 1
    stall: float = 1.0


SIZES = {
    ("s3g", "twin"): Size(longer=3, after=1.0, options={"prog_words": 2048}),
    # gateware makes some two million cycles a second, and a second of this board has 50
    ("s3g", "rtl"): Size(
        0.5, 0.2, {"prog_words": 512}, timeout=0.03, retries=1, share=0.4, stall=0.25
    ),
}


def plan(longer=1):
    """Return a straight move from rest to rest: up to 3750 and 2250 step/s."""
    seconds, way, motors = longer * SECONDS, [longer * x for x in WAY], MOTORS
    poly, none = np.zeros((1, 4, motors)), np.zeros((1, motors))
    poly[0, 1] = way
    zero, one = np.zeros(1, np.int32), np.ones(1)
    law = np.array([[0.0, 0.0, 3 / seconds**2, -2 / seconds**3]])
    return Trajectory(poly, none, none, 0 * one, one, zero, zero, np.array([0.0, seconds]), law)


class KilledError(Exception):
    """The host process is gone: nothing more is sent, not even to leave the board."""


@dataclass
class Scene:
    """A board on a link with faults, at rest.

    Parameters
    ----------
    board, engine : str
        Engine is ``twin`` or ``rtl``.
    feedback : bool
        The motors have encoders with a count per step.
    inputs : tuple of int
        Limit switches.
    options : dict
        Of the board.
    seed : int
        Of faults at random.
    """

    board: str
    engine: str = "twin"
    feedback: bool = False
    inputs: tuple = ()
    options: dict = field(default_factory=dict)
    seed: int = 1

    def __post_init__(self):
        self.room = boards.get(self.board)
        self.size = SIZES.get((self.board, self.engine), Size())
        self.options = self.size.options | self.options
        self.faults = Faults(self.seed)
        self.driver = open_board(self.board, f"{self.engine}:", faults=self.faults, **self.options)
        self._shorten()
        self.twin = self.driver.bus.twin
        self.clock = self.twin.clock_hz
        self.longer = self.size.longer
        self.plan = plan(self.longer)
        self.end = [round(self.longer * x) for x in WAY]
        self.pins = numbered_pins(MOTORS, self.room.positive_direction, *self.room.motor_pins)
        self.counts = np.zeros(MOTORS, np.int64)
        self.last = 0  # cycle of the last step
        self.told = False  # a new host that the board was left in mid-move
        self.error = None
        self.drives = Drives(
            [5000.0] * MOTORS,
            [60_000.0] * MOTORS,
            [6e6] * MOTORS,
            TIMING,
            feedback=Feedback((1.0,) * MOTORS) if self.feedback else None,
            switches=LimitSwitches(self.inputs) if self.inputs else None,
        )
        self.player = self.room.player(self.driver, self.plan, self.drives)

    def _shorten(self):
        """Let the driver ask for answers no longer than such a scene allows, on serial links."""
        self.driver.timeout, self.driver.retries = self.size.timeout, self.size.retries

    def note(self):
        """Count the steps up to now."""
        trace = self.twin.drain()
        for motor, pins in enumerate(self.pins):
            cycles, signs = step_signs(trace, pins)
            if "tristate" in trace.pins:  # what is high-Z is no step
                high_z = np.searchsorted(trace["tristate"], cycles, side="right") & 1
                driven = high_z ^ trace.level_at_start("tristate") == 0
                cycles, signs = cycles[driven], signs[driven]
            self.counts[motor] += signs.sum()
            self.last = max([self.last, *cycles[-1:].tolist()])

    def play(self, fault):
        """Play to the fault, let it happen, play on; then leave the board as a program does."""
        self.player.prepare()
        if self.feedback and hasattr(self.driver, "encoder_faults"):
            self.turn(0.0, HIT_AT)
        self.player.play(HIT_AT * self.longer)
        self.note()
        self.fault_at = self.twin.now
        self.at_fault = self.counts.copy()
        try:
            fault(self)
            self.player.play(math.inf)
            self.driver.__exit__(None, None, None)
        except KilledError:
            pass
        except PulsewrightError as error:
            self.error = error
            with suppress(PulsewrightError):  # what leaving the board meets with is not the cause
                self.driver.__exit__(type(error), error, None)
        self.note()
        self.wait()

    def play_again(self):
        """Play the plan from where the board is; return the steps that it made."""
        before = self.counts.copy()
        self.faults.inject("none")
        numbers = self.room.numbers(self.options)  # of a new session, which knows of nothing
        self.driver = self.room.driver(self.driver.bus, self.room.default_profile, **numbers)
        self._shorten()
        self.player = self.room.player(self.driver, self.plan, self.drives)
        try:
            self.player.prepare()
        except PositionUnknownError:  # the board has told that it was left in mid-move
            self.told = True
            self.driver.reference()
            self.player.prepare()
        self.player.play(math.inf)
        self.note()
        return (self.counts - before).tolist()

    def wait(self):
        """Let time pass."""
        self.twin.advance(self.twin.now + round(self.size.after * self.clock))
        self.note()

    @property
    def rest_after(self):
        """Time from the fault to the last step [ms]."""
        return (self.last - self.fault_at) / self.clock * 1e3

    @property
    def left(self):
        """Time from the fault to the end of the plan [ms]."""
        return (
            (self.player.start_cycle + self.plan.duration * self.clock - self.fault_at)
            / self.clock
            * 1e3
        )

    @property
    def steps(self):
        return self.counts.tolist()

    def turn(self, begin, end, slip=0):
        """Let the encoders at the pins turn with the motors of the plan, a count per step.

        From ``begin`` to ``end`` [s]; the first one is ``slip`` counts behind.
        """
        time = np.arange(begin, end, 1e-5)
        for motor, place in enumerate(self.plan.at(time).T):
            counts = np.floor(place + 0.5).astype(int) - (slip if motor == 0 else 0)
            if slip and motor == 0:
                counts = np.maximum(counts, np.floor(place[0] + 0.5).astype(int))
            cycles = self.player.start_cycle + np.round(time * self.clock).astype(int)
            cycles = np.maximum(cycles, self.twin.now + 10)
            for pin, phases in (("a", (1, 2)), ("b", (2, 3))):  # A leads B
                level = np.isin(counts % 4, phases).astype(int)
                at = np.flatnonzero(np.diff(level)) + 1
                self.twin.schedule(cycles[at], f"enc{motor}_{pin}", level[at])

    def set_pin(self, pin, level):
        """Bring an input pin to a level in the next cycle."""
        self.twin.schedule([self.twin.now + 1], pin, level)


@dataclass(frozen=True)
class Case:
    """A row of the table.

    Parameters
    ----------
    name : str
        First cell of the row.
    fault : callable or None
        Gets the `Scene` in mid-move. None: there is no such scene, and asking for it is refused.
    error : str
        Class of the error that ends the motion, as its cell begins; empty: none.
    says : str
        What its message says, and the cell, too.
    rest : str
        When all is at rest, as its cell begins: ``10 ms``, ``end of plan``, ``never``.
    scene : dict
        Of `Scene`, what is different.
    silent : bool
        The steps made are not those of the plan, and nobody notices.
    check : callable, optional
        Gets the scene at the end; for what else the row says.
    rtl : bool
        It concerns the board: the same on its gateware.
    """

    name: str
    fault: object
    error: str = ""
    says: str = ""
    rest: str = "end of plan"
    scene: dict = field(default_factory=dict)
    silent: bool = False
    check: object = None
    rtl: bool = False


def rows(board):
    """Return the rows of a board's table: cells by name of the row."""
    text = TABLE.read_text()
    section = re.search(rf"^## {board}$(.*?)(?=^## |\Z)", text, re.M | re.S).group(1)
    found = {}
    for line in re.findall(r"^\| (.*) \|$", section, re.M):
        cells = [cell.strip() for cell in line.split(" | ")]
        assert len(cells) == 5, line
        found[cells[0]] = cells[1:]
    del found["fault"], found["---"]
    return found


def check_case(board, case, engine="twin"):
    """Play a case, and compare with its row."""
    if case.fault is None:
        with pytest.raises(UsageError, match=case.says):
            Scene(board, engine, **case.scene)
        return
    scene = Scene(board, engine, **case.scene)
    scene.play(case.fault)
    assert type(scene.error).__name__ == (case.error or "NoneType"), scene.error
    assert scene.error is None or case.says in str(scene.error)
    if case.rest == "end of plan":
        assert scene.rest_after <= scene.left + 5
    elif case.rest == "never":
        assert scene.rest_after > 0.9e3 * scene.size.after
    else:
        assert scene.rest_after <= 1.02 * float(case.rest.removesuffix(" ms")) * scene.size.share
    assert np.abs(scene.at_fault).min() > 100, "in mid-move"
    if case.silent:
        assert scene.error is None
        assert scene.steps != scene.end
    elif case.rest == "end of plan":
        assert scene.steps == scene.end
    if case.check:
        case.check(scene)


def check_rows(board, cases):
    """Check that table and cases are about the same, and say the same."""
    table = rows(board)
    assert list(table) == [case.name for case in cases]
    for case in cases:
        does, reports, rest, then = table[case.name]
        assert does
        assert then
        wanted = f"`{case.error}`" if case.error else "nothing"
        assert reports.startswith(wanted), case.name
        assert case.says.strip() in reports.replace("`", ""), case.name
        assert rest.startswith(case.rest), case.name
        assert ("undetected" in reports) == case.silent, case.name
