"""The modal state of a program: what holds until another code changes it."""

from __future__ import annotations

from dataclasses import dataclass

from pulsewright.motion.moves import Plane


@dataclass(slots=True)
class Modal:
    """Modal state; `dataclasses.replace` makes the copy that M70 keeps.

    Members
    -------
    motion : int or None
        Code of the motion mode, ten times its number; None after G80.
    feed_mode : int
        930, 940 or 950.
    compensation : int
        400, 410 for left or 420 for right.
    scale : float
        Length unit [mm].
    path : (str, float, float)
        Motion control mode, tolerance and naive CAM tolerance [program units].
    retract : int
        980 or 990.
    feed : float
        F as programmed, in units of ``feed_scale`` [mm].
    spindle : int
        1 clockwise, -1 counterclockwise, 0 off.
    surface_limit : float
        D of G96 [rev/min]; 0 in G97.
    """

    motion: int | None = None
    plane: Plane = Plane.XY
    absolute: bool = True
    absolute_centers: bool = False
    feed_mode: int = 940
    compensation: int = 400
    scale: float = 1.0
    path: tuple[str, float, float] = ("CONTINUOUS", 0.0, 0.0)
    retract: int = 990
    system: int = 1
    feed: float = 0.0
    feed_scale: float = 1.0
    speed: float = 0.0
    spindle: int = 0
    surface_limit: float = 0.0
    mist: bool = False
    flood: bool = False
    feed_override: bool = True
    speed_override: bool = True
    adaptive_feed: bool = False
    feed_hold: bool = True
    diameter: bool = False
    tool: tuple[float, ...] = (0.0,) * 6
