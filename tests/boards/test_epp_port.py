"""Requests of the EPP socket protocol: worked vectors, model time, control commands, faults.

Numbered vectors are those of section 9 of the protocol's specification.
"""

import io
import json
import zlib

import pytest

from pulsewright import boards
from pulsewright.boards.control import EppControl
from pulsewright.boards.epp_port import EppPort
from pulsewright.errors import UsageError

SECOND = 10**9


def request(op, argument, t=0):
    return bytes([ord(op), argument]) + t.to_bytes(8, "little")


def requests(text, t=0):
    """Return requests from words like ``A0F R01``: letter, argument in hexadecimal."""
    return b"".join(request(word[0], int(word[1:], 16), t) for word in text.split())


class Clock:
    now = 0

    def __call__(self):
        return self.now


def make(board="usc", *, twin=None, **options):
    return EppPort(boards.get(board).twin(access_cycles=0, **twin or {}), clock=Clock(), **options)


def ask(port, text, t=0):
    replies, good = port.exchange(requests(text, t))
    assert good
    return replies.hex()


def control(port):
    """Return a function that sends a command, and a list of calls of ``stop`` and ``cut``."""
    calls = []
    channel = EppControl(port, lambda: calls.append("stop"), lambda: calls.append("cut"))

    def command(cmd, **arguments):
        reply = channel.answer(json.dumps({"cmd": cmd, **arguments}).encode())
        return None if reply is None else json.loads(reply)

    command.raw, command.calls = channel.answer, calls
    return command


# ----------------------------------------------------------------------------------------- vectors


def test_vectors_1_to_4_and_7():
    port = make()
    assert ask(port, "A0F R01") == "0041"
    assert ask(port, "A2F R01") == "012f"
    assert ask(port, "A00 R04") == "0000000000"
    assert ask(port, "A2F W55 A0F R01") == "0141"
    assert ask(port, "I00 A0F R01 I01 A0F R01") == "010f" + "0041"


def test_vectors_5_and_6():
    port = make("pluto_step")
    port.twin.set_din(0xBEEF)
    assert ask(port, "A10 R04") == "00efbe0000"
    assert ask(port, "A00 R04 a01") == "0000000000" + "0000"


def test_vectors_8_and_9():
    record = io.BytesIO()
    port = make(lockstep_us=1000, record=record)
    marker = "A04 W20"
    assert ask(port, "A00 " * 9 + marker + " A00 R01") == "0000"
    assert int.from_bytes(record.getvalue()[:8], "little") == 16_500 + 2 * 1500
    for _ in range(2):
        ask(port, "A04 W00 " + marker + " A00 R01" + " A00" * 35)
    times = [int.from_bytes(record.getvalue()[n : n + 8], "little") for n in (0, 24, 48)]
    assert times == [19_500, 1_019_500, 2_019_500]
    assert int(port.link["overruns"]) == 0


def test_vector_10():
    port = make()
    assert port.exchange(requests("A0F R01 X00 A1E W55")) == (b"\x00\x41", False)
    assert port.exchange(requests("R00")) == (b"", False)
    assert port.exchange(requests("a00")) == (b"", False)
    assert port.twin.state()["width"] == 0xFE  # nothing behind the wrong one was done


def test_a_read_of_255_bytes_and_a_block_of_them():
    port = make()
    replies, good = port.exchange(requests("A0F " + "RFF " * 419))
    assert (len(replies), good) == (419 * 256, True)
    assert replies[:2] == b"\x00\x41"
    assert replies[33:34] == b"\x41"  # 32 registers, round and round


# -------------------------------------------------------------------------------------------- reset


def test_reset_holds_the_boards_and_clears_what_came_before():
    port = make(lockstep_us=1000)
    command = control(port)
    ask(port, "A1E W55 P12 P34")
    state = command("get")
    assert (state["config_bytes"], state["width"]) == (2, 0x55)
    assert state["config_crc32"] == zlib.crc32(b"\x12\x34")
    ask(port, "I00")
    state = command("get")
    assert (state["config_bytes"], state["config_crc32"], state["width"]) == (0, 0, 0xFE)
    before = port.now
    assert ask(port, "I00 I01 I01") == ""
    assert port.now == before  # reset does not move time
    assert ask(port, "A0F R01") == "0041"


def test_unconfigured_boards_do_not_answer():
    port = make("pluto_step", require_config=True)
    assert ask(port, "A11 R01") == "0111"
    assert ask(port, "P00 A00 R02") == "000000"
    assert ask(port, "I00 I01 A15 W16 R01") == "0116"  # it lost its configuration
    assert ask(port, "I00 PFF I01 A00 R01") == "0000"


# -------------------------------------------------------------------------------------- model time


def test_wall_time_is_the_clients_and_never_goes_back():
    port = make()
    ask(port, "A0F", t=5 * SECOND)
    assert port.now == 0
    ask(port, "A0F", t=5 * SECOND + 700)
    assert port.now == 700
    ask(port, "A0F", t=5 * SECOND + 300)
    assert port.now == 700
    ask(port, "A0F", t=64 * SECOND)
    assert port.now == 59 * SECOND
    assert port.twin.now == 59 * 40_000_000


@pytest.mark.parametrize("t", [(1 << 64) - 1, 1 << 63, 1 << 62, 5 * SECOND + 61 * SECOND + 1])
def test_a_clock_that_is_far_off_is_not_followed(t):
    port = make()
    ask(port, "A0F", t=5 * SECOND)
    port._clock.now = 2_000
    ask(port, "A0F", t=t)
    assert port.now == 2_000
    port._clock.now = 3_000
    ask(port, "A0F", t=5 * SECOND + 2_500)
    assert port.now == 2_500


def test_a_first_client_with_a_wild_clock_does_not_stop_time_for_the_next():
    for wild in (0, 1 << 62, (1 << 64) - 1):
        port = make()
        port._clock.now = 1000 * SECOND
        ask(port, "A0F", t=wild)
        port._clock.now += 4 * SECOND
        ask(port, "A0F", t=port._clock.now)
        assert port.now == 4 * SECOND


def test_lockstep_counts_overruns():
    port = make(lockstep_us=100)
    cycle = "A04 W20 W00"  # the second write is at 05 and does nothing
    ask(port, cycle)
    first = port.now - 1500
    ask(port, "A04 W00 " + "A00 " * 70 + cycle)  # 76 requests: 114 us
    assert port.now - 1500 - first == (1 + 2 + 70 + 2) * 1500
    ask(port, "A04 W00 " + cycle)
    assert int(port.link["overruns"]) == 1
    assert int(port.link["markers"]) == 3


def test_lockstep_does_not_depend_on_clocks():
    def run(t):
        trace = io.StringIO()
        port = make(lockstep_us=1000, trace=trace, twin={"watchdog_us": 0})
        for _ in range(20):
            t = t * 7 % (1 << 64)
            ask(port, "A04 W20 A04 W00 A10 WE7 W03 W00 A1C W03 A1F W80", t)  # 10 kHz
        return trace.getvalue(), port.twin.state()["steps"]

    assert run(1) == run(123_456_789)
    assert run(1)[1][0] > 180


def test_edge_0_is_at_the_first_request():
    port = make("pluto_step", lockstep_us=1000, access_ns=1010)
    # velocity 0 is 1024 from 3030 ns on; edge 0 is at 1025 ns, then there is a tick every 1600 ns
    ask(port, "A00 W00 W04" + " A00" * 6)
    # read at 10100 ns: the ticks at 4225, 5825, 7425 and 9025 ns have added
    assert ask(port, "R04") == "0000100000"


# ----------------------------------------------------------------------------------------- control


def test_commands_set_what_the_board_sees():
    port = make()
    command = control(port)
    assert command("get")["t"] == 0
    assert command("enc", n=1, value=-1) == {"ok": True}  # before the first request, too
    assert ask(port, "A04 W20 A03 R03") == "00ffffff"
    assert command("din", value=0x7FFF) == {"ok": True}
    assert ask(port, "A0D R02") == "00ff7f"
    assert command("index", n=2) == {"ok": True}
    assert ask(port, "A0C R01 A0C R01") == "0004" + "0000"
    assert command("loopback", on=True) == {"ok": True}
    assert command("get")["loopback"] is True
    assert command("estop_in", ok=False) == {"ok": True}
    assert command("get")["estop_in"] is False
    state = command("get")
    assert state["frames"] == state["bus_frames"] == 10
    assert state["reads"] == {"3": 1, "4": 1, "5": 1, "12": 2, "13": 1, "14": 1}
    assert command("steps") == {"t": 0, "steps": [0] * 4, "step_edges": [0] * 4}


def test_commands_act_at_the_present_time():
    port = make(twin={"watchdog_us": 0})
    command = control(port)
    ask(port, "A10 WE7 W03 W00 A1C W03 A1F W80")  # 999: period 1000 ticks, 10 kHz
    port._clock.now = SECOND
    state = command("steps")
    assert state["t"] == SECOND
    assert state["steps"][0] == 10_000
    port._clock.now = 0
    assert command("get")["t"] == SECOND


def test_wrong_commands_are_explained_and_do_nothing():
    command = control(make("pluto_step"))
    assert command("nonsense") == {"error": "unknown command"}
    assert command("enc", n=0, value=1) == {"error": "unknown command"}  # it has no encoders
    for wrong in (b"", b"{", b"[1]", b"7", b'"get"', b"\xff\xfe", b"[" * 100_000, b'{"cmd":[]}'):
        assert set(json.loads(command.raw(wrong))) == {"error"}
    for arguments, message in (
        ({"value": "1"}, "integer"),
        ({"value": True}, "integer"),
        ({}, "'value' should be an integer"),
        ({"value": 1 << 16}, "0..0xffff"),
        ({"value": 1, "board": 1}, "no board 1; there are 0..0"),
    ):
        assert message in command("din", **arguments)["error"]
    assert command("get")["din"] == 0
    assert command("quit") is None
    assert command.calls == ["stop"]


# ------------------------------------------------------------------------------------------- faults


def test_accesses_without_acknowledge():
    port = make()
    command = control(port)
    assert command("fault", kind="mute", count=3) == {"ok": True}
    assert ask(port, "A1E W55 R01") == "0155"  # none of the three reached the board
    assert ask(port, "A1E R01") == "0000"
    assert port.twin.state()["width"] == 0xFE
    command("fault", kind="mute", count=2)
    assert ask(port, "A0F") + ask(port, "R03") == "010f0000"  # one muted: 0F; then 1F and 00
    command("fault", kind="mute")
    assert ask(port, "A0F R01 R01") == "010f010f"
    command("fault", kind="none")
    assert ask(port, "A0F R01") == "0041"


def test_flipped_bits():
    port = make()
    command = control(port)
    command("fault", kind="flip", mask=0x81, count=2)
    assert ask(port, "A0F R01 A0F R01 A0F R01") == "00c0" + "00c0" + "0041"
    command("fault", kind="flip", mask=0x10, of="write", count=2)
    ask(port, "A0E W55")  # arrives as 1E <- 45
    assert port.twin.state()["width"] == 0x45
    assert "0..255" in command("fault", kind="flip", mask=256)["error"]


def test_with_a_stuck_wait_line_accesses_act_and_time_out():
    port = make()
    command = control(port)
    command("fault", kind="stuck", count=4)
    assert ask(port, "A1E W55 A0F R01") == "01ff"
    assert port.twin.state()["width"] == 0x55
    assert ask(port, "A0F R01") == "0041"
    command("fault", kind="stuck")
    assert ask(port, "A0F R02 R01") == "01ffff" + "01ff"
    command("fault", kind="none")
    assert ask(port, "A0F R01") == "0041"


def test_writes_that_get_lost_or_come_twice():
    """1E and 1F are next to each other: a write that came twice reaches both."""
    port = make()
    command = control(port)
    command("fault", kind="lose", count=1)
    assert ask(port, "A1E R01") == "0000"  # address 0, encoder 0
    assert ask(port, "A1E") == ""
    command("fault", kind="lose", count=1)
    assert ask(port, "W55 W44 A0F R01") == "0041"
    assert port.twin.state()["width"] == 0x44
    command("fault", kind="double", count=2)
    assert ask(port, "A1E W33 A0F R01") == "0041"
    assert (port.twin.state()["width"], port.twin.state()["dout"]) == (0x33, 0x33)


def test_a_board_without_power_forgets_and_does_not_answer():
    port = make()
    command = control(port)
    ask(port, "A1E W55")
    command("fault", kind="power", on=False)
    assert ask(port, "A0F R01") == "010f"
    command("fault", kind="power", on=True)
    assert ask(port, "A0F R01") == "0041"
    assert port.twin.state()["width"] == 0xFE


def test_other_faults():
    port = make()
    command = control(port)
    assert port.delay() == 0
    command("fault", kind="delay", seconds=0.25, count=1)
    assert (port.delay(), port.delay()) == (0.25, 0)
    command("fault", kind="cut")
    assert command.calls == ["cut"]
    assert "mute" in command("fault", kind="fire")["error"]
    assert "seconds" in command("fault", kind="delay", seconds=-1)["error"]
    assert "count" in command("fault", kind="mute", count=-2)["error"]


def test_periods_that_are_not_allowed_are_explained():
    with pytest.raises(UsageError, match="servo period of -1 us"):
        make(lockstep_us=-1)
