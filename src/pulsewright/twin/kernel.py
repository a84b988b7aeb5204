"""The decorators of twin kernels.

Kernels look into arrays that their caller keeps, and make none. So they are compiled without
reference counts, which would cost several times the work of a call that passes a whole state.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar

from pulsewright.compiled import compiled

F = TypeVar("F", bound=Callable[..., Any])
OPTIONS: Final[dict[str, Any]] = {"error_model": "numpy", "allocates": False}


def kernel(function: F) -> F:
    """Compile a kernel. Division by zero is not checked."""
    return compiled(**OPTIONS)(function)


def inlined(function: F) -> F:
    """Compile a short kernel into each of its callers."""
    return compiled(**OPTIONS, inline="always")(function)


def hot(function: F) -> F:
    """Compile a kernel of any size into its callers, sparing them to pass it a whole state."""
    return compiled(**OPTIONS, forceinline=True)(function)
