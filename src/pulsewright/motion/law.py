"""The time law of a whole path, from the states between its cells."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import compiled
from pulsewright.motion.cell_law import two_pieces
from pulsewright.motion.path import Elements, Floats, Ints


@compiled(error_model="numpy")
def law(
    path: Elements, at: Ints, offset: Floats, size: Floats, b: Floats, a: Floats, split: Floats
) -> tuple[NDArray[np.int32], Floats, Floats]:
    """Return the pieces of the trajectory: element, start and law of each.

    ``at``, ``offset`` and ``size`` are those of the cells.
    """
    n, m = size.size, path.length.size
    most = 2 * n + m + 1
    element, start, piece = np.empty(most, np.int32), np.empty(most + 1), np.empty((most, 4))
    start[0] = 0.0
    k, time, lost = 0, 0.0, 0.0  # compensated sum: errors do not grow
    for c in range(n):
        e, s = at[c], offset[c]
        if size[c] == 0.0:
            time += path.dwell[e]
            element[k], start[k + 1] = e, time
            piece[k, 0] = piece[k, 1] = piece[k, 2] = piece[k, 3] = 0.0
            k += 1
            continue
        after = at[c + 1] if c + 1 < n else m
        final = max(after - 1, e)  # the last element of the cell
        v0, v1 = math.sqrt(b[c]), math.sqrt(b[c + 1])
        whole, middle, vm, _ = two_pieces(v0, v1, a[c], a[c + 1], size[c], split[c])
        for half in range(2):
            v, x = (v0, a[c]) if half == 0 else (vm, middle)
            end = middle if half == 0 else a[c + 1]
            left = (split[c] if half == 0 else 1.0 - split[c]) * whole
            j = (end - x) / left
            while True:
                room = path.length[e] - s
                step = (v + (0.5 * x + j * (1 / 6) * left) * left) * left
                crossing = e < final and step > room * (1.0 - 1e-13)
                span = left
                if crossing:
                    span = min(room / v, left) if v > 0.0 else left
                    early, late = 0.0, left
                    for _ in range(60):
                        over = (v + (0.5 * x + j * (1 / 6) * span) * span) * span - room
                        if over < 0.0:
                            early = span
                        else:
                            late = span
                        before = span
                        span -= over / (v + (x + 0.5 * j * span) * span)
                        if not early <= span <= late:  # it would jump to and fro
                            span = 0.5 * (early + late)
                        if abs(span - before) <= 1e-15 * left:
                            break
                same = (
                    k > 0
                    and j == 0.0
                    and x == 0.0
                    and element[k - 1] == e
                    and piece[k - 1, 1] == v
                    and piece[k - 1, 2] == 0.0
                    and piece[k - 1, 3] == 0.0
                )
                step = span - lost
                now = time + step
                lost = (now - time) - step
                if same:
                    start[k] = now
                elif now > time:  # what rounding makes instantaneous is left out
                    element[k] = e
                    piece[k, 0], piece[k, 1] = s, v
                    piece[k, 2], piece[k, 3] = 0.5 * x, j * (1 / 6)
                    k += 1
                    start[k] = now
                time = now
                if not crossing:
                    s += (v + (0.5 * x + j * (1 / 6) * span) * span) * span
                    break
                v += (x + 0.5 * j * span) * span
                x += j * span
                left -= span
                e += 1
                s = 0.0
    return element[:k], start[: k + 1], piece[:k]
