"""Program memory as a ring: words are written ahead of the executor, which never waits for them.

The executor's PC counts modulo 2^16 and addresses memory modulo its size. Behind the last word
written there is always a ``DONE``, so that an executor that comes so far ends, instead of going on
into old words. New words begin by taking the place of that ``DONE``. A packet is written from its
first word on and three times slower than the executor works, so one packet may do it only while the
executor is far away; otherwise a first packet writes all but the first word, and a second one that.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from pulsewright.boards.s3g import registers as reg
from pulsewright.boards.s3g.commands import Segments, Words
from pulsewright.boards.s3g.packets import MAX_WORDS
from pulsewright.boards.s3g.words import DRY, FINISHED, control
from pulsewright.errors import BusError

if TYPE_CHECKING:
    from pulsewright.boards.s3g.driver import S3GDriver

PORTION: Final = MAX_WORDS - 1  # words of a packet, with a DONE behind them
QUARTER: Final = 4  # of a small memory: a packet takes no more
DONE: Final = control(reg.OP_DONE, DRY)
ADDRESSES: Final = 1 << 16
FAR: Final = 4  # packets that the executor must be away from words that one packet replaces
PATIENCE: Final = 4  # packets until one is given up, and a time of the host's own
HOST_TIME: Final = 0.02  # [s]
STUCK: Final = 1.0  # an executor that stays at a word for so long waits for ever [s]


class ProgramRing:
    """The words of a job on their way through program memory.

    All numbers of words count from the start of the job.

    Parameters
    ----------
    driver : S3GDriver
    grid : int
        Length of a grid step [clock].
    packet_cycles : int
        Time that a full packet takes on the link, with its reply [clock].

    Attributes
    ----------
    tail : int
        Words written: where the ``DONE`` is.
    passed : int
        Words that the executor has done for sure.
    ended : int or None
        Code with which the executor ended; None while it runs.
    """

    def __init__(self, driver: S3GDriver, *, grid: int, packet_cycles: int) -> None:
        self.tail = self.passed = 0
        self.ended: int | None = None
        self._driver, self._grid, self._packet_cycles = driver, grid, packet_cycles
        self._timeout = PATIENCE * packet_cycles / driver.bus.clock_hz + HOST_TIME
        self._started = False
        self._noted = self._moved = 0  # when the board told ``passed``, and another one before
        self._waiting = np.zeros(0, np.int64)  # words to write
        self._end = 0  # number of the word behind them
        # loads not passed, but for the last that is: word, grid step at its end, and the load
        self._word = np.zeros(0, np.int64)
        self._until = np.zeros(0, np.int64)
        self._loads: Segments | None = None

    @property
    def portion(self) -> int:
        """Most words that a packet takes, without its ``DONE``."""
        return min(PORTION, max((self._driver.prog_words - 1) // QUARTER, 1))

    @property
    def ready(self) -> bool:
        """Whether there are words to write, and room for a packet or for all of them."""
        return 0 < min(self.waiting, self.portion) <= self.room

    @property
    def waiting(self) -> int:
        """Words that are still to be written."""
        return len(self._waiting)

    @property
    def room(self) -> int:
        """Words that can be written now."""
        return self._driver.prog_words - 1 - (self.tail - self.passed)

    def append(self, more: Words) -> None:
        """Take in the next words of the job."""
        self._forget()
        steps = more.segments.steps.cumsum() + (self._until[-1] if len(self._until) else 0)
        self._word = np.concatenate([self._word, self._end + more.loads])
        self._until = np.concatenate([self._until, steps])
        self._loads = more.segments if self._loads is None else _joined(self._loads, more.segments)
        self._waiting = np.concatenate([self._waiting, more.words])
        self._end += len(more.words)

    def start(self) -> int:
        """Start the executor; return the cycle of the start strobe, see `S3GDriver`."""
        cycle = self._driver.start_program(0, self._timeout)
        self._started, self._noted, self._moved = True, cycle, cycle
        return cycle

    def write(self) -> None:
        """Write what fits in a packet; there must be words waiting, and room.

        Raises
        ------
        BusError
            If the link fails, however often it is tried, or as `poll`.
        """
        n = min(self.waiting, self.portion)
        words = [*self._waiting[:n].tolist(), DONE]
        for attempt in range(self._driver.retries + 1):
            try:
                if self._far():
                    self._send(self.tail, words)
                else:
                    self._send(self.tail + 1, words[1:])
                    if self.ended is None:
                        self._send(self.tail, words[:1])
                break
            except BusError:
                if attempt == self._driver.retries:
                    raise
                self._driver.retried += 1
                self.poll()
            if self.ended is not None:
                return
        self.tail += n
        self._waiting = self._waiting[n:]

    def poll(self) -> None:
        """Ask where the executor is.

        Raises
        ------
        BusError
            If the link fails, or the executor does what these words do not say.
        """
        status = self._driver.status(self._timeout)
        if self._started and not status.busy and status.error == reg.BE_RUNNING:
            raise BusError(
                "s3g: the board knows of no program any more: it has lost power or was reset; "
                "check its supply, reference the machine, and begin anew"
            )
        self._note(status.error, status.pc)

    def cycles_to(self, word: int) -> int:
        """Return in how much time from now the executor passes a word at the earliest [clock].

        It may be negative.
        """
        first, last = np.searchsorted(self._word, [self.passed, word])
        if first >= last or self._loads is None:
            return 0
        # at ``passed`` it may have been just about to give the first load
        steps = int(self._until[last - 1] - self._until[first])
        steps += int(self._loads.steps[first] - self._loads.steps[last - 1])
        return steps * self._grid - (self._driver.bus.now() - self._noted)

    def cycles_to_room(self, packets: int) -> int:
        """Return in how much time there may be room for some packets [clock]."""
        words = min(packets * self.portion, self._driver.prog_words // 2)
        return self.cycles_to(self.tail + words - (self._driver.prog_words - 1))

    def last_load(self) -> tuple[int, Segments]:
        """Return the grid step at the end of the last load that was given, and that load.

        Exact once the executor has ended.
        """
        k = int(np.searchsorted(self._word, self.passed)) - 1
        if k < 0 or self._loads is None:
            raise BusError("s3g: the program ended before its first load")
        return int(self._until[k]), self._loads[k : k + 1]

    def cut(self, cycles: int, first: int, last: int) -> tuple[int, Segments] | None:
        """Drop the words behind a load, the first one that is not given for ``cycles`` from now on.

        If all that is written is given earlier, it is the first load that is not written whole.

        Parameters
        ----------
        cycles : int
            [clock]
        first, last : int
            It ends after grid step ``first``, and before ``last``.

        Returns
        -------
        int
            Grid step at the end of that load.
        Segments
            The loads up to it, as far back as known.

        None if there is no such load.

        Raises
        ------
        BusError
            As `write`.
        """
        self.poll()
        if self._loads is None or self.ended is not None:
            return None
        for k in range(len(self._word)):
            end = int(self._word[k]) + 1
            if not first < self._until[k] < last:
                continue
            if end > self.tail or self.cycles_to(end) > cycles:
                break
        else:
            return None
        if end < self.tail:
            for attempt in range(self._driver.retries + 1):
                try:
                    self._send(end, [DONE])
                    break
                except BusError:
                    if attempt == self._driver.retries:
                        raise
                    self._driver.retried += 1
            self.tail = end
        self._waiting, self._end = self._waiting[: end - self.tail], end
        self._word, self._until = self._word[: k + 1], self._until[: k + 1]
        self._loads = self._loads[: k + 1]
        return int(self._until[k]), self._loads

    def _send(self, word: int, words: list[int]) -> None:
        address = word % ADDRESSES
        reply = self._driver.request(
            "WRITE_BUFFER",
            timeout=self._timeout,
            retries=0,
            count=len(words),
            address=address,
            words=words,
        )
        self._note(reply["error"], reply["pc"])

    def _note(self, error: int, pc: int) -> None:
        """Take in what the board tells of the executor."""
        if not self._started:
            return
        self._noted = self._driver.bus.now()
        done = (pc - self.passed) % ADDRESSES
        if done:
            self.passed, self._moved = self.passed + done, self._noted
        if error in (reg.BE_RUNNING, reg.BE_WAITING):
            if self._noted - self._moved > STUCK * self._driver.bus.clock_hz:
                raise BusError(
                    f"s3g: the executor stays at address {pc}; something else has loaded motion or "
                    f"written to program memory"
                )
            return
        self.ended = error
        if error not in (DRY, FINISHED):
            raise BusError(
                f"s3g: the executor ended at address {pc} with code {error:#04x}; something else "
                f"has stopped it or written to program memory"
            )

    def _far(self) -> bool:
        """Tell whether the executor stays away from the ``DONE`` for the time of a few packets."""
        return not self._started or self.cycles_to(self.tail) > FAR * self._packet_cycles

    def _forget(self) -> None:
        """Drop loads that are over."""
        k = max(int(np.searchsorted(self._word, self.passed)) - 1, 0)
        if k and self._loads is not None:
            self._word, self._until = self._word[k:], self._until[k:]
            self._loads = self._loads[k:]


def _joined(first: Segments, second: Segments) -> Segments:
    columns = (
        (first.steps, second.steps),
        (first.velocity, second.velocity),
        (first.position, second.position),
    )
    return Segments(*(np.concatenate(pair) for pair in columns))
