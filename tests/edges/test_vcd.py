from fractions import Fraction

import numpy as np
import pytest

from pulsewright.edges.trace import EdgeTrace
from pulsewright.edges.vcd import timescale, write_vcd
from pulsewright.errors import UsageError


def chunk(step, direction, start, end, initial):
    arrays = (np.array(step, np.int64), np.array(direction, np.int64))
    return EdgeTrace(40_000_000, ("step0", "dir0"), np.array(initial, np.uint8), arrays, start, end)


def read(path):
    """A minimal VCD reader: time unit, {wire: {time: level}}, last time."""
    names, values, now, unit = {}, {}, None, None
    words = path.read_text().split("\n")
    for line in words:
        if line.startswith("$timescale"):
            unit = line.split("$timescale")[1].replace("$end", "").strip()
        elif line.startswith("$var"):
            _, kind, size, code, name, *_ = line.split()
            assert (kind, size) == ("wire", "1")
            names[code] = name
            values[name] = {}
        elif line.startswith("#"):
            now = int(line[1:])
        elif line[:1] in "01" and line:
            values[names[line[1:]]][now] = int(line[0])
    return unit, values, now


@pytest.mark.parametrize(
    ("clock", "scale"),
    [
        (40_000_000, (1, "ns", Fraction(25))),
        (10_000_000, (100, "ns", Fraction(1))),
        (12_500_000, (10, "ns", Fraction(8))),
        (1, (1, "s", Fraction(1))),
        (48_000_000, (1, "ps", Fraction(62500, 3))),
    ],
)
def test_the_time_unit_holds_a_period_exactly_where_one_does(clock, scale):
    assert timescale(clock) == scale


def test_two_chunks_become_one_dump(tmp_path):
    path = tmp_path / "t.vcd"
    first = chunk([10, 14], [4], 2, 20, [0, 0])
    second = chunk([30], [25], 20, 40, [0, 1])
    assert write_vcd(path, [first, second]) == 5
    unit, values, last = read(path)
    assert unit == "1 ns"
    assert values == {
        "step0": {50: 0, 250: 1, 350: 0, 750: 1},
        "dir0": {50: 0, 100: 1, 625: 0},
    }
    assert last == 1000
    assert [p.name for p in tmp_path.iterdir()] == ["t.vcd"]


def test_a_gap_between_chunks_leaves_no_file(tmp_path):
    late = chunk([30], [], 21, 40, [0, 1])
    with pytest.raises(UsageError, match="do not follow"):
        write_vcd(tmp_path / "t.vcd", [chunk([10, 14], [4], 2, 20, [0, 0]), late])
    with pytest.raises(UsageError, match="no trace"):
        write_vcd(tmp_path / "t.vcd", [])
    assert list(tmp_path.iterdir()) == []
