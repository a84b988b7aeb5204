"""Requests of the EPP socket protocol on the board of `twin`, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Names, not modules: a package would make these kernels depend on all of its files.
from pulsewright.boards.epp_requests import BLOCK_WORDS, Board, rows_at, serve_requests
from pulsewright.boards.pluto_step.twin_kernel import (
    ADDRESSES,
    AXES,
    AXIS,
    BOARD,
    State,
    run_all,
    set_ninit,
    transact,
)
from pulsewright.transport.bus import DATA_READ
from pulsewright.twin.kernel import kernel
from pulsewright.twin.memory import array_at, unlocked


@kernel
def bring(s: State, cycle: int) -> bool:
    """Do all edges up to ``cycle``, axes included; False if a buffer is full."""
    return run_all(s, cycle)


@kernel
def set_origin(s: State, cycle: int) -> None:
    """Let edge 0 be at ``cycle``; nothing has happened yet."""
    s.board[0].origin = cycle


@kernel
def is_marker(s: State, op: int, value: int) -> bool:
    """Tell whether an access is the first data read of a servo cycle, at address 0."""
    board = s.board[0]
    return bool(op == DATA_READ and board.address == 0 and not board.in_reset)


@kernel
def reads_first(s: State, count: int) -> bool:
    """Tell whether so many data reads touch address 0."""
    board = s.board[0]
    return bool(not board.in_reset and -board.address % ADDRESSES < count)


@kernel
def address(s: State) -> int:
    """Return the address register."""
    return int(s.board[0].address)


@kernel
def byte(s: State) -> int:
    """Return the byte last driven on the bus."""
    return int(s.board[0].byte)


@kernel
def set_byte(s: State, value: int) -> None:
    """Drive a byte that the board does not see."""
    s.board[0].byte = value


@kernel
def position(s: State, axis: int) -> int:
    """Return the pulses of an axis with their sign [step]."""
    return int(s.axes[axis].steps)


@unlocked
def serve(at: int) -> int:
    """Carry out requests; ``at``: where the block of addresses is. See `serve_requests`."""
    block: NDArray[np.int64] = array_at(at, BLOCK_WORDS, np.int64)
    s = State(
        array_at(block[0], 1, BOARD),
        array_at(block[1], AXES, AXIS),
        array_at(block[2], (block[3], 3), np.int64),
        rows_at(block),
    )
    board = Board(
        transact,
        bring,
        set_ninit,
        set_origin,
        is_marker,
        reads_first,
        address,
        byte,
        set_byte,
        position,
    )
    return serve_requests(s, board, block)
