r"""Messages of the word bus: what a host sends, and what the board's replies say.

A message is one to 2 + 2 N words, N being the number of motors; a word is 64 or 32 bits, least
significant byte first, so that the header, the highest byte of the first word, is the last byte of
that word on the wire. The board replies to each word while the next one comes. A message in a CS
frame of its own gets all replies it needs: where a message is too short for that, a no-op follows.

Examples
--------
>>> codec = Codec()
>>> codec.status_read(0x01).hex(" ", 8)
'01000000000000f1 0000000000000000'
>>> hex(codec.value(bytes.fromhex("0000000000000000 0404202000000000")))
'0x20200404'
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from pulsewright.boards.rapcores.registers import (
    ENCODERS,
    HEADER_CONFIG_READ,
    HEADER_CONFIG_SWAP,
    HEADER_MOVE,
    HEADER_NOP,
    HEADER_STATUS_READ,
    HEADER_V020_BRAKE,
    HEADER_V020_BRIDGE,
    HEADER_V020_CHANNEL_INFO,
    HEADER_V020_CHARGE_PUMP,
    HEADER_V020_CHOPPER,
    HEADER_V020_DIVIDER,
    HEADER_V020_ENABLE,
    HEADER_V020_ENCODER,
    HEADER_V020_ENCODER_FAULT,
    HEADER_V020_MOTOR,
    HEADER_V020_MOTOR_FAULT,
    HEADER_V020_VERSION,
    MAX_ENCODERS,
    MAX_MOTORS,
    MAX_MOTORS_32,
    MOTORS,
    POSITION_BITS,
    VELOCITY_BITS,
    WORD_BITS,
)
from pulsewright.errors import BusError, RegisterValueError, UsageError

VALUE_BITS: Final = 32  # of a register and of a duration
ADDRESS_BITS: Final = 8
CHANNEL_LSB: Final = 48  # of the channel in words of profile `v020`
CHANNEL_BITS: Final = 8
CURRENT_LSB: Final = 12


@dataclass(frozen=True)
class Telemetry:
    """Encoders as the replies to a move tell them.

    Parameters
    ----------
    positions : tuple of int
        Of each encoder that a move tells, signed [count].
    velocities : tuple of int
        Clock cycles between the last two counts, less 1, negative if the last one was down [cycle].
        Empty in profile `v020`, whose moves tell positions only.
    """

    positions: tuple[int, ...]
    velocities: tuple[int, ...] = ()


class Codec:
    """Messages and replies of one build.

    Methods named as a message return the bytes of its frame. They raise `RegisterValueError` if a
    value does not fit, those that read a reply `BusError` if it has not the length that it must
    have.

    Parameters
    ----------
    motors : int
        1..32; 1..24 with words of 32 bits.
    encoders : int
        0..64.
    word_bits : int
        64 or 32.
    position_bits : int
        Of an encoder position in profile `v020`, 24 or 32.

    Attributes
    ----------
    fraction_bits, one_step : int
        Of an accumulator. In profile `v020`, a step is 2**64 instead.
    move_words : int
        Words of a move.

    Raises
    ------
    UsageError
        If a parameter is not allowed.
    """

    def __init__(
        self,
        *,
        motors: int = MOTORS,
        encoders: int = ENCODERS,
        word_bits: int = WORD_BITS,
        position_bits: int = POSITION_BITS,
    ) -> None:
        most = MAX_MOTORS_32 if word_bits == VALUE_BITS else MAX_MOTORS
        for name, value, allowed in (
            ("word_bits", word_bits, (WORD_BITS, VALUE_BITS)),
            ("motors", motors, range(1, most + 1)),
            ("encoders", encoders, range(MAX_ENCODERS + 1)),
            ("position_bits", position_bits, (24, POSITION_BITS)),
        ):
            if value not in allowed:
                raise UsageError(
                    f"rapcores: {name} = {value}; allowed are {_range(allowed)}"
                    + (f" with words of {word_bits} bits" if name == "motors" else "")
                )
        self.motors, self.encoders = motors, encoders
        self.word_bits, self.position_bits = word_bits, position_bits
        self.word_bytes = word_bits // 8
        self.fraction_bits = word_bits - 1
        self.one_step = 1 << self.fraction_bits  # [accumulator unit]
        self.move_words = 2 + 2 * motors
        self._dtype = np.dtype(f"<u{self.word_bytes}")

    # ------------------------------------------------------------------------------- words

    def to_bytes(self, words: Sequence[int]) -> bytes:
        """Return words as they go over the wire."""
        return b"".join(word.to_bytes(self.word_bytes, "little") for word in words)

    def to_words(self, data: bytes) -> list[int]:
        """Return the words of a frame, unsigned.

        Raises
        ------
        BusError
            If it does not end with a whole word.
        """
        if len(data) % self.word_bytes:
            raise BusError(
                f"rapcores: {len(data)} bytes are no words of {self.word_bytes}; read whole frames"
            )
        size = self.word_bytes
        return [int.from_bytes(data[at : at + size], "little") for at in range(0, len(data), size)]

    def signed(self, word: int) -> int:
        """Return the number that a word is in two's complement."""
        return word - (word >> self.word_bits - 1 << self.word_bits)

    def _header(self, code: int, low: int = 0) -> int:
        return code << self.word_bits - 8 | low

    # ------------------------------------------------------------------------------- messages

    def nop(self) -> bytes:
        """Do nothing."""
        return self.to_bytes([self._header(HEADER_NOP)])

    def status_read(self, address: int) -> bytes:
        """Read the register of the read side at an address; the reply is for `value`."""
        return self.to_bytes([self._header(HEADER_STATUS_READ, _address(address)), 0])

    def config_swap(self, address: int, value: SupportsIndex) -> bytes:
        """Write a register of the write side, 32 bits; the reply with its old `value`."""
        raw = _unsigned(f"configuration {address:#04x}", value, VALUE_BITS)
        return self.to_bytes([self._header(HEADER_CONFIG_SWAP, _address(address)), raw])

    def config_read(self, address: int) -> bytes:
        """Read a register of the write side; the reply is for `value`. Not in `upstream`."""
        return self.to_bytes([self._header(HEADER_CONFIG_READ, _address(address)), 0])

    def move(
        self,
        duration: SupportsIndex,
        increments: Sequence[SupportsIndex],
        increment_increments: Sequence[SupportsIndex] | None = None,
        direction_bits: SupportsIndex = 0,
    ) -> bytes:
        """Move all motors for a time; the reply is for `telemetry`.

        Parameters
        ----------
        duration : int
            0..2**32 - 1 [tick].
        increments : sequence of int
            Added to the accumulator of each motor at every tick, signed words
            [2**-fraction_bits step/tick].
        increment_increments : sequence of int, optional
            Added to the increment of each motor after every tick, as ``increments``; 0 if left out.
        direction_bits : int
            One bit per motor; without effect in profile `document`.
        """
        changes = [0] * self.motors if increment_increments is None else increment_increments
        words = [
            self._header(HEADER_MOVE, _unsigned("direction bits", direction_bits, self.motors)),
            _unsigned("duration", duration, VALUE_BITS, "tick"),
        ]
        for name, values in (("increments", increments), ("increment-increments", changes)):
            if len(values) != self.motors:
                raise RegisterValueError(
                    f"rapcores: {len(values)} {name} for {self.motors} motors; give one for each"
                )
        for motor, (increment, change) in enumerate(zip(increments, changes, strict=True)):
            words.append(self._signed_word(f"increment of motor {motor}", increment))
            words.append(self._signed_word(f"increment-increment of motor {motor}", change))
        return self.to_bytes(words)

    def moves(
        self,
        durations: NDArray[Any],
        increments: NDArray[Any],
        increment_increments: NDArray[Any],
        direction_bits: NDArray[Any] | None = None,
    ) -> list[bytes]:
        """Return the frames of many moves, given as columns of integers.

        Parameters
        ----------
        durations : array of int, shape (n,)
            [tick].
        increments, increment_increments : array of int, shape (n, motors)
            As in `move`.
        direction_bits : array of int, shape (n,), optional
            0 if left out.
        """
        count = len(durations)
        columns = [
            ("duration", durations, (count,), 0, (1 << VALUE_BITS) - 1),
            *(
                (name, column, (count, self.motors), -(1 << self.fraction_bits), self.one_step - 1)
                for name, column in (
                    ("increment", increments),
                    ("increment-increment", increment_increments),
                )
            ),
        ]
        if direction_bits is not None:
            columns.append(("direction bits", direction_bits, (count,), 0, (1 << self.motors) - 1))
        for name, column, shape, low, high in columns:
            if column.shape != shape or column.dtype.kind not in "iu":
                raise RegisterValueError(
                    f"rapcores: {name} is {column.dtype} of shape {column.shape}; moves need "
                    f"integers of shape {shape}"
                )
            if count and not low <= int(column.min()) <= int(column.max()) <= high:
                raise RegisterValueError(
                    f"rapcores: {name} between {column.min()} and {column.max()}; allowed are "
                    f"{low}..{high}"
                )
        words = np.zeros((count, self.move_words), self._dtype)
        words[:, 0] = self._header(HEADER_MOVE)
        if direction_bits is not None:
            words[:, 0] |= direction_bits.astype(self._dtype)
        words[:, 1] = durations
        words[:, 2::2] = increments.astype(self._dtype)
        words[:, 3::2] = increment_increments.astype(self._dtype)
        return [row.tobytes() for row in words]

    # ------------------------------------------------------------------------------- replies

    def value(self, reply: bytes) -> int:
        """Return what a message of two words has read, an unsigned word."""
        return self._words(reply, 2)[1]

    def telemetry(self, reply: bytes) -> Telemetry:
        """Return what the replies to a move tell: as many encoders as motors at most."""
        words = [self.signed(word) for word in self._words(reply, self.move_words)]
        told = min(self.motors, self.encoders)
        return Telemetry(tuple(words[2::2][:told]), tuple(words[3::2][:told]))

    # ------------------------------------------------------------------------------- profile v020

    def encoder(self, channel: int) -> bytes:
        """Read position and velocity of an encoder in `v020`; the reply is for `encoder_state`."""
        if not 0 <= channel < max(self.encoders, 1):
            raise RegisterValueError(
                f"rapcores: encoder {channel}; allowed are 0..{self.encoders - 1}"
            )
        return self.to_bytes([self._header(HEADER_V020_ENCODER, self._channel(channel)), 0])

    def encoder_state(self, reply: bytes) -> tuple[int, int]:
        """Return position [count] and velocity [cycle] of an encoder, signed."""
        word = self.value(reply)
        return (
            _sign(word, self.position_bits),
            _sign(word >> self.position_bits, VELOCITY_BITS),
        )

    def enable(self, mask: SupportsIndex) -> bytes:
        """Write the motor enable mask in `v020`."""
        return self._setting(HEADER_V020_ENABLE, "enable mask", mask, self.motors)

    def brake(self, mask: SupportsIndex) -> bytes:
        """Write the brake-on-disable mask in `v020`."""
        return self._setting(HEADER_V020_BRAKE, "brake mask", mask, self.motors)

    def divider(self, divider: SupportsIndex) -> bytes:
        """Write the DDA clock divider in `v020`, 8 bits."""
        return self._setting(HEADER_V020_DIVIDER, "divider", divider, 8)

    def motor(self, channel: int, current: SupportsIndex, microsteps: SupportsIndex) -> bytes:
        """Write current (4 bits) and microsteps (3 bits) of a motor in `v020`."""
        if not 0 <= channel < self.motors:
            raise RegisterValueError(f"rapcores: motor {channel}; allowed are 0..{self.motors - 1}")
        low = _unsigned("current", current, 4) << CURRENT_LSB
        low |= _unsigned("microsteps", microsteps, 3)
        return self.to_bytes([self._header(HEADER_V020_MOTOR, self._channel(channel) | low)])

    def chopper(self, value: SupportsIndex) -> bytes:
        """Write the chopper setting in `v020`, 8 bits."""
        return self._setting(HEADER_V020_CHOPPER, "chopper", value, 8)

    def charge_pump(self, period: SupportsIndex) -> bytes:
        """Write the period of the charge pump in `v020`, 8 bits."""
        return self._setting(HEADER_V020_CHARGE_PUMP, "charge pump period", period, 8)

    def bridge(self, inversion: SupportsIndex) -> bytes:
        """Write the inversion of the bridges in `v020`, 2 bits."""
        return self._setting(HEADER_V020_BRIDGE, "bridge inversion", inversion, 2)

    def motor_fault(self) -> bytes:
        """Read the motor fault mask in `v020`; the reply is for `value`."""
        return self.to_bytes([self._header(HEADER_V020_MOTOR_FAULT), 0])

    def encoder_fault(self) -> bytes:
        """Read the encoder fault mask in `v020`; the reply is for `value`."""
        return self.to_bytes([self._header(HEADER_V020_ENCODER_FAULT), 0])

    def channel_info(self) -> bytes:
        """Read the channel info in `v020`, with a no-op behind it; the reply is for `value`."""
        return self.to_bytes([self._header(HEADER_V020_CHANNEL_INFO), self._header(HEADER_NOP)])

    def version(self) -> bytes:
        """Read the version in `v020`; the reply is for `value`."""
        return self.to_bytes([self._header(HEADER_V020_VERSION), 0])

    def telemetry_v020(self, reply: bytes) -> Telemetry:
        """Return the encoder positions that the replies to a move tell in `v020`."""
        words = self._words(reply, self.move_words)
        told = min(self.motors, self.encoders)
        return Telemetry(tuple(_sign(word, self.position_bits) for word in words[3::2][:told]))

    # ------------------------------------------------------------------------------- parts

    def _setting(self, header: int, name: str, value: SupportsIndex, bits: int) -> bytes:
        return self.to_bytes([self._header(header, _unsigned(name, value, bits))])

    def _channel(self, channel: int) -> int:
        if self.word_bits <= CHANNEL_LSB:
            raise RegisterValueError(
                f"rapcores: a word of {self.word_bits} bits cannot name a channel; profile v020 "
                f"has words of 64 bits"
            )
        return channel << CHANNEL_LSB

    def _signed_word(self, name: str, value: SupportsIndex) -> int:
        raw, limit = _integer(name, value), 1 << self.word_bits - 1
        if not -limit <= raw < limit:
            raise RegisterValueError(
                f"rapcores: {name} is {raw}; allowed are {-limit}..{limit - 1}"
            )
        return raw % (2 * limit)

    def _words(self, reply: bytes, count: int) -> list[int]:
        words = self.to_words(reply)
        if len(words) != count:
            raise BusError(f"rapcores: a reply of {len(words)} words, expected {count}")
        return words


def _range(allowed: Sequence[int]) -> str:
    if isinstance(allowed, range):
        return f"{allowed[0]}..{allowed[-1]}"
    return " and ".join(map(str, allowed))


def _sign(word: int, bits: int) -> int:
    """Return the number that the low bits of a word are in two's complement."""
    word &= (1 << bits) - 1
    return word - (word >> bits - 1 << bits)


def _integer(name: str, value: SupportsIndex) -> int:
    try:
        return operator.index(value)
    except TypeError:
        raise RegisterValueError(f"rapcores: {name} is {value!r}, which is no integer") from None


def _unsigned(name: str, value: SupportsIndex, bits: int, unit: str = "") -> int:
    raw = _integer(name, value)
    if not 0 <= raw < 1 << bits:
        raise RegisterValueError(
            f"rapcores: {name} is {raw}; allowed are 0..{(1 << bits) - 1}"
            + (f" [{unit}]" if unit else "")
        )
    return raw


def _address(address: SupportsIndex) -> int:
    return _unsigned("address", address, ADDRESS_BITS)
