"""Servers outlive whatever clients send, and serve the next good one."""

import random
import select
import socket
import struct
import time

import pytest
from served import Control, Epp, Process, connected


def epp_garbage(rng, count):
    """Return requests, most of them possible, with any times and now and then a wrong one."""
    block = bytearray(rng.randbytes(10 * count))
    for n in range(0, len(block), 10):
        if rng.random() < 0.999:
            block[n] = rng.choice(b"AWRaIP" if rng.random() < 0.2 else b"AWWR")
            block[n + 1] = block[n + 1] or 1
    return bytes(block)


def spi_garbage(rng, count):
    """Return frames of whole words, and now and then others, with any headers."""
    out = b""
    for _ in range(count):
        length = rng.choice((8, 16, 16, 80)) if rng.random() < 0.98 else rng.randrange(1, 40)
        out += struct.pack("<II", length, rng.getrandbits(31)) + rng.randbytes(length)
    return out


def pour(path, data):
    """Send bytes and take replies, until the server has read all of them, or closes before."""
    with connected(path) as client:
        client.setblocking(False)
        sent, until = 0, time.monotonic() + 3600
        while True:
            assert time.monotonic() < until
            able = select.select([client], [client] if sent < len(data) else [], [], 1)
            try:
                if able[1]:
                    sent += client.send(data[sent : sent + 4096])
                    if sent == len(data):
                        client.shutdown(socket.SHUT_WR)
                if able[0] and not client.recv(1 << 16):
                    return
            except OSError:
                return  # closed upon a wrong request


MANY = pytest.mark.campaign


def abuse(server, path, garbage, total):
    """Send ``total`` requests in many connections; return growth of memory after a tenth [kB]."""
    rng, done, before = random.Random(7), 0, 0
    while done < total:
        count = min(rng.choice((1, 20, 400)), total - done)
        pour(path, garbage(rng, count))
        done += count
        if not before and done > total // 10:
            before = server.memory_kb()
    return server.memory_kb() - before


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
    places = ("--listen", f"epp+unix:{path}", "--control", f"unix:{tmp_path / 'c'}")
    with Process(board, *places, "--time", time_mode) as server:
        growth = abuse(server, path, epp_garbage, total)
        good_epp(path, ident)
        control = Control(tmp_path / "c")
        control.socket.sendall(random.Random(1).randbytes(5000) + b"\n" + b"[" * 60_000 + b"\n")
        while "error" not in control("nonsense"):
            pass
    # wrong ones end a connection, and what comes behind them
    assert server.served["frames"] > total // 4
    assert growth < 20_000


@pytest.mark.parametrize("total", [1000, pytest.param(1_000_000, marks=MANY)], ids=["some", "many"])
def test_garbage_on_an_spi_port(tmp_path, total):
    path = tmp_path / "bus"
    with Process("rapcores", "--listen", f"spi+unix:{path}") as server:
        growth = abuse(server, path, spi_garbage, total)
        with connected(path) as client:
            frame = struct.pack("<QQ", 0xF100000000000001, 0)
            for _ in range(2):
                client.sendall(struct.pack("<II", 16, 0) + frame)
                reply = b""
                while len(reply) < 16:
                    reply += client.recv(16 - len(reply))
        assert struct.unpack("<QQ", reply) == (0, 0x20200404)
    assert server.served["received"] > 8 * total
    assert growth < 20_000


@pytest.mark.parametrize(
    "total", [20_000, pytest.param(1_000_000, marks=MANY)], ids=["some", "many"]
)
def test_garbage_on_a_serial_port(total):
    """Bytes, of which the wire takes 312 500 a second; then silence longer than a packet."""
    with Process("s3g", "--listen", "tcp:127.0.0.1:0", "--set", "baud1=3125000") as server:
        port = int(server.line.rpartition(":")[2])
        rng, before = random.Random(3), 0
        with socket.create_connection(("127.0.0.1", port), timeout=60) as client:
            for sent in range(0, total, 1000):
                client.sendall(rng.randbytes(1000))
                if not before and sent >= total // 10:
                    before = server.memory_kb()
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
        growth = server.memory_kb() - before
    assert server.served["received"] > total
    assert growth < 20_000
