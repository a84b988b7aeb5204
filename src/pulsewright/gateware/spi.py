"""SPI with words: mode 0, bytes with their highest bit first, the lowest byte of a word first.

All pins are sampled by the clock. Times are given from f, the first cycle with SCK low after the
last bit of a word.
"""

from __future__ import annotations

from amaranth import Cat, Module, Mux, Signal
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import Component, In, Out


class SpiWordPort(Component):
    """Bits in, words out, and back.

    A byte is complete at the fall of SCK after its last bit, if CS is low then.

    Parameters
    ----------
    word_bits : int
        A multiple of 8, at least 16.
    drop_partial : bool
        CS high drops the bytes of an incomplete word. Otherwise the next frame goes on with them.

    Members
    -------
    cs, sck, copi : In(1)
        Pins, asynchronous; CS is active low. SCK is sampled in reset, too, the others are 1 and 0
        then.
    cipo : Out(1), cipo_oe : Out(1)
        0 while CS is high, in cycles that are late by 2.
    word : Out(word_bits)
        With ``strobe``.
    strobe : Out(1)
        A word is complete: cycle f + 4.
    soon : Out(1)
        ``strobe`` comes in two cycles.
    byte_strobe : Out(1), received : Out(8)
        ``received`` is byte ``byte`` of a word; for the last one a cycle before ``strobe``.
    byte : Out(range(word_bits // 8))
        Also, the byte of the reply to show now.
    bit : Out(3)
        The bit of that byte to show now, from 7 down to 0.
    reply : In(8)
        That byte; it is 0 in the next word unless something else is put there by f + 5.
    ended : Out(1)
        A frame has ended: cycle h + 4 if h is the first cycle with CS high. Never with ``strobe``.
    partial : Out(1)
        With ``ended``: it had bits behind its last whole word.
    """

    def __init__(self, *, word_bits: int, drop_partial: bool) -> None:
        if word_bits < 16 or word_bits % 8:
            raise ValueError(f"word_bits must be a multiple of 8, at least 16, not {word_bits}")
        self._bytes, self._drop_partial = word_bits // 8, drop_partial
        super().__init__(
            {
                "cs": In(1),
                "sck": In(1),
                "copi": In(1),
                "cipo": Out(1),
                "cipo_oe": Out(1),
                "word": Out(word_bits),
                "strobe": Out(1),
                "soon": Out(1),
                "byte_strobe": Out(1),
                "received": Out(8),
                "byte": Out(range(self._bytes)),
                "bit": Out(3, init=7),
                "reply": In(8),
                "ended": Out(1),
                "partial": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        sck, before = Signal(), Signal(reset_less=True)
        cs, copi = Signal(), Signal()
        m.submodules.sck = FFSynchronizer(self.sck, sck, reset_less=True)
        m.submodules.cs = FFSynchronizer(self.cs, cs, init=1, reset_less=False)
        m.submodules.copi = FFSynchronizer(self.copi, copi, reset_less=False)
        rise, fall = Signal(), Signal()
        m.d.sync += before.eq(sck)
        m.d.comb += [rise.eq(~cs & sck & ~before), fall.eq(~cs & ~sck & before)]

        bit = self.bit
        whole, whole_before = Signal(), Signal()  # the last fall ended a byte
        with m.If(cs):
            m.d.sync += bit.eq(7)
        with m.Elif(fall):
            m.d.sync += [bit.eq(bit - 1), whole.eq(bit == 0)]
        with m.If(rise):
            m.d.sync += self.received.eq(Cat(copi, self.received))
        m.d.sync += [
            whole_before.eq(whole),
            self.strobe.eq(self.byte_strobe & (self.byte == self._bytes - 1)),
        ]
        m.d.comb += [
            self.soon.eq(fall & (bit == 0) & (self.byte == self._bytes - 1)),
            self.byte_strobe.eq(whole & ~whole_before),
        ]
        with m.If(self.byte_strobe):
            m.d.sync += [
                self.byte.eq(Mux(self.byte == self._bytes - 1, 0, self.byte + 1)),
                self.word.eq(Cat(self.word[8:], self.received)),
            ]
        m.d.comb += [
            self.cipo.eq(~cs & self.reply.bit_select(bit, 1)),
            self.cipo_oe.eq(~cs),
        ]

        cs_before, ended, part = Signal(init=1), Signal(2), Signal(2)
        m.d.sync += [
            cs_before.eq(cs),
            ended.eq(Cat(cs & ~cs_before, ended)),
            part.eq(Cat(bit != 7, part)),
        ]
        m.d.comb += [
            self.ended.eq(ended[1]),
            self.partial.eq(part[1] | (self.byte != 0)),
        ]
        if self._drop_partial:
            with m.If(self.ended):
                m.d.sync += self.byte.eq(0)
        return m
