"""The USC driver against a bus that remembers what it was told; bytes by hand from the document."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pulsewright.boards.usc.driver import UscDriver, extend_counts, find_boards
from pulsewright.errors import (
    BusError,
    BusTimeoutError,
    EstopError,
    RegisterValueError,
    UsageError,
)
from pulsewright.transport.bus import (
    ADDRESS_READ,
    ADDRESS_WRITE,
    DATA_READ,
    DATA_WRITE,
    EppBus,
)


class RecordingBus(EppBus):
    """A bus with one board that reads ``memory`` (address -> byte, or list of bytes in turn).

    ``writes`` collects (address, bytes) of each run of data writes, ``log`` all accesses as
    (cycle, op, address, value).
    """

    clock_hz = 40_000_000
    access_cycles = 60

    def __init__(self, base=0, **memory):
        self.base = base
        self.memory = {0x0F: 0x41, 0x0E: 0x80}
        self.clear()
        self.time = 0
        self.delay = {}  # index of access in an array -> extra cycles
        self.arrays = 0
        self.closed = 0

    def clear(self):
        self.writes, self.log = [], []

    def transact(self, accesses):
        self.arrays += 1
        address = driven = 0
        fresh = True
        for i, access in enumerate(accesses):
            self.time = max(self.time, int(access["cycle"])) + self.delay.get(i, 0)
            op, selected = int(access["op"]), address >> 5 == self.base
            if op == ADDRESS_WRITE:
                address, fresh = int(access["value"]), True
                driven = address
            elif op == DATA_WRITE:
                driven = int(access["value"])
                if fresh:
                    self.writes.append((address, b""))
                self.writes[-1] = self.writes[-1][0], self.writes[-1][1] + bytes([driven])
                fresh = False
            else:
                assert op == DATA_READ != ADDRESS_READ
                if selected:
                    cell = self.memory.get(address & 31, 0)
                    driven = cell.pop(0) if isinstance(cell, list) else cell
                access["value"] = driven
            if op != ADDRESS_WRITE:
                if not selected:
                    access["timeout"] = 1
                address = address & 0xE0 | (address + 1) & 0x1F
            access["cycle"] = self.time
            self.log.append((self.time, op, address, driven))
            self.time += self.access_cycles

    def reset(self):
        raise NotImplementedError

    def now(self):
        return self.time

    def close(self):
        self.closed += 1


@pytest.fixture
def bus():
    return RecordingBus()


def counts(*values):
    """Return the 12 count bytes of four encoders as memory."""
    data = b"".join((value % 2**24).to_bytes(3, "little") for value in values)
    return dict(enumerate(data))


# ----------------------------------------------------------------------------------- step rates


@pytest.mark.parametrize(
    ("profile", "axis", "rate", "divisor", "control"),
    [
        ("document", 1, 25_000, (0x13, "8f 01 00"), 0b1100),  # 399 + 1 = 400 ticks
        ("document", 0, 1_000, (0x10, "0f 27 00"), 0b11),  # vector 6: 9999
        ("linuxcnc", 0, 1_000, (0x10, "0c 27 00"), 0b11),  # vector 7: 9996
        ("linuxcnc", 1, -25_000, (0x13, "8c 01 00"), 0b1000),  # 396, dir 0
        ("linuxcnc", 2, 100_000, (0x16, "60 00 00"), 0b110000),  # 96
        ("linuxcnc", 3, 3, (0x19, "d1 dc 32"), 0b11000000),  # 3333329
        ("document", 3, 5_000_000, (0x19, "01 00 00"), 0b11000000),  # "1 will cause 5 MHz"
    ],
)
def test_set_step_rate_writes_divisor_and_then_run_and_direction(
    bus, profile, axis, rate, divisor, control
):
    driver = UscDriver(bus, profile=profile)
    assert driver.set_step_rate(axis, rate) == pytest.approx(rate, rel=2e-7)
    address, data = divisor
    assert bus.writes == [(address, bytes.fromhex(data)), (0x1C, bytes([control]))]


def test_the_rate_returned_is_the_one_the_divisor_gives(bus):
    # 10 MHz / 30 kHz = 333.3 ticks
    assert UscDriver(bus).set_step_rate(0, 30_000) == 10_000_000 / 333
    assert UscDriver(bus).set_step_rate(0, -29_985) == -10_000_000 / 334


def test_control_byte_of_the_client_example(bus):
    """Vector 18: axes 0, 2, 3 forward and axis 1 reverse, all running: FB."""
    driver = UscDriver(bus)
    for axis, rate in enumerate([1000, -25_000, 100_000, 3]):
        driver.set_step_rate(axis, rate)
    assert bus.writes[-1] == (0x1C, b"\xfb")


def test_all_axes_go_out_in_one_burst(bus):
    driver = UscDriver(bus, profile="linuxcnc")
    rates = driver.set_step_rates([1000, -25_000, 100_000, 0])
    assert bus.writes == [(0x10, bytes.fromhex("0c2700 8c0100 600000 000000 7b"))]
    assert bus.arrays == 1
    assert rates == (1000.0, -25_000.0, 100_000.0, 0.0)


@pytest.mark.parametrize("rate", [5_000_001, -6e6, 0.59, -0.59, float("inf"), float("nan")])
def test_a_rate_out_of_range_is_refused_and_nothing_is_written(bus, rate):
    with pytest.raises(RegisterValueError, match=r"usc axis 2: .*0\.596\d*\.\.5e\+06"):
        UscDriver(bus).set_step_rate(2, rate)
    with pytest.raises(RegisterValueError, match="usc axis 2"):
        UscDriver(bus).set_step_rates([1, 1, rate, 1])
    assert bus.writes == []


def test_the_slowest_rate_has_the_largest_divisor(bus):
    rate = UscDriver(bus).set_step_rate(0, 10_000_000 / 2**24)
    assert bus.writes[0] == (0x10, b"\xff\xff\xff")
    assert rate == 10_000_000 / 2**24


@pytest.mark.parametrize("axis", [-1, 4])
def test_an_axis_that_is_not_there_is_named(bus, axis):
    with pytest.raises(UsageError, match=rf"usc has no axis {axis}; allowed are 0\.\.3"):
        UscDriver(bus).set_step_rate(axis, 100)


def test_stop_clears_run_and_keeps_direction(bus):
    driver = UscDriver(bus)
    driver.set_step_rates([100, -100, -100, 100])
    bus.clear()
    driver.stop(1)
    driver.stop()
    assert bus.writes == [(0x1C, b"\xe3"), (0x1C, b"\x41")]
    assert driver.step_rates() == (0, 0, 0, 0)


def test_rate_zero_halts_with_direction_positive(bus):
    driver = UscDriver(bus)
    driver.set_step_rate(0, -100)
    assert driver.set_step_rate(0, 0) == 0
    assert bus.writes[-1] == (0x1C, b"\x01")


# ----------------------------------------------------------------------------------- pulse shape


@pytest.mark.parametrize(
    ("profile", "width", "setup"), [("document", 0xD7, 0x9B), ("linuxcnc", 0xD8, 0x9C)]
)
def test_times_of_4_and_10_us(bus, profile, width, setup):
    """Vector 11."""
    driver = UscDriver(bus, profile=profile)
    assert driver.set_pulse_width(4e-6) == pytest.approx(4e-6)
    assert driver.set_setup_time(10e-6) == pytest.approx(10e-6)
    assert bus.writes == [(0x1E, bytes([width])), (0x1D, bytes([setup]))]


def test_times_are_rounded_up_to_whole_ticks(bus):
    driver = UscDriver(bus)
    assert driver.set_pulse_width(1.01e-6) == pytest.approx(1.1e-6)
    assert driver.set_setup_time(0.3e-6) == pytest.approx(0.3e-6)  # 0.3e-6 * 1e7 > 3 in binary
    assert bus.writes == [(0x1E, bytes([255 - 11])), (0x1D, bytes([255 - 3]))]


@pytest.mark.parametrize(
    ("profile", "seconds", "code"),
    [
        ("document", 0.1e-6, 0xFE),
        ("document", 25.4e-6, 0x01),
        ("document", 25.5e-6, 0x00),
        ("linuxcnc", 0.1e-6, 0xFE),  # the client never uses less than 200 ns
        ("linuxcnc", 0.2e-6, 0xFE),
        ("linuxcnc", 25.4e-6, 0x02),
    ],
)
def test_ends_of_the_range_of_times(bus, profile, seconds, code):
    UscDriver(bus, profile=profile).set_setup_time(seconds)
    assert bus.writes == [(0x1D, bytes([code]))]


@pytest.mark.parametrize(
    ("profile", "seconds"),
    [
        ("document", 25.51e-6),
        ("linuxcnc", 25.5e-6),
        ("document", 0),
        ("document", -1e-6),
        ("document", float("nan")),
        ("document", float("inf")),
    ],
)
def test_a_time_out_of_range_is_refused(bus, profile, seconds):
    driver = UscDriver(bus, profile=profile)
    with pytest.raises(RegisterValueError, match=r"pulse width .* us asked, allowed are 0\.[12]\."):
        driver.set_pulse_width(seconds)
    with pytest.raises(RegisterValueError, match=r"setup time .* us asked, allowed are 0\.[12]\."):
        driver.set_setup_time(seconds)
    assert bus.writes == []


@pytest.mark.parametrize(
    ("profile", "width", "rate"),
    [
        ("document", 0.1e-6, 5_000_000),  # 1 + 1 ticks
        ("document", 4e-6, 10_000_000 / 41),
        ("linuxcnc", 0.2e-6, 2_000_000),  # 2 + 3 ticks
        ("linuxcnc", 4e-6, 10_000_000 / 43),
    ],
)
def test_the_highest_rate_follows_the_pulse_width(bus, profile, width, rate):
    driver = UscDriver(bus, profile=profile)
    driver.set_pulse_width(width)
    assert driver.max_step_rate() == pytest.approx(rate)
    assert driver.set_step_rate(0, rate) == pytest.approx(rate)
    with pytest.raises(RegisterValueError, match="pulse width"):
        driver.set_step_rate(0, rate * 1.0001)


def test_the_smallest_divisor_is_1_whatever_the_pulse_width(bus):
    """Period = divisor + 4 ticks at least 5, although pulse and space would fit in 2."""
    driver = UscDriver(bus, profile="document", div_offset=4)
    driver.set_pulse_width(0.1e-6)
    assert driver.max_step_rate() == 2_000_000


def test_a_pulse_width_too_long_for_a_running_axis_is_refused(bus):
    driver = UscDriver(bus)
    driver.set_step_rate(2, 500_000)  # 20 ticks
    driver.set_pulse_width(1.9e-6)
    bus.clear()
    with pytest.raises(RegisterValueError, match=r"axis 2: runs at 500000 step/s"):
        driver.set_pulse_width(2.0e-6)
    driver.stop(2)
    driver.set_pulse_width(2.0e-6)
    assert bus.writes == [(0x1C, b"\x10"), (0x1E, bytes([255 - 20]))]


# ----------------------------------------------------------------------------------- identity


def test_scan_finds_a_usc_and_leaves_out_what_lingers_on_the_bus():
    assert find_boards(RecordingBus(base=1))[0].slot == 2
    (found,) = find_boards(RecordingBus(base=0))
    assert (found.base, found.name, found.version, found.index_reset) == (0, "USC", 1, False)


@pytest.mark.parametrize(("ident", "reset"), [(0x41, False), (0x42, True), (0x4E, True)])
def test_index_reset_comes_with_version_2(bus, ident, reset):
    bus.memory[0x0F] = ident
    assert find_boards(bus)[0].index_reset is reset


@pytest.mark.parametrize("byte", [0x00, 0xFF, 0x4F])
def test_scan_takes_these_for_an_empty_slot(bus, byte):
    bus.memory[0x0F] = byte
    assert find_boards(bus) == ()


def test_scan_names_siblings_and_skips_the_second_slot_of_a_usc(bus):
    bus.memory |= {0x0F: 0x12, 0x1F: 0x23}
    assert [(b.slot, b.name) for b in find_boards(bus)] == [
        (0, "PPMC encoder card"),
        (1, "PPMC DAC card"),
    ]
    bus.memory |= {0x0F: 0x41}
    assert [(b.slot, b.name) for b in find_boards(bus)] == [(0, "USC")]


def test_identify_refuses_another_board(bus):
    assert UscDriver(bus).identify().version == 1
    bus.memory[0x0F] = 0x52
    with pytest.raises(BusError, match="reads 52h"):
        UscDriver(bus).identify()


def test_no_board_at_the_base_is_a_timeout(bus):
    with pytest.raises(BusTimeoutError, match="after address write 4Fh"):
        UscDriver(bus, base=2).identify()


def test_every_address_carries_the_base():
    bus = RecordingBus(base=5)
    driver = UscDriver(bus, base=5)
    driver.initialise()
    driver.release_estop()
    driver.read_encoders()
    driver.stream(updates([30_000], [[100, 200, 300, 400]]))
    driver.set_dac(1)
    assert {address >> 5 for address, _ in bus.writes} == {5}


def test_unknown_profiles_and_switches_are_refused(bus):
    with pytest.raises(UsageError, match="no profile 'exact'; it has document, linuxcnc"):
        UscDriver(bus, profile="exact")
    with pytest.raises(UsageError, match="no profile switch 'speed'"):
        UscDriver(bus, speed=1)
    with pytest.raises(UsageError, match="base = 8"):
        UscDriver(bus, base=8)


def test_initialise_stops_first_and_sets_every_register(bus):
    driver = UscDriver(bus)
    driver.initialise()
    assert bus.writes[0] == (0x1F, b"\0")
    state = {}
    for address, data in bus.writes:
        state |= {address + i: byte for i, byte in enumerate(data)}
    expected = dict.fromkeys([0, 1, 2, 4, 6, 0x0C, 0x0D, 0x0F, *range(0x10, 0x1C), 0x1F], 0)
    assert state == expected | {0x1C: 0x55, 0x1D: 0x9B, 0x1E: 0xD7}
    assert (0x0C, b"\xf0") in bus.writes  # all counters loaded with the assembly register
    assert bus.log[-1][1:3] == (DATA_READ, 0x0D)  # reading 0C discarded stale sense bits


def test_the_linuxcnc_profile_writes_encoder_control_where_the_client_does(bus):
    UscDriver(bus, profile="linuxcnc").initialise()
    assert [w for w in bus.writes if w[0] in (0x03, 0x0C)] == [(0x03, b"\xf0"), (0x03, b"\0")]


def test_a_later_board_can_be_made_a_slave(bus):
    UscDriver(bus).initialise(slave=True)
    assert (0x06, b"\x01") in bus.writes


# ----------------------------------------------------------------------------------- encoders


def held(bus, register, value):
    """Return for how long [s] ``value`` stood in ``register``, the bus being one access a time."""
    times = [t for t, op, at, v in bus.log if op == DATA_WRITE and at == register + 1]
    values = [v for _, op, at, v in bus.log if op == DATA_WRITE and at == register + 1]
    first = values.index(value)
    return (times[first + 1] - times[first]) / bus.clock_hz


@pytest.mark.parametrize("access_cycles", [1, 12, 60, 400])
def test_encoders_are_latched_for_2_us_and_read_in_one_transaction(bus, access_cycles):
    bus.access_cycles = access_cycles
    bus.memory |= counts(1, -2, 5, 0x123456)
    assert UscDriver(bus).read_encoders().tolist() == [1, -2, 5, 0x123456]
    assert bus.writes == [(0x04, b"\x20"), (0x04, b"\x00")]
    assert bus.arrays == 1
    assert held(bus, 0x04, 0x20) >= 2e-6


def test_counts_wrap_both_ways_into_64_bits(bus):
    driver = UscDriver(bus)
    seen = []
    for raw in [0x7FFFFF, 0x800001, 0xFFFFFE, 0x000003, 0xFFFFFF, 0x900000]:
        bus.memory |= counts(raw, 0, 0, 0)
        seen.append(int(driver.read_encoders()[0]))
    assert seen == [8388607, 8388609, 16777214, 16777219, 16777215, 9437184]
    bus.memory |= counts(0x100000, 0, 0, 0)
    assert driver.read_encoders()[0] == 0x100000
    bus.memory |= counts(0xFFFFFF, 0, 0, 0)
    assert driver.read_encoders()[0] == -1


@given(
    st.lists(st.tuples(st.integers(-(2**60), 2**60), st.integers(-(2**23), 2**23 - 1)), min_size=1)
)
def test_extension_follows_every_move_that_24_bits_can_tell(moves):
    before, by = np.array(moves, np.int64).T
    assert extend_counts(before, (before + by) % 2**24).tolist() == (before + by).tolist()


def test_load_position_assembles_holds_and_clears(bus):
    driver = UscDriver(bus)
    driver.load_position(2, 0x123456)
    assert bus.writes == [(0x00, b"\x56\x34\x12"), (0x0C, b"\x40"), (0x0C, b"\x00")]
    assert held(bus, 0x0C, 0x40) >= 2e-6


@pytest.mark.parametrize("count", [0, -1, 2**24 + 7, -(2**40) + 12345, 10**15])
def test_a_loaded_position_keeps_all_its_64_bits(bus, count):
    driver = UscDriver(bus)
    driver.load_position(1, count)
    loaded = int.from_bytes(bus.writes[0][1], "little")
    bus.memory |= counts(0, loaded + 100, 0, 0)
    assert driver.read_encoders().tolist() == [0, count + 100, 0, 0]
    with pytest.raises(RegisterValueError, match="axis 1"):
        driver.load_position(1, 2**62)


def test_the_timer_keeps_running_while_counts_are_read_twice(bus):
    driver = UscDriver(bus)
    assert driver.set_master_timer(5_000) == 5_000  # 2 * 100 us
    assert bus.writes == [(0x04, b"\x12")]
    bus.memory |= counts(0, 0, 0, 0) | {0: [0xFF, 0x01, 0x01], 1: [0x01, 0x01, 0x01]}
    assert driver.read_encoders()[0] == 0x101  # not 0x1FF, torn between 0x0FF and 0x101
    assert bus.writes[1:] == [(0x04, b"\x32"), (0x04, b"\x12")]
    bus.memory |= {0: list(range(20)), 1: 0}  # never two equal reads
    with pytest.raises(BusError, match="latch timer"):
        driver.read_encoders()


@pytest.mark.parametrize(
    ("rate", "code", "real"),
    [
        (0, 0x00, 0),
        (10_000, 0x11, 10_000),
        (10_000 / 15, 0x1F, 10_000 / 15),
        (3_000, 0x13, 1e4 / 3),
        (3_700, 0x13, 1e4 / 3),
    ],
)
def test_timer_rates(bus, rate, code, real):
    assert UscDriver(bus).set_master_timer(rate) == pytest.approx(real)
    assert bus.writes == [(0x04, bytes([code]))]


@pytest.mark.parametrize("rate", [-1, 600, 10_001, float("nan")])
def test_timer_rates_out_of_range(bus, rate):
    with pytest.raises(RegisterValueError, match=r"666\.667\.\.10000 Hz"):
        UscDriver(bus).set_master_timer(rate)


# ----------------------------------------------------------------------------------- index


def test_a_stale_sense_bit_is_discarded(bus):
    driver = UscDriver(bus)
    bus.memory[0x0C] = [0x02, 0x00, 0x02]
    driver.arm_index(1)
    assert bus.writes == [(0x0C, b"\x02")]
    assert driver.index_seen() == (False, False, False, False)
    assert driver.index_seen() == (False, True, False, False)


def test_an_index_stays_seen_when_another_axis_is_asked_or_armed(bus):
    driver = UscDriver(bus)
    bus.memory[0x0C] = [0, 0x01, 0, 0]
    driver.arm_index(0)
    driver.arm_index(3)  # this read of 0C clears the sense bit of axis 0
    assert driver.index_seen() == (True, False, False, False)


def test_an_index_nobody_waits_for_is_not_reported(bus):
    bus.memory[0x0C] = 0x0F
    assert UscDriver(bus).index_seen() == (False,) * 4


def test_index_position_is_the_captured_count_and_disarms(bus):
    driver = UscDriver(bus)
    driver.load_position(1, 2**24 + 10)
    bus.memory[0x0C] = [0, 0x02]
    driver.arm_index(1)
    with pytest.raises(UsageError, match=r"no index captured; call arm_index\(1\)"):
        driver.index_position(1)
    assert driver.index_seen()[1]
    bus.memory |= counts(0, 7, 0, 0)
    bus.clear()
    assert driver.index_position(1) == 2**24 + 7
    assert bus.writes == [(0x0C, b"\0"), (0x0D, b"\0")]
    assert not any(op == DATA_WRITE and at == 5 for _, op, at, _ in bus.log)  # no soft latch
    with pytest.raises(UsageError, match="no index captured"):
        driver.index_position(1)


def test_loading_a_position_keeps_other_axes_armed(bus):
    driver = UscDriver(bus)
    driver.arm_index(3)
    bus.clear()
    driver.load_position(0, 0)
    assert bus.writes[1:] == [(0x0C, b"\x18"), (0x0C, b"\x08")]


def test_index_reset_needs_version_2(bus):
    with pytest.raises(UsageError, match="version 2 or later, this one is version 1"):
        UscDriver(bus).arm_index(0, reset=True)
    assert bus.writes == []


def test_after_an_index_reset_the_position_counts_from_the_index(bus):
    bus.memory |= {0x0F: 0x42, 0x0C: [0, 0, 0x04]} | counts(0, 0, 5000, 0)
    driver = UscDriver(bus)
    driver.load_position(2, 2**30 + 5000)
    bus.clear()
    driver.arm_index(2, reset=True)
    assert bus.writes == [(0x0D, b"\x04")]
    assert driver.index_seen() == (False,) * 4
    assert driver.index_seen() == (False, False, True, False)
    assert bus.writes == [(0x0D, b"\x04"), (0x0D, b"\x00")]
    bus.memory |= counts(0, 0, -3, 0)
    assert driver.read_encoders()[2] == -3


def test_disarm_clears_both_ways_of_waiting(bus):
    bus.memory[0x0F] = 0x42
    driver = UscDriver(bus)
    driver.arm_index(0)
    driver.arm_index(1)
    driver.arm_index(0, reset=True)
    bus.clear()
    driver.disarm_index(0)
    assert bus.writes == [(0x0C, b"\x02"), (0x0D, b"\0")]


def test_a_disarmed_index_is_no_longer_seen(bus):
    bus.memory[0x0C] = [0, 0x01, 0, 0]
    driver = UscDriver(bus)
    driver.arm_index(0)
    assert driver.index_seen()[0]
    driver.disarm_index(0)
    driver.arm_index(1)
    assert driver.index_seen() == (False,) * 4


# ----------------------------------------------------------------------------------- in and out


def test_inputs_by_word_and_by_bit(bus):
    bus.memory |= {0x0D: 0xA5, 0x0E: 0xC0}  # bit 7 of 0E is the estop status
    driver = UscDriver(bus)
    assert driver.read_inputs() == 0x40A5
    assert [driver.read_input(i) for i in (0, 1, 14, 13)] == [True, False, True, False]
    with pytest.raises(UsageError, match=r"no input 15; allowed are 0\.\.14"):
        driver.read_input(15)


def test_outputs_by_word_and_by_bit_keep_the_estop_release(bus):
    driver = UscDriver(bus)
    driver.write_outputs(0b1000001)
    driver.release_estop()
    bus.clear()
    driver.write_output(2, True)
    driver.write_output(0, False)
    assert bus.writes == [(0x1F, b"\xc5"), (0x1F, b"\xc4")]
    with pytest.raises(RegisterValueError, match=r"0\.\.0x7f"):
        driver.write_outputs(0x80)
    with pytest.raises(UsageError, match="no output 7"):
        driver.write_output(7, True)


@pytest.mark.parametrize(("volts", "code"), [(0, 0), (5, 127), (9.99, 254), (10, 255)])
def test_dac_rounds_down_as_the_client_does(bus, volts, code):
    driver = UscDriver(bus)
    real = driver.set_dac(volts)
    assert bus.writes == [(0x0F, bytes([code]))]
    assert real == pytest.approx(code * 10 / 255)


def test_every_voltage_that_the_dac_makes_can_be_asked_for_again(bus):
    driver = UscDriver(bus)
    for code in range(256):
        driver.set_dac(code * 10 / 255)
    assert [data[0] for _, data in bus.writes] == list(range(256))


@pytest.mark.parametrize("volts", [-0.1, 10.1, float("nan")])
def test_dac_out_of_range(bus, volts):
    with pytest.raises(RegisterValueError, match=r"allowed are 0\.\.10 V"):
        UscDriver(bus).set_dac(volts)


# ----------------------------------------------------------------------------------- estop


def test_release_halts_feeds_and_makes_an_edge(bus):
    driver = UscDriver(bus)
    driver.write_outputs(0x03)
    driver.set_step_rates([1000] * 4)
    bus.clear()
    driver.release_estop()
    assert bus.writes == [
        (0x10, bytes.fromhex("0f2700" * 4 + "55")),
        (0x1F, b"\x03"),
        (0x1F, b"\x83"),
    ]
    assert bus.arrays == 3
    assert driver.running
    driver.estop()
    assert bus.writes[-1] == (0x1F, b"\x03")


@pytest.mark.parametrize(
    ("switches", "slave", "cause"),
    [
        ({}, False, "chain is most likely open"),
        ({"watchdog_us": 20}, False, "watchdog time of 20 us"),  # 19 accesses of 1.5 us
        ({}, True, "watchdog is the likely one"),
    ],
)
def test_a_release_in_vain_says_why_and_takes_the_release_bit_back(bus, switches, slave, cause):
    driver = UscDriver(bus, **switches)
    driver.initialise(slave=slave)
    bus.memory[0x0E] = 0x7F
    with pytest.raises(EstopError, match=cause):
        driver.release_estop()
    assert bus.writes[-1] == (0x1F, b"\0")


def test_check_running_tells_a_stop_from_a_release_that_never_was(bus):
    driver = UscDriver(bus)
    driver.release_estop()
    driver.check_running()
    bus.memory[0x0E] = 0
    with pytest.raises(EstopError, match=r"chain opened, or .* 10000 us"):
        driver.check_running()
    with pytest.raises(EstopError, match=r"not released; call release_estop\(\)"):
        UscDriver(bus).check_running()


def test_feeding_the_watchdog_rewrites_two_adjacent_divisors(bus):
    driver = UscDriver(bus)
    driver.set_step_rates([1000, 25_000, 1, 1])
    bus.clear()
    driver.feed_watchdog()
    assert bus.writes == [(0x10, bytes.fromhex("0f2700 8f0100"))]


def test_leaving_the_context_stops_the_board_and_closes_the_bus(bus):
    def crash():
        with UscDriver(bus) as driver:
            driver.release_estop()
            raise KeyError

    with pytest.raises(KeyError):
        crash()
    assert bus.writes[-1] == (0x1F, b"\0")
    assert bus.closed == 1


# ----------------------------------------------------------------------------------- stream


def updates(cycle, divisor, control=None):
    control = [0xFF] * len(cycle) if control is None else control
    return SimpleNamespace(
        cycle=np.array(cycle, np.int64),
        divisor=np.array(divisor, np.uint32).reshape(-1, 4),
        control=np.array(control, np.uint8),
    )


def test_a_stream_is_one_array_of_bursts_at_their_cycles(bus):
    UscDriver(bus).stream(
        updates([1000, 5000], [[399, 9999, 0, 2**24 - 1], [1, 2, 3, 4]], [0xFB, 0x55])
    )
    assert bus.arrays == 1
    assert bus.writes == [
        (0x10, bytes.fromhex("8f0100 0f2700 000000 ffffff fb")),
        (0x10, bytes.fromhex("010000 020000 030000 040000 55")),
    ]
    times = [t for t, *_ in bus.log]
    assert times[:14] == list(range(1000, 1000 + 14 * 60, 60))
    assert times[14:] == list(range(5000, 5000 + 14 * 60, 60))


def test_the_committing_accesses_are_those_of_the_burst_facts(bus):
    """High bytes of the divisors are accesses 3, 6, 9, 12; control is 13 (address write is 0)."""
    from pulsewright.boards.usc.burst import BURST_ACCESSES, CONTROL_ACCESS, DIVISOR_ACCESS

    UscDriver(bus).stream(updates([0], [[1, 1, 1, 1]]))
    after = [at for _, _, at, _ in bus.log]  # register address after each access
    assert [after[k] - 1 for k in DIVISOR_ACCESS] == [0x12, 0x15, 0x18, 0x1B]
    assert (after[CONTROL_ACCESS] - 1, len(after)) == (0x1C, BURST_ACCESSES)
    assert (DIVISOR_ACCESS, CONTROL_ACCESS) == ((3, 6, 9, 12), 13)


def test_streams_of_any_length_reuse_the_buffer(bus, monkeypatch):
    monkeypatch.setattr("pulsewright.boards.usc.driver.STREAM_BURSTS", 4)
    driver = UscDriver(bus)
    cycle = 1000 * np.arange(1, 11)
    driver.stream(updates(cycle, np.arange(1, 41)))
    driver.stream(updates([12_000], [[50, 51, 52, 53]]))
    driver.stream(updates([], []))
    assert bus.arrays == 4  # 4 + 4 + 2 bursts, then 1, then none
    assert [data[0] for _, data in bus.writes] == [*range(1, 41, 4), 50]
    starts = [t for t, op, *_ in bus.log if op == ADDRESS_WRITE]
    assert starts == [*cycle, 12_000]


def test_after_a_stream_the_driver_knows_what_runs(bus):
    driver = UscDriver(bus)
    driver.stream(updates([0, 1000], [[9, 9, 9, 9], [399, 9999, 0, 9]], [0xFF, 0x3B]))
    assert driver.step_rates() == (25_000.0, -1000.0, 0.0, 0.0)


def test_a_burst_that_starts_late_is_an_error(bus):
    bus.time = 1030
    with pytest.raises(BusError, match=r"1 of 2 rate commands .* cycle 1000, by 30 cycles \(0\.75"):
        UscDriver(bus).stream(updates([1000, 9000], [[1, 1, 1, 1]] * 2))


def test_a_late_access_within_a_burst_is_an_error(bus):
    bus.delay = {27: 1}  # the control byte of the second burst
    with pytest.raises(BusError, match="for cycle 5000, by 1 cycles"):
        UscDriver(bus).stream(updates([1000, 5000], [[1, 1, 1, 1]] * 2))


def test_bursts_closer_than_the_bus_allows_are_an_error(bus):
    with pytest.raises(BusError, match="for cycle 1839, by 1 cycles"):
        UscDriver(bus).stream(updates([1000, 1000 + 14 * 60 - 1], [[1, 1, 1, 1]] * 2))


def test_a_stream_to_an_absent_board_times_out(bus):
    with pytest.raises(BusTimeoutError, match="after address write 30h"):
        UscDriver(bus, base=1).stream(updates([1000], [[1, 1, 1, 1]]))
    # a time-out is not remembered in the reused buffer
    driver = UscDriver(bus, base=1)
    with pytest.raises(BusTimeoutError):
        driver.stream(updates([10_000], [[1, 1, 1, 1]]))
    bus.base = 1
    driver.stream(updates([20_000], [[1, 1, 1, 1]]))


def test_divisors_that_the_board_cannot_run_are_refused(bus):
    driver = UscDriver(bus)
    with pytest.raises(RegisterValueError, match="axis 3: divisor 16777216 in update 1"):
        driver.stream(updates([0, 9000], [[1, 1, 1, 1], [1, 1, 1, 2**24]]))
    driver.set_pulse_width(4e-6)  # shortest period 41 ticks: divisor 40
    bus.clear()
    with pytest.raises(RegisterValueError, match=r"axis 1: divisor 39 in update 0, .*40\.\."):
        driver.stream(updates([0], [[0, 39, 40, 40]]))
    assert bus.writes == []
    driver.stream(updates([9000], [[0, 39, 40, 40]], [0xF7]))  # axis 1 does not run


def test_columns_of_unequal_length_are_refused(bus):
    with pytest.raises(UsageError, match=r"shape \(2, 4\)"):
        UscDriver(bus).stream(updates([0, 9000], [[1, 1, 1, 1]]))


# ----------------------------------------------------------------------------------- raw access


def test_raw_registers_by_name(bus):
    driver = UscDriver(bus)
    bus.memory |= counts(0, 0, -2, 0)
    assert driver.read_register("R_ENCODER_COUNT", 2) == {"value": -2}
    driver.write_register("W_TIMER", soft_latch=1, rate=3)
    driver.write_register("W_DIVISOR", 3, value=9999)
    assert bus.writes == [(0x04, b"\x23"), (0x19, b"\x0f\x27\x00")]


def test_raw_access_refuses_the_wrong_side_and_instance(bus):
    driver = UscDriver(bus)
    with pytest.raises(UsageError, match="is on the write side"):
        driver.read_register("W_DIVISOR")
    with pytest.raises(UsageError, match=r"no W_DIVISOR instance 4; allowed are 0\.\.3"):
        driver.write_register("W_DIVISOR", 4, value=1)
    with pytest.raises(UsageError, match="no register 'W_SPEED'"):
        driver.write_register("W_SPEED", value=1)
