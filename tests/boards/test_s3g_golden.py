"""The twin replays recordings of the original controller: every output pin at every clock."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pulsewright.boards.s3g.golden import changes, load, replay
from pulsewright.boards.s3g.twin import S3GTwin
from pulsewright.errors import UsageError

GOLDEN = Path(__file__).parents[1] / "golden" / "s3g"
RECORDINGS = sorted(GOLDEN.glob("*.npz"))
each_recording = pytest.mark.parametrize("path", RECORDINGS, ids=lambda p: p.stem)
MOTION = [path for path in RECORDINGS if len(np.load(path).get("st__dc", ()))]


def test_all_37_recordings_are_here():
    assert len(RECORDINGS) == 37


@each_recording
def test_every_pin_changes_at_its_cycle(path):
    golden = load(path)
    assert golden.expected.first_difference(replay(golden, "twin")) is None
    assert sum(map(len, golden.expected.cycles)) > 400
