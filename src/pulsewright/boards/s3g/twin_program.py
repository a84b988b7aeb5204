"""Program executor (BE) of the twin: one event per instruction, at its DECODE cycle."""

from __future__ import annotations

from typing import Final

from pulsewright.boards.s3g.registers import (
    BE_ABORTED,
    BE_ILLEGAL,
    BE_RUNNING,
    BE_WAITING,
    CLASS_CONTROL,
    CLASS_OUTPUT,
    INT_BE_COMPLETE,
    OP_CLEAR,
    OP_DONE,
    OP_STB,
    OP_WAIT_ALL,
    OP_WAIT_ANY,
    PROG_CLASS_LSB,
    PROG_OPCODE_LSB,
    R_BE_CONTROL_PC_MASK,
    STB_BE_ABORT,
    STB_BE_START,
    W_BE_START_ADDR,
    W_BE_START_ADDR_ADDRESS_MASK,
)
from pulsewright.boards.s3g.twin_channel import WORD
from pulsewright.boards.s3g.twin_state import (
    HALTED,
    NO_ACTIONS,
    RUNNING,
    STOPPED,
    Actions,
    State,
)
from pulsewright.twin.clock import NEVER
from pulsewright.twin.kernel import inlined, kernel

OPCODE: Final = 0x3F
CODE: Final = 0xFF
COMPLETE: Final = 1 << INT_BE_COMPLETE


@inlined
def read_memory(s: State, cycle: int) -> int:
    """Return the program word that is decoded in ``cycle``: it left the memory two edges before."""
    board = s.board[0]
    index = board.pc & (board.words - 1)
    if board.wrote_at >= cycle - 1 and board.wrote_index == index:
        word: int = board.wrote_over
    else:
        word = s.memory[index]
    return word


@kernel
def write_memory(s: State, address: int, word: int, cycle: int) -> None:
    """Write a program word at edge ``cycle``."""
    board = s.board[0]
    index = address & (board.words - 1)
    board.wrote_at, board.wrote_index, board.wrote_over = cycle, index, s.memory[index]
    s.memory[index] = word
    if board.be_state == HALTED:
        board.be_at = min(board.be_at, cycle + 2)


@kernel
def execute(s: State, cycle: int, strobes: int, bus_busy: bool) -> Actions:
    """Run the executor through ``cycle``; ``bus_busy``: the host writes an output register."""
    board = s.board[0]
    if strobes >> STB_BE_ABORT & 1:
        board.be_state, board.be_at, board.aborted = STOPPED, NEVER, 1
        board.pc, board.error = 0, BE_ABORTED
        return NO_ACTIONS
    if board.be_state == STOPPED:
        if strobes >> STB_BE_START & 1:
            board.pc = board.outputs[W_BE_START_ADDR] & W_BE_START_ADDR_ADDRESS_MASK
            board.error, board.aborted, board.be_state = BE_RUNNING, 0, RUNNING
            board.be_from, board.be_at = cycle + 1, cycle + 2
        return NO_ACTIONS
    if board.be_at != cycle:
        return NO_ACTIONS
    word = read_memory(s, cycle)
    kind = word >> PROG_CLASS_LSB
    opcode = word >> PROG_OPCODE_LSB & OPCODE
    data = word & (WORD - 1)
    register, strobe, clear = -1, 0, 0
    if kind == CLASS_OUTPUT:
        if bus_busy:
            board.be_at = cycle + 1
            return NO_ACTIONS
        register = opcode
    elif kind != CLASS_CONTROL or (opcode > OP_CLEAR and opcode != OP_DONE):
        return finish(s, cycle, BE_ILLEGAL)
    elif opcode == OP_DONE:
        return finish(s, cycle, data & CODE)
    elif opcode == OP_STB:
        strobe = data
    elif opcode == OP_CLEAR:
        clear = data
    elif opcode in (OP_WAIT_ALL, OP_WAIT_ANY):
        held = board.pending & data
        passed = held == data if opcode == OP_WAIT_ALL else held != 0
        if not passed:
            board.be_state, board.error = HALTED, BE_WAITING
            # nothing changes until an interrupt comes or the word is written
            board.be_at = board.wrote_at + 2 if board.wrote_at >= cycle - 1 else NEVER
            return NO_ACTIONS
    board.be_state, board.error = RUNNING, BE_RUNNING
    board.pc = (board.pc + 1) & R_BE_CONTROL_PC_MASK
    board.be_at = cycle + 2
    return Actions(register, data, strobe, clear, 0)


@inlined
def finish(s: State, cycle: int, code: int) -> Actions:
    """End the program in ``cycle``."""
    board = s.board[0]
    board.be_state, board.be_at, board.error = STOPPED, NEVER, code
    board.be_until = cycle + 1
    return Actions(-1, 0, 0, 0, COMPLETE)
