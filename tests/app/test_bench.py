"""The benchmarks run and measure what they say; how fast is no matter here."""

import pytest

from pulsewright.app import bench, bench_links, build
from pulsewright.errors import UsageError
from pulsewright.motion.gcode import interpret


def test_the_twin_benchmark_records_every_edge(monkeypatch):
    monkeypatch.setattr(bench, "TWIN_SECONDS", 1)
    figures = bench.run("twin")
    assert all(figure["value"] > 0 for figure in figures)
    # one second of 4 axes at 50 k step/s, within a percent: 200 000 pulses, a rise and a fall each,
    # and on pluto_step those of axis 0 once more at its LED
    # and on s3g two channels; on rapcores 20, 30, 40 and 50 k step/s
    boards = (
        (figures[:3], 400_000),
        (figures[3:6], 500_000),
        (figures[6:8], 200_000),
        (figures[8:], 280_000),
    )
    for (alone, *_, rate), edges in boards:
        assert abs(rate["value"] * 1e6 / alone["value"] - edges) < 4_000
    assert "x real time" in bench.text(figures)


def test_the_surfacing_program_takes_about_the_time_asked(tmp_path):
    path = tmp_path / "surface.ngc"
    bench.surfacing(path, 60.0)
    moves = interpret(path).moves
    length = abs(moves.end[1:-1] - moves.end[:-2])[:, :2].sum()
    assert abs(length / 25.0 - 60.0) < 8.0  # at 25 mm/s, whole rows


def test_area_writes_the_page_that_it_prints(monkeypatch, tmp_path):
    pytest.importorskip("amaranth")
    monkeypatch.setattr(build, "DESIGNS", build.DESIGNS[:1])
    monkeypatch.setattr(build, "SEEDS", (1,))
    figures = bench.run("area", page=tmp_path / "resources.md")
    luts = [figure["value"] for figure in figures if figure["unit"] == "LUT"]
    lines = (tmp_path / "resources.md").read_text().splitlines()
    rows = [line.split("|") for line in lines if line.startswith("| pluto_step")]
    assert [int(row[3]) for row in rows] == luts
    assert all(0 < lut <= aim for lut, aim in zip(luts, (300, 240), strict=True))


def test_a_page_of_speeds_is_refused(tmp_path):
    with pytest.raises(UsageError, match="bench area"):
        bench.run("twin", page=tmp_path / "page.md")
    with pytest.raises(UsageError, match=r"twin, job, .*area"):
        bench.run("size")


def test_links_are_measured_side_by_side():
    rows = bench_links.round_trips(3)
    assert [row["link"] for row in rows] == [
        *("usc at twin:", "usc at epp+unix:", "usc at epp+tcp:"),
        *("rapcores at twin:", "rapcores at spi+unix:", "rapcores at spi+tcp:"),
        *("s3g at twin:", "s3g at serial:"),
    ]
    for row in rows:
        assert 1e-7 < row["reply"] < 10
        assert 0.1 < row["rate"] < 1e8
