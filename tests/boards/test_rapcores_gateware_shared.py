# amaranth: UnusedElaboratable=no
"""Shared arithmetic does what arithmetic of each motor does, clock by clock, on random traffic.

The core with arithmetic of each motor does the worked vectors; see test_rapcores_gateware.py.
"""

from itertools import pairwise
from random import Random

import pytest
from amaranth import Module, Signal
from amaranth.hdl import MemoryInstance
from amaranth.lib.memory import Memory
from rapcores_equality import Pair, busy
from rapcores_host import MOVE, STATUS, Host
from rapcores_traffic import play

from pulsewright.boards.rapcores import gateware_registers, gateware_shared
from pulsewright.boards.rapcores.gateware import Rapcores

pytestmark = pytest.mark.rtl

U = 1 << 63
BOARDS = (
    {},
    {"motors": 1, "encoders": 1, "depth": 4},
    {"motors": 2, "encoders": 3, "word_bits": 32},
)
LONG = (
    *BOARDS,
    {"motors": 8, "encoders": 8, "depth": 8},
    {"motors": 3, "encoders": 0, "halt_pin": 0},
    {"motors": 5, "encoders": 2, "cs_reset_message": 0, "word_bits": 32},
)


def compare(seed, options, half=6, **more):
    """Play the same on both cores; return the number of pin changes."""
    turning = bool(seed % 2)
    channels = {name: options.get(name, 4) for name in ("motors", "encoders")}
    least = Rapcores(shared_dda=1, **options).min_divider
    found = []
    for shared in (0, 1):
        replies, telemetry, trace = play(
            Host(shared_dda=shared, **options),
            seed,
            least_divider=least,
            half=half,
            turning=turning,
            **channels,
            **more,
        )
        found.append((replies, telemetry, trace))
    (replies, telemetry, trace), (shared_replies, shared_telemetry, shared_trace) = found
    assert shared_replies == replies
    assert shared_telemetry == telemetry
    assert trace.first_difference(shared_trace) is None
    return sum(len(cycles) for cycles in trace.cycles)


@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize("options", BOARDS, ids=str)
def test_shared_arithmetic_is_as_exact(options, seed):
    assert compare(seed, options, messages=40) > 20


@pytest.mark.campaign
@pytest.mark.parametrize("half", [2, 6])
@pytest.mark.parametrize("seed", range(10, 30))
@pytest.mark.parametrize("options", LONG, ids=str)
def test_shared_arithmetic_is_as_exact_in_the_long_run(options, seed, half):
    assert compare(seed, options, half) > 20


def test_the_smallest_divider():
    assert Rapcores().min_divider == 0
    assert Rapcores(shared_dda=1).min_divider == 23  # 5 entries of 4 slices, and 4 cycles
    assert Rapcores(shared_dda=1, motors=8, encoders=8).min_divider == 39


@pytest.mark.parametrize("divider", [0, 22, 23, 24])
def test_below_the_smallest_divider_ticks_are_as_far_apart_as_there(divider):
    host = Host(shared_dda=1)
    host.write(2, divider)
    for address in range(0xC0, 0xC4):
        host.write(address, 5)
    host.send(MOVE, 5, -U, *[0] * 7)
    host.run(host.fell + 400)
    rises = [cycle for cycle, level in host.edges("step0") if level]
    period = 1 + max(divider, 23)
    assert [b - a for a, b in pairwise(rises)][1:] == [period] * 3
    assert host.write(2, 40) == divider


def test_telemetry_of_the_start_of_a_move_with_shared_arithmetic():
    host = Host(shared_dda=1, motors=1, encoders=1)
    host.pin(400, "enc0_b", 1)
    host.run(500)
    start = [(1 << 64) - 1, (1 << 64) - (400 - 253)]
    assert host.send(MOVE, 60_000, 0, 0) == [0, 0, *start]
    host.pin(host.free + 10, "enc0_b", 0)
    host.run(host.free + 50)
    assert host.send(MOVE, 1, 0, 0) == [0, 0, *start]
    assert host.status(0x04) == 0


def test_moves_that_end_one_after_the_other_are_all_counted():
    host = Host(shared_dda=1, motors=1, encoders=1, depth=16)
    host.send(MOVE, 1300, 0, 0)
    for _ in range(15):
        host.send(MOVE, 0, 0, 0)
    host.run(host.free + 10_000)
    assert len(host.edges("move_done")) == 16
    assert host.status(0xE2) == 16


def test_a_reset_clears_what_is_in_memory():
    host = Host(shared_dda=1)
    host.write(0xC0, 7)
    host.pin(host.free, "enc0_a", 1)
    host.send(MOVE, 10, -U, *[0] * 7)
    host.send(MOVE, 0, *[0] * 8)
    host.run(host.free + 1000)
    assert [host.status(place) for place in (4, 0xC0, 0xE2)] == [1, (1 << 64) - 10, 2]
    host.pin(host.free, "rst_n", 0)
    host.pin(host.free + 3, "rst_n", 1)
    host.run(host.free + 300)
    places = (4, 0x44, 0xC0, 0xE2, 1)
    assert [host.status(place) for place in places] == [0, 0, 0, 0, 0x20200404]
    assert host.send(0xF3 << 56 | 0xC0, 0) == [0, 20]
    assert host.send(STATUS | 0xFE, 0) == [0, 0x2040]


@pytest.mark.parametrize("shared", [0, 1])
def test_a_reset_clears_fractions_of_steps(shared):
    host = Host(shared_dda=shared, motors=1, encoders=0)
    for half_steps in (1, 3):  # the last ones make one and a half
        host.send(MOVE, half_steps, U >> 1, 0)
        host.run(host.free + 1000)
        host.pin(host.free, "rst_n", int(half_steps == 3))
        host.pin(host.free + 3, "rst_n", 1)
        host.run(host.free + 300)
    assert host.status(0xC0) == 1


@pytest.mark.parametrize("shared", [0, 1])
@pytest.mark.parametrize("address", [0x01, 0x04])
def test_nothing_of_a_reply_is_shown_after_a_reset_within_its_frame(shared, address):
    host = Host(shared_dda=shared, motors=1, encoders=1)
    host.pin(host.free, "enc0_b", 1)  # one down, so that the reply is -1
    start = host.free + 10
    low = host.f(1, start) + 150
    host.pin(low, "rst_n", 0)
    host.pin(low + 1, "rst_n", 1)
    host.send(STATUS | address, 0, start=start)
    assert host.fell > low + 500  # well after the board is ready again
    first, *_, last = [cycle for cycle, _ in host.edges("cipo")]
    assert first < low
    assert last <= low + 5


def test_the_shortest_reset_clears_the_time_since_the_last_count():
    for phase in range(30):
        host = Host(shared_dda=1, motors=1, encoders=1)
        host.pin(320, "enc0_a", 1)
        low = 400 + phase
        host.pin(low, "rst_n", 0)
        host.pin(low + 1, "rst_n", 1)
        host.pin(low + 600, "enc0_a", 0)
        host.run(low + 700)
        # it counts from the end of the reset, 255 cycles after that with the pin low
        assert host.status(0x44) == (1 << 64) - (600 + 2 - 256)


def test_telemetry_is_that_of_the_cycle_in_which_a_move_starts():
    for phase in range(20):
        host = Host(shared_dda=1, motors=1, encoders=1)
        f = host.f(4, 300 + phase)
        begin = f - 100
        for n in range(120):  # a count in each cycle, up, visible after three
            host.pin(begin + n, "enc0_" + "ab"[n % 2], int(n % 4 < 2))
        host.send(MOVE, 60_000, 0, 0, start=300 + phase)
        assert host.fell == f
        # the move starts in f + 5
        assert host.send(MOVE, 1, 0, 0) == [0, 0, f + 5 - 3 - begin + 1, 0]
        assert host.status(0x04) == 120


@pytest.mark.parametrize("shared", [0, 1])
def test_telemetry_asked_for_as_a_move_without_ticks_ends(shared):
    found, last = [], 0
    for late in (None, 0, 1, 2):
        host = Host(shared_dda=shared, motors=1, encoders=1, depth=4)
        for duration in (300, 0, 1000):
            host.send(MOVE, duration, 0, 0)
        if late is None:
            host.run(host.free + 10_000)
            first, second = (cycle for cycle, _ in host.edges("move_done"))
            last = first - 1  # the last tick; what is behind starts with it and a cycle later
            assert second == first + 1
            continue
        for n in range(120):  # a count in each cycle, up, visible after three
            host.pin(last - 99 + n, "enc0_" + "ab"[n % 2], int(n % 4 < 2))
        reply = host.send(MOVE, 1, 0, 0, start=last + late - 4 - host.f(1, 0))
        assert host.f(1, last + late - 4 - host.f(1, 0)) + 4 == last + late
        found.append(reply[2])
    # in the cycle of the last tick still that of the first move; the limit of shared arithmetic
    assert found == [0, 98 if shared else 97, 98]


class SpoilingMemory(Memory):
    """Block RAM in which a word that is read as it is written comes out wrong."""

    def elaborate(self, platform):
        m = Module()
        assert self.attrs["no_rw_check"]
        m.submodules.memory = memory = MemoryInstance(data=self.data, attrs=self.attrs)
        (written,), (read,) = self.write_ports, self.read_ports
        data, spoilt = Signal.like(read.data), Signal(reset_less=True)
        memory.write_port(domain="sync", addr=written.addr, data=written.data, en=written.en)
        memory.read_port(domain="sync", addr=read.addr, data=data, en=read.en, transparent_for=())
        m.d.sync += spoilt.eq(written.en.any() & (written.addr == read.addr))
        m.d.comb += read.data.eq(data ^ spoilt.replicate(len(data)))
        return m


@pytest.mark.parametrize(
    "options",
    [
        {"motors": 1, "encoders": 1, "depth": 8},
        pytest.param({}, marks=pytest.mark.campaign),
        pytest.param({"motors": 3, "word_bits": 32}, marks=pytest.mark.campaign),
    ],
    ids=str,
)
def test_no_word_is_used_that_is_read_as_it_is_written(monkeypatch, options):
    # bitstreams rely on that: `no_rw_check`
    monkeypatch.setattr(gateware_registers, "Memory", SpoilingMemory)
    monkeypatch.setattr(gateware_shared, "Memory", SpoilingMemory)
    pair = Pair(shared_dda=1, **options)
    for seed in range(2):
        pair.run(busy(Random(seed), pair, 100_000, flaws=100))
