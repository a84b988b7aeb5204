"""What is compiled ahead is what jobs need, and nobody waits for it or keeps it running."""

import math
import os
import re
import subprocess
import sys
import time

import pytest

from pulsewright import boards, compiled
from pulsewright.app import rehearsal

# kernel: what an index of kept kernels is named after; variant: what its files are
FILE = re.compile(r"(?P<module>\w+)_[0-9a-f]{40}/(?P<kernel>[\w.]+)-\d+\.py\d+\.(?P<variant>\d+)")


def kept(folder):
    """Return the kernels kept in a folder, each with its file per type of arguments."""
    found = [FILE.search(str(path)).groups() for path in folder.glob("*/*.nbc")]
    return {(f"{module}/{kernel}", variant) for module, kernel, variant in found}


def rehearsed(part, environment):
    command = [sys.executable, "-m", "pulsewright.app.rehearsal", part]
    subprocess.run(command, env=environment, check=True)


@pytest.mark.campaign  # compiles all kernels of all boards
def test_kernels_compiled_ahead_are_those_that_jobs_use(tmp_path):
    cache = tmp_path / "cache"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    for part in rehearsal.PLANNER:
        rehearsed(part, environment)
    ahead = {kernel for kernel, _ in kept(cache)}
    assert {"motion/speeds.speeds", "motion/certificate_kernels.worst"} <= ahead
    program = tmp_path / "two.ngc"
    program.write_text("G21 G64 P0.05 F1000\nG1 X10 Y0\nG1 X10 Y10\n")
    for board in boards.BOARDS:
        rehearsed(board, environment)
        before = kept(cache)
        ahead |= {kernel for kernel, _ in before}
        assert any(kernel.startswith(f"{board}/twin_kernel.") for kernel in ahead)
        assert {f"{board}/commands_kernel.convert", "verify/kernels.follow"} <= ahead
        command = [sys.executable, "-m", "pulsewright", "run", str(program), "--board", board]
        subprocess.run([*command, "--out", str(tmp_path / board)], env=environment, check=True)
        again = {kernel for kernel, _ in kept(cache) - before if kernel in ahead}
        assert not again, "compiled ahead for other types than those of a job"


@pytest.mark.parametrize("part", [*rehearsal.PLANNER, *boards.BOARDS])
def test_every_part_can_be_done(part):
    rehearsal.rehearse(part)  # in another process nobody would see that it fails


def needed_kernel(module):
    """Return a kernel that says it is of a module, and was never needed before."""

    def function():
        return 1.0

    function.__module__ = module
    return compiled.Kernel(function, {})


def sleeping(monkeypatch, seconds):
    """Have other processes sleep instead of what they are for; return the list of them."""
    started = []
    start = subprocess.Popen

    def noted(command, **options):
        sleep = f"import time; time.sleep({seconds})"
        started.append(start([sys.executable, "-c", sleep], **options))
        return started[-1]

    monkeypatch.setattr(subprocess, "Popen", noted)
    return started


@pytest.mark.parametrize(("looks", "seconds"), [(4, 600), (math.inf, 1)])
def test_a_kernel_that_another_process_compiles_is_waited_for(monkeypatch, looks, seconds):
    """Until it is ready, or until that process ends without it."""
    started = sleeping(monkeypatch, seconds)
    first, other = needed_kernel("pulsewright.motion.path"), needed_kernel("somewhere.else")
    seen = []

    def kept(kernel):
        seen.append(kernel)
        return len(seen) >= looks

    monkeypatch.setattr(compiled.Kernel, "kept", kept)
    monkeypatch.setattr(rehearsal, "PLANNER", {"speeds": ("other",)})
    monkeypatch.setattr(rehearsal, "_kernel", {"other": other}.get)
    with rehearsal.rehearsed():
        assert first() == 1.0
        assert len(started) == len(seen) == 1  # whether a process is of use
        assert other() == 1.0
        assert len(seen) == looks or started[0].poll() == 0
        assert set(seen) == {other}


def test_other_processes_end_with_the_block_that_they_compile_for(monkeypatch):
    monkeypatch.setattr(compiled.Kernel, "kept", lambda kernel: False)
    started = sleeping(monkeypatch, 600)
    begin = time.monotonic()
    with rehearsal.rehearsed("usc"):
        assert len(started) == 1
        assert needed_kernel("pulsewright.verify.kernels")() == 1.0
        assert len(started) == 1
        for _ in range(2):
            assert needed_kernel("pulsewright.motion.path")() == 1.0
            assert len(started) == 3
        assert all(process.poll() is None for process in started)
    assert all(process.poll() is not None for process in started)
    assert time.monotonic() - begin < 300
