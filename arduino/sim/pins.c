/* Pins: inputs that change at exact cycles, outputs with cycle stamps, and their reset. */
#include "pins.h"

#define QUEUE (SIM_MAX_INPUTS * 2)
#define OUTPUT_COUNT 6

struct pin { char port; int bit; };

static const struct pin INPUT[] = {
    [SIM_IN_ESTOP] = {'E', 5}, [SIM_IN_END_UP] = {'C', 7}, [SIM_IN_END_DOWN] = {'C', 6},
    [SIM_IN_INDEX] = {'B', 1}, [SIM_IN_SYNC] = {'B', 0},
    [SIM_IN_MARK] = {'E', 4},
};
static const struct pin OUTPUT[OUTPUT_COUNT] = {
    [SIM_OUT_STEP] = {'B', 5}, [SIM_OUT_DIR] = {'A', 0}, [SIM_OUT_ENABLE] = {'A', 1},
    [SIM_OUT_SYNC] = {'A', 2}, [SIM_OUT_BRIDGE] = {'H', 5}, [SIM_OUT_SCK] = {'E', 3},
};

/* Set an input. A PORT write restores simavr's external value, so set that and the pin. */
void pins_set(struct pins *pins, char port, int bit, int level)
{
    int n = port - 'A';
    pins->pull_mask[n] |= 1 << bit;
    pins->pull_value[n] = (pins->pull_value[n] & ~(1 << bit)) | level << bit;
    avr_ioport_external_t external = {
        .name = port, .mask = pins->pull_mask[n], .value = pins->pull_value[n]};
    avr_ioctl(pins->chip->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(port), &external);
    avr_raise_irq(avr_io_getirq(pins->chip->avr, AVR_IOCTL_IOPORT_GETIRQ(port), bit), level);
}

static void set_output(struct pins *pins, int signal, int level)
{
    if (level == pins->out_level[signal]) return;
    pins->out_level[signal] = level;
    if (signal != SIM_OUT_SCK) report_edge(pins->chip, signal, level);
    else if (pins->on_clock) pins->on_clock(pins->clock_param, level);
}

static void on_bridge(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    set_output(param, SIM_OUT_BRIDGE, value & 1);
}

static void on_clock(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    set_output(param, SIM_OUT_SCK, value & 1);
}

/* Direction, enable and sync may be wired to other bits of their port. */
static void on_port_a(avr_irq_t *irq, uint32_t value, void *param)
{
    struct pins *pins = param;
    int signal = SIM_OUT_DIR + (int)irq->irq - pins->chip->io.port_a_first;
    if (signal < SIM_OUT_DIR || signal > SIM_OUT_SYNC) return;
    int other = signal == SIM_OUT_ENABLE && pins->chip->io.enable_high;
    set_output(pins, signal, (int)(value & 1) ^ other);
}

static avr_irq_t *output_irq(struct pins *pins, int signal)
{
    struct pin pin = OUTPUT[signal];
    if (pin.port == 'A') pin.bit += pins->chip->io.port_a_first;
    return avr_io_getirq(pins->chip->avr, AVR_IOCTL_IOPORT_GETIRQ(pin.port), pin.bit);
}

static void listen(struct pins *pins)
{
    avr_irq_register_notify(output_irq(pins, SIM_OUT_BRIDGE), on_bridge, pins);
    avr_irq_register_notify(output_irq(pins, SIM_OUT_SCK), on_clock, pins);
    for (int bit = 0; bit < 8; bit++) {
        avr_irq_t *irq = avr_io_getirq(pins->chip->avr, AVR_IOCTL_IOPORT_GETIRQ('A'), bit);
        avr_irq_register_notify(irq, on_port_a, pins);
    }
    pins->out_level[SIM_OUT_ENABLE] = 1; /* pulled up: an undriven pin switches the driver off */
}

void pins_open(struct pins *pins, struct chip *chip)
{
    int drum = chip->kind == SIM_DRUM;
    int first = drum ? SIM_IN_ESTOP : SIM_IN_INDEX, last = drum ? SIM_IN_END_DOWN : SIM_IN_SYNC;
    pins->chip = chip;
    if (drum) listen(pins);
    for (int i = first; i <= last; i++) pins_set(pins, INPUT[i].port, INPUT[i].bit, 0);
}

/* During a reset all pins are inputs: pull resistors hold the drivers off. */
void pins_float(struct pins *pins)
{
    for (int i = 0; i < OUTPUT_COUNT; i++) {
        output_irq(pins, i)->value = 0;
        if (i == SIM_OUT_SCK) set_output(pins, i, 0);
        else if (i != SIM_OUT_STEP) set_output(pins, i, i == SIM_OUT_ENABLE);
        pins->out_level[i] = i == SIM_OUT_ENABLE;
    }
}

void pins_restore(struct pins *pins)
{
    for (int n = 0; n < 16; n++)
        for (int bit = 0; bit < 8; bit++) {
            if (!BIT(pins->pull_mask[n], bit)) continue;
            int level = BIT(pins->pull_value[n], bit);
            avr_irq_t *irq = avr_io_getirq(pins->chip->avr, AVR_IOCTL_IOPORT_GETIRQ('A' + n), bit);
            irq->value = !level; /* otherwise the filter hides the level from the reset chip */
            pins_set(pins, 'A' + n, bit, level);
        }
}

void pins_begin(struct pins *pins)
{
    struct pin_queue *in = &pins->queue;
    sim_io *io = &pins->chip->io;
    for (int i = 0; i < io->input_count; i++) {
        if ((in->tail + 1) % QUEUE == in->head) {
            io->overflows++;
            break;
        }
        in->cycle[in->tail] = io->input_cycle[i];
        in->signal[in->tail] = io->input_signal[i];
        in->level[in->tail] = io->input_level[i];
        in->tail = (in->tail + 1) % QUEUE;
    }
    io->input_count = 0;
}

uint64_t pins_next(const struct pins *pins)
{
    const struct pin_queue *in = &pins->queue;
    return in->head == in->tail ? NEVER : in->cycle[in->head];
}

void pins_run(struct pins *pins, uint64_t now)
{
    struct pin_queue *in = &pins->queue;
    while (in->head != in->tail && in->cycle[in->head] <= now) {
        const struct pin *pin = &INPUT[in->signal[in->head]];
        pins_set(pins, pin->port, pin->bit, in->level[in->head]);
        in->head = (in->head + 1) % QUEUE;
    }
}
