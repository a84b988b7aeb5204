"""The gateware does what the twin does: every output pin at every clock cycle."""

import functools
from random import Random

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from usc_equality import Pair, bus_changes, command, legal, traffic, with_times

CONFIGURATIONS = {
    "document": {"watchdog_us": 300},
    "linuxcnc": {
        "profile": "linuxcnc", "boards": 2, "clock_hz": 20_000_000, "base": 1, "ident": 0x42,
        "sense_gate": 1, "enc_filter": 3, "watchdog_us": 200, "nwait_idle": 1,
    },
    "mariss": {
        "mariss": 1, "loopback": 1, "ident": 0x4E, "div_offset": 0, "watchdog_us": 0,
        "clock_hz": 10_000_000, "min_space": 2,
    },
    "bus": {
        "boards": 3, "ident": 0x42, "base": 5, "clock_hz": 30_000_000,
        "watchdog_us": 7, "enc_filter": 2, "div_offset": 2,
    },
    "slow": {
        "profile": "linuxcnc", "clock_hz": 50_000_000, "ident": 0x43, "min_space": 256,
        "enc_filter": 20, "watchdog_us": 10_000, "div_offset": 3,
    },
    "loopback": {
        "profile": "linuxcnc", "loopback": 1, "time_code": 255, "sense_gate": 1,
        "watchdog_us": 5, "min_space": 5,
    },
    "two axes": {"axes": 2, "ident": 0x42, "watchdog_us": 300},
}  # fmt: skip


@functools.cache
def pair(name):
    return Pair(**CONFIGURATIONS[name])


@st.composite
def scenarios(draw, names):
    """A few commands and a few changes of inputs, which shrink to the shortest that differ."""
    both = pair(draw(st.sampled_from(names)))
    random = draw(st.randoms())
    flaws, pauses = draw(st.sampled_from([0, 100])), draw(st.sampled_from([(1,), (1, 40, 3000)]))
    board = both.base << 5
    start = [
        *(("A", board | 0x10), ("W", 9), ("W", 0), ("W", 0), ("W", 20), ("W", 0), ("W", 0)),
        *(("A", board | 0x1C), ("W", 0xFB), ("A", board | 0x1F), ("W", 0xFF)),
    ]
    cycles = legal(*start) if draw(st.booleans()) else []
    for _ in range(draw(st.integers(1, 15))):
        cycles += with_times(random, command(random, both), flaws if both.axes == 4 else 0, pauses)
    changes, end = bus_changes(cycles, 3)
    inputs = draw(st.lists(st.tuples(
        st.integers(0, end), st.integers(0, both.boards - 1),
        st.sampled_from([(pin, i) for pin in (0, 4, 8) for i in range(both.axes)]
                        + [(12, n) for n in range(15)] + [(27, 0)]),
        st.integers(0, 1),
    ), max_size=40))  # fmt: skip
    rows = [(cycle, 5 + 28 * b + first + n, level) for cycle, b, (first, n), level in inputs]
    for _ in range(draw(st.integers(0, 1))):
        low = draw(st.integers(0, end))
        rows += [(low, 3, 0), (low + draw(st.integers(1, 9)), 3, 1)]
    extra = np.array(rows, np.int64).reshape(-1, 3)
    return both, np.concatenate([changes, extra]), end + draw(st.sampled_from([50, 9000]))


SETTINGS = {
    "deadline": None,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large],
}


@settings(max_examples=40, **SETTINGS)
@given(scenarios(["document", "linuxcnc"]))
def test_gateware_matches_the_twin(scenario):
    both, changes, end = scenario
    both.run(changes, end)


@pytest.mark.parametrize("name", ["document", "linuxcnc"])
def test_gateware_matches_the_twin_in_busy_traffic(name):
    trace = pair(name).run(*traffic(Random(7), pair(name), 2500))
    prefix = "" if name == "document" else "b1."
    # The traffic is worth something: axes ran, turned, stopped; boards answered.
    active = {pin: len(trace[prefix + pin]) for pin in ("step0", "dir0", "running", "out0", "dac7")}
    assert min(active.values()) >= 10, active
    assert len(trace["nwait"]) > 1000
    assert len(trace["data0"]) > 100


@pytest.mark.campaign
@settings(max_examples=1_000, **SETTINGS)
@given(scenarios(list(CONFIGURATIONS)))
def test_gateware_matches_the_twin_campaign(scenario):
    both, changes, end = scenario
    both.run(changes, end)


@pytest.mark.campaign
@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_gateware_matches_the_twin_for_many_cycles(name):
    """Each configuration for 15 million cycles: 10^8 in total."""
    both, seed, cycles = pair(name), 0, 0
    while cycles < 15_000_000:
        seed += 1
        quiet = seed % 4 == 0
        changes, end = traffic(Random(seed), both, 300 if quiet else 3000, (0, 30)[seed % 2], quiet)
        both.run(changes, end)
        cycles += end
