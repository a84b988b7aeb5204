"""What tests of served boards share: a server in a thread, and clients of plain sockets."""

import json
import socket
import threading
import time
from contextlib import contextmanager

from pulsewright.app.serve import serve


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
