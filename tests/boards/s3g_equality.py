"""Gateware and twin of the S3G side by side: the same levels at the pins in, every pin compared.

Changes of input pins are arrays (n, 3) of cycle, pin and level; pins are numbers in
`INPUT_PINS` of the twin. The first edge that samples a level is that of its cycle.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from pulsewright.boards.s3g import packets
from pulsewright.boards.s3g import registers as s3g
from pulsewright.boards.s3g.gateware import S3G, pins
from pulsewright.boards.s3g.twin import INPUT_PINS, S3GTwin
from pulsewright.gateware.rtl import RtlSimulation

FAST = {"baud1": 3_125_000, "baud2": 3_125_000, "ints_timer": 20_000}
BYTE = 10  # bits, with start and stop
READY = s3g.READY_CYCLES + 20


class Pair:
    """One configuration of the board, compiled once.

    Parameters
    ----------
    gateware : callable
        Makes the component.
    **options
        Those of twin and gateware.
    """

    def __init__(self, gateware=S3G, **options):
        self.options = options
        self.channels = options.get("channels", s3g.CHANNELS)
        self.words = options.get("prog_words", s3g.PROG_WORDS)
        bauds = (options.get("baud1", s3g.BAUD1), options.get("baud2", s3g.BAUD2))
        self.bits = tuple(s3g.CLOCK_HZ / baud for baud in bauds)  # clocks
        self.rtl = RtlSimulation(gateware(**options))

    def run(self, traffic, end):
        """Run both from configuration up to edge ``end``, not included; assert that all pins agree.

        Returns
        -------
        Counter
            What the board did, as far as it can be seen from outside; see `Traffic.seen`.
        """
        changes = traffic.changes(end)
        twin = S3GTwin(bus_pins=True, **self.options)
        if len(changes):
            twin.schedule(*changes.T)
        twin.advance(end)
        trace = twin.drain()
        self.rtl.reset()
        before = dict(zip(trace.pins, trace.initial, strict=True))
        here = self._outputs(self.rtl.run(end, self._stimulus(changes)), before)
        first = []
        for pin in trace.pins:
            there, mine = trace[pin], here[pin]
            if not np.array_equal(there, mine):
                common = min(len(there), len(mine))
                differs = np.flatnonzero(there[:common] != mine[:common])
                n = differs[0] if len(differs) else common
                both = there[n : n + 4].tolist(), mine[n : n + 4].tolist()
                first.append((min(times[0] for times in both if times), pin, *both))
        if first:
            cycle, pin, there, mine = min(first)
            raise AssertionError(
                f"cycle {cycle}: {pin} changes at {there} in the twin, at {mine} in the gateware; "
                f"others: {[row[:2] for row in sorted(first)[1:]]}"
            )
        seen = traffic.seen([twin.receive(port) for port in (1, 2)])
        for c in range(self.channels):
            seen["step"] += len(trace[f"mot{c}_step"]) // 2
            seen["turn"] += len(trace[f"mot{c}_dir"])
        return seen

    def _stimulus(self, changes):
        """Return rows of all inputs: one for each cycle with a change."""
        at = np.unique(np.append(0, changes[:, 0]))
        rows = np.zeros(len(at), self.rtl.inputs)
        rows["cycle"] = at
        for n, pin in enumerate(INPUT_PINS):
            mine = changes[changes[:, 1] == n]
            level = np.append(1, mine[:, 2])
            rows[pin] = level[np.searchsorted(mine[:, 0], at, side="right")]
        return rows

    def _outputs(self, rows, before):
        """Return the cycles at which each output pin changes, from levels before the first."""
        ports = pins(self.channels) | {"avr_rx": ("avr_rx", 0), "ext_rx": ("ext_rx", 0)}
        assert ports.keys() == before.keys()
        changes = {}
        for pin, (port, bit) in ports.items():
            level = np.append(before[pin], rows[port].astype(np.int64) >> bit & 1)
            changes[pin] = rows["cycle"][np.flatnonzero(np.diff(level))]
        return changes


# -------------------------------------------------------------------------------- what goes to pins


class Traffic:
    """Bytes and levels for the pins of a board, and what became of the requests among them.

    Parameters
    ----------
    pair : Pair
    """

    def __init__(self, pair):
        self._bits = pair.bits
        self._bytes = []  # start, clocks per bit, byte, level of the stop bit, port
        self._levels = []
        self._requests = {}
        self.free = [READY, READY]  # cycle from which on a line is free

    def send(self, port, data, cycle, *, pace=1.0, bad_stop=None, gap=0):
        """Send bytes from a cycle on, or as soon as the line is free; return when they are out.

        Parameters
        ----------
        pace : float
            Length of bits, times that of the baud rate.
        bad_stop : int, optional
            Byte with a low stop bit.
        gap : int
            Clocks between bytes.
        """
        bit = self._bits[port] * pace
        start = max(cycle, self.free[port])
        for n, byte in enumerate(data):
            self._bytes.append((start, bit, byte, n != bad_stop, port))
            start += BYTE * bit + gap
        self.free[port] = int(start) + 1
        return self.free[port]

    def glitch(self, port, cycle, clocks):
        """Pull a line low for some clocks, as soon as it is free."""
        start = max(cycle, self.free[port])
        self._bytes.append((start, clocks, 0xFF, True, port))
        self.free[port] = start + BYTE * clocks

    def low(self, pin, cycle, clocks):
        """Pull ``rst_n`` or ``cclk`` low for some clocks."""
        n = INPUT_PINS.index(pin)
        self._levels += [(cycle, n, 0), (cycle + clocks, n, 1)]

    def tag(self, code, arguments):
        """Return the payload of a request with a tag of its own, 0..0xFFFE."""
        tag = len(self._requests) % 0xFFFF
        self._requests[tag] = (code, arguments)
        return bytes((tag & 0xFF, tag >> 8, code)) + arguments

    def changes(self, end):
        """Return changes of the input pins before a cycle, in order."""
        parts = [np.array(self._levels, np.int64).reshape(-1, 3)]
        if self._bytes:
            start, bit, byte, stop, port = np.array(self._bytes).T
            byte = byte.astype(np.int64)
            levels = [0 * byte, *(byte >> n & 1 for n in range(8)), stop, 0 * byte + 1]
            for n, level in reversed([*enumerate(levels)]):  # a start bit may come with the last
                parts.append(np.stack([start + n * bit, port, level], 1).astype(np.int64))
        changes = np.concatenate(parts)
        changes = changes[changes[:, 0] < end]
        changes = changes[np.lexsort((changes[:, 1], changes[:, 0]))]  # stable: the last one counts
        last = np.ones(len(changes), bool)
        last[:-1] = np.any(changes[1:, :2] != changes[:-1, :2], axis=1)
        return changes[last]

    def seen(self, heard):
        """Count what the board did, from what it sent on each port.

        Returns
        -------
        Counter
            Requests answered with OK by name of the command (``STB``), those of them that load
            (``load``), replies of other kinds by name (``ERROR``, ``UNKNOWN``, ``BUF_ERROR``), or
            ``cut`` if a reset garbled them,
            reports (``INTERRUPT``), interrupts that are in a report and not in the one before by
            name (``ASG_DONE``), and answers about the program executor by its code (``WAITING``).
        """
        seen, answered, before = Counter(), set(), 0
        for port, data in enumerate(heard):
            decoder = packets.Decoder()
            for payload in decoder.feed(data) + decoder.flush():
                reply = packets.Reply.parse(payload)
                if reply.is_report:
                    if port == 0:
                        seen["INTERRUPT"] += 1
                        seen.update(packets.interrupt_names(reply.pending & ~before))
                        before = reply.pending
                elif reply.tag not in answered:
                    answered.add(reply.tag)
                    self._count(seen, reply)
        return seen

    def _count(self, seen, reply):
        code, arguments = self._requests.get(reply.tag, (-1, b""))
        if reply.code != s3g.REPLY_OK:
            kind = packets.REPLIES.at(reply.code)  # none: a reply that a reset cut may look whole
            seen[kind.name if kind else "cut"] += 1
            return
        command = packets.COMMANDS.at(code)
        if command:
            seen[command.name] += 1
        if code == s3g.CMD_STB and arguments[:1] and arguments[0] & 1:
            seen["load"] += 1
        if code == s3g.CMD_INPUT and arguments[:1] == b"\x3e" and len(reply.data) == 4:
            state = s3g.MAP.table("BE").at(reply.data[2])
            seen[state.name if state else "program done"] += 1


# ----------------------------------------------------------------------------------- random traffic

VALUES = (s3g.W_X_VAL_LO, s3g.W_X_VAL_HI, s3g.W_V_VAL, s3g.W_A_VAL, s3g.W_J_VAL, s3g.W_JJ_VAL,
          s3g.W_TARGET_V_VAL, s3g.W_ABORT_A_VAL)  # fmt: skip
SPEEDS = (0, 1, 0x7FFF, 0x8000, 0xFFFF, 0x10000, 0x10001, 0x1FFFF, 0x20000, 0x20001, 0x7FFFFFFF,
          0x80000000)  # fmt: skip
THRESHOLDS = ((s3g.W_MSG_ALL_PRE_N, 2), (s3g.W_MSG_ALL_PULSE_N, 60), (s3g.W_MSG_ALL_POST_N, 60))
WAITS = (1, 1, 1, 1, 2, 3, 1 << 31, 1 << 30, 0, 0x80000001)
KINDS = (
    *("output", "output", "output", "move", "move", "move", "load", "load", "reload", "reload"),
    *("strobe", "input", "input", "state", "state", "clear", "clear", "clear", "mask"),
    *("write", "write", "write", "start", "start", "start", "abort", "version", "other", "short"),
)


def speed(random):
    """A signed quantity of motion, of any magnitude and often one where something happens."""
    kind = random.randrange(8)
    if kind == 0:
        value = random.choice(SPEEDS) + random.randint(-1, 1)
    elif kind == 1:
        value = random.getrandbits(32)
    else:
        value = random.getrandbits(random.randrange(1, 18))
    return (value if random.randrange(2) else -value) & 0xFFFFFFFF


def small(random, most):
    """A count, small ones more often."""
    return random.randrange(random.randrange(1, most + 1) + 1)


def setting(random, pair):
    """An output register and a value for it."""
    c = random.randrange(pair.channels)
    kind = random.randrange(16)
    if kind < 6:
        value = speed(random)
        register = random.choice(VALUES)[c]
        if register in (s3g.W_J_VAL[c], s3g.W_JJ_VAL[c]) and random.randrange(4):
            value = random.randint(-9, 9) & 0xFFFFFFFF
        return register, value
    if kind == 6:
        return s3g.W_ASG_STEPS_VAL, random.choice((0, 1, 2, 3, 4, 5, 2, 3, 40))
    if kind < 9:
        most = random.choice((0, 3, 12, 200, 2000, 2000, 9000, 0xFFFFFFFE))
        return s3g.W_ASG_DT_VAL, small(random, most + 1)
    if kind < 11:
        return s3g.W_ASG_CONTROL, control(random)
    if kind == 11:
        register, most = random.choice(THRESHOLDS)
        return register, small(random, most) if random.randrange(8) else random.randrange(200)
    if kind == 12:
        return s3g.W_MSG_CONTROL, random.getrandbits(8)
    if kind == 13:
        return s3g.W_ASG_CONTROL2, random.getrandbits(32)
    if kind == 14:
        return s3g.W_LEDS, random.getrandbits(32)
    # not the thresholds: with a large one, a pulse lasts longer than the run
    others = (s3g.W_BE_START_ADDR, s3g.W_SE_REG_LB, s3g.W_LEDS, random.randrange(7, 64))
    return random.choice(others), random.getrandbits(32)


def control(random):
    """Load bits: any, or those of a move."""
    bits = random.getrandbits(32)
    return random.choice((bits, bits | 0x0F, bits | 0x0F, 0x3F3F3F0F, bits & 0xFFFFFFF0))


def word(kind, opcode, data):
    return kind << 38 | opcode << 32 | data


def program(random, pair, size):
    """Words of a program that is mostly legal, or of the middle of one."""
    words = []
    while len(words) < size:
        kind = random.randrange(20)
        wait = random.choice((s3g.OP_WAIT_ALL, s3g.OP_WAIT_ANY))
        if kind < 11:
            words.append(word(s3g.CLASS_OUTPUT, *setting(random, pair)))
            continue
        if kind < 16:  # what a program is for: load, wait until that is done, clear
            steps = [
                (wait, random.choice(WAITS)),
                (s3g.OP_CLEAR, random.choice((1, 3, 0xFFFFFFFF))),
            ]
            steps = [*steps, (s3g.OP_STB, 1)] if random.randrange(2) else [(s3g.OP_STB, 1), *steps]
        elif kind == 16:
            steps = [(s3g.OP_STB, random.choice((1, 1, 1 << 31, 1 << 29, 1 << 30, 0xDFFFFFFF)))]
        elif kind == 17:
            steps = [(s3g.OP_DONE, random.getrandbits(10))]
        elif kind == 18:
            steps = [(s3g.OP_NOP, random.getrandbits(32)), (wait, random.getrandbits(2))]
        else:
            steps = []
            words.append(random.getrandbits(40) if random.randrange(3) == 0 else 0)
        words += [word(s3g.CLASS_CONTROL, *step) for step in steps]
    return words[:size]


def requests(random, pair):
    """One thing that software does, as commands with arguments."""

    def u32(value):
        return value.to_bytes(4, "little")

    def output(register, value):
        return (s3g.CMD_OUTPUT, bytes((register | random.choice((0, 0, 64)),)) + u32(value))

    def strobe(mask):
        return (s3g.CMD_STB, u32(mask))

    kind = random.choice(KINDS)
    c = random.randrange(pair.channels)
    if kind == "output":
        return [output(*setting(random, pair))]
    if kind == "move":
        move = {
            s3g.W_ASG_STEPS_VAL: random.randrange(6),
            s3g.W_ASG_DT_VAL: random.choice((100, 700, 3000, 1 + small(random, 9000))),
            s3g.W_V_VAL[c]: random.choice((speed(random), random.randint(-70_000, 70_000))),
            s3g.W_A_VAL[c]: random.choice((0, speed(random), random.randint(-999, 999))),
            s3g.W_TARGET_V_VAL[c]: random.choice((speed(random), random.randint(-999, 999))),
            s3g.W_ABORT_A_VAL[c]: random.choice((speed(random), random.randrange(2000))),
            s3g.W_ASG_CONTROL: control(random),
            s3g.W_ASG_CONTROL2: control(random),
        }
        some = random.sample(sorted(move), random.randint(2, len(move)))
        return [*(output(r, move[r] & 0xFFFFFFFF) for r in some), strobe(1)]
    if kind == "load":
        setup = [output(s3g.W_V_VAL[c], speed(random)), output(s3g.W_MSG_ALL_PRE_N, 2)]
        setup.append(output(s3g.W_MSG_ALL_PULSE_N, random.randint(3, 40)))
        return [
            *setup[: random.randrange(4)],
            output(s3g.W_ASG_CONTROL, control(random)),
            strobe(1),
        ]
    if kind == "reload":
        return [strobe(1)]
    if kind == "strobe":
        return [strobe(random.choice((1, 1 << 31, random.getrandbits(32))))]
    if kind == "input":
        return [(s3g.CMD_INPUT, bytes((random.choice((0, 1, 62, 63, random.randrange(256))),)))]
    if kind == "state":
        return [(s3g.CMD_INPUT, bytes((s3g.R_BE_CONTROL,)))]
    if kind == "clear":
        return [(s3g.CMD_CLEAR, u32(random.choice((1, 3, 0xFFFFFFFF, random.getrandbits(32)))))]
    if kind == "mask":
        masks = (0xFFFFFFFF, 0xFFFFFFFF, 0xFFFFFFFD, 0, random.getrandbits(32))
        return [(s3g.CMD_MASK, u32(random.choice(masks)))]
    if kind == "write":
        size = small(random, min(24, packets.MAX_WORDS))
        first = random.choice((0, 0, random.randrange(64), random.getrandbits(16)))
        words = program(random, pair, size)
        count = size if random.randrange(20) else random.randrange(256)
        head = bytes((count,)) + first.to_bytes(2, "little")
        whole = b"".join(w.to_bytes(s3g.PROG_WORD_BYTES, "little") for w in words)
        return [(s3g.CMD_WRITE_BUFFER, head + whole)]
    if kind == "start":
        start = strobe(1 << s3g.STB_BE_START)
        first = random.choice((0, 0, random.randrange(24), random.getrandbits(16)))
        return random.choice(([start], [output(s3g.W_BE_START_ADDR, first), start]))
    if kind == "abort":
        return [strobe(1 << s3g.STB_BE_ABORT | random.choice((0, 0, 1, 1 << s3g.STB_BE_START)))]
    if kind == "version":
        return [(random.choice((s3g.CMD_VERSION, s3g.CMD_EXT_VER)), b"")]
    arguments = bytes(random.randrange(256) for _ in range(random.randrange(12)))
    if kind == "other":
        return [(random.randrange(256), arguments)]
    return [(random.randrange(60, 66), arguments[: random.randrange(8)])]


def start(random, traffic, pair):
    """Set the pulse former, sometimes to short pulses that leave out few steps."""
    at = 0
    pre, pulse, post = random.choice(((2, 5, 9), (1, 2, 3), (0, 2, 2), (3, 40, 90)))
    for register, value in ((4, pre), (5, pulse), (6, post), (7, 1)):
        at = say(random, traffic, pair, [(s3g.CMD_OUTPUT, bytes((register, value, 0, 0, 0)))], at)
    return at


def say(random, traffic, pair, commands, cycle, *, flaws=0, pauses=(1,)):
    """Send commands from a cycle on; return when the next ones may follow.

    Parameters
    ----------
    flaws : int
        Packets in a thousand that have one.
    pauses : tuple of int
        Upper limits of pauses [byte], one of which is chosen.
    """
    slower = int(BYTE * max(pair.bits)) + 1
    for code, arguments in commands:
        port = random.randrange(2)
        payload = traffic.tag(code, arguments)
        data, options = packets.frame(payload), {}
        if flaws and random.randrange(1000) < flaws:
            data, options = spoilt(random, traffic, port, payload, cycle)
        end = traffic.send(port, data, cycle, **options)
        kind = random.randrange(1000)
        if kind < flaws:  # next to it, on the other port
            cycle += random.randrange(end - cycle)
        elif kind < 3 * flaws:  # too early
            cycle = end + random.randrange(6 * slower)
        else:
            length = 16 if code in (s3g.CMD_INPUT, s3g.CMD_WRITE_BUFFER) else 7
            cycle = end + length * slower
    return cycle + random.randrange(random.choice(pauses) * slower)


def spoilt(random, traffic, port, payload, cycle):
    """Return bytes of a packet that has a flaw, and options of `Traffic.send`."""
    data, options = packets.frame(payload), {}
    kind = random.randrange(9)
    if kind == 0:
        data = data[:-1] + bytes((data[-1] ^ 1 << random.randrange(8),))
    elif kind == 1:
        data = data[: random.randrange(1, len(data))]
    elif kind == 2:
        noise = bytes(random.randrange(256) for _ in range(random.randrange(1, 9)))
        data = noise + data
    elif kind == 3:
        options["bad_stop"] = random.randrange(len(data))
    elif kind == 4:
        options["gap"] = random.choice((1, 7, 100, 500, 3000))
    elif kind == 5:
        options["pace"] = random.uniform(0.94, 1.06)
    elif kind == 6:
        for _ in range(random.randrange(1, 5)):
            traffic.glitch(port, cycle, random.choice((1, 2, 7, 8, 9, 10, 11, 12, 150)))
    elif kind == 7:  # lengths that have no place for a command
        size = random.choice((1, 2, 2, 3))
        data = bytes((s3g.HEADER, size)) + payload[:size] + bytes((packets.crc8(payload[:size]),))
    else:
        fill = bytes(256) if random.randrange(4) == 0 else b""  # N = 0 may have 256 bytes
        data = bytes((s3g.HEADER, 0)) + fill + bytes((packets.crc8(fill),))
    return data, options


def resets(random, traffic, end, number):
    """Pull reset or configuration low for a while, some number of times."""
    for _ in range(number):
        pin = random.choice(("rst_n", "cclk"))
        clocks = random.choice((1, 2, random.randrange(1, 20), random.randrange(1, 3000)))
        traffic.low(pin, random.randrange(end), clocks)


def busy(random, pair, clocks, *, flaws=40, pauses=(1, 1, 1, 8, 40)):
    """Random traffic for at least so many clocks; return it and the cycle at which it ends."""
    traffic = Traffic(pair)
    at = start(random, traffic, pair)
    while at < clocks:
        at = say(random, traffic, pair, requests(random, pair), at, flaws=flaws, pauses=pauses)
    resets(random, traffic, at, at // 400_000)
    return traffic, at + 5000
