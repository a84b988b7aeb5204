"""The same job on twin and gateware."""

import pytest

from pulsewright import boards
from pulsewright.app.run import Job
from pulsewright.edges.trace import EdgeTrace

BUS = {"cipo"}  # a twin that sends whole words does not record it
PROGRAM = "M3 S1000\nG1 X0.4 Y-0.2 F1200\nG3 X0 Y0 R0.3\nM5\n"


@pytest.mark.rtl
@pytest.mark.parametrize(
    ("board", "profile"),
    [*((name, None) for name in boards.BOARDS), ("s3g", "robust")],
)
def test_a_job_gives_the_same_trace_on_gateware_and_twin(board, profile, tmp_path):
    path = tmp_path / "part.ngc"
    path.write_text(PROGRAM)
    traces = []
    for link in ("twin:", "rtl:"):
        result = Job.from_gcode(path).run(
            board=board, profile=profile, link=link, out=tmp_path / link
        )
        assert result.passed, result.text()
        traces.append(EdgeTrace.load(tmp_path / link / "trace.npz"))
    twin, rtl = traces
    assert sorted(twin.pins) == sorted(rtl.pins)
    step = boards.get(board).motor_pins[0]
    assert sum(len(twin.edges(step.format(i), 1)) for i in range(4)) > 200
    end = min(twin.end, rtl.end)
    assert end > result.job.duration * twin.clock_hz
    for pin in set(twin.pins) - BUS:
        assert twin.level_at_start(pin) == rtl.level_at_start(pin), pin
        assert twin[pin][twin[pin] < end].tolist() == rtl[pin][rtl[pin] < end].tolist(), pin
