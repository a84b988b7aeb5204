"""SPI: what a driver may ask of any link with frames of bytes, and a link to a twin.

Mode 0, most significant bit of each byte first, chip select (CS) active low. A frame is all bytes
between the fall of CS and its rise; for each byte sent, one comes back.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from functools import lru_cache
from typing import Final, Protocol

from pulsewright.errors import UsageError
from pulsewright.transport.bus import ASAP

HALF_PERIOD: Final = 6  # of SCK on links to twins [cycle]
CS_HIGH: Final = 6  # between frames on links to twins, at least [cycle]
RESET_PULSE: Final = 8  # at rst_n [cycle]


@lru_cache(256)
def frame_cycles(length: int, half: int = HALF_PERIOD) -> int:
    """Return how long a frame of ``length`` bytes takes on a link to a twin [cycle].

    From the fall of CS to its next fall, if frames follow each other at once. ``half`` is half a
    period of SCK [cycle].

    Examples
    --------
    >>> frame_cycles(16)  # two words of 64 bits, with SCK at a twelfth of the board's clock
    1560
    """
    return half * (16 * length + 2) + max(2 * half, CS_HIGH)


class SpiBus(Protocol):
    """An SPI link with one board behind it."""

    clock_hz: int  # unit of `now` [Hz]
    in_real_time: bool = False  # time is that of the host's clock, and it may be late

    @abstractmethod
    def transfer(self, data: bytes, cycle: int = ASAP) -> bytes:
        """Send bytes in one frame and return as many that the board has sent meanwhile.

        Parameters
        ----------
        data : bytes
            At least one.
        cycle : int
            Board cycle at which CS falls, not before the frame ahead is done; ASAP: right after
            that. Links to hardware send at once.

        Raises
        ------
        UsageError
            If there are no bytes.
        BusError
            If the link is lost.
        """

    def level(self, pin: str) -> int | None:
        """Return the level of an output pin of the board, or None if the link does not have it."""
        return None

    @abstractmethod
    def now(self) -> int:
        """Return the present time [board cycle].

        A link to a twin knows the board's own cycle; any other one counts from its opening on, with
        the clock of the host.
        """

    @abstractmethod
    def sleep(self, seconds: float) -> None:
        """Let time pass, 0 or more [s]."""

    @abstractmethod
    def reset(self) -> None:
        """Pulse the reset pin, and wait until the board listens again.

        Raises
        ------
        UsageError
            If the link does not have that pin.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the link; a second call does nothing."""


def check_frame(data: bytes) -> None:
    """Check that a frame has bytes.

    Raises
    ------
    UsageError
        If not.
    """
    if not data:
        raise UsageError("spi link: a frame without bytes; allowed are 1 or more")


def check_time(seconds: float) -> None:
    """Check a time to wait.

    Raises
    ------
    UsageError
        If it is negative or no number.
    """
    if not 0 <= seconds < math.inf:
        raise UsageError(f"spi link: wait {seconds} s; allowed are 0 or more")


class SpiTwin(Protocol):
    """What a twin, or a simulation of gateware, offers to a link."""

    @property
    def clock_hz(self) -> int:
        """Board clock [Hz]."""

    @property
    def now(self) -> int:
        """Present cycle: its edge is done."""

    def advance(self, cycle: int) -> None:
        """Let time pass through edge ``cycle``, which is not before ``now``."""

    def schedule(self, cycle: int, pin: str, level: int) -> None:
        """Set an input pin from ``cycle`` on, which is after ``now``."""

    def level(self, pin: str) -> int:
        """Return the level of an output pin now."""

    def transfer(self, cycle: int, data: bytes, half: int) -> tuple[bytes, int]:
        """Send one frame.

        CS falls at ``cycle``, which is after ``now``, and the first bit is set up ``half`` cycles
        later, at t0. SCK rises at t0 + half + 2 half j and falls at t0 + 2 half (j + 1) for bit j,
        and COPI changes with that fall. CIPO is sampled in the last cycle before each rise. CS
        rises ``half`` cycles after the last fall and stays high for max(2 half, 6) cycles at least.

        Returns
        -------
        bytes
            As many as were sent.
        int
            First cycle at which the next frame may begin: ``cycle`` + `frame_cycles`. Time has
            passed up to the last bit at least, and not through this cycle.
        """


class VirtualSpiBus(SpiBus):
    """A link to a twin in this process; time is that of the board.

    Parameters
    ----------
    twin : SpiTwin
        Kept as ``twin``, so that a program can reach its pins and its recording.
    half : int
        Half a period of SCK, at least 2 [cycle].
    listens : int
        Cycles from the board's start, or from the end of a reset, until it can take a frame.

    Raises
    ------
    UsageError
        If ``half`` is not allowed.
    """

    def __init__(self, twin: SpiTwin, half: int = HALF_PERIOD, *, listens: int = 0) -> None:
        if half < 2:
            raise UsageError(f"spi link: half a period of {half} cycles; allowed are 2 or more")
        self.twin, self.half = twin, half
        self.clock_hz = twin.clock_hz
        self._wait = listens
        self._listens = listens  # cycle from which on the board takes frames
        self._free = 0  # cycle from which on the bus is free

    def transfer(self, data: bytes, cycle: int = ASAP) -> bytes:
        """Send bytes in one frame and return what the board has sent; see `SpiBus.transfer`."""
        check_frame(data)
        begin = max(cycle, self._free, self._listens, self.twin.now + 1)
        reply, self._free = self.twin.transfer(begin, data, self.half)
        return reply

    def level(self, pin: str) -> int | None:
        """Return the level of an output pin of the board now."""
        return self.twin.level(pin)

    def now(self) -> int:
        """Return the cycle of the board, or that at which the next frame can begin."""
        return max(self.twin.now, self._free)

    def sleep(self, seconds: float) -> None:
        """Let board time pass [s]."""
        check_time(seconds)
        self.twin.advance(self.now() + math.ceil(seconds * self.clock_hz))

    def reset(self) -> None:
        """Pulse rst_n, and wait until the board listens again."""
        begin = self.now() + 1
        self.twin.schedule(begin, "rst_n", 0)
        self.twin.schedule(begin + RESET_PULSE, "rst_n", 1)
        self._listens = begin + 2 * RESET_PULSE + self._wait  # a synchroniser may take some of it
        self.twin.advance(self._listens)

    def close(self) -> None:
        """Do nothing: the twin stays, with its recording."""
