import pytest

from pulsewright.errors import UsageError
from pulsewright.transport.bus import ASAP
from pulsewright.transport.spi_bus import SpiBus, VirtualSpiBus, frame_cycles


class LoopTwin:
    """Answers each byte with its complement; a frame takes 1000 cycles."""

    clock_hz = 1_000_000

    def __init__(self):
        self.now, self.frames, self.scheduled = 0, [], []

    def advance(self, cycle):
        assert cycle >= self.now
        self.now = cycle

    def schedule(self, cycle, pin, level):
        assert cycle > self.now
        self.scheduled.append((cycle, pin, level))

    def level(self, pin):
        return {"buffer_dtr": 1, "move_done": 0}[pin]

    def transfer(self, cycle, data, half):
        assert cycle > self.now
        self.frames.append((cycle, data, half))
        self.now = cycle + 990
        return bytes(0xFF - byte for byte in data), cycle + 1000


class DeafBus(SpiBus):
    """A link without pins, as one over a cable."""

    clock_hz = 1_000_000

    def transfer(self, data, cycle=ASAP):
        return bytes(len(data))

    def now(self):
        return 0

    def sleep(self, seconds):
        pass

    def reset(self):
        raise UsageError("no reset pin")

    def close(self):
        pass


def test_a_frame_takes_its_bits_and_the_pause_behind_it():
    # CS falls; half; 8 bits of two halves each; half; CS high for two halves
    assert frame_cycles(1, half=10) == 10 + 8 * 20 + 10 + 20
    # one byte at half a period of 2: the pause is 6 cycles at least
    assert frame_cycles(1, half=2) == 2 + 8 * 4 + 2 + 6


def test_frames_follow_each_other_as_soon_as_they_may_or_when_they_are_asked_to():
    twin = LoopTwin()
    bus = VirtualSpiBus(twin, half=7)
    assert (bus.clock_hz, bus.now()) == (1_000_000, 0)
    assert bus.transfer(b"\x0f\xf0") == b"\xf0\x0f"
    assert bus.now() == 1001
    bus.transfer(b"a")
    bus.transfer(b"b", cycle=5000)
    bus.transfer(b"c", cycle=5500)
    assert twin.frames == [(1, b"\x0f\xf0", 7), (1001, b"a", 7), (5000, b"b", 7), (6000, b"c", 7)]


def test_the_first_frame_waits_until_the_board_listens():
    twin = LoopTwin()
    bus = VirtualSpiBus(twin, listens=255)
    assert bus.now() == 0
    bus.transfer(b"a")
    bus.transfer(b"b")
    assert [cycle for cycle, _, _ in twin.frames] == [255, 1255]


def test_sleep_begins_when_the_frame_is_done_and_rounds_up():
    twin = LoopTwin()
    bus = VirtualSpiBus(twin)
    bus.transfer(b"a")
    bus.sleep(10.5e-6)
    assert (twin.now, bus.now()) == (1012, 1012)


def test_reset_pulses_the_pin_and_waits_for_the_board():
    twin = LoopTwin()
    bus = VirtualSpiBus(twin, listens=255)
    bus.transfer(b"a")
    bus.reset()
    (fall, low, level_low), (rise, high, level_high) = twin.scheduled
    assert (low, level_low, high, level_high) == ("rst_n", 0, "rst_n", 1)
    assert 1255 < fall < rise
    bus.transfer(b"b")
    assert twin.frames[-1][0] > rise + 255


def test_levels_of_pins_are_those_of_the_twin_and_unknown_elsewhere():
    bus = VirtualSpiBus(LoopTwin())
    assert (bus.level("buffer_dtr"), bus.level("move_done")) == (1, 0)
    assert DeafBus().level("buffer_dtr") is None


@pytest.mark.parametrize("half", [1, 0, -6])
def test_a_clock_that_is_too_fast_is_refused(half):
    with pytest.raises(UsageError, match=f"period of {half} cycles; allowed are 2 or more"):
        VirtualSpiBus(LoopTwin(), half)


def test_an_empty_frame_is_refused():
    with pytest.raises(UsageError, match="without bytes"):
        VirtualSpiBus(LoopTwin()).transfer(b"")


@pytest.mark.parametrize("seconds", [-0.1, float("inf"), float("nan")])
def test_impossible_times_are_refused(seconds):
    with pytest.raises(UsageError, match="allowed are 0 or more"):
        VirtualSpiBus(LoopTwin()).sleep(seconds)


def test_closing_twice_does_no_harm_and_keeps_the_twin():
    bus = VirtualSpiBus(LoopTwin())
    bus.close()
    bus.close()
    assert bus.twin.frames == []
