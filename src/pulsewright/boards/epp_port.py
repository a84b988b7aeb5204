"""One EPP port with simulated boards, as programs see it through a socket.

Model time is the clients' in wall mode; in lockstep one servo period passes for each servo cycle
that a client makes. `epp_requests` has the rules.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from typing import IO, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards import epp_requests as kernel
from pulsewright.boards.twinning import EppTwin
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError
from pulsewright.transport.bus import EPP_ACCESS
from pulsewright.transport.pollfd import POLL

CHUNK_S: Final = 0.05  # of edges in memory [s]
RECORD: Final = struct.Struct("<q4i")
LONGEST_NS: Final = 10**9  # servo period and cost of a request
FIELD: Final = {name: n for n, name in enumerate(kernel.LINK.names or ())}
SIZE, AT, REPLIED, LOGGED, RECORDED, OWN, TARGET, FD, POLLS = (
    FIELD[name]
    for name in (
        *("size", "at", "replied", "logged", "recorded"),
        *("own", "target", "fd", "polls"),
    )
)


class EppPort:
    """Boards behind requests of the EPP socket protocol.

    Parameters
    ----------
    twin : EppTwin
        Boards in their reset state, with ``access_cycles`` 0.
    lockstep_us : int
        Servo period [us]; 0: wall mode.
    access_ns : int
        Lockstep: cost of a request [ns].
    require_config : bool
        Boards answer only after a byte of configuration.
    record : binary file, optional
        Gets 24 bytes per servo cycle.
    trace : text file, optional
        Gets a line per acknowledged data write.
    edges : callable, optional
        Gets the changes of all pins in pieces, each valid during the call only.
    clock : callable
        Monotonic time [ns], that of the clients.

    Attributes
    ----------
    link : LINK
        Time, counters and faults; see `epp_requests`.
    delays : int
        Fault: replies that still come late (-1: all).
    delay_s : float
        So much later [s].

    Raises
    ------
    UsageError
        If a time is not allowed.
    """

    def __init__(
        self,
        twin: EppTwin,
        *,
        lockstep_us: int = 0,
        access_ns: int = 1500,
        require_config: bool = False,
        record: IO[bytes] | None = None,
        trace: IO[str] | None = None,
        edges: Callable[[EdgeTrace], None] | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        if not 0 <= lockstep_us * 1000 <= LONGEST_NS or not 0 <= access_ns <= LONGEST_NS:
            raise UsageError(
                f"epp port: a servo period of {lockstep_us} us and {access_ns} ns per request; "
                f"allowed are 0 (wall mode) to {LONGEST_NS // 1000} us, and 0 to {LONGEST_NS} ns"
            )
        self.twin, self._clock = twin, clock
        self.delays, self.delay_s = 0, 0.0
        self._record, self._trace, self._edges = record, trace, edges
        self._chunk = round(CHUNK_S * twin.clock_hz)
        self._link = np.zeros(1, kernel.LINK)
        self.link = self._link[0]
        self.link["clock_hz"], self.link["cost"] = twin.clock_hz, access_ns
        self.link["period"], self.link["horizon"] = lockstep_us * 1000, self._chunk
        self.link["require_config"] = require_config
        self.link["ninit"] = self.link["power"] = 1
        self.link["logging"], self.link["recording"] = trace is not None, record is not None
        self._words = memoryview(self._link.view(np.int64).data)  # quicker than fields
        self._requests = np.zeros(kernel.BLOCK, np.uint8)
        self._replies = np.zeros(kernel.REPLY_BYTES, np.uint8)
        self._in, self._out = memoryview(self._requests.data), memoryview(self._replies.data)
        self._log = np.zeros((kernel.LOG_ROWS, 3), np.int64)
        self._rows = np.zeros((kernel.LOG_ROWS, 1 + kernel.AXES), np.int64)
        self._accesses = np.zeros(255, EPP_ACCESS)
        self._polls = np.zeros(kernel.POLLS, POLL)
        self._block = np.zeros(kernel.BLOCK_WORDS, np.int64)
        self._block[9:] = [
            array.ctypes.data
            for array in (
                *(self._link, self._requests, self._replies),
                *(self._log, self._rows, self._accesses, self._polls),
            )
        ]
        self._block_at = int(self._block.ctypes.data)
        self._serve = twin.serve
        self._storage: object = None
        self.reset_line()
        self.exchange(b"")  # so that all is compiled

    @property
    def now(self) -> int:
        """Model time of the last request or command [ns]."""
        return int(self.link["now"])

    def exchange(self, data: bytes) -> tuple[bytes, bool]:
        """Carry out whole requests; bytes behind the last one are ignored.

        Parameters
        ----------
        data : bytes
            Up to 4200.

        Returns
        -------
        bytes
            Replies, also to the requests before a wrong one.
        bool
            False if a request is wrong; it and those behind it are not carried out.
        """
        replies, _, good = self._carry_out(data, -1)
        return replies, good

    def converse(self, data: bytes, fd: int, polls: NDArray[np.void]) -> tuple[bytes, bytes, bool]:
        """Carry out requests of a client, reply to it, and go on with what it sends next.

        It ends as soon as something happens at another connection, after 50 ms without or with
        requests, or where the client does not take its replies.

        Parameters
        ----------
        data : bytes
            What was received from the client and not carried out yet, up to 4200.
        fd : int
            Its socket, which does not block.
        polls : (n,) POLL
            What may happen at all connections, this one among them.

        Returns
        -------
        bytes
            Replies that are still to be sent.
        bytes
            What was received and not carried out yet.
        bool
            False if a request is wrong.
        """
        if self.delays or len(polls) > kernel.POLLS:
            fd = -1
        else:
            self._polls[: len(polls)] = polls
            self._words[POLLS] = len(polls)
        return self._carry_out(data, fd)

    def _carry_out(self, data: bytes, fd: int) -> tuple[bytes, bytes, bool]:
        words = self._words
        self._in[: len(data)] = data
        words[SIZE], words[FD] = len(data), fd
        words[AT] = words[REPLIED] = words[LOGGED] = words[RECORDED] = 0
        words[OWN] = self._clock()
        while (status := self._call()) not in (kernel.DONE, kernel.WRONG):
            if status == kernel.FULL:
                self.twin.grow()
            else:
                self._bring(words[TARGET])
        if words[LOGGED] or words[RECORDED]:
            self._note()
        rest = bytes(self._in[words[AT] : words[SIZE]])
        return bytes(self._out[: words[REPLIED]]), rest, status == kernel.DONE

    def arrive(self) -> None:
        """Bring model time to that of a command that comes now, and the boards to model time."""
        link = self.link
        if not link["started"]:
            return
        if not link["period"]:
            own, first = self._clock(), int(link["first_own"])
            apart = abs(first - int(link["first_t"])) > kernel.SLACK_NS  # not the same clock
            link["now"] = max(self.now, own - (first if apart else int(link["first_t"])))
        self._bring(kernel.cycle_of(self.now, self.twin.clock_hz))

    def delay(self) -> float:
        """Return how much later than usual the replies come that were just made [s]."""
        if not self.delays:
            return 0.0
        self.delays -= 1 if self.delays > 0 else 0
        return self.delay_s

    def power(self, on: bool) -> None:
        """Switch the boards off, which then forget everything, or on."""
        if bool(self.link["power"]) != on:
            self.link["power"] = on
            self.link["config_bytes"] = self.link["config_crc"] = 0
            self.reset_line()

    def reset_line(self) -> None:
        """Bring the boards into reset, or out of it, as nINIT, power and configuration demand."""
        self.twin.set_ninit(int(kernel.answers(self.link)))

    def finish(self) -> None:
        """Hand over what is recorded and was not handed over yet."""
        self._drain()

    # ------------------------------------------------------------------------------------- helpers

    def _call(self) -> int:
        if self.twin.storage is not self._storage:
            self._storage = self.twin.storage
            self._block[:9] = self.twin.addresses()
        return self._serve(self._block_at)

    def _bring(self, cycle: int) -> None:
        """Let time pass up to ``cycle``, in pieces whose edges fit into little memory."""
        twin = self.twin
        while twin.now < cycle:
            twin.advance(min(cycle, twin.now + self._chunk))
            self._drain()

    def _drain(self) -> None:
        piece = self.twin.drain(copy=False)
        self.link["horizon"] = self.twin.now + self._chunk
        if self._edges is not None:
            self._edges(piece)

    def _note(self) -> None:
        """Write the rows of record and trace."""
        if self._trace is not None:
            for ns, address, value in self._log[: self._words[LOGGED]].tolist():
                self._trace.write(f"{ns} W {address:02X} {value:02X}\n")
        if self._record is not None:
            for ns, *steps in self._rows[: self._words[RECORDED]].tolist():
                self._record.write(RECORD.pack(ns, *(_wrapped(step) for step in steps)))


def _wrapped(step: int) -> int:
    return (step + (1 << 31)) % (1 << 32) - (1 << 31)
