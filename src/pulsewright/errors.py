"""Every error that pulsewright raises on purpose, in one tree.

Messages help: what was asked, where (file and line, key, board and axis), what is allowed and
what to try.
"""

from __future__ import annotations

from pathlib import Path


class PulsewrightError(Exception):
    """An error with a message for the person at the keyboard."""


class UsageError(PulsewrightError, ValueError):
    """A request that cannot be carried out as asked: unknown board, unusable option or file."""


class SourceError(UsageError):
    """A program text that cannot be used: of a machine or of a board.

    Parameters
    ----------
    message : str
        What is wrong, what is allowed and what to try.
    path : Path or str
        The program.
    line, column : int
        Where, both from 1; 0 where the place is the whole file or line.
    text : str
        The offending words.
    """

    def __init__(
        self, message: str, *, path: Path | str = "", line: int = 0, column: int = 0, text: str = ""
    ) -> None:
        self.path, self.line, self.column, self.text = str(path), line, column, text
        place = ":".join([self.path or "program"] + [str(n) for n in (line, column) if n])
        super().__init__(f"{place}: {message}" + (f" (at '{text}')" if text else ""))


class GcodeError(SourceError):
    """A G-code program that cannot be run."""


class MachineError(UsageError):
    """A machine file that cannot be used; ``key`` names the entry, dotted."""

    def __init__(self, message: str, *, path: Path | str = "", key: str = "") -> None:
        self.path, self.key = str(path), key
        place = ": ".join(part for part in (self.path, key) if part)
        super().__init__(f"{place}: {message}" if place else message)


class MotionLimitError(UsageError):
    """Motion that the machine or the board cannot do: travel, rate or acceleration."""


class RegisterValueError(PulsewrightError, ValueError):
    """A value that a register of a board cannot hold."""


class BusError(PulsewrightError):
    """A bus or link that does not do what its protocol demands."""


class BusTimeoutError(BusError, TimeoutError):
    """No board acknowledged a bus cycle in time."""


class LateError(BusError):
    """Commands that came later than their time: the motion is not exactly as planned."""


class PositionUnknownError(PulsewrightError):
    """Planned motion asked of a machine whose motors may have lost steps; reference it first."""


class EstopError(PulsewrightError):
    """A board that is in emergency stop where it should run."""


class StarvedError(EstopError):
    """A board that got no motion in time and stopped by itself, in a controlled way.

    Parameters
    ----------
    message : str
        What happened, and what to try.
    time : float
        Time of the plan up to which it was followed [s].
    position : tuple of float
        Where each motor rests now [step].
    """

    def __init__(self, message: str, *, time: float, position: tuple[float, ...]) -> None:
        self.time, self.position = time, position
        super().__init__(message)


class FollowingError(PulsewrightError):
    """A motor that is not where it was commanded to be: steps were lost, or commands spoilt."""


class LimitSwitchError(PulsewrightError):
    """A limit switch that was hit in mid-move."""


class StoppedError(PulsewrightError):
    """A job that was ended on request, before its program was."""


class CheckFailedError(PulsewrightError):
    """A check that ran to its end and found a difference or a violated limit."""
