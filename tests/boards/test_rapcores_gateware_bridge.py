# amaranth: UnusedElaboratable=no
"""Windings of dual H-bridges get the sine and cosine of the step position, by pulse width."""

from itertools import pairwise
from math import cos, pi, sin

import numpy as np
import pytest
from rapcores_host import MOVE, READ, READY, SWAP, Host
from rapcores_traffic import play

from pulsewright.boards.rapcores.gateware import Rapcores
from pulsewright.boards.rapcores.gateware_bridge import HBridges
from pulsewright.errors import UsageError
from pulsewright.gateware.rtl import RtlSimulation

pytestmark = pytest.mark.rtl

U = 1 << 63
FRAME = 512
BEGIN = 3  # cycle of the first frame in which a PWM period begins at the legs
RELEASED = 255  # cycle in which the reset of the board ends
LEGS = ("a1", "a2", "b1", "b2")
COAST, BRAKE = 0b00, 0b11
FORWARDS, BACKWARDS = 0b01, 0b10  # first leg in bit 0

_bridges = {}


def board(shared=0):
    """Return a board with two motors, reset."""
    return Host(motors=2, encoders=1, motor_driver=1, shared_dda=shared)


def bridges(motors=1):
    """Return the block, from configuration on."""
    if motors not in _bridges:
        _bridges[motors] = RtlSimulation(HBridges(motors=motors))
    _bridges[motors].reset()
    return _bridges[motors]


def levels(simulation, rows, end, motor=0):
    """Return legs of A and of B in each cycle, as two bits."""
    stimulus = np.zeros(len(rows), simulation.inputs)
    for row, (cycle, inputs) in zip(stimulus, rows, strict=True):
        row["cycle"] = cycle
        for name, value in inputs.items():
            row[name] = value
    changes = simulation.run(end, stimulus)
    at = np.searchsorted(changes["cycle"], np.arange(end - 1), side="right") - 1
    a1, a2, b1, b2 = ((changes[leg][at] >> motor & 1).astype(int) for leg in LEGS)
    # A result is just after its edge: what is seen in the cycle after it.
    return tuple(np.concatenate(([COAST], x | y << 1)) for x, y in ((a1, a2), (b1, b2)))


def pulse(legs, period):
    """Return first cycle in its period, length and sense of the only pulse of a period."""
    legs = legs[BEGIN + FRAME * period :][:FRAME]
    driven = np.flatnonzero(legs != BRAKE)
    if not driven.size:
        return None, 0, 0
    assert np.all(np.diff(driven) == 1)
    (sense,) = set(legs[driven].tolist())
    return int(driven[0]), driven.size, {FORWARDS: 1, BACKWARDS: -1}[sense]


@pytest.mark.parametrize(
    ("phase", "current", "a", "b"),
    [
        # 4095 sin(pi / 1024) = 12.56: 13 x 255 / 2048 = 1.6; cosine 4094.98: 4095 x 255 / 2048
        (0, 255, 2, 510),
        # 4095 sin(45.18 deg) = 2904.5, cosine 2886.7: x 100 / 2048 = 141.8 and 141.0
        (128, 100, 142, 141),
        (128 + 256, 100, 141, -142),
        (128 + 512, 100, -142, -141),
        (128 + 768, 100, -141, 142),
        (255, 255, 510, 2),  # the top, and the microstep after it
        (256, 255, 510, -2),
        (511, 255, 2, -510),
        (512, 255, -2, -510),
        (767, 255, -510, -2),
        (768, 255, -510, 2),
        (1023, 255, -2, 510),
        (128, 1, 1, 1),  # 1.42 and 1.41
        (42, 1, 1, 2),  # 4095 sin(14.94 deg) = 1055.8: 0.52; cosine 3956.6: 1.93
        (40, 1, 0, 2),  # 4095 sin(14.24 deg) = 1007.2: 0.49
        (300, 0, 0, 0),
    ],
)
def test_on_times_of_windings(phase, current, a, b):
    found = levels(bridges(), [(0, {"phase": phase, "current": current, "en": 1})], 3 * FRAME)
    for legs, on in zip(found, (a, b), strict=True):
        _, length, sense = pulse(legs, 1)
        assert length * sense == on


@pytest.fixture(scope="module")
def waves():
    """On-times of A and B, with their signs, at every phase, by current."""
    found = {}
    for current in (255, 77):
        rows = [(FRAME * n, {"phase": n % 1024, "current": current, "en": 1}) for n in range(1025)]
        a, b = levels(bridges(), rows, 1026 * FRAME + BEGIN)
        found[current] = np.array(
            [[pulse(legs, n)[1] * pulse(legs, n)[2] for n in range(1, 1025)] for legs in (a, b)]
        )
    return found


def test_on_times_are_sine_and_cosine_within_rounding(waves):
    angle = 2 * pi * (np.arange(1024) + 0.5) / 1024
    for current, (a, b) in waves.items():
        scale = 4095 * current / 2048
        # half a unit of the table, times current / 2048, and half a cycle
        bound = 0.5 * current / 2048 + 0.5 + 1e-9
        assert np.abs(a - scale * np.sin(angle)).max() <= bound
        assert np.abs(b - scale * np.cos(angle)).max() <= bound


def test_quarters_mirror_each_other(waves):
    for a, b in waves.values():
        assert np.array_equal(a[:512], a[511::-1])
        assert np.array_equal(a[512:], -a[:512])
        assert np.array_equal(b, np.roll(a, -256))
        assert np.all(a[:512] >= 0)
        assert np.all(np.diff(a[:256]) >= 0)


@pytest.mark.parametrize("phase", [0, 77, 128, 255, 300])
def test_pulses_are_in_the_middle_of_their_period(phase):
    found = levels(bridges(), [(0, {"phase": phase, "current": 200, "en": 1})], 3 * FRAME)
    lengths = set()
    for legs in found:
        start, length, _ = pulse(legs, 1)
        # cycles before the middle and after it are as many, or one less
        before, after = 256 - start, start + length - 256
        assert after - before in (0, 1)
        lengths.add(length)
    assert len(lengths) == 2


@pytest.mark.parametrize(("motors", "motor"), [(1, 0), (32, 0), (32, 5), (32, 31)])
def test_a_motor_is_looked_at_once_in_a_frame(motors, motor):
    """A new phase is seen by the next period or the one after, and no pulse is a mixture."""
    sampled = 512 - 16 * (motors - motor)
    assert 0 <= sampled < 512
    for change, first in ((sampled, 3), (sampled + 1, 4)):
        old, new = {"phase": 128, "current": 100}, {"phase": 128 + 512, "current": 50}
        enabled = {"en": (1 << motors) - 1}
        rows = [(0, old | enabled), (2 * FRAME + change, new | enabled)]
        for legs, before, after in zip(
            levels(bridges(motors), rows, 7 * FRAME, motor), (142, 141), (-71, -70), strict=True
        ):
            found = [pulse(legs, n)[1] * pulse(legs, n)[2] for n in range(1, 6)]
            assert found == [before] * (first - 1) + [after] * (6 - first)


def test_the_first_period_is_braked():
    """Nothing has been looked at before it, whatever the motor is to get."""
    found = levels(bridges(), [(0, {"phase": 300, "current": 255, "en": 1})], 2 * FRAME)
    for legs in found:
        assert set(legs[1 : BEGIN + FRAME].tolist()) == {BRAKE}
        assert set(legs[BEGIN + FRAME :].tolist()) > {BRAKE}


def test_motors_have_phases_and_currents_of_their_own():
    host = board()
    host.write(2, 0)
    host.write(0xD0, 100)
    host.write(0xD1, 255)
    host.write(0, 0b11)
    for ticks in (128, 255, 1):  # to 128 - 512 = -384, and to -1
        host.send(MOVE, ticks, -U, 0, -U if ticks == 1 else 0, 0)
        host.run(host.free + 500)
    host.run(host.free + 4 * FRAME)
    assert [host.status(0x84 + n) for n in range(2)] == [640, 1023]
    assert on_times(host, 0) == (-142, -141)
    assert on_times(host, 1) == (-2, 510)


def legs_of(host, motor, since, until):
    """Return legs of A and of B of a motor on the board in cycles ``since`` to ``until`` - 1."""
    found = []
    for pair in (LEGS[:2], LEGS[2:]):
        both = np.zeros(until - since, int)
        for bit, leg in enumerate(pair):
            level, at = 0, 0
            signal = np.zeros(until - since, int)
            for cycle, after in host.edges(f"phase{motor}_{leg}"):
                edge = min(max(cycle - since, 0), until - since)
                signal[at:edge], level, at = level, after, edge
            signal[at:] = level
            both |= signal << bit
        found.append(both)
    return tuple(found)


def on_times(host, motor):
    """Return on-times of A and B in the last whole PWM period."""
    begin = RELEASED + BEGIN
    period = (host.board.now - begin) // FRAME - 1
    start = begin + period * FRAME
    found = []
    for legs in legs_of(host, motor, start - BEGIN, start + FRAME):
        _, length, sense = pulse(legs, 0)
        found.append(length * sense)
    return tuple(found)


@pytest.mark.parametrize("shared", [0, 1])
def test_pulses_on_the_board_follow_the_step_position(shared):
    """A position that changes within a period tells in a whole period, not in this one."""
    host = board(shared)
    host.write(0xD0, 100)
    host.write(0, 1)
    frames = -(-(host.free - RELEASED) // FRAME) + 1  # up to the first enabled period
    begin = RELEASED + BEGIN + frames * FRAME
    host.send(MOVE, 129, U - 1, 0, 0, 0)  # ends below 129
    host.run(host.free + 200 * 41)
    assert host.status(0x84) == 128
    end = host.board.now + 3 * FRAME
    host.run(end)
    whole = [
        [pulse(legs, n) for n in range((end - begin) // FRAME)]
        for legs in legs_of(host, 0, begin - BEGIN, end)
    ]
    for periods, last in zip(whole, (142, 141), strict=True):
        for start, length, _ in periods:
            if length:
                assert start == 256 - length // 2
        assert periods[-1][1:] == (last, 1)
    # A grows and B falls, a microstep in 41 cycles
    lengths = [(a[1], b[1]) for a, b in zip(*whole, strict=True)]
    assert len(set(lengths)) > 9
    assert lengths[0] == (1, 200)  # 0.6 and 199.95
    assert all(old[0] <= new[0] and old[1] >= new[1] for old, new in pairwise(lengths))


@pytest.mark.parametrize("shared", [0, 1])
def test_a_halt_takes_owed_steps_back_from_windings_too(shared):
    host = board(shared)
    host.write(0xD0, 100)
    host.write(0, 1)
    for address in (0xC0, 0xC1):
        host.write(address, 1000)  # a step every 2000 cycles, and ticks every 41
    host.send(MOVE, 1000, -U, 0, 0, 0)
    host.pin(host.fell + 2100, "halt", 0)
    host.run(host.fell + 5000)
    assert host.status(0xC0) == 2**64 - 2  # two pulses, of 51 steps
    end = host.free + 3 * FRAME
    host.run(end)
    period = (end - RELEASED - BEGIN) // FRAME - 1
    a, b = (pulse(legs, period) for legs in legs_of(host, 0, RELEASED, end))
    # phase 1022: 4095 sin(0.53 deg) = 37.7, x 100 / 2048 = 1.86; cosine 4094.8
    assert (a[1] * a[2], b[1] * b[2]) == (-2, 200)


def test_nothing_is_driven_before_the_host_asks():
    host = board()
    host.run(READY + 2 * FRAME)
    pins = [f"phase{n}_{leg}" for n in range(2) for leg in LEGS]
    assert all(host.edges(pin) == [] for pin in pins)  # coasting
    host.write(0, 0b11)
    at = host.fell + 6  # a cycle after EN
    host.run(host.free + 3 * FRAME)
    # enabled without current: braked
    assert [host.edges(pin) for pin in pins] == [[(at, 1)]] * len(pins)


@pytest.mark.parametrize(("brake", "off"), [(0, COAST), (1, BRAKE)])
def test_without_enable_windings_are_open_or_braked(brake, off):
    """At once, also within a pulse, and within one again when enabled."""
    host = board()
    host.write(1, brake)
    host.write(0xD0, 255)
    host.write(0xD1, 255)
    host.write(0, 0b11)
    host.run(host.free + 3 * FRAME)
    # f + 6 in the middle of a pulse of 510 cycles of B
    for enabled in (0b10, 0b11):
        length = host.f(2, 0)
        middle = RELEASED + BEGIN + 256
        start = host.free + (middle - 6 - host.free - length) % FRAME
        host.send(SWAP, enabled, start=start)
        assert (host.fell + 6 - middle) % FRAME == 0
        at = host.fell + 6
        host.run(at + 100)
        _, b = legs_of(host, 0, at - 2, at + 50)
        levels = (FORWARDS, off) if enabled == 0b10 else (off, FORWARDS)
        assert b.tolist() == [levels[0]] * 2 + [levels[1]] * 50
        _, other = legs_of(host, 1, at - 2, at + 50)
        assert set(other.tolist()) == {FORWARDS}


@pytest.mark.parametrize("shared", [0, 1])
def test_currents_are_registers_of_8_bits_that_are_0_at_first(shared):
    host = board(shared)
    assert [host.write(0xD0 + n, 0x1234 + n) for n in range(3)] == [0, 0, 0]
    assert [host.send(READ | 0xD0 + n, 0)[1] for n in range(3)] == [0x34, 0x35, 0]
    assert host.status(0xFE) == 0x12040


def test_a_board_without_bridges_has_no_currents():
    host = Host()
    host.write(0xD0, 5)
    assert host.send(READ | 0xD0, 0)[1] == 0
    assert host.status(0xFE) == 0x2040
    assert not any(pin.startswith("phase") for pin in Rapcores().output_pins)


def test_bridges_are_in_profile_document_only():
    with pytest.raises(UsageError, match="motor_driver = 1; allowed: 0"):
        Rapcores("upstream", motor_driver=1)
    with pytest.raises(UsageError, match=r"motor_driver = 2; allowed: 0\.\.1"):
        Rapcores(motor_driver=2)


@pytest.mark.parametrize("seed", [4, 5])
def test_shared_arithmetic_drives_windings_as_exactly(seed):
    found = []
    least = Rapcores(shared_dda=1, motors=2, encoders=1).min_divider
    for shared in (0, 1):
        host = board(shared)
        host.write(0xD0, 255)
        host.write(0xD1, 130)
        host.write(0, 0b11)
        host.run(host.free + 30 * FRAME)  # with pulses, whatever the traffic does to enables
        _, _, trace = play(
            host, seed, motors=2, encoders=1, messages=40, least_divider=least, half=6
        )
        pins = [n for n, pin in enumerate(trace.pins) if pin.startswith("phase")]
        found.append([trace.cycles[n].tolist() for n in pins])
    assert found[0] == found[1]
    assert len(found[0]) == 8
    assert sum(len(cycles) for cycles in found[0]) > 200  # two windings of two motors


def test_cosine_is_a_quarter_ahead():
    """Rising positions turn the field from B to A."""
    legs = levels(bridges(), [(0, {"phase": 85, "current": 200, "en": 1})], 3 * FRAME)
    lengths = [pulse(each, 1)[1] for each in legs]
    angle = 2 * pi * 85.5 / 1024
    assert lengths == [round(400 * sin(angle)), round(400 * cos(angle))]
