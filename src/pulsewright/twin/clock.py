"""Ticks on the integer time line of a board.

A divided clock ticks at cycles ``origin``, ``origin + period``, ...: tick k is the edge at cycle
``origin + k * period``. ``origin`` is the first edge after reset.
"""

from __future__ import annotations

from typing import Final

from pulsewright.twin.kernel import inlined

NEVER: Final = 1 << 62  # a cycle that does not come


@inlined
def ticks_through(cycle: int, origin: int, period: int) -> int:
    """Count the ticks at cycles up to and including ``cycle``; 0 before ``origin``.

    This is also the number of the first tick after ``cycle``.
    """
    return (cycle - origin) // period + 1 if cycle >= origin else 0


@inlined
def tick_cycle(tick: int, origin: int, period: int) -> int:
    """Return the cycle of a tick."""
    return origin + tick * period
