"""The step generator of pluto_step: what a drive may rely on, for every input sequence.

Three links make the chain: the serial timer keeps its promise; the gateware with that promise in
its place does what the table of the specification says, at every clock edge; and the table keeps
the pins safe. The first two are proved with ticks at any distance, the last tick by tick.
"""

import pytest
from formal_harness import mutant, prove, reach
from formal_step_generator import PinBench, SpeedBench, SteadyBench, TableBench, Timer, TimerBench

from pulsewright.boards.pluto_step import gateware
from pulsewright.gateware import serial_timer

ANYTHING_GOES = (
    "pins and position change at ticks only",
    "width",
    "width is exact",
    "space",
    "dir changes while step is low",
    "hold",
    "set-up",
    "position moves along dir",
)
ORIGINAL = (
    "pins and position change at ticks only",
    "width",
    "dir changes while step is low",
    "hold",
    "set-up",
    "position moves along dir",
)


def with_promised_timer(old="class StepGenerator(", new="class StepGenerator("):
    module = mutant(gateware, old, new)
    module.SerialTimer = Timer
    return module


def test_the_serial_timer_is_a_timer():
    assert prove(TimerBench()).holds


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("borrow.eq(borrow & ~count[0])", "borrow.eq(borrow)"),
        ("& ~cleared", ""),
        ("self.idle.eq(self.idle & ~changed)", "self.idle.eq(self.idle & ~count[0])"),
    ],
)
def test_a_broken_serial_timer_is_found(old, new):
    assert not prove(TimerBench(mutant(serial_timer, old, new)), depth=60).holds


@pytest.mark.campaign
@pytest.mark.parametrize("extended", [False, True])
def test_the_gateware_does_what_the_table_says(extended):
    assert prove(TableBench(with_promised_timer(), extended=extended), seconds=300).holds


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("last.eq(last ^ start)", "last.eq(step_bit)"),
        ("cancel.eq(holding & ~turn if self._clean_cancel else 0)", "cancel.eq(0)"),
        ("m.d.sync += waiting.eq(0)", "m.d.sync += waiting.eq(waiting)"),
    ],
)
def test_gateware_that_differs_from_the_table_is_found(old, new):
    assert not prove(TableBench(with_promised_timer(old, new)), depth=120).holds


def test_the_extended_profile_keeps_the_pins_safe():
    assert prove(PinBench(None), *ANYTHING_GOES).holds


@pytest.mark.campaign
@pytest.mark.parametrize("tap", range(4))
def test_steps_out_are_position_counted(tap):
    """Every step of the position comes out once, or is reported as missed."""
    assert prove(PinBench(None, fixed_tap=tap), "steps out are position counted").holds


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        (
            "pins and position change at ticks only",
            "self.tick & (timer.idle | cancel)",
            "timer.idle",
        ),
        ("width", "loads_steptime.eq(start & due)", "loads_steptime.eq(0)"),
        (
            "width is exact",
            "start | self.step & Mux(turn, holding, setting_up)",
            "start | self.step",
        ),
        ("space", "fits = ~self.step & (space == 0)", "fits = ~self.step & ~space[-1]"),
        (
            "dir changes while step is low",
            "cancel.eq(holding & ~turn if self._clean_cancel else 0)",
            "cancel.eq(0)",
        ),
        ("hold", "loads_dirtime.eq(turn & due)", "loads_dirtime.eq(flip & due)"),
        ("set-up", "loads_dirtime.eq(turn & due)", "loads_dirtime.eq(turn & ~holding & due)"),
        (
            "position moves along dir",
            "self.tick & ~reverse & ~setting_up",
            "self.tick & ~setting_up",
        ),
        ("steps out are position counted", "waiting.eq(pending & ~(due & start))", "waiting.eq(0)"),
    ],
)
@pytest.mark.campaign
def test_every_demand_on_the_pins_can_fail(name, old, new):
    """One small change of the gateware breaks each of them, and the search finds how."""
    bench = PinBench(with_promised_timer(old, new), fixed_tap=0)
    assert not prove(bench, name, depth=150).holds


@pytest.mark.campaign
@pytest.mark.parametrize(("steptime", "space"), [(0, 0), (3, 2)])
def test_no_step_is_missed_up_to_the_speed_limit(steptime, space):
    assert prove(SpeedBench(steptime=steptime, space=space), "no step is missed").holds
    fast = SpeedBench(steptime=steptime, space=space, limit=2047)
    assert not prove(fast, "no step is missed", depth=60).holds


@pytest.mark.campaign
@pytest.mark.parametrize("steptime", [0, 3])
def test_the_original_loses_no_step_up_to_the_speed_limit(steptime):
    counted = "steps out are position counted"
    bench = SpeedBench(steptime=steptime, space=0, extended=False)
    assert prove(bench, counted).holds
    fast = SpeedBench(steptime=steptime, space=0, extended=False, limit=2047)
    assert not prove(fast, counted, depth=60).holds


@pytest.mark.campaign
def test_the_original_is_safe_while_no_reversal_is_called_off():
    bench = SteadyBench(None, fixed_tap=0, extended=False)
    assert prove(bench, *ORIGINAL).holds


@pytest.mark.campaign
@pytest.mark.parametrize("name", ["width", "position moves along dir"])
def test_the_original_always_keeps(name):
    assert prove(PinBench(None, extended=False), name).holds


def test_the_original_changes_dir_while_step_is_high_after_a_reversal_called_off():
    """The quirk of the original, found from nothing but the pins."""
    bench = PinBench(None, fixed_tap=0, extended=False)
    assert reach(bench, "dir changes while step is high", depth=40).trace


@pytest.mark.campaign
@pytest.mark.parametrize(
    "goal", ["dir changes", "dir changes back", "a reversal is called off", "a step is missed"]
)
def test_the_benches_allow_what_they_are_about(goal):
    assert reach(PinBench(None, fixed_tap=0), goal, depth=60).trace
