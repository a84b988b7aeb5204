# amaranth: UnusedElaboratable=no
# A build asks gateware for its ports before it chooses what to make.
"""RAPcores: buffered moves of several motors behind SPI."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from pulsewright.boards.board import Board
from pulsewright.boards.rapcores.registers import (
    DEFAULT_PROFILE,
    MAX_MOTORS,
    MOTORS,
    PROFILES,
)

if TYPE_CHECKING:
    from pulsewright.boards.golden import Recordings
    from pulsewright.boards.playing import Drives
    from pulsewright.boards.rapcores.driver import RapcoresDriver
    from pulsewright.boards.rapcores.gateware import Rapcores
    from pulsewright.boards.rapcores.player import RapcoresPlayer
    from pulsewright.boards.rapcores.twin import RapcoresTwin
    from pulsewright.boards.rtl_spi import RtlSpiBoard
    from pulsewright.motion.trajectory import Trajectory
    from pulsewright.registers.model import RegisterMap
    from pulsewright.transport.spi_bus import SpiBus

PARAMETERS: Final = frozenset(
    {"motors", "encoders", "word_bits", "depth", "halt_pin", "position_bits", "motor_driver"}
)


def _registers() -> RegisterMap:
    from pulsewright.boards.rapcores.registers import MAP

    return MAP


def _twin(profile: str = DEFAULT_PROFILE, **options: Any) -> RapcoresTwin:
    from pulsewright.boards.rapcores.twin import RapcoresTwin

    return RapcoresTwin(profile, **options)


def _rtl(profile: str = DEFAULT_PROFILE, **options: Any) -> RtlSpiBoard:
    from pulsewright.boards.rapcores.gateware import Rapcores
    from pulsewright.boards.rapcores.registers import CLOCK_HZ, RESET_CYCLES
    from pulsewright.boards.rtl_spi import RtlSpiBoard

    return RtlSpiBoard(Rapcores(profile, **options), clock_hz=CLOCK_HZ, listens=RESET_CYCLES)


def _gateware(profile: str = DEFAULT_PROFILE, axes: int | None = None, **options: Any) -> Rapcores:
    from pulsewright.boards.rapcores.gateware import Rapcores

    motors = MOTORS if axes is None else axes
    return Rapcores(profile, **({"motors": motors, "encoders": motors} | options))


def _driver(bus: SpiBus, profile: str = DEFAULT_PROFILE, **options: int) -> RapcoresDriver:
    from pulsewright.boards.rapcores.driver import RapcoresDriver

    return RapcoresDriver(bus, profile=profile, **options)


def _player(driver: RapcoresDriver, trajectory: Trajectory, drives: Drives) -> RapcoresPlayer:
    from pulsewright.boards.rapcores.player import RapcoresPlayer

    return RapcoresPlayer(driver, trajectory, drives)


def _parameters_for(motors: int) -> dict[str, int]:
    return {"motors": min(max(motors, MOTORS), MAX_MOTORS)}


def _recordings() -> Recordings[Any]:
    from pulsewright.boards.rapcores.golden import RECORDINGS

    return RECORDINGS


BOARD: Final = Board(
    name="rapcores",
    title="RAPcores motion controller",
    document="RAPcores register map, protocol 0.3",
    profiles=tuple(PROFILES),
    default_profile=DEFAULT_PROFILE,
    axes=MAX_MOTORS,
    registers=_registers,
    twin=_twin,
    rtl=_rtl,
    gateware=_gateware,
    driver=_driver,
    player=_player,
    positive_direction=0,
    bus="spi",
    digital_outputs=False,
    parameters=PARAMETERS,
    choices={"motor_driver": ("step_dir", "h_bridge")},
    parameters_for=_parameters_for,
    # a bitstream has one adder for all motors
    sizes={"ice40": {"shared_dda": 1}, "ecp5": {"shared_dda": 1}},
    recordings=_recordings,
)
