import html.parser
import json
import subprocess
import sys
from pathlib import Path

import pytest

from pulsewright.app.regs import render
from pulsewright.errors import UsageError
from pulsewright.registers import generate


@pytest.mark.parametrize(("format", "suffix"), [("md", "md"), ("json", "json"), ("c", "h")])
def test_formats_are_the_committed_files(format, suffix):
    committed = generate.CHECKOUT / f"docs/registers/usc.{suffix}"
    assert render("usc", format) + "\n" == committed.read_text(encoding="utf-8")


@pytest.mark.parametrize("columns", ["80", "200"])
def test_the_table_fits_the_terminal_and_says_everything(columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", columns)
    text = render("usc")
    assert max(map(len, text.splitlines())) <= int(columns)
    assert "…" not in text  # nothing is cut off
    words = " ".join(text.split())
    assert "1C Rate generator control" in words
    assert "│ run3 │ dir3 │ run2 │ dir2 │ run1 │ dir1 │ run0 │ dir0 │" in words
    assert "document: ticks = 255 - code" in words
    assert "linuxcnc: ticks = 256 - code" in words
    assert "linuxcnc: period = value + 4 ticks" in words


def test_markdown_rows_have_as_many_cells_as_their_heads():
    width = None
    for line in render("usc", "md").splitlines():
        cells = line.replace("\\|", "").count("|")
        if cells:
            assert cells == (width or cells), line
        width = cells or None
    assert "| load<br>axis 3 | load<br>axis 2 |" in render("usc", "md")


class _Page(html.parser.HTMLParser):
    """Collects what a page refers to, and checks that its tags nest."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.links = [], set(), set()

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        if tag not in ("meta", "br"):
            self.open.append(tag)
        self.ids |= {attributes["id"]} if "id" in attributes else set()
        self.links |= {attributes[name] for name in ("href", "src") if name in attributes}

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_html_is_one_page_whose_links_lead_somewhere():
    page = _Page()
    page.feed(render("usc", "html"))
    assert page.open == []
    assert "w_divisor" in page.ids
    assert page.links == {f"#{name}" for name in page.ids}


def test_json_is_json():
    assert json.loads(render("usc", "json"))["title"] == "Universal Stepper Controller (USC)"


def test_unknown_boards_and_formats_are_answered_with_those_there_are():
    with pytest.raises(UsageError, match="usc"):
        render("ucs")
    with pytest.raises(
        UsageError, match="no format 'pdf'; the formats are table, md, json, c, html"
    ):
        render("usc", "pdf")


def test_every_format_works_without_the_register_compiler():
    program = (
        "import sys; sys.modules['systemrdl'] = None\n"
        "from pulsewright.app.regs import FORMATS, render\n"
        "print(*(len(render('usc', name)) > 5000 for name in FORMATS))\n"
        "print('numba' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=Path("/")
    )
    assert done.stdout.split() == ["True"] * 5 + ["False"]
