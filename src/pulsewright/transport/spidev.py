"""A board behind an SPI controller of this computer, by the Linux driver spidev."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import struct
import time
from pathlib import Path
from typing import Final

from pulsewright.errors import BusError, UsageError
from pulsewright.transport.bus import ASAP
from pulsewright.transport.host_clock import HostClock
from pulsewright.transport.ioctl import to_device
from pulsewright.transport.spi_bus import SpiBus, check_frame, check_time

# requests of linux/spi/spidev.h
SET_MODE: Final = to_device("k", 1, 1)
SET_BITS: Final = to_device("k", 3, 1)
SET_SPEED: Final = to_device("k", 4, 4)
MESSAGE: Final = to_device("k", 0, 32)  # one transfer
# what to send and where to receive (addresses), length, speed [Hz], delay, bits per word, and
# things that stay 0
TRANSFER: Final = struct.Struct("QQIIHBBBBBB")

BUFFER_SIZE: Final = Path("/sys/module/spidev/parameters/bufsiz")
DEFAULT_BUFFER: Final = 4096  # bytes of a frame, where that file does not say


class SpidevBus(SpiBus):
    """One chip select of one SPI controller: mode 0, 8 bits, CS active low.

    Parameters
    ----------
    path : str
        Device: ``/dev/spidev0.0``.
    hz : int
        Rate of SCK, at most; the controller takes the next lower one that it has [Hz].
    clock_hz : int
        Unit of `now` [Hz].

    Raises
    ------
    UsageError
        If there is no such device, it is not ours to open, or cannot run like that.
    """

    in_real_time = True

    def __init__(self, path: str, hz: int, clock_hz: int) -> None:
        self.clock_hz, self._path, self._hz = clock_hz, path, hz
        self._clock = HostClock(clock_hz)
        try:
            self._fd = os.open(path, os.O_RDWR)
        except OSError as error:
            raise UsageError(_cannot_open(path, error)) from error
        try:
            fcntl.ioctl(self._fd, SET_MODE, bytes(1))
            fcntl.ioctl(self._fd, SET_BITS, b"\x08")
            fcntl.ioctl(self._fd, SET_SPEED, struct.pack("I", hz))
        except OSError as error:
            os.close(self._fd)
            raise UsageError(
                f"spi device {path} does not take mode 0 at {hz} Hz ({error.strerror}); try a "
                f"lower rate, '?hz=1000000'"
            ) from error
        self._longest = _buffer_size()

    def transfer(self, data: bytes, cycle: int = ASAP) -> bytes:
        """Send bytes in one frame, not before ``cycle`` by the host's clock; see `SpiBus`."""
        check_frame(data)
        if len(data) > self._longest:
            raise UsageError(
                f"spi link: a frame of {len(data)} bytes; the driver takes {self._longest}: load "
                f"it with 'modprobe spidev bufsiz={1 << (len(data) - 1).bit_length()}'"
            )
        self._clock.wait(cycle)
        out = ctypes.create_string_buffer(data, len(data))
        back = ctypes.create_string_buffer(len(data))
        request = TRANSFER.pack(
            ctypes.addressof(out), ctypes.addressof(back), len(data), self._hz, 0, 8, *(0,) * 5
        )
        try:
            fcntl.ioctl(self._fd, MESSAGE, request)
        except OSError as error:
            raise BusError(
                f"spi device {self._path}: {error.strerror}; the link is lost"
            ) from error
        return back.raw

    def now(self) -> int:
        """Return the time since the device was opened, by the clock of the host."""
        return self._clock.now()

    def sleep(self, seconds: float) -> None:
        """Let time pass [s]."""
        check_time(seconds)
        time.sleep(seconds)

    def reset(self) -> None:
        """Refuse: SPI has no reset."""
        raise UsageError("spi link: it has no reset pin; press the board's button")

    def close(self) -> None:
        """Close the device; a second call does nothing."""
        if self._fd >= 0:
            fd, self._fd = self._fd, -1
            os.close(fd)


def _buffer_size() -> int:
    try:
        return int(BUFFER_SIZE.read_text())
    except (OSError, ValueError):
        return DEFAULT_BUFFER


def _cannot_open(path: str, error: OSError) -> str:
    if error.errno == errno.ENOENT:
        what = "there is no such device: switch SPI on (Raspberry Pi: dtparam=spi=on)"
    elif error.errno in (errno.EACCES, errno.EPERM):
        what = "you may not use it: join the group of the device (Raspberry Pi OS: spi)"
    else:
        what = f"{error.strerror}"
    return f"spi device {path} cannot be opened; {what}"
