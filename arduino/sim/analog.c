/* Analog inputs: voltages that move linearly within a slice, read when a conversion starts.
 *
 * simavr has no auto trigger from timer 1. It is made here from the compare flag: only a flag
 * that goes from cleared to set starts a conversion, as on silicon, so firmware that never
 * clears OCF1B samples once and never again.
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

/* Millivolts that simavr turns into exactly this code. */
static uint32_t millivolts(int code)
{
    if (code < 0) code = 0;
    if (code > FULL_SCALE) code = FULL_SCALE;
    return (code * MILLIVOLTS + SIMAVR_STEPS - 1) / SIMAVR_STEPS;
}

/* The row of the slice in which now lies, and the share of it that has passed. */
static int row_now(const sim_board *board, double *passed)
{
    double length = (double)(board->slice_end - board->slice_start), place;
    int row, last = board->exchange.analog_rows - 1;
    *passed = 0;
    if (last <= 0 || length <= 0) return 0;
    place = (double)(board->avr->cycle - board->slice_start) / length * last;
    row = place < last ? (int)place : last - 1;
    *passed = place - row;
    return row;
}

/* What the world puts on a channel now, as a share of the reference. */
double share_now(const sim_board *board, int channel)
{
    const sim_exchange *x = &board->exchange;
    double passed;
    int row = row_now(board, &passed);
    double here = x->analog[row][channel];
    return x->analog_rows > 1 ? here + (x->analog[row + 1][channel] - here) * passed : here;
}

static int code_of(const sim_board *board, double share, int channel)
{
    double passed;
    int row = row_now(board, &passed);
    return (int)(share * FULL_SCALE + board->exchange.analog_noise[row][channel] + 0.5);
}

/* The line that is driven, or -1 when none or several are, or one floats. */
static int driven_line(const sim_board *board)
{
    int port = board->avr->data[PORTD_328P] >> LINE_SHIFT & 7;
    int direction = board->avr->data[DDRD_328P] >> LINE_SHIFT & 7;
    if (board->exchange.driven_low) port ^= 7;
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
    if (board->kind == SIM_TAXELS && input < INPUTS && sensor_is_odd(board))
        level = millivolts(code_of(board, sensor_share(board, input), input));
    else if (channel >= 0)
        level = millivolts(code_of(board, share_now(board, channel), channel));
    /* simavr looks at the multiplexer only when ADCL is read: all channels hold the sample. */
    for (int c = 0; c < CHANNELS; c++) board->adc->adc_values[c] = level;
    if (!board->exchange.report_samples) return;
    uint64_t sampled = board->triggered ? board->triggered : board->avr->cycle;
    report_edge_at(board, sampled, SIM_OUT_SAMPLE, channel);
}

/* simavr looks at its timers between instructions; silicon's trigger waits for none. Timer 1
 * compares at its top, where it begins anew. */
static uint64_t compared(const sim_board *board)
{
    uint64_t now = board->avr->cycle, turn = board->sampler->tov_cycles;
    return turn ? now - (now - board->sampler->tov_base) % turn : now;
}

static void on_compare(avr_irq_t *irq, uint32_t value, void *param)
{
    sim_board *board = param;
    avr_t *avr = board->avr;
    (void)irq;
    if (!value) {
        board->compare_latched = 0;
        return;
    }
    if (board->compare_latched) return;
    board->compare_latched = 1;
    if ((avr->data[ADCSRB_328P] & TRIGGER_MASK) != TRIGGER_TIMER1_COMPB) return;
    board->triggered = compared(board);
    avr_raise_irq(board->adc->io.irq + ADC_IRQ_IN_TRIGGER, 1);
    board->triggered = 0;
}

void analog_open(sim_board *board)
{
    board->adc = (avr_adc_t *)find_io(board->avr, "adc");
    avr_irq_register_notify(board->adc->io.irq + ADC_IRQ_OUT_TRIGGER, on_conversion, board);
    if (board->kind != SIM_TAXELS) return;
    board->sampler = (avr_timer_t *)find_io(board->avr, "timer");
    while (board->sampler->name != '1')
        board->sampler = (avr_timer_t *)board->sampler->io.next;
    avr_irq_t *compare = avr_get_interrupt_irq(board->avr, TIMER1_COMPB_328P);
    avr_irq_register_notify(compare + AVR_INT_IRQ_PENDING, on_compare, board);
}
