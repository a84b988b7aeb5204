"""The boards, one room each."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, Literal, overload
from urllib.parse import parse_qsl, urlsplit

from pulsewright.boards import pluto_step, rapcores, s3g, usc
from pulsewright.boards.board import Board
from pulsewright.errors import UsageError

if TYPE_CHECKING:
    from pulsewright.boards.pluto_step.driver import PlutoStepDriver
    from pulsewright.boards.rapcores.driver import RapcoresDriver
    from pulsewright.boards.s3g.driver import S3GDriver
    from pulsewright.boards.usc.driver import UscDriver
    from pulsewright.transport.bus import EppBus
    from pulsewright.transport.serial_bus import SerialBus
    from pulsewright.transport.spi_bus import SpiBus

BOARDS: Final = {
    board.name: board for board in (pluto_step.BOARD, rapcores.BOARD, s3g.BOARD, usc.BOARD)
}
LINKS: Final = {
    "twin:": "a new simulated board in this process",
    "rtl:": "its gateware, simulated clock by clock; needs the extra 'build' and a C++ compiler",
    "serial:PATH?baud=N": "a board at a serial port, such as serial:/dev/ttyUSB0?baud=500000",
}


def get(name: str) -> Board:
    """Return what the room ``name`` offers.

    Raises
    ------
    UsageError
        If there is no such board; the message lists those there are.
    """
    try:
        return BOARDS[name]
    except KeyError:
        raise UsageError(f"no board '{name}'; the boards are {', '.join(BOARDS)}") from None


@overload
def open_board(
    name: Literal["pluto_step"], link: str = ..., profile: str | None = ..., **options: int
) -> PlutoStepDriver: ...
@overload
def open_board(
    name: Literal["rapcores"], link: str = ..., profile: str | None = ..., **options: int
) -> RapcoresDriver: ...
@overload
def open_board(
    name: Literal["s3g"], link: str = ..., profile: str | None = ..., **options: int
) -> S3GDriver: ...
@overload
def open_board(
    name: Literal["usc"], link: str = ..., profile: str | None = ..., **options: int
) -> UscDriver: ...
@overload
def open_board(name: str, link: str = ..., profile: str | None = ..., **options: int) -> Any: ...


def open_board(name: str, link: str = "twin:", profile: str | None = None, **options: int) -> Any:
    """Open a board behind a link and return its driver. Nothing is sent to the board yet.

    Parameters
    ----------
    name : str
        A key of `BOARDS`.
    link : str
        One of `LINKS`. A simulated board is in its reset state; one at a port is as it is.
    profile : str, optional
        How contradictions in the board's document are resolved; see the README of its room.
    **options : int
        Profile switches that differ from the profile, and parameters that the room knows: channels.

    Raises
    ------
    UsageError
        If the board, link, profile or a switch is unknown.

    Examples
    --------
    >>> with open_board("usc") as board:
    ...     board.initialise()
    ...     board.release_estop()
    ...     board.set_step_rate(0, 30_000.0)
    30030.03003003003
    """
    board = get(name)
    profile = board.default_profile if profile is None else profile
    board.switches(profile, **options)
    if link.startswith("serial:") and board.bus == "serial":
        path, baud = _serial_port(board, link)
        options = {"baud1": baud} | options
        return board.driver(_open_port(board, path, baud), profile, **options)
    return board.driver(_open_bus(board, link, profile, options), profile, **options)


def _open_bus(
    board: Board, link: str, profile: str, options: dict[str, int]
) -> EppBus | SerialBus | SpiBus:
    if link not in ("twin:", "rtl:"):
        usable = "; ".join(f"'{url}' ({what})" for url, what in LINKS.items())
        raise UsageError(
            f"link '{link}' is not one that {board.name} can be opened at; usable are {usable}"
        )
    simulated = (board.twin if link == "twin:" else board.rtl)(profile, **options)
    if board.bus == "serial":
        from pulsewright.transport.serial_bus import VirtualSerialBus

        return VirtualSerialBus(simulated)
    if board.bus == "spi":
        from pulsewright.transport.spi_bus import VirtualSpiBus

        return VirtualSpiBus(simulated, listens=_constant(board, "RESET_CYCLES"))
    from pulsewright.transport.virtual import VirtualEppBus

    return VirtualEppBus(simulated)


def _serial_port(board: Board, link: str) -> tuple[str, int]:
    """Read ``serial:PATH?baud=N``; without a rate, it is that of the board's first port."""
    url = urlsplit(link)
    query = dict(parse_qsl(url.query, keep_blank_values=True))
    baud = query.pop("baud", str(_constant(board, "BAUD1")))
    if not url.path or query or not baud.isdecimal():
        raise UsageError(f"link '{link}': expected serial:PATH?baud=N, with N in baud")
    return url.path, int(baud)


def _open_port(board: Board, path: str, baud: int) -> SerialBus:
    from pulsewright.transport.serial_port import PortSerialBus

    return PortSerialBus(path, baud, _constant(board, "CLOCK_HZ"))


def _constant(board: Board, name: str) -> int:
    constants = {constant.name: constant.value for constant in board.registers().constants}
    return constants[name]
