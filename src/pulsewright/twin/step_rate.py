"""Step rate generator: a counter that asks for a step when it reaches its period.

Counting 0 .. period - 1 makes a step due at the last tick of the period. The comparison is by
magnitude, so a counter beyond a new, shorter period is due at once. A step that cannot start yet
holds the counter.
"""

from __future__ import annotations

from pulsewright.twin.kernel import kernel


@kernel
def due_tick(count: int, tick: int, period: int) -> int:
    """Return the first tick at which a step is due, if ``count`` is the counter before ``tick``."""
    return tick + max(0, period - 1 - count)


@kernel
def count_before(end: int, count: int, tick: int, period: int, active: bool) -> int:
    """Return the counter before tick ``end``: ``count`` before ``tick``, and no step starts."""
    if end <= tick:
        return count
    if not active:
        return 0
    if count >= period - 1:
        return count
    return min(period - 1, count + end - tick)
