"""Small faults in the twin: recordings of the original or the worked vectors find each of them."""

from functools import partial
from pathlib import Path
from unittest.mock import patch

import pytest
import test_s3g_twin as vectors
from faults import interpreted

from pulsewright.boards.s3g.golden import load

ROOM = "pulsewright.boards.s3g"
CHANNEL, PROGRAM = f"{ROOM}.twin_channel", f"{ROOM}.twin_program"
PROTOCOL, KERNEL, STATE = f"{ROOM}.twin_protocol", f"{ROOM}.twin_kernel", f"{ROOM}.twin_state"
UART = "pulsewright.twin.uart"
GOLDEN = Path(__file__).parents[1] / "golden" / "s3g"
RECORDINGS = sorted(GOLDEN.glob("*.npz"), key=lambda path: path.stat().st_size)

# Where, what is there, what comes in its place.
FOUND_BY_RECORDINGS = {
    "speed rounds towards 0": (CHANNEL, "each = doubled >> 1", "each = int(doubled / 2)"),
    "position moves with the new speed only": (
        CHANNEL,
        "channel.v + channel.sv if",
        "2 * channel.v if",
    ),
    "steps of negative speed one cycle late": (
        CHANNEL,
        "STEP_UNITS - 1 - part",
        "STEP_UNITS - part",
    ),
    "no aliasing": (CHANNEL, "((each + STEP_UNITS) & (CYCLE - 1)) - STEP_UNITS", "each"),
    "the pulse former sees a step at once": (
        CHANNEL,
        "cycle = tick + after",
        "cycle = tick + after - 1",
    ),
    "a step is taken one cycle early": (CHANNEL, "if cycle < free:", "if cycle < free - 1:"),
    "a step in the register is always taken": (CHANNEL, "channel.free <= tick", "True"),
    "remainders of a train are forgotten": (CHANNEL, "over += stride * late - rest", "over = 0"),
    "direction of a step in the register is the new one": (
        CHANNEL,
        "tick, channel.up,",
        "tick, up,",
    ),
    "POST does not count": (
        CHANNEL,
        "max(1, times.pre, times.pulse, times.post)",
        "max(1, times.pre, times.pulse)",
    ),
    "PULSE counts from PRE": (CHANNEL, "cycle + times.pulse", "cycle + times.pre + times.pulse"),
    "PRE 0 is earlier than PRE 1": (
        CHANNEL,
        "first, width, hold = max(times.pre, 1)",
        "first, width, hold = times.pre",
    ),
    "a loaded speed leaves the one before it": (
        CHANNEL,
        "channel.v = channel.sv = ",
        "channel.v = ",
    ),
    "a target outlives a load": (
        CHANNEL,
        "channel.target_set = control",
        "channel.target_set |= control",
    ),
    "the target is passed where it was hit": (CHANNEL, "v == target or v < target", "v < target"),
    "jerk takes its own change first": (
        CHANNEL,
        "channel.a + channel.j)",
        "channel.a + channel.j + channel.jj)",
    ),
    "an abort keeps the jerk": (
        CHANNEL,
        "channel.sv = v\n    channel.j = channel.jj = 0",
        "channel.sv = v",
    ),
    "an abort passes 0": (CHANNEL, "elif v >= opposite:", "elif False:"),
    "channel 1 has the bits of channel 0": (KERNEL, "+ CONTROL_BITS * c\n", "\n"),
    "a load makes a due step": (
        KERNEL,
        "next_hit(board, cycle + 1) if board.dt_limit",
        "next_hit(board, cycle) if board.dt_limit",
    ),
    "a load resets dt": (KERNEL, "if control & W_ASG_CONTROL_RESET_DT_MASK:", "if True:"),
    "the last step needs more than the limit": (
        KERNEL,
        "board.steps >= board.steps_limit",
        "board.steps > board.steps_limit",
    ),
    "ASG_ABORT is an event": (KERNEL, "board.asg_state == ABORTING and not loads", "False"),
    "CLEAR wins over an interrupt": (
        KERNEL,
        "& ~(by_host.clear | by_program.clear) | sources",
        "| sources & ~(by_host.clear | by_program.clear)",
    ),
    "times act one cycle late": (STATE, "board.times_at = cycle + 1", "board.times_at = cycle + 2"),
    "enable pins are not inverted": (STATE, "(value >> c & 1) ^ 1", "value >> c & 1"),
    "an abort has the loaded dt": (STATE, "board.abort_dt_latched == 0", "False"),
    "WAIT_ANY of nothing passes": (PROGRAM, "else held != 0", "else data == 0 or held != 0"),
    "an abort says that the program is complete": (
        PROGRAM,
        "BE_ABORTED\n        return NO_ACTIONS",
        "BE_ABORTED\n        return Actions(-1, 0, 0, 0, COMPLETE)",
    ),
    "a start while busy starts again": (
        PROGRAM,
        "if board.be_state == STOPPED:",
        "if board.be_state == STOPPED or strobes >> STB_BE_START & 1:",
    ),
    "the PC does not wrap at the memory": (
        PROGRAM,
        "board.pc & (board.words - 1)",
        "min(board.pc, board.words - 1)",
    ),
    "port 2 comes first": (PROTOCOL, "0 if byte1 == HEADER else 1", "1 if byte2 == HEADER else 0"),
    "a packet may change ports": (
        PROTOCOL,
        "byte1 if board.lock == 0 else byte2",
        "max(byte1, byte2)",
    ),
    "the shadow keeps old bytes": (PROTOCOL, "board.shadow[n] = 0", "pass"),
    "length 0 is a packet without payload": (
        PROTOCOL,
        "byte == 0 and board.length_check",
        "byte == 0",
    ),
    "the exact profile is the robust one": (
        f"{ROOM}.twin",
        "resolve_switches(MAP, profile,",
        "resolve_switches(MAP, 'robust',",
    ),
    "a reply goes at the pace of port 1": (
        PROTOCOL,
        "done = max(done, port.done)",
        "done = done or port.done",
    ),
    "a byte comes one cycle early": (PROTOCOL, "2, 3, 4\n", "2, 2, 4\n"),
    "the next decision comes one cycle early": (PROTOCOL, "2, 3, 4\n", "2, 3, 3\n"),
    "MASK leaves the timer": (
        PROTOCOL,
        "board.mask = argument(board, ARGUMENTS, 4)\n            board.timer_at = cycle + 1",
        "board.mask = argument(board, ARGUMENTS, 4)",
    ),
    "reports come one cycle early": (
        PROTOCOL,
        "cycle + 1 + board.ints_timer",
        "cycle + board.ints_timer",
    ),
    "masked interrupts are not in a report": (
        PROTOCOL,
        "add(board, board.pending, 4)",
        "add(board, board.pending & board.mask, 4)",
    ),
    "an input is read one cycle early": (PROTOCOL, "READING, cycle + 1\n", "READING, cycle\n"),
    "a copy of nothing has its own address": (
        PROTOCOL,
        "            else:\n                close_copy",
        "            else:\n                board.copy_addr = address\n                close_copy",
    ),
    "a copy outlives the next packet": (PROTOCOL, "board.invalid_from < cycle", "False"),
    "a low stop bit is no matter": (UART, "if frame & STOP else -1", ""),
    "no synchroniser": (UART, "SYNCHRONISER: Final = 2", "SYNCHRONISER: Final = 0"),
    "a bit clock without fractions": (UART, "more = 1 if rest > excess else 0", "more = 0"),
    "start bits are whole": (
        UART,
        '"start": 15, "frame": 10 * 16 - 1',
        '"start": 16, "frame": 10 * 16',
    ),
}

# The same, and the test that finds it.
FOUND_BY_VECTORS = {
    "the buffer does not wrap": (
        PROTOCOL,
        "(board.copy_place + n) % BUFFER",
        "min(board.copy_place + n, BUFFER - 1)",
        vectors.test_a_copy_longer_than_the_buffer_goes_on_at_its_head,
    ),
    "start bits are checked one enable early": (
        UART,
        '"check": 10,',
        '"check": 9,',
        partial(
            vectors.test_a_start_bit_is_checked_ten_enables_after_it_is_seen,
            10,
            ["d505010081bace34"],
        ),
    ),
    "the target keeps the acceleration": (
        CHANNEL,
        "target, signed(target - v)",
        "target, channel.a",
        partial(vectors.test_vector_14_target, 250, [(100, 100), (200, 100), (250, 50), (250, 0)]),
    ),
    "a loaded position makes steps": (
        KERNEL,
        "~bits >> SET_X & 1)",
        "1)",
        vectors.test_a_load_of_a_position_makes_no_step,
    ),
    "busy is not late": (
        STATE,
        "board.be_from < cycle",
        "board.be_from <= cycle",
        vectors.test_busy_is_one_cycle_late,
    ),
    "a program word is read at once": (
        PROGRAM,
        "board.wrote_at >= cycle - 1 and",
        "board.wrote_at >= cycle and",
        partial(vectors.test_a_program_word_is_decoded_two_cycles_after_its_write, 1, 0),
    ),
    "a program OUTPUT overtakes the host": (
        PROGRAM,
        "if bus_busy:",
        "if False:",
        partial(vectors.test_an_output_of_the_host_delays_that_of_a_program_by_a_cycle, 0, 2),
    ),
    "channel 3 has the bits of channel 0": (
        KERNEL,
        "c < CONTROL_CHANNELS",
        "True",
        vectors.test_six_channels_run_at_their_own_speeds,
    ),
    "new thresholds leave a pulse alone": (
        CHANNEL,
        "if channel.free > cycle:",
        "if False:",
        vectors.test_thresholds_work_at_once_also_inside_a_pulse,
    ),
    "time-out one cycle late": (
        PROTOCOL,
        "cycle + board.rx_timeout if",
        "cycle + 1 + board.rx_timeout if",
        vectors.test_13_a_truncated_packet_holds_the_receiver_or_is_given_up,
    ),
    "a request is dropped in the robust profile": (
        PROTOCOL,
        "board.packet_at <= cycle)",
        "board.packet_at < 0)",
        vectors.test_16_a_request_during_a_reply_is_lost_or_held,
    ),
    "the receiver goes on while it holds a request": (
        PROTOCOL,
        "board.hold_from <= cycle <= board.hold_until",
        "False",
        vectors.test_16_a_third_request_in_flight_is_lost,
    ),
    "replies always go to both ports": (
        PROTOCOL,
        "1 << board.lock if board.reply_port else BOTH",
        "BOTH",
        vectors.test_17_replies_go_to_the_port_that_asked_at_its_own_pace,
    ),
    "reset leaves registers": (
        KERNEL,
        "board.outputs[n] = 0",
        "pass",
        vectors.test_reset_brings_pins_to_rest_and_keeps_the_program,
    ),
    "upper half of positions in the robust profile": (
        KERNEL,
        "0 if board.x_sign_extended else WORD",
        "WORD",
        vectors.test_negative_positions_have_their_upper_half_in_the_robust_profile,
    ),
    "a cut byte is heard as it was": (
        UART,
        "heard[last] |= 1 << (bit - 1)",
        "pass",
        vectors.test_reset_inside_a_byte_ends_it_with_ones,
    ),
    "a host hears a byte with its start": (
        UART,
        "sampled(port, FRAME_BITS - 1) << 8",
        "sampled(port, 0) << 8",
        vectors.test_waiting_for_bytes_ends_with_them_or_at_its_limit,
    ),
}


def differs(twin_class, path):
    """Tell whether a twin does not replay a recording."""
    golden = load(path)
    twin = twin_class(bus_pins=True, **golden.settings)
    twin.schedule(golden.cycle, golden.pin, golden.level)
    twin.advance(golden.expected.end)
    return golden.expected.first_difference(twin.drain()) is not None


@pytest.mark.campaign
@pytest.mark.parametrize("fault", FOUND_BY_RECORDINGS)
def test_recordings_find(fault):
    twin_class = interpreted(ROOM, *FOUND_BY_RECORDINGS[fault]).S3GTwin
    assert any(differs(twin_class, path) for path in RECORDINGS)


@pytest.mark.campaign
@pytest.mark.parametrize("fault", FOUND_BY_VECTORS)
def test_vectors_find(fault):
    *change, test = FOUND_BY_VECTORS[fault]
    twin_class = interpreted(ROOM, *change).S3GTwin
    with patch.object(vectors, "S3GTwin", twin_class), pytest.raises(AssertionError):
        test()


@pytest.mark.campaign
def test_without_a_fault_nothing_is_found():
    twin_class = interpreted(ROOM).S3GTwin
    assert not any(differs(twin_class, path) for path in RECORDINGS)
    with patch.object(vectors, "S3GTwin", twin_class):
        for *_, test in FOUND_BY_VECTORS.values():
            test()
