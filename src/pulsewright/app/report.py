"""The report of a run: one page for people, one file for programs, one picture."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping
from html import escape
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any, Final

from pulsewright.app import pictures
from pulsewright.app.report_page import PAGE
from pulsewright.errors import UsageError
from pulsewright.files import replacing
from pulsewright.verify.verdict import Check, Verdict, plain

if TYPE_CHECKING:
    from pulsewright.app.plan_view import PlanView

FILES: Final = ("report.json", "report.html", "path.png")
_LABELS: Final = {
    "program": "program",
    "machine": "machine",
    "board": "board",
    "profile": "profile",
    "moves": "moves",
    "elements": "path elements",
    "pieces": "pieces of constant jerk",
    "update_rate": "updates of the board [1/s]",
    "real_time_ratio": "machine time / CPU time",
    "messages": "messages of the program",
    "not_switched": "not switched, for want of outputs",
    "feed_changes": "feed changed while it ran",
    "cpu_seconds": "CPU time [s]",
    "certificate": "certificate of the plan",
}
PLACES: Final = 8  # program lines shown at most
_IN_TILES: Final = {"duration"}


def write_report(
    verdict: Verdict,
    context: Mapping[str, Any],
    out_dir: Path | str,
    *,
    plan: PlanView | None = None,
) -> list[Path]:
    """Write report.json, report.html and path.png.

    All are made before the first is written, and each appears whole or not at all.

    Parameters
    ----------
    verdict : Verdict
    context : mapping
        What was run: ``program`` (path), ``machine``, ``board``, ``profile`` and whatever else is
        worth a line; values that `json.dumps` takes, or dictionaries of these.
    out_dir : Path or str
        A folder that exists.
    plan : PlanView, optional
        The plan, for a section about it.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    UsageError
        If the folder does not exist or cannot be written.
    """
    folder = Path(out_dir)
    if not folder.is_dir():
        raise UsageError(f"{folder}: no such folder; make it, or choose another for the report")
    name = Path(str(context.get("program", "run"))).name
    picture = pictures.path_picture(verdict, f"{name}   {clock_time(verdict.duration)}")
    content = {
        "report.json": report_json(verdict, context).encode(),
        "report.html": report_page(verdict, context, picture, plan).encode(),
        "path.png": picture,
    }
    for file in FILES:
        with replacing(folder / file) as temporary:
            temporary.write_bytes(content[file])
    return [folder / file for file in FILES]


def report_json(verdict: Verdict, context: Mapping[str, Any]) -> str:
    """Return the report as JSON: ``passed``, the context, and ``verdict``."""
    report = {"passed": verdict.passed, **plain(dict(context)), "verdict": verdict.to_json()}
    return json.dumps(report, indent=2, allow_nan=False) + "\n"


def report_page(
    verdict: Verdict, context: Mapping[str, Any], picture: bytes, plan: PlanView | None = None
) -> str:
    """Return the report as one HTML page that needs nothing from anywhere else."""
    name = Path(str(context.get("program", "run"))).name
    return Template(PAGE).substitute(
        name=escape(name),
        state="pass" if verdict.passed else "fail",
        word="PASS" if verdict.passed else "FAIL",
        headline=escape(_headline(verdict)),
        where=escape(
            ", ".join(
                str(context[key]) for key in ("machine", "board", "profile") if context.get(key)
            )
        ),
        tiles="".join(_tile(*tile) for tile in _tiles(verdict)),
        picture=base64.b64encode(picture).decode(),
        checks="".join(_check_row(check) for check in verdict.checks),
        places=_places(verdict, context),
        plan="" if plan is None else plan.section(_program(context)),
        dynamics=_inline(pictures.dynamics_chart(verdict)),
        deviation=_inline(pictures.deviation_chart(verdict)),
        speed_window=f"{verdict.sample.speed_window * 1e3:.3g}",
        acceleration_window=f"{verdict.sample.acceleration_window * 1e3:.3g}",
        motors="".join(_motor_row(motor) for motor in verdict.to_json()["motors"]),
        facts="".join(
            f"<tr><th>{escape(_LABELS.get(key, key))}</th><td>{_value(value)}</td></tr>"
            for key, value in context.items()
            if key not in _IN_TILES
        ),
    )


def clock_time(seconds: float) -> str:
    """Return a time for people: ``1:02:03.4`` or ``12.34 s``."""
    if seconds < 60:
        return f"{seconds:.2f} s"
    minutes, rest = divmod(round(seconds, 1), 60)
    hours, minutes = divmod(int(minutes), 60)
    return f"{hours}:{minutes:02}:{rest:04.1f}"


def _headline(verdict: Verdict) -> str:
    if verdict.passed:
        return f"all {len(verdict.checks)} checks hold on {verdict.steps:,} recorded steps"
    failed = [
        check.title + ("" if check.line is None else f" (line {check.line})")
        for check in verdict.failed
    ]
    return f"{len(failed)} of {len(verdict.checks)} checks fail: {'; '.join(failed)}"


def _tiles(verdict: Verdict) -> list[tuple[str, str, str]]:
    following, path = verdict["following"], verdict["path"]
    wrong = sum(abs(motor.lost) for motor in verdict.motors)
    return [
        (clock_time(verdict.duration), "machine time", ""),
        (f"{verdict.steps:,}", "steps", f"{verdict.edges:,} pin changes"),
        (f"{wrong}", "steps lost or too many", "exact at every standstill" if not wrong else ""),
        (_number(following.worst), "step off the plan", f"allowed {_number(following.bound)}"),
        (
            "-" if path.worst is None else f"{path.worst * 1e3:.1f} µm",
            "off the programmed path",
            f"allowed {path.bound * 1e3:.1f} µm there",
        ),
    ]


def _tile(value: str, label: str, note: str) -> str:
    return (
        f'<div class="tile"><b>{escape(value)}</b><span>{escape(label)}</span>'
        f"<small>{escape(note)}</small></div>"
    )


def _check_row(check: Check) -> str:
    sign = "≤" if check.limit == "most" else "≥"
    state = "pass" if check.passed else "fail"
    line = "" if check.line is None else str(check.line)
    time = "" if check.time is None else f"{check.time:.3f}"
    return (
        f'<tr class="{state}"><td class="mark">{"✓" if check.passed else "✗"}</td>'
        f"<td>{escape(check.title)}<small>{escape(check.detail)}</small></td>"
        f"<td>{escape(check.where)}</td>"
        f'<td class="number">{_number(check.worst)}</td>'
        f'<td class="number">{sign} {_number(check.bound)}</td>'
        f"<td>{escape(_unit(check.unit))}</td><td>{_bar(check)}</td>"
        f'<td class="number">{line}</td><td class="number">{time}</td></tr>'
    )


def _used(check: Check) -> float:
    """Return how much of its bound a check uses: 1 just reaches it."""
    if check.worst is None or not math.isfinite(check.bound):
        return 0.0
    over, under = check.worst, check.bound
    if check.limit == "least":
        over, under = under, over
    if under > 0:
        return over / under
    return 0.0 if check.passed else math.inf


def _bar(check: Check) -> str:
    """Return a bar that is full where the bound is just reached."""
    if check.worst is None:
        return ""
    return f'<div class="bar"><i style="width:{min(_used(check), 1.0):.1%}"></i></div>'


def _places(verdict: Verdict, context: Mapping[str, Any]) -> str:
    """Return rows that show the program where checks failed, or else where margins are least."""
    text = _program(context)
    tight = sorted(verdict.failed or verdict.checks, key=_used, reverse=True)
    chosen: dict[int, list[str]] = {}
    for check in tight:
        if check.line is not None and (check.line in chosen or len(chosen) < PLACES):
            chosen.setdefault(check.line, []).append(check.title)
    rows = []
    for line, titles in sorted(chosen.items()):
        code = text[line - 1].strip() if 0 < line <= len(text) else ""
        rows.append(
            f'<tr><td class="number">{line}</td><td><code>{escape(code)}</code></td>'
            f"<td>{escape('; '.join(titles))}</td></tr>"
        )
    return "".join(rows)


def _program(context: Mapping[str, Any]) -> list[str]:
    """Return the lines of the program; none if it is not there any more."""
    try:
        return Path(str(context["program"])).read_text(errors="replace").splitlines()
    except (KeyError, OSError):
        return []


def _motor_row(motor: dict[str, Any]) -> str:
    keys = ("steps", "forward", "backward", "start", "end", "planned_end", "lost", "deviation")
    cells = "".join(f'<td class="number">{_number(motor[key])}</td>' for key in keys)
    return f"<tr><td>{escape(motor['name'])}</td>{cells}</tr>"


def _unit(unit: str) -> str:
    """Return a unit as one writes it by hand."""
    return unit.replace("^2", "²").replace("us", "µs").replace("degrees", "°")


def _number(value: float | None) -> str:
    """Return a number with enough digits to compare it; a dash for none, infinity as a sign."""
    if value is None:
        return "-"
    if not math.isfinite(value):
        return "∞"
    if abs(value - round(value)) < 1e-9 and abs(value) < 1e9:
        return f"{round(value):,}"
    return f"{value:,.0f}" if 1e4 <= abs(value) < 1e9 else f"{value:.4g}"


def _value(value: Any) -> str:
    """Return a value of the context as HTML; a dictionary takes a line per entry."""
    if isinstance(value, Mapping):
        return "<br>".join(f"{escape(str(key))}: {_words(item)}" for key, item in value.items())
    return _words(value)


def _words(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{escape(str(key))} {_words(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return "<br>".join(_words(item) for item in value) or "-"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return escape(str(value))
    return _number(value)


def _inline(svg: str) -> str:
    """Return an SVG document as an element of a page."""
    return svg[svg.index("<svg") :]
