"""Canned cycles: drilling, tapping and boring in any plane, and threads (G76)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from pulsewright.motion.gcode import calls as c
from pulsewright.motion.moves import Plane

CLEARANCE: Final = 0.254  # [mm] above the last cut, where pecking goes on (0.010 inch)
STICKY: Final = "RPQIJK"  # words, beside the depth, that the next hole of a series keeps


@dataclass
class Hole:
    """One hole: where it is, and how its cycle moves there.

    Lengths are program units, positions program coordinates.
    """

    emit: Callable[[tuple[object, ...]], None]
    plane: Plane
    position: list[float]
    retract: float  # R
    bottom: float  # Z
    clear: float  # where it ends
    clearance: float
    spindle: int  # 1 clockwise, -1 counterclockwise
    words: dict[str, float] = field(default_factory=dict)
    overrides: Sequence[str] = ()  # those that were on before it

    def traverse(self, depth: float) -> None:
        """Go to a depth as fast as the machine can."""
        self.position[self.plane] = depth
        self.emit(c.StraightTraverse(self.position.copy()))

    def feed(self, depth: float) -> None:
        """Go to a depth at the feed rate."""
        self.position[self.plane] = depth
        self.emit(c.StraightFeed(self.position.copy()))

    def tap(self, depth: float) -> None:
        """Go to a depth at the feed rate, with a tap."""
        self.position[self.plane] = depth
        self.emit(c.TapFeed(self.position.copy(), self.plane))

    def traverse_beside(self, point: Sequence[float]) -> None:
        """Go to a point of the plane."""
        for axis, value in zip(self.plane.axes, point, strict=True):
            self.position[axis] = value
        self.emit(c.StraightTraverse(self.position.copy()))

    def dwell(self) -> None:
        """Stand still for P."""
        self.emit(c.Dwell(self.words["P"]))


def _drill(hole: Hole) -> None:
    hole.feed(hole.bottom)
    hole.traverse(hole.clear)


def _spot(hole: Hole) -> None:
    hole.feed(hole.bottom)
    hole.dwell()
    hole.traverse(hole.clear)


def _break_chips(hole: Hole) -> None:
    depth = hole.retract - hole.words["Q"]
    while depth > hole.bottom:
        hole.feed(depth)
        hole.traverse(depth + hole.clearance)
        depth -= hole.words["Q"]
    hole.feed(hole.bottom)
    hole.traverse(hole.clear)


def _peck(hole: Hole) -> None:
    depth = hole.retract - hole.words["Q"]
    while depth > hole.bottom:
        hole.feed(depth)
        hole.traverse(hole.retract)
        hole.traverse(depth + hole.clearance)
        depth -= hole.words["Q"]
    hole.feed(hole.bottom)
    hole.traverse(hole.clear)


def _tap(hole: Hole) -> None:
    hole.emit(c.Switch("FEED_OVERRIDE", False))
    hole.emit(c.Switch("SPEED_OVERRIDE", False))
    hole.tap(hole.bottom)
    hole.emit(c.StopSpindle())
    hole.emit(c.StartSpindle(-hole.spindle))
    hole.emit(c.Dwell(hole.words.get("P", 0.0)))
    hole.tap(hole.clear)
    hole.emit(c.StopSpindle())
    hole.emit(c.StartSpindle(hole.spindle))
    for name in hole.overrides:
        hole.emit(c.Switch(name, True))


def _bore(hole: Hole) -> None:
    hole.feed(hole.bottom)
    hole.feed(hole.retract)
    hole.traverse(hole.clear)


def _bore_stopped(hole: Hole) -> None:
    hole.feed(hole.bottom)
    hole.dwell()
    hole.emit(c.StopSpindle())
    hole.traverse(hole.clear)
    hole.emit(c.StartSpindle(hole.spindle))


def _back_bore(hole: Hole) -> None:
    first, second = hole.plane.axes
    on = hole.position[first], hole.position[second]
    letters = ["IJK"[axis] for axis in (first, second, hole.plane)]
    beside = on[0] + hole.words[letters[0]], on[1] + hole.words[letters[1]]

    def through(depth: float) -> None:
        hole.traverse_beside(beside)
        if depth == hole.bottom:
            orient()
        hole.traverse(depth)
        hole.traverse_beside(on)
        hole.emit(c.StartSpindle(hole.spindle))

    def orient() -> None:
        hole.emit(c.StopSpindle())
        hole.emit(c.OrientSpindle(0.0, 2))

    through(hole.bottom)
    hole.feed(hole.words[letters[2]])
    hole.feed(hole.bottom)
    orient()
    through(hole.clear)


def _bore_by_hand(hole: Hole) -> None:
    hole.feed(hole.bottom)
    hole.dwell()
    hole.emit(c.StopSpindle())
    hole.emit(c.ProgramStop(optional=False))
    hole.emit(c.StartSpindle(hole.spindle))
    hole.position[hole.plane] = hole.clear  # where the operator has taken it


def _bore_dwelling(hole: Hole) -> None:
    hole.feed(hole.bottom)
    hole.dwell()
    hole.feed(hole.clear)


@dataclass(frozen=True)
class Cycle:
    """How a cycle is carried out, the words it needs, and how the spindle must turn.

    ``spindle`` is 1 or -1 for a direction, 0 for any, None where it does not matter.
    """

    run: Callable[[Hole], None]
    words: str = ""
    spindle: int | None = None


CYCLES: Final[dict[int, Cycle]] = {
    730: Cycle(_break_chips, "Q"),
    740: Cycle(_tap, spindle=-1),
    810: Cycle(_drill),
    820: Cycle(_spot, "P"),
    830: Cycle(_peck, "Q"),
    840: Cycle(_tap, spindle=1),
    850: Cycle(_bore),
    860: Cycle(_bore_stopped, "P", spindle=0),
    870: Cycle(_back_bore, "IJK", spindle=0),
    880: Cycle(_bore_by_hand, "P", spindle=0),
    890: Cycle(_bore_dwelling, "P"),
}


@dataclass(frozen=True)
class Thread:
    """The words of G76, in program units.

    Parameters
    ----------
    pitch : float
        P, along Z per revolution.
    peak : float
        I, from the drive line to the thread's peak; negative outside.
    first, depth : float
        J and K: of the first cut, of the whole thread.
    degression : float
        R, at least 1: 1 cuts equally deep, 2 equal areas.
    angle : float
        Q, of the compound slide [degrees].
    springs : int
        H, passes more at full depth.
    taper : float
        E, length of a taper along Z.
    entry, exit : bool
        L: where there is a taper.
    """

    pitch: float
    peak: float
    first: float
    depth: float
    degression: float
    angle: float
    springs: int
    taper: float
    entry: bool
    exit: bool

    def run(
        self, emit: Callable[[tuple[object, ...]], None], start: Sequence[float], end: float
    ) -> None:
        """Cut it, from the drive line at ``start`` to Z ``end``."""
        outside = -1.0 if self.peak < 0 else 1.0  # which way in is
        depths, depth = [], self.first
        while depth < self.depth - 1e-9:
            depths.append(depth)
            depth = self.first * (len(depths) + 1) ** (1 / self.degression)
        for depth in [*depths, *[self.depth] * (1 + self.springs)]:
            self._pass(emit, start, end, depth, outside)
        emit(c.StraightTraverse([start[0], start[1], end, *start[3:]]))

    def _pass(
        self,
        emit: Callable[[tuple[object, ...]], None],
        start: Sequence[float],
        end: float,
        depth: float,
        outside: float,
    ) -> None:
        drive, tangent = start[0], math.tan(math.radians(self.angle))
        cut = drive + self.peak + outside * depth
        tapered = cut - outside * self.depth
        toward = -1.0 if end <= start[2] else 1.0
        first = start[2] + toward * depth * tangent
        last = end - toward * (self.depth - depth) * tangent
        slope = math.hypot(self.depth, self.taper) / self.taper if self.taper else 1.0

        def at(x: float, z: float) -> list[float]:
            return [x, start[1], z, *start[3:]]

        away = tapered - self.peak
        emit(c.StraightTraverse(at(away, first)))
        if not self.entry:
            emit(c.StraightTraverse(at(cut, first)))
        emit(c.Switch("FEED_OVERRIDE", False))
        if self.entry:
            emit(c.StartSpeedFeedSync(self.pitch * slope))
            emit(c.StraightFeed(at(tapered, first)))
            emit(c.StraightFeed(at(cut, first + toward * self.taper)))
            emit(c.StartSpeedFeedSync(self.pitch))
        else:
            emit(c.StartSpeedFeedSync(self.pitch))
        if self.exit:
            emit(c.StraightFeed(at(cut, last - toward * self.taper)))
            emit(c.StartSpeedFeedSync(self.pitch * slope))
            emit(c.StraightFeed(at(tapered, last)))
        else:
            emit(c.StraightFeed(at(cut, last)))
        emit(c.StopSpeedFeedSync())
        emit(c.StraightTraverse(at(away, last)))
        emit(c.Switch("FEED_OVERRIDE", True))
