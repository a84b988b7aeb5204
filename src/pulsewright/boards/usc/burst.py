"""The burst that commands all axes at once: planned by `commands`, sent by `driver`.

It is an address write (access 0) and one data write to each register from the first divisor to the
rate generator control. Every access takes the same time.
"""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.usc import registers

AXES: Final = len(registers.W_DIVISOR)
BURST_ADDRESS: Final = registers.W_DIVISOR[0]
BURST_ACCESSES: Final = 2 + registers.W_RATE_CONTROL - BURST_ADDRESS
# the accesses that take effect: the high byte of each divisor, then run and direction of all axes
DIVISOR_ACCESS: Final = tuple(address + 3 - BURST_ADDRESS for address in registers.W_DIVISOR)
CONTROL_ACCESS: Final = BURST_ACCESSES - 1


class RateUpdates(Protocol):
    """Commands for all axes at n moments, in columns."""

    @property
    def cycle(self) -> NDArray[np.int64]:
        """Clock cycle at which the address write of each burst acts, shape (n,)."""

    @property
    def divisor(self) -> NDArray[np.uint32]:
        """Divisors, shape (n, 4), 0 .. 2^24 - 1; 0 halts an axis."""

    @property
    def control(self) -> NDArray[np.uint8]:
        """Rate generator control bytes, shape (n,)."""
