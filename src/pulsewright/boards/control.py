"""Control channels of served boards: one JSON object per line, and one back.

``docs/control.md`` describes the commands.
"""

from __future__ import annotations

import json
from abc import abstractmethod
from collections.abc import Callable
from typing import Any, Final

from pulsewright.boards.epp_port import EppPort
from pulsewright.boards.live import LivePort
from pulsewright.errors import UsageError

OK: Final[dict[str, Any]] = {"ok": True}

Command = Callable[[dict[str, Any]], Any]  # returns the reply, or nothing


class Control:
    """Commands for one served twin.

    Parameters
    ----------
    stop : callable
        Ends the server.
    cut : callable
        Closes all connections of clients.
    """

    def __init__(self, stop: Callable[[], None], cut: Callable[[], None]) -> None:
        self._stop, self._cut = stop, cut
        self._commands = self.commands()

    def answer(self, line: bytes) -> bytes | None:
        """Carry out a command; return the reply, a line without its end, or None."""
        try:
            request = json.loads(line)
            if not isinstance(request, dict):
                raise UsageError("a command is a JSON object")
            name = request.get("cmd")
            if name == "quit":
                self._stop()
                return None
            if not isinstance(name, str) or name not in self._commands:
                raise UsageError("unknown command")
            reply = self._commands[name](request) or OK
        except (ValueError, RecursionError) as error:  # of JSON, or ours
            reply = {"error": str(error)}
        return json.dumps(reply).encode()

    @abstractmethod
    def commands(self) -> dict[str, Command]:
        """Return the commands but ``quit`` by name."""


def number(request: dict[str, Any], name: str, default: int | None = None) -> int:
    """Return an integer of a command.

    Raises
    ------
    UsageError
        If it is missing, or none.
    """
    value = request.get(name, default)
    if type(value) is not int:
        raise UsageError(f"'{name}' should be an integer, not {value!r}"[:200])
    return value


def switch(request: dict[str, Any], name: str) -> bool:
    """Return a truth value of a command.

    Raises
    ------
    UsageError
        If it is missing, or none.
    """
    value = request.get(name)
    if type(value) is not bool:
        raise UsageError(f"'{name}' should be true or false, not {value!r}"[:200])
    return value


class EppControl(Control):
    """Commands for boards on an EPP port."""

    def __init__(self, port: EppPort, stop: Callable[[], None], cut: Callable[[], None]) -> None:
        self._port, self._twin = port, port.twin
        self._faults: dict[str, Command] = {
            "none": self._no_fault,
            "mute": lambda r: self._counted("mute", r),
            "flip": self._flip,
            "stuck": lambda r: self._counted("stuck", r),
            "lose": lambda r: self._counted("lose", r),
            "double": lambda r: self._counted("double", r),
            "delay": self._delay,
            "power": self._power,
            "cut": self._cut_off,
        }
        super().__init__(stop, cut)

    def commands(self) -> dict[str, Command]:
        """Return the commands; those of encoders and estop only where the board has them."""
        twin: Any = self._twin
        of_board: dict[str, Command] = {
            "get": self._get,
            "steps": self._steps,
            "din": lambda r: twin.set_din(number(r, "value"), **self._board(r)),
        }
        if hasattr(twin, "set_encoder"):
            of_board |= {
                "enc": lambda r: twin.set_encoder(
                    number(r, "n"), number(r, "value"), **self._board(r)
                ),
                "index": lambda r: twin.index_edge(number(r, "n"), **self._board(r)),
                "estop_in": lambda r: twin.set_estop_chain(switch(r, "ok"), **self._board(r)),
                "loopback": lambda r: twin.set_loopback(switch(r, "on"), **self._board(r)),
            }
        return {name: self._now(command) for name, command in of_board.items()} | {
            "fault": self._now(self._fault)
        }

    def _now(self, command: Command) -> Command:
        """Let a command act at the present model time."""

        def act(request: dict[str, Any]) -> Any:
            self._port.arrive()
            return command(request)

        return act

    def _board(self, request: dict[str, Any]) -> dict[str, int]:
        """Return the argument ``board`` for methods of the twin that take it."""
        board, boards = number(request, "board", 0), getattr(self._twin, "boards", 1)
        if not 0 <= board < boards:
            raise UsageError(f"no board {board}; there are 0..{boards - 1}")
        return {"board": board} if hasattr(self._twin, "boards") else {}

    def _get(self, request: dict[str, Any]) -> dict[str, Any]:
        state: dict[str, Any] = self._twin.state(**self._board(request))
        link = self._port.link
        return (
            state
            | {"t": self._port.now, "cycle": int(link["markers"])}
            | {name: int(link[name]) for name in ("frames", "bus_frames", "config_bytes")}
            | {"config_crc32": int(link["config_crc"]), "overruns": int(link["overruns"])}
        )

    def _steps(self, request: dict[str, Any]) -> dict[str, Any]:
        state = self._get(request)
        return {name: state[name] for name in ("t", "steps", "step_edges")}

    # -------------------------------------------------------------------------------------- faults

    def _fault(self, request: dict[str, Any]) -> None:
        kind = request.get("kind")
        if not isinstance(kind, str) or kind not in self._faults:
            raise UsageError(f"'kind' should be one of {', '.join(self._faults)}")
        self._faults[kind](request)

    def _no_fault(self, request: dict[str, Any]) -> None:
        link = self._port.link
        for name in ("mute", "stuck", "lose", "double", "flip_reads", "flip_writes"):
            link[name] = 0
        self._port.delays, self._port.delay_s = 0, 0.0
        self._port.power(True)

    def _counted(self, kind: str, request: dict[str, Any]) -> None:
        self._port.link[kind] = _count(request)

    def _flip(self, request: dict[str, Any]) -> None:
        mask, of = number(request, "mask"), request.get("of", "read")
        if not 0 <= mask <= 0xFF or of not in ("read", "write"):
            raise UsageError("'mask' should be 0..255, and 'of' \"read\" or \"write\"")
        self._port.link[f"flip_{of}"], self._port.link[f"flip_{of}s"] = mask, _count(request)

    def _delay(self, request: dict[str, Any]) -> None:
        seconds = request.get("seconds")
        if type(seconds) not in (int, float) or not 0 <= seconds <= 3600:  # type: ignore[operator]
            raise UsageError("'seconds' should be a number, 0..3600")
        self._port.delays = _count(request)
        self._port.delay_s = float(seconds)  # type: ignore[arg-type]

    def _power(self, request: dict[str, Any]) -> None:
        self._port.power(switch(request, "on"))

    def _cut_off(self, request: dict[str, Any]) -> None:
        self._cut()


def _count(request: dict[str, Any]) -> int:
    count = number(request, "count", -1)
    if not -1 <= count < 1 << 31:
        raise UsageError("'count' should be -1, for ever, or 0..2147483647")
    return count


class LiveControl(Control):
    """Commands for a board in real time, behind a serial or SPI port."""

    def __init__(self, port: LivePort, stop: Callable[[], None], cut: Callable[[], None]) -> None:
        self._port = port
        super().__init__(stop, cut)

    def commands(self) -> dict[str, Command]:
        """Return the commands."""
        return {
            "get": self._get,
            "steps": self._steps,
            "pin": self._pin,
            "reset": self._reset,
            "fault": self._fault,
        }

    def _get(self, request: dict[str, Any]) -> dict[str, Any]:
        self._port.catch_up()
        state: dict[str, Any] = self._port.twin.state()
        return state

    def _steps(self, request: dict[str, Any]) -> dict[str, Any]:
        state = self._get(request)
        return {"t": state["t"], "steps": state["position"]}

    def _pin(self, request: dict[str, Any]) -> None:
        """Bring an input pin to a level now; those of the link are the link's."""
        twin = self._port.twin
        pins = [pin for pin in twin.input_pins if pin not in self._port.link_pins]
        if (name := request.get("name")) not in pins:
            raise UsageError(f"'name' should be one of {', '.join(pins)}")
        self._port.catch_up()
        twin.schedule([twin.now + 1], name, number(request, "value"))

    def _reset(self, request: dict[str, Any]) -> None:
        self._port.catch_up()
        self._port.reset()

    def _fault(self, request: dict[str, Any]) -> None:
        arguments = {name: value for name, value in request.items() if name not in ("cmd", "kind")}
        kind = request.get("kind")
        if kind not in self._port.fault_kinds:
            raise UsageError(f"'kind' should be one of {', '.join(self._port.fault_kinds)}")
        self._port.catch_up()
        if kind == "cut":
            self._cut()
        elif kind == "power":
            self._port.power(switch(request, "on"))
        else:
            self._port.faults.inject(kind, **arguments)
            if kind == "none":
                self._port.power(True)
