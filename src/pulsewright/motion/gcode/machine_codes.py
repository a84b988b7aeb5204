"""Feed, spindle, tools, coolant, pins and waiting."""

from __future__ import annotations

from typing import Final

from pulsewright.motion.gcode import calls as c
from pulsewright.motion.gcode.codes import SWITCHES
from pulsewright.motion.gcode.context import Context
from pulsewright.motion.gcode.parameters import (
    INPUT,
)
from pulsewright.motion.gcode.reader import Block
from pulsewright.units import INCH

_FEED_MODES: Final = {
    930: "inverse time",
    940: "units per minute",
    950: "units per revolution",
}
_OUTPUTS: Final = {
    62: ("SET_MOTION_OUTPUT_BIT", True),
    63: ("CLEAR_MOTION_OUTPUT_BIT", True),
    64: ("SET_AUX_OUTPUT_BIT", False),
    65: ("CLEAR_AUX_OUTPUT_BIT", False),
    67: ("SET_MOTION_OUTPUT_VALUE", True),
    68: ("SET_AUX_OUTPUT_VALUE", False),
}


class MachineCodes(Context):
    """What switches and sets the machine."""

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
        self._tool_of(self._next_tool, block, "T", ("T", 0))  # it must be known
        self._emit(c.SelectTool(self._next_tool))

    def _change_tool(self, code: int, block: Block) -> None:
        if code == 61:
            self._name_tool(block)
            return
        self._forbid_compensation(block, "M", 6)
        self.modal.spindle = 0
        self._emit(c.StopSpindle())
        self._use_tool(self._next_tool)
        self._emit(c.ChangeTool(self._tool))

    def _name_tool(self, block: Block) -> None:
        self._need(block, "Q", "the tool that is in the spindle", "M", 61)
        number = self._whole(block, "Q")
        self._tool_of(number, block, "Q", ("M", 61))
        self._use_tool(number)
        self._emit(c.ChangeToolNumber(number))

    def _use_tool(self, number: int) -> None:
        self._tool = number
        self._store_tool()

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

    def _set_overrides(self, code: int, block: Block) -> None:
        if code in SWITCHES:
            self._set_switch(code, block)
            return
        self.modal.feed_override = self.modal.speed_override = code == 48
        self._emit(c.Switch("FEED_OVERRIDE", code == 48))
        self._emit(c.Switch("SPEED_OVERRIDE", code == 48))

    def _set_switch(self, code: int, block: Block) -> None:
        on = block.words.get("P", 1.0) != 0
        name = SWITCHES[code]
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
