"""The way back to a plan that was left: return to it, and speed up along it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pulsewright.motion.trajectory import Trajectory

Floats = NDArray[np.float64]

SHARE: Final = 0.1  # of the limits of acceleration and jerk, for speeding up along the plan
PIECES: Final = 64  # of the time in which that is done
SLIVER: Final = 1e-12  # of it: so short a part is none
HALVINGS: Final = 60  # to find when a time of the plan comes


@dataclass(frozen=True)
class Rejoined(Trajectory):
    """The motion back to a plan and along it.

    Parameters
    ----------
    plan : Trajectory
    joined : float
        Where the plan is joined, in its time [s].
    back : float
        How long the way there is [s].
    warp : float
        How long after that the plan's time passes slower than always [s].
    """

    plan: Trajectory
    joined: float
    back: float
    warp: float

    def plan_time(self, time: float) -> float:
        """Return the time of the plan at a time of this motion; on the way back, where it ends."""
        since = max(time - self.back, 0.0)
        share = min(since / self.warp, 1.0)
        return self.joined + self.warp * share**3 * (1 - share / 2) + max(since - self.warp, 0.0)

    def mapped(self, matrix: Floats) -> Rejoined:
        """Return the same motion in other coordinates."""
        mapped = super().mapped(matrix)
        assert isinstance(mapped, Rejoined)
        return replace(mapped, plan=self.plan.mapped(matrix))


def rejoin(
    plan: Trajectory,
    time: float,
    position: ArrayLike,
    *,
    rates: Sequence[float],
    accelerations: Sequence[float],
    jerks: Sequence[float],
) -> Rejoined:
    """Return the motion that completes a plan from a place beside it.

    It goes straight to where the plan is at ``time``, from rest to rest and within the limits. From
    there on it follows the plan's path to the end: first slower than the plan, with the plan's own
    time passing ever faster, then as the plan. Speeding up adds at most `SHARE` of the limits of
    acceleration and jerk to what the plan has. Acceleration has no jump that the plan has not.

    A motion that has rejoined a plan and is left again goes back to that plan.

    Parameters
    ----------
    plan : Trajectory
    time : float
        Where to join it [s].
    position : (axes,) float
        Where the machine rests.
    rates, accelerations, jerks : sequence of float
        Limits of each axis, in its units per s, s^2 and s^3; not 0.
    """
    if isinstance(plan, Rejoined):
        time, plan = plan.plan_time(time), plan.plan
    time = min(max(time, 0.0), plan.duration)
    begin = np.asarray(position, float)
    way = plan.at(time)[0] - begin
    limits = np.array([rates, accelerations, jerks], float)
    first = int(np.clip(np.searchsorted(plan.start, time, "right") - 1, 0, len(plan.element) - 1))
    start, law, element = [np.zeros(1)], [np.zeros((0, 4))], [np.zeros(0, np.int32)]
    back, warp = 0.0, _warp(*limits)
    if way.any():
        ends, pieces = _straight(*(1 / (abs(way) / limits).max(axis=1)).tolist())
        start.append(ends)
        law.append(pieces)
        element.append(np.zeros(len(ends), np.int32))
        back = float(ends[-1])
    if time < plan.duration:
        ends, pieces, elements = _warped(plan, time, warp)
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
    return Rejoined(
        poly=np.concatenate([line, plan.poly[kept]]),
        cosine=np.concatenate([none, plan.cosine[kept]]),
        sine=np.concatenate([none, plan.sine[kept]]),
        omega=np.concatenate([[0.0], plan.omega[kept]]),
        length=np.concatenate([[1.0], plan.length[kept]]),
        move=np.concatenate([plan.move[kept][:1], plan.move[kept]]),
        element=np.concatenate(element).astype(np.int32),
        start=np.concatenate(start),
        law=np.concatenate(law),
        plan=plan,
        joined=time,
        back=back,
        warp=warp,
    )


def _straight(speed: float, acceleration: float, jerk: float) -> tuple[Floats, Floats]:
    """Return end times and laws of the fastest way from 0 to 1, from rest to rest."""
    a = min(acceleration, math.sqrt(speed * jerk))
    v = speed
    if v * (a / jerk + v / a) > 1:  # no room to get so fast
        v = (jerk / 4) ** (1 / 3)
        a = math.sqrt(v * jerk)
        if a > acceleration:
            a = acceleration
            v = (math.sqrt((a * a / jerk) ** 2 + 4 * a) - a * a / jerk) / 2
    build = a / jerk
    hold, cruise = max(v / a - build, 0.0), max(1 / v - build - v / a, 0.0)
    times = [build, hold, build, cruise, build, hold, build]
    laws, ends = [], []
    state: tuple[Any, Any, Any] = (0.0, 0.0, 0.0)  # path coordinate, speed, acceleration
    for time, j in zip(times, [jerk, 0.0, -jerk, 0.0, -jerk, 0.0, jerk], strict=True):
        if time > 0:
            x, v, a = state
            laws.append((x, v, a / 2, j / 6))
            ends.append(time)
            state = _after(x, v, a, j, time)
    return np.cumsum(ends), np.array(laws)


def _after(x: Any, v: Any, a: Any, j: Any, time: Any) -> tuple[Any, Any, Any]:
    """Return position, speed and acceleration after a time of constant jerk."""
    return (
        x + (v + (a / 2 + j / 6 * time) * time) * time,
        v + (a + j / 2 * time) * time,
        a + j * time,
    )


def _warp(rate: Floats, acceleration: Floats, jerk: Floats) -> float:
    """Return the time T in which the plan's time begins to pass as always [s].

    Its rate is 3 r^2 - 2 r^3 at a share r of T: that changes by 1.5 / T at most, and the change by
    6 / T^2. So 1.5 rate / T comes on top of the plan's acceleration, and 4.5 acceleration / T + 6
    rate / T^2 on top of its jerk.
    """
    soft, bend = SHARE * jerk, 4.5 * acceleration
    by_jerk = (bend + np.sqrt(bend**2 + 24 * soft * rate)) / (2 * soft)
    return float(np.maximum(1.5 * rate / (SHARE * acceleration), by_jerk).max())


def _warped(plan: Trajectory, time: float, warp: float) -> tuple[Floats, Floats, NDArray[np.int32]]:
    """Return end times, laws and elements of the plan's pieces from ``time`` on, from rest.

    At a share r of ``warp``, the plan's time is time + warp (r^3 - r^4 / 2), later it passes as
    always. In the first part, pieces are split; positions, speeds and accelerations at the ends of
    the parts are exact, and three cubics lead from one to the next.
    """
    full = time + warp / 2  # time of the plan from which on it passes as always
    stop = min(full, plan.duration)
    bounds = plan.start[(plan.start > time) & (plan.start < stop)]
    last = _share(np.array([(stop - time) / warp]))
    even = np.linspace(0, 1, PIECES + 1)
    share = np.concatenate([_share((bounds - time) / warp), even[even < last], last])
    share = np.unique(share)
    share = share[np.append(True, np.diff(share) > SLIVER)]
    share[-1] = last[0]
    r, span = share[:-1], warp * np.diff(share)
    middle = (r + share[1:]) / 2
    k = np.searchsorted(plan.start, time + warp * middle**3 * (1 - middle / 2), "right") - 1
    tau = np.maximum(time + warp * r**3 * (1 - r / 2) - plan.start[k], 0.0)
    x, v, a = _after(plan.law[k, 0], plan.law[k, 1], 2 * plan.law[k, 2], 6 * plan.law[k, 3], tau)
    # series of the plan's time, and of the path coordinate in it, in the time since r
    rate = [r * r * (3 - 2 * r), 3 * r * (1 - r) / warp, (1 - 2 * r) / warp**2]
    passed = np.stack([0 * r, *rate, 0 * r - 0.5 / warp**3], axis=1)
    square = _product(passed, passed)
    series = _product(square, passed) * plan.law[k, 3, None]
    series[:, : square.shape[1]] += square * a[:, None] / 2
    series[:, : passed.shape[1]] += passed * v[:, None]
    n = np.arange(3, series.shape[1])
    terms = series[:, 3:] * span[:, None] ** (n - 3)
    rise, gain, climb = 3 * terms @ (n * (n - 1)), 9 * terms @ n, 27 * terms.sum(axis=1)
    first = climb - gain + rise / 3
    second = 3 * gain - 2 * climb - 7 / 6 * rise
    h = span / 3
    v, a = series[:, 1], 2 * series[:, 2]
    laws, ends = [], []
    for part, j in enumerate([first, second, rise - first - second], start=1):
        laws.append(np.stack([x, v, a / 2, j / 6], axis=1))
        ends.append(warp * r + part * h)
        x, v, a = _after(x, v, a, j, h)
    ends[-1] = warp * share[1:]
    slow = np.stack(ends, axis=1).ravel(), np.stack(laws, axis=1).reshape(-1, 4)
    elements = np.repeat(plan.element[k], 3)
    if full >= plan.duration:
        return *slow, elements
    k = np.arange(int(np.searchsorted(plan.start, full, "right")) - 1, len(plan.element))
    rest = plan.law[k].copy()
    c0, c1, c2, c3 = rest[0]
    x, v, a = _after(c0, c1, 2 * c2, 6 * c3, full - plan.start[k[0]])
    rest[0, :3] = x, v, a / 2
    return (
        np.concatenate([slow[0], plan.start[k + 1] - full + warp]),
        np.concatenate([slow[1], rest]),
        np.concatenate([elements, plan.element[k]]),
    )


def _share(passed: Floats) -> Floats:
    """Return r with r^3 - r^4 / 2 as given, from 0 to 1 / 2."""
    low, high = np.zeros_like(passed), np.ones_like(passed)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        below = middle**3 * (1 - middle / 2) < passed
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return high


def _product(a: Floats, b: Floats) -> Floats:
    """Return the products of polynomials, coefficients of rising powers in rows."""
    out = np.zeros((len(a), a.shape[1] + b.shape[1] - 1))
    for n in range(b.shape[1]):
        out[:, n : n + a.shape[1]] += a * b[:, n, None]
    return out
