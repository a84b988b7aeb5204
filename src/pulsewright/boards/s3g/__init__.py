# amaranth: UnusedElaboratable=no
# A build asks gateware for its ports before it chooses what to make.
"""S3G: motion controller behind two serial ports."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from pulsewright.boards.board import Board
from pulsewright.boards.s3g.registers import (
    BAUD1,
    CHANNELS,
    DEFAULT_PROFILE,
    MAX_CHANNELS,
    PROFILES,
)

if TYPE_CHECKING:
    from pulsewright.boards.golden import Recordings
    from pulsewright.boards.playing import Drives
    from pulsewright.boards.rtl_serial import RtlSerialBoard
    from pulsewright.boards.s3g.driver import S3GDriver
    from pulsewright.boards.s3g.gateware import S3G
    from pulsewright.boards.s3g.player import S3GPlayer
    from pulsewright.boards.s3g.twin import S3GTwin
    from pulsewright.motion.trajectory import Trajectory
    from pulsewright.registers.model import RegisterMap
    from pulsewright.transport.serial_bus import SerialBus

PARAMETERS: Final = frozenset({"channels", "prog_words", "baud1", "baud2", "ints_timer"})


def _registers() -> RegisterMap:
    from pulsewright.boards.s3g.registers import MAP

    return MAP


def _twin(profile: str = DEFAULT_PROFILE, **options: Any) -> S3GTwin:
    from pulsewright.boards.s3g.twin import S3GTwin

    return S3GTwin(profile, **options)


def _rtl(profile: str = DEFAULT_PROFILE, **options: int) -> RtlSerialBoard:
    from pulsewright.boards.rtl_serial import RtlSerialBoard, SerialPins
    from pulsewright.boards.s3g.gateware import pins
    from pulsewright.boards.s3g.registers import BAUD2, CLOCK_HZ, READY_CYCLES

    return RtlSerialBoard(
        _made(profile, **options),
        clock_hz=CLOCK_HZ,
        ports=(
            SerialPins("avr_tx", "avr_rx", options.get("baud1", BAUD1)),
            SerialPins("ext_tx", "ext_rx", options.get("baud2", BAUD2)),
        ),
        idle={"rst_n": 1, "cclk": 1},
        pins=pins(options.get("channels", CHANNELS)),
        listens=READY_CYCLES,
    )


def _gateware(profile: str = DEFAULT_PROFILE, axes: int | None = None, **options: int) -> S3G:
    return _made(profile, channels=CHANNELS if axes is None else axes, **options)


def _made(profile: str, **options: int) -> S3G:
    """Return the gateware; what is not the original on every clock may save logic as well."""
    from pulsewright.boards.s3g.gateware import S3G

    return S3G(profile, shared_arithmetic=int(profile != DEFAULT_PROFILE), **options)


def _driver(bus: SerialBus, profile: str = DEFAULT_PROFILE, **options: int) -> S3GDriver:
    from pulsewright.boards.s3g.driver import S3GDriver

    of_the_board = {"baud1", "baud2", "ints_timer"}
    kept = {name: value for name, value in options.items() if name not in of_the_board}
    return S3GDriver(bus, profile=profile, baud=options.get("baud1", BAUD1), **kept)


def _player(driver: S3GDriver, trajectory: Trajectory, drives: Drives) -> S3GPlayer:
    from pulsewright.boards.s3g.player import S3GPlayer

    return S3GPlayer(driver, trajectory, drives)


def _parameters_for(motors: int) -> dict[str, int]:
    return {"channels": min(max(motors, CHANNELS), MAX_CHANNELS)}


def _recordings() -> Recordings[Any]:
    from pulsewright.boards.s3g.golden import RECORDINGS

    return RECORDINGS


BOARD: Final = Board(
    name="s3g",
    title="S3G motion controller",
    document="valurap FPGA controller, register, interrupt, strobe, packet and program tables",
    profiles=tuple(PROFILES),
    default_profile=DEFAULT_PROFILE,
    axes=MAX_CHANNELS,
    registers=_registers,
    twin=_twin,
    rtl=_rtl,
    gateware=_gateware,
    driver=_driver,
    player=_player,
    motor_pins=("mot{}_step", "mot{}_dir"),
    bus="serial",
    # 20 of the 30 or 32 block RAMs; the original's 8192 words are 80
    sizes={"ice40": {"prog_words": 2048}},
    parameters=PARAMETERS,
    parameters_for=_parameters_for,
    recordings=_recordings,
)
