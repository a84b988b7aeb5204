"""The RAPcores driver with the whole board behind it; values by hand from the specification."""

import itertools

import numpy as np
import pytest

from pulsewright import open_board
from pulsewright.errors import BusError, EstopError, StarvedError, UsageError

U = 1 << 63


def running(profile="document", **options):
    board = open_board("rapcores", profile=profile, **options)
    board.initialise()
    board.release_estop()
    return board


def turn(board, encoder, counts, start, period=200):
    """Turn an encoder by counts from its reset state, A before B for positive ones."""
    levels = {"a": 0, "b": 0}
    for n, pin in zip(range(abs(counts)), itertools.cycle("ab" if counts > 0 else "ba")):
        levels[pin] ^= 1
        board.bus.twin.schedule(start + n * period, f"enc{encoder}_{pin}", levels[pin])


@pytest.mark.parametrize("build", [{}, {"motors": 2, "word_bits": 32}, {"motor_driver": 1}])
def test_accumulators_are_brought_to_whole_steps_wherever_they_are(build):
    """With no steps in the end; a reset could not tell it from one that was never moved."""
    board = running(**build)
    one = board.one_step
    parts = [one // 3, -one // 7, 0, 1][: board.motors]
    board.move(1, parts)
    board.wait_idle()
    with pytest.raises(UsageError, match="needs motors that are disabled"):
        board.level()
    before = board.read_steps().tolist()
    assert before == [0, -1, 0, 0][: board.motors]
    board.initialise()
    board.level()
    assert board.bus.twin.state()["fraction"] == [0] * board.motors
    assert board.read_steps().tolist() == before
    board.check_counters()


@pytest.mark.parametrize(
    "build",
    [
        {},
        {"motors": 1, "encoders": 1},
        {"motors": 2, "encoders": 2, "word_bits": 32},
        {"motors": 6, "encoders": 0, "depth": 8},
        {"motors": 24, "encoders": 64, "word_bits": 32, "depth": 64, "halt_pin": 0},
        {"motors": 32, "encoders": 64},
        {"cs_reset_message": 0},
        {"v020_info": 1},
        {"motor_driver": 1},
        {"profile": "upstream"},
        {"profile": "upstream", "fixed": 1},
        {"profile": "v020"},
        {"profile": "v020", "position_bits": 24},
    ],
    ids=str,
)
def test_every_build_is_identified_initialised_and_moved(build):
    board = running(**build)
    identity = board.identify()
    assert (identity.motors, identity.encoders) == (board.motors, board.encoders)
    assert identity.version == ("0.2.0-dev" if board.profile == "v020" else "0.3.0-dev")
    one = board.one_step
    told = board.move(100, [one // 4] * board.motors)
    assert told.positions == (0,) * min(board.motors, board.encoders)
    board.wait_idle()
    if board.profile == "document":
        assert board.read_steps().tolist() == [25] * board.motors
        board.check_counters()


def test_another_build_is_refused():
    board = open_board("rapcores", motors=6)
    with pytest.raises(BusError, match="motors = 6, the driver was opened for 4"):
        type(board)(board.bus).identify()
    board = open_board("rapcores", word_bits=32)
    with pytest.raises(BusError, match=r"build id 01000300, .* with word_bits=32"):
        type(board)(board.bus).identify()


def test_windings_get_current_when_they_are_enabled_and_told_how_much():
    """Legs of A in the middle of periods: 512 cycles from 255 on, 3 late; see the README."""
    board = open_board("rapcores", motor_driver="h_bridge", motors=2)
    with pytest.raises(UsageError, match="no motor_driver 'bridge'; there are step_dir and h_br"):
        open_board("rapcores", motor_driver="bridge")
    with pytest.raises(UsageError, match="no motors 'two'; it is a number"):
        open_board("rapcores", motors="two")
    twin = board.bus.twin

    def legs():
        """Return both legs of winding A of each motor around the middle of a period."""
        middle = 255 + 512 * ((twin.now - 255) // 512 + 3) + 3 + 256
        twin.advance(middle)
        pins = [f"phase{motor}_a{leg}" for motor in range(2) for leg in (1, 2)]
        return [twin.level(pin) for pin in pins]

    board.initialise()
    assert legs() == [0, 0, 0, 0]
    board.release_estop()
    assert legs() == [1, 1, 1, 1]  # no current: braked
    assert board.set_current([1, 0]).tolist() == [1, 0]
    one = board.one_step
    board.move(257, [one - 1, 0])  # ends at 256, the top of A
    board.wait_idle()
    assert board.read_register("R_PHASE_ANGLE") == {"angle": 256}
    assert legs() == [1, 0, 1, 1]
    board.move(512, [-one, 0])
    board.wait_idle()
    assert legs() == [0, 1, 1, 1]
    board.brake_on_disable(0b10)
    board.estop()
    assert legs() == [0, 0, 1, 1]
    board.release_estop()
    assert legs() == [0, 1, 1, 1]


def test_registers_are_what_was_written():
    board = running(profile="document")
    board.set_tick_rate(1e6)
    board.set_times(2e-6, 3e-6, 4e-6, 5e-6)
    assert board.read_register("W_DIVIDER") == {"divider": 15}
    names = ("W_STEP_WIDTH", "W_STEP_LOW", "W_DIR_SETUP", "W_DIR_HOLD")
    assert [board.read_register(name)["cycles"] for name in names] == [32, 48, 64, 80]
    assert board.read_register("W_ENABLE") == {"enable": 0xF}
    upstream = running(profile="upstream")
    assert upstream.read_register("W_DIVIDER") == {"divider": 40}
    assert upstream.read_register("W_ENABLE") == {"enable": 0xF}


def test_a_stream_leaves_no_tick_between_its_moves():
    board = running(depth=4)
    board.bus.twin.drain()
    durations = np.array([700, 650, 801, 900, 750, 999, 650, 700])
    shape = (len(durations), 4)
    board.stream(durations, np.full(shape, U // 4), np.zeros(shape, np.int64))
    board.wait_idle()
    done = np.concatenate([*(board.bus.twin.drain()["move_done"],)])
    assert np.diff(done).tolist() == (durations[1:] * 41).tolist()
    # floor of 6150 / 4
    assert board.read_steps().tolist() == [6150 // 4] * 4
    board.check_counters()


def test_a_stream_of_moves_that_are_too_short_is_noticed():
    board = running()
    shape = (5, 4)
    with pytest.raises(StarvedError) as caught:
        board.stream(np.full(5, 2), np.full(shape, U // 2), np.zeros(shape, np.int64))
    sent = round(caught.value.time * board.tick_rate) // 2
    assert caught.value.position == (float(sent),) * 4


def test_telemetry_is_of_the_start_of_the_executing_move():
    board = running()
    now = board.bus.now()
    turn(board, 0, 30, now + 100)
    turn(board, 1, -7, now + 100)
    board.bus.sleep(1e-3)
    first = board.move(20_000, [0] * 4)
    assert (first.positions, first.velocities) == ((30, -7, 0, 0), (199, -199, 0, 0))
    assert (first.completed, first.executing) == (0, False)
    assert board.read_encoders().tolist() == [30, -7, 0, 0]
    assert board.encoder_rates().tolist() == [80_000.0, -80_000.0, 0.0, 0.0]
    # 30 counts have left both signals of encoder 0 at 1, from where it goes on with A
    board.bus.twin.schedule(board.bus.now() + 50, "enc0_a", 0)
    second = board.move(20_000, [0] * 4)
    assert (second.positions[0], second.completed, second.executing) == (30, 0, True)
    board.wait_room()
    third = board.move(20_000, [0] * 4)
    assert (third.positions[0], third.completed, third.executing) == (31, 1, True)


def test_a_fault_of_an_encoder_is_told_and_cleared():
    board = running(encoders=64)
    for encoder in (1, 63):
        for pin in "ab":
            board.bus.twin.schedule(board.bus.now() + 100, f"enc{encoder}_{pin}", 1)
    board.bus.sleep(1e-4)
    assert board.encoder_faults() == 1 << 63 | 1 << 1
    board.clear()
    assert board.encoder_faults() == 0


def test_the_halt_input_stops_at_once_and_stays_noticed():
    board = running()
    board.move(1 << 20, [U // 8] * 4)
    board.bus.sleep(0.01)
    at = board.bus.now() + 10
    board.bus.twin.schedule(at, "halt", 0)
    board.bus.twin.schedule(at + 1, "halt", 1)
    board.bus.sleep(0.001)
    stopped = board.read_steps()
    trace = board.bus.twin.drain()
    # a pulse already high in the second cycle after the fall may end; none begins
    assert not [cycle for cycle in trace.edges("step0", 1) if cycle > at + 3]
    assert stopped.tolist() == [len(trace.edges("step0", 1))] * 4
    with pytest.raises(EstopError, match="was halted"):
        board.check_running()
    assert (board.room(), board.buffer().used) == (0, 0)
    board.release_estop()
    board.check_running()
    board.move(800, [-U // 8] * 4)
    board.wait_idle()
    assert board.read_steps().tolist() in ([n - 100] * 4 for n in (stopped[0], stopped[0] + 1))
    assert board.counters().moves_completed == 1


def test_leaving_the_context_stops_all_motion():
    with running() as board:
        board.move(1 << 20, [U // 8] * 4)
        board.bus.sleep(0.001)
    board.bus.twin.drain()
    board.bus.sleep(0.01)
    trace = board.bus.twin.drain()
    assert not any(len(trace[f"step{motor}"]) for motor in range(4))
    assert [trace.level_at_start(f"en{motor}") for motor in range(4)] == [0] * 4


def test_a_reset_sets_all_positions_to_0():
    board = running()
    board.move(800, [U // 2] * 4)
    board.wait_idle()
    assert board.read_steps().tolist() == [400] * 4
    board.initialise()
    assert board.read_steps().tolist() == [400] * 4
    board.initialise(reset=True)
    assert board.read_steps().tolist() == [0] * 4
    assert not board.running


def test_an_original_is_fed_by_its_pin():
    board = running(profile="upstream", fixed=1)
    durations = np.full(6, 1000)
    shape = (6, 4)
    board.stream(
        durations,
        np.full(shape, U // 4),
        np.zeros(shape, np.int64),
        np.array([0, 0, 0, 5, 5, 5]),
    )
    board.wait_idle()
    trace = board.bus.twin.drain()
    # the highest fraction bit rises once a step
    assert [len(trace.edges(f"step{motor}", 1)) for motor in range(4)] == [1500] * 4
    assert len(trace["move_done"]) == 6
    # DIR is the direction bit of the slot in turn
    assert len(trace["dir0"])
    assert trace["dir0"].tolist() == trace["dir2"].tolist()
    assert not len(trace["dir1"]) + len(trace["dir3"])
    assert board.read_encoders().tolist() == [0] * 4
    with pytest.raises(UsageError, match="has no read_steps"):
        board.read_steps()
