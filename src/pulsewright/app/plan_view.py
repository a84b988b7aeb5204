"""What a plan makes of its limits: pictures over time, and program lines where time is lost."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np

from pulsewright.app import pictures
from pulsewright.motion.moves import MoveKind

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pulsewright.motion.machine import Machine
    from pulsewright.motion.moves import Moves
    from pulsewright.motion.trajectory import Trajectory

SAMPLES: Final = 8 * pictures.COLUMNS  # instants looked at for pictures
PLACES: Final = 8  # program lines shown at most
PORTION: Final = 4096  # elements that are looked at together, for little memory
LEAST: Final = 1e-3  # lost time that is shown [s]
COLOURS: Final = (
    pictures.BLUE,
    pictures.ORANGE,
    pictures.GREEN,
    pictures.RED,
    "#6b46a8",
    "#52606d",
)
KINDS: Final = ("velocity", "acceleration", "jerk")

Floats = pictures.Floats


@dataclass(frozen=True)
class PlanView:
    """A plan with what it was made from.

    Parameters
    ----------
    trajectory : Trajectory
        Of the machine's axes.
    moves : Moves
    machine : Machine
    """

    trajectory: Trajectory
    moves: Moves
    machine: Machine

    def possible_speed(self) -> Floats:
        """Return the path speed that feeds and velocities of axes allow on each element, (m,).

        Velocities are compared at both ends and in the middle of an element. Infinite for a dwell.
        """
        elements = np.arange(len(self.trajectory.length))
        if not len(self.moves):
            return np.full(len(elements), np.inf)
        portions = np.array_split(elements, len(elements) // PORTION + 1)
        return np.concatenate([self._possible(slice(p[0], p[-1] + 1)) for p in portions])

    def _possible(self, elements: slice) -> Floats:
        """Return the possible speed on some elements."""
        t, moves = self.trajectory, self.moves
        rows, velocity, _ = self.machine.limit_rows()
        move, length = t.move[elements], t.length[elements]
        free = moves.rapid[move] | (moves.kind[move] == MoveKind.DWELL)
        speed = np.where(free, np.inf, moves.feed[move])
        p, w = t.poly[elements], t.omega[elements, None]
        cosine, sine = t.cosine[elements], t.sine[elements]
        for part in (0.0, 0.5, 1.0):
            s = part * length[:, None]
            rate = p[:, 1] + (2 * p[:, 2] + 3 * p[:, 3] * s) * s
            rate = rate + w * (sine * np.cos(w * s) - cosine * np.sin(w * s))
            with np.errstate(divide="ignore"):
                speed = np.minimum(speed, (velocity / np.abs(rate @ rows.T)).min(axis=1))
        return np.asarray(np.where(length > 0, speed, np.inf))

    def lost(self) -> Floats:
        """Return how much longer each element takes than at its possible speed, (m,) [s]."""
        t = self.trajectory
        spent = np.bincount(t.element, np.diff(t.start), minlength=len(t.length))
        moving = t.length > 0
        return np.where(moving, np.maximum(spent - t.length / self.possible_speed(), 0.0), 0.0)

    def places(self) -> list[tuple[int, float, float]]:
        """Return program line, time lost and time spent [s] of the lines that lose most."""
        t = self.trajectory
        if not len(self.moves):
            return []
        line = self.moves.line[t.move]
        spent = np.bincount(t.element, np.diff(t.start), minlength=len(t.length))
        lost = np.bincount(line, self.lost())
        whole = np.bincount(line, spent)
        order = np.argsort(-lost, kind="stable")[:PLACES]
        return [(int(n), float(lost[n]), float(whole[n])) for n in order if lost[n] >= LEAST]

    def chart(self) -> str:
        """Return an SVG of the shares of limits over time, and of speed over what is possible."""
        from matplotlib import rc_context
        from matplotlib.figure import Figure

        t = self.trajectory
        rows, velocity, acceleration = self.machine.limit_rows()
        limits = (velocity, acceleration, self.machine.jerk_limits())
        time = np.linspace(0.0, t.duration, SAMPLES)
        names = self.machine.axes
        used = [np.abs(t.at(time, n) @ rows.T) / limits[n - 1] for n in (1, 2, 3)]
        moving = [r for r in range(len(names)) if used[0][:, r].any()]
        with rc_context(pictures.STYLE):
            figure = Figure(figsize=(11, 7.2), layout="constrained")
            upper, *others = figure.subplots(4, 1, sharex=True)
            self._speed(upper, time)
            for axes, kind, share in zip(others, KINDS, used, strict=True):
                for r in moving:
                    column, curve = pictures.envelope(time, 100 * share[:, r])
                    colour = COLOURS[r % len(COLOURS)]
                    axes.plot(column, curve, color=colour, linewidth=1, label=names[r])
                axes.axhline(100, color=pictures.RED, linewidth=1, linestyle="--")
                axes.set_ylabel(f"{kind}\n[% of limit]")
                axes.set_ylim(0, 110)
                axes.margins(x=0)
            if moving:
                lines = others[0].lines[: len(moving)]
                figure.legend(handles=lines, ncols=len(moving), loc="outside upper right")
            others[-1].set_xlabel("time [s]")
            return pictures.rendered(figure, "svg").decode()

    def _speed(self, axes: Axes, time: Floats) -> None:
        """Draw path speed as a share of the possible one."""
        t = self.trajectory
        k = np.clip(np.searchsorted(t.start, time, "right") - 1, 0, len(t.element) - 1)
        tau, law = time - t.start[k], t.law[k]
        speed = np.abs(law[:, 1] + (2 * law[:, 2] + 3 * law[:, 3] * tau) * tau)
        share = 100 * speed / self.possible_speed()[t.element[k]]
        column, curve = pictures.envelope(time, share)
        axes.fill_between(column, curve, color=pictures.BLUE, alpha=0.15, linewidth=0)
        axes.plot(column, curve, color=pictures.BLUE, linewidth=1)
        axes.set_ylabel("speed\n[% of possible]")
        axes.set_ylim(0, 110)
        axes.margins(x=0)

    def section(self, text: list[str]) -> str:
        """Return the part of the report about the plan; ``text`` is the program's lines."""
        total, lost = self.trajectory.duration, float(self.lost().sum())
        share = lost / total if total > 0 else 0.0
        table = "".join(
            f'<tr><td class="number">{line}</td>'
            f"<td><code>{escape(text[line - 1].strip() if 0 < line <= len(text) else '')}</code>"
            f'</td><td class="number">{less:.3f}</td><td class="number">{spent:.3f}</td></tr>'
            for line, less, spent in self.places()
        )
        picture = self.chart()
        return (
            f"<section><h2>Plan: use of limits, and where time is lost</h2>"
            f"{picture[picture.index('<svg') :]}"
            '<p class="note">Largest in each column. Speed is compared with what feed and velocity '
            "limits allow there; what is missing to 100 % is lost to speeding up, slowing down and "
            f"bends: {lost:.3f} s, {share:.1%} of the time.</p>"
            '<table><thead><tr><th class="number">line</th><th>program</th>'
            '<th class="number">time lost [s]</th><th class="number">of [s]</th></tr></thead>'
            f"<tbody>{table}</tbody></table></section>"
        )
