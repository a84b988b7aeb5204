"""Benches for the step path of usc, written from `usc.md` 4.2 to 4.5."""

from amaranth import Cat, Elaboratable, Module, Mux, Signal, unsigned
from formal_harness import Bench

from pulsewright.boards.usc import gateware
from pulsewright.gateware import estop, step_pulse, step_rate, watchdog


class SpecifiedPulse(Elaboratable):
    """The pulse former as section 4.4 tabulates it, in the names of `StepPulse`."""

    def __init__(self, *, min_space=1, change_at_fall=False):
        self.min_space, self.mariss = min_space, change_at_fall
        self.tick, self.due, self.ready, self.direction = (Signal() for _ in range(4))
        self.width, self.setup = Signal(8), Signal(8)  # W and S, less one
        self.step, self.dir = Signal(), Signal()

    def elaborate(self, platform):
        m = Module()
        w, h, g = (Signal(8, name=name) for name in "whg")
        q = Signal(range(self.min_space + 1))
        m.d.comb += self.ready.eq(~self.step & (q == 0) & (g == 0) & (self.dir == self.direction))
        with m.If(self.tick & self.step):
            with m.If(w > 0):
                m.d.sync += w.eq(w - 1)
            with m.Else():
                m.d.sync += [self.step.eq(0), q.eq(self.min_space - 1)]
                m.d.sync += self.dir.eq(self.direction) if self.mariss else h.eq(self.setup)
        with m.Elif(self.tick):
            for counter in (q, h, g):
                with m.If(counter > 0):
                    m.d.sync += counter.eq(counter - 1)
            with m.If((h == 0) & (self.direction != self.dir)):
                m.d.sync += self.dir.eq(self.direction)
                if not self.mariss:
                    m.d.sync += g.eq(self.setup)
            with m.If(self.ready & self.due):
                m.d.sync += [self.step.eq(1), w.eq(self.width)]
        return m


class PulseTableBench(Bench):
    """The pulse former does what the table of section 4.4 says, at every clock edge."""

    def __init__(self, module=step_pulse, **options):
        self.former = module.StepPulse(**options)
        self.table = SpecifiedPulse(**options)
        super().__init__()

    def build(self, m: Module) -> None:
        m.submodules.former, m.submodules.table = former, table = self.former, self.table
        self.free_inputs(former)
        for name in ("tick", "due", "direction", "width", "setup"):
            m.d.comb += getattr(table, name).eq(getattr(former, name))
        self.always("step", former.step == table.step)
        self.always("dir", former.dir == table.dir)
        self.always("ready", ~former.tick | (former.ready == table.ready))


class PulsePinBench(Bench):
    """What a drive may rely on, seen at the pins and at ticks only; a tick at every edge.

    Parameters
    ----------
    module : module
        Where `StepPulse` comes from; None for `SpecifiedPulse`.
    **options
        As for `StepPulse`.
    """

    def __init__(self, module=None, *, min_space=1, change_at_fall=False):
        options = {"min_space": min_space, "change_at_fall": change_at_fall}
        self.min_space, self.mariss = min_space, change_at_fall
        self.former = (SpecifiedPulse if module is None else module.StepPulse)(**options)
        super().__init__()

    def build(self, m: Module) -> None:
        m.submodules.former = former = self.former
        m.d.comb += former.tick.eq(1)
        for name in ("due", "direction", "width", "setup"):
            port = getattr(former, name)
            m.d.comb += port.eq(self.free(port.shape(), name))
        step, direction, past = former.step, former.dir, self.past
        step_before, dir_before = past(step), past(direction)
        rises, falls, flips = step & ~step_before, ~step & step_before, direction != dir_before
        W, S = past(former.width), past(former.setup)  # as the last tick found them
        self.always("a pulse for every step accepted", rises == past(former.ready & former.due))

        def within(ticks, start, counts=1):
            """Return whether ``start`` was one to ``ticks`` ticks ago; those that count."""
            left = Signal(8)
            now = Mux(start, ticks, left)
            m.d.sync += left.eq(Mux((now > 0) & counts, now - 1, now))
            return past(now > 0)

        pulsing = within(W, rises)
        self.always("width", ~pulsing | step)
        self.always("width is exact", pulsing | ~step | rises)
        self.always("space", ~within(self.min_space - 1, falls) | ~step)
        if self.mariss:
            self.always("dir changes while step is low", ~flips | ~step)
        else:
            self.always("dir changes while step is low", ~flips | ~step & ~step_before)
            self.always("hold", ~within(S, falls, counts=~step) | ~flips)
            self.always("set-up", ~within(S, flips) | ~rises)
        self.possible("dir changes back", flips & dir_before)
        fallen = Signal()
        with m.If(falls):
            m.d.sync += fallen.eq(1)
        self.possible("a second pulse", rises & fallen)


class PeriodBench(Bench):
    """The rate generator does what the table of section 4.3 says."""

    def __init__(self, module=step_rate, *, width=6, offset=1):
        self.rate = module.PeriodCounter(width=width, offset=offset)
        self.offset = offset
        super().__init__()

    def build(self, m: Module) -> None:
        m.submodules.rate = rate = self.rate
        self.free_inputs(rate)
        C = Signal(len(rate.divisor) + 1)
        self.assume(~rate.enable | (rate.divisor != 0))  # the board's, as 0 halts
        due = Signal()
        m.d.comb += due.eq(rate.enable & (rate.divisor + self.offset <= C + 1))
        with m.If(rate.tick):
            with m.If(~rate.enable | due & rate.ready):
                m.d.sync += C.eq(0)
            with m.Elif(~due):
                m.d.sync += C.eq(C + 1)
        self.always("due", rate.due == due)
        self.always("no step while halted", rate.enable | ~rate.due)
        self.possible("a second period", rate.due & self.past(rate.due & rate.ready))


class EstopBench(Bench):
    """Chain, release bit and watchdog in any order."""

    def __init__(self, module=estop):
        self.chain = module.EstopChain()
        super().__init__()

    def build(self, m: Module) -> None:
        m.submodules.chain = chain = self.chain
        self.free_inputs(chain)
        self.always(
            "runs only while nothing objects",
            ~chain.running | chain.release & chain.closed & chain.fed,
        )
        raised = chain.release & ~self.past(chain.release)
        self.always(
            "leaves estop only as release rises", ~chain.running | self.past(chain.running) | raised
        )
        self.always(
            "release rises and nothing objects: runs",
            ~(raised & chain.closed & chain.fed) | chain.running,
        )
        self.always(
            "goes on while nothing objects",
            ~(self.past(chain.running) & chain.release & chain.closed & chain.fed) | chain.running,
        )
        self.possible(
            "runs again", chain.running & ~self.past(chain.running) & self.past(chain.closed)
        )


class WatchdogBench(Bench):
    """It expires with the last tick since the feed, never earlier or later, and feeding ends it."""

    def __init__(self, module=watchdog, *, ticks, starts_expired=False):
        self.ticks, self.starts_expired = ticks, starts_expired
        self.watchdog = module.Watchdog(ticks=ticks, starts_expired=starts_expired)
        super().__init__()

    def build(self, m: Module) -> None:
        m.submodules.watchdog = dog = self.watchdog
        self.free_inputs(dog)
        since = Signal(unsigned(self.ticks.bit_length()), init=self.ticks * self.starts_expired)
        with m.If(dog.feed):
            m.d.sync += since.eq(0)
        with m.Elif(dog.tick & (since < self.ticks)):
            m.d.sync += since.eq(since + 1)
        self.always("expires in time", (since < self.ticks) | dog.expired)
        self.always("does not expire early", (since == self.ticks) | ~dog.expired)
        self.always("a feed ends it", ~self.past(dog.feed) | ~dog.expired)


class BoardEstopBench(Bench):
    """The whole board between free pins: in estop nothing comes out, and no pulse starts.

    The watchdog time is 1 us, so that it can expire; nINIT is high, as resetting ends everything.
    Without ``slave``, bit 0 of the bus is 0, so that the board cannot be told to ignore its chain.
    """

    def __init__(self, module=gateware, profile="document", *, slave=True):
        self.board = module.Usc(profile, axes=2, watchdog_us=1)
        self.slave = slave
        super().__init__()

    def build(self, m: Module) -> None:
        m.submodules.board = board = self.board
        self.free_inputs(board, but=("ninit",))
        m.d.comb += board.ninit.eq(1)
        stopped = ~self.past(board.running)
        starts = board.step & ~self.past(board.step)
        self.always("outputs are 0 in estop", board.running | (Cat(board.out, board.dac) == 0))
        self.always("no pulse starts in estop", ~stopped | (starts == 0))
        self.possible("a pulse starts", starts[0])
        self.possible("stops while a pulse is out", ~board.running & ~stopped & board.step[0])
        # Edge n + 2 is the first to use a level of the chain that edge n sampled; the estop acts
        # right after it.
        opened = ~self.past(self.past(self.past(board.estop_chain)))
        if self.slave:
            self.possible("a slave runs with its chain open", board.running & opened)
        else:
            self.assume(~board.data_i[0])
            self.always("an open chain stops the board", ~(board.running & opened))
