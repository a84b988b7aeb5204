"""Cycle-exact twin of the USC: what the pins do at every clock cycle, from event to event.

Time is an integer, the cycle of the core clock. Where the specification leaves a choice at the
level of cycles, this is how the twin reads it:

- A change of an input "at cycle n" is first sampled by edge n; a change of an output at cycle n
  shows right after edge n. Inputs pass a two-flop synchroniser, so edge n + 2 is the first to use
  them; ``enc_filter`` delays encoder inputs (A, B, index) by ``enc_filter - 1`` more edges. Digital
  inputs and the estop chain are synchronised, not filtered.
- A bus access at cycle n (`UscTwin.transact`) acts between the edges n and n + 1, after the tick at
  its time. An EPP cycle at the pins acts at its action edge, from the values before that edge.
- A ahead of B counts up. An index reset wins over a count of the same edge.
- A counter whose load position bit is 1 shows the assembly register at all times.
- The Intr line has no delay: all boards latch at the edge of the event.
- A watchdog feed at the edge of expiry wins.
- Reset does not touch synchronisers, filters and the levels that the decoders saw last.
- At the pins, nINIT is sampled like any other input of the bus, and the first edge that samples it
  high is edge 0. The byte for the data bus changes with address and data reads of a selected board
  only; with both strobes low, a read is a data read. Strobes too short for the action increment the
  address.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.board import resolve_switches
from pulsewright.boards.twinning import EppTwin
from pulsewright.boards.usc import twin_kernel as kernel
from pulsewright.boards.usc.registers import (
    CLOCK_HZ,
    DEFAULT_PROFILE,
    MAP,
    TICK_HZ,
    W_SETUP_RESET,
    W_WIDTH_RESET,
)
from pulsewright.errors import UsageError
from pulsewright.twin.clock import NEVER
from pulsewright.twin.epp import ACCESS_NS
from pulsewright.twin.inputs import merged

BUS_INPUTS: Final = ("nwrite", "ndatastr", "naddrstr", "ninit", "data")
BOARD_INPUTS: Final = (
    *(f"{pin}{axis}" for pin in ("a", "b", "index") for axis in range(4)),
    *(f"din{n}" for n in range(15)),
    "estop_chain",
)
BUS_OUTPUTS: Final = ("nwait", "drive", *(f"data{n}" for n in range(8)))
BOARD_OUTPUTS: Final = (
    *(f"step{axis}" for axis in range(4)),
    *(f"dir{axis}" for axis in range(4)),
    *(f"out{n}" for n in range(7)),
    *(f"dac{n}" for n in range(8)),
    "running",
)


def _of_boards(pins: tuple[str, ...], boards: int) -> tuple[str, ...]:
    return tuple(f"b{b}.{pin}" if b else pin for b in range(boards) for pin in pins)


class UscTwin(EppTwin):
    """One or more USC boards on an EPP bus.

    Parameters
    ----------
    profile : str
        ``document`` or ``linuxcnc``.
    boards : int
        Boards on the bus, 1..8; the first one answers at ``base``, the others at the next bases.
    clock_hz : int
        Core clock [Hz], a multiple of 10 MHz.
    access_cycles : int, optional
        Time of one access of `transact` [cycle]; default 1.5 us. With 0 every access can have the
        cycle it wants.
    bus_pins : bool
        Record the pins ``nwait``, ``drive`` (a board drives the data bus) and ``data0`` ..
        ``data7`` (0 while not driven). They follow the strobes given to `schedule`, not `transact`.
    nwait_idle : int
        Level of ``nwait`` while no board acknowledges.
    **switches : int
        Switches that differ from the profile: ``div_offset``, ``time_code``, ``min_space``,
        ``ident``, ``sense_gate``, ``watchdog_us``, ``mariss``, ``loopback``, ``base``,
        ``enc_filter``.

    Attributes
    ----------
    input_pins : tuple of str
        Pins that `schedule` knows: those of the bus, then ``a0``, ``b0``, ``index0``, ``din0``,
        ``estop_chain`` and so on of each board. Pins of boards after the first are prefixed with
        their number: ``b1.din0``.
    output_pins : tuple of str
        Pins of the trace: ``step0``, ``dir0``, ``out0``, ``dac0``, ``running`` (1 = not in estop)
        and so on of each board, prefixed likewise; then those of the bus, if recorded.
    switches : dict of str to int
        All profile switches.

    Raises
    ------
    UsageError
        If a parameter is not allowed.

    Examples
    --------
    >>> from pulsewright.transport.virtual import VirtualEppBus
    >>> twin = UscTwin(profile="linuxcnc", boards=2)
    >>> VirtualEppBus(twin).read(0x2F, 1).hex()  # module ID of the second board
    '41'
    >>> twin.advance(40_000)  # 1 ms
    >>> twin.state()["estop"]
    True
    """

    def __init__(
        self,
        profile: str = DEFAULT_PROFILE,
        boards: int = 1,
        clock_hz: int = CLOCK_HZ,
        *,
        access_cycles: int | None = None,
        bus_pins: bool = False,
        nwait_idle: int = 0,
        **switches: int,
    ) -> None:
        self.switches = resolve_switches(MAP, profile, switches)
        base = self.switches["base"]
        if not 1 <= boards <= kernel.BOARDS_MAX - base:
            raise UsageError(
                f"usc twin: {boards} boards from base {base} on; allowed are "
                f"1..{kernel.BOARDS_MAX - base} of them (bases 0..{kernel.BOARDS_MAX - 1})"
            )
        if clock_hz < TICK_HZ or clock_hz % TICK_HZ:
            raise UsageError(
                f"usc twin: core clock {clock_hz} Hz; allowed are multiples of {TICK_HZ} Hz"
            )
        if access_cycles is None:
            access_cycles = clock_hz // 1000 * ACCESS_NS // 1_000_000
        if access_cycles < 0:
            raise UsageError(
                f"usc twin: an access of {access_cycles} cycles; 0 or more are allowed"
            )
        if nwait_idle not in (0, 1):
            raise UsageError(f"usc twin: nwait_idle = {nwait_idle}; allowed are 0 and 1")
        super().__init__(
            "usc",
            clock_hz,
            BUS_INPUTS + _of_boards(BOARD_INPUTS, boards),
            _of_boards(BOARD_OUTPUTS, boards) + (BUS_OUTPUTS if bus_pins else ()),
            most={"data": 255},
            high=("nwait",) if nwait_idle else (),
        )
        self.profile, self.access_cycles, self.boards = profile, access_cycles, boards

        world = np.zeros(1, kernel.WORLD)
        self._bus, self._boards = world["bus"][0], world["boards"][0]
        self._axes = world["axes"][0]
        bus, board, inputs = self._bus, self._boards, world["inputs"][0]
        fixed = ("div_offset", "time_code", "min_space", "ident", "sense_gate", "watchdog_us")
        for name in (*fixed, "mariss", "enc_filter", "base"):
            bus[name] = self.switches[name]
        bus["boards"] = boards
        bus["tick"], bus["access_cycles"] = clock_hz // TICK_HZ, access_cycles
        bus["bus_pins"], bus["nwait_idle"] = bus_pins, nwait_idle
        bus["done"], bus["last_access"], bus["intr_until"] = -1, -access_cycles, -1
        for name in ("nwrite", "ndatastr", "naddrstr", "ninit"):
            bus[name] = 1
        bus["selected"] = -1 if base else 0
        bus["next_accept"] = NEVER
        board["setup"], board["width"] = W_SETUP_RESET, W_WIDTH_RESET
        board["loopback"] = self.switches["loopback"]
        board["chain"], board["watchdog_at"], board["timer_at"] = 1, -1, NEVER
        for name in ("seen", "level"):
            inputs[name][kernel.CHAIN_PIN :: kernel.INPUT_PINS] = 1
        inputs["accept_at"] = NEVER
        self._s = kernel.State(world[0], np.zeros((0, 3), np.int64), self._recorder.rows)

    def set_ninit(self, level: int) -> None:
        """Bring nINIT to a level now; low holds all boards in reset and no board answers."""
        self._settle()
        kernel.set_ninit(self._s, int(bool(level)))

    # -------------------------------------------------------------------------------------- inputs

    def set_din(self, value: int, board: int = 0) -> None:
        """Set all digital inputs of a board now, bit n = input n, past the synchroniser.

        Raises
        ------
        UsageError
            If the value is not in 0..0x7FFF or there is no such board.
        """
        if not 0 <= value < 1 << 15:
            raise UsageError(f"usc twin: digital inputs {value:#x}; allowed are 0..0x7fff")
        first = self._board(board) * kernel.INPUT_PINS + kernel.DIN_PIN
        self._settle()
        for n in range(15):
            kernel.set_input(self._s, first + n, value >> n & 1)

    def set_estop_chain(self, closed: bool, board: int = 0) -> None:
        """Close or open the estop chain of a board now, past the synchroniser."""
        pin = self._board(board) * kernel.INPUT_PINS + kernel.CHAIN_PIN
        self._settle()
        kernel.set_input(self._s, pin, int(bool(closed)))

    def set_encoder(self, axis: int, value: int, board: int = 0) -> None:
        """Set an encoder counter now, modulo 2^24.

        Nothing happens while the board is in reset or the axis' load position bit is 1.
        """
        self._board(board, axis)
        self._settle()
        kernel.set_encoder(self._s, board, axis, value % (kernel.COUNT_MASK + 1))

    def index_edge(self, axis: int, board: int = 0) -> None:
        """Give a rising index edge now; the level of the pin stays. Nothing while in reset."""
        self._board(board, axis)
        self._settle()
        if not self._bus["in_reset"]:
            kernel.index_edge(self._s, board, axis, int(self._axes["encoder"][board, axis]))

    def set_loopback(self, on: bool, board: int = 0) -> None:
        """Switch the step loopback of a board now."""
        self._board(board)
        self._settle()
        self._boards["loopback"][board] = bool(on)

    # --------------------------------------------------------------------------------------- state

    def state(self, board: int = 0) -> dict[str, Any]:
        """Return the registers and counters of a board as they are now.

        Returns
        -------
        dict
            ``now`` [cycle] and ``t``, the same in ns; registers as raw codes: ``assembly``,
            ``rate`` (divisors), ``rate_ctrl``, ``setup``, ``width``, ``dout``, ``extra``,
            ``enc_ctrl``, ``index_reset``, ``timer``, ``slave``, ``index_sense``; ``enc`` and
            ``latch`` (counters and holding registers, unsigned); ``steps`` (signed position
            [step]), ``step_edges`` (pulses); ``din``; ``estop`` (True while in estop),
            ``estop_in`` (chain closed), ``loopback``, ``watchdog_left`` (ticks until it expires, 0
            if expired, None if off), ``address`` (address register); ``reads`` and ``writes`` (data
            accesses by register).
        """
        self._board(board)
        self._settle()
        registers, axes, bus = self._boards[board], self._axes[board], self._bus
        left = int(registers["watchdog_at"] - self.now) * TICK_HZ
        return {
            "now": self.now,
            "t": self.now * 1_000_000_000 // self.clock_hz,
            "address": int(bus["address"]),
            "assembly": int(registers["assembly"]),
            "rate": axes["divisor"].tolist(),
            "rate_ctrl": int(registers["rate_control"]),
            "setup": int(registers["setup"]),
            "width": int(registers["width"]),
            "dout": int(registers["outputs"]),
            "extra": int(registers["dac"]),
            "enc": axes["encoder"].tolist(),
            "latch": axes["latch"].tolist(),
            "enc_ctrl": int(registers["encoder_control"]),
            "index_reset": int(registers["index_reset"]),
            "index_sense": int(registers["index_sense"]),
            "timer": int(registers["timer"]),
            "slave": int(registers["slave"]),
            "steps": axes["position"].tolist(),
            "step_edges": axes["pulses"].tolist(),
            "din": int(registers["din"]),
            "estop": not registers["running"],
            "estop_in": bool(registers["chain"]),
            "loopback": bool(registers["loopback"]),
            "watchdog_left": max(0, -(-left // self.clock_hz)) if bus["watchdog_us"] else None,
            "reads": {n: int(k) for n, k in enumerate(registers["reads"]) if k},
            "writes": {n: int(k) for n, k in enumerate(registers["writes"]) if k},
        }

    # ------------------------------------------------------------------------------------- helpers

    @property
    def serve(self) -> Callable[[int], int]:
        """Kernel that carries out requests of the EPP socket protocol; see `epp_requests`."""
        from pulsewright.boards.usc.twin_requests import serve

        return serve

    def _state_arrays(self) -> tuple[int, int]:
        return int(self._s.world.__array_interface__["data"][0]), 0

    def _done(self) -> int:
        return int(self._bus["done"])

    def _run(self, cycle: int) -> bool:
        return kernel.run(self._s, cycle)

    def _transact(self, accesses: NDArray[np.void], first: int) -> int:
        return kernel.transact(self._s, accesses, first)

    def _queue(self, events: NDArray[np.int64]) -> None:
        events[:, 0] += np.where(events[:, 1] < kernel.BUS_PINS, 0, kernel.SYNCHRONISER)
        self._s = self._s._replace(queue=merged(self._s.queue[int(self._bus["head"]) :], events))
        self._bus["head"] = self._bus["next_event"] = 0

    def _settle(self) -> None:
        """Bring the axes to the present cycle; they run only when looked at."""
        done = int(self._bus["done"])
        while not kernel.advance_all(self._s, done) or self._s.rows.full[0]:
            self._grow()

    def _board(self, board: int, axis: int = 0) -> int:
        if not 0 <= board < self.boards:
            raise UsageError(f"usc twin: board {board}; allowed are 0..{self.boards - 1}")
        if not 0 <= axis < kernel.AXES:
            raise UsageError(f"usc twin: axis {axis}; allowed are 0..{kernel.AXES - 1}")
        return board
