"""What a room offers to the floors above it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pulsewright.errors import UsageError
from pulsewright.registers.model import RegisterMap


@dataclass(frozen=True)
class Board:
    """One board. Its parts are imported when they are first asked for, so listing boards is cheap.

    Parameters
    ----------
    name : str
        Of the room and of the register map: ``usc``.
    title : str
        Name for people.
    document : str
        The published document that describes the board.
    profiles : mapping of str to mapping of str to int
        Values of the profile switches, by profile.
    default_profile : str
        One of ``profiles``.
    registers : callable
        ``registers()`` returns the `RegisterMap`.
    twin : callable
        ``twin(profile, **switches)`` returns a new twin, in its reset state.
    driver : callable
        ``driver(bus, profile, **switches)`` returns a driver for a board on an open bus.
    """

    name: str
    title: str
    document: str
    profiles: Mapping[str, Mapping[str, int]]
    default_profile: str
    registers: Callable[[], RegisterMap]
    twin: Callable[..., Any]
    driver: Callable[..., Any]

    def switches(self, profile: str | None = None, **changes: int) -> dict[str, int]:
        """Return the switches of a profile (None: the default one), with ``changes`` made.

        Raises
        ------
        UsageError
            If the profile or a switch is unknown, or a value is not allowed.
        """
        profile = self.default_profile if profile is None else profile
        if profile not in self.profiles:
            raise UsageError(
                f"{self.name} has no profile '{profile}'; it has {', '.join(self.profiles)}"
            )
        chosen = dict(self.profiles[profile])
        for name, value in changes.items():
            if name not in chosen:
                raise UsageError(
                    f"{self.name} has no profile switch '{name}'; it has {', '.join(chosen)}"
                )
            chosen[name] = value
        if changes:
            for switch in self.registers().switches:
                value = chosen[switch.name]
                if not switch.minimum <= value <= switch.maximum:
                    raise UsageError(
                        f"{self.name} profile switch {switch.name} = {value}: allowed are "
                        f"{switch.allowed}"
                    )
        return chosen
