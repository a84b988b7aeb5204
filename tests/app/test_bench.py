"""The benchmarks run and measure what they say; how fast is no matter here."""

from pulsewright.app import bench
from pulsewright.motion.gcode import interpret


def test_the_twin_benchmark_records_every_edge(monkeypatch):
    monkeypatch.setattr(bench, "TWIN_SECONDS", 1)
    figures = bench.run("twin")
    assert all(figure["value"] > 0 for figure in figures)
    # one second of 4 axes, periods of 199..201 ticks: 200 000 pulses, a rise and a fall each
    edges_per_ratio = figures[2]["value"] * 1e6 / figures[0]["value"]
    assert abs(edges_per_ratio - 400_000) < 4_000
    assert "x real time" in bench.text(figures)


def test_the_surfacing_program_takes_about_the_time_asked(tmp_path):
    path = tmp_path / "surface.ngc"
    bench.surfacing(path, 60.0)
    moves = interpret(path).moves
    length = abs(moves.end[1:-1] - moves.end[:-2])[:, :2].sum()
    assert abs(length / 25.0 - 60.0) < 8.0  # at 25 mm/s, whole rows
