"""Look-ahead planning: from moves to a trajectory that keeps every limit.

1. *Geometry*: at each corner where the program allows a deviation, a parabola (a cubic next to an
   arc) replaces the corner, tangent to the path at both ends; see `path.blends`.
2. *Speeds*: a backward and a forward pass find the fastest speeds at the ends of all elements with
   piecewise constant path acceleration; see `plan_kernels.speeds`. Speed changes on blends too, so
   curves made of short chords are driven like the curves they stand for.
3. *Time law*: pieces of constant path acceleration; velocity is continuous everywhere.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pulsewright.motion.certificate import Certificate, certify
from pulsewright.motion.machine import Machine
from pulsewright.motion.moves import Moves
from pulsewright.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from pulsewright.motion.path import Limits, Segments

__all__ = ["Certificate", "begin_times", "certify", "plan"]

MARGIN = 1e-7  # of feeds and limits, for rounding on the shortest pieces and in late times


def plan(moves: Moves, machine: Machine) -> Trajectory:
    """Plan the fastest motion along ``moves`` within feeds, limits and tolerances.

    Velocity and acceleration of each of the machine's limit rows stay within bounds, the path
    within each move's tolerance (in mm for X, Y, Z; the same number of degrees for A, B, C), and
    velocity has no jump. The machine rests at the end of moves with tolerance 0, at dwells and
    reversals, and at the end.

    Every element's ``move`` is the last move it stands for. A dwell has an element of its own, of
    length 0.

    Raises
    ------
    MotionLimitError
        If a move leaves the travel of the machine.
    """
    from pulsewright.motion import path, plan_kernels  # compiled on first use

    machine.check_travel(moves)
    limits = path.Limits(*(column for column in _limits(machine)))
    elements = path.elements(*_blended(moves, limits))
    grid, bounds = plan_kernels.cells(elements, limits)
    b, a, _ = plan_kernels.speeds(grid, bounds, limits)
    element, start, law = plan_kernels.law(elements, grid, b, a)
    return Trajectory(*elements[:6], element, start, law)


def _limits(machine: Machine) -> tuple[NDArray[np.float64], ...]:
    rows, velocity, acceleration = machine.limit_rows()
    slack = 1 - MARGIN
    return rows, velocity * slack, acceleration * slack, machine.jerk_limits() * slack


def _blended(
    moves: Moves, limits: Limits
) -> tuple[Segments, *tuple[NDArray[np.float64], ...], NDArray[np.bool_]]:
    """Return the segments of the path, the blends between them, and the rests."""
    from pulsewright.motion import path

    kept, tolerance = path.kept_moves(
        moves.start, moves.kind, moves.end, moves.sweep, moves.dwell, moves.tolerance
    )
    if len(kept):
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
        last, tolerance = path.merged(segments, limits)
        if len(last) < len(kept):
            segments = path.traced(*columns, kept[last], tolerance, limits)
    else:  # nothing moves: one rest of no time
        nowhere, zero = np.zeros((1, 6)), np.zeros(1)
        segments = path.Segments(
            np.stack([moves.start[None], nowhere], axis=1),
            *(nowhere, nowhere, zero, zero, np.zeros(1, np.int64)),
            *(zero, zero, zero, zero, zero),
        )
    return segments, *path.blends(segments, limits)


def begin_times(trajectory: Trajectory, count: int) -> NDArray[np.float64]:
    """Return when each of ``count`` moves begins, and the duration as last entry [s].

    Exact where the machine rests before the move, as it does before every event of a program;
    moves that were merged begin together, and a blend counts to the move before its corner.
    """
    first = np.searchsorted(trajectory.move[trajectory.element], np.arange(count + 1))
    return trajectory.start[np.minimum(first, len(trajectory.element))]
