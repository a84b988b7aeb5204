"""Random programs on random machines: every plan keeps its promises, whole, streamed or changed."""

from __future__ import annotations

import itertools
import math
import random

import pytest

from pulsewright.motion.certificate import certify
from pulsewright.motion.gcode import InterpreterSettings, interpret_text
from pulsewright.motion.live import LivePlan
from pulsewright.motion.machine import Machine
from pulsewright.motion.plan import plan
from pulsewright.motion.stream import joined, planned

DEFAULT = Machine.default()
PROGRAMS = 500  # in each part of the campaign


def machine(limits=lambda axis: {}):
    """Return a machine without bounds of travel, and with other limits."""
    axes = {
        letter: axis.model_copy(update={"min": -1e7, "max": 1e7, **limits(axis)})
        for letter, axis in DEFAULT.axis.items()
    }
    return DEFAULT.model_copy(update={"axis": axes})


def moves_of(text, machine):
    return interpret_text(text, settings=InterpreterSettings(axes=machine.axes)).moves


@pytest.mark.parametrize(
    "text",
    [
        # blends of tiny arcs, which take 1e-9 of the long line before them
        "F112 G1 X68.96135 Y117.74545 Z788.11503 A5.4215\n"
        "G17 G3 X68.9613534 Y117.745455 Z788.1150345 I-617.0869628 J-679.4810587\n",
        "F235 G1 X218.11808 Y117.73664 Z-119.40325\n"
        "G17 G3 X218.1180817 Y117.7366399 Z-119.4032516 I-0.2961154 J0.2147335\n",
        "F4295 G0 X-74.27469 Z29.31795 A-6.0992\n"
        "G19 G3 X-74.274689 Y0 Z29.3179533 J-14.4413465 K-66.4467628\n"
        "G17 G2 X-245 Y-280 Z58 I-225 J-55\n",
        # the feed of a line of 0.3 um, along which A turns by 9 degrees
        "F14 G64 P0.0002\nG1 X-3.945 Y-2.736 Z-0.391\nG1 X-3.9448 Y-2.7358 Z-0.3908 A-8.8097\n",
        # far from the start, a tolerance of 0.0001
        "F1147 G1 X16 A-33\nG1 A50\nG64 P0.0001 Q0.0051\nG1 A-43\nG1 X79 A-72\n"
        "G1 X66.50552 A-74.66981\nG1 X66.191 A-57.309\nG1 X59.3 A-64.2\n",
        # a chord of two lines beside a blend that may leave the path more than they
        "F56 G1 X0.8 Y0.3 Z-0.4\nG1 X1 Y0 Z0 A-7\nG64 P0.001 Q0.004\n"
        "G1 X0.7537 Y0.2855 Z-0.4273\nG1 X0.7535 Y0.2855 Z-0.4273\n",
    ],
)
def test_promises_are_kept_where_sizes_are_far_apart(text):
    moves = moves_of("G21 G90 " + text, machine())
    certificate = certify(plan(moves, machine()), moves, machine())
    assert certificate.passed, certificate


def random_machine(r):
    def limits(axis):
        acceleration = 10 ** r.uniform(1.5, 4.3)
        jerk = acceleration * 10 ** r.uniform(0.3, 3)
        return {"velocity": 10 ** r.uniform(0.5, 3), "acceleration": acceleration, "jerk": jerk}

    return machine(limits)


def random_program(r):
    """Return a program of one of many kinds, with sizes over many decades."""
    kind = r.choice([_noise, _curve, _zigzag, _tiny, _rotary, _mixed, _arcs])
    size = 10 ** r.uniform(-2.5, 2)
    lines, state = [f"G21 G90 F{10 ** r.uniform(1, 4.5):.5f}", _tolerance(r)], [0.0] * 4
    for n in range(r.randint(3, 60)):
        chance = r.random()
        if chance < 0.04:
            lines.append(_tolerance(r))
        elif chance < 0.08:
            lines.append(f"F{10 ** r.uniform(0.5, 4.5):.5f}")
        elif chance > 0.98:
            lines.append(f"G4 P{r.uniform(0, 0.3):.4f}")
        scale = size * (10 ** r.uniform(-3, 1) if r.random() < 0.3 else 1)
        lines.append(kind(r, n, scale, state))
    return "\n".join(lines) + "\n"


def _tolerance(r):
    chance = r.random()
    if chance < 0.2:
        return "G61"
    if chance < 0.8:
        return f"G64 P{10 ** r.uniform(-4, 0):.6f}"
    return f"G64 P{10 ** r.uniform(-4, -1):.6f} Q{10 ** r.uniform(-4, -1):.6f}"


def _line(r, state, letters="XYZ"):
    code = "G0" if r.random() < 0.08 else "G1"
    return code + "".join(f" {c}{state['XYZA'.index(c)]:.7f}" for c in letters)


def _noise(r, n, size, state):
    state[0] += size * r.uniform(0.2, 1)
    state[1] = size * r.gauss(0, 0.2)
    return _line(r, state)


def _curve(r, n, size, state):
    state[3] += r.gauss(0, 0.2)  # of the direction, not of the axis
    state[0] += size * math.cos(state[3])
    state[1] += size * math.sin(state[3])
    state[2] += size * r.gauss(0, 0.05)
    return _line(r, state)


def _zigzag(r, n, size, state):
    state[0] += size * r.uniform(0.01, 0.1)
    state[1] = size * (n % 2)
    return _line(r, state)


def _tiny(r, n, size, state):
    state[0] += r.choice([-1, 1]) * 10 ** r.uniform(-7, -1)
    state[1] += r.choice([-1, 0, 1]) * 10 ** r.uniform(-7, 0)
    return _line(r, state)


def _rotary(r, n, size, state):
    state[3] += 5 * size * r.uniform(-1, 1)
    if r.random() < 0.4:
        return _line(r, state, "A")
    state[0] += size * r.gauss(0, 1)
    return _line(r, state, "XA")


def _mixed(r, n, size, state):
    if r.random() < 0.35:
        return _arcs(r, n, size, state)
    state[0] += size * r.gauss(0, 1)
    state[1] += size * r.gauss(0, 1) * r.choice([0, 1])
    state[2] += size * r.gauss(0, 0.3) * r.choice([0, 1])
    if r.random() < 0.1:
        state[3] = r.uniform(-9, 9)
    return _line(r, state, "XYZA")


def _arcs(r, n, size, state):
    plane, axes = r.choice([("G17", "XYZ"), ("G18", "ZXY"), ("G19", "YZX")])
    u, v = size * r.gauss(0, 1) + 0.01, size * r.gauss(0, 1)
    small, large = r.uniform(0.001, 0.1), r.uniform(0.1, 6.2)
    sweep = r.choice([small, large, 2 * math.pi, math.pi / 2]) * r.choice([1, -1])
    cos, sin = math.cos(sweep), math.sin(sweep)
    rise = size * r.gauss(0, 1) if r.random() < 0.3 else 0.0
    for letter, way in zip(axes, (u - u * cos + v * sin, v - u * sin - v * cos, rise), strict=True):
        state["XYZ".index(letter)] += way
    offsets = ["IJK"["XYZ".index(letter)] for letter in axes]
    code = "G3" if sweep > 0 else "G2"
    ends = " ".join(f"{c}{x:.7f}" for c, x in zip("XYZ", state, strict=False))
    return f"{plane} {code} {ends} {offsets[0]}{u:.7f} {offsets[1]}{v:.7f}"


@pytest.mark.campaign
@pytest.mark.parametrize("part", range(6))
def test_every_promise_is_kept_on_any_machine(part):
    for seed in range(part * PROGRAMS, (part + 1) * PROGRAMS):
        r = random.Random(seed)
        limited, text = random_machine(r), random_program(r)
        moves = moves_of(text, limited)
        trajectory = plan(moves, limited)
        certificate = certify(trajectory, moves, limited)
        assert certificate.passed, f"{seed}: {certificate}"
        if r.random() < 0.3:
            cuts = [0, *sorted(r.randint(0, len(moves)) for _ in range(3)), len(moves)]
            parts = [moves.part(a, b) for a, b in itertools.pairwise(cuts) if a < b]
            certificate = certify(joined(planned(parts, limited)), moves, limited)
            assert certificate.passed, f"{seed}, streamed: {certificate}"
        if r.random() < 0.3:
            certificate = _changed(r, LivePlan(trajectory, moves, limited)).certificate()
            assert certificate.passed, f"{seed}, changed: {certificate}"


def _changed(r, live):
    """Hold, resume and override a plan a few times."""
    now, whole = 0.0, live.trajectory.duration
    for _ in range(4):
        now += r.uniform(0, whole / 3)
        if now >= live.trajectory.duration:
            break
        if r.random() < 0.4:
            live.hold(now)
            while not live.at_rest(now):
                now += 0.1
            live.resume(now)
        else:
            live.set_override(10 ** r.uniform(-1, 0.5), now)
    return live
