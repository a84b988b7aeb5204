"""Cycle-exact twin of pluto-step: what the pins do at every clock cycle, from event to event.

Time is an integer, the cycle of the core clock. Where the specification leaves a choice at the
level of cycles, this is how the twin reads it:

- A change of an input "at cycle n" is first sampled by edge n; a change of an output at cycle n
  shows right after edge n. No input passes a synchroniser.
- A bus access at cycle n (`PlutoStepTwin.transact`) acts between the edges n and n + 1, after the
  tick at its time. An EPP cycle at the pins acts at its action edge, from the values before that
  edge: so a write at the pins with action edge n equals an access at cycle n, a read one at n - 1.
- nINIT low stands for the reconfiguration of the board: the first edge that samples it low sets
  every register to 0, the first one that samples it high again is edge 0.
- ``missed`` is not set where the tap changed between the two ticks, even if it changed back.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.board import resolve_switches
from pulsewright.boards.pluto_step import twin_kernel as kernel
from pulsewright.boards.pluto_step.registers import (
    CLOCK_HZ,
    DEFAULT_PROFILE,
    MAP,
    R_POSITION_VALUE_MASK,
    W_VELOCITY_VALUE_MASK,
)
from pulsewright.boards.twinning import EppTwin
from pulsewright.errors import UsageError
from pulsewright.twin.clock import NEVER
from pulsewright.twin.epp import ACCESS_NS
from pulsewright.twin.inputs import merged

BUS_INPUTS: Final = ("nwrite", "ndatastr", "naddrstr", "ninit", "data")
INPUT_PINS: Final = (*BUS_INPUTS, *(f"din{n}" for n in range(kernel.INPUTS)))
BOARD_OUTPUTS: Final = (
    *(f"step{axis}" for axis in range(kernel.AXES)),
    *(f"dir{axis}" for axis in range(kernel.AXES)),
    *(f"out{n}" for n in range(kernel.OUTS)),
    "led",
    "tristate",
)
BUS_OUTPUTS: Final = ("nwait", "nconfig", "drive", *(f"data{n}" for n in range(8)))
ACCESS_CYCLES: Final = CLOCK_HZ // 1000 * ACCESS_NS // 1_000_000


class PlutoStepTwin(EppTwin):
    """One board on an EPP bus.

    Parameters
    ----------
    profile : str
        ``exact`` or ``extended``.
    access_cycles : int
        Time of one access of `transact` [cycle]; default 1.5 us, 10 are the fastest at the pins.
        With 0 every access can have the cycle it wants.
    bus_pins : bool
        Record the pins ``nwait``, ``nconfig``, ``drive`` (the board drives the data bus) and
        ``data0`` .. ``data7`` (0 while not driven). All but ``nconfig`` follow the strobes given to
        `schedule`, not `transact`.
    **switches : int
        Switches that differ from the profile; see the register map.

    Attributes
    ----------
    input_pins : tuple of str
        Pins that `schedule` knows: those of the bus, then ``din0`` .. ``din15``.
    output_pins : tuple of str
        Pins of the trace: ``step0``, ``dir0``, ``out0`` and so on, ``led``, ``tristate`` (1: all of
        these are high-Z, and recorded as 0); then those of the bus, if recorded.
    switches : dict of str to int
        All profile switches.

    Raises
    ------
    UsageError
        If a parameter is not allowed.

    Examples
    --------
    >>> twin = PlutoStepTwin()
    >>> twin.transact(write_accesses(0x00, bytes([0x00, 0x04])))  # axis 0 at 312.5 kHz
    >>> twin.advance(40_000)  # 1 ms
    >>> len(twin.drain().edges("step0", 1))
    312
    """

    def __init__(
        self,
        profile: str = DEFAULT_PROFILE,
        *,
        access_cycles: int = ACCESS_CYCLES,
        bus_pins: bool = False,
        **switches: int,
    ) -> None:
        self.switches = resolve_switches(MAP, profile, switches)
        if access_cycles < 0:
            raise UsageError(
                f"pluto_step twin: an access of {access_cycles} cycles; 0 or more are allowed"
            )
        self.profile, self.access_cycles = profile, access_cycles
        super().__init__(
            "pluto_step",
            CLOCK_HZ,
            INPUT_PINS,
            BOARD_OUTPUTS + (BUS_OUTPUTS if bus_pins else ()),
            most={"data": 0xFF},
            high=("nwait", "nconfig") if self.switches["nwait_idle"] else ("nconfig",),
        )
        board = np.zeros(1, kernel.BOARD)
        for name in kernel.SWITCHES:
            board[name] = self.switches[name]
        board["access_cycles"], board["bus_pins"] = access_cycles, bus_pins
        board["done"], board["last_access"], board["expires_at"] = -1, -access_cycles, NEVER
        for name in ("nwrite", "ndatastr", "naddrstr", "ninit"):
            board[name] = 1
        self._s = kernel.State(
            board,
            np.zeros(kernel.AXES, kernel.AXIS),
            np.zeros((0, 3), np.int64),
            self._recorder.rows,
        )

    @property
    def next_access(self) -> int:
        """First cycle at which a further access can act."""
        free = int(self._s.board["last_access"][0]) + self.access_cycles
        return max(self.now, free)

    def set_ninit(self, level: int) -> None:
        """Bring nINIT to a level now; low holds the board in reset, where it does not answer."""
        self._settle()
        kernel.set_ninit(self._s, int(bool(level)))

    # -------------------------------------------------------------------------------------- inputs

    def set_din(self, value: int) -> None:
        """Set all digital inputs now, bit n = input n.

        Raises
        ------
        UsageError
            If the value is not in 0..0xFFFF.
        """
        most = (1 << kernel.INPUTS) - 1
        if not 0 <= value <= most:
            raise UsageError(
                f"pluto_step twin: digital inputs {value:#x}; allowed are 0..{most:#x}"
            )
        self._s.board["din"] = value

    # --------------------------------------------------------------------------------------- state

    def state(self) -> dict[str, Any]:
        """Return the registers and counters of the board as they are now.

        Returns
        -------
        dict
            ``cycle`` and ``t`` [ns] of now; registers as raw codes: ``address``, ``vel`` (12 bits),
            ``pos`` (21 bits), ``dout``, ``timing``, ``space``, ``control``; ``wd_enabled`` and
            ``tristate`` (bool), ``din``; ``steps`` (pulses with their sign [step]), ``step_edges``
            (pulses); ``missed`` (bool per axis); ``reads`` and ``writes`` (data accesses by
            register).
        """
        self._settle()
        board, axes = self._s.board[0], self._s.axes
        return {
            "cycle": self.now,
            "t": self.now * 1_000_000_000 // CLOCK_HZ,
            "address": int(board["address"]),
            "vel": (axes["velocity"] & W_VELOCITY_VALUE_MASK).tolist(),
            "pos": (axes["position"] & R_POSITION_VALUE_MASK).tolist(),
            "dout": int(board["outputs"]),
            "timing": int(board["timing"]),
            "space": int(board["space"]),
            "control": int(board["control"]),
            "wd_enabled": bool(board["enabled"]),
            "tristate": bool(board["tristate"]),
            "din": int(board["din"]),
            "steps": axes["steps"].tolist(),
            "step_edges": axes["pulses"].tolist(),
            "missed": axes["missed"].astype(bool).tolist(),
            "reads": {n: int(k) for n, k in enumerate(board["reads"]) if k},
            "writes": {n: int(k) for n, k in enumerate(board["writes"]) if k},
        }

    # ------------------------------------------------------------------------------------- helpers

    @property
    def serve(self) -> Callable[[int], int]:
        """Kernel that carries out requests of the EPP socket protocol; see `epp_requests`."""
        from pulsewright.boards.pluto_step.twin_requests import serve

        return serve

    def _state_arrays(self) -> tuple[int, int]:
        return self._s.board.ctypes.data, self._s.axes.ctypes.data

    def _done(self) -> int:
        return int(self._s.board["done"][0])

    def _run(self, cycle: int) -> bool:
        return kernel.run(self._s, cycle)

    def _transact(self, accesses: NDArray[np.void], first: int) -> int:
        return kernel.transact(self._s, accesses, first)

    def _queue(self, events: NDArray[np.int64]) -> None:
        board = self._s.board
        queue = merged(self._s.queue[int(board["head"][0]) :], events)
        board["head"], board["next_event"] = 0, 0
        self._s = self._s._replace(queue=queue)

    def _settle(self) -> None:
        """Bring the axes to the present cycle; they run only when looked at."""
        while not kernel.run_all(self._s, self._done()):
            self._grow()
