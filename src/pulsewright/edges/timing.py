"""Pulse timing as measured on the pins, against what a drive's datasheet demands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pulsewright.edges.path import MotorPins, require_pins
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError

KINDS: Final = ("width", "space", "setup", "hold", "hold_trailing")
_UNSEEN: Final = 1 << 62  # shortest time of what never happened [cycle]


@dataclass(frozen=True)
class DriveTiming:
    """Shortest times that a drive's datasheet allows [s]; 0 = no demand.

    Parameters
    ----------
    width, space : float
        Step pulse active, and inactive between two pulses.
    setup : float
        Direction stable before the active step edge.
    hold : float
        Direction stable after the active step edge.
    hold_trailing : float
        Direction stable after the pulse has ended, for drives that say so.
    """

    width: float = 0.0
    space: float = 0.0
    setup: float = 0.0
    hold: float = 0.0
    hold_trailing: float = 0.0


@dataclass(frozen=True)
class TimingResult:
    """Shortest time of one kind at one motor.

    Parameters
    ----------
    motor : int
    kind : str
        One of `KINDS`.
    measured : float or None
        Shortest time [s]; None if the pins never showed one. Negative only for
        ``hold_trailing``: the direction changed that long before the pulse ended.
    required : float
        What the drive demands [s]; 0 = nothing.
    cycle : int or None
        Cycle of the edge that ended the shortest time.
    violations : int
        How many times were too short.
    """

    motor: int
    kind: str
    measured: float | None
    required: float
    cycle: int | None
    violations: int


class TimingMeter:
    """Shortest pulse times of every motor, over chunks that follow each other.

    Parameters
    ----------
    clock_hz : int
        Unit of the cycles [Hz].
    motors : sequence of MotorPins
    drives : sequence of DriveTiming
        Demands, one per motor.
    """

    def __init__(
        self, clock_hz: int, motors: Sequence[MotorPins], drives: Sequence[DriveTiming]
    ) -> None:
        from pulsewright.edges.kernels import NEVER, STATE_SIZE

        if len(motors) != len(drives):
            raise UsageError(f"{len(motors)} motors need as many drive timings, not {len(drives)}")
        self.clock_hz = clock_hz
        self.motors = tuple(motors)
        self.drives = tuple(drives)
        shape = (len(self.motors), len(KINDS))
        # Rounded up, but a time that is a whole number of cycles must not gain one by 1e-16 s.
        self._need = np.array(
            [[math.ceil(getattr(d, k) * clock_hz - 1e-6) for k in KINDS] for d in drives], np.int64
        ).reshape(shape)
        for i, drive in enumerate(drives):
            for k, kind in enumerate(KINDS):
                if getattr(drive, kind) == 0:
                    self._need[i, k] = -_UNSEEN  # even a negative hold is no violation then
        self._state = np.full((shape[0], STATE_SIZE), NEVER, np.int64)
        self._low = np.full(shape, _UNSEEN, np.int64)
        self._at = np.zeros(shape, np.int64)
        self._below = np.zeros(shape, np.int64)

    def feed(self, chunk: EdgeTrace) -> None:
        """Measure the next chunk."""
        from pulsewright.edges.kernels import measure_timing

        require_pins(chunk, self.motors)
        for i, motor in enumerate(self.motors):
            measure_timing(
                chunk[motor.step],
                int(chunk.level_at_start(motor.step) == motor.active),
                chunk[motor.direction],
                self._need[i],
                self._state[i],
                self._low[i],
                self._at[i],
                self._below[i],
            )

    def results(self) -> list[TimingResult]:
        """Return the shortest time of every kind at every motor, by motor and then by kind."""
        return [
            TimingResult(
                i,
                kind,
                int(self._low[i, k]) / self.clock_hz if self._low[i, k] < _UNSEEN else None,
                float(getattr(drive, kind)),
                int(self._at[i, k]) if self._low[i, k] < _UNSEEN else None,
                int(self._below[i, k]),
            )
            for i, drive in enumerate(self.drives)
            for k, kind in enumerate(KINDS)
        ]

    def violations(self) -> list[TimingResult]:
        """Return the results that break the drive's demands."""
        return [result for result in self.results() if result.violations]
