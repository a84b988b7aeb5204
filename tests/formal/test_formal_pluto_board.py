"""The whole pluto_step board, from any sequence on its bus to its pins.

Ticks are 8 clocks, watchdog ticks 64, and the watchdog time is three of them; see `small_board`.
"""

import pytest
from formal_harness import mutant, prove, reach
from formal_pluto_board import DividerBench, PathBench, WatchdogBench, small_board

from pulsewright.gateware import divider

PROFILES = pytest.mark.parametrize("profile", ["exact", "extended"])


def test_the_divider_keeps_its_period():
    assert prove(DividerBench(period=32)).holds
    assert reach(DividerBench(period=8), "a second period", depth=30).trace


@pytest.mark.campaign
def test_the_divider_of_ticks_keeps_its_period():
    assert prove(DividerBench(period=64)).holds


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("old", "new"), [("rest & state[-1]", "state[-1]"), ("state[:-1].any()", "state.any()")]
)
def test_a_broken_divider_is_found(old, new):
    assert not prove(DividerBench(mutant(divider, old, new), period=8), depth=30).holds


@pytest.mark.campaign
@PROFILES
def test_from_the_bus_to_the_pins_the_board_does_what_the_specification_says(profile):
    assert prove(PathBench(small_board(), profile), seconds=300).holds


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("step pin", "axis.step ^ bank.timing.polarity", "axis.step"),
        ("dir pin", "self._velocity(m, bank, n)", "self._velocity(m, bank, 1)"),
        ("led", "self.led.eq(axis.step ^ axis.dir)", "self.led.eq(axis.step)"),
        ("step pin", "axis.drop.eq(moved_tap if", "axis.drop.eq(0 if"),
    ],
)
def test_every_demand_on_the_path_can_fail(name, old, new):
    assert not prove(PathBench(small_board(old, new), "extended"), name, depth=100).holds


@PROFILES
def test_the_watchdog_turns_the_outputs_off_in_time(profile):
    """Whatever is on the bus: from the last tick of the time since the arm until the next arm."""
    assert prove(WatchdogBench(small_board(), profile)).holds


@pytest.mark.campaign
@pytest.mark.parametrize("goal", ["off", "on again"])
def test_the_watchdog_can_expire_and_be_fed(goal):
    assert reach(WatchdogBench(small_board(), "exact"), goal, depth=230).trace


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("never armed, never off", "enabled & watchdog.expired", "watchdog.expired"),
        ("off with the third watchdog tick", "feed.eq(arm)", "feed.eq(bank.outputs_commit)"),
    ],
)
def test_every_demand_on_the_watchdog_can_fail(name, old, new):
    bench = WatchdogBench(small_board(old, new), "exact")
    assert not prove(bench, name, depth=230).holds
