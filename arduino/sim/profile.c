/* Time spent in interrupt routines, measured from outside. To get the CPU load, add the chip's entry
 * cycles (4 on the 328P, 5 on the 2560), which simavr does not count. */
#include "profile.h"

static void leave(struct profile *profile)
{
    sim_io *io = &profile->chip->io;
    if (!profile->depth) return;
    profile->depth--;
    uint64_t lasted = profile->chip->avr->cycle - profile->entered[profile->depth];
    int vector = profile->vector[profile->depth];
    io->isr_count++;
    if (!profile->depth) io->isr_cycles += lasted;
    if (lasted > io->longest_isr[vector]) io->longest_isr[vector] = lasted;
}

static void on_running(avr_irq_t *irq, uint32_t value, void *param)
{
    const struct profiled_vector *profiled = param;
    struct profile *profile = profiled->profile;
    (void)irq;
    if (!value) {
        leave(profile);
    } else if (profile->depth < SIM_VECTORS) {
        profile->vector[profile->depth] = profiled->vector;
        profile->entered[profile->depth++] = profile->chip->avr->cycle;
    }
}

void profile_open(struct profile *profile, struct chip *chip)
{
    profile->chip = chip;
    for (int vector = 1; vector < SIM_VECTORS; vector++) {
        avr_irq_t *irq = avr_get_interrupt_irq(chip->avr, vector);
        struct profiled_vector *profiled = &profile->vectors[vector];
        *profiled = (struct profiled_vector){.profile = profile, .vector = vector};
        if (irq) avr_irq_register_notify(irq + AVR_INT_IRQ_RUNNING, on_running, profiled);
    }
}

void profile_restore(struct profile *profile)
{
    profile->depth = 0;
    profile->off_since = 0;
}

/* After each instruction, measure how long the main program keeps interrupts off. */
void profile_instruction(struct profile *profile)
{
    sim_io *io = &profile->chip->io;
    uint64_t now = profile->chip->avr->cycle;
    if (!profile->chip->avr->sreg[S_I] && !profile->depth) {
        if (!profile->off_since) profile->off_since = now;
        return;
    }
    if (profile->off_since && now - profile->off_since > io->longest_off) io->longest_off = now - profile->off_since;
    profile->off_since = 0;
}
