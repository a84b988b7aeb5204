"""Bit-field pictures of registers and words, as SVG: the highest bit at the left, 32 bits a row."""

from __future__ import annotations

import html as markup
from typing import Final

from pulsewright.registers.model import Field, Register

BITS: Final = 32  # of a row
BIT: Final = 24  # width of a bit [px]
HEIGHT: Final = 32  # of a box [px]
TEXT: Final = 12  # size of text [px]
LETTER: Final = 7.25  # width of a letter of that size [px]
NUMBERS: Final = 18  # height of the row of bit numbers [px]
GAP: Final = 10  # between rows, and around the picture [px]
LINE: Final = "#333"
UNUSED: Final = "#e4e4e4"
USED: Final = "#f2f7fc"


def svg(register: Register) -> str:
    """Return the picture of a register.

    A field is a box with its name, and with the numbers of its highest and lowest bit above. Bits
    without a field are grey. A name that does not fit is written downwards below its box; what the
    bits of a field belong to stands below it, too.
    """
    width = BITS * BIT + 2 * GAP
    parts: list[str] = []
    top = GAP
    for high in range(8 * register.size - 1, -1, -BITS):
        low = max(high - BITS + 1, 0)
        row, top = _row(register, high, low, top)
        parts += row
    style = f'font-family="monospace" font-size="{TEXT}" text-anchor="middle"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{top}" '
        f'viewBox="0 0 {width} {top}" {style}>\n'
        f"<title>{_plain(describe(register))}</title>\n"
        f'<rect width="{width}" height="{top}" fill="#fff"/>\n' + "\n".join(parts) + "\n</svg>\n"
    )


def describe(register: Register) -> str:
    """Say what a picture shows: ``31:24 devel, 23:16 major, 15:8 minor, 7:0 patch``."""
    return ", ".join(f"{field.bits} {field.name}" for field in register.fields)


def boxes(register: Register, high: int, low: int) -> list[tuple[int, int, Field | None]]:
    """Return the boxes of the bits from ``high`` down to ``low``: highest and lowest bit, field."""
    found: list[tuple[int, int, Field | None]] = []
    bit = high
    while bit >= low:
        field = register.field_at(bit)
        end = bit
        while end > low and register.field_at(end - 1) is field:
            end -= 1
        found.append((bit, end, field))
        bit = end - 1
    return found


def _row(register: Register, high: int, low: int, top: int) -> tuple[list[str], int]:
    """Draw bits ``high`` to ``low``; return the elements and where the next row begins."""
    box_top = top + NUMBERS
    bottom = box_top + HEIGHT
    parts: list[str] = []
    deepest = 0
    for first, last, field in boxes(register, high, low):
        left = GAP + (BITS - 1 - (first - low)) * BIT
        width = (first - last + 1) * BIT
        middle = left + width // 2
        parts.append(
            f'<rect x="{left}" y="{box_top}" width="{width}" height="{HEIGHT}" '
            f'fill="{USED if field else UNUSED}" stroke="{LINE}"/>'
        )
        for bit in sorted({first, last}, reverse=True):
            at = GAP + (BITS - 1 - (bit - low)) * BIT + BIT // 2
            parts.append(f'<text x="{at}" y="{box_top - 5}" fill="{LINE}">{bit}</text>')
        if field is None:
            continue
        owner = _owner(field, first, last)
        if len(field.name) * LETTER <= width:
            parts.append(_text(middle, box_top + HEIGHT // 2 + TEXT // 3, field.name))
            if owner:
                parts.append(_text(middle, bottom + TEXT + 2, owner))
                deepest = max(deepest, TEXT + 6)
        else:
            name = f"{field.name}, {owner}" if owner else field.name
            at = middle - TEXT // 3
            parts.append(
                f'<text x="{at}" y="{bottom + 6}" text-anchor="start" '
                f'transform="rotate(90 {at} {bottom + 6})">{_plain(name)}</text>'
            )
            deepest = max(deepest, 6 + round(len(name) * LETTER))
    return parts, bottom + deepest + GAP


def _owner(field: Field, first: int, last: int) -> str:
    """Say what the bits of a box belong to: ``motor 0..31``."""
    if not field.per:
        return ""
    low, high = (field.first + bit - field.lsb for bit in (last, first))
    return f"{field.per} {low}" if low == high else f"{field.per} {low}..{high}"


def _text(x: int, y: int, text: str) -> str:
    return f'<text x="{x}" y="{y}">{_plain(text)}</text>'


def _plain(text: str) -> str:
    return markup.escape(text)
