"""The gateware replays recordings of the original controller, and does the worked vectors.

Vectors are those of section 8 of the board's specification; what `robust` does otherwise is in its
section 6. t is the cycle at which the start bit of the last byte of a request falls.
"""

import functools
import gc
from pathlib import Path

import pytest
from s3g_host import CONFIGURED, FAST, Host, simulation

from pulsewright.boards.s3g import packets
from pulsewright.boards.s3g.gateware import S3G
from pulsewright.boards.s3g.golden import load, replay_on
from pulsewright.errors import UsageError
from pulsewright.gateware.rtl import RtlSimulation

pytestmark = [
    pytest.mark.rtl,
    pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable"),
]

GOLDEN = Path(__file__).parents[1] / "golden" / "s3g"
# Short ones of every kind; all 37 are the campaign.
QUICK = (
    *(
        "proto_basic_fast",
        "malformed_fast",
        "pipeline_drop_fast",
        "interrupts_fast",
        "fuzz_12_fast",
    ),
    *("buf_basic_fast", "buf_error_fast", "reset_fast", "asg_corners_fast", "load_phase_fast"),
    *("abort_exact_fast", "abort_neg_fast", "abort_zero_fast", "motion_rand_1_fast"),
    *("x_accel_target_fast", "v_alias_fast", "x_neg_fast", "msg_timing_6_fast"),
)


@functools.cache
def board(baud1, baud2, ints_timer):
    return RtlSimulation(S3G(baud1=baud1, baud2=baud2, ints_timer=ints_timer))


def replay(path):
    golden = load(path)
    made = board(**golden.settings)
    made.reset()
    return golden.expected.first_difference(replay_on(made, golden))


@pytest.mark.parametrize("name", QUICK)
def test_every_pin_changes_when_it_did_on_the_original(name):
    assert replay(GOLDEN / f"{name}.npz") is None


@pytest.mark.campaign
@pytest.mark.parametrize("path", sorted(GOLDEN.glob("*.npz")), ids=lambda path: path.stem)
def test_every_pin_of_every_recording(path):
    assert replay(path) is None


# In the others, acceleration steps or loads come sooner than shared arithmetic takes them.
SHARED = (
    *("motion_rand_1_fast", "motion_rand_2_fast", "motion_rand_3_fast", "x_jj_fast", "x_neg_fast"),
    *("x_accel_target_fast", "xy_two_axes_fast", "reset_fast", "fuzz_12_fast", "x_jerk_fast"),
)


@pytest.mark.parametrize("name", SHARED)
def test_shared_arithmetic_is_as_exact(name):
    golden = load(GOLDEN / f"{name}.npz")
    assert golden.settings == FAST
    trace = replay_on(simulation(shared_arithmetic=1), golden)
    assert golden.expected.first_difference(trace) is None


@pytest.mark.parametrize(("dt", "shift"), [(45, 0), (44, 1), (1, 44)])
def test_shared_arithmetic_takes_a_step_22_cycles_per_channel_after_a_load(dt, shift):
    """A step that is due earlier waits; a program that waits for it tells when it came."""
    lit = []
    for shared in (0, 1):
        host = Host(shared_arithmetic=shared)
        # STB 1 (load), WAIT_ALL 1 (done), LEDs 2
        host.ask(request("0100 41 03 0000 0100000081 0100000082 0200000040"))
        for number, value in ((1, 1), (2, dt), (3, 0xF)):
            host.ask(packets.write_output(1, number, value))
        t, _ = host.ask(request("0200 3E 00000020"))
        lit.append(host.edges("led", 1)[0][0] - t)
    # The load is at start + 3, DONE after dt, visible in the next cycle; then WAIT, FETCH, OUTPUT.
    assert lit == [159 + 3 + dt + 4, 159 + 3 + dt + 4 + shift]


def request(text):
    """Return a whole packet from its payload."""
    return packets.frame(bytes.fromhex(text))


@pytest.mark.parametrize(("cclk", "answered"), [(20, True), (21, False)])
def test_the_board_is_ready_1024_cycles_after_both_inputs_are_high(cclk, answered):
    # Ready from 1044 on, it sees a low line at 1046 and checks it at 1056, which is the level of
    # 1054: the last one of a start bit that began at 1039.
    host = Host(begin={0: {"rst_n": 0, "cclk": 0}, 10: {"rst_n": 1}, cclk: {"cclk": 1}})
    host.send(request("0100 00"), cycle=1039)
    host.run(5000)
    assert [payload for _, payload in host.replies()] == ["010081bace"] * answered


def test_vector_1_version():
    host = Host()
    t, payload = host.ask(bytes.fromhex("D5 03 01 00 00 AB"))
    assert payload == "010081bace"
    for port in (0, 1):
        sent = host.received(port, since=t)
        assert [byte for _, byte in sent] == list(bytes.fromhex("D5 05 01 00 81 BA CE 34"))
        assert [at for at, _ in sent] == [t + 161 + 164 * n for n in range(8)]


def test_vector_2_output():
    host = Host()
    t, payload = host.ask(bytes.fromhex("D5 08 02 00 3C 00 A5 00 00 00 3E"))
    assert payload == "020081"
    assert [host.edges("led", bit)[0] for bit in range(8)] == [
        [t + 159] if 0xA5 >> bit & 1 else [] for bit in range(8)
    ]
    assert host.answered == t + 161


def test_vector_3_wrong_crc():
    host = Host()
    _, payload = host.ask(bytes.fromhex("D5 08 02 00 3C 00 A5 00 00 00 3F"))
    assert payload == "020080"
    assert host.edges("led") == [[], []]


def test_vector_4_input():
    host = Host()
    host.ask(request("0100 3C 3F 78563412"), port=1)
    t, payload = host.ask(bytes.fromhex("D5 04 03 00 3D 3F D3"), port=1)
    assert (payload, host.answered) == ("03008178563412", t + 163)


@pytest.mark.parametrize(
    ("data", "payload"),
    [
        ("D5 03 04 00 1B 23", "0400810100 0100 CE000000"),
        ("D5 03 06 00 63 56", "060085"),
        ("D5 02 01 00 C4", "010081BACE"),
    ],
)
def test_vectors_5_to_7(data, payload):
    assert Host().ask(bytes.fromhex(data))[1] == bytes.fromhex(payload).hex()


WORDS_AT_16 = "D5 10 05 00 41 02 10 00 00 00 00 80 81 07 00 00 00 BF A8"


def test_vector_8_write_buffer():
    host = Host()
    t, payload = host.ask(bytes.fromhex(WORDS_AT_16))
    assert (payload, host.answered) == ("0500811000000000", t + 173)


def test_vector_10_a_program():
    host = Host()
    host.ask(request("0100 41 02 0000 3C00000040 07000000BF"))
    t, payload = host.ask(request("0200 3E 00000020"))
    assert (payload, host.answered) == ("020081", t + 161)
    assert host.edges("led", 2)[0] == [t + 162]
    assert host.replies(since=t)[1] == (t + 1148, "ffff5000000040")
    assert host.ask(request("0300 3D 3E"))[1] == "03008101000700"


def test_a_wait_that_is_overwritten_is_what_it_is_now():
    """Section 4.1: a word written in cycle w is executed from w + 2 on; here w is done + 6."""
    host = Host()
    host.ask(request("0100 41 02 0000 0100000082 07000000BF"))
    host.ask(request("0200 3E 00000020"))
    assert host.ask(request("0300 3D 3E"))[1] == "030081000002c0"
    t, _ = host.ask(request("0400 41 01 0000 0800000040"))
    done = t + 158
    assert host.edges("led", 3)[0] == [done + 6 + 2 + 1]


def motion(host, **values):
    """Write output registers by number, then load; return the load cycle."""
    for n, value in {int(k[1:]): v for k, v in values.items()}.items():
        data = value.to_bytes(4, "little", signed=value < 0)
        host.ask(packets.frame(bytes([1, 0, 0x3C, n]) + data))
    return host.ask(request("0200 3E 01000000"))[0] + 159


def test_vector_12_chain():
    host = Host()
    load = motion(host, r4=2, r5=5, r6=9, r7=1, r1=3, r2=1000, r10=16384, r15=5000, r3=0x1F0F)
    host.run(load + 12_000)
    rises, falls = host.edges("mot_step", since=load)
    s = [load + 5, *range(load + 17, load + 4000, 12)]
    common = [at for at in s if at < load + 3990]
    assert rises[: len(common)] == [at + 3 for at in common]
    assert falls[: len(common)] == [at + 6 for at in common]
    assert host.edges("mot_dir", since=load) == [[load + 6], []]
    assert host.edges("mot_enable", since=CONFIGURED)[1] != []
    assert (load + 3004, "ffff5001000000") in host.replies(since=load)
    # Mean velocities of the thousands of cycles after 4000: 13884, 8884, 3884 and 692.
    x = 4000 * 16384 + 1000 * (13884 + 8884 + 3884)
    last = [at for at in rises if at > load + 7000]
    assert len(last) == (x + 1000 * 692) // 65536 - x // 65536
    assert last[-1] < load + 8003


@pytest.mark.parametrize("shared", [0, 1])
def test_a_reset_clears_velocities_and_their_registers(shared):
    host = Host(shared_arithmetic=shared)
    motion(host, r5=2, r7=1, r1=1000, r2=1000, r10=3000, r11=50, r12=7, r3=0x1E0F)
    host.set(host.now, cclk=0)
    host.set(host.now + 1, cclk=1)
    host.run(host.now + 1500)
    # Nothing is set, and then all, from registers that were not written.
    load = motion(host, r5=2, r1=3, r2=1000, r3=0xF)
    host.run(load + 5000)
    load = motion(host, r1=3, r3=0x1E0F)
    host.run(load + 5000)
    assert host.edges("mot_step", since=load - 20_000) == [[], []]


def test_missing_step_pulses_without_width():
    host = Host()
    load = motion(host, r4=5, r5=5, r6=9, r7=2, r1=3, r2=1000, r18=16384, r3=0x1F000F)
    host.run(load + 2000)
    assert host.edges("mot_step", 1, since=load) == [[], []]
    assert host.edges("mot_dir", 1, since=load)[0] == [load + 6]


# Profile `robust`


def robust(**options):
    return Host(profile="robust", channels=6, **options)


def test_13_a_truncated_packet_is_given_up_after_20_ms():
    for late, answered in ((0, True), (1, False)):
        host = Host(profile="robust", channels=6, rx_timeout=5000)
        whole = request("0100 00")
        t = host.send(whole[:-1])
        # The last byte is valid at t + 157; 5000 cycles later is the last one in time.
        host.send(whole[-1:], cycle=t + 5000 + late)
        host.run(t + 9000)
        assert bool(host.replies(since=t)) == answered
        assert host.ask(request("0200 00"))[1] == "020081bace"


@pytest.mark.parametrize(
    ("data", "payload"),
    [
        ("D5 00 00", "000080"),
        ("D5 00 01", "000080"),
        ("D5 01 07 B1", "070080"),
        ("D5 02 01 00 C4", "010080"),
    ],
)
def test_14_short_packets_are_errors(data, payload):
    assert robust().ask(bytes.fromhex(data))[1] == payload


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("0100 3C 00 A50000", "80"),
        ("0100 3C 00 A5000000", "81"),
        ("0100 3C 00 A5000000 99", "81"),
        ("0100 3D", "80"),
        ("0100 3E 000000", "80"),
        ("0100 3F 000000", "80"),
        ("0100 40 000000", "80"),
        ("0100 41 01 00", "80"),
        ("0100 41 01 0000 00000000", "80"),
        ("0100 41 34 0000" + "00" * 249, "80"),
        ("0100 41 00 0000", "81"),
        ("0100 63", "85"),
    ],
)
def test_15_commands_that_lack_arguments_are_errors(text, code):
    host = robust()
    _, payload = host.ask(request(text))
    assert payload.startswith("0100" + code)
    assert bool(host.edges("led")[0]) == (text.startswith("0100 3C") and code == "81")


def test_16_a_request_that_comes_during_a_reply_waits():
    for profile, answers in (("exact", ["010081bace"]), ("robust", ["010081bace", "020081bace"])):
        host = Host(profile=profile, channels=6) if profile == "robust" else Host()
        t = host.send(request("0100 00") + request("0200 00"))
        host.run(t + 4000)
        assert [payload for _, payload in host.replies()] == answers


def test_6_the_program_memory_is_written_before_the_next_packet_is_taken():
    # 255 words take 1530 cycles, in which the length of the next packet comes.
    host = Host()
    host.run(host.send(request("0100 41 FF 0000" + "00" * 245) + request("0200 00")) + 6000)
    assert [payload[:6] for _, payload in host.replies()] == ["000082"]
    # 49 words take 294 cycles, in which only its header comes, and is not taken.
    host = robust()
    host.run(host.send(request("0100 41 31 0000" + "00" * 245) + request("0200 00")) + 6000)
    assert [payload[:6] for _, payload in host.replies()] == ["010081"]


def test_17_replies_go_to_the_asking_port_and_reports_to_both():
    host = robust()
    t, _ = host.ask(request("0100 00"), port=1)
    assert [byte for _, byte in host.received(0, since=t)] == []
    host.ask(request("0200 3E 00000080"), port=0)
    host.run(host.now + 4000)
    assert [payload for _, payload in host.replies(0, since=t)] == ["020081", "ffff5000000080"]
    assert [payload for _, payload in host.replies(1, since=t)] == ["010081bace", "ffff5000000080"]


@pytest.mark.parametrize("channel", [2, 5])
def test_channels_have_registers_control_bits_and_pins_of_their_own(channel):
    """Section 2.5: channels from 3 on are controlled by register 60."""
    host = robust()
    base = 8 + 8 * channel
    select = {"r3": 0xF | (0 if channel > 2 else 2 << 8 + 8 * channel)}
    if channel > 2:
        select["r60"] = 2 << 8 * (channel - 3)
    load = motion(host, r5=2, r7=1 << channel, r1=3, r2=1000, **{f"r{base + 2}": 16384}, **select)
    host.run(load + 900)
    for other in range(6):
        rises, _ = host.edges("mot_step", other, since=load)
        assert rises[:3] == ([load + 7, load + 11, load + 15] if other == channel else [])
        assert len(host.edges("mot_enable", other)[1]) == (other == channel)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"profile": "document"}, "no profile 'document'"),
        ({"colour": 1}, "no profile switch 'colour'"),
        ({"channels": 0}, "1..6"),
        ({"channels": 7}, "no room for more"),
        ({"baud1": 99}, "100..3125000"),
        ({"baud2": 3_125_100}, "100..3125000"),
        ({"ints_timer": 0}, "at least 1"),
        ({"prog_words": 3000}, "powers of two"),
    ],
)
def test_parameters_are_checked(options, words):
    message = ""
    try:
        S3G(**options)
    except UsageError as error:
        message = str(error)
    gc.collect()  # what was half made, while its warning is off
    assert words in message
