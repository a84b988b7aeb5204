"""Gateware of the board's serial side: packets in, their execution, packets out."""

from __future__ import annotations

from enum import IntEnum
from typing import Final

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib.crc.catalog import CRC8_MAXIM_DOW
from amaranth.lib.wiring import Component, In, Out

from pulsewright.boards.s3g import registers

PAYLOAD_BYTES: Final = 8  # of a request that commands look at; program words are in the buffer
WORD_BYTES: Final = registers.PROG_WORD_BYTES
BUFFER_DATA: Final = 6  # where the program words of a request start
FRAME_BYTES: Final = 3  # header, length and CRC


class PacketReceiver(Component):
    """Frames in: header, length N, N bytes of payload, CRC. From two ports, one packet at a time.

    It takes the port where a header comes first, port 0 if both at once, and is deaf to the other
    one until the packet ends.

    Parameters
    ----------
    timeout : int
        A packet is given up after so many cycles without a byte; a byte in the last of them is in
        time. 0: never.
    empty_frames : bool
        N = 0 has no payload; otherwise it has 256 bytes.
    hold : bool
        A packet stays, and no byte is taken, until ``release``; otherwise it is there for a cycle.

    Members
    -------
    valid : In(2), data0, data1 : In(8)
        Bytes from the ports.
    deaf : In(1)
        Take no byte in this cycle.
    release : In(1)
        Bytes are taken again from the next cycle on. Only with ``hold``.
    done, error : Out(1)
        A packet with a good or a bad CRC, from the cycle after its last byte on.
    port : Out(1)
        Where it came from.
    size : Out(8)
        N.
    payload : Out(8 * 8)
        First bytes of the payload, 0 where it is shorter. Gone with the length of the next packet.
    store : Out(1), index : Out(8), byte : Out(8)
        Payload for a buffer: write ``byte`` at ``index``.
    intact : Out(1)
        The buffer holds the last good packet, and nothing of another one.
    """

    def __init__(self, *, timeout: int = 0, empty_frames: bool = False, hold: bool = False) -> None:
        self._timeout, self._empty_frames, self._hold = timeout, empty_frames, hold
        super().__init__(
            {
                "valid": In(2),
                "data0": In(8),
                "data1": In(8),
                "deaf": In(1),
                "release": In(1),
                "done": Out(1),
                "error": Out(1),
                "port": Out(1),
                "size": Out(8),
                "payload": Out(8 * PAYLOAD_BYTES),
                "store": Out(1),
                "index": Out(8),
                "byte": Out(8),
                "intact": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.crc = crc = CRC8_MAXIM_DOW(data_width=8).create()
        header = Signal(2)
        taken = Signal()
        next_index = Signal(8)
        m.d.comb += [
            header.eq(
                Cat(
                    self.valid[n] & (data == registers.HEADER)
                    for n, data in enumerate((self.data0, self.data1))
                )
            ),
            self.byte.eq(Mux(self.port, self.data1, self.data0)),
            taken.eq(Mux(self.port, self.valid[1], self.valid[0]) & ~self.deaf),
            next_index.eq(self.index + 1),
            crc.data.eq(self.byte),
        ]
        if not self._hold:
            m.d.sync += [self.done.eq(0), self.error.eq(0)]

        expired = Signal()
        with m.FSM() as fsm:
            with m.State("INIT"), m.If(header.any() & ~self.deaf):
                m.d.sync += self.port.eq(~header[0])
                m.next = "LENGTH"
            with m.State("LENGTH"):
                m.d.comb += crc.start.eq(taken)
                with m.If(taken):
                    m.d.sync += [
                        self.size.eq(self.byte),
                        self.payload.eq(0),
                        self.index.eq(0),
                        self.intact.eq(0),
                    ]
                    m.next = "DATA"
                    if self._empty_frames:
                        with m.If(self.byte == 0):
                            m.next = "CRC"
                with m.Elif(expired):
                    m.next = "INIT"
            with m.State("DATA"):
                m.d.comb += [crc.valid.eq(taken), self.store.eq(taken)]
                with m.If(taken):
                    m.d.sync += self.index.eq(next_index)
                    for n in range(PAYLOAD_BYTES):
                        with m.If(self.index == n):
                            m.d.sync += self.payload.word_select(n, 8).eq(self.byte)
                    with m.If(next_index == self.size):
                        m.next = "CRC"
                with m.Elif(expired):
                    m.next = "INIT"
            with m.State("CRC"):
                with m.If(taken):
                    good = self.byte == crc.crc
                    m.d.sync += [self.done.eq(good), self.error.eq(~good), self.intact.eq(good)]
                    m.next = "HELD" if self._hold else "INIT"
                with m.Elif(expired):
                    m.next = "INIT"
            if self._hold:
                with m.State("HELD"), m.If(self.release):
                    m.d.sync += [self.done.eq(0), self.error.eq(0)]
                    m.next = "INIT"

        if self._timeout:
            left = Signal(range(self._timeout), init=self._timeout - 1)
            m.d.comb += expired.eq(left == 0)
            m.d.sync += left.eq(left - 1)
            with m.If(taken | fsm.ongoing("INIT")):
                m.d.sync += left.eq(self._timeout - 1)
        return m


class PacketSender(Component):
    """Frames out: header, length, payload, CRC; byte by byte to one port or both.

    A byte goes out when every port is done with the one before, three cycles after the end of its
    stop bit.

    Members
    -------
    start : In(1)
        Send a packet; the header goes out in the next cycle. Only while ``idle``.
    ports : In(2)
        Where to; steady while the packet is sent.
    size : In(4)
        Bytes of payload, 1 to 13; steady.
    position : Out(4)
        Byte of the packet that goes out; the payload starts at 2.
    byte : In(8)
        Byte of the payload at ``position``.
    write : Out(2), data : Out(8)
        To the ports.
    busy : In(2)
        The ports send.
    idle : Out(1)
        From the third cycle after the last stop bit on.
    """

    def __init__(self) -> None:
        super().__init__(
            {
                "start": In(1),
                "ports": In(2),
                "size": In(4),
                "position": Out(4),
                "byte": In(8),
                "write": Out(2),
                "data": Out(8),
                "busy": In(2),
                "idle": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.crc = crc = CRC8_MAXIM_DOW(data_width=8).create()
        last = self.position == self.size + FRAME_BYTES - 1
        m.d.comb += crc.data.eq(self.byte)
        with m.If(self.position == 0):
            m.d.comb += self.data.eq(registers.HEADER)
        with m.Elif(self.position == 1):
            m.d.comb += self.data.eq(self.size)
        with m.Elif(last):
            m.d.comb += self.data.eq(crc.crc)
        with m.Else():
            m.d.comb += self.data.eq(self.byte)

        with m.FSM():
            with m.State("IDLE"):
                m.d.comb += [self.idle.eq(1), crc.start.eq(1)]
                with m.If(self.start):
                    m.next = "WRITE"
            with m.State("WRITE"):
                m.d.comb += [self.write.eq(self.ports), crc.valid.eq(self.position[1:].any())]
                m.next = "WAIT"
            with m.State("WAIT"), m.If(~self.busy.any()):
                m.next = "PAUSE"
            with m.State("PAUSE"):
                m.next = "NEXT"
            with m.State("NEXT"):
                m.d.sync += self.position.eq(Mux(last, 0, self.position + 1))
                m.next = "WRITE"
                with m.If(last):
                    m.next = "IDLE"
        return m


class Reply(IntEnum):
    """What the board sends."""

    OK = 0
    VERSION = 1
    EXT_VER = 2
    INPUT = 3
    WRITE_BUFFER = 4
    BUF_ERROR = 5
    ERROR = 6
    UNKNOWN = 7
    REPORT = 8


_CODE: Final = {
    Reply.BUF_ERROR: registers.REPLY_BUF_ERROR,
    Reply.ERROR: registers.REPLY_ERROR,
    Reply.UNKNOWN: registers.REPLY_UNKNOWN,
    Reply.REPORT: registers.REPLY_INTERRUPT,
}  # and all others: OK
# Bytes that a command needs, with its tag and code; the words of a program are more.
_NEEDS: Final = {
    registers.CMD_VERSION: 3,
    registers.CMD_EXT_VER: 3,
    registers.CMD_OUTPUT: 8,
    registers.CMD_INPUT: 4,
    registers.CMD_STB: 7,
    registers.CMD_CLEAR: 7,
    registers.CMD_MASK: 7,
    registers.CMD_WRITE_BUFFER: 6,
}
# Commands that are done in one cycle and answered with OK alone.
_ACTIONS: Final = (
    registers.CMD_OUTPUT,
    registers.CMD_STB,
    registers.CMD_CLEAR,
    registers.CMD_MASK,
)


class SerialExecutor(Component):
    """Executes packets, and sends replies and reports; the board's SE.

    It looks at ``done``, ``error`` and ``due``, in this order, while nothing else is under way. A
    command acts in that cycle, D; ``start`` is D + 1, for INPUT D + 3, for WRITE_BUFFER
    D + 1 + 6 * words.

    Parameters
    ----------
    address_bits : int
        Of program memory.
    length_check : bool
        Commands that lack arguments are errors.
    reply_to_asker : bool
        Replies go to the port of the request only; reports go to both.

    Members
    -------
    done, error, port, size, payload, intact
        From the `PacketReceiver`.
    release : Out(1)
        The packet has been used; in the cycle before ``start``.
    copying : Out(1)
        The buffer is being read.
    buffer_index : Out(8), buffer_byte : In(8)
        Reads the buffer; the byte comes in the next cycle.
    program_write : Out(1), program_address : Out(address_bits), program_word : Out(40)
        Writes program memory.
    write : Out(1), address : Out(6), value : Out(32)
        Writes an output register.
    mask : Out(32)
        Argument of STB, CLEAR and MASK.
    strobe, clear, set_mask : Out(1)
        What to do with it in this cycle.
    due, report : In(1), Out(1)
        A report is due; it is made in this cycle.
    pending : In(32)
        What a report says.
    dt, steps, status, loop_back : In(32)
        Input registers.
    start, ports, reply_size, position, byte, idle
        To and from the `PacketSender`.
    """

    def __init__(
        self, *, address_bits: int, length_check: bool = False, reply_to_asker: bool = False
    ) -> None:
        self._length_check, self._reply_to_asker = length_check, reply_to_asker
        super().__init__(
            {
                "done": In(1),
                "error": In(1),
                "port": In(1),
                "size": In(8),
                "payload": In(8 * PAYLOAD_BYTES),
                "intact": In(1),
                "release": Out(1),
                "copying": Out(1),
                "buffer_index": Out(8, init=BUFFER_DATA),
                "buffer_byte": In(8),
                "program_write": Out(1),
                "program_address": Out(address_bits),
                "program_word": Out(8 * WORD_BYTES),
                "write": Out(1),
                "address": Out(6),
                "value": Out(32),
                "mask": Out(32),
                "strobe": Out(1),
                "clear": Out(1),
                "set_mask": Out(1),
                "due": In(1),
                "report": Out(1),
                "pending": In(32),
                "dt": In(32),
                "steps": In(32),
                "status": In(32),
                "loop_back": In(32),
                "start": Out(1),
                "ports": Out(2),
                "reply_size": Out(4),
                "position": In(4),
                "byte": Out(8),
                "idle": In(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()

        def argument(first: int, count: int) -> Value:
            return self.payload[8 * first : 8 * (first + count)]

        code, count, address = argument(2, 1), argument(3, 1), argument(4, 2)
        m.d.comb += [
            self.address.eq(argument(3, 1)),
            self.value.eq(argument(4, 4)),
            self.mask.eq(argument(3, 4)),
        ]
        reply = Signal(Reply)
        sent_address = Signal(16)  # of the last WRITE_BUFFER
        words = Signal(8)
        phase = Signal(range(WORD_BYTES + 1))
        bytes_ = Signal(8 * (WORD_BYTES - 1))
        m.d.sync += bytes_.eq(Cat(bytes_[8:], self.buffer_byte))
        m.d.comb += self.program_word.eq(Cat(bytes_, self.buffer_byte))

        def answer(kind: Reply | None = None) -> None:
            if kind is not None:
                m.d.sync += reply.eq(kind)
            m.d.comb += self.release.eq(1)
            m.next = "DELAY"

        accept = Signal()  # a good packet is executed in this cycle
        with m.FSM() as fsm:
            with m.State("INIT"):
                m.d.sync += [
                    self.buffer_index.eq(BUFFER_DATA),
                    phase.eq(0),
                    words.eq(count),
                    self.program_address.eq(address),
                    self.ports.eq(Cat(~self.port, self.port) if self._reply_to_asker else 3),
                ]
                with m.If(self.error | self.done & self._too_short(code, count)):
                    answer(Reply.ERROR)
                with m.Elif(self.done & self._nothing()):
                    answer(Reply.OK)
                with m.Elif(self.done):
                    m.d.comb += accept.eq(1)
                    with m.Switch(code):
                        with m.Case(registers.CMD_VERSION):
                            answer(Reply.VERSION)
                        with m.Case(registers.CMD_EXT_VER):
                            answer(Reply.EXT_VER)
                        with m.Case(registers.CMD_INPUT):
                            m.d.sync += reply.eq(Reply.INPUT)
                            m.next = "INPUT"
                        with m.Case(registers.CMD_WRITE_BUFFER):
                            m.d.sync += sent_address.eq(address)
                            with m.If(count == 0):
                                answer(Reply.WRITE_BUFFER)
                            with m.Else():
                                m.d.sync += [
                                    reply.eq(Reply.WRITE_BUFFER),
                                    self.buffer_index.eq(BUFFER_DATA + 1),
                                ]
                                m.next = "COPY"
                        with m.Case(*_ACTIONS):
                            answer(Reply.OK)
                        with m.Default():
                            answer(Reply.UNKNOWN)
                with m.Elif(self.due):
                    m.d.comb += self.report.eq(1)
                    m.d.sync += self.ports.eq(3)
                    answer(Reply.REPORT)
            with m.State("INPUT"):
                m.next = "INPUT_DONE"
            with m.State("INPUT_DONE"):
                answer()
            with m.State("COPY"):
                # The byte asked for in a phase comes in the next one, the first word's first byte
                # in phase 0. Written in phase 4, a word is there for programs as if it were written
                # in the phase after that: they read memory a cycle early.
                with m.If(phase != WORD_BYTES - 1):
                    m.d.sync += self.buffer_index.eq(self.buffer_index + 1)
                with m.Elif(self.intact):
                    m.d.comb += self.program_write.eq(1)
                with m.Else():
                    answer(Reply.BUF_ERROR)
                m.d.sync += phase.eq(phase + 1)
                with m.If(phase == WORD_BYTES):
                    m.d.sync += [
                        phase.eq(0),
                        words.eq(words - 1),
                        self.program_address.eq(self.program_address + 1),
                    ]
                    with m.If(words == 1):
                        answer()
            with m.State("DELAY"):
                m.d.comb += self.start.eq(1)
                m.next = "BUSY"
            with m.State("BUSY"), m.If(self.idle):
                m.next = "INIT"

        m.d.comb += [
            self.copying.eq(fsm.ongoing("COPY")),
            self.write.eq(accept & (code == registers.CMD_OUTPUT)),
            self.strobe.eq(accept & (code == registers.CMD_STB)),
            self.clear.eq(accept & (code == registers.CMD_CLEAR)),
            self.set_mask.eq(accept & (code == registers.CMD_MASK)),
        ]

        # What a reply says is as it was in the cycle before `start`, or two before for INPUT.
        tag, said_address, said = Signal(16), Signal(16), Signal(32)
        with m.If(fsm.ongoing("INIT") | self.copying):
            m.d.sync += [tag.eq(argument(0, 2)), said_address.eq(sent_address)]
        with m.If(self.report):
            m.d.sync += said.eq(self.pending)
        with m.Elif(fsm.ongoing("INIT") | self.copying):
            m.d.sync += said.eq(self.status)
        with m.Elif(fsm.ongoing("INPUT")), m.Switch(argument(3, 1)[:6]):
            for number, value in (
                (registers.R_ASG_DT, self.dt),
                (registers.R_ASG_STEP, self.steps),
                (registers.R_BE_CONTROL, self.status),
                (registers.R_SE_REG_LB, self.loop_back),
            ):
                with m.Case(number):
                    m.d.sync += said.eq(value)
            with m.Default():
                m.d.sync += said.eq(0)

        report = Const(0xFF, 8) & (reply == Reply.REPORT).replicate(8)
        m.d.comb += self.reply_size.eq(3)
        with m.Switch(self.position):
            with m.Case(2):
                m.d.comb += self.byte.eq(tag[:8] | report)
            with m.Case(3):
                m.d.comb += self.byte.eq(tag[8:] | report)
            with m.Case(4), m.Switch(reply):
                for kind, reply_code in _CODE.items():
                    with m.Case(kind):
                        m.d.comb += self.byte.eq(reply_code)
                with m.Default():
                    m.d.comb += self.byte.eq(registers.REPLY_OK)
        four = [said.word_select(n, 8) for n in range(4)]
        two = [said_address[:8], said_address[8:]]
        written = [*two, four[registers.R_BE_CONTROL_ERROR_LSB // 8], *four[:2]]
        ext_version = registers.EXT_VERSION_LOW | registers.EXT_VERSION_HIGH << 32
        arguments: dict[Reply, list[Value]] = {
            Reply.VERSION: [Const(byte, 8) for byte in registers.VERSION.to_bytes(2, "little")],
            Reply.EXT_VER: [Const(byte, 8) for byte in ext_version.to_bytes(8, "little")],
            Reply.INPUT: four,
            Reply.REPORT: four,
            Reply.WRITE_BUFFER: written,
            Reply.BUF_ERROR: written,
        }
        for kind, values in arguments.items():
            with m.If(reply == kind):
                m.d.comb += self.reply_size.eq(3 + len(values))
                for n, value in enumerate(values):
                    with m.If(self.position == 5 + n):
                        m.d.comb += self.byte.eq(value)
        return m

    def _too_short(self, code: Value, count: Value) -> Value:
        """Return whether a packet lacks arguments."""
        if not self._length_check:
            return Const(0)
        short: Value = self.size < min(_NEEDS.values())
        for needs in sorted(set(_NEEDS.values()))[1:]:
            commands = [command for command, n in _NEEDS.items() if n == needs]
            short |= code.matches(*commands) & (self.size < needs)
        words = BUFFER_DATA + WORD_BYTES * count > self.size
        return short | (code == registers.CMD_WRITE_BUFFER) & words

    def _nothing(self) -> Value:
        """Return whether a packet is answered without being executed."""
        return Const(0) if self._length_check else self.size == 0
