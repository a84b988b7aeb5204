"""Messages of the RAPcores board against the worked vectors of its specification, byte by byte."""

import doctest
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pulsewright.boards.rapcores import messages
from pulsewright.boards.rapcores.messages import Codec, Telemetry
from pulsewright.errors import BusError, RegisterValueError, UsageError

LONG = Codec()
SHORT = Codec(motors=2, encoders=2, word_bits=32)
U = 1 << 63


def wire(text):
    """Return 64-bit words, as the specification writes them, low byte first."""
    return b"".join(
        bytes.fromhex(word.rjust(16, "0"))[::-1] for word in text.replace(",", "").split()
    )


def test_the_example_of_the_module_holds():
    result = doctest.testmod(messages)
    assert result.attempted
    assert not result.failed


# ----------------------------------------------------------------------------------- vectors


def test_status_read():  # vectors 1 and 2
    assert LONG.status_read(0) == bytes.fromhex("00000000000000F1" + 8 * "00")
    assert LONG.value(bytes(8) + bytes.fromhex("0003000100000000")) == 0x01000300
    assert LONG.status_read(1) == wire("F100000000000001, 0")
    assert LONG.value(wire("0, 20200404")) == 0x20200404


def test_config_swap_and_read():  # vectors 3 and 4
    assert LONG.config_swap(2, 3) == wire("F200000000000002, 3")
    assert LONG.value(wire("0, 28")) == 40
    assert LONG.config_swap(0, 0x0F) == wire("F200000000000000, 0F")
    assert LONG.config_read(0) == wire("F300000000000000, 0")
    assert LONG.config_swap(0xC7, 0xFFFFFFFF) == wire("F2000000000000C7, FFFFFFFF")


def test_a_move():  # increments of vector 18
    expected = wire(
        "0100000000000000, 5, 4000000000000000, 0, 2000000000000000, 0200000000000000, "
        "8000000000000000, 0, 7FFFFFFFFFFFFFFF, 0"
    )
    assert LONG.move(5, [U // 2, U // 4, -U, U - 1], [0, U // 64, 0, 0]) == expected
    assert LONG.move(0, [0] * 4) == wire("0100000000000000" + 9 * ", 0")


def test_direction_bits_of_a_move_are_the_low_bits_of_its_header():
    assert LONG.move(1, [-1, 0, 0, 0], direction_bits=0b1001)[:16] == wire("0100000000000009, 1")


def test_telemetry():  # vector 13
    codec = Codec(motors=1, encoders=1)
    reply = wire("0, 0, FFFFFFFFFFFFFFFD, FFFFFFFFFFFFFFCE")
    assert codec.telemetry(reply) == Telemetry((-3,), (-50,))


def test_telemetry_tells_the_first_encoders_that_there_are():
    reply = wire("0, 0, 1, 2, 3, 4, 0, 0, 0, 0")
    assert Codec(encoders=2).telemetry(reply) == Telemetry((1, 3), (2, 4))
    assert Codec(encoders=9).telemetry(reply) == Telemetry((1, 3, 0, 0), (2, 4, 0, 0))
    assert Codec(encoders=0).telemetry(reply) == Telemetry((), ())


def test_words_of_32_bits():  # vector 16
    expected = bytes.fromhex("00000001 04000000 00000040 00000000 00000080 00000000")
    assert SHORT.move(4, [1 << 30, -(1 << 31)]) == expected
    assert SHORT.status_read(0xC1) == bytes.fromhex("C10000F1 00000000")
    assert SHORT.value(bytes.fromhex("00000000 FCFFFFFF")) == 0xFFFFFFFC
    assert SHORT.signed(0xFFFFFFFC) == -4
    assert SHORT.telemetry(struct.pack("<6i", 0, 0, -3, -50, 7, 20)) == Telemetry(
        (-3, 7), (-50, 20)
    )


def test_messages_of_v020():  # vectors A1 to A3
    assert LONG.version() == wire("FE00000000000000, 0")
    assert LONG.channel_info() == wire("FD00000000000000, 0")
    assert LONG.enable(0xF) == wire("0A0000000000000F")
    assert LONG.encoder(0) == wire("0300000000000000, 0")
    assert LONG.encoder_state(wire("0, FFFFFF8500000025")) == (37, -123)
    assert LONG.encoder(3) == wire("0303000000000000, 0")
    assert LONG.divider(3) == wire("2000000000000003")
    assert LONG.brake(1) == wire("0B00000000000001")
    assert LONG.motor(2, current=15, microsteps=5) == wire("100200000000F005")
    assert LONG.chopper(0xFF) == wire("30000000000000FF")
    assert LONG.charge_pump(91) == wire("310000000000005B")
    assert LONG.bridge(2) == wire("3200000000000002")
    assert LONG.motor_fault() == wire("5000000000000000, 0")
    assert LONG.encoder_fault() == wire("5100000000000000, 0")


def test_encoder_positions_of_24_bits_in_v020():
    codec = Codec(position_bits=24)
    # velocity directly above the position: 7, and -1 (all ones in 24 bits)
    assert codec.encoder_state(wire("0, 0000000007FFFFFF")) == (-1, 7)
    # moves tell step count and position, zero-extended
    reply = wire("0, 0, 5, FFFFFF, 0, 800000, 0, 7FFFFF, 0, 1")
    assert codec.telemetry_v020(reply) == Telemetry((-1, -(1 << 23), (1 << 23) - 1, 1))


def test_a_no_op():
    assert (LONG.nop(), SHORT.nop()) == (bytes(8), bytes(4))


# ----------------------------------------------------------------------------------- any values


@st.composite
def any_move(draw):
    bits = draw(st.sampled_from([32, 64]))
    motors = draw(st.integers(1, 24 if bits == 32 else 32))
    limit = 1 << bits - 1
    words = st.lists(st.integers(-limit, limit - 1), min_size=motors, max_size=motors)
    return (
        Codec(motors=motors, word_bits=bits),
        draw(st.integers(0, (1 << 32) - 1)),
        draw(words),
        draw(words),
        draw(st.integers(0, (1 << motors) - 1)),
    )


@given(any_move())
def test_any_move_is_header_duration_and_pairs(move):
    codec, duration, increments, changes, directions = move
    data = codec.move(duration, increments, changes, directions)
    code = "q" if codec.word_bits == 64 else "i"
    words = struct.unpack(f"<{2 * code.upper()}{2 * codec.motors * code}", data)
    assert words[0] == (1 << codec.word_bits - 8) + directions
    assert words[1:] == (
        duration,
        *(n for pair in zip(increments, changes, strict=True) for n in pair),
    )
    assert data[codec.word_bytes - 1] == 1  # the header is the last byte of its word
    assert [codec.signed(word) for word in codec.to_words(data)][2:] == [*words[2:]]


@given(any_move(), st.integers(1, 3))
def test_moves_in_columns_are_the_same(move, count):
    codec, duration, increments, changes, directions = move
    frames = codec.moves(
        np.full(count, duration),
        np.array([increments] * count),
        np.array([changes] * count),
        np.full(count, directions),
    )
    assert frames == [codec.move(duration, increments, changes, directions)] * count


@given(st.binary(max_size=80).filter(lambda data: len(data) % 8 == 0))
def test_words_and_bytes_are_inverse(data):
    assert LONG.to_bytes(LONG.to_words(data)) == data
    assert SHORT.to_bytes(SHORT.to_words(data)) == data


@given(st.binary(max_size=100))
def test_a_reply_of_the_wrong_length_is_refused_and_any_other_is_read(reply):
    for read, length in ((LONG.value, 16), (LONG.telemetry, 80), (SHORT.telemetry, 24)):
        if len(reply) == length:
            read(reply)
        else:
            with pytest.raises(BusError, match=r"expected \d+|are no words"):
                read(reply)


@given(st.integers(0, 255), st.integers(0, (1 << 32) - 1))
def test_any_register_can_be_addressed(address, value):
    data = LONG.config_swap(address, value)
    assert struct.unpack("<QQ", data) == (0xF2 << 56 | address, value)
    for read, code in ((LONG.status_read, 0xF1), (LONG.config_read, 0xF3)):
        assert struct.unpack("<QQ", read(address)) == (code << 56 | address, 0)


# ----------------------------------------------------------------------------------- errors


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: LONG.status_read(256), r"address is 256; allowed are 0\.\.255"),
        (lambda: LONG.config_read(-1), "address is -1"),
        (lambda: LONG.config_swap(2, 1 << 32), r"configuration 0x02 is 4294967296; allowed are"),
        (lambda: LONG.move(1 << 32, [0] * 4), r"duration is 4294967296; .*\[tick\]"),
        (lambda: LONG.move(1, [0] * 3), "3 increments for 4 motors"),
        (lambda: LONG.move(1, [0] * 4, [0] * 5), "5 increment-increments for 4 motors"),
        (lambda: LONG.move(1, [0, U, 0, 0]), f"increment of motor 1 is {U}"),
        (lambda: LONG.move(1, [0] * 4, [0, 0, -U - 1, 0]), "increment-increment of motor 2 is -"),
        (lambda: LONG.move(1, [0.5, 0, 0, 0]), "0.5, which is no integer"),
        (lambda: LONG.move(1, [0] * 4, None, 16), r"direction bits is 16; allowed are 0\.\.15"),
        (lambda: SHORT.move(1, [1 << 31, 0]), r"allowed are -2147483648\.\.2147483647"),
        (lambda: LONG.encoder(4), r"encoder 4; allowed are 0\.\.3"),
        (lambda: LONG.motor(4, 0, 0), r"motor 4; allowed are 0\.\.3"),
        (lambda: LONG.motor(0, 16, 0), "current is 16"),
        (lambda: LONG.enable(16), r"enable mask is 16; allowed are 0\.\.15"),
        (lambda: LONG.bridge(4), r"allowed are 0\.\.3"),
        (lambda: SHORT.encoder(0), "a word of 32 bits cannot name a channel"),
    ],
)
def test_values_that_do_not_fit_are_refused(make, message):
    with pytest.raises(RegisterValueError, match=message):
        make()


@pytest.mark.parametrize(
    ("durations", "increments", "message"),
    [
        (np.array([-1]), np.zeros((1, 2), int), r"duration between -1 and -1; allowed are 0\.\."),
        (np.array([1]), np.zeros((1, 3), int), r"increment is int64 of shape \(1, 3\)"),
        (np.array([1]), np.zeros((1, 2)), "increment is float64"),
        (np.array([1]), np.array([[0, 1 << 31]]), "increment between 0 and 2147483648"),
    ],
)
def test_columns_that_do_not_fit_are_refused(durations, increments, message):
    with pytest.raises(RegisterValueError, match=message):
        SHORT.moves(durations, increments, np.zeros((1, 2), int))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"motors": 0}, r"motors = 0; allowed are 1\.\.32 with words of 64 bits"),
        ({"motors": 33}, "motors = 33"),
        ({"motors": 25, "word_bits": 32}, r"allowed are 1\.\.24 with words of 32 bits"),
        ({"encoders": 65}, r"encoders = 65; allowed are 0\.\.64"),
        ({"word_bits": 48}, "allowed are 64 and 32"),
        ({"position_bits": 16}, "allowed are 24 and 32"),
    ],
)
def test_builds_that_cannot_be_are_refused(parameters, message):
    with pytest.raises(UsageError, match=message):
        Codec(**parameters)
