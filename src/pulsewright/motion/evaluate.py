"""Compiled evaluation of a trajectory, for loops that ask millions of times."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import compiled, inner

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


@inner
def piece_at(start: Floats, t: float) -> int:
    """Return the piece that holds time ``t``; the first before all, the last after them.

    ``start`` is (pieces + 1,).
    """
    low, high = 0, start.size - 2
    while low < high:
        middle = (low + high + 1) // 2
        if t < start[middle]:
            high = middle - 1
        else:
            low = middle
    return low


@inner
def rests_at(
    geometry: tuple[Floats, Floats, Floats, Floats],
    law: tuple[NDArray[np.int32], Floats, Floats],
    axis: int,
    begin: float,
    end: float,
) -> float:
    """Return where a coordinate stays between two times [s], or NaN if it changes.

    Other arguments as those of `sample`.
    """
    poly, cosine, sine, _ = geometry
    element, start, _ = law
    first = element[piece_at(start, begin)]
    place: float = poly[first, 0, axis]
    for e in range(first, element[piece_at(start, end)] + 1):
        moves = poly[e, 1, axis] != 0.0 or poly[e, 2, axis] != 0.0 or poly[e, 3, axis] != 0.0
        if moves or poly[e, 0, axis] != place or cosine[e, axis] != 0.0 or sine[e, axis] != 0.0:
            return math.nan
    return place


@inner
def sample(
    geometry: tuple[Floats, Floats, Floats, Floats],
    law: tuple[NDArray[np.int32], Floats, Floats],
    axis: int,
    first: int,
    step: int,
    unit: float,
    out: Floats,
) -> None:
    """Put where a trajectory is at the times (``first`` + n ``step``) ``unit`` into ``out``.

    That has a column per time, and rows for the path coordinate and for as many coordinates from
    ``axis`` on as there are rows left. ``geometry`` is (poly, cosine, sine, omega) and ``law`` is
    (element, start, law) of a `Trajectory`, which is at rest before and after.
    """
    poly, cosine, sine, omega = geometry
    element, start, time_law = law
    pieces, end, count = element.size, start[element.size], out.shape[1]
    for n in range(count):  # times first: the compiler makes several at once
        out[0, n] = min(max((first + n * step) * unit, 0.0), end)
    k, n = piece_at(start, first * unit), 0
    while n < count:
        since, until = start[k], start[k + 1] if k + 1 < pieces else math.inf
        # coefficients are read once: for all the compiler knows, what is written may be them
        l0, l1, l2, l3 = time_law[k, 0], time_law[k, 1], time_law[k, 2], time_law[k, 3]
        e, begin = element[k], n
        p0, p1, p2, p3 = poly[e, 0, axis], poly[e, 1, axis], poly[e, 2, axis], poly[e, 3, axis]
        while n < count and out[0, n] < until:
            tau = out[0, n] - since
            s = ((l3 * tau + l2) * tau + l1) * tau + l0
            out[0, n], out[1, n] = s, ((p3 * s + p2) * s + p1) * s + p0
            n += 1
        for row in range(2, out.shape[0]):
            i = axis + row - 1
            p0, p1, p2, p3 = poly[e, 0, i], poly[e, 1, i], poly[e, 2, i], poly[e, 3, i]
            for m in range(begin, n):
                s = out[0, m]
                out[row, m] = ((p3 * s + p2) * s + p1) * s + p0
        if omega[e] != 0.0:
            for m in range(begin, n):
                angle = omega[e] * out[0, m]
                c, d = math.cos(angle), math.sin(angle)
                for row in range(1, out.shape[0]):
                    i = axis + row - 1
                    out[row, m] += cosine[e, i] * c + sine[e, i] * d
        k += 1
