"""What is known from one run to the next of where the machine at a link stands.

Boards forget, and a host that is killed tells nobody. So a file stands for each machine on a real
link from before it moves until it rests in a known place: what finds one there must not move it.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from pulsewright.boards.links import SIMULATED
from pulsewright.errors import PositionUnknownError, UsageError
from pulsewright.files import replacing


class Standing:
    """An account, kept through a ``with`` block that plays a program, of a machine's position.

    A simulated board begins with its program, and needs none.

    Parameters
    ----------
    link : str
        Where the board is.
    program : str
        Name for people.
    referenced : bool
        The machine has been referenced since it moved the last time.

    Attributes
    ----------
    driver : Driver or None
        To be set in the block once there is one; its ``position_known`` at the end of the block is
        what is kept.
    """

    def __init__(self, link: str, program: str, *, referenced: bool) -> None:
        self._link, self._referenced = link, referenced
        self._path = None if link in SIMULATED else account(link)
        begun = time.strftime("%Y-%m-%d %H:%M:%S")
        self._note = {"link": link, "program": program, "time": begun}
        self.driver: Any = None

    def __enter__(self) -> Self:
        """Begin.

        Raises
        ------
        PositionUnknownError
            If the position is unknown, and the machine has not been referenced.
        UsageError
            If no account can be kept.
        """
        if self._path is not None:
            if self._path.exists() and not self._referenced:
                raise PositionUnknownError(f"link '{self._link}': {_told(self._path)}")
            _write(self._path, self._note)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Keep what is known now."""
        if self._path is None:
            return
        if self.driver is None or self.driver.position_known:
            self._path.unlink(missing_ok=True)
        else:
            _write(self._path, self._note | {"why": str(error or "")})


def account(link: str) -> Path:
    """Return the file that is there while the position of the machine at a link is unknown.

    It is in ``$XDG_STATE_HOME/pulsewright``, which is ``~/.local/state/pulsewright`` by default.
    """
    scheme, _, place = link.partition("?")[0].partition(":")
    if not scheme.endswith("tcp"):
        place = str(Path(place).absolute())
    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    name = hashlib.sha256(f"{scheme}:{place}".encode()).hexdigest()[:16]
    return Path(home) / "pulsewright" / f"unknown-{name}.json"


def _write(path: Path, note: dict[str, str]) -> None:
    """Write an account that outlasts a computer whose power fails."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"{path.parent}: cannot be made ({error.strerror}), but keeps account of machines "
            f"whose position is unknown; set XDG_STATE_HOME to a folder that can be written"
        ) from error
    with replacing(path) as temporary, temporary.open("w") as file:
        json.dump(note, file)
        file.flush()
        os.fsync(file.fileno())


def _told(path: Path) -> str:
    """Return what an account says."""
    try:
        note = json.loads(path.read_text())
        begun = f"{note['program']}, begun at {note['time']}, "
    except (OSError, ValueError, KeyError, TypeError):
        note, begun = {}, "a program "
    ended = f"ended so: {note['why']}" if note.get("why") else "has not come to its end"
    return (
        f"the position of the machine is unknown, for {begun}{ended}. Reference it (switches, "
        f"stops or by eye), and say so with --referenced"
    )
