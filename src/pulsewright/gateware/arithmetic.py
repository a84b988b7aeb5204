"""Counting without a carry chain.

A LUT that is part of a carry chain has no input left for the multiplexer in front of a register.
For counters of a few bits plain logic is smaller.
"""

from __future__ import annotations

from collections.abc import Sequence

from amaranth import Cat, Const, Mux, Value


def increment(value: Value) -> Value:
    """Return ``value + 1`` modulo ``2**len(value)``."""
    return value ^ Cat(Const(1, 1), *(value[:n].all() for n in range(1, len(value))))


def decrement(value: Value) -> Value:
    """Return ``value - 1`` modulo ``2**len(value)``."""
    return value ^ Cat(Const(1, 1), *(~value[:n].any() for n in range(1, len(value))))


def choose(select: Value, choices: Sequence[Value]) -> Value:
    """Return one of four single bits, in the shape that fits two 4-input LUTs.

    While ``select`` points to the upper pair, the lower LUT passes on which of the two it is.
    """
    low, high = select[0], select[1]
    lower = Mux(high, low, Mux(low, choices[1], choices[0]))
    return Mux(high, Mux(lower, choices[3], choices[2]), lower)
