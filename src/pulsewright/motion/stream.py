"""Planning while the machine moves: programs of any length, feed hold and feed override.

The path is planned in windows, always up to a rest at its known end. What the machine does next is
taken from the plan in parts; a part that has been taken stays as it is, the rest may change:

* *More moves* are planned from where the rest at the end of the old plan is not felt yet, with the
  speed and acceleration that the old plan has there.
* A *hold* is the shortest way to rest that keeps the limits.
* An *override* changes feeds from now on; where the machine is faster then, from the shortest
  distance on in which it can get slower.

All of these begin somewhere on a plan that keeps all limits and ends at rest. Where no better plan
can be found from there, it is followed a little further; at worst, to its rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import uncompiled
from pulsewright.errors import UsageError
from pulsewright.motion.machine import Machine
from pulsewright.motion.moves import Moves
from pulsewright.motion.replan import NEAR, NOTHING, Along, Place, Plan
from pulsewright.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from pulsewright.motion.path import Elements

WINDOW: Final = 1 << 12  # moves that are planned at once
UNSURE: Final = 68  # moves at the end, whose chords may change with those that follow
RUNS: Final = 3  # and chords, whose blends may
LOOK_AHEAD: Final = 2.0  # of the time for stopping: from there on, the end is not felt
TRIES: Final = 16  # places in that time to begin from


@dataclass(frozen=True)
class Part:
    """A part of a planned motion, to be done next.

    Parameters
    ----------
    trajectory : Trajectory
        From time 0 on, beginning with the speed and acceleration that the part before ends with.
        ``move`` counts from the first move of all. It has all elements of each move that it has
        pieces of, also those it does not reach.
    override : (k,) float64
        Of the feed, on each piece.
    """

    trajectory: Trajectory
    override: NDArray[np.float64]


class Planner:
    """Plans moves as they come, within bounded memory.

    Parameters
    ----------
    machine : Machine

    Examples
    --------
    >>> planner = Planner(machine)
    >>> planner.add(moves)
    >>> while part := planner.take(0.1):
    ...     send(part.trajectory)
    ...     if pause_is_pressed():
    ...         planner.hold()
    """

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        _, velocity, acceleration = machine.limit_rows()
        stop = velocity / acceleration + acceleration / machine.jerk_limits()
        self._look_ahead = LOOK_AHEAD * float(stop.max())
        self._queue: list[Moves] = []  # not looked at yet
        self._moves: Moves | None = None  # of the window
        self._first = 0  # how many moves there were before
        self._sure = 0  # the move from which on the window's elements are right
        self._ends = np.zeros(0, np.int64)  # last moves of the window's chords
        self._along: Along | None = None
        self._plan = NOTHING  # what is not taken yet
        self._place = Place(0, 0.0)  # where it begins
        self._override = 1.0
        self._held = self._complete = self._all_seen = False

    @property
    def held(self) -> bool:
        """Whether motion is held, or on the way to it."""
        return self._held

    @property
    def at_rest(self) -> bool:
        """Whether the parts that have been taken end at rest."""
        return self._place.speed == 0.0 and self._place.acceleration == 0.0

    def add(self, moves: Moves) -> None:
        """Add moves, which begin where the ones before end.

        Raises
        ------
        MotionLimitError
            If a move leaves the travel of the machine.
        UsageError
            If the moves were said to be complete, or cannot be as they are.
        """
        if self._complete:
            raise UsageError("moves were added after the last ones; make a new Planner for them")
        moves.require_sound()
        self._machine.check_travel(moves)
        if len(moves):
            self._queue.append(moves)

    def finish(self) -> None:
        """Say that no more moves follow, so the motion may end with those that are known."""
        self._complete = True

    def take(self, seconds: float = math.inf) -> Part | None:
        """Return the next part of the motion, which stays as it is from now on.

        It is at most ``seconds`` long: shorter where more moves may change what follows, or where a
        window ends. None if there is no motion: because it is held or finished, or more moves have
        to be added first.
        """
        while self._settled() <= NEAR and not self._held and self._extend():
            pass
        time = min(seconds, self._settled())
        if time <= NEAR or self._along is None:
            return None
        taken, left = self._plan.cut(time)
        self._place = self._along.at(self._plan, time) or self._place
        self._plan = left
        return self._part(taken, self._along.elements)

    def hold(self) -> None:
        """Come to rest as soon as the limits allow, on the path."""
        if not self._held:
            self._held = True
            if self._along is None or self.at_rest:
                self._plan = NOTHING
            else:
                self._plan = self._along.to_rest(self._place, self._plan)

    def resume(self) -> None:
        """Go on after a hold."""
        if self._held:
            self._held = False
            self._lead(0.0)

    def override(self, factor: float) -> None:
        """Multiply programmed feeds by ``factor`` from now on; limits of the machine stay.

        Rapids and moves that keep to the spindle are not changed.

        Raises
        ------
        UsageError
            If the factor is not positive.
        """
        if not 0 < factor < math.inf:
            raise UsageError(f"override of {factor:g} asked; it must be positive; 0 is hold()")
        if factor != self._override:
            self._override = factor
            if not self._held:
                self._lead(0.0)

    def _settled(self) -> float:
        """Return how much of the plan may be taken [s]."""
        if self._held or self._all_seen:
            return self._plan.duration
        return self._plan.duration - self._look_ahead

    def _part(self, taken: Plan, x: Elements) -> Part:
        """Return pieces of a plan with their elements."""
        first = int(np.searchsorted(x.move, x.move[taken.element[0]]))
        last = int(np.searchsorted(x.move, x.move[taken.element[-1]], "right"))
        here = slice(first, last)
        trajectory = Trajectory(
            *(x.poly[here], x.cosine[here], x.sine[here], x.omega[here], x.length[here]),
            move=(x.move[here] + self._first).astype(np.int32),
            element=taken.element - np.int32(first),
            start=taken.start,
            law=taken.law,
        )
        return Part(trajectory, taken.override)

    def _lead(self, time: float) -> None:
        """Plan to the end of the window, from ``time`` on or as soon as a plan is found."""
        old, along = self._plan, self._along
        if along is None:
            return
        while True:
            found = along.to_end(along.at(old, time) or self._place, self._override)
            if found is not None:
                self._plan = old.cut(time)[0].then(found) if time > 0 else found
                return
            time = min(time + self._look_ahead / TRIES, old.duration)  # there, it is at rest

    def _extend(self) -> bool:
        """Look at more moves and plan them; return whether that may have changed anything."""
        if self._all_seen or not (self._queue or self._complete):
            return False
        begin = self._forget()
        known = 0 if self._along is None else len(self._along)
        while not self._all_seen and (self._queue or self._complete):
            fresh = self._next_moves(WINDOW)
            if fresh is not None:
                self._moves = fresh if self._moves is None else self._moves.followed_by(fresh)
            self._all_seen = self._complete and not self._queue
            with uncompiled(0 if self._moves is None else len(self._moves)):
                self._look(begin)
                if self._along is not None and len(self._along) > known:
                    self._lead(max(self._plan.duration - self._look_ahead, 0.0))
                    break
        return True

    def _forget(self) -> int:
        """Drop what lies behind; return the first move that the elements kept are of."""
        if self._along is None or self._moves is None:
            return 0
        # the chord on which the machine is; two chords before it decide its blends
        move = self._along.elements.move
        run = int(move[min(self._place.element, len(move) - 1)]) + self._first
        run = int(np.searchsorted(self._ends, run))
        if run > 0:
            self._sure = max(self._sure, int(self._ends[run - 1]) + 1)
        cut = int(np.searchsorted(move, self._sure - self._first))
        behind = int(self._ends[run - 3]) + 1 - self._first if run > 2 else 0
        self._moves = self._moves.part(behind)
        self._along = self._along.without(cut, behind)
        self._first += behind
        self._plan = replace(self._plan, element=self._plan.element - np.int32(cut))
        self._place = self._place._replace(element=self._place.element - cut)
        return self._sure

    def _next_moves(self, count: int) -> Moves | None:
        """Take some moves from the queue."""
        found: Moves | None = None
        while self._queue and count > 0:
            head = self._queue.pop(0)
            if len(head) > count:
                self._queue.insert(0, head.part(count))
                head = head.part(0, count)
            count -= len(head)
            found = head if found is None else found.followed_by(head)
        return found

    def _look(self, sure: int) -> None:
        """Make the elements of the window, from move ``sure`` on; those that stay as they are."""
        from pulsewright.motion import path
        from pulsewright.motion.plan import blended

        moves = self._moves
        if moves is None:
            return
        x, limits, kept, ends = blended(moves, self._machine)
        if not len(kept):
            return
        last = len(ends) - 1
        if not self._all_seen:
            known = kept[-UNSURE] if len(kept) >= UNSURE else -1
            last = int(np.searchsorted(ends, known)) - 1 - RUNS
            if last < 0:
                return
        first = int(np.searchsorted(x.move, sure - self._first))
        final = int(np.searchsorted(x.move, ends[last], "right"))
        if first < final:
            columns: Any = (column[first:final].copy() for column in x)
            x = path.Elements(*columns)
            self._along = Along(x, limits, moves.pitch[x.move] == 0)
            self._ends = ends + self._first


def planned(chunks: Iterable[Moves], machine: Machine) -> Iterator[Part]:
    """Yield the motion along moves that come in chunks of any size."""
    planner = Planner(machine)
    for moves in chunks:
        planner.add(moves)
        while part := planner.take():
            yield part
    planner.finish()
    while part := planner.take():
        yield part


def joined(parts: Iterable[Part]) -> Trajectory:
    """Return parts that follow each other, at least one, as one trajectory."""
    found: list[Trajectory] = []
    elements, now, last = 0, 0.0, -1
    for part in parts:
        t = part.trajectory
        again = int(np.searchsorted(t.move, last, "right"))  # elements of the part before
        new = slice(again, None)
        found.append(
            Trajectory(
                *(t.poly[new], t.cosine[new], t.sine[new], t.omega[new], t.length[new]),
                move=t.move[new],
                element=t.element + np.int32(elements - again),
                start=now + t.start[1:],
                law=t.law,
            )
        )
        elements, now, last = elements + len(t.move) - again, now + t.duration, int(t.move[-1])
    columns = {
        column.name: np.concatenate([getattr(t, column.name) for t in found])
        for column in fields(Trajectory)
    }
    return Trajectory(**columns | {"start": np.append(0.0, columns["start"])})
