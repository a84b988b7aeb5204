"""A host that moves a served board until it is killed; for tests of what the board does then.

Arguments: board, link, ``rates`` or ``plan``, and parameters of the board as ``NAME=N``. It says
``moving`` and the time between its commands [s], for each time it has begun to move.
"""

import math
import sys
import time
from contextlib import suppress

import numpy as np

from pulsewright import boards, open_board
from pulsewright.boards.playing import Drives
from pulsewright.edges.timing import DriveTiming
from pulsewright.errors import EstopError, MotionLimitError, StarvedError
from pulsewright.motion.trajectory import Trajectory

RATES = (3000.0, -1800.0)
REFRESH = 0.001  # from one update of rates to the next [s]
TIMING = DriveTiming(width=2.5e-6, space=2.5e-6, setup=5e-6, hold=5e-6)
DRIVES = Drives([5000.0] * 2, [60_000.0] * 2, [6e6] * 2, TIMING)


def plan(seconds, way):
    """Return a straight move from rest to rest."""
    poly, none = np.zeros((1, 4, len(way))), np.zeros((1, len(way)))
    poly[0, 1] = way
    zero, one = np.zeros(1, np.int32), np.ones(1)
    law = np.array([[0.0, 0.0, 3 / seconds**2, -2 / seconds**3]])
    return Trajectory(poly, none, none, 0 * one, one, zero, zero, np.array([0.0, seconds]), law)


def drive(driver, rates):
    """Set step rates; release the board before, if it does not run, for it gives up late hosts."""
    if not driver.running:
        with suppress(EstopError):  # late again
            driver.release_estop()
    with suppress(EstopError):
        others = len(driver.step_rates()) - len(rates)
        driver.set_step_rates([*rates, *[0.0] * others])


def set_rates(driver):
    """Set step rates for ever, as a servo loop does."""
    driver.initialise()
    print("moving", REFRESH, flush=True)
    while True:
        drive(driver, RATES)
        time.sleep(REFRESH)


def play(driver, room, trajectory):
    """Play a plan for ever; begin anew where this computer was too busy to keep up with it."""
    while True:
        player = room.player(driver, trajectory, DRIVES)
        driver.reference()  # of a board that nobody has hurt yet
        with suppress(MotionLimitError, StarvedError):
            player.prepare()
            print("moving", player.update, flush=True)
            player.play(math.inf)


def main(board, link, how, *options):
    """Move a board."""
    numbers = {name: int(value) for name, _, value in (word.partition("=") for word in options)}
    driver = open_board(board, link, **numbers)
    if how == "rates":
        set_rates(driver)
    else:
        play(driver, boards.get(board), plan(10.0, (20_000.0, -12_000.0)))


if __name__ == "__main__":
    main(*sys.argv[1:])
