/* The sensor behind the taxel board's pins, with wiring faults.
 *
 * The voltage of an input's node follows from all conductances at it, in units of the divider's: the
 * divider, the three taxels of the input, of which the driven line pulls one up and the others, whose
 * lines are low, pull down, and a pull-up if it is on.
 */
#include "sensor.h"

#include "voltage.h"

#define LINES 3
#define INPUTS 6
#define LINE_SHIFT 4 /* lines are PD4, PD5, PD6 */
#define PULL_UP 0.28 /* 10 kOhm of divider beside 35 kOhm of pull-up */

enum { PIND = 0x29, DDRD = 0x2a, PORTD = 0x2b, DDRC = 0x27, PORTC = 0x28 };

static int pull_ups(const struct sensor *sensor)
{
    return sensor->chip->avr->data[PORTC] & ~sensor->chip->avr->data[DDRC] & 0x3f;
}

/* Return the level of a line's driver: 0, 1, or -1 if the pin is an input. */
static int driver_level(const struct sensor *sensor, int line)
{
    const uint8_t *data = sensor->chip->avr->data;
    return BIT(data[DDRD], LINE_SHIFT + line) ? BIT(data[PORTD], LINE_SHIFT + line) : -1;
}

/* Return the level of a line; two drivers that conflict over a short leave it low. */
static int line_level(const struct sensor *sensor, int line)
{
    const sim_io *io = &sensor->chip->io;
    int level = driver_level(sensor, line);
    if (BIT(io->lines_low, line)) return 0;
    if (BIT(io->lines_high, line)) return 1;
    for (int other = 0; BIT(io->lines_together, line) && other < LINES; other++) {
        if (other == line || !BIT(io->lines_together, other) || driver_level(sensor, other) < 0) continue;
        level = level < 0 ? driver_level(sensor, other) : level & driver_level(sensor, other);
    }
    return level >= 0 ? level : BIT(sensor->chip->avr->data[PORTD], LINE_SHIFT + line);
}

static void add_input(const struct sensor *sensor, int input, double *pulls, double *up)
{
    if (!BIT(sensor->chip->io.inputs_open, input)) {
        *pulls += 1;
        *up += sensor->chip->io.driven_low;
    }
    if (BIT(pull_ups(sensor), input)) *pulls += PULL_UP, *up += PULL_UP;
    for (int line = 0; line < LINES; line++) {
        double conductance = analog_input(sensor->chip, line * INPUTS + input);
        *pulls += conductance;
        if (line_level(sensor, line)) *up += conductance;
    }
}

/* Return the voltage at an input as a share of the reference. */
double sensor_share(const struct sensor *sensor, int input)
{
    const sim_io *io = &sensor->chip->io;
    int node = BIT(io->inputs_together, input) ? io->inputs_together : 1 << input;
    double pulls = 0, up = 0;
    if (node & io->inputs_high) return 1;
    if (node & io->inputs_low) return 0;
    for (int other = 0; other < INPUTS; other++)
        if (BIT(node, other)) add_input(sensor, other, &pulls, &up);
    return pulls > 0 ? up / pulls : 0;
}

/* Read the lines' true levels: simavr reads an output back as it is driven. */
static uint8_t on_read(avr_t *avr, avr_io_addr_t address, void *param)
{
    struct sensor *sensor = param;
    sensor->read_pins(avr, address, sensor->read_param);
    for (int line = 0; line < LINES; line++) {
        int bit = 1 << (LINE_SHIFT + line);
        avr->data[address] = (avr->data[address] & ~bit) | (line_level(sensor, line) ? bit : 0);
    }
    return avr->data[address];
}

void sensor_open(struct sensor *sensor, struct chip *chip)
{
    int port = AVR_DATA_TO_IO(PIND);
    sensor->chip = chip;
    sensor->read_pins = chip->avr->io[port].r.c;
    sensor->read_param = chip->avr->io[port].r.param;
    chip->avr->io[port].r.c = on_read;
    chip->avr->io[port].r.param = sensor;
}
