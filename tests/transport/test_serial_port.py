"""Serial ports by pyserial, tried at a pseudo-terminal with a plain responder behind it."""

import os
import threading
import tty
from contextlib import suppress

import pytest

from pulsewright import open_board
from pulsewright.errors import BusError, UsageError
from pulsewright.transport.serial_port import PortSerialBus


@pytest.fixture
def pair():
    """A bus, and the other end of its wire."""
    host, terminal = os.openpty()
    tty.setraw(terminal)
    bus = PortSerialBus(os.ttyname(terminal), 500_000, 1_000_000)
    yield bus, host
    bus.close()
    for end in (host, terminal):
        with suppress(OSError):
            os.close(end)


def test_bytes_go_both_ways(pair):
    bus, far = pair
    bus.write(b"\xd5\x00\xff")
    assert os.read(far, 10) == b"\xd5\x00\xff"
    os.write(far, b"\x01\x02\x03\x04")
    assert bus.read(2, 1.0, min_bytes=2) == b"\x01\x02"
    assert bus.read(10, 1.0, min_bytes=2) == b"\x03\x04"


def test_reading_waits_for_what_is_missing_and_no_longer(pair):
    bus, far = pair
    before = bus.now()
    assert bus.read(4, 0.05) == b""
    assert 0.05 <= (bus.now() - before) / 1e6 < 5.0
    threading.Timer(0.05, os.write, (far, b"late")).start()
    assert bus.read(4, 10.0, min_bytes=4) == b"late"
    os.write(far, b"ab")
    assert bus.read(4, 0.05, min_bytes=3) == b"ab"


def test_old_bytes_can_be_forgotten(pair):
    bus, far = pair
    os.write(far, b"old")
    bus.sleep(0.02)
    bus.reset_input()
    os.write(far, b"new")
    assert bus.read(3, 1.0, min_bytes=3) == b"new"


def test_what_cannot_be_done_is_explained(pair):
    bus, far = pair
    with pytest.raises(UsageError, match="no_such_port cannot be opened at 500000 baud"):
        PortSerialBus("/dev/no_such_port", 500_000, 1)
    with pytest.raises(UsageError, match="at least 3 and at most 2"):
        bus.read(2, 1.0, min_bytes=3)
    with pytest.raises(UsageError, match="wait -1"):
        bus.sleep(-1)
    os.close(far)
    with pytest.raises(BusError, match="the link is lost"):
        bus.read(1, 1.0)
    bus.close()
    bus.close()


@pytest.mark.parametrize(
    ("board", "link", "message"),
    [
        ("s3g", "serial:", "expected serial:PATH"),
        ("s3g", "serial:/dev/x?baud=fast", "expected serial:PATH"),
        ("s3g", "serial:/dev/x?speed=9600", "expected serial:PATH"),
        ("s3g", "serial:/dev/no_such_port", "at 500000 baud"),
        ("s3g", "serial:/dev/no_such_port?baud=115200", "at 115200 baud"),
        ("usc", "serial:/dev/ttyUSB0", "not one that usc can be opened at"),
        ("s3g", "tcp:1", "not one that s3g can be opened at"),
    ],
)
def test_links_that_cannot_be_opened(board, link, message):
    with pytest.raises(UsageError, match=message):
        open_board(board, link=link)
