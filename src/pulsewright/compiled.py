"""Kernels: functions of numbers and arrays that numba compiles, where that pays.

Numba, and what it keeps on disk (see `pulsewright.jit`), is loaded when a kernel is first needed
compiled. That takes longer than the plan of a short program takes in Python, so within `uncompiled`
kernels are run as they are written. Plans are the same to the last bit, as long as kernels write
squares as products: Python does not always round its powers like products.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cached_property
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any, Final, TypeVar, cast

import numpy as np

F = TypeVar("F", bound=Callable[..., Any])

FEW: Final = 100  # moves that Python is done with before compiled kernels would be loaded

watchers: Final[list[Callable[[Kernel], None]]] = []  # told of kernels that are needed

_in_python: ContextVar[bool | None] = ContextVar("in_python", default=None)
_seen = SimpleNamespace(moves=0.0)  # in this process, towards `FEW`
_namespaces: dict[int, dict[str, Any]] = {}  # of modules, by the identity of their own ones


class Kernel:
    """A function that is compiled when it is first called, or when a kernel that calls it is."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self._function, self._options = function, options

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Return what the function does."""
        function = self._uncompiled if _in_python.get() else self.dispatcher
        return function(*args, **kwargs)

    @cached_property
    def dispatcher(self) -> Any:
        """What numba makes of it."""
        for told in watchers:
            told(self)
        return self._made

    @cached_property
    def _made(self) -> Any:
        from pulsewright import jit

        return jit.dispatcher(self._function, **self._options)

    def kept(self) -> bool:
        """Return whether it is kept on disk as it is, compiled for arguments of some type."""
        file = getattr(getattr(self._made, "_cache", None), "_cache_file", None)
        return file is not None and bool(file._load_index())

    @property
    def _numba_type_(self) -> Any:  # what numba asks of a global that a kernel uses
        return self.dispatcher._numba_type_

    @cached_property
    def _uncompiled(self) -> Callable[..., Any]:
        """The function, with arithmetic that gives infinity or NaN where Python has errors."""
        f = self._function
        known = f.__globals__
        names = _namespaces.setdefault(id(known), known | {"math": _MATH})
        return FunctionType(f.__code__, names, f.__name__, f.__defaults__, f.__closure__)


def compiled(*, allocates: bool = True, **options: Any) -> Callable[[F], F]:
    """Return a decorator for kernels.

    Parameters
    ----------
    allocates : bool
        Whether the kernel makes arrays. One that does not, and is told so, counts no references to
        those it is given, which costs more than a short function does by itself.
    **options
        Of `numba.njit`.
    """
    if not allocates:
        options["_nrt"] = False  # of numba's own, whose version is pinned

    def decorate(function: F) -> F:
        return cast(F, Kernel(function, options))

    return decorate


#: For kernels that only kernels call: what Python needs to call one takes longest to compile.
inner = compiled(
    allocates=False, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True
)

#: The same for those that make arrays.
making = compiled(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)

#: As `inner`, for those called so often that handing over all words of all arrays takes long: they
#: become part of what calls them.
inlined = compiled(
    allocates=False,
    error_model="numpy",
    no_cpython_wrapper=True,
    no_cfunc_wrapper=True,
    forceinline=True,
)


@contextmanager
def uncompiled(moves: int) -> Iterator[None]:
    """Run kernels in Python during a ``with`` block that plans or checks some moves, if few.

    That is as long as there were no more than `FEW` in the process: those that come later, or that
    are many, pay for loading compiled kernels, or for compiling them. What must not wait for that
    says 0 moves. A block in another one does as that does.
    """
    if _in_python.get() is not None:
        yield
        return
    _seen.moves += moves
    token = _in_python.set(_seen.moves <= FEW)
    try:
        with np.errstate(all="ignore"):  # as numba does
            yield
    finally:
        _in_python.reset(token)


def always() -> None:
    """Compile, or load, kernels from now on in this process however few the moves are."""
    _seen.moves = math.inf


def kept(module: ModuleType) -> bool:
    """Return whether kernels of a module are kept that it could use now."""
    kernels = [k for k in vars(module).values() if isinstance(k, Kernel)]
    return any(k.kept() for k in kernels if k.__module__ == module.__name__)


def _ieee(function: Callable[..., float]) -> Callable[..., np.float64]:
    """Return a function of `math` without errors; its results are divided without errors, too."""

    def value(*x: float) -> np.float64:
        try:
            return np.float64(function(*x))
        except ValueError:
            return np.float64(math.nan)

    return value


_MATH: Final = SimpleNamespace(
    **vars(math)
    | {name: _ieee(getattr(math, name)) for name in ("sin", "cos", "atan2")}
    | {"sqrt": np.sqrt, "hypot": np.hypot}
)
