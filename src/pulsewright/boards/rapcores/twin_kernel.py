"""The twin's clock: edge by edge where something happens, nothing in between.

The motors stay behind the present cycle and are brought to it when somebody looks (`advance_all`).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.rapcores import twin_bridge as bridges
from pulsewright.boards.rapcores import twin_message as message
from pulsewright.boards.rapcores import twin_motor as motion
from pulsewright.boards.rapcores import twin_original as original
from pulsewright.boards.rapcores import twin_spi as spi_pins
from pulsewright.boards.rapcores.registers import (
    HEADER_MOVE,
    HEADER_NOP,
    RESET_CYCLES,
    W_BRAKE,
    W_CLEAR,
    W_CLEAR_HALT_SEEN_MASK,
    W_CONTROL,
    W_CONTROL_HALT_MASK,
    W_CURRENT,
    W_CURRENT_CURRENT_MASK,
    W_DIR_HOLD,
    W_DIR_HOLD_CYCLES_MASK,
    W_DIR_HOLD_RESET,
    W_DIR_POLARITY,
    W_DIR_SETUP,
    W_DIR_SETUP_CYCLES_MASK,
    W_DIR_SETUP_RESET,
    W_DIVIDER,
    W_DIVIDER_DIVIDER_MASK,
    W_DIVIDER_RESET,
    W_ENABLE,
    W_STEP_LOW,
    W_STEP_LOW_CYCLES_MASK,
    W_STEP_LOW_RESET,
    W_STEP_POLARITY,
    W_STEP_WIDTH,
    W_STEP_WIDTH_CYCLES_MASK,
    W_STEP_WIDTH_RESET,
    WORD_BITS,
)
from pulsewright.boards.rapcores.twin_motor import Times
from pulsewright.boards.rapcores.twin_state import (
    COPI,
    CS,
    DIRECTION,
    DOCUMENT,
    ENABLE,
    ENCODER_DELAY,
    ENCODER_PINS,
    FIXED_ROWS,
    HALT,
    HALT_DELAY,
    LEGS,
    MOTOR_PINS,
    MOVE_DONE,
    RST_N,
    SCK,
    STEP,
    V020,
    WORLD,
    State,
    bridge_row,
    hold_telemetry,
    motor_row,
    next_tick,
    pieces_before,
    show_ready,
    signed,
)
from pulsewright.transport.spi_bus import CS_HIGH
from pulsewright.twin import quadrature
from pulsewright.twin.clock import NEVER
from pulsewright.twin.kernel import hot, inlined, kernel
from pulsewright.twin.memory import array_at
from pulsewright.twin.recorder import PIN, Rows, drive, toggle

CURRENT_0: Final = W_CURRENT[0]
FRAME_END: Final = 4  # cycles from the rise of CS to what it does

# ------------------------------------------------------------------------------------------- motors


@inlined
def advance_bridge(s: State, i: int, end: int, ticks: int) -> bool:
    """Run the bridges of a motor up to cycle ``end``, not included; False if a buffer is full.

    ``ticks`` are those of its move up to there. The motor must still be where it was.
    """
    board, world = s.world[0].board, s.world[0]
    return bridges.advance(
        *(world.bridges[i], world.motors[i], board.current[i], end, ticks),
        *(board.piece_first, board.period, s.rows, bridge_row(board, i)),
    )


@kernel
def advance_all(s: State, end: int) -> bool:
    """Run all motors up to cycle ``end``, not included; False if a buffer is full."""
    board = s.world[0].board
    if board.profile != DOCUMENT:
        return True
    times = Times(max(board.width, 1), max(board.low, 1), max(board.setup, 1), max(board.hold, 1))
    ticks = pieces_before(board, end)
    done = True
    for i in range(board.motors):
        pins = (motor_row(i, STEP), motor_row(i, DIRECTION))
        motor = s.world[0].motors[i]
        if board.phase_pins and not advance_bridge(s, i, end, ticks):
            done = False
            continue
        if motor.shown < end or motor.done < ticks:
            ran = motion.advance(
                motor, end, ticks, board.piece_first, board.period, times, s.rows, pins
            )
            done = done and ran
    return done


@kernel
def begin_piece(s: State, cycle: int) -> None:
    """Let the ticks from ``cycle`` on be those of the countdown."""
    board = s.world[0].board
    board.piece_first = next_tick(board, cycle)
    for i in range(board.motors):
        s.world[0].motors[i].done = 0
    board.sequence_at = cycle
    if board.piece_count:
        board.sequence_at = board.piece_first + (board.piece_count - 1) * board.period


# ---------------------------------------------------------------------------------------- sequencer


@kernel
def load(s: State, slot: int, cycle: int) -> None:
    """Load a move at edge ``cycle``; the motors must be past it."""
    board = s.world[0].board
    hold_telemetry(s)
    board.run = 1
    board.piece_count = board.duration[slot]
    for i in range(board.motors):
        motor = s.world[0].motors[i]
        motor.increment, motor.change = board.increment[slot, i], board.change[slot, i]
    begin_piece(s, cycle + 1)


@hot
def sequence(s: State, cycle: int) -> None:
    """End the executing move, or load one, in ``cycle``."""
    board = s.world[0].board
    board.sequence_at = NEVER
    if not board.run:
        load(s, board.slot, cycle)
        return
    advance_all(s, cycle + 1)
    toggle(s.rows, MOVE_DONE, cycle)
    board.completed += 1
    board.slot = (board.slot + 1) % board.depth
    board.used -= 1
    if board.used:
        load(s, board.slot, cycle)
    else:
        board.run = board.piece_count = 0
        board.idle_from = cycle + 1
        for i in range(board.motors):
            s.world[0].motors[i].done = 0


@kernel
def stop(s: State, cycle: int) -> None:
    """Do what the first halted cycle does; the motors must stand there."""
    board = s.world[0].board
    board.halt_at = board.sequence_at = NEVER
    board.halt_seen = 1
    if board.run:
        board.run = 0
        board.idle_from = cycle + 1
    board.used = board.piece_count = board.accept = 0
    board.slot = board.write_slot
    for i in range(board.motors):
        motor = s.world[0].motors[i]
        if board.phase_pins:
            advance_bridge(s, i, cycle + 1, motor.done)
        motor.position -= motor.backlog + motor.delta
        motor.backlog = motor.delta = motor.done = 0


@kernel
def change_halt(s: State, cycle: int) -> None:
    """Let the board be halted, or not, from the cycle after ``cycle`` on."""
    board = s.world[0].board
    halted = 1 if board.soft_halt or board.pin_halt else 0
    if board.profile == DOCUMENT and halted != board.halted:
        board.halted = halted
        if halted:
            board.halt_at = cycle + 1
    show_ready(s, cycle)


@kernel
def arm(s: State, cycle: int) -> None:
    """Arm the slot that was written to, at edge ``cycle``."""
    board = s.world[0].board
    board.used += 1
    board.write_slot = (board.write_slot + 1) % board.depth
    if not board.run:
        board.sequence_at = cycle + 1


# ------------------------------------------------------------------------------------ configuration


@kernel
def change_divider(s: State, value: int, cycle: int) -> None:
    """Write the divider at edge ``cycle``; the motors must be past it."""
    board = s.world[0].board
    board.divider = value
    period = (value & W_DIVIDER_DIVIDER_MASK) + 1
    if board.profile != DOCUMENT:
        board.period = period
        return
    start = cycle + 1
    left = board.piece_count - pieces_before(board, start)
    if start > board.base:
        board.before = board.base + (start - 1 - board.base) // board.period * board.period
    board.base = max(start, board.before + period)
    board.period = period
    if board.run and board.piece_count:
        board.piece_count = left
        begin_piece(s, start)


@kernel
def change_polarity(s: State, pin: int, changed: int, cycle: int) -> None:
    """Toggle step or direction pins of motors at edge ``cycle``."""
    for i in range(s.world[0].board.motors):
        if changed >> i & 1:
            toggle(s.rows, motor_row(i, pin), cycle)


@kernel
def change_bridges(s: State, cycle: int) -> None:
    """Let bridges be enabled, disabled or braked at edge ``cycle``; they must be past it."""
    board = s.world[0].board
    if board.phase_pins:
        for i in range(board.motors):
            bridge = s.world[0].bridges[i]
            bridges.change(bridge, board.enable >> i & 1, board.brake >> i & 1, cycle)


@kernel
def write(s: State, address: int, value: int, cycle: int) -> None:
    """Write a configuration register at edge ``cycle``; the motors must be past it."""
    board = s.world[0].board
    motors = (1 << board.motors) - 1
    if address == W_ENABLE:
        board.enable = value
        for i in range(board.motors):
            drive(s.rows, motor_row(i, ENABLE), value >> i & 1, cycle)
        change_bridges(s, cycle)
    elif address == W_BRAKE:
        board.brake = value
        change_bridges(s, cycle)
    elif address == W_DIVIDER:
        change_divider(s, value, cycle)
    elif board.profile != DOCUMENT:
        return
    elif address == W_STEP_WIDTH:
        board.width = value & W_STEP_WIDTH_CYCLES_MASK
    elif address == W_STEP_LOW:
        board.low = value & W_STEP_LOW_CYCLES_MASK
    elif address == W_DIR_SETUP:
        board.setup = value & W_DIR_SETUP_CYCLES_MASK
    elif address == W_DIR_HOLD:
        board.hold = value & W_DIR_HOLD_CYCLES_MASK
    elif address == W_CONTROL:
        board.soft_halt = value & W_CONTROL_HALT_MASK
        change_halt(s, cycle)
    elif address == W_CLEAR:
        if value & W_CLEAR_HALT_SEEN_MASK and not board.halted:
            board.halt_seen = 0
            show_ready(s, cycle)
    elif address == W_STEP_POLARITY:
        change_polarity(s, STEP, board.step_polarity ^ value & motors, cycle)
        board.step_polarity = value & motors
    elif address == W_DIR_POLARITY:
        change_polarity(s, DIRECTION, board.direction_polarity ^ value & motors, cycle)
        board.direction_polarity = value & motors
    elif board.motor_driver and CURRENT_0 <= address < CURRENT_0 + board.motors:
        board.current[address - CURRENT_0] = value & W_CURRENT_CURRENT_MASK


@hot
def after_message(s: State, cycle: int) -> None:
    """Do what a message left for the end of ``cycle``."""
    board = s.world[0].board
    if board.profile != DOCUMENT and (board.arm or board.stores or board.writes):
        original.pass_time(board, cycle + 1)
    if board.stores:
        message.store(board, board.stores, board.store_value)
        board.stores = 0
    if board.writes:
        board.writes = 0
        advance_all(s, cycle + 1)
        write(s, board.write_address, board.write_value, cycle)
    if board.arm:
        board.arm = 0
        if board.profile == DOCUMENT:
            arm(s, cycle)
            show_ready(s, cycle)
        else:
            original.arm(s, cycle)


@kernel
def end_frame(s: State) -> None:
    """Do what the end of a frame does."""
    board, spi = s.world[0].board, s.world[0].spi
    board.frame_at = NEVER
    if spi.count or spi.partial:
        board.framing += 1
    spi.count = spi.partial = 0
    if board.cs_reset_message and board.header != HEADER_NOP:
        board.header = HEADER_NOP
        board.reply = 0
        board.aborted += 1


# ------------------------------------------------------------------------------------------- inputs


@inlined
def look(s: State, e: int, cycle: int) -> None:
    """Let an encoder see its pins in ``cycle``."""
    encoder = s.world[0].encoders[e]
    if encoder.a == encoder.pin_a and encoder.b == encoder.pin_b:
        return
    if encoder.a != encoder.pin_a and encoder.b != encoder.pin_b:
        s.world[0].board.fault |= 1 << e
    else:
        step = quadrature.count(encoder.a, encoder.b, encoder.pin_a, encoder.pin_b)
        encoder.old_position, encoder.old_velocity = encoder.position, encoder.velocity
        encoder.position = signed(encoder.position + step)
        encoder.velocity = signed(step * max(cycle - encoder.last - 1, 0))
        encoder.last = cycle
    encoder.a, encoder.b = encoder.pin_a, encoder.pin_b


@inlined
def turn(s: State, pin: int, level: int, cycle: int) -> int:
    """Bring a pin of an encoder to a level; return the encoder, -1 if its other pin follows.

    The change is the one before the head of the queue.
    """
    board, queue = s.world[0].board, s.queue
    e = (pin - ENCODER_PINS) >> 1
    if (pin - ENCODER_PINS) & 1:
        s.world[0].encoders[e].pin_b = level
        return e
    s.world[0].encoders[e].pin_a = level
    more = board.head < queue.shape[0]
    if more and queue[board.head, 0] == cycle and queue[board.head, 1] == pin + 1:
        return -1
    return e


@hot
def take_encoders(s: State, end: int) -> None:
    """Let the encoders count before cycle ``end``, up to a change of another pin."""
    board, queue = s.world[0].board, s.queue
    while board.head < queue.shape[0]:
        cycle, pin = queue[board.head, 0], queue[board.head, 1]
        if cycle >= end or pin < ENCODER_PINS:
            break
        level = queue[board.head, 2]
        board.head += 1
        board.done = cycle
        e = turn(s, pin, level, cycle)
        if e >= 0:
            look(s, e, cycle)


@hot
def take_pins(s: State, cycle: int) -> None:
    """Bring all pins to what edge ``cycle`` looks at, and let the encoders count."""
    board, spi, queue = s.world[0].board, s.world[0].spi, s.queue
    while board.head < queue.shape[0] and queue[board.head, 0] <= cycle:
        pin, level = queue[board.head, 1], queue[board.head, 2]
        board.head += 1
        if pin >= ENCODER_PINS:
            e = turn(s, pin, level, cycle)
            if e < 0:
                continue
            if board.in_reset:
                if board.profile == DOCUMENT:
                    encoder = s.world[0].encoders[e]
                    encoder.a, encoder.b = encoder.pin_a, encoder.pin_b
            elif cycle > board.check_at or board.check_at == NEVER or board.profile == DOCUMENT:
                look(s, e, cycle)
        elif pin == CS:
            spi.cs = level
            board.spi_at = cycle
        elif pin == SCK:
            spi.sck = level
            board.spi_at = cycle
        elif pin == COPI:
            spi.copi = level
            board.spi_at = cycle
        elif pin == HALT:
            board.halt = level
            if not board.in_reset and (board.check_at == NEVER or cycle > board.check_at - 1):
                board.pin_halt = 1 if board.halt_pin and not level else 0
                change_halt(s, cycle)
        elif pin == RST_N:
            if board.rst_n and not level:
                board.ready_at = NEVER
                if not board.in_reset:
                    board.reset_at = cycle + 1
            elif level and not board.rst_n:
                board.ready_at = cycle + RESET_CYCLES
            board.rst_n = level


@kernel
def check_inputs(s: State, cycle: int) -> None:
    """Look at inputs whose flops have been in reset: the halt pin first, then the encoders."""
    board = s.world[0].board
    if cycle == board.check_at - 1:
        board.pin_halt = 1 if board.halt_pin and not board.halt else 0
        change_halt(s, cycle)
    else:
        board.check_at = NEVER
        for e in range(board.encoders):
            look(s, e, cycle)


# -------------------------------------------------------------------------------------------- reset


@kernel
def enter_reset(s: State, cycle: int) -> None:
    """Bring everything to its reset value at edge ``cycle``; the motors must be past it."""
    board = s.world[0].board
    board.in_reset = 1
    board.reset_at = board.check_at = board.word_at = board.frame_at = NEVER
    board.halt_at = board.sequence_at = NEVER
    board.header = board.place = board.address = board.reply = board.accept = 0
    board.run = board.used = board.write_slot = board.slot = board.piece_count = 0
    board.enable = board.brake = board.halted = board.halt_seen = 0
    board.soft_halt = board.pin_halt = board.step_polarity = board.direction_polarity = 0
    board.fault = board.arm = board.writes = board.stores = 0
    board.tick1 = board.tick2 = board.ready = board.finished = 0
    board.completed = board.refused = board.framing = board.aborted = board.unknown = 0
    board.ticks_left = board.count = 0
    board.divider = W_DIVIDER_RESET
    board.period = W_DIVIDER_RESET + 1
    board.width, board.low = W_STEP_WIDTH_RESET, W_STEP_LOW_RESET
    board.setup, board.hold = W_DIR_SETUP_RESET, W_DIR_HOLD_RESET
    for k in range(board.held.size):
        board.held[k] = 0
    for k in range(board.depth):
        board.directions[k] = 0
        board.duration[k] = 0
        for i in range(board.motors):
            board.increment[k, i] = board.change[k, i] = 0
    spi_pins.reset(s.world[0].spi)
    for i in range(board.motors):
        motor = s.world[0].motors[i]
        motor.position = motor.fraction = motor.increment = motor.change = motor.done = 0
        motor.delta = motor.backlog = motor.step = motor.direction = motor.lost = 0
        motor.low = motor.hold = motor.setup = 0
        board.current[i] = 0
        bridges.reset(s.world[0].bridges[i], cycle, board.motors - 1 - i)
    pins = MOTOR_PINS + (LEGS if board.motor_driver else 0)
    for row in range(FIXED_ROWS + pins * board.motors):
        drive(s.rows, row, 0, cycle)
    s.world[0].spi.shown = 0
    show_ready(s, cycle)
    for e in range(board.encoders):
        encoder = s.world[0].encoders[e]
        encoder.position = encoder.velocity = 0
        if board.profile == DOCUMENT:
            encoder.a, encoder.b = encoder.pin_a, encoder.pin_b
        else:
            encoder.a = encoder.b = 0


@kernel
def leave_reset(s: State, cycle: int) -> None:
    """Let everything run from ``cycle`` on."""
    board = s.world[0].board
    board.in_reset = 0
    board.ready_at = NEVER
    board.check_at = cycle + ENCODER_DELAY
    board.spi_at = cycle
    board.before = cycle - 1
    board.base = cycle - 1 + board.period
    board.idle_from = board.core_cycle = cycle
    for i in range(board.motors):
        s.world[0].motors[i].shown = cycle
        bridges.reset(s.world[0].bridges[i], cycle, board.motors - 1 - i)
    for e in range(board.encoders):
        # the original 0.2 knows no velocity before the second count
        s.world[0].encoders[e].last = NEVER if board.profile == V020 else cycle - 1


# ------------------------------------------------------------------------------------- edge by edge


@inlined
def counts_only(s: State) -> bool:
    """Tell whether encoders that turn do nothing but count."""
    board = s.world[0].board
    calm = board.in_reset == 0 and board.check_at == NEVER and board.spi_at == NEVER
    return bool(calm and s.world[0].spi.cs1 == 1)


@hot
def next_event(s: State, cycle: int) -> int:
    """Return the first cycle after ``done`` in which something happens by itself.

    What encoders count up to ``cycle``, before anything else happens, is done already.
    """
    board = s.world[0].board
    first = min(board.reset_at, board.ready_at, board.spi_at)
    if not board.in_reset:
        first = min(first, board.word_at, board.frame_at, board.halt_at, board.sequence_at)
        if board.check_at != NEVER:
            first = min(first, board.check_at - (ENCODER_DELAY - HALT_DELAY))
        if board.profile != DOCUMENT:
            first = min(first, original.next_event(s))
    if board.head < s.queue.shape[0] and s.queue[board.head, 0] < first:
        if counts_only(s):
            take_encoders(s, min(first, cycle + 1))
        if board.head < s.queue.shape[0]:
            first = min(first, s.queue[board.head, 0])
    return int(max(first, board.done + 1))


@kernel
def stand(s: State, cycle: int) -> bool:
    """Bring the motors to ``cycle``, with room for one more; False if a buffer is full."""
    return advance_all(s, cycle) and s.rows.full[0] == 0


@hot
def edge(s: State, cycle: int) -> bool:
    """Do all that happens in ``cycle``; False, and nothing done, if a buffer is full."""
    board = s.world[0].board
    if s.rows.full[0]:
        return False
    acts = board.word_at == cycle
    looks = acts and message.looks_at_motors(board, board.word_value)
    moves = board.sequence_at == cycle or board.halt_at == cycle or board.reset_at == cycle
    if (looks or moves) and not stand(s, cycle):
        return False
    if board.ready_at == cycle:
        leave_reset(s, cycle)
    if board.reset_at == cycle:
        advance_all(s, cycle + 1)
        enter_reset(s, cycle)
    elif not board.in_reset:
        run_blocks(s, cycle, acts)
        if board.writes or board.arm or board.stores:
            after_message(s, cycle)
    take_pins(s, cycle)
    if not board.in_reset and cycle >= board.check_at - 1:
        check_inputs(s, cycle)
    if board.spi_at <= cycle:
        spi_pins.clock(s, cycle)
        spi_pins.show(s, cycle)
    elif s.world[0].spi.cs1 == 0:
        spi_pins.show(s, cycle)
    return True


@hot
def run_blocks(s: State, cycle: int, acts: bool) -> None:
    """Let messages and moves do what they do in ``cycle``."""
    board = s.world[0].board
    if acts:
        board.word_at = NEVER
        message.act(s, board.word_value, cycle)
    if board.frame_at == cycle:
        end_frame(s)
    if board.halt_at == cycle:
        stop(s, cycle)
    elif board.sequence_at == cycle:
        sequence(s, cycle)
        show_ready(s, cycle)
    if board.profile != DOCUMENT and original.next_event(s) <= cycle:
        original.clock(s, cycle)


@kernel
def run(s: State, cycle: int) -> bool:
    """Do all cycles through ``cycle``; motors stay behind. False if a buffer is full."""
    board = s.world[0].board
    while True:
        if board.next_event <= cycle:
            board.next_event = next_event(s, cycle)
        if board.next_event > cycle:
            board.done = max(board.done, cycle)
            return True
        if not edge(s, board.next_event):
            return False
        board.done = board.next_event


@kernel
def settle(s: State) -> bool:
    """Bring all pins to the present cycle; False if a buffer is full."""
    board = s.world[0].board
    if s.rows.full[0]:
        return False
    return board.in_reset == 1 or advance_all(s, board.done + 1)


# --------------------------------------------------------------------------------------------- bus

FRESH: Final = -1  # place of a frame that is not begun
NOT_BY_WORDS: Final = -2


# Words of the block that tells where everything is: addresses, and lengths of arrays.
WORLD_AT, QUEUE_AT, EVENTS, CYCLES_AT, PLACES, PINS_AT, PINS, FULL_AT, WORDS_AT = range(9)
BLOCK: Final = 9


@hot
def state_at(at: int) -> State:
    """Return the state of which the block at an address tells."""
    block: NDArray[np.int64] = array_at(at, BLOCK, np.int64)
    return State(
        array_at(block[WORLD_AT], 1, WORLD),
        array_at(block[QUEUE_AT], (block[EVENTS], 3), np.int64),
        Rows(
            array_at(block[CYCLES_AT], block[PLACES], np.int64),
            array_at(block[PINS_AT], block[PINS], PIN),
            array_at(block[FULL_AT], 1, np.int64),
        ),
    )


@hot
def word_at(at: int, place: int, bits: int) -> int:
    """Return a word of a frame, of 64 or 32 bits."""
    words = array_at(at, BLOCK, np.int64)[WORDS_AT]
    if bits == WORD_BITS:
        return int(array_at(words, place + 1, np.int64)[place])
    return int(array_at(words, place + 1, np.int32)[place])


@hot
def put_word(at: int, place: int, bits: int, word: int) -> None:
    """Replace a word of a frame."""
    words = array_at(at, BLOCK, np.int64)[WORDS_AT]
    if bits == WORD_BITS:
        array_at(words, place + 1, np.int64)[place] = word
    else:
        array_at(words, place + 1, np.int32)[place] = word


@inlined
def takes_words(s: State, start: int, end: int) -> bool:
    """Tell whether a frame from ``start`` to ``end`` can be taken word by word."""
    board, queue = s.world[0].board, s.queue
    if board.in_reset or board.bus_pins or board.done != start - 1:
        return False
    if board.word_at != NEVER or board.frame_at != NEVER or board.check_at != NEVER:
        return False
    for k in range(board.head, queue.shape[0]):
        if queue[k, 0] > end:
            break
        if queue[k, 1] < HALT:
            return False
    return bool(spi_pins.quiet(board, s.world[0].spi))


@hot
def passes(s: State, cycle: int) -> bool:
    """Let a word act in ``cycle`` at once if it is one of a move, not the last, and time is calm.

    Such a word is only stored, and what it replies has been kept. Return False, and do nothing,
    otherwise.
    """
    board = s.world[0].board
    inside = board.header == HEADER_MOVE and board.place <= 2 * board.motors
    if not inside or board.profile != DOCUMENT:
        return False
    if board.next_event <= cycle:
        board.next_event = next_event(s, cycle)
    if board.next_event <= cycle:
        return False
    message.move_word(s, board.word_value, cycle)
    board.done = cycle
    return True


@kernel
def transfer(at: int, place: int, start: int, half: int, count: int) -> int:
    """Take ``count`` words of a frame with CS falling at ``start``, from word ``place`` on.

    ``at`` is where `State` and words are, see `state_at`; ``place`` is `FRESH` at first. Each word
    is replaced by what comes back with it. Return the place to go on from once buffers have room;
    one more than there are words if the frame is done; `NOT_BY_WORDS`, with time just before
    ``start`` at most, if it is to be sent bit by bit.
    """
    s = state_at(at)
    board = s.world[0].board
    bits = 2 * half * board.word_bits
    rise = start + 2 * half + count * bits
    if place == FRESH:
        if board.done >= start:
            return NOT_BY_WORDS
        if not run(s, start - 1):
            return FRESH
        if not takes_words(s, start, rise + max(2 * half, CS_HIGH)):
            return NOT_BY_WORDS
        place = 0
    while place < count:
        acts_at = start + half + (place + 1) * bits + spi_pins.FLAG
        if board.word_at == NEVER:
            board.word_value = word_at(at, place, board.word_bits)
            put_word(at, place, board.word_bits, board.reply)
            if not passes(s, acts_at):
                board.word_at = acts_at
                board.next_event = 0
        if board.word_at != NEVER and not run(s, acts_at):
            return place
        if place == count - 1:
            spi_pins.after_word(board, s.world[0].spi, board.word_value)
        place += 1
    if board.profile == DOCUMENT and board.header != HEADER_NOP and board.done < rise:
        board.frame_at = rise + FRAME_END
        board.next_event = 0
    return place + 1 if run(s, rise) else place
