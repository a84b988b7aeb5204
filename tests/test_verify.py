"""The verifier passes ideal step edges, and fails each kind of fault in the check made for it.

Machine: X and Y with 100 step/mm, Z with 200, at most 50 mm/s and 500 mm/s^2 each. With a
following tolerance of 1.1 step the quanta are 1.1/100 mm on X and Y and 1.1/200 mm on Z.
"""

import dataclasses
import json
import math
import tracemalloc

import numpy as np
import pytest

from pulsewright.edges.path import numbered_pins
from pulsewright.edges.timing import DriveTiming
from pulsewright.edges.trace import EdgeTrace, concatenate
from pulsewright.errors import UsageError
from pulsewright.motion.moves import MoveKind, Moves, Plane
from pulsewright.motion.trajectory import Trajectory
from pulsewright.verify import Tolerances, Verifier
from pulsewright.verify.reference import Runs

CLOCK = 40_000_000
V, A = 50.0, 500.0
SCALE = np.array([100.0, 100.0, 200.0])
MATRIX = np.zeros((3, 6))
MATRIX[[0, 1, 2], [0, 1, 2]] = SCALE
LIMITS = (np.eye(6)[:3], np.full(3, V), np.full(3, A))
DRIVE = DriveTiming(width=2.5e-6, space=2.5e-6, setup=5e-6, hold=5e-6)
WIDTH, SETUP = 120, 400  # of the ideal pulses: 3 us and 10 us [cycle]


def straight(*ends, start=(0, 0, 0), feed=V, tolerance=0.0, line=10):
    """Moves along lines; program lines count from ``line`` in tens."""
    end = np.zeros((len(ends), 6))
    end[:, :3] = np.reshape(ends, (-1, 3))
    begin = np.zeros(6)
    begin[:3] = start
    n = len(end)
    return Moves(
        start=begin,
        kind=np.full(n, MoveKind.LINE, np.int8),
        plane=np.full(n, Plane.XY, np.int8),
        rapid=np.zeros(n, bool),
        line=(line + 10 * np.arange(n)).astype(np.int32),
        end=end,
        center=np.zeros((n, 3)),
        sweep=np.zeros(n),
        feed=np.full(n, float(feed)),
        dwell=np.zeros(n),
        tolerance=np.full(n, float(tolerance)),
    )


def full_circle(radius=5.0, feed=20.0, rise=0.0):
    """One counterclockwise turn from (radius, 0) about the origin."""
    moves = straight((radius, 0, rise), start=(radius, 0, 0), feed=feed)
    return dataclasses.replace(
        moves, kind=np.array([MoveKind.ARC], np.int8), sweep=np.array([2 * math.pi])
    )


def stop_and_go(moves, *, speed=V, acceleration=A, rest=0.0):
    """Each move from rest to rest with a trapezoid of speed, and ``rest`` seconds after it."""
    n = len(moves)
    poly, cosine, sine = np.zeros((n, 4, 6)), np.zeros((n, 6)), np.zeros((n, 6))
    omega, length = np.zeros(n), np.zeros(n)
    element, law, start = [], [], [0.0]
    for i, (begin, end) in enumerate(zip(moves.starts(), moves.end, strict=True)):
        delta = end - begin
        if moves.kind[i] == MoveKind.ARC:  # in XY about the origin, from (radius, 0)
            radius = begin[0]
            length[i] = math.hypot(radius * moves.sweep[i], delta[2])
            omega[i] = moves.sweep[i] / length[i]
            poly[i, 1, 2] = delta[2] / length[i]
            cosine[i, 0] = sine[i, 1] = radius
        else:
            length[i] = np.linalg.norm(delta)
            poly[i, 0], poly[i, 1] = begin, delta / length[i]
        v = min(moves.feed[i], speed, math.sqrt(acceleration * length[i]))
        ramp, s = v / acceleration, v * v / acceleration / 2
        cruise = (length[i] - 2 * s) / v
        pieces = [
            (ramp, (0, 0, acceleration / 2)),
            (cruise, (s, v, 0)),
            (ramp, (length[i] - s, v, -acceleration / 2)),
            (rest, (length[i], 0, 0)),
        ]
        for duration, (s0, s1, s2) in pieces:
            if duration > 1e-12:
                element.append(i)
                law.append((s0, s1, s2, 0))
                start.append(start[-1] + duration)
    return Trajectory(
        poly,
        cosine,
        sine,
        omega,
        length,
        np.arange(n, dtype=np.int32),
        np.array(element, np.int32),
        np.array(start),
        np.array(law, float),
    )


def crossings(steps, motor):
    """Times at which a motor passes half steps, and the sign of each step."""
    t = np.arange(0.0, steps.duration + 2e-5, 2e-5)
    count = np.floor(steps.at(t)[:, motor] + 0.5)
    k = np.flatnonzero(np.diff(count))
    sign = np.diff(count)[k]
    assert set(sign) <= {-1.0, 1.0}
    level = np.maximum(count[k], count[k + 1]) - 0.5
    low, high = t[k], t[k + 1]
    for _ in range(40):
        middle = (low + high) / 2
        beyond = (steps.at(middle)[:, motor] - level) * sign > 0 if len(k) else np.zeros(0, bool)
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return high, sign.astype(int)


def ideal(plan, *, end=0.01, delay=0.0):
    """Trace in which every motor steps exactly where its plan passes half a step."""
    steps = plan.mapped(MATRIX)
    cycles, initial = [], []
    for motor in range(3):
        when, sign = crossings(steps, motor)
        rise = np.round((when + delay) * CLOCK).astype(np.int64)
        pulse = np.stack([rise, rise + WIDTH], axis=1).ravel()
        turns = np.flatnonzero(np.diff(sign, prepend=1))
        cycles += [pulse, rise[turns] - SETUP]
        initial += [0, 1]
    pins = tuple(pin for i in range(3) for pin in (f"step{i}", f"dir{i}"))
    last = round((plan.duration + end) * CLOCK)
    return EdgeTrace(CLOCK, pins, np.array(initial, np.uint8), tuple(cycles), 0, last)


def changed(trace, pin, cycles):
    """The trace with other changes of one pin."""
    i = trace.pins.index(pin)
    arrays = list(trace.cycles)
    arrays[i] = np.asarray(cycles, np.int64)
    return dataclasses.replace(trace, cycles=tuple(arrays))


def split(trace, *at):
    parts, begin = [], trace.start
    levels = trace.initial
    for end in (*at, trace.end):
        cycles = tuple(c[(c >= begin) & (c < end)] for c in trace.cycles)
        part = EdgeTrace(trace.clock_hz, trace.pins, levels, cycles, begin, end)
        parts.append(part)
        begin, levels = end, part.final()
    return parts


def verifier(plan, moves, **options):
    options = {
        "motor_matrix": MATRIX,
        "limits": LIMITS,
        "clock_hz": CLOCK,
        "motors": numbered_pins(3),
        "drives": [DRIVE] * 3,
    } | options
    return Verifier(trajectory=plan, moves=moves, **options)


def verify(trace, plan, moves, **options):
    checker = verifier(plan, moves, **options)
    for chunk in trace if isinstance(trace, list) else [trace]:
        checker.feed(chunk)
    return checker.finish()


def failed(verdict):
    return {check.name for check in verdict.failed}


# An L with a way back: 8 mm along X, 6 mm along Y, and home on the diagonal, resting 20 ms at
# each corner.
L = straight((8, 0, 0), (8, 6, 0), (0, 0, 0))
PLAN = stop_and_go(L, rest=0.02)
TRACE = ideal(PLAN)


def test_ideal_steps_pass_every_check():
    verdict = verify(TRACE, PLAN, L)
    assert failed(verdict) == set()
    assert verdict.passed
    assert verdict["following"].worst == pytest.approx(0.5, abs=0.001)
    assert verdict["following"].bound == 1.1
    # half a step of X and Y on the diagonal's normal at most
    assert verdict["path"].worst < 0.005 * math.sqrt(2)
    assert verdict["path"].bound == pytest.approx(math.hypot(0.011, 0.011, 0.0055), abs=2e-6)
    assert verdict["coverage"].worst < 0.001
    assert (verdict["stops"].worst, verdict["end"].worst) == (0, 0)
    assert verdict["timing:width"].worst == 3.0  # us
    assert verdict["timing:setup"].worst == 10.0
    assert verdict.edges == 2 * verdict.steps + 2  # two reversals


def test_counts_and_summary_are_those_of_the_program():
    verdict = verify(TRACE, PLAN, L)
    assert [(m.forward, m.backward, m.end, m.lost) for m in verdict.motors] == [
        (800, 800, 0, 0),
        (600, 600, 0, 0),
        (0, 0, 0, 0),
    ]
    assert verdict.steps == 2800
    # 8 and 6 mm: 0.1 s + length / 50; 10 mm: the same rule; 20 ms rest after each
    assert verdict.duration == pytest.approx(0.26 + 0.22 + 0.3 + 0.06)


def test_the_result_does_not_depend_on_how_the_recording_is_cut():
    whole = verify(TRACE, PLAN, L)
    rise = int(TRACE["step0"][800])
    parts = verify(split(TRACE, 1, 5_000_001, rise, rise + 1, rise + WIDTH, 20_000_000), PLAN, L)
    assert parts.to_json() == whole.to_json()
    for name in ("time", "position", "speed", "acceleration", "deviation", "distance", "line"):
        assert np.array_equal(getattr(parts.sample, name), getattr(whole.sample, name))


def test_a_verdict_is_plain_json():
    data = json.loads(json.dumps(verify(TRACE, PLAN, L).to_json(), allow_nan=False))
    assert data["passed"] is True
    assert data["checks"][0]["name"] == "following"
    # before and after each step half a step off: no deviation is outside -0.525 .. 0.525
    edges, counts = data["histogram"]["edges"], data["histogram"]["counts"]
    assert sum(counts) == 2 * 2800
    assert {round(e, 3) for e, n in zip(edges, counts, strict=False) if n} == {-0.525, 0.475}


def drop(trace, pin, k):
    return changed(trace, pin, np.delete(trace[pin], [2 * k, 2 * k + 1]))


def test_a_lost_step_is_found_at_the_next_stop_and_at_the_end():
    # X never makes step 400, half way through the first move
    verdict = verify(drop(TRACE, "step0", 400), PLAN, L)
    assert failed(verdict) >= {"following", "stops", "end"}
    assert verdict["following"].worst == pytest.approx(1.5, abs=0.01)
    stops = verdict["stops"]
    assert (stops.worst, stops.where, stops.line) == (1, "step0", 10)
    assert stops.time == pytest.approx(0.26)
    assert stops.detail.startswith("1 lost: counted 799, planned 800.000; first of 3 wrong")
    assert verdict["end"].worst == 1
    assert verdict.motors[0].end == -1
    assert [m.lost for m in verdict.motors] == [1, 0, 0]  # on the first leg, not again later


def test_the_last_step_missing_is_no_deviation_but_a_lost_step():
    # the diagonal's last X step is half a step before home: count and plan differ by 1 only
    verdict = verify(drop(TRACE, "step0", 1599), PLAN, L)
    assert failed(verdict) == {"stops", "end"}
    assert verdict["following"].worst == pytest.approx(1.0)
    assert verdict["end"].line == 30
    assert verdict.motors[0].lost == 1


def test_a_step_too_many_at_standstill():
    extra = round(0.27 * CLOCK)  # 10 ms into the first rest
    cycles = np.sort(np.append(TRACE["step0"], [extra, extra + WIDTH]))
    verdict = verify(changed(TRACE, "step0", cycles), PLAN, L)
    assert {"stops", "end"} <= failed(verdict)
    assert verdict["stops"].detail.startswith("1 too many: counted 801, planned 800.000")
    assert verdict["end"].detail.startswith("1 too many: counted 1, planned 0.000")
    assert [m.lost for m in verdict.motors] == [-1, 0, 0]


def test_an_extra_step_and_its_undoing_during_one_rest_are_seen():
    a, b = round(0.268 * CLOCK), round(0.272 * CLOCK)
    step = np.sort(np.append(TRACE["step0"], [a, a + WIDTH, b, b + WIDTH]))
    turned = np.sort(np.append(TRACE["dir0"], [b - SETUP, b + SETUP]))
    verdict = verify(changed(changed(TRACE, "step0", step), "dir0", turned), PLAN, L)
    assert failed(verdict) == {"stops"}
    assert verdict["stops"].detail.startswith("1 too many")


def test_a_step_before_the_start_is_seen():
    late = dataclasses.replace(
        TRACE, cycles=tuple(c + 400_000 for c in TRACE.cycles), end=TRACE.end + 400_000
    )
    assert verify(late, PLAN, L, start_cycle=400_000).passed
    early = changed(late, "step1", np.append([1000, 1000 + WIDTH], late["step1"]))
    verdict = verify(early, PLAN, L, start_cycle=400_000)
    assert verdict["stops"].time == 0
    assert verdict["stops"].where == "step1"


def test_a_motor_that_never_steps_is_left_behind():
    verdict = verify(changed(TRACE, "step1", []), PLAN, L)
    assert {"following", "stops", "path", "coverage"} <= failed(verdict)
    assert (verdict["following"].worst, verdict["following"].where) == (600, "step1")
    assert verdict["stops"].detail.startswith("600 lost: counted 0, planned 600.000")
    assert verdict["coverage"].worst == pytest.approx(6.0)
    assert verdict["end"].passed  # Y ends where it began


def test_a_missing_direction_change_runs_away():
    verdict = verify(changed(TRACE, "dir0", []), PLAN, L)
    assert {"following", "end", "path", "coverage"} <= failed(verdict)
    assert verdict.motors[0].end == 1600
    assert verdict["following"].worst == pytest.approx(1600)
    # home was missed by 16 mm on X
    coverage = verdict["coverage"]
    assert (coverage.line, coverage.position) == (30, (0, 0, 0))


def test_steps_shifted_in_time_deviate_by_speed_times_delay():
    verdict = verify(ideal(PLAN, delay=0.002), PLAN, L)
    assert failed(verdict) == {"following"}
    # 2 ms at 50 mm/s are 10 steps; half a step more just before a step
    assert verdict["following"].worst == pytest.approx(10.5, abs=0.01)
    assert verdict["path"].worst < 0.0075


def test_a_chunk_shifted_in_time_is_found():
    middle = round(0.1 * CLOCK)
    before, after = split(TRACE, middle)
    moved = [np.where(c < round(0.2 * CLOCK), c + 40_000, c) for c in after.cycles]
    verdict = verify([before, dataclasses.replace(after, cycles=tuple(moved))], PLAN, L)
    # 1 ms at 50 mm/s and 100 step/mm are 5 steps
    assert "following" in failed(verdict)
    assert verdict["following"].worst == pytest.approx(5.5, abs=0.05)


@pytest.mark.parametrize(("kind", "cycles", "measured"), [("width", 60, 1.5), ("space", -80, 2.0)])
def test_short_pulses_and_spaces_break_the_data_sheet(kind, cycles, measured):
    step = TRACE["step0"].copy()
    if kind == "width":
        step[901] = step[900] + cycles
    else:
        step[901] = step[902] + cycles
    verdict = verify(changed(TRACE, "step0", step), PLAN, L)
    assert failed(verdict) == {f"timing:{kind}"}
    check = verdict[f"timing:{kind}"]
    assert (check.worst, check.bound, check.line, check.where) == (measured, 2.5, 10, "step0")


def test_short_setup_breaks_the_data_sheet():
    turned = TRACE["dir0"] + (SETUP - 100)
    verdict = verify(changed(TRACE, "dir0", turned), PLAN, L)
    assert failed(verdict) == {"timing:setup"}
    assert verdict["timing:setup"].worst == 2.5
    assert verdict["timing:setup"].line == 30


def test_short_hold_breaks_the_data_sheet():
    # motor 1 turns right after its last step of the second move instead of before the third
    last = int(TRACE["step1"][2 * 599])
    verdict = verify(changed(TRACE, "dir1", [last + 160]), PLAN, L)
    assert failed(verdict) == {"timing:hold"}
    assert verdict["timing:hold"].worst == 4.0


def test_a_skipped_move_is_found_by_coverage():
    # programmed with a 1 mm detour into Z that neither plan nor steps make
    detour = straight((4, 0, 0), (4, 0, 1), (4, 0, 0), (8, 0, 0))
    direct = straight((8, 0, 0))
    plan = dataclasses.replace(stop_and_go(direct), move=np.array([0], np.int32))
    verdict = verify(ideal(plan), plan, detour)
    assert "coverage" in failed(verdict)
    assert verdict["coverage"].line == 20
    assert verdict["coverage"].worst == pytest.approx(1.0, abs=0.001)
    assert verdict["coverage"].detail.startswith("1 of 4 ends")


def test_cutting_a_corner_needs_its_tolerance():
    # plan: straight from (0,0) to (6,4) and so past the corner (6,0)... by 6*4/hypot(6,4) mm
    moves = straight((6, 0, 0), (6, 4, 0))
    plan = stop_and_go(straight((6, 4, 0)))
    gap = 24 / math.hypot(6, 4)
    steps = ideal(plan)
    verdict = verify(steps, plan, moves)
    assert {"path", "coverage"} <= failed(verdict)
    assert verdict["coverage"].worst == pytest.approx(gap, abs=0.006)
    # the point of the diagonal furthest from both legs is where it halves the angle: d/6 + d/4 = 1
    assert verdict["path"].worst == pytest.approx(2.4, abs=0.03)
    generous = dataclasses.replace(moves, tolerance=np.array([3.4, 0.0]))
    assert verify(steps, plan, generous).passed


def test_overspeed_is_found_per_axis():
    quick = dataclasses.replace(L, feed=np.full(3, 70.0))
    fast = stop_and_go(quick, speed=70.0, rest=0.02)
    verdict = verify(ideal(fast), fast, quick)
    # X reaches sqrt(500 * 8) = 63 mm/s within 8 mm, Y 55, the diagonal 70 * (0.8, 0.6): with the
    # blur of 7.3 mm/s only the first is surely too fast
    assert failed(verdict) == {"velocity:X"}
    check = verdict["velocity:X"]
    assert check.worst == pytest.approx(math.sqrt(500 * 8), rel=0.06)
    # q = 0.011 mm; h = 2 q / (0.15 * 50 mm/s) = 2.93, so 3 ms
    assert check.bound == pytest.approx(50 + 2 * 0.011 / 0.003)
    assert check.line == 10


def test_overacceleration_is_found_per_axis():
    hard = stop_and_go(L, acceleration=800.0, rest=0.02)
    verdict = verify(ideal(hard), hard, L)
    # the diagonal splits 800 into 640 and 480
    assert failed(verdict) == {"acceleration:X", "acceleration:Y"}
    check = verdict["acceleration:X"]
    # q = 0.011 mm; h = sqrt(4 q / (0.15 * 500)) = 24.2, so 25 ms; blur 4 q / h^2
    assert check.bound == pytest.approx(500 + 4 * 0.011 / 0.025**2)
    assert check.worst == pytest.approx(800, abs=4 * 0.0055 / 0.025**2)


@pytest.mark.parametrize("end", [0.003, 0.2])
@pytest.mark.parametrize("where", ["start", "end"])
def test_an_abrupt_start_and_an_abrupt_end_are_seen(where, end):
    # 5 mm to or from 50 mm/s with 250 mm/s^2 in 0.2 s; at the other end 50 mm/s within no time
    moves = straight((5, 0, 0))
    law = (0.0, 50.0, -125.0, 0.0) if where == "start" else (0.0, 0.0, 125.0, 0.0)
    plan = dataclasses.replace(
        stop_and_go(moves),
        element=np.array([0], np.int32),
        start=np.array([0.0, 0.2]),
        law=np.array([law]),
    )
    verdict = verify(ideal(plan, end=end), plan, moves)
    assert failed(verdict) == {"acceleration:X"}
    check = verdict["acceleration:X"]
    assert check.time == pytest.approx(0 if where == "start" else 0.2, abs=0.004)
    # over h = 25 ms it looks like 50 / h, less half of the ramp within the window
    assert check.worst == pytest.approx(2000 - 125, abs=4 * 0.0055 / 0.025**2)


def test_more_than_the_programmed_feed_is_found():
    slow = dataclasses.replace(L, feed=np.array([50.0, 30.0, 50.0]))
    verdict = verify(TRACE, PLAN, slow)
    assert failed(verdict) == {"feed"}
    check = verdict["feed"]
    assert check.line == 20
    quantum = math.hypot(0.011, 0.011, 0.0055)
    assert check.bound == pytest.approx(30 + 2 * quantum / 0.05)
    # the leg's 20 ms at 50 mm/s with 15 ms of either ramp: (2.5 mm - 500 * 0.015^2 mm) / 50 ms
    assert check.worst == pytest.approx(47.75, abs=0.2)
    rapid = dataclasses.replace(slow, rapid=np.array([False, True, False]))
    assert verify(TRACE, PLAN, rapid).passed


def test_a_full_circle_is_followed_and_a_flat_one_is_not():
    circle = full_circle(5.0, feed=20.0)
    plan = stop_and_go(circle)
    verdict = verify(ideal(plan), plan, circle)
    assert verdict.passed
    assert verdict["path"].worst < 0.0075
    # the same circle with all X 1% too small is off by 0.05 mm at most
    squeezed = dataclasses.replace(plan, cosine=plan.cosine * 0.99)
    verdict = verify(ideal(squeezed), squeezed, circle)
    assert {"path", "coverage"} <= failed(verdict)
    assert verdict["path"].worst == pytest.approx(0.05, abs=0.0075)


def test_a_helix_has_to_rise():
    helix = full_circle(5.0, feed=20.0, rise=2.0)
    plan = stop_and_go(helix)
    assert verify(ideal(plan), plan, helix).passed
    flat = dataclasses.replace(plan, poly=plan.poly * 0)
    # Z stays at 0: after half a turn the helix is 1 mm above, less what its slope brings nearer
    verdict = verify(ideal(flat), flat, helix)
    assert {"path", "coverage"} <= failed(verdict)
    assert verdict["coverage"].worst == pytest.approx(2.0, abs=0.01)


@pytest.mark.parametrize("plane", [Plane.YZ, Plane.ZX])
def test_arcs_in_the_other_planes(plane):
    helix = full_circle(5.0, feed=20.0, rise=2.0)
    plan = stop_and_go(helix)
    # X Y Z of the helix become the plane's first and second axis and its normal
    columns = [*np.argsort([*plane.axes, int(plane)]).tolist(), 3, 4, 5]
    turned = dataclasses.replace(
        helix,
        start=helix.start[columns],
        end=helix.end[:, columns],
        plane=np.array([plane], np.int8),
    )
    plan = dataclasses.replace(
        plan,
        poly=plan.poly[:, :, columns],
        cosine=plan.cosine[:, columns],
        sine=plan.sine[:, columns],
    )
    verdict = verify(ideal(plan), plan, turned)
    assert failed(verdict) == set()
    assert verdict["path"].worst < 0.0085
    other = dataclasses.replace(turned, plane=np.array([Plane.XY], np.int8))
    assert "path" in failed(verify(ideal(plan), plan, other))


@pytest.mark.parametrize(
    ("point", "sweep", "rise", "distance"),
    [
        ((6, 0, 0), 90, 0, 1),  # beside its start
        ((0, 0, 0), 90, 0, 5),  # the centre is equally far from all of it
        ((3, 3, 0), 90, 0, 5 - math.hypot(3, 3)),
        ((0, -5, 0), 90, 0, math.hypot(5, 5)),  # nearest is an end
        ((3, -3, 4), -90, 0, math.hypot(5 - math.hypot(3, 3), 4)),
        ((6, 0, 2), 3 * 360, 3, 1),  # beside the end of a helix' second turn
        ((4, 0, 9), 3 * 360, 3, math.hypot(1, 6)),  # above its end
    ],
)
def test_distance_from_an_arc_of_radius_5_by_hand(point, sweep, rise, distance):
    from pulsewright.verify.kernels import arc_distance2

    arc = np.array([0.0, math.radians(sweep), 5.0, 5.0, rise])
    square = arc_distance2(*map(float, point), 0.0, 0.0, 0.0, arc)
    assert math.sqrt(square) == pytest.approx(distance, abs=1e-9)


def test_distance_from_spirals_and_helices_is_that_of_their_nearest_point():
    from pulsewright.verify.kernels import arc_distance2

    random = np.random.default_rng(1)
    u = np.linspace(0, 1, 20_001)
    for _ in range(300):
        begin, sweep, rise = random.uniform(-7, 7), random.uniform(-15, 15), random.uniform(-6, 6)
        r0 = random.uniform(1, 5)
        r1 = r0 + random.uniform(-0.01, 0.01)
        r, angle = r0 + (r1 - r0) * u, begin + sweep * u
        curve = np.stack([r * np.cos(angle), r * np.sin(angle), rise * u])
        # as a machine would be: close to the curve, at most a tenth of its radius away
        near = curve[:, random.integers(len(u))] + random.uniform(-0.05, 0.05, 3) * r0
        brute = np.linalg.norm(curve - near[:, None], axis=0).min()
        square = arc_distance2(*near, 0.0, 0.0, 0.0, np.array([begin, sweep, r0, r1, rise]))
        assert math.sqrt(square) == pytest.approx(brute, abs=2e-4)
        assert math.sqrt(square) <= brute + 1e-9


def test_a_stop_of_an_instant_must_be_reached():
    # to 5 mm and back without rest; X loses the last step forth and the first one back
    moves = straight((5, 0, 0), (0, 0, 0))
    plan = stop_and_go(moves)
    trace = ideal(plan)
    verdict = verify(trace, plan, moves)
    assert verdict.passed
    assert verdict["turns"].worst == pytest.approx(0, abs=1e-9)
    assert verdict["turns"].detail.startswith("1 stops")
    short = drop(drop(trace, "step0", 499), "step0", 499)
    verdict = verify(short, plan, moves)
    assert failed(verdict) == {"turns"}
    assert verdict["turns"].worst == pytest.approx(1.0)
    assert (verdict["turns"].line, verdict["turns"].where) == (20, "step0")


def test_a_stop_at_half_a_step_may_be_rounded_either_way():
    moves = straight((1.005, 0, 0))  # 100.5 steps
    plan = stop_and_go(moves)
    trace = ideal(plan)
    for n in (100, 101):
        step = trace["step0"][: 2 * n]
        if len(step) < 2 * n:
            last = round(plan.duration * CLOCK)
            step = np.append(step, [last, last + WIDTH])
        verdict = verify(changed(trace, "step0", step), plan, moves)
        assert (verdict["end"].passed, verdict.motors[0].end) == (True, n)
    verdict = verify(changed(trace, "step0", trace["step0"][: 2 * 99]), plan, moves)
    assert (verdict["end"].worst, verdict.motors[0].lost) == (1, 1)


def test_a_recording_that_ends_early_proves_nothing():
    verdict = verify(split(TRACE, round(0.5 * CLOCK))[0], PLAN, L)
    assert {"recording", "end"} <= failed(verdict)
    assert verdict["recording"].worst == pytest.approx(0.5)
    assert verdict["end"].worst is None


def test_a_step_pin_without_a_motor_must_not_move():
    pins = (*TRACE.pins, "step3", "dir3", "out0")
    still, moved = np.zeros(0, np.int64), np.array([100, 220])
    initial = np.append(TRACE.initial, [0, 0, 0]).astype(np.uint8)
    quiet = EdgeTrace(CLOCK, pins, initial, (*TRACE.cycles, still, moved, moved), 0, TRACE.end)
    assert verify(quiet, PLAN, L).passed
    stray = changed(quiet, "step3", moved)
    verdict = verify(stray, PLAN, L)
    assert failed(verdict) == {"stray"}
    assert verdict["stray"].detail == "step3 2"


def test_a_gantry_counts_both_motors():
    matrix = np.vstack([MATRIX, MATRIX[0]])
    pins = (*TRACE.pins, "step3", "dir3")
    both = EdgeTrace(
        CLOCK,
        pins,
        np.append(TRACE.initial, [0, 1]).astype(np.uint8),
        (*TRACE.cycles, TRACE["step0"], TRACE["dir0"]),
        0,
        TRACE.end,
    )
    options = {"motor_matrix": matrix, "motors": numbered_pins(4), "drives": [DRIVE] * 4}
    assert verify(both, PLAN, L, **options).passed
    verdict = verify(drop(both, "step3", 400), PLAN, L, **options)
    assert verdict["end"].where == "step3"
    assert [m.lost for m in verdict.motors] == [0, 0, 0, 1]


def test_rotary_axes_are_checked_in_degrees():
    moves = straight((4, 0, 0), (4, 0, 0))
    moves.end[1, 3] = 10.0  # A alone, 10 degrees
    moves = dataclasses.replace(moves, feed=np.array([50.0, 20.0]))
    matrix = MATRIX.copy()
    matrix[2] = 0
    matrix[2, 3] = 50.0  # motor 2 turns A: 50 step/degree
    plan = stop_and_go(moves, rest=0.01)
    steps = plan.mapped(matrix)
    when, sign = crossings(steps, 2)
    assert sign.tolist() == [1] * 500
    rise = np.round(when * CLOCK).astype(np.int64)
    trace = changed(ideal(plan), "step2", np.stack([rise, rise + WIDTH], axis=1).ravel())
    options = {"motor_matrix": matrix, "limits": (np.eye(6)[[0, 1, 3]], *LIMITS[1:])}
    verdict = verify(trace, plan, moves, **options)
    assert failed(verdict) == set()
    assert verdict["path:ABC"].unit == "degrees"
    assert verdict["path:ABC"].bound == pytest.approx(1.1 / 50, abs=2e-6)
    assert verdict["velocity:A"].unit == "degrees/s"
    fast = dataclasses.replace(moves, feed=np.array([50.0, 10.0]))
    assert failed(verify(trace, plan, fast, **options)) == {"feed:ABC"}
    other = dataclasses.replace(moves, end=moves.end.copy())
    other.end[1, 3] = 11.0
    verdict = verify(trace, plan, other, **options)
    assert failed(verdict) == {"coverage:ABC"}
    assert verdict["coverage:ABC"].worst == pytest.approx(1.0)


def test_a_feed_is_lent_to_the_blend_in_the_next_move():
    # X at 5 mm/s; A alone at 20 degrees/s; X and A at 5 mm/s; A alone; X
    moves = straight((1, 0, 0), (1, 0, 0), (2, 0, 0), (2, 0, 0), (3, 0, 0))
    moves.end[:, 3] = [0, 30, 60, 90, 90]
    moves = dataclasses.replace(moves, feed=np.array([5.0, 20, 5, 20, 5]))
    plan = stop_and_go(moves)
    own = {"XYZ": [5, 0, 5, 0, 5], "ABC": [0, 20, np.inf, 20, 0]}
    runs = Runs(plan, moves)
    assert {group: feed.tolist() for group, feed in runs.feed.items()} == own
    assert {group: feed.tolist() for group, feed in runs.lent.items()} == own
    runs = Runs(plan, dataclasses.replace(moves, tolerance=np.full(5, 0.1)))
    assert {group: feed.tolist() for group, feed in runs.feed.items()} == own
    # blends reach into the moves beside: nothing is said of what these do not move themselves,
    # and of A where X sets its pace
    assert runs.lent["XYZ"].tolist() == [5, 5, 5, 5, 5]
    assert runs.lent["ABC"].tolist() == [20, np.inf, np.inf, np.inf, 20]


def test_a_feed_is_lent_only_while_the_plan_is_on_a_blend():
    moves = straight((1, 0, 0), (1, 0, 0), tolerance=0.1)
    moves.end[1, 3] = 30
    plan = stop_and_go(moves)
    assert len(plan.length) == 2
    # the second element in two: the first degree of A on a curve
    columns = {name: getattr(plan, name)[[0, 1, 1]] for name in ("cosine", "sine", "omega", "move")}
    poly, length = plan.poly[[0, 1, 1]], np.array([1.0, 1.0, 29.0])
    poly[1, 2, 3] = 1e-3
    element, start, law = np.arange(3, dtype=np.int32), np.array([0.0, 1, 2, 3]), np.zeros((3, 4))
    runs = Runs(Trajectory(poly, columns["cosine"], columns["sine"], columns["omega"], length,
                           columns["move"], element, start, law), moves)  # fmt: skip
    time, run = np.array([0.5, 1.0, 1.5, 2.5]), np.array([0, 1, 1, 1])
    assert runs.allowed("XYZ", run, time).tolist() == [V, V, V, 0]


def test_a_program_without_motion_passes_if_nothing_moves():
    moves = straight()
    empty = Trajectory(
        np.zeros((0, 4, 6)),
        np.zeros((0, 6)),
        np.zeros((0, 6)),
        np.zeros(0),
        np.zeros(0),
        np.zeros(0, np.int32),
        np.zeros(0, np.int32),
        np.zeros(1),
        np.zeros((0, 4)),
    )
    still = split(TRACE, 100_000)[0]
    assert verify(still, empty, moves).passed
    assert not verify(TRACE, empty, moves).passed


def test_pictures_get_a_bounded_number_of_points_that_keep_the_peaks():
    few = Tolerances(samples=50)
    verdict = verify(split(TRACE, 3_000_001, 9_999_999), PLAN, L, tolerances=few)
    full = verify(TRACE, PLAN, L)
    assert 40 <= len(verdict.sample.time) <= 52
    assert len(full.sample.time) == 850  # 0 .. 0.849 s, by ms: the plan takes 0.84 s
    assert verdict.sample.deviation.max() == full.sample.deviation.max()
    assert verdict.sample.speed.max() == full.sample.speed.max()
    assert full.sample.speed.max() == pytest.approx(50, rel=0.04)
    at_corner = np.searchsorted(full.sample.time, 0.27)
    assert full.sample.position[at_corner, :3].tolist() == [8, 0, 0]
    assert full.sample.line[at_corner] == 10


def test_what_does_not_fit_together_is_refused():
    with pytest.raises(UsageError, match=r"motor matrix must be \(3, 6\)"):
        verifier(PLAN, L, motor_matrix=np.eye(2))
    with pytest.raises(UsageError, match="moves axis Y, but the motors do not determine"):
        verifier(PLAN, L, motor_matrix=MATRIX * np.array([1, 0, 1, 0, 0, 0]))
    with pytest.raises(UsageError, match=r"visits moves 0\.\.2"):
        verifier(PLAN, straight((8, 0, 0)))
    with pytest.raises(UsageError, match="as many drive timings"):
        verifier(PLAN, L, drives=[DRIVE])
    with pytest.raises(UsageError, match="nothing was recorded"):
        verifier(PLAN, L).finish()
    with pytest.raises(UsageError, match="no pin dir3, step3"):
        verify(
            TRACE,
            PLAN,
            L,
            motor_matrix=np.vstack([MATRIX, MATRIX[0]]),
            motors=numbered_pins(4),
            drives=[DRIVE] * 4,
        )
    with pytest.raises(UsageError, match="40000000 Hz, the plan's is 10000000 Hz"):
        verify(TRACE, PLAN, L, clock_hz=10_000_000)
    first, _, last = split(TRACE, 1000, 2000)
    with pytest.raises(UsageError, match="do not follow each other"):
        verify([first, last], PLAN, L)
    checker = verifier(PLAN, L)
    checker.feed(TRACE)
    checker.finish()
    with pytest.raises(UsageError, match="no more can be fed"):
        checker.feed(TRACE)
    assert concatenate(split(TRACE, 1000)) == TRACE


def test_a_verifier_keeps_less_for_each_move_than_the_geometry_of_one():
    moves = straight(*np.arange(1.0, 5001.0)[:, None] * [1, 0, 0])
    plan = stop_and_go(moves)
    verifier(PLAN, L)  # what the first one loads is not counted
    tracemalloc.start()
    try:
        checker = verifier(plan, moves)
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert checker is not None
    # 4 + 2 coefficients of 6 axes; with a stop after each move, which takes most
    assert kept / len(moves) < 6 * 6 * 8
