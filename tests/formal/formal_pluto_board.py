"""Benches for the whole pluto_step board, between its bus and its pins."""

from types import SimpleNamespace

from amaranth import Cat, Module, Mux, Signal
from amaranth.lib.wiring import Component, In, Out
from formal_harness import Bench, mutant
from formal_step_generator import SpecifiedAxis, Timer

from pulsewright.boards.pluto_step import gateware
from pulsewright.gateware import divider

TICK, WATCHDOG_TICK, WATCHDOG_TICKS = 8, 64, 3  # clocks, clocks, watchdog ticks; the board: 64,
# 2048, 127. Nothing else depends on them, and the state that a proof must reach is far smaller.


class PromisedDivider(Component):
    """What `Divider` promises, as a binary counter."""

    def __init__(self, *, period):
        super().__init__({"enable": In(1), "last": Out(1)})
        self.period = period

    def elaborate(self, platform):
        m = Module()
        count = Signal(range(self.period))
        m.d.comb += self.last.eq(count == self.period - 1)
        with m.If(self.enable):
            m.d.sync += count.eq(count + 1)
        return m


class DividerBench(Bench):
    """The divider and its promise."""

    def __init__(self, module=divider, *, period):
        self.divider, self.promise = module.Divider(period=period), PromisedDivider(period=period)
        super().__init__()

    def build(self, m: Module) -> None:
        m.submodules.divider, m.submodules.promise = self.divider, self.promise
        enable = self.free(1, "enable")
        m.d.comb += [self.divider.enable.eq(enable), self.promise.enable.eq(enable)]
        self.always("period", self.divider.last == self.promise.last)
        self.possible("a second period", self.divider.last & self.past(~self.divider.last))


def small_board(old="class PlutoStep(", new="class PlutoStep("):
    """Return the gateware with its three times shortened, and with promises for its parts."""
    module = mutant(gateware, old, new)
    constants = vars(gateware.registers) | {
        "TICK_CYCLES": TICK,
        "WATCHDOG_CYCLES": WATCHDOG_TICK,
        "WATCHDOG_TICKS": WATCHDOG_TICKS,
    }
    module.registers = SimpleNamespace(**constants)
    module.SerialTimer, module.Divider = Timer, PromisedDivider
    return module


class BusBench(Bench):
    """The board with all its pins free, and a reading of the bus by sections 2.3 and 3.2.

    ``written`` is high in the cycle before a byte takes effect, ``place`` is its address, and
    ``word`` the byte above the shared low-byte latch.
    """

    def __init__(self, module, profile):
        self.board = module.PlutoStep(profile)
        self.extended = profile == "extended"
        super().__init__()

    def build(self, m: Module) -> None:
        m.submodules.board = board = self.board
        self.free_inputs(board)
        strobe = ~(board.ndatastr & board.naddrstr)
        sampled = self.past(strobe)
        before = self.past(sampled)
        acts = self.past(sampled & ~before)  # the third edge
        self.place, low = Signal(5), Signal(8)
        with m.If(acts & ~board.naddrstr & ~board.nwrite):
            m.d.sync += self.place.eq(board.data_i)
        with m.Elif(acts & board.naddrstr):
            m.d.sync += self.place.eq(self.place + 1)
        self.written = Signal()
        m.d.comb += self.written.eq(acts & ~board.ndatastr & ~board.nwrite)
        if self.extended:  # no aliases
            self.register = self.place
            latches = self.written & ~self.place[4] & ~self.place.matches(1, 3, 5, 7, 9, 11, 13, 15)
        else:
            self.register = self.place[:4]
            latches = self.written & ~self.register.matches(1, 3, 5, 7, 9, 11)
        with m.If(latches):
            m.d.sync += low.eq(board.data_i)
        self.word = Cat(low, board.data_i)

        # Edge 0 is a tick.
        clock = Signal(range(WATCHDOG_TICK))
        m.d.sync += clock.eq(clock + 1)
        self.tick = (clock % TICK) == 0
        self.watchdog_tick = clock == WATCHDOG_TICK - 1
        self.observe(m)

    def commit(self, address):
        return self.written & (self.register == address)


class PathBench(BusBench):
    """From the bus to the pins of axis 0, the board does what the specification says."""

    def observe(self, m: Module) -> None:
        board, word = self.board, self.word
        m.submodules.axis = axis = SpecifiedAxis(
            clean_cancel=self.extended, enforce_space=self.extended
        )
        velocity, polarity, space = Signal(12), Signal(), Signal(4)
        steptime, dirtime, tap = Signal(4), Signal(4), Signal(2)
        with m.If(self.commit(1)):
            m.d.sync += velocity.eq(word)
        with m.If(self.commit(11)):
            m.d.sync += [steptime.eq(word[:4]), tap.eq(word[6:8])]
            m.d.sync += [dirtime.eq(word[8:12]), polarity.eq(word[15])]
        next_tap = Mux(self.commit(11), word[6:8], tap)
        if self.extended:
            with m.If(self.commit(13)):
                m.d.sync += space.eq(word)
            self.assume(~self.commit(15))  # joint commit and watchdog stop are not switched on
        m.d.comb += [
            axis.tick.eq(self.tick),
            axis.velocity.eq(velocity),
            axis.steptime.eq(steptime),
            axis.dirtime.eq(dirtime),
            axis.space.eq(space),
            axis.tap.eq(tap),
            axis.next_tap.eq(next_tap),
            axis.moved_tap.eq(next_tap != tap),
            axis.drop.eq((next_tap != tap) if self.extended else 0),
        ]
        self.always("step pin", board.step[0] == axis.step ^ polarity)
        self.always("dir pin", board.dir[0] == axis.dir)
        self.always("led", board.led == axis.step ^ axis.dir)


class WatchdogBench(BusBench):
    """Outputs are off exactly from the third watchdog tick after the last arm on."""

    def observe(self, m: Module) -> None:
        arm = self.commit(9) & self.word[14]
        armed, ticks = Signal(), Signal(range(WATCHDOG_TICKS + 1))
        with m.If(arm):
            m.d.sync += [armed.eq(1), ticks.eq(0)]
        with m.Elif(self.watchdog_tick & (ticks < WATCHDOG_TICKS)):
            m.d.sync += ticks.eq(ticks + 1)
        off = self.board.tristate
        self.always("never armed, never off", armed | ~off)
        self.always("off with the third watchdog tick", off == (armed & (ticks == WATCHDOG_TICKS)))
        self.possible("off", off)
        self.possible("on again", self.past(off) & ~off)
