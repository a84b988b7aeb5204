"""Small faults in the gateware: recordings of the original or the twin find each of them."""

from contextlib import ExitStack, contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from random import Random
from unittest.mock import patch

import pytest
import rapcores_host
import test_rapcores_gateware as vectors
import test_rapcores_gateware_bridge as windings
import test_rapcores_gateware_shared as shared
from faults import faulty
from rapcores_equality import Pair, busy

from pulsewright.boards.rapcores import gateware
from pulsewright.boards.rapcores.golden import load, replay_on
from pulsewright.gateware.rtl import RtlSimulation

pytestmark = [
    pytest.mark.campaign,
    pytest.mark.rtl,
    pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable"),
]

ROOM = "pulsewright.boards.rapcores.gateware"
SPI = "pulsewright.gateware.spi"
DOCUMENT, COMPACT, ORIGINAL = f"{ROOM}_document", f"{ROOM}_compact", f"{ROOM}_original"
ENCODER, MOTION, PULSE = f"{ROOM}_encoder", f"{ROOM}_motion", f"{ROOM}_pulse"
SHARED, REGISTERS, BRIDGE = f"{ROOM}_shared", f"{ROOM}_registers", f"{ROOM}_bridge"
# Each after those it takes parts from.
MODULES = (
    *(SPI, ENCODER, MOTION, PULSE, SHARED, REGISTERS, BRIDGE),
    *(DOCUMENT, COMPACT, ORIGINAL, ROOM),
)
GOLDEN = Path(__file__).parents[1] / "golden" / "rapcores"
SIZE = 100_000  # cycles

# Where, what is there, what comes in its place.
RECORDED_FAULTS = {
    "bytes of a word from the highest on": (
        SPI, "Cat(self.word[8:], self.received)", "Cat(self.received, self.word)",
    ),
    "a byte is over a bit early": (SPI, "whole.eq(bit == 0)", "whole.eq(bit == 1)"),
    "replies in the other order of bits": (SPI, "bit_select(bit, 1)", "bit_select(~bit, 1)"),
    "A and B the other way round": (ENCODER, "a[1] ^ b[2]", "b[1] ^ a[2]"),
    "the third flop left out": (ENCODER, "a[1] ^ a[2], b[1] ^ b[2]", "a[0] ^ a[1], b[0] ^ b[1]"),
    "a tick at a level, not at its rise": (ORIGINAL, "level & ~before[0]", "level"),
    "ticks counted a cycle early": (
        ORIGINAL, "before[0] & ~before[1]", "level & ~before[0]",
    ),
    "a new divider restarts the count": (ORIGINAL, "count == divider", "count >= divider"),
    "a third move is refused": (
        ORIGINAL, "with m.If(self._arm):", "with m.If(self._arm & self.buffer_dtr):",
    ),
    "directions of the slot to be written": (
        ORIGINAL, "Mux(slot, self._directions[1]", "Mux(self._write_slot, self._directions[1]",
    ),
    "increment-increments from the wrong word": (
        ORIGINAL, "self._v020 or self._fixed else increment", "0 else increment",
    ),
}  # fmt: skip
COMPARED_FAULTS = {
    "a word goes on in the next frame": (
        SPI, "            with m.If(self.ended):", "            with m.If(0):",
    ),
    "a frame ends a cycle early": (SPI, "self.ended.eq(ended[1])", "self.ended.eq(ended[0])"),
    "fewer ticks at a smaller divider": (MOTION, "count >= self.divider", "count == self.divider"),
    "moves do not follow each other at once": (
        MOTION, "self.finish & (self.used > 1)", "0 & self.finish",
    ),
    "a halt goes on with the slot after": (
        MOTION, "self.slot.eq(self.write_slot)", "self.slot.eq(self.slot)",
    ),
    "positions stay where a halt found them": (
        MOTION, "position - self.excess[n].as_signed()", "position",
    ),
    "increments do not grow": (MOTION, "inc.eq(inc + incinc)", "inc.eq(inc)"),
    "lost moves are armed": (
        DOCUMENT, "sequencer.arm.eq(self._accept & ~self._halted)", "sequencer.arm.eq(1)",
    ),
    "a halt is forgotten": (DOCUMENT, "& ~self._halt_seen", ""),
    "times of 0 are long": (DOCUMENT, "value[1:] == 0", "value == 1"),
    "telemetry is live": (
        DOCUMENT, "update = ~self._sequencer.run | self._sequencer.load", "update = Const(1)",
    ),
    "a message goes on in the next frame": (
        DOCUMENT, "        if self._cs_reset_message:", "        if False:",
    ),
    "a pulse as long as the time behind it": (
        PULSE, "self.low_end, self.width_end", "self.low_end, self.low_end",
    ),
    "no hold time": (PULSE, "(setting_up | dir_ended)", "1"),
    "no setup time": (PULSE, "(~setting_up | dir_ended)", "1"),
    "one step more is owed": (PULSE, "total[8] ^ total[7]", "0"),
    "levels at the end of a reset count": (ENCODER, "reset_less=self._primed", "reset_less=False"),
}  # fmt: skip
SHARED_FAULTS = {
    "the sum of the slice below": (SHARED, "carry & ~bottom[2]", "carry"),
    "the first tick of a move as any other": (SHARED, "with m.If(self.first):", "with m.If(0):"),
    "growth in the first tick": (SHARED, "self.slot, ~self.first", "self.slot, 1"),
    "words that arrive late are not seen": (COMPACT, "| (~sequencer.run & arrived)", ""),
    "a copy of what encoders are later": (
        REGISTERS, "zip(parts, then, strict=True)", "zip(parts, now, strict=True)",
    ),
    "the second turn of a time adds it again": (
        REGISTERS, "idle = second & ~chosen & velocity & ~often", "idle = Const(0)",
    ),
    "a second turn without a result ends the time": (
        REGISTERS, "turn & ~position & (~second | often)", "turn & ~position",
    ),
    "the time from the count before last": (REGISTERS, "often | (count & counted)", "often"),
    "the rest of a reply is that of the word before": (
        COMPACT, "later.eq(late & ~self._nothing)", "later.eq(0)",
    ),
    "ticks left are those of the move before": (
        COMPACT, "restart.eq(sequencer.load | sequencer.finish", "restart.eq(sequencer.finish",
    ),
}  # fmt: skip
BRIDGE_FAULTS = {
    "B is a sine, too": (BRIDGE, "(phase[-2] ^ winding_b).replicate", "phase[-2].replicate"),
    "B has the sign of A": (BRIDGE, "phase[-1] ^ (phase[-2] & winding_b)", "phase[-1]"),
    "half a cycle is cut off": (BRIDGE, "half = 1 << (CUT_BITS - 1)", "half = 0"),
    "a pulse a cycle to the left": (BRIDGE, "Cat(~position[-1], Mux", "Cat(position[-1], Mux"),
    "motors in the other order": (BRIDGE, "SLOTS - self._motors + n", "SLOTS - 1 - n"),
    "A and B the other way round": (BRIDGE, "LEGS[n % 2 * 2 :]", "LEGS[2 - n % 2 * 2 :]"),
    "legs the other way round": (BRIDGE, "driven & ~negative", "driven & negative"),
    "brakes without being asked": (BRIDGE, "& negative), brake)", "& negative), 1)"),
    "a current of all motors": (
        DOCUMENT, "bridges.current.eq(current)", "bridges.current.eq(self._current[0])",
    ),
    "disabled motors are driven": (DOCUMENT, "bridges.en.eq(self.en)", "bridges.en.eq(~0)"),
}  # fmt: skip
SHARED_BRIDGE_FAULTS = {
    "phases go up only": (COMPACT, "Cat(1, registers.down[n]).as_signed()", "1"),
}
# Too rare in random traffic: the test that finds it.
DIRECTED_FAULTS = {
    "telemetry while a move executes": (
        *(ORIGINAL, "with m.If(self._idle):\n", "with m.If(1):\n"),
        vectors.test_upstream_telemetry_is_of_the_start_of_the_move,
    ),
    "pulses in a halt": (
        *(PULSE, "~self.blocked & ~self.step", "~self.step"),
        partial(vectors.test_no_pulse_begins_in_a_halt, 0),
    ),
    "pulses in a halt, with shared arithmetic": (
        *(PULSE, "~self.blocked & ~self.step", "~self.step"),
        partial(vectors.test_no_pulse_begins_in_a_halt, 1),
    ),
    "an event while cleared is lost": (
        *(DOCUMENT, "Mux(cleared, 0, count) + self._events[name]",
        "Mux(cleared, 0, count + self._events[name])"),
        partial(vectors.test_an_event_in_the_cycle_of_the_clear_is_counted, 0),
    ),
    "an event while cleared is lost, with shared arithmetic": (
        *(REGISTERS, "| self.zero, self.event[n],", "| self.zero, self.event[n] & ~self.zero,"),
        partial(vectors.test_an_event_in_the_cycle_of_the_clear_is_counted, 1),
    ),
    "a copy of what has had its turn": (
        *(REGISTERS, "chosen & ~unchanged", "chosen"),
        shared.test_telemetry_is_that_of_the_cycle_in_which_a_move_starts,
    ),
    "registers stay in a reset": (
        *(REGISTERS, "m.If(self.clear):\n            m.d.comb += read.addr.eq(ZERO)",
        "m.If(self.clear):"),
        shared.test_a_reset_clears_what_is_in_memory,
    ),
    "the time since before a reset": (
        *(REGISTERS, "(count & counted)) | self.clear", "(count & counted))"),
        shared.test_the_shortest_reset_clears_the_time_since_the_last_count,
    ),
    "fractions of steps stay in a reset": (
        *(SHARED, "with m.If(unused):", "with m.If(0):"),
        partial(shared.test_a_reset_clears_fractions_of_steps, 1),
    ),
    "a copy of what is not in memory yet": (
        *(REGISTERS, "(wait == 0)", "~wait[0]"),
        shared.test_telemetry_is_that_of_the_cycle_in_which_a_move_starts,
    ),
    "a reply stays in a reset": (
        *(COMPACT, "with m.If(self.clear | self._nothing)", "with m.If(self._nothing)"),
        partial(shared.test_nothing_of_a_reply_is_shown_after_a_reset_within_its_frame, 1, 0x01),
    ),
    "owed steps stay in phases": (
        *(COMPACT, "counted - Mux(take, owed, 0)", "counted"),
        partial(windings.test_a_halt_takes_owed_steps_back_from_windings_too, 1),
    ),
}  # fmt: skip


@contextmanager
def boards(fault):
    """Let `gateware.Rapcores` be made with a fault, and give the component."""
    name, *change = fault
    with ExitStack() as stack:
        spoilt = faulty(name, *change)
        parts = {
            key: value
            for key, value in vars(spoilt).items()
            if getattr(value, "__module__", "") == spoilt.__name__
        }
        for other in map(import_module, MODULES[MODULES.index(name) + 1 :]):
            for key, value in parts.items():
                if hasattr(other, key):
                    stack.enter_context(patch.object(other, key, value))
        yield parts.get("Rapcores", gateware.Rapcores)


def recordings():
    """Return recordings by board, small ones first."""
    paths = sorted(GOLDEN.glob("*.jsonl.gz"), key=lambda path: path.stat().st_size)
    return [load(path) for path in paths if path.stat().st_size < 20_000]


@pytest.mark.parametrize("fault", RECORDED_FAULTS)
def test_recordings_find(fault):
    found, made = False, {}
    with boards(RECORDED_FAULTS[fault]) as component:
        for golden in recordings():
            key = golden.profile, *golden.switches
            if key not in made:
                made[key] = RtlSimulation(component(golden.profile, **golden.switches))
            made[key].reset()
            if golden.expected.first_difference(replay_on(made[key], golden)) is not None:
                found = True
                break
    assert found


def differs(component, **options):
    """Say whether gateware and twin differ in one of some runs of random traffic."""
    pair = Pair(component, **({"motors": 1, "encoders": 1} | options))
    for seed in range(20):
        try:
            pair.run(busy(Random(seed), pair, SIZE, flaws=100))
        except AssertionError:
            return True
    return False


@pytest.mark.parametrize("fault", COMPARED_FAULTS)
def test_comparison_finds(fault):
    with boards(COMPARED_FAULTS[fault]) as component:
        assert differs(component)


@pytest.mark.parametrize("fault", SHARED_FAULTS)
def test_comparison_finds_with_shared_arithmetic(fault):
    with boards(SHARED_FAULTS[fault]) as component:
        assert differs(component, shared_dda=1)


@pytest.mark.parametrize("fault", BRIDGE_FAULTS)
def test_comparison_finds_in_bridges(fault):
    with boards(BRIDGE_FAULTS[fault]) as component:
        assert differs(component, motors=2, motor_driver=1)


@pytest.mark.parametrize("fault", SHARED_BRIDGE_FAULTS)
def test_comparison_finds_in_bridges_with_shared_arithmetic(fault):
    with boards(SHARED_BRIDGE_FAULTS[fault]) as component:
        assert differs(component, shared_dda=1, motor_driver=1)


@pytest.mark.parametrize("fault", DIRECTED_FAULTS)
def test_vectors_find(fault):
    *change, test = DIRECTED_FAULTS[fault]
    with (
        boards(change) as component,
        patch.object(rapcores_host, "Rapcores", component),
        patch.dict(rapcores_host._boards, clear=True),
        pytest.raises(AssertionError),
    ):
        test()


def test_nothing_differs_without_a_fault():
    assert not differs(gateware.Rapcores)
    assert not differs(gateware.Rapcores, motors=2, motor_driver=1)
