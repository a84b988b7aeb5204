"""Random traffic, legal and not: the gateware against the specification's rules, clock by clock."""

import numpy as np
import pytest
from pluto_step_reference import Reference

from pulsewright.boards.pluto_step.gateware import PlutoStep
from pulsewright.boards.pluto_step.registers import PROFILES
from pulsewright.gateware.rtl import RtlSimulation

CYCLES = 30_000


def random_traffic(rng):
    """Return (cycle, nwrite, ndatastr, naddrstr, data, din) rows of bursts of bus cycles."""
    rows, cycle, din = [(0, 1, 1, 1, 0, 0)], 5, 0

    def strobe(write, data, *, address=False, both=False):
        nonlocal cycle, din
        legal = rng.random() < 0.85
        width = int(rng.integers(3, 6)) if legal else int(rng.integers(1, 4))
        gap = 5 if legal else int(rng.integers(1, 6))
        rows.append((cycle, not write, address and not both, not (address or both), data, din))
        if not legal and rng.random() < 0.3:  # nWrite turns within the strobe
            rows.append((cycle + 1, write, *rows[-1][2:]))
        rows.append((cycle + width, not write, 1, 1, data, din))
        cycle += width + gap

    while cycle < CYCLES:
        kind = rng.random()
        if kind < 0.6:
            word = int(rng.choice([0, 2, 4, 6, 8, 10, 10, 12, 14]))
            strobe(True, word | int(rng.choice([0, 0, 0, 16, 0xE0])), address=True)
            for _ in range(int(rng.integers(1, 4))):
                high = int(rng.choice([0, 1, 3, 4, 7, 8, 12, 13, 15]))
                low = int(rng.integers(0, 256))
                if word == 10:  # short times, so that something happens
                    low, high = low & 0xC3, high & 3
                strobe(True, low)
                strobe(True, high | int(rng.integers(0, 16)) << 4)
        elif kind < 0.95:
            din = int(rng.integers(0, 1 << 16))
            strobe(True, int(rng.integers(0, 8)) * 4, address=True)
            for _ in range(int(rng.integers(1, 9))):
                strobe(False, 0, address=rng.random() < 0.1)
        else:
            strobe(rng.random() < 0.5, int(rng.integers(0, 256)), both=True)
        cycle += int(rng.choice([1, 20, 100, 700]))
    return [tuple(int(x) for x in row) for row in rows]


def levels(row, name, size):
    return [int(row[name]) >> bit & 1 for bit in range(size)]


def pins(row):
    """Return the outputs in the order of the reference; high-Z pins and data read as 0."""
    shown = [*levels(row, "step", 4), *levels(row, "dir", 4), *levels(row, "dout", 14)]
    shown.append(int(row["led"]))
    if row["tristate"]:
        shown = [0] * len(shown)
    shown += [int(row[name]) for name in ("tristate", "nwait", "nconfig", "data_oe")]
    return shown + levels(row if row["data_oe"] else {"data_o": 0}, "data_o", 8)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("profile", PROFILES)
def test_every_pin_is_what_the_rules_say(profile, seed):
    traffic = random_traffic(np.random.default_rng(seed))
    board = RtlSimulation(PlutoStep(profile))
    stimulus = np.zeros(len(traffic), board.inputs)
    names = ("cycle", "nwrite", "ndatastr", "naddrstr", "data_i", "din")
    for name, values in zip(names, zip(*traffic, strict=True), strict=True):
        stimulus[name] = values
    stimulus["nreset"] = 1
    seen = board.run(CYCLES, stimulus)
    changes = {int(row["cycle"]): pins(row) for row in seen}

    reference = Reference(**PROFILES[profile])
    inputs = {row[0]: row[1:] for row in traffic}
    shown = present = None
    for cycle in range(CYCLES):
        present = inputs.get(cycle, present)
        nwrite, ndatastr, naddrstr, data, din = present
        expected = reference.clock(nwrite, ndatastr, naddrstr, 1, data, din)
        shown = changes.get(cycle, shown)
        assert shown == expected, f"cycle {cycle}"
    assert len(changes) > 1000
    assert sum(axis.step or axis.pos != 0 for axis in reference.axes) == 4
