"""LinuxCNC's own interpreter as an oracle, where it is installed."""

import fcntl
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest


def require_rs274():
    """Skip the test where ``rs274`` is not installed."""
    if shutil.which("rs274") is None:
        pytest.skip("rs274 of LinuxCNC is not installed")


def rs274(program, folder, *options, timeout=60):
    """Run a program; return the completed process.

    One at a time on a machine: they share memory, and of two at once one may die. ``folder`` is to
    be of this run alone, as offsets and parameters are left there for the next one.
    """
    with (Path(tempfile.gettempdir()) / "pulsewright-rs274.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        done = subprocess.run(
            ["rs274", *options, "-g", str(program)],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )
    assert done.returncode >= 0, f"rs274 was ended by signal {-done.returncode}"
    return done
