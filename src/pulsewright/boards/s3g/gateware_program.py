"""Gateware of the board's interrupts and of its program executor."""

from __future__ import annotations

from typing import Final

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib.wiring import Component, In, Out

from pulsewright.boards.s3g import registers

# The interrupts and strobes that there are; a mask keeps these bits of a word.
INTERRUPTS: Final = (
    registers.INT_ASG_DONE,
    registers.INT_ASG_ABORT,
    registers.INT_BE_COMPLETE,
    registers.INT_SE_INT_LB,
)
STROBES: Final = (
    registers.STB_ASG_LOAD,
    registers.STB_BE_START,
    registers.STB_BE_ABORT,
    registers.STB_SE_INT_LB,
)
OPCODE_LSB: Final = registers.PROG_OPCODE_LSB
CLASS_LSB: Final = registers.PROG_CLASS_LSB


def picked(word: Value, bits: tuple[int, ...]) -> Value:
    """Return some bits of a word, close together."""
    return Cat(word[bit] for bit in bits)


def placed(value: Value, bits: tuple[int, ...]) -> Value:
    """Return a word of 32 bits with the bits of a value at these places."""
    return Cat(value[bits.index(bit)] if bit in bits else Const(0, 1) for bit in range(32))


class Interrupts(Component):
    """Pending interrupts, their mask, and when to report them.

    Vectors have a bit per interrupt, in the order of `INTERRUPTS`.

    Parameters
    ----------
    repeat : int
        Cycles after a report in which there is no other, at least 1.

    Members
    -------
    sources : In(4)
        Set a bit; wins over ``clear``.
    clear : In(4)
    pending : Out(4)
    set_mask : In(1), mask : In(4)
        Which ones may be reported, 1 = may; all after reset.
    rearm : In(1)
        The next report need not wait.
    report : In(1)
        A report is made in this cycle.
    due : Out(1)
        A report can be made in this cycle.
    """

    def __init__(self, *, repeat: int) -> None:
        if repeat < 1:
            raise ValueError(f"repeat must be at least 1, not {repeat}")
        self._repeat = repeat
        each = len(INTERRUPTS)
        super().__init__(
            {
                "sources": In(each),
                "clear": In(each),
                "pending": Out(each),
                "set_mask": In(1),
                "mask": In(each),
                "rearm": In(1),
                "report": In(1),
                "due": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        mask = Signal.like(self.mask, init=~0)
        # Counts down to -1 and stays there, so that its sign says that it has run out.
        timer = Signal((self._repeat - 1).bit_length() + 1, init=~0)
        m.d.comb += self.due.eq((self.pending & mask).any() & timer[-1])
        m.d.sync += self.pending.eq(self.pending & ~self.clear | self.sources)
        with m.If(self.set_mask):
            m.d.sync += mask.eq(self.mask)
        with m.If(self.rearm):
            m.d.sync += timer.eq(~0)
        with m.Elif(self.report):
            m.d.sync += timer.eq(self._repeat - 1)
        with m.Elif(~timer[-1]):
            m.d.sync += timer.eq(timer - 1)
        return m


class ProgramExecutor(Component):
    """Runs the program in program memory; the board's BE.

    An instruction takes a cycle to fetch and one or more to execute. A wait reads its own word
    again in every cycle.

    Members
    -------
    start, abort : In(1)
        Strobes. A start is ignored while a program runs; an abort wins.
    first : In(16)
        Where a program starts.
    read_address : Out(16), word : In(40)
        Reads program memory; the word comes in the next cycle, and is executed in the one after it.
    pending : In(4)
        Interrupts.
    stall : In(1)
        No output register can be written in this cycle.
    write : Out(1), address : Out(6), value : Out(32)
        Writes an output register.
    strobe, clear : Out(1)
        Give the strobes, or clear the interrupts, in ``value``.
    complete : Out(1)
        A program ends in this cycle, and not by ``abort``.
    status : Out(32)
        Input register BE_CONTROL.
    """

    def __init__(self) -> None:
        super().__init__(
            {
                "start": In(1),
                "abort": In(1),
                "first": In(16),
                "read_address": Out(16),
                "word": In(CLASS_LSB + 2),
                "pending": In(len(INTERRUPTS)),
                "stall": In(1),
                "write": Out(1),
                "address": Out(6),
                "value": Out(32),
                "strobe": Out(1),
                "clear": Out(1),
                "complete": Out(1),
                "status": Out(32),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        # Memory is slow, so its word goes to a register, with what takes many bits to know.
        kind, opcode = self.word[CLASS_LSB:], self.word[OPCODE_LSB:CLASS_LSB]
        fetched = self.word[:OPCODE_LSB]
        is_control = kind == registers.CLASS_CONTROL

        def marked(condition: Value) -> Signal:
            mark = Signal()
            m.d.sync += mark.eq(condition)
            return mark

        output = marked(kind == registers.CLASS_OUTPUT)
        strobe = marked(is_control & (opcode == registers.OP_STB))
        wait_all = marked(is_control & (opcode == registers.OP_WAIT_ALL))
        wait_any = marked(is_control & (opcode == registers.OP_WAIT_ANY))
        clear = marked(is_control & (opcode == registers.OP_CLEAR))
        nop = marked(is_control & (opcode == registers.OP_NOP))
        done = marked(is_control & (opcode == registers.OP_DONE))
        others = marked(Cat(fetched[bit] for bit in range(32) if bit not in INTERRUPTS).any())
        m.d.sync += [self.address.eq(opcode), self.value.eq(fetched)]

        pc, next_pc = Signal(16), Signal(16)
        error, busy, waiting = Signal(8), Signal(), Signal()
        run, decode = Signal(), Signal()  # a program runs; its word is there
        wanted = picked(self.value, INTERRUPTS)
        goes_on = output | strobe | wait_all | wait_any | clear | nop
        execute = decode & ~self.abort
        wait = Signal()
        m.d.comb += [
            wait.eq(
                wait_all & ((wanted & ~self.pending).any() | others)
                | wait_any & ~(wanted & self.pending).any()
            ),
            self.write.eq(execute & output),
            self.strobe.eq(execute & strobe),
            self.clear.eq(execute & clear),
            self.complete.eq(execute & ~goes_on),
            self.status.eq(Cat(pc, error, Const(0, 6), waiting, busy)),
            next_pc.eq(pc),
            self.read_address.eq(next_pc),
        ]

        m.d.sync += [busy.eq(run), decode.eq(run & ~decode), pc.eq(next_pc)]
        with m.If(decode):
            m.d.sync += [waiting.eq(wait), error.eq(Mux(wait, registers.BE_WAITING, 0))]
            with m.If(~goes_on):
                m.d.sync += [
                    run.eq(0),
                    error.eq(Mux(done, self.value[:8], registers.BE_ILLEGAL)),
                ]
            with m.Elif(wait | output & self.stall):
                m.d.sync += decode.eq(1)
            with m.Else():
                m.d.comb += next_pc.eq(pc + 1)
        with m.If(self.start & ~run):
            m.d.comb += next_pc.eq(self.first)
            m.d.sync += [run.eq(1), error.eq(registers.BE_RUNNING)]
        with m.If(self.abort):
            m.d.sync += [
                run.eq(0),
                decode.eq(0),
                busy.eq(0),
                waiting.eq(0),
                pc.eq(0),
                error.eq(registers.BE_ABORTED),
            ]
        return m
