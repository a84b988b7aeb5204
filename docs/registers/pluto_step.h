/* Pluto-step, four-axis step generator: registers. Generated from registers.rdl of the board; do
 * not edit. */

#ifndef PULSEWRIGHT_PLUTO_STEP_REGISTERS_H
#define PULSEWRIGHT_PLUTO_STEP_REGISTERS_H

/* Core clock. [Hz] */
#define PLUTO_STEP_CLOCK_HZ 40000000u

/* Rate of the step generators. [Hz] */
#define PLUTO_STEP_TICK_HZ 625000u

/* Core clock cycles per tick; a tick is every such clock edge, edge 0 included. [cycle] */
#define PLUTO_STEP_TICK_CYCLES 64u

/* Core clock cycles per watchdog tick; the first is edge 2047. [cycle] */
#define PLUTO_STEP_WATCHDOG_CYCLES 2048u

/* Watchdog ticks after an arm until the pins go high-Z: 6.4512 to 6.5024 ms. [watchdog tick] */
#define PLUTO_STEP_WATCHDOG_TICKS 127u

/* Units of position per step at tap 0; each tap doubles it. [1/step] */
#define PLUTO_STEP_UNITS_PER_STEP 2048u

/* Axis 0..3 position (read). What the axis has been told to move, also while its pins are high-Z.
 * The document says 10.10 for these 21 bits; they are 10.11. */
#define PLUTO_STEP_R_POSITION(n) (0x00u + 4u * (n))
#define PLUTO_STEP_R_POSITION_INSTANCES 4u
#define PLUTO_STEP_R_POSITION_SIZE 4u
#define PLUTO_STEP_R_POSITION_RESET 0x00000000u
#define PLUTO_STEP_R_POSITION_VALUE_LSB 0u
#define PLUTO_STEP_R_POSITION_VALUE_MASK 0x001FFFFFu

/* Digital inputs (read). Levels of the input pins, raw, all at one clock edge. */
#define PLUTO_STEP_R_INPUTS 0x10u
#define PLUTO_STEP_R_INPUTS_SIZE 4u
#define PLUTO_STEP_R_INPUTS_INPUTS_LSB 0u
#define PLUTO_STEP_R_INPUTS_INPUTS_MASK 0x0000FFFFu

/* Identification (read). Not in the original (ours), which has no register here. */
#define PLUTO_STEP_R_IDENT 0x14u
#define PLUTO_STEP_R_IDENT_SIZE 4u
#define PLUTO_STEP_R_IDENT_RESET 0x50570104u
#define PLUTO_STEP_R_IDENT_MAGIC_LSB 16u
#define PLUTO_STEP_R_IDENT_MAGIC_MASK 0xFFFF0000u
#define PLUTO_STEP_R_IDENT_VERSION_LSB 8u
#define PLUTO_STEP_R_IDENT_VERSION_MASK 0x0000FF00u
#define PLUTO_STEP_R_IDENT_AXES_LSB 0u
#define PLUTO_STEP_R_IDENT_AXES_MASK 0x000000FFu

/* Status (read). Not in the original (ours), which has no register here. */
#define PLUTO_STEP_R_STATUS 0x18u
#define PLUTO_STEP_R_STATUS_SIZE 4u
#define PLUTO_STEP_R_STATUS_RESET 0x00000000u
#define PLUTO_STEP_R_STATUS_MISSED_LSB 4u
#define PLUTO_STEP_R_STATUS_MISSED_MASK 0x000000F0u
#define PLUTO_STEP_R_STATUS_TRISTATE_LSB 1u
#define PLUTO_STEP_R_STATUS_TRISTATE_MASK 0x00000002u
#define PLUTO_STEP_R_STATUS_ENABLED_LSB 0u
#define PLUTO_STEP_R_STATUS_ENABLED_MASK 0x00000001u

/* Tick count (read). Not in the original (ours), which has no register here. */
#define PLUTO_STEP_R_TICKS 0x1Cu
#define PLUTO_STEP_R_TICKS_SIZE 4u
#define PLUTO_STEP_R_TICKS_RESET 0x00000000u
#define PLUTO_STEP_R_TICKS_VALUE_LSB 0u
#define PLUTO_STEP_R_TICKS_VALUE_MASK 0xFFFFFFFFu

/* Axis 0..3 velocity (write). Added to the position at every tick; the sign is the direction, 0
 * counts as positive. The document says '+-.10' for these 12 bits; they are sign and 11 fraction
 * bits. The client sends it sign-extended to 16 bits. Takes effect at the write of the high byte,
 * for the ticks after it; a change of sign waits for the direction time. */
#define PLUTO_STEP_W_VELOCITY(n) (0x00u + 2u * (n))
#define PLUTO_STEP_W_VELOCITY_INSTANCES 4u
#define PLUTO_STEP_W_VELOCITY_ALIAS(n) (0x10u + 2u * (n))
#define PLUTO_STEP_W_VELOCITY_SIZE 2u
#define PLUTO_STEP_W_VELOCITY_RESET 0x0000u
#define PLUTO_STEP_W_VELOCITY_VALUE_LSB 0u
#define PLUTO_STEP_W_VELOCITY_VALUE_MASK 0x0FFFu

/* Digital outputs, watchdog (write). Levels of the output pins, and the one bit that feeds the
 * watchdog. The document's table has the bit in the next register, its notes here; the original
 * has it here only. Takes effect at the write of the high byte, all bits at once. */
#define PLUTO_STEP_W_OUTPUTS 0x08u
#define PLUTO_STEP_W_OUTPUTS_ALIAS 0x18u
#define PLUTO_STEP_W_OUTPUTS_SIZE 2u
#define PLUTO_STEP_W_OUTPUTS_RESET 0x0000u
#define PLUTO_STEP_W_OUTPUTS_WATCHDOG_ARM_LSB 14u
#define PLUTO_STEP_W_OUTPUTS_WATCHDOG_ARM_MASK 0x4000u
#define PLUTO_STEP_W_OUTPUTS_LEVELS_LSB 0u
#define PLUTO_STEP_W_OUTPUTS_LEVELS_MASK 0x3FFFu

/* Pulse timing (write). For all axes. Takes effect at the write of the high byte, for the ticks
 * after it; times that run keep their value, polarity changes at once. */
#define PLUTO_STEP_W_TIMING 0x0Au
#define PLUTO_STEP_W_TIMING_ALIAS 0x1Au
#define PLUTO_STEP_W_TIMING_SIZE 2u
#define PLUTO_STEP_W_TIMING_RESET 0x0000u
#define PLUTO_STEP_W_TIMING_POLARITY_LSB 15u
#define PLUTO_STEP_W_TIMING_POLARITY_MASK 0x8000u
#define PLUTO_STEP_W_TIMING_DIRTIME_LSB 8u
#define PLUTO_STEP_W_TIMING_DIRTIME_MASK 0x0F00u
#define PLUTO_STEP_W_TIMING_TAP_LSB 6u
#define PLUTO_STEP_W_TIMING_TAP_MASK 0x00C0u
#define PLUTO_STEP_W_TIMING_STEPTIME_LSB 0u
#define PLUTO_STEP_W_TIMING_STEPTIME_MASK 0x000Fu

/* Pulse space (write). For all axes. Not in the original (ours), which has no register here.
 * Takes effect at the write of the high byte, for the pulses that end after it. */
#define PLUTO_STEP_W_SPACE 0x0Cu
#define PLUTO_STEP_W_SPACE_ALIAS 0x1Cu
#define PLUTO_STEP_W_SPACE_SIZE 2u
#define PLUTO_STEP_W_SPACE_RESET 0x0000u
#define PLUTO_STEP_W_SPACE_SPACE_LSB 0u
#define PLUTO_STEP_W_SPACE_SPACE_MASK 0x000Fu

/* Control (write). Not in the original (ours), which has no register here. Takes effect at the
 * write of the high byte. */
#define PLUTO_STEP_W_CONTROL 0x0Eu
#define PLUTO_STEP_W_CONTROL_ALIAS 0x1Eu
#define PLUTO_STEP_W_CONTROL_SIZE 2u
#define PLUTO_STEP_W_CONTROL_RESET 0x0000u
#define PLUTO_STEP_W_CONTROL_WATCHDOG_STOP_LSB 1u
#define PLUTO_STEP_W_CONTROL_WATCHDOG_STOP_MASK 0x0002u
#define PLUTO_STEP_W_CONTROL_JOINT_LSB 0u
#define PLUTO_STEP_W_CONTROL_JOINT_MASK 0x0001u

/* Profile switch clean_cancel: A reversal cancelled during its hold time. Off: the hold timer
 * goes on as step timer and the next reversal may flip DIR while STEP is high. On: the generator
 * runs again at once. */
#define PLUTO_STEP_EXACT_CLEAN_CANCEL 0u
#define PLUTO_STEP_EXTENDED_CLEAN_CANCEL 1u

/* Profile switch enforce_space: Space between pulses. Off: none is kept, pulses merge above the
 * speed limit. On: at least the time of W_SPACE, and R_STATUS tells of steps that were missed. */
#define PLUTO_STEP_EXACT_ENFORCE_SPACE 0u
#define PLUTO_STEP_EXTENDED_ENFORCE_SPACE 1u

/* Profile switch tap_sync: A change of tap. Off: each axis may make a spurious step. On: none. */
#define PLUTO_STEP_EXACT_TAP_SYNC 0u
#define PLUTO_STEP_EXTENDED_TAP_SYNC 1u

/* Profile switch joint_commit: On: W_CONTROL has the bit that lets the velocities of all axes act
 * at once. */
#define PLUTO_STEP_EXACT_JOINT_COMMIT 0u
#define PLUTO_STEP_EXTENDED_JOINT_COMMIT 1u

/* Profile switch wd_stop: On: W_CONTROL has the bit that lets an expired watchdog stop the axes.
 * */
#define PLUTO_STEP_EXACT_WD_STOP 0u
#define PLUTO_STEP_EXTENDED_WD_STOP 1u

/* Profile switch no_alias: Writes to 10..1F. Off: they act as writes to 00..0F. On: they do
 * nothing but increment the address. */
#define PLUTO_STEP_EXACT_NO_ALIAS 0u
#define PLUTO_STEP_EXTENDED_NO_ALIAS 1u

/* Profile switch id_reg: On: R_IDENT exists. */
#define PLUTO_STEP_EXACT_ID_REG 0u
#define PLUTO_STEP_EXTENDED_ID_REG 1u

/* Profile switch status_reg: On: R_STATUS exists. */
#define PLUTO_STEP_EXACT_STATUS_REG 0u
#define PLUTO_STEP_EXTENDED_STATUS_REG 1u

/* Profile switch tick_reg: On: R_TICKS exists. */
#define PLUTO_STEP_EXACT_TICK_REG 0u
#define PLUTO_STEP_EXTENDED_TICK_REG 1u

/* Profile switch nwait_idle: Level of nWait between bus cycles: 1 as the original, 0 as IEEE 1284
 * has it. Whether the original board inverts the line on its way out is not known. */
#define PLUTO_STEP_EXACT_NWAIT_IDLE 1u
#define PLUTO_STEP_EXTENDED_NWAIT_IDLE 1u

#endif /* PULSEWRIGHT_PLUTO_STEP_REGISTERS_H */
