r"""Packets of the serial protocol: requests of a host, replies and reports of the board.

A packet is a header byte, a length N, N bytes of payload and their CRC. The payload is a tag of two
bytes, a command or reply code, and arguments as the register map lays them out. A reply repeats the
tag of its request; reports of interrupts have a tag of their own.

Examples
--------
>>> write_output(tag=2, register=0, value=0xA5).hex(" ")
'd5 08 02 00 3c 00 a5 00 00 00 3e'
>>> decoder = Decoder()
>>> [payload] = decoder.feed(bytes.fromhex("d5 07 03 00 81 78 56 34 12 68"))
>>> Reply.parse(payload).values("INPUT")
{'value': 305419896}
"""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, SupportsIndex

from pulsewright.boards.s3g.registers import (
    CRC_POLYNOMIAL,
    HEADER,
    MAP,
    PROG_WORD_BYTES,
    REPLY_INTERRUPT,
    REPLY_OK,
    REPORT_TAG,
)
from pulsewright.errors import BusError, RegisterValueError
from pulsewright.registers.model import Argument

COMMANDS: Final = MAP.table("CMD")
REPLIES: Final = MAP.table("REPLY")
INTERRUPTS: Final = MAP.table("INT")

SHORTEST: Final = 3  # payload: tag and code [byte]
LONGEST: Final = 255  # payload that a length byte can tell [byte]
LONGEST_REPLY: Final = SHORTEST + max(
    sum(argument.size for argument in layout)
    for layout in [*(code.reply for code in COMMANDS.codes), *(c.arguments for c in REPLIES.codes)]
)
REGISTERS: Final = 1 << MAP.address_bits
_WRITE_BUFFER_HEAD: Final = SHORTEST + sum(
    argument.size for argument in COMMANDS["WRITE_BUFFER"].arguments if not argument.repeat
)
MAX_WORDS: Final = (LONGEST - _WRITE_BUFFER_HEAD) // PROG_WORD_BYTES  # of one WRITE_BUFFER: 49


def _crc_table() -> bytes:
    table = bytearray(256)
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = crc >> 1 ^ (CRC_POLYNOMIAL if crc & 1 else 0)
        table[byte] = crc
    return bytes(table)


_CRC: Final = _crc_table()


def crc8(data: bytes) -> int:
    """Return the CRC of a payload, 0..255."""
    crc = 0
    for byte in data:
        crc = _CRC[crc ^ byte]
    return crc


def frame(payload: bytes) -> bytes:
    """Return the packet that carries a payload.

    Raises
    ------
    RegisterValueError
        If the payload is not 3 to 255 bytes long.
    """
    if not SHORTEST <= len(payload) <= LONGEST:
        raise RegisterValueError(
            f"s3g: a payload of {len(payload)} bytes; {SHORTEST}..{LONGEST} fit in a packet"
        )
    return bytes((HEADER, len(payload), *payload, crc8(payload)))


class Decoder:
    """Take packets out of a stream of bytes, whatever else is in it.

    What looks like a packet but has a wrong CRC may be a damaged one or begin with a header byte
    that is none: the search goes on at the byte after its header, so that no good packet is lost
    behind it. One in 256 such places has a right CRC by chance; the tag of a reply tells.

    Parameters
    ----------
    longest : int
        Longest payload to believe in [byte]; without it, the longest that the board sends.

    Attributes
    ----------
    skipped : int
        Bytes so far that belonged to no good packet.
    """

    def __init__(self, longest: int = LONGEST_REPLY) -> None:
        self.skipped = 0
        self._longest = longest
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """Take in the next bytes of the stream; return the payloads that are complete with them."""
        self._buffer += data
        return self._search(more=True)

    def flush(self) -> list[bytes]:
        """Give up the packet that is not complete; return the payloads found in what is left.

        For a host that has waited long enough: a false header byte may be waiting for bytes that
        will not come, in front of a packet that is there.
        """
        return self._search(more=False)

    def _search(self, *, more: bool) -> list[bytes]:
        buffer, found, at = self._buffer, [], 0
        while (header := buffer.find(HEADER, at)) >= 0:
            self.skipped += header - at
            at = header
            length = buffer[at + 1] if at + 1 < len(buffer) else SHORTEST
            if SHORTEST <= length <= self._longest:
                end = at + 2 + length
                payload = bytes(buffer[at + 2 : end])
                if end < len(buffer):
                    if crc8(payload) == buffer[end]:
                        found.append(payload)
                        at = end + 1
                        continue
                elif more:
                    del buffer[:at]
                    return found
            self.skipped += 1
            at += 1
        self.skipped += len(buffer) - at
        buffer.clear()
        return found


@dataclass(frozen=True)
class Reply:
    """What the board says: a reply, or a report that nobody asked for.

    Parameters
    ----------
    tag : int
        Of the request, 0..0xFFFF.
    code : int
        One of the ``REPLY_`` constants of the register map.
    data : bytes
        What follows.
    """

    tag: int
    code: int
    data: bytes = b""

    @classmethod
    def parse(cls, payload: bytes) -> Reply:
        """Read a reply from the payload of a packet.

        Raises
        ------
        BusError
            If it is too short for a tag and a code.
        """
        if len(payload) < SHORTEST:
            raise BusError(
                f"s3g: a reply of {len(payload)} bytes ({payload.hex(' ')}); one has at least "
                f"{SHORTEST}: tag and code"
            )
        return cls(int.from_bytes(payload[:2], "little"), payload[2], bytes(payload[3:]))

    @property
    def is_report(self) -> bool:
        """Whether it reports interrupts and answers no request."""
        return self.tag == REPORT_TAG and self.code == REPLY_INTERRUPT

    @property
    def pending(self) -> int:
        """Mask of the interrupts that a report says are pending; masked ones are in it.

        Raises
        ------
        BusError
            If this is no report.
        """
        if not self.is_report:
            raise BusError(f"s3g: {self.text} is no report of interrupts")
        return self._read(REPLIES["INTERRUPT"].arguments, "report of interrupts")["pending"]

    @property
    def text(self) -> str:
        """The reply in words."""
        code = REPLIES.at(self.code)
        name = f"REPLY_{code.name}" if code else f"code {self.code:#04x}"
        return " ".join(filter(None, [f"{name} with tag {self.tag}", self.data.hex(" ")]))

    def values(self, command: str) -> dict[str, int]:
        """Return the arguments of a reply that says a command is done.

        Parameters
        ----------
        command : str
            What was asked: ``INPUT``.

        Raises
        ------
        BusError
            If the board says something else, or what it says has the wrong length.
        UsageError
            If there is no such command.
        """
        layout = COMMANDS[command].reply
        if self.code != REPLY_OK:
            meaning = REPLIES.at(self.code)
            why = f". {meaning.desc}" if meaning else "; the board has no such reply"
            raise BusError(f"s3g: {command} was answered with {self.text}{why}")
        return self._read(layout, f"reply to {command}")

    def _read(self, layout: Sequence[Argument], what: str) -> dict[str, int]:
        if len(self.data) != sum(argument.size for argument in layout):
            wanted = ", ".join(argument.text for argument in layout) or "nothing"
            raise BusError(
                f"s3g: {what} with {len(self.data)} bytes of arguments ({self.text}); "
                f"it should be {wanted}"
            )
        values, at = {}, 0
        for argument in layout:
            end = at + argument.size
            values[argument.name] = int.from_bytes(self.data[at:end], "little")
            at = end
        return values


def interrupt_names(mask: int) -> list[str]:
    """Return the names of the interrupts in a mask, the lowest first: ``['ASG_DONE', 'bit 5']``."""
    codes = [(bit, INTERRUPTS.at(bit)) for bit in range(mask.bit_length()) if mask >> bit & 1]
    return [code.name if code else f"bit {bit}" for bit, code in codes]


# ---- requests


def request(
    command: str, tag: int, values: Mapping[str, SupportsIndex | Sequence[SupportsIndex]]
) -> bytes:
    """Return the packet of a request.

    Parameters
    ----------
    command : str
        Name of a command in the register map: ``OUTPUT``.
    tag : int
        Comes back in the reply, 0..0xFFFE; 0xFFFF is for reports.
    values : mapping
        The arguments by name. A number may be negative: it is sent in two's complement.

    Raises
    ------
    RegisterValueError
        If the tag or an argument does not fit, or all of them do not fit in a packet.
    UsageError
        If there is no such command.
    """
    code = COMMANDS[command]
    if not 0 <= tag < REPORT_TAG:
        raise RegisterValueError(f"s3g {command}: tag {tag}; allowed are 0..{REPORT_TAG - 1}")
    payload = bytearray(tag.to_bytes(2, "little"))
    payload.append(code.value)
    for argument in code.arguments:
        value = values[argument.name]
        for item in value if isinstance(value, Sequence) else [value]:
            payload += _number(command, argument, item)
    return frame(bytes(payload))


def _number(command: str, argument: Argument, value: SupportsIndex) -> bytes:
    bits = 8 * argument.size
    lowest, highest = -(1 << bits - 1), (1 << bits) - 1
    try:
        number = operator.index(value)
    except TypeError:
        number = highest + 1
    if not lowest <= number <= highest:
        raise RegisterValueError(
            f"s3g {command}: {argument.name} {value!r}; allowed are integers {lowest}..{highest}"
        )
    return (number & highest).to_bytes(argument.size, "little")


def version(tag: int) -> bytes:
    """Return the request that asks for the version; the reply should be ``VERSION``."""
    return request("VERSION", tag, {})


def extended_version(tag: int) -> bytes:
    """Return the request that asks for the extended version."""
    return request("EXT_VER", tag, {})


def write_output(tag: int, register: int, value: SupportsIndex) -> bytes:
    """Return the request that writes output register 0..63; the value may be signed or unsigned.

    Raises
    ------
    RegisterValueError
        If there is no such register, or the value does not fit in 32 bits.
    """
    return request("OUTPUT", tag, {"register": _checked(register, "output"), "value": value})


def read_input(tag: int, register: int) -> bytes:
    """Return the request that reads input register 0..63.

    Raises
    ------
    RegisterValueError
        If there is no such register.
    """
    return request("INPUT", tag, {"register": _checked(register, "input")})


def strobe(tag: int, mask: int) -> bytes:
    """Return the request that gives the strobes in ``mask``."""
    return request("STB", tag, {"mask": mask})


def clear_interrupts(tag: int, mask: int) -> bytes:
    """Return the request that clears the pending interrupts in ``mask``."""
    return request("CLEAR", tag, {"mask": mask})


def mask_interrupts(tag: int, mask: int) -> bytes:
    """Return the request that lets the board report the interrupts in ``mask``, and no others."""
    return request("MASK", tag, {"mask": mask})


def write_buffer(tag: int, address: int, words: Sequence[int]) -> bytes:
    """Return the request that writes words of 40 bits to program memory.

    Parameters
    ----------
    tag : int
        Comes back in the reply.
    address : int
        Of the first word, 0..0xFFFF; memory wraps.
    words : sequence of int
        1 to 49 of them.

    Raises
    ------
    RegisterValueError
        If a number does not fit, or there are no or too many words.
    """
    if not 1 <= len(words) <= MAX_WORDS:
        raise RegisterValueError(
            f"s3g WRITE_BUFFER: {len(words)} words; a packet takes 1..{MAX_WORDS}, send longer "
            f"programs in pieces"
        )
    if not 0 <= address <= 0xFFFF or any(word < 0 for word in words):
        raise RegisterValueError(f"s3g WRITE_BUFFER: address {address} and words must be from 0 on")
    return request(
        "WRITE_BUFFER", tag, {"count": len(words), "address": address, "words": tuple(words)}
    )


def _checked(register: int, kind: str) -> int:
    if not 0 <= register < REGISTERS:
        raise RegisterValueError(f"s3g: {kind} register {register}; allowed are 0..{REGISTERS - 1}")
    return register
