"""Bitstreams, Verilog and figures of a board, from the call that the command line makes."""

import json
import re
import shutil
import subprocess
import sys

import pytest

from pulsewright.app import build
from pulsewright.errors import CheckFailedError, UsageError

TOOL = """
import json, sys
from pathlib import Path

words = sys.argv[1:]
with open(LOG, "a") as log:
    print(Path(sys.argv[0]).stem, *words, file=log)
if KIND == "yosys":
    cells = {"SB_LUT4": 7, "SB_DFFER": 5, "SB_DFF": 1, "SB_CARRY": 3, "SB_RAM40_4K": 2, "SB_IO": 9}
    Path("stat.json").write_text(json.dumps({"design": {"num_cells_by_type": cells}}))
elif KIND == "nextpnr":
    seed = int(words[words.index("--seed") + 1])
    clocks = {"$glbnet$board_clock": {"achieved": REACHED[seed - 1], "constraint": 40.0}}
    report = {"fmax": clocks, "utilization": {"A": {"used": 1, "available": 4}, "B": {"used": 0}}}
    Path("report.json").write_text(json.dumps(report))
else:
    Path("top.bin").write_bytes(b"bits")
"""


@pytest.fixture
def tools(monkeypatch, tmp_path):
    """Stand-ins for all tools; ``tools(MHz, ...)`` sets what each placement reaches.

    Returns the words of each call.
    """
    log = tmp_path / "log"
    log.touch()

    def install(*reached):
        for kind, variables in (
            ("yosys", ("YOSYS",)),
            ("nextpnr", ("NEXTPNR_ICE40", "NEXTPNR_ECP5")),
            ("icepack", ("ICEPACK",)),
        ):
            path = tmp_path / f"{kind}.py"
            path.write_text(f"LOG, KIND, REACHED = {str(log)!r}, {kind!r}, {reached!r}\n{TOOL}")
            for variable in variables:
                monkeypatch.setenv(variable, f"{sys.executable} {path}")
        return lambda: [line.split() for line in log.read_text().splitlines()]

    return install


def test_a_build_leaves_bitstream_pins_and_report(tools, tmp_path):
    calls = tools(41.5)
    out = tmp_path / "out"
    stages = []
    result = build.run(
        "pluto_step", "icebreaker", out=out, progress=lambda *stage: stages.append(stage)
    )
    assert [call[0] for call in calls()] == ["yosys", "nextpnr", "icepack"]
    assert sorted(path.name for path in out.iterdir()) == [
        *("pins.toml", "pluto_step-icebreaker.bin", "report.json", "report.txt", "tools")
    ]
    assert (out / "pluto_step-icebreaker.bin").read_bytes() == b"bits"
    assert stages == [("build", 0.0), ("build", 0.4), ("build", 0.95), ("build", 1.0)]

    summary = json.loads((out / "report.json").read_text())
    assert summary == result.summary()
    assert summary["passed"] is True
    assert summary["axes"] == 4
    assert summary["clock_hz"] == 40_000_000
    assert summary["resources"] == {"lut": 7, "ff": 6, "carry": 3, "bram": 2}
    assert summary["clocks"] == [{"net": "board_clock", "goal": 40, "reached": 41.5, "met": True}]
    assert summary["device"] == {"A": [1, 4]}
    # PMOD1A carries the data: its pins 1 to 4 are 4, 2, 47, 45 of the FPGA, 7 to 10 3, 48, 46, 44.
    data = next(row for row in summary["pins"] if row["port"] == "data[0..7]")
    assert data["pins"] == [f"pmod_0:{n}" for n in (1, 2, 3, 4, 7, 8, 9, 10)]
    assert data["fpga"] == ["4", "2", "47", "45", "3", "48", "46", "44"]
    constraints = (out / "tools" / "top.pcf").read_text()
    assert "set_io pad_data_7__io 44" in constraints
    assert "set_frequency board_clock 40.0" in constraints

    text = result.text()
    assert (out / "report.txt").read_text() == text + "\n"
    assert len(text.splitlines()) < 40
    for part in (
        "12 MHz x 80 / 8 / 3 = 40 MHz, exactly",
        "board_clock: 41.5 MHz reached, 40 MHz needed (+4%), placement 1",
        "7 LUT4, 6 FF, 3 carry, 2 block RAM",
        "data[0..7]   io  pmod_0:1 2 3 4 7 8 9 10",
        "no pin    nreset data_oe nconfig din[0..15] dout[4..13] led",
        f"iceprog {out / 'pluto_step-icebreaker.bin'}",
    ):
        assert part in text


def test_placements_are_tried_until_one_is_fast_enough(tools, tmp_path):
    calls = tools(39.9, 38.0, 40.0)
    result = build.run("pluto_step", "hx8k", out=tmp_path / "out")
    assert [call[-1] for call in calls() if call[0] == "nextpnr"] == ["1", "2", "3"]
    assert result.summary()["seed"] == 3


def test_a_missed_clock_is_an_error_and_leaves_no_bitstream(tools, tmp_path):
    calls = tools(*[39.9] * 8)
    out = tmp_path / "out"
    with pytest.raises(CheckFailedError, match=r"timing missed on hx8k: board_clock reaches 39\.9"):
        build.run("pluto_step", "hx8k", out=out)
    assert "icepack" not in {call[0] for call in calls()}
    assert sorted(path.name for path in out.iterdir()) == [
        *("pins.toml", "report.json", "report.txt", "tools")
    ]
    assert "FAILED: too slow" in (out / "report.txt").read_text()
    assert json.loads((out / "report.json").read_text())["passed"] is False


def test_a_failure_takes_away_the_bitstream_of_an_earlier_build(tools, tmp_path):
    tools(50.0)
    result = build.run("pluto_step", "hx8k", out=tmp_path)
    assert result.files[0].exists()
    tools(*[39.9] * 8)
    with pytest.raises(CheckFailedError):
        build.run("pluto_step", "hx8k", out=tmp_path)
    assert not result.files[0].exists()


def test_pins_of_a_build_can_be_changed_and_used_again(tools, tmp_path):
    tools(50.0)
    build.run("pluto_step", "icebreaker", axes=2, out=tmp_path)
    pins = tmp_path / "mine.toml"
    text = (tmp_path / "pins.toml").read_text()
    assert 'step = ["pmod_1:7", "pmod_1:9"]' in text
    pins.write_text(text.replace('"pmod_1:7", "pmod_1:9"', '"pmod_1:9", "pmod_1:7"'))
    result = build.run("pluto_step", "icebreaker", pins=pins, out=tmp_path)
    assert result.axes == 2
    rows = {row[0]: row[2:] for row in result.pins}
    assert rows["step[0..1]"] == (("pmod_1:9", "pmod_1:7"), ("32", "42"))


def test_axes_without_pins_are_left_out_where_the_board_can(tools, tmp_path):
    tools(50.0)
    result = build.run("usc", "icebreaker", out=tmp_path)
    assert result.axes == 2  # 24 pins: 12 of the bus, the estop chain, twice 5
    design = (tmp_path / "tools" / "top.il").read_text()
    assert set(re.findall(r"wire width (\d+) input \d+ +.index\n", design)) == {"2"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"board": "pluto"}, "no board 'pluto'"),
        ({"platform": "de10"}, "no platform 'de10'; the platforms are icebreaker, hx8k, ulx3s"),
        ({"profile": "odd"}, "pluto_step has no profile 'odd'; it has exact, extended"),
        ({"axes": 5}, "5 axes asked; pluto_step has 1 to 4"),
        ({"platform": "orangecrab", "axes": 4}, "at most 3 axes fit, not 4"),
        ({"pins": "x.toml"}, "x.toml: cannot be read"),
        ({"pins": "x.toml", "axes": 1}, "x.toml says which axes are at pins"),
        ({"verilog": True, "platform": "ulx3s"}, "leave out platform and pins"),
        ({"verilog": True, "axes": 3}, "3 axes asked; pluto_step always has 4"),
        ({"verilog": True, "axes": 9}, "9 axes asked; pluto_step has 1 to 4"),
    ],
)
def test_requests_that_cannot_be_met(tmp_path, options, message):
    with pytest.raises(UsageError, match=message):
        build.run(**{"board": "pluto_step", "out": tmp_path / "out"} | options)
    assert not (tmp_path / "out").exists()


def test_verilog_has_the_ports_of_the_board(tmp_path):
    result = build.run("pluto_step", verilog=True, out=tmp_path)
    assert result.files == (tmp_path / "pluto_step.v",)
    text = result.files[0].read_text()
    for declaration in (
        "module pluto_step(",
        "input clk;",
        "input rst;",
        "input [7:0] data_i;",
        "output [7:0] data_o;",
        "output data_oe;",
        "output [3:0] step;",
        "output [13:0] dout;",
    ):
        assert declaration in text
    if compiler := shutil.which("iverilog"):
        subprocess.run([compiler, "-t", "null", result.files[0]], check=True)


def test_area_gives_the_median_clock_of_each_family(tools):
    calls = tools(130.0, 100.0, 120.0)
    rows = build.area(build.DESIGNS[:1], seeds=(1, 2, 3))
    assert [row.family for row in rows] == ["ice40", "ecp5"]
    assert [row.clock_mhz for row in rows] == [120.0, 120.0]
    assert [row.original.lut for row in rows] == [379, 305]
    scripts = [call for call in calls() if call[0] == "yosys"]
    assert "synth_ice40 -top top; write_json design.json" in " ".join(scripts[0])
    page = build.area_page(rows)
    assert (
        "| pluto_step exact, 4 axes | ice40 | 7 | 6 | 3 | 2 | 120.0 | 100.0 .. 130.0 "
        "| 379 LUT, 130.5 MHz | 300 LUT, 130.0 MHz |" in page
    )


def test_a_family_that_is_only_counted_has_no_clock(tools):
    calls = tools(130.0)
    design = next(design for design in build.DESIGNS if list(design.families) == ["xc6s"])
    (row,) = build.area([design], seeds=(1,))
    assert row.clock_mhz is None
    assert [call[0] for call in calls()] == ["yosys"]
    assert "synth_xilinx -family xc6s -top top" in " ".join(calls()[0])
    assert f"| {design.name} | xc6s | 7 | 6 | 3 | 2 | - | - |" in build.area_page([row])


def test_options_of_synthesis_are_named(tools):
    calls = tools(130.0)
    design = next(design for design in build.DESIGNS if design.options)
    (row,) = build.area([design], seeds=(1,))
    assert "synth_ecp5 -nowidelut -top top" in " ".join(calls()[0])
    assert f"| {design.name} | ecp5 |" in build.area_page([row])
    assert design.name.endswith("4 axes, -nowidelut")


ICE40, ECP5 = b"\x7e\xaa\x99\x7e", b"\xff\xff\xbd\xb3"  # how bitstreams begin


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("board", "platform", "preamble", "clock"),
    [
        ("pluto_step", "icebreaker", ICE40, 40.0),
        ("pluto_step", "orangecrab", ECP5, 40.0),
        ("s3g", "hx8k", ICE40, 50.0),
        ("s3g", "ulx3s", ECP5, 50.0),
    ],
)
def test_a_whole_bitstream(tmp_path, board, platform, preamble, clock):
    result = build.run(board, platform, out=tmp_path)
    assert result.passed
    assert preamble in result.files[0].read_bytes()[:2048]
    assert all(made.reached >= made.goal for made in result.implementation.clocks)
    assert clock in {made.goal for made in result.implementation.clocks}


def test_the_serial_port_is_where_the_platform_has_it(tools, tmp_path):
    tools(60.0)
    result = build.run("s3g", "hx8k", out=tmp_path, axes=3)
    wired = {port: pins for port, _, pins, _ in result.pins}
    assert wired["avr_tx"] == ("uart_0:rx",)
    assert wired["avr_rx"] == ("uart_0:tx",)
    assert len(wired["mot_step[0..2]"]) == 3
    assert not any(
        pin.startswith("uart") for port, pins in wired.items() if "avr" not in port for pin in pins
    )
    tools(60.0)
    usc = build.run("usc", "hx8k", out=tmp_path)
    assert not any(pin.startswith("uart") for _, _, pins, _ in usc.pins for pin in pins)


def test_an_s3g_that_cannot_be_built(tools, tmp_path):
    tools(60.0)
    with pytest.raises(UsageError, match="7 axes asked; s3g has 1 to 6"):
        build.run("s3g", "hx8k", out=tmp_path, axes=7)


def test_the_pins_of_rapcores_on_an_icebreaker(tools, tmp_path):
    """Bus, then step, direction and enable of each axis, outputs, HALT, encoders in pairs."""
    tools(60.0)
    result = build.run("rapcores", "icebreaker", out=tmp_path, axes=4)
    wired = {port: pins for port, _, pins, _ in result.pins}
    assert [wired[port] for port in ("cs", "sck", "copi", "cipo")] == [
        (f"pmod_0:{pin}",) for pin in (1, 2, 3, 4)
    ]
    assert [wired[f"{port}[0..3]"][0] for port in ("step", "dir", "en")] == [
        f"pmod_0:{pin}" for pin in (7, 8, 9)
    ]
    assert wired["halt"] == ("pmod_2:3",)
    assert wired["enc_a[0..2]"] == ("pmod_2:4", "pmod_2:8", "pmod_2:10")
    assert wired["enc_b[0..1]"] == ("pmod_2:7", "pmod_2:9")
    assert result.left_out == ("rst_n", "enc_a[3]", "enc_b[2..3]")
    assert str(result.pll) == "12 MHz x 64 / 16 / 3 = 16 MHz"


def test_the_pins_of_rapcores_with_h_bridges(tools, tmp_path):
    """Windings and enable of each axis stand where step, direction and enable are otherwise."""
    tools(60.0)
    made = build.run(
        "rapcores", "icebreaker", out=tmp_path, axes=3, encoders=1, motor_driver="h_bridge"
    )
    wired = {port: pins for port, _, pins, _ in made.pins}
    windings = ("phase_a1", "phase_a2", "phase_b1", "phase_b2")
    assert [wired[f"{port}[0..2]"][0] for port in (*windings, "en")] == [
        f"pmod_0:{pin}" for pin in (7, 8, 9, 10)
    ] + ["pmod_1:1"]
    assert [wired[port] for port in ("halt", "enc_a", "enc_b")] == [
        (f"pmod_2:{pin}",) for pin in (8, 9, 10)
    ]
    assert made.axes == 3
    assert made.left_out == ("rst_n", "step[0..2]", "dir[0..2]")
    larger = build.run("rapcores", "hx8k", out=tmp_path, axes=2, motor_driver="h_bridge")
    assert {"step[0..1]", "dir[0..1]"} <= {port for port, _, _, _ in larger.pins}
    plain = build.run("rapcores", "hx8k", out=tmp_path, axes=2, motor_driver="step_dir")
    assert not any(port.startswith("phase") for port, _, _, _ in plain.pins)


def test_motor_drivers_that_there_are_not(tools, tmp_path):
    tools(60.0)
    with pytest.raises(UsageError, match="'chopper'; there are step_dir and h_bridge"):
        build.run("rapcores", "hx8k", out=tmp_path, motor_driver="chopper")
    with pytest.raises(UsageError, match="h_bridge asked; usc has step and direction"):
        build.run("usc", "hx8k", out=tmp_path, motor_driver="h_bridge")


def test_the_number_of_encoders_is_chosen(tools, tmp_path):
    tools(60.0)
    made = build.run("rapcores", "hx8k", out=tmp_path, axes=2, encoders=5)
    ports = [port for port, _, _, _ in made.pins]
    assert {"enc_a[0..4]", "enc_b[0..4]", "step[0..1]"} <= set(ports)
    with pytest.raises(UsageError, match="5 encoders asked; those of usc are as they are"):
        build.run("usc", "hx8k", out=tmp_path, encoders=5)
