import numpy as np
import pytest

from pulsewright.edges.path import (
    MotorPins,
    StepCounter,
    numbered_pins,
    positions_at,
    require_pins,
    step_signs,
)
from pulsewright.edges.timing import DriveTiming, TimingMeter
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError

CLOCK = 40_000_000  # 25 ns
ONE = numbered_pins(1)


def pair(step, direction, *, start=0, end=1000, initial=(0, 0)):
    return EdgeTrace(
        CLOCK,
        ("step0", "dir0"),
        np.array(initial, np.uint8),
        (np.array(step, np.int64), np.array(direction, np.int64)),
        start,
        end,
    )


def cut(trace, at):
    """The trace as two chunks."""
    left = tuple(c[c < at] for c in trace.cycles)
    right = tuple(c[c >= at] for c in trace.cycles)
    first = EdgeTrace(trace.clock_hz, trace.pins, trace.initial, left, trace.start, at)
    return [first, EdgeTrace(trace.clock_hz, trace.pins, first.final(), right, at, trace.end)]


# Pulses rise at 100, 200, 300 and 400 and last 40; dir is 1 from 50 to 280, else 0.
RUN = pair([100, 140, 200, 240, 300, 340, 400, 440], [50, 280])


def test_dir_at_the_rising_edge_gives_the_sign():
    cycles, signs = step_signs(RUN, ONE[0])
    assert cycles.tolist() == [100, 200, 300, 400]
    assert signs.tolist() == [1, 1, -1, -1]


def test_active_low_steps_and_inverted_direction():
    motor = MotorPins("step0", "dir0", active=0, positive=0)
    cycles, signs = step_signs(RUN, motor)
    assert cycles.tolist() == [140, 240, 340, 440]
    assert signs.tolist() == [-1, -1, 1, 1]


def test_a_direction_change_in_the_cycle_of_the_edge_counts_with_the_new_level():
    assert step_signs(pair([100, 140], [100]), ONE[0])[1].tolist() == [1]


@pytest.mark.parametrize("at", [60, 100, 120, 250, 290, 999])
def test_counts_are_the_same_in_chunks(at):
    counter = StepCounter(ONE, np.array([7]))
    parts = [counter.feed(chunk)[0] for chunk in cut(RUN, at)]
    assert np.concatenate([p[0] for p in parts]).tolist() == [100, 200, 300, 400]
    assert np.concatenate([p[1] for p in parts]).tolist() == [8, 9, 8, 7]
    assert counter.counts.tolist() == [7]


def test_positions_between_edges():
    at = np.array([0, 99, 100, 250, 399, 400])
    assert positions_at(RUN, ONE, at)[:, 0].tolist() == [0, 0, 1, 2, 1, 0]


def test_missing_and_doubled_pins_are_named():
    with pytest.raises(UsageError, match="no pin dir1, step1; it has step0, dir0"):
        StepCounter(numbered_pins(2)).feed(RUN)
    with pytest.raises(UsageError, match="pin dir0 is given to more than one"):
        require_pins(RUN, [MotorPins("step0", "dir0"), MotorPins("dir0", "dir0")])


@pytest.mark.parametrize("at", [1, 60, 110, 141, 240, 279, 281, 299, 330, 441, 999])
def test_shortest_times_of_a_reversal(at):
    meter = TimingMeter(CLOCK, ONE, [DriveTiming()])
    for chunk in cut(RUN, at):
        meter.feed(chunk)
    found = {r.kind: (round(r.measured * CLOCK), r.cycle) for r in meter.results()}
    assert found == {
        "width": (40, 140),
        "space": (60, 200),
        "setup": (20, 300),  # dir falls at 280
        "hold": (80, 280),  # after the edge at 200
        "hold_trailing": (40, 280),  # after the pulse that ends at 240
    }
    assert meter.violations() == []


def test_times_at_the_limit_pass_and_one_cycle_less_fails():
    exact = DriveTiming(width=1e-6, space=1.5e-6, setup=0.5e-6, hold=2e-6, hold_trailing=1e-6)
    meter = TimingMeter(CLOCK, ONE, [exact])
    meter.feed(RUN)
    assert meter.violations() == []
    for kind in ("width", "space", "setup", "hold", "hold_trailing"):
        meter = TimingMeter(CLOCK, ONE, [DriveTiming(**{kind: getattr(exact, kind) + 1e-9})])
        meter.feed(RUN)
        [violation] = meter.violations()
        assert violation.kind == kind
        assert violation.required == getattr(exact, kind) + 1e-9
        assert violation.measured == getattr(exact, kind)
    assert violation.violations == 1


def test_every_violation_is_counted():
    meter = TimingMeter(CLOCK, ONE, [DriveTiming(width=1.1e-6)])
    meter.feed(RUN)
    assert [(v.kind, v.violations, v.cycle) for v in meter.violations()] == [("width", 4, 140)]


@pytest.mark.parametrize("at", [110, 121, 130, 999])
def test_a_direction_change_inside_the_pulse_has_a_negative_trailing_hold(at):
    meter = TimingMeter(CLOCK, ONE, [DriveTiming(hold_trailing=1e-9)])
    for chunk in cut(pair([100, 140], [120, 125]), at):
        meter.feed(chunk)
    found = {r.kind: r.measured for r in meter.results()}
    assert found["hold"] * CLOCK == 20
    assert found["hold_trailing"] * CLOCK == -20
    assert found["space"] is None  # one pulse has none
    assert [v.kind for v in meter.violations()] == ["hold_trailing"]


def test_a_change_with_the_step_edge_has_no_setup():
    meter = TimingMeter(CLOCK, ONE, [DriveTiming(setup=1e-9)])
    meter.feed(pair([100, 140], [100]))
    assert [(v.kind, v.measured, v.cycle) for v in meter.violations()] == [("setup", 0.0, 100)]


def test_one_demand_per_motor():
    with pytest.raises(UsageError, match="2 motors need as many drive timings, not 1"):
        TimingMeter(CLOCK, numbered_pins(2), [DriveTiming()])
