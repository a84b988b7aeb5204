"""Plans left in their middle: rest within the limits on the path, and what is known of it then.

Everything is measured on the edges of the twin, with independent arithmetic: the position is the
steps counted, and between three instants h apart the second difference of a count that is within d
steps of motion that keeps an acceleration a is at most a h^2 + 4 d, the first one v h + 2 d.
"""

import math
import os
import signal

import numpy as np
import pytest

from pulsewright import boards, open_board
from pulsewright.app.run import Job
from pulsewright.boards.playing import Drives
from pulsewright.edges.path import StepCounter, numbered_pins, positions_at
from pulsewright.edges.timing import DriveTiming
from pulsewright.errors import BusError, EstopError, PositionUnknownError, UsageError
from pulsewright.motion.hold import AxisLimits
from pulsewright.motion.machine import Machine

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
        "G21 G90 G64 P0.05 F3000\nG1 X12 Y3\nG1 X14 Y12\nG3 X4 Y12 I-5\nG1 X2 Y2 Z-1\nG4 P0.1\n"
        "G0 X40 Y30 Z2\nG0 X0 Y0\nM2\n"
    )
    return Job.from_gcode(path)


class Run:
    """A job on a twin, with what its edges say."""

    def __init__(self, name, job, **options):
        machine = job.machine
        self.room, self.matrix = boards.get(name), machine.motor_matrix()
        options = self.room.parameters_for(len(self.matrix)) | options
        self.driver = open_board(name, **options)
        self.rows, self.velocity, self.acceleration = machine.limit_rows()
        inverse = np.linalg.pinv(self.matrix)
        scale = abs(self.matrix @ np.linalg.pinv(self.rows))
        self.plan = job.trajectory.mapped(self.matrix)
        drives = Drives(
            (scale @ self.velocity).tolist(),
            (scale @ self.acceleration).tolist(),
            TIMING,
            AxisLimits(self.rows @ inverse, self.acceleration, machine.jerk_limits()),
        )
        self.player = self.room.player(self.driver, self.plan, drives)
        self.pins = numbered_pins(
            len(self.matrix), self.room.positive_direction, *self.room.motor_pins
        )
        self.origin = np.floor(self.plan.at(0.0)[0] + 0.5).astype(np.int64)

    @property
    def twin(self):
        return self.driver.bus.twin

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
        """Check velocity and acceleration along every row from ``since`` [s] of the plan on."""
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
        assert turn.max() > 0  # it moved


def moments(job, count, seed):
    return np.random.default_rng(seed).uniform(0.05, job.duration - 0.05, count)


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
        trace = run.trace()
        assert not driver.bus.twin.drain().cycles[0].size  # it rests
        assert stop.position == tuple(run.counted(trace))
        # on the path: as near to the plan where it says as a count can be
        assert (abs(stop.position - run.plan.at(stop.time)[0]) <= D).all()
        assert time - 0.01 <= stop.time <= job.duration
        run.check_limits(trace, time)
        assert driver.position_known
        assert driver.stopped_at == stop
    assert not driver.running
    assert driver.position_known  # an emergency stop at rest loses nothing
