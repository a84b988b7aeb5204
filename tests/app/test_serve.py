"""`pulsewright serve s3g`: programs that know nothing of this package talk to the twin.

The client is what section 5 of the board's specification says of the original's host layer: a
random tag, one request at a time, bytes read one by one with a time-out of 10 ms, 1 s for a reply,
three attempts; packets with another tag are kept as unexpected.
"""

import json
import random
import signal
import socket
import struct
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import serial
from served import Control, serving

from pulsewright import open_board
from pulsewright.app.serve import serve
from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError

OK = 0x81
VERSION = bytes([0xBA, 0xCE])


def crc8(data):
    crc = 0
    for byte in data:
        for bit in range(8):
            carry = (crc ^ byte >> bit) & 1
            crc = crc >> 1 ^ 0x8C * carry
    return crc


class Client:
    def __init__(self, path):
        self.port = serial.Serial(str(path), 500_000, timeout=0.01)
        self.unexpected = []

    def packet(self, until):
        """Return the payload of the next packet, or None when time is up."""
        data = b""
        while time.monotonic() < until:
            data += self.port.read(1)
            if data and data[0] != 0xD5:
                data = data[1:]
            if len(data) > 2 and len(data) == data[1] + 3:
                assert crc8(data[2:-1]) == data[-1]
                return data[2:-1]
        return None

    def ask(self, *payload):
        for _ in range(3):
            tag = struct.pack("<H", random.randint(1000, 65000))
            body = tag + bytes(payload)
            self.port.write(bytes([0xD5, len(body)]) + body + bytes([crc8(body)]))
            until = time.monotonic() + 1.0
            while (reply := self.packet(until)) is not None:
                if reply[:2] == tag:
                    return reply[2:]
                self.unexpected.append(reply)
        raise TimeoutError


@pytest.fixture
def served(tmp_path):
    """A board at a terminal; its link, and what `serve` returned once it has stopped."""
    link, result, over = tmp_path / "board", {}, threading.Event()
    up = threading.Event()

    def work():
        result.update(
            serve(
                "s3g",
                listen=f"pty:{link}",
                edges=tmp_path / "trace.npz",
                ready=lambda line: up.set(),
                stop=over.is_set,
            )
        )

    thread = threading.Thread(target=work)
    thread.start()
    assert up.wait(300)

    def finish():
        over.set()
        thread.join(30)
        return result

    yield link, finish
    finish()


def test_a_plain_client_reads_writes_and_runs_a_program(served, tmp_path):
    link, finish = served
    client = Client(link)
    assert client.ask(0) == bytes([OK]) + VERSION
    assert client.ask(27) == bytes.fromhex("81 01 00 01 00 CE 00 00 00")
    assert client.ask(60, 63, *struct.pack("<I", 0x12345678)) == bytes([OK])
    assert client.ask(61, 63) == bytes.fromhex("81 78 56 34 12")
    assert client.ask(99) == bytes([0x85])
    # vector 10: LEDs 3C, DONE 7, at 0; the report comes by itself, unasked
    words = bytes.fromhex("3C 00 00 00 40  07 00 00 00 BF")
    assert client.ask(65, 2, 0, 0, *words)[:3] == bytes([OK, 0, 0])
    assert client.ask(64, 0, 0, 0, 0) == bytes([OK])  # nothing is reported
    assert client.ask(62, *struct.pack("<I", 1 << 29)) == bytes([OK])
    assert client.ask(61, 62) == bytes([OK]) + struct.pack("<I", 0x00070001)
    assert client.unexpected == []
    assert client.ask(64, 0, 0, 0, 0xFF) == bytes([OK])
    report = client.packet(time.monotonic() + 5.0)
    assert report == bytes.fromhex("FF FF 50 00 00 00 40")
    assert client.ask(63, 0, 0, 0, 0x40) == bytes([OK])

    result = finish()
    assert result["state"]["outputs"][0] == 0x3C
    assert result["received"] > 100
    assert not link.is_symlink()
    trace = EdgeTrace.load(tmp_path / "trace.npz")
    assert [len(trace[f"led{n}"]) for n in range(8)] == [0, 0, 1, 1, 1, 1, 0, 0]


def test_a_client_may_come_and_go(served):
    link, _ = served
    for _ in range(2):
        client = Client(link)
        assert client.ask(0) == bytes([OK]) + VERSION
        client.port.close()


def test_our_own_driver_opens_it_as_a_port(served):
    link, _ = served
    with open_board("s3g", link=f"serial:{link}?baud=500000") as board:
        board.initialise()
        board.write_register("W_SE_REG_LB", value=0x89ABCDEF)
        assert board.read_register("R_SE_REG_LB") == {"value": 0x89ABCDEF}


def test_noise_is_outlived(served):
    link, _ = served
    client = Client(link)
    client.port.write(bytes(range(200)))  # no D5 among them
    assert client.ask(0) == bytes([OK]) + VERSION


class Tcp:
    """The part of a serial port that `Client` uses, at a socket."""

    def __init__(self, port):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=0.01)
        self.write, self.close = self.socket.sendall, self.socket.close

    def read(self, count):
        try:
            return self.socket.recv(count)
        except TimeoutError:
            return b""


def test_programs_at_a_tcp_port_share_the_board(tmp_path):
    with serving("s3g", listen="tcp:127.0.0.1:0", control=f"unix:{tmp_path / 'c'}") as result:
        port = int(result["line"].rpartition(":")[2])
        first, second = Client.__new__(Client), Client.__new__(Client)
        for client in (first, second):
            client.port, client.unexpected = Tcp(port), []
        assert first.ask(60, 0, *struct.pack("<I", 0xA5)) == bytes([OK])
        assert second.packet(time.monotonic() + 5)[2:] == bytes([OK])  # it hears that, too
        first.port.close()
        assert second.ask(0) == bytes([OK]) + VERSION
        control = Control(tmp_path / "c")
        assert control("get")["outputs"][0] == 0xA5
        assert control("steps")["steps"] == [0, 0]
        assert control("reset") == {"ok": True}
        assert control("get")["outputs"][0] == 0
        assert control("fault", kind="cut") == {"ok": True}
        assert second.port.read(1) == b""
        assert control("quit") is None


def test_the_start_of_a_printer_program(served):
    """MASK 0, abort, clear, registers, a program in pieces of 40 words, polled to its end."""
    link, _ = served
    client = Client(link)
    ok = bytes([OK])
    assert client.ask(64, 0, 0, 0, 0) == ok
    assert client.ask(62, *struct.pack("<I", 1 << 30)) == ok
    assert client.ask(63, *struct.pack("<I", 0xFFFFFFFF)) == ok
    for register in (7, 34, 33):
        assert client.ask(60, register, 0, 0, 0, 0) == ok
    words = [bytes.fromhex("0000000080")] * 45 + [bytes.fromhex("09000000bf")]  # NOP, DONE 9
    for at in (0, 40):
        piece = words[at : at + 40]
        head = [65, len(piece), *struct.pack("<H", at)]
        assert client.ask(*head, *b"".join(piece))[:3] == bytes([OK, at, 0])
    assert client.ask(60, 62, 0, 0, 0, 0) == ok
    assert client.ask(62, *struct.pack("<I", 1 << 29)) == ok
    assert client.ask(61, 62) == ok + struct.pack("<I", 9 << 16 | 45)


def test_the_command_ends_in_order(tmp_path):
    link = tmp_path / "board"
    source = "from pulsewright.app.cli import main; main()"
    command = [sys.executable, "-c", source, "serve", "s3g", "--listen", f"pty:{link}", "--json"]
    command += ["--channels", "3"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert "listens at" in process.stderr.readline()
        assert Client(link).ask(0) == bytes([OK]) + VERSION
        process.send_signal(signal.SIGTERM)
        output, _ = process.communicate(timeout=30)
    assert process.returncode == 0
    first, _, rest = output.partition("\n")
    assert first == "ready"
    served = json.loads(rest)
    assert served["received"] == 6
    assert len(served["state"]["lost"]) == 3
    assert not link.is_symlink()


def test_unusable_requests_are_explained(tmp_path):
    with pytest.raises(UsageError, match="usc is on an EPP bus"):
        serve("usc", listen=f"pty:{tmp_path / 'x'}")
    with pytest.raises(UsageError, match="s3g is on a serial port and listens at pty:PATH"):
        serve("s3g", listen="epp+unix:x")
    with pytest.raises(UsageError, match="tcp:HOST:PORT"):
        serve("s3g", listen="tcp:1")
    with pytest.raises(UsageError, match="not on an EPP bus"):
        serve("s3g", listen=f"pty:{tmp_path / 'x'}", time="lockstep:1000")
    taken = tmp_path / "taken"
    taken.touch()
    with pytest.raises(UsageError, match="taken exists"):
        serve("s3g", listen=f"pty:{taken}")
    with pytest.raises(UsageError, match="cannot be made"):
        serve("s3g", listen=f"pty:{tmp_path / 'no' / 'folder'}")
    stale = tmp_path / "stale"
    stale.symlink_to(tmp_path / "gone")
    assert serve("s3g", listen=f"pty:{stale}", stop=lambda: True)["received"] == 0
    assert not stale.is_symlink()


def test_states_are_plain(tmp_path):
    state = serve("s3g", listen=f"pty:{tmp_path / 'x'}", stop=lambda: True)["state"]
    assert not any(isinstance(value, np.generic) for value in state.values())
    assert list(tmp_path.iterdir()) == []
