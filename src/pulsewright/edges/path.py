"""Positions from step edges: what the motors did, told by the pins alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError


@dataclass(frozen=True)
class MotorPins:
    """The two pins of one motor's drive.

    Parameters
    ----------
    step, direction : str
        Pin names.
    active : int
        Level that ``step`` takes at the edge on which the drive steps (0 or 1).
    positive : int
        Level of ``direction`` that counts upwards (0 or 1).
    """

    step: str
    direction: str
    active: int = 1
    positive: int = 1


def numbered_pins(
    motors: int, positive: int = 1, step: str = "step{}", direction: str = "dir{}"
) -> tuple[MotorPins, ...]:
    """Return the pins step0, dir0, step1, dir1, ... of motors from 0 on.

    ``positive`` is the level of the direction pins that counts upwards; ``step`` and ``direction``
    are what a board calls its pins.
    """
    return tuple(
        MotorPins(step.format(i), direction.format(i), positive=positive) for i in range(motors)
    )


def require_pins(trace: EdgeTrace, motors: Sequence[MotorPins]) -> None:
    """Check that a trace has the pins of every motor, and no pin serves twice.

    Raises
    ------
    UsageError
        Naming the missing or doubled pins and those that there are.
    """
    wanted = [pin for motor in motors for pin in (motor.step, motor.direction)]
    missing = sorted(set(wanted) - set(trace.pins))
    if missing:
        raise UsageError(
            f"the trace has no pin {', '.join(missing)}; it has {', '.join(trace.pins) or 'none'}"
        )
    doubled = sorted({pin for pin in wanted if wanted.count(pin) > 1})
    if doubled:
        raise UsageError(f"pin {', '.join(doubled)} is given to more than one motor")


def step_signs(trace: EdgeTrace, motor: MotorPins) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the active step edges of one motor and the sign of each step, both (n,).

    A direction that changes in the very cycle of a step edge counts with its new level: the
    pins change together, and `TimingMeter` reports a setup time of 0.
    """
    cycles = trace.edges(motor.step, motor.active)
    changes = np.searchsorted(trace[motor.direction], cycles, side="right")
    level = (changes & 1) ^ trace.level_at_start(motor.direction)
    return cycles, np.where(level == motor.positive, 1, -1).astype(np.int64)


class StepCounter:
    """Position of every motor over a recording that arrives in chunks, each where one ended.

    Parameters
    ----------
    motors : sequence of MotorPins
    origin : (motors,) int64, optional
        Positions before the first chunk [step]; 0 if not given.

    Examples
    --------
    >>> counter = StepCounter(numbered_pins(4))
    >>> for chunk in recording:
    ...     for cycles, counts in counter.feed(chunk):
    ...         ...
    >>> counter.counts  # position now [step]
    """

    def __init__(
        self, motors: Sequence[MotorPins], origin: NDArray[np.int64] | None = None
    ) -> None:
        self.motors = tuple(motors)
        self.counts = np.zeros(len(self.motors), np.int64)
        if origin is not None:
            self.counts += origin

    def feed(self, chunk: EdgeTrace) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Return per motor the cycles of its steps and its position after each of them [step]."""
        require_pins(chunk, self.motors)
        result = []
        for i, motor in enumerate(self.motors):
            cycles, signs = step_signs(chunk, motor)
            counts = self.counts[i] + np.cumsum(signs)
            if len(counts):
                self.counts[i] = counts[-1]
            result.append((cycles, counts))
        return result


def positions_at(
    trace: EdgeTrace,
    motors: Sequence[MotorPins],
    cycles: NDArray[np.int64],
    origin: NDArray[np.int64] | None = None,
) -> NDArray[np.int64]:
    """Return the positions right after each of ``cycles`` (n,), shape (n, motors) [step]."""
    counter = StepCounter(motors, origin)
    first = counter.counts.copy()
    result = np.empty((len(cycles), len(counter.motors)), np.int64)
    for i, (edges, counts) in enumerate(counter.feed(trace)):
        passed = np.searchsorted(edges, cycles, side="right")
        result[:, i] = np.concatenate([first[i : i + 1], counts])[passed]
    return result
