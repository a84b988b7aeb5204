"""EPP: the handshake of `pluto_step.md` 3.2, and of `usc.md` 3.2, for every sequence on the bus."""

import pytest
from amaranth import Const, Module, Signal
from formal_harness import Bench, mutant, prove, prove_by_induction, reach

from pulsewright.boards.pluto_step import gateware as pluto_step
from pulsewright.boards.usc import gateware as usc
from pulsewright.gateware import epp

FAR = 31  # the counter of edges stops here


class HandshakeBench(Bench):
    """The host does whatever it likes with its pins: no sequence hangs the handshake.

    Parameters
    ----------
    port : component
        Anything with an EPP port; its other inputs are free.
    base : int, optional
        Board select bits; then a board that is not selected must keep quiet.
    idle : int
        Level of nWait between cycles.
    """

    def __init__(self, port, *, base=None, idle=1, fixed=()):
        self.port, self.base, self.idle, self.fixed = port, base, idle, fixed
        super().__init__()

    def build(self, m: Module) -> None:
        m.submodules.port = port = self.port
        self.free_inputs(port, but=self.fixed)
        for name in self.fixed:
            m.d.comb += getattr(port, name).eq(1)
        strobe = ~(port.ndatastr & port.naddrstr)
        acknowledged = port.nwait != self.idle

        # How many edges in a row sampled the strobe as it was last sampled.
        active, same = Signal(), Signal(range(FAR + 1), init=FAR)
        with m.If(strobe != active):
            m.d.sync += [active.eq(strobe), same.eq(1)]
        with m.Elif(same < FAR):
            m.d.sync += same.eq(same + 1)
        self.acts = self.past(active & (same == 1))  # in the cycle before A + 2

        selected = Const(1)
        if self.base is not None:
            select = Signal(3)
            with m.If(self.acts & ~port.naddrstr & ~port.nwrite):
                m.d.sync += select.eq(port.data_i[5:])
            selected = select == self.base
        self.always("answers within 5 edges", ~(active & (same >= 5) & selected) | acknowledged)
        self.always("lets go within 5 edges", ~(~active & (same >= 5)) | ~acknowledged)
        self.always("keeps quiet unless selected", selected | ~acknowledged)
        self.always("drives the bus in reads only", ~port.data_oe | port.nwrite & acknowledged)
        byte_held = active & (same > 5) & self.past(port.data_oe) & port.data_oe
        self.always("holds the byte", ~byte_held | (port.data_o == self.past(port.data_o)))
        self.possible("an answer", acknowledged & active)


class PortBench(HandshakeBench):
    """What the port tells the board inside, and its address register."""

    def __init__(self, module=epp):
        super().__init__(module.EppPort())

    def build(self, m: Module) -> None:
        super().build(m)
        port = self.port
        del self.properties["holds the byte"]  # the board's, not the port's
        address = Signal(5)
        with m.If(self.acts & ~port.naddrstr & ~port.nwrite):
            m.d.sync += address.eq(port.data_i)
        with m.Elif(self.acts & port.naddrstr):
            m.d.sync += address.eq(address + 1)
        self.always("acts once per strobe, at its third edge", port.action == self.acts)
        self.always("address register", port.address == address)
        self.always(
            "writes and reads",
            (port.write == (self.acts & ~port.ndatastr & ~port.nwrite))
            & (port.read == (self.acts & port.nwrite)),
        )


BOARDS = {
    "pluto_step exact": lambda: HandshakeBench(pluto_step.PlutoStep("exact")),
    "pluto_step extended": lambda: HandshakeBench(pluto_step.PlutoStep("extended")),
    "usc at base 0": lambda: HandshakeBench(usc.Usc(), base=0, idle=0, fixed=("ninit",)),
    "usc at base 5": lambda: HandshakeBench(usc.Usc(base=5), base=5, idle=0, fixed=("ninit",)),
}


def test_no_bus_sequence_confuses_the_port():
    assert prove(PortBench()).holds


@pytest.mark.campaign
def test_an_smt_solver_agrees_about_the_port():
    assert prove_by_induction(PortBench(), depth=10).holds
    broken = PortBench(mutant(epp, "stages[1] & ~stages[2]", "stages[1] & ~stages[3]"))
    assert not prove_by_induction(broken, depth=10).holds


@pytest.mark.campaign
@pytest.mark.parametrize("board", BOARDS)
def test_no_bus_sequence_hangs_the_handshake_of_a_board(board):
    assert prove(BOARDS[board]()).holds


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        (
            "answers within 5 edges",
            "acknowledge = stages[4]",
            "acknowledge = stages[4] & self.nwrite",
        ),
        ("lets go within 5 edges", "(stages << 1) | ", "(stages << 1) | stages[4:] | "),
        ("drives the bus in reads only", "acknowledge & self.nwrite", "acknowledge"),
        ("acts once per strobe, at its third edge", "stages[1] & ~stages[2]", "stages[1:3].all()"),
        ("address register", "self.action & self.naddrstr", "self.action"),
        (
            "writes and reads",
            "self.action & ~self.ndatastr & ~self.nwrite",
            "self.action & ~self.nwrite",
        ),
    ],
)
def test_every_demand_on_the_port_can_fail(name, old, new):
    assert not prove(PortBench(mutant(epp, old, new)), name, depth=30).holds


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("name", "module", "old", "new"),
    [
        ("keeps quiet unless selected", usc, 'base=switches["base"], ', ""),
        ("holds the byte", usc, "epp.rdata.eq(byte)", "epp.rdata.eq(byte ^ tick)"),
    ],
)
def test_every_demand_on_the_bus_of_a_board_can_fail(name, module, old, new):
    board = mutant(module, old, new).Usc(base=5)
    bench = HandshakeBench(board, base=5, idle=0, fixed=("ninit",))
    assert not prove(bench, name, depth=30).holds


@pytest.mark.campaign
def test_the_host_can_have_an_answer():
    assert reach(PortBench(), "an answer", depth=10).trace
