"""Hold, resume and override the feed of a job while it runs, from another thread or program."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from numpy.typing import NDArray

from pulsewright import compiled
from pulsewright.errors import StoppedError
from pulsewright.motion.live import LivePlan, require_override

if TYPE_CHECKING:
    from pulsewright.boards.playing import Player
    from pulsewright.motion.certificate import Certificate
    from pulsewright.motion.trajectory import Trajectory

Floats = NDArray[np.float64]
# `Player.change`
ChangePlan = Callable[[Callable[[float], "Trajectory"]], float | None]

PORTION: Final = 0.02  # machine time between two looks at what is asked [s], ...
LONGER: Final = 0.1  # ... in real time, where a link is kept busy meanwhile
NAP: Final = 0.05  # between two looks at signals, while a simulated machine is held [s]


@dataclass(frozen=True)
class FeedState:
    """Where a job is.

    Parameters
    ----------
    state : str
        ``waiting`` for the run to begin, ``running``, ``holding`` on the way to rest, ``held`` at
        rest, or ``ended``.
    time : float
        Machine time [s].
    override : float
        Of the feed.
    line : int
        Of the program.
    position : dict of str to float
        Where the plan is, by axis [mm, degrees].
    """

    state: str
    time: float
    override: float
    line: int
    position: dict[str, float]


@dataclass(frozen=True)
class Change:
    """What was asked of a job, and when.

    Parameters
    ----------
    command : str
        ``hold``, ``resume``, ``override`` or ``stop``.
    at : float
        Machine time at which the job took it in [s].
    since : float
        Machine time from which on its plan is another one [s].
    factor : float
        The override of the feed from then on.
    """

    command: str
    at: float
    since: float
    factor: float


class FeedControl:
    """What is asked of a job while it runs. All methods may be called from any thread.

    A hold comes to rest on the path as soon as the limits allow. An override multiplies the
    programmed feeds; limits of the machine stay, and rapids and moves that keep to the spindle are
    not changed. What is asked before the job runs, holds from its begin.

    Examples
    --------
    >>> feed = FeedControl()
    >>> thread = threading.Thread(target=job.run, kwargs={"board": "usc", "feed": feed})
    >>> thread.start()
    >>> feed.hold()
    >>> feed.wait("held", timeout=5.0)
    True
    >>> feed.override(0.5)
    >>> feed.resume()
    """

    def __init__(self) -> None:
        self._news = threading.Condition()
        self._asked: list[tuple[float, str, float]] = []  # time, command, factor; by time
        self._state = FeedState("waiting", 0.0, 1.0, 0, {})

    @property
    def state(self) -> FeedState:
        """Where the job is."""
        with self._news:
            return self._state

    def hold(self, at: float | None = None) -> None:
        """Come to rest on the path, and stay there.

        Parameters
        ----------
        at : float, optional
            Machine time at which the job takes this in [s]; default is now. Likewise below.
        """
        self._ask("hold", at)

    def resume(self, at: float | None = None) -> None:
        """Go on after a hold."""
        self._ask("resume", at)

    def override(self, factor: float, at: float | None = None) -> None:
        """Multiply programmed feeds by ``factor``.

        Raises
        ------
        UsageError
            If it is not positive.
        """
        require_override(factor)
        self._ask("override", at, factor)

    def stop(self, at: float | None = None) -> None:
        """End the job: it comes to rest on its path, and `Job.run` raises `StoppedError`."""
        self._ask("stop", at)

    def wait(self, state: str, timeout: float | None = None) -> bool:
        """Wait until the job is in a state, or has ended; return whether it is in that state.

        Parameters
        ----------
        state : str
            See `FeedState`.
        timeout : float, optional
            Of this computer's time [s]; default is none.
        """
        with self._news:
            self._news.wait_for(lambda: self._state.state in (state, "ended"), timeout)
            return self._state.state == state

    def _ask(self, command: str, at: float | None, factor: float = 1.0) -> None:
        with self._news:
            self._asked.append((-math.inf if at is None else at, command, factor))
            self._asked.sort(key=lambda asked: asked[0])
            self._news.notify_all()

    def _next(self, time: float) -> tuple[str, float] | None:
        """Return what is due at a time [s] and was asked first."""
        with self._news:
            if self._asked and self._asked[0][0] <= time:
                return self._asked.pop(0)[1:]
            return None

    def _due(self) -> float:
        """Return when something is due next [s]."""
        with self._news:
            return self._asked[0][0] if self._asked else math.inf

    def _nap(self) -> None:
        """Wait a moment for something to be asked."""
        with self._news:
            if not self._asked:
                self._news.wait(NAP)

    def _tell(self, state: FeedState) -> None:
        with self._news:
            self._state = state
            self._news.notify_all()

    def _end(self) -> None:
        with self._news:
            self._tell(replace(self._state, state="ended"))


class Feeding:
    """A job's plan, played as a `FeedControl` asks; as it is, without one.

    Parameters
    ----------
    feed : FeedControl or None
    plan : LivePlan or None
        None without ``feed``.
    trajectory : Trajectory
        Of the machine's axes.
    mapped : callable
        Returns the plan of the motors for that of the axes.
    place : callable
        Returns line and position by axis at a time of a plan [s].

    Attributes
    ----------
    changes : list of Change
    time : float
        Machine time up to which has been played [s].
    simulated : bool
        Whether the machine's time stands still while nothing is asked of the board; set by its
        user.
    """

    def __init__(
        self,
        feed: FeedControl | None,
        plan: LivePlan | None,
        trajectory: Trajectory,
        mapped: Callable[[Trajectory], Trajectory],
        place: Callable[[Trajectory, float], tuple[int, dict[str, float]]],
    ) -> None:
        self.changes: list[Change] = []
        self._followers: list[Callable[[Trajectory, Floats], None]] = []
        self.time = 0.0
        self._feed, self._plan, self._mapped, self._place = feed, plan, mapped, place
        self._trajectory = trajectory
        self.simulated = False

    @property
    def trajectory(self) -> Trajectory:
        """The plan of the machine's axes as it is now."""
        return self._trajectory if self._plan is None else self._plan.trajectory

    @property
    def motors(self) -> Trajectory:
        """The plan of the motors as it is now."""
        return self._mapped(self.trajectory)

    def certificate(self) -> Certificate:
        """Return the certificate of the plan as it is now, which has been changed."""
        assert self._plan is not None
        return self._plan.certificate()

    def followed_by(self, follow: Callable[[Trajectory, Floats], None]) -> None:
        """Call ``follow`` with the plan and the override on its pieces where it is another one."""
        self._followers.append(follow)
        if self._plan is not None and self._plan.trajectory is not self._trajectory:
            follow(self._plan.trajectory, self._plan.override)

    def begin(self) -> None:
        """Do what was asked before the plan begins."""
        if self._feed is not None and self._plan is not None:
            _rehearse(self._plan)
            while asked := self._feed._next(0.0):
                self._carry_out(*asked, _at_begin)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._feed is not None:
            self._feed._end()

    def play(self, player: Player, until: float) -> float:
        """Play up to a time, or to the next change of the plan; return which it was [s]."""
        feed, plan = self._feed, self._plan
        if feed is None or plan is None:
            player.play(until)
            self.time = until
            return until
        while True:
            asked = feed._next(self.time)
            if asked is not None and self._carry_out(*asked, player.change):
                return self.time
            if asked is not None:
                continue
            self._tell(feed, plan)
            if self.simulated and plan.at_rest(self.time) and feed._due() == math.inf:
                feed._nap()
                continue
            portion = PORTION if self.simulated else LONGER
            end = min(until, self.time + portion, max(feed._due(), self.time))
            if end >= plan.trajectory.duration:
                end = math.inf
            player.play(end)
            self.time = end
            if end == math.inf:
                self._tell(feed, plan)
            if end >= until:
                return end

    def _carry_out(self, command: str, factor: float, change: ChangePlan) -> bool:
        """Do what was asked; return whether the plan is another one now."""
        assert self._plan is not None
        plan = self._plan
        if command == "stop":
            raise StoppedError(f"stopped on request at {max(self.time, 0.0):.3f} s")
        if command in ("hold", "resume") and plan.held == (command == "hold"):
            return False
        if command == "override" and (plan.held or factor == plan.factor):
            if factor != plan.factor:  # felt when it goes on
                plan.set_override(factor, 0.0)
                self.changes.append(Change(command, self.time, self.time, factor))
            return False
        made: list[LivePlan] = []

        def replan(time: float) -> Trajectory:
            made.append(_changed(plan, command, factor, time))
            return self._mapped(made[-1].trajectory)

        since = change(replan)
        if since is None:  # it ends too soon for that
            return False
        self._plan = changed = made[-1]
        self.changes.append(Change(command, self.time, since, changed.factor))
        for follow in self._followers:
            follow(changed.trajectory, changed.override)
        return True

    def _tell(self, feed: FeedControl, plan: LivePlan) -> None:
        state = "running"
        if plan.held:
            state = "held" if plan.at_rest(self.time) else "holding"
        time = min(self.time, plan.trajectory.duration)
        line, position = self._place(plan.trajectory, time)
        feed._tell(FeedState(state, time, plan.factor, line, position))


def _changed(plan: LivePlan, command: str, factor: float, time: float) -> LivePlan:
    """Return a plan changed at a time [s]; the given one stays as it is."""
    changed = copy(plan)
    if command == "hold":
        changed.hold(time)
    elif command == "resume":
        changed.resume(time)
    else:
        changed.set_override(factor, time)
    return changed


def _at_begin(replan: Callable[[float], Trajectory]) -> float:
    """Change a plan that is not played yet."""
    replan(0.0)
    return 0.0


def _rehearse(plan: LivePlan) -> None:
    """Compile what changes of a plan need now, and not when they are urgent."""
    compiled.always()
    middle = plan.trajectory.duration / 2
    plan = copy(plan)
    plan.hold(middle)
    plan.resume(middle + 1.0)
