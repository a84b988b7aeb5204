"""Planning in parts: the same motion as planned at once, feed hold and override within limits."""

from __future__ import annotations

import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from test_plan import MACHINE, program, random_program

from pulsewright.errors import MotionLimitError, UsageError
from pulsewright.motion import stream
from pulsewright.motion.certificate import Certifier, certify
from pulsewright.motion.gcode import InterpreterSettings, interpret
from pulsewright.motion.plan import plan
from pulsewright.motion.stream import Planner, joined, planned

WIDE = MACHINE.model_copy(
    update={
        "axis": {
            letter: axis.model_copy(update={"min": -1e6, "max": 1e6})
            for letter, axis in MACHINE.axis.items()
        }
    }
)
SPEED, ACCELERATION, JERK = 60.0, 500.0, 20_000.0  # of X, Y, Z


def chunks(moves, size):
    """Return moves in chunks."""
    return [moves.part(at, min(at + size, len(moves))) for at in range(0, len(moves), size)]


def certified(parts, moves, machine=WIDE):
    """Return the parts as one trajectory; they pass their certificates, and so does that."""
    certifier = Certifier(machine, moves.start)
    certifier.add(moves)
    for part in parts:
        certificate = certifier.check(part.trajectory, part.override)
        assert certificate.passed, str(certificate)
    whole = certifier.finish()
    assert whole.passed, str(whole)
    trajectory = joined(parts)
    fastest = max(part.override.max() for part in parts)
    fixed = moves.rapid | (moves.pitch != 0)
    feed = np.where(fixed, moves.feed, moves.feed * fastest)
    certificate = certify(trajectory, replace(moves, feed=feed), machine)
    assert certificate.passed, str(certificate)
    return trajectory


def drain(planner, seconds=math.inf):
    """Return all parts that can be taken now."""
    parts = []
    while part := planner.take(seconds):
        parts.append(part)
    return parts


def started(moves, machine=MACHINE):
    """Return a planner that knows all moves."""
    planner = Planner(machine)
    planner.add(moves)
    planner.finish()
    return planner


def until(planner, seconds):
    """Return the parts up to a time."""
    parts, left = [], seconds
    while left > 1e-9:
        parts.append(planner.take(left))
        left -= parts[-1].trajectory.duration
    return parts


def check_path(trajectory, whole):
    """Check that two trajectories have the same path."""
    for name in ("poly", "cosine", "sine", "omega", "length", "move"):
        assert np.array_equal(getattr(trajectory, name), getattr(whole, name)), name


@pytest.mark.parametrize(
    ("name", "size"),
    [("wheels.ngc", 150), ("wheels.ngc", 1000), ("vcarve.ngc", 150), ("trochoidal.ngc", 5000)],
)
def test_every_chunk_size_has_the_same_path_and_time(corpus, monkeypatch, name, size):
    monkeypatch.setattr(stream, "WINDOW", size)
    settings = InterpreterSettings(axes="XYZA", path_tolerance=0.01)
    moves = interpret(corpus / name, settings=settings).moves
    parts = list(planned(chunks(moves, size), MACHINE))
    assert len(parts) >= len(moves) // size
    trajectory = certified(parts, moves, MACHINE)
    whole = plan(moves, MACHINE)
    check_path(trajectory, whole)
    assert trajectory.duration == pytest.approx(whole.duration, rel=0.01)


@pytest.mark.parametrize("size", [1, 7])
def test_moves_may_come_one_by_one(size):
    angle = np.linspace(0, 2 * np.pi, 301)[1:]
    points = np.column_stack([20 * np.cos(angle), 20 * np.sin(angle)])
    moves = program([(point, 40) for point in points], start=(20, 0))
    parts = list(planned(chunks(moves, size), MACHINE))
    assert len(parts) > 5
    trajectory, whole = certified(parts, moves, MACHINE), plan(moves, MACHINE)
    check_path(trajectory, whole)
    assert trajectory.duration == pytest.approx(whole.duration, rel=0.02)


def test_parts_are_as_long_as_asked():
    parts = drain(started(program([((100, 0), 50), ((100, 50), 50)])), 0.25)
    assert all(part.trajectory.duration == pytest.approx(0.25) for part in parts[:-1])
    moves = program([((100, 0), 50), ((100, 50), 50)])
    total = sum(part.trajectory.duration for part in parts)
    assert total == pytest.approx(plan(moves, MACHINE).duration)
    certified(parts, moves)


def test_memory_does_not_grow_with_the_program():
    def chunk(number, count=2000):
        x = 0.05 * np.arange(1, count + 1)
        points = np.column_stack([x + 0.05 * count * number, np.sin(x)])
        return program(
            [(point, 40) for point in points],
            start=(0.05 * count * number, np.sin(x[-1]) if number else 0),
        )

    def peak(count):
        tracemalloc.start()
        parts = planned((chunk(number) for number in range(count)), WIDE)
        duration = sum(part.trajectory.duration for part in parts)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most, duration

    peak(1)  # compiles
    (few, short), (many, long) = peak(3), peak(12)
    assert long > 3.5 * short
    assert many < 1.3 * few


def test_without_more_moves_the_motion_that_is_sure_can_be_taken():
    moves = program([((0.5 * n, 0), 40) for n in range(1, 401)])
    planner = Planner(MACHINE)
    assert planner.take() is None
    planner.add(moves.part(0, 300))
    parts = drain(planner)
    assert 1.0 < joined(parts).duration < 300 * 0.5 / 40
    assert not planner.at_rest
    planner.hold()  # nothing more comes in time
    parts += drain(planner)
    assert planner.at_rest
    planner.add(moves.part(300))
    planner.finish()
    assert planner.take() is None
    planner.resume()
    parts += drain(planner)
    check_path(certified(parts, moves), plan(moves, MACHINE))


@pytest.mark.parametrize("time", [0.01, 0.06, 0.11, 1.0, 1.5])
def test_a_hold_stops_as_soon_as_the_limits_allow_and_goes_on(time):
    moves = program([((100, 0), 50), ((100, 50), 50)], tolerance=0.1)
    planner = started(moves)
    parts = until(planner, time)
    state = [joined(parts).at(time, n)[0, 0] for n in range(3)]
    planner.hold()
    assert planner.held
    stopping = drain(planner)
    assert planner.at_rest
    # the acceleration to 0, at which the speed is v; and from there to rest
    v, rise = state[1] + state[2] ** 2 / (2 * JERK), state[2] / JERK
    least = rise + (
        v / ACCELERATION + ACCELERATION / JERK
        if v > ACCELERATION**2 / JERK
        else 2 * math.sqrt(v / JERK)
    )
    spent = sum(part.trajectory.duration for part in stopping)
    assert least * (1 - 1e-9) <= spent <= 1.25 * least
    assert planner.take() is None
    planner.resume()
    parts += stopping + drain(planner)
    trajectory = certified(parts, moves)
    check_path(trajectory, plan(moves, MACHINE))
    assert trajectory.at(time + spent, 1)[0] == pytest.approx(np.zeros(6))
    assert trajectory.duration > plan(moves, MACHINE).duration + 0.5 * spent


def test_a_hold_can_be_ended_before_the_machine_rests():
    moves = program([((100, 0), 50)])
    planner = started(moves)
    parts = until(planner, 1.0)
    planner.hold()
    parts += until(planner, 0.05)
    planner.resume()
    parts += drain(planner)
    trajectory = certified(parts, moves)
    assert trajectory.at(np.linspace(0.5, 1.5, 100), 1)[:, 0].min() > 10
    assert not planner.held


def test_a_dwell_that_is_held_goes_on():
    moves = program([((10, 0), 50), 0.5, ((20, 0), 50)])
    planner = started(moves)
    first = plan(moves.part(0, 1), MACHINE).duration
    parts = until(planner, first + 0.2)
    planner.hold()
    assert planner.take() is None
    planner.resume()
    parts += drain(planner)
    assert certified(parts, moves).duration == pytest.approx(plan(moves, MACHINE).duration)


@pytest.mark.parametrize(
    ("factor", "speed"), [(0.1, 2.0), (0.5, 10.0), (1.5, 30.0), (2.0, 40.0), (4.0, 60.0)]
)
def test_an_override_changes_the_feed_at_once(factor, speed):
    moves = program([((200, 0), 20), ((200, 100), 20)])
    planner = started(moves)
    parts = until(planner, 2.0)
    planner.override(factor)
    parts += drain(planner)
    trajectory = certified(parts, moves)
    change = abs(speed - 20)
    least = change / ACCELERATION + ACCELERATION / JERK
    if change < ACCELERATION**2 / JERK:
        least = 2 * math.sqrt(change / JERK)
    assert trajectory.at(2.0 + 1.4 * least, 1)[0, 0] == pytest.approx(speed, rel=5e-3)
    assert trajectory.at(2.0 + 0.5 * least, 1)[0, 0] != pytest.approx(speed, rel=1e-2)
    check_path(trajectory, plan(moves, MACHINE))
    last = parts[-1]
    assert last.override[-1] == factor


def test_rapids_and_synchronised_moves_keep_their_speed():
    moves = program([((100, 0), None), ((150, 0), 20), ((200, 0), 20)])
    moves = replace(moves, pitch=np.array([0.0, 1.0, 0.0]))
    planner = started(moves)
    planner.override(0.5)
    trajectory = certified(drain(planner), moves)
    speed = trajectory.at(np.linspace(0, trajectory.duration, 5000), 1)[:, 0]
    assert speed.max() == pytest.approx(SPEED, rel=1e-3)
    counts = [np.isclose(speed, v, rtol=1e-3).sum() * trajectory.duration / 5000 for v in (20, 10)]
    assert counts == pytest.approx([2.5, 5.0], abs=0.2)


def test_a_held_machine_goes_on_with_the_new_override():
    planner = started(program([((100, 0), 20)]))
    until(planner, 1.0)
    planner.hold()
    drain(planner)
    planner.override(2.0)
    assert planner.take() is None
    planner.resume()
    after = joined(drain(planner))
    assert after.at(0.5 * after.duration, 1)[0, 0] == pytest.approx(40, rel=1e-3)


def at_random(moves, seed, machine=WIDE, longest=10.0):
    """Return the parts of a motion that is held, resumed and overridden at random times."""
    rng = np.random.default_rng(seed)
    queue, parts = chunks(moves, int(rng.integers(1, len(moves) + 1))), []
    planner, waiting = Planner(machine), 0
    while waiting < 2:
        choice = rng.random()
        if queue and choice < 0.3:
            planner.add(queue.pop(0))
        if not queue:
            planner.finish()
        if choice < 0.1:
            planner.hold()
        elif choice < 0.3 or (planner.at_rest and choice < 0.9):
            planner.resume()
        elif choice < 0.5:
            planner.override(float(rng.choice([0.1, 0.3, 0.5, 0.9, 1, 1.2, 2])))
        part = planner.take(longest * float(10 ** rng.uniform(-4, 0)))
        if part is not None:
            parts.append(part)
        waiting = waiting + 1 if part is None and not queue and not planner.held else 0
    return parts


def check_at_random(seed):
    moves = random_program(seed)
    parts = at_random(moves, seed)
    if parts:
        check_path(certified(parts, moves), plan(moves, WIDE))


@pytest.mark.parametrize("seed", range(25))
def test_limits_hold_whatever_is_done_when(seed):
    check_at_random(seed)


@pytest.mark.campaign
@pytest.mark.parametrize("first", range(1000, 1300, 100))
def test_limits_hold_whatever_is_done_when_campaign(first):
    for seed in range(first, first + 100):
        check_at_random(seed)


@pytest.mark.parametrize("name", ["vcarve.ngc", "wheels.ngc"])
def test_limits_hold_on_real_programs_whatever_is_done_when(corpus, name):
    check_corpus_at_random(corpus / name)


@pytest.mark.campaign
@pytest.mark.parametrize(
    "name",
    [
        "3D_Chips.ngc",
        "arcspiral.ngc",
        "cds.ngc",
        "contour.ngc",
        "flowsnake.ngc",
        "spiral.ngc",
        "tort.ngc",
        "trochoidal.ngc",
        "wave.gcode",
        "zigzag_0.002_0.001.ngc",
    ],
)
def test_limits_hold_on_real_programs_whatever_is_done_when_campaign(corpus, name):
    check_corpus_at_random(corpus / name)


def check_corpus_at_random(path):
    settings = InterpreterSettings(axes="XYZA", path_tolerance=0.01)
    moves = interpret(path, settings=settings).moves
    whole = plan(moves, MACHINE)
    parts = at_random(moves, 1, MACHINE, longest=whole.duration / 10)
    assert len(parts) > 20
    check_path(certified(parts, moves, MACHINE), whole)


def test_what_cannot_be_done_is_said():
    planner = Planner(MACHINE)
    with pytest.raises(UsageError, match="override of 0 asked"):
        planner.override(0.0)
    with pytest.raises(MotionLimitError, match="line 1: X reaches 401 mm"):
        planner.add(program([((401, 0), 50)]))
    planner.finish()
    with pytest.raises(UsageError, match="after the last ones"):
        planner.add(program([((1, 0), 50)]))
    assert planner.take() is None


CORNERS = program([((50, 0), 50), ((50, 50), 50), 0.5, ((0, 50), 50)], tolerance=0.1)


def checked(parts, moves=CORNERS, machine=MACHINE):
    certifier = Certifier(machine, moves.start)
    certifier.add(moves)
    for part in parts:
        certifier.check(part.trajectory, part.override)
    return certifier.finish()


def test_seams_are_certified():
    parts = drain(started(CORNERS), 0.4)
    assert checked(parts).passed
    third = parts[2].trajectory
    for power, name, jump in [(0, "position", 0.25), (1, "velocity", 0.5), (2, "acceleration", 20)]:
        law = third.law.copy()
        law[0, power] += jump / max(power, 1)
        broken = replace(parts[2], trajectory=replace(third, law=law))
        certificate = checked([*parts[:2], broken, *parts[3:]])
        assert getattr(certificate, f"{name}_jump") >= jump - 1e-6
        assert not certificate.passed
    with_gap = checked(parts[:2] + parts[3:])
    assert with_gap.position_jump > 5


def test_a_motion_that_ends_too_soon_is_found():
    parts = drain(started(CORNERS), 0.4)
    certificate = checked(parts[:-1])
    assert certificate.end_error > 1
    assert not certificate.passed
    assert checked(parts[:1]).end_error == math.inf  # whole moves are missing


def test_a_dwell_that_is_too_short_is_found_in_parts():
    parts = drain(started(CORNERS), 0.05)
    assert checked(parts).dwell_error < 1e-9
    still = [n for n, part in enumerate(parts) if not part.trajectory.law[:, 1:].any()]
    assert len(still) >= 8
    certificate = checked(parts[: still[3]] + parts[still[4] :])
    assert certificate.dwell_error == pytest.approx(0.05)


def test_a_rest_that_is_missed_between_two_parts_is_found():
    # cut where the motion goes on at full speed, though a rest is programmed there
    moves = program([((20, 0), 50), ((40, 0), 50)], tolerance=0.1)
    whole = plan(moves, MACHINE)
    seam = next(k for k in range(len(whole.element)) if whole.move[whole.element[k]] == 1)
    last = len(whole.element)
    halves = [
        replace(
            whole,
            **{
                name: getattr(whole, name)[elements]
                for name in ("poly", "cosine", "sine", "omega", "length", "move")
            },
            element=whole.element[pieces] - whole.element[pieces][0],
            start=whole.start[pieces.start : pieces.stop + 1] - whole.start[pieces.start],
            law=whole.law[pieces],
        )
        for pieces, elements in [
            (slice(0, seam), whole.move == 0),
            (slice(seam, last), whole.move == 1),
        ]
    ]
    parts = [stream.Part(half, np.ones(len(half.element))) for half in halves]
    assert checked(parts, moves).passed
    stops = replace(moves, tolerance=np.zeros(2))
    assert checked(parts, stops).missed_rests == 1


def test_speed_beyond_the_override_is_found():
    parts = drain(started(CORNERS), 0.4)
    slow = [replace(part, override=part.override * 0.8) for part in parts]
    assert checked(slow).feed.ratio == pytest.approx(1.25)


def test_parts_out_of_order_are_refused():
    parts = drain(started(CORNERS), 0.4)
    with pytest.raises(UsageError, match="check parts in order"):
        checked([parts[0], parts[-1], parts[0]])
    certifier = Certifier(MACHINE, CORNERS.start)
    with pytest.raises(UsageError, match="add moves first"):
        certifier.check(parts[0].trajectory)
