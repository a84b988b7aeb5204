"""The RAPcores driver against a small board made from sections 2 to 4 of the specification.

The board works on whole words: messages act when their frame ends, moves are integrated when time
passes. Its clock is 1 MHz and a frame takes 100 cycles, so that times are easy to follow.
"""

import numpy as np
import pytest

from pulsewright.boards.rapcores.driver import BufferState, RapcoresDriver, StepTiming
from pulsewright.errors import (
    BusError,
    BusTimeoutError,
    EstopError,
    MotionLimitError,
    RegisterValueError,
    StarvedError,
    UsageError,
)
from pulsewright.transport.bus import ASAP
from pulsewright.transport.spi_bus import SpiBus

U = 1 << 63
FRAME = 100  # [cycle]
ONE_WORD = {0x0A: 1, 0x20: 1, 0xFD: 1}


class Board(SpiBus):
    """A board of four motors and encoders with words of 64 bits."""

    clock_hz = 1_000_000

    def __init__(self, profile="document", depth=2):
        self.profile, self.depth = profile, depth
        self.cycle, self.closed = 0, False
        self.frames = []  # [cycle, words]
        self.status = {0x00: 0x01000300, 0x01: 0x20200404, 0xFE: 0x2040, 0xFF: 0x52430001}
        if profile == "v020":
            self.status[0x00] = 0x01000200
        self.config = {0x02: 40, **dict.fromkeys(range(0xC0, 0xC4), 20)}
        self.halt_pin = self.halt_seen = False
        self.moves, self.acc, self.left = [], [0] * 4, None
        self.encoders = [(0, 0)] * 4
        self.snapshot = self.encoders
        self.frozen = False
        self.pins = {}
        self.open_words = 0

    # -- the link

    def transfer(self, data, cycle=ASAP):
        self.sleep_cycles(max(cycle - self.cycle, 0) + FRAME)
        words = np.frombuffer(data, "<u8").tolist() if len(data) % 8 == 0 else []
        self.frames.append((self.cycle, words))
        self.open_words = max(self.open_words - len(words), 0)
        if not words or self.open_words:
            return bytes(len(data))
        return np.array(self.answers(words), np.uint64).tobytes()

    def level(self, pin):
        return self.pins.get(pin)

    def now(self):
        return self.cycle

    def sleep(self, seconds):
        self.sleep_cycles(round(seconds * self.clock_hz))

    def reset(self):
        raise UsageError("no reset pin")

    def close(self):
        self.closed = True

    # -- the board

    @property
    def halted(self):
        return self.halt_pin or bool(self.config.get(0xC4, 0))

    def sleep_cycles(self, cycles):
        for _ in range(cycles):
            self.cycle += 1
            if self.halted:
                self.halt_seen, self.moves, self.left = True, [], None
            if not self.moves or self.frozen or self.cycle % (self.config[0x02] + 1):
                if not self.moves:
                    self.snapshot = self.encoders
                continue
            move = self.moves[0]
            for motor in range(4):
                self.acc[motor] += move[1][motor]
                move[1][motor] += move[2][motor]
            move[0] -= 1
            if move[0] <= 0:
                self.moves.pop(0)
                self.status[0xE2] = self.status.get(0xE2, 0) + 1
                self.snapshot = self.encoders

    def read(self, address):
        halted = self.halted | self.halt_seen << 1
        state = len(self.moves) | self.depth << 8 | bool(self.moves) << 16 | halted << 17
        live = {0xE0: state, 0xE1: self.moves[0][0] if self.moves else 0}
        for motor, acc in enumerate(self.acc):
            live[0xC0 + motor] = acc // U
        for encoder, (position, velocity) in enumerate(self.encoders):
            live |= {0x04 + encoder: position, 0x44 + encoder: velocity}
        return live.get(address, self.status.get(address, 0)) % 2**64

    def answers(self, words):
        replies, queue = [0] * len(words), list(enumerate(words))
        while queue:
            at, word = queue.pop(0)
            header, low = word >> 56, word & 0xFF
            length = {0x00: 1, 0x01: 10} | (ONE_WORD if self.profile == "v020" else {})
            rest = [queue.pop(0)[1] for _ in range(length.get(header, 2) - 1)]
            if self.profile == "v020" and header in (0xFE, 0xFD, 0x51, 0x03):
                channel = word >> 48 & 0xFF
                position, velocity = self.encoders[channel]
                replies[at + 1] = {
                    0xFE: self.status[0x00],
                    0xFD: 0x20200404,
                    0x51: 5,
                    0x03: velocity % 2**32 << 32 | position % 2**32,
                }[header]
            elif self.profile == "v020" and header in (0x0A, 0x20):
                self.config[{0x0A: 0x00, 0x20: 0x02}[header]] = low
            elif header == 0xF1:
                replies[at + 1] = self.read(low)
            elif header in (0xF2, 0xF3):
                replies[at + 1] = self.config.get(low, 0)
                if header == 0xF2:
                    self.config[low] = rest[0]
                if header == 0xF2 and low == 0xC5:
                    self.clear(rest[0])
                assert header == 0xF2 or self.profile == "document"
            elif header == 0x01:
                for encoder, (position, velocity) in enumerate(self.snapshot):
                    replies[at + 2 + 2 * encoder] = position % 2**64
                    replies[at + 3 + 2 * encoder] = velocity % 2**64
                self.take(rest)
        return replies

    def take(self, rest):
        signed = [word - (word >> 63 << 64) for word in rest]
        if len(self.moves) < self.depth and not self.halted and not self.halt_seen:
            self.moves.append([rest[0], signed[1::2], signed[2::2]])
        else:
            self.status[0xE3] = self.status.get(0xE3, 0) + 1

    def clear(self, bits):
        self.config[0xC5] = 0
        if bits & 1:
            self.status |= dict.fromkeys(range(0xE2, 0xE7), 0)
        if bits & 2:
            self.status |= {0x02: 0}
        if bits & 4:
            self.status |= {0xE7: 0}
        if bits & 8 and not self.halted:
            self.halt_seen = False


def opened(**changes):
    board = Board(**changes)
    return board, RapcoresDriver(board, **changes)


def ready(**changes):
    board, driver = opened(**changes)
    driver.initialise()
    if driver.profile == "document":
        driver.set_times(20e-6, 20e-6, 20e-6, 20e-6)
    driver.release_estop()
    board.frames.clear()
    return board, driver


def moves(count, duration=100, increment=0):
    shape = (count, 4)
    return np.full(count, duration), np.full(shape, increment), np.zeros(shape, np.int64)


# ----------------------------------------------------------------------------------- identity


def test_the_board_is_named():
    _, driver = opened()
    identity = driver.identify()
    assert (identity.version, identity.motors, identity.encoders) == ("0.3.0-dev", 4, 4)
    assert (identity.position_bits, identity.velocity_bits) == (32, 32)
    assert identity.build_id == 0x52430001


@pytest.mark.parametrize(
    ("register", "value", "message"),
    [
        (0x00, 0, "tells version 00000000, expected 01000300"),
        (0x00, 0x01000200, "tells version 01000200"),
        (0x01, 0x20200408, r"motors = 8, the driver was opened for 4; open it with motors=8"),
        (0x01, 0x20200004, "encoders = 0"),
        (0xFE, 0x2020, "word_bits = 32"),
        (0xFF, 0, "tells build id 00000000, expected 52430001; .*'upstream'"),
    ],
)
def test_another_board_is_refused(register, value, message):
    board, driver = opened()
    board.status[register] = value
    with pytest.raises(BusError, match=message):
        driver.identify()


def test_another_depth_is_refused():
    driver = RapcoresDriver(Board(depth=8))
    with pytest.raises(BusError, match="depth = 8, the driver was opened for 2"):
        driver.identify()


def test_a_message_that_is_open_from_before_is_ended_where_cs_does_not():
    board, driver = opened(profile="upstream")
    board.open_words = 9  # of a move
    assert driver.identify().version == "0.3.0-dev"
    assert board.frames[0][1] == [0] * 10


def test_an_open_word_is_completed_byte_by_byte():
    class Shifted(Board):
        """Has three bytes of a word from before; then all is late by them."""

        stray = 3

        def transfer(self, data, cycle=ASAP):
            self.stray = (self.stray + len(data)) % 8
            return super().transfer(data, cycle) if not self.stray else bytes(len(data))

    driver = RapcoresDriver(Shifted(profile="upstream"), profile="upstream")
    assert driver.identify().version == "0.3.0-dev"
    silent = Shifted(profile="upstream")
    silent.status[0] = 0
    with pytest.raises(BusError, match="check wiring"):
        RapcoresDriver(silent, profile="upstream").identify()


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"depth": 3}, "depth = 3; allowed are powers of two from 2 to 64"),
        ({"depth": 128}, "depth = 128"),
        ({"halt_pin": 2}, "halt_pin = 2"),
        ({"motors": 33}, "motors = 33"),
        ({"profile": "upstream", "word_bits": 32}, "word_bits = 32 and depth = 2 in profile 'up"),
        ({"profile": "v020", "depth": 4}, "depth = 4 in profile 'v020'"),
        ({"position_bits": 24}, "position_bits = 24 in profile 'document'; it has 32"),
        ({"motor_driver": 2}, r"motor_driver = 2; allowed are 0 \(step_dir\) and 1 \(h_bridge\)"),
        ({"profile": "v020", "motor_driver": 1}, "only 'document' has H-bridges"),
        ({"fixed": 2}, "profile switch fixed = 2"),
        ({"profile": "x"}, "no profile 'x'"),
    ],
)
def test_builds_that_cannot_be_are_refused(parameters, message):
    with pytest.raises(UsageError, match=message):
        RapcoresDriver(Board(), **parameters)


# ----------------------------------------------------------------------------------- initialise


def test_initialise_leaves_nothing_from_before():
    board, driver = opened()
    board.moves = [[1000, [U // 2] * 4, [0] * 4]]
    board.config |= {0x00: 0xF, 0x01: 0xF, 0x02: 7, 0xC0: 1, 0xC6: 3, 0xC7: 5}
    board.status |= {0x02: 1, 0xE3: 9, 0xE7: 2}
    driver.initialise(pulse_width=3e-6, pulse_space=4.5e-6, direction_setup=0, direction_hold=9e-6)
    assert not board.moves
    assert (board.halted, board.halt_seen) == (False, False)
    assert [board.config[at] for at in (0x00, 0x01, 0x02, 0xC6, 0xC7)] == [0, 0, 40, 0, 0]
    assert [board.config[0xC0 + i] for i in range(4)] == [3, 5, 1, 9]  # [cycle of 1 us]
    assert [board.status[at] for at in (0x02, 0xE3, 0xE7)] == [0, 0, 0]
    assert not driver.running
    assert driver.timing == StepTiming(3, 5, 1, 9)


def test_motors_that_moved_before_stop_at_once():
    board, driver = opened()
    board.moves = [[1 << 31, [U // 2] * 4, [0] * 4]]
    driver.initialise()
    at = [*board.acc]
    board.sleep_cycles(10_000)
    assert board.acc == at


def test_tick_rate_is_the_nearest_that_the_divider_has():
    board, driver = ready()
    assert driver.tick_rate == pytest.approx(1e6 / 41)
    assert driver.set_tick_rate(300_000) == pytest.approx(1e6 / 3)
    assert board.config[0x02] == driver.divider == 2
    assert driver.set_tick_rate(1e6) == 1e6
    assert board.config[0x02] == 0
    assert driver.set_tick_rate(1e6 / 256) == 1e6 / 256
    for rate in (0, -1, 3800, 3e6, float("nan")):
        with pytest.raises(RegisterValueError, match=r"allowed are 3906\.25 to 1e\+06"):
            driver.set_tick_rate(rate)
    with pytest.raises(RegisterValueError, match=r"to 500000"):  # divider 0 stops the original
        opened(profile="upstream")[1].set_tick_rate(1e6)


@pytest.mark.parametrize("time", [-1e-9, 65_536e-6, float("nan"), float("inf")])
def test_times_of_pulses_that_do_not_fit_are_refused(time):
    _, driver = ready()
    with pytest.raises(RegisterValueError, match=r"direction setup of .*allowed are 0 to 0.065535"):
        driver.set_times(direction_setup=time)
    assert driver.timing == StepTiming(20, 20, 20, 20)


# ----------------------------------------------------------------------------------- estop


def test_estop_halts_and_disables_and_release_undoes_both():
    board, driver = ready()
    assert driver.running
    assert board.config[0x00] == 0xF
    board.moves = [[1 << 31, [1] * 4, [0] * 4]]
    driver.estop()
    assert (board.halted, board.config[0x00], driver.running) == (True, 0, False)
    board.sleep_cycles(1)
    assert not board.moves
    driver.release_estop()
    assert (board.halted, board.halt_seen, board.config[0x00]) == (False, False, 0xF)
    driver.check_running()


def test_a_halt_leaves_motors_enabled_and_refuses_moves():
    board, driver = ready()
    driver.halt()
    assert (board.config[0x00], driver.running, driver.room()) == (0xF, False, 0)
    with pytest.raises(EstopError):
        driver.move(1, [0] * 4)
    driver.clear_halt()
    assert (driver.running, driver.room()) == (True, 2)


def test_the_halt_input_is_noticed_and_has_to_be_released():
    board, driver = ready()
    board.halt_pin = True
    with pytest.raises(EstopError, match="was halted"):
        driver.check_running()
    with pytest.raises(EstopError, match="HALT input is low"):
        driver.release_estop()
    board.halt_pin = False
    with pytest.raises(EstopError, match="was halted"):  # seen, though over
        driver.check_running()
    driver.release_estop()
    driver.check_running()


def test_motors_are_enabled_by_a_mask():
    board, driver = ready()
    driver.enable(0b0101)
    assert board.config[0x00] == 0b0101
    for mask in (-1, 16):
        with pytest.raises(RegisterValueError, match=r"allowed are 0\.\.0xf with 4 motors"):
            driver.enable(mask)


def with_bridges():
    """Return a board with H-bridges and its driver."""
    board = Board()
    board.status[0xFE] = 0x12040
    return board, RapcoresDriver(board, motor_driver=1)


def test_currents_are_parts_of_the_full_scale():
    board, driver = with_bridges()
    assert driver.set_current(1).tolist() == [1.0] * 4
    assert [board.config[0xD0 + motor] for motor in range(4)] == [255] * 4
    # 0.3 x 255 = 76.5, 0.7 x 255 = 178.5, to even; 0.001 x 255 = 0.26
    told = driver.set_current([0, 0.001, 0.3, 0.7])
    assert [board.config[0xD0 + motor] for motor in range(4)] == [0, 0, 76, 178]
    assert told.tolist() == driver.currents().tolist() == [0, 0, 76 / 255, 178 / 255]


@pytest.mark.parametrize("value", [-0.01, 1.01, float("nan"), float("inf")])
def test_a_current_out_of_range_sets_none(value):
    board, driver = with_bridges()
    driver.set_current(0.5)
    with pytest.raises(RegisterValueError, match=r"motor 2: current \S+; allowed are 0 to 1"):
        driver.set_current([0, 0, value, 0])
    assert [board.config[0xD0 + motor] for motor in range(4)] == [128] * 4
    with pytest.raises(UsageError, match="give one for all motors, or 4, one for each"):
        driver.set_current([0.5] * 3)


def test_motors_brake_or_coast_while_disabled():
    board, driver = with_bridges()
    driver.brake_on_disable(0b0101)
    assert board.config[0x01] == 0b0101
    with pytest.raises(RegisterValueError, match=r"motor mask 0x10; allowed are 0\.\.0xf"):
        driver.brake_on_disable(0x10)


def test_initialise_leaves_no_current_and_no_brake():
    board, driver = with_bridges()
    driver.set_current(1)
    driver.brake_on_disable(0xF)
    driver.initialise()
    assert [board.config[at] for at in (0x01, *range(0xD0, 0xD4))] == [0] * 5


def test_estop_and_halt_leave_currents():
    board, driver = with_bridges()
    driver.initialise()
    driver.set_current(0.4)
    driver.release_estop()
    driver.estop()
    assert board.config[0x00] == 0
    assert driver.currents().tolist() == [0.4] * 4  # 102 of 255


def test_only_builds_with_bridges_have_currents():
    board, driver = opened()
    for call in (
        lambda: driver.set_current(0),
        driver.currents,
        lambda: driver.brake_on_disable(0),
    ):
        with pytest.raises(UsageError, match='open the board with motor_driver="h_bridge"'):
            call()
    board.status[0xFE] = 0x12040
    with pytest.raises(BusError, match="motor_driver = 1, the driver was opened for 0"):
        driver.identify()
    _, driver = with_bridges()
    driver.bus.status[0xFE] = 0x2040
    with pytest.raises(BusError, match="motor_driver = 0, the driver was opened for 1"):
        driver.identify()


def test_leaving_the_context_stops_the_board_and_releases_the_link():
    board, driver = opened()
    with driver:
        driver.initialise()
        driver.release_estop()
    assert (board.halted, board.config[0x00], board.closed) == (True, 0, True)


# ----------------------------------------------------------------------------------- units


def test_increments_and_rates():
    _, driver = ready()
    driver.set_tick_rate(10_000)
    assert driver.increment(2_500) == U // 4
    assert driver.increment(-2_500) == -U // 4
    assert driver.increment(10_000) == U - 1
    assert driver.increment(-10_000) == -U
    assert driver.step_rate(U // 8) == 1_250
    assert driver.increment_increment(1e8 / 4) == U // 4
    assert driver.acceleration(-U // 2) == -1e8 / 2
    with pytest.raises(MotionLimitError, match=r"10001 step/s; allowed are up to 10000"):
        driver.increment(10_001)
    with pytest.raises(MotionLimitError, match=r"allowed are up to 1e\+08"):
        driver.increment_increment(1.1e8)


def test_the_pulse_former_limits_rates_too():
    _, driver = ready()
    driver.set_tick_rate(100_000)  # ten cycles, but pulses take 40
    assert driver.max_step_rate == 25_000
    with pytest.raises(MotionLimitError, match=r"up to 25000 .* pulses of 40 cycles"):
        driver.increment(25_001)
    driver.set_times(5e-6, 5e-6)
    assert driver.max_step_rate == 100_000


def test_half_a_step_per_tick_is_the_most_of_v020():
    _, driver = opened(profile="v020")
    assert driver.one_step == 1 << 64
    assert driver.max_step_rate == driver.tick_rate / 2
    assert driver.increment(driver.tick_rate / 2) == U - 1
    assert driver.increment(driver.tick_rate / 4) == U // 2


# ----------------------------------------------------------------------------------- moves


def test_a_move_is_one_frame_and_is_executed():
    board, driver = ready()
    driver.set_tick_rate(10_000)
    telemetry = driver.move(10, [U // 2, -U // 2, 0, U // 64], [0, 0, 0, U // 64])
    sent = [words for _, words in board.frames if 0x01 in [word >> 56 for word in words]]
    # room, moves completed; the move; moves completed again
    assert sent == [
        [
            *(0xF1000000000000E0, 0, 0xF1000000000000E2, 0),
            *(0x0100000000000000, 10),
            *(U // 2, 0, U + U // 2, 0, 0, 0, U // 64, U // 64),
            *(0xF1000000000000E2, 0),
        ]
    ]
    assert (telemetry.completed, telemetry.executing) == (0, False)
    driver.wait_idle()
    # 10/64 + 45/64 of a step
    assert driver.read_steps().tolist() == [5, -5, 0, 0]
    assert board.acc[3] == 55 * U // 64


def test_telemetry_tells_at_which_move_it_was_taken():
    board, driver = ready()
    board.encoders = [(7, -3), (-8, 2), (0, 0), (1, 1)]
    board.sleep_cycles(1)
    telemetry = driver.move(1000, [0] * 4)
    assert telemetry.positions == (7, -8, 0, 1)
    assert telemetry.velocities == (-3, 2, 0, 1)
    assert (telemetry.completed, telemetry.executing) == (0, False)
    board.encoders = [(9, 9)] * 4
    telemetry = driver.move(1000, [0] * 4)
    assert (telemetry.positions, telemetry.completed, telemetry.executing) == (
        (7, -8, 0, 1), 0, True
    )  # fmt: skip
    driver.wait_room()
    telemetry = driver.move(1000, [0] * 4)
    assert (telemetry.positions, telemetry.completed, telemetry.executing) == (
        (9,) * 4, 1, True
    )  # fmt: skip


def test_telemetry_of_which_the_move_is_not_sure_has_no_number():
    class Ending(Board):
        """Completes a move in every frame that has one."""

        def take(self, rest):
            super().take(rest)
            self.status[0xE2] = self.status.get(0xE2, 0) + 1

    driver = RapcoresDriver(Ending())
    driver.initialise()
    driver.release_estop()
    telemetry = driver.move(10, [0] * 4)
    assert (telemetry.completed, telemetry.executing) == (None, None)


def test_a_move_without_room_is_not_sent():
    board, driver = ready()
    driver.move(1000, [0] * 4)
    driver.move(1000, [0] * 4)
    assert driver.room() == 0
    with pytest.raises(BusError, match=r"no room for a move, all 2 are in use; call wait_room"):
        driver.move(1000, [0] * 4)
    assert len(board.moves) == 2
    assert board.status[0xE3] == 0
    assert driver.wait_room() == 1


def test_a_move_that_another_host_makes_the_board_refuse_is_reported():
    class Shared(Board):
        def take(self, rest):
            self.moves = [[1000, [0] * 4, [0] * 4] for _ in range(2)]
            super().take(rest)

    driver = RapcoresDriver(Shared())
    driver.initialise()
    driver.release_estop()
    with pytest.raises(BusError, match="refused a move; is another host using it"):
        driver.move(1000, [0] * 4)


def test_moves_need_enabled_motors():
    board, driver = opened()
    for send in (lambda: driver.move(1, [0] * 4), lambda: driver.stream(*moves(2))):
        with pytest.raises(EstopError, match="call release_estop"):
            send()
    assert not board.frames


def test_a_stream_keeps_the_buffer_full_and_leaves_no_pause():
    board, driver = ready(depth=4)
    start = board.cycle
    told = driver.stream(*moves(20, duration=50, increment=U // 8))
    assert len(told) == 20
    assert all(len(one.positions) == 4 for one in told)
    driver.wait_idle()
    assert driver.read_steps().tolist() == [125] * 4
    driver.check_counters()
    # without pauses: 1000 ticks of 41 cycles, the first frames and the last poll
    assert board.cycle - start < 1000 * 41 + 50 * 41 + 20 * FRAME
    assert driver.counters().moves_completed == 20


def test_a_stream_polls_only_when_the_buffer_is_full():
    board, driver = ready(depth=4)
    driver.stream(*moves(4, duration=1000))
    kinds = [[word >> 56 for word in words if word >> 56] for _, words in board.frames]
    assert kinds == [[0xF1, 0xF1], *([[0xF1, 0x01]] * 4)]


def test_a_stream_begins_at_its_cycle():
    board, driver = ready()
    begin = board.cycle + 12_345
    driver.stream(*moves(1), cycle=begin)
    assert board.frames[-1][0] == begin + FRAME


def test_a_stream_that_comes_too_late_is_reported_with_its_place():
    board, driver = ready()
    driver.set_tick_rate(10_000)
    with pytest.raises(StarvedError, match=r"2 moves of this stream, 0\.0002 s") as caught:
        # a move of one tick is over before the next frame is there
        driver.stream(*moves(5, duration=1, increment=U // 2))
    assert caught.value.time == pytest.approx(2e-4)
    assert caught.value.position == (1.0,) * 4
    assert not board.moves


def test_a_chained_stream_must_not_come_too_late_either():
    _, driver = ready()
    driver.stream(*moves(1))
    driver.wait_idle()
    driver.stream(*moves(1))
    driver.wait_idle()
    with pytest.raises(StarvedError):
        driver.stream(*moves(1), chained=True)


def test_a_halt_ends_a_stream():
    class Halting(Board):
        def take(self, rest):
            super().take(rest)
            self.halt_pin = len(self.frames) > 40

    board = Halting()
    driver = RapcoresDriver(board)
    driver.initialise()
    driver.release_estop()
    with pytest.raises(EstopError, match="dropped its moves"):
        driver.stream(*moves(100))
    assert board.halt_seen


def test_a_halt_just_before_a_move_is_noticed():
    class Halting(Board):
        def answers(self, words):
            self.halt_pin |= 0x01 in [word >> 56 for word in words]
            return super().answers(words)

    driver = RapcoresDriver(Halting())
    driver.initialise()
    driver.release_estop()
    with pytest.raises(EstopError, match="dropped its moves"):
        driver.stream(*moves(1))


def test_moves_that_are_too_fast_are_not_sent():
    board, driver = ready()
    driver.set_tick_rate(100_000)
    board.frames.clear()
    fast = driver.increment(25_000)
    durations, increments, changes = moves(3, duration=11, increment=fast - 1000)
    changes[1, 2] = 100  # reaches fast at the last of 11 ticks
    driver._check_rates(durations, increments, changes)
    changes[1, 2] = U // 10_000
    with pytest.raises(MotionLimitError, match="motor 2: move 1 reaches 25100 step/s"):
        driver.stream(durations, increments, changes)
    with pytest.raises(MotionLimitError, match="motor 0: move 0 reaches 50000 step/s"):
        driver.move(1, [-U // 2, 0, 0, 0])
    assert not board.frames


def test_a_move_that_makes_no_progress_is_not_waited_for():
    board, driver = ready()
    board.frozen = True
    driver.move(10, [0] * 4)
    with pytest.raises(BusTimeoutError, match="10 ticks left makes no progress"):
        driver.wait_idle()


def test_steps_that_stay_pending_are_not_waited_for():
    board, driver = ready()
    board.status[0xE9] = 4
    with pytest.raises(BusTimeoutError, match="steps stay pending"):
        driver.wait_idle()


# ----------------------------------------------------------------------------------- state


def test_buffer_state():
    board, driver = ready(depth=8)
    board.moves = [[33, [0] * 4, [0] * 4] for _ in range(3)]
    board.frozen = True
    assert driver.buffer() == BufferState(3, 8, True, False, False, 33)
    assert driver.buffer().room == 5


def test_counters_and_their_check():
    board, driver = ready()
    driver.check_counters()
    for address, name in (
        (0xE3, "1 moves refused"),
        (0xE4, "1 framing errors"),
        (0xE5, "1 aborted messages"),
        (0xE6, "1 unknown headers"),
    ):
        board.status[address] = 1
        with pytest.raises(BusError, match=name):
            driver.check_counters()
        driver.clear()
    board.status[0xE7] = 0b1010
    assert driver.steps_lost() == 0b1010
    with pytest.raises(BusError, match="steps lost by motors 1, 3"):
        driver.check_counters()
    driver.clear()
    driver.check_counters()


def test_positions_go_on_beyond_32_bits():
    board, driver = ready()
    for turn in range(-1, 7):
        board.acc = [turn * (1 << 30) * U, -turn * (1 << 30) * U, U - 1, -1]
        assert driver.read_steps().tolist() == [turn << 30, -turn << 30, 0, -1]
        wrapped = ((turn << 30) + 2**31) % 2**32 - 2**31
        board.encoders = [(wrapped, 1)] * 4
        assert driver.read_encoders().tolist() == [turn << 30] * 4
    board.sleep_cycles(1)
    assert driver.move(1, [0] * 4).positions == (6 << 30,) * 4


def test_encoder_rates():
    board, driver = ready()
    board.encoders = [(0, 999), (0, -1), (0, 0), (0, -(1 << 31))]
    assert driver.encoder_rates().tolist() == [1000.0, -500_000.0, 0.0, -1e6 / (2**31 + 1)]


def test_following_error():
    board, driver = ready()
    board.acc = [100 * U, -50 * U, 0, 0]
    board.encoders = [(390, 0), (-200, 0), (0, 0), (0, 0)]
    assert driver.following_error([0.25, 0.25]).tolist() == [2.5, 0.0]
    with pytest.raises(UsageError, match="5 ratios for 4 motors and 4 encoders"):
        driver.following_error([1] * 5)


def test_encoder_faults_are_1_in_every_profile():
    board, driver = ready()
    board.status[0x02] = 0b0110
    assert driver.encoder_faults() == 0b0110
    board, driver = opened(profile="upstream")
    board.status[0x02] = 0b1001  # 1 = healthy
    assert driver.encoder_faults() == 0b0110
    assert opened(profile="v020")[1].encoder_faults() == 0b0101
    # with 64 encoders, one register of a long word has them all
    board = Board()
    board.status[0x02] = 1 << 63 | 1
    assert RapcoresDriver(board, encoders=64).encoder_faults() == 1 << 63 | 1


def test_encoder_faults_of_short_words_are_in_two_registers():
    class Short(Board):
        def transfer(self, data, cycle=ASAP):
            address = data[0]
            return bytes(4) + {0x02: 0x80000001, 0xE8: 5}[address].to_bytes(4, "little")

    driver = RapcoresDriver(Short(), encoders=64, word_bits=32)
    assert driver.encoder_faults() == 0x5_8000_0001


# ----------------------------------------------------------------------------------- registers


def test_registers_by_name():
    board, driver = ready()
    board.config[0x02] = 0x123
    assert driver.read_register("W_DIVIDER") == {"divider": 0x23}
    assert driver.read_register("W_STEP_WIDTH") == {"cycles": 20}
    board.acc[2] = -5 * U
    assert driver.read_register("R_STEP_POSITION", 2) == {"position": -5}
    driver.write_register("W_STEP_POLARITY", invert=3)
    assert board.config[0xC6] == 3
    with pytest.raises(UsageError, match="is on the read side"):
        driver.write_register("R_VERSION")
    with pytest.raises(UsageError, match="no R_STEP_POSITION instance 32"):
        driver.read_register("R_STEP_POSITION", 32)


def test_upstream_is_read_by_swapping_the_old_value_back():
    board, driver = opened(profile="upstream")
    driver.initialise()
    driver.release_estop()
    board.frames.clear()
    assert driver.read_register("W_ENABLE") == {"enable": 0xF}
    # the value that goes there meanwhile is the one that should be there
    assert [words[1] for _, words in board.frames] == [0xF, 0xF]
    board.config[0x01] = 9
    assert driver.read_register("W_BRAKE") == {"brake": 9}
    assert board.config[0x01] == 9


# ----------------------------------------------------------------------------------- profiles


@pytest.mark.parametrize("profile", ["upstream", "v020"])
def test_originals_are_driven_by_the_pin_that_tells_of_room(profile):
    board, driver = opened(profile=profile)
    driver.initialise(tick_rate=1e5)
    assert board.config[0x02] == 9
    driver.release_estop()
    assert (board.config[0x00], driver.running) == (0xF, True)
    driver.check_running()
    with pytest.raises(UsageError, match="the link must have it"):
        driver.move(10, [0] * 4)
    board.pins["buffer_dtr"] = 1
    board.encoders = [(5, 6), (-1, -2), (0, 0), (3, 3)]
    board.sleep_cycles(1)
    telemetry = driver.move(10, [1] * 4, direction_bits=0b0011)
    header = board.frames[-1][1][0]
    assert header == 0x0100000000000003
    # in v020 moves tell positions as the second word of each pair
    assert telemetry.positions == ((5, -1, 0, 3) if profile == "upstream" else (6, -2, 0, 3))
    assert telemetry.completed is None
    driver.wait_idle()
    assert not board.moves
    board.pins["buffer_dtr"] = 0
    with pytest.raises(BusError, match="no room"):
        driver.move(10, [0] * 4)
    with pytest.raises(BusTimeoutError, match="BUFFER_DTR is low, although"):
        driver.wait_room()
    driver.estop()
    assert (board.config[0x00], driver.running) == (0, False)


def test_what_originals_do_not_have_is_refused_by_name():
    for profile in ("upstream", "v020"):
        _, driver = opened(profile=profile)
        for call in (
            "halt",
            "clear_halt",
            "buffer",
            "counters",
            "clear",
            "steps_lost",
            "set_times",
        ):
            with pytest.raises(UsageError, match=f"profile '{profile}' has no {call}; only"):
                getattr(driver, call)()
    with pytest.raises(UsageError, match="has no registers, only messages"):
        driver.read_register("R_VERSION")
    with pytest.raises(UsageError, match="share their addresses"):
        opened(profile="upstream")[1].read_encoders()


def test_encoders_of_v020_are_read_one_by_one():
    board, driver = opened(profile="v020")
    board.encoders = [(37, -124), (-1, 5), (0, 0), (1, 1)]
    assert driver.read_encoders().tolist() == [37, -1, 0, 1]
    assert driver.encoder_rates()[0] == -8000.0
    assert driver.identify().version == "0.2.0-dev"


def test_encoders_of_a_mended_original_are_read_as_registers():
    board = Board(profile="upstream")
    board.encoders = [(37, -124), (-1, 5), (0, 0), (1, 1)]
    driver = RapcoresDriver(board, profile="upstream", fixed=1)
    assert driver.read_encoders().tolist() == [37, -1, 0, 1]
