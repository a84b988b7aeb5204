"""The gateware does what the twin does: every output pin at every clock cycle."""

import functools
from random import Random

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pluto_step_equality import DIN, INPUTS, NINIT, TICK, Pair, Traffic, traffic

pytestmark = pytest.mark.rtl

PROFILES = ["exact", "extended"]
CONFIGURATIONS = {
    "exact": {},
    "extended": {"profile": "extended"},
    "space": {"enforce_space": 1, "status_reg": 1},
    "tap": {"tap_sync": 1, "wd_stop": 1, "tick_reg": 1},
    "joint": {
        "joint_commit": 1, "clean_cancel": 1, "id_reg": 1, "status_reg": 1, "no_alias": 1,
        "nwait_idle": 0,
    },
    "all but": {
        "profile": "extended", "tap_sync": 0, "joint_commit": 0, "no_alias": 0, "nwait_idle": 0,
    },
}  # fmt: skip


@functools.cache
def pair(name):
    return Pair(**CONFIGURATIONS[name])


@st.composite
def scenarios(draw, names):
    """A few commands and a few changes of inputs, which shrink to the shortest that differ."""
    name = draw(st.sampled_from(names))
    host = Traffic(draw(st.randoms()), flaws=draw(st.sampled_from([0, 100])))
    if draw(st.booleans()):  # axes that run are more interesting
        host.word(0, 700, -700 & 0xFFFF, 1024, 2000)
    pauses = st.sampled_from([0, 0, 0, 1, 37, TICK, 300, 3000])
    for pause in draw(st.lists(pauses, min_size=1, max_size=15)):
        host.command()
        host.now += pause
    end = host.now + draw(st.sampled_from([50, 9000]))
    inputs = st.tuples(st.integers(0, end), st.integers(DIN, DIN + INPUTS - 1), st.integers(0, 1))
    rows = [*host.changes, *draw(st.lists(inputs, max_size=20))]
    for _ in range(draw(st.integers(0, 1))):
        low = draw(st.integers(0, end))
        rows += [(low, NINIT, 0), (low + draw(st.integers(1, 9)), NINIT, 1)]
    return name, np.array(rows, np.int64), end


SETTINGS = {
    "deadline": None,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large],
}


@settings(max_examples=60, **SETTINGS)
@given(scenarios(PROFILES))
def test_gateware_matches_the_twin(scenario):
    name, changes, end = scenario
    pair(name).run(changes, end)


@pytest.mark.parametrize("name", PROFILES)
def test_gateware_matches_the_twin_in_busy_traffic(name):
    trace = pair(name).run(*traffic(Random(7), 600))
    # The traffic is worth something: axes ran and turned, the board answered and was reset.
    active = {pin: len(trace[pin]) for pin in ("step0", "dir3", "led", "out13", "data0", "nconfig")}
    assert min(active.values()) >= 8, active
    assert len(trace["nwait"]) > 3000


@pytest.mark.parametrize("name", PROFILES)
def test_gateware_matches_the_twin_when_the_watchdog_expires(name):
    trace = pair(name).run(*traffic(Random(3), 60, quiet=True))
    assert len(trace["tristate"]) >= 8
    assert len(trace["step1"]) > 1000


@pytest.mark.campaign
@settings(max_examples=700, **SETTINGS)
@given(scenarios(list(CONFIGURATIONS)))
def test_gateware_matches_the_twin_campaign(scenario):
    name, changes, end = scenario
    pair(name).run(changes, end)


@pytest.mark.campaign
@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_gateware_matches_the_twin_for_many_cycles(name):
    """Each configuration for 10 million cycles: 6 x 10^7 in total."""
    seed = cycles = 0
    while cycles < 10_000_000:
        seed += 1
        quiet = seed % 3 == 0
        changes, end = traffic(Random(seed), 200 if quiet else 2000, (0, 30)[seed % 2], quiet)
        pair(name).run(changes, end)
        cycles += end
