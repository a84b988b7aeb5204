# amaranth: UnusedElaboratable=no
"""Clocks, pin maps, pads and netlists: what a bitstream is made of."""

import re
from pathlib import Path

import pytest
from amaranth import Module
from amaranth.lib import io
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import Component, In, Out
from amaranth.sim import Simulator

from pulsewright.boards.pluto_step.gateware import PlutoStep
from pulsewright.boards.pluto_step.golden import load, replay_on
from pulsewright.boards.usc.gateware import Usc
from pulsewright.errors import UsageError
from pulsewright.gateware import pins, platforms, pll, synth
from pulsewright.gateware.rtl import RtlSimulation
from pulsewright.gateware.top import Pads, Ring

GOLDEN = Path(__file__).parents[1] / "golden" / "pluto_step"
RECORDINGS = sorted(GOLDEN.glob("*.npz"))
SHORT = ("p02_dio", "p04_reversal", "p05_polarity", "p08_addr_wrap")


# Clocks


def test_40_mhz_from_12_takes_120_mhz_and_a_ring_of_three():
    # 40 = 12 x N / Q with an oscillator N x 12 of 533..1066 MHz: only Q = 16, and 640 / 12 is not
    # an integer. With 80 / 12 the same for a ring of two; 120 = 12 x 80 / 8 for three.
    made = pll.solve("ice40", 12_000_000, 40_000_000)
    assert (made.reference, made.multiplier, made.output, made.ring) == (1, 80, 8, 3)
    assert (made.oscillator_hz, made.output_hz) == (960_000_000, 120_000_000)
    assert made.filter_range == 1  # of 10..17 MHz at the phase detector
    assert str(made) == "12 MHz x 80 / 8 / 3 = 40 MHz"


@pytest.mark.parametrize(
    ("crystal", "reference", "multiplier"), [(25_000_000, 5, 8), (48_000_000, 6, 5)]
)
def test_40_mhz_on_an_ecp5(crystal, reference, multiplier):
    made = pll.solve("ecp5", crystal, 40_000_000)
    assert (made.reference, made.multiplier, made.output) == (reference, multiplier, 15)
    assert (made.oscillator_hz, made.clock_hz) == (600_000_000, 40_000_000)


@pytest.mark.parametrize(
    ("crystal", "megahertz", "oscillator", "text"),
    [
        # 16 is 25 x 16 / 25, and with 3.125 MHz at least at the detector not a whole multiple of it
        (25_000_000, 16, 400_000_000, "25 MHz x 16 / 25 = 16 MHz"),
        (48_000_000, 50, 600_000_000, "48 MHz / 2 x 25 / 12 = 50 MHz"),
    ],
)
def test_a_second_output_of_an_ecp5_pll(crystal, megahertz, oscillator, text):
    made = pll.solve("ecp5", crystal, megahertz * 1_000_000)
    assert (made.oscillator_hz, made.clock_hz) == (oscillator, megahertz * 1_000_000)
    assert made.detector_hz * made.multiplier * made.output == oscillator
    assert str(made) == text


@pytest.mark.parametrize(
    ("family", "crystal", "wanted"),
    [("ice40", 12_000_000, 40_000_001), ("ecp5", 25_000_000, 40_000_001)],
)
def test_a_clock_that_cannot_be_exact_is_refused(family, crystal, wanted):
    with pytest.raises(UsageError, match=r"cannot make 40\.000001 MHz exactly"):
        pll.solve(family, crystal, wanted)


@pytest.mark.parametrize("period", [2, 3, 5])
def test_a_ring_is_high_once_per_round(simulate, period):
    clock = simulate(Ring(period), 4 * period)["clock"]
    assert clock.sum() == 4
    assert set(clock.nonzero()[0] % period) == {period - 2}  # the bit enters at edge 0


# Pin maps


@pytest.fixture(scope="module")
def pads():
    return pins.pads(PlutoStep())


def test_pads_are_the_ports_with_their_three_state_ones_joined(pads):
    assert {name: (p.width, p.direction, p.high_z) for name, p in pads.items()} == {
        "nwrite": (1, "i", False),
        "ndatastr": (1, "i", False),
        "naddrstr": (1, "i", False),
        "nreset": (1, "i", False),
        "data": (8, "io", False),
        "data_oe": (1, "o", False),
        "nwait": (1, "o", False),
        "nconfig": (1, "o", False),
        "din": (16, "i", False),
        "step": (4, "o", True),
        "dir": (4, "o", True),
        "dout": (14, "o", True),
        "led": (1, "o", True),
    }


def test_24_pins_take_the_bus_four_axes_and_four_outputs(pads):
    free = [f"p:{n}" for n in range(24)]
    found = pins.default_map(pads, free, None, "x")
    assert found["data"] == tuple(free[:8])
    assert [found[n][0] for n in ("nwrite", "ndatastr", "naddrstr", "nwait")] == free[8:12]
    assert found["step"] == ("p:12", "p:14", "p:16", "p:18")
    assert found["dir"] == ("p:13", "p:15", "p:17", "p:19")
    assert found["dout"] == tuple(free[20:])
    assert pins.left_out(found, pads) == [
        *("nreset", "data_oe", "nconfig", "din[0..15]", "dout[4..13]", "led")
    ]


def test_without_a_number_as_many_axes_as_fit(pads):
    found = pins.default_map(pads, [f"p:{n}" for n in range(19)], None, "x")
    assert pins.axes_of(found, pads) == (0, 1, 2)


def test_encoders_belong_to_their_axis_and_the_estop_chain_to_the_bus():
    usc = pins.pads(Usc())
    found = pins.default_map(usc, [f"p:{n}" for n in range(12 + 1 + 2 * 5)], None, "x")
    assert {name: len(places) for name, places in found.items()} == {
        **dict.fromkeys(("nwrite", "ndatastr", "naddrstr", "nwait", "estop_chain"), 1),
        **dict.fromkeys(("step", "dir", "a", "b", "index"), 2),
        "data": 8,
    }


@pytest.mark.parametrize(
    ("axes", "count", "message"),
    [
        (0, 99, "0 axes asked; the board has 1 to 4"),
        (5, 99, "5 axes asked; the board has 1 to 4"),
        (4, 19, "x has 19 free pins; the bus takes 12 and each axis 2 .step, dir., so at most 3"),
        (None, 13, "at most 0 axes fit, not 1"),
    ],
)
def test_axes_that_cannot_be_are_refused(pads, axes, count, message):
    with pytest.raises(UsageError, match=message):
        pins.default_map(pads, [f"p:{n}" for n in range(count)], axes, "x")


def test_a_map_survives_its_file(pads, tmp_path):
    free = [f"p:{n}" for n in range(99)]
    found = pins.default_map(pads, free, 2, "x")
    found["dout"] = (None, "p:90", None, "p:91")
    path = tmp_path / "pins.toml"
    path.write_text(pins.toml(found, "note"))
    assert pins.load(path, pads, free, "x") == found
    assert "dout[0 2 4 5 6 7 8 9 10 11 12 13]" in pins.left_out(found, pads)


BUS = """
data = ["p:0", "p:1", "p:2", "p:3", "p:4", "p:5", "p:6", "p:7"]
nwrite = "p:8"
ndatastr = "p:9"
naddrstr = "p:10"
nwait = "p:11"
"""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BUS + 'stp = "p:12"', "no pad 'stp'; it has nwrite, ndatastr"),
        (BUS + 'step = "q:12"', r"x has no free pin 'q:12' for step\[0\]; it has p:0 1 2 "),
        (BUS + 'step = "p:8"', r"pin p:8 is given to nwrite and to step\[0\]"),
        (BUS + 'led = ["p:12", "p:13"]', "led is given 2 pins; it has 1 bits"),
        (BUS + "step = 3", "step must be a pin or a list of pins"),
        (BUS, "no axis has its step and dir at pins"),
        (BUS.replace('"p:7"', '"-"'), "data needs 8 pins and has 7; always needed are data, nwr"),
        (BUS.replace('nwait = "p:11"', ""), "nwait needs 1 pins and has 0"),
        ("data = [", "not a TOML file"),
    ],
)
def test_a_file_that_is_no_map_is_refused(pads, tmp_path, text, message):
    path = tmp_path / "pins.toml"
    path.write_text(text)
    with pytest.raises(UsageError, match=message) as caught:
        pins.load(path, pads, [f"p:{n}" for n in range(20)], "x")
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("platform", platforms.PLATFORMS.values(), ids=lambda p: p.name)
def test_every_platform_has_pins_for_pluto_step_and_can_make_its_clock(pads, platform):
    free = platform.pins()
    assert len(set(free.values())) == len(free)
    found = pins.default_map(pads, list(free), None, platform.name)
    assert len(pins.axes_of(found, pads)) >= 3
    assert pll.solve(platform.family, platform.crystal_hz, 40_000_000).clock_hz == 40_000_000


# Pads


class Through(Component):
    """One of each kind of port, joined so that a test sees them from the pins."""

    def __init__(self):
        super().__init__(
            {
                **{"nwrite": In(1), "din": In(2), "estop_chain": In(1), "let_go": In(1)},
                **{"data_i": In(2), "data_o": Out(2), "data_oe": Out(1)},
                **{"nwait": Out(1), "step": Out(2), "dout": Out(5), "tristate": Out(1)},
            }
        )

    def elaborate(self, platform):
        m = Module()
        m.d.comb += [
            self.data_o.eq(0b10),
            self.data_oe.eq(~self.nwrite),
            self.nwait.eq(1),
            self.step.eq(0b01),
            self.dout.eq(self.data_i | self.din << 2 | self.estop_chain << 4),
            self.tristate.eq(self.let_go),
        ]
        return m


class PinsOfSimulation:
    """As much of an Amaranth platform as pads need."""

    def __init__(self):
        self.ports, self.directions = {}, {}

    def add_resources(self, resources):
        for resource in resources:
            self.directions[resource.name, resource.number] = resource.ios[0].dir

    def request(self, name, number, dir):
        port = io.SimulationPort(self.directions[name, number], 1, name=f"{name}{number}")
        self.ports[name.removeprefix("pad_"), number] = port
        return port


def test_pads_drive_and_let_go_as_the_ports_say():
    places = {"let_go": ("p",), "step": (None, "p"), "dout": ("p",) * 5, "data": ("p", "p")}
    platform = PinsOfSimulation()
    places |= {"nwrite": ("p",), "nwait": ("p",), "data_oe": ("p",)}
    design = Pads(Through(), "ice40", places).elaborate(platform)
    port = platform.ports
    seen = []

    async def bench(context):
        for nwrite, let_go in ((1, 0), (0, 0), (1, 1)):
            context.set(port["nwrite", 0].i, nwrite)
            context.set(port["let_go", 0].i, let_go)
            context.set(port["data", 0].i, 1)
            await context.delay(1e-9)
            driven = {
                name: (context.get(p.oe), context.get(p.o))
                for name, p in port.items()
                if (p.direction is not io.Direction.Input)
            }
            seen.append(driven)

    simulator = Simulator(design)
    simulator.add_testbench(bench)
    simulator.run()
    assert ("step", 0) not in port
    reading, writing, expired = seen
    # The bus is driven by data_oe alone; nwait always.
    assert [run["data", 0][0] for run in seen] == [0, 1, 0]
    assert (writing["data", 0], writing["data", 1]) == ((1, 0), (1, 1))
    assert [run["data_oe", 0] for run in seen] == [(1, 0), (1, 1), (1, 0)]
    assert [run["nwait", 0] for run in seen] == [(1, 1)] * 3
    # dout shows the data pin, both open inputs at 1, and the open safety input at 0.
    assert [reading["dout", n] for n in range(5)] == [(1, 1), (1, 0), (1, 1), (1, 1), (1, 0)]
    assert [run["step", 1] for run in (reading, writing)] == [(1, 0)] * 2
    assert [expired["dout", n][0] for n in range(5)] + [expired["step", 1][0]] == [0] * 6


# Netlists


def _replays(family, options, recordings):
    board = PlutoStep()
    simulation = RtlSimulation(board, synth.netlist(board, family, options))
    for path in recordings:
        golden = load(path)
        simulation.reset()
        difference = golden.expected.first_difference(replay_on(simulation, golden))
        assert difference is None, f"{path.stem}: {difference}"


@pytest.mark.rtl
def test_the_netlist_for_the_ice40_replays_the_original():
    _replays("ice40", "", [path for path in RECORDINGS if path.stem in SHORT])


@pytest.mark.rtl
@pytest.mark.campaign
@pytest.mark.parametrize(
    ("family", "options"),
    [("ice40", ""), ("ice40", platforms.get("icebreaker").synthesis), ("ecp5", "")],
)
def test_every_netlist_replays_every_recording_of_the_original(family, options):
    assert len(RECORDINGS) == 9
    _replays(family, options, RECORDINGS)


@pytest.mark.parametrize(
    ("family", "most"),
    [("ice40", 300), pytest.param("ecp5", 240, marks=pytest.mark.campaign)],
)
def test_pluto_step_is_smaller_than_the_original(tmp_path, family, most):
    # The original takes 379 LUTs of the iCE40 and 305 of the ECP5, and 251 flip-flops.
    resources = synth.synthesise(PlutoStep(), family, tmp_path)
    assert 200 < resources.lut <= most
    assert resources.ff >= 4 * (21 + 12 + 3) + 32 + 5  # positions, velocities, latch, address


# Tools


def test_a_missing_tool_says_what_to_install(monkeypatch):
    monkeypatch.delenv("YOSYS", raising=False)
    monkeypatch.setattr(synth, "find_spec", lambda package: None)
    with pytest.raises(UsageError, match=r"yosys is missing; .*pip install 'pulsewright\[build\]'"):
        synth.run_tool("yosys", ["-V"], ".")


def test_a_tool_of_ones_own_that_is_not_there(monkeypatch):
    monkeypatch.setenv("YOSYS", "/nowhere/yosys")
    with pytest.raises(UsageError, match="/nowhere/yosys: cannot be run"):
        synth.run_tool("yosys", ["-V"], ".")


def test_a_tool_that_fails_shows_its_last_words(monkeypatch, tmp_path):
    monkeypatch.setenv("YOSYS", "sh -c 'echo first; echo no such cell >&2; exit 3'")
    with pytest.raises(UsageError, match=r"yosys failed \(exit code 3\):\nfirst\nno such cell"):
        synth.run_tool("yosys", [], tmp_path)


class TwoMemories(Component):
    """Two memories; one of them promises that no word is used that is read as it is written."""

    def __init__(self):
        super().__init__({"address": In(4), "data": In(8), "careful": Out(8), "careless": Out(8)})

    def elaborate(self, platform):
        m = Module()
        for name, attrs in (("careful", {"no_rw_check": 1}), ("careless", {})):
            m.submodules[name] = memory = Memory(shape=8, depth=16, init=[], attrs=attrs)
            written, read = memory.write_port(), memory.read_port()
            m.d.comb += [
                *(written.addr.eq(self.address), written.data.eq(self.data), written.en.eq(1)),
                *(read.addr.eq(self.address), getattr(self, name).eq(read.data)),
            ]
        return m


def test_only_a_memory_that_promises_it_is_read_without_checks():
    design = synth._alone(TwoMemories(), "ice40")
    read = r'cell \$memrd_v2.*?MEMID "\\\\(\w+).*?COLLISION_X_MASK (\S+)'
    assert dict(re.findall(read, design, re.DOTALL)) == {"careful": "1'1", "careless": "1'0"}
