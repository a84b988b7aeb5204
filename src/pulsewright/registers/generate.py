"""Make every product of the boards' ``registers.rdl``.

Run as ``python -m pulsewright.registers.generate`` in a checkout. A board is a folder
``src/pulsewright/boards/<board>`` with a register source; its products are ``registers.py``
beside it and ``docs/registers/<board>.md``, ``.json`` and ``.h``, and its pictures in
``docs/registers/<board>/`` if it asks for them. With ``--check`` nothing is
written: the files that differ are named, and the exit code is 1.
"""

from __future__ import annotations

import argparse
import dataclasses
import re
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pulsewright.errors import PulsewrightError, UsageError
from pulsewright.registers import picture, render
from pulsewright.registers.model import RegisterMap
from pulsewright.registers.render import LISTED

COMMAND = "python -m pulsewright.registers.generate"
CHECKOUT = Path(__file__).parents[3]
WIDTH = 100  # of a line, as in pyproject.toml
HEXADECIMAL = {"addresses", "aliases", "reset"}


def sources(root: Path = CHECKOUT) -> list[Path]:
    """Return the register source of every board of a checkout.

    Raises
    ------
    UsageError
        If ``root`` is no checkout.
    """
    found = sorted((root / "src/pulsewright/boards").glob("*/registers.rdl"))
    if not found:
        raise UsageError(
            f"{root}: no src/pulsewright/boards/<board>/registers.rdl here; generate in a checkout"
        )
    return found


def products(source: Path, root: Path = CHECKOUT) -> dict[Path, str]:
    """Return the text of each file that is generated from one register source, by path.

    Raises
    ------
    UsageError
        If the source cannot be read; the message begins with file, line and column.
    """
    from pulsewright.registers import rdl

    registers = rdl.read(source)
    board = source.parent.name
    if registers.board != board:
        raise UsageError(f"{source}: the address map is '{registers.board}', must be '{board}'")
    docs = root / "docs/registers"
    pictures = {
        docs / render.picture_file(registers, register): picture.svg(register)
        for register in (*registers.registers, *registers.words)
        if registers.pictures
    }
    return {
        source.with_name("registers.py"): python(registers),
        docs / f"{board}.md": render.markdown(registers),
        docs / f"{board}.json": render.json(registers),
        docs / f"{board}.h": render.c_header(registers),
        **pictures,
    }


def python(registers: RegisterMap) -> str:
    """Return ``registers.py``: constants for code, and ``MAP`` with everything, formatted."""
    board = registers.board
    lines = [
        f'"""Registers of {board}: {registers.title}.',
        "",
        f"Generated from registers.rdl by `{COMMAND}`; do not edit.",
        '"""',
        "",
        "from __future__ import annotations",
        "",
        "from typing import Final",
        "",
        *_import("pulsewright.registers.model", sorted(_classes(registers))),
    ]
    for constant in registers.constants:
        lines += ["", *_comments(constant.comment)]
        lines.append(f"{constant.name}: Final = {constant.text}")
    for register in registers.registers:
        lines += ["", *_comments(f"{register.label()} ({register.side})")]
        written = "" if registers.decimal else "addresses"
        at = register.addresses if len(register.addresses) > 1 else register.addresses[0]
        lines.append(f"{register.key}: Final = {_literal(at, written)}")
        for i, alias in enumerate(register.alias_groups):
            at = alias if len(alias) > 1 else alias[0]
            lines.append(f"{register.key}_ALIAS{i or ''}: Final = {_literal(at, written)}")
        digits = 2 * register.size
        if register.reset is not None:
            lines.append(f"{register.key}_RESET: Final = 0x{register.reset:0{digits}X}")
        for field in register.fields:
            prefix = f"{register.key}_{field.name.upper()}"
            lines.append(f"{prefix}_LSB: Final = {field.lsb}")
            lines.append(f"{prefix}_MASK: Final = 0x{field.mask:0{digits}X}")
    for table in registers.tables:
        lines += ["", *_comments(table.title + (" [bit]" if table.unit == "bit" else ""))]
        lines += [
            f"{table.prefix}_{code.name}: Final = {table.text(code.value)}" for code in table.codes
        ]
    if registers.profiles:
        lines += ["", f'DEFAULT_PROFILE: Final = "{registers.profiles[0]}"']
        lines.append("PROFILES: Final[dict[str, dict[str, int]]] = {")
        for i, profile in enumerate(registers.profiles):
            lines.append(f'    "{profile}": {{')
            for switch in registers.switches:
                value = f"0x{switch.values[i]:02X}" if switch.unit == "hex" else switch.values[i]
                lines.append(f'        "{switch.name}": {value},')
            lines.append("    },")
        lines.append("}")
    lines += ["", *_expression(registers, "MAP: Final = ", 0)]
    return "\n".join(lines) + "\n"


def _classes(value: Any) -> set[str]:
    """Return the names of the dataclasses that a value is made of."""
    if dataclasses.is_dataclass(value):
        parts = [getattr(value, field.name) for field in dataclasses.fields(value)]
        return {type(value).__name__}.union(*map(_classes, parts))
    return set().union(*map(_classes, value)) if isinstance(value, tuple) else set()


def _import(module: str, names: Sequence[str]) -> list[str]:
    line = f"from {module} import {', '.join(names)}"
    if len(line) <= WIDTH:
        return [line]
    return [f"from {module} import (", *(f"    {name}," for name in names), ")"]


def _comments(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent="# ", subsequent_indent="# ")


def _expression(value: Any, prefix: str, indent: int, *, suffix: str = "") -> list[str]:
    """Write a value as Python, formatted as ruff does: on one line if it fits, else broken up."""
    space, name = " " * indent, prefix.removesuffix("=")
    line = f"{space}{prefix}{_literal(value, name)}{suffix}"
    if len(line) <= WIDTH:
        return [line]
    inner = indent + 4
    if isinstance(value, str):
        body = [f"{' ' * inner}{_quote(row)}" for row in _wrap(value, WIDTH - inner - 2)]
        return [f"{space}{prefix}(", *body, f"{space}){suffix}"]
    if isinstance(value, tuple):
        body = [row for item in value for row in _expression(item, "", inner, suffix=",")]
        return [f"{space}{prefix}(", *body, f"{space}){suffix}"]
    body = [
        row
        for key, item in _arguments(value)
        for row in _expression(item, f"{key}=", inner, suffix=",")
    ]
    return [f"{space}{prefix}{type(value).__name__}(", *body, f"{space}){suffix}"]


def _literal(value: Any, name: str = "") -> str:
    if isinstance(value, str):
        return _quote(value)
    if isinstance(value, tuple):
        if name in HEXADECIMAL and len(value) > LISTED and value == _range(value):
            return f"tuple(range(0x{value[0]:02X}, 0x{value[-1] + 1:02X}))"
        items = ", ".join(_literal(item, name) for item in value)
        return f"({items},)" if len(value) == 1 else f"({items})"
    if dataclasses.is_dataclass(value):
        arguments = (f"{key}={_literal(item, key)}" for key, item in _arguments(value))
        return f"{type(value).__name__}({', '.join(arguments)})"
    if type(value) is int and name in HEXADECIMAL:
        return f"0x{value:02X}"
    return repr(value)


def _range(numbers: Sequence[int]) -> tuple[int, ...]:
    """Return as many numbers in a row, from the first on."""
    return tuple(range(numbers[0], numbers[0] + len(numbers)))


def _arguments(value: Any) -> list[tuple[str, Any]]:
    """Return the arguments of a dataclass that differ from their defaults."""
    pairs = [(field, getattr(value, field.name)) for field in dataclasses.fields(value)]
    return [(field.name, item) for field, item in pairs if item != field.default]


def _wrap(text: str, width: int) -> list[str]:
    """Break a text after spaces, and after its own line breaks; nothing is lost."""
    rows: list[str] = []
    for line in text.splitlines(keepends=True):
        row = ""
        for word in re.findall(r"\S+\s*", line) or [line]:
            if row and len(_quote(row + word)) - 2 > width:
                rows.append(row)
                row = ""
            row += word
        rows.append(row)
    return rows


def _quote(text: str) -> str:
    quote = "'" if text.count('"') > text.count("'") else '"'
    escaped = text.replace("\\", "\\\\").replace("\n", "\\n").replace(quote, "\\" + quote)
    return f"{quote}{escaped}{quote}"


def run(root: Path = CHECKOUT, *, check: bool = False) -> list[Path]:
    """Write every product that is missing or differs; return those files.

    Parameters
    ----------
    root : Path
        The checkout.
    check : bool
        Write nothing.
    """
    texts: dict[Path, str] = {}
    for source in sources(root):
        texts |= products(source, root)
    stale = [
        path
        for path, text in texts.items()
        if not path.is_file() or path.read_text(encoding="utf-8") != text
    ]
    if not check:
        for path in stale:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(texts[path], encoding="utf-8")
    return stale


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    parser = argparse.ArgumentParser(prog=COMMAND, description="Generate from registers.rdl.")
    parser.add_argument("--check", action="store_true", help="write nothing; 1 if files differ")
    parser.add_argument("--root", type=Path, default=CHECKOUT, help="the checkout")
    options = parser.parse_args(arguments)
    try:
        stale = run(options.root, check=options.check)
    except PulsewrightError as error:
        print(error, file=sys.stderr)
        return 1
    for path in stale:
        print(f"{'differs from its source' if options.check else 'written'}: {path}")
    if stale and options.check:
        print(f"run `{COMMAND}` and commit the result", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
