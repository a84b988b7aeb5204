"""State of the twin as its kernels see it, and what several of them do to it.

All times are cycles. Cycle n is the interval before clock edge n: a block that finds a condition in
cycle n changes registers at edge n, and others see the change in cycle n + 1. So within one cycle
every block works on what was before the edge; see `twin_kernel.edge` for the order that gives that.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.s3g.registers import (
    W_ASG_DT_VAL,
    W_LEDS,
    W_LEDS_LEDS_MASK,
    W_MSG_ALL_POST_N,
    W_MSG_ALL_PRE_N,
    W_MSG_CONTROL,
)
from pulsewright.boards.s3g.twin_channel import WORD
from pulsewright.twin.kernel import inlined, kernel
from pulsewright.twin.recorder import Rows, drive

REGISTERS: Final = 64
PORTS: Final = 2
BUFFER: Final = 256  # bytes of a request
SHADOW: Final = 16  # of them, those in registers
REPLY: Final = 16  # bytes of the longest packet sent, with its frame

# Input pins, by number; the serial lines come first.
AVR_TX, EXT_TX, RST_N, CCLK = range(4)
# Output pins, by number: LEDs, then three of each channel, then one of each port.
LEDS: Final = W_LEDS_LEDS_MASK.bit_count()
STEP, DIRECTION, ENABLE = range(3)
CHANNEL_ROWS: Final = 3

# States of the packet receiver, the command executor, the acceleration steps.
AWAIT_HEADER, AWAIT_LENGTH, AWAIT_DATA, AWAIT_CRC = range(4)
READY, READING, COPYING, REPLYING = range(4)
IDLE, WORKING, WAITING, ABORTING = range(4)
# States of the program executor.
STOPPED, RUNNING, HALTED = range(3)  # HALTED: in a wait that was not passed at first

SWITCHES: Final = (
    *("abort_dt_latched", "rx_timeout", "length_check", "hold_buffer", "req_queue", "reply_port"),
    "x_sign_extended",
)
# Set to 0 by reset. The reports' timer is 0 from ``timer_at`` on. No request is valid from
# ``invalid_from`` on; bytes are dropped from ``hold_from`` to ``hold_until``.
CLEARED: Final = (
    *("rx_state", "se_state", "asg_state", "be_state"),
    *("invalid_from", "copy_addr", "timer_at", "pending", "strobes", "hold_from", "hold_until"),
    *("steps", "dt_limit", "steps_limit", "pre", "pulse", "post"),
    # program: first cycle of FETCH, first cycle of idle
    *("pc", "error", "aborted", "be_from", "be_until"),
)
# Cycles of events, set to NEVER by reset: ``packet_at``, the pulse that tells the executor of a
# packet; ``timeout_at``, a packet is given up; ``strobes_at``, the strobe word; ``times_at``, the
# first one with other thresholds; ``se_at``, a word is read or written; ``send_at``, a byte goes to
# the UARTs; ``be_at``, DECODE; ``asg_at``, an acceleration step.
STOPS: Final = (
    *("packet_at", "timeout_at", "se_at", "send_at", "strobes_at", "times_at", "be_at", "asg_at"),
)
BOARD: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            # last edge done; no event comes before, nor of the command executor; head of the queue
            # of pin changes
            *("done", "next_event", "host_at", "head"),
            *("channels", "words", "ints_timer", "bus_pins", *SWITCHES),
            # pins; reset: first cycle of it, and first cycle after it
            *("rst_n", "cclk", "in_reset", "reset_at", "ready_at"),
            *CLEARED,
            *STOPS,
            # receiver: asking port, bytes of the request, still to come, next place, checksum
            *("lock", "length", "left", "place", "crc"),
            # ... and whether the checksum was right
            "packet_good",
            # executor: free from ``se_free`` on; words to write, place in the buffer, address of
            # the next one
            *("se_free", "copy_left", "copy_place", "copy_to"),
            # sender: ports used (bits), place in ``reply``
            *("reply_ports", "reply_length", "reply_place"),
            "mask",
            # the last word written: cycle, index, what was there
            *("wrote_at", "wrote_index", "wrote_over"),
            # the dt counter is 0 in this cycle
            "dt_origin",
        )
    ]
    + [
        ("outputs", np.int64, (REGISTERS,)),
        ("buffer", np.int64, (BUFFER,)),
        ("shadow", np.int64, (SHADOW,)),
        ("reply", np.int64, (REPLY,)),
    ]
)


class State(NamedTuple):
    """Everything there is.

    Parameters
    ----------
    board : (1,) BOARD
    channels : (channels,) CHANNEL
    ports : (2,) PORT
    lines : (2, room) int64
        Changes of the serial inputs, cycle << 1 | level.
    heard : (2, HEARD) int64
        Bytes of the serial outputs, cycle << 8 | byte.
    memory : (words,) int64
        The program.
    queue : (events, 3) int64
        Cycle, input pin and level of changes of ``rst_n`` and ``cclk`` to come, by cycle.
    rows : Rows
        Edge buffers of all output pins.
    """

    board: NDArray[np.void]
    channels: NDArray[np.void]
    ports: NDArray[np.void]
    lines: NDArray[np.int64]
    heard: NDArray[np.int64]
    memory: NDArray[np.int64]
    queue: NDArray[np.int64]
    rows: Rows


class Actions(NamedTuple):
    """What one block asks of others at a clock edge.

    Parameters
    ----------
    register : int
        Output register to write, or -1.
    value : int
        What to write.
    strobes : int
        Strobe word of the next cycle.
    clear : int
        Interrupts to clear.
    sources : int
        Interrupts to set.
    """

    register: int
    value: int
    strobes: int
    clear: int
    sources: int


NO_ACTIONS: Final = Actions(-1, 0, 0, 0, 0)


@inlined
def channel_row(c: int, pin: int) -> int:
    """Return the row of a pin of a channel."""
    return LEDS + CHANNEL_ROWS * c + pin


@inlined
def serial_row(board: Any, port: int) -> int:
    """Return the row of a serial output."""
    row: int = LEDS + CHANNEL_ROWS * board.channels + port
    return row


@inlined
def counter(board: Any, cycle: int) -> int:
    """Return the dt counter as it is in ``cycle``."""
    value: int = (cycle - board.dt_origin) & (WORD - 1)
    return value


@inlined
def next_hit(board: Any, cycle: int) -> int:
    """Return the first cycle from ``cycle`` on in which the dt counter reaches its limit."""
    limit = board.dt_limit
    if board.asg_state == ABORTING and board.abort_dt_latched == 0:
        limit = board.outputs[W_ASG_DT_VAL]
    following = (counter(board, cycle) + 1) & (WORD - 1)
    at: int = cycle + max(limit - following, 0)
    return at


@kernel
def write_output(s: State, register: int, value: int, cycle: int) -> None:
    """Write an output register at edge ``cycle``."""
    board = s.board[0]
    board.outputs[register] = value
    if register == W_LEDS:
        for n in range(LEDS):
            drive(s.rows, n, value >> n & 1, cycle)
    elif register == W_MSG_CONTROL:
        for c in range(board.channels):
            drive(s.rows, channel_row(c, ENABLE), (value >> c & 1) ^ 1, cycle)
    elif W_MSG_ALL_PRE_N <= register <= W_MSG_ALL_POST_N:
        board.times_at = cycle + 1
    elif register == W_ASG_DT_VAL and board.asg_state == ABORTING:
        board.asg_at = next_hit(board, cycle + 1)


@inlined
def be_busy(board: Any, cycle: int) -> bool:
    """Tell whether the program executor shows itself busy in ``cycle``: one cycle late."""
    if board.be_state != STOPPED:
        return bool(board.be_from < cycle)
    return bool(board.be_until >= cycle and board.aborted == 0)
