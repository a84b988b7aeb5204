"""What tests of served boards share: a server in a thread, and clients of plain sockets."""

import json
import os
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

from pulsewright.app.serve import serve
from pulsewright.motion.machine import Machine


@contextmanager
def serving(board, **arguments):
    """Serve in a thread; yield a dict that holds what `serve` returned, at the end."""
    result, over, up = {}, threading.Event(), threading.Event()

    def work():
        try:
            result.update(
                serve(
                    board,
                    ready=lambda line: result.update(line=line) or up.set(),
                    stop=over.is_set,
                    **arguments,
                )
            )
        except BaseException as error:
            result["error"] = error
            raise
        finally:
            up.set()

    thread = threading.Thread(target=work)
    thread.start()
    assert up.wait(600)
    try:
        assert "error" not in result
        yield result
    finally:
        over.set()
        thread.join(60)
        assert not thread.is_alive()


@contextmanager
def limited(process, seconds):
    """Kill a process whose ``with`` block takes longer, so that nobody waits for it for ever."""
    timer = threading.Timer(seconds, process.kill)
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def slow_machine(board, **options):
    """Return a machine of two axes, of a hundred steps per mm, at a board with these options."""
    axis = (
        "steps_per_mm = 100\nmin = -100\nmax = 100\nvelocity = 20\nacceleration = 100\njerk = 2000"
    )
    return Machine.parse(
        "\n".join(
            [
                'name = "two axes"',
                *(f"[axis.{name}]\nmotor = {motor}\n{axis}" for motor, name in enumerate("XY")),
                f'[board]\nname = "{board}"\n[board.options]',
                *(f"{name} = {value}" for name, value in options.items()),
            ]
        )
    )


class Process:
    """A server in a process of its own.

    Parameters
    ----------
    *arguments
        Those of ``pulsewright serve``.
    patience : float
        A server that is not ready after so long is killed, which fails the test [s].
    """

    _COMMAND = (sys.executable, "-c", "from pulsewright.app.cli import main; main()", "serve")

    def __init__(self, *arguments, patience=600):
        command = [*self._COMMAND, *map(str, arguments), "--json"]
        self._process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        with limited(self._process, patience):
            assert self._process.stdout.readline() == "ready\n"
            self.line = self._process.stderr.readline()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._process.terminate()
        self.said, self.complaints = self._process.communicate(timeout=60)

    @property
    def served(self):
        """What the server says at its end."""
        assert self._process.returncode == 0, self.complaints
        return json.loads(self.said)

    def memory_kb(self):
        pages = int(Path(f"/proc/{self._process.pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") // 1024


def connected(path):
    client = socket.socket(socket.AF_UNIX)
    client.settimeout(30)
    client.connect(str(path))
    return client


class Epp:
    """The client's side of the EPP socket protocol."""

    def __init__(self, path, clock=time.monotonic_ns):
        self.socket, self.clock = connected(path), clock
        self.requests = 0

    def say(self, op, argument):
        self.requests += 1
        self.socket.sendall(bytes([ord(op), argument]) + self.clock().to_bytes(8, "little"))

    def reply(self, count):
        data = b""
        while len(data) < count + 1:
            block = self.socket.recv(count + 1 - len(data))
            assert block, "the server has closed the connection"
            data += block
        return data[0], data[1:]

    def address(self, address):
        self.say("A", address)

    def write(self, *data):
        for byte in data:
            self.say("W", byte)

    def read(self, count=1, op="R"):
        """Return flags and bytes of one request."""
        self.say(op, count)
        return self.reply(count)

    def close(self):
        self.socket.close()


class Control:
    def __init__(self, path):
        self.socket = connected(path)
        self.file = self.socket.makefile("rb")

    def __call__(self, cmd, **arguments):
        self.socket.sendall(json.dumps({"cmd": cmd, **arguments}).encode() + b"\n")
        return json.loads(self.file.readline() or b"null")
