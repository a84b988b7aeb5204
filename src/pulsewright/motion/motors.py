"""A plan of the machine's axes as that of its motors, without a second copy of the path."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.motion.trajectory import Trajectory

WINDOW: Final = 4096  # pieces of which the motors' path is made at once

Floats = NDArray[np.float64]


class MotorPlan(Trajectory):
    """The trajectory ``plan.mapped(matrix)``, of which only the part in use is in memory.

    That is the part which `between` or `at` was asked for last. ``poly``, ``cosine`` and ``sine``
    are made whole whenever they are asked for.

    Parameters
    ----------
    plan : Trajectory
        Of the machine's axes.
    matrix : (motors, axes) float64
        Steps per unit.
    """

    def __init__(self, plan: Trajectory, matrix: Floats) -> None:
        columns = {name: getattr(plan, name) for name in ("omega", "length", "move")}
        columns |= {name: getattr(plan, name) for name in ("element", "start", "law")}
        for name, value in columns.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "_plan", plan)
        object.__setattr__(self, "_matrix", matrix)
        object.__setattr__(self, "_seen", (math.inf, -math.inf, plan))

    _plan: Trajectory
    _matrix: Floats
    _seen: tuple[float, float, Trajectory]  # the part in use, and from when to when it is right

    @property
    def poly(self) -> Floats:
        """As that of the whole trajectory."""
        return self._whole.poly

    @property
    def cosine(self) -> Floats:
        """As that of the whole trajectory."""
        return self._whole.cosine

    @property
    def sine(self) -> Floats:
        """As that of the whole trajectory."""
        return self._whole.sine

    @property
    def axes(self) -> int:
        """Number of motors."""
        return len(self._matrix)

    @property
    def _whole(self) -> Trajectory:
        return self._plan.mapped(self._matrix)

    def require_sound(self, begin: float | None = 0.0) -> None:
        """Check the plan of the axes; see `Trajectory.require_sound`."""
        self._plan.require_sound(begin)

    def mapped(self, matrix: Floats) -> Trajectory:
        """Return the same motion in other coordinates."""
        return self._whole.mapped(matrix)

    def timed(
        self, element: NDArray[np.int32], start: Floats, law: Floats, here: slice = slice(None)
    ) -> Trajectory:
        """Return the same path with other pieces; see `Trajectory.timed`."""
        return MotorPlan(self._plan.timed(element, start, law, here), self._matrix)

    def part(self, begin: int, end: int) -> Trajectory:
        """Return the pieces from ``begin`` to before ``end``; see `Trajectory.part`."""
        return self._plan.part(begin, end).mapped(self._matrix)

    def between(self, begin: float, end: float) -> Trajectory:
        """Return a trajectory that is the same from ``begin`` to ``end`` [s]."""
        since, until, found = self._seen
        if not since <= begin <= end < until:
            first, pieces = int(self.piece(begin)), len(self.element)
            last = min(int(self.piece(end)) + WINDOW, pieces)
            found = self.part(first, last)
            since = float(self.start[first]) if first > 0 else -math.inf
            until = float(self.start[last]) if last < pieces else math.inf
            object.__setattr__(self, "_seen", (since, until, found))
        return found

    def at(self, time: Floats | float, derivative: int = 0, matrix: Floats | None = None) -> Floats:
        """Return positions or their derivatives at times that are near each other, (n, motors)."""
        near = self.between(float(np.min(time)), float(np.max(time)))
        return near.at(time, derivative, matrix)
