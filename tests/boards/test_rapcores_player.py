"""Plans played on the rapcores twin: to the step and the cycle, after starving, and halted."""

import math
from time import monotonic, sleep

import numpy as np
import pytest

from pulsewright import open_board
from pulsewright.boards.playing import Drives
from pulsewright.boards.rapcores import player as player_module
from pulsewright.boards.rapcores.driver import RapcoresDriver
from pulsewright.boards.rapcores.messages import Codec
from pulsewright.boards.rapcores.player import RapcoresPlayer, Told
from pulsewright.boards.rapcores.registers import R_BUFFER_STATE, R_TICKS_LEFT
from pulsewright.boards.rapcores.twin import RapcoresTwin
from pulsewright.edges.path import StepCounter, numbered_pins
from pulsewright.edges.timing import DriveTiming
from pulsewright.errors import (
    BusError,
    EstopError,
    MotionLimitError,
    PositionUnknownError,
    StarvedError,
    UsageError,
)
from pulsewright.motion.hold import hold
from pulsewright.motion.trajectory import Trajectory
from pulsewright.transport.spi_bus import SpiBus, VirtualSpiBus

CLOCK = 16_000_000
DEVIATION = 0.6


def swing(seconds, amplitude, rate, motors=2, slope=0.0):
    """Return motors on circles from rest to rest, up to ``rate`` [step/s]."""
    poly, cosine, sine = np.zeros((1, 4, motors)), np.zeros((1, motors)), np.zeros((1, motors))
    way = rate * seconds / 1.5
    poly[0, 1] = slope / rate
    poly[0, 0, ::2] = amplitude
    cosine[0, ::2], sine[0, 1::2] = -amplitude, amplitude
    zero, law = np.zeros(1, np.int32), np.array([[0.0, 0.0, 3 / seconds**2, -2 / seconds**3]]) * way
    omega, length = np.array([1 / amplitude]), np.array([way])
    return Trajectory(poly, cosine, sine, omega, length, zero, zero, np.array([0.0, seconds]), law)


def play_on(driver, plan, **changes):
    most = {"rates": 20_000.0, "accelerations": 160_000.0, "jerks": 6.4e6}
    motors = {name: [value] * plan.axes for name, value in most.items()}
    width = changes.pop("pulse_width", 2.5e-6)
    timing = DriveTiming(width=width, space=2.5e-6, setup=5e-6, hold=5e-6)
    return RapcoresPlayer(driver, plan, Drives(**motors | changes, timing=timing))


class Slow(VirtualSpiBus):
    """A link to a twin whose host pauses before some frame."""

    def __init__(self, twin):
        super().__init__(twin, listens=255)
        self.frames, self.pause_at, self.pause = 0, (), 0.0

    def transfer(self, data, cycle=-1):
        self.frames += 1
        if self.frames in self.pause_at:
            self.sleep(self.pause)
        return super().transfer(data, cycle)


class Cable(SpiBus):
    """A link to a twin that looks like one to hardware: it sends at once, and has no other pins."""

    def __init__(self, twin):
        self.clock_hz, self.twin = CLOCK, twin
        self._bus = VirtualSpiBus(twin, listens=255)

    def transfer(self, data, cycle=-1):
        return self._bus.transfer(data)

    def now(self):
        return self._bus.now()

    def sleep(self, seconds):
        self._bus.sleep(seconds)

    def reset(self):
        raise UsageError("no reset pin")

    def close(self):
        self._bus.close()


class Paced(Cable):
    """The same, in real time: while the host waits, other threads have as long."""

    in_real_time = True

    def sleep(self, seconds):
        sleep(seconds)
        super().sleep(seconds)


def steps_of(twin, motors):
    """Return cycles and counts of the steps of each motor since the start."""
    return StepCounter(numbered_pins(motors, 0)).feed(twin.drain())


def check_steps(steps, plan, start_cycle):
    """Check steps against a plan that starts at 0, and the counts at its end."""
    worst, end = 0.0, plan.at(math.inf)[0]
    for i, (cycles, counts) in enumerate(steps):
        crossed = (counts + np.concatenate([[0], counts[:-1]])) / 2
        planned = plan.at((cycles - start_cycle) / CLOCK)[:, i]
        worst = max(worst, float(abs(crossed - planned).max(initial=0.0)))
        assert abs(counts[-1] - end[i]) <= 0.5
    assert 0.5 + worst <= DEVIATION
    return worst


def check_about(player, plan):
    """Check steps on a link where the start is known to half a frame or so only."""
    shift = 9000 * 2e-5
    for i, (made, places) in enumerate(steps_of(player.driver.bus.twin, 2)):
        playing = made >= player.start_cycle
        assert places[~playing][-1:].sum() == 0  # to and fro, before motors were enabled
        cycles, counts = made[playing], places[playing]
        crossed = counts - np.diff(counts, prepend=0) / 2
        planned = plan.at((cycles - player.start_cycle) / CLOCK)[:, i]
        assert abs(crossed - planned).max() < 0.1 + shift
        assert abs(counts[-1] - plan.at(math.inf)[0, i]) <= 0.5


# ------------------------------------------------------------------------------ on time


@pytest.mark.parametrize(
    "build",
    [
        {},
        {"motors": 2, "encoders": 0},
        {"motors": 6, "encoders": 6, "depth": 16},
        {"word_bits": 32, "depth": 4},
    ],
)
def test_steps_come_when_the_plan_passes_the_middle_between_two(build):
    driver = open_board("rapcores", **build)
    plan = swing(0.3, 700, 10_000, motors=min(driver.motors, 4), slope=200.0)
    player = play_on(driver, plan)
    player.prepare()
    assert not player.done
    player.play(math.inf)
    assert player.done
    steps = steps_of(driver.bus.twin, plan.axes)
    assert sum(len(cycles) for cycles, _ in steps) > 1000 * plan.axes
    # 0.02 in long moves, half a tick of 41 clocks at up to 10200 steps/s is 0.013
    assert check_steps(steps, plan, player.start_cycle) < 0.036
    assert driver.read_steps()[: plan.axes].tolist() == np.floor(plan.at(9.0)[0] + 0.5).tolist()


@pytest.mark.parametrize("rate", [10_000.0, 60_000.0, 190_000.0])
def test_the_first_tick_is_known_for_any_length_of_ticks(rate):
    # a straight move: its steps are at the plan, up to half a tick beside it
    seconds = 0.5
    n = int(rate * seconds / 1.5)
    law = np.array([[0.0, 0.0, 3 / seconds**2, -2 / seconds**3]])
    poly, none, zero = np.zeros((1, 4, 1)), np.zeros((1, 1)), np.zeros(1, np.int32)
    poly[0, 1] = n
    one, ends = np.ones(1), np.array([0.0, seconds])
    plan = Trajectory(poly, none, none, np.zeros(1), one, zero, zero, ends, law)
    driver = open_board("rapcores", motors=1, encoders=0)
    player = play_on(driver, plan, rates=[rate], accelerations=[6 * n / seconds**2])
    player.prepare()
    player.play(math.inf)
    ((cycles, counts),) = steps_of(driver.bus.twin, 1)
    assert (counts == np.arange(1, n + 1)).all()
    tick = round(CLOCK / driver.tick_rate)
    late = cycles - player.start_cycle - when(plan, counts - 0.5, seconds) * CLOCK
    middle = late[n // 3 : -n // 3]  # where a step is short: there the bend is no time
    assert abs(middle).max() <= tick / 2 + 2 + 0.02 / rate * CLOCK
    assert abs(middle.mean()) <= 1.5


def when(plan, positions, seconds):
    """Return the times at which a plan that rises passes positions, by bisection."""
    low, high = np.zeros(len(positions)), np.full(len(positions), seconds)
    for _ in range(50):
        middle = (low + high) / 2
        below = plan.at(middle)[:, 0] < positions
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return low


def test_a_plan_in_portions_waits_for_each_and_gives_the_same_steps():
    plan, traces = swing(0.2, 400, 9000), []
    for portions in ([math.inf], [0.05, 0.0501, 0.15, math.inf]):
        driver = open_board("rapcores")
        player = play_on(driver, plan)
        player.prepare()
        for until in portions:
            player.play(until)
            if until < 1:
                at = player.start_cycle + until * CLOCK
                assert at <= driver.bus.now() <= at + 15_000  # a message
        traces.append(steps_of(driver.bus.twin, 2))
    for (cycles, counts), (others, same) in zip(*traces, strict=True):
        assert (cycles == others).all()
        assert (counts == same).all()


def test_the_buffer_is_full_most_of_the_time():
    driver = open_board("rapcores", depth=8)
    player = play_on(driver, swing(0.2, 400, 9000))
    player.prepare()
    for until in np.arange(0.0, 0.15, 0.01):
        player.play(until)
        assert driver.buffer().used >= 7


def test_a_plan_that_takes_long_to_make_is_made_while_the_old_one_goes_on():
    """Its board keeps 0.1 s of motion; a host that waited for the new plan would starve it."""
    twin = RapcoresTwin()
    bus = Paced(twin)
    driver, plan, asked = RapcoresDriver(bus), swing(1.5, 4000, 9000), []
    player = play_on(driver, plan)
    player.prepare()
    player.play(0.2)

    def replan(time):
        asked.append(time)
        patience = monotonic() + 20
        while len(asked) == 1 and bus.now() < player.start_cycle + 0.6 * CLOCK:
            assert monotonic() < patience, "the old plan does not go on"
            sleep(1e-3)
        return hold(plan, time, player.limits)[0]

    since = player.change(replan)
    assert len(asked) == 2  # the first time had passed when its plan was made
    assert asked[0] < 0.6 < since == asked[1]
    player.play(math.inf)
    assert player.trajectory.duration < plan.duration
    check_about(player, player.trajectory)


# ------------------------------------------------------------------------------ where things are


def test_a_second_job_starts_where_the_first_one_ended():
    driver = RapcoresDriver(Cable(RapcoresTwin("document")))
    for _ in range(2):
        before = driver.read_steps() if driver.running else np.zeros(4)
        plan = swing(0.1, 321.3, 4000)
        player = play_on(driver, plan)
        player.prepare()
        player.play(math.inf)
        moved = driver.read_steps() - before
        assert (abs(moved[:2] - plan.at(9.0)[0]) <= 0.5).all()


def test_a_plan_that_starts_between_steps_and_far_away():
    plan = swing(0.1, 300, 4000)
    poly = plan.poly.copy()
    poly[0, 0] += [5_000_000_000.4, -7.5]
    moved = Trajectory(
        poly, plan.cosine, plan.sine, plan.omega, plan.length, plan.move, plan.element, plan.start,
        plan.law,
    )  # fmt: skip
    driver = open_board("rapcores")
    player = play_on(driver, moved)
    player.prepare()
    player.play(math.inf)
    start, end = (np.floor(moved.at(t)[0] + 0.5) for t in (0.0, 9.0))
    assert driver.read_steps()[:2].tolist() == (end - start).tolist()


def test_a_link_without_pins_plays_the_same_motion():
    driver = RapcoresDriver(Cable(RapcoresTwin("document")))
    plan = swing(0.2, 400, 9000)
    player = play_on(driver, plan)
    player.prepare()
    player.play(math.inf)
    check_about(player, plan)


def test_telemetry_is_that_of_the_start_of_a_move_it_names():
    # encoder 0 counts 4 up in every 10 ms, from cycle 1000 on
    driver = open_board("rapcores")
    twin = driver.bus.twin
    for k in range(60):
        for phase, (pin, level) in enumerate(
            [("enc0_a", 1), ("enc0_b", 1), ("enc0_a", 0), ("enc0_b", 0)]
        ):
            twin.schedule(100_000 + 160_000 * k + 40_000 * phase, pin, level)
    plan = swing(0.2, 400, 9000)
    player = play_on(driver, plan)
    player.prepare()
    seen = set()
    for until in np.arange(0.01, 0.19, 0.007):
        player.play(until)
        told = player.told
        if told is None or told.move < 2:
            continue
        seen.add(told.move)
        # three clocks and half a tick later what the move does shows
        begin = player.start_cycle + told.time * CLOCK
        counted = (begin - 100_000) // 40_000 + 1
        assert abs(told.telemetry.positions[0] - counted) <= (begin % 40_000 < 100)
        planned = plan.at(told.time)[0]
        assert np.allclose(told.position, planned, atol=2e-3)
    assert len(seen) > 15


def test_following_error_is_commanded_minus_measured():
    codec = Codec(motors=2, encoders=2)
    reply = codec.to_bytes([0, 0, 400, 9, (1 << 64) - 100, 9])
    told = Told(3, 0.1, np.array([101.5, -24.0]), codec.telemetry(reply))
    assert told.following_error([4.0, 4.0]).tolist() == [1.5, 1.0]


# ------------------------------------------------------------------------------ what goes wrong


@pytest.mark.parametrize("depth", [2, 8])
def test_a_host_that_pauses_too_long_starves_the_board_and_resumes(depth):
    bus = Slow(RapcoresTwin("document", depth=depth))
    driver = RapcoresDriver(bus, depth=depth)
    plan = swing(1.5, 500, 9000)
    player = play_on(driver, plan)
    player.prepare()
    bus.pause = 0.2
    for _ in range(2):
        bus.pause_at = (bus.frames + 60,)
        with pytest.raises(StarvedError) as starved:
            player.play(math.inf)
        at, time = np.array(starved.value.position), starved.value.time
        assert 0 < time < player.trajectory.duration
        assert np.floor(at + 0.5).tolist() == driver.read_steps()[:2].tolist()
        assert np.allclose(at, player.trajectory.at(time)[0], atol=2e-3)
        assert driver.buffer().used == 0
        with pytest.raises(StarvedError):
            player.play(math.inf)
        with pytest.raises(PositionUnknownError, match="rapcores: the position is unknown"):
            player.resume()
        driver.reference()  # a motor of the twin loses no step
        player.resume()
    player.play(math.inf)
    assert driver.read_steps()[:2].tolist() == np.floor(plan.at(9.0)[0] + 0.5).tolist()
    with pytest.raises(UsageError, match="nothing to resume"):
        player.resume()


class Noisy(Cable):
    """A link on which noise makes all ones of the ticks left, in some of the answers."""

    asked, spoilt = 0, -1  # answers; noise begins at 0

    def transfer(self, data, cycle=-1):
        reply = super().transfer(data)
        codec, size = Codec(word_bits=64), 8
        question = codec.status_read(R_TICKS_LEFT) + codec.status_read(R_BUFFER_STATE)
        if self.spoilt < 0 or not data.endswith(question):
            return reply
        self.asked += 1
        if self.asked % 5:
            return reply
        self.spoilt += 1
        return reply[: -3 * size] + b"\xff" * size + reply[-2 * size :]

    def sleep(self, seconds):
        assert self.spoilt < 0 or seconds < 0.02, "longer than the longest move"
        super().sleep(seconds)


def test_noise_in_the_ticks_left_never_lets_the_host_wait_longer_than_a_move():
    bus = Noisy(RapcoresTwin("document", depth=16))
    driver = RapcoresDriver(bus, depth=16)
    plan = swing(0.3, 500, 9000)
    player = play_on(driver, plan)
    player.prepare()
    player.play(0.05)  # it waits behind a move of 0.2 s
    bus.spoilt = 0
    player.play(math.inf)
    assert player.done
    assert bus.spoilt > 10
    assert driver.read_steps()[:2].tolist() == np.floor(plan.at(9.0)[0] + 0.5).tolist()


def test_a_pause_just_within_the_buffer_starves_nobody():
    bus = Slow(RapcoresTwin("document", depth=32))
    driver = RapcoresDriver(bus, depth=32)
    player = play_on(driver, swing(0.3, 500, 9000))
    player.prepare()
    bus.pause_at, bus.pause = (bus.frames + 40,), 30 * player.update
    player.play(math.inf)
    assert player.done


@pytest.mark.parametrize("how", ["pin", "host"])
def test_a_halt_ends_the_job(how):
    driver = open_board("rapcores")
    player = play_on(driver, swing(0.3, 500, 9000))
    player.prepare()
    player.play(0.1)
    if how == "pin":
        driver.bus.twin.schedule(driver.bus.now() + 10, "halt", 0)
    else:
        driver.halt()
    with pytest.raises(EstopError):
        player.play(math.inf)
    assert not player.done


def test_motion_of_somebody_else_is_found_at_the_end():
    driver = open_board("rapcores", depth=16)
    player = play_on(driver, swing(0.1, 500, 5000))
    player.prepare()
    player.play(0.0999)  # all is sent
    driver.move(100, [1 << 62, 0, 0, 0])
    with pytest.raises(BusError, match=r"made \d+ moves and is at .* it was sent"):
        player.play(math.inf)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"pulse_width": 5e-3}, MotionLimitError, "pulse width of 0.005 s"),
        ({"rates": [3e5, 1.0]}, MotionLimitError, "300000 step/s asked"),
        ({"accelerations": [3e6, 1.0]}, MotionLimitError, r"3e\+06 step/s\^2 asked"),
    ],
)
def test_what_the_board_cannot_do_is_refused(changes, error, message):
    player = play_on(open_board("rapcores"), swing(0.1, 500, 5000), **changes)
    with pytest.raises(error, match=message):
        player.prepare()


def test_other_profiles_and_too_many_motors_are_refused():
    plan = swing(0.1, 500, 5000, motors=5)
    with pytest.raises(UsageError, match="profile 'upstream' cannot play"):
        play_on(open_board("rapcores", profile="upstream"), plan).prepare()
    with pytest.raises(MotionLimitError, match="the plan has 5 motors, the board has 4"):
        play_on(open_board("rapcores"), plan).prepare()
    with pytest.raises(RuntimeError, match="prepare"):
        play_on(open_board("rapcores"), plan).play(1.0)


def test_the_lead_gives_a_host_its_time():
    driver = open_board("rapcores")
    player = play_on(driver, swing(0.1, 500, 5000))
    player.prepare()
    assert player.start_cycle - driver.bus.now() > 0.9 * player_module.LEAD * CLOCK
