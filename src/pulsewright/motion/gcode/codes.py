"""Which codes exist, and which of them exclude each other: the modal groups of RS274/NGC."""

from __future__ import annotations

from enum import IntEnum
from typing import Final

from pulsewright.motion.moves import Plane


class Group(IntEnum):
    """A line may hold one code of each group."""

    NON_MODAL = 0
    MOTION = 1
    PLANE = 2
    DISTANCE = 3
    CENTER_DISTANCE = 4
    FEED_MODE = 5
    UNITS = 6
    CUTTER_COMPENSATION = 7
    TOOL_LENGTH = 8
    RETRACT = 9
    COORDINATES = 10
    PATH = 11
    SPINDLE_MODE = 12
    STOP = 13
    TOOL_CHANGE = 14
    SPINDLE = 15
    COOLANT = 16
    OVERRIDES = 17
    LATHE = 18
    PINS = 19
    STATE = 20
    SUBPROGRAM = 21
    SHIFT_ENDS = 22


CYCLES: Final = frozenset((730, 740, 810, 820, 830, 840, 850, 860, 870, 880, 890))
ARCS: Final = frozenset((20, 30))
PROBES: Final = frozenset((382, 383, 384, 385))
SPLINES: Final = frozenset((50, 51, 52, 53))

# G codes are keyed by ten times their number: G61.1 is 611.
G_GROUPS: Final[dict[int, Group]] = {
    code: group
    for group, codes in {
        Group.NON_MODAL: (40, 100, 280, 281, 300, 301, 520, 530, 920),
        Group.SHIFT_ENDS: (921, 922, 923),
        Group.MOTION: (
            *(0, 10, 20, 30, *sorted(SPLINES), 330, 331),
            *(*sorted(PROBES), 760, 800, *sorted(CYCLES)),
        ),
        Group.PLANE: (170, 180, 190),
        Group.DISTANCE: (900, 910),
        Group.CENTER_DISTANCE: (901, 911),
        Group.FEED_MODE: (930, 940, 950),
        Group.UNITS: (200, 210),
        Group.CUTTER_COMPENSATION: (400, 410, 411, 420, 421),
        Group.TOOL_LENGTH: (430, 431, 432, 490),
        Group.RETRACT: (980, 990),
        Group.COORDINATES: (540, 550, 560, 570, 580, 590, 591, 592, 593),
        Group.PATH: (610, 611, 640),
        Group.SPINDLE_MODE: (960, 970),
        Group.LATHE: (70, 80),
    }.items()
    for code in codes
}

M_GROUPS: Final[dict[int, Group]] = {
    code: group
    for group, codes in {
        Group.STOP: (0, 1, 2, 30, 60),
        Group.TOOL_CHANGE: (6, 61),
        Group.SPINDLE: (3, 4, 5, 19),
        Group.COOLANT: (7, 8, 9),
        Group.OVERRIDES: (48, 49, 50, 51, 52, 53),
        Group.PINS: (62, 63, 64, 65, 66, 67, 68),
        Group.STATE: (70, 71, 72, 73),
        Group.SUBPROGRAM: (98, 99),
    }.items()
    for code in codes
}

MOST_M_CODES: Final = 4  #: in a line

#: Codes of the full dialect that are refused, with what they are.
G_REFUSED: Final[dict[int, str]] = {
    **dict.fromkeys((171, 181, 191), "planes of U, V, W"),
    **dict.fromkeys((700, 710, 711, 712, 720, 721, 722), "lathe cycles"),
}

M_REFUSED: Final[dict[int, str]] = dict.fromkeys(range(100, 200), "user-defined codes")

#: Letters that mean nothing without a code that uses them, with those G and M codes.
USERS: Final[dict[str, tuple[frozenset[int], frozenset[int]]]] = {
    letter: (frozenset(g), frozenset(m))
    for letter, g, m in (
        ("I", (20, 30, 50, 51, 100, 331, 760, 870), ()),
        ("J", (20, 30, 50, 51, 100, 760, 870), ()),
        ("K", (20, 30, 330, 331, 760, 870), ()),
        ("R", (20, 30, 100, 760, *CYCLES), (19,)),
        ("P", (20, 30, 40, 50, 52, 100, 640, 740, 760, 820, 840, 860, 880, 890), (
            19, 50, 51, 52, 53, 62, 63, 64, 65, 66, 98)),
        ("Q", (50, 100, 640, 730, 760, 830), (19, 61, 66, 67, 68)),
        ("L", (52, 100, 410, 411, 420, 421, 760, *CYCLES), (66, 98)),
        ("H", (430, 432, 760), ()),
        ("D", (410, 411, 420, 421, 960), ()),
        ("E", (760,), (66, 67, 68)),
        ("$", (330, 331, 760, 950, 960, 970), (3, 4, 5, 19, 51)),
    )
}  # fmt: skip


#: Letters that say where to go.
AXIS_WORDS: Final = frozenset("XYZABCUVW@^")
# Letters of the centre of an arc, by axis.
CENTERS: Final = "IJK"
# Looking up a member of an enum takes longer than anything else done for a simple line.
MOTION: Final = Group.MOTION
PLANES: Final = {170: Plane.XY, 180: Plane.ZX, 190: Plane.YZ}
SWITCHES: Final = {
    50: "FEED_OVERRIDE",
    51: "SPEED_OVERRIDE",
    52: "ADAPTIVE_FEED",
    53: "FEED_HOLD",
}
SYSTEM_CODES: Final = tuple(k for k, group in G_GROUPS.items() if group is Group.COORDINATES)


def g_name(code: int) -> str:
    """Return how a G code is written: ``G61.1`` for 611."""
    whole, tenth = divmod(code, 10)
    return f"G{whole}.{tenth}" if tenth else f"G{whole}"


def code_name(letter: str, code: int) -> str:
    """Return how a G or M code is written."""
    return g_name(code) if letter == "G" else f"M{code}"
