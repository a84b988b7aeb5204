"""Planes, units, distances, path control and cutter compensation."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from pulsewright.motion.gcode import calls as c
from pulsewright.motion.gcode.codes import PLANES
from pulsewright.motion.gcode.compensation import Compensation
from pulsewright.motion.gcode.context import Context
from pulsewright.motion.gcode.reader import Block
from pulsewright.motion.moves import Plane
from pulsewright.units import INCH

#: From the centre of a lathe tool's nose to the point that is programmed, by the tool's
#: orientation: along Z the real part, along X the imaginary one, in radii.
TIPS: Final = (0, 1 - 1j, -1 - 1j, -1 + 1j, 1 + 1j, 1, -1j, -1, 1j, 0)

_PATH_MODES: Final = {610: "EXACT_PATH", 611: "EXACT_STOP", 640: "CONTINUOUS"}


class ModeCodes(Context):
    """What says how later words are meant."""

    def _set_plane(self, code: int, block: Block) -> None:
        plane = PLANES[code]
        if plane is not self.modal.plane:
            self._forbid_compensation(block, "G", code)
        self.modal.plane = plane
        self._emit(c.SelectPlane(plane))

    def _set_lathe_mode(self, code: int, _: Block) -> None:
        if self.modal.diameter == (code == 70):
            return
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
        _, tolerance, naive = self.modal.path  # which G61 leaves as they are
        if code == 640:
            for letter in "PQ":
                if block.words.get(letter, 0.0) < 0:
                    raise block.fault("a tolerance must not be negative", letter)
            tolerance = block.words.get("P", 0.0)
            naive = block.words.get("Q", tolerance)
        self.modal.path = (mode, tolerance, naive)
        self._say_path_control()

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

    def _set_compensation(self, code: int, block: Block) -> None:
        if code == 400:
            self._end_compensation()
            self.modal.compensation = 400
            self._emit(c.Remark("interpreter: cutter radius compensation off"))
            return
        if self._compensation is not None:
            raise block.fault("cutter compensation is already on; use G40 first", "G", code)
        if self.modal.plane is Plane.YZ:
            raise block.fault("cutter compensation works in G17 and G18", "G", code)
        radius, orientation = self._nose(code, block)
        left = (code in (410, 411)) != (radius < 0)
        self.modal.compensation = 410 if left else 420
        self._emit(
            c.Remark(f"interpreter: cutter radius compensation on {'left' if left else 'right'}")
        )
        self._compensation = self.canon = Compensation(
            self._base,
            self.modal.plane,
            left=left,
            radius=abs(radius),
            position=self.position,
            tip=abs(radius) * TIPS[orientation],
        )

    def _nose(self, code: int, block: Block) -> tuple[float, int]:
        """Return the tool's radius [program units], negative to change sides; its orientation."""
        words = block.words
        if code in (411, 421):
            self._need(block, "D", "the diameter of the tool", "G", code)
            radius = words["D"] / 2
            orientation = self._whole(block, "L", 0, 9) if "L" in words else 0
        else:
            number = (self._whole(block, "D") if "D" in words else 0) or self._tool
            tool = self._tool_of(number, block, "D", ("G", code))
            radius, orientation = tool.diameter / 2 / self.modal.scale, tool.orientation
        if orientation and self.modal.plane is not Plane.ZX:
            letter = "L" if "L" in words else "G"
            raise block.fault("a lathe tool, with an orientation, works in G18", letter, code)
        return radius, orientation

    def _end_compensation(self) -> None:
        if self._compensation is not None:
            self._compensation.finish()
            self._leaving = self._compensation.entered
            self._compensation = None
            self.canon = self._base
