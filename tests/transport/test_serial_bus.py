import pytest

from pulsewright.errors import BusError, UsageError
from pulsewright.transport.serial_bus import VirtualSerialBus


class LateTwin:
    """Sends byte k at cycle 100 k, and keeps what it is asked."""

    clock_hz = 1_000_000

    def __init__(self, bytes_sent=b""):
        self.now, self.taken, self.lost = 0, 0, False
        self.bytes_sent, self.written, self.asked = bytes_sent, [], []

    def advance(self, cycle):
        self.now = cycle

    def send(self, port, data):
        self.written.append((port, data))

    def receive(self, port, until=None, count=1):
        self.asked.append((port, until, count))
        if self.lost:
            self.lost = False
            raise BusError("lost")
        due = 100 * (self.taken + count - 1)
        if until is not None:
            self.now = max(self.now, min(until, due))
        there = min(self.now // 100 + 1, len(self.bytes_sent))
        data = self.bytes_sent[self.taken : there]
        self.taken = there
        return data


def test_what_is_written_goes_to_the_port_and_takes_no_time():
    twin = LateTwin()
    VirtualSerialBus(twin, port=2).write(b"ab")
    assert (twin.written, twin.now) == ([(2, b"ab")], 0)


def test_a_read_returns_with_the_first_byte_or_with_as_many_as_asked():
    bus = VirtualSerialBus(LateTwin(b"abcdefgh"))
    bus.sleep(0.000_050)
    assert (bus.read(8, 1.0), bus.now()) == (b"a", 50)
    assert (bus.read(8, 1.0), bus.now()) == (b"b", 100)
    assert (bus.read(8, 1.0, min_bytes=4), bus.now()) == (b"cdef", 500)


def test_what_is_above_the_maximum_stays_for_the_next_read():
    bus = VirtualSerialBus(LateTwin(b"abcd"))
    bus.sleep(0.000_300)
    assert bus.read(3, 1.0) == b"abc"
    assert (bus.read(3, 1.0), bus.now()) == (b"d", 300)


def test_a_time_out_is_exact_and_leaves_what_is_there():
    twin = LateTwin(b"abc")
    bus = VirtualSerialBus(twin)
    assert (bus.read(9, 0.000_150_5, min_bytes=9), bus.now()) == (b"ab", 151)
    assert twin.asked == [(1, 151, 9)]
    assert (bus.read(9, 0, min_bytes=1), bus.now()) == (b"", 151)


def test_bytes_left_unread_can_be_forgotten_even_if_some_were_lost():
    twin = LateTwin(b"abcdef")
    bus = VirtualSerialBus(twin)
    bus.sleep(0.000_300)
    assert bus.read(1, 0) == b"a"
    twin.lost = True
    bus.reset_input()
    assert (bus.read(9, 0), bus.read(9, 1.0)) == (b"", b"e")


@pytest.mark.parametrize(("most", "least"), [(0, 0), (0, 1), (3, 4), (3, 0)])
def test_impossible_numbers_of_bytes_are_refused(most, least):
    with pytest.raises(UsageError, match=f"at least {least} and at most {most} bytes"):
        VirtualSerialBus(LateTwin()).read(most, 1.0, min_bytes=least)


@pytest.mark.parametrize("seconds", [-0.1, float("inf"), float("nan")])
def test_impossible_times_are_refused(seconds):
    bus = VirtualSerialBus(LateTwin())
    with pytest.raises(UsageError, match="allowed are 0 or more"):
        bus.read(1, seconds)
    with pytest.raises(UsageError, match="allowed are 0 or more"):
        bus.sleep(seconds)


def test_closing_twice_does_no_harm_and_keeps_the_twin():
    bus = VirtualSerialBus(LateTwin(b"a"))
    bus.close()
    bus.close()
    assert bus.twin.bytes_sent == b"a"
