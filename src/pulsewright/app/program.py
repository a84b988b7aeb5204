"""A program of the s3g board's executor as words, with what is wrong: ``pulsewright program``."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pulsewright.boards.s3g.program import Finding, Program, assemble, check
from pulsewright.boards.s3g.registers import CHANNELS, MAX_CHANNELS, PROG_OPCODE_LSB
from pulsewright.errors import SourceError, UsageError


@dataclass(frozen=True)
class Report:
    """A program, and what is wrong with it."""

    program: Program
    findings: tuple[Finding, ...]

    @property
    def passed(self) -> bool:
        """Whether there is no error; warnings do not count."""
        return all(finding.severity != "error" for finding in self.findings)

    def summary(self) -> dict[str, Any]:
        """Return the report in plain types; ``word`` has 40 bits."""
        return {
            "file": self.program.path,
            "passed": self.passed,
            "labels": dict(self.program.labels),
            "words": [
                {"address": i.address, "word": i.word, "text": i.text, "line": i.line}
                for i in self.program.instructions
            ],
            "findings": [asdict(finding) for finding in self.findings],
        }

    def text(self) -> str:
        """Return the report for people: address, word, instruction and line, then the findings."""
        names: dict[int, list[str]] = {}
        for label, address in self.program.labels.items():
            names.setdefault(address, []).append(label)
        lines = [" addr  word         instruction"]
        for item in self.program.instructions:
            lines += [f"{label}:" for label in names.get(item.address, [])]
            high, low = item.word >> PROG_OPCODE_LSB, item.word & ((1 << PROG_OPCODE_LSB) - 1)
            lines.append(f"{item.address:5}  {high:02X} {low:08X}  {item.text}")
        lines += [
            f"{self.program.path}:{f.line}:{f.column}: {f.severity}: {f.message}"
            for f in self.findings
        ]
        size = len(self.program.instructions)
        lines.append(f"{size} word{'s' * (size != 1)}, {'PASSED' if self.passed else 'FAILED'}")
        return "\n".join(lines)


def run(path: Path | str, *, channels: int | None = None) -> Report:
    """Assemble and check a program.

    Parameters
    ----------
    path : Path or str
        The text; its language is described in `pulsewright.boards.s3g.program`.
    channels : int, optional
        Of the board that it is for, 1..6; as the original's without it.

    Raises
    ------
    SourceError
        If there is no such text, or a line of it is wrong.
    UsageError
        If there can be no such board.
    """
    channels = CHANNELS if channels is None else channels
    if not 1 <= channels <= MAX_CHANNELS:
        raise UsageError(f"s3g: {channels} channels; a board has 1..{MAX_CHANNELS}")
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise SourceError(f"cannot be read: {error.strerror}", path=path) from error
    except UnicodeDecodeError:
        raise SourceError("this is not a text file", path=path) from None
    program = assemble(text, path)
    return Report(program, tuple(check(program, channels=channels)))
