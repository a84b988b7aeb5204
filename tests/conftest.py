"""What several test modules need: the shared data beside the checkout."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import Phase, settings
from hypothesis.internal.conjecture import providers

# The same examples in every run, so that a change is judged by itself; to look for new ones:
# pytest --hypothesis-profile=search
PHASES = (Phase.explicit, Phase.reuse, Phase.generate, Phase.shrink)  # explanations take too long
settings.register_profile("steady", derandomize=True, phases=PHASES)
settings.register_profile("search", derandomize=False, print_blob=True, phases=PHASES)
settings.load_profile("steady")

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"


def _folder(path: Path) -> Path:
    if not path.is_dir():
        pytest.skip(f"no {path.name} data beside the checkout")
    return path


@pytest.fixture(scope="session")
def corpus() -> Path:
    """Real programs; not part of the package."""
    return _folder(SHARED / "ngc" / "corpus")


@pytest.fixture(scope="session")
def conformance() -> Path:
    """Programs with the canonical commands that another interpreter expects of them."""
    return _folder(SHARED / "ngc" / "conformance")


@pytest.fixture(scope="session")
def examples() -> Path:
    """The programs that ship with the package."""
    return ROOT / "examples"


@pytest.fixture(autouse=True, scope="session")
def _state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep accounts of machines whose position is unknown apart from those of the user."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


def pytest_configure() -> None:
    """Let Ctrl-C interrupt, also in the background; keep examples apart from modules loaded.

    A shell lets what it starts in the background ignore Ctrl-C, which tests send. Which modules a
    process has loaded decides whose constants Hypothesis takes. Where these variables say that a
    CI service runs the tests, pytest explains each failed comparison with a whole diff; of two long
    lists, which the faults of mutation tests make differ on purpose, that takes an hour.
    """
    for variable in ("CI", "BUILD_NUMBER"):
        os.environ.pop(variable, None)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if settings.get_current_profile_name() == "steady":
        # hypothesis, whose version is pinned, has no public way to say so
        none = providers.Constants()
        providers._get_local_constants = lambda: none


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what simulates gateware where there is no C++ compiler."""
    if os.environ.get("CXX") or any(map(shutil.which, ("g++", "clang++", "c++"))):
        return
    for item in items:
        if item.get_closest_marker("rtl"):
            item.add_marker(pytest.mark.skip("no C++ compiler (Debian: apt install g++)"))
