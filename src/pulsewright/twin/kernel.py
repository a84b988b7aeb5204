"""The decorators of twin kernels.

Kernels look into arrays that their caller keeps, and make none. So they are compiled without
reference counts, which would cost several times the work of a call that passes a whole state.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])
OPTIONS: Final[dict[str, Any]] = {"cache": True, "error_model": "numpy", "_nrt": False}


def kernel(function: F) -> F:
    """Compile a kernel. Division by zero is not checked."""
    compiled: F = njit(**OPTIONS)(function)
    return compiled


def inlined(function: F) -> F:
    """Compile a short kernel into each of its callers."""
    compiled: F = njit(**OPTIONS, inline="always")(function)
    return compiled


def hot(function: F) -> F:
    """Compile a kernel of any size into its callers, sparing them to pass it a whole state."""
    compiled: F = njit(**OPTIONS, forceinline=True)(function)
    return compiled
