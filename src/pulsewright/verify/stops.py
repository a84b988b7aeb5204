"""Counts wherever the plan is at rest: steps lost or too many."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.verify.reference import FAR, Floats, Ints, Reference
from pulsewright.verify.verdict import Check

AT_REST: Final = 1e-4  # slower than this the plan stands still [mm/s, degrees/s]


class StopCheck:
    """Counts in intervals of time, most of them standstills of the plan.

    Attributes
    ----------
    window : (w, 2) int64
        First and last cycle of each, by first cycle. The first one is all time before the plan,
        the last one all time after it.
    seen : (motors, w, 2) int64
        Lowest and highest count in each, filled by `kernels.follow`; (high, low) before.
    """

    def __init__(self, reference: Reference) -> None:
        self._reference = reference
        self._intervals()

    def follow(self) -> None:
        """Take in another plan; of intervals that begin as before, what was seen stays."""
        window, seen = self.window, self.seen
        self._intervals()
        same = min(len(window), len(self.window)) - 1  # the last one is all time after the end
        same = int(np.argmin(np.append(window[:same, 0] == self.window[:same, 0], False)))
        self.seen[:, :same] = seen[:, :same]

    def _intervals(self) -> None:
        """Find the standstills."""
        reference = self._reference
        plan, tolerances = reference.plan, reference.tolerances
        law, start = plan.law, plan.start
        rest = (law[:, 1:] == 0).sum(axis=1) == 3
        tau = np.diff(start)
        slow_end = np.abs(law[:, 1] + (2 * law[:, 2] + 3 * law[:, 3] * tau) * tau) < AT_REST
        slow_start = np.abs(law[:, 1]) < AT_REST
        border = np.diff(np.concatenate([[False], rest, [False]]).astype(np.int8))
        turning = np.flatnonzero(slow_end[:-1] & slow_start[1:] & ~rest[:-1] & ~rest[1:]) + 1
        begin = start[np.concatenate([np.flatnonzero(border == 1), turning])]
        end = start[np.concatenate([np.flatnonzero(border == -1), turning])]
        settle = tolerances.settle
        # a board that is told rates at times may leave a rest by rounding as early as it reaches it
        exact = end - begin >= 2 * settle
        first = np.where(exact, begin + settle, begin - settle)
        last = np.where(exact, end - settle, end + settle)
        order = np.argsort(first, kind="stable")
        self._exact = np.concatenate([[True], exact[order], [True]])
        self._time = np.concatenate([[0.0], begin[order], [plan.duration]])
        w = len(self._time)
        self.window = np.empty((w, 2), np.int64)
        self.window[1:-1, 0] = reference.start + np.ceil(first[order] * reference.clock)
        self.window[1:-1, 1] = reference.start + np.floor(last[order] * reference.clock)
        self.window[0] = -FAR, reference.start - 1
        self.window[-1] = math.ceil(reference.cycle(plan.duration + settle)), FAR
        self._target = np.ascontiguousarray(reference.motors_at(self._time).T)  # (motors, w)
        self.seen = np.empty((len(reference.motors), w, 2), np.int64)
        self.seen[:, :, 0], self.seen[:, :, 1] = FAR, -FAR

    def _wrong(self, count: NDArray[Any], target: NDArray[Any]) -> Ints:
        """Return how many steps counts are away from the nearest allowed one, with sign."""
        off = np.asarray(count - target, float)
        beyond = np.ceil(np.abs(off) - 0.5 - self._reference.tolerances.tie)
        wrong: Ints = (np.sign(off) * np.maximum(beyond, 0)).astype(np.int64)
        return wrong

    def _held(self) -> Ints:
        """Return per motor and window the count furthest from its target, (motors, w)."""
        target = self._target
        low, high = self.seen[:, :, 0], self.seen[:, :, 1]
        worse = np.where(np.abs(low - target) > np.abs(high - target), low, high)
        return np.where(low <= high, worse, np.round(target).astype(np.int64))

    def lost(self) -> Ints:
        """Return per motor and window the steps lost (positive) or too many (negative) on the way.

        They are counted in the direction from one standstill to the next. What is wrong already
        at the standstill before is not counted again.
        """
        wrong = np.where(self._exact, self._wrong(self._held(), self._target), 0)
        result = np.zeros_like(wrong)
        exact = np.flatnonzero(self._exact)
        came = np.diff(self._target[:, exact], prepend=self._target[:, :1])
        more = np.diff(wrong[:, exact], prepend=0)
        result[:, exact] = np.where(came < -0.5, more, -more)
        return result

    def checks(self) -> list[Check]:
        """Return the checks of standstills, of stops of an instant, and of the end."""
        reference, settle = self._reference, self._reference.tolerances.settle
        recorded = np.asarray((self.seen[:, :, 0] <= self.seen[:, :, 1]).all(axis=0))  # (w,)
        held = self._held()
        wrong = np.abs(self._wrong(held, self._target))  # (motors, w)
        last = np.arange(len(recorded)) == len(recorded) - 1
        standing = self._exact & ~last & recorded
        target = np.round(self._target)
        passed = recorded & ~self._exact
        nearest = np.where(passed, np.clip(target, self.seen[:, :, 0], self.seen[:, :, 1]), target)
        approach = np.abs(nearest - self._target)
        rule = f"from {settle * 1e3:g} ms after coming to rest"
        stops = int((self._exact & ~last).sum()) - 1
        return [
            self._exact_check(
                "stops",
                "at standstills",
                wrong,
                held,
                standing,
                f"standstills: {stops}, {rule} to as long before moving on; and the time before "
                f"the program",
            ),
            self._turn_check(approach, passed),
            self._exact_check(
                "end",
                "at the program's end",
                wrong,
                held,
                last & recorded,
                f"{rule}; final counts "
                + ", ".join(
                    f"{motor.step} {count}"
                    for motor, count in zip(reference.motors, held[:, -1].tolist(), strict=True)
                )
                if recorded[-1]
                else "the recording stops before the end",
            ),
        ]

    def _exact_check(
        self,
        name: str,
        title: str,
        wrong: Ints,
        held: Ints,
        which: NDArray[np.bool_],
        detail: str,
    ) -> Check:
        reference = self._reference
        bad = np.flatnonzero(which & (wrong.max(axis=0) > 0))
        place: dict[str, Any] = {}
        if len(bad):
            stop = int(bad[0])
            motor = int(np.argmax(wrong[:, stop]))
            detail = (
                f"{self._words(motor, stop)}: counted {held[motor, stop]}, planned "
                f"{self._target[motor, stop]:.3f}; first of {len(bad)} wrong; " + detail
            )
            place = reference.place(reference.cycle(self._time[stop]))
            place["where"] = reference.motors[motor].step
        worst = float(wrong[:, which].max()) if which.any() else None
        return Check(
            name,
            f"steps lost or too many {title}",
            "step",
            worst,
            0.0,
            "most",
            worst == 0,
            detail=detail,
            **place,
        )

    def _words(self, motor: int, stop: int) -> str:
        lost = int(self.lost()[motor, : stop + 1].sum())
        return f"{lost} lost" if lost > 0 else f"{-lost} too many"

    def _turn_check(self, approach: Floats, which: NDArray[np.bool_]) -> Check:
        reference, tolerances = self._reference, self._reference.tolerances
        worst: float | None = None
        place: dict[str, Any] = {}
        if which.any():
            shown = np.where(which, approach, -1.0)
            motor, stop = divmod(int(np.argmax(shown)), shown.shape[1])
            worst = float(shown[motor, stop])
            place = reference.place(reference.cycle(self._time[stop]))
            place["where"] = reference.motors[motor].step
        return Check(
            "turns",
            "closest count to stops of an instant",
            "step",
            worst,
            tolerances.passing,
            "most",
            worst is None or worst <= tolerances.passing,
            detail=f"{int(which.sum())} stops where the plan rests for less than "
            f"{2 * tolerances.settle * 1e3:g} ms, each approached within that time",
            **place,
        )
