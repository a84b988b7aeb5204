"""The decorators of twin kernels.

Kernels look into arrays that their caller keeps, and make none. So they are compiled without
reference counts, which would cost several times the work of a call that passes a whole state.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a kernel. Division by zero is not checked."""
    compiled: F = njit(cache=True, error_model="numpy", _nrt=False)(function)
    return compiled


def inlined(function: F) -> F:
    """Compile a short kernel into each of its callers."""
    compiled: F = njit(cache=True, error_model="numpy", _nrt=False, inline="always")(function)
    return compiled
