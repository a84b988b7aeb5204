"""Shared blocks: expected cycles by hand, or from the worked vectors of the USC specification."""

import numpy as np
import pytest

from pulsewright.gateware.divider import Divider
from pulsewright.gateware.estop import EstopChain
from pulsewright.gateware.quadrature import EncoderCounter, QuadratureDecoder
from pulsewright.gateware.serial_timer import SerialTimer
from pulsewright.gateware.step_pulse import StepPulse
from pulsewright.gateware.step_rate import PeriodCounter, PhaseAccumulator
from pulsewright.gateware.synchroniser import InputFilter
from pulsewright.gateware.watchdog import Watchdog

pytestmark = pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable")


def cycles_where(levels):
    return np.flatnonzero(levels).tolist()


def edges(levels):
    """Cycles at which a level changes, from 0 on."""
    return np.flatnonzero(np.diff(levels, prepend=0)).tolist()


# Time


@pytest.mark.parametrize("period", [8, 16, 32, 64])
def test_a_divider_goes_through_all_its_states(simulate, period):
    # In the state before the first one after 7, 15, ... edges.
    seen = simulate(Divider(period=period), 3 * period + 1, enable=1)
    assert cycles_where(seen["last"]) == [period - 2, 2 * period - 2, 3 * period - 2]


def test_a_divider_that_is_not_enabled_stands(simulate):
    seen = simulate(Divider(period=8), 60, enable={0: 1, 7: 0, 40: 1})
    assert cycles_where(seen["last"]) == [*range(6, 40), 47, 55]


@pytest.mark.parametrize("period", [0, 4, 60, 256])
def test_a_divider_refuses_other_periods(period):
    with pytest.raises(ValueError, match="period must be one of 8, 16, 32"):
        Divider(period=period)


def test_a_watchdog_expires_after_its_ticks_and_a_feed_wins_over_a_tick(simulate):
    tick = {0: 0} | {n: int(n % 10 == 0) for n in range(1, 100) if n % 10 in (0, 1)}
    seen = simulate(Watchdog(ticks=3), 100, tick=tick, feed={0: 0, 20: 1, 21: 0, 60: 1, 61: 0})
    # The ticks at 30, 40 and 50 follow the feed at 20, those at 70, 80, 90 the one at 60.
    assert cycles_where(seen["expired"]) == [*range(50, 60), *range(90, 100)]


def test_a_watchdog_can_start_expired(simulate):
    seen = simulate(Watchdog(ticks=2, starts_expired=True), 9, tick=1, feed={0: 0, 5: 1, 6: 0})
    assert cycles_where(seen["expired"]) == [0, 1, 2, 3, 4, 7, 8]


def serial(loads, clears=()):
    """Inputs of a 4-bit timer with a tick every 8 cycles; ``loads``: value by tick."""
    tick = {n: int(n % 8 == 0) for n in range(400) if n % 8 in (0, 1)}
    shift = {n: int(n % 8 in (3, 4, 5, 6)) for n in range(400)}
    bit = {8 * t + 3 + i: v >> i & 1 for t, v in loads.items() for i in range(4)}
    bit |= {8 * t + 7: 0 for t in loads}
    clear = {0: 0} | {8 * t: 1 for t in clears} | {8 * t + 1: 0 for t in clears}
    return {"tick": tick, "shift": shift, "bit": {0: 0} | bit, "clear": clear}


@pytest.mark.parametrize("value", [0, 1, 2, 7, 8, 15])
def test_a_serial_timer_is_idle_again_after_its_ticks(simulate, value):
    seen = simulate(SerialTimer(width=4), 200, **serial({2: value}))
    idle = seen["idle"][7::8]  # as the next tick sees it
    assert cycles_where(idle == 0) == list(range(2, 2 + value))


def test_a_cleared_serial_timer_is_idle_or_takes_a_new_value(simulate):
    seen = simulate(SerialTimer(width=4), 200, **serial({2: 9}, clears=[5]))
    assert cycles_where(seen["idle"][7::8] == 0) == [2, 3, 4]
    seen = simulate(SerialTimer(width=4), 200, **serial({2: 9, 5: 2}, clears=[5]))
    assert cycles_where(seen["idle"][7::8] == 0) == [2, 3, 4, 5, 6]


# Steps


def test_an_accumulator_adds_signed_velocity_and_wraps(simulate):
    seen = simulate(
        PhaseAccumulator(width=5, velocity_width=4), 6, run={0: 1, 4: 0}, velocity={0: 7, 2: -8}
    )
    assert seen["position"].tolist() == [7, 14, 6, 30, 30, 30]


def rate(simulate, cycles, offset=1, **inputs):
    inputs = {"tick": 1, "enable": 1, "ready": 1} | inputs
    seen = simulate(PeriodCounter(width=24, offset=offset), cycles, before=True, **inputs)
    return cycles_where(seen["due"])


@pytest.mark.parametrize(("offset", "divisor", "period"), [(1, 1, 2), (1, 9, 10), (4, 6, 10)])
def test_the_first_step_ends_the_first_period(simulate, offset, divisor, period):
    steps = rate(simulate, 40, offset, divisor=divisor)
    assert steps == list(range(period - 1, 40, period))


def test_a_smaller_divisor_gives_one_step_at_once(simulate):
    # Vector 9, with a tenth of its numbers: N = 999 at count 50, then N = 9.
    assert rate(simulate, 85, divisor={0: 999, 50: 9})[:4] == [50, 60, 70, 80]


def test_a_counter_that_is_enabled_again_starts_anew(simulate):
    # Vector 10: no pulse, count 0, first pulse in the tenth active tick.
    inputs = {"divisor": {0: 999, 50: 9}, "enable": {0: 1, 50: 0, 60: 1}}
    assert rate(simulate, 85, **inputs) == [69, 79]


def test_a_step_that_cannot_start_waits_and_none_are_saved_up(simulate):
    steps = rate(simulate, 60, divisor=9, ready={0: 1, 10: 0, 35: 1})
    assert steps == [9, *range(19, 36), 45, 55]


def test_only_ticks_count(simulate):
    tick = {n: int(n % 4 == 0) for n in range(200)}
    steps = rate(simulate, 100, divisor=9, tick=tick)
    # Tick 9 is edge 36, tick 19 edge 76; a step is due from the edge after the tick before.
    assert steps == [33, 34, 35, 36, 73, 74, 75, 76]


def test_width_and_set_up_time_around_a_change_of_direction(simulate):
    # Vectors 12 and 13: W = 40, S = 100, a pulse starts at 10, direction inverted after 20.
    pulse = StepPulse(min_space=3)
    times = {"tick": 1, "width": 39, "setup": 99, "direction": {0: 0, 21: 1}}
    seen = simulate(pulse, 1100, due={0: 0, 10: 1, 11: 0, 1010: 1, 1011: 0}, **times)
    assert edges(seen["step"]) == [10, 50, 1010, 1050]
    assert edges(seen["dir"]) == [150]
    seen = simulate(StepPulse(min_space=3), 500, due={0: 0, 10: 1, 11: 0, 210: 1, 251: 0}, **times)
    assert edges(seen["step"]) == [10, 50, 250, 290]


@pytest.mark.parametrize("space", [1, 3])
def test_pulses_never_merge(simulate, space):
    seen = simulate(StepPulse(min_space=space), 40, tick=1, due=1, width=0, setup=5, direction=0)
    assert edges(seen["step"])[:6] == [0, 1, 1 + space, 2 + space, 2 + 2 * space, 3 + 2 * space]


def test_the_direction_may_change_as_a_pulse_ends(simulate):
    pulse = StepPulse(change_at_fall=True)
    pins = {"tick": 1, "width": 4, "setup": 99, "direction": {0: 0, 12: 1, 30: 0}}
    seen = simulate(pulse, 50, due={0: 0, 10: 1, 17: 0, 30: 1, 32: 0}, **pins)
    # The pulse from 10 falls at 15, and the direction with it; a start due in the tick of a
    # change waits one tick.
    assert edges(seen["dir"]) == [15, 30]
    assert edges(seen["step"]) == [10, 15, 16, 21, 31, 36]


# Encoders, inputs, estop


def quadrature(states):
    return {
        "a": {4 * n: s >> 1 for n, s in enumerate(states)},
        "b": {4 * n: s & 1 for n, s in enumerate(states)},
    }


@pytest.mark.parametrize(
    ("states", "counts"),
    [
        ([0, 0b10, 0b11, 0b01, 0b00, 0b10], [1, 1, 1, 1, 1]),
        ([0, 0b01, 0b11, 0b10, 0b00, 0b01], [-1, -1, -1, -1, -1]),
        ([0, 0b10, 0b00, 0b01, 0b00], [1, -1, -1, 1]),
        ([0, 0b11, 0b00, 0b10, 0b01], [1]),
    ],
)
def test_every_quadrature_edge_counts_and_double_ones_do_not(simulate, states, counts):
    cycles = 4 * len(states) + 4
    seen = simulate(QuadratureDecoder(), cycles, before=True, **quadrature(states))
    at = cycles_where(seen["count"])
    assert [1 if seen["up"][n] else -1 for n in at] == counts
    assert all(n % 4 == 0 for n in at)


def test_an_encoder_counter_obeys_its_order_of_precedence(simulate):
    seen = simulate(
        EncoderCounter(width=24),
        9,
        before=True,
        count=1,
        up={0: 0, 1: 1},
        value=0x1234,
        load={0: 0, 3: 1, 4: 0},
        reset={0: 0, 3: 1, 4: 0, 6: 1, 7: 0},
        latch={0: 0, 2: 1, 3: 0, 6: 1, 7: 0},
    )
    # Load shows at once and is left behind; a latch takes what is there before a reset or a count.
    assert seen["position"].tolist() == [0, 0xFFFFFF, 0, 0x1234, 0x1234, 0x1235, 0x1236, 0, 1]
    assert seen["held"].tolist() == [0, 0, 0, 0, 0, 0, 0, 0x1236, 0x1236]


def test_inputs_pass_two_flops(simulate):
    pins = {0: 0, 3: 0b01, 4: 0b10}
    seen = simulate(InputFilter(width=2), 10, before=True, pins=pins)
    assert seen["levels"].tolist() == [0, 0, 0, 0, 0, 1, 2, 2, 2, 2]
    assert seen["before"].tolist() == [0, 0, 0, 0, 0, 0, 1, 2, 2, 2]


def test_a_filter_drops_short_pulses(simulate):
    pins = {0: 0, 3: 1, 5: 0, 10: 1, 13: 0, 20: 1, 30: 0, 31: 1}
    seen = simulate(InputFilter(width=1, samples=3), 45, before=True, pins=pins)
    # Two samples are not enough; three, from edges 10, 13 and 20 on, show four edges later.
    assert edges(seen["levels"]) == [14, 17, 24]


def test_estop_is_left_by_a_rise_of_release_only(simulate):
    seen = simulate(
        EstopChain(),
        40,
        release={0: 0, 5: 1, 25: 0, 30: 1},
        closed={0: 1, 10: 0, 12: 1},
        fed={0: 1, 35: 0, 36: 1},
    )
    assert cycles_where(seen["running"]) == [*range(5, 10), *range(30, 35)]


def test_estop_stays_while_the_watchdog_is_not_fed(simulate):
    seen = simulate(EstopChain(), 10, release={0: 0, 2: 1}, closed=1, fed={0: 0, 5: 1})
    assert not seen["running"].any()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Watchdog(ticks=0), "ticks must be at least 1"),
        (lambda: PeriodCounter(width=24, offset=-1), "offset must be at least 0"),
        (lambda: StepPulse(min_space=0), "min_space must be at least 1"),
        (lambda: InputFilter(width=1, samples=0), "samples must be at least 1"),
    ],
)
def test_a_wrong_parameter_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
