/* Time spent in interrupt routines, measured from outside. Add the chip's entry cycles (4 on
 * the 328P, 5 on the 2560), which simavr does not count, before calling it a CPU load. */
#include "board.h"

static void leave(sim_board *board)
{
    struct profile *p = &board->profile;
    sim_exchange *x = &board->exchange;
    if (!p->depth) return;
    p->depth--;
    uint64_t lasted = board->avr->cycle - p->entered[p->depth];
    int vector = p->vector[p->depth];
    x->isr_count++;
    if (!p->depth) x->isr_cycles += lasted;
    if (lasted > x->longest_isr[vector]) x->longest_isr[vector] = lasted;
}

static void on_running(avr_irq_t *irq, uint32_t value, void *param)
{
    const struct watched *watched = param;
    sim_board *board = watched->board;
    struct profile *p = &board->profile;
    (void)irq;
    if (!value) {
        leave(board);
    } else if (p->depth < SIM_VECTORS) {
        p->vector[p->depth] = watched->vector;
        p->entered[p->depth++] = board->avr->cycle;
    }
}

void profile_open(sim_board *board)
{
    for (int vector = 1; vector < SIM_VECTORS; vector++) {
        avr_irq_t *irq = avr_get_interrupt_irq(board->avr, vector);
        struct watched *watched = &board->profile.watched[vector];
        *watched = (struct watched){.board = board, .vector = vector};
        if (irq) avr_irq_register_notify(irq + AVR_INT_IRQ_RUNNING, on_running, watched);
    }
}

void profile_restore(sim_board *board)
{
    board->profile.depth = 0;
    board->profile.off_since = 0;
}

/* After an instruction: how long the main program has kept interrupts off. */
void profile_look(sim_board *board)
{
    struct profile *p = &board->profile;
    sim_exchange *x = &board->exchange;
    uint64_t now = board->avr->cycle;
    if (!board->avr->sreg[S_I] && !p->depth) {
        if (!p->off_since) p->off_since = now;
        return;
    }
    if (p->off_since && now - p->off_since > x->longest_off) x->longest_off = now - p->off_since;
    p->off_since = 0;
}
