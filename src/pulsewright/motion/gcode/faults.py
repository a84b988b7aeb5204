"""What is wrong with a line of a program, before its file and number are known."""

from __future__ import annotations


class Fault(Exception):  # noqa: N818 - becomes a GcodeError where path and line are known
    """What is wrong with a line; columns count from 1, 0 is the whole line."""

    def __init__(self, message: str, column: int = 0, text: str = "") -> None:
        super().__init__(message)
        self.message, self.column, self.text = message, column, text
