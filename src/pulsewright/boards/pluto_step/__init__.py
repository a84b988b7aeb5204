# amaranth: UnusedElaboratable=no
# A build asks gateware for its ports before it chooses what to make.
"""Pluto-P board as four-axis step generator behind a parallel port."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from pulsewright.boards.board import Board
from pulsewright.boards.pluto_step.registers import DEFAULT_PROFILE, PROFILES

if TYPE_CHECKING:
    from pulsewright.boards.golden import Recordings
    from pulsewright.boards.playing import Drives
    from pulsewright.boards.pluto_step.driver import PlutoStepDriver
    from pulsewright.boards.pluto_step.gateware import PlutoStep
    from pulsewright.boards.pluto_step.player import PlutoStepPlayer, PlutoStepServo
    from pulsewright.boards.pluto_step.twin import PlutoStepTwin
    from pulsewright.boards.rtl_board import RtlEppBoard
    from pulsewright.motion.trajectory import Trajectory
    from pulsewright.registers.model import RegisterMap
    from pulsewright.transport.bus import EppBus


def _registers() -> RegisterMap:
    from pulsewright.boards.pluto_step.registers import MAP

    return MAP


def _twin(profile: str = DEFAULT_PROFILE, **options: Any) -> PlutoStepTwin:
    from pulsewright.boards.pluto_step.twin import PlutoStepTwin

    return PlutoStepTwin(profile=profile, **options)


def _rtl(profile: str = DEFAULT_PROFILE, **switches: int) -> RtlEppBoard:
    from pulsewright.boards.pluto_step.gateware import PlutoStep
    from pulsewright.boards.pluto_step.registers import CLOCK_HZ
    from pulsewright.boards.rtl_board import RtlEppBoard

    return RtlEppBoard(
        PlutoStep(profile, **switches),
        clock_hz=CLOCK_HZ,
        nwait_idle=1,
        idle={"nreset": 1},
        pins={"step": "step", "dir": "dir", "dout": "out", "led": "led", "tristate": "tristate"},
    )


def _gateware(
    profile: str = DEFAULT_PROFILE, axes: int | None = None, **switches: int
) -> PlutoStep:
    from pulsewright.boards.pluto_step.gateware import PlutoStep

    return PlutoStep(profile, **switches)  # its axes are always four


def _driver(bus: EppBus, profile: str = DEFAULT_PROFILE, **switches: int) -> PlutoStepDriver:
    from pulsewright.boards.pluto_step.driver import PlutoStepDriver

    return PlutoStepDriver(bus, profile=profile, **switches)


def _player(
    driver: PlutoStepDriver, trajectory: Trajectory, drives: Drives
) -> PlutoStepPlayer | PlutoStepServo:
    from pulsewright.boards.pluto_step.player import player

    return player(driver, trajectory, drives)


def _recordings() -> Recordings[Any]:
    from pulsewright.boards.pluto_step.golden import RECORDINGS

    return RECORDINGS


BOARD: Final = Board(
    name="pluto_step",
    title="Pluto-step, four-axis step generator",
    document="LinuxCNC, The register layout of the pluto-servo (pluto-step firmware)",
    profiles=tuple(PROFILES),
    default_profile=DEFAULT_PROFILE,
    axes=4,
    registers=_registers,
    twin=_twin,
    rtl=_rtl,
    gateware=_gateware,
    driver=_driver,
    player=_player,
    positive_direction=0,
    recordings=_recordings,
)
