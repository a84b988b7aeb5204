"""Numbered and named parameters, and the file that keeps some of them between programs."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final, NoReturn

from pulsewright.errors import UsageError

if TYPE_CHECKING:
    from pulsewright.motion.gcode.expressions import Span

LAST_PARAMETER: Final = 5601
LOCALS: Final = 30  # #1 to #30 belong to the subroutine that runs
READ_ONLY: Final = range(5400, 5429)  # tool and position

# Where the dialect keeps positions: nine numbers from each of these, for X Y Z A B C U V W.
HOME: Final = {280: 5161, 300: 5181}
PROBED: Final = 5061
G92_ON: Final = 5210
G92_OFFSET: Final = 5211
SYSTEM: Final = 5220
SYSTEM_OFFSET: Final = 5221  # of G54; the others follow 20 apart
ROTATION: Final = 9  # behind the offset of its system
INPUT: Final = 5399  # what M66 saw
TOOL: Final = 5400  # number, then offsets, diameter, angles and orientation
POSITION: Final = 5420
DEBUG: Final = 5599  # above 0: (DEBUG,...) is said

#: Numbers that a parameter file always holds.
KEPT: Final = frozenset(
    n
    for first in (5161, 5181, 5211, *range(5221, 5382, 20))
    for n in range(first, first + (10 if first > 5220 else 9))
) | {G92_ON, SYSTEM}

_MESSAGE_PART: Final = re.compile(r"#<([^>]*)>|#([0-9]{1,9})|%(?:d|(?:\.([0-9]))?f|(?=\.))")


class Parameters:
    """Numbered and named parameters.

    Members
    -------
    numbered : list of float
        By number, from 1.
    local, world : dict of str to float
        Named parameters of the running subroutine, and those that begin with ``_``.
    position : callable
        Gives #5420 to #5428, the program position of an axis by its column.
    predefined : mapping of str to callable
        Named parameters that tell the state of the machine.
    """

    #: Names that the machine gives.
    PREDEFINED: Final = frozenset(
        [
            "_VMAJOR",
            "_VMINOR",
            "_LINE",
            "_MOTION_MODE",
            "_PLANE",
            "_CCOMP",
            "_METRIC",
            "_IMPERIAL",
            "_ABSOLUTE",
            "_INCREMENTAL",
            "_INVERSE_TIME",
            "_UNITS_PER_MINUTE",
            "_UNITS_PER_REV",
            "_COORD_SYSTEM",
            "_TOOL_OFFSET",
            "_RETRACT_R_PLANE",
            "_RETRACT_OLD_Z",
            "_SPINDLE_RPM_MODE",
            "_SPINDLE_CSS_MODE",
            "_IJK_ABSOLUTE_MODE",
            "_LATHE_DIAMETER_MODE",
            "_LATHE_RADIUS_MODE",
            "_SPINDLE_ON",
            "_SPINDLE_CW",
            "_MIST",
            "_FLOOD",
            "_SPEED_OVERRIDE",
            "_FEED_OVERRIDE",
            "_ADAPTIVE_FEED",
            "_FEED_HOLD",
            "_FEED",
            "_RPM",
            "_X",
            "_Y",
            "_Z",
            "_A",
            "_B",
            "_C",
            "_U",
            "_V",
            "_W",
            "_ABS_X",
            "_ABS_Y",
            "_ABS_Z",
            "_ABS_A",
            "_ABS_B",
            "_ABS_C",
            "_CURRENT_TOOL",
            "_CURRENT_POCKET",
            "_SELECTED_TOOL",
            "_SELECTED_POCKET",
            "_VALUE",
            "_VALUE_RETURNED",
            "_TASK",
            "_CALL_LEVEL",
            "_REMAP_LEVEL",
        ]
    )

    def __init__(self) -> None:
        self.numbered = [0.0] * (LAST_PARAMETER + 1)
        self.numbered[SYSTEM] = self.numbered[DEBUG] = 1.0
        self.local: dict[str, float] = {}
        self.world: dict[str, float] = {}
        self.position: Callable[[int], float] = lambda _: 0.0
        self.predefined: Mapping[str, Callable[[], float]] = {}

    def get(self, key: int | str) -> float | None:
        """Return a value; None for a name that was never set or a number that does not exist."""
        if isinstance(key, str):
            if key[:1] != "_":
                return self.local.get(key)
            known = self.predefined.get(key)
            return self.world.get(key) if known is None else known()
        if POSITION <= key < POSITION + 9:
            return self.position(key - POSITION)
        return self.numbered[key] if 1 <= key <= LAST_PARAMETER else None

    def set(self, key: int | str, value: float) -> None:
        """Set a value that `check` let pass."""
        if isinstance(key, int):
            self.numbered[key] = value
        elif key[:1] == "_":
            self.world[key] = value
        else:
            self.local[key] = value

    def check(self, key: int | str, span: Span) -> None:
        """Refuse to set what cannot be set.

        Raises
        ------
        Fault
            At ``span``.
        """
        if isinstance(key, int):
            if not 1 <= key <= LAST_PARAMETER:
                self.refuse(key, span)
            if key in READ_ONLY:
                span.fail(f"parameter #{key} is given by the machine; it cannot be set")
        elif key in self.PREDEFINED:
            span.fail(f"parameter #<{key.lower()}> is given by the machine; it cannot be set")

    def refuse(self, key: int | str, span: Span) -> NoReturn:
        """Raise a fault about a parameter that has no value."""
        if isinstance(key, int):
            span.fail(f"parameter #{key} does not exist; they are 1 to {LAST_PARAMETER}")
        span.fail(f"parameter #<{key.lower()}> has not been set")

    def fill_in(self, text: str) -> str:
        """Return the text of a message with values for ``#1`` and ``#<name>``.

        ``%d``, ``%f`` (4 decimals) and ``%.2f`` set the decimals of what follows; else there are 6.
        A parameter that is not set shows as ``######``.
        """
        decimals = 6

        def replace(match: re.Match[str]) -> str:
            nonlocal decimals
            name, number, digits = match.groups()
            if name is None and number is None:
                if match[0] != "%":  # which alone is lost before a point
                    decimals = 0 if match[0] == "%d" else int(digits or 4)
                return ""
            key = int(number) if name is None else "".join(name.split()).upper()
            value = self.get(key)
            return "######" if value is None else f"{value:.{decimals}f}"

        return _MESSAGE_PART.sub(replace, text)


def read_parameters(path: str | Path) -> dict[int, float]:
    """Read a parameter file: a number and its value in each line.

    A missing file holds nothing. Text behind ``#`` or ``;`` is a comment.

    Raises
    ------
    UsageError
        If a line is something else; it names the line.
    """
    path = Path(path)
    if not path.exists():
        return {}
    values: dict[int, float] = {}
    for n, line in enumerate(path.read_text().splitlines(), 1):
        words = re.split("[#;]", line)[0].split()
        if not words:
            continue
        try:
            number, value = int(words[0]), float(words[1])
        except (ValueError, IndexError):
            raise UsageError(
                f"{path}:{n}: '{line.strip()}' is no parameter; write a number and its value, "
                "as in '5221 10.5'"
            ) from None
        if not 1 <= number <= LAST_PARAMETER or number in values:
            why = "stands twice" if number in values else f"is not within 1 to {LAST_PARAMETER}"
            raise UsageError(f"{path}:{n}: parameter {number} {why}")
        values[number] = value
    return values


def write_parameters(path: str | Path, values: Mapping[int, float]) -> None:
    """Write a parameter file: first in full beside the old one, then in its place at once.

    The old file stays as ``PATH.bak``, so a crash or a full disk never loses both.
    """
    write_safely(path, "".join(f"{n}\t{values[n]:.6f}\n" for n in sorted(values)))


def write_safely(path: str | Path, text: str) -> None:
    """Replace a text file at once; what was there stays as ``PATH.bak``."""
    path = Path(path)
    new, old = (path.with_name(path.name + end) for end in (".new", ".bak"))
    with new.open("w") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    if path.exists():
        old.write_bytes(path.read_bytes())
    new.replace(path)
