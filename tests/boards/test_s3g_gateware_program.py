"""Interrupts and program executor of the S3G gateware: cycles by hand, sections 3.5 and 4.1."""

import numpy as np
import pytest

from pulsewright.boards.s3g import registers as s3g
from pulsewright.boards.s3g.gateware_program import Interrupts, ProgramExecutor
from pulsewright.gateware.rtl import RtlSimulation

pytestmark = [
    pytest.mark.rtl,
    pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable"),
]

BUSY, WAITING = s3g.R_BE_CONTROL_BUSY_MASK, s3g.R_BE_CONTROL_WAITING_MASK
ERROR = s3g.R_BE_CONTROL_ERROR_LSB


def run(board, cycles, **inputs):
    """Return the outputs after each edge; an input is a level, or {cycle: level}."""
    rows = np.zeros(cycles, board.inputs)
    rows["cycle"] = np.arange(cycles)
    for name, levels in inputs.items():
        for cycle, level in (levels if isinstance(levels, dict) else {0: levels}).items():
            rows[name][cycle:] = level
    board.reset()
    seen = board.run(cycles, rows)
    return seen[np.searchsorted(seen["cycle"], np.arange(cycles), "right") - 1]


def pulse(*cycles, level=1):
    return {0: 0} | {n + k: level * (1 - k) for n in cycles for k in (0, 1)}


def word(kind, opcode, data):
    return kind << s3g.PROG_CLASS_LSB | opcode << s3g.PROG_OPCODE_LSB | data


def control(opcode, data=0):
    return word(s3g.CLASS_CONTROL, opcode, data)


@pytest.fixture(scope="module")
def interrupts():
    return RtlSimulation(Interrupts(repeat=5))


@pytest.fixture(scope="module")
def executor():
    return RtlSimulation(ProgramExecutor())


def test_a_source_wins_over_the_clearing_of_its_cycle(interrupts):
    seen = run(interrupts, 20, sources=pulse(5, 9), clear=pulse(9, 12))
    assert np.flatnonzero(seen["pending"]).tolist() == list(range(5, 12))


def test_reports_are_due_again_after_their_time_or_when_rearmed(interrupts):
    # A report in cycle n gives the next one in n + 6.
    seen = run(interrupts, 40, sources=pulse(3), report=pulse(10, 20), rearm=pulse(22))
    off = [*range(10, 15), 20, 21]
    assert np.flatnonzero(seen["due"]).tolist() == [n for n in range(3, 40) if n not in off]


def test_masked_interrupts_are_pending_and_not_due(interrupts):
    seen = run(interrupts, 20, sources=pulse(3, level=2), set_mask=pulse(8, 12), mask={0: 1, 10: 2})
    assert np.flatnonzero(seen["pending"] == 2).tolist() == list(range(3, 20))
    assert np.flatnonzero(seen["due"]).tolist() == [*range(3, 8), *range(12, 20)]


def test_busy_is_a_cycle_late_and_an_instruction_takes_two(executor):
    # Start in cycle 10: fetch 11, execute 12, and so on.
    seen = run(executor, 30, start=pulse(10), first=0x1234, word=control(s3g.OP_NOP))
    status = seen["status"]
    assert (status[:10] == 0).all()
    assert status[10:17].tolist() == [
        0x1234,
        *(BUSY | pc for pc in (0x1234, 0x1235, 0x1235, 0x1236, 0x1236, 0x1237)),
    ]


def test_an_end_is_an_interrupt_and_an_error_code(executor):
    done = control(s3g.OP_DONE, 0x1F7)
    for code, error in ((done, 0xF7), (control(5), 0x81), (0, 0x81), (word(3, 0, 0), 0x81)):
        seen = run(executor, 30, start=pulse(10), first=7, word=code)
        # Executed in cycle 12; `busy` from the edge of 11 to that of 13.
        assert seen["status"][10:15].tolist() == [
            *(7, BUSY | 7, BUSY | error << ERROR | 7, *[error << ERROR | 7] * 2)
        ]
        assert np.flatnonzero(seen["complete"]).tolist() == [11]


@pytest.mark.parametrize(
    ("opcode", "data", "pending", "waits"),
    [
        (s3g.OP_WAIT_ALL, 0x40000001, 0b0101, False),
        (s3g.OP_WAIT_ALL, 0x40000001, 0b0001, True),
        (s3g.OP_WAIT_ALL, 0x00000021, 0b1111, True),
        (s3g.OP_WAIT_ALL, 0, 0, False),
        (s3g.OP_WAIT_ANY, 0x40000001, 0b0100, False),
        (s3g.OP_WAIT_ANY, 0x80000002, 0b0101, True),
        (s3g.OP_WAIT_ANY, 0, 0b1111, True),
    ],
)
def test_waits(executor, opcode, data, pending, waits):
    seen = run(executor, 30, start=pulse(10), word=control(opcode, data), pending=pending)
    waiting = BUSY | WAITING | s3g.BE_WAITING << ERROR
    assert seen["status"][12] == (waiting if waits else BUSY | 1)


def test_an_output_waits_for_the_serial_one(executor):
    code = word(s3g.CLASS_OUTPUT, 42, 0x89ABCDEF)
    seen = run(executor, 30, start=pulse(10), word=code, stall={0: 0, 12: 1, 15: 0})
    # Executed in 12 to 15: the write is there after the edges of 11 to 14.
    assert np.flatnonzero(seen["write"])[:5].tolist() == [11, 12, 13, 14, 16]
    assert (seen["address"][12], seen["value"][12]) == (42, 0x89ABCDEF)
    assert seen["status"][14:16].tolist() == [BUSY, BUSY | 1]


def test_an_abort_ends_a_program_at_once(executor):
    seen = run(
        executor, 30, start=pulse(10, 15, 20), first=7, abort=pulse(20), word=control(s3g.OP_NOP)
    )
    assert seen["status"][16] == BUSY | 10  # the second start is ignored
    assert (seen["status"][20:] == s3g.BE_ABORTED << ERROR).all()
    assert not seen["complete"].any()
