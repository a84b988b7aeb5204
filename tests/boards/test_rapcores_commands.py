"""Planned motion as moves, against accumulators added up tick by tick as the specification says."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pulsewright.boards.rapcores.commands import (
    DEVIATION,
    Converter,
    PulseTiming,
    grid_ticks,
    tick_period,
)
from pulsewright.errors import MotionLimitError
from pulsewright.motion.trajectory import Trajectory

CLOCK = 16_000_000
TIMING = PulseTiming(width=40, low=40, setup=80, hold=40)
MESSAGE = 9_264  # clocks: 12 words of 64 bits in two frames, at 12 clocks a bit


def chain(points, times):
    """Return straight moves from rest to rest between points (n + 1, motors)."""
    points, times = np.asarray(points, float), np.asarray(times, float)
    n, motors = len(times), points.shape[1]
    poly = np.zeros((n, 4, motors))
    poly[:, 0], poly[:, 1] = points[:-1], np.diff(points, axis=0)
    law = np.zeros((n, 4))
    law[:, 2], law[:, 3] = 3 / times**2, -2 / times**3
    none, number = np.zeros((n, motors)), np.arange(n, dtype=np.int32)
    start = np.concatenate([[0.0], np.cumsum(times)])
    return Trajectory(poly, none, none, np.zeros(n), np.ones(n), number, number, start, law)


def swing(seconds, amplitude, rate, motors=2, slope=0.0):
    """Return motors on circles, cosine, sine, cosine ... [step], up to ``rate`` [step/s].

    From rest to rest; the acceleration along the circle is up to 4 rate / seconds [step/s^2].
    """
    poly, cosine, sine = np.zeros((1, 4, motors)), np.zeros((1, motors)), np.zeros((1, motors))
    way = rate * seconds / 1.5
    poly[0, 1] = slope / rate
    poly[0, 0, ::2] = amplitude
    cosine[0, ::2], sine[0, 1::2] = -amplitude, amplitude
    zero, law = np.zeros(1, np.int32), np.array([[0.0, 0.0, 3 / seconds**2, -2 / seconds**3]]) * way
    omega, length = np.array([1 / amplitude]), np.array([way])
    return Trajectory(poly, cosine, sine, omega, length, zero, zero, np.array([0.0, seconds]), law)


def line(rate, seconds, jump=0.0):
    """Return one motor that starts at ``rate`` [step/s] and ends at ``rate + jump`` at once."""
    law = np.array([[0.0, rate, jump / 2 / seconds, 0.0]])
    poly = np.zeros((1, 4, 1))
    poly[0, 1] = 1.0
    none, zero = np.zeros((1, 1)), np.zeros(1, np.int32)
    return Trajectory(
        poly, none, none, np.zeros(1), np.ones(1), zero, zero, np.array([0.0, seconds]), law
    )


def accumulate(moves, motor, start, bits):
    """Add up one accumulator as table 4.3 says; return ticks (from 0) and signs of its steps.

    ``start`` is the accumulator before the first tick [2^-bits step]. Position and fraction after
    each move must be those that the conversion tells.
    """
    acc, tick, ticks, signs = start, 0, [], []
    for n, inc, incinc, position, fraction in zip(
        moves.duration.tolist(),
        moves.increment[:, motor].tolist(),
        moves.incinc[:, motor].tolist(),
        moves.position[:, motor].tolist(),
        moves.fraction[:, motor].tolist(),
        strict=True,
    ):
        rate = inc
        for _ in range(n):
            before = acc >> bits
            acc, rate = acc + rate, rate + incinc
            assert -(1 << bits) <= rate < 1 << bits
            if acc >> bits != before:
                ticks.append(tick)
                signs.append((acc >> bits) - before)
            tick += 1
        assert acc == (position << bits) + fraction
        assert 0 <= fraction < 1 << bits
    return np.array(ticks, np.int64), np.array(signs, np.int64)


def converted(plan, ticks=400, tick=41, portions=(10**9,), **options):
    converter = Converter(plan, ticks=ticks, tick=tick, **options)
    parts = []
    while not converter.done:
        parts += [converter.convert(n) for n in portions]
    columns = [
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("duration", "increment", "incinc", "position", "fraction")
    ]
    return converter, type(parts[0])(*columns)


def check(plan, *, bits=63, **options):
    """Convert a plan and check what is promised; return all steps and the largest deviation."""
    converter, moves = converted(plan, word_bits=bits + 1, **options)
    worst, steps = 0.0, []
    for i in range(plan.axes):
        first = math.floor(plan.at(0.0)[0, i] + 0.5)
        ticks, signs = accumulate(moves, i, first << bits, bits)
        assert (abs(signs) == 1).all()
        # tick k at cycle k * period makes a step pulse three clocks later, spec 4.5
        seconds = (ticks * converter.tick + 3 - converter.start_cycle(0)) / CLOCK
        counts = first + np.cumsum(signs)
        if len(signs):
            worst = max(worst, float(abs(counts - signs / 2 - plan.at(seconds)[:, i]).max()))
        last = counts[-1] if len(counts) else first
        assert abs(last - plan.at(math.inf)[0, i]) <= 0.5
        assert converter.position[i] == last
        steps.append((seconds, signs))
    assert 0.5 + worst <= DEVIATION
    return steps, worst


# ------------------------------------------------------------------------------ ticks and moves


@pytest.mark.parametrize(
    ("rate", "tick"),
    [
        (19_200, 41),  # 833 clocks a step; a tenth is more than the longest tick
        (100_000, 16),  # a tenth of 160
        (197_000, 1),  # 81.2 clocks from step to step, 80 for the pulse
        (0, 41),
    ],
)
def test_a_tick_is_a_tenth_of_a_step_and_leaves_the_pulse_its_time(rate, tick):
    assert tick_period(TIMING, rate) == tick


def test_more_than_a_step_in_81_clocks_is_refused():
    with pytest.raises(MotionLimitError, match=r"197531 step/s asked; with 5 us .* to 197531"):
        tick_period(TIMING, 197_531)  # 16e6 / 81 = 197530.9


def test_grid_steps_are_as_long_as_their_bend_allows():
    # 0.1 * 160000 * T^2 = 0.04 at T = 1.5811 ms = 25298 clocks = 617 ticks
    length = {"tick": 41, "message_cycles": MESSAGE}
    assert grid_ticks(TIMING, acceleration=160_000, **length) == 616
    assert grid_ticks(TIMING, acceleration=0, **length) == 1948  # 5 ms = 1951.2 ticks


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        # 1.25 * 9264 + 164 clocks = 734.0 us; 0.4 / 734.0e-6^2
        ({"acceleration": 8e5}, r"8e\+05 step/s\^2 asked; .* each 724 us, .* up to 7.42e\+05"),
        # sqrt(0.02 / 1000) = 4.47 ms
        (
            {"acceleration": 1e3, "setup": 80_000},
            r"takes 5005 us with these pulses; at 1e\+03 step/s\^2 allowed are 4.47e\+03 us",
        ),
    ],
)
def test_accelerations_beyond_link_or_pulses_are_refused(changes, message):
    timing = PulseTiming(40, 40, changes.pop("setup", 80), 40)
    with pytest.raises(MotionLimitError, match=message):
        grid_ticks(timing, tick=41, message_cycles=MESSAGE, **changes)


# ------------------------------------------------------------------------------ the law


@pytest.mark.parametrize("bits", [63, 31])
def test_circles_are_followed_at_their_steps(bits):
    steps, worst = check(swing(0.3, 700, 10_000, slope=300), bits=bits)
    assert sum(len(signs) for _, signs in steps) > 2000
    assert worst <= 0.036  # half a tick at 10300 steps/s is 0.013, and 0.02 in long moves


def test_moves_are_long_where_the_plan_is_smooth_and_short_where_it_comes_to_rest():
    # 900 steps in 1 s: jerk 10 800 steps/s^3; 8 T = 8.2 ms is off by 10800 * 8.2e-3^3 / 125 = 5e-5
    plan = chain([[0.0], [900.0], [900.0], [0.0]], [1.0, 0.5, 1.0])
    _, moves = converted(plan)
    sizes = (moves.duration // 400).tolist()
    assert set(sizes) == {1, 2, 4, 8}
    assert sizes.count(8) > 0.9 * len(sizes)
    grid = 400 * 41 / CLOCK
    begin = -grid
    for size, inc in zip(sizes, moves.increment[:, 0].tolist(), strict=True):
        if any(begin < t < begin + size * grid for t in (1.0, 1.5)):
            assert size == 1
        if 1.0 <= begin <= 1.5 - size * grid:
            assert inc == 0
        begin += size * grid


def test_a_constant_acceleration_is_met_exactly_and_velocity_does_not_jump():
    # x = a t^2 / 2, T = 1.025 ms: inc grows by incinc from tick to tick, and on to the next move
    plan = line(0.0, 0.1, jump=4000.0)
    moves = Converter(plan, ticks=400, tick=41).convert(90)
    inc, bow = moves.increment[2:, 0], moves.incinc[2:, 0]
    n = moves.duration[2:].astype(object)
    tick = 41 / CLOCK
    assert bow * 2.0**-63 == pytest.approx(40_000 * tick**2, rel=1e-6)
    after = inc.astype(object) + n * bow.astype(object)
    jump = np.abs(after[:-1] - inc[1:].astype(object)) * 2.0**-63
    assert jump.max() < 1e-9


@pytest.mark.parametrize("way", [90.0, -90.0])
def test_a_constant_jerk_is_off_by_a_125th_of_jerk_times_length_cubed(way):
    # from rest to rest in 1 / 8 s: jerk 12 d / t^3; moves of 4.1 ms
    plan = chain([[0.0], [way]], [0.125])
    jerk = 12 * 90 / 0.125**3
    converter, moves = converted(plan, ticks=1600, tick=41, longest=1)
    length = converter.grid
    j = 15  # a move in the middle: the parabola against the cubic, at its worst place
    n = 1600 * (0.5 - math.sqrt(1 / 12))
    inc, bow = int(moves.increment[j, 0]) * 2.0**-63, int(moves.incinc[j, 0]) * 2.0**-63
    begin = moves.position[j - 1, 0] + moves.fraction[j - 1, 0] * 2.0**-63 - 0.5
    parabola = begin + n * inc + n * (n - 1) / 2 * bow
    off = parabola - plan.at(converter.time(1600 * j) + n / 1600 * length)[0, 0]
    assert abs(off) == pytest.approx(jerk * length**3 / 124.7, rel=1e-2)


def test_portions_of_any_size_give_the_same_moves():
    plan = swing(0.05, 300, 9000)
    _, whole = converted(plan)
    _, parts = converted(plan, portions=(1, 7, 2))
    assert (whole.increment == parts.increment).all()
    assert (whole.incinc == parts.incinc).all()


def test_a_plan_at_rest_makes_no_motion_once_it_is_met():
    plan = chain([[0.3, -7.4], [0.3, -7.4]], [0.1])
    steps, _ = check(plan)
    _, moves = converted(plan)
    assert all(len(signs) == 0 for _, signs in steps)
    assert not moves.increment[1:].any()
    assert not moves.incinc[1:].any()


@pytest.mark.parametrize("bits", [63, 31])
@pytest.mark.parametrize("rest", [-0.5, 0.5, 0.4999, -0.49999, 0.0, 3.5, 2.5])
def test_rest_near_a_crossing_dithers_never(rest, bits):
    points = [[0.0], [rest], [rest], [rest + 1.75], [rest], [0.0]]
    ((_, signs),), _ = check(chain(points, [0.02, 0.01, 0.03, 0.03, 0.02]), bits=bits, ticks=390)
    there, beyond = math.floor(rest + 0.5), math.floor(rest + 2.25)
    assert len(signs) == 2 * abs(there) + 2 * (beyond - there)
    assert (np.diff(signs) != 0).sum() <= 3


def test_rest_a_unit_beyond_a_crossing_keeps_a_thousandth_of_a_step_from_it():
    # short words: 400 ticks leave up to 200 units of rounding
    converter, _ = converted(chain([[0.0], [0.5 + 2.0**-31]], [0.0213]), word_bits=32)
    assert converter.position.tolist() == [1]
    assert converter.fraction[0] == pytest.approx(2**31 / 1024, abs=200)


def test_what_comes_and_goes_between_two_rests_is_not_taken_for_rest():
    # 0.11 steps beyond a crossing for a moment, anywhere in the grid of 1.025 ms
    for wait in 0.02 + 0.001025 * np.arange(8):
        points = [[0.45], [0.45], [0.61], [0.45], [0.45]]
        ((_, signs),), _ = check(chain(points, [wait, 0.0022, 0.0022, 0.03]))
        assert signs.tolist() == [1, -1]


def test_slow_motion_makes_each_step_once():
    for bits in (63, 31):
        ((_, signs),), _ = check(chain([[0.0], [3.0]], [1.0]), bits=bits)
        assert signs.tolist() == [1, 1, 1]


def test_a_start_of_acceleration_within_a_move_makes_no_step_back():
    # at rest a thousandth above a crossing; a parabola through three points would dip below it
    for wait in np.linspace(0.010, 0.011, 9):
        points = [[-0.4985], [-0.4985], [40.0]]
        ((_, signs),), _ = check(chain(points, [wait, 0.04]), ticks=600)
        assert (signs == 1).all()


def test_a_known_accumulator_is_where_the_motion_starts():
    plan = chain([[10.0], [12.0]], [0.05])
    converter, moves = converted(plan, position=[9], fraction=[3 << 61])
    ticks, signs = accumulate(moves, 0, (9 << 63) + (3 << 61), 63)
    assert signs.tolist() == [1, 1, 1]
    assert ticks[0] < 400  # during the lead
    assert converter.position.tolist() == [12]


@pytest.mark.parametrize("bits", [63, 31])
def test_a_job_ends_at_whole_steps_without_a_step(bits):
    plan = chain([[0.0, 0.3], [-2.2, 5.4]], [0.05])
    converter, _ = converted(plan, word_bits=bits + 1)
    at = converter.position.tolist(), converter.fraction.tolist()
    start = [(p << bits) + f for p, f in zip(*at, strict=True)]
    moves = converter.finish()
    assert moves.duration.tolist() == [400, 1]
    for i, (acc, end) in enumerate(zip(start, [-2, 5], strict=True)):
        ticks, _ = accumulate(moves, i, acc, bits)
        assert len(ticks) == 0
        assert (moves.position[-1, i], moves.fraction[-1, i]) == (end, 0)
    assert converter.fraction.tolist() == [0, 0]


def test_velocity_above_a_step_per_tick_is_refused():
    with pytest.raises(MotionLimitError, match=r"motor 0: needs 1\.08 steps per tick"):
        converted(line(420_000.0, 0.01), ticks=400, tick=41)


def test_a_plan_that_moves_leave_is_refused():
    # a jump of velocity by 1000 steps/s cannot be followed by moves of 16 ms
    plan = chain([[0.0], [8.0], [0.0]], [0.02, 0.02])
    with pytest.raises(MotionLimitError, match=r"motor 0: misses the plan by .* steps at 0\.0"):
        converted(plan, ticks=6400)


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.floats(-6, 6, allow_nan=False), min_size=2, max_size=5),
    st.sampled_from([63, 31]),
    st.sampled_from([1, 2]),
    st.data(),
)
def test_any_plan_within_limits_is_followed_without_a_step_against_it(points, bits, twice, data):
    ways = np.abs(np.diff(points))
    # acceleration 6 d / t^2 of at most 1.6e5 steps/s^2
    least = np.sqrt(6 * ways / 160_000) + 1e-3
    times = [t * data.draw(st.floats(1, 3)) for t in least.tolist()]
    plan = chain(np.array(points)[:, None] * np.ones((1, twice)), times)
    steps, _ = check(plan, bits=bits, ticks=616)
    for seconds, signs in steps:
        # crossings of the plan; one more or less, there and back, only where it turns close to one
        borders = np.abs(np.diff(np.floor(np.array(points) + 0.5))).sum()
        assert abs(len(signs) - borders) <= 2 * (len(points) - 2)
        assert (np.diff(seconds) > 0).all()
