/* Pins: inputs that change at exact cycles, outputs with cycle stamps, and their reset. */
#include "board.h"

#define QUEUE (SIM_MAX_INPUTS * 2)
#define OUTPUT_COUNT 6

struct pin { char port; int bit; };

static const struct pin INPUT[] = {
    [SIM_IN_ESTOP] = {'E', 5}, [SIM_IN_END_UP] = {'C', 7}, [SIM_IN_END_DOWN] = {'C', 6},
    [SIM_IN_INDEX] = {'B', 1}, [SIM_IN_SYNC] = {'B', 0},
};
static const struct pin OUTPUT[OUTPUT_COUNT] = {
    [SIM_OUT_STEP] = {'B', 5}, [SIM_OUT_DIR] = {'A', 0}, [SIM_OUT_ENABLE] = {'A', 1},
    [SIM_OUT_SYNC] = {'A', 2}, [SIM_OUT_BRIDGE] = {'H', 5}, [SIM_OUT_SCK] = {'E', 3},
};

/* Set an input. A PORT write restores simavr's external value, so set that and the pin. */
void pins_set(sim_board *board, char port, int bit, int level)
{
    int n = port - 'A';
    board->pins.pull_mask[n] |= 1 << bit;
    board->pins.pull_value[n] = (board->pins.pull_value[n] & ~(1 << bit)) | level << bit;
    avr_ioport_external_t external = {
        .name = port, .mask = board->pins.pull_mask[n], .value = board->pins.pull_value[n]};
    avr_ioctl(board->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(port), &external);
    avr_raise_irq(avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ(port), bit), level);
}

void pins_on_output(sim_board *board, int signal, int level)
{
    if (level == board->pins.out_level[signal]) return;
    board->pins.out_level[signal] = level;
    if (signal == SIM_OUT_SCK) loadcell_clock(board, level);
    else if (signal != SIM_OUT_STEP) report_edge(board, signal, level);
    else if (level) motor_step(board);
}

#define ON_OUTPUT(name, signal)                                        \
    static void name(avr_irq_t *irq, uint32_t value, void *param)      \
    {                                                                  \
        (void)irq;                                                     \
        pins_on_output(param, signal, value & 1);                           \
    }
ON_OUTPUT(on_pin_bridge, SIM_OUT_BRIDGE)
ON_OUTPUT(on_pin_sck, SIM_OUT_SCK)

static const avr_irq_notify_t ON_PIN[OUTPUT_COUNT] = {
    [SIM_OUT_BRIDGE] = on_pin_bridge, [SIM_OUT_SCK] = on_pin_sck};

/* Direction, enable and sync may be wired to other bits of their port. */
static void on_port_a(avr_irq_t *irq, uint32_t value, void *param)
{
    sim_board *board = param;
    int signal = SIM_OUT_DIR + (int)irq->irq - board->io.port_a_first;
    if (signal < SIM_OUT_DIR || signal > SIM_OUT_SYNC) return;
    int other = signal == SIM_OUT_ENABLE && board->io.enable_high;
    pins_on_output(board, signal, (int)(value & 1) ^ other);
}

static avr_irq_t *output_irq(sim_board *board, int signal)
{
    struct pin pin = OUTPUT[signal];
    if (pin.port == 'A') pin.bit += board->io.port_a_first;
    return avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ(pin.port), pin.bit);
}

static void pins_open_drum(sim_board *board)
{
    motor_open(board);
    for (int i = 0; i < OUTPUT_COUNT; i++) {
        if (ON_PIN[i]) avr_irq_register_notify(output_irq(board, i), ON_PIN[i], board);
    }
    for (int bit = 0; bit < 8; bit++) {
        avr_irq_t *irq = avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ('A'), bit);
        avr_irq_register_notify(irq, on_port_a, board);
    }
    bridge_open(board);
    board->pins.out_level[SIM_OUT_ENABLE] = 1; /* pulled up: an undriven pin switches the driver off */
}

void pins_open(sim_board *board)
{
    if (board->kind == SIM_DRUM) pins_open_drum(board);
    int first = board->kind == SIM_DRUM ? SIM_IN_ESTOP : SIM_IN_INDEX;
    int last = board->kind == SIM_DRUM ? SIM_IN_END_DOWN : SIM_IN_SYNC;
    for (int i = first; i <= last; i++) pins_set(board, INPUT[i].port, INPUT[i].bit, 0);
}

/* During a reset all pins are inputs: pull resistors hold the drivers off. */
static void float_outputs(sim_board *board)
{
    for (int i = 0; i < OUTPUT_COUNT; i++) {
        output_irq(board, i)->value = 0;
        if (i == SIM_OUT_SCK) pins_on_output(board, i, 0);
        else if (i != SIM_OUT_STEP) pins_on_output(board, i, i == SIM_OUT_ENABLE);
        board->pins.out_level[i] = i == SIM_OUT_ENABLE;
    }
}

void pins_restore(sim_board *board)
{
    if (board->kind == SIM_DRUM) {
        float_outputs(board);
        bridge_changed(board);
        motor_show_mark(board);
    }
    for (int n = 0; n < 16; n++)
        for (int bit = 0; bit < 8; bit++) {
            if (!BIT(board->pins.pull_mask[n], bit)) continue;
            int level = BIT(board->pins.pull_value[n], bit);
            avr_irq_t *irq = avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ('A' + n), bit);
            irq->value = !level; /* otherwise the filter hides the level from the reset chip */
            pins_set(board, 'A' + n, bit, level);
        }
}

void pins_begin(sim_board *board)
{
    struct pin_queue *in = &board->pins.queue;
    sim_io *io = &board->io;
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

uint64_t pins_next(const sim_board *board)
{
    const struct pin_queue *in = &board->pins.queue;
    return in->head == in->tail ? NEVER : in->cycle[in->head];
}

void pins_run(sim_board *board, uint64_t now)
{
    struct pin_queue *in = &board->pins.queue;
    while (in->head != in->tail && in->cycle[in->head] <= now) {
        const struct pin *pin = &INPUT[in->signal[in->head]];
        pins_set(board, pin->port, pin->bit, in->level[in->head]);
        in->head = (in->head + 1) % QUEUE;
    }
}
