"""When the pulse formers make pulses, and which velocities they follow."""

from __future__ import annotations

from dataclasses import dataclass

from pulsewright.boards.s3g.registers import STEP_UNITS


@dataclass(frozen=True)
class PulseTiming:
    """Pulse timing of all channels: thresholds of the pulse formers' counter [clock].

    Parameters
    ----------
    pre : int
        From a change of direction to the rise of a step pulse, at least 1.
    pulse : int
        To the fall of the pulse; more than ``pre``.
    post : int
        To the end of what the pulse former counts.
    """

    pre: int
    pulse: int
    post: int

    @classmethod
    def of(cls, *, width: int, space: int, setup: int, hold: int) -> PulseTiming:
        """Return the shortest timing with these times between edges [clock].

        Parameters
        ----------
        width, space : int
            Time the step pin is active, and at least inactive.
        setup, hold : int
            Least time from a change of direction to a step edge, and from that to the next change.
        """
        pre = max(setup, 1)
        pulse = pre + max(width, 1)
        # the next step comes at the earliest one clock after the counter is done
        return cls(pre, pulse, max(pulse, width + space - 1, pre + hold - 1))

    @property
    def spacing(self) -> int:
        """Shortest time between two steps; one that comes earlier is lost [clock]."""
        return 1 + max(1, self.pre, self.pulse, self.post)

    @property
    def limit(self) -> int:
        """Largest velocity [unit]."""
        return STEP_UNITS // self.spacing
