"""Traces written while they grow: memory for one chunk, one file at the end.

Format ``pulsewright-trace-2``, a zip of numpy arrays (``.npz``): ``format``, ``clock_hz``, ``span``
(start, end), ``pins``, ``initial`` as in `EdgeTrace`, and ``deltas_<pin>`` uint32: the cycles from
``start`` to the first change and from each change to the next. A gap of `ESCAPE` cycles or more is
preceded by entries of `ESCAPE`, each worth that many cycles without a change. In plain numpy::

    cycles = (start + np.cumsum(deltas, dtype=np.int64))[deltas != 0xFFFFFFFF]
"""

from __future__ import annotations

import io
import shutil
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Final, Self

import numpy as np
from numpy.typing import NDArray

from pulsewright.edges.trace import ESCAPE, FORMAT, EdgeTrace
from pulsewright.errors import UsageError
from pulsewright.files import replacing

_BLOCK: Final = 1 << 20  # bytes copied at once


def encode(cycles: NDArray[np.int64], last: int) -> NDArray[np.uint32]:
    """Return the differences of ``cycles`` (n,), the first from ``last``, long gaps escaped."""
    gaps = np.diff(cycles, prepend=np.int64(last))
    long = np.flatnonzero(gaps >= ESCAPE)
    if len(long):
        escapes = gaps[long] // ESCAPE
        gaps[long] -= escapes * ESCAPE
        gaps = np.insert(gaps, np.repeat(long, escapes), ESCAPE)
    return gaps.astype("<u4")


class TraceWriter:
    """File of pin changes that grows chunk by chunk and appears whole, or not at all.

    Leaving the ``with`` block normally finishes the file; leaving it by an exception, or never
    closing it, leaves nothing behind and an older file untouched. Changes are spooled to nameless
    temporary files in the same folder.

    Parameters
    ----------
    path : Path or str
        Where the trace goes, by custom ``*.npz``.
    clock_hz, pins, initial, start
        As in `EdgeTrace`.

    Raises
    ------
    UsageError
        If the folder does not exist or cannot be written.

    Examples
    --------
    >>> with TraceWriter("trace.npz", 40_000_000, ("step0", "dir0"), [0, 0]) as writer:
    ...     for chunk in recording:
    ...         writer.append(chunk)
    """

    def __init__(
        self,
        path: Path | str,
        clock_hz: int,
        pins: Sequence[str],
        initial: Sequence[int] | NDArray[np.uint8],
        start: int = 0,
    ) -> None:
        self.path = Path(path)
        empty = tuple(np.zeros(0, np.int64) for _ in pins)
        levels = np.array(initial, np.uint8)
        self._last = EdgeTrace(clock_hz, tuple(pins), levels, empty, start, start)
        self._first = self._last
        self._previous = [start] * len(self._last.pins)
        self._counts = [0] * len(self._last.pins)
        try:
            self._spools: list[IO[bytes]] = [
                tempfile.TemporaryFile(dir=self.path.parent)  # noqa: SIM115 -- lives as the writer
                for _ in pins
            ]
        except OSError as error:
            raise UsageError(f"{path}: cannot be written ({error.strerror})") from error
        self._open = True

    @property
    def edges(self) -> int:
        """Level changes written so far."""
        return sum(self._counts)

    def append(self, chunk: EdgeTrace) -> None:
        """Add the changes of ``chunk``, which starts where the last one ended.

        Raises
        ------
        UsageError
            If the chunk does not follow the last one, or the writer is closed.
        """
        if not self._open:
            raise UsageError(f"{self.path}: the trace is closed, nothing can be added")
        chunk.require_after(self._last)
        for i, cycles in enumerate(chunk.cycles):
            if len(cycles):
                encode(cycles, self._previous[i]).tofile(self._spools[i])
                self._previous[i] = int(cycles[-1])
                self._counts[i] += len(cycles)
        empty = tuple(np.zeros(0, np.int64) for _ in chunk.pins)
        self._last = EdgeTrace(
            chunk.clock_hz, chunk.pins, chunk.final(), empty, chunk.end, chunk.end
        )

    def close(self) -> None:
        """Write the file; a second call does nothing."""
        if not self._open:
            return
        try:
            with (
                replacing(self.path) as temporary,
                zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
            ):
                for name, value in {
                    "format": np.array(FORMAT),
                    "clock_hz": np.array(self._first.clock_hz),
                    "span": np.array([self._first.start, self._last.end], np.int64),
                    "pins": np.array(self._first.pins, dtype=str),
                    "initial": self._first.initial,
                }.items():
                    block = io.BytesIO()
                    np.save(block, value)
                    archive.writestr(f"{name}.npy", block.getvalue())
                for pin, spool in zip(self._first.pins, self._spools, strict=True):
                    with archive.open(f"deltas_{pin}.npy", "w", force_zip64=True) as entry:
                        np.lib.format.write_array_header_1_0(
                            entry,
                            {
                                "descr": "<u4",
                                "fortran_order": False,
                                "shape": (spool.seek(0, io.SEEK_END) // 4,),
                            },
                        )
                        spool.seek(0)
                        shutil.copyfileobj(spool, entry, _BLOCK)
        finally:
            self.abort()

    def abort(self) -> None:
        """Drop what was written; after `close` this does nothing."""
        self._open = False
        for spool in self._spools:
            spool.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abort()
