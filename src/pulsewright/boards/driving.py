"""What drivers have in common, whatever the board."""

from __future__ import annotations

from abc import ABC, abstractmethod
from types import TracebackType
from typing import TYPE_CHECKING, ClassVar, Generic, Self, TypeVar

from pulsewright.errors import UsageError
from pulsewright.transport.bus import EppBus
from pulsewright.transport.serial_bus import SerialBus
from pulsewright.transport.spi_bus import SpiBus

if TYPE_CHECKING:
    from pulsewright.registers.model import Register, RegisterMap

B = TypeVar("B", EppBus, SerialBus, SpiBus)


class Driver(ABC, Generic[B]):
    """A board on an open bus; as a context manager it leaves the board stopped."""

    registers: ClassVar[RegisterMap]
    bus: B

    @abstractmethod
    def estop(self) -> None:
        """Stop all motion at once."""

    def close(self) -> None:
        """Release the bus; the board goes on as it is."""
        self.bus.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop the board as `estop` does, and release the bus."""
        try:
            self._leave()
        finally:
            self.close()

    def _leave(self) -> None:
        self.estop()

    def _register(self, side: str, name: str, instance: int) -> tuple[Register, int]:
        """Return a register of a side by its name, and the address of one instance of it.

        Raises
        ------
        UsageError
            If there is none.
        """
        register = self.registers[name]
        if register.side != side:
            raise UsageError(
                f"{self.registers.board} register {name} is on the {register.side} side of the map"
            )
        self._require(f"{name} instance", instance, len(register.addresses))
        return register, register.addresses[instance]

    def _require(self, what: str, number: int, count: int) -> None:
        """Check that there is a ``what`` of that number.

        Raises
        ------
        UsageError
            If not.
        """
        if not 0 <= number < count:
            raise UsageError(
                f"{self.registers.board} has no {what} {number}; allowed are 0..{count - 1}"
            )
