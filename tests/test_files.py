"""Files that appear together, or not at all."""

import os
import signal

import pytest

from pulsewright.errors import UsageError
from pulsewright.files import appearing


def names(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def write(folder, texts, error=None):
    with appearing(folder) as temporary:
        for name, text in texts.items():
            (temporary / name).write_text(text)
        if error is not None:
            raise error


def test_files_appear_together(tmp_path):
    with appearing(tmp_path / "new/out") as temporary:
        (temporary / "a").write_text("1")
        (temporary / "b").write_text("2")
        assert not (tmp_path / "new/out/a").exists()
    assert names(tmp_path) == ["new", "new/out", "new/out/a", "new/out/b"]
    assert (tmp_path / "new/out/b").read_text() == "2"


def test_what_was_there_stays_if_not_replaced(tmp_path):
    for name in "ab":
        (tmp_path / name).write_text("old")
    write(tmp_path, {"a": "new"})
    assert [(tmp_path / name).read_text() for name in "ab"] == ["new", "old"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_error_leaves_what_was_there(tmp_path, error):
    (tmp_path / "a").write_text("old")
    for folder in (tmp_path, tmp_path / "new/out"):
        with pytest.raises(error):
            write(folder, {"a": "new"}, error)
    assert names(tmp_path) == ["a"]
    assert (tmp_path / "a").read_text() == "old"


def test_an_interrupt_waits_until_all_are_there(tmp_path, monkeypatch):
    replace = os.replace

    def interrupted(*args, **kwargs):
        signal.raise_signal(signal.SIGINT)
        replace(*args, **kwargs)

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / "out", {"a": "1", "b": "2"})
    assert names(tmp_path) == ["out", "out/a", "out/b"]


@pytest.mark.parametrize("out", ["file", "file/out", "file/new/out"])
def test_a_file_is_no_folder(tmp_path, out):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=f"{tmp_path / 'file'}: is a file; give the name"):
        write(tmp_path / out, {})


def test_a_folder_that_cannot_be_made(tmp_path):
    with pytest.raises(UsageError, match="cannot be written"):
        write(tmp_path / ("x" * 300), {})
