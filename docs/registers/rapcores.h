/* RAPcores motion controller: registers. Generated from registers.rdl of the board; do not edit.
 * */

#ifndef PULSEWRIGHT_RAPCORES_REGISTERS_H
#define PULSEWRIGHT_RAPCORES_REGISTERS_H

/* Clock of everything, unless a build says otherwise. [Hz] */
#define RAPCORES_CLOCK_HZ 16000000u

/* Power-up reset; also after a low level at rst_n. [cycle] */
#define RAPCORES_RESET_CYCLES 255u

/* Motors unless a build says otherwise. */
#define RAPCORES_MOTORS 4u

/* Encoders unless a build says otherwise. */
#define RAPCORES_ENCODERS 4u

/* Slots for moves, the executing one included, unless a build says otherwise. [move] */
#define RAPCORES_DEPTH 2u

/* Of a word, unless a build says otherwise; 32 is possible. [bit] */
#define RAPCORES_WORD_BITS 64u

/* Motors that the registers have room for. */
#define RAPCORES_MAX_MOTORS 32u

/* Motors at most with words of 32 bits: direction bits in a header word. */
#define RAPCORES_MAX_MOTORS_32 24u

/* Encoders that the registers have room for. */
#define RAPCORES_MAX_ENCODERS 64u

/* Slots for moves at most; a power of two, at least 2. [move] */
#define RAPCORES_MAX_DEPTH 64u

/* Of an encoder position; 24 is possible in profile v020. [bit] */
#define RAPCORES_POSITION_BITS 32u

/* Of an encoder velocity. [bit] */
#define RAPCORES_VELOCITY_BITS 32u

/* Of an accumulator, above its fraction bits, which are one less than the bits of a word. [bit]
 * */
#define RAPCORES_INTEGER_BITS 32u

/* Half period of SCK from which on every reply bit is valid in time. [cycle] */
#define RAPCORES_MIN_HALF_PERIOD 6u

/* Steps that a pulse former can owe; further ones are lost. [step] */
#define RAPCORES_BACKLOG 128u

/* Period of the windings of a dual H-bridge. [cycle] */
#define RAPCORES_PWM_CYCLES 512u

/* Largest value of the sine table of a dual H-bridge. */
#define RAPCORES_SINE_AMPLITUDE 4095u

/* Of the original 0.3: devel 1, 0.3.0. */
#define RAPCORES_VERSION 0x1000300u

/* Of the original 0.2: devel 1, 0.2.0. */
#define RAPCORES_VERSION_V020 0x1000200u

/* RC, version 1 of our specification. */
#define RAPCORES_BUILD_ID 0x52430001u

/* Version (read). Of the protocol: 0.3.0. Profile v020 has a message for its own. */
#define RAPCORES_R_VERSION 0x00u
#define RAPCORES_R_VERSION_SIZE 4u
#define RAPCORES_R_VERSION_RESET 0x01000300u
#define RAPCORES_R_VERSION_DEVEL_LSB 24u
#define RAPCORES_R_VERSION_DEVEL_MASK 0xFF000000u
#define RAPCORES_R_VERSION_MAJOR_LSB 16u
#define RAPCORES_R_VERSION_MAJOR_MASK 0x00FF0000u
#define RAPCORES_R_VERSION_MINOR_LSB 8u
#define RAPCORES_R_VERSION_MINOR_MASK 0x0000FF00u
#define RAPCORES_R_VERSION_PATCH_LSB 0u
#define RAPCORES_R_VERSION_PATCH_MASK 0x000000FFu

/* Channel info (read). What the build has. */
#define RAPCORES_R_CHANNEL_INFO 0x01u
#define RAPCORES_R_CHANNEL_INFO_SIZE 4u
#define RAPCORES_R_CHANNEL_INFO_RESET 0x20200404u
#define RAPCORES_R_CHANNEL_INFO_VELOCITY_BITS_LSB 24u
#define RAPCORES_R_CHANNEL_INFO_VELOCITY_BITS_MASK 0xFF000000u
#define RAPCORES_R_CHANNEL_INFO_POSITION_BITS_LSB 16u
#define RAPCORES_R_CHANNEL_INFO_POSITION_BITS_MASK 0x00FF0000u
#define RAPCORES_R_CHANNEL_INFO_ENCODERS_LSB 8u
#define RAPCORES_R_CHANNEL_INFO_ENCODERS_MASK 0x0000FF00u
#define RAPCORES_R_CHANNEL_INFO_MOTORS_LSB 0u
#define RAPCORES_R_CHANNEL_INFO_MOTORS_MASK 0x000000FFu

/* Encoder fault mask (read). Latched until W_CLEAR, in profile upstream until reset. In words of
 * 64 bits, bits 63:32 are encoders 32 to 63. The document says mask; in the original (profile
 * upstream) 1 = healthy. */
#define RAPCORES_R_ENCODER_FAULT 0x02u
#define RAPCORES_R_ENCODER_FAULT_SIZE 4u
#define RAPCORES_R_ENCODER_FAULT_RESET 0x00000000u
#define RAPCORES_R_ENCODER_FAULT_FAULT_LSB 0u
#define RAPCORES_R_ENCODER_FAULT_FAULT_MASK 0xFFFFFFFFu

/* Motor fault mask (read). As R_STEP_LOST (ours): a build has no fault inputs. Not defined in
 * profile upstream. */
#define RAPCORES_R_MOTOR_FAULT 0x03u
#define RAPCORES_R_MOTOR_FAULT_SIZE 4u
#define RAPCORES_R_MOTOR_FAULT_RESET 0x00000000u
#define RAPCORES_R_MOTOR_FAULT_FAULT_LSB 0u
#define RAPCORES_R_MOTOR_FAULT_FAULT_MASK 0xFFFFFFFFu

/* Encoder 0..63 position (read). Four counts a period. The document's table, 04 to 24 for 32
 * encoders, is of an older version. */
#define RAPCORES_R_ENCODER_POSITION(n) (0x04u + 1u * (n))
#define RAPCORES_R_ENCODER_POSITION_INSTANCES 64u
#define RAPCORES_R_ENCODER_POSITION_SIZE 4u
#define RAPCORES_R_ENCODER_POSITION_RESET 0x00000000u
#define RAPCORES_R_ENCODER_POSITION_POSITION_LSB 0u
#define RAPCORES_R_ENCODER_POSITION_POSITION_MASK 0xFFFFFFFFu

/* Encoder 0..63 velocity (read). The document does not list it. In profile upstream it is at 04,
 * too, unless fixed. */
#define RAPCORES_R_ENCODER_VELOCITY(n) (0x44u + 1u * (n))
#define RAPCORES_R_ENCODER_VELOCITY_INSTANCES 64u
#define RAPCORES_R_ENCODER_VELOCITY_SIZE 4u
#define RAPCORES_R_ENCODER_VELOCITY_RESET 0x00000000u
#define RAPCORES_R_ENCODER_VELOCITY_VELOCITY_LSB 0u
#define RAPCORES_R_ENCODER_VELOCITY_VELOCITY_MASK 0xFFFFFFFFu

/* Motor 0..31 phase angle (read). The document does not list it. In profile upstream it is at 44
 * on, unless fixed. */
#define RAPCORES_R_PHASE_ANGLE(n) (0x84u + 1u * (n))
#define RAPCORES_R_PHASE_ANGLE_INSTANCES 32u
#define RAPCORES_R_PHASE_ANGLE_SIZE 4u
#define RAPCORES_R_PHASE_ANGLE_RESET 0x00000000u
#define RAPCORES_R_PHASE_ANGLE_ANGLE_LSB 0u
#define RAPCORES_R_PHASE_ANGLE_ANGLE_MASK 0x000003FFu

/* Motor 0..31 step position (read). (ours) */
#define RAPCORES_R_STEP_POSITION(n) (0xC0u + 1u * (n))
#define RAPCORES_R_STEP_POSITION_INSTANCES 32u
#define RAPCORES_R_STEP_POSITION_SIZE 4u
#define RAPCORES_R_STEP_POSITION_RESET 0x00000000u
#define RAPCORES_R_STEP_POSITION_POSITION_LSB 0u
#define RAPCORES_R_STEP_POSITION_POSITION_MASK 0xFFFFFFFFu

/* Buffer state (read). (ours) */
#define RAPCORES_R_BUFFER_STATE 0xE0u
#define RAPCORES_R_BUFFER_STATE_SIZE 4u
#define RAPCORES_R_BUFFER_STATE_RESET 0x00000200u
#define RAPCORES_R_BUFFER_STATE_HALT_SEEN_LSB 18u
#define RAPCORES_R_BUFFER_STATE_HALT_SEEN_MASK 0x00040000u
#define RAPCORES_R_BUFFER_STATE_HALTED_LSB 17u
#define RAPCORES_R_BUFFER_STATE_HALTED_MASK 0x00020000u
#define RAPCORES_R_BUFFER_STATE_EXECUTING_LSB 16u
#define RAPCORES_R_BUFFER_STATE_EXECUTING_MASK 0x00010000u
#define RAPCORES_R_BUFFER_STATE_DEPTH_LSB 8u
#define RAPCORES_R_BUFFER_STATE_DEPTH_MASK 0x0000FF00u
#define RAPCORES_R_BUFFER_STATE_USED_LSB 0u
#define RAPCORES_R_BUFFER_STATE_USED_MASK 0x000000FFu

/* Ticks left (read). (ours) */
#define RAPCORES_R_TICKS_LEFT 0xE1u
#define RAPCORES_R_TICKS_LEFT_SIZE 4u
#define RAPCORES_R_TICKS_LEFT_RESET 0x00000000u
#define RAPCORES_R_TICKS_LEFT_TICKS_LSB 0u
#define RAPCORES_R_TICKS_LEFT_TICKS_MASK 0xFFFFFFFFu

/* Moves completed (read). (ours) */
#define RAPCORES_R_MOVES_COMPLETED 0xE2u
#define RAPCORES_R_MOVES_COMPLETED_SIZE 4u
#define RAPCORES_R_MOVES_COMPLETED_RESET 0x00000000u
#define RAPCORES_R_MOVES_COMPLETED_COUNT_LSB 0u
#define RAPCORES_R_MOVES_COMPLETED_COUNT_MASK 0xFFFFFFFFu

/* Moves refused (read). (ours) */
#define RAPCORES_R_MOVES_REFUSED 0xE3u
#define RAPCORES_R_MOVES_REFUSED_SIZE 4u
#define RAPCORES_R_MOVES_REFUSED_RESET 0x00000000u
#define RAPCORES_R_MOVES_REFUSED_COUNT_LSB 0u
#define RAPCORES_R_MOVES_REFUSED_COUNT_MASK 0xFFFFFFFFu

/* Framing errors (read). (ours) */
#define RAPCORES_R_FRAMING_ERRORS 0xE4u
#define RAPCORES_R_FRAMING_ERRORS_SIZE 4u
#define RAPCORES_R_FRAMING_ERRORS_RESET 0x00000000u
#define RAPCORES_R_FRAMING_ERRORS_COUNT_LSB 0u
#define RAPCORES_R_FRAMING_ERRORS_COUNT_MASK 0xFFFFFFFFu

/* Aborted messages (read). (ours) */
#define RAPCORES_R_ABORTED_MESSAGES 0xE5u
#define RAPCORES_R_ABORTED_MESSAGES_SIZE 4u
#define RAPCORES_R_ABORTED_MESSAGES_RESET 0x00000000u
#define RAPCORES_R_ABORTED_MESSAGES_COUNT_LSB 0u
#define RAPCORES_R_ABORTED_MESSAGES_COUNT_MASK 0xFFFFFFFFu

/* Unknown headers (read). (ours) */
#define RAPCORES_R_UNKNOWN_HEADERS 0xE6u
#define RAPCORES_R_UNKNOWN_HEADERS_SIZE 4u
#define RAPCORES_R_UNKNOWN_HEADERS_RESET 0x00000000u
#define RAPCORES_R_UNKNOWN_HEADERS_COUNT_LSB 0u
#define RAPCORES_R_UNKNOWN_HEADERS_COUNT_MASK 0xFFFFFFFFu

/* Step-lost mask (read). (ours) Latched until W_CLEAR. */
#define RAPCORES_R_STEP_LOST 0xE7u
#define RAPCORES_R_STEP_LOST_SIZE 4u
#define RAPCORES_R_STEP_LOST_RESET 0x00000000u
#define RAPCORES_R_STEP_LOST_LOST_LSB 0u
#define RAPCORES_R_STEP_LOST_LOST_MASK 0xFFFFFFFFu

/* Encoder fault mask, upper half (read). (ours) For words of 32 bits. */
#define RAPCORES_R_ENCODER_FAULT_HI 0xE8u
#define RAPCORES_R_ENCODER_FAULT_HI_SIZE 4u
#define RAPCORES_R_ENCODER_FAULT_HI_RESET 0x00000000u
#define RAPCORES_R_ENCODER_FAULT_HI_FAULT_LSB 0u
#define RAPCORES_R_ENCODER_FAULT_HI_FAULT_MASK 0xFFFFFFFFu

/* Pulses pending mask (read). (ours) */
#define RAPCORES_R_PULSES_PENDING 0xE9u
#define RAPCORES_R_PULSES_PENDING_SIZE 4u
#define RAPCORES_R_PULSES_PENDING_RESET 0x00000000u
#define RAPCORES_R_PULSES_PENDING_PENDING_LSB 0u
#define RAPCORES_R_PULSES_PENDING_PENDING_MASK 0xFFFFFFFFu

/* Build parameters (read). (ours) */
#define RAPCORES_R_BUILD_PARAMETERS 0xFEu
#define RAPCORES_R_BUILD_PARAMETERS_SIZE 4u
#define RAPCORES_R_BUILD_PARAMETERS_RESET 0x00002040u
#define RAPCORES_R_BUILD_PARAMETERS_MOTOR_DRIVER_LSB 16u
#define RAPCORES_R_BUILD_PARAMETERS_MOTOR_DRIVER_MASK 0x00010000u
#define RAPCORES_R_BUILD_PARAMETERS_INTEGER_BITS_LSB 8u
#define RAPCORES_R_BUILD_PARAMETERS_INTEGER_BITS_MASK 0x0000FF00u
#define RAPCORES_R_BUILD_PARAMETERS_WORD_BITS_LSB 0u
#define RAPCORES_R_BUILD_PARAMETERS_WORD_BITS_MASK 0x000000FFu

/* Build id (read). (ours) */
#define RAPCORES_R_BUILD_ID 0xFFu
#define RAPCORES_R_BUILD_ID_SIZE 4u
#define RAPCORES_R_BUILD_ID_RESET 0x52430001u
#define RAPCORES_R_BUILD_ID_ID_LSB 0u
#define RAPCORES_R_BUILD_ID_ID_MASK 0xFFFFFFFFu

/* Motor enable mask (write). Levels of the enable pins. Steps are given whether a motor is
 * enabled or not. Takes effect at once. */
#define RAPCORES_W_ENABLE 0x00u
#define RAPCORES_W_ENABLE_SIZE 4u
#define RAPCORES_W_ENABLE_RESET 0x00000000u
#define RAPCORES_W_ENABLE_ENABLE_LSB 0u
#define RAPCORES_W_ENABLE_ENABLE_MASK 0xFFFFFFFFu

/* Motor brake-on-disable mask (write). For dual H-bridges; without function on a step/dir board.
 * Takes effect at once. */
#define RAPCORES_W_BRAKE 0x01u
#define RAPCORES_W_BRAKE_SIZE 4u
#define RAPCORES_W_BRAKE_RESET 0x00000000u
#define RAPCORES_W_BRAKE_BRAKE_LSB 0u
#define RAPCORES_W_BRAKE_BRAKE_MASK 0xFFFFFFFFu

/* DDA clock divider (write). Bits 31:8 are stored and read back, too, without function. Takes
 * effect at once; with a value below the present count, the next tick comes at once. */
#define RAPCORES_W_DIVIDER 0x02u
#define RAPCORES_W_DIVIDER_SIZE 4u
#define RAPCORES_W_DIVIDER_RESET 0x00000028u
#define RAPCORES_W_DIVIDER_DIVIDER_LSB 0u
#define RAPCORES_W_DIVIDER_DIVIDER_MASK 0x000000FFu

/* Step width (write). (ours) Its reset value is a build parameter. Takes effect at the next step.
 * */
#define RAPCORES_W_STEP_WIDTH 0xC0u
#define RAPCORES_W_STEP_WIDTH_SIZE 4u
#define RAPCORES_W_STEP_WIDTH_RESET 0x00000014u
#define RAPCORES_W_STEP_WIDTH_CYCLES_LSB 0u
#define RAPCORES_W_STEP_WIDTH_CYCLES_MASK 0x0000FFFFu

/* Step low time (write). (ours) Its reset value is a build parameter. Takes effect at the end of
 * the next pulse. */
#define RAPCORES_W_STEP_LOW 0xC1u
#define RAPCORES_W_STEP_LOW_SIZE 4u
#define RAPCORES_W_STEP_LOW_RESET 0x00000014u
#define RAPCORES_W_STEP_LOW_CYCLES_LSB 0u
#define RAPCORES_W_STEP_LOW_CYCLES_MASK 0x0000FFFFu

/* Direction setup (write). (ours) Its reset value is a build parameter. Takes effect at the next
 * change of direction. */
#define RAPCORES_W_DIR_SETUP 0xC2u
#define RAPCORES_W_DIR_SETUP_SIZE 4u
#define RAPCORES_W_DIR_SETUP_RESET 0x00000014u
#define RAPCORES_W_DIR_SETUP_CYCLES_LSB 0u
#define RAPCORES_W_DIR_SETUP_CYCLES_MASK 0x0000FFFFu

/* Direction hold (write). (ours) Its reset value is a build parameter. Takes effect at the end of
 * the next pulse. */
#define RAPCORES_W_DIR_HOLD 0xC3u
#define RAPCORES_W_DIR_HOLD_SIZE 4u
#define RAPCORES_W_DIR_HOLD_RESET 0x00000014u
#define RAPCORES_W_DIR_HOLD_CYCLES_LSB 0u
#define RAPCORES_W_DIR_HOLD_CYCLES_MASK 0x0000FFFFu

/* Control (write). (ours) Takes effect at once. */
#define RAPCORES_W_CONTROL 0xC4u
#define RAPCORES_W_CONTROL_SIZE 4u
#define RAPCORES_W_CONTROL_RESET 0x00000000u
#define RAPCORES_W_CONTROL_HALT_LSB 0u
#define RAPCORES_W_CONTROL_HALT_MASK 0x00000001u

/* Clear (write). (ours) Write 1 to clear; reads 0. What comes in the clock cycle before wins.
 * Takes effect at once. */
#define RAPCORES_W_CLEAR 0xC5u
#define RAPCORES_W_CLEAR_SIZE 4u
#define RAPCORES_W_CLEAR_RESET 0x00000000u
#define RAPCORES_W_CLEAR_HALT_SEEN_LSB 3u
#define RAPCORES_W_CLEAR_HALT_SEEN_MASK 0x00000008u
#define RAPCORES_W_CLEAR_STEP_LOST_LSB 2u
#define RAPCORES_W_CLEAR_STEP_LOST_MASK 0x00000004u
#define RAPCORES_W_CLEAR_ENCODER_FAULT_LSB 1u
#define RAPCORES_W_CLEAR_ENCODER_FAULT_MASK 0x00000002u
#define RAPCORES_W_CLEAR_COUNTERS_LSB 0u
#define RAPCORES_W_CLEAR_COUNTERS_MASK 0x00000001u

/* STEP polarity mask (write). (ours) Takes effect at once. */
#define RAPCORES_W_STEP_POLARITY 0xC6u
#define RAPCORES_W_STEP_POLARITY_SIZE 4u
#define RAPCORES_W_STEP_POLARITY_RESET 0x00000000u
#define RAPCORES_W_STEP_POLARITY_INVERT_LSB 0u
#define RAPCORES_W_STEP_POLARITY_INVERT_MASK 0xFFFFFFFFu

/* DIR polarity mask (write). (ours) Takes effect at once. */
#define RAPCORES_W_DIR_POLARITY 0xC7u
#define RAPCORES_W_DIR_POLARITY_SIZE 4u
#define RAPCORES_W_DIR_POLARITY_RESET 0x00000000u
#define RAPCORES_W_DIR_POLARITY_INVERT_LSB 0u
#define RAPCORES_W_DIR_POLARITY_INVERT_MASK 0xFFFFFFFFu

/* Motor 0..31 current (write). (ours) In builds with dual H-bridges only. Windings get this part
 * of the supply voltage at the top of the sine; nothing measures their current. Takes effect in
 * the next PWM period but one at the latest. */
#define RAPCORES_W_CURRENT(n) (0xD0u + 1u * (n))
#define RAPCORES_W_CURRENT_INSTANCES 32u
#define RAPCORES_W_CURRENT_SIZE 4u
#define RAPCORES_W_CURRENT_RESET 0x00000000u
#define RAPCORES_W_CURRENT_CURRENT_LSB 0u
#define RAPCORES_W_CURRENT_CURRENT_MASK 0x000000FFu

/* Messages. Highest byte of the first word. The reply to a word comes with the next word; N is
 * the number of motors. Other messages have two words and are ignored; both replies are 0. */
#define RAPCORES_HEADER_NOP 0x00u
#define RAPCORES_HEADER_MOVE 0x01u
#define RAPCORES_HEADER_STATUS_READ 0xF1u
#define RAPCORES_HEADER_CONFIG_SWAP 0xF2u
#define RAPCORES_HEADER_CONFIG_READ 0xF3u

/* Messages of profile v020. The original 0.2 has no registers. HEADER_MOVE is as above, with
 * other replies: step count (not defined) and encoder position of each motor, and with increments
 * of which one step is 2^64. Other messages have one word and are ignored. */
#define RAPCORES_HEADER_V020_ENCODER 0x03u
#define RAPCORES_HEADER_V020_ENABLE 0x0Au
#define RAPCORES_HEADER_V020_BRAKE 0x0Bu
#define RAPCORES_HEADER_V020_MOTOR 0x10u
#define RAPCORES_HEADER_V020_DIVIDER 0x20u
#define RAPCORES_HEADER_V020_CHOPPER 0x30u
#define RAPCORES_HEADER_V020_CHARGE_PUMP 0x31u
#define RAPCORES_HEADER_V020_BRIDGE 0x32u
#define RAPCORES_HEADER_V020_MOTOR_FAULT 0x50u
#define RAPCORES_HEADER_V020_ENCODER_FAULT 0x51u
#define RAPCORES_HEADER_V020_CHANNEL_INFO 0xFDu
#define RAPCORES_HEADER_V020_VERSION 0xFEu

/* Profile switch fixed: In profile upstream only: three faults of the original 0.3 are mended.
 * The increment-increment is its own word, the velocity block is at 44, STEP is driven (by the
 * highest fraction bit). */
#define RAPCORES_DOCUMENT_FIXED 0u
#define RAPCORES_UPSTREAM_FIXED 0u
#define RAPCORES_V020_FIXED 0u

/* Profile switch cs_reset_message: In profile document only: the end of a CS frame ends an open
 * message, which has no effect then. Off: CS may rise between words, and a message goes on in the
 * next frame, as it always does in the other profiles. */
#define RAPCORES_DOCUMENT_CS_RESET_MESSAGE 1u
#define RAPCORES_UPSTREAM_CS_RESET_MESSAGE 0u
#define RAPCORES_V020_CS_RESET_MESSAGE 0u

/* Profile switch v020_info: In profile document only: HEADER_V020_ENCODER,
 * HEADER_V020_CHANNEL_INFO and HEADER_V020_VERSION are answered, too. */
#define RAPCORES_DOCUMENT_V020_INFO 0u
#define RAPCORES_UPSTREAM_V020_INFO 0u
#define RAPCORES_V020_V020_INFO 0u

#endif /* PULSEWRIGHT_RAPCORES_REGISTERS_H */
