"""The driver of pluto-step: words by hand from the specification, and behaviour on the twin."""

import warnings

import numpy as np
import pytest

from pulsewright.boards import open_board
from pulsewright.boards.pluto_step.commands import Updates
from pulsewright.boards.pluto_step.driver import Identity, PlutoStepDriver
from pulsewright.boards.pluto_step.twin import PlutoStepTwin
from pulsewright.errors import (
    BusError,
    BusTimeoutError,
    EstopError,
    RegisterValueError,
    UsageError,
)
from pulsewright.transport.bus import ADDRESS_WRITE, DATA_READ, DATA_WRITE
from pulsewright.transport.virtual import VirtualEppBus

MS = 40_000  # clock cycles


class Bus(VirtualEppBus):
    """A twin behind a bus that remembers runs of data writes: (address, bytes)."""

    def __init__(self, profile="exact", **switches):
        super().__init__(PlutoStepTwin(profile, **switches))
        self.writes = []
        self.delay = 0  # cycles by which accesses come late

    def transact(self, accesses):
        accesses["cycle"] += np.where(accesses["cycle"] >= 0, self.delay, 0)
        super().transact(accesses)
        address, data = 0, b""
        for op, value in zip(accesses["op"].tolist(), accesses["value"].tolist(), strict=True):
            if op == DATA_WRITE:
                data += bytes([value])
            elif data:
                self.writes.append((address, data))
                data = b""
            if op == ADDRESS_WRITE:
                address = value
            assert op in (ADDRESS_WRITE, DATA_WRITE, DATA_READ)
        if data:
            self.writes.append((address, data))

    def take(self):
        """Return the writes since the last call, as (address, hex)."""
        writes, self.writes = self.writes, []
        return [(address, data.hex(" ")) for address, data in writes]


def opened(profile="exact", **times):
    bus = Bus(profile)
    driver = PlutoStepDriver(bus, profile=profile)
    driver.initialise(**times)
    driver.release_estop()
    bus.take()
    return driver, bus


def wait(driver, cycles):
    driver.bus.twin.advance(driver.bus.now() + cycles)


# ------------------------------------------------------------------------------------------- words


def test_initialise_writes_zero_velocities_outputs_and_times():
    bus = Bus()
    driver = PlutoStepDriver(bus)
    assert bus.twin.now == 0
    driver.initialise(step_time=3.3e-6, step_space=1e-6, direction_time=20e-6)
    # 3.3 us = 2.06 ticks: 3, field 2; 20 us = 12.5 ticks: 13, field 12; tap 0, active high
    assert bus.take() == [
        (0x00, "00 00 00 00 00 00 00 00 00 00"),
        (0x0A, "02 0c"),
    ]
    assert (driver.step_ticks, driver.space_ticks, driver.direction_ticks) == (3, 1, 13)


def test_active_low_and_tap_are_bits_of_the_timing_word():
    bus = Bus()
    driver = PlutoStepDriver(bus)
    # 10 kHz: tap 3 reaches 39 kHz; tap in bits 7:6
    driver.initialise(step_time=0, step_space=0, direction_time=0, max_rate=1e4, active_low=True)
    assert bus.take()[1] == (0x0A, "c0 80")
    assert driver.tap == 3
    wait(driver, 100)
    assert bus.twin.drain().final()[0] == 1


def test_the_extended_board_gets_the_space_and_the_stop_by_the_watchdog():
    bus = Bus("extended")
    driver = PlutoStepDriver(bus, profile="extended")
    # 4 us = 3 ticks, field 2; 25.6 us = 16 ticks, the most that field and board can do
    for space, field in ((4e-6, "02"), (25.6e-6, "0f")):
        driver.initialise(step_time=0, step_space=space, direction_time=0)
        assert bus.take()[1:] == [(0x0A, "00 00"), (0x0C, f"{field} 00"), (0x0E, "02 00")]


@pytest.mark.parametrize(
    ("seconds", "field"),
    [(0, 0), (1e-9, 0), (1.6e-6, 0), (1.601e-6, 1), (3.2e-6, 1), (25.6e-6, 15)],
)
def test_times_round_up_to_ticks_and_exact_multiples_gain_none(seconds, field):
    driver, bus = opened(direction_time=0)
    real = driver.set_times(step_time=seconds, step_space=0, direction_time=seconds)
    assert bus.take() == [(0x0A, f"{field:02x} {field:02x}")]
    assert real == pytest.approx(((field + 1) * 1.6e-6, 1.6e-6, (field + 1) * 1.6e-6))


def test_a_time_beyond_the_field_is_clamped_and_reported_and_never_wraps():
    driver, bus = opened()
    # the client would make 27 us a pulse of 1.6 us
    with pytest.warns(UserWarning, match=r"step time 27 us asked, the most .* is 25.6 us"):
        real = driver.set_times(step_time=27e-6, step_space=0, direction_time=0)
    assert real[0] == pytest.approx(25.6e-6)
    assert bus.take() == [(0x0A, "0f 00")]
    assert driver.clamped == {"step time": (27e-6, pytest.approx(25.6e-6))}
    driver.set_times(step_time=5e-6, step_space=0, direction_time=0)
    assert driver.clamped == {}
    with pytest.raises(RegisterValueError, match=r"step time -1 us asked, allowed are 0..25.6 us"):
        driver.set_times(step_time=-1e-6, step_space=0, direction_time=0)


@pytest.mark.parametrize(
    ("tap_rate", "rate", "word", "real"),
    [
        (3e5, 1000.0, "03 00", 915.527),  # 3.28 units of 305.176 Hz
        (3e5, -1000.0, "fd ff", -915.527),  # sign-extended to 16 bits
        (3e5, 312_500.0, "00 04", 312_500.0),
        (3e4, 1000.0, "1a 00", 991.821),  # 26.2 units of 38.147 Hz
        (3e4, -39_024.0, "01 fc", -39_024.35),  # -1023
    ],
)
def test_a_rate_is_the_nearest_word(tap_rate, rate, word, real):
    driver, bus = opened(step_time=0, step_space=0, max_rate=tap_rate)
    assert driver.set_step_rate(2, rate) == pytest.approx(real, abs=1e-2)
    # all velocities, then the outputs word with its watchdog bit
    assert bus.take() == [(0x00, f"00 00 00 00 {word} 00 00 00 40")]


def test_four_rates_go_in_one_write_cycle():
    driver, bus = opened(step_time=0, step_space=0)
    driver.write_outputs(0x2345)
    assert bus.take() == [(0x08, "45 63")]
    rates = driver.set_step_rates([305.2, -305.2, 0.0, 610.0])
    assert rates == pytest.approx((305.176, -305.176, 0, 610.352), abs=1e-3)
    assert bus.take() == [(0x00, "01 00 ff ff 00 00 02 00 45 63")]
    driver.stop(3)
    assert bus.take() == [(0x00, "01 00 ff ff 00 00 00 00 45 63")]
    driver.stop()
    assert bus.take() == [(0x00, "00 00 00 00 00 00 00 00 45 63")]


def test_the_rate_limit_keeps_the_space_between_pulses():
    # 5 us = 4 ticks active, 4 us = 3 inactive: 2048 // 7 = 292 units of 305.176 Hz
    driver, bus = opened(step_time=5e-6, step_space=4e-6)
    assert driver.max_step_rate() == pytest.approx(292 * 625_000 / 2048)
    driver.set_step_rate(0, driver.max_step_rate())
    wait(driver, 5 * MS)
    trace = bus.twin.drain()
    rise, fall = trace.edges("step0", 1), trace.edges("step0", 0)
    assert (rise[1:] - fall[: len(rise) - 1]).min() == 3 * 64
    bus.take()
    with pytest.raises(RegisterValueError, match=r"axis 0: 89500 step/s asked, allowed are up to"):
        driver.set_step_rate(0, 89_500)
    for rate in (np.inf, np.nan):
        with pytest.raises(RegisterValueError, match="step/s asked"):
            driver.set_step_rate(0, rate)
    # 20 us = 13 ticks, and 1: 2048 // 14 = 146 units
    with pytest.raises(RegisterValueError, match=r"axis 0: runs at 89111.* allow 44555\.7"):
        driver.set_times(step_time=20e-6, step_space=0, direction_time=0)
    assert driver.step_ticks == 4
    assert bus.take() == []


def test_every_register_by_its_name():
    driver, bus = opened()
    driver.write_register("W_VELOCITY", 1, value=-100)
    assert bus.take() == [(0x02, "9c 0f")]
    wait(driver, 2 * MS)
    assert driver.read_register("R_POSITION", 1)["value"] < 0
    with pytest.raises(UsageError, match="R_STATUS needs switch status_reg"):
        driver.read_register("R_STATUS")
    with pytest.raises(UsageError, match="W_VELOCITY is on the write side"):
        driver.read_register("W_VELOCITY")
    with pytest.raises(UsageError, match=r"no W_VELOCITY instance 4; allowed are 0\.\.3"):
        driver.write_register("W_VELOCITY", 4, value=0)


# ----------------------------------------------------------------------------------- speed ranges


@pytest.mark.parametrize("profile", ["exact", "extended"])
def test_the_count_of_steps_survives_changes_of_the_speed_range(profile):
    """Each change may make a step on the exact board; the driver knows it."""
    driver, bus = opened(profile, step_time=0, step_space=0)
    generator = np.random.default_rng(5)
    for reach in (3e4, 7e4, 3e5, 1.5e5, 3e4, 3e5) * 3:
        driver.set_step_rates(generator.uniform(-20_000, 20_000, 4))
        wait(driver, 3 * MS)
        driver.feed_watchdog()
        driver.stop()
        assert driver.set_speed_range(reach) >= reach
        assert driver.read_steps().tolist() == bus.twin.state()["steps"]
        position = driver.read_positions()
        assert (np.floor(position) == driver.read_steps()).all()
    trace = bus.twin.drain()
    extra = [len(trace.edges(f"step{n}", 1)) for n in range(4)]
    assert min(extra) > 200


def test_the_speed_range_changes_at_rest_only():
    driver, bus = opened(step_time=0, step_space=0)
    driver.set_step_rate(1, 5000)
    bus.take()
    with pytest.raises(RegisterValueError, match=r"axis 1: runs at 4882\.81 step/s; .* stop\(\)"):
        driver.set_speed_range(1e4)
    driver.stop()
    with pytest.raises(RegisterValueError, match=r"400000 step/s asked, .* allow 312500"):
        driver.set_speed_range(4e5)
    assert driver.tap == 0


# -------------------------------------------------------------------------------------- positions


def test_positions_extend_beyond_21_bits():
    driver, _ = opened(step_time=0, step_space=0)
    driver.set_step_rates([300_000, -300_000, 0, 150_000])
    for _ in range(20):  # 20 x 1 ms x 300 steps, the register wraps every 1024
        wait(driver, MS)
        driver.feed_watchdog()
        driver.read_positions()
    driver.stop()
    wait(driver, 100)
    steps = driver.read_steps()
    assert steps.tolist() == driver.bus.twin.state()["steps"]
    assert 6000 < steps[0] < 6400
    assert -6400 < steps[1] < -6000


def test_positions_that_may_have_wrapped_are_an_error():
    driver, _ = opened(step_time=0, step_space=0)
    driver.set_step_rate(2, 312_500)
    for _ in range(2):  # 512 steps take 1.64 ms
        wait(driver, MS)
        driver.feed_watchdog()
    with pytest.raises(BusError, match=r"axis 2: position is ambiguous .* every 0.00164 s"):
        driver.read_positions()


# ------------------------------------------------------------------------------- watchdog and stop


def test_nothing_moves_before_the_release():
    bus = Bus()
    driver = PlutoStepDriver(bus)
    driver.initialise()
    bus.take()
    for attempt in (
        lambda: driver.set_step_rate(0, 1000),
        lambda: driver.set_step_rates([0] * 4),
        lambda: driver.stream(Updates(*(np.zeros((0, 4), np.int64),) * 3)),
    ):
        with pytest.raises(EstopError, match="release_estop"):
            attempt()
    with pytest.raises(EstopError, match="in emergency stop"):
        driver.check_running()
    driver.write_outputs(1)
    assert bus.take() == [(0x08, "01 00")]  # does not arm
    assert not bus.twin.state()["wd_enabled"]


@pytest.mark.parametrize("profile", ["exact", "extended"])
def test_a_watchdog_that_is_not_fed_is_noticed(profile):
    driver, bus = opened(profile)
    driver.set_step_rate(0, 1000)
    wait(driver, int(6.4 * MS))
    assert driver.running
    driver.feed_watchdog()
    wait(driver, int(6.6 * MS))
    assert bus.twin.state()["tristate"]
    assert not driver.running
    driver.feed_watchdog()  # pins are driven again, but steps are lost
    with pytest.raises(EstopError, match="watchdog expired, so steps are lost"):
        driver.check_running()
    driver.release_estop()
    driver.check_running()


def test_leaving_halts_the_axes_and_lets_the_watchdog_expire():
    with open_board("pluto_step") as driver:
        driver.initialise()
        driver.release_estop()
        driver.write_outputs(0x3FFF)
        driver.set_step_rate(0, 10_000)
        twin = driver.bus.twin
    assert twin.state()["vel"] == [0] * 4
    assert twin.state()["dout"] == 0
    twin.advance(twin.now + int(6.6 * MS))
    assert twin.state()["tristate"]


def test_the_extended_board_stops_its_axes_when_the_watchdog_expires():
    driver, bus = opened("extended")
    assert bus.twin.state()["control"] == 2
    driver.set_step_rate(0, 10_000)
    wait(driver, 7 * MS)
    before = bus.twin.state()["pos"]
    wait(driver, 7 * MS)
    assert bus.twin.state()["pos"] == before


def test_identity():
    assert opened("extended")[0].identify() == Identity(version=1, axes=4)
    assert opened()[0].identify() is None
    with pytest.raises(BusError, match="profile 'exact'"):
        PlutoStepDriver(Bus(), profile="extended").identify()
    bus = Bus()
    bus.twin.set_ninit(0)
    with pytest.raises(BusTimeoutError):
        PlutoStepDriver(bus).identify()


# ----------------------------------------------------------------------------------------- streams


def updates(bus, count, velocity=100, lead=1000, period=MS):
    cycle = bus.now() + lead + np.arange(count, dtype=np.int64) * period
    return Updates(cycle, np.full((count, 4), velocity, np.int16), np.zeros((count, 4), np.int64))


def test_a_stream_writes_every_burst_at_its_cycle():
    driver, bus = opened()
    driver.write_outputs(5)
    bus.take()
    send = updates(bus, 3)
    send.velocity[1] = [1, -1, 256, -256]
    driver.stream(send)
    assert bus.take() == [
        (0x00, "64 00 64 00 64 00 64 00 05 40"),
        (0x00, "01 00 ff ff 00 01 00 ff 05 40"),
        (0x00, "64 00 64 00 64 00 64 00 05 40"),
    ]
    driver.check_running()
    assert driver.step_rates() == pytest.approx([100 * 625_000 / 2048] * 4)
    driver.stream(updates(bus, 0))
    assert bus.take() == []


def test_a_late_burst_is_an_error():
    driver, bus = opened()
    bus.delay = 7
    with pytest.raises(BusError, match=r"3 of 3 rate commands came late.* by 7 cycles"):
        driver.stream(updates(bus, 3))


def test_a_gap_in_a_stream_longer_than_the_watchdog_is_noticed():
    driver, bus = opened()
    driver.stream(updates(bus, 3, period=6 * MS))
    driver.check_running()
    driver.stream(updates(bus, 3, period=7 * MS))
    with pytest.raises(EstopError, match="watchdog expired"):
        driver.check_running()


def test_a_velocity_beyond_the_limit_is_refused_before_anything_is_sent():
    driver, bus = opened(step_time=5e-6, step_space=4e-6)
    send = updates(bus, 5)
    send.velocity[3, 2] = -293
    with pytest.raises(RegisterValueError, match=r"axis 2: velocity -293 in update 3.* -292..292"):
        driver.stream(send)
    assert bus.take() == []
    with pytest.raises(UsageError, match=r"velocities of shape \(5, 4\), not \(4, 4\)"):
        driver.stream(Updates(send.cycle, send.velocity[:4], send.count))


# ---------------------------------------------------------------------------------- inputs, outputs


def test_inputs_and_outputs():
    driver, bus = opened()
    bus.twin.set_din(0x8005)
    assert driver.read_inputs() == 0x8005
    assert [driver.read_input(n) for n in (0, 1, 2, 15)] == [True, False, True, True]
    driver.write_output(13, True)
    driver.write_output(0, True)
    driver.write_output(13, False)
    assert bus.twin.state()["dout"] == 1
    for wrong in (lambda: driver.read_input(16), lambda: driver.write_output(14, True)):
        with pytest.raises(UsageError, match=r"has no (input 16|output 14); allowed are 0\.\."):
            wrong()
    with pytest.raises(RegisterValueError, match=r"output word 0x4000 asked, allowed are 0\.\."):
        driver.write_outputs(0x4000)


def test_ordinary_use_warns_of_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        opened()
