"""A register map as text for people and programs: Markdown, HTML, a C header, JSON."""

from __future__ import annotations

import dataclasses
import html as markup
import json as json_module
import re
import textwrap
from collections.abc import Iterator
from typing import Any, Final

from pulsewright.registers import picture
from pulsewright.registers.model import (
    Constant,
    Field,
    Place,
    Register,
    RegisterMap,
    Table,
)

JSON_FORMAT: Final = "pulsewright-registers-1"
LISTED: Final = 8  # addresses of a register that are listed one by one
SOURCE: Final = "Generated from `registers.rdl` of the board; do not edit."


def places(registers: RegisterMap) -> Iterator[tuple[int, Place | None, Place | None]]:
    """Yield (address, what is read there, what is written there) for every register address."""
    for address in range(1 << registers.address_bits):
        yield address, registers.at("read", address), registers.at("write", address)


def addresses(registers: RegisterMap, register: Register) -> str:
    """Write the addresses of a register as documents do: ``0C, also 03``; ``10, 13``; ``04..43``.

    Many addresses in a row are written as a range.
    """
    found = [address(registers, at) for at in register.addresses]
    text = ", ".join(found)
    last = register.addresses[0] + len(found) - 1
    if len(found) > LISTED and register.addresses == tuple(range(register.addresses[0], last + 1)):
        text = f"{found[0]}..{found[-1]}"
    return ", also ".join([text, *(address(registers, at) for at in register.aliases)])


def address(registers: RegisterMap, at: int) -> str:
    """Write an address as the documents of a board do."""
    return str(at) if registers.decimal else f"{at:02X}"


def numbers(registers: RegisterMap) -> str:
    """Say how a page writes numbers."""
    if registers.decimal:
        return "Register numbers are decimal, words are hexadecimal."
    return "Addresses and words are hexadecimal."


def constant_row(constant: Constant) -> tuple[str, str, str, str]:
    """Return name, value, unit and meaning of a constant."""
    unit = "" if constant.unit == "hex" else constant.unit
    return f"`{constant.name}`", constant.text, unit, constant.desc


def table_rows(table: Table) -> tuple[list[str], list[list[str]]]:
    """Return a table of codes as its head and its rows; arguments only where some code has any."""
    head = ["Name", "Bit" if table.unit == "bit" else "Value", "Meaning"]
    rows = [
        [f"`{table.prefix}_{code.name}`", table.text(code.value), code.desc] for code in table.codes
    ]
    for title, parts in (
        ("Reply", [code.reply for code in table.codes]),
        ("Arguments", [code.arguments for code in table.codes]),
    ):
        if any(parts):
            head.insert(2, title)
            for row, part in zip(rows, parts, strict=True):
                row.insert(2, ", ".join(argument.text for argument in part))
    return head, rows


def word(register: Register, value: int | None) -> str:
    """Write a value of a register in hexadecimal, ``-`` for none."""
    return "-" if value is None else f"{value:0{2 * register.size}X}"


def bit_runs(register: Register) -> list[tuple[str, str, int]]:
    """Return the bits of a register from the highest down, as (field, owner of the bit, bits).

    A field whose bits belong to axes or inputs gives one entry per bit; any other field one entry;
    bits between fields one entry with an empty name.
    """
    runs: list[tuple[str, str, int]] = []
    bit = 8 * register.size - 1
    while bit >= 0:
        field = register.field_at(bit)
        if field is None:
            first = bit
            while bit >= 0 and register.field_at(bit) is None:
                bit -= 1
            runs.append(("", "", first - bit))
        elif field.per:
            runs.append((field.name, f"{field.per} {field.first + bit - field.lsb}", 1))
            bit -= 1
        else:
            runs.append((field.name, "", field.width))
            bit -= field.width
    return runs


def picture_file(registers: RegisterMap, register: Register) -> str:
    """Return where the picture of a register is, beside the page: ``usc/w_timer.svg``."""
    return f"{registers.board}/{register.key.lower()}.svg"


def has_picture(register: Register) -> bool:
    """Tell whether a row of bits says more about a register than its name."""
    return len(bit_runs(register)) > 1


def formulas(registers: RegisterMap, field: Field) -> list[str]:
    """Return the formula of a field, once per profile where the profiles differ."""
    texts = []
    for i in range(len(registers.profiles) or 1):
        values = {switch.name: switch.values[i] for switch in registers.switches}
        texts.append(field.formula.format(**values))
    if len(set(texts)) == 1:
        return [texts[0]] if texts[0] else []
    return [f"`{p}`: {text}" for p, text in zip(registers.profiles, texts, strict=True)]


def notes(register: Register) -> list[tuple[str, str]]:
    """Return what is special about a register, as (term, text)."""
    found = []
    if register.takes_effect:
        found.append(("Takes effect", register.takes_effect))
    if register.latched:
        found.append(("Holding register", f"loaded by {register.latched}"))
    cleared = [f"`{field.name}`" for field in register.fields if field.clear_on_read]
    if cleared:
        found.append(("Cleared by the read", ", ".join(cleared)))
    if register.commits:
        found.append(("Commit", "the write of the high byte, that byte included"))
    if register.assembly and register.assembly != register.name:
        found.append(("Assembled in", f"the shared register `W_{register.assembly}`"))
    if register.min_version:
        found.append(("Present", f"from ident version {register.min_version} on"))
    if register.present_with:
        names = " or ".join(f"`{name}`" for name in register.present_with)
        found.append(("Present", f"with profile switch {names}"))
    if register.follows:
        found.append(("Value", f"that of the profile switch `{register.follows}`"))
    return found


def meaning(registers: RegisterMap, field: Field) -> list[str]:
    """Return what there is to say about a field, one sentence or formula an entry."""
    parts = [field.desc]
    parts += [f"{c.value} = `{c.name}`" + (f": {c.desc}" if c.desc else "") for c in field.choices]
    parts += formulas(registers, field)
    if field.signed:
        parts.append("Two's complement.")
    if field.fracwidth:
        parts.append(f"Fixed point, {field.fracwidth} fraction bits.")
    if field.unit:
        parts.append(f"Unit: {field.unit}.")
    return parts


# ---- Markdown


def markdown(registers: RegisterMap) -> str:
    """Return the register map as a Markdown page."""
    lines = [f"# {registers.title}: registers", "", f"<!-- {SOURCE} -->", "", registers.desc, ""]
    lines += [numbers(registers), "", "## Addresses", ""]
    lines += _table(
        ("Address", "Read", "Write"),
        [
            (f"`{address(registers, at)}`", _linked(read), _linked(written))
            for at, read, written in places(registers)
        ],
    )
    for side in ("read", "write"):
        lines += ["", f"## {side.capitalize()} side"]
        for register in registers.registers:
            if register.side == side:
                lines += _markdown_register(registers, register)
    for table in registers.tables:
        lines += ["", f"## {table.title}", ""]
        lines += [table.desc, ""] if table.desc else []
        lines += _table(*table_rows(table))
    if registers.words:
        lines += ["", "## Words of messages"]
        for part in registers.words:
            lines += _markdown_register(registers, part)
    if registers.switches:
        lines += ["", "## Profiles", "", f"The default is `{registers.profiles[0]}`.", ""]
        lines += _table(
            ("Switch", *(f"`{p}`" for p in registers.profiles), "Allowed", "Meaning"),
            [
                (f"`{s.name}`", *map(s.text, s.values), s.allowed, s.meaning)
                for s in registers.switches
            ],
        )
    if registers.constants:
        lines += ["", "## Constants", ""]
        lines += _table(
            ("Name", "Value", "Unit", "Meaning"),
            map(constant_row, registers.constants),
        )
    return "\n".join(lines) + "\n"


def _markdown_register(registers: RegisterMap, register: Register) -> list[str]:
    head = f"**{register.label()}.**"
    if register.side != "word":
        head += f" Address `{addresses(registers, register)}`"
        head += f", {register.size} bytes" if register.size > 1 else ""
        head += (
            f", reset `{word(register, register.reset)}`." if register.reset is not None else "."
        )
    lines = ["", f"### {register.key}", "", head, "", register.desc, ""]
    if registers.pictures:
        lines += [f"![{picture.describe(register)}]({picture_file(registers, register)})", ""]
    elif has_picture(register):
        bits = range(8 * register.size - 1, -1, -1)
        cells = []
        for bit in bits:
            field = register.field_at(bit)
            label = field.label(bit) if field else ""
            cells.append(label.replace(" ", "<br>", 1))
        lines += [*_table([str(bit) for bit in bits], [cells], align=":-:"), ""]
    lines += [f"- {term}: {text}." for term, text in notes(register)]
    lines += [""] if notes(register) else []
    rows = [
        (
            field.bits,
            f"`{field.name}`",
            "-" if field.reset is None else f"{field.reset:X}",
            "<br>".join(meaning(registers, field)),
        )
        for field in register.fields
    ]
    return [*lines, *_table(("Bits", "Field", "Reset", "Meaning"), rows)]


def _linked(place: Place | None) -> str:
    return f"[{place.label}](#{place.register.key.lower()})" if place else ""


def _table(head: Any, rows: Any, align: str = "---") -> list[str]:
    lines = [list(head), [align] * len(head), *rows]
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in lines]


# ---- C


def c_header(registers: RegisterMap) -> str:
    """Return the register map as a C header (C90 and later, no dependencies)."""
    board = registers.board.upper()
    guard = f"PULSEWRIGHT_{board}_REGISTERS_H"
    lines = [*_comment(f"{registers.title}: registers. {SOURCE}")]
    lines += ["", f"#ifndef {guard}", f"#define {guard}"]

    def define(name: str, value: str) -> None:
        lines.append(f"#define {board}_{name} {value}")

    def written(at: int) -> str:
        return f"{at}u" if registers.decimal else f"0x{at:02X}u"

    for constant in registers.constants:
        lines += ["", *_comment(constant.comment)]
        define(constant.name, f"{constant.text.replace('_', '')}u")
    for register in registers.registers:
        text = f"{register.label()} ({register.side}). {register.desc}"
        if register.takes_effect:
            text += f" Takes effect {register.takes_effect}."
        lines += ["", *_comment(text)]
        first, digits = register.addresses[0], 2 * register.size
        if len(register.addresses) > 1:
            stride = register.addresses[1] - first
            define(f"{register.key}(n)", f"({written(first)} + {stride}u * (n))")
            define(f"{register.key}_INSTANCES", f"{len(register.addresses)}u")
        else:
            define(register.key, written(first))
        for i, alias in enumerate(register.alias_groups):
            name = f"{register.key}_ALIAS{i or ''}"
            if len(alias) > 1:
                define(f"{name}(n)", f"({written(alias[0])} + {alias[1] - alias[0]}u * (n))")
            else:
                define(name, written(alias[0]))
        if register.size > 1:
            define(f"{register.key}_SIZE", f"{register.size}u")
        if register.reset is not None:
            define(f"{register.key}_RESET", f"0x{register.reset:0{digits}X}u")
        for field in register.fields:
            name = f"{register.key}_{field.name.upper()}"
            define(f"{name}_LSB", f"{field.lsb}u")
            define(f"{name}_MASK", f"0x{field.mask:0{digits}X}u")
            for choice in field.choices:
                define(f"{name}_{choice.name.upper()}", f"{choice.value}u")
    for table in registers.tables:
        lines += ["", *_comment(" ".join([f"{table.title}.", table.desc]).strip())]
        for code in table.codes:
            define(f"{table.prefix}_{code.name}", f"{table.text(code.value)}u")
    for switch in registers.switches:
        lines += ["", *_comment(f"Profile switch {switch.name}: {switch.meaning}")]
        for profile, value in zip(registers.profiles, switch.values, strict=True):
            number = f"0x{value:02X}u" if switch.unit == "hex" else f"{value}u"
            define(f"{profile.upper()}_{switch.name.upper()}", number)
    lines += ["", f"#endif /* {guard} */"]
    return "\n".join(lines) + "\n"


def _comment(text: str) -> list[str]:
    plain = text.replace("*/", "* /").replace("/*", "/ *").replace("`", "")
    return textwrap.wrap(f"/* {plain} */", 98, subsequent_indent=" * ", break_on_hyphens=False)


# ---- JSON


def json(registers: RegisterMap) -> str:
    """Return the register map as JSON: the model's names, masks and resets worked out."""
    described = []
    for register in registers.registers:
        entry = {"key": register.key} | dataclasses.asdict(register) | {"reset": register.reset}
        del entry["board"]
        if register.address_bytes == 1:
            del entry["address_bytes"]
        entry["fields"] = [
            dataclasses.asdict(field)
            | {"mask": field.mask, "minimum": field.minimum, "maximum": field.maximum}
            for field in register.fields
        ]
        described.append(entry)
    page = {"format": JSON_FORMAT} | dataclasses.asdict(registers) | {"registers": described}
    if not registers.tables:
        del page["tables"]
    for name in ("hex_addresses", "pictures", "words"):
        if not page[name]:
            del page[name]
    return json_module.dumps(page, indent=1) + "\n"


# ---- HTML

STYLE: Final = """
:root { color-scheme: light dark; --line: #8886; --soft: #8881; --mark: #2a78c6; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 64rem; margin: 2rem auto; padding: 0 1rem; }
h1, h2, h3 { line-height: 1.2; } h2 { margin-top: 3rem; }
section { border-top: 1px solid var(--line); padding: .5rem 0 1rem; scroll-margin-top: 1rem; }
section:target { border-left: 4px solid var(--mark); padding-left: 1rem; }
h3 small { font-weight: normal; opacity: .75; margin-left: .5rem; }
table { border-collapse: collapse; margin: .8rem 0; width: 100%; }
th, td { border: 1px solid var(--line); padding: .25rem .5rem; text-align: left;
  vertical-align: top; }
th { background: var(--soft); }
table.fields td:last-child { width: 70%; }
code { font-family: ui-monospace, monospace; }
table.bits { table-layout: fixed; } table.bits th, table.bits td { text-align: center;
  overflow-wrap: anywhere; font-size: .85rem; }
table.bits td { font-weight: 600; } table.bits td.none { background: var(--soft); }
table.bits span { display: block; font-weight: normal; opacity: .8; }
dl { display: grid; grid-template-columns: max-content auto; gap: .1rem 1rem; }
dt { opacity: .75; } dd { margin: 0; }
a { color: var(--mark); text-decoration: none; } a:hover { text-decoration: underline; }
"""


def html(registers: RegisterMap) -> str:
    """Return the register map as one HTML page that needs no other file."""
    title = f"{markup.escape(registers.title)}: registers"
    body = [f"<h1>{title}</h1>"]
    body += [f"<p>{_inline(text)}</p>" for text in registers.desc.split("\n\n")]
    body += [f"<p>{numbers(registers)}</p>", "<h2>Addresses</h2>"]
    rows = [
        [f"<code>{address(registers, at)}</code>", _anchor(read), _anchor(written)]
        for at, read, written in places(registers)
    ]
    body.append(_html_table(["Address", "Read", "Write"], rows))
    for side in ("read", "write"):
        body.append(f"<h2>{side.capitalize()} side</h2>")
        body += [_html_register(registers, r) for r in registers.registers if r.side == side]
    for table in registers.tables:
        body.append(f"<h2>{_inline(table.title)}</h2>")
        body += [f"<p>{_inline(table.desc)}</p>"] if table.desc else []
        titles, codes = table_rows(table)
        body.append(_html_table(titles, [list(map(_inline, row)) for row in codes]))
    if registers.words:
        body.append("<h2>Words of messages</h2>")
        body += [_html_register(registers, part) for part in registers.words]
    if registers.switches:
        body.append("<h2>Profiles</h2>")
        body.append(f"<p>The default is <code>{registers.profiles[0]}</code>.</p>")
        rows = [
            [f"<code>{s.name}</code>"]
            + [_inline(text) for text in (*map(s.text, s.values), s.allowed, s.meaning)]
            for s in registers.switches
        ]
        body.append(_html_table(["Switch", *registers.profiles, "Allowed", "Meaning"], rows))
    if registers.constants:
        body.append("<h2>Constants</h2>")
        rows = [list(map(_inline, constant_row(constant))) for constant in registers.constants]
        body.append(_html_table(["Name", "Value", "Unit", "Meaning"], rows))
    head = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>{STYLE}</style></head><body>\n"
    )
    return head + "\n".join(body) + "\n</body></html>\n"


def _html_register(registers: RegisterMap, register: Register) -> str:
    facts = []
    if register.side != "word":
        facts.append(("Address", f"`{addresses(registers, register)}`"))
    if register.size > 1:
        facts.append(("Size", f"{register.size} bytes, low byte first"))
    if register.reset is not None:
        facts.append(("Reset", f"`{word(register, register.reset)}`"))
    parts = [
        f'<section id="{register.key.lower()}"><h3><code>{register.key}</code>'
        f"<small>{_inline(register.label())}</small></h3>",
        f"<p>{_inline(register.desc)}</p>",
    ]
    if has_picture(register):
        bits = "".join(f"<th>{bit}</th>" for bit in range(8 * register.size - 1, -1, -1))
        cells = "".join(
            f'<td colspan="{width}"{"" if name else " class=none"}>{_inline(name)}'
            + (f"<span>{_inline(owner)}</span>" if owner else "")
            + "</td>"
            for name, owner, width in bit_runs(register)
        )
        parts.append(f'<table class="bits"><tr>{bits}</tr><tr>{cells}</tr></table>')
    terms = "".join(
        f"<dt>{term}</dt><dd>{_inline(text)}</dd>" for term, text in [*facts, *notes(register)]
    )
    parts.append(f"<dl>{terms}</dl>")
    rows = [
        [
            field.bits,
            f"<code>{field.name}</code>",
            "-" if field.reset is None else f"{field.reset:X}",
            "<br>".join(map(_inline, meaning(registers, field))),
        ]
        for field in register.fields
    ]
    fields = _html_table(["Bits", "Field", "Reset", "Meaning"], rows)
    parts += [fields.replace("<table>", '<table class="fields">', 1), "</section>"]
    return "\n".join(parts)


def _html_table(head: list[str], rows: list[list[str]]) -> str:
    def row(cells: list[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{cell}</{tag}>" for cell in cells) + "</tr>"

    return "\n".join(
        ["<table>", row(head, "th"), *(row(cells, "td") for cells in rows), "</table>"]
    )


def _anchor(place: Place | None) -> str:
    if place is None:
        return ""
    return f'<a href="#{place.register.key.lower()}">{_inline(place.label)}</a>'


def _inline(text: str) -> str:
    """Escape a text for HTML; words in backticks become code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", markup.escape(text))
