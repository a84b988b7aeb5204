"""Plans left in their middle: rest within the limits on the path, and what is known of it then.

Everything is measured on the edges of the twin, with independent arithmetic: the position is the
steps counted, and between three instants h apart the second difference of a count that is within d
steps of motion that keeps an acceleration a is at most a h^2 + 4 d, the first one v h + 2 d.
"""

import math
import signal

import numpy as np
import pytest

from pulsewright import boards, open_board
from pulsewright.app.run import Job
from pulsewright.boards.playing import Drives
from pulsewright.edges.path import StepCounter, numbered_pins, positions_at
from pulsewright.edges.timing import DriveTiming
from pulsewright.errors import (
    BusError,
    EstopError,
    LateError,
    PositionUnknownError,
    UsageError,
)
from pulsewright.motion.hold import AxisLimits
from pulsewright.motion.rejoin import rejoin

ROOMS = list(boards.BOARDS)
TIMING = DriveTiming(width=2.5e-6, space=2.5e-6, setup=5e-6, hold=5e-6)
# steps that a count may be off the plan: half a step is unavoidable, and the velocities of the S3G
# are coarse: half a unit of 763 step/s over a grid step of 0.8 ms
D = 1.1
WINDOW = 0.012  # h: 4 d in it are a tenth of the acceleration limit [s]

each_room = pytest.mark.parametrize("name", ROOMS)


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    """Return corners, a curve, a dwell and traverses, on the built-in machine."""
    path = tmp_path_factory.mktemp("part") / "part.ngc"
    path.write_text(
        "G21 G90 G64 P0.05 F3000\nG1 X12 Y3\nG1 X14 Y12\nG3 X4 Y12 I-5\nG1 X2 Y2 Z-1\nG4 P0.5\n"
        "G0 X40 Y30 Z2\nG0 X0 Y0\nM2\n"
    )
    return Job.from_gcode(path)


class Run:
    """A job on a twin, with what its edges say."""

    def __init__(self, name, job, **options):
        machine, self.job = job.machine, job
        self.room, self.matrix = boards.get(name), machine.motor_matrix()
        options = self.room.parameters_for(len(self.matrix)) | options
        self.driver = open_board(name, options.pop("link", "twin:"), **options)
        self.rows, self.velocity, self.acceleration = machine.limit_rows()
        inverse = np.linalg.pinv(self.matrix)
        scale = abs(self.matrix @ np.linalg.pinv(self.rows))
        self.plan = job.trajectory.mapped(self.matrix)
        self.drives = Drives(
            (scale @ self.velocity).tolist(),
            (scale @ self.acceleration).tolist(),
            (scale @ machine.jerk_limits()).tolist(),
            TIMING,
            AxisLimits(self.rows @ inverse, self.acceleration, machine.jerk_limits()),
        )
        self.player = self.room.player(self.driver, self.plan, self.drives)
        self.pins = numbered_pins(
            len(self.matrix), self.room.positive_direction, *self.room.motor_pins
        )
        self.origin = np.floor(self.plan.at(0.0)[0] + 0.5).astype(np.int64)

    @property
    def twin(self):
        return self.driver.bus.twin

    def before_sends(self, number, action):
        """Do ``action`` as the host is about to send or wait for the ``number``-th time."""
        bus, calls = self.driver.bus, 0

        def counting(original):
            def counted(*arguments):
                nonlocal calls
                calls += 1
                if calls == number:
                    action()
                return original(*arguments)

            return counted

        for name in ("transact", "transfer", "write", "sleep"):
            if hasattr(bus, name):
                setattr(bus, name, counting(getattr(bus, name)))

    def fail_from_now(self):
        """Cut the cable."""

        def fail(*arguments, **options):
            raise BusError("the cable is cut")

        bus = self.driver.bus
        for name in ("transact", "transfer", "write", "read"):
            if hasattr(bus, name):
                setattr(bus, name, fail)

    def check_stopped(self, time):
        """Check that it has come to rest on its path, after ``time``, and that this is known."""
        trace, stop = self.trace(), self.driver.stopped_at
        assert stop.position == tuple(self.counted(trace))
        assert (abs(stop.position - self.plan.at(stop.time)[0]) <= D).all()
        assert time - 0.01 <= stop.time <= self.job.duration
        moved = self.check_limits(trace, time)
        assert moved > 0 or (self.plan.at(stop.time)[0] == self.plan.at(time)[0]).all()
        assert self.driver.position_known

    def trace(self):
        """Return the recording up to a millisecond from now."""
        if hasattr(self.twin, "advance"):
            self.twin.advance(
                max(self.driver.bus.now(), self.twin.now) + self.twin.clock_hz // 1000
            )
        else:
            self.driver.bus.read(0x0F, 1)
        return self.twin.drain()

    def counted(self, trace):
        """Return the steps counted at its end."""
        counter = StepCounter(self.pins, self.origin)
        counter.feed(trace)
        return counter.counts

    def check_limits(self, trace, since):
        """Check velocity and acceleration along every row from ``since`` [s] of the plan on.

        Returns the largest difference, to be sure that there was motion [mm].
        """
        clock, dt = trace.clock_hz, 0.0005
        end = (trace.end - 1 - self.player.start_cycle) / clock
        times = np.arange(since - 0.05, end, dt)
        cycles = (self.player.start_cycle + times * clock).astype(np.int64)
        motors = positions_at(trace, self.pins, np.clip(cycles, trace.start, None), self.origin)
        motors = np.concatenate([motors, np.repeat(motors[-1:], 100, axis=0)])  # it rests
        inverse = np.linalg.pinv(self.matrix)
        axes = motors @ inverse.T @ self.rows.T
        blur = D * abs(self.rows @ inverse).sum(axis=1)
        w = round(WINDOW / dt)
        h = w * dt
        speed = abs(axes[w:] - axes[:-w]).max(axis=0)
        assert (speed <= self.velocity * h + 2 * blur).all(), speed / h
        turn = abs(axes[2 * w :] - 2 * axes[w:-w] + axes[: -2 * w]).max(axis=0)
        assert (turn <= self.acceleration * h**2 + 4 * blur).all(), turn / h**2
        return float(turn.max())


def moments(job, count, seed):
    return np.random.default_rng(seed).uniform(0.05, job.duration - 0.05, count)


def fast(job):
    """Return a time at which the plan is fast."""
    times = np.arange(0.0, job.duration, 0.01)
    return float(times[np.linalg.norm(job.trajectory.at(times, 1), axis=1).argmax()])


def drive(run, time, *actions):
    """Play up to a time, and then do something more, in the driver's ``with`` block."""
    with run.driver:
        run.player.prepare()
        run.player.play(time)
        run.player._portion = 1  # as on a link in real time: signals are seen soon
        for action in actions:
            action()


# ------------------------------------------------------------------------------ on the ramp


@each_room
@pytest.mark.parametrize("k", range(5))
def test_a_plan_is_left_on_its_path_within_the_limits(name, job, k):
    time = moments(job, 5, seed=len(name))[k]
    run = Run(name, job)
    with run.driver as driver:
        run.player.prepare()
        run.player.play(time)
        stop = run.player.stop()
        assert driver.running
        assert driver.stopped_at == stop == run.player.stopped_at
        assert run.player.stop() is stop  # and a second time it does nothing
        with pytest.raises(UsageError, match=r"left at .* s; play a new one"):
            run.player.play(math.inf)
    assert not driver.running
    run.check_stopped(time)  # an emergency stop at rest loses nothing
    assert stop.time < time + 0.4


@each_room
@pytest.mark.parametrize(
    ("number", "error"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)]
)
def test_a_signal_in_mid_move_ends_on_the_ramp(name, job, number, error):
    run, time = Run(name, job), fast(job) - 0.1
    run_on = lambda: run.player.play(math.inf)  # noqa: E731
    with pytest.raises(error) as ended:
        drive(run, time, lambda: run.before_sends(1, lambda: signal.raise_signal(number)), run_on)
    assert not isinstance(ended.value, SystemExit) or ended.value.code == 143
    run.check_stopped(time)
    assert run.driver.stopped_at.time < time + 0.4  # and not at the end


@each_room
def test_an_error_of_the_caller_ends_on_the_ramp(name, job):
    run, time = Run(name, job), fast(job)
    with pytest.raises(ZeroDivisionError):
        drive(run, time, lambda: 1 / 0)
    run.check_stopped(time)


@each_room
def test_a_plan_that_was_left_is_rejoined_and_completed(name, job):
    run, time = Run(name, job), fast(job)
    with run.driver as driver:
        run.player.prepare()
        run.player.play(time)
        stop = run.player.stop()
        drives = run.drives
        rest = rejoin(
            run.plan,
            stop.time,
            stop.position,
            rates=drives.rates,
            accelerations=drives.accelerations,
            jerks=drives.jerks,
        )
        player = run.room.player(driver, rest, drives)
        player.prepare()
        player.play(math.inf)
        assert player.done
    counted = run.counted(run.trace())
    assert (abs(counted - run.plan.at(math.inf)[0]) <= 0.5).all()


@each_room
def test_a_plan_at_rest_is_left_where_it_is(name, job):
    run = Run(name, job)
    steps = job.trajectory.start
    dwell = steps[:-1][(np.diff(steps) > 0.49) & (abs(job.trajectory.law[:, 1:]).sum(axis=1) == 0)]
    with run.driver:
        run.player.prepare()
        run.player.play(float(dwell[0]) + 0.01)
        stop = run.player.stop()
    assert dwell[0] <= stop.time <= dwell[0] + 0.5
    assert stop.position == tuple(np.floor(run.plan.at(dwell[0])[0] + 0.5))
    run.check_stopped(float(dwell[0]))


@each_room
def test_a_plan_that_is_done_or_has_not_begun_is_not_left(name, job):
    run = Run(name, job)
    assert run.player.stop() is None
    run.player.prepare()
    run.player.play(math.inf)
    assert run.player.done
    assert run.player.stop() is None
    end = run.trace()
    assert (abs(run.counted(end) - run.plan.at(math.inf)[0]) <= 0.5).all()


@each_room
def test_a_plan_that_is_left_at_its_end_is_done(name, job):
    run = Run(name, job)
    run.player.prepare()
    run.player.play(job.duration - 1e-3)
    stop = run.player.stop()
    assert stop.time == pytest.approx(job.duration, abs=1e-3)
    assert stop.position == tuple(run.counted(run.trace()))


@pytest.mark.parametrize("options", [{"prog_words": 256}, {"profile": "robust"}])
def test_an_s3g_with_little_memory_and_one_with_a_fast_link_stop_soon(job, options):
    run, time = Run("s3g", job, **options), fast(job)
    with run.driver:
        run.player.prepare()
        run.player.play(time)
        stop = run.player.stop()
    run.check_stopped(time)
    assert stop.time < time + 0.25


# ------------------------------------------------------------------------------ at once


@each_room
def test_an_emergency_stop_in_mid_move_is_at_once_and_the_position_unknown(name, job):
    run, time = Run(name, job), fast(job)
    run.player.prepare()
    run.player.play(time)
    run.twin.drain()
    before = run.driver.bus.now()
    run.driver.estop()
    assert not run.driver.position_known
    steps = run.trace().edges(run.pins[0].step, 1)
    # the S3G takes nine requests of 0.4 ms
    assert not (steps > before + 4e-3 * run.twin.clock_hz).any()
    assert run.player.stop() is None
    player = run.room.player(run.driver, run.plan, run.drives)
    with pytest.raises(PositionUnknownError, match=rf"{name}: .*reference\(\)"):
        player.prepare()
    run.driver.reference()
    player.prepare()
    player.play(0.2)
    assert run.driver.position_known


@each_room
def test_motors_that_can_stop_at_once_lose_nothing_in_an_emergency_stop(name, job):
    run = Run(name, job)
    run.driver.start_stop_rate = 1e6
    run.player.prepare()
    run.player.play(fast(job))
    run.driver.estop()
    assert run.driver.position_known


@each_room
def test_a_second_signal_stops_at_once(name, job):
    run = Run(name, job)
    again = lambda: signal.raise_signal(signal.SIGINT)  # noqa: E731
    with pytest.raises(KeyboardInterrupt):
        drive(run, fast(job), lambda: run.before_sends(3, again))  # on the ramp already
    assert run.driver.stopped_at is None
    assert not run.driver.position_known


@each_room
def test_a_link_that_fails_in_mid_move_leaves_the_position_unknown(name, job):
    run = Run(name, job)
    with pytest.raises(BusError, match="cable is cut") as cut:
        drive(
            run,
            fast(job),
            lambda: run.before_sends(3, run.fail_from_now),
            lambda: run.player.play(math.inf),
        )
    assert "could not be told to stop: " in cut.value.__notes__[-1]  # of the first error
    assert not run.driver.position_known
    assert run.driver.stopped_at is None


@pytest.mark.parametrize("name", ["usc", "pluto_step"])
def test_a_host_that_was_late_still_ends_on_a_ramp(name, job):
    run, time = Run(name, job), fast(job)

    def wait():
        later = run.driver.bus.now() + 2 * run.player.converter.update_cycles
        while run.driver.bus.now() < later:
            run.driver.feed_watchdog()

    with pytest.raises(LateError) as late:
        drive(run, time, wait, lambda: run.player.play(math.inf))
    assert not hasattr(late.value, "__notes__")  # of a ramp that failed
    assert not run.driver.position_known
    assert run.driver.stopped_at.time > time
    trace = run.trace()
    axis = int(abs(run.plan.at(time, 1)[0]).argmax())
    steps = trace.edges(run.pins[axis].step, 1)
    left = np.diff(steps[steps > run.player.start_cycle + time * trace.clock_hz])
    assert left[-1] > 5 * left[0]  # slower and slower


@pytest.mark.parametrize("name", ["usc", "rapcores"])
def test_a_board_that_stops_by_itself_in_mid_move_is_somewhere_unknown(name, job):
    run = Run(name, job)
    run.player.prepare()
    run.player.play(fast(job))
    if name == "usc":
        run.twin.set_estop_chain(False)
    else:
        run.twin.schedule(run.twin.now + 10, "halt", 0)
    with pytest.raises(EstopError):
        run.player.play(math.inf)
    assert not run.driver.position_known


# ------------------------------------------------------------------------------ without a plan


@pytest.mark.parametrize("name", ["usc", "pluto_step", "s3g"])
@pytest.mark.parametrize("how", ["estop", "stop", "initialise"])
def test_step_rates_that_end_at_once_leave_the_position_unknown(name, how):
    driver = open_board(name)
    driver.initialise()
    driver.release_estop()
    rate = abs(driver.set_step_rate(1, 5000.0))
    driver.start_stop_rate = rate
    getattr(driver, how)()
    assert driver.position_known
    driver.initialise()
    driver.release_estop()
    driver.start_stop_rate = rate - 1
    driver.set_step_rate(1, -rate)
    getattr(driver, how)()
    assert not driver.position_known
    driver.release_estop()
    driver.set_step_rate(0, 1000.0)  # referencing needs motion


@pytest.mark.parametrize("how", ["estop", "halt", "initialise"])
def test_moves_that_end_at_once_leave_the_position_unknown(how):
    driver = open_board("rapcores")
    driver.initialise()
    driver.release_estop()
    driver.move(100_000, [driver.increment(-2000.0), 0, 0, 0])
    driver.start_stop_rate = 2001.0
    getattr(driver, how)()
    assert driver.position_known
    driver.release_estop()
    driver.move(1_000, [driver.increment(2500.0), 0, 0, 0])
    driver.wait_idle()
    getattr(driver, how)()
    assert driver.position_known  # nothing moved any more
    driver.release_estop()
    driver.move(100_000, [driver.increment(2500.0), 0, 0, 0])
    getattr(driver, how)()
    assert not driver.position_known


def test_the_watchdog_of_a_usc_leaves_the_position_unknown():
    driver = open_board("usc")
    driver.initialise()
    driver.release_estop()
    driver.set_step_rates([1000.0, 0.0, 0.0, 0.0])
    for _ in range(3000):  # 4 us each
        driver.read_inputs()
    with pytest.raises(EstopError, match="watchdog"):
        driver.check_running()
    assert not driver.position_known


# ------------------------------------------------------------------------------ on gateware


@pytest.mark.rtl
@pytest.mark.campaign
@pytest.mark.parametrize("name", ["pluto_step", "rapcores", "usc"])  # the s3g's takes minutes
def test_gateware_stops_as_its_twin_does(name, tmp_path):
    path = tmp_path / "part.ngc"
    path.write_text("G1 X2 Y-1 F1800\nG3 X0 Y0 R1.5\n")
    job, runs = Job.from_gcode(path), []
    for link in ("twin:", "rtl:"):
        run = Run(name, job, link=link)
        with run.driver:
            run.player.prepare()
            run.player.play(0.06)
            run.player.stop()
        trace = run.trace()
        assert run.driver.stopped_at.position == tuple(run.counted(trace))
        assert run.check_limits(trace, 0.06) > 0
        runs.append((run.driver.stopped_at, [trace.edges(pins.step, 1) for pins in run.pins]))
    (stop, edges), (stop_rtl, edges_rtl) = runs
    assert stop == stop_rtl
    assert 0.06 < stop.time < job.duration - 0.01
    for one, other in zip(edges, edges_rtl, strict=True):
        assert one.tolist() == other.tolist()
