"""Coordinate systems, offsets, the tool table, and homes."""

from __future__ import annotations

from dataclasses import replace

from pulsewright.motion.gcode import calls as c
from pulsewright.motion.gcode.codes import (
    AXIS_WORDS,
    SYSTEM_CODES,
    g_name,
)
from pulsewright.motion.gcode.context import TURN, Context, turned
from pulsewright.motion.gcode.offsets import ZERO
from pulsewright.motion.gcode.parameters import (
    G92_OFFSET,
    G92_ON,
    HOME,
    ROTATION,
    SYSTEM,
    SYSTEM_OFFSET,
)
from pulsewright.motion.gcode.reader import Block
from pulsewright.motion.gcode.settings import SYSTEMS
from pulsewright.motion.gcode.tools import Tool


class OriginCodes(Context):
    """What moves the origin, or the machine to a stored position."""

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
        system = 1 + SYSTEM_CODES.index(code)
        if system == self.modal.system:
            self._emit(c.Remark("interpreter: continuing to use same coordinate system"))
        else:
            self._use_system(system)

    def _set_tool_length(self, code: int, block: Block) -> None:
        words = block.words
        self._forbid_compensation(block, "G", code)
        offset = list(ZERO)
        if code == 431:
            offset = list(self.frame.tool)
            for axis, value in self._named_axes(block):
                offset[axis] = value * self._scales()[axis]
        elif code in (430, 432):
            if code == 432:
                self._need(block, "H", "the tool whose offset is added", "G", 432)
                offset = list(self.frame.tool)
            number = (self._whole(block, "H") if "H" in words else 0) or self._tool
            added = self._tool_of(number, block, "H", ("G", code)).offset
            offset = [a + b for a, b in zip(offset, added, strict=True)]
        self._use_tool_offset(tuple(offset))

    def _use_tool_offset(self, offset: tuple[float, ...]) -> None:
        self.modal.tool = offset
        self._move_frame(tool=offset)
        self._emit(c.UseToolLengthOffset(offset))

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
        if not {"I", "J"}.isdisjoint(block.words):
            raise block.fault("I and J are angles of a tool; they are set with G10 L1", "IJ")
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
        number = self._whole(block, "P", 1)
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
        self._say_tool(1 + list(self.tools).index(number), tool)
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

    def _say_tool(self, row: int, tool: Tool) -> None:
        unit = self.settings.unit
        self._emit(
            c.SetToolTableEntry(
                row,
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
        named = not AXIS_WORDS.isdisjoint(block.words)
        if named:
            self.position = self._target(block)
        self._leaving = False
        self._emit(c.StraightTraverse(self.position.copy()))
        machine, home = self.frame.to_machine(self.position), self._stored(HOME[command])
        for axis in self._wrapped:
            home[axis] = turned(home[axis] % TURN, machine[axis])
        home = self.frame.to_program(home)
        self.position = self.position.copy()
        for letter, axis in self._axis.items():
            if letter in block.words or not named:
                self.position[axis] = home[axis]
        self._emit(c.StraightTraverse(self.position.copy()))

    def _store_home(self, command: int, block: Block) -> None:
        self._forbid_compensation(block, "G", command)
        self._store(HOME[command - 1], self.frame.to_machine(self.position))
