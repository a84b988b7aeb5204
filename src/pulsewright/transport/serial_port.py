"""A board behind a serial port of this computer, or a pseudo-terminal, by pyserial."""

from __future__ import annotations

import time
from typing import Final

import serial

from pulsewright.errors import BusError, UsageError
from pulsewright.transport.host_clock import HostClock
from pulsewright.transport.serial_bus import SerialBus, check_read, check_time

WRITE_TIMEOUT: Final = 5.0  # a port that takes nothing for so long is stuck [s]


class PortSerialBus(SerialBus):
    """One serial port (8N1), opened for this process alone where the system can do that.

    Parameters
    ----------
    path : str
        Device: ``/dev/ttyUSB0``.
    baud : int
        Bit rate [baud].
    clock_hz : int
        Unit of `now` [Hz].

    Raises
    ------
    UsageError
        If there is no such port, it is in use or not ours to open, or cannot run at ``baud``.
    """

    def __init__(self, path: str, baud: int, clock_hz: int) -> None:
        self.clock_hz, self._path = clock_hz, path
        try:
            self._port = serial.Serial(
                path, baud, timeout=0, write_timeout=WRITE_TIMEOUT, exclusive=True
            )
        except (serial.SerialException, ValueError, OverflowError) as error:
            raise UsageError(
                f"serial port {path} cannot be opened at {baud} baud: {error}; see that the cable "
                f"is in, the path is right, no other program has the port, and you may use it "
                f"(on Debian: group dialout)"
            ) from error
        self._clock = HostClock(clock_hz)

    def write(self, data: bytes) -> None:
        """Send bytes, behind those that are still to be sent; see `SerialBus.write`."""
        try:
            self._port.write(data)
        except serial.SerialException as error:
            raise self._lost(error) from error

    def read(self, max_bytes: int, timeout_s: float, *, min_bytes: int = 1) -> bytes:
        """Return bytes that the board has sent; see `SerialBus.read`."""
        check_read(max_bytes, timeout_s, min_bytes)
        try:
            self._port.timeout = timeout_s
            data = bytes(self._port.read(min_bytes))
            if len(data) == min_bytes < max_bytes:
                self._port.timeout = 0
                data += bytes(self._port.read(max_bytes - min_bytes))
        except (serial.SerialException, OSError) as error:
            raise self._lost(error) from error
        return data

    def sleep(self, seconds: float) -> None:
        """Let time pass [s]."""
        check_time(seconds)
        time.sleep(seconds)

    def now(self) -> int:
        """Return the time since the port was opened, by the clock of the host [board cycle]."""
        return self._clock.now()

    def reset_input(self) -> None:
        """Forget the bytes that were received up to now and not read."""
        try:
            self._port.reset_input_buffer()
        except (serial.SerialException, OSError) as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Close the port; a second call does nothing."""
        self._port.close()

    def _lost(self, error: Exception) -> BusError:
        return BusError(f"serial port {self._path}: {error}; the link is lost")
