"""The conversion against a board simulated tick by tick from the rules of its specification."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numba import njit

from pulsewright.boards.pluto_step.commands import Converter, PulseTiming, Updates
from pulsewright.boards.pluto_step.limits import finest_tap, velocity_limit
from pulsewright.errors import MotionLimitError
from pulsewright.motion.trajectory import Trajectory

TICK_HZ = 625_000
CYCLES = 64  # clock cycles of a tick
ACCESS = 60  # clock cycles of a bus access


@njit(cache=True)
def simulate(commit, velocity, s, t, tap, start, ticks):
    """One axis, one tick at a time, as the table of the step generator says.

    New velocities act from tick ``commit[j]``. Returns the position register before each tick, and
    step and direction after it.
    """
    run, hold, setup = 0, 1, 2
    pos = np.empty(ticks + 1, np.int64)
    steps = np.empty(ticks, np.int64)
    directions = np.empty(ticks, np.int64)
    position, step, direction, timer, mode = start, 0, 0, 0, run
    last = (start >> (11 + tap)) & 1
    v = j = 0
    for tick in range(ticks):
        while j < commit.size and commit[j] <= tick:
            v = velocity[j]
            j += 1
        pos[tick] = position
        negative = 1 if v < 0 else 0
        bit = (position >> (11 + tap)) & 1
        want, pend = direction != negative, bit != last
        if want and not pend:
            if timer > 0:
                timer -= 1
            elif mode == hold:
                direction, timer, mode = negative, t, setup
            else:
                step, timer, mode = 0, t, hold
        elif mode == setup:
            if timer > 0:
                timer -= 1
            else:
                mode = run
        else:
            if timer > 0:
                timer -= 1
            elif pend:
                last, step, timer = bit, 1, s
            else:
                step = 0
            if not want:
                position += v
        steps[tick] = step
        directions[tick] = direction
    pos[ticks] = position
    return pos, steps, directions


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
    durations = np.array(times)
    return durations, np.diff(np.concatenate([[0.0], rates, [0.0]])) / durations


def convert_all(plan, timing, portion=1 << 30, units=(0, 0, 0, 0), update=None):
    rate = np.abs(plan.at(plan.start, 1)).max()
    bend = 2 * np.abs(plan.law[:, 2]).max() * np.abs(plan.poly[0, 1]).max()
    update = update or timing.update_period(rate, bend)
    converter = Converter(plan, timing, units=units, first_cycle=6400, update=update)
    parts = []
    while not converter.done:
        parts.append(converter.convert(portion))
    names = ("cycle", "velocity", "count")
    return converter, Updates(*(np.concatenate([getattr(p, n) for p in parts]) for n in names))


def check_against_the_board(plan, timing, portion=1 << 30, units=(0, 0, 0, 0)):
    """Return the largest distance of count and plan, before and after every step [step]."""
    converter, updates = convert_all(plan, timing, portion, units)
    ticks = int((updates.cycle[-1] + converter.update_cycles) // CYCLES)
    worst = 0.0
    for motor in range(plan.axes):
        commit = (updates.cycle + (2 + 2 * motor) * ACCESS) // CYCLES + 1
        pos, step, direction = simulate(
            commit,
            updates.velocity[:, motor].astype(np.int64),
            timing.step - 1,
            timing.direction - 1,
            timing.tap,
            units[motor],
            ticks,
        )
        rise = np.flatnonzero(np.diff(step, prepend=0) > 0)
        fall = np.flatnonzero(np.diff(step, prepend=0) < 0)
        if len(rise):
            assert set((fall - rise).tolist()) == {timing.step}
            assert (rise[1:] - fall[:-1]).min(initial=timing.space) >= timing.space
        count = np.concatenate([[0], np.cumsum(1 - 2 * direction[rise])])
        # the model counts every step that is under way when the next update takes effect
        unit = 2048 << timing.tap
        seen = pos[np.append(commit[1:], ticks)] // unit - units[motor] // unit
        assert seen.tolist() == updates.count[:, motor].tolist()
        assert count[-1] == updates.count[-1, motor]
        assert pos[-1] - units[motor] // unit * unit == converter.units[motor]  # to the last unit
        time = (rise * CYCLES - converter.start_cycle) / (CYCLES * TICK_HZ)
        planned = plan.at(time)[:, motor]
        for side in (count[:-1], count[1:]):
            worst = max(worst, np.abs(side - planned).max(initial=0.0))
        assert abs(count[-1] - plan.at(plan.duration)[0, motor]) <= 0.5 + 1e-9
    return worst


def timing_of(tap, step=2, space=2, direction=4):
    return PulseTiming(step=step, space=space, direction=direction, tap=tap, access=ACCESS)


@pytest.mark.parametrize(("tap", "word"), [(0, 33), (1, 66), (2, 131), (3, 262)])
def test_a_constant_rate_becomes_its_word(tap, word):
    # 10 kHz is 10000 / 625000 x 2048 = 32.768 units per tick at tap 0
    plan = pieces([0.02, 0.5, 0.02], [5e5, 0.0, -5e5], [1.0])
    _, updates = convert_all(plan, timing_of(tap))
    middle = updates.velocity[len(updates) // 2 - 100 : len(updates) // 2 + 100, 0]
    assert middle.mean() == pytest.approx(10_000 / 625_000 * 2048 * 2**tap, abs=0.01)
    assert set(middle.tolist()) <= {word - 1, word, word + 1}


def test_standstill_is_word_0_but_for_the_way_to_the_middle_of_a_step():
    _, updates = convert_all(pieces([0.05], [0.0], [1.0, 1.0, 1.0, 1.0]), timing_of(0))
    # 1024 units in 625 ticks
    assert updates.velocity[0].tolist() == [2, 2, 2, 2]
    assert not updates.velocity[1:].any()
    assert not updates.count.any()


@pytest.mark.parametrize("units", [(0, 0, 0, 0), (2047, 1, 2**21 - 1, 123_456)])
@pytest.mark.parametrize("tap", [0, 3])
def test_reversals_follow_the_plan(tap, units):
    rates = [10.0, -10.0, 3.0, -0.2, 0.2, -6.0]
    plan = pieces(
        *there_and_back(rates, [0.05, 0.1, 0.06, 0.3, 0.2, 0.1, 0.05]), [1200.0, -1199.7, 17.0, 0.7]
    )
    assert check_against_the_board(plan, timing_of(tap), units=units) < 0.5 + 0.2


def test_a_reversal_waits_for_the_pulse_before_it():
    """Of 40 fast reversals some come within the 16 ticks of a pulse after its crossing."""
    rates = 8000.0 * (-1.0) ** np.arange(40)
    plan = pieces(*there_and_back(rates, np.full(41, 0.0051)), [1.0, -0.77, 0.53, 0.31])
    assert check_against_the_board(plan, timing_of(3, step=16, space=20)) < 0.5 + 0.3


@pytest.mark.parametrize("tap", [0, 1, 2, 3])
def test_at_1_khz_the_word_costs_less_than_a_fifth_of_a_step(tap):
    """Slow and fast, forward and back, updates of 1 ms; the plan bends 0.03 steps in one."""
    top = 30_000.0
    rates, times = [top, -0.37 * top, -3.0, 3.0], [0.4, 0.5, 0.3, 0.1, 0.1]
    plan = pieces(*there_and_back(rates, times), [1.0, -0.31, 0.01, 1.0])
    timing = timing_of(tap)
    converter, _ = convert_all(plan, timing)
    assert converter.update_cycles == 40_000
    assert check_against_the_board(plan, timing) < 0.5 + 0.2


@pytest.mark.parametrize("end", [3.5001, 3.4999, -3.5001, -3.4999, 0.49999, 7.0, -0.5001])
@pytest.mark.parametrize("tap", [0, 3])
def test_the_count_is_right_where_the_plan_ends_between_two_steps(tap, end):
    plan = pieces([0.05, 0.05], [end / 0.05**2, -end / 0.05**2], [1.0])
    _, updates = convert_all(plan, timing_of(tap))
    assert updates.count[-1, 0] == round(end)
    assert not updates.velocity[-2:].any()
    check_against_the_board(plan, timing_of(tap))


@settings(max_examples=25, deadline=None)
@given(
    rates=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=5),
    times=st.lists(st.floats(0.001, 0.05), min_size=6, max_size=6),
    top=st.floats(10.0, 300_000.0),
    scale=st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4),
    portion=st.integers(1, 50),
    step=st.integers(1, 16),
    space=st.integers(1, 20),
    direction=st.integers(1, 16),
    tap=st.integers(0, 3),
    units=st.lists(st.integers(0, 2**21 - 1), min_size=4, max_size=4),
)
def test_any_motion_within_the_limits_is_followed_exactly(
    rates, times, top, scale, portion, step, space, direction, tap, units
):
    timing = timing_of(tap, step, space, direction)
    rates = np.array(rates) * min(top, timing.max_rate)
    durations, acceleration = there_and_back(rates, times[: len(rates) + 1])
    # updates can be as short as this, and follow a bend of 0.1 step each
    shortest = timing.shortest_update / TICK_HZ
    assume(np.abs(acceleration).max() < 0.8 / shortest**2)
    plan = pieces(durations, acceleration, scale)
    # the word costs 0.2 step at most, the bend within an update 0.1, and a step waits for a tick
    bound = 0.5 + 0.3 + np.abs(rates).max() / TICK_HZ
    assert check_against_the_board(plan, timing, portion, units) < bound


def test_portions_do_not_change_the_commands():
    plan = pieces([0.1, 0.2, 0.1], [2e5, 0.0, -2e5], [1.0, -0.3])
    _, whole = convert_all(plan, timing_of(2))
    _, parts = convert_all(plan, timing_of(2), portion=7)
    for name in ("cycle", "velocity", "count"):
        assert getattr(whole, name).tolist() == getattr(parts, name).tolist()


def test_updates_reach_to_a_time_of_the_plan():
    plan = pieces([0.1], [0.0], [1.0])
    converter = Converter(plan, timing_of(0), units=[0] * 4, first_cycle=0, update=625)
    assert converter.start_cycle == 40_000
    # bursts at 0, 1, ... ms; second 0 of the plan at 1 ms
    assert converter.updates_until(0.0095) == 11
    converter.convert(11)
    assert converter.updates_until(0.0095) == 0
    assert converter.updates_until(1e9) == 104 - 11
    assert len(converter.convert(1 << 30)) == 93
    assert converter.done
    assert len(converter.convert(5)) == 0


def test_limits_are_those_of_the_table():
    """Table of section 4.2: 2048 / (S + 2), at most 1024; k more ticks of space count like S."""
    table = [1024, 682, 512, 409, 341, 292, 256, 227, 204, 186, 170, 157, 146, 136, 128, 120]
    assert [velocity_limit(0, s + 1, 1) for s in range(16)] == table
    assert velocity_limit(3, 2, 4) == 1024
    assert velocity_limit(3, 16, 4) == 819
    # 1023 x 38.147 Hz, 76.29, 152.59; 1024 x 305.18
    rates = (39_024, 39_025, 78_048, 78_050, 156_097, 156_099, 312_500, 312_501)
    assert [finest_tap(rate, 1, 1) for rate in rates] == [3, 2, 2, 1, 1, 0, 0, None]


def test_what_the_board_cannot_follow_is_an_error_that_names_the_limit():
    timing = timing_of(3)
    assert timing.max_rate == pytest.approx(1023 * 625_000 / 16384)
    with pytest.raises(MotionLimitError, match=r"39025 step/s asked.* up to 39024 step/s"):
        timing.update_period(39_024.7, 1e5)
    # a burst of 11 x 60 cycles lasts 11 ticks; a reversal 2 x 2 + 2 x 4 + 1 = 13: twice that
    assert timing.shortest_update == 26
    with pytest.raises(
        MotionLimitError, match=r"1e\+09 step/s\^2 .*41.6 us follow up to 4.62e\+08"
    ):
        timing.update_period(1000, 1e9)
    with pytest.raises(MotionLimitError, match="5 motors, one board drives 4"):
        Converter(pieces([1.0], [0.0], [1.0] * 5), timing, units=[0] * 4, first_cycle=0, update=625)


def test_a_plan_that_outruns_the_board_is_caught():
    """``update_period`` was told less than the plan asks for."""
    plan = pieces([0.01, 0.05, 0.01], [6e6, 0.0, -6e6], [1.0])
    with pytest.raises(MotionLimitError, match=r"axis 0: misses the plan by .* at 0.0"):
        convert_all(plan, timing_of(3), update=625)
