"""Look-ahead planning: from moves to a trajectory that keeps every limit.

1. *Geometry*: at each corner where the program allows a deviation, and where a line meets an arc, a
   displacement makes position, tangent and curvature continuous; see `path.blended`.
2. *Speeds*: the second-order optimum of this path, lowered where speeds would change faster than
   the jerk allows; see `speeds`. Speed changes on blends too, so curves made of short
   chords are driven like the curves they stand for. Where that loses much time, an interior-point
   method gets most of it back; see `refine`.
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
from pulsewright.motion.moves import Moves
from pulsewright.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from pulsewright.motion.path import Elements, Limits

__all__ = ["Certificate", "begin_times", "certify", "plan"]


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
    from pulsewright.motion.cells import cells
    from pulsewright.motion.law import law
    from pulsewright.motion.speeds import speeds

    moves.require_sound()
    machine.check_travel(moves)
    with uncompiled(len(moves)):
        elements, limits = blended_path(moves, machine)
        grid = cells(elements, limits, 0.0)
        b, a, split, _ = speeds(elements, limits, grid, 0.0, 0.0)
        at = grid.element, grid.offset, grid.size
        return Trajectory(*elements[:6], *law(elements, *at, b, a, split))


def blended_path(moves: Moves, machine: Machine) -> tuple[Elements, Limits]:
    """Return the path with blends, and the limits that hold on it."""
    from pulsewright.motion import path

    elements, limits, kept, _ = blended(moves, machine)
    if len(kept):
        return elements, limits
    # nothing moves: one rest of no time
    nowhere, zero, never = np.zeros((1, 6)), np.zeros(1), np.zeros(1, np.int32)
    poly = np.stack([moves.start[None], nowhere, nowhere, nowhere], axis=1)
    rest = np.ones(1, np.bool_)
    return path.Elements(poly, nowhere, nowhere, zero, zero, never, zero, zero, rest), limits


def blended(
    moves: Moves, machine: Machine
) -> tuple[Elements, Limits, NDArray[np.int64], NDArray[np.int64]]:
    """Return what `path.blended` does: without elements if nothing moves."""
    from pulsewright.motion import path

    columns = path.Columns(*(getattr(moves, name) for name in path.Columns._fields))
    return path.blended(columns, *machine.limit_rows(), machine.jerk_limits())


def begin_times(trajectory: Trajectory, count: int) -> NDArray[np.float64]:
    """Return when each of ``count`` moves begins, and the duration as last entry [s].

    Moves that were merged begin together, and a blended one in the middle of the blend before it.
    """
    first = np.searchsorted(trajectory.move[trajectory.element], np.arange(count + 1))
    return trajectory.start[np.minimum(first, len(trajectory.element))]
