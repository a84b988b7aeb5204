"""Cutter compensation: the path of a tool of some radius beside the programmed contour.

Works on plane points as complex numbers; multiplying by 1j turns left. A move waits until the next
one is known, because an inside corner shortens it. What else the program does meanwhile waits
behind it.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from pulsewright.motion.gcode import calls as c
from pulsewright.motion.gcode.faults import Fault
from pulsewright.motion.moves import Plane

STRAIGHT_ON: Final = 0.05  # [rad]; corners of less are passed without an arc
_SHORT: Final = 1e-9  # relative to the radius: rounding, not motion
# What is said at once, ahead of the move that waits: it does not matter where the tool then is.
_AT_ONCE: Final = (c.Message, c.Print, c.Log, c.SelectTool, c.SelectPlane, c.UseLengthUnits)


@dataclass
class _Element:
    """A compensated move: where it starts and ends, and how it runs there."""

    start: complex
    end: complex
    direction: complex  # of the programmed move at its end, length 1
    position: list[float]  # the end in all axes; those of the plane are set from ``end``
    rapid: bool = False
    center: complex | None = None  # of an arc
    sweep: float = 0.0  # [rad] as programmed, or nearly


_Waiting = tuple[int, "tuple[object, ...] | _Element"]


class Compensation:
    """Cutter compensation from G41 or G42 to G40.

    Parameters
    ----------
    canon : Canon
        Where compensated calls go.
    plane : Plane
        In which to compensate.
    left : bool
        The tool is left of the contour.
    radius : float
        Of the tool [program units], 0 or more.
    position : (6,) floats
        Where the tool is, in program coordinates.
    tip : complex
        From the centre of the tool to the point that is programmed, in the plane; of lathe tools.
    """

    def __init__(
        self,
        canon: c.Canon,
        plane: Plane,
        *,
        left: bool,
        radius: float,
        position: c.Position,
        tip: complex = 0j,
    ) -> None:
        self.line, self.number = canon.line, canon.number
        self.plane, self.left, self.radius = plane, left, radius
        self._canon = canon
        self._tip = tip
        self._first, self._second = plane.axes
        self._normal = 1j if left else -1j
        self._before = list(position)  # programmed
        self._at = self._point(position)
        self._tool = self._at  # compensated, once all that waits is done
        self._pending: _Element | None = None
        self.entered = False
        self._waiting: list[_Waiting] = []

    # The canon that the interpreter sees

    def emit(self, call: tuple[object, ...]) -> None:
        """Take a call: motion is compensated, all else keeps its place between."""
        if isinstance(call, c.StraightFeed | c.StraightTraverse):
            self._straight(call.position, rapid=isinstance(call, c.StraightTraverse))
            self._before = list(call.position)
        elif isinstance(call, c.ArcFeed):
            self._arc(call)
            self._before = list(call.end)
        elif isinstance(call, _AT_ONCE):
            self._canon.line, self._canon.number = self.line, self.number
            self._canon.emit(call)
        else:
            self._wait(call)
        if self.radius == 0 or self._pending is None:
            self._flush()  # no move can be shortened

    def finish(self) -> None:
        """Carry out all that waits."""
        self._flush()
        self._pending = None

    # One move after the other

    def _straight(self, position: c.Position, *, rapid: bool) -> None:
        end = self._point(position)
        length = abs(end - self._at)
        self._check_entry(length)
        if length <= _SHORT * max(1.0, self.radius):
            # Motion beside the plane: at the place where the tool then is.
            self._wait(_Element(self._tool, self._tool, 0j, list(position), rapid))
            return
        direction = (end - self._at) / length
        target = end + self.radius * self._normal * direction
        self._join(_Element(self._tool, target, direction, list(position), rapid), direction)
        self._at = end

    def _arc(self, call: c.ArcFeed) -> None:
        if call.plane is not self.plane:
            raise Fault("arcs in another plane cannot be compensated; use G40 first")
        start, end, center = self._at, self._point(call.end), complex(*call.center)
        self._check_entry(abs(end - start))
        turn = 1j if call.sweep > 0 else -1j
        arriving = turn * (end - center) / abs(end - center)
        leaving = turn * (start - center) / abs(start - center)
        target = end + self.radius * self._normal * arriving
        programmed = abs(end - center)
        outward = ((target - end) / (end - center)).real * programmed
        if programmed + outward <= _SHORT * self.radius:
            raise Fault(
                f"the arc's radius of {programmed:.4g} is too small for the tool's radius of "
                f"{self.radius:.4g}: it would gouge"
            )
        if not self.entered:
            # The entry starts at the tool's centre and arrives along the contour.
            radial = (target - center) / abs(target - center)
            chord = target - self._tool
            along = 2 * (chord * radial.conjugate()).real
            if abs(along) <= _SHORT * abs(chord):
                raise Fault("cutter compensation cannot begin on this arc; enter along a line")
            center = target - radial * abs(chord) ** 2 / along
        element = _Element(self._tool, target, arriving, list(call.end), False, center, call.sweep)
        self._join(element, leaving)
        self._at = end

    def _check_entry(self, length: float) -> None:
        """Check that the first move is long enough; ``length`` is from its start to its end."""
        if not self.entered and 0 < self.radius >= length:
            raise Fault(
                f"the first move with cutter compensation is {length:.4g} long; it must be longer "
                f"than the tool's radius, {self.radius:.4g}"
            )

    def _join(self, new: _Element, leaving: complex) -> None:
        """Let a move follow the pending one: over an outside corner, or into an inside corner."""
        old = self._pending
        corner: _Element | None = None
        if old is not None and self.radius > 0:
            angle = cmath.phase(leaving / old.direction)  # positive to the left
            inside = angle if self.left else -angle
            if abs(angle) > math.pi - STRAIGHT_ON:
                # Almost straight back: around the end, but for an arc that curves away from the
                # tool, whose path the other one crosses.
                arc = new if new.center is not None else old
                crosses = arc.center is not None and (arc.sweep < 0) == self.left
                inside = abs(angle) if crosses else inside - math.tau * (inside > 0)
            if inside < -STRAIGHT_ON:
                begin = self._at + self.radius * self._normal * leaving
                corner = _Element(old.end, begin, leaving, self._before, new.rapid)
                if not new.rapid:  # as LinuxCNC does it, a rapid goes straight to its beginning
                    corner.center, corner.sweep = self._at, inside if self.left else -inside
                new.start = begin
            elif inside > STRAIGHT_ON:
                self._shorten(old, new, leaving)
        if corner is not None:
            self._wait(corner)
        self._flush()
        self._wait(new)
        self._pending = new
        self.entered = True
        self._tool = new.end

    def _shorten(self, old: _Element, new: _Element, leaving: complex) -> None:
        """End the pending move where the offset paths meet."""
        begin = self._at + self.radius * self._normal * leaving
        meet = _intersection((old.end, old.direction, old.center), (begin, leaving, new.center))
        if meet is None:
            raise Fault("the tool does not fit into this inside corner: it would gouge")
        for element, end in ((old, meet), (new, new.end)):
            start = old.start if element is old else meet
            if element.center is None:
                fits = ((end - start) * element.direction.conjugate()).real > -1e-9
            else:
                swept = _sweep(start, end, element.center, element.sweep)
                fits = swept * element.sweep > 0 and abs(swept) <= abs(element.sweep) + math.pi / 2
            if not fits:
                raise Fault(
                    "a move is too short for the tool to go from one inside corner to the next: "
                    "it would gouge"
                )
        for _, waiting in self._waiting:
            if isinstance(waiting, _Element) and waiting is not old and waiting.direction == 0:
                waiting.start = waiting.end = meet
        old.end = new.start = self._tool = meet

    # What waits

    def _wait(self, call: tuple[object, ...] | _Element) -> None:
        self._waiting.append((self.line, call))

    def _flush(self) -> None:
        self._canon.number = self.number  # as LinuxCNC gives it, that of the line that lets them go
        for line, waiting in self._waiting:
            self._canon.line = line
            call = self._call(waiting) if isinstance(waiting, _Element) else waiting
            self._canon.emit(call)
        self._waiting.clear()

    def _call(self, element: _Element) -> tuple[object, ...]:
        position = self._position(element.position, element.end + self._tip)
        if element.center is None:
            return c.StraightTraverse(position) if element.rapid else c.StraightFeed(position)
        sweep = _sweep(element.start, element.end, element.center, element.sweep)
        center = element.center.real + self._tip.real, element.center.imag + self._tip.imag
        turns = math.copysign(max(1, math.ceil(abs(sweep) / math.tau - 1e-9)), sweep)
        return c.ArcFeed(self.plane, position, center, int(turns), sweep)

    def _point(self, position: c.Position) -> complex:
        return complex(position[self._first], position[self._second])

    def _position(self, position: Sequence[float], point: complex) -> list[float]:
        result = list(position)
        result[self._first], result[self._second] = point.real, point.imag
        return result


def _sweep(start: complex, end: complex, center: complex, near: float) -> float:
    """Return the angle from start to end; of all whole turns the one closest to ``near``."""
    angle = cmath.phase((end - center) / (start - center)) if start != center else 0.0
    return angle + math.tau * round((near - angle) / math.tau)


_Path = tuple[complex, complex, complex | None]  # a point, the direction there, centre of an arc


def _intersection(old: _Path, new: _Path) -> complex | None:
    """Return where two paths meet, as short as can be before the point of the old one."""
    (p, d, center), (q, e, other_center) = old, new
    if center is None and other_center is None:
        across = (d.conjugate() * e).imag
        return p + d * (((q - p).conjugate() * e).imag / across) if abs(across) > 1e-12 else None
    if center is None:
        assert other_center is not None
        points = _line_circle(p, d, other_center, abs(q - other_center))
        points = [point for point in points if _before(point, p, d) > -1e-9]
        return min(points, key=lambda point: _before(point, p, d), default=None)
    if other_center is None:
        points = _line_circle(q, e, center, abs(p - center))
    else:
        points = _circle_circle(center, abs(p - center), other_center, abs(q - other_center))

    def back(point: complex) -> float:
        """Angle along the old arc from a point to its end."""
        toward = 1.0 if ((p - center) * 1j * d.conjugate()).real > 0 else -1.0
        angle = toward * cmath.phase((p - center) / (point - center)) % math.tau
        return angle if angle < math.tau - 1e-9 else 0.0

    return min(points, key=back, default=None)


def _before(point: complex, end: complex, direction: complex) -> float:
    """Return how far a point of a line lies before its end."""
    return ((end - point) * direction.conjugate()).real


def _line_circle(p: complex, d: complex, center: complex, radius: float) -> list[complex]:
    foot = p + d * ((center - p) * d.conjugate()).real
    distance = abs(center - foot)
    if distance > radius * (1 + 1e-9):
        return []
    half = math.sqrt(max(radius * radius - distance * distance, 0.0))
    return [foot + d * half, foot - d * half]


def _circle_circle(center: complex, r: float, other: complex, s: float) -> list[complex]:
    distance = abs(other - center)
    if distance < 1e-12:
        return []
    along = (r * r - s * s + distance * distance) / (2 * distance)
    if abs(along) > r * (1 + 1e-9):
        return []
    rise = math.sqrt(max(r * r - along * along, 0.0))
    unit = (other - center) / distance
    return [center + unit * complex(along, rise), center + unit * complex(along, -rise)]
