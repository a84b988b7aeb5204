"""The worked vectors of the S3G specification on the twin, and what its user meets first."""

import numpy as np
import pytest

from pulsewright.boards.s3g.packets import frame
from pulsewright.boards.s3g.twin import S3GTwin
from pulsewright.edges.trace import concatenate
from pulsewright.errors import BusError, UsageError
from pulsewright.transport.serial_bus import VirtualSerialBus

BIT = 16  # cycles, in the setting `fast`
FAST = {"baud1": 3_125_000, "baud2": 3_125_000, "ints_timer": 20_000}
VERSION = "d503010000ab"  # vector 1
LEDS_A5 = "d50802003c00a50000003e"  # vector 2
OK = frame(bytes([1, 0, 0x81])).hex()  # reply to a request with tag 1
SERIAL = ("avr_rx", "ext_rx")


class Host:
    """Requests in the setting `fast`, and everything that the board does.

    Cycles as in the specification: a change that is visible in cycle n, which edge n - 1 made, is
    at cycle n.
    """

    def __init__(self, *arguments, **options):
        self.twin = S3GTwin(*arguments, bus_pins=True, **(FAST | options))
        self.traces = []
        self.advance(2000)

    def advance(self, cycle):
        self.twin.advance(cycle)
        self.traces.append(self.twin.drain())

    def send(self, data, port=1, cycle=None):
        """Send bytes; return t, the cycle in which the start bit of the last one begins."""
        return self.twin.send(port, bytes.fromhex(data), cycle) - 10 * BIT

    def ask(self, data, port=1):
        """Send a request and wait until it is answered; return t and the answer."""
        t = self.send(data, port)
        self.advance(t + 4000)
        return t, next(packet for _, packet in self.sent(port, since=t) if "ffff50" not in packet)

    def write(self, **registers):
        """Set output registers, named r0, r1 and so on."""
        for name, value in registers.items():
            register = int(name[1:])
            payload = bytes([1, 0, 60, register]) + (value % 2**32).to_bytes(4, "little")
            assert self.ask(frame(payload).hex())[1] == OK

    def read(self, register):
        """Return an input register."""
        answer = bytes.fromhex(self.ask(frame(bytes([1, 0, 61, register])).hex())[1])
        assert answer[4] == 0x81
        return int.from_bytes(answer[5:9], "little")

    def strobe(self, mask):
        """Send a strobe word; return the cycle in which it is true, with nothing run after it."""
        t = self.send(frame(bytes([1, 0, 62]) + mask.to_bytes(4, "little")).hex())
        self.advance(t + 159)
        return t + 159

    def program(self, address, *words):
        payload = bytes([1, 0, 65, len(words)]) + address.to_bytes(2, "little")
        payload += b"".join(word.to_bytes(5, "little") for word in words)
        assert self.ask(frame(payload).hex())[1][8:10] == "81"

    def edges(self, pin, level):
        """Return the cycles from which on a pin has a level."""
        return (concatenate(self.traces).edges(pin, level) + 1).tolist()

    def changes(self, pin, since):
        return [cycle for cycle in (concatenate(self.traces)[pin] + 1).tolist() if cycle >= since]

    def bytes_sent(self, port=1, since=0):
        """Return (cycle of the start bit, byte) of all bytes that the board has sent."""
        trace = concatenate(self.traces)
        pin, found, free = SERIAL[port - 1], [], since
        changes = trace[pin] + 1
        for fall in (trace.edges(pin, 0) + 1).tolist():
            if fall >= free:
                at = fall + BIT // 2 + BIT * np.arange(1, 9)
                bits = np.searchsorted(changes, at, side="right") % 2
                found.append((fall, int(sum(bits << np.arange(8)))))
                free = fall + 9 * BIT
        return found

    def sent(self, port=1, since=0):
        """Return (cycle of the first start bit, packet) of all packets that the board has sent."""
        data, packets = self.bytes_sent(port, since), []
        while data:
            size = data[1][1] + 3
            packets.append((data[0][0], bytes(byte for _, byte in data[:size]).hex()))
            data = data[size:]
        return packets


# ------------------------------------------------------------------------ section 8, worked vectors


@pytest.mark.parametrize("port", [1, 2])
def test_vector_1_version(port):
    host = Host()
    t, answer = host.ask(VERSION, port)
    assert answer == "d505010081bace34"
    for sent in (host.bytes_sent(1, t), host.bytes_sent(2, t)):
        assert [cycle for cycle, _ in sent] == [t + 161 + 164 * n for n in range(8)]


def test_vector_2_output():
    host = Host()
    t, answer = host.ask(LEDS_A5)
    assert answer == "d5030200819d"
    assert host.sent(since=t)[0][0] == t + 161
    assert [host.edges(f"led{n}", 1) for n in range(8)] == [
        [t + 159] if 0xA5 >> n & 1 else [] for n in range(8)
    ]


def test_vector_3_wrong_checksum():
    host = Host()
    assert host.ask(LEDS_A5[:-2] + "3f")[1] == "d503020080c3"
    assert host.edges("led0", 1) == []


def test_vector_4_input():
    host = Host()
    host.write(r63=0x12345678)
    t, answer = host.ask("d50403003d3fd3")
    assert answer == "d50703008178563412" + "68"
    assert host.sent(since=t)[0][0] == t + 163


@pytest.mark.parametrize(
    ("request_bytes", "answer"),
    [
        ("d50304001b23", "d50b0400810100010" + "0ce0000002e"),  # 5: extended version
        ("d50306006356", "d50306008562"),  # 6: unknown command 99
        ("d5020100c4", "d505010081bace34"),  # 7: without a command
    ],
)
def test_vectors_5_to_7(request_bytes, answer):
    assert Host().ask(request_bytes)[1] == answer


def test_vector_8_program_words():
    host = Host()
    t, answer = host.ask("d51005004102100000000080810700000" + "0bfa8")
    assert answer == "d50805008110000000" + "00f7"
    assert host.sent(since=t)[0][0] == t + 173


def test_vector_9_both_ports_at_the_pace_of_the_slower():
    twin = S3GTwin(bus_pins=True)
    twin.send(1, bytes.fromhex(VERSION))
    assert twin.receive(1, 200_000, count=8).hex() == "d505010081bace34"
    end = twin.now
    assert twin.receive(2, 200_000, count=8).hex() == "d505010081bace34"
    falls = twin.drain().edges("avr_rx", 0)
    starts = [falls[0]]
    for fall in falls:
        if fall > starts[-1] + 1000:  # a byte has 1000 cycles
            starts.append(fall)
    assert len(starts) == 8
    # 160 enables of 27.13 cycles at 115 200 baud, the first one up to a whole one early, and 4
    assert all(4317 <= gap <= 4345 for gap in np.diff(starts))
    assert end == starts[-1] + 950  # in the middle of its stop bit


def test_vector_10_program():
    host = Host()
    host.program(0, 0x40_0000003C, 0xBF_00000007)
    strobe = host.strobe(1 << 29)
    t = strobe - 159
    host.advance(t + 3000)
    assert host.edges("led2", 1) == [t + 162]
    assert [packet for _, packet in host.sent(since=t)] == [OK, "d507ffff500000004083"]
    assert host.sent(since=t)[1][0] == t + 1148
    assert host.read(62) == 0x0007_0001
    done = Host()
    done.program(0, 0x40_0000003C, 0xBF_00000007)
    done.twin.advance(done.strobe(1 << 29) + 4 - 1)  # t + 163, DONE is decoded
    assert done.twin.state()["pending"] == 0
    done.twin.advance(done.twin.now + 1)
    assert done.twin.state()["pending"] == 1 << 30


def test_vector_11_report_of_two_interrupts():
    host = Host()
    host.write(r1=1, r2=10, r3=0xF)
    host.ask(frame(bytes([1, 0, 64, 0, 0, 0, 0])).hex())  # mask all
    start = host.strobe(0x8000_0001)
    host.advance(start + 5)  # done at start + 10, aborted at start + 20
    host.write(r2=0)  # a load of this later makes the generator idle
    host.strobe(1)
    host.ask(frame(bytes([1, 0, 63, 2, 0, 0, 0])).hex())  # clear the abort
    t, _ = host.ask(frame(bytes([1, 0, 64, 255, 255, 255, 255])).hex())
    assert host.sent(since=t)[1][1] == "d507ffff5001000080c6"


def vector_12():
    host = Host()
    host.write(r4=2, r5=5, r6=9, r7=1, r1=3, r2=1000, r3=0x1F0F)
    host.write(r8=0, r9=0, r10=16384, r11=0, r12=0, r13=0, r15=5000)
    return host, host.strobe(1)


def states(host, cycles, *names):
    """Return what channel 0 has in each of the cycles."""
    found = []
    for cycle in cycles:
        host.twin.advance(cycle - 1)
        state = host.twin.state()
        found.append(tuple(state[name][0] for name in names))
    return found


def test_vector_12_pulses():
    host, start = vector_12()
    assert states(host, [start + 1, start + 4, start + 5], "x", "v", "sv") == [
        (0, 16384, 16384),
        (49152, 16384, 16384),
        (65536, 16384, 16384),
    ]
    host.advance(start + 17 + 24)
    assert host.edges("mot0_dir", 1) == [start + 6]
    assert host.edges("mot0_step", 1) == [start + 8, start + 20, start + 32]
    assert host.edges("mot0_step", 0) == [start + 11, start + 23, start + 35]
    state = host.twin.state()  # steps at start + 5, 9, .. 41; 5, 17, 29 and 41 are taken
    assert (state["pulses"][0], state["lost"][0], state["position"][0]) == (4, 6, 4)


def test_vector_12_acceleration_steps_and_abort():
    host, start = vector_12()
    host.twin.advance(start + 3999)
    assert (host.twin.state()["asg"], host.twin.state()["pending"]) == ("wait", 1)
    host.twin.advance(start + 4000)
    assert (host.twin.state()["asg"], host.twin.state()["pending"]) == ("abort", 3)
    at = [start + n + 1 for n in (4000, 5000, 6000, 7000, 8000)]
    assert states(host, at, "v", "a", "sv") == [
        (11384, -5000, 16384),
        (6384, -5000, 11384),
        (1384, -5000, 6384),
        (0, -1384, 1384),
        (0, 0, 0),
    ]
    host.advance(start + 9000)
    reports = [packet for packet in host.sent(since=start) if "ffff50" in packet[1]]
    assert reports == [(start + 3004, "d507ffff50010000004a")]


def test_vector_12_motor_moves_on_after_its_speed_is_0():
    host, start = vector_12()
    before, after, later = (
        x for (x,) in states(host, [start + n for n in (7001, 8001, 9001)], "x")
    )
    assert (after - before, later - after) == (692 * 1000, 0)


@pytest.mark.parametrize(
    ("v", "speeds", "accelerations"),
    [
        (1000, [700, 400, 100, 0, 0], [-300, -300, -300, -100, 0]),
        (-1000, [-700, -400, -100, 0, 0], [300, 300, 300, 100, 0]),
    ],
)
def test_vector_13_abort(v, speeds, accelerations):
    host = Host()
    host.write(r1=1, r2=100, r3=0x3F0F, r10=v, r11=0, r12=0, r13=0, r14=v, r15=300)
    start = host.strobe(1)
    at = [start + 100 * n + 1 for n in range(2, 7)]
    assert states(host, at, "v", "a") == list(zip(speeds, accelerations, strict=True))


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        (250, [(100, 100), (200, 100), (250, 50), (250, 0)]),
        (200, [(100, 100), (200, 100), (200, 0), (200, 0)]),
    ],
)
def test_vector_14_target(target, expected):
    host = Host()
    host.write(r1=9, r2=100, r3=0x3F0F, r10=0, r11=100, r12=0, r13=0, r14=target)
    start = host.strobe(1)
    assert states(host, [start + 100 * n + 1 for n in (1, 2, 3, 4)], "v", "a") == expected


def output(register, value):
    """Return a program word."""
    return 0x40_00000000 | register << 32 | value


# Words of a program.
NOP, LOAD, DONE = 0x80_00000000, 0x81_00000001, 0xBF_00000000
RESET_STEPS = 0x43_00000004  # OUTPUT 3 = 4


@pytest.mark.parametrize(
    ("load", "steps", "state"),
    [
        (21, [10, 20, 30], "working"),
        (29, [10, 20, 30], "working"),
        (30, [10, 20, 31], "working"),
        (None, [10, 20, 30], "abort"),
    ],
)
def test_vector_15_cadence(load, steps, state):
    """Two steps of 10 cycles, and a second load by a program so many cycles after the first."""
    host = Host()
    host.write(r1=2, r2=10, r3=0xF)
    if load is None:
        start = host.strobe(1)
    elif load % 2:  # loads with the strobe that starts the program, which decodes 2 cycles later
        host.program(0, RESET_STEPS, *[NOP] * ((load - 5) // 2), LOAD, DONE)
        start = host.strobe(0x2000_0001)
    else:
        host.program(0, LOAD, RESET_STEPS, *[NOP] * ((load - 4) // 2), LOAD, DONE)
        start = host.strobe(0x2000_0000) + 3
    found = []
    for n in range(1, 36):
        host.twin.advance(start + n)
        if host.twin.state()["dt"] == 0:  # in the cycle after a step
            found.append(n)
    assert (found, host.twin.state()["asg"]) == (steps, state)


# ------------------------------------------------------------------------------ section 4, programs


def long_program(words=1024):
    """Return a board whose whole program memory has NOPs."""
    host = Host(prog_words=words)
    for address in range(0, words, 32):
        host.program(address, *[NOP] * 32)
    return host


def test_busy_is_one_cycle_late():
    """Started in cycle c, DONE is decoded in c + 2: busy from c + 2 to c + 3."""
    host = Host()
    host.program(0, DONE)
    start = host.strobe(1 << 29)
    seen = []
    for cycle in range(start, start + 6):
        host.twin.advance(cycle - 1) if cycle > start else None
        seen.append(host.twin.state()["be"] >> 31)
    assert seen == [0, 0, 1, 1, 0, 0]


@pytest.mark.parametrize(("after", "led"), [(1, 0), (2, 1), (3, 1)])
def test_a_program_word_is_decoded_two_cycles_after_its_write(after, led):
    """NOPs in a ring reach a word for the second time, so long after it was written."""
    host = long_program()
    host.write(r62=0)
    start = host.strobe(1 << 29)
    decoded = start + 2 + 2 * (1024 + 500)
    word = output(0, 1).to_bytes(5, "little")
    # written in done + 6, done being 158 behind the start bit of the checksum, byte 13
    first = decoded - after - 6 - 158 - 13 * 10 * BIT
    host.send(frame(bytes([1, 0, 65, 1]) + (500).to_bytes(2, "little") + word).hex(), cycle=first)
    host.advance(decoded + 3)
    assert host.edges("led0", 1) == [decoded + 1] * led


def test_a_copy_longer_than_the_buffer_goes_on_at_its_head():
    """Word 50 has bytes 256 to 260, which are tag, command, count and address: OUTPUT 0 = tag."""
    host = Host()
    payload = bytes([0xA5, 0, 65, 51, 0x40, 0]) + bytes(249)
    assert host.ask(frame(payload).hex())[1][8:10] == "81"
    host.write(r62=0x40 + 50)
    start = host.strobe(1 << 29)
    host.advance(start + 10)
    assert [len(host.edges(f"led{n}", 1)) for n in range(8)] == [1, 0, 1, 0, 0, 1, 0, 1]


@pytest.mark.parametrize(("ahead", "led"), [(1, 1), (0, 2), (-1, 1)])
def test_an_output_of_the_host_delays_that_of_a_program_by_a_cycle(ahead, led):
    host = long_program()
    host.program(0, output(0, 1))
    host.write(r62=1)
    start = host.strobe(1 << 29)
    decoded = start + 2 + 2 * 1023  # of word 0, the last one
    # done is 158 behind the start bit of the checksum, byte 10
    first = decoded - ahead - 158 - 10 * 10 * BIT
    host.send(frame(bytes([1, 0, 60, 63, 7, 0, 0, 0])).hex(), cycle=first)
    host.advance(decoded + 3)
    assert host.edges("led0", 1) == [decoded + led]
    assert host.twin.state()["outputs"][63] == 7


# -------------------------------------------------------------------------------------------- ports


def test_the_board_listens_1024_cycles_after_both_inputs_are_high():
    twin = S3GTwin(bus_pins=True)
    twin.schedule([0, 20], "cclk", [0, 1])
    twin.advance(1042)
    assert not twin.state()["ready"]
    twin.advance(1043)
    assert twin.state()["ready"]  # in cycle 1044


@pytest.mark.parametrize(("early", "heard"), [(5, True), (6, False)])
def test_a_start_bit_before_the_board_listens(early, heard):
    """The synchroniser is in reset, and high, until cycle 1044: so the line is found low in 1046.

    The start bit is checked in 1056, at the level that the pin has in 1054: it must last till then.
    """
    twin = S3GTwin(bus_pins=True, **FAST)
    twin.schedule([0, 20], "cclk", [0, 1])
    bits = [
        bit for byte in bytes.fromhex(VERSION) for bit in (0, *(byte >> n & 1 for n in range(8)), 1)
    ]
    twin.schedule(1044 - early + BIT * np.arange(len(bits)), "avr_tx", bits)
    twin.advance(5000)
    assert (len(twin.receive(1)) > 0) == heard


def test_bytes_wait_for_the_board_to_listen_and_for_the_line():
    """Ten bits of 434.03 cycles at 115 200 baud, rounded up for the next byte."""
    twin = S3GTwin()
    assert twin.send(2, b"\x55") == 1024 + 4341
    assert twin.send(2, b"") == 1024 + 4341
    assert twin.send(2, b"\x55\x55") == 1024 + 4341 + 8681
    assert twin.send(1, b"\x55") == 1024 + 1000


def test_a_byte_on_a_line_that_is_not_free_is_refused():
    twin = S3GTwin()
    twin.schedule(5000, "avr_tx", 0)
    with pytest.raises(UsageError, match="port 1 at cycle 5000; its line is free from cycle 5001"):
        twin.send(1, b"\0", 5000)
    with pytest.raises(UsageError, match="serial port 3; there are 1"):
        twin.send(3, b"\0")


@pytest.mark.parametrize("baud", [115_200, 500_000, 3_125_000, 9_600])
def test_all_bytes_pass_both_ways_at_any_rate(baud):
    """Register 63 as a loop-back; the host's bit clock is ideal, the board's has 16 parts a bit."""
    twin = S3GTwin(baud1=baud, baud2=3_125_000)
    for word in (0x00FF55AA, 0xD5D5D5D5, 0x01020304, 0x80407FFE):
        twin.send(1, frame(bytes([1, 0, 60, 63]) + word.to_bytes(4, "little")))
        assert twin.receive(1, twin.now + 20_000_000, count=6)[4] == 0x81
        twin.send(1, frame(bytes([1, 0, 61, 63])))
        answer = twin.receive(1, twin.now + 20_000_000, count=10)
        assert answer == frame(bytes([1, 0, 0x81]) + word.to_bytes(4, "little"))


def test_waiting_for_bytes_ends_with_them_or_at_its_limit():
    host = Host()
    t = host.send(VERSION)
    # the first byte starts in cycle t + 161 and is there 9.5 bits later
    assert (host.twin.receive(1, t + 311), host.twin.now) == (b"", t + 311)
    assert (host.twin.receive(1, t + 4000), host.twin.now) == (b"\xd5", t + 160 + 152)
    assert (host.twin.receive(1), host.twin.now) == (b"", t + 312)
    assert host.twin.receive(1, t + 4000, count=3) == bytes.fromhex("050100")
    assert host.twin.now == t + 160 + 3 * 164 + 152


def test_a_host_that_does_not_listen_is_told_what_it_has_lost():
    """An interrupt that stays pending is reported again and again; the ring holds 65536 bytes."""
    host = Host(ints_timer=0)
    host.strobe(1 << 31)
    host.twin.advance(host.twin.now + 70_000 * 164)
    with pytest.raises(BusError, match="bytes from port 2 are lost, for a host can leave 65536"):
        host.twin.receive(2)
    assert len(host.twin.receive(2)) in (65_535, 65_536)  # one may still be on its way


@pytest.mark.parametrize(("low", "answers"), [(10, ["d505010081bace34"]), (11, [])])
def test_a_start_bit_is_checked_ten_enables_after_it_is_seen(low, answers):
    """So 10 low cycles are a glitch; 11 are a byte, and the packet that begins in it is lost."""
    host = Host()
    start = host.twin.now + 100
    host.twin.schedule([start, start + low], "avr_tx", [0, 1])
    host.send(VERSION, cycle=start + 20)
    host.advance(start + 5000)
    assert [packet for _, packet in host.sent()] == answers


def test_a_byte_with_a_low_stop_bit_is_dropped():
    host = Host()
    start = host.twin.now + 100
    # 0xD5 without its stop bit, and then the rest of a packet: nothing of it is heard
    bits = [0, *(0xD5 >> bit & 1 for bit in range(8)), 0, 1]
    host.twin.schedule(start + BIT * np.arange(11), "avr_tx", bits)
    host.send(VERSION[2:], cycle=start + 20 * BIT)
    host.advance(start + 5000)
    assert host.sent() == []
    assert host.ask(VERSION)[1] == "d505010081bace34"


def test_a_header_among_rubbish_is_found():
    host = Host()
    assert host.ask("0102ff" + VERSION)[1] == "d505010081bace34"


# -------------------------------------------------------------------------------------------- reset


def test_reset_brings_pins_to_rest_and_keeps_the_program():
    host = Host()
    host.program(5, output(0, 0xFF), DONE)
    host.write(r0=1, r1=2**31, r2=2**31, r3=0x3F0F, r5=3, r7=1, r10=5000, r14=5000)
    start = host.strobe(1)
    host.advance(start + 500)
    assert len(host.edges("mot0_step", 1)) == 37  # 500 * 5000 / 65536 = 38.1, one still to come
    low = host.twin.now + 100
    host.twin.schedule([low, low + 1], "rst_n", [0, 1])
    host.advance(low + 1023)
    assert not host.twin.state()["ready"]
    host.advance(low + 1024)
    assert host.twin.state()["ready"]  # 1024 cycles after the rise
    assert host.changes("led0", start)[-1] == low + 2
    assert host.changes("mot0_enable", start)[-1] == low + 2
    assert host.twin.state()["outputs"] == [0] * 64
    assert host.twin.state()["mask"] == 2**32 - 1
    quiet = concatenate(host.traces).final().tolist()
    names = host.twin.output_pins
    assert [n for n, level in zip(names, quiet, strict=True) if level] == [
        *("mot0_enable", "mot1_enable", "avr_rx", "ext_rx")
    ]
    host.write(r62=5)
    host.strobe(1 << 29)
    host.advance(host.twin.now + 3000)
    assert host.edges("led7", 1) != []


def test_reset_inside_a_byte_ends_it_with_ones():
    """0xD5 goes out as 0 1010 1011 1; reset after its first two data bits leaves 1111 1101."""
    host = Host()
    t = host.send(VERSION)
    host.twin.schedule([t + 160 + 3 * BIT, t + 163 + 3 * BIT], "rst_n", [0, 1])
    assert host.twin.receive(1, t + 5000) == b"\xfd"
    assert host.twin.receive(2, t + 9000) == b"\xfd"


def test_the_method_returns_with_a_board_that_is_ready():
    host = Host()
    host.write(r0=255)
    before = host.twin.now
    host.twin.reset()
    assert host.twin.now == before + 1026
    assert host.twin.state()["ready"]
    assert host.twin.state()["outputs"][0] == 0


# ------------------------------------------------------------------------------------------- motion


def moving(channels=2, **registers):
    """Return a board that runs one endless acceleration cycle, and the cycle of its load."""
    host = Host(channels=channels)
    control, second = 0xF, 0
    for c in range(channels):
        if c < 3:
            control |= 0x3F << (8 + 8 * c)
        else:
            second |= 0x3F << (8 * (c - 3))
    host.write(r1=2**31, r2=2**31, r3=control, r60=second, **registers)
    return host, host.strobe(1)


def test_six_channels_run_at_their_own_speeds():
    """Speed n for 65536 cycles is n steps."""
    speeds = {f"r{10 + 8 * c}": (-1) ** c * 1000 * (c + 1) for c in range(6)}
    targets = {f"r{14 + 8 * c}": v for c, v in enumerate(speeds.values())}
    host, start = moving(6, r4=1, r5=3, r6=4, **speeds, **targets)
    host.advance(start + 65_536 + 1)  # the pulse former sees a step one cycle later
    state = host.twin.state()
    assert state["position"] == [1000, -2000, 3000, -4000, 5000, -6000]
    assert state["lost"] == [0] * 6
    host.advance(
        start + 65_536 + 8
    )  # the last pulses, and below 0 the first ones of the next round
    for c in range(6):
        assert len(host.edges(f"mot{c}_step", 1)) == 1000 * (c + 1) + c % 2
        assert len(host.edges(f"mot{c}_dir", 1)) == (c + 1) % 2


@pytest.mark.parametrize(
    ("v", "toggles"),
    [(65_536, 1), (131_072, 0), (131_072 + 4096, 1 / 16), (65_536 + 32_768, 1 / 2)],
)
def test_speeds_from_65536_on_alias(v, toggles):
    """Bit 16 changes every cycle, never, as with 4096, or every other cycle."""
    host, start = moving(1, r10=v, r14=v)
    host.advance(start + 1600 + 1)
    state = host.twin.state()
    assert state["pulses"][0] + state["lost"][0] == 1600 * toggles


def test_a_load_of_a_position_makes_no_step():
    """At 65536 every cycle makes a step, but for that of the load."""
    host, start = moving(1, r10=65_536, r14=65_536)
    again = host.strobe(1)
    host.advance(again + 100)
    state = host.twin.state()  # steps of cycles start + 1 up to again + 99
    assert state["pulses"][0] + state["lost"][0] == again - start + 99 - 1


def test_thresholds_work_at_once_also_inside_a_pulse():
    """PULSE goes from 900 to 400 in a program while the counter is past 400: the pin falls then."""
    host, _ = moving(1, r4=100, r5=900, r6=900, r10=16384, r14=16384)
    host.program(0, output(5, 400), output(6, 400), DONE)  # meanwhile pulses of 800 cycles
    rises = host.edges("mot0_step", 1)
    assert [fall - rise for rise, fall in zip(rises, host.edges("mot0_step", 0), strict=False)] == [
        800
    ] * len(host.edges("mot0_step", 0))
    host.advance(host.edges("mot0_step", 1)[-1] + 904 + 100 + 500)
    rise = host.edges("mot0_step", 1)[-1]
    t = host.strobe(1 << 29)
    host.advance(t + 3000)
    written = t + 3  # visible in this cycle
    rise = max(cycle for cycle in host.edges("mot0_step", 1) if cycle < written)
    fall = min(cycle for cycle in host.edges("mot0_step", 0) if cycle > rise)
    assert written + 1 - rise > 300
    assert fall == written + 1


def test_negative_positions_have_their_upper_half_in_the_robust_profile():
    for profile, upper in (("exact", 1000), ("robust", 2**32)):
        host = Host(profile)
        host.write(r1=9, r2=2**31, r3=0x3F0F, r10=-1, r14=-1)
        host.twin.advance(host.strobe(1) + 1000)
        assert host.twin.state()["x"][0] % 2**32 == 2**32 - 1000
        assert host.twin.state()["x"][0] >> 32 == (upper - 1)


# --------------------------------------------------------------- section 6, what profiles differ in

ERROR = frame(bytes([7, 0, 0x80])).hex()  # reply to a request with tag 7
WRONG = frame(bytes([1, 0, 0x80])).hex()


def test_6_the_next_packet_stops_a_copy_in_the_exact_profile():
    """Its length byte is valid 320 cycles behind the checksum, in the fifth cycle of word 53."""
    words = frame(bytes([7, 0, 65, 200, 0x34, 0x12])).hex()
    host = Host()
    t = host.send(words)
    host.send("d503")
    host.advance(t + 4000)
    # R = t + 157, done = R + 1: the fifth cycle of word k is done + 5 + 6 k, its valid bit is gone
    # from R + 321 on, so k = 53: 323; hand-over of the reply at done + 7 + 6 k, a cycle ahead
    at, packet = host.sent(since=t)[0]
    assert at == t + 157 + 1 + 7 + 6 * 53 + 1
    assert packet == frame(bytes([0, 0, 0x82, 0x34, 0x12, 0, 0, 0])).hex()


def test_6_in_the_robust_profile_the_copy_is_not_disturbed():
    host = Host("robust")
    payload = bytes([7, 0, 65, 49, 0x34, 0x12]) + bytes(5 * 49)
    t = host.send(frame(payload).hex())
    host.send("d503")
    host.advance(t + 4000)
    assert host.sent(since=t) == [
        (t + 161 + 6 * 49, frame(bytes([7, 0, 0x81, 0x34, 0x12, 0, 0, 0])).hex())
    ]


def test_9_the_length_of_steps_in_an_abort_is_live_or_that_of_the_last_load():
    for latched, steps in ((0, 10), (1, 2)):
        host = Host(abort_dt_latched=latched)
        host.write(r1=1, r2=5000, r3=0xF)
        start = host.strobe(1)
        host.advance(start + 10_001)  # done at 5000, in abort from 10000 on
        host.write(r2=1000)
        host.twin.advance(start + 10_001 + 10_000)
        before = host.twin.state()["steps"]
        host.twin.advance(host.twin.now + 10_000)
        assert host.twin.state()["steps"] - before == steps


def test_13_a_truncated_packet_holds_the_receiver_or_is_given_up():
    cut = "d508"
    exact = Host()
    exact.send(cut)
    exact.advance(exact.twin.now + 100_000)
    exact.send(VERSION)
    exact.advance(exact.twin.now + 4000)
    assert exact.sent() == []
    # one cycle decides: the valid pulse of the next byte in the last cycle, or behind it
    for late, answers in ((0, []), (1, ["d505010081bace34"])):
        host = Host("robust", rx_timeout=5000)
        t = host.send(cut)
        host.send(VERSION, cycle=t + 5000 + late)
        host.advance(t + 12_000)
        assert [packet for _, packet in host.sent()] == answers


@pytest.mark.parametrize("size", [0, 1, 2])
def test_14_packets_without_a_command_are_an_error(size):
    host = Host("robust")
    payload = bytes([7, 0][:size])
    t, answer = host.ask("d500" + "00" if size == 0 else raw_frame(payload))
    assert answer == (ERROR if size else frame(bytes([0, 0, 0x80])).hex())
    assert host.sent(since=t)[0][0] == t + 161


def raw_frame(payload):
    """Return a packet that may be too short to be one."""
    long = frame(payload + bytes(3 - len(payload)))  # zeros, of which the checksum is made anew
    crc = 0
    for byte in payload:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8C if crc & 1 else 0)
    return (long[:1] + bytes([len(payload)]) + payload + bytes([crc])).hex()


def test_14_in_the_exact_profile_length_0_takes_256_bytes():
    host = Host()
    crc = frame(bytes(255))[-1]  # of zeros: 0, however many
    assert crc == 0
    host.send("d500" + "00" * 255)
    host.advance(host.twin.now + 50_000)
    assert host.sent() == []
    t = host.send("00" + "00")
    host.advance(t + 4000)
    assert host.sent() == [(t + 161, frame(bytes([0, 0, 0x81])).hex())]


@pytest.mark.parametrize(
    "payload",
    [
        bytes([7, 0, 60, 0, 255, 0, 0]),
        bytes([7, 0, 61]),
        bytes([7, 0, 62, 0, 0, 0]),
        bytes([7, 0, 63, 0, 0, 0]),
        bytes([7, 0, 64, 0, 0, 0]),
        bytes([7, 0, 65, 0, 0]),
        bytes([7, 0, 65, 1, 0, 0, 1, 2, 3, 4]),
    ],
)
def test_15_missing_arguments_are_an_error(payload):
    host = Host("robust")
    assert host.ask(frame(payload).hex())[1] == ERROR
    assert host.twin.state()["outputs"][0] == 0
    assert host.ask(frame(payload + bytes(1)).hex())[1][8:10] == "81"
    exact = Host()
    assert exact.ask(frame(payload).hex())[1][8:10] == "81"


def test_16_a_request_during_a_reply_is_lost_or_held():
    """The first reply has 6 bytes of 164 cycles; its executor decides again 4 cycles behind it."""
    for profile, answers in (("exact", 1), ("robust", 2)):
        host = Host(profile)
        t = host.send(LEDS_A5)
        host.send(VERSION[:-2] + "aa")  # over 960 cycles later; a wrong checksum waits, too
        host.advance(t + 8000)
        sent = host.sent(since=t)
        assert [packet for _, packet in sent] == ["d5030200819d", WRONG][:answers]
        assert host.edges("led0", 1) == [t + 159]
    # the line falls at t + 161 + 5 * 164 for the last byte, whose done pulse is 160 cycles later
    assert sent[1][0] == t + 161 + 5 * 164 + 160 + 4 + 3


def test_16_a_third_request_in_flight_is_lost():
    host = Host("robust")
    t = host.send(VERSION)
    host.send(VERSION)
    host.send(VERSION)
    host.advance(t + 12_000)
    assert len(host.sent(since=t)) == 2


def test_17_replies_go_to_the_port_that_asked_at_its_own_pace():
    twin = S3GTwin("robust")  # port 2 is 4.3 times slower
    twin.send(1, bytes.fromhex(VERSION))
    start = twin.now
    assert twin.receive(1, 200_000, count=8).hex() == "d505010081bace34"
    assert twin.now - start < 1024 + 8 * 1000 + 8 * 1010
    twin.advance(twin.now + 100_000)
    assert twin.receive(2) == b""
    twin.send(1, frame(bytes([1, 0, 62, 0, 0, 0, 128])))  # strobe 31 gives interrupt 31
    report = frame(bytes.fromhex("ffff5000000080")).hex()
    assert twin.receive(1, twin.now + 200_000, count=16).hex() == OK + report
    assert twin.receive(2, twin.now + 200_000, count=10).hex() == report


def test_a_driver_on_a_virtual_link_waits_exactly():
    host = Host()
    bus = VirtualSerialBus(host.twin, port=2)
    bus.write(bytes.fromhex(VERSION))
    t = host.twin.now + 1 + 5 * 10 * BIT
    assert bus.read(2, 1.0, min_bytes=2) == b"\xd5\x05"
    assert bus.now() == t + 160 + 164 + 152
    assert bus.read(16, 1.0, min_bytes=6).hex() == "010081bace34"
    before = bus.now()
    assert bus.read(1, 0.001) == b""
    assert bus.now() == before + 50_000


# ------------------------------------------------------------------------------------------- errors


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"channels": 7}, r"7 channels; the registers have room for 1\.\.6"),
        ({"channels": 0}, "0 channels"),
        ({"baud1": 115_250}, "115250 baud; allowed are multiples of 100 up to 3125000"),
        ({"baud2": 3_125_100}, "3125100 baud"),
        ({"baud2": 0}, "0 baud"),
        ({"ints_timer": -1}, r"ints_timer -1; allowed are 0\.\.4294967295"),
        ({"prog_words": 1000}, "1000 program words; allowed are powers of 2 up to 65536"),
        ({"profile": "ideal"}, "no profile 'ideal'"),
        ({"req_queue": 2}, "req_queue = 2"),
    ],
)
def test_impossible_boards_are_refused(options, message):
    with pytest.raises(UsageError, match=message):
        S3GTwin(**options)


def test_time_does_not_go_back():
    twin = S3GTwin()
    twin.advance(100)
    with pytest.raises(UsageError, match="advance to cycle 99, but it is already 100"):
        twin.advance(99)
    with pytest.raises(UsageError, match="cycle 100, but that is over"):
        twin.schedule(100, "avr_tx", 0)
