"""Packet receiver, command executor (SE) and packet sender of the twin, one event per byte."""

from __future__ import annotations

from typing import Any, Final

from pulsewright.boards.s3g.registers import (
    CMD_CLEAR,
    CMD_EXT_VER,
    CMD_INPUT,
    CMD_MASK,
    CMD_OUTPUT,
    CMD_STB,
    CMD_VERSION,
    CMD_WRITE_BUFFER,
    CRC_POLYNOMIAL,
    EXT_VERSION_HIGH,
    EXT_VERSION_LOW,
    HEADER,
    PROG_WORD_BYTES,
    R_ASG_DT,
    R_ASG_STEP,
    R_BE_CONTROL,
    R_BE_CONTROL_BUSY_MASK,
    R_BE_CONTROL_ERROR_LSB,
    R_BE_CONTROL_WAITING_MASK,
    R_SE_REG_LB,
    REPLY_BUF_ERROR,
    REPLY_ERROR,
    REPLY_INTERRUPT,
    REPLY_OK,
    REPLY_UNKNOWN,
    REPORT_TAG,
    VERSION,
    W_SE_REG_LB,
)
from pulsewright.boards.s3g.twin_program import write_memory
from pulsewright.boards.s3g.twin_state import (
    AWAIT_CRC,
    AWAIT_DATA,
    AWAIT_HEADER,
    AWAIT_LENGTH,
    BUFFER,
    COPYING,
    HALTED,
    NO_ACTIONS,
    PORTS,
    READING,
    READY,
    REGISTERS,
    REPLYING,
    SHADOW,
    Actions,
    State,
    be_busy,
    counter,
    serial_row,
)
from pulsewright.twin import uart
from pulsewright.twin.clock import NEVER
from pulsewright.twin.kernel import inlined, kernel
from pulsewright.twin.recorder import drive

# Places in a request, and in the frame of a reply.
TAG: Final = 0
COMMAND: Final = 2
ARGUMENTS: Final = 3
PAYLOAD: Final = 2
COPY_CYCLES: Final = 6  # per word
# Cycles from the executor's decision to the hand-over of the first byte, from the last done pulse
# to the next hand-over, and to the next decision.
DECIDE, NEXT_BYTE, NEXT_DECISION = 2, 3, 4
READ_CYCLES: Final = 2
BOTH: Final = (1 << PORTS) - 1


@inlined
def crc8(crc: int, byte: int) -> int:
    """Take one more byte into a checksum."""
    crc ^= byte
    for _ in range(8):
        crc = (crc >> 1) ^ (CRC_POLYNOMIAL if crc & 1 else 0)
    return crc


# ----------------------------------------------------------------------------------------- receiver


@kernel
def receive(s: State, cycle: int, byte1: int, byte2: int) -> None:
    """Take the bytes whose valid pulses are in ``cycle``; -1 where there is none."""
    board = s.board[0]
    if board.hold_from <= cycle <= board.hold_until:
        byte1 = byte2 = -1
    if board.rx_state == AWAIT_HEADER:
        if byte1 == HEADER or byte2 == HEADER:
            board.lock = 0 if byte1 == HEADER else 1
            board.rx_state = AWAIT_LENGTH
            set_timeout(board, cycle)
        return
    byte = byte1 if board.lock == 0 else byte2
    if byte < 0:
        if cycle == board.timeout_at:
            board.rx_state, board.timeout_at = AWAIT_HEADER, NEVER
        return
    set_timeout(board, cycle)
    if board.rx_state == AWAIT_LENGTH:
        board.length = board.left = byte
        board.place = board.crc = 0
        for n in range(SHADOW):
            board.shadow[n] = 0
        board.invalid_from = cycle + 1
        board.rx_state = AWAIT_CRC if byte == 0 and board.length_check else AWAIT_DATA
    elif board.rx_state == AWAIT_DATA:
        board.buffer[board.place] = byte
        if board.place < SHADOW:
            board.shadow[board.place] = byte
        board.place = (board.place + 1) % BUFFER
        board.crc = crc8(board.crc, byte)
        board.left = (board.left - 1) % BUFFER
        if board.left == 0:
            board.rx_state = AWAIT_CRC
    else:
        board.rx_state, board.timeout_at = AWAIT_HEADER, NEVER
        board.packet_at = cycle + 1
        board.packet_good = 1 if byte == board.crc else 0
        if board.packet_good:
            board.invalid_from = NEVER
        if board.req_queue:
            board.hold_from, board.hold_until = cycle + 1, NEVER


@inlined
def set_timeout(board: Any, cycle: int) -> None:
    """Start the time that the next byte of a packet has, after one in ``cycle``."""
    board.timeout_at = cycle + board.rx_timeout if board.rx_timeout else NEVER


# ------------------------------------------------------------------------------------------- sender


@kernel
def begin_reply(board: Any, tag: int, code: int) -> None:
    """Start a packet in the reply buffer."""
    board.reply[0] = HEADER
    board.reply[PAYLOAD] = tag & 0xFF
    board.reply[PAYLOAD + 1] = tag >> 8
    board.reply[PAYLOAD + COMMAND] = code
    board.reply_length = PAYLOAD + ARGUMENTS


@inlined
def add(board: Any, value: int, count: int) -> None:
    """Add ``count`` bytes to the reply, low byte first."""
    for n in range(count):
        board.reply[board.reply_length + n] = value >> (8 * n) & 0xFF
    board.reply_length += count


@kernel
def reply(board: Any, at: int) -> None:
    """Close the packet in the reply buffer and send it; the first byte is handed over in ``at``."""
    crc = 0
    for n in range(PAYLOAD, board.reply_length):
        crc = crc8(crc, board.reply[n])
    board.reply[1] = board.reply_length - PAYLOAD
    board.reply[board.reply_length] = crc
    board.reply_length += 1
    board.reply_place, board.send_at = 0, at
    board.se_state, board.se_at, board.se_free = REPLYING, NEVER, NEVER


@kernel
def hand_over(s: State, cycle: int) -> None:
    """Give the next byte of a reply to the UARTs in ``cycle``."""
    board = s.board[0]
    byte = board.reply[board.reply_place]
    board.reply_place += 1
    done = 0
    for n in range(PORTS):
        if board.reply_ports >> n & 1:
            port = s.ports[n]
            if board.bus_pins:
                uart.show_bits(port, cycle, s.rows, serial_row(board, n))
                drive(s.rows, serial_row(board, n), 0, cycle)
            uart.start_byte(port, s.heard[n], byte, cycle)
            done = max(done, port.done)
    if board.reply_place < board.reply_length:
        board.send_at = done + NEXT_BYTE
    else:
        board.send_at = NEVER
        board.se_state, board.se_free = READY, done + NEXT_DECISION


# ----------------------------------------------------------------------------------------- executor


@inlined
def argument(board: Any, place: int, count: int) -> int:
    """Return ``count`` bytes of the request, low byte first."""
    value = 0
    for n in range(count):
        value |= board.shadow[place + n] << (8 * n)
    return value


@kernel
def least_length(board: Any) -> int:
    """Return the bytes that the command of the request needs."""
    command = board.shadow[COMMAND]
    if command == CMD_OUTPUT:
        return ARGUMENTS + 5
    if command == CMD_INPUT:
        return ARGUMENTS + 1
    if command in (CMD_STB, CMD_CLEAR, CMD_MASK):
        return ARGUMENTS + 4
    if command == CMD_WRITE_BUFFER:
        return int(ARGUMENTS + 3 + PROG_WORD_BYTES * board.shadow[ARGUMENTS])
    return ARGUMENTS


@kernel
def be_control(board: Any, cycle: int) -> int:
    """Return input register 62 as it is in ``cycle``."""
    value: int = board.error << R_BE_CONTROL_ERROR_LSB | board.pc
    if be_busy(board, cycle):
        value |= R_BE_CONTROL_BUSY_MASK
    if board.be_state == HALTED:
        value |= R_BE_CONTROL_WAITING_MASK
    return value


@kernel
def read_input(board: Any, register: int, cycle: int) -> int:
    """Return an input register as it is in ``cycle``."""
    if register == R_ASG_DT:
        return int(counter(board, cycle))
    if register == R_ASG_STEP:
        return int(board.steps)
    if register == R_BE_CONTROL:
        return int(be_control(board, cycle))
    if register == R_SE_REG_LB:
        return int(board.outputs[W_SE_REG_LB])
    return 0


@inlined
def has_request(board: Any, cycle: int) -> bool:
    """Tell whether the executor, if ready, sees a request in ``cycle``."""
    waiting: bool = board.packet_at == cycle or (board.req_queue == 1 and board.packet_at <= cycle)
    return waiting


@inlined
def reports_from(board: Any) -> int:
    """Return the cycle from which on the executor, if ready, reports an interrupt."""
    return int(board.timer_at if board.pending & board.mask else NEVER)


@inlined
def next_event(board: Any) -> int:
    """Return the cycle in which the executor, if nothing else happens, acts next."""
    packet = board.packet_at
    if board.se_state == READY:
        if board.req_queue:
            packet = max(packet, board.se_free)
        return int(min(packet, max(board.se_free, reports_from(board))))
    return int(min(board.se_at, NEVER if board.req_queue else packet))


@kernel
def execute(s: State, cycle: int) -> Actions:
    """Run the executor through ``cycle``."""
    board = s.board[0]
    if board.se_state == READY and board.se_free <= cycle:
        if has_request(board, cycle):
            board.packet_at = NEVER
            return decide(s, cycle)
        if reports_from(board) <= cycle:
            begin_reply(board, REPORT_TAG, REPLY_INTERRUPT)
            add(board, board.pending, 4)
            board.reply_ports = BOTH
            board.timer_at = cycle + 1 + board.ints_timer
            reply(board, cycle + DECIDE)
    elif board.se_at == cycle:
        if board.se_state == READING:
            add(board, read_input(board, board.shadow[ARGUMENTS] % REGISTERS, cycle), 4)
            reply(board, cycle - 1 + READ_CYCLES + DECIDE)
        else:
            copy_word(s, cycle)
    if board.packet_at == cycle and board.req_queue == 0:
        board.packet_at = NEVER  # lost
    return NO_ACTIONS


@kernel
def decide(s: State, cycle: int) -> Actions:
    """Carry out the request that the receiver holds."""
    board = s.board[0]
    tag = argument(board, TAG, 2)
    command = board.shadow[COMMAND]
    first = cycle + DECIDE  # hand-over of the reply
    actions = NO_ACTIONS
    copies = False
    board.reply_ports = 1 << board.lock if board.reply_port else BOTH
    short = board.length_check == 1 and board.length < least_length(board)
    if short or board.packet_good == 0:
        begin_reply(board, tag, REPLY_ERROR)
    elif board.length == 0:
        begin_reply(board, tag, REPLY_OK)
    else:
        begin_reply(board, tag, REPLY_OK)
        if command == CMD_VERSION:
            add(board, VERSION, 2)
        elif command == CMD_EXT_VER:
            add(board, EXT_VERSION_LOW, 4)
            add(board, EXT_VERSION_HIGH, 4)
        elif command == CMD_OUTPUT:
            value = argument(board, ARGUMENTS + 1, 4)
            actions = Actions(board.shadow[ARGUMENTS] % REGISTERS, value, 0, 0, 0)
        elif command == CMD_INPUT:
            board.se_state, board.se_at = READING, cycle + 1
            first += READ_CYCLES
        elif command == CMD_STB:
            actions = Actions(-1, 0, argument(board, ARGUMENTS, 4), 0, 0)
        elif command == CMD_CLEAR:
            actions = Actions(-1, 0, 0, argument(board, ARGUMENTS, 4), 0)
            board.timer_at = cycle + 1
        elif command == CMD_MASK:
            board.mask = argument(board, ARGUMENTS, 4)
            board.timer_at = cycle + 1
        elif command == CMD_WRITE_BUFFER:
            count = board.shadow[ARGUMENTS]
            address = argument(board, ARGUMENTS + 1, 2)
            board.copy_left, board.copy_to = count, address
            if count:
                board.copy_addr = address
                board.copy_place = ARGUMENTS + 3
                board.se_state, board.se_at = COPYING, cycle + COPY_CYCLES
                copies = True
            else:
                close_copy(board, cycle)
                board.copy_addr = address
            first += COPY_CYCLES * count
        else:
            begin_reply(board, tag, REPLY_UNKNOWN)
    if board.se_state == READY:
        reply(board, first)
    if board.req_queue:
        board.hold_until = first - DECIDE
    elif board.hold_buffer and copies:
        board.hold_from, board.hold_until = cycle + 1, first - DECIDE
    return actions


@kernel
def close_copy(board: Any, cycle: int) -> None:
    """Add what the reply to CMD_WRITE_BUFFER ends with."""
    add(board, board.copy_addr, 2)
    add(board, board.error, 1)
    add(board, board.pc, 2)


@kernel
def copy_word(s: State, cycle: int) -> None:
    """Write the word that is due in ``cycle``, unless the next request has begun."""
    board = s.board[0]
    if board.invalid_from < cycle:
        begin_reply(board, argument(board, TAG, 2), REPLY_BUF_ERROR)
        close_copy(board, cycle)
        reply(board, cycle - 1 + DECIDE)
        return
    word = 0
    for n in range(PROG_WORD_BYTES):
        word |= board.buffer[(board.copy_place + n) % BUFFER] << (8 * n)
    board.copy_place += PROG_WORD_BYTES
    write_memory(s, board.copy_to, word, cycle)
    board.copy_to = (board.copy_to + 1) & 0xFFFF
    board.copy_left -= 1
    if board.copy_left:
        board.se_at = cycle + COPY_CYCLES
    else:
        begin_reply(board, argument(board, TAG, 2), REPLY_OK)
        close_copy(board, cycle)
        reply(board, cycle + DECIDE)
