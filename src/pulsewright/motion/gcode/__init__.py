"""The G-code interpreter."""

from pulsewright.motion.gcode.interpreter import InterpreterSettings
from pulsewright.motion.gcode.run import canonical, interpret, interpret_text

__all__ = ["InterpreterSettings", "canonical", "interpret", "interpret_text"]
