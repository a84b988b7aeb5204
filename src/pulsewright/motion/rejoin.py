"""The way back to a plan that was left: return to it, and speed up along it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pulsewright.motion.trajectory import Trajectory

SHARE: Final = 0.1  # of the acceleration limit, for speeding up along the plan
PIECES: Final = 64  # of the time in which that is done


def rejoin(
    plan: Trajectory,
    time: float,
    position: ArrayLike,
    *,
    rates: Sequence[float],
    accelerations: Sequence[float],
) -> Trajectory:
    """Return the motion that completes a plan from a place beside it.

    It goes straight to where the plan is at ``time``, from rest to rest and within the limits. From
    there on it follows the plan's path to the end: first slower than the plan, with the plan's own
    time passing ever faster, then as the plan. Speeding up adds at most `SHARE` of the acceleration
    limits to what the plan has.

    Parameters
    ----------
    plan : Trajectory
    time : float
        Where to join it [s].
    position : (axes,) float
        Where the machine rests.
    rates, accelerations : sequence of float
        Limits of each axis, in its units per s and per s^2; not 0.
    """
    time = min(max(time, 0.0), plan.duration)
    begin = np.asarray(position, float)
    way = plan.at(time)[0] - begin
    rate, acceleration = np.asarray(rates, float), np.asarray(accelerations, float)
    first = int(np.clip(np.searchsorted(plan.start, time, "right") - 1, 0, len(plan.element) - 1))
    # 3 u^2 - 2 u^3 over a time T: at most 1.5 / T fast, with 6 / T^2
    back = max(
        1.5 * float((abs(way) / rate).max()), math.sqrt(6 * float((abs(way) / acceleration).max()))
    )
    start, law, element = [np.zeros(1)], [np.zeros((0, 4))], [np.zeros(0, np.int32)]
    if back > 0:
        start.append(np.array([back]))
        law.append(np.array([[0.0, 0.0, 3 / back**2, -2 / back**3]]))
        element.append(np.zeros(1, np.int32))
    if time < plan.duration:
        warp = float((rate / acceleration).max()) / SHARE
        ends, pieces, elements = _warped(plan, time, first, warp)
        start.append(back + ends)
        law.append(pieces)
        element.append(elements - plan.element[first] + 1)
    if len(start) == 1:  # there already, at the end
        start.append(np.zeros(1))
        law.append(np.zeros((1, 4)))
        element.append(np.zeros(1, np.int32))
    kept = slice(int(plan.element[first]), None)
    line = np.zeros((1, 4, plan.axes))
    line[0, 0], line[0, 1] = begin, way
    none = np.zeros((1, plan.axes))
    return replace(
        plan,
        poly=np.concatenate([line, plan.poly[kept]]),
        cosine=np.concatenate([none, plan.cosine[kept]]),
        sine=np.concatenate([none, plan.sine[kept]]),
        omega=np.concatenate([[0.0], plan.omega[kept]]),
        length=np.concatenate([[1.0], plan.length[kept]]),
        move=np.concatenate([plan.move[kept][:1], plan.move[kept]]),
        element=np.concatenate(element).astype(np.int32),
        start=np.concatenate(start),
        law=np.concatenate(law),
    )


def _warped(
    plan: Trajectory, time: float, first: int, warp: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int32]]:
    """Return end times, laws and elements of the plan's pieces from ``time`` on, from rest.

    At u < ``warp`` the plan's time is time + u^2 / (2 warp), later it passes as always. Pieces of
    the first part are split, and cubics with the same positions and velocities at their ends.
    """
    full = time + warp / 2  # time of the plan from which on it passes as always
    bounds = plan.start[(plan.start > time) & (plan.start < full)]
    inside = time + np.linspace(0, 1, PIECES + 1) ** 2 * warp / 2
    stop = min(full, plan.duration)
    slow = np.unique(np.concatenate([bounds, inside[inside < stop], [time, stop]]))
    u = np.sqrt(2 * warp * (slow - time))
    k = np.searchsorted(plan.start, slow[:-1], "right") - 1
    s, v = _path(plan, k, slow[:-1])
    s_end, v_end = _path(plan, k, slow[1:])
    v, v_end, h = v * u[:-1] / warp, v_end * u[1:] / warp, np.diff(u)
    rise = (s_end - s) / h
    hermite = [s, v, (3 * rise - 2 * v - v_end) / h, (v + v_end - 2 * rise) / h**2]
    ends, laws, elements = u[1:], np.stack(hermite, axis=1), plan.element[k]
    if full >= plan.duration:
        return ends, laws, elements
    k = np.arange(int(np.searchsorted(plan.start, full, "right")) - 1, len(plan.element))
    rest = plan.law[k].copy()
    tau = full - plan.start[k[0]]
    c0, c1, c2, c3 = rest[0]
    rest[0] = (
        ((c3 * tau + c2) * tau + c1) * tau + c0,
        (3 * c3 * tau + 2 * c2) * tau + c1,
        3 * c3 * tau + c2,
        c3,
    )
    return (
        np.concatenate([ends, plan.start[k + 1] - full + warp]),
        np.concatenate([laws, rest]),
        np.concatenate([elements, plan.element[k]]),
    )


def _path(
    plan: Trajectory, k: NDArray[np.int64], time: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return path coordinate and its velocity on pieces ``k`` at times."""
    tau, law = time - plan.start[k], plan.law[k]
    s = ((law[:, 3] * tau + law[:, 2]) * tau + law[:, 1]) * tau + law[:, 0]
    return s, (3 * law[:, 3] * tau + 2 * law[:, 2]) * tau + law[:, 1]
