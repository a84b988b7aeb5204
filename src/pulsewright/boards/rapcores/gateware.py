"""Gateware of the board: reset, and a core by profile.

Everything takes its new value from old ones, at one clock edge.
"""

from __future__ import annotations

from collections.abc import Sequence

from amaranth import ClockDomain, ClockSignal, DomainRenamer, Module, Signal
from amaranth.lib.wiring import Component, In, Member, Out

from pulsewright.boards.board import resolve_switches
from pulsewright.boards.rapcores import registers as reg
from pulsewright.boards.rapcores.gateware_bridge import LEGS
from pulsewright.boards.rapcores.gateware_compact import CompactCore
from pulsewright.boards.rapcores.gateware_document import DocumentCore
from pulsewright.boards.rapcores.gateware_original import OriginalCore
from pulsewright.boards.rapcores.gateware_shared import cycles
from pulsewright.errors import UsageError

BUS = ("cs", "sck", "copi")
ENCODER_INPUTS = ("enc_a", "enc_b")
INPUTS = (*BUS, "halt", *ENCODER_INPUTS)
MOTOR_OUTPUTS = ("step", "dir", "en")
OUTPUTS = ("cipo", "buffer_dtr", "move_done")


class Rapcores(Component):
    """The board, without pads: clock domain ``sync``, whose reset is that of configuration.

    Parameters
    ----------
    profile : str
        ``document``, ``upstream`` or ``v020``.
    motors : int
        1 to 32; 1 to 24 with words of 32 bits.
    encoders : int
        0 to 64.
    word_bits : int
        64, or 32 in profile ``document``.
    depth : int
        Slots for moves, the executing one included: a power of two, 2 to 64; 2 in profiles other
        than ``document``.
    halt_pin : int
        1: HALT is there. 0: the pin does nothing.
    position_bits : int
        Of encoder positions, 32, or 24 in profile ``v020``.
    shared_dda : int
        1, in profile ``document``: one adder for the DDAs of all motors, and one for all registers
        that count, at a fraction of the logic. 0: each has arithmetic of its own. Pins are the same
        at every clock, with two exceptions. With a divider below `min_divider` a tick waits until
        it is worked out. With more than 2 slots, if a move of duration 0 ends in the cycle in which
        the header of a move message acts, and another move starts with it, the telemetry of that
        message is that of the start of the move behind; if that has a duration of 0, too, of the
        one behind that, and so on.
    motor_driver : int
        1, in profile ``document``: besides step and direction there are outputs for dual H-bridges.
    **switches : int
        Profile switches that differ from the profile.

    Members
    -------
    rst_n : In(1)
        While 0, and for 255 cycles after it, the board is in reset.
    cs, sck, copi : In(1), cipo, cipo_oe : Out(1)
        The bus; CS is active low. Without ``cipo_oe``, ``cipo`` is 0 and not to be driven.
    halt : In(1)
        Active low.
    enc_a, enc_b : In(encoders)
        Of encoders; not there without any.
    buffer_dtr : Out(1)
        A move would be taken now.
    move_done : Out(1)
        Toggles at the end of each move.
    step, dir, en : Out(motors)
        Pins of the motor drivers; ``en`` is active high.
    phase_a1, phase_a2, phase_b1, phase_b2 : Out(motors)
        With ``motor_driver``: the inputs of two integrated bridges of each motor, see `HBridges`.

    Raises
    ------
    UsageError
        If a parameter is not allowed.
    """

    def __init__(
        self,
        profile: str = reg.DEFAULT_PROFILE,
        *,
        motors: int = reg.MOTORS,
        encoders: int = reg.ENCODERS,
        word_bits: int = reg.WORD_BITS,
        depth: int = reg.DEPTH,
        halt_pin: int = 1,
        position_bits: int = reg.POSITION_BITS,
        shared_dda: int = 0,
        motor_driver: int = 0,
        **switches: int,
    ) -> None:
        self.switches = resolve_switches(reg.MAP, profile, switches)
        document = profile == "document"
        _check("word_bits", word_bits, (reg.WORD_BITS, 32) if document else (reg.WORD_BITS,))
        most = reg.MAX_MOTORS if word_bits == reg.WORD_BITS else reg.MAX_MOTORS_32
        _check("motors", motors, range(1, most + 1))
        _check("encoders", encoders, range(reg.MAX_ENCODERS + 1))
        depths = [1 << n for n in range(1, reg.MAX_DEPTH.bit_length())]
        _check("depth", depth, depths if document else (reg.DEPTH,))
        _check("halt_pin", halt_pin, range(2))
        allowed = (reg.POSITION_BITS, 24) if profile == "v020" else (reg.POSITION_BITS,)
        _check("position_bits", position_bits, allowed)
        if self.switches["v020_info"]:  # its replies have 64 bits
            _check("word_bits, with v020_info,", word_bits, (reg.WORD_BITS,))
        _check("shared_dda", shared_dda, range(2))
        _check("motor_driver", motor_driver, range(2) if document else (0,))
        self._h_bridge = bool(motor_driver)
        legs = LEGS if motor_driver else ()
        self._motor_outputs = (*MOTOR_OUTPUTS, *(f"phase_{leg}" for leg in legs))
        self._profile, self._position_bits = profile, position_bits
        self._compact = bool(shared_dda) and document and not self.switches["v020_info"]
        self._motors, self._encoders = motors, encoders
        self._word_bits, self._depth, self._halt_pin = word_bits, depth, bool(halt_pin)
        ports: dict[str, Member] = {name: In(1) for name in ("rst_n", *BUS, "halt")}
        if encoders:
            ports |= {name: In(encoders) for name in ENCODER_INPUTS}
        ports |= {name: Out(1) for name in ("cipo", "cipo_oe", "buffer_dtr", "move_done")}
        ports |= {name: Out(motors) for name in self._motor_outputs}
        super().__init__(ports)

    @property
    def min_divider(self) -> int:
        """Smallest value of the clock divider that is as in the specification.

        A tick is worked out anew with each move that ends, and so with moves of duration 0 between
        two ticks.
        """
        if not self._compact:
            return 0
        return cycles(self._motors, self._word_bits) - 1 + self._depth - reg.DEPTH

    @property
    def input_pins(self) -> dict[str, tuple[str, int]]:
        """Input pins: port and bit of each, such as ``enc0_a``."""
        return {name: (name, 0) for name in ("rst_n", *BUS, "halt")} | {
            f"enc{n}_{name[-1]}": (name, n)
            for n in range(self._encoders)
            for name in ENCODER_INPUTS
        }

    @property
    def output_pins(self) -> dict[str, tuple[str, int]]:
        """Output pins: port and bit of each, such as ``step0`` and ``phase0_a1``."""
        return {name: (name, 0) for name in OUTPUTS} | {
            _numbered(name, n): (name, n)
            for name in self._motor_outputs
            for n in range(self._motors)
        }

    def elaborate(self, platform: object) -> Module:
        m = Module()
        count = Signal(range(reg.RESET_CYCLES + 1))
        ready = Signal()
        m.d.comb += ready.eq(count == reg.RESET_CYCLES)
        with m.If(~self.rst_n):
            m.d.sync += count.eq(0)
        with m.Elif(~ready):
            m.d.sync += count.eq(count + 1)
        # A domain of its own, so that its flip-flops have one reset and not two.
        domain = ClockDomain("board", local=True)
        m.domains += domain
        m.d.comb += [domain.clk.eq(ClockSignal()), domain.rst.eq(~ready)]
        core = self._core()
        m.submodules.core = DomainRenamer("board")(core)
        if self._profile == "document":
            # In the first cycle of a reset the core is not reset yet: no place that is used.
            place = Signal(8, init=reg.RESET_CYCLES)
            m.d.sync += place.eq(count)
            m.d.comb += [core.clear.eq(~ready), core.clear_address.eq(place)]
        m.d.comb += [
            getattr(core, name).eq(getattr(self, name)) for name in INPUTS if hasattr(self, name)
        ]
        m.d.comb += [
            getattr(self, name).eq(getattr(core, name))
            for name in (*OUTPUTS, "cipo_oe", *self._motor_outputs)
        ]
        return m

    def _core(self) -> Component:
        if self._profile != "document":
            return OriginalCore(
                motors=self._motors,
                encoders=self._encoders,
                position_bits=self._position_bits,
                v020=self._profile == "v020",
                fixed=bool(self.switches["fixed"]),
            )
        return (CompactCore if self._compact else DocumentCore)(
            motors=self._motors,
            encoders=self._encoders,
            word_bits=self._word_bits,
            depth=self._depth,
            halt_pin=self._halt_pin,
            cs_reset_message=bool(self.switches["cs_reset_message"]),
            v020_info=bool(self.switches["v020_info"]),
            h_bridge=self._h_bridge,
        )


def _numbered(port: str, n: int) -> str:
    """Return the name of a pin of motor n."""
    kind, _, leg = port.partition("_")
    return f"{kind}{n}_{leg}" if leg else f"{port}{n}"


def _check(name: str, value: object, allowed: range | Sequence[object]) -> None:
    if value not in allowed:
        shown = (
            f"{allowed[0]}..{allowed[-1]}"
            if isinstance(allowed, range)
            else ", ".join(map(str, allowed))
        )
        raise UsageError(f"rapcores gateware: {name} = {value}; allowed: {shown}")
