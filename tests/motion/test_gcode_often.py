"""Lines that set parameters, one by one and as functions: the same results and faults."""

from __future__ import annotations

import random

import pytest

from pulsewright.errors import GcodeError
from pulsewright.motion.gcode import InterpreterSettings, flow, interpret_text, often
from pulsewright.motion.gcode.source import Source


def outcome(text, passes, monkeypatch, **settings):
    """Return moves and messages of a program, or its error, with functions after some passes."""
    monkeypatch.setattr(flow, "OFTEN", passes)
    try:
        program = interpret_text(text, settings=InterpreterSettings(**settings))
    except GcodeError as error:
        return str(error)
    return program.moves.end.tolist(), [event.text for event in program.events]


def same(text, monkeypatch, **settings):
    """Return the outcome, which is the same whenever functions are used."""
    found = [outcome(text, passes, monkeypatch, **settings) for passes in (10**9, 0, 3)]
    assert found[0] == found[1] == found[2], text
    return found[0]


def test_lines_see_what_the_lines_before_have_set(monkeypatch):
    text = """G1 F100
    #<a> = 1 #<b> = 2
    o1 repeat [5]
    #<a> = #<b> #<b> = #<a> (both sides of a line at once)
    #<a> = [#<a> + 10]

    #<b> = [#<b> * 2] #3 = [#<a> - #<b>]
    G1 X#3
    o1 endrepeat
    """
    # a b: 1 2, swapped 2 1, then 12 1, #3 = 11 and b = 2; 2 12, 12 12, 0, 24; 24 12, 34 12, 22, 24;
    # 24 34, 34 34, 0, 68; 68 34, 78 34, 44
    ends, _ = same(text, monkeypatch)
    assert [end[0] for end in ends] == [11, 0, 22, 0, 44]


@pytest.mark.parametrize(
    ("before", "line", "message"),
    [
        ("#1 = 3", "#1 = [#1 - 1]\n#2 = [1 / #1]", "division by zero"),
        ("#1 = 3", "#1 = [#1 - 1]\n#2 = SQRT[#1 - 1]", "no result for -1"),
        ("#1 = 1" + 60 * "0", "#2 = 5\n#1 = [#1 * #1 * #1]", "too large"),
        ("#1 = 1" + 60 * "0", "#1 = [#1 * 10000000000]\n#2 = [1 / [#1 * #1 * #1]]", "too large"),
        ("#1 = 1" + 60 * "0", "#1 = [#1 * 10000000000]\n#2 = EXP[-[#1 * #1 * #1]]", "too large"),
        ("#1 = 1" + 60 * "0", "#1 = [#1 * 10000000000]\n#2 = [1 LT [#1 * #1 * #1]]", "too large"),
        ("#1 = 5", "#2 = 1\n#3 = #<none>", "#<none> has not been set"),
        ("#1 = 5", "#2 = 1\n#5420 = 3", "cannot be set"),
        ("#1 = 5", "#2 = 1\n#1 = = 2", ""),
        ("#1 = 5", "#2 = 1\n#[#1 * 2000] = 3", "#10000 does not exist"),
    ],
)
def test_faults_have_their_place(before, line, message, monkeypatch):
    text = f"{before}\no1 repeat [9]\n{line}\no1 endrepeat\n"
    error = same(text, monkeypatch)
    assert isinstance(error, str)
    assert message in error
    assert f":{2 + len(line.splitlines())}:" in error


def test_lines_count_towards_the_limit(monkeypatch):
    text = "o1 while [1]\n#1 = 1\n\n#2 = 2\n#3 = 3\no1 endwhile\n"
    for limit in range(40, 50):
        error = same(text, monkeypatch, max_lines=limit)
        # the program's own lines are free: 7, with the empty one at the end; 6 are in each round
        assert f":{(limit + 7) % 6 + 1}:" in error


def test_global_and_computed_parameters_and_comments_end_a_run():
    def lines(text):
        run = often.run_from(Source(text.encode(), ""), 0)
        return None if run is None else run.lines

    assert lines("#1 = 2\n#<a> = #1\n\n#3 = [2 ** #<a>]\nG0 X1\n") == 4
    assert lines("#1 = 2\n#<_a> = 3\n") == 1
    assert lines("#1 = #<_line>\n") is None
    assert lines("#1 = ##2\n") is None
    assert lines("#1 = EXISTS[#<a>]\n") is None
    assert lines("#1 = 2\n#2 = 3 (debug, #1)\n") == 1
    assert lines("#1 = 2\n/#2 = 3\n") == 1
    assert lines("/#2 = 3\n") is None


NUMBERS = ("#1", "#2", "#<a>", "#<b>", "2", "-.5", "0", "3.25", "1000000")
INFIX = ("+", "-", "*", "/", "**", "MOD", "EQ", "NE", "GT", "GE", "LT", "LE", "AND", "OR", "XOR")
PREFIX = ("ABS", "ACOS", "ASIN", "COS", "EXP", "FIX", "FUP", "LN", "ROUND", "SIN", "SQRT", "TAN")


def expression(rng, depth):
    kind = rng.random()
    if depth == 0 or kind < 0.2:
        return rng.choice(NUMBERS)
    if kind < 0.35:
        return f"{rng.choice(PREFIX)}[{expression(rng, depth - 1)}]"
    if kind < 0.4:
        return f"[-[{expression(rng, depth - 1)}]]"
    sign = rng.choice(INFIX[:4] if kind < 0.8 else INFIX)
    return f"[{expression(rng, depth - 1)} {sign} {expression(rng, depth - 1)}]"


@pytest.mark.parametrize("seed", range(60))
def test_random_settings_come_out_the_same(seed, monkeypatch):
    rng = random.Random(seed)
    keys = ("#1", "#2", "#<a>", "#<b>")
    lines = [
        " ".join(f"{rng.choice(keys)} = {expression(rng, 3)}" for _ in range(rng.choice((1, 1, 2))))
        for _ in range(rng.randrange(1, 5))
    ]
    text = ["#1 = 1.5 #2 = -2 #<a> = 0.75 #<b> = 3", "o1 repeat [6]", *lines]
    text += ["(debug, #1 #2 #<a> #<b>)", "o1 endrepeat", ""]
    same("\n".join(text), monkeypatch)


@pytest.mark.parametrize("seed", range(40))
def test_random_conditions_and_arguments_come_out_the_same(seed, monkeypatch):
    rng = random.Random(seed)
    first, second, third = (expression(rng, 2) for _ in range(3))
    same(
        f"""o1 sub
        #<a> = #1
        #<b> = #2
        o2 if [{first}]
        (debug, yes #1 #2)
        o2 elseif [#<none> + 1]
        o2 endif
        o1 endsub [{third}]
        #<a> = 1.25 #<b> = -2
        o3 repeat [6]
        o1 call [{second}] [#<_value> / 2] [#<a>]
        #<a> = [#<a> + 1]
        (debug, #1 #2 #<a> #<_value>)
        o3 endrepeat
        """,
        monkeypatch,
    )


def test_a_value_that_is_too_large_is_found_in_a_call(monkeypatch):
    ones = "1" + 60 * "0"
    text = f"""o1 sub
    #<a> = #1
    o1 endsub
    #<a> = {ones}
    o2 repeat [9]
    #<a> = [#<a> * 10000000000]
    o1 call [1 / [#<a> * #<a> * #<a>]] [1]
    o2 endrepeat
    """
    error = same(text, monkeypatch)
    assert "too large" in error
    assert ":7:" in error
