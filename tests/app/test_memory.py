"""What becomes of memory that was freed."""

import ctypes
import subprocess
import sys

import pytest

from pulsewright.app.memory import keep_freed_memory

MEGABYTE = 1 << 20
PAGE = 4096


def faults(before: str) -> int:
    """Return how many pages a process has to get for 16 arrays of 4 MB, when it has freed such."""
    code = f"""
import resource
import numpy as np
{before}
for _ in range(3):
    begin = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    arrays = [np.ones({4 * MEGABYTE - 4096}, np.uint8) for _ in range(16)]
    del arrays
    spent = resource.getrusage(resource.RUSAGE_SELF).ru_minflt - begin
print(spent)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return int(run.stdout)


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "mallopt"), reason="this C library cannot be told"
)
def test_memory_that_was_freed_is_used_again():
    pages = 64 * MEGABYTE // PAGE
    kept = faults("from pulsewright.app.memory import keep_freed_memory; keep_freed_memory()")
    assert kept < pages / 100


def test_a_library_that_cannot_be_told_is_left_alone(monkeypatch):
    monkeypatch.setattr(ctypes, "CDLL", lambda name: object())
    keep_freed_memory()
