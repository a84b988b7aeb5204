"""FPGA motion control from register map to moving machine."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pulsewright.boards import open_board

__all__ = ["open_board"]


def __getattr__(name: str) -> Any:
    """Import the public names when they are first used: ``import pulsewright`` costs nothing."""
    if name == "open_board":
        from pulsewright.boards import open_board

        return open_board
    raise AttributeError(f"module 'pulsewright' has no attribute '{name}'")
