import numpy as np
import pytest

from pulsewright.errors import BusTimeoutError
from pulsewright.transport.bus import (
    ADDRESS_WRITE,
    ASAP,
    DATA_READ,
    DATA_WRITE,
    EPP_ACCESS,
    EppBus,
    read_accesses,
    require_acknowledge,
    write_accesses,
)


class ScriptedBus(EppBus):
    """Answer reads with 0x10, 0x11, ...; leave the accesses in ``unanswered`` unacknowledged."""

    clock_hz = 40_000_000
    access_cycles = 60

    def __init__(self, unanswered=()):
        self.unanswered = list(unanswered)
        self.seen = []

    def transact(self, accesses):
        self.seen.append([(int(a["op"]), int(a["value"])) for a in accesses])
        reads = np.flatnonzero(accesses["op"] == DATA_READ)
        accesses["value"][reads] = 0x10 + np.arange(len(reads))
        accesses["timeout"][self.unanswered] = 1

    def reset(self):
        raise NotImplementedError

    def now(self):
        return 0

    def close(self):
        pass


def test_an_access_is_16_bytes():
    assert EPP_ACCESS.itemsize == 16


def test_write_is_one_address_and_then_data():
    bus = ScriptedBus()
    bus.write(0x13, b"\x8f\x01\x00")
    assert bus.seen == [
        [(ADDRESS_WRITE, 0x13), (DATA_WRITE, 0x8F), (DATA_WRITE, 0x01), (DATA_WRITE, 0x00)]
    ]


def test_read_is_one_address_and_then_reads():
    bus = ScriptedBus()
    assert bus.read(0x0D, 2) == b"\x10\x11"
    assert bus.seen == [[(ADDRESS_WRITE, 0x0D), (DATA_READ, 0), (DATA_READ, 0)]]


def test_accesses_follow_each_other_without_pause():
    assert write_accesses(0x10, [1, 2])["cycle"].tolist() == [ASAP] * 3
    assert read_accesses(0x10, 1)["cycle"].tolist() == [ASAP] * 2


@pytest.mark.parametrize(
    ("call", "name"),
    [(lambda bus: bus.write(0x3F, b"\1\2"), "write"), (lambda bus: bus.read(0x3F, 2), "read")],
)
def test_an_unanswered_access_raises_and_names_its_address(call, name):
    with pytest.raises(BusTimeoutError, match=rf"1 of 3 .*data {name} 2 \(after address write 3Fh"):
        call(ScriptedBus(unanswered=[2]))


def test_the_address_named_is_the_one_in_force():
    accesses = np.concatenate(
        [write_accesses(0x10, [0]), write_accesses(0x2F, [1, 2]), write_accesses(0x04, [0])]
    )
    accesses["timeout"][[3, 6]] = 1
    with pytest.raises(BusTimeoutError, match=r"2 of 7 .*data write 3 \(after address write 2Fh"):
        require_acknowledge(accesses)


def test_acknowledged_accesses_pass():
    require_acknowledge(write_accesses(0x10, [0]))
