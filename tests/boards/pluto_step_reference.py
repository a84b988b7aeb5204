"""The board as its specification says it, tick by tick and clock by clock, without any shortcut.

Sections and rows are those of the board's specification; every edge works on old values.
"""

from pulsewright.boards.pluto_step.registers import PROFILES

RUN, HOLD, SETUP = 0, 1, 2


class Axis:
    """Section 4.2 and the items of 6.2 that change it, tick by tick."""

    def __init__(self):
        self.pos = self.step = self.dir = self.timer = self.mode = self.last = 0
        self.space = self.missed = 0
        self.unserved = False  # pending at the last tick, no pulse started, tap unchanged since

    def tick(self, v, s, t, tap, sp, clean_cancel, enforce_space):
        step_before = self.step
        neg = int(v < 0)
        p = self.pos >> (11 + tap) & 1
        want, pend = self.dir != neg, p != self.last
        started = False
        if want and not pend:
            if self.timer > 0:
                self.timer -= 1
            elif self.mode == HOLD:
                self.dir, self.timer, self.mode = neg, t, SETUP
            else:
                self.step, self.timer, self.mode = 0, t, HOLD
        elif self.mode == SETUP:
            if self.timer > 0:
                self.timer -= 1
            else:
                self.mode = RUN
        else:
            idle = self.timer == 0
            if clean_cancel and self.mode == HOLD:
                self.mode, self.timer, idle = RUN, 0, True
            if not idle:
                self.timer -= 1
            elif enforce_space and self.step == 1:
                self.step = 0
            elif pend and (not enforce_space or self.space == 0):
                self.last, self.step, self.timer, started = p, 1, s, True
            else:
                self.step = 0
            if not want:
                self.pos = (self.pos + v) % 2**21
        if enforce_space:
            if step_before == 1 and self.step == 0:
                self.space = sp
            elif step_before == 0 and self.space > 0:
                self.space -= 1
            if not pend and self.unserved:
                self.missed = 1
            self.unserved = pend and not started


class Reference:
    """Sections 2 to 4 and 6.2, clock by clock."""

    def __init__(self, **switches):
        self.sw = {**PROFILES["exact"], **switches}
        self.reset()

    def reset(self):
        self.n = self.ticks = 0
        self.s = [0] * 5
        self.a = self.latch = self.low = 0
        self.velocity, self.staged = [0] * 4, [0] * 4
        self.dout = self.s_time = self.t_time = self.tap = self.polarity = self.sp = 0
        self.joint = self.stop = 0
        self.count = self.enable = 0
        self.axes = [Axis() for _ in range(4)]

    @property
    def tristate(self):
        return int(self.enable and self.count == 127)

    def load(self, din):
        sw = self.sw
        if self.a < 16:
            self.latch = self.axes[self.a // 4].pos
        elif self.a == 16:
            self.latch = din
        elif self.a == 20 and sw["id_reg"]:
            self.latch = 0x5057 << 16 | 1 << 8 | 4
        elif self.a == 24 and sw["status_reg"]:
            self.latch = self.enable | self.tristate << 1
            for i, axis in enumerate(self.axes):
                self.latch |= axis.missed << (4 + i)
                axis.missed = 0
        elif self.a == 28 and sw["tick_reg"]:
            self.latch = self.ticks % 2**32

    def write(self, address, h, before):
        sw = self.sw
        if sw["no_alias"] and address >= 16:
            return
        address %= 16
        word = h << 8 | self.low
        if address in (1, 3, 5, 7):
            v = word & 0xFFF
            v -= 4096 if v >= 2048 else 0
            self.staged[address // 2] = v
            if not self.joint:
                self.velocity[address // 2] = v
        elif address == 9:
            self.dout = word & 0x3FFF
            if self.joint:
                self.velocity = list(self.staged)
            if word & 0x4000:
                self.count, self.enable, self.armed = 0, 1, True
        elif address == 11:
            tap = word >> 6 & 3
            if tap != self.tap:
                for axis, pos in zip(self.axes, before, strict=True):
                    axis.unserved = False
                    if sw["tap_sync"]:
                        axis.last = pos >> (11 + tap) & 1
            self.s_time, self.tap = word & 15, tap
            self.t_time, self.polarity = word >> 8 & 15, word >> 15
        elif address == 13 and sw["enforce_space"]:
            self.sp = word & 15
        elif address == 15 and (sw["joint_commit"] or sw["wd_stop"]):
            self.joint = word & 1 if sw["joint_commit"] else 0
            self.stop = word >> 1 & 1 if sw["wd_stop"] else 0
        else:
            self.low = h

    def clock(self, nwrite, ndatastr, naddrstr, ninit, data, din):
        """Return the output pins after one edge, in the order of the twin's pins."""
        if not ninit:
            self.reset()
            return self.outputs(nwrite, ninit)
        sw, self.armed = self.sw, False
        before = [axis.pos for axis in self.axes]
        act = self.s[1] and not self.s[2]
        if act and nwrite and self.a % 4 == 0:
            self.load(din)
        if self.n % 64 == 0:
            dead = self.stop and self.tristate
            for axis, v in zip(self.axes, self.velocity, strict=True):
                axis.tick(
                    0 if dead else v,
                    *(self.s_time, self.t_time, self.tap, self.sp),
                    *(sw["clean_cancel"], sw["enforce_space"]),
                )
            self.ticks += 1
        old = self.a
        if act:
            if not naddrstr and not nwrite:
                self.a = data & 31
            if naddrstr:
                self.a = (old + 1) % 32
            if not ndatastr and not nwrite:
                self.write(old, data, before)
        if self.n % 2048 == 2047 and not self.armed:
            self.count = min(127, self.count + 1)
        self.s = [int(not ndatastr or not naddrstr), *self.s[:4]]
        self.n += 1
        return self.outputs(nwrite, ninit)

    def outputs(self, nwrite, ninit):
        shown = not self.tristate
        pins = [(axis.step ^ self.polarity) * shown for axis in self.axes]
        pins += [axis.dir * shown for axis in self.axes]
        pins += [(self.dout >> n & 1) * shown for n in range(14)]
        pins += [(self.axes[0].step ^ self.axes[0].dir) * shown, self.tristate]
        drive = nwrite and self.s[4]
        byte = self.latch >> 8 * ((self.a - 1) % 4) & 0xFF if drive else 0
        pins += [self.s[4] ^ self.sw["nwait_idle"], ninit, int(drive)]
        return pins + [byte >> n & 1 for n in range(8)]
