"""Registers of s3g: S3G motion controller.

Generated from registers.rdl by `python -m pulsewright.registers.generate`; do not edit.
"""

from __future__ import annotations

from typing import Final

from pulsewright.registers.model import (
    Argument,
    Choice,
    Code,
    Constant,
    Field,
    ProfileSwitch,
    Register,
    RegisterMap,
    Table,
)

# Clock of everything. [Hz]
CLOCK_HZ: Final = 50_000_000

# From both rst_n and cclk high until the board runs. [cycle]
READY_CYCLES: Final = 1_024

# Channels of the original.
CHANNELS: Final = 2

# Channels that the registers have room for.
MAX_CHANNELS: Final = 6

# Units of position per step. [1/step]
STEP_UNITS: Final = 65_536

# UART 1, pins avr_tx and avr_rx. [baud]
BAUD1: Final = 500_000

# UART 2, pins ext_tx and ext_rx. [baud]
BAUD2: Final = 115_200

# Baud rates are multiples of it; the multiple is added in every clock cycle. [baud]
BAUD_UNIT: Final = 100

# Where that sum gives an enable, 16 of which are a bit.
BAUD_LIMIT: Final = 31_250

# Between reports of interrupts that stay pending. [cycle]
INTS_TIMER: Final = 1_000_000

# In profile `robust`: without a byte for so long inside a packet, the packet is given up. [cycle]
RX_TIMEOUT: Final = 1_000_000

# Program memory; addresses wrap. [word]
PROG_WORDS: Final = 8_192

# A program word, low byte first. [byte]
PROG_WORD_BYTES: Final = 5

# Lowest bit of the class (2 bits) of a program word. [bit]
PROG_CLASS_LSB: Final = 38

# Lowest bit of the opcode or register number (6 bits) of a program word. [bit]
PROG_OPCODE_LSB: Final = 32

# First byte of a packet.
HEADER: Final = 0xD5

# x^8 + x^5 + x^4 + 1 for shifting right, from 0, over the payload.
CRC_POLYNOMIAL: Final = 0x8C

# Tag of reports, which nobody asked for.
REPORT_TAG: Final = 0xFFFF

# Answer to `CMD_VERSION`.
VERSION: Final = 0xCEBA

# Answer to `CMD_EXT_VER`, first four bytes.
EXT_VERSION_LOW: Final = 0x10001

# Answer to `CMD_EXT_VER`, last four bytes.
EXT_VERSION_HIGH: Final = 0xCE

# Clock cycle of the acceleration step (read)
R_ASG_DT: Final = 0
R_ASG_DT_RESET: Final = 0x00000000
R_ASG_DT_VALUE_LSB: Final = 0
R_ASG_DT_VALUE_MASK: Final = 0xFFFFFFFF

# Acceleration step (read)
R_ASG_STEP: Final = 1
R_ASG_STEP_RESET: Final = 0x00000000
R_ASG_STEP_VALUE_LSB: Final = 0
R_ASG_STEP_VALUE_MASK: Final = 0xFFFFFFFF

# Program executor (read)
R_BE_CONTROL: Final = 62
R_BE_CONTROL_RESET: Final = 0x00000000
R_BE_CONTROL_BUSY_LSB: Final = 31
R_BE_CONTROL_BUSY_MASK: Final = 0x80000000
R_BE_CONTROL_WAITING_LSB: Final = 30
R_BE_CONTROL_WAITING_MASK: Final = 0x40000000
R_BE_CONTROL_ERROR_LSB: Final = 16
R_BE_CONTROL_ERROR_MASK: Final = 0x00FF0000
R_BE_CONTROL_PC_LSB: Final = 0
R_BE_CONTROL_PC_MASK: Final = 0x0000FFFF

# Loop-back (read)
R_SE_REG_LB: Final = 63
R_SE_REG_LB_RESET: Final = 0x00000000
R_SE_REG_LB_VALUE_LSB: Final = 0
R_SE_REG_LB_VALUE_MASK: Final = 0xFFFFFFFF

# LEDs (write)
W_LEDS: Final = 0
W_LEDS_RESET: Final = 0x00000000
W_LEDS_LEDS_LSB: Final = 0
W_LEDS_LEDS_MASK: Final = 0x000000FF

# Acceleration steps (write)
W_ASG_STEPS_VAL: Final = 1
W_ASG_STEPS_VAL_RESET: Final = 0x00000000
W_ASG_STEPS_VAL_VALUE_LSB: Final = 0
W_ASG_STEPS_VAL_VALUE_MASK: Final = 0xFFFFFFFF

# Length of an acceleration step (write)
W_ASG_DT_VAL: Final = 2
W_ASG_DT_VAL_RESET: Final = 0x00000000
W_ASG_DT_VAL_VALUE_LSB: Final = 0
W_ASG_DT_VAL_VALUE_MASK: Final = 0xFFFFFFFF

# Load control (write)
W_ASG_CONTROL: Final = 3
W_ASG_CONTROL_RESET: Final = 0x00000000
W_ASG_CONTROL_CHANNEL2_LSB: Final = 24
W_ASG_CONTROL_CHANNEL2_MASK: Final = 0x3F000000
W_ASG_CONTROL_CHANNEL1_LSB: Final = 16
W_ASG_CONTROL_CHANNEL1_MASK: Final = 0x003F0000
W_ASG_CONTROL_CHANNEL0_LSB: Final = 8
W_ASG_CONTROL_CHANNEL0_MASK: Final = 0x00003F00
W_ASG_CONTROL_RESET_DT_LSB: Final = 3
W_ASG_CONTROL_RESET_DT_MASK: Final = 0x00000008
W_ASG_CONTROL_RESET_STEPS_LSB: Final = 2
W_ASG_CONTROL_RESET_STEPS_MASK: Final = 0x00000004
W_ASG_CONTROL_DT_LIMIT_LSB: Final = 1
W_ASG_CONTROL_DT_LIMIT_MASK: Final = 0x00000002
W_ASG_CONTROL_STEPS_LIMIT_LSB: Final = 0
W_ASG_CONTROL_STEPS_LIMIT_MASK: Final = 0x00000001

# Pulse timing: start (write)
W_MSG_ALL_PRE_N: Final = 4
W_MSG_ALL_PRE_N_RESET: Final = 0x00000000
W_MSG_ALL_PRE_N_VALUE_LSB: Final = 0
W_MSG_ALL_PRE_N_VALUE_MASK: Final = 0xFFFFFFFF

# Pulse timing: end (write)
W_MSG_ALL_PULSE_N: Final = 5
W_MSG_ALL_PULSE_N_RESET: Final = 0x00000000
W_MSG_ALL_PULSE_N_VALUE_LSB: Final = 0
W_MSG_ALL_PULSE_N_VALUE_MASK: Final = 0xFFFFFFFF

# Pulse timing: ready (write)
W_MSG_ALL_POST_N: Final = 6
W_MSG_ALL_POST_N_RESET: Final = 0x00000000
W_MSG_ALL_POST_N_VALUE_LSB: Final = 0
W_MSG_ALL_POST_N_VALUE_MASK: Final = 0xFFFFFFFF

# Motor enable (write)
W_MSG_CONTROL: Final = 7
W_MSG_CONTROL_RESET: Final = 0x00000000
W_MSG_CONTROL_ENABLE_LSB: Final = 0
W_MSG_CONTROL_ENABLE_MASK: Final = 0x0000003F

# Channel 0..5 position, low half (write)
W_X_VAL_LO: Final = (8, 16, 24, 32, 40, 48)
W_X_VAL_LO_RESET: Final = 0x00000000
W_X_VAL_LO_VALUE_LSB: Final = 0
W_X_VAL_LO_VALUE_MASK: Final = 0xFFFFFFFF

# Channel 0..5 position, high half (write)
W_X_VAL_HI: Final = (9, 17, 25, 33, 41, 49)
W_X_VAL_HI_RESET: Final = 0x00000000
W_X_VAL_HI_VALUE_LSB: Final = 0
W_X_VAL_HI_VALUE_MASK: Final = 0xFFFFFFFF

# Channel 0..5 velocity (write)
W_V_VAL: Final = (10, 18, 26, 34, 42, 50)
W_V_VAL_RESET: Final = 0x00000000
W_V_VAL_VALUE_LSB: Final = 0
W_V_VAL_VALUE_MASK: Final = 0xFFFFFFFF

# Channel 0..5 acceleration (write)
W_A_VAL: Final = (11, 19, 27, 35, 43, 51)
W_A_VAL_RESET: Final = 0x00000000
W_A_VAL_VALUE_LSB: Final = 0
W_A_VAL_VALUE_MASK: Final = 0xFFFFFFFF

# Channel 0..5 jerk (write)
W_J_VAL: Final = (12, 20, 28, 36, 44, 52)
W_J_VAL_RESET: Final = 0x00000000
W_J_VAL_VALUE_LSB: Final = 0
W_J_VAL_VALUE_MASK: Final = 0xFFFFFFFF

# Channel 0..5 change of jerk (write)
W_JJ_VAL: Final = (13, 21, 29, 37, 45, 53)
W_JJ_VAL_RESET: Final = 0x00000000
W_JJ_VAL_VALUE_LSB: Final = 0
W_JJ_VAL_VALUE_MASK: Final = 0xFFFFFFFF

# Channel 0..5 target velocity (write)
W_TARGET_V_VAL: Final = (14, 22, 30, 38, 46, 54)
W_TARGET_V_VAL_RESET: Final = 0x00000000
W_TARGET_V_VAL_VALUE_LSB: Final = 0
W_TARGET_V_VAL_VALUE_MASK: Final = 0xFFFFFFFF

# Channel 0..5 abort deceleration (write)
W_ABORT_A_VAL: Final = (15, 23, 31, 39, 47, 55)
W_ABORT_A_VAL_RESET: Final = 0x00000000
W_ABORT_A_VAL_VALUE_LSB: Final = 0
W_ABORT_A_VAL_VALUE_MASK: Final = 0xFFFFFFFF

# Load control of channels 3 to 5 (write)
W_ASG_CONTROL2: Final = 60
W_ASG_CONTROL2_RESET: Final = 0x00000000
W_ASG_CONTROL2_CHANNEL5_LSB: Final = 16
W_ASG_CONTROL2_CHANNEL5_MASK: Final = 0x003F0000
W_ASG_CONTROL2_CHANNEL4_LSB: Final = 8
W_ASG_CONTROL2_CHANNEL4_MASK: Final = 0x00003F00
W_ASG_CONTROL2_CHANNEL3_LSB: Final = 0
W_ASG_CONTROL2_CHANNEL3_MASK: Final = 0x0000003F

# Program start (write)
W_BE_START_ADDR: Final = 62
W_BE_START_ADDR_RESET: Final = 0x00000000
W_BE_START_ADDR_ADDRESS_LSB: Final = 0
W_BE_START_ADDR_ADDRESS_MASK: Final = 0x0000FFFF

# Loop-back (write)
W_SE_REG_LB: Final = 63
W_SE_REG_LB_RESET: Final = 0x00000000
W_SE_REG_LB_VALUE_LSB: Final = 0
W_SE_REG_LB_VALUE_MASK: Final = 0xFFFFFFFF

# Interrupts [bit]
INT_ASG_DONE: Final = 0
INT_ASG_ABORT: Final = 1
INT_BE_COMPLETE: Final = 30
INT_SE_INT_LB: Final = 31

# Strobes [bit]
STB_ASG_LOAD: Final = 0
STB_BE_START: Final = 29
STB_BE_ABORT: Final = 30
STB_SE_INT_LB: Final = 31

# Load bits of a channel [bit]
SET_X: Final = 0
SET_V: Final = 1
SET_A: Final = 2
SET_J: Final = 3
SET_JJ: Final = 4
SET_TARGET_V: Final = 5

# Commands
CMD_VERSION: Final = 0
CMD_EXT_VER: Final = 27
CMD_OUTPUT: Final = 60
CMD_INPUT: Final = 61
CMD_STB: Final = 62
CMD_CLEAR: Final = 63
CMD_MASK: Final = 64
CMD_WRITE_BUFFER: Final = 65

# Reply codes
REPLY_INTERRUPT: Final = 0x50
REPLY_ERROR: Final = 0x80
REPLY_OK: Final = 0x81
REPLY_BUF_ERROR: Final = 0x82
REPLY_UNKNOWN: Final = 0x85

# Classes of program words
CLASS_OUTPUT: Final = 1
CLASS_CONTROL: Final = 2

# Opcodes of control words
OP_NOP: Final = 0
OP_STB: Final = 1
OP_WAIT_ALL: Final = 2
OP_WAIT_ANY: Final = 3
OP_CLEAR: Final = 4
OP_DONE: Final = 63

# Error codes of the program executor
BE_RUNNING: Final = 0x00
BE_WAITING: Final = 0x02
BE_ILLEGAL: Final = 0x81
BE_ABORTED: Final = 0x82

DEFAULT_PROFILE: Final = "exact"
PROFILES: Final[dict[str, dict[str, int]]] = {
    "exact": {
        "abort_dt_latched": 0,
        "rx_timeout": 0,
        "length_check": 0,
        "hold_buffer": 0,
        "req_queue": 0,
        "reply_port": 0,
        "x_sign_extended": 0,
    },
    "robust": {
        "abort_dt_latched": 0,
        "rx_timeout": 1000000,
        "length_check": 1,
        "hold_buffer": 1,
        "req_queue": 1,
        "reply_port": 1,
        "x_sign_extended": 1,
    },
}

MAP: Final = RegisterMap(
    board="s3g",
    title="S3G motion controller",
    desc=(
        "FPGA behind two serial ports (8N1) with one step generator per channel, a generator of "
        "acceleration steps for all of them, and a program memory with an executor.\n"
        "\n"
        "64 output registers are written, 64 input registers read, each of 32 bits; an address is "
        "the number of a register. Numbers on the wire go low byte first. Output registers without "
        "an entry are storage without function, input registers without one read 0; of the output "
        "registers only `W_SE_REG_LB` can be read back.\n"
        "\n"
        "Channel c has output registers 8 + 8 c to 15 + 8 c, a group of six bits in "
        "`W_ASG_CONTROL`, and a bit in `W_MSG_CONTROL`. The document has channel 0 (X), the "
        "original 0 and 1 (X, Y); channels 2..5 are ours and are there in builds with so many. The "
        "registers have no room for more.\n"
        "\n"
        "A write is visible one clock cycle later. Reset sets every output register to 0."
    ),
    registers=(
        Register(
            board="s3g",
            name="ASG_DT",
            side="read",
            addresses=(0x00,),
            size=4,
            title="Clock cycle of the acceleration step",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="cycle",
                    desc="Clock cycles since the last acceleration step or reset of the counter.",
                ),
            ),
            desc="It goes on when nothing moves.",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="ASG_STEP",
            side="read",
            addresses=(0x01,),
            size=4,
            title="Acceleration step",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="acceleration step",
                    desc="Acceleration steps since the counter was reset.",
                ),
            ),
            desc="In an abort too.",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="BE_CONTROL",
            side="read",
            addresses=(0x3E,),
            size=4,
            title="Program executor",
            fields=(
                Field(name="busy", lsb=31, width=1, reset=0x00, desc="1 = a program runs."),
                Field(
                    name="waiting",
                    lsb=30,
                    width=1,
                    reset=0x00,
                    desc="1 = it waits for interrupts.",
                ),
                Field(name="error", lsb=16, width=8, reset=0x00, desc="Error code, see table BE."),
                Field(
                    name="pc",
                    lsb=0,
                    width=16,
                    reset=0x00,
                    unit="word",
                    desc="Address of the program word; in memory modulo its size.",
                ),
            ),
            desc="What it does now. `busy` is one clock cycle late.",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="SE_REG_LB",
            side="read",
            addresses=(0x3F,),
            size=4,
            title="Loop-back",
            fields=(Field(name="value", lsb=0, width=32, reset=0x00, desc="Output register 63."),),
            desc="For tests of the link.",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="LEDS",
            side="write",
            addresses=(0x00,),
            size=4,
            title="LEDs",
            fields=(Field(name="leds", lsb=0, width=8, reset=0x00, desc="Pin level.", per="pin"),),
            desc="Levels of the pins led0 to led7.",
            takes_effect="at once",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="ASG_STEPS_VAL",
            side="write",
            addresses=(0x01,),
            size=4,
            title="Acceleration steps",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="acceleration step",
                    desc="0 gives one step, as 1 does.",
                ),
            ),
            desc=(
                'Length of a cycle. The document\'s "steps" are acceleration steps, at which '
                "velocity changes, and not steps of a motor."
            ),
            takes_effect="at a load with `steps_limit`",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="ASG_DT_VAL",
            side="write",
            addresses=(0x02,),
            size=4,
            title="Length of an acceleration step",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="cycle",
                    desc="0 ends the cycle: the generator goes idle.",
                ),
            ),
            desc="For all channels.",
            takes_effect=(
                "at a load with `dt_limit`; in an abort at once (switch `abort_dt_latched`)"
            ),
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="ASG_CONTROL",
            side="write",
            addresses=(0x03,),
            size=4,
            title="Load control",
            fields=(
                Field(
                    name="channel2",
                    lsb=24,
                    width=6,
                    reset=0x00,
                    desc="What to set of channel 2, see Load bits.",
                ),
                Field(
                    name="channel1",
                    lsb=16,
                    width=6,
                    reset=0x00,
                    desc="What to set of channel 1 (Y), see Load bits.",
                ),
                Field(
                    name="channel0",
                    lsb=8,
                    width=6,
                    reset=0x00,
                    desc="What to set of channel 0 (X), see Load bits.",
                ),
                Field(
                    name="reset_dt",
                    lsb=3,
                    width=1,
                    reset=0x00,
                    desc="1 = reset the counter of clock cycles.",
                ),
                Field(
                    name="reset_steps",
                    lsb=2,
                    width=1,
                    reset=0x00,
                    desc="1 = reset the counter of acceleration steps.",
                ),
                Field(
                    name="dt_limit",
                    lsb=1,
                    width=1,
                    reset=0x00,
                    desc="1 = set the length of an acceleration step.",
                ),
                Field(
                    name="steps_limit",
                    lsb=0,
                    width=1,
                    reset=0x00,
                    desc="1 = set the number of acceleration steps.",
                ),
            ),
            desc=(
                "What strobe 0 loads. Values come from their registers as they are in that clock "
                "cycle; there is no shadow copy."
            ),
            takes_effect="at each load",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="MSG_ALL_PRE_N",
            side="write",
            addresses=(0x04,),
            size=4,
            title="Pulse timing: start",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="cycle",
                    desc="Count at which the step pin rises; 0 is as 1.",
                ),
            ),
            desc=(
                "The document calls it a length. It is where a counter, which starts from 1 one "
                "clock cycle after a step is due, begins the pulse. The direction changes with "
                "that start."
            ),
            takes_effect="at once",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="MSG_ALL_PULSE_N",
            side="write",
            addresses=(0x05,),
            size=4,
            title="Pulse timing: end",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="cycle",
                    desc="Count at which the step pin falls; up to the start there is no pulse.",
                ),
            ),
            desc="Count of the same counter, so not a length but start plus length.",
            takes_effect="at once",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="MSG_ALL_POST_N",
            side="write",
            addresses=(0x06,),
            size=4,
            title="Pulse timing: ready",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="cycle",
                    desc=(
                        "Last count, if it is the greatest of the three. A step that is due before "
                        "it is lost: the position has moved, the motor has not."
                    ),
                ),
            ),
            desc="Count of the same counter, so start plus length plus space.",
            takes_effect="at once",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="MSG_CONTROL",
            side="write",
            addresses=(0x07,),
            size=4,
            title="Motor enable",
            fields=(
                Field(
                    name="enable",
                    lsb=0,
                    width=6,
                    reset=0x00,
                    desc="1 = enabled; the enable pin is low then.",
                    per="channel",
                ),
            ),
            desc="One bit per channel.",
            takes_effect="at once",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="X_VAL_LO",
            side="write",
            addresses=(0x08, 0x10, 0x18, 0x20, 0x28, 0x30),
            size=4,
            title="Channel {n} position, low half",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="step",
                    desc="Low 32 bits; bit 16 toggles at each step.",
                    fracwidth=16,
                ),
            ),
            desc="Position to set.",
            takes_effect="at a load with `SET_X` of the channel",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="X_VAL_HI",
            side="write",
            addresses=(0x09, 0x11, 0x19, 0x21, 0x29, 0x31),
            size=4,
            title="Channel {n} position, high half",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="65536 steps",
                    desc="High 32 bits.",
                    signed=True,
                ),
            ),
            desc="Position to set.",
            takes_effect="at a load with `SET_X` of the channel",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="V_VAL",
            side="write",
            addresses=(0x0A, 0x12, 0x1A, 0x22, 0x2A, 0x32),
            size=4,
            title="Channel {n} velocity",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="step/cycle",
                    desc=(
                        "Step rate = value * CLOCK_HZ / 65536: 1 is 763 steps/s. Above 65535 steps "
                        "are lost."
                    ),
                    signed=True,
                    fracwidth=16,
                ),
            ),
            desc="Velocity to set.",
            takes_effect="at a load with `SET_V` of the channel",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="A_VAL",
            side="write",
            addresses=(0x0B, 0x13, 0x1B, 0x23, 0x2B, 0x33),
            size=4,
            title="Channel {n} acceleration",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="step/cycle per acceleration step",
                    desc="As velocity.",
                    signed=True,
                    fracwidth=16,
                ),
            ),
            desc="Acceleration to set; added to velocity at each acceleration step.",
            takes_effect="at a load with `SET_A` of the channel",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="J_VAL",
            side="write",
            addresses=(0x0C, 0x14, 0x1C, 0x24, 0x2C, 0x34),
            size=4,
            title="Channel {n} jerk",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="step/cycle per acceleration step^2",
                    desc="As velocity.",
                    signed=True,
                    fracwidth=16,
                ),
            ),
            desc="Jerk to set; added to acceleration at each acceleration step.",
            takes_effect="at a load with `SET_J` of the channel",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="JJ_VAL",
            side="write",
            addresses=(0x0D, 0x15, 0x1D, 0x25, 0x2D, 0x35),
            size=4,
            title="Channel {n} change of jerk",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="step/cycle per acceleration step^3",
                    desc="As velocity.",
                    signed=True,
                    fracwidth=16,
                ),
            ),
            desc="Change of jerk to set; added to jerk at each acceleration step.",
            takes_effect="at a load with `SET_JJ` of the channel",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="TARGET_V_VAL",
            side="write",
            addresses=(0x0E, 0x16, 0x1E, 0x26, 0x2E, 0x36),
            size=4,
            title="Channel {n} target velocity",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="step/cycle",
                    desc="As velocity.",
                    signed=True,
                    fracwidth=16,
                ),
            ),
            desc="Velocity at which acceleration ends.",
            takes_effect="at a load with `SET_TARGET_V` of the channel",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="ABORT_A_VAL",
            side="write",
            addresses=(0x0F, 0x17, 0x1F, 0x27, 0x2F, 0x37),
            size=4,
            title="Channel {n} abort deceleration",
            fields=(
                Field(
                    name="value",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="step/cycle per acceleration step",
                    desc="0 never stops, below 0 accelerates.",
                    signed=True,
                    fracwidth=16,
                ),
            ),
            desc="Taken from the speed at each acceleration step of an abort.",
            takes_effect="at once, in an abort",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="ASG_CONTROL2",
            side="write",
            addresses=(0x3C,),
            size=4,
            title="Load control of channels 3 to 5",
            fields=(
                Field(
                    name="channel5",
                    lsb=16,
                    width=6,
                    reset=0x00,
                    desc="What to set of channel 5, see Load bits.",
                ),
                Field(
                    name="channel4",
                    lsb=8,
                    width=6,
                    reset=0x00,
                    desc="What to set of channel 4, see Load bits.",
                ),
                Field(
                    name="channel3",
                    lsb=0,
                    width=6,
                    reset=0x00,
                    desc="What to set of channel 3, see Load bits.",
                ),
            ),
            desc=(
                "Not in the original (ours), where this register is without function; with more "
                "than three channels only."
            ),
            takes_effect="at each load",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="BE_START_ADDR",
            side="write",
            addresses=(0x3E,),
            size=4,
            title="Program start",
            fields=(
                Field(
                    name="address",
                    lsb=0,
                    width=16,
                    reset=0x00,
                    unit="word",
                    desc="Address of the program word; in memory modulo its size.",
                ),
            ),
            desc="Where strobe 29 starts the program executor.",
            takes_effect="at strobe 29",
            address_bytes=4,
        ),
        Register(
            board="s3g",
            name="SE_REG_LB",
            side="write",
            addresses=(0x3F,),
            size=4,
            title="Loop-back",
            fields=(Field(name="value", lsb=0, width=32, reset=0x00, desc="Any word."),),
            desc="For tests of the link.",
            takes_effect="at once, in input register 63",
            address_bytes=4,
        ),
    ),
    profiles=("exact", "robust"),
    switches=(
        ProfileSwitch(
            name="abort_dt_latched",
            meaning=(
                "Length of acceleration steps in an abort. Off: `W_ASG_DT_VAL` as it is then. On: "
                "the last length loaded."
            ),
            values=(0, 0),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="rx_timeout",
            meaning=(
                "Without a byte for so long inside a packet, the packet is given up without a "
                "reply. 0: never."
            ),
            values=(0, 1000000),
            minimum=0,
            maximum=16777215,
            unit="cycles",
        ),
        ProfileSwitch(
            name="length_check",
            meaning=(
                "Off: missing arguments read 0, and a length of 0 is one of 256 that does nothing. "
                "On: a request that is too short is answered with `REPLY_ERROR` and does nothing."
            ),
            values=(0, 1),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="hold_buffer",
            meaning=(
                "On: the receiver waits while program memory is written, so that no write of it "
                "fails."
            ),
            values=(0, 1),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="req_queue",
            meaning=(
                "A request that ends while a reply or report is sent. Off: it is lost. On: it is "
                "executed and answered after that; a third one may still be lost."
            ),
            values=(0, 1),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="reply_port",
            meaning=(
                "Where replies go. `both`: to both UARTs, at the pace of the slower. `asking`: to "
                "the one that asked, at its pace; reports go to both."
            ),
            values=(0, 1),
            minimum=0,
            maximum=1,
            choices=(Choice(name="both", value=0), Choice(name="asking", value=1)),
        ),
        ProfileSwitch(
            name="x_sign_extended",
            meaning=(
                "Upper half of a position. Off: not defined, as in the original, where it is wrong "
                "after negative velocity. On: right. No pin and no register shows it."
            ),
            values=(0, 1),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
    ),
    constants=(
        Constant(name="CLOCK_HZ", value=50000000, unit="Hz", desc="Clock of everything."),
        Constant(
            name="READY_CYCLES",
            value=1024,
            unit="cycle",
            desc="From both rst_n and cclk high until the board runs.",
        ),
        Constant(name="CHANNELS", value=2, unit="", desc="Channels of the original."),
        Constant(
            name="MAX_CHANNELS",
            value=6,
            unit="",
            desc="Channels that the registers have room for.",
        ),
        Constant(name="STEP_UNITS", value=65536, unit="1/step", desc="Units of position per step."),
        Constant(name="BAUD1", value=500000, unit="baud", desc="UART 1, pins avr_tx and avr_rx."),
        Constant(name="BAUD2", value=115200, unit="baud", desc="UART 2, pins ext_tx and ext_rx."),
        Constant(
            name="BAUD_UNIT",
            value=100,
            unit="baud",
            desc="Baud rates are multiples of it; the multiple is added in every clock cycle.",
        ),
        Constant(
            name="BAUD_LIMIT",
            value=31250,
            unit="",
            desc="Where that sum gives an enable, 16 of which are a bit.",
        ),
        Constant(
            name="INTS_TIMER",
            value=1000000,
            unit="cycle",
            desc="Between reports of interrupts that stay pending.",
        ),
        Constant(
            name="RX_TIMEOUT",
            value=1000000,
            unit="cycle",
            desc=(
                "In profile `robust`: without a byte for so long inside a packet, the packet is "
                "given up."
            ),
        ),
        Constant(
            name="PROG_WORDS",
            value=8192,
            unit="word",
            desc="Program memory; addresses wrap.",
        ),
        Constant(
            name="PROG_WORD_BYTES",
            value=5,
            unit="byte",
            desc="A program word, low byte first.",
        ),
        Constant(
            name="PROG_CLASS_LSB",
            value=38,
            unit="bit",
            desc="Lowest bit of the class (2 bits) of a program word.",
        ),
        Constant(
            name="PROG_OPCODE_LSB",
            value=32,
            unit="bit",
            desc="Lowest bit of the opcode or register number (6 bits) of a program word.",
        ),
        Constant(name="HEADER", value=213, unit="hex", desc="First byte of a packet."),
        Constant(
            name="CRC_POLYNOMIAL",
            value=140,
            unit="hex",
            desc="x^8 + x^5 + x^4 + 1 for shifting right, from 0, over the payload.",
        ),
        Constant(
            name="REPORT_TAG",
            value=65535,
            unit="hex",
            desc="Tag of reports, which nobody asked for.",
        ),
        Constant(name="VERSION", value=52922, unit="hex", desc="Answer to `CMD_VERSION`."),
        Constant(
            name="EXT_VERSION_LOW",
            value=65537,
            unit="hex",
            desc="Answer to `CMD_EXT_VER`, first four bytes.",
        ),
        Constant(
            name="EXT_VERSION_HIGH",
            value=206,
            unit="hex",
            desc="Answer to `CMD_EXT_VER`, last four bytes.",
        ),
    ),
    address_bits=6,
    tables=(
        Table(
            prefix="INT",
            title="Interrupts",
            codes=(
                Code(
                    name="ASG_DONE",
                    value=0,
                    desc="The last acceleration step of a cycle is done; a load is required.",
                ),
                Code(
                    name="ASG_ABORT",
                    value=1,
                    desc=(
                        "No load came in time. True in every clock cycle of an abort, so that "
                        "clearing lasts only after its end."
                    ),
                ),
                Code(
                    name="BE_COMPLETE",
                    value=30,
                    desc="A program ended, by `OP_DONE` or an illegal instruction; not by abort.",
                ),
                Code(
                    name="SE_INT_LB",
                    value=31,
                    desc="Strobe 31 came. The document says strobe 0.",
                ),
            ),
            unit="bit",
            desc=(
                "A bit stays pending until it is cleared. Pending bits are 0 after reset, and all "
                "may be reported. Others are unused."
            ),
        ),
        Table(
            prefix="STB",
            title="Strobes",
            codes=(
                Code(
                    name="ASG_LOAD",
                    value=0,
                    desc="Load what `W_ASG_CONTROL` says, of all channels.",
                ),
                Code(
                    name="BE_START",
                    value=29,
                    desc="Start the program at `W_BE_START_ADDR`; ignored while one runs.",
                ),
                Code(name="BE_ABORT", value=30, desc="End the program at once. Motion goes on."),
                Code(name="SE_INT_LB", value=31, desc="Sets interrupt 31."),
            ),
            unit="bit",
            desc=(
                "A mask of strobes is true for one clock cycle, from the host or a program. Others "
                "do nothing."
            ),
        ),
        Table(
            prefix="SET",
            title="Load bits of a channel",
            codes=(
                Code(name="X", value=0, desc="Position, from `W_X_VAL_LO` and `W_X_VAL_HI`."),
                Code(name="V", value=1, desc="Velocity, from `W_V_VAL`."),
                Code(name="A", value=2, desc="Acceleration, from `W_A_VAL`."),
                Code(name="J", value=3, desc="Jerk, from `W_J_VAL`."),
                Code(name="JJ", value=4, desc="Change of jerk, from `W_JJ_VAL`."),
                Code(
                    name="TARGET_V",
                    value=5,
                    desc="Target velocity, from `W_TARGET_V_VAL`; 0 = none until the next load.",
                ),
            ),
            unit="bit",
            desc=(
                "Bits of each channel's field in `W_ASG_CONTROL` and `W_ASG_CONTROL2`: what a load "
                "sets."
            ),
        ),
        Table(
            prefix="CMD",
            title="Commands",
            codes=(
                Code(
                    name="VERSION",
                    value=0,
                    desc="Version: BA CE.",
                    reply=(Argument(name="version", size=2),),
                ),
                Code(
                    name="EXT_VER",
                    value=27,
                    desc="Extended version: 01 00 01 00 CE 00 00 00.",
                    reply=(Argument(name="version", size=8),),
                ),
                Code(
                    name="OUTPUT",
                    value=60,
                    desc="Write an output register (its number modulo 64).",
                    arguments=(Argument(name="register", size=1), Argument(name="value", size=4)),
                ),
                Code(
                    name="INPUT",
                    value=61,
                    desc="Read an input register (its number modulo 64).",
                    arguments=(Argument(name="register", size=1),),
                    reply=(Argument(name="value", size=4),),
                ),
                Code(
                    name="STB",
                    value=62,
                    desc="Give strobes.",
                    arguments=(Argument(name="mask", size=4),),
                ),
                Code(
                    name="CLEAR",
                    value=63,
                    desc="Clear pending interrupts; the next report need not wait.",
                    arguments=(Argument(name="mask", size=4),),
                ),
                Code(
                    name="MASK",
                    value=64,
                    desc=(
                        "Say which interrupts may be reported (1 = may); the next report need not "
                        "wait."
                    ),
                    arguments=(Argument(name="mask", size=4),),
                ),
                Code(
                    name="WRITE_BUFFER",
                    value=65,
                    desc=(
                        "Write program memory from an address on. The reply tells the address as "
                        "sent (with count 0: that of the request before), the error code of the "
                        "executor (table BE), and its PC."
                    ),
                    arguments=(
                        Argument(name="count", size=1),
                        Argument(name="address", size=2),
                        Argument(name="words", size=5, repeat="count"),
                    ),
                    reply=(
                        Argument(name="address", size=2),
                        Argument(name="error", size=1),
                        Argument(name="pc", size=2),
                    ),
                ),
            ),
            desc=(
                "Third byte of a request's payload, after the tag; arguments follow. `u40 x count` "
                "is so many numbers of 40 bits. Surplus bytes are ignored, missing ones read 0 "
                "(switch `length_check`). Other codes are answered with `REPLY_UNKNOWN`."
            ),
        ),
        Table(
            prefix="REPLY",
            title="Reply codes",
            codes=(
                Code(
                    name="INTERRUPT",
                    value=80,
                    desc=(
                        "Report, with all pending interrupts, masked ones included. 80 in the "
                        "document is decimal."
                    ),
                    arguments=(Argument(name="pending", size=4),),
                ),
                Code(
                    name="ERROR",
                    value=128,
                    desc=(
                        "Wrong CRC; nothing was done. With switch `length_check` also a wrong "
                        "length."
                    ),
                ),
                Code(name="OK", value=129, desc="Done."),
                Code(
                    name="BUF_ERROR",
                    value=130,
                    desc=(
                        "The next packet came while program memory was written; the words before "
                        "that are written. The tag is 0. Cannot happen with switch `hold_buffer`."
                    ),
                    arguments=(
                        Argument(name="address", size=2),
                        Argument(name="error", size=1),
                        Argument(name="pc", size=2),
                    ),
                ),
                Code(name="UNKNOWN", value=133, desc="No such command."),
            ),
            unit="hex",
            desc=(
                "Third byte of a reply's payload, after the tag. The arguments of `REPLY_OK` are "
                "the reply of the command."
            ),
        ),
        Table(
            prefix="CLASS",
            title="Classes of program words",
            codes=(
                Code(
                    name="OUTPUT",
                    value=1,
                    desc="Write the data to the output register in bits 37:32.",
                ),
                Code(name="CONTROL", value=2, desc="Do what the opcode in bits 37:32 says."),
            ),
            desc="Bits 39:38 of a program word. Others are illegal.",
        ),
        Table(
            prefix="OP",
            title="Opcodes of control words",
            codes=(
                Code(name="NOP", value=0, desc="Nothing."),
                Code(name="STB", value=1, desc="Give the strobes in the data."),
                Code(
                    name="WAIT_ALL",
                    value=2,
                    desc="Go on when all interrupts in the data are pending; with 0 at once.",
                ),
                Code(
                    name="WAIT_ANY",
                    value=3,
                    desc="Go on when any interrupt in the data is pending; with 0 never.",
                ),
                Code(name="CLEAR", value=4, desc="Clear the interrupts in the data."),
                Code(
                    name="DONE",
                    value=63,
                    desc="End. The low 8 bits of the data become the error code.",
                ),
            ),
            desc=(
                "Bits 37:32 of a program word of class 2; the data is in bits 31:0. Others are "
                "illegal. An instruction takes two clock cycles."
            ),
        ),
        Table(
            prefix="BE",
            title="Error codes of the program executor",
            codes=(
                Code(name="RUNNING", value=0, desc="Runs, or was never started."),
                Code(name="WAITING", value=2, desc="Waits for interrupts."),
                Code(name="ILLEGAL", value=129, desc="Ended by an illegal instruction, at PC."),
                Code(name="ABORTED", value=130, desc="Ended by strobe 30."),
            ),
            unit="hex",
            desc=(
                "Field `error` of `R_BE_CONTROL`, and argument of replies. After `OP_DONE` its own "
                "code."
            ),
        ),
    ),
)
