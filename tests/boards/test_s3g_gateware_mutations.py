"""Small faults in the gateware: recordings of the original or the rules find each of them."""

from pathlib import Path
from unittest.mock import patch

import pytest
import test_s3g_gateware_motion as rules
import test_s3g_gateware_program as program
from faults import faulty

from pulsewright.boards.s3g import gateware as room
from pulsewright.boards.s3g import registers as s3g
from pulsewright.boards.s3g.gateware_motion import Profiles
from pulsewright.boards.s3g.golden import load, replay_on
from pulsewright.gateware.rtl import RtlSimulation

pytestmark = [
    pytest.mark.campaign,
    pytest.mark.rtl,
    pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable"),
]

ROOM = "pulsewright.boards.s3g.gateware"
UART = "pulsewright.gateware.uart"
SERIAL, PROGRAM, MOTION = f"{ROOM}_serial", f"{ROOM}_program", f"{ROOM}_motion"
SHARED = f"{ROOM}_shared"
GOLDEN = Path(__file__).parents[1] / "golden" / "s3g"
RECORDINGS = sorted(GOLDEN.glob("*_fast.npz"), key=lambda path: path.stat().st_size)

# Where, what is there, what comes in its place.
BOARD_FAULTS = {
    "start bit checked late": (UART, "count.eq(7)", "count.eq(6)"),
    "bad stop bits accepted": (UART, "self.valid.eq(line)", "self.valid.eq(1)"),
    "a start bit of 17 enables": (UART, "count.eq(1),", "count.eq(0),"),
    "an enable too early": (UART, "init=-self._limit", "init=1 - self._limit"),
    "port 1 wins": (SERIAL, "self.port.eq(~header[0])", "self.port.eq(header[1])"),
    "payload kept from the packet before": (SERIAL, "self.payload.eq(0),", ""),
    "the next packet is not noticed": (SERIAL, "self.intact.eq(0),", ""),
    "replies one cycle early": (SERIAL, 'm.next = "PAUSE"', 'm.next = "NEXT"'),
    "one word too few": (SERIAL, "words == 1", "words == 2"),
    "address of this request with no words": (
        SERIAL, "said_address.eq(sent_address)", "said_address.eq(address)",
    ),
    "N = 0 is a command": (SERIAL, "else self.size == 0", "else Const(0)"),
    "reports one cycle late": (PROGRAM, "timer.eq(self._repeat - 1)", "timer.eq(self._repeat)"),
    "a running program can be started": (PROGRAM, "self.start & ~run", "self.start"),
    "abort ends a program with an interrupt": (
        PROGRAM, "execute & ~goes_on", "decode & ~goes_on | self.abort",
    ),
    "a step during a load": (
        MOTION, "(working & goes | self.aborting) & ~self.load", "(working & goes | self.aborting)",
    ),
    "steps of an abort as long as before": (
        MOTION, "Mux(in_abort, self.dt_value, dt_limit)", "dt_limit",
    ),
    "interrupt in the first cycle of an abort only": (
        MOTION, "(hit | in_abort)", "(hit & ~in_abort)",
    ),
    "pulses start at once": (MOTION, "busy & ~before_pre & before_end", "busy & before_end"),
    "bytes of words one late": (SERIAL, "BUFFER_DATA + 1", "BUFFER_DATA"),
    "never reset": (ROOM, "domain.rst.eq(~ready)", "domain.rst.eq(0)"),
    "enable pins not inverted": (ROOM, "self.mot_enable.eq(~enable)", "self.mot_enable.eq(enable)"),
}  # fmt: skip
PROGRAM_FAULTS = {
    "an interrupt is lost that meets its clearing": (
        PROGRAM, "self.pending & ~self.clear | self.sources",
        "(self.pending | self.sources) & ~self.clear",
    ),
    "waits for interrupts that there are not": (PROGRAM, ".any() | others)", ".any())"),
    "busy in time": (PROGRAM, "waiting, busy))", "waiting, run))"),
    "an output does not wait": (PROGRAM, "wait | output & self.stall", "wait"),
}  # fmt: skip
PULSE_FAULTS = {
    "pre does not count for the end": (
        MOTION, "before_pre | before_end | before_post", "before_end | before_post",
    ),
}  # fmt: skip
PROFILE_FAULTS = {
    "a target that is met exactly ends the profile": (
        MOTION, "Mux(above, beyond, ~not_below)", "Mux(above, not_below, ~not_below)",
    ),
    "v = limit < 0 is v > limit": (MOTION, "& ~equal & ~exactly_negative", "& ~equal"),
    "a target in an abort": (
        MOTION, "with m.If(self.done):\n            m.d.sync += target.eq(0)\n        with m.Elif",
        "with m.If",
    ),
    "speed of the step before forgotten": (MOTION, "twice.eq(0)]", "twice.eq(1)]"),
    "a load makes a step": (MOTION, "moved[STEP_BIT] & ~self.load", "moved[STEP_BIT]"),
    "a sum that wraps has its sign": (
        MOTION, "Mux(v[31] ^ change[31], faster[31], v[31])", "faster[31]",
    ),
    "jerk goes on in an abort": (
        MOTION, "self.step & (at_once | self.aborting) |", "self.step & at_once |",
    ),
    "a target lasts": (MOTION, "has_target.eq(set_target)", "has_target.eq(1)"),
    "directions the other way": (MOTION, "self.up.eq(~self.negative)", "self.up.eq(self.negative)"),
}  # fmt: skip
SHARED_FAULTS = {
    "a target that is met exactly ends the profile": (SHARED, "crossed = ~zero & (", "crossed = ("),
    "jerk goes on at the target": (SHARED, "(self._cycle[1:] == 4)", "(self._cycle[1:] == 7)"),
    "registers cannot be written again in time": (SHARED, "place.eq(~Mux(", "place.eq(Mux("),
    "a write during a load is loaded": (
        SHARED, "Mux(self.load, newest[c][n], used[c][n])", "used[c][n]",
    ),
    "the last channel is forgotten": (
        SHARED, "channel == self._channels - 1", "channel == self._channels - 2",
    ),
    "velocities are set late": (
        SHARED, "self.step | self.load & bits[registers.SET_V]", "self.step",
    ),
    "a new limit comes too late": (
        SHARED, "self.step | new_limit | self.load", "self.step | self.load",
    ),
    "v = limit is v > limit": (SHARED, "down.eq(~result[32] & ~zero)", "down.eq(~result[32])"),
}  # fmt: skip


def found(fault, paths, **options):
    """Say whether one of the recordings comes out otherwise on a board with the fault."""
    name, old, new = fault
    module = faulty(name, old, new)
    parts = {key: value for key, value in vars(module).items() if hasattr(room, key)}
    boards = {}
    for path in paths:
        golden = load(path)
        settings = tuple(golden.settings.items())
        if settings not in boards:
            make = module.S3G if name == ROOM else room.S3G
            with patch.multiple(room, **parts):
                boards[settings] = RtlSimulation(make(**golden.settings, **options))
        boards[settings].reset()
        if golden.expected.first_difference(replay_on(boards[settings], golden)) is not None:
            return True
    return False


@pytest.mark.parametrize("fault", BOARD_FAULTS)
def test_recordings_find(fault):
    # An average is off at rates that do not divide the clock alone.
    slow = [GOLDEN / "proto_basic_std.npz"] if fault == "an enable too early" else []
    assert found(BOARD_FAULTS[fault], [*slow, *RECORDINGS])


def fails(test, *boards, seeds=range(8)):
    """Say whether a test of rules fails, for one of its seeds if it has some."""
    for seed in [(seed,) for seed in seeds] or [()]:
        try:
            test(*boards, *seed)
        except AssertionError:
            return True
    return False


@pytest.mark.parametrize("fault", PROGRAM_FAULTS)
def test_rules_of_programs_find(fault):
    module = faulty(*PROGRAM_FAULTS[fault])

    def all_of_them():
        program.test_a_source_wins_over_the_clearing_of_its_cycle(
            RtlSimulation(module.Interrupts(repeat=5))
        )
        executor = RtlSimulation(module.ProgramExecutor())
        program.test_busy_is_a_cycle_late_and_an_instruction_takes_two(executor)
        program.test_waits(executor, s3g.OP_WAIT_ALL, 0x21, 0b1111, True)
        program.test_an_output_waits_for_the_serial_one(executor)

    assert fails(all_of_them, seeds=())


@pytest.mark.parametrize("fault", PULSE_FAULTS)
def test_rules_of_pulses_find(fault):
    with patch.object(rules, "PulseFormer", faulty(*PULSE_FAULTS[fault]).PulseFormer):
        assert fails(rules.test_pulses_follow_thresholds_that_change, seeds=())


@pytest.mark.parametrize("fault", PROFILE_FAULTS)
def test_rules_of_profiles_find(fault):
    simulation = RtlSimulation(faulty(*PROFILE_FAULTS[fault]).ProfileGenerator())
    assert fails(rules.test_profiles_follow_the_rules, simulation)


@pytest.mark.parametrize("fault", SHARED_FAULTS)
def test_comparison_finds_with_shared_arithmetic(fault):
    shared = RtlSimulation(faulty(*SHARED_FAULTS[fault]).SharedProfiles(2))
    assert fails(rules.test_shared_profiles_do_the_same, (RtlSimulation(Profiles(2)), shared))
