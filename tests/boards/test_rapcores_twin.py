"""The worked vectors of the RAPcores specification on the twin, and what its user meets first.

Cycles are those of the specification: what edge n makes is visible in cycle n + 1. ``f`` is the
first cycle with SCK low after the last bit of a message.
"""

from itertools import pairwise

import numpy as np
import pytest

from pulsewright.boards.rapcores.twin import RapcoresTwin
from pulsewright.edges.trace import concatenate
from pulsewright.errors import UsageError
from pulsewright.transport.spi_bus import VirtualSpiBus

U = 1 << 63  # one step
HALF = 6
BEGIN = 300  # of the first frame
COUNTERS = {"completed": 0xE2, "refused": 0xE3, "framing": 0xE4, "aborted": 0xE5, "unknown": 0xE6}


class Host:
    """Sends frames and remembers what the pins did."""

    def __init__(self, *arguments, **options):
        self.twin = RapcoresTwin(*arguments, **options)
        self.size = self.twin.word_bits // 8
        self.free, self.traces = BEGIN, []

    def send(self, *words, at=None):
        """Send words in a frame; return the replies. ``f`` is that of the last one then."""
        data = b"".join((w % 256**self.size).to_bytes(self.size, "little") for w in words)
        begin = self.free if at is None else at
        self.f = begin + HALF + 2 * HALF * 8 * len(data)
        reply, self.free = self.twin.transfer(begin, data, HALF)
        return [
            int.from_bytes(reply[n : n + self.size], "little")
            for n in range(0, len(reply), self.size)
        ]

    def header(self, byte, rest=0):
        return byte << (8 * self.size - 8) | rest

    def status(self, address):
        first, value = self.send(self.header(0xF1, address), 0)
        assert first == 0
        return value

    def configure(self, address, value):
        self.send(self.header(0xF2, address), value)

    def times(self, width, low, setup, hold):
        for address, value in zip(range(0xC0, 0xC4), (width, low, setup, hold), strict=True):
            self.configure(address, value)

    def move(self, duration, *motors, at=None):
        """Send a move, (increment, increment-increment) of each motor; return the replies."""
        words = [word for motor in motors for word in motor]
        return self.send(self.header(1), duration, *words, at=at)

    def wait(self, cycles):
        self.twin.advance(self.twin.now + cycles)
        self.free = max(self.free, self.twin.now + 1)

    def trace(self):
        self.traces.append(self.twin.drain())
        return concatenate(self.traces)

    def rises(self, pin):
        """Return the cycles from which on a pin is visibly high."""
        return (self.trace().edges(pin, 1) + 1).tolist()

    def changes(self, pin):
        """Return the cycles from which on a pin has another level."""
        return (self.trace()[pin] + 1).tolist()

    def levels(self, pin, cycles):
        """Return what pins 0 to 3 show in some cycles, as a number each."""
        trace, values = self.trace(), []
        for cycle in cycles:
            parts = (np.searchsorted(trace[f"{pin}{i}"], cycle) & 1 for i in range(4))
            values.append(sum(int(part) << i for i, part in enumerate(parts)))
        return values


def old_tick(cycle):
    """Return how long ago the last tick of the default divider was, that is its counter."""
    return (cycle - (255 + 40)) % 41 - 1


# ------------------------------------------------------------------------------------------ vectors


@pytest.mark.parametrize("profile", ["document", "upstream"])
def test_1_the_version_low_byte_first(profile):
    reply, end = RapcoresTwin(profile).transfer(BEGIN, bytes(7) + b"\xf1" + bytes(8), HALF)
    assert reply[:8] == bytes(8)
    assert reply[8:] == bytes.fromhex("0003000100000000")
    assert end == BEGIN + HALF + 2 * HALF * 128 + HALF + 2 * HALF


@pytest.mark.parametrize("profile", ["document", "upstream"])
def test_2_channel_info(profile):
    assert Host(profile).send(0xF1 << 56 | 1, 0) == [0, 0x20200404]


@pytest.mark.parametrize(("profile", "switches"), [("document", {}), ("upstream", {"fixed": 1})])
def test_3_a_swap_returns_the_old_divider(profile, switches):
    host = Host(profile, **switches)
    assert host.send(0xF2 << 56 | 2, 3) == [0, 40]
    assert host.send(0xF2 << 56 | 2, 5) == [0, 3]
    host.wait(300)  # the counter of the original may have to wrap
    host.move(20, (-U, 0), (0, 0), (0, 0), (0, 0))
    seen = []
    for cycle in range(host.free, host.free + 60):
        host.twin.advance(cycle)
        seen.append(host.twin.positions()[0])
    at = np.flatnonzero(np.diff(seen))
    assert len(at) > 5
    assert set(np.diff(at)) == {6}


def test_4_a_configuration_read_changes_nothing():
    host = Host()
    host.send(0xF2 << 56, 0x0F)
    enabled = host.f + 5
    assert host.send(0xF3 << 56, 0) == [0, 0x0F]
    assert host.send(0xF3 << 56, 0x33) == [0, 0x0F]
    for i in range(4):
        assert host.changes(f"en{i}") == [enabled]


@pytest.mark.parametrize("profile", ["document", "upstream"])
def test_5_an_unknown_header_swallows_a_word(profile):
    host = Host(profile)
    assert host.send(0x55 << 56, 0xF1 << 56 | 1) == [0, 0]
    assert host.send(0) == [0]
    assert host.send(0xF1 << 56 | 1, 0) == [0, 0x20200404]
    assert host.twin.state()["unknown"] == 1
    if profile == "document":
        assert host.status(0xE6) == 1


def test_6_half_a_step_per_clock():
    host = Host(motors=1, encoders=1)
    host.configure(2, 0)
    host.times(1, 1, 1, 1)
    host.move(6, (U // 2, 0))
    f = host.f
    host.wait(100)
    assert host.changes("step0") == [f + 10, f + 11, f + 12, f + 13, f + 14, f + 15]
    assert host.changes("move_done") == [f + 12]
    assert host.twin.state()["position"] == [3]
    assert host.twin.state()["fraction"] == [0]


def test_steps_follow_the_ticks_that_cross_them():
    """Steady, ever faster and ever slower, up and down: against the sum itself, tick by tick."""
    speeds = [
        (3 * U // 19, 0),
        (U // 50, U // 10**6),
        (-U // 9, -U // 10**5),
        (U // 8, -U // 10**5),
    ]
    ticks, period = 4000, 10
    host = Host(motors=4, encoders=1)
    host.configure(2, period - 1)
    host.times(2, 2, 1, 1)
    host.move(ticks, *speeds)
    host.wait(ticks * period + 100)
    last = host.changes("move_done")[0] - 1
    for motor, (first, change) in enumerate(speeds):
        speed, total, expected = first, 0, []
        for tick in range(ticks):
            before = total // U
            total += speed
            speed += change
            if total // U != before:
                expected.append(last - (ticks - 1 - tick) * period + 3)
        rises = host.rises(f"step{motor}")
        # the pin of direction comes before the first step down
        assert rises[1:] == expected[1:]
        assert len(rises) == len(expected) > 80
        assert host.changes(f"step{motor}")[1::2] == [rise + 2 for rise in rises]
        assert host.twin.state()["position"][motor] == total // U
        assert host.twin.state()["fraction"][motor] == total % U
        assert host.twin.state()["increment"][motor] == speed


def test_7_a_reversal_between_chained_moves():
    host = Host(motors=1, encoders=1)
    host.configure(2, 9)
    host.times(2, 2, 3, 4)
    host.move(700, (U // 2, 0))
    host.move(4, (-U // 2, 0))
    host.wait(8000)
    t, end = (cycle - 1 for cycle in host.changes("move_done"))
    assert end + 1 == t + 41
    assert host.changes("dir0") == [t + 13]
    steps = host.changes("step0")
    assert len(steps) == 2 * 352
    assert steps[-6:] == [t + 3, t + 5, t + 16, t + 18, t + 33, t + 35]
    assert host.twin.state()["position"] == [348]
    assert host.twin.state()["fraction"] == [0]


def test_8_acceleration_is_exact():
    host = Host()
    host.configure(2, 0)
    a = U // 1000
    host.move(1000, (0, a), (0, 0), (0, 0), (3, 5))
    host.wait(2000)
    state = host.twin.state()
    assert [499500 * a >> 63, 499500 * a % U] == [499, state["fraction"][0]]
    assert state["position"] == [499, 0, 0, 0]
    assert state["fraction"][3] == 2500500
    assert state["increment"] == [1000 * a, 0, 0, 5003]


def test_9_a_third_move_is_refused():
    host = Host()
    still = [(0, 0)] * 3
    host.move(5000, (1, 0), *still)
    host.move(5000, (2, 0), *still)
    full = host.f + 5
    host.move(5000, (3, 0), *still)
    assert host.status(0xE3) == 1
    assert host.status(0xE0) == 0x00010202
    assert host.changes("buffer_dtr") == [full]
    host.wait(2 * 5000 * 41)
    assert host.twin.state()["fraction"] == [15000, 0, 0, 0]
    assert host.status(0xE0) == 0x200
    assert host.status(0xE2) == 2


def test_10_a_move_of_no_time():
    host = Host()
    host.move(0, *[(U - 1, 7)] * 4)
    f = host.f
    host.wait(100)
    assert host.changes("move_done") == [f + 7]
    assert host.twin.state()["fraction"] == [0] * 4


@pytest.mark.parametrize("profile", ["document", "upstream", "v020"])
def test_11_encoder_counts_and_velocities(profile):
    twin, c = RapcoresTwin(profile), 1000
    twin.schedule([c, c + 150], "enc0_a", [1, 0])
    twin.schedule([c + 100, c + 151], "enc0_b", [1, 0])
    seen = []
    for n, visible in enumerate((c + 3, c + 103, c + 153, c + 154)):
        twin.advance(visible - 2)
        assert twin.state()["encoder_position"][0] == n  # one cycle earlier
        twin.advance(visible - 1)
        state = twin.state()
        assert state["encoder_position"][0] == n + 1
        seen.append(state["encoder_velocity"][0])
    # in 0.2 a velocity is not known before the second count
    assert seen == [0 if profile == "v020" else c - 253, 99, 49, 0]


@pytest.mark.parametrize(("profile", "mask"), [("document", 2), ("upstream", 0x0D)])
def test_12_both_signals_at_once_are_a_fault(profile, mask):
    host, c = Host(profile), 1000
    host.twin.schedule(c, ["enc1_a"], 1)
    host.twin.schedule(c, ["enc1_b"], 1)
    host.twin.advance(c + 1)
    assert host.twin.state()["fault"] == 0
    host.twin.advance(c + 2)
    assert host.twin.state()["fault"] == 2
    host.free = 1100
    assert host.status(2) == mask
    assert host.twin.state()["encoder_position"][1] == 0


def count(twin, e, cycle, gaps, up):
    """Let an encoder that stands at 0, 0 count; return the cycle after the last change."""
    order = "ab" if up else "ba"
    for n, gap in enumerate(gaps):
        cycle += gap
        twin.schedule(cycle, f"enc{e}_{order[n % 2]}", 1 - n // 2 % 2)
    return cycle + 1


def test_13_telemetry_is_that_of_the_start_of_the_move():
    host = Host(motors=1, encoders=1)
    host.twin.advance(1000)
    # down 3 counts, the last after 51 clocks; three changes leave A high and B low
    host.free = count(host.twin, 0, 1000, [60, 70, 51], up=False) + 10
    expected = [0, 0, 2**64 - 3, 2**64 - 50]
    assert host.move(2000, (0, 0)) == expected
    state = host.twin.state()
    assert state["executing"]
    # now A 1, B 0: B, A, B, A, ... count up
    cycle, levels = host.free + 10, {"a": 1, "b": 0}
    for n in range(10):
        cycle += 21
        pin = "ba"[n % 2]
        levels[pin] ^= 1
        host.twin.schedule(cycle, f"enc0_{pin}", levels[pin])
    host.wait(400)
    state = host.twin.state()
    assert (state["encoder_position"], state["encoder_velocity"]) == ([7], [20])
    assert host.move(5, (0, 0)) == expected
    assert host.send(0xF1 << 56, 0) == [0, 0x01000300]


def test_14_a_few_bits_are_a_framing_error():
    host = Host()
    host.twin.schedule([300, 400], "cs", [0, 1])
    host.twin.schedule(310 + 20 * np.arange(3), "sck", 1)
    host.twin.schedule(320 + 20 * np.arange(3), "sck", 0)
    host.free = 500
    assert host.send(0xF1 << 56 | 1, 0) == [0, 0x20200404]
    assert host.status(0xE4) == 1


def test_15_a_cut_word_is_dropped():
    host = Host()
    data = (0xF2 << 56).to_bytes(8, "little") + 7 * b"\xff"
    _, host.free = host.twin.transfer(300, data, HALF)
    assert host.send(0xF1 << 56 | 1, 0) == [0, 0x20200404]
    assert host.send(0xF3 << 56, 0) == [0, 0]
    assert [host.status(0xE4), host.status(0xE5)] == [1, 1]


def test_15_upstream_takes_the_rest_from_the_next_frame():
    host = Host("upstream")
    data = (0xF2 << 56).to_bytes(8, "little") + 7 * b"\xff"
    _, host.free = host.twin.transfer(300, data, HALF)
    _, host.free = host.twin.transfer(host.free, b"\xff" + bytes(7) + b"\xf1" + bytes(8), HALF)
    assert host.twin.state()["enable"] == 0xFFFFFFFF


def test_16_words_of_32_bits():
    host = Host(word_bits=32, motors=2)
    host.configure(2, 9)
    host.send(0x01000000, 4, 0x40000000, 0, 0x80000000, 0)
    host.wait(100)
    assert host.status(0xC0) == 2
    assert host.status(0xC1) == 0xFFFFFFFC
    assert host.status(0x85) == 0x3FC
    assert host.status(0xFE) == 0x2020


def test_17_halt_ends_moves_until_it_is_cleared():
    host = Host()
    host.move(5000, *[(U // 3, 0)] * 4)
    host.move(5000, *[(U // 3, 0)] * 4)
    c = host.free + 1000
    host.twin.schedule(c, "halt", 0)
    host.twin.advance(c + 1)  # what is visible in c + 2
    assert host.twin.level("buffer_dtr") == 0
    assert host.twin.state()["executing"]
    host.twin.advance(c + 2)
    state = host.twin.state()
    assert (state["executing"], state["used"], state["halted"]) == (False, 0, True)
    assert host.changes("move_done") == []
    host.free = host.twin.now + 10
    host.move(5, *[(0, 0)] * 4)
    host.twin.schedule(host.free, "halt", 1)
    host.wait(10)
    assert host.status(0xE3) == 1
    assert host.status(0xE0) == 0x00040200
    assert host.twin.level("buffer_dtr") == 0
    host.move(5, *[(0, 0)] * 4)
    assert host.status(0xE3) == 2
    host.configure(0xC5, 8)
    assert host.changes("buffer_dtr")[-1] == host.f + 5
    host.move(5, *[(0, 0)] * 4)
    host.wait(1000)
    assert (host.status(0xE3), host.status(0xE2), host.status(0xE0)) == (2, 1, 0x200)


def test_17a_owed_pulses_are_taken_back():
    host = Host(motors=1, encoders=1)
    host.times(4, 4, 1, 1)
    host.configure(2, 1)
    visible = host.f + 5
    # the counter is past 1, so there is a tick at once, and then every second cycle
    assert old_tick(visible) >= 1
    length = HALF + 2 * HALF * 64 * 4
    at = host.free + (host.free + length + 6 - visible) % 2
    host.move(100, (-U, 0), at=at)
    f = host.f
    host.twin.schedule(f + 20, "halt", 0)
    host.wait(2000)
    assert host.changes("dir0") == [f + 9]
    assert host.changes("step0") == [f + 10, f + 14, f + 18, f + 22]
    # taken back before it is read: 8 ticks were used, 2 pulses given
    assert host.status(0xC0) == 2**64 - 2
    assert host.status(0xE0) == 0x00060200
    assert host.status(0xE7) == 0


def original(divider, f_of_tick, length, profile="upstream", **switches):
    """Return an original whose next frame of ``length`` words can begin at ``at``.

    ``f_of_tick`` is where after its f a tick comes. After the write of the divider, its counter
    runs on to 255; from there on ticks come at the divider's value.
    """
    host = Host(profile, **switches)
    if profile == "v020":
        host.send(0x20 << 56 | divider)
    else:
        host.configure(2, divider)
    visible = host.f + 5
    counter = old_tick(visible)
    assert counter > divider
    tick = visible + 256 - counter + divider
    f = host.free + HALF + 2 * HALF * 64 * length
    at = host.free + (tick - f - f_of_tick) % (divider + 1)
    return host, at


VECTOR_18 = [(U // 2, 0), (U // 4, U // 64), (-U, 0), (U - 1, 0)]


@pytest.mark.parametrize(
    ("fixed", "positions"),
    [
        (1, [(0, 0, -1, 0), (1, 0, -2, 1), (1, 0, -3, 2), (2, 1, -4, 3)]),
        (0, [(0, 0, -1, 0), (-1, 0, -1, 0), (-1, 1, -2, 1), (-1, 0, -2, 1)]),
    ],
)
def test_18_and_19_a_tick_in_the_load_cycle_is_lost(fixed, positions):
    host, at = original(3, 5, 10, fixed=fixed)
    host.move(5, *VECTOR_18, at=at)
    f, seen = host.f, []
    for tick in (f + 9, f + 13, f + 17, f + 21):
        host.twin.advance(tick - 1)
        before = seen[-1] if seen else (0, 0, 0, 0)
        assert tuple(host.twin.positions()) == before
        host.twin.advance(tick)
        seen.append(tuple(host.twin.positions()))
    assert seen == positions
    host.wait(100)
    assert tuple(host.twin.positions()) == positions[-1]
    assert host.changes("move_done") == [f + 24]
    cycles = [n + k for n in (f + 10, f + 14, f + 18, f + 22) for k in (-1, 0)]
    if fixed:
        assert host.levels("step", cycles) == [0, 9, 9, 0xA, 0xA, 0xB, 0xB, 8]


@pytest.mark.parametrize(
    ("divider", "ticks", "first", "last", "done"), [(2, 9, 8, 32, 35), (1, 10, 7, 25, 26)]
)
def test_20_ticks_of_fast_dividers(divider, ticks, first, last, done):
    host, at = original(divider, 5, 10, fixed=1)
    host.move(10, *[(-U, 0)] * 4, at=at)
    f, moved = host.f, []
    for cycle in range(f + 6, f + 60):
        before = host.twin.positions()[0]
        host.twin.advance(cycle + 1)
        if host.twin.positions()[0] != before:
            moved.append(cycle + 1 - f)
    assert (len(moved), moved[0], moved[-1]) == (ticks, first, last)
    assert host.changes("move_done") == [f + done]


def test_a1_version_and_channel_info_of_v020():
    host = Host("v020")
    assert host.send(0xFE << 56, 0) == [0, 0x01000200]
    assert host.send(0xFD << 56, 0) == [0, 0x20200404]
    assert Host("v020", position_bits=24).send(0xFD << 56, 0) == [0, 0x20180404]


def test_a2_enable_in_one_word():
    host = Host("v020")
    host.send(0x0A << 56 | 0x0F)
    assert [host.changes(f"en{i}") for i in range(4)] == [[host.f + 5]] * 4


@pytest.mark.parametrize(("bits", "reply"), [(32, 0xFFFFFF8500000025), (24, 0x00FFFFFF85000025)])
def test_a3_an_encoder_in_one_word(bits, reply):
    host = Host("v020", position_bits=bits)
    host.free = count(host.twin, 0, 1000, [50] * 38, up=True)
    # 38 changes leave A 1, B 1; one count back takes B to 0
    host.twin.schedule(host.free - 1 + 124, "enc0_b", 0)
    host.free += 200
    assert host.send(0x03 << 56, 0) == [0, reply]


def test_a4_steps_follow_the_sign_of_the_accumulator():
    host, at = original(3, 8, 10, "v020")
    host.move(5, (1 << 62, 0), (-(1 << 62), 0), (U - 1, 0), (0, 1 << 60), at=at)
    f = host.f
    host.wait(100)
    cycles = [12, 13, 17, 21, 25, 29, 33, 37, 60]
    pins = host.levels("step", [f + n for n in cycles])
    assert pins == [0, 5, 8, 0xE, 8, 5, 4, 0, 0]
    assert host.changes("move_done") == [f + 27]


# ------------------------------------------------------------------------------- beyond the vectors


def test_v020_info_in_profile_document():
    host = Host(v020_info=1)
    assert host.send(0xFE << 56, 0) == [0, 0x01000200]
    assert host.send(0xFD << 56, 0xF1 << 56 | 0xFF, 0) == [0, 0x20200404, 0x52430001]
    host.free = count(host.twin, 2, host.free, [50, 124], up=False) + 10
    assert host.send(0x03 << 56 | 2 << 48, 0) == [0, (2**32 - 123) << 32 | 2**32 - 2]
    assert host.status(0xE6) == 0
    assert Host().send(0xFE << 56, 0) == [0, 0]


def test_a_message_goes_on_in_the_next_frame_if_asked():
    host = Host(cs_reset_message=0)
    host.send(0xF2 << 56)
    host.send(0x0A)
    assert host.status(0xE5) == 0
    assert host.twin.state()["enable"] == 0x0A


@pytest.mark.parametrize("period", [1, 2, 41, 256])
def test_moves_follow_each_other_without_a_gap(period):
    """Three moves of one step per tick: ticks are as even between as inside them."""
    host = Host(motors=1, encoders=0, depth=4)
    host.configure(2, period - 1)
    lead = 3 * 4 * 2 * HALF * 64 // period + 200
    for duration in (lead, 50, 50):
        host.move(duration, (-U, 0))
    first = host.trace().end
    at = []
    host.wait(0)
    for _ in range(4000):
        before = host.twin.positions()[0]
        host.twin.advance(host.twin.now + 1)
        if host.twin.positions()[0] != before:
            at.append(host.twin.now)
        if len(at) == 8:
            break
    assert set(np.diff(at)) == {period}
    host.twin.advance(first + (lead + 200) * period)
    assert host.twin.state()["position"] == [-(lead + 100)]
    done = host.changes("move_done")
    assert [after - before for before, after in pairwise(done)] == [50 * period] * 2


def test_a_pulse_is_lost_when_128_are_owed():
    host = Host(motors=1, encoders=0)
    host.configure(2, 0)
    host.times(60000, 1, 1, 1)
    # the first tick gives a step that goes out 4 cycles later; 128 more may wait
    host.move(129, (-U, 0))
    host.wait(200)
    assert host.status(0xE7) == 0
    assert host.status(0xE9) == 1
    host.move(1, (-U, 0))
    host.wait(10)
    assert (host.status(0xE7), host.status(0x03)) == (1, 1)
    host.configure(0xC5, 4)
    assert host.status(0xE7) == 0


def test_polarity_inverts_pins_at_once():
    host = Host()
    host.configure(0xC6, 0b0101)
    assert [host.changes(f"step{i}") for i in range(4)] == [[host.f + 5], [], [host.f + 5], []]
    host.configure(0xC7, 0xFF)
    assert [host.changes(f"dir{i}") for i in range(4)] == [[host.f + 5]] * 4
    assert host.send(0xF3 << 56 | 0xC7, 0) == [0, 0x0F]


def test_reset_brings_everything_to_rest():
    host = Host()
    host.configure(0, 0x0F)
    host.move(5000, *[(U - 1, 0)] * 4)
    host.wait(1000)
    host.twin.reset()
    assert host.twin.state()["in_reset"] is False
    assert host.twin.state()["position"] == [0] * 4
    assert [host.twin.level(pin) for pin in ("en0", "step0", "buffer_dtr")] == [0, 0, 1]
    host.free = host.twin.now + 1
    assert host.status(0xE0) == 0x200
    assert host.send(0xF3 << 56 | 2, 0) == [0, 40]


def test_the_bus_of_a_driver():
    bus = VirtualSpiBus(RapcoresTwin(), listens=255)
    request = bytes(7) + b"\xf1" + bytes(8)
    assert bus.transfer(request)[8:12] == bytes.fromhex("00030001")
    assert bus.level("buffer_dtr") == 1
    bus.reset()
    assert bus.transfer(request)[8:12] == bytes.fromhex("00030001")


@pytest.mark.parametrize(
    ("profile", "options", "text"),
    [
        ("document", {"motors": 33}, r"motors = 33 .* allowed are 1\.\.32"),
        ("document", {"motors": 25, "word_bits": 32}, r"allowed are 1\.\.24"),
        ("document", {"depth": 3}, r"depth = 3 .* allowed are \[2, 4, 8, 16, 32, 64\]"),
        ("upstream", {"depth": 4}, r"depth = 4 in profile upstream .* allowed are \[2\]"),
        ("v020", {"word_bits": 32}, "word_bits = 32 in profile v020"),
        ("document", {"position_bits": 24}, "position_bits = 24"),
        ("document", {"encoders": 65}, r"allowed are 0\.\.64"),
        ("document", {"fixed": 1}, "fixed = 1 in profile document; the switch is for .* upstream"),
        ("upstream", {"cs_reset_message": 1}, "is for profile document"),
        ("document", {"v020_info": 1, "word_bits": 32}, "v020_info needs words of 64 bits"),
        ("neither", {}, "has no profile 'neither'"),
    ],
)
def test_what_cannot_be_built_is_explained(profile, options, text):
    with pytest.raises(UsageError, match=text):
        RapcoresTwin(profile, **options)


def test_wrong_use_is_explained():
    twin = RapcoresTwin()
    twin.advance(500)
    with pytest.raises(UsageError, match="a frame at cycle 500, but that is over"):
        twin.transfer(500, bytes(8))
    with pytest.raises(UsageError, match="half a period of 0"):
        twin.transfer(501, bytes(8), 0)
    with pytest.raises(UsageError, match="without bytes"):
        twin.transfer(501, b"")
    with pytest.raises(UsageError, match="advance to cycle 1"):
        twin.advance(1)
    with pytest.raises(UsageError, match="no output pin 'sck'"):
        twin.level("sck")
    with pytest.raises(UsageError, match="no input pin 'step0'"):
        twin.schedule(600, "step0", 1)
