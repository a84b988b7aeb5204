"""The burst that commands all axes: planned by `commands`, sent by `driver`.

It is an address write (access 0) and one data write to each byte from the first velocity to the
outputs, whose word feeds the watchdog. Every access takes the same time.
"""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.pluto_step import registers

AXES: Final = len(registers.W_VELOCITY)
BURST_ADDRESS: Final = registers.W_VELOCITY[0]
BURST_ACCESSES: Final = 3 + registers.W_OUTPUTS - BURST_ADDRESS
# the access that makes the velocity of each axis take effect: its high byte
VELOCITY_ACCESS: Final = tuple(address + 2 - BURST_ADDRESS for address in registers.W_VELOCITY)


class RateUpdates(Protocol):
    """Commands for all axes at n moments, in columns."""

    @property
    def cycle(self) -> NDArray[np.int64]:
        """Clock cycle at which the address write of each burst acts, shape (n,)."""

    @property
    def velocity(self) -> NDArray[np.int16]:
        """Velocity words, shape (n, 4), -1024 .. 1024 at most."""
