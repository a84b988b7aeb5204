"""The way of plain motion lines from an interpreter through the compiled reader to a recorder."""

from __future__ import annotations

from typing import Final

import numpy as np

from pulsewright.motion.gcode import calls as c
from pulsewright.motion.gcode.bulk_kernel import DEPTH, DIGITS, FEED, MOTION, POSITION, read
from pulsewright.motion.gcode.interpreter import Interpreter
from pulsewright.motion.gcode.recorder import Recorder
from pulsewright.motion.gcode.settings import FARTHEST
from pulsewright.motion.gcode.source import Source
from pulsewright.motion.moves import AXES

ROWS: Final = 1 << 14  # moves in one go
_POWERS: Final = np.array([float(10**n) for n in range(DIGITS + 1)])


class Bulk:
    """Reads plain lines of one program.

    Parameters
    ----------
    interpreter : Interpreter
        Whose state the lines start from and change.
    recorder : Recorder
        Where their moves go.
    source : Source
        The program.
    """

    def __init__(self, interpreter: Interpreter, recorder: Recorder, source: Source) -> None:
        self._interpreter, self._recorder, self._source = interpreter, recorder, source
        data = source.data if source.data.endswith(b"\n") else source.data + b"\n"
        self._data = np.frombuffer(data, np.uint8)
        self._columns = np.full(26, -1, np.int64)
        settings = interpreter.settings
        for letter in set(settings.axes) - set(settings.wrapped):
            self._columns[ord(letter) - ord("A")] = AXES.index(letter)
        self._room = np.empty(DEPTH), np.empty(DEPTH, np.int64)
        self._lines = np.empty(ROWS, np.int32)
        self._ends = np.empty((ROWS, len(AXES)))
        self._feeds = np.empty(ROWS)

    def run(self, i: int) -> int:
        """Carry out plain lines from line ``i`` on; return the first that is none, from 0."""
        interpreter = self._interpreter
        modal = interpreter.modal
        if not interpreter.plain or (modal.feed and modal.feed_scale != modal.scale):
            return i
        if modal.feed_scale != modal.scale:  # with feed 0: the next F is in the new units
            modal.feed_scale = modal.scale
            self._recorder.emit(c.SetFeedRate(0.0, modal.scale))
        names, bounds, values = self._names()
        motion = {0: 0.0, 10: 1.0}.get(-1 if modal.motion is None else modal.motion, -1.0)
        state = np.array(
            [modal.absolute, motion, modal.feed, modal.scale, *interpreter.position], np.float64
        )
        feed = modal.feed
        offset, line = int(self._source.starts[i]), i + 1
        while offset < len(self._data):
            offset, line, count = read(
                self._data,
                offset,
                line,
                self._columns,
                FARTHEST,
                _POWERS,
                names,
                bounds,
                values,
                *self._room,
                state,
                self._lines,
                self._ends,
                self._feeds,
            )
            self._recorder.straights(self._lines[:count], self._ends[:count], self._feeds[:count])
            if count < ROWS:
                break
        if state[MOTION] >= 0:
            modal.motion = 10 * int(state[MOTION])
        interpreter.position = state[POSITION:].tolist()
        if state[FEED] != feed:
            modal.feed = float(state[FEED])
            self._recorder.emit(c.SetFeedRate(modal.feed, modal.scale))
        return line - 1

    def _names(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the named parameters as the kernel takes them."""
        parameters = self._interpreter.parameters
        known = {**parameters.local, **parameters.world}
        known = {name: value for name, value in known.items() if name.isascii()}
        bounds = np.cumsum([0, *map(len, known)])
        names = np.frombuffer("".join(known).encode(), np.uint8)
        return names, bounds.astype(np.int64), np.array([*known.values()], np.float64)
