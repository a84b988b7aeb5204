"""SPI through spidev, tried at the system calls: a model of the driver with a twin behind it.

Numbers of requests, and where things are in them, are what a C program prints from
linux/spi/spidev.h.
"""

import ctypes
import errno
import os
import struct
from types import SimpleNamespace

import pytest

from pulsewright import open_board
from pulsewright.boards.rapcores.twin import RapcoresTwin
from pulsewright.errors import BusError, UsageError
from pulsewright.transport import spidev
from pulsewright.transport.spi_bus import VirtualSpiBus

MODE, BITS, SPEED, MESSAGE = 0x40016B01, 0x40016B03, 0x40046B04, 0x40206B00
FD = 77


class Spidev:
    """One chip select: what the kernel keeps of it, and how it answers."""

    def __init__(self, twin):
        self.bus = VirtualSpiBus(twin, listens=255)
        self.open_error = self.speed_error = self.error = 0
        self.settings, self.frames, self.opened = {}, [], False
        self.bufsiz = 4096

    def _fail(self, number):
        raise OSError(number, os.strerror(number))

    def open(self, path, flags):
        assert (path, flags) == ("/dev/spidev0.0", os.O_RDWR)
        if self.open_error:
            self._fail(self.open_error)
        self.opened = True
        return FD

    def close(self, fd):
        assert fd == FD
        assert self.opened
        self.opened = False

    def ioctl(self, fd, request, argument):
        assert fd == FD
        assert self.opened
        if self.error:
            self._fail(self.error)
        if request == SPEED and self.speed_error:
            self._fail(self.speed_error)
        if request in (MODE, BITS, SPEED):
            self.settings[request] = int.from_bytes(argument, "little")
            return 0
        assert request == MESSAGE
        send, receive, length = struct.unpack_from("QQI", argument)
        (speed,) = struct.unpack_from("I", argument, 20)
        if length > self.bufsiz:
            self._fail(errno.EMSGSIZE)
        assert speed == self.settings[SPEED]
        assert argument[24:] == bytes((0, 0, 8, 0, 0, 0, 0, 0))  # delay, bits, CS stays as it is
        data = ctypes.string_at(send, length)
        self.frames.append(data)
        ctypes.memmove(receive, self.bus.transfer(data), length)
        return length


@pytest.fixture
def device(monkeypatch):
    device = Spidev(RapcoresTwin())
    calls = {name: getattr(device, name) for name in ("open", "close")}
    monkeypatch.setattr(spidev, "os", SimpleNamespace(**calls, O_RDWR=os.O_RDWR))
    monkeypatch.setattr(spidev, "fcntl", SimpleNamespace(ioctl=device.ioctl))
    return device


def test_a_board_behind_spidev_works_as_on_any_link(device):
    with open_board("rapcores", link="spi:/dev/spidev0.0?hz=1000000") as board:
        board.initialise(pulse_width=2e-6, pulse_space=2e-6, direction_setup=5e-6)
        board.release_estop()
        board.move(round(0.01 * board.tick_rate), [board.increment(1_000.0), 0, 0, 0])
        device.bus.sleep(0.05)
        assert board.read_steps().tolist() == [9, 0, 0, 0]
    assert device.settings == {MODE: 0, BITS: 8, SPEED: 1_000_000}
    assert not device.opened


def test_without_a_rate_replies_are_right(device):
    """The board samples its pins with 16 MHz, and replies are right up to a twelfth of that."""
    open_board("rapcores", link="spi:/dev/spidev0.0").close()
    assert device.settings[SPEED] == 1_333_333


def test_bytes_go_both_ways_in_one_frame(device):
    bus = spidev.SpidevBus("/dev/spidev0.0", 1_000_000, 16_000_000)
    frame = struct.pack("<QQ", 0xF1 << 56 | 1, 0)  # the version of the protocol
    bus.transfer(frame)
    assert struct.unpack("<QQ", bus.transfer(frame)) == (0, 0x20200404)
    assert device.frames == [frame, frame]
    with pytest.raises(UsageError, match="without bytes"):
        bus.transfer(b"")
    with pytest.raises(UsageError, match=r"5000 bytes; the driver takes 4096.*bufsiz=8192"):
        bus.transfer(bytes(5000))
    with pytest.raises(UsageError, match="no reset pin"):
        bus.reset()
    begin = bus.now()
    bus.sleep(0.01)
    assert bus.now() - begin >= 160_000
    bus.close()
    bus.close()


@pytest.mark.parametrize(
    ("what", "number", "message"),
    [
        ("open_error", errno.ENOENT, "switch SPI on"),
        ("open_error", errno.EACCES, "group of the device"),
        ("speed_error", errno.EINVAL, "try a lower rate"),
    ],
)
def test_a_device_that_cannot_be_had(device, what, number, message):
    setattr(device, what, number)
    with pytest.raises(UsageError, match=message):
        open_board("rapcores", link="spi:/dev/spidev0.0")
    assert not device.opened


def test_a_device_that_goes_is_a_lost_link(device):
    bus = spidev.SpidevBus("/dev/spidev0.0", 1_000_000, 16_000_000)
    device.error = errno.ESHUTDOWN
    with pytest.raises(BusError, match="the link is lost"):
        bus.transfer(bytes(16))


@pytest.mark.parametrize("query", ["?hz=fast", "?hz=0", "?speed=3"])
def test_links_that_are_none(query):
    with pytest.raises(UsageError, match=r"expected spi:PATH\?hz=N"):
        open_board("rapcores", link=f"spi:/dev/spidev0.0{query}")
