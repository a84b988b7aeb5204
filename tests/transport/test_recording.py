"""What went over a link, in a file and back."""

import json
import struct

import numpy as np
import pytest

from pulsewright import open_board
from pulsewright.errors import UsageError
from pulsewright.transport.bus import EPP_ACCESS
from pulsewright.transport.recording import Event, Recorder, Recording, recorded

OPENED = {"board": "usc", "profile": "document", "options": {}, "link": "x:", "clock_hz": 1000}


class Bus:
    """All three kinds of bus at once; a call takes a cycle."""

    clock_hz, access_cycles, exact, twin = 1000, 3, False, "a twin"
    in_real_time = True

    def __init__(self):
        self.time, self.closed = 40, 0

    def now(self):
        self.time += 1
        return self.time

    def transact(self, accesses):
        accesses["cycle"] = 77
        accesses["value"] = accesses["value"] + 1

    def transfer(self, data, cycle=-1):
        return bytes(255 - byte for byte in data)

    def level(self, pin):
        return {"low": 0, "high": 1}.get(pin)

    def read(self, most, seconds, *, min_bytes=1):
        return bytes(range(min_bytes))

    def write(self, data):
        pass

    def sleep(self, seconds):
        pass

    def reset(self):
        pass

    def reset_input(self):
        pass

    def close(self):
        self.closed += 1


def test_every_call_is_kept_with_its_answer(tmp_path):
    path = tmp_path / "session"
    epp = recorded("epp", Bus(), Recorder(path, OPENED))
    accesses = np.zeros(2, EPP_ACCESS)
    accesses["value"] = 5, 6
    epp.transact(accesses)
    assert accesses["value"].tolist() == [6, 7]
    assert (epp.access_cycles, epp.exact, epp.twin) == (3, False, "a twin")
    assert epp.in_real_time
    epp.reset()
    epp.close()
    recording = Recording.load(path)
    assert recording.opened == OPENED
    assert recording.whole
    assert [(event.kind, event.at) for event in recording.events] == [("access", 41), ("reset", 42)]
    assert recording.events[0].content == accesses.tobytes()

    spi = recorded("spi", Bus(), Recorder(path, OPENED))
    assert spi.transfer(b"\x01\x02", 90) == b"\xfe\xfd"
    assert spi.transfer(b"\x03") == b"\xfc"
    assert [spi.level(pin) for pin in ("low", "high", "none")] == [0, 1, None]
    spi.sleep(0.25)
    events = Recording.load(path).events  # while it is open
    assert [event.frame for event in events[:2]] == [
        (90, b"\x01\x02", b"\xfe\xfd"),
        (-1, b"\x03", b"\xfc"),
    ]
    assert [event.pin for event in events[2:5]] == [("low", 0), ("high", 1), ("none", None)]
    assert events[5].seconds == 0.25

    serial = recorded("serial", Bus(), Recorder(path, OPENED))
    serial.write(b"ask")
    assert serial.read(9, 0.5, min_bytes=3) == b"\0\1\2"
    serial.reset_input()
    serial.close()
    serial.close()
    events = Recording.load(path).events
    assert [event.kind for event in events] == ["write", "read", "forget"]
    assert events[0].content == b"ask"
    assert events[1].answer == (9, 3, 0.5, b"\0\1\2")


def test_a_file_that_is_cut_off_is_good_up_to_there(tmp_path):
    path = tmp_path / "session"
    recorder = Recorder(path, OPENED)
    recorder.keep("write", 5, b"first")
    recorder.keep("write", 6, b"second")
    whole = path.read_bytes()
    first = Event("write", 5, b"first")
    for missing in range(1, 16 + 6):
        path.write_bytes(whole[:-missing])
        recording = Recording.load(path)
        assert recording.events == (first,)
        assert not recording.whole
    path.write_bytes(whole[: -16 - 6])
    assert Recording.load(path).whole


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"G1 X1\n",
        b"\xff\xfe\n",
        b"[1]\n",
        json.dumps({"format": "something else"}).encode() + b"\n",
        json.dumps({"format": "pulsewright recording"}).encode()
        + b"\n"
        + struct.pack("<cxxxIq", b"?", 0, 0),
    ],
)
def test_other_files_are_none(tmp_path, content):
    path = tmp_path / "other"
    path.write_bytes(content)
    with pytest.raises(UsageError, match="is no recording of a link"):
        Recording.load(path)


def test_places_that_do_not_exist(tmp_path):
    with pytest.raises(UsageError, match="cannot be read"):
        Recording.load(tmp_path / "none")
    with pytest.raises(UsageError, match="cannot be written"):
        open_board("usc", record=tmp_path / "none" / "session")
