"""Sequencer and accumulators of the original, clock by clock where they do anything.

The tick is a level, the divider counter equal to the divider; its rising edge integrates, one clock
later the countdown follows. All registers are as they are in cycle ``core_cycle``.
"""

from __future__ import annotations

from typing import Any, Final

from pulsewright.boards.rapcores.twin_motor import FRACTION
from pulsewright.boards.rapcores.twin_state import (
    LONG,
    MOVE_DONE,
    STEP,
    UPSTREAM,
    State,
    hold_telemetry,
    motor_row,
    show_directions,
    show_ready,
)
from pulsewright.twin.clock import NEVER
from pulsewright.twin.kernel import inlined, kernel
from pulsewright.twin.recorder import drive, toggle

COUNTER: Final = 0xFF  # mask of the divider counter
SLOTS: Final = 2
HALF_STEP: Final = 62  # bit of the fraction
IDLE_LOSS: Final = (1 << 63) - 101  # taken from a positive accumulator of 0.2 at an idle tick
FLOPS: Final = 2  # cycles for which a tick level is remembered


@inlined
def pending(board: Any) -> bool:
    """Tell whether the slot to execute is armed."""
    return bool((board.ready ^ board.finished) >> board.slot & 1)


@inlined
def to_level(board: Any) -> int:
    """Return how many cycles it is to the next one with the tick level."""
    ahead = board.period - 1 - board.count
    cycles: int = ahead if ahead >= 0 else ahead + COUNTER + 1
    return cycles


@kernel
def owes(s: State) -> bool:
    """Tell whether ticks change something while no move executes, as in the original 0.2."""
    board = s.world[0].board
    if board.profile == UPSTREAM:
        return False
    for i in range(board.motors):
        if s.world[0].motors[i].step or s.world[0].motors[i].fraction > 0:
            return True
    return False


@kernel
def next_event(s: State) -> int:
    """Return the first cycle from ``core_cycle`` on in which a clock edge changes anything."""
    board = s.world[0].board
    now = board.core_cycle
    execute = board.run and pending(board)
    if (not board.run and pending(board)) or (execute and board.ticks_left == 0):
        return int(now)
    if not execute and not owes(s):
        return NEVER
    if board.tick1 != board.tick2:
        return int(now)
    if board.tick1:  # with divider 0 the level stays, and there is no tick
        return NEVER if board.period == 1 and board.count == 0 else int(now)
    return int(now + to_level(board))


@kernel
def pass_time(board: Any, cycle: int) -> None:
    """Bring divider and tick flops to ``cycle``, while nothing else changes."""
    left = cycle - board.core_cycle
    period = board.period
    if left > FLOPS:
        skip = left - FLOPS
        ahead = to_level(board)
        if skip <= ahead:
            board.count = (board.count + skip) & COUNTER
        else:
            board.count = (skip - ahead - 1) % period
        left = FLOPS
        # flops that matter then are set by the cycles that are left
    for _ in range(left):
        level = 1 if board.count == board.period - 1 else 0
        board.tick2, board.tick1 = board.tick1, level
        board.count = 0 if level else (board.count + 1) & COUNTER
    board.core_cycle = cycle


@kernel
def integrate(s: State, execute: bool, cycle: int) -> None:
    """Do what a tick does to the accumulators in ``cycle``."""
    board = s.world[0].board
    for i in range(board.motors):
        motor = s.world[0].motors[i]
        row = motor_row(i, STEP)
        if board.profile == UPSTREAM:
            if not execute:
                continue
            total = motor.fraction + motor.increment
            if total < 0:
                motor.position += 1 if motor.increment >= 0 else -1
            motor.fraction = total & FRACTION
            if board.fixed:
                drive(s.rows, row, motor.fraction >> HALF_STEP & 1, cycle)
                motor.increment += board.change[board.slot, i]
            else:
                motor.increment += board.increment[board.slot, i]
            continue
        positive = motor.fraction > 0
        motor.step = 1 if positive else 0
        drive(s.rows, row, motor.step, cycle)
        if execute:
            motor.fraction += motor.increment
            motor.increment += board.change[board.slot, i]
        elif positive:
            motor.fraction -= IDLE_LOSS


@kernel
def clock(s: State, cycle: int) -> None:
    """Do the edge at the end of ``cycle``, in which something may happen."""
    board = s.world[0].board
    pass_time(board, cycle)
    ready = pending(board)
    execute = bool(board.run) and ready
    load = not board.run and ready
    ends = execute and board.ticks_left == 0
    level = 1 if board.count == board.period - 1 else 0
    if level and not board.tick1:
        integrate(s, execute, cycle)
    if board.tick1 and not board.tick2 and execute:
        board.ticks_left = (board.ticks_left - 1) & LONG
    board.tick2, board.tick1 = board.tick1, level
    board.count = 0 if level else (board.count + 1) & COUNTER
    board.core_cycle = cycle + 1
    if load:
        hold_telemetry(s)
        board.run = 1
        board.ticks_left = board.duration[board.slot]
        for i in range(board.motors):
            s.world[0].motors[i].increment = board.increment[board.slot, i]
    if ends:
        board.run = 0
        board.idle_from = cycle + 1
        board.finished ^= 1 << board.slot
        board.slot = (board.slot + 1) % SLOTS
        toggle(s.rows, MOVE_DONE, cycle)
        show_directions(s, cycle)
        show_ready(s, cycle)


@kernel
def arm(s: State, cycle: int) -> None:
    """Toggle the slot that was written to ready, at edge ``cycle``."""
    board = s.world[0].board
    board.ready ^= 1 << board.write_slot
    board.write_slot = (board.write_slot + 1) % SLOTS
    show_ready(s, cycle)
