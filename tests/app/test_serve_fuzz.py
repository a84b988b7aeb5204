"""Servers outlive whatever clients send, and serve the next good one."""

import random
import socket
import struct
import time
from pathlib import Path

import pytest
from served import Control, Epp, connected, serving

PAGE_KB = 4


def memory_kb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_KB


def epp_garbage(rng, count):
    """Return requests, most of them possible, with any times and now and then a wrong one."""
    block = bytearray(rng.randbytes(10 * count))
    for n in range(0, len(block), 10):
        if rng.random() < 0.999:
            block[n] = rng.choice(b"AWRaIP" if rng.random() < 0.2 else b"AWWR")
            block[n + 1] = block[n + 1] or 1
    return bytes(block)


def spi_garbage(rng, count):
    """Return frames of whole words and others, with any headers."""
    out = b""
    for _ in range(count):
        length = rng.choice((8, 16, 16, 80, rng.randrange(1, 40)))
        out += struct.pack("<II", length, rng.getrandbits(31)) + rng.randbytes(length)
    return out


def pour(path, data):
    """Send bytes and take replies, until all is sent or the server closes."""
    client = connected(path)
    client.settimeout(0.0)
    sent, until = 0, time.monotonic() + 60
    while sent < len(data):
        try:
            sent += client.send(data[sent : sent + 4096])
        except BlockingIOError:
            time.sleep(0.001)
        except OSError:
            break
        try:
            while client.recv(1 << 16):
                pass
            break  # closed
        except BlockingIOError:
            pass
        except OSError:
            break
        assert time.monotonic() < until
    client.close()


MANY = (
    pytest.mark.campaign,
    pytest.mark.skip(reason="open: how long these take, and their bounds, are not known yet"),
)


def abuse(path, garbage, total, good):
    """Send ``total`` requests in many connections; return growth of memory after a tenth [kB]."""
    rng, done, before = random.Random(7), 0, 0
    while done < total:
        count = min(rng.choice((1, 20, 400)), total - done)
        pour(path, garbage(rng, count))
        done += count
        if not before and done > total // 10:
            before = memory_kb()
    good()
    return memory_kb() - before


def good_epp(path, ident):
    client = Epp(path)
    client.say("I", 0)
    client.say("I", 1)
    client.address(ident[0])
    client.read(1)  # may tell of a time-out before
    client.address(ident[0])
    assert client.read(1) == (0, ident[1])
    client.close()


@pytest.mark.parametrize("total", [4000, pytest.param(1_000_000, marks=MANY)], ids=["some", "many"])
@pytest.mark.parametrize(("board", "time_mode"), [("usc", "wall"), ("pluto_step", "lockstep:1000")])
def test_garbage_on_an_epp_port(tmp_path, board, time_mode, total):
    path, ident = tmp_path / "bus", (0x0F, b"\x41") if board == "usc" else (0x15, b"\x00")
    with serving(
        board, listen=f"epp+unix:{path}", control=f"unix:{tmp_path / 'c'}", time=time_mode
    ) as result:
        growth = abuse(path, epp_garbage, total, lambda: good_epp(path, ident))
        control = Control(tmp_path / "c")
        control.socket.sendall(random.Random(1).randbytes(5000) + b"\n" + b"[" * 60_000 + b"\n")
        while "error" not in control("nonsense"):
            pass
    assert result["frames"] > total // 4  # wrong ones end a connection, and what comes behind them
    assert growth < 20_000


@pytest.mark.parametrize("total", [1000, pytest.param(1_000_000, marks=MANY)], ids=["some", "many"])
def test_garbage_on_an_spi_port(tmp_path, total):
    path = tmp_path / "bus"

    def good():
        client = connected(path)
        frame = struct.pack("<QQ", 0xF100000000000001, 0)
        for _ in range(2):
            client.sendall(struct.pack("<II", 16, 0) + frame)
            reply = b""
            while len(reply) < 16:
                reply += client.recv(16 - len(reply))
        assert struct.unpack("<QQ", reply) == (0, 0x20200404)

    with serving("rapcores", listen=f"spi+unix:{path}"):
        assert abuse(path, spi_garbage, total, good) < 20_000


@pytest.mark.parametrize(
    "total", [20_000, pytest.param(1_000_000, marks=MANY)], ids=["some", "many"]
)
def test_garbage_on_a_serial_port(tmp_path, total):
    """Bytes, of which the wire takes 50000 a second; then silence longer than a packet."""
    with serving("s3g", listen="tcp:127.0.0.1:0", options={"baud1": 3_125_000}) as result:
        port = int(result["line"].rpartition(":")[2])
        rng, before = random.Random(3), memory_kb()
        with socket.create_connection(("127.0.0.1", port), timeout=60) as client:
            for _ in range(0, total, 1000):
                client.sendall(rng.randbytes(1000))
            client.shutdown(socket.SHUT_WR)  # and stay until all of it is read
            while client.recv(1 << 16):
                pass
        with socket.create_connection(("127.0.0.1", port), timeout=1) as client:
            # a packet that has begun takes up to 257 bytes more: fill it, then ask
            client.sendall(bytes(600))
            heard, until = b"", time.monotonic() + 60
            while bytes.fromhex("d505010081bace34") not in heard:
                assert time.monotonic() < until
                client.sendall(bytes.fromhex("d503010000ab"))
                time.sleep(0.2)
                heard += client.recv(1 << 16)
        growth = memory_kb() - before
    assert result["received"] > total
    assert growth < 20_000
