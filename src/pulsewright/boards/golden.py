"""Recordings of original controllers: what went in, and every pin change that came out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError

Words = NDArray[np.int64]


@dataclass(frozen=True)
class Golden:
    """One recording, in the terms of the room: names of its pins, cycles of its clock.

    Parameters
    ----------
    name, description : str
        Of the scenario.
    cycle : (n,) int64
        First edge that samples each change of an input, never decreasing.
    pin : (n,) str
        Input pin that changes.
    level : (n,) int64
        Its new level.
    expected : EdgeTrace
        Every change of every output pin. The recording ends with the trace.
    transactions : int
        Bus transactions whose replies are among the changes.
    """

    name: str
    description: str
    cycle: NDArray[np.int64]
    pin: NDArray[np.str_]
    level: NDArray[np.int64]
    expected: EdgeTrace
    transactions: int

    def levels(self, pin: str, idle: int, at: Words) -> Words:
        """Return the levels that an input has after edges; ``idle`` before its first change."""
        mine = self.pin == pin
        level = np.concatenate([[idle], self.level[mine]])
        return level[np.searchsorted(self.cycle[mine], at, side="right")]


G = TypeVar("G", bound=Golden)


@dataclass(frozen=True)
class Recordings(Generic[G]):
    """How a room reads recordings, and what replays them.

    Parameters
    ----------
    board : str
        Its name, for errors.
    load : callable
        ``load(path)`` reads a recording.
    engines : mapping of str to callable
        ``twin``, and ``rtl``: the gateware in a simulator. Given a recording, each returns every
        change of the output pins from the same inputs.
    """

    board: str
    load: Callable[[Path | str], G]
    engines: Mapping[str, Callable[[G], EdgeTrace]]

    def replay(self, golden: G, engine: str) -> EdgeTrace:
        """Give the inputs of a recording to an engine; return every change of its output pins.

        Raises
        ------
        UsageError
            If the engine is unknown or cannot be run here.
        """
        if engine not in self.engines:
            raise UsageError(
                f"{self.board} has no engine '{engine}'; it has {', '.join(self.engines)}"
            )
        return self.engines[engine](golden)


def stimulus(
    pins: Iterable[tuple[str, Words, Words]],
) -> tuple[Words, NDArray[np.str_], Words]:
    """Return changes of inputs as columns of a `Golden`, by cycle.

    Parameters
    ----------
    pins : iterable of (str, (n,) int64, (n,) int64)
        Name of each, cycles of its changes, and levels after them.
    """
    columns = list(pins)
    cycles = np.concatenate([at for _, at, _ in columns])
    names = np.concatenate([np.full(len(at), pin) for pin, at, _ in columns])
    levels = np.concatenate([level for _, _, level in columns])
    order = np.argsort(cycles, kind="stable")
    return cycles[order], names[order], levels[order]


def changes_of_words(
    fields: Iterable[tuple[str, int, int]], at: Words, words: Words, idle: int
) -> tuple[Words, NDArray[np.str_], Words]:
    """Return changes of inputs as columns, from words that come at cycles; ``idle`` before them.

    Parameters
    ----------
    fields : iterable of (str, int, int)
        Name, lowest bit and number of bits of each pin.
    """
    before = np.concatenate([[idle], words])

    def changes(name: str, lsb: int, width: int) -> tuple[str, Words, Words]:
        value = before >> lsb & ((1 << width) - 1)
        rows = np.flatnonzero(np.diff(value))
        return name, at[rows], value[1:][rows]

    return stimulus(changes(*field) for field in fields)
