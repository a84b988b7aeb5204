"""State of the twin as its kernels see it, and what several of them do to it.

All times are cycles. Clock edge n ends cycle n: what a block finds in cycle n it registers at edge
n, and others see it in cycle n + 1. So within one cycle every block works on what was before its
edge; see `twin_kernel.edge` for the order that gives that.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.rapcores.registers import MAX_DEPTH, MAX_ENCODERS, MAX_MOTORS
from pulsewright.boards.rapcores.twin_bridge import BRIDGE
from pulsewright.boards.rapcores.twin_motor import MOTOR
from pulsewright.twin.kernel import inlined, kernel
from pulsewright.twin.recorder import Rows, drive

# Profiles.
DOCUMENT, UPSTREAM, V020 = range(3)

# Input pins, by number; then A and B of each encoder.
RST_N, CS, SCK, COPI, HALT = range(5)
ENCODER_PINS: Final = 5
# Edges between a change of a pin and the one at which the twin looks at it: the pins of the bus
# have their flops in `twin_spi`.
HALT_DELAY: Final = 1  # the last flop of its synchroniser takes it there
ENCODER_DELAY: Final = 2  # counted there

# Output pins, by number; then step, dir and enable of each motor, then the legs of its bridges.
CIPO, BUFFER_DTR, MOVE_DONE = range(3)
STEP, DIRECTION, ENABLE = range(3)
MOTOR_PINS: Final = 3
FIXED_ROWS: Final = 3
LEGS: Final = 4  # of the two bridges of a motor

LONG: Final = (1 << 32) - 1  # mask of a register

# An encoder: level of its pins, those that it has seen; count and velocity, and as they were before
# the last count, which was in cycle ``last``.
ENCODER: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            *("pin_a", "pin_b", "a", "b"),
            *("position", "velocity", "last", "old_position", "old_velocity"),
        )
    ]
)

# SPI: levels of the pins, flops behind them (``sck0`` next to the pin), and the registers of the
# specification; ``shown``, the level of CIPO.
SPI: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            *("sck", "cs", "copi", "sck0", "sck1", "sck2", "cs0", "cs1", "cs2", "copi0", "copi1"),
            *("bit", "byte", "byte_flag", "byte_before", "count", "word", "word_flag"),
            *("partial", "shown"),
        )
    ]
)

# Cycles of events; NEVER if none is known.
STOPS: Final = (
    *("reset_at", "ready_at", "check_at"),  # first cycle of reset, first after it, look at inputs
    *("spi_at", "word_at", "frame_at"),  # the pins of the bus; message action; end of a frame
    *("halt_at", "sequence_at"),  # first halted cycle; load or end of a move
)
COUNTERS: Final = ("completed", "refused", "framing", "aborted", "unknown")
# Set to 0 by reset, beside the counters.
CLEARED: Final = (
    *("header", "place", "address", "reply", "accept"),
    *("run", "used", "write_slot", "slot", "piece_count"),
    *("enable", "brake", "halted", "halt_seen", "soft_halt", "pin_halt"),
    *("step_polarity", "direction_polarity", "fault"),
    # what a message does at the end of its cycle: a slot is armed, a register is written
    *("arm", "writes", "stores"),
    # of the original: flops of its tick, ready and finished slots as bits
    *("tick1", "tick2", "ready", "finished"),
)
BOARD: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            # last edge done; no event comes before; head of the queue of pin changes
            *("done", "next_event", "head"),
            # fixed
            *("profile", "fixed", "cs_reset_message", "v020_info", "bus_pins"),
            *("motors", "encoders", "word_bits", "word_bytes", "depth", "halt_pin"),
            *("position_bits", "motor_driver", "phase_pins"),
            *("rst_n", "halt", "in_reset", *STOPS, *CLEARED, *COUNTERS),
            # the word that acts at ``word_at``, the write that a message makes
            *("word_value", "write_address", "write_value", "store_value"),
            *("divider", "width", "low", "setup", "hold"),
            # ticks are at ``base``, ``base + period``, ..., and the one before at ``before``
            *("base", "period", "before"),
            # integrations of the executing move still to do: ``piece_count`` of them, from the
            # tick ``piece_first`` on
            "piece_first",
            # telemetry follows the encoders from ``idle_from`` on, while no move executes
            "idle_from",
            # of the original: cycle of its state, countdown
            *("core_cycle", "count", "ticks_left"),
        )
    ]
    + [
        ("held", np.int64, (2 * MAX_ENCODERS,)),  # telemetry since the last load
        ("snapshot", np.int64, (2 * MAX_ENCODERS,)),  # telemetry of the message
        ("duration", np.int64, (MAX_DEPTH,)),
        ("directions", np.int64, (MAX_DEPTH,)),
        ("increment", np.int64, (MAX_DEPTH, MAX_MOTORS)),
        ("change", np.int64, (MAX_DEPTH, MAX_MOTORS)),
        ("current", np.int64, (MAX_MOTORS,)),
    ]
)

# All of it: a kernel gets one pointer.
WORLD: Final = np.dtype(
    [
        ("board", BOARD),
        ("spi", SPI),
        ("motors", MOTOR, (MAX_MOTORS,)),
        ("bridges", BRIDGE, (MAX_MOTORS,)),
        ("encoders", ENCODER, (MAX_ENCODERS,)),
    ]
)


class State(NamedTuple):
    """Everything there is.

    Parameters
    ----------
    world : (1,) WORLD
        Registers and time.
    queue : (events, 3) int64
        Edge that looks at it, pin and level of changes of input pins, by edge.
    rows : Rows
        Edge buffers of all output pins.
    """

    world: NDArray[np.void]
    queue: NDArray[np.int64]
    rows: Rows


@inlined
def motor_row(i: int, pin: int) -> int:
    """Return the row of a pin of a motor."""
    return FIXED_ROWS + MOTOR_PINS * i + pin


@inlined
def bridge_row(board: Any, i: int) -> int:
    """Return the row of the first leg of the bridges of a motor."""
    row: int = FIXED_ROWS + MOTOR_PINS * board.motors + LEGS * i
    return row


@inlined
def signed(value: int) -> int:
    """Return the low 32 bits of a value as a signed number."""
    number: int = ((value + (1 << 31)) & LONG) - (1 << 31)
    return number


@inlined
def next_tick(board: Any, cycle: int) -> int:
    """Return the first tick from ``cycle`` on."""
    late = max(cycle - board.base, 0)
    tick: int = board.base + (late + board.period - 1) // board.period * board.period
    return tick


@inlined
def pieces_before(board: Any, cycle: int) -> int:
    """Return how many integrations of the executing move were due before ``cycle``."""
    if board.piece_count == 0 or cycle <= board.piece_first:
        return 0
    ticks = (cycle - 1 - board.piece_first) // board.period + 1
    return int(min(ticks, board.piece_count))


@inlined
def ticks_left(board: Any, cycle: int) -> int:
    """Return the countdown of the executing move as it is in ``cycle``."""
    if board.profile != DOCUMENT:
        return int(board.ticks_left)
    return int(board.piece_count - pieces_before(board, cycle))


@kernel
def show_ready(s: State, cycle: int) -> None:
    """Bring BUFFER_DTR to its level at edge ``cycle``."""
    board = s.world[0].board
    if board.profile == DOCUMENT:
        ready = board.used < board.depth and board.halted == 0 and board.halt_seen == 0
    else:
        ready = board.ready ^ board.finished != 3
    drive(s.rows, BUFFER_DTR, 1 if ready else 0, cycle)


@kernel
def show_directions(s: State, cycle: int) -> None:
    """Bring the direction pins of the original to the bits of its slot at edge ``cycle``."""
    board = s.world[0].board
    for i in range(board.motors):
        drive(s.rows, motor_row(i, DIRECTION), board.directions[board.slot] >> i & 1, cycle)


@inlined
def telemetry(s: State, n: int, cycle: int) -> int:
    """Return a telemetry register, position and velocity of each encoder, as it is in ``cycle``.

    While no move executes it is the encoder's register of the cycle before.
    """
    board = s.world[0].board
    if board.run or cycle <= board.idle_from:
        return int(board.held[n])
    encoder = s.world[0].encoders[n >> 1]
    late = encoder.last == cycle - 1
    if n & 1:
        return int(encoder.old_velocity if late else encoder.velocity)
    return int(encoder.old_position if late else encoder.position)


@kernel
def hold_telemetry(s: State) -> None:
    """Let telemetry keep what the encoders have, at a load."""
    board = s.world[0].board
    for e in range(board.encoders):
        board.held[2 * e] = s.world[0].encoders[e].position
        board.held[2 * e + 1] = s.world[0].encoders[e].velocity
