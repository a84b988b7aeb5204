"""Replay recordings of original controllers on our own, and demand every change at its cycle."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from pulsewright import boards
from pulsewright.app.progress import Progress, silent
from pulsewright.errors import UsageError

BOTH: Final = ("twin", "rtl")
PATTERNS: Final = ("*.npz", "*.jsonl.gz")  # names of recordings


@dataclass(frozen=True)
class Replay:
    """One recording on one engine.

    Parameters
    ----------
    recording, engine : str
    cycles, changes, transactions : int
        Length of the recording, level changes of pins and bus transactions in it.
    difference : str or None
        Where it first differs, in words; None if every change is there at its cycle, and no other.
    seconds : float
        Time of the replay.
    """

    recording: str
    engine: str
    cycles: int
    changes: int
    transactions: int
    difference: str | None
    seconds: float

    def text(self) -> str:
        """Return the result for people."""
        if self.difference:
            return f"FAIL {self.recording} on {self.engine}: {self.difference}"
        return (
            f"ok   {self.recording} on {self.engine}: {self.changes} changes in {self.cycles} "
            f"cycles, {self.transactions} transactions ({self.seconds:.2f} s)"
        )


@dataclass(frozen=True)
class Report:
    """All replays of a check."""

    board: str
    replays: tuple[Replay, ...]

    @property
    def passed(self) -> bool:
        """Whether every replay is equal to its recording."""
        return all(replay.difference is None for replay in self.replays)

    def summary(self) -> dict[str, Any]:
        """Return the report in plain types."""
        return {
            "board": self.board,
            "passed": self.passed,
            "replays": [asdict(replay) for replay in self.replays],
        }

    def text(self) -> str:
        """Return the report for people."""
        lines = [replay.text() for replay in self.replays]
        return "\n".join([*lines, "PASSED" if self.passed else "FAILED"])


def check(
    board: str,
    golden: Sequence[Path | str],
    engine: str = "twin",
    progress: Progress = silent,
) -> Report:
    """Replay recordings.

    Parameters
    ----------
    board : str
        Name of a room.
    golden : sequence of Path or str
        Recordings of the original, or folders of them.
    engine : str
        ``twin``, ``rtl`` (the gateware in a simulator), or ``both``.

    Raises
    ------
    UsageError
        If there is no such board or engine, or a file is no recording of the board.
    """
    room = boards.get(board)
    if room.recordings is None:
        raise UsageError(f"{board}: there are no recordings of its original to replay")
    recordings = room.recordings()
    files = [file for path in golden for file in _files(Path(path))]
    if not files:
        raise UsageError(f"check {board}: no recordings given; name files or folders with --golden")
    jobs = [(file, name) for file in files for name in (BOTH if engine == "both" else (engine,))]
    replays = []
    for n, (file, name) in enumerate(jobs):
        progress("check", n / len(jobs))
        recording = recordings.load(file)
        start = time.perf_counter()
        seen = recordings.replay(recording, name)
        seconds = time.perf_counter() - start
        expected = recording.expected
        replays.append(
            Replay(
                recording=recording.name,
                engine=name,
                cycles=expected.end,
                changes=sum(map(len, expected.cycles)),
                transactions=recording.transactions,
                difference=_difference(expected.first_difference(seen), name),
                seconds=seconds,
            )
        )
    progress("check", 1.0)
    return Report(board, tuple(replays))


def _difference(text: str | None, engine: str) -> str | None:
    return None if text is None else f"{text} (recording, {engine})"


def _files(path: Path) -> list[Path]:
    """Return the recordings that a path means: itself, or those in a folder."""
    if not path.is_dir():
        return [path]
    return sorted(file for pattern in PATTERNS for file in path.glob(pattern))
