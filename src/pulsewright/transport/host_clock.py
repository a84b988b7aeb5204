"""Time on links to hardware: the host's clock, in cycles of the board."""

from __future__ import annotations

import time


class HostClock:
    """Counts from its making on.

    Parameters
    ----------
    clock_hz : int
        Board clock [Hz].
    """

    def __init__(self, clock_hz: int) -> None:
        self.clock_hz = clock_hz
        self._begin = time.monotonic_ns()

    def now(self) -> int:
        """Return the present time [cycle]."""
        return (time.monotonic_ns() - self._begin) * self.clock_hz // 1_000_000_000

    def nanoseconds(self, cycle: int) -> int:
        """Return the monotonic time of the host at a cycle [ns]."""
        return self._begin + cycle * 1_000_000_000 // self.clock_hz

    def wait(self, cycle: int) -> None:
        """Sleep until a cycle; return at once if it is over."""
        ahead = self.nanoseconds(cycle) - time.monotonic_ns()
        if ahead > 0:
            time.sleep(ahead / 1e9)
