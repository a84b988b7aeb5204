"""Boards in real time, whose computer may be too slow for them."""

import pytest

from pulsewright.boards.live import LivePort


class Board:
    """A board of 1 MHz; simulating a second of it takes ``cost`` seconds."""

    clock_hz = 1_000_000

    def __init__(self, cost):
        self.now, self.cost, self.time, self.pieces = 0, cost, 50.0, []

    def clock(self):
        return self.time

    def advance(self, cycle):
        assert cycle > self.now
        self.pieces.append(cycle - self.now)
        self.time += (cycle - self.now) / self.clock_hz * self.cost
        self.now = cycle

    def drain(self, copy):
        return None


def live(board):
    return LivePort(board, clock=board.clock, effort=board.clock)


def test_a_fast_computer_catches_up():
    """A second takes a thousandth of one."""
    board = Board(cost=0.001)
    port = live(board)
    board.time += 3.0
    port.catch_up()
    assert board.now == 3_000_000
    assert port.lost == 0.0
    port.catch_up()
    assert board.now == pytest.approx(3_003_000, abs=2)


def test_for_a_slow_one_time_stands_still():
    """A second takes two: in 10 ms it gets 5 ms far, and forgets what it is late then."""
    board = Board(cost=2.0)
    port = live(board)
    for _ in range(20):
        board.time += 1.0
        begin = board.now
        port.catch_up()
        assert board.now - begin == pytest.approx(5000, abs=2000)
        assert port.cycle == pytest.approx(board.now, abs=2)
        assert port.lost + board.now / 1e6 == pytest.approx(board.time - 50.0, abs=1e-3)


def test_clients_that_ask_in_haste_are_answered():
    """Each asks 0.1 ms after an answer: a tenth of the time is theirs, so 1000 take 1 s."""
    board = Board(cost=4.0)
    port = live(board)
    for _ in range(1000):
        board.time += 1e-4
        port.catch_up()
    assert board.time - 50.0 == pytest.approx(1.0, rel=0.1)


def test_a_computer_that_did_other_things_meanwhile_catches_up():
    board = Board(cost=0.0)
    port = LivePort(board, clock=board.clock, effort=lambda: 0.0)
    board.time += 30.0
    port.catch_up()
    assert board.now == 30_000_000
    assert port.lost == 0.0


def test_what_is_simulated_at_once_is_short():
    board = Board(cost=0.0)
    port = live(board)
    board.time += 1.0
    port.catch_up()
    assert max(board.pieces) == 2000
