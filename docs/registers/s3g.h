/* S3G motion controller: registers. Generated from registers.rdl of the board; do not edit. */

#ifndef PULSEWRIGHT_S3G_REGISTERS_H
#define PULSEWRIGHT_S3G_REGISTERS_H

/* Clock of everything. [Hz] */
#define S3G_CLOCK_HZ 50000000u

/* From both rst_n and cclk high until the board runs. [cycle] */
#define S3G_READY_CYCLES 1024u

/* Channels of the original. */
#define S3G_CHANNELS 2u

/* Channels that the registers have room for. */
#define S3G_MAX_CHANNELS 6u

/* Units of position per step. [1/step] */
#define S3G_STEP_UNITS 65536u

/* UART 1, pins avr_tx and avr_rx. [baud] */
#define S3G_BAUD1 500000u

/* UART 2, pins ext_tx and ext_rx. [baud] */
#define S3G_BAUD2 115200u

/* Baud rates are multiples of it; the multiple is added in every clock cycle. [baud] */
#define S3G_BAUD_UNIT 100u

/* Where that sum gives an enable, 16 of which are a bit. */
#define S3G_BAUD_LIMIT 31250u

/* Between reports of interrupts that stay pending. [cycle] */
#define S3G_INTS_TIMER 1000000u

/* In profile robust: without a byte for so long inside a packet, the packet is given up. [cycle]
 * */
#define S3G_RX_TIMEOUT 1000000u

/* Program memory; addresses wrap. [word] */
#define S3G_PROG_WORDS 8192u

/* A program word, low byte first. [byte] */
#define S3G_PROG_WORD_BYTES 5u

/* Lowest bit of the class (2 bits) of a program word. [bit] */
#define S3G_PROG_CLASS_LSB 38u

/* Lowest bit of the opcode or register number (6 bits) of a program word. [bit] */
#define S3G_PROG_OPCODE_LSB 32u

/* First byte of a packet. */
#define S3G_HEADER 0xD5u

/* x^8 + x^5 + x^4 + 1 for shifting right, from 0, over the payload. */
#define S3G_CRC_POLYNOMIAL 0x8Cu

/* Tag of reports, which nobody asked for. */
#define S3G_REPORT_TAG 0xFFFFu

/* Answer to CMD_VERSION. */
#define S3G_VERSION 0xCEBAu

/* Answer to CMD_EXT_VER, first four bytes. */
#define S3G_EXT_VERSION_LOW 0x10001u

/* Answer to CMD_EXT_VER, last four bytes. */
#define S3G_EXT_VERSION_HIGH 0xCEu

/* Clock cycle of the acceleration step (read). It goes on when nothing moves. */
#define S3G_R_ASG_DT 0u
#define S3G_R_ASG_DT_SIZE 4u
#define S3G_R_ASG_DT_RESET 0x00000000u
#define S3G_R_ASG_DT_VALUE_LSB 0u
#define S3G_R_ASG_DT_VALUE_MASK 0xFFFFFFFFu

/* Acceleration step (read). In an abort too. */
#define S3G_R_ASG_STEP 1u
#define S3G_R_ASG_STEP_SIZE 4u
#define S3G_R_ASG_STEP_RESET 0x00000000u
#define S3G_R_ASG_STEP_VALUE_LSB 0u
#define S3G_R_ASG_STEP_VALUE_MASK 0xFFFFFFFFu

/* Program executor (read). What it does now. busy is one clock cycle late. */
#define S3G_R_BE_CONTROL 62u
#define S3G_R_BE_CONTROL_SIZE 4u
#define S3G_R_BE_CONTROL_RESET 0x00000000u
#define S3G_R_BE_CONTROL_BUSY_LSB 31u
#define S3G_R_BE_CONTROL_BUSY_MASK 0x80000000u
#define S3G_R_BE_CONTROL_WAITING_LSB 30u
#define S3G_R_BE_CONTROL_WAITING_MASK 0x40000000u
#define S3G_R_BE_CONTROL_ERROR_LSB 16u
#define S3G_R_BE_CONTROL_ERROR_MASK 0x00FF0000u
#define S3G_R_BE_CONTROL_PC_LSB 0u
#define S3G_R_BE_CONTROL_PC_MASK 0x0000FFFFu

/* Loop-back (read). For tests of the link. */
#define S3G_R_SE_REG_LB 63u
#define S3G_R_SE_REG_LB_SIZE 4u
#define S3G_R_SE_REG_LB_RESET 0x00000000u
#define S3G_R_SE_REG_LB_VALUE_LSB 0u
#define S3G_R_SE_REG_LB_VALUE_MASK 0xFFFFFFFFu

/* LEDs (write). Levels of the pins led0 to led7. Takes effect at once. */
#define S3G_W_LEDS 0u
#define S3G_W_LEDS_SIZE 4u
#define S3G_W_LEDS_RESET 0x00000000u
#define S3G_W_LEDS_LEDS_LSB 0u
#define S3G_W_LEDS_LEDS_MASK 0x000000FFu

/* Acceleration steps (write). Length of a cycle. The document's "steps" are acceleration steps,
 * at which velocity changes, and not steps of a motor. Takes effect at a load with steps_limit.
 * */
#define S3G_W_ASG_STEPS_VAL 1u
#define S3G_W_ASG_STEPS_VAL_SIZE 4u
#define S3G_W_ASG_STEPS_VAL_RESET 0x00000000u
#define S3G_W_ASG_STEPS_VAL_VALUE_LSB 0u
#define S3G_W_ASG_STEPS_VAL_VALUE_MASK 0xFFFFFFFFu

/* Length of an acceleration step (write). For all channels. Takes effect at a load with dt_limit;
 * in an abort at once (switch abort_dt_latched). */
#define S3G_W_ASG_DT_VAL 2u
#define S3G_W_ASG_DT_VAL_SIZE 4u
#define S3G_W_ASG_DT_VAL_RESET 0x00000000u
#define S3G_W_ASG_DT_VAL_VALUE_LSB 0u
#define S3G_W_ASG_DT_VAL_VALUE_MASK 0xFFFFFFFFu

/* Load control (write). What strobe 0 loads. Values come from their registers as they are in that
 * clock cycle; there is no shadow copy. Takes effect at each load. */
#define S3G_W_ASG_CONTROL 3u
#define S3G_W_ASG_CONTROL_SIZE 4u
#define S3G_W_ASG_CONTROL_RESET 0x00000000u
#define S3G_W_ASG_CONTROL_CHANNEL2_LSB 24u
#define S3G_W_ASG_CONTROL_CHANNEL2_MASK 0x3F000000u
#define S3G_W_ASG_CONTROL_CHANNEL1_LSB 16u
#define S3G_W_ASG_CONTROL_CHANNEL1_MASK 0x003F0000u
#define S3G_W_ASG_CONTROL_CHANNEL0_LSB 8u
#define S3G_W_ASG_CONTROL_CHANNEL0_MASK 0x00003F00u
#define S3G_W_ASG_CONTROL_RESET_DT_LSB 3u
#define S3G_W_ASG_CONTROL_RESET_DT_MASK 0x00000008u
#define S3G_W_ASG_CONTROL_RESET_STEPS_LSB 2u
#define S3G_W_ASG_CONTROL_RESET_STEPS_MASK 0x00000004u
#define S3G_W_ASG_CONTROL_DT_LIMIT_LSB 1u
#define S3G_W_ASG_CONTROL_DT_LIMIT_MASK 0x00000002u
#define S3G_W_ASG_CONTROL_STEPS_LIMIT_LSB 0u
#define S3G_W_ASG_CONTROL_STEPS_LIMIT_MASK 0x00000001u

/* Pulse timing: start (write). The document calls it a length. It is where a counter, which
 * starts from 1 one clock cycle after a step is due, begins the pulse. The direction changes with
 * that start. Takes effect at once. */
#define S3G_W_MSG_ALL_PRE_N 4u
#define S3G_W_MSG_ALL_PRE_N_SIZE 4u
#define S3G_W_MSG_ALL_PRE_N_RESET 0x00000000u
#define S3G_W_MSG_ALL_PRE_N_VALUE_LSB 0u
#define S3G_W_MSG_ALL_PRE_N_VALUE_MASK 0xFFFFFFFFu

/* Pulse timing: end (write). Count of the same counter, so not a length but start plus length.
 * Takes effect at once. */
#define S3G_W_MSG_ALL_PULSE_N 5u
#define S3G_W_MSG_ALL_PULSE_N_SIZE 4u
#define S3G_W_MSG_ALL_PULSE_N_RESET 0x00000000u
#define S3G_W_MSG_ALL_PULSE_N_VALUE_LSB 0u
#define S3G_W_MSG_ALL_PULSE_N_VALUE_MASK 0xFFFFFFFFu

/* Pulse timing: ready (write). Count of the same counter, so start plus length plus space. Takes
 * effect at once. */
#define S3G_W_MSG_ALL_POST_N 6u
#define S3G_W_MSG_ALL_POST_N_SIZE 4u
#define S3G_W_MSG_ALL_POST_N_RESET 0x00000000u
#define S3G_W_MSG_ALL_POST_N_VALUE_LSB 0u
#define S3G_W_MSG_ALL_POST_N_VALUE_MASK 0xFFFFFFFFu

/* Motor enable (write). One bit per channel. Takes effect at once. */
#define S3G_W_MSG_CONTROL 7u
#define S3G_W_MSG_CONTROL_SIZE 4u
#define S3G_W_MSG_CONTROL_RESET 0x00000000u
#define S3G_W_MSG_CONTROL_ENABLE_LSB 0u
#define S3G_W_MSG_CONTROL_ENABLE_MASK 0x0000003Fu

/* Channel 0..5 position, low half (write). Position to set. Takes effect at a load with SET_X of
 * the channel. */
#define S3G_W_X_VAL_LO(n) (8u + 8u * (n))
#define S3G_W_X_VAL_LO_INSTANCES 6u
#define S3G_W_X_VAL_LO_SIZE 4u
#define S3G_W_X_VAL_LO_RESET 0x00000000u
#define S3G_W_X_VAL_LO_VALUE_LSB 0u
#define S3G_W_X_VAL_LO_VALUE_MASK 0xFFFFFFFFu

/* Channel 0..5 position, high half (write). Position to set. Takes effect at a load with SET_X of
 * the channel. */
#define S3G_W_X_VAL_HI(n) (9u + 8u * (n))
#define S3G_W_X_VAL_HI_INSTANCES 6u
#define S3G_W_X_VAL_HI_SIZE 4u
#define S3G_W_X_VAL_HI_RESET 0x00000000u
#define S3G_W_X_VAL_HI_VALUE_LSB 0u
#define S3G_W_X_VAL_HI_VALUE_MASK 0xFFFFFFFFu

/* Channel 0..5 velocity (write). Velocity to set. Takes effect at a load with SET_V of the
 * channel. */
#define S3G_W_V_VAL(n) (10u + 8u * (n))
#define S3G_W_V_VAL_INSTANCES 6u
#define S3G_W_V_VAL_SIZE 4u
#define S3G_W_V_VAL_RESET 0x00000000u
#define S3G_W_V_VAL_VALUE_LSB 0u
#define S3G_W_V_VAL_VALUE_MASK 0xFFFFFFFFu

/* Channel 0..5 acceleration (write). Acceleration to set; added to velocity at each acceleration
 * step. Takes effect at a load with SET_A of the channel. */
#define S3G_W_A_VAL(n) (11u + 8u * (n))
#define S3G_W_A_VAL_INSTANCES 6u
#define S3G_W_A_VAL_SIZE 4u
#define S3G_W_A_VAL_RESET 0x00000000u
#define S3G_W_A_VAL_VALUE_LSB 0u
#define S3G_W_A_VAL_VALUE_MASK 0xFFFFFFFFu

/* Channel 0..5 jerk (write). Jerk to set; added to acceleration at each acceleration step. Takes
 * effect at a load with SET_J of the channel. */
#define S3G_W_J_VAL(n) (12u + 8u * (n))
#define S3G_W_J_VAL_INSTANCES 6u
#define S3G_W_J_VAL_SIZE 4u
#define S3G_W_J_VAL_RESET 0x00000000u
#define S3G_W_J_VAL_VALUE_LSB 0u
#define S3G_W_J_VAL_VALUE_MASK 0xFFFFFFFFu

/* Channel 0..5 change of jerk (write). Change of jerk to set; added to jerk at each acceleration
 * step. Takes effect at a load with SET_JJ of the channel. */
#define S3G_W_JJ_VAL(n) (13u + 8u * (n))
#define S3G_W_JJ_VAL_INSTANCES 6u
#define S3G_W_JJ_VAL_SIZE 4u
#define S3G_W_JJ_VAL_RESET 0x00000000u
#define S3G_W_JJ_VAL_VALUE_LSB 0u
#define S3G_W_JJ_VAL_VALUE_MASK 0xFFFFFFFFu

/* Channel 0..5 target velocity (write). Velocity at which acceleration ends. Takes effect at a
 * load with SET_TARGET_V of the channel. */
#define S3G_W_TARGET_V_VAL(n) (14u + 8u * (n))
#define S3G_W_TARGET_V_VAL_INSTANCES 6u
#define S3G_W_TARGET_V_VAL_SIZE 4u
#define S3G_W_TARGET_V_VAL_RESET 0x00000000u
#define S3G_W_TARGET_V_VAL_VALUE_LSB 0u
#define S3G_W_TARGET_V_VAL_VALUE_MASK 0xFFFFFFFFu

/* Channel 0..5 abort deceleration (write). Taken from the speed at each acceleration step of an
 * abort. Takes effect at once, in an abort. */
#define S3G_W_ABORT_A_VAL(n) (15u + 8u * (n))
#define S3G_W_ABORT_A_VAL_INSTANCES 6u
#define S3G_W_ABORT_A_VAL_SIZE 4u
#define S3G_W_ABORT_A_VAL_RESET 0x00000000u
#define S3G_W_ABORT_A_VAL_VALUE_LSB 0u
#define S3G_W_ABORT_A_VAL_VALUE_MASK 0xFFFFFFFFu

/* Load control of channels 3 to 5 (write). Not in the original (ours), where this register is
 * without function; with more than three channels only. Takes effect at each load. */
#define S3G_W_ASG_CONTROL2 60u
#define S3G_W_ASG_CONTROL2_SIZE 4u
#define S3G_W_ASG_CONTROL2_RESET 0x00000000u
#define S3G_W_ASG_CONTROL2_CHANNEL5_LSB 16u
#define S3G_W_ASG_CONTROL2_CHANNEL5_MASK 0x003F0000u
#define S3G_W_ASG_CONTROL2_CHANNEL4_LSB 8u
#define S3G_W_ASG_CONTROL2_CHANNEL4_MASK 0x00003F00u
#define S3G_W_ASG_CONTROL2_CHANNEL3_LSB 0u
#define S3G_W_ASG_CONTROL2_CHANNEL3_MASK 0x0000003Fu

/* Program start (write). Where strobe 29 starts the program executor. Takes effect at strobe 29.
 * */
#define S3G_W_BE_START_ADDR 62u
#define S3G_W_BE_START_ADDR_SIZE 4u
#define S3G_W_BE_START_ADDR_RESET 0x00000000u
#define S3G_W_BE_START_ADDR_ADDRESS_LSB 0u
#define S3G_W_BE_START_ADDR_ADDRESS_MASK 0x0000FFFFu

/* Loop-back (write). For tests of the link. Takes effect at once, in input register 63. */
#define S3G_W_SE_REG_LB 63u
#define S3G_W_SE_REG_LB_SIZE 4u
#define S3G_W_SE_REG_LB_RESET 0x00000000u
#define S3G_W_SE_REG_LB_VALUE_LSB 0u
#define S3G_W_SE_REG_LB_VALUE_MASK 0xFFFFFFFFu

/* Interrupts. A bit stays pending until it is cleared. Pending bits are 0 after reset, and all
 * may be reported. Others are unused. */
#define S3G_INT_ASG_DONE 0u
#define S3G_INT_ASG_ABORT 1u
#define S3G_INT_BE_COMPLETE 30u
#define S3G_INT_SE_INT_LB 31u

/* Strobes. A mask of strobes is true for one clock cycle, from the host or a program. Others do
 * nothing. */
#define S3G_STB_ASG_LOAD 0u
#define S3G_STB_BE_START 29u
#define S3G_STB_BE_ABORT 30u
#define S3G_STB_SE_INT_LB 31u

/* Load bits of a channel. Bits of each channel's field in W_ASG_CONTROL and W_ASG_CONTROL2: what
 * a load sets. */
#define S3G_SET_X 0u
#define S3G_SET_V 1u
#define S3G_SET_A 2u
#define S3G_SET_J 3u
#define S3G_SET_JJ 4u
#define S3G_SET_TARGET_V 5u

/* Commands. Third byte of a request's payload, after the tag; arguments follow. u40 x count is so
 * many numbers of 40 bits. Surplus bytes are ignored, missing ones read 0 (switch length_check).
 * Other codes are answered with REPLY_UNKNOWN. */
#define S3G_CMD_VERSION 0u
#define S3G_CMD_EXT_VER 27u
#define S3G_CMD_OUTPUT 60u
#define S3G_CMD_INPUT 61u
#define S3G_CMD_STB 62u
#define S3G_CMD_CLEAR 63u
#define S3G_CMD_MASK 64u
#define S3G_CMD_WRITE_BUFFER 65u

/* Reply codes. Third byte of a reply's payload, after the tag. The arguments of REPLY_OK are the
 * reply of the command. */
#define S3G_REPLY_INTERRUPT 0x50u
#define S3G_REPLY_ERROR 0x80u
#define S3G_REPLY_OK 0x81u
#define S3G_REPLY_BUF_ERROR 0x82u
#define S3G_REPLY_UNKNOWN 0x85u

/* Classes of program words. Bits 39:38 of a program word. Others are illegal. */
#define S3G_CLASS_OUTPUT 1u
#define S3G_CLASS_CONTROL 2u

/* Opcodes of control words. Bits 37:32 of a program word of class 2; the data is in bits 31:0.
 * Others are illegal. An instruction takes two clock cycles. */
#define S3G_OP_NOP 0u
#define S3G_OP_STB 1u
#define S3G_OP_WAIT_ALL 2u
#define S3G_OP_WAIT_ANY 3u
#define S3G_OP_CLEAR 4u
#define S3G_OP_DONE 63u

/* Error codes of the program executor. Field error of R_BE_CONTROL, and argument of replies.
 * After OP_DONE its own code. */
#define S3G_BE_RUNNING 0x00u
#define S3G_BE_WAITING 0x02u
#define S3G_BE_ILLEGAL 0x81u
#define S3G_BE_ABORTED 0x82u

/* Profile switch abort_dt_latched: Length of acceleration steps in an abort. Off: W_ASG_DT_VAL as
 * it is then. On: the last length loaded. */
#define S3G_EXACT_ABORT_DT_LATCHED 0u
#define S3G_ROBUST_ABORT_DT_LATCHED 0u

/* Profile switch rx_timeout: Without a byte for so long inside a packet, the packet is given up
 * without a reply. 0: never. */
#define S3G_EXACT_RX_TIMEOUT 0u
#define S3G_ROBUST_RX_TIMEOUT 1000000u

/* Profile switch length_check: Off: missing arguments read 0, and a length of 0 is one of 256
 * that does nothing. On: a request that is too short is answered with REPLY_ERROR and does
 * nothing. */
#define S3G_EXACT_LENGTH_CHECK 0u
#define S3G_ROBUST_LENGTH_CHECK 1u

/* Profile switch hold_buffer: On: the receiver waits while program memory is written, so that no
 * write of it fails. */
#define S3G_EXACT_HOLD_BUFFER 0u
#define S3G_ROBUST_HOLD_BUFFER 1u

/* Profile switch req_queue: A request that ends while a reply or report is sent. Off: it is lost.
 * On: it is executed and answered after that; a third one may still be lost. */
#define S3G_EXACT_REQ_QUEUE 0u
#define S3G_ROBUST_REQ_QUEUE 1u

/* Profile switch reply_port: Where replies go. both: to both UARTs, at the pace of the slower.
 * asking: to the one that asked, at its pace; reports go to both. */
#define S3G_EXACT_REPLY_PORT 0u
#define S3G_ROBUST_REPLY_PORT 1u

/* Profile switch x_sign_extended: Upper half of a position. Off: not defined, as in the original,
 * where it is wrong after negative velocity. On: right. No pin and no register shows it. */
#define S3G_EXACT_X_SIGN_EXTENDED 0u
#define S3G_ROBUST_X_SIGN_EXTENDED 1u

#endif /* PULSEWRIGHT_S3G_REGISTERS_H */
