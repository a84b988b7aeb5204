"""Arrays at addresses in memory and calls of the system, for kernels that serve other programs.

Numba takes twenty times longer to look at the arrays of a whole state than a short kernel needs. A
kernel that takes an address gets round that; the caller keeps what lies there alive.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np import arrayobj

from pulsewright.compiled import compiled
from pulsewright.twin.kernel import OPTIONS

F = TypeVar("F", bound=Callable[..., Any])

_make: Any = arrayobj.make_array  # numba has types for a few of its functions only
_populate: Any = arrayobj.populate_array
_pack: Any = cgutils.pack_array


@intrinsic
def _array_at(context: Any, address: Any, shape: Any, dtype: Any) -> Any:
    """Make an array without an owner."""
    tuples = isinstance(shape, types.BaseTuple)
    sizes = tuple(shape) if tuples else (shape,)
    array = types.Array(dtype.dtype, len(sizes), "C")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole = arguments[1]
        lengths = [
            context.cast(
                builder, builder.extract_value(whole, n) if tuples else whole, size, types.intp
            )
            for n, size in enumerate(sizes)
        ]
        made = _make(array)(context, builder)
        item = context.get_constant(
            types.intp, context.get_abi_sizeof(context.get_data_type(array.dtype))
        )
        strides = [item]
        for length in reversed(lengths[1:]):
            strides.insert(0, builder.mul(strides[0], length))
        _populate(
            made,
            data=builder.inttoptr(arguments[0], made.data.type),
            shape=_pack(builder, lengths),
            strides=_pack(builder, strides),
            itemsize=item,
            meminfo=None,
        )
        return made._getvalue()

    return array(types.int64, shape, dtype), generate


# array_at(address, shape, dtype): the array that lies there. In kernels only.
array_at: Final[Callable[[int, Any, Any], Any]] = _array_at  # type: ignore[assignment]


def _of_system(name: str, result: Any, *arguments: Any) -> Any:
    return types.ExternalFunction(name, result(*arguments))


# Functions of the C library; addresses are numbers.
poll = _of_system("poll", types.int32, types.int64, types.uint64, types.int32)
receive = _of_system("recv", types.int64, types.int32, types.int64, types.uint64, types.int32)
send = _of_system("send", types.int64, types.int32, types.int64, types.uint64, types.int32)
clock_gettime = _of_system("clock_gettime", types.int32, types.int32, types.int64)


def unlocked(function: F) -> F:
    """Compile a kernel that may wait: other threads of the program run meanwhile."""
    return compiled(**OPTIONS)(function)
