"""Serial ports: 8 data bits, no parity, 1 stop bit, lowest bit first.

All time is in enables, 16 to a bit, which one `BaudGenerator` makes for a receiver and a
transmitter.
"""

from __future__ import annotations

from math import gcd

from amaranth import Cat, Const, Module, Mux, Signal
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import Component, In, Out


class BaudGenerator(Component):
    """Enables at 16 times a bit rate, exact on average.

    An accumulator from 0 grows by ``step`` every clock; where it has reached ``limit``, it is
    reduced by that and the next cycle is an enable.

    Parameters
    ----------
    step, limit : int
        There are ``step / limit`` enables per clock; 1 <= ``step`` <= ``limit``.

    Members
    -------
    enable : Out(1)
        Registered.

    Raises
    ------
    ValueError
        If ``step`` is not in its range.
    """

    def __init__(self, *, step: int, limit: int) -> None:
        if not 1 <= step <= limit:
            raise ValueError(f"step must be 1 to {limit}, not {step}")
        common = gcd(step, limit)
        self._step, self._limit = step // common, limit // common
        super().__init__({"enable": Out(1)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        # The sum less the limit, so that its sign says where the limit is reached.
        bits = self._limit.bit_length() + 1
        below = Signal(bits, init=-self._limit % (1 << bits))
        add = Mux(below[-1], Const(self._step, bits), Const(self._step - self._limit, bits))
        m.d.sync += [below.eq(below + add), self.enable.eq(~below[-1])]
        return m


class UartReceiver(Component):
    """Serial line in, bytes out.

    Each bit is sampled once: the start bit 10 enables after the one that found the line low, data
    and stop bit every 16 enables from there. A start bit that is high then was none; a byte with a
    stop bit that is low is dropped. After its stop bit the receiver looks for the next start bit.

    Members
    -------
    enable : In(1)
        From a `BaudGenerator`.
    line : In(1)
        Pin, asynchronous; idle high.
    valid : Out(1)
        High in the cycle after the sample of a good stop bit.
    data : Out(8)
        The byte: while ``valid``, and until the next start bit.
    """

    def __init__(self) -> None:
        super().__init__({"enable": In(1), "line": In(1), "valid": Out(1), "data": Out(8)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        line = Signal(init=1)
        m.submodules.synchroniser = FFSynchronizer(self.line, line, init=1, reset_less=False)
        busy, started = Signal(), Signal()
        count = Signal(4)
        # The start bit comes down through the ones, and says when all data bits are in.
        bits = Signal(9)
        m.d.comb += self.data.eq(bits[1:])
        m.d.sync += self.valid.eq(0)
        with m.If(self.enable):
            with m.If(~busy), m.If(~line):
                m.d.sync += [busy.eq(1), started.eq(0), count.eq(7), bits.eq(~0)]
            with m.Else():
                m.d.sync += count.eq(count + 1)
                with m.If(count == 0):
                    m.d.sync += started.eq(1)
                    with m.If(~started & line):
                        m.d.sync += busy.eq(0)
                    with m.Elif(bits[0]):
                        m.d.sync += bits.eq(Cat(bits[1:], line))
                    with m.Else():
                        m.d.sync += [busy.eq(0), self.valid.eq(line)]
        return m


class UartTransmitter(Component):
    """Bytes in, serial line out.

    Members
    -------
    enable : In(1)
        From a `BaudGenerator`.
    write : In(1)
        Send ``data``; only while no byte is being sent. The line is low from the next cycle on; the
        start bit ends with the 16th enable from there, so it lasts 15 to 16 enables' time.
    data : In(8)
    line : Out(1)
        Pin; idle high.
    busy : Out(1)
        From the cycle after ``write`` up to the enable that ends the stop bit.
    """

    def __init__(self) -> None:
        super().__init__(
            {
                "enable": In(1),
                "write": In(1),
                "data": In(8),
                "line": Out(1, init=1),
                "busy": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        count = Signal(4)
        bits = Signal(9)  # data and stop bit; nothing is left when that one is out
        with m.If(self.write):
            m.d.sync += [
                self.busy.eq(1),
                count.eq(1),
                bits.eq(Cat(self.data, Const(1, 1))),
                self.line.eq(0),
            ]
        with m.Elif(self.busy & self.enable):
            m.d.sync += count.eq(count + 1)
            with m.If(count == 0):
                m.d.sync += bits.eq(bits[1:])
                with m.If(bits.any()):
                    m.d.sync += self.line.eq(bits[0])
                with m.Else():
                    m.d.sync += self.busy.eq(0)
        return m
