"""The twin against the slow model: every pin at every cycle, every byte read, every counter."""

import random

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from usc_reference import DOCUMENT, LINUXCNC, Reference

from pulsewright.boards.usc.twin import UscTwin
from pulsewright.edges.trace import concatenate
from pulsewright.transport.bus import EPP_ACCESS

AXES = st.integers(0, 3)
LEVEL = st.integers(0, 1)
BYTE = st.integers(0, 255)
GAP = st.one_of(st.integers(0, 9), st.integers(0, 150), st.sampled_from([0, 0, 400, 1000]))
CODE = st.one_of(st.integers(0xF0, 0xFF), st.sampled_from([0xFE, 0xFF, 0x00, 0xE0]))
N = st.one_of(st.integers(0, 12), st.integers(0, 80), st.sampled_from([0xFFFFFF, 0x10000, 300]))

SWITCHES = st.fixed_dictionaries(
    {},
    optional={
        "div_offset": st.integers(0, 4),
        "time_code": st.sampled_from([255, 256]),
        "min_space": st.integers(1, 5),
        "ident": st.sampled_from([0x41, 0x42, 0x4E]),
        "sense_gate": LEVEL,
        "mariss": LEVEL,
        "loopback": LEVEL,
        "enc_filter": st.sampled_from([1, 1, 2, 3, 7]),
        "base": st.integers(0, 6),
    },
)
KINDS = [
    *("divisors", "divisors", "divisor", "control", "codes", "outputs", "release", "timer"),
    *("encoders", "read", "any", "byte", "address", "din", "estop_in", "enc", "index"),
    *("loopback", "cycle", "cycle", "reset", "ninit"),
]
STORM_KINDS = [
    *("control", "divisor", "two", "code", "release", "latch", "timer", "select"),
    *("read", "din", "estop_in", "enc", "index", "loopback", "reset"),
]


def address(b, register):
    return ("A", b, register)  # the board bits are put in when the base is known


@st.composite
def commands(draw, board_count):
    """One thing that software does: a list of accesses, or a control command."""
    b = draw(st.integers(0, board_count - 1))
    kind = draw(st.sampled_from(KINDS))
    if kind == "divisors":
        first = draw(AXES)
        data = [
            d for n in draw(st.lists(N, min_size=1, max_size=4)) for d in n.to_bytes(3, "little")
        ]
        return [address(b, 0x10 + 3 * first), *(("W", d) for d in data)]
    if kind == "divisor":
        return [address(b, 0x10 + 3 * draw(AXES) + draw(st.integers(0, 2))), ("W", draw(BYTE))]
    if kind == "control":
        return [address(b, 0x1C), ("W", draw(st.one_of(BYTE, st.sampled_from([0xFF, 0xAA]))))]
    if kind == "codes":
        return [address(b, 0x1D), ("W", draw(CODE)), ("W", draw(CODE))]
    if kind == "outputs":
        return [address(b, 0x1F), ("W", draw(BYTE))]
    if kind == "release":
        return [address(b, 0x1F), ("W", 0), address(b, 0x1F), ("W", 0x80 | draw(BYTE))]
    if kind == "timer":
        value = draw(st.sampled_from([0x00, 0x10, 0x11, 0x12, 0x20, 0x30, 0x31, 0x01]))
        return [address(b, 0x04), ("W", value)]
    if kind == "encoders":
        register = draw(st.sampled_from([0x03, 0x0C, 0x0D, 0x06, 0x0F]))
        return [
            address(b, register),
            ("W", draw(st.one_of(BYTE, st.sampled_from([0, 0xF0, 0x0F])))),
        ]
    if kind == "read":
        first = draw(st.sampled_from([0, 0, 3, 6, 0x0C, 0x0D, 0x0E, 0x0F, 0x10]))
        return [address(b, first), *[("R", 0)] * draw(st.integers(1, 8))]
    if kind == "any":
        data = draw(st.lists(BYTE, min_size=1, max_size=4))
        return [("A", None, draw(BYTE)), *(("W", d) for d in data)]
    if kind == "byte":
        return [(draw(st.sampled_from("WRa")), draw(BYTE))]
    if kind == "address":
        return [("A", None, draw(BYTE)), ("a", 0), ("R", 0)]
    if kind == "cycle":
        return [
            address(b, 4),
            ("W", 0x20),
            address(b, 4),
            ("W", 0),
            address(b, 0),
            *[("R", 0)] * 15,
        ]
    if kind == "din":
        return ("din", b, draw(st.integers(0, 0x7FFF)))
    if kind == "enc":
        return ("enc", b, draw(AXES), draw(st.sampled_from([0, 5, -1, 0x7FFFFF, -0x800000])))
    if kind == "index":
        return ("index", b, draw(AXES))
    if kind in ("estop_in", "loopback"):
        return (kind, b, draw(LEVEL))
    return (kind, draw(LEVEL))


@st.composite
def input_changes(draw, board_count):
    """Changes of board inputs: quadrature walks, glitches, index pulses, inputs, the chain."""
    changes, phases = [], {}
    cycle = 0
    for _ in range(draw(st.integers(0, 60))):
        cycle += draw(st.one_of(st.integers(0, 3), st.integers(0, 60)))
        b, i = draw(st.integers(0, board_count - 1)), draw(AXES)
        prefix = f"b{b}." if b else ""
        kind = draw(st.sampled_from(["walk"] * 5 + ["pin"] * 2 + ["index", "din", "chain"]))
        if kind == "walk":
            phases[b, i] = (phases.get((b, i), 0) + draw(st.sampled_from([1, 1, 1, -1]))) % 4
            pin = ("a", "b", "a", "b")[phases[b, i]]
            changes.append((cycle, f"{prefix}{pin}{i}", int(phases[b, i] in (1, 2))))
        elif kind == "pin":
            changes.append((cycle, f"{prefix}{draw(st.sampled_from('ab'))}{i}", draw(LEVEL)))
        elif kind == "index":
            changes.append((cycle, f"{prefix}index{i}", draw(LEVEL)))
        elif kind == "din":
            changes.append((cycle, f"{prefix}din{draw(st.integers(0, 14))}", draw(LEVEL)))
        else:
            closed = draw(st.sampled_from([0, 1, 1]))
            changes.append((cycle, f"{prefix}estop_chain", closed))
    return changes


@st.composite
def scenarios(draw):
    boards = draw(st.sampled_from([1, 1, 2]))
    options = {
        "profile": draw(st.sampled_from(["document", "linuxcnc"])),
        "boards": boards,
        "clock_hz": draw(st.sampled_from([10, 20, 40])) * 1_000_000,
        "watchdog_us": draw(st.sampled_from([0, 0, 0, 3, 50, 10_000])),
        **draw(SWITCHES),
    }
    access_cycles = draw(st.sampled_from([0, 1, 2, 7, 10, 60]))
    steps = draw(st.lists(st.tuples(GAP, commands(boards)), min_size=1, max_size=30))
    if draw(st.sampled_from([True, True, True, False])):  # boards that run are more interesting
        prelude = []
        for b in range(boards):
            prelude += [address(b, 0x10), *[("W", d) for d in (9, 0, 0, 14, 0, 0)]]
            prelude += [address(b, 0x1C), ("W", 0xFB), address(b, 0x1F), ("W", 0x80)]
        prelude += [address(0, 0x04), ("W", draw(st.sampled_from([0x00, 0x11])))]
        steps.insert(0, (0, prelude))
    return options, access_cycles, steps, draw(input_changes(boards))


def storm(seed):
    """A dense scenario: short periods, reversals in pulses, latches and inputs close together."""
    rng = random.Random(seed)
    boards = rng.choice([1, 1, 2])
    clock = rng.choice([10, 20, 40])
    options = {
        "profile": rng.choice(["document", "linuxcnc"]),
        "boards": boards,
        "clock_hz": clock * 1_000_000,
        "watchdog_us": rng.choice([0, 0, 5, 40]),
        "min_space": rng.choice([1, 3, 5]),
        "ident": rng.choice([0x41, 0x42]),
        "sense_gate": rng.choice([0, 1]),
        "mariss": rng.choice([0, 0, 1]),
        "loopback": rng.choice([0, 1]),
        "enc_filter": rng.choice([1, 2, 4]),
    }
    tick = clock // 10
    highest = 255 if options["profile"] == "document" else 256

    def code():
        return highest - min(rng.choice([1, 1, 2, 3, 8, 20]), highest)

    def divisor():
        return rng.choice([0, 1, 2, 3, 5, 9, 9, 15, 30, 60]).to_bytes(3, "little")

    def command():
        b, i = rng.randrange(boards), rng.randrange(4)
        kind = rng.choices(
            STORM_KINDS,
            [30, 15, 15, 10, 8, 8, 5, 8, 5, 2, 1, 4, 4, 1, 1],
        )[0]
        if kind == "control":
            return [address(b, 0x1C), ("W", rng.choice([0xAA, 0xFF, rng.randrange(256)]))]
        if kind in ("divisor", "two"):
            count = 1 if kind == "divisor" else 2
            data = b"".join(divisor() for _ in range(count))
            return [address(b, 0x10 + 3 * min(i, 4 - count)), *(("W", d) for d in data)]
        if kind == "code":
            return [address(b, rng.choice([0x1D, 0x1E])), ("W", code())]
        if kind == "release":
            first = rng.choice([[], [("W", 0), address(b, 0x1F)]])
            return [address(b, 0x1F), *first, ("W", 0x80 | rng.randrange(128))]
        if kind == "latch":
            return [
                address(b, 4),
                ("W", rng.choice([0x20, 0x30, 0x31])),
                address(b, 4),
                ("W", 0x11),
            ]
        if kind == "timer":
            return [address(b, 4), ("W", rng.choice([0x11, 0x11, 0x01, 0x12, 0x31]))]
        if kind == "select":
            value = rng.choice([0, 0, rng.randrange(256), 1 << rng.randrange(8)])
            return [address(b, rng.choice([0x03, 0x0C, 0x0D])), ("W", value)]
        if kind == "read":
            return [address(b, rng.choice([0, 9, 0x0C])), *[("R", 0)] * 4]
        if kind == "reset":
            return ("reset", 0)
        last = {
            "din": (rng.randrange(1 << 15),),
            "enc": (i, rng.randrange(1 << 24)),
            "index": (i,),
        }.get(kind, (rng.choice([0, 1, 1]),))
        return (kind, b, *last)

    gaps = rng.choices(
        [0, 1, 3, 10, 40, 120, 500], [30, 15, 20, 20, 10, 4, 1], k=rng.randint(30, 90)
    )
    steps = [(gap * tick // rng.choice([1, 2]), command()) for gap in gaps]
    prelude = [address(0, 0x10), *[("W", d) for d in (9, 0, 0, 14, 0, 0)]]
    prelude += [address(0, 0x1C), ("W", 0xFB), address(0, 0x1F), ("W", 0x80)]
    changes, cycle = [], 0
    for _ in range(rng.randrange(150)):
        cycle += rng.choice([0, 0, 1, 1, 2, 3, 5, 30])
        b, pin = rng.randrange(boards), rng.choice("abababab") + str(rng.randrange(4))
        if rng.random() < 0.3:
            pin = rng.choice([f"index{rng.randrange(4)}", f"din{rng.randrange(15)}"])
        changes.append((cycle, f"b{b}.{pin}" if b else pin, rng.randrange(2)))
    return options, rng.choice([0, 1, 2, 7]), [(0, prelude), *steps], changes


def carry_out(options, access_cycles, steps, changes, bus_pins=False, look=lambda twin: None):
    """Run a scenario on both models; return the twin, its trace and the reference."""
    twin = UscTwin(access_cycles=access_cycles, bus_pins=bus_pins, **options)
    reference = Reference(**{"base": 0, **options})
    base = options.get("base", 0)
    at = {}
    for cycle, pin, level in changes:
        at.setdefault(cycle, {})[pin] = level
    if changes:
        cycles, pins, levels = zip(*changes, strict=True)
        twin.schedule(cycles, pins, levels)
    now, last = 0, -access_cycles
    for gap, command in steps:
        look(twin)
        now += gap
        if isinstance(command, list):
            accesses = np.zeros(len(command), EPP_ACCESS)
            expected = []
            for n, (op, *rest) in enumerate(command):
                value = rest[-1]
                if op == "A" and rest[0] is not None:
                    value |= (base + rest[0]) << 5
                wanted = now if n == 0 else -1
                accesses[n] = (wanted, ord(op), value, 9, (0,) * 5)
                now = last = max(wanted, last + access_cycles, now)
                reference.run_to(now, at)
                expected.append((now, *reference.access(op, value)))
            twin.transact(accesses)
            got = [(int(a["cycle"]), int(a["value"]), int(a["timeout"])) for a in accesses]
            assert got == expected, command
            continue
        reference.run_to(now, at)
        twin.advance(now)
        name, *arguments = command
        if name == "din":
            b, value = arguments
            twin.set_din(value, b)
            for n in range(15):
                reference.set_pin(b, f"din{n}", value >> n & 1)
        elif name == "estop_in":
            b, closed = arguments
            twin.set_estop_chain(bool(closed), b)
            reference.set_pin(b, "estop_chain", closed)
        elif name == "enc":
            b, i, value = arguments
            twin.set_encoder(i, value, b)
            reference.set_encoder(b, i, value)
        elif name == "index":
            b, i = arguments
            twin.index_edge(i, b)
            reference.index_edge(b, i)
        elif name == "loopback":
            b, on = arguments
            twin.set_loopback(bool(on), b)
            reference.boards[b].loopback = on
        elif name == "ninit":
            twin.set_ninit(arguments[0])
            reference.set_ninit(arguments[0])
        elif name == "reset":
            twin.reset()
            reference.set_ninit(0)
            reference.set_ninit(1)
        else:
            raise AssertionError(name)
    return twin, reference, now + 300, at


def assert_same(twin, reference, end, at):
    reference.run_to(end, at)
    twin.advance(end)
    trace = twin.drain()
    for pin in trace.pins:
        assert trace[pin].tolist() == reference.changes[pin], pin
        assert trace.level_at_start(pin) == reference.initial[pin]
    for b, board in enumerate(reference.boards):
        state, r = twin.state(b), board.r
        assert state["enc"] == list(r["count"])
        assert state["latch"] == list(r["holding"])
        assert state["steps"] == board.steps
        assert state["step_edges"] == board.pulses
        assert state["estop"] == (not r["running"])
        assert state["rate"] == list(r["N"])
        assert state["index_sense"] == r["sense"]
        assert state["assembly"] == r["assembly"]
        assert state["address"] == next(
            (x.r["address"] for x in reference.boards if x.selected()), state["address"]
        )
        if board.p.watchdog_us:
            assert state["watchdog_left"] == r["watchdog"]


SETTINGS = {
    "deadline": None,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large],
}


@st.composite
def strobes(draw):
    """Bus pins: legal EPP cycles, some with a flaw, and plain abuse. Changes by cycle."""
    changes, cycle = {}, draw(st.integers(0, 9))

    def put(at, **levels):
        changes.setdefault(at, {}).update(levels)

    for _ in range(draw(st.integers(1, 25))):
        kind = draw(st.sampled_from(["address", "write", "read"] * 3 + ["mess", "ninit"]))
        if kind == "mess":
            for _ in range(draw(st.integers(1, 12))):
                pin = draw(st.sampled_from(["nwrite", "ndatastr", "naddrstr", "data"]))
                put(cycle, **{pin: draw(BYTE if pin == "data" else LEVEL)})
                cycle += draw(st.integers(0, 4))
            put(cycle, nwrite=1, ndatastr=1, naddrstr=1)
            cycle += draw(st.integers(1, 12))
        elif kind == "ninit":
            put(cycle, ninit=0)
            put(cycle + draw(st.sampled_from([1, 2, 5])), ninit=1)
            cycle += draw(st.integers(1, 9))
        else:
            register = draw(st.sampled_from([0, 4, 0x0C, 0x0D, 0x0E, 0x10, 0x1C, 0x1D, 0x1F, 0x2C]))
            data = (
                register if kind == "address" else draw(st.one_of(BYTE, N.map(lambda n: n % 256)))
            )
            pin = "naddrstr" if kind == "address" else "ndatastr"
            flaw = draw(st.sampled_from([None] * 6 + ["both", "short", "nwrite"]))
            length = draw(st.integers(1, 2)) if flaw == "short" else draw(st.integers(3, 6))
            put(cycle, nwrite=int(kind == "read"), data=data, **{pin: 0})
            if flaw == "both":
                put(cycle, ndatastr=0, naddrstr=0)
            if flaw == "nwrite":
                put(cycle + draw(st.integers(1, 4)), nwrite=draw(LEVEL))
            put(cycle + length, ndatastr=1, naddrstr=1, nwrite=1)
            cycle += length + draw(st.sampled_from([1, 2, 5, 5, 5, 30]))
    return changes


@st.composite
def pin_scenarios(draw):
    boards = draw(st.sampled_from([1, 1, 2]))
    options = {
        "profile": draw(st.sampled_from(["document", "linuxcnc"])),
        "boards": boards,
        "clock_hz": draw(st.sampled_from([10, 20, 40])) * 1_000_000,
        "watchdog_us": draw(st.sampled_from([0, 0, 1, 5])),
        "nwait_idle": draw(LEVEL),
        **draw(SWITCHES),
        "base": draw(st.sampled_from([0, 0, 1])),
    }
    prelude = draw(st.sampled_from([[], [(0x1F, 0x8F), (0x10, 9, 0, 0, 5, 0, 0), (0x1C, 0xFF)]]))
    return options, prelude, draw(strobes()), draw(input_changes(boards))


def carry_out_at_pins(options, prelude, bus, changes):
    """As `carry_out`, but after a prelude of plain accesses the bus is driven by its pins."""
    commands = [[("A", 0, first), *(("W", d) for d in data)] for first, *data in prelude]
    twin, reference, _, _ = carry_out(options, 1, [(0, c) for c in commands], [], bus_pins=True)
    start = twin.now + 1
    at = {start + cycle: dict(levels) for cycle, levels in bus.items()}
    for cycle, pin, level in changes:
        at.setdefault(start + cycle, {})[pin] = level
    events = [(cycle, pin, level) for cycle, pins in at.items() for pin, level in pins.items()]
    twin.schedule(*zip(*events, strict=True))
    return twin, reference, max(at) + 100, at


@settings(max_examples=50, **SETTINGS)
@given(scenarios())
def test_transactions_match_the_reference(scenario):
    assert_same(*carry_out(*scenario))


@settings(max_examples=35, **SETTINGS)
@given(st.integers(0, 2**32).map(storm))
def test_storms_match_the_reference(scenario):
    assert_same(*carry_out(*scenario))


@settings(max_examples=60, **SETTINGS)
@given(pin_scenarios())
def test_pins_match_the_reference(scenario):
    assert_same(*carry_out_at_pins(*scenario))


@settings(max_examples=25, **SETTINGS)
@given(scenarios(), st.lists(st.integers(0, 100), max_size=6))
def test_portions_do_not_matter(scenario, cuts):
    """Advancing, draining and looking in between changes nothing."""
    traces = []

    def look(twin):
        twin.state()
        traces.append(twin.drain())

    whole, _, end, _ = carry_out(*scenario)
    parts, _, _, _ = carry_out(*scenario, look=look)
    for cut in sorted(cuts):
        parts.advance(min(parts.now + cut, end))
        look(parts)
    for twin in (whole, parts):
        twin.advance(end)
    traces.append(parts.drain())
    assert concatenate(traces) == whole.drain()
    assert parts.state() == whole.state()


@pytest.mark.campaign
@settings(max_examples=150, **SETTINGS)
@given(st.integers(0, 2**32).map(storm))
def test_storms_match_the_reference_campaign(scenario):
    assert_same(*carry_out(*scenario))


@pytest.mark.campaign
@settings(max_examples=400, **SETTINGS)
@given(pin_scenarios())
def test_pins_match_the_reference_campaign(scenario):
    assert_same(*carry_out_at_pins(*scenario))


@pytest.mark.campaign
@settings(max_examples=400, **SETTINGS)
@given(scenarios())
def test_transactions_match_the_reference_campaign(scenario):
    assert_same(*carry_out(*scenario))


def test_reference_has_the_switches_of_the_profiles():
    assert UscTwin("document").switches == DOCUMENT
    assert UscTwin("linuxcnc").switches == LINUXCNC
