/* The sensor behind the taxel board's pins, with wiring faults.
 *
 * A healthy sensor does not need this file: an input reads the driven line's share. With a fault, or
 * with a pull-up on, the voltage of an input's node is computed from all conductances at it, in units
 * of the divider's conductance.
 */
#include "board.h"

#define LINES 3
#define INPUTS 6
#define LINE_SHIFT 4 /* lines are PD4, PD5, PD6 */
#define PULL_UP 0.28 /* 10 kOhm of divider beside 35 kOhm of pull-up */
#define MOST 0.9995

enum { PIND = 0x29, DDRD = 0x2a, PORTD = 0x2b, DDRC = 0x27, PORTC = 0x28 };

static int pull_ups(const sim_board *board)
{
    return board->avr->data[PORTC] & ~board->avr->data[DDRC] & 0x3f;
}

/* Return whether more than the driven line determines the readings. */
int sensor_needs_network(const sim_board *board)
{
    const sim_io *io = &board->io;
    return io->driven_low | pull_ups(board) | io->lines_low | io->lines_high | io->lines_together |
           io->inputs_high | io->inputs_low | io->inputs_open | io->inputs_together;
}

/* Return the level of a line's driver: 0, 1, or -1 if the pin is an input. */
static int driver_level(const sim_board *board, int line)
{
    const uint8_t *data = board->avr->data;
    return BIT(data[DDRD], LINE_SHIFT + line) ? BIT(data[PORTD], LINE_SHIFT + line) : -1;
}

/* Return the level of a line; two drivers that conflict over a short leave it low. */
static int line_level(const sim_board *board, int line)
{
    const sim_io *io = &board->io;
    int level = driver_level(board, line);
    if (BIT(io->lines_low, line)) return 0;
    if (BIT(io->lines_high, line)) return 1;
    for (int other = 0; BIT(io->lines_together, line) && other < LINES; other++) {
        if (other == line || !BIT(io->lines_together, other) || driver_level(board, other) < 0) continue;
        level = level < 0 ? driver_level(board, other) : level & driver_level(board, other);
    }
    return level >= 0 ? level : BIT(board->avr->data[PORTD], LINE_SHIFT + line);
}

static double taxel(const sim_board *board, int line, int input)
{
    double share = analog_share(board, line * INPUTS + input);
    if (share > MOST) share = MOST;
    return share > 0 ? share / (1 - share) : 0;
}

static void add_input(const sim_board *board, int input, double *pulls, double *up)
{
    if (!BIT(board->io.inputs_open, input)) {
        *pulls += 1;
        *up += board->io.driven_low;
    }
    if (BIT(pull_ups(board), input)) *pulls += PULL_UP, *up += PULL_UP;
    for (int line = 0; line < LINES; line++) {
        double conductance = taxel(board, line, input);
        *pulls += conductance;
        if (line_level(board, line)) *up += conductance;
    }
}

/* Return the voltage at an input as a share of the reference. */
double sensor_share(const sim_board *board, int input)
{
    const sim_io *io = &board->io;
    int node = BIT(io->inputs_together, input) ? io->inputs_together : 1 << input;
    double pulls = 0, up = 0;
    if (node & io->inputs_high) return 1;
    if (node & io->inputs_low) return 0;
    for (int other = 0; other < INPUTS; other++)
        if (BIT(node, other)) add_input(board, other, &pulls, &up);
    return pulls > 0 ? up / pulls : 0;
}

/* Read the lines' true levels: simavr reads an output back as it is driven. */
static uint8_t on_read(avr_t *avr, avr_io_addr_t address, void *param)
{
    sim_board *board = avr->custom.data;
    board->sensor.read_pins(avr, address, param);
    for (int line = 0; line < LINES; line++) {
        int bit = 1 << (LINE_SHIFT + line);
        avr->data[address] = (avr->data[address] & ~bit) | (line_level(board, line) ? bit : 0);
    }
    return avr->data[address];
}

void sensor_open(sim_board *board)
{
    int port = AVR_DATA_TO_IO(PIND);
    board->sensor.read_pins = board->avr->io[port].r.c;
    board->avr->io[port].r.c = on_read;
}
