"""The USC driver and the twin together. They share nothing but the register map."""

from types import SimpleNamespace

import numpy as np
import pytest

from pulsewright import open_board
from pulsewright.boards.usc.driver import UscDriver, find_boards
from pulsewright.boards.usc.twin import UscTwin
from pulsewright.errors import BusError, BusTimeoutError, EstopError
from pulsewright.transport.virtual import VirtualEppBus

MS = 40_000  # [cycle]


@pytest.fixture
def board():
    """A board of the default profile, running, pulses of 4 us, setup 10 us, no watchdog."""
    driver = open_board("usc", watchdog_us=0, loopback=1)
    driver.initialise()
    driver.release_estop()
    driver.bus.twin.drain()
    return driver


def run(driver, cycles):
    """Let time pass; return the trace of it."""
    twin = driver.bus.twin
    twin.drain()
    twin.advance(twin.now + cycles)
    return twin.drain()


@pytest.mark.parametrize("profile", ["document", "linuxcnc"])
@pytest.mark.parametrize(("rate", "period"), [(25_000, 1600), (-100_000, 400), (200_000, 200)])
def test_the_rate_set_is_the_rate_on_the_pins(profile, rate, period):
    driver = open_board("usc", profile=profile, watchdog_us=0)
    driver.initialise()
    driver.release_estop()
    assert driver.set_step_rate(2, rate) == rate
    trace = run(driver, MS)
    steps = trace.edges("step2", 1)
    assert np.diff(steps).tolist() == [period] * (len(steps) - 1)
    assert len(steps) in (MS // period - 1, MS // period)
    assert trace.final()[trace.pins.index("dir2")] == (rate > 0)
    assert len(trace["step0"]) == 0


def test_rates_in_reverse_keep_setup_and_width_on_the_pins(board):
    assert board.set_pulse_width(2.5e-6) == pytest.approx(2.5e-6)
    assert board.set_setup_time(7.7e-6) == pytest.approx(7.7e-6)
    board.set_step_rate(0, 20_000)
    board.bus.twin.advance(board.bus.now() + MS)
    board.bus.twin.drain()
    board.set_step_rate(0, -20_000)
    board.bus.twin.advance(board.bus.now() + MS)
    trace = board.bus.twin.drain()
    rise, fall = trace.edges("step0", 1), trace.edges("step0", 0)
    fall = fall[fall > rise[0]]
    assert set(fall[: len(rise)] - rise[: len(fall)]) == {100}  # 2.5 us
    (change,) = trace.edges("dir0", 0)
    after = rise[rise > change][0] - change
    assert after >= 308  # 7.7 us


def test_a_stream_steps_at_the_tick_that_hand_arithmetic_gives(board):
    """Control acts 13 accesses after the burst; the first pulse comes 9999 ticks after that."""
    start = -(-board.bus.now() // 4) * 4 + 4000
    board.stream(
        SimpleNamespace(
            cycle=np.array([start, start + 100 * MS]),
            divisor=np.array([[9999, 0, 0, 0]] * 2, np.uint32),
            control=np.array([0x57, 0x55], np.uint8),
        )
    )
    board.check_running()
    steps = board.bus.twin.drain().edges("step0", 1)
    first = start + 13 * 60 + 4  # the write acts after the tick at its time
    assert steps.tolist() == [first + 4 * (9999 + 10_000 * k) for k in range(len(steps))]
    assert len(steps) == 100  # the 100th is due in the tick after which run is cleared


def test_a_stream_may_begin_as_soon_as_the_bus_is_free(board):
    def burst(cycle):
        return SimpleNamespace(
            cycle=np.array([cycle]),
            divisor=np.full((1, 4), 9999, np.uint32),
            control=np.array([0xFF], np.uint8),
        )

    board.stream(burst(board.bus.now()))
    with pytest.raises(BusError, match="by 1 cycles"):
        board.stream(burst(board.bus.now() - 1))


def test_every_command_of_a_long_stream_reaches_the_pins(board):
    """1000 bursts, alternating 50 and 100 kHz on axis 3: 50 and 100 steps per ms.

    The divisor commits 15 ticks before run does; the first pulse comes 200 ticks after that, which
    leaves room for 49 pulses in the first ms.
    """
    n = 1000
    start = board.bus.now() + MS
    board.stream(
        SimpleNamespace(
            cycle=start + MS * np.arange(n),
            divisor=np.tile(np.array([[0, 0, 0, 199], [0, 0, 0, 99]], np.uint32), (n // 2, 1)),
            control=np.full(n, 0xD5, np.uint8),
        )
    )
    board.bus.twin.advance(start + n * MS)
    trace = board.bus.twin.drain()
    bounds = start + 12 * 60 + 4 + MS * np.arange(n)  # first ticks under each divisor
    per_ms = np.histogram(trace.edges("step3", 1), bounds)[0]
    assert per_ms[:-1].tolist() == [49] + [100, 50] * (n // 2 - 2) + [100]
    assert board.step_rates() == (0, 0, 0, 100_000)


def test_encoders_follow_the_loopback(board):
    board.load_position(1, -500)
    board.set_step_rates([10_000, -20_000, 0, 0])
    run(board, 10 * MS)
    board.stop()
    counts = board.read_encoders()
    steps = board.bus.twin.state()["steps"]
    assert counts.tolist() == [steps[0], steps[1] - 500, 0, 0]
    assert counts[0] in (100, 101)
    assert counts[1] in (-700, -701)


def test_positions_go_on_beyond_24_bits(board):
    twin = board.bus.twin
    board.load_position(0, 2**40 + 2**23 - 5)
    for step in (3, 4, 2**22, -7, -(2**22), 2**23 - 1):
        before = int(board.read_encoders()[0])
        twin.set_encoder(0, before + step)
        assert board.read_encoders()[0] == before + step
    assert twin.state()["enc"][1:] == [0, 0, 0]


def test_initialise_clears_counts_left_over(board):
    board.bus.twin.set_encoder(3, 77)
    board.initialise()
    assert board.read_encoders().tolist() == [0] * 4
    state = board.bus.twin.state()
    assert (state["width"], state["setup"], state["rate_ctrl"]) == (0xD7, 0x9B, 0x55)
    assert state["estop"]


@pytest.mark.parametrize("sense_gate", [0, 1])
def test_index_capture(sense_gate):
    driver = open_board("usc", sense_gate=sense_gate)
    twin = driver.bus.twin
    driver.initialise()
    twin.set_encoder(2, 1000)
    twin.index_edge(2)  # stale
    driver.arm_index(2)
    assert driver.index_seen() == (False,) * 4
    twin.set_encoder(2, 1234)
    twin.index_edge(2)
    twin.set_encoder(2, 1300)
    assert driver.index_seen() == (False, False, True, False)
    assert driver.index_position(2) == 1234
    assert driver.read_encoders()[2] == 1300


def test_index_reset():
    driver = open_board("usc", ident=0x42)
    twin = driver.bus.twin
    driver.initialise()
    twin.set_encoder(0, 5000)
    assert driver.read_encoders()[0] == 5000
    driver.arm_index(0, reset=True)
    twin.index_edge(0)
    twin.set_encoder(0, (twin.state()["enc"][0] - 20) % 2**24)
    assert driver.index_seen()[0]
    assert driver.read_encoders()[0] == -20
    twin.index_edge(0)  # no longer armed
    assert driver.read_encoders()[0] == -20


def test_the_master_timer_latches_by_itself(board):
    twin = board.bus.twin
    board.set_master_timer(1000)
    twin.set_encoder(0, 42)
    twin.advance(twin.now + MS + 4)
    assert twin.state()["latch"][0] == 42
    twin.set_encoder(0, 43)
    assert board.read_encoders()[0] == 43


def test_estop_chain(board):
    twin = board.bus.twin
    assert board.running
    twin.set_estop_chain(False)
    twin.set_estop_chain(True)
    assert not board.running
    with pytest.raises(EstopError, match="chain opened"):
        board.check_running()
    board.release_estop()
    assert board.running
    board.estop()
    assert not board.running
    twin.set_estop_chain(False)
    with pytest.raises(EstopError, match="chain is most likely open"):
        board.release_estop()
    board.initialise(slave=True)
    board.release_estop()
    assert board.running


def test_release_starts_no_axis_by_itself(board):
    board.set_step_rate(0, 50_000)
    board.estop()
    board.release_estop()
    assert len(run(board, 5 * MS)["step0"]) == 0


def test_the_watchdog_stops_a_board_that_is_not_fed():
    driver = open_board("usc")  # watchdog 10 ms
    driver.initialise()
    driver.release_estop()
    for _ in range(5):
        run(driver, 9 * MS)
        driver.feed_watchdog()
    driver.check_running()
    run(driver, 11 * MS)
    with pytest.raises(EstopError, match="10000 us"):
        driver.check_running()


def test_a_watchdog_shorter_than_the_release_is_named():
    driver = open_board("usc", watchdog_us=5)
    driver.initialise()
    with pytest.raises(EstopError, match="watchdog time of 5 us"):
        driver.release_estop()


def test_inputs_outputs_and_dac(board):
    twin = board.bus.twin
    twin.set_din(0x5A3C)
    assert board.read_inputs() == 0x5A3C
    assert (board.read_input(14), board.read_input(13)) == (True, False)
    board.write_outputs(0x25)
    board.write_output(6, True)
    board.set_dac(5)
    trace = run(board, 10)
    levels = dict(zip(trace.pins, trace.final().tolist(), strict=True))
    assert sum(levels[f"out{n}"] << n for n in range(7)) == 0x65
    assert sum(levels[f"dac{n}"] << n for n in range(8)) == 127
    assert board.running
    board.estop()
    trace = run(board, 10)
    levels = dict(zip(trace.pins, trace.final().tolist(), strict=True))
    assert not any(levels[pin] for pin in levels if pin.startswith(("out", "dac")))


def test_two_boards_on_one_bus():
    bus = VirtualEppBus(UscTwin(boards=2, ident=0x42, watchdog_us=0))
    assert [(b.slot, b.base, b.ident) for b in find_boards(bus)] == [(0, 0, 0x42), (2, 1, 0x42)]
    first, second = UscDriver(bus, watchdog_us=0), UscDriver(bus, base=1, watchdog_us=0)
    for driver in (first, second):
        driver.initialise(slave=driver is second)
        driver.release_estop()
    second.set_step_rate(0, 10_000)
    trace = run(second, 10 * MS)
    assert len(trace.edges("b1.step0", 1)) == pytest.approx(100, abs=1)
    assert len(trace["step0"]) == 0
    with pytest.raises(BusTimeoutError, match="4Fh"):
        UscDriver(bus, base=2).initialise()


def test_leaving_the_context_stops_the_steps():
    with open_board("usc", watchdog_us=0) as driver:
        driver.initialise()
        driver.release_estop()
        driver.set_step_rate(0, 100_000)
        assert len(run(driver, MS)["step0"]) > 190
    run(driver, MS)
    assert len(run(driver, MS)["step0"]) == 0


def test_bus_reset_brings_the_reset_state(board):
    board.set_step_rate(0, 1000)
    board.bus.reset()
    state = board.bus.twin.state()
    assert (state["rate"], state["width"], state["estop"]) == ([0] * 4, 0xFE, True)
