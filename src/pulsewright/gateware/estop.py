"""Emergency stop chain."""

from __future__ import annotations

from amaranth import Module, Signal
from amaranth.lib.wiring import Component, In, Out


class EstopChain(Component):
    """Lets a board run from a release command on, as long as nothing objects.

    Members
    -------
    release : In(1)
        The release bit. A rise while the other two are high leaves estop.
    closed : In(1)
        The chain is closed.
    fed : In(1)
        The watchdog has not expired.
    running : Out(1)
        Low in estop, as after reset. Falls as soon as one of the three is low, and stays low until
        the next rise of ``release``.
    """

    def __init__(self) -> None:
        super().__init__({"release": In(1), "closed": In(1), "fed": In(1), "running": Out(1)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        released, ran = Signal(), Signal()
        m.d.sync += [released.eq(self.release), ran.eq(self.running)]
        m.d.comb += self.running.eq(self.release & self.closed & self.fed & (ran | ~released))
        return m
