"""Plans that begin anywhere on a path, at any speed: what hold, override and more moves need."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import uncompiled

if TYPE_CHECKING:
    from pulsewright.motion.path import Elements, Limits

FARTHER: Final = 1.15  # ratio of distances that are tried
LEAST: Final = 0.05  # of the distance for stopping, to begin with
FASTER: Final = 1.02  # than a machine can get while it begins to brake, for rounding
NEAR_BY: Final = 8.0  # distances for stopping: what begins well so far, does
NEAR: Final = 1e-9  # of an element, or in s: so small a part is none

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Place(NamedTuple):
    """Where a plan is at some time, and its path speed and acceleration."""

    element: int
    s: float
    speed: float = 0.0
    acceleration: float = 0.0
    waited: float = 0.0  # in a dwell [s]
    override: float = 1.0  # of the feed


class Cap(NamedTuple):
    """What holds up to a place."""

    to: Place
    override: float  # of the feed
    speed: float  # at most


@dataclass(frozen=True)
class Plan:
    """Pieces of a trajectory, and the override of the feed on each."""

    element: NDArray[np.int32]
    start: Floats
    law: Floats
    override: Floats

    @property
    def duration(self) -> float:
        """Time from begin to end [s]."""
        return float(self.start[-1])

    @property
    def end(self) -> Place:
        """Where the last piece ends; there has to be one."""
        tau = float(self.start[-1] - self.start[-2])
        s = float(self.law[-1] @ tau ** np.arange(4))
        return Place(int(self.element[-1]), s)

    def cut(self, time: float) -> tuple[Plan, Plan]:
        """Return what comes before a time and what comes after."""
        k = int(np.searchsorted(self.start, time - NEAR))
        if k < len(self.start) and self.start[k] <= time + NEAR:  # between two pieces
            return self._pieces(0, k), self._pieces(k, len(self.element))
        before, after = self._pieces(0, k), self._pieces(k - 1, len(self.element))
        before.start[-1] = time
        tau = time - self.start[k - 1]
        c0, c1, c2, c3 = self.law[k - 1]
        after.law[0] = (
            *(c0 + (c1 + (c2 + c3 * tau) * tau) * tau, c1 + (2 * c2 + 3 * c3 * tau) * tau),
            *(c2 + 3 * c3 * tau, c3),
        )
        after.start[1:] -= tau
        return before, after

    def _pieces(self, first: int, last: int) -> Plan:
        start = self.start[first : last + 1] - self.start[first]
        return Plan(
            self.element[first:last], start, self.law[first:last].copy(), self.override[first:last]
        )

    def then(self, more: Plan) -> Plan:
        """Return this plan followed by another one."""
        return Plan(
            np.concatenate([self.element, more.element]),
            np.concatenate([self.start, self.duration + more.start[1:]]),
            np.concatenate([self.law, more.law]),
            np.concatenate([self.override, more.override]),
        )


NOTHING: Final = Plan(np.zeros(0, np.int32), np.zeros(1), np.zeros((0, 4)), np.zeros(0))


class Along:
    """A path that is known up to some place, and the plans along it; they all end at rest.

    Parameters
    ----------
    elements : Elements
    limits : Limits
    overridable : (m,) bool
        Whether an override changes the feed of an element.
    """

    def __init__(self, elements: Elements, limits: Limits, overridable: NDArray[np.bool_]) -> None:
        self.elements, self.limits, self._overridable = elements, limits, overridable
        self._size = len(elements.length)

    def __len__(self) -> int:
        return self._size

    @property
    def end(self) -> Place:
        """The end of what is known."""
        return Place(self._size - 1, float(self.elements.length[-1]))

    def without(self, count: int, moves: int) -> Along:
        """Return the path without its first elements; moves are counted from ``moves`` on."""
        x = self.elements
        kept = _rows(x, slice(count, None))
        kept = kept._replace(move=kept.move - np.int32(moves))
        return Along(kept, self.limits, self._overridable[count:])

    def at(self, plan: Plan, time: float) -> Place | None:
        """Return where a plan is at a time; None if it is empty."""
        x = self.elements
        left = plan.cut(time)[1]
        if len(left.element):
            e, (s, speed, half, _) = int(left.element[0]), left.law[0].tolist()
            waited = 0.0
            if x.length[e] == 0.0:  # a dwell has several pieces if its override changed meanwhile
                pieces = int(np.searchsorted(left.element, e, "right"))
                waited = float(x.dwell[e] - left.start[pieces])
            return Place(e, s, speed, 2 * half, waited, float(left.override[0]))
        if not len(plan.element):
            return None
        e, s = plan.end[:2]
        if s >= x.length[e] * (1 - NEAR):
            e, s = e + 1, 0.0
        return Place(e, s)

    def to_end(self, place: Place, override: float) -> Plan | None:
        """Plan to the end of the path, with another override from as soon as possible on.

        None if no plan is found that keeps the limits.
        """
        if place.element >= self._size:
            return NOTHING
        found = None
        if self._may_begin(place, override):
            found = self._planned(place, [Cap(self.end, override, math.inf)])
        if found is not None or not override < place.override:
            return found
        to = min(override * float(self.elements.feed[place.element]), place.speed)
        distance = max(self._stopping(place, to), LEAST * self._stopping(place, 0.0))
        most = self._distance(place, self.end)
        while distance < most:
            slow = Cap(self._farther(place, distance), place.override, self._peak(place))
            found = self._planned(place, [slow, Cap(self.end, override, math.inf)])
            if found is not None:
                return found
            distance *= FARTHER
        return None

    def _may_begin(self, place: Place, override: float) -> bool:
        """Return whether there is a plan from a place to rest near by: that is known soon."""
        if place.speed == 0:
            return True
        distance = NEAR_BY * self._stopping(place, 0.0)
        if distance >= self._distance(place, self.end):
            return True
        stop = Cap(self._farther(place, distance), override, math.inf)
        return self._planned(place, [stop]) is not None

    def to_rest(self, place: Place, old: Plan) -> Plan:
        """Plan the shortest way to rest; at worst, that of the old plan, which begins there."""
        still = np.flatnonzero((old.law[1:, 1:3] == 0).all(axis=1))
        rest = old.cut(float(old.start[still[0] + 1]))[0] if len(still) else old
        most = self._distance(place, rest.end)
        distance = self._stopping(place, 0.0)
        while distance < most:
            stop = Cap(self._farther(place, distance), place.override, self._peak(place))
            found = self._planned(place, [stop])
            if found is not None:
                return found
            distance *= FARTHER
        return rest

    @uncompiled(0)
    def _planned(self, place: Place, caps: list[Cap]) -> Plan | None:
        """Plan from a place to rest at the last cap; None if that breaks a limit."""
        from pulsewright.motion.cells import cells
        from pulsewright.motion.law import law
        from pulsewright.motion.speeds import speeds

        if self._stops_at_once(place):
            return None
        row, low, high, override, cap = self._stretch(place, caps)
        if not len(row):
            return NOTHING
        path = self._cut_out(row, low, high)
        feed = np.where(self._overridable[row], path.feed * override, path.feed)
        path = path._replace(feed=np.minimum(feed, cap))
        path.dwell[0] -= place.waited
        square = place.speed**2
        grid = cells(path, self.limits, square)
        b, a, split, repairs = speeds(path, self.limits, grid, square, place.acceleration)
        if repairs[2] < 0:
            return None
        element, start, piece = law(path, grid.element, grid.offset, grid.size, b, a, split)
        piece[:, 0] += low[element]
        return Plan(row[element].astype(np.int32), start, piece, override[element])

    def _stops_at_once(self, place: Place) -> bool:
        """Tell whether a place is so near before a rest that nothing but coming to it is left."""
        final = bool(self.elements.rest[place.element]) or place.element == self._size - 1
        moving = place.speed > 0 or place.acceleration != 0
        return final and moving and self._is_over(place)

    def _is_over(self, place: Place) -> bool:
        """Tell whether what is left of an element, not a dwell, is so little that it is none."""
        length = float(self.elements.length[place.element])
        return length > 0 and place.s >= length * (1 - NEAR)

    def _stretch(
        self, place: Place, caps: list[Cap]
    ) -> tuple[Ints, Floats, Floats, Floats, Floats]:
        """Return the elements from a place to the last cap, split where caps change.

        Which element, where on it the part begins and ends, override and largest speed there.
        """
        length = self.elements.length
        parts = []
        e, s = (place.element + 1, 0.0) if self._is_over(place) else place[:2]
        for to, override, speed in caps:
            last, stop = to.element, to.s
            if last > e and length[last] > 0 and stop <= length[last] * NEAR:
                last, stop = last - 1, float(length[last - 1])
            if last < e or (last == e and stop <= s and length[e] > 0):
                continue
            rows = np.arange(e, last + 1)
            low, high = np.zeros(len(rows)), length[rows].copy()
            low[0], high[-1] = s, stop
            parts.append((rows, low, high, 0 * low + override, np.full(len(rows), speed)))
            e, s = (last, stop) if stop < length[last] * (1 - NEAR) else (last + 1, 0.0)
        if not parts:
            nothing = np.zeros(0)
            return np.zeros(0, np.int64), nothing, nothing, nothing, nothing
        columns: Any = [np.concatenate(column) for column in zip(*parts, strict=True)]
        return tuple(columns)

    def _cut_out(self, row: Ints, low: Floats, high: Floats) -> Elements:
        """Return parts of elements as elements; they rest at the last one's end."""
        part = _rows(self.elements, row)
        part.length[:] = high - low
        for i in np.flatnonzero(low > 0).tolist():
            at, w = low[i], part.omega[i]
            p = part.poly[i].copy()
            part.poly[i, 0] = p[0] + (p[1] + (p[2] + p[3] * at) * at) * at
            part.poly[i, 1] = p[1] + (2 * p[2] + 3 * p[3] * at) * at
            part.poly[i, 2] = p[2] + 3 * p[3] * at
            c, d = part.cosine[i].copy(), part.sine[i].copy()
            cos, sin = math.cos(w * at), math.sin(w * at)
            part.cosine[i], part.sine[i] = c * cos + d * sin, d * cos - c * sin
        part.rest[:-1] &= row[1:] > row[:-1]
        part.rest[-1] = True
        return part

    def _rates(self, place: Place) -> tuple[float, float]:
        """Return about the path acceleration and jerk that are possible at a place."""
        x, limits, s = self.elements, self.limits, place.s
        e = min(place.element, self._size - 1)
        w, p = x.omega[e], x.poly[e]
        along = p[1] + (2 * p[2] + 3 * p[3] * s) * s
        along = along + w * (x.sine[e] * math.cos(w * s) - x.cosine[e] * math.sin(w * s))
        rate = np.abs(limits.rows @ along)
        with np.errstate(divide="ignore"):
            return float((limits.acceleration / rate).min()), float((limits.jerk / rate).min())

    def _peak(self, place: Place) -> float:
        """Return the largest speed on the way to a lower one."""
        rise = max(place.acceleration, 0.0)
        return FASTER * (place.speed + 0.5 * rise * rise / self._rates(place)[1])

    def _stopping(self, place: Place, to: float) -> float:
        """Return about the distance in which the speed can fall to another one."""
        a, j = self._rates(place)
        v, now = place.speed, place.acceleration
        rise = abs(now) / j
        peak = v + 0.5 * rise * abs(now)  # where the acceleration will be 0, or was so
        way = (v + now * rise / 3) * rise if now > 0 else -(peak + now * rise / 6) * rise
        fall = max(peak - to, 0.0)
        time = fall / a + a / j if fall * j > a * a else 2 * math.sqrt(fall / j)
        return max(0.5 * (peak + to) * time + way, LEAST * v * v / a, NEAR)

    def _distance(self, place: Place, to: Place) -> float:
        """Return the path coordinate between two places."""
        between = self.elements.length[place.element : to.element]
        return float(between.sum()) + to.s - place.s

    def _farther(self, place: Place, distance: float) -> Place:
        """Return the place some path coordinate further, at most the end of the path."""
        length = self.elements.length
        e, left = place.element, place.s + distance
        while e + 1 < self._size and left > length[e]:
            left -= float(length[e])
            e += 1
        return Place(e, min(left, float(length[e])))


def _rows(elements: Elements, row: Any) -> Elements:
    """Return some of the elements, in arrays of their own."""
    columns: Any = (np.array(column[row]) for column in elements)
    return type(elements)(*columns)
