"""How much memory this process has taken."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

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
