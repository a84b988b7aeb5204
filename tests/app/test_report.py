import base64
import dataclasses
import html.parser
import json
import math
import re

import numpy as np
import pytest

from pulsewright.app.pictures import path_picture
from pulsewright.app.report import clock_time, write_report
from pulsewright.errors import UsageError
from pulsewright.verify import Check, MotorSummary, PathSample, Verdict

PNG = b"\x89PNG\r\n\x1a\n"
CONTEXT = {
    "program": "no/such/folder/part <1>.ngc",
    "machine": "mill & drill",
    "board": "usc",
    "profile": "document",
    "moves": 2,
    "certificate": {"velocity": [{"ratio": 0.5, "what": "X"}], "passed": True},
    "messages": [],
}


def checks(*, lost=0):
    place = {"time": 0.5, "line": 2, "position": (5.0, 0.0, 0.0)}
    return (
        Check("following", "count against plan", "step", 0.52, 1.1, "most", True, **place),
        Check("path", "distance from path", "mm", 0.0042, 0.0165, "most", True, **place),
        Check("end", "lost steps", "step", float(lost), 0.0, "most", lost == 0, **place),
        Check("feed", "speed", "mm/s", 0.0, math.inf, "most", True),
        Check("timing:width", "pulse width", "us", 3.0, 2.5, "least", True, where="step0"),
        Check("timing:hold", "hold", "us", None, 5.0, "least", True),
    )


def verdict(points=200, *, lost=0, deep=False, rapid=False):
    """A run along X from 0 to 10 mm at 10 mm/s, Z rising with it if ``deep``."""
    t = np.linspace(0, 1, points)
    position = np.zeros((points, 6))
    position[:, 0] = 10 * t
    position[:, 2] = 3 * t * deep
    found = checks(lost=lost)
    return Verdict(
        passed=all(check.passed for check in found),
        checks=found,
        motors=(MotorSummary("step0", 1000, 1000, 0, 0, 1000 - lost, 1000.0, lost, 0.52),),
        edges=2000,
        steps=1000,
        duration=1.0,
        recorded=1.1,
        sample=PathSample(
            time=t,
            position=position,
            speed=np.full(points, 10.0),
            acceleration=np.zeros(points),
            rapid=np.full(points, rapid),
            line=np.full(points, 2, np.int32),
            deviation=np.full((points, 1), 0.52),
            distance=np.zeros(points),
            speed_window=0.01,
            acceleration_window=0.025,
        ),
        histogram={"edges": [-0.525, -0.475, 0.475, 0.525], "counts": [1000, 0, 1000]},
    )


class Page(html.parser.HTMLParser):
    """Checks that tags nest, and keeps text, addresses and table rows."""

    VOID = ("meta", "img", "br", "link")

    def __init__(self, text):
        super().__init__()
        self.open, self.words, self.addresses, self.rows = [], [], [], 0
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.addresses += [v for k, v in attrs if k in ("src", "href", "xlink:href", "data")]
        self.rows += tag == "tr"
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def page(folder):
    return Page((folder / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The folder of a report on a run that passed."""
    folder = tmp_path_factory.mktemp("report")
    assert sorted(write_report(verdict(), CONTEXT, folder)) == sorted(folder.iterdir())
    return folder


def size(png):
    assert png.startswith(PNG)
    return int.from_bytes(png[16:20]), int.from_bytes(png[20:24])


def test_the_folder_holds_three_files_and_nothing_else(written):
    assert sorted(p.name for p in written.iterdir()) == ["path.png", "report.html", "report.json"]


def test_json_has_context_and_every_check_and_no_infinity(written):
    text = (written / "report.json").read_text()
    data = json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert data["passed"] is True
    assert data["machine"] == "mill & drill"
    assert [c["name"] for c in data["verdict"]["checks"]] == [c.name for c in checks()]
    assert data["verdict"]["checks"][1]["worst"] == 0.0042
    assert data["verdict"]["checks"][3]["bound"] is None


def test_the_page_stands_alone(written):
    addresses = page(written).addresses
    outside = [a for a in addresses if not a.startswith(("data:image/png;base64,", "#"))]
    assert outside == []
    assert "url(" not in re.sub(r"url\(#[^)]*\)", "", (written / "report.html").read_text())
    [image] = [a for a in addresses if a.startswith("data:")]
    picture = base64.b64decode(image.split(",")[1])
    assert picture == (written / "path.png").read_bytes()


def test_the_page_says_pass_and_shows_worst_and_bound(written):
    words = page(written).words
    assert "PASS" in words
    assert "FAIL" not in words
    assert "all 6 checks hold on 1,000 recorded steps" in words
    for shown in ("0.0042", "≤ 0.0165", "≥ 2.5", "≤ ∞", "µs", "4.2 µm", "mill & drill"):
        assert shown in " ".join(words)
    assert "part <1>.ngc" in words  # escaped in the source, else it were a tag


def test_the_page_says_fail_and_what_failed_where(tmp_path):
    program = tmp_path / "part.ngc"
    program.write_text("G21\nG1 X10 F600 (cut)\nM2\n")
    write_report(verdict(lost=1), CONTEXT | {"program": str(program)}, tmp_path)
    words = page(tmp_path).words
    assert "FAIL" in words
    assert "1 of 6 checks fail: lost steps (line 2)" in words
    assert "G1 X10 F600 (cut)" in words
    assert json.loads((tmp_path / "report.json").read_text())["passed"] is False


def test_depth_adds_a_second_view(written):
    flat = size((written / "path.png").read_bytes())
    deep = size(path_picture(verdict(deep=True), "part"))
    assert deep[1] == flat[1]
    assert deep[0] > flat[0]


@pytest.mark.parametrize(("points", "rapid"), [(0, False), (1, False), (5000, True)])
def test_empty_short_and_long_runs_can_be_drawn(tmp_path, points, rapid):
    write_report(verdict(points, rapid=rapid), CONTEXT, tmp_path)
    assert (tmp_path / "path.png").read_bytes().startswith(PNG)
    assert (tmp_path / "report.html").stat().st_size < 1_000_000


def test_nothing_is_written_if_a_part_cannot_be_made(tmp_path):
    (tmp_path / "report.json").write_text("older")
    with pytest.raises(TypeError):
        write_report(verdict(), CONTEXT | {"moves": object()}, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["report.json"]
    assert (tmp_path / "report.json").read_text() == "older"
    with pytest.raises(UsageError, match="none: no such folder"):
        write_report(verdict(), CONTEXT, tmp_path / "none")


def test_the_same_run_gives_the_same_files(written, tmp_path):
    for path in write_report(verdict(), CONTEXT, tmp_path):
        assert path.read_bytes() == (written / path.name).read_bytes()


def test_a_check_by_name():
    assert verdict()["path"].bound == 0.0165
    with pytest.raises(KeyError, match="there are following, path, end"):
        verdict()["nothing"]
    assert [c.name for c in verdict(lost=2).failed] == ["end"]
    assert dataclasses.asdict(verdict().motors[0])["lost"] == 0


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, "0.00 s"), (59.99, "59.99 s"), (60.0, "0:01:00.0"), (3723.45, "1:02:03.4")],
)
def test_times_for_people(seconds, text):
    assert clock_time(seconds) == text
