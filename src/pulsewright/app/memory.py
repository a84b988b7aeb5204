"""The memory of this process: how much it has taken, and what becomes of it."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path
from typing import Final

KEPT: Final = 1 << 28  # freed memory that is not given back [byte]
LARGE: Final = 1 << 25  # what takes so much is given back at once, the most there can be [byte]
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # of glibc's mallopt

_PEAK: Final = re.compile(r"^VmHWM:\s*(\d+) kB", re.MULTILINE)


def peak_memory() -> float:
    """Return the most memory that this process has had at once [MB].

    The figure of `resource.getrusage` begins with what the process had that started this one.

    Raises
    ------
    OSError
        If this system is no Linux.
    """
    found = _PEAK.search(Path("/proc/self/status").read_text(encoding="ascii"))
    if found is None:
        raise OSError("/proc/self/status tells no VmHWM")
    return int(found[1]) / 1024


def keep_freed_memory() -> None:
    """Keep what is freed for what comes next, where the C library can.

    By itself it gives back the arrays of each plan; the system takes about as long to clear them
    for the next one as many moves take to plan.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_TRIM_THRESHOLD, KEPT)
        mallopt(_MMAP_THRESHOLD, LARGE)
