"""EPP over a socket: the wire format.

A request is 10 bytes; a reply is a byte of flags and the data read, and comes for reads only.
Requests are those accesses of `bus` that have the same letter, and two more: nINIT and one byte of
configuration.
"""

from __future__ import annotations

from typing import Final

import numpy as np

NINIT: Final = ord("I")
CONFIGURE: Final = ord("P")
TIMEOUT: Final = 0x01  # flag: a cycle since the last reply was not acknowledged

# One request. ``arg``: byte to write, number of reads 1..255, or level. ``t``: client's monotonic
# time [ns].
REQUEST: Final = np.dtype([("op", "u1"), ("arg", "u1"), ("t", "<u8")])
REQUEST_BYTES: Final = REQUEST.itemsize
