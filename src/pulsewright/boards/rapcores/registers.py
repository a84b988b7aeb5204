"""Registers of rapcores: RAPcores motion controller.

Generated from registers.rdl by `python -m pulsewright.registers.generate`; do not edit.
"""

from __future__ import annotations

from typing import Final

from pulsewright.registers.model import (
    Choice,
    Code,
    Constant,
    Field,
    ProfileSwitch,
    Register,
    RegisterMap,
    Table,
)

# Clock of everything, unless a build says otherwise. [Hz]
CLOCK_HZ: Final = 16_000_000

# Power-up reset; also after a low level at rst_n. [cycle]
RESET_CYCLES: Final = 255

# Motors unless a build says otherwise.
MOTORS: Final = 4

# Encoders unless a build says otherwise.
ENCODERS: Final = 4

# Slots for moves, the executing one included, unless a build says otherwise. [move]
DEPTH: Final = 2

# Of a word, unless a build says otherwise; 32 is possible. [bit]
WORD_BITS: Final = 64

# Motors that the registers have room for.
MAX_MOTORS: Final = 32

# Motors at most with words of 32 bits: direction bits in a header word.
MAX_MOTORS_32: Final = 24

# Encoders that the registers have room for.
MAX_ENCODERS: Final = 64

# Slots for moves at most; a power of two, at least 2. [move]
MAX_DEPTH: Final = 64

# Of an encoder position; 24 is possible in profile `v020`. [bit]
POSITION_BITS: Final = 32

# Of an encoder velocity. [bit]
VELOCITY_BITS: Final = 32

# Of an accumulator, above its fraction bits, which are one less than the bits of a word. [bit]
INTEGER_BITS: Final = 32

# Half period of SCK from which on every reply bit is valid in time. [cycle]
MIN_HALF_PERIOD: Final = 6

# Steps that a pulse former can owe; further ones are lost. [step]
BACKLOG: Final = 128

# Period of the windings of a dual H-bridge. [cycle]
PWM_CYCLES: Final = 512

# Largest value of the sine table of a dual H-bridge.
SINE_AMPLITUDE: Final = 4_095

# Of the original 0.3: devel 1, 0.3.0.
VERSION: Final = 0x1000300

# Of the original 0.2: devel 1, 0.2.0.
VERSION_V020: Final = 0x1000200

# RC, version 1 of our specification.
BUILD_ID: Final = 0x52430001

# Version (read)
R_VERSION: Final = 0x00
R_VERSION_RESET: Final = 0x01000300
R_VERSION_DEVEL_LSB: Final = 24
R_VERSION_DEVEL_MASK: Final = 0xFF000000
R_VERSION_MAJOR_LSB: Final = 16
R_VERSION_MAJOR_MASK: Final = 0x00FF0000
R_VERSION_MINOR_LSB: Final = 8
R_VERSION_MINOR_MASK: Final = 0x0000FF00
R_VERSION_PATCH_LSB: Final = 0
R_VERSION_PATCH_MASK: Final = 0x000000FF

# Channel info (read)
R_CHANNEL_INFO: Final = 0x01
R_CHANNEL_INFO_RESET: Final = 0x20200404
R_CHANNEL_INFO_VELOCITY_BITS_LSB: Final = 24
R_CHANNEL_INFO_VELOCITY_BITS_MASK: Final = 0xFF000000
R_CHANNEL_INFO_POSITION_BITS_LSB: Final = 16
R_CHANNEL_INFO_POSITION_BITS_MASK: Final = 0x00FF0000
R_CHANNEL_INFO_ENCODERS_LSB: Final = 8
R_CHANNEL_INFO_ENCODERS_MASK: Final = 0x0000FF00
R_CHANNEL_INFO_MOTORS_LSB: Final = 0
R_CHANNEL_INFO_MOTORS_MASK: Final = 0x000000FF

# Encoder fault mask (read)
R_ENCODER_FAULT: Final = 0x02
R_ENCODER_FAULT_RESET: Final = 0x00000000
R_ENCODER_FAULT_FAULT_LSB: Final = 0
R_ENCODER_FAULT_FAULT_MASK: Final = 0xFFFFFFFF

# Motor fault mask (read)
R_MOTOR_FAULT: Final = 0x03
R_MOTOR_FAULT_RESET: Final = 0x00000000
R_MOTOR_FAULT_FAULT_LSB: Final = 0
R_MOTOR_FAULT_FAULT_MASK: Final = 0xFFFFFFFF

# Encoder 0..63 position (read)
R_ENCODER_POSITION: Final = tuple(range(0x04, 0x44))
R_ENCODER_POSITION_RESET: Final = 0x00000000
R_ENCODER_POSITION_POSITION_LSB: Final = 0
R_ENCODER_POSITION_POSITION_MASK: Final = 0xFFFFFFFF

# Encoder 0..63 velocity (read)
R_ENCODER_VELOCITY: Final = tuple(range(0x44, 0x84))
R_ENCODER_VELOCITY_RESET: Final = 0x00000000
R_ENCODER_VELOCITY_VELOCITY_LSB: Final = 0
R_ENCODER_VELOCITY_VELOCITY_MASK: Final = 0xFFFFFFFF

# Motor 0..31 phase angle (read)
R_PHASE_ANGLE: Final = tuple(range(0x84, 0xA4))
R_PHASE_ANGLE_RESET: Final = 0x00000000
R_PHASE_ANGLE_ANGLE_LSB: Final = 0
R_PHASE_ANGLE_ANGLE_MASK: Final = 0x000003FF

# Motor 0..31 step position (read)
R_STEP_POSITION: Final = tuple(range(0xC0, 0xE0))
R_STEP_POSITION_RESET: Final = 0x00000000
R_STEP_POSITION_POSITION_LSB: Final = 0
R_STEP_POSITION_POSITION_MASK: Final = 0xFFFFFFFF

# Buffer state (read)
R_BUFFER_STATE: Final = 0xE0
R_BUFFER_STATE_RESET: Final = 0x00000200
R_BUFFER_STATE_HALT_SEEN_LSB: Final = 18
R_BUFFER_STATE_HALT_SEEN_MASK: Final = 0x00040000
R_BUFFER_STATE_HALTED_LSB: Final = 17
R_BUFFER_STATE_HALTED_MASK: Final = 0x00020000
R_BUFFER_STATE_EXECUTING_LSB: Final = 16
R_BUFFER_STATE_EXECUTING_MASK: Final = 0x00010000
R_BUFFER_STATE_DEPTH_LSB: Final = 8
R_BUFFER_STATE_DEPTH_MASK: Final = 0x0000FF00
R_BUFFER_STATE_USED_LSB: Final = 0
R_BUFFER_STATE_USED_MASK: Final = 0x000000FF

# Ticks left (read)
R_TICKS_LEFT: Final = 0xE1
R_TICKS_LEFT_RESET: Final = 0x00000000
R_TICKS_LEFT_TICKS_LSB: Final = 0
R_TICKS_LEFT_TICKS_MASK: Final = 0xFFFFFFFF

# Moves completed (read)
R_MOVES_COMPLETED: Final = 0xE2
R_MOVES_COMPLETED_RESET: Final = 0x00000000
R_MOVES_COMPLETED_COUNT_LSB: Final = 0
R_MOVES_COMPLETED_COUNT_MASK: Final = 0xFFFFFFFF

# Moves refused (read)
R_MOVES_REFUSED: Final = 0xE3
R_MOVES_REFUSED_RESET: Final = 0x00000000
R_MOVES_REFUSED_COUNT_LSB: Final = 0
R_MOVES_REFUSED_COUNT_MASK: Final = 0xFFFFFFFF

# Framing errors (read)
R_FRAMING_ERRORS: Final = 0xE4
R_FRAMING_ERRORS_RESET: Final = 0x00000000
R_FRAMING_ERRORS_COUNT_LSB: Final = 0
R_FRAMING_ERRORS_COUNT_MASK: Final = 0xFFFFFFFF

# Aborted messages (read)
R_ABORTED_MESSAGES: Final = 0xE5
R_ABORTED_MESSAGES_RESET: Final = 0x00000000
R_ABORTED_MESSAGES_COUNT_LSB: Final = 0
R_ABORTED_MESSAGES_COUNT_MASK: Final = 0xFFFFFFFF

# Unknown headers (read)
R_UNKNOWN_HEADERS: Final = 0xE6
R_UNKNOWN_HEADERS_RESET: Final = 0x00000000
R_UNKNOWN_HEADERS_COUNT_LSB: Final = 0
R_UNKNOWN_HEADERS_COUNT_MASK: Final = 0xFFFFFFFF

# Step-lost mask (read)
R_STEP_LOST: Final = 0xE7
R_STEP_LOST_RESET: Final = 0x00000000
R_STEP_LOST_LOST_LSB: Final = 0
R_STEP_LOST_LOST_MASK: Final = 0xFFFFFFFF

# Encoder fault mask, upper half (read)
R_ENCODER_FAULT_HI: Final = 0xE8
R_ENCODER_FAULT_HI_RESET: Final = 0x00000000
R_ENCODER_FAULT_HI_FAULT_LSB: Final = 0
R_ENCODER_FAULT_HI_FAULT_MASK: Final = 0xFFFFFFFF

# Pulses pending mask (read)
R_PULSES_PENDING: Final = 0xE9
R_PULSES_PENDING_RESET: Final = 0x00000000
R_PULSES_PENDING_PENDING_LSB: Final = 0
R_PULSES_PENDING_PENDING_MASK: Final = 0xFFFFFFFF

# Build parameters (read)
R_BUILD_PARAMETERS: Final = 0xFE
R_BUILD_PARAMETERS_RESET: Final = 0x00002040
R_BUILD_PARAMETERS_MOTOR_DRIVER_LSB: Final = 16
R_BUILD_PARAMETERS_MOTOR_DRIVER_MASK: Final = 0x00010000
R_BUILD_PARAMETERS_INTEGER_BITS_LSB: Final = 8
R_BUILD_PARAMETERS_INTEGER_BITS_MASK: Final = 0x0000FF00
R_BUILD_PARAMETERS_WORD_BITS_LSB: Final = 0
R_BUILD_PARAMETERS_WORD_BITS_MASK: Final = 0x000000FF

# Build id (read)
R_BUILD_ID: Final = 0xFF
R_BUILD_ID_RESET: Final = 0x52430001
R_BUILD_ID_ID_LSB: Final = 0
R_BUILD_ID_ID_MASK: Final = 0xFFFFFFFF

# Motor enable mask (write)
W_ENABLE: Final = 0x00
W_ENABLE_RESET: Final = 0x00000000
W_ENABLE_ENABLE_LSB: Final = 0
W_ENABLE_ENABLE_MASK: Final = 0xFFFFFFFF

# Motor brake-on-disable mask (write)
W_BRAKE: Final = 0x01
W_BRAKE_RESET: Final = 0x00000000
W_BRAKE_BRAKE_LSB: Final = 0
W_BRAKE_BRAKE_MASK: Final = 0xFFFFFFFF

# DDA clock divider (write)
W_DIVIDER: Final = 0x02
W_DIVIDER_RESET: Final = 0x00000028
W_DIVIDER_DIVIDER_LSB: Final = 0
W_DIVIDER_DIVIDER_MASK: Final = 0x000000FF

# Step width (write)
W_STEP_WIDTH: Final = 0xC0
W_STEP_WIDTH_RESET: Final = 0x00000014
W_STEP_WIDTH_CYCLES_LSB: Final = 0
W_STEP_WIDTH_CYCLES_MASK: Final = 0x0000FFFF

# Step low time (write)
W_STEP_LOW: Final = 0xC1
W_STEP_LOW_RESET: Final = 0x00000014
W_STEP_LOW_CYCLES_LSB: Final = 0
W_STEP_LOW_CYCLES_MASK: Final = 0x0000FFFF

# Direction setup (write)
W_DIR_SETUP: Final = 0xC2
W_DIR_SETUP_RESET: Final = 0x00000014
W_DIR_SETUP_CYCLES_LSB: Final = 0
W_DIR_SETUP_CYCLES_MASK: Final = 0x0000FFFF

# Direction hold (write)
W_DIR_HOLD: Final = 0xC3
W_DIR_HOLD_RESET: Final = 0x00000014
W_DIR_HOLD_CYCLES_LSB: Final = 0
W_DIR_HOLD_CYCLES_MASK: Final = 0x0000FFFF

# Control (write)
W_CONTROL: Final = 0xC4
W_CONTROL_RESET: Final = 0x00000000
W_CONTROL_HALT_LSB: Final = 0
W_CONTROL_HALT_MASK: Final = 0x00000001

# Clear (write)
W_CLEAR: Final = 0xC5
W_CLEAR_RESET: Final = 0x00000000
W_CLEAR_HALT_SEEN_LSB: Final = 3
W_CLEAR_HALT_SEEN_MASK: Final = 0x00000008
W_CLEAR_STEP_LOST_LSB: Final = 2
W_CLEAR_STEP_LOST_MASK: Final = 0x00000004
W_CLEAR_ENCODER_FAULT_LSB: Final = 1
W_CLEAR_ENCODER_FAULT_MASK: Final = 0x00000002
W_CLEAR_COUNTERS_LSB: Final = 0
W_CLEAR_COUNTERS_MASK: Final = 0x00000001

# STEP polarity mask (write)
W_STEP_POLARITY: Final = 0xC6
W_STEP_POLARITY_RESET: Final = 0x00000000
W_STEP_POLARITY_INVERT_LSB: Final = 0
W_STEP_POLARITY_INVERT_MASK: Final = 0xFFFFFFFF

# DIR polarity mask (write)
W_DIR_POLARITY: Final = 0xC7
W_DIR_POLARITY_RESET: Final = 0x00000000
W_DIR_POLARITY_INVERT_LSB: Final = 0
W_DIR_POLARITY_INVERT_MASK: Final = 0xFFFFFFFF

# Motor 0..31 current (write)
W_CURRENT: Final = tuple(range(0xD0, 0xF0))
W_CURRENT_RESET: Final = 0x00000000
W_CURRENT_CURRENT_LSB: Final = 0
W_CURRENT_CURRENT_MASK: Final = 0x000000FF

# Messages
HEADER_NOP: Final = 0x00
HEADER_MOVE: Final = 0x01
HEADER_STATUS_READ: Final = 0xF1
HEADER_CONFIG_SWAP: Final = 0xF2
HEADER_CONFIG_READ: Final = 0xF3

# Messages of profile `v020`
HEADER_V020_ENCODER: Final = 0x03
HEADER_V020_ENABLE: Final = 0x0A
HEADER_V020_BRAKE: Final = 0x0B
HEADER_V020_MOTOR: Final = 0x10
HEADER_V020_DIVIDER: Final = 0x20
HEADER_V020_CHOPPER: Final = 0x30
HEADER_V020_CHARGE_PUMP: Final = 0x31
HEADER_V020_BRIDGE: Final = 0x32
HEADER_V020_MOTOR_FAULT: Final = 0x50
HEADER_V020_ENCODER_FAULT: Final = 0x51
HEADER_V020_CHANNEL_INFO: Final = 0xFD
HEADER_V020_VERSION: Final = 0xFE

DEFAULT_PROFILE: Final = "document"
PROFILES: Final[dict[str, dict[str, int]]] = {
    "document": {
        "fixed": 0,
        "cs_reset_message": 1,
        "v020_info": 0,
    },
    "upstream": {
        "fixed": 0,
        "cs_reset_message": 0,
        "v020_info": 0,
    },
    "v020": {
        "fixed": 0,
        "cs_reset_message": 0,
        "v020_info": 0,
    },
}

MAP: Final = RegisterMap(
    board="rapcores",
    title="RAPcores motion controller",
    desc=(
        "FPGA behind SPI with one DDA per motor, which runs buffered moves of a duration, an "
        "increment and an increment-increment; with quadrature encoders, and telemetry tied to the "
        "moves.\n"
        "\n"
        "The bus carries words of 64 bits (32 as a build parameter), least significant byte first. "
        "The highest byte of a message's first word is its header. Status (read side) and "
        "configuration (write side) are two address spaces; the address is in bits 7:0 of the "
        "header word, and is the number of a whole register. Configuration is read back with "
        "`HEADER_CONFIG_READ`. Moves and telemetry have no address: they are the words of "
        "`HEADER_MOVE`.\n"
        "\n"
        "Registers have 32 bits. In a longer word, signed fields are sign-extended, other bits are "
        "0; the one exception is the encoder fault mask. What is not listed, and channels beyond "
        "those of a build, read 0. A write is visible 5 clock cycles after the fall of SCK that "
        "completes its last word."
    ),
    registers=(
        Register(
            board="rapcores",
            name="VERSION",
            side="read",
            addresses=(0x00,),
            size=4,
            title="Version",
            fields=(
                Field(name="devel", lsb=24, width=8, reset=0x01, desc="1 = development version."),
                Field(name="major", lsb=16, width=8, reset=0x00, desc="Major version."),
                Field(name="minor", lsb=8, width=8, reset=0x03, desc="Minor version."),
                Field(name="patch", lsb=0, width=8, reset=0x00, desc="Patch."),
            ),
            desc="Of the protocol: 0.3.0. Profile `v020` has a message for its own.",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="CHANNEL_INFO",
            side="read",
            addresses=(0x01,),
            size=4,
            title="Channel info",
            fields=(
                Field(
                    name="velocity_bits",
                    lsb=24,
                    width=8,
                    reset=0x20,
                    unit="bit",
                    desc="Bits of an encoder velocity.",
                ),
                Field(
                    name="position_bits",
                    lsb=16,
                    width=8,
                    reset=0x20,
                    unit="bit",
                    desc="Bits of an encoder position.",
                ),
                Field(name="encoders", lsb=8, width=8, reset=0x04, desc="Number of encoders."),
                Field(name="motors", lsb=0, width=8, reset=0x04, desc="Number of motors."),
            ),
            desc="What the build has.",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="ENCODER_FAULT",
            side="read",
            addresses=(0x02,),
            size=4,
            title="Encoder fault mask",
            fields=(
                Field(
                    name="fault",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    desc="1 = both signals changed at once.",
                    per="encoder",
                ),
            ),
            desc=(
                "Latched until `W_CLEAR`, in profile `upstream` until reset. In words of 64 bits, "
                "bits 63:32 are encoders 32 to 63. The document says mask; in the original "
                "(profile `upstream`) 1 = healthy."
            ),
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="MOTOR_FAULT",
            side="read",
            addresses=(0x03,),
            size=4,
            title="Motor fault mask",
            fields=(
                Field(name="fault", lsb=0, width=32, reset=0x00, desc="1 = fault.", per="motor"),
            ),
            desc=(
                "As `R_STEP_LOST` (ours): a build has no fault inputs. Not defined in profile "
                "`upstream`."
            ),
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="ENCODER_POSITION",
            side="read",
            addresses=tuple(range(0x04, 0x44)),
            size=4,
            title="Encoder {n} position",
            fields=(
                Field(
                    name="position",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="count",
                    desc="Wraps modulo 2^32.",
                    signed=True,
                ),
            ),
            desc=(
                "Four counts a period. The document's table, 04 to 24 for 32 encoders, is of an "
                "older version."
            ),
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="ENCODER_VELOCITY",
            side="read",
            addresses=tuple(range(0x44, 0x84)),
            size=4,
            title="Encoder {n} velocity",
            fields=(
                Field(
                    name="velocity",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="cycle",
                    desc=(
                        "Clock cycles between the last two counts, less 1; negative if the last "
                        "one was down. Holds at standstill."
                    ),
                    signed=True,
                ),
            ),
            desc=(
                "The document does not list it. In profile `upstream` it is at 04, too, unless "
                "`fixed`."
            ),
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="PHASE_ANGLE",
            side="read",
            addresses=tuple(range(0x84, 0xA4)),
            size=4,
            title="Motor {n} phase angle",
            fields=(
                Field(
                    name="angle",
                    lsb=0,
                    width=10,
                    reset=0x00,
                    unit="step",
                    desc=(
                        "Low 10 bits of the step position: an electrical cycle of 4 full steps of "
                        "256."
                    ),
                ),
            ),
            desc=(
                "The document does not list it. In profile `upstream` it is at 44 on, unless "
                "`fixed`."
            ),
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="STEP_POSITION",
            side="read",
            addresses=tuple(range(0xC0, 0xE0)),
            size=4,
            title="Motor {n} step position",
            fields=(
                Field(
                    name="position",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="step",
                    desc="Integer part (floor) of the accumulator. Wraps modulo 2^32.",
                    signed=True,
                ),
            ),
            desc="(ours)",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="BUFFER_STATE",
            side="read",
            addresses=(0xE0,),
            size=4,
            title="Buffer state",
            fields=(
                Field(
                    name="halt_seen",
                    lsb=18,
                    width=1,
                    reset=0x00,
                    desc=(
                        "1 = a halt came since this bit was cleared by `W_CLEAR`; moves are "
                        "refused while it is set."
                    ),
                ),
                Field(
                    name="halted",
                    lsb=17,
                    width=1,
                    reset=0x00,
                    desc="1 = halted now, by pin or by `W_CONTROL`.",
                ),
                Field(name="executing", lsb=16, width=1, reset=0x00, desc="1 = a move executes."),
                Field(
                    name="depth",
                    lsb=8,
                    width=8,
                    reset=0x02,
                    unit="move",
                    desc="Slots that there are.",
                ),
                Field(
                    name="used",
                    lsb=0,
                    width=8,
                    reset=0x00,
                    unit="move",
                    desc="Slots in use, the executing one included.",
                ),
            ),
            desc="(ours)",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="TICKS_LEFT",
            side="read",
            addresses=(0xE1,),
            size=4,
            title="Ticks left",
            fields=(
                Field(
                    name="ticks",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="tick",
                    desc="Of the executing move; 0 when none executes.",
                ),
            ),
            desc="(ours)",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="MOVES_COMPLETED",
            side="read",
            addresses=(0xE2,),
            size=4,
            title="Moves completed",
            fields=(
                Field(
                    name="count",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="move",
                    desc="Wraps modulo 2^32.",
                ),
            ),
            desc="(ours)",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="MOVES_REFUSED",
            side="read",
            addresses=(0xE3,),
            size=4,
            title="Moves refused",
            fields=(
                Field(
                    name="count",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    unit="move",
                    desc=(
                        "No slot was free, or halted, or a halt seen and not cleared. Wraps modulo "
                        "2^32."
                    ),
                ),
            ),
            desc="(ours)",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="FRAMING_ERRORS",
            side="read",
            addresses=(0xE4,),
            size=4,
            title="Framing errors",
            fields=(
                Field(
                    name="count",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    desc="CS frames that ended within a word. Wraps modulo 2^32.",
                ),
            ),
            desc="(ours)",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="ABORTED_MESSAGES",
            side="read",
            addresses=(0xE5,),
            size=4,
            title="Aborted messages",
            fields=(
                Field(
                    name="count",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    desc="Messages that the end of a CS frame cut off. Wraps modulo 2^32.",
                ),
            ),
            desc="(ours)",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="UNKNOWN_HEADERS",
            side="read",
            addresses=(0xE6,),
            size=4,
            title="Unknown headers",
            fields=(
                Field(
                    name="count",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    desc="Messages with no known header. Wraps modulo 2^32.",
                ),
            ),
            desc="(ours)",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="STEP_LOST",
            side="read",
            addresses=(0xE7,),
            size=4,
            title="Step-lost mask",
            fields=(
                Field(
                    name="lost",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    desc=(
                        "1 = more steps came due than the pulse former can owe; position and motor "
                        "differ."
                    ),
                    per="motor",
                ),
            ),
            desc="(ours) Latched until `W_CLEAR`.",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="ENCODER_FAULT_HI",
            side="read",
            addresses=(0xE8,),
            size=4,
            title="Encoder fault mask, upper half",
            fields=(
                Field(
                    name="fault",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    desc="As `R_ENCODER_FAULT`.",
                    per="encoder",
                    first=32,
                ),
            ),
            desc="(ours) For words of 32 bits.",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="PULSES_PENDING",
            side="read",
            addresses=(0xE9,),
            size=4,
            title="Pulses pending mask",
            fields=(
                Field(
                    name="pending",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    desc="1 = the pulse former owes steps.",
                    per="motor",
                ),
            ),
            desc="(ours)",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="BUILD_PARAMETERS",
            side="read",
            addresses=(0xFE,),
            size=4,
            title="Build parameters",
            fields=(
                Field(
                    name="motor_driver",
                    lsb=16,
                    width=1,
                    reset=0x00,
                    desc="0 = step and direction, 1 = dual H-bridges, too.",
                ),
                Field(
                    name="integer_bits",
                    lsb=8,
                    width=8,
                    reset=0x20,
                    unit="bit",
                    desc="Integer bits of an accumulator.",
                ),
                Field(
                    name="word_bits",
                    lsb=0,
                    width=8,
                    reset=0x40,
                    unit="bit",
                    desc="Bits of a word.",
                ),
            ),
            desc="(ours)",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="BUILD_ID",
            side="read",
            addresses=(0xFF,),
            size=4,
            title="Build id",
            fields=(
                Field(
                    name="id",
                    lsb=0,
                    width=32,
                    reset=0x52430001,
                    desc="RC, and the version of our specification.",
                ),
            ),
            desc="(ours)",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="ENABLE",
            side="write",
            addresses=(0x00,),
            size=4,
            title="Motor enable mask",
            fields=(
                Field(
                    name="enable",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    desc="1 = enabled; the enable pin is high then.",
                    per="motor",
                ),
            ),
            desc="Levels of the enable pins. Steps are given whether a motor is enabled or not.",
            takes_effect="at once",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="BRAKE",
            side="write",
            addresses=(0x01,),
            size=4,
            title="Motor brake-on-disable mask",
            fields=(
                Field(
                    name="brake",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    desc="1 = windings are short-circuited while disabled; 0 = open.",
                    per="motor",
                ),
            ),
            desc="For dual H-bridges; without function on a step/dir board.",
            takes_effect="at once",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="DIVIDER",
            side="write",
            addresses=(0x02,),
            size=4,
            title="DDA clock divider",
            fields=(
                Field(
                    name="divider",
                    lsb=0,
                    width=8,
                    reset=0x28,
                    unit="cycle",
                    desc=(
                        "A tick has divider + 1 clock cycles. In profiles `upstream` and `v020`, 0 "
                        "stops all motion."
                    ),
                ),
            ),
            desc="Bits 31:8 are stored and read back, too, without function.",
            takes_effect=(
                "at once; with a value below the present count, the next tick comes at once"
            ),
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="STEP_WIDTH",
            side="write",
            addresses=(0xC0,),
            size=4,
            title="Step width",
            fields=(
                Field(
                    name="cycles",
                    lsb=0,
                    width=16,
                    reset=0x14,
                    unit="cycle",
                    desc="STEP is active for so long; 0 is as 1.",
                ),
            ),
            desc="(ours) Its reset value is a build parameter.",
            takes_effect="at the next step",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="STEP_LOW",
            side="write",
            addresses=(0xC1,),
            size=4,
            title="Step low time",
            fields=(
                Field(
                    name="cycles",
                    lsb=0,
                    width=16,
                    reset=0x14,
                    unit="cycle",
                    desc="STEP is inactive for so long at least; 0 is as 1.",
                ),
            ),
            desc="(ours) Its reset value is a build parameter.",
            takes_effect="at the end of the next pulse",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="DIR_SETUP",
            side="write",
            addresses=(0xC2,),
            size=4,
            title="Direction setup",
            fields=(
                Field(
                    name="cycles",
                    lsb=0,
                    width=16,
                    reset=0x14,
                    unit="cycle",
                    desc="From a change of DIR to the start of a pulse, at least; 0 is as 1.",
                ),
            ),
            desc="(ours) Its reset value is a build parameter.",
            takes_effect="at the next change of direction",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="DIR_HOLD",
            side="write",
            addresses=(0xC3,),
            size=4,
            title="Direction hold",
            fields=(
                Field(
                    name="cycles",
                    lsb=0,
                    width=16,
                    reset=0x14,
                    unit="cycle",
                    desc="From the end of a pulse to a change of DIR, at least; 0 is as 1.",
                ),
            ),
            desc="(ours) Its reset value is a build parameter.",
            takes_effect="at the end of the next pulse",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="CONTROL",
            side="write",
            addresses=(0xC4,),
            size=4,
            title="Control",
            fields=(
                Field(
                    name="halt",
                    lsb=0,
                    width=1,
                    reset=0x00,
                    desc=(
                        "1 = halted: no steps, all moves are dropped, and further ones are refused."
                    ),
                ),
            ),
            desc="(ours)",
            takes_effect="at once",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="CLEAR",
            side="write",
            addresses=(0xC5,),
            size=4,
            title="Clear",
            fields=(
                Field(
                    name="halt_seen",
                    lsb=3,
                    width=1,
                    reset=0x00,
                    desc="`halt_seen` of `R_BUFFER_STATE`.",
                ),
                Field(name="step_lost", lsb=2, width=1, reset=0x00, desc="`R_STEP_LOST`."),
                Field(name="encoder_fault", lsb=1, width=1, reset=0x00, desc="`R_ENCODER_FAULT`."),
                Field(
                    name="counters",
                    lsb=0,
                    width=1,
                    reset=0x00,
                    desc="`R_MOVES_COMPLETED` to `R_UNKNOWN_HEADERS`.",
                ),
            ),
            desc="(ours) Write 1 to clear; reads 0. What comes in the clock cycle before wins.",
            takes_effect="at once",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="STEP_POLARITY",
            side="write",
            addresses=(0xC6,),
            size=4,
            title="STEP polarity mask",
            fields=(
                Field(
                    name="invert",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    desc="1 = the pin is inverted.",
                    per="motor",
                ),
            ),
            desc="(ours)",
            takes_effect="at once",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="DIR_POLARITY",
            side="write",
            addresses=(0xC7,),
            size=4,
            title="DIR polarity mask",
            fields=(
                Field(
                    name="invert",
                    lsb=0,
                    width=32,
                    reset=0x00,
                    desc="1 = the pin is inverted. Otherwise 0 = rising position.",
                    per="motor",
                ),
            ),
            desc="(ours)",
            takes_effect="at once",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="CURRENT",
            side="write",
            addresses=tuple(range(0xD0, 0xF0)),
            size=4,
            title="Motor {n} current",
            fields=(
                Field(
                    name="current",
                    lsb=0,
                    width=8,
                    reset=0x00,
                    desc="256 would be the whole supply voltage; 0 = not driven.",
                ),
            ),
            desc=(
                "(ours) In builds with dual H-bridges only. Windings get this part of the supply "
                "voltage at the top of the sine; nothing measures their current."
            ),
            takes_effect="in the next PWM period but one at the latest",
            address_bytes=4,
        ),
    ),
    profiles=("document", "upstream", "v020"),
    switches=(
        ProfileSwitch(
            name="fixed",
            meaning=(
                "In profile `upstream` only: three faults of the original 0.3 are mended. The "
                "increment-increment is its own word, the velocity block is at 44, STEP is driven "
                "(by the highest fraction bit)."
            ),
            values=(0, 0, 0),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="cs_reset_message",
            meaning=(
                "In profile `document` only: the end of a CS frame ends an open message, which has "
                "no effect then. Off: CS may rise between words, and a message goes on in the next "
                "frame, as it always does in the other profiles."
            ),
            values=(1, 0, 0),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
        ProfileSwitch(
            name="v020_info",
            meaning=(
                "In profile `document` only: `HEADER_V020_ENCODER`, `HEADER_V020_CHANNEL_INFO` and "
                "`HEADER_V020_VERSION` are answered, too."
            ),
            values=(0, 0, 0),
            minimum=0,
            maximum=1,
            choices=(Choice(name="off", value=0), Choice(name="on", value=1)),
        ),
    ),
    constants=(
        Constant(
            name="CLOCK_HZ",
            value=16000000,
            unit="Hz",
            desc="Clock of everything, unless a build says otherwise.",
        ),
        Constant(
            name="RESET_CYCLES",
            value=255,
            unit="cycle",
            desc="Power-up reset; also after a low level at rst_n.",
        ),
        Constant(name="MOTORS", value=4, unit="", desc="Motors unless a build says otherwise."),
        Constant(name="ENCODERS", value=4, unit="", desc="Encoders unless a build says otherwise."),
        Constant(
            name="DEPTH",
            value=2,
            unit="move",
            desc="Slots for moves, the executing one included, unless a build says otherwise.",
        ),
        Constant(
            name="WORD_BITS",
            value=64,
            unit="bit",
            desc="Of a word, unless a build says otherwise; 32 is possible.",
        ),
        Constant(
            name="MAX_MOTORS",
            value=32,
            unit="",
            desc="Motors that the registers have room for.",
        ),
        Constant(
            name="MAX_MOTORS_32",
            value=24,
            unit="",
            desc="Motors at most with words of 32 bits: direction bits in a header word.",
        ),
        Constant(
            name="MAX_ENCODERS",
            value=64,
            unit="",
            desc="Encoders that the registers have room for.",
        ),
        Constant(
            name="MAX_DEPTH",
            value=64,
            unit="move",
            desc="Slots for moves at most; a power of two, at least 2.",
        ),
        Constant(
            name="POSITION_BITS",
            value=32,
            unit="bit",
            desc="Of an encoder position; 24 is possible in profile `v020`.",
        ),
        Constant(name="VELOCITY_BITS", value=32, unit="bit", desc="Of an encoder velocity."),
        Constant(
            name="INTEGER_BITS",
            value=32,
            unit="bit",
            desc=(
                "Of an accumulator, above its fraction bits, which are one less than the bits of a "
                "word."
            ),
        ),
        Constant(
            name="MIN_HALF_PERIOD",
            value=6,
            unit="cycle",
            desc="Half period of SCK from which on every reply bit is valid in time.",
        ),
        Constant(
            name="BACKLOG",
            value=128,
            unit="step",
            desc="Steps that a pulse former can owe; further ones are lost.",
        ),
        Constant(
            name="PWM_CYCLES",
            value=512,
            unit="cycle",
            desc="Period of the windings of a dual H-bridge.",
        ),
        Constant(
            name="SINE_AMPLITUDE",
            value=4095,
            unit="",
            desc="Largest value of the sine table of a dual H-bridge.",
        ),
        Constant(
            name="VERSION",
            value=16777984,
            unit="hex",
            desc="Of the original 0.3: devel 1, 0.3.0.",
        ),
        Constant(
            name="VERSION_V020",
            value=16777728,
            unit="hex",
            desc="Of the original 0.2: devel 1, 0.2.0.",
        ),
        Constant(
            name="BUILD_ID",
            value=1380122625,
            unit="hex",
            desc="RC, version 1 of our specification.",
        ),
    ),
    address_bits=8,
    tables=(
        Table(
            prefix="HEADER",
            title="Messages",
            codes=(
                Code(name="NOP", value=0, desc="1 word. Nothing; replies 0."),
                Code(
                    name="MOVE",
                    value=1,
                    desc=(
                        "2 + 2 N words: direction bits with the header (without effect in profile "
                        "`document`); duration [tick]; then, for each motor, increment [step/tick] "
                        "and increment-increment [step/tick^2], signed, one step being 2^63 (2^31 "
                        "with words of 32 bits). The replies to words 2 on are telemetry: position "
                        "and velocity of each of the first N encoders, signed, as at the start of "
                        "the executing move, or as they are now when none executes."
                    ),
                ),
                Code(
                    name="STATUS_READ",
                    value=241,
                    desc="2 words. Replies a register of the read side with the second word.",
                ),
                Code(
                    name="CONFIG_SWAP",
                    value=242,
                    desc=(
                        "2 words. Writes the second word to a register of the write side; replies "
                        "the old value with it."
                    ),
                ),
                Code(
                    name="CONFIG_READ",
                    value=243,
                    desc=(
                        "2 words. Replies a register of the write side with the second word, which "
                        "is ignored. (ours), profile `document`."
                    ),
                ),
            ),
            unit="hex",
            desc=(
                "Highest byte of the first word. The reply to a word comes with the next word; N "
                "is the number of motors. Other messages have two words and are ignored; both "
                "replies are 0."
            ),
        ),
        Table(
            prefix="HEADER_V020",
            title="Messages of profile `v020`",
            codes=(
                Code(
                    name="ENCODER",
                    value=3,
                    desc=(
                        "2 words. Replies position and velocity, the velocity directly above the "
                        "position bits, of the encoder in bits 55:48."
                    ),
                ),
                Code(
                    name="ENABLE",
                    value=10,
                    desc="1 word. Writes the motor enable mask, bits N-1:0.",
                ),
                Code(
                    name="BRAKE",
                    value=11,
                    desc="1 word. Writes the brake-on-disable mask, bits N-1:0.",
                ),
                Code(
                    name="MOTOR",
                    value=16,
                    desc=(
                        "1 word. Motor in bits 55:48, current in bits 15:12, microsteps in bits "
                        "2:0. No effect on a step/dir board."
                    ),
                ),
                Code(
                    name="DIVIDER",
                    value=32,
                    desc="1 word. Writes the DDA clock divider, bits 7:0.",
                ),
                Code(
                    name="CHOPPER",
                    value=48,
                    desc="1 word. Chopper, bits 7:0. No effect on a step/dir board.",
                ),
                Code(
                    name="CHARGE_PUMP",
                    value=49,
                    desc=(
                        "1 word. Period of the charge pump, bits 7:0. No effect on a step/dir "
                        "board."
                    ),
                ),
                Code(
                    name="BRIDGE",
                    value=50,
                    desc="1 word. Bridge inversion, bits 1:0. No effect on a step/dir board.",
                ),
                Code(
                    name="MOTOR_FAULT",
                    value=80,
                    desc=(
                        "2 words. Replies the motor fault mask, 1 = fault; not defined on a "
                        "step/dir board."
                    ),
                ),
                Code(
                    name="ENCODER_FAULT",
                    value=81,
                    desc="2 words. Replies the encoder fault mask, 1 = fault.",
                ),
                Code(
                    name="CHANNEL_INFO",
                    value=253,
                    desc=(
                        "1 word. Replies as `R_CHANNEL_INFO` with the next word, which is a header "
                        "again."
                    ),
                ),
                Code(name="VERSION", value=254, desc="2 words. Replies the version."),
            ),
            unit="hex",
            desc=(
                "The original 0.2 has no registers. `HEADER_MOVE` is as above, with other replies: "
                "step count (not defined) and encoder position of each motor, and with increments "
                "of which one step is 2^64. Other messages have one word and are ignored."
            ),
        ),
    ),
    hex_addresses=True,
    pictures=True,
    words=(
        Register(
            board="rapcores",
            name="MOVE",
            side="word",
            addresses=(0x00,),
            size=8,
            title="First word of a move",
            fields=(
                Field(name="header", lsb=56, width=8, reset=None, desc="`HEADER_MOVE`."),
                Field(
                    name="direction",
                    lsb=0,
                    width=32,
                    reset=None,
                    desc="Levels of DIR in profiles `upstream` and `v020`.",
                    per="motor",
                ),
            ),
            desc=(
                "Then come the duration and, for each motor, increment and increment-increment. In "
                "words of 32 bits, the header is in bits 31:24, and direction bits in bits 23:0."
            ),
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="DURATION",
            side="word",
            addresses=(0x02,),
            size=8,
            title="Duration of a move",
            fields=(
                Field(
                    name="duration",
                    lsb=0,
                    width=32,
                    reset=None,
                    unit="tick",
                    desc="0 ends at once.",
                ),
            ),
            desc="Word 1.",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="INCREMENT",
            side="word",
            addresses=(0x04,),
            size=8,
            title="Increment of a motor",
            fields=(
                Field(
                    name="increment",
                    lsb=0,
                    width=64,
                    reset=None,
                    unit="step/tick",
                    desc="Added to the accumulator at every tick.",
                    signed=True,
                    fracwidth=63,
                ),
            ),
            desc="Word 2 + 2 m for motor m. In words of 32 bits, 31 are fraction bits.",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="INCREMENT_INCREMENT",
            side="word",
            addresses=(0x06,),
            size=8,
            title="Increment-increment of a motor",
            fields=(
                Field(
                    name="increment_increment",
                    lsb=0,
                    width=64,
                    reset=None,
                    unit="step/tick^2",
                    desc="Added to the increment at every tick.",
                    signed=True,
                    fracwidth=63,
                ),
            ),
            desc="Word 3 + 2 m for motor m. In words of 32 bits, 31 are fraction bits.",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="ACCESS",
            side="word",
            addresses=(0x08,),
            size=8,
            title="First word of an access to a register",
            fields=(
                Field(
                    name="header",
                    lsb=56,
                    width=8,
                    reset=None,
                    desc="`HEADER_STATUS_READ`, `HEADER_CONFIG_SWAP` or `HEADER_CONFIG_READ`.",
                ),
                Field(name="address", lsb=0, width=8, reset=None, desc="Of a register."),
            ),
            desc="In words of 32 bits, the header is in bits 31:24.",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="VALUE",
            side="word",
            addresses=(0x0A,),
            size=8,
            title="Value of a register",
            fields=(Field(name="value", lsb=0, width=32, reset=None, desc="See the register."),),
            desc=(
                "Word 1 of `HEADER_CONFIG_SWAP`; as a reply sign-extended where the register is "
                "signed."
            ),
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="TELEMETRY_POSITION",
            side="word",
            addresses=(0x0C,),
            size=8,
            title="Telemetry: position of an encoder",
            fields=(
                Field(
                    name="position",
                    lsb=0,
                    width=64,
                    reset=None,
                    unit="count",
                    desc="As `R_ENCODER_POSITION`, sign-extended.",
                    signed=True,
                ),
            ),
            desc="Reply that comes with word 2 + 2 e of a move, for encoder e.",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="TELEMETRY_VELOCITY",
            side="word",
            addresses=(0x0E,),
            size=8,
            title="Telemetry: velocity of an encoder",
            fields=(
                Field(
                    name="velocity",
                    lsb=0,
                    width=64,
                    reset=None,
                    unit="cycle",
                    desc="As `R_ENCODER_VELOCITY`, sign-extended.",
                    signed=True,
                ),
            ),
            desc="Reply that comes with word 3 + 2 e of a move, for encoder e.",
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="V020",
            side="word",
            addresses=(0x10,),
            size=8,
            title="Message of profile `v020`",
            fields=(
                Field(
                    name="header",
                    lsb=56,
                    width=8,
                    reset=None,
                    desc="See Messages of profile `v020`.",
                ),
                Field(
                    name="channel",
                    lsb=48,
                    width=8,
                    reset=None,
                    desc="Number of a motor or encoder.",
                ),
                Field(name="current", lsb=12, width=4, reset=None, desc="Motor current."),
                Field(name="microsteps", lsb=0, width=3, reset=None, desc="Microsteps."),
            ),
            desc=(
                "The channel is that of `HEADER_V020_ENCODER` and `HEADER_V020_MOTOR`, the rest of "
                "the latter."
            ),
            address_bytes=4,
        ),
        Register(
            board="rapcores",
            name="V020_ENCODER",
            side="word",
            addresses=(0x12,),
            size=8,
            title="Encoder of profile `v020`",
            fields=(
                Field(
                    name="velocity",
                    lsb=32,
                    width=32,
                    reset=None,
                    unit="cycle",
                    desc="As `R_ENCODER_VELOCITY`.",
                    signed=True,
                ),
                Field(
                    name="position",
                    lsb=0,
                    width=32,
                    reset=None,
                    unit="count",
                    desc="As `R_ENCODER_POSITION`.",
                    signed=True,
                ),
            ),
            desc=(
                "Reply to `HEADER_V020_ENCODER`, with 32 bits of position; a build may have 24, "
                "and the velocity is directly above."
            ),
            address_bytes=4,
        ),
    ),
)
