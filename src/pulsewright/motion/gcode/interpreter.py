"""What the words of a line do, in the order that RS274/NGC gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

from pulsewright.motion.gcode import calls as c
from pulsewright.motion.gcode.codes import (
    ARCS,
    AXIS_WORDS,
    CENTERS,
    CYCLES,
    G_GROUPS,
    G_REFUSED,
    M_GROUPS,
    M_REFUSED,
    MOST_M_CODES,
    MOTION,
    PLANES,
    PROBES,
    SWITCHES,
    USERS,
    Group,
    code_name,
    g_name,
)
from pulsewright.motion.gcode.faults import Fault
from pulsewright.motion.gcode.machine_codes import MachineCodes
from pulsewright.motion.gcode.mode_codes import ModeCodes
from pulsewright.motion.gcode.motion_codes import MotionCodes
from pulsewright.motion.gcode.origin_codes import OriginCodes
from pulsewright.motion.gcode.parameters import DEBUG
from pulsewright.motion.gcode.reader import Block, Comment, Line
from pulsewright.motion.gcode.settings import FARTHEST, InterpreterSettings
from pulsewright.motion.gcode.splines import SplineCodes
from pulsewright.motion.gcode.state import Modal
from pulsewright.motion.moves import Plane
from pulsewright.units import INCH

_CENTER_WORDS: Final = frozenset(CENTERS)
# Codes that take the axis words, so that there is no motion in their line.
_USES_AXES: Final = frozenset((100, 280, 300, 520, 920))
_POLAR: Final = frozenset("@^")
_NEEDS_AXES: Final = frozenset((50, 51, 330, 331, *PROBES, *CYCLES))
_ONCE: Final = frozenset((50, 51))  # motion that is no mode
_USELESS: Final = {
    "D": "D belongs to cutter compensation (G41, G42) and G96",
    "E": "exponents, as in 1e3, are not part of the language",
}
_WITH_USERS: Final = frozenset(USERS)
_NON_MODAL: Final = Group.NON_MODAL
_NO_GROUPS: Final[Mapping[Group, int]] = {}


class Interpreter(MachineCodes, ModeCodes, OriginCodes, MotionCodes, SplineCodes):
    """Carries out one line after the other, as RS274/NGC orders it; see `Context` for its state."""

    def __init__(self, settings: InterpreterSettings, canon: c.Canon) -> None:
        super().__init__(settings, canon)
        self._steps: tuple[tuple[Group, Callable[[int, Block], None]], ...] = (
            (Group.PINS, self._set_pin),
            (Group.TOOL_CHANGE, self._change_tool),
            (Group.SPINDLE, self._set_spindle),
            (Group.STATE, self._keep_state),
            (Group.COOLANT, self._set_coolant),
            (Group.OVERRIDES, self._set_overrides),
            (Group.NON_MODAL, self._dwell),
            (Group.PLANE, self._set_plane),
            (Group.UNITS, self._set_units),
            (Group.LATHE, self._set_lathe_mode),
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
            **dict.fromkeys((520, 920), self._shift),
        }
        self._motions: dict[int, Callable[[int, Block], None]] = {
            **dict.fromkeys((0, 10), self._straight),
            **dict.fromkeys(ARCS, self._arc),
            **dict.fromkeys((330, 331), self._synchronised),
            **dict.fromkeys(PROBES, self._probe),
            **dict.fromkeys(CYCLES, self._cycle),
            760: self._thread,
            50: self._cubic,
            51: self._quadratic,
            52: self._control_point,
            53: self._end_spline,
        }

    def begin(self) -> None:
        """Say the state in which every program starts."""
        for call in (
            c.UseLengthUnits(1.0),
            c.SetG5xOffset(self.modal.system, self.frame.work),
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
        if block.m and self._jumps(block):
            return
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
                and not self._leaving
                and self._plain.issuperset(block.words)
            ):
                self._plain_move(code, block)
            else:
                self._execute(block)

    @property
    def plain(self) -> bool:
        """Whether G0 and G1 with axis words mean just that."""
        modal = self.modal
        calm = self._compensation is None and not self._leaving
        return calm and modal.feed_mode == 940 and not modal.diameter

    def finish(self, *, percent: bool = False) -> None:
        """Carry out what still waits at the end of the program, and close."""
        self.canon.number = ""
        self._check_no_spline()
        self._end_compensation()
        if not self.ended and percent:
            self._emit(c.Finish())
        self._emit(c.OnReset())
        self._emit(c.OnReset())

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
        motion = groups.get(MOTION)
        has_axes = not AXIS_WORDS.isdisjoint(words)
        if has_axes and not self._foreign.isdisjoint(words):
            axes = " ".join(self.settings.axes)
            raise block.fault(f"the machine has no such axis; it has {axes}", self._foreign)
        user = self._axis_user(groups, command, motion)
        if user is not None:
            if not _POLAR.isdisjoint(words):
                raise block.fault(f"polar coordinates are for motion, not for {user}", _POLAR)
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
                    "axis words without a motion mode; begin with G0, G1, G2 or G3", AXIS_WORDS
                )
        else:
            motion_now = motion
            if motion in _NEEDS_AXES:
                raise block.fault(f"{g_name(motion)} needs an axis word", "G", motion)
            if (
                motion is None
                and self.modal.motion in ARCS
                and not _CENTER_WORDS.isdisjoint(words)
                and groups.get(Group.TOOL_LENGTH) is None
            ):
                motion_now = self.modal.motion  # a full circle by its centre alone
        if command == 530:
            mode = self.modal.motion if motion_now is None else motion_now
            if mode not in (0, 10):
                raise block.fault("G53 works with G0 and G1 only", "G", 530)
            self._forbid_compensation(block, "G", 530)
        if not _WITH_USERS.isdisjoint(words):
            self._check_users(block, motion_now)

        if Group.SPINDLE_MODE in groups:
            self._set_spindle_mode(groups[Group.SPINDLE_MODE], block)
        if Group.FEED_MODE in groups:
            self._set_feed_mode(groups[Group.FEED_MODE])
        if "F" in words:
            self._set_feed(block, groups.get(Group.UNITS))
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
        if Group.SHIFT_ENDS in groups:
            self._shift(groups[Group.SHIFT_ENDS], block)
        if motion == 800:
            self._emit(c.Remark("interpreter: motion mode set to none"))
            self.modal.motion = None
        if motion_now is not None and motion_now != 800:
            if has_axes or motion_now not in (0, 10) or self.modal.feed > 0 or motion_now == 0:
                self._motions[motion_now](motion_now, block)
                self._leaving = False
            if motion_now not in _ONCE:
                self.modal.motion = motion_now if motion_now != 53 else None
        if Group.SUBPROGRAM in groups:
            self.request = ("return",)
        if Group.STOP in groups:
            self._stop(groups[Group.STOP])

    def _axis_user(
        self, groups: Mapping[Group, int], command: int | None, motion: int | None
    ) -> str | None:
        """Return which code other than a motion uses the axis words, if any does."""
        if command in _USES_AXES:
            return g_name(command)
        if groups.get(Group.TOOL_LENGTH) == 431 and motion is None:  # which shares them otherwise
            return "G43.1"
        return None

    def _classify(self, block: Block) -> Mapping[Group, int]:
        """Return the codes of a line by their groups."""
        groups: dict[Group, int] = {}
        if len(block.m) > MOST_M_CODES:
            raise block.fault(
                f"a line may hold {MOST_M_CODES} M codes, not {len(block.m)}", "M", block.m[-1]
            )
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
                beside = group is MOTION and 800 in (code, groups.get(group))
                if group in groups and not beside:
                    others = " ".join(code_name(letter, k) for k in table if table[k] is group)
                    raise block.fault(
                        f"{code_name(letter, groups[group])} and {code_name(letter, code)} exclude "
                        f"each other; a line may hold one of {others}",
                        letter,
                        code,
                    )
                if groups.get(group, 800) == 800:  # beside G80 the other motion counts
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
            if letter == "$":
                self._check_spindle(block)
                if "S" in block.words:
                    continue
            if present.isdisjoint(g) and m.isdisjoint(block.m):
                names = [*map(g_name, sorted(g)), *(f"M{code}" for code in sorted(m))]
                hint = _USELESS.get(letter) or f"it belongs to {', '.join(names)}"
                raise block.fault(f"nothing in this line uses the {letter} word; {hint}", letter)

    def _check_spindle(self, block: Block) -> None:
        if round(block.words["$"]) not in (0, -1):
            raise block.fault("there is one spindle: $0", "$")

    def _comment(self, comment: Comment) -> None:
        kind, text = comment
        if kind == "comment":
            self._emit(c.Remark(text))
        elif kind == "msg":
            self._emit(c.Message(text))
        elif kind == "debug":
            if self.parameters.numbered[DEBUG] > 0:
                self._emit(c.Message(self.parameters.fill_in(text)))
        elif kind == "print":
            self._emit(c.Print(self.parameters.fill_in(text)))
        elif kind == "log":
            self._emit(c.Log("LOG", self.parameters.fill_in(text)))
        else:
            self._emit(c.Log(kind.upper(), text))

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
        if kept.compensation not in (400, now.compensation):
            raise Fault("M72 cannot switch cutter compensation on again; use G41 or G42")
        blank = Block("")
        if kept.scale != now.scale:
            self._set_units(200 if kept.scale == INCH else 210, blank)
        # From here on in the order of the codes of one line, then the other M codes.
        if kept.surface_limit != now.surface_limit:
            now.surface_limit = kept.surface_limit
            self._emit(c.SetSpindleMode(kept.surface_limit))
        if kept.feed_mode != now.feed_mode:
            self._set_feed_mode(kept.feed_mode)
        now.feed, now.feed_scale = kept.feed, kept.feed_scale
        if kept.feed_mode != 930:
            self._emit(c.SetFeedRate(kept.feed, kept.feed_scale))
        now.speed = kept.speed
        self._emit(c.SetSpindleSpeed(kept.speed))
        turned = kept.spindle != now.spindle
        if turned:
            self._set_spindle({1: 3, -1: 4, 0: 5}[kept.spindle], blank)
        else:
            self._restore_coolant(kept)
        if kept.plane is not now.plane:
            self._set_plane({plane: code for code, plane in PLANES.items()}[kept.plane], blank)
        self._set_lathe_mode(70 if kept.diameter else 80, blank)
        if kept.compensation != now.compensation:
            self._set_compensation(400, blank)
        if kept.tool != now.tool:
            self._use_tool_offset(kept.tool)
        if kept.system != now.system:
            self._use_system(kept.system)
        now.path = kept.path
        self._say_path_control()
        self._set_distance_mode(900 if kept.absolute else 910, blank)
        self._set_center_mode(901 if kept.absolute_centers else 911, blank)
        if kept.retract != now.retract:
            self._set_retract_mode(kept.retract, blank)
        if turned:
            self._restore_coolant(kept)
        for name in SWITCHES.values():
            on = getattr(kept, name.lower())
            if on != getattr(now, name.lower()):
                setattr(now, name.lower(), on)
                self._emit(c.Switch(name, on))

    def _restore_coolant(self, kept: Modal) -> None:
        now = self.modal
        if (now.mist and not kept.mist) or (now.flood and not kept.flood):
            self._coolant_off()
        for coolant, on in ((7, kept.mist and not now.mist), (8, kept.flood and not now.flood)):
            if on:
                self._set_coolant(coolant, Block(""))

    def _jumps(self, block: Block) -> bool:
        """Carry out a line that calls a subprogram or ends one; comments in it mean nothing."""
        if block.m == [99] and len(self.kept) > 1 and not (block.g or block.words):
            self.request = ("return",)
            return True
        if 98 not in block.m:
            return False
        others = [code for code in block.m if code != 98]
        if block.g or others or not block.words.keys() <= {"P", "L"}:
            raise block.fault("M98 stands alone in its line, with P and perhaps L", "M", 98)
        self._need(block, "P", "the number of the subprogram", "M", 98)
        repeat = self._whole(block, "L") if "L" in block.words else 1
        self.request = ("call", self._whole(block, "P"), repeat)
        return True

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
        self._check_no_spline()
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
