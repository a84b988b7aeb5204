"""The compiled part of `twin`: one board, from event to event.

Within a cycle all blocks see what was before its edge. That is why `edge` calls them in this order:
who reads registers of another comes before it, and what they write to shared registers comes last.
A function that may fill an edge buffer returns False before anything but the time of a channel has
changed, so that the caller can make room and call again.
"""

from __future__ import annotations

from typing import Any, Final

from pulsewright.boards.s3g import twin_channel as motion
from pulsewright.boards.s3g import twin_program as program
from pulsewright.boards.s3g import twin_protocol as protocol
from pulsewright.boards.s3g.registers import (
    INT_ASG_ABORT,
    INT_ASG_DONE,
    INT_SE_INT_LB,
    READY_CYCLES,
    SET_X,
    STB_ASG_LOAD,
    STB_SE_INT_LB,
    W_ABORT_A_VAL,
    W_ASG_CONTROL,
    W_ASG_CONTROL2,
    W_ASG_CONTROL_CHANNEL0_LSB,
    W_ASG_CONTROL_DT_LIMIT_MASK,
    W_ASG_CONTROL_RESET_DT_MASK,
    W_ASG_CONTROL_RESET_STEPS_MASK,
    W_ASG_CONTROL_STEPS_LIMIT_MASK,
    W_ASG_DT_VAL,
    W_ASG_STEPS_VAL,
    W_MSG_ALL_POST_N,
    W_MSG_ALL_PRE_N,
    W_MSG_ALL_PULSE_N,
)
from pulsewright.boards.s3g.twin_channel import WORD, Times
from pulsewright.boards.s3g.twin_state import (
    ABORTING,
    DIRECTION,
    ENABLE,
    HALTED,
    IDLE,
    LEDS,
    NO_ACTIONS,
    PORTS,
    REGISTERS,
    RST_N,
    STEP,
    WAITING,
    WORKING,
    State,
    channel_row,
    next_hit,
    serial_row,
    write_output,
)
from pulsewright.twin import uart
from pulsewright.twin.clock import NEVER
from pulsewright.twin.kernel import hot, inlined, kernel
from pulsewright.twin.recorder import drive

MASK: Final = WORD - 1
CONTROL_BITS: Final = 8  # of each channel in registers 3 and 60
CONTROL_CHANNELS: Final = 3  # in register 3; the next ones are in register 60


# ----------------------------------------------------------------------------------------- channels


@hot
def advance_channel(s: State, c: int, end: int, moving: int) -> bool:
    """Run a channel up to cycle ``end``, not included; False if a buffer is full."""
    board = s.board[0]
    times = Times(board.pre, board.pulse, board.post)
    pins = (channel_row(c, STEP), channel_row(c, DIRECTION))
    carry = 0 if board.x_sign_extended else WORD
    done: bool = motion.advance(s.channels[c], end, moving, carry, times, s.rows, pins)
    return done


@hot
def advance_all(s: State, end: int) -> bool:
    """Run all channels up to cycle ``end``, not included; False if a buffer is full."""
    done = True
    for c in range(s.board[0].channels):
        if s.channels[c].tick < end:
            done = advance_channel(s, c, end, 1) and done
    return done


@inlined
def control_bits(board: Any, c: int) -> int:
    """Return what a load sets in a channel, bit by bit."""
    if c < CONTROL_CHANNELS:
        lsb = W_ASG_CONTROL_CHANNEL0_LSB + CONTROL_BITS * c
        bits = board.outputs[W_ASG_CONTROL] >> lsb
    else:
        lsb = CONTROL_BITS * (c - CONTROL_CHANNELS)
        bits = board.outputs[W_ASG_CONTROL2] >> lsb
    return int(bits)


@kernel
def change_times(s: State, cycle: int) -> None:
    """Let the present thresholds count from ``cycle`` on; the channels must stand there."""
    board = s.board[0]
    board.pre = board.outputs[W_MSG_ALL_PRE_N]
    board.pulse = board.outputs[W_MSG_ALL_PULSE_N]
    board.post = board.outputs[W_MSG_ALL_POST_N]
    board.times_at = NEVER
    for c in range(board.channels):
        motion.retime(s.channels[c], cycle, Times(board.pre, board.pulse, board.post))


# ------------------------------------------------------------------------------- acceleration steps


@kernel
def load(s: State, cycle: int) -> None:
    """Load parameters in ``cycle``; the channels must stand there."""
    board = s.board[0]
    control = board.outputs[W_ASG_CONTROL]
    if control & W_ASG_CONTROL_STEPS_LIMIT_MASK:
        board.steps_limit = board.outputs[W_ASG_STEPS_VAL]
    if control & W_ASG_CONTROL_DT_LIMIT_MASK:
        board.dt_limit = board.outputs[W_ASG_DT_VAL]
    if control & W_ASG_CONTROL_RESET_STEPS_MASK:
        board.steps = 0
    if control & W_ASG_CONTROL_RESET_DT_MASK:
        board.dt_origin = cycle + 1
    for c in range(board.channels):
        bits = control_bits(board, c)
        advance_channel(s, c, cycle + 1, ~bits >> SET_X & 1)
        motion.load(s.channels[c], board.outputs, c, bits)
    board.asg_state = WORKING
    board.asg_at = next_hit(board, cycle + 1) if board.dt_limit else cycle + 1


@hot
def step(s: State, cycle: int) -> int:
    """Do what is due in ``cycle`` without a load; return the interrupts that it gives.

    The channels must stand there.
    """
    board = s.board[0]
    if board.asg_state == WORKING and board.dt_limit == 0:
        board.asg_state, board.asg_at = IDLE, NEVER
        return 0
    board.steps = (board.steps + 1) & MASK
    board.dt_origin = cycle + 1
    sources = 0
    if board.asg_state == WORKING:
        if board.steps >= board.steps_limit:
            board.asg_state = WAITING
            sources = 1 << INT_ASG_DONE
    else:
        board.asg_state = ABORTING
        sources = 1 << INT_ASG_ABORT
    for c in range(board.channels):
        channel = s.channels[c]
        if channel.tick <= cycle:
            advance_channel(s, c, cycle + 1, 1)
        if board.asg_state == ABORTING:
            motion.brake(channel, motion.signed(board.outputs[W_ABORT_A_VAL[c]]))
        else:
            motion.accelerate(channel)
    board.asg_at = next_hit(board, cycle + 1)
    return sources


# -------------------------------------------------------------------------------------------- reset


@kernel
def enter_reset(s: State, cycle: int) -> None:
    """Bring everything to its reset value at edge ``cycle``; the channels must stand there."""
    board = s.board[0]
    board.in_reset = 1
    board.reset_at = NEVER
    board.rx_state = board.se_state = board.asg_state = board.be_state = 0
    board.invalid_from = board.copy_addr = board.timer_at = board.pending = board.strobes = 0
    board.hold_from = board.hold_until = 0
    board.steps = board.dt_limit = board.steps_limit = board.pre = board.pulse = board.post = 0
    board.pc = board.error = board.aborted = board.be_from = board.be_until = 0
    board.packet_at = board.timeout_at = board.se_at = board.send_at = NEVER
    board.strobes_at = board.times_at = board.be_at = board.asg_at = NEVER
    board.mask = MASK
    for n in range(REGISTERS):
        board.outputs[n] = 0
    for n in range(LEDS):
        drive(s.rows, n, 0, cycle)
    for c in range(board.channels):
        channel = s.channels[c]
        channel.x = channel.v = channel.a = channel.j = channel.jj = channel.sv = 0
        channel.target_v = channel.target_set = channel.stepping = channel.up = 0
        channel.start = channel.free = channel.rise = channel.fall = 0
        channel.step = channel.direction = 0
        drive(s.rows, channel_row(c, STEP), 0, cycle)
        drive(s.rows, channel_row(c, DIRECTION), 0, cycle)
        drive(s.rows, channel_row(c, ENABLE), 1, cycle)
    for n in range(PORTS):
        port = s.ports[n]
        port.idle = port.valid = NEVER
        if board.bus_pins:
            uart.show_bits(port, cycle - 1, s.rows, serial_row(board, n))
            drive(s.rows, serial_row(board, n), 1, cycle)
        uart.cut_byte(port, s.heard[n], cycle)


@kernel
def leave_reset(s: State, cycle: int) -> None:
    """Let everything run from ``cycle`` on."""
    board = s.board[0]
    board.in_reset = 0
    board.ready_at = NEVER
    board.dt_origin = board.se_free = cycle
    for c in range(board.channels):
        s.channels[c].tick = s.channels[c].shown = cycle
    for n in range(PORTS):
        uart.receiver_reset(s.ports[n], s.lines[n], cycle)


@kernel
def take_pins(s: State, cycle: int) -> None:
    """Bring ``rst_n`` and ``cclk`` to what ``cycle`` sees; that works from the next one on."""
    board = s.board[0]
    before = board.rst_n & board.cclk
    while board.head < s.queue.shape[0] and s.queue[board.head, 0] <= cycle:
        if s.queue[board.head, 1] == RST_N:
            board.rst_n = s.queue[board.head, 2]
        else:
            board.cclk = s.queue[board.head, 2]
        board.head += 1
    good = board.rst_n & board.cclk
    if before and not good:
        board.ready_at = NEVER
        if not board.in_reset:
            board.reset_at = cycle + 1
    elif good and not before:
        board.ready_at = cycle + READY_CYCLES


# ------------------------------------------------------------------------------------- edge by edge


@hot
def next_event(s: State) -> int:
    """Return the first cycle after ``done`` in which something happens by itself."""
    board = s.board[0]
    first = min(board.reset_at, board.ready_at)
    if board.head < s.queue.shape[0]:
        first = min(first, s.queue[board.head, 0])
    if board.in_reset:
        return int(first)
    first = min(first, s.ports[0].valid, s.ports[1].valid, board.timeout_at, board.send_at)
    first = min(first, board.strobes_at, board.times_at, board.be_at, board.asg_at)
    board.host_at = protocol.next_event(board)
    return int(max(min(first, board.host_at), board.done + 1))


@hot
def edge(s: State, cycle: int) -> bool:
    """Do all that happens in ``cycle``; False if a buffer is full."""
    board = s.board[0]
    if s.rows.full[0]:
        return False
    strobes = board.strobes if board.strobes_at == cycle else 0
    loads = strobes >> STB_ASG_LOAD & 1 == 1
    steps = board.asg_at == cycle and not loads
    resets = board.reset_at == cycle
    retimes = board.times_at == cycle
    # after loads and other thresholds channels move once more in this cycle, and then cannot stop
    if (loads or resets or retimes) and (not advance_all(s, cycle) or s.rows.full[0]):
        return False
    if steps and not retimes and not advance_all(s, cycle + 1):
        return False
    if board.ready_at == cycle:
        leave_reset(s, cycle)
    if resets:
        enter_reset(s, cycle)
    elif not board.in_reset:
        run_blocks(s, cycle, strobes, loads, steps)
    take_pins(s, cycle)
    return True


@hot
def run_blocks(s: State, cycle: int, strobes: int, loads: bool, steps: bool) -> None:
    """Run all blocks through ``cycle``; where they move, the channels must stand there."""
    board = s.board[0]
    if board.times_at == cycle:
        change_times(s, cycle)
    by_host = by_program = NO_ACTIONS
    if board.host_at <= cycle:
        by_host = protocol.execute(s, cycle)
    if board.be_at == cycle or strobes:
        by_program = program.execute(s, cycle, strobes, by_host.register >= 0)
    sources = by_program.sources
    if strobes >> STB_SE_INT_LB & 1:
        sources |= 1 << INT_SE_INT_LB
    if board.asg_state == ABORTING and not loads:
        sources |= 1 << INT_ASG_ABORT
    if loads:
        load(s, cycle)
    elif steps:
        sources |= step(s, cycle)

    byte1 = byte2 = -1
    if s.ports[0].valid == cycle:
        byte1 = uart.take_byte(s.ports[0], s.lines[0])
    if s.ports[1].valid == cycle:
        byte2 = uart.take_byte(s.ports[1], s.lines[1])
    if byte1 >= 0 or byte2 >= 0 or board.timeout_at == cycle:
        protocol.receive(s, cycle, byte1, byte2)
    if board.send_at == cycle:
        protocol.hand_over(s, cycle)

    if by_host.register >= 0:
        write_output(s, by_host.register, by_host.value, cycle)
    if by_program.register >= 0:
        write_output(s, by_program.register, by_program.value, cycle)
    board.strobes = by_host.strobes | by_program.strobes
    board.strobes_at = cycle + 1 if board.strobes else NEVER
    pending = board.pending & ~(by_host.clear | by_program.clear) | sources
    if pending != board.pending:
        board.pending = pending
        if board.be_state == HALTED:
            board.be_at = cycle + 1


@kernel
def run(s: State, cycle: int, port: int, count: int) -> bool:
    """Do all cycles through ``cycle``, or until the host has ``count`` bytes from ``port``.

    Pins of channels and ports stay behind, see `settle`. False if a buffer is full.
    """
    board, serial = s.board[0], s.ports[port]
    while True:
        end = cycle
        if serial.sent - serial.taken >= count:
            end = min(end, s.heard[port, (serial.taken + count - 1) % uart.HEARD] >> 8)
        if board.next_event <= end:
            board.next_event = next_event(s)
        if board.next_event > end:
            board.done = max(board.done, end)
            return True
        if not edge(s, board.next_event):
            return False
        board.done = board.next_event


@kernel
def settle(s: State) -> bool:
    """Bring all pins to the present cycle; False if a buffer is full."""
    board = s.board[0]
    if s.rows.full[0]:
        return False
    if board.bus_pins:
        for n in range(PORTS):
            uart.show_bits(s.ports[n], board.done, s.rows, serial_row(board, n))
    return board.in_reset == 1 or advance_all(s, board.done + 1)


@kernel
def line_free(s: State, port: int) -> int:
    """Return the first cycle in which a byte can start on a serial input."""
    return int(max(s.ports[port].free, s.board[0].done + 1))


@kernel
def send(s: State, port: int, data: Any, start: int) -> int:
    """Put bytes on a serial input from ``start`` on, but not before it is free.

    If the board is in reset and nothing but time keeps it there, they wait for the end of that.
    Return the first cycle in which more can start, or -1, and nothing done, if there is no room.
    """
    board = s.board[0]
    start = max(start, line_free(s, port))
    if board.in_reset and board.ready_at < NEVER:
        start = max(start, board.ready_at)
    board.next_event = 0
    done = uart.send(s.ports[port], s.lines[port], data, start)
    return int(s.ports[port].free) if done else -1


@kernel
def lines_changed(s: State) -> None:
    """Look again at the serial inputs, after changes were added to them."""
    for n in range(PORTS):
        if s.ports[n].idle < NEVER:
            uart.find_byte(s.ports[n], s.lines[n])


@kernel
def take_heard(s: State, port: int, data: Any) -> int:
    """Take the bytes that the host has received; see `uart.take_heard`."""
    return uart.take_heard(s.ports[port], s.heard[port], s.board[0].done, data)
