"""Lines and values as Python functions, for loops and subroutines, which come by them often.

A function carries out all lines that only set parameters and follow each other. It sets nothing
before all values are worked out; so where anything goes wrong it has no effect, and the lines can
be carried out one by one to find the fault at its place.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

from pulsewright.motion.gcode.expressions import (
    Binary,
    Fixed,
    Function,
    Named,
    Negative,
    Node,
    Number,
    Numbered,
)
from pulsewright.motion.gcode.faults import Fault
from pulsewright.motion.gcode.parameters import READ_ONLY, Parameters
from pulsewright.motion.gcode.source import BLANK, Source

OFTEN: Final = 24  # passes after which a function has paid for its making
LONGEST: Final = 64  # lines
FAILURES: Final = (ArithmeticError, KeyError, ValueError)  # of a function that had no effect

_SIGNS: Final = {operator.add: "+", operator.sub: "-", operator.mul: "*"}


class Run(NamedTuple):
    """Lines that follow each other, and what carries them out."""

    lines: int
    function: Callable[[Parameters], None]


def run_from(source: Source, first: int) -> Run | None:
    """Return what carries out the lines from ``first`` on that only set parameters, if any can.

    Not among them are lines with parameters whose number is worked out, and with global ones, which
    the machine may give.
    """
    writer = _Writer()
    for i in range(first, min(first + LONGEST, source.count)):
        try:
            line = source.line(i, keep=True)
            fits = line is BLANK or (line.only_sets and not line.deleted)
            if not fits or not all(writer.takes(*setting) for setting in line.settings):
                break
        except Fault:  # it complains when the program comes by
            break
        writer.write(line.settings)
        writer.size += 1
    return Run(writer.size, writer.function()) if writer.held else None


def values_of(nodes: Sequence[Node]) -> Callable[[Parameters], Sequence[float]] | None:
    """Return what works out some values, if it can be made."""
    writer = _Writer()
    return writer.values(nodes) if all(map(writer.readable, nodes)) else None


class _Writer:
    """Writes one function; in it ``n`` and ``l`` are the numbered and the local parameters."""

    def __init__(self) -> None:
        self.size = 0  # lines
        self.held: dict[int | str, str] = {}  # variables for parameters set so far
        self._lines: list[str] = []
        self._checked: list[str] = []  # variables that have to be finite
        self._known: dict[str, Any] = {}  # functions by their names in the text

    def takes(self, key: Numbered | Named, node: Node) -> bool:
        """Return whether a setting can be written."""
        number = isinstance(key, Fixed) and key.index not in READ_ONLY
        return (number or (isinstance(key, Named) and key.local)) and self.readable(node)

    def readable(self, node: Node) -> bool:
        """Return whether a value can be written."""
        if isinstance(node, Binary):
            return self.readable(node.left) and self.readable(node.right)
        if isinstance(node, Negative | Function):
            return self.readable(node.node)
        return isinstance(node, Number | Fixed) or (isinstance(node, Named) and node.local)

    def write(self, settings: Any) -> None:
        """Write the settings of a line: first all values, then all parameters."""
        found: dict[int | str, str] = {}
        for key, node in settings:
            text = self._value(node)
            found[key.index if isinstance(key, Fixed) else key.name] = self._variable(text, node)
        self.held |= found

    def function(self) -> Callable[[Parameters], None]:
        """Return the function that carries out the lines."""
        return self._made([f"{self._place(key)} = {name}" for key, name in self.held.items()])

    def values(self, nodes: Sequence[Node]) -> Callable[[Parameters], Sequence[float]]:
        """Return the function that works out some values."""
        found = [self._operand(node) for node in nodes]
        return self._made([f"return [{', '.join(found)}]"])

    def _made(self, end: list[str]) -> Callable[[Parameters], Any]:
        """Return a function that works out all variables, checks them, and ends so."""
        lines = ["def run(p):", "n, l = p.numbered, p.local", *self._lines]
        if self._checked:
            zero = " + ".join(f"({name} - {name})" for name in self._checked)
            lines += [f"if {zero} != 0.0:", "    raise OverflowError"]
        names = dict(self._known)
        exec("\n    ".join(lines + end), names)
        made: Callable[[Parameters], Any] = names["run"]
        return made

    @staticmethod
    def _place(key: int | str) -> str:
        return f"n[{key}]" if isinstance(key, int) else f"l[{key!r}]"

    def _variable(self, text: str, node: Node) -> str:
        """Return a new variable for a value; what is worked out has to be finite."""
        name = f"v{len(self._lines)}"
        self._lines.append(f"{name} = {text}")
        if _worked_out(node):
            self._checked.append(name)
        return name

    def _value(self, node: Node) -> str:
        """Return the text of a value."""
        if isinstance(node, Number):
            return f"({node.number!r})"
        if isinstance(node, Negative):
            return f"(-{self._value(node.node)})"
        if isinstance(node, Binary):
            sign = _SIGNS.get(node.function)
            if sign is not None:  # what is not finite stays so
                return f"({self._value(node.left)} {sign} {self._value(node.right)})"
            left, right = self._operand(node.left), self._operand(node.right)
            if node.function is operator.truediv:
                return f"({left} / {right})"
            return f"{self._name(node.function)}({left}, {right})"
        if isinstance(node, Function):
            return f"{self._name(node.function)}({self._operand(node.node)})"
        assert isinstance(node, Fixed | Named)
        key = node.index if isinstance(node, Fixed) else node.name
        return self.held.get(key) or self._place(key)

    def _operand(self, node: Node) -> str:
        """Return the text of a value of which something finite may be made though it is not."""
        text = self._value(node)
        return self._variable(text, node) if _worked_out(node) else text

    def _name(self, function: Callable[..., float]) -> str:
        name = f"f{len(self._known)}"
        self._known[name] = function
        return name


def _worked_out(node: Node) -> bool:
    """Return whether a value is neither written down nor that of a parameter."""
    while isinstance(node, Negative):
        node = node.node
    return isinstance(node, Binary | Function)
