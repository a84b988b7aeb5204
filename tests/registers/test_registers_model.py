import pytest

from pulsewright.boards.usc.registers import MAP
from pulsewright.errors import UsageError
from pulsewright.registers.model import Choice, Field, ProfileSwitch


def test_an_unknown_register_is_answered_with_those_there_are():
    with pytest.raises(UsageError, match=r"usc has no register 'TIMER'; it has R_ENCODER_COUNT"):
        MAP["TIMER"]


def test_limits_of_signed_and_unsigned_fields():
    signed = Field("a", lsb=0, width=4, reset=0, signed=True)
    unsigned = Field("a", lsb=3, width=4, reset=0)
    assert (signed.minimum, signed.maximum, signed.mask) == (-8, 7, 0x0F)
    assert (unsigned.minimum, unsigned.maximum, unsigned.mask) == (0, 15, 0x78)
    assert (unsigned.bits, signed.bits) == ("6:3", "3:0")


def test_places_are_named_for_people():
    assert MAP.at("read", 0x05).label == "Encoder 1 count, high byte"
    assert MAP.at("write", 0x15).label == "Axis 1 divisor, high byte (commits)"
    assert MAP.at("write", 0x03).label == "Encoder control (alias)"
    assert MAP["W_DIVISOR"].label() == "Axis 0..3 divisor"


def test_switch_values_are_written_by_name_or_with_their_unit():
    gate = ProfileSwitch("gate", "", (0,), 0, 1, choices=(Choice("always", 0), Choice("gated", 1)))
    assert (gate.text(1), gate.allowed) == ("gated", "always (0), gated (1)")
    time = ProfileSwitch("time", "", (10,), 0, 20, "us")
    assert (time.text(10), time.allowed) == ("10 us", "0..20")
    ident = ProfileSwitch("ident", "", (0x41,), 0x41, 0x4E, "hex")
    assert (ident.text(0x41), ident.allowed) == ("0x41", "0x41..0x4E")
