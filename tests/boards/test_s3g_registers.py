"""The register map of the S3G board against the tables of its document, typed by hand."""

import pytest

from pulsewright.app.regs import table
from pulsewright.boards.s3g import registers
from pulsewright.boards.s3g.registers import MAP, PROFILES
from pulsewright.errors import UsageError
from pulsewright.registers.codec import decode, encode, encode_bytes
from pulsewright.registers.generate import CHECKOUT
from pulsewright.registers.render import c_header, html, json, markdown

# "Outputs" of the document: number, name, [(name, highest bit, lowest bit)]. Its names of
# registers 8 to 15 begin with APG_X_, for the one channel that it has.
OUTPUTS = [
    (0, "LEDS", [("leds", 7, 0)]),
    (1, "ASG_STEPS_VAL", [("value", 31, 0)]),
    (2, "ASG_DT_VAL", [("value", 31, 0)]),
    (4, "MSG_ALL_PRE_N", [("value", 31, 0)]),
    (5, "MSG_ALL_PULSE_N", [("value", 31, 0)]),
    (6, "MSG_ALL_POST_N", [("value", 31, 0)]),
    (8, "X_VAL_LO", [("value", 31, 0)]),
    (9, "X_VAL_HI", [("value", 31, 0)]),
    (10, "V_VAL", [("value", 31, 0)]),
    (11, "A_VAL", [("value", 31, 0)]),
    (12, "J_VAL", [("value", 31, 0)]),
    (13, "JJ_VAL", [("value", 31, 0)]),
    (14, "TARGET_V_VAL", [("value", 31, 0)]),
    (15, "ABORT_A_VAL", [("value", 31, 0)]),
    (62, "BE_START_ADDR", [("address", 15, 0)]),
    (63, "SE_REG_LB", [("value", 31, 0)]),
]

# "Inputs" of the document.
INPUTS = [
    (0, "ASG_DT", [("value", 31, 0)]),
    (1, "ASG_STEP", [("value", 31, 0)]),
    (62, "BE_CONTROL", [("busy", 31, 31), ("waiting", 30, 30), ("error", 23, 16), ("pc", 15, 0)]),
    (63, "SE_REG_LB", [("value", 31, 0)]),
]

# Interrupts, strobes, replies, commands and program words of the document; the report's code is 80
# in decimal, and "BufError" is BUF_ERROR here.
CODES = {
    "INT": {"ASG_DONE": 0, "ASG_ABORT": 1, "BE_COMPLETE": 30, "SE_INT_LB": 31},
    "STB": {"ASG_LOAD": 0, "BE_START": 29, "BE_ABORT": 30, "SE_INT_LB": 31},
    "REPLY": {"INTERRUPT": 80, "ERROR": 0x80, "OK": 0x81, "BUF_ERROR": 0x82, "UNKNOWN": 0x85},
    "CMD": {
        **{"VERSION": 0, "EXT_VER": 27, "OUTPUT": 60, "INPUT": 61, "STB": 62},
        **{"CLEAR": 63, "MASK": 64, "WRITE_BUFFER": 65},
    },
    "CLASS": {"OUTPUT": 0b01, "CONTROL": 0b10},
    "OP": {"NOP": 0, "STB": 1, "WAIT_ALL": 2, "WAIT_ANY": 3, "CLEAR": 4, "DONE": 63},
    # "set X" to "set target V" are bits 8 to 13 of register 3
    "SET": {"X": 0, "V": 1, "A": 2, "J": 3, "JJ": 4, "TARGET_V": 5},
    # specification, 2.2
    "BE": {"RUNNING": 0, "WAITING": 2, "ILLEGAL": 0x81, "ABORTED": 0x82},
}

# Offsets of arguments in a payload, counted behind tag and code, with their sizes.
ARGUMENTS = {
    "OUTPUT": [("register", 0, 1), ("value", 1, 4)],
    "INPUT": [("register", 0, 1)],
    "STB": [("mask", 0, 4)],
    "CLEAR": [("mask", 0, 4)],
    "MASK": [("mask", 0, 4)],
    "WRITE_BUFFER": [("count", 0, 1), ("address", 1, 2), ("words", 3, 5)],
    "VERSION": [],
    "EXT_VER": [],
}
REPLIES = {
    "VERSION": [("version", 0, 2)],
    "EXT_VER": [("version", 0, 8)],
    "INPUT": [("value", 0, 4)],
    "WRITE_BUFFER": [("address", 0, 2), ("error", 2, 1), ("pc", 3, 2)],
    **{name: [] for name in ("OUTPUT", "STB", "CLEAR", "MASK")},
}


@pytest.mark.parametrize(("side", "rows"), [("write", OUTPUTS), ("read", INPUTS)])
def test_registers_and_bits_are_those_of_the_document(side, rows):
    for number, name, fields in rows:
        place = MAP.at(side, number)
        assert (place.register.name, place.instance, place.byte) == (name, 0, 0)
        assert [(f.name, f.msb, f.lsb) for f in place.register.fields] == fields
        assert getattr(registers, f"{side[0].upper()}_{name}") in (
            number,
            tuple(range(number, 56, 8)),
        )
        assert (place.register.size, place.register.reset) == (4, 0)


def test_everything_else_is_unused():
    used = {side: {n for n in range(64) if MAP.at(side, n)} for side in ("read", "write")}
    assert used["read"] == {0, 1, 62, 63}
    # channels 1 to 5 and the load control of 3 to 5: specification, 2.5
    assert used["write"] == {*range(56), 60, 62, 63}
    assert MAP.numbered


def test_load_and_motor_control_of_the_document_and_of_more_channels():
    # bits 0 to 3 and 8 to 13 are the document's; 8 + 8 c to 13 + 8 c the specification's, 2.5
    control = MAP["W_ASG_CONTROL"]
    assert [(f.name, f.lsb, f.width) for f in reversed(control.fields)] == [
        *(("steps_limit", 0, 1), ("dt_limit", 1, 1), ("reset_steps", 2, 1), ("reset_dt", 3, 1)),
        *(("channel0", 8, 6), ("channel1", 16, 6), ("channel2", 24, 6)),
    ]
    second = MAP["W_ASG_CONTROL2"]
    assert second.addresses == (60,)
    assert [(f.name, f.lsb, f.width) for f in reversed(second.fields)] == [
        *(("channel3", 0, 6), ("channel4", 8, 6), ("channel5", 16, 6)),
    ]
    enable = MAP["W_MSG_CONTROL"].field("enable")
    assert (enable.lsb, enable.width, enable.per) == (0, 6, "channel")
    assert [MAP.at("write", 10 + 8 * c).label for c in range(6)] == [
        f"Channel {c} velocity" for c in range(6)
    ]


@pytest.mark.parametrize("prefix", CODES)
def test_codes_are_those_of_the_document(prefix):
    codes = MAP.table(prefix)
    assert {code.name: code.value for code in codes.codes} == CODES[prefix]
    for name, value in CODES[prefix].items():
        assert getattr(registers, f"{prefix}_{name}") == value
        assert (codes.at(value), codes[name].value) == (codes[name], value)
    assert codes.at(77) is None


def layout(arguments):
    rows, offset = [], 0
    for argument in arguments:
        rows.append((argument.name, offset, argument.size))
        offset += argument.size
    return rows


@pytest.mark.parametrize("name", ARGUMENTS)
def test_arguments_are_where_the_document_has_them(name):
    command = MAP.table("CMD")[name]
    assert layout(command.arguments) == ARGUMENTS[name]
    assert layout(command.reply) == REPLIES[name]
    assert [a.repeat for a in command.arguments if a.repeat] == ["count"] * (name == "WRITE_BUFFER")


def test_an_unknown_table_or_code_is_answered_with_those_there_are():
    with pytest.raises(UsageError, match="s3g has no table 'IRQ'; it has INT, STB, SET, CMD"):
        MAP.table("IRQ")
    with pytest.raises(UsageError, match="Commands: no 'READ'; there are VERSION, EXT_VER"):
        MAP.table("CMD")["READ"]


def test_constants_are_those_of_the_specification():
    names = ["CLOCK_HZ", "BAUD1", "BAUD2", "INTS_TIMER", "CHANNELS", "PROG_WORDS", "RX_TIMEOUT"]
    values = [50_000_000, 500_000, 115_200, 1_000_000, 2, 8192, 1_000_000]
    assert [getattr(registers, name) for name in names] == values
    assert (registers.HEADER, registers.CRC_POLYNOMIAL) == (0xD5, 0x8C)
    assert (registers.REPORT_TAG, registers.VERSION) == (0xFFFF, 0xCEBA)
    assert (registers.BAUD_LIMIT, registers.BAUD_UNIT) == (31_250, 100)
    extended = registers.EXT_VERSION_LOW | registers.EXT_VERSION_HIGH << 32
    assert extended.to_bytes(8, "little").hex(" ") == "01 00 01 00 ce 00 00 00"


def test_profiles_are_those_of_the_specification():
    # section 6, items 9, 13 to 17, 6 and 12
    assert PROFILES["exact"] == dict.fromkeys(PROFILES["exact"], 0)
    assert PROFILES["robust"] == {
        "abort_dt_latched": 0,
        "rx_timeout": 1_000_000,
        "length_check": 1,
        "hold_buffer": 1,
        "req_queue": 1,
        "reply_port": 1,
        "x_sign_extended": 1,
    }
    assert registers.DEFAULT_PROFILE == "exact"


def test_words_are_made_and_read_as_a_whole():
    # program ended with code 7 at address 1: worked vector 10
    assert decode(MAP["R_BE_CONTROL"], 0x00070001) == {
        "busy": 0,
        "waiting": 0,
        "error": 7,
        "pc": 1,
    }
    assert encode_bytes(MAP["W_V_VAL"], value=-2) == b"\xfe\xff\xff\xff"
    # worked chain: X, V, A, J and JJ of channel 0, with limits and resets, is 1F0F
    load = encode(
        MAP["W_ASG_CONTROL"],
        **{"steps_limit": 1, "dt_limit": 1, "reset_steps": 1, "reset_dt": 1, "channel0": 0b011111},
    )
    assert load == 0x1F0F


def test_pages_have_register_numbers_and_tables():
    text = markdown(MAP)
    assert "| `63` | [Loop-back](#r_se_reg_lb) | [Loop-back](#w_se_reg_lb) |" in text
    assert "**Channel 0..5 velocity.** Address `10, 18, 26, 34, 42, 50`, 4 bytes" in text
    assert "| `CMD_OUTPUT` | 60 | register u8, value u32 |  | Write an output register" in text
    assert "| `REPLY_BUF_ERROR` | 0x82 | address u16, error u8, pc u16 |" in text
    assert "| `INT_BE_COMPLETE` | 30 |" in text
    assert "| `HEADER` | 0xD5 |  | First byte of a packet. |" in text
    header = c_header(MAP)
    assert "#define S3G_W_V_VAL(n) (10u + 8u * (n))\n" in header
    assert "#define S3G_R_BE_CONTROL 62u\n" in header
    assert "#define S3G_REPLY_INTERRUPT 0x50u\n" in header
    assert "#define S3G_HEADER 0xD5u\n" in header
    page = html(MAP)
    assert "<td><code>STB_BE_START</code></td><td>29</td>" in page
    assert "<td><code>63</code></td>" in page
    assert '"prefix": "INT"' in json(MAP)
    assert markdown(MAP) == (CHECKOUT / "docs/registers/s3g.md").read_text()


def test_the_table_of_a_terminal_says_everything(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    text = table(MAP)
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text
    words = " ".join(text.split())
    assert "63 Loop-back Loop-back" in words
    assert "REPLY_INTERRUPT 0x50 pending u32 Report, with" in words
    assert "│ 31 │ 30 │ 29:24 │ 23:16 │ 15:0 │" in words
    # the load control is too wide for one row
    assert "│ 31:30 │ 29:24 │ 23:22 │ 21:16 │ 15:14 │" in words
    assert "│ 13:8 │ 7:4 │ 3 │ 2 │ 1 │ 0 │" in words
