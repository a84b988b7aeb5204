"""FPGA boards that a bitstream can be built for."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any, Final

from pulsewright.errors import UsageError
from pulsewright.gateware.pll import Family

INSTALL: Final = "install what builds bitstreams with: pip install 'pulsewright[build]'"


@dataclass(frozen=True)
class Platform:
    """One FPGA board: what is beyond its description in amaranth-boards.

    Parameters
    ----------
    name, title : str
        For the command line, and for people.
    family : str
        ``ice40`` or ``ecp5``.
    module, kind : str
        Where amaranth-boards describes it.
    connectors : tuple of str
        Connectors whose pins are free, in the order in which they are filled.
    note : str
        How the names of the pins read on the board.
    flash : str
        Command that loads the bitstream, ``{file}``; see docs/flashing.md.
    synthesis : str
        Options for Yosys, which make a design faster.
    pll_pad : bool
        iCE40: the clock enters at the pad of a PLL, which cannot be used in another way.
    """

    name: str
    title: str
    family: Family
    module: str
    kind: str
    connectors: tuple[str, ...]
    note: str
    flash: str
    synthesis: str = ""
    pll_pad: bool = False

    def open(self) -> Any:
        """Return a new Amaranth platform.

        Raises
        ------
        UsageError
            If amaranth-boards is not installed.
        """
        try:
            module = importlib.import_module(f"amaranth_boards.{self.module}")
        except ModuleNotFoundError as error:
            raise UsageError(f"platform {self.name} needs {error.name}; {INSTALL}") from error
        from amaranth.build import Connector

        platform = getattr(module, self.kind)()
        uart = platform.resources.get(("uart", 0))
        if uart is not None:  # its pins by name, like those of a connector
            pins = {sub.name: sub.ios[0].names[0] for sub in uart.ios if sub.name in ("rx", "tx")}
            platform.add_connectors([Connector("uart", 0, pins)])
        return platform

    def pins(self) -> dict[str, str]:
        """Return the free pins in the order of use: ``pmod_0:1`` on the board, ``4`` on the FPGA.

        The last ones are the serial port at the board's USB, ``uart_0:rx`` and ``uart_0:tx``, if it
        has one; only a serial bus may go there.

        Raises
        ------
        UsageError
            If amaranth-boards is not installed.
        """
        connectors = {f"{c.name}_{c.number}": c for c in self.open().connectors.values()}
        return {
            f"{name}:{pin}": ball
            for name in (*self.connectors, "uart_0")
            if name in connectors
            for pin, ball in connectors[name].mapping.items()
        }

    @property
    def crystal_hz(self) -> int:
        """Frequency of the clock on the board [Hz]."""
        return int(self.open().default_clk_frequency)


PLATFORMS: Final = {
    platform.name: platform
    for platform in (
        Platform(
            name="icebreaker",
            title="1BitSquared iCEBreaker (iCE40 UP5K)",
            family="ice40",
            module="icebreaker",
            kind="ICEBreakerPlatform",
            connectors=("pmod_0", "pmod_1", "pmod_2"),
            note="pmod_0, 1, 2: PMOD1A, PMOD1B, PMOD2; pins 1..4 are the upper row, 7..10 below",
            flash="iceprog {file}",
            synthesis="-abc9 -device u",
            pll_pad=True,
        ),
        Platform(
            name="hx8k",
            title="Lattice iCE40HX8K-B-EVN breakout board",
            family="ice40",
            module="ice40_hx8k_b_evn",
            kind="ICE40HX8KBEVNPlatform",
            connectors=("j_2", "j_3"),
            note="j_2, j_3: headers J2 and J3, numbered as on the board",
            flash="iceprog -S {file}",
            synthesis="-abc9 -device hx",
        ),
        Platform(
            name="ulx3s",
            title="Radiona ULX3S with LFE5U-25F (ECP5)",
            family="ecp5",
            module="ulx3s",
            kind="ULX3S_25F_Platform",
            connectors=("gpio_0",),
            note="gpio_0: headers J1 and J2, GP0 is 0+ and GN0 is 0-",
            flash="openFPGALoader -b ulx3s {file}",
        ),
        Platform(
            name="icesugar_pro",
            title="MuseLab iCESugar-Pro with LFE5U-25F (ECP5)",
            family="ecp5",
            module="icesugar_pro",
            kind="ICESugarProPlatform",
            connectors=("sodimm_0",),
            note="sodimm_0: contacts of the SO-DIMM edge",
            flash="icesprog {file}",
        ),
        Platform(
            name="orangecrab",
            title="OrangeCrab r0.2 with LFE5U-25F (ECP5)",
            family="ecp5",
            module="orangecrab_r0_2",
            kind="OrangeCrabR0_2_25FPlatform",
            connectors=("io_0",),
            note="io_0: the Feather header, named as on the board",
            flash="dfu-util -a 0 -D {file}",
        ),
    )
}


def get(name: str) -> Platform:
    """Return a platform.

    Raises
    ------
    UsageError
        If there is none of that name; the message lists those there are.
    """
    try:
        return PLATFORMS[name]
    except KeyError:
        raise UsageError(
            f"no platform '{name}'; the platforms are {', '.join(PLATFORMS)}"
        ) from None
