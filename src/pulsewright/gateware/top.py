"""A component on an FPGA: its clock, its reset and its pads."""

from __future__ import annotations

from typing import Any

from amaranth import (
    Cat,
    ClockDomain,
    ClockSignal,
    Const,
    DomainRenamer,
    Elaboratable,
    Instance,
    Module,
    Signal,
    Value,
)
from amaranth.build import Attrs, Pins, Resource
from amaranth.lib import io
from amaranth.lib.cdc import ResetSynchronizer
from amaranth.lib.wiring import Component, Out

from pulsewright.gateware.pins import ACTIVE_HIGH, Pad, PinMap, pads
from pulsewright.gateware.pll import Family, Pll


def sync_domain(family: str) -> ClockDomain:
    """Return the clock domain of a component, with the reset that costs least.

    Flip-flops of the ECP5 are reset by a net of their own (GSR), those of the iCE40 have an
    asynchronous reset; it is released in step with the clock.
    """
    if family == "ice40":
        return ClockDomain("sync", async_reset=True)
    return ClockDomain("sync", reset_less=True)


class Ring(Component):
    """Frequency divider of flip-flops alone, as fast as they are.

    One bit goes round; whatever the bits are at first, only one is left after a round.

    Parameters
    ----------
    period : int
        At least 2.

    Members
    -------
    clock : Out(1)
        A flip-flop that is high for one cycle of ``period``.
    """

    def __init__(self, period: int) -> None:
        self._period = period
        super().__init__({"clock": Out(1)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        bits = Signal(self._period - 1)
        m.d.sync += bits.eq(Cat(~bits.any(), bits))
        m.d.comb += self.clock.eq(bits[-1])
        return m


class Pads(Elaboratable):
    """A component at the pins of an Amaranth platform.

    Parameters
    ----------
    component : Component
    family : str
        Of the FPGA.
    pin_map : PinMap
        Where the component's pads go.
    """

    def __init__(self, component: Component, family: Family, pin_map: PinMap) -> None:
        self._component, self._family, self._pin_map = component, family, pin_map

    def elaborate(self, platform: Any) -> Module:
        m = Module()
        m.submodules.board = self._component
        for pad in pads(self._component).values():
            places = self._pin_map.get(pad.name, ())
            for bit in range(pad.width):
                pin = places[bit] if bit < len(places) else None
                if pin:
                    self._connect(m, platform, pad, bit, pin)
                elif pad.direction != "o":
                    m.d.comb += self._bit(pad, bit, "i").eq(pad.name not in ACTIVE_HIGH)
        return m

    def _bit(self, pad: Pad, bit: int, suffix: str) -> Value:
        name = f"{pad.name}_{suffix}" if pad.direction == "io" else pad.name
        return Value.cast(getattr(self._component, name))[bit]

    def _connect(self, m: Module, platform: Any, pad: Pad, bit: int, pin: str) -> None:
        name = f"pad_{pad.name}"
        attributes = Attrs(**_attributes(self._family, pad))
        platform.add_resources([Resource(name, bit, Pins(pin, dir=pad.direction), attributes)])
        port = platform.request(name, bit, dir="-")
        buffer = io.Buffer(pad.direction, port)
        m.submodules[f"{name}_{bit}"] = buffer
        if pad.direction != "o":
            m.d.comb += self._bit(pad, bit, "i").eq(buffer.i)
        if pad.direction != "i":
            m.d.comb += buffer.o.eq(self._bit(pad, bit, "o"))
        if pad.direction == "io" or pad.enabled:
            m.d.comb += buffer.oe.eq(getattr(self._component, f"{pad.name}_oe"))
        elif pad.high_z:
            m.d.comb += buffer.oe.eq(~self._component.tristate)


class Top(Elaboratable):
    """A component with all it needs to run by itself; for an Amaranth platform.

    It is in reset until the PLL has locked.

    Parameters
    ----------
    component : Component
        Clocked by ``sync``.
    pll : Pll
        How ``sync`` is made from the platform's clock.
    pll_pad : bool
        That clock enters at the pad of an iCE40 PLL.
    pin_map : PinMap
        Where the component's pads go.
    """

    def __init__(self, component: Component, pll: Pll, pll_pad: bool, pin_map: PinMap) -> None:
        self._component, self._pin_map = component, pin_map
        self._pll, self._pll_pad = pll, pll_pad

    def elaborate(self, platform: Any) -> Module:
        m = Module()
        family = self._pll.family
        m.domains += sync_domain(family)
        clock = Signal(name="board_clock", attrs={"keep": 1})  # so that its name survives
        m.d.comb += ClockSignal("sync").eq(clock)
        platform.add_clock_constraint(clock, float(self._pll.clock_hz))
        (self._ecp5_clock if family == "ecp5" else self._ice40_clock)(m, platform, clock)
        m.submodules.pads = Pads(self._component, family, self._pin_map)
        return m

    def _ice40_clock(self, m: Module, platform: Any, clock: Signal) -> None:
        pll, pin = self._pll, platform.request(platform.default_clk, dir="-").io
        fast, locked = Signal(name="pll_clock"), Signal()
        settings: dict[str, Any] = {
            "p_FEEDBACK_PATH": "SIMPLE",
            "p_DIVR": Const(pll.reference - 1, 4),
            "p_DIVF": Const(pll.multiplier - 1, 7),
            "p_DIVQ": Const(pll.output.bit_length() - 1, 3),
            "p_FILTER_RANGE": Const(pll.filter_range, 3),
            "i_RESETB": Const(1),
            "i_BYPASS": Const(0),
            "o_LOCK": locked,
            "o_PLLOUTGLOBAL": fast,
        }
        if self._pll_pad:
            m.submodules.pll = Instance("SB_PLL40_PAD", io_PACKAGEPIN=pin, **settings)
        else:
            reference = Signal()
            m.submodules.clock_pin = Instance(
                "SB_IO", p_PIN_TYPE=Const(0b000001, 6), io_PACKAGE_PIN=pin, o_D_IN_0=reference
            )
            m.submodules.pll = Instance("SB_PLL40_CORE", i_REFERENCECLK=reference, **settings)
        if pll.ring == 1:
            m.d.comb += clock.eq(fast)
        else:
            m.domains += ClockDomain("ring", reset_less=True, local=True)
            m.d.comb += ClockSignal("ring").eq(fast)
            m.submodules.ring = ring = DomainRenamer("ring")(Ring(pll.ring))
            m.submodules.ring_out = Instance(
                "SB_GB", i_USER_SIGNAL_TO_GLOBAL_BUFFER=ring.clock, o_GLOBAL_BUFFER_OUTPUT=clock
            )
        m.submodules.reset = ResetSynchronizer(~locked, domain="sync")

    def _ecp5_clock(self, m: Module, platform: Any, clock: Signal) -> None:
        pll = self._pll
        m.submodules.clock_pin = pin = io.Buffer(
            "i", platform.request(platform.default_clk, dir="-")
        )
        locked, seen, released = Signal(), Signal(), Signal()
        feedback, second = clock, {}
        if pll.second:
            feedback = Signal()
            second = {
                "a_FREQUENCY_PIN_CLKOS": f"{float(pll.clock_hz) / 1e6:g}",
                "p_CLKOS_DIV": pll.second,
                "p_CLKOS_CPHASE": pll.second - 1,
                "p_CLKOS_FPHASE": 0,
                "p_CLKOS_ENABLE": "ENABLED",
                "i_ENCLKOS": Const(0),
                "o_CLKOS": clock,
            }
        m.submodules.pll = Instance(
            "EHXPLLL",
            a_FREQUENCY_PIN_CLKI=f"{pll.reference_hz / 1e6:g}",
            a_FREQUENCY_PIN_CLKOP=f"{float(pll.oscillator_hz / pll.output) / 1e6:g}",
            a_ICP_CURRENT="12",
            a_LPF_RESISTOR="8",
            a_MFG_ENABLE_FILTEROPAMP="1",
            a_MFG_GMCREF_SEL="2",
            p_CLKI_DIV=pll.reference,
            p_CLKFB_DIV=pll.multiplier,
            p_CLKOP_DIV=pll.output,
            p_CLKOP_CPHASE=pll.output - 1,
            p_CLKOP_FPHASE=0,
            p_CLKOP_ENABLE="ENABLED",
            p_FEEDBK_PATH="CLKOP",
            p_OUTDIVIDER_MUXA="DIVA",
            p_PLLRST_ENA="DISABLED",
            p_INTFB_WAKE="DISABLED",
            p_STDBY_ENABLE="DISABLED",
            p_DPHASE_SOURCE="DISABLED",
            i_CLKI=pin.i,
            i_CLKFB=feedback,
            i_RST=Const(0),
            i_STDBY=Const(0),
            i_PHASESEL0=Const(0),
            i_PHASESEL1=Const(0),
            i_PHASEDIR=Const(1),
            i_PHASESTEP=Const(1),
            i_PHASELOADREG=Const(1),
            i_PLLWAKESYNC=Const(0),
            i_ENCLKOP=Const(0),
            o_CLKOP=feedback,
            o_LOCK=locked,
            **second,
        )
        # The global reset must not reset what releases it.
        for n, (d, q) in enumerate(((locked, seen), (seen, released))):
            m.submodules[f"reset{n}"] = Instance(
                "FD1S3AX", p_GSR="DISABLED", i_CK=clock, i_D=d, o_Q=q
            )
        m.submodules.reset = Instance("SGSR", i_CLK=clock, i_GSR=released)


def _attributes(family: Family, pad: Pad) -> dict[str, str | int]:
    """Return what the pins of a pad are: 3.3 V CMOS, and what they read while open."""
    pulled = pad.direction != "o" and pad.name not in ACTIVE_HIGH
    if family == "ecp5":
        pull = "UP" if pulled else "DOWN" if pad.name in ACTIVE_HIGH else "NONE"
        return {"IO_TYPE": "LVCMOS33", "PULLMODE": pull}
    return {"IO_STANDARD": "SB_LVCMOS", **({"PULLUP": 1} if pulled else {})}
