"""Clock divider of which only the period matters."""

from __future__ import annotations

from typing import Final

from amaranth import Cat, Module, Signal
from amaranth.lib.wiring import Component, In, Out

# Bits whose XOR is fed back into a shift register of maximum length: the last one, and this one.
_TAPS: Final = {3: 2, 4: 3, 5: 3, 6: 5, 7: 6, 9: 5, 10: 7, 11: 9, 15: 14}


class Divider(Component):
    """Shift register that goes through all of its states.

    Smaller and faster than a binary counter, as it has no carry. It is one of maximum length, with
    the feedback inverted while all bits but the last are 0, which adds the state 0.

    Parameters
    ----------
    period : int
        2**3 to 2**7, 2**9 to 2**11 or 2**15.

    Members
    -------
    enable : In(1)
        Go to the next state at this edge.
    last : Out(1)
        The next state is the one after reset: high in every ``period``-th one.

    Raises
    ------
    ValueError
        If the period is not one of these.
    """

    def __init__(self, *, period: int) -> None:
        self._width = period.bit_length() - 1
        if self._width not in _TAPS or period != 1 << self._width:
            allowed = ", ".join(str(1 << width) for width in _TAPS)
            raise ValueError(f"period must be one of {allowed}, not {period}")
        super().__init__({"enable": In(1), "last": Out(1)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        state = Signal(self._width)
        rest = ~state[:-1].any()
        m.d.comb += self.last.eq(rest & state[-1])
        with m.If(self.enable):
            feedback = state[-1] ^ state[_TAPS[self._width] - 1] ^ rest
            m.d.sync += state.eq(Cat(feedback, state[:-1]))
        return m
