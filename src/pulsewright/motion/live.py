"""A plan that is changed while it is played: feed hold, resume and feed override.

What has been played stays; from a given time on the plan is another one along the same path, within
the same limits. A hold is the shortest way to rest, and then a standstill without end, which the
plan after it takes the place of.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import uncompiled
from pulsewright.errors import CheckFailedError, UsageError
from pulsewright.motion.certificate import Certificate, Certifier
from pulsewright.motion.machine import Machine
from pulsewright.motion.moves import Moves
from pulsewright.motion.plan import blended_path
from pulsewright.motion.replan import NEAR, NOTHING, Along, Place, Plan
from pulsewright.motion.trajectory import Trajectory

ENDLESS: Final = 1e6  # a standstill until further notice [s]
LATER: Final = 0.01  # from one place to the next one at which a new plan is tried [s]


class LivePlan:
    """A trajectory and what becomes of it.

    Parameters
    ----------
    trajectory : Trajectory
        As `plan` returns it.
    moves : Moves
    machine : Machine

    Attributes
    ----------
    trajectory : Trajectory
        As it is now, with the same elements.
    override : (k,) float64
        Of the feed, on each piece; 0 where motion is held.
    factor : float
        What feeds are multiplied by now.
    held : bool
        Whether motion is held, or on the way to it.
    """

    @uncompiled(0)
    def __init__(self, trajectory: Trajectory, moves: Moves, machine: Machine) -> None:
        self.trajectory = trajectory
        self.factor, self.held = 1.0, False
        self._moves, self._machine = moves, machine
        self._plan = Plan(
            trajectory.element, trajectory.start, trajectory.law, np.ones(len(trajectory.element))
        )
        elements, limits = blended_path(moves, machine)
        free = moves.pitch[elements.move] == 0 if len(moves) else np.ones(1, np.bool_)
        self._along = Along(elements, limits, free)
        self._rest = Place(0, 0.0)  # where it is held ...
        self._since = math.inf  # ... from this time on

    @property
    def override(self) -> NDArray[np.float64]:
        """Override of the feed on each piece; 0 where motion is held, (k,)."""
        return self._plan.override

    def at_rest(self, time: float) -> bool:
        """Tell whether motion is held and has come to rest by ``time`` [s]."""
        return self.held and time >= self._since

    def hold(self, time: float) -> Trajectory:
        """Return the plan that leaves the old one at ``time`` [s], comes to rest, and stays there.

        Raises
        ------
        CheckFailedError
            If it breaks a limit: a defect of the planner, caught by its certificate.
        """
        if self.held:
            return self.trajectory
        before, after = self._plan.cut(time)
        place = self._along.at(self._plan, time)
        if place is None:  # there is no motion at all
            return self.trajectory
        way, end = NOTHING, min(place, self._along.end)  # no place is behind the path
        if place.speed or place.acceleration:
            way = self._along.to_rest(place, after)
            end = way.end
            place = self._along.at(way, way.duration) or end
        standstill = Plan(
            np.array([end.element], np.int32),
            np.array([0.0, ENDLESS]),
            np.array([[end.s, 0.0, 0.0, 0.0]]),
            np.zeros(1),
        )
        self._change(before.then(way).then(standstill), whole=False)
        self.held, self._rest, self._since = True, place, time + way.duration
        return self.trajectory

    def resume(self, time: float) -> Trajectory:
        """Return the plan that goes on at ``time`` [s] where motion is held.

        Raises
        ------
        CheckFailedError
            As `hold`.
        """
        if self.held:
            if not self._lead(time, self._since):
                raise CheckFailedError("no plan found that goes on from a hold within the limits")
            self.held, self._since = False, math.inf
        return self.trajectory

    def set_override(self, factor: float, time: float) -> Trajectory:
        """Return the plan whose programmed feeds are multiplied by ``factor`` from ``time`` [s] on.

        Rapids and moves that keep to the spindle are not changed, nor limits of the machine.

        Raises
        ------
        UsageError
            If the factor is not positive.
        CheckFailedError
            As `hold`.
        """
        require_override(factor)
        before, self.factor = self.factor, factor
        if factor != before and not self.held:
            try:
                self._lead(time, self._plan.duration)
            except CheckFailedError:
                self.factor = before
                raise
        return self.trajectory

    def certificate(self) -> Certificate:
        """Return the certificate of the whole plan, standstills of holds left out."""
        return self._certified(self._plan, whole=not self.held)

    def _lead(self, time: float, rest: float) -> bool:
        """Plan to the end of the path from ``time`` on, or from as soon as a plan is found.

        Return whether one was found up to ``rest`` [s], where the old plan rests.
        """
        old, along = self._plan, self._along
        while True:
            place = self._rest if time >= self._since else along.at(old, time)
            found = None if place is None else along.to_end(place, self.factor)
            if found is not None:
                self._change(old.cut(time)[0].then(found), whole=True)
                return True
            if time >= rest - NEAR:
                return False
            time = min(time + LATER, rest)

    def _change(self, plan: Plan, *, whole: bool) -> None:
        certificate = self._certified(plan, whole=whole)
        if not certificate.passed:
            raise CheckFailedError(f"the changed plan fails its certificate: {certificate}")
        self._plan = plan
        self.trajectory = self.trajectory.timed(plan.element, plan.start, plan.law)

    @uncompiled(0)
    def _certified(self, plan: Plan, *, whole: bool) -> Certificate:
        moving = plan.override > 0
        certifier = Certifier(self._machine, self.trajectory.at(0.0)[0])
        if moving.any() and len(self._moves):
            certifier.add(self._moves)
            element = plan.element[moving]
            start = np.append(0.0, np.diff(plan.start)[moving].cumsum())
            t = self.trajectory
            reached = int(np.searchsorted(t.move, t.move[element[-1]], "right"))
            path = t.timed(element, start, plan.law[moving], slice(0, reached))
            found = certifier.check(path, plan.override[moving])
            return certifier.finish() if whole else found
        return certifier.finish()


def require_override(factor: float) -> None:
    """Check a factor for feeds.

    Raises
    ------
    UsageError
        If it is not positive.
    """
    if not 0 < factor < math.inf:
        raise UsageError(f"override of {factor:g} asked; it must be positive; 0 is hold()")
