"""A host at the serial pins of the S3G gateware, both ports at 16 clocks per bit."""

import numpy as np

from pulsewright.boards.s3g import packets
from pulsewright.boards.s3g.gateware import S3G
from pulsewright.gateware.rtl import RtlSimulation

BAUD = 3_125_000
BIT = 16  # clocks
BYTE = 10 * BIT
FAST = {"baud1": BAUD, "baud2": BAUD, "ints_timer": 20_000}
PORTS = (("avr_tx", "avr_rx"), ("ext_tx", "ext_rx"))
CONFIGURED = 2000  # cycle from which on the board runs

_simulations = {}


def simulation(**options):
    """Return the gateware as after configuration; each kind is made once."""
    key = tuple(sorted(options.items()))
    if key not in _simulations:
        _simulations[key] = RtlSimulation(S3G(**(FAST | options)))
    _simulations[key].reset()
    return _simulations[key]


class Host:
    """The board, what goes to its inputs at chosen cycles, and its outputs.

    ``cycle`` of all methods is the first clock edge that samples a level, and levels read are those
    in the cycle before an edge.
    """

    def __init__(self, begin=None, **options):
        self.board = simulation(**options)
        self.level = {"rst_n": 1, "cclk": 1, "avr_tx": 1, "ext_tx": 1}
        self.changes = {0: {}} if begin is None else begin  # cycle: {pin: level}
        self.rows = []
        if begin is None:
            self.run(CONFIGURED)

    @property
    def now(self):
        return self.board.cycle

    def set(self, cycle, **levels):
        self.changes.setdefault(cycle, {}).update(levels)

    def send(self, data, cycle=None, port=0):
        """Send bytes from ``cycle`` on; return t, the cycle at which the last start bit falls."""
        cycle = self.now if cycle is None else cycle
        pin = PORTS[port][0]
        for n, byte in enumerate(data):
            start = cycle + BYTE * n
            for bit, level in enumerate([0, *(byte >> k & 1 for k in range(8)), 1]):
                self.set(start + BIT * bit, **{pin: level})
        return cycle + BYTE * (len(data) - 1)

    def run(self, end):
        """Run up to cycle ``end``."""
        at = sorted(cycle for cycle in self.changes if cycle < end)
        stimulus = np.zeros(len(at), self.board.inputs)
        for row, cycle in zip(stimulus, at, strict=True):
            self.level |= self.changes.pop(cycle)
            row["cycle"] = cycle
            for pin, level in self.level.items():
                row[pin] = level
        self.rows.append(self.board.run(end, stimulus))
        return self

    def edges(self, pin, bit=0, since=1):
        """Return the cycles at which a pin rises, and those at which it falls."""
        rows = np.concatenate(self.rows)
        level = (rows[pin] >> bit & 1).astype(int)
        at = rows["cycle"][1:] + 1
        step = np.diff(level)
        return [at[(step == d) & (at >= since)].tolist() for d in (1, -1)]

    def received(self, port=0, since=1):
        """Return (cycle of its start bit, byte) of each byte that the board sent at 16 clocks."""
        rows = np.concatenate(self.rows)
        pin = PORTS[port][1]
        found, cycle = [], since
        for fall in self.edges(pin, since=since)[1]:
            if fall >= cycle:
                at = fall - 1 + BIT * np.arange(1, 9) + BIT // 2
                bits = rows[pin][np.searchsorted(rows["cycle"], at, "right") - 1]
                found.append((fall, int(np.packbits(bits.astype(np.uint8), bitorder="little")[0])))
                cycle = fall + 9 * BIT
        return found

    def replies(self, port=0, since=1):
        """Return (cycle of its start bit, payload in hex) of each whole packet from the board."""
        found, data = [], self.received(port, since)
        while len(data) > 1 and len(data) >= data[1][1] + 3:
            assert data[0][1] == 0xD5
            size = data[1][1]
            frame = bytes(byte for _, byte in data[: size + 3])
            assert frame == packets.frame(frame[2:-1])
            found.append((data[0][0], frame[2:-1].hex()))
            data = data[size + 3 :]
        return found

    def ask(self, data, port=0):
        """Send a request and run until it is answered; return t, and the payload of the answer."""
        t = self.send(data, port=port)
        self.run(t + 4000)
        (at, payload), *_ = self.replies(port, since=t)
        self.answered = at
        return t, payload
