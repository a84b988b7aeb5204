"""How motors move axes: matrices from axis positions to motor steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from pulsewright.errors import MachineError
from pulsewright.motion.moves import AXES


class Drive(Protocol):
    """What kinematics need to know of one axis."""

    @property
    def motors(self) -> Sequence[int]:
        """Indices of the motors of this axis."""

    @property
    def directions(self) -> Sequence[int]:
        """Which way each of them turns while the axis goes forward, 1 or -1."""

    @property
    def steps_per_unit(self) -> Fraction:
        """Steps of each of them per millimetre or degree."""


class Cartesian:
    """Each motor moves one axis; an axis with two motors is a gantry."""

    def matrix(self, axes: Mapping[str, Drive]) -> NDArray[np.float64]:
        """Return the steps of each motor per mm or degree of each axis, shape (motors, 6)."""
        matrix = np.zeros((sum(len(axis.motors) for axis in axes.values()), len(AXES)))
        for letter, axis in axes.items():
            scale = float(axis.steps_per_unit)
            matrix[list(axis.motors), AXES.index(letter)] = scale * np.array(axis.directions)
        return matrix


class CoreXY(Cartesian):
    """Two motors share one belt: X's motor turns with X + Y, Y's motor with X - Y."""

    def matrix(self, axes: Mapping[str, Drive]) -> NDArray[np.float64]:
        """Return the steps of each motor per mm or degree of each axis, shape (motors, 6).

        Raises
        ------
        MachineError
            If X or Y is missing or has more than one motor.
        """
        for letter in "XY":
            if letter not in axes or len(axes[letter].motors) != 1:
                raise MachineError(
                    f"corexy needs axes X and Y with one motor each; see axis.{letter}",
                    key="kinematics.type",
                )
        matrix = super().matrix(axes)
        (a,), (b,) = axes["X"].motors, axes["Y"].motors
        matrix[a, 1] = matrix[a, 0]
        matrix[b, 0], matrix[b, 1] = matrix[b, 1], -matrix[b, 1]
        return matrix


KINEMATICS: Final[dict[str, Cartesian]] = {"cartesian": Cartesian(), "corexy": CoreXY()}
