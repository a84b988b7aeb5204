"""How fast links are, and what they cost: servers run in a process of their own."""

from __future__ import annotations

import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from pulsewright.errors import BusError

CYCLES: Final = 41  # EPP cycles that LinuxCNC makes in a servo period, 15 of them reads
PERIOD: Final = 1e-3  # servo period [s]
PERIODS: Final = 5000
_SERVE: Final = "from pulsewright.app.cli import main; main()"


def epp_socket(periods: int = PERIODS) -> dict[str, float]:
    """Make servo cycles as LinuxCNC does, at a served USC twin in lockstep.

    Returns
    -------
    dict
        ``cycles``: EPP cycles per second while paced by a servo thread; ``share``: CPU time of the
        server against time passed; ``fastest``: cycles per second without pace; ``reply``: time
        from a request to its reply then [s].

    Raises
    ------
    BusError
        If the server does not come up.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bus"
        command = [sys.executable, "-c", _SERVE, "serve", "usc", "--profile", "linuxcnc"]
        command += ["--loopback", "on", "--time", "lockstep:1000", "--listen", f"epp+unix:{path}"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as server:
            assert server.stdout is not None
            if server.stdout.readline() != b"ready\n":
                raise BusError("bench links: the server does not start; try pulsewright serve usc")
            try:
                with socket.socket(socket.AF_UNIX) as client:
                    client.connect(str(path))
                    return _measure(client, server.pid, periods)
            finally:
                server.terminate()
                server.communicate()


def _measure(client: socket.socket, pid: int, periods: int) -> dict[str, float]:
    clock = (~pid << 3) | 2  # CPU time of another process, as clock_getcpuclockid has it
    for _ in range(100):
        _servo_cycle(client)
    begin, spent = time.monotonic(), time.clock_gettime(clock)
    for n in range(periods):
        _servo_cycle(client)
        time.sleep(max(0.0, begin + (n + 1) * PERIOD - time.monotonic()))
    seconds, spent = time.monotonic() - begin, time.clock_gettime(clock) - spent
    begin = time.monotonic()
    for _ in range(periods // 5):
        _servo_cycle(client)
    fast = time.monotonic() - begin
    begin = time.monotonic()
    for _ in range(periods):
        _ask(client)
    reply = (time.monotonic() - begin) / periods
    return {
        "cycles": CYCLES * periods / seconds,
        "share": spent / seconds,
        "fastest": CYCLES * (periods // 5) / fast,
        "reply": reply,
    }


def _say(client: socket.socket, op: str, argument: int) -> None:
    client.send(bytes([ord(op), argument]) + time.monotonic_ns().to_bytes(8, "little"))


def _ask(client: socket.socket) -> bytes:
    _say(client, "R", 1)
    return client.recv(2)


def _servo_cycle(client: socket.socket) -> None:
    """Latch, read 15 bytes, write 17; each access a request of its own."""
    for data in (0x20, 0x20, 0x00):
        _say(client, "A", 0x04)
        _say(client, "W", data)
    _say(client, "A", 0x00)
    for _ in range(15):
        _ask(client)
    _say(client, "A", 0x0D)
    _say(client, "W", 0x00)
    _say(client, "A", 0x10)
    for data in bytes.fromhex("0c2700 fbffff fbffff fbffff 57 9c d8 80"):
        _say(client, "W", data)


def links() -> list[dict[str, Any]]:
    """Return the figures of all links, as `app.bench` shows them."""
    found = epp_socket()
    name = "EPP over a unix socket, USC twin"
    # a computer that is busy with other things may not keep the pace
    whole = 100 * found["share"] * CYCLES / PERIOD / found["cycles"]
    rows = (
        (f"{name}: 1 kHz servo thread, 41 cycles each", found["cycles"], "cycles/s", ">= 41000"),
        ("CPU of the server meanwhile", 100 * found["share"], "% of a core", "< 25"),
        ("the same for whole 41000 cycles/s", whole, "% of a core", "< 25"),
        ("cycles without a pace", found["fastest"], "cycles/s", "-"),
        ("from a read to its reply", 1e6 * found["reply"], "us", "-"),
    )
    return [
        {"name": "links", "what": what, "value": value, "unit": unit, "aim": aim}
        for what, value, unit, aim in rows
    ]
