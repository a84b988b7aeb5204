"""A program of the s3g board's executor: its words, what is wrong, and what it does on a twin."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from pulsewright.boards import open_board
from pulsewright.boards.s3g import packets
from pulsewright.boards.s3g.program import Finding, Program, assemble, check
from pulsewright.boards.s3g.registers import (
    CHANNELS,
    CLOCK_HZ,
    MAP,
    MAX_CHANNELS,
    PROG_OPCODE_LSB,
    STB_BE_START,
    STEP_UNITS,
)
from pulsewright.errors import SourceError, UsageError
from pulsewright.registers.codec import decode

START: Final = "start"  # label where a simulation begins; without it, at the lowest address
TAG: Final = 1
MILLISECOND: Final = CLOCK_HZ // 1000


@dataclass(frozen=True)
class Channel:
    """Where a simulation left a channel.

    Parameters
    ----------
    steps : int
        Steps at the pins, with their sign.
    lost : int
        Steps that came while the pulse former was busy.
    rate : float
        Present speed [step/s].
    """

    steps: int
    lost: int
    rate: float


@dataclass(frozen=True)
class Simulation:
    """What a program did on a twin.

    Parameters
    ----------
    seconds : float
        From the start of the program, in steps of 1 ms.
    ended : str
        How: words for its end, or for where it was when time was up.
    done : bool
        Whether it ended by itself, with DONE.
    channels : tuple of Channel
    """

    seconds: float
    ended: str
    done: bool
    channels: tuple[Channel, ...]

    @property
    def passed(self) -> bool:
        """Whether the program ended by itself, and no step was lost."""
        return self.done and not any(channel.lost for channel in self.channels)

    def text(self) -> str:
        """Return the result for people."""
        lines = [f"simulated {self.seconds:.3f} s: {self.ended}"]
        for c, channel in enumerate(self.channels):
            lines.append(
                f"channel {c}: {channel.steps} steps, {channel.lost} lost, now at "
                f"{channel.rate:.6g} step/s"
            )
        return "\n".join(lines)


@dataclass(frozen=True)
class Report:
    """A program, what is wrong with it, and what it did if it was simulated."""

    program: Program
    findings: tuple[Finding, ...]
    simulation: Simulation | None = None

    @property
    def passed(self) -> bool:
        """Whether there is no error, and the simulation passed; warnings do not count."""
        return not _errors(self.findings) and (self.simulation is None or self.simulation.passed)

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
            "simulation": self.simulation and asdict(self.simulation),
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
        if self.simulation is not None:
            lines.append(self.simulation.text())
        size = len(self.program.instructions)
        lines.append(f"{size} word{'s' * (size != 1)}, {'PASSED' if self.passed else 'FAILED'}")
        return "\n".join(lines)


def run(path: Path | str, *, channels: int | None = None, seconds: float | None = None) -> Report:
    """Assemble and check a program, and simulate it if asked.

    Parameters
    ----------
    path : Path or str
        The text; its language is described in `pulsewright.boards.s3g.program`.
    channels : int, optional
        Of the board that it is for, 1..6; as the original's without it.
    seconds : float, optional
        Simulate this time, unless there are errors; see `simulate`.

    Raises
    ------
    SourceError
        If there is no such text, or a line of it is wrong.
    UsageError
        If there can be no such board, or ``seconds`` is not positive.
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
    findings = tuple(check(program, channels=channels))
    done = None
    if seconds is not None and not _errors(findings):
        done = simulate(program, seconds=seconds, channels=channels)
    return Report(program, findings, done)


def _errors(findings: tuple[Finding, ...]) -> bool:
    return any(finding.severity == "error" for finding in findings)


def simulate(program: Program, *, seconds: float, channels: int = CHANNELS) -> Simulation:
    """Load a program into a new twin, start it at its label ``start``, and see what happens.

    Parameters
    ----------
    program : Program
    seconds : float
        Time until it is stopped, if it does not end before and leave all motors at rest.
    channels : int
        Of the board, 1..6.

    Raises
    ------
    UsageError
        If there can be no such board, or ``seconds`` is not positive.
    """
    if seconds <= 0:
        raise UsageError(f"a simulation of {seconds:g} s; it takes more than 0")
    board = open_board("s3g", channels=channels)
    twin = board.bus.twin  # type: ignore[attr-defined]
    board.write_program(program)
    start = program.labels.get(START, min(i.address for i in program.instructions))
    board.write_register("W_BE_START_ADDR", address=start)
    # not by the driver, which would let time pass until the board has answered
    twin.send(1, packets.strobe(TAG, 1 << STB_BE_START))
    while not decode(MAP["R_BE_CONTROL"], twin.state()["be"])["busy"]:
        if twin.receive(1, twin.now + 1):  # the answer comes long after the start
            break
    begin = twin.now
    end = begin + max(round(seconds * CLOCK_HZ), 1)
    state = twin.state()
    status = decode(MAP["R_BE_CONTROL"], state["be"])
    while twin.now < end and (status["busy"] or any(state["v"]) or any(state["sv"])):
        twin.advance(min(twin.now + MILLISECOND, end))
        state = twin.state()
        status = decode(MAP["R_BE_CONTROL"], state["be"])
    pc, code = status["pc"], status["error"]
    words_at = {i.address: i for i in program.instructions}
    here = words_at[pc].text if pc in words_at else "outside the program"
    done = not status["busy"] and here.split()[0] == "DONE"
    if status["busy"]:
        ended = f"still at address {pc}: {here}"
    elif done:
        ended = f"ended at address {pc} with code {code}"
    else:
        ended = f"stopped at address {pc}: {MAP.table('BE').text(code)}"
    rates = [
        (v + sv) / 2 * CLOCK_HZ / STEP_UNITS for v, sv in zip(state["v"], state["sv"], strict=True)
    ]
    found = zip(state["position"], state["lost"], rates, strict=True)
    return Simulation(
        (twin.now - begin) / CLOCK_HZ, ended, done, tuple(Channel(*row) for row in found)
    )
