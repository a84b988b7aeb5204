"""A board behind serial ports in simulation: what a link to it sees, and when."""

import numpy as np
import pytest
from amaranth import Module, Signal
from amaranth.lib.wiring import Component, In, Out

from pulsewright.boards.rtl_serial import RtlSerialBoard, SerialPins
from pulsewright.boards.s3g import BOARD, packets
from pulsewright.errors import UsageError
from pulsewright.transport.serial_bus import VirtualSerialBus

pytestmark = pytest.mark.rtl
CLOCK = 1_000_000
BAUD = 30_000  # 33.33 cycles to a bit


class Echo(Component):
    """Both lines come back a cycle later; ``level`` counts the changes of the first one."""

    def __init__(self):
        super().__init__(
            {"on": In(1), "rx": In(2), "a": Out(1), "b": Out(1), "level": Out(2, init=2)}
            | {"in_a": In(1), "in_b": In(1)}
        )

    def elaborate(self, platform):
        m = Module()
        before = Signal(init=1)
        m.d.sync += [self.a.eq(self.in_a), self.b.eq(self.in_b & self.on), before.eq(self.in_a)]
        with m.If(before != self.in_a):
            m.d.sync += self.level.eq(self.level + 1)
        return m


@pytest.fixture
def board():
    return RtlSerialBoard(
        Echo(),
        clock_hz=CLOCK,
        ports=(SerialPins("in_a", "a", BAUD), SerialPins("in_b", "b", 2 * BAUD)),
        idle={"on": 1},
        pins={"low": ("level", 0), "high": ("level", 1)},
        listens=100,
    )


def test_a_byte_starts_when_the_board_listens_and_is_there_in_the_middle_of_its_stop_bit(board):
    assert board.now == 0
    assert board.send(1, b"\x55") == 100 + 334  # 333.3 cycles
    assert board.receive(1) == b""
    assert board.receive(1, until=10_000) == b"\x55"
    # The line falls at 100; 9.5 bits are 316.7 cycles.
    assert board.now == 100 + 317


def test_bytes_go_on_behind_those_that_are_on_the_wire(board):
    board.send(1, b"\x00\xff")
    assert board.send(1, b"\x31") == 100 + 667 + 334
    assert board.receive(1, until=20_000, count=3) == b"\x00\xff\x31"
    assert board.now == 100 + 667 + 317
    board.advance(5000)
    assert board.send(1, b"\x31") == 5001 + 334


def test_ports_have_rates_and_bytes_of_their_own(board):
    board.send(1, b"\x12")
    board.send(2, b"\x34\x56")
    board.advance(2000)
    assert (board.receive(1), board.receive(2)) == (b"\x12", b"\x34\x56")
    with pytest.raises(UsageError, match=r"serial port 3; there are 1\.\.2"):
        board.receive(3)


def test_a_wait_ends_in_its_cycle_and_time_does_not_go_back(board):
    assert board.receive(1, until=1234) == b""
    assert board.now == 1234
    assert board.receive(1, until=1000) == b""
    with pytest.raises(UsageError, match="advance to cycle 1000, but it is already 1234"):
        board.advance(1000)


def test_the_trace_has_the_changes_of_every_bit_once(board):
    board.send(1, b"\x0f")  # 0 1111 0000 1: falls at 100, rises at 133, falls at 266, rises at 400
    board.advance(133)
    first = board.drain()
    assert (first.start, first.end, first.initial.tolist()) == (0, 133, [0, 1])
    assert [cycles.tolist() for cycles in first.cycles] == [[100], []]
    board.advance(1000)
    second = board.drain()
    assert (second.start, second.end, second.initial.tolist()) == (133, 1000, [1, 1])
    assert [cycles.tolist() for cycles in second.cycles] == [[133, 266, 400], [133, 400]]
    board.restart()
    assert board.now == 0
    board.advance(50)
    assert not np.concatenate(board.drain().cycles).size


def test_a_link_reads_what_the_board_sends(board):
    bus = VirtualSerialBus(board)
    bus.write(b"hello")
    assert bus.read(10, 1.0, min_bytes=5) == b"hello"
    bus.sleep(0.001)
    assert bus.now() == 100 + 1333 + 317 + 1000


@pytest.mark.parametrize("profile", ["exact", "robust"])
def test_a_session_is_the_same_on_gateware_and_twin(profile):
    """Bytes, their times, and every change of every pin, with motion of both channels."""

    def session(board):
        bus, heard = VirtualSerialBus(board), []
        values = {5: 20, 7: 3, 1: 5, 2: 2000, 10: 3000, 18: -2500 & 0xFFFFFFFF, 11: 10}
        requests = [(packets.version(1), 8)]
        requests += [(packets.write_output(2, *item), 6) for item in values.items()]
        requests += [(packets.write_output(3, 3, 0x1E1E0F), 6), (packets.strobe(4, 1), 6)]
        for request, answer in [*requests, (packets.read_input(5, 0), 10)]:
            bus.write(request)
            heard.append((bus.read(100, 0.02, min_bytes=answer), bus.now()))
        bus.sleep(0.01)
        heard.append((bus.read(100, 0.05), bus.now()))
        return heard, board.drain()

    twin, gateware = session(BOARD.twin(profile)), session(BOARD.rtl(profile))
    assert twin[0] == gateware[0]
    assert twin[1].first_difference(gateware[1]) is None
    assert sum(map(len, gateware[1].cycles)) > 10_000
