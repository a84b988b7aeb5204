"""The register map of a board as text: what ``pulsewright regs`` prints."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from io import StringIO
from typing import Final

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Table

from pulsewright import boards
from pulsewright.errors import UsageError
from pulsewright.registers import render as pages
from pulsewright.registers.model import Register, RegisterMap


def render(board: str, format: str = "table") -> str:
    """Return the register map of a board.

    Parameters
    ----------
    board : str
        Name of a room, such as ``usc``.
    format : str
        ``table`` for a terminal, ``md``, ``json``, ``c`` (a header) or ``html`` (one page).

    Raises
    ------
    UsageError
        If the board or the format is unknown; the message lists those there are.

    Examples
    --------
    >>> "#define USC_W_TIMER 0x04u" in render("usc", "c")
    True
    """
    make = FORMATS.get(format)
    if make is None:
        raise UsageError(f"no format '{format}'; the formats are {', '.join(FORMATS)}")
    return make(boards.get(board).registers()).rstrip("\n")


def table(registers: RegisterMap) -> str:
    """Return the register map as tables of the terminal's width, at least 80 columns."""
    width = max(80, shutil.get_terminal_size((100, 24)).columns)
    out = StringIO()
    console = Console(file=out, width=width, color_system=None, highlight=False)
    console.print(f"{registers.title}: registers\n")
    console.print(_text(registers.desc))

    overview = Table("addr", "read", "write", box=box.SIMPLE_HEAD)
    for at, read, written in pages.places(registers):
        labels = (place.label if place else "" for place in (read, written))
        overview.add_row(pages.address(registers, at), *labels)
    console.print(overview)

    for register in (*registers.registers, *registers.words):
        place = "" if register.side == "word" else f" @ {pages.addresses(registers, register)}"
        head = f"{register.key}{place}: {register.label()}"
        if register.reset is not None:
            head += f", reset {pages.word(register, register.reset)}"
        console.print(head)
        if pages.has_picture(register):
            for picture in _pictures(register, console):
                console.print(Padding(picture, (0, 2)))
        console.print(_text(register.desc))
        for term, text in pages.notes(register):
            console.print(_text(f"{term}: {text}."))
        fields = Table("bits", "field", "reset", "meaning", box=box.SIMPLE_HEAD)
        for field in register.fields:
            reset = "-" if field.reset is None else f"{field.reset:X}"
            lines = "\n".join(pages.meaning(registers, field))
            fields.add_row(field.bits, field.name, reset, _plain(lines))
        console.print(fields)

    for codes in registers.tables:
        console.print(codes.title)
        console.print(_text(codes.desc))
        titles, rows = pages.table_rows(codes)
        listed = Table(*(title.lower() for title in titles), box=box.SIMPLE_HEAD)
        listed.columns[0].no_wrap = True
        for row in rows:
            listed.add_row(*map(_plain, row))
        console.print(listed)
    if registers.switches:
        switches = Table("switch", *registers.profiles, "allowed", "meaning", box=box.SIMPLE_HEAD)
        switches.columns[0].no_wrap = True
        for switch in registers.switches:
            cells = [switch.name, *map(switch.text, switch.values), switch.allowed, switch.meaning]
            switches.add_row(*map(_plain, cells))
        console.print(switches)
    if registers.constants:
        constants = Table("constant", "value", "meaning", box=box.SIMPLE_HEAD)
        for constant in registers.constants:
            name, value, unit, meaning = pages.constant_row(constant)
            constants.add_row(_plain(name), f"{value} {unit}".strip(), _plain(meaning))
        console.print(constants)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines())


def _plain(text: str) -> str:
    """Take the backticks away, and keep rich from reading ``[...]`` as markup."""
    return escape(text.replace("`", ""))


def _text(text: str) -> Padding:
    return Padding(_plain(text), (0, 2))


def _pictures(register: Register, console: Console) -> list[Table]:
    """Draw a register as a row of bits, the highest at the left; as several where it is wide."""
    places = []
    bit = 8 * register.size - 1
    for name, owner, width in pages.bit_runs(register):
        low = bit - width + 1
        short = name.replace("_", "_\n") if len(name) > 8 else name
        text = f"{short}\n{owner}" if owner else short or "-"
        places.append((f"{bit}:{low}" if width > 1 else str(bit), text))
        bit = low - 1
    return _rows_of_bits(places, console)


def _rows_of_bits(places: list[tuple[str, str]], console: Console) -> list[Table]:
    picture = Table(box=box.SQUARE, show_lines=True, padding=(0, 1))
    for bits, _ in places:
        picture.add_column(bits, justify="center")
    picture.add_row(*(text for _, text in places))
    for padding in (1, 0):  # without it, eight bits with owners fit in 80 columns
        picture.padding = (0, padding)
        if Measurement.get(console, console.options, picture).maximum <= console.width - 4:
            return [picture]
    half = len(places) // 2
    return [*_rows_of_bits(places[:half], console), *_rows_of_bits(places[half:], console)]


FORMATS: Final[dict[str, Callable[[RegisterMap], str]]] = {
    "table": table,
    "md": pages.markdown,
    "json": pages.json,
    "c": pages.c_header,
    "html": pages.html,
}
