"""The gateware replays recordings of the original controller, pin by pin and clock by clock."""

import json
from pathlib import Path

import numpy as np
import pytest

from pulsewright.boards.pluto_step.gateware import PlutoStep
from pulsewright.gateware.rtl import RtlSimulation

GOLDEN = Path(__file__).parents[1] / "golden" / "pluto_step"

# Packing of the recordings: port, lowest bit, size (see the README beside them).
INPUTS = (
    *(("nwrite", 0, 1), ("ndatastr", 1, 1), ("naddrstr", 2, 1), ("nreset", 3, 1)),
    *(("data_i", 4, 8), ("din", 16, 16)),
)
OUTPUTS = (
    *(("step", 0, 4), ("dir", 4, 4), ("dout", 8, 14), ("led", 22, 1), ("tristate", 23, 1)),
    *(("nwait", 24, 1), ("nconfig", 25, 1), ("data_oe", 26, 1), ("data_o", 27, 8)),
)
HIGH_Z = ("step", "dir", "dout", "led")


@pytest.fixture(scope="module")
def board():
    return RtlSimulation(PlutoStep())


def unpack(data, which, ports, dtype):
    rows = np.zeros(len(data[f"{which}_delta"]), dtype)
    rows["cycle"] = np.cumsum(data[f"{which}_delta"], dtype=np.int64)
    for port, lsb, size in ports:
        rows[port] = data[f"{which}_word"].astype(np.uint64) >> np.uint64(lsb) & np.uint64(
            (1 << size) - 1
        )
    return rows


def as_recorded(rows):
    """Mask what is not driven, and drop rows in which nothing visible changes."""
    rows = rows.copy()
    for port in HIGH_Z:
        rows[port][rows["tristate"] == 1] = 0
    rows["data_o"][rows["data_oe"] == 0] = 0
    pins = [name for name in rows.dtype.names if name != "cycle"]
    changed = np.ones(len(rows), bool)
    changed[1:] = np.any([rows[pin][1:] != rows[pin][:-1] for pin in pins], axis=0)
    return rows[changed]


@pytest.mark.parametrize("path", sorted(GOLDEN.glob("*.npz")), ids=lambda path: path.stem)
def test_every_pin_changes_when_it_did_on_the_original(board, path):
    data = np.load(path)
    cycles = int(json.loads(str(data["meta"]))["n_cycles"])
    board.reset()
    seen = as_recorded(board.run(cycles, unpack(data, "in", INPUTS, board.inputs)))
    recorded = unpack(data, "out", OUTPUTS, board.outputs)
    common = min(len(seen), len(recorded))
    different = np.flatnonzero(seen[:common] != recorded[:common])
    assert not len(different), f"first: {seen[different[0]]}, recorded {recorded[different[0]]}"
    assert len(seen) == len(recorded)
