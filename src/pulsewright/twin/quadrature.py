"""Quadrature decoding, four counts per line."""

from __future__ import annotations

from pulsewright.twin.kernel import kernel


@kernel
def count(a_before: int, b_before: int, a: int, b: int) -> int:
    """Return the count (-1, 0, 1) of a change of A and B; 0 where both change at once.

    A ahead of B counts up: (A, B) = 00, 10, 11, 01, 00.
    """
    if (a != a_before) == (b != b_before):
        return 0
    return 1 if (a != b) == (a != a_before) else -1
