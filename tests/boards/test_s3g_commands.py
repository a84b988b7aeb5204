"""Planned motion as loads and program words, against the rules of the board's document."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pulsewright.boards.s3g import commands
from pulsewright.boards.s3g import registers as reg
from pulsewright.boards.s3g.commands import (
    DEVIATION,
    Abort,
    Converter,
    Encoder,
    Segments,
    grid_step,
    moving_together,
)
from pulsewright.boards.s3g.program import instruction
from pulsewright.boards.s3g.pulses import PulseTiming
from pulsewright.boards.s3g.words import control, load_control, output
from pulsewright.errors import MotionLimitError
from pulsewright.motion.rejoin import rejoin
from pulsewright.motion.trajectory import Trajectory

U = 65536  # units of a step
CLOCK = 50_000_000
TIMING = PulseTiming(250, 375, 499)  # 500 clocks from step to step at least


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


def steps_of(segments, origin, grid):
    """Return cycles after time 0 and signs of the steps of one motor, by the rule of the position.

    It grows by the velocity in every clock; a step comes where bit 16 changes.
    """
    cycles, signs, x, border = [], [], origin, 0
    for n, v in zip(segments.steps.tolist(), segments.velocity.tolist(), strict=True):
        end = x + v * n * grid
        crossed = np.arange(min(x, end) // U + 1, max(x, end) // U + 1) * U
        if v > 0:
            cycles += (border - (x - crossed) // v).tolist()
        elif v < 0:
            cycles += (border + (x - crossed[::-1]) // -v + 1).tolist()
        signs += [1 if v > 0 else -1] * len(crossed)
        x, border = end, border + n * grid
    return np.array(cycles, np.int64), np.array(signs, np.int64)


def check(plan, grid, timing=TIMING):
    """Convert a plan and check what is promised; return loads and distance from the plan."""
    converter = Converter(plan, timing, grid=grid)
    segments = converter.convert(10**9)
    assert converter.done
    assert segments.steps.sum() == converter.at >= plan.duration * CLOCK / grid
    assert abs(segments.velocity).max() <= timing.limit
    worst = 0.0
    for i in range(plan.axes):
        one = Segments(segments.steps, segments.velocity[:, i], segments.position[:, i])
        cycles, signs = steps_of(one, int(converter.origin[i]), grid)
        counts = int(converter.origin[i]) // U + np.cumsum(signs)
        assert (np.diff(cycles) >= timing.spacing).all()
        if len(cycles):
            crossed = counts - signs / 2
            worst = max(worst, float(abs(crossed - plan.at(cycles / CLOCK)[:, i]).max()))
        end = plan.at(math.inf)[0, i]
        assert abs((counts[-1] if len(counts) else converter.origin[i] // U) - end) <= 0.5
    assert worst <= DEVIATION
    return segments, worst


# ------------------------------------------------------------------------------ words and timing


def test_words_are_those_of_the_document():
    assert output(0, 0x3C) == 0x40_0000003C
    assert output(10, -1) == 0x4A_FFFFFFFF
    assert control(63, 7) == 0xBF_00000007
    assert control(1, 1 << 31) == 0x81_80000000


def test_load_bits_of_the_first_three_channels_are_in_register_3_and_the_others_in_60():
    assert load_control(0b1111, 0b10, 2) == {3: 0x0000_020F | 0x0002_0000}
    assert load_control(0, 0b11111, 6) == {3: 0x1F1F_1F00, 60: 0x1F_1F1F}


@pytest.mark.parametrize(
    ("times", "thresholds"),
    [
        # setup, then width, are the first two thresholds; steps 250 = 125 + 125 apart, or as hold
        ((125, 125, 10, 10), (10, 135, 249)),
        ((125, 125, 250, 250), (250, 375, 499)),
        ((125, 125, 400, 0), (400, 525, 525)),
        ((1, 0, 0, 0), (1, 2, 2)),
    ],
)
def test_thresholds_keep_the_times_of_the_drive(times, thresholds):
    timing = PulseTiming.of(**dict(zip(("width", "space", "setup", "hold"), times, strict=True)))
    assert (timing.pre, timing.pulse, timing.post) == thresholds


def test_the_largest_velocity_makes_steps_just_as_far_apart_as_pulses_allow():
    assert (TIMING.spacing, TIMING.limit) == (500, 131)
    assert 65536 // 131 == 500
    assert 65536 // 132 < 500


# ------------------------------------------------------------------------------ the grid


def test_the_grid_is_as_long_as_the_link_takes_for_a_load_and_a_tenth():
    # 3 motors and 3 more words of 6100 clocks
    assert grid_step(TIMING, motors=3, word_cycles=6100, rate=20_000, acceleration=1e5) == 40_260
    assert grid_step(TIMING, motors=1, word_cycles=100, rate=1, acceleration=1) == 12_500


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        # (131 - 1) * 50e6 / 65536
        ({"rate": 99_200}, r"99200 step/s asked.* up to 99182 step/s"),
        # 8 * 0.1 * (50e6 / 40260)^2
        ({"acceleration": 1.3e6}, r"1.3e\+06 step/s\^2 asked.* up to 1.23e\+06"),
        ({"word_cycles": 9900}, "1307 us for the 6 words .* allowed are 1280 us"),
        ({"timing": PulseTiming(1, 2, 40_260), "rate": 1}, "805.22 us from step to step"),
    ],
)
def test_what_the_board_cannot_follow_is_refused_with_what_it_can(changes, message):
    asked = {
        "timing": TIMING,
        "motors": 3,
        "word_cycles": 6100,
        "rate": 99_182,
        "acceleration": 1.2e6,
    }
    grid_step(**{**asked, "rate": 1})
    with pytest.raises(MotionLimitError, match=message):
        grid_step(**asked | changes)


def test_motors_that_move_together_are_counted_by_element(monkeypatch):
    plan = chain([[0, 0, 0], [1, 2, 0], [1, 2, 3], [1, 2, 3]], [1, 1, 1])
    assert moving_together(plan) == 2
    monkeypatch.setattr(commands, "PORTION", 1)
    assert moving_together(plan) == 2
    assert moving_together(swing(1, 10, 1, motors=4)) == 4
    assert moving_together(chain([[0], [0]], [1])) == 1


# ------------------------------------------------------------------------------ conversion


@pytest.mark.parametrize("grid", [12_500, 40_961, 64_000])
def test_random_moves_from_rest_to_rest_keep_what_is_promised(grid):
    rng = np.random.default_rng(grid)
    for _ in range(4):
        n = 100
        size = 10 ** rng.uniform(-1.5, 2.3, (n, 1))
        points = np.cumsum(size * rng.normal(size=(n, 3)) * rng.integers(0, 2, (n, 3)), axis=0)
        points = np.concatenate([np.zeros((1, 3)), points])
        way = abs(np.diff(points, axis=0)).max(axis=1)
        # at most 50 000 step/s, and 150 000 step/s^2
        times = np.maximum(1.5 * way / 50_000, np.sqrt(6 * way / 150_000))
        times = np.maximum(times * rng.uniform(1, 3, n), 1e-4)
        _, worst = check(chain(points, times), grid)
        # half a unit of velocity over the grid, and what the plan bends in it
        assert worst <= grid / 2 / U + 150_000 * (grid / CLOCK) ** 2 / 8 + 0.02


@pytest.mark.parametrize(("grid", "amplitude", "rate"), [
    (12_500, 300, 20_000), (40_000, 0.45, 90), (40_000, 0.52, 300), (40_000, 3, 1500),
    (40_000, 5000, 60_000), (64_000, 0.6, 200), (64_000, 700, 9000), (64_000, 1.3, 700),
])  # fmt: skip
@pytest.mark.parametrize("slope", [0.0, 31.0])
def test_motion_that_turns_anywhere_keeps_what_is_promised(grid, amplitude, rate, slope):
    for phase in np.linspace(-0.5, 0.5, 5):
        plan = swing(1.5, amplitude, rate, slope=slope)
        plan.poly[0, 0] += phase
        check(plan, grid)


def test_no_step_goes_back_while_the_plan_does_not():
    rng = np.random.default_rng(5)
    size = 10 ** rng.uniform(-1.5, 1.5, (300, 1))
    points = np.concatenate([np.zeros((1, 1)), np.cumsum(size, axis=0)])
    times = np.maximum(np.sqrt(6 * size[:, 0] / 1e5), 1e-3)
    for grid in (12_500, 40_000, 64_000):
        segments, _ = check(chain(points, times), grid)
        assert segments.velocity.min() >= 0


@pytest.mark.parametrize(
    ("distance", "velocity"),
    [(0, 0), (20_000, 0), (20_001, 1), (60_000, 1), (60_001, 2), (-20_000, 0), (-60_001, -2)],
)
def test_of_two_velocities_as_close_the_slower_is_taken(distance, velocity):
    """Otherwise a position that is ahead by just half a unit would go back at rest."""
    from pulsewright.boards.s3g.commands_kernel import nearest

    assert nearest(distance, 40_000) == velocity


@pytest.mark.parametrize("end", [0.49, 0.51, -0.49, -0.51, 7.499, 7.501])
def test_where_the_plan_rests_close_to_half_a_step_the_count_is_right(end):
    plan = chain([[0.0], [end], [end], [0.0]], [0.05, 0.2, 0.05])
    grid = 40_000
    segments, _ = check(plan, grid)
    rest = np.cumsum(segments.steps) * grid / CLOCK
    resting = segments.position[(rest > 0.0516) & (rest < 0.25), 0] // U  # two grid steps later
    assert len(resting) > 3
    assert set(resting.tolist()) == {math.floor(end + 0.5)}


def test_portions_of_any_size_give_the_same_loads():
    plan = swing(0.3, 40, 3000, motors=3)
    whole = Converter(plan, TIMING, grid=30_000).convert(10**9)
    for portion in (1, 7, 100):
        converter = Converter(plan, TIMING, grid=30_000)
        parts = []
        while not converter.done:
            parts.append(converter.convert(portion))
        for column in ("steps", "velocity", "position"):
            joined = np.concatenate([getattr(part, column) for part in parts])
            assert np.array_equal(joined, getattr(whole, column))
    assert len(Converter(plan, TIMING, grid=30_000).convert(0)) == 0


def test_rest_takes_few_loads():
    segments, _ = check(chain([[3.0], [3.0]], [10.0]), 40_000)
    assert len(segments) <= 12_500 / 8 + 3
    assert not segments.velocity.any()


def test_a_motor_that_is_elsewhere_goes_to_the_plan():
    plan = chain([[5.0], [5.0]], [0.1])
    converter = Converter(plan, TIMING, grid=40_000, position=[4 * U + U // 4])
    converter.convert(10**9)
    assert converter.position[0] // U == 5


def test_motion_that_the_board_cannot_follow_is_refused_with_its_place():
    plan = chain([[0.0], [0.0], [3000.0]], [0.1, 0.02])
    with pytest.raises(MotionLimitError, match=r"motor 0: misses the plan by .* at 0\.1\d+ s"):
        Converter(plan, TIMING, grid=40_000).convert(10**9)


def test_a_reversal_that_would_lose_a_step_is_told_from_the_others():
    """A step up 100 clocks ago, 10 units back to it, and a plan that goes down at once."""
    from pulsewright.boards.s3g.commands_kernel import LOST, convert

    grid = 40_000
    # the first step down is 11 clocks away, 111 from the other one; at -1 it may wait for a load
    for least, velocity, lost in [(112, -20, True), (111, -20, False), (500, -1, False)]:
        state = np.array([[3 * U + 10 * -velocity, 7 * grid - 100, 1]])
        goals = state[0, 0] + np.arange(10)[:, None] * velocity * grid
        columns = np.zeros(1, np.int64), np.zeros((1, 1), np.int64), np.zeros((1, 1), np.int64)
        parameters = np.array([7, 1, grid, 131, least])
        used, _, worst, motor, at = convert(goals, goals, parameters, state, *columns)
        assert (used, worst >= LOST) == (int(not lost), lost)
        assert not lost or (motor, at) == (0, 7)


# ------------------------------------------------------------------------------ words of loads


def executed(words):
    """Return what each load of these words finds in the registers, and how many words that took."""
    registers, loads = {}, []
    for word in words.tolist():
        kind, opcode, data = word >> 38, word >> 32 & 63, word & 0xFFFF_FFFF
        if kind == 1:
            assert registers.get(opcode) != data, f"{instruction(word)} changes nothing"
            registers[opcode] = data
        elif opcode == 1:
            loads.append(dict(registers))
    return loads


def test_words_load_each_segment_and_write_only_what_changes():
    motors, grid = 4, 30_000
    encoder = Encoder(motors, grid, 8, Abort(400_000, np.array([1, 2, 3, 4])))
    segments = Converter(swing(0.1, 40, 3000, motors=motors), TIMING, grid=grid).convert(10**9)
    origin = np.array([5, -7, 1 << 40, -(1 << 40)])
    parts = [encoder.start(origin, known=False)]
    for k in range(0, len(segments), 10):
        rows = slice(k, k + 10)
        columns = (segments.steps, segments.velocity, segments.position)
        parts.append(encoder.encode(Segments(*(column[rows] for column in columns))))
    words = np.concatenate([part.words for part in parts])
    first, *loads = executed(words)
    # dt, steps, both reset, then x, v, a, j, jj of each channel
    assert (first[1], first[2], first[3], first[60]) == (8, grid, 0x1F1F_1F0F, 0x1F)
    assert [first[8 + 8 * c] for c in range(4)] == [5, 0xFFFF_FFF9, 0, 0]
    assert [first[9 + 8 * c] for c in range(4)] == [0, 0xFFFF_FFFF, 256, 0xFFFF_FF00]
    assert [first[15 + 8 * c] for c in range(4)] == [1, 2, 3, 4]
    assert len(loads) == len(segments)
    for load, n, velocity in zip(loads, segments.steps, segments.velocity, strict=True):
        # number and velocities, the count of steps reset; the grid stays, and aborts are slower
        assert (load[1], load[2], load[3], load[60]) == (n, 400_000, 0x0202_0205, 0x2)
        assert [load[10 + 8 * c] for c in range(4)] == [v & 0xFFFF_FFFF for v in velocity.tolist()]
    for part in parts:
        assert all(word == control(reg.OP_STB, 1) for word in part.words[part.loads])


def test_the_last_load_ends_motion_and_program():
    encoder = Encoder(2, 30_000, 8, Abort(400_000, np.array([1, 1])))
    (load,) = executed(encoder.finish(np.zeros(2, np.int64)).words)
    assert (load[2], load[3], load[10], load[18]) == (0, 0x0002_0202, 0, 0)
    assert encoder.finish(np.zeros(2, np.int64)).words[-1] == control(reg.OP_DONE, 3)


def test_an_hour_of_plan_takes_seconds():
    import time

    plan = swing(3600, 3000, 9000, motors=3)
    converter = Converter(plan, TIMING, grid=40_000)
    encoder = Encoder(3, 40_000, 8, Abort(400_000, np.array([1, 1, 1])))
    encoder.encode(converter.convert(1000))  # compiled
    begin, words = time.process_time(), 0
    while not converter.done and converter.at < 450_000:  # 6 minutes
        words += len(encoder.encode(converter.convert(50_000)).words)
    assert words > 1_000_000
    assert time.process_time() - begin < 3.0


# ------------------------------------------------------------------------------ abort and rejoin


def test_an_abort_is_as_hard_as_the_weakest_motor_may_be_in_whole_units():
    # a unit of velocity, 763 step/s, in 763 / 100 000 s = 381 470 clocks
    abort = Abort.of([100_000.0, 350_000.0], 40_000)
    assert (abort.dt, abort.deceleration.tolist()) == (381_470, [1, 3])
    assert Abort.of([1e9], 40_000).dt == 40_000
    assert Abort.of([100_000.0], 40_000, latched=True).dt == 40_000


def test_the_way_of_an_abort_is_that_of_the_document():
    # vector 13: 1000 -> 700 -> 400 -> 100 -> 0 -> 0, and the same backwards
    abort = Abort(1000, np.array([300, 300]))
    assert abort.steps(np.array([1000, -1000])) == 5
    averages = [850, 550, 250, 50, 0]
    way = abort.way(np.array([1000, -1000]), 506)
    assert way.tolist() == [500_000 + 1000 * sum(averages), -500_000 - 1000 * sum(averages)]
    # odd sums round down: floor((-101 - 50) / 2) = -76
    assert Abort(10, np.array([51])).way(np.array([-101]), 6).tolist() == [10 * (-76 - 25)]


@pytest.mark.parametrize("time", [0.0, 0.3, 0.9, 1.234, 1.9, 2.0])
def test_a_plan_is_joined_again_within_limits_and_completed(time):
    plan = swing(1.0, 500, 8000, slope=100.0)
    plan = replace(  # a second at 8000 step/s, and one that ends at 2500 step/s
        plan,
        poly=np.concatenate([plan.poly, plan.poly]),
        cosine=np.concatenate([plan.cosine] * 2),
        sine=np.concatenate([plan.sine] * 2),
        omega=np.concatenate([plan.omega] * 2),
        length=np.array([8000.0, 13_500.0]),
        move=np.array([0, 1], np.int32),
        element=np.array([0, 1], np.int32),
        start=np.array([0.0, 1.0, 2.0]),
        law=np.array([[0.0, 8000.0, 0.0, 0.0], [8000.0, 8000.0, -2000.0, -500.0]]),
    )
    place = plan.at(time)[0] + [40.0, -3.0]
    limits = {"rates": [9000.0] * 2, "accelerations": [200_000.0] * 2, "jerks": [1.6e7] * 2}
    joined = rejoin(plan, time, place, **limits)
    t = np.linspace(0, joined.duration, 100_001)
    x, v, a = (joined.at(t, n) for n in range(3))
    assert np.allclose(x[0], place)
    assert np.allclose(np.diff(x, axis=0) / t[1], (v[1:] + v[:-1]) / 2, atol=2.0)  # no jumps
    # straight back, by jerk alone: a quarter of the time each up, down, down and up
    back = 4 * (40 / (2 * 1.6e7)) ** (1 / 3)
    there = t <= back
    assert np.allclose((x[there] - place) @ [3.0, 40.0], 0.0)
    assert abs(a[there]).max() == pytest.approx(1.6e7 * back / 4, rel=0.01)
    # then the time of the plan passes from 0 to as fast as always: 1.5 * 9000 / (0.1 * 200 000) s
    since, warp = t[~there] - back, 0.675
    part = np.minimum(since / warp, 1)
    passed = warp * part**3 * (1 - part / 2) + np.maximum(since - warp, 0)
    after = np.minimum(time + passed, plan.duration)
    assert np.allclose(x[~there], plan.at(after), atol=2e-3)
    assert (abs(v) <= 9000).all()
    # 8100^2 / 500 is what the plan has in the circle, and 7000 along it
    assert abs(a[~there]).max(initial=0) <= 131_220 + 7000 + 0.1 * 200_000


def test_limits_of_the_conversion_are_those_promised():
    assert commands.LONGEST_GRID // 2 + 1 < U // 2
    assert commands.DEVIATION <= 0.6
