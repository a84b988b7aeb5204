"""What the C library's ``poll`` is asked and answers."""

from __future__ import annotations

from typing import Final

import numpy as np

POLL: Final = np.dtype([("fd", "<i4"), ("events", "<i2"), ("revents", "<i2")])
