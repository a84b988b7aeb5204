"""The text of a program: its lines, and where O-words lead."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from pulsewright.errors import GcodeError
from pulsewright.motion.gcode.faults import Fault
from pulsewright.motion.gcode.reader import Label, Line, OWord, read_line

BLANK: Final = Line("")

_PART: Final = 1 << 16  # bytes searched for line ends at once
#: A line up to its keyword, of those that divide a condition; names may hold ``else`` too.
_BRANCH: Final = re.compile(r"(?:.*>)?.*?else", re.IGNORECASE)
_O_LINE: Final = re.compile(rb"^[ \t]*(?:/[ \t]*)?(?:[nN][ \t0-9.]*)?[oO]", re.MULTILINE)

#: Keywords that end or divide a construct, with those that begin it.
_CLOSES: Final = {"ENDSUB": "SUB", "ENDIF": "IF", "ENDWHILE": "WHILE", "ENDREPEAT": "REPEAT"}
_LOOPS: Final = frozenset(("WHILE", "DO", "REPEAT"))


@dataclass(eq=False)
class Construct:
    """A subroutine, condition or loop: the lines of its parts, from 0."""

    keyword: str
    label: Label
    head: int
    branches: list[int] = field(default_factory=list)  # of elseif and else
    tail: int = -1  # of what closes it; -1 = nothing does

    @property
    def after(self) -> int:
        """The line behind it."""
        return self.tail + 1


class Source:
    """A program text.

    Parameters
    ----------
    data : bytes
        The text: UTF-8, or any 8-bit encoding where that is not valid.
    path : str
        Its name in errors.
    """

    def __init__(self, data: bytes, path: str) -> None:
        self.path = path
        if b"\r" in data:
            data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        self.data = data.removeprefix(b"\xef\xbb\xbf")
        self._encoding = "utf-8"
        if not self.data.isascii():
            try:
                self.data.decode()
            except UnicodeDecodeError:
                # Old programs have comments in 8-bit encodings; such bytes are refused elsewhere.
                self._encoding = "latin-1"
        text = np.frombuffer(self.data, np.uint8)
        parts = (text[k : k + _PART] for k in range(0, len(text), _PART))  # which stay in caches
        ends = [np.flatnonzero(part == ord("\n")) + n * _PART + 1 for n, part in enumerate(parts)]
        #: Offset of each line, and of where another would begin.
        self.starts = np.concatenate([[0], *ends, [len(self.data) + 1]]).astype(np.int64)
        self.count = len(self.starts) - 1
        #: Lines that have been read and are kept.
        self.lines: dict[int, Line] = {}

    @classmethod
    def from_file(cls, path: str | Path) -> Source:
        """Read a file.

        Raises
        ------
        GcodeError
            If it cannot be read or is not text.
        """
        path = Path(path)
        try:
            data = path.read_bytes()
        except FileNotFoundError:
            raise GcodeError("no such file", path=path) from None
        except IsADirectoryError:
            raise GcodeError("this is a directory; name a program file", path=path) from None
        except OSError as error:
            raise GcodeError(f"cannot be read: {error.strerror}", path=path) from None
        if b"\0" in data:
            raise GcodeError("this is not a text file (it holds NUL bytes)", path=path)
        return cls(data, str(path))

    def text(self, i: int) -> str:
        """Return the text of a line, from 0."""
        return self.data[self.starts[i] : self.starts[i + 1] - 1].decode(self._encoding)

    def line(self, i: int, *, keep: bool) -> Line:
        """Return a line, read; ``keep`` it for the next time. `BLANK` if there is nothing in it."""
        line = self.lines.get(i)
        if line is None:
            line = read_line(self.text(i)) or BLANK
            if keep:
                self.lines[i] = line
        return line

    # O-words

    @cached_property
    def flow(self) -> dict[int, Construct]:
        """The construct that each line with an O-word belongs to.

        Lines that belong to none are not in it: whoever comes by there may complain.
        """
        found: dict[int, Construct] = {}
        stack: list[Construct] = []
        for i, word in self._o_words():
            label = word.label
            assert label is not None
            keyword = word.keyword
            mine = [c for c in stack if c.label == label]
            inner = mine[-1] if mine else None
            if keyword == "WHILE" and inner is not None and inner.keyword == "DO":
                keyword = "ENDDO"
            begins = "DO" if keyword == "ENDDO" else _CLOSES.get(keyword)
            if keyword == "SUB" or keyword in ("IF", "WHILE", "DO", "REPEAT"):
                construct = Construct(keyword, label, i)
                stack.append(construct)
                found[i] = construct
            elif begins is not None:
                construct = next((c for c in reversed(mine) if c.keyword == begins), None)  # type: ignore[assignment]
                if construct is not None:
                    del stack[stack.index(construct) :]
                    construct.tail = i
                    found[i] = construct
            elif keyword in ("ELSEIF", "ELSE"):
                if inner is not None and inner.keyword == "IF":
                    inner.branches.append(i)
                    found[i] = inner
            elif keyword in ("BREAK", "CONTINUE"):
                loop = next((c for c in reversed(mine) if c.keyword in _LOOPS), None)
                if loop is not None:
                    found[i] = loop
        return found

    @cached_property
    def subroutines(self) -> dict[Label, Construct]:
        """Subroutines by their labels."""
        subs: dict[Label, Construct] = {}
        for construct in self.flow.values():
            if construct.keyword == "SUB":
                subs.setdefault(construct.label, construct)
        return subs

    @cached_property
    def programs(self) -> dict[Label, int]:
        """Subprograms of M98: the line of each label that stands alone."""
        programs: dict[Label, int] = {}
        for i, word in self._o_words():
            if word.keyword == "" and word.label is not None:
                programs.setdefault(word.label, i)
        return programs

    def _o_words(self) -> list[tuple[int, OWord]]:
        """Return the lines with O-words that have a fixed label and can be read."""
        words = []
        offsets = [match.start() for match in _O_LINE.finditer(self.data)]
        for i in np.searchsorted(self.starts, offsets, side="right") - 1:
            line = self._o_line(int(i))
            if line is not None and line.flow is not None and line.flow.label is not None:
                words.append((int(i), line.flow))
        return words

    def _o_line(self, i: int) -> Line | None:
        """Return a line, read; None if it cannot be: it complains when the program comes by."""
        with suppress(Fault):
            return self.line(i, keep=True)
        # A condition goes on, and complains, at an else or elseif with a fault behind the keyword.
        branch = _BRANCH.match(self.text(i))
        with suppress(Fault):
            return read_line(branch[0]) if branch else None
        return None
