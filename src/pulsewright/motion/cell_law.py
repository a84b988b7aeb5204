"""The time law of a cell: two pieces of constant jerk between the states at its ends.

``b`` is the square of the path speed v, ``a`` the path acceleration: ``db/ds = 2 a``. The path is
cut into *cells*: groups of short elements, or parts of long ones. On a cell, the largest magnitudes
of the derivatives of position along each limited row are known, and limits hold if they hold with
all of them at once::

    first v <= velocity
    second b + first |a| <= acceleration
    third v^3 + 3 second v |a| + first |j| <= jerk

With each inequality over its limit, six coefficients remain, the *shares* of a cell: of ``v``, of
``|a|``, of ``|j|``, of ``b``, of ``v |a|``, of ``v^3``.

What a planner chooses are ``b`` and ``a`` at the *nodes* between cells. Whatever they are, a time
law with two pieces of constant jerk on every cell has exactly these values at its ends; so the
acceleration is continuous by construction, and limits are checked on the law itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import inlined, inner
from pulsewright.motion.path import Floats, Ints

ROUNDING = 1e-8  # of the limits
BEND_SHARE = 0.97  # of the acceleration, for bending at constant speed
TWIST_SHARE = 0.9  # of the jerk, for bending at constant speed


class Cells(NamedTuple):
    """Stretches of the path with common bounds."""

    element: Ints  # (n,) the first element
    offset: Floats  # (n,) where on it the cell begins
    size: Floats  # (n,); 0 for a rest
    rest: NDArray[np.bool_]  # (n,) whether the machine rests at the end
    row: Ints  # (n,) of ``share``: cells of one line have the same
    share: Floats  # (p, r, 6); that of ``v`` is in the first row, also for the feed
    rows: Ints  # (p,) how many rows of it matter: they come first


class Task(NamedTuple):
    """What speeds are planned from, and what is tightened on the way."""

    cells: Cells
    cap: Floats  # (n,) largest b on a cell
    ease: Floats  # (n,) share of it and of the acceleration
    soft: Floats  # (n,) share of the jerk
    ramp: Floats  # (n,) path acceleration left
    jerk: Floats  # (n,) path jerk left
    split: Floats  # (n,) of a cell's time, for the first of its two pieces
    node: Ints  # (n + 1,) scratch
    work: Floats  # (6, n + 8) scratch


@inner
def cap_of(share: Floats, rows: int) -> float:
    """Return the largest square of the speed on a cell."""
    bend, twist = 0.0, 0.0
    for r in range(rows):
        bend, twist = max(bend, share[r, 3]), max(twist, share[r, 5])
    return top_square(share[0, 0], bend, twist)


@inner
def top_square(slow: float, bend: float, twist: float) -> float:
    """Return the largest square of the speed by the shares of v, of its square and of its cube."""
    top: float = 1.0 / (slow * slow)
    if bend * top > BEND_SHARE:
        top = BEND_SHARE / bend
    if twist * top * math.sqrt(top) > TWIST_SHARE:
        top = (TWIST_SHARE / twist) ** (2 / 3)
    return top


@inner
def is_bent(cells: Cells, c: int) -> bool:
    """Return whether a cell is not on a line."""
    row = cells.row[c]
    share = cells.share[row]
    bent: bool = cells.rows[row] > 1 or share[0, 3] > 0.0 or share[0, 5] > 0.0
    return bent


@inner
def two_pieces(
    v0: float, v1: float, a0: float, a1: float, size: float, split: float
) -> tuple[float, float, float, float]:
    """Return the time of a cell, and acceleration and speed where its two pieces meet.

    The first of them, each of constant jerk, lasts ``split`` of that time. The time is negative if
    there is no solution. The last number is the root that its derivatives are divided by.
    """
    rest = 1.0 - split
    linear = (v0 * (1.0 + split) + v1 * (1.0 + rest)) * (1 / 3)
    root = linear * linear + (split * a0 - rest * a1) * (2 / 3) * size
    if not root > 0.0:
        return -1.0, 0.0, 0.0, 0.0
    root = math.sqrt(root)
    time = 2.0 * size / (linear + root)
    middle = 2.0 * (v1 - v0) / time - (split * a0 + rest * a1)
    return time, middle, v0 + 0.5 * split * time * (a0 + middle), root


@inlined
def extremes(
    v0: float, vm: float, v1: float, a0: float, am: float, a1: float, t0: float, t1: float
) -> tuple[float, float]:
    """Return the largest speed in two pieces of constant jerk, and the smallest but for the ends.

    Speeds and accelerations are those at the ends of the pieces, which last ``t0`` and ``t1``.
    """
    top, low = max(v0, v1, vm), vm
    if a0 * am < 0.0:  # an extreme inside the first piece
        inside = v0 + 0.5 * a0 * t0 * a0 / (a0 - am)
        top, low = max(top, inside), min(low, inside)
    if am * a1 < 0.0:
        inside = vm + 0.5 * am * t1 * am / (am - a1)
        top, low = max(top, inside), min(low, inside)
    return top, low


@inner
def limits_used(
    cells: Cells, c: int, v0: float, v1: float, a0: float, a1: float, split: float
) -> tuple[float, float, float, float]:
    """Return the time of cell ``c``, and the used shares of velocity, acceleration and jerk."""
    row = cells.row[c]
    return _use(cells.share, row, cells.rows[row], cells.size[c], v0, v1, a0, a1, split)


@inner
def _use(
    share: Floats,
    row: int,
    rows: int,
    size: float,
    v0: float,
    v1: float,
    a0: float,
    a1: float,
    split: float,
) -> tuple[float, float, float, float]:
    """Return the time of a cell, and the used shares of velocity, acceleration and jerk.

    Arguments are few, as this is called most.
    """
    time, am, vm, _ = two_pieces(v0, v1, a0, a1, size, split)
    if time < 0.0:
        return time, 1.0, 1.0, 8.0
    top, low = extremes(v0, vm, v1, a0, am, a1, split * time, (1.0 - split) * time)
    if low < 0.0:  # back and forth
        return -1.0, 1.0, 1.0, 8.0
    rate = max(abs(a0), abs(a1), abs(am))
    most = max(abs(am - a0) * (1.0 - split), abs(a1 - am) * split)
    j = most / (split * (1.0 - split) * time)
    velocity, acceleration, jerk = share[row, 0, 0] * top, 0.0, 0.0
    square, cube, mixed = top * top, top * top * top, top * rate
    for r in range(rows):
        acceleration = max(acceleration, share[row, r, 3] * square + share[row, r, 1] * rate)
        used = share[row, r, 5] * cube + share[row, r, 4] * mixed + share[row, r, 2] * j
        jerk = max(jerk, used)
    return time, velocity, acceleration, jerk


@inner
def keeps_limits(cells: Cells, b: Floats, a: Floats, c: int, split: float) -> bool:
    """Return whether the law of a cell keeps the limits."""
    v0, v1 = math.sqrt(b[c]), math.sqrt(b[c + 1])
    _, v, s, j = limits_used(cells, c, v0, v1, a[c], a[c + 1], split)
    return max(v, s, j) <= 1.0 + ROUNDING
