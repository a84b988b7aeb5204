"""Gateware and twin of the USC side by side: the same levels at the pins in, every pin compared.

Changes of input pins are arrays (n, 3) of cycle, pin and level; pins are numbers in
`UscTwin.input_pins`. The first edge that samples a level is that of its cycle.
"""

from __future__ import annotations

import numpy as np

from pulsewright.boards.usc.gateware import UscBoards
from pulsewright.boards.usc.twin import UscTwin
from pulsewright.gateware.rtl import RtlSimulation

IDLE = {"nwrite": 1, "ndatastr": 1, "naddrstr": 1, "ninit": 1, "estop_chain": 1}
NWRITE, NDATASTR, NADDRSTR, NINIT, DATA = range(5)
FIRST_BOARD_PIN = 5
BOARD_PINS = 28  # a0..3, b0..3, index0..3, din0..14, estop_chain
A, B, INDEX, DIN, CHAIN = 0, 4, 8, 12, 27


def ordered(changes):
    """Sort changes by cycle; of several changes of a pin at one cycle the last one counts."""
    changes = np.asarray(changes, np.int64).reshape(-1, 3)
    changes = changes[np.lexsort((changes[:, 1], changes[:, 0]))]  # stable
    last = np.ones(len(changes), bool)
    last[:-1] = np.any(changes[1:, :2] != changes[:-1, :2], axis=1)
    return changes[last]


class Pair:
    """One configuration of the board, compiled once.

    Parameters
    ----------
    gateware : callable
        Makes the component.
    axes : int
        Axes of the gateware.
    **options
        Those of twin and gateware.
    """

    def __init__(self, gateware=UscBoards, *, axes=4, **options):
        self.axes = axes
        self.options = {"boards": 1} | options
        self.boards = self.options["boards"]
        self.base = options.get("base", 0)
        self.rtl = RtlSimulation(gateware(axes=axes, **self.options))
        self.twin = UscTwin(bus_pins=True, **self.options)
        self.idle = options.get("nwait_idle", 0)

    def reset(self):
        self.rtl.reset()
        self.twin = UscTwin(bus_pins=True, **self.options)

    def run(self, changes, end):
        """Run both from reset up to edge ``end``, not included; assert that all pins agree."""
        self.reset()
        changes = ordered(changes)
        rows = self.rtl.run(end, self._stimulus(changes))
        if len(changes):
            self.twin.schedule(*changes.T)
        self.twin.advance(end)
        trace = self.twin.drain()
        here = self._outputs(rows)
        for pin in trace.pins:
            if pin[-1].isdigit() and int(pin[-1]) >= self.axes and pin not in here:
                continue  # an axis that the gateware does not have
            there, mine = trace[pin], here[pin]
            common = min(len(there), len(mine))
            differs = np.flatnonzero(there[:common] != mine[:common])
            first = differs[0] if len(differs) else common
            assert np.array_equal(there, mine), (
                f"{pin}: gateware changes at {mine[first : first + 4]}, "
                f"twin at {there[first : first + 4]}"
            )
        return trace

    def _stimulus(self, changes):
        """Return rows of all inputs: one for each cycle with a change."""
        pins = UscTwin(**self.options).input_pins
        ports = [("nwrite", 1), ("ndatastr", 1), ("naddrstr", 1), ("ninit", 1), ("data_i", 1)]
        for b in range(self.boards):
            axes = [(f"{name}__{b}", 4) for name in ("a", "b", "index")]
            ports += [*axes, (f"din__{b}", 15), (f"estop_chain__{b}", 1)]
        assert sum(size for _, size in ports) == len(pins)

        grid = np.append(0, changes[:, 0])  # in order
        grid = grid[np.append(True, grid[1:] != grid[:-1])]
        rows = np.zeros(len(grid), self.rtl.inputs)
        rows["cycle"] = grid
        first = np.array([IDLE.get(pin.split(".")[-1], 0) for pin in pins])
        cycle, pin, level = changes[np.lexsort((changes[:, 0], changes[:, 1]))].T
        before = np.append(0, level[:-1])
        new = np.append(True, pin[1:] != pin[:-1])[: len(pin)]
        rise = level - np.where(new, first[pin], before[: len(pin)])
        place = np.searchsorted(grid, cycle)
        lowest = 0
        for port, size in ports:
            mine = (pin >= lowest) & (pin < lowest + size)
            weights = rise[mine] << (pin[mine] - lowest)
            steps = np.bincount(place[mine], weights, len(grid)).astype(np.int64)
            steps[0] += sum(first[lowest + n] << n for n in range(size))
            rows[port] = np.cumsum(steps)
            lowest += size
        return rows

    def _outputs(self, rows):
        """Return the cycles at which each output pin changes, by the twin's name of the pin."""
        ports = [("nwait", "nwait", 1), ("drive", "data_oe", 1), ("data{}", "data_o", 8)]
        for b in range(self.boards):
            prefix = f"b{b}." if b else ""
            ports += [(f"{prefix}{n}{{}}", f"{n}__{b}", self.axes) for n in ("step", "dir")]
            ports += [(f"{prefix}out{{}}", f"out__{b}", 7), (f"{prefix}dac{{}}", f"dac__{b}", 8)]
            ports += [(f"{prefix}running", f"running__{b}", 1)]
        driven = rows["data_oe"] == 1
        changes = {}
        for pin, port, size in ports:
            level = np.where(driven, rows[port], 0) if port == "data_o" else rows[port]
            for n in range(size):
                bits = np.append(self.idle if pin == "nwait" else 0, level >> n & 1)
                changes[pin.format(n)] = rows["cycle"][np.flatnonzero(np.diff(bits))]
        return changes


# --------------------------------------------------------------------------------------- bus cycles

# One bus cycle: operation, byte, edges that sample the strobe, edges to the next one, and a flaw:
# none, both strobes, nWrite or data change within the strobe, or nWrite goes up with the strobe
# (that is allowed, and the board drives the bus).
LEGAL, BOTH, NWRITE_CHANGES, DATA_CHANGES, NWRITE_UP = range(5)
CYCLE = np.dtype([(name, "i8") for name in ("op", "byte", "length", "gap", "flaw")])


def legal(*accesses, gap=5):
    """Bus cycles at full speed, from pairs of operation (A, W, R, a) and byte."""
    return [(ord(op), byte, 5, gap, LEGAL) for op, byte in accesses]


def bus_changes(cycles, start):
    """Return the changes of the bus pins, and the cycle after the last bus cycle."""
    c = np.array(cycles, CYCLE)
    at = start + np.append(0, np.cumsum(c["length"] + c["gap"]))
    at, end = at[:-1], int(at[-1])
    address = (c["op"] == ord("A")) | (c["op"] == ord("a"))
    read = ((c["op"] == ord("R")) | (c["op"] == ord("a"))).astype(np.int64)
    both = c["flaw"] == BOTH

    def change(where, cycle, pin, level):
        where = np.broadcast_to(where, at.shape)
        out = np.empty((int(where.sum()), 3), np.int64)
        out[:, 0] = cycle[where]
        out[:, 1] = pin
        out[:, 2] = np.broadcast_to(level, at.shape)[where]
        return out

    middle = at + c["length"] // 2
    changes = [
        change(True, at + c["length"], NADDRSTR, 1),
        change(True, at + c["length"], NDATASTR, 1),
        change(c["flaw"] == NWRITE_UP, at + c["length"], NWRITE, 1),
        change(c["flaw"] == NWRITE_CHANGES, middle, NWRITE, 1 - read),
        change(c["flaw"] == DATA_CHANGES, middle, DATA, ~c["byte"] & 0xFF),
        change(True, at, NWRITE, read),
        change(True, at, DATA, c["byte"]),
        change(address | both, at, NADDRSTR, 0),
        change(~address | both, at, NDATASTR, 0),
    ]
    return np.concatenate(changes), end


# ----------------------------------------------------------------------------------- random traffic

COMMANDS = (
    *("divisors", "divisors", "divisor", "control", "codes", "outputs", "release", "release"),
    *("timer", "load", "encoders", "read", "cycle", "cycle", "any", "byte", "address"),
)


def command(random, pair):
    """One thing that software does, as accesses (operation, byte)."""
    b = random.randrange(pair.boards)
    loads = (1 << pair.axes) - 1 << 4 | 0x0F  # no load of an axis that is not there

    def byte():
        return random.randrange(256)

    def to(register):
        return ("A", (pair.base + b) << 5 | register)

    def divisor():
        choices = (random.randrange(13), random.randrange(80), 300, 0x10000, 0xFFFFFF, 0)
        return random.choice(choices).to_bytes(3, "little")

    kind = random.choice(COMMANDS)
    if kind == "divisors":
        first = random.randrange(4)
        most = 4 if pair.axes == 4 else 4 - first  # past 1F come 00 .. 03, and they may load
        data = b"".join(divisor() for _ in range(random.randint(1, most)))
        return [to(0x10 + 3 * first), *(("W", d) for d in data)]
    if kind == "divisor":
        return [to(0x10 + random.randrange(12)), ("W", byte())]
    if kind == "control":
        return [to(0x1C), ("W", random.choice((byte(), 0xFF, 0xAA, 0xFB)))]
    if kind == "codes":
        few = lambda: random.choice((random.randrange(0xF0, 0x100), 0xFE, 0xFF, 0, 0xE0))  # noqa: E731
        return [to(0x1D), ("W", few()), ("W", few())]
    if kind == "outputs":
        return [to(0x1F), ("W", byte()), to(0x0F), ("W", byte())]
    if kind == "release":
        feed = [to(0x10 + 3 * random.randrange(3)), *[("W", d) for d in divisor() + divisor()]]
        leave = [to(0x1F), ("W", 0), to(0x1F), ("W", 0x80 | byte())]
        return random.choice((feed + leave, leave + feed, feed, leave))
    if kind == "timer":
        value = random.choice((0x00, 0x10, 0x11, 0x12, 0x1F, 0x20, 0x30, 0x31, 0x01, byte()))
        return [to(0x04), ("W", value)]
    if kind == "load":
        data = [("W", byte()) for _ in range(random.randint(1, 3))]
        return [to(0x0C), ("W", byte() & loads), to(0), *data, to(3), ("W", 0)]
    if kind == "encoders":
        register = random.choice((0x03, 0x0C, 0x0D, 0x06))
        return [to(register), ("W", random.choice((byte(), 0, 0x0F)) & loads)]
    if kind == "read":
        first = random.choice((0, 3, 6, 9, 0x0C, 0x0D, 0x0E, 0x0F, 0x10))
        return [to(first), *[("R", 0)] * random.randint(1, 8)]
    if kind == "cycle":
        return [to(4), ("W", 0x20), to(4), ("W", 0x00), to(0), *[("R", 0)] * 15]
    if kind == "any":
        register = random.randrange(32)
        if register in (0x02, 0x03, 0x0B, 0x0C) or pair.axes < 4:
            register = 0x1A
        return [("A", random.randrange(8) << 5 | register), *[("W", byte())] * random.randint(1, 2)]
    if kind == "byte":
        return [(random.choice("Ra"), byte())]
    return [("A", byte()), ("a", 0), ("R", 0)]


def with_times(random, accesses, flaws, pauses):
    """Make bus cycles of accesses; ``flaws``: how many in a thousand are illegal."""
    cycles = []
    pace = random.choice((5, 5, 6, 30))
    for op, byte in accesses:
        length, gap, flaw = 5, pace, random.choice((LEGAL, NWRITE_UP))
        if random.randrange(1000) < flaws:
            length = random.choice((1, 2, 3, 4, 7))
            gap = random.choice((0, 1, 2, 5))
            flaw = random.choice((LEGAL, BOTH, NWRITE_CHANGES, DATA_CHANGES))
        cycles.append((ord(op), byte, length, gap, flaw))
    op, byte, length, gap, flaw = cycles[-1]
    cycles[-1] = (op, byte, length, gap + random.randrange(random.choice(pauses)), flaw)
    return cycles


def traffic(random, pair, size, flaws=30, quiet=False, slower=1):
    """Random changes at all pins, and the cycle at which they end.

    Parameters
    ----------
    random : random.Random
    pair : Pair
    size : int
        Commands. Parts repeat, as it takes long to make them; what they meet does not.
    flaws : int
        Bus cycles in a thousand that are illegal; none where axes are absent, for they might load
        a position there.
    quiet : bool
        Long pauses, in which timers and slow axes have time to act; inputs are slower by 50.
    slower : int
        Time between changes of the inputs of boards, times this.
    """
    rng = np.random.default_rng(random.getrandbits(64))
    pauses = (1, 400, 4_000, 40_000) if quiet else (1, 1, 1, 40, 400)
    flaws = flaws if pair.axes == 4 else 0
    pool = [with_times(random, command(random, pair), flaws, pauses) for _ in range(min(size, 300))]
    start = [("A", pair.base << 5 | 0x10), *[("W", d) for d in (9, 0, 0, 20, 0, 0)]]
    start += [("A", pair.base << 5 | 0x1C), ("W", 0xFB), ("A", pair.base << 5 | 0x1F), ("W", 0xFF)]
    cycles = [legal(*start), *(pool[n] for n in rng.integers(len(pool), size=size))]
    changes, end = bus_changes([cycle for part in cycles for cycle in part], 3)
    parts = [changes]
    for b in range(pair.boards):
        parts += [board_changes(rng, pair, b, end, slower * (50 if quiet else 1))]
    resets = np.sort(rng.integers(end, size=rng.poisson(end / 200_000)))
    parts += [np.stack([resets, 0 * resets + NINIT, 0 * resets], 1)]
    lasts = resets + rng.integers(1, 20, size=len(resets))
    parts += [np.stack([lasts, 0 * lasts + NINIT, 0 * lasts + 1], 1)]
    return np.concatenate(parts), end + 50


def board_changes(rng, pair, b, end, slower):
    """Random changes of the inputs of a board: encoders that move and jump, and all others."""
    first = FIRST_BOARD_PIN + BOARD_PINS * b
    parts = []

    def add(times, pin, levels):
        inside = times < end
        pins = np.full(len(times), first + pin)
        parts.append(np.stack([times, pins, np.broadcast_to(levels, times.shape)], 1)[inside])

    for i in range(pair.axes):
        pace = rng.choice([3, 20, 400]) * slower
        times = np.cumsum(1 + rng.geometric(1 / pace, size=end // pace))
        turns = np.where(rng.random(len(times)) < 0.02, -1, 1)
        steps = np.cumprod(turns) * np.where(rng.random(len(times)) < 0.02, 2, 1)
        phase = np.cumsum(steps) % 4
        add(times, A + i, (phase % 3 != 0).astype(int))
        add(times, B + i, (phase >= 2).astype(int))
        # the index: short pulses, some near the edges of the encoder
        rises = np.cumsum(1 + rng.geometric(1 / 300 / slower, size=end // 300 // slower))
        add(rises, INDEX + i, 1)
        add(rises + rng.integers(1, 12, size=len(rises)), INDEX + i, 0)
    times = np.cumsum(1 + rng.geometric(1 / 100 / slower, size=end // 100 // slower))
    pins = rng.integers(15, size=len(times))
    parts.append(np.stack([times, first + DIN + pins, rng.integers(2, size=len(times))], 1))
    opens = np.cumsum(1 + rng.geometric(1 / 20_000, size=end // 20_000))
    add(opens, CHAIN, 0)
    add(opens + rng.integers(1, 300, size=len(opens)), CHAIN, 1)
    return np.concatenate(parts)
