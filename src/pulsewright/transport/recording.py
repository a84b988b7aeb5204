"""Sessions on links, kept call by call in a file that is good however the program ends.

File: a line of JSON that says what was opened, then events: a letter, the length of what follows,
the time before the call [board cycle], and what belongs to it. A file that ends within an event,
as when the computer is switched off, is good up to there.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from pulsewright.errors import UsageError
from pulsewright.transport.bus import ASAP, EPP_ACCESS, EppBus
from pulsewright.transport.serial_bus import SerialBus
from pulsewright.transport.spi_bus import SpiBus

MAGIC: Final = "pulsewright recording"
EVENT: Final = struct.Struct("<cxxxIq")  # kind, length, time

Kind = Literal["access", "reset", "transfer", "level", "sleep", "write", "read", "forget"]
_LETTERS: Final[dict[Kind, bytes]] = {
    "access": b"X",  # EPP: rows of `EPP_ACCESS` as they were carried out
    "reset": b"I",
    "transfer": b"T",  # SPI: cycle asked (i64), bytes sent, as many received
    "level": b"L",  # SPI: level of a pin (255: unknown), its name
    "sleep": b"S",  # seconds (f64)
    "write": b"W",  # serial: bytes
    "read": b"R",  # serial: most and least bytes (u32), time to wait (f64), bytes received
    "forget": b"C",  # serial: forget what came
}
_KINDS: Final = {letter: kind for kind, letter in _LETTERS.items()}
_READ: Final = struct.Struct("<IId")
_UNKNOWN: Final = 255


@dataclass(frozen=True)
class Event:
    """One call of a bus.

    Parameters
    ----------
    kind : str
    at : int
        Time before the call [board cycle].
    content : bytes
        What `_LETTERS` says of the kind.
    """

    kind: Kind
    at: int
    content: bytes

    @property
    def accesses(self) -> NDArray[np.void]:
        """Of an ``access``: what was carried out, a copy."""
        return np.frombuffer(self.content, EPP_ACCESS).copy()

    @property
    def frame(self) -> tuple[int, bytes, bytes]:
        """Of a ``transfer``: cycle asked, bytes sent, bytes received."""
        half = (len(self.content) - 8) // 2
        (cycle,) = struct.unpack_from("<q", self.content)
        return cycle, self.content[8 : 8 + half], self.content[8 + half :]

    @property
    def pin(self) -> tuple[str, int | None]:
        """Of a ``level``: name of the pin, and its level."""
        level = self.content[0]
        return self.content[1:].decode(), None if level == _UNKNOWN else level

    @property
    def seconds(self) -> float:
        """Of a ``sleep``: how long [s]."""
        (seconds,) = struct.unpack("<d", self.content)
        return float(seconds)

    @property
    def answer(self) -> tuple[int, int, float, bytes]:
        """Of a ``read``: most and least bytes, time to wait [s], bytes received."""
        most, least, seconds = _READ.unpack_from(self.content)
        return most, least, seconds, self.content[_READ.size :]


@dataclass(frozen=True)
class Recording:
    """A session on a link.

    Parameters
    ----------
    opened : dict
        What was opened: ``board``, ``profile``, ``options``, ``link`` and ``clock_hz``.
    events : tuple of Event
    whole : bool
        Whether the file ended with an event, and not within one.
    """

    opened: dict[str, Any]
    events: tuple[Event, ...]
    whole: bool = True

    @classmethod
    def load(cls, path: Path | str) -> Recording:
        """Read a file.

        Raises
        ------
        UsageError
            If it cannot be read, or is no recording.
        """
        try:
            head, _, data = Path(path).read_bytes().partition(b"\n")
        except OSError as error:
            raise UsageError(f"{path}: cannot be read ({error.strerror})") from error
        try:
            opened = json.loads(head)
            if opened.pop("format") != MAGIC:
                raise KeyError
            events, whole = _events(data)
        except (ValueError, KeyError, AttributeError, TypeError) as error:
            raise UsageError(
                f"{path}: is no recording of a link; 'pulsewright run --record FILE' makes one"
            ) from error
        return cls(opened, events, whole)


def _events(data: bytes) -> tuple[tuple[Event, ...], bool]:
    events, at = [], 0
    while at + EVENT.size <= len(data):
        letter, length, cycle = EVENT.unpack_from(data, at)
        begin = at + EVENT.size
        if begin + length > len(data):
            break
        events.append(Event(_KINDS[letter], cycle, data[begin : begin + length]))
        at = begin + length
    return tuple(events), at == len(data)


class Recorder:
    """A file that takes events, each at once.

    Parameters
    ----------
    path : Path or str
        Made anew.
    opened : mapping
        See `Recording`.

    Raises
    ------
    UsageError
        If the file cannot be written.
    """

    def __init__(self, path: Path | str, opened: Mapping[str, Any]) -> None:
        try:
            self._file = Path(path).open("wb", buffering=0)  # noqa: SIM115
        except OSError as error:
            raise UsageError(f"{path}: cannot be written ({error.strerror})") from error
        self._file.write(json.dumps({"format": MAGIC, **opened}).encode() + b"\n")

    def keep(self, kind: Kind, at: int, content: bytes = b"") -> None:
        """Append an event."""
        self._file.write(EVENT.pack(_LETTERS[kind], len(content), at) + content)

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._file.close()


class _Recorded:
    """What the recorded buses share: the bus behind them, of which they also have the rest."""

    def __init__(self, bus: Any, recorder: Recorder) -> None:
        self._bus, self._recorder = bus, recorder
        self.clock_hz: int = bus.clock_hz

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bus, name)

    def now(self) -> int:
        """Return the time of the bus [cycle]."""
        return int(self._bus.now())

    def reset(self) -> None:
        """Reset as the bus does."""
        self._recorder.keep("reset", self.now())
        self._bus.reset()

    def sleep(self, seconds: float) -> None:
        """Let time pass [s]."""
        self._recorder.keep("sleep", self.now(), struct.pack("<d", seconds))
        self._bus.sleep(seconds)

    def close(self) -> None:
        """Release the bus, and end the recording."""
        self._recorder.close()
        self._bus.close()


class RecordedEppBus(_Recorded, EppBus):
    """An EPP bus whose accesses are kept."""

    def __init__(self, bus: EppBus, recorder: Recorder) -> None:
        super().__init__(bus, recorder)
        self.access_cycles, self.exact = bus.access_cycles, bus.exact
        self.in_real_time = bus.in_real_time

    def transact(self, accesses: NDArray[np.void]) -> None:
        """Carry out accesses; see `EppBus`."""
        at = self.now()
        self._bus.transact(accesses)
        self._recorder.keep("access", at, accesses.tobytes())


class RecordedSpiBus(_Recorded, SpiBus):
    """An SPI link whose frames are kept."""

    def __init__(self, bus: SpiBus, recorder: Recorder) -> None:
        super().__init__(bus, recorder)
        self.in_real_time = bus.in_real_time

    def transfer(self, data: bytes, cycle: int = ASAP) -> bytes:
        """Send bytes in one frame; see `SpiBus`."""
        at = self.now()
        reply: bytes = self._bus.transfer(data, cycle)
        self._recorder.keep("transfer", at, struct.pack("<q", cycle) + data + reply)
        return reply

    def level(self, pin: str) -> int | None:
        """Return the level of a pin of the board; see `SpiBus`."""
        level: int | None = self._bus.level(pin)
        known = bytes((_UNKNOWN if level is None else level,))
        self._recorder.keep("level", self.now(), known + pin.encode())
        return level


class RecordedSerialBus(_Recorded, SerialBus):
    """A serial port whose bytes are kept."""

    def write(self, data: bytes) -> None:
        """Send bytes; see `SerialBus`."""
        self._recorder.keep("write", self.now(), bytes(data))
        self._bus.write(data)

    def read(self, max_bytes: int, timeout_s: float, *, min_bytes: int = 1) -> bytes:
        """Return bytes that came; see `SerialBus`."""
        at = self.now()
        data: bytes = self._bus.read(max_bytes, timeout_s, min_bytes=min_bytes)
        self._recorder.keep("read", at, _READ.pack(max_bytes, min_bytes, timeout_s) + data)
        return data

    def reset_input(self) -> None:
        """Forget the bytes that came; see `SerialBus`."""
        self._recorder.keep("forget", self.now())
        self._bus.reset_input()


_WRAPPERS: Final[dict[str, Any]] = {
    "epp": RecordedEppBus,
    "spi": RecordedSpiBus,
    "serial": RecordedSerialBus,
}


def recorded(kind: str, bus: Any, recorder: Recorder) -> Any:
    """Return a bus that does what ``bus`` does and keeps it; ``kind`` as `Board.bus` has it."""
    return _WRAPPERS[kind](bus, recorder)
