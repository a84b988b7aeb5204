"""Pictures of a verified run: the path, and what speed, acceleration and deviation did in time."""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.units import MINUTE
from pulsewright.verify.verdict import Check, PathSample, Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

INK: Final = "#1f2933"
FAINT: Final = "#9aa5b1"
GRID: Final = "#e4e7eb"
BLUE: Final = "#2563a8"
ORANGE: Final = "#c2570c"
GREEN: Final = "#18794e"
RED: Final = "#c62828"
HEIGHT: Final = 7.0  # of a view of the path [inch]
LEVELS: Final = 100  # colours of speed
COLUMNS: Final = 1200  # points of a curve over time: more than a page shows
ISOMETRIC: Final = np.array([[0.866, -0.5], [0.866, 0.5], [0.0, 1.0]])  # X right and down, Z up
STYLE: Any = {  # typed by matplotlib as a dictionary of 300 literal keys
    "font.family": "sans-serif",
    "font.size": 10,
    "text.color": INK,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": GRID,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "pulsewright",  # the same run gives the same file
}


def path_picture(verdict: Verdict, title: str) -> bytes:
    """Return a PNG of the path as the step edges tell it, coloured by speed.

    From above, and from the side too where Z moves. The place of the largest deviation is marked,
    and where checks failed.
    """
    from matplotlib import colormaps, rc_context
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize
    from matplotlib.figure import Figure

    sample = verdict.sample
    xyz = sample.position[:, :3]
    fast = np.where(sample.rapid, 0.0, sample.speed) * MINUTE
    top = float(fast.max(initial=0.0)) or 1.0
    # plasma without its palest end, which white paper swallows
    colours = LinearSegmentedColormap.from_list(
        "speed", colormaps["plasma"](np.linspace(0.0, 0.88, 256))
    )
    norm = Normalize(0.0, top)
    deep = bool(len(xyz)) and bool(np.ptp(xyz[:, 2]) > 0)
    with rc_context(STYLE | {"font.size": 13}):
        projections = (np.eye(3)[:, :2], ISOMETRIC)[: 1 + deep]
        shapes = [_shape(xyz, projection) for projection in projections]
        figure = Figure(
            figsize=(HEIGHT * sum(shapes) + 2.4, HEIGHT + 0.8), dpi=120, layout="constrained"
        )
        views = figure.subplots(1, len(shapes), squeeze=False, width_ratios=shapes)[0]
        marks = _marks(verdict)
        for axes, projection in zip(views, projections, strict=True):
            _draw_path(axes, sample, xyz @ projection, fast, colours, norm)
            _draw_marks(axes, marks, projection)
            axes.set_aspect("equal", adjustable="datalim")
            axes.margins(0.06)
        views[0].set(xlabel="X [mm]", ylabel="Y [mm]")
        if deep:
            _finish_isometric(views[1], xyz)
        figure.colorbar(
            ScalarMappable(norm, colours),
            ax=list(views),
            label="speed [mm/min]",
            shrink=0.7,
            aspect=30,
            pad=0.02,
        )
        figure.suptitle(title, x=0.01, ha="left", fontsize=17, fontweight="bold")
        figure.text(
            0.995,
            0.985,
            "PASS" if verdict.passed else "FAIL",
            ha="right",
            va="top",
            fontsize=20,
            fontweight="bold",
            color=GREEN if verdict.passed else RED,
        )
        return rendered(figure, "png")


def _shape(xyz: Floats, projection: Floats) -> float:
    """Return width over height of a view, within what looks well."""
    if not len(xyz):
        return 1.0
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    corners = np.array(list(product(*zip(low, high, strict=True)))) @ projection
    width, height = np.ptp(corners, axis=0)
    return float(np.clip(width / max(height, 1e-9), 0.6, 1.45))


def _draw_path(
    axes: Axes, sample: PathSample, points: Floats, fast: Floats, colours: Any, norm: Any
) -> None:
    from matplotlib.collections import LineCollection

    if len(points) < 2:
        axes.plot(*points.T, "o", color=BLUE)
        return
    moving = (points[1:] != points[:-1]).any(axis=1)
    rapid = sample.rapid[:-1] & moving
    travel = np.where(_with_ends(rapid)[:, None], points, np.nan)
    axes.plot(
        *travel.T, color=FAINT, linewidth=0.8, linestyle=(0, (4, 3)), zorder=2, label="traverse"
    )
    cut = np.flatnonzero(moving & ~sample.rapid[:-1])
    if len(cut):
        # neighbours of nearly one speed make one line, which draws a hundred times faster
        level = np.round(norm(fast[cut]) * LEVELS)
        breaks = np.flatnonzero((np.diff(cut) > 1) | (np.diff(level) != 0)) + 1
        first = np.append(0, breaks)
        last = np.append(breaks, len(cut)) - 1
        axes.add_collection(
            LineCollection(
                [points[cut[i] : cut[j] + 2] for i, j in zip(first, last, strict=True)],
                colors=colours(level[first] / LEVELS),
                linewidths=_width(points),
                capstyle="round",
                joinstyle="round",
                zorder=3,
            )
        )
    axes.plot(*points[0], "o", color="white", markeredgecolor=INK, markersize=7, zorder=5)
    axes.plot(*points[-1], "s", color=INK, markersize=5, zorder=5)
    axes.update_datalim(points)
    axes.autoscale_view()


def _width(points: Floats) -> float:
    """Return a line width [pt] that leaves gaps between the passes of a dense path."""
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    passes = length / max(float(np.linalg.norm(np.ptp(points, axis=0))), 1e-9)
    return float(np.clip(2.2 - 0.25 * np.log2(max(passes, 1.0)), 0.5, 1.6))


def _with_ends(segment: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which points bound one of the chosen segments between neighbouring points."""
    return np.asarray(np.append(segment, False) | np.append(False, segment))


def _marks(verdict: Verdict) -> list[tuple[Check, str, str]]:
    """Return the checks to mark in the picture, with a label and a colour."""
    path = verdict["path"]
    marks = []
    if path.worst is not None and path.passed:
        marks.append((path, f"largest deviation {path.worst * 1e3:.1f} µm{_line(path)}", INK))
    failed = [check for check in verdict.failed if check.position is not None]
    marks += [(check, f"{check.name}{_line(check)}", RED) for check in failed[:4]]
    return [mark for mark in marks if mark[0].position is not None]


def _line(check: Check) -> str:
    return "" if check.line is None else f", line {check.line}"


def _draw_marks(axes: Axes, marks: Sequence[tuple[Check, str, str]], projection: Floats) -> None:
    for k, (check, label, colour) in enumerate(marks):
        u, v = np.array(check.position) @ projection
        side = 1 if u < np.mean(axes.get_xlim()) else -1  # away from the view's nearer border
        axes.plot(u, v, "o", markersize=13, markerfacecolor="none", color=colour, zorder=6)
        axes.annotate(
            label,
            (u, v),
            xytext=(18 * side, 18 + 28 * k),
            ha="left" if side > 0 else "right",
            textcoords="offset points",
            color=colour,
            fontsize=12,
            zorder=7,
            arrowprops={"arrowstyle": "-", "color": colour, "shrinkB": 6, "linewidth": 0.8},
            bbox={
                "boxstyle": "round,pad=0.3",
                "facecolor": "white",
                "edgecolor": colour,
                "linewidth": 0.6,
                "alpha": 0.9,
            },
        )


def _finish_isometric(axes: Axes, xyz: Floats) -> None:
    """Replace the axes of an isometric view by the box around the path, with its sizes."""
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    for axis in range(3):
        others = [a for a in range(3) if a != axis]
        for first in (low, high):
            for second in (low, high):
                edge = np.empty((2, 3))
                edge[:, others[0]], edge[:, others[1]] = first[others[0]], second[others[1]]
                edge[:, axis] = low[axis], high[axis]
                axes.plot(*(edge @ ISOMETRIC).T, color=GRID, linewidth=1, zorder=1)
    corner = {0: (low[1], low[2]), 1: (high[0], low[2]), 2: (low[0], low[1])}
    for axis, name in enumerate("XYZ"):
        middle = (low + high) / 2
        middle[[a for a in range(3) if a != axis]] = corner[axis]
        u, v = middle @ ISOMETRIC
        size = high[axis] - low[axis]
        axes.annotate(
            f"{name} {size:.4g} mm",
            (u, v),
            xytext=((-8, -10), (8, -10), (-10, 0))[axis],
            textcoords="offset points",
            ha=("right", "left", "right")[axis],
            va=("top", "top", "center")[axis],
            color="#616e7c",
            fontsize=12,
        )
    axes.set_axis_off()


def dynamics_chart(verdict: Verdict) -> str:
    """Return an SVG of speed and acceleration over time."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    sample = verdict.sample
    time, speed, acceleration = envelope(sample.time, sample.speed * MINUTE, sample.acceleration)
    with rc_context(STYLE):
        figure = Figure(figsize=(11, 4.2), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True)
        for axes, curve, colour, label in (
            (upper, speed, BLUE, "speed\n[mm/min]"),
            (lower, acceleration, ORANGE, "acceleration\n[mm/s²]"),
        ):
            axes.fill_between(time, curve, color=colour, alpha=0.15, linewidth=0)
            axes.plot(time, curve, color=colour, linewidth=1)
            axes.set_ylabel(label)
            axes.set_ylim(bottom=0)
            axes.margins(x=0)
        lower.set_xlabel("time [s]")
        return rendered(figure, "svg").decode()


def deviation_chart(verdict: Verdict) -> str:
    """Return an SVG of the following deviation: over time, and how often it was how large."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    sample, bound = verdict.sample, verdict["following"].bound
    largest = sample.deviation.max(axis=1, initial=0.0)
    time, curve = envelope(sample.time, largest)
    edges = np.array(verdict.histogram["edges"])
    counts = np.array(verdict.histogram["counts"], float)
    with rc_context(STYLE):
        figure = Figure(figsize=(11, 3.2), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(2, 1))
        left.plot(time, curve, color=BLUE, linewidth=1)
        left.axhline(bound, color=RED, linewidth=1, linestyle="--")
        left.annotate(
            f"bound {bound:g}",
            (1, bound),
            xycoords=("axes fraction", "data"),
            xytext=(0, 3),
            textcoords="offset points",
            ha="right",
            color=RED,
            fontsize=9,
        )
        left.set(xlabel="time [s]", ylabel="largest |count - plan| [step]")
        left.set_ylim(0, max(bound * 1.2, float(curve.max(initial=0.0)) * 1.1))
        left.margins(x=0)
        shown = np.flatnonzero(counts)
        if len(shown):
            right.bar(
                edges[:-1], counts, width=np.diff(edges), align="edge", color=BLUE, linewidth=0
            )
            reach = max(bound * 1.1, np.abs(edges[[shown[0], shown[-1] + 1]]).max())
            right.set_xlim(-reach, reach)
            right.set_yscale("log")
            right.set_ylim(bottom=0.8)
        for side in (-bound, bound):
            right.axvline(side, color=RED, linewidth=1, linestyle="--")
        right.set(xlabel="count - plan at a step [step]", ylabel="how often")
        return rendered(figure, "svg").decode()


def envelope(time: Floats, *curves: Floats) -> list[Floats]:
    """Return times and curves with at most about `COLUMNS` points, keeping the largest values."""
    stride = -(-len(time) // COLUMNS)
    if stride <= 1:
        return [time, *curves]
    first = np.arange(0, len(time), stride)
    return [time[first], *(np.maximum.reduceat(curve, first) for curve in curves)]


def rendered(figure: Figure, kind: str) -> bytes:
    """Return the file of a picture, the same for the same picture: ``png`` or ``svg``."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)  # no window system is asked for
    buffer = io.BytesIO()
    metadata = {"Date": None} if kind == "svg" else {"Software": "pulsewright"}
    figure.savefig(buffer, format=kind, metadata=metadata)
    figure.clear()  # a long path takes much memory, which nothing else would free soon
    return buffer.getvalue()
