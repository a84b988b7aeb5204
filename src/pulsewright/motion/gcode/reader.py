"""From a line of text to a `Block`: words, codes, parameter settings, comments.

Spaces and the case of letters mean nothing, so a line is first squeezed. Most lines of most
programs are words with plain numbers: one regular expression reads those. All others, and all
that are wrong, go through `_Reader`, which also knows columns.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Final, NamedTuple, NoReturn

from pulsewright.motion.gcode.codes import G_GROUPS

LAST_PARAMETER: Final = 5602
EQUAL: Final = 1e-4  # EQ and NE, and how far an "integer" may be off
MAX_NESTING: Final = 50  # brackets within brackets; far from Python's own recursion limit

# Letters with a value; G, M, N and O are read on their own.
VALUE_LETTERS: Final = frozenset("ABCDEFHIJKLPQRSTUVWXYZ")
_OTHER_LETTERS: Final = {
    "O": "O-words (subroutines, loops, conditions)",
    "@": "polar coordinates",
    "^": "polar coordinates",
    "$": "choosing a spindle with $",
}

_WORDS: Final = re.compile(r"(.)([+-]?[0-9.]*)")
_LINE_NUMBER: Final = re.compile(r"N[0-9]+(?:\.[0-9]*)?")
_NUMBER: Final = re.compile(r"[0-9.]+")
_NAME: Final = re.compile(r"[A-Z]+")
_OPERATOR: Final = re.compile(r"\*\*|[*/+-]|MOD|EQ|NE|GT|GE|LT|LE|AND|OR|XOR")
_MESSAGE: Final = re.compile(r"\s*(msg|debug|print)\s*,(.*)", re.IGNORECASE | re.DOTALL)
_MESSAGE_VALUE: Final = re.compile(r"#(?:<([^>]*)>|([0-9]+))")

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


class Fault(Exception):  # noqa: N818 - becomes a GcodeError where path and line are known
    """What is wrong with a line; columns count from 1, 0 is the whole line."""

    def __init__(self, message: str, column: int = 0, text: str = "") -> None:
        super().__init__(message)
        self.message, self.column, self.text = message, column, text


class Parameters:
    """Numbered and named parameters.

    Parameters
    ----------
    position : callable
        Gives #5420 to #5425, the program position of an axis by its column; cannot be set.
    """

    FIRST_POSITION: Final = 5420

    def __init__(self, position: Callable[[int], float]) -> None:
        self.numbered = [0.0] * (LAST_PARAMETER + 1)
        self.named: dict[str, float] = {}
        self._position = position

    def get(self, key: int | str) -> float | None:
        """Return a value, None for a name that was never set."""
        if isinstance(key, str):
            return self.named.get(key)
        if self.FIRST_POSITION <= key < self.FIRST_POSITION + 6:
            return self._position(key - self.FIRST_POSITION)
        return self.numbered[key]

    def set(self, key: int | str, value: float) -> None:
        """Set a value; ``key`` is what `_Reader` let pass."""
        if isinstance(key, str):
            self.named[key] = value
        else:
            self.numbered[key] = value


class _Word(NamedTuple):
    letter: str
    value: float
    column: int
    text: str


class Block:
    """One line, read.

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
    settings : sequence of (key, value)
        Parameters to set at the end of the line.
    messages : sequence of str
        Texts of message comments.
    """

    __slots__ = ("_parameters", "g", "m", "messages", "settings", "text", "words")

    def __init__(self, text: str, parameters: Parameters) -> None:
        self.text = text
        self._parameters = parameters
        self.words: dict[str, float] = {}
        self.g: list[int] = []
        self.m: list[int] = []
        self.settings: Sequence[tuple[int | str, float]] = ()
        self.messages: Sequence[str] = ()

    def __bool__(self) -> bool:
        """Whether the line asks for anything."""
        return bool(self.words or self.g or self.m or self.settings or self.messages)

    def fault(self, message: str, letters: Iterable[str] = (), code: int | None = None) -> Fault:
        """Return a fault at the first word with one of ``letters``, of G or M words with ``code``.

        Places of words are known to the slow reader alone, so the line is read again.
        """
        with suppress(Fault):  # a parameter set by this very line may have made it unreadable
            for word in _Reader(self.text, self._parameters).words():
                value = round(10 * word.value if word.letter == "G" else word.value)
                if word.letter in letters and code in (None, value):
                    return Fault(message, word.column, word.text)
        return Fault(message, 1 + len(self.text) - len(self.text.lstrip()), self.text.strip())


def read_block(text: str, parameters: Parameters, *, skip_deleted: bool = False) -> Block:
    """Read one line; with ``skip_deleted`` a line that begins with ``/`` is empty.

    Raises
    ------
    Fault
        If the line is not RS274/NGC, with its column.
    """
    block = Block(text, parameters)
    if not text.isascii():  # upper() may turn other letters into ours
        return _Reader(text, parameters).block(block, skip_deleted)
    squeezed = "".join(text.split()).upper()
    if squeezed[:1] == "N":
        number = _LINE_NUMBER.match(squeezed)
        squeezed = squeezed[number.end() :] if number else squeezed
    words, g = block.words, block.g
    try:
        for letter, value in _WORDS.findall(squeezed):
            if letter == "G":
                g.append(_G_TEXTS[value])
            elif letter in VALUE_LETTERS and letter not in words:
                words[letter] = float(value)
            else:
                break
        else:
            if len(squeezed) < 300:  # then no number reaches infinity
                return block
    except (ValueError, KeyError):
        pass
    return _Reader(text, parameters).block(Block(text, parameters), skip_deleted)


def _power(left: float, right: float) -> float:
    if left < 0 and right != round(right):
        raise ValueError("Python would go complex")
    return float(left**right)


def _modulo(left: float, right: float) -> float:
    remainder = math.fmod(left, right)
    return remainder + abs(right) if remainder < 0 else remainder


# Operators bind tighter with a higher number, and to the left among equals.
_BINARY: Final[dict[str, tuple[int, Callable[[float, float], float]]]] = {
    "**": (5, _power),
    "*": (4, operator.mul),
    "/": (4, operator.truediv),
    "MOD": (4, _modulo),
    "+": (3, operator.add),
    "-": (3, operator.sub),
    "EQ": (2, lambda a, b: float(abs(a - b) < EQUAL)),
    "NE": (2, lambda a, b: float(abs(a - b) >= EQUAL)),
    "GT": (2, lambda a, b: float(a > b)),
    "GE": (2, lambda a, b: float(a >= b)),
    "LT": (2, lambda a, b: float(a < b)),
    "LE": (2, lambda a, b: float(a <= b)),
    "AND": (1, lambda a, b: float(a != 0 and b != 0)),
    "OR": (1, lambda a, b: float(a != 0 or b != 0)),
    "XOR": (1, lambda a, b: float((a != 0) != (b != 0))),
}

_FUNCTIONS: Final[dict[str, Callable[[float], float]]] = {
    "ABS": abs,
    "ACOS": lambda x: math.degrees(math.acos(x)),
    "ASIN": lambda x: math.degrees(math.asin(x)),
    "COS": lambda x: math.cos(math.radians(x)),
    "EXP": math.exp,
    "FIX": lambda x: float(math.floor(x)),
    "FUP": lambda x: float(math.ceil(x)),
    "LN": math.log,
    "ROUND": lambda x: math.copysign(math.floor(abs(x) + 0.5), x),
    "SIN": lambda x: math.sin(math.radians(x)),
    "SQRT": math.sqrt,
    "TAN": lambda x: math.tan(math.radians(x)),
}


class _Reader:
    """Reads one line with care: every fault has its column."""

    def __init__(self, text: str, parameters: Parameters) -> None:
        self.text = text
        self.parameters = parameters
        self.comments: list[str] = []
        self.at = 0  # in self.line
        self.nesting = 0
        self.settings: list[tuple[int | str, float]] = []
        self.line, self.columns = self._squeeze()

    def _squeeze(self) -> tuple[str, list[int]]:
        """Return the line in capitals without spaces and comments, and each character's column.

        A comment leaves its ``(``, so that words do not grow together across it.
        """
        text, kept, columns = self.text, [], []
        i = 0
        while i < len(text):
            c = text[i]
            if c == ";":
                self.comments.append(text[i + 1 :])
                text = text[:i]
                break
            if not c.isspace():
                kept.append(c.upper() if c.isascii() else c)
                columns.append(i + 1)
            if c == "(":
                end = text.find(")", i)
                if end < 0:
                    raise Fault("a comment is not closed; ) is missing", i + 1, text[i:].strip())
                nested = text.find("(", i + 1, end)
                if nested >= 0:
                    raise Fault("a comment holds another (", nested + 1, text[i : end + 1])
                self.comments.append(text[i + 1 : end])
                i = end
            i += 1
        columns.append(len(text.rstrip()) + 1)
        return "".join(kept), columns

    def fail(self, message: str, start: int, end: int | None = None) -> NoReturn:
        """Raise a fault that names the characters from ``start`` to ``end`` (the reading point)."""
        end = max(self.at if end is None else end, start + 1)
        text = self.text[self.columns[start] - 1 :] if start < len(self.line) else ""
        if end < len(self.columns):
            text = text[: self.columns[end] - self.columns[start]]
        raise Fault(message, self.columns[start], text.strip())

    def block(self, block: Block, skip_deleted: bool) -> Block:
        """Fill a block."""
        if skip_deleted and self.line.startswith("/"):
            return block
        for word in self.words():
            if word.letter == "G":
                block.g.append(round(10 * word.value))
            elif word.letter == "M":
                block.m.append(round(word.value))
            else:
                block.words[word.letter] = word.value
        block.settings = self.settings
        block.messages = [
            self._message(match[2], verbatim=match[1].lower() == "msg")
            for match in map(_MESSAGE.fullmatch, self.comments)
            if match
        ]
        return block

    def words(self) -> list[_Word]:
        """Read the line; leave parameter settings in ``self.settings``."""
        words: list[_Word] = []
        seen: set[str] = set()
        self.at = 1 if self.line.startswith("/") else 0
        if number := _LINE_NUMBER.match(self.line, self.at):
            self.at = number.end()
        while self.at < len(self.line):
            start, letter = self.at, self.line[self.at]
            self.at += 1
            if letter == "(":
                continue
            if letter == "#":
                self._setting(start)
                continue
            if letter in _OTHER_LETTERS:
                self.fail(f"{_OTHER_LETTERS[letter]} are not supported yet", start, len(self.line))
            if letter == "N":
                self.fail("a line number N stands at the beginning of its line", start)
            if letter not in VALUE_LETTERS and letter not in "GM":
                self.fail(
                    f"unexpected character {letter!r}; a word is a letter and a number", start
                )
            value = self._value()
            if letter == "G" and abs(10 * value - round(10 * value)) > 10 * EQUAL:
                self.fail("a G code has one decimal at most", start)
            if letter == "M" and abs(value - round(value)) > EQUAL:
                self.fail("an M code is a whole number", start)
            if letter in seen and letter not in "GM":
                self.fail(f"a second {letter} word in one line; a letter may stand once", start)
            seen.add(letter)
            text = self.text[self.columns[start] - 1 : self.columns[self.at - 1]]
            words.append(_Word(letter, value, self.columns[start], text.strip()))
        return words

    def _setting(self, start: int) -> None:
        key = self._key()
        if self.line[self.at : self.at + 1] != "=":
            self.fail("= is missing; a parameter is set as in #1=2.5", start)
        self.at += 1
        first = Parameters.FIRST_POSITION
        if isinstance(key, int) and first <= key < first + 6:
            self.fail(f"parameter #{key} is the position; it cannot be set", start)
        self.settings.append((key, self._value()))

    def _value(self) -> float:
        """Read a number, parameter, expression or function, perhaps with a sign."""
        start = self.at
        c = self.line[start : start + 1]
        if c in ("+", "-"):
            self.at += 1
            value = self._value()
            return -value if c == "-" else value
        if number := _NUMBER.match(self.line, start):
            self.at = number.end()
            try:
                value = float(number[0])
            except ValueError:
                self.fail(f"'{number[0]}' is not a number", start)
            if math.isinf(value):
                self.fail("the number is too large", start)
            return value
        if c == "[":
            return self._expression()
        if c == "#":
            self.at += 1
            return self._parameter(start)
        name = _NAME.match(self.line, start)
        if name is None:
            self.fail("a number is missing", max(start - 1, 0), start)
        return self._function(name[0], start)

    def _expression(self) -> float:
        start = self.at
        if self.line[start : start + 1] != "[":
            self.fail("[ is missing", max(start - 1, 0), start)
        self.nesting += 1
        if self.nesting > MAX_NESTING:
            self.fail(f"brackets are nested deeper than {MAX_NESTING}", start)
        self.at += 1
        value = self._operation(0)
        if self.line[self.at : self.at + 1] != "]":
            self.fail("an operator or ] is missing", start)
        self.at += 1
        self.nesting -= 1
        return value

    def _operation(self, floor: int) -> float:
        """Read operands joined by operators that bind tighter than ``floor``."""
        left = self._value()
        while match := _OPERATOR.match(self.line, self.at):
            binding, function = _BINARY[match[0]]
            if binding <= floor:
                break
            self.at = match.end()
            right = self._operation(binding)
            left = self._apply(function, match.start(), left, right)
        return left

    def _apply(self, function: Callable[..., float], start: int, *values: float) -> float:
        try:
            result = function(*values)
        except ZeroDivisionError:
            self.fail("division by zero", start)
        except (ValueError, OverflowError):
            self.fail(f"no result for {', '.join(f'{v:g}' for v in values)}", start)
        if not math.isfinite(result):
            self.fail("the result is too large", start)
        return result

    def _function(self, name: str, start: int) -> float:
        self.at = start + len(name)
        if name == "ATAN":
            y = self._expression()
            if self.line[self.at : self.at + 1] != "/":
                self.fail("ATAN needs two arguments: ATAN[y]/[x]", start)
            self.at += 1
            return math.degrees(math.atan2(y, self._expression()))
        if name == "EXISTS":
            if self.line[self.at : self.at + 2] != "[#":
                self.fail("EXISTS needs a parameter: EXISTS[#<name>]", start)
            self.at += 2
            known = self.parameters.get(self._key()) is not None
            if self.line[self.at : self.at + 1] != "]":
                self.fail("] is missing", start)
            self.at += 1
            return float(known)
        if name not in _FUNCTIONS:
            if self.line[self.at : self.at + 1] != "[":
                self.fail("a number is missing", max(start - 1, 0), start)
            known = ", ".join(sorted([*_FUNCTIONS, "ATAN", "EXISTS"]))
            self.fail(f"unknown function; there are {known}", start)
        return self._apply(_FUNCTIONS[name], start, self._expression())

    def _key(self) -> int | str:
        """Read what follows #: a name or an index."""
        start = self.at - 1
        if self.line[self.at : self.at + 1] == "<":
            end = self.line.find(">", self.at)
            if end < 0:
                self.fail("> is missing after the name of a parameter", start, len(self.line))
            name = self.line[self.at + 1 : end]
            self.at = end + 1
            return name
        value = self._value()
        index = round(value)
        if abs(value - index) > EQUAL:
            self.fail(f"a parameter has a whole number, not {value:g}", start)
        if not 1 <= index <= LAST_PARAMETER:
            self.fail(f"parameter #{index} does not exist; they are 1 to {LAST_PARAMETER}", start)
        return index

    def _parameter(self, start: int) -> float:
        key = self._key()
        value = self.parameters.get(key)
        if value is None:
            hint = "; predefined ones are not supported yet" if str(key).startswith("_") else ""
            self.fail(f"parameter #<{str(key).lower()}> has not been set{hint}", start)
        return value

    def _message(self, text: str, *, verbatim: bool) -> str:
        """Return the text of a message, with the values of its parameters."""

        def value_of(match: re.Match[str]) -> str:
            name, number = match.groups()
            value = None
            if number is None:
                value = self.parameters.get("".join(name.split()).upper())
            elif 1 <= int(number) <= LAST_PARAMETER:
                value = self.parameters.get(int(number))
            return "######" if value is None else f"{value:.6f}"

        return text.strip() if verbatim else _MESSAGE_VALUE.sub(value_of, text).strip()
