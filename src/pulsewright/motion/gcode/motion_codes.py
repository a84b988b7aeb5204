"""Lines, arcs, motion with the spindle, probing, canned cycles and threads."""

from __future__ import annotations

import math
from typing import Final

from pulsewright.motion.gcode import arcs
from pulsewright.motion.gcode import calls as c
from pulsewright.motion.gcode.arcs import RESOLUTION
from pulsewright.motion.gcode.codes import (
    AXIS_WORDS,
    CENTERS,
    CYCLES,
    PLANES,
    g_name,
)
from pulsewright.motion.gcode.context import Context
from pulsewright.motion.gcode.cycles import CLEARANCE, STICKY, Hole, Thread
from pulsewright.motion.gcode.cycles import CYCLES as CYCLE_OF
from pulsewright.motion.gcode.parameters import PROBED
from pulsewright.motion.gcode.reader import Block
from pulsewright.motion.gcode.settings import FARTHEST
from pulsewright.motion.moves import AXES, Plane
from pulsewright.units import INCH

# Of the radii of an arc, by length unit [program units]: LinuxCNC lets them differ so far.
ARC_TOLERANCE: Final = {1.0: 0.02 * math.sqrt(2), INCH: 0.002 * math.sqrt(2)}
REACH_TOLERANCE: Final = {1.0: 0.00127, INCH: 0.00005}  # of R against half the chord
PROBE_BACK: Final = 0.254  # [mm]
_PLANE_NAMES: Final = {plane: g_name(code) for code, plane in PLANES.items()}


class MotionCodes(Context):
    """What moves the machine."""

    def _straight(self, code: int, block: Block) -> None:
        end = self._target(block, machine=530 in block.g)
        if code == 0:
            self.position = end
            self._emit(c.StraightTraverse(end))
            return
        start = self.position
        length = math.dist(start[:3], end[:3])
        if length * self.modal.scale <= RESOLUTION:
            length = math.dist(start[3:], end[3:])
        self._feed_for(block, length)
        self.position = end
        self._emit(c.StraightFeed(end))

    def _arc(self, code: int, block: Block) -> None:
        if 530 in block.g:
            raise block.fault("G53 works with G0 and G1 only", "G", 530)
        self._check_not_leaving(block)
        modal, words, plane = self.modal, block.words, self.modal.plane
        clockwise = code == 20
        first, second = plane.axes
        letters = AXES[first], AXES[second]
        centers = CENTERS[first], CENTERS[second]
        if CENTERS[plane] in words:
            raise block.fault(
                f"in the plane of {_PLANE_NAMES[plane]} the centre is given by {centers[0]} and "
                f"{centers[1]}",
                CENTERS[plane],
            )
        turns = self._whole(block, "P", 1) if "P" in words else 1
        end = self._target(block)
        a = self.position[first], self.position[second]
        b = end[first], end[second]
        try:
            if "R" in words:
                if not set(centers).isdisjoint(words):
                    raise block.fault("an arc has either R or a centre, not both", "R")
                named = {*letters, *("@^" if plane is Plane.XY else "")}
                if named.isdisjoint(words) or math.dist(a, b) <= RESOLUTION:
                    raise block.fault(
                        f"an arc with R needs an end in {letters[0]} or {letters[1]} that is not "
                        "its start; give the centre for a full circle",
                        "R",
                    )
                center = arcs.center_from_radius(
                    a,
                    b,
                    words["R"],
                    clockwise=clockwise,
                    tolerance=REACH_TOLERANCE[modal.scale],
                )
            else:
                center = self._center(block, a, centers, (first, second))
                arcs.check_radii(a, b, center, ARC_TOLERANCE[modal.scale])
        except ValueError as error:
            raise block.fault(str(error), {"R", *centers}) from None
        sweep = arcs.sweep(a, b, center, clockwise=clockwise, turns=turns)
        rise = end[plane] - self.position[plane]
        length = math.hypot(math.dist(a, center) * sweep, rise)
        if not length < FARTHEST:
            raise block.fault(f"an arc of more than {FARTHEST:g} mm", {"R", "P", *centers})
        self._feed_for(block, length)
        self.position = end
        self._emit(c.ArcFeed(plane, end, center, -turns if clockwise else turns, sweep))

    def _center(
        self, block: Block, start: arcs.Point, letters: tuple[str, str], axes: tuple[int, int]
    ) -> arcs.Point:
        """Return the centre that I, J and K give."""
        words = block.words
        absolute = self.modal.absolute_centers
        missing = [letter for letter in letters if letter not in words]
        if len(missing) == 2 or (missing and absolute):
            raise block.fault(
                f"an arc needs its centre or its radius: {' and '.join(missing)} or R is missing"
                + (" (with G90.1 both coordinates of the centre)" if len(missing) == 1 else ""),
                {"G", *AXIS_WORDS},
                self._motion_code(block),
            )
        origin = (0.0, 0.0) if absolute else start
        x, y = (words.get(letter, 0.0) for letter in letters)
        return origin[0] + x, origin[1] + y

    def _synchronised(self, code: int, block: Block) -> None:
        """Move with the spindle: G33 and G33.1."""
        self._forbid_compensation(block, "G", code)
        self._need(block, "K", "travel per revolution", "G", code)
        if not self.modal.spindle:
            raise block.fault(f"{g_name(code)} needs a turning spindle; use M3 or M4", "G", code)
        end = self._target(block)
        self._emit(c.StartSpeedFeedSync(block.words["K"]))
        if code == 330:
            self.position = end
            self._emit(c.StraightFeed(end))
        else:
            back = block.words.get("I", 1.0)
            if back <= 0:
                raise block.fault("I, how much faster the tap goes back, must be above 0", "I")
            self._emit(c.RigidTap(end, self.position, back))
        self._emit(c.StopSpeedFeedSync())

    def _probe(self, code: int, block: Block) -> None:
        self._forbid_compensation(block, "G", code)
        if self.modal.feed_mode != 940:
            raise block.fault("probing works with feed per minute (G94) only", "G", code)
        end = self._target(block)
        if end == self.position:
            raise block.fault("a probe has to move; this is where it is", AXIS_WORDS)
        self._feed_for(block, math.dist(self.position[:3], end[:3]))
        self._emit(c.Probe(True))
        self._emit(c.StraightProbe(end))
        self._emit(c.Probe(False))
        # Without a machine the probe trips at the end, and is drawn back a little, as that of
        # LinuxCNC is where it stands alone.
        self.parameters.numbered[PROBED : PROBED + len(AXES)] = end
        start, length = self.position, math.dist(self.position[:3], end[:3])
        back = PROBE_BACK / self.modal.scale / length if length else 0.0
        self.position = [e + back * (s - e) for s, e in zip(start[:3], end[:3], strict=True)]
        self.position += end[3:]

    def _cycle(self, code: int, block: Block) -> None:
        modal, words, plane = self.modal, block.words, self.modal.plane
        self._forbid_compensation(block, "G", code)
        if modal.feed_mode == 930:
            raise block.fault("canned cycles do not work with inverse time feed (G93)", "G", code)
        if rotary := set("ABC") & set(words):
            raise block.fault("rotary axes do not move in a canned cycle", rotary)
        cycle, name, depth_letter = CYCLE_OF[code], g_name(code), AXES[plane]
        goes_on = modal.motion in CYCLES
        if not goes_on:
            self._old_depth = self.position[plane]
        if modal.motion != code:
            self._series = {}
        named = dict(self._named_axes(block))
        self._series.update({k: v for k, v in words.items() if k in STICKY or k == depth_letter})
        for letter in f"R{depth_letter}{cycle.words}":
            if letter not in self._series:
                raise block.fault(f"{name} needs {letter}", "G", code)
        series = self._series
        self._pause = series.get("P", self._pause)
        if self._pause < 0:
            raise block.fault("P, the time to wait, must not be negative", "P")
        if "Q" in cycle.words and series["Q"] <= 0:
            raise block.fault("Q, the depth of a peck, must be above 0", "Q")
        if cycle.spindle is not None and not (
            modal.spindle == cycle.spindle if cycle.spindle else modal.spindle
        ):
            how = {1: " clockwise (M3)", -1: " counterclockwise (M4)", 0: ""}[cycle.spindle]
            raise block.fault(f"{name} needs a spindle that turns{how}", "G", code)
        if modal.feed <= 0:
            self._refuse_zero_feed(block)
        repeat = self._whole(block, "L", 1) if "L" in words else 1

        retract, bottom = series["R"], series[depth_letter]
        if not modal.absolute:
            retract += self._old_depth
            bottom += retract
        if retract < bottom:
            raise block.fault(
                f"R is {retract:g}, below {depth_letter}, which is {bottom:g}", f"R{depth_letter}"
            )
        clear = max(self._old_depth, retract) if modal.retract == 980 else retract
        hole = Hole(
            self._emit,
            plane,
            self.position.copy(),
            retract,
            bottom,
            clear,
            CLEARANCE / modal.scale,
            modal.spindle,
            {"P": self._pause, **series},
            [name for name in ("FEED_OVERRIDE", "SPEED_OVERRIDE") if getattr(modal, name.lower())],
        )
        if code == 870 and not modal.absolute:
            hole.words["IJK"[plane]] += bottom
        if self._old_depth < retract - RESOLUTION:
            hole.traverse(retract)
        elif goes_on and hole.position[plane] <= retract:
            # From hole to hole where the last one ended, if that is above R; else from where G98 or
            # G99 would have ended it.
            hole.position[plane] = clear
        exact = modal.path[0] == "EXACT_PATH"
        if not exact:
            self._emit(c.SetMotionControlMode("EXACT_PATH"))
        polar = not {"@", "^"}.isdisjoint(words)
        for _ in range(repeat):
            there = hole.position.copy()
            for axis, value in named.items():
                there[axis] = value if modal.absolute else there[axis] + value
            if polar:
                self._polar(block, there)
            hole.traverse_beside([there[axis] for axis in plane.axes])
            if abs(hole.position[plane] - retract) > RESOLUTION:
                hole.traverse(retract)
            cycle.run(hole)
        self.position = hole.position
        if not exact:
            self._say_path_control(naive=True)

    def _thread(self, _: int, block: Block) -> None:
        words, modal = block.words, self.modal
        self._forbid_compensation(block, "G", 760)
        if modal.plane is not Plane.ZX:
            raise block.fault("G76 works in the plane of G18", "G", 760)
        if others := set("XYABC") & set(words):
            raise block.fault("G76 moves along Z; all else is where the tool is", others)
        self._need(block, "ZPIJK", "end, pitch, peak, first cut and depth", "G", 760)
        if not modal.spindle:
            raise block.fault("G76 needs a turning spindle; use M3 or M4", "G", 760)
        half = 0.5 if modal.diameter else 1.0
        ends = self._whole(block, "L", 0, 3) if "L" in words else 0
        thread = Thread(
            words["P"],
            words["I"] * half,
            words["J"] * half,
            words["K"] * half,
            words.get("R", 1.0),
            words.get("Q", 0.0),
            self._whole(block, "H") if "H" in words else 0,
            words.get("E", 0.0),
            bool(ends & 1),
            bool(ends & 2),
        )
        for letter, fits in (
            ("P", thread.pitch > 0),
            ("I", thread.peak != 0),
            ("J", thread.first > 0),
            ("K", thread.depth > 0),
            ("R", thread.degression >= 1),
            ("Q", 0 <= thread.angle < 90),
            ("E", thread.taper >= 0 and (thread.taper > 0 or not ends)),
        ):
            if not fits:
                raise block.fault(f"G76 cannot work with this {letter}", {letter, "G"}, 760)
        if thread.depth < thread.first:
            raise block.fault("the first cut, J, is deeper than the thread, K", "J")
        if (thread.depth / thread.first) ** thread.degression > 10_000:
            raise block.fault("this thread would take more than 10000 passes", "J")
        end = self._target(block)
        thread.run(self._emit, self.position, end[2])
        self.position = end
