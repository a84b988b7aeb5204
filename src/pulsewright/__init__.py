"""FPGA motion control from register map to moving machine."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from pulsewright.app.feed import FeedControl
    from pulsewright.app.run import Job
    from pulsewright.boards import open_board

__all__ = ["FeedControl", "Job", "open_board"]

_HOMES: Final = {
    "FeedControl": "pulsewright.app.feed",
    "Job": "pulsewright.app.run",
    "open_board": "pulsewright.boards",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: ``import pulsewright`` costs nothing."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pulsewright' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
