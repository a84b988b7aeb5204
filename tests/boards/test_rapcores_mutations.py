"""Small faults in the twin: the worked vectors find each of them."""

from functools import partial
from unittest.mock import patch

import pytest
import test_rapcores_twin as vectors
import test_rapcores_twin_bridge as windings
from faults import interpreted

ROOM = "pulsewright.boards.rapcores"
MOTOR, SPI, KERNEL = f"{ROOM}.twin_motor", f"{ROOM}.twin_spi", f"{ROOM}.twin_kernel"
BRIDGE = f"{ROOM}.twin_bridge"
MESSAGE, ORIGINAL, STATE = f"{ROOM}.twin_message", f"{ROOM}.twin_original", f"{ROOM}.twin_state"

# Where, what is there, what comes in its place, and the test that finds it.
FAULTS = {
    "a pulse is one cycle longer": (
        MOTOR,
        "fall = cycle + width",
        "fall = cycle + width + 1",
        vectors.test_steps_follow_the_ticks_that_cross_them,
    ),
    "direction setup is not kept": (
        MOTOR,
        "motor.setup = cycle + times.setup",
        "motor.setup = cycle",
        vectors.test_7_a_reversal_between_chained_moves,
    ),
    "owed pulses are kept in a halt": (
        KERNEL,
        "motor.position -= motor.backlog + motor.delta",
        "pass",
        vectors.test_17a_owed_pulses_are_taken_back,
    ),
    "a full buffer takes moves": (
        MESSAGE,
        "room = board.used < board.depth",
        "room = True",
        vectors.test_9_a_third_move_is_refused,
    ),
    "a partial word stays": (
        KERNEL,
        "spi.count = spi.partial = 0",
        "pass",
        vectors.test_15_a_cut_word_is_dropped,
    ),
    "halt is forgotten with its release": (
        KERNEL,
        "board.halt_seen = 1",
        "board.halt_seen = 0",
        vectors.test_17_halt_ends_moves_until_it_is_cleared,
    ),
    "a fault is inverted": (
        MESSAGE,
        "value = board.fault",
        "value = ~board.fault",
        partial(vectors.test_12_both_signals_at_once_are_a_fault, "document", 2),
    ),
    "a tick in the load cycle counts": (
        KERNEL,
        "begin_piece(s, cycle + 1)",
        "begin_piece(s, cycle)",
        vectors.test_6_half_a_step_per_clock,
    ),
    "the original always has its own word": (
        ORIGINAL,
        "motor.increment += board.increment[board.slot, i]",
        "motor.increment += board.change[board.slot, i]",
        partial(
            vectors.test_18_and_19_a_tick_in_the_load_cycle_is_lost,
            0,
            [(0, 0, -1, 0), (-1, 0, -1, 0), (-1, 1, -2, 1), (-1, 0, -2, 1)],
        ),
    ),
    "half a step is not lost in 0.2": (
        ORIGINAL,
        "motor.fraction -= IDLE_LOSS",
        "motor.fraction -= 1",
        vectors.test_a4_steps_follow_the_sign_of_the_accumulator,
    ),
    "velocity counts one more": (
        KERNEL,
        "cycle - encoder.last - 1",
        "cycle - encoder.last",
        partial(vectors.test_11_encoder_counts_and_velocities, "document"),
    ),
    "a train goes on while steps get longer": (
        MOTOR,
        "if longest > fewest + 2:",
        "if longest > fewest + 900:",
        vectors.test_steps_follow_the_ticks_that_cross_them,
    ),
    "a train does not get faster": (
        MOTOR,
        "speed += fewest * gain",
        "speed += fewest",
        vectors.test_steps_follow_the_ticks_that_cross_them,
    ),
    "an even train goes on too far": (
        MOTOR,
        "/ ONE + MARGIN",
        "/ ONE + 1.9",
        vectors.test_steps_follow_the_ticks_that_cross_them,
    ),
    "every step of an even train is as long": (
        MOTOR,
        "cycle += jump + (period & late)",
        "cycle += jump",
        vectors.test_steps_follow_the_ticks_that_cross_them,
    ),
    "a word acts one cycle late": (
        SPI,
        "FLAG: Final = 4",
        "FLAG: Final = 5",
        vectors.test_10_a_move_of_no_time,
    ),
    "a period begins a cycle late": (
        BRIDGE,
        "LATENCY: Final = 2",
        "LATENCY: Final = 3",
        partial(windings.test_windings_are_driven_in_the_middle_of_periods, 128, 100, 142, 141),
    ),
    "half a cycle is cut off": (
        BRIDGE,
        "HALF: Final = SCALE // 2",
        "HALF: Final = 0",
        partial(windings.test_windings_are_driven_in_the_middle_of_periods, 128, 100, 142, 141),
    ),
    "B has the sign of A": (
        BRIDGE,
        "return (0 if phase & TURN // 2",
        "return (0 if sample & TURN // 2",
        partial(windings.test_windings_are_driven_in_the_middle_of_periods, 384, 100, 141, -142),
    ),
    "motors are looked at one after the other too soon": (
        BRIDGE,
        "LOOK: Final = 16",
        "LOOK: Final = 17",
        partial(windings.test_a_motor_is_looked_at_once_in_a_frame, 2, 1, 496),
    ),
    "a tick is seen in its own cycle": (
        BRIDGE,
        "due, late = (cycle - 1 - first)",
        "due, late = (cycle - first)",
        partial(windings.test_windings_follow_any_motion, 1, 1),
    ),
    "increments that wrap are summed up": (
        BRIDGE,
        "if wraps or not",
        "if not",
        partial(windings.test_windings_follow_any_motion, 1, 1),
    ),
    "windings follow enable a cycle late": (
        BRIDGE,
        "bridge.change_at = cycle + 1",
        "bridge.change_at = cycle + 2",
        partial(windings.test_without_enable_windings_are_open_or_braked, 0, windings.COAST),
    ),
    "a motor that is off is looked at too late": (
        BRIDGE,
        "// PWM_CYCLES - KEPT, 0)",
        "// PWM_CYCLES, 0)",
        partial(windings.test_a_motor_that_moved_while_it_was_off_is_where_it_is, 32),
    ),
    "owed steps are taken back a cycle early in windings": (
        KERNEL,
        "advance_bridge(s, i, cycle + 1, motor.done)",
        "pass",
        partial(windings.test_owed_steps_are_there_up_to_the_first_halted_cycle, 0, 194),
    ),
    "a current outlives a reset": (
        KERNEL,
        "board.current[i] = 0",
        "pass",
        windings.test_currents_are_registers_of_8_bits_that_are_0_at_first,
    ),
}


@pytest.mark.campaign
@pytest.mark.parametrize("fault", FAULTS)
def test_vectors_find(fault):
    *change, test = FAULTS[fault]
    twin_class = interpreted(ROOM, *change).RapcoresTwin
    with patch.object(vectors, "RapcoresTwin", twin_class), pytest.raises(AssertionError):
        test()


@pytest.mark.campaign
def test_without_a_fault_nothing_is_found():
    twin_class = interpreted(ROOM).RapcoresTwin
    with patch.object(vectors, "RapcoresTwin", twin_class):
        for *_, test in FAULTS.values():
            test()
