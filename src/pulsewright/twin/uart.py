"""Asynchronous serial ports (8N1) of a board, from byte to byte.

The bit clock of a UART is a sum: every board cycle adds ``step``, and each time that the sum passes
a multiple of ``limit``, an enable comes one cycle later, 16 of which are a bit. The sum runs from
cycle 0 on and knows no reset, so enables have closed forms. Cycle n is the interval before clock
edge n.

What comes in is kept as changes of the line; a byte is looked for where the line falls, and taken
in one go at the cycle of its valid pulse. What goes out is a byte, a start, and edges that are made
when they are asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pulsewright.twin.clock import NEVER
from pulsewright.twin.kernel import inlined, kernel
from pulsewright.twin.recorder import Rows, drive

FRAME_BITS: Final = 10
STOP: Final = 1 << (FRAME_BITS - 1)
SYNCHRONISER: Final = 2  # cycles from the pin to the receiver
HEARD: Final = 1 << 16  # bytes that a host can leave unread
# Enables in a bit; from the one that sees the line low to the check of the start bit and to that of
# the stop bit; from the first one of a byte that is sent to the end of its start bit and of all.
SPANS: Final = {"bit": 16, "check": 10, "stop": 10 + 9 * 16, "start": 15, "frame": 10 * 16 - 1}

# One port. ``step``, ``limit``: the bit clock. ``bit`` and ``bit_rest``, and so with other spans:
# whole cycles of it, and how much the sum lacks then. ``clock_hz``, ``baud``: the host's bit clock;
# ``free``, the first cycle in which it can start a byte.
# Receiver: ``idle`` is the first cycle in which it waits for a start bit; ``level`` of the line
# before change number ``head`` of ``tail``; ``checked``, when the start bit is checked, with the
# ``checked_excess`` of that enable; ``valid``, the cycle of the valid pulse.
# Transmitter: ``begin`` is the cycle of the hand-over, ``done`` that of the done pulse, ``sending``
# the byte with its start and stop bit; ``shown`` of its bits are recorded, the next one comes at
# edge ``edge``. Bytes for the host are in a ring of `HEARD`: ``sent``, ``taken`` of them.
PORT: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            *("step", "limit", *SPANS, *(f"{name}_rest" for name in SPANS)),
            *("clock_hz", "baud", "free"),
            *("idle", "level", "head", "tail", "checked", "checked_excess", "valid"),
            *("begin", "done", "sending", "shown", "edge", "edge_excess", "sent", "taken"),
        )
    ]
)


def make_ports(clock_hz: int, clocks: Sequence[tuple[int, int, int]]) -> NDArray[np.void]:
    """Return ports that are held in reset.

    Parameters
    ----------
    clock_hz : int
        Clock of the board [Hz].
    clocks : sequence of (int, int, int)
        Of each port its baud rate, for the host, and ``step`` and ``limit``.
    """
    ports = np.zeros(len(clocks), PORT)
    ports["clock_hz"] = clock_hz
    ports["baud"], ports["step"], ports["limit"] = np.array(clocks).T
    for name, enables in SPANS.items():
        ports[name], ports[f"{name}_rest"] = np.divmod(enables * ports["limit"], ports["step"])
    ports["level"], ports["shown"] = 1, FRAME_BITS
    ports["idle"] = ports["valid"] = NEVER
    return ports


# ---------------------------------------------------------------------------------------- bit clock


@inlined
def first_enable(port: Any, cycle: int) -> tuple[int, int]:
    """Return the first enable in ``cycle``, at least 2, or later, and its excess.

    The excess is what the sum is past a multiple of ``limit`` there.
    """
    rest = (cycle - 2) * port.step % port.limit
    wait = (port.limit - rest + port.step - 1) // port.step
    return cycle - 1 + wait, rest + wait * port.step - port.limit


@inlined
def later(enable: tuple[int, int], cycles: int, rest: int, step: int) -> tuple[int, int]:
    """Return the enable one span after another one, and its excess."""
    cycle, excess = enable
    more = 1 if rest > excess else 0
    return cycle + cycles + more, excess + more * step - rest


# ----------------------------------------------------------------------------------------- receiver


@kernel
def find_byte(port: Any, line: Any) -> None:
    """Find the next valid pulse in the changes that are known.

    To be called when the receiver becomes idle, and again when changes are added; those that are
    over stay as they are, so a pulse that was found and is over stays, too.
    """
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
        start = first_enable(port, idle)
        while at < port.tail and line[at] >> 1 <= start[0] - SYNCHRONISER:
            level = line[at] & 1
            at += 1
        if level == 1:
            idle = start[0] + 1
            continue
        check = later(start, port.check, port.check_rest, port.step)
        while at < port.tail and line[at] >> 1 <= check[0] - SYNCHRONISER:
            level = line[at] & 1
            at += 1
        if level == 1:
            idle = check[0] + 1
            continue
        port.checked, port.checked_excess = check
        port.valid = later(start, port.stop, port.stop_rest, port.step)[0] + 1
        return


@kernel
def take_byte(port: Any, line: Any) -> int:
    """Return the byte whose valid pulse is now, or -1 if its stop bit is low; go on to the next."""
    at, level, frame = port.head, port.level, 0
    sample = (port.checked, port.checked_excess)
    for bit in range(1, FRAME_BITS):
        sample = later(sample, port.bit, port.bit_rest, port.step)
        while at < port.tail and line[at] >> 1 <= sample[0] - SYNCHRONISER:
            level = line[at] & 1
            at += 1
        frame |= level << bit
    port.head, port.level, port.idle = at, level, port.valid
    find_byte(port, line)
    return frame >> 1 & 0xFF if frame & STOP else -1


@kernel
def receiver_reset(port: Any, line: Any, cycle: int) -> None:
    """Let the receiver run from ``cycle`` on; its synchroniser is reset too and still high then."""
    port.idle = cycle + SYNCHRONISER
    while port.head < port.tail and line[port.head] >> 1 <= cycle:
        port.level = line[port.head] & 1
        port.head += 1
    find_byte(port, line)


@kernel
def send(port: Any, line: Any, data: Any, start: int) -> bool:
    """Put bytes on the line, the first start bit at ``start`` or as soon after as it is free.

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
    tail = port.tail
    at, over = max(start, port.free), 0  # begin of a bit: whole cycles, and parts of one
    whole, rest = port.clock_hz // port.baud, port.clock_hz % port.baud
    for n in range(len(data)):
        frame = int(data[n]) << 1 | STOP
        for bit in range(FRAME_BITS):
            if frame >> bit & 1 != level:
                level ^= 1
                line[tail] = at << 1 | level
                tail += 1
            at += whole
            over += rest
            if over >= port.baud:
                at += 1
                over -= port.baud
    port.tail = tail
    port.free = at + 1 if over else at
    if port.idle < NEVER:
        find_byte(port, line)
    return True


# -------------------------------------------------------------------------------------- transmitter


@kernel
def show_bits(port: Any, cycle: int, rows: Rows, row: int) -> None:
    """Record the edges through ``cycle`` of the byte that is sent."""
    while port.shown < FRAME_BITS and port.edge <= cycle:
        drive(rows, row, port.sending >> port.shown & 1, port.edge)
        edge = (port.edge, port.edge_excess)
        port.edge, port.edge_excess = later(edge, port.bit, port.bit_rest, port.step)
        port.shown += 1


@kernel
def start_byte(port: Any, heard: Any, byte: int, cycle: int) -> None:
    """Hand a byte to the transmitter in ``cycle``; the one before must be done."""
    port.begin, port.sending, port.shown = cycle, byte << 1 | STOP, 1
    first = first_enable(port, cycle + 1)
    port.edge, port.edge_excess = later(first, port.start, port.start_rest, port.step)
    port.done = later(first, port.frame, port.frame_rest, port.step)[0] + 1
    heard[port.sent % HEARD] = sampled(port, FRAME_BITS - 1) << 8 | byte
    port.sent += 1


@inlined
def sampled(port: Any, bit: int) -> int:
    """Return the cycle at which a host samples a bit of the byte that is sent: in its middle."""
    middle = ((2 * bit + 1) * port.clock_hz + 2 * port.baud - 1) // (2 * port.baud)
    return int(port.begin + middle)


@kernel
def cut_byte(port: Any, heard: Any, cycle: int) -> None:
    """Bring the line to 1 at ``cycle``, perhaps inside a byte: the host hears the rest as 1."""
    if port.sent > 0 and sampled(port, FRAME_BITS - 1) >= cycle:
        if sampled(port, 0) >= cycle:
            port.sent -= 1  # too short for a start bit
        else:
            last = (port.sent - 1) % HEARD
            for bit in range(1, FRAME_BITS - 1):
                if sampled(port, bit) >= cycle:
                    heard[last] |= 1 << (bit - 1)
    port.shown = FRAME_BITS
    port.done = NEVER


@kernel
def take_heard(port: Any, heard: Any, cycle: int, data: Any) -> int:
    """Take the bytes that the host has received up to ``cycle``; return how many.

    Of more than `HEARD`, the older ones are lost: then their negative number comes back, and they
    count as taken.
    """
    lost = port.sent - port.taken - HEARD
    if lost > 0:
        port.taken += lost
        return int(-lost)
    count = 0
    while port.taken < port.sent and heard[port.taken % HEARD] >> 8 <= cycle:
        data[count] = heard[port.taken % HEARD] & 0xFF
        port.taken += 1
        count += 1
    return count
