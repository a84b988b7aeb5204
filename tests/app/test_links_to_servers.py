"""Drivers at served boards: the client's side of the sockets."""

import time

import numpy as np
import pytest
from served import Control, serving

from pulsewright import open_board
from pulsewright.errors import BusError, BusTimeoutError, UsageError
from pulsewright.transport.bus import EPP_ACCESS
from pulsewright.transport.socket_bus import SocketEppBus


def test_a_usc_over_a_socket(tmp_path):
    path, options = tmp_path / "bus", {"watchdog_us": 0}  # this computer may be slow
    with serving(
        "usc", listen=f"epp+unix:{path}", control=f"unix:{tmp_path / 'c'}", options=options
    ):
        control = Control(tmp_path / "c")
        with open_board("usc", link=f"epp+unix:{path}", **options) as board:
            board.initialise()
            board.release_estop()
            begin = time.monotonic()
            rate = board.set_step_rate(0, 10_000.0)
            ran = time.monotonic()
            time.sleep(0.1)
            least = time.monotonic() - ran
            board.set_step_rate(0, 0.0)
            steps, seconds = control("steps")["steps"][0], time.monotonic() - begin
        # the server takes the client's times: the board ran from one write to the other
        assert least * rate - 2 <= steps <= seconds * rate + 2


def test_a_write_that_is_not_acknowledged_shows_at_the_next_read(tmp_path):
    path = tmp_path / "bus"
    with serving("usc", listen=f"epp+unix:{path}"):
        bus = SocketEppBus(f"unix:{path}", 40_000_000)
        assert bus.read(0x0F, 1) == b"\x41"
        with pytest.raises(BusTimeoutError, match=r"1 of 2.*data read 1.*2Fh"):
            bus.read(0x2F, 1)  # slot 2 is empty
        bus.write(0x2F, b"\x55")  # posted
        with pytest.raises(BusTimeoutError):
            bus.read(0x0F, 1)
        assert bus.read(0x0F, 1) == b"\x41"
        bus.write(0x0D, b"\x01")
        bus.reset()
        assert bus.read(0x00, 600) == bus.read(0x00, 600)  # more than a portion
        bus.close()


def test_accesses_wait_for_their_cycles(tmp_path):
    path = tmp_path / "bus"
    with serving("usc", listen=f"epp+unix:{path}", control=f"unix:{tmp_path / 'c'}"):
        bus = SocketEppBus(f"unix:{path}", 40_000_000)
        bus.read(0x0F, 1)
        accesses = np.zeros(4, EPP_ACCESS)
        accesses["op"] = np.frombuffer(b"ARAR", np.uint8)
        accesses["value"] = 0x0F
        later, begin = bus.now() + 2_000_000, time.monotonic()  # 50 ms
        accesses["cycle"] = -1, -1, later, -1
        bus.transact(accesses)
        cycles = accesses["cycle"].tolist()
        assert cycles[1] == cycles[0] + 60  # 1500 ns
        assert cycles[1] < later == cycles[2] == cycles[3] - 60
        assert time.monotonic() - begin > 0.049
        assert accesses["value"].tolist() == [0x0F, 0x41] * 2
        assert not accesses["timeout"].any()
        accesses["value"][2] = 0x2F  # nobody is there
        bus.transact(accesses)
        assert accesses["timeout"].tolist() == [0, 0, 0, 1]


def test_a_rapcores_over_a_socket(tmp_path):
    path = tmp_path / "bus"
    with (
        serving("rapcores", listen=f"spi+unix:{path}", control=f"unix:{tmp_path / 'c'}"),
        open_board("rapcores", link=f"spi+unix:{path}") as board,
    ):
        board.initialise(pulse_width=2e-6, pulse_space=2e-6, direction_setup=5e-6)
        board.release_estop()
        board.move(round(0.01 * board.tick_rate), [board.increment(1_000.0), 0, 0, 0])
        board.wait_idle()
        assert board.read_steps().tolist() == [9, 0, 0, 0]
        with pytest.raises(UsageError, match="control channel"):
            board.bus.reset()


def test_an_s3g_at_a_terminal(tmp_path):
    link = tmp_path / "s3g"
    with (
        serving("s3g", listen=f"pty:{link}"),
        open_board("s3g", link=f"serial:{link}?baud=500000") as board,
    ):
        assert board.identify().version == 0xCEBA  # what the document says: BA CE


def test_tcp_too():
    with serving("usc", listen="epp+tcp:127.0.0.1:0") as result:
        address = result["line"].partition("+")[2]
        bus = SocketEppBus(address, 40_000_000)
        assert bus.read(0x0F, 1) == b"\x41"
        bus.close()
        bus.close()


def test_a_server_that_goes_is_a_lost_link(tmp_path):
    path = tmp_path / "bus"
    with serving("usc", listen=f"epp+unix:{path}"):
        bus = SocketEppBus(f"unix:{path}", 40_000_000)
        assert bus.read(0x0F, 1) == b"\x41"
    with pytest.raises(BusError, match="the link is lost"):
        bus.read(0x0F, 1)


@pytest.mark.parametrize(
    ("board", "link", "message"),
    [
        ("usc", "epp+unix:/no/such/place", "nobody serves at unix:/no/such/place"),
        ("usc", "epp+tcp:127.0.0.1", "expected tcp:HOST:PORT"),
        ("usc", "epp+tcp:127.0.0.1:99999", "expected tcp:HOST:PORT"),
        ("rapcores", "spi+unix:/no/such/place", "nobody serves"),
        ("rapcores", "epp+unix:/no/such/place", "not one that rapcores can be opened at"),
    ],
)
def test_places_without_a_server(board, link, message):
    with pytest.raises(UsageError, match=message):
        open_board(board, link=link)
