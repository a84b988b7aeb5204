"""Compiled evaluation of a trajectory, for loops that ask millions of times."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import compiled

Floats = NDArray[np.float64]


@compiled(inline="always")
def path_coordinate(law: Floats, k: int, tau: float) -> float:
    """Return s on piece ``k``, ``tau`` seconds after its start."""
    s: float = ((law[k, 3] * tau + law[k, 2]) * tau + law[k, 1]) * tau + law[k, 0]
    return s


@compiled(inline="always")
def coordinate(
    poly: Floats, cosine: Floats, sine: Floats, omega: Floats, e: int, axis: int, s: float
) -> float:
    """Return one coordinate on element ``e`` at path coordinate ``s``."""
    x: float = ((poly[e, 3, axis] * s + poly[e, 2, axis]) * s + poly[e, 1, axis]) * s + poly[
        e, 0, axis
    ]
    if omega[e] != 0.0:
        angle = omega[e] * s
        x += cosine[e, axis] * math.cos(angle) + sine[e, axis] * math.sin(angle)
    return x


@compiled(inline="always")
def piece_at(start: Floats, t: float, k: int) -> int:
    """Return the piece that holds time ``t``, searching forward from piece ``k``.

    ``start`` is (pieces + 1,); times past the end belong to the last piece.
    """
    last = start.size - 2
    while k < last and t >= start[k + 1]:
        k += 1
    return k


@compiled(inline="always")
def position_at(
    geometry: tuple[Floats, Floats, Floats, Floats],
    law: tuple[NDArray[np.int32], Floats, Floats],
    axis: int,
    t: float,
    k: int,
) -> tuple[float, int]:
    """Return one coordinate at time ``t``, and the piece that holds it; at rest before and after.

    ``geometry`` is (poly, cosine, sine, omega) and ``law`` is (element, start, law) of a
    `Trajectory`; ``k`` is a piece at or before ``t``.
    """
    poly, cosine, sine, omega = geometry
    element, start, time_law = law
    t = min(max(t, 0.0), start[-1])
    k = piece_at(start, t, k)
    s = path_coordinate(time_law, k, t - start[k])
    return coordinate(poly, cosine, sine, omega, element[k], axis, s), k
