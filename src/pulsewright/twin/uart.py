"""Asynchronous serial ports (8N1) of a board, from byte to byte.

The bit clock of a UART is a sum: every board cycle adds ``step``, and each time that the sum passes
``limit``, an enable comes, 16 of which are a bit. The sum runs from cycle 0 on and knows no reset,
so that enables have closed forms. Cycle n is the interval before clock edge n.

What comes in is kept as changes of the line; a byte is looked for where the line falls, and taken
in one go at the cycle of its valid pulse. What goes out is a byte, a start, and edges that are made
when they are asked for.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from pulsewright.twin.clock import NEVER
from pulsewright.twin.kernel import inlined, kernel
from pulsewright.twin.recorder import Rows, drive

FRAME_BITS: Final = 10
STOP: Final = 1 << (FRAME_BITS - 1)
OVERSAMPLING: Final = 16
START_CHECK: Final = 10  # enables from the one that sees the line low to the check of the start bit
SYNCHRONISER: Final = 2  # cycles from the pin to the receiver
HEARD: Final = 1 << 16  # bytes that a host can leave unread

# One port. ``step``, ``limit``: the bit clock. ``clock_hz``, ``baud``: the host's bit clock.
# Receiver: ``idle`` is the first cycle in which it waits for a start bit; ``level`` of the line
# before change number ``head`` of ``tail``; ``first``, the number of the enable that sees the start
# bit, and ``valid``, the cycle of the valid pulse. Transmitter: ``frame`` with start and stop bit,
# enables before it ``base``, bits already shown ``bit``, cycle ``begin`` of the hand-over and
# ``done`` of the done pulse. Bytes for the host, in a ring of `HEARD`: ``sent`` and ``taken``.
PORT: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            *("step", "limit", "clock_hz", "baud"),
            *("idle", "level", "head", "tail", "first", "valid"),
            *("frame", "base", "bit", "begin", "done", "sent", "taken"),
        )
    ]
)


# ---------------------------------------------------------------------------------------- bit clock


@inlined
def enables_through(cycle: int, step: int, limit: int) -> int:
    """Count the enables in cycles up to and including ``cycle``."""
    return (cycle - 1) * step // limit if cycle > 0 else 0


@inlined
def enable_cycle(number: int, step: int, limit: int) -> int:
    """Return the cycle of an enable, counted from 1."""
    return (number * limit + step - 1) // step + 1


# ----------------------------------------------------------------------------------------- receiver


@kernel
def find_byte(port: Any, line: Any) -> None:
    """Find the next valid pulse in the changes that are known.

    To be called when the receiver becomes idle, and again when changes are added; those that are
    over stay as they are, so a pulse that was found and is over stays, too.
    """
    step, limit = port.step, port.limit
    idle, at, level = port.idle, port.head, port.level
    while True:
        while at < port.tail and line[at] >> 1 <= idle - SYNCHRONISER:
            level = line[at] & 1
            at += 1
        if level == 1:
            if at == port.tail:
                port.valid = NEVER
                return
            idle = (line[at] >> 1) + SYNCHRONISER
            continue
        first = enables_through(idle - 1, step, limit) + 1
        seen = enable_cycle(first, step, limit)
        while at < port.tail and line[at] >> 1 <= seen - SYNCHRONISER:
            level = line[at] & 1
            at += 1
        if level == 1:
            idle = seen + 1
            continue
        check = enable_cycle(first + START_CHECK, step, limit)
        while at < port.tail and line[at] >> 1 <= check - SYNCHRONISER:
            level = line[at] & 1
            at += 1
        if level == 1:
            idle = check + 1
            continue
        port.first = first
        stop = first + START_CHECK + OVERSAMPLING * (FRAME_BITS - 1)
        port.valid = enable_cycle(stop, step, limit) + 1
        return


@kernel
def take_byte(port: Any, line: Any) -> int:
    """Return the byte whose valid pulse is now, or -1 if its stop bit is low; go on to the next."""
    at, level, frame = port.head, port.level, 0
    for bit in range(1, FRAME_BITS):
        number = port.first + START_CHECK + OVERSAMPLING * bit
        sample = enable_cycle(number, port.step, port.limit) - SYNCHRONISER
        while at < port.tail and line[at] >> 1 <= sample:
            level = line[at] & 1
            at += 1
        frame |= level << bit
    port.head, port.level, port.idle = at, level, port.valid
    find_byte(port, line)
    return frame >> 1 & 0xFF if frame & STOP else -1


@kernel
def receiver_reset(port: Any, line: Any, cycle: int) -> None:
    """Let the receiver wait for a start bit from ``cycle`` on."""
    port.idle = cycle
    while port.head < port.tail and line[port.head] >> 1 <= cycle - SYNCHRONISER:
        port.level = line[port.head] & 1
        port.head += 1
    find_byte(port, line)


@kernel
def send(port: Any, line: Any, data: Any, start: int) -> bool:
    """Put bytes on the line, the first start bit at ``start``, after all changes that are known.

    Bit k of them begins ``floor(k * clock_hz / baud)`` cycles later. False, and nothing done, if
    there is no room for them.
    """
    if port.tail + FRAME_BITS * len(data) > len(line):
        for n in range(port.head, port.tail):
            line[n - port.head] = line[n]
        port.tail -= port.head
        port.head = 0
        if port.tail + FRAME_BITS * len(data) > len(line):
            return False
    level = line[port.tail - 1] & 1 if port.tail > port.head else port.level
    tail, bits = port.tail, 0
    for n in range(len(data)):
        frame = int(data[n]) << 1 | STOP
        for bit in range(FRAME_BITS):
            if frame >> bit & 1 != level:
                level ^= 1
                line[tail] = (start + bits * port.clock_hz // port.baud) << 1 | level
                tail += 1
            bits += 1
    port.tail = tail
    if port.idle < NEVER:
        find_byte(port, line)
    return True


# -------------------------------------------------------------------------------------- transmitter


@kernel
def show_bits(port: Any, cycle: int, rows: Rows, row: int) -> None:
    """Record the edges through ``cycle`` of the byte that is sent."""
    while port.bit < FRAME_BITS - 1:
        bit = port.bit + 1
        level = port.frame >> bit & 1
        if level != rows.pins[row].level:
            at = enable_cycle(port.base + OVERSAMPLING * bit, port.step, port.limit)
            if at > cycle:
                return
            drive(rows, row, level, at)
        port.bit = bit


@kernel
def start_byte(port: Any, heard: Any, byte: int, cycle: int) -> None:
    """Hand a byte to the transmitter in ``cycle``; the one before must be done."""
    port.frame, port.bit, port.begin = byte << 1 | STOP, 0, cycle
    port.base = enables_through(cycle, port.step, port.limit)
    end = port.base + OVERSAMPLING * FRAME_BITS
    port.done = enable_cycle(end, port.step, port.limit) + 1
    heard[port.sent % HEARD] = arrival(port, FRAME_BITS - 1) << 8 | byte
    port.sent += 1


@inlined
def arrival(port: Any, bit: int) -> int:
    """Return the cycle at which a host samples a bit of the byte that is sent: in its middle."""
    middle = ((2 * bit + 1) * port.clock_hz + 2 * port.baud - 1) // (2 * port.baud)
    return int(port.begin + middle)


@kernel
def cut_byte(port: Any, heard: Any, cycle: int) -> None:
    """Bring the line to 1 at ``cycle``, perhaps inside a byte: the host hears the rest as 1."""
    if port.sent > 0 and arrival(port, FRAME_BITS - 1) >= cycle:
        if arrival(port, 0) >= cycle:
            port.sent -= 1  # too short for a start bit
        else:
            last = (port.sent - 1) % HEARD
            for bit in range(1, FRAME_BITS - 1):
                if arrival(port, bit) >= cycle:
                    heard[last] |= 1 << (bit - 1)
    port.bit = FRAME_BITS - 1
    port.done = NEVER


@kernel
def heard_through(port: Any, heard: Any, cycle: int) -> int:
    """Count the bytes that the host has received up to ``cycle`` and not taken yet."""
    n = port.sent
    while n > port.taken and heard[(n - 1) % HEARD] >> 8 > cycle:
        n -= 1
    return int(n - port.taken)
