"""Look-ahead planning: from moves to a trajectory that keeps every limit.

1. *Geometry*: at each corner where the program allows a deviation, and where a line meets an arc, a
   displacement makes position, tangent and curvature continuous; see `path.blends`.
2. *Speeds*: the second-order optimum of this path, lowered where speeds would change faster than
   the jerk allows; see `plan_kernels.speeds`. Speed changes on blends too, so curves made of short
   chords are driven like the curves they stand for.
3. *Time law*: pieces of constant path jerk; acceleration is continuous everywhere.

No speed is trusted: the law of every cell is checked against the limits of all axes, and planned
again with tighter ones where it breaks them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import uncompiled
from pulsewright.motion.certificate import Certificate, certify
from pulsewright.motion.machine import Machine
from pulsewright.motion.moves import MoveKind, Moves, Plane
from pulsewright.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from pulsewright.motion.path import Elements, Limits, Segments

__all__ = ["Certificate", "begin_times", "certify", "plan"]

MARGIN = 1e-7  # of feeds and limits, for rounding on the shortest pieces and in late times


def plan(moves: Moves, machine: Machine) -> Trajectory:
    """Plan the fastest motion along ``moves`` within feeds, limits and tolerances.

    Velocity, acceleration and jerk of each of the machine's limit rows stay within bounds, the path
    within each move's tolerance (in mm for X, Y, Z; the same number of degrees for A, B, C), and
    acceleration has no jump. The machine rests at the end of moves with tolerance 0, at dwells and
    reversals, and at the end.

    Every element's ``move`` is the last move it stands for. A dwell has an element of its own, of
    length 0.

    Raises
    ------
    MotionLimitError
        If a move leaves the travel of the machine.
    UsageError
        If the moves cannot be as they are, see `Moves.require_sound`.
    """
    from pulsewright.motion import plan_kernels

    moves.require_sound()
    machine.check_travel(moves)
    with uncompiled(len(moves)):
        elements, limits = blended_path(moves, machine)
        grid = plan_kernels.cells(elements, limits, 0.0)
        b, a, split, _ = plan_kernels.speeds(elements, limits, grid, 0.0, 0.0)
        cells = grid.element, grid.offset, grid.size
        return Trajectory(*elements[:6], *plan_kernels.law(elements, *cells, b, a, split))


def blended_path(moves: Moves, machine: Machine) -> tuple[Elements, Limits]:
    """Return the path with blends, and the limits that hold on it."""
    from pulsewright.motion import path

    found = window(moves, machine)
    if found is None:  # nothing moves: one rest of no time
        nowhere, zero, never = np.zeros((1, 6)), np.zeros(1), np.zeros(1, np.int32)
        poly = np.stack([moves.start[None], nowhere, nowhere, nowhere], axis=1)
        rest = path.Elements(
            *(poly, nowhere, nowhere, zero, zero, never, zero, zero, np.ones(1, np.bool_))
        )
        return rest, path.Limits(*_limits(machine, moves))
    segments, limits, _ = found
    return path.elements(segments, *path.blends(segments, limits)), limits


def _limits(machine: Machine, moves: Moves) -> tuple[NDArray[np.float64], ...]:
    """Return rows that the moves use, and their limits."""
    rows, *limits = *machine.limit_rows(), machine.jerk_limits()
    moving = (np.diff(moves.end, axis=0, prepend=moves.start[None]) != 0).any(axis=0)
    arcs = moves.kind == MoveKind.ARC
    for plane in Plane:
        moving[list(plane.axes)] |= (arcs & (moves.plane == plane)).any()
    used = (rows[:, moving] != 0).any(axis=1)
    return rows[used], *(limit[used] * (1 - MARGIN) for limit in limits)


def window(moves: Moves, machine: Machine) -> tuple[Segments, Limits, NDArray[np.int64]] | None:
    """Return the segments of the path, limits on it, and the moves that do something.

    Chords have replaced runs of short segments. None if nothing moves.
    """
    from pulsewright.motion import path

    limits = path.Limits(*_limits(machine, moves))
    kept, tolerance = path.kept_moves(
        moves.start, moves.kind, moves.end, moves.sweep, moves.dwell, moves.tolerance
    )
    if not len(kept):
        return None
    columns = (
        moves.start,
        moves.kind,
        moves.plane,
        moves.end,
        moves.center,
        moves.sweep,
        np.where(moves.rapid, np.inf, moves.feed * (1 - MARGIN)),
        moves.dwell,
    )
    segments = path.traced(*columns, kept, tolerance, limits)
    feeds = ~moves.rapid & (moves.pitch == 0)
    collapse = np.where(feeds, moves.collapse, 0.0)
    last, tolerance = path.merged(segments, collapse[kept], limits)
    if len(last) < len(kept):
        segments = path.traced(*columns, kept[last], tolerance, limits)
    return segments, limits, kept


def begin_times(trajectory: Trajectory, count: int) -> NDArray[np.float64]:
    """Return when each of ``count`` moves begins, and the duration as last entry [s].

    Moves that were merged begin together, and a blended one in the middle of the blend before it.
    """
    first = np.searchsorted(trajectory.move[trajectory.element], np.arange(count + 1))
    return trajectory.start[np.minimum(first, len(trajectory.element))]
