"""Units of the outside world, converted once, to millimetres, degrees and seconds."""

from __future__ import annotations

from typing import Final

INCH: Final = 25.4  # [mm]
MINUTE: Final = 60.0  # [s]
MICROSECOND: Final = 1e-6  # [s]
