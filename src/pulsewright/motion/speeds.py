"""Speeds of a whole path: states at the nodes between its cells.

Plans of parts of it (see `fit`, and `line_law` for lines) are checked against the limits, repaired
where they break one, and refined where they lose much time. What the names and the limits of a cell
are is said in `cell_law`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import compiled, inner
from pulsewright.motion.cell_law import (
    ROUNDING,
    Cells,
    Task,
    cap_of,
    keeps_limits,
    limits_used,
    two_pieces,
)
from pulsewright.motion.fit import best_of, fit
from pulsewright.motion.line_law import LINE_JERK, straighten
from pulsewright.motion.path import Elements, Floats, Ints, Limits
from pulsewright.motion.refine import WINDOW, Window, refine, window_of

SHORT = 7  # cells from rest to rest: better tighten limits at first
GENTLE = 3  # rounds of that
PATIENCE = 9  # rounds before the speed is made steady there
REPAIRS = 24  # rounds of tightening the limits where the law breaks them
SPLITS = (0.35, 0.65, 0.2, 0.8)  # where the two pieces of a cell may meet, besides its middle
BRIDGES = (1, 2, 3, 5)  # cells on both sides of a broken one that change with it
LINE_SOFT = 0.8  # the same while speeds are raised
MATTERS = 0.005  # of a run's time, lost to the second-order optimum
WORTH = 0.03  # of a window's time, lost the same way
SMALLEST = 16  # cells, where larger windows find nothing better
FULL = 1.0 - 1e-6  # of the square of the largest speed: such a state stays


@compiled(error_model="numpy")
def speeds(
    path: Elements, limits: Limits, grid: Cells, square: float, slope: float
) -> tuple[Floats, Floats, Floats, Ints]:
    """Return ``b`` and ``a`` at the nodes, (n + 1,), splits of cells, and what was repaired.

    From rest to rest: the second-order optimum, then what the jerk takes from it, see `fit`. Where
    the law of a cell breaks a limit, one law is led over more cells, see `_bridged`. If that does
    not help, limits are tightened there and the speeds around it are planned again; a run that does
    not come to an end is slowed down as a whole. At last, speeds are raised where that saves
    enough, see `refine`: shares of the jerk were estimates. Cells of lines change their sizes, see
    `line_law`.

    ``square`` and ``slope`` are b and a at the first node, 0 at rest. What begins in motion cannot
    be slowed down as a whole; where that would be needed, the last number of repairs is negative.
    """
    n = grid.size.size
    b, a = np.zeros(n + 1), np.zeros(n + 1)
    task = Task(
        grid, np.zeros(n), np.ones(n), np.ones(n), np.empty(n), np.empty(n),
        np.full(n, 0.5), np.empty(n + 1, np.int64), np.empty((6, n + 8)),
    )  # fmt: skip
    window = window_of(limits.velocity.size)
    best = np.empty(n + 1)
    repaired = np.zeros(3, np.int64)
    broken = np.zeros(n, np.bool_)
    for c in range(n):
        if grid.size[c] > 0.0:
            task.cap[c] = cap_of(grid.share[grid.row[c]], grid.rows[grid.row[c]])
    b[0], a[0] = square, slope
    first = 0
    while first < n:
        last = first
        while not grid.rest[last]:
            last += 1
        last += 1  # nodes first..last, cells first..last - 1
        if grid.size[first] > 0.0:
            short = last - first <= SHORT
            for c in range(first, last):
                broken[c] = True  # nothing is planned yet
            left = last - first
            for trial in range(REPAIRS + 1):
                if left == 0:
                    break
                left = 0
                c = first
                reach = 4 << min(trial, max(5, trial - 8))
                while c < last:
                    if not broken[c]:
                        c += 1
                        continue
                    low, high = max(first, c - reach), c + 1
                    while c < min(last, high + reach):
                        if broken[c]:
                            high = c + 1
                        c += 1
                    high = min(last, high + reach)
                    if trial > 0:
                        repaired[0] += 1
                        repaired[1] += high - low
                    fit(task, b, a, low, high)
                    bridge = not short or trial > GENTLE
                    left += _check(task, b, a, low, high, broken, trial, bridge)
                    c = high
            if left > 0 and b[first] > 0.0:
                repaired[2] = -1
                break
            if left > 0:
                repaired[2] += 1
                _slow_down(task, b, a, first, last)
            if trial > 1:  # repairs leave lines slower than they can be
                straighten(task, b, a, first, last, LINE_JERK)
            best_of(task, best, b, first, last)
            _raise(task, window, path, limits, best, b, a, first, last)
        first = last
    return b, a, task.split, repaired


@inner
def _check(
    task: Task,
    b: Floats,
    a: Floats,
    first: int,
    last: int,
    broken: NDArray[np.bool_],
    trial: int,
    bridge: bool,
) -> int:
    """Find the cells whose law breaks a limit, tighten limits there, and return how many."""
    count, cells, v0 = 0, task.cells, math.sqrt(b[first])
    for c in range(first, last):
        v1 = math.sqrt(b[c + 1])
        _, v, s, j = limits_used(cells, c, v0, v1, a[c], a[c + 1], task.split[c])
        broken[c] = not max(v, s, j) <= 1.0 + ROUNDING
        v0 = v1
    for c in range(first, last):
        if not broken[c]:
            continue
        if bridge and _bridged(task, b, a, first, last, c, broken):
            continue
        count += 1
        if trial >= PATIENCE:  # drive steadily there: that needs neither acceleration nor jerk
            wide = trial - PATIENCE + 2
            begin, end = max(first, c - wide), min(last, c + 1 + wide)
            level = math.inf
            for i in range(begin, end + 1):
                level = min(level, b[i])
            for near in range(begin, end):
                task.soft[near] *= 0.9
                task.ease[near] = min(task.ease[near], max(0.95 * level / task.cap[near], 1e-3))
            continue
        _, v, s, j = limits_used(
            cells, c, math.sqrt(b[c]), math.sqrt(b[c + 1]), a[c], a[c + 1], 0.5
        )
        for near in range(max(first, c - 1), min(last, c + 2)):
            if not j <= 1.0 + ROUNDING:
                task.soft[near] *= max(0.6, 0.95 / j)
                if trial > 1:  # bending alone may take too much of it
                    task.ease[near] *= max(0.9, 0.99 / j)
            else:
                task.ease[near] *= 0.99 / max(v * v, s)
    return count


@inner
def _bridged(
    task: Task,
    b: Floats,
    a: Floats,
    first: int,
    last: int,
    c: int,
    broken: NDArray[np.bool_],
) -> bool:
    """Lead one law of two pieces over ever more cells around a broken one, until limits hold."""
    cells, size, split = task.cells, task.cells.size, task.split
    for share in SPLITS:
        if keeps_limits(cells, b, a, c, share):
            split[c], broken[c] = share, False
            return True
    keep, hold, part = task.work[0], task.work[1], task.work[2]
    for reach in BRIDGES:
        for side in range(3):  # both, or one of them: on the other the feed may be less
            low = max(first, c - reach) if side < 2 else c
            high = min(last, c + 1 + reach) if side != 1 else c + 1
            total = 0.0
            for i in range(low, high):
                total += size[i]
                keep[i], hold[i], part[i] = b[i], a[i], split[i]
            v0, v1 = math.sqrt(b[low]), math.sqrt(b[high])
            for way in range(3):
                share = 0.5 + 0.2 * (way if way < 2 else -1)
                time, middle, _, _ = two_pieces(v0, v1, a[low], a[high], total, share)
                if time > 0.0 and _spread(task, b, a, low, high, time, middle, share):
                    for i in range(low, high):
                        broken[i] = False
                    return True
                for i in range(low, high):
                    b[i], a[i], split[i] = keep[i], hold[i], part[i]
    return False


@inner
def _spread(
    task: Task, b: Floats, a: Floats, low: int, high: int, time: float, middle: float, share: float
) -> bool:
    """Put the states of one law over several cells into their nodes; return whether limits hold."""
    cells, size, split = task.cells, task.cells.size, task.split
    v0, a0 = math.sqrt(b[low]), a[low]
    turn = share * time
    j0, j1 = (middle - a0) / turn, (a[high] - middle) / (time - turn)
    vm = v0 + 0.5 * turn * (a0 + middle)
    x, t = -((v0 + (0.5 * a0 + j0 * (1 / 6) * turn) * turn) * turn), -turn  # from the turn on
    for c in range(low, high):
        x += size[c]
        before, v, j = t, 0.0, j1
        if c + 1 < high:
            j = j0 if x < 0.0 else j1
            v = math.sqrt(b[c])
            t = min(t + (size[c] / v if v > 0.0 else 0.5 * (time - turn - t)), time - turn)
            for _ in range(6):
                v = vm + (middle + 0.5 * j * t) * t
                if v <= 0.0:
                    return False
                over = (vm + (0.5 * middle + j * (1 / 6) * t) * t) * t - x
                t -= over / v
                if abs(over) <= 1e-12 * size[c]:
                    break
            v = vm + (middle + 0.5 * j * t) * t
            if v <= 0.0 or t <= before:
                return False
            b[c + 1], a[c + 1] = v * v, middle + j * t
        else:
            t = time - turn
        split[c] = 0.5
        if before < 0.0 < t:
            split[c] = min(max(-before / (t - before), 0.05), 0.95)
        if not keeps_limits(cells, b, a, c, split[c]):
            return False
    return True


@inner
def _slow_down(task: Task, b: Floats, a: Floats, first: int, last: int) -> None:
    """Let time pass more slowly from rest to rest, such that all limits hold.

    Where a cell has no law from one state to the other, it has none at any speed; then the speed is
    steady at all nodes, between which there is always one.
    """
    for steady in range(2):
        worst, solved = 1.0, True
        if steady == 1:
            for i in range(first + 1, last):
                a[i] = 0.0
        for c in range(first, last):
            task.split[c] = 0.5
            v0, v1 = math.sqrt(b[c]), math.sqrt(b[c + 1])
            time, v, s, j = limits_used(task.cells, c, v0, v1, a[c], a[c + 1], 0.5)
            solved &= time > 0.0
            worst = max(worst, v, math.sqrt(s), j ** (1 / 3))
        if solved:
            break
    for i in range(first, last + 1):
        b[i] /= worst * worst
        a[i] /= worst * worst


@inner
def _raise(
    task: Task,
    window: Window,
    path: Elements,
    limits: Limits,
    best: Floats,
    b: Floats,
    a: Floats,
    first: int,
    last: int,
) -> None:
    """Raise speeds of a run where b is far below ``best``, its second-order optimum; see `refine`.

    Lines there have less jerk meanwhile: where a limit is used up, there is no way to begin.
    """
    cells, row, share = task.cells, task.cells.row, task.cells.share
    whole, lost = _loss(cells, best, b, first, last)
    if lost < MATTERS * whole:
        return
    begin, most = first, WINDOW
    while begin < last:
        end = begin + 1
        while end < min(last, begin + most):
            pace = max(share[row[end - 1], 0, 0], share[row[end], 0, 0])
            if b[end] * pace * pace >= FULL:
                break
            end += 1
        whole, lost = _loss(cells, best, b, begin, end)
        done = end == begin + 1 or lost <= WORTH * whole
        if not done:
            low, high = begin, end  # and the lines that begin before it, or end after it
            while low > first and row[low - 1] == row[low]:
                low -= 1
            while high < last and row[high - 1] == row[high]:
                high += 1
            straighten(task, b, a, low, high, LINE_SOFT)
            done = refine(window, path, limits, cells, task.split, b, a, begin, end)
            straighten(task, b, a, low, high, LINE_JERK)
        most = WINDOW if done else (end - begin) // 2  # perhaps only some cells are in the way
        if done or most < SMALLEST:
            begin, most = end, WINDOW


@inner
def _loss(cells: Cells, best: Floats, b: Floats, first: int, last: int) -> tuple[float, float]:
    """Return about the time of some cells, and how much less it is with ``best``."""
    whole, less = 0.0, 0.0
    for c in range(first, last):
        size = 2.0 * cells.size[c]
        whole += size / (math.sqrt(b[c]) + math.sqrt(b[c + 1]))
        less += size / (math.sqrt(best[c]) + math.sqrt(best[c + 1]))
    return whole, whole - less
