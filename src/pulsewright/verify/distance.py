"""Distance of the tool from the programmed path, and whether it passed the end of every move."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from pulsewright.motion.moves import MoveKind, Moves, Plane
from pulsewright.verify.reference import ROUNDING, Floats, Ints, Reference
from pulsewright.verify.verdict import Check

GROUPS: Final = {"XYZ": slice(0, 3), "ABC": slice(3, 6)}
_WORDS: Final = {"XYZ": ("", "X Y Z", "mm"), "ABC": (":ABC", "A B C", "degrees")}


class PathCheck:
    """Compare X Y Z, or A B C, at every instant looked at with the moves around the active one.

    In A B C every move is a line, and the tolerance of a corner counts as degrees.

    Parameters
    ----------
    reference : Reference
    group : str
        A key of `GROUPS`.

    Attributes
    ----------
    quantum : float
        Distance that `Tolerances.following` steps of every motor make together.
    """

    def __init__(self, reference: Reference, group: str) -> None:
        self.group, self.columns = group, GROUPS[group]
        self.suffix, self.axes, self.unit = _WORDS[group]
        self._reference, moves = reference, reference.moves
        per_axis = np.abs(reference.inverse[self.columns]).sum(axis=1)
        self.quantum = float(np.linalg.norm(reference.tolerances.following * per_axis))
        starts = moves.starts()
        arc = moves.kind == MoveKind.ARC
        arcs = np.flatnonzero(arc)
        self._arc = columns = _arcs(moves, starts, arcs)
        self._row = np.full(len(moves), -1, np.int32)
        self._row[arcs] = np.arange(len(arcs))
        slack = np.zeros(len(moves))
        slack[arcs] = np.abs(columns[:, 3] - columns[:, 2])
        length = np.linalg.norm((moves.end - starts)[:, self.columns], axis=1)
        if group == "XYZ":
            turned = np.abs(moves.sweep[arcs]) * columns[:, 2:4].max(axis=1)
            length[arcs] = np.hypot(turned, columns[:, 4])
        self._start = np.ascontiguousarray(moves.start, float)
        self._end = np.ascontiguousarray(moves.end, float)
        self._plane = moves.plane
        self._center = np.ascontiguousarray(moves.center, float)
        self._length, self._slack = length, slack
        self.follow()
        allowed = np.maximum(moves.tolerance, moves.collapse * (moves.tolerance > 0))
        self._needed = allowed + slack
        self._covered = np.full(len(moves), np.inf)
        self._worst = np.zeros(4)
        self._state = np.zeros(2, np.int64)
        self._before = reference.tool(reference.start_counts[None])[0]

    def follow(self) -> None:
        """Take in when the plan is in which move; what has been compared stays."""
        reference, moves, runs = self._reference, self._reference.moves, self._reference.runs
        # When the end of each move can be passed: from the start of the run that leads to it to
        # the end of the run after it, and a little more, since the machine trails the plan.
        index = np.arange(len(moves))
        into = np.maximum(np.searchsorted(runs.move, index, side="right") - 1, 0)
        out = np.minimum(into + 1, len(runs.move) - 1)
        margin = reference.tolerances.settle
        span = np.stack([runs.start[into] - margin, runs.start[out + 1] + margin], axis=1)
        self._span = reference.start + np.round(span * reference.clock).astype(np.int64)

    def feed(self, tool: Floats, run: Ints, cycle: int) -> Floats:
        """Compare the tool (n, 6) at instants from ``cycle`` on; return its distances (n,)."""
        from pulsewright.verify.kernels import compare_path

        distance, runs = np.zeros(len(tool)), self._reference.runs
        if len(self._end):
            move = runs.move[run]
            compare_path(
                tool,
                self._before,
                runs.since(run),
                move,
                runs.until(run),
                self.quantum + ROUNDING + (runs.tolerance[run] + self._slack[move]),
                self.quantum,
                cycle,
                self._reference.grid,
                self.columns.start,
                self._start,
                self._end,
                self._plane,
                self._center,
                self._row,
                self._arc,
                self._length,
                self._span,
                self._state,
                self._worst,
                self._covered,
                distance,
            )
        return distance

    def check(self) -> Check:
        """Return the check of distances."""
        ratio, distance, allowed, cycle = self._worst.tolist()
        bound = allowed if ratio > 0 else self.quantum
        following, dt = self._reference.tolerances.following, self._reference.dt
        return Check(
            f"path{self.suffix}",
            f"distance of {self.axes} from the programmed path",
            self.unit,
            distance,
            bound,
            "most",
            ratio <= 1.0,
            where=self.axes,
            detail=f"{self.quantum:.4f} for {following:g} steps of every motor, the rest for "
            f"rounded corners near; looked at every {dt * 1e3:g} ms",
            **self._reference.place(cycle),
        )

    def coverage_check(self, bulge: float) -> Check:
        """Return the check that the end of every move was passed.

        ``bulge`` is how far the path may leave the straight line between two instants looked at.
        """
        moves, runs = self._reference.moves, self._reference.runs
        bound = self.quantum + ROUNDING + bulge + self._needed
        covered = np.sqrt(self._covered)
        missed = int((covered > bound).sum())
        worst: float | None = None
        allowed, place = self.quantum, dict[str, Any]()
        if len(moves):
            i = int(np.argmax(covered / bound))
            worst = float(covered[i]) if np.isfinite(covered[i]) else None
            allowed = float(bound[i])
            x, y, z = self._end[i, :3].tolist()
            due = min(int(np.searchsorted(runs.move, i)), len(runs.move) - 1)
            place = {
                "time": float(runs.start[due + 1]),
                "line": int(moves.line[i]),
                "position": (x, y, z),
            }
        return Check(
            f"coverage{self.suffix}",
            f"distance at which {self.axes} pass the end of a move",
            self.unit,
            worst,
            allowed,
            "most",
            missed == 0,
            where=self.axes,
            detail=f"{missed} of {len(moves)} ends not passed; {self.quantum:.4f} for steps, "
            f"{bulge:.2g} between instants, the rest for the rounded corner",
            **place,
        )


def _arcs(moves: Moves, starts: Floats, arcs: Ints) -> Floats:
    """Return (n, 5) what `kernels.arc_distance2` needs of each of some moves."""
    columns = np.zeros((len(arcs), 5))
    for plane in Plane:
        rows = np.flatnonzero(moves.plane[arcs] == plane)
        which = arcs[rows]
        near, far = (
            (points[which] - moves.center[which])[:, plane.axes]
            for points in (starts[:, :3], moves.end[:, :3])
        )
        columns[rows] = np.stack(
            [
                np.arctan2(near[:, 1], near[:, 0]),
                moves.sweep[which],
                np.hypot(near[:, 0], near[:, 1]),
                np.hypot(far[:, 0], far[:, 1]),
                moves.end[which, plane] - starts[which, plane],
            ],
            axis=1,
        )
    return columns
