"""A slow model of the USC, written from the tables of the specification: one clock edge at a time.

Every register is an entry of a dictionary. An edge computes all new values from the old ones. The
model is an oracle for the twin and the gateware, so it knows no shortcut and shares no code.
"""

from types import SimpleNamespace

RESET = {
    "address": 0, "assembly": 0, "encoder_control": 0, "timer": 0, "slave": 0, "index_reset": 0,
    "dac": 0, "N": (0, 0, 0, 0), "rate_control": 0, "setup_code": 0xFE, "width_code": 0xFE,
    "outputs": 0, "sense": 0, "running": 0, "read_byte": 0, "S": (0, 0, 0, 0, 0),
    "count": (0, 0, 0, 0), "holding": (0, 0, 0, 0),
    "watchdog": 0, "commits": frozenset(), "timer_count": 0,
    "C": (0, 0, 0, 0), "step": (0, 0, 0, 0), "D": (0, 0, 0, 0),
    "w": (0, 0, 0, 0), "q": (0, 0, 0, 0), "h": (0, 0, 0, 0), "g": (0, 0, 0, 0),
}  # fmt: skip
DOCUMENT = {
    "div_offset": 1, "time_code": 255, "min_space": 1, "ident": 0x41, "sense_gate": 0,
    "watchdog_us": 10_000, "mariss": 0, "loopback": 0, "base": 0, "enc_filter": 1,
}  # fmt: skip
LINUXCNC = {**DOCUMENT, "div_offset": 4, "time_code": 256, "min_space": 3}
IDLE_BUS = {"nwrite": 1, "ndatastr": 1, "naddrstr": 1, "ninit": 1, "data": 0}
AXIS_STATE = ("C", "step", "D", "w", "q", "h", "g")
QUADRATURE = [(0, 0), (1, 0), (1, 1), (0, 1)]  # (A, B), counting up


def bit(value, n):
    return value >> n & 1


def with_item(values, i, value):
    return (*values[:i], value, *values[i + 1 :])


class Board:
    def __init__(self, switches):
        self.p = SimpleNamespace(**switches)
        self.loopback = self.p.loopback
        self.r = dict(RESET)
        self.pins = {f"{pin}{i}": 0 for pin in ("a", "b", "index") for i in range(4)}
        self.pins |= {f"din{n}": 0 for n in range(15)} | {"estop_chain": 1}
        self.flop1, self.flop2, self.seen = dict(self.pins), dict(self.pins), dict(self.pins)
        encoder = [f"{pin}{i}" for pin in ("a", "b", "index") for i in range(4)]
        self.samples = {pin: [0] * self.p.enc_filter for pin in encoder}
        self.filtered = dict.fromkeys(encoder, 0)
        self.decoded = dict.fromkeys(encoder, 0)  # levels at the edge before
        self.steps, self.pulses = [0] * 4, [0] * 4

    # ------------------------------------------------------------------------------ small rules

    def selected(self):
        return self.r["address"] >> 5 == self.p.base

    def code_ticks(self, code):
        return max(1, self.p.time_code - code)

    def sample_inputs(self):
        """One edge of synchronisers and filters."""
        self.seen = self.flop2
        self.flop2, self.flop1 = self.flop1, dict(self.pins)
        self.decoded = dict(self.filtered)
        for pin, samples in self.samples.items():
            samples.append(self.seen[pin])
            del samples[0]
            if samples.count(samples[0]) == len(samples):
                self.filtered[pin] = samples[0]

    def read(self, register):
        """The byte of a data read."""
        if register < 0x0C:
            return self.r["holding"][register // 3] >> 8 * (register % 3) & 0xFF
        if register == 0x0C:
            return self.r["sense"]
        if register == 0x0D:
            return sum(self.seen[f"din{n}"] << n for n in range(8))
        if register == 0x0E:
            return sum(self.seen[f"din{8 + n}"] << n for n in range(7)) | self.r["running"] << 7
        if register == 0x0F:
            return self.p.ident
        return 0

    def timer_event(self, tick):
        r = self.r["timer"] & 0x0F
        active = bit(self.r["timer"], 4) and r != 0
        return bool(tick and active and self.r["timer_count"] + 1 >= r * 1000)

    def soft_latch(self, act):
        return bool(
            act and act[0] == "W" and act[1] == 0x04
            and bit(act[2], 5) and not bit(self.r["timer"], 5)
        )  # fmt: skip

    def visible_count(self, r, i):
        """The counter of an axis; a load position bit makes it transparent."""
        return r["assembly"] if bit(r["encoder_control"], 4 + i) else r["count"][i]

    # ------------------------------------------------------------------------------- one instant

    def next(self, clock, tick, act, latch):
        """All new register values from the old ones.

        clock: a clock edge; else the instant after one, at which only ``act`` happens. act: None,
        ("W", register, value) or ("R", register). latch: the board latches.
        """
        old, new, p = self.r, dict(self.r), self.p
        if act and act[0] == "W":
            self.write(old, new, act[1], act[2])
        if act and act[0] == "R" and act[1] == 0x0C:
            new["sense"] = 0
        if tick:
            self.tick(old, new)
        self.encoders(old, new, clock, latch)
        if tick:
            new["timer_count"] = self.next_timer_count(old)
            if not (act and self.feeds(old, act)):
                new["watchdog"] = max(0, old["watchdog"] - 1)
        # estop
        rising = bit(new["outputs"], 7) and not bit(old["outputs"], 7)
        closed = self.seen["estop_chain"] or new["slave"]
        satisfied = p.watchdog_us == 0 or new["watchdog"] > 0
        new["running"] = int(
            bool((old["running"] or rising) and bit(new["outputs"], 7) and closed and satisfied)
        )
        self.r = new

    def next_timer_count(self, old):
        r = old["timer"] & 0x0F
        if not (bit(old["timer"], 4) and r):
            return 0
        return 0 if old["timer_count"] + 1 >= r * 1000 else old["timer_count"] + 1

    def feeds(self, old, act):
        if act[0] != "W" or act[1] not in (0x12, 0x15, 0x18, 0x1B):
            return False
        commits = old["commits"] | {(act[1] - 0x12) // 3}
        return any({i, i + 1} <= commits for i in range(3))

    def write(self, old, new, register, value):
        if register <= 0x02 or 0x10 <= register <= 0x1B:
            k = register if register <= 0x02 else (register - 0x10) % 3
            new["assembly"] = old["assembly"] & ~(0xFF << 8 * k) | value << 8 * k
            if register >= 0x10 and k == 2:
                i = (register - 0x10) // 3
                new["N"] = with_item(old["N"], i, new["assembly"])
                new["commits"] = old["commits"] | {i}
                if self.feeds(old, ("W", register, value)):
                    new["commits"] = frozenset()
                    new["watchdog"] = 10 * self.p.watchdog_us
        elif register in (0x03, 0x0C):
            new["encoder_control"] = value
        elif register == 0x04:
            new["timer"] = value
        elif register == 0x06:
            new["slave"] = value & 1
        elif register == 0x0D:
            if self.p.ident & 0x0F >= 2:
                new["index_reset"] = value & 0x0F
        elif register == 0x0F:
            new["dac"] = value
        elif register == 0x1C:
            new["rate_control"] = value
        elif register == 0x1D:
            new["setup_code"] = value
        elif register == 0x1E:
            new["width_code"] = value
        elif register == 0x1F:
            new["outputs"] = value

    def tick(self, old, new):
        """Rate generator and pulse former, sections 4.3 and 4.4."""
        p = self.p
        W, S = self.code_ticks(old["width_code"]), self.code_ticks(old["setup_code"])
        axes = []
        for i in range(4):
            want = bit(old["rate_control"], 2 * i)
            C, step, D, w, q, h, g = (old[name][i] for name in AXIS_STATE)
            active = bit(old["rate_control"], 2 * i + 1) and old["N"][i] != 0 and old["running"]
            P = old["N"][i] + p.div_offset
            due = active and C + 1 >= P
            ready = step == 0 and q == 0 and g == 0 and want == D
            # rate generator
            new_C = 0 if not active or (due and ready) else C if due else C + 1
            # pulse former: the counters count down unless a row loads them
            new_step, new_D, new_w = step, D, w
            new_q, new_h, new_g = (
                (max(0, q - 1), max(0, h - 1), max(0, g - 1)) if step == 0 else (q, h, g)
            )
            if due and ready:
                new_step, new_w = 1, W - 1
                self.pulses[i] += 1
                self.steps[i] += 1 if D else -1
            elif step == 1 and w > 0:
                new_w = w - 1
            elif step == 1:
                new_step, new_q, new_h = 0, p.min_space - 1, S - 1
                if p.mariss:
                    new_D = want
            elif h == 0 and want != D:
                new_D, new_g = want, S - 1
            if p.mariss:
                new_h, new_g = 0, 0
            axes.append((new_C, new_step, new_D, new_w, new_q, new_h, new_g))
        new |= zip(AXIS_STATE, zip(*axes, strict=True), strict=True)

    def encoders(self, old, new, clock, latch):
        """Section 4.1."""
        for i in range(4):
            load, load_after = (
                bit(old["encoder_control"], 4 + i),
                bit(new["encoder_control"], 4 + i),
            )
            select, reset = bit(old["encoder_control"], i), bit(old["index_reset"], i)
            before = self.visible_count(old, i)
            count = before
            index = clock and self.filtered[f"index{i}"] and not self.decoded[f"index{i}"]
            if clock and self.loopback:
                if new["step"][i] and not old["step"][i]:
                    count += 1 if old["D"][i] else -1
            elif clock:
                was = QUADRATURE.index((self.decoded[f"a{i}"], self.decoded[f"b{i}"]))
                now = QUADRATURE.index((self.filtered[f"a{i}"], self.filtered[f"b{i}"]))
                count += {1: 1, 3: -1}.get((now - was) % 4, 0)
            if index and reset:
                count = 0
            if load:
                count = old["assembly"]
            if load_after:
                count = new["assembly"]
            new["count"] = with_item(new["count"], i, count & 0xFFFFFF)
            if (latch and not select) or (index and select):
                new["holding"] = with_item(new["holding"], i, before)
            if index and (self.p.sense_gate == 0 or select or reset):
                new["sense"] |= 1 << i

    def outputs(self):
        r = self.r
        levels = {f"step{i}": r["step"][i] for i in range(4)}
        levels |= {f"dir{i}": r["D"][i] for i in range(4)}
        levels |= {f"out{n}": bit(r["outputs"], n) & r["running"] for n in range(7)}
        levels |= {f"dac{n}": bit(r["dac"], n) & r["running"] for n in range(8)}
        return levels | {"running": r["running"]}


class Reference:
    """Boards on a bus, driven edge by edge (`edge`) and, between edges, by `access`."""

    def __init__(self, profile="document", boards=1, clock_hz=40_000_000, nwait_idle=0, **switches):
        values = {**{"document": DOCUMENT, "linuxcnc": LINUXCNC}[profile], **switches}
        base = values.pop("base")
        self.boards = [Board({**values, "base": base + b}) for b in range(boards)]
        self.tick_cycles = clock_hz // 10_000_000
        self.nwait_idle = nwait_idle
        self.line = 0  # cycles for which the Intr line stays asserted
        self.edge_number = -1  # last edge since reset
        self.cycle = -1
        self.byte = 0
        self.bus = dict(IDLE_BUS)
        self.in_reset = False
        self.levels = self.outputs()
        self.initial = dict(self.levels)
        self.changes = {pin: [] for pin in self.levels}

    def outputs(self):
        levels = {}
        for b, board in enumerate(self.boards):
            prefix = f"b{b}." if b else ""
            levels |= {prefix + pin: level for pin, level in board.outputs().items()}
        acknowledge = drive = byte = 0
        for board in self.boards:
            if board.r["S"][4] and board.selected() and not self.in_reset:
                acknowledge = 1
                if self.bus["nwrite"]:
                    drive, byte = 1, board.r["read_byte"]
        levels |= {"nwait": acknowledge ^ self.nwait_idle, "drive": drive}
        return levels | {f"data{n}": bit(byte, n) for n in range(8)}

    def record(self):
        """Note the changes of the cycle that ends, before the next edge."""
        levels = self.outputs()
        if levels == self.levels:
            return
        for pin, level in levels.items():
            if level != self.levels[pin]:
                self.changes[pin].append(self.cycle)
        self.levels = levels

    def edge(self, pins=None):
        """One clock edge that samples ``pins``: the changes of bus and board inputs."""
        self.record()
        self.cycle += 1
        for pin, level in (pins or {}).items():
            if pin in self.bus:
                self.bus[pin] = level
            else:
                b, name = pin.split(".") if "." in pin else ("b0", pin)
                self.boards[int(b[1:])].pins[name] = level
        for board in self.boards:
            board.sample_inputs()
        if not self.bus["ninit"]:
            self.reset_registers()
            return
        if self.in_reset:
            self.in_reset, self.edge_number = False, -1
        self.edge_number += 1
        tick = self.edge_number % self.tick_cycles == 0
        acts = [self.strobe_pipeline(board) for board in self.boards]
        self.instant(True, tick, acts)
        self.line_and_pipeline()

    def line_and_pipeline(self):
        strobe = int(not (self.bus["ndatastr"] and self.bus["naddrstr"]))
        for board in self.boards:
            board.r["S"] = (strobe, *board.r["S"][:4])

    def strobe_pipeline(self, board):
        """Section 3.2: what the bus does at this edge; address and read byte change at its end."""
        S = board.r["S"]
        board.after = {}
        if not (S[1] == 1 and S[2] == 0):
            return None
        register, act = board.r["address"] & 0x1F, None
        write, data, address = (not self.bus[pin] for pin in ("nwrite", "ndatastr", "naddrstr"))
        if board.selected() and data and write:
            act = ("W", register, self.bus["data"])
        elif board.selected() and data:
            act = ("R", register)
            board.after["read_byte"] = board.read(register)
        elif board.selected() and address and not write:
            board.after["read_byte"] = board.r["address"]
        if not address and board.selected():
            board.after["address"] = board.r["address"] & 0xE0 | (board.r["address"] + 1) & 0x1F
        elif address and write:
            board.after["address"] = self.bus["data"]
        return act

    def instant(self, clock, tick, acts):
        """A clock edge, or the instant after one."""
        events = [
            board.timer_event(tick) or board.soft_latch(act)
            for board, act in zip(self.boards, acts, strict=True)
        ]
        asserted = self.line > 0
        if any(events):
            self.line = self.tick_cycles * 10
        elif clock and self.line:
            self.line -= 1
        for board, act, event in zip(self.boards, acts, events, strict=True):
            latch = event or (any(events) and not asserted)
            board.next(clock, tick, act, latch)
            board.r |= getattr(board, "after", {})
            board.after = {}

    def reset_registers(self):
        self.in_reset = True
        self.line = 0
        for board in self.boards:
            board.r = dict(RESET)
            board.steps, board.pulses = [0] * 4, [0] * 4

    def run_to(self, cycle, changes=None):
        """All edges up to ``cycle``; changes: {cycle: {pin: level}}."""
        while self.cycle < cycle:
            self.edge((changes or {}).get(self.cycle + 1))

    # ------------------------------------------------- between the edges: socket accesses, control

    def access(self, op, value=0):
        """An EPP access after the present edge. Return (byte, time-out)."""
        selected = [b for b in self.boards if b.selected()] if not self.in_reset else []
        if op == "A":
            self.byte = value
            if not self.in_reset:
                for board in self.boards:
                    board.r["address"] = value
            return value, 0
        if not selected:
            self.byte = value if op == "W" else self.byte
            return self.byte, 1
        (board,) = selected
        register = board.r["address"] & 0x1F
        if op == "a":
            self.byte = board.r["address"]
            return self.byte, 0
        self.byte = value if op == "W" else board.read(register)
        act = ("W", register, value) if op == "W" else ("R", register)
        board.after = {"address": board.r["address"] & 0xE0 | (register + 1) & 0x1F}
        self.instant(False, False, [act if other is board else None for other in self.boards])
        return self.byte, 0

    def set_pin(self, b, pin, level):
        """A digital or chain input changes at once, synchroniser included."""
        board = self.boards[b]
        for stage in (board.pins, board.flop1, board.flop2, board.seen):
            stage[pin] = level
        self.instant(False, False, [None] * len(self.boards))

    def set_encoder(self, b, i, value):
        r = self.boards[b].r
        if not self.in_reset and not bit(r["encoder_control"], 4 + i):
            r["count"] = with_item(r["count"], i, value & 0xFFFFFF)

    def index_edge(self, b, i):
        board = self.boards[b]
        if not self.in_reset:
            board.decoded = dict(board.filtered)
            held = board.filtered[f"index{i}"], board.loopback
            board.filtered[f"index{i}"], board.decoded[f"index{i}"], board.loopback = 1, 0, True
            board.encoders(dict(board.r), board.r, True, False)
            board.filtered[f"index{i}"], board.loopback = held

    def set_ninit(self, level):
        self.bus["ninit"] = level
        if not level and not self.in_reset:
            self.reset_registers()
        elif level and self.in_reset:
            self.in_reset, self.edge_number = False, 0
