"""Canonical calls: what an interpreted program does, one small record each.

These are the canonical machining functions of RS274/NGC. Positions are program coordinates: in the
length units that `UseLengthUnits` selected last, under the offsets and the rotation that stand.
Offsets are in mm and degrees, whatever the units.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from pulsewright.motion.moves import Plane

Position = Sequence[float]  # X Y Z A B C


class UseLengthUnits(NamedTuple):
    """Lengths from here on are in units of ``scale`` [mm]."""

    scale: float


class SetG5xOffset(NamedTuple):
    """Select a coordinate system, 1 to 9, with its origin in machine coordinates."""

    system: int
    offset: Position


class SetG92Offset(NamedTuple):
    """Shift program coordinates within their system."""

    offset: Position


class SetXYRotation(NamedTuple):
    """Turn program coordinates about the Z axis of their system [degrees]."""

    angle: float


class UseToolLengthOffset(NamedTuple):
    """Compensate for the tool."""

    offset: Position


class SetFeedReference(NamedTuple):
    """Feeds are along X, Y and Z."""


class OnReset(NamedTuple):
    """The interpreter starts afresh."""


class Remark(NamedTuple):
    """A comment."""

    text: str


class Message(NamedTuple):
    """Text for the operator."""

    text: str


class Print(NamedTuple):
    """Text for the standard output."""

    text: str


class Log(NamedTuple):
    """A line for the log file, or its opening and closing: ``LOG``, ``LOGOPEN``..."""

    name: str
    text: str


class SelectPlane(NamedTuple):
    """Arcs turn in this plane."""

    plane: Plane


class SetFeedMode(NamedTuple):
    """Feed rates count per revolution, or else per minute."""

    per_revolution: bool


class SetFeedRate(NamedTuple):
    """Feed rate in units of ``scale`` [mm] (or degrees) per minute or revolution."""

    rate: float
    scale: float


class SetSpindleSpeed(NamedTuple):
    """Spindle speed [rev/min]."""

    speed: float


class SetSpindleMode(NamedTuple):
    """Constant surface speed up to ``limit`` [rev/min]; 0 for constant turning."""

    limit: float


class StartSpindle(NamedTuple):
    """Turn the spindle: 1 clockwise, -1 counterclockwise."""

    direction: int


class StopSpindle(NamedTuple):
    """Stop the spindle."""


class OrientSpindle(NamedTuple):
    """Turn the spindle to an angle [degrees] and hold it."""

    angle: float
    mode: int


class WaitOrient(NamedTuple):
    """Wait until the spindle is oriented, at most ``timeout`` [s]."""

    timeout: float


class StraightTraverse(NamedTuple):
    """Move straight as fast as the machine can."""

    position: Position


class StraightFeed(NamedTuple):
    """Move straight at the feed rate."""

    position: Position


class TapFeed(NamedTuple):
    """Move straight at the feed rate within a tapping cycle in ``plane``."""

    position: Position
    plane: Plane


class ArcFeed(NamedTuple):
    """Move along an arc or helix at the feed rate.

    ``center`` is in the two axes of the plane; ``turns`` counts the turns begun, negative
    clockwise; ``sweep`` is the signed angle [rad].
    """

    plane: Plane
    end: Position
    center: tuple[float, float]
    turns: int
    sweep: float


class SplineFeed(NamedTuple):
    """Move along a clamped uniform rational B-spline in X and Y at the feed rate.

    ``points`` are its control points, where it starts the first of them, ``weights`` theirs;
    ``order`` is 1 more than its degree.
    """

    points: Sequence[tuple[float, float]]
    weights: Sequence[float]
    order: int
    end: Position


class RigidTap(NamedTuple):
    """Go to ``position``, and back to ``start`` ``back`` times as fast, with the spindle."""

    position: Position
    start: Position
    back: float = 1.0


class StraightProbe(NamedTuple):
    """Move straight until the probe trips."""

    position: Position


class Probe(NamedTuple):
    """Switch the probe on or off."""

    on: bool


class StartSpeedFeedSync(NamedTuple):
    """Tie motion to the spindle: ``pitch`` length units per revolution."""

    pitch: float


class StopSpeedFeedSync(NamedTuple):
    """End that."""


class SetMotionControlMode(NamedTuple):
    """How corners are passed: ``EXACT_PATH``, ``EXACT_STOP``, or ``CONTINUOUS`` in a tolerance."""

    mode: str
    tolerance: float = 0.0


class SetNaivecamTolerance(NamedTuple):
    """How far a line that replaces several may be off."""

    tolerance: float


class SelectTool(NamedTuple):
    """Prepare a tool."""

    number: int


class ChangeTool(NamedTuple):
    """Put the prepared tool into the spindle."""

    number: int


class ChangeToolNumber(NamedTuple):
    """Say which tool is in the spindle."""

    number: int


class SetToolTableEntry(NamedTuple):
    """Change the tool table; ``row`` counts from 1, and 0 is the tool in the spindle."""

    row: int
    number: int
    offset: Position
    diameter: float
    front_angle: float
    back_angle: float
    orientation: int


class Switch(NamedTuple):
    """Coolant (``MIST``, ``FLOOD``) or an override, on or off."""

    name: str
    on: bool


class Output(NamedTuple):
    """Set a digital or analog output, with the motion or at once."""

    name: str
    pin: int
    value: float | None = None
    with_motion: bool = False


class WaitInput(NamedTuple):
    """Wait for an input: ``kind`` and ``mode`` as M66 has them, ``timeout`` [s]."""

    pin: int
    analog: bool
    mode: int
    timeout: float


class Dwell(NamedTuple):
    """Stand still [s]."""

    seconds: float


class ProgramStop(NamedTuple):
    """Wait for the operator; ``optional`` for M1."""

    optional: bool


class PalletShuttle(NamedTuple):
    """Change the pallet."""


class ProgramEnd(NamedTuple):
    """The program is over; ``code`` 2 or 30."""

    code: int


class Finish(NamedTuple):
    """The program is over at its closing percent sign."""


class Canon(Protocol):
    """Whoever carries out canonical calls.

    Members
    -------
    line : int
        Line of the program that the calls come from.
    number : str
        Its N word, or nothing.
    """

    line: int
    number: str

    def emit(self, call: tuple[object, ...]) -> None:
        """Carry out one call."""
        ...
