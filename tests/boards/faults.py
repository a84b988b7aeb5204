"""Small faults in the source of gateware and twins, to show that the tests notice."""

from __future__ import annotations

import ctypes
import importlib.util
import math
import operator
import sys
from contextlib import ExitStack
from pathlib import Path
from types import ModuleType
from unittest.mock import patch

import numpy as np

# Modules that a twin consists of, each after those it imports; `boards.twinning` is between them.
FLOOR = ("kernel", "clock", "epp", "recorder", "quadrature", "step_rate", "step_pulse", "uart")
ROOM = (
    *("twin_stepgen", "twin_channel", "twin_motor", "twin_bridge", "twin_state"),
    *("twin_program", "twin_protocol", "twin_original", "twin_message", "twin_spi"),
    *("twin_kernel", "twin"),
)


def faulty(name, old, new):
    """Return the module ``name`` with the first ``old`` in its source replaced by ``new``."""
    module = ModuleType(f"{name}_faulty")
    with patch.dict(sys.modules, {module.__name__: module}):
        exec(compile(_source(name, old, new), name, "exec"), module.__dict__)
    return module


def interpreted(room, *fault):
    """Return a twin whose kernels are plain Python, with a fault or without.

    Compiling all kernels of a twin takes far longer than a faulty one needs to show itself.

    Parameters
    ----------
    room : str
        Package of the board; its module ``twin`` is returned.
    *fault : str
        Module, what is there, what comes in its place; or nothing.
    """
    names = [f"pulsewright.twin.{part}" for part in FLOOR]
    names += ["pulsewright.boards.twinning"]
    names += [f"{room}.{part}" for part in ROOM if importlib.util.find_spec(f"{room}.{part}")]
    assert not fault or fault[0] in names
    with ExitStack() as stack:
        stack.enter_context(patch("pulsewright.twin.memory.array_at", _array_at))
        stack.enter_context(patch.dict(sys.modules))
        for name in names:
            spec = importlib.util.find_spec(name)
            source = _source(name, *fault[1:] if name in fault[:1] else ())
            module = sys.modules[name] = importlib.util.module_from_spec(spec)
            exec(compile(source, name, "exec"), module.__dict__)
            if name == "pulsewright.twin.kernel":
                module.kernel = module.inlined = module.hot = lambda function: function
            for key, value in list(vars(module).items()):
                if isinstance(value, np.dtype):
                    setattr(module, key, _with_attributes(value))
            package, _, leaf = name.rpartition(".")
            stack.enter_context(patch.object(sys.modules[package], leaf, module, create=True))
    return module


def _source(name, old="", new=""):
    """Return the source of a module, changed; nothing of it is left in a cache."""
    source = Path(importlib.util.find_spec(name).origin).read_text()
    assert old in source, f"{name} has no {old!r}"
    return source.replace(old, new, 1) if old else source


def _array_at(address, shape, dtype):
    """Return the array that lies at an address, in plain Python."""
    dtype = np.dtype(dtype)
    size = math.prod(shape if isinstance(shape, tuple) else (shape,)) * dtype.itemsize
    memory = (ctypes.c_char * int(size)).from_address(int(address))
    return np.ndarray(shape, dtype, memory)


def _with_attributes(dtype):
    """Return a dtype whose records have their fields as attributes, as they do in kernels."""
    if dtype.subdtype:
        base, shape = dtype.subdtype
        return np.dtype((_with_attributes(base), shape))
    if not dtype.names:
        return dtype

    def field(name):
        return property(
            operator.itemgetter(name), lambda row, value: operator.setitem(row, name, value)
        )

    row = type("Row", (np.void,), {name: field(name) for name in dtype.names})
    fields = [(name, _with_attributes(dtype.fields[name][0])) for name in dtype.names]
    return np.dtype((row, fields))
