"""Pin changes at clock cycles: the one currency of equality between twin, gateware and hardware.

A change at cycle n means: the pin has its new level right after rising clock edge n. Recordings of
the original controllers use the same convention.
"""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.errors import UsageError

FORMAT: Final = "pulsewright-trace-2"  # written and described in edges/writer.py
ESCAPE: Final = 0xFFFFFFFF  # in a file: that many cycles without a change


@dataclass(frozen=True, eq=False)
class EdgeTrace:
    """All level changes of some pins from cycle ``start`` up to, not including, cycle ``end``.

    Parameters
    ----------
    clock_hz : int
        Clock of the board; one cycle lasts ``1 / clock_hz`` [s].
    pins : tuple of str
        Pin names, as in the gateware: ``step0``, ``dir0``, ``out3``.
    initial : (pins,) uint8
        Level of each pin just before ``start``.
    cycles : tuple of (n,) int64, one per pin
        Cycles of the changes, strictly increasing, all in ``start <= cycle < end``. The level
        toggles at each.
    start, end : int
        First cycle recorded, and the first one no longer recorded.
    """

    clock_hz: int
    pins: tuple[str, ...]
    initial: NDArray[np.uint8]
    cycles: tuple[NDArray[np.int64], ...]
    start: int
    end: int
    _index: dict[str, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not len(self.pins) == len(self.initial) == len(self.cycles):
            raise UsageError(
                f"a trace needs one initial level and one array of cycles per pin, not "
                f"{len(self.initial)} and {len(self.cycles)} for {len(self.pins)} pins"
            )
        object.__setattr__(self, "_index", {pin: i for i, pin in enumerate(self.pins)})

    def __eq__(self, other: object) -> bool:
        """Tell whether both traces record the same changes over the same cycles."""
        return (
            isinstance(other, EdgeTrace)
            and (self.clock_hz, self.pins, self.start, self.end)
            == (other.clock_hz, other.pins, other.start, other.end)
            and bool(np.array_equal(self.initial, other.initial))
            and all(np.array_equal(a, b) for a, b in zip(self.cycles, other.cycles, strict=True))
        )

    __hash__ = None  # type: ignore[assignment]  # holds arrays

    def __getitem__(self, pin: str) -> NDArray[np.int64]:
        """Return the cycles at which ``pin`` changes."""
        return self.cycles[self._index[pin]]

    def level_at_start(self, pin: str) -> int:
        """Return the level of ``pin`` just before the first recorded cycle."""
        return int(self.initial[self._index[pin]])

    def edges(self, pin: str, level: int) -> NDArray[np.int64]:
        """Return the cycles at which ``pin`` changes to ``level`` (0 or 1)."""
        return self[pin][int(self.level_at_start(pin) == level) :: 2]

    def final(self) -> NDArray[np.uint8]:
        """Return the level of each pin after the last change, shape (pins,)."""
        toggles = np.array([len(c) & 1 for c in self.cycles], dtype=np.uint8)
        return np.asarray(self.initial ^ toggles, dtype=np.uint8)

    def events(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.uint8]]:
        """Return all changes as (cycle, pin index, level), by cycle and then by pin."""
        cycle = np.concatenate([*self.cycles, np.zeros(0, np.int64)])
        pin = np.repeat(np.arange(len(self.pins)), [len(c) for c in self.cycles])
        level = np.concatenate(
            [
                (np.arange(1, len(c) + 1) + int(first)) & 1
                for c, first in zip(self.cycles, self.initial, strict=True)
            ]
            + [np.zeros(0, np.int64)]
        ).astype(np.uint8)
        order = np.argsort(cycle, kind="stable")
        return cycle[order], pin[order], level[order]

    def first_difference(self, other: EdgeTrace) -> str | None:
        """Say in words where two traces of the same pins first differ; None if they do not."""
        if (self.clock_hz, self.pins) != (other.clock_hz, other.pins):
            return f"different pins or clocks: {self.pins} and {other.pins}"
        worst: tuple[int, str] | None = None
        for i, pin in enumerate(self.pins):
            a, b = self.cycles[i], other.cycles[i]
            if self.initial[i] != other.initial[i]:
                return f"{pin} starts at level {self.initial[i]} and {other.initial[i]}"
            n = min(len(a), len(b))
            unequal = np.flatnonzero(a[:n] != b[:n])
            k = int(unequal[0]) if len(unequal) else n
            if k == len(a) == len(b):
                continue
            ours, theirs = (f"at cycle {c[k]}" if k < len(c) else "never" for c in (a, b))
            cycle = min(int(c[k]) for c in (a, b) if k < len(c))
            if worst is None or cycle < worst[0]:
                worst = cycle, f"change {k} of {pin} happens {ours} and {theirs}"
        if worst is None and (self.start, self.end) != (other.start, other.end):
            return f"recorded cycles {self.start}..{self.end} and {other.start}..{other.end}"
        return worst[1] if worst else None

    def require_after(self, before: EdgeTrace) -> None:
        """Check that this trace starts where ``before`` ends, with the same pins and levels.

        Raises
        ------
        UsageError
            Saying what differs.
        """
        if self.pins != before.pins:
            changed = sorted(set(self.pins) ^ set(before.pins))
            raise UsageError(
                f"traces do not follow each other: pins {', '.join(self.pins)} after "
                f"{', '.join(before.pins)} (differing: {', '.join(changed) or 'their order'})"
            )
        if (self.clock_hz, self.start) != (before.clock_hz, before.end):
            raise UsageError(
                f"traces do not follow each other: one ends at cycle {before.end} of "
                f"{before.clock_hz} Hz, the next starts at {self.start} of {self.clock_hz} Hz"
            )
        jumped = np.flatnonzero(self.initial != before.final())
        if len(jumped):
            raise UsageError(
                f"traces do not follow each other: between them, at cycle {self.start}, "
                f"{', '.join(self.pins[i] for i in jumped)} changes unrecorded"
            )

    def save(self, path: Path | str) -> None:
        """Write the trace to a compressed ``.npz`` that `load` and plain numpy read."""
        from pulsewright.edges.writer import TraceWriter

        with TraceWriter(path, self.clock_hz, self.pins, self.initial, self.start) as writer:
            writer.append(self)

    @classmethod
    def load(cls, path: Path | str) -> EdgeTrace:
        """Read a trace written by `save` or by `TraceWriter`.

        Raises
        ------
        UsageError
            If the file is missing or is not a trace.
        """
        try:
            with np.load(path, allow_pickle=False) as data:
                if str(data["format"]) != FORMAT:
                    raise UsageError(f"{path}: format {data['format']}, expected {FORMAT}")
                pins = tuple(str(pin) for pin in data["pins"])
                start, end = (int(n) for n in data["span"])
                deltas = [data[f"deltas_{pin}"] for pin in pins]
                cycles = tuple(
                    (start + np.cumsum(delta, dtype=np.int64))[delta != ESCAPE] for delta in deltas
                )
                return cls(int(data["clock_hz"]), pins, data["initial"], cycles, start, end)
        except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
            if isinstance(error, UsageError):
                raise
            raise UsageError(f"{path}: not a trace of pin changes ({error})") from error


def concatenate(traces: Sequence[EdgeTrace]) -> EdgeTrace:
    """Join traces of the same pins, each starting in the cycle where the one before it ends."""
    first = traces[0]
    for before, after in pairwise(traces):
        after.require_after(before)
    cycles = tuple(
        np.concatenate([trace.cycles[i] for trace in traces]) for i in range(len(first.pins))
    )
    return EdgeTrace(first.clock_hz, first.pins, first.initial, cycles, first.start, traces[-1].end)
