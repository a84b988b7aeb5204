"""The boards, one room each."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Final, Literal, overload

from pulsewright.boards import links, pluto_step, rapcores, s3g, usc
from pulsewright.boards.board import Board
from pulsewright.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from pulsewright.boards.pluto_step.driver import PlutoStepDriver
    from pulsewright.boards.rapcores.driver import RapcoresDriver
    from pulsewright.boards.s3g.driver import S3GDriver
    from pulsewright.boards.usc.driver import UscDriver
    from pulsewright.transport.faults import Faults

BOARDS: Final = {
    board.name: board for board in (pluto_step.BOARD, rapcores.BOARD, s3g.BOARD, usc.BOARD)
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
    name: Literal["pluto_step"],
    link: str = ...,
    profile: str | None = ...,
    *,
    record: Path | str | None = ...,
    faults: Faults | None = ...,
    **options: int,
) -> PlutoStepDriver: ...
@overload
def open_board(
    name: Literal["rapcores"],
    link: str = ...,
    profile: str | None = ...,
    *,
    record: Path | str | None = ...,
    faults: Faults | None = ...,
    **options: int | str,
) -> RapcoresDriver: ...
@overload
def open_board(
    name: Literal["s3g"],
    link: str = ...,
    profile: str | None = ...,
    *,
    record: Path | str | None = ...,
    faults: Faults | None = ...,
    **options: int,
) -> S3GDriver: ...
@overload
def open_board(
    name: Literal["usc"],
    link: str = ...,
    profile: str | None = ...,
    *,
    record: Path | str | None = ...,
    faults: Faults | None = ...,
    **options: int,
) -> UscDriver: ...
@overload
def open_board(
    name: str,
    link: str = ...,
    profile: str | None = ...,
    *,
    record: Path | str | None = ...,
    faults: Faults | None = ...,
    **options: int | str,
) -> Any: ...


def open_board(
    name: str,
    link: str = "twin:",
    profile: str | None = None,
    *,
    record: Path | str | None = None,
    faults: Faults | None = None,
    **options: int | str,
) -> Any:
    """Open a board behind a link and return its driver. Nothing is sent to the board yet.

    Parameters
    ----------
    name : str
        A key of `BOARDS`.
    link : str
        One of `links.links`. A simulated board is in its reset state; any other one is as it is.
    profile : str, optional
        How contradictions in the board's document are resolved; see the README of its room.
    record : Path or str, optional
        File that keeps all that goes over the link, for `pulsewright replay`.
    faults : Faults, optional
        What goes wrong on the link, as far as it is told to: see `transport.faults`. A recording
        has what the driver saw of it.
    **options : int or str
        Profile switches that differ from the profile, and parameters that the room knows: channels.
        Some have values with names, such as ``motor_driver="h_bridge"``.

    Raises
    ------
    UsageError
        If the board, link, profile or a switch is unknown, or ``record`` cannot be written.

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
    numbers = board.numbers(options)
    board.switches(profile, **numbers)
    if baud := links.bit_rate(board, link):
        numbers = {"baud1": baud} | numbers
    bus: Any = links.open_bus(board, link, profile, numbers)
    with ExitStack() as failed:
        failed.callback(bus.close)
        if faults is not None:
            from pulsewright.transport.faults import faulty

            bus = faulty(board.bus, bus, faults)
        if record is not None:
            from pulsewright.transport.recording import Recorder, recorded

            opened = {"board": name, "profile": profile, "options": numbers, "link": link}
            recorder = Recorder(record, opened | {"clock_hz": bus.clock_hz})
            failed.callback(recorder.close)
            bus = recorded(board.bus, bus, recorder)
        driver = board.driver(bus, profile, **numbers)
        failed.pop_all()
    return driver
