"""What is looked at while a plan is played: encoders, limit switches, positions of the board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pulsewright.errors import FollowingError, LimitSwitchError, UsageError


@dataclass(frozen=True)
class Feedback:
    """Encoders of the motors, where the board counts them.

    Parameters
    ----------
    counts_per_step : sequence of float
        Of encoder i, which is on motor i; the first motors, not more than there are encoders.
    following_error : float
        So far a motor may be from where it is commanded to be, at rest [step].
    """

    counts_per_step: Sequence[float]
    following_error: float = 2.0


@dataclass(frozen=True)
class LimitSwitches:
    """Switches at the ends of travel, on digital inputs of the board.

    Parameters
    ----------
    inputs : sequence of int
        Numbers of the inputs.
    active : int
        Their level while a switch is hit: 1 for normally closed ones against a pull-up.
    """

    inputs: Sequence[int]
    active: int = 1


def check_switches(driver: Any, switches: LimitSwitches) -> None:
    """Check that no limit switch is hit.

    Raises
    ------
    LimitSwitchError
        If one is.
    """
    levels = driver.read_inputs()
    hit = [number for number in switches.inputs if levels >> number & 1 == switches.active]
    if hit:
        raise LimitSwitchError(
            f"{driver.registers.board}: the limit switch at input {hit[0]} is hit; drive off it "
            f"slowly, and reference the machine again"
        )


def check_positions(
    board: str, off: NDArray[np.float64], bounds: NDArray[np.float64], cause: str
) -> None:
    """Check that motors are where they were commanded to be.

    Parameters
    ----------
    board : str
        Its name, for errors.
    off, bounds : (motors,) float
        Actual minus commanded position, and its largest magnitude [step].
    cause : str
        The likely one, if not.

    Raises
    ------
    FollowingError
        If one is not.
    """
    wrong = np.flatnonzero(np.abs(off) > bounds)
    if len(wrong):
        motor = int(wrong[0])
        raise FollowingError(
            f"{board} motor {motor}: is {off[motor]:+.1f} steps from where it was commanded to be, "
            f"allowed are {bounds[motor]:.1f}; {cause}. Look for the cause, and reference the "
            f"machine again"
        )


def require_inputs(board: str, switches: LimitSwitches | None, inputs: int) -> None:
    """Check that a board has the inputs of limit switches.

    Raises
    ------
    UsageError
        If not.
    """
    if switches is None:
        return
    if not inputs:
        raise UsageError(
            f"{board}: it has no digital inputs for limit switches; let them act on the drives"
        )
    wrong = [number for number in switches.inputs if not 0 <= number < inputs]
    if wrong:
        raise UsageError(
            f"{board}: no input {wrong[0]} for a limit switch; allowed are 0..{inputs - 1}"
        )


def require_encoders(board: str, feedback: Feedback | None, encoders: int) -> None:
    """Check that a board counts the encoders of the motors.

    Raises
    ------
    UsageError
        If not.
    """
    if feedback is None:
        return
    if len(feedback.counts_per_step) > encoders:
        raise UsageError(
            f"{board}: {len(feedback.counts_per_step)} encoders given, it has {encoders or 'none'}"
        )
    if not all(feedback.counts_per_step):
        raise UsageError(f"{board}: an encoder with 0 counts per step given")
