"""How fast links are, and what they cost: servers run in a process of their own."""

from __future__ import annotations

import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

from pulsewright.boards import open_board
from pulsewright.boards.usc.registers import R_IDENT
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
    options = ("--profile", "linuxcnc", "--loopback", "on", "--time", "lockstep:1000")
    with (
        _served("usc", "epp+unix:{}", *options) as (link, pid),
        socket.socket(socket.AF_UNIX) as client,
    ):
        client.connect(link.partition(":")[2])
        return _measure(client, pid, periods)


@contextmanager
def _served(board: str, listen: str, *options: str) -> Iterator[tuple[str, int]]:
    """Serve a board in a process of its own; give where, and the process.

    Parameters
    ----------
    listen : str
        Where to; ``{}`` stands for a new path.
    """
    with tempfile.TemporaryDirectory() as folder:
        place = listen.format(Path(folder) / "bus")
        command = [sys.executable, "-c", _SERVE, "serve", board, "--listen", place, *options]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as server:
            assert server.stdout is not None
            assert server.stderr is not None
            if server.stdout.readline() != "ready\n":
                raise BusError(f"the server does not start; try pulsewright serve {board}")
            where = server.stderr.readline().split()[-1]  # with the port that it has got
            try:
                yield where, server.pid
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


# Links by board; {} stands for a new path.
LINKS: Final = {
    "usc": ("twin:", "epp+unix:{}", "epp+tcp:127.0.0.1:0"),
    "rapcores": ("twin:", "spi+unix:{}", "spi+tcp:127.0.0.1:0"),
    "s3g": ("twin:", "pty:{}"),
}
EXCHANGES: Final = 1000


def round_trips(exchanges: int = EXCHANGES) -> list[dict[str, Any]]:
    """Measure each kind of link in the same way, through the client's side of this package.

    Parameters
    ----------
    exchanges : int
        How many to measure per link.

    Returns
    -------
    list of dict
        ``link``; ``cycle``, what is counted; ``reply``, from asking until the answer, median [s];
        ``rate``, sustained [cycles/s].
    """
    rows = []
    for board, links in LINKS.items():
        for link in links:
            if link == "twin:":
                rows.append(_side_by_side(board, link, exchanges))
                continue
            with _served(board, link) as (where, _):
                # a pseudo-terminal is a serial port for its clients
                rows.append(_side_by_side(board, where.replace("pty:", "serial:"), exchanges))
    return rows


def _side_by_side(board: str, link: str, exchanges: int) -> dict[str, Any]:
    with open_board(board, link) as driver:
        cycle, count, ask, work = _EXCHANGE[board](driver)
        times = []
        for _ in range(exchanges):
            begin = time.perf_counter()
            ask()
            times.append(time.perf_counter() - begin)
        begin = time.perf_counter()
        for _ in range(exchanges):
            work()
        seconds = time.perf_counter() - begin
    scheme = link.partition(":")[0]
    return {
        "link": f"{board} at {scheme}:",
        "cycle": cycle,
        "reply": statistics.median(times),
        "rate": count * exchanges / seconds,
    }


_Exchange = tuple[str, int, Callable[[], object], Callable[[], object]]


def _epp_exchange(driver: Any) -> _Exchange:
    """Read a byte; then make the cycles of a servo period in a row."""
    read = driver.bus.read
    return "EPP cycle", CYCLES, partial(read, R_IDENT, 1), partial(read, R_IDENT, CYCLES - 1)


def _spi_exchange(driver: Any) -> _Exchange:
    """Ask what board it is: a frame of two words."""
    frame = driver.codec.channel_info()
    exchange = partial(driver.bus.transfer, frame)
    return "SPI frame", 1, exchange, exchange


def _serial_exchange(driver: Any) -> _Exchange:
    """Ask for the version: a packet and its reply."""
    exchange = partial(driver.request, "VERSION")
    return "packet", 1, exchange, exchange


_EXCHANGE: Final = {"usc": _epp_exchange, "rapcores": _spi_exchange, "s3g": _serial_exchange}


def links() -> list[dict[str, Any]]:
    """Return the figures of all links, side by side, as `app.bench` shows them."""
    found = epp_socket()
    name = "EPP over a unix socket, USC twin"
    # a computer that is busy with other things may not keep the pace
    whole = 100 * found["share"] * CYCLES / PERIOD / found["cycles"]
    rows = [
        (f"{name}: 1 kHz servo thread, 41 cycles each", found["cycles"], "cycles/s", ">= 41000"),
        ("CPU of the server meanwhile", 100 * found["share"], "% of a core", "< 25"),
        ("the same for whole 41000 cycles/s", whole, "% of a core", "< 25"),
        ("cycles without a pace", found["fastest"], "cycles/s", "-"),
        ("from a read to its reply", 1e6 * found["reply"], "us", "-"),
    ]
    for row in round_trips():
        rows += [
            (f"{row['link']} from asking to the answer, median", 1e6 * row["reply"], "us", "-"),
            (f"{row['link']} {row['cycle']}s in a row", row["rate"], "cycles/s", "-"),
        ]
    return [
        {"name": "links", "what": what, "value": value, "unit": unit, "aim": aim}
        for what, value, unit, aim in rows
    ]
