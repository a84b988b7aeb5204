"""The frame of program coordinates: units, work offset, rotation, G92 shift and tool offset."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

ZERO: Final = (0.0,) * 6


@dataclass(frozen=True)
class Frame:
    """Where program coordinates stand in machine coordinates.

    Parameters
    ----------
    scale : float
        Length unit [mm].
    work, shift, tool : (6,) floats
        Origin of the coordinate system, shift by G92 or G52 within it, tool offset [mm, degrees].
    rotation : float
        Of the coordinate system about Z [degrees].
    """

    scale: float = 1.0
    work: Sequence[float] = ZERO
    shift: Sequence[float] = ZERO
    tool: Sequence[float] = ZERO
    rotation: float = 0.0

    @cached_property
    def turn(self) -> tuple[float, float]:
        """Cosine and sine of the rotation."""
        # Quarter turns are exact.
        quarters, rest = divmod(self.rotation, 90.0)
        if rest == 0.0:
            return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarters) % 4]
        angle = math.radians(self.rotation)
        return math.cos(angle), math.sin(angle)

    def to_machine(self, position: Sequence[float]) -> list[float]:
        """Return machine coordinates [mm, degrees] of program coordinates."""
        s, shift, work, tool = self.scale, self.shift, self.work, self.tool
        x, y = position[0] * s + shift[0], position[1] * s + shift[1]
        if self.rotation:
            c, n = self.turn
            x, y = x * c - y * n, x * n + y * c
        return [
            x + (work[0] + tool[0]),
            y + (work[1] + tool[1]),
            position[2] * s + shift[2] + (work[2] + tool[2]),
            *(
                p + q + (w + t)
                for p, q, w, t in zip(position[3:], shift[3:], work[3:], tool[3:], strict=True)
            ),
        ]

    def to_program(self, machine: Sequence[float]) -> list[float]:
        """Return program coordinates of machine coordinates [mm, degrees]."""
        s, shift, work, tool = self.scale, self.shift, self.work, self.tool
        x, y = machine[0] - (work[0] + tool[0]), machine[1] - (work[1] + tool[1])
        if self.rotation:
            c, n = self.turn
            x, y = x * c + y * n, y * c - x * n
        return [
            (x - shift[0]) / s,
            (y - shift[1]) / s,
            (machine[2] - (work[2] + tool[2]) - shift[2]) / s,
            *(
                m - (w + t) - q
                for m, q, w, t in zip(machine[3:], shift[3:], work[3:], tool[3:], strict=True)
            ),
        ]


def _sum(position: float, shift: float, work: float, tool: float) -> float:
    return position + shift + (work + tool)


def _difference(machine: float, shift: float, work: float, tool: float) -> float:
    return machine - (work + tool) - shift
