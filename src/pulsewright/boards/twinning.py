"""What twins have in common, whatever the board."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import BusError, UsageError
from pulsewright.transport.bus import (
    ADDRESS_READ,
    ADDRESS_WRITE,
    DATA_READ,
    DATA_WRITE,
    EPP_ACCESS,
)
from pulsewright.twin.inputs import InputPins
from pulsewright.twin.recorder import Recorder

_KNOWN: Final = np.zeros(256, np.bool_)
_KNOWN[[ADDRESS_WRITE, DATA_WRITE, DATA_READ, ADDRESS_READ]] = True


class Twin(ABC):
    """A board, cycle for cycle. Kernels do the work, in state that they share; see `twin.recorder`.

    Parameters
    ----------
    board : str
        Its name, for errors.
    clock_hz : int
        Core clock [Hz].
    inputs, outputs : tuple of str
        Pins that `schedule` knows, and pins of the trace.
    most : dict of str to int
        Highest level of inputs that are wider than one bit.
    high : tuple of str
        Outputs that are 1 at first.

    Attributes
    ----------
    input_pins, output_pins : tuple of str
    """

    _s: Any  # state of the kernels: a named tuple with the rows of the recorder in it

    def __init__(
        self,
        board: str,
        clock_hz: int,
        inputs: tuple[str, ...],
        outputs: tuple[str, ...],
        *,
        most: dict[str, int] | None = None,
        high: tuple[str, ...] = (),
    ) -> None:
        self._name = f"{board} twin"
        self.clock_hz = clock_hz
        self.input_pins, self.output_pins = inputs, outputs
        self._inputs = InputPins(self._name, inputs, most or {})
        self._recorder = Recorder(outputs, clock_hz, high)

    @property
    def now(self) -> int:
        """Present cycle: its edge is done."""
        return max(self._done(), 0)

    def advance(self, cycle: int) -> None:
        """Run through the edge ``cycle``; nothing comes over the bus meanwhile but what waits.

        Raises
        ------
        UsageError
            If the cycle is over.
        """
        if cycle < self.now:
            raise UsageError(
                f"{self._name}: advance to cycle {cycle}, but it is already {self.now}"
            )
        while not self._run(cycle):
            self._grow()

    def drain(self, copy: bool = True) -> EdgeTrace:
        """Return all level changes since the last call, up to, not including, cycle `now`.

        Changes at `now` itself come with the next call, for the cycle may not be over.

        Parameters
        ----------
        copy : bool
            False: the arrays of the trace look into the twin's buffers and are valid only until
            time goes on. For loops that look at every chunk once.
        """
        self._settle()
        return self._recorder.drain(self.now, copy)

    def schedule(
        self, cycles: ArrayLike, pins: str | Sequence[str] | ArrayLike, levels: ArrayLike
    ) -> None:
        """Let input pins change at later cycles.

        Parameters
        ----------
        cycles : (n,) int
            First edge that samples the new level, after `now` (from 0 on if nothing has run yet).
            Any order; of several changes of one pin at one cycle the last one counts.
        pins : (n,) str or int, or one of them for all
            Names from `input_pins`, or their numbers there.
        levels : (n,) int, or one for all
            0 or 1; 0..255 for a data bus.

        Raises
        ------
        UsageError
            If a pin is unknown, a level not possible or a cycle over; nothing is scheduled then.
        """
        self._queue(self._inputs.events(cycles, pins, levels, self._done()))

    @abstractmethod
    def reset(self) -> None:
        """Bring the board to its reset state."""

    @abstractmethod
    def state(self) -> dict[str, Any]:
        """Return registers and counters as they are now."""

    @abstractmethod
    def _done(self) -> int:
        """Return the last edge that is done, -1 before the first one."""

    @abstractmethod
    def _run(self, cycle: int) -> bool:
        """Run through an edge, or until a buffer is full: then return False."""

    @abstractmethod
    def _settle(self) -> None:
        """Bring all pins to the present cycle: some run only when they are looked at."""

    @abstractmethod
    def _queue(self, events: NDArray[np.int64]) -> None:
        """Take changes of inputs, (n, 3): cycle, pin number and level."""

    def _grow(self) -> None:
        """Make room for edges."""
        self._recorder.grow()
        self._s = self._s._replace(rows=self._recorder.rows)


class EppTwin(Twin):
    """Boards on an EPP bus; inputs ``nwrite``, ``ndatastr``, ``naddrstr``, ``ninit`` and ``data``.

    Attributes
    ----------
    access_cycles : int
        Time of one access of `transact` [cycle].
    """

    access_cycles: int

    def transact(self, accesses: NDArray[np.void]) -> None:
        """Carry out EPP accesses in order.

        Parameters
        ----------
        accesses : (n,) EPP_ACCESS
            An access acts after the edge ``cycle``, but not before the present cycle nor earlier
            than ``access_cycles`` after the access before it; `ASAP` asks for just that. Filled in:
            ``cycle`` at which it acted, ``value`` of reads, ``timeout`` = 1 where no board answers
            (never for an address write; a read then gives the byte last driven).

        Raises
        ------
        BusError
            If an access has an unknown op; none has been carried out then.
        """
        if accesses.dtype != EPP_ACCESS or accesses.ndim != 1:
            raise BusError(
                f"{self._name}: accesses must be a one-dimensional array of EPP_ACCESS, not "
                f"{accesses.ndim}-dimensional of {accesses.dtype}"
            )
        known = _KNOWN[accesses["op"]]
        if not known.all():
            bad = int(known.argmin())
            raise BusError(
                f"{self._name}: access {bad} has op {int(accesses['op'][bad])}; allowed are "
                "ADDRESS_WRITE, DATA_WRITE, DATA_READ and ADDRESS_READ"
            )
        block = np.ascontiguousarray(accesses)  # the kernel is compiled for one layout
        done = 0
        while (done := self._transact(block, done)) < len(block):
            self._grow()
        if block is not accesses:
            accesses[:] = block

    def reset(self) -> None:
        """Pulse nINIT: every board goes to its reset state; the present edge is its edge 0."""
        self.set_ninit(0)
        self.set_ninit(1)

    @property
    @abstractmethod
    def serve(self) -> Callable[[int], int]:
        """Kernel that carries out requests of the EPP socket protocol; see `epp_requests`."""

    @property
    def storage(self) -> object:
        """What `addresses` are of: another object as soon as they change."""
        return self._s

    def addresses(self) -> tuple[int, ...]:
        """Return where the state is in memory now: words 0 to 8 of the block that `serve` takes."""
        rows, queue = self._s.rows, self._s.queue
        first, second = self._state_arrays()
        return (
            *(first, second, queue.ctypes.data, len(queue)),
            *(rows.cycles.ctypes.data, len(rows.cycles)),
            *(rows.pins.ctypes.data, len(rows.pins), rows.full.ctypes.data),
        )

    def grow(self) -> None:
        """Make room for edges, after a kernel has found a buffer full."""
        self._grow()

    @abstractmethod
    def _state_arrays(self) -> tuple[int, int]:
        """Return the addresses of registers and time; the second one is 0 if there is just one."""

    @abstractmethod
    def set_ninit(self, level: int) -> None:
        """Bring nINIT to a level now; low holds all boards in reset and no board answers."""

    @abstractmethod
    def _transact(self, accesses: NDArray[np.void], first: int) -> int:
        """Carry out accesses from number ``first`` on; return that of the first one not done."""
