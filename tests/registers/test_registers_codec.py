import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pulsewright.errors import RegisterValueError, UsageError
from pulsewright.registers.codec import decode, decode_bytes, encode, encode_bytes
from pulsewright.registers.model import Field, Register

VELOCITY = Register(
    board="demo",
    name="VELOCITY",
    side="write",
    addresses=(0x00, 0x02),
    size=2,
    title="Velocity of axis {n}",
    fields=(
        Field("enable", lsb=15, width=1, reset=0),
        Field("velocity", lsb=0, width=12, reset=0, unit="step/tick", signed=True, fracwidth=10),
    ),
)


def test_fields_go_to_their_bits_and_bytes_low_byte_first():
    # -1 in 12 bits is FFF; enable is bit 15
    assert encode(VELOCITY, velocity=-1) == 0x0FFF
    assert encode(VELOCITY, velocity=-2048, enable=1) == 0x8800
    assert encode_bytes(VELOCITY, velocity=0x123, enable=1) == b"\x23\x81"


def test_bits_outside_the_fields_are_ignored_when_read():
    assert decode(VELOCITY, 0x7FFF) == {"enable": 0, "velocity": -1}
    assert decode_bytes(VELOCITY, b"\xff\x87") == {"enable": 1, "velocity": 0x7FF}


@given(st.integers(-2048, 2047), st.integers(0, 1))
def test_what_is_encoded_is_decoded(velocity, enable):
    values = {"enable": enable, "velocity": velocity}
    assert decode_bytes(VELOCITY, encode_bytes(VELOCITY, **values)) == values


@pytest.mark.parametrize("value", [-2049, 2048, 1 << 40])
def test_a_value_that_does_not_fit_names_board_register_field_and_range(value):
    message = f"demo W_VELOCITY.velocity: {value} does not fit in 12 bits; "
    message += r"allowed are -2048..2047 \[step/tick\]"
    with pytest.raises(RegisterValueError, match=message):
        encode(VELOCITY, velocity=value)


def test_integers_of_numpy_are_integers_and_floats_are_not():
    assert encode(VELOCITY, velocity=np.int64(5)) == 5
    with pytest.raises(RegisterValueError, match=r"W_VELOCITY.velocity: 5.0 is no integer"):
        encode(VELOCITY, velocity=5.0)


def test_an_unknown_field_is_answered_with_those_there_are():
    with pytest.raises(UsageError, match="has no field 'speed'; its fields are enable, velocity"):
        encode(VELOCITY, speed=1)


def test_words_and_bytes_of_the_wrong_size_are_refused():
    with pytest.raises(RegisterValueError, match="0x10000 is no word of 2 bytes"):
        decode(VELOCITY, 0x10000)
    with pytest.raises(RegisterValueError, match="3 bytes for a register of 2"):
        decode_bytes(VELOCITY, b"abc")
