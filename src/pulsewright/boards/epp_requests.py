"""Requests of the EPP socket protocol, carried out on a twin in compiled code.

`serve_requests` is generic: a room calls it from a kernel of its own with its `Board` of functions,
and with state that it finds at addresses in memory (`twin.memory`). A servo cycle of a real client
is some twenty replies, each of which it waits for. So a client is also received from and replied to
in compiled code (`converse`), for as long as no other one wants anything.
"""

from __future__ import annotations

import time
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pulsewright.transport.bus import (
    ADDRESS_READ,
    ADDRESS_WRITE,
    DATA_READ,
    DATA_WRITE,
    EPP_ACCESS,
)
from pulsewright.transport.epp_wire import CONFIGURE, NINIT, REQUEST_BYTES
from pulsewright.transport.pollfd import POLL
from pulsewright.twin.kernel import hot, kernel
from pulsewright.twin.memory import array_at, clock_gettime, poll, receive, send
from pulsewright.twin.recorder import PIN, Rows

AXES: Final = 4  # step positions in a record
BLOCK: Final = 4200  # bytes of requests in one call, at most
REPLY_BYTES: Final = (BLOCK // REQUEST_BYTES) * 256
BLOCK_ROWS: Final = BLOCK // REQUEST_BYTES  # that one block of requests can write, at most
LOG_ROWS: Final = 8 * BLOCK_ROWS
TURN_NS: Final = 50_000_000  # a client is served by itself for so long at once, at most
MONOTONIC: Final = time.CLOCK_MONOTONIC
SLACK_NS: Final = 60 * 10**9  # a client's clock further off than this is another clock
SECOND: Final = 10**9

# What `carry_out` returns.
DONE: Final = 0
FULL: Final = 1  # make room for edges and call again
AHEAD: Final = 2  # bring the boards to cycle ``target`` and call again
WRONG: Final = 3  # the request at ``at`` is none; those before it are done

POLLS: Final = 256  # file descriptors

LINK: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            # this call: bytes of requests, offset of the next one, bytes of replies; rows used
            *("size", "at", "replied", "logged", "recorded"),
            # request under way: accesses, those done, model time, marker; accesses = 0: none
            *("accesses", "done", "op", "first_answered", "address"),
            # fixed: clock, lockstep period [ns] (0: wall), cost of a request [ns]
            *("clock_hz", "period", "cost", "require_config", "logging", "recording"),
            # time [ns]: of the last request, of the last marker; wall mode: time of the first
            # request by the client and by the server, and the server's clock now
            *("now", "marked", "first_t", "first_own", "own"),
            *("started", "markers", "overruns", "timeout", "record_due"),
            # boards are brought to this cycle at most; cycle asked with AHEAD
            *("horizon", "target"),
            *("frames", "bus_frames", "ninit", "config_bytes", "config_crc"),
            # faults: accesses not acknowledged (-1: all), bits flipped in data read or written
            *("mute", "flip_read", "flip_reads", "flip_write", "flip_writes", "power"),
            # writes that boards do not see, or see twice; accesses carried out, not acknowledged
            *("lose", "double", "stuck"),
            # client to converse with, -1: none; file descriptors to look at; bytes in and out
            *("fd", "polls", "bytes_in", "bytes_out"),
            # what the system says of the time
            *("clock_s", "clock_ns"),
        )
    ]
)
CLOCK_AT: Final = (LINK.names or ()).index("clock_s") * 8
BLOCK_WORDS: Final = 16  # addresses and lengths, in the order of `EppTwin.addresses` and `Memory`


class Memory(NamedTuple):
    """What lies beside the state of a board; see `array_at`.

    Parameters
    ----------
    link : (1,) LINK
    requests : (BLOCK,) uint8
    replies : (REPLY_BYTES,) uint8
    log : (LOG_ROWS, 3) int64
        Acknowledged data writes: model time [ns], address byte, value.
    record : (LOG_ROWS, 1 + AXES) int64
        Servo cycles: model time [ns], step positions.
    accesses : (255,) EPP_ACCESS
    polls : (POLLS,) POLL
        What may happen at all connections.
    """

    link: NDArray[np.void]
    requests: NDArray[np.uint8]
    replies: NDArray[np.uint8]
    log: NDArray[np.int64]
    record: NDArray[np.int64]
    accesses: NDArray[np.void]
    polls: NDArray[np.void]


class Board(NamedTuple):
    """What a room tells of its boards; ``s`` is its state.

    Parameters
    ----------
    transact : kernel
        ``(s, accesses, first)``: as in `EppTwin`.
    bring : kernel
        ``(s, cycle)``: all edges up to ``cycle``, axes included; False if a buffer is full.
    set_ninit : kernel
        ``(s, level)``: at the present cycle, axes brought there.
    set_origin : kernel
        ``(s, cycle)``: edge 0 of boards that nothing has happened to.
    is_marker : kernel
        ``(s, op, value)``: whether an access begins a servo cycle.
    reads_first : kernel
        ``(s, count)``: whether data reads touch register 00 of the first board.
    address, byte : kernel
        ``(s)``: address register; byte last driven on the bus.
    set_byte : kernel
        ``(s, value)``: a byte that no board sees.
    position : kernel
        ``(s, axis)``: step position of the first board [step].
    """

    transact: Any
    bring: Any
    set_ninit: Any
    set_origin: Any
    is_marker: Any
    reads_first: Any
    address: Any
    byte: Any
    set_byte: Any
    position: Any


@hot
def rows_at(block: NDArray[np.int64]) -> Rows:
    """Return the edge buffers, of which words 4 to 8 of the block tell."""
    return Rows(
        array_at(block[4], block[5], np.int64),
        array_at(block[6], block[7], PIN),
        array_at(block[8], 1, np.int64),
    )


@hot
def memory_at(block: NDArray[np.int64]) -> Memory:
    """Return what words 9 to 15 of the block tell of."""
    return Memory(
        array_at(block[9], 1, LINK),
        array_at(block[10], BLOCK, np.uint8),
        array_at(block[11], REPLY_BYTES, np.uint8),
        array_at(block[12], (LOG_ROWS, 3), np.int64),
        array_at(block[13], (LOG_ROWS, 1 + AXES), np.int64),
        array_at(block[14], 255, EPP_ACCESS),
        array_at(block[15], POLLS, POLL),
    )


@kernel
def cycle_of(ns: int, clock_hz: int) -> int:
    """Return the last cycle whose edge is not after a model time."""
    return ns // SECOND * clock_hz + ns % SECOND * clock_hz // SECOND


@kernel
def first_cycle(ns: int, clock_hz: int) -> int:
    """Return the first cycle whose edge is not before a model time."""
    return ns // SECOND * clock_hz + -(-(ns % SECOND * clock_hz) // SECOND)


@kernel
def wall_time(link: Any, t: int) -> int:
    """Return the model time of a request with the client's time ``t`` [ns].

    A clock that is far off is not the one that the first request came with: then the server's own
    counts, so that no client can stop the time of another one or send it far ahead.
    """
    own: int = link.own - link.first_own
    since: int = t - link.first_t
    if t < 0 or since > max(link.now, own) + SLACK_NS or since < -SLACK_NS:
        since = own
    now: int = max(link.now, since)
    return now


@kernel
def crc32(crc: int, byte: int) -> int:
    """Return the checksum with one more byte (as zlib)."""
    crc = crc ^ 0xFFFFFFFF ^ byte
    for _ in range(8):
        crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


@hot
def begin(s: Any, link: Any, memory: Memory, board: Board) -> int:
    """Start the request at ``at``: its time, and accesses for the boards; or all of it, if short.

    Returns
    -------
    int
        As `carry_out`; unless DONE, nothing has happened.
    """
    request = memory.requests[link.at : link.at + REQUEST_BYTES]
    op, arg = int(request[0]), int(request[1])
    t = 0
    for i in range(8):
        t |= int(request[2 + i]) << (8 * i)
    reads = op in (DATA_READ, ADDRESS_READ)
    on_bus = reads or op in (ADDRESS_WRITE, DATA_WRITE)
    if (not on_bus and op not in (NINIT, CONFIGURE)) or (reads and arg == 0):
        return WRONG
    if not link.started and not link.period:
        link.first_t, link.first_own = t if t >= 0 else link.own, link.own
    marker = on_bus and board.is_marker(s, op, arg)
    overrun = 0
    if not link.period:
        now = wall_time(link, t)
    else:
        now = link.now + link.cost if on_bus else link.now
        if marker and link.markers:
            due = link.marked + link.period
            overrun = 1 if now > due else 0
            now = max(now, due)
    cycle = cycle_of(now, link.clock_hz)
    if cycle > link.horizon:
        link.target = cycle
        return AHEAD
    recorded = (
        link.recording
        and (marker or link.record_due)
        and op == DATA_READ
        and board.reads_first(s, arg)
    )
    edge = first_cycle(now, link.clock_hz)
    if (recorded or not on_bus) and not board.bring(s, edge if not on_bus else cycle):
        return FULL
    if not link.started:
        link.started = 1
        if answers(link):
            board.set_origin(s, edge)
    link.now = now
    link.frames += 1
    if marker:
        link.marked = now
        link.markers += 1
        link.overruns += overrun
        link.record_due = 1
    if recorded:
        memory.record[link.recorded, 0] = now
        for i in range(AXES):
            memory.record[link.recorded, 1 + i] = board.position(s, i)
        link.recorded += 1
        link.record_due = 0
    if not on_bus:
        configure(s, link, op, arg, board)
        link.at += REQUEST_BYTES
        return DONE
    link.bus_frames += 1
    link.op, link.address, link.first_answered = op, board.address(s), 0
    link.accesses = arg if reads else 1
    lost = not reads and link.lose != 0
    if lost:
        link.lose -= 1 if link.lose > 0 else 0
    elif not reads and link.double:
        link.accesses = 2
        link.double -= 1 if link.double > 0 else 0
    for n in range(link.accesses):
        access = memory.accesses[n]
        access.cycle, access.op, access.value, access.timeout = cycle, op, arg, 0
    if not reads and link.flip_writes:
        for n in range(link.accesses):
            memory.accesses[n].value ^= link.flip_write
        link.flip_writes -= 1 if link.flip_writes > 0 else 0
    link.done = link.accesses if lost else 0
    if not lost:
        mute(s, link, memory, board)
    return DONE


@kernel
def configure(s: Any, link: Any, op: int, arg: int, board: Board) -> None:
    """Carry out ``I`` or ``P``; the boards stand at the time of the request."""
    if op == CONFIGURE:
        link.config_bytes += 1
        link.config_crc = crc32(link.config_crc, arg)
    elif (arg != 0) != (link.ninit != 0):
        link.ninit = 1 if arg else 0
        if not arg:
            link.config_bytes = link.config_crc = 0
    board.set_ninit(s, 1 if answers(link) else 0)


@kernel
def answers(link: Any) -> bool:
    """Tell whether the boards are out of reset."""
    configured = not link.require_config or link.config_bytes > 0
    return bool(link.ninit and link.power and configured)


@kernel
def mute(s: Any, link: Any, memory: Memory, board: Board) -> None:
    """Take away the accesses that a fault keeps from the boards."""
    count = link.accesses if link.mute < 0 else min(link.accesses, link.mute)
    for n in range(count):
        access = memory.accesses[n]
        access.timeout = 0 if link.op == ADDRESS_WRITE else 1
        if link.op in (ADDRESS_WRITE, DATA_WRITE):
            board.set_byte(s, access.value)
        else:
            access.value = board.byte(s)
    link.done = link.first_answered = count
    link.mute -= count if link.mute > 0 else 0


@hot
def finish(link: Any, memory: Memory) -> None:
    """Reply to the request whose accesses are done, and note it."""
    accesses = memory.accesses[: link.accesses]
    for n in range(link.accesses):
        if link.stuck:
            link.stuck -= 1 if link.stuck > 0 else 0
            if link.op != ADDRESS_WRITE:
                accesses[n].timeout = 1
            if link.op in (DATA_READ, ADDRESS_READ):
                accesses[n].value = 0xFF
        link.timeout |= accesses[n].timeout
    if link.op in (DATA_READ, ADDRESS_READ):
        memory.replies[link.replied] = link.timeout
        link.replied += 1
        link.timeout = 0
        for n in range(link.accesses):
            value = accesses[n].value
            if link.flip_reads:
                value ^= link.flip_read
                link.flip_reads -= 1 if link.flip_reads > 0 else 0
            memory.replies[link.replied] = value
            link.replied += 1
    elif link.op == DATA_WRITE and link.logging and not accesses[0].timeout:
        memory.log[link.logged, 0] = link.now
        memory.log[link.logged, 1] = link.address
        memory.log[link.logged, 2] = accesses[0].value
        link.logged += 1
    link.accesses = 0
    link.at += REQUEST_BYTES


@hot
def carry_out(s: Any, memory: Memory, board: Board) -> int:
    """Carry out requests from ``at`` on, until all are done or the caller has to do something.

    Returns
    -------
    int
        ``DONE``, or what the caller has to do.
    """
    link = memory.link[0]
    while link.at + REQUEST_BYTES <= link.size:
        if not link.accesses:
            status = begin(s, link, memory, board)
            if status != DONE:
                return status
            if not link.accesses:
                continue
        link.done = board.transact(s, memory.accesses[: link.accesses], link.done)
        if link.done < link.accesses:
            return FULL
        finish(link, memory)
    return DONE


@hot
def look(link: Any, block: NDArray[np.int64]) -> int:
    """Return the monotonic time [ns]."""
    clock_gettime(MONOTONIC, block[9] + CLOCK_AT)
    return int(link.clock_s * SECOND + link.clock_ns)


@hot
def converse(s: Any, memory: Memory, board: Board, block: NDArray[np.int64]) -> int:
    """Carry out requests of the client ``fd`` and reply, until something else is to be done.

    Returns
    -------
    int
        As `carry_out`. Requests from ``at`` on, and replies up to ``replied``, are the caller's.
    """
    link = memory.link[0]
    until = link.own + TURN_NS
    while True:
        status = carry_out(s, memory, board)
        if status != DONE:
            return status
        rest = link.size - link.at
        for n in range(rest):
            memory.requests[n] = memory.requests[link.at + n]
        link.at, link.size = 0, rest
        if link.replied:
            sent = send(link.fd, block[11], link.replied, 0)
            if sent != link.replied:
                for n in range(max(0, sent), link.replied):
                    memory.replies[n - max(0, sent)] = memory.replies[n]
                link.replied -= max(0, sent)
                return DONE
            link.replied = 0
            link.bytes_out += sent
        if max(link.logged, link.recorded) > LOG_ROWS - BLOCK_ROWS or link.own >= until:
            return DONE
        if poll(block[15], link.polls, (until - link.own) // 1_000_000 + 1) <= 0:
            return DONE
        for n in range(link.polls):
            if memory.polls[n].revents and memory.polls[n].fd != link.fd:
                return DONE
        got = receive(link.fd, block[10] + rest, BLOCK - rest, 0)
        if got <= 0:
            return DONE
        link.own = look(link, block)
        link.size += got
        link.bytes_in += got


@hot
def serve_requests(s: Any, board: Board, block: NDArray[np.int64]) -> int:
    """Carry out the requests in memory; converse with a client, if there is one.

    Returns
    -------
    int
        As `carry_out`.
    """
    memory = memory_at(block)
    if memory.link[0].fd >= 0:
        return converse(s, memory, board, block)
    return carry_out(s, memory, board)
