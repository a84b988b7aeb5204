"""Counting without a carry chain.

A LUT that is part of a carry chain has no input left for the multiplexer in front of a register.
For counters of a few bits plain logic is smaller.
"""

from __future__ import annotations

from amaranth import Cat, Const, Value


def increment(value: Value) -> Value:
    """Return ``value + 1`` modulo ``2**len(value)``."""
    return value ^ Cat(Const(1, 1), *(value[:n].all() for n in range(1, len(value))))


def decrement(value: Value) -> Value:
    """Return ``value - 1`` modulo ``2**len(value)``."""
    return value ^ Cat(Const(1, 1), *(~value[:n].any() for n in range(1, len(value))))
