"""Few moves are planned by kernels that nobody compiled, with the same result."""

import math
import random
import subprocess
import sys

import numpy as np
import pytest
from test_plan import random_program
from test_plan_campaign import machine, moves_of, random_machine
from test_plan_campaign import random_program as random_text

from pulsewright import compiled
from pulsewright.motion.certificate import certify
from pulsewright.motion.plan import plan


def in_both_ways(moves, machine, monkeypatch):
    """Return the plan made by Python after that made by compiled kernels."""
    plans = []
    for moves_before in (math.inf, -math.inf):
        monkeypatch.setattr(compiled._seen, "moves", moves_before)
        plans.append(plan(moves, machine))
        assert certify(plans[-1], moves, machine).passed
    return plans


def check_same(one, other):
    for column in ("poly", "cosine", "sine", "omega", "length", "move", "element", "start", "law"):
        assert np.array_equal(getattr(one, column), getattr(other, column)), column


@pytest.mark.parametrize("seed", range(20))
def test_plans_are_the_same_to_the_last_bit(seed, monkeypatch):
    moves = random_program(seed)
    check_same(*in_both_ways(moves, machine(), monkeypatch))


def test_changes_of_a_plan_made_in_python_do_not_wait_for_compiled_kernels():
    code = (
        "import sys;"
        "from pulsewright.motion.gcode import interpret_text;"
        "from pulsewright.motion.live import LivePlan;"
        "from pulsewright.motion.machine import Machine;"
        "from pulsewright.motion.plan import plan;"
        "from pulsewright.motion.stream import Planner;"
        "moves, machine = interpret_text('F600 G1 X30').moves, Machine.default();"
        "live = LivePlan(plan(moves, machine), moves, machine);"
        "live.set_override(0.5, 1.0); live.hold(2.0); live.resume(4.0);"
        "assert live.certificate().passed;"
        "stream = Planner(machine); stream.add(moves); stream.finish();"
        "stream.take(1.0); stream.override(0.5); stream.hold(); stream.take(); stream.resume();"
        "assert stream.take() is not None;"
        "print('numba' in sys.modules)"
    )
    assert not in_new_process(code)


@pytest.mark.campaign
@pytest.mark.parametrize("part", range(4))
def test_plans_of_programs_of_all_sizes_are_the_same(part, monkeypatch):
    for seed in range(100 * part, 100 * (part + 1)):
        r = random.Random(seed)
        limited = random_machine(r)
        moves = moves_of(random_text(r), limited)
        check_same(*in_both_ways(moves, limited, monkeypatch))


def loaded(program, *, before=""):
    """Plan and certify a file in a new process; return whether numba was loaded for it."""
    code = (
        "import sys; from pulsewright.app.planning import plan_file;"
        f"{before} assert plan_file({str(program)!r}).certificate.passed;"
        "print('numba' in sys.modules)"
    )
    return in_new_process(code)


def in_new_process(code):
    """Run code that prints a truth value; return it."""
    command = [sys.executable, "-c", code]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return {"True\n": True, "False\n": False}[output]


def test_compiled_kernels_are_loaded_for_many_moves_only(tmp_path):
    program = tmp_path / "some.ngc"
    corner = "G21 G64 P0.05 F1000\nG1 X10\nG3 X20 Y10 J10\n"
    program.write_text(corner)
    assert not loaded(program)
    assert loaded(program, before="from pulsewright import compiled; compiled.always();")
    program.write_text(corner + "".join(f"G1 X{20 + n % 2} Y{10 + n}\n" for n in range(100)) * 4)
    assert loaded(program)
