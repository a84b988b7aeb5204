"""The compiled loop of `hold`."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import compiled

LOOKS: Final = 12  # at the limits, on the way back to a constant rate
BISECTIONS: Final = 12
NOISE: Final = 1e-9

Floats = NDArray[np.float64]


@compiled(inline="always")
def allowed(
    velocity: Floats,
    acceleration: Floats,
    jerk: Floats,
    most: Floats,
    most_jerk: Floats,
    i: int,
    rate: float,
    bend: float,
    change: float,
) -> bool:
    """Tell whether all rows keep their limits at point ``i`` of the plan."""
    for row in range(most.size):
        v, a, j = velocity[i, row], acceleration[i, row], jerk[i, row]
        own = abs(a) * rate**2
        if abs(a * rate**2 + v * bend) > max(most[row], own) * (1.0 + NOISE):
            return False
        own = abs(j) * rate**3
        if abs(j * rate**3 + 3.0 * a * rate * bend + v * change) > max(most_jerk[row], own) * (
            1.0 + NOISE
        ):
            return False
    return True


@compiled()
def safe(
    velocity: Floats,
    acceleration: Floats,
    jerk: Floats,
    most: Floats,
    most_jerk: Floats,
    step: float,
    back: float,
    sigma: float,
    rate: float,
    bend: float,
) -> bool:
    """Tell whether ``bend`` can become 0 by ``back`` within the limits, before the rate is 0."""
    if rate - bend**2 / (2.0 * back) < -NOISE:
        return False
    last = velocity.shape[0] - 1
    whole = -bend / back
    for k in range(LOOKS + 1):
        t = whole * k / LOOKS
        s = sigma + t * (rate + t * (bend / 2.0 + t * back / 6.0))
        r, b = rate + t * (bend + t * back / 2.0), bend + t * back
        i = int(s / step)
        if i >= last:
            return True
        for j in (i, i + 1):  # the jerk may jump between them
            if not allowed(velocity, acceleration, jerk, most, most_jerk, j, r, b, back):
                return False
    return True


@compiled()
def brake(
    velocity: Floats,
    acceleration: Floats,
    jerk: Floats,
    most: Floats,
    most_jerk: Floats,
    step: float,
    back: float,
    nodes: Floats,
) -> int:
    """Fill ``nodes`` with moments u, plan times sigma and their two derivatives; return how many.

    Parameters
    ----------
    velocity, acceleration, jerk : (n, rows) float64
        Of the plan, each ``step`` seconds from where it is left, to a rest or further than needed.
    most, most_jerk : (rows,) float64
        Limits.
    step : float
        Of u, too [s].
    back : float
        Largest change of the second derivative [1/s^2], 3rd derivative.
    nodes : (m, 4) float64

    Returns
    -------
    int
        0 if the machine does not come to rest within these points.
    """
    last = (velocity.shape[0] - 1) * step
    moves = (velocity[-1] != 0.0).any()
    u, sigma, rate, bend = 0.0, 0.0, 1.0, 0.0
    nodes[0, 0], nodes[0, 1], nodes[0, 2], nodes[0, 3] = u, sigma, rate, bend
    for n in range(1, nodes.shape[0] - 1):
        if rate <= back * step**2:  # the last of it: a parabola that ends with the rate
            t = 2.0 * rate / -bend if -bend * step > rate else step
            nodes[n, 0], nodes[n, 1] = u + t, sigma + rate * t / 3.0
            nodes[n, 2], nodes[n, 3] = 0.0, 0.0
            return n + 1
        low, high = -back, min(back, -bend / step)
        for k in range(BISECTIONS + 1):
            change = low if k == 0 else (low + high) / 2.0
            s = sigma + step * (rate + step * (bend / 2.0 + step * change / 6.0))
            r, b = rate + step * (bend + step * change / 2.0), bend + step * change
            i = min(int(sigma / step), velocity.shape[0] - 2)
            if (
                r >= 0.0
                and allowed(velocity, acceleration, jerk, most, most_jerk, i, rate, bend, change)
                and allowed(velocity, acceleration, jerk, most, most_jerk, i + 1, r, b, change)
                and safe(velocity, acceleration, jerk, most, most_jerk, step, back, s, r, b)
            ):
                high = change
                if k == 0:
                    break
            elif k > 0:
                low = change
        change = high
        sigma += step * (rate + step * (bend / 2.0 + step * change / 6.0))
        rate += step * (bend + step * change / 2.0)
        bend = min(bend + step * change, 0.0)
        u += step
        nodes[n, 0], nodes[n, 1], nodes[n, 2], nodes[n, 3] = u, sigma, rate, bend
        if sigma >= last:
            return 0 if moves else n + 1
    return 0
