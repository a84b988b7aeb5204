"""The gateware replays recordings of the original controller, and does the worked vectors.

Vectors are those of section 8 of the board's specification; cycles of the `extended` profile are
worked out by hand from its section 6.2.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from pulsewright.boards.pluto_step.gateware import PlutoStep
from pulsewright.gateware.rtl import RtlSimulation
from pulsewright.transport.bus import (
    ASAP,
    DATA_WRITE,
    EPP_ACCESS,
    read_accesses,
    write_accesses,
)

pytestmark = pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable")

GOLDEN = Path(__file__).parents[1] / "golden" / "pluto_step"

# Packing of the recordings: port, lowest bit, size (see the README beside them).
INPUTS = (
    *(("nwrite", 0, 1), ("ndatastr", 1, 1), ("naddrstr", 2, 1), ("nreset", 3, 1)),
    *(("data_i", 4, 8), ("din", 16, 16)),
)
OUTPUTS = (
    *(("step", 0, 4), ("dir", 4, 4), ("dout", 8, 14), ("led", 22, 1), ("tristate", 23, 1)),
    *(("nwait", 24, 1), ("nconfig", 25, 1), ("data_oe", 26, 1), ("data_o", 27, 8)),
)
HIGH_Z = ("step", "dir", "dout", "led")


SIMULATIONS = {}


def simulation(profile="exact"):
    """Return the board as after configuration; each profile is made once."""
    made = SIMULATIONS.setdefault(profile, None) or RtlSimulation(PlutoStep(profile))
    SIMULATIONS[profile] = made
    made.reset()
    return made


def unpack(data, which, ports, dtype):
    rows = np.zeros(len(data[f"{which}_delta"]), dtype)
    rows["cycle"] = np.cumsum(data[f"{which}_delta"], dtype=np.int64)
    for port, lsb, size in ports:
        rows[port] = data[f"{which}_word"].astype(np.uint64) >> np.uint64(lsb) & np.uint64(
            (1 << size) - 1
        )
    return rows


def as_recorded(rows):
    """Mask what is not driven, and drop rows in which nothing visible changes."""
    rows = rows.copy()
    for port in HIGH_Z:
        rows[port][rows["tristate"] == 1] = 0
    rows["data_o"][rows["data_oe"] == 0] = 0
    pins = [name for name in rows.dtype.names if name != "cycle"]
    changed = np.ones(len(rows), bool)
    changed[1:] = np.any([rows[pin][1:] != rows[pin][:-1] for pin in pins], axis=0)
    return rows[changed]


def replay(profile, path):
    """Say where the board first differs from a recording; None if nowhere."""
    board = simulation(profile)
    with np.load(path) as data:
        end = json.loads(str(data["meta"]))["n_cycles"]
        recorded = unpack(data, "out", OUTPUTS, board.outputs)
        seen = as_recorded(board.run(end, unpack(data, "in", INPUTS, board.inputs)))
    common = min(len(seen), len(recorded))
    different = np.flatnonzero(seen[:common] != recorded[:common])
    if len(different):
        return f"row {different[0]} is {seen[different[0]]}, recorded {recorded[different[0]]}"
    return None if len(seen) == len(recorded) else f"{len(seen)} rows, recorded {len(recorded)}"


@pytest.mark.parametrize("path", sorted(GOLDEN.glob("*.npz")), ids=lambda path: path.stem)
def test_every_pin_changes_when_it_did_on_the_original(path):
    assert replay("exact", path) is None


@pytest.mark.parametrize("name", ["p01_powerup_idle", "p02_dio", "p03_const_vel", "p09_servo_60ms"])
def test_the_extended_profile_equals_the_original_where_its_new_registers_are_not_used(name):
    # No cancelled reversal, merged pulse, change of tap or address beyond the original's in these.
    assert replay("extended", GOLDEN / f"{name}.npz") is None


class Session:
    """A board, bus cycles at chosen clock edges, and the outputs after each edge."""

    def __init__(self, profile="exact"):
        self.board = simulation(profile)
        self.rows = []

    def access(self, cycle, accesses):
        accesses["cycle"] = ASAP
        accesses["cycle"][0] = cycle + 2  # given is the edge that samples the strobe
        self.rows.append(self.board.transact(accesses))
        assert not accesses["timeout"].any()
        return bytes(accesses["value"][1:])

    def write(self, cycle, address, *data):
        """Address write at edge ``cycle``, and a data write every 10 edges after it."""
        self.access(cycle, write_accesses(address, bytes(data)))

    def read(self, cycle, address, count):
        return self.access(cycle, read_accesses(address, count))

    def run(self, end):
        self.rows.append(self.board.run(end))
        return self

    def levels(self, port, bit, edges):
        """Return a bit of a port just after each of some edges, as text."""
        rows = np.concatenate(self.rows)
        at = np.searchsorted(rows["cycle"], edges, side="right") - 1
        return "".join(str(level) for level in rows[port][at].astype(int) >> bit & 1)

    def changes(self, port, bit=0):
        """Return the edges after which a bit of a port is new."""
        rows = np.concatenate(self.rows)
        level = rows[port].astype(int) >> bit & 1
        return rows["cycle"][1:][np.diff(level) != 0].tolist()


def velocity(value):
    return value & 0xFF, value >> 8 & 0xFF


def timing(steptime=0, dirtime=0, tap=0, polarity=0):
    return steptime | tap << 6, dirtime | polarity << 7


def test_velocity_1024_steps_at_312_5_khz():  # vector 5
    session = Session()
    session.write(100, 0, *velocity(1024))
    session.run(600)
    assert session.changes("step") == [256, 320, 384, 448, 512, 576]
    assert session.changes("led") == [256, 320, 384, 448, 512, 576]
    assert session.changes("dir") == []


def test_negative_velocity_sets_the_direction_first():  # vector 6
    session = Session()
    session.write(100, 0, *velocity(-1024))
    session.run(600)
    assert session.changes("dir") == [192]
    assert session.changes("step") == [384, 448, 512, 576]
    assert session.changes("led") == [192, 384, 448, 512, 576]  # step XOR dir


def test_tap_and_polarity():  # vector 7
    session = Session()
    session.write(100, 10, *timing(tap=1, polarity=1))
    session.write(130, 0, *velocity(1024))
    session.run(800)
    assert session.changes("step", 0) == [122, 448, 512, 704, 768]
    assert session.changes("step", 3) == [122]
    assert session.changes("led") == [448, 512, 704, 768]


def test_a_strobe_that_is_gone_at_the_action_increments():  # vector 8
    session = Session()
    session.write(100, 0)
    stimulus = np.zeros(2, session.board.inputs)
    stimulus["cycle"] = [120, 121]
    stimulus["naddrstr"] = [0, 1]
    stimulus["ndatastr"], stimulus["nwrite"], stimulus["data_i"] = 1, [0, 1], 8
    session.rows.append(session.board.run(135, stimulus))
    accesses = np.zeros(2, EPP_ACCESS)
    accesses["op"], accesses["value"] = DATA_WRITE, [0x55, 0x02]
    session.access(140, accesses)
    session.run(400)
    # Velocity 500h = 1280: bit 11 toggles at the second tick, 256, so a step at 320.
    assert session.changes("step") == [320, 384]
    assert not np.concatenate(session.rows)["dout"].any()


def test_the_watchdog_expires_at_its_127th_tick():  # vector 9
    session = Session()
    session.write(100, 8, 0xFF, 0x40)
    session.run(260_200)
    assert session.levels("dout", 0, [121, 122]) == "01"
    assert session.changes("tristate") == [127 * 2048 - 1]
    # A feed ends it at its own edge; a write without the bit does not.
    session.write(260_300, 8, 0, 0)
    session.write(260_400, 8, 0, 0x40)
    assert session.changes("tristate")[1:] == [260_422]


def test_writes_above_0fh_are_aliases():  # vector 10
    session = Session()
    session.write(100, 0x11, 0x04)
    session.run(300)
    assert session.changes("step") == [256]


@pytest.mark.parametrize(
    ("value", "direction", "steps"), [(1, [], [2048, 4096]), (-1, [1], [4, 2052])]
)
def test_the_slowest_velocity(value, direction, steps):  # vectors 11 and 12
    session = Session()
    session.write(100, 0, *velocity(value))
    session.run(128 + 64 * 4097)
    assert session.changes("dir") == [128 + 64 * tick for tick in direction]
    assert session.changes("step")[::2][:2] == [128 + 64 * tick for tick in steps]


@pytest.mark.parametrize(
    ("value", "steptime", "step"),
    [(2047, 3, "001111011110"), (512, 2, "000011101110")],
)
def test_merged_pulses_and_the_limit_before_them(value, steptime, step):  # vectors 13 and 14
    session = Session()
    session.write(10, 10, *timing(steptime))
    session.write(80, 0, *velocity(value))  # tick 0 is edge 128
    session.run(1000)
    assert session.levels("step", 0, 128 + 64 * np.arange(12)) == step


def cancelled_reversal(profile):
    """Vector 15: S = 1, T = 2, |v| = 1024, negative in ticks 4 to 6 and from 9 on."""
    session = Session(profile)
    session.write(10, 10, *timing(1, 2))
    for tick, value in ((0, 1024), (4, -1024), (7, 1024), (9, -1024)):
        session.write(640 + 64 * tick - 40, 0, *velocity(value))
    session.run(640 + 64 * 20)
    ticks = 640 + 64 * np.arange(19)
    return session.levels("step", 0, ticks), session.levels("dir", 0, ticks)


def test_a_cancelled_reversal_flips_dir_while_step_is_high():
    step, direction = cancelled_reversal("exact")
    assert step[:16] == "0011110001111110"
    assert direction[:16] == "0000000000011111"


def test_clean_cancel_holds_before_the_next_reversal():
    step, direction = cancelled_reversal(clean_cancel())
    assert step[:18] == "001111000110000000"
    assert direction[:18] == "000000000000001111"


def test_clean_cancel_ends_the_hold_time():
    session = Session(clean_cancel())
    session.write(10, 10, *timing(0, 10))
    for tick, value in ((0, 1024), (4, -1024), (6, 1024)):  # holds from tick 5 on
        session.write(640 + 64 * tick - 40, 0, *velocity(value))
    session.run(640 + 64 * 13)
    assert session.levels("step", 0, 640 + 64 * np.arange(12)) == "001010001010"


def clean_cancel():
    """Name the `exact` profile with this one switch on."""
    if "clean_cancel" not in SIMULATIONS:
        SIMULATIONS["clean_cancel"] = RtlSimulation(PlutoStep(clean_cancel=1))
    return "clean_cancel"


def status(session, cycle):
    return session.read(cycle, 0x18, 4)[0]


def test_pulses_keep_their_space_and_none_is_missed_at_the_limit():
    session = Session("extended")
    session.write(10, 12, 1, 0)  # space 1, steptime 0: the limit is 2048 / 3 = 682
    session.write(600, 0, *velocity(682))
    session.write(640 + 64 * 300 - 40, 0, *velocity(0))
    session.run(21_000)
    edges = np.array(session.changes("step"))
    # 300 ticks give 204 600 units, which is 99.9 steps.
    assert len(edges) == 2 * 99
    assert (edges[1::2] - edges[::2] == 64).all()
    assert (edges[2::2] - edges[1:-1:2]).min() >= 128
    assert status(session, 21_100) == 0


def test_missed_steps_are_told_once():
    session = Session("extended")
    session.write(10, 12, 1, 0)
    session.write(70, 2, *velocity(1024))  # axis 1: due every other tick, room every third
    session.run(10_000)
    edges = np.array(session.changes("step", 1))
    assert (edges[2::2] - edges[1:-1:2]).min() == 128
    session.write(10_000, 2, *velocity(0))
    assert status(session, 10_300) == 0x20
    assert status(session, 10_400) == 0


@pytest.mark.parametrize(("profile", "steps"), [("exact", 2), ("extended", 1)])
def test_a_change_of_tap_makes_a_spurious_step_on_the_original_only(profile, steps):
    session = Session(profile)
    session.write(600, 0, *velocity(1024))
    session.write(640 + 64 * 3 - 40, 0, *velocity(0))
    # Three ticks give 3072 units: bit 11, which made a step, is 1 and bit 12 is 0.
    session.write(1200, 10, *timing(tap=1))
    session.run(1600)
    assert len(session.changes("step")) == 2 * steps


def test_a_tap_written_right_before_a_tick_is_used_by_it():
    session = Session()
    session.write(600, 0, *velocity(1024))
    session.write(640 + 64 * 3 - 40, 0, *velocity(0))
    session.write(1280 - 1 - 22, 10, *timing(tap=1))  # commits at edge 1279
    session.run(1600)
    assert session.changes("step")[2:] == [1280, 1344]


def test_joint_velocities_act_with_the_outputs():
    session = Session("extended")
    session.write(10, 14, 1, 0)
    session.write(70, 0, *velocity(1024), *velocity(1024))
    session.run(2000)
    assert not session.changes("step", 0) + session.changes("step", 1)
    session.write(2010, 8, 0, 0)  # acts before the tick at 2048: a step after two more
    session.run(2300)
    assert session.changes("step", 0) == session.changes("step", 1) == [2176, 2240]


def test_without_the_joint_bit_a_velocity_acts_at_once_and_stays_staged():
    session = Session("extended")
    session.write(10, 0, *velocity(1024))
    session.write(600, 14, 1, 0)
    session.write(700, 2, *velocity(1024))
    session.write(1900, 8, 0, 0)
    session.run(2300)
    edges = session.changes("step", 0)
    assert np.diff(edges).tolist() == [64] * (len(edges) - 1)
    assert session.changes("step", 1)[:1] == [2112]  # third tick after the commit at 1922


@pytest.mark.parametrize(("stop", "moves"), [(0, True), (2, False)])
def test_an_expired_watchdog_stops_the_axes_if_it_shall(stop, moves):
    session = Session("extended")
    session.write(10, 14, stop, 0)
    session.write(70, 8, 0, 0x40)
    session.write(130, 0, *velocity(1024))
    session.run(261_000)
    assert session.changes("step")[0] == 320  # runs until then
    positions = [session.read(cycle, 0, 4) for cycle in (261_100, 262_100)]
    assert (positions[0] != positions[1]) == moves
    assert status(session, 262_300) == 0b11  # expired and enabled


def test_extended_registers():
    session = Session("extended")
    session.write(100, 0x11, 0x04)  # no alias
    session.write(140, 0x19, 0x40)  # arms nothing
    assert session.read(1000, 0x14, 4) == b"\x04\x01WP"
    # The first data read acts at edge 1112, after the ticks at 0, 64, ..., 1088.
    assert session.read(1100, 0x1C, 4) == bytes([18, 0, 0, 0])
    # It acts at edge 1216, which is a tick, and does not count that one: 0, 64, ..., 1152.
    assert session.read(1216 - 12, 0x1C, 4) == bytes([19, 0, 0, 0])
    assert status(session, 1300) == 0
    assert session.run(2000).changes("step") == []


def test_nwait_can_idle_low():
    board = RtlSimulation(PlutoStep(nwait_idle=0))
    accesses = write_accesses(8, b"\x34\x12")
    rows = board.transact(accesses, nwait_idle=0)
    assert not accesses["timeout"].any()
    assert (rows["nwait"][0], rows["dout"][-1]) == (0, 0x1234)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"profile": "fast"}, "no profile 'fast'; it has exact, extended"),
        ({"clean_cancle": 1}, "no profile switch clean_cancle; it has clean_cancel"),
    ],
)
def test_an_unknown_profile_or_switch_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        PlutoStep(**arguments)
