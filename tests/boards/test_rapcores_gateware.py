# amaranth: UnusedElaboratable=no
"""The gateware does the worked vectors of section 8 of the board's specification.

f is the first cycle with SCK low after the last bit of a message.
"""

import pytest
from rapcores_host import MOVE, READ, READY, STATUS, SWAP, Host

from pulsewright.boards.rapcores import registers as reg
from pulsewright.boards.rapcores.gateware import Rapcores
from pulsewright.errors import UsageError

pytestmark = pytest.mark.rtl

U = 1 << 63


def timing(host, width, low, setup, hold):
    for address, value in zip(range(0xC0, 0xC4), (width, low, setup, hold), strict=True):
        host.write(address, value)


def test_vector_1_version_byte_by_byte():
    host = Host()
    reply, _ = host.board.transfer(READY, bytes([0, 0, 0, 0, 0, 0, 0, 0xF1, *[0] * 8]), 6)
    assert reply == bytes([*[0] * 8, 0x00, 0x03, 0x00, 0x01, 0, 0, 0, 0])


def test_vector_2_channel_info():
    assert Host().send(STATUS | 1, 0) == [0, 0x20200404]
    assert Host(motors=1, encoders=7).send(STATUS | 1, 0) == [0, 0x20200701]


def test_vector_3_divider():
    host = Host()
    assert host.send(SWAP | 2, 3) == [0, 0x28]
    assert host.send(SWAP | 2, 5) == [0, 3]
    host.send(MOVE, 10, -U, *[0] * 7)  # a step at each tick
    host.run(host.fell + 200)
    timers = [cycle for cycle, _ in host.edges("move_done")]
    assert len(timers) == 1
    assert host.fell + 5 + 9 * 6 + 1 < timers[0] <= host.fell + 5 + 10 * 6 + 1


def test_vector_4_enable_takes_effect_at_f_plus_5():
    host = Host()
    host.send(SWAP, 0xF)
    fell = host.fell
    assert host.send(READ, 0) == [0, 0xF]
    assert host.send(READ, 0) == [0, 0xF]
    assert [host.edges(f"en{n}") for n in range(4)] == [[(fell + 5, 1)]] * 4


@pytest.mark.parametrize("words", [(0x55 << 56, STATUS | 1), (0x02 << 56, SWAP)])
def test_vector_5_unknown_header_swallows_a_word(words):
    host = Host()
    assert host.send(*words, 0, STATUS | 1, 0) == [0, 0, 0, 0, 0x20200404]
    assert host.status(0xE6) == 1


def test_vector_6_every_clock_a_tick():
    host = Host(motors=1)
    timing(host, 1, 1, 1, 1)
    host.write(2, 0)
    host.send(MOVE, 6, U // 2, 0)
    f = host.fell
    host.run(f + 100)
    assert host.pulses("step0") == [(f + 10, f + 10), (f + 12, f + 12), (f + 14, f + 14)]
    assert host.edges("move_done") == [(f + 12, 1)]
    assert host.status(0xC0) == 3


def test_vector_7_reversal():
    host = Host(motors=1)
    timing(host, 2, 2, 3, 4)
    host.write(2, 9)
    host.send(MOVE, 700, U // 2, 0)
    host.send(MOVE, 4, -U // 2, 0)
    host.run(host.fell + 7000)
    (first, _), (second, _) = host.edges("move_done")
    t = first - 1
    assert second == t + 41
    assert host.edges("dir0") == [(t + 13, 1)]
    assert host.pulses("step0")[349:] == [
        (t + 3, t + 4),
        (t + 16, t + 17),
        (t + 33, t + 34),
    ]
    assert host.status(0xC0) == 348


def test_vector_8_sums():
    host = Host()
    host.write(2, 0)
    a = U // 1000
    host.send(MOVE, 1000, 0, a, 0, 0, 0, 0, 3, 5)
    host.run(host.fell + 1100)
    assert [host.status(0xC0 + n) for n in range(4)] == [499, 0, 0, 0]
    # The fractions: one unit less than to the next step, and one more.
    rest = 500 * U - 499500 * a - 1
    host.send(MOVE, 1, rest, 0, 0, 0, 0, 0, -2500500, 0)
    assert [host.status(0xC0), host.status(0xC3)] == [499, 0]
    host.send(MOVE, 1, 1, 0, 0, 0, 0, 0, -1, 0)
    assert [host.status(0xC0), host.status(0xC3)] == [500, (1 << 64) - 1]


def test_vector_9_third_move_is_refused():
    host = Host()
    fell = []
    for inc in (1, 2, 3):
        host.send(MOVE, 5000, inc, *[0] * 7)
        fell.append(host.fell)
    assert host.edges("buffer_dtr") == [(fell[1] + 5, 0)]
    assert host.status(0xE3) == 1
    assert host.status(0xE0) == 0x00010202
    host.run(fell[0] + 10_001 * 41)
    assert host.status(0xE0) == 0x200
    assert host.status(0xE2) == 2
    # 15000 units; -15000 is exactly 0, and one more is below
    host.send(MOVE, 1, -15000, *[0] * 7)
    assert host.status(0xC0) == 0
    host.send(MOVE, 1, -1, *[0] * 7)
    assert host.status(0xC0) == (1 << 64) - 1


def test_vector_10_no_duration():
    host = Host()
    host.send(MOVE, 0, -U, *[0] * 7)
    host.run(host.fell + 50)
    assert host.edges("move_done") == [(host.fell + 7, 1)]
    assert host.status(0xC0) == 0


@pytest.mark.parametrize("edges", range(5))
def test_vector_11_encoder(edges):
    host = Host()
    c = 1000
    moves = [("a", 0, 1), ("b", 100, 1), ("a", 150, 0), ("b", 151, 0)]
    for signal, at, level in moves[:edges]:
        host.pin(c + at, f"enc0_{signal}", level)
    host.run(2000)
    assert host.status(0x04) == edges
    assert host.status(0x44) == (0, c - 253, 99, 49, 0)[edges]


@pytest.mark.parametrize(("after_f", "position"), [(1, (1 << 64) - 1), (2, 0)])
def test_status_is_sampled_at_f_plus_4(after_f, position):
    host = Host()
    host.pin(host.f(1) + after_f, "enc3_b", 1)
    assert host.status(0x07) == position


@pytest.mark.parametrize(("after_f", "fault"), [(1, 2), (2, 0)])
def test_vector_12_both_change_at_once(after_f, fault):
    host = Host()
    for signal in "ab":
        host.pin(host.f(1) + after_f, f"enc1_{signal}", 1)
    assert host.status(0x02) == fault
    assert host.status(0x05) == 0
    assert host.status(0x02) == 2
    host.write(0xC5, 2)
    assert host.status(0x02) == 0


def turn(host, cycle, counts, gap):
    """Turn encoder 0, the last two counts ``gap`` cycles apart; return when it is done."""
    levels = [(0, 0), (1, 0), (1, 1), (0, 1)]  # while it goes up
    now = turn.phase
    for _ in range(abs(counts)):
        cycle += gap
        now += 1 if counts > 0 else -1
        for signal, level in zip("ab", levels[now % 4], strict=True):
            host.pin(cycle, f"enc0_{signal}", level)
    turn.phase = now
    return cycle


def test_vector_13_telemetry_is_of_the_start_of_the_move():
    host = Host(motors=1, encoders=1)
    turn.phase = 0
    host.run(turn(host, 400, -3, 51) + 10)
    start = [(1 << 64) - 3, (1 << 64) - 50]
    assert host.send(MOVE, 60_000, 0, 0) == [0, 0, *start]
    host.run(turn(host, host.free + 10, 10, 21) + 10)
    assert host.send(MOVE, 1, 0, 0) == [0, 0, *start]
    assert host.send(STATUS, 0) == [0, 0x01000300]
    assert [host.status(0x04), host.status(0x44)] == [7, 20]
    assert host.status(0xE0) == 0x10202


def test_telemetry_of_motors_without_an_encoder_is_0():
    host = Host(motors=3, encoders=1)
    host.pin(400, "enc0_b", 1)
    host.run(500)
    reply = host.send(MOVE, 1, *[0] * 6)
    assert reply == [0, 0, (1 << 64) - 1, (1 << 64) - (400 - 253), 0, 0, 0, 0]


def frame(host, data, bits=0):
    """Send whole bytes and some bits of a further one, which are 1."""
    start = host.free
    wire = [*data, 0xFF] if bits else data
    host.board.transfer(start, bytes(data), host.half) if not bits else None
    if bits:
        t, period = start + host.half, 2 * host.half
        levels = [byte >> (7 - k) & 1 for byte in wire for k in range(8)][: 8 * len(data) + bits]
        host.pin(start, "cs", 0)
        for n, level in enumerate(levels):
            host.pin(t + period * n, "copi", level)
            host.pin(t + period * n + host.half, "sck", 1)
            host.pin(t + period * (n + 1), "sck", 0)
        start = t + period * len(levels) + host.half
        host.pin(start, "cs", 1)
        host.run(start + 20)
    else:
        host.free = start + host.half * (16 * len(data) + 2) + 2 * host.half


def test_vector_14_bits_of_a_byte_are_dropped():
    host = Host()
    frame(host, [], bits=3)
    assert host.send(STATUS | 1, 0) == [0, 0x20200404]
    assert [host.status(0xE4), host.status(0xE5)] == [1, 0]


def test_vector_15_bytes_of_a_word_are_dropped():
    host = Host()
    frame(host, [0, 0, 0, 0, 0, 0, 0, 0xF2, *[0xFF] * 7])
    assert host.send(STATUS | 1, 0) == [0, 0x20200404]
    assert [host.status(0xE4), host.status(0xE5)] == [1, 1]
    assert host.send(READ, 0) == [0, 0]


def test_a_message_goes_on_in_the_next_frame_if_so_asked():
    host = Host(cs_reset_message=0)
    frame(host, [0, 0, 0, 0, 0, 0, 0, 0xF2, 0xFF])
    assert host.send(5, READ) == [0, 0]
    assert host.send(0, STATUS | 0xE5, 0, STATUS | 0xE4, 0) == [5, 0, 0, 0, 1]


def test_vector_16_words_of_32_bits():
    host = Host(word_bits=32, motors=2)
    status = reg.HEADER_STATUS_READ << 24
    host.send(reg.HEADER_CONFIG_SWAP << 24 | 2, 9)
    host.send(0x01000000, 4, 0x40000000, 0, 0x80000000, 0)
    host.run(host.fell + 100)
    assert host.send(status | 0xC0, 0) == [0, 2]
    assert host.send(status | 0xC1, 0) == [0, 0xFFFFFFFC]
    assert host.send(status | 0x85, 0) == [0, 0x3FC]
    assert host.send(status | 0xFE, 0) == [0, 0x2020]


def test_vector_17_halt_drops_all_moves():
    host = Host()
    host.send(MOVE, 5000, U // 2, *[0] * 7)
    host.send(MOVE, 5000, U // 2, *[0] * 7)
    c = host.free + 1000
    host.pin(c, "halt", 0)
    host.run(c + 100)
    assert host.edges("buffer_dtr")[-1][1] == 0
    host.send(MOVE, 1, *[0] * 8)
    assert host.status(0xE3) == 1
    assert host.status(0xE0) == 0x00060200
    host.pin(host.free, "halt", 1)
    host.run(host.free + 10)
    assert host.status(0xE0) == 0x00040200
    host.send(MOVE, 1, *[0] * 8)
    assert host.status(0xE3) == 2
    assert host.edges("move_done") == []
    host.write(0xC5, 8)
    assert host.edges("buffer_dtr")[-1] == (host.fell + 5, 1)
    assert host.status(0xE0) == 0x200


@pytest.mark.parametrize("slots", [1, 2])
def test_halt_is_seen_after_two_cycles(slots):
    host = Host(depth=4)
    for _ in range(slots):
        host.send(MOVE, 5000, *[0] * 8)
    c = host.free + 500
    host.pin(c, "halt", 0)
    host.pin(c + 1, "halt", 1)  # one cycle is enough
    host.run(c + 100)
    assert host.edges("buffer_dtr") == [(c + 2, 0)]
    assert host.status(0xE0) == 0x00040400


def test_vector_17a_halt_takes_back_what_is_owed():
    found = []
    for delay in (0, 1):  # one of them has the first tick in f + 6
        host = Host(motors=1)
        timing(host, 4, 4, 1, 1)
        host.write(2, 1)
        start = host.free + delay
        f = host.f(4, start)
        host.pin(f + 20, "halt", 0)
        host.send(MOVE, 100, -U, 0, start=start)
        host.run(f + 200)
        assert host.edges("move_done") == []
        found.append(
            (
                [at - f for at, _ in host.edges("dir0")],
                [(a - f, b - f) for a, b in host.pulses("step0")],
                *(host.status(address) for address in (0xC0, 0xE0, 0xE7, 0xE9)),
            )
        )
    assert ([9], [(10, 13), (18, 21)], (1 << 64) - 2, 0x00060200, 0, 0) in found


@pytest.mark.parametrize("shared", [0, 1])
def test_no_pulse_begins_in_a_halt(shared):
    """Section 4.4: with HALT low at c, no STEP rises after c + 2."""
    rise, found = 0, []
    for before in (None, 3, 2):
        host = Host(motors=1, shared_dda=shared)
        timing(host, 4, 4, 1, 1)
        if before is not None:
            host.pin(rise - before, "halt", 0)
        host.send(MOVE, 1000, -U, 0)  # a step at each tick
        host.run(host.fell + 400)
        rises = [cycle for cycle, level in host.edges("step0") if level]
        if before is None:
            rise = rises[3]
            continue
        found.append(len(rises))
        # all that is owed is taken back
        assert host.status(0xC0) == (1 << 64) - len(rises)
        assert host.status(0xE9) == 0
    assert found == [3, 4]


@pytest.mark.parametrize("shared", [0, 1])
def test_an_event_in_the_cycle_of_the_clear_is_counted(shared):
    """Section 2.3: what is cleared in f + 4 is 1 with an event in that cycle."""
    found, done = [], 0
    for late in (None, -1, 0, 1):
        host = Host(motors=1, encoders=0, shared_dda=shared)
        host.send(MOVE, 1, 0, 0)
        host.send(MOVE, 100, 0, 0)
        if late is None:
            host.run(host.free + 5000)
            done = host.edges("move_done")[1][0] - 1  # seen a cycle later
        else:
            host.send(SWAP | 0xC5, 1, start=done + late - 4 - host.f(2, 0))
            assert host.fell + 4 == done + late
        found.append(host.status(0xE2))
    assert found == [2, 1, 1, 0]


def test_upstream_telemetry_is_of_the_start_of_the_move():
    host = Host("upstream")
    turn.phase = 0
    host.run(turn(host, 400, -3, 51) + 10)
    start = [(1 << 64) - 3, (1 << 64) - 50]
    assert host.send(MOVE, 60_000, *[0] * 8)[2:] == [*start, *[0] * 6]
    host.run(turn(host, host.free + 10, 10, 21) + 10)
    assert host.send(MOVE, 1, *[0] * 8)[2:] == [*start, *[0] * 6]


def test_software_halt():
    host = Host(halt_pin=0)
    host.pin(host.free, "halt", 0)  # there is no such pin
    host.send(MOVE, 5000, *[0] * 8)
    assert host.status(0xE0) == 0x00010201
    host.write(0xC4, 1)
    assert host.edges("buffer_dtr") == [(host.fell + 5, 0)]
    assert host.status(0xE0) == 0x00060200
    host.write(0xC4, 0)
    assert host.status(0xE0) == 0x00040200


def test_steps_beyond_128_owed_are_lost():
    host = Host(motors=1)
    timing(host, 0xFFFF, 1, 1, 1)
    host.write(2, 0)
    host.send(MOVE, 131, -U, 0)
    # Of 131 steps one is being given, 128 are owed, and two are lost.
    assert [host.status(0xC0), host.status(0xE7), host.status(0x03)] == [(1 << 64) - 131, 1, 1]
    assert host.status(0xE9) == 1
    host.write(0xC4, 1)
    assert [host.status(0xC0), host.status(0xE9)] == [(1 << 64) - 3, 0]
    host.write(0xC5, 4)
    assert host.status(0xE7) == 0


def test_polarity():
    host = Host(motors=2)
    host.write(0xC6, 2)
    step = host.fell
    host.write(0xC7, 1)
    assert [host.edges("step0"), host.edges("step1")] == [[], [(step + 5, 1)]]
    assert [host.edges("dir0"), host.edges("dir1")] == [[(host.fell + 5, 1)], []]


def test_messages_of_the_original_0_2_on_request():
    host = Host(v020_info=1)
    assert host.send(0xFE << 56, 0) == [0, 0x01000200]
    assert host.send(0xFD << 56, 0) == [0, 0x20200404]
    host.pin(host.free, "enc2_b", 1)
    host.run(host.free + 10)
    velocity = -(host.free - 11 - 253) % (1 << 32)
    assert host.send(0x03 << 56 | 2 << 48, 0) == [0, velocity << 32 | 0xFFFFFFFF]
    assert host.status(0xE6) == 0


@pytest.mark.parametrize(
    ("profile", "options", "message"),
    [
        ("document", {"motors": 33}, r"motors = 33; allowed: 1\.\.32"),
        ("document", {"motors": 25, "word_bits": 32}, r"motors = 25; allowed: 1\.\.24"),
        ("document", {"depth": 3}, r"depth = 3; allowed: 2, 4, 8, 16, 32, 64"),
        ("upstream", {"depth": 4}, r"depth = 4; allowed: 2"),
        ("v020", {"word_bits": 32}, r"word_bits = 32; allowed: 64"),
        ("document", {"position_bits": 24}, r"position_bits = 24; allowed: 32"),
        ("document", {"speed": 1}, "no profile switch 'speed'"),
        ("original", {}, "no profile 'original'"),
    ],
)
def test_unknown_parameters(profile, options, message):
    with pytest.raises(UsageError, match=message):
        Rapcores(profile, **options)
