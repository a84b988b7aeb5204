"""Registers of usc: Universal Stepper Controller (USC).

Generated from registers.rdl by `python -m pulsewright.registers.generate`; do not edit.
"""

from __future__ import annotations

from typing import Final

from pulsewright.registers.model import (
    Choice,
    Constant,
    Field,
    ProfileSwitch,
    Register,
    RegisterMap,
)

# Core clock (ours): a multiple of the rate clock. [Hz]
CLOCK_HZ: Final = 40_000_000

# Rate clock: the step rate generators, setup time and pulse width count its ticks. [Hz]
TICK_HZ: Final = 10_000_000

# Core clock cycles per tick; a tick is every such clock edge, edge 0 included. [cycle]
TICK_CYCLES: Final = 4

# Latch timer: ticks between latch events for each unit of its rate (ours: 100 us). [tick]
TIMER_UNIT_TICKS: Final = 1_000

# A latch event drives the Intr line for this time (ours: 1 us). [tick]
INTR_TICKS: Final = 10

# The document asks to hold a load position bit for at least this time (2 us). [tick]
LOAD_HOLD_TICKS: Final = 20

# Encoder 0..3 count (read)
R_ENCODER_COUNT: Final = (0x00, 0x03, 0x06, 0x09)
R_ENCODER_COUNT_RESET: Final = 0x000000
R_ENCODER_COUNT_VALUE_LSB: Final = 0
R_ENCODER_COUNT_VALUE_MASK: Final = 0xFFFFFF

# Index sense (read)
R_INDEX_SENSE: Final = 0x0C
R_INDEX_SENSE_RESET: Final = 0x00
R_INDEX_SENSE_SENSED_LSB: Final = 0
R_INDEX_SENSE_SENSED_MASK: Final = 0x0F

# Digital inputs 0..7 (read)
R_INPUTS_LOW: Final = 0x0D
R_INPUTS_LOW_INPUTS_LSB: Final = 0
R_INPUTS_LOW_INPUTS_MASK: Final = 0xFF

# Digital inputs 8..14, estop (read)
R_INPUTS_HIGH: Final = 0x0E
R_INPUTS_HIGH_RUNNING_LSB: Final = 7
R_INPUTS_HIGH_RUNNING_MASK: Final = 0x80
R_INPUTS_HIGH_INPUTS_LSB: Final = 0
R_INPUTS_HIGH_INPUTS_MASK: Final = 0x7F

# Module ID (read)
R_IDENT: Final = 0x0F
R_IDENT_RESET: Final = 0x41
R_IDENT_TYPE_LSB: Final = 4
R_IDENT_TYPE_MASK: Final = 0xF0
R_IDENT_VERSION_LSB: Final = 0
R_IDENT_VERSION_MASK: Final = 0x0F

# Assembly register (write)
W_ASSEMBLY: Final = 0x00
W_ASSEMBLY_RESET: Final = 0x000000
W_ASSEMBLY_VALUE_LSB: Final = 0
W_ASSEMBLY_VALUE_MASK: Final = 0xFFFFFF

# Timer configuration (write)
W_TIMER: Final = 0x04
W_TIMER_RESET: Final = 0x00
W_TIMER_SOFT_LATCH_LSB: Final = 5
W_TIMER_SOFT_LATCH_MASK: Final = 0x20
W_TIMER_MASTER_LSB: Final = 4
W_TIMER_MASTER_MASK: Final = 0x10
W_TIMER_RATE_LSB: Final = 0
W_TIMER_RATE_MASK: Final = 0x0F

# Slave (write)
W_SLAVE: Final = 0x06
W_SLAVE_RESET: Final = 0x00
W_SLAVE_ENABLE_LSB: Final = 0
W_SLAVE_ENABLE_MASK: Final = 0x01

# Encoder control (write)
W_ENCODER_CONTROL: Final = 0x0C
W_ENCODER_CONTROL_ALIAS: Final = 0x03
W_ENCODER_CONTROL_RESET: Final = 0x00
W_ENCODER_CONTROL_LOAD_LSB: Final = 4
W_ENCODER_CONTROL_LOAD_MASK: Final = 0xF0
W_ENCODER_CONTROL_INDEX_SELECT_LSB: Final = 0
W_ENCODER_CONTROL_INDEX_SELECT_MASK: Final = 0x0F

# Index reset (write)
W_INDEX_RESET: Final = 0x0D
W_INDEX_RESET_RESET: Final = 0x00
W_INDEX_RESET_AXES_LSB: Final = 0
W_INDEX_RESET_AXES_MASK: Final = 0x0F

# DAC or extra outputs on P8 (write)
W_DAC: Final = 0x0F
W_DAC_RESET: Final = 0x00
W_DAC_VALUE_LSB: Final = 0
W_DAC_VALUE_MASK: Final = 0xFF

# Axis 0..3 divisor (write)
W_DIVISOR: Final = (0x10, 0x13, 0x16, 0x19)
W_DIVISOR_RESET: Final = 0x000000
W_DIVISOR_VALUE_LSB: Final = 0
W_DIVISOR_VALUE_MASK: Final = 0xFFFFFF

# Rate generator control (write)
W_RATE_CONTROL: Final = 0x1C
W_RATE_CONTROL_RESET: Final = 0x00
W_RATE_CONTROL_RUN3_LSB: Final = 7
W_RATE_CONTROL_RUN3_MASK: Final = 0x80
W_RATE_CONTROL_DIR3_LSB: Final = 6
W_RATE_CONTROL_DIR3_MASK: Final = 0x40
W_RATE_CONTROL_RUN2_LSB: Final = 5
W_RATE_CONTROL_RUN2_MASK: Final = 0x20
W_RATE_CONTROL_DIR2_LSB: Final = 4
W_RATE_CONTROL_DIR2_MASK: Final = 0x10
W_RATE_CONTROL_RUN1_LSB: Final = 3
W_RATE_CONTROL_RUN1_MASK: Final = 0x08
W_RATE_CONTROL_DIR1_LSB: Final = 2
W_RATE_CONTROL_DIR1_MASK: Final = 0x04
W_RATE_CONTROL_RUN0_LSB: Final = 1
W_RATE_CONTROL_RUN0_MASK: Final = 0x02
W_RATE_CONTROL_DIR0_LSB: Final = 0
W_RATE_CONTROL_DIR0_MASK: Final = 0x01

# Setup time (write)
W_SETUP: Final = 0x1D
W_SETUP_RESET: Final = 0xFE
W_SETUP_CODE_LSB: Final = 0
W_SETUP_CODE_MASK: Final = 0xFF

# Step pulse width (write)
W_WIDTH: Final = 0x1E
W_WIDTH_RESET: Final = 0xFE
W_WIDTH_CODE_LSB: Final = 0
W_WIDTH_CODE_MASK: Final = 0xFF

# Estop release and outputs (write)
W_OUTPUTS: Final = 0x1F
W_OUTPUTS_RESET: Final = 0x00
W_OUTPUTS_ESTOP_RELEASE_LSB: Final = 7
W_OUTPUTS_ESTOP_RELEASE_MASK: Final = 0x80
W_OUTPUTS_SSR_LSB: Final = 0
W_OUTPUTS_SSR_MASK: Final = 0x7F

DEFAULT_PROFILE: Final = "document"
PROFILES: Final[dict[str, dict[str, int]]] = {
    "document": {
        "div_offset": 1,
        "time_code": 255,
        "min_space": 1,
        "ident": 0x41,
        "sense_gate": 0,
        "watchdog_us": 10000,
        "mariss": 0,
        "loopback": 0,
        "base": 0,
        "enc_filter": 1,
    },
    "linuxcnc": {
        "div_offset": 4,
        "time_code": 256,
        "min_space": 3,
        "ident": 0x41,
        "sense_gate": 0,
        "watchdog_us": 10000,
        "mariss": 0,
        "loopback": 0,
        "base": 0,
        "enc_filter": 1,
    },
}

MAP: Final = RegisterMap(
    board="usc",
    title="Universal Stepper Controller (USC)",
    desc=(
        "EPP board with four step and direction rate generators, four quadrature encoder counters, "
        "15 digital inputs, 7 outputs, an estop chain with watchdog, and one 8-bit DAC or extra "
        "output port.\n"
        "\n"
        "An EPP address byte selects the board with bits 7:5 and the register with bits 4:0 (the "
        "document writes 4 + 5 bits and gives 3 + 5 as its example). After each data byte the "
        "register address increments and wraps from 1F to 00 in the same board (ours). Values of "
        "several bytes go low byte first.\n"
        "\n"
        "Addresses without a register read 00 and ignore writes (ours). Bus reset (nINIT low) "
        "resets every register, counter and holding register and enters estop. Rewriting a "
        "register with an equal value restarts nothing."
    ),
    registers=(
        Register(
            board="usc",
            name="ENCODER_COUNT",
            side="read",
            addresses=(0x00, 0x03, 0x06, 0x09),
            size=3,
            title="Encoder {n} count",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=24,
                    reset=0x00,
                    unit="count",
                    desc="Low byte first.",
                    signed=True,
                ),
            ),
            desc=(
                "Position: every edge of the quadrature inputs counts, straight binary with plain "
                "24-bit wrap. A holding register, so that the three bytes belong together."
            ),
            latched="a latch event with index select 0, or a rising index edge with index select 1",
        ),
        Register(
            board="usc",
            name="INDEX_SENSE",
            side="read",
            addresses=(0x0C,),
            size=1,
            title="Index sense",
            fields=(
                Field(
                    name="sensed",
                    lsb=0,
                    width=4,
                    reset=0x00,
                    desc="A rising index edge came; see switch `sense_gate`.",
                    per="axis",
                    clear_on_read=True,
                ),
            ),
            desc=(
                "Index pulses seen since the last read. Read it once to discard what was sensed "
                "before; an edge during the clearing read is kept (ours)."
            ),
        ),
        Register(
            board="usc",
            name="INPUTS_LOW",
            side="read",
            addresses=(0x0D,),
            size=1,
            title="Digital inputs 0..7",
            fields=(
                Field(name="inputs", lsb=0, width=8, reset=None, desc="Pin level.", per="input"),
            ),
            desc="Levels of the input pins, as they are at the read.",
        ),
        Register(
            board="usc",
            name="INPUTS_HIGH",
            side="read",
            addresses=(0x0E,),
            size=1,
            title="Digital inputs 8..14, estop",
            fields=(
                Field(
                    name="running",
                    lsb=7,
                    width=1,
                    reset=0x00,
                    desc=(
                        "Estop status. The document says 'Estop' only; the client wants 1 = "
                        "running."
                    ),
                    choices=(
                        Choice(
                            name="in_estop",
                            value=0,
                            desc="no step pulses, outputs and DAC forced to 0",
                        ),
                        Choice(name="running", value=1, desc="out of estop"),
                    ),
                ),
                Field(
                    name="inputs",
                    lsb=0,
                    width=7,
                    reset=None,
                    desc="Pin level.",
                    per="input",
                    first=8,
                ),
            ),
            desc="Levels of the input pins, as they are at the read, and the estop status.",
        ),
        Register(
            board="usc",
            name="IDENT",
            side="read",
            addresses=(0x0F,),
            size=1,
            title="Module ID",
            fields=(
                Field(
                    name="type",
                    lsb=4,
                    width=4,
                    reset=0x04,
                    desc="Type of the board.",
                    choices=(
                        Choice(name="ppmc_encoder", value=1, desc="PPMC encoder card"),
                        Choice(name="ppmc_dac", value=2, desc="PPMC DAC card"),
                        Choice(name="ppmc_dio", value=3, desc="PPMC digital I/O card"),
                        Choice(name="usc", value=4, desc="Universal Stepper Controller"),
                        Choice(name="upc", value=5, desc="Universal PWM Controller"),
                    ),
                ),
                Field(
                    name="version",
                    lsb=0,
                    width=4,
                    reset=0x01,
                    desc="Version; 2 and above have index reset.",
                ),
            ),
            desc="Type and version of the board. Version F is never used.",
            follows="ident",
        ),
        Register(
            board="usc",
            name="ASSEMBLY",
            side="write",
            addresses=(0x00,),
            size=3,
            title="Assembly register",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=24,
                    reset=0x00,
                    unit="count",
                    desc="Low byte first.",
                ),
            ),
            desc=(
                "The one 24-bit register that all values of three bytes pass through: the byte "
                "written at 00, 01, 02 or at an axis' divisor replaces the same byte of it. An "
                "encoder loads it through its load position bit."
            ),
            takes_effect="at the write of each byte",
            assembly="ASSEMBLY",
        ),
        Register(
            board="usc",
            name="TIMER",
            side="write",
            addresses=(0x04,),
            size=1,
            title="Timer configuration",
            fields=(
                Field(
                    name="soft_latch",
                    lsb=5,
                    width=1,
                    reset=0x00,
                    desc=(
                        "Soft latch: the change from 0 to 1 is a latch event, also with master 0. "
                        "The client writes 20, 20, 00 before it reads the encoders."
                    ),
                ),
                Field(
                    name="master",
                    lsb=4,
                    width=1,
                    reset=0x00,
                    desc="1 = the timer of this board runs.",
                ),
                Field(
                    name="rate",
                    lsb=0,
                    width=4,
                    reset=0x00,
                    unit="100 us",
                    desc=(
                        "Time between latch events of the timer; 0 = none. The document's table is "
                        "empty, the time is ours; a new rate does not restart the timer."
                    ),
                ),
            ),
            desc=(
                "Sources of latch events. A latch event copies the encoder counters to their "
                "holding registers, on this board and, over the Intr line, on all others."
            ),
            takes_effect="at the write",
        ),
        Register(
            board="usc",
            name="SLAVE",
            side="write",
            addresses=(0x06,),
            size=1,
            title="Slave",
            fields=(
                Field(
                    name="enable",
                    lsb=0,
                    width=1,
                    reset=0x00,
                    desc="1 = the board takes its own estop chain input as closed.",
                ),
            ),
            desc=(
                "Not in the document: the client writes 1 to its second and later boards. The "
                "meaning is inferred (ours)."
            ),
            takes_effect="at the write; clearing it while the estop chain is open enters estop",
        ),
        Register(
            board="usc",
            name="ENCODER_CONTROL",
            side="write",
            addresses=(0x0C,),
            size=1,
            title="Encoder control",
            fields=(
                Field(
                    name="load",
                    lsb=4,
                    width=4,
                    reset=0x00,
                    desc=(
                        "Load position: while the bit is 1, the encoder's counter follows the "
                        "assembly register, and its counts are lost. Several axes may load the "
                        "same value. The document sets it, holds it for at least 2 us and clears "
                        "it; the client sets it first and writes the value afterwards."
                    ),
                    per="axis",
                ),
                Field(
                    name="index_select",
                    lsb=0,
                    width=4,
                    reset=0x00,
                    desc=(
                        "Index select: 1 = only a rising index edge loads the encoder's holding "
                        "register; 0 = every latch event loads it (soft latch, timer, Intr line)."
                    ),
                    per="axis",
                ),
            ),
            desc=(
                "The document has it at 0C, the client writes 03: both addresses reach this "
                "register."
            ),
            takes_effect="at the write",
            aliases=(0x03,),
        ),
        Register(
            board="usc",
            name="INDEX_RESET",
            side="write",
            addresses=(0x0D,),
            size=1,
            title="Index reset",
            fields=(
                Field(
                    name="axes",
                    lsb=0,
                    width=4,
                    reset=0x00,
                    desc="1 = a rising index edge sets the counter to 0.",
                    per="axis",
                ),
            ),
            desc="Not in the document. Boards of version 1 ignore it (switch `ident`).",
            takes_effect=(
                "at the next rising index edge of the axis, and at every later one until the bit "
                "is written 0"
            ),
            min_version=2,
        ),
        Register(
            board="usc",
            name="DAC",
            side="write",
            addresses=(0x0F,),
            size=1,
            title="DAC or extra outputs on P8",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=8,
                    reset=0x00,
                    desc="00 = 0 V .. FF = 10 V, or the outputs.",
                    formula="value / 255 * 10 V",
                ),
            ),
            desc=(
                "With a DAC fitted the magnitude of a voltage (its sign is left to two outputs), "
                "else eight digital outputs. Forced to 0 in estop."
            ),
            takes_effect="at the write; in estop at the release",
        ),
        Register(
            board="usc",
            name="DIVISOR",
            side="write",
            addresses=(0x10, 0x13, 0x16, 0x19),
            size=3,
            title="Axis {n} divisor",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=24,
                    reset=0x00,
                    unit="tick",
                    desc="Low byte first.",
                    formula=(
                        "period = value + {div_offset} ticks, rate = TICK_HZ / (value + "
                        "{div_offset})"
                    ),
                ),
            ),
            desc=(
                "Step rate: pulses of the rate clock between two steps. 0, illegal in the "
                "document, halts the axis. A counter that exceeds a new divisor steps at once, and "
                "once only. All 12 bytes and the control register after them can be written in one "
                "burst."
            ),
            takes_effect="at the write of the high byte, for the tick after it",
            assembly="ASSEMBLY",
            commits=True,
        ),
        Register(
            board="usc",
            name="RATE_CONTROL",
            side="write",
            addresses=(0x1C,),
            size=1,
            title="Rate generator control",
            fields=(
                Field(
                    name="run3",
                    lsb=7,
                    width=1,
                    reset=0x00,
                    desc="1 = axis 3 steps at its programmed rate.",
                ),
                Field(name="dir3", lsb=6, width=1, reset=0x00, desc="Direction of axis 3."),
                Field(
                    name="run2",
                    lsb=5,
                    width=1,
                    reset=0x00,
                    desc="1 = axis 2 steps at its programmed rate.",
                ),
                Field(name="dir2", lsb=4, width=1, reset=0x00, desc="Direction of axis 2."),
                Field(
                    name="run1",
                    lsb=3,
                    width=1,
                    reset=0x00,
                    desc="1 = axis 1 steps at its programmed rate.",
                ),
                Field(name="dir1", lsb=2, width=1, reset=0x00, desc="Direction of axis 1."),
                Field(
                    name="run0",
                    lsb=1,
                    width=1,
                    reset=0x00,
                    desc="1 = axis 0 steps at its programmed rate.",
                ),
                Field(name="dir0", lsb=0, width=1, reset=0x00, desc="Direction of axis 0."),
            ),
            desc=(
                "Run and direction of each axis. Direction follows the bit after the setup time, "
                "whether the axis runs or not. The client writes direction 1 for velocities of 0 "
                "and above."
            ),
            takes_effect=(
                "at the write, for the tick after it; a direction change waits for the setup time "
                "after a step"
            ),
        ),
        Register(
            board="usc",
            name="SETUP",
            side="write",
            addresses=(0x1D,),
            size=1,
            title="Setup time",
            fields=(
                Field(
                    name="code",
                    lsb=0,
                    width=8,
                    reset=0xFE,
                    desc="Time code; the reset value is ours.",
                    formula="ticks = {time_code} - code, at least 1; 1 tick = 0.1 us",
                ),
            ),
            desc=(
                "For all axes: a direction change waits this long after a step pulse, a step pulse "
                "this long after a direction change. The document gives codes 0 to 254 for 25.4 to "
                "0.1 us and forbids 255; code 0 would be 25.5 us."
            ),
            takes_effect=(
                "for the delays that start after the write; one that runs keeps its time (ours)"
            ),
        ),
        Register(
            board="usc",
            name="WIDTH",
            side="write",
            addresses=(0x1E,),
            size=1,
            title="Step pulse width",
            fields=(
                Field(
                    name="code",
                    lsb=0,
                    width=8,
                    reset=0xFE,
                    desc="Time code; the reset value is ours.",
                    formula="ticks = {time_code} - code, at least 1; 1 tick = 0.1 us",
                ),
            ),
            desc="For all axes. Codes as for the setup time.",
            takes_effect=(
                "for the pulses that start after the write; one that runs keeps its width (ours)"
            ),
        ),
        Register(
            board="usc",
            name="OUTPUTS",
            side="write",
            addresses=(0x1F,),
            size=1,
            title="Estop release and outputs",
            fields=(
                Field(
                    name="estop_release",
                    lsb=7,
                    width=1,
                    reset=0x00,
                    desc=(
                        "The change from 0 to 1 leaves estop if the chain is closed and the "
                        "watchdog is fed (ours; the client accepts it); 0 enters estop at once."
                    ),
                ),
                Field(name="ssr", lsb=0, width=7, reset=0x00, desc="1 = output on.", per="output"),
            ),
            desc="Outputs for solid state relays, and the way out of estop.",
            takes_effect="at the write; in estop the outputs are 0 and the bits act at the release",
        ),
    ),
    profiles=("document", "linuxcnc"),
    switches=(
        ProfileSwitch(
            name="div_offset",
            meaning=(
                "Step period = divisor + div_offset. The document's 1 -> 5 MHz and 2 -> 3.333 MHz "
                "give 1 (its 4 -> 2.5 MHz gives 0, or is a slip for 3); the client subtracts 4."
            ),
            values=(1, 4),
            minimum=0,
            maximum=4,
            unit="tick",
        ),
        ProfileSwitch(
            name="time_code",
            meaning=(
                "Setup time and pulse width in ticks = time_code - code; never below 1 tick, so "
                "that code FF, forbidden by the document, acts as 1 tick."
            ),
            values=(255, 256),
            minimum=255,
            maximum=256,
        ),
        ProfileSwitch(
            name="min_space",
            meaning=(
                "Shortest time that a step pin is low between two pulses: 1 makes 5 MHz reachable, "
                "the client's limits ask for 300 ns."
            ),
            values=(1, 3),
            minimum=1,
            maximum=256,
            unit="tick",
        ),
        ProfileSwitch(
            name="ident",
            meaning=(
                "Module ID that the board answers with. 42 and above have index reset, which the "
                "client needs for homing to an index."
            ),
            values=(65, 65),
            minimum=65,
            maximum=78,
            unit="hex",
        ),
        ProfileSwitch(
            name="sense_gate",
            meaning=(
                "Which index edges set the index sense bit: the document wants index select set, "
                "the client never sets it and still reads the bit."
            ),
            values=(0, 0),
            minimum=0,
            maximum=1,
            choices=(
                Choice(name="always", value=0, desc="every rising index edge"),
                Choice(
                    name="gated",
                    value=1,
                    desc="those with index select or index reset of the axis set",
                ),
            ),
        ),
        ProfileSwitch(
            name="watchdog_us",
            meaning=(
                "Estop this long after the last commit on two adjacent axes (time and rule not "
                "documented); 0 = watchdog off."
            ),
            values=(10000, 10000),
            minimum=0,
            maximum=1000000,
            unit="us",
        ),
        ProfileSwitch(
            name="mariss",
            meaning=(
                "The 'Mariss' DIP switch, which the document only names. On (ours): no setup time, "
                "direction changes as the step pin falls."
            ),
            values=(0, 0),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="loopback",
            meaning="On: each step counts into the axis' encoder in place of its quadrature input.",
            values=(0, 0),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="base",
            meaning="Board select bits that the board answers to.",
            values=(0, 0),
            minimum=0,
            maximum=7,
        ),
        ProfileSwitch(
            name="enc_filter",
            meaning="Equal samples that an encoder input needs before its level counts.",
            values=(1, 1),
            minimum=1,
            maximum=255,
            unit="sample",
        ),
    ),
    constants=(
        Constant(
            name="CLOCK_HZ",
            value=40000000,
            unit="Hz",
            desc="Core clock (ours): a multiple of the rate clock.",
        ),
        Constant(
            name="TICK_HZ",
            value=10000000,
            unit="Hz",
            desc=(
                "Rate clock: the step rate generators, setup time and pulse width count its ticks."
            ),
        ),
        Constant(
            name="TICK_CYCLES",
            value=4,
            unit="cycle",
            desc="Core clock cycles per tick; a tick is every such clock edge, edge 0 included.",
        ),
        Constant(
            name="TIMER_UNIT_TICKS",
            value=1000,
            unit="tick",
            desc=(
                "Latch timer: ticks between latch events for each unit of its rate (ours: 100 us)."
            ),
        ),
        Constant(
            name="INTR_TICKS",
            value=10,
            unit="tick",
            desc="A latch event drives the Intr line for this time (ours: 1 us).",
        ),
        Constant(
            name="LOAD_HOLD_TICKS",
            value=20,
            unit="tick",
            desc="The document asks to hold a load position bit for at least this time (2 us).",
        ),
    ),
    address_bits=5,
)
