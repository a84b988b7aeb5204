"""The register map of RAPcores against the tables of its document, typed by hand."""

import pytest

from pulsewright.app.regs import table
from pulsewright.boards.rapcores import registers
from pulsewright.boards.rapcores.registers import MAP, PROFILES
from pulsewright.registers.codec import decode, encode
from pulsewright.registers.generate import CHECKOUT
from pulsewright.registers.render import c_header, html, json, markdown

# "Configuration Register - Read/Write" of the document: entry, bit fields from bit 0 up.
CONFIGURATION = [
    (0x00, [(32, "Motor Enable Mask")]),
    (0x01, [(32, "Motor Brake-on-Disable Mask")]),
    (0x02, [(8, "DDA Clock Divider")]),
]

# "Status Register - Read Only" of the document.
STATUS = [
    (0x00, [(8, "Patch"), (8, "Minor"), (8, "Major"), (8, "Devel")]),
    (
        0x01,
        [
            (8, "Motor Count"),
            (8, "Encoder Count"),
            (8, "Encoder Position Bits"),
            (8, "Encoder Velocity Bits"),
        ],
    ),
    (0x02, [(32, "Encoder Fault mask")]),
    (0x03, [(32, "Motor Fault mask")]),
    (0x04, [(32, "Encoder Position")]),  # channel 0
    # 0x24 "channel 31" is the 33rd entry: channel 31 is at 0x23
    (0x23, [(32, "Encoder Position")]),
]

# What the document's fields are called here.
NAMES = {
    "Motor Enable Mask": "enable",
    "Motor Brake-on-Disable Mask": "brake",
    "DDA Clock Divider": "divider",
    "Patch": "patch",
    "Minor": "minor",
    "Major": "major",
    "Devel": "devel",
    "Motor Count": "motors",
    "Encoder Count": "encoders",
    "Encoder Position Bits": "position_bits",
    "Encoder Velocity Bits": "velocity_bits",
    "Encoder Fault mask": "fault",
    "Motor Fault mask": "fault",
    "Encoder Position": "position",
}

# Specification, 2.2: name, address, instances, reset word, [(field, highest bit, lowest bit)].
STATUS_SPEC = [
    ("VERSION", 0x00, 1, 0x01000300, None),
    ("CHANNEL_INFO", 0x01, 1, 0x20200404, None),
    ("ENCODER_FAULT", 0x02, 1, 0, None),
    ("MOTOR_FAULT", 0x03, 1, 0, None),
    ("ENCODER_POSITION", 0x04, 64, 0, [("position", 31, 0)]),
    ("ENCODER_VELOCITY", 0x44, 64, 0, [("velocity", 31, 0)]),
    ("PHASE_ANGLE", 0x84, 32, 0, [("angle", 9, 0)]),
    ("STEP_POSITION", 0xC0, 32, 0, [("position", 31, 0)]),
    (
        *("BUFFER_STATE", 0xE0, 1, 0x200),
        [
            *(("used", 7, 0), ("depth", 15, 8), ("executing", 16, 16)),
            *(("halted", 17, 17), ("halt_seen", 18, 18)),
        ],
    ),
    ("TICKS_LEFT", 0xE1, 1, 0, [("ticks", 31, 0)]),
    ("MOVES_COMPLETED", 0xE2, 1, 0, [("count", 31, 0)]),
    ("MOVES_REFUSED", 0xE3, 1, 0, [("count", 31, 0)]),
    ("FRAMING_ERRORS", 0xE4, 1, 0, [("count", 31, 0)]),
    ("ABORTED_MESSAGES", 0xE5, 1, 0, [("count", 31, 0)]),
    ("UNKNOWN_HEADERS", 0xE6, 1, 0, [("count", 31, 0)]),
    ("STEP_LOST", 0xE7, 1, 0, [("lost", 31, 0)]),
    ("ENCODER_FAULT_HI", 0xE8, 1, 0, [("fault", 31, 0)]),
    ("PULSES_PENDING", 0xE9, 1, 0, [("pending", 31, 0)]),
    (
        *("BUILD_PARAMETERS", 0xFE, 1, 0x2040),
        # the motor driver is ours beyond the specification
        [("word_bits", 7, 0), ("integer_bits", 15, 8), ("motor_driver", 16, 16)],
    ),
    ("BUILD_ID", 0xFF, 1, 0x52430001, [("id", 31, 0)]),
]

# Specification, 2.3.
CONFIGURATION_SPEC = [
    ("ENABLE", 0x00, 1, 0, None),
    ("BRAKE", 0x01, 1, 0, None),
    ("DIVIDER", 0x02, 1, 40, None),
    ("STEP_WIDTH", 0xC0, 1, 20, [("cycles", 15, 0)]),
    ("STEP_LOW", 0xC1, 1, 20, [("cycles", 15, 0)]),
    ("DIR_SETUP", 0xC2, 1, 20, [("cycles", 15, 0)]),
    ("DIR_HOLD", 0xC3, 1, 20, [("cycles", 15, 0)]),
    ("CONTROL", 0xC4, 1, 0, [("halt", 0, 0)]),
    (
        *("CLEAR", 0xC5, 1, 0),
        [
            *(("counters", 0, 0), ("encoder_fault", 1, 1)),
            *(("step_lost", 2, 2), ("halt_seen", 3, 3)),
        ],
    ),
    ("STEP_POLARITY", 0xC6, 1, 0, [("invert", 31, 0)]),
    ("DIR_POLARITY", 0xC7, 1, 0, [("invert", 31, 0)]),
    ("CURRENT", 0xD0, 32, 0, [("current", 7, 0)]),  # ours beyond the specification
]

# Specification, 2.1 and appendix A.
HEADERS = {"NOP": 0x00, "MOVE": 0x01, "STATUS_READ": 0xF1, "CONFIG_SWAP": 0xF2, "CONFIG_READ": 0xF3}
HEADERS_V020 = {
    **{"ENCODER": 0x03, "ENABLE": 0x0A, "BRAKE": 0x0B, "MOTOR": 0x10, "DIVIDER": 0x20},
    **{"CHOPPER": 0x30, "CHARGE_PUMP": 0x31, "BRIDGE": 0x32, "MOTOR_FAULT": 0x50},
    **{"ENCODER_FAULT": 0x51, "CHANNEL_INFO": 0xFD, "VERSION": 0xFE},
}


@pytest.mark.parametrize(("side", "rows"), [("write", CONFIGURATION), ("read", STATUS)])
def test_registers_and_bits_are_those_of_the_document(side, rows):
    for address, fields in rows:
        register = MAP.at(side, address).register
        found = {field.name: (field.lsb, field.width) for field in register.fields}
        lsb, expected = 0, {}
        for width, name in fields:
            expected[NAMES[name]] = (lsb, width)
            lsb += width
        assert found == expected, f"{address:02X}"


@pytest.mark.parametrize(("side", "rows"), [("read", STATUS_SPEC), ("write", CONFIGURATION_SPEC)])
def test_registers_and_bits_are_those_of_the_specification(side, rows):
    assert [(r.name, r.addresses[0]) for r in MAP.registers if r.side == side] == [
        (name, address) for name, address, *_ in rows
    ]
    for name, address, instances, reset, fields in rows:
        register = MAP[f"{side[0].upper()}_{name}"]
        assert register.addresses == tuple(range(address, address + instances))
        assert (register.size, register.reset) == (4, reset)
        if fields is not None:
            assert [(f.name, f.msb, f.lsb) for f in reversed(register.fields)] == fields


def test_everything_else_is_unused():
    used = {side: {n for n in range(256) if MAP.at(side, n)} for side in ("read", "write")}
    assert used["read"] == {*range(0xA4), *range(0xC0, 0xEA), 0xFE, 0xFF}
    assert used["write"] == {0, 1, 2, *range(0xC0, 0xC8), *range(0xD0, 0xF0)}


def test_addresses_are_numbers_of_registers_in_hexadecimal():
    assert MAP.numbered
    assert not MAP.decimal
    assert (registers.R_BUFFER_STATE, registers.W_CLEAR) == (0xE0, 0xC5)
    assert tuple(range(0x44, 0x84)) == registers.R_ENCODER_VELOCITY
    assert registers.R_PHASE_ANGLE[31] == 0xA3
    page = markdown(MAP)
    assert "Address `44..83`" in page
    assert "Address `E0`, 4 bytes, reset `00000200`." in page
    assert "Addresses and words are hexadecimal." in page


def test_headers():
    for prefix, expected in (("HEADER", HEADERS), ("HEADER_V020", HEADERS_V020)):
        assert {code.name: code.value for code in MAP.table(prefix).codes} == expected
        for name, value in expected.items():
            assert getattr(registers, f"{prefix}_{name}") == value


def test_constants():
    # specification, 1
    assert registers.CLOCK_HZ == 16_000_000
    assert (registers.MOTORS, registers.ENCODERS, registers.DEPTH) == (4, 4, 2)
    assert (registers.MAX_MOTORS, registers.MAX_MOTORS_32, registers.MAX_ENCODERS) == (32, 24, 64)
    assert (registers.WORD_BITS, registers.MAX_DEPTH, registers.RESET_CYCLES) == (64, 64, 255)
    assert (registers.POSITION_BITS, registers.VELOCITY_BITS, registers.INTEGER_BITS) == (32,) * 3
    # 2.2, 3.2, 4.4, A
    assert (registers.VERSION, registers.VERSION_V020) == (0x01000300, 0x01000200)
    assert registers.BUILD_ID == MAP["R_BUILD_ID"].reset == 0x52430001
    assert (registers.MIN_HALF_PERIOD, registers.BACKLOG) == (6, 128)


def test_signs_and_owners_of_bits():
    signed = {r.key for r in MAP.registers if any(field.signed for field in r.fields)}
    assert signed == {"R_ENCODER_POSITION", "R_ENCODER_VELOCITY", "R_STEP_POSITION"}
    assert decode(MAP["R_STEP_POSITION"], 0xFFFFFFFC) == {"position": -4}
    assert encode(MAP["W_CLEAR"], halt_seen=1) == 8
    assert MAP["R_ENCODER_FAULT"].fields[0].label(5) == "fault encoder 5"
    assert MAP["R_ENCODER_FAULT_HI"].fields[0].label(5) == "fault encoder 37"
    assert MAP["W_ENABLE"].fields[0].label(31) == "enable motor 31"


def test_profiles():
    assert tuple(PROFILES) == ("document", "upstream", "v020")
    # specification, 3.3 and 6
    assert PROFILES["document"] == {"fixed": 0, "cs_reset_message": 1, "v020_info": 0}
    original = {"fixed": 0, "cs_reset_message": 0, "v020_info": 0}
    assert PROFILES["upstream"] == PROFILES["v020"] == original


@pytest.mark.parametrize("render", [markdown, html, json, c_header, table])
def test_pages_name_every_register_and_header(render):
    page = render(MAP)
    for register in MAP.registers:
        assert register.key in page or register.name in page
    for name in HEADERS:
        assert name in page


def test_c_header_is_in_the_checkout():
    text = (CHECKOUT / "docs/registers/rapcores.h").read_text()
    assert "#define RAPCORES_R_ENCODER_POSITION(n) (0x04u + 1u * (n))" in text
    assert "#define RAPCORES_W_CLEAR_HALT_SEEN_MASK 0x00000008u" in text
    assert "#define RAPCORES_HEADER_STATUS_READ 0xF1u" in text
