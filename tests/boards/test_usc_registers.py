"""The register map of the USC against the tables of its document, typed by hand."""

import pytest

from pulsewright.boards.usc import registers
from pulsewright.boards.usc.registers import MAP, PROFILES
from pulsewright.registers.codec import decode, decode_bytes, encode, encode_bytes

# "Universal Stepper Controller Register Definition", the address table: address, read, write, as
# (register, instance, byte). Two entries of the write side are not in the document but written by
# the client: 06 and 0D; and 03, where the client writes the encoder control.
ADDRESS_TABLE = [
    (0x00, ("ENCODER_COUNT", 0, 0), ("ASSEMBLY", 0, 0)),
    (0x01, ("ENCODER_COUNT", 0, 1), ("ASSEMBLY", 0, 1)),
    (0x02, ("ENCODER_COUNT", 0, 2), ("ASSEMBLY", 0, 2)),
    (0x03, ("ENCODER_COUNT", 1, 0), ("ENCODER_CONTROL", 0, 0)),
    (0x04, ("ENCODER_COUNT", 1, 1), ("TIMER", 0, 0)),
    (0x05, ("ENCODER_COUNT", 1, 2), None),
    (0x06, ("ENCODER_COUNT", 2, 0), ("SLAVE", 0, 0)),
    (0x07, ("ENCODER_COUNT", 2, 1), None),
    (0x08, ("ENCODER_COUNT", 2, 2), None),
    (0x09, ("ENCODER_COUNT", 3, 0), None),
    (0x0A, ("ENCODER_COUNT", 3, 1), None),
    (0x0B, ("ENCODER_COUNT", 3, 2), None),
    (0x0C, ("INDEX_SENSE", 0, 0), ("ENCODER_CONTROL", 0, 0)),
    (0x0D, ("INPUTS_LOW", 0, 0), ("INDEX_RESET", 0, 0)),
    (0x0E, ("INPUTS_HIGH", 0, 0), None),
    (0x0F, ("IDENT", 0, 0), ("DAC", 0, 0)),
    (0x10, None, ("DIVISOR", 0, 0)),
    (0x11, None, ("DIVISOR", 0, 1)),
    (0x12, None, ("DIVISOR", 0, 2)),
    (0x13, None, ("DIVISOR", 1, 0)),
    (0x14, None, ("DIVISOR", 1, 1)),
    (0x15, None, ("DIVISOR", 1, 2)),
    (0x16, None, ("DIVISOR", 2, 0)),
    (0x17, None, ("DIVISOR", 2, 1)),
    (0x18, None, ("DIVISOR", 2, 2)),
    (0x19, None, ("DIVISOR", 3, 0)),
    (0x1A, None, ("DIVISOR", 3, 1)),
    (0x1B, None, ("DIVISOR", 3, 2)),
    (0x1C, None, ("RATE_CONTROL", 0, 0)),
    (0x1D, None, ("SETUP", 0, 0)),
    (0x1E, None, ("WIDTH", 0, 0)),
    (0x1F, None, ("OUTPUTS", 0, 0)),
]

# The bit tables of the document, bits 7 to 0; "" is none. Slave and index reset: the specification.
BIT_TABLES = {
    "W_ENCODER_CONTROL": [
        *("load axis 3", "load axis 2", "load axis 1", "load axis 0"),
        *("index_select axis 3", "index_select axis 2", "index_select axis 1"),
        "index_select axis 0",
    ],
    "W_TIMER": ["", "", "soft_latch", "master", "rate[3]", "rate[2]", "rate[1]", "rate[0]"],
    "R_INDEX_SENSE": [
        *("", "", "", ""),
        *("sensed axis 3", "sensed axis 2", "sensed axis 1", "sensed axis 0"),
    ],
    "W_RATE_CONTROL": ["run3", "dir3", "run2", "dir2", "run1", "dir1", "run0", "dir0"],
    "R_INPUTS_LOW": [f"inputs input {n}" for n in (7, 6, 5, 4, 3, 2, 1, 0)],
    "R_INPUTS_HIGH": ["running", *(f"inputs input {n}" for n in (14, 13, 12, 11, 10, 9, 8))],
    "R_IDENT": [
        *("type[3]", "type[2]", "type[1]", "type[0]"),
        *("version[3]", "version[2]", "version[1]", "version[0]"),
    ],
    "W_OUTPUTS": ["estop_release", *(f"ssr output {n}" for n in (6, 5, 4, 3, 2, 1, 0))],
    "W_SLAVE": ["", "", "", "", "", "", "", "enable"],
    "W_INDEX_RESET": ["", "", "", "", "axes axis 3", "axes axis 2", "axes axis 1", "axes axis 0"],
}


@pytest.mark.parametrize(("address", "read", "written"), ADDRESS_TABLE)
def test_every_address_holds_what_the_document_says(address, read, written):
    for side, expected in (("read", read), ("write", written)):
        place = MAP.at(side, address)
        found = place and (place.register.name, place.instance, place.byte)
        assert found == expected


def test_there_is_nothing_beyond_the_32_addresses():
    assert MAP.address_bits == 5
    assert all(MAP.at(side, a) is None for side in ("read", "write") for a in range(32, 256))


@pytest.mark.parametrize("key", BIT_TABLES)
def test_every_bit_means_what_the_document_says(key):
    register = MAP[key]
    found = [register.field_at(bit) for bit in range(7, -1, -1)]
    labels = [f.label(bit) if f else "" for f, bit in zip(found, range(7, -1, -1), strict=True)]
    assert labels == BIT_TABLES[key]


def test_registers_without_a_bit_table_are_one_value():
    whole = {r.key: r.fields[0].width for r in MAP.registers if r.key not in BIT_TABLES}
    assert whole == {
        "R_ENCODER_COUNT": 24,
        "W_ASSEMBLY": 24,
        "W_DIVISOR": 24,
        "W_DAC": 8,
        "W_SETUP": 8,
        "W_WIDTH": 8,
    }


def test_resets_are_those_of_the_specification():
    assert {r.key: r.reset for r in MAP.registers} == {
        "R_ENCODER_COUNT": 0,
        "R_INDEX_SENSE": 0,
        "R_INPUTS_LOW": None,  # levels of pins
        "R_INPUTS_HIGH": None,
        "R_IDENT": 0x41,
        "W_ASSEMBLY": 0,
        "W_ENCODER_CONTROL": 0,
        "W_TIMER": 0,
        "W_SLAVE": 0,
        "W_INDEX_RESET": 0,
        "W_DAC": 0,
        "W_DIVISOR": 0,
        "W_RATE_CONTROL": 0,
        "W_SETUP": 0xFE,
        "W_WIDTH": 0xFE,
        "W_OUTPUTS": 0,
    }
    assert MAP["R_INPUTS_HIGH"].field("running").reset == 0  # in estop


def test_special_behaviour_is_in_the_map():
    special = {
        "latched": [r.key for r in MAP.registers if r.latched],
        "assembled": [r.key for r in MAP.registers if r.assembly == "ASSEMBLY"],
        "commits": [r.key for r in MAP.registers if r.commits],
        "clear on read": [r.key for r in MAP.registers for f in r.fields if f.clear_on_read],
        "signed": [r.key for r in MAP.registers for f in r.fields if f.signed],
        "from version 2": [r.key for r in MAP.registers if r.min_version == 2],
        "aliases": {r.key: r.aliases for r in MAP.registers if r.aliases},
        "follows": {r.key: r.follows for r in MAP.registers if r.follows},
    }
    assert special == {
        "latched": ["R_ENCODER_COUNT"],
        "assembled": ["W_ASSEMBLY", "W_DIVISOR"],
        "commits": ["W_DIVISOR"],
        "clear on read": ["R_INDEX_SENSE"],
        "signed": ["R_ENCODER_COUNT"],
        "from version 2": ["W_INDEX_RESET"],
        "aliases": {"W_ENCODER_CONTROL": (0x03,)},
        "follows": {"R_IDENT": "ident"},
    }


def test_the_high_byte_of_each_axis_commits_its_divisor():
    committing = [a for a in range(32) if "commits" in (getattr(MAP.at("write", a), "label", ""))]
    assert committing == [0x12, 0x15, 0x18, 0x1B]


def test_every_written_register_says_when_it_takes_effect():
    assert [r.key for r in MAP.registers if r.side == "write" and not r.takes_effect] == []


def test_constants_are_those_of_the_document():
    assert registers.R_ENCODER_COUNT == (0x00, 0x03, 0x06, 0x09)
    assert (registers.R_INDEX_SENSE, registers.R_INPUTS_LOW) == (0x0C, 0x0D)
    assert (registers.R_INPUTS_HIGH, registers.R_IDENT) == (0x0E, 0x0F)
    assert (registers.W_ASSEMBLY, registers.W_TIMER, registers.W_SLAVE) == (0x00, 0x04, 0x06)
    assert registers.W_ENCODER_CONTROL == 0x0C
    assert registers.W_ENCODER_CONTROL_ALIAS == 0x03
    assert (registers.W_INDEX_RESET, registers.W_DAC) == (0x0D, 0x0F)
    assert registers.W_DIVISOR == (0x10, 0x13, 0x16, 0x19)
    assert (registers.W_RATE_CONTROL, registers.W_SETUP) == (0x1C, 0x1D)
    assert (registers.W_WIDTH, registers.W_OUTPUTS) == (0x1E, 0x1F)
    assert registers.W_TIMER_SOFT_LATCH_MASK == 0x20
    assert registers.W_TIMER_MASTER_MASK == 0x10
    assert registers.W_TIMER_RATE_MASK == 0x0F
    assert registers.W_ENCODER_CONTROL_LOAD_LSB == 4
    assert registers.W_OUTPUTS_ESTOP_RELEASE_MASK == 0x80
    assert registers.W_OUTPUTS_SSR_MASK == 0x7F
    assert registers.R_INPUTS_HIGH_RUNNING_MASK == 0x80
    assert (registers.W_RATE_CONTROL_RUN3_LSB, registers.W_RATE_CONTROL_DIR0_LSB) == (7, 0)
    assert (registers.CLOCK_HZ, registers.TICK_HZ) == (40_000_000, 10_000_000)
    assert registers.TICK_CYCLES == 4
    assert registers.TIMER_UNIT_TICKS == 1000  # 100 us
    assert registers.INTR_TICKS == 10  # 1 us
    assert registers.LOAD_HOLD_TICKS == 20  # "held for at least 2 uS"


def test_profiles_are_the_table_of_the_specification():
    both = {"ident": 0x41, "sense_gate": 0, "watchdog_us": 10_000, "mariss": 0, "loopback": 0}
    both |= {"base": 0, "enc_filter": 1}
    expected = {
        "document": {"div_offset": 1, "time_code": 255, "min_space": 1, **both},
        "linuxcnc": {"div_offset": 4, "time_code": 256, "min_space": 3, **both},
    }
    assert expected == PROFILES
    assert list(PROFILES) == ["document", "linuxcnc"]
    assert registers.DEFAULT_PROFILE == MAP.profiles[0] == "document"


def test_switches_name_their_allowed_values():
    allowed = {switch.name: switch.allowed for switch in MAP.switches}
    assert allowed["sense_gate"] == "always (0), gated (1)"
    assert allowed["base"] == "0..7"
    assert allowed["ident"] == "0x41..0x4E"  # version F is never used
    assert allowed["time_code"] == "255..256"


# Worked vectors of the specification, section 8, and the client's servo cycle, section 5.


def test_divisor_of_1_khz_goes_low_byte_first():
    assert encode_bytes(MAP["W_DIVISOR"], value=9999) == bytes([0x0F, 0x27, 0x00])
    assert encode_bytes(MAP["W_DIVISOR"], value=9996) == bytes([0x0C, 0x27, 0x00])


def test_holding_register_of_minus_two():
    assert decode_bytes(MAP["R_ENCODER_COUNT"], bytes([0xFE, 0xFF, 0xFF])) == {"value": -2}


def test_ident_of_the_document():
    assert decode(MAP["R_IDENT"], 0x41) == {"type": 4, "version": 1}
    assert [c.name for c in MAP["R_IDENT"].field("type").choices if c.value == 4] == ["usc"]


def test_axes_0_2_3_forward_and_1_in_reverse_running():
    run = {f"run{axis}": 1 for axis in range(4)}
    assert encode(MAP["W_RATE_CONTROL"], **run, dir0=1, dir1=0, dir2=1, dir3=1) == 0xFB


def test_index_pulse_of_axis_1():
    assert decode(MAP["R_INDEX_SENSE"], 0x02) == {"sensed": 0b0010}


def test_latch_and_load_of_the_client():
    assert encode(MAP["W_TIMER"], soft_latch=1) == 0x20
    assert encode(MAP["W_TIMER"], master=1) == 0x10
    assert encode(MAP["W_ENCODER_CONTROL"], load=0b1111) == 0xF0
    assert encode(MAP["W_OUTPUTS"], estop_release=1, ssr=0b1000001) == 0xC1
