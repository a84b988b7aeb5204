"""The twin replays recordings of the original controller: every output pin at every clock."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pulsewright.boards.s3g.golden import RECORDINGS, changes, load
from pulsewright.boards.s3g.twin import S3GTwin
from pulsewright.errors import UsageError

GOLDEN = Path(__file__).parents[1] / "golden" / "s3g"
PATHS = sorted(GOLDEN.glob("*.npz"))
each_recording = pytest.mark.parametrize("path", PATHS, ids=lambda p: p.stem)
MOVING = [path for path in PATHS if "st__dc" in np.load(path).files]
ASG_STATES = ["idle", "working", "wait", "abort"]
RESET_FAST_LAST = 54_827  # cycle of that rise
VALID_FAST = 157  # cycles from a start bit to the valid pulse of its byte, at 16 cycles a bit


def started(golden):
    """Return a twin that is given the inputs of a recording."""
    twin = S3GTwin(bus_pins=True, **golden.settings)
    twin.schedule(golden.cycle, golden.pin, golden.level)
    return twin


def test_all_37_recordings_are_here():
    assert len(PATHS) == 37


@each_recording
def test_every_pin_changes_at_its_cycle(path):
    golden = load(path)
    assert golden.expected.first_difference(RECORDINGS.replay(golden, "twin")) is None
    assert sum(map(len, golden.expected.cycles)) > 400


@each_recording
def test_state_inside_is_that_of_every_cycle_in_which_it_changes(path):
    """Ready, interrupts, program and acceleration state: in the cycle of a change and before it."""
    data, twin = np.load(path), started(load(path))
    names = {"ready": "ready", "pend": "pending", "mask": "mask", "be": "be", "asg_state": "asg"}
    lists = {key: changes(data, f"int_{name}") for name, key in names.items()}
    at = np.unique(np.concatenate([cycle for cycle, _ in lists.values()])).tolist()
    for cycle in sorted({c for n in at for c in (n - 1, n) if c > 0}):
        twin.advance(cycle - 1)
        state = twin.state()
        for key, (cycles, values) in lists.items():
            value = int(values[np.searchsorted(cycles, cycle, side="right") - 1])
            expected = ASG_STATES[value] if key == "asg" else value
            assert state[key] == expected, (key, cycle)


@pytest.mark.parametrize("path", MOVING, ids=lambda p: p.stem)
def test_profiles_are_right_after_every_load_and_acceleration_step(path):
    with np.load(path) as file:
        data = {name: file[name].tolist() for name in file.files if name.startswith("st_")}
    twin = started(load(path))
    for row, cycle in enumerate(np.cumsum(data["st__dc"]).tolist()):
        twin.advance(cycle - 1)
        state = twin.state()
        assert (state["dt"], state["steps"]) == (data["st_dt"][row], data["st_steps"][row])
        for c, axis in enumerate("xy"):
            for name in ("x", "v", "a", "j", "jj", "sv"):  # all 64 bits of x, right or wrong
                assert state[name][c] == data[f"st_{axis}_{name}"][row], (cycle, name)


@each_recording
def test_lost_steps_are_counted(path):
    data, golden = np.load(path), load(path)
    twin = started(golden)
    twin.advance(golden.expected.end - 1)  # a recording has them one cycle late
    assert twin.state()["lost"] == [len(changes(data, f"int_miss_{axis}")[0]) for axis in "xy"]


@pytest.mark.parametrize(
    "name", ["proto_basic_fast", "fuzz_11_fast", "proto_basic_std", "motion_std"]
)
def test_a_host_receives_what_is_sent(name):
    golden = load(GOLDEN / f"{name}.npz")
    cycles, sent = changes(np.load(GOLDEN / f"{name}.npz"), "int_tx")
    twin = started(golden)
    twin.advance(golden.expected.end)
    for port, baud in ((1, golden.baud1), (2, golden.baud2)):
        whole = cycles + 9.5 * 50e6 / baud <= golden.expected.end
        assert twin.receive(port) == bytes(sent[whole].astype(np.uint8))


@pytest.mark.parametrize("name", ["proto_basic_fast", "motion_rand_1_fast", "pipeline_drop_fast"])
def test_bytes_do_what_their_waveform_does(name):
    golden, data = load(GOLDEN / f"{name}.npz"), np.load(GOLDEN / f"{name}.npz")
    twin = S3GTwin(bus_pins=True, **golden.settings)
    other = ~np.isin(golden.pin, ("avr_tx", "ext_tx"))
    twin.schedule(golden.cycle[other], golden.pin[other], golden.level[other])
    for port in (1, 2):
        for cycle, byte in zip(*changes(data, f"int_rx{port}"), strict=True):
            twin.send(port, bytes([byte]), int(cycle) - VALID_FAST)
    twin.advance(golden.expected.end)
    assert golden.expected.first_difference(twin.drain()) is None


def test_a_recording_may_be_replayed_in_pieces():
    """Chunks of 997 cycles, each drained: no edge is lost or doubled between them."""
    golden = load(GOLDEN / "motion_rand_3_fast.npz")
    twin = started(golden)
    pieces = []
    for end in [*range(997, golden.expected.end, 997), golden.expected.end]:
        twin.advance(end)
        pieces.append(twin.drain())
    for n, cycles in enumerate(golden.expected.cycles):
        assert np.concatenate([piece.cycles[n] for piece in pieces]).tolist() == cycles.tolist()


def test_a_difference_is_found_and_named():
    """Without the last rise of rst_n, the first answer after it does not come."""
    golden = load(GOLDEN / "reset_fast.npz")
    level = golden.level.copy()
    level[np.flatnonzero(golden.pin == "rst_n")[-1]] = 0
    wrong = RECORDINGS.replay(dataclasses.replace(golden, level=level), "twin")
    falls = golden.expected.edges("avr_rx", 0)
    first = falls[falls > RESET_FAST_LAST][0]
    difference = golden.expected.first_difference(wrong)
    assert f"happens at cycle {first} and never" in difference


def test_what_is_no_recording_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"missing\.npz: not a recording of s3g"):
        load(tmp_path / "missing.npz")
    np.savez(tmp_path / "other.npz", meta="{}")
    with pytest.raises(UsageError, match=r"other\.npz: not a recording of s3g"):
        load(tmp_path / "other.npz")
    with pytest.raises(UsageError, match="no engine 'fpga'; it has twin, rtl"):
        RECORDINGS.replay(load(GOLDEN / "reset_fast.npz"), "fpga")
