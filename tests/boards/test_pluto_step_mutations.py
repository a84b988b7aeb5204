"""Small faults in gateware and twin: the comparison of the two finds each of them.

Recordings of the original controller find many of them too, without a second opinion.
"""

import functools
from pathlib import Path
from random import Random
from unittest.mock import patch

import pytest
from faults import faulty, interpreted
from pluto_step_equality import Pair, traffic

from pulsewright.boards.pluto_step import gateware as room
from pulsewright.boards.pluto_step.golden import load, replay_on

pytestmark = [pytest.mark.campaign, pytest.mark.rtl]

GOLDEN = Path(__file__).parents[1] / "golden" / "pluto_step"

ROOM = "pulsewright.boards.pluto_step"
GATEWARE = f"{ROOM}.gateware"
STEPGEN, KERNEL = f"{ROOM}.twin_stepgen", f"{ROOM}.twin_kernel"
EXTENDED = {"profile": "extended"}

# Where, what is there, what comes in its place, configuration.
GATEWARE_FAULTS = {
    "a cancelled reversal ends its hold time": (
        GATEWARE, "if self._clean_cancel else 0", "if True else 0", {},
    ),
    "direction flips without hold time": (GATEWARE, "turn & holding)", "turn)", {}),
    "position moves while the direction is wrong": (
        GATEWARE, "self.tick & ~reverse", "self.tick", {},
    ),
    "step bit of the old tap right before a tick": (
        GATEWARE, "Mux(bank.timing_commit, written.tap, bank.timing.tap)", "bank.timing.tap", {},
    ),
    "times taken after the tick": (
        GATEWARE,
        "with m.If(tick):\n                m.d.sync += held.eq(value)",
        "m.d.sync += held.eq(value)",
        {},
    ),
    "led shows the polarity": (GATEWARE, "axis.step ^ axis.dir", "self.step[0] ^ axis.dir", {}),
    "an absent register is latched": (GATEWARE, " & ~self.address.matches(*absent)", "", {}),
    "no low byte at addresses above the registers": (
        GATEWARE, "range(16 if on[\"no_alias\"] else 32)", "range(16)", {},
    ),
    "every write of the outputs arms": (
        GATEWARE, " & bank.word[registers.W_OUTPUTS_WATCHDOG_ARM_LSB]", "", {},
    ),
    "a watchdog tick one cycle late": (GATEWARE, "ticks.last & watchdog", "tick & watchdog", {}),
    "a pulse starts while the one before is high": (
        GATEWARE, "~self.step & (space == 0)", "space == 0", EXTENDED,
    ),
    "a step missed at the read of the status is forgotten": (
        GATEWARE,
        "kept & ~read.replicate(AXES) | missed", "(kept | missed) & ~read.replicate(AXES)",
        EXTENDED,
    ),
    "a change of tap makes a missed step": (
        GATEWARE, "m.d.sync += waiting.eq(0)", "m.d.sync += waiting.eq(waiting)", EXTENDED,
    ),
    "a change of tap makes a step": (GATEWARE, "last.eq(step_bit)", "last.eq(last)", EXTENDED),
    "the tick of the read is counted": (
        GATEWARE, "latch.ticks.eq(count)", "latch.ticks.eq(count + tick)", EXTENDED,
    ),
    "staged velocities act without the joint bit": (
        GATEWARE, "m.If(joint & bank.outputs_commit)", "m.If(bank.outputs_commit)", EXTENDED,
    ),
    "the watchdog always stops the axes": (
        GATEWARE, "self.tristate & bank.control.watchdog_stop", "self.tristate", EXTENDED,
    ),
    "a tick at the edge of a feed counts": (
        "pulsewright.gateware.watchdog", "m.If(self.feed)", "m.If(self.feed & ~self.tick)", {},
    ),
    "the watchdog starts again by itself": (
        "pulsewright.gateware.watchdog", "self.tick & ~self.expired", "self.tick", {},
    ),
    "a timer without borrow": (
        "pulsewright.gateware.serial_timer", "borrow & ~count[0]", "0", {},
    ),
    "acknowledge one cycle early": ("pulsewright.gateware.epp", "stages[4] &", "stages[3] &", {}),
    "a strobe that is gone writes": (
        "pulsewright.gateware.epp", "self.action & ~self.ndatastr", "self.action", {},
    ),
}  # fmt: skip

TWIN_FAULTS = {
    "no low tick after a pulse of a train": (
        STEPGEN, "speed * apart <= unit", "speed * (apart - 1) <= unit", {},
    ),
    "negative steps where positive ones are": (STEPGEN, "into + 1 if negative else", "", {}),
    "a pulse of a train late": (STEPGEN, "speed - 0.5 - over", "speed + 0.5 - over", {}),
    "a train one tick too long": (STEPGEN, "step_time - 2) * speed", "step_time - 1) * speed", {}),
    "a train counts as one toggle": (STEPGEN, "axis.last ^= count & 1", "axis.last ^= 1", {}),
    "a cancelled reversal ends its hold time": (
        STEPGEN, "timing.clean_cancel and axis.mode", "axis.mode", {},
    ),
    "a train leaves the hold time": (
        STEPGEN, "axis.mode == HOLD and not timing.clean_cancel", "axis.mode == HOLD", EXTENDED,
    ),
    "a train begins within a space": (STEPGEN, "first >= axis.space", "first >= 0", EXTENDED),
    "space passes while step is high": (
        STEPGEN, "axis.space if axis.step else timing.space", "timing.space - 1", EXTENDED,
    ),
    "a tick at the edge of an arm counts": (
        KERNEL, "(cycle - board.origin + 1) // WATCHDOG", "(cycle - board.origin) // WATCHDOG", {},
    ),
    "a read sees the tick of its edge": (
        KERNEL, "advance_all(s, cycle - 1,", "advance_all(s, cycle,", {},
    ),
    "the tick of the read is counted": (
        KERNEL, "load_latch(s, cycle - 1)", "load_latch(s, cycle)", EXTENDED,
    ),
    "velocities are staged with the joint bit only": (
        KERNEL, "    axis.staged = velocity", "    else:\n        axis.staged = velocity", EXTENDED,
    ),
    "staged velocities outlive a reset": (
        KERNEL, "axis.velocity = axis.staged = 0", "axis.velocity = 0", EXTENDED,
    ),
    "times act on the tick of their edge": (
        KERNEL, "        advance_axis(s, i, cycle, 0)\n", "", {},
    ),
    "a change of tap makes a missed step": (KERNEL, "s.axes[i].pending = 0", "pass", EXTENDED),
    "a read of the status keeps missed steps": (KERNEL, "s.axes[i].missed = 0", "pass", EXTENDED),
    "led shows the polarity": (
        KERNEL, "(s.axes[0].step ^ s.axes[0].direction)", "(s.axes[0].step ^ polarity)", {},
    ),
    "addresses above the registers are nothing": (KERNEL, "board.no_alias and ", "", {}),
    "the watchdog always stops the axes": (
        KERNEL, "board.tristate == 1 and (board.control & W_CONTROL_WATCHDOG_STOP_MASK) != 0",
        "board.tristate == 1", EXTENDED,
    ),
    "action one edge early": (
        "pulsewright.twin.epp", "(stages & 0b110) == 0b010", "(stages & 0b11) == 0b01", {},
    ),
    "two changes in a cycle stay": (
        "pulsewright.twin.recorder", "pin.used > 0 and rows.cycles[end - 1] == cycle", "False", {},
    ),
}  # fmt: skip


# Faults that change a recording of the original, which is of the profile `exact`.
RECORDED_GATEWARE = {
    "acknowledge one cycle early": "p02_dio",
    "a timer without borrow": "p04_reversal",
    "direction flips without hold time": "p05_polarity",
    "position moves while the direction is wrong": "p05_polarity",
    "led shows the polarity": "p05_polarity",
    "every write of the outputs arms": "p06_tap",
    "a watchdog tick one cycle late": "p07_watchdog",
    "the watchdog starts again by itself": "p07_watchdog",
    "a cancelled reversal ends its hold time": "p08_addr_wrap",
}
RECORDED_TWIN = {
    "negative steps where positive ones are": "p03_const_vel",
    "a pulse of a train late": "p04_reversal",
    "no low tick after a pulse of a train": "p05_polarity",
    "led shows the polarity": "p05_polarity",
    "two changes in a cycle stay": "p05_polarity",
    "a train counts as one toggle": "p06_tap",
    "action one edge early": "p06_tap",
    "a train one tick too long": "p07_watchdog",
    "a cancelled reversal ends its hold time": "p08_addr_wrap",
    "addresses above the registers are nothing": "p08_addr_wrap",
}


@functools.cache
def recording(name):
    return load(GOLDEN / f"{name}.npz")


def gateware_differs(simulation, name):
    """Say where gateware first differs from a recording; None if nowhere."""
    simulation.reset()
    return recording(name).expected.first_difference(replay_on(simulation, recording(name)))


def twin_differs(make, name):
    twin, golden = make(bus_pins=True), recording(name)
    twin.schedule(golden.cycle, golden.pin, golden.level)
    twin.advance(golden.expected.end)
    return golden.expected.first_difference(twin.drain())


def pair_with_faulty_gateware(name, old, new, options):
    module = faulty(name, old, new)
    if name == GATEWARE:
        return Pair(gateware=module.PlutoStep, **options)
    parts = {key: value for key, value in vars(module).items() if hasattr(room, key)}
    with patch.multiple(room, **parts):
        return Pair(**options)


@functools.cache
def faulty_twin(*fault):
    return interpreted(ROOM, *fault).PlutoStepTwin


def find(pair, runs):
    """Return random traffic in which the two of a pair differ; None if there is none."""
    for seed, options in enumerate(runs, 1):
        found = traffic(Random(seed), **options)
        try:
            pair.run(*found)
        except AssertionError:
            return found
    return None


GATEWARE_RUNS = [*[{"size": 1000}] * 2, {"size": 60, "quiet": True}] * 5
# An interpreted twin takes a thousand times longer for an event, so it gets fewer of them.
TWIN_RUNS = [*[{"size": 50}] * 2, {"size": 10, "quiet": True}] * 15


@pytest.mark.parametrize("fault", GATEWARE_FAULTS)
def test_comparison_finds_in_the_gateware(fault):
    *_, options = GATEWARE_FAULTS[fault]
    found = find(pair_with_faulty_gateware(*GATEWARE_FAULTS[fault]), GATEWARE_RUNS)
    assert found
    Pair(**options).run(*found)  # it was the fault


@pytest.mark.parametrize("fault", TWIN_FAULTS)
def test_comparison_finds_in_the_twin(fault):
    *change, options = TWIN_FAULTS[fault]
    found = find(Pair(twin=faulty_twin(*change), **options), TWIN_RUNS)
    assert found
    Pair(twin=faulty_twin(), **options).run(*found)  # it was the fault


@pytest.mark.parametrize("fault", RECORDED_GATEWARE)
def test_recording_finds_in_the_gateware(fault):
    pair = pair_with_faulty_gateware(*GATEWARE_FAULTS[fault])
    assert gateware_differs(pair.rtl, RECORDED_GATEWARE[fault])


@pytest.mark.parametrize("fault", RECORDED_TWIN)
def test_recording_finds_in_the_twin(fault):
    *change, _ = TWIN_FAULTS[fault]
    assert twin_differs(faulty_twin(*change), RECORDED_TWIN[fault])


def test_without_a_fault_the_recordings_differ_nowhere():
    simulation = Pair().rtl
    for name in {*RECORDED_GATEWARE.values(), *RECORDED_TWIN.values()}:
        assert gateware_differs(simulation, name) is None
        assert twin_differs(faulty_twin(), name) is None
