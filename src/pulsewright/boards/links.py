"""The ways to a board, by URL."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final
from urllib.parse import parse_qsl

from pulsewright.boards.board import Board
from pulsewright.errors import UsageError

if TYPE_CHECKING:
    from pulsewright.transport.bus import EppBus
    from pulsewright.transport.serial_bus import SerialBus
    from pulsewright.transport.spi_bus import SpiBus

SIMULATED: Final = {
    "twin:": "a new simulated board in this process",
    "rtl:": "its gateware, simulated clock by clock; needs the extra 'build' and a C++ compiler",
}
SERIAL: Final = "serial:PATH?baud=N"
# by what boards meet at; the words behind the colon say what belongs there
REAL: Final = {
    "epp": {
        "epp:PATH": "a parallel port of this computer, such as epp:/dev/parport0",
        "epp+unix:PATH": "a server on this computer; see 'pulsewright serve'",
        "epp+tcp:HOST:PORT": "a server at a network address",
    },
    "serial": {
        SERIAL: "a serial port, such as serial:/dev/ttyUSB0?baud=500000",
    },
    "spi": {
        "spi:PATH?hz=N": "an SPI device of this computer, such as spi:/dev/spidev0.0?hz=1000000",
        "spi+unix:PATH": "a server on this computer; see 'pulsewright serve'",
        "spi+tcp:HOST:PORT": "a server at a network address",
    },
}
SCK_CYCLES: Final = 12  # of the board's clock in one of SCK, at least: so replies are in time


def links(board: Board) -> dict[str, str]:
    """Return the forms of link that a board can be opened at, and what each one is."""
    return SIMULATED | REAL[board.bus]


def open_bus(
    board: Board, link: str, profile: str, options: dict[str, int]
) -> EppBus | SerialBus | SpiBus:
    """Open a link. ``options`` are those of a simulated board.

    Raises
    ------
    UsageError
        If the board has no such link, or it cannot be opened.
    """
    if link in SIMULATED:
        return _simulated(board, link, profile, options)
    scheme, _, place = link.partition(":")
    forms = {form.partition(":")[0]: form for form in REAL[board.bus]}
    if scheme not in forms:
        usable = "; ".join(f"'{form}' ({what})" for form, what in links(board).items())
        raise UsageError(
            f"link '{link}' is not one that {board.name} can be opened at; usable are {usable}"
        )
    clock_hz = constant(board, "CLOCK_HZ")
    if scheme in ("epp+unix", "epp+tcp", "spi+unix", "spi+tcp"):
        from pulsewright.transport import socket_bus

        opened = socket_bus.SocketEppBus if board.bus == "epp" else socket_bus.SocketSpiBus
        return opened(f"{scheme.partition('+')[2]}:{place}", clock_hz)
    path, rate = _device(link, forms[scheme], _usual_rate(board))
    if scheme == "serial":
        from pulsewright.transport.serial_port import PortSerialBus

        return PortSerialBus(path, rate, clock_hz)
    if scheme == "spi":
        from pulsewright.transport.spidev import SpidevBus

        return SpidevBus(path, rate, clock_hz)
    from pulsewright.transport.parport import ParportEppBus

    return ParportEppBus(path, clock_hz)


def bit_rate(board: Board, link: str) -> int | None:
    """Return the rate of a link to a serial port [baud], None of another one.

    Raises
    ------
    UsageError
        If the link is none.
    """
    if not link.startswith("serial:") or board.bus != "serial":
        return None
    return _device(link, SERIAL, _usual_rate(board))[1]


def constant(board: Board, name: str) -> int:
    """Return the value of a constant of a board's register map."""
    return {constant.name: constant.value for constant in board.registers().constants}[name]


def _simulated(
    board: Board, link: str, profile: str, options: dict[str, int]
) -> EppBus | SerialBus | SpiBus:
    simulated: Any = (board.twin if link == "twin:" else board.rtl)(profile, **options)
    if board.bus == "serial":
        from pulsewright.transport.serial_bus import VirtualSerialBus

        return VirtualSerialBus(simulated)
    if board.bus == "spi":
        from pulsewright.transport.spi_bus import VirtualSpiBus

        return VirtualSpiBus(simulated, listens=constant(board, "RESET_CYCLES"))
    from pulsewright.transport.virtual import VirtualEppBus

    return VirtualEppBus(simulated)


def _usual_rate(board: Board) -> int:
    """Return the rate of a port if a link gives none [baud, Hz]; of EPP there is none."""
    if board.bus == "serial":
        return constant(board, "BAUD1")
    return constant(board, "CLOCK_HZ") // SCK_CYCLES


def _device(link: str, form: str, rate: int) -> tuple[str, int]:
    """Read ``scheme:PATH?key=N``, where ``form`` has a key at all; return the path and N."""
    path, _, query = link.partition(":")[2].partition("?")
    key = form.partition("?")[2].partition("=")[0]
    given = dict(parse_qsl(query, keep_blank_values=True))
    text = given.pop(key, str(rate))
    if not path or given or not text.isdecimal() or int(text) == 0:
        raise UsageError(f"link '{link}': expected {form}" + (", with N above 0" if key else ""))
    return path, int(text)
