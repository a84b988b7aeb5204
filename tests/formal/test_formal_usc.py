"""The step path of usc: what a drive may rely on, and estop, for every input sequence.

The gateware does what the tables of the specification say, at every clock edge; the tables keep the
pins safe.
"""

import pytest
from formal_harness import mutant, prove, reach
from formal_usc import (
    BoardEstopBench,
    EstopBench,
    PeriodBench,
    PulsePinBench,
    PulseTableBench,
    WatchdogBench,
)

from pulsewright.boards.usc import gateware
from pulsewright.gateware import estop, step_pulse, step_rate, watchdog

SPACES = pytest.mark.parametrize("min_space", [1, 3])  # profiles document and linuxcnc
MARISS = pytest.mark.parametrize("mariss", [False, True])


@SPACES
@MARISS
def test_the_pulse_former_does_what_the_table_says(min_space, mariss):
    assert prove(PulseTableBench(min_space=min_space, change_at_fall=mariss)).holds


@pytest.mark.campaign
@SPACES
@MARISS
def test_the_pulse_former_keeps_the_pins_safe(min_space, mariss):
    assert prove(PulsePinBench(min_space=min_space, change_at_fall=mariss)).holds


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        (
            "a pulse for every step accepted",
            "with m.If(self.ready & self.due)",
            "with m.If(self.due)",
        ),
        ("width", "self.step.eq(1), timer.eq(self.width)", "self.step.eq(1), timer.eq(0)"),
        ("width is exact", "self.step.eq(0)", "self.step.eq(~space[0])"),
        ("space", "space.eq(self._min_space - 1)", "space.eq(0)"),
        (
            "dir changes while step is low",
            "m.d.sync += [timer.eq(self.setup), setting_up.eq(0)]",
            "m.d.sync += self.dir.eq(self.direction)",
        ),
        ("hold", "turn & (ended | setting_up)", "turn"),
        ("set-up", "~turn & (ended | ~setting_up)", "~turn"),
    ],
)
def test_every_demand_on_the_pins_can_fail(name, old, new):
    bench = PulsePinBench(mutant(step_pulse, old, new), min_space=3)
    assert not prove(bench, name, depth=40).holds


@pytest.mark.campaign
@pytest.mark.parametrize("goal", ["dir changes back", "a second pulse"])
def test_the_pulse_bench_allows_what_it_is_about(goal):
    assert reach(PulsePinBench(min_space=3), goal, depth=40).trace


@pytest.mark.campaign
def test_a_pulse_former_that_differs_from_the_table_is_found():
    broken = mutant(step_pulse, "turn & (ended | setting_up)", "turn & ended")
    assert not prove(PulseTableBench(broken), depth=40).holds


@pytest.mark.parametrize(("width", "offset"), [(24, 1), (6, 4)])  # 24 bits of offset 4: too hard
def test_the_rate_generator_does_what_the_table_says(width, offset):
    assert prove(PeriodBench(width=width, offset=offset)).holds


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("due", "count >= self.divisor", "count > self.divisor"),
        ("no step while halted", "self.enable & counting", "counting"),
    ],
)
def test_every_demand_on_the_rate_generator_can_fail(name, old, new):
    assert not prove(PeriodBench(mutant(step_rate, old, new)), name, depth=40).holds


@pytest.mark.campaign
def test_the_rate_generator_bench_allows_a_second_period():
    assert reach(PeriodBench(), "a second period", depth=20).trace


def test_estop_overrides_everything():
    assert prove(EstopBench()).holds
    assert reach(EstopBench(), "runs again", depth=20).trace


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        (
            "runs only while nothing objects",
            "self.release & self.closed & self.fed",
            "self.release & self.fed",
        ),
        ("leaves estop only as release rises", "(ran | ~released)", "1"),
        ("release rises and nothing objects: runs", "(ran | ~released)", "ran"),
        ("goes on while nothing objects", "(ran | ~released)", "~released"),
    ],
)
def test_every_demand_on_estop_can_fail(name, old, new):
    assert not prove(EstopBench(mutant(estop, old, new)), name, depth=20).holds


@pytest.mark.parametrize(
    ("ticks", "starts_expired"),
    [(127, False), (100_000, True)],  # pluto_step and usc
)
def test_the_watchdog_expires_in_time(ticks, starts_expired):
    assert prove(WatchdogBench(ticks=ticks, starts_expired=starts_expired)).holds


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("expires in time", "self.tick & ~self.expired", "self.tick & ~self.expired & ~count[1]"),
        ("does not expire early", "count == self._ticks", "count >= self._ticks - 1"),
        ("a feed ends it", "count.eq(0)", "count.eq(count)"),
    ],
)
def test_every_demand_on_the_watchdog_can_fail(name, old, new):
    bench = WatchdogBench(mutant(watchdog, old, new), ticks=5)
    assert not prove(bench, name, depth=40).holds


PROFILES = pytest.mark.parametrize("profile", ["document", "linuxcnc"])


@pytest.mark.campaign
@PROFILES
def test_in_estop_no_pulse_starts_whatever_happens_on_the_bus(profile):
    assert prove(BoardEstopBench(profile=profile)).holds
    assert prove(BoardEstopBench(profile=profile, slave=False)).holds


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("outputs are 0 in estop", "Mux(estop.running, bank.dac.value, 0)", "bank.dac.value"),
        ("no pulse starts in estop", "& nonzero[n] & self.running", "& nonzero[n]"),
        (
            "an open chain stops the board",
            "self.chain | bank.slave.enable",
            "self.chain | bank.slave.enable | bank.dac.value[7]",
        ),
    ],
)
def test_every_demand_on_the_board_in_estop_can_fail(name, old, new):
    slave = name != "an open chain stops the board"
    bench = BoardEstopBench(mutant(gateware, old, new), slave=slave)
    assert not prove(bench, name, depth=60).holds


@pytest.mark.campaign
@pytest.mark.parametrize(
    "goal", ["a pulse starts", "stops while a pulse is out", "a slave runs with its chain open"]
)
def test_the_bus_can_start_and_stop_the_board(goal):
    assert reach(BoardEstopBench(), goal, depth=60).trace
