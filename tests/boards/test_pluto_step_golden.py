"""The twin replays recordings of the original controller: pins at every clock, and transactions."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pulsewright.boards.pluto_step.golden import RECORDINGS, load
from pulsewright.boards.pluto_step.twin import BOARD_OUTPUTS, PlutoStepTwin
from pulsewright.errors import UsageError
from pulsewright.transport.bus import (
    ADDRESS_READ,
    ADDRESS_WRITE,
    DATA_READ,
    DATA_WRITE,
    EPP_ACCESS,
)

GOLDEN = Path(__file__).parents[1] / "golden" / "pluto_step"
each_recording = pytest.mark.parametrize("path", sorted(GOLDEN.glob("*.npz")), ids=lambda p: p.stem)
OPS = np.array([ADDRESS_WRITE, ADDRESS_READ, DATA_WRITE, DATA_READ], np.uint8)


def test_all_nine_recordings_are_here():
    assert [path.name[:3] for path in sorted(GOLDEN.glob("*.npz"))] == [
        f"p0{n}" for n in range(1, 10)
    ]


@each_recording
def test_every_pin_changes_at_its_cycle(path):
    golden = load(path)
    assert golden.expected.first_difference(RECORDINGS.replay(golden, "twin")) is None
    assert sum(map(len, golden.expected.cycles)) > 80


@each_recording
def test_every_transaction_at_the_pins_has_its_times_and_its_byte(path):
    """The host's record of each bus cycle, against the pins of the twin."""
    trace = RECORDINGS.replay(load(path), "twin")
    txn = np.load(path)["txn"]
    assert trace.edges("nwait", 0).tolist() == txn["wait_low"].tolist()
    assert trace.edges("nwait", 1).tolist() == txn["wait_high"].tolist()
    reads = txn[txn["kind"] % 2 == 1]
    sampled = reads["release_cycle"].astype(np.int64) - 1
    seen = np.zeros(len(reads), np.int64)
    for n in range(8):
        seen |= (np.searchsorted(trace[f"data{n}"], sampled, side="right") & 1) << n
    assert seen.tolist() == reads["value"].tolist()


@each_recording
def test_transactions_in_arrays_do_what_they_do_at_the_pins(path):
    """A write acts at its action edge; a read sees what was there before that edge."""
    golden, txn = load(path), np.load(path)["txn"]
    twin = PlutoStepTwin(access_cycles=10)
    is_input = np.char.startswith(golden.pin, "din")
    # an access after edge n - 1 shall see the inputs that edge n samples
    at = np.maximum(golden.cycle[is_input] - 1, 0)
    twin.schedule(at, golden.pin[is_input], golden.level[is_input])
    accesses = np.zeros(len(txn), EPP_ACCESS)
    read = txn["kind"] % 2 == 1
    accesses["op"] = OPS[txn["kind"]]
    accesses["value"][~read] = txn["value"][~read]
    accesses["cycle"] = txn["assert_cycle"] + 2 - read
    twin.transact(accesses)
    assert accesses["value"].tolist() == txn["value"].tolist()
    twin.advance(golden.expected.end)
    trace = twin.drain()
    for pin in BOARD_OUTPUTS:
        assert trace[pin].tolist() == golden.expected[pin].tolist(), pin


def test_a_difference_is_found_and_named():
    """With another first outputs word, out0 does not come at its cycle."""
    golden = load(GOLDEN / "p02_dio.npz")
    data = golden.level.copy()
    # the first bytes that the host drives are an address (8) and the low byte of the word (1)
    low_byte = np.flatnonzero(golden.pin == "data")[1]
    assert data[low_byte] == 1
    data[low_byte] = 2
    wrong = RECORDINGS.replay(dataclasses.replace(golden, level=data), "twin")
    assert golden.expected.first_difference(wrong).startswith(
        "change 0 of out0 happens at cycle 110"
    )


def test_what_is_no_recording_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"missing\.npz: not a recording of pluto-step"):
        load(tmp_path / "missing.npz")
    np.savez(tmp_path / "other.npz", meta='{"format": "usc-golden-7"}')
    with pytest.raises(UsageError, match="format usc-golden-7, expected pluto-golden-1"):
        load(tmp_path / "other.npz")
    with pytest.raises(UsageError, match="no engine 'fpga'; it has twin, rtl"):
        RECORDINGS.replay(load(GOLDEN / "p02_dio.npz"), "fpga")
