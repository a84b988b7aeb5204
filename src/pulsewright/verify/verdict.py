"""What the verifier found, in plain values that a report or a program can use."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Check:
    """One claim, what was measured, and where it was worst.

    Parameters
    ----------
    name : str
        Short and stable, for programs: ``following``, ``acceleration:X``.
    title : str
        For people.
    unit : str
    worst : float or None
        What was measured where the margin is least; None if there was nothing to measure.
    bound : float
        What is allowed at that place.
    limit : str
        ``most``: ``worst`` must not exceed ``bound``; ``least``: must not fall below it.
    passed : bool
    time : float or None
        Where, in the time of the plan [s].
    line : int or None
        Line of the program.
    where : str
        Motor or axis.
    position : tuple of float or None
        X, Y, Z there [mm].
    detail : str
        How the bound is made up, and what else is worth knowing.
    """

    name: str
    title: str
    unit: str
    worst: float | None
    bound: float
    limit: Literal["most", "least"]
    passed: bool
    time: float | None = None
    line: int | None = None
    where: str = ""
    position: tuple[float, float, float] | None = None
    detail: str = ""


@dataclass(frozen=True)
class MotorSummary:
    """What one motor did.

    Parameters
    ----------
    name : str
    steps : int
        Active step edges in all.
    forward, backward : int
        Of these, with positive and with negative direction.
    start, end : int
        Position before the recording and after it [step].
    planned_end : float
        Position at the end of the plan, not rounded [step].
    lost : int
        Steps lost (positive) or too many (negative) from standstill to standstill, in all, in the
        direction of motion.
    deviation : float
        Largest following deviation, with its sign [step].
    """

    name: str
    steps: int
    forward: int
    backward: int
    start: int
    end: int
    planned_end: float
    lost: int
    deviation: float


@dataclass(frozen=True, eq=False)
class PathSample:
    """The run at evenly spaced times, for pictures: n points, a bounded number.

    Parameters
    ----------
    time : (n,) float64
        Time of the plan [s].
    position : (n, 6) float64
        Tool, rebuilt from the step edges [mm, degrees].
    speed, acceleration : (n,) float64
        Of X, Y, Z, by differences over ``speed_window`` and ``acceleration_window``
        [mm/s, mm/s^2]; the largest between this point and the next.
    rapid : (n,) bool
        The plan is in a traverse (G0).
    line : (n,) int32
        Line of the program.
    deviation : (n, motors) float64
        Largest following deviation between this point and the next [step].
    distance : (n,) float64
        Largest distance from the programmed path between this point and the next [mm].
    speed_window, acceleration_window : float
        [s]
    """

    time: NDArray[np.float64]
    position: NDArray[np.float64]
    speed: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    rapid: NDArray[np.bool_]
    line: NDArray[np.int32]
    deviation: NDArray[np.float64]
    distance: NDArray[np.float64]
    speed_window: float
    acceleration_window: float


@dataclass(frozen=True)
class Verdict:
    """The verifier's result.

    Parameters
    ----------
    passed : bool
        Every check passed.
    checks : tuple of Check
    motors : tuple of MotorSummary
    edges : int
        Level changes seen on all pins.
    steps : int
        Active step edges of all motors.
    duration : float
        Planned [s].
    recorded : float
        Length of the recording [s].
    sample : PathSample
    histogram : dict
        ``edges`` (b + 1,) [step] and ``counts`` (b,) of following deviations just before and just
        after each step, all motors together; the outer bins hold everything further out.
    """

    passed: bool
    checks: tuple[Check, ...]
    motors: tuple[MotorSummary, ...]
    edges: int
    steps: int
    duration: float
    recorded: float
    sample: PathSample = field(repr=False)
    histogram: dict[str, list[float]] = field(repr=False)

    @property
    def failed(self) -> tuple[Check, ...]:
        """The checks that did not pass."""
        return tuple(check for check in self.checks if not check.passed)

    def __getitem__(self, name: str) -> Check:
        """Return the check called ``name``."""
        for check in self.checks:
            if check.name == name:
                return check
        raise KeyError(f"no check {name!r}; there are {', '.join(c.name for c in self.checks)}")

    def to_json(self) -> dict[str, Any]:
        """Return everything but the path sample in types that `json.dumps` takes."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self) if f.name != "sample"}


def plain(value: Any) -> Any:
    """Return ``value`` made of dicts, lists, strings, finite numbers, booleans and None."""
    if isinstance(value, Check | MotorSummary):
        return plain(asdict(value))
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None  # JSON knows no infinity
    return value
