"""Small faults in gateware and twin: the comparison of the two finds each of them."""

from random import Random
from unittest.mock import patch

import pytest
import usc_equality
from faults import faulty, interpreted
from usc_equality import Pair, traffic

from pulsewright.boards.usc import gateware as room

pytestmark = [pytest.mark.campaign, pytest.mark.rtl]

FLOOR = "pulsewright.gateware"
ROOM = "pulsewright.boards.usc.gateware"
TWO_BOARDS = {"boards": 2, "watchdog_us": 0}

# Where, what is there, what comes in its place, configuration.
FAULTS = {
    "pulse one tick longer": (
        f"{FLOOR}.step_pulse", "timer.eq(self.width)", "timer.eq(self.width + 1)", {},
    ),
    "no space between pulses": (
        f"{FLOOR}.step_pulse", "~self.step & (space == 0)", "~self.step", {"min_space": 3},
    ),
    "no setup time before a pulse": (
        f"{FLOOR}.step_pulse", " & (ended | ~setting_up)", "", {},
    ),
    "a change of mind waits for the setup time": (
        f"{FLOOR}.step_pulse", "turn & (ended | setting_up)", "turn & ended", {},
    ),
    "direction changes one tick after the fall": (
        f"{FLOOR}.step_pulse",
        "m.d.sync += self.dir.eq(self.direction)\n                    else:",
        "pass\n                    else:",
        {"mariss": 1},
    ),
    "divisor compared for equality": (
        f"{FLOOR}.step_rate", "count >= self.divisor", "count == self.divisor", {},
    ),
    "counter goes on while a pulse waits": (
        f"{FLOOR}.step_rate", "m.Elif(~self.due)", "m.Else()", {"min_space": 40},
    ),
    "counter kept while the axis is off": (
        f"{FLOOR}.step_rate", "~self.enable | self.due & self.ready", "self.due & self.ready", {},
    ),
    "encoder counts the other way": (
        f"{FLOOR}.quadrature", "self.up.eq(self.a ^ b)", "self.up.eq(~self.a ^ b)", {},
    ),
    "position load one cycle late": (
        f"{FLOOR}.quadrature", "Mux(self.load, self.value, count)", "count", {},
    ),
    "index reset during a position load": (
        f"{FLOOR}.quadrature", "m.If(self.load)", "m.If(self.load & ~self.reset)", {"ident": 0x42},
    ),
    "filter takes one sample less": (
        f"{FLOOR}.synchroniser", "count == self._samples - 1", "count == self._samples - 2",
        {"enc_filter": 3},
    ),
    "estop left without an edge of the release bit": (
        f"{FLOOR}.estop", " & (ran | ~released)", "", {},
    ),
    "an address read increments": (
        f"{FLOOR}.epp", "self.action & self.naddrstr", "self.action", {},
    ),
    "estop chain one cycle early": (
        ROOM, "inputs.before[INPUTS]", "inputs.levels[INPUTS]", {},
    ),
    "divisor 0 runs": (ROOM, " & nonzero[n]", "", {}),
    "latch timer one unit late": (ROOM, "units + full >=", "units + full >", {}),
    "index edge lost that meets the read": (
        ROOM, "Mux(read, 0, sense) | sensed", "Mux(read, 0, sense | sensed)", {},
    ),
    "boards latch all the time the Intr line is asserted": (
        ROOM, "self.intr_i & ~asserted", "self.intr_i", TWO_BOARDS,
    ),
    "Intr line asserted for one cycle more": (
        ROOM, "* tick_cycles - 1", "* tick_cycles", TWO_BOARDS,
    ),
    "watchdog one tick late": (
        ROOM, "* (registers.TICK_HZ // 1_000_000),", "* (registers.TICK_HZ // 1_000_000) + 1,", {},
    ),
    "watchdog fed by axes that are not adjacent": (
        ROOM, "commits & commits >> 1", "commits & commits >> 2", {},
    ),
    "ticks one cycle late": (ROOM, "tick.eq(phase == 0)", "tick.eq(phase == 1)", {}),
    "short strobe reads": (ROOM, "m.If(epp.read & ~self.ndatastr)", "m.If(epp.read)", {}),
    "forbidden time code wraps": (ROOM, "Mux(code.all(), 0, ~code - 1)", "(~code - 1)", {}),
    "bus reset ignored": (ROOM, "ResetInserter(~self.ninit)(core)", "core", {}),
}  # fmt: skip


KERNEL, PULSE = "pulsewright.boards.usc.twin_kernel", "pulsewright.twin.step_pulse"

TURNS = ("divisors", "control", "codes", "release")
LATCHES = ("timer", "cycle", "encoders", "load", "read")

# As above, with what the host does: kinds of `usc_equality.COMMANDS`.
TWIN_FAULTS = {
    "a train one tick too long": (
        PULSE, "end - 1 - width - start", "end - width - start", {}, TURNS,
    ),
    "no space between the pulses of a train": (
        PULSE, "max(period, width + space)", "max(period, width + 1)", {"min_space": 3}, TURNS,
    ),
    "no hold time after a single pulse": (
        PULSE, "axis.hold = axis.fall + setup", "pass", {}, TURNS,
    ),
    "counter goes on while a pulse waits": (
        "pulsewright.twin.step_rate", "min(period - 1, count + end - tick)", "count + end - tick",
        {"min_space": 40}, TURNS,
    ),
    "a divisor acts on the tick of its edge": (
        KERNEL, "if not advance_axis(s, b, i, cycle):\n            return False\n", "pass\n", {},
        TURNS,
    ),
    "a time code acts on the tick of its edge": (
        KERNEL,
        "if not advance_board(s, b, cycle):\n                return False\n            if register",
        "if register", {}, ("codes",),
    ),
    "the watchdog takes one tick more": (
        KERNEL, "bus.watchdog_us - 1", "bus.watchdog_us", {"watchdog_us": 40}, TURNS,
    ),
    "a feed keeps the commits before it": (
        KERNEL, "        board.commits = 0\n", "", {"watchdog_us": 40}, TURNS,
    ),
    "a slave obeys the chain": (
        KERNEL, "board.chain == 0 and board.slave == 0", "board.chain == 0", {},
        ("encoders", "release"),
    ),
    "the DAC works in estop": (
        KERNEL, "board.dac >> i & board.running", "board.dac >> i & 1", {}, ("outputs", "release"),
    ),
    "a double transition counts": (
        "pulsewright.twin.quadrature", "return 0", "return 1", {}, LATCHES,
    ),
    "a capture takes the count of its edge": (
        KERNEL, "index_edge(s, b, i, before)", "index_edge(s, b, i, axis.encoder)", {}, LATCHES,
    ),
    "index reset during a position load": (
        KERNEL, "reset and not loads(board.encoder_control, i)", "reset", {"ident": 0x42}, LATCHES,
    ),
    "index reset does not open the gate": (
        KERNEL, "select or reset:", "select:", {"ident": 0x42, "sense_gate": 1}, LATCHES,
    ),
    "sense bits of other axes are lost": (
        KERNEL, "index_sense |= 1", "index_sense = 1", {}, LATCHES,
    ),
    "filter takes one sample more": (
        KERNEL, "cycle + bus.enc_filter - 1", "cycle + bus.enc_filter", {"enc_filter": 3}, LATCHES,
    ),
    "a latch timer that is off goes on": (
        KERNEL, "board.timer_tick if running else 0", "board.timer_tick", {}, LATCHES,
    ),
    "latch timer one unit early": (KERNEL, "rate * TIMER", "(rate - 1) * TIMER", {}, LATCHES),
    "an event latches no other board": (
        KERNEL, "not asserted or sources >> b & 1", "sources >> b & 1", TWO_BOARDS, LATCHES,
    ),
    "the address runs on into the next board": (
        KERNEL, "bus.address & ~(PAGE - 1) | (bus.address + 1) % PAGE", "(bus.address + 1) % 256",
        TWO_BOARDS, ("outputs", "byte"),
    ),
}  # fmt: skip


def find(pair, runs):
    """Return random traffic in which the two of a pair differ; None if there is none."""
    for seed, options in enumerate(runs, 1):
        found = traffic(Random(seed), pair, **options)
        try:
            pair.run(*found)
        except AssertionError:
            return found
    return None


GATEWARE_RUNS = [*[{"size": 3000}] * 3, {"size": 300, "quiet": True}] * 15
# An interpreted twin takes a thousand times longer for an event, so it gets fewer of them.
TWIN_RUNS = [{"size": 20}, {"size": 40, "slower": 8}, {"size": 20, "quiet": True}] * 20


@pytest.mark.parametrize("fault", FAULTS)
def test_comparison_finds_in_the_gateware(fault):
    name, old, new, options = FAULTS[fault]
    module = faulty(name, old, new)
    boards = room.UscBoards
    parts = {key: value for key, value in vars(module).items() if hasattr(room, key)}
    if name == ROOM:
        boards, parts = module.UscBoards, {"UscBoards": boards}
    with patch.multiple(room, **parts):
        pair = Pair(boards, **({"watchdog_us": 40} | options))
    assert find(pair, GATEWARE_RUNS)


@pytest.mark.parametrize("fault", TWIN_FAULTS)
def test_comparison_finds_in_the_twin(fault):
    *change, options, commands = TWIN_FAULTS[fault]
    twins = [interpreted("pulsewright.boards.usc", *fault).UscTwin for fault in (change, ())]
    with patch.multiple(usc_equality, UscTwin=twins[0], COMMANDS=commands):
        pair = Pair(**({"watchdog_us": 0} | options))
        found = find(pair, TWIN_RUNS)
    assert found
    with patch.object(usc_equality, "UscTwin", twins[1]):
        pair.run(*found)  # it was the fault
