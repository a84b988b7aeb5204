"""Small faults in the gateware: the comparison with the twin finds each of them."""

import importlib
import sys
from pathlib import Path
from random import Random
from types import ModuleType
from unittest.mock import patch

import pytest
from usc_equality import Pair, traffic

from pulsewright.boards.usc import gateware as room

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


def faulty(name, old, new):
    """Return the module ``name`` with a fault in its source."""
    source = Path(importlib.import_module(name).__file__).read_text()
    assert source.count(old) >= 1, f"{name} has no {old!r}"
    module = ModuleType(f"{name}_faulty")
    with patch.dict(sys.modules, {module.__name__: module}):
        exec(compile(source.replace(old, new, 1), name, "exec"), module.__dict__)
    return module


@pytest.mark.campaign
@pytest.mark.parametrize("fault", FAULTS)
def test_comparison_finds(fault):
    name, old, new, options = FAULTS[fault]
    module = faulty(name, old, new)
    boards = room.UscBoards
    parts = {key: value for key, value in vars(module).items() if hasattr(room, key)}
    if name == ROOM:
        boards, parts = module.UscBoards, {"UscBoards": boards}
    with patch.multiple(room, **parts):
        pair = Pair(boards, **({"watchdog_us": 40} | options))

    def differs(seed):
        quiet = seed % 4 == 0
        try:
            pair.run(*traffic(Random(seed), pair, 300 if quiet else 3000, quiet=quiet))
        except AssertionError:
            return True
        return False

    assert any(differs(seed) for seed in range(1, 61))
