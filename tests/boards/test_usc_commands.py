"""The conversion against a board that is simulated tick by tick from the tables of its document."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numba import njit

from pulsewright.boards.usc.commands import Converter, PulseTiming, Updates
from pulsewright.errors import MotionLimitError
from pulsewright.motion.trajectory import Trajectory

TICK_HZ = 10_000_000
CYCLES = 4  # clock cycles of a tick
ACCESS = 60  # clock cycles of a bus access


@njit(cache=True)
def simulate(commit, divisor, settle, run, direction, width, setup, space, offset, ticks):
    """One axis, one tick at a time: rate generator and pulse former as their tables say.

    New divisors act from tick ``commit[j]``, run and direction from ``settle[j]``. Returns the
    tick and sign of every pulse.
    """
    pulses = np.empty(ticks // 2, np.int64)
    signs = np.empty(ticks // 2, np.int64)
    n = 0
    count = step = level = w = q = h = g = 0
    level = 1
    N = R = 0
    bit = 1
    j = k = 0
    for t in range(ticks):
        while j < commit.size and commit[j] <= t:
            N = divisor[j]
            j += 1
        while k < settle.size and settle[k] <= t:
            R, bit = run[k], direction[k]
            k += 1
        active = R == 1 and N != 0
        due = active and count + 1 >= N + offset
        ready = step == 0 and q == 0 and g == 0 and level == bit
        start = due and ready
        if not active or start:
            count = 0
        elif not due:
            count += 1
        q0, h0, g0 = q, h, g
        if start:
            step, w = 1, width - 1
            pulses[n], signs[n] = t, 2 * bit - 1
            n += 1
        elif step == 1 and w > 0:
            w -= 1
        elif step == 1:
            step, q, h = 0, space - 1, setup - 1
            continue
        if step == 0:
            q, h, g = max(q0 - 1, 0), max(h0 - 1, 0), max(g0 - 1, 0)
            if h0 == 0 and level != bit:
                level, g = bit, setup - 1
    return pulses[:n], signs[:n]


def pieces(duration, acceleration, scale):
    """Motors on one path coordinate s(t), with piecewise constant acceleration, from rest."""
    start = np.concatenate([[0.0], np.cumsum(duration)])
    law = np.zeros((len(duration), 4))
    s = v = 0.0
    for k, (t, a) in enumerate(zip(duration, acceleration, strict=True)):
        law[k] = s, v, a / 2, 0.0
        s, v = s + v * t + a * t * t / 2, v + a * t
    motors = len(scale)
    poly = np.zeros((1, 4, motors))
    poly[0, 1] = scale
    return Trajectory(
        poly=poly,
        cosine=np.zeros((1, motors)),
        sine=np.zeros((1, motors)),
        omega=np.zeros(1),
        length=np.array([1.0]),
        move=np.zeros(1, np.int32),
        element=np.zeros(len(duration), np.int32),
        start=start,
        law=law,
    )


def there_and_back(rates, times):
    """Ramp through the given signed rates and come to rest at the end."""
    steps = np.diff(np.concatenate([[0.0], rates, [0.0]]))
    durations = np.array(times)
    return durations, steps / durations


def convert_all(plan, timing, portion=1 << 30, **kwargs):
    rate = np.abs(plan.at(plan.start, 1)).max()
    bend = 2 * np.abs(plan.law[:, 2]).max() * np.abs(plan.poly[0, 1]).max()
    update = timing.update_period(rate, bend)
    converter = Converter(plan, timing, first_cycle=4000, update=update, **kwargs)
    parts = []
    while not converter.done:
        parts.append(converter.convert(portion))
    joined = Updates(
        *(
            np.concatenate([getattr(p, name) for p in parts])
            for name in ("cycle", "divisor", "control", "count")
        )
    )
    return converter, joined


def check_against_the_board(plan, timing, portion=1 << 30):
    converter, updates = convert_all(plan, timing, portion)
    ticks = int((updates.cycle[-1] + converter.update_cycles) // CYCLES)
    worst = 0.0
    for motor in range(plan.axes):
        commit = (updates.cycle + (3 + 3 * motor) * ACCESS) // CYCLES + 1
        settle = (updates.cycle + 13 * ACCESS) // CYCLES + 1
        run = (updates.control >> (2 * motor + 1)) & 1
        bit = (updates.control >> (2 * motor)) & 1
        pulses, signs = simulate(
            commit,
            updates.divisor[:, motor].astype(np.int64),
            settle,
            run.astype(np.int64),
            bit.astype(np.int64),
            timing.width,
            timing.setup,
            timing.space,
            timing.div_offset,
            ticks,
        )
        position = np.concatenate([[0], np.cumsum(signs)])
        # the model counts every pulse before the next update takes effect
        seen = position[np.searchsorted(pulses, np.append(commit[1:], ticks), side="left")]
        assert seen.tolist() == updates.count[:, motor].tolist()
        time = (pulses * CYCLES - converter.start_cycle) / (CYCLES * TICK_HZ)
        planned = plan.at(time)[:, motor]
        for side in (position[:-1], position[1:]):
            worst = max(worst, np.abs(side - planned).max(initial=0.0))
        end = plan.at(plan.duration)[0, motor]
        assert abs(position[-1] - end) <= 0.5 + 1e-9
    return worst


TIMING = PulseTiming(width=25, space=25, setup=50, div_offset=1, access=ACCESS)


def test_a_constant_rate_becomes_its_divisor():
    # 1000 step/s = 10000 ticks, divisor 9999 with offset 1 and 9996 with offset 4
    for offset, divisor in ((1, 9999), (4, 9996)):
        plan = pieces([0.01, 0.5, 0.01], [1e5, 0.0, -1e5], [1.0])
        timing = PulseTiming(width=25, space=25, setup=50, div_offset=offset, access=ACCESS)
        _, updates = convert_all(plan, timing)
        middle = updates.divisor[len(updates) // 2 - 50 : len(updates) // 2 + 50, 0]
        assert set(middle.tolist()) == {divisor}
        assert updates.control[len(updates) // 2] == 0x57


def test_standstill_halts_every_axis():
    plan = pieces([0.05], [0.0], [1.0, 1.0, 1.0, 1.0])
    _, updates = convert_all(plan, TIMING)
    assert set(updates.control.tolist()) == {0x55}


@pytest.mark.parametrize("scale", [[100.0], [3000.0, -2999.3, 17.0, 0.7]])
def test_reversals_follow_the_plan(scale):
    rates = [10.0, -10.0, 3.0, -0.2, 0.2, -6.0]
    plan = pieces(*there_and_back(rates, [0.05, 0.1, 0.06, 0.3, 0.2, 0.1, 0.05]), scale)
    assert check_against_the_board(plan, TIMING) < 1.1


@settings(max_examples=25, deadline=None)
@given(
    rates=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=5),
    times=st.lists(st.floats(0.001, 0.05), min_size=6, max_size=6),
    top=st.floats(10.0, 90_000.0),
    scale=st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4),
    portion=st.integers(1, 50),
    width=st.integers(2, 40),
    setup=st.integers(1, 255),
    offset=st.sampled_from([1, 4]),
)
def test_any_motion_within_the_limits_is_followed_exactly(
    rates, times, top, scale, portion, width, setup, offset
):
    timing = PulseTiming(width=width, space=20, setup=setup, div_offset=offset, access=ACCESS)
    rates = np.array(rates) * min(top, timing.max_rate)
    durations, acceleration = there_and_back(rates, times[: len(rates) + 1])
    # updates can be as short as this, and follow a bend of 0.1 step each
    shortest = timing.shortest_update / TICK_HZ
    assume(np.abs(acceleration).max() < 0.8 / shortest**2)
    plan = pieces(durations, acceleration, scale)
    assert check_against_the_board(plan, timing, portion) < 1.1


def test_steps_fall_when_the_plan_passes_the_middle():
    # 20,000 step/s, reached in 0.5 s: an update of 1 ms departs from a constant rate by
    # 40,000 * 0.001^2 / 8 = 0.005 steps, and whole ticks of 20 periods of 500 by 20 / 2 / 500
    plan = pieces([0.5, 0.2, 0.5], [4e4, 0.0, -4e4], [1.0, -0.61])
    assert check_against_the_board(plan, TIMING) < 0.5 + 0.005 + 0.02 + 2 / 500


def in_turn(*parts):
    """Two motors along lines of so many steps, or three quarters of a circle, from rest to rest."""
    count, duration = len(parts), 0.5
    poly, cosine, sine = np.zeros((count, 4, 2)), np.zeros((count, 2)), np.zeros((count, 2))
    omega, place = np.zeros(count), np.zeros(2)
    for e, part in enumerate(parts):
        poly[e, 0] = place
        if np.ndim(part):
            poly[e, 1] = part
            place = place + part
        else:  # the radius
            poly[e, 0, 0] -= part
            cosine[e, 0] = sine[e, 1] = part
            omega[e] = 1.5 * np.pi
            place = place - part
    half, rate = duration / 2, 2 / duration
    return Trajectory(
        poly=poly,
        cosine=cosine,
        sine=sine,
        omega=omega,
        length=np.ones(count),
        move=np.arange(count, dtype=np.int32),
        element=np.repeat(np.arange(count, dtype=np.int32), 2),
        start=np.arange(2 * count + 1) * half,
        law=np.tile([[0, 0, rate / duration, 0], [0.5, rate, -rate / duration, 0]], (count, 1)),
    )


@pytest.mark.parametrize(
    "parts",
    [[(900, 0), (0, 500)], [(900, 0), (0, 0), (0, 500), (-1, 0)], [(900, 0), 40.0], [(0, 900), 40]],
)
def test_a_motor_that_rested_moves_when_the_plan_does(parts):
    plan = in_turn(*(np.asarray(p, float) for p in parts))
    assert check_against_the_board(plan, TIMING) < 1.1
    assert check_against_the_board(plan, TIMING, portion=300) < 1.1


def test_portions_do_not_change_the_commands():
    plan = pieces([0.1, 0.2, 0.1], [2e5, 0.0, -2e5], [1.0, -0.3])
    _, whole = convert_all(plan, TIMING)
    _, parts = convert_all(plan, TIMING, portion=7)
    assert whole.divisor.tolist() == parts.divisor.tolist()
    assert whole.control.tolist() == parts.control.tolist()
    assert whole.cycle.tolist() == parts.cycle.tolist()


def test_a_rate_beyond_the_board_is_an_error_that_names_the_limit():
    # width 25 + space 25 ticks: 200 kHz by the pulses; updates no faster than 42 us allow 100 ns *
    # sqrt(2 * 420) = 2.9 us, which is less
    assert TIMING.max_rate == pytest.approx(200_000)
    with pytest.raises(MotionLimitError, match="200000 step/s"):
        TIMING.update_period(200_001, 1e5)
    with pytest.raises(MotionLimitError, match="acceleration"):
        TIMING.update_period(1000, 1e9)


def test_more_motors_than_axes_are_refused():
    with pytest.raises(MotionLimitError, match="5 motors"):
        Converter(pieces([1.0], [0.0], [1.0] * 5), TIMING, first_cycle=0, update=10_000)
