"""`pulsewright serve rapcores`: frames over a socket, among them those of the one ready client."""

import struct
import time

from served import Control, connected, serving

KEEP = 1 << 31


class Spi:
    def __init__(self, path):
        self.socket = connected(path)

    def transfer(self, data, flags=0):
        self.socket.sendall(struct.pack("<II", len(data), flags) + data)
        reply = b""
        while len(reply) < len(data):
            block = self.socket.recv(len(data) - len(reply))
            assert block, "the server has closed the connection"
            reply += block
        return reply

    def words(self, *words, flags=0):
        reply = self.transfer(struct.pack(f"<{len(words)}Q", *words), flags)
        return list(struct.unpack(f"<{len(words)}Q", reply))


def test_librapcore_reads_what_it_wants(tmp_path):
    """Each message one transfer of 16 bytes; mode word 4, CS active high, is ignored."""
    with serving(
        "rapcores",
        profile="v020",
        listen=f"spi+unix:{tmp_path / 'bus'}",
        options={"position_bits": 24},
    ) as result:
        spi = Spi(tmp_path / "bus")
        for _ in range(200):  # its connection test
            assert spi.words(0xFE00000000000000, 0, flags=4) == [0, 0x01000200]
        assert spi.words(0xFD00000000000000, 0, flags=4) == [0, 0x20180404]
        assert spi.words(0x0300000000000000, 0, flags=4) == [0, 0]
    assert result["received"] == 202 * 24
    assert result["sent"] == 202 * 16


def test_a_move_in_real_time(tmp_path):
    """1000 ticks of half a step at 41 clocks a tick: 500 steps, 2.6 ms."""
    with serving(
        "rapcores", listen=f"spi+unix:{tmp_path / 'bus'}", control=f"unix:{tmp_path / 'c'}"
    ):
        spi, control = Spi(tmp_path / "bus"), Control(tmp_path / "c")
        spi.words(0x0100000000000000, 1000, 1 << 62, 0, 0, 0, 0, 0, 0, 0)
        deadline = time.monotonic() + 30
        while control("get")["completed"] < 1:
            assert time.monotonic() < deadline
        assert control("steps")["steps"] == [500, 0, 0, 0]
        assert spi.words(0xF1000000000000C0, 0) == [0, 500]
        assert control("reset") == {"ok": True}
        assert spi.words(0xF1000000000000C0, 0) == [0, 0]


def test_a_frame_in_pieces_is_one_frame(tmp_path):
    with serving("rapcores", listen=f"spi+unix:{tmp_path / 'bus'}"):
        spi = Spi(tmp_path / "bus")
        request = struct.pack("<QQ", 0xF100000000000001, 0)
        reply = b"".join(
            spi.transfer(request[at : at + 4], KEEP if at < 12 else 0) for at in (0, 4, 8, 12)
        )
        assert struct.unpack("<QQ", reply) == (0, 0x20200404)
        # without that, the board drops each piece, and counts it
        for at in (0, 4, 8, 12):
            spi.transfer(request[at : at + 4])
        assert spi.words(0xF1000000000000E4, 0) == [0, 4]


def test_frames_that_cannot_be_close_the_connection(tmp_path):
    with serving("rapcores", listen=f"spi+unix:{tmp_path / 'bus'}"):
        spi = Spi(tmp_path / "bus")
        assert spi.transfer(b"") == b""
        spi.socket.sendall(struct.pack("<II", 4097, 0))
        assert spi.socket.recv(1) == b""
        assert Spi(tmp_path / "bus").words(0xF100000000000001, 0) == [0, 0x20200404]


def test_faults_of_a_served_board(tmp_path):
    """Version register 0: the reply is in the second word."""
    version, ask = 0x01000300, 0xF1000000000000_00
    with serving(
        "rapcores", listen=f"spi+unix:{tmp_path / 'bus'}", control=f"unix:{tmp_path / 'c'}"
    ):
        spi, control = Spi(tmp_path / "bus"), Control(tmp_path / "c")
        ok = {"ok": True}
        assert control("fault", kind="mute", count=16) == ok
        assert spi.words(ask, 0) == [(1 << 64) - 1] * 2
        assert spi.words(ask, 0) == [0, version]
        assert control("fault", kind="flip", mask=1, of="read", after=8, count=1) == ok
        assert spi.words(ask, 0) == [0, version ^ 1]
        assert control("fault", kind="flip", mask=1, count=1) == ok  # asks for address 1
        assert spi.words(ask, 0) == [0, 0x20200404]
        # a byte of the header gets lost: the word is complete a byte later, and what the host hears
        # is the reply from there on
        assert control("fault", kind="lose", count=1) == ok
        spi.words(ask, 0)
        assert control("get")["framing"] == 1
        assert control("fault", kind="double", count=1) == ok
        spi.words(ask, 0)
        assert control("get")["framing"] == 2
        assert control("fault", kind="delay", seconds=0.3, count=1) == ok
        begin = time.monotonic()
        assert spi.words(ask, 0) == [0, version]
        assert 0.3 <= time.monotonic() - begin < 5
        spi.words(0xF2000000_00000002, 7)
        assert control("get")["divider"] == 7
        assert control("fault", kind="power", on=False) == ok
        assert spi.words(ask, 0) == [(1 << 64) - 1] * 2
        assert control("fault", kind="none") == ok
        assert spi.words(ask, 0) == [0, version]
        assert control("get")["divider"] == 40
        assert control("pin", name="halt", value=0) == ok
        deadline = time.monotonic() + 30
        while not control("get")["halted"]:
            assert time.monotonic() < deadline
        assert (
            "'name' should be one of halt, enc0_a" in control("pin", name="sck", value=0)["error"]
        )
        assert "'kind' should be one of mute" in control("fault", kind="stuck")["error"]
        assert "no argument 'x'" in control("fault", kind="mute", x=1)["error"]
        assert control("fault", kind="cut") == ok
        assert spi.socket.recv(1) == b""
