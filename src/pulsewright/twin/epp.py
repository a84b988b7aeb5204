"""EPP strobe pipeline of a board that samples the bus with its own clock.

Five stages: bit i of ``stages`` is the strobe as it was i edges before the last one. The action is
at the third edge that samples the strobe active, the acknowledge follows two edges later and ends
at the fifth edge that samples it inactive.
"""

from __future__ import annotations

from typing import Final

from pulsewright.twin.kernel import inlined

ACCESS_NS: Final = 1500  # time of one access by software over a parallel port
_ALL: Final = 0b11111


@inlined
def acts(stages: int) -> bool:
    """Tell whether the next edge is an action edge."""
    return (stages & 0b110) == 0b010


@inlined
def shift(stages: int, strobe: int) -> int:
    """Return the stages after an edge that samples ``strobe`` (1 = active)."""
    return ((stages << 1) | strobe) & _ALL


@inlined
def acknowledges(stages: int) -> int:
    """Return 1 while the cycle is acknowledged and a byte read is on the bus."""
    return stages >> 4


@inlined
def settled(stages: int, strobe: int) -> bool:
    """Tell whether edges change nothing as long as ``strobe`` stays as it is."""
    return stages == (_ALL if strobe else 0)
