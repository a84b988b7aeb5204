"""What the words of a line do, in the order that RS274/NGC gives."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from pulsewright.errors import UsageError
from pulsewright.motion.gcode import arcs
from pulsewright.motion.gcode import calls as c
from pulsewright.motion.gcode.arcs import RESOLUTION
from pulsewright.motion.gcode.codes import (
    ARCS,
    CYCLES,
    G_GROUPS,
    G_REFUSED,
    M_GROUPS,
    M_REFUSED,
    PROBES,
    USERS,
    Group,
    code_name,
    g_name,
)
from pulsewright.motion.gcode.compensation import Compensation
from pulsewright.motion.gcode.cycles import CLEARANCE, STICKY, Hole, Thread
from pulsewright.motion.gcode.cycles import CYCLES as CYCLE_OF
from pulsewright.motion.gcode.faults import Fault
from pulsewright.motion.gcode.offsets import ZERO, Frame
from pulsewright.motion.gcode.parameters import (
    G92_OFFSET,
    G92_ON,
    HOME,
    INPUT,
    ROTATION,
    SYSTEM,
    SYSTEM_OFFSET,
    TOOL,
    Parameters,
)
from pulsewright.motion.gcode.reader import Block, Comment, Line
from pulsewright.motion.gcode.state import Modal
from pulsewright.motion.gcode.tools import Tool
from pulsewright.motion.moves import AXES, Plane
from pulsewright.units import INCH

SYSTEMS: Final = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")

FARTHEST: Final = 1e9  # [length units, degrees] where an axis may go
SLOWEST: Final = 0.1  # [length units or degrees per minute] that inverse time asks for
ARC_TOLERANCE: Final = {1.0: 0.005, INCH: 0.0005}  # of radii, by length unit [program units]
REACH_TOLERANCE: Final = {1.0: 0.00127, INCH: 0.00005}  # of R against half the chord

_AXIS_WORDS: Final = frozenset("XYZABCUVW@^")
_PLAIN: Final = frozenset("XYZABCF")
_CENTERS: Final = "IJK"
_CENTER_WORDS: Final = frozenset(_CENTERS)
# Codes that take the axis words, so that there is no motion in their line.
_USES_AXES: Final = frozenset((100, 280, 300, 520, 920))
_PLANES: Final = {170: Plane.XY, 180: Plane.ZX, 190: Plane.YZ}
_PLANE_NAMES: Final = {plane: g_name(code) for code, plane in _PLANES.items()}
_FEED_MODES: Final = {
    930: "inverse time",
    940: "units per minute",
    950: "units per revolution",
}
_PATH_MODES: Final = {610: "EXACT_PATH", 611: "EXACT_STOP", 640: "CONTINUOUS"}
_SWITCHES: Final = {
    50: "FEED_OVERRIDE",
    51: "SPEED_OVERRIDE",
    52: "ADAPTIVE_FEED",
    53: "FEED_HOLD",
}
_OUTPUTS: Final = {
    62: ("SET_MOTION_OUTPUT_BIT", True),
    63: ("CLEAR_MOTION_OUTPUT_BIT", True),
    64: ("SET_AUX_OUTPUT_BIT", False),
    65: ("CLEAR_AUX_OUTPUT_BIT", False),
    67: ("SET_MOTION_OUTPUT_VALUE", True),
    68: ("SET_AUX_OUTPUT_VALUE", False),
}
_USELESS: Final = {
    "D": "D belongs to cutter compensation (G41, G42) and G96",
    "E": "exponents, as in 1e3, are not part of the language",
}
_SYSTEM_CODES: Final = tuple(k for k, group in G_GROUPS.items() if group is Group.COORDINATES)
_WITH_USERS: Final = frozenset(USERS)

# Looking up a member of an enum takes longer than anything else done for a simple line.
_MOTION: Final = Group.MOTION
_NON_MODAL: Final = Group.NON_MODAL
_NO_GROUPS: Final[Mapping[Group, int]] = {}


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
    tools : mapping of int to float or Tool, or None
        Tools by number: their table entries, or lengths along Z alone [mm]. None: the machine has
        no tool table, all lengths are 0.
    home, second_home : (6,) floats
        Machine positions for G28 and G30 until the program stores others [mm, degrees].
    path_tolerance : float
        How far the path may pass from a programmed corner in G64 without P [mm], above 0.
    exact_tolerance : float
        How far it may pass in G61 [mm], 0 or more: some fraction of a step.
    block_delete : bool
        Skip lines that begin with ``/``.
    unit : float
        Length unit of the machine [mm]: that of the parameters for offsets and positions.
    parameters : mapping of int to float
        Numbered parameters before the program starts, as a parameter file holds them; where given,
        those of offsets and homes go before ``work_offsets`` and the homes.
    subroutines : sequence of str
        Folders with files of subroutines, ``NAME.ngc``, searched in turn after that of the program.
    max_depth : int
        Subroutine calls within each other, at least 1.
    max_lines : int
        Lines that a program may carry out, each as often as loops come by.
    """

    axes: str = "XYZ"
    start: Sequence[float] = ZERO
    work_offsets: Mapping[str, Sequence[float]] = field(default_factory=dict)
    tools: Mapping[int, float | Tool] | None = None
    home: Sequence[float] = ZERO
    second_home: Sequence[float] = ZERO
    path_tolerance: float = 0.05
    exact_tolerance: float = 0.001
    block_delete: bool = False
    unit: float = 1.0
    parameters: Mapping[int, float] = field(default_factory=dict)
    subroutines: Sequence[str] = ()
    max_depth: int = 100
    max_lines: int = 20_000_000

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
        if self.max_depth < 1 or self.max_lines < 1:
            raise UsageError("max_depth and max_lines must be 1 or more")


class Interpreter:
    """Carries out one line after the other, as RS274/NGC orders it.

    Positions are program coordinates, as the canonical calls are; `Frame` knows where they stand
    on the machine.

    Parameters
    ----------
    settings : InterpreterSettings
        The machine.
    canon : Canon
        Who carries out the canonical calls.

    Members
    -------
    parameters : Parameters
        All parameters.
    tools : dict[int, Tool] or None
        The tool table; the program may change it.
    modal : Modal
        The modal state.
    ended : bool
        The program has said that it is over.
    request : tuple or None
        What the last line asked of the flow: ``("call", label, repetitions)`` for M98,
        ``("return",)`` for M99, or ``("save", codes)`` where a subroutine's state is concerned.
    """

    def __init__(self, settings: InterpreterSettings, canon: c.Canon) -> None:
        self.settings = settings
        self.canon: c.Canon = canon
        self.ended = False
        self.request: tuple[str, ...] | tuple[str, int, int] | None = None
        self.modal = Modal()
        self.tools = _tool_table(settings.tools)
        self.kept: list[Modal | None] = [None]  # by M70 and M73, one for each call level
        self.restore_on_return: list[bool] = [False]

        self._base = canon
        self._compensation: Compensation | None = None
        self._compensation_mode = 400
        self._axis = {letter: AXES.index(letter) for letter in settings.axes}
        self._foreign = _AXIS_WORDS - set(settings.axes) - {"@", "^"}
        self._plain = _PLAIN & {*settings.axes, "F"}
        self._unit = (settings.unit,) * 3 + (1.0,) * 3  # of parameters [mm, degrees]
        self._next_tool = 0
        self._tool = 0
        self._series: dict[str, float] = {}  # sticky words of canned cycles
        self._pause = 0.0  # P of the last one that had it: a tap waits for so long
        self._old_depth = 0.0  # before a series of canned cycles

        self.parameters = parameters = Parameters()
        self._store(HOME[280], settings.home)
        self._store(HOME[300], settings.second_home)
        for i, name in enumerate(SYSTEMS):
            self._store(SYSTEM_OFFSET + 20 * i, settings.work_offsets.get(name, ZERO))
        for number, value in settings.parameters.items():
            parameters.numbered[number] = float(value)
        parameters.position = self._position_parameter
        parameters.predefined = self._predefined()
        parameters.numbered[SYSTEM] = 1.0

        shift = self._stored(G92_OFFSET) if parameters.numbered[G92_ON] else list(ZERO)
        self.frame = Frame(shift=tuple(shift))
        self._use_system_frame(1)
        self.position = self.frame.to_program(settings.start)
        self._steps: tuple[tuple[Group, Callable[[int, Block], None]], ...] = (
            (Group.TOOL_CHANGE, self._change_tool),
            (Group.TOOL_NUMBER, self._name_tool),
            (Group.SPINDLE, self._set_spindle),
            (Group.STATE, self._keep_state),
            (Group.COOLANT, self._set_coolant),
            (Group.OVERRIDES, self._set_overrides),
            (Group.SWITCHES, self._set_switch),
            (Group.PINS, self._set_pin),
            (Group.NON_MODAL, self._dwell),
            (Group.PLANE, self._set_plane),
            (Group.LATHE, self._set_lathe_mode),
            (Group.UNITS, self._set_units),
            (Group.CUTTER_COMPENSATION, self._set_compensation),
            (Group.TOOL_LENGTH, self._set_tool_length),
            (Group.COORDINATES, self._set_system),
            (Group.PATH, self._set_path_control),
            (Group.DISTANCE, self._set_distance_mode),
            (Group.CENTER_DISTANCE, self._set_center_mode),
            (Group.RETRACT, self._set_retract_mode),
        )
        self._commands: dict[int, Callable[[int, Block], None]] = {
            100: self._set_data,
            280: self._go_home,
            300: self._go_home,
            281: self._store_home,
            301: self._store_home,
            **dict.fromkeys((520, 920, 921, 922, 923), self._shift),
        }
        self._motions: dict[int, Callable[[int, Block], None]] = {
            **dict.fromkeys((0, 10), self._straight),
            **dict.fromkeys(ARCS, self._arc),
            **dict.fromkeys((330, 331), self._synchronised),
            **dict.fromkeys(PROBES, self._probe),
            **dict.fromkeys(CYCLES, self._cycle),
            760: self._thread,
        }

    def begin(self) -> None:
        """Say the state in which every program starts."""
        for call in (
            c.UseLengthUnits(1.0),
            c.SetG5xOffset(1, self.frame.work),
            c.SetG92Offset(self.frame.shift),
            c.SetXYRotation(self.frame.rotation),
            c.SetFeedReference(),
            c.OnReset(),
        ):
            self._emit(call)

    def execute(self, line: Line) -> None:
        """Carry out one line without O-word.

        Raises
        ------
        Fault
            If it cannot be done, with its column.
        """
        self.canon.number = line.number
        block = line.constant or line.block(self.parameters)
        if line.settings:
            line.set_parameters(self.parameters)
        if line.comment is not None:
            self._comment(line.comment)
        if block.words or block.g or block.m:
            modal = self.modal
            code = block.g[0] if block.g else modal.motion
            if (
                (code == 0 or code == 10)
                and modal.feed_mode == 940
                and len(block.g) < 2
                and not block.m
                and not modal.diameter
                and self._plain.issuperset(block.words)
            ):
                self._plain_move(code, block)
            else:
                self._execute(block)

    @property
    def plain(self) -> bool:
        """Whether G0 and G1 with axis words mean just that."""
        modal = self.modal
        return self._compensation is None and modal.feed_mode == 940 and not modal.diameter

    def finish(self, *, percent: bool = False) -> None:
        """Carry out what still waits at the end of the program, and close."""
        self._end_compensation()
        if not self.ended and percent:
            self._emit(c.Finish())
        self._emit(c.OnReset())
        self._emit(c.OnReset())

    def _emit(self, call: tuple[object, ...]) -> None:
        self.canon.emit(call)

    # What a line asks for, and in which order it is done

    def _plain_move(self, code: int, block: Block) -> None:
        """Carry out a line of nothing but G0 or G1, axis words and F; most lines are such."""
        words, modal = block.words, self.modal
        if "F" in words:
            self._set_feed(block)
            if not block.g and len(words) == 1:
                return
        modal.motion = code
        position = self.position
        self.position = end = position.copy()
        axes, absolute = self._axis, modal.absolute
        for letter, value in words.items():
            if letter != "F":
                axis = axes[letter]
                end[axis] = value if absolute else value + position[axis]
                if not -FARTHEST < end[axis] < FARTHEST:
                    self._refuse_distance(block, letter)
        if code == 0:
            self.canon.emit(c.StraightTraverse(end))
        else:
            if modal.feed <= 0:
                if not words:
                    return  # G1 alone only sets the mode
                self._refuse_zero_feed(block)
            self.canon.emit(c.StraightFeed(end))

    def _execute(self, block: Block) -> None:
        words = block.words
        groups = self._classify(block) if block.g or block.m else _NO_GROUPS
        command = groups.get(_NON_MODAL)
        motion = groups.get(_MOTION)
        has_axes = not _AXIS_WORDS.isdisjoint(words)
        if has_axes and not self._foreign.isdisjoint(words):
            axes = " ".join(self.settings.axes)
            raise block.fault(f"the machine has no such axis; it has {axes}", self._foreign)
        user = self._axis_user(groups, command)
        if user is not None:
            if motion is not None and motion != 800:
                raise block.fault(
                    f"{user} and {g_name(motion)} would both use the axis words; "
                    "give them lines of their own",
                    "G",
                    motion,
                )
            motion_now = None
        elif has_axes:
            motion_now = self.modal.motion if motion is None else motion
            if motion_now is None or motion_now == 800:
                raise block.fault(
                    "axis words without a motion mode; begin with G0, G1, G2 or G3", _AXIS_WORDS
                )
            if command == 530 and motion is None and self.modal.motion not in (0, 10):
                raise block.fault("G53 works with G0 and G1 only", "G", 530)
        else:
            motion_now = motion
            if (
                motion is None
                and self.modal.motion in ARCS
                and not _CENTER_WORDS.isdisjoint(words)
                and groups.get(Group.TOOL_LENGTH) is None
            ):
                motion_now = self.modal.motion  # a full circle by its centre alone
        if not _WITH_USERS.isdisjoint(words):
            self._check_users(block, motion_now)

        if Group.FEED_MODE in groups:
            self._set_feed_mode(groups[Group.FEED_MODE])
        if "F" in words:
            self._set_feed(block, groups.get(Group.UNITS))
        if Group.SPINDLE_MODE in groups:
            self._set_spindle_mode(groups[Group.SPINDLE_MODE], block)
        if "S" in words:
            self._set_speed(block)
        if "T" in words:
            self._select_tool(block)
        if groups:
            for group, step in self._steps:
                if group in groups:
                    step(groups[group], block)
        do = self._commands.get(command) if command is not None else None
        if do is not None and command is not None:
            do(command, block)
        if motion == 800:
            self._emit(c.Remark("interpreter: motion mode set to none"))
            self.modal.motion = None
        if motion_now is not None and motion_now != 800:
            if has_axes or motion_now not in (0, 10) or self.modal.feed > 0 or motion_now == 0:
                self._motions[motion_now](motion_now, block)
            if motion_now not in PROBES:
                self.modal.motion = motion_now
        if Group.SUBPROGRAM in groups:
            self._subprogram(groups[Group.SUBPROGRAM], block)
        if Group.STOP in groups:
            self._stop(groups[Group.STOP])

    def _axis_user(self, groups: Mapping[Group, int], command: int | None) -> str | None:
        """Return which code other than a motion uses the axis words, if any does."""
        if command in _USES_AXES:
            return g_name(command)
        if groups.get(Group.TOOL_LENGTH) == 431:
            return "G43.1"
        return None

    def _classify(self, block: Block) -> Mapping[Group, int]:
        """Return the codes of a line by their groups."""
        groups: dict[Group, int] = {}
        for letter, codes, table, refused in (
            ("G", block.g, G_GROUPS, G_REFUSED),
            ("M", block.m, M_GROUPS, M_REFUSED),
        ):
            for code in codes:
                group = table.get(code)
                if group is None:
                    if code in refused:
                        message = (
                            f"{code_name(letter, code)} ({refused[code]}) is not supported yet"
                        )
                    else:
                        message = f"unknown code {code_name(letter, code)}"
                    raise block.fault(message, letter, code)
                if group in groups:
                    others = " ".join(code_name(letter, k) for k in table if table[k] is group)
                    raise block.fault(
                        f"{code_name(letter, groups[group])} and {code_name(letter, code)} exclude "
                        f"each other; a line may hold one of {others}",
                        letter,
                        code,
                    )
                groups[group] = code
        return groups

    def _check_users(self, block: Block, motion: int | None) -> None:
        """Check that each letter with a meaning of its own stands beside a code that uses it."""
        present = {motion, *block.g}
        for letter in block.words:
            users = USERS.get(letter)
            if users is None:
                continue
            g, m = users
            if present.isdisjoint(g) and m.isdisjoint(block.m):
                names = [*map(g_name, sorted(g)), *(f"M{code}" for code in sorted(m))]
                hint = _USELESS.get(letter) or f"it belongs to {', '.join(names)}"
                raise block.fault(f"nothing in this line uses the {letter} word; {hint}", letter)

    def _whole(self, block: Block, letter: str, low: int = 0, high: int | None = None) -> int:
        """Return the whole number of a word."""
        value = block.words[letter]
        number = round(value)
        if abs(value - number) > 1e-4 or number < low or (high is not None and number > high):
            allowed = f"{low} or more" if high is None else f"{low} to {high}"
            raise block.fault(f"{letter} must be a whole number, {allowed}", letter)
        return number

    def _need(self, block: Block, letters: str, user: str, letter: str, code: int) -> None:
        """Check that words stand beside a code."""
        for word in letters:
            if word not in block.words:
                raise block.fault(f"{code_name(letter, code)} needs {word}: {user}", letter, code)

    def _comment(self, comment: Comment) -> None:
        kind, text = comment
        if kind == "comment":
            self._emit(c.Remark(text))
        elif kind == "msg":
            self._emit(c.Message(text))
        elif kind == "debug":
            self._emit(c.Message(self.parameters.fill_in(text)))
        elif kind == "print":
            self._emit(c.Print(self.parameters.fill_in(text)))
        elif kind == "log":
            self._emit(c.Log("LOG", self.parameters.fill_in(text)))
        else:
            self._emit(c.Log(kind.upper(), text.strip()))

    # Feed, speed, tools

    def _set_feed_mode(self, code: int) -> None:
        modal = self.modal
        modal.feed_mode = code
        self._emit(c.Remark(f"interpreter: feed mode set to {_FEED_MODES[code]}"))
        self._emit(c.SetFeedMode(code == 950))
        if code != 930:
            modal.feed = 0.0
            self._emit(c.SetFeedRate(0.0, modal.scale))

    def _set_feed(self, block: Block, units: int | None = None) -> None:
        feed, modal = block.words["F"], self.modal
        if feed < 0:
            raise block.fault("the feed must not be negative", "F")
        if modal.feed_mode == 930:
            return  # counts in its own line alone
        modal.feed = feed
        # Units change later in a line, but F is in those of its own line: "G20 F6" is 6 inch/min
        # whatever was in force before.
        modal.feed_scale = modal.scale if units is None else INCH if units == 200 else 1.0
        self._emit(c.SetFeedRate(feed, modal.feed_scale))

    def _set_speed(self, block: Block) -> None:
        speed = block.words["S"]
        if speed < 0:
            raise block.fault("the spindle speed must not be negative; M4 turns backwards", "S")
        self.modal.speed = speed
        self._emit(c.SetSpindleSpeed(speed))

    def _select_tool(self, block: Block) -> None:
        self._next_tool = self._whole(block, "T")
        self._emit(c.SelectTool(self._next_tool))

    def _change_tool(self, _: int, block: Block) -> None:
        self._forbid_compensation(block, "M", 6)
        self._tool_of(self._next_tool, block, "T", ("M", 6))  # it must be known
        self.modal.spindle = 0
        self._emit(c.StopSpindle())
        self._use_tool(self._next_tool)
        self._emit(c.ChangeTool(self._tool))

    def _name_tool(self, _: int, block: Block) -> None:
        self._need(block, "Q", "the tool that is in the spindle", "M", 61)
        number = self._whole(block, "Q")
        self._tool_of(number, block, "Q", ("M", 61))
        self._use_tool(number)
        self._emit(c.ChangeToolNumber(number))

    def _use_tool(self, number: int) -> None:
        self._tool = number
        self._store_tool()

    def _store_tool(self) -> None:
        """Let the parameters tell the tool in the spindle."""
        tool = (self.tools or {}).get(self._tool, Tool(self._tool))
        unit = self.settings.unit
        values = [v / u for v, u in zip(tool.offset, self._unit, strict=True)]
        self.parameters.numbered[TOOL : TOOL + 14] = [
            float(self._tool),
            *values,
            *(0.0, 0.0, 0.0),
            tool.diameter / unit,
            tool.front_angle,
            tool.back_angle,
            float(tool.orientation),
        ]

    def _tool_of(self, number: int, block: Block, letter: str, code: tuple[str, int]) -> Tool:
        """Return a tool that ``letter`` names, or else an earlier line."""
        if self.tools is None or (number == 0 and number not in self.tools):
            return Tool(number)
        if number not in self.tools:
            known = ", ".join(map(str, sorted(self.tools)))
            place = (letter,) if letter in block.words else code
            raise block.fault(f"tool {number} is not in the tool table, which has {known}", *place)
        return self.tools[number]

    def _set_spindle_mode(self, code: int, block: Block) -> None:
        if code == 970:
            self.modal.surface_limit = 0.0
            self._emit(c.SetSpindleMode(0.0))
            return
        self._need(block, "S", "the surface speed", "G", 960)
        limit = block.words.get("D", 1e30)
        if limit <= 0:
            raise block.fault("the greatest speed must be above 0", "D")
        self.modal.surface_limit = limit
        self._emit(c.SetSpindleMode(limit))

    def _set_spindle(self, code: int, block: Block) -> None:
        if code == 19:
            self._orient(block)
            return
        self.modal.spindle = {3: 1, 4: -1, 5: 0}[code]
        self._emit(c.StartSpindle(self.modal.spindle) if code != 5 else c.StopSpindle())

    def _orient(self, block: Block) -> None:
        self._need(block, "R", "the angle of the spindle", "M", 19)
        angle = block.words["R"]
        if not 0 <= angle <= 360:
            raise block.fault("R must be an angle of 0 to 360 degrees", "R")
        mode = self._whole(block, "P", 0, 2) if "P" in block.words else 0
        self.modal.spindle = 0
        self._emit(c.OrientSpindle(angle, mode))
        if "Q" in block.words:
            if block.words["Q"] <= 0:
                raise block.fault("Q, the time to wait, must be above 0", "Q")
            self._emit(c.WaitOrient(block.words["Q"]))

    def _set_coolant(self, code: int, _: Block) -> None:
        if code == 7:
            self.modal.mist = True
            self._emit(c.Switch("MIST", True))
        elif code == 8:
            self.modal.flood = True
            self._emit(c.Switch("FLOOD", True))
        else:
            self._coolant_off()

    def _coolant_off(self) -> None:
        self.modal.mist = self.modal.flood = False
        self._emit(c.Switch("MIST", False))
        self._emit(c.Switch("FLOOD", False))

    def _set_overrides(self, code: int, _: Block) -> None:
        self.modal.feed_override = self.modal.speed_override = code == 48
        self._emit(c.Switch("FEED_OVERRIDE", code == 48))
        self._emit(c.Switch("SPEED_OVERRIDE", code == 48))

    def _set_switch(self, code: int, block: Block) -> None:
        on = block.words.get("P", 1.0) != 0
        name = _SWITCHES[code]
        setattr(self.modal, name.lower(), on)
        self._emit(c.Switch(name, on))

    def _set_pin(self, code: int, block: Block) -> None:
        words = block.words
        if code == 66:
            self._wait_for_pin(block)
            return
        name, with_motion = _OUTPUTS[code]
        if code < 66:
            self._need(block, "P", "the number of the pin", "M", code)
            self._emit(c.Output(name, self._whole(block, "P"), None, with_motion))
        else:
            self._need(block, "EQ", "the number of the pin (E) and its value (Q)", "M", code)
            self._emit(c.Output(name, self._whole(block, "E"), words["Q"], with_motion))

    def _wait_for_pin(self, block: Block) -> None:
        words = block.words
        if ("P" in words) == ("E" in words):
            raise block.fault("M66 needs a digital pin (P) or an analog one (E)", "M", 66)
        mode = self._whole(block, "L", 0, 4) if "L" in words else 0
        timeout = words.get("Q", 0.0)
        if timeout < 0:
            raise block.fault("Q, the time to wait, must not be negative", "Q")
        if "E" in words and mode:
            raise block.fault("an analog pin is read at once: L0", "L")
        if mode and timeout == 0:
            raise block.fault("M66 that waits needs Q, the longest time to wait", "M", 66)
        letter = "E" if "E" in words else "P"
        self._emit(c.WaitInput(self._whole(block, letter), letter == "E", mode, timeout))
        self.parameters.numbered[INPUT] = 0.0  # nobody is there to answer

    def _dwell(self, code: int, block: Block) -> None:
        if code != 40:
            return
        if block.words.get("P", -1.0) < 0:
            raise block.fault(
                "G4 needs its time: P with 0 seconds or more", "P" if "P" in block.words else "G"
            )
        self._emit(c.Dwell(block.words["P"]))

    # Modes

    def _set_plane(self, code: int, block: Block) -> None:
        plane = _PLANES[code]
        if plane is not self.modal.plane:
            self._forbid_compensation(block, "G", code)
        self.modal.plane = plane
        self._emit(c.SelectPlane(plane))

    def _set_lathe_mode(self, code: int, _: Block) -> None:
        self.modal.diameter = code == 70
        mode = "diameter" if code == 70 else "radius"
        self._emit(c.Remark(f"interpreter: Lathe diameter mode changed to {mode}"))

    def _set_units(self, code: int, block: Block) -> None:
        scale = INCH if code == 200 else 1.0
        modal = self.modal
        if scale != modal.scale:
            self._forbid_compensation(block, "G", code)
        factor = modal.scale / scale
        modal.scale = scale
        self.position = [v * factor for v in self.position[:3]] + self.position[3:]
        self.frame = replace(self.frame, scale=scale)
        mode, tolerance, naive = modal.path
        modal.path = (mode, tolerance * factor, naive * factor)
        self._emit(c.UseLengthUnits(scale))

    def _set_path_control(self, code: int, block: Block) -> None:
        mode = _PATH_MODES[code]
        tolerance = naive = 0.0
        if code == 640:
            for letter in "PQ":
                if block.words.get(letter, 0.0) < 0:
                    raise block.fault("a tolerance must not be negative", letter)
            tolerance = block.words.get("P", 0.0)
            naive = block.words.get("Q", tolerance)
        self.modal.path = (mode, tolerance, naive)
        self._say_path_control()

    def _say_path_control(self, *, naive: bool = False) -> None:
        mode, tolerance, collapse = self.modal.path
        self._emit(c.SetMotionControlMode(mode, tolerance))
        if mode == "CONTINUOUS" or naive:
            self._emit(c.SetNaivecamTolerance(collapse))

    def _set_distance_mode(self, code: int, _: Block) -> None:
        absolute = code == 900
        if absolute != self.modal.absolute:
            self.modal.absolute = absolute
            self._say_mode("distance", "absolute" if absolute else "incremental")

    def _set_center_mode(self, code: int, _: Block) -> None:
        absolute = code == 901
        if absolute != self.modal.absolute_centers:
            self.modal.absolute_centers = absolute
            self._say_mode("IJK distance", "absolute" if absolute else "incremental")

    def _say_mode(self, what: str, mode: str) -> None:
        self._emit(c.Remark(f"interpreter: {what} mode changed to {mode}"))

    def _set_retract_mode(self, code: int, _: Block) -> None:
        self.modal.retract = code
        mode = "old_z" if code == 980 else "r_plane"
        self._emit(c.Remark(f"interpreter: retract mode set to {mode}"))

    # Cutter compensation

    def _set_compensation(self, code: int, block: Block) -> None:
        if code == 400:
            self._end_compensation()
            self._compensation_mode = 400
            self._emit(c.Remark("interpreter: cutter radius compensation off"))
            return
        if self._compensation is not None:
            raise block.fault("cutter compensation is already on; use G40 first", "G", code)
        if self.modal.plane is Plane.YZ:
            raise block.fault("cutter compensation works in G17 and G18", "G", code)
        radius = self._compensation_radius(code, block)
        left = (code in (410, 411)) != (radius < 0)
        self._compensation_mode = code
        self._emit(
            c.Remark(f"interpreter: cutter radius compensation on {'left' if left else 'right'}")
        )
        # G18 looks along Y from behind: what is left there is right by axes Z and X.
        side = left if self.modal.plane is Plane.XY else not left
        self._compensation = self.canon = Compensation(
            self._base,
            self.modal.plane,
            left=side,
            radius=abs(radius),
            position=self.position,
        )

    def _compensation_radius(self, code: int, block: Block) -> float:
        """Return the tool's radius [program units], negative to change sides."""
        if code in (411, 421):
            self._need(block, "D", "the diameter of the tool", "G", code)
            return block.words["D"] / 2
        number = self._whole(block, "D") if "D" in block.words else self._tool
        return self._tool_of(number, block, "D", ("G", code)).diameter / 2 / self.modal.scale

    def _end_compensation(self) -> None:
        if self._compensation is not None:
            self._compensation.finish()
            self._compensation = None
            self.canon = self._base

    def _forbid_compensation(self, block: Block, letter: str, code: int) -> None:
        if self._compensation is not None:
            name = code_name(letter, code)
            raise block.fault(f"{name} cannot be used with cutter compensation", letter, code)

    # Offsets

    def _store(self, first: int, values: Sequence[float]) -> None:
        """Store a position [mm, degrees] in parameters."""
        self.parameters.numbered[first : first + len(AXES)] = [
            v / u for v, u in zip(values, self._unit, strict=True)
        ]

    def _stored(self, first: int) -> list[float]:
        """Return a position [mm, degrees] from parameters."""
        numbered = self.parameters.numbered[first : first + len(AXES)]
        return [v * u for v, u in zip(numbered, self._unit, strict=True)]

    def _scales(self) -> tuple[float, ...]:
        return (self.modal.scale,) * 3 + (1.0,) * 3

    def _move_frame(self, **changes: object) -> None:
        """Change the frame while the machine stands still."""
        machine = self.frame.to_machine(self.position)
        self.frame = replace(self.frame, **changes)  # type: ignore[arg-type]
        self.position = self.frame.to_program(machine)

    def _use_system_frame(self, system: int) -> None:
        first = SYSTEM_OFFSET + 20 * (system - 1)
        changes = {
            "work": tuple(self._stored(first)),
            "rotation": self.parameters.numbered[first + ROTATION],
        }
        if system == self.modal.system and not hasattr(self, "position"):
            self.frame = replace(self.frame, **changes)  # type: ignore[arg-type]
        else:
            self._move_frame(**changes)

    def _use_system(self, system: int, *, shift: bool = True) -> None:
        """Select a coordinate system, 1 to 9; take its origin from the parameters."""
        self.modal.system = system
        self.parameters.numbered[SYSTEM] = system
        self._use_system_frame(system)
        self._emit(c.SetG5xOffset(system, self.frame.work))
        if shift:
            self._emit(c.SetG92Offset(self.frame.shift))
        self._emit(c.SetXYRotation(self.frame.rotation))

    def _set_system(self, code: int, block: Block) -> None:
        self._forbid_compensation(block, "G", code)
        system = 1 + _SYSTEM_CODES.index(code)
        if system == self.modal.system:
            # Its parameters may have been set since.
            before = self.frame
            self._use_system_frame(system)
            if self.frame == before:
                text = "interpreter: continuing to use same coordinate system"
                self._emit(c.Remark(text))
                return
        self._use_system(system)

    def _set_tool_length(self, code: int, block: Block) -> None:
        words = block.words
        offset = list(ZERO)
        if code == 431:
            offset = list(self.frame.tool)
            for letter, axis in self._axis.items():
                if letter in words:
                    offset[axis] = words[letter] * self._scales()[axis]
        elif code in (430, 432):
            if code == 432:
                self._need(block, "H", "the tool whose offset is added", "G", 432)
                offset = list(self.frame.tool)
            number = self._whole(block, "H") if "H" in words else self._tool
            added = self._tool_of(number, block, "H", ("G", code)).offset
            offset = [a + b for a, b in zip(offset, added, strict=True)]
        self._use_tool_offset(tuple(offset))

    def _use_tool_offset(self, offset: tuple[float, ...]) -> None:
        self.modal.tool = offset
        self._move_frame(tool=offset)
        self._emit(c.UseToolLengthOffset(offset))

    def _named_axes(self, block: Block) -> list[tuple[int, float]]:
        """Return column and value [program units] of each axis word."""
        half = 0.5 if self.modal.diameter else 1.0
        return [
            (axis, block.words[letter] * (half if letter == "X" else 1.0))
            for letter, axis in self._axis.items()
            if letter in block.words
        ]

    def _set_data(self, _: int, block: Block) -> None:
        """Set an origin or a tool: G10."""
        self._forbid_compensation(block, "G", 100)
        kind = block.words.get("L")
        if kind in (2, 20):
            self._set_origin(block, relative=kind == 20)
        elif kind in (1, 10, 11):
            self._set_tool(block, int(kind))
        else:
            raise block.fault(
                "G10 is one of G10 L2 and G10 L20 (origins), G10 L1, L10 and L11 (tools)",
                "L" if kind is not None else "G",
                100,
            )

    def _set_origin(self, block: Block, *, relative: bool) -> None:
        if "P" not in block.words:
            raise block.fault(
                "G10 needs its coordinate system: P1 (G54) to P9 (G59.3), or P0, the active one",
                "G",
                100,
            )
        if relative and "R" in block.words:
            raise block.fault("R, the rotation, is set with G10 L2", "R")
        system = self._whole(block, "P", 0, len(SYSTEMS)) or self.modal.system
        first = SYSTEM_OFFSET + 20 * (system - 1)
        numbered = self.parameters.numbered
        if "R" in block.words:
            numbered[first + ROTATION] = block.words["R"]
        origin = self._stored(first)
        named = self._named_axes(block)
        if relative:
            # The origin that gives the named axes their values where the machine is.
            rotation = numbered[first + ROTATION]
            frame = replace(self.frame, work=tuple(origin), rotation=rotation)
            machine = self.frame.to_machine(self.position)
            wanted = frame.to_program(machine)
            for axis, value in named:
                wanted[axis] = value
            there = frame.to_machine(wanted)
            moved = [w + m - t for w, m, t in zip(origin, machine, there, strict=True)]
            if rotation:
                origin = moved
            else:
                for axis, _ in named:
                    origin[axis] = moved[axis]
        else:
            for axis, value in named:
                origin[axis] = value * self._scales()[axis]
        self._store(first, origin)
        if system == self.modal.system:
            self._use_system(system, shift=False)
        else:
            self._emit(c.Remark("interpreter: setting coordinate system origin"))

    def _set_tool(self, block: Block, kind: int) -> None:
        """Change the tool table: G10 L1, L10 and L11."""
        words = block.words
        self._need(block, "P", "the number of the tool", "G", 100)
        number = self._whole(block, "P")
        if self.tools is None:
            self.tools = {}
        if number not in self.tools:
            if self.settings.tools is not None:
                self._tool_of(number, block, "P", ("G", 100))
            self.tools[number] = Tool(number, number)
        tool = self.tools[number]
        scales = self._scales()
        if kind == 1:
            changed = {axis: value * scales[axis] for axis, value in self._named_axes(block)}
        else:
            changed = self._touched(block, fixture=kind == 11)
        offset = tuple(changed.get(axis, value) for axis, value in enumerate(tool.offset))
        scale = self.modal.scale
        tool = replace(
            tool,
            offset=offset,
            diameter=words["R"] * 2 * scale if "R" in words else tool.diameter,
            front_angle=words.get("I", tool.front_angle),
            back_angle=words.get("J", tool.back_angle),
            orientation=self._whole(block, "Q", 0, 9) if "Q" in words else tool.orientation,
        )
        self.tools[number] = tool
        self._say_tool(tool.pocket, tool)
        if number == (self._tool or next(iter(self.tools))):
            self._say_tool(0, tool)  # the spindle; before any change it has the first tool
        if number == self._tool:
            self._store_tool()

    def _touched(self, block: Block, *, fixture: bool) -> dict[int, float]:
        """Return the tool offsets with which the named axes have their values here."""
        frame = replace(self.frame, tool=ZERO)
        if fixture:  # as if there were no G92, in the ninth coordinate system
            first = SYSTEM_OFFSET + 20 * 8
            frame = replace(
                frame,
                work=tuple(self._stored(first)),
                shift=ZERO,
                rotation=self.parameters.numbered[first + ROTATION],
            )
        machine = self.frame.to_machine(self.position)
        named = self._named_axes(block)
        wanted = frame.to_program(machine)
        if frame.rotation:  # turned axes: what is not named stays as the present offset has it
            wanted = replace(frame, tool=self._present_offset(block)).to_program(machine)
        for axis, value in named:
            wanted[axis] = value
        there = frame.to_machine(wanted)
        axes = {axis for axis, _ in named}
        if frame.rotation and axes & {0, 1}:
            axes |= {0, 1}
        return {axis: machine[axis] - there[axis] for axis in axes}

    def _present_offset(self, block: Block) -> tuple[float, ...]:
        """Return the offset that the table has for the tool of a G10."""
        assert self.tools is not None
        return self.tools[self._whole(block, "P")].offset

    def _say_tool(self, pocket: int, tool: Tool) -> None:
        unit = self.settings.unit
        self._emit(
            c.SetToolTableEntry(
                pocket,
                tool.number,
                tuple(v / u for v, u in zip(tool.offset, self._unit, strict=True)),
                tool.diameter / unit,
                tool.front_angle,
                tool.back_angle,
                tool.orientation,
            )
        )

    def _shift(self, command: int, block: Block) -> None:
        """Set, clear or restore the shift of G92 and G52."""
        self._forbid_compensation(block, "G", command)
        shift = list(self.frame.shift)
        scales = self._scales()
        if command in (920, 520):
            named = self._named_axes(block)
            if not named:
                raise block.fault(f"{g_name(command)} needs an axis word", "G", command)
            for axis, value in named:
                if command == 920:
                    shift[axis] += (self.position[axis] - value) * scales[axis]
                else:
                    shift[axis] = value * scales[axis]
            self._store(G92_OFFSET, shift)
        elif command == 923:
            shift = self._stored(G92_OFFSET)
        else:
            shift = list(ZERO)
            if command == 921:
                self._store(G92_OFFSET, ZERO)
        self.parameters.numbered[G92_ON] = float(command in (520, 920, 923))
        self._move_frame(shift=tuple(shift))
        self._emit(c.SetG92Offset(self.frame.shift))

    def _go_home(self, command: int, block: Block) -> None:
        self._forbid_compensation(block, "G", command)
        named = not _AXIS_WORDS.isdisjoint(block.words)
        if named:
            self.position = self._target(block)
        self._emit(c.StraightTraverse(self.position.copy()))
        home = self.frame.to_program(self._stored(HOME[command]))
        self.position = self.position.copy()
        for letter, axis in self._axis.items():
            if letter in block.words or not named:
                self.position[axis] = home[axis]
        self._emit(c.StraightTraverse(self.position.copy()))

    def _store_home(self, command: int, _: Block) -> None:
        self._store(HOME[command - 1], self.frame.to_machine(self.position))

    # Motion

    def _target(self, block: Block, *, machine: bool = False) -> list[float]:
        """Return where the axis words point; ``machine`` for G53."""
        named = self._named_axes(block)
        for axis, value in named:
            if not -FARTHEST < value < FARTHEST:
                self._refuse_distance(block, AXES[axis])
        if machine:
            if not self.modal.absolute:
                raise block.fault("G53 needs absolute distances; use G90", "G", 530)
            end = self.frame.to_machine(self.position)
            scales = self._scales()
            for axis, value in named:
                end[axis] = value * scales[axis]
            return self.frame.to_program(end)
        end = self.position.copy()
        absolute = self.modal.absolute
        for axis, value in named:
            end[axis] = value if absolute else value + end[axis]
        if "@" in block.words or "^" in block.words:
            self._polar(block, end)
        return end

    def _polar(self, block: Block, end: list[float]) -> None:
        """Set X and Y from polar coordinates about the origin."""
        words = block.words
        if "X" in words or "Y" in words:
            raise block.fault("polar coordinates stand in for X and Y", "@^")
        x, y = self.position[:2]
        at_origin = math.hypot(x, y) < RESOLUTION
        if at_origin and (not self.modal.absolute or "^" not in words):
            raise block.fault(
                "at the origin a polar angle is needed, and it cannot be added to", "@^"
            )
        if self.modal.absolute:
            radius = words.get("@", math.hypot(x, y))
            angle = math.radians(words["^"]) if "^" in words else math.atan2(y, x)
        else:
            radius = words.get("@", 0.0) + math.hypot(x, y)
            angle = math.radians(words.get("^", 0.0)) + math.atan2(y, x)
        end[0], end[1] = radius * math.cos(angle), radius * math.sin(angle)

    def _straight(self, code: int, block: Block) -> None:
        end = self._target(block, machine=530 in block.g)
        if code == 0:
            self.position = end
            self._emit(c.StraightTraverse(end))
            return
        start = self.position
        length = math.dist(start[:3], end[:3])
        if length * self.modal.scale <= RESOLUTION:
            length = math.dist(start[3:], end[3:])
        self._feed_for(block, length)
        self.position = end
        self._emit(c.StraightFeed(end))

    def _feed_for(self, block: Block, length: float) -> None:
        """Check that there is a feed; in inverse time, set it for a move of this length."""
        modal = self.modal
        if modal.feed_mode == 930:
            feed = block.words.get("F", 0.0)
            if feed <= 0:
                raise block.fault(
                    "G93 needs F in every line that moves: 1/minutes that the move takes",
                    {"F", "G", *_AXIS_WORDS},
                    modal.motion if not block.g else self._motion_code(block),
                )
            self._emit(c.SetFeedRate(max(length * feed, SLOWEST), modal.scale))
        elif modal.feed <= 0:
            self._refuse_zero_feed(block)

    def _motion_code(self, block: Block) -> int | None:
        return next((code for code in block.g if G_GROUPS.get(code) is _MOTION), None)

    def _refuse_zero_feed(self, block: Block) -> None:
        raise block.fault(
            "the feed is 0; set it with F before or beside the first G1, G2 or G3",
            {"F", "G", *_AXIS_WORDS},
            self._motion_code(block),
        )

    def _refuse_distance(self, block: Block, letter: str) -> None:
        raise block.fault(f"a move of more than {FARTHEST:g} mm or degrees", letter)

    def _arc(self, code: int, block: Block) -> None:
        if 530 in block.g:
            raise block.fault("G53 works with G0 and G1 only", "G", 530)
        modal, words, plane = self.modal, block.words, self.modal.plane
        clockwise = code == 20
        first, second = plane.axes
        letters = AXES[first], AXES[second]
        centers = _CENTERS[first], _CENTERS[second]
        if _CENTERS[plane] in words:
            raise block.fault(
                f"in the plane of {_PLANE_NAMES[plane]} the centre is given by {centers[0]} and "
                f"{centers[1]}",
                _CENTERS[plane],
            )
        turns = self._whole(block, "P", 1) if "P" in words else 1
        end = self._target(block)
        a = self.position[first], self.position[second]
        b = end[first], end[second]
        try:
            if "R" in words:
                if not set(centers).isdisjoint(words):
                    raise block.fault("an arc has either R or a centre, not both", "R")
                named = {*letters, *("@^" if plane is Plane.XY else "")}
                if named.isdisjoint(words) or math.dist(a, b) <= RESOLUTION:
                    raise block.fault(
                        f"an arc with R needs an end in {letters[0]} or {letters[1]} that is not "
                        "its start; give the centre for a full circle",
                        "R",
                    )
                center = arcs.center_from_radius(
                    a,
                    b,
                    words["R"],
                    clockwise=clockwise,
                    tolerance=REACH_TOLERANCE[modal.scale],
                )
            else:
                center = self._center(block, a, centers, (first, second))
                arcs.check_radii(a, b, center, ARC_TOLERANCE[modal.scale])
        except ValueError as error:
            raise block.fault(str(error), {"R", *centers}) from None
        sweep = arcs.sweep(a, b, center, clockwise=clockwise, turns=turns)
        rise = end[plane] - self.position[plane]
        length = math.hypot(math.dist(a, center) * sweep, rise)
        if not length < FARTHEST:
            raise block.fault(f"an arc of more than {FARTHEST:g} mm", {"R", "P", *centers})
        self._feed_for(block, length)
        self.position = end
        self._emit(c.ArcFeed(plane, end, center, -turns if clockwise else turns, sweep))

    def _center(
        self, block: Block, start: arcs.Point, letters: tuple[str, str], axes: tuple[int, int]
    ) -> arcs.Point:
        """Return the centre that I, J and K give."""
        words = block.words
        absolute = self.modal.absolute_centers
        missing = [letter for letter in letters if letter not in words]
        if len(missing) == 2 or (missing and absolute):
            raise block.fault(
                f"an arc needs its centre or its radius: {' and '.join(missing)} or R is missing"
                + (" (with G90.1 both coordinates of the centre)" if len(missing) == 1 else ""),
                {"G", *_AXIS_WORDS},
                self._motion_code(block),
            )
        origin = (0.0, 0.0) if absolute else start
        x, y = (words.get(letter, 0.0) for letter in letters)
        return origin[0] + x, origin[1] + y

    def _synchronised(self, code: int, block: Block) -> None:
        """Move with the spindle: G33 and G33.1."""
        self._forbid_compensation(block, "G", code)
        self._need(block, "K", "travel per revolution", "G", code)
        if not self.modal.spindle:
            raise block.fault(f"{g_name(code)} needs a turning spindle; use M3 or M4", "G", code)
        end = self._target(block)
        self._emit(c.StartSpeedFeedSync(block.words["K"]))
        if code == 330:
            self.position = end
            self._emit(c.StraightFeed(end))
        else:
            self._emit(c.RigidTap(end, self.position))
        self._emit(c.StopSpeedFeedSync())

    def _probe(self, code: int, block: Block) -> None:
        self._forbid_compensation(block, "G", code)
        end = self._target(block)
        self._feed_for(block, math.dist(self.position[:3], end[:3]))
        self._emit(c.Probe(True))
        self._emit(c.StraightProbe(end))
        self._emit(c.Probe(False))
        self.position = end

    # Canned cycles

    def _cycle(self, code: int, block: Block) -> None:
        modal, words, plane = self.modal, block.words, self.modal.plane
        self._forbid_compensation(block, "G", code)
        if modal.feed_mode == 930:
            raise block.fault("canned cycles do not work with inverse time feed (G93)", "G", code)
        if rotary := set("ABC") & set(words):
            raise block.fault("rotary axes do not move in a canned cycle", rotary)
        cycle, name, depth_letter = CYCLE_OF[code], g_name(code), AXES[plane]
        goes_on = modal.motion in CYCLES
        if not goes_on:
            self._old_depth = self.position[plane]
        if modal.motion != code:
            self._series = {}
        named = dict(self._named_axes(block))
        self._series.update({k: v for k, v in words.items() if k in STICKY or k == depth_letter})
        for letter in f"R{depth_letter}{cycle.words}":
            if letter not in self._series:
                raise block.fault(f"{name} needs {letter}", "G", code)
        series = self._series
        self._pause = series.get("P", self._pause)
        if "Q" in cycle.words and series["Q"] <= 0:
            raise block.fault("Q, the depth of a peck, must be above 0", "Q")
        if cycle.spindle is not None and not (
            modal.spindle == cycle.spindle if cycle.spindle else modal.spindle
        ):
            how = {1: " clockwise (M3)", -1: " counterclockwise (M4)", 0: ""}[cycle.spindle]
            raise block.fault(f"{name} needs a spindle that turns{how}", "G", code)
        if modal.feed <= 0:
            self._refuse_zero_feed(block)
        repeat = self._whole(block, "L", 1) if "L" in words else 1

        retract, bottom = series["R"], series[depth_letter]
        if not modal.absolute:
            retract += self._old_depth
            bottom += retract
        if retract < bottom:
            raise block.fault(
                f"R is {retract:g}, below {depth_letter}, which is {bottom:g}", f"R{depth_letter}"
            )
        clear = max(self._old_depth, retract) if modal.retract == 980 else retract
        hole = Hole(
            self._emit,
            plane,
            self.position.copy(),
            retract,
            bottom,
            clear,
            CLEARANCE / modal.scale,
            modal.spindle,
            {"P": self._pause, **series},
            [name for name in ("FEED_OVERRIDE", "SPEED_OVERRIDE") if getattr(modal, name.lower())],
        )
        if code == 870 and not modal.absolute:
            hole.words["IJK"[plane]] += bottom
        if self._old_depth < retract:
            hole.traverse(retract)
        elif goes_on:
            # From hole to hole where the last one ended, but never below R nor, in G98, below
            # where the series began.
            depth = clear if modal.retract == 980 else max(retract, hole.position[plane])
            hole.position[plane] = depth
        exact = modal.path[0] == "EXACT_PATH"
        if not exact:
            self._emit(c.SetMotionControlMode("EXACT_PATH"))
        first, second = plane.axes
        for _ in range(repeat):
            point = [
                named.get(axis, hole.position[axis])
                if modal.absolute
                else hole.position[axis] + named.get(axis, 0.0)
                for axis in (first, second)
            ]
            hole.traverse_beside(point)
            if hole.position[plane] != retract:
                hole.traverse(retract)
            cycle.run(hole)
        self.position = hole.position
        if not exact:
            self._say_path_control(naive=True)

    def _thread(self, _: int, block: Block) -> None:
        words, modal = block.words, self.modal
        self._forbid_compensation(block, "G", 760)
        if modal.plane is not Plane.ZX:
            raise block.fault("G76 works in the plane of G18", "G", 760)
        if "X" in words or "Y" in words:
            raise block.fault("G76 moves along Z; X and Y are where the tool is", "XY")
        self._need(block, "ZPIJK", "end, pitch, peak, first cut and depth", "G", 760)
        if not modal.spindle:
            raise block.fault("G76 needs a turning spindle; use M3 or M4", "G", 760)
        half = 0.5 if modal.diameter else 1.0
        ends = self._whole(block, "L", 0, 3) if "L" in words else 0
        thread = Thread(
            words["P"],
            words["I"] * half,
            words["J"] * half,
            words["K"] * half,
            words.get("R", 1.0),
            words.get("Q", 0.0),
            self._whole(block, "H") if "H" in words else 0,
            words.get("E", 0.0),
            bool(ends & 1),
            bool(ends & 2),
        )
        for letter, fits in (
            ("P", thread.pitch > 0),
            ("I", thread.peak != 0),
            ("J", thread.first > 0),
            ("K", thread.depth > 0),
            ("R", thread.degression >= 1),
            ("Q", 0 <= thread.angle < 90),
            ("E", thread.taper >= 0 and (thread.taper > 0 or not ends)),
        ):
            if not fits:
                raise block.fault(f"G76 cannot work with this {letter}", {letter, "G"}, 760)
        if thread.depth < thread.first:
            raise block.fault("the first cut, J, is deeper than the thread, K", "J")
        if (thread.depth / thread.first) ** thread.degression > 10_000:
            raise block.fault("this thread would take more than 10000 passes", "J")
        end = self._target(block)
        thread.run(self._emit, self.position, end[2])
        self.position = end
        modal.feed_override = True  # each pass has ended with it

    # State, subprograms, stops

    def _keep_state(self, code: int, _: Block) -> None:
        if code in (70, 73):
            self.kept[-1] = replace(self.modal)
            self.restore_on_return[-1] |= code == 73
        elif code == 71:
            self.kept[-1] = None
        else:
            self.restore_state()

    def restore_state(self) -> None:
        """Return to the modal state that M70 or M73 kept at this call level.

        Raises
        ------
        Fault
            If nothing was kept; without column.
        """
        kept, now = self.kept[-1], self.modal
        if kept is None:
            raise Fault("M72 without M70: no modal state has been kept here")
        blank = Block("")
        if kept.scale != now.scale:
            self._set_units(200 if kept.scale == INCH else 210, blank)
        if kept.feed_mode != now.feed_mode:
            self._set_feed_mode(kept.feed_mode)
        now.feed, now.feed_scale = kept.feed, kept.feed_scale
        self._emit(c.SetFeedRate(kept.feed, kept.feed_scale))
        now.speed = kept.speed
        self._emit(c.SetSpindleSpeed(kept.speed))
        if kept.spindle != now.spindle:
            self._set_spindle({1: 3, -1: 4, 0: 5}[kept.spindle], blank)
        if kept.plane is not now.plane:
            self._set_plane({plane: code for code, plane in _PLANES.items()}[kept.plane], blank)
        if kept.tool != now.tool:
            self._use_tool_offset(kept.tool)
        if kept.system != now.system:
            self._use_system(kept.system)
        now.path = kept.path
        self._say_path_control()
        self._set_distance_mode(900 if kept.absolute else 910, blank)
        self._set_center_mode(901 if kept.absolute_centers else 911, blank)
        if kept.diameter != now.diameter:
            self._set_lathe_mode(70 if kept.diameter else 80, blank)
        if kept.retract != now.retract:
            self._set_retract_mode(kept.retract, blank)
        now.motion = kept.motion
        if (kept.mist, kept.flood) != (now.mist, now.flood):
            self._coolant_off()
            for coolant in [7] * kept.mist + [8] * kept.flood:
                self._set_coolant(coolant, blank)
        for name in _SWITCHES.values():
            on = getattr(kept, name.lower())
            if on != getattr(now, name.lower()):
                setattr(now, name.lower(), on)
                self._emit(c.Switch(name, on))

    def _subprogram(self, code: int, block: Block) -> None:
        if code == 99:
            self.request = ("return",)
            return
        self._need(block, "P", "the number of the subprogram", "M", 98)
        repeat = self._whole(block, "L") if "L" in block.words else 1
        self.request = ("call", self._whole(block, "P"), repeat)

    def _stop(self, code: int) -> None:
        if code == 60:
            self._emit(c.PalletShuttle())
            self._emit(c.ProgramStop(optional=False))
        elif code in (0, 1):
            self._emit(c.ProgramStop(optional=code == 1))
        else:
            self.end(code)

    def end(self, code: int) -> None:
        """End the program; reset what its end resets."""
        self._end_compensation()
        modal = self.modal
        self._use_system(1, shift=False)
        if modal.plane is not Plane.XY:
            modal.plane = Plane.XY
            self._emit(c.SelectPlane(Plane.XY))
        modal.absolute, modal.feed_mode, modal.motion = True, 940, 10
        self._emit(c.SetFeedMode(False))
        modal.feed = 0.0
        self._emit(c.SetFeedRate(0.0, modal.scale))
        if not modal.feed_override:
            self._emit(c.Switch("FEED_OVERRIDE", True))
        modal.feed_override = modal.speed_override = True
        modal.spindle = 0
        self._emit(c.StopSpindle())
        self._emit(c.SetSpindleMode(0.0))
        if modal.mist:
            self._emit(c.Switch("MIST", False))
        if modal.flood:
            self._emit(c.Switch("FLOOD", False))
        modal.mist = modal.flood = False
        if code == 30:
            self._emit(c.PalletShuttle())
        self._emit(c.ProgramEnd(code))
        self.ended = True

    # What parameters tell

    def _position_parameter(self, axis: int) -> float:
        return self.position[axis] if axis < len(AXES) else 0.0

    def _predefined(self) -> dict[str, Callable[[], float]]:
        """Return the named parameters that tell the state; `_LINE` and the like come later."""

        def absolute(axis: int) -> Callable[[], float]:
            def value() -> float:
                return self.frame.to_machine(self.position)[axis] / self._scales()[axis]

            return value

        def relative(axis: int) -> Callable[[], float]:
            return lambda: self._position_parameter(axis)

        def modal(name: str) -> Callable[[], float]:
            return lambda: float(getattr(self.modal, name))

        known: dict[str, Callable[[], float]] = {
            "_VMAJOR": lambda: 2.9,
            "_VMINOR": lambda: 0.0,
            "_LINE": lambda: float(self._base.line),
            "_MOTION_MODE": lambda: float(800 if self.modal.motion is None else self.modal.motion),
            "_PLANE": lambda: float({p: k for k, p in _PLANES.items()}[self.modal.plane]),
            "_CCOMP": lambda: float(self._compensation_mode),
            "_METRIC": lambda: float(self.modal.scale != INCH),
            "_IMPERIAL": lambda: float(self.modal.scale == INCH),
            "_ABSOLUTE": lambda: float(self.modal.absolute),
            "_INCREMENTAL": lambda: float(not self.modal.absolute),
            "_INVERSE_TIME": lambda: float(self.modal.feed_mode == 930),
            "_UNITS_PER_MINUTE": lambda: float(self.modal.feed_mode == 940),
            "_UNITS_PER_REV": lambda: float(self.modal.feed_mode == 950),
            "_COORD_SYSTEM": lambda: float(_SYSTEM_CODES[self.modal.system - 1]),
            "_TOOL_OFFSET": lambda: float(any(self.frame.tool)),
            "_RETRACT_R_PLANE": lambda: float(self.modal.retract == 990),
            "_RETRACT_OLD_Z": lambda: float(self.modal.retract == 980),
            "_SPINDLE_RPM_MODE": lambda: float(not self.modal.surface_limit),
            "_SPINDLE_CSS_MODE": lambda: float(bool(self.modal.surface_limit)),
            "_IJK_ABSOLUTE_MODE": modal("absolute_centers"),
            "_LATHE_DIAMETER_MODE": modal("diameter"),
            "_LATHE_RADIUS_MODE": lambda: float(not self.modal.diameter),
            "_SPINDLE_ON": lambda: float(self.modal.spindle != 0),
            "_SPINDLE_CW": lambda: float(self.modal.spindle > 0),
            "_MIST": modal("mist"),
            "_FLOOD": modal("flood"),
            "_SPEED_OVERRIDE": modal("speed_override"),
            "_FEED_OVERRIDE": modal("feed_override"),
            "_ADAPTIVE_FEED": modal("adaptive_feed"),
            "_FEED_HOLD": modal("feed_hold"),
            "_FEED": modal("feed"),
            "_RPM": modal("speed"),
            "_CURRENT_TOOL": lambda: float(self._tool),
            "_CURRENT_POCKET": lambda: float(self._pocket(self._tool)),
            "_SELECTED_TOOL": lambda: float(self._next_tool),
            "_SELECTED_POCKET": lambda: float(self._pocket(self._next_tool)),
            "_TASK": lambda: 0.0,
            "_REMAP_LEVEL": lambda: 0.0,
        }
        for axis, letter in enumerate(AXES):
            known[f"_{letter}"] = relative(axis)
            known[f"_ABS_{letter}"] = absolute(axis)
        known.update(dict.fromkeys(("_U", "_V", "_W"), lambda: 0.0))
        return known

    def _pocket(self, number: int) -> int:
        tool = (self.tools or {}).get(number)
        return tool.pocket if tool is not None else number


def _tool_table(tools: Mapping[int, float | Tool] | None) -> dict[int, Tool] | None:
    if tools is None:
        return None
    return {
        number: tool
        if isinstance(tool, Tool)
        else Tool(number, number, (0.0, 0.0, float(tool), 0.0, 0.0, 0.0))
        for number, tool in tools.items()
    }
