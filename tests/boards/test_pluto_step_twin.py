"""The twin of pluto-step against a clock-by-clock model written from the specification alone."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pluto_step_reference import HOLD, RUN, SETUP, Axis, Reference

from pulsewright.boards.pluto_step import twin_stepgen as stepgen
from pulsewright.boards.pluto_step.registers import PROFILES
from pulsewright.boards.pluto_step.twin import PlutoStepTwin
from pulsewright.errors import BusError, UsageError
from pulsewright.transport.bus import (
    ADDRESS_READ,
    ADDRESS_WRITE,
    DATA_READ,
    DATA_WRITE,
    EPP_ACCESS,
    read_accesses,
    write_accesses,
)
from pulsewright.twin.recorder import Recorder

IDLE = (1, 1, 1, 1, 0, 0)


def reference_levels(stimulus, cycles, **switches):
    """Return the output pins after every edge, shape (cycles, pins)."""
    model = Reference(**switches)
    pins, rows = list(IDLE), []
    changes = iter(sorted(stimulus, key=lambda change: change[0]))
    upcoming = next(changes, None)
    for n in range(cycles):
        while upcoming is not None and upcoming[0] <= n:
            pins[upcoming[1]] = upcoming[2]
            upcoming = next(changes, None)
        rows.append(model.clock(*pins))
    return np.array(rows, np.uint8)


def twin_levels(stimulus, cycles, stops=(), **switches):
    """Return the same of the twin; it is asked for its trace at ``stops`` too."""
    twin = PlutoStepTwin(bus_pins=True, **switches)
    for cycle, pin, level in sorted(stimulus, key=lambda change: change[0]):
        if pin < 5:
            twin.schedule([cycle], [pin], [level])
        else:
            for n in range(16):
                twin.schedule([cycle], [f"din{n}"], [level >> n & 1])
    rows = np.zeros((cycles, len(twin.output_pins)), np.uint8)
    for stop in (*sorted(stops), cycles):
        twin.advance(stop)
        trace = twin.drain()
        for i, changes in enumerate(trace.cycles):
            toggles = np.zeros(trace.end - trace.start, np.uint8)
            toggles[changes - trace.start] = 1
            rows[trace.start : trace.end, i] = trace.initial[i] ^ (np.cumsum(toggles) & 1)
    return rows


def assert_same(stimulus, cycles, stops=(), **switches):
    expected = reference_levels(stimulus, cycles, **switches)
    actual = twin_levels(stimulus, cycles, stops, **switches)
    wrong = np.argwhere(expected != actual)
    pins = PlutoStepTwin(bus_pins=True).output_pins
    assert not len(wrong), f"{pins[wrong[0, 1]]} after edge {wrong[0, 0]} of {len(wrong)} wrong"


class Host:
    """A legal EPP host: strobe sampled for five edges, ten edges per access."""

    def __init__(self):
        self.changes = []

    def set(self, cycle, nwrite, ndatastr, naddrstr, data=0):
        for pin, level in enumerate((nwrite, ndatastr, naddrstr)):
            self.changes.append((cycle, pin, level))
        self.changes.append((cycle, 4, data))

    def strobe(self, cycle, nwrite, ndatastr, naddrstr, data=0, length=5):
        self.set(cycle, nwrite, ndatastr, naddrstr, data)
        self.set(cycle + length, nwrite, 1, 1, data)
        return self

    def aw(self, cycle, value):
        return self.strobe(cycle, 0, 1, 0, value)

    def dw(self, cycle, value):
        return self.strobe(cycle, 0, 0, 1, value)

    def dr(self, cycle):
        return self.strobe(cycle, 1, 0, 1)

    def write(self, cycle, address, *data):
        self.aw(cycle, address)
        for n, value in enumerate(data):
            self.dw(cycle + 10 * (n + 1), value)
        return self


# ----------------------------------------------------------------- against the clock-by-clock model

switch_sets = st.one_of(
    st.just({}),
    st.just(PROFILES["extended"]),
    st.fixed_dictionaries({name: st.integers(0, 1) for name in PROFILES["exact"]}),
)
# words that make things happen: fast axes, taps, arms, the words of the extended profile
accesses = st.one_of(
    st.tuples(st.just("aw"), st.sampled_from([*range(32), 0, 2, 8, 10, 12, 14, 24])),
    st.tuples(st.just("dw"), st.sampled_from([0, 1, 2, 3, 4, 5, 7, 8, 11, 12, 0x40, 0x80, 0xFF])),
    st.tuples(st.just("dw"), st.integers(0, 255)),
    st.tuples(st.just("dr"), st.just(0)),
    st.tuples(st.just("ar"), st.just(0)),
    st.tuples(st.just("both"), st.integers(0, 255)),
    st.tuples(st.just("short"), st.integers(0, 255)),
    st.tuples(st.just("flip"), st.integers(0, 255)),
    st.tuples(st.just("din"), st.integers(0, 0xFFFF)),
)
LINES = {  # nWrite, nDataStr, nAddrStr
    "aw": (0, 1, 0),
    "dw": (0, 0, 1),
    "dr": (1, 0, 1),
    "ar": (1, 1, 0),
    "both": (0, 0, 0),
    "short": (0, 1, 0),
    "flip": (0, 0, 1),
}


def program(steps, start=10):
    """Return the stimulus of a random program, and the cycle after it."""
    host, now = Host(), start
    for (kind, value), gap in steps:
        if kind == "din":
            host.changes.append((now, 5, value))
        elif kind == "short":
            host.strobe(now, *LINES[kind], value, length=2)
            now += 10
        else:
            host.strobe(now, *LINES[kind], value)
            if kind == "flip":
                host.changes.append((now + 3, 0, 1))
            now += 10
        now += gap
    return host.changes, now


@settings(max_examples=40, deadline=None)
@given(
    switches=switch_sets,
    steps=st.lists(
        st.tuples(accesses, st.sampled_from([0, 0, 0, 1, 37, 64, 300, 1500])),
        min_size=1,
        max_size=60,
    ),
    stop=st.integers(0, 4000),
)
def test_twin_equals_the_model_at_every_clock(switches, steps, stop):
    """Whatever is on the bus, legal or not, every pin is the same after every edge."""
    stimulus, end = program(steps)
    assert_same(stimulus, end + 2000, [stop] if stop < end else [], **switches)


stretches = st.lists(
    st.tuples(
        st.one_of(  # velocity: any, or one that pulses can follow
            st.integers(-2048, 2047), st.sampled_from([0, 1, -1, 341, -341, 512, -512, 1024, -1024])
        ),
        st.sampled_from([0, 0, 1, 2, 3, 7, 15]),  # steptime
        st.sampled_from([0, 0, 1, 2, 4, 15]),  # dirtime
        st.sampled_from([0, 0, 0, 1, 2, 3]),  # tap
        st.sampled_from([0, 0, 1, 5, 15]),  # space
        st.sampled_from([1, 2, 3, 5, 17, 60, 500]),  # ticks
    ),
    min_size=1,
    max_size=25,
)


@settings(max_examples=150, deadline=None)
@given(stretches, st.integers(0, 1), st.integers(0, 1), st.booleans())
# a long space that runs on after the host has made it short
@example([(512, 0, 0, 0, 15, 7), (1024, 0, 0, 0, 0, 40)], 0, 1, False)
def test_step_generator_equals_the_model_at_every_tick(parts, clean, enforce, hidden):
    """Closed form and tick by tick give the same state, whatever the host writes when."""
    model, axis = Axis(), np.zeros(1, stepgen.STEPGEN)
    recorder = Recorder(("step", "dir", "led"), 40_000_000)
    pins = stepgen.Pins(-1, -1, -1) if hidden else stepgen.Pins(0, 1, 2)
    at, tap, levels = 0, 0, []
    for v, s, t, new_tap, sp, ticks in parts:
        if new_tap != tap:
            tap, model.unserved, axis["pending"] = new_tap, False, 0
        space = sp if enforce else 0
        timing = stepgen.Timing(s, t, space, tap, clean, enforce)
        for _ in range(ticks):
            model.tick(v, s, t, tap, space, clean, enforce)
            levels.append((model.step, model.dir, model.step ^ model.dir))
        at += ticks
        while not stepgen.advance(axis[0], at, v, timing, 0, recorder.rows, pins, 16):
            recorder.grow()
        state = {name: int(axis[name][0]) for name in axis.dtype.names}
        assert state["position"] % 2**21 == model.pos
        for name in ("step", "timer", "mode", "last", "space", "missed"):
            assert state[name] == getattr(model, name), name
        assert (state["direction"], state["tick"]) == (model.dir, at)
        assert bool(state["pending"]) == model.unserved
    trace = recorder.drain(64 * at)
    expected = np.diff(np.array([(0, 0, 0), *levels]), axis=0)
    for i in range(3):
        assert trace.cycles[i].tolist() == (
            [] if hidden else (64 * expected[:, i].nonzero()[0]).tolist()
        )
    if not hidden:
        signs = [1 - 2 * level[1] for level, d in zip(levels, expected[:, 0], strict=True) if d > 0]
        # merged pulses are counted too: those that start while the pin is high
        assert state["pulses"] >= len(signs)


def test_twin_equals_the_model_through_watchdog_and_reset():
    """Arm, expire with axes running, stop by the watchdog, re-arm, reset in the middle."""
    host = Host()
    host.write(100, 0x00, 0x00, 0x04, 0x00, 0xFE, 0xFF, 0x07, 0x01, 0x00, 0x34, 0x52, 0x02, 0x83)
    host.write(300, 0x0E, 0x02, 0x00)
    host.write(268_000, 0x08, 0x34, 0x52)
    host.changes += [(271_000, 3, 0), (271_007, 3, 1)]
    host.write(272_000, 0x00, 0x00, 0x04)
    assert_same(host.changes, 273_000, [260_095, 260_096], wd_stop=1)


# ------------------------------------------------------------------------------- worked vectors (8)


def levels_after(host, pin, cycles):
    """Return the level of a pin after each of the given edges."""
    twin = PlutoStepTwin(bus_pins=True)
    for change in sorted(host.changes, key=lambda change: change[0]):
        twin.schedule(*([value] for value in change))
    twin.advance(max(cycles) + 1)
    trace = twin.drain()
    start = trace.level_at_start(pin)
    return [start ^ int((trace[pin] <= cycle).sum() & 1) for cycle in cycles]


def replies(host, cycles, din=0):
    """Return the byte driven after each of the given edges, None while nothing is driven."""
    twin = PlutoStepTwin(bus_pins=True)
    twin.set_din(din)
    for change in sorted(host.changes, key=lambda change: change[0]):
        twin.schedule(*([value] for value in change))
    twin.advance(max(cycles) + 1)
    trace = twin.drain()

    def level(pin, cycle):
        return int((trace[pin] <= cycle).sum() & 1)

    return [
        sum(level(f"data{n}", cycle) << n for n in range(8)) if level("drive", cycle) else None
        for cycle in cycles
    ]


def test_vector_1_handshake_and_drive_when_nwrite_rises_early():
    host = Host().aw(100, 0x08)
    host.changes.append((105, 0, 1))
    assert levels_after(host, "nwait", [103, 104, 108, 109]) == [1, 0, 0, 1]
    assert levels_after(host, "drive", [104, 105, 108, 109]) == [0, 1, 1, 0]


def test_vector_2_outputs_change_all_at_once():
    host = Host().write(100, 0x08, 0x34, 0x12)
    for n in range(14):
        assert levels_after(host, f"out{n}", [121, 122]) == [0, 0x1234 >> n & 1]


def test_vectors_3_and_4_inputs_are_latched_once_and_read_stale():
    host = Host().aw(100, 0x10).dr(110).dr(120).dr(130).dr(140)
    after = [113, 114, 118, 119, 124, 128, 134, 138, 144, 148]
    assert replies(host, after, 0xBEEF) == [None, 0xEF, 0xEF, None, 0xBE, 0xBE, 0, 0, 0, 0]
    host.aw(150, 0x11).dr(160)
    assert replies(host, [164], 0xBEEF) == [0xBE]


def test_vector_5_positive_start():
    host = Host().write(100, 0x00, 0x00, 0x04)
    cycles = [255, 256, 319, 320, 383, 384, 447, 448]
    assert levels_after(host, "step0", cycles) == [0, 1, 1, 0, 0, 1, 1, 0]
    assert levels_after(host, "led", cycles) == [0, 1, 1, 0, 0, 1, 1, 0]
    assert levels_after(host, "dir0", cycles) == [0] * 8


def test_vector_6_negative_start():
    host = Host().write(100, 0x00, 0x00, 0xFC)
    assert levels_after(host, "dir0", [191, 192, 600]) == [0, 1, 1]
    cycles = [383, 384, 447, 448, 511, 512]
    assert levels_after(host, "step0", cycles) == [0, 1, 1, 0, 0, 1]
    assert levels_after(host, "led", cycles) == [1, 0, 0, 1, 1, 0]


def test_vector_7_polarity_and_tap():
    host = Host().write(100, 0x0A, 0x40, 0x80).write(130, 0x00, 0x00, 0x04)
    for axis in range(4):
        assert levels_after(host, f"step{axis}", [121, 122]) == [0, 1]
    cycles = [447, 448, 511, 512, 703, 704]
    assert levels_after(host, "step0", cycles) == [1, 0, 0, 1, 1, 0]
    assert levels_after(host, "led", cycles) == [0, 1, 1, 0, 0, 1]


def test_vector_8_short_strobe_increments():
    host = Host().aw(100, 0x00).strobe(120, 0, 1, 0, 0x08, length=1).dw(140, 0x55).dw(150, 0x02)
    twin = PlutoStepTwin()
    for change in sorted(host.changes, key=lambda change: change[0]):
        twin.schedule(*([value] for value in change))
    twin.advance(200)
    state = twin.state()
    assert state["vel"] == [0x500, 0, 0, 0]
    assert (state["dout"], state["address"]) == (0, 3)


def test_vector_9_watchdog_expires():
    host = Host().write(100, 0x08, 0xFF, 0x40)
    assert levels_after(host, "out7", [121, 122, 260_094, 260_095]) == [0, 1, 1, 0]
    assert levels_after(host, "tristate", [260_094, 260_095]) == [0, 1]


def test_vector_10_writes_alias():
    twin = PlutoStepTwin()
    twin.transact(write_accesses(0x11, bytes([0x04])))
    assert twin.state()["vel"] == [0x400, 0, 0, 0]


def step_ticks(velocity, ticks, steptime=0, dirtime=0, **switches):
    """Return ticks of rising and falling step edges, of an axis that has ``velocity`` at tick 0."""
    twin = PlutoStepTwin(access_cycles=1, **switches)
    twin.reset()  # edge 0 is the present one, so writes at cycle 0 act before the first tick
    twin.transact(write_accesses(0x0A, bytes([steptime, dirtime])))
    twin.transact(write_accesses(0x00, velocity.to_bytes(2, "little", signed=True)))
    twin.advance(64 * (ticks + 2))
    trace = twin.drain()
    return trace, lambda pin, level: ((trace.edges(pin, level) - 64) // 64).tolist()


def test_vector_11_slowest_positive_steps():
    _, ticks = step_ticks(1, 4200)
    assert ticks("step0", 1) == [2048, 4096]


def test_vector_12_slowest_negative_steps():
    _, ticks = step_ticks(-1, 4200)
    assert ticks("dir0", 1) == [1]
    assert ticks("step0", 1) == [4, 2052, 4100]


def test_vector_13_pulses_merge_above_the_limit():
    _, ticks = step_ticks(2047, 30, steptime=3)
    assert ticks("step0", 1)[:3] == [2, 7, 12]
    assert ticks("step0", 0)[:3] == [6, 11, 16]


def test_vector_14_limit_case_keeps_one_low_tick():
    _, ticks = step_ticks(512, 16, steptime=2)
    assert ticks("step0", 1)[:3] == [4, 8, 12]
    assert ticks("step0", 0)[:3] == [7, 11, 15]


VECTOR_15 = {  # state after ticks 0..15: pos, step, dir, timer, mode, last
    "exact": [
        *((1024, 0, 0, 0, RUN, 0), (2048, 0, 0, 0, RUN, 0), (3072, 1, 0, 1, RUN, 1)),
        *((4096, 1, 0, 0, RUN, 1), (4096, 1, 0, 1, RUN, 0), (4096, 1, 0, 0, RUN, 0)),
        *((4096, 0, 0, 2, HOLD, 0), (5120, 0, 0, 1, HOLD, 0), (6144, 0, 0, 0, HOLD, 0)),
        *((6144, 1, 0, 1, HOLD, 1), (6144, 1, 0, 0, HOLD, 1), (6144, 1, 1, 2, SETUP, 1)),
        *((6144, 1, 1, 1, SETUP, 1), (6144, 1, 1, 0, SETUP, 1), (6144, 1, 1, 0, RUN, 1)),
        (5120, 0, 1, 0, RUN, 1),
    ],
    "clean": [
        *((1024, 0, 0, 0, RUN, 0), (2048, 0, 0, 0, RUN, 0), (3072, 1, 0, 1, RUN, 1)),
        *((4096, 1, 0, 0, RUN, 1), (4096, 1, 0, 1, RUN, 0), (4096, 1, 0, 0, RUN, 0)),
        *((4096, 0, 0, 2, HOLD, 0), (5120, 0, 0, 0, RUN, 0), (6144, 0, 0, 0, RUN, 0)),
        *((6144, 1, 0, 1, RUN, 1), (6144, 1, 0, 0, RUN, 1), (6144, 0, 0, 2, HOLD, 1)),
        *((6144, 0, 0, 1, HOLD, 1), (6144, 0, 0, 0, HOLD, 1), (6144, 0, 1, 2, SETUP, 1)),
        *((6144, 0, 1, 1, SETUP, 1), (6144, 0, 1, 0, SETUP, 1), (6144, 0, 1, 0, RUN, 1)),
        (5120, 0, 1, 0, RUN, 1),
    ],
}


@pytest.mark.parametrize(("name", "clean"), [("exact", 0), ("clean", 1)])
def test_vector_15_cancelled_reversal(name, clean):
    axis, rows = np.zeros(1, stepgen.STEPGEN), Recorder(("step", "dir"), 1).rows
    timing = stepgen.Timing(1, 2, 0, 0, clean, 0)
    got = []
    for tick in range(len(VECTOR_15[name])):
        v = -1024 if 4 <= tick <= 6 or tick >= 9 else 1024
        stepgen.advance(axis[0], tick + 1, v, timing, 0, rows, stepgen.Pins(0, 1, -1), 16)
        got.append(
            tuple(
                int(axis[name][0])
                for name in ("position", "step", "direction", "timer", "mode", "last")
            )
        )
    assert got == VECTOR_15[name]


# ---------------------------------------------------------------------------- rules stated in words


@pytest.mark.parametrize(
    ("steptime", "limit"),
    list(
        enumerate((1024, 682, 512, 409, 341, 292, 256, 227, 204, 186, 170, 157, 146, 136, 128, 120))
    ),
)
def test_highest_velocity_without_lost_steps(steptime, limit):
    """The table of section 4.2: at the limit no step is lost, above it some are."""
    for v, lost in ((limit, False), (limit + 1, True)):
        twin = PlutoStepTwin(access_cycles=1)
        twin.transact(write_accesses(0x0A, bytes([steptime, 0])))
        twin.transact(write_accesses(0x00, v.to_bytes(2, "little")))
        twin.advance(64 * 20_000)
        pulses = len(twin.drain().edges("step0", 1))
        assert (pulses < v * 19_990 // 2048) == lost


def test_enforced_space_keeps_pulses_apart_and_reports_missed_steps():
    def run(v, sp):
        twin = PlutoStepTwin("extended", access_cycles=1)
        twin.transact(write_accesses(0x0A, bytes([1, 0, sp, 0])))
        twin.transact(write_accesses(0x00, v.to_bytes(2, "little")))
        twin.advance(64 * 5000)
        return twin, twin.drain()

    def shortest_low(trace):
        rises = trace.edges("step0", 1)
        return (rises[1:] - trace.edges("step0", 0)[: len(rises) - 1]).min()

    for sp in (0, 3, 9):
        limit = 2048 // (1 + sp + 2)
        twin, trace = run(limit, sp)
        assert twin.state()["missed"] == [False] * 4
        assert shortest_low(trace) >= 64 * (sp + 1)
        twin, trace = run(2 * limit, sp)
        assert shortest_low(trace) == 64 * (sp + 1)
        assert twin.state()["missed"] == [True, False, False, False]


def status_byte(twin):
    accesses = read_accesses(0x18, 1)
    twin.transact(accesses)
    return int(accesses["value"][1])


def test_status_is_cleared_by_the_read():
    twin = PlutoStepTwin("extended")
    twin.transact(write_accesses(0x06, (2047).to_bytes(2, "little") + bytes([0, 0x40, 15, 0])))
    twin.advance(64 * 200)
    assert status_byte(twin) == 0x81
    twin.transact(write_accesses(0x06, bytes(2)))
    twin.advance(64 * 500)
    status_byte(twin)
    twin.advance(twin.now + 64 * 100)
    assert status_byte(twin) == 0x01
    twin.advance(300_000)
    assert status_byte(twin) == 0x03


def test_a_read_at_the_edge_of_a_tick_gives_what_was_before_it():
    # v = 1024 as in vector 5: position 1024 after edge 128, 2048 after 192, 3072 after 256
    host = Host().write(100, 0x00, 0x00, 0x04).aw(180, 0x00).dr(190).dr(200)
    assert replies(host, [194, 204]) == [0x00, 0x04]
    host = Host().write(100, 0x00, 0x00, 0x04).aw(181, 0x00).dr(191).dr(201)
    assert replies(host, [195, 205]) == [0x00, 0x08]


def test_a_step_that_ends_with_a_change_of_tap_is_not_missed():
    """Velocity 1024 with STEP high for 16 ticks; the second step waits at position 5120."""
    for tap, missed in ((1, 0x00), (0, 0x10)):
        twin = PlutoStepTwin("extended", access_cycles=1, tap_sync=0)
        twin.transact(write_accesses(0x0A, bytes([15, 0])))
        twin.transact(write_accesses(0x00, bytes([0x00, 0x04])))
        twin.advance(330)  # after tick 5, the fifth that adds
        assert twin.state()["pos"][0] == 5120
        twin.transact(write_accesses(0x0A, bytes([15 | tap << 6, 0])))
        twin.advance(450)
        assert status_byte(twin) == missed


def test_joint_commit_moves_all_axes_at_the_same_tick():
    twin = PlutoStepTwin("extended", access_cycles=100)
    twin.transact(write_accesses(0x0E, bytes([1, 0])))
    twin.transact(write_accesses(0x00, bytes([0, 4] * 4)))
    twin.advance(10_000)
    assert twin.state()["vel"] == [0] * 4
    twin.transact(write_accesses(0x08, bytes(2)))
    twin.advance(20_000)
    trace = twin.drain()
    assert len({int(trace[f"step{axis}"][0]) for axis in range(4)}) == 1


def test_identification_and_tick_count():
    twin = PlutoStepTwin("extended")
    twin.advance(64 * 1000 - 1)
    accesses = read_accesses(0x14, 12)
    accesses["cycle"][0] = 64 * 1000 - 1
    twin.transact(accesses)
    word = bytes(accesses["value"][1:5])
    assert word == bytes([4, 1, 0x57, 0x50])
    # loaded by access 9, 9 x 60 cycles later: ticks 0 .. 1008
    assert int.from_bytes(bytes(accesses["value"][9:13]), "little") == 1000 + (9 * 60 - 1) // 64 + 1


# ------------------------------------------------------------------------------------- transactions


def one(op, value=0, cycle=-1):
    return np.array([(cycle, op, value, 0, [0] * 5)], EPP_ACCESS)


def transacted(twin, *items):
    accesses = np.concatenate([one(*item) for item in items])
    twin.transact(accesses)
    return accesses


def test_accesses_act_no_sooner_than_the_bus_allows():
    twin = PlutoStepTwin(access_cycles=60)
    done = transacted(
        twin, (ADDRESS_WRITE, 0), (DATA_WRITE, 0), (DATA_WRITE, 4, 1000), (DATA_WRITE, 4, 1001)
    )
    assert done["cycle"].tolist() == [0, 60, 1000, 1060]
    assert not done["timeout"].any()


def test_socket_vectors_5_and_6():
    """Worked vectors 5 and 6 of the socket protocol."""
    twin = PlutoStepTwin()
    twin.set_din(0xBEEF)
    accesses = read_accesses(0x10, 4)
    twin.transact(accesses)
    assert bytes(accesses["value"][1:]) == b"\xef\xbe\x00\x00"
    twin.transact(read_accesses(0x00, 4))
    assert transacted(twin, (ADDRESS_READ,))["value"][0] == 0
    assert twin.state()["address"] == 4


def test_a_board_in_reset_does_not_answer_and_the_last_byte_lingers():
    twin = PlutoStepTwin()
    twin.transact(write_accesses(0x08, bytes([0xFF, 0x7F])))
    twin.set_ninit(0)
    done = transacted(twin, (ADDRESS_WRITE, 0x0F), (DATA_READ,), (DATA_WRITE, 0x33), (DATA_READ,))
    assert done["timeout"].tolist() == [0, 1, 1, 1]
    assert done["value"].tolist() == [0x0F, 0x0F, 0x33, 0x33]
    twin.set_ninit(1)
    state = twin.state()
    assert (state["address"], state["dout"], state["wd_enabled"]) == (0, 0, False)
    assert not transacted(twin, (DATA_READ,))["timeout"].any()


def test_a_full_buffer_grows_in_the_middle_of_everything():
    """A long run in one call gives the same edges as many short ones."""
    long, short = PlutoStepTwin(), PlutoStepTwin()
    for twin in (long, short):
        twin.transact(write_accesses(0x00, bytes([0x00, 0x04, 0xFF, 0x07, 0x21, 0xFE, 0x99, 0x00])))
    long.advance(5_000_000)
    whole = long.drain()
    counts = np.zeros(len(whole.pins), int)
    for cycle in range(50_000, 5_000_001, 50_000):
        short.advance(cycle)
        for i, changes in enumerate(short.drain(copy=False).cycles):
            assert np.array_equal(changes, whole.cycles[i][counts[i] : counts[i] + len(changes)])
            counts[i] += len(changes)
    assert counts.tolist() == [len(changes) for changes in whole.cycles]
    assert counts[whole.pins.index("step0")] > 70_000


# ------------------------------------------------------------------------------------------- errors


def test_wrong_use_is_explained():
    twin = PlutoStepTwin()
    with pytest.raises(UsageError, match="no input pin 'din16'; the pins are nwrite"):
        twin.schedule([10], "din16", 1)
    with pytest.raises(UsageError, match=r"level 2 for input pin din0; allowed are 0\.\.1"):
        twin.schedule([10], "din0", 2)
    twin.advance(100)
    with pytest.raises(UsageError, match="cycle 100, but that is over; cycles from 101 on"):
        twin.schedule([100], "din0", 1)
    with pytest.raises(UsageError, match="advance to cycle 99, but it is already 100"):
        twin.advance(99)
    with pytest.raises(UsageError, match=r"digital inputs 0x10000; allowed are 0\.\.0xffff"):
        twin.set_din(0x10000)
    with pytest.raises(UsageError, match="access of -1 cycles"):
        PlutoStepTwin(access_cycles=-1)
    with pytest.raises(BusError, match="access 1 has op 7"):
        transacted(twin, (ADDRESS_WRITE, 0), (7, 0))
    with pytest.raises(BusError, match="array of EPP_ACCESS"):
        twin.transact(np.zeros(3))
