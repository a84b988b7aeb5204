"""The tool table: read from LinuxCNC's format, written back safely."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from pulsewright.errors import UsageError
from pulsewright.motion.gcode.parameters import write_safely

_ENTRY: Final = re.compile(r"([TPXYZABCUVWDIJQ])([+-]?(?:\d+\.?\d*|\.\d+))", re.IGNORECASE)


@dataclass(frozen=True)
class Tool:
    """One tool.

    Parameters
    ----------
    number, pocket : int
        T and P of the table.
    offset : (6,) floats
        Along X Y Z A B C [mm, degrees]; Z is the length.
    diameter : float
        Of a mill, or twice the nose radius of a lathe tool [mm].
    front_angle, back_angle : float
        Of a lathe tool [degrees].
    orientation : int
        Of a lathe tool, 0 to 9.
    comment : str
        What the table says about it.
    """

    number: int
    pocket: int = 0
    offset: tuple[float, ...] = (0.0,) * 6
    diameter: float = 0.0
    front_angle: float = 0.0
    back_angle: float = 0.0
    orientation: int = 0
    comment: str = ""


def read_tools(path: str | Path, unit: float = 1.0) -> dict[int, Tool]:
    """Read a tool table, by tool number.

    Parameters
    ----------
    path : str or Path
        A file with one tool in each line: ``T1 P1 Z10.5 D6 ;comment``.
    unit : float
        Length unit of the table [mm].

    Raises
    ------
    UsageError
        If the file cannot be read, or a line is no tool; it names the line.
    """
    try:
        lines = Path(path).read_text().splitlines()
    except OSError as error:
        raise UsageError(f"{path}: the tool table cannot be read: {error.strerror}") from None
    tools: dict[int, Tool] = {}
    for n, line in enumerate(lines, 1):
        text, _, comment = line.partition(";")
        words = "".join(text.split())
        if not words:
            continue
        found = _ENTRY.findall(words)
        entry = {letter.upper(): float(value) for letter, value in found}
        if "".join(a + b for a, b in found) != words or len(entry) < len(found) or "T" not in entry:
            raise UsageError(
                f"{path}:{n}: '{line.strip()}' is no tool; write its number, pocket, offsets and "
                "diameter, as in 'T1 P1 Z10.5 D6 ;comment'"
            )
        number, pocket, orientation = (int(entry.get(letter, 0)) for letter in "TPQ")
        if number in tools:
            raise UsageError(f"{path}:{n}: tool {number} stands twice")
        tools[number] = Tool(
            number,
            pocket,
            tuple(entry.get(a, 0.0) * (unit if a in "XYZ" else 1.0) for a in "XYZABC"),
            entry.get("D", 0.0) * unit,
            entry.get("I", 0.0),
            entry.get("J", 0.0),
            orientation,
            comment.strip(),
        )
    return tools


def write_tools(path: str | Path, tools: Mapping[int, Tool], unit: float = 1.0) -> None:
    """Write a tool table that `read_tools` reads; the old one stays as ``PATH.bak``."""
    lines = []
    for tool in tools.values():
        words = [f"T{tool.number}", f"P{tool.pocket}"]
        offset = zip("XYZABC", tool.offset, strict=True)
        lengths = {a: v / (unit if a in "XYZ" else 1.0) for a, v in offset}
        angles = {"D": tool.diameter / unit, "I": tool.front_angle, "J": tool.back_angle}
        words += [f"{letter}{v:+.6f}" for letter, v in {**lengths, **angles}.items() if v]
        words += [f"Q{tool.orientation}"] if tool.orientation else []
        lines.append(" ".join(words) + (f" ;{tool.comment}" if tool.comment else "") + "\n")
    write_safely(path, "".join(lines))


def with_offset(tool: Tool, axis: int, value: float) -> Tool:
    """Return the tool with another offset along an axis."""
    offset = list(tool.offset)
    offset[axis] = value
    return replace(tool, offset=tuple(offset))
