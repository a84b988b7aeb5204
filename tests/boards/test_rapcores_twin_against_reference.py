"""The twin against the specification clock by clock: every pin, every cycle, and what is inside."""

import random
from dataclasses import dataclass, field

import numpy as np
import pytest
from rapcores_reference import Reference, wrap

from pulsewright.boards.rapcores.twin import RapcoresTwin

STATUS = [*range(9), 0x44, 0x45, 0x84, 0x85, 0xC0, 0xC1, *range(0xE0, 0xEB), 0xFE, 0xFF, 0xB0]
CONFIGURATION = [0, 1, 2, 3, *range(0xC0, 0xC8)]


@dataclass
class Stimulus:
    """Changes of input pins, made as a host would."""

    bits: int
    cycle: int = 260
    events: list = field(default_factory=list)

    def set(self, pin, level, cycle=None):
        self.events.append((self.cycle if cycle is None else cycle, pin, level))

    def frame(self, data, half, bits=None, gap=None):
        """Send bytes, or just the first ``bits`` of them, in a frame."""
        bits = 8 * len(data) if bits is None else bits
        self.set("cs", 0)
        self.cycle += half
        for k in range(bits):
            self.set("copi", data[k // 8] >> (7 - k % 8) & 1)
            self.set("sck", 1, self.cycle + half)
            self.cycle += 2 * half
            self.set("sck", 0)
        self.cycle += half
        self.set("cs", 1)
        self.cycle += 2 * half if gap is None else gap

    def words(self, words, half=2, **cut):
        size = self.bits // 8
        self.frame(
            b"".join((w % 2**self.bits).to_bytes(size, "little") for w in words), half, **cut
        )

    def header(self, byte, rest=0):
        return byte << (self.bits - 8) | rest

    def write(self, address, value, half=2):
        self.words([self.header(0xF2, address), value], half)

    def move(self, duration, motors, half=2, **cut):
        words = [self.header(1), duration]
        for increment, change in motors:
            words += [increment, change]
        self.words(words, half, **cut)


def replayed(reference, events, end):
    """Run the reference up to ``end``; return the edges at which each of its pins changes."""
    pins = dict.fromkeys(("sck", "copi"), 0) | {"rst_n": 1, "cs": 1, "halt": 1}
    pins |= {f"enc{e}_{pin}": 0 for e in range(reference.E) for pin in "ab"}
    changes = {}
    for cycle, pin, level in events:
        changes.setdefault(cycle, []).append((pin, level))
    before = reference.outputs()
    edges = {pin: [] for pin in before}
    for cycle in range(end + 1):
        for pin, level in changes.get(cycle, ()):
            pins[pin] = level
        reference.clock(pins)
        now = reference.outputs()
        if now != before:
            for pin, level in now.items():
                if level != before[pin]:
                    edges[pin].append(cycle)
            before = now
    return edges


def check(reference, twin, events, end, cuts=()):
    """Run both, the twin in pieces, and compare what they show and what they hold."""
    edges = replayed(reference, events, end)
    cycles, pins, levels = zip(*events, strict=True)
    twin.schedule(cycles, list(pins), levels)
    traces = []
    for cut in sorted({*cuts, end}):
        twin.advance(cut)
        traces.append(twin.drain())
    twin.advance(end + 1)
    traces.append(twin.drain())
    for n, pin in enumerate(twin.output_pins):
        seen = np.concatenate([trace.cycles[n] for trace in traces]).tolist()
        assert seen == edges[pin], pin
    # the reference has done edge ``end``, the twin one more, which nothing comes at
    reference.clock(
        dict.fromkeys(("rst_n", "cs", "halt"), 1)
        | dict.fromkeys(("sck", "copi"), 0)
        | {f"enc{e}_a": reference.encoders[e].a[0] for e in range(reference.E)}
        | {f"enc{e}_b": reference.encoders[e].b[0] for e in range(reference.E)}
    )
    state, shift = twin.state(), 64 - reference.W
    motors = reference.motors
    assert state["position"] == [reference.position(i) for i in range(reference.N)]
    assert [f >> shift for f in state["fraction"]] == [m.acc % (1 << reference.F) for m in motors]
    assert [n >> shift for n in state["increment"]] == [m.inc for m in motors]
    assert state["backlog"] == [m.backlog for m in motors]
    assert state["lost"] == [bool(m.lost) for m in motors]
    assert state["encoder_position"] == [e.position for e in reference.encoders]
    assert state["encoder_velocity"] == [e.velocity for e in reference.encoders]
    assert state["fault"] % 2**64 == reference.fault
    names = ("completed", "refused", "framing", "aborted", "unknown")
    assert [state[name] for name in names] == list(reference.counters.values())
    assert state["used"] == reference.use
    assert state["ticks_left"] == (reference.left if reference.run else 0)
    return edges


def encoder_events(rng, stimulus, encoders, start, end, busy):
    """Let encoders move, bounce and jump."""
    for e in range(encoders):
        cycle, levels = start, [0, 0]
        while (cycle := cycle + rng.choice((1, 2, 5, 40, busy, busy))) < end:
            which = rng.choice(("a", "b", "a", "b", "ab"))
            for pin in which:
                levels["ab".index(pin)] ^= 1
                stimulus.set(f"enc{e}_{pin}", levels["ab".index(pin)], cycle)


def random_speed(rng, bits):
    """Return an increment and its change: fast, slow, still, turning soon or at the limit."""
    unit = 1 << (bits - 1)
    speed = int(rng.choice((0, 0.01, 0.1, 0.3, 0.7, 0.99)) * unit * rng.choice((-1, 1)))
    change = rng.choice((0, 0, rng.randrange(-unit // 50, unit // 50), rng.randrange(-unit, unit)))
    if rng.random() < 0.3:  # turns inside the move
        change = -speed // rng.randrange(1, 60)
    if rng.random() < 0.1:
        speed = rng.choice((unit - 1, -unit))
    return speed, change


@pytest.mark.parametrize("seed", range(10))
def test_random_hosts(seed):
    """Moves, reads, writes, halts, cut frames and moving encoders, all at random."""
    rng = random.Random(seed)
    bits = rng.choice((32, 32, 64))
    motors, encoders = rng.choice(((1, 1), (2, 3), (3, 1), (2, 0)))
    depth = rng.choice((2, 2, 4))
    switches = {"cs_reset_message": rng.choice((0, 1, 1)), "v020_info": int(bits == 64)}
    stimulus = Stimulus(bits)
    divider = rng.choice((0, 0, 1, 2, 5, 9, 255))
    stimulus.write(2, divider)
    for address in range(0xC0, 0xC4):
        stimulus.write(address, rng.choice((0, 1, 2, 3, 7)))
    stimulus.write(0, rng.randrange(8))
    while stimulus.cycle < 22_000:
        kind = rng.random()
        if kind < 0.45:
            duration = rng.choice((0, 1, 2, 7, 50, 400, 3000 // (divider + 1)))
            speeds = [random_speed(rng, bits) for _ in range(motors)]
            cut = {"bits": rng.randrange(1, 6 * bits)} if rng.random() < 0.06 else {}
            stimulus.move(duration, speeds, rng.choice((2, 2, 3)), **cut)
        elif kind < 0.6:
            words = [stimulus.header(0xF1, rng.choice(STATUS)), 0]
            stimulus.words(words, 6, gap=rng.choice((1, 2, 9)))
        elif kind < 0.7:
            address = rng.choice(CONFIGURATION)
            value = rng.choice((0, 1, 2, 3, 5, 8, 30)) if address != 0xC4 else 0
            stimulus.write(address, value, rng.choice((2, 6)))
        elif kind < 0.74:
            stimulus.write(0xC4, 1)
            stimulus.cycle += rng.choice((0, 300))
            stimulus.write(0xC4, 0)
            stimulus.write(0xC5, 8)
        elif kind < 0.8:
            stimulus.write(0xC5, rng.choice((15, 8, 1, 2, 4)))
        elif kind < 0.88:
            words = [stimulus.header(rng.choice((0, 3, 0x55, 0xF3, 0xFD, 0xFE)), 1), 7]
            stimulus.words(words, 6)
        elif kind < 0.92:
            length = rng.choice((1, 2, 50))
            start = stimulus.cycle + rng.randrange(400)
            stimulus.set("halt", 0, start)
            stimulus.set("halt", 1, start + length)
            if rng.random() < 0.8:
                stimulus.cycle = start + length
                stimulus.write(0xC5, 8)
        elif kind < 0.94:
            stimulus.set("rst_n", 0)
            stimulus.set("rst_n", 1, stimulus.cycle + rng.choice((1, 3)))
            stimulus.cycle += 270
            stimulus.write(2, divider)
        else:
            stimulus.cycle += rng.randrange(2000)
    encoder_events(rng, stimulus, encoders, 100, stimulus.cycle, 300)
    end = stimulus.cycle + 2000
    options = {"motors": motors, "encoders": encoders, "depth": depth} | switches
    cuts = [rng.randrange(end) for _ in range(30)]
    twin = RapcoresTwin(word_bits=bits, bus_pins=True, **options)
    check(Reference(bits=bits, **options), twin, stimulus.events, end, cuts)


# ----------------------------------------------------------------------------- skipping, at length

UNIT = 1 << 63
DIVIDER = 9


def steps_of(moves):
    """Integrate moves of one motor tick by tick; return (tick, +1 or -1) of steps, and the rest."""
    acc, tick, steps, increment = 0, 0, [], 0
    for duration, begin, change in moves:
        increment = begin
        for _ in range(duration):
            before = acc >> 63
            acc += increment
            increment = wrap(increment + change, 64)
            if acc >> 63 != before:
                steps.append((tick, (acc >> 63) - before))
            tick += 1
    return steps, acc, increment


def words_of(*words):
    return b"".join((word % 2**64).to_bytes(8, "little") for word in words)


def played(moves):
    """Play moves of one motor back to back with all step times 1; return twin and trace."""
    twin = RapcoresTwin(motors=1, encoders=0, depth=64)
    free = 300
    for address, value in ((2, DIVIDER), (0xC0, 1), (0xC1, 1), (0xC2, 1), (0xC3, 1)):
        _, free = twin.transfer(free, words_of(0xF2 << 56 | address, value))
    # while a first move of no motion lasts, the others are sent
    lead = 400 * len(moves)
    for duration, increment, change in [(lead, 0, 0), *moves]:
        _, free = twin.transfer(free, words_of(1 << 56, duration, increment, change))
    ticks = lead + sum(duration for duration, _, _ in moves)
    twin.advance(free + (ticks + 3) * (DIVIDER + 1))
    assert not twin.state()["executing"]
    return twin, twin.drain()


def near_turn(rng):
    """Return moves that turn just before a step, just on it or just behind it."""
    ticks = rng.randrange(3, 3000)
    speed = rng.randrange(1, UNIT // ticks)
    change = -max(speed // ticks, 1)
    way = speed
    highest = total = 0
    for _ in range(ticks + 2):
        total += way
        way += change
        highest = max(highest, total)
    start = (UNIT - highest % UNIT) % UNIT + rng.randrange(-2, 3)
    start = min(max(start, 0), UNIT - 1)
    sign = rng.choice((1, -1))
    turn = (2 * ticks + rng.randrange(5), sign * speed, sign * change)
    return [(1, sign * start - (0 if sign == 1 else 1), 0), turn]


def any_moves(rng):
    moves = []
    for _ in range(rng.randrange(1, 4)):
        size = rng.choice((1, 2, 8, 30, 45, 62))
        speed = rng.randrange(-(1 << size), 1 << size)
        change = rng.choice((0, rng.randrange(-(1 << size), 1 << size) // rng.choice((50, 3000))))
        moves.append((rng.choice((1, 3, 40, 3000)), speed, change))
    return moves


def even_moves(rng):
    """Return moves of even speed, of which a step is a whole number of ticks, or nearly so."""
    moves = [(1, rng.randrange(-UNIT, UNIT), 0)]  # from anywhere
    for _ in range(rng.randrange(1, 4)):
        ticks = rng.choice((1, 2, 3, 4, 7, 8, 64, 1000, rng.randrange(2, 50)))
        speed = min(UNIT // ticks + rng.randrange(-2, 3), UNIT - 1)
        moves.append((rng.choice((30, 300, 3000)), rng.choice((1, -1)) * speed, 0))
    return moves


@pytest.mark.parametrize("make", [near_turn, any_moves, even_moves])
def test_steps_are_at_the_tick_that_crosses(make):
    """Also where ticks are skipped up to a turn at the very edge of a step."""
    rng = random.Random(5)
    found = 0
    for _ in range(60):
        moves = make(rng)
        twin, trace = played(moves)
        steps, acc, increment = steps_of(moves)
        first = int(trace["move_done"][0]) + DIVIDER + 1  # tick after the lead
        rises, direction = [], 1
        for tick, way in steps:
            # STEP is high from the third cycle after its tick on; after a turn, one later
            rises.append(first + tick * (DIVIDER + 1) + 2 + (way != direction))
            direction = way
        assert trace.edges("step0", 1).tolist() == rises
        state = twin.state()
        assert state["position"][0] == acc >> 63
        assert state["fraction"][0] == acc % UNIT
        assert state["increment"][0] == increment
        found += len(steps)
    assert found > 30


@pytest.mark.parametrize("ticks", [2**32 - 1, 2**31, 123_456_789])
def test_long_moves_end_where_their_formula_says(ticks):
    """Slow moves, some of which turn: n inc + n (n - 1) / 2 incinc, without a step lost."""
    rng = random.Random(ticks)
    for _ in range(4):
        speed = rng.randrange(-(1 << 43), 1 << 43)
        change = rng.choice((0, -2 * speed // ticks, rng.randrange(-1000, 1000)))
        twin, trace = played([(ticks, speed, change)])
        acc = ticks * speed + ticks * (ticks - 1) // 2 * change
        state = twin.state()
        assert state["position"][0] == acc >> 63
        assert state["fraction"][0] == acc % UNIT
        assert state["increment"][0] == speed + ticks * change
        ups = (np.searchsorted(trace["dir0"], trace.edges("step0", 1)) & 1) == 0
        assert 2 * np.count_nonzero(ups) - len(ups) == acc >> 63


# ----------------------------------------------------------------------------------- words and pins


@pytest.mark.parametrize("profile", ["document", "upstream", "v020"])
def test_frames_do_the_same_word_by_word_and_bit_by_bit(profile):
    """Replies, all other pins and state, with reads, moves, odd frames and a halt."""
    rng = random.Random(profile)
    quick, slow = (RapcoresTwin(profile, motors=2, bus_pins=pins) for pins in (False, True))
    free = 300
    header = {"document": (0, 1, 0xF1, 0xF2, 0xF3, 0x77), "upstream": (0, 1, 0xF1, 0xF2)}
    for round_ in range(60):
        kind = rng.choice(header.get(profile, (0, 1, 3, 0x0A, 0x20, 0x50, 0x51, 0xFD, 0xFE, 9)))
        words = [kind << 56 | rng.choice((0, 1, 2, 4, 0xC0, 0xE0, 0xE2)), rng.randrange(1, 40)]
        if kind == 1:
            size = 60 if profile == "document" else 63
            words += [rng.randrange(-(1 << size), 1 << size) for _ in range(2 * 2)]
        if rng.random() < 0.1:
            words.pop()
        data = words_of(*words)
        if rng.random() < 0.05 and profile == "document":
            data = data[:-3]
        if round_ == 30:
            for twin in (quick, slow):
                twin.schedule([free + 100, free + 150], "halt", [0, 1])
        for twin in (quick, slow):
            cycles = free + np.arange(40) * 7
            twin.schedule(cycles, "enc0_a", np.arange(40) % 2)
            twin.schedule(cycles[:20] + 3, "enc0_b", np.arange(20) % 2)
        half = rng.choice((6, 6, 6, 7, 3))
        answer, end = slow.transfer(free, data, half)
        assert quick.transfer(free, data, half) == (answer, end)
        free = end + rng.choice((0, 0, 500))
        assert quick.state() == slow.state() | {"cycle": quick.now, "t": quick.state()["t"]}
    one, other = quick.drain(), slow.drain()
    for pin in quick.output_pins[1:]:
        assert one[pin].tolist() == other[pin].tolist(), pin
