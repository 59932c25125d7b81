/* Time spent in interrupt routines, measured from outside. To get the CPU load, add the chip's entry
 * cycles (4 on the 328P, 5 on the 2560), which simavr does not count. */
#include "board.h"

static void leave(sim_board *board)
{
    struct profile *p = &board->profile;
    sim_io *io = &board->io;
    if (!p->depth) return;
    p->depth--;
    uint64_t lasted = board->avr->cycle - p->entered[p->depth];
    int vector = p->vector[p->depth];
    io->isr_count++;
    if (!p->depth) io->isr_cycles += lasted;
    if (lasted > io->longest_isr[vector]) io->longest_isr[vector] = lasted;
}

static void on_running(avr_irq_t *irq, uint32_t value, void *param)
{
    const struct profiled_vector *profiled = param;
    sim_board *board = profiled->board;
    struct profile *p = &board->profile;
    (void)irq;
    if (!value) {
        leave(board);
    } else if (p->depth < SIM_VECTORS) {
        p->vector[p->depth] = profiled->vector;
        p->entered[p->depth++] = board->avr->cycle;
    }
}

void profile_open(sim_board *board)
{
    for (int vector = 1; vector < SIM_VECTORS; vector++) {
        avr_irq_t *irq = avr_get_interrupt_irq(board->avr, vector);
        struct profiled_vector *profiled = &board->profile.vectors[vector];
        *profiled = (struct profiled_vector){.board = board, .vector = vector};
        if (irq) avr_irq_register_notify(irq + AVR_INT_IRQ_RUNNING, on_running, profiled);
    }
}

void profile_restore(sim_board *board)
{
    board->profile.depth = 0;
    board->profile.off_since = 0;
}

/* After each instruction, measure how long the main program keeps interrupts off. */
void profile_instruction(sim_board *board)
{
    struct profile *p = &board->profile;
    sim_io *io = &board->io;
    uint64_t now = board->avr->cycle;
    if (!board->avr->sreg[S_I] && !p->depth) {
        if (!p->off_since) p->off_since = now;
        return;
    }
    if (p->off_since && now - p->off_since > io->longest_off) io->longest_off = now - p->off_since;
    p->off_since = 0;
}
