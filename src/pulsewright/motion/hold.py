"""Feed hold: a plan that is left on its own path, and comes to rest there within the limits.

The path stays; only its time passes ever slower. With sigma(u) the plan's time at time u of the
machine, r = sigma' its rate, which falls from 1 to 0, and b = sigma'' never above 0, an axis at
x(sigma) has

    velocity x' r,    acceleration x'' r^2 + x' b,    jerk x''' r^3 + 3 x'' r b + x' sigma'''

so velocity never exceeds the plan's. `hold_kernel` chooses sigma''' step by step, as low as leaves
a way back to a constant rate that keeps all limits; a constant rate of 1 or less always keeps them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.motion.trajectory import Trajectory

HEADROOM: Final = 0.995  # of limits, as the plan is looked at in steps
SHARES: Final = (0.9, 0.5, 0.25)  # of the jerk limit, for changes of b; the quickest stop is taken
STEPS: Final = 400  # of a stop, about
SHORTEST_STEP: Final = 2e-5  # [s]
LONGEST_STEP: Final = 2e-3
SUDDEN: Final = 4  # steps in which b may do all that an axis without a jerk limit can
STILL: Final = 1e-6  # of the largest path velocity: rest
HALVINGS: Final = 50

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class AxisLimits:
    """What combinations of motors may do while a plan is left.

    Parameters
    ----------
    rows : (r, motors) float64
        Combinations of motors: an axis [mm] of motors [step], or a motor itself.
    accelerations : (r,) float64
        Largest along each row [mm/s^2, step/s^2].
    jerks : (r,) float64
        Likewise; inf where there is no limit.
    """

    rows: Floats
    accelerations: Floats
    jerks: Floats

    @classmethod
    def of_motors(cls, accelerations: Sequence[float], jerks: Sequence[float]) -> AxisLimits:
        """Return limits of motors by themselves [step/s^2, step/s^3]."""
        return cls(np.eye(len(accelerations)), *np.array([accelerations, jerks], float))


def hold(plan: Trajectory, time: float, limits: AxisLimits) -> tuple[Trajectory, float]:
    """Return a plan that is left at ``time`` [s] and comes to rest on its path, and where.

    Acceleration and jerk stay within ``limits``, or within what the plan itself has there. Up to
    ``time`` it is the same plan, piece by piece. It ends at the next rest of the plan at the
    latest.

    Parameters
    ----------
    plan : Trajectory
    time : float
        When to begin [s].
    limits : AxisLimits

    Returns
    -------
    Trajectory
        Of the motors, to rest.
    float
        Time of ``plan`` at which it was where that one rests [s].
    """
    time = max(time, 0.0)
    if time >= plan.duration:
        return plan, plan.duration
    fastest = float(abs(plan.law[:, 1]).max(initial=0.0))
    here = int(np.searchsorted(plan.start, time, "right")) - 1
    resting = np.flatnonzero(abs(plan.law[here + 1 :, 1]) <= STILL * fastest)
    end = float(plan.start[here + 1 + resting[0]]) if len(resting) else plan.duration
    velocity = plan.at(time, 1)[0]
    if not velocity.any():  # in a dwell, or where the plan turns
        return _cut(plan, time, here), time
    u, sigma, rate, bend = _brake(plan, time, end, limits)
    return _warped(plan, time, here, u, sigma, rate, bend), float(sigma[-1])


def _brake(
    plan: Trajectory, time: float, end: float, limits: AxisLimits
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return moments u from 0 on, plan times, and their first two derivatives there."""
    from pulsewright.motion.hold_kernel import brake  # numba: on first use only

    speeds = abs(plan.at(time, 1) @ limits.rows.T)[0]
    reach = 2 * float((speeds / limits.accelerations).max())
    soft = np.isfinite(limits.jerks)
    reach += 4 * float((limits.accelerations[soft] / limits.jerks[soft]).max(initial=0.0))
    while True:
        step = min(max(reach / 2 / STEPS, SHORTEST_STEP), LONGEST_STEP)
        grid = np.arange(math.ceil(min(reach, end - time) / step) + 2) * step
        at = np.minimum(time + grid, end)
        planned = [plan.at(at, k) @ limits.rows.T for k in (1, 2, 3)]
        jerks = np.minimum(limits.jerks, limits.accelerations / (SUDDEN * step))
        best = None
        for share in SHARES:
            with np.errstate(divide="ignore"):
                change = share * float((jerks / abs(planned[0]).max(axis=0)).min())
            nodes = np.zeros((4 * len(grid) + 8 * STEPS, 4))
            most, most_jerk = HEADROOM * limits.accelerations, HEADROOM * jerks
            used = brake(planned[0], planned[1], planned[2], most, most_jerk, step, change, nodes)
            if used and (best is None or nodes[used - 1, 0] < best[-1, 0]):
                best = nodes[:used]
        if best is not None:
            u, sigma, rate, bend = best.T
            return u, np.minimum(time + sigma, end), rate, bend
        if time + reach >= end:  # as slowly as ever: to the end of the path
            return np.array([0.0, end - time]), np.array([time, end]), np.ones(2), np.zeros(2)
        reach *= 2


def _cut(plan: Trajectory, time: float, here: int) -> Trajectory:
    """Return a plan that ends at ``time``, on piece ``here``, where it rests."""
    start = np.append(plan.start[: here + 1], time)
    return plan.timed(plan.element[: here + 1], start, plan.law[: here + 1])


def _warped(
    plan: Trajectory,
    time: float,
    here: int,
    u: Floats,
    sigma: Floats,
    rate: Floats,
    bend: Floats,
) -> Trajectory:
    """Return the plan up to ``time``, then its path with plan times ``sigma`` at moments ``u``.

    Pieces end at these moments and where those of the plan do; they are cubics with the same
    positions and velocities at their ends.
    """
    bounds = plan.start[(plan.start > time) & (plan.start < sigma[-1])]
    j = np.clip(np.searchsorted(sigma, bounds, "right") - 1, 0, len(u) - 2)
    length = np.diff(u)[j]
    change = (np.diff(bend) / np.diff(u))[j]
    low, high = np.zeros(len(j)), length
    for _ in range(HALVINGS):
        t = (low + high) / 2
        below = sigma[j] + t * (rate[j] + t * (bend[j] / 2 + t * change / 6)) < bounds
        low, high = np.where(below, t, low), np.where(below, high, t)
    t = (low + high) / 2
    u = np.concatenate([u, u[j] + t])
    sigma = np.concatenate([sigma, bounds])
    rate = np.concatenate([rate, rate[j] + t * (bend[j] + t * change / 2)])
    order = np.lexsort([sigma, u])
    u, sigma, rate = u[order], np.maximum.accumulate(sigma[order]), rate[order]
    kept = np.append(np.diff(u) > 0, True)
    u, sigma, rate = u[kept], sigma[kept], rate[kept]

    k = np.clip(np.searchsorted(plan.start, sigma[:-1], "right") - 1, 0, len(plan.element) - 1)
    s, v = _path(plan, k, sigma[:-1])
    s_end, v_end = _path(plan, k, sigma[1:])
    v, v_end, h = v * rate[:-1], v_end * rate[1:], np.diff(u)
    rise = (s_end - s) / h
    law = np.stack([s, v, (3 * rise - 2 * v - v_end) / h, (v + v_end - 2 * rise) / h**2], axis=1)
    return plan.timed(
        np.concatenate([plan.element[: here + 1], plan.element[k]]),
        np.concatenate([plan.start[: here + 1], time + u]),
        np.concatenate([plan.law[: here + 1], law]),
    )


def _path(plan: Trajectory, k: NDArray[np.int64], time: Floats) -> tuple[Floats, Floats]:
    """Return path coordinate and its velocity on pieces ``k`` at times."""
    tau, law = time - plan.start[k], plan.law[k]
    s = ((law[:, 3] * tau + law[:, 2]) * tau + law[:, 1]) * tau + law[:, 0]
    return s, (3 * law[:, 3] * tau + 2 * law[:, 2]) * tau + law[:, 1]
