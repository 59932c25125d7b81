/* Analog inputs: voltages that change linearly within a slice, sampled when a conversion starts.
 *
 * simavr has no auto trigger from timer 1. This file triggers conversions by the compare flag: as on
 * silicon, only a flag that changes from cleared to set starts one, so firmware that never clears
 * OCF1B samples only once.
 */
#include "board.h"

#define FULL_SCALE 1023
#define SIMAVR_STEPS 1023 /* simavr reads mV × 1023 / vref */
#define MILLIVOLTS 5000
#define CHANNELS 8
#define TIMER1_COMPB_328P 12
#define ADCSRB_328P 0x7b
#define TRIGGER_MASK 7
#define TRIGGER_TIMER1_COMPB 5
#define PORTD_328P 0x2b
#define DDRD_328P 0x2a
#define LINE_SHIFT 4 /* lines are PD4, PD5, PD6 */
#define INPUTS 6

/* Return the millivolts that simavr converts to exactly this code. */
static uint32_t millivolts(int code)
{
    if (code < 0) code = 0;
    if (code > FULL_SCALE) code = FULL_SCALE;
    return (code * MILLIVOLTS + SIMAVR_STEPS - 1) / SIMAVR_STEPS;
}

/* Return the row of the present time, and the share of the row that has passed. */
static int row_now(const sim_board *board, double *passed)
{
    double length = (double)(board->slice_end - board->slice_start), place;
    int row, last = board->io.analog_rows - 1;
    *passed = 0;
    if (last <= 0 || length <= 0) return 0;
    place = (double)(board->avr->cycle - board->slice_start) / length * last;
    row = place < last ? (int)place : last - 1;
    *passed = place - row;
    return row;
}

/* Return the present voltage of a channel as a share of the reference. */
double analog_share(const sim_board *board, int channel)
{
    const sim_io *io = &board->io;
    double passed;
    int row = row_now(board, &passed);
    double here = io->analog[row][channel];
    return io->analog_rows > 1 ? here + (io->analog[row + 1][channel] - here) * passed : here;
}

static int code_of(const sim_board *board, double share, int channel)
{
    double passed;
    int row = row_now(board, &passed);
    return (int)(share * FULL_SCALE + board->io.analog_noise[row][channel] + 0.5);
}

/* Return the driven line, or -1 if none or several are driven, or one floats. */
static int driven_line(const sim_board *board)
{
    int port = board->avr->data[PORTD_328P] >> LINE_SHIFT & 7;
    int direction = board->avr->data[DDRD_328P] >> LINE_SHIFT & 7;
    if (board->io.driven_low) port ^= 7;
    if (direction != 7) return -1;
    return port == 1 ? 0 : port == 2 ? 1 : port == 4 ? 2 : -1;
}

static void on_conversion(avr_irq_t *irq, uint32_t value, void *param)
{
    sim_board *board = param;
    union { avr_adc_mux_t mux; uint32_t value; } started = {.value = value};
    (void)irq;
    if (started.mux.kind != ADC_MUX_SINGLE) return;
    int input = started.mux.src, channel = input, level = 0;
    if (board->kind == SIM_TAXELS) {
        int line = driven_line(board);
        channel = line < 0 || input >= INPUTS ? -1 : line * INPUTS + input;
    } else if (input > 0) {
        channel = -1;
    }
    if (board->kind == SIM_TAXELS && input < INPUTS && sensor_needs_network(board))
        level = millivolts(code_of(board, sensor_share(board, input), input));
    else if (channel >= 0)
        level = millivolts(code_of(board, analog_share(board, channel), channel));
    /* simavr reads the multiplexer only when ADCL is read, so all channels hold the sample. */
    for (int c = 0; c < CHANNELS; c++) board->analog.adc->adc_values[c] = level;
    if (!board->io.report_samples) return;
    uint64_t sampled = board->analog.triggered ? board->analog.triggered : board->avr->cycle;
    report_edge_at(board, sampled, SIM_OUT_SAMPLE, channel);
}

/* Return the exact cycle of the compare: simavr checks timers between instructions, silicon does not
 * wait. Timer 1 compares at its top, where it restarts. */
static uint64_t compared(const sim_board *board)
{
    uint64_t now = board->avr->cycle, turn = board->analog.timer->tov_cycles;
    return turn ? now - (now - board->analog.timer->tov_base) % turn : now;
}

static void on_compare(avr_irq_t *irq, uint32_t value, void *param)
{
    sim_board *board = param;
    avr_t *avr = board->avr;
    (void)irq;
    if (!value) {
        board->analog.compare_latched = 0;
        return;
    }
    if (board->analog.compare_latched) return;
    board->analog.compare_latched = 1;
    if ((avr->data[ADCSRB_328P] & TRIGGER_MASK) != TRIGGER_TIMER1_COMPB) return;
    board->analog.triggered = compared(board);
    avr_raise_irq(board->analog.adc->io.irq + ADC_IRQ_IN_TRIGGER, 1);
    board->analog.triggered = 0;
}

void analog_open(sim_board *board)
{
    board->analog.adc = (avr_adc_t *)find_io(board->avr, "adc");
    avr_irq_register_notify(board->analog.adc->io.irq + ADC_IRQ_OUT_TRIGGER, on_conversion, board);
    if (board->kind != SIM_TAXELS) return;
    board->analog.timer = (avr_timer_t *)find_io(board->avr, "timer");
    while (board->analog.timer->name != '1')
        board->analog.timer = (avr_timer_t *)board->analog.timer->io.next;
    avr_irq_t *compare = avr_get_interrupt_irq(board->avr, TIMER1_COMPB_328P);
    avr_irq_register_notify(compare + AVR_INT_IRQ_PENDING, on_compare, board);
}
