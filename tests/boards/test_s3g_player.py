"""Plans played on the s3g twin: through a memory that wraps, on bad links, and after starving."""

import math
import random

import numpy as np
import pytest

from pulsewright import open_board
from pulsewright.boards.playing import Drives
from pulsewright.boards.s3g import player as player_module
from pulsewright.boards.s3g.driver import S3GDriver
from pulsewright.boards.s3g.player import S3GPlayer
from pulsewright.boards.s3g.twin import S3GTwin
from pulsewright.edges.path import StepCounter, numbered_pins
from pulsewright.edges.timing import DriveTiming
from pulsewright.errors import BusError, EstopError, MotionLimitError, StarvedError, UsageError
from pulsewright.motion.trajectory import Trajectory
from pulsewright.transport.serial_bus import VirtualSerialBus

CLOCK = 50_000_000
U = 65536  # units of a step
DEVIATION = 0.6


def swing(seconds, amplitude, rate, motors=2):
    """Return motors on circles from rest to rest, up to ``rate`` [step/s]."""
    poly, cosine, sine = np.zeros((1, 4, motors)), np.zeros((1, motors)), np.zeros((1, motors))
    way = rate * seconds / 1.5
    poly[0, 0, ::2] = amplitude
    cosine[0, ::2], sine[0, 1::2] = -amplitude, amplitude
    zero, law = np.zeros(1, np.int32), np.array([[0.0, 0.0, 3 / seconds**2, -2 / seconds**3]]) * way
    omega, length = np.array([1 / amplitude]), np.array([way])
    return Trajectory(poly, cosine, sine, omega, length, zero, zero, np.array([0.0, seconds]), law)


class Rough(VirtualSerialBus):
    """A link to a twin with a host that pauses, and with bits that flip and bytes that get lost."""

    def __init__(self, twin, seed=1):
        super().__init__(twin)
        self.random, self.spoilt = random.Random(seed), 0
        self.pauses = self.damage = 0.0  # how often

    def write(self, data):
        if self.random.random() < self.pauses:
            self.sleep(self.random.random() * 0.06)
        super().write(self._damaged(data))

    def read(self, *args, **options):
        return self._damaged(super().read(*args, **options))

    def _damaged(self, data):
        if not data or self.random.random() >= self.damage:
            return data
        self.spoilt += 1
        data, place = bytearray(data), self.random.randrange(len(data))
        if self.random.random() < 0.5:
            del data[place]
        else:
            data[place] ^= 1 << self.random.randrange(8)
        return bytes(data)


def play_on(driver, plan, **changes):
    most = {"rates": 20_000.0, "accelerations": 160_000.0, "jerks": 6.4e6}
    motors = {name: [value] * plan.axes for name, value in most.items()}
    width = changes.pop("pulse_width", 2.5e-6)
    timing = DriveTiming(width=width, space=2.5e-6, setup=5e-6, hold=5e-6)
    return S3GPlayer(driver, plan, Drives(**motors | changes, timing=timing))


def rough(plan, *, profile="exact", seed=1, **options):
    bus = Rough(S3GTwin(profile, channels=max(plan.axes, 2), **options), seed)
    driver = S3GDriver(bus, profile=profile, channels=max(plan.axes, 2), **options)
    return play_on(driver, plan), bus


def positions(bus):
    """Return the low halves of the twin's positions, signed [unit]."""
    return [(x + (1 << 31)) % (1 << 32) - (1 << 31) for x in bus.twin.state()["x"]]


def complete(player, bus):
    """Play to the end, resuming as often as needed; return how often that was."""
    starved = 0
    while True:
        try:
            player.play(math.inf)
        except StarvedError as error:
            starved += 1
            state = bus.twin.state()
            assert state["v"] == state["sv"] == [0] * len(state["v"])
            told = [(p + 0.5) * U for p in error.position]
            assert positions(bus)[: len(told)] == told
            assert starved < 60
            player.resume()
        else:
            return starved


def check_end(player, bus, plan):
    """Check that no step is wrong at the end."""
    state, end = bus.twin.state(), plan.at(math.inf)[0]
    assert player.done
    assert state["lost"] == [0] * len(state["lost"])
    assert (state["asg"], state["v"]) == ("idle", [0] * len(state["v"]))
    assert (abs(np.array(state["position"][: plan.axes]) - end) <= 0.5).all()


def largest_distance(trace, plan, start_cycle, motors):
    """Return how far a count is from the plan at most, just before or after a step [step]."""
    worst = 0.0
    pins = numbered_pins(motors, 1, "mot{}_step", "mot{}_dir")
    for i, (cycles, counts) in enumerate(StepCounter(pins).feed(trace)):
        crossed = (counts + np.concatenate([[0], counts[:-1]])) / 2
        planned = plan.at((cycles - start_cycle) / CLOCK)[:, i]
        worst = max(worst, float(abs(crossed - planned).max()))
    return worst


# ------------------------------------------------------------------------------ the model


@pytest.mark.parametrize(("profile", "motors"), [("exact", 1), ("robust", 3), ("exact", 6)])
def test_positions_are_those_of_the_model_at_every_load(profile, motors):
    plan = swing(0.4, 60, 4000, motors=motors)
    driver = open_board("s3g", profile=profile, channels=max(motors, 2))
    player = play_on(driver, plan)
    player.prepare()
    twin, grid = driver.bus.twin, round(player.update * CLOCK)
    converter = player._job.converter
    # the same conversion once more, from the start
    copy = type(converter)(plan, driver.timing, grid=grid)
    loads = copy.convert(10**9)
    border = player.start_cycle - driver.timing.pre  # cycle of time 0, see the conversion
    assert twin.now < border
    for n, velocity, position in zip(
        loads.steps.tolist(), loads.velocity.tolist(), loads.position.tolist(), strict=True
    ):
        twin.advance(border)  # the first cycle in which the load shows is over
        state = twin.state()
        assert state["v"][:motors] == velocity
        border += n * grid
        if border - 1 < twin.now + grid // 2:
            continue
        twin.advance(border - 1)
        assert positions(driver.bus)[:motors] == position
    player.play(math.inf)
    check_end(player, driver.bus, plan)


def test_steps_are_at_their_time():
    plan = swing(1.0, 500, 15_000)
    driver = open_board("s3g")
    player = play_on(driver, plan)
    player.prepare()
    prepared = driver.bus.twin.drain()
    assert len(prepared["mot0_step"]) == 0
    player.play(math.inf)
    trace = driver.bus.twin.drain()
    grid = player.update * CLOCK
    # rounding to whole units, what the plan bends in a grid step, and a clock
    bound = grid / 2 / U + 90_000 * player.update**2 / 8 + 0.01
    assert bound < 0.35
    assert largest_distance(trace, plan, player.start_cycle, 2) <= bound
    check_end(player, driver.bus, plan)
    assert driver.bus.now() / CLOCK < player.start_cycle / CLOCK + 1.05


def test_play_returns_at_its_time_and_keeps_the_memory_full():
    plan = swing(6.0, 500, 8000)
    driver = open_board("s3g")
    player = play_on(driver, plan)
    player.prepare()
    for until in (0.0, 0.1, 0.1234, 2.5, 2.5001, 4.0):
        player.play(until)
        late = driver.bus.now() - player.start_cycle - until * CLOCK
        assert 0 <= late <= 0.001 * CLOCK
        assert not player.done
    driver.write_output(3, True)
    player.play(5.0)
    driver.bus.sleep(0.7)  # the board goes on by itself
    player.play(math.inf)
    check_end(player, driver.bus, plan)
    assert driver.bus.twin.state()["outputs"][0] == 8


def test_a_job_of_more_words_than_the_counter_has_goes_through_a_small_memory():
    plan = swing(17.0, 3000, 12_000)
    player, bus = rough(plan, prog_words=512)
    player.prepare()
    player.play(math.inf)
    assert player._job.ring.tail > 1 << 16
    check_end(player, bus, plan)
    assert largest_distance(bus.twin.drain(), plan, player.start_cycle, 2) <= DEVIATION


def test_even_a_tiny_memory_does_a_slow_job():
    plan = swing(0.5, 5, 60, motors=1)
    player, bus = rough(plan, prog_words=64)
    player.prepare()
    complete(player, bus)
    check_end(player, bus, plan)


def test_channels_that_a_job_does_not_move_rest():
    plan = swing(0.3, 20, 500, motors=1)
    driver = open_board("s3g", channels=3)
    player = play_on(driver, plan)
    player.prepare()
    player.play(math.inf)
    check_end(player, driver.bus, plan)
    assert driver.bus.twin.state()["pulses"][1:] == [0, 0]


def test_one_board_plays_one_plan_after_another():
    driver = open_board("s3g")
    for plan in (swing(0.3, 20, 500), swing(0.2, 3, 100)):
        before = driver.bus.twin.state()["position"]
        player = play_on(driver, plan)
        player.prepare()
        player.play(math.inf)
        made = np.subtract(driver.bus.twin.state()["position"], before)
        assert (abs(made - plan.at(math.inf)[0]) <= 0.5).all()


# ------------------------------------------------------------------------------ bad links


@pytest.mark.parametrize("profile", ["exact", "robust"])
def test_a_link_that_damages_bytes_costs_retries_and_no_step(profile):
    plan = swing(4.0, 500, 8000)
    player, bus = rough(plan, profile=profile, seed=4)
    bus.damage = 0.02
    player.prepare()
    complete(player, bus)
    assert player.driver.retried > 10
    assert bus.spoilt >= player.driver.retried
    check_end(player, bus, plan)


@pytest.mark.parametrize("seed", range(3))
def test_a_host_that_is_often_late_never_makes_the_board_run_old_words(seed):
    # 256 words are 40 ms; new words often come as the executor is about to end
    plan = swing(1.5, 300, 3000)
    player, bus = rough(plan, seed=seed, prog_words=256)
    player.prepare()
    bus.pauses = 0.03
    assert complete(player, bus) > 2
    check_end(player, bus, plan)


def test_words_that_end_the_executor_in_the_last_moment_are_replaced_in_two_packets():
    plan = swing(1.0, 300, 3000)
    player, bus = rough(plan, prog_words=512)
    player.prepare()
    ring, sizes = player._job.ring, []
    request = player.driver.request

    def counting(command, **values):
        if command == "WRITE_BUFFER":
            sizes.append(values["count"])
        return request(command, **values)

    player.driver.request = counting
    player.play(0.1)
    assert 1 not in sizes
    first = len(sizes)
    left = ring.cycles_to(ring.tail)
    bus.sleep((left - 2 * player._packet) / CLOCK)  # two packets' time before the end
    player.play(0.3)
    assert sizes[first + 1] == 1
    player.play(math.inf)
    check_end(player, bus, plan)


def test_a_start_that_gets_no_answer_is_ended_and_repeated():
    plan = swing(0.3, 20, 500)
    player, bus = rough(plan)
    read, dropped = bus.read, []

    def losing(*args, **options):
        data = read(*args, **options)
        if bus.twin.state()["be"] >> 31 and not dropped:  # it runs: this is the answer
            dropped.append(data)
            return b""
        return data

    bus.read = losing
    player.prepare()
    assert dropped
    player.play(math.inf)
    check_end(player, bus, plan)
    assert largest_distance(bus.twin.drain(), plan, player.start_cycle, 2) <= DEVIATION


def test_a_dead_link_is_an_error_and_motion_stops():
    plan = swing(6.0, 500, 8000)
    player, bus = rough(plan)
    player.prepare()
    player.play(1.0)
    bus.damage = 1.0
    with pytest.raises(BusError):
        player.play(math.inf)
    bus.twin.advance(bus.now() + 5 * CLOCK)
    state = bus.twin.state()
    assert (state["asg"], state["v"], state["lost"]) == ("abort", [0, 0], [0, 0])


def test_an_executor_that_something_else_stops_is_an_error():
    plan = swing(3.0, 500, 8000)
    player, _ = rough(plan)
    player.prepare()
    player.play(0.5)
    player.driver.abort_program()
    with pytest.raises(BusError, match="ended at address 0 with code 0x82"):
        player.play(math.inf)


@pytest.mark.parametrize("until", [0.5, 2.9])
def test_an_executor_that_waits_for_ever_is_an_error(until):
    player, _ = rough(swing(3.0, 500, 8000))
    player.prepare()
    player.play(until)
    player.driver.write_register("W_ASG_CONTROL", steps_limit=1, dt_limit=1, reset_steps=1)
    player.driver.write_register("W_ASG_DT_VAL", value=0xFFFF_FFFF)
    player.driver.strobe(1)  # acceleration steps of 86 s: none is done
    with pytest.raises(BusError, match="executor stays at address"):
        player.play(math.inf)


# ------------------------------------------------------------------------------ starvation


def starved(plan, until=1.0, **options):
    """Play, stop refilling, and return player, link and error."""
    player, bus = rough(plan, **options)
    player.prepare()
    player.play(until)
    bus.twin.drain()
    bus.sleep(4.0)
    with pytest.raises(StarvedError, match="got no motion in time") as error:
        player.play(math.inf)
    return player, bus, error.value


@pytest.mark.parametrize("profile", ["exact", "robust"])
def test_a_starved_board_stops_on_a_ramp_and_the_place_is_known(profile):
    plan = swing(8.0, 2000, 15_000)
    player, bus, error = starved(plan, 2.0, profile=profile)
    state = bus.twin.state()
    assert positions(bus) == [(p + 0.5) * U for p in error.position]
    assert (state["asg"], state["lost"]) == ("abort", [0, 0])
    assert 2.0 < error.time < 5.0
    # on the plan as told, then a unit of velocity per 4.8 ms: all of 160 000 step/s^2
    trace = bus.twin.drain()
    pins = numbered_pins(2, 1, "mot{}_step", "mot{}_dir")
    for i, (cycles, _) in enumerate(StepCounter(pins).feed(trace)):
        after = cycles[cycles > player.start_cycle + error.time * CLOCK]
        speed = abs(plan.at(error.time, 1)[0, i])
        assert (after[-1] - after[0]) / CLOCK == pytest.approx(speed / 160_000, rel=0.1, abs=0.01)
        periods = np.diff(after)
        assert periods[-1] > 3 * periods[0]
        assert (np.diff(periods) >= -np.maximum(periods[:-1], 3000) * 0.6).all()
    assert isinstance(error, EstopError)
    with pytest.raises(StarvedError):  # until it is resumed
        player.play(math.inf)


@pytest.mark.parametrize("until", [0.02, 1.0, 6.0])
def test_a_starved_job_is_resumed_and_completed_with_every_step(until):
    plan = swing(8.0, 2000, 15_000)
    player, bus, error = starved(plan, until)
    counted = [round(p) for p in error.position]
    bus.twin.drain()
    told = positions(bus)
    rest = player.resume()
    assert positions(bus) == told  # the board is not told where it is: it goes on
    assert rest is player.trajectory
    assert rest.at(0.0)[0].tolist() == list(error.position)
    player.play(math.inf)
    check_end(player, bus, plan)
    # and on its way it follows what resume returned
    pins = numbered_pins(2, 1, "mot{}_step", "mot{}_dir")
    trace = bus.twin.drain()
    for i, (cycles, counts) in enumerate(StepCounter(pins, np.array(counted)).feed(trace)):
        own = cycles >= player.start_cycle
        crossed = (counts + np.concatenate([counted[i : i + 1], counts[:-1]])) / 2
        planned = rest.at((cycles[own] - player.start_cycle) / CLOCK)[:, i]
        assert abs(crossed[own] - planned).max() <= DEVIATION


def test_starving_while_the_plan_rests_stops_there():
    plan = swing(0.3, 20, 500)
    player, bus = rough(plan, prog_words=64)
    player.prepare()
    bus.sleep(1.0)  # only the first loads are in memory, and at rest
    with pytest.raises(StarvedError) as error:
        player.play(math.inf)
    assert error.value.time < 0.3
    player.resume()
    complete(player, bus)
    check_end(player, bus, plan)


def test_only_a_starved_job_can_be_resumed():
    player, _ = rough(swing(0.2, 20, 500))
    with pytest.raises(UsageError, match="nothing to resume"):
        player.resume()
    with pytest.raises(RuntimeError, match="prepare"):
        player.play(1.0)


# ------------------------------------------------------------------------------ limits


@pytest.mark.parametrize(
    ("motors", "changes", "message"),
    [
        (3, {}, "3 motors, the board has 2 channels"),
        (2, {"rates": [1e3, 2e5]}, "200000 step/s asked"),
        (2, {"accelerations": [1e3, 1e8]}, r"1e\+08 step/s\^2 asked"),
        (2, {"pulse_width": 1.0}, "width of 1e"),
    ],
)
def test_jobs_beyond_the_board_are_refused(motors, changes, message):
    driver = open_board("s3g")
    with pytest.raises(MotionLimitError, match=message):
        play_on(driver, swing(0.2, 20, 500, motors=motors), **changes).prepare()


def test_a_faster_link_has_a_finer_grid():
    plan = swing(0.1, 20, 500)
    updates = []
    for options in ({"baud1": 115_200}, {}, {"profile": "robust"}, {"baud1": 1_000_000}):
        try:
            player = play_on(open_board("s3g", **options), plan)
            player.prepare()
            updates.append(player.update)
        except MotionLimitError as error:
            assert "takes" in str(error)  # noqa: PT017
            updates.append(math.inf)
    assert updates == sorted(updates, reverse=True)
    # 5 words; 254 bytes out at 500 kbaud and 11 in at 115 200; 48 of 49 words are new; a tenth more
    expected = 5 * (2540 / 500e3 + 110 / 115.2e3) / 48 * 1.1
    assert updates[1] == pytest.approx(expected, rel=0.02)
    assert player_module.LEAD > 0.1
