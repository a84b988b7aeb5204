"""The worked vectors of the USC specification on the twin, and what its user meets first."""

import numpy as np
import pytest

from pulsewright.boards.usc.twin import UscTwin
from pulsewright.edges.trace import concatenate
from pulsewright.errors import BusError, UsageError
from pulsewright.transport.bus import EPP_ACCESS

TICK = 4  # cycles
START = 4_000_000  # far behind every setup access, and a tick
QUADRATURE = [(0, 0), (1, 0), (1, 1), (0, 1)]  # (A, B), counting up


class Host:
    """Single accesses on a twin, as a driver makes them."""

    def __init__(self, *arguments, watchdog_us=0, **options):
        self.twin = UscTwin(*arguments, watchdog_us=watchdog_us, **options)

    def access(self, op, value=0, cycle=-1):
        accesses = np.array([(cycle, ord(op), value, 0, (0,) * 5)], EPP_ACCESS)
        self.twin.transact(accesses)
        return accesses[0]

    def aw(self, value, cycle=-1):
        self.access("A", value, cycle)

    def dw(self, *values, cycle=-1):
        for value in values:
            assert not self.access("W", value, cycle)["timeout"]

    def dr(self, count=1):
        accesses = [self.access("R") for _ in range(count)]
        assert not any(a["timeout"] for a in accesses)
        return [int(a["value"]) for a in accesses]

    def set(self, register, *values):
        self.aw(register)
        self.dw(*values)

    def release(self):
        self.set(0x1F, 0x00)
        self.set(0x1F, 0x80)

    def rates(self, *divisors):
        self.set(0x10, *(byte for n in divisors for byte in n.to_bytes(3, "little")))

    def run_at(self, cycle, control=0x03):
        """Write the control byte so that the tick after ``cycle`` is the first active one."""
        self.aw(0x1C)
        self.dw(control, cycle=cycle)

    def rises(self, ticks, pin="step0"):
        """Ticks after START at which ``pin`` rises, up to tick ``ticks``."""
        self.twin.advance(START + ticks * TICK)
        return ((self.twin.drain().edges(pin, 1) - START) / TICK).tolist()


def running(divisor, profile="document", **options):
    """A host whose axis 0 is active from the tick at START on (r = 0)."""
    host = Host(profile, **options)
    host.rates(divisor)
    host.release()
    host.run_at(START - 1)
    return host


# ------------------------------------------------------------------ worked vectors, specification 8


def test_vector_1_identification():
    host = Host()
    host.aw(0x0F)
    assert host.dr() == [0x41]
    assert host.twin.state()["address"] == 0x10


def test_vector_2_no_board_leaves_the_address_on_the_bus():
    host = Host()
    host.aw(0x2F)
    answer = host.access("R")
    assert (answer["value"], answer["timeout"]) == (0x2F, 1)


def test_vector_3_increment_wraps_inside_the_board():
    host = Host()
    host.set(0x1E, 0xFE, 0x80, 0x12)
    state = host.twin.state()
    assert (state["width"], state["dout"], state["assembly"]) == (0xFE, 0x80, 0x12)


def test_vector_4_estop_leaves_on_an_edge_of_the_release_bit():
    host = Host()

    def status():
        host.aw(0x0E)
        return host.dr()[0] >> 7

    assert status() == 0
    host.set(0x1F, 0x80)
    assert status() == 1
    host.twin.set_estop_chain(False)
    host.twin.set_estop_chain(True)
    assert status() == 0
    host.set(0x1F, 0x80)
    assert status() == 0
    host.set(0x1F, 0x00)
    host.set(0x1F, 0x80)
    assert status() == 1


def test_vector_5_watchdog():
    host = Host(watchdog_us=10_000)
    host.set(0x1F, 0x80)  # cycles 0, 60
    assert host.twin.state()["estop"]
    host.set(0x1F, 0x00)  # 120, 180
    host.set(0x10, 0x10, 0x27, 0x00, 0x10, 0x27, 0x00)  # 240 .. 600: the feed
    host.set(0x1F, 0x80)  # 660, 720
    assert not host.twin.state()["estop"]
    assert host.twin.state()["watchdog_left"] == 100_000 - 30
    host.twin.advance(1_000_000)
    assert host.twin.drain()["running"].tolist() == [720, 600 + 400_000]


def test_vector_6_one_kilohertz():
    host = running(9999)
    assert host.rises(40_000) == [9999, 19_999, 29_999, 39_999]
    assert host.twin.state()["steps"] == [4, 0, 0, 0]


@pytest.mark.parametrize(("profile", "period"), [("linuxcnc", 10_000), ("document", 9997)])
def test_vector_7_divisor_of_the_client(profile, period):
    host = running(0, profile)
    host.set(0x10, 0x0C, 0x27, 0x00)
    host = running(0x00270C, profile)
    assert host.rises(25_000) == [period - 1, 2 * period - 1]


@pytest.mark.parametrize(("divisor", "period"), [(1, 2), (2, 3), (3, 4), (4, 5)])
def test_vector_8_fastest_rates(divisor, period):
    host = running(divisor)
    host.twin.advance(START + 1 + 20 * period * TICK)
    edges = ((host.twin.drain()["step0"] - START) / TICK).tolist()
    first = period - 1
    assert edges[::2] == [first + period * n for n in range(len(edges[::2]))]
    assert edges[1::2] == [tick + 1 for tick in edges[::2]][: len(edges[1::2])]
    assert len(edges[::2]) == 20


def test_vector_9_shorter_period_gives_one_pulse_at_the_next_tick():
    host = running(9999)
    host.aw(0x10)
    host.dw(99, 0)
    host.dw(0, cycle=START + 4999 * TICK)  # C = 5000 after this tick
    assert host.rises(5250) == [5000, 5100, 5200]


def test_vector_10_divisor_0_halts_and_clears_the_counter():
    host = running(9999)
    host.aw(0x10)
    host.dw(0, 0)
    host.dw(0, cycle=START + 4999 * TICK)
    host.aw(0x10)
    host.dw(99, 0)
    host.dw(0, cycle=START + 20_000 * TICK - 1)
    assert host.rises(20_250) == [20_099, 20_199]


@pytest.mark.parametrize(
    ("profile", "width", "setup"), [("document", 0xD7, 0x9B), ("linuxcnc", 0xD8, 0x9C)]
)
def test_vector_11_time_codes(profile, width, setup):
    host = Host(profile)
    host.rates(999 if profile == "document" else 996)
    host.set(0x1D, setup, width)
    host.release()
    host.run_at(START - 1, 0x03)
    host.aw(0x1C)
    host.dw(0x02, cycle=START + 999 * TICK)  # reverse right after the pulse started
    host.twin.advance(START + 3000 * TICK)
    trace = host.twin.drain()
    assert ((trace["step0"][:2] - START) / TICK).tolist() == [999, 1039]  # 4 us
    assert ((trace["dir0"][1:] - START) / TICK).tolist() == [1139]  # 10 us


@pytest.mark.parametrize(("period", "starts"), [(1000, [0, 1000, 2000]), (200, [0, 240, 440, 640])])
def test_vectors_12_and_13_reversal(period, starts):
    host = Host("linuxcnc")
    host.rates(period - 4)
    host.set(0x1D, 0x9C, 0xD8)
    host.release()
    host.run_at(START - (period - 1) * TICK - 1)  # the first pulse starts at tick 0
    host.aw(0x1C)
    host.dw(0x02, cycle=START + 10 * TICK + 1)
    host.twin.advance(START + (starts[-1] + 39) * TICK)
    trace = host.twin.drain()
    ticks = {pin: ((trace[pin] - START) / TICK).tolist() for pin in ("step0", "dir0")}
    expected = [edge for tick in starts for edge in (tick, tick + 40)]
    assert ticks["step0"] == expected[:-1]
    assert ticks["dir0"][1:] == [140]
    assert host.twin.state()["steps"][0] == 1 - (len(starts) - 1)


def turn(twin, axis, counts, phase, cycle):
    """Let an encoder move from quadrature ``phase`` by ``counts``, one every 10 cycles."""
    step = 1 if counts > 0 else -1
    for n in range(abs(counts)):
        phase = (phase + step) % 4
        for pin, level in zip("ab", QUADRATURE[phase], strict=True):
            twin.schedule([cycle + 10 * n], f"{pin}{axis}", level)
    twin.advance(cycle + 10 * abs(counts))
    return phase


def test_vector_14_soft_latch_acts_on_its_edge():
    host = Host()
    phase = turn(host.twin, 0, -2, 0, 100)
    host.set(0x04, 0x20)
    host.set(0x04, 0x20)
    turn(host.twin, 0, 7, phase, 10_000)
    assert host.twin.state()["enc"][0] == 5
    host.set(0x04, 0x20)
    host.set(0x04, 0x00)
    host.aw(0x00)
    assert host.dr(3) == [0xFE, 0xFF, 0xFF]


def test_vector_15_load_position_is_transparent():
    host = Host()
    host.set(0x03, 0xF0)
    host.aw(0x00)
    for byte, value in zip((0x56, 0x34, 0x12), (0x56, 0x3456, 0x123456), strict=True):
        host.dw(byte)
        assert host.twin.state()["enc"] == [value] * 4
    turn(host.twin, 2, 3, 0, 10_000)  # lost
    host.set(0x03, 0x00)
    turn(host.twin, 2, 3, 3, 20_000)
    assert host.twin.state()["enc"] == [0x123456, 0x123456, 0x123459, 0x123456]


def test_vector_16_reading_clears_the_index_sense():
    host = Host()
    host.twin.schedule([100], "index1", 1)
    host.twin.advance(200)
    host.aw(0x0C)
    assert host.dr() == [0x02]
    host.aw(0x0C)
    assert host.dr() == [0x00]


def test_vector_17_index_reset():
    host = Host(ident=0x42)
    host.set(0x0D, 0x01)
    host.twin.set_encoder(0, 5000)
    host.twin.schedule([1000], "index0", 1)
    host.twin.advance(1001)
    assert host.twin.state()["enc"][0] == 5000
    host.twin.advance(1002)  # two flops behind
    state = host.twin.state()
    assert (state["enc"][0], state["index_sense"], state["index_reset"]) == (0, 1, 1)


def test_load_position_wins_over_index_reset():
    host = Host(ident=0x42)
    host.set(0x0D, 0x01)
    host.set(0x03, 0x10)
    host.set(0x00, 0x05)
    host.twin.index_edge(0)
    host.twin.schedule([1000], "index0", 1)
    host.twin.advance(1100)
    state = host.twin.state()
    assert (state["enc"][0], state["index_sense"]) == (5, 1)


def test_a_capture_takes_the_count_before_its_reset():
    host = Host(ident=0x42)
    host.set(0x0D, 0x01)
    host.set(0x03, 0x01)
    host.twin.set_encoder(0, 5000)
    host.twin.schedule([1000, 1000], ["index0", "a0"], [1, 1])  # a count at the same edge
    host.twin.advance(1100)
    state = host.twin.state()
    assert (state["latch"][0], state["enc"][0]) == (5000, 0)


def test_version_1_ignores_index_reset():
    host = Host(ident=0x41)
    host.set(0x0D, 0x01)
    host.twin.set_encoder(0, 5000)
    host.twin.index_edge(0)
    assert host.twin.state()["enc"][0] == 5000


def test_vector_18_control_byte():
    host = Host()
    host.rates(99, 99, 99, 99)
    host.release()
    host.run_at(START - 1, 0xFB)
    host.twin.advance(START + 101 * TICK)
    assert host.twin.state()["steps"] == [1, -1, 1, 1]
    assert host.twin.drain().final()[4:8].tolist() == [1, 0, 1, 1]


# --------------------------------------------------------------------- bus vectors of the socket, 9


def test_socket_vector_3_counts_after_reset_are_0():
    host = Host()
    host.aw(0x00)
    assert host.dr(4) == [0, 0, 0, 0]


def test_socket_vector_4_a_write_nobody_takes_times_out():
    host = Host()
    host.aw(0x2F)
    assert host.access("W", 0x55)["timeout"] == 1
    lingering = host.access("R")
    assert (lingering["value"], lingering["timeout"]) == (0x55, 1)
    host.aw(0x0F)
    assert host.dr() == [0x41]


def test_socket_vector_7_boards_in_reset_do_not_answer():
    host = Host()
    host.set(0x0F, 0x77)
    host.twin.set_ninit(0)
    host.aw(0x0F)
    answer = host.access("R")
    assert (answer["value"], answer["timeout"]) == (0x0F, 1)
    assert host.twin.state()["address"] == 0
    host.twin.set_ninit(1)
    host.aw(0x0F)
    assert host.dr() == [0x41]
    assert host.twin.state()["extra"] == 0


def test_address_read_gives_the_address_register_and_does_not_increment():
    host = Host(base=5)
    host.aw(0xAD)
    assert host.access("a")["value"] == 0xAD
    assert host.access("a")["value"] == 0xAD


def test_exit_of_the_client_gives_no_pulse():
    """32 zero bytes from base 10h: N = 0 comes ten writes before run = 0, and the burst wraps."""
    host = running(9999)
    host.twin.advance(START + 9000 * TICK)
    host.set(0x10, *[0] * 32)
    assert host.rises(50_000) == []
    state = host.twin.state()
    assert (state["rate"], state["rate_ctrl"], state["dout"]) == ([0] * 4, 0, 0)


def test_scan_finds_each_board_in_its_even_slot():
    host = Host(boards=2)
    found = []
    for slot in range(16):
        host.aw(slot * 16 + 0x0F)
        found.append(int(host.access("R")["value"]))
    assert found[:4] == [0x41, 0x00, 0x41, 0x00]
    assert found[4:] == [slot * 16 + 0x0F for slot in range(4, 16)]


# ---------------------------------------------------------------------------------- latches, Intr


def test_soft_latch_of_the_first_board_latches_the_others():
    host = Host(boards=2)
    host.twin.set_encoder(3, 0x123456, board=1)
    host.set(0x04, 0x20)
    host.aw(0x29)
    assert host.dr(3) == [0x56, 0x34, 0x12]


def test_timer_latches_every_100_us_times_rate():
    host = Host(boards=2)
    host.aw(0x04)
    host.dw(0x12, cycle=1000)  # master, rate 2: 200 us = 8000 cycles
    for n, value in ((1, 11), (2, 22)):
        event = 1000 + 8000 * n  # the 2000th tick after the write, a tick itself
        host.twin.set_encoder(0, value, board=1)
        host.twin.advance(event - 1)
        assert host.twin.state(1)["latch"][0] == (0 if n == 1 else 11)
        host.twin.advance(event)
        assert host.twin.state(1)["latch"][0] == value


def latch_times(host, start, end):
    """Cycles at which the latch of axis 0 takes a new count; the count changes all the time."""
    times, last = [], host.twin.state()["latch"][0]
    for cycle in range(start, end, 4):
        host.twin.advance(cycle)
        latch = host.twin.state()["latch"][0]
        if latch != last:
            times.append(cycle)
            last = latch
        host.twin.set_encoder(0, cycle)
    return times


def test_a_stopped_timer_starts_anew():
    host = Host()
    host.aw(0x04)
    host.dw(0x11, cycle=1000)  # 100 us = 4000 cycles
    host.aw(0x04)
    host.dw(0x10, cycle=3000)
    host.aw(0x04)
    host.dw(0x11, cycle=5000)
    assert latch_times(host, 5000, 9100) == [9000]


@pytest.mark.parametrize(
    ("before", "after", "at", "event"),
    [(0x11, 0x12, 3000, 9000), (0x12, 0x11, 7000, 7004), (0x12, 0x11, 3000, 5000)],
)
def test_a_new_timer_rate_is_compared_by_magnitude(before, after, at, event):
    host = Host()
    host.aw(0x04)
    host.dw(before, cycle=1000)
    host.aw(0x04)
    host.dw(after, cycle=at)
    assert latch_times(host, at, event + 100) == [event]


@pytest.mark.parametrize(("distance", "latched"), [(40, 1), (41, 2)])
def test_intr_is_asserted_for_1_us(distance, latched):
    """Another board's timer event latches this one, unless the line is still asserted."""
    host = Host(boards=2)
    host.aw(0x24)
    host.dw(0x11, cycle=1000)  # its event is at 5000
    host.aw(0x04)
    host.twin.set_encoder(0, 1)
    host.dw(0x20, cycle=5000 - distance)
    host.twin.set_encoder(0, 2)
    host.twin.advance(5000)
    assert host.twin.state()["latch"][0] == latched


def test_an_event_while_intr_is_asserted_latches_its_own_board_only():
    host = Host(boards=2, access_cycles=10)
    host.aw(0x04)
    host.dw(0x20, cycle=1000)  # Intr asserted for 40 cycles
    host.twin.set_encoder(0, 7, board=0)
    host.twin.set_encoder(0, 7, board=1)
    host.aw(0x24, cycle=1020)
    host.dw(0x20, cycle=1039)  # still asserted; prolonged to 1079
    assert host.twin.state(0)["latch"][0] == 0
    assert host.twin.state(1)["latch"][0] == 7
    host.dw(0x00, cycle=1050)
    host.aw(0x24, cycle=1060)
    host.dw(0x00, cycle=1070)
    host.aw(0x24, cycle=1075)
    host.dw(0x20, cycle=1085)
    assert host.twin.state(0)["latch"][0] == 7


# -------------------------------------------------------------------------- estop, outputs, inputs


def test_estop_forces_outputs_to_0_and_finishes_the_pulse_in_flight():
    host = Host()
    host.rates(999)
    host.set(0x1D, 0xFE, 0x9B)  # 10 us wide
    host.set(0x0F, 0xA5)
    host.set(0x1F, 0x00)
    host.set(0x1F, 0xFF)
    host.run_at(START - 1)
    host.twin.schedule([START + 999 * TICK + 10], "estop_chain", 0)
    host.twin.advance(START + 5000 * TICK)
    trace = host.twin.drain()
    stop = START + 999 * TICK + 12  # two flops
    assert trace["step0"].tolist() == [START + 999 * TICK, START + 1099 * TICK]
    released = trace["running"].tolist()[0]
    for pin in ("running", "out0", "out6", "dac0", "dac7"):
        assert trace[pin].tolist() == [released, stop]
    assert trace["dac1"].tolist() == []
    assert host.twin.state()["dout"] == 0xFF


def test_a_slave_ignores_its_own_chain():
    host = Host()
    host.set(0x06, 1)
    host.twin.set_estop_chain(False)
    host.release()
    assert not host.twin.state()["estop"]
    host.set(0x06, 0)
    assert host.twin.state()["estop"]


def test_digital_inputs_pass_two_flops():
    host = Host()
    host.twin.schedule([100, 100], ["din0", "din14"], [1, 1])
    host.twin.advance(101)
    assert host.twin.state()["din"] == 0
    host.twin.advance(102)
    assert host.twin.state()["din"] == 0x4001
    host.twin.set_din(0x1234)
    host.aw(0x0D)
    assert host.dr(2) == [0x34, 0x12]


def test_an_input_that_is_set_flushes_its_synchroniser():
    twin = UscTwin()
    twin.schedule([100, 103], "din0", [1, 1])
    twin.advance(101)  # edge 100 has sampled it
    twin.set_din(0)
    twin.advance(104)
    assert twin.state()["din"] == 0
    twin.advance(105)
    assert twin.state()["din"] == 1


def test_loopback_counts_each_step_once():
    host = running(9999, loopback=1)
    host.rises(25_000)
    assert host.twin.state()["enc"][0] == 2
    host.twin.set_loopback(False)
    host.rises(45_000)
    assert host.twin.state()["enc"][0] == 2
    assert host.twin.state()["steps"][0] == 4


def test_filter_drops_short_pulses_of_an_encoder_input():
    twin = UscTwin(enc_filter=3)
    twin.schedule([100, 102], "a0", [1, 0])
    twin.advance(200)
    assert twin.state()["enc"][0] == 0
    twin.schedule([300, 303], "b0", [1, 0])
    twin.advance(303)
    assert twin.state()["enc"][0] == 0
    twin.advance(304)  # 300 + 2 flops + 2 more equal samples
    assert twin.state()["enc"][0] == 0xFFFFFF


# ------------------------------------------------------------------------------------------- pins


def strobe(twin, cycle, pin, nwrite, data):
    """One EPP cycle at the pins, as fast as allowed: 5 edges sample the strobe."""
    twin.schedule([cycle, cycle, cycle], ["nwrite", "data", pin], [nwrite, data, 0])
    twin.schedule([cycle + 5, cycle + 5], ["nwrite", pin], [1, 1])


def test_an_epp_cycle_at_the_pins_takes_ten_clocks():
    twin = UscTwin(bus_pins=True)
    strobe(twin, 100, "naddrstr", 0, 0x0F)
    strobe(twin, 110, "ndatastr", 1, 0x00)
    strobe(twin, 120, "naddrstr", 0, 0x2F)  # another board: no acknowledge
    strobe(twin, 130, "ndatastr", 0, 0x55)
    twin.advance(200)
    trace = twin.drain()
    assert trace["nwait"].tolist() == [104, 109, 114, 119]
    # the host raises nWrite with the strobe: the board drives, all 0, until its acknowledge ends
    assert trace["drive"].tolist() == [105, 109, 114, 119]
    assert trace["data0"].tolist() == trace["data6"].tolist() == [114, 119]
    assert trace["data1"].tolist() == []
    assert twin.state()["address"] == 0x2F
    assert twin.state()["writes"] == {}


def test_nwait_can_idle_high():
    twin = UscTwin(bus_pins=True, nwait_idle=1)
    strobe(twin, 100, "naddrstr", 0, 0x0F)
    twin.advance(200)
    trace = twin.drain()
    assert trace.level_at_start("nwait") == 1
    assert trace["nwait"].tolist() == [104, 109]


def test_a_write_at_the_pins_acts_from_the_values_before_its_edge():
    """The tick at the action edge still sees the old registers; an access between edges too."""
    twin = UscTwin(watchdog_us=0)
    strobe(twin, 100, "naddrstr", 0, 0x1F)
    strobe(twin, 110, "ndatastr", 0, 0xFF)  # action at 112
    twin.advance(200)
    assert twin.drain()["out3"].tolist() == [112]


def test_ninit_at_the_pins_resets_and_restarts_the_ticks():
    twin = UscTwin(watchdog_us=0)
    host = Host()
    host.twin = twin
    host.set(0x1F, 0x85)
    twin.schedule([1001, 1003], "ninit", [0, 1])
    twin.advance(2000)
    trace = twin.drain()
    assert trace["out0"].tolist() == [60, 1001]
    host.rates(9)
    host.release()
    host.run_at(4000)
    twin.advance(4100)
    # edge 0 is at 1003, so the first tick after 4000 is at 4003; period 10
    assert twin.drain()["step0"].tolist()[:2] == [4003 + 36, 4003 + 40]


# ---------------------------------------------------------------------------- time, trace, errors


def test_buffers_grow_without_losing_an_edge():
    host = running(1)
    end = START + 400_000
    host.twin.advance(end)
    trace = host.twin.drain()
    assert np.array_equal(trace["step0"], np.arange(START + TICK, end, TICK))


def test_drain_in_portions_gives_the_same_trace():
    def busy():
        host = Host()
        host.rates(9, 16, 99, 3)
        host.set(0x1D, 0xF0, 0xFC)
        host.release()
        host.run_at(START, 0xBE)
        return host.twin

    whole, parts = busy(), busy()
    whole.advance(START + 100_000)
    traces = []
    for cycle in range(START, START + 100_001, 997):
        parts.advance(cycle)
        traces.append(parts.drain())
    parts.advance(START + 100_000)
    traces.append(parts.drain())
    assert concatenate(traces) == whole.drain()


def test_a_change_and_back_in_one_cycle_leaves_no_edge():
    host = Host()
    host.set(0x1F, 0x80)
    host.twin.set_estop_chain(False)
    host.twin.advance(1000)
    assert host.twin.drain()["running"].tolist() == []


def test_accesses_keep_their_distance():
    twin = UscTwin()
    accesses = np.zeros(3, EPP_ACCESS)
    accesses["op"] = ord("A")
    accesses["cycle"] = [100, 110, -1]
    twin.transact(accesses)
    assert accesses["cycle"].tolist() == [100, 160, 220]


def test_accesses_may_lie_apart_in_memory():
    twin = UscTwin()
    accesses = np.zeros(4, EPP_ACCESS)
    accesses["op"] = [ord("A"), 0, ord("R"), 0]
    accesses["value"] = 0x0F
    accesses["cycle"] = -1
    twin.transact(accesses[::2])
    assert accesses["value"].tolist() == [0x0F, 0x0F, 0x41, 0x0F]
    assert accesses["cycle"].tolist() == [0, -1, 60, -1]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"profile": "exact"}, "document, linuxcnc"),
        ({"boards": 9}, "1..8"),
        ({"boards": 2, "base": 7}, "1..1"),
        ({"clock_hz": 25_000_000}, "multiples of 10000000"),
        ({"min_space": 0}, "1..256"),
        ({"speed": 1}, "div_offset"),
        ({"nwait_idle": 2}, "0 and 1"),
        ({"access_cycles": -1}, "0 or more"),
    ],
)
def test_a_wrong_parameter_names_what_is_allowed(options, words):
    with pytest.raises(UsageError, match=words):
        UscTwin(**options)


def test_wrong_requests_are_refused_and_change_nothing():
    twin = UscTwin()
    twin.advance(1000)
    with pytest.raises(UsageError, match="already 1000"):
        twin.advance(999)
    with pytest.raises(UsageError, match="from 1001 on"):
        twin.schedule([1000], "din0", 1)
    with pytest.raises(UsageError, match="no input pin 'din15'"):
        twin.schedule([2000], "din15", 1)
    with pytest.raises(UsageError, match=r"level 2 for input pin a0; allowed are 0..1"):
        twin.schedule([2000], "a0", 2)
    with pytest.raises(UsageError, match="board 1"):
        twin.state(1)
    accesses = np.zeros(2, EPP_ACCESS)
    accesses["op"] = [ord("A"), ord("X")]
    accesses["value"] = 0x55
    with pytest.raises(BusError, match="access 1 has op 88"):
        twin.transact(accesses)
    assert twin.state()["address"] == 0
