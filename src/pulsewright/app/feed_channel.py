"""Control channel of a job that runs: its feed, for other programs."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from pulsewright.app.feed import FeedControl
from pulsewright.boards.control import Command, Control
from pulsewright.errors import UsageError
from pulsewright.transport.server import LineSession, Server

PERIOD: Final = 0.05  # between two looks at whether the job has ended [s]
UNIX: Final = "unix:"


class FeedChannel(Control):
    """The same as JSON commands, one per line; ``docs/control.md`` describes them."""

    def __init__(self, feed: FeedControl) -> None:
        self._feed = feed
        super().__init__(feed.stop, lambda: None)

    def commands(self) -> dict[str, Command]:
        """Return the commands by name."""
        feed = self._feed
        return {
            "hold": lambda r: feed.hold(_time(r)),
            "resume": lambda r: feed.resume(_time(r)),
            "override": lambda r: feed.override(_number(r, "factor"), _time(r)),
            "stop": lambda r: feed.stop(_time(r)),
            "get": lambda r: asdict(feed.state),
        }


@contextmanager
def listening(feed: FeedControl, url: str) -> Iterator[None]:
    """Let clients at ``unix:PATH`` control the feed while the context lasts.

    Only the user who runs this may connect.

    Raises
    ------
    UsageError
        If that is not a path at which a socket can be made.
    """
    if not url.startswith(UNIX):
        raise UsageError(f"'{url}': a control channel is unix:PATH")
    server, ended = Server(), threading.Event()
    channel = FeedChannel(feed)
    with server.listen(url, lambda c: LineSession(c, channel.answer)) as place:
        Path(place.removeprefix(UNIX)).chmod(0o600)
        thread = threading.Thread(target=server.run, args=(ended.is_set, None, PERIOD), daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()


def _number(request: dict[str, Any], name: str) -> float:
    value = request.get(name)
    if type(value) is not int and type(value) is not float:
        raise UsageError(f"'{name}' should be a number, not {value!r}"[:200])
    return float(value)


def _time(request: dict[str, Any]) -> float | None:
    return _number(request, "at") if "at" in request else None
