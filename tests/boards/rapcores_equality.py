"""Gateware and twin of RAPcores side by side: the same levels at the pins in, every pin compared.

A change of an input at a cycle is first sampled by that edge.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from pulsewright.boards.rapcores import registers as reg
from pulsewright.boards.rapcores.gateware import Rapcores
from pulsewright.boards.rapcores.twin import RapcoresTwin, input_pins
from pulsewright.boards.rtl_spi import RtlSpiBoard

READY = reg.RESET_CYCLES + 5
PIECE = 50_000  # cycles after which counters of the twin are looked at
COUNTERS = ("refused", "framing", "aborted", "unknown")
LATCHES = ("halt_seen", "fault", "lost")


class Pair:
    """One configuration of the board, compiled once.

    Parameters
    ----------
    component : callable
        Makes the gateware.
    shared_dda : int
        Of the gateware; its smallest divider is then that of all traffic.
    **options
        Those of twin and gateware.
    """

    def __init__(self, component=Rapcores, shared_dda=0, **options):
        gateware = component(shared_dda=shared_dda, **options)
        self.rtl = RtlSpiBoard(gateware, clock_hz=reg.CLOCK_HZ, listens=reg.RESET_CYCLES)
        self.least_divider = gateware.min_divider
        self.options = options
        self.profile = options.get("profile", reg.DEFAULT_PROFILE)
        self.word_bits = options.get("word_bits", reg.WORD_BITS)
        self.motors = options.get("motors", reg.MOTORS)
        self.encoders = options.get("encoders", reg.ENCODERS)
        self.bridges = options.get("motor_driver", 0)

    def run(self, traffic):
        """Run both from configuration to the end of the traffic; assert that all pins agree.

        Returns
        -------
        Counter
            What the board did: changes of pins by their name without number (``step`` counts
            rising edges), increments of the counters in `COUNTERS`, and how often there was
            something in `LATCHES`, looked at now and then.
        """
        twin = RapcoresTwin(bus_pins=True, **self.options)
        self.rtl.restart()
        changes = traffic.changes()
        twin.schedule(*changes.T)
        for n, pin in enumerate(twin.input_pins):
            mine = changes[changes[:, 1] == n]
            self.rtl.schedule(mine[:, 0], pin, mine[:, 2])
        seen, before = Counter(), dict.fromkeys((*COUNTERS, *LATCHES), 0)
        for cycle in [*range(PIECE, traffic.at, PIECE), traffic.at]:
            twin.advance(cycle)
            state = twin.state()
            now = {name: state[name] for name in COUNTERS}
            now |= {name: int(np.any(state[name])) for name in LATCHES}
            for name, old in before.items():
                # a counter that is less than it was has been cleared
                seen[name] += now[name] - old if now[name] >= old else now[name]
            before = {name: now[name] for name in before}
        self.rtl.advance(traffic.at)
        trace, other = twin.drain(), self.rtl.drain()
        difference = trace.first_difference(of_pins(other, trace.pins))
        assert difference is None, f"twin and gateware: {difference}"
        for pin in trace.pins:
            name = "phase" if pin.startswith("phase") else pin.rstrip("0123456789")
            edges = trace.edges(pin, 1) if name == "step" else trace[pin]
            seen[name] += len(edges)
        return seen


def of_pins(trace, pins):
    """Return a trace with some of its pins, in that order."""
    places = [trace.pins.index(pin) for pin in pins]
    cycles = tuple(trace.cycles[n] for n in places)
    return replace(trace, pins=pins, initial=trace.initial[places], cycles=cycles)


# -------------------------------------------------------------------------------- what goes to pins


class Traffic:
    """Levels for the input pins of a board.

    Parameters
    ----------
    pair : Pair

    Attributes
    ----------
    at : int
        Cycle at which the next frame may start, and up to which traffic is.
    divider : int
        As the host has set it.
    halted : bool
        There may have been a halt that the host has not cleared.
    """

    def __init__(self, pair):
        self.pair, self.at, self.divider = pair, READY, reg.W_DIVIDER_RESET
        self.halted = False
        self._pins = input_pins(pair.encoders)
        self._changes = [np.zeros((0, 3), np.int64)]

    def set(self, pin, cycles, levels):
        """Set a pin at some cycles to one level or one each."""
        cycles = np.atleast_1d(cycles)
        part = np.empty((len(cycles), 3), np.int64)
        part[:, 0], part[:, 1], part[:, 2] = cycles, self._pins.index(pin), levels
        self._changes.append(part)

    def low(self, pin, cycle, clocks):
        """Pull a pin low for some clocks."""
        self.set(pin, [cycle, cycle + clocks], [0, 1])

    def frame(self, data, low, high, *, lead=6, tail=6, gap=12, bits=None, copi_after=None):
        """Send the first bits of some bytes in a frame.

        Parameters
        ----------
        low, high : (8 * bytes,) int, or one for all
            How long SCK is low before it rises, and high, for each bit.
        lead, tail, gap : int
            From the fall of CS to the first bit, from the last fall of SCK to the rise of CS
            (``-high[-1]`` and more), and of CS high; ``gap`` at least 1.
        copi_after : (8 * bytes,) int, optional
            Levels of COPI from the clock after that in which SCK rises. Otherwise COPI changes as
            SCK falls.

        Returns
        -------
        (n,) int64
            Cycles at which SCK falls.
        """
        levels = np.unpackbits(np.frombuffer(data, np.uint8))[:bits].astype(np.int64)
        low, high = (np.broadcast_to(part, 8 * len(data))[: len(levels)] for part in (low, high))
        falls = self.at + lead + np.cumsum(low + high)
        rises = falls - high
        self.set("cs", self.at, 0)
        if copi_after is None:
            self.set("copi", rises - low, levels)
        else:
            self.set("copi", rises, levels)
            self.set("copi", rises + 1, copi_after[: len(levels)])
        self.set("sck", rises, 1)
        self.set("sck", falls, 0)
        end = int(falls[-1]) + tail if len(falls) else self.at + lead
        end = max(end, self.at + 1)
        self.set("cs", end, 1)
        self.at = end + gap
        return falls

    def changes(self):
        """Return changes of the input pins (n, 3) up to ``at``: cycle, number and level."""
        changes = np.concatenate(self._changes)
        changes = changes[changes[:, 0] <= self.at]
        # stable, so that the last change of a pin at a cycle is the one that counts
        return changes[np.lexsort((changes[:, 1], changes[:, 0]))]


# ----------------------------------------------------------------------------------- random traffic

HALVES = (2, 2, 2, 3, 4, 5, 6, 7, 8)
STEP_TIMES = (0, 1, 1, 2, 2, 3, 5, 9, 20, 60)
DIVIDERS = (0, 0, 1, 1, 2, 3, 4, 7, 9, 20, 40)
STATUS = (
    *range(9), *range(0x44, 0x4B), *range(0x84, 0x8B), *range(0xC0, 0xC9), *range(0xE0, 0xEC),
    0xA3, 0xA4, 0xBF, 0xDF, 0xFD, 0xFE, 0xFF,
)  # fmt: skip
CONFIGURATION = (*range(4), *range(0xC0, 0xC9))
UNKNOWN_HEADERS = (0x02, 0x03, 0x0A, 0x55, 0xF0, 0xF3, 0xF4, 0xFD, 0xFE, 0xFF)
V020_HEADERS = (0x03, 0x0A, 0x0B, 0x10, 0x30, 0x31, 0x32, 0x50, 0x51, 0xFD, 0xFE)
TWO_WORDS_V020 = (0x03, 0x50, 0x51, 0xFE)
DOCUMENT_KINDS = (
    *("move",) * 14, *("status",) * 6, *("read",) * 2, *("swap",) * 3, *("time",) * 4,
    *("divider",) * 2, *("clear",) * 5, "halt", "software halt", "unknown", "nop", "pause",
)  # fmt: skip
ORIGINAL_KINDS = (
    *("move",) * 12, *("status",) * 4, *("swap",) * 2, *("divider",) * 3, *("pause",) * 8,
    "unknown", "nop",
)  # fmt: skip


def speed(random, bits):
    """Return an increment and what it grows by: fast, slow, still, turning soon, at a limit."""
    unit = 1 << bits - 1
    kind = random.randrange(10)
    if kind == 0:
        return random.choice((unit - 1, -unit, unit // 2, -unit // 2)), random.choice((0, 1, -1))
    if kind == 1:
        return random.randrange(-unit, unit), random.randrange(-unit, unit)
    increment = int(random.choice((0, 0.01, 0.1, 0.3, 0.7, 0.99)) * unit)
    increment *= random.choice((-1, 1))
    if kind < 5:  # turns inside the move
        return increment, -increment // random.randrange(1, 60)
    return increment, random.choice((0, 0, random.randrange(-unit // 50, unit // 50)))


def move(random, traffic):
    """Words of a move that takes some message times, or none."""
    pair = traffic.pair
    clocks = random.choice((0, 300, 2000, 6000, 6000, 15_000, 40_000))
    if pair.profile != "document":  # a move too many stops the board for long
        clocks //= random.choice((1, 4, 4, 8))
    ticks = clocks // (traffic.divider + 1)
    duration = random.choice((random.randrange(4), random.randrange(ticks + 1)))
    if pair.profile == "document" and random.randrange(60) == 0:
        duration = random.choice((0xFFFF, 0x10000, 0xFFFFFFFF))  # a halt ends it
        halt(random, traffic)
    words = [header(pair, reg.HEADER_MOVE, random.getrandbits(24)), duration]
    for _ in range(pair.motors):
        words += speed(random, pair.word_bits)
    return words


def header(pair, byte, rest=0):
    return byte << pair.word_bits - 8 | rest


def halt(random, traffic):
    """Pull HALT low some time from now, for some time."""
    clocks = random.choice((1, 2, 3, 50, 3000))
    traffic.halted = True
    traffic.low("halt", traffic.at + random.randrange(1, 9000), clocks)


def swap(pair, address, value):
    return [header(pair, reg.HEADER_CONFIG_SWAP, address), value]


def divider(random, traffic):
    """Words that set another divider."""
    pair = traffic.pair
    value = random.choice((random.choice(DIVIDERS), random.randrange(60), random.randrange(256)))
    if pair.profile != "document" and random.randrange(4):
        value = value % 16 + 1  # with 0 the board stops
    traffic.divider = value = max(value, pair.least_divider)
    above = random.choice((0, random.getrandbits(24) << 8))  # without effect
    if pair.profile == "v020":
        return [header(pair, reg.HEADER_V020_DIVIDER, above | value)]
    return swap(pair, reg.W_DIVIDER, above | value)


def message(random, traffic):
    """Words of one message, of some, or of none."""
    pair = traffic.pair
    kind = random.choice(DOCUMENT_KINDS if pair.profile == "document" else ORIGINAL_KINDS)
    if traffic.halted and random.randrange(4) == 0:
        traffic.halted, kind = False, "clear"
    dummy = random.getrandbits(pair.word_bits)
    if kind == "move":
        return move(random, traffic)
    if kind == "divider":
        return divider(random, traffic)
    if kind == "nop":
        return [header(pair, reg.HEADER_NOP, random.getrandbits(16))]
    if pair.profile == "v020" and kind != "pause":
        byte = random.choice((*V020_HEADERS, random.getrandbits(8)))
        if byte in (reg.HEADER_MOVE, reg.HEADER_V020_DIVIDER):
            byte = reg.HEADER_V020_ENCODER
        channel = random.choice((random.randrange(6), random.getrandbits(8)))
        head = header(pair, byte, channel << 48 | random.getrandbits(48))
        return [head, dummy] if byte in TWO_WORDS_V020 else [head]
    if kind == "status":
        middle = random.choice((0, 0, random.getrandbits(12) << 8))
        return [header(pair, reg.HEADER_STATUS_READ, random.choice(STATUS) | middle), dummy]
    if kind == "read":
        places = CONFIGURATION + reg.W_CURRENT[: (pair.motors + 1) * pair.bridges]
        return [header(pair, reg.HEADER_CONFIG_READ, random.choice(places)), dummy]
    if kind == "swap":
        address = random.choice((0, 0, 1, 3, 0xC6, 0xC7, 0xC8, 0xFF))
        if pair.bridges and random.randrange(3):
            address = random.choice((1, *reg.W_CURRENT[: pair.motors + 1]))
        return swap(pair, address, random.getrandbits(pair.word_bits))
    if kind == "time":
        low = random.choice((*STEP_TIMES, *STEP_TIMES, random.randrange(500)))
        above = random.choice((0, random.getrandbits(16) << 16))
        return swap(pair, random.randrange(reg.W_STEP_WIDTH, reg.W_DIR_HOLD + 1), above | low)
    if kind == "clear":
        return swap(pair, reg.W_CLEAR, random.choice((8, 8, 8, 0xC, 0xF, random.getrandbits(16))))
    if kind == "halt":
        halt(random, traffic)
        return []
    if kind == "software halt":
        traffic.halted = True
        return [*swap(pair, reg.W_CONTROL, random.choice((1, 3))), *swap(pair, reg.W_CONTROL, 0)]
    if kind == "unknown":
        byte = random.choice((*UNKNOWN_HEADERS, random.randrange(2, 0xF1)))
        rest = random.randrange(6) << 48 if pair.word_bits == reg.WORD_BITS else 0
        return [header(pair, byte, rest | random.choice(STATUS)), dummy]
    traffic.at += random.randrange(random.choice((10, 3000, 20_000)))
    return []


def send(random, traffic, words, flaws):
    """Send words in one frame; say whether it has a flaw.

    Parameters
    ----------
    flaws : int
        Frames in a thousand that have one.
    """
    pair = traffic.pair
    size = pair.word_bits // 8
    data = b"".join((w % (1 << pair.word_bits)).to_bytes(size, "little") for w in words)
    bits = 8 * len(data)
    numpy = np.random.default_rng(random.getrandbits(32))
    half = random.choice((*HALVES, random.randrange(1, 20)))
    low, high = half, half
    if random.randrange(8) == 0:
        low, high = numpy.integers(1, random.choice((3, 5, 14)), (2, bits))
    options = {
        "lead": random.choice((6, half, random.randrange(12))),
        "tail": random.choice((6, half, 1, 2, 3, 4, 5)),
        "gap": random.choice((1, 2, 3, 4, 5, 6, 12, 12, 2 * half, random.randrange(1, 200))),
    }
    if random.randrange(6) == 0:
        options["copi_after"] = numpy.integers(0, 2, bits)
    start = traffic.at
    kind = random.randrange(10) if random.randrange(1000) < flaws else -1
    if kind == 0:  # too few bits
        options["bits"] = random.randrange(bits)
    elif kind == 1:  # bytes or words too few
        unit = random.choice((8, pair.word_bits))
        options["bits"] = unit * random.randrange(bits // unit)
    elif kind == 2:  # CS rises with SCK, or before it falls
        options["tail"] = random.choice((0, 0, -1))
    elif kind == 3:  # bytes too many
        data += bytes(random.randrange(256) for _ in range(random.randrange(1, 2 * size)))
        low, high, options["copi_after"] = half, half, None
    falls = traffic.frame(data, low, high, **options)
    end = traffic.at
    if not len(falls):
        return True
    if kind in (4, 5):  # CS high for a moment: between words, bytes, or bits, or anywhere
        step = random.choice((1, 8, pair.word_bits))
        fall = random.choice(falls[step - 1 :: step].tolist() or [start + 2])
        cycle = max(fall + random.choice((-3, -2, -1, 0, 1, 2, 3, half)), start + 1)
        traffic.set("cs", [cycle, cycle + random.choice((1, 1, 2, 3, 4, 5, 9))], [1, 0])
        traffic.set("cs", max(end - options["gap"], cycle + 10), 1)
        traffic.at = max(end, cycle + 11)
    elif kind == 6:  # SCK while CS is high
        cycles = end + np.cumsum(numpy.integers(1, 9, random.randrange(1, 40)))
        traffic.set("sck", cycles, np.arange(len(cycles)) + 1 & 1)
        traffic.set("sck", cycles[-1] + 1, 0)
        traffic.at = int(cycles[-1]) + random.randrange(1, 9)
    elif kind == 7:  # SCK anywhere
        for _ in range(random.randrange(1, 4)):
            cycle = random.randrange(start, end)
            traffic.set("sck", [cycle, cycle + random.choice((1, 1, 2, 5))], [1, 0])
    elif kind == 8:  # COPI anywhere
        cycles = numpy.integers(start, end, 20)
        traffic.set("copi", cycles, numpy.integers(0, 2, 20))
    elif kind == 9:  # frames of nothing
        for _ in range(random.randrange(1, 5)):
            traffic.low("cs", traffic.at, random.choice((1, 2, 3, 9)))
            traffic.at += random.randrange(10, 15)
    return kind >= 0


def spared(pair, words):
    """Say whether a flaw must not meet these words: the divider may not become too small."""
    return pair.least_divider > 0 and words[:1] == swap(pair, reg.W_DIVIDER, 0)[:1]


def turn(random, traffic):
    """Let all encoders turn to and fro up to the end, and sometimes change both lines at once."""
    for e in range(traffic.pair.encoders):
        numpy = np.random.default_rng(random.getrandbits(32))
        # phases, each with a pace of its own
        count = max(traffic.at // 10_000, 1)
        pace = np.repeat(
            numpy.choice([1, 2, 3, 30, 300, 2000], count), numpy.integers(1, 60, count)
        )
        cycles = numpy.choice([1, 5000]) + np.cumsum(numpy.integers(1, pace + 1))
        way = np.where(numpy.random(len(pace)) < 0.97, np.sign(np.sin(np.cumsum(pace) / 700)), -1)
        way[numpy.random(len(pace)) < 0.003] = 2
        phase = np.cumsum(way.astype(np.int64)) + numpy.integers(4)
        traffic.set(f"enc{e}_a", cycles, phase >> 1 & 1)
        traffic.set(f"enc{e}_b", cycles, (phase + 1 & 2) // 2)


def reset(random, traffic):
    """Pull the reset pin low, and be quiet for a while or not at all."""
    clocks = random.choice((1, 1, 2, 5, random.randrange(1, 3000)))
    traffic.low("rst_n", traffic.at - random.randrange(min(traffic.at - 1, 2000)), clocks)
    traffic.at += random.choice((0, clocks, clocks + READY, clocks + READY, clocks + READY))
    traffic.divider = reg.W_DIVIDER_RESET


def busy(random, pair, clocks, *, flaws=60, turning=True):
    """Return random traffic for at least so many clocks."""
    traffic = Traffic(pair)
    # The originals do not find back from a flaw by themselves.
    rounds, patience = (400, 400) if pair.profile == "document" else (60, 2)
    if pair.profile == "document":
        send(random, traffic, swap(pair, reg.W_ENABLE, random.getrandbits(32)), 0)
        for address in range(reg.W_STEP_WIDTH, reg.W_DIR_HOLD + 1):
            send(random, traffic, swap(pair, address, random.choice((1, 2, 5))), 0)
        for address in reg.W_CURRENT[: pair.motors * pair.bridges]:
            current = random.choice((255, random.randrange(256)))
            send(random, traffic, swap(pair, address, current), 0)
    while traffic.at < clocks:
        flawed = talk(random, traffic, flaws)
        if random.randrange(patience if flawed else rounds) == 0:
            reset(random, traffic)
    traffic.at += 5000
    if turning:
        turn(random, traffic)
    return traffic


def talk(random, traffic, flaws):
    """Send one message, or some in one frame; say whether it has a flaw."""
    words = message(random, traffic)
    spare = spared(traffic.pair, words)
    if not spare and random.randrange(4) == 0:
        words += [word for _ in range(2) for word in message(random, traffic)]
        spare = traffic.pair.least_divider > 0  # there may be a divider among them
    return bool(words) and send(random, traffic, words, 0 if spare else flaws)
