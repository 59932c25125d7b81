/* The taxel board's own pins and the sensor behind them, with what may be wrong there.
 *
 * A healthy sensor needs none of this: the share that the world gives for the driven line is
 * what an input sees. With a fault, or with a pull-up on, the node of an input is reckoned from
 * everything that pulls at it, in units of the divider's conductance.
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

/* Whether the share of the driven line does not tell the whole story. */
int sensor_is_odd(const sim_board *board)
{
    const sim_exchange *x = &board->exchange;
    return x->driven_low | pull_ups(board) | x->lines_low | x->lines_high | x->lines_together | x->inputs_high |
           x->inputs_low | x->inputs_open | x->inputs_together;
}

/* What a line's driver wants: 0, 1, or -1 where it only listens. */
static int wanted(const sim_board *board, int line)
{
    const uint8_t *data = board->avr->data;
    return BIT(data[DDRD], LINE_SHIFT + line) ? BIT(data[PORTD], LINE_SHIFT + line) : -1;
}

/* Level of a line; two drivers that fight over a bridge leave it low. */
static int line_level(const sim_board *board, int line)
{
    const sim_exchange *x = &board->exchange;
    int level = wanted(board, line);
    if (BIT(x->lines_low, line)) return 0;
    if (BIT(x->lines_high, line)) return 1;
    for (int other = 0; BIT(x->lines_together, line) && other < LINES; other++) {
        if (other == line || !BIT(x->lines_together, other) || wanted(board, other) < 0) continue;
        level = level < 0 ? wanted(board, other) : level & wanted(board, other);
    }
    return level >= 0 ? level : BIT(board->avr->data[PORTD], LINE_SHIFT + line);
}

static double taxel(const sim_board *board, int line, int input)
{
    double share = share_now(board, line * INPUTS + input);
    if (share > MOST) share = MOST;
    return share > 0 ? share / (1 - share) : 0;
}

static void add_input(const sim_board *board, int input, double *pulls, double *up)
{
    if (!BIT(board->exchange.inputs_open, input)) {
        *pulls += 1;
        *up += board->exchange.driven_low;
    }
    if (BIT(pull_ups(board), input)) *pulls += PULL_UP, *up += PULL_UP;
    for (int line = 0; line < LINES; line++) {
        double conductance = taxel(board, line, input);
        *pulls += conductance;
        if (line_level(board, line)) *up += conductance;
    }
}

/* Voltage at an input as a share of the reference. */
double sensor_share(const sim_board *board, int input)
{
    const sim_exchange *x = &board->exchange;
    int node = BIT(x->inputs_together, input) ? x->inputs_together : 1 << input;
    double pulls = 0, up = 0;
    if (node & x->inputs_high) return 1;
    if (node & x->inputs_low) return 0;
    for (int other = 0; other < INPUTS; other++)
        if (BIT(node, other)) add_input(board, other, &pulls, &up);
    return pulls > 0 ? up / pulls : 0;
}

/* simavr reads an output back as it is driven, whatever holds the wire. */
static uint8_t on_read(avr_t *avr, avr_io_addr_t address, void *param)
{
    sim_board *board = avr->custom.data;
    board->pins_read(avr, address, param);
    for (int line = 0; line < LINES; line++) {
        int bit = 1 << (LINE_SHIFT + line);
        avr->data[address] = (avr->data[address] & ~bit) | (line_level(board, line) ? bit : 0);
    }
    return avr->data[address];
}

void sensor_open(sim_board *board)
{
    int port = AVR_DATA_TO_IO(PIND);
    board->pins_read = board->avr->io[port].r.c;
    board->avr->io[port].r.c = on_read;
}
