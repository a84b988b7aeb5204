"""The bus of the twin at its pins, clock by clock while anything is in its flops.

Registers are those of the specification: ``bit`` the transmit bit number, ``byte`` the bits
received, ``count`` the bytes, ``word`` the bytes before. A message acts in the cycle in which the
word flag rises.
"""

from __future__ import annotations

from typing import Any, Final

from pulsewright.boards.rapcores.twin_state import CIPO, DOCUMENT, State
from pulsewright.twin.clock import NEVER
from pulsewright.twin.kernel import hot, inlined, kernel
from pulsewright.twin.recorder import drive

BITS: Final = 8
LAST_BIT: Final = BITS - 1
FRAME_END: Final = 2  # cycles from the first one with CS high behind its flops
FLAG: Final = 4  # cycles from the fall after the last bit to the message action


@inlined
def settled(spi: Any) -> bool:
    """Tell whether clock edges change nothing as long as the pins stay."""
    return bool(
        spi.sck == spi.sck0
        and spi.sck == spi.sck1
        and spi.sck == spi.sck2
        and spi.cs == spi.cs0
        and spi.cs == spi.cs1
        and spi.cs == spi.cs2
        and spi.copi == spi.copi0
        and spi.copi == spi.copi1
        and spi.byte_flag == spi.byte_before
        and (spi.cs == 0 or spi.bit == LAST_BIT)
    )


@kernel
def reset(spi: Any) -> None:
    """Bring all but the flops of SCK to reset values."""
    spi.cs0 = spi.cs1 = spi.cs2 = 1
    spi.copi0 = spi.copi1 = 0
    spi.bit = LAST_BIT
    spi.byte = spi.byte_flag = spi.byte_before = spi.count = spi.word = spi.word_flag = 0
    spi.partial = 0


@hot
def clock(s: State, cycle: int) -> None:
    """Do the edge at the end of ``cycle``."""
    board, spi = s.world[0].board, s.world[0].spi
    if not board.in_reset:
        rise = spi.sck1 == 1 and spi.sck2 == 0
        fall = spi.sck1 == 0 and spi.sck2 == 1
        active = spi.cs1 == 0
        if not active and spi.cs2 == 0 and board.profile == DOCUMENT:
            board.frame_at = cycle + FRAME_END
            spi.partial = 1 if spi.bit != LAST_BIT else 0
        if spi.byte_flag and not spi.byte_before:
            last = spi.count == board.word_bytes - 1
            spi.count = 0 if last else spi.count + 1
            kept = spi.word >> BITS & ((1 << (board.word_bits - BITS)) - 1)
            spi.word = kept | spi.byte << (board.word_bits - BITS)
            if last and not spi.word_flag:
                board.word_at = cycle + 1
                board.word_value = spi.word
            spi.word_flag = 1 if last else 0
        spi.byte_before = spi.byte_flag
        if active and fall:
            spi.byte_flag = 1 if spi.bit == 0 else 0
        if active and rise:
            spi.byte = (spi.byte << 1 | spi.copi1) & 0xFF
        if not active:
            spi.bit = LAST_BIT
        elif fall:
            spi.bit = (spi.bit - 1) % BITS
        spi.cs2, spi.cs1, spi.cs0 = spi.cs1, spi.cs0, spi.cs
        spi.copi1, spi.copi0 = spi.copi0, spi.copi
    spi.sck2, spi.sck1, spi.sck0 = spi.sck1, spi.sck0, spi.sck
    board.spi_at = cycle + 1
    if settled(spi) or (board.in_reset and spi.sck == spi.sck0 == spi.sck1 == spi.sck2):
        board.spi_at = NEVER


@kernel
def show(s: State, cycle: int) -> None:
    """Bring CIPO to its level at edge ``cycle``; 0 while CS is high."""
    board, spi = s.world[0].board, s.world[0].spi
    level = board.reply >> (BITS * spi.count + spi.bit) & 1 if spi.cs1 == 0 else 0
    if level != spi.shown:
        spi.shown = level
        if board.bus_pins:
            drive(s.rows, CIPO, level, cycle)


@inlined
def quiet(board: Any, spi: Any) -> bool:
    """Tell whether the bus is between frames and words, with nothing in its flops."""
    return bool(board.spi_at == NEVER and spi.cs == 1 and spi.sck == 0 and spi.count == 0)


@inlined
def after_word(board: Any, spi: Any, word: int) -> None:
    """Leave the registers as they are when a word has come and CS has risen after it."""
    spi.word = word
    spi.byte = word >> (board.word_bits - BITS) & 0xFF
    spi.copi = spi.copi0 = spi.copi1 = spi.byte & 1
    spi.byte_flag = spi.byte_before = spi.word_flag = 1
