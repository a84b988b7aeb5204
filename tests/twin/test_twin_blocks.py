"""Shared blocks of the twins, on numbers worked out by hand."""

from itertools import pairwise

import numpy as np
import pytest

from pulsewright.edges.trace import concatenate
from pulsewright.twin import clock, epp, quadrature, step_pulse, step_rate
from pulsewright.twin.inputs import merged
from pulsewright.twin.recorder import FIRST_ROOM, Recorder, drive, pulses, toggle


def test_ticks_are_counted_through_a_cycle():
    assert [clock.ticks_through(cycle, 100, 4) for cycle in (0, 99, 100, 103, 104)] == [
        *(0, 0, 1, 1, 2)
    ]
    assert clock.tick_cycle(3, 100, 4) == 112


def test_quadrature_counts_four_per_line_and_ignores_double_transitions():
    walk = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)]
    steps = list(pairwise(walk))
    assert [quadrature.count(*a, *b) for a, b in steps] == [1, 1, 1, 1]
    assert [quadrature.count(*b, *a) for a, b in steps] == [-1, -1, -1, -1]
    assert quadrature.count(0, 0, 1, 1) == quadrature.count(1, 0, 0, 1) == 0
    assert quadrature.count(1, 0, 1, 0) == 0


def test_strobe_pipeline_acts_at_the_third_edge_and_acknowledges_two_later():
    """Strobe sampled active at edges 0..4: action at 2, acknowledge after 4, release after 9."""
    stages, acting, acknowledged = 0, [], []
    for edge in range(12):
        strobe = int(edge < 5)
        if epp.acts(stages):
            acting.append(edge)
        stages = epp.shift(stages, strobe)
        if epp.acknowledges(stages):
            acknowledged.append(edge)
    assert acting == [2]
    assert acknowledged == [4, 5, 6, 7, 8]
    assert epp.settled(stages, 0)
    assert not epp.settled(stages, 1)
    assert epp.settled(0b11111, 1)


def test_a_step_is_due_at_the_last_tick_of_its_period():
    assert step_rate.due_tick(0, 50, 10) == 59
    assert step_rate.due_tick(4, 50, 10) == 55
    assert step_rate.due_tick(20, 50, 10) == 50  # beyond a new, shorter period


def test_the_counter_holds_when_it_is_due_and_clears_when_halted():
    assert step_rate.count_before(55, 0, 50, 10, True) == 5
    assert step_rate.count_before(80, 0, 50, 10, True) == 9
    assert step_rate.count_before(80, 20, 50, 10, True) == 20
    assert step_rate.count_before(50, 20, 50, 10, False) == 20
    assert step_rate.count_before(51, 20, 50, 10, False) == 0


class Axis:
    """One axis at one cycle per tick."""

    def __init__(self):
        self.recorder = Recorder(("step", "dir"), 1_000_000)
        self.axes = np.zeros(1, step_pulse.STEP_AXIS)

    def advance(self, end, period, direction=0, width=2, space=1, setup=3, active=True):
        return step_pulse.advance(
            *(self.axes[0], end, active, direction, period, width, space, setup, False),
            *((0, 1), self.recorder.rows, (0, 1)),
        )

    def trace(self, end):
        return self.recorder.drain(end)


def test_pulse_train():
    axis = Axis()
    assert axis.advance(35, 10)
    assert axis.trace(35)["step"].tolist() == [9, 11, 19, 21, 29, 31]
    assert axis.axes["position"][0] == -3
    assert axis.axes["count"][0] == 5


def test_pulses_never_merge():
    """Period 2 is shorter than width 2 + space 1: one pulse every 3 ticks."""
    axis = Axis()
    axis.advance(10, 2)
    assert axis.trace(10)["step"].tolist() == [1, 3, 4, 6, 7, 9]


def test_direction_waits_for_setup_after_the_pulse_and_the_next_pulse_after_it():
    axis = Axis()
    axis.advance(10, 10)  # pulse at 9 .. 11
    axis.advance(40, 10, direction=1)
    trace = axis.trace(40)
    assert trace["dir"].tolist() == [14]
    assert trace["step"].tolist() == [9, 11, 19, 21, 29, 31, 39]
    assert axis.axes["position"][0] == 2
    assert axis.axes["pulses"][0] == 4


def test_direction_waits_for_setup_after_a_train_of_pulses():
    axis = Axis()
    axis.advance(32, 10)  # the last pulse, 29 .. 31, is over
    axis.advance(50, 10, direction=1)
    trace = axis.trace(50)
    assert trace["dir"].tolist() == [34]
    assert trace["step"].tolist()[4:] == [29, 31, 39, 41, 49]


def test_a_due_pulse_waits_for_the_direction():
    axis = Axis()
    axis.advance(10, 10)
    axis.advance(20, 3, direction=1)  # due at 12, direction at 14, pulse at 17
    assert axis.trace(20)["step"].tolist() == [9, 11, 17, 19]


def test_a_full_buffer_stops_an_axis_and_growing_lets_it_go_on():
    axis = Axis()
    end = 20 * FIRST_ROOM
    calls = 1
    while not axis.advance(end, 4):
        axis.recorder.grow()
        calls += 1
    assert calls > 3
    edges = axis.trace(end)["step"]
    assert np.array_equal(edges[::2], np.arange(3, end, 4))
    assert np.array_equal(edges[1::2], np.arange(5, end, 4))


@pytest.fixture
def recorder():
    return Recorder(("a", "b"), 1_000_000, ("b",))


def test_recorder_returns_changes_before_the_end_and_keeps_the_rest(recorder):
    toggle(recorder.rows, 0, 5)
    drive(recorder.rows, 1, 1, 6)  # is high
    drive(recorder.rows, 1, 0, 7)
    first = recorder.drain(7)
    toggle(recorder.rows, 0, 7)
    second = recorder.drain(8)
    assert [c.tolist() for c in first.cycles] == [[5], []]
    assert [c.tolist() for c in second.cycles] == [[7], [7]]
    assert first.initial.tolist() == [0, 1]
    assert concatenate([first, second]).final().tolist() == [0, 0]


def test_recorder_drops_a_change_that_is_taken_back_in_its_cycle(recorder):
    toggle(recorder.rows, 0, 5)
    assert recorder.drain(5)["a"].tolist() == []
    toggle(recorder.rows, 0, 5)
    toggle(recorder.rows, 1, 5)
    trace = recorder.drain(6)
    assert trace["a"].tolist() == []
    assert trace["b"].tolist() == [5]


def test_recorder_without_copy_looks_into_the_buffers(recorder):
    pulses(recorder.rows, 0, 10, 100, 3, 2)
    trace = recorder.drain(200, copy=False)
    assert trace["a"].tolist() == [10, 13, 110, 113]
    assert np.shares_memory(trace["a"], recorder.rows.cycles)
    pulses(recorder.rows, 0, 210, 100, 3, 2)
    assert recorder.drain(400)["a"].tolist() == [210, 213, 310, 313]


@pytest.mark.parametrize(
    ("queue", "events", "expected"),
    [
        ([], [[5, 1, 1], [5, 2, 0], [9, 1, 0]], [[5, 1, 1], [5, 2, 0], [9, 1, 0]]),
        ([[4, 3, 1]], [[5, 1, 1], [6, 0, 0]], [[4, 3, 1], [5, 1, 1], [6, 0, 0]]),
        # the same cycle as the end of the queue, and before it
        ([[5, 3, 1]], [[5, 1, 1], [6, 0, 0]], [[5, 1, 1], [5, 3, 1], [6, 0, 0]]),
        ([[7, 3, 1]], [[5, 1, 1]], [[5, 1, 1], [7, 3, 1]]),
        # out of order by pin, by cycle; the last of several changes of a pin in a cycle
        ([], [[5, 2, 1], [5, 1, 1]], [[5, 1, 1], [5, 2, 1]]),
        ([], [[6, 1, 1], [5, 2, 1]], [[5, 2, 1], [6, 1, 1]]),
        ([[3, 0, 1]], [[5, 1, 1], [5, 1, 0]], [[3, 0, 1], [5, 1, 0]]),
    ],
)
def test_changes_of_inputs_are_merged_in_order(queue, events, expected):
    rows = [np.array(part, np.int64).reshape(-1, 3) for part in (queue, events)]
    assert merged(*rows).tolist() == expected
