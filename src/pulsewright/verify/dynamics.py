"""Velocities and accelerations that the step edges show, against limits and feeds.

Between two instants h apart an axis that keeps its limits moves by at most v h, and its second
difference is at most a h^2; counts that are up to q off add 2 q and 4 q. The windows h are chosen
per axis such that this blur is about `Tolerances.share` of the limit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.motion.moves import AXES
from pulsewright.verify.distance import PathCheck
from pulsewright.verify.reference import Floats, Ints, Reference
from pulsewright.verify.verdict import Check, PathSample

SPEED_WINDOW: Final = 0.01  # for pictures [s]
FEED_WINDOW: Final = 0.05  # long, so that steps blur little at small feeds [s]


@dataclass
class _Peak:
    """Largest value relative to its bound, and where."""

    ratio: float = -1.0
    value: float = 0.0
    bound: float = 0.0
    point: int = 0  # grid point in the centre of the window
    planned: float = 0.0  # largest of the plan, by the same differences

    def note(self, value: float, bound: float, point: int) -> None:
        """Take in the largest value of some windows."""
        if value > self.ratio * bound:
            self.ratio, self.value, self.bound, self.point = value / bound, value, bound, point


@dataclass(frozen=True)
class _Limit:
    """One limited combination of axes, and the windows [grid points] by which it is measured."""

    name: str
    unit: str
    row: Floats
    velocity: float
    acceleration: float
    blur: float  # q
    velocity_window: int
    acceleration_window: int
    fast: _Peak = field(default_factory=_Peak)
    hard: _Peak = field(default_factory=_Peak)


class DynamicsCheck:
    """Differences over windows around each grid point, and the samples for pictures.

    The machine rests before the plan starts and after the recording ends, so the windows at
    either end are filled up with rest.

    Parameters
    ----------
    reference : Reference
    limits : tuple of (r, 6), (r,), (r,) float64
        As in `Verifier`.
    paths : sequence of PathCheck
        Groups of axes whose feed to check.

    Attributes
    ----------
    bulge : float
        How far the plan leaves the straight line between two grid points [mm, degrees].
    """

    def __init__(
        self,
        reference: Reference,
        limits: tuple[Floats, Floats, Floats],
        paths: Sequence[PathCheck],
    ) -> None:
        self._reference, self._paths = reference, tuple(paths)
        tolerances, dt = reference.tolerances, reference.dt
        self._limits = []
        for row, v, a in zip(*(np.asarray(column, float) for column in limits), strict=True):
            q = tolerances.following * float(np.abs(row @ reference.inverse).sum())
            if q == 0:  # no motor moves it
                continue
            by_velocity = math.ceil(2 * q / (tolerances.share * v) / dt)
            by_acceleration = math.ceil(math.sqrt(4 * q / (tolerances.share * a)) / dt)
            unit = "mm" if row[:3].any() else "degrees"
            self._limits.append(
                _Limit(_name(row), unit, row, v, a, q, by_velocity, by_acceleration)
            )
        self._feeds = [_Peak() for _ in self._paths]
        self._feed_window = max(1, round(FEED_WINDOW / dt))
        self._speed_window = max(1, round(SPEED_WINDOW / dt))
        self._hard_window = max(
            (limit.acceleration_window for limit in self._limits if limit.unit == "mm"), default=1
        )
        self.bulge = 0.0
        windows = [max(x.velocity_window, x.acceleration_window) for x in self._limits]
        self._delay = max(self._feed_window, self._speed_window, *windows, 1)
        n = 2 * self._delay
        self._tail = (
            np.repeat(reference.tool(reference.start_counts[None]), n, axis=0),
            np.repeat(reference.home[None], n, axis=0),
            np.zeros(n, np.int64),
            np.zeros((n, len(reference.motors))),
            np.zeros(n),
        )
        self._point = -self._delay  # grid point in the centre of the next windows
        points = math.ceil(reference.plan.duration / dt) + 1
        self._picture = _Decimator(math.ceil(points / tolerances.samples))

    def feed(
        self, tool: Floats, plan: Floats, run: Ints, deviation: Floats, distance: Floats
    ) -> None:
        """Take in the next grid points.

        Parameters
        ----------
        tool, plan : (n, 6) float64
            Position measured, and planned.
        run : (n,) int64
        deviation : (n, motors) float64
            Largest following deviation since the grid point before [step].
        distance : (n,) float64
            From the programmed path [mm].
        """
        from pulsewright.verify import kernels

        old_tool, old_plan, old_run, old_deviation, old_distance = self._tail
        tool, plan = np.concatenate([old_tool, tool]), np.concatenate([old_plan, plan])
        run = np.concatenate([old_run, run])
        deviation = np.concatenate([old_deviation, deviation])
        distance = np.concatenate([old_distance, distance])
        n = len(tool) - 2 * self._delay
        self._tail = (tool[n:], plan[n:], run[n:], deviation[n:], distance[n:])

        dt, delay, peak = self._reference.dt, self._delay, np.empty(4)
        for limit in self._limits:
            windows = limit.velocity_window, limit.acceleration_window
            h, g = windows[0] * dt, windows[1] * dt
            kernels.row_differences(tool, limit.row, delay, *windows, peak)
            first, at, second, turn = peak.tolist()
            limit.fast.note(first / h, limit.velocity + 2 * limit.blur / h, self._point + int(at))
            limit.hard.note(
                second / g**2, limit.acceleration + 4 * limit.blur / g**2, self._point + int(turn)
            )
            kernels.row_differences(plan, limit.row, delay, *windows, peak)
            limit.fast.planned = max(limit.fast.planned, float(peak[0]) / h)
            limit.hard.planned = max(limit.hard.planned, float(peak[2]) / g**2)
        h = self._feed_window * dt
        for path, fast in zip(self._paths, self._feeds, strict=True):
            column = path.columns.start
            speed = kernels.first_differences(tool, column, delay, self._feed_window) / h
            bound = self._feed_allowed(run, path.group, n) + 2 * path.quantum / h
            i = int(np.argmax(speed / bound))
            fast.note(float(speed[i]), float(bound[i]), self._point + i)
            bulge = kernels.second_differences(plan, column, delay, 1).max() / 8
            self.bulge = max(self.bulge, float(bulge))

        here = slice(delay, delay + n)
        w, h = self._speed_window, self._speed_window * dt
        speed = kernels.first_differences(tool, 0, delay, w) / h
        w, h = self._hard_window, self._hard_window * dt
        hard = kernels.second_differences(tool, 0, delay, w) / h**2
        started = slice(max(0, -self._point), None)  # rest before the start makes no picture
        self._picture.feed(
            (self._point + np.arange(n))[started],
            tool[here][started],
            run[here][started],
            np.column_stack([speed, hard, distance[here], deviation[here]])[started],
        )
        self._point += n

    def _feed_allowed(self, run: Ints, group: str, n: int) -> Floats:
        """Return the highest feed in the window around each of n centres."""
        first = self._point - self._delay
        time = np.arange(first, first + len(run)).astype(np.float64) * self._reference.dt
        feed = self._reference.runs.allowed(group, run, time)
        low = self._delay - self._feed_window // 2
        return _rolling_largest(feed[low : low + n + self._feed_window], self._feed_window + 1)

    def flush(self) -> None:
        """Finish the windows that reach beyond the recording."""
        tool, plan, run, _, _ = self._tail
        d = self._delay
        self.feed(
            np.repeat(tool[-1:], d, axis=0),
            np.repeat(plan[-1:], d, axis=0),
            np.repeat(run[-1:], d),
            np.zeros((d, len(self._reference.motors))),
            np.zeros(d),
        )

    def checks(self) -> list[Check]:
        """Return one check of velocity and one of acceleration per limit, and those of feed."""
        dt, checks = self._reference.dt, []
        for limit in self._limits:
            h, g = limit.velocity_window * dt, limit.acceleration_window * dt
            for kind, unit, peak, most, blur, window in (
                ("velocity", "/s", limit.fast, limit.velocity, 2 * limit.blur / h, h),
                ("acceleration", "/s^2", limit.hard, limit.acceleration, 4 * limit.blur / g**2, g),
            ):
                checks.append(
                    self._check(
                        f"{kind}:{limit.name}",
                        f"{kind} of {limit.name}",
                        limit.unit + unit,
                        peak,
                        limit.name,
                        f"limit {most:g}, {blur:.3g} for steps over {window * 1e3:.3g} ms; planned "
                        f"at most {peak.planned:.6g} by the same differences",
                    )
                )
        h = self._feed_window * dt
        for path, peak in zip(self._paths, self._feeds, strict=True):
            blur = 2 * path.quantum / h
            checks.append(
                self._check(
                    f"feed{path.suffix}",
                    f"speed of {path.axes} against the programmed feed",
                    f"{path.unit}/s",
                    peak,
                    path.axes,
                    f"feed {peak.bound - blur:.6g} there, {blur:.3g} for steps over "
                    f"{h * 1e3:.3g} ms; not where a traverse is within"
                    if math.isfinite(peak.bound)
                    else "there are only traverses"
                    + (", and motion that X Y Z pace" if path.group == "ABC" else ""),
                )
            )
        return checks

    def _check(
        self, name: str, title: str, unit: str, peak: _Peak, where: str, detail: str
    ) -> Check:
        # what never moves is nowhere at its fastest
        cycle = self._reference.start + float(peak.point) * self._reference.grid
        place = self._reference.place(cycle) if peak.value else {}
        return Check(
            name,
            title,
            unit,
            peak.value,
            peak.bound,
            "most",
            peak.ratio <= 1.0,
            where=where,
            detail=detail,
            **place,
        )

    def sample(self) -> PathSample:
        """Return the run in few enough points for a picture."""
        reference = self._reference
        point, tool, run, peaks = self._picture.result()
        moves, runs = reference.moves, reference.runs
        line = moves.line[runs.move[run]] if len(moves) else np.zeros(len(run), np.int32)
        return PathSample(
            time=point * reference.dt,
            position=tool,
            speed=peaks[:, 0],
            acceleration=peaks[:, 1],
            rapid=runs.rapid[run],
            line=line,
            deviation=peaks[:, 3:],
            distance=peaks[:, 2],
            speed_window=self._speed_window * reference.dt,
            acceleration_window=self._hard_window * reference.dt,
        )


def _name(row: Floats) -> str:
    """Return ``X`` for the row of an axis, ``X - 0.5 Y`` for a combination."""
    terms = [
        letter if factor == 1 else f"{factor:g} {letter}"
        for letter, factor in zip(AXES, row.tolist(), strict=True)
        if factor
    ]
    return " + ".join(terms).replace("+ -", "- ")


def _rolling_largest(values: Floats, window: int) -> Floats:
    """Return the largest of each ``window`` neighbouring values, shape (n - window + 1,)."""
    width, result = 1, values
    while 2 * width <= window:
        result = np.maximum(result[width:], result[:-width])
        width *= 2
    rest = window - width
    return np.maximum(result[rest:], result[: len(result) - rest]) if rest else result


class _Decimator:
    """Rows thinned to one in ``stride``, keeping the largest of what may peak in between."""

    def __init__(self, stride: int) -> None:
        self._stride = stride
        self._pending: list[tuple[NDArray[Any], ...]] = []
        self._kept: list[list[NDArray[Any]]] = []

    def feed(self, *columns: NDArray[Any]) -> None:
        """Take in rows; of the last column the largest is kept, of the others the first."""
        self._pending.append(columns)
        if sum(len(rows[0]) for rows in self._pending) >= self._stride:
            self._thin(last=False)

    def _thin(self, *, last: bool) -> None:
        rows = [np.concatenate(parts) for parts in zip(*self._pending, strict=True)]
        n = len(rows[0]) if last else len(rows[0]) // self._stride * self._stride
        first = np.arange(0, n, self._stride)
        peaks = np.maximum.reduceat(rows[-1][:n], first, axis=0) if n else rows[-1][:0]
        self._kept.append([*(column[first] for column in rows[:-1]), peaks])
        self._pending = [tuple(column[n:] for column in rows)]

    def result(self) -> list[NDArray[Any]]:
        """Return the thinned columns."""
        self._thin(last=True)
        return [np.concatenate(parts) for parts in zip(*self._kept, strict=True)]
