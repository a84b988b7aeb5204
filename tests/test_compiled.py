"""Compiled kernels kept on disk are compiled again when what they are made of changes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pulsewright import compiled, jit

CALLER = """
from pulsewright.compiled import compiled
from pulsewright.boards.toy import other
from pulsewright.boards.toy.constants import (
    OFFSET,
)

@compiled()
def value():
    return other.scale(3) + OFFSET
"""
OTHER = """
from pulsewright.compiled import compiled

@compiled()
def scale(x):
    return x * {factor}
"""


@pytest.fixture
def toy(tmp_path):
    """A package with kernels in one file that are made of two other files."""
    root = tmp_path / "pulsewright"
    folder = root / "boards" / "toy"
    folder.mkdir(parents=True)
    for package in (root, root / "boards", folder):
        (package / "__init__.py").touch()
    for module in (compiled, jit):
        (root / Path(module.__file__).name).write_text(Path(module.__file__).read_text())
    (folder / "kernels.py").write_text(CALLER)
    (folder / "other.py").write_text(OTHER.format(factor=2))
    (folder / "constants.py").write_text("OFFSET = 100\n")
    return folder


def value(folder, also="sum(k.value.dispatcher.stats.cache_hits.values())"):
    """Call the kernel in a new process; return its result and whether it came from disk."""
    code = f"from pulsewright.boards.toy import kernels as k; print(k.value(), {also})"
    root = folder.parents[2]
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    output = subprocess.run(
        [sys.executable, "-c", code],
        cwd=root,
        env=environment | {"PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        check=True,
    )
    return tuple(int(word) for word in output.stdout.split())


def test_a_kernel_is_kept_until_a_file_that_it_imports_changes(toy):
    assert value(toy) == (106, 0)
    assert value(toy) == (106, 1)
    (toy / "other.py").write_text(OTHER.format(factor=-20))
    assert value(toy) == (40, 0)
    (toy / "constants.py").write_text("OFFSET = 1000\n")
    assert value(toy) == (940, 0)
    assert value(toy) == (940, 1)


SEVERAL = """
from pulsewright.compiled import compiled

@compiled()
def times(x, n, back):
    return -x * n if back else x * n

@compiled()
def value():
    x, factor = 1.0, 2
    for _ in range(3):
        x = times(x, factor, False)
        factor = 5
    return int(times(x, 3, back=True))
"""


def test_a_kernel_is_compiled_once_for_all_constants(toy):
    (toy / "kernels.py").write_text(SEVERAL)
    assert value(toy, "len(k.times.dispatcher.signatures)") == (-150, 1)
