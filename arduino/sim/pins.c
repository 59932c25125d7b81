/* Pins: inputs that change at exact cycles, outputs with cycle stamps, the bridge's duty, and
 * the index mark that passes its sensor as the step pulses turn the drum. */
#include "board.h"

#define QUEUE (SIM_MAX_INPUTS * 2)
#define OUTPUT_COUNT 6
#define BIT(value, n) ((value) >> (n) & 1)
#define LONGEST_STEP 80000 /* 5 ms: slower steps are single jerks */

struct pin { char port; int bit; };

static const struct pin INPUT[] = {
    [SIM_IN_ESTOP] = {'E', 5}, [SIM_IN_END_UP] = {'C', 7}, [SIM_IN_END_DOWN] = {'C', 6},
    [SIM_IN_INDEX] = {'B', 1}, [SIM_IN_SYNC] = {'B', 0},
};
static const struct pin DRUM_INDEX = {'E', 4};
static const struct pin OUTPUT[OUTPUT_COUNT] = {
    [SIM_OUT_STEP] = {'B', 5}, [SIM_OUT_DIR] = {'A', 0}, [SIM_OUT_ENABLE] = {'A', 1},
    [SIM_OUT_SYNC] = {'A', 2}, [SIM_OUT_BRIDGE] = {'H', 5}, [SIM_OUT_SCK] = {'E', 3},
};

/* Timer 4 of the 2560, whose compare pins PH3 and PH4 drive the bridge. */
enum {
    TCCR4A = 0xa0, TCCR4B = 0xa1, ICR4L = 0xa6, OCR4AL = 0xa8, OCR4BL = 0xaa,
    DDRH = 0x101, PORTH = 0x102, PRESS_BIT = 3, LIFT_BIT = 4,
};

/* Timer 1 of the 2560, whose compare pin PB5 makes the steps. */
enum { TCCR1A = 0x80, OCR1AL = 0x88, PORTB = 0x25, STEP_BIT = 5, TIMER1_COMPA = 17 };
enum { COM_PORT = 0, COM_TOGGLE = 1, COM_SET = 3 };

/* A PORT write restores what simavr believes an input to be, so it is told both ways. */
void set_pin(sim_board *board, char port, int bit, int level)
{
    int n = port - 'A';
    board->pull_mask[n] |= 1 << bit;
    board->pull_value[n] = (board->pull_value[n] & ~(1 << bit)) | level << bit;
    avr_ioport_external_t external = {
        .name = port, .mask = board->pull_mask[n], .value = board->pull_value[n]};
    avr_ioctl(board->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(port), &external);
    avr_raise_irq(avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ(port), bit), level);
}

/* Between pulses the drum glides on to where the last one wants it, as long as a step lasts. */
static double drum_place(const sim_board *board)
{
    const struct drum *drum = &board->drum;
    uint64_t since = board->avr->cycle - drum->stepped;
    if (since >= drum->interval) return (double)drum->steps;
    return drum->from + ((double)drum->steps - drum->from) * (double)since / (double)drum->interval;
}

static int on_mark(const sim_board *board)
{
    const sim_exchange *x = &board->exchange;
    if (x->steps_per_turn <= 0) return 0;
    int64_t at = board->drum.steps % x->steps_per_turn;
    return (at < 0 ? at + x->steps_per_turn : at) < x->mark_length_steps;
}

static void show_mark(sim_board *board)
{
    int level = on_mark(board);
    if (level == board->out_level[SIM_OUT_INDEX]) return;
    board->out_level[SIM_OUT_INDEX] = level;
    set_pin(board, DRUM_INDEX.port, DRUM_INDEX.bit, level);
    report_edge(board, SIM_OUT_INDEX, level);
}

static void on_step(sim_board *board)
{
    struct drum *drum = &board->drum;
    if (board->out_level[SIM_OUT_ENABLE]) return; /* driver off: the pulse moves nothing */
    if (board->exchange.report_steps) report_edge(board, SIM_OUT_STEP, 1);
    if (board->exchange.motor_jammed) return;
    drum->from = drum_place(board);
    drum->interval = board->avr->cycle - drum->stepped;
    if (drum->interval > LONGEST_STEP) drum->interval = LONGEST_STEP;
    drum->stepped = board->avr->cycle;
    drum->steps += board->out_level[SIM_OUT_DIR] ? -1 : 1;
    show_mark(board);
}

static void on_output(sim_board *board, int signal, int level)
{
    if (level == board->out_level[signal]) return;
    board->out_level[signal] = level;
    if (signal == SIM_OUT_SCK) loadcell_clock(board, level);
    else if (signal != SIM_OUT_STEP) report_edge(board, signal, level);
    else if (level) on_step(board);
}

#define ON_OUTPUT(name, signal)                                        \
    static void name(avr_irq_t *irq, uint32_t value, void *param)      \
    {                                                                  \
        (void)irq;                                                     \
        on_output(param, signal, value & 1);                           \
    }
ON_OUTPUT(on_pin_dir, SIM_OUT_DIR)
ON_OUTPUT(on_pin_enable, SIM_OUT_ENABLE)
ON_OUTPUT(on_pin_sync, SIM_OUT_SYNC)
ON_OUTPUT(on_pin_bridge, SIM_OUT_BRIDGE)
ON_OUTPUT(on_pin_sck, SIM_OUT_SCK)

static const avr_irq_notify_t ON_PIN[OUTPUT_COUNT] = {
    [SIM_OUT_DIR] = on_pin_dir, [SIM_OUT_ENABLE] = on_pin_enable,
    [SIM_OUT_SYNC] = on_pin_sync, [SIM_OUT_BRIDGE] = on_pin_bridge, [SIM_OUT_SCK] = on_pin_sck};

static int step_mode(const sim_board *board) { return board->avr->data[TCCR1A] >> 6; }

/* The step pin is derived from compare matches, not from simavr's pin: on each overflow and on
 * each write of OCR1A simavr sets the pin against its compare mode, as fast PWM would. */
static void on_step_match(avr_irq_t *irq, uint32_t value, void *param)
{
    sim_board *board = param;
    int mode = step_mode(board), level = mode == COM_SET;
    (void)irq;
    if (!value || mode == COM_PORT) return;
    on_output(board, SIM_OUT_STEP, mode == COM_TOGGLE ? !board->out_level[SIM_OUT_STEP] : level);
}

/* With the compare output off the pin shows its port bit. */
static void follow_port(sim_board *board)
{
    if (step_mode(board) == COM_PORT)
        on_output(board, SIM_OUT_STEP, BIT(board->avr->data[PORTB], STEP_BIT));
}

static void on_step_mode(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    (void)avr, (void)address, (void)value;
    follow_port(param);
}

static void on_step_port(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)value;
    follow_port(param);
}

/* simavr never matches at 0: the match comes a cycle later instead of not at all. */
static void on_match_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    (void)param;
    if (value || avr->data[OCR1AL + 1]) return;
    int io = AVR_DATA_TO_IO(address);
    avr->io[io].w.c(avr, address, 1, avr->io[io].w.param);
}

static void open_step_pin(sim_board *board)
{
    avr_irq_t *match = avr_get_interrupt_irq(board->avr, TIMER1_COMPA);
    avr_irq_register_notify(match + AVR_INT_IRQ_PENDING, on_step_match, board);
    avr_irq_t *port = avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ('B'), IOPORT_IRQ_REG_PORT);
    avr_irq_register_notify(port, on_step_port, board);
    /* simavr lets four registers have a second listener: these two, and TCCR4A below. */
    avr_register_io_write(board->avr, TCCR1A, on_step_mode, board);
    avr_register_io_write(board->avr, OCR1AL, on_match_write, board);
}

static unsigned timer4_top(const uint8_t *data)
{
    static const unsigned FIXED[4] = {0xffff, 0xff, 0x1ff, 0x3ff};
    if (data[TCCR4B] & 0x10) return data[ICR4L] | data[ICR4L + 1] << 8; /* WGM43 */
    return FIXED[data[TCCR4A] & 3];
}

/* Share of time that a half of the bridge is on: by compare output, or by its port bit. */
static double half_duty(const uint8_t *data, int com_shift, int ocr, int bit)
{
    if (!BIT(data[DDRH], bit)) return 0;
    if (BIT(data[TCCR4A], com_shift + 1) == 0) return BIT(data[PORTH], bit);
    unsigned top = timer4_top(data), on = data[ocr] | data[ocr + 1] << 8;
    return top ? (on > top ? 1.0 : (double)on / top) : 0;
}

static double bridge_duty(const sim_board *board)
{
    const uint8_t *data = board->avr->data;
    if (!board->out_level[SIM_OUT_BRIDGE] || !BIT(data[DDRH], 5)) return 0;
    return half_duty(data, 6, OCR4AL, PRESS_BIT) - half_duty(data, 4, OCR4BL, LIFT_BIT);
}

static void integrate_duty(sim_board *board)
{
    uint64_t now = board->avr->cycle;
    board->duty_sum += board->duty * (double)(now - board->duty_since);
    board->duty_since = now;
    board->duty = bridge_duty(board);
}

static void on_bridge_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    (void)avr, (void)address, (void)value;
    integrate_duty(param);
}

static void on_bridge_change(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)value;
    integrate_duty(param);
}

static void open_bridge(sim_board *board)
{
    avr_irq_t *timer = avr_io_getirq(board->avr, AVR_IOCTL_TIMER_GETIRQ('4'), 0);
    avr_irq_t *port = avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ('H'), IOPORT_IRQ_REG_PORT);
    avr_irq_register_notify(timer + TIMER_IRQ_OUT_PWM0, on_bridge_change, board);
    avr_irq_register_notify(timer + TIMER_IRQ_OUT_PWM1, on_bridge_change, board);
    avr_irq_register_notify(port, on_bridge_change, board);
    avr_register_io_write(board->avr, TCCR4A, on_bridge_write, board);
}

static void pins_open_drum(sim_board *board)
{
    avr_t *avr = board->avr;
    open_step_pin(board);
    for (int i = 0; i < OUTPUT_COUNT; i++) {
        avr_irq_t *irq = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(OUTPUT[i].port), OUTPUT[i].bit);
        if (ON_PIN[i]) avr_irq_register_notify(irq, ON_PIN[i], board);
    }
    open_bridge(board);
    board->out_level[SIM_OUT_ENABLE] = 1; /* pulled up: the driver is off while nobody drives it */
}

void pins_open(sim_board *board)
{
    sim_exchange *x = &board->exchange;
    x->steps_per_turn = 12800;
    x->mark_length_steps = 64;
    if (board->kind == SIM_DRUM) pins_open_drum(board);
    int first = board->kind == SIM_DRUM ? SIM_IN_ESTOP : SIM_IN_INDEX;
    int last = board->kind == SIM_DRUM ? SIM_IN_END_DOWN : SIM_IN_SYNC;
    for (int i = first; i <= last; i++) set_pin(board, INPUT[i].port, INPUT[i].bit, 0);
    if (board->kind == SIM_DRUM) set_pin(board, DRUM_INDEX.port, DRUM_INDEX.bit, 0);
}

/* Pins in reset are inputs: pull resistors hold the drivers off, input levels stay. */
static void float_outputs(sim_board *board)
{
    for (int i = 0; i < OUTPUT_COUNT; i++) {
        avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ(OUTPUT[i].port), OUTPUT[i].bit)->value = 0;
        if (i == SIM_OUT_SCK) on_output(board, i, 0);
        else if (i != SIM_OUT_STEP) on_output(board, i, i == SIM_OUT_ENABLE);
        board->out_level[i] = i == SIM_OUT_ENABLE;
    }
}

void pins_restore(sim_board *board)
{
    if (board->kind == SIM_DRUM) {
        float_outputs(board);
        integrate_duty(board);
        show_mark(board);
    }
    for (int n = 0; n < 16; n++)
        for (int bit = 0; bit < 8; bit++) {
            if (!BIT(board->pull_mask[n], bit)) continue;
            int level = BIT(board->pull_value[n], bit);
            avr_irq_t *irq = avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ('A' + n), bit);
            irq->value = !level; /* or the filter would keep the reset chip from seeing it */
            set_pin(board, 'A' + n, bit, level);
        }
}

void pins_begin(sim_board *board)
{
    struct inputs *in = &board->inputs;
    sim_exchange *x = &board->exchange;
    for (int i = 0; i < x->input_count; i++) {
        if ((in->tail + 1) % QUEUE == in->head) {
            x->overflows++;
            break;
        }
        in->cycle[in->tail] = x->input_cycle[i];
        in->signal[in->tail] = x->input_signal[i];
        in->level[in->tail] = x->input_level[i];
        in->tail = (in->tail + 1) % QUEUE;
    }
    x->input_count = 0;
    board->duty_sum = 0;
    board->duty_since = board->avr->cycle;
}

void pins_end(sim_board *board)
{
    if (board->kind != SIM_DRUM) return;
    integrate_duty(board);
    board->exchange.drum_steps = board->drum.steps;
    board->exchange.drum_place = drum_place(board);
    uint64_t length = board->avr->cycle - board->slice_start;
    board->exchange.drive = length ? board->duty_sum / (double)length : board->duty;
}

uint64_t pins_next(const sim_board *board)
{
    const struct inputs *in = &board->inputs;
    return in->head == in->tail ? NEVER : in->cycle[in->head];
}

void pins_run(sim_board *board, uint64_t now)
{
    struct inputs *in = &board->inputs;
    while (in->head != in->tail && in->cycle[in->head] <= now) {
        const struct pin *pin = &INPUT[in->signal[in->head]];
        set_pin(board, pin->port, pin->bit, in->level[in->head]);
        in->head = (in->head + 1) % QUEUE;
    }
}
