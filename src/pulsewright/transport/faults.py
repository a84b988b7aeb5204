"""Faults of links, injected on purpose: what a bad cable, a sick port or a stalled host does.

A wrapper around any bus does to its accesses, frames or bytes what `Faults` says, so that a program
can see how driver and board bear it. Servers do the same to what their clients send and get.
"""

from __future__ import annotations

import math
import random
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from pulsewright.errors import BusError, UsageError
from pulsewright.transport.bus import ADDRESS_READ, ADDRESS_WRITE, ASAP, DATA_READ, EppBus
from pulsewright.transport.serial_bus import SerialBus, check_read
from pulsewright.transport.spi_bus import SpiBus, check_frame, frame_cycles

FOR_EVER: Final = -1
FLOATING: Final = 0xFF  # what a host reads where nobody drives a line
LONGEST_S: Final = 3600.0
MOST: Final = (1 << 31) - 1
_EPP_READS: Final = (DATA_READ, ADDRESS_READ)

Direction = Literal["read", "write"]

# arguments of each kind beside those that all have: after, count, share
KINDS: Final[dict[str, tuple[str, ...]]] = {
    "mute": (),
    "stuck": ("level",),
    "lose": ("of",),
    "double": ("of",),
    "flip": ("mask", "of"),
    "delay": ("seconds",),
    "stall": ("seconds",),
}
SWITCHES: Final = ("cut", "power", "none")  # kinds without those


@dataclass
class Fault:
    """One fault, and how often it still hits.

    Parameters
    ----------
    kind : str
        A key of `KINDS`.
    of : str
        Of ``lose``, ``double`` and ``flip``: ``read`` or ``write``, as the host sees it.
    mask : int
        Of ``flip``: bits inverted, 1..255.
    seconds : float
        Of ``delay`` and ``stall``: so much later [s].
    level : int
        Of ``stuck``: level of the wait line.
    after : int
        So many units pass before the first one is hit. Units are accesses (EPP) or bytes; of
        ``delay`` and ``stall``, calls.
    count : int
        So many are hit, `FOR_EVER`: all.
    share : float
        Of those due, this share is hit, at random; above 0, up to 1.
    """

    kind: str
    of: Direction = "write"
    mask: int = 0
    seconds: float = 0.0
    level: int = 0
    after: int = 0
    count: int = FOR_EVER
    share: float = 1.0

    def __post_init__(self) -> None:
        def refuse(name: str, allowed: str) -> None:
            given = repr(getattr(self, name))[:80]
            raise UsageError(f"fault {self.kind}: '{name}' should be {allowed}, not {given}")

        if self.of not in ("read", "write"):
            refuse("of", '"read" or "write"')
        lowest = int(self.kind == "flip")
        if type(self.mask) is not int or not lowest <= self.mask <= 0xFF:
            refuse("mask", "1..255")
        for name in ("seconds", "share"):
            if type(getattr(self, name)) not in (int, float):
                refuse(name, "a number")
        if not 0 <= self.seconds <= LONGEST_S:
            refuse("seconds", f"0..{LONGEST_S:g}")
        if not 0 < self.share <= 1:
            refuse("share", "above 0, up to 1")
        if self.level not in (0, 1):
            refuse("level", "0 or 1")
        if type(self.after) is not int or not 0 <= self.after <= MOST:
            refuse("after", f"0..{MOST}")
        if type(self.count) is not int or not FOR_EVER <= self.count <= MOST:
            refuse("count", f"{FOR_EVER}, for ever, or 0..{MOST}")

    def hits(self, units: int, chance: random.Random) -> list[int]:
        """Return which of the next units are hit, by number from 0 on; they are counted."""
        first = min(self.after, units)
        self.after -= first
        if not self.count:
            return []
        if self.share == 1.0:
            last = units if self.count == FOR_EVER else min(units, first + self.count)
            found = list(range(first, last))
        else:
            found = [n for n in range(first, units) if chance.random() < self.share]
            if self.count != FOR_EVER:
                del found[self.count :]
        if self.count != FOR_EVER:
            self.count -= len(found)
        return found


class Faults:
    """What goes wrong on a link, from now on or later; nothing at first.

    Parameters
    ----------
    seed : int
        Of what happens at random, so that it does again the same way.

    Attributes
    ----------
    hit : int
        Accesses, bytes and calls that were hit so far.

    Examples
    --------
    >>> from pulsewright import open_board
    >>> faults = Faults()
    >>> with open_board("usc", faults=faults) as board:
    ...     board.initialise()
    ...     faults.inject("flip", mask=0x40, of="read", count=1)
    ...     board.identify()
    Traceback (most recent call last):
        ...
    pulsewright.errors.BusError: usc base 0: the module ID reads 01h, a USC has 40h..4Eh; ...
    """

    def __init__(self, seed: int = 0) -> None:
        self._chance = random.Random(seed)
        self._active: list[Fault] = []
        self.cut = False
        self.powered = True
        self.hit = 0

    def inject(self, kind: str, **arguments: Any) -> None:
        """Begin a fault, beside those there are.

        Parameters
        ----------
        kind : str
            ``mute``: nothing reaches the board, nor the host: the cable is pulled, and the port is
            still there. ``stuck``: the wait line stays as it is (EPP: accesses reach the board and
            are not acknowledged; SPI: pins of the board read ``level``). ``lose``, ``double``,
            ``flip``: bytes on their way, or accesses. ``delay``: what is sent, or received from a
            serial port, comes later. ``stall``: the host stands still before its next call,
            whatever that is. ``cut``: the link is lost for good, as when a port is
            unplugged. ``power``: with ``on=False`` the board forgets everything and does not
            answer; with ``on=True`` it is as after power-up. ``none``: all is well again.
        **arguments
            See `Fault`.

        Raises
        ------
        UsageError
            If there is no such kind, or an argument is not one of it or not allowed.
        """
        if kind == "cut" and not arguments:
            self.cut = True
        elif kind == "none" and not arguments:
            self._active.clear()
            self.cut, self.powered = False, True
        elif kind == "power" and arguments.keys() == {"on"} and type(arguments["on"]) is bool:
            self.powered = arguments["on"]
        elif kind in KINDS:
            known = (*KINDS[kind], "after", "count", "share")
            unknown = arguments.keys() - set(known)
            if unknown:
                raise UsageError(
                    f"fault {kind}: no argument '{min(unknown)}'; it takes {', '.join(known)}"
                )
            needed = {"flip": "mask", "delay": "seconds", "stall": "seconds"}.get(kind)
            if needed and needed not in arguments:
                raise UsageError(f"fault {kind}: '{needed}' is missing")
            self._active.append(Fault(kind, **arguments))
        elif kind in SWITCHES:
            takes = "on, which is true or false" if kind == "power" else "no argument"
            raise UsageError(f"fault {kind}: it takes {takes}")
        else:
            raise UsageError(f"fault: 'kind' should be one of {', '.join((*KINDS, *SWITCHES))}")

    def hits(self, kind: str, units: int, of: Direction | None = None) -> list[int]:
        """Return which of the next units a kind of fault hits; they are counted."""
        found: set[int] = set()
        for fault in self._active:
            if fault.kind == kind and of in (None, fault.of):
                found.update(fault.hits(units, self._chance))
        self.hit += len(found)
        return sorted(found)

    def masks(self, units: int, of: Direction) -> NDArray[np.uint8]:
        """Return the bits that are inverted in each of the next units; they are counted."""
        masks = np.zeros(units, np.uint8)
        for fault in self._active:
            if fault.kind == "flip" and fault.of == of:
                masks[fault.hits(units, self._chance)] ^= fault.mask
        self.hit += int(np.count_nonzero(masks))
        return masks

    def delay(self, kind: str = "delay") -> float:
        """Return how much later the next call comes by a kind of fault [s]."""
        late = 0.0
        for fault in self._active:
            if fault.kind == kind and fault.hits(1, self._chance):
                self.hit += 1
                late += fault.seconds
        return late

    def silent(self, units: int) -> list[int]:
        """Return which of the next units do not get through, for want of cable or power."""
        muted = self.hits("mute", units)
        return muted if self.powered else list(range(units))

    def stuck(self) -> int | None:
        """Return the level at which the wait line stays, None if it works."""
        for fault in self._active:
            if fault.kind == "stuck" and fault.hits(1, self._chance):
                self.hit += 1
                return fault.level
        return None

    def spoil(self, data: bytes, of: Direction, *, answer: bool = False) -> tuple[bytes, list[int]]:
        """Return bytes as they arrive, and of which one each of them is.

        Of a byte that is lost there is none; of one that is doubled there are two. What makes a
        link silent was counted before if this is the ``answer`` to what went.
        """
        if not self._active and self.powered:
            return data, list(range(len(data)))
        gone = set() if answer else set(self.silent(len(data)))
        gone.update(self.hits("lose", len(data), of))
        twice = set(self.hits("double", len(data), of))
        values = np.frombuffer(data, np.uint8) ^ self.masks(len(data), of)
        places = [n for n in range(len(data)) if n not in gone for _ in range(1 + (n in twice))]
        return values[places].tobytes(), places

    def frame(self, data: bytes, transfer: Callable[[bytes], bytes]) -> bytes | None:
        """Send a frame as it arrives; return as many bytes as were sent, or None if nothing did.

        A byte that the board does not see, or sees twice, shifts what it sends back, too.

        Parameters
        ----------
        data : bytes
        transfer : callable
            Gets what arrives, at least one byte, and returns as many.
        """
        sent, places = self.spoil(data, "write")
        if not sent:
            return None
        back = bytearray([FLOATING]) * len(data)
        for place, byte in zip(places, transfer(sent), strict=True):
            back[place] = byte
        received, _ = self.spoil(bytes(back), "read", answer=True)
        return received[: len(data)].ljust(len(data), bytes([FLOATING]))


class _Faulty:
    """What the wrappers share: the bus behind them, of which they also have the rest."""

    _what: str

    def __init__(self, bus: Any, faults: Faults) -> None:
        self._bus, self.faults = bus, faults
        self._powered = True
        self.clock_hz: int = bus.clock_hz

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bus, name)

    def now(self) -> int:
        """Return the time of the bus [cycle]."""
        self._stand()
        return int(self._bus.now())

    def reset(self) -> None:
        """Reset as the bus does, if the board can be reached."""
        self._check()
        if not self.faults.silent(1):
            self._bus.reset()

    def sleep(self, seconds: float) -> None:
        """Let time pass [s]."""
        self._bus.sleep(seconds)

    def close(self) -> None:
        """Release the bus."""
        self._bus.close()

    def _check(self) -> None:
        """Do what concerns the whole link.

        Raises
        ------
        BusError
            If it is cut.
        UsageError
            If the board's power shall be switched, but it is no simulated one.
        """
        self._stand()
        if self.faults.powered != self._powered:
            twin = getattr(self._bus, "twin", None)
            if twin is None:
                raise UsageError(
                    f"{self._what} link: fault power is for simulated boards; switch the board's"
                )
            twin.reset()
            self._powered = self.faults.powered
        if self.faults.cut:
            raise BusError(f"{self._what} link: cut on purpose (fault injection); it is lost")

    def _stand(self) -> None:
        """Let time pass while the host stands still."""
        seconds = self.faults.delay("stall")
        if not seconds:
            return
        if hasattr(self._bus, "sleep"):
            self._bus.sleep(seconds)
        elif (twin := getattr(self._bus, "twin", None)) is not None:
            twin.advance(self._bus.now() + math.ceil(seconds * self.clock_hz))
        else:
            time.sleep(seconds)

    def _late(self, cycle: int) -> int:
        """Return when a call comes that was asked for a cycle."""
        seconds = self.faults.delay()
        if not seconds:
            return cycle
        return max(cycle, self.now()) + math.ceil(seconds * self.clock_hz)


class FaultyEppBus(_Faulty, EppBus):
    """An EPP bus with faults; units are accesses."""

    _what = "epp"

    def __init__(self, bus: EppBus, faults: Faults) -> None:
        super().__init__(bus, faults)
        self.access_cycles, self.exact = bus.access_cycles, bus.exact
        self.in_real_time = bus.in_real_time

    def transact(self, accesses: NDArray[np.void]) -> None:
        """Carry out accesses as far as the faults let them; see `EppBus.transact`.

        A read that does not reach a board gives FF. One that is not acknowledged sets ``timeout``,
        as everywhere; a lost one does not.
        """
        self._check()
        n, faults = len(accesses), self.faults
        if not n:
            return
        reads = np.isin(accesses["op"], _EPP_READS)
        sides: tuple[tuple[Direction, NDArray[np.intp]], ...] = (
            ("write", np.flatnonzero(~reads)),
            ("read", np.flatnonzero(reads)),
        )
        silent = np.zeros(n, bool)
        silent[faults.silent(n)] = True
        stuck = np.zeros(n, bool)
        stuck[faults.hits("stuck", n)] = True
        times = np.ones(n, np.int64)  # that the board sees each of them
        masks = np.zeros(n, np.uint8)
        for of, rows in sides:
            times[rows[faults.hits("double", len(rows), of)]] = 2
            times[rows[faults.hits("lose", len(rows), of)]] = 0
            masks[rows] = faults.masks(len(rows), of)
        times[silent] = 0
        rows = np.repeat(np.arange(n), times)
        sent = accesses[rows]
        sent["value"] ^= np.where(reads, 0, masks)[rows]
        if len(sent):
            sent["cycle"][0] = self._late(int(sent["cycle"][0]))
        start = self.now()
        self._bus.transact(sent)
        # what did not go takes the time of an access all the same
        accesses["cycle"] = np.maximum(start, accesses["cycle"])
        accesses["timeout"] = 0
        seen, first = np.unique(rows, return_index=True)
        # a doubled one takes no time, for the port knows of one
        late = np.maximum(sent["cycle"][first] - accesses["cycle"][seen], 0)
        more = (first - np.arange(len(first))) * self.access_cycles
        accesses["cycle"][seen] = sent["cycle"][first] - np.minimum(late, more)
        accesses["timeout"][seen] = sent["timeout"][first]
        read = reads[seen]
        accesses["value"][reads] = FLOATING
        accesses["value"][seen[read]] = sent["value"][first[read]]
        accesses["value"][reads] ^= masks[reads]
        unanswered = silent | stuck
        accesses["timeout"][unanswered & (accesses["op"] != ADDRESS_WRITE)] = 1
        accesses["value"][unanswered & reads] = FLOATING


class FaultySpiBus(_Faulty, SpiBus):
    """An SPI link with faults; units are bytes."""

    _what = "spi"

    def __init__(self, bus: SpiBus, faults: Faults) -> None:
        super().__init__(bus, faults)
        self.in_real_time = bus.in_real_time

    def transfer(self, data: bytes, cycle: int = ASAP) -> bytes:
        """Send a frame as far as the faults let it; see `SpiBus.transfer`."""
        self._check()
        check_frame(data)
        cycle = self._late(cycle)
        reply = self.faults.frame(data, lambda sent: self._bus.transfer(sent, cycle))
        if reply is None:
            self._bus.sleep(frame_cycles(len(data)) / self.clock_hz)
            return bytes([FLOATING]) * len(data)
        return reply

    def level(self, pin: str) -> int | None:
        """Return the level of a pin of the board; see `SpiBus`."""
        stuck = self.faults.stuck()
        level: int | None = self._bus.level(pin)
        return level if stuck is None or level is None else stuck


class FaultySerialBus(_Faulty, SerialBus):
    """A serial port with faults; units are bytes. What the host gets is delayed, in order."""

    _what = "serial"

    def __init__(self, bus: SerialBus, faults: Faults) -> None:
        super().__init__(bus, faults)
        self._coming: deque[tuple[int, bytes]] = deque()  # cycle from which on bytes are there
        self._there = b""

    def write(self, data: bytes) -> None:
        """Send bytes as far as the faults let them; see `SerialBus.write`."""
        self._check()
        if sent := self.faults.spoil(data, "write")[0]:
            self._bus.write(sent)

    def read(self, max_bytes: int, timeout_s: float, *, min_bytes: int = 1) -> bytes:
        """Return bytes as they arrive; see `SerialBus.read`."""
        self._check()
        check_read(max_bytes, timeout_s, min_bytes)
        end = self.now() + math.ceil(timeout_s * self.clock_hz)
        looked = False
        while True:
            self._arrive()
            missing = min_bytes - len(self._there)
            left = end - self.now()
            until = min(left, self._coming[0][0] - self.now()) if self._coming else left
            if missing <= 0 or (looked and left <= 0):
                break
            least = 1 if self._coming else missing
            self._take(self._bus.read(1 << 16, max(until, 0) / self.clock_hz, min_bytes=least))
            looked = True
        data, self._there = self._there[:max_bytes], self._there[max_bytes:]
        return data

    def _take(self, data: bytes) -> None:
        """Let bytes of the bus be there, or on their way."""
        if data and (data := self.faults.spoil(data, "read")[0]):
            self._coming.append((self._late(self.now()), data))
            self._arrive()

    def _arrive(self) -> None:
        while self._coming and self._coming[0][0] <= self.now():
            self._there += self._coming.popleft()[1]

    def reset_input(self) -> None:
        """Forget the bytes that came; see `SerialBus`."""
        self._there = b""
        self._coming.clear()
        self._bus.reset_input()


_WRAPPERS: Final[dict[str, Any]] = {
    "epp": FaultyEppBus,
    "spi": FaultySpiBus,
    "serial": FaultySerialBus,
}


def faulty(kind: str, bus: Any, faults: Faults) -> Any:
    """Return a bus that does what ``bus`` does, with faults; ``kind`` as `Board.bus` has it."""
    return _WRAPPERS[kind](bus, faults)
