"""Messages of the twin: what a word does, and what it replies.

A word acts in the cycle in which the word flag of the bus rises. It sees everything as it is in
that cycle; what it changes is visible in the next one. What others would see too early, a slot that
is armed and a register that is written, is kept for the end of the cycle (`arm`, `writes`).
"""

from __future__ import annotations

from typing import Any, Final

from pulsewright.boards.rapcores.registers import (
    BUILD_ID,
    HEADER_CONFIG_READ,
    HEADER_CONFIG_SWAP,
    HEADER_MOVE,
    HEADER_NOP,
    HEADER_STATUS_READ,
    HEADER_V020_BRAKE,
    HEADER_V020_CHANNEL_INFO,
    HEADER_V020_DIVIDER,
    HEADER_V020_ENABLE,
    HEADER_V020_ENCODER,
    HEADER_V020_ENCODER_FAULT,
    HEADER_V020_MOTOR_FAULT,
    HEADER_V020_VERSION,
    INTEGER_BITS,
    MAX_ENCODERS,
    R_ABORTED_MESSAGES,
    R_BUFFER_STATE,
    R_BUFFER_STATE_DEPTH_LSB,
    R_BUFFER_STATE_EXECUTING_LSB,
    R_BUFFER_STATE_HALT_SEEN_LSB,
    R_BUFFER_STATE_HALTED_LSB,
    R_BUILD_ID,
    R_BUILD_PARAMETERS,
    R_BUILD_PARAMETERS_INTEGER_BITS_LSB,
    R_BUILD_PARAMETERS_MOTOR_DRIVER_LSB,
    R_CHANNEL_INFO,
    R_CHANNEL_INFO_ENCODERS_LSB,
    R_CHANNEL_INFO_POSITION_BITS_LSB,
    R_CHANNEL_INFO_VELOCITY_BITS_LSB,
    R_ENCODER_FAULT,
    R_ENCODER_FAULT_HI,
    R_ENCODER_POSITION,
    R_ENCODER_VELOCITY,
    R_FRAMING_ERRORS,
    R_MOTOR_FAULT,
    R_MOVES_COMPLETED,
    R_MOVES_REFUSED,
    R_PHASE_ANGLE,
    R_PHASE_ANGLE_ANGLE_MASK,
    R_PULSES_PENDING,
    R_STEP_LOST,
    R_STEP_POSITION,
    R_TICKS_LEFT,
    R_UNKNOWN_HEADERS,
    R_VERSION,
    VELOCITY_BITS,
    VERSION,
    VERSION_V020,
    W_BRAKE,
    W_CLEAR,
    W_CLEAR_COUNTERS_MASK,
    W_CLEAR_ENCODER_FAULT_MASK,
    W_CLEAR_STEP_LOST_MASK,
    W_CONTROL,
    W_CURRENT,
    W_DIR_HOLD,
    W_DIR_POLARITY,
    W_DIR_SETUP,
    W_DIVIDER,
    W_DIVIDER_DIVIDER_MASK,
    W_ENABLE,
    W_STEP_LOW,
    W_STEP_POLARITY,
    W_STEP_WIDTH,
)
from pulsewright.boards.rapcores.twin_state import (
    DOCUMENT,
    LONG,
    UPSTREAM,
    V020,
    State,
    show_directions,
    signed,
    telemetry,
    ticks_left,
)
from pulsewright.twin.kernel import hot, inlined, kernel

SWALLOWED: Final = 0x100  # ``header`` of a message whose second word is ignored
ADDRESS: Final = 0xFF
LONG_ADDRESS: Final = (1 << 33) - 1  # of reads in the original
ENCODERS_SHOWN: Final = 32  # in the fault mask of short words

POSITION_0: Final = R_ENCODER_POSITION[0]
VELOCITY_0: Final = R_ENCODER_VELOCITY[0]
PHASE_0: Final = R_PHASE_ANGLE[0]
UPSTREAM_PHASE_0: Final = R_ENCODER_VELOCITY[0]  # of the original, unless ``fixed``
STEP_0: Final = R_STEP_POSITION[0]
LAST_STEP: Final = R_STEP_POSITION[-1]
CURRENT_0: Final = W_CURRENT[0]
LAST_PHASE: Final = R_PHASE_ANGLE[-1]


@inlined
def top(board: Any, value: int) -> int:
    """Return a value of words of 64 bits, one of shorter ones moved to their upper half."""
    number: int = value << (64 - board.word_bits)
    return number


@inlined
def channel_info(board: Any) -> int:
    """Return what there is."""
    info: int = (
        VELOCITY_BITS << R_CHANNEL_INFO_VELOCITY_BITS_LSB
        | board.position_bits << R_CHANNEL_INFO_POSITION_BITS_LSB
        | board.encoders << R_CHANNEL_INFO_ENCODERS_LSB
        | board.motors
    )
    return info


@kernel
def motors_mask(s: State, pending: bool) -> int:
    """Return a bit per motor: it owes pulses, or it has lost steps."""
    mask = 0
    for i in range(s.world[0].board.motors):
        motor = s.world[0].motors[i]
        if (motor.backlog != 0) if pending else (motor.lost != 0):
            mask |= 1 << i
    return mask


@kernel
def channel(s: State, address: int) -> int:
    """Return a status register of an encoder or a motor; 0 if there is none."""
    board, world = s.world[0].board, s.world[0]
    if address < VELOCITY_0:
        e = address - POSITION_0
        return int(world.encoders[e].position) if e < board.encoders else 0
    if address < PHASE_0:
        e = address - VELOCITY_0
        return int(world.encoders[e].velocity) if e < board.encoders else 0
    i = address - PHASE_0
    if address <= LAST_PHASE and i < board.motors:
        return int(world.motors[i].position & R_PHASE_ANGLE_ANGLE_MASK)
    i = address - STEP_0
    if STEP_0 <= address <= LAST_STEP and i < board.motors:
        return int(signed(world.motors[i].position))
    return 0


@kernel
def status(s: State, address: int, cycle: int) -> int:
    """Return a status register as it is in ``cycle``; the motors must stand there."""
    board = s.world[0].board
    value = 0
    if address == R_VERSION:
        value = VERSION
    elif address == R_CHANNEL_INFO:
        value = channel_info(board)
    elif address == R_ENCODER_FAULT:
        value = board.fault
    elif address in (R_MOTOR_FAULT, R_STEP_LOST):
        value = motors_mask(s, False)
    elif address == R_BUFFER_STATE:
        value = board.used | board.depth << R_BUFFER_STATE_DEPTH_LSB
        value |= board.run << R_BUFFER_STATE_EXECUTING_LSB
        value |= board.halted << R_BUFFER_STATE_HALTED_LSB
        value |= board.halt_seen << R_BUFFER_STATE_HALT_SEEN_LSB
    elif address == R_TICKS_LEFT:
        value = ticks_left(board, cycle)
    elif address == R_MOVES_COMPLETED:
        value = board.completed & LONG
    elif address == R_MOVES_REFUSED:
        value = board.refused & LONG
    elif address == R_FRAMING_ERRORS:
        value = board.framing & LONG
    elif address == R_ABORTED_MESSAGES:
        value = board.aborted & LONG
    elif address == R_UNKNOWN_HEADERS:
        value = board.unknown & LONG
    elif address == R_ENCODER_FAULT_HI:
        value = board.fault >> ENCODERS_SHOWN & LONG
    elif address == R_PULSES_PENDING:
        value = motors_mask(s, True)
    elif address == R_BUILD_PARAMETERS:
        value = board.word_bits | INTEGER_BITS << R_BUILD_PARAMETERS_INTEGER_BITS_LSB
        value |= board.motor_driver << R_BUILD_PARAMETERS_MOTOR_DRIVER_LSB
    elif address == R_BUILD_ID:
        value = BUILD_ID
    else:
        value = channel(s, address)
    return int(value)


@kernel
def upstream_status(s: State, address: int) -> int:
    """Return a status register of the original; 0 where it is not known."""
    board, world = s.world[0].board, s.world[0]
    if address == R_VERSION:
        return VERSION
    if address == R_CHANNEL_INFO:
        return int(channel_info(board))
    if address == R_ENCODER_FAULT:
        unused = -1 << board.encoders if board.encoders < MAX_ENCODERS else 0
        return int(~board.fault & ~unused)
    if POSITION_0 <= address < POSITION_0 + board.encoders:
        encoder = world.encoders[address - POSITION_0]
        # both drive the register; where they agree, the bit is known
        return int(encoder.position if board.fixed else encoder.position & encoder.velocity)
    if board.fixed and VELOCITY_0 <= address < VELOCITY_0 + board.encoders:
        return int(world.encoders[address - VELOCITY_0].velocity)
    i = address - (PHASE_0 if board.fixed else UPSTREAM_PHASE_0)
    if 0 <= i < board.motors:
        return int(world.motors[i].position & R_PHASE_ANGLE_ANGLE_MASK)
    return 0


@kernel
def configuration(board: Any, address: int) -> int:
    """Return a configuration register."""
    value = 0
    if address == W_ENABLE:
        value = board.enable
    elif address == W_BRAKE:
        value = board.brake
    elif address == W_DIVIDER:
        value = board.divider
    elif board.profile != DOCUMENT:
        value = 0
    elif address == W_STEP_WIDTH:
        value = board.width
    elif address == W_STEP_LOW:
        value = board.low
    elif address == W_DIR_SETUP:
        value = board.setup
    elif address == W_DIR_HOLD:
        value = board.hold
    elif address == W_CONTROL:
        value = board.soft_halt
    elif address == W_STEP_POLARITY:
        value = board.step_polarity
    elif address == W_DIR_POLARITY:
        value = board.direction_polarity
    elif board.motor_driver and CURRENT_0 <= address < CURRENT_0 + board.motors:
        value = board.current[address - CURRENT_0]
    return int(value)


@inlined
def looks_at_motors(board: Any, word: int) -> bool:
    """Tell whether a word may read or write what the motors show or use."""
    header: int = word >> (board.word_bits - 8) & 0xFF
    return bool(
        board.header == HEADER_CONFIG_SWAP
        or (board.header == HEADER_NOP and header == HEADER_STATUS_READ)
    )


@kernel
def clear(s: State, bits: int) -> None:
    """Clear what can be cleared; an event of the same cycle comes after it, and so wins."""
    board = s.world[0].board
    if bits & W_CLEAR_COUNTERS_MASK:
        board.completed = board.refused = board.framing = board.aborted = board.unknown = 0
    if bits & W_CLEAR_ENCODER_FAULT_MASK:
        board.fault = 0
    if bits & W_CLEAR_STEP_LOST_MASK:
        for i in range(board.motors):
            s.world[0].motors[i].lost = 0


@inlined
def write_later(board: Any, address: int, value: int) -> None:
    """Write a configuration register at the end of the cycle."""
    board.writes = 1
    board.write_address = address
    board.write_value = value & LONG


@kernel
def take_snapshot(s: State, cycle: int) -> None:
    """Keep telemetry as it is in ``cycle``, for the words of a move message."""
    board = s.world[0].board
    for e in range(min(board.motors, board.encoders)):
        if board.profile == V020:
            position = s.world[0].encoders[e].position
            board.snapshot[2 * e] = 0
            board.snapshot[2 * e + 1] = position & ((1 << board.position_bits) - 1)
        else:
            board.snapshot[2 * e] = telemetry(s, 2 * e, cycle)
            board.snapshot[2 * e + 1] = telemetry(s, 2 * e + 1, cycle)


@inlined
def move_reply(s: State, word: int, cycle: int) -> int:
    """Return the telemetry that word ``word`` of a move message queues."""
    board = s.world[0].board
    n = word - 1
    if n >> 1 >= board.encoders:
        return 0
    if board.profile == UPSTREAM:  # also for the last word, behind the last motor
        return int(telemetry(s, n, cycle))
    return int(board.snapshot[n]) if n < 2 * board.motors else 0


@inlined
def store(board: Any, place: int, word: int) -> None:
    """Put word ``place`` of a move message into the slot for it."""
    if place == 1:
        board.duration[board.write_slot] = word & LONG
    elif place & 1:
        board.change[board.write_slot, (place - 3) >> 1] = top(board, word)
    else:
        board.increment[board.write_slot, (place - 2) >> 1] = top(board, word)


@hot
def move_word(s: State, word: int, cycle: int) -> None:
    """Take a word of a move message after its header."""
    board = s.world[0].board
    k = board.place
    board.place = k + 1
    board.reply = move_reply(s, k, cycle)
    if board.profile != DOCUMENT:  # the slot may be executing, and shows the word a cycle later
        board.stores = k
        board.store_value = word
    elif board.accept:
        store(board, k, word)
    if k == 2 * board.motors + 1:
        board.header = HEADER_NOP
        if board.profile != DOCUMENT or (board.accept and board.halted == 0):
            board.arm = 1
        else:
            board.refused += 1


@kernel
def open_move(s: State, word: int, cycle: int) -> None:
    """Take the header of a move message."""
    board = s.world[0].board
    board.header = HEADER_MOVE
    board.place = 1
    if board.profile == DOCUMENT:
        room = board.used < board.depth
        board.accept = 1 if room and board.halted == 0 and board.halt_seen == 0 else 0
    if board.profile != UPSTREAM:
        take_snapshot(s, cycle)
    if board.profile != DOCUMENT or board.accept:
        board.directions[board.write_slot] = word & ((1 << board.motors) - 1)
        if board.profile != DOCUMENT and board.write_slot == board.slot:
            show_directions(s, cycle)


@kernel
def encoder_reply(s: State, e: int) -> int:
    """Return velocity and position of an encoder in one word."""
    board = s.world[0].board
    if e >= board.encoders:
        return 0
    encoder = s.world[0].encoders[e]
    position = encoder.position & ((1 << board.position_bits) - 1)
    return int((encoder.velocity & LONG) << board.position_bits | position)


@kernel
def v020_word(s: State, header: int, word: int) -> None:
    """Take the header of a message of the original 0.2, other than a move."""
    board = s.world[0].board
    if header == HEADER_V020_ENCODER:
        board.reply = encoder_reply(s, word >> 48 & 0xFF)
        board.header = SWALLOWED
    elif header == HEADER_V020_CHANNEL_INFO:
        board.reply = channel_info(board)
    elif header == HEADER_V020_VERSION:
        board.reply = VERSION_V020
        board.header = SWALLOWED
    elif board.profile != V020:
        return
    elif header == HEADER_V020_ENCODER_FAULT:
        board.reply = board.fault
        board.header = SWALLOWED
    elif header == HEADER_V020_MOTOR_FAULT:
        board.header = SWALLOWED
    elif header == HEADER_V020_ENABLE:
        write_later(board, W_ENABLE, word & ((1 << board.motors) - 1))
    elif header == HEADER_V020_BRAKE:
        write_later(board, W_BRAKE, word & ((1 << board.motors) - 1))
    elif header == HEADER_V020_DIVIDER:
        write_later(board, W_DIVIDER, word & W_DIVIDER_DIVIDER_MASK)


@kernel
def is_v020(board: Any, header: int) -> bool:
    """Tell whether a header is one of the original 0.2 that this board answers."""
    if board.profile == V020:
        return True
    return bool(board.v020_info) and (
        header in (HEADER_V020_ENCODER, HEADER_V020_CHANNEL_INFO, HEADER_V020_VERSION)
    )


@hot
def act(s: State, word: int, cycle: int) -> None:
    """Let a word act in ``cycle``. Where it looks at motors, they must stand there."""
    board = s.world[0].board
    if board.header == HEADER_MOVE:
        move_word(s, word, cycle)
        return
    board.reply = 0
    if board.header == HEADER_CONFIG_SWAP:
        if board.address == W_CLEAR and board.profile == DOCUMENT:
            clear(s, word)
        write_later(board, board.address, word)
    if board.header != HEADER_NOP:
        board.header = HEADER_NOP
        return
    header = word >> (board.word_bits - 8) & 0xFF
    address = word & ADDRESS
    if header == HEADER_NOP:
        return
    if header == HEADER_MOVE:
        open_move(s, word, cycle)
    elif is_v020(board, header):
        v020_word(s, header, word)
    elif header == HEADER_STATUS_READ:
        board.header = SWALLOWED
        if board.profile == DOCUMENT:
            board.reply = status(s, address, cycle)
        elif word & LONG_ADDRESS == address:
            board.reply = upstream_status(s, address)
    elif header == HEADER_CONFIG_SWAP:
        board.header, board.address = HEADER_CONFIG_SWAP, address
        board.reply = configuration(board, address)
    elif header == HEADER_CONFIG_READ and board.profile == DOCUMENT:
        board.header = SWALLOWED
        board.reply = configuration(board, address)
    else:
        board.header = SWALLOWED
        board.unknown += 1
