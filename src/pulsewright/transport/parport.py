"""EPP boards at a parallel port of this computer, by the Linux driver ppdev.

The port makes whole EPP cycles in hardware; ppdev hands bytes to it. A cycle that no board
acknowledges ends after about 10 us: the port sets a flag that the driver clears, and moves fewer
bytes than asked.
"""

from __future__ import annotations

import errno
import fcntl
import os
import struct
import time
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.errors import BusError, UsageError
from pulsewright.transport.bus import (
    ADDRESS_READ,
    ADDRESS_WRITE,
    DATA_READ,
    DATA_WRITE,
    EppBus,
)
from pulsewright.transport.host_clock import HostClock
from pulsewright.transport.ioctl import from_device, plain, to_device

# requests of linux/ppdev.h
CLAIM: Final = plain("p", 0x8B)
RELEASE: Final = plain("p", 0x8C)
EXCLUSIVE: Final = plain("p", 0x8F)
SET_MODE: Final = to_device("p", 0x80, 4)
DATA_DIRECTION: Final = to_device("p", 0x90, 4)
CHANGE_CONTROL: Final = to_device("p", 0x8E, 2)  # mask, value
GET_MODES: Final = from_device("p", 0x97, 4)

# values of linux/parport.h
PORT_HAS_EPP: Final = 1 << 2
EPP_DATA: Final = 1 << 6
EPP_ADDRESS: Final = EPP_DATA | 1 << 13
NINIT: Final = 1 << 2

RESET_PULSE: Final = 1e-3  # nINIT low, and the time that boards have to come up then [s]
CYCLE_TIME: Final = 1.5e-6  # of one EPP cycle with what the system adds to it, at best [s]
BUFFER: Final = 1024  # bytes that ppdev moves in one call
LOST: Final = 0xFF  # what a port reads when nobody answers
_MODES: Final = {
    ADDRESS_WRITE: EPP_ADDRESS,
    ADDRESS_READ: EPP_ADDRESS,
    DATA_WRITE: EPP_DATA,
    DATA_READ: EPP_DATA,
}
_READS: Final = (DATA_READ, ADDRESS_READ)


class ParportEppBus(EppBus):
    """All boards at one parallel port, which belongs to this process until `close`.

    Accesses wait for their cycle by the host's clock, which may let them come late. Those of one
    kind in a row go to the system in one call.

    Parameters
    ----------
    path : str
        Device: ``/dev/parport0``.
    clock_hz : int
        Unit of `now` and of the cycles of accesses [Hz].

    Raises
    ------
    UsageError
        If there is no such port, it is not ours to open, another driver has it, or it has no EPP.
    """

    in_real_time = True

    def __init__(self, path: str, clock_hz: int) -> None:
        self.clock_hz, self._path = clock_hz, path
        self.exact = False  # the system and the port take their time
        self.access_cycles = round(CYCLE_TIME * clock_hz)
        self._clock = HostClock(clock_hz)
        try:
            # without waiting: a read that no board answers would be tried for ever
            self._fd = os.open(path, os.O_RDWR | os.O_NONBLOCK)
        except OSError as error:
            raise UsageError(_cannot_open(path, error)) from error
        try:
            self._claim()
        except BaseException:
            os.close(self._fd)
            self._fd = -1
            raise
        self._mode = 0

    def _claim(self) -> None:
        try:
            fcntl.ioctl(self._fd, EXCLUSIVE)
            fcntl.ioctl(self._fd, CLAIM)
        except OSError as error:
            raise UsageError(
                f"parallel port {self._path} is in use by another driver ({error.strerror}); stop "
                f"what has it: often the printer driver, 'rmmod lp', or a running LinuxCNC"
            ) from error
        (modes,) = struct.unpack("I", fcntl.ioctl(self._fd, GET_MODES, bytes(4)))
        if not modes & PORT_HAS_EPP:
            raise UsageError(
                f"parallel port {self._path} has no EPP mode; choose EPP (or EPP 1.9, ECP+EPP) for "
                f"the port in the computer's firmware set-up, or take a port card that has it"
            )
        fcntl.ioctl(self._fd, DATA_DIRECTION, struct.pack("i", 0))

    def transact(self, accesses: NDArray[np.void]) -> None:
        """Carry out accesses, each not before its cycle by the host's clock; see `EppBus`."""
        if not len(accesses):
            return
        ops, asked = accesses["op"], accesses["cycle"]
        breaks = (ops[1:] != ops[:-1]) | (asked[1:] > asked[:-1])
        begins = [0, *(np.flatnonzero(breaks) + 1).tolist(), len(accesses)]
        try:
            for first, last in pairwise(begins):
                self._clock.wait(int(asked[first]))
                done = self._clock.now()
                self._group(accesses[first:last])
                asked[first:last] = done
        except OSError as error:
            raise BusError(
                f"parallel port {self._path}: {error.strerror or error}; the link is lost"
            ) from error

    def _group(self, group: NDArray[np.void]) -> None:
        """Carry out accesses of one kind; go on behind those that are not acknowledged."""
        op = int(group["op"][0])
        if self._mode != _MODES[op]:
            fcntl.ioctl(self._fd, SET_MODE, struct.pack("i", _MODES[op]))
            self._mode = _MODES[op]
        group["timeout"] = 0
        done = 0
        while done < len(group):
            part = group[done : done + BUFFER]
            if op in _READS:
                data = self._read(len(part))
                part["value"][: len(data)] = np.frombuffer(data, np.uint8)
                moved = len(data)
            else:
                moved = self._write(part["value"].tobytes())
            done += moved
            if moved < len(part):  # the next one was tried, and nobody answered
                group["timeout"][done] = 1
                if op in _READS:
                    group["value"][done] = LOST
                done += 1

    def _read(self, count: int) -> bytes:
        try:
            return os.read(self._fd, count)
        except BlockingIOError:  # no byte came
            return b""

    def _write(self, data: bytes) -> int:
        try:
            return os.write(self._fd, data)
        except BlockingIOError:  # no byte went
            return 0

    def reset(self) -> None:
        """Pulse nINIT."""
        try:
            for level in (0, NINIT):
                fcntl.ioctl(self._fd, CHANGE_CONTROL, struct.pack("BB", NINIT, level))
                time.sleep(RESET_PULSE)
        except OSError as error:
            raise BusError(
                f"parallel port {self._path}: {error.strerror}; the link is lost"
            ) from error

    def now(self) -> int:
        """Return the time since the port was opened, by the clock of the host."""
        return self._clock.now()

    def close(self) -> None:
        """Give the port back; a second call does nothing."""
        if self._fd >= 0:
            fd, self._fd = self._fd, -1
            try:
                fcntl.ioctl(fd, RELEASE)
            finally:
                os.close(fd)


def _cannot_open(path: str, error: OSError) -> str:
    if error.errno == errno.ENOENT:
        what = "there is no such device: load the drivers with 'modprobe parport_pc ppdev'"
    elif error.errno in (errno.EACCES, errno.EPERM):
        what = "you may not use it: join the group of the device (on Debian: lp)"
    elif error.errno in (errno.ENXIO, errno.ENODEV):
        what = "the device has no port behind it: see what parport_pc found with 'dmesg'"
    else:
        what = f"{error.strerror}"
    return f"parallel port {path} cannot be opened; {what}"
