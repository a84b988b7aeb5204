"""Which velocity words the board follows without merging pulses, and in which speed range."""

from __future__ import annotations

from typing import Final

from pulsewright.boards.pluto_step import registers

MAX_VELOCITY: Final = 1024  # beyond, pulses merge whatever their width
TAPS: Final = range((registers.W_TIMING_TAP_MASK >> registers.W_TIMING_TAP_LSB) + 1)


def units_per_step(tap: int) -> int:
    """Return how many units of position make a step; a velocity of 1 is one unit per tick."""
    return registers.UNITS_PER_STEP << tap


def velocity_limit(tap: int, step_ticks: int, space_ticks: int) -> int:
    """Return the largest velocity word that keeps pulses apart.

    Parameters
    ----------
    tap : int
        0..3.
    step_ticks, space_ticks : int
        Time the step pin is active and at least inactive, both at least 1 [tick].
    """
    return min(MAX_VELOCITY, units_per_step(tap) // (step_ticks + space_ticks))


def finest_tap(rate: float, step_ticks: int, space_ticks: int) -> int | None:
    """Return the tap with the finest rates that reaches ``rate`` [step/s], or None.

    Above tap 0 it does so with one velocity word to spare, for corrections.
    """
    for tap in reversed(TAPS):
        limit = velocity_limit(tap, step_ticks, space_ticks) - (tap > 0)
        if abs(rate) <= limit * registers.TICK_HZ / units_per_step(tap):
            return tap
    return None
