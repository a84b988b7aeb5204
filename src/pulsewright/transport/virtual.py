"""A bus in this process: whole arrays of accesses go to a twin in one call."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pulsewright.transport.bus import EppBus


class EppTwin(Protocol):
    """What a twin offers to a bus; units and meaning as in `EppBus`."""

    @property
    def clock_hz(self) -> int:
        """Board clock [Hz]."""

    @property
    def access_cycles(self) -> int:
        """Time one access takes [cycle]."""

    @property
    def now(self) -> int:
        """Cycle up to which time has passed."""

    def transact(self, accesses: NDArray[np.void]) -> None:
        """Carry out an array of `EPP_ACCESS`."""

    def reset(self) -> None:
        """Bring every board to its reset state."""


class VirtualEppBus(EppBus):
    """An EPP bus whose boards are a twin.

    Parameters
    ----------
    twin : EppTwin
        Kept as ``twin``, so that a program can reach its pins and its recording.
    """

    def __init__(self, twin: EppTwin) -> None:
        self.twin = twin
        self.clock_hz = twin.clock_hz
        self.access_cycles = twin.access_cycles
        self._free = 0  # cycle from which on the bus is free

    def transact(self, accesses: NDArray[np.void]) -> None:
        """Hand the whole array to the twin; see `EppBus.transact`."""
        self.twin.transact(accesses)
        if len(accesses):
            self._free = int(accesses["cycle"][-1]) + self.access_cycles

    def reset(self) -> None:
        """Reset every board of the twin."""
        self.twin.reset()

    def now(self) -> int:
        """Return the cycle at which the next access can act."""
        return max(self.twin.now, self._free)

    def close(self) -> None:
        """Do nothing: the twin stays, with its recording."""
