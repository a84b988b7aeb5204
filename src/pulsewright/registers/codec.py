r"""Field values to register words and bytes, and back, with every value checked.

Examples
--------
>>> from pulsewright.boards.usc.registers import MAP
>>> encode_bytes(MAP["W_DIVISOR"], value=9999)
b"\x0f'\x00"
>>> encode(MAP["W_TIMER"], soft_latch=1, rate=3)
35
>>> decode(MAP["R_IDENT"], 0x41)
{'type': 4, 'version': 1}
"""

from __future__ import annotations

import operator
from typing import SupportsIndex

from pulsewright.errors import RegisterValueError
from pulsewright.registers.model import Field, Register


def encode(register: Register, **values: SupportsIndex) -> int:
    """Return the word that holds these raw field values; fields not named are 0.

    Raises
    ------
    RegisterValueError
        If a value is no integer or does not fit its field.
    UsageError
        If the register has no such field.
    """
    word = 0
    for name, value in values.items():
        field = register.field(name)
        raw = _checked(register, field, value)
        word |= raw << field.lsb & field.mask
    return word


def decode(register: Register, word: int) -> dict[str, int]:
    """Return the raw value of each field of a word, from the highest bits down.

    Raises
    ------
    RegisterValueError
        If the word is wider than the register.
    """
    limit = (1 << 8 * register.size) - 1
    if not 0 <= word <= limit:
        raise RegisterValueError(
            f"{register.board} {register.key}: {word:#x} is no word of {register.size} bytes; "
            f"allowed are 0..{limit:#x}"
        )
    values = {}
    for field in register.fields:
        raw = (word & field.mask) >> field.lsb
        values[field.name] = raw - (1 << field.width) if raw > field.maximum else raw
    return values


def encode_bytes(register: Register, **values: SupportsIndex) -> bytes:
    """Return the bytes that hold these raw field values, low byte first; as `encode`."""
    return encode(register, **values).to_bytes(register.size, "little")


def decode_bytes(register: Register, data: bytes) -> dict[str, int]:
    """Return the raw value of each field of a register read as bytes, low byte first.

    Raises
    ------
    RegisterValueError
        If there are more or fewer bytes than the register has.
    """
    if len(data) != register.size:
        raise RegisterValueError(
            f"{register.board} {register.key}: {len(data)} bytes for a register of "
            f"{register.size}; read all of its bytes, low byte first"
        )
    return decode(register, int.from_bytes(data, "little"))


def _checked(register: Register, field: Field, value: SupportsIndex) -> int:
    place = f"{register.board} {register.key}.{field.name}"
    allowed = f"allowed are {field.minimum}..{field.maximum}"
    if field.unit:
        allowed += f" [{field.unit}]"
    try:
        raw = operator.index(value)
    except TypeError:
        raise RegisterValueError(f"{place}: {value!r} is no integer; {allowed}") from None
    if not field.minimum <= raw <= field.maximum:
        raise RegisterValueError(f"{place}: {raw} does not fit in {field.width} bits; {allowed}")
    return raw
