"""Blocks of the S3G gateware against the rules of sections 4.2 to 4.8 of its specification."""

from random import Random

import numpy as np
import pytest

from pulsewright.boards.s3g.gateware_motion import (
    AccelerationSteps,
    ProfileGenerator,
    Profiles,
    PulseFormer,
)
from pulsewright.boards.s3g.gateware_shared import SharedProfiles
from pulsewright.gateware.rtl import RtlSimulation

pytestmark = [
    pytest.mark.rtl,
    pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable"),
]

WORD = 1 << 32


def signed(value):
    """Return a number of 32 bits as its sign bit says."""
    value %= WORD
    return value - WORD if value >= WORD // 2 else value


class Profile:
    """One channel as the specification has it (4.4 to 4.7), a cycle at a time."""

    def __init__(self):
        self.x = self.v = self.sv = self.a = self.j = self.jj = self.target = 0
        self.has_target = False
        self.regs = [0] * 8  # values X low, X high, V, A, J, JJ, target V, abort A

    def load(self, select):
        """Return the new x, or None."""
        x, (v, a, j, jj, t) = None, (signed(value) for value in self.regs[2:7])
        if select & 1:
            x = self.regs[0]
        if select & 2:
            self.v = self.sv = v
        if select & 4:
            self.a = a
        if select & 8:
            self.j = j
        if select & 16:
            self.jj = jj
        self.has_target = bool(select & 32)
        if self.has_target:
            self.target = t
        return x

    def step(self):
        v, a, t, ahead = self.v, self.a, self.target, signed(self.v + self.a)
        self.sv = v
        if self.has_target and v == t:
            self.v, self.a, self.j, self.jj = t, 0, 0, 0
        elif self.has_target and (v < t < ahead or v > t > ahead):
            self.v, self.a, self.j, self.jj = t, signed(t - v), 0, 0
        else:
            self.v, self.a = ahead, signed(a + self.j)
            self.j = signed(self.j + self.jj)

    def abort_step(self):
        v, q = self.v, signed(self.regs[7])
        self.sv, self.j, self.jj = v, 0, 0
        if v == 0:
            self.v = self.a = 0
        elif v > q:
            self.v, self.a = signed(v - q), signed(-q)
        elif v >= -q:
            self.v, self.a = 0, signed(-v)
        else:
            self.v, self.a = signed(v + q), q

    def move(self, x):
        """Return whether a step is made, and its direction."""
        moved = (self.x + (self.v + self.sv) // 2) % WORD if x is None else x
        stepped = x is None and bool((moved ^ self.x) >> 16 & 1)
        up = self.v + self.sv > 0
        self.x = moved
        return stepped, up


def number(random, even):
    """Return a number of 32 bits, often one where something changes.

    With ``even`` it is a small multiple of one number, so that targets are met exactly.
    """
    if even:
        return random.randrange(-6, 7) * 20_000 % WORD
    return (
        random.choice(
            [
                random.randrange(WORD),
                random.choice([0, 1, -1, 2, -2, 1 << 31, (1 << 31) - 1, (1 << 31) + 1]),
                random.randrange(-3, 4) * 40_000,
                random.randrange(-9, 10) * 3000,
                random.randrange(-300_000, 300_000),
            ]
        )
        % WORD
    )


def each_cycle(seen, port, cycles):
    """Return the levels of an output after each edge."""
    return seen[port][np.searchsorted(seen["cycle"], np.arange(cycles), "right") - 1]


@pytest.fixture(scope="module")
def profile():
    return RtlSimulation(ProfileGenerator())


@pytest.mark.parametrize("seed", range(8))
def test_profiles_follow_the_rules(profile, seed):
    """Loads, steps and writes in any cycle, with numbers that reach every branch."""
    random = Random(seed)
    cycles = 20_000
    model, rows, expected = Profile(), np.zeros(cycles, profile.inputs), []
    aborting = False
    late = None
    slow = random.choice([1, 3, 30])
    for n in range(cycles):
        row = rows[n]
        row["cycle"] = n
        row["aborting"] = aborting
        if late is not None:
            row["write"], row["late_data"] = 1, late
        late = None
        action = random.randrange(4 * slow)
        write = None
        x = None
        if random.randrange(3) == 0:
            write = random.randrange(8), number(random, seed % 2)
            row["data"], row["negated"] = write[1], -write[1] % WORD
            if write[0]:
                row["write"] |= 1 << write[0]
            else:
                late = write[1] & 0xFFFF
        if action == 0:
            select = random.choice([random.randrange(64), 2, 3, 34, 38])
            row["load"], row["select"] = 1, select
            x = model.load(select)
            aborting = False
        elif action <= 2:
            row["step"] = 1
            if aborting:
                model.abort_step()
            else:
                row["done"] = aborting = random.randrange(8) == 0
                model.step()
        expected.append((x, model.v, model.sv))
        if write:
            model.regs[write[0]] = write[1]
    # Positions come from the velocities that each cycle finds.
    mover, strobes, ups = Profile(), [], []
    v = sv = 0
    for x, next_v, next_sv in expected:
        mover.v, mover.sv = v, sv
        stepped, up = mover.move(x)
        strobes.append(stepped)
        ups.append(up)
        v, sv = next_v, next_sv
    profile.reset()
    seen = profile.run(cycles, rows)
    strobes, ups = np.array(strobes), np.array(ups)
    assert each_cycle(seen, "strobe", cycles).tolist() == strobes.astype(int).tolist()
    assert (each_cycle(seen, "up", cycles)[strobes] == ups[strobes]).all()
    assert strobes.sum() > 500


@pytest.fixture(scope="module")
def both_profiles():
    return RtlSimulation(Profiles(2)), RtlSimulation(SharedProfiles(2))


@pytest.mark.parametrize("seed", range(6))
def test_shared_profiles_do_the_same(both_profiles, seed):
    """Writes in any cycle, loads and steps as close together as is allowed."""
    random = Random(seed)
    cycles = 20_000
    events = np.zeros(cycles, both_profiles[0].inputs)
    events["cycle"] = np.arange(cycles)
    aborting = False
    may_load = may_step = 0
    for n, row in enumerate(events):
        row["aborting"] = aborting
        if random.randrange(2):
            row["write"], row["data"] = 1, number(random, seed % 2)
            row["address"] = random.randrange(8, 24)
            if aborting and row["address"] % 8 == 7:
                may_step = max(may_step, n + 15 * 2 + 1)
        if n >= may_load and random.randrange(40) == 0:
            row["load"], row["select"] = 1, random.randrange(1 << 12)
            aborting = False
            may_load, may_step = n + 7 * 2 + 1, n + 22 * 2 + 1
        elif n >= may_step and random.randrange(3) == 0:
            row["step"] = 1
            if not aborting:
                row["done"] = aborting = random.randrange(6) == 0
            may_step = max(may_step, n + 15 * 2 + 1)
    seen = []
    for board in both_profiles:
        rows = np.zeros(cycles, board.inputs)
        for name in events.dtype.names:
            rows[name] = events[name]
        board.reset()
        out = board.run(cycles, rows)
        strobe = each_cycle(out, "strobe", cycles)
        up = each_cycle(out, "up", cycles) & strobe  # of use with a strobe only
        seen.append((strobe.tolist(), up.tolist()))
    assert seen[0] == seen[1]
    assert sum(map(bool, seen[0][0])) > 1000


@pytest.mark.parametrize("seed", range(3))
def test_acceleration_steps_follow_the_rules(seed):
    """Sections 4.2 and 4.3, with limits of a few cycles and loads at any time."""
    random = Random(seed)
    cycles = 20_000
    board = RtlSimulation(AccelerationSteps())
    rows = np.zeros(cycles, board.inputs)
    rows["cycle"] = np.arange(cycles)
    state, dt, steps, dt_limit, steps_limit = "idle", 0, 0, 0, 0
    values = [0, 0]
    expected = {name: [] for name in ("step", "done", "abort", "dt", "steps")}
    seldom = random.choice([5, 40])
    for row in rows:
        if random.randrange(10) == 0:
            values[random.randrange(2)] = random.choice([0, 1, 2, 3, 7, 20])
        row["steps_value"], row["dt_value"] = values
        load = random.randrange(seldom) == 0
        step = done = abort = False
        bits = [random.randrange(2) for _ in range(4)]
        row["load"] = load
        for name, bit in zip(("set_steps", "set_dt", "reset_steps", "reset_dt"), bits, strict=True):
            row[name] = bit
        hit = dt + 1 >= (values[1] if state == "abort" else dt_limit)
        next_dt, next_steps = dt + 1, steps
        next_state = state
        if load:
            next_state = "working"
            next_dt = 0 if bits[3] else next_dt
            next_steps = 0 if bits[2] else steps
        elif state == "working" and dt_limit == 0:
            next_state = "idle"
        elif state == "working" and hit:
            step, done = True, steps + 1 >= steps_limit
            next_state = "wait" if done else state
        elif state in ("wait", "abort"):
            step = hit
            abort = hit or state == "abort"
            next_state = "abort" if hit else state
        if step:
            next_dt, next_steps = 0, steps + 1
        for name, level in (("step", step), ("done", done), ("abort", abort)):
            expected[name].append(int(level))
        expected["dt"].append(next_dt)
        expected["steps"].append(next_steps)
        state, dt, steps = next_state, next_dt, next_steps
        if load and bits[0]:
            steps_limit = values[0]
        if load and bits[1]:
            dt_limit = values[1]
    # Counters are compared after each edge; the others as the edge finds them.
    seen = board.run(cycles, rows)
    assert each_cycle(seen, "dt", cycles).tolist() == expected["dt"]
    assert each_cycle(seen, "steps", cycles).tolist() == expected["steps"]
    assert sum(expected["done"]) > 50
    assert sum(expected["abort"]) > 50


@pytest.mark.parametrize("thresholds", [(0, 0, 0), (1, 2, 3), (5, 5, 9), (4, 9, 6), (3, 12, 20)])
def test_pulses_start_and_end_at_their_thresholds(thresholds):
    """Section 4.8: the formulas, with a strobe in every cycle."""
    pre, pulse, post = thresholds
    board = RtlSimulation(PulseFormer())
    row = np.zeros(1, board.inputs)
    row["strobe"], row["up"] = 1, 1
    row["pre"], row["pulse"], row["post"] = thresholds
    step = each_cycle(board.run(200, row), "step", 200)
    expected = np.zeros(200, int)
    for s in range(0, 200, 1 + max(1, pre, pulse, post)):
        # Cycle n + 1 comes after edge n.
        expected[s + max(pre, 1) : max(s + pulse, s + max(pre, 1))] = 1
    assert step.tolist() == expected.tolist()


def test_pulses_follow_thresholds_that_change():
    random = Random(1)
    cycles = 20_000
    board = RtlSimulation(PulseFormer())
    rows = np.zeros(cycles, board.inputs)
    rows["cycle"] = np.arange(cycles)
    count = step = direction = 0
    now = [2, 5, 9]
    expected = []
    for row in rows:
        if random.randrange(6) == 0:
            now[random.randrange(3)] = random.choice([0, 1, 2, 3, 5, 9, 20, WORD - 1, 1 << 31])
        row["pre"], row["pulse"], row["post"] = now
        row["strobe"], row["up"] = random.randrange(3) == 0, random.randrange(2)
        step = int(count >= 1 and now[0] <= count < now[1])
        if count == 0:
            if row["strobe"]:
                count, direction = 1, int(row["up"])
        else:
            count = count + 1 if count < max(now) else 0
        expected.append((step, direction))
    seen = board.run(cycles, rows)
    assert (
        list(zip(each_cycle(seen, "step", cycles), each_cycle(seen, "dir", cycles), strict=True))
        == expected
    )
    assert sum(level for level, _ in expected) > 1000
