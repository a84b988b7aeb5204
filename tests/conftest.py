"""What several test modules need: the shared data beside the checkout."""

from __future__ import annotations

from pathlib import Path

import pytest

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
