"""The worked vectors of the specification at the pins of the gateware, and its parameters."""

import functools
import gc

import numpy as np
import pytest

from pulsewright.boards.usc.gateware import Usc, UscBoards
from pulsewright.errors import UsageError
from pulsewright.gateware.rtl import RtlSimulation
from pulsewright.transport.bus import EPP_ACCESS

TICK = 4  # cycles, at 40 MHz

simulation = functools.cache(lambda *options: RtlSimulation(Usc(**dict(options))))


class Host:
    """A host on the bus of one board, and hands on its other pins."""

    def __init__(self, **options):
        self.board = simulation(*sorted(({"watchdog_us": 0} | options).items()))
        self.board.reset()
        self.seen = []
        self.levels = np.zeros(1, self.board.inputs)
        self.set(nwrite=1, ndatastr=1, naddrstr=1, ninit=1, estop_chain=1)

    def set(self, cycles=1, **levels):
        """Bring inputs to levels and go on for some cycles."""
        for name, level in levels.items():
            self.levels[name] = level
        self.levels["cycle"] = self.board.cycle
        self.seen.append(self.board.run(self.board.cycle + cycles, self.levels))

    def do(self, text):
        """Carry out accesses, such as ``A10 W0F R``; return the bytes read and the last access."""
        words = text.split()
        accesses = np.zeros(len(words), EPP_ACCESS)
        accesses["cycle"] = -1
        accesses["op"] = [ord(word[0]) for word in words]
        accesses["value"] = [int(word[1:] or "0", 16) for word in words]
        self.seen.append(self.board.transact(accesses, nwait_idle=0))
        self.last = accesses[-1]
        return accesses["value"][accesses["op"] == ord("R")].tolist()

    def first_tick(self):
        """Return the cycle of the first tick after the last access."""
        return (int(self.last["cycle"]) // TICK + 1) * TICK

    def quadrature(self, axis, counts):
        """Turn an encoder, from its present lines on."""
        for _ in range(abs(counts)):
            a, b = (int(self.levels[pin][0]) >> axis & 1 for pin in "ab")
            turns_a = (a == b) == (counts > 0)
            pin = "a" if turns_a else "b"
            self.set(10, **{pin: int(self.levels[pin][0]) ^ 1 << axis})

    def pulses(self, pin, bit=0):
        """Return the cycles at which a pin rises and those at which it falls."""
        rows = np.concatenate(self.seen)
        level = np.append(0, rows[pin] >> bit & 1).astype(int)
        rises, falls = (rows["cycle"][np.flatnonzero(np.diff(level) == d)] for d in (1, -1))
        return rises, falls

    def run(self):
        """Leave estop with all outputs off."""
        self.do("A1F W00 A1F W80")


def test_vector_1_ident():
    host = Host()
    assert host.do("A0F R a") == [0x41]
    assert host.last["value"] == 0x10


def test_vector_2_another_board():
    host = Host()
    host.do("A2F")
    assert host.last["timeout"] == 1
    assert host.do("R") == [0x2F]
    assert host.last["timeout"] == 1


def test_vector_3_the_address_wraps_in_the_board():
    host = Host()
    host.do("A1E WFE W80 W12")
    assert len(host.pulses("running")[0]) == 1
    assert host.do("A0C WF0 A04 W20 A00 R R R") == [0x12, 0x00, 0x00]


def test_vector_4_estop():
    host = Host()
    assert host.do("A0E R") == [0x00]
    assert host.do("A1F W80 A0E R") == [0x80]
    host.set(100, estop_chain=0)
    host.set(100, estop_chain=1)
    assert host.do("A0E R") == [0x00]
    assert host.do("A1F W80 A0E R") == [0x00]
    assert host.do("A1F W00 A1F W80 A0E R") == [0x80]


def test_vector_5_watchdog():
    host = Host(watchdog_us=10_000)
    host.do("A1F W80 A0E R")
    assert not len(host.pulses("running")[0])
    host.do("A1F W00 A10 W10 W27 W00 W10 W27 W00")
    fed = host.first_tick()
    host.do("A1F W80")
    host.set(410_000)
    rises, falls = host.pulses("running")
    assert len(rises) == 1
    assert falls.tolist() == [fed + (100_000 - 1) * TICK]


@pytest.mark.parametrize(("profile", "period"), [("document", 9997), ("linuxcnc", 10_000)])
def test_vectors_6_and_7_period(profile, period):
    host = Host(profile=profile, ident=0x42)
    host.run()
    host.do("A10 W0C W27 W00 A1C W03")
    r = host.first_tick()
    host.set(35_000 * TICK)
    expected = [r + (k * period - 1) * TICK for k in (1, 2, 3)]
    assert host.pulses("step")[0].tolist() == expected
    assert len(host.pulses("dir")[0]) == 1


@pytest.mark.parametrize("divisor", [1, 2, 3, 4])
def test_vector_8_fastest_rates(divisor):
    host = Host()
    host.run()
    host.do(f"A10 W{divisor:02X} W00 W00 A1C W03")
    r = host.first_tick()
    host.set(101 * TICK)
    rises, falls = host.pulses("step")
    assert rises[0] == r + divisor * TICK
    assert set(np.diff(rises)) == {(divisor + 1) * TICK}
    assert set(falls - rises[: len(falls)]) == {TICK}


def test_vector_9_a_smaller_divisor_gives_one_pulse():
    host = Host()
    host.run()
    host.do("A10 W0F W27 W00 A1C W03")
    host.set(5000 * TICK)
    host.do("A10 W63 W00 W00")
    tick = host.first_tick()
    host.set(350 * TICK)
    assert host.pulses("step")[0].tolist() == [tick + k * 100 * TICK for k in range(4)]


def test_vector_10_divisor_0_halts():
    host = Host()
    host.run()
    host.do("A10 W0F W27 W00 A1C W03")
    host.set(5000 * TICK)
    host.do("A10 W00 W00 W00")
    host.set(5000 * TICK)
    assert not len(host.pulses("step")[0])
    host.do("A10 W63 W00 W00")
    r = host.first_tick()
    host.set(150 * TICK)
    assert host.pulses("step")[0].tolist() == [r + 99 * TICK]


@pytest.mark.parametrize(("profile", "code"), [("document", "D7"), ("linuxcnc", "D8")])
def test_vector_11_pulse_width_of_4_us(profile, code):
    host = Host(profile=profile, ident=0x42)
    host.run()
    host.do(f"A1E W{code} A10 WFF W00 W00 A1C W03")
    host.set(400 * TICK)
    rises, falls = host.pulses("step")
    assert falls[0] - rises[0] == 40 * TICK


@pytest.mark.parametrize(("period", "next_pulses"), [(1000, (1000, 2000)), (200, (240, 440))])
def test_vectors_12_and_13_direction_change(period, next_pulses):
    host = Host(profile="linuxcnc", ident=0x42)
    host.run()
    low, mid = (period - 4).to_bytes(2, "little")
    host.do(f"A1D W9C WD8 A10 W{low:02X} W{mid:02X} W00 A1C W03")
    k = host.first_tick() + (period - 1) * TICK
    # the write acts at the third edge of its strobe; that lies between the ticks k+10 and k+11
    host.do("A1C")
    host.set(k + 10 * TICK - host.board.cycle)
    host.do("W02")
    assert k + 10 * TICK < host.last["cycle"] < k + 11 * TICK
    host.set(2500 * TICK)
    rises, falls = host.pulses("step")
    assert (rises[0], falls[0]) == (k, k + 40 * TICK)
    assert host.pulses("dir")[1].tolist() == [k + 140 * TICK]
    assert rises[1:3].tolist() == [k + n * TICK for n in next_pulses]


def test_vector_14_soft_latch():
    host = Host()
    host.quadrature(0, -2)
    host.do("A04 W20 A04 W20 A04 W00")
    host.quadrature(0, 7)
    assert host.do("A00 R R R") == [0xFE, 0xFF, 0xFF]
    assert host.do("A04 W20 A00 R R R") == [0x05, 0x00, 0x00]


def test_vector_15_load_position():
    host = Host()
    host.do("A03 WF0 A00")
    counts = []
    for byte in ("56", "34", "12"):
        host.do(f"W{byte}")
        counts.append(host.do(f"A04 W20 A04 W00 A00 R R R A{len(counts) + 1:02X}"))
    assert counts == [[0x56, 0, 0], [0x56, 0x34, 0], [0x56, 0x34, 0x12]]
    host.quadrature(3, 3)
    host.do("A03 W00")
    host.quadrature(3, 2)
    assert host.do("A04 W20 A06 R R R R R R") == [0x56, 0x34, 0x12, 0x58, 0x34, 0x12]


def test_vector_16_index_sense():
    host = Host()
    host.set(20, index=0b0010)
    assert host.do("A0C R A0C R") == [0x02, 0x00]


def test_vector_17_index_reset():
    host = Host(profile="linuxcnc", ident=0x42)
    host.do("A0F R A00 W88 W13 W00 A0C W10 A0C W00 A0D W01")
    host.set(20, index=0b0001)
    assert host.do("A04 W20 A04 W00 A00 R R R") == [0, 0, 0]
    assert host.do("A0C R") == [0x01]
    host.quadrature(0, 3)
    host.set(20, index=0)
    host.set(20, index=1)  # the register still holds 1
    assert host.do("A04 W20 A04 W00 A00 R R R") == [0, 0, 0]


def test_vector_18_directions():
    host = Host()
    host.run()
    host.do("A10" + " W09 W00 W00" * 4 + " A1C WFB")
    host.set(200 * TICK)
    assert [len(host.pulses("dir", axis)[0]) for axis in range(4)] == [1, 0, 1, 1]
    assert [len(host.pulses("step", axis)[0]) for axis in range(4)] == [20] * 4


def test_the_intr_line_is_asserted_for_1_us_and_may_come_late():
    host = Host()
    host.do("A04 W20")
    host.set(100)
    rises, falls = host.pulses("intr_o")
    assert (falls - rises).tolist() == [10 * TICK]
    host.do("A04 W00")
    host.quadrature(0, 1)
    host.set(10, intr_i=1)
    host.quadrature(0, 1)
    assert host.do("A00 R") == [1]  # latched by the leading edge, and not again


def test_the_bus_reset_keeps_the_board_in_reset():
    host = Host()
    host.do("A1F WFF A0F W55")
    assert host.do("A0F R") == [0x41]
    host.set(3, ninit=0)
    assert host.do("A0F R") == [0x0F]  # nobody answers
    assert host.last["timeout"] == 1
    host.set(1, ninit=1)
    assert host.do("A0E R") == [0x00]
    rises, falls = host.pulses("dac")
    assert len(rises) == len(falls) == 1


def refusal(make, **options):
    """Return the message, when what was half made is gone."""
    message = ""
    try:
        make(**options)
    except UsageError as error:
        message = str(error)
    gc.collect()
    return message


@pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable")
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"profile": "pluto"}, "no profile 'pluto'"),
        ({"colour": 1}, "no profile switch 'colour'"),
        ({"min_space": 0}, "min_space = 0"),
        ({"axes": 5}, "1..4"),
        ({"clock_hz": 25_000_000}, "multiples of 10000000 Hz"),
        ({"nwait_idle": 2}, "0 and 1"),
    ],
)
def test_parameters_are_checked(options, words):
    assert words in refusal(Usc, **options)


@pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable")
def test_boards_must_fit_on_the_bus():
    assert "allowed are 1..2 of them" in refusal(UscBoards, boards=3, base=6)
