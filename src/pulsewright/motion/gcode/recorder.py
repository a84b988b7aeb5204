"""What an interpreted program does, collected in columns: the interpreter's only way out."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

import numpy as np

from pulsewright.motion.moves import AXES, Event, MoveKind, Moves, Plane, Program

_Arc = tuple[int, Plane, Sequence[float], float]


class Recorder:
    """Collects motion and events in machine coordinates [mm, degrees, s].

    Parameters
    ----------
    start : (6,) floats
        Position before the first move.
    """

    def __init__(self, start: Sequence[float]) -> None:
        self._start = list(start)
        # A large program has 1e5 moves: plain columns here, what is rare beside them.
        self._line = array("i")
        self._end = array("d")
        self._feed = array("d")
        self._tolerances = [(0, 0.0)]  # from which move on
        self._stops: list[int] = []  # moves that end at rest, counted from 1
        self._arcs: list[_Arc] = []
        self._dwells: list[tuple[int, float]] = []
        self._events: list[Event] = []

    def path_tolerance(self, tolerance: float) -> None:
        """Set the path tolerance of the moves to come [mm]; 0 = come to rest after each."""
        self._tolerances.append((len(self._line), tolerance))

    def straight(self, end: list[float], feed: float, line: int) -> None:
        """Add a straight move; an infinite ``feed`` is a rapid."""
        self._line.append(line)
        self._end.fromlist(end)
        self._feed.append(feed)

    def arc(
        self,
        end: list[float],
        feed: float,
        line: int,
        *,
        plane: Plane,
        center: Sequence[float],
        sweep: float,
    ) -> None:
        """Add an arc or helix about ``center`` (3 coordinates)."""
        self._arcs.append((len(self._line), plane, tuple(center), sweep))
        self.straight(end, feed, line)

    def dwell(self, seconds: float, line: int) -> None:
        """Stand still."""
        self.stop()
        self._dwells.append((len(self._line), seconds))
        self.straight(self._end[-len(AXES) :].tolist() or self._start, 0.0, line)
        self.stop()

    def event(
        self, kind: str, line: int, *, value: float = 0.0, text: str = "", rest: bool = True
    ) -> None:
        """Add an event after the motion so far; with ``rest`` the machine stands still for it."""
        if rest:
            self.stop()
        self._events.append(Event(len(self._line), line, kind, value, text))

    def stop(self) -> None:
        """Let the motion so far end at rest."""
        self._stops.append(len(self._line))

    def program(self, path: str) -> Program:
        """Return all of it; the last move ends at rest."""
        self.stop()
        n = len(self._line)
        kind = np.full(n, MoveKind.LINE, np.int8)
        plane = np.full(n, Plane.XY, np.int8)
        center, sweep, dwell = np.zeros((n, 3)), np.zeros(n), np.zeros(n)
        for i, turned_about, arc_center, angle in self._arcs:
            kind[i], plane[i], center[i], sweep[i] = MoveKind.ARC, turned_about, arc_center, angle
        for i, seconds in self._dwells:
            kind[i], dwell[i] = MoveKind.DWELL, seconds
        first, value = zip(*self._tolerances, strict=True)
        tolerance = np.repeat(np.array(value), np.diff([*first, n]))
        tolerance[np.array(sorted({*self._stops} - {0}), dtype=np.int64) - 1] = 0.0
        feed = np.array(self._feed)
        moves = Moves(
            start=np.array(self._start, dtype=np.float64),
            kind=kind,
            plane=plane,
            rapid=np.isinf(feed),
            line=np.array(self._line, dtype=np.int32),
            end=np.array(self._end).reshape(n, len(AXES)),
            center=center,
            sweep=sweep,
            feed=feed,
            dwell=dwell,
            tolerance=tolerance,
        )
        return Program(path, moves, tuple(self._events))
