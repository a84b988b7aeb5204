"""Cycle-exact twin of RAPcores: what the pins do at every clock cycle, from event to event.

Time is an integer, the cycle of the clock. A change of an input "at cycle n" is first sampled by
edge n; a change of an output at cycle n shows right after edge n, and is visible in cycle n + 1 of
the specification. Where the specification leaves a choice, this is how the twin reads it:

- ``rst_n`` has no synchroniser: low in cycle n, it puts the board into reset from cycle n + 1 on;
  high again from cycle n on, the board is out of reset from cycle n + 255 on.
- The flops behind CS and ``halt`` start from inactive at the end of reset.
- In profiles ``upstream`` and ``v020`` what is not known of the original is 0; also STEP, unless
  ``fixed``, and what its CS flops hold in reset, which is inactive.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.board import resolve_switches
from pulsewright.boards.rapcores import twin_kernel as kernel
from pulsewright.boards.rapcores import twin_state as layout
from pulsewright.boards.rapcores.registers import (
    CLOCK_HZ,
    DEFAULT_PROFILE,
    DEPTH,
    ENCODERS,
    MAP,
    MAX_DEPTH,
    MAX_ENCODERS,
    MAX_MOTORS,
    MAX_MOTORS_32,
    MIN_HALF_PERIOD,
    MOTORS,
    POSITION_BITS,
    PROFILES,
    RESET_CYCLES,
    WORD_BITS,
)
from pulsewright.boards.rapcores.twin_bridge import LEGS
from pulsewright.boards.twinning import Twin
from pulsewright.errors import UsageError
from pulsewright.transport.spi_bus import check_frame, frame_cycles
from pulsewright.twin.clock import NEVER
from pulsewright.twin.inputs import merged

NAME: Final = "rapcores twin"
BUS_INPUTS: Final = ("rst_n", "cs", "sck", "copi", "halt")
IDLE_HIGH: Final = ("rst_n", "cs", "halt")
OUTPUTS: Final = ("cipo", "buffer_dtr", "move_done")
PROFILE_CODES: Final = {
    "document": layout.DOCUMENT,
    "upstream": layout.UPSTREAM,
    "v020": layout.V020,
}
WORDS: Final = 66  # of the longest message of the board
POSITION_BITS_V020: Final = (24, 32)


def input_pins(encoders: int) -> tuple[str, ...]:
    """Return the input pins of a board."""
    return (*BUS_INPUTS, *(f"enc{e}_{pin}" for e in range(encoders) for pin in "ab"))


def output_pins(motors: int, motor_driver: int = 0) -> tuple[str, ...]:
    """Return the output pins of a board."""
    pins = (*OUTPUTS, *(f"{pin}{i}" for i in range(motors) for pin in ("step", "dir", "en")))
    if motor_driver:
        pins += tuple(f"phase{i}_{leg}" for i in range(motors) for leg in LEGS)
    return pins


class RapcoresTwin(Twin):
    """One board.

    It is in reset in cycles 0..254.

    Parameters
    ----------
    profile : str
        ``document``, ``upstream`` or ``v020``.
    motors : int
        1..32, with words of 32 bits 1..24.
    encoders : int
        0..64.
    word_bits : int
        64 or 32; 64 in profiles ``upstream`` and ``v020``.
    depth : int
        Slots for moves, a power of two, 2..64; 2 in profiles ``upstream`` and ``v020``.
    halt_pin : int
        1: the pin ``halt`` is built.
    position_bits : int
        Of an encoder position in replies: 32; in profile ``v020`` 24 is possible.
    motor_driver : int
        1, in profile ``document``: there are dual H-bridges, too.
    bus_pins : bool
        Record the pin ``cipo``. Frames are sent bit by bit then, which takes far longer.
    phase_pins : int
        0: pins of dual H-bridges are not recorded, and stay 0. Those of a motor that is driven
        change 125 000 times a second, whether it moves or not.
    **switches : int
        Switches that differ from the profile; see the register map.

    Attributes
    ----------
    input_pins : tuple of str
        Pins that `schedule` knows: ``rst_n``, ``cs``, ``sck``, ``copi``, ``halt``, then ``enc0_a``,
        ``enc0_b`` and so on. ``rst_n``, ``cs`` and ``halt`` are high at first, the others low.
    output_pins : tuple of str
        Pins of the trace: ``cipo``, ``buffer_dtr``, ``move_done``, then ``step0``, ``dir0``,
        ``en0`` and so on; with ``motor_driver``, then ``phase0_a1``, ``phase0_a2``, ``phase0_b1``,
        ``phase0_b2`` and so on.
    switches : dict of str to int
        All profile switches.

    Raises
    ------
    UsageError
        If a parameter is not allowed.

    Examples
    --------
    >>> twin = RapcoresTwin()
    >>> words = bytes.fromhex("00000000000000f1 0000000000000000")  # read status 0, the version
    >>> reply, end = twin.transfer(300, words, 6)
    >>> reply[8:].hex()
    '0003000100000000'
    """

    def __init__(
        self,
        profile: str = DEFAULT_PROFILE,
        *,
        motors: int = MOTORS,
        encoders: int = ENCODERS,
        word_bits: int = WORD_BITS,
        depth: int = DEPTH,
        halt_pin: int = 1,
        position_bits: int = POSITION_BITS,
        motor_driver: int = 0,
        bus_pins: bool = False,
        phase_pins: int = 1,
        **switches: int,
    ) -> None:
        self.switches = resolve_switches(MAP, profile, switches)
        _check(profile, motors, encoders, word_bits, depth, halt_pin, position_bits, motor_driver)
        _check_switches(profile, word_bits, self.switches)
        self.profile, self.motors, self.encoders = profile, motors, encoders
        self.word_bits, self.bus_pins = word_bits, bus_pins
        self._word_bytes = word_bits // 8
        super().__init__(
            *("rapcores", CLOCK_HZ, input_pins(encoders), output_pins(motors, motor_driver)),
            high=("buffer_dtr",),
        )
        self._delay = np.full(len(self.input_pins), layout.ENCODER_DELAY)
        self._delay[: layout.ENCODER_PINS] = 0
        self._delay[layout.HALT] = layout.HALT_DELAY

        world = np.zeros(1, layout.WORLD)
        self._board, self._motors = world["board"][0], world["motors"][0]
        self._encoders, self._spi = world["encoders"][0], world["spi"][0]
        board = self._board
        board["profile"] = PROFILE_CODES[profile]
        for name, value in self.switches.items():
            board[name] = value
        board["motors"], board["encoders"], board["depth"] = motors, encoders, depth
        board["word_bits"], board["word_bytes"] = word_bits, word_bits // 8
        board["halt_pin"], board["position_bits"], board["bus_pins"] = (
            halt_pin,
            position_bits,
            bus_pins,
        )
        board["motor_driver"], board["phase_pins"] = motor_driver, motor_driver and phase_pins
        board["done"], board["rst_n"], board["halt"] = -1, 1, 1
        board["spi_at"], board["ready_at"] = NEVER, RESET_CYCLES
        self._spi["cs"] = 1
        self._s = layout.State(world, np.zeros((0, 3), np.int64), self._recorder.rows)
        kernel.enter_reset(self._s, -1)
        self._block = np.zeros(kernel.BLOCK, np.int64)
        self._block_at = self._block.ctypes.data
        self._make_words(WORDS)

    def reset(self) -> None:
        """Pulse ``rst_n``, and let time pass until the board listens again."""
        start = self._done() + 1
        self.schedule([start, start + 1], "rst_n", [0, 1])
        self.advance(start + 1 + RESET_CYCLES)

    # ----------------------------------------------------------------------------------------- bus

    def transfer(self, cycle: int, data: bytes, half: int = MIN_HALF_PERIOD) -> tuple[bytes, int]:
        """Send one frame.

        CS falls at ``cycle``, and the first bit is set up ``half`` cycles later. From there on, SCK
        is low and high for ``half`` cycles each. COPI changes as SCK falls; CIPO is sampled in the
        last cycle before SCK rises. CS rises ``half`` cycles after the last fall. Time passes up to
        there.

        Parameters
        ----------
        cycle : int
            After `now`.
        data : bytes
            At least one.
        half : int
            Half a period of SCK, at least 1 [cycle]; replies are right with 6 and more.

        Returns
        -------
        bytes
            As many as were sent.
        int
            First cycle at which the next frame may begin.

        Raises
        ------
        UsageError
            If there are no bytes, or a parameter is not allowed.
        """
        if half >= MIN_HALF_PERIOD and data and len(data) % self._word_bytes == 0:
            reply = self._transfer_words(cycle, data, half)
            if reply is not None:
                return reply, cycle + frame_cycles(len(data), half)
        check_frame(data)
        if half < 1:
            raise UsageError(f"{NAME}: half a period of {half} cycles; at least 1 is allowed")
        if cycle <= self._done():
            raise UsageError(
                f"{NAME}: a frame at cycle {cycle}, but that is over; cycles from "
                f"{self.now + 1} on are allowed"
            )
        return self._transfer_bits(cycle, data, half), cycle + frame_cycles(len(data), half)

    def _transfer_words(self, cycle: int, data: bytes, half: int) -> bytes | None:
        """Send a frame of whole words at once; None, and nothing sent, if that cannot be done."""
        length = len(data)
        count = length // self._word_bytes
        if count > len(self._words):
            self._make_words(count)
        self._bytes[:length] = data
        place = kernel.FRESH
        while place <= count:
            place = kernel.transfer(self._block_at, place, cycle, half, count)
            if place == kernel.NOT_BY_WORDS:
                return None
            if place <= count:
                self._grow()
        return bytes(self._bytes[:length])

    def _make_words(self, count: int) -> None:
        """Make room for the words of a frame, which are also its bytes."""
        size = np.int64 if self.word_bits == WORD_BITS else np.int32
        self._bytes = bytearray(count * self._word_bytes)
        self._words = np.frombuffer(self._bytes, size)
        self._locate()

    def _locate(self) -> None:
        """Write down where everything is, for kernels that look there."""
        world, queue, rows = self._s
        self._block[:] = (
            *(world.ctypes.data, queue.ctypes.data, len(queue)),
            *(rows.cycles.ctypes.data, len(rows.cycles)),
            *(rows.pins.ctypes.data, len(rows.pins), rows.full.ctypes.data),
            self._words.ctypes.data,
        )

    def _transfer_bits(self, cycle: int, data: bytes, half: int) -> bytes:
        bits = np.unpackbits(np.frombuffer(data, np.uint8))
        setup = cycle + half + 2 * half * np.arange(len(bits))
        rises = setup + half
        self.schedule([cycle, rises[-1] + 2 * half], "cs", [0, 1])
        self.schedule(rises, "sck", 1)
        self.schedule(rises + half, "sck", 0)
        self.schedule(setup, "copi", bits)
        reply = []
        for rise in rises.tolist():
            # the level visible in the cycle before the rise is that after the edge before it
            self.advance(rise - 2)
            reply.append(int(self._spi["shown"]))
        self.advance(int(rises[-1]) + 2 * half)
        return np.packbits(reply).tobytes()

    # --------------------------------------------------------------------------------------- state

    def level(self, pin: str) -> int:
        """Return the level of an output pin now.

        Raises
        ------
        UsageError
            If there is no such output pin.
        """
        if pin not in self.output_pins:
            raise UsageError(
                f"{NAME}: no output pin '{pin}'; the pins are {', '.join(self.output_pins)}"
            )
        if pin == "cipo":
            return int(self._spi["shown"])
        self._settle()
        return int(self._s.rows.pins["level"][self.output_pins.index(pin)])

    def positions(self) -> list[int]:
        """Return the integer part of all accumulators now, signed, as the next edge sees it."""
        self._settle()
        position = self._motors["position"][: self.motors]
        return np.asarray(position).astype(np.int32).tolist()  # type: ignore[no-any-return]

    def state(self) -> dict[str, Any]:
        """Return what the board holds now, that is what its next edge sees.

        Returns
        -------
        dict
            ``cycle`` and ``t`` [ns] of now; ``in_reset``, ``executing``, ``halted``, ``halt_seen``
            (bool); ``used`` (slots), ``ticks_left``; counters ``completed``, ``refused``,
            ``framing``, ``aborted``, ``unknown``; ``divider``, ``enable``, ``fault`` (mask). Of
            each motor ``position`` [step], ``fraction`` [2^-63 step], ``increment``, ``backlog``
            [step], ``lost`` (bool), ``current``. Of each encoder ``encoder_position`` and
            ``encoder_velocity``.
        """
        self._settle()
        board, motors = self._board, self._motors[: self.motors]
        encoders = self._encoders[: self.encoders]
        return {
            "cycle": self.now,
            "t": self.now * 1_000_000_000 // CLOCK_HZ,
            "in_reset": bool(board["in_reset"]),
            "executing": bool(board["run"]),
            "halted": bool(board["halted"]),
            "halt_seen": bool(board["halt_seen"]),
            "ticks_left": int(layout.ticks_left(self._s.world[0]["board"], int(board["done"]) + 1)),
            **{
                name: int(board[name])
                for name in ("used", "divider", "enable", "fault", *layout.COUNTERS)
            },
            "position": self.positions(),
            **{name: motors[name].tolist() for name in ("fraction", "increment", "backlog")},
            "lost": (motors["lost"] != 0).tolist(),
            "current": board["current"][: self.motors].tolist(),
            "encoder_position": encoders["position"].tolist(),
            "encoder_velocity": encoders["velocity"].tolist(),
        }

    # ------------------------------------------------------------------------------------- helpers

    def _done(self) -> int:
        return int(self._board["done"])

    def _run(self, cycle: int) -> bool:
        return bool(kernel.run(self._s, cycle))

    def _settle(self) -> None:
        while not kernel.settle(self._s):
            self._grow()

    def _queue(self, events: NDArray[np.int64]) -> None:
        board = self._board
        if len(events) and events[:, 1].min() >= layout.ENCODER_PINS:
            events[:, 0] += layout.ENCODER_DELAY
        else:
            events[:, 0] += self._delay[events[:, 1]]
        self._s = self._s._replace(queue=merged(self._s.queue[int(board["head"]) :], events))
        board["head"] = board["next_event"] = 0
        self._locate()

    def _grow(self) -> None:
        super()._grow()
        self._locate()


def _check(
    profile: str,
    motors: int,
    encoders: int,
    word_bits: int,
    depth: int,
    halt_pin: int,
    position_bits: int,
    motor_driver: int,
) -> None:
    """Check the parameters of a build; raise `UsageError`."""
    document, v020 = profile == "document", profile == "v020"
    most = MAX_MOTORS if word_bits == WORD_BITS else MAX_MOTORS_32
    depths = [1 << n for n in range(1, MAX_DEPTH.bit_length())] if document else [DEPTH]
    allowed: dict[str, tuple[int, Sequence[int]]] = {
        "word_bits": (word_bits, (32, WORD_BITS) if document else (WORD_BITS,)),
        "motors": (motors, range(1, most + 1)),
        "encoders": (encoders, range(MAX_ENCODERS + 1)),
        "depth": (depth, depths),
        "halt_pin": (halt_pin, (0, 1)),
        "position_bits": (position_bits, POSITION_BITS_V020 if v020 else (POSITION_BITS,)),
        "motor_driver": (motor_driver, (0, 1) if document else (0,)),
    }
    for name, (value, values) in allowed.items():
        if value not in values:
            text = f"{values[0]}..{values[-1]}" if isinstance(values, range) else str(list(values))
            raise UsageError(
                f"{NAME}: {name} = {value} in profile {profile} with words of {word_bits} "
                f"bits; allowed are {text}"
            )


def _check_switches(profile: str, word_bits: int, switches: dict[str, int]) -> None:
    """Check that the switches belong to the profile; raise `UsageError`."""
    owner = {"fixed": "upstream", "cs_reset_message": "document", "v020_info": "document"}
    for name, value in switches.items():
        if profile != owner[name] and value != PROFILES[profile][name]:
            raise UsageError(
                f"{NAME}: {name} = {value} in profile {profile}; the switch is for profile "
                f"{owner[name]}"
            )
    if switches["v020_info"] and word_bits != WORD_BITS:
        raise UsageError(f"{NAME}: v020_info needs words of {WORD_BITS} bits, not of {word_bits}")
