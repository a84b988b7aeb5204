"""EPP through ppdev, tried at the system calls: a model of the driver with a twin at its port.

Numbers of requests and modes are those that a C program prints from linux/ppdev.h and
linux/parport.h.
"""

import errno
import os
import struct
from types import SimpleNamespace

import numpy as np
import pytest

from pulsewright import Job, open_board
from pulsewright.boards.playing import Drives
from pulsewright.boards.usc.player import UscPlayer
from pulsewright.boards.usc.twin import UscTwin
from pulsewright.edges.timing import DriveTiming
from pulsewright.errors import BusError, BusTimeoutError, UsageError
from pulsewright.transport import parport
from pulsewright.transport.bus import EPP_ACCESS
from pulsewright.transport.virtual import VirtualEppBus

CLAIM, RELEASE, EXCLUSIVE = 0x708B, 0x708C, 0x708F
SET_MODE, DIRECTION, CONTROL, GET_MODES = 0x40047080, 0x40047090, 0x4002708E, 0x80047097
EPP, ADDRESS = 0x40, 0x2000
FD = 1234


class Ppdev:
    """One port: what the kernel keeps of it, and how it answers."""

    def __init__(self, twin):
        self.bus = VirtualEppBus(twin)
        self.open_error = self.claim_error = self.error = 0
        self.modes = 0x7  # with EPP
        self.opened = self.claimed = self.exclusive = False
        self.mode, self.direction, self.calls, self.ninit = 0, None, [], []

    def _fail(self, number):
        raise OSError(number, os.strerror(number))

    def open(self, path, flags):
        assert path == "/dev/parport0"
        assert flags & os.O_ACCMODE == os.O_RDWR
        assert flags & os.O_NONBLOCK  # or the driver tries a read for ever
        if self.open_error:
            self._fail(self.open_error)
        self.opened = True
        return FD

    def close(self, fd):
        assert fd == FD
        assert self.opened
        self.opened = self.claimed = False

    def ioctl(self, fd, request, argument=b""):
        assert fd == FD
        assert self.opened
        if self.error:
            self._fail(self.error)
        if request == EXCLUSIVE:
            assert not self.claimed
            self.exclusive = True
        elif request == CLAIM:
            if self.claim_error:
                self._fail(self.claim_error)
            assert self.exclusive
            self.claimed = True
        elif request == RELEASE:
            if not self.claimed:
                self._fail(errno.EINVAL)
            self.claimed = False
        elif request == GET_MODES:
            return struct.pack("I", self.modes)
        elif not self.claimed:
            self._fail(errno.EINVAL)
        elif request == SET_MODE:
            (self.mode,) = struct.unpack("i", argument)
        elif request == DIRECTION:
            (self.direction,) = struct.unpack("i", argument)
        elif request == CONTROL:
            mask, value = argument
            assert mask == 4
            self.ninit.append(value)
            if value == 0:
                self.bus.reset()
        else:
            self._fail(errno.ENOTTY)
        return 0

    def _cycles(self, op, data):
        """Make EPP cycles until one is not acknowledged; return how many were, and the bytes."""
        if self.error:
            self._fail(self.error)
        if not self.claimed:
            self._fail(errno.EINVAL)
        assert self.mode & ~ADDRESS == EPP
        self.calls.append((op, len(data)))
        values = bytearray()
        for byte in data[:1024]:  # its buffer
            access = np.zeros(1, EPP_ACCESS)
            access["cycle"], access["op"], access["value"] = -1, ord(op), byte
            self.bus.transact(access)
            if access["timeout"][0]:
                break
            values.append(int(access["value"][0]))
        return bytes(values)

    def read(self, fd, count):
        assert fd == FD
        data = self._cycles("a" if self.mode & ADDRESS else "R", bytes(count))
        if not data:
            self._fail(errno.EAGAIN)
        return data

    def write(self, fd, data):
        assert fd == FD
        return len(self._cycles("A" if self.mode & ADDRESS else "W", data))


@pytest.fixture
def port(monkeypatch):
    port = Ppdev(UscTwin())
    calls = {name: getattr(port, name) for name in ("open", "close", "read", "write")}
    names = {name: getattr(os, name) for name in ("O_RDWR", "O_NONBLOCK")}
    monkeypatch.setattr(parport, "os", SimpleNamespace(**calls, **names))
    monkeypatch.setattr(parport, "fcntl", SimpleNamespace(ioctl=port.ioctl))
    return port


def test_a_board_at_the_port_works_as_on_any_link(port):
    with open_board("usc", link="epp:/dev/parport0") as board:
        assert board.identify().type == 4
        board.initialise()
        board.release_estop()
        assert board.set_step_rate(0, 30_000.0) == pytest.approx(30_000.0, rel=2e-3)
        port.bus.twin.advance(port.bus.now() + 200_000)  # 5 ms
        assert port.bus.twin.state()["steps"][0] == pytest.approx(150, abs=2)
    assert port.direction == 0
    assert not port.opened  # and given back


def test_a_plan_is_refused_where_nobody_keeps_its_times(port, examples):
    job = Job.from_gcode(examples / "square.ngc")
    steps = job.trajectory.mapped(job.machine.motor_matrix())
    drives = Drives([32e3] * 4, [160e3] * 4, [6.4e6] * 4, DriveTiming(2e-6, 2e-6, 5e-6, 5e-6))
    with (
        open_board("usc", link="epp:/dev/parport0") as board,
        pytest.raises(UsageError, match="not at their clock cycle"),
    ):
        UscPlayer(board, steps, drives).prepare()


def test_accesses_of_one_kind_go_to_the_system_together(port):
    bus = parport.ParportEppBus("/dev/parport0", 40_000_000)
    bus.write(0x00, bytes(12))
    assert port.calls == [("A", 1), ("W", 12)]
    assert bus.read(0x0F, 1) == b"\x41"  # its type and version
    bus.read(0x00, 3000)  # more than the driver's buffer has room for
    reads = [("R", 1024), ("R", 1024), ("R", 952)]
    assert port.calls[2:] == [("A", 1), ("R", 1), ("A", 1), *reads]
    bus.close()
    bus.close()


def test_an_access_waits_for_its_cycle(port):
    bus = parport.ParportEppBus("/dev/parport0", 1_000_000)
    accesses = np.zeros(3, EPP_ACCESS)
    accesses["op"], accesses["value"] = (ord("A"), ord("A"), ord("W")), (0x0F, 0x0D, 0)
    later = bus.now() + 30_000
    accesses["cycle"] = -1, later, -1
    bus.transact(accesses)
    assert accesses["cycle"][0] < later <= accesses["cycle"][1] <= accesses["cycle"][2]
    assert bus.now() >= later


def test_what_nobody_acknowledges_is_told_once(port):
    bus = parport.ParportEppBus("/dev/parport0", 40_000_000)
    with pytest.raises(BusTimeoutError, match="no board acknowledged 1 of 2"):
        bus.read(0x3F, 1)  # slot 3
    with pytest.raises(BusTimeoutError, match="3 of 4"):
        bus.write(0x30, b"abc")
    assert port.calls == [("A", 1), ("R", 1), ("A", 1), *(("W", n) for n in (3, 2, 1))]
    assert bus.read(0x0F, 1) == b"\x41"  # and the port works on


def test_reset_is_a_pulse(port):
    bus = parport.ParportEppBus("/dev/parport0", 40_000_000)
    bus.write(0x00, b"\x55")
    bus.reset()
    assert port.ninit == [0, 4]


@pytest.mark.parametrize(
    ("what", "number", "message"),
    [
        ("open_error", errno.ENOENT, "modprobe parport_pc ppdev"),
        ("open_error", errno.EACCES, "group of the device"),
        ("open_error", errno.ENXIO, "no port behind it"),
        ("claim_error", errno.ENXIO, "in use by another driver.*rmmod lp"),
    ],
)
def test_a_port_that_cannot_be_had(port, what, number, message):
    setattr(port, what, number)
    with pytest.raises(UsageError, match=message):
        open_board("usc", link="epp:/dev/parport0")
    assert not port.opened


def test_a_port_without_epp(port):
    port.modes = 0x3
    with pytest.raises(UsageError, match="has no EPP mode; choose EPP"):
        open_board("usc", link="epp:/dev/parport0")
    assert not port.opened
    assert not port.claimed


@pytest.mark.parametrize("number", [errno.ENODEV, errno.EIO])
def test_a_port_that_goes_is_a_lost_link(port, number):
    bus = parport.ParportEppBus("/dev/parport0", 40_000_000)
    port.error = number
    for call in (lambda: bus.read(0, 1), lambda: bus.write(0, b"a"), bus.reset):
        with pytest.raises(BusError, match="the link is lost"):
            call()


def test_links_that_are_none():
    with pytest.raises(UsageError, match="expected epp:PATH"):
        open_board("usc", link="epp:")
    with pytest.raises(UsageError, match="expected epp:PATH"):
        open_board("usc", link="epp:/dev/parport0?hz=1")
    with pytest.raises(UsageError, match=r"not one that usc can be opened at.*'epp:PATH'"):
        open_board("usc", link="spi:/dev/spidev0.0")
