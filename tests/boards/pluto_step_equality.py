"""Gateware and twin of pluto-step side by side: the same levels at the pins in, every pin compared.

Changes of input pins are arrays (n, 3) of cycle, pin and level; pins are numbers in
`PlutoStepTwin.input_pins`. The first edge that samples a level is that of its cycle.
"""

from __future__ import annotations

import numpy as np

from pulsewright.boards.pluto_step.gateware import PlutoStep
from pulsewright.boards.pluto_step.twin import PlutoStepTwin
from pulsewright.edges.trace import EdgeTrace
from pulsewright.gateware.rtl import RtlSimulation

NWRITE, NDATASTR, NADDRSTR, NINIT, DATA, DIN = range(6)
INPUTS = 16
IDLE = (1, 1, 1, 1, 0, *[0] * INPUTS)
# Ports of the gateware in the order of the twin's pins, with their size.
OUTPUTS = (
    *(("step", 4), ("dir", 4), ("dout", 14), ("led", 1), ("tristate", 1)),
    *(("nwait", 1), ("nconfig", 1), ("data_oe", 1), ("data_o", 8)),
)
HIGH_Z = 4 + 4 + 14 + 1  # pins, from the first one on, that are high-Z while tristate

TICK = 64
WATCHDOG_TICK = 2048
WATCHDOG_TICKS = 127


def ordered(changes):
    """Sort changes by cycle; of several changes of a pin at one cycle the last one counts."""
    changes = np.asarray(changes, np.int64).reshape(-1, 3)
    changes = changes[np.lexsort((changes[:, 1], changes[:, 0]))]  # stable
    last = np.ones(len(changes), bool)
    last[:-1] = np.any(changes[1:, :2] != changes[:-1, :2], axis=1)
    return changes[last]


class Pair:
    """One profile of the board, compiled once.

    Parameters
    ----------
    profile : str
    gateware, twin : callable
        Make the component and the twin.
    **switches : int
        Those of both.
    """

    def __init__(self, profile="exact", gateware=PlutoStep, twin=PlutoStepTwin, **switches):
        self.rtl = RtlSimulation(gateware(profile, **switches))
        self._twin = lambda: twin(profile, bus_pins=True, **switches)
        self.switches = self._twin().switches

    def run(self, changes, end):
        """Run both from reset up to edge ``end``, not included; assert that all pins agree."""
        changes = ordered(changes)
        expected, seen = self.run_twin(changes, end), self.run_gateware(changes, end)
        assert (difference := seen.first_difference(expected)) is None, (
            f"{difference} (gateware, twin)"
        )
        return expected

    def run_twin(self, changes, end):
        twin = self._twin()
        if len(changes):
            twin.schedule(*changes.T)
        twin.advance(end)
        return twin.drain()

    def run_gateware(self, changes, end):
        grid = np.unique(np.append(0, changes[:, 0]))
        level = np.empty((len(IDLE), len(grid)), np.int64)
        for pin, idle in enumerate(IDLE):
            mine = changes[changes[:, 1] == pin]
            at = np.searchsorted(mine[:, 0], grid, side="right")
            level[pin] = np.append(idle, mine[:, 2])[at]
        rows = np.zeros(len(grid), self.rtl.inputs)
        rows["cycle"] = grid
        rows["nwrite"], rows["ndatastr"], rows["naddrstr"] = level[:NINIT]
        rows["nreset"], rows["rst"] = level[NINIT], 1 - level[NINIT]
        rows["data_i"] = level[DATA]
        rows["din"] = (level[DIN:] << np.arange(INPUTS)[:, None]).sum(axis=0)
        self.rtl.reset()
        return self._trace(self.rtl.run(end, rows), end)

    def _trace(self, rows, end):
        pins = [rows[port].astype(np.int64) >> n & 1 for port, size in OUTPUTS for n in range(size)]
        pins = np.array(pins, np.uint8)
        pins[:HIGH_Z, rows["tristate"] == 1] = 0
        pins[-8:, rows["data_oe"] == 0] = 0
        names = self._twin().output_pins
        high = {"nconfig": 1, "nwait": self.switches["nwait_idle"]}
        initial = np.array([high.get(name, 0) for name in names], np.uint8)
        levels = np.concatenate([initial[:, None], pins], axis=1)
        cycles = tuple(rows["cycle"][np.flatnonzero(np.diff(level))] for level in levels)
        return EdgeTrace(40_000_000, names, initial, cycles, 0, end)


# ----------------------------------------------------------------------------------- random traffic

COMMANDS = (
    *("velocities", "velocities", "velocity", "reversal", "reversal", "timing", "timing", "tap"),
    *("space", "control", "outputs", "outputs", "arm", "read", "latch", "latch", "inputs"),
    *("alone", "any", "byte"),
)
IMPOLITE = (*COMMANDS, "mess")
SMALL = (0, 0, 0, 1, 1, 2, 3, 5, 15)
FAST = (1024, 1024, 682, 683, 512, 341, 300, 2047, 2000, 1500)
HIGH_BYTE = 2  # bus cycles from the address write that commit a word: address, low byte, high byte


class Traffic:
    """A host, mostly a polite one. Its methods append changes of the bus pins.

    Parameters
    ----------
    random : random.Random
    flaws : int
        Bus cycles in a thousand that break the rules; 0: none, and no reset either.
    """

    def __init__(self, random, flaws=0):
        self.random, self.flaws = random, flaws
        self.changes = []
        self.now = 3  # first edge that samples the next strobe
        self.origin = 0  # edge 0 of the board
        self.gap = 5  # edges between strobes
        self._timing = 0

    def put(self, cycle, pin, level):
        self.changes.append((cycle, pin, level))

    def access(self, op, byte=0):
        """Do one bus cycle: write or read of the address or of data (A, a, W, R)."""
        random, at = self.random, self.now
        length, gap, address, read = 5, self.gap, op in "Aa", int(op in "aR")
        flaw = ""
        if self.flaws and random.randrange(1000) < self.flaws:
            length, gap = random.choice((1, 2, 3, 4, 7)), random.choice((1, 2, 5))
            flaw = random.choice(("none", "both", "nwrite", "data", "reset"))
        end = at + length
        self.put(at, NWRITE, read)
        self.put(at, DATA, byte)
        if address or flaw == "both":
            self.put(at, NADDRSTR, 0)
        if not address or flaw == "both":
            self.put(at, NDATASTR, 0)
        self.put(end, NADDRSTR, 1)
        self.put(end, NDATASTR, 1)
        if flaw == "nwrite":
            self.put(at + random.randint(1, length + 4), NWRITE, 1 - read)
        elif flaw == "data":
            self.put(at + random.randint(1, length), DATA, ~byte & 0xFF)
        elif flaw == "reset":
            self.reset(at + random.randint(-2, length + 4))
        elif random.randrange(4) == 0:  # that is allowed, and the board drives the bus
            self.put(end, NWRITE, 1)
        self.now = end + gap

    def write(self, address, *data):
        self.access("A", address | self.random.choice((0, 0, 0, 0x20, 0xE0)))
        for byte in data:
            self.access("W", byte)

    def word(self, address, *values):
        self.write(address, *(byte for v in values for byte in (v & 0xFF, v >> 8 & 0xFF)))

    def reset(self, low):
        """Reset the board from edge ``low`` on."""
        self.origin = max(low, 1) + self.random.choice((1, 2, 3, 20))
        self.put(max(low, 1), NINIT, 0)
        self.put(self.origin, NINIT, 1)

    def align(self, period, phase, ahead=0):
        """Wait until the action of a bus cycle is ``phase`` after a multiple of ``period``.

        Parameters
        ----------
        ahead : int
            Which one: 0 is the next bus cycle.
        """
        action = self.now + ahead * (5 + self.gap) + 2 - self.origin
        self.now += (phase - action) % period

    def about(self, phase):
        return phase + self.random.choice((-1, 0, 0, 1))

    def velocity(self):
        random = self.random
        choices = (0, random.choice(FAST), random.choice(FAST), random.randrange(1, 60),
                   random.randrange(2048), 2048)  # fmt: skip
        return random.choice(choices) * random.choice((1, 1, -1))

    def command(self):
        """Do one thing that software does, or should not do."""
        random = self.random
        self.gap = random.choice((5, 5, 5, 6, 30))
        if random.randrange(3) == 0:  # commit at the edge of a tick, or near it
            self.align(random.choice((TICK, TICK, WATCHDOG_TICK)), self.about(0), HIGH_BYTE)
        kind, byte = random.choice(IMPOLITE if self.flaws else COMMANDS), random.randrange(256)
        if kind == "velocities":
            self.word(0, *(self.velocity() for _ in range(random.randint(2, 4))))
        elif kind == "velocity":
            self.word(2 * random.randrange(4), self.velocity())
        elif kind == "reversal":  # often cancelled in its hold or set-up time
            axis, velocity = random.randrange(4), self.velocity() or 700
            for _ in range(random.randint(1, 4)):
                self.word(2 * axis, velocity)
                self.now += TICK * random.choice((0, 1, 1, 2, 3, 5, 12))
                velocity = -velocity
        elif kind == "timing":
            self._timing = random.choice(SMALL) | random.choice(SMALL) << 8
            self._timing |= random.choice((0, 0x30)) | (byte & 0xF0) << 8
            self._timing |= random.choice((0, 0, byte & 0xC0))
            self.word(10, self._timing)
        elif kind == "tap":
            self.word(10, self._timing ^ (byte & 0xC0))
        elif kind == "space":
            for space in random.choice(((0,), (1,), (3,), (15, 0), (15, 1))):
                self.word(12, space | byte & 0xF0)
                self.now += TICK * random.choice((0, 1, 4, 12))
        elif kind == "control":
            self.word(14, random.choice((0, 1, 2, 3, byte)))
        elif kind in ("outputs", "arm"):
            self.word(8, random.getrandbits(16) & ~0x4000 | (kind == "arm") << 14)
        elif kind == "read":
            self.access("A", random.choice((*range(0, 32, 4), byte)))
            for _ in range(random.randint(1, 8)):
                self.access("R")
        elif kind == "latch":  # at the edge of a tick, or near it
            for _ in range(random.randint(1, 2)):
                self.access("A", random.choice((24, 24, 24, 28, 0, 4, 8, 12)))
                self.align(TICK, self.about(0))
                for _ in range(random.randint(1, 4)):
                    self.access("R")
        elif kind == "inputs":
            for _ in range(8):
                pin = random.randrange(DIN, DIN + INPUTS)
                self.put(self.now + random.randrange(40), pin, random.randrange(2))
            self.access("A", 16)
            for _ in range(2):
                self.access("R")
        elif kind == "alone":  # a high byte, with whatever the low byte was
            self.write(random.randrange(1, 32, 2), byte)
        elif kind == "any":
            self.write(random.randrange(32), *random.randbytes(random.randint(1, 4)))
        elif kind == "byte":
            self.access(random.choice("WRa"), byte)
        elif kind == "mess":
            for _ in range(random.randint(1, 12)):
                pin = random.choice((NWRITE, NDATASTR, NADDRSTR, DATA))
                self.put(self.now, pin, random.randrange(256 if pin == DATA else 2))
                self.now += random.randint(0, 4)
            self.put(self.now, NDATASTR, 1)
            self.put(self.now, NADDRSTR, 1)
            self.now += random.choice((1, 5, 9))

    def expire(self):
        """Arm the watchdog, then do a command at about the edge at which it expires."""
        random = self.random
        self.align(WATCHDOG_TICK, self.about(-1), HIGH_BYTE)
        self.word(8, random.getrandbits(14) | 0x4000)
        self.now += (WATCHDOG_TICKS - 1) * WATCHDOG_TICK
        self.gap = 5
        self.align(WATCHDOG_TICK, random.choice((-500, 500, self.about(-1))), HIGH_BYTE)
        self.word(random.choice((0, 8, 8, 10)), random.getrandbits(16))


def traffic(random, size, flaws=30, quiet=False):
    """Random changes at all pins, and the cycle at which they end.

    Parameters
    ----------
    random : random.Random
    size : int
        Commands.
    flaws : int
        Bus cycles in a thousand that break the rules; 0: no reset either.
    quiet : bool
        Long pauses, in which slow axes make steps and the watchdog expires.
    """
    host = Traffic(random, flaws)
    pauses = (1, 3_000, 60_000) if quiet else (1, 1, 1, 40, 400, 4_000)
    for n in range(size):
        if quiet and n % 8 == 0:
            host.expire()
        host.command()
        host.now += random.randrange(random.choice(pauses))
    return np.array(host.changes, np.int64), host.now + 500
