"""From a line of text to a `Line`: words, codes, parameter settings, O-words, comments.

Spaces and the case of letters mean nothing, so a line is first squeezed. Most lines of most
programs are words with plain numbers: one regular expression reads those. All others, and all
that are wrong, go through `_Reader`, which also knows columns and makes trees of expressions. A
`Line` is read once and carried out as often as the program comes by.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Container, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple, NoReturn

from pulsewright.motion.gcode.codes import G_GROUPS
from pulsewright.motion.gcode.expressions import (
    BINARY,
    EQUAL,
    FUNCTIONS,
    Arctangent,
    Binary,
    Exists,
    Fixed,
    Function,
    Named,
    Negative,
    Node,
    Number,
    Numbered,
    Span,
)
from pulsewright.motion.gcode.faults import Fault
from pulsewright.motion.gcode.parameters import POSITION, Parameters

MAX_NESTING: Final = 50  # values within values; far from Python's own recursion limit

# Letters with a value; G, M, N and O are read on their own.
VALUE_LETTERS: Final = frozenset("ABCDEFHIJKLPQRSTUVWXYZ@^$")

_WORDS: Final = re.compile(r"(.)([+-]?[0-9.]*)")
_LINE_NUMBER: Final = re.compile(r"N([0-9]+)(?:\.[0-9]*)?")
_NUMBER: Final = re.compile(r"[0-9.]+")
_NAME: Final = re.compile(r"[A-Z]+")
_OPERATOR: Final = re.compile(r"\*\*|[*/+-]|MOD|EQ|NE|GT|GE|LT|LE|AND|OR|XOR")
_COMMENT: Final = re.compile(r"\([^()]*\)|;.*")
_MESSAGE: Final = re.compile(
    r"\(\s*(?:(msg|debug|print|log|logopen|logappend),([^()]*)|(logclose))\)", re.IGNORECASE
)
_FIXED: Final = frozenset(range(1, POSITION))  # parameters that are nothing but numbers
_GAP: Final = ";"  # stands for a comment, so that words do not grow together across it
_KEYWORD: Final = re.compile(
    "ENDSUB|SUB|CALL|RETURN|IF|ELSEIF|ELSE|ENDIF|WHILE|ENDWHILE|DO|REPEAT|ENDREPEAT|BREAK|CONTINUE"
)
_WITH_VALUE: Final = frozenset(("IF", "ELSEIF", "WHILE", "REPEAT"))
_WITH_VALUES: Final = frozenset(("CALL", "RETURN", "ENDSUB"))

# How G codes of the dialect are commonly written, to ten times their number: "1", "01", "61.1".
_G_TEXTS: Final[dict[str, int]] = {
    text: code
    for code in G_GROUPS
    for text in (
        [f"{code // 10}.{code % 10}"]
        if code % 10
        else [f"{code // 10}", f"{code // 10:02}", f"{code // 10}.0", f"{code // 10}."]
    )
}

Label = int | str


class Comment(NamedTuple):
    """A comment in parentheses; ``kind`` is "comment" or what makes it a message."""

    kind: str
    text: str


class _Item(NamedTuple):
    """A word of a line, or a parameter setting (letter ``#``)."""

    letter: str
    node: Node
    key: Numbered | Named | None
    start: int  # in the squeezed line
    end: int


@dataclass(slots=True, eq=False)
class OWord:
    """The flow of control that a line asks for.

    ``keyword`` is empty where the line is the label of an M98 subprogram. ``label`` is None where
    it must be worked out (``o#1 call``); then ``node`` does that. ``passes`` is how often its
    values were worked out, while that matters, and ``function`` does it from then on.
    """

    keyword: str
    label: Label | None
    node: Node | None
    values: tuple[Node, ...]
    span: Span
    passes: int = 0
    function: Callable[[Parameters], Sequence[float]] | None = None

    @property
    def name(self) -> str:
        """How the label is written."""
        return label_name(self.label)


def label_name(label: Label | None) -> str:
    """Return how a label is written."""
    return f"o<{label}>" if isinstance(label, str) else "o" + str("" if label is None else label)


class Block:
    """What one line asks for, with all values worked out.

    Members
    -------
    text : str
        The line.
    words : dict[str, float]
        Words other than G, M and N, by letter.
    g : list[int]
        Ten times the numbers of the G words, in order.
    m : list[int]
        The M words, in order.
    """

    __slots__ = ("g", "m", "text", "words")

    def __init__(self, text: str) -> None:
        self.text = text
        self.words: dict[str, float] = {}
        self.g: list[int] = []
        self.m: list[int] = []

    def fault(self, message: str, letters: Container[str], code: int | None = None) -> Fault:
        """Return a fault at the first word with one of ``letters``; a G or M word counts by code.

        Places of words are known to the slow reader alone, so the line is read again.
        """
        with suppress(Fault):
            reader = _Reader(self.text)
            seen = {"G": iter(self.g), "M": iter(self.m)}
            for item in reader.items():
                value = next(seen[item.letter], None) if item.letter in "GM" else None
                if item.letter in letters and (value is None or code in (None, value)):
                    return Fault(message, *reader.place(item.start, item.end))
        return Fault(message, 1 + len(self.text) - len(self.text.lstrip()), self.text.strip())


NO_CODES: Final = Block("")


class Line:
    """One line, read.

    Members
    -------
    text : str
        The line.
    deleted : bool
        It begins with ``/``.
    number : str
        The digits of its N word before the point, or nothing.
    comment : Comment or None
        Its last comment in parentheses; the dialect forgets the others.
    flow : OWord or None
        What it asks of the flow of control; it then has no words.
    constant : Block or None
        Its words, if their values never change.
    items, settings : sequences
        Its words otherwise, and the parameters that it sets.
    only_sets : bool
        It does nothing but set parameters.
    passes : int
        How often it was come by, while that matters.
    """

    __slots__ = (
        "_codes",
        "_reader",
        "comment",
        "constant",
        "deleted",
        "flow",
        "items",
        "number",
        "only_sets",
        "passes",
        "settings",
        "text",
    )

    def __init__(self, text: str) -> None:
        self.text = text
        self.deleted = False
        self.number = ""
        self.comment: Comment | None = None
        self.flow: OWord | None = None
        self.constant: Block | None = None
        self.items: Sequence[_Item] = ()
        self.settings: Sequence[tuple[Numbered | Named, Node]] = ()
        self.only_sets = False
        self.passes = 0
        self._codes = NO_CODES
        self._reader: _Reader | None = None

    @property
    def asks(self) -> bool:
        """Whether it holds words, settings or a message: all but a plain comment."""
        block = self.constant
        words = block is not None and (block.words or block.g or block.m)
        message = self.comment is not None and self.comment.kind != "comment"
        return bool(words or self.items or self.settings or message)

    def hold(self, items: Sequence[_Item], reader: _Reader) -> None:
        """Take the words and settings that a reader has found."""
        self._reader = reader
        self.settings = [(item.key, item.node) for item in items if item.key is not None]
        self.items = [item for item in items if item.key is None]
        codes = [item for item in self.items if item.letter in "GM"]
        if all(isinstance(item.node, Number) for item in codes):
            # They are the same each time.
            self._codes = Block(self.text)
            for item in codes:
                self._add_code(self._codes, item, item.node.value(_NO_PARAMETERS))
            self.items = [item for item in self.items if item.letter not in "GM"]
        if not self.items:
            self.constant = self._codes
        others = self.items or codes or self.comment or self.number
        self.only_sets = bool(self.settings) and not others

    def block(self, parameters: Parameters) -> Block:
        """Work out all words.

        Raises
        ------
        Fault
            If a value cannot be worked out, or a code is none.
        """
        if self.constant is not None:
            return self.constant
        block = Block(self.text)
        block.g, block.m = self._codes.g, self._codes.m
        words = block.words
        for item in self.items:
            letter = item[0]
            value = item[1].value(parameters)
            if letter == "G" or letter == "M":
                block.g, block.m = block.g.copy(), block.m.copy()
                self._add_code(block, item, value)
            else:
                words[letter] = value
        return block

    def _add_code(self, block: Block, item: _Item, value: float) -> None:
        """Add a G or M code to a block."""
        letter, _, _, start, end = item
        if letter == "G":
            code, codes, slack = 10 * value, block.g, 10 * EQUAL
            message = "a G code has one decimal at most"
        else:
            code, codes, slack, message = value, block.m, EQUAL, "an M code is a whole number"
        if abs(code - round(code)) > slack:
            assert self._reader is not None
            self._reader.fail(message, start, end)
        codes.append(round(code))

    def set_parameters(self, parameters: Parameters) -> None:
        """Work out the parameters that it sets, then set them.

        Raises
        ------
        Fault
            If a value cannot be worked out, or a parameter cannot be set.
        """
        if len(self.settings) == 1:
            key, node = self.settings[0]
            value = node.value(parameters)
            if type(key) is Named and key.local:
                parameters.local[key.name] = value
                return
            values = [(key, value)]
        else:
            values = [(key, node.value(parameters)) for key, node in self.settings]
        named = [(key.key(parameters), value, key.span) for key, value in values]
        for name, value, span in named:
            parameters.check(name, span)
            parameters.set(name, value)


def read_line(text: str) -> Line | None:
    """Read one line; None if there is nothing in it.

    Raises
    ------
    Fault
        If the line is not RS274/NGC, with its column.
    """
    if not text.isascii():  # upper() may turn other letters into ours
        return _Reader(text).read()
    plain = _COMMENT.sub(_GAP, text) if "(" in text or ";" in text else text
    squeezed = "".join(plain.split()).upper()
    line = Line(text)
    if squeezed[:1] == "N":
        number = _LINE_NUMBER.match(squeezed)
        if number:
            squeezed, line.number = squeezed[number.end() :], number[1]
    block = Block(text)
    words, g, m = block.words, block.g, block.m
    try:
        for letter, value in _WORDS.findall(squeezed):
            if letter == "G":
                g.append(_G_TEXTS[value])
            elif letter in VALUE_LETTERS and letter not in words:
                words[letter] = float(value)
            elif letter == "M":
                m.append(int(value))
            elif letter != _GAP or value:
                break
        else:
            if len(squeezed) < 300:  # then no number reaches infinity
                line.constant = block
                if plain is not text and "(" in text:
                    line.comment = _last_comment(text)
                    if "(" in plain or ")" in plain:
                        return _Reader(text).read()
                if not (words or g or m or line.comment or line.number):
                    return None
                return line
    except (ValueError, KeyError):
        pass
    return _Reader(text).read()


def _last_comment(text: str) -> Comment | None:
    comments = [c for c in _COMMENT.findall(text) if c.startswith("(")]
    if not comments or comments[-1] == "()":
        return None
    message = _MESSAGE.fullmatch(comments[-1])
    if message:
        return Comment((message[1] or message[3]).lower(), message[2] or "")
    return Comment("comment", comments[-1][1:-1].lstrip())


class _Reader:
    """Reads one line with care: every fault has its column."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0  # in self.line
        self.nesting = 0
        self.number = ""
        bare = "".join(_COMMENT.sub(_GAP, text).split())
        self.line = bare.upper() if bare.isascii() else "".join(map(_ascii_upper, bare))

    @cached_property
    def columns(self) -> list[int]:
        """The column of each character of ``line``, and of what follows the last."""
        comments = {match.start(): match.end() for match in _COMMENT.finditer(self.text)}
        columns = []
        i = 0
        while i < len(self.text):
            if not self.text[i].isspace():
                columns.append(i + 1)
            i = comments.get(i, i + 1)
        return [*columns, len(self.text.rstrip()) + 1]

    def place(self, start: int, end: int) -> tuple[int, str]:
        """Return the column and the text of characters of the squeezed line."""
        first = self.columns[start]
        text = self.text[first - 1 : self.columns[end] - 1].strip()
        return first, text if len(text) <= 60 else f"{text[:57]}..."

    def fail(self, message: str, start: int, end: int | None = None) -> NoReturn:
        """Raise a fault at the characters from ``start`` to ``end``, or to the reading point."""
        end = max(self.at if end is None else end, start + 1)
        raise Fault(message, *self.place(start, end))

    def read(self) -> Line | None:
        """Return the line; None if there is nothing in it."""
        line = Line(self.text)
        line.deleted = self.line.startswith("/")
        self._start()
        line.number = self.number
        line.comment = _last_comment(self.text)
        if self.line[self.at : self.at + 1] == "O":
            line.flow = self._flow()
        else:
            line.hold(list(self.items()), self)
        return line if line.asks or line.flow or line.comment or line.number else None

    def _start(self) -> None:
        """Read a slash and a line number; refuse broken comments."""
        for parenthesis, message in (
            ("(", "a comment is not closed, or holds another ("),
            (")", "no comment begins before this )"),
        ):
            if parenthesis in self.line:
                self.fail(message, self.line.index(parenthesis))
        self.at = 1 if self.line.startswith("/") else 0
        if number := _LINE_NUMBER.match(self.line, self.at):
            self.at, self.number = number.end(), number[1]

    def items(self) -> Iterable[_Item]:
        """Read the words and settings of the line."""
        if self.at == 0:
            self._start()
        seen: set[str] = set()
        while self.at < len(self.line):
            start, letter = self.at, self.line[self.at]
            self.at += 1
            if letter == _GAP:
                continue
            if letter == "#":
                yield self._setting(start)
                continue
            if letter == "N":
                self.fail("a line number N stands at the beginning of its line", start)
            if letter == "O":
                self.fail("an O word stands at the beginning of its line", start)
            if letter not in VALUE_LETTERS and letter not in "GM":
                self.fail(
                    f"unexpected character {letter!r}; a word is a letter and a number", start
                )
            node = self._value()
            if letter in seen and letter not in "GM":
                self.fail(f"a second {letter} word in one line; a letter may stand once", start)
            seen.add(letter)
            yield _Item(letter, node, None, start, self.at)

    def _flow(self) -> OWord:
        """Read what follows O."""
        start = self.at
        self.at += 1
        label: Label | None = None
        node: Node | None = None
        c = self.line[self.at : self.at + 1]
        if c == "<":
            end = self.line.find(">", self.at)
            if end < 0:
                self.fail("> is missing after the name", start, len(self.line))
            label, self.at = self.line[self.at + 1 : end].lower(), end + 1
            if label.isdigit() and (label == "0" or label[0] != "0"):
                label = int(label)  # o<12> is o12
        elif c.isdigit():
            match = _NUMBER.match(self.line, self.at)
            assert match is not None
            if "." in match[0]:
                self.fail("the number of an O word is whole", start, match.end())
            label, self.at = int(match[0]), match.end()
        elif c in ("#", "["):
            node = self._value()
        else:
            self.fail("a number, #, [ or <name> is missing after O", start)
        rest = self.line[self.at :].replace(_GAP, "")
        match = _KEYWORD.match(self.line, self.at)
        if match is None:
            if rest or node is not None:
                known = "sub, call, return, if, while, do, repeat, break or continue"
                self.fail(f"after this label there is no {known}", start, len(self.line))
            return OWord("", label, node, (), Span(self, start, self.at))
        keyword = match[0]
        self.at = match.end()
        if node is not None and keyword != "CALL":
            self.fail("a label that is worked out works with call alone", start, self.at)
        head = self.at
        values: list[Node] = []
        while self.at < len(self.line):
            if self.line[self.at] == _GAP:
                self.at += 1
            elif (
                self.line[self.at] == "["
                and (keyword in _WITH_VALUES or (keyword in _WITH_VALUE and not values))
            ) or (keyword in _WITH_VALUE and not values):
                values.append(self._value())
            else:
                self.fail(f"this does not belong to {keyword.lower()}", self.at, len(self.line))
        if keyword in _WITH_VALUE and not values:
            self.fail(f"{keyword.lower()} needs a value: [...]", start, head)
        if keyword != "CALL" and len(values) > 1:
            self.fail(f"{keyword.lower()} takes one value", start, self.at)
        return OWord(keyword, label, node, tuple(values), Span(self, start, self.at))

    def _setting(self, start: int) -> _Item:
        key = self._key()
        if self.line[self.at : self.at + 1] != "=":
            self.fail("= is missing; a parameter is set as in #1=2.5", start)
        self.at += 1
        return _Item("#", self._value(), key, start, self.at)

    def _value(self) -> Node:
        """Read a number, parameter, expression or function, perhaps with a sign."""
        self.nesting += 1
        if self.nesting > MAX_NESTING:
            self.fail(f"brackets, signs or # are nested deeper than {MAX_NESTING}", self.at - 1)
        node = self._operand()
        self.nesting -= 1
        return node

    def _operand(self) -> Node:
        start = self.at
        c = self.line[start : start + 1]
        if c in ("+", "-"):
            self.at += 1
            node = self._value()
            if c == "+":
                return node
            return Number(-node.number) if isinstance(node, Number) else Negative(node)
        if number := _NUMBER.match(self.line, start):
            self.at = number.end()
            try:
                value = float(number[0])
            except ValueError:
                self.fail(f"'{number[0]}' is not a number", start)
            if math.isinf(value):
                self.fail("the number is too large", start)
            return Number(value)
        if c == "[":
            return self._expression()
        if c == "#":
            self.at += 1
            return self._key()
        name = _NAME.match(self.line, start)
        if name is None:
            self._miss_number(start)
        return self._function(name[0], start)

    def _miss_number(self, start: int) -> NoReturn:
        before = self.line[start - 1]
        self.fail(f"a number is missing after {before}", start - 1, start)

    def _expression(self) -> Node:
        start = self.at
        if self.line[start : start + 1] != "[":
            self.fail("[ is missing", max(start - 1, 0), start)
        self.at += 1
        node = self._operation(0)
        if self.line[self.at : self.at + 1] != "]":
            self.fail("an operator or ] is missing", start)
        self.at += 1
        return node

    def _operation(self, floor: int) -> Node:
        """Read operands joined by operators that bind tighter than ``floor``."""
        left = self._value()
        while match := _OPERATOR.match(self.line, self.at):
            binding, function = BINARY[match[0]]
            if binding <= floor:
                break
            self.at = match.end()
            right = self._operation(binding)
            left = Binary(function, left, right, Span(self, match.start(), self.at))
        return left

    def _function(self, name: str, start: int) -> Node:
        self.at = start + len(name)
        if name == "ATAN":
            y = self._expression()
            if self.line[self.at : self.at + 1] != "/":
                self.fail("ATAN needs two arguments: ATAN[y]/[x]", start)
            self.at += 1
            return Arctangent(y, self._expression())
        if name == "EXISTS":
            if self.line[self.at : self.at + 2] != "[#":
                self.fail("EXISTS needs a parameter: EXISTS[#<name>]", start)
            self.at += 2
            known = self._key()
            if self.line[self.at : self.at + 1] != "]":
                self.fail("] is missing", start)
            self.at += 1
            return Exists(known)
        if name not in FUNCTIONS:
            if self.line[self.at : self.at + 1] != "[":
                self._miss_number(start)
            functions = ", ".join(sorted([*FUNCTIONS, "ATAN", "EXISTS"]))
            self.fail(f"unknown function; there are {functions}", start)
        node = self._expression()
        return Function(FUNCTIONS[name], node, Span(self, start, self.at))

    def _key(self) -> Numbered | Named:
        """Read what follows #: a name or an index."""
        start = self.at - 1
        if self.line[self.at : self.at + 1] == "<":
            end = self.line.find(">", self.at)
            if end < 0:
                self.fail("> is missing after the name of a parameter", start, len(self.line))
            name = self.line[self.at + 1 : end]
            self.at = end + 1
            return Named(name, Span(self, start, self.at))
        node = self._value()
        span = Span(self, start, self.at)
        if isinstance(node, Number) and node.number in _FIXED:
            return Fixed(int(node.number), span)
        return Numbered(node, span)


def _ascii_upper(c: str) -> str:
    return c.upper() if c.isascii() else c


_NO_PARAMETERS: Final = Parameters()
