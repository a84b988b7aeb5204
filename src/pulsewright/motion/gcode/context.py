"""What all codes share: settings, parameters, tools, the modal state, and where the tool is."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from pulsewright.motion.gcode import calls as c
from pulsewright.motion.gcode.arcs import RESOLUTION
from pulsewright.motion.gcode.codes import (
    AXIS_WORDS,
    G_GROUPS,
    MOTION,
    PLANES,
    SYSTEM_CODES,
    code_name,
)
from pulsewright.motion.gcode.compensation import Compensation
from pulsewright.motion.gcode.offsets import ZERO, Frame
from pulsewright.motion.gcode.parameters import (
    G92_OFFSET,
    G92_ON,
    HOME,
    ROTATION,
    SYSTEM,
    SYSTEM_OFFSET,
    TOOL,
    Parameters,
)
from pulsewright.motion.gcode.reader import Block
from pulsewright.motion.gcode.settings import FARTHEST, SYSTEMS, InterpreterSettings
from pulsewright.motion.gcode.state import Modal
from pulsewright.motion.gcode.tools import Tool
from pulsewright.motion.moves import AXES, Plane
from pulsewright.units import INCH

SLOWEST: Final = 0.1  # [length units or degrees per minute] that inverse time asks for
TURN: Final = 360.0  # [degrees]
SAME: Final = 1e-6  # so near to a position no turn is made to reach it, as offsets round [degrees]
_PLAIN: Final = frozenset("XYZABCF")


class Context:
    """The state of a program, and what every kind of code needs of it.

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
        self._leaving = False  # compensation has ended, and no move led away from it yet
        self._axis = {letter: AXES.index(letter) for letter in settings.axes}
        self._foreign = AXIS_WORDS - set(settings.axes) - {"@", "^"}
        self._wrapped = frozenset(AXES.index(letter) for letter in settings.wrapped)
        self._plain = _PLAIN & {*settings.axes, "F"} - {*settings.wrapped}
        self._unit = (settings.unit,) * 3 + (1.0,) * 3  # of parameters [mm, degrees]
        self._next_tool = 0
        self._tool = 0
        # The way on from a G5, and where it ended; the spline between G5.2 and G5.3.
        self._smooth: tuple[tuple[float, float], list[float]] | None = None
        self._control: list[tuple[float, float]] | None = None
        self._weights: list[float] = []
        self._order = 0
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
        system = int(parameters.numbered[SYSTEM])
        self.modal.system = system if 1 <= system <= len(SYSTEMS) else 1
        parameters.numbered[SYSTEM] = self.modal.system

        shift = self._stored(G92_OFFSET) if parameters.numbered[G92_ON] else list(ZERO)
        self.frame = Frame(shift=tuple(shift))
        self._use_system_frame(self.modal.system)
        self.position = self.frame.to_program(settings.start)

    def _emit(self, call: tuple[object, ...]) -> None:
        self.canon.emit(call)

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

    def _tool_of(self, number: int, block: Block, letter: str, code: tuple[str, int]) -> Tool:
        """Return a tool that ``letter`` names, or else an earlier line."""
        if self.tools is None or number == 0:
            return Tool(number)
        if number not in self.tools:
            known = ", ".join(map(str, sorted(self.tools)))
            place = (letter,) if letter in block.words else code
            raise block.fault(f"tool {number} is not in the tool table, which has {known}", *place)
        return self.tools[number]

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

    def _named_axes(self, block: Block) -> list[tuple[int, float]]:
        """Return column and value [program units] of each axis word."""
        half = 0.5 if self.modal.diameter else 1.0
        return [
            (axis, block.words[letter] * (half if letter == "X" else 1.0))
            for letter, axis in self._axis.items()
            if letter in block.words
        ]

    def _target(self, block: Block, *, machine: bool = False) -> list[float]:
        """Return where the axis words point; ``machine`` for G53."""
        named = self._named_axes(block)
        for axis, value in named:
            if not -FARTHEST < value < FARTHEST:
                self._refuse_distance(block, AXES[axis])
        if machine:
            if not self.modal.absolute:
                raise block.fault("G53 needs absolute distances; use G90", "G", 530)
            if not {"@", "^"}.isdisjoint(block.words):
                raise block.fault("polar coordinates do not work with G53", "@^")
            end = self.frame.to_machine(self.position)
            scales = self._scales()
            for axis, value in named:
                there = value * scales[axis]
                wrapped = axis in self._wrapped
                end[axis] = self._around(block, axis, there, end[axis]) if wrapped else there
            return self.frame.to_program(end)
        end = self.position.copy()
        absolute = self.modal.absolute
        for axis, value in named:
            if not absolute:
                end[axis] += value
            elif axis in self._wrapped:
                end[axis] = self._around(block, axis, value, end[axis])
            else:
                end[axis] = value
        if "@" in block.words or "^" in block.words:
            self._polar(block, end)
        return end

    def _around(self, block: Block, axis: int, value: float, here: float) -> float:
        """Return where a wrapped axis, now ``here``, gets by an absolute word."""
        if not -TURN < value < TURN:
            raise block.fault(
                f"axis {AXES[axis]} is wrapped: an absolute position is above -360 and below 360 "
                "degrees, a negative one says to turn backwards; for whole turns use G91",
                AXES[axis],
            )
        return turned(value, here)

    def _polar(self, block: Block, end: list[float]) -> None:
        """Move X and Y of ``end`` by polar coordinates about the origin."""
        words = block.words
        if self.modal.plane is not Plane.XY:
            raise block.fault("polar coordinates work in the plane of G17", "@^")
        if "X" in words or "Y" in words:
            raise block.fault("polar coordinates stand in for X and Y", "@^")
        x, y = end[:2]
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

    def _feed_for(self, block: Block, length: float) -> None:
        """Check that there is a feed; in inverse time, set it for a move of this length."""
        modal = self.modal
        if modal.feed_mode == 930:
            feed = block.words.get("F", 0.0)
            if feed <= 0:
                raise block.fault(
                    "G93 needs F in every line that moves: 1/minutes that the move takes",
                    {"F", "G", *AXIS_WORDS},
                    modal.motion if not block.g else self._motion_code(block),
                )
            self._emit(c.SetFeedRate(max(length * feed, SLOWEST), modal.scale))
        elif modal.feed <= 0:
            self._refuse_zero_feed(block)
        elif modal.feed_mode == 950 and modal.speed <= 0:
            raise block.fault(
                "G95 feeds by the turns of the spindle, whose speed is 0; set it with S",
                {"G", *AXIS_WORDS},
                self._motion_code(block),
            )

    def _motion_code(self, block: Block) -> int | None:
        return next((code for code in block.g if G_GROUPS.get(code) is MOTION), None)

    def _refuse_zero_feed(self, block: Block) -> None:
        raise block.fault(
            "the feed is 0; set it with F before or beside the first G1, G2 or G3",
            {"F", "G", *AXIS_WORDS},
            self._motion_code(block),
        )

    def _refuse_distance(self, block: Block, letter: str) -> None:
        raise block.fault(f"a move of more than {FARTHEST:g} mm or degrees", letter)

    def _check_not_leaving(self, block: Block) -> None:
        """Check that a curve does not come right behind cutter compensation."""
        if self._leaving:
            raise block.fault(
                "the first move after cutter compensation is from beside the contour; it must be "
                "straight: G0 or G1",
                {"G", *AXIS_WORDS},
                self._motion_code(block),
            )

    def _forbid_compensation(self, block: Block, letter: str, code: int) -> None:
        if self._compensation is not None:
            name = code_name(letter, code)
            raise block.fault(f"{name} cannot be used with cutter compensation", letter, code)

    def _say_path_control(self, *, naive: bool = False) -> None:
        mode, tolerance, collapse = self.modal.path
        self._emit(c.SetMotionControlMode(mode, tolerance))
        if mode == "CONTINUOUS" or naive:
            self._emit(c.SetNaivecamTolerance(collapse))

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
            "_PLANE": lambda: float({p: k for k, p in PLANES.items()}[self.modal.plane]),
            "_CCOMP": modal("compensation"),
            "_METRIC": lambda: float(self.modal.scale != INCH),
            "_IMPERIAL": lambda: float(self.modal.scale == INCH),
            "_ABSOLUTE": lambda: float(self.modal.absolute),
            "_INCREMENTAL": lambda: float(not self.modal.absolute),
            "_INVERSE_TIME": lambda: float(self.modal.feed_mode == 930),
            "_UNITS_PER_MINUTE": lambda: float(self.modal.feed_mode == 940),
            "_UNITS_PER_REV": lambda: float(self.modal.feed_mode == 950),
            "_COORD_SYSTEM": lambda: float(SYSTEM_CODES[self.modal.system - 1]),
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
            "_SELECTED_POCKET": lambda: float(
                self._pocket(self._next_tool) if self._next_tool else -1
            ),
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


def turned(value: float, here: float) -> float:
    """Return the next place from ``here`` on that is ``abs(value)`` within a turn [degrees].

    That is onwards, and for negative values, -0 included, backwards.
    """
    place = abs(value)
    if math.copysign(1.0, value) > 0:
        return place + TURN * math.ceil((here - SAME - place) / TURN)
    return place + TURN * math.floor((here + SAME - place) / TURN)
