"""The G-code interpreter: RS274/NGC as LinuxCNC speaks it.

The dialect, and what is chosen where machines differ:

- At the start: G21 G17 G90 G91.1 G94 G49 G64 (blending within the machine's own tolerance), G99,
  no motion mode, feed 0, spindle and coolant off; the coordinate system of parameter 5220, which
  is G54 where no parameter file says another.
- Motion: G0 G1, G2 G3 (I J K or R, helices, P turns, G17 G18 G19), G53, polar ``@`` ``^``, G80, G28
  and G30 (``.1`` stores), G33 G33.1 G76 with the spindle, G38.2 to G38.5, splines in G17 (G5, G5.1,
  G5.2 to G5.3).
- Frames: G54 to G59.3 with rotation, G10 L1 L2 L10 L11 L20, G52, G92 to G92.3, G43 G43.1 G43.2 G49,
  G20 G21, G90 G91, G90.1 G91.1, G7 G8. The machine stands still while its frame changes.
- Feed: G93, G94, G95. F is read in the length units that its own block selects: ``G20 F6`` is 6
  inch/min.
- Path: G61 (exact path), G61.1 (exact stop), G64 with P (tolerance) and Q (short segments).
- Cutter compensation: G40, G41, G42, G41.1, G42.1 in G17 and G18, there with the orientations of
  lathe tools too; what would gouge is refused.
- Canned cycles: G73 G74 G81 to G89 with G98 and G99 in all planes. G84 taps along its axis in G18
  and G19 too; there the printer alone repeats how the reference writes it.
- Machine: M0 M1 M60, M2 M30, M3 M4 M5 S, G96 G97, M19, M6 T, M61, M7 M8 M9, M48 to M53, M62 to
  M68, M70 to M73, G4.
- Flow: O-words with numbers, names and values; subroutines in this file and in files of a search
  path; M98 and M99. M99 of the main program ends it. Calls and lines are limited: nothing hangs.
- Values: expressions, functions, numbered and named parameters, which take their new values at the
  end of the line, and those that tell the state of the machine. Offsets and homes are parameters
  5161 to 5390, in the units of the machine.
- Comments ``( )`` and ``;``. The last one in parentheses counts: ``(MSG,...)``, ``(DEBUG,...)`` and
  ``(PRINT,...)`` are messages.
- A program ends at M2, M30, a second ``%`` or its last line.

Everything else is refused with its line and column, never skipped: lathe cycles, axes U V W,
user-defined M codes.

Read in this order: ``reader`` (text to `Line`) with ``expressions`` and ``parameters``; ``codes``
(modal groups) and ``calls`` (what comes out: canonical calls); ``interpreter`` (what a line does,
and in which order) above ``context`` (the state), ``machine_codes``, ``mode_codes``,
``origin_codes``, ``motion_codes`` and ``splines``, with their geometry in ``offsets``, ``arcs``,
``cycles`` and ``compensation``; ``flow`` (which line is next); ``recorder`` (calls to moves) and
``printer`` (calls to text); ``bulk`` (plain lines past all that).
"""

from pulsewright.motion.gcode.run import canonical, interpret, interpret_text
from pulsewright.motion.gcode.settings import InterpreterSettings

__all__ = ["InterpreterSettings", "canonical", "interpret", "interpret_text"]
