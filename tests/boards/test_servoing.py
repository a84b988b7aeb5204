"""Plans in closed loop: what the step pins make of it, with hosts that are late at random."""

import math
import random

import numpy as np
import pytest
from fault_scenes import SECONDS, TIMING, WAY, plan

from pulsewright import boards
from pulsewright.boards.playing import Drives
from pulsewright.boards.pluto_step.player import PlutoStepServo
from pulsewright.boards.usc.player import UscServo
from pulsewright.boards.watching import Feedback, LimitSwitches
from pulsewright.edges.path import numbered_pins, step_signs
from pulsewright.errors import (
    EstopError,
    FollowingError,
    LimitSwitchError,
    MotionLimitError,
    UsageError,
)
from pulsewright.transport.bus import EppBus
from pulsewright.transport.virtual import VirtualEppBus

BOARDS = {"usc": {"loopback": 1}, "pluto_step": {}}
END = [round(x) for x in WAY]


class HostBus(EppBus):
    """A twin behind a host that does not keep its times: each access comes when it comes.

    Parameters
    ----------
    twin
    late : callable
        How late the host is in an access or after a nap [s].
    """

    in_real_time, exact = True, False

    def __init__(self, twin, late):
        self.bus, self.twin, self._late = VirtualEppBus(twin), twin, late
        self.clock_hz, self.access_cycles = self.bus.clock_hz, self.bus.access_cycles

    def transact(self, accesses):
        self.sleep(0)
        accesses["cycle"] = -1
        self.bus.transact(accesses)

    def sleep(self, seconds):
        self.twin.advance(self.twin.now + round((seconds + self._late()) * self.clock_hz))

    def reset(self):
        self.bus.reset()

    def now(self):
        return self.bus.now()

    def close(self):
        self.bus.close()


class Loop:
    """A board that plays a plan in closed loop, and its pins."""

    def __init__(self, board, late=lambda: 0.0, options=None, rate=5000.0, way=None, **drives):
        self.room = boards.get(board)
        options = BOARDS[board] if options is None else options
        self.twin = self.room.twin(self.room.default_profile, **options)
        self.driver = self.room.driver(HostBus(self.twin, late), **options)
        self.plan = way or plan()
        self.player = self.room.player(
            self.driver,
            self.plan,
            Drives([rate] * 2, [60_000.0] * 2, [6e6] * 2, TIMING, **drives),
        )
        self.player.sleep = self.driver.bus.sleep
        self.pins = numbered_pins(2, self.room.positive_direction, *self.room.motor_pins)

    def steps(self):
        """Return cycles and signs of the steps of each motor up to now."""
        self.twin.advance(self.twin.now + round(0.002 * self.twin.clock_hz))
        trace = self.twin.drain()
        return [step_signs(trace, pins) for pins in self.pins]

    def deviation(self, steps):
        """Return by how much motors were off the plan, just before and after each step [step]."""
        worst = 0.0
        for motor, (cycles, signs) in enumerate(steps):
            counts = np.cumsum(signs)
            time = (cycles - self.player.start_cycle) / self.twin.clock_hz
            planned = self.plan.at(time)[:, motor]
            worst = max(worst, *abs(planned - counts), *abs(planned - counts + signs))
        return worst


def positions(steps):
    return [int(signs.sum()) for _, signs in steps]


def jitter(most, seed=1, share=1.0):
    """Return how late a host is that is late now and then by up to ``most`` [s]."""
    numbers = random.Random(seed)
    return lambda: numbers.uniform(0, most) if numbers.random() < share else 0.0


@pytest.mark.parametrize("board", BOARDS)
def test_a_board_of_a_host_in_real_time_is_driven_in_closed_loop(board):
    kind = UscServo if board == "usc" else PlutoStepServo
    assert isinstance(Loop(board).player, kind)


@pytest.mark.parametrize(
    ("late", "most"),
    [
        (lambda: 0.0, 1.5),
        (jitter(0.0002), 2.0),
        (jitter(0.004, share=0.02), 2.5),
    ],
    ids=["punctual", "0.2 ms late", "4 ms late at times"],
)
@pytest.mark.parametrize("board", BOARDS)
def test_a_plan_is_followed_and_ends_where_it_ends(board, late, most):
    """Half a step of the grid, another one of the encoders, and 0.2 steps in 4 ms without rates."""
    loop = Loop(board, late)
    loop.player.prepare()
    loop.player.play(0.25)
    assert not loop.player.done
    loop.player.play(math.inf)
    assert loop.player.done
    steps = loop.steps()
    assert positions(steps) == END
    assert loop.deviation(steps) <= most
    assert loop.player.worst.max() <= most
    assert loop.driver.position_known
    assert f"{loop.player.worst[0]:.1f}" in loop.player.evidence[0]


@pytest.mark.parametrize("board", BOARDS)
def test_a_plan_that_is_left_rests_on_its_path(board):
    loop = Loop(board, jitter(0.0002))
    loop.player.prepare()
    loop.player.play(0.25)
    stop = loop.player.stop()
    assert positions(loop.steps()) == list(stop.position)
    assert 0.25 < stop.time < 0.4 < SECONDS  # 3750 step/s take 63 ms at 60 000 step/s^2
    assert np.abs(np.array(stop.position) - loop.plan.at(stop.time)[0]).max() <= 0.51
    assert loop.driver.position_known


def resting(share, since, until):
    """Return a plan that rests in its middle, at a share of the way, between two times [s]."""
    law = [
        [0.0, 0.0, 3 * share / since**2, -2 * share / since**3],
        [share, 0.0, 0.0, 0.0],
        [share, 0.0, 3 * (1 - share) / since**2, -2 * (1 - share) / since**3],
    ]
    start = np.array([0.0, since, until, until + since])
    return plan().timed(np.zeros(3, np.int32), start, np.array(law))


@pytest.mark.parametrize("board", BOARDS)
def test_a_motor_rests_where_the_plan_does(board):
    """At 750.512 steps, that is 0.012 more than the board needs to be told to make the last one."""
    loop = Loop(board, jitter(0.0002), way=resting(750.512 / WAY[0], 0.4, 1.4))
    loop.player.prepare()
    loop.player.play(math.inf)
    steps = loop.steps()
    assert positions(steps) == END
    for (cycles, signs), there in zip(steps, (751, -450), strict=True):
        time = (cycles - loop.player.start_cycle) / loop.twin.clock_hz
        assert signs[time < 0.46].sum() == there
        assert not ((time > 0.46) & (time < 1.4)).any()


@pytest.mark.parametrize("board", BOARDS)
def test_a_host_that_stands_still_is_stopped_by_the_watchdog(board):
    stalled = []
    loop = Loop(board, lambda: stalled.pop() if stalled else 0.0)
    loop.player.prepare()
    loop.player.play(0.25)
    stalled.append(0.03)
    with pytest.raises(EstopError):
        loop.player.play(math.inf)
    assert not loop.driver.position_known


def test_a_motor_that_does_not_follow_is_noticed():
    loop = Loop("usc")
    loop.player.prepare()
    loop.player.play(0.25)
    loop.twin.set_loopback(False)
    with pytest.raises(FollowingError, match="an encoder does not count as it should"):
        loop.player.play(math.inf)


def test_a_motor_that_has_lost_steps_catches_up():
    """Within the following error, the loop brings it back: the encoder has the last word."""
    loop = Loop("usc", feedback=Feedback((1.0, 1.0), following_error=5.0))
    loop.player.prepare()
    loop.player.play(0.25)
    count = loop.twin.state()["enc"][0]
    loop.twin.set_encoder(0, count - 4)
    loop.player.play(math.inf)
    assert positions(loop.steps()) == [END[0] + 4, END[1]]
    assert loop.twin.state()["enc"][0] == END[0]


def test_a_limit_switch_ends_it():
    loop = Loop("pluto_step", switches=LimitSwitches((9,)))
    loop.player.prepare()
    loop.player.play(0.25)
    loop.twin.set_din(1 << 9)
    with pytest.raises(LimitSwitchError, match="input 9"):
        loop.player.play(math.inf)


def test_without_encoders_a_usc_takes_plans_on_exact_links_only():
    loop = Loop("usc", options={})
    with pytest.raises(UsageError, match=r"encoders"):
        loop.player.prepare()


def test_rates_that_the_pulses_do_not_allow():
    """2.5 us high and 2.5 us low: 200 000 step/s."""
    loop = Loop("usc", rate=210_000.0)
    with pytest.raises(MotionLimitError, match=r"210000 step/s asked.*200000"):
        loop.player.prepare()


def test_an_encoder_on_each_motor():
    with pytest.raises(UsageError, match="1 encoders given for 2 motors"):
        Loop("usc", feedback=Feedback((4.0,)))
