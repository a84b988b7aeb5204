"""Requests of the EPP socket protocol on the boards of `twin`, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Names, not modules: a package would make these kernels depend on all of its files.
from pulsewright.boards.epp_requests import BLOCK_WORDS, Board, rows_at, serve_requests
from pulsewright.boards.usc.twin_kernel import (
    PAGE,
    WORLD,
    State,
    advance_all,
    run,
    set_ninit,
    starts_soft_latch,
    transact,
)
from pulsewright.transport.bus import DATA_WRITE
from pulsewright.twin.kernel import kernel
from pulsewright.twin.memory import array_at, unlocked


@kernel
def bring(s: State, cycle: int) -> bool:
    """Do all edges up to ``cycle``, axes included; False if a buffer is full."""
    return run(s, cycle) and advance_all(s, cycle) and not s.rows.full[0]


@kernel
def set_origin(s: State, cycle: int) -> None:
    """Let edge 0 be at ``cycle``; nothing has happened yet."""
    s.world.bus.origin = cycle


@kernel
def is_marker(s: State, op: int, value: int) -> bool:
    """Tell whether an access is the first soft latch of a servo cycle, on the first board."""
    bus = s.world.bus
    if op != DATA_WRITE or bus.selected != 0:
        return False
    return starts_soft_latch(s, 0, bus.address % PAGE, value)


@kernel
def reads_first(s: State, count: int) -> bool:
    """Tell whether so many data reads touch register 00 of the first board."""
    bus = s.world.bus
    return bool(bus.selected == 0 and -bus.address % PAGE < count)


@kernel
def address(s: State) -> int:
    """Return the address register."""
    return int(s.world.bus.address)


@kernel
def byte(s: State) -> int:
    """Return the byte last driven on the bus."""
    return int(s.world.bus.byte)


@kernel
def set_byte(s: State, value: int) -> None:
    """Drive a byte that no board sees."""
    s.world.bus.byte = value


@kernel
def position(s: State, axis: int) -> int:
    """Return a step position of the first board [step]."""
    return int(s.world.axes[0, axis].position)


@unlocked
def serve(at: int) -> int:
    """Carry out requests; ``at``: where the block of addresses is. See `serve_requests`."""
    block: NDArray[np.int64] = array_at(at, BLOCK_WORDS, np.int64)
    s = State(
        array_at(block[0], 1, WORLD)[0],
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
