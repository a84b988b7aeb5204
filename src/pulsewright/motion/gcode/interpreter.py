"""The state of a program under interpretation, and the order in which a line is carried out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from pulsewright.errors import GcodeError, UsageError
from pulsewright.motion.gcode import arcs
from pulsewright.motion.gcode.arcs import RESOLUTION
from pulsewright.motion.gcode.codes import (
    G_GROUPS,
    G_REFUSED,
    M_GROUPS,
    M_REFUSED,
    Group,
    g_name,
)
from pulsewright.motion.gcode.reader import Block, Fault, Parameters, read_block
from pulsewright.motion.gcode.recorder import Recorder
from pulsewright.motion.moves import AXES, Plane, Program
from pulsewright.units import INCH, MINUTE

SYSTEMS: Final = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")
ZERO: Final = (0.0,) * len(AXES)

FARTHEST: Final = 1e9  # [mm, degrees] that one move may go
ARC_TOLERANCE: Final = {1.0: 0.005, INCH: 0.0005 * INCH}  # of radii, by length unit [mm]
REACH_TOLERANCE: Final = {1.0: 0.00127, INCH: 0.00005 * INCH}  # of R against half the chord [mm]

# Where the full dialect keeps positions: six parameters from each of these [mm, degrees].
HOME: Final = {280: 5161, 300: 5181}
G92_OFFSET: Final = 5211
SYSTEM: Final = 5220
SYSTEM_OFFSET: Final = 5221  # of G54, the others follow 20 apart

_AXIS_WORDS: Final = frozenset("XYZABCUVW")
_CENTERS: Final = "IJK"
_CENTER_WORDS: Final = frozenset(_CENTERS)
_ARCS: Final = frozenset((20, 30))
_USES_AXES: Final = frozenset((100, 280, 300, 920))  # non-modal codes that take the axis words

# Letters that mean nothing without a code that uses them, with those codes.
_USERS: Final[dict[str, tuple[int, ...]]] = {
    "I": (20, 30),
    "J": (20, 30),
    "K": (20, 30),
    "R": (20, 30, 100),
    "P": (20, 30, 40, 100, 640),
    "Q": (640,),
    "L": (100,),
    "H": (430,),
    "D": (),
    "E": (),
}
_USELESS: Final = {
    "D": "D belongs to cutter compensation, which is not supported yet",
    "E": "exponents, as in 1e3, are not part of the language",
}
_SYSTEM_CODES: Final = tuple(c for c, group in G_GROUPS.items() if group is Group.COORDINATES)
_WITH_USERS: Final = frozenset(_USERS)

# Looking up a member of an enum takes longer than anything else done for a simple line.
_MOTION: Final = Group.MOTION
_NON_MODAL: Final = Group.NON_MODAL
_STOP: Final = Group.STOP
_NO_GROUPS: Final[Mapping[Group, int]] = {}
_ONE_GROUP: Final[dict[int, Mapping[Group, int]]] = {
    code: {group: code} for code, group in G_GROUPS.items()
}


@dataclass(frozen=True)
class InterpreterSettings:
    """What a program takes from the machine.

    Parameters
    ----------
    axes : str
        Axes that the machine has, of "XYZABC".
    start : (6,) floats
        Machine position before the first move [mm, degrees].
    work_offsets : mapping of str to (6,) floats
        Origins of "G54" to "G59.3" in machine coordinates [mm, degrees]; 0 where not given.
    tools : mapping of int to float, or None
        Lengths of the tools along Z [mm]. None: the machine has no tool table, all lengths are 0.
    home, second_home : (6,) floats
        Machine positions for G28 and G30 until the program stores others [mm, degrees].
    path_tolerance : float
        How far the path may pass from a programmed corner in G64 without P [mm], above 0.
    exact_tolerance : float
        How far it may pass in G61 [mm], 0 or more: some fraction of a step.
    block_delete : bool
        Skip lines that begin with ``/``.
    """

    axes: str = "XYZ"
    start: Sequence[float] = ZERO
    work_offsets: Mapping[str, Sequence[float]] = field(default_factory=dict)
    tools: Mapping[int, float] | None = None
    home: Sequence[float] = ZERO
    second_home: Sequence[float] = ZERO
    path_tolerance: float = 0.05
    exact_tolerance: float = 0.001
    block_delete: bool = False

    def __post_init__(self) -> None:
        if not self.axes or set(self.axes) - set(AXES) or len(set(self.axes)) < len(self.axes):
            raise UsageError(f"axes must be different letters of {AXES}, not '{self.axes}'")
        if unknown := set(self.work_offsets) - set(SYSTEMS):
            raise UsageError(
                f"unknown work offset {', '.join(sorted(unknown))}; there are {', '.join(SYSTEMS)}"
            )
        positions = {"start": self.start, "home": self.home, "second_home": self.second_home}
        for name, position in {**positions, **self.work_offsets}.items():
            if len(position) != len(AXES) or not all(map(math.isfinite, position)):
                raise UsageError(
                    f"{name} must be {len(AXES)} finite numbers, one for each of {AXES}"
                )
        if not self.path_tolerance > 0:
            raise UsageError(f"path_tolerance must be above 0 mm, not {self.path_tolerance:g}")
        if not self.exact_tolerance >= 0:
            raise UsageError(f"exact_tolerance must be 0 mm or more, not {self.exact_tolerance:g}")


def interpret(path: str | Path, *, settings: InterpreterSettings | None = None) -> Program:
    """Interpret a program file.

    Raises
    ------
    GcodeError
        If the file cannot be read, is not text, is empty, or asks for what cannot be done; with
        line and column where there are any.

    Examples
    --------
    >>> program = interpret("examples/rosette.ngc")
    >>> len(program.moves), program.moves.end[-1]
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise GcodeError("no such file", path=path) from None
    except IsADirectoryError:
        raise GcodeError("this is a directory; name a program file", path=path) from None
    except OSError as error:
        raise GcodeError(f"cannot be read: {error.strerror}", path=path) from None
    if b"\0" in data:
        raise GcodeError("this is not a text file (it holds NUL bytes)", path=path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Old programs have comments in 8-bit encodings; such bytes are refused elsewhere.
        text = data.decode("latin-1")
    return interpret_text(text, path, settings=settings)


def interpret_text(
    text: str, path: str | Path = "program", *, settings: InterpreterSettings | None = None
) -> Program:
    r"""Interpret a program given as text; ``path`` names it in errors and in the result.

    Raises
    ------
    GcodeError
        As `interpret`.

    Examples
    --------
    >>> interpret_text("G0 X10 \n G1 X20 F600").moves.feed
    array([inf, 10.])
    """
    settings = settings or InterpreterSettings()
    recorder = Recorder(settings.start)
    interpreter = Interpreter(settings, recorder)
    number = 0
    try:
        for number, line in enumerate(
            text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), 1
        ):
            interpreter.line(line, number)
            if interpreter.ended:
                break
        interpreter.finish()
    except Fault as fault:
        raise GcodeError(
            fault.message, path=path, line=number, column=fault.column, text=fault.text
        ) from None
    if interpreter.empty:
        raise GcodeError("the program is empty: it holds no words", path=path)
    return recorder.program(str(path))


class Interpreter:
    """Carries out one line after the other, as RS274/NGC orders it.

    Positions are machine coordinates [mm, degrees] throughout; words are turned into them at once,
    so a change of units or offsets changes nothing that is already known.

    Parameters
    ----------
    settings : InterpreterSettings
        The machine.
    recorder : Recorder
        Where motion and events go.
    """

    def __init__(self, settings: InterpreterSettings, recorder: Recorder) -> None:
        self.settings = settings
        self.recorder = recorder
        self.empty = True
        self.ended = False
        self._skip_deleted = settings.block_delete
        self._percent = False  # the program stands between two % lines
        self._line = 0

        self._axis = {letter: AXES.index(letter) for letter in settings.axes}
        self._foreign = _AXIS_WORDS - set(settings.axes)
        self._position = list(map(float, settings.start))

        self.parameters = Parameters(self._program_position)
        self._store(HOME[280], settings.home)
        self._store(HOME[300], settings.second_home)
        for i, name in enumerate(SYSTEMS):
            self._store(SYSTEM_OFFSET + 20 * i, settings.work_offsets.get(name, ZERO))

        self._motion: int | None = None
        self._plane = Plane.XY
        self._absolute = True
        self._absolute_centers = False
        self._inverse_time = False
        self._scale = 1.0  # [mm] of one length unit
        self._scales = list(ZERO)  # of each axis
        self._linear_feed = 0.0  # [mm/s]
        self._angular_feed = 0.0  # [degrees/s]
        self._speed = 0.0  # [rev/min]
        self._spindle = 0  # 1 clockwise, -1 counterclockwise
        self._tool = self._next_tool = 0
        self._tool_length = 0.0  # [mm]
        self._work = list(ZERO)
        self._g92 = list(ZERO)
        self._origin = list(ZERO)  # sum of all offsets: machine position of program position 0
        self._use_units(210)
        self._use_system(1)
        recorder.path_tolerance(settings.path_tolerance)

    def line(self, text: str, number: int) -> None:
        """Carry out one line.

        Raises
        ------
        Fault
            If it cannot be done, with its column.
        """
        if "%" in text and text.strip() == "%":
            self.ended = self._percent or not self.empty
            self._percent = True
            return
        block = read_block(text, self.parameters, skip_deleted=self._skip_deleted)
        if block is None:
            return
        self.empty = False
        self._line = number
        for key, value in block.settings:
            self.parameters.set(key, value)
        self._execute(block)

    def finish(self) -> None:
        """Check, after the last line, that a program begun with % is whole.

        Raises
        ------
        Fault
            If it is not.
        """
        if self._percent and not self.ended:
            raise Fault("the file began with % and ends without one; it may have been cut short")

    # What a line asks for, and in which order it is done

    def _execute(self, block: Block) -> None:
        words = block.words
        groups = self._classify(block) if block.g or block.m else _NO_GROUPS
        command = groups.get(_NON_MODAL)
        motion = groups.get(_MOTION)
        has_axes = not _AXIS_WORDS.isdisjoint(words)
        if has_axes and not self._foreign.isdisjoint(words):
            axes = " ".join(self.settings.axes)
            raise block.fault(f"the machine has no such axis; it has {axes}", self._foreign)
        if command in _USES_AXES:
            if motion is not None and motion != 800:
                raise block.fault(
                    f"{g_name(command)} and {g_name(motion)} would both use the axis words; "
                    "give them lines of their own",
                    "G",
                    motion,
                )
        elif has_axes:
            motion = self._motion if motion is None else motion
            if motion is None or motion == 800:
                raise block.fault(
                    "axis words without a motion mode; begin with G0, G1, G2 or G3", _AXIS_WORDS
                )
        elif motion is None and self._motion in _ARCS and not _CENTER_WORDS.isdisjoint(words):
            motion = self._motion  # a full circle by its centre alone
        if not _WITH_USERS.isdisjoint(words):
            self._check_users(block, motion)
        modes = len(groups) > (_MOTION in groups)

        for kind, text in block.messages:
            if kind != "msg":
                text = self.parameters.fill_in(text)  # noqa: PLW2901
            self.recorder.event("message", self._line, text=text, rest=False)
        if modes:
            self._change_feed_mode_and_units(groups)
        if "F" in words:
            self._set_feed(block)
        if "S" in words:
            self._set_speed(block, groups)
        if "T" in words:
            self._next_tool = self._whole(block, "T")
        if modes:
            self._change_modes(block, groups)
        if command is not None and command != 530:
            self._do(command, block, has_axes)
        if motion is not None:
            if _MOTION in groups:
                self._motion = None if motion == 800 else motion
            if motion in _ARCS:
                self._arc(block, clockwise=motion == 20, machine=command == 530)
            elif has_axes and command not in _USES_AXES:
                end = self._target(block, machine=command == 530)
                self._straight(block, end, rapid=motion == 0)
        if _STOP in groups:
            self._stop(groups[_STOP])

    def _classify(self, block: Block) -> Mapping[Group, int]:
        """Return the codes of a line by their groups."""
        if len(block.g) == 1 and not block.m and block.g[0] in _ONE_GROUP:
            return _ONE_GROUP[block.g[0]]
        groups: dict[Group, int] = {}
        for letter, codes, table, refused in (
            ("G", block.g, G_GROUPS, G_REFUSED),
            ("M", block.m, M_GROUPS, M_REFUSED),
        ):
            for code in codes:
                group = table.get(code)
                if group is None:
                    if code in refused:
                        message = f"{_name(letter, code)} ({refused[code]}) is not supported yet"
                    else:
                        message = f"unknown code {_name(letter, code)}"
                    raise block.fault(message, letter, code)
                if group in groups:
                    others = " ".join(_name(letter, c) for c in table if table[c] is group)
                    raise block.fault(
                        f"{_name(letter, groups[group])} and {_name(letter, code)} exclude each "
                        f"other; a line may hold one of {others}",
                        letter,
                        code,
                    )
                groups[group] = code
        return groups

    def _check_users(self, block: Block, motion: int | None) -> None:
        """Check that each letter with a meaning of its own stands beside a code that uses it."""
        present = {motion, *block.g}
        for letter in block.words:
            users = _USERS.get(letter)
            if users is not None and present.isdisjoint(users):
                hint = _USELESS.get(letter) or f"it belongs to {', '.join(map(g_name, users))}"
                raise block.fault(f"nothing in this line uses the {letter} word; {hint}", letter)

    def _whole(self, block: Block, letter: str, low: int = 0, high: int | None = None) -> int:
        """Return the whole number of a word."""
        value = block.words[letter]
        number = round(value)
        if abs(value - number) > 1e-4 or number < low or (high is not None and number > high):
            allowed = f"{low} or more" if high is None else f"{low} to {high}"
            raise block.fault(f"{letter} must be a whole number, {allowed}", letter)
        return number

    # Modes

    def _change_feed_mode_and_units(self, groups: Mapping[Group, int]) -> None:
        if Group.FEED_MODE in groups and self._inverse_time != (groups[Group.FEED_MODE] == 930):
            self._inverse_time = not self._inverse_time
            self._linear_feed = self._angular_feed = 0.0
        # RS274 changes units later in a line, behind F. Nothing between depends on them, and
        # "G20 F6" shall be 6 inch/min whatever was in force before.
        if Group.UNITS in groups:
            self._use_units(groups[Group.UNITS])

    def _use_units(self, code: int) -> None:
        self._scale = INCH if code == 200 else 1.0
        self._scales = [self._scale] * 3 + [1.0] * 3

    def _set_feed(self, block: Block) -> None:
        feed = block.words["F"]
        if feed < 0:
            raise block.fault("the feed must not be negative", "F")
        if not self._inverse_time:
            self._linear_feed = feed * self._scale / MINUTE
            self._angular_feed = feed / MINUTE

    def _set_speed(self, block: Block, groups: Mapping[Group, int]) -> None:
        self._speed = block.words["S"]
        if self._speed < 0:
            raise block.fault("the spindle speed must not be negative; M4 turns backwards", "S")
        if self._spindle and Group.SPINDLE not in groups:
            self._report_spindle(rest=False)

    def _report_spindle(self, *, rest: bool = True) -> None:
        self.recorder.event("spindle", self._line, value=self._spindle * self._speed, rest=rest)

    def _change_modes(self, block: Block, groups: Mapping[Group, int]) -> None:
        recorder, line = self.recorder, self._line
        if Group.TOOL_CHANGE in groups:
            self._tool_length_of(self._next_tool, block, "T", ("M", 6))  # it must be known
            if self._spindle:
                self._spindle = 0
                self._report_spindle()
            self._tool = self._next_tool
            recorder.event("tool", line, value=float(self._tool))
        if Group.SPINDLE in groups:
            self._spindle = {3: 1, 4: -1, 5: 0}[groups[Group.SPINDLE]]
            self._report_spindle()
        if Group.COOLANT in groups:
            code = groups[Group.COOLANT]
            for kind in {7: ("mist",), 8: ("flood",), 9: ("mist", "flood")}[code]:
                recorder.event(kind, line, value=float(code != 9), rest=False)
        if groups.get(Group.NON_MODAL) == 40:
            if block.words.get("P", -1.0) < 0:
                raise block.fault(
                    "G4 needs its time: P with 0 seconds or more",
                    "P" if "P" in block.words else "G",
                )
            recorder.dwell(block.words["P"], line)
        if Group.PLANE in groups:
            self._plane = {170: Plane.XY, 180: Plane.ZX, 190: Plane.YZ}[groups[Group.PLANE]]
        if Group.TOOL_LENGTH in groups:
            self._tool_length = 0.0
            if groups[Group.TOOL_LENGTH] == 430:
                number = self._whole(block, "H") if "H" in block.words else self._tool
                self._tool_length = self._tool_length_of(number, block, "H", ("G", 430))
            self._use_offsets()
        if Group.COORDINATES in groups:
            self._use_system(1 + _SYSTEM_CODES.index(groups[Group.COORDINATES]))
        if Group.PATH in groups:
            self._use_path_control(groups[Group.PATH], block)
        if Group.DISTANCE in groups:
            self._absolute = groups[Group.DISTANCE] == 900
        if Group.CENTER_DISTANCE in groups:
            self._absolute_centers = groups[Group.CENTER_DISTANCE] == 901

    def _tool_length_of(
        self, number: int, block: Block, letter: str, code: tuple[str, int]
    ) -> float:
        """Return the length of a tool that ``letter`` names, or else an earlier line."""
        tools = self.settings.tools
        if tools is None or (number == 0 and number not in tools):
            return 0.0
        if number not in tools:
            known = ", ".join(map(str, sorted(tools)))
            place = (letter,) if letter in block.words else code
            raise block.fault(f"tool {number} is not in the tool table, which has {known}", *place)
        return float(tools[number])

    def _use_path_control(self, code: int, block: Block) -> None:
        if code == 611:
            self.recorder.path_tolerance(0.0)
        elif code == 610:
            self.recorder.path_tolerance(self.settings.exact_tolerance)
        else:
            for letter in "PQ":
                if block.words.get(letter, 0.0) < 0:
                    raise block.fault("a tolerance must not be negative", letter)
            tolerance = block.words.get("P", 0.0) * self._scale
            # P0 means "as fast as the machine allows", the same as no P.
            self.recorder.path_tolerance(tolerance or self.settings.path_tolerance)

    # Offsets

    def _store(self, first: int, values: Sequence[float]) -> None:
        self.parameters.numbered[first : first + len(AXES)] = map(float, values)

    def _stored(self, first: int) -> list[float]:
        return self.parameters.numbered[first : first + len(AXES)]

    def _use_system(self, system: int) -> None:
        """Select a coordinate system, 1 to 9; take its origin from the parameters."""
        self._system = system
        self.parameters.numbered[SYSTEM] = system
        self._work = self._stored(SYSTEM_OFFSET + 20 * (system - 1))
        self._use_offsets()

    def _use_offsets(self) -> None:
        self._origin = [work + shift for work, shift in zip(self._work, self._g92, strict=True)]
        self._origin[2] += self._tool_length

    def _program_position(self, axis: int) -> float:
        return (self._position[axis] - self._origin[axis]) / self._scales[axis]

    def _named_axes(self, block: Block) -> list[tuple[int, float]]:
        """Return column and value [mm, degrees] of each axis word."""
        return [
            (axis, block.words[letter] * self._scales[axis])
            for letter, axis in self._axis.items()
            if letter in block.words
        ]

    # Codes that are not modal

    def _do(self, command: int, block: Block, has_axes: bool) -> None:
        if command == 100:
            self._set_system(block)
        elif command in HOME:
            if has_axes:
                self._straight(block, self._target(block), rapid=True)
            home, end = self._stored(HOME[command]), self._position.copy()
            for letter, axis in self._axis.items():
                if letter in block.words or not has_axes:
                    end[axis] = home[axis]
            self._straight(block, end, rapid=True)
        elif command - 1 in HOME:
            self._store(HOME[command - 1], self._position)
        elif command != 40:
            self._shift(command, block)

    def _set_system(self, block: Block) -> None:
        """Set the origin of a coordinate system: G10 L2 or L20."""
        kind = block.words.get("L")
        if kind not in (2, 20):
            raise block.fault(
                "only G10 L2 and G10 L20 are supported yet", "L" if kind else "G", 100
            )
        if block.words.get("R", 0.0) != 0:
            raise block.fault("G10 R: turned coordinate systems are not supported yet", "R")
        if "P" not in block.words:
            raise block.fault(
                "G10 needs its coordinate system: P1 (G54) to P9 (G59.3), or P0, the active one",
                "G",
                100,
            )
        system = self._whole(block, "P", 0, len(SYSTEMS)) or self._system
        first = SYSTEM_OFFSET + 20 * (system - 1)
        for axis, value in self._named_axes(block):
            if kind == 20:
                others = self._origin[axis] - self._work[axis]
                value = self._position[axis] - others - value  # noqa: PLW2901
            self.parameters.numbered[first + axis] = value
        if system == self._system:
            self._use_system(system)

    def _shift(self, command: int, block: Block) -> None:
        """Set, clear or restore the G92 offset."""
        if command == 920:
            named = self._named_axes(block)
            if not named:
                raise block.fault("G92 needs an axis word", "G", 920)
            for axis, value in named:
                others = self._origin[axis] - self._g92[axis]
                self._g92[axis] = self._position[axis] - others - value
            self._store(G92_OFFSET, self._g92)
        elif command == 923:
            self._g92 = self._stored(G92_OFFSET)
        else:
            self._g92 = list(ZERO)
            if command == 921:
                self._store(G92_OFFSET, ZERO)
        self.parameters.numbered[G92_OFFSET - 1] = float(command in (920, 923))
        self._use_offsets()

    # Motion

    def _target(self, block: Block, *, machine: bool = False) -> list[float]:
        """Return where the axis words point; ``machine`` for G53."""
        end = self._position.copy()
        axes, scales, absolute = self._axis, self._scales, self._absolute
        origin = ZERO if machine else self._origin
        if machine and not absolute:
            raise block.fault("G53 needs absolute distances; use G90", "G", 530)
        for letter, value in block.words.items():
            axis = axes.get(letter)
            if axis is not None:
                end[axis] = value * scales[axis] + (origin[axis] if absolute else end[axis])
        return end

    def _straight(self, block: Block, end: list[float], *, rapid: bool) -> None:
        start = self._position
        dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
        length2 = dx * dx + dy * dy + dz * dz
        linear = length2 > RESOLUTION * RESOLUTION
        if not linear:
            length2 = math.dist(start[3:], end[3:]) ** 2
        if rapid:
            feed = math.inf
        elif self._inverse_time:
            feed = self._inverse_time_feed(block, math.sqrt(length2))
        else:
            feed = self._linear_feed if linear else self._angular_feed
            if feed <= 0:
                self._refuse_zero_feed(block)
        if not length2 < FARTHEST * FARTHEST:
            raise block.fault(f"a move of more than {FARTHEST:g} mm or degrees", _AXIS_WORDS)
        self._position = end
        if length2 > RESOLUTION * RESOLUTION:
            self.recorder.straight(end, feed, self._line)

    def _inverse_time_feed(self, block: Block, length: float) -> float:
        feed = block.words.get("F", 0.0)
        if feed <= 0:
            raise block.fault(
                "G93 needs F in every line that moves: 1/minutes that the move takes",
                {"F", "G", *_AXIS_WORDS},
                self._motion,
            )
        return length * feed / MINUTE

    def _refuse_zero_feed(self, block: Block) -> None:
        raise block.fault(
            "the feed is 0; set it with F before or beside the first G1, G2 or G3",
            {"F", "G", *_AXIS_WORDS},
            self._motion,
        )

    def _arc(self, block: Block, *, clockwise: bool, machine: bool) -> None:
        if machine:
            raise block.fault("G53 works with G0 and G1 only", "G", 530)
        words, plane = block.words, self._plane
        first, second = plane.axes
        name = {Plane.XY: "G17", Plane.ZX: "G18", Plane.YZ: "G19"}[plane]
        letters = AXES[first], AXES[second]
        centers = _CENTERS[first], _CENTERS[second]
        if _CENTERS[plane] in words:
            raise block.fault(
                f"in the plane of {name} the centre is given by {centers[0]} and {centers[1]}",
                _CENTERS[plane],
            )
        turns = self._whole(block, "P", 1) if "P" in words else 1
        end = self._target(block)
        a = self._position[first], self._position[second]
        b = end[first], end[second]
        try:
            if "R" in words:
                if not set(centers).isdisjoint(words):
                    raise block.fault("an arc has either R or a centre, not both", "R")
                if set(letters).isdisjoint(words) or math.dist(a, b) <= RESOLUTION:
                    raise block.fault(
                        f"an arc with R needs an end in {letters[0]} or {letters[1]} that is not "
                        "its start; give the centre for a full circle",
                        "R",
                    )
                center = arcs.center_from_radius(
                    a,
                    b,
                    words["R"] * self._scale,
                    clockwise=clockwise,
                    tolerance=REACH_TOLERANCE[self._scale],
                )
            else:
                center = self._center(block, a, centers, (first, second))
                arcs.check_radii(a, b, center, ARC_TOLERANCE[self._scale])
        except ValueError as error:
            raise block.fault(str(error), {"R", *centers}) from None
        sweep = arcs.sweep(a, b, center, clockwise=clockwise, turns=turns)
        rise = end[plane] - self._position[plane]
        length = math.hypot(math.dist(a, center) * sweep, rise)
        if not length < FARTHEST:
            raise block.fault(f"an arc of more than {FARTHEST:g} mm", {"R", "P", *centers})
        if self._inverse_time:
            feed = self._inverse_time_feed(block, length)
        else:
            feed = self._linear_feed
            if feed <= 0:
                self._refuse_zero_feed(block)
        middle = [0.0, 0.0, 0.0]
        middle[first], middle[second] = center
        self._position = end
        self.recorder.arc(end, feed, self._line, plane=plane, center=middle, sweep=sweep)

    def _center(
        self, block: Block, start: arcs.Point, letters: tuple[str, str], axes: tuple[int, int]
    ) -> arcs.Point:
        """Return the centre that I, J and K give."""
        words = block.words
        missing = [letter for letter in letters if letter not in words]
        if len(missing) == 2 or (missing and self._absolute_centers):
            raise block.fault(
                f"an arc needs its centre or its radius: {' and '.join(missing)} or R is missing"
                + (" (with G90.1 both coordinates of the centre)" if len(missing) == 1 else ""),
                {"G", *_AXIS_WORDS},
                self._motion,
            )
        origin = [self._origin[axis] for axis in axes] if self._absolute_centers else start
        x, y = (words.get(letter, 0.0) * self._scale for letter in letters)
        return origin[0] + x, origin[1] + y

    def _stop(self, code: int) -> None:
        if code in (0, 1):
            self.recorder.event("pause", self._line, text=f"M{code}")
        else:
            self.recorder.event("end", self._line, text=f"M{code}")
            self.ended = True


def _name(letter: str, code: int) -> str:
    return g_name(code) if letter == "G" else f"M{code}"
