"""Splines: G5, G5.1, and control points from G5.2 to G5.3."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pulsewright.motion.gcode import calls as c
from pulsewright.motion.gcode.codes import g_name
from pulsewright.motion.gcode.context import Context
from pulsewright.motion.gcode.faults import Fault
from pulsewright.motion.gcode.reader import Block
from pulsewright.motion.gcode.settings import FARTHEST
from pulsewright.motion.moves import Plane

ORDER: Final = 3  # of G5.2 without L
_MOST: Final = 1 << 14  # chords of one span


class SplineCodes(Context):
    """What moves along splines in the XY plane."""

    def _cubic(self, code: int, block: Block) -> None:
        words = block.words
        start, end = self._ends_of_spline(code, block)
        self._need(block, "PQ", "from the end to its control point", "G", code)
        if ("I" in words) != ("J" in words):
            raise block.fault("G5 takes both I and J, or neither", "IJ")
        if "I" in words:
            first = words["I"], words["J"]
        elif self._smooth is not None and self._smooth[1] is self.position:
            first = self._smooth[0]
        else:
            raise block.fault(
                "G5 needs I and J, but for one that follows another G5 straight on", "G", code
            )
        last = words["P"], words["Q"]
        self._spline_feed(
            block, [_beside(start, first), _beside(end, last), (end[0], end[1])], end, 4
        )
        self._smooth = (-last[0], -last[1]), self.position

    def _quadratic(self, code: int, block: Block) -> None:
        start, end = self._ends_of_spline(code, block)
        self._need(block, "IJ", "from the start to the control point", "G", code)
        control = _beside(start, (block.words["I"], block.words["J"]))
        self._spline_feed(block, [control, (end[0], end[1])], end, 3)

    def _control_point(self, code: int, block: Block) -> None:
        words = block.words
        _, end = self._ends_of_spline(code, block)
        weight = words.get("P", 1.0)
        if weight <= 0:
            raise block.fault("P, the weight of a control point, must be above 0", "P")
        named = "X" in words or "Y" in words
        if named and not ("X" in words and "Y" in words):
            raise block.fault("a control point has both X and Y", "XY")
        self._check_goes_on(block)
        if self._control is not None:
            self._need(block, "P", "the weight of the control point", "G", code)
        else:
            self._control, self._weights = [], [1.0 if named else weight]
            self._order = ORDER
        if "L" in words:
            self._order = self._whole(block, "L", 2)
        if named:
            self._control.append((end[0], end[1]))
            self._weights.append(weight)

    def _end_spline(self, code: int, block: Block) -> None:
        self._check_goes_on(block)
        control, self._control = self._control, None
        if control is None:
            raise block.fault("G5.3 ends a spline that G5.2 has begun", "G", code)
        if len(control) + 1 < self._order:
            raise block.fault(
                f"a spline of order {self._order} (L) has at least {self._order} control points, "
                f"with its start; here are {len(control) + 1}",
                "G",
                code,
            )
        end = [*control[-1], *self.position[2:]]
        self._spline_feed(block, control, end, self._order, self._weights)

    def _ends_of_spline(self, code: int, block: Block) -> tuple[list[float], list[float]]:
        """Return where a spline starts and where the axis words point."""
        self._forbid_compensation(block, "G", code)
        self._check_not_leaving(block)
        if self.modal.plane is not Plane.XY:
            raise block.fault(f"{g_name(code)} works in the plane of G17", "G", code)
        if others := set("ZABC") & set(block.words):
            raise block.fault("splines move X and Y alone", others)
        if self.modal.feed_mode == 930:
            raise block.fault("splines do not work with inverse time feed (G93)", "G", code)
        return self.position, self._target(block)

    def _spline_feed(
        self,
        block: Block,
        control: Sequence[tuple[float, float]],
        end: list[float],
        order: int,
        weights: Sequence[float] = (),
    ) -> None:
        """Move along a spline from here by the control points to ``end``."""
        points = ((self.position[0], self.position[1]), *control)
        if not all(max(map(abs, point)) < FARTHEST for point in points):
            raise block.fault(f"a spline of more than {FARTHEST:g} mm", "IJPQXY")
        self._feed_for(block, 0.0)
        self.position = end
        self._emit(c.SplineFeed(points, tuple(weights) or (1.0,) * len(points), order, end))

    def _check_goes_on(self, block: Block) -> None:
        """Check that there was no other motion since a spline began."""
        if self._control is not None and self.modal.motion != 52:
            raise block.fault("there was other motion since G5.2 began this spline", "G")

    def _check_no_spline(self) -> None:
        """Check at the end of the program that no spline is left open."""
        if self._control is not None:
            raise Fault("the program ends between G5.2 and G5.3")


def _beside(point: Sequence[float], offset: tuple[float, float]) -> tuple[float, float]:
    return point[0] + offset[0], point[1] + offset[1]


def chords(call: c.SplineFeed, error: float) -> NDArray[np.float64]:
    """Return the ends of straight lines along a spline, shape (n, 2).

    Parameters
    ----------
    call : SplineFeed
    error : float
        How far the spline may lie beside them, in its own units.
    """
    spans = len(call.points) - call.order + 1
    pieces = 4
    while True:
        u = np.linspace(0.0, spans, 2 * pieces * spans + 1)
        points = spline_points(call.points, call.weights, call.order, u)
        ends = points[::2]
        off = points[1::2] - (ends[1:] + ends[:-1]) / 2
        if math.sqrt(np.square(off).sum(axis=1).max()) <= error or pieces >= _MOST:
            return ends[1:]
        pieces *= 2


def spline_points(
    control: ArrayLike, weights: ArrayLike, order: int, u: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return points of a clamped uniform rational B-spline.

    Parameters
    ----------
    control : (n, 2) array_like
    weights : (n,) array_like
    order : int
        Its degree and 1, at most n.
    u : (m,) floats
        Parameters, 0 at the start to n - order + 1 at the end.

    Returns
    -------
    (m, 2) floats
    """
    weights = np.asarray(weights, np.float64)
    n = weights.size
    last = n - order + 1
    knots = np.concatenate([np.zeros(order - 1), np.arange(last + 1), np.full(order - 1, last)])
    span = np.minimum(np.floor(u), last - 1)[:, None]
    # The basis functions of Cox and de Boor, from steps to order - 1.
    basis = ((knots[:-1] == span) & (knots[1:] == span + 1)).astype(np.float64)
    at = u[:, None]
    for degree in range(1, order):
        width = knots[degree:] - knots[:-degree]
        slope = np.divide(1.0, width, out=np.zeros_like(width), where=width > 0)
        rising = (at - knots[: -degree - 1]) * slope[:-1]
        falling = (knots[degree + 1 :] - at) * slope[1:]
        basis = rising * basis[:, :-1] + falling * basis[:, 1:]
    weighted = basis * weights
    points: NDArray[np.float64] = weighted @ np.asarray(control, np.float64)
    points /= weighted.sum(axis=1, keepdims=True)
    return points
