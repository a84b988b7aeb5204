"""The G-code interpreter: RS274/NGC as LinuxCNC speaks it.

The dialect, and what is chosen where machines differ:

- At the start: G21 G17 G90 G91.1 G94 G54 G49 G64 (blending within the machine's own tolerance), no
  motion mode, feed 0, spindle and coolant off.
- Motion: G0 G1 G2 G3 (I J K or R, helices, P turns, G17 G18 G19), G53, G80, G28 and G30 (``.1``
  stores).
- Frames: G54 to G59.3, G10 L2 and L20, G92 to G92.3, G43 H, G49, G20 G21, G90 G91, G90.1 G91.1.
- Feed: F in G94 (units/min) and G93 (inverse time). F is read in the length units that its own
  block selects: ``G20 F6`` is 6 inch/min.
- Path: G61 (exact path), G61.1 (exact stop), G64 with P (tolerance); Q is accepted and not used.
- Machine: M3 M4 M5 S, M6 T, M7 M8 M9, M0 M1, M2 M30, G4.
- Accepted without effect here: G40, G97, G98, G99, M48, M49.
- Values: expressions in brackets, functions, numbered and named parameters, which take their new
  values at the end of the line. Work offsets, homes and G92 are parameters 5161 to 5390 [mm].
- Comments ``( )`` and ``;``; ``(MSG,...)``, ``(DEBUG,...)`` and ``(PRINT,...)`` become messages.
- A program ends at M2, M30, a second ``%`` or its last line.

Everything else is refused with its line and column, never skipped.

Modules: ``reader`` (text to `Block`), ``codes`` (modal groups), ``arcs`` (geometry),
``interpreter`` (state and order of execution), ``recorder`` (what comes out, in columns).
"""

from pulsewright.motion.gcode.interpreter import InterpreterSettings, interpret, interpret_text

__all__ = ["InterpreterSettings", "interpret", "interpret_text"]
