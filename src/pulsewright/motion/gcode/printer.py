"""Canonical calls as text, in the form of ``rs274 -g``."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Final

from pulsewright.motion.gcode import calls as c
from pulsewright.motion.moves import Plane
from pulsewright.units import INCH

_PLANES: Final = {Plane.XY: "XY", Plane.ZX: "XZ", Plane.YZ: "YZ"}


def _list(values: Iterable[float], separator: str = ", ") -> str:
    return separator.join([f"{value:.4f}" for value in values])


def _arc(call: c.ArcFeed) -> str:
    first, second = call.plane.axes
    end = call.end
    return (
        f"ARC_FEED({end[first]:.4f}, {end[second]:.4f}, {_list(call.center)}, {call.turns}, "
        f"{end[call.plane]:.4f}, {_list(end[3:])})"
    )


def _tap(call: c.TapFeed) -> str:
    # In G18 and G19 the reference gives the coordinates of tapping moves in the order of the plane.
    x, y, z, *abc = call.position
    turned = {Plane.XY: (x, y, z), Plane.ZX: (y, z, x), Plane.YZ: (z, x, y)}[call.plane]
    return f"STRAIGHT_FEED({_list((*turned, *abc))})"


def _mode(call: c.SetMotionControlMode) -> str:
    tolerance = f", {call.tolerance:.6f}" if call.mode == "CONTINUOUS" else ""
    return f"SET_MOTION_CONTROL_MODE(CANON_{call.mode}{tolerance})"


def _switch(call: c.Switch) -> str:
    if call.name in ("MIST", "FLOOD"):
        return f"{call.name}_{'ON' if call.on else 'OFF'}()"
    spindle = "0" if call.name == "SPEED_OVERRIDE" else ""
    return f"{'ENABLE' if call.on else 'DISABLE'}_{call.name}({spindle})"


def _output(call: c.Output) -> str:
    return f"{call.name}({call.pin}{'' if call.value is None else f',{call.value:.6f}'})"


def _tool(call: c.SetToolTableEntry) -> str:
    offset = _list((*call.offset, 0.0, 0.0, 0.0), " ")
    return (
        f"SET_TOOL_TABLE_ENTRY({call.row}, {call.number}, {offset}, "
        f"{call.front_angle:.4f}, {call.back_angle:.4f}, {call.orientation})"
    )


_TEXT: Final[dict[type, Callable[[Any], str]]] = {
    c.SetXYRotation: lambda call: f"SET_XY_ROTATION({call.angle:.4f})",
    c.SetFeedReference: lambda _: "SET_FEED_REFERENCE(CANON_XYZ)",
    c.OnReset: lambda _: "ON_RESET()",
    c.Remark: lambda call: f'COMMENT("{call.text}")',
    c.Message: lambda call: f'MESSAGE("{call.text}")',
    c.Log: lambda call: f'{call.name}("{call.text}")' if call.text else f"{call.name}()",
    c.SelectPlane: lambda call: f"SELECT_PLANE(CANON_PLANE_{_PLANES[call.plane]})",
    c.SetFeedMode: lambda call: f"SET_FEED_MODE(0, {call.per_revolution:d})",
    c.SetFeedRate: lambda call: f"SET_FEED_RATE({call.rate:.4f})",
    c.SetSpindleSpeed: lambda call: f"SET_SPINDLE_SPEED(0, {call.speed:.4f})",
    c.SetSpindleMode: lambda call: f"SET_SPINDLE_MODE(0 {call.limit:.4f})",
    c.StartSpindle: lambda call: (
        f"START_SPINDLE_{'CLOCKWISE' if call.direction > 0 else 'COUNTERCLOCKWISE'}(0)"
    ),
    c.StopSpindle: lambda _: "STOP_SPINDLE_TURNING(0)",
    c.OrientSpindle: lambda call: f"ORIENT_SPINDLE(0, {call.angle:.4f}, {call.mode})",
    c.WaitOrient: lambda call: f"SPINDLE.0.WAIT_ORIENT_COMPLETE({call.timeout:.4f})",
    c.StraightTraverse: lambda call: f"STRAIGHT_TRAVERSE({_list(call.position)})",
    c.StraightFeed: lambda call: f"STRAIGHT_FEED({_list(call.position)})",
    c.TapFeed: _tap,
    c.ArcFeed: _arc,
    c.SplineFeed: lambda call: f"NURBS_FEED({len(call.points)}, ...)",
    c.RigidTap: lambda call: f"RIGID_TAP({_list(call.position[:3])})",
    c.StraightProbe: lambda call: f"STRAIGHT_PROBE({_list(call.position)})",
    c.Probe: lambda call: f"TURN_PROBE_{'ON' if call.on else 'OFF'}()",
    c.StartSpeedFeedSync: lambda call: f"START_SPEED_FEED_SYNC({call.pitch:.6f},0)",
    c.StopSpeedFeedSync: lambda _: "STOP_SPEED_FEED_SYNCH()",
    c.SetMotionControlMode: _mode,
    c.SetNaivecamTolerance: lambda call: f"SET_NAIVECAM_TOLERANCE({call.tolerance:.4f})",
    c.SelectTool: lambda call: f"SELECT_TOOL({call.number})",
    c.ChangeTool: lambda _: "CHANGE_TOOL()",
    c.ChangeToolNumber: lambda call: f"CHANGE_TOOL_NUMBER({call.number})",
    c.SetToolTableEntry: _tool,
    c.Switch: _switch,
    c.Output: _output,
    c.Dwell: lambda call: f"DWELL({call.seconds:.4f})",
    c.ProgramStop: lambda call: f"{'OPTIONAL_' * call.optional}PROGRAM_STOP()",
    c.PalletShuttle: lambda _: "PALLET_SHUTTLE()",
    c.ProgramEnd: lambda _: "PROGRAM_END()",
    c.Finish: lambda _: "FINISH()",
}


class Printer:
    """Writes calls as numbered lines.

    Parameters
    ----------
    write : callable
        Takes each line of text, with its line end.
    """

    def __init__(self, write: Callable[[str], object]) -> None:
        self.line = 0
        self.number = ""
        self._write = write
        self._count = 0
        self._scale = 1.0

    def emit(self, call: tuple[object, ...]) -> None:
        """Write one call."""
        if isinstance(call, c.Print):
            self._write(call.text + "\n")
            return
        if isinstance(call, c.WaitInput):  # there is nothing to wait for
            return
        self._count += 1
        number = f"N{self.number}" if self.number else "N....."
        self._write(f"{self._count:5d} {number:<7}{self._text(call)}\n")

    def _text(self, call: tuple[object, ...]) -> str:
        if isinstance(call, c.UseLengthUnits):
            self._scale = call.scale
            return f"USE_LENGTH_UNITS(CANON_UNITS_{'INCHES' if call.scale == INCH else 'MM'})"
        if isinstance(call, c.SetG5xOffset):
            return f"SET_G5X_OFFSET({call.system}, {_list(self._units(call.offset))})"
        if isinstance(call, c.SetG92Offset):
            return f"SET_G92_OFFSET({_list(self._units(call.offset))})"
        if isinstance(call, c.UseToolLengthOffset):
            x, y, z, *abc = (f"{v:.4f}" for v in self._units(call.offset))
            zero = "0.0000 0.0000 0.0000"
            return f"USE_TOOL_LENGTH_OFFSET({x} {y} {z}, {' '.join(abc)}, {zero})"
        return _TEXT[type(call)](call)

    def _units(self, offset: c.Position) -> list[float]:
        """Return an offset in program units."""
        return [value / self._scale for value in offset[:3]] + list(offset[3:])
