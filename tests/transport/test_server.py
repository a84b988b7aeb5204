"""The event loop of servers: who may come, what is bounded, what is left behind."""

import socket
import threading
import time
from contextlib import contextmanager

import pytest

from pulsewright.errors import UsageError
from pulsewright.transport.server import LineSession, ProtocolError, Server


class Echo:
    """Replies what it gets; ``hold`` delays, ``bad`` is a protocol error."""

    def __init__(self, connection):
        self.connection = connection

    def received(self, data):
        data = bytes(data)
        if data == b"hold":
            self.connection.hold(0.2)
        if data == b"bad":
            raise ProtocolError
        self.connection.send(data)

    def closed(self):
        pass


@contextmanager
def running(url, make=Echo, **options):
    server = Server()
    with server.listen(url, make, **options) as place:
        thread = threading.Thread(target=server.run, kwargs={"period": 0.01})
        thread.start()
        try:
            yield place, server
        finally:
            server.stop()
            thread.join(10)
            assert not thread.is_alive()


def unix(path):
    client = socket.socket(socket.AF_UNIX)
    client.settimeout(10)
    client.connect(str(path))
    return client


def test_clients_are_served_side_by_side_up_to_a_number(tmp_path):
    with running(f"unix:{tmp_path / 's'}", most=2) as (_, server):
        assert (tmp_path / "s").stat().st_mode & 0o777 == 0o666
        first, second = unix(tmp_path / "s"), unix(tmp_path / "s")
        for client in (first, second, first):
            client.sendall(b"hello")
            assert client.recv(9) == b"hello"
        third = unix(tmp_path / "s")
        assert third.recv(1) == b""
        first.close()
        second.sendall(b"bad")
        assert second.recv(1) == b""
        time.sleep(0.1)
        fourth = unix(tmp_path / "s")
        fourth.sendall(b"again")
        assert fourth.recv(9) == b"again"
        server.cut()
    assert (server.taken, server.sent) == (23, 20)
    assert not (tmp_path / "s").exists()


def test_a_held_client_waits_and_others_do_not(tmp_path):
    with running(f"unix:{tmp_path / 's'}"):
        held, other = unix(tmp_path / "s"), unix(tmp_path / "s")
        begin = time.monotonic()
        held.sendall(b"hold")
        other.sendall(b"hello")
        assert other.recv(9) == b"hello"
        assert held.recv(9) == b"hold"
        assert time.monotonic() - begin >= 0.19
        held.sendall(b"on")
        assert held.recv(9) == b"on"


def test_backlogs_are_sent_in_order(tmp_path):
    with running(f"unix:{tmp_path / 's'}"):
        client = unix(tmp_path / "s")
        data = bytes(range(256)) * 8192

        writer = threading.Thread(target=client.sendall, args=(data,))
        writer.start()
        time.sleep(0.3)  # the server stops reading meanwhile
        back = b""
        while len(back) < len(data):
            back += client.recv(1 << 16)
        writer.join()
        assert back == data


def test_lines_are_answered_and_long_ones_are_not_kept(tmp_path):
    def make(connection):
        return LineSession(connection, lambda line: line.upper() or None, longest=10)

    with running(f"unix:{tmp_path / 's'}", make):
        client = unix(tmp_path / "s")
        client.sendall(b"one\n\ntw")
        client.sendall(b"o\n")
        with client.makefile("rb") as lines:
            assert [lines.readline(), lines.readline()] == [b"ONE\n", b"TWO\n"]
        client.sendall(b"x" * 11)
        assert client.recv(1) == b""


def test_other_computers_are_let_in_only_when_told(tmp_path):
    server = Server()
    for url, message in (
        ("tcp:0.0.0.0:0", "other computers could reach 0.0.0.0"),
        ("tcp:[::]:0", "other computers could reach ::"),
        ("tcp:127.0.0.1:99999", "port of 0..65535"),
        ("tcp::5", "tcp:HOST:PORT"),
        ("file:x", "no place to listen at"),
        (f"unix:{tmp_path / 'no' / 's'}", "no socket can be made"),
    ):
        with pytest.raises(UsageError, match=message), server.listen(url, Echo):
            pass
    with server.listen("tcp:0.0.0.0:0", Echo, remote=True):
        pass
    with running("tcp:127.0.0.1:0") as (place, _):
        port = int(place.rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port), timeout=10) as client:
            client.sendall(b"hello")
            assert client.recv(9) == b"hello"
        with pytest.raises(UsageError, match="is not free"), server.listen(place, Echo):
            pass


def test_the_socket_of_a_killed_server_is_replaced_and_that_of_a_living_one_is_not(tmp_path):
    path = tmp_path / "s"
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(path))
    with running(f"unix:{path}"):
        with pytest.raises(UsageError, match="no socket"), Server().listen(f"unix:{path}", Echo):
            pass
        client = unix(path)
        client.sendall(b"hello")
        assert client.recv(9) == b"hello"
