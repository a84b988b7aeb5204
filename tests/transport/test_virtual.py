import numpy as np

from pulsewright.transport.bus import read_accesses
from pulsewright.transport.virtual import VirtualEppBus


class CountingTwin:
    clock_hz = 40_000_000
    access_cycles = 60

    def __init__(self):
        self.now = 7
        self.arrays = []

    def transact(self, accesses):
        self.arrays.append(accesses)
        accesses["value"][-1] = 0x41
        accesses["cycle"] = self.now + 60 * np.arange(len(accesses))
        self.now = int(accesses["cycle"][-1])

    def reset(self):
        self.now = 1000


def test_a_read_reaches_the_twin_as_one_array():
    twin = CountingTwin()
    assert VirtualEppBus(twin).read(0x0F, 1) == b"\x41"
    assert [len(array) for array in twin.arrays] == [2]


def test_the_array_itself_is_handed_over_not_a_copy():
    twin, accesses = CountingTwin(), read_accesses(0x0F, 1)
    VirtualEppBus(twin).transact(accesses)
    assert twin.arrays[0] is accesses


def test_time_and_reset_are_those_of_the_twin():
    twin = CountingTwin()
    bus = VirtualEppBus(twin)
    assert (bus.clock_hz, bus.access_cycles, bus.now()) == (40_000_000, 60, 7)
    bus.write(0, b"\0\0")  # accesses act at 7, 67 and 127
    assert bus.now() == 187
    twin.now = 500
    assert bus.now() == 500
    bus.reset()
    assert bus.now() == 1000
    bus.close()
    bus.close()
