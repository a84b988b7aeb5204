"""Quadrature encoders: position, velocity as the time between counts, and faults."""

from __future__ import annotations

from amaranth import Cat, Module, Mux, Signal
from amaranth.lib.wiring import Component, In, Out


class EncoderInputs(Component):
    """Counts of one encoder, from its pins; parameter and pins as of `Encoder`.

    Members
    -------
    a, b : In(1)
    count, up : Out(1)
        A count in this cycle, and its direction.
    fault : Out(1)
        Both have changed at once in this cycle, which counts nothing.
    """

    def __init__(self, *, primed: bool = True) -> None:
        self._primed = primed
        super().__init__({"a": In(1), "b": In(1), "count": Out(1), "up": Out(1), "fault": Out(1)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        a, b = (Signal(3, name=name, reset_less=self._primed) for name in "ab")
        m.d.sync += [a.eq(Cat(self.a, a)), b.eq(Cat(self.b, b))]
        changed_a, changed_b = a[1] ^ a[2], b[1] ^ b[2]
        m.d.comb += [
            self.count.eq(changed_a ^ changed_b),
            self.up.eq(a[1] ^ b[2]),
            self.fault.eq(changed_a & changed_b),
        ]
        return m


class Encoder(Component):
    """One encoder with registers of its own; section 4.6 of the specification.

    Parameters
    ----------
    primed : bool
        A and B are followed in reset, so that their levels at its end count nothing.
    velocity_reset : bool
        The time since the last count starts at 0; otherwise it is not known before the second
        count, and the velocity stays 0 until then.

    Members
    -------
    a, b : In(1)
        Pins, asynchronous. A leads B while the position rises. A change in cycle c counts in cycle
        c + 2, and is visible in c + 3.
    position, velocity : Out(32)
        Signed; the velocity is the number of cycles between the last two counts, less 1, with the
        sign of the last one.
    fault : Out(1)
        Both have changed at once in this cycle, which counts nothing.
    """

    def __init__(self, *, primed: bool = True, velocity_reset: bool = True) -> None:
        self._primed, self._velocity_reset = primed, velocity_reset
        super().__init__(
            {
                "a": In(1),
                "b": In(1),
                "position": Out(32),
                "velocity": Out(32),
                "fault": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.inputs = inputs = EncoderInputs(primed=self._primed)
        up = inputs.up
        time, counted = Signal(32), Signal()
        m.d.sync += time.eq(time + 1)
        m.d.comb += [
            inputs.a.eq(self.a),
            inputs.b.eq(self.b),
            self.fault.eq(inputs.fault),
        ]
        with m.If(inputs.count):
            m.d.sync += [
                self.position.eq(self.position + Mux(up, 1, -1)),
                time.eq(0),
                counted.eq(1),
            ]
            with m.If(counted | self._velocity_reset):
                m.d.sync += self.velocity.eq(Mux(up, time, -time))
        return m
