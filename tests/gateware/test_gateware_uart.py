"""Serial ports: cycles by hand, from the rules of section 3.2 of the S3G board's specification."""

import numpy as np
import pytest

from pulsewright.gateware.uart import BaudGenerator, UartReceiver, UartTransmitter

pytestmark = pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable")

BIT = 16  # cycles, with an enable in every one


def cycles_where(levels):
    return np.flatnonzero(levels).tolist()


def line(start, data, stop=1):
    """Levels of a line by cycle, with one byte whose start bit begins at ``start``."""
    bits = [0, *(data >> n & 1 for n in range(8)), stop, 1]
    return {0: 1} | {start + BIT * n: level for n, level in enumerate(bits)}


def test_enables_come_where_the_sum_reaches_the_limit(simulate):
    # 5000 of 31250 is 4 of 25: the sum is 28 in cycle 7, then goes on from 3 less 25.
    seen = simulate(BaudGenerator(step=5000, limit=31250), 60, before=True)
    assert cycles_where(seen["enable"]) == [8, 14, 20, 26, 33, 39, 45, 51, 58]


def test_a_step_as_large_as_the_limit_enables_always(simulate):
    seen = simulate(BaudGenerator(step=31250, limit=31250), 9, before=True)
    assert cycles_where(seen["enable"]) == [2, 3, 4, 5, 6, 7, 8]


def test_115200_baud_is_exact_on_average(simulate):
    # 1152 of 31250 is 576 of 15625.
    seen = simulate(BaudGenerator(step=1152, limit=31250), 100 + 15625, before=True)
    enables = cycles_where(seen["enable"][100:])
    assert len(enables) == 576
    assert set(np.diff(enables)) == {27, 28}


@pytest.mark.parametrize("step", [0, 31251])
def test_a_step_must_be_in_its_range(step):
    with pytest.raises(ValueError, match=f"step must be 1 to 31250, not {step}"):
        BaudGenerator(step=step, limit=31250)


@pytest.mark.parametrize("data", [0x00, 0x01, 0x80, 0xA5, 0xFF])
def test_a_byte_is_valid_157_cycles_after_its_start_bit(simulate, data):
    seen = simulate(UartReceiver(), 300, before=True, enable=1, line=line(20, data))
    assert cycles_where(seen["valid"]) == [177]
    assert seen["data"][177] == data


def test_bytes_may_follow_each_other_at_once(simulate):
    levels = line(20, 0x35) | line(180, 0xCA)
    seen = simulate(UartReceiver(), 400, before=True, enable=1, line=dict(sorted(levels.items())))
    assert cycles_where(seen["valid"]) == [177, 337]
    assert seen["data"][[177, 337]].tolist() == [0x35, 0xCA]


def test_a_byte_with_a_bad_stop_bit_is_dropped(simulate):
    # What is left of the stop bit is no start bit, as the line is high again ten enables later.
    levels = line(20, 0x35, stop=0) | line(190, 0xCA)
    seen = simulate(UartReceiver(), 400, before=True, enable=1, line=dict(sorted(levels.items())))
    assert cycles_where(seen["valid"]) == [347]
    assert seen["data"][347] == 0xCA


@pytest.mark.parametrize(("low", "starts"), [(10, False), (11, True)])
def test_a_start_bit_is_checked_ten_enables_after_it_was_found(simulate, low, starts):
    # Found 2 cycles after the fall, at 22, and checked at 32, where the line of 30 is seen.
    seen = simulate(UartReceiver(), 300, before=True, enable=1, line={0: 1, 20: 0, 20 + low: 1})
    assert cycles_where(seen["valid"]) == ([177] if starts else [])


def test_a_receiver_stands_between_enables(simulate):
    enable = {n: int(n % 3 == 0) for n in range(700)}
    slow = {3 * cycle: level for cycle, level in line(20, 0x96).items()}
    seen = simulate(UartReceiver(), 700, before=True, enable=enable, line=slow)
    # The fall at 60 is found by the enable at 63; the stop bit is sampled 10 + 9 * 16 enables on.
    assert cycles_where(seen["valid"]) == [63 + 3 * 154 + 1]
    assert seen["data"][63 + 3 * 154 + 1] == 0x96


def test_a_byte_goes_out_lowest_bit_first(simulate):
    seen = simulate(
        UartTransmitter(), 200, before=True, enable=1, write={0: 0, 3: 1, 4: 0}, data=0xA6
    )
    levels = [1] * 4 + [bit for bit in (0, 0, 1, 1, 0, 0, 1, 0, 1, 1) for _ in range(BIT)]
    assert seen["line"][: len(levels)].tolist() == levels
    assert seen["line"][len(levels) :].all()
    assert cycles_where(seen["busy"]) == list(range(4, 164))


def test_a_start_bit_ends_with_the_16th_enable(simulate):
    enable = {n: int(n % 5 == 2) for n in range(1000)}
    seen = simulate(
        UartTransmitter(), 1000, before=True, enable=enable, write={0: 0, 3: 1, 4: 0}, data=0xFF
    )
    # Enables from the write on: 7, 12, ...; the 16th is 7 + 15 * 5.
    assert cycles_where(seen["line"] == 0) == list(range(4, 83))
    assert cycles_where(seen["busy"]) == list(range(4, 83 + 9 * 16 * 5))
