"""The compiled part of `twin`: one board on one bus, from event to event.

Every function that may fill an edge buffer returns False before it has changed anything but the
time of an axis, so that the caller can make room and call again.

A clock edge works on old values: the read latch takes what was there before the tick of the same
edge, a write acts on the ticks after it. Bus accesses outside the pins act between the edge of
their cycle and the next one.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.pluto_step.registers import (
    R_IDENT,
    R_IDENT_RESET,
    R_INPUTS,
    R_INPUTS_INPUTS_MASK,
    R_POSITION,
    R_POSITION_VALUE_MASK,
    R_STATUS,
    R_STATUS_ENABLED_LSB,
    R_STATUS_MISSED_LSB,
    R_STATUS_TRISTATE_LSB,
    R_TICKS,
    R_TICKS_VALUE_MASK,
    TICK_CYCLES,
    W_CONTROL,
    W_CONTROL_JOINT_MASK,
    W_CONTROL_WATCHDOG_STOP_MASK,
    W_OUTPUTS,
    W_OUTPUTS_LEVELS_MASK,
    W_OUTPUTS_WATCHDOG_ARM_MASK,
    W_SPACE,
    W_SPACE_SPACE_MASK,
    W_TIMING,
    W_TIMING_DIRTIME_LSB,
    W_TIMING_DIRTIME_MASK,
    W_TIMING_POLARITY_LSB,
    W_TIMING_POLARITY_MASK,
    W_TIMING_STEPTIME_MASK,
    W_TIMING_TAP_LSB,
    W_TIMING_TAP_MASK,
    W_VELOCITY,
    W_VELOCITY_VALUE_MASK,
    WATCHDOG_CYCLES,
    WATCHDOG_TICKS,
)
from pulsewright.boards.pluto_step.twin_stepgen import (
    NO_ROW,
    STEPGEN,
    Pins,
    Timing,
    advance,
    step_bit,
)
from pulsewright.transport.bus import ADDRESS_WRITE, DATA_READ, DATA_WRITE
from pulsewright.twin import epp
from pulsewright.twin.clock import NEVER, ticks_through
from pulsewright.twin.kernel import inlined, kernel
from pulsewright.twin.recorder import RESERVE, Rows, drive

AXES: Final = len(W_VELOCITY)
ADDRESSES: Final = 32
ALIAS: Final = 16  # writes to addresses from here on repeat those below
TIMING_BITS: Final = (
    W_TIMING_POLARITY_MASK | W_TIMING_DIRTIME_MASK | W_TIMING_TAP_MASK | W_TIMING_STEPTIME_MASK
)
OUTS: Final = W_OUTPUTS_LEVELS_MASK.bit_count()
INPUTS: Final = R_INPUTS_INPUTS_MASK.bit_count()

# Input pins, by number; DIN is the first of the digital inputs.
NWRITE, NDATASTR, NADDRSTR, NINIT, DATA, DIN = range(6)
# Output pins, by number.
STEP_ROW: Final = 0
DIRECTION_ROW: Final = STEP_ROW + AXES
OUT_ROW: Final = DIRECTION_ROW + AXES
LED_ROW: Final = OUT_ROW + OUTS
TRISTATE_ROW: Final = LED_ROW + 1
NWAIT_ROW: Final = TRISTATE_ROW + 1
NCONFIG_ROW: Final = NWAIT_ROW + 1
DRIVE_ROW: Final = NCONFIG_ROW + 1
DATA_ROW: Final = DRIVE_ROW + 1

SWITCHES: Final = (
    *("clean_cancel", "enforce_space", "tap_sync", "joint_commit", "wd_stop"),
    *("no_alias", "id_reg", "status_reg", "tick_reg", "nwait_idle"),
)
REGISTERS: Final = (  # set to 0 by reset
    *("address", "low", "latch", "outputs", "timing", "space", "control"),
    *("enabled", "tristate", "stages"),
)
BOARD: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            # time: last edge done, no event comes before, last access; origin: edge 0 of the board
            *("done", "next_event", "last_access", "origin"),
            *("access_cycles", "bus_pins", *SWITCHES),
            *REGISTERS,
            # first edge at which the counter of an enabled watchdog is full
            "expires_at",
            # byte last driven on the bus, pins, head of the queue of pin changes
            *("byte", "in_reset"),
            *("nwrite", "ndatastr", "naddrstr", "ninit", "data", "din", "head"),
        )
    ]
    + [("reads", np.int64, (ADDRESSES,)), ("writes", np.int64, (ADDRESSES,))]
)
AXIS: Final = np.dtype([*STEPGEN.descr, ("velocity", np.int64), ("staged", np.int64)])


class State(NamedTuple):
    """Everything there is, as kernels see it.

    Parameters
    ----------
    board : (1,) BOARD
    axes : (4,) AXIS
    queue : (events, 3) int64
        Cycle, input pin and level of changes to come, by cycle.
    rows : Rows
        Edge buffers of all output pins.
    """

    board: NDArray[np.void]
    axes: NDArray[np.void]
    queue: NDArray[np.int64]
    rows: Rows


# --------------------------------------------------------------------------------------- axes, pins


@inlined
def bit(value: int, n: int) -> int:
    """Return bit ``n`` of ``value``."""
    return (value >> n) & 1


@inlined
def tap_of(timing: int) -> int:
    """Return the tap of a timing word."""
    return (timing & W_TIMING_TAP_MASK) >> W_TIMING_TAP_LSB


@inlined
def stops(board: Any) -> bool:
    """Tell whether the expired watchdog makes all velocities count as 0."""
    on: bool = board.tristate == 1 and (board.control & W_CONTROL_WATCHDOG_STOP_MASK) != 0
    return on


@inlined
def advance_axis(s: State, i: int, cycle: int, reserve: int) -> bool:
    """Run one axis through the ticks up to ``cycle``; False if a buffer is full."""
    board, axis = s.board[0], s.axes[i]
    end = ticks_through(cycle, board.origin, TICK_CYCLES)
    if axis.tick >= end:
        return True
    word = board.timing
    timing = Timing(
        word & W_TIMING_STEPTIME_MASK,
        (word & W_TIMING_DIRTIME_MASK) >> W_TIMING_DIRTIME_LSB,
        board.space,
        tap_of(word),
        board.clean_cancel,
        board.enforce_space,
    )
    pins = Pins(STEP_ROW + i, DIRECTION_ROW + i, LED_ROW if i == 0 else NO_ROW)
    if board.tristate:
        pins = Pins(NO_ROW, NO_ROW, NO_ROW)
    velocity = 0 if stops(board) else axis.velocity
    return advance(axis, end, velocity, timing, board.origin, s.rows, pins, reserve)


@kernel
def advance_all(s: State, cycle: int, reserve: int) -> bool:
    """Run all axes through the ticks up to ``cycle``; False if a buffer is full."""
    done = True
    for i in range(AXES):
        done = advance_axis(s, i, cycle, reserve) and done
    return done


@kernel
def drive_pins(s: State, cycle: int) -> None:
    """Bring all pins that can be high-Z to what the registers say; they count as 0 while high-Z."""
    board, rows = s.board[0], s.rows
    shown = 1 - board.tristate
    polarity = bit(board.timing, W_TIMING_POLARITY_LSB)
    for i in range(AXES):
        drive(rows, STEP_ROW + i, (s.axes[i].step ^ polarity) & shown, cycle)
        drive(rows, DIRECTION_ROW + i, s.axes[i].direction & shown, cycle)
    for i in range(OUTS):
        drive(rows, OUT_ROW + i, bit(board.outputs, i) & shown, cycle)
    drive(rows, LED_ROW, (s.axes[0].step ^ s.axes[0].direction) & shown, cycle)
    drive(rows, TRISTATE_ROW, board.tristate, cycle)


@kernel
def drive_bus(s: State, cycle: int) -> None:
    """Bring the bus to what the strobe pipeline and the host's nWrite say."""
    board, rows = s.board[0], s.rows
    acknowledged = epp.acknowledges(board.stages)
    driven = acknowledged & board.nwrite
    value = bus_byte(board) if driven else 0
    drive(rows, NWAIT_ROW, acknowledged ^ board.nwait_idle, cycle)
    drive(rows, NCONFIG_ROW, board.ninit, cycle)
    drive(rows, DRIVE_ROW, driven, cycle)
    for i in range(8):
        drive(rows, DATA_ROW + i, bit(value, i), cycle)


# ----------------------------------------------------------------------------------------- watchdog


@kernel
def arm_watchdog(s: State, cycle: int) -> None:
    """Start the watchdog's time again, and show the pins; axes must stand at ``cycle``."""
    board = s.board[0]
    ticks = (cycle - board.origin + 1) // WATCHDOG_CYCLES  # the first is at edge 2047
    board.enabled = 1
    board.expires_at = board.origin + (ticks + WATCHDOG_TICKS) * WATCHDOG_CYCLES - 1
    board.next_event = min(board.next_event, board.expires_at)
    if board.tristate:
        board.tristate = 0
        drive_pins(s, cycle)


@kernel
def expire_watchdog(s: State, cycle: int) -> None:
    """Make the pins high-Z; axes must stand at ``cycle``."""
    s.board[0].tristate = 1
    drive_pins(s, cycle)


# ---------------------------------------------------------------------------------------- registers


@inlined
def bus_byte(board: Any) -> int:
    """Return the byte that a read sees, with the address already incremented."""
    byte: int = (board.latch >> (8 * ((board.address - 1) & 3))) & 0xFF
    return byte


@kernel
def load_latch(s: State, cycle: int) -> None:
    """Load the read latch from the address register; axes must stand at ``cycle``."""
    board = s.board[0]
    address = board.address
    if address == R_INPUTS:
        board.latch = board.din
    elif address <= R_POSITION[AXES - 1]:
        board.latch = s.axes[address // 4].position & R_POSITION_VALUE_MASK
    elif address == R_IDENT and board.id_reg:
        board.latch = R_IDENT_RESET
    elif address == R_STATUS and board.status_reg:
        board.latch = (board.enabled << R_STATUS_ENABLED_LSB) | (
            board.tristate << R_STATUS_TRISTATE_LSB
        )
        for i in range(AXES):
            board.latch |= s.axes[i].missed << (R_STATUS_MISSED_LSB + i)
            s.axes[i].missed = 0
    elif address == R_TICKS and board.tick_reg:
        ticks = ticks_through(cycle, board.origin, TICK_CYCLES)
        board.latch = ticks & R_TICKS_VALUE_MASK


@inlined
def write_byte(s: State, value: int, cycle: int, reserve: int) -> bool:
    """Write a byte at the address register, at edge ``cycle``; False if a buffer is full.

    With ``reserve`` 0 the axes must stand before that edge.
    """
    board = s.board[0]
    if board.no_alias and board.address >= ALIAS:
        return True
    address = board.address % ALIAS
    word = (value << 8) | board.low
    if address < W_OUTPUTS:
        if address & 1:
            return write_velocity(s, address // 2, word, cycle, reserve)
    elif address == W_OUTPUTS + 1:
        return write_outputs(s, word, cycle, reserve)
    elif address == W_TIMING + 1:
        return write_timing(s, word & TIMING_BITS, cycle, reserve)
    elif address == W_SPACE + 1 and board.enforce_space:
        if not advance_all(s, cycle, reserve):
            return False
        board.space = word & W_SPACE_SPACE_MASK
        return True
    elif address == W_CONTROL + 1 and (board.joint_commit or board.wd_stop):
        if not advance_all(s, cycle, reserve):
            return False
        board.control = word & (
            (W_CONTROL_JOINT_MASK if board.joint_commit else 0)
            | (W_CONTROL_WATCHDOG_STOP_MASK if board.wd_stop else 0)
        )
        return True
    board.low = value
    return True


@inlined
def write_velocity(s: State, i: int, word: int, cycle: int, reserve: int) -> bool:
    """Commit a velocity; False if a buffer is full."""
    axis = s.axes[i]
    sign = (W_VELOCITY_VALUE_MASK + 1) >> 1
    velocity = ((word & W_VELOCITY_VALUE_MASK) ^ sign) - sign
    if s.board[0].control & W_CONTROL_JOINT_MASK == 0 and velocity != axis.velocity:
        if not advance_axis(s, i, cycle, reserve):
            return False
        axis.velocity = velocity
    axis.staged = velocity
    return True


@kernel
def write_outputs(s: State, word: int, cycle: int, reserve: int) -> bool:
    """Commit outputs and watchdog arm, and staged velocities; False if a buffer is full."""
    board = s.board[0]
    arms = word & W_OUTPUTS_WATCHDOG_ARM_MASK != 0
    levels = word & W_OUTPUTS_LEVELS_MASK
    joint = board.control & W_CONTROL_JOINT_MASK != 0
    if (joint or (arms and board.tristate)) and not advance_all(s, cycle, reserve):
        return False
    if joint:
        for i in range(AXES):
            s.axes[i].velocity = s.axes[i].staged
    if levels != board.outputs:
        board.outputs = levels
        if not board.tristate:
            for i in range(OUTS):
                drive(s.rows, OUT_ROW + i, bit(levels, i), cycle)
    if arms:
        arm_watchdog(s, cycle)
    return True


@kernel
def write_timing(s: State, word: int, cycle: int, reserve: int) -> bool:
    """Commit times, tap and polarity; False if a buffer is full."""
    board = s.board[0]
    if word == board.timing:
        return True
    if reserve and not advance_all(s, cycle, reserve):
        return False
    tap, retapped = tap_of(word), tap_of(word) != tap_of(board.timing)
    bits = 0  # step bits before the edge; of an access outside the pins, after its cycle's edge
    for i in range(AXES):
        bits |= step_bit(s.axes[i].position, tap) << i
        advance_axis(s, i, cycle, 0)
    if retapped:
        for i in range(AXES):
            s.axes[i].pending = 0
            if board.tap_sync:
                s.axes[i].last = bit(bits, i)
    board.timing = word
    if not board.tristate:
        drive_pins(s, cycle)
    return True


# -------------------------------------------------------------------------------------------- reset


@kernel
def enter_reset(s: State, cycle: int) -> None:
    """Set every register to 0 after the edge ``cycle`` and hold it there.

    The axes must stand at ``cycle``.
    """
    board = s.board[0]
    board.in_reset, board.origin, board.expires_at = 1, NEVER, NEVER
    board.address = board.low = board.latch = board.outputs = board.timing = 0
    board.space = board.control = board.enabled = board.tristate = board.stages = 0
    for i in range(AXES):
        axis = s.axes[i]
        axis.tick = axis.position = axis.step = axis.direction = axis.timer = axis.mode = 0
        axis.last = axis.space = axis.pending = axis.missed = axis.steps = axis.pulses = 0
        axis.velocity = axis.staged = 0
    drive_pins(s, cycle)


@kernel
def leave_reset(s: State, cycle: int) -> None:
    """Start the board; the edge ``cycle`` is its edge 0."""
    s.board[0].in_reset, s.board[0].origin = 0, cycle


@kernel
def set_ninit(s: State, level: int) -> None:
    """Bring nINIT to a level after the present edge; axes must have been run up to it."""
    board = s.board[0]
    cycle = max(board.done, 0)
    board.ninit = level
    if level == 0 and not board.in_reset:
        enter_reset(s, cycle)
    elif level == 1 and board.in_reset:
        leave_reset(s, cycle)
    if board.bus_pins:
        drive_bus(s, cycle)


# ------------------------------------------------------------------------------------- edge by edge


@inlined
def strobe_active(board: Any) -> int:
    """Return 1 while one of the strobes is low."""
    return 1 if board.ndatastr == 0 or board.naddrstr == 0 else 0


@kernel
def take_pins(s: State, cycle: int) -> None:
    """Bring the input pins to what the edge ``cycle`` samples."""
    board = s.board[0]
    while board.head < s.queue.shape[0] and s.queue[board.head, 0] <= cycle:
        pin, level = s.queue[board.head, 1], s.queue[board.head, 2]
        board.head += 1
        if pin >= DIN:
            board.din = board.din & ~(1 << (pin - DIN)) | (level << (pin - DIN))
        elif pin == DATA:
            board.data = level
        elif pin == NWRITE:
            board.nwrite = level
        elif pin == NDATASTR:
            board.ndatastr = level
        elif pin == NADDRSTR:
            board.naddrstr = level
        else:
            board.ninit = level


@kernel
def next_event(s: State) -> int:
    """Return the first cycle after ``done`` at which something happens by itself."""
    board = s.board[0]
    first = NEVER
    if board.enabled and not board.tristate:
        first = board.expires_at
    if board.head < s.queue.shape[0]:
        first = min(first, s.queue[board.head, 0])
    if not board.in_reset and not epp.settled(board.stages, strobe_active(board)):
        first = min(first, board.done + 1)
    return first


@kernel
def act(s: State, cycle: int) -> None:
    """Do the action edge of a bus cycle; axes must stand before it."""
    board = s.board[0]
    write = board.nwrite == 0
    if not write and board.address % 4 == 0:
        load_latch(s, cycle - 1)
    if board.ndatastr == 0:
        if write:
            board.writes[board.address] += 1
            write_byte(s, board.data, cycle, 0)
        else:
            board.reads[board.address] += 1
    if board.naddrstr == 1:
        board.address = (board.address + 1) % ADDRESSES
    elif write:
        board.address = board.data % ADDRESSES
    if board.ndatastr == 0 or board.naddrstr == 0:
        board.byte = board.data if write else bus_byte(board)


@kernel
def edge(s: State, cycle: int) -> bool:
    """Do everything that happens at one clock edge but the ticks; False if a buffer is full."""
    board = s.board[0]
    if not advance_all(s, cycle - 1, RESERVE):
        return False
    take_pins(s, cycle)
    if board.ninit == 0:
        if not board.in_reset:
            enter_reset(s, cycle)
    elif board.in_reset:
        leave_reset(s, cycle)
    if not board.in_reset:
        acting = epp.acts(board.stages)
        board.stages = epp.shift(board.stages, strobe_active(board))
        if acting:
            act(s, cycle)
        if board.enabled and not board.tristate and cycle >= board.expires_at:
            expire_watchdog(s, cycle)
    if board.bus_pins:
        drive_bus(s, cycle)
    return True


@kernel
def run(s: State, cycle: int) -> bool:
    """Do all edges up to ``cycle``, axes excepted; False if a buffer is full."""
    board = s.board[0]
    while board.next_event <= cycle:
        if s.rows.full[0]:
            return False
        board.next_event = next_event(s)
        if board.next_event > cycle:
            break
        if not edge(s, board.next_event):
            return False
        board.done = board.next_event
    board.done = max(board.done, cycle)
    return True


@kernel
def run_all(s: State, cycle: int) -> bool:
    """Do all edges up to ``cycle``, axes included; False if a buffer is full."""
    return run(s, cycle) and advance_all(s, cycle, RESERVE)


# ------------------------------------------------------------------------------------- transactions


@kernel
def transact(s: State, accesses: Any, first: int) -> int:
    """Carry out accesses from number ``first`` on; return the number of the first one not done.

    That is less than the number of accesses if a buffer is full.
    """
    board = s.board[0]
    for n in range(first, accesses.size):
        access = accesses[n]
        cycle = max(access.cycle, board.last_access + board.access_cycles, board.done)
        if s.rows.full[0] or (board.next_event <= cycle and not run(s, cycle)):
            return n
        op, timeout = access.op, 0
        if op == ADDRESS_WRITE:
            board.byte = access.value
            board.address = 0 if board.in_reset else access.value % ADDRESSES
        elif board.in_reset:
            timeout = 1
            if op == DATA_WRITE:
                board.byte = access.value
            else:
                access.value = board.byte
        elif op == DATA_WRITE:
            if not write_byte(s, int(access.value), cycle, RESERVE):
                return n
            board.byte = access.value
            board.writes[board.address] += 1
            board.address = (board.address + 1) % ADDRESSES
        else:
            if board.address % 4 == 0:
                if not advance_all(s, cycle, RESERVE):
                    return n
                load_latch(s, cycle)
            if op == DATA_READ:
                board.reads[board.address] += 1
                board.address = (board.address + 1) % ADDRESSES
            board.byte = bus_byte(board)
            access.value = board.byte
        access.timeout = timeout
        access.cycle = cycle
        board.last_access = board.done = cycle
    return len(accesses)
