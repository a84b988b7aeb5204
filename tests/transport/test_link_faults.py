"""Faults of links do what they say, on each kind of bus, and no more."""

import numpy as np
import pytest

from pulsewright import open_board
from pulsewright.errors import BusError, BusTimeoutError, UsageError
from pulsewright.transport.bus import EppBus, read_accesses, write_accesses
from pulsewright.transport.faults import Fault, Faults, faulty
from pulsewright.transport.serial_bus import SerialBus
from pulsewright.transport.spi_bus import SpiBus


class Memory(EppBus):
    """A bus with 256 bytes, address register and auto-increment; it notes its accesses."""

    clock_hz, access_cycles = 1000, 2

    def __init__(self):
        self.cells, self.at, self.free, self.seen, self.resets = bytearray(256), 0, 0, [], 0

    def transact(self, accesses):
        for row in accesses:
            self.free = max(self.free, int(row["cycle"]))
            row["cycle"], row["timeout"] = self.free, 0
            op, value = chr(row["op"]), int(row["value"])
            self.seen.append((op, value, self.free))
            self.free += self.access_cycles
            if op == "A":
                self.at = value
                continue
            if op == "W":
                self.cells[self.at] = value
            else:
                row["value"] = self.cells[self.at]
            self.at = (self.at + 1) % 256

    def reset(self):
        self.resets += 1

    def now(self):
        return self.free

    def close(self):
        pass


class Shift(SpiBus):
    """A board that answers each byte with the one before, from 0 on."""

    clock_hz = 1_000_000

    def __init__(self):
        self.seen, self.cycle = [], 0

    def transfer(self, data, cycle=-1):
        self.cycle = max(self.cycle, cycle)
        self.seen.append((bytes(data), self.cycle))
        return bytes([0, *data[:-1]])

    def level(self, pin):
        return 1

    def now(self):
        return self.cycle

    def sleep(self, seconds):
        self.cycle += round(seconds * self.clock_hz)

    def reset(self):
        pass

    def close(self):
        pass


class Echo(SerialBus):
    """A board that sends back what it gets, 10 cycles a byte."""

    clock_hz = 1000

    def __init__(self):
        self.cycle, self.line = 0, []

    def write(self, data):
        for byte in data:
            self.line.append((max(self.cycle, self.line[-1][0] if self.line else 0) + 10, byte))

    def read(self, max_bytes, timeout_s, *, min_bytes=1):
        end = self.cycle + round(timeout_s * self.clock_hz)
        if len(self.line) >= min_bytes:
            end = min(end, self.line[min_bytes - 1][0])
        self.cycle = max(self.cycle, end)
        found = [byte for at, byte in self.line if at <= self.cycle][:max_bytes]
        del self.line[: len(found)]
        return bytes(found)

    def sleep(self, seconds):
        self.cycle += round(seconds * self.clock_hz)

    def now(self):
        return self.cycle

    def reset_input(self):
        self.line = [(at, byte) for at, byte in self.line if at > self.cycle]

    def close(self):
        pass


def epp(**fault):
    faults = Faults()
    memory = Memory()
    bus = faulty("epp", memory, faults)
    if fault:
        faults.inject(**fault)
    return bus, memory, faults


# ------------------------------------------------------------------------------------- which units


@pytest.mark.parametrize(
    ("after", "count", "hit"),
    [
        (0, -1, [0, 1, 2, 3, 4, 5]),
        (2, -1, [2, 3, 4, 5]),
        (1, 2, [1, 2]),
        (4, 3, [4, 5]),
        (9, 1, []),
    ],
)
def test_after_so_many_units_so_many_are_hit(after, count, hit):
    """Counting goes on from call to call."""
    for sizes in ([6], [1, 2, 3], [0, 5, 1]):
        fault, found, first = Fault("lose", after=after, count=count), [], 0
        for size in sizes:
            found += [first + n for n in fault.hits(size, None)]
            first += size
        assert found == hit


def test_a_share_is_hit_at_random_and_the_same_again():
    def hit(seed):
        faults = Faults(seed)
        faults.inject("lose", share=0.25, count=400)
        return [n for k in range(10) for n in faults.hits("lose", 1000)]

    first = hit(1)
    assert len(first) == 400
    assert first == hit(1) != hit(2)
    faults = Faults()
    faults.inject("lose", share=0.25)
    assert len(faults.hits("lose", 100_000)) == pytest.approx(25_000, abs=1000)


@pytest.mark.parametrize(
    ("kind", "arguments", "message"),
    [
        ("melt", {}, "'kind' should be one of mute, stuck, lose, .*stall, cut, power, none"),
        ("mute", {"of": "read"}, "fault mute: no argument 'of'; it takes after, count, share"),
        ("flip", {}, "fault flip: 'mask' is missing"),
        ("flip", {"mask": 0}, r"'mask' should be 1..255, not 0"),
        ("flip", {"mask": 256}, r"'mask' should be 1..255, not 256"),
        ("lose", {"of": "both"}, "'of' should be \"read\" or \"write\", not 'both'"),
        ("delay", {}, "fault delay: 'seconds' is missing"),
        ("delay", {"seconds": -1.0}, r"'seconds' should be 0..3600"),
        ("delay", {"seconds": float("nan")}, r"'seconds' should be 0..3600"),
        ("delay", {"seconds": "1"}, "'seconds' should be a number"),
        ("mute", {"count": -2}, "'count' should be -1, for ever, or 0"),
        ("mute", {"count": True}, "'count' should be -1, for ever, or 0"),
        ("mute", {"after": 0.5}, r"'after' should be 0\.\."),
        ("mute", {"share": 0}, "'share' should be above 0"),
        ("stuck", {"level": 2}, "'level' should be 0 or 1"),
        ("cut", {"count": 1}, "fault cut: it takes no argument"),
        ("power", {}, "fault power: it takes on, which is true or false"),
        ("power", {"on": 1}, "fault power: it takes on, which is true or false"),
    ],
)
def test_wrong_faults_are_refused_by_name(kind, arguments, message):
    with pytest.raises(UsageError, match=message):
        Faults().inject(kind, **arguments)


# ------------------------------------------------------------------------------------- EPP


def test_without_faults_nothing_is_changed():
    bus, memory, faults = epp()
    bus.write(0x10, b"\x01\x02\x03")
    assert bus.read(0x11, 2) == b"\x02\x03"
    assert [op for op, _, _ in memory.seen] == ["A", "W", "W", "W", "A", "R", "R"]
    assert bus.now() == 14
    assert faults.hit == 0


def test_mute_keeps_accesses_from_the_board_and_they_time_out():
    bus, memory, _ = epp(kind="mute", after=2)
    accesses = write_accesses(0x10, b"\x01\x02")
    bus.transact(accesses)
    assert accesses["timeout"].tolist() == [0, 0, 1]
    with pytest.raises(BusTimeoutError, match="no board acknowledged 1 of 2"):
        bus.read(0x10, 1)
    assert memory.cells[0x10:0x12] == b"\x01\x00"
    assert len(memory.seen) == 2


def test_with_a_stuck_wait_line_accesses_reach_the_board_and_time_out():
    bus, memory, faults = epp(kind="stuck", count=5)
    with pytest.raises(BusTimeoutError, match="no board acknowledged 1 of 2"):
        bus.write(0x10, b"\x07")
    assert memory.cells[0x10] == 7
    accesses = read_accesses(0x10, 2)
    bus.transact(accesses)
    assert accesses["timeout"].tolist() == [0, 1, 1]
    assert accesses["value"][1:].tolist() == [0xFF, 0xFF]
    assert bus.read(0x10, 1) == b"\x07"
    assert faults.hit == 5


def test_a_lost_access_is_acknowledged_but_the_board_has_not_seen_it():
    bus, memory, _ = epp(kind="lose", after=2, count=1)
    bus.write(0x10, b"\x01\x02\x03")
    assert memory.cells[0x10:0x13] == b"\x01\x03\x00"


def test_a_doubled_access_is_seen_twice():
    bus, memory, _ = epp(kind="double", after=2, count=1)
    bus.write(0x10, b"\x01\x02\x03")
    assert memory.cells[0x10:0x14] == b"\x01\x02\x02\x03"
    bus, memory, _ = epp(kind="double", of="read", count=1)
    memory.cells[:4] = b"\x05\x06\x07\x08"
    assert bus.read(0, 2) == b"\x05\x07"


def test_flipped_bits_arrive_and_the_program_keeps_its_own():
    """Writes: the address is one of them. Reads do not count as writes."""
    bus, memory, _ = epp(kind="flip", mask=0x81, after=1, count=1)
    accesses = write_accesses(0x10, b"\x01\x02")
    bus.transact(accesses)
    assert accesses["value"].tolist() == [0x10, 1, 2]
    assert memory.cells[0x10:0x12] == b"\x80\x02"
    bus, memory, _ = epp(kind="flip", mask=0x81, of="read", after=1, count=1)
    assert bus.read(0x10, 3) == b"\x00\x81\x00"
    assert memory.seen[0][:2] == ("A", 0x10)


def test_delayed_accesses_come_later_and_say_so():
    """Time unit: ms. Asked for 100, and 0.25 s late."""
    bus, memory, _ = epp(kind="delay", seconds=0.25, count=1)
    accesses = write_accesses(0x10, b"\x01")
    accesses["cycle"] = [100, 102]
    bus.transact(accesses)
    assert accesses["cycle"].tolist() == [350, 352]
    bus.write(0x10, b"\x01")
    assert [at for _, _, at in memory.seen] == [350, 352, 354, 356]


def test_a_stalled_host_stands_before_its_next_call():
    """The board goes on meanwhile, for 50 ms at 1 MHz."""
    faults, board = Faults(), Shift()
    bus = faulty("spi", board, faults)
    faults.inject("stall", seconds=0.05, count=2)
    assert bus.now() == 50_000
    bus.transfer(b"\x10")
    bus.transfer(b"\x10")
    assert [at for _, at in board.seen] == [100_000, 100_000]
    faults = Faults()
    driver = open_board("usc", faults=faults)
    faults.inject("stall", seconds=1.0, count=1)
    assert driver.bus.now() == driver.bus.twin.now == 40_000_000


def test_a_cut_link_is_lost_until_all_is_well_again():
    for kind, bus, call in (
        ("epp", Memory(), lambda bus: bus.write(0, b"\x00")),
        ("spi", Shift(), lambda bus: bus.transfer(b"\x00")),
        ("serial", Echo(), lambda bus: bus.read(1, 0.0)),
    ):
        faults = Faults()
        link = faulty(kind, bus, faults)
        faults.inject("cut")
        with pytest.raises(BusError, match=f"{kind} link: cut on purpose"):
            call(link)
        faults.inject("none")
        call(link)


def test_a_reset_does_not_get_through_a_pulled_cable():
    bus, memory, faults = epp(kind="mute")
    bus.reset()
    faults.inject("none")
    bus.reset()
    assert memory.resets == 1


def test_power_is_for_simulated_boards():
    bus, _, _ = epp(kind="power", on=False)
    with pytest.raises(UsageError, match="epp link: fault power is for simulated boards"):
        bus.write(0, b"\x00")


@pytest.mark.parametrize("name", ["usc", "pluto_step", "rapcores", "s3g"])
def test_a_board_without_power_is_silent_and_has_forgotten_everything_then(name):
    faults = Faults()
    board = open_board(name, faults=faults)
    board.initialise()
    before = board.bus.twin.state()
    faults.inject("power", on=False)
    with pytest.raises(BusError):
        board.initialise()
    faults.inject("power", on=True)
    board.identify()
    board.release_estop()
    after = board.bus.twin.state()
    key = {"usc": "width", "pluto_step": "timing", "rapcores": "divider", "s3g": "outputs"}[name]
    reset = {"usc": 0xFE, "pluto_step": 0, "rapcores": 40}
    if name == "s3g":  # register 5: pulse width
        assert before[key][5] > 0 == after[key][5]
    else:
        assert after[key] == reset[name]


# ------------------------------------------------------------------------------------- SPI


def spi(**fault):
    faults, board = Faults(), Shift()
    faults.inject(**fault)
    return faulty("spi", board, faults), board


def test_spi_bytes_are_flipped_both_ways():
    bus, board = spi(kind="flip", mask=0x0F, after=1, count=1)
    assert bus.transfer(b"\x10\x20\x30") == b"\x00\x10\x2f"
    assert board.seen[0][0] == b"\x10\x2f\x30"
    bus, board = spi(kind="flip", mask=0x0F, of="read", after=1, count=1)
    assert bus.transfer(b"\x10\x20\x30") == b"\x00\x1f\x20"
    assert board.seen[0][0] == b"\x10\x20\x30"


def test_a_byte_that_the_board_did_not_see_shifts_its_answer():
    bus, board = spi(kind="lose", after=1, count=1)
    assert bus.transfer(b"\x10\x20\x30") == b"\x00\xff\x10"
    assert board.seen[0][0] == b"\x10\x30"
    bus, board = spi(kind="double", after=1, count=1)
    assert bus.transfer(b"\x10\x20\x30") == b"\x00\x20\x20"
    assert board.seen[0][0] == b"\x10\x20\x20\x30"


def test_a_byte_that_the_host_did_not_see_shifts_the_rest():
    bus, _ = spi(kind="lose", of="read", after=1, count=1)
    assert bus.transfer(b"\x10\x20\x30") == b"\x00\x20\xff"
    bus, _ = spi(kind="double", of="read", after=1, count=1)
    assert bus.transfer(b"\x10\x20\x30") == b"\x00\x10\x10"


def test_a_muted_spi_link_reads_ones_and_takes_its_time():
    """3 bytes: 24 periods of 12 cycles of SCK, 18 between frames, 6 at the ends."""
    bus, board = spi(kind="mute")
    assert bus.transfer(b"\x10\x20\x30") == b"\xff\xff\xff"
    assert board.seen == []
    assert bus.now() == 24 * 12 + 12 + 12


def test_spi_frames_are_delayed_and_pins_stuck():
    bus, board = spi(kind="delay", seconds=0.5, count=1)
    bus.transfer(b"\x10", 100)
    bus.transfer(b"\x11")
    assert [at for _, at in board.seen] == [500_100, 500_100]
    assert bus.level("buffer_dtr") == 1
    bus, _ = spi(kind="stuck", level=0, count=1)
    assert [bus.level("buffer_dtr") for _ in range(2)] == [0, 1]


# ------------------------------------------------------------------------------------- serial


def serial(**fault):
    faults, board = Faults(), Echo()
    if fault:
        faults.inject(**fault)
    return faulty("serial", board, faults), board


@pytest.mark.parametrize(
    ("fault", "answer"),
    [
        ({"kind": "flip", "mask": 0x80, "after": 1, "count": 1}, b"\x01\x82\x03"),
        ({"kind": "flip", "mask": 0x80, "of": "read", "after": 1, "count": 1}, b"\x01\x82\x03"),
        ({"kind": "lose", "after": 1, "count": 1}, b"\x01\x03"),
        ({"kind": "lose", "of": "read", "after": 1, "count": 1}, b"\x01\x03"),
        ({"kind": "double", "after": 1, "count": 1}, b"\x01\x02\x02\x03"),
        ({"kind": "double", "of": "read", "after": 1, "count": 1}, b"\x01\x02\x02\x03"),
        ({"kind": "mute"}, b""),
        ({"kind": "mute", "after": 3}, b""),
        ({"kind": "mute", "count": 1}, b"\x02\x03"),
    ],
)
def test_serial_bytes_are_spoilt_both_ways(fault, answer):
    bus, _ = serial(**fault)
    bus.write(b"\x01\x02\x03")
    assert bus.read(10, 0.1, min_bytes=4) == answer
    assert bus.read(10, 0.0) == b""


def test_serial_reading_takes_the_time_it_takes_without_faults():
    """Bytes are there after 10, 20 and 30 ms."""
    bus, _ = serial()
    bus.write(b"\x01\x02\x03")
    assert bus.read(1, 1.0) == b"\x01"
    assert bus.now() == 10
    assert bus.read(5, 1.0, min_bytes=2) == b"\x02\x03"
    assert bus.now() == 30
    assert bus.read(5, 0.5) == b""
    assert bus.now() == 530


def test_what_the_host_gets_is_late_and_in_order():
    """The first byte is there after 10 ms, and 50 ms later; what comes behind waits for it."""
    bus, _ = serial(kind="delay", seconds=0.05, count=1)
    bus.write(b"\x01\x02\x03")
    assert bus.read(5, 0.02) == b""
    assert bus.now() == 20
    assert bus.read(5, 0.03) == b""
    assert bus.read(5, 1.0, min_bytes=3) == b"\x01\x02\x03"
    assert bus.now() == 60
    bus.write(b"\x04")
    bus.sleep(0.02)
    bus.reset_input()
    assert bus.read(5, 0.1) == b""


def test_no_fault_of_a_link_reaches_the_board_by_its_reads():
    """The same 1000 accesses, with all that happens to reads only: the board sees the same."""

    def seen(**fault):
        bus, memory, _ = epp(**fault)
        for k in range(200):
            bus.transact(write_accesses(k, bytes([k])))
            bus.transact(read_accesses(k, 2))
        return memory.cells

    plain = seen()
    assert seen(kind="flip", mask=0xFF, of="read", share=0.5) == plain
    assert np.array_equal(seen(kind="lose", of="read", share=0.5), plain)
