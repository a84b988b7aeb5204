"""Which codes exist, and which of them exclude each other: the modal groups of RS274/NGC."""

from __future__ import annotations

from enum import IntEnum
from typing import Final


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


# G codes are keyed by ten times their number: G61.1 is 611.
G_GROUPS: Final[dict[int, Group]] = {
    code: group
    for group, codes in {
        Group.NON_MODAL: (40, 100, 280, 281, 300, 301, 530, 920, 921, 922, 923),
        Group.MOTION: (0, 10, 20, 30, 800),
        Group.PLANE: (170, 180, 190),
        Group.DISTANCE: (900, 910),
        Group.CENTER_DISTANCE: (901, 911),
        Group.FEED_MODE: (930, 940),
        Group.UNITS: (200, 210),
        Group.CUTTER_COMPENSATION: (400,),
        Group.TOOL_LENGTH: (430, 490),
        Group.RETRACT: (980, 990),
        Group.COORDINATES: (540, 550, 560, 570, 580, 590, 591, 592, 593),
        Group.PATH: (610, 611, 640),
        Group.SPINDLE_MODE: (970,),
    }.items()
    for code in codes
}

M_GROUPS: Final[dict[int, Group]] = {
    code: group
    for group, codes in {
        Group.STOP: (0, 1, 2, 30),
        Group.TOOL_CHANGE: (6,),
        Group.SPINDLE: (3, 4, 5),
        Group.COOLANT: (7, 8, 9),
        Group.OVERRIDES: (48, 49),
    }.items()
    for code in codes
}

#: Codes of the full dialect that are refused, with what they are.
G_REFUSED: Final[dict[int, str]] = {
    **dict.fromkeys((50, 51, 52, 53), "splines"),
    **dict.fromkeys((70, 80), "lathe diameter and radius mode"),
    **dict.fromkeys((171, 181, 191), "planes of U, V, W"),
    **dict.fromkeys((330, 331, 760), "spindle-synchronised motion"),
    **dict.fromkeys((382, 383, 384, 385), "probing"),
    **dict.fromkeys((410, 411, 420, 421), "cutter compensation"),
    **dict.fromkeys((431, 432), "dynamic tool offsets"),
    520: "local offsets",
    **dict.fromkeys((700, 710, 711, 712, 720, 721, 722), "lathe cycles"),
    **dict.fromkeys((730, 740, 810, 820, 830, 840, 850, 860, 870, 880, 890), "canned cycles"),
    950: "feed per revolution",
    960: "constant surface speed",
}

M_REFUSED: Final[dict[int, str]] = {
    19: "spindle orientation",
    **dict.fromkeys((50, 51, 52, 53), "override switches"),
    60: "pallet change",
    61: "setting the tool number",
    **dict.fromkeys(range(62, 69), "digital and analog pins"),
    **dict.fromkeys((70, 71, 72, 73), "saving the modal state"),
    **dict.fromkeys((98, 99), "subroutines"),
    **dict.fromkeys(range(100, 200), "user-defined codes"),
}


def g_name(code: int) -> str:
    """Return how a G code is written: ``G61.1`` for 611."""
    whole, tenth = divmod(code, 10)
    return f"G{whole}.{tenth}" if tenth else f"G{whole}"
