# amaranth: UnusedElaboratable=no
# A build asks gateware for its ports before it chooses what to make.
"""Pico Systems Universal Stepper Controller."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from pulsewright.boards.board import Board
from pulsewright.boards.usc.registers import DEFAULT_PROFILE, PROFILES

if TYPE_CHECKING:
    from pulsewright.boards.playing import Drives
    from pulsewright.boards.rtl_board import RtlEppBoard
    from pulsewright.boards.usc.driver import UscDriver
    from pulsewright.boards.usc.gateware import Usc
    from pulsewright.boards.usc.player import UscPlayer, UscServo
    from pulsewright.boards.usc.twin import UscTwin
    from pulsewright.motion.trajectory import Trajectory
    from pulsewright.registers.model import RegisterMap
    from pulsewright.transport.bus import EppBus


def _registers() -> RegisterMap:
    from pulsewright.boards.usc.registers import MAP

    return MAP


def _twin(profile: str = DEFAULT_PROFILE, **options: Any) -> UscTwin:
    from pulsewright.boards.usc.twin import UscTwin

    return UscTwin(profile=profile, **options)


def _rtl(profile: str = DEFAULT_PROFILE, **switches: int) -> RtlEppBoard:
    from pulsewright.boards.rtl_board import RtlEppBoard
    from pulsewright.boards.usc.gateware import Usc
    from pulsewright.boards.usc.registers import CLOCK_HZ

    return RtlEppBoard(
        Usc(profile, **switches),
        clock_hz=CLOCK_HZ,
        nwait_idle=0,
        idle={"ninit": 1, "estop_chain": 1},
        pins={name: name for name in ("step", "dir", "out", "dac", "running")},
    )


def _gateware(profile: str = DEFAULT_PROFILE, axes: int | None = None, **switches: int) -> Usc:
    from pulsewright.boards.usc.gateware import Usc

    return Usc(profile, **({} if axes is None else {"axes": axes}), **switches)


def _driver(bus: EppBus, profile: str = DEFAULT_PROFILE, **switches: int) -> UscDriver:
    from pulsewright.boards.usc.driver import UscDriver

    return UscDriver(bus, profile=profile, **switches)


def _player(driver: UscDriver, trajectory: Trajectory, drives: Drives) -> UscPlayer | UscServo:
    from pulsewright.boards.usc.player import player

    return player(driver, trajectory, drives)


BOARD: Final = Board(
    name="usc",
    title="Universal Stepper Controller (USC)",
    document="Pico Systems, Universal Stepper Controller Register Definition",
    profiles=tuple(PROFILES),
    default_profile=DEFAULT_PROFILE,
    axes=4,
    registers=_registers,
    twin=_twin,
    rtl=_rtl,
    gateware=_gateware,
    driver=_driver,
    player=_player,
)
