"""Canonical calls collected in columns: the motion of a program for the planner."""

from __future__ import annotations

import sys
from array import array
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from pulsewright.motion.gcode import calls as c
from pulsewright.motion.gcode.arcs import RESOLUTION
from pulsewright.motion.gcode.faults import Fault
from pulsewright.motion.gcode.offsets import Frame
from pulsewright.motion.gcode.splines import chords
from pulsewright.motion.moves import AXES, Event, MoveKind, Moves, Plane, Program
from pulsewright.units import MINUTE

MANY: Final = 1 << 14  # moves that are kept before they are taken
SPLINE_ERROR: Final = 1e-3  # of the straight lines that stand for a spline [mm]
LONGEST_DWELL: Final = 1e5  # much later, times would not be fine enough for motion [s]
_EVENT_OF_SWITCH: Final = {"MIST": "mist", "FLOOD": "flood"}
_NOWHERE: Final = (np.nan,) * len(AXES)  # a dwell stays where the move before it ended

T = TypeVar("T")


class Recorder:
    """Collects motion and events in machine coordinates [mm, degrees, s].

    Ends are kept in program coordinates and turned into machine coordinates all together; a
    program of many lines never makes an object for each of its moves.

    Parameters
    ----------
    start : (6,) floats
        Machine position before the first move.
    path_tolerance : float
        How far the path may pass from a corner where the program gives no tolerance [mm].
    exact_tolerance : float
        How far in G61 [mm].
    take : callable, optional
        Gets moves as soon as there are many that stay as they are; `program` has the others.
    """

    def __init__(
        self,
        start: Sequence[float],
        path_tolerance: float = 0.05,
        exact_tolerance: float = 0.001,
        take: Callable[[Moves], None] | None = None,
    ) -> None:
        self.line = 0
        self.number = ""
        self._start = np.array([float(v) for v in start])  # where the first move begins,
        self._before = self._start  # and where the first of all that do something or not
        self._given = 0  # how many moves were taken
        self._give = take
        self._most = sys.maxsize if take is None else MANY
        self._path_tolerance, self._exact_tolerance = path_tolerance, exact_tolerance
        self._lines = array("i")
        self._ends = array("d")
        self._feeds = array("d")  # [mm/s] or infinite
        # What changes rarely: (the first move it is for, value).
        self._frames: list[tuple[int, Frame]] = [(0, Frame())]
        self._feed_scales: list[tuple[int, float]] = [(0, 1.0)]
        self._tolerances: list[tuple[int, float]] = [(0, path_tolerance)]
        self._collapses: list[tuple[int, float]] = [(0, 0.0)]
        self._pitches: list[tuple[int, float]] = [(0, 0.0)]
        # What is rare: (move, value).
        self._stops: list[int] = []  # moves that end at rest, counted from 1
        self._arcs: list[tuple[int, c.ArcFeed]] = []
        self._dwells: list[tuple[int, float]] = []
        self._events: list[Event] = []
        self._past: list[Event] = []  # those of moves that are forgotten
        self._frame = Frame()
        self._feed = 0.0
        self._rate = c.SetFeedRate(0.0, 1.0)
        self._per_revolution = False
        self._speed, self._direction = 0.0, 0
        self._continuous = True
        self._pitch = 0.0
        self._take: dict[type, Callable[[Any], None]] = {
            c.StraightFeed: self._straight_feed,
            c.StraightTraverse: self._straight_traverse,
            c.TapFeed: lambda call: self._straight_feed(c.StraightFeed(call.position)),
            c.ArcFeed: self._arc_feed,
            c.SplineFeed: self._spline_feed,
            c.SetFeedRate: self._set_feed_rate,
            c.RigidTap: self._rigid_tap,
            c.StraightProbe: self._probe,
            c.UseLengthUnits: lambda call: self._use_frame(scale=call.scale),
            c.SetG5xOffset: lambda call: self._use_frame(work=tuple(call.offset)),
            c.SetG92Offset: lambda call: self._use_frame(shift=tuple(call.offset)),
            c.SetXYRotation: lambda call: self._use_frame(rotation=call.angle),
            c.UseToolLengthOffset: lambda call: self._use_frame(tool=tuple(call.offset)),
            c.SetFeedMode: self._set_feed_mode,
            c.SetMotionControlMode: self._set_path_control,
            c.SetNaivecamTolerance: self._set_collapse,
            c.StartSpeedFeedSync: lambda call: self._synchronise(call.pitch),
            c.StopSpeedFeedSync: lambda _: self._synchronise(0.0),
            c.SetSpindleSpeed: self._set_speed,
            c.SetSpindleMode: self._set_spindle_mode,
            c.StartSpindle: lambda call: self._spindle(call.direction),
            c.StopSpindle: lambda _: self._spindle(0),
            c.OrientSpindle: lambda call: self._event("orient", call.angle),
            c.Dwell: lambda call: self._dwell(call.seconds),
            c.Message: self._message,
            c.Print: self._message,
            c.ChangeTool: lambda call: self._event("tool", float(call.number)),
            c.Switch: self._switch,
            c.Output: self._output,
            c.WaitInput: lambda call: self._event(
                "input",
                float(call.mode),
                f"{'analog' if call.analog else 'digital'} {call.pin}",
            ),
            c.ProgramStop: lambda call: self._event("pause", text="M1" if call.optional else "M0"),
            c.ProgramEnd: lambda call: self._event("end", text=f"M{call.code}"),
        }

    def emit(self, call: tuple[object, ...]) -> None:
        """Take one call; those that are neither motion nor event have no effect here."""
        take = self._take.get(type(call))
        if take is not None:
            take(call)
            if len(self._lines) > self._most:
                self._hand_over()

    # Motion

    def straights(
        self, lines: NDArray[np.int32], ends: NDArray[np.float64], feeds: NDArray[np.float64]
    ) -> None:
        """Take many straight moves at once: ends in program coordinates, feeds [mm/s]."""
        self._lines.frombytes(lines.view(np.uint8).data)
        self._ends.frombytes(ends.view(np.uint8).data)
        self._feeds.frombytes(feeds.view(np.uint8).data)
        if len(self._lines) > self._most:
            self._hand_over()

    def _straight_traverse(self, call: c.StraightTraverse) -> None:
        self._lines.append(self.line)
        self._ends.extend(call.position)
        self._feeds.append(np.inf)

    def _straight_feed(self, call: c.StraightFeed) -> None:
        self._lines.append(self.line)
        self._ends.extend(call.position)
        self._feeds.append(self._feed)

    def _arc_feed(self, call: c.ArcFeed) -> None:
        if call.plane is not Plane.XY and self._frame.rotation:
            raise Fault(
                "an arc in G18 or G19 cannot be run in a coordinate system that is rotated about "
                "Z; use G10 L2 R0 or G17"
            )
        self._arcs.append((len(self._lines), call))
        self._lines.append(self.line)
        self._ends.extend(call.end)
        self._feeds.append(self._feed)

    def _spline_feed(self, call: c.SplineFeed) -> None:
        ends = chords(call, SPLINE_ERROR / self._frame.scale).tolist()
        first, stop = len(self._lines), self._tolerances[-1][1] == 0
        if stop:  # at its end, not at each line
            self._tolerances.append((first, self._exact_tolerance))
            self._tolerances.append((first + len(ends) - 1, 0.0))
        for x, y in ends:
            self._straight_feed(c.StraightFeed([x, y, *call.end[2:]]))

    def _rigid_tap(self, call: c.RigidTap) -> None:
        feed = self._feed
        for position, speed in ((call.position, 1.0), (call.start, call.back)):
            self._feed = feed * speed
            self._straight_feed(c.StraightFeed(position))
            self._stop()
        self._feed = feed

    def _probe(self, _: c.StraightProbe) -> None:
        raise Fault("where a probe trips is known to the machine alone: G38 cannot be planned")

    def _dwell(self, seconds: float) -> None:
        if not seconds <= LONGEST_DWELL:
            raise Fault(
                f"a dwell of more than {LONGEST_DWELL:g} s cannot be planned; divide the program"
            )
        self._stop()
        self._dwells.append((len(self._lines), seconds))
        self._lines.append(self.line)
        self._ends.extend(_NOWHERE)
        self._feeds.append(0.0)
        self._stop()

    def _stop(self) -> None:
        """Let the motion so far end at rest."""
        self._stops.append(len(self._lines))

    # What motion depends on

    def _use_frame(self, **changes: Any) -> None:
        self._frame = replace(self._frame, **changes)
        self._frames.append((len(self._lines), self._frame))

    def _set_feed_rate(self, call: c.SetFeedRate) -> None:
        if call == self._rate:
            return
        self._rate = call
        if call.scale != self._feed_scales[-1][1]:
            self._feed_scales.append((len(self._lines), call.scale))
        self._use_feed()

    def _use_feed(self) -> None:
        if self._pitch:
            self._feed = self._pitch * self._frame.scale * self._speed / MINUTE
        else:
            per_minute = self._speed if self._per_revolution else 1.0
            self._feed = self._rate.rate * self._rate.scale * per_minute / MINUTE

    def _set_feed_mode(self, call: c.SetFeedMode) -> None:
        self._per_revolution = call.per_revolution
        self._use_feed()

    def _set_path_control(self, call: c.SetMotionControlMode) -> None:
        tolerance = {"EXACT_PATH": self._exact_tolerance, "EXACT_STOP": 0.0}.get(
            call.mode,
            # G64 P0 means "as fast as the machine allows", the same as no P.
            call.tolerance * self._frame.scale or self._path_tolerance,
        )
        self._tolerances.append((len(self._lines), tolerance))
        self._continuous = call.mode == "CONTINUOUS"
        if not self._continuous:  # with which its own call comes
            self._collapses.append((len(self._lines), 0.0))

    def _set_collapse(self, call: c.SetNaivecamTolerance) -> None:
        if self._continuous:
            self._collapses.append((len(self._lines), call.tolerance * self._frame.scale))

    def _synchronise(self, pitch: float) -> None:
        self._pitch = pitch
        self._pitches.append((len(self._lines), pitch * self._frame.scale))
        self._use_feed()

    # Events

    def _event(self, kind: str, value: float = 0.0, text: str = "", *, rest: bool = True) -> None:
        """Add an event after the motion so far; with ``rest`` the machine stands still for it."""
        if rest:
            self._stop()
        self._events.append(Event(len(self._lines), self.line, kind, value, text))

    def _set_speed(self, call: c.SetSpindleSpeed) -> None:
        self._speed = call.speed
        if self._direction:
            self._event("spindle", self._direction * call.speed, rest=False)
        self._use_feed()

    def _set_spindle_mode(self, call: c.SetSpindleMode) -> None:
        if call.limit:
            raise Fault("constant surface speed (G96) is not supported in planned motion; use G97")

    def _spindle(self, direction: int) -> None:
        if direction == self._direction == 0:
            self._stop()
            return
        self._direction = direction
        last = self._events[-1] if self._events else None
        if last and (last.kind, last.line, last.at) == ("spindle", self.line, len(self._lines)):
            self._events.pop()  # the speed of the same line: one event for both
        self._event("spindle", direction * self._speed)

    def _message(self, call: c.Message | c.Print) -> None:
        self._event("message", text=" ".join(call.text.split()), rest=False)

    def _switch(self, call: c.Switch) -> None:
        if call.name in _EVENT_OF_SWITCH:
            self._event(_EVENT_OF_SWITCH[call.name], float(call.on), rest=False)

    def _output(self, call: c.Output) -> None:
        kind = "analog" if call.value is not None else "digital"
        value = float("SET" in call.name) if call.value is None else call.value
        self._event("output", value, f"{kind} {call.pin}", rest=not call.with_motion)

    # All of it

    def program(self, path: str) -> Program:
        """Return all of it but what was taken; the last move ends at rest."""
        self._stop()
        return Program(path, self._first(len(self._lines)), tuple(self._past))

    def _hand_over(self) -> None:
        """Give away all but the last move, whose end may still become a rest."""
        moving = np.flatnonzero(self._kept()[2])
        if self._give is None or len(moving) < 2:
            return
        try:
            moves = self._first(int(moving[-1]))
        except Fault:  # `program` raises it again, and its line is known then
            self._most = sys.maxsize
        else:
            self._give(moves)

    def _kept(
        self,
    ) -> tuple[NDArray[np.float64], NDArray[np.int8], NDArray[np.bool_], NDArray[np.bool_]]:
        """Return ends in machine coordinates, kinds, which moves do anything, and which in XYZ."""
        end = self._machine_ends()
        kind = np.full(len(end), MoveKind.LINE, np.int8)
        for i, _ in self._arcs:
            kind[i] = MoveKind.ARC
        for i, _ in self._dwells:
            kind[i] = MoveKind.DWELL
        way = end - np.concatenate([self._before[None], end[:-1]])
        linear, rotary = _norm(way[:, :3]) > RESOLUTION, _norm(way[:, 3:]) > RESOLUTION
        return end, kind, linear | rotary | (kind != MoveKind.LINE), linear

    def _first(self, n: int) -> Moves:
        """Return the first of the moves, and forget them."""
        end, kind, keep, linear = self._kept()
        end, kind, keep, linear = end[:n], kind[:n], keep[:n], linear[:n]
        plane = np.full(n, Plane.XY, np.int8)
        center, sweep, dwell = np.zeros((n, 3)), np.zeros(n), np.zeros(n)
        for i, arc in self._arcs:
            if i >= n:
                break
            plane[i], sweep[i] = arc.plane, arc.sweep
            point = list(arc.end)
            for axis, value in zip(arc.plane.axes, arc.center, strict=True):
                point[axis] = value
            machine = _at(self._frames, i).to_machine(point)
            for axis in arc.plane.axes:
                center[i, axis] = machine[axis]
        for i, seconds in self._dwells:
            if i < n:
                dwell[i] = seconds
        line, feed = np.array(self._lines[:n], np.int32), np.array(self._feeds[:n])
        # A feed is in degrees per minute where rotary axes alone move.
        rotary = ~linear & (kind == MoveKind.LINE)
        feed[rotary] /= _spread(self._feed_scales, n)[rotary]
        if (stuck := keep & (feed <= 0) & (kind != MoveKind.DWELL)).any():
            self.line = int(line[stuck][0])
            raise Fault(
                "feed per revolution or motion tied to the spindle, but its speed is 0; set S first"
            )
        kept = np.concatenate([[0], np.cumsum(keep)])  # of the first i moves
        tolerance = _spread(self._tolerances, n)[keep]
        stops = np.unique(kept[[i for i in self._stops if i <= n]])
        tolerance[stops[stops > 0] - 1] = 0.0
        moves = Moves(
            start=self._start,
            kind=kind[keep],
            plane=plane[keep],
            rapid=np.isinf(feed[keep]),
            line=line[keep],
            end=end.compress(keep, axis=0),  # several times as fast as ``end[keep]``
            center=center.compress(keep, axis=0),
            sweep=sweep[keep],
            feed=feed[keep],
            dwell=dwell[keep],
            tolerance=tolerance,
            collapse=_spread(self._collapses, n)[keep],
            pitch=_spread(self._pitches, n)[keep],
        )
        self._past += [
            replace(event, at=self._given + int(kept[event.at]))
            for event in self._events
            if event.at <= n
        ]
        if n:
            self._before = end[-1].copy()
        if len(moves):
            self._start = moves.end[-1].copy()
        self._given += len(moves)
        self._forget(n)
        return moves

    def _forget(self, n: int) -> None:
        """Forget the first moves, and what is for them alone."""
        del self._lines[:n], self._ends[: n * len(AXES)], self._feeds[:n]
        self._frames = _from(self._frames, n)
        self._feed_scales = _from(self._feed_scales, n)
        self._tolerances = _from(self._tolerances, n)
        self._collapses = _from(self._collapses, n)
        self._pitches = _from(self._pitches, n)
        self._arcs = [(i - n, arc) for i, arc in self._arcs if i >= n]
        self._dwells = [(i - n, seconds) for i, seconds in self._dwells if i >= n]
        self._stops = [i - n for i in self._stops if i > n]
        self._events = [replace(event, at=event.at - n) for event in self._events if event.at > n]

    def _machine_ends(self) -> NDArray[np.float64]:
        """Return the end of every move in machine coordinates, shape (n, 6)."""
        ends = np.array(self._ends).reshape(-1, len(AXES))
        at = [i for i, _ in self._frames[1:]] + [len(ends)]
        for (first, frame), last in zip(self._frames, at, strict=True):
            if first < last:
                # By columns, as `Frame` does it for one position: the same operations in turn.
                columns = frame.to_machine(ends[first:last].T)  # type: ignore[arg-type]
                ends[first:last] = np.array(columns).T
        for i, _ in self._dwells:
            ends[i] = ends[i - 1] if i else self._before
        return ends


def _norm(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    squares: NDArray[np.float64] = np.einsum("ij,ij->i", vectors, vectors)
    return np.sqrt(squares)


def _at(changes: Sequence[tuple[int, T]], i: int) -> T:
    """Return the value that holds for move ``i``."""
    return next(value for first, value in reversed(changes) if first <= i)


def _from(changes: Sequence[tuple[int, T]], n: int) -> list[tuple[int, T]]:
    """Return changes as they are when the first ``n`` moves are forgotten."""
    return [(0, _at(changes, n)), *((first - n, value) for first, value in changes if first > n)]


def _spread(changes: Sequence[tuple[int, float]], n: int) -> NDArray[np.float64]:
    """Return a value for each move from values and the moves from which on they hold."""
    first, value = zip(*(change for change in changes if change[0] <= n), strict=True)
    return np.repeat(np.array(value, dtype=np.float64), np.diff([*first, n]))
