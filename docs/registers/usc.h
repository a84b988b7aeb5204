/* Universal Stepper Controller (USC): registers. Generated from registers.rdl of the board; do
 * not edit. */

#ifndef PULSEWRIGHT_USC_REGISTERS_H
#define PULSEWRIGHT_USC_REGISTERS_H

/* Core clock (ours): a multiple of the rate clock. [Hz] */
#define USC_CLOCK_HZ 40000000u

/* Rate clock: the step rate generators, setup time and pulse width count its ticks. [Hz] */
#define USC_TICK_HZ 10000000u

/* Core clock cycles per tick; a tick is every such clock edge, edge 0 included. [cycle] */
#define USC_TICK_CYCLES 4u

/* Latch timer: ticks between latch events for each unit of its rate (ours: 100 us). [tick] */
#define USC_TIMER_UNIT_TICKS 1000u

/* A latch event drives the Intr line for this time (ours: 1 us). [tick] */
#define USC_INTR_TICKS 10u

/* The document asks to hold a load position bit for at least this time (2 us). [tick] */
#define USC_LOAD_HOLD_TICKS 20u

/* Encoder 0..3 count (read). Position: every edge of the quadrature inputs counts, straight
 * binary with plain 24-bit wrap. A holding register, so that the three bytes belong together. */
#define USC_R_ENCODER_COUNT(n) (0x00u + 3u * (n))
#define USC_R_ENCODER_COUNT_INSTANCES 4u
#define USC_R_ENCODER_COUNT_SIZE 3u
#define USC_R_ENCODER_COUNT_RESET 0x000000u
#define USC_R_ENCODER_COUNT_VALUE_LSB 0u
#define USC_R_ENCODER_COUNT_VALUE_MASK 0xFFFFFFu

/* Index sense (read). Index pulses seen since the last read. Read it once to discard what was
 * sensed before; an edge during the clearing read is kept (ours). */
#define USC_R_INDEX_SENSE 0x0Cu
#define USC_R_INDEX_SENSE_RESET 0x00u
#define USC_R_INDEX_SENSE_SENSED_LSB 0u
#define USC_R_INDEX_SENSE_SENSED_MASK 0x0Fu

/* Digital inputs 0..7 (read). Levels of the input pins, as they are at the read. */
#define USC_R_INPUTS_LOW 0x0Du
#define USC_R_INPUTS_LOW_INPUTS_LSB 0u
#define USC_R_INPUTS_LOW_INPUTS_MASK 0xFFu

/* Digital inputs 8..14, estop (read). Levels of the input pins, as they are at the read, and the
 * estop status. */
#define USC_R_INPUTS_HIGH 0x0Eu
#define USC_R_INPUTS_HIGH_RUNNING_LSB 7u
#define USC_R_INPUTS_HIGH_RUNNING_MASK 0x80u
#define USC_R_INPUTS_HIGH_RUNNING_IN_ESTOP 0u
#define USC_R_INPUTS_HIGH_RUNNING_RUNNING 1u
#define USC_R_INPUTS_HIGH_INPUTS_LSB 0u
#define USC_R_INPUTS_HIGH_INPUTS_MASK 0x7Fu

/* Module ID (read). Type and version of the board. Version F is never used. */
#define USC_R_IDENT 0x0Fu
#define USC_R_IDENT_RESET 0x41u
#define USC_R_IDENT_TYPE_LSB 4u
#define USC_R_IDENT_TYPE_MASK 0xF0u
#define USC_R_IDENT_TYPE_PPMC_ENCODER 1u
#define USC_R_IDENT_TYPE_PPMC_DAC 2u
#define USC_R_IDENT_TYPE_PPMC_DIO 3u
#define USC_R_IDENT_TYPE_USC 4u
#define USC_R_IDENT_TYPE_UPC 5u
#define USC_R_IDENT_VERSION_LSB 0u
#define USC_R_IDENT_VERSION_MASK 0x0Fu

/* Assembly register (write). The one 24-bit register that all values of three bytes pass through:
 * the byte written at 00, 01, 02 or at an axis' divisor replaces the same byte of it. An encoder
 * loads it through its load position bit. Takes effect at the write of each byte. */
#define USC_W_ASSEMBLY 0x00u
#define USC_W_ASSEMBLY_SIZE 3u
#define USC_W_ASSEMBLY_RESET 0x000000u
#define USC_W_ASSEMBLY_VALUE_LSB 0u
#define USC_W_ASSEMBLY_VALUE_MASK 0xFFFFFFu

/* Timer configuration (write). Sources of latch events. A latch event copies the encoder counters
 * to their holding registers, on this board and, over the Intr line, on all others. Takes effect
 * at the write. */
#define USC_W_TIMER 0x04u
#define USC_W_TIMER_RESET 0x00u
#define USC_W_TIMER_SOFT_LATCH_LSB 5u
#define USC_W_TIMER_SOFT_LATCH_MASK 0x20u
#define USC_W_TIMER_MASTER_LSB 4u
#define USC_W_TIMER_MASTER_MASK 0x10u
#define USC_W_TIMER_RATE_LSB 0u
#define USC_W_TIMER_RATE_MASK 0x0Fu

/* Slave (write). Not in the document: the client writes 1 to its second and later boards. The
 * meaning is inferred (ours). Takes effect at the write; clearing it while the estop chain is
 * open enters estop. */
#define USC_W_SLAVE 0x06u
#define USC_W_SLAVE_RESET 0x00u
#define USC_W_SLAVE_ENABLE_LSB 0u
#define USC_W_SLAVE_ENABLE_MASK 0x01u

/* Encoder control (write). The document has it at 0C, the client writes 03: both addresses reach
 * this register. Takes effect at the write. */
#define USC_W_ENCODER_CONTROL 0x0Cu
#define USC_W_ENCODER_CONTROL_ALIAS 0x03u
#define USC_W_ENCODER_CONTROL_RESET 0x00u
#define USC_W_ENCODER_CONTROL_LOAD_LSB 4u
#define USC_W_ENCODER_CONTROL_LOAD_MASK 0xF0u
#define USC_W_ENCODER_CONTROL_INDEX_SELECT_LSB 0u
#define USC_W_ENCODER_CONTROL_INDEX_SELECT_MASK 0x0Fu

/* Index reset (write). Not in the document. Boards of version 1 ignore it (switch ident). Takes
 * effect at the next rising index edge of the axis, and at every later one until the bit is
 * written 0. */
#define USC_W_INDEX_RESET 0x0Du
#define USC_W_INDEX_RESET_RESET 0x00u
#define USC_W_INDEX_RESET_AXES_LSB 0u
#define USC_W_INDEX_RESET_AXES_MASK 0x0Fu

/* DAC or extra outputs on P8 (write). With a DAC fitted the magnitude of a voltage (its sign is
 * left to two outputs), else eight digital outputs. Forced to 0 in estop. Takes effect at the
 * write; in estop at the release. */
#define USC_W_DAC 0x0Fu
#define USC_W_DAC_RESET 0x00u
#define USC_W_DAC_VALUE_LSB 0u
#define USC_W_DAC_VALUE_MASK 0xFFu

/* Axis 0..3 divisor (write). Step rate: pulses of the rate clock between two steps. 0, illegal in
 * the document, halts the axis. A counter that exceeds a new divisor steps at once, and once
 * only. All 12 bytes and the control register after them can be written in one burst. Takes
 * effect at the write of the high byte, for the tick after it. */
#define USC_W_DIVISOR(n) (0x10u + 3u * (n))
#define USC_W_DIVISOR_INSTANCES 4u
#define USC_W_DIVISOR_SIZE 3u
#define USC_W_DIVISOR_RESET 0x000000u
#define USC_W_DIVISOR_VALUE_LSB 0u
#define USC_W_DIVISOR_VALUE_MASK 0xFFFFFFu

/* Rate generator control (write). Run and direction of each axis. Direction follows the bit after
 * the setup time, whether the axis runs or not. The client writes direction 1 for velocities of 0
 * and above. Takes effect at the write, for the tick after it; a direction change waits for the
 * setup time after a step. */
#define USC_W_RATE_CONTROL 0x1Cu
#define USC_W_RATE_CONTROL_RESET 0x00u
#define USC_W_RATE_CONTROL_RUN3_LSB 7u
#define USC_W_RATE_CONTROL_RUN3_MASK 0x80u
#define USC_W_RATE_CONTROL_DIR3_LSB 6u
#define USC_W_RATE_CONTROL_DIR3_MASK 0x40u
#define USC_W_RATE_CONTROL_RUN2_LSB 5u
#define USC_W_RATE_CONTROL_RUN2_MASK 0x20u
#define USC_W_RATE_CONTROL_DIR2_LSB 4u
#define USC_W_RATE_CONTROL_DIR2_MASK 0x10u
#define USC_W_RATE_CONTROL_RUN1_LSB 3u
#define USC_W_RATE_CONTROL_RUN1_MASK 0x08u
#define USC_W_RATE_CONTROL_DIR1_LSB 2u
#define USC_W_RATE_CONTROL_DIR1_MASK 0x04u
#define USC_W_RATE_CONTROL_RUN0_LSB 1u
#define USC_W_RATE_CONTROL_RUN0_MASK 0x02u
#define USC_W_RATE_CONTROL_DIR0_LSB 0u
#define USC_W_RATE_CONTROL_DIR0_MASK 0x01u

/* Setup time (write). For all axes: a direction change waits this long after a step pulse, a step
 * pulse this long after a direction change. The document gives codes 0 to 254 for 25.4 to 0.1 us
 * and forbids 255; code 0 would be 25.5 us. Takes effect for the delays that start after the
 * write; one that runs keeps its time (ours). */
#define USC_W_SETUP 0x1Du
#define USC_W_SETUP_RESET 0xFEu
#define USC_W_SETUP_CODE_LSB 0u
#define USC_W_SETUP_CODE_MASK 0xFFu

/* Step pulse width (write). For all axes. Codes as for the setup time. Takes effect for the
 * pulses that start after the write; one that runs keeps its width (ours). */
#define USC_W_WIDTH 0x1Eu
#define USC_W_WIDTH_RESET 0xFEu
#define USC_W_WIDTH_CODE_LSB 0u
#define USC_W_WIDTH_CODE_MASK 0xFFu

/* Estop release and outputs (write). Outputs for solid state relays, and the way out of estop.
 * Takes effect at the write; in estop the outputs are 0 and the bits act at the release. */
#define USC_W_OUTPUTS 0x1Fu
#define USC_W_OUTPUTS_RESET 0x00u
#define USC_W_OUTPUTS_ESTOP_RELEASE_LSB 7u
#define USC_W_OUTPUTS_ESTOP_RELEASE_MASK 0x80u
#define USC_W_OUTPUTS_SSR_LSB 0u
#define USC_W_OUTPUTS_SSR_MASK 0x7Fu

/* Profile switch div_offset: Step period = divisor + div_offset. The document's 1 -> 5 MHz and 2
 * -> 3.333 MHz give 1 (its 4 -> 2.5 MHz gives 0, or is a slip for 3); the client subtracts 4. */
#define USC_DOCUMENT_DIV_OFFSET 1u
#define USC_LINUXCNC_DIV_OFFSET 4u

/* Profile switch time_code: Setup time and pulse width in ticks = time_code - code; never below 1
 * tick, so that code FF, forbidden by the document, acts as 1 tick. */
#define USC_DOCUMENT_TIME_CODE 255u
#define USC_LINUXCNC_TIME_CODE 256u

/* Profile switch min_space: Shortest time that a step pin is low between two pulses: 1 makes 5
 * MHz reachable, the client's limits ask for 300 ns. */
#define USC_DOCUMENT_MIN_SPACE 1u
#define USC_LINUXCNC_MIN_SPACE 3u

/* Profile switch ident: Module ID that the board answers with. 42 and above have index reset,
 * which the client needs for homing to an index. */
#define USC_DOCUMENT_IDENT 0x41u
#define USC_LINUXCNC_IDENT 0x41u

/* Profile switch sense_gate: Which index edges set the index sense bit: the document wants index
 * select set, the client never sets it and still reads the bit. */
#define USC_DOCUMENT_SENSE_GATE 0u
#define USC_LINUXCNC_SENSE_GATE 0u

/* Profile switch watchdog_us: Estop this long after the last commit on two adjacent axes (time
 * and rule not documented); 0 = watchdog off. */
#define USC_DOCUMENT_WATCHDOG_US 10000u
#define USC_LINUXCNC_WATCHDOG_US 10000u

/* Profile switch mariss: The 'Mariss' DIP switch, which the document only names. On (ours): no
 * setup time, direction changes as the step pin falls. */
#define USC_DOCUMENT_MARISS 0u
#define USC_LINUXCNC_MARISS 0u

/* Profile switch loopback: On: each step counts into the axis' encoder in place of its quadrature
 * input. */
#define USC_DOCUMENT_LOOPBACK 0u
#define USC_LINUXCNC_LOOPBACK 0u

/* Profile switch base: Board select bits that the board answers to. */
#define USC_DOCUMENT_BASE 0u
#define USC_LINUXCNC_BASE 0u

/* Profile switch enc_filter: Equal samples that an encoder input needs before its level counts.
 * */
#define USC_DOCUMENT_ENC_FILTER 1u
#define USC_LINUXCNC_ENC_FILTER 1u

#endif /* PULSEWRIGHT_USC_REGISTERS_H */
