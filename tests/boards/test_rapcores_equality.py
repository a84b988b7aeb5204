# amaranth: UnusedElaboratable=no
"""The gateware does what the twin does: every output pin at every clock cycle."""

import functools
from collections import Counter
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rapcores_equality import Pair, Traffic, busy, reset, talk, turn

pytestmark = pytest.mark.rtl

CONFIGURATIONS = {
    "document": {},
    "deep": {"motors": 1, "encoders": 0, "depth": 8},
    "short words": {"word_bits": 32, "motors": 24, "encoders": 2},
    "shared": {"motors": 8, "encoders": 8, "shared_dda": 1},
    "shared, short words": {"motors": 3, "encoders": 5, "word_bits": 32, "shared_dda": 1},
    "shared, deep": {"motors": 1, "encoders": 3, "depth": 8, "shared_dda": 1},
    "bridges": {"motor_driver": 1, "motors": 2, "encoders": 1},
    "shared bridges": {"motor_driver": 1, "shared_dda": 1, "word_bits": 32},
    "frames": {"cs_reset_message": 0, "motors": 2, "encoders": 1},
    "info": {"v020_info": 1, "motors": 2},
    "no halt": {"halt_pin": 0, "motors": 3},
    "upstream": {"profile": "upstream"},
    "fixed": {"profile": "upstream", "fixed": 1},
    "v020": {"profile": "v020"},
    "librapcore": {"profile": "v020", "position_bits": 24, "motors": 3},
}


@functools.cache
def pair(name):
    return Pair(**CONFIGURATIONS[name])


@st.composite
def scenarios(draw, names):
    """A few messages, which shrink to the fewest that differ."""
    both = pair(draw(st.sampled_from(names)))
    random, flaws = draw(st.randoms()), draw(st.sampled_from([0, 300]))
    traffic = Traffic(both)
    for _ in range(draw(st.integers(1, 12))):
        talk(random, traffic, flaws)
    if draw(st.booleans()):
        reset(random, traffic)
    traffic.at += draw(st.sampled_from([100, 20_000]))
    if draw(st.booleans()):
        turn(random, traffic)
    return both, traffic


SETTINGS = {
    "deadline": None,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large],
}


def assert_busy(seen, least):
    """The traffic is worth something: the board moved, and refused what it should."""
    assert all(seen[name] >= count for name, count in least.items()), seen


@settings(max_examples=20, **SETTINGS)
@given(scenarios(["document", "fixed"]))
def test_gateware_matches_the_twin(scenario):
    both, traffic = scenario
    both.run(traffic)


# In a million cycles; the originals stand still more often, so in two million.
LEAST = {
    "document": {
        "move_done": 30, "step": 1500, "dir": 200, "en": 3, "buffer_dtr": 10, "cipo": 200,
        "refused": 5, "framing": 2, "aborted": 1, "unknown": 2, "halt_seen": 1,
    },
    "upstream": {"move_done": 15, "dir": 50, "en": 4, "buffer_dtr": 2, "cipo": 500},
    "v020": {"move_done": 15, "step": 300, "dir": 50, "en": 4, "buffer_dtr": 2, "cipo": 500},
}  # fmt: skip


WITH_BRIDGES = {"en": 2, "dir": 100, "phase": 4000}  # two motors


@pytest.mark.parametrize("name", ["document", "shared", "bridges", "fixed", "v020"])
def test_gateware_matches_the_twin_in_busy_traffic(name):
    both = pair(name)
    cycles = 1_000_000 if both.profile == "document" else 2_000_000
    least = LEAST[both.profile] | (WITH_BRIDGES if both.bridges else {})
    assert_busy(both.run(busy(Random(9), both, cycles)), least)


@pytest.mark.campaign
@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_gateware_matches_the_twin_for_many_cycles(name):
    """Each configuration for 9.5 million cycles: more than 10^8 in total."""
    both, seed, cycles, seen = pair(name), 0, 0, Counter()
    while cycles < 9_500_000:
        seed += 1
        flaws, turning = (0, 30, 150)[seed % 3], seed % 4 > 0
        traffic = busy(Random(seed), both, 1_000_000, flaws=flaws, turning=turning)
        seen += both.run(traffic)
        cycles += traffic.at
    least = LEAST[both.profile] | ({"fault": 2, "lost": 1} if name == "document" else {})
    if name == "frames":  # where messages are not aborted
        del least["aborted"]
    assert_busy(seen, {key: 4 * count for key, count in least.items()})
