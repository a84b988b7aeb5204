"""What a room offers to the floors above it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from pulsewright.errors import UsageError
from pulsewright.registers.model import RegisterMap

if TYPE_CHECKING:
    from pulsewright.boards.golden import Recordings


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
    profiles : tuple of str
        Ways to resolve the contradictions of the document.
    default_profile : str
        One of ``profiles``.
    axes : int
        Motors that one board can drive at most.
    registers : callable
        ``registers()`` returns the `RegisterMap`.
    twin : callable
        ``twin(profile, **options)`` returns a new twin, in its reset state; options are profile
        switches, ``parameters``, and what else the room's twin knows.
    rtl : callable
        ``rtl(profile, **options)`` returns the board's gateware in simulation, with the methods of
        its twin that a bus uses.
    gateware : callable
        ``gateware(profile, axes, **switches)`` returns the board's gateware, a `Component`; with
        just ``axes`` axes (None: as many as the original), where the room can leave out some.
    driver : callable
        ``driver(bus, profile, **options)`` returns a driver for a board on an open bus.
    player : callable
        ``player(driver, trajectory, drives)`` returns what plays planned motion on the board, with
        `Drives` that tell what the motors allow.
    sizes : mapping of str to mapping of str to int
        For FPGA families that are too small for all of a board: parameters of ``gateware`` with
        which it fits.
    positive_direction : int
        Level of the direction pins while a motor's position rises (0 or 1).
    motor_pins : (str, str)
        Names of step and direction pins, with ``{}`` for the number of the motor.
    bus : str
        What driver and twin meet at: ``epp``, ``serial`` or ``spi``.
    digital_outputs : bool
        Whether it has outputs that a driver can switch, by ``write_output(number, level)``.
    parameters : frozenset of str
        What a board can be made with besides profile switches: options of ``twin``, ``rtl`` and
        ``driver``.
    choices : mapping of str to tuple of str
        Of parameters whose values have names, those of 0, 1 and so on; see `numbers`.
    parameters_for : callable
        ``parameters_for(motors)`` returns those of a board that can drive so many motors.
    recordings : callable, optional
        ``recordings()`` returns what reads and replays recordings of the original controller.
    """

    name: str
    title: str
    document: str
    profiles: tuple[str, ...]
    default_profile: str
    axes: int
    registers: Callable[[], RegisterMap]
    twin: Callable[..., Any]
    rtl: Callable[..., Any]
    gateware: Callable[..., Any]
    driver: Callable[..., Any]
    player: Callable[..., Any]
    positive_direction: int = 1
    motor_pins: tuple[str, str] = ("step{}", "dir{}")
    bus: Literal["epp", "serial", "spi"] = "epp"
    parameters: frozenset[str] = frozenset()
    choices: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    parameters_for: Callable[[int], dict[str, int]] = lambda motors: {}
    digital_outputs: bool = True
    sizes: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    recordings: Callable[[], Recordings[Any]] | None = None

    def numbers(self, options: Mapping[str, int | str]) -> dict[str, int]:
        """Return switches and parameters with numbers in the place of names.

        Raises
        ------
        UsageError
            If there is no such name.
        """
        found: dict[str, int] = {}
        for name, value in options.items():
            if isinstance(value, str):
                choices = self.choices.get(name, ())
                if value not in choices:
                    known = f"there are {' and '.join(choices)}" if choices else "it is a number"
                    raise UsageError(f"{self.name}: no {name} '{value}'; {known}")
                found[name] = choices.index(value)
            else:
                found[name] = value
        return found

    def switches(self, profile: str | None = None, **changes: int) -> dict[str, int]:
        """Return the switches of a profile (None: the default one), with ``changes`` made.

        ``changes`` may have `parameters` among them, which are no switches.

        Raises
        ------
        UsageError
            If the profile or a switch is unknown, or a value is not allowed.
        """
        return resolve_switches(
            self.registers(),
            self.default_profile if profile is None else profile,
            {name: value for name, value in changes.items() if name not in self.parameters},
        )


def resolve_switches(
    registers: RegisterMap, profile: str, changes: Mapping[str, int]
) -> dict[str, int]:
    """Return the switches of a profile, with ``changes`` made.

    Raises
    ------
    UsageError
        If the profile or a switch is unknown, or a value is not allowed.
    """
    board = registers.board
    if profile not in registers.profiles:
        raise UsageError(
            f"{board} has no profile '{profile}'; it has {', '.join(registers.profiles)}"
        )
    column = registers.profiles.index(profile)
    switches = {switch.name: switch.values[column] for switch in registers.switches}
    unknown = changes.keys() - switches.keys()
    if unknown:
        raise UsageError(
            f"{board} has no profile switch '{min(unknown)}'; it has {', '.join(switches)}"
        )
    switches |= changes
    for switch in registers.switches:
        if not switch.minimum <= switches[switch.name] <= switch.maximum:
            raise UsageError(
                f"{board}: profile switch {switch.name} = {switches[switch.name]} asked, allowed "
                f"are {switch.allowed}"
            )
    return switches
