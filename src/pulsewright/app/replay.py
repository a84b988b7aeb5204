"""Recordings of links, done again on a simulated board and compared; and two files compared."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from pulsewright import boards
from pulsewright.app.progress import Progress, silent
from pulsewright.boards import links
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError
from pulsewright.files import replacing
from pulsewright.transport.bus import (
    ADDRESS_READ,
    ADDRESS_WRITE,
    DATA_READ,
    DATA_WRITE,
)
from pulsewright.transport.recording import Event, Recording

_OPS: Final = {
    ADDRESS_WRITE: "address write",
    ADDRESS_READ: "address read",
    DATA_WRITE: "data write",
    DATA_READ: "data read",
}
_READS: Final = (DATA_READ, ADDRESS_READ)


@dataclass(frozen=True)
class Comparison:
    """What was compared, and where it first differs.

    Parameters
    ----------
    what : str
        What was compared with what, and how much of it.
    difference : str, optional
        The first difference in words, None without one.
    """

    what: str
    difference: str | None

    @property
    def passed(self) -> bool:
        """Whether there is none."""
        return self.difference is None

    def summary(self) -> dict[str, Any]:
        """Return everything as plain values for JSON."""
        return {"passed": self.passed, "what": self.what, "difference": self.difference}

    def text(self) -> str:
        """Return two lines to read."""
        return f"{self.what}\n{'no difference' if self.passed else self.difference}"


def replay(
    path: Path | str,
    *,
    engine: str = "twin",
    edges: Path | None = None,
    progress: Progress = silent,
) -> Comparison:
    """Do a recorded session again on a simulated board, at the times it had, and compare answers.

    Answers that a link has spoilt, where no board acknowledged, are not compared.

    Parameters
    ----------
    path : Path or str
        Of a recording.
    engine : str
        ``twin`` or ``rtl``.
    edges : Path, optional
        Where to write every change of every pin (.npz).

    Raises
    ------
    UsageError
        If the file is no recording, or the engine is unknown.
    """
    if engine not in ("twin", "rtl"):
        raise UsageError(f"replay: engine '{engine}'; there are twin and rtl")
    recording = Recording.load(path)
    opened = recording.opened
    room = boards.get(opened["board"])
    bus: Any = links.open_bus(room, f"{engine}:", opened["profile"], opened["options"])
    session = _Session(bus, opened["clock_hz"])
    difference = None
    for number, event in enumerate(recording.events):
        progress("replay", number / len(recording.events))
        difference = session.again(event)
        if difference is not None:
            break
    else:
        difference = session.unheard()
    progress("replay", 1.0)
    if edges is not None:
        bus.twin.advance(max(bus.now(), bus.twin.now))
        with replacing(edges) as file:
            bus.twin.drain().save(file)
    end = "" if recording.whole else ", whose end is cut off"
    what = (
        f"{path}: {len(recording.events)} calls at {opened['link']}{end}, done again on the "
        f"{engine} of {room.name}, profile {opened['profile']}"
    )
    return Comparison(what, difference)


class _Session:
    """A recorded session on another bus.

    Bytes of a serial port are compared as one stream: how many come at once is a matter of time.
    """

    def __init__(self, bus: Any, clock_hz: int) -> None:
        self._bus, self._clock_hz = bus, clock_hz
        self._before, self._now = bytearray(), bytearray()  # heard at a serial port

    def again(self, event: Event) -> str | None:
        """Do one call; say what came that did not come before."""
        bus = self._bus
        if event.at > bus.now():
            bus.twin.advance(event.at)
        if event.kind == "access":
            before, now = event.accesses, event.accesses
            bus.transact(now)
            return _unequal_accesses(before, now, self._clock_hz, ("recorded", "now"))
        if event.kind == "transfer":
            asked, sent, received = event.frame
            reply = bus.transfer(sent, asked)
            if reply != received:
                what = f"the answer to {sent.hex(' ')} was {received.hex(' ')}"
                return f"{self._time(event)}: {what}, now it is {reply.hex(' ')}"
        elif event.kind == "read":
            most, least, seconds, data = event.answer
            self._before += data
            self._now += bus.read(most, seconds, min_bytes=least)
            return self._unequal_bytes(event)
        elif event.kind == "level":
            pin, level = event.pin
            if level is not None and bus.level(pin) != level:
                return f"{self._time(event)}: pin {pin} was {level}, now it is {1 - level}"
        elif event.kind == "write":
            bus.write(event.content)
        elif event.kind == "sleep":
            bus.sleep(event.seconds)
        elif event.kind == "reset":
            bus.reset()
        else:
            bus.reset_input()
        return None

    def unheard(self) -> str | None:
        """At the end, say which bytes came before and did not come now."""
        if len(self._now) >= len(self._before):
            return None
        at = len(self._now)
        return f"at the end: answers lack byte {at} and on: {self._before[at:].hex(' ')}"

    def _unequal_bytes(self, event: Event) -> str | None:
        for n, (before, now) in enumerate(zip(self._before, self._now, strict=False)):
            if before != now:
                return (
                    f"{self._time(event)}: byte {n} of the answers was {before:02x}, now {now:02x}"
                )
        return None

    def _time(self, event: Event) -> str:
        return _time(event.at, self._clock_hz)


def _unequal_accesses(before: Any, now: Any, clock_hz: int, names: tuple[str, str]) -> str | None:
    """Say where accesses first differ: what is asked, what is answered, whether anybody does."""
    reads = np.isin(before["op"], _READS) & np.isin(now["op"], _READS)
    unheard = before["timeout"] | now["timeout"]
    differs = (before["op"] != now["op"]) | (before["timeout"] != now["timeout"])
    differs |= (before["value"] != now["value"]) & ~(reads & (unheard == 1))
    if not differs.any():
        return None
    n = int(np.argmax(differs))
    return (
        f"{_time(int(before['cycle'][n]), clock_hz)}, {_place(before, n)}: {names[0]} "
        f"{_access(before[n])}, {names[1]} {_access(now[n])}"
    )


def _place(accesses: Any, n: int) -> str:
    """Say where an access of many is, by the address that was written last."""
    sent = np.flatnonzero(accesses["op"][:n] == ADDRESS_WRITE)
    if not len(sent):
        return f"access {n}"
    return f"access {n} ({n - sent[-1]} after address {accesses['value'][sent[-1]]:02X}h)"


def _access(access: Any) -> str:
    silent = ", not acknowledged" if access["timeout"] else ""
    return f"{_OPS.get(int(access['op']), 'access')} {access['value']:02X}h{silent}"


def _time(cycle: int, clock_hz: int) -> str:
    return f"at {cycle / clock_hz:.6f} s"


# --------------------------------------------------------------------------------------- two files


def diff(first: Path | str, second: Path | str) -> Comparison:
    """Compare two recordings of links, or two traces of pins (.npz).

    Recordings are compared by what was said and answered, not by when.

    Raises
    ------
    UsageError
        If a file cannot be read, or one is a trace and the other is not.
    """
    traces = [Path(path).suffix == ".npz" for path in (first, second)]
    if traces[0] != traces[1]:
        raise UsageError(f"diff: {first} and {second}: two recordings or two traces (.npz)")
    if traces[0]:
        ours, theirs = EdgeTrace.load(first), EdgeTrace.load(second)
        changes = [sum(map(len, trace.cycles)) for trace in (ours, theirs)]
        what = f"{first} ({changes[0]} changes) and {second} ({changes[1]})"
        return Comparison(what, ours.first_difference(theirs))
    here, there = Recording.load(first), Recording.load(second)
    what = f"{first} ({len(here.events)} calls) and {second} ({len(there.events)})"
    return Comparison(what, _unequal_recordings(here, there))


def _unequal_recordings(here: Recording, there: Recording) -> str | None:
    for key in ("board", "profile", "options"):
        if here.opened[key] != there.opened[key]:
            return f"{key}: {here.opened[key]} and {there.opened[key]}"
    clock_hz = here.opened["clock_hz"]
    parts = zip(_said(here), _said(there), strict=False)
    for n, (ours, theirs) in enumerate(parts):
        if isinstance(ours, str) or isinstance(theirs, str):
            if ours != theirs:
                return f"part {n}: {_short(ours)} and {_short(theirs)}"
            continue
        common = min(len(ours), len(theirs))
        if found := _unequal_accesses(
            ours[:common], theirs[:common], clock_hz, ("first", "second")
        ):
            return found
        if len(ours) != len(theirs):
            return f"{len(ours)} accesses and {len(theirs)}; the first {common} are equal"
    lengths = [sum(1 for _ in _said(recording)) for recording in (here, there)]
    if lengths[0] != lengths[1]:
        return f"{lengths[0]} parts and {lengths[1]}; those that both have are equal"
    return None


def _said(recording: Recording) -> Iterator[Any]:
    """Yield what was said and answered: other calls as text, accesses between them as one array."""
    accesses: list[Any] = []
    clock_hz = recording.opened["clock_hz"]
    for event in recording.events:
        if event.kind == "access":
            accesses.append(event.accesses)
            continue
        if accesses:
            yield np.concatenate(accesses)
            accesses = []
        if event.kind != "sleep":
            yield _call(event, clock_hz)
    if accesses:
        yield np.concatenate(accesses)


def _call(event: Event, clock_hz: int) -> str:
    """Return what was said and answered in one call."""
    if event.kind == "transfer":
        _, sent, received = event.frame
        return f"frame {sent.hex(' ')}, answered {received.hex(' ')}"
    if event.kind == "read":
        return f"received {event.answer[3].hex(' ') or 'nothing'}"
    if event.kind == "write":
        return f"sent {event.content.hex(' ')}"
    if event.kind == "level":
        return "pin {} is {}".format(*event.pin)
    return event.kind


def _short(part: Any) -> str:
    return part if isinstance(part, str) else f"{len(part)} accesses"
