"""Numbers of device requests, as Linux makes them on x86, ARM and RISC-V."""

from __future__ import annotations


def plain(kind: str, number: int) -> int:
    """Return the number of a request without an argument."""
    return ord(kind) << 8 | number


def to_device(kind: str, number: int, size: int) -> int:
    """Return the number of a request that hands ``size`` bytes to a driver."""
    return 1 << 30 | size << 16 | plain(kind, number)


def from_device(kind: str, number: int, size: int) -> int:
    """Return the number of a request that fetches ``size`` bytes from a driver."""
    return 2 << 30 | size << 16 | plain(kind, number)
