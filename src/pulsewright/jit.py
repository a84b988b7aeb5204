"""Functions compiled by numba and kept on disk, for as long as nothing that they use has changed.

Numba itself looks at the file of a kernel only. A kernel also contains what its file imports:
other kernels, and constants as they were. So the stamp of a kept kernel is made of all files of
this package that its own one reaches by imports.
"""

from __future__ import annotations

import gc
import hashlib
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Final

import numba
from numba import types
from numba.core import event
from numba.core.compiler_lock import global_compiler_lock
from numba.core.runtime.nrt import rtsys

_ROOT: Final = Path(__file__).parents[1]
# "from a.b import c, d" also in parentheses; the names may be modules
_IMPORT: Final = re.compile(r"^ *from (pulsewright[\w.]*) import (\([^)]*\)|.*)", re.MULTILINE)


def dispatcher(function: Callable[..., Any], **options: Any) -> Any:
    """Return ``numba.njit(cache=True, nogil=True, **options)`` of a function, as said above.

    Other threads go on while a kernel runs: a plan is changed while it is played. What Python
    cannot call is not kept: it is part of the kernels that call it.
    """
    keep = not options.get("no_cpython_wrapper")
    result: Any = numba.njit(cache=keep, nogil=True, **options)(function)
    if hasattr(result, "get_call_template"):  # not with NUMBA_DISABLE_JIT
        result.get_call_template = _general(result.get_call_template)
        result.compile = _vectorized(result.compile)
    if keep and hasattr(result, "_cache"):
        # numba, whose version is pinned, has no public way to say on what a kernel depends
        files: Any = result._cache._cache_file
        files._source_stamp = stamp(function.__code__.co_filename)
        files._load_index = _tolerant(files._load_index)
        files.save = _apart(files)
        result._cache.load_overload = _lean(result._cache)
    return result


class _Unhindered(event.Listener):
    """No collection of garbage while kernels are compiled: that takes a quarter longer."""

    def __init__(self) -> None:
        self._depth, self._collects = 0, False

    def on_start(self, event: Any) -> None:
        if self._depth == 0:
            self._collects = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0 and self._collects:
            gc.enable()


event.register("numba:compile", _Unhindered())  # type: ignore[no-untyped-call]


def _general(template: Callable[..., Any]) -> Callable[..., Any]:
    """Return ``template`` such that calls with constants take the kernel for any value.

    Otherwise each constant in a call compiles the kernel, and all that it calls, once more; even
    the first value of a variable does, while its type is being found.
    """
    any_value: Callable[[Any], Any] = types.unliteral

    def general(args: Any, kws: Any) -> Any:
        free = {name: any_value(kind) for name, kind in dict(kws).items()}
        return template(tuple(map(any_value, args)), free)

    return general


def _vectorized(compile_: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return ``compile_`` such that sums and products side by side become those of vectors.

    What they are does not change. Numba does so by a setting for all that is compiled, off unless
    the user turns it on; here it is on as long as one of our kernels is being compiled.
    """

    def vectorized(signature: Any) -> Any:
        settings: Any = numba.config
        with global_compiler_lock:  # else two threads could leave it on
            before, settings.SLP_VECTORIZE = settings.SLP_VECTORIZE, 1
            try:
                return compile_(signature)
            finally:
                settings.SLP_VECTORIZE = before

    return vectorized


def _apart(files: Any) -> Callable[[Any, Any], None]:
    """Return a ``save`` that processes may call at the same time.

    Numba's own numbers files in the order in which it saves them: two processes, with other types
    of arguments each, could take the same number, and one would be given the code of the other.
    """

    def save(key: Any, data: Any) -> None:
        number = hashlib.sha256(repr(key).encode()).digest()[:8]
        name = files._data_name(int.from_bytes(number, "big"))
        files._save_data(name, data)
        files._save_index(files._load_index() | {key: name})

    return save


def _lean(cache: Any) -> Callable[[Any, Any], Any]:
    """Return a ``load_overload`` of ``cache`` that does not load what only compiling needs.

    That takes numba as long as its import. Where nothing is kept, compiling itself loads it.
    """

    def load_overload(signature: Any, target: Any) -> Any:
        rtsys.initialize(target)
        with cache._guard_against_spurious_io_errors():
            return cache._load_overload(signature, target)

    return load_overload


def _tolerant(load_index: Callable[[], Any]) -> Callable[[], Any]:
    """Return ``load_index`` such that an index with types that are gone counts as outdated."""

    def load() -> Any:
        try:
            return load_index()
        except (AttributeError, ImportError):
            return {}

    return load


@cache
def stamp(path: str) -> tuple[tuple[str, int, int], ...]:
    """Return name, time of change and size of a source file and of all here that it imports."""
    found: set[Path] = set()
    pending = [Path(path)]
    while pending:
        file = pending.pop()
        if file not in found:
            found.add(file)
            pending += _imported(file)
    stats = ((file.name, file.stat()) for file in sorted(found))
    return tuple((name, stat.st_mtime_ns, stat.st_size) for name, stat in stats)


@cache
def _imported(file: Path) -> tuple[Path, ...]:
    """Return the files of this package that a file imports from."""
    files = []
    for module, names in _IMPORT.findall(file.read_text(encoding="utf-8")):
        folder = _ROOT.joinpath(*module.split("."))
        candidates = [folder.with_suffix(".py"), folder / "__init__.py"]
        candidates += [folder / f"{name}.py" for name in re.findall(r"\w+", names)]
        files += [candidate for candidate in candidates if candidate.is_file()]
    return tuple(files)
