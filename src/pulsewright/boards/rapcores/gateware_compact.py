"""The board of profile ``document`` with one adder for the DDAs of all motors."""

from __future__ import annotations

from amaranth import Module, Mux, Signal
from amaranth.lib.memory import Memory

from pulsewright.boards.rapcores.gateware_document import DocumentCore
from pulsewright.boards.rapcores.gateware_shared import SharedDda


class CompactCore(DocumentCore):
    """As `DocumentCore`, with the same parameters and members."""

    def _motion(self, m: Module) -> None:
        """Add the DDA of all motors, and their step positions."""
        spi, sequencer, number = self._spi, self._sequencer, self._number
        m.submodules.dda = dda = SharedDda(
            motors=self._motors, depth=self._depth, word_bits=self._word_bits
        )
        # Words that the first tick of a move depends on.
        arrived = spi.strobe & self._moving & ~(number[0] & number[1:].any())
        first = Signal(init=1)
        with m.If(sequencer.integrate):
            m.d.sync += first.eq(0)
        with m.If(sequencer.finish | self._halted):
            m.d.sync += first.eq(1)
        m.d.comb += [
            dda.clear.eq(self.clear),
            dda.clear_address.eq(self.clear_address),
            dda.write.eq(spi.byte_strobe & self._moving),
            dda.write_slot.eq(sequencer.write_slot),
            dda.number.eq(number),
            dda.index.eq(spi.byte),
            dda.byte.eq(spi.received),
            dda.slot.eq(sequencer.slot),
            dda.first.eq(first),
            dda.integrate.eq(sequencer.integrate),
            dda.restart.eq(sequencer.finish | self._halted | (~sequencer.run & arrived)),
            self._ready.eq(dda.ready),
            self._left.eq(dda.left),
            sequencer.last.eq(dda.last),
        ]
        # Whether a move has no ticks has to be known as it starts.
        m.submodules.empty = memory = Memory(shape=1, depth=self._depth, init=[])
        written, read = memory.write_port(), memory.read_port(domain="comb")
        m.d.comb += [
            written.addr.eq(sequencer.write_slot),
            written.data.eq(spi.word[:32] == 0),
            written.en.eq(spi.strobe & self._moving & (number == 1)),
            read.addr.eq(sequencer.slot),
            sequencer.empty.eq(read.data),
        ]
        self._positions(m, dda)

    def _positions(self, m: Module, dda: SharedDda) -> None:
        """Add step positions, and tell pulse formers of their changes."""
        self._position = [Signal(32, name=f"position{n}") for n in range(self._motors)]
        for n, former in enumerate(self._formers):
            position = self._position[n]
            m.d.sync += [
                former.moved.eq(self._sequencer.integrate & dda.moved[n]),
                former.down.eq(dda.down[n]),
            ]
            m.d.comb += [
                former.blocked.eq(self._halted),
                former.forget.eq(self._halted),
                self._pending[n].eq(former.owed != 0),
            ]
            with m.If(self._halted):
                m.d.sync += position.eq(position - former.excess.as_signed())
            with m.Elif(self._sequencer.integrate & dda.moved[n]):
                m.d.sync += position.eq(position + Mux(dda.down[n], -1, 1))
