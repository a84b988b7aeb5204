"""RAPcores: buffered moves of several motors behind SPI."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from pulsewright.boards.board import Board
from pulsewright.boards.rapcores.registers import (
    CLOCK_HZ,
    DEFAULT_PROFILE,
    MAX_MOTORS,
    MOTORS,
    PROFILES,
)

if TYPE_CHECKING:
    from pulsewright.registers.model import RegisterMap
    from pulsewright.transport.spi_bus import SpiBus

PARAMETERS: Final = frozenset(
    {"motors", "encoders", "word_bits", "depth", "halt_pin", "position_bits"}
)


def _part(module: str, name: str) -> Any:
    """Return what a module of the room, or beside it, offers under a name."""
    return getattr(import_module(f"pulsewright.boards.{module}"), name)


def _registers() -> RegisterMap:
    from pulsewright.boards.rapcores.registers import MAP

    return MAP


def _twin(profile: str = DEFAULT_PROFILE, **options: Any) -> Any:
    return _part("rapcores.twin", "RapcoresTwin")(profile, **options)


def _rtl(profile: str = DEFAULT_PROFILE, **options: int) -> Any:
    board = _part("rapcores.gateware", "Rapcores")(profile, **options)
    return _part("rtl_spi", "RtlSpiBoard")(board, clock_hz=CLOCK_HZ)


def _gateware(profile: str = DEFAULT_PROFILE, axes: int | None = None, **options: int) -> Any:
    of_the_build = {"motors": MOTORS if axes is None else axes} | options
    return _part("rapcores.gateware", "Rapcores")(profile, **of_the_build)


def _driver(bus: SpiBus, profile: str = DEFAULT_PROFILE, **options: int) -> Any:
    return _part("rapcores.driver", "RapcoresDriver")(bus, profile=profile, **options)


def _player(driver: Any, trajectory: Any, **limits: Any) -> Any:
    return _part("rapcores.player", "RapcoresPlayer")(driver, trajectory, **limits)


def _parameters_for(motors: int) -> dict[str, int]:
    return {"motors": min(max(motors, MOTORS), MAX_MOTORS)}


def _recordings() -> tuple[Any, Any]:
    return _part("rapcores.golden", "load"), _part("rapcores.golden", "replay")


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
    parameters_for=_parameters_for,
    recordings=_recordings,
)
