"""Program words and load control of the executor, as driver and conversion make them."""

from __future__ import annotations

from typing import Final

from pulsewright.boards.s3g import registers as reg

ASG_DONE: Final = 1 << reg.INT_ASG_DONE
VALUE: Final = 0xFFFF_FFFF
RATE_UNIT: Final = reg.CLOCK_HZ / reg.STEP_UNITS  # one unit of velocity [step/s]

# Error codes with which plans end: where no more is written so far, and at their end.
DRY: Final = 0x01
FINISHED: Final = 0x03

# What a load sets of a channel.
SET_VELOCITY: Final = 1 << reg.SET_V
SET_PROFILE: Final = SET_VELOCITY | 1 << reg.SET_A | 1 << reg.SET_J | 1 << reg.SET_JJ
SET_POSITION: Final = 1 << reg.SET_X

# Where the load bits of each channel are: register and lowest bit.
LOAD_BITS: Final = tuple(
    (register.addresses[0], register.field(f"channel{c}").lsb)
    for c in range(reg.MAX_CHANNELS)
    for register in (reg.MAP["W_ASG_CONTROL"], reg.MAP["W_ASG_CONTROL2"])
    if any(field.name == f"channel{c}" for field in register.fields)
)


def output(register: int, value: int) -> int:
    """Return the word that writes an output register; the value may be negative."""
    head = reg.CLASS_OUTPUT << reg.PROG_CLASS_LSB | register << reg.PROG_OPCODE_LSB
    return head | value & VALUE


def control(opcode: int, data: int) -> int:
    """Return the word of an instruction other than that."""
    return reg.CLASS_CONTROL << reg.PROG_CLASS_LSB | opcode << reg.PROG_OPCODE_LSB | data


# Wait for the end of a load and give the next one; the load strobe is true in the cycle after the
# last of them is executed.
NEXT_LOAD: Final = (
    control(reg.OP_WAIT_ALL, ASG_DONE),
    control(reg.OP_CLEAR, ASG_DONE),
    control(reg.OP_STB, 1 << reg.STB_ASG_LOAD),
)


def load_control(bits: int, what: int, channels: int) -> dict[int, int]:
    """Return the values of the control registers for a load, by register.

    Parameters
    ----------
    bits : int
        Of the generator of acceleration steps.
    what : int
        What to set of each of the channels 0 .. ``channels`` - 1: bits ``SET_``.
    channels : int
    """
    values = {reg.W_ASG_CONTROL: bits}
    for register, lsb in LOAD_BITS[:channels]:
        values[register] = values.get(register, 0) | what << lsb
    return values
