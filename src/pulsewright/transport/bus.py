"""Bus protocols: what a driver may ask of any link, be it a twin, a simulation or a cable."""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

ADDRESS_WRITE: Final = ord("A")
DATA_WRITE: Final = ord("W")
DATA_READ: Final = ord("R")
ADDRESS_READ: Final = ord("a")
ASAP: Final = -1  # as soon as the access before it is done

# One EPP access. ``cycle``: board clock cycle at which it acts, not before the access ahead of it
# is done; ASAP: right after that. ``value``: byte to write, or the byte read (filled in place).
# ``timeout``: set to 1 where no board acknowledged.
EPP_ACCESS: Final = np.dtype(
    [("cycle", "<i8"), ("op", "u1"), ("value", "u1"), ("timeout", "u1"), ("_", "u1", 5)]
)


class EppBus(Protocol):
    """An IEEE-1284 EPP bus with one or more boards."""

    clock_hz: int  # unit of ``EPP_ACCESS.cycle`` [Hz]
    access_cycles: int  # time one access takes [cycle]

    def transact(self, accesses: NDArray[np.void]) -> None:
        """Carry out an array of `EPP_ACCESS` in order; fill ``value`` of reads and ``timeout``.

        Also replaces each ``cycle`` by the cycle at which the access acted.

        Raises
        ------
        BusError
            If the link is lost. A cycle that no board acknowledges is no error here: it sets
            ``timeout``, and the driver decides.
        """

    def write(self, address: int, data: bytes) -> None:
        """Write ``data`` from ``address`` on, by auto-increment.

        Raises
        ------
        BusTimeoutError
            If no board acknowledges.
        """

    def read(self, address: int, count: int) -> bytes:
        """Read ``count`` bytes from ``address`` on, by auto-increment.

        Raises
        ------
        BusTimeoutError
            If no board acknowledges.
        """

    def reset(self) -> None:
        """Pulse nINIT: every board goes to its reset state."""

    def now(self) -> int:
        """Return the cycle at which the next access can act."""

    def close(self) -> None:
        """Release the link; a second call does nothing."""
