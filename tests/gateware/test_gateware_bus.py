"""EPP port and register bank: expected cycles are those of the specifications' worked vectors."""

import numpy as np
import pytest

from pulsewright.boards.pluto_step import registers as pluto
from pulsewright.boards.usc import registers as usc
from pulsewright.gateware.epp import EppPort
from pulsewright.gateware.register_bank import WriteBank

pytestmark = pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable")


def cycles_where(levels):
    return np.flatnonzero(levels).tolist()


def bus(*accesses):
    """Inputs for accesses (cycle, op, byte): five edges of strobe from ``cycle`` on."""
    pins = {"nwrite": {0: 1}, "ndatastr": {0: 1}, "naddrstr": {0: 1}, "data_i": {0: 0}}
    for cycle, op, byte in accesses:
        strobe = "naddrstr" if op in "Aa" else "ndatastr"
        pins[strobe] |= {cycle: 0, cycle + 5: 1}
        pins["nwrite"][cycle] = int(op in "Ra")
        pins["data_i"][cycle] = byte
    return pins


def test_action_and_acknowledge_of_an_address_write(simulate):
    pins = bus((10, "A", 0x08))
    pins["nwrite"][15] = 1  # together with the release
    seen = simulate(EppPort(), 30, **pins, rdata=0x5A)
    assert cycles_where(seen["address"] == 8) == list(range(12, 30))
    assert cycles_where(seen["nwait"] == 0) == list(range(14, 19))
    assert cycles_where(seen["data_oe"]) == list(range(15, 19))
    assert seen["data_o"][15] == 0x5A


def test_data_accesses_increment_and_wrap_and_address_reads_do_not(simulate):
    seen = simulate(
        EppPort(),
        60,
        **bus((10, "A", 0xFE), (20, "W", 0), (30, "R", 0), (40, "a", 0), (50, "W", 0)),
    )
    # nothing is in front of the edge that acts; bits 7:5 are ignored
    assert [seen["address"][n] for n in (11, 12, 22, 32, 42, 52)] == [0, 0x1E, 0x1F, 0, 0, 1]
    assert cycles_where(seen["action"]) == [11, 21, 31, 41, 51]
    assert cycles_where(seen["write"]) == [21, 51]
    assert cycles_where(seen["read"]) == [31, 41]


def test_a_strobe_of_one_cycle_increments(simulate):
    pins = bus((10, "A", 0x08))
    pins["naddrstr"] = {0: 1, 10: 0, 11: 1}
    seen = simulate(EppPort(), 20, **pins)
    assert cycles_where(seen["address"] == 1) == list(range(12, 20))
    assert cycles_where(seen["nwait"] == 0) == [14]


def test_both_strobes_load_the_address_and_write_to_the_old_one(simulate):
    pins = bus((10, "A", 0x08))
    pins["ndatastr"] |= {10: 0, 15: 1}
    seen = simulate(EppPort(), 20, **pins)
    assert cycles_where(seen["write"]) == [11]
    assert (seen["address"][11], seen["address"][12]) == (0, 8)


def test_only_the_selected_board_answers(simulate):
    pins = bus((10, "A", 0x2F), (20, "W", 1), (30, "A", 0x0F), (40, "W", 1))
    seen = simulate(EppPort(base=0, nwait_idle=0), 50, **pins)
    assert cycles_where(seen["nwait"]) == [*range(34, 39), *range(44, 49)]
    assert cycles_where(seen["write"]) == [41]
    assert seen["address"][39] == 0x0F
    assert seen["address"][49] == 0x10


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"address_bits": 9}, "address_bits must be 1 to 8"),
        ({"base": 8}, "base must be 0 to 7"),
        ({"nwait_idle": 2}, "nwait_idle must be 0 or 1"),
    ],
)
def test_a_wrong_parameter_is_named(options, message):
    with pytest.raises(ValueError, match=message):
        EppPort(**options)


def writes(*pairs):
    """Inputs that write byte after byte, each for one cycle, from cycle 1 on, every other cycle."""
    pins = {"write": {0: 0}, "address": {0: 0}, "data": {0: 0}}
    for n, (address, byte) in enumerate(pairs):
        cycle = 1 + 2 * n
        pins["write"] |= {cycle: 1, cycle + 1: 0}
        pins["address"][cycle], pins["data"][cycle] = address, byte
    return pins


def pluto_bank(**options):
    words = ("VELOCITY", "OUTPUTS", "TIMING")
    return WriteBank(pluto.MAP, present=words, **{"stray_addresses": range(32)} | options)


def test_the_high_byte_commits_with_the_latch(simulate):
    seen = simulate(pluto_bank(), 8, **writes((8, 0x34), (9, 0x12), (3, 0x05)))
    levels = seen["outputs"] & pluto.W_OUTPUTS_LEVELS_MASK
    assert levels.tolist() == [0, 0, 0, 0x1234, 0x1234, 0x1234, 0x1234, 0x1234]
    # A lone high byte takes the low byte of the register before it.
    assert seen["velocity__1"].tolist() == [0, 0, 0, 0, 0, 0x534, 0x534, 0x534]


@pytest.mark.parametrize(
    ("address", "acts"), [(0x11, True), (0x0D, False), (0x0F, False), (0x1E, False)]
)
def test_which_addresses_commit_and_which_feed_the_latch(simulate, address, acts):
    seen = simulate(pluto_bank(), 6, **writes((address, 0x04), (1, 0x02)))
    assert seen["velocity__0"][2] == (0x400 if acts else 0)
    assert seen["velocity__0"][4] == (0x200 if acts else 0x204)


def test_without_aliases_nothing_happens_there(simulate):
    bank = pluto_bank(aliases=False, stray_addresses=range(16))
    seen = simulate(bank, 6, **writes((0x10, 0x77), (0x11, 0x04), (1, 0x02)))
    assert seen["velocity__0"][5] == 0x200


def test_fields_land_where_the_map_says(simulate):
    bank = pluto_bank()
    seen = simulate(bank, 5, **writes((10, 0x7D), (11, 0x93)))
    # polarity 1, dirtime 3, tap 1, steptime 13; bits 5:4 and 14:12 are nobody's
    assert seen["timing"][4] == 0x834D


def test_an_assembly_register_takes_every_byte_and_resets_come_from_the_map(simulate):
    seen = simulate(WriteBank(usc.MAP), 12, **writes((0x10, 0x0F), (0x11, 0x27), (0x12, 0x01)))
    assert seen["divisor__0"].tolist() == [0] * 5 + [0x01270F] * 7
    assert seen["assembly"].tolist() == [0, 0x0F, 0x0F, 0x270F, 0x270F] + [0x01270F] * 7
    assert seen["setup"][0] == seen["width"][0] == 0xFE


def test_an_unknown_register_is_named():
    with pytest.raises(ValueError, match="pluto_step has no write register FOO; it has VELOCITY"):
        WriteBank(pluto.MAP, present=("FOO",))
