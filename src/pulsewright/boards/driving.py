"""What drivers have in common, whatever the board."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, ClassVar, Generic, Protocol, Self, TypeVar

from pulsewright.errors import PositionUnknownError, PulsewrightError, UsageError
from pulsewright.transport.bus import EppBus
from pulsewright.transport.serial_bus import SerialBus
from pulsewright.transport.spi_bus import SpiBus

if TYPE_CHECKING:
    from pulsewright.registers.model import Register, RegisterMap

B = TypeVar("B", EppBus, SerialBus, SpiBus)


@dataclass(frozen=True)
class Stop:
    """Where a plan that was left has come to rest.

    Parameters
    ----------
    time : float
        When the plan is there [s].
    position : tuple of int
        Step that each motor is at, counted as the plan counts; if the driver's ``position_known``
        says so.
    """

    time: float
    position: tuple[int, ...]


class Playing(Protocol):
    """What a driver needs of a player; see `playing.Player`."""

    def stop(self) -> Stop | None:
        """Leave the plan, and come to rest within the machine's limits."""

    def speed(self) -> float:
        """Return the highest commanded rate of a motor now [step/s]; 0 where it is not known."""


@contextmanager
def _noted(error: BaseException | None, what: str) -> Iterator[None]:
    """Let what fails in a ``with`` block be a note of ``error``, if there is one."""
    try:
        yield
    except PulsewrightError as failed:
        if error is None:
            raise
        error.add_note(f"{what}: {failed}")


class Driver(ABC, Generic[B]):
    """A board on an open bus; as a context manager it leaves the board stopped.

    Attributes
    ----------
    start_stop_rate : float
        Step rate from which the motors can stop at once, and to which they can start, without
        losing a step [step/s]; 0, the default, if it is not known.
    stopped_at : Stop or None
        Where the last plan came to rest that was left before its end.
    """

    registers: ClassVar[RegisterMap]
    bus: B
    start_stop_rate: float = 0.0
    stopped_at: Stop | None = None
    _position_known = True
    _player: Playing | None = None

    @abstractmethod
    def estop(self) -> None:
        """Stop all motion at once, without a ramp; see `position_known`."""

    @property
    def position_known(self) -> bool:
        """Whether the motors are where the commands have led them, for all that is known.

        True at first: the driver takes the machine to be referenced. It becomes False where motors
        that ran faster than `start_stop_rate` stopped at once, which may lose steps: by `estop`
        and the like, an emergency stop of the board, its watchdog, or a link that failed in
        mid-move. No plan is played then until the machine has been referenced; see `reference`.
        Step rates can still be set, for that is how it is done.
        """
        return self._position_known

    def reference(self) -> None:
        """Say that the machine has been referenced: where it stands is known again."""
        self._position_known = True

    def require_position(self) -> None:
        """Check that the position is known.

        Raises
        ------
        PositionUnknownError
            If it is not.
        """
        if not self._position_known:
            raise PositionUnknownError(
                f"{self.registers.board}: the position is unknown, for motors were stopped without "
                f"a ramp or the link failed in mid-move, and steps may be lost; reference the "
                f"machine (switches, stops or by eye), call reference(), and plan from there"
            )

    def lose_position(self) -> None:
        """Note that steps may have been lost."""
        self._position_known = False

    def begin_plan(self, player: Playing) -> None:
        """Note what plays on this board, to be stopped on its ramp when the driver is left."""
        self._player, self.stopped_at = player, None

    def end_plan(self) -> None:
        """Note that no plan moves the motors any more."""
        self._player = None

    def plays(self, player: Playing) -> bool:
        """Tell whether a player's plan is under way."""
        return self._player is player

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
        """Let a plan under way come to rest on its ramp, stop the board, and release the bus.

        With another error on its way, what fails of that becomes a note of it.
        """
        try:
            with _noted(error, "no ramp to rest"):
                if self._player is not None:
                    self._player.stop()
        finally:
            try:
                with _noted(error, "the board could not be told to stop"):
                    self._leave()
            finally:
                self.close()

    def _leave(self) -> None:
        self.estop()

    def _halting(self, rate: float = 0.0) -> None:
        """Note that all motion stops at once.

        Parameters
        ----------
        rate : float
            Fastest of the motors that a player does not know of [step/s].
        """
        if self._player is not None:
            rate = max(rate, self._player.speed())
        if rate > self.start_stop_rate:
            self.lose_position()
        self.end_plan()

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
