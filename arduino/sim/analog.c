/* The converter samples an input when a conversion starts.
 *
 * simavr has no auto trigger from timer 1. This file triggers conversions by the compare flag: as on
 * silicon, only a flag that changes from cleared to set starts one, so firmware that never clears
 * OCF1B samples only once.
 */
#include "analog.h"

#include "voltage.h"

#define FULL_SCALE 1023
#define SIMAVR_STEPS 1023 /* simavr reads mV × 1023 / vref */
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
static uint32_t millivolts(const struct chip *chip, int code)
{
    if (code < 0) code = 0;
    if (code > FULL_SCALE) code = FULL_SCALE;
    return (code * (int)chip->avr->avcc + SIMAVR_STEPS - 1) / SIMAVR_STEPS;
}

static int code_of(const struct chip *chip, double share, int channel)
{
    return (int)(share * FULL_SCALE + analog_noise(chip, channel) + 0.5);
}

/* Return the driven line, or -1 if none or several are driven, or one floats. */
static int driven_line(const struct chip *chip)
{
    int port = chip->avr->data[PORTD_328P] >> LINE_SHIFT & 7;
    int direction = chip->avr->data[DDRD_328P] >> LINE_SHIFT & 7;
    if (chip->io.driven_low) port ^= 7;
    if (direction != 7) return -1;
    return port == 1 ? 0 : port == 2 ? 1 : port == 4 ? 2 : -1;
}

/* Return the millivolts at an input, and in `channel` the taxel that it reads, -1 for none. */
static uint32_t convert_taxel(const struct analog *analog, int input, int *channel)
{
    const struct chip *chip = analog->chip;
    int line = driven_line(chip);
    *channel = line < 0 || input >= INPUTS ? -1 : line * INPUTS + input;
    if (input >= INPUTS) return 0;
    return millivolts(chip, code_of(chip, sensor_share(analog->sensor, input), line < 0 ? input : *channel));
}

static void on_conversion(avr_irq_t *irq, uint32_t value, void *param)
{
    struct analog *analog = param;
    struct chip *chip = analog->chip;
    union { avr_adc_mux_t mux; uint32_t value; } started = {.value = value};
    (void)irq;
    if (started.mux.kind != ADC_MUX_SINGLE) return;
    int input = started.mux.src, channel = input > 0 ? -1 : input, level = 0;
    if (chip->kind == SIM_TAXELS) level = convert_taxel(analog, input, &channel);
    else if (!input) level = millivolts(chip, code_of(chip, analog_input(chip, 0), 0));
    /* simavr reads the multiplexer only when ADCL is read, so all channels hold the sample. */
    for (int c = 0; c < CHANNELS; c++) analog->adc->adc_values[c] = level;
    if (!chip->io.report_samples) return;
    uint64_t sampled = analog->triggered ? analog->triggered : chip->avr->cycle;
    report_edge_at(chip, sampled, SIM_OUT_SAMPLE, channel);
}

/* Return the exact cycle of the compare: simavr checks timers between instructions, silicon does not
 * wait. Timer 1 compares at its top, where it restarts. */
static uint64_t compared(const struct analog *analog)
{
    uint64_t now = analog->chip->avr->cycle, turn = analog->timer->tov_cycles;
    return turn ? now - (now - analog->timer->tov_base) % turn : now;
}

static void on_compare(avr_irq_t *irq, uint32_t value, void *param)
{
    struct analog *analog = param;
    avr_t *avr = analog->chip->avr;
    (void)irq;
    if (!value) {
        analog->compare_latched = 0;
        return;
    }
    if (analog->compare_latched) return;
    analog->compare_latched = 1;
    if ((avr->data[ADCSRB_328P] & TRIGGER_MASK) != TRIGGER_TIMER1_COMPB) return;
    analog->triggered = compared(analog);
    avr_raise_irq(analog->adc->io.irq + ADC_IRQ_IN_TRIGGER, 1);
    analog->triggered = 0;
}

void analog_open(struct analog *analog, struct chip *chip, const struct sensor *sensor)
{
    analog->chip = chip;
    analog->sensor = sensor;
    analog->adc = (avr_adc_t *)find_io(chip->avr, "adc");
    avr_irq_register_notify(analog->adc->io.irq + ADC_IRQ_OUT_TRIGGER, on_conversion, analog);
    if (chip->kind != SIM_TAXELS) return;
    analog->timer = (avr_timer_t *)find_io(chip->avr, "timer");
    while (analog->timer->name != '1') analog->timer = (avr_timer_t *)analog->timer->io.next;
    avr_irq_t *compare = avr_get_interrupt_irq(chip->avr, TIMER1_COMPB_328P);
    avr_irq_register_notify(compare + AVR_INT_IRQ_PENDING, on_compare, analog);
}
