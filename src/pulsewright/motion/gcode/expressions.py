"""Values of words: numbers, parameters, expressions, functions.

The reader makes a tree of nodes once; `value` of its root works it out as often as the line is
carried out. A node that can fail knows its place in the line.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, NamedTuple, NoReturn, Protocol

from pulsewright.motion.gcode.faults import Fault

if TYPE_CHECKING:
    from pulsewright.motion.gcode.parameters import Parameters

EQUAL: Final = 1e-4  # EQ and NE, and how far an "integer" may be off
_INFINITY: Final = math.inf


class Text(Protocol):
    """A line that knows the columns of its characters."""

    def place(self, start: int, end: int) -> tuple[int, str]:
        """Return column and text of part of the line."""
        ...


class Span(NamedTuple):
    """Where a node stands."""

    text: Text
    start: int
    end: int

    def fail(self, message: str) -> NoReturn:
        """Raise a fault about this place."""
        raise Fault(message, *self.text.place(self.start, self.end))


class Node(Protocol):
    """A value that depends on parameters."""

    def value(self, parameters: Parameters) -> float:
        """Work it out.

        Raises
        ------
        Fault
            If there is no such parameter or result.
        """
        ...


class Number:
    """A constant."""

    __slots__ = ("number",)

    def __init__(self, number: float) -> None:
        self.number = number

    def value(self, _: Parameters) -> float:
        """Return it."""
        return self.number


class Negative:
    """A value with the other sign."""

    __slots__ = ("node",)

    def __init__(self, node: Node) -> None:
        self.node = node

    def value(self, parameters: Parameters) -> float:
        """Return it."""
        return -self.node.value(parameters)


class Numbered:
    """The parameter #n, where n is any value."""

    __slots__ = ("node", "span")

    def __init__(self, node: Node, span: Span) -> None:
        self.node, self.span = node, span

    def key(self, parameters: Parameters) -> int:
        """Return its whole number, which need not be that of a parameter."""
        value = self.node.value(parameters)
        index = round(value)
        if abs(value - index) > EQUAL:
            self.span.fail(f"a parameter has a whole number, not {value:g}")
        return index

    def value(self, parameters: Parameters) -> float:
        """Return the value of the parameter."""
        value = parameters.get(index := self.key(parameters))
        if value is None:
            parameters.refuse(index, self.span)
        return value


class Fixed(Numbered):
    """A parameter whose number is written down."""

    __slots__ = ("index",)

    def __init__(self, index: int, span: Span) -> None:
        super().__init__(Number(float(index)), span)
        self.index = index

    def key(self, _: Parameters) -> int:
        """Return its number."""
        return self.index

    def value(self, parameters: Parameters) -> float:
        """Return the value of the parameter."""
        return parameters.numbered[self.index]


class Named:
    """The parameter #<name>."""

    __slots__ = ("local", "name", "span")

    def __init__(self, name: str, span: Span) -> None:
        self.name, self.span = name, span
        self.local = not name.startswith("_")

    def key(self, _: Parameters) -> str:
        """Return the name."""
        return self.name

    def value(self, parameters: Parameters) -> float:
        """Return the value of the parameter."""
        value = parameters.local.get(self.name)  # the common case first
        if value is None:
            value = parameters.get(self.name)
            if value is None:
                parameters.refuse(self.name, self.span)
        return value


class Binary:
    """Two values and an operator between them."""

    __slots__ = ("function", "left", "right", "span")

    def __init__(
        self, function: Callable[[float, float], float], left: Node, right: Node, span: Span
    ) -> None:
        self.function, self.left, self.right, self.span = function, left, right, span

    def value(self, parameters: Parameters) -> float:
        """Return the result."""
        left, right = self.left.value(parameters), self.right.value(parameters)
        try:
            result = self.function(left, right)
        except ZeroDivisionError:
            self.span.fail("division by zero")
        except (ValueError, OverflowError):
            self.span.fail(f"no result for {left:g}, {right:g}")
        if not -_INFINITY < result < _INFINITY:
            self.span.fail("the result is too large")
        return result


class Function:
    """A function of one value."""

    __slots__ = ("function", "node", "span")

    def __init__(self, function: Callable[[float], float], node: Node, span: Span) -> None:
        self.function, self.node, self.span = function, node, span

    def value(self, parameters: Parameters) -> float:
        """Return the result."""
        argument = self.node.value(parameters)
        try:
            result = self.function(argument)
        except (ValueError, OverflowError):
            self.span.fail(f"no result for {argument:g}")
        if not -_INFINITY < result < _INFINITY:
            self.span.fail("the result is too large")
        return result


class Arctangent:
    """``ATAN[y]/[x]`` in degrees."""

    __slots__ = ("x", "y")

    def __init__(self, y: Node, x: Node) -> None:
        self.y, self.x = y, x

    def value(self, parameters: Parameters) -> float:
        """Return the angle, -180 to 180."""
        return math.degrees(math.atan2(self.y.value(parameters), self.x.value(parameters)))


class Exists:
    """``EXISTS[#<name>]``: 1 or 0."""

    __slots__ = ("parameter",)

    def __init__(self, parameter: Numbered | Named) -> None:
        self.parameter = parameter

    def value(self, parameters: Parameters) -> float:
        """Return whether the parameter has a value."""
        return float(parameters.get(self.parameter.key(parameters)) is not None)


def _power(left: float, right: float) -> float:
    if left < 0 and right != round(right):
        raise ValueError("Python would go complex")
    return float(left**right)


def _modulo(left: float, right: float) -> float:
    remainder = math.fmod(left, right)
    return remainder + abs(right) if remainder < 0 else remainder


# Operators bind tighter with a higher number, and to the left among equals.
BINARY: Final[dict[str, tuple[int, Callable[[float, float], float]]]] = {
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

FUNCTIONS: Final[dict[str, Callable[[float], float]]] = {
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
