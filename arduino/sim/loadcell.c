/* The HX711 as in its data sheet: its own conversion clock, a two-wire readout whose pulse count
 * selects the next gain, power-down by a long clock pulse, four conversions of settling. */
#include "loadcell.h"

#define PORT_DOUT 'D'
#define BIT_DOUT 2
#define DATA_PULSES 24
#define LAST_PULSE 27            /* 25: A×128, 26: B×32, 27: A×64 */
#define POWER_DOWN_CYCLES 960    /* 60 µs */
#define SETTLING 4
#define FULL_SCALE 0x7fffff

static void show_dout(struct loadcell *cell)
{
    int level = cell->dout | cell->chip->io.loadcell_data_open;
    if (level == cell->shown) return;
    cell->shown = level;
    pins_set(cell->pins, PORT_DOUT, BIT_DOUT, level);
}

static void put_dout(struct loadcell *cell, int level)
{
    cell->dout = level;
    show_dout(cell);
}

static void start(struct loadcell *cell, int settling)
{
    cell->settling = settling;
    cell->pulses = 0;
    cell->ready_q16 = (cell->chip->avr->cycle << 16) + cell->chip->io.loadcell_period_q16;
}

void loadcell_open(struct loadcell *cell, struct chip *chip, struct pins *pins)
{
    cell->chip = chip;
    cell->pins = pins;
    cell->gain_pulses = DATA_PULSES + 1;
    chip->io.loadcell_period_q16 = (int64_t)200000 << 16;
    start(cell, SETTLING);
    cell->shown = -1;
    put_dout(cell, 1);
}

void loadcell_restore(struct loadcell *cell)
{
    pins_set(cell->pins, PORT_DOUT, BIT_DOUT, cell->shown);
}

static int32_t conversion(struct loadcell *cell)
{
    int32_t counts = cell->chip->io.loadcell_counts;
    if (cell->chip->io.loadcell_mode == SIM_LOADCELL_FROZEN) return cell->last;
    if (cell->chip->io.loadcell_mode == SIM_LOADCELL_SATURATED) return FULL_SCALE;
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

static void finish_conversion(struct loadcell *cell)
{
    cell->ready_q16 += cell->chip->io.loadcell_period_q16;
    if (cell->pulses > DATA_PULSES) close_read(cell);
    if (cell->settling > 1) {
        cell->settling--;
        return;
    }
    /* An unfinished read holds the register: a conversion that ends meanwhile is lost. */
    if (cell->pulses || cell->chip->io.loadcell_mode == SIM_LOADCELL_SILENT) return;
    cell->chip->io.loadcell_conversions++;
    cell->held = cell->last = conversion(cell);
    if (!cell->dout) put_dout(cell, 1);
    put_dout(cell, 0);
    cell->offered = cell->chip->avr->cycle;
}

static uint64_t power_down_at(const struct loadcell *cell)
{
    return cell->sck && !cell->down ? cell->sck_rise + POWER_DOWN_CYCLES : NEVER;
}

uint64_t loadcell_next(const struct loadcell *cell)
{
    uint64_t next = cell->down ? NEVER : (cell->ready_q16 + 0xffff) >> 16;
    uint64_t off = power_down_at(cell);
    return off < next ? off : next;
}

void loadcell_run(struct loadcell *cell, uint64_t now)
{
    if (power_down_at(cell) <= now) {
        cell->down = 1;
        cell->pulses = 0;
        put_dout(cell, 1);
    }
    while (!cell->down && cell->ready_q16 <= now << 16) finish_conversion(cell);
}

static void end_of_read(struct loadcell *cell)
{
    sim_io *io = &cell->chip->io;
    uint64_t now = cell->chip->avr->cycle;
    if (now - cell->read_start > io->longest_read) io->longest_read = now - cell->read_start;
    if (now - cell->offered > io->loadcell_latency) io->loadcell_latency = now - cell->offered;
}

static void clock_rise(struct loadcell *cell)
{
    cell->sck_rise = cell->chip->avr->cycle;
    if (cell->down || (cell->pulses == 0 && cell->dout)) return; /* nothing to read */
    if (++cell->pulses == 1) cell->read_start = cell->chip->avr->cycle;
    if (cell->pulses <= DATA_PULSES) {
        put_dout(cell, cell->held >> (DATA_PULSES - cell->pulses) & 1);
        return;
    }
    put_dout(cell, 1);
    if (cell->pulses == DATA_PULSES + 1) cell->chip->io.loadcell_reads++;
}

/* The wires may have changed. */
void loadcell_begin(struct loadcell *cell)
{
    show_dout(cell);
    loadcell_clock(cell, cell->pins->out_level[SIM_OUT_SCK]);
}

void loadcell_clock(struct loadcell *cell, int level)
{
    if (cell->chip->io.loadcell_clock_open) level = 0;
    if (level == cell->sck) return;
    cell->sck = level;
    if (level) {
        clock_rise(cell);
    } else if (cell->down) {
        cell->down = 0;
        cell->gain_pulses = DATA_PULSES + 1;
        start(cell, SETTLING);
    } else if (cell->pulses > DATA_PULSES) {
        end_of_read(cell);
    }
}
