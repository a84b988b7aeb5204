"""Profile `document` of the RAPcores specification, one clock edge at a time, in plain Python.

Written from the tables of the specification, register by register, without a thought of speed:
`Reference.clock` takes the levels of the input pins in a cycle and does the edge that ends it.
"""

from dataclasses import dataclass, field

RESET_CYCLES = 255
TELEMETRY = range(32)


def wrap(value, bits):
    """Return the low bits of a value as a signed number."""
    half = 1 << (bits - 1)
    return (value + half) % (1 << bits) - half


@dataclass
class Motor:
    acc: int = 0
    inc: int = 0
    incinc: int = 0
    q: int = 0
    backlog: int = 0
    step: int = 0
    dir: int = 0
    tw: int = 0
    tl: int = 0
    th: int = 0
    tg: int = 0
    lost: int = 0


@dataclass
class Encoder:
    a: list = field(default_factory=lambda: [0, 0, 0])
    b: list = field(default_factory=lambda: [0, 0, 0])
    position: int = 0
    velocity: int = 0
    v: int = 0


@dataclass
class Slot:
    duration: int = 0
    inc: list = field(default_factory=lambda: [0] * 32)
    incinc: list = field(default_factory=lambda: [0] * 32)


class Reference:
    """The board; ``outputs`` are what its pins show in the present cycle."""

    def __init__(self, motors=4, encoders=4, bits=64, depth=2, cs_reset_message=1, v020_info=0):
        self.N, self.E, self.W, self.depth = motors, encoders, bits, depth
        self.F = bits - 1
        self.cs_reset_message, self.v020_info = cs_reset_message, v020_info
        self.sck = [0, 0, 0]
        self.encoders = [Encoder() for _ in range(encoders)]
        self.counter = 0
        self.reset()

    def reset(self):
        self.cs, self.copi, self.halt = [1, 1], [0, 0], [1, 1]
        self.cs_before = 1
        self.tn, self.rb, self.bc, self.rw = 7, 0, 0, 0
        self.byte_flag = self.byte_before = self.word_flag = self.word_before = 0
        self.frame_end = []  # [cycles left, part]
        self.header, self.k, self.address, self.reply, self.accept = None, 0, 0, 0, 0
        self.config = dict.fromkeys(range(256), 0) | {2: 40, 0xC0: 20, 0xC1: 20, 0xC2: 20, 0xC3: 20}
        self.counters = dict.fromkeys(range(0xE2, 0xE7), 0)
        self.tick_counter = 0
        self.run = self.left = self.w = self.m = self.use = self.done = self.halt_seen = 0
        self.slots = [Slot() for _ in range(self.depth)]
        self.telemetry = [0] * (2 * self.E)
        self.snapshot = [0] * (2 * self.E)
        self.fault = 0
        self.motors = [Motor() for _ in range(self.N)]
        for encoder in self.encoders:
            encoder.position = encoder.velocity = encoder.v = 0

    # -------------------------------------------------------------------------------------- outputs

    @property
    def in_reset(self):
        return self.counter < RESET_CYCLES

    @property
    def halted(self):
        return self.halt[1] == 0 or self.config[0xC4] & 1 == 1

    def outputs(self):
        c = self.config
        pins = {
            "cipo": self.reply >> (8 * self.bc + self.tn) & 1 if self.cs[1] == 0 else 0,
            "buffer_dtr": int(self.use < self.depth and not self.halted and not self.halt_seen),
            "move_done": self.done,
        }
        for i, motor in enumerate(self.motors):
            pins[f"step{i}"] = motor.step ^ (c[0xC6] >> i & 1)
            pins[f"dir{i}"] = motor.dir ^ (c[0xC7] >> i & 1)
            pins[f"en{i}"] = c[0] >> i & 1
        return pins

    def position(self, i):
        """Return the integer part of an accumulator."""
        return self.motors[i].acc >> self.F

    # -------------------------------------------------------------------------------------- a clock

    def clock(self, pins):
        """Do the edge at the end of a cycle in which the input pins have the levels ``pins``."""
        counter = 0 if not pins["rst_n"] else min(self.counter + 1, RESET_CYCLES)
        if self.in_reset:
            self.reset()
        else:
            self._clock(pins)
        self.sck = [pins["sck"], *self.sck[:2]]
        for e, encoder in enumerate(self.encoders):
            encoder.a = [pins[f"enc{e}_a"], *encoder.a[:2]]
            encoder.b = [pins[f"enc{e}_b"], *encoder.b[:2]]
        self.counter = counter

    def _clock(self, pins):
        # from old values: what the sequencer, the encoders and the pulse formers would do
        tick = self.tick_counter >= self.config[2] & 0xFF
        halted, run = self.halted, self.run
        word_event = self.word_flag and not self.word_before
        telemetry = self._encoder_registers()
        load = None
        arm, writes, clears = 0, {}, 0
        events = dict.fromkeys(self.counters, 0)
        lost, fault = 0, 0

        if word_event:
            arm, writes, clears = self._message(events)

        # 4.5 pulse former, from old values
        integrate = run and tick and self.left > 0 and not halted
        for i, motor in enumerate(self.motors):
            lost |= self._former(motor, halted) << i
        if integrate:
            for motor in self.motors:
                motor.acc = wrap(motor.acc + motor.inc, 32 + self.F)
                motor.inc = wrap(motor.inc + motor.incinc, self.W)

        # 4.3 sequencer
        use, finish = self.use, False
        if halted:
            self.run = self.use = self.accept = 0
            self.m = self.w
            arm = 0
        elif run and (self.left == 0 or (tick and self.left == 1)):
            finish = True
            self.done ^= 1
            events[0xE2] += 1
            self.m = (self.m + 1) % self.depth
            self.use -= 1
            if use > 1:
                load = self.m
            else:
                self.run = 0
        elif run and tick:
            self.left -= 1
        elif not run and use > 0:
            load = self.m
        if load is not None:
            slot = self.slots[load]
            self.left, self.run = slot.duration, 1
            for i, motor in enumerate(self.motors):
                motor.inc, motor.incinc = slot.inc[i], slot.incinc[i]
        assert not (finish and halted)
        if arm:
            self.use += 1
            self.w = (self.w + 1) % self.depth
        if run == 0 or load is not None:
            self.telemetry = telemetry

        # 4.6 encoders
        for e, encoder in enumerate(self.encoders):
            fault |= self._count(encoder) << e

        # 3.3 end of a frame
        self._frame_end(events)

        # writes and clears, visible in the next cycle; events win
        halt_seen = 0 if clears & 8 else self.halt_seen
        self.halt_seen = 1 if halted else halt_seen
        self.fault = (0 if clears & 2 else self.fault) | fault
        for i, motor in enumerate(self.motors):
            motor.lost = (0 if clears & 4 else motor.lost) | (lost >> i & 1)
        for address, count in events.items():
            self.counters[address] = (0 if clears & 1 else self.counters[address]) + count
        self.tick_counter = 0 if tick else self.tick_counter + 1
        self.config.update(writes)

        self._bus(pins)
        self.halt = [pins["halt"], self.halt[0]]

    def _former(self, motor, halted):
        c = self.config
        V, L, S, H = (max(c[a] & 0xFFFF, 1) for a in (0xC0, 0xC1, 0xC2, 0xC3))
        integer = motor.acc >> self.F
        delta = {0: 0, 1: 1, 3: -1}[(integer - motor.q) % 4]
        step, owed, direction = motor.step, motor.backlog, motor.dir
        tw, tl, th, tg = motor.tw, motor.tl, motor.th, motor.tg
        e = lost = 0
        if step and tw > 0:
            motor.tw = tw - 1
        elif step:
            motor.step, motor.tl, motor.th = 0, L - 1, H - 1
        else:
            motor.tl, motor.th, motor.tg = max(tl - 1, 0), max(th - 1, 0), max(tg - 1, 0)
        if not step and owed and not halted:
            if (owed < 0) != bool(direction):
                if th == 0:
                    motor.dir, motor.tg = int(owed < 0), S - 1
            elif tl == 0 and tg == 0:
                motor.step, motor.tw = 1, V - 1
                e = 1 if owed > 0 else -1
        if halted:
            x = owed + delta
            motor.acc = wrap(motor.acc - (x << self.F), 32 + self.F)
            motor.q = (integer - x) % 4
            motor.backlog = 0
        else:
            motor.q = integer % 4
            motor.backlog = owed + delta - e
            if not -128 <= motor.backlog <= 127:
                motor.backlog = owed - e
                lost = 1
        return lost

    def _encoder_registers(self):
        return [value for e in self.encoders for value in (e.position, e.velocity)]

    def _count(self, encoder):
        (_, a1, a2), (_, b1, b2) = encoder.a, encoder.b
        v = encoder.v
        encoder.v += 1
        if a1 != a2 and b1 != b2:
            return 1
        if a1 != a2 or b1 != b2:
            up = a1 ^ b2
            encoder.position = wrap(encoder.position + (1 if up else -1), 32)
            encoder.velocity = wrap(v if up else -v, 32)
            encoder.v = 0
        return 0

    # ------------------------------------------------------------------------------------------ bus

    def _frame_end(self, events):
        if self.cs[1] == 1 and self.cs_before == 0:
            self.frame_end.append([2, self.tn != 7])
        if self.frame_end and self.frame_end[0][0] == 0:
            _, part = self.frame_end.pop(0)
            events[0xE4] += int(self.bc != 0 or part)
            self.bc = 0
            if self.cs_reset_message and self.header is not None:
                self.header, self.reply = None, 0
                events[0xE5] += 1
        for entry in self.frame_end:
            entry[0] -= 1

    def _bus(self, pins):
        _, s1, s2 = self.sck
        rise, fall, active = s1 and not s2, s2 and not s1, self.cs[1] == 0
        byte_flag, word_flag = self.byte_flag, self.word_flag
        if byte_flag and not self.byte_before:
            self.rw = (self.rw >> 8) | self.rb << (self.W - 8)
            self.word_flag = int(self.bc == self.W // 8 - 1)
            self.bc = (self.bc + 1) % (self.W // 8)
        self.byte_before, self.word_before = byte_flag, word_flag
        if active and fall:
            self.byte_flag = int(self.tn == 0)
        if active and rise:
            self.rb = (self.rb << 1 & 0xFF) | self.copi[1]
        if not active:
            self.tn = 7
        elif fall:
            self.tn = (self.tn - 1) % 8
        self.cs_before = self.cs[1]
        self.cs = [pins["cs"], self.cs[0]]
        self.copi = [pins["copi"], self.copi[0]]

    def _message(self, events):
        """Do a message action; return whether a slot is armed, writes, bits of a clear."""
        word, header = self.rw, self.rw >> (self.W - 8)
        address = word & 0xFF
        arm, writes, clears = 0, {}, 0
        if self.header == 1:
            arm = self._move_word(word, events)
        elif self.header is not None:
            if self.header == 0xF2 and self.address == 0xC5:
                clears = word
            elif self.header == 0xF2:
                kept = {0: 0xFFFFFFFF, 1: 0xFFFFFFFF, 2: 0xFFFFFFFF, 0xC4: 1}
                kept |= dict.fromkeys(range(0xC0, 0xC4), 0xFFFF)
                kept |= dict.fromkeys((0xC6, 0xC7), (1 << self.N) - 1)
                writes = {self.address: word & kept.get(self.address, 0)}
            self.header, self.reply = None, 0
        elif header == 0:
            self.reply = 0
        elif header == 1:
            self.header, self.k, self.reply = 1, 1, 0
            self.accept = int(self.use < self.depth and not self.halted and not self.halt_seen)
            self.snapshot = list(self.telemetry)
        elif header == 0xFD and self.v020_info:
            self.reply = self._status(1)
        else:
            self.header, self.address, self.reply = header, address, 0
            if header == 0xF1:
                self.reply = self._status(address) & ((1 << self.W) - 1)
            elif header in (0xF2, 0xF3):
                self.reply = self.config[address]
            elif header == 0xFE and self.v020_info:
                self.reply = 0x01000200
            elif header == 0x03 and self.v020_info:
                e = word >> 48 & 0xFF
                if e < self.E:
                    self.reply = (self.encoders[e].velocity & 0xFFFFFFFF) << 32
                    self.reply |= self.encoders[e].position & 0xFFFFFFFF
            else:
                events[0xE6] += 1
        return arm, writes, clears

    def _move_word(self, word, events):
        k, slot = self.k, self.slots[self.w]
        last = k == 2 * self.N + 1
        n = k - 1
        known = n < 2 * min(self.N, self.E) and not last
        self.reply = self.snapshot[n] & ((1 << self.W) - 1) if known else 0
        self.k += 1
        if self.accept:
            if k == 1:
                slot.duration = word & 0xFFFFFFFF
            elif k % 2 == 0:
                slot.inc[(k - 2) // 2] = wrap(word, self.W)
            else:
                slot.incinc[(k - 3) // 2] = wrap(word, self.W)
        if not last:
            return 0
        self.header = None
        if self.accept and not self.halted:
            return 1
        events[0xE3] += 1
        return 0

    def _status(self, a):
        if 4 <= a < 0x44:
            return self.encoders[a - 4].position if a - 4 < self.E else 0
        if 0x44 <= a < 0x84:
            return self.encoders[a - 0x44].velocity if a - 0x44 < self.E else 0
        if 0x84 <= a < 0xA4:
            return self.position(a - 0x84) & 0x3FF if a - 0x84 < self.N else 0
        if 0xC0 <= a < 0xE0:
            return self.position(a - 0xC0) if a - 0xC0 < self.N else 0
        if a in self.counters:
            return self.counters[a] & 0xFFFFFFFF
        lost = sum(motor.lost << i for i, motor in enumerate(self.motors))
        values = {
            0x00: 0x01000300,
            0x01: 0x20200000 | self.E << 8 | self.N,
            0x02: self.fault,
            0x03: lost,
            0xE0: self.use | self.depth << 8 | self.run << 16 | self.halted << 17,
            0xE1: self.left if self.run else 0,
            0xE7: lost,
            0xE8: self.fault >> 32,
            0xE9: sum((motor.backlog != 0) << i for i, motor in enumerate(self.motors)),
            0xFE: 0x2000 | self.W,
            0xFF: 0x52430001,
        }
        values[0xE0] |= self.halt_seen << 18
        return values.get(a, 0)
