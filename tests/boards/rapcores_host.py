"""A host at the pins of the RAPcores gateware, in the cycles of its specification.

Cycle c is the time after clock edge c - 1 and before edge c: a level given for cycle c is first
sampled by edge c, and a change that edge c makes is seen in cycle c + 1.
"""

from pulsewright.boards.rapcores import registers as reg
from pulsewright.boards.rapcores.gateware import Rapcores
from pulsewright.boards.rtl_spi import RtlSpiBoard

READY = 300  # cycle in which the board is ready
STATUS, SWAP, READ, MOVE = (
    header << 56
    for header in (
        reg.HEADER_STATUS_READ,
        reg.HEADER_CONFIG_SWAP,
        reg.HEADER_CONFIG_READ,
        reg.HEADER_MOVE,
    )
)

_boards = {}


class Host:
    """The board, and what was sent to it."""

    def __init__(self, profile="document", *, half=6, **options):
        key = profile, tuple(sorted(options.items()))
        if key not in _boards:
            _boards[key] = RtlSpiBoard(
                Rapcores(profile, **options), clock_hz=reg.CLOCK_HZ, listens=READY
            )
        self.board = _boards[key]
        self.board.restart()
        self.half = half
        self.bytes = options.get("word_bits", 64) // 8
        self.free = READY
        self.traces = []

    def bits(self, words):
        return b"".join((w % (1 << 8 * self.bytes)).to_bytes(self.bytes, "little") for w in words)

    def f(self, words, start=None):
        """Return f of the last word of a message that is sent from ``start`` on, or next."""
        start = self.free if start is None else start
        return start + self.half + 16 * self.half * self.bytes * words

    def send(self, *words, start=None):
        """Send words in one frame; return those that came back. ``fell`` is f of the last one."""
        start = self.free if start is None else start
        self.fell = self.f(len(words), start)
        return self.raw(self.bits(words), start)

    def raw(self, data, start=None):
        start = self.free if start is None else start
        reply, self.free = self.board.transfer(start, data, self.half)
        return [
            int.from_bytes(reply[k : k + self.bytes], "little")
            for k in range(0, len(reply), self.bytes)
        ]

    def status(self, address):
        return self.send(STATUS | address, 0)[1]

    def write(self, address, value):
        """Write a configuration register; return its old value."""
        return self.send(SWAP | address, value)[1]

    def pin(self, cycle, name, level):
        self.board.schedule(cycle, name, level)

    def run(self, cycle):
        self.board.advance(cycle)
        self.free = max(self.free, cycle + 1)

    def edges(self, name, since=0):
        """Return (cycle, level) of all changes of an output pin, from ``since`` on."""
        self.traces.append(self.board.drain())
        found = []
        for trace in self.traces:
            n = trace.pins.index(name)
            level = int(trace.initial[n])
            for cycle in trace.cycles[n]:
                level ^= 1
                found.append((int(cycle) + 1, level))
        return [edge for edge in found if edge[0] >= since]

    def pulses(self, name, since=0):
        """Return (first, last) cycle of each pulse."""
        edges = self.edges(name, since)
        return [(a, b - 1) for (a, up), (b, _) in zip(edges[::2], edges[1::2], strict=True) if up]
