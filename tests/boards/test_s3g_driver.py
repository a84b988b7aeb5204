"""The S3G driver, on a scripted port and on the twin; they share nothing but the register map."""

import pytest

from pulsewright import open_board
from pulsewright.boards.s3g import packets
from pulsewright.boards.s3g.driver import S3GDriver
from pulsewright.boards.s3g.program import assemble
from pulsewright.boards.s3g.registers import STB_SE_INT_LB
from pulsewright.boards.s3g.twin import S3GTwin
from pulsewright.errors import (
    BusError,
    BusTimeoutError,
    EstopError,
    RegisterValueError,
    UsageError,
)
from pulsewright.transport.serial_bus import SerialBus, VirtualSerialBus

MS = 50_000  # clocks
OK = "81"


class Script(SerialBus):
    """A port behind which each request is answered from a list: payloads after the tag, or None."""

    clock_hz = 50_000_000

    def __init__(self, *answers):
        self.answers, self.requests, self.time = list(answers), [], 0
        self.pending = b""

    def write(self, data):
        self.requests.append(data)
        if len(data) > 255:
            return  # filler
        answer = self.answers.pop(0) if self.answers else OK
        if isinstance(answer, bytes):
            self.pending += answer
        elif answer is not None:
            self.pending += packets.frame(data[2:4] + bytes.fromhex(answer))

    def read(self, max_bytes, timeout_s, *, min_bytes=1):
        data, self.pending = self.pending[:max_bytes], self.pending[max_bytes:]
        if len(data) < min_bytes:
            self.sleep(timeout_s)
        return data

    def sleep(self, seconds):
        self.time += round(seconds * self.clock_hz)

    def now(self):
        return self.time

    def reset_input(self):
        self.pending = b""

    def close(self):
        self.closed = True

    @property
    def payloads(self):
        """What was asked, without tags."""
        return [data[4:-1].hex() for data in self.requests if len(data) <= 255]


class Spoiling(VirtualSerialBus):
    """A link to a twin that changes what is written or read when told to."""

    def __init__(self, twin):
        super().__init__(twin)
        self.spoil_write = self.spoil_read = None

    def write(self, data):
        change, self.spoil_write = self.spoil_write, None
        super().write(change(data) if change else data)

    def read(self, *args, **options):
        data = super().read(*args, **options)
        if data and self.spoil_read:
            change, self.spoil_read = self.spoil_read, None
            data = change(data)
        return data


def spoiling(profile="exact"):
    bus = Spoiling(S3GTwin(profile))
    driver = S3GDriver(bus, profile=profile)
    driver._random.seed(1)  # tags, so that no change of a byte of them finds it there already
    driver.identify()
    return driver, bus


def run(driver, cycles):
    """Let time pass; return the trace of it."""
    twin = driver.bus.twin
    twin.drain()
    twin.advance(twin.now + cycles)
    return twin.drain()


# ------------------------------------------------------------------------------ requests


def test_requests_are_those_of_the_document():
    bus = Script(OK, OK, OK, OK, "8178563412", OK)
    driver = S3GDriver(bus)
    driver.write_register("W_V_VAL", instance=1, value=-2)
    driver.strobe(1 << 31)
    driver.clear_interrupts(3)
    driver.mask_interrupts(0xFFFF_FFFF)
    assert driver.read_register("R_SE_REG_LB") == {"value": 0x12345678}
    driver.write_outputs(0xA5)
    assert bus.payloads == [
        "3c12feffffff",
        "3e00000080",
        "3f03000000",
        "40ffffffff",
        "3d3f",
        "3c00a5000000",
    ]
    tags = [int.from_bytes(data[2:4], "little") for data in bus.requests]
    assert all(1000 <= tag <= 65_000 for tag in tags)
    assert len(set(tags)) > 3


def test_identify_reads_both_versions_and_refuses_another_board():
    identity = S3GDriver(Script("81bace", "8101000100ce000000")).identify()
    assert (identity.version, identity.extended) == (0xCEBA, 0xCE_0001_0001)
    with pytest.raises(BusError, match="version 1234, expected CEBA"):
        S3GDriver(Script("813412")).identify()


def test_a_request_without_answer_is_repeated_three_times_a_second_each():
    bus = Script(*[None] * 9)
    with pytest.raises(BusTimeoutError, match=r"no reply to VERSION within 1 s, sent 4 times"):
        S3GDriver(bus).identify()
    assert bus.payloads == ["00"] * 4
    assert 4.0 <= bus.time / bus.clock_hz < 4.2


def test_a_damaged_request_is_repeated_at_once():
    bus = Script("80", packets.frame(bytes.fromhex("ffff80")), "81bace", "8101000100ce000000")
    driver = S3GDriver(bus)
    driver.identify()
    assert driver.retried == 2
    assert bus.time < 0.01 * bus.clock_hz


@pytest.mark.parametrize(
    ("answers", "message"),
    [(["80"] * 4, "REPLY_ERROR"), (["85"], "REPLY_UNKNOWN"), (["81ba"], "VERSION.*1 byte")],
)
def test_other_answers_are_errors(answers, message):
    with pytest.raises(BusError, match=message):
        S3GDriver(Script(*answers)).identify()


class InPieces(Script):
    """A port whose answers arrive in two pieces: the first bytes, and 2 ms later the others."""

    def __init__(self, first, *answers):
        super().__init__(*answers)
        self.first, self.coming, self.due = first, b"", 0

    def write(self, data):
        super().write(data)
        self.pending, self.coming = self.pending[: self.first], self.pending[self.first :]
        self.due = self.time + 2 * MS

    def read(self, max_bytes, timeout_s, *, min_bytes=1):
        if len(self.pending) < min_bytes:
            self.time = min(self.time + round(timeout_s * self.clock_hz), max(self.time, self.due))
            if self.time >= self.due:
                self.pending, self.coming = self.pending + self.coming, b""
        return super().read(max_bytes, timeout_s, min_bytes=min_bytes)


@pytest.mark.parametrize("first", range(1, 8))
def test_an_answer_that_arrives_in_pieces_is_waited_for_no_longer_than_it_takes(first):
    bus = InPieces(first, "81bace")
    assert S3GDriver(bus).request("VERSION") == {"version": 0xCEBA}
    assert bus.time == 2 * MS


def test_an_answer_to_an_earlier_request_is_not_taken_for_this_one():
    late = packets.frame(bytes.fromhex("0100810000"))
    bus = Script(late + packets.frame(bytes.fromhex("ffff5003000000")), "81bace")
    driver = S3GDriver(bus, timeout=0.1)
    assert driver.request("VERSION") == {"version": 0xCEBA}
    assert driver.retried == 1
    assert driver.events() == [3]


def test_after_a_time_out_the_board_gets_what_it_may_still_wait_for():
    bus = Script(None, "81bace")
    S3GDriver(bus, timeout=0.1).request("VERSION")
    # the longest packet: 256 bytes for N = 0 and a checksum
    assert len(bus.requests[1]) >= 257
    assert set(bus.requests[1]) == {0}
    bus = Script(None, "81bace")
    S3GDriver(bus, timeout=0.1, profile="robust").request("VERSION")
    assert len(bus.requests) == 2


@pytest.mark.parametrize("profile", ["exact", "robust"])
@pytest.mark.parametrize(
    "change",
    [
        lambda data: data[:5] + bytes([data[5] ^ 4]) + data[6:],  # an argument
        lambda data: data[:-1] + bytes([data[-1] ^ 1]),  # the checksum
        lambda data: data[:3] + data[4:],  # a byte lost
        lambda data: data[1:],  # the header lost
        lambda data: data[:1] + b"\xff" + data[2:],  # a packet that seems to be long
        lambda data: data[:1] + b"\x00" + data[2:],  # 256 bytes in exact
        lambda data: data[:2] + b"\xd5" + data[3:],  # a header in the tag
        lambda data: data[:2],
        lambda data: b"",
    ],
)
def test_any_damage_of_a_request_is_mended(profile, change):
    driver, bus = spoiling(profile)
    driver.write_register("W_SE_REG_LB", value=0x0102_0304)
    bus.spoil_write = change
    driver.write_register("W_SE_REG_LB", value=0x1234_5678)
    assert driver.retried == 1
    assert driver.read_register("R_SE_REG_LB") == {"value": 0x1234_5678}
    assert driver.retried == 1


@pytest.mark.parametrize("change", [lambda data: b"", lambda data: data[:3] + b"\xd5" + data[4:]])
def test_any_damage_of_a_reply_is_mended(change):
    driver, bus = spoiling()
    bus.spoil_read = change
    driver.write_register("W_SE_REG_LB", value=77)
    assert driver.retried == 1
    assert driver.read_register("R_SE_REG_LB") == {"value": 77}


def test_reports_are_events():
    driver, bus = spoiling()
    assert driver.events() == []
    driver.strobe(1 << STB_SE_INT_LB)
    assert driver.events(timeout=0.1) == [1 << 31]
    before = bus.now()
    assert driver.events(timeout=0.1) == [1 << 31]  # repeated after 20 ms
    assert bus.now() - before == pytest.approx(20 * MS, rel=0.1)
    driver.clear_interrupts(1 << 31)
    driver.events()
    before = bus.now()
    assert driver.events(timeout=0.05) == []
    assert bus.now() - before == 50 * MS


# ------------------------------------------------------------------------------ state


def test_initialise_stops_motion_and_program_from_any_state():
    driver = open_board("s3g", channels=3)
    driver.write_program(
        assemble(
            "OUTPUT ASG_STEPS_VAL, 2\nOUTPUT ASG_DT_VAL, 5000\nOUTPUT V_VAL[0], 30\n"
            "OUTPUT V_VAL[2], -7\nOUTPUT A_VAL[0], 3\nOUTPUT LEDS, 255\n"
            "OUTPUT MSG_CONTROL, ENABLE[0] | ENABLE[2]\n"
            "OUTPUT ASG_CONTROL, STEPS_LIMIT | DT_LIMIT | RESET_STEPS | RESET_DT | SET_V[0] | "
            "SET_A[0] | SET_V[2]\nSTB ASG_LOAD\nWAIT_ALL SE_INT_LB\nDONE 0"
        )
    )
    driver.start_program(0)
    twin = driver.bus.twin
    state = twin.state()
    assert state["asg"] == "abort"
    assert driver.status().busy
    driver.initialise()
    state = twin.state()
    assert (state["asg"], state["v"], state["sv"]) == ("idle", [0, 0, 0], [0, 0, 0])
    assert (state["pending"], state["mask"], state["outputs"][0]) == (0, 0, 0)
    trace = run(driver, 10 * MS)
    assert sum(len(trace[pin]) for pin in trace.pins) == 0
    assert trace.final()[trace.pins.index("mot0_enable")] == 1  # high is off
    assert not driver.status().busy


def test_thresholds_are_sums_of_the_times():
    driver = open_board("s3g")
    driver.initialise(pulse_width=2e-6, pulse_space=3e-6, direction_setup=4e-6, direction_hold=1e-6)
    outputs = driver.bus.twin.state()["outputs"]
    # 4 us; 4 + 2 us; steps 2 + 3 us apart, but as the pulse itself takes 6
    assert outputs[4:7] == [200, 300, 300]
    real = driver.set_times(
        pulse_width=2e-6, pulse_space=10e-6, direction_setup=0, direction_hold=0
    )
    assert real == pytest.approx((2e-6, 10e-6, 20e-9, 599 * 20e-9))
    assert driver.bus.twin.state()["outputs"][4:7] == [1, 101, 599]


def test_pins_keep_the_times_asked_for():
    driver = open_board("s3g")
    driver.initialise(pulse_width=2e-6, pulse_space=3e-6, direction_setup=4e-6, direction_hold=1e-6)
    driver.release_estop()
    driver.set_step_rate(0, 20_000)
    driver.bus.sleep(0.01)
    driver.bus.twin.drain()
    driver.set_step_rate(0, -20_000)
    driver.bus.sleep(0.01)
    trace = driver.bus.twin.drain()
    (change,) = trace["mot0_dir"]
    rise, fall = trace.edges("mot0_step", 1), trace.edges("mot0_step", 0)
    fall = fall[fall > rise[0]]
    assert set(fall - rise[: len(fall)]) == {100}
    assert rise[rise > change][0] - change == 200
    assert change - rise[rise < change][-1] >= 50


@pytest.mark.parametrize("rate", [20_000.0, -20_000.0, 100.0, 305_000.0])
def test_the_rate_set_is_the_rate_on_the_pins(rate):
    driver = open_board("s3g", channels=4)
    driver.initialise(pulse_width=1e-6, pulse_space=1e-6, direction_setup=1e-6, direction_hold=0)
    driver.release_estop()
    real = driver.set_step_rate(3, rate)
    unit = 50e6 / 65536
    assert real == round(rate / unit) * unit
    trace = run(driver, 100 * MS)
    assert abs(len(trace.edges("mot3_step", 1)) - abs(real) / 10) <= 1
    if real:
        assert trace.final()[trace.pins.index("mot3_dir")] == (rate > 0)
    assert driver.bus.twin.state()["lost"] == [0] * 4


def test_all_rates_change_in_the_same_clock():
    driver = open_board("s3g")
    driver.initialise()
    driver.release_estop()
    assert driver.set_step_rates([763, -763]) == pytest.approx((763, -763), abs=1)
    v = driver.bus.twin.state()
    assert (v["v"], v["sv"], v["asg"]) == ([1, -1], [1, -1], "idle")
    driver.stop()
    assert driver.bus.twin.state()["v"] == [0, 0]
    assert driver.step_rates() == (0.0, 0.0)


def test_close_leaves_motion_stopped_and_leaving_also_disables():
    driver = open_board("s3g")
    driver.initialise()
    driver.release_estop()
    driver.set_step_rate(0, 5000)
    driver.close()
    state = driver.bus.twin.state()
    assert (state["v"], state["outputs"][7]) == ([0, 0], 3)
    driver.close()
    with open_board("s3g") as driver:
        driver.initialise()
        driver.release_estop()
        driver.set_step_rate(0, 5000)
    state = driver.bus.twin.state()
    assert (state["v"], state["outputs"][7]) == ([0, 0], 0)


def test_a_driver_that_sent_nothing_sends_nothing_as_it_is_closed():
    bus = Script()
    with S3GDriver(bus):
        pass
    assert (bus.requests, bus.closed) == ([], True)


def test_outputs_are_the_leds():
    driver = open_board("s3g")
    driver.write_outputs(0b1000_0001)
    driver.write_output(2, True)
    driver.write_output(0, False)
    assert driver.bus.twin.state()["outputs"][0] == 0b1000_0100


@pytest.mark.parametrize(
    ("call", "kind", "message"),
    [
        (lambda d: d.set_step_rate(0, 2e5), RegisterValueError, r"axis 0: 200000 step/s .*99945"),
        (lambda d: d.set_step_rate(0, float("nan")), RegisterValueError, "axis 0: nan step/s"),
        (lambda d: d.set_step_rate(2, 0), UsageError, r"no axis 2; allowed are 0\.\.1"),
        (lambda d: d.set_step_rates([0]), UsageError, "1 step rates given, the board has 2"),
        (lambda d: d.enable_motors(4), RegisterValueError, r"mask 0x4 asked; .*0\.\.0x3"),
        (lambda d: d.write_output(8, 1), UsageError, r"no output 8; allowed are 0\.\.7"),
        (lambda d: d.write_outputs(256), RegisterValueError, r"0x100 asked, .*0\.\.0xff"),
        (lambda d: d.read_register("W_LEDS"), UsageError, "W_LEDS is on the write side"),
        (lambda d: d.write_register("W_V_VAL", 6, value=0), UsageError, r"instance 6; .*0\.\.5"),
        (lambda d: d.initialise(pulse_width=2e-3), RegisterValueError, r"width of 2000 us asked"),
        (lambda d: d.initialise(direction_hold=-1), RegisterValueError, "hold of -1e"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_sent(call, kind, message):
    driver = open_board("s3g")
    driver.initialise()
    driver.release_estop()
    before = driver.bus.now()
    with pytest.raises(kind, match=message):
        call(driver)
    assert driver.bus.now() == before


def test_motors_do_not_move_before_they_are_enabled():
    driver = open_board("s3g")
    driver.initialise()
    with pytest.raises(EstopError, match=r"call release_estop\(\)"):
        driver.set_step_rate(0, 1000)
    with pytest.raises(EstopError, match="not enabled"):
        driver.check_running()


def test_times_too_long_for_the_present_rate_are_refused():
    driver = open_board("s3g")
    driver.initialise()
    driver.release_estop()
    driver.set_step_rate(1, 50_000)
    with pytest.raises(
        RegisterValueError, match=r"axis 1: runs at 50354 step/s, .* allow 762\.939"
    ):
        driver.set_times(
            pulse_width=500e-6, pulse_space=500e-6, direction_setup=0, direction_hold=0
        )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"channels": 7}, r"7 channels asked; there may be 1\.\.6"),
        ({"channels": 0}, "0 channels asked"),
        ({"prog_words": 1000}, "1000 words asked; it may have a power of 2"),
        ({"watchdog": 1}, "no profile switch 'watchdog'"),
    ],
)
def test_impossible_boards_are_refused(options, message):
    with pytest.raises(UsageError, match=message):
        S3GDriver(Script(), **options)


# ------------------------------------------------------------------------------ programs

MOVE = """
.org {at}
    OUTPUT ASG_STEPS_VAL, 10
    OUTPUT ASG_DT_VAL, 50_000
    OUTPUT V_VAL[0], 16
    OUTPUT ASG_CONTROL, STEPS_LIMIT | DT_LIMIT | RESET_STEPS | RESET_DT | SET_V[0]
    STB ASG_LOAD
    WAIT_ALL ASG_DONE
    CLEAR ASG_DONE
    OUTPUT V_VAL[0], 0
    OUTPUT ASG_DT_VAL, 0
    OUTPUT ASG_CONTROL, DT_LIMIT | SET_V[0]
    STB ASG_LOAD
    DONE 9
"""


@pytest.mark.parametrize(
    "options",
    [{}, {"profile": "robust"}, {"baud1": 115_200}, {"baud1": 3_125_000, "baud2": 3_125_000}],
)
def test_the_cycle_of_the_start_is_exact_on_a_twin(options):
    driver = open_board("s3g", **options)
    driver.initialise()
    driver.mask_interrupts(0)
    driver.write_program(assemble(MOVE.format(at=8190)))  # over the end of memory
    for delay in range(20):
        driver.bus.twin.advance(driver.bus.now() + 1000 + 7 * delay)
        strobe = driver.start_program(8190)
        load = strobe + 2 + 2 * 4 + 1  # FETCH, four instructions, DECODE, strobe
        state = driver.bus.twin.state()
        # the counter was 0 in the cycle after the load
        assert state["cycle"] + 1 - state["dt"] - state["steps"] * 50_000 == load + 1
        status = driver.wait_program(0.1)
        assert (status.busy, status.error, status.pc) == (False, 9, 8201)
    assert status.text == "idle at address 8201: ended with code 0x09"


def test_a_program_that_does_not_end_is_told_and_can_be_ended():
    driver = open_board("s3g")
    driver.initialise()
    driver.write_program(assemble("WAIT_ALL SE_INT_LB\nDONE 0"))
    driver.start_program(0)
    before = driver.bus.now()
    with pytest.raises(BusTimeoutError, match=r"runs for more than 0\.05 s .*busy at address 0: "):
        driver.wait_program(0.05)
    assert driver.bus.now() - before == pytest.approx(50 * MS, rel=0.1)
    driver.abort_program()
    assert driver.status().text == "idle at address 0: ABORTED"


def test_a_start_is_not_repeated():
    bus = Script(OK, None, OK, OK)
    with pytest.raises(BusTimeoutError, match="no reply to STB"):
        S3GDriver(bus).start_program(5)
    assert bus.payloads == ["3c3e05000000", "3e00000020"]


def test_long_programs_go_in_pieces():
    bus = Script(*["810000000000"] * 3)
    S3GDriver(bus).write_program(assemble(".org 16\n" + "NOP\n" * 100 + "DONE 0"))
    heads = [payload[:8] for payload in bus.payloads]
    assert heads == ["41311000", "41314100", "41037200"]  # 49, 49 and 3 words from 16, 65, 114
    with pytest.raises(UsageError, match="101 words in a row; the program memory has 64"):
        S3GDriver(Script(), prog_words=64).write_program(assemble("NOP\n" * 100 + "DONE 0"))


def test_words_tell_where_the_executor_is():
    driver = open_board("s3g")
    driver.initialise()
    assert driver.write_words(300, [0xBF_00000005]) == (0x82, 0)
    driver.start_program(300)
    assert driver.write_words(0, [0xBF_00000005]) == (5, 300)
