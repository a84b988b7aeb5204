"""Geometry of G2 and G3 in their plane. Lengths in mm, angles in radians."""

from __future__ import annotations

import math
from typing import Final

Point = tuple[float, float]

RESOLUTION: Final = 1e-9  # [mm]; what is shorter is rounding, not motion
RELATIVE_TOLERANCE: Final = 1e-3  # of the larger radius
CAP: Final = 100  # times the absolute tolerance: no arc may be off by more, however large


def center_from_radius(
    start: Point, end: Point, radius: float, *, clockwise: bool, tolerance: float
) -> Point:
    """Return the centre of an arc given by its radius.

    Parameters
    ----------
    start, end : (2,) float
        Different points.
    radius : float
        Not 0; negative for the arc of more than half a turn.
    clockwise : bool
        G2.
    tolerance : float
        How much the radius may fall short of half the chord; then that is taken.

    Raises
    ------
    ValueError
        If the radius does not reach.
    """
    half = math.dist(start, end) / 2
    if half - abs(radius) > tolerance:
        raise ValueError(
            f"an arc of radius {abs(radius):g} does not reach its end, {2 * half:g} away; "
            f"the radius must be {half:g} or more"
        )
    rise = math.sqrt(max(radius * radius - half * half, 0.0))
    # The centre of a short counterclockwise arc is to the left of the chord.
    if clockwise != (radius < 0):
        rise = -rise
    ux, uy = (end[0] - start[0]) / (2 * half), (end[1] - start[1]) / (2 * half)
    return (start[0] + end[0]) / 2 - rise * uy, (start[1] + end[1]) / 2 + rise * ux


def check_radii(start: Point, end: Point, center: Point, tolerance: float) -> None:
    """Check that a centre fits its end points.

    The radii may differ by ``tolerance``, or by 0.1 % where that is more, at most by 100 times
    ``tolerance``.

    Raises
    ------
    ValueError
        If they differ more, or one of them is 0.
    """
    first, last = math.dist(start, center), math.dist(end, center)
    if min(first, last) <= RESOLUTION:
        raise ValueError(f"the radius of the arc is {first:g} at its start and {last:g} at its end")
    allowed = min(max(tolerance, RELATIVE_TOLERANCE * max(first, last)), CAP * tolerance)
    if abs(first - last) > allowed:
        raise ValueError(
            f"the radius of the arc is {first:.6g} at its start and {last:.6g} at its end; "
            f"they may differ by {allowed:.3g}; check I, J, K and their mode (G90.1, G91.1)"
        )


def sweep(start: Point, end: Point, center: Point, *, clockwise: bool, turns: int = 1) -> float:
    """Return the signed angle from start to end, positive counterclockwise.

    Equal end points make a full turn; ``turns`` above 1 adds full turns.
    """
    if math.dist(start, end) <= RESOLUTION:  # rounding may put the end before or behind the start
        angle = math.tau
    else:
        a = math.atan2(start[1] - center[1], start[0] - center[0])
        b = math.atan2(end[1] - center[1], end[0] - center[0])
        angle = (a - b if clockwise else b - a) % math.tau
    angle += math.tau * (turns - 1)
    return -angle if clockwise else angle
