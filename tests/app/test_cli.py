"""The command line as a person meets it: results, errors, exit codes, and what is left on disk."""

import json
import math
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from pulsewright.app import cli
from pulsewright.edges.trace import EdgeTrace

SQUARE = """G21 G90 G61.1 F1200
G1 X5
G2 X10 Y5 R5
G1 Y10 Z-1
G0 X0 Y0 Z0
M2
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def call(folder, monkeypatch, capsys):
    """Run the command line in this process; return exit code, output and errors."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["pulsewright", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        out, err = capsys.readouterr()
        return stop.value.code or 0, out, err

    return run


def write(folder, text, name="part.ngc"):
    path = folder / name
    path.write_text(text)
    return path


def test_a_good_program_passes_and_leaves_its_reports(call, folder):
    code, out, err = call("run", write(folder, SQUARE))
    assert (code, err) == (0, "")
    assert "PASSED" in out
    files = {path.name for path in (folder / "out/part").iterdir()}
    written = {"report.json", "report.html", "path.png", "trace.npz", "certificate.json"}
    assert files == written
    certificate = json.loads((folder / "out/part/certificate.json").read_text())
    assert certificate["passed"]
    assert not certificate["violations"]
    assert 0.5 < certificate["jerk"][0]["ratio"] <= 1
    assert certificate["jerk"][0]["line"] >= 1
    report = json.loads((folder / "out/part/report.json").read_text())
    assert report["passed"] is True
    trace = EdgeTrace.load(folder / "out/part/trace.npz")
    # 320 steps per mm: 10 mm there and back along X and Y, 1 mm along Z
    assert [len(trace.edges(f"step{i}", 1)) for i in range(4)] == [6400, 6400, 640, 0]


def test_json_is_one_object_with_every_check(call, folder):
    code, out, _ = call("run", write(folder, SQUARE), "--json", "--out", folder / "here")
    result = json.loads(out)
    assert code == 0
    assert result["verdict"]["passed"] is True
    assert {"following", "path"} <= {check["name"] for check in result["verdict"]["checks"]}
    assert (folder / "here/path.png").exists()


def test_a_lost_step_fails_the_run_and_the_report_says_so(call, folder, monkeypatch):
    from pulsewright.boards.usc.twin import UscTwin

    drain = UscTwin.drain

    def lossy(self, *args, **kwargs):
        trace = drain(self, *args, **kwargs)
        cycles = list(trace.cycles)
        pin = trace.pins.index("step0")
        if len(cycles[pin]) > 100:  # one whole pulse
            cycles[pin] = np.delete(cycles[pin], [50, 51])
        return EdgeTrace(
            trace.clock_hz, trace.pins, trace.initial, tuple(cycles), trace.start, trace.end
        )

    monkeypatch.setattr(UscTwin, "drain", lossy)
    code, out, _ = call("run", write(folder, SQUARE))
    assert code == 1
    assert "FAILED" in out
    assert json.loads((folder / "out/part/report.json").read_text())["passed"] is False


def test_plan_prints_time_and_certificate(call, folder):
    code, out, _ = call("plan", write(folder, "G1 X60 F600\nM2\n"), "--json")
    result = json.loads(out)
    assert code == 0
    # 60 mm at 10 mm/s: 6 s, and with 20 000 mm/s3 at least 2 sqrt(10 / 20 000) s more
    least = 6 + 2 * math.sqrt(10 / 20_000)
    assert least <= result["duration"] <= least + 0.02


BAD = {
    "unknown word": ("G21\nG1 X1 F100\nG1 X2 ^3\n", r"part\.ngc:3:7: "),
    "unknown code": ("G21 G90\nG1 X5 F100\nG999\n", r"part\.ngc:3:1: "),
    "radius": ("F100\nG2 X10 Y0 I4 J0\n", r"part\.ngc:2.*4.*6"),
    "travel": ("G1 X10 F100\nG1 X9999\n", r"line 2: X reaches 9999 .*axis\.X\.max"),
    # from the bottom of a circle of radius 5 about X399, counterclockwise: over X404
    "arc travel": ("G0 X399\nG3 Y10 J5 F100\n", "line 2: X reaches 404 "),
    "no feed": ("G1 X10\n", r"part\.ngc:1:\d+: .*feed"),
    "feed of zero": ("G1 X10 F0\n", r"part\.ngc:1:\d+: .*feed"),
    "axis": ("G1 V10 F10\n", r"part\.ngc:1:4: .*V"),
    "empty": ("", "part.ngc: "),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_programs_are_errors_with_their_place(case, call, folder):
    text, message = BAD[case]
    code, out, err = call("run", write(folder, text))
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1
    import re

    assert re.search(message, err), err
    assert not (folder / "out").exists()


def test_missing_and_binary_programs_are_errors(call, folder):
    code, _, err = call("run", folder / "none.ngc")
    assert (code, "none.ngc: no such file" in err) == (2, True)
    (folder / "binary.ngc").write_bytes(b"\x7fELF\0\0\1")
    code, _, err = call("run", folder / "binary.ngc")
    assert (code, "not a text file" in err) == (2, True)
    code, _, err = call("run", folder)
    assert (code, "directory" in err) == (2, True)
    assert not (folder / "out").exists()


MACHINE = """name = "test"
[axis.X]
motor = 0
steps_per_mm = {steps}
min = 0
max = 100
velocity = {velocity}
acceleration = 500
"""


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"steps": 20000}, "step/s"),
        ({"velocity": -3}, r"axis\.X\.velocity: -3"),
        ({"steps": '"many"'}, r"axis\.X\.steps_per_mm"),
        ({"velocity": "]"}, "not valid TOML"),
    ],
)
def test_bad_machine_files_are_errors_that_name_the_key(change, message, call, folder):
    text = MACHINE.format(**{"steps": 100, "velocity": 60, **change})
    machine = write(folder, text, "machine.toml")
    code, _, err = call("run", write(folder, "G1 X10 F100\n"), "--machine", machine)
    import re

    assert code == 2
    assert re.search(message, err), err
    assert not (folder / "out").exists()


def test_usage_errors_exit_with_2(call, folder):
    program = write(folder, SQUARE)
    assert call("run")[0] == 2
    assert call("fly")[0] == 2
    assert call("run", program, "--board", "abacus")[0] == 2
    assert call("run", program, "--link", "pigeon:")[0] == 2
    assert call("run", program, "--profile", "none")[0] == 2
    assert call("regs", "usc", "--format", "punchcard")[0] == 2
    assert call("bench", "nothing")[0] == 2
    code, _, err = call("run", program, "--out", program)
    assert (code, "is a file" in err) == (2, True)


@pytest.mark.parametrize("arguments", [("regs", "usc"), ("regs", "no such board")])
def test_signals_do_afterwards_what_they_did_before(call, arguments):
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    call(*arguments)
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_vcd_is_written_when_asked(call, folder):
    assert call("run", write(folder, SQUARE), "--vcd")[0] == 0
    assert "$timescale" in (folder / "out/part/trace.vcd").read_text()[:2000]


@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        ("import pulsewright", {"numpy", "numba", "typer", "pydantic", "matplotlib"}),
        (
            "import sys; from pulsewright.app import cli; sys.argv = ['pulsewright', '--help'];\n"
            "try: cli.main()\nexcept SystemExit: pass",
            {"numpy", "numba", "pydantic", "matplotlib", "rich"},
        ),
    ],
)
def test_starting_loads_nothing_heavy(statement, absent):
    code = f"{statement}\nimport sys; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert not absent & set(loaded)


def opened(pid):
    """Return the names of all files that a process has open."""
    names = []
    for link in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(OSError):  # closed meanwhile
            names.append(str(link.readlink()))
    return names


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_run_that_is_ended_leaves_nothing(folder, number, code):
    """A job of an hour, ended once it has begun to write; the machine stands on its path."""
    path = write(folder, "G21 G90 F600\n" + "G1 X100\nG1 X0\n" * 180 + "M2\n")
    command = [sys.executable, "-c", "from pulsewright.app.cli import main; main()", "run", path]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        until = time.monotonic() + 300
        while not any("/out/part/" in name for name in opened(process.pid)):
            assert process.poll() is None
            assert time.monotonic() < until
            time.sleep(0.01)
        process.send_signal(number)
        _, complaint = process.communicate(timeout=60)
    assert process.returncode == code
    assert "Traceback" not in complaint
    said = complaint.splitlines()
    assert said[0] == f"pulsewright: {'terminated' if code == 143 else 'interrupted'}"
    place = (
        r"stopped within its limits on its path at \d+\.\d{3} s of the plan, line (\d+): X (\S+) Y"
    )
    (found,) = (re.search(place, line) for line in said[1:])
    assert 2 <= int(found[1]) <= 361
    assert 0 <= float(found[2]) <= 100
    assert not (folder / "out").exists()
