#include "chip.h"

#include <string.h>

void report_edge(struct chip *chip, int signal, int level)
{
    report_edge_at(chip, chip->avr->cycle, signal, level);
}

void report_edge_at(struct chip *chip, uint64_t cycle, int signal, int level)
{
    sim_io *io = &chip->io;
    if (io->edge_count == SIM_MAX_EDGES) {
        io->overflows++;
        return;
    }
    io->edge_cycle[io->edge_count] = cycle;
    io->edge_signal[io->edge_count] = signal;
    io->edge_level[io->edge_count++] = level;
}

/* Return simavr's first peripheral of a kind. */
avr_io_t *find_io(avr_t *avr, const char *kind)
{
    avr_io_t *io = avr->io_port;
    while (io && strcmp(io->kind, kind)) io = io->next;
    return io;
}
