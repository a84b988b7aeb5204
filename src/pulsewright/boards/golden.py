"""Recordings of original controllers: what went in, and every pin change that came out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pulsewright.edges.trace import EdgeTrace


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
