"""From a line of text to a `Block`: words, codes, parameter settings, comments.

Spaces and the case of letters mean nothing, so a line is first squeezed. Most lines of most
programs are words with plain numbers: one regular expression reads those. All others, and all
that are wrong, go through `_Reader`, which also knows columns.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Container, Sequence
from contextlib import suppress
from functools import cached_property
from typing import Final, NamedTuple, NoReturn

from pulsewright.motion.gcode.codes import G_GROUPS

LAST_PARAMETER: Final = 5602
EQUAL: Final = 1e-4  # EQ and NE, and how far an "integer" may be off
MAX_NESTING: Final = 50  # values within values; far from Python's own recursion limit

# Letters with a value; G, M, N and O are read on their own.
VALUE_LETTERS: Final = frozenset("ABCDEFHIJKLPQRSTUVWXYZ")
_OTHER_LETTERS: Final = {
    "O": "O (subroutines, loops, conditions)",
    "@": "@ (polar coordinates)",
    "^": "^ (polar coordinates)",
    "$": "$ (choosing a spindle)",
}

_WORDS: Final = re.compile(r"(.)([+-]?[0-9.]*)")
_LINE_NUMBER: Final = re.compile(r"N[0-9]+(?:\.[0-9]*)?")
_NUMBER: Final = re.compile(r"[0-9.]+")
_NAME: Final = re.compile(r"[A-Z]+")
_OPERATOR: Final = re.compile(r"\*\*|[*/+-]|MOD|EQ|NE|GT|GE|LT|LE|AND|OR|XOR")
_COMMENT: Final = re.compile(r"\([^()]*\)|;.*")
_MESSAGE: Final = re.compile(r"\(\s*(msg|debug|print),([^()]*)\)", re.IGNORECASE)
_MESSAGE_PART: Final = re.compile(r"#<([^>]*)>|#([0-9]{1,9})|%(?:d|(?:\.([0-9]))?f)")
_GAP: Final = ";"  # stands for a comment, so that words do not grow together across it

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
        """Return a value; None for a name that was never set or a number that does not exist."""
        if isinstance(key, str):
            return self.named.get(key)
        if self.FIRST_POSITION <= key < self.FIRST_POSITION + 6:
            return self._position(key - self.FIRST_POSITION)
        return self.numbered[key] if 1 <= key <= LAST_PARAMETER else None

    def set(self, key: int | str, value: float) -> None:
        """Set a value; ``key`` is what `_Reader` let pass."""
        if isinstance(key, str):
            self.named[key] = value
        else:
            self.numbered[key] = value

    def fill_in(self, text: str) -> str:
        """Return the text of a message with values for ``#1`` and ``#<name>``.

        ``%d``, ``%f`` (4 decimals) and ``%.2f`` set the decimals of what follows; else there are 6.
        A parameter that is not set shows as ``######``. Several spaces become one.
        """
        decimals = 6

        def replace(match: re.Match[str]) -> str:
            nonlocal decimals
            name, number, digits = match.groups()
            if name is None and number is None:
                decimals = 0 if match[0] == "%d" else int(digits or 4)
                return ""
            key = int(number) if name is None else "".join(name.split()).upper()
            value = self.get(key)
            return "######" if value is None else f"{value:.{decimals}f}"

        return " ".join(_MESSAGE_PART.sub(replace, text).split())


class _Word(NamedTuple):
    letter: str
    value: float
    start: int  # in the squeezed line
    end: int


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
        Parameters to set once the line is read.
    messages : sequence of (kind, text)
        Comments that are messages; the kind is "msg", "debug" or "print".
    """

    __slots__ = ("_parameters", "g", "m", "messages", "settings", "text", "words")

    def __init__(self, text: str, parameters: Parameters) -> None:
        self.text = text
        self._parameters = parameters
        self.words: dict[str, float] = {}
        self.g: list[int] = []
        self.m: list[int] = []
        self.settings: Sequence[tuple[int | str, float]] = ()
        self.messages: Sequence[tuple[str, str]] = ()

    def fault(self, message: str, letters: Container[str], code: int | None = None) -> Fault:
        """Return a fault at the first word with one of ``letters``; a G or M word counts by code.

        Places of words are known to the slow reader alone, so the line is read again.
        """
        with suppress(Fault):  # a parameter set by this very line may have made it unreadable
            reader = _Reader(self.text, self._parameters)
            for word in reader.words():
                value = round(10 * word.value if word.letter == "G" else word.value)
                if word.letter in letters and (word.letter not in "GM" or code in (None, value)):
                    return Fault(message, *reader.place(word.start, word.end))
        return Fault(message, 1 + len(self.text) - len(self.text.lstrip()), self.text.strip())


def read_block(text: str, parameters: Parameters, *, skip_deleted: bool = False) -> Block | None:
    """Read one line; None if it asks for nothing.

    With ``skip_deleted`` a line that begins with ``/`` asks for nothing.

    Raises
    ------
    Fault
        If the line is not RS274/NGC, with its column.
    """
    if not text.isascii():  # upper() may turn other letters into ours
        return _Reader(text, parameters).block(skip_deleted)
    plain = text
    if ("(" in text or ";" in text) and not _MESSAGE.search(text):
        plain = _COMMENT.sub(_GAP, text)
    squeezed = "".join(plain.split()).upper()
    if squeezed[:1] == "N":
        number = _LINE_NUMBER.match(squeezed)
        squeezed = squeezed[number.end() :] if number else squeezed
    if not squeezed.strip(_GAP):
        return None
    block = Block(text, parameters)
    words, g = block.words, block.g
    try:
        for letter, value in _WORDS.findall(squeezed):
            if letter == "G":
                g.append(_G_TEXTS[value])
            elif letter in VALUE_LETTERS and letter not in words:
                words[letter] = float(value)
            elif letter != _GAP or value:
                break
        else:
            if len(squeezed) < 300:  # then no number reaches infinity
                return block
    except (ValueError, KeyError):
        pass
    return _Reader(text, parameters).block(skip_deleted)


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
        self.at = 0  # in self.line
        self.nesting = 0
        self.settings: list[tuple[int | str, float]] = []
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

    def block(self, skip_deleted: bool) -> Block | None:
        """Return the line as a block; None if it asks for nothing."""
        if skip_deleted and self.line.startswith("/"):
            return None
        block = Block(self.text, self.parameters)
        for word in self.words():
            if word.letter == "G":
                block.g.append(round(10 * word.value))
            elif word.letter == "M":
                block.m.append(round(word.value))
            else:
                block.words[word.letter] = word.value
        block.settings = self.settings
        if "(" in self.text:
            comments = map(_MESSAGE.fullmatch, _COMMENT.findall(self.text))
            block.messages = [(m[1].lower(), m[2].strip()) for m in comments if m]
        asks = block.words or block.g or block.m or block.settings or block.messages
        return block if asks else None

    def words(self) -> list[_Word]:
        """Read the line; leave parameter settings in ``self.settings``."""
        for parenthesis, message in (
            ("(", "a comment is not closed, or holds another ("),
            (")", "no comment begins before this )"),
        ):
            if parenthesis in self.line:
                self.fail(message, self.line.index(parenthesis))
        words: list[_Word] = []
        seen: set[str] = set()
        self.at = 1 if self.line.startswith("/") else 0
        if number := _LINE_NUMBER.match(self.line, self.at):
            self.at = number.end()
        while self.at < len(self.line):
            start, letter = self.at, self.line[self.at]
            self.at += 1
            if letter == _GAP:
                continue
            if letter == "#":
                self._setting(start)
                continue
            if letter in _OTHER_LETTERS:
                self.fail(f"{_OTHER_LETTERS[letter]} is not supported yet", start, len(self.line))
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
            words.append(_Word(letter, value, start, self.at))
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
        self.nesting += 1
        if self.nesting > MAX_NESTING:
            self.fail(f"brackets, signs or # are nested deeper than {MAX_NESTING}", self.at - 1)
        value = self._operand()
        self.nesting -= 1
        return value

    def _operand(self) -> float:
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
            self._miss_number(start)
        return self._function(name[0], start)

    def _miss_number(self, start: int) -> NoReturn:
        before = self.line[start - 1]
        self.fail(f"a number is missing after {before}", start - 1, start)

    def _expression(self) -> float:
        start = self.at
        if self.line[start : start + 1] != "[":
            self.fail("[ is missing", max(start - 1, 0), start)
        self.at += 1
        value = self._operation(0)
        if self.line[self.at : self.at + 1] != "]":
            self.fail("an operator or ] is missing", start)
        self.at += 1
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
            known = self.parameters.get(self._key(must_exist=False)) is not None
            if self.line[self.at : self.at + 1] != "]":
                self.fail("] is missing", start)
            self.at += 1
            return float(known)
        if name not in _FUNCTIONS:
            if self.line[self.at : self.at + 1] != "[":
                self._miss_number(start)
            functions = ", ".join(sorted([*_FUNCTIONS, "ATAN", "EXISTS"]))
            self.fail(f"unknown function; there are {functions}", start)
        return self._apply(_FUNCTIONS[name], start, self._expression())

    def _key(self, *, must_exist: bool = True) -> int | str:
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
        if must_exist and not 1 <= index <= LAST_PARAMETER:
            self.fail(f"parameter #{index} does not exist; they are 1 to {LAST_PARAMETER}", start)
        return index

    def _parameter(self, start: int) -> float:
        key = self._key()
        value = self.parameters.get(key)
        if value is None:
            hint = "; predefined ones are not supported yet" if str(key).startswith("_") else ""
            self.fail(f"parameter #<{str(key).lower()}> has not been set{hint}", start)
        return value


def _ascii_upper(c: str) -> str:
    return c.upper() if c.isascii() else c
