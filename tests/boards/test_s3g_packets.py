"""The codec against the specification's worked vectors and packets of the original controller."""

import itertools
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pulsewright.boards.s3g import packets
from pulsewright.boards.s3g.packets import Decoder, Reply, crc8, frame
from pulsewright.errors import BusError, RegisterValueError

SCENARIOS = [
    json.loads(line)
    for line in (Path(__file__).parents[1] / "golden/s3g/packets.jsonl").read_text().splitlines()
]
SENT = [bytes.fromhex(p[3]) for s in SCENARIOS for p in s["packets"] if p[0] == "out"]


def reply(packet):
    [payload] = Decoder().feed(bytes.fromhex(packet))
    return Reply.parse(payload)


# Specification, section 8.
REQUESTS = [
    (packets.version(1), "D5 03 01 00 00 AB"),
    (packets.write_output(2, 0, 0xA5), "D5 08 02 00 3C 00 A5 00 00 00 3E"),
    (packets.read_input(3, 63), "D5 04 03 00 3D 3F D3"),
    (packets.extended_version(4), "D5 03 04 00 1B 23"),
    (
        packets.write_buffer(5, 16, [0x81_8000_0000, 0xBF_0000_0007]),
        "D5 10 05 00 41 02 10 00 00 00 00 80 81 07 00 00 00 BF A8",
    ),
]


@pytest.mark.parametrize(("built", "expected"), REQUESTS)
def test_requests_are_those_of_the_worked_vectors(built, expected):
    assert built == bytes.fromhex(expected)


def test_crc_of_the_check_word():
    assert crc8(b"\x80\x81\x00") == 0x89
    assert crc8(b"") == 0


@pytest.mark.parametrize(
    ("packet", "tag", "command", "values"),
    [
        ("D5 05 01 00 81 BA CE 34", 1, "VERSION", {"version": 0xCEBA}),
        ("D5 03 02 00 81 9D", 2, "OUTPUT", {}),
        ("D5 07 03 00 81 78 56 34 12 68", 3, "INPUT", {"value": 0x12345678}),
        ("D5 0B 04 00 81 01 00 01 00 CE 00 00 00 2E", 4, "EXT_VER", {"version": 0xCE_0001_0001}),
        (
            "D5 08 05 00 81 10 00 00 00 00 F7",
            5,
            "WRITE_BUFFER",
            {"address": 16, "error": 0, "pc": 0},
        ),
    ],
)
def test_replies_of_the_worked_vectors(packet, tag, command, values):
    answer = reply(packet)
    assert (answer.tag, answer.is_report) == (tag, False)
    assert answer.values(command) == values


@pytest.mark.parametrize(
    ("packet", "names"),
    [
        ("D5 07 FF FF 50 00 00 00 40 83", ["BE_COMPLETE"]),
        ("D5 07 FF FF 50 01 00 00 80 C6", ["ASG_DONE", "SE_INT_LB"]),
        ("D5 07 FF FF 50 01 00 00 00 4A", ["ASG_DONE"]),
    ],
)
def test_reports_of_the_worked_vectors(packet, names):
    report = reply(packet)
    assert report.is_report
    assert packets.interrupt_names(report.pending) == names


def test_only_the_tag_of_reports_makes_a_report():
    assert not Reply(1, 0x50, bytes(4)).is_report
    assert not Reply(0xFFFF, 0x81, bytes(4)).is_report


def test_unused_interrupts_are_named_by_their_bit():
    assert packets.interrupt_names(0x8000_0022) == ["ASG_ABORT", "bit 5", "SE_INT_LB"]


@pytest.mark.parametrize(
    ("packet", "message"),
    [
        ("D5 03 02 00 80 C3", r"INPUT was answered with REPLY_ERROR with tag 2\. Wrong CRC"),
        (
            "D5 03 06 00 85 62",
            r"INPUT was answered with REPLY_UNKNOWN with tag 6\. No such command",
        ),
        ("D5 03 02 00 81 9D", r"reply to INPUT with 0 bytes of arguments .*should be value u32"),
        ("D5 08 05 00 81 10 00 00 00 00 F7", "reply to INPUT with 5 bytes of arguments"),
        ("D5 07 FF FF 50 01 00 00 00 4A", "INPUT was answered with REPLY_INTERRUPT with tag 65535"),
    ],
)
def test_a_reply_that_is_no_answer_says_what_it_is(packet, message):
    with pytest.raises(BusError, match=message):
        reply(packet).values("INPUT")


def test_a_code_of_no_table_and_a_short_payload_are_refused():
    with pytest.raises(BusError, match="code 0x99 with tag 2; the board has no such reply"):
        Reply(2, 0x99).values("STB")
    with pytest.raises(BusError, match="a reply of 2 bytes"):
        Reply.parse(b"\x01\x02")
    with pytest.raises(BusError, match="REPLY_OK with tag 1 is no report"):
        _ = Reply(1, 0x81).pending
    with pytest.raises(BusError, match="report of interrupts with 2 bytes"):
        _ = Reply(0xFFFF, 0x50, b"\x01\x00").pending


def test_numbers_are_sent_in_twos_complement():
    # payload: tag, 60, register, low byte first
    assert packets.write_output(0x1234, 10, -2)[2:-1].hex() == "34123c0afeffffff"
    assert packets.strobe(1, 1 << 31)[2:-1].hex() == "01003e00000080"
    assert packets.clear_interrupts(1, 3)[2:-1].hex() == "01003f03000000"
    assert packets.mask_interrupts(1, 0xFFFFFFFF)[2:-1].hex() == "010040ffffffff"


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: packets.write_output(1, 64, 0), r"output register 64; allowed are 0\.\.63"),
        (lambda: packets.read_input(1, -1), r"input register -1; allowed are 0\.\.63"),
        (lambda: packets.write_output(1, 0, 1 << 32), "OUTPUT: value 4294967296; allowed"),
        (lambda: packets.write_output(1, 0, -(1 << 31) - 1), "OUTPUT: value -2147483649"),
        (lambda: packets.write_output(1, 0, 1.0), r"OUTPUT: value 1\.0; allowed are integers"),
        (lambda: packets.version(0xFFFF), r"VERSION: tag 65535; allowed are 0\.\.65534"),
        (lambda: packets.write_buffer(1, 0, [0] * 50), r"50 words; a packet takes 1\.\.49"),
        (lambda: packets.write_buffer(1, 0, []), "0 words"),
        (lambda: packets.write_buffer(1, 0, [1 << 40]), "WRITE_BUFFER: words 1099511627776"),
        (lambda: packets.write_buffer(1, 0, [-1]), "must be from 0 on"),
        (lambda: packets.write_buffer(1, 1 << 16, [0]), "address 65536"),
        (lambda: frame(b"ab"), "a payload of 2 bytes"),
        (lambda: frame(bytes(256)), "a payload of 256 bytes"),
    ],
)
def test_what_does_not_fit_is_refused(build, message):
    with pytest.raises(RegisterValueError, match=message):
        build()


def test_the_largest_program_piece_fits_in_one_packet():
    packet = packets.write_buffer(1, 8191, [0xFF_FFFF_FFFF] * 49)
    assert (packet[1], packet[5], packet[6:8]) == (6 + 5 * 49, 49, b"\xff\x1f")


# ---- packets of the original controller


def test_every_packet_of_the_original_is_found_and_nothing_is_left():
    decoder = Decoder()
    payloads = decoder.feed(b"".join(SENT))
    assert payloads == [packet[2:-1] for packet in SENT]
    assert len(payloads) == 30 + 41 + 23 + 21  # of the four scenarios
    assert decoder.skipped == 0


def test_replies_of_the_original_have_the_arguments_of_their_command():
    """Each request with a good CRC and a known command, and the reply that has its tag."""
    answered = {"VERSION": 0, "EXT_VER": 0, "OUTPUT": 0, "INPUT": 0, "STB": 0, "CLEAR": 0}
    answered |= {"MASK": 0, "WRITE_BUFFER": 0}
    [scenario] = [s for s in SCENARIOS if s["meta"]["name"] == "proto_basic_fast"]
    requests = {}
    for kind, _, _, text in scenario["packets"]:
        [payload] = Decoder(longest=255).feed(bytes.fromhex(text))
        if kind != "out":
            requests[int.from_bytes(payload[:2], "little")] = payload[2]
            continue
        answer = Reply.parse(payload)
        if answer.is_report or answer.code == 0x85:
            continue
        code = packets.COMMANDS.at(requests[answer.tag])
        values = answer.values(code.name)
        answered[code.name] += 1
        if code.name == "VERSION":
            assert values == {"version": 0xCEBA}
    assert min(answered.values()) >= 2


def test_reports_and_refused_writes_of_the_original_are_read():
    replies = [Reply.parse(packet[2:-1]) for packet in SENT]
    assert {r.pending for r in replies if r.is_report} == {0x8000_0000, 0xC000_0000, 0x4000_0000}
    refused = [r for r in replies if r.code == 0x82]
    assert refused[0] == Reply(0, 0x82, bytes.fromhex("4002000000"))


def rebuilt(packet):
    """The request that our builders make from the numbers of a recorded one, taken out by hand."""
    tag, command, rest = int.from_bytes(packet[2:4], "little"), packet[4], packet[5:-1]
    number = int.from_bytes(rest[-4:], "little")
    if command == 65:
        words = [int.from_bytes(rest[i : i + 5], "little") for i in range(3, len(rest), 5)]
        return packets.write_buffer(tag, rest[1] + 256 * rest[2], words) if words else packet
    if command in (60, 61):
        build = packets.write_output if command == 60 else packets.read_input
        return build(tag, rest[0], *([number] if command == 60 else []))
    masked = {62: packets.strobe, 63: packets.clear_interrupts, 64: packets.mask_interrupts}
    if command in masked:
        return masked[command](tag, number)
    return {0: packets.version, 27: packets.extended_version}[command](tag)


def test_the_recorded_requests_are_what_the_builders_make():
    [scenario] = [s for s in SCENARIOS if s["meta"]["name"] == "proto_basic_fast"]
    recorded = [bytes.fromhex(p[3]) for p in scenario["packets"] if p[0] != "out"]
    known = [packet for packet in recorded if packet[4] != 99]  # 99 is no command
    assert [rebuilt(packet) for packet in known] == known
    assert {packet[4] for packet in known} == {0, 27, 60, 61, 62, 63, 64, 65}


# ---- any stream


def found_by_hand(stream, longest):
    """What a decoder should find: at each place a good packet, or one byte that is none."""
    found, at = [], 0
    while at < len(stream):
        size = stream[at + 1] if at + 1 < len(stream) else 0
        payload = stream[at + 2 : at + 2 + size]
        good = stream[at] == 0xD5 and 3 <= size <= longest and len(stream) > at + 2 + size
        if good and crc8(payload) == stream[at + 2 + size]:
            found.append(payload)
            at += size + 3
        else:
            at += 1
    return found


payloads = st.binary(min_size=3, max_size=11)
garbage = st.one_of(
    st.binary(max_size=12),
    st.lists(st.sampled_from([0xD5, 3, 11, 0, 255]), max_size=8).map(bytes),
    payloads.map(lambda p: frame(p)[:-1]),  # cut short
    payloads.map(lambda p: frame(p)[:-1] + bytes([crc8(p) ^ 1])),  # damaged
)
streams = st.lists(st.one_of(garbage, payloads.map(frame)), max_size=8).map(b"".join)


@given(streams, st.lists(st.integers(0, 60), max_size=5), st.sampled_from([11, 255]))
def test_any_stream_in_any_pieces_gives_its_good_packets(stream, cuts, longest):
    decoder = Decoder(longest)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    found = []
    for start, end in itertools.pairwise(edges):
        found += decoder.feed(stream[start:end])
    found += decoder.flush()
    assert found == found_by_hand(stream, longest)
    assert decoder.skipped == len(stream) - sum(len(payload) + 3 for payload in found)


@given(st.binary(max_size=30).map(lambda b: b.replace(b"\xd5", b"")), payloads)
def test_a_packet_behind_noise_is_found_at_once(noise, payload):
    decoder = Decoder()
    assert decoder.feed(noise + frame(payload)) == [payload]
    assert decoder.skipped == len(noise)


def test_a_length_that_the_board_never_sends_is_not_waited_for():
    # 0C is one more than the longest reply, that to EXT_VER
    assert Decoder().feed(bytes.fromhex("D5 0C D5 03 02 00 81 9D")) == [b"\x02\x00\x81"]
    longer = frame(bytes(12))
    assert Decoder().feed(longer) == []
    assert Decoder(longest=12).feed(longer) == [bytes(12)]


def test_a_packet_behind_a_false_header_is_found_when_waiting_ends():
    # D5 0B asks for twelve more bytes; six come
    decoder = Decoder()
    assert decoder.feed(bytes.fromhex("D5 0B D5 03 02 00 81 9D")) == []
    assert decoder.flush() == [bytes.fromhex("02 00 81")]
    assert decoder.skipped == 2
    assert decoder.feed(bytes.fromhex("D5 03 02 00 81 9D")) == [bytes.fromhex("02 00 81")]


@given(st.integers(0, 0xFFFF), st.integers(0, 255), st.binary(max_size=8))
def test_a_reply_survives_its_packet(tag, code, data):
    payload = tag.to_bytes(2, "little") + bytes([code]) + data
    [received] = Decoder().feed(frame(payload))
    assert Reply.parse(received) == Reply(tag, code, data)
