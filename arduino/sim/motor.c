/* The stepper: pulses by the compare pin turn the drum, and the drum its index mark. */
#include "board.h"

#include <stddef.h>

#define PORT_INDEX 'E'
#define BIT_INDEX 4
#define LONGEST_STEP 80000 /* 5 ms: slower steps are single jerks */

/* Timer 1 of the 2560, whose compare pin PB5 makes the steps. */
enum { TCCR1A = 0x80, TCNT1L = 0x84, OCR1AL = 0x88, PORTB = 0x25, STEP_BIT = 5 };
enum { TIMER1_COMPA = 17, ROUND = 0x10000, LONGEST_INSTRUCTION = 5 };
enum { COM_PORT = 0, COM_TOGGLE = 1, COM_SET = 3 };

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

void motor_show_mark(sim_board *board)
{
    int level = on_mark(board), pin = level ^ board->exchange.mark_inverted;
    if (pin != board->drum.index_pin) set_pin(board, PORT_INDEX, BIT_INDEX, pin);
    board->drum.index_pin = pin;
    if (level == board->out_level[SIM_OUT_INDEX]) return;
    board->out_level[SIM_OUT_INDEX] = level;
    report_edge(board, SIM_OUT_INDEX, level);
}

void motor_step(sim_board *board)
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
    motor_show_mark(board);
}

static int step_mode(const sim_board *board) { return board->avr->data[TCCR1A] >> 6; }

/* The step pin is derived from compare matches, not from simavr's pin: on each overflow and on
 * each write of OCR1A simavr sets the pin against its compare mode, as fast PWM would. */
static void on_step_match(avr_irq_t *irq, uint32_t value, void *param)
{
    sim_board *board = param;
    int mode = step_mode(board), level = mode == COM_SET;
    (void)irq;
    if (!value) return;
    board->drum.matched = 1;
    if (mode == COM_PORT) return;
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

static avr_int_vector_t *vector_of(avr_t *avr, int number)
{
    avr_int_vector_t **vectors = avr->interrupts.vector;
    for (int i = 0; i < avr->interrupts.vector_count; i++)
        if (vectors[i]->vector == number) return vectors[i];
    return NULL;
}

static uint16_t count_of_timer(avr_t *avr)
{
    int io = AVR_DATA_TO_IO(TCNT1L);
    uint8_t low = avr->io[io].r.c(avr, TCNT1L, avr->io[io].r.param);
    return (uint16_t)(low | avr->data[TCNT1L + 1] << 8);
}

/* A match that did not come is made up for, with the port bit that simavr toggles at each. */
static avr_cycle_count_t on_match_overdue(avr_t *avr, avr_cycle_count_t when, void *param)
{
    sim_board *board = param;
    (void)when;
    if (board->drum.matched) return 0;
    if (step_mode(board) == COM_TOGGLE) {
        int high = !BIT(avr->data[PORTB], STEP_BIT);
        avr_irq_t *pin = avr_io_getirq(avr, AVR_IOCTL_TIMER_GETIRQ('1'), TIMER_IRQ_OUT_COMP);
        avr_raise_irq(pin, AVR_IOPORT_OUTPUT | (uint32_t)high);
    }
    avr_raise_interrupt(avr, vector_of(avr, TIMER1_COMPA));
    return 0;
}

/* Where the instruction in which the timer overflows ends behind the match, simavr 1.6 leaves the
 * match out for a whole round (avr_timer_tov): one of some hundred thousand came 4 ms late. It
 * matches a cycle after the count is reached; a cycle later it is known to have left it out. */
static void on_match_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    sim_board *board = param;
    uint16_t match = (uint16_t)(value | avr->data[OCR1AL + 1] << 8), count = count_of_timer(avr);
    (void)address;
    board->drum.matched = 0;
    avr_cycle_timer_cancel(avr, on_match_overdue, board);
    if (match >= LONGEST_INSTRUCTION || count <= match) return;
    avr_cycle_timer_register(avr, ROUND - count + match + 2u, on_match_overdue, board);
}

void motor_open(sim_board *board)
{
    avr_irq_t *match = avr_get_interrupt_irq(board->avr, TIMER1_COMPA);
    avr_irq_register_notify(match + AVR_INT_IRQ_PENDING, on_step_match, board);
    avr_irq_t *port = avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ('B'), IOPORT_IRQ_REG_PORT);
    avr_irq_register_notify(port, on_step_port, board);
    /* simavr lets four registers have a second listener: these two, and TCCR4A of the bridge. */
    avr_register_io_write(board->avr, TCCR1A, on_step_mode, board);
    avr_register_io_write(board->avr, OCR1AL, on_match_write, board);
    board->exchange.steps_per_turn = 12800;
    board->exchange.mark_length_steps = 64;
    set_pin(board, PORT_INDEX, BIT_INDEX, 0);
}

void motor_end(sim_board *board)
{
    board->exchange.drum_steps = board->drum.steps;
    board->exchange.drum_place = drum_place(board);
}
