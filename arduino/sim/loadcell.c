/* The HX711 as in its data sheet: its own conversion clock, a two-wire readout whose pulse count
 * selects the next gain, power-down by a long clock pulse, four conversions of settling. */
#include "board.h"

#define PORT_DOUT 'D'
#define BIT_DOUT 2
#define DATA_PULSES 24
#define LAST_PULSE 27            /* 25: A×128, 26: B×32, 27: A×64 */
#define POWER_DOWN_CYCLES 960    /* 60 µs */
#define SETTLING 4
#define FULL_SCALE 0x7fffff

static void put_dout(sim_board *board, int level)
{
    board->loadcell.dout = level;
    pins_set(board, PORT_DOUT, BIT_DOUT, level);
}

static void start(sim_board *board, int settling)
{
    struct loadcell *cell = &board->loadcell;
    cell->settling = settling;
    cell->pulses = 0;
    cell->ready_q16 = (board->avr->cycle << 16) + board->io.loadcell_period_q16;
}

void loadcell_open(sim_board *board)
{
    board->loadcell.gain_pulses = DATA_PULSES + 1;
    board->io.loadcell_period_q16 = (int64_t)200000 << 16;
    start(board, SETTLING);
    put_dout(board, 1);
}

void loadcell_restore(sim_board *board)
{
    pins_set(board, PORT_DOUT, BIT_DOUT, board->loadcell.dout);
}

static int32_t conversion(sim_board *board)
{
    struct loadcell *cell = &board->loadcell;
    int32_t counts = board->io.loadcell_counts;
    if (board->io.loadcell_mode == SIM_LOADCELL_FROZEN) return cell->last;
    if (board->io.loadcell_mode == SIM_LOADCELL_SATURATED) return FULL_SCALE;
    if (cell->gain_pulses == LAST_PULSE) counts /= 2;
    if (cell->gain_pulses == DATA_PULSES + 2) counts = 0; /* input B is not connected */
    if (counts > FULL_SCALE) counts = FULL_SCALE;
    if (counts < -FULL_SCALE - 1) counts = -FULL_SCALE - 1;
    return counts;
}

/* A read ends with the next conversion; its pulses after the data have selected the gain. */
static void close_read(struct loadcell *cell)
{
    int chosen = cell->pulses > LAST_PULSE ? LAST_PULSE : cell->pulses;
    if (chosen != cell->gain_pulses) cell->settling = SETTLING;
    cell->gain_pulses = chosen;
    cell->pulses = 0;
}

static void finish_conversion(sim_board *board)
{
    struct loadcell *cell = &board->loadcell;
    cell->ready_q16 += board->io.loadcell_period_q16;
    if (cell->pulses > DATA_PULSES) close_read(cell);
    if (cell->settling > 1) {
        cell->settling--;
        return;
    }
    /* An unfinished read holds the register: a conversion that ends meanwhile is lost. */
    if (cell->pulses || board->io.loadcell_mode == SIM_LOADCELL_SILENT) return;
    board->io.loadcell_conversions++;
    cell->held = cell->last = conversion(board);
    if (!cell->dout) put_dout(board, 1);
    put_dout(board, 0);
    cell->offered = board->avr->cycle;
}

static uint64_t power_down_at(const struct loadcell *cell)
{
    return cell->sck && !cell->down ? cell->sck_rise + POWER_DOWN_CYCLES : NEVER;
}

uint64_t loadcell_next(const sim_board *board)
{
    const struct loadcell *cell = &board->loadcell;
    uint64_t next = cell->down ? NEVER : (cell->ready_q16 + 0xffff) >> 16;
    uint64_t off = power_down_at(cell);
    return off < next ? off : next;
}

void loadcell_run(sim_board *board, uint64_t now)
{
    struct loadcell *cell = &board->loadcell;
    if (power_down_at(cell) <= now) {
        cell->down = 1;
        cell->pulses = 0;
        put_dout(board, 1);
    }
    while (!cell->down && cell->ready_q16 <= now << 16) finish_conversion(board);
}

static void end_of_read(sim_board *board)
{
    struct loadcell *cell = &board->loadcell;
    sim_io *io = &board->io;
    uint64_t now = board->avr->cycle;
    if (now - cell->read_start > io->longest_read) io->longest_read = now - cell->read_start;
    if (now - cell->offered > io->loadcell_latency) io->loadcell_latency = now - cell->offered;
}

static void clock_rise(sim_board *board)
{
    struct loadcell *cell = &board->loadcell;
    cell->sck_rise = board->avr->cycle;
    if (cell->down || (cell->pulses == 0 && cell->dout)) return; /* nothing to read */
    if (++cell->pulses == 1) cell->read_start = board->avr->cycle;
    if (cell->pulses <= DATA_PULSES) {
        put_dout(board, cell->held >> (DATA_PULSES - cell->pulses) & 1);
        return;
    }
    put_dout(board, 1);
    if (cell->pulses == DATA_PULSES + 1) board->io.loadcell_reads++;
}

void loadcell_clock(sim_board *board, int level)
{
    struct loadcell *cell = &board->loadcell;
    cell->sck = level;
    if (level) {
        clock_rise(board);
    } else if (cell->down) {
        cell->down = 0;
        cell->gain_pulses = DATA_PULSES + 1;
        start(board, SETTLING);
    } else if (cell->pulses > DATA_PULSES) {
        end_of_read(board);
    }
    schedule(board);
}
