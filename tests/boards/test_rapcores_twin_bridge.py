"""Dual H-bridges of the RAPcores twin: values by hand from the README of its room.

Cycles are those of the specification, in which what edge n makes is visible in cycle n + 1. Frames
of 512 cycles begin in cycle 255; the period made from one begins in cycle 3 of the next one.
"""

from math import floor, pi, sin
from random import Random

import numpy as np
import pytest
import test_rapcores_twin as vectors

from pulsewright.boards.rapcores.twin import RapcoresTwin
from pulsewright.edges.trace import concatenate
from pulsewright.errors import UsageError

U = 1 << 63
FRAME, FIRST, BEGIN = 512, 255, 3
LEGS = ("a1", "a2", "b1", "b2")
COAST, BRAKE, FORWARDS, BACKWARDS = (0, 0), (1, 1), (1, 0), (0, 1)


def board(motors=1, currents=(255,), enable=1, **options):
    """Return a host of a board with ticks in every cycle and its motors enabled."""
    host = vectors.Host(motors=motors, encoders=0, motor_driver=1, **options)
    host.configure(2, 0)
    for motor, current in enumerate(currents):
        host.configure(0xD0 + motor, current)
    host.configure(0, enable)
    return host


def winding(host, letter, cycles, motor=0):
    """Return both legs of a winding in some cycles."""
    trace = host.trace()
    legs = [trace[f"phase{motor}_{letter}{leg}"] for leg in (1, 2)]
    return list(
        zip(*((np.searchsorted(changes, cycles) & 1).tolist() for changes in legs), strict=True)
    )


def pulse(host, letter, period, motor=0):
    """Return first cycle in its period, length and sense of the pulse of a period."""
    begin = FIRST + FRAME * period + BEGIN
    levels = winding(host, letter, np.arange(begin, begin + FRAME), motor)
    driven = [n for n, level in enumerate(levels) if level != BRAKE]
    if not driven:
        return None, 0, 0
    assert len(driven) == driven[-1] - driven[0] + 1
    (level,) = {levels[n] for n in driven}
    return driven[0], len(driven), {FORWARDS: 1, BACKWARDS: -1}[level]


def whole_periods(host, count):
    """Let some more periods pass, from the next one on; return the number of that."""
    period = (host.free - FIRST) // FRAME + 1
    end = FIRST + FRAME * (period + count) + BEGIN
    host.wait(end - host.twin.now)
    return period


def start_for(host, words, f):
    """Return when a frame has to begin for a certain f, some frames of 512 cycles later."""
    begin = f - vectors.HALF * (1 + 2 * 64 * words)
    return begin + FRAME * (-(-(host.free - begin) // FRAME) + 2)


# --------------------------------------------------------------------------------------- periods


@pytest.mark.parametrize(
    ("position", "current", "a", "b"),
    [
        # 4095 sin(pi / 1024) = 12.56: 13 x 255 / 2048 = 1.6; cosine 4094.98: 4095 x 255 / 2048
        (0, 255, 2, 510),
        # 4095 sin(45.18 deg) = 2904.5, cosine 2886.7: x 100 / 2048 = 141.8 and 141.0
        (128, 100, 142, 141),
        (384, 100, 141, -142),
        (640, 100, -142, -141),
        (896, 100, -141, 142),
        (1024 + 128, 100, 142, 141),
        (-1, 255, -2, 510),  # phase 1023
        (-257, 255, -510, -2),  # phase 767
        (128, 1, 1, 1),  # 1.42 and 1.41
        (40, 1, 0, 2),  # 4095 sin(14.24 deg) = 1007.2: 0.49; cosine 3968.9: 1.94
        (300, 0, 0, 0),
    ],
)
def test_windings_are_driven_in_the_middle_of_periods(position, current, a, b):
    host = board(currents=(current,))
    # n + 1 ticks up by less than a step each, or n down by a step
    host.move(position + 1 if position >= 0 else -position, (U - 1 if position >= 0 else -U, 0))
    host.wait(2000)
    assert host.status(0x84) == position % 1024
    period = whole_periods(host, 2)
    for letter, on in (("a", a), ("b", b)):
        start, length, sense = pulse(host, letter, period + 1)
        assert length * sense == on
        assert start == (256 - abs(on) // 2 if on else None)


@pytest.mark.parametrize(("motors", "motor", "cycle"), [(2, 0, 480), (2, 1, 496), (32, 0, 0)])
def test_a_motor_is_looked_at_once_in_a_frame(motors, motor, cycle):
    """Its position in cycle 512 - 16 (N - n) is what counts, that in the next one is late."""
    for late in (0, 1):
        host = board(motors, [255] * (motor + 1), (1 << motors) - 1)
        moves = [(0, 0)] * motors
        moves[motor] = (-U, 0)
        # armed f + 5 is loaded; the tick in f + 6 is visible in f + 7
        at = start_for(host, 2 + 2 * motors, FIRST + cycle + late - 7)
        host.move(1, *moves, at=at)
        seen = host.f + 7
        assert (seen - FIRST) % FRAME == cycle + late
        whole_periods(host, 3)
        # phase 0 forwards, phase 1023 backwards
        period = (seen - FIRST) // FRAME + 1
        found = [pulse(host, "a", period + n, motor)[1:] for n in (-1, 0, 1)]
        assert found == [(2, 1), (2, 1) if late else (2, -1), (2, -1)]


def test_a_current_holds_from_the_next_look_on():
    for late in (0, 1):
        host = board(2, (0, 100), 0b11)
        host.send(0xF2 << 56 | 0xD0, 200, at=start_for(host, 2, FIRST + 480 + late - 5))
        period = (host.f + 5 - FIRST) // FRAME + 1
        whole_periods(host, 3)
        # 4095 x 200 / 2048 = 399.9 and 4095 x 100 / 2048 = 199.95
        found = [pulse(host, "b", period + n)[1] for n in (-1, 0, 1)]
        assert found == [0, 0 if late else 400, 400]
        assert pulse(host, "b", period, 1)[1] == 200


@pytest.mark.parametrize("pieces", [1, 50])
@pytest.mark.parametrize("seed", range(6))
def test_windings_follow_any_motion(seed, pieces):
    """The twin knows where a motor was, however far it goes at once: also when increments wrap."""
    random = Random(seed)
    host = board(currents=(255,), depth=2)
    divider = random.choice((0, 3, 40))
    host.configure(2, divider)
    motion = [
        (random.randrange(-U, U), random.randrange(-U, U)),
        (random.randrange(-U, U), random.choice((1, -1)) * random.randrange(1 << 50)),
        (random.choice((U - 1, -U, U // 3)), random.choice((0, -(1 << 40)))),
    ][seed % 3]
    ticks = 20_000 // (divider + 1)
    host.move(ticks, motion)
    first = host.f + 6  # the earliest
    assert host.twin.state()["ticks_left"] > 0.9 * ticks
    end = first + 20_000 + 4 * FRAME
    for n in range(pieces):
        host.twin.advance(host.twin.now + (end - host.twin.now) // (pieces - n))
        host.traces.append(host.twin.drain())
    host.traces = [concatenate(host.traces)]
    # ticks come every divider + 1 cycles, the last one where MOVE_DONE toggles
    last = int(host.changes("move_done")[0]) - 1
    increment, total, positions = motion[0], 0, [0]
    for _ in range(ticks):
        total += increment
        increment = (increment + motion[1] + U) % (2 * U) - U
        positions.append(total // U)
    begin = (first - FIRST) // FRAME
    for frame in range(begin, begin + 20_000 // FRAME):
        look = FIRST + FRAME * frame + 496
        done = ticks - max(-(-(last + 1 - look) // (divider + 1)), 0)
        phase = positions[max(done, 0)] % 1024
        for letter, shift in (("a", 0), ("b", 256)):
            wave = sin(2 * pi * (phase + shift + 0.5) / 1024)
            on = floor((round(4095 * abs(wave)) * 255 + 1024) / 2048)
            _, length, sense = pulse(host, letter, frame + 1)
            assert (length, sense) == (on, 1 if wave > 0 else -1)


def test_a_halt_takes_owed_steps_back_from_windings_too():
    host = board(currents=(100,))
    host.times(100, 100, 1, 1)  # pulses of 100 cycles, steps in every cycle
    host.move(129, (-U, 0))
    host.twin.schedule(host.f + 6 + 60, "halt", 0)
    host.wait(2000)
    position = host.twin.positions()[0]
    assert -128 < position < 0
    assert len(host.rises("step0")) == -position == 1
    period = whole_periods(host, 2)
    # phase 1023: 13 x 100 / 2048 = 0.6, 4095 x 100 / 2048
    assert pulse(host, "a", period)[1:] == (1, -1)
    assert pulse(host, "b", period)[1:] == (200, 1)


@pytest.mark.parametrize(("late", "on"), [(0, 194), (1, 2)])
def test_owed_steps_are_there_up_to_the_first_halted_cycle(late, on):
    """HALT low at c: the last tick is in c + 1, owed steps are taken back in c + 2."""
    host = board()
    host.times(100, 100, 1, 1)
    f = FIRST + 496 - 2 - late - 68  # the 64th tick in c + 1, f + 6 was the first
    host.move(1000, (-U, 0), at=start_for(host, 4, f))
    halt = host.f + 68
    assert (halt + 2 + late - FIRST) % FRAME == 496
    host.twin.schedule(halt, "halt", 0)
    host.wait(2000)
    assert host.twin.positions() == [-1]
    # phase 960: 4095 sin(22.32 deg) = 1555.4, x 255 / 2048 = 193.6; phase 1023: 1.6
    assert pulse(host, "a", (halt - FIRST) // FRAME + 1)[1:] == (on, -1)


# ------------------------------------------------------------------------------- enable and brake


@pytest.mark.parametrize("motors", [1, 32])
def test_a_motor_that_moved_while_it_was_off_is_where_it_is(motors):
    """Also the first of 32, which has been looked at for the next period before this begins."""
    host = board(motors, currents=(100,), enable=0)
    host.move(129, *[(U - 1, 0)] * motors)
    # enabled before the pulse of a period, long after
    host.send(0xF2 << 56, 1, at=start_for(host, 2, FIRST + BEGIN + 100) + 20 * FRAME)
    host.wait(2 * FRAME)
    middle = host.f - 100 + 256
    levels = winding(host, "a", range(middle - 90, middle + 90))
    assert levels == [BRAKE] * (90 - 71) + [FORWARDS] * 142 + [BRAKE] * (90 - 71)


@pytest.mark.parametrize(("brake", "off"), [(0, COAST), (1, BRAKE)])
def test_without_enable_windings_are_open_or_braked(brake, off):
    """A cycle after EN, also within a pulse."""
    host = board(2, (255, 255), 0)
    host.configure(1, brake)
    host.configure(0, 0b11)
    before = FORWARDS
    for enabled, after in ((0b10, off), (0b11, FORWARDS)):
        # f + 6 in the middle of a pulse of 510 cycles
        host.send(0xF2 << 56, enabled, at=start_for(host, 2, FIRST + BEGIN + 256 - 6))
        at = host.f + 6
        host.wait(100)
        assert winding(host, "b", range(at - 2, at + 3)) == [before] * 2 + [after] * 3
        assert set(winding(host, "b", range(at - 2, at + 50), 1)) == {FORWARDS}
        before = after


def test_brake_acts_while_disabled():
    host = board(currents=(255,), enable=0)
    for brake, before, after in ((1, COAST, BRAKE), (0, BRAKE, COAST)):
        host.configure(1, brake)
        at = host.f + 6
        host.wait(1000)
        assert winding(host, "a", [at - 1, at, at + 800]) == [before, after, after]


def test_nothing_is_driven_before_the_host_asks():
    host = vectors.Host(motor_driver=1)
    host.wait(2000)
    host.configure(0, 0b0101)
    at = host.f + 6
    host.wait(2000)
    for motor in range(4):
        for letter in "ab":
            levels = winding(host, letter, [at - 1, at, at + 1500], motor)
            assert levels == [COAST, *[COAST if motor % 2 else BRAKE] * 2]


@pytest.mark.parametrize("low", [1, 700])
def test_frames_begin_again_with_the_end_of_a_reset(low):
    host = board()
    period = whole_periods(host, 0)
    middle = FIRST + BEGIN + FRAME * period + 256
    # low in cycle n, in reset from n + 1 on; out of it 255 cycles after the rise
    host.twin.schedule([middle, middle + low], "rst_n", [0, 1])
    host.free = middle + low + 300
    host.configure(0xD0, 255)
    host.configure(0, 1)
    enabled = host.f + 6
    host.wait(3 * FRAME)
    levels = winding(host, "b", range(middle - 10, enabled + 1))
    edge = levels.index(COAST)
    assert levels[:edge] == [FORWARDS] * edge
    assert edge in (11, 12)
    assert set(levels[edge:-1]) == {COAST}
    begin = middle + low + 255 + BEGIN
    begin += -(-(enabled - begin) // FRAME) * FRAME
    levels = winding(host, "b", range(begin, begin + FRAME))
    assert levels == [BRAKE] + [FORWARDS] * 510 + [BRAKE]


# --------------------------------------------------------------------------------- registers, pins


def test_currents_are_registers_of_8_bits_that_are_0_at_first():
    host = board(2, ())
    assert [host.send(0xF2 << 56 | 0xD0 + n, 0x1234 + n)[1] for n in range(3)] == [0, 0, 0]
    assert [host.send(0xF3 << 56 | 0xD0 + n, 0)[1] for n in range(3)] == [0x34, 0x35, 0]
    assert host.twin.state()["current"] == [0x34, 0x35]
    assert host.status(0xFE) == 0x12040
    host.twin.reset()
    assert host.twin.state()["current"] == [0, 0]


def test_a_board_without_bridges_has_no_currents():
    host = vectors.Host()
    host.configure(0xD0, 5)
    assert host.send(0xF3 << 56 | 0xD0, 0) == [0, 0]
    assert host.status(0xFE) == 0x2040
    assert not any(pin.startswith("phase") for pin in host.twin.output_pins)


def test_pins_that_are_not_recorded_stay_low_and_the_others_are_the_same():
    found = []
    for recorded in (1, 0):
        host = board(2, (255, 255), 0b11, phase_pins=recorded)
        host.move(500, (U // 3, 0), (-U // 5, 1 << 50))
        host.wait(5000)
        found.append(host.trace())
    whole, rest = found
    for pin in whole.pins:
        if pin.startswith("phase"):
            assert not len(rest[pin])
            assert len(whole[pin])
        else:
            assert rest[pin].tolist() == whole[pin].tolist()


def test_bridges_are_in_profile_document_only():
    with pytest.raises(UsageError, match="motor_driver = 1 in profile upstream"):
        RapcoresTwin("upstream", motor_driver=1)
    with pytest.raises(UsageError, match="motor_driver = 2"):
        RapcoresTwin(motor_driver=2)
    names = [f"phase{motor}_{leg}" for motor in range(2) for leg in LEGS]
    assert RapcoresTwin(motors=2, motor_driver=1).output_pins[-8:] == tuple(names)
