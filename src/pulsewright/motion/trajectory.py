"""Where the machine is at every instant: exact geometry, and an exact law of time along it.

A trajectory is a chain of *elements* (geometry, a function of a path coordinate s) and a chain of
*pieces* (time law, a cubic s(t) on one element). Position at time t is the element's geometry at
s(t); nothing is sampled. On element e::

    x(s) = poly[e,0] + poly[e,1] s + poly[e,2] s^2 + poly[e,3] s^3
         + cosine[e] cos(omega[e] s) + sine[e] sin(omega[e] s)        0 <= s <= length[e]

so a line has ``poly`` of degree 1, a blend of degree 3, an arc or helix degree 1 with ``omega`` =
1 / radius, and a blend on it degree 3 besides. On piece k, from ``start[k]`` to ``start[k + 1]``,
tau = t - start[k]::

    s(tau) = law[k,0] + law[k,1] tau + law[k,2] tau^2 + law[k,3] tau^3
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from pulsewright.errors import UsageError


@dataclass(frozen=True)
class Trajectory:
    """Exact motion of some coordinates: machine axes [mm, degrees] or motors [step].

    Parameters
    ----------
    poly : (m, 4, axes) float64
    cosine, sine : (m, axes) float64
    omega, length : (m,) float64
        Geometry of m elements, see the module's text.
    move : (m,) int32
        The move that an element belongs to; a blend has elements on both sides of its corner.
    element : (k,) int32
        Element of each piece, never decreasing.
    start : (k + 1,) float64
        Start time of each piece, and the end of the last one [s]. The first is 0.
    law : (k, 4) float64
        Path coordinate over time since the start of the piece. Standstill has ``law[1:] = 0``.
    """

    poly: NDArray[np.float64]
    cosine: NDArray[np.float64]
    sine: NDArray[np.float64]
    omega: NDArray[np.float64]
    length: NDArray[np.float64]
    move: NDArray[np.int32]
    element: NDArray[np.int32]
    start: NDArray[np.float64]
    law: NDArray[np.float64]

    def require_sound(self, begin: float | None = 0.0) -> None:
        """Check shapes and values, as programs that make trajectories by themselves may err.

        Limits and continuity are not looked at; see `certify`. The first ``start`` has to be
        ``begin``, or with None any time that is not negative.

        Raises
        ------
        UsageError
            If a column has another shape than said above, a value is not finite, a piece has no
            element, or time runs back; the message names the first such entry.
        """
        m, k, axes = len(self.length), len(self.element), self.axes
        shapes = [(m, 4, axes), (m, axes), (m, axes), (m,), (m,), (m,), (k,), (k + 1,), (k, 4)]
        for field, shape in zip(fields(Trajectory), shapes, strict=True):
            column = getattr(self, field.name)
            if column.shape != shape:
                raise UsageError(
                    f"trajectory.{field.name} has the shape {column.shape}; with {m} elements and "
                    f"{k} pieces it must be {shape}"
                )
            with np.errstate(invalid="ignore", over="ignore"):
                finite = np.isfinite(column.sum())  # without looking at each, and no memory
            if not finite and not np.isfinite(column).all():
                at = tuple(np.argwhere(~np.isfinite(column))[0].tolist())
                raise UsageError(
                    f"trajectory.{field.name}{list(at)} is {column[at]}; it must be finite"
                )
        early = np.diff(self.start, prepend=0.0) < 0
        early[0] |= begin is not None and self.start[0] != begin
        other = (np.diff(self.element, prepend=0) < 0) | (self.element >= m)
        for name, wrong, rule in [
            ("element", other, f"from 0 to {m - 1}, never decreasing"),
            ("start", early, "0 and then never decreasing"),
        ]:
            if wrong.any():
                n = int(np.argmax(wrong))
                raise UsageError(
                    f"trajectory.{name}[{n}] is {getattr(self, name)[n]}; they must be {rule}"
                )

    @property
    def duration(self) -> float:
        """Time from start to rest [s]."""
        return float(self.start[-1])

    @property
    def axes(self) -> int:
        """Number of coordinates."""
        return int(self.poly.shape[2])

    def mapped(self, matrix: NDArray[np.float64]) -> Trajectory:
        """Return the same motion in other coordinates: ``matrix`` (new, axes) times position.

        With rows of steps per unit this gives motor positions in steps.
        """
        return replace(
            self,
            poly=_product(self.poly, matrix),
            cosine=_product(self.cosine, matrix),
            sine=_product(self.sine, matrix),
        )

    def timed(
        self,
        element: NDArray[np.int32],
        start: NDArray[np.float64],
        law: NDArray[np.float64],
        here: slice = slice(None),
    ) -> Trajectory:
        """Return the same path with other pieces; of the path the elements ``here`` only."""
        poly, cosine, sine = self.poly[here], self.cosine[here], self.sine[here]
        rest = self.omega[here], self.length[here], self.move[here]
        return Trajectory(poly, cosine, sine, *rest, element, start, law)

    def between(self, begin: float, end: float) -> Trajectory:
        """Return a trajectory that is the same from ``begin`` to ``end`` [s]: this one."""
        return self

    def part(self, begin: int, end: int) -> Trajectory:
        """Return the pieces from ``begin`` to before ``end``, at their times, and their elements.

        So ``start`` begins where the first of them does. Arrays are views, where they can be.
        """
        first, last = int(self.element[begin]), int(self.element[end - 1]) + 1
        element, start = self.element[begin:end] - np.int32(first), self.start[begin : end + 1]
        return self.timed(element, start, self.law[begin:end], slice(first, last))

    def piece(self, time: NDArray[np.float64] | float) -> NDArray[np.int64]:
        """Return the piece at each time; before 0 the first one, after the end the last one."""
        found = np.searchsorted(self.start, time, side="right") - 1
        return np.asarray(np.clip(found, 0, len(self.element) - 1))

    def at(
        self,
        time: NDArray[np.float64] | float,
        derivative: int = 0,
        matrix: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Return position (0), velocity (1), acceleration (2) or jerk (3) at times, (n, axes).

        Before 0 and after the end the machine rests. With a ``matrix``, in other coordinates: as
        `mapped` by it, but only what is looked at.
        """
        t = np.clip(np.atleast_1d(np.asarray(time, float)), 0.0, self.duration)
        k = self.piece(t)
        tau, law, e = t - self.start[k], self.law[k], self.element[k]
        s = ((law[:, 3] * tau + law[:, 2]) * tau + law[:, 1]) * tau + law[:, 0]
        v = (3 * law[:, 3] * tau + 2 * law[:, 2]) * tau + law[:, 1]
        a = 6 * law[:, 3] * tau + 2 * law[:, 2]
        s, v, a, w = s[:, None], v[:, None], a[:, None], self.omega[e][:, None]
        p, cos, sin = self.poly[e], self.cosine[e], self.sine[e]
        if matrix is not None:
            p, cos, sin = (_product(part, matrix) for part in (p, cos, sin))
        if derivative == 0:
            x = ((p[:, 3] * s + p[:, 2]) * s + p[:, 1]) * s + p[:, 0]
            return np.asarray(x + cos * np.cos(w * s) + sin * np.sin(w * s))
        first = (3 * p[:, 3] * s + 2 * p[:, 2]) * s + p[:, 1]
        first = first + w * (sin * np.cos(w * s) - cos * np.sin(w * s))
        if derivative == 1:
            return np.asarray(first * v)
        second = 6 * p[:, 3] * s + 2 * p[:, 2]
        second = second - w * w * (cos * np.cos(w * s) + sin * np.sin(w * s))
        if derivative == 2:
            return np.asarray(second * v * v + first * a)
        third = 6 * p[:, 3] + w**3 * (cos * np.sin(w * s) - sin * np.cos(w * s))
        j = 6 * law[:, 3, None]
        return np.asarray(third * v**3 + 3 * second * v * a + first * j)


def _product(values: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``values @ matrix.T``, where few entries of ``matrix`` are not 0.

    Numpy's own product of large matrices leaves the other processors busy waiting for a while.
    """
    found = np.empty((*values.shape[:-1], len(matrix)))
    for row, factors in enumerate(matrix):
        first, *others = np.flatnonzero(factors).tolist() or [0]
        np.multiply(values[..., first], factors[first], out=found[..., row])
        for column in others:
            found[..., row] += values[..., column] * factors[column]
    return found
