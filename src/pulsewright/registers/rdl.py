"""Read a board's ``registers.rdl`` (SystemRDL 2.0). Needed to build pulsewright, not to run it."""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from pathlib import Path
from typing import Any

from systemrdl.compiler import RDLCompiler
from systemrdl.messages import MessagePrinter, RDLCompileError, Severity
from systemrdl.node import AddressableNode, AddrmapNode, FieldNode, Node, RegfileNode, RegNode
from systemrdl.source_ref import DetailedFileSourceRef

from pulsewright.errors import UsageError
from pulsewright.registers.model import (
    Argument,
    Choice,
    Code,
    Constant,
    Field,
    ProfileSwitch,
    Register,
    RegisterMap,
    Side,
    Table,
)

PROPERTIES = Path(__file__).parent  # `include "properties.rdl"` is found here


class _Messages(MessagePrinter):
    """Collect the compiler's messages with their places, uncoloured."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def print_message(self, severity: Severity, text: str, src_ref: Any) -> None:
        if severity >= Severity.ERROR and src_ref is not None:
            self.lines.append(f"{_place(src_ref)}: {text}")


def _place(src_ref: Any) -> str:
    if isinstance(src_ref, DetailedFileSourceRef):
        return f"{src_ref.path}:{src_ref.line}:{src_ref.line_selection[0] + 1}"
    return str(getattr(src_ref, "path", "registers"))


def _error(node: Node, message: str, named: str = "") -> UsageError:
    """Make an error that points at a node, or at its property ``named`` where it has that."""
    inst = node.inst
    known = [inst.property_src_ref.get(named), inst.inst_src_ref, inst.def_src_ref]
    place = next(_place(ref) for ref in known if isinstance(ref, DetailedFileSourceRef))
    return UsageError(f"{place}: {node.get_path()}: {message}")


def read(path: Path | str) -> RegisterMap:
    """Read the register map of a board.

    Parameters
    ----------
    path : Path or str
        ``boards/<board>/registers.rdl``; the top address map bears the name of the folder.

    Raises
    ------
    UsageError
        If the file is missing, is no SystemRDL, or lacks what every map must say: the message
        begins with file, line and column.
    """
    path = Path(path)
    if not path.is_file():
        raise UsageError(f"{path}: no such file; a board has boards/<board>/registers.rdl")
    messages = _Messages()
    compiler = RDLCompiler(message_printer=messages)
    try:
        compiler.compile_file(str(path), incl_search_paths=[str(PROPERTIES)])
        top = compiler.elaborate().top
    except RDLCompileError as error:
        raise UsageError("\n".join(messages.lines) or f"{path}: {error}") from error
    return _map(top)


def _map(top: AddrmapNode) -> RegisterMap:
    board = top.inst_name
    sides = {node.inst_name: node for node in top.children()}
    if list(sides) not in (["read", "write"], ["read", "write", "words"]):
        raise _error(
            top,
            f"holds {', '.join(sides)}; needs the two addrmaps 'read' and 'write', and may have "
            f"'words'",
        )
    profiles = tuple(_udp(top, "profiles", []))
    switches = tuple(_switch(top, raw, len(profiles)) for raw in _udp(top, "switches", []))
    defaults = {switch.name: switch.values[0] for switch in switches}
    address_bytes = _udp(top, "address_bytes", 1)
    registers: list[Register] = []
    for side in ("read", "write"):
        found = list(_registers(board, side, sides[side], defaults, address_bytes))
        registers += sorted(found, key=lambda register: register.addresses)
    address_bits = _udp(top, "address_bits", 0)
    if not address_bits:
        raise _error(top, "address_bits is missing: bits of an address that select the register")
    last = max(at + r.size // address_bytes - 1 for r in registers for at in r.addresses)
    if last >= 1 << address_bits:
        raise _error(
            top, f"address {last:#x} does not fit in {address_bits} address bits", "address_bits"
        )
    return RegisterMap(
        board=board,
        title=_text(top, "name") or board,
        desc=_text(top, "desc"),
        registers=tuple(registers),
        profiles=profiles,
        switches=switches,
        constants=tuple(
            Constant(raw.name, raw.value, raw.unit, _join(raw.desc))
            for raw in _udp(top, "constants", [])
        ),
        address_bits=address_bits,
        tables=tuple(_table(top, raw) for raw in _udp(top, "tables", [])),
        hex_addresses=_udp(top, "hex_addresses", False),
        pictures=_udp(top, "pictures", False),
        words=tuple(_registers(board, "word", sides["words"], defaults, address_bytes))
        if "words" in sides
        else (),
    )


def _table(top: AddrmapNode, raw: Any) -> Table:
    codes = tuple(
        Code(
            code.name,
            code.value,
            _join(code.desc),
            _arguments(top, code, "arguments"),
            _arguments(top, code, "reply"),
        )
        for code in raw.codes
    )
    values = [code.value for code in codes]
    if values != sorted(set(values)) or len({code.name for code in codes}) < len(codes):
        raise _error(
            top, f"table {raw.prefix}: needs rising values and names of their own", "tables"
        )
    return Table(raw.prefix, raw.title, codes, raw.unit, _join(raw.desc))


def _arguments(top: AddrmapNode, code: Any, which: str) -> tuple[Argument, ...]:
    found: dict[str, Argument] = {}
    for raw in getattr(code, which, []):
        if raw.repeat and raw.repeat not in found:
            raise _error(
                top,
                f"{code.name}: {raw.name} repeats by '{raw.repeat}', no argument before it",
                "tables",
            )
        found[raw.name] = Argument(raw.name, raw.size, raw.repeat)
    return tuple(found.values())


def _switch(top: AddrmapNode, raw: Any, profiles: int) -> ProfileSwitch:
    if not profiles or len(raw.values) != profiles:
        raise _error(
            top,
            f"switch {raw.name} has {len(raw.values)} values for {profiles} profiles",
            "switches",
        )
    for value in raw.values:
        if not raw.minimum <= value <= raw.maximum:
            raise _error(
                top,
                f"switch {raw.name}: {value} is not in {raw.minimum}..{raw.maximum}",
                "switches",
            )
    choices = tuple(Choice(c.name, c.value, _join(c.desc)) for c in raw.choices)
    return ProfileSwitch(
        raw.name,
        _join(raw.meaning),
        tuple(raw.values),
        raw.minimum,
        raw.maximum,
        raw.unit,
        choices,
    )


def _registers(
    board: str, side: Side, addrmap: Node, defaults: dict[str, int], address_bytes: int
) -> Iterator[Register]:
    for node in addrmap.children():
        if isinstance(node, RegNode):
            if node.is_alias:
                continue  # listed with its primary
            aliases = tuple(
                at for alias in node.aliases() for at in _addresses(alias, address_bytes)
            )
            size = node.get_property("regwidth") // 8
            follows = _udp(node, "follows", "")
            if follows and follows not in defaults:
                raise _error(node, f"follows '{follows}', which is no switch", "follows")
            fields = tuple(
                _field(field, defaults.get(follows)) for field in reversed(list(node.fields()))
            )
        elif isinstance(node, RegfileNode) and _udp(node, "assembled", False):
            aliases = ()
            size, fields = _assembled(node)
            follows = ""
        elif isinstance(node, RegfileNode) and node.is_array and isinstance(addrmap, AddrmapNode):
            yield from _registers(board, side, node, defaults, address_bytes)
            continue
        else:
            raise _error(node, "is neither a register nor an assembled regfile")
        if size % address_bytes:
            raise _error(node, f"has {size} bytes; {address_bytes} are at one address")
        _check(node, side, fields, addrmap, defaults)
        takes_effect = _text(node, "takes_effect")
        if side == "write" and not takes_effect:
            raise _error(node, "takes_effect is missing: when does a write act?")
        if not _text(node, "desc"):
            raise _error(node, "desc is missing")
        yield Register(
            board=board,
            name=node.inst_name.upper(),
            side=side,
            addresses=_addresses(node, address_bytes),
            size=size,
            title=_text(node, "name") or node.inst_name,
            fields=fields,
            desc=_text(node, "desc"),
            takes_effect=takes_effect,
            aliases=aliases,
            latched=_text(node, "latched"),
            assembly=_udp(node, "assembly", "").upper(),
            commits=_udp(node, "commits", False),
            min_version=_udp(node, "min_version", 0),
            follows=follows,
            present_with=_present_with(node),
            address_bytes=address_bytes,
        )


def _check(
    node: RegNode | RegfileNode,
    side: Side,
    fields: tuple[Field, ...],
    addrmap: Node,
    switches: Container[str],
) -> None:
    """Refuse a register on the wrong side, or one that refers to what is not there."""
    for part in [node] if isinstance(node, RegNode) else node.registers():
        access = [part.has_sw_readable, part.has_sw_writable]
        if access != [side != "write", side == "write"]:
            wanted = "w" if side == "write" else "r"
            raise _error(part, f"is in addrmap '{addrmap.inst_name}'; set sw = {wanted}")
    for name in _present_with(node):
        if name not in switches:
            raise _error(node, f"present_with '{name}', which is no switch", "present_with")
    assembly = _udp(node, "assembly", "")
    if assembly and addrmap.get_child_by_name(assembly) is None:
        raise _error(node, f"assembly '{assembly}' is no register beside it", "assembly")
    for field in fields:
        for name in re.findall(r"{(.*?)}", field.formula):
            if name not in switches:
                raise _error(node, f"formula of {field.name}: '{name}' is no switch")


def _addresses(node: AddressableNode, address_bytes: int) -> tuple[int, ...]:
    starts = _starts(node)
    if isinstance(node.parent, RegfileNode):  # one instance in each element of the group
        if node.is_array:
            raise _error(node, "an array of registers has one dimension")
        starts = [start + starts[0] for start in _starts(node.parent)]
    if any(at % address_bytes for at in starts):
        raise _error(node, f"begins within an address; {address_bytes} bytes are at each")
    return tuple(at // address_bytes for at in starts)


def _starts(node: AddressableNode) -> list[int]:
    start = node.raw_address_offset
    if not node.is_array:
        return [start]
    dimensions, stride = node.array_dimensions, node.array_stride
    if dimensions is None or stride is None or len(dimensions) != 1:
        raise _error(node, "an array of registers has one dimension")
    return [start + i * stride for i in range(dimensions[0])]


def _field(node: FieldNode, word: int | None) -> Field:
    """Read a field; ``word`` is the value that the whole register follows, if it follows one."""
    reset = node.get_property("reset")
    if word is not None:
        reset = word >> node.low & ((1 << node.width) - 1)
    if reset is None and node.is_sw_writable:
        raise _error(node, "reset is missing: what does it hold after reset?")
    if not _text(node, "desc"):
        raise _error(node, "desc is missing")
    encode = node.get_property("encode")
    choices = [] if encode is None else encode.members.values()
    on_read = node.get_property("onread")
    return Field(
        name=node.inst_name,
        lsb=node.low,
        width=node.width,
        reset=reset if isinstance(reset, int) else None,
        unit=_text(node, "unit"),
        desc=_text(node, "desc"),
        signed=bool(_udp(node, "is_signed", False)),
        fracwidth=_udp(node, "fracwidth", 0),
        per=_text(node, "per"),
        first=_udp(node, "first", 0),
        clear_on_read=on_read is not None and on_read.name == "rclr",
        formula=_text(node, "formula"),
        choices=tuple(Choice(c.name, c.value, _join(c.rdl_desc or "")) for c in choices),
    )


def _assembled(node: RegfileNode) -> tuple[int, tuple[Field, ...]]:
    """Make one value of the bytes of an assembled regfile: its size and its field."""
    parts = [child for child in node.children() if isinstance(child, RegNode)]
    reset: int | None = 0
    for byte, part in enumerate(parts):
        fields = part.fields()
        if part.raw_address_offset != byte or [(f.low, f.width) for f in fields] != [(0, 8)]:
            raise _error(part, "each byte of an assembled value is one 8-bit field")
        value = fields[0].get_property("reset")
        reset = reset | value << 8 * byte if reset is not None and isinstance(value, int) else None
    field = Field(
        name="value",
        lsb=0,
        width=8 * len(parts),
        reset=reset,
        unit=_text(node, "unit"),
        desc="Low byte first.",
        signed=bool(_udp(node, "is_signed", False)),
        fracwidth=_udp(node, "fracwidth", 0),
        formula=_text(node, "formula"),
    )
    return len(parts), (field,)


def _present_with(node: Node) -> tuple[str, ...]:
    names = _text(node, "present_with")
    return tuple(names.split(" or ")) if names else ()


def _udp(node: Node, name: str, default: Any) -> Any:
    """Return a user-defined property, or ``default`` where it is not set."""
    value = node.get_property(name, default=default)
    return default if value is None else value


def _text(node: Node, name: str) -> str:
    return _join(_udp(node, name, "") if name in node.list_properties() else "")


def _join(text: str) -> str:
    """Undo the line breaks of the source; an empty line parts paragraphs."""
    paragraphs = "\n".join(line.strip() for line in text.splitlines()).split("\n\n")
    return "\n\n".join(" ".join(p.split()) for p in paragraphs if p.strip())
