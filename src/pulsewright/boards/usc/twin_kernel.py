"""The compiled part of `twin`: all boards on one bus, from event to event.

Every function that may fill an edge buffer returns False before it has changed anything but the
time of an axis, so that the caller can make room and call again.

One clock edge does, in this order, what the boards do at once from old values: the byte of a read,
latches, index captures, counts, index resets, the write of the bus cycle, the estop. Bus accesses
outside the pins act between the edge of their cycle and the next one.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.usc.registers import (
    INTR_TICKS,
    R_ENCODER_COUNT,
    R_IDENT,
    R_INDEX_SENSE,
    R_INPUTS_HIGH,
    R_INPUTS_HIGH_INPUTS_MASK,
    R_INPUTS_HIGH_RUNNING_MASK,
    R_INPUTS_LOW,
    R_INPUTS_LOW_INPUTS_MASK,
    TIMER_UNIT_TICKS,
    W_ASSEMBLY,
    W_DAC,
    W_DIVISOR,
    W_ENCODER_CONTROL,
    W_ENCODER_CONTROL_ALIAS,
    W_ENCODER_CONTROL_INDEX_SELECT_LSB,
    W_ENCODER_CONTROL_LOAD_LSB,
    W_ENCODER_CONTROL_LOAD_MASK,
    W_INDEX_RESET,
    W_INDEX_RESET_AXES_MASK,
    W_OUTPUTS,
    W_OUTPUTS_ESTOP_RELEASE_MASK,
    W_RATE_CONTROL,
    W_RATE_CONTROL_DIR0_LSB,
    W_RATE_CONTROL_RUN0_LSB,
    W_SETUP,
    W_SETUP_RESET,
    W_SLAVE,
    W_SLAVE_ENABLE_MASK,
    W_TIMER,
    W_TIMER_MASTER_MASK,
    W_TIMER_RATE_MASK,
    W_TIMER_SOFT_LATCH_MASK,
    W_WIDTH,
    W_WIDTH_RESET,
)
from pulsewright.transport.bus import ADDRESS_READ, ADDRESS_WRITE, DATA_READ, DATA_WRITE
from pulsewright.twin import epp, quadrature, step_pulse
from pulsewright.twin.clock import NEVER, tick_cycle, ticks_through
from pulsewright.twin.kernel import hot, inlined, kernel
from pulsewright.twin.recorder import Rows, drive
from pulsewright.twin.step_pulse import STEP_AXIS

AXES: Final = 4
COUNT_MASK: Final = 0xFFFFFF
SYNCHRONISER: Final = 2  # edges from the one that samples an input to the one that uses it
WATCHDOG_TICKS_PER_US: Final = 10
PAGE: Final = 32  # registers of a board
BOARDS_MAX: Final = 8

# Input pins of a board, by number.
A_PIN: Final = 0
B_PIN: Final = 4
INDEX_PIN: Final = 8
FILTERED_PINS: Final = 12  # the encoder inputs come first
DIN_PIN: Final = 12
CHAIN_PIN: Final = 27
INPUT_PINS: Final = 28
# Pins of the bus itself, by number.
NWRITE, NDATASTR, NADDRSTR, NINIT, DATA = range(5)
BUS_PINS: Final = 5
# Output pins of a board, by number; those of the bus follow after all boards.
STEP_ROW: Final = 0
DIRECTION_ROW: Final = 4
OUT_ROW: Final = 8
DAC_ROW: Final = 15
RUNNING_ROW: Final = 23
BOARD_ROWS: Final = 24
NWAIT_ROW: Final = 0
DRIVE_ROW: Final = 1
DATA_ROW: Final = 2

BUS: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            # time: last edge done, no event comes before, last access; origin: edge 0 of the boards
            *("done", "next_event", "last_access", "origin"),
            # fixed: boards, cycles per tick, cycles per access, base address of board 0
            *("boards", "tick", "access_cycles", "base"),
            # fixed: profile switches
            *("div_offset", "time_code", "min_space", "ident", "sense_gate", "watchdog_us"),
            *("mariss", "enc_filter", "nwait_idle", "bus_pins"),
            # bus: address register of all boards, board selected or -1, byte last driven
            *("address", "selected", "byte", "in_reset"),
            # shared Intr line: asserted through the cycle before this one
            "intr_until",
            # pins and strobe pipeline
            *("nwrite", "ndatastr", "naddrstr", "ninit", "data", "stages"),
            # first change of the queue that is still to come, first edge at which a filter accepts
            *("head", "next_accept"),
        )
    ]
)
BOARD: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            *("assembly", "encoder_control", "timer", "slave", "index_reset", "dac"),
            *("rate_control", "setup", "width", "outputs", "index_sense", "read_byte"),
            *("running", "chain", "din", "loopback"),
            # axes committed since the last feed, cycle at which the watchdog expires
            *("commits", "watchdog_at"),
            # latch timer: ``timer_count`` before tick ``timer_tick``, cycle of the next event
            *("timer_count", "timer_tick", "timer_at"),
        )
    ]
    + [("reads", np.int64, (PAGE,)), ("writes", np.int64, (PAGE,))]
)
AXIS: Final = np.dtype(
    [*STEP_AXIS.descr, ("divisor", np.int64), ("encoder", np.int64), ("latch", np.int64)]
)

# One input: level after the synchroniser, after the filter, edge at which the filter accepts.
INPUT: Final = np.dtype([(name, np.int64) for name in ("seen", "level", "accept_at")])

# All of it: a kernel gets one pointer. Boards after the last one are not used.
WORLD: Final = np.dtype(
    [
        ("bus", BUS),
        ("boards", BOARD, (BOARDS_MAX,)),
        ("axes", AXIS, (BOARDS_MAX, AXES)),
        ("inputs", INPUT, (BOARDS_MAX * INPUT_PINS,)),
    ]
)


class State(NamedTuple):
    """Everything there is, as kernels see it.

    Parameters
    ----------
    world : WORLD
        Registers and time.
    queue : (events, 3) int64
        Edge that uses it, pin and level of changes of the pins, by edge. Pins are those of the bus,
        then those of the boards.
    rows : Rows
        Edge buffers of all output pins.
    """

    world: Any
    queue: NDArray[np.int64]
    rows: Rows


# ------------------------------------------------------------------------------------- step pulses


@inlined
def loads(encoder_control: int, i: int) -> int:
    """Return the load position bit of an axis."""
    return encoder_control >> (W_ENCODER_CONTROL_LOAD_LSB + i) & 1


@inlined
def selects_index(encoder_control: int, i: int) -> int:
    """Return the index select bit of an axis."""
    return encoder_control >> (W_ENCODER_CONTROL_INDEX_SELECT_LSB + i) & 1


@kernel
def advance_axis(s: State, b: int, i: int, cycle: int) -> bool:
    """Run one axis through the ticks up to ``cycle``; False if a buffer is full."""
    bus, board, axis = s.world.bus, s.world.boards[b], s.world.axes[b, i]
    end = ticks_through(cycle, bus.origin, bus.tick)
    if axis.tick >= end:
        return True
    before = axis.position
    run = board.rate_control >> (2 * i + W_RATE_CONTROL_RUN0_LSB) & 1
    done = step_pulse.advance(
        axis,
        end,
        run == 1 and axis.divisor != 0 and board.running == 1,
        board.rate_control >> (2 * i + W_RATE_CONTROL_DIR0_LSB) & 1,
        axis.divisor + bus.div_offset,
        max(1, bus.time_code - board.width),
        bus.min_space,
        max(1, bus.time_code - board.setup),
        bus.mariss == 1,
        (bus.origin, bus.tick),
        s.rows,
        (b * BOARD_ROWS + STEP_ROW + i, b * BOARD_ROWS + DIRECTION_ROW + i),
    )
    if board.loopback and not loads(board.encoder_control, i):
        axis.encoder = (axis.encoder + axis.position - before) & COUNT_MASK
    return done


@kernel
def advance_board(s: State, b: int, cycle: int) -> bool:
    """Run the axes of one board through the ticks up to ``cycle``; False if a buffer is full."""
    done = True
    for i in range(AXES):
        done &= advance_axis(s, b, i, cycle)
    return done


@kernel
def advance_all(s: State, cycle: int) -> bool:
    """Run all axes through the ticks up to ``cycle``; False if a buffer is full."""
    done = True
    for b in range(s.world.bus.boards):
        done &= advance_board(s, b, cycle)
    return done


# --------------------------------------------------------------------------------- estop, watchdog


@kernel
def drive_outputs(s: State, b: int, cycle: int) -> None:
    """Bring the outputs of one board to what its registers say; all 0 in estop."""
    board = s.world.boards[b]
    row = b * BOARD_ROWS
    drive(s.rows, row + RUNNING_ROW, board.running, cycle)
    for i in range(7):
        drive(s.rows, row + OUT_ROW + i, board.outputs >> i & board.running, cycle)
    for i in range(8):
        drive(s.rows, row + DAC_ROW + i, board.dac >> i & board.running, cycle)


@hot
def feed_watchdog(s: State, b: int, cycle: int) -> None:
    """Let the watchdog expire with its last tick, counted from the first one after ``cycle``."""
    bus = s.world.bus
    last = ticks_through(cycle, bus.origin, bus.tick) + WATCHDOG_TICKS_PER_US * bus.watchdog_us - 1
    s.world.boards[b].watchdog_at = tick_cycle(last, bus.origin, bus.tick)


@kernel
def settle_estop(s: State, b: int, running: int, cycle: int) -> None:
    """Enter or leave estop after the edge ``cycle``; ``running``: 1 to stay out of it if possible.

    The axes must have room for the ticks up to ``cycle``.
    """
    bus, board = s.world.bus, s.world.boards[b]
    if (
        board.outputs & W_OUTPUTS_ESTOP_RELEASE_MASK == 0
        or (board.chain == 0 and board.slave == 0)
        or (bus.watchdog_us and cycle >= board.watchdog_at)
    ):
        running = 0
    if running != board.running:
        advance_board(s, b, cycle)
        board.running = running
        drive_outputs(s, b, cycle)
        if running and bus.watchdog_us:
            bus.next_event = min(bus.next_event, board.watchdog_at)


# ------------------------------------------------------------------------- encoders, latches, index


@kernel
def latch(s: State, b: int) -> None:
    """Latch the counters of one board whose index select bit is 0."""
    for i in range(AXES):
        if not selects_index(s.world.boards[b].encoder_control, i):
            s.world.axes[b, i].latch = s.world.axes[b, i].encoder


@kernel
def latch_event(s: State, sources: int, asserted: bool, cycle: int) -> None:
    """Latch the boards with an event (bits of ``sources``), and all if it starts the Intr line."""
    bus = s.world.bus
    for b in range(s.world.bus.boards):
        if not asserted or sources >> b & 1:
            latch(s, b)
    bus.intr_until = cycle + INTR_TICKS * bus.tick


@kernel
def schedule_timer(s: State, b: int) -> None:
    """Find the next event of a board's latch timer from its counter."""
    bus, board = s.world.bus, s.world.boards[b]
    rate = board.timer & W_TIMER_RATE_MASK
    board.timer_at = NEVER
    if rate and board.timer & W_TIMER_MASTER_MASK:
        due = board.timer_tick + max(0, rate * TIMER_UNIT_TICKS - 1 - board.timer_count)
        board.timer_at = tick_cycle(due, bus.origin, bus.tick)
        bus.next_event = min(bus.next_event, board.timer_at)


@kernel
def write_timer(s: State, b: int, value: int, cycle: int) -> None:
    """Write the timer register; a soft latch is the caller's."""
    bus, board = s.world.bus, s.world.boards[b]
    tick = ticks_through(cycle, bus.origin, bus.tick)
    if tick > board.timer_tick:
        running = board.timer_at != NEVER
        board.timer_count = board.timer_count + tick - board.timer_tick if running else 0
        board.timer_tick = tick
    board.timer = value
    schedule_timer(s, b)


@kernel
def index_edge(s: State, b: int, i: int, latched: int) -> None:
    """Capture, reset and sense at a rising index edge; ``latched`` is the count captured."""
    bus, board, axis = s.world.bus, s.world.boards[b], s.world.axes[b, i]
    select = selects_index(board.encoder_control, i)
    reset = board.index_reset >> i & 1
    if select:
        axis.latch = latched
    if reset and not loads(board.encoder_control, i):
        axis.encoder = 0
    if bus.sense_gate == 0 or select or reset:
        board.index_sense |= 1 << i


@kernel
def count_encoder(s: State, b: int, i: int, counted: int, index: int, cycle: int) -> None:
    """Count one axis at the edge ``cycle``; ``index``: its index rises at this edge."""
    board, axis = s.world.boards[b], s.world.axes[b, i]
    before = axis.encoder
    if board.loopback:
        advance_axis(s, b, i, cycle)
    elif not loads(board.encoder_control, i):
        axis.encoder = (axis.encoder + counted) & COUNT_MASK
    if index:
        index_edge(s, b, i, before)


@kernel
def take_pins(s: State, cycle: int) -> None:
    """Bring the pins to what the edge ``cycle`` sees of them; the encoders have not acted yet."""
    bus = s.world.bus
    while bus.head < s.queue.shape[0] and s.queue[bus.head, 0] <= cycle:
        pin, level = s.queue[bus.head, 1], s.queue[bus.head, 2]
        bus.head += 1
        if pin == NWRITE:
            bus.nwrite = level
        elif pin == NDATASTR:
            bus.ndatastr = level
        elif pin == NADDRSTR:
            bus.naddrstr = level
        elif pin == NINIT:
            bus.ninit = level
        elif pin == DATA:
            bus.data = level
        else:
            take_input(s, pin - BUS_PINS, level, cycle)


@kernel
def take_input(s: State, pin: int, level: int, cycle: int) -> None:
    """Bring one input of a board to the level that the edge ``cycle`` sees."""
    bus, one = s.world.bus, s.world.inputs[pin]
    if one.seen == level:
        return
    one.seen = level
    b, kind = pin // INPUT_PINS, pin % INPUT_PINS
    if kind < FILTERED_PINS:
        one.accept_at = cycle + bus.enc_filter - 1 if one.level != level else NEVER
        bus.next_accept = min(bus.next_accept, one.accept_at)
    elif kind == CHAIN_PIN:
        s.world.boards[b].chain = level
    else:
        s.world.boards[b].din ^= 1 << (kind - DIN_PIN)


@kernel
def decode_encoders(s: State, cycle: int) -> None:
    """Let the encoders act on the levels that pass the filter at the edge ``cycle``."""
    bus = s.world.bus
    bus.next_accept = NEVER
    for b in range(s.world.bus.boards):
        for i in range(AXES):
            first = b * INPUT_PINS + i
            pin_a, pin_b = s.world.inputs[first + A_PIN], s.world.inputs[first + B_PIN]
            pin_index = s.world.inputs[first + INDEX_PIN]
            old_a, old_b, old_index = pin_a.level, pin_b.level, pin_index.level
            changed = False
            for kind in (A_PIN, B_PIN, INDEX_PIN):
                one = s.world.inputs[first + kind]
                if one.accept_at <= cycle:
                    one.accept_at = NEVER
                    one.level = one.seen
                    changed = True
                bus.next_accept = min(bus.next_accept, one.accept_at)
            if changed and not bus.in_reset:
                counted = quadrature.count(old_a, old_b, pin_a.level, pin_b.level)
                count_encoder(s, b, i, counted, pin_index.level & ~old_index, cycle)


# --------------------------------------------------------------------------------------- registers


@kernel
def select_board(s: State) -> None:
    """Find the board that the address register selects."""
    bus = s.world.bus
    b = bus.address // PAGE - bus.base
    bus.selected = b if 0 <= b < s.world.bus.boards and not bus.in_reset else -1


@hot
def read_register(s: State, b: int, register: int) -> int:
    """Return the byte of a data read and do its side effect."""
    board = s.world.boards[b]
    board.reads[register] += 1
    if register < R_ENCODER_COUNT[3] + 3:
        return int(s.world.axes[b, register // 3].latch >> (8 * (register % 3)) & 0xFF)
    if register == R_INDEX_SENSE:
        sense = int(board.index_sense)
        board.index_sense = 0
        return sense
    if register == R_INPUTS_LOW:
        return int(board.din & R_INPUTS_LOW_INPUTS_MASK)
    if register == R_INPUTS_HIGH:
        running = R_INPUTS_HIGH_RUNNING_MASK if board.running else 0
        return int(board.din >> 8 & R_INPUTS_HIGH_INPUTS_MASK | running)
    return s.world.bus.ident if register == R_IDENT else 0


@hot
def starts_soft_latch(s: State, b: int, register: int, value: int) -> bool:
    """Tell whether a write is a soft latch: bit 5 from 0 to 1."""
    return register == W_TIMER and value & ~s.world.boards[b].timer & W_TIMER_SOFT_LATCH_MASK != 0


@hot
def write_assembly(s: State, b: int, k: int, value: int) -> None:
    """Replace byte ``k`` of the assembly register, also in the counters that load it."""
    board = s.world.boards[b]
    board.assembly = (board.assembly & ~(0xFF << (8 * k))) | (value << (8 * k))
    if board.encoder_control & W_ENCODER_CONTROL_LOAD_MASK:
        load_positions(s, b)


@kernel
def load_positions(s: State, b: int) -> None:
    """Bring the counters whose load position bit is 1 to the assembly register."""
    board = s.world.boards[b]
    for i in range(AXES):
        if loads(board.encoder_control, i):
            s.world.axes[b, i].encoder = board.assembly


@hot
def commit_divisor(s: State, b: int, i: int, value: int, cycle: int) -> bool:
    """Write the high byte of a divisor: commit it and, as the case may be, feed the watchdog."""
    board, axis = s.world.boards[b], s.world.axes[b, i]
    divisor = (board.assembly & 0xFFFF) | (value << 16)
    if divisor != axis.divisor:
        if not advance_axis(s, b, i, cycle):
            return False
        axis.divisor = divisor
    write_assembly(s, b, 2, value)
    board.commits |= 1 << i
    if board.commits & (board.commits >> 1):
        board.commits = 0
        feed_watchdog(s, b, cycle)
    return True


@hot
def write_register(s: State, b: int, register: int, value: int, cycle: int) -> bool:
    """Carry out a data write after the edge ``cycle``; False if a buffer is full.

    A soft latch is the caller's.
    """
    board = s.world.boards[b]
    if W_DIVISOR[0] <= register < W_DIVISOR[3] + 3:
        i, k = (register - W_DIVISOR[0]) // 3, (register - W_DIVISOR[0]) % 3
        if k < 2:
            write_assembly(s, b, k, value)
        elif not commit_divisor(s, b, i, value, cycle):
            return False
    elif register == W_RATE_CONTROL:
        if value != board.rate_control:
            if not advance_board(s, b, cycle):
                return False
            board.rate_control = value
    elif register in (W_SETUP, W_WIDTH):
        if value != (board.setup if register == W_SETUP else board.width):
            if not advance_board(s, b, cycle):
                return False
            if register == W_SETUP:
                board.setup = value
            else:
                board.width = value
    elif register == W_OUTPUTS:
        if value != board.outputs:
            if not advance_board(s, b, cycle):
                return False
            rising = value & ~board.outputs & W_OUTPUTS_ESTOP_RELEASE_MASK != 0
            board.outputs = value
            settle_estop(s, b, 1 if rising else board.running, cycle)
            drive_outputs(s, b, cycle)
    elif register < W_ASSEMBLY + 3:
        write_assembly(s, b, register - W_ASSEMBLY, value)
    elif register == W_TIMER:
        if value != board.timer:
            write_timer(s, b, value, cycle)
    elif register == W_DAC:
        if value != board.dac:
            board.dac = value
            drive_outputs(s, b, cycle)
    elif register in (W_ENCODER_CONTROL, W_ENCODER_CONTROL_ALIAS):
        if value != board.encoder_control:
            if not advance_board(s, b, cycle):
                return False
            board.encoder_control = value
            load_positions(s, b)
    elif register == W_INDEX_RESET:
        if s.world.bus.ident & 0x0F >= 2:
            board.index_reset = value & W_INDEX_RESET_AXES_MASK
    elif register == W_SLAVE and value & W_SLAVE_ENABLE_MASK != board.slave:
        if not advance_board(s, b, cycle):
            return False
        board.slave = value & W_SLAVE_ENABLE_MASK
        settle_estop(s, b, board.running, cycle)
    board.writes[register] += 1
    return True


# ------------------------------------------------------------------------------------------- reset


@kernel
def enter_reset(s: State, cycle: int) -> None:
    """Bring every board to its reset state after the edge ``cycle`` and hold it there.

    Synchronisers, filters and the levels they hold go on; so do the access counters. The axes must
    stand at ``cycle``.
    """
    bus = s.world.bus
    bus.in_reset, bus.origin = 1, NEVER
    bus.address, bus.selected, bus.stages, bus.intr_until = 0, -1, 0, -1
    for b in range(s.world.bus.boards):
        board = s.world.boards[b]
        board.assembly = board.encoder_control = board.timer = board.slave = 0
        board.index_reset = board.dac = board.rate_control = board.outputs = 0
        board.index_sense = board.read_byte = board.running = board.commits = 0
        board.setup, board.width = W_SETUP_RESET, W_WIDTH_RESET
        board.watchdog_at, board.timer_at = -1, NEVER
        board.timer_count = board.timer_tick = 0
        drive_outputs(s, b, cycle)
        for i in range(AXES):
            axis = s.world.axes[b, i]
            axis.tick = axis.count = axis.step = axis.direction = axis.fall = 0
            axis.space = axis.hold = axis.setup = axis.position = axis.pulses = 0
            axis.divisor = axis.encoder = axis.latch = 0
            drive(s.rows, b * BOARD_ROWS + STEP_ROW + i, 0, cycle)
            drive(s.rows, b * BOARD_ROWS + DIRECTION_ROW + i, 0, cycle)


@kernel
def leave_reset(s: State, cycle: int) -> None:
    """Start the boards; the edge ``cycle`` is their edge 0."""
    bus = s.world.bus
    bus.in_reset, bus.origin = 0, cycle
    select_board(s)


# ----------------------------------------------------------------------------------------- bus pins


@kernel
def drive_bus(s: State, cycle: int) -> None:
    """Bring nWait and the data bus to what the strobe pipeline says."""
    bus = s.world.bus
    row = s.world.bus.boards * BOARD_ROWS
    acknowledged = epp.acknowledges(bus.stages) if bus.selected >= 0 else 0
    driven = acknowledged & bus.nwrite
    drive(s.rows, row + NWAIT_ROW, acknowledged ^ bus.nwait_idle, cycle)
    drive(s.rows, row + DRIVE_ROW, driven, cycle)
    for i in range(8):
        level = s.world.boards[bus.selected].read_byte >> i & 1 if driven else 0
        drive(s.rows, row + DATA_ROW + i, level, cycle)


# ------------------------------------------------------------------------------------ edge by edge


@kernel
def next_event(s: State) -> int:
    """Return the first cycle after ``done`` at which something happens by itself."""
    bus = s.world.bus
    first: int = NEVER
    for b in range(s.world.bus.boards):
        board = s.world.boards[b]
        first = min(first, board.timer_at)
        if board.running and bus.watchdog_us:
            first = min(first, board.watchdog_at)
    first = min(first, bus.next_accept)
    if bus.head < s.queue.shape[0]:
        first = min(first, s.queue[bus.head, 0])
    if not bus.in_reset and not epp.settled(bus.stages, 1 ^ (bus.ndatastr & bus.naddrstr)):
        first = min(first, bus.done + 1)
    return first


@kernel
def edge(s: State, cycle: int) -> bool:
    """Do everything that happens at one clock edge but the ticks; False if a buffer is full."""
    bus = s.world.bus
    if not advance_all(s, cycle - 1) or s.rows.full[0]:
        return False
    take_pins(s, cycle)
    if bus.ninit == 0:
        if not bus.in_reset:
            enter_reset(s, cycle)
    elif bus.in_reset:
        leave_reset(s, cycle)
    acting = epp.acts(bus.stages) and not bus.in_reset
    bus.stages = 0 if bus.in_reset else epp.shift(bus.stages, 1 ^ (bus.ndatastr & bus.naddrstr))

    b, register = bus.selected, bus.address % PAGE  # old values
    data_cycle = acting and bus.ndatastr == 0 and b >= 0
    write = data_cycle and bus.nwrite == 0
    read = data_cycle and bus.nwrite == 1
    if read:
        s.world.boards[b].read_byte = read_register(s, b, register)
    elif acting and bus.nwrite == 1 and bus.naddrstr == 0 and b >= 0:
        s.world.boards[b].read_byte = bus.address

    sources = 0
    for k in range(s.world.bus.boards):
        board = s.world.boards[k]
        if board.timer_at == cycle:
            sources |= 1 << k
            board.timer_count = 0
            board.timer_tick = ticks_through(cycle, bus.origin, bus.tick)
            schedule_timer(s, k)
    if write and starts_soft_latch(s, b, register, bus.data):
        sources |= 1 << b
    if sources:
        latch_event(s, sources, cycle <= bus.intr_until, cycle)
    if bus.next_accept <= cycle:
        decode_encoders(s, cycle)
    if write:
        write_register(s, b, register, bus.data, cycle)
    for k in range(s.world.bus.boards):
        settle_estop(s, k, s.world.boards[k].running, cycle)
    if acting:
        if bus.nwrite == 0 and (bus.naddrstr == 0 or bus.ndatastr == 0):
            bus.byte = bus.data
        elif b >= 0 and (bus.naddrstr == 0 or bus.ndatastr == 0):
            bus.byte = s.world.boards[b].read_byte
        if bus.naddrstr == 1 and b >= 0:
            step_address(s)
        elif bus.naddrstr == 0 and bus.nwrite == 0:
            bus.address = bus.data
            select_board(s)
    if bus.bus_pins:
        drive_bus(s, cycle)
    return True


@hot
def step_address(s: State) -> None:
    """Increment the register bits of the address; the board select bits stay."""
    bus = s.world.bus
    bus.address = bus.address & ~(PAGE - 1) | (bus.address + 1) % PAGE


@kernel
def run(s: State, cycle: int) -> bool:
    """Do all edges up to ``cycle``, axes excepted; False if a buffer is full."""
    bus = s.world.bus
    while bus.next_event <= cycle:
        bus.next_event = next_event(s)
        if bus.next_event > cycle:
            break
        if not edge(s, bus.next_event):
            return False
        bus.done = bus.next_event
    bus.done = max(bus.done, cycle)
    return True


# ------------------------------------------------------------------------------------ transactions


@kernel
def transact(s: State, accesses: Any, first: int) -> int:
    """Carry out accesses from number ``first`` on; return the number of the first one not done.

    That is less than the number of accesses if a buffer is full.
    """
    bus = s.world.bus
    for n in range(first, accesses.size):
        access = accesses[n]
        cycle = max(access.cycle, bus.last_access + bus.access_cycles, bus.done)
        if s.rows.full[0] or (bus.next_event <= cycle and not run(s, cycle)):
            return n
        op, b, register = access.op, bus.selected, bus.address % PAGE
        timeout = 0
        if op == ADDRESS_WRITE:
            bus.byte = access.value
            if not bus.in_reset:
                bus.address = bus.byte
                select_board(s)
        elif b < 0:
            timeout = 1
            if op == DATA_WRITE:
                bus.byte = access.value
            else:
                access.value = bus.byte
        elif op == DATA_WRITE:
            bus.byte = access.value
            value = bus.byte
            if starts_soft_latch(s, b, register, value):
                if not advance_all(s, cycle):
                    return n
                latch_event(s, 1 << b, cycle < bus.intr_until, cycle)
            if not write_register(s, b, register, value, cycle):
                return n
            step_address(s)
        elif op == DATA_READ:
            bus.byte = read_register(s, b, register)
            access.value = bus.byte
            step_address(s)
        elif op == ADDRESS_READ:
            bus.byte = bus.address
            access.value = bus.byte
        access.timeout = timeout
        access.cycle = cycle
        bus.last_access = bus.done = cycle
    return int(accesses.size)


# ----------------------------------------------------------------------- control outside the pins


@kernel
def set_input(s: State, pin: int, level: int) -> None:
    """Bring a digital or chain input to a level at once, past the synchroniser.

    All edges up to the present cycle must be done, axes included.
    """
    bus = s.world.bus
    for n in range(bus.head, s.queue.shape[0]):
        if s.queue[n, 0] <= bus.done + SYNCHRONISER and s.queue[n, 1] == pin + BUS_PINS:
            s.queue[n, 2] = level  # was in the synchroniser
    s.world.inputs[pin].seen = level
    b, kind = pin // INPUT_PINS, pin % INPUT_PINS
    if kind == CHAIN_PIN:
        s.world.boards[b].chain = level
        settle_estop(s, b, s.world.boards[b].running, bus.done)
    else:
        n = kind - DIN_PIN
        s.world.boards[b].din = s.world.boards[b].din & ~(1 << n) | (level << n)


@kernel
def set_encoder(s: State, b: int, i: int, value: int) -> None:
    """Set an encoder counter, unless it is loading a position or the board is in reset.

    All edges up to the present cycle must be done, axes included.
    """
    loading = loads(s.world.boards[b].encoder_control, i)
    if not s.world.bus.in_reset and not loading:
        s.world.axes[b, i].encoder = value & COUNT_MASK


@kernel
def set_ninit(s: State, level: int) -> None:
    """Bring nINIT to a level after the present edge; axes must have been run up to it."""
    bus = s.world.bus
    bus.ninit = level
    if level == 0 and not bus.in_reset:
        enter_reset(s, bus.done)
    elif level == 1 and bus.in_reset:
        leave_reset(s, max(bus.done, 0))
    if bus.bus_pins:
        drive_bus(s, max(bus.done, 0))
