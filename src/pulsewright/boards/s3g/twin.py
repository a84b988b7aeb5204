"""Cycle-exact twin of the S3G controller: what the pins do at every clock cycle, event by event.

Time is an integer, the cycle of the clock. A change of an input "at cycle n" is first sampled by
edge n; a change of an output at cycle n shows right after edge n, and is visible in cycle n + 1 of
the specification. Where the specification leaves a choice, this is how the twin reads it:

- Reset does not touch the synchronisers of the serial inputs.
- The dt counter and what it is compared with have 32 bits: in a state without steps it wraps.
- A program instruction whose DECODE meets the abort strobe does nothing.
- ``rx_timeout`` n: the packet is given up if none of the n cycles after a byte's valid pulse has
  another one from the asking port; a byte in the last of them is still taken.
- ``req_queue``, ``hold_buffer``: bytes whose valid pulse comes while the receiver is held are
  dropped. With a queue it is held from the cycle after the checksum's valid pulse up to the one
  before the executor's DELAY; without one, in all cycles of the copy.
- ``length_check`` comes before the checksum of too short a packet; both give the same reply.
- A host samples bits in their middle, so it has a byte 9.5 bits after the start of that.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.board import resolve_switches
from pulsewright.boards.s3g import twin_kernel as kernel
from pulsewright.boards.s3g import twin_state as layout
from pulsewright.boards.s3g.registers import (
    BAUD1,
    BAUD2,
    BAUD_LIMIT,
    BAUD_UNIT,
    CHANNELS,
    CLOCK_HZ,
    DEFAULT_PROFILE,
    INTS_TIMER,
    MAP,
    MAX_CHANNELS,
    PROG_WORDS,
    READY_CYCLES,
)
from pulsewright.boards.s3g.twin_channel import CHANNEL
from pulsewright.boards.s3g.twin_protocol import be_control
from pulsewright.boards.twinning import Twin
from pulsewright.errors import BusError, UsageError
from pulsewright.twin import uart
from pulsewright.twin.clock import NEVER
from pulsewright.twin.inputs import merged

INPUT_PINS: Final = ("avr_tx", "ext_tx", "rst_n", "cclk")
BUS_OUTPUTS: Final = ("avr_rx", "ext_rx")
ASG_STATES: Final = ("idle", "working", "wait", "abort")
FIRST_ROOM: Final = 1 << 12  # changes of a serial line to come


def output_pins(channels: int) -> tuple[str, ...]:
    """Return the pins of a board other than the serial ones."""
    return (
        *(f"led{n}" for n in range(layout.LEDS)),
        *(f"mot{c}_{pin}" for c in range(channels) for pin in ("step", "dir", "enable")),
    )


class S3GTwin(Twin):
    """One board with two serial ports, 1 (pins ``avr_*``) and 2 (``ext_*``).

    The board is ready to listen 1024 cycles after cycle 0.

    Parameters
    ----------
    profile : str
        ``exact`` or ``robust``.
    channels : int
        Axes, 1..6.
    baud1, baud2 : int
        Baud rates of the ports, multiples of 100 up to 3 125 000.
    ints_timer : int
        Between reports of interrupts that stay pending, 0..2^32-1 [cycle].
    prog_words : int
        Size of the program memory, a power of 2 up to 65536.
    bus_pins : bool
        Record the pins ``avr_rx`` and ``ext_rx``.
    **switches : int
        Switches that differ from the profile; see the register map.

    Attributes
    ----------
    input_pins : tuple of str
        Pins that `schedule` knows: ``avr_tx`` and ``ext_tx``, on which the board listens, ``rst_n``
        and ``cclk``. All are high at first.
    output_pins : tuple of str
        Pins of the trace: ``led0`` .. ``led7``, ``mot0_step``, ``mot0_dir``, ``mot0_enable`` and so
        on; then those of the ports, if recorded.
    switches : dict of str to int
        All profile switches.

    Raises
    ------
    UsageError
        If a parameter is not allowed.

    Examples
    --------
    >>> twin = S3GTwin()
    >>> end = twin.send(1, bytes.fromhex("d503010000ab"))  # version, tag 1
    >>> twin.receive(1, until=100_000, count=8).hex()
    'd505010081bace34'
    """

    def __init__(
        self,
        profile: str = DEFAULT_PROFILE,
        *,
        channels: int = CHANNELS,
        baud1: int = BAUD1,
        baud2: int = BAUD2,
        ints_timer: int = INTS_TIMER,
        prog_words: int = PROG_WORDS,
        bus_pins: bool = False,
        **switches: int,
    ) -> None:
        self.switches = resolve_switches(MAP, profile, switches)
        bauds = (baud1, baud2)
        _check(channels, bauds, ints_timer, prog_words)
        super().__init__(
            "s3g",
            CLOCK_HZ,
            INPUT_PINS,
            output_pins(channels) + (BUS_OUTPUTS if bus_pins else ()),
            high=tuple(f"mot{c}_enable" for c in range(channels)),
        )
        self.profile, self.channels = profile, channels
        self._heard = np.zeros(uart.HEARD, np.uint8)  # what `receive` returns

        board = np.zeros(1, layout.BOARD)
        for name in layout.SWITCHES:
            board[name] = self.switches[name]
        board["channels"], board["words"], board["ints_timer"] = channels, prog_words, ints_timer
        board["bus_pins"] = bus_pins
        board["done"], board["wrote_at"] = -1, -NEVER
        board["rst_n"] = board["cclk"] = board["in_reset"] = 1
        board["ready_at"] = READY_CYCLES
        self._s = layout.State(
            board,
            np.zeros(channels, CHANNEL),
            uart.make_ports(CLOCK_HZ, [(baud, baud // BAUD_UNIT, BAUD_LIMIT) for baud in bauds]),
            np.zeros((layout.PORTS, FIRST_ROOM), np.int64),
            np.zeros((layout.PORTS, uart.HEARD), np.int64),
            np.zeros(prog_words, np.int64),
            np.zeros((0, 3), np.int64),
            self._recorder.rows,
        )

    def reset(self) -> None:
        """Pulse ``rst_n``, and let time pass until the board is ready again."""
        start = self._done() + 1
        self.schedule([start, start + 1], "rst_n", [0, 1])
        self.advance(start + 1 + READY_CYCLES)

    # --------------------------------------------------------------------------------- serial ports

    def send(self, port: int, data: bytes, cycle: int | None = None) -> int:
        """Send bytes to the board, back to back, without letting time pass.

        Bit k of them begins ``floor(k * clock_hz / baud)`` cycles after the first start bit.

        Parameters
        ----------
        port : int
            1 or 2.
        data : bytes
        cycle : int, optional
            Start of the first byte; default: as soon as the bytes before are out and, after
            power-up or a reset, the board listens.

        Returns
        -------
        int
            The first cycle in which another byte can start.

        Raises
        ------
        UsageError
            If there is no such port, or the cycle is over or taken.
        """
        n = self._port(port)
        if cycle is None:
            cycle = 0
        elif cycle < (free := kernel.line_free(self._s, n)):
            raise UsageError(
                f"s3g twin: a byte on port {port} at cycle {cycle}; its line is free from cycle "
                f"{free} on"
            )
        block = np.frombuffer(data, np.uint8)
        while (end := kernel.send(self._s, n, block, cycle)) < 0:
            self._make_room(n, uart.FRAME_BITS * len(block))
        return end

    def receive(self, port: int, until: int | None = None, count: int = 1) -> bytes:
        """Let time pass until the host has received bytes, and return all that it has.

        Parameters
        ----------
        port : int
            1 or 2.
        until : int, optional
            Wait through this cycle at most; by default, time does not pass.
        count : int
            Wait for so many bytes, at least 1.

        Raises
        ------
        UsageError
            If there is no such port.
        BusError
            If the host has left more than 65536 bytes unread; the older ones are lost then, and the
            next call goes on with the newer ones.
        """
        n = self._port(port)
        cycle = -1 if until is None else until
        while not kernel.run(self._s, cycle, n, count):
            self._grow()
        received = kernel.take_heard(self._s, n, self._heard)
        if received < 0:
            raise BusError(
                f"s3g twin: {-received} bytes from port {port} are lost, for a host can leave "
                f"{uart.HEARD} unread; receive more often"
            )
        return self._heard[:received].tobytes()

    # ---------------------------------------------------------------------------------------- state

    def state(self) -> dict[str, Any]:
        """Return what the board holds now, that is what its next edge sees.

        Returns
        -------
        dict
            ``cycle`` and ``t`` [ns] of now; ``ready`` (bool); ``outputs`` (64 registers);
            ``pending`` and ``mask`` of interrupts; ``be`` (as input register 62); ``asg``
            (``idle``, ``working``, ``wait``, ``abort``), ``dt`` and ``steps`` (counters). Of each
            channel ``x`` (unsigned, 64 bits), ``v``, ``a``, ``j``, ``jj``, ``sv``; ``position``
            (steps taken by the pulse former, with their sign), ``pulses`` (without it) and
            ``lost`` (steps that came during a pulse).
        """
        self._settle()
        board, channels = self._s.board[0], self._s.channels
        cycle = int(board["done"]) + 1
        ready = not board["in_reset"] or int(board["ready_at"]) == cycle
        return {
            "cycle": self.now,
            "t": self.now * 1_000_000_000 // CLOCK_HZ,
            "ready": bool(ready and int(board["reset_at"]) != cycle),
            "outputs": board["outputs"].tolist(),
            "pending": int(board["pending"]),
            "mask": int(board["mask"]),
            "be": int(be_control(board, cycle)),
            "asg": ASG_STATES[int(board["asg_state"])],
            "dt": 0 if board["in_reset"] else int(layout.counter(board, cycle)),
            "steps": int(board["steps"]),
            "x": channels["x"].astype(np.uint64).tolist(),
            **{
                name: channels[name].tolist()
                for name in ("v", "a", "j", "jj", "sv", "position", "pulses", "lost")
            },
        }

    # -------------------------------------------------------------------------------------- helpers

    def _port(self, port: int) -> int:
        if not 1 <= port <= layout.PORTS:
            raise UsageError(f"s3g twin: serial port {port}; there are 1 (avr) and 2 (ext)")
        return port - 1

    def _done(self) -> int:
        return int(self._s.board["done"][0])

    def _run(self, cycle: int) -> bool:
        return kernel.run(self._s, cycle, 0, NEVER)

    def _queue(self, events: NDArray[np.int64]) -> None:
        for n in range(layout.PORTS):
            if len(mine := events[events[:, 1] == n]):
                self._schedule_line(n, mine)
        board = self._s.board[0]
        queue = merged(self._s.queue[int(board["head"]) :], events[events[:, 1] >= layout.PORTS])
        board["head"] = board["next_event"] = 0
        self._s = self._s._replace(queue=queue)

    def _schedule_line(self, n: int, events: NDArray[np.int64]) -> None:
        serial = self._s.ports[n]
        line = self._s.lines[n, int(serial["head"]) : int(serial["tail"])]
        known = np.stack([line >> 1, np.full(len(line), n), line & 1], axis=1)
        changes = merged(known, events)
        self._make_room(n, len(changes))
        serial["head"], serial["tail"] = 0, len(changes)
        serial["free"] = max(int(serial["free"]), int(changes[-1, 0]) + 1)
        self._s.lines[n, : len(changes)] = changes[:, 0] << 1 | changes[:, 2]
        kernel.lines_changed(self._s)

    def _make_room(self, n: int, changes: int) -> None:
        """Let a line have room for so many more changes."""
        room = int(self._s.ports["tail"][n]) + changes
        old = self._s.lines
        if room > old.shape[1]:
            lines = np.zeros((layout.PORTS, 2 * room), np.int64)
            lines[:, : old.shape[1]] = old
            self._s = self._s._replace(lines=lines)

    def _settle(self) -> None:
        """Bring channels and serial outputs to the present cycle; they run only when looked at."""
        while not kernel.settle(self._s):
            self._grow()


def _check(channels: int, bauds: tuple[int, int], ints_timer: int, prog_words: int) -> None:
    """Check the parameters of a build; raise `UsageError`."""
    if not 1 <= channels <= MAX_CHANNELS:
        raise UsageError(
            f"s3g twin: {channels} channels; the registers have room for 1..{MAX_CHANNELS}"
        )
    for baud in bauds:
        if baud % BAUD_UNIT or not 0 < baud <= BAUD_UNIT * BAUD_LIMIT:
            raise UsageError(
                f"s3g twin: {baud} baud; allowed are multiples of {BAUD_UNIT} up to "
                f"{BAUD_UNIT * BAUD_LIMIT}"
            )
    if not 0 <= ints_timer < 1 << 32:
        raise UsageError(f"s3g twin: ints_timer {ints_timer}; allowed are 0..{(1 << 32) - 1}")
    if not 1 <= prog_words <= 1 << 16 or prog_words & (prog_words - 1):
        raise UsageError(
            f"s3g twin: {prog_words} program words; allowed are powers of 2 up to {1 << 16}"
        )
