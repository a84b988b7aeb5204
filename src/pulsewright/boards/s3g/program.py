"""Programs of the program executor: text to words of 40 bits and back, and what is wrong with them.

One instruction a line; ``;`` begins a comment::

    .org 16                            ; where in program memory; 0 without it
    cruise:                            ; a name for that address
        OUTPUT   V_VAL[1], -16384      ; write a register, of channel 1
        OUTPUT   ASG_CONTROL, STEPS_LIMIT | DT_LIMIT | SET_V[1]
        STB      ASG_LOAD              ; give strobes
        WAIT_ALL ASG_DONE              ; or WAIT_ANY: wait for interrupts
        CLEAR    ASG_DONE              ; clear interrupts
        NOP
        DONE     7                     ; end, with an error code

Numbers are decimal, hexadecimal (``0x``) or binary (``0b``), and may have underscores; values go
from -2^31 to 2^32 - 1. Registers, strobes and interrupts have their names from the register map
(in any case), or are numbers: of a register, or a mask. ``|`` joins names and masks. Besides
numbers, a register takes the names of its single bits, and labels. The executor has no jumps: a
label is where a program may be started. ``.word`` gives a word as it is.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, NoReturn

from pulsewright.boards.s3g.registers import (
    BE_RUNNING,
    CHANNELS,
    CLASS_CONTROL,
    CLASS_OUTPUT,
    MAP,
    OP_CLEAR,
    OP_DONE,
    OP_NOP,
    OP_STB,
    OP_WAIT_ALL,
    OP_WAIT_ANY,
    PROG_CLASS_LSB,
    PROG_OPCODE_LSB,
    PROG_WORD_BYTES,
    PROG_WORDS,
    STB_BE_ABORT,
    STB_BE_START,
)
from pulsewright.errors import SourceError
from pulsewright.registers.model import Field, Register, Table

WORD: Final = (1 << 8 * PROG_WORD_BYTES) - 1
DATA: Final = (1 << PROG_OPCODE_LSB) - 1
OPCODE: Final = (1 << PROG_CLASS_LSB - PROG_OPCODE_LSB) - 1
ADDRESSES: Final = 1 << 16  # of the executor's program counter


def _bits(table: Table) -> dict[str, int]:
    return {code.name: 1 << code.value for code in table.codes}


def _flags(register: Register) -> dict[str, int]:
    """Return the names of the single bits of an output register, with their masks."""
    flags: dict[str, int] = {}
    for field in reversed(register.fields):
        if channel := re.fullmatch(r"channel(\d)", field.name):
            for code in MAP.table("SET").codes:
                flags[f"SET_{code.name}[{channel[1]}]"] = 1 << field.lsb + code.value
        elif field.per == "channel":
            for i in range(field.width):
                flags[f"{field.name.upper()}[{field.first + i}]"] = 1 << field.lsb + i
        elif field.width == 1:
            flags[field.name.upper()] = field.mask
    return flags


STROBES: Final = _bits(MAP.table("STB"))
INTERRUPTS: Final = _bits(MAP.table("INT"))
OPCODES: Final = {code.name: code.value for code in MAP.table("OP").codes}
OUTPUTS: Final = [register for register in MAP.registers if register.side == "write"]
REGISTERS: Final = {
    f"{register.name}[{i}]" if len(register.addresses) > 1 else register.name: at
    for register in OUTPUTS
    for i, at in enumerate(register.addresses)
}
FLAGS: Final = {
    at: flags for register in OUTPUTS if (flags := _flags(register)) for at in register.addresses
}
_NAMES: Final = {number: name for name, number in REGISTERS.items()}
_MNEMONICS: Final = ["OUTPUT", *OPCODES, ".WORD"]
_MASKS: Final = {
    OP_NOP: {},
    OP_DONE: {},
    OP_STB: STROBES,
    OP_WAIT_ALL: INTERRUPTS,
    OP_WAIT_ANY: INTERRUPTS,
    OP_CLEAR: INTERRUPTS,
}
_RESERVED: Final = {
    name.partition("[")[0]
    for names in (_MNEMONICS, REGISTERS, STROBES, INTERRUPTS, *FLAGS.values())
    for name in names
}


def _fields(word: int) -> tuple[int, int, int]:
    """Take a word apart into class, opcode or register, and data."""
    return word >> PROG_CLASS_LSB, word >> PROG_OPCODE_LSB & OPCODE, word & DATA


def _word(kind: int, opcode: int, data: int) -> int:
    return kind << PROG_CLASS_LSB | opcode << PROG_OPCODE_LSB | data


@dataclass(frozen=True)
class Instruction:
    """A word of program memory, and where in the text it comes from (both from 1)."""

    address: int
    word: int
    line: int
    column: int

    @property
    def text(self) -> str:
        """The instruction as `disassemble` writes it."""
        return instruction(self.word)


@dataclass(frozen=True)
class Program:
    """An assembled program.

    Parameters
    ----------
    instructions : tuple of Instruction
        By address.
    labels : mapping of str to int
        Names of addresses.
    path : str
        Of the text, for messages.
    """

    instructions: tuple[Instruction, ...]
    labels: Mapping[str, int]
    path: str = ""

    def pieces(self) -> list[tuple[int, list[int]]]:
        """Return the words as (address, words that follow each other from there)."""
        pieces: list[tuple[int, list[int]]] = []
        for item in self.instructions:
            if pieces and item.address == pieces[-1][0] + len(pieces[-1][1]):
                pieces[-1][1].append(item.word)
            else:
                pieces.append((item.address, [item.word]))
        return pieces


@dataclass(frozen=True)
class Finding:
    """What is wrong with a program at one place.

    An ``error`` keeps it from doing its work on any board; a ``warning`` is something that it may
    be meant to do.
    """

    severity: Literal["error", "warning"]
    line: int
    column: int
    message: str


# ---- words to text


def instruction(word: int) -> str:
    """Return the text of one word; an illegal one becomes a ``.word``.

    Examples
    --------
    >>> instruction(0x40_0000003C)
    'OUTPUT LEDS, 0x3C'
    >>> instruction(0x82_40000001)
    'WAIT_ALL ASG_DONE | BE_COMPLETE'
    """
    kind, opcode, data = _fields(word)
    if kind == CLASS_OUTPUT:
        return f"OUTPUT {_NAMES.get(opcode, opcode)}, {_value(opcode, data)}"
    code = MAP.table("OP").at(opcode)
    if kind != CLASS_CONTROL or code is None:
        return f".word 0x{word:010X}"
    if code.value == OP_NOP and not data:
        return "NOP"
    if code.value == OP_DONE:
        return f"DONE {data}"
    return f"{code.name} {_mask(data, _MASKS[code.value])}"


def disassemble(pieces: Iterable[tuple[int, Sequence[int]]]) -> str:
    """Return the text of words in program memory, given as (address, words from there on).

    `assemble` makes the same words of it.
    """
    lines, expected = [], 0
    for address, words in pieces:
        if address != expected:
            lines.append(f".org {address}")
        lines += [f"    {instruction(word)}" for word in words]
        expected = address + len(words)
    return "".join(f"{line}\n" for line in lines)


def _value(register: int, data: int) -> str:
    place = MAP.at("write", register)
    field = place.register.fields[0] if place else None
    if register in FLAGS:
        return _mask(data, FLAGS[register])
    if field and field.signed and data >> 31:
        return str(data - (1 << 32))
    return str(data) if field and (field.signed or field.unit) else f"0x{data:X}"


def _mask(mask: int, names: Mapping[str, int]) -> str:
    if not mask:
        return "0"
    if mask & ~sum(names.values()):
        return f"0x{mask:X}"
    return " | ".join(name for name, bit in names.items() if mask & bit)


# ---- text to words

_TOKEN: Final = re.compile(
    r"(?P<number>-?(0x[0-9a-f_]+|0b[01_]+|[0-9][0-9_]*)(?!\w))|(?P<name>\.?[a-z_]\w*)|[][,|:]",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class _Token:
    kind: str  # "number", "name", "end" or the sign itself
    text: str
    column: int


class _Line:
    """A line of the text, taken token by token."""

    def __init__(self, path: str, number: int, text: str) -> None:
        self.path, self.number = path, number
        self._at = 0
        self._tokens: list[_Token] = []
        code = text.partition(";")[0].rstrip()
        at = 0
        while at < len(code):
            if code[at].isspace():
                at += 1
                continue
            match = _TOKEN.match(code, at)
            if match is None:
                unknown = _Token("", code[at:].split()[0], at + 1)
                self.fail("no number, name or sign of a program", unknown)
            self._tokens.append(_Token(match.lastgroup or match[0], match[0], at + 1))
            at = match.end()
        self._tokens.append(_Token("end", "", len(code) + 1))

    def fail(self, message: str, token: _Token) -> NoReturn:
        raise SourceError(
            message, path=self.path, line=self.number, column=token.column, text=token.text
        )

    @property
    def next(self) -> _Token:
        return self._tokens[self._at]

    def take(self, kind: str, wanted: str) -> _Token:
        """Take the next token, which must be of this kind."""
        token = self.next
        if token.kind != kind:
            what = "the line ends" if token.kind == "end" else "this is something else"
            self.fail(f"wanted is {wanted}; {what}", token)
        self._at += 1
        return token

    def takes(self, kind: str) -> bool:
        """Take the next token if it is of this kind; tell whether it was."""
        if self.next.kind == kind:
            self._at += 1
            return True
        return False

    def label(self) -> _Token | None:
        """Take a label, if one is next."""
        token = self.next
        if token.kind != "name" or self._tokens[self._at + 1].kind != ":":
            return None
        self._at += 2
        return token

    def number_in(self, lowest: int, highest: int, wanted: str) -> int:
        """Take a number in a range."""
        token = self.take("number", wanted)
        digits = token.text.replace("_", "").lower()
        base = {"0x": 16, "0b": 2}.get(digits.lstrip("-")[:2], 10)
        value = int(digits, base)
        if not lowest <= value <= highest:
            self.fail(f"does not fit; wanted is {wanted}", token)
        return value

    def named(self, names: Mapping[str, int], kind: str) -> int:
        """Take a name, which may have an index, and return what it stands for."""
        token = self.take("name", f"a {kind}")
        name = token.text.upper()
        if self.takes("["):
            index = self.number_in(0, DATA, "an index: a number from 0 on")
            self.take("]", "a closing bracket")
            name += f"[{index}]"
        known = token.text if token.text in names else name  # a label keeps its case
        if known not in names:
            base = name.partition("[")[0] + "["
            family = [other for other in names if other.startswith(base)]
            close = difflib.get_close_matches(name, names, 1)
            hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(names)}"
            if family:
                hint = f"there are {', '.join(family)}"
            self.fail(f"no {kind} '{known}'; {hint}", token)
        return names[known]

    def value(self, names: Mapping[str, int], kind: str) -> int:
        """Take numbers and names joined by ``|``; return them as 32 bits."""
        total, first = 0, self.next
        while True:
            token = self.next
            if token.kind == "name" and names:
                total |= self.named(names, kind)
            else:
                wanted = f"a number {-(1 << 31)}..{DATA}" + (f" or a {kind}" if names else "")
                number = self.number_in(-(1 << 31), DATA, wanted)
                if number < 0 and (token is not first or self.next.kind == "|"):
                    self.fail("a negative number cannot be joined with others", token)
                total |= number & DATA
            if not self.takes("|"):
                return total

    def end(self) -> None:
        """Demand that the line ends here."""
        if self.next.kind != "end":
            self.fail("the instruction is complete before this; a comment begins with ;", self.next)


def assemble(text: str, path: Path | str = "") -> Program:
    r"""Translate the text of a program; see the top of this module.

    Parameters
    ----------
    text : str
        The program.
    path : Path or str
        Of the text, for messages.

    Raises
    ------
    SourceError
        If a line is wrong; names the line, the column and what is allowed.

    Examples
    --------
    >>> [hex(item.word) for item in assemble("OUTPUT LEDS, 60\nDONE 7").instructions]
    ['0x400000003c', '0xbf00000007']
    """
    labels: dict[str, int] = {}
    lines: dict[int, _Line] = {}
    address = 0
    for number, row in enumerate(text.splitlines(), 1):
        line = _Line(str(path), number, row)
        label = None
        while token := line.label():
            label = token
            if token.text.upper() in _RESERVED:
                line.fail("a label needs a name that is not one of the board's", token)
            if token.text in labels:
                line.fail(f"this label is address {labels[token.text]} already", token)
            labels[token.text] = address
        if line.next.text.lower() == ".org":
            if label:
                line.fail("a label names the address after .org; put it on the next line", label)
            line.take("name", "")
            address = line.number_in(0, ADDRESSES - 1, f"an address 0..{ADDRESSES - 1}")
            line.end()
        elif line.next.kind != "end":
            if address in lines:
                taken = lines[address].number
                line.fail(f"address {address} has the instruction of line {taken}", line.next)
            if address >= ADDRESSES:
                line.fail(f"address {address} is beyond the last, {ADDRESSES - 1}", line.next)
            lines[address] = line
            address += 1
    instructions = tuple(_instruction(at, lines[at], labels) for at in sorted(lines))
    return Program(instructions, labels, str(path))


def _instruction(address: int, line: _Line, labels: Mapping[str, int]) -> Instruction:
    token = line.take("name", "an instruction")
    mnemonic = token.text.upper()
    if mnemonic == ".WORD":
        word = line.number_in(0, WORD, f"a word 0..0x{WORD:X}")
    elif mnemonic == "OUTPUT":
        if line.next.kind == "number":
            register = line.number_in(0, OPCODE, f"a register 0..{OPCODE}")
        else:
            register = line.named(REGISTERS, "register")
        line.take(",", "a comma and a value")
        names = {**labels, **FLAGS.get(register, {})}
        word = _word(CLASS_OUTPUT, register, line.value(names, "name of a bit or label"))
    elif mnemonic in OPCODES:
        opcode = OPCODES[mnemonic]
        kind = "strobe" if opcode == OP_STB else "interrupt"
        bare = opcode == OP_NOP and line.next.kind == "end"
        word = _word(CLASS_CONTROL, opcode, 0 if bare else line.value(_MASKS[opcode], kind))
    else:
        close = difflib.get_close_matches(mnemonic, _MNEMONICS, 1) or _MNEMONICS
        line.fail(f"no instruction '{mnemonic}'; there are {', '.join(close)}", token)
    line.end()
    return Instruction(address, word, line.number, token.column)


# ---- checks


def check(
    program: Program, *, channels: int = CHANNELS, prog_words: int = PROG_WORDS
) -> list[Finding]:
    """Return what is wrong with a program, by line.

    Parameters
    ----------
    program : Program
        What to look at.
    channels : int
        Of the board; registers of others have no function.
    prog_words : int
        Size of its program memory [word].
    """
    if not program.instructions:
        return [Finding("error", 1, 1, "there is no instruction")]
    findings = [
        Finding(severity, item.line, item.column, message)
        for item in program.instructions
        for severity, message in _problems(item, channels, prog_words)
    ]
    findings += _flow(program, prog_words)
    return sorted(findings, key=lambda finding: (finding.line, finding.column))


_Problem = tuple[Literal["error", "warning"], str]


def _problems(item: Instruction, channels: int, prog_words: int) -> Iterator[_Problem]:
    """Yield what is wrong with an instruction by itself."""
    kind, opcode, data = _fields(item.word)
    if item.address >= prog_words:
        yield (
            "error",
            f"address {item.address} is beyond the program memory of {prog_words} words; it would "
            f"be written at {item.address % prog_words}",
        )
    if kind == CLASS_OUTPUT:
        used = _used(opcode, channels)
        name = _NAMES.get(opcode, str(opcode))
        if not used:
            yield "warning", f"register {name} has no function with {channels} channels"
        elif data & ~used:
            unused = f"bits 0x{data & ~used:X} of register {name}"
            yield "warning", f"{unused} have no function with {channels} channels"
    elif kind != CLASS_CONTROL or MAP.table("OP").at(opcode) is None:
        yield "error", f"word {item.word:010X} is illegal: it ends the program with code 0x81"
    elif opcode == OP_STB:
        if data & ~sum(STROBES.values()):
            yield "warning", f"strobes 0x{data & ~sum(STROBES.values()):X} have no function"
        if data >> STB_BE_START & 1:
            yield "warning", "BE_START is ignored while a program runs"
    elif opcode == OP_WAIT_ALL and data & ~sum(INTERRUPTS.values()):
        never = data & ~sum(INTERRUPTS.values())
        yield "error", f"never goes on: interrupts 0x{never:X} are never pending"
    elif opcode == OP_WAIT_ALL and not data:
        yield "warning", "waits for nothing: goes on at once"
    elif opcode == OP_WAIT_ANY and not data & sum(INTERRUPTS.values()):
        yield "error", "never goes on: none of its interrupts is ever pending"
    elif opcode == OP_DONE:
        if data > 0xFF:
            yield "warning", f"only the low 8 bits become the error code: 0x{data & 0xFF:02X}"
        meaning = MAP.table("BE").at(data & 0xFF)
        if meaning and meaning.value != BE_RUNNING:
            yield "warning", f"code 0x{data & 0xFF:02X} looks like {meaning.name}: {meaning.desc}"


def _used(register: int, channels: int) -> int:
    """Return the bits of an output register that do something on a board with so many channels."""
    place = MAP.at("write", register)
    if place is None or (len(place.register.addresses) > 1 and place.instance >= channels):
        return 0
    return sum(_used_bits(field, channels) for field in place.register.fields)


def _used_bits(field: Field, channels: int) -> int:
    if channel := re.fullmatch(r"channel(\d)", field.name):
        return field.mask if int(channel[1]) < channels else 0
    if field.per == "channel":
        return field.mask & (1 << field.lsb + max(channels - field.first, 0)) - 1
    return field.mask


def _flow(program: Program, prog_words: int) -> Iterator[Finding]:
    """Yield where the executor runs into nothing, and what it never reaches."""
    placed = {item.address for item in program.instructions}
    starts = {address for address, _ in program.pieces()} | set(program.labels.values())
    end: Instruction | None = None  # where the program ended before this instruction
    said = False
    for item in program.instructions:
        if item.address in starts:
            end, said = None, False
        if end:
            if not said:
                yield Finding(
                    "warning",
                    item.line,
                    item.column,
                    f"never reached: the program ends at line {end.line}; a label says that it can "
                    f"be started here",
                )
            said = True
            continue
        end = item if _ends(item.word) else None
        after = (item.address + 1) % prog_words
        if not end and after not in placed:
            yield Finding(
                "error",
                item.line,
                item.column,
                f"DONE is missing: the executor goes on to address {after}, where this program "
                f"has nothing",
            )


def _ends(word: int) -> bool:
    """Tell whether the executor never goes on to the next word."""
    kind, opcode, data = _fields(word)
    if kind == CLASS_OUTPUT:
        return False
    if kind != CLASS_CONTROL or MAP.table("OP").at(opcode) is None:
        return True
    return opcode == OP_DONE or (opcode == OP_STB and bool(data >> STB_BE_ABORT & 1))
