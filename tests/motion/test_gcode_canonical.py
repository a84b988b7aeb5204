"""Canonical calls: what LinuxCNC's own test suite expects of an interpreter."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import pytest

from pulsewright.motion.gcode import canonical
from pulsewright.motion.gcode.run import STAND_ALONE
from pulsewright.motion.gcode.tools import read_tools
from pulsewright.units import INCH

NUMBER = re.compile(r"-?\d+\.\d+")

CASES = [
    "ccomp__mill-line-arc-entry",
    "ccomp__mill-zchanges",
    "interp__crazy-paths",
    "interp__do-while-break",
    "interp__exists",
    "interp__fractional-linenumbers",
    "interp__g10__g10-l1-l10",
    "interp__g10__g10-l2-while-active",
    "interp__g33.1",
    "interp__g52__g52-g92-interaction",
    "interp__g6164",
    "interp__g81__g17__g98",
    "interp__g81__g18__g99",
    "interp__g84__g17__g99",
    "interp__g84__g19__g98",
    "interp__inverse-time-with-comp",
    "interp__m98m99__01-basics",
    "interp__m98m99__02-variables",
    "interp__m98m99__05-M98-loops",
    "interp__m98m99__07-nested-subs",
    "interp__m98m99__08-sub-follows-main",
    "interp__m98m99__10-M98-P001",
    "interp__m98m99__14-o-expression-call",
    "interp__magic_comments__param_format_printing",
    "interp__namedparam-bug424",
    "interp__oword-bug315",
    "interp__return-value",
    "interp__rotation__abs-pts",
    "interp__rotation__g28",
    "interp__subs-follow-main",
    "interp__unit-conversion",
    "m70-m73__m70m72-restore.0",
    "oword__sub.0",
    "oword__while.0",
]


def run(path, table=None):
    """Return the canonical text of a program."""
    tools = read_tools(table, INCH) if table else None
    lines = []
    canonical(path, lines.append, settings=replace(STAND_ALONE, tools=tools))
    return "".join(lines)


def normal(text, *, strip=False, only=None):
    """Return names, other text and numbers of each line; spaces count once."""
    found = []
    for line in text.splitlines():
        words = line.split()[1:] if strip else line.split()
        joined = " ".join(words)
        if not words or (only and only not in joined):
            continue
        numbers = [float(n) for n in NUMBER.findall(joined)]
        found.append((NUMBER.sub("?", joined), numbers))
    return found


def assert_same(ours, theirs, tolerance=1e-4):
    for i, (mine, other) in enumerate(zip(ours, theirs, strict=False)):
        assert mine[0] == other[0], f"call {i}: {ours[i]} instead of {theirs[i]}"
        assert mine[1] == pytest.approx(other[1], abs=tolerance), f"call {i}: {mine} {other}"
    assert len(ours) == len(theirs)


def test_every_case_is_listed(conformance):
    assert {c["case"] for c in json.loads((conformance / "cases.json").read_text())} == set(CASES)


@pytest.mark.parametrize("name", CASES)
def test_conformance(conformance, name):
    case = {c["case"]: c for c in json.loads((conformance / "cases.json").read_text())}[name]
    folder = conformance / name
    table = folder / case["tool_table"] if case["tool_table"] else None
    ours = normal(
        run(folder / case["program"], table),
        strip=case["line_numbers_stripped"],
        only=case["only"],
    )
    assert_same(ours, normal((folder / "expected").read_text()))
