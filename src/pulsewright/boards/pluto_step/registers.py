"""Registers of pluto_step: Pluto-step, four-axis step generator.

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

# Core clock. [Hz]
CLOCK_HZ: Final = 40_000_000

# Rate of the step generators. [Hz]
TICK_HZ: Final = 625_000

# Core clock cycles per tick; a tick is every such clock edge, edge 0 included. [cycle]
TICK_CYCLES: Final = 64

# Core clock cycles per watchdog tick; the first is edge 2047. [cycle]
WATCHDOG_CYCLES: Final = 2_048

# Watchdog ticks after an arm until the pins go high-Z: 6.4512 to 6.5024 ms. [watchdog tick]
WATCHDOG_TICKS: Final = 127

# Units of position per step at tap 0; each tap doubles it. [1/step]
UNITS_PER_STEP: Final = 2_048

# Axis 0..3 position (read)
R_POSITION: Final = (0x00, 0x04, 0x08, 0x0C)
R_POSITION_RESET: Final = 0x00000000
R_POSITION_VALUE_LSB: Final = 0
R_POSITION_VALUE_MASK: Final = 0x001FFFFF

# Digital inputs (read)
R_INPUTS: Final = 0x10
R_INPUTS_INPUTS_LSB: Final = 0
R_INPUTS_INPUTS_MASK: Final = 0x0000FFFF

# Identification (read)
R_IDENT: Final = 0x14
R_IDENT_RESET: Final = 0x50570104
R_IDENT_MAGIC_LSB: Final = 16
R_IDENT_MAGIC_MASK: Final = 0xFFFF0000
R_IDENT_VERSION_LSB: Final = 8
R_IDENT_VERSION_MASK: Final = 0x0000FF00
R_IDENT_AXES_LSB: Final = 0
R_IDENT_AXES_MASK: Final = 0x000000FF

# Status (read)
R_STATUS: Final = 0x18
R_STATUS_RESET: Final = 0x00000000
R_STATUS_MISSED_LSB: Final = 4
R_STATUS_MISSED_MASK: Final = 0x000000F0
R_STATUS_TRISTATE_LSB: Final = 1
R_STATUS_TRISTATE_MASK: Final = 0x00000002
R_STATUS_ENABLED_LSB: Final = 0
R_STATUS_ENABLED_MASK: Final = 0x00000001

# Tick count (read)
R_TICKS: Final = 0x1C
R_TICKS_RESET: Final = 0x00000000
R_TICKS_VALUE_LSB: Final = 0
R_TICKS_VALUE_MASK: Final = 0xFFFFFFFF

# Axis 0..3 velocity (write)
W_VELOCITY: Final = (0x00, 0x02, 0x04, 0x06)
W_VELOCITY_ALIAS: Final = (0x10, 0x12, 0x14, 0x16)
W_VELOCITY_RESET: Final = 0x0000
W_VELOCITY_VALUE_LSB: Final = 0
W_VELOCITY_VALUE_MASK: Final = 0x0FFF

# Digital outputs, watchdog (write)
W_OUTPUTS: Final = 0x08
W_OUTPUTS_ALIAS: Final = 0x18
W_OUTPUTS_RESET: Final = 0x0000
W_OUTPUTS_WATCHDOG_ARM_LSB: Final = 14
W_OUTPUTS_WATCHDOG_ARM_MASK: Final = 0x4000
W_OUTPUTS_LEVELS_LSB: Final = 0
W_OUTPUTS_LEVELS_MASK: Final = 0x3FFF

# Pulse timing (write)
W_TIMING: Final = 0x0A
W_TIMING_ALIAS: Final = 0x1A
W_TIMING_RESET: Final = 0x0000
W_TIMING_POLARITY_LSB: Final = 15
W_TIMING_POLARITY_MASK: Final = 0x8000
W_TIMING_DIRTIME_LSB: Final = 8
W_TIMING_DIRTIME_MASK: Final = 0x0F00
W_TIMING_TAP_LSB: Final = 6
W_TIMING_TAP_MASK: Final = 0x00C0
W_TIMING_STEPTIME_LSB: Final = 0
W_TIMING_STEPTIME_MASK: Final = 0x000F

# Pulse space (write)
W_SPACE: Final = 0x0C
W_SPACE_ALIAS: Final = 0x1C
W_SPACE_RESET: Final = 0x0000
W_SPACE_SPACE_LSB: Final = 0
W_SPACE_SPACE_MASK: Final = 0x000F

# Control (write)
W_CONTROL: Final = 0x0E
W_CONTROL_ALIAS: Final = 0x1E
W_CONTROL_RESET: Final = 0x0000
W_CONTROL_WATCHDOG_STOP_LSB: Final = 1
W_CONTROL_WATCHDOG_STOP_MASK: Final = 0x0002
W_CONTROL_JOINT_LSB: Final = 0
W_CONTROL_JOINT_MASK: Final = 0x0001

DEFAULT_PROFILE: Final = "exact"
PROFILES: Final[dict[str, dict[str, int]]] = {
    "exact": {
        "clean_cancel": 0,
        "enforce_space": 0,
        "tap_sync": 0,
        "joint_commit": 0,
        "wd_stop": 0,
        "no_alias": 0,
        "id_reg": 0,
        "status_reg": 0,
        "tick_reg": 0,
        "nwait_idle": 1,
    },
    "extended": {
        "clean_cancel": 1,
        "enforce_space": 1,
        "tap_sync": 1,
        "joint_commit": 1,
        "wd_stop": 1,
        "no_alias": 1,
        "id_reg": 1,
        "status_reg": 1,
        "tick_reg": 1,
        "nwait_idle": 1,
    },
}

MAP: Final = RegisterMap(
    board="pluto_step",
    title="Pluto-step, four-axis step generator",
    desc=(
        "FPGA board behind a parallel port (EPP) with four step and direction generators, 14 "
        "digital outputs, 16 digital inputs, an LED and a watchdog.\n"
        "\n"
        "One 5-bit address register serves reads and writes; it increments after each data byte "
        "and wraps from 1F to 00. Values of several bytes go low byte first.\n"
        "\n"
        "Written bytes: at an even address (and at every address above 0B where nothing commits) "
        "the byte goes to one shared low-byte latch; at the odd address it commits the register "
        "together with that latch, which it leaves as it is. So a lone high byte commits with a "
        "stale low byte. A commit is atomic; a tick at the same clock edge still uses the old "
        "value. Addresses 10..1F alias 00..0F (switch `no_alias`).\n"
        "\n"
        "Read bytes come from one 32-bit read latch, loaded with a whole register as the address "
        "reaches a multiple of 4 (before the tick of the same clock edge). A read that starts "
        "within a register, or where no register is, gives bytes of what was latched last. Bits "
        "without a field read 0 and are ignored when written.\n"
        "\n"
        "Reset (nINIT low, ours; the original has none) sets every register to 0."
    ),
    registers=(
        Register(
            board="pluto_step",
            name="POSITION",
            side="read",
            addresses=(0x00, 0x04, 0x08, 0x0C),
            size=4,
            title="Axis {n} position",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=21,
                    reset=0x00,
                    unit="step at tap 0",
                    desc="Modulo 2^21. A step is made whenever bit 11 + tap toggles.",
                    signed=True,
                    fracwidth=11,
                ),
            ),
            desc=(
                "What the axis has been told to move, also while its pins are high-Z. The document "
                "says 10.10 for these 21 bits; they are 10.11."
            ),
            latched="the bus cycle that reaches its first address",
        ),
        Register(
            board="pluto_step",
            name="INPUTS",
            side="read",
            addresses=(0x10,),
            size=4,
            title="Digital inputs",
            fields=(
                Field(name="inputs", lsb=0, width=16, reset=None, desc="Pin level.", per="input"),
            ),
            desc="Levels of the input pins, raw, all at one clock edge.",
            latched="the bus cycle that reaches its first address",
        ),
        Register(
            board="pluto_step",
            name="IDENT",
            side="read",
            addresses=(0x14,),
            size=4,
            title="Identification",
            fields=(
                Field(name="magic", lsb=16, width=16, reset=0x5057, desc="The letters PW."),
                Field(
                    name="version",
                    lsb=8,
                    width=8,
                    reset=0x01,
                    desc="Version of this register map.",
                ),
                Field(name="axes", lsb=0, width=8, reset=0x04, desc="Number of axes."),
            ),
            desc="Not in the original (ours), which has no register here.",
            latched="the bus cycle that reaches its first address",
            present_with=("id_reg",),
        ),
        Register(
            board="pluto_step",
            name="STATUS",
            side="read",
            addresses=(0x18,),
            size=4,
            title="Status",
            fields=(
                Field(
                    name="missed",
                    lsb=4,
                    width=4,
                    reset=0x00,
                    desc=(
                        "Two steps vanished since the last read; 0 without switch `enforce_space`. "
                        "One that vanishes at the clearing edge is kept."
                    ),
                    per="axis",
                    clear_on_read=True,
                ),
                Field(
                    name="tristate",
                    lsb=1,
                    width=1,
                    reset=0x00,
                    desc="1 = the watchdog has expired: outputs, step, dir and LED are high-Z.",
                ),
                Field(
                    name="enabled",
                    lsb=0,
                    width=1,
                    reset=0x00,
                    desc="1 = the watchdog was armed since reset.",
                ),
            ),
            desc="Not in the original (ours), which has no register here.",
            latched="the bus cycle that reaches its first address",
            present_with=("status_reg",),
        ),
        Register(
            board="pluto_step",
            name="TICKS",
            side="read",
            addresses=(0x1C,),
            size=4,
            title="Tick count",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="tick",
                    desc="Ticks since reset, before the clock edge that latches them; modulo 2^32.",
                ),
            ),
            desc="Not in the original (ours), which has no register here.",
            latched="the bus cycle that reaches its first address",
            present_with=("tick_reg",),
        ),
        Register(
            board="pluto_step",
            name="VELOCITY",
            side="write",
            addresses=(0x00, 0x02, 0x04, 0x06),
            size=2,
            title="Axis {n} velocity",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=12,
                    reset=0x00,
                    unit="step/tick at tap 0",
                    desc=(
                        "Step rate = value * TICK_HZ / 2^(11 + tap). Above 1024 (and with long "
                        "step times below it) pulses merge and steps vanish."
                    ),
                    signed=True,
                    fracwidth=11,
                ),
            ),
            desc=(
                "Added to the position at every tick; the sign is the direction, 0 counts as "
                "positive. The document says '+-.10' for these 12 bits; they are sign and 11 "
                "fraction bits. The client sends it sign-extended to 16 bits."
            ),
            takes_effect=(
                "at the write of the high byte, for the ticks after it; a change of sign waits for "
                "the direction time"
            ),
            aliases=(0x10, 0x12, 0x14, 0x16),
        ),
        Register(
            board="pluto_step",
            name="OUTPUTS",
            side="write",
            addresses=(0x08,),
            size=2,
            title="Digital outputs, watchdog",
            fields=(
                Field(
                    name="watchdog_arm",
                    lsb=14,
                    width=1,
                    reset=0x00,
                    desc=(
                        "1 = enable the watchdog and start its time again; 0 = nothing. Once "
                        "enabled it stays so until reset."
                    ),
                ),
                Field(name="levels", lsb=0, width=14, reset=0x00, desc="Pin level.", per="output"),
            ),
            desc=(
                "Levels of the output pins, and the one bit that feeds the watchdog. The "
                "document's table has the bit in the next register, its notes here; the original "
                "has it here only."
            ),
            takes_effect="at the write of the high byte, all bits at once",
            aliases=(0x18,),
        ),
        Register(
            board="pluto_step",
            name="TIMING",
            side="write",
            addresses=(0x0A,),
            size=2,
            title="Pulse timing",
            fields=(
                Field(
                    name="polarity",
                    lsb=15,
                    width=1,
                    reset=0x00,
                    desc="1 = the step pins are active low.",
                ),
                Field(
                    name="dirtime",
                    lsb=8,
                    width=4,
                    reset=0x00,
                    unit="tick",
                    desc=(
                        "Direction hold and set-up: DIR changes at least dirtime + 1 ticks after "
                        "STEP fell, the next step rises at least dirtime + 3 ticks after that."
                    ),
                ),
                Field(
                    name="tap",
                    lsb=6,
                    width=2,
                    reset=0x00,
                    desc=(
                        "Speed range: the step bit is bit 11 + tap of the position. Not in the "
                        "document. Change it at velocity 0 only; even then a spurious step may "
                        "come (switch `tap_sync`)."
                    ),
                ),
                Field(
                    name="steptime",
                    lsb=0,
                    width=4,
                    reset=0x00,
                    unit="tick",
                    desc="STEP is high for steptime + 1 ticks.",
                ),
            ),
            desc="For all axes.",
            takes_effect=(
                "at the write of the high byte, for the ticks after it; times that run keep their "
                "value, polarity changes at once"
            ),
            aliases=(0x1A,),
        ),
        Register(
            board="pluto_step",
            name="SPACE",
            side="write",
            addresses=(0x0C,),
            size=2,
            title="Pulse space",
            fields=(
                Field(
                    name="space",
                    lsb=0,
                    width=4,
                    reset=0x00,
                    unit="tick",
                    desc="STEP is low for at least space + 1 ticks.",
                ),
            ),
            desc="For all axes. Not in the original (ours), which has no register here.",
            takes_effect="at the write of the high byte, for the pulses that end after it",
            aliases=(0x1C,),
            present_with=("enforce_space",),
        ),
        Register(
            board="pluto_step",
            name="CONTROL",
            side="write",
            addresses=(0x0E,),
            size=2,
            title="Control",
            fields=(
                Field(
                    name="watchdog_stop",
                    lsb=1,
                    width=1,
                    reset=0x00,
                    desc=(
                        "1 = while the watchdog has expired, all velocities count as 0; they act "
                        "again after the next arm. With switch `wd_stop` only."
                    ),
                ),
                Field(
                    name="joint",
                    lsb=0,
                    width=1,
                    reset=0x00,
                    desc=(
                        "1 = velocities written act together with the next write of the outputs "
                        "register. An axis that is not written keeps its velocity. With switch "
                        "`joint_commit` only."
                    ),
                ),
            ),
            desc="Not in the original (ours), which has no register here.",
            takes_effect="at the write of the high byte",
            aliases=(0x1E,),
            present_with=("joint_commit", "wd_stop"),
        ),
    ),
    profiles=("exact", "extended"),
    switches=(
        ProfileSwitch(
            name="clean_cancel",
            meaning=(
                "A reversal cancelled during its hold time. Off: the hold timer goes on as step "
                "timer and the next reversal may flip DIR while STEP is high. On: the generator "
                "runs again at once."
            ),
            values=(0, 1),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="enforce_space",
            meaning=(
                "Space between pulses. Off: none is kept, pulses merge above the speed limit. On: "
                "at least the time of `W_SPACE`, and `R_STATUS` tells of steps that were missed."
            ),
            values=(0, 1),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="tap_sync",
            meaning="A change of tap. Off: each axis may make a spurious step. On: none.",
            values=(0, 1),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="joint_commit",
            meaning="On: `W_CONTROL` has the bit that lets the velocities of all axes act at once.",
            values=(0, 1),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="wd_stop",
            meaning="On: `W_CONTROL` has the bit that lets an expired watchdog stop the axes.",
            values=(0, 1),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="no_alias",
            meaning=(
                "Writes to 10..1F. Off: they act as writes to 00..0F. On: they do nothing but "
                "increment the address."
            ),
            values=(0, 1),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="id_reg",
            meaning="On: `R_IDENT` exists.",
            values=(0, 1),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="status_reg",
            meaning="On: `R_STATUS` exists.",
            values=(0, 1),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="tick_reg",
            meaning="On: `R_TICKS` exists.",
            values=(0, 1),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="nwait_idle",
            meaning=(
                "Level of nWait between bus cycles: 1 as the original, 0 as IEEE 1284 has it. "
                "Whether the original board inverts the line on its way out is not known."
            ),
            values=(1, 1),
            minimum=0,
            maximum=1,
        ),
    ),
    constants=(
        Constant(name="CLOCK_HZ", value=40000000, unit="Hz", desc="Core clock."),
        Constant(name="TICK_HZ", value=625000, unit="Hz", desc="Rate of the step generators."),
        Constant(
            name="TICK_CYCLES",
            value=64,
            unit="cycle",
            desc="Core clock cycles per tick; a tick is every such clock edge, edge 0 included.",
        ),
        Constant(
            name="WATCHDOG_CYCLES",
            value=2048,
            unit="cycle",
            desc="Core clock cycles per watchdog tick; the first is edge 2047.",
        ),
        Constant(
            name="WATCHDOG_TICKS",
            value=127,
            unit="watchdog tick",
            desc="Watchdog ticks after an arm until the pins go high-Z: 6.4512 to 6.5024 ms.",
        ),
        Constant(
            name="UNITS_PER_STEP",
            value=2048,
            unit="1/step",
            desc="Units of position per step at tap 0; each tap doubles it.",
        ),
    ),
    address_bits=5,
)
