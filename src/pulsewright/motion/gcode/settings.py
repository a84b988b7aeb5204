"""What a program takes from the machine."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from pulsewright.errors import UsageError
from pulsewright.motion.gcode.offsets import ZERO
from pulsewright.motion.gcode.tools import Tool
from pulsewright.motion.moves import AXES

SYSTEMS: Final = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")
FARTHEST: Final = 1e9  # [length units, degrees] where an axis may go


@dataclass(frozen=True)
class InterpreterSettings:
    """What a program takes from the machine.

    Parameters
    ----------
    axes : str
        Axes that the machine has, of "XYZABC".
    wrapped : str
        Those of A, B and C for which absolute words say where within a turn to go, from 0 to below
        360 degrees, and by their sign, -0 included, which way round.
    start : (6,) floats
        Machine position before the first move [mm, degrees].
    work_offsets : mapping of str to (6,) floats
        Origins of "G54" to "G59.3" in machine coordinates [mm, degrees]; 0 where not given.
    tools : mapping of int to float or Tool, or None
        Tools by number: their table entries, or lengths along Z alone [mm]. None: the machine has
        no tool table, all lengths are 0.
    home, second_home : (6,) floats
        Machine positions for G28 and G30 until the program stores others [mm, degrees].
    path_tolerance : float
        How far the path may pass from a programmed corner in G64 without P [mm], above 0.
    exact_tolerance : float
        How far it may pass in G61 [mm], 0 or more: some fraction of a step.
    block_delete : bool
        Skip lines that begin with ``/``.
    unit : float
        Length unit of the machine [mm]: that of the parameters for offsets and positions.
    parameters : mapping of int to float
        Numbered parameters before the program starts, as a parameter file holds them; where given,
        those of offsets and homes go before ``work_offsets`` and the homes.
    subroutines : sequence of str
        Folders with files of subroutines, ``NAME.ngc``, searched in turn after that of the program.
    max_depth : int
        Subroutine calls within each other, at least 1.
    max_lines : int
        Lines that a program may carry out, each as often as loops come by.
    """

    axes: str = "XYZ"
    wrapped: str = ""
    start: Sequence[float] = ZERO
    work_offsets: Mapping[str, Sequence[float]] = field(default_factory=dict)
    tools: Mapping[int, float | Tool] | None = None
    home: Sequence[float] = ZERO
    second_home: Sequence[float] = ZERO
    path_tolerance: float = 0.05
    exact_tolerance: float = 0.001
    block_delete: bool = False
    unit: float = 1.0
    parameters: Mapping[int, float] = field(default_factory=dict)
    subroutines: Sequence[str] = ()
    max_depth: int = 100
    max_lines: int = 20_000_000

    def __post_init__(self) -> None:
        if not self.axes or set(self.axes) - set(AXES) or len(set(self.axes)) < len(self.axes):
            raise UsageError(f"axes must be different letters of {AXES}, not '{self.axes}'")
        if unfit := set(self.wrapped) - (set(self.axes) & set("ABC")):
            raise UsageError(
                f"wrapped must name rotary axes of the machine, not {', '.join(sorted(unfit))}"
            )
        if unknown := set(self.work_offsets) - set(SYSTEMS):
            raise UsageError(
                f"unknown work offset {', '.join(sorted(unknown))}; there are {', '.join(SYSTEMS)}"
            )
        positions = {"start": self.start, "home": self.home, "second_home": self.second_home}
        for name, position in {**positions, **self.work_offsets}.items():
            if len(position) != len(AXES) or not all(map(math.isfinite, position)):
                raise UsageError(
                    f"{name} must be {len(AXES)} finite numbers, one for each of {AXES}"
                )
        if not self.path_tolerance > 0:
            raise UsageError(f"path_tolerance must be above 0 mm, not {self.path_tolerance:g}")
        if not self.exact_tolerance >= 0:
            raise UsageError(f"exact_tolerance must be 0 mm or more, not {self.exact_tolerance:g}")
        if self.max_depth < 1 or self.max_lines < 1:
            raise UsageError("max_depth and max_lines must be 1 or more")
