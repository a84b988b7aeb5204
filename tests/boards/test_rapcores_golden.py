"""The twin replays recordings of the original: every known output pin at every clock."""

import dataclasses
import gzip
import json
from pathlib import Path

import numpy as np
import pytest

from pulsewright.app.check import check
from pulsewright.boards.rapcores.golden import POSITIONS, RECORDINGS, load
from pulsewright.boards.rapcores.twin import RapcoresTwin
from pulsewright.errors import UsageError

GOLDEN = Path(__file__).parents[1] / "golden" / "rapcores"
PATHS = sorted(GOLDEN.glob("*.jsonl.gz"))
MIN_HALF = 6  # half period of SCK from which on replies are in time


def path_of(name):
    return GOLDEN / f"{name}.jsonl.gz"


def test_all_43_recordings_pass_the_check():
    report = check("rapcores", [GOLDEN])
    assert report.passed, report.text()
    assert len(report.replays) == len(PATHS) == 43
    # README beside the recordings: cycles and words
    first = next(
        replay for replay in report.replays if replay.recording == "head__s05_buffered_chain"
    )
    assert (first.cycles, first.transactions) == (100_910, 64)


def test_positions_of_all_motors_are_compared_where_they_were_recorded():
    golden = load(path_of("headfix__s07_accel"))
    assert len(golden.expected[POSITIONS]) > 3000
    assert POSITIONS not in load(path_of("v020__m07_accel")).expected.pins


def frames(golden):
    """Return CS frames: fall, rise, and the words whose first bit is in them."""
    at = golden.cycle[golden.pin == "cs"].tolist()
    words = [word for message in golden.messages for word in message]
    for fall, rise in zip(at[::2], at[1::2], strict=True):
        yield fall, rise, [word for word in words if fall < word.cycle < rise]


@pytest.mark.parametrize("path", PATHS, ids=lambda p: p.name.partition(".")[0])
def test_words_sent_as_such_get_the_recorded_replies(path):
    """Where a frame has the timing of `transfer`; the others are given to the pins."""
    golden = load(path)
    twin = RapcoresTwin(golden.profile, **golden.switches)
    encoders = np.char.startswith(golden.pin, "enc")
    twin.schedule(golden.cycle[encoders], golden.pin[encoders], golden.level[encoders])
    bus, compared = ~encoders, 0
    for fall, rise, words in frames(golden):
        half = words[0].half if words else 0
        length = 2 * half * 64
        regular = half >= MIN_HALF and all(
            word.cycle == words[0].cycle + n * length and word.half == half
            for n, word in enumerate(words)
        )
        mine = bus & (golden.cycle >= fall) & (golden.cycle <= rise)
        if not regular or np.count_nonzero(mine & (golden.pin == "sck")) != 128 * len(words):
            twin.schedule(golden.cycle[mine], golden.pin[mine], golden.level[mine])
            twin.advance(rise)
            continue
        data = b"".join(word.sent.to_bytes(8, "little") for word in words)
        reply, _ = twin.transfer(max(words[0].cycle - half, twin.now + 1), data, half)
        for n, word in enumerate(words):
            seen = int.from_bytes(reply[8 * n : 8 * n + 8], "little")
            assert seen & ~word.unknown == word.reply & ~word.unknown, hex(word.sent)
            compared += 1
    assert compared > 0 or "s13" in path.name or "s14" in path.name


def test_a_difference_is_found_and_named():
    """Without the last bit of COPI, what it says does not happen."""
    golden = load(path_of("headfix__s02_config_swap"))
    quiet = golden.pin != "copi"
    wrong = dataclasses.replace(
        golden, cycle=golden.cycle[quiet], pin=golden.pin[quiet], level=golden.level[quiet]
    )
    assert "and never" in golden.expected.first_difference(RECORDINGS.replay(wrong, "twin"))
    positions = list(load(path_of("head__s03_single_move")).probe)
    positions[5] = (positions[5][0] + 1, positions[5][1])
    moved = dataclasses.replace(load(path_of("head__s03_single_move")), probe=tuple(positions))
    assert "positions" in moved.expected.first_difference(RECORDINGS.replay(moved, "twin"))


def test_what_is_unknown_is_not_compared():
    """STEP of the original is not driven: that is no recorded level, and ours does not count."""
    golden = load(path_of("head__s04_signed_4axis"))
    assert all(len(golden.expected[f"step{i}"]) == 0 for i in range(4))
    other = dataclasses.replace(golden, switches={"fixed": 1})
    seen = RECORDINGS.replay(other, "twin")
    assert all(len(seen[f"step{i}"]) == 0 for i in range(4))


def test_what_is_no_recording_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"missing\.jsonl\.gz: not a recording of rapcores"):
        load(tmp_path / "missing.jsonl.gz")
    other = tmp_path / "other.jsonl.gz"
    with gzip.open(other, "wt") as file:
        file.write(json.dumps({"format": "else"}) + "\n{}\n")
    with pytest.raises(UsageError, match="format else, expected pulsewright-rapcores-golden/1"):
        load(other)
    with pytest.raises(UsageError, match="no engine 'fpga'; it has twin, rtl"):
        RECORDINGS.replay(load(path_of("head__s01_status_reads")), "fpga")
