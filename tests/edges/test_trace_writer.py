import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pulsewright.edges.trace import EdgeTrace, concatenate
from pulsewright.edges.writer import TraceWriter, encode
from pulsewright.errors import UsageError

MAX = 0xFFFFFFFF


def trace(*cycles, start=0, end=100, initial=None, pins=None):
    pins = pins or tuple(f"p{i}" for i in range(len(cycles)))
    levels = np.array(initial or [0] * len(cycles), np.uint8)
    return EdgeTrace(
        40_000_000, pins, levels, tuple(np.array(c, np.int64) for c in cycles), start, end
    )


def test_a_file_holds_differences_that_plain_numpy_reads(tmp_path):
    trace([10, 13, 99], [], start=8).save(tmp_path / "t.npz")
    with np.load(tmp_path / "t.npz") as data:
        assert str(data["format"]) == "pulsewright-trace-2"
        assert data["deltas_p0"].tolist() == [2, 3, 86]
        assert data["deltas_p0"].dtype == np.uint32
        assert data["deltas_p1"].tolist() == []
        assert data["span"].tolist() == [8, 100]
        assert data["pins"].tolist() == ["p0", "p1"]


def test_a_gap_that_32_bits_do_not_hold_is_escaped():
    assert encode(np.array([MAX - 1]), 0).tolist() == [MAX - 1]
    assert encode(np.array([MAX]), 0).tolist() == [MAX, 0]
    assert encode(np.array([5, 2 * MAX + 12, 2 * MAX + 13]), 0).tolist() == [5, MAX, MAX, 7, 1]


@given(
    st.lists(
        st.one_of(st.integers(1, 50), st.sampled_from([MAX - 1, MAX, MAX + 1, 3 * MAX + 5])),
        max_size=12,
    ),
    st.integers(0, 12),
    st.integers(0, 1),
)
def test_chunks_come_back_as_one_trace(tmp_path_factory, gaps, cut, level):
    path = tmp_path_factory.mktemp("w") / "t.npz"
    cycles = (np.cumsum(gaps) + 99).astype(np.int64)  # the first may be at `start` itself
    middle = int(cycles[cut]) if cut < len(cycles) else 100
    end = int(cycles[-1]) + 1 if len(cycles) else 101
    left, right = cycles[cycles < middle], cycles[cycles >= middle]
    first = trace(left, start=100, end=middle, initial=[level])
    second = trace(right, start=middle, end=end, initial=[(level + len(left)) % 2])
    with TraceWriter(path, 40_000_000, ("p0",), [level], start=100) as writer:
        writer.append(first)
        writer.append(second)
        assert writer.edges == len(gaps)
    loaded = EdgeTrace.load(path)
    assert loaded["p0"].tolist() == cycles.tolist()
    assert loaded == concatenate([first, second])


def test_an_error_inside_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "t.npz"
    path.write_text("older")
    with pytest.raises(KeyError), TraceWriter(path, 1, ("p0",), [0]):
        raise KeyError
    assert path.read_text() == "older"
    assert [p.name for p in tmp_path.iterdir()] == ["t.npz"]


def test_a_finished_file_leaves_no_spools(tmp_path):
    trace([3]).save(tmp_path / "t.npz")
    assert [p.name for p in tmp_path.iterdir()] == ["t.npz"]
    assert zipfile.ZipFile(tmp_path / "t.npz").testzip() is None


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (trace([150], start=101, end=200), "ends at cycle 100"),
        (trace([150], start=100, end=200, initial=[1]), "p0 changes unrecorded"),
        (trace([150], start=100, end=200, pins=("q",)), "differing: p0, q"),
    ],
)
def test_chunks_that_do_not_follow_each_other_are_refused(tmp_path, second, message):
    def write():
        with TraceWriter(tmp_path / "t.npz", 40_000_000, ("p0",), [0]) as writer:
            writer.append(trace([1, 2]))
            writer.append(second)

    with pytest.raises(UsageError, match=message):
        write()
    assert list(tmp_path.iterdir()) == []


def test_a_closed_writer_takes_nothing(tmp_path):
    writer = TraceWriter(tmp_path / "t.npz", 40_000_000, ("p0",), [0])
    writer.close()
    writer.close()
    with pytest.raises(UsageError, match="closed"):
        writer.append(trace([1]))


def test_a_missing_folder_and_a_file_that_is_no_trace_are_named(tmp_path):
    with pytest.raises(UsageError, match=r"none/t\.npz"):
        trace([1]).save(tmp_path / "none" / "t.npz")
    (tmp_path / "x.npz").write_text("no zip")
    with pytest.raises(UsageError, match=r"x\.npz: not a trace"):
        EdgeTrace.load(tmp_path / "x.npz")
