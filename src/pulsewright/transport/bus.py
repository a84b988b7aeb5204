"""Bus protocols: what a driver may ask of any link, be it a twin, a simulation or a cable."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from pulsewright.errors import BusTimeoutError

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

_OP_NAMES: Final = {
    ADDRESS_WRITE: "address write",
    DATA_WRITE: "data write",
    DATA_READ: "data read",
    ADDRESS_READ: "address read",
}


def write_accesses(address: int, data: bytes | Sequence[int]) -> NDArray[np.void]:
    """Return the accesses that write ``data`` from ``address`` on, by auto-increment, ASAP."""
    accesses = np.zeros(1 + len(data), EPP_ACCESS)
    accesses["cycle"] = ASAP
    accesses["op"] = DATA_WRITE
    accesses["op"][0] = ADDRESS_WRITE
    accesses["value"] = [address, *data]
    return accesses


def read_accesses(address: int, count: int) -> NDArray[np.void]:
    """Return the accesses that read ``count`` bytes from ``address`` on, ASAP."""
    accesses = write_accesses(address, bytes(count))
    accesses["op"][1:] = DATA_READ
    return accesses


def require_acknowledge(accesses: NDArray[np.void]) -> None:
    """Check that a board acknowledged every one of these accesses.

    Raises
    ------
    BusTimeoutError
        If not; names the first one that was not acknowledged, and its address.
    """
    missed = np.flatnonzero(accesses["timeout"])
    if not len(missed):
        return
    first = int(missed[0])
    ops = accesses["op"][: first + 1]
    sent = np.flatnonzero(ops == ADDRESS_WRITE)
    address = f"{int(accesses['value'][sent[-1]]):02X}h" if len(sent) else "an earlier address"
    raise BusTimeoutError(
        f"no board acknowledged {len(missed)} of {len(accesses)} EPP accesses, the first being the "
        f"{_OP_NAMES.get(int(ops[-1]), 'access')} {first} (after address write {address}); check "
        f"power, cable, port mode (EPP) and the board's base address"
    )


class EppBus(Protocol):
    """An IEEE-1284 EPP bus with one or more boards.

    A link inherits from this class, defines the abstract methods, and gets `write` and `read`.
    """

    clock_hz: int  # unit of ``EPP_ACCESS.cycle`` [Hz]
    access_cycles: int  # time one access takes [cycle]
    in_real_time: bool = False  # time is that of the host's clock, and it may be late
    exact: bool = True  # accesses act at the very cycles they ask for, if the host is not late

    @abstractmethod
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
        accesses = write_accesses(address, data)
        self.transact(accesses)
        require_acknowledge(accesses)

    def read(self, address: int, count: int) -> bytes:
        """Read ``count`` bytes from ``address`` on, by auto-increment.

        Raises
        ------
        BusTimeoutError
            If no board acknowledges.
        """
        accesses = read_accesses(address, count)
        self.transact(accesses)
        require_acknowledge(accesses)
        return bytes(accesses["value"][1:])

    @abstractmethod
    def reset(self) -> None:
        """Pulse nINIT: every board goes to its reset state."""

    @abstractmethod
    def now(self) -> int:
        """Return the cycle at which the next access can act."""

    @abstractmethod
    def close(self) -> None:
        """Release the link; a second call does nothing."""
