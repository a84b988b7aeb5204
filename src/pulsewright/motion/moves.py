"""What a program asks for: straight and circular moves in machine coordinates, in columns."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import IntEnum
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.errors import UsageError

AXES: Final = "XYZABC"  # columns of every position: X Y Z in mm, A B C in degrees


class MoveKind(IntEnum):
    """Geometry of one move."""

    LINE = 0
    ARC = 1  # circle or helix
    DWELL = 2  # no motion for ``dwell`` seconds


class Plane(IntEnum):
    """Plane of an arc, by the axis it turns about."""

    YZ = 0  # about X, G19
    ZX = 1  # about Y, G18
    XY = 2  # about Z, G17

    @property
    def axes(self) -> tuple[int, int]:
        """Columns (first, second) of the plane; first to second is counterclockwise (G3)."""
        return (self + 1) % 3, (self + 2) % 3


@dataclass(frozen=True)
class Moves:
    """The motion of a program: n moves, each from where the one before it ends.

    Parameters
    ----------
    start : (6,) float64
        Machine position before the first move [mm, degrees].
    kind, plane : (n,) int8
        `MoveKind`; `Plane` of an arc.
    rapid : (n,) bool
        Traverse at the machine's limits (G0).
    line : (n,) int32
        Line of the program, from 1.
    end : (n, 6) float64
        Machine position after the move [mm, degrees].
    center : (n, 3) float64
        Centre of an arc; the column of the plane's normal axis is not used [mm].
    sweep : (n,) float64
        Signed angle of an arc [rad]; positive is counterclockwise (G3) seen against the normal.
    feed : (n,) float64
        Programmed speed [mm/s] along X, Y, Z where one of them moves, else [degrees/s] along
        A, B, C. Infinite for rapids.
    dwell : (n,) float64
        Time of a dwell [s].
    tolerance : (n,) float64
        How far the path may pass from the programmed corner at the end of this move [mm];
        0 = the machine comes to rest there.
    collapse : (n,) float64
        How far the path may pass from straight feeds that one straight line replaces [mm] (G64 Q,
        the naive CAM tolerance). What is not more than ``tolerance`` changes nothing: within that,
        lines may be replaced anyway. All 0 where not given.
    pitch : (n,) float64
        Travel along the move per turn of the spindle [mm], for moves that keep to its angle (G33,
        G33.1, G76); 0 = not synchronised. ``feed`` is then right at the programmed spindle speed.
        All 0 where not given.
    """

    start: NDArray[np.float64]
    kind: NDArray[np.int8]
    plane: NDArray[np.int8]
    rapid: NDArray[np.bool_]
    line: NDArray[np.int32]
    end: NDArray[np.float64]
    center: NDArray[np.float64]
    sweep: NDArray[np.float64]
    feed: NDArray[np.float64]
    dwell: NDArray[np.float64]
    tolerance: NDArray[np.float64]
    collapse: NDArray[np.float64] = None  # type: ignore[assignment]  # set below
    pitch: NDArray[np.float64] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        for name in ("collapse", "pitch"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.zeros(len(self.kind)))

    def __len__(self) -> int:
        return len(self.kind)

    def require_sound(self) -> None:
        """Check types, shapes and values, as programs that make moves by themselves may err.

        Raises
        ------
        UsageError
            If a column has another type or shape than said above, or a value that means nothing;
            the message names the first such move.
        """
        count = len(np.atleast_1d(self.kind))
        for name, dtype, wide in _LAYOUT:
            column, shape = getattr(self, name), wide if name == "start" else (count, *wide)
            sound = isinstance(column, np.ndarray) and column.dtype == dtype
            if not sound or column.shape != shape:
                found = f"{getattr(column, 'dtype', type(column).__name__)} {np.shape(column)}"
                raise UsageError(
                    f"moves.{name} is {found}; for {count} moves it must be an array of "
                    f"{dtype} {shape}"
                )
        if not np.isfinite(self.start).all():
            raise UsageError(f"moves.start is {self.start.tolist()}; positions must be finite")
        self._require(_is_one_of(self.kind, MoveKind), "kind", "that of a MoveKind")
        line = self.kind != MoveKind.ARC
        if not line.all():
            normal = np.arange(3) == self.plane[:, None]
            center, swept = np.isfinite(self.center) | normal, np.isfinite(self.sweep)
            self._require(_is_one_of(self.plane, Plane) | line, "plane", "that of a Plane")
            self._require(center | line[:, None], "center", "finite")
            self._require(swept & (self.sweep != 0) | line, "sweep", "finite and not 0")
        driven = (self.feed > 0) | self.rapid | (self.kind == MoveKind.DWELL)
        self._require(np.isfinite(self.end), "end", "finite")
        self._require(driven, "feed", "above 0")
        for name in ("dwell", "tolerance", "collapse", "pitch"):
            column = getattr(self, name)
            self._require((column >= 0) & (column < np.inf), name, "finite, 0 or more")

    def _require(self, fine: NDArray[np.bool_], name: str, rule: str) -> None:
        """Raise the error of `require_sound` for the first value of a column that is not fine."""
        if not fine.all():
            n = int(np.argwhere(~fine)[0, 0])
            raise UsageError(
                f"moves.{name}[{n}] is {getattr(self, name)[n].tolist()} (line {self.line[n]} of "
                f"the program); it must be {rule}"
            )

    def starts(self) -> NDArray[np.float64]:
        """Return the position before each move, shape (n, 6)."""
        return np.concatenate([self.start[None], self.end[:-1]])[: len(self)]

    def part(self, begin: int, end: int | None = None) -> Moves:
        """Return the moves from ``begin`` to before ``end``."""
        start = self.end[begin - 1] if begin else self.start
        return Moves(start, *(column[begin:end] for column in self._columns()))

    def followed_by(self, more: Moves) -> Moves:
        """Return these moves and then ``more``, which begin where these end."""
        pairs = zip(self._columns(), more._columns(), strict=True)
        return Moves(self.start, *(np.concatenate(pair) for pair in pairs))

    def _columns(self) -> list[NDArray[Any]]:
        return [getattr(self, column.name) for column in fields(self)[1:]]


def _is_one_of(column: NDArray[np.int8], members: type[IntEnum]) -> NDArray[np.bool_]:
    """Return where a column has values of members, which are numbered from 0."""
    return column.view(np.uint8) < len(members)


def _layout() -> list[tuple[str, np.dtype[Any], tuple[int, ...]]]:
    """Return name and type of each column of `Moves`, and the shape of an entry."""
    types = {"kind": np.int8, "plane": np.int8, "rapid": np.bool_, "line": np.int32}
    wide = {"start": (6,), "end": (6,), "center": (3,)}
    names = [column.name for column in fields(Moves)]
    return [(name, np.dtype(types.get(name, np.float64)), wide.get(name, ())) for name in names]


_LAYOUT: Final = _layout()


@dataclass(frozen=True)
class Event:
    """Something that happens between moves: before move ``at``.

    The machine is at rest there, except for ``message``, ``mist``, ``flood``, ``output`` that goes
    with the motion (M62, M63, M67) and another speed of a turning spindle: these do not interrupt
    it.

    ``kind`` is one of ``spindle`` (value: signed rev/min, 0 off), ``orient`` (degrees), ``tool``
    (number), ``mist``, ``flood`` (0 or 1), ``output`` (value; text: what is set), ``input`` (text:
    what is waited for), ``pause`` (M0, M1), ``message`` (text), ``end`` (M2, M30).
    """

    at: int
    line: int
    kind: str
    value: float = 0.0
    text: str = ""


@dataclass(frozen=True)
class Program:
    """An interpreted program: its moves, and what happens between them."""

    path: str
    moves: Moves
    events: tuple[Event, ...] = field(default=())
