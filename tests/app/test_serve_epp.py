"""EPP boards behind a socket: the documented traffic of real clients, byte by byte."""

import socket
import struct
import subprocess
import sys
import time
import zlib
from contextlib import suppress

import pytest
from served import Control, Epp, connected, serving

from pulsewright.app.serve import serve
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError

MS = 1_000_000  # [ns]
COST = 1500  # of a request in lockstep [ns]


# ------------------------------------------------------------------- hal_ppmc, the driver of a USC


class Ppmc:
    """The traffic of LinuxCNC's `hal_ppmc`: 8-bit accesses, each data read one request."""

    def __init__(self, path):
        self.epp = Epp(path)

    def scan(self):
        """Return time-out flag and byte of the slots; the one after a USC is skipped."""
        found, slot = {}, 0
        while slot < 16:
            self.epp.address(slot * 16 + 0x0F)
            flags, data = self.epp.read()
            found[slot] = (flags, data[0])
            slot += 2 if data[0] >> 4 == 4 and not flags else 1
        return found

    def initialise(self):
        epp = self.epp
        for address, data in ((0x1F, 0x00), (0x03, 0x00), (0x04, 0x10), (0x03, 0xF0)):
            epp.address(address)
            epp.write(data)
        epp.address(0x00)
        epp.write(0, 0, 0)
        for address in (0x03, 0x0D):
            epp.address(address)
            epp.write(0)

    def cycle(self, divisors, control, outputs):
        """Make one servo cycle; return the 15 bytes read."""
        epp = self.epp
        for data in (0x20, 0x20, 0x00):
            epp.address(0x04)
            epp.write(data)
        epp.address(0x00)
        read = b""
        for _ in range(15):
            flags, data = epp.read()
            assert flags == 0
            read += data
        epp.address(0x0D)
        epp.write(0)
        epp.address(0x10)
        for divisor in divisors:
            epp.write(*divisor.to_bytes(3, "little"))
        epp.write(control, 0x9C, 0xD8, outputs)  # setup 10 us, width 4 us
        return read

    def unload(self):
        for slot in range(16):
            self.epp.address(slot * 16)
            self.epp.write(*bytes(32))


IDLE = 0xFFFFFB  # divisor of an axis that stands
ONE_KHZ = 0x270C  # 9996: period 10000 ticks


def test_the_usc_driver_of_linuxcnc_in_lockstep(tmp_path):
    cycles = 50
    with serving(
        "usc",
        profile="linuxcnc",
        listen=f"epp+unix:{tmp_path / 'bus'}",
        control=f"unix:{tmp_path / 'control'}",
        time="lockstep:1000",
        record=tmp_path / "record",
        trace=tmp_path / "trace",
        edges=tmp_path / "edges.npz",
        options={"loopback": 1},
    ) as result:
        control = Control(tmp_path / "control")
        client = Ppmc(tmp_path / "bus")
        slots = client.scan()
        assert slots[0] == (0, 0x41)
        assert [slots[n] for n in range(2, 16)] == [(1, n * 16 + 0x0F) for n in range(2, 16)]
        client.initialise()
        assert client.epp.requests == 46
        assert control("din", value=0x1234) == {"ok": True}
        read = []
        for _ in range(cycles):
            read.append(client.cycle((ONE_KHZ, IDLE, IDLE, IDLE), 0x57, 0x80))
        client.epp.read(1)  # so that all before it is done
        state = control("get")
        client.unload()
        client.epp.close()
        while control("get")["bus_frames"] < 46 + 41 * cycles + 1 + 33 * 16:
            time.sleep(0.01)
        final = control("get")
        assert control("quit") is None

    # the drive is released by the last write of the first cycle, 39 requests after the marker; the
    # first pulse starts 1 ms later, and the latch at the marker of cycle k shows k - 1
    counts = [int.from_bytes(data[:3], "little") for data in read]
    assert counts == [0, *range(cycles - 1)]
    assert [data[0x0D] for data in read] == [0x34] * cycles
    assert [data[0x0E] for data in read] == [0x12] + [0x92] * (cycles - 1)

    # the marker is the second request of a cycle, register 00 is read 6 requests later
    first = 48 * COST
    record = list(struct.iter_unpack("<q4i", (tmp_path / "record").read_bytes()))
    assert record == [(first + k * MS + 6 * COST, max(0, k - 1), 0, 0, 0) for k in range(cycles)]
    trace = (tmp_path / "trace").read_text().splitlines()
    assert trace[0] == f"{32 * COST} W 1F 00"
    assert trace[9] == f"{first} W 04 20"
    assert len(trace) == 9 + 20 * cycles + 2 * 32  # what no board acknowledges is not there

    assert state["cycle"] == cycles
    assert state["frames"] == state["bus_frames"] == 46 + 41 * cycles + 1
    assert state["steps"] == state["step_edges"] == [cycles - 1, 0, 0, 0]
    assert (state["rate"], state["rate_ctrl"]) == ([ONE_KHZ, IDLE, IDLE, IDLE], 0x57)
    assert (state["setup"], state["width"], state["dout"]) == (0x9C, 0xD8, 0x80)
    assert (state["estop"], state["timer"], state["writes"]["4"]) == (False, 0, 3 * cycles + 1)
    assert state["overruns"] == 0
    assert (final["rate"], final["rate_ctrl"], final["estop"]) == ([0] * 4, 0, True)
    assert final["steps"] == [cycles - 1, 0, 0, 0]
    assert (result["cycles"], result["overruns"]) == (cycles, 0)
    rises = EdgeTrace.load(tmp_path / "edges.npz").edges("step0", 1)
    start = (first + 39 * COST) // 25
    assert rises.tolist() == [start + 40_000 * k for k in range(1, cycles)]


def test_two_uscs_on_one_bus(tmp_path):
    with serving(
        "usc",
        listen=f"epp+unix:{tmp_path / 'bus'}",
        control=f"unix:{tmp_path / 'control'}",
        boards_on_bus=2,
        options={"ident": 0x42},
    ):
        client, control = Ppmc(tmp_path / "bus"), Control(tmp_path / "control")
        slots = client.scan()
        assert slots[0] == slots[2] == (0, 0x42)
        assert slots[4] == (1, 0x4F)
        control("din", board=1, value=0x0102)
        control("estop_in", board=1, ok=False)
        control("enc", board=1, n=2, value=-5)
        control("index", board=1, n=3)
        assert control("get", board=1)["enc"] == [0, 0, 0xFFFFFB, 0]
        client.epp.address(0x24)
        client.epp.write(0x20)  # latch
        client.epp.address(0x26)
        assert client.epp.read(3) == (0, b"\xfb\xff\xff")
        client.epp.address(0x2C)
        assert client.epp.read(3) == (0, bytes([0b1000, 0x02, 0x01]))
        assert control("get")["din"] == 0
        assert control("get", board=1)["estop_in"] is False
        assert "no board 2" in control("get", board=2)["error"]


# --------------------------------------------------------------------------- pluto_step, its driver


def test_the_pluto_step_driver_of_linuxcnc_in_lockstep(tmp_path):
    configuration = bytes(n * 7 % 256 for n in range(19_895))
    with serving(
        "pluto_step",
        listen=f"epp+unix:{tmp_path / 'bus'}",
        control=f"unix:{tmp_path / 'control'}",
        time="lockstep:1000",
        record=tmp_path / "record",
        require_config=True,
    ) as result:
        epp, control = Epp(tmp_path / "bus", lambda: 0), Control(tmp_path / "control")
        control("din", value=0xBEEF)
        epp.say("I", 0)
        epp.say("I", 1)
        assert epp.read(1) == (1, b"\x00")  # not configured yet: nothing answers
        for byte in configuration:
            epp.say("P", byte)
        positions, inputs = [], []
        for _ in range(3):
            epp.address(0)
            registers = [epp.read(4) for _ in range(5)]
            assert [flags for flags, _ in registers] == [0] * 5
            positions.append([int.from_bytes(data, "little") for _, data in registers[:2]])
            inputs.append(registers[4][1])
            epp.address(0)
            for velocity in (1024, -512, 0, 0):
                epp.write(*struct.pack("<h", velocity))
            epp.write(*struct.pack("<HH", 0x1234, 0))
        epp.read(1)
        state = control("get")
        epp.close()
        control("quit")
    assert inputs == [b"\xef\xbe\x00\x00"] * 3
    # Model time: the read without an answer 1.5 us, P nothing, so the board starts at 1.5 us; the
    # first marker is at 4.5 us. Velocity 0 is whole 7 requests later, at 15 us: ticks (every 1.6 us
    # from 1.5 us) from number 9 on add 1024. Reads are at 1004.5 and 2004.5 us: through ticks 626
    # (1003.1 us) and 1251 (2003.1 us). Velocity 1 is whole at 18 us; its ticks 11, 12 and 13 turn
    # the direction, those from 14 on count; it is read 1.5 us later, through ticks 627 and 1252.
    assert positions == [
        [0, 0],
        [(626 - 8) * 1024, -512 * (627 - 13) % (1 << 21)],
        [(1251 - 8) * 1024, -512 * (1252 - 13) % (1 << 21)],
    ]
    assert state["vel"] == [0x400, 0xE00, 0, 0]  # nothing is written at the end: it runs on
    assert (state["dout"], state["timing"], state["wd_enabled"]) == (0x1234, 0, False)
    assert (state["config_bytes"], state["config_crc32"]) == (19_895, zlib.crc32(configuration))
    assert state["cycle"] == 3
    record = list(struct.iter_unpack("<q4i", (tmp_path / "record").read_bytes()))
    assert [time for time, *_ in record] == [4500, 4500 + MS, 4500 + 2 * MS]
    # bit 11 toggles with tick 10 and every second one after it; the pulse comes a tick later
    assert [steps[0] for _, *steps in record] == [0, (626 - 11) // 2 + 1, (1251 - 11) // 2 + 1]
    assert result["frames"] == 2 + 1 + 19_895 + 3 * 19 + 1


# ------------------------------------------------------------------------------------ the transport


def test_clients_come_and_go_and_the_board_stays_as_it_is(tmp_path):
    with serving("usc", listen=f"epp+unix:{tmp_path / 'bus'}") as result:
        first = Epp(tmp_path / "bus")
        first.address(0x1E)
        first.write(0x12)
        first.address(0x0F)
        assert first.read() == (0, b"\x41")
        second = Epp(tmp_path / "bus")
        assert second.read(1, "a") == (0, b"\x10")  # the address register is the board's
        first.socket.sendall(b"R\x01abc")  # half a request, and gone
        first.close()
        assert second.read(1, "a") == (0, b"\x10")
        second.socket.sendall(b"X" + bytes(9))  # unknown: closed
        assert second.socket.recv(1) == b""
        third = Epp(tmp_path / "bus")
        third.socket.sendall(b"R\x00" + bytes(8))  # no reads at all: closed
        assert third.socket.recv(1) == b""
        fourth = Epp(tmp_path / "bus")
        # many requests in one piece, and one in pieces
        fourth.socket.sendall((b"A\x0f" + bytes(8) + b"R\x01" + bytes(8)) * 300)
        for _ in range(300):
            assert fourth.reply(1) == (0, b"\x41")
        for byte in b"a\x01" + bytes(8):
            fourth.socket.sendall(bytes([byte]))
        assert fourth.reply(1) == (0, b"\x10")
    assert result["frames"] == 4 + 1 + 1 + 601
    assert result["state"]["width"] == 0x12
    assert list(tmp_path.iterdir()) == []


def test_a_client_that_takes_no_replies_is_not_read_from(tmp_path):
    with serving("usc", listen=f"epp+unix:{tmp_path / 'bus'}") as result:
        deaf, good = connected(tmp_path / "bus"), Epp(tmp_path / "bus")
        deaf.settimeout(0.5)
        block = (b"R\xff" + bytes(8)) * 100
        sent = 0
        with suppress(TimeoutError):
            while True:
                sent += deaf.send(block)
        assert good.read(1, "a")[0] == 0
        for _ in range(20):  # all that was sent is replied to, in order, once it is taken
            data = b""
            while len(data) < 256:
                data += deaf.recv(256 - len(data))
            assert data[0] == 0
    assert sent < 10_000_000
    assert result["received"] < sent + 10


def test_the_command_prints_ready_and_ends_in_order(tmp_path):
    source = "from pulsewright.app.cli import main; main()"
    command = [sys.executable, "-c", source, "serve", "usc", "--listen", "epp+tcp:127.0.0.1:0"]
    command += ["--ident", "42", "--loopback", "on", "--time", "lockstep:1000"]
    command += ["--trace", str(tmp_path / "trace"), "--set", "watchdog_us=0"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "ready\n"
        line = process.stderr.readline()
        port = int(line.rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port), timeout=30) as client:
            client.sendall(b"A\x1e" + bytes(8) + b"W\x77" + bytes(8))
            client.sendall(b"A\x0f" + bytes(8) + b"R\x01" + bytes(8))
            assert client.recv(2) == b"\x00\x42"
        process.terminate()
        output, _ = process.communicate(timeout=30)
    assert process.returncode == 0
    assert "4 requests, 0 servo cycles, 0 overruns" in output
    assert (tmp_path / "trace").read_text() == "3000 W 1E 77\n"


def test_unusable_requests_are_explained(tmp_path):
    taken = tmp_path / "taken"
    taken.touch()
    bus = f"epp+unix:{tmp_path / 'bus'}"
    for arguments, message in (
        ({"listen": f"pty:{tmp_path / 'x'}"}, "EPP bus and listens at epp.unix:PATH"),
        ({"listen": f"epp+unix:{taken}"}, "no socket can be made"),
        ({"listen": "epp+tcp:0.0.0.0:0"}, "other computers could reach 0.0.0.0"),
        ({"listen": "epp+tcp:127.0.0.1:x"}, "tcp:HOST:PORT"),
        ({"listen": bus, "time": "lockstep"}, "wall and lockstep:US"),
        ({"listen": bus, "time": "lockstep:2000000"}, "servo period"),
        ({"listen": bus, "boards_on_bus": 9}, "9 boards"),
        ({"listen": bus, "record": tmp_path / "no" / "file"}, "cannot be written"),
        ({"listen": bus, "control": "udp:1"}, "no place to listen at"),
        ({"listen": bus, "options": {"speed": 1}}, "no profile switch 'speed'"),
    ):
        with pytest.raises(UsageError, match=message):
            serve("usc", stop=lambda: True, ready=lambda line: None, **arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]
