/* The stepper: pulses of the compare pin turn the drum with its index mark. */
#include "motor.h"

#include <math.h>
#include <stddef.h>

#include "avr_timer.h"

#define PORT_INDEX 'E'
#define BIT_INDEX 4
#define LONGEST_STEP 80000 /* 5 ms: slower steps are single movements */

/* Timer 1 of the 2560, whose compare pin PB5 makes the steps. */
enum { TCCR1A = 0x80, TCNT1L = 0x84, OCR1AL = 0x88, PORTB = 0x25, STEP_BIT = 5 };
enum { TIMER1_COMPA = 17, ROUND = 0x10000, LONGEST_INSTRUCTION = 5 };
enum { COM_PORT = 0, COM_TOGGLE = 1, COM_SET = 3 };

/* Position of the drum, which takes the duration of a step to reach each new step. */
static double position(const struct motor *motor)
{
    uint64_t since = motor->chip->avr->cycle - motor->stepped;
    if (since >= motor->interval) return motor->steps;
    return motor->from + (motor->steps - motor->from) * (double)since / (double)motor->interval;
}

static int on_mark(const struct motor *motor)
{
    const sim_io *io = &motor->chip->io;
    if (io->steps_per_turn <= 0) return 0;
    double at = fmod(motor->steps, io->steps_per_turn);
    return (at < 0 ? at + io->steps_per_turn : at) < io->mark_length_steps;
}

void motor_show_mark(struct motor *motor)
{
    int level = on_mark(motor), pin = level ^ motor->chip->io.mark_inverted;
    if (pin != motor->index_pin) pins_set(motor->pins, PORT_INDEX, BIT_INDEX, pin);
    motor->index_pin = pin;
    if (level == motor->pins->out_level[SIM_OUT_INDEX]) return;
    motor->pins->out_level[SIM_OUT_INDEX] = level;
    report_edge(motor->chip, SIM_OUT_INDEX, level);
}

static int backwards(const struct motor *motor)
{
    int level = motor->pins->out_level[SIM_OUT_DIR], wire = motor->chip->io.direction;
    return wire == SIM_DIRECTION_STUCK ? 0 : level ^ (wire == SIM_DIRECTION_REVERSED);
}

static void make_step(struct motor *motor)
{
    if (motor->pins->out_level[SIM_OUT_ENABLE]) return; /* driver off: the pulse moves nothing */
    if (motor->chip->io.report_steps) report_edge(motor->chip, SIM_OUT_STEP, 1);
    if (motor->chip->io.motor_jammed) return;
    motor->from = position(motor);
    motor->interval = motor->chip->avr->cycle - motor->stepped;
    if (motor->interval > LONGEST_STEP) motor->interval = LONGEST_STEP;
    motor->stepped = motor->chip->avr->cycle;
    motor->steps += backwards(motor) ? -motor->chip->io.step_size : motor->chip->io.step_size;
    motor_show_mark(motor);
}

static void set_step_pin(struct motor *motor, int level)
{
    uint8_t *pin = &motor->pins->out_level[SIM_OUT_STEP];
    if (level == *pin) return;
    *pin = level;
    if (level) make_step(motor);
}

static int step_mode(const struct motor *motor) { return motor->chip->avr->data[TCCR1A] >> 6; }

/* Derive the step pin from compare matches instead of simavr's pin: on each overflow and on each
 * write of OCR1A simavr sets the pin against its compare mode, as in fast PWM. */
static void on_step_match(avr_irq_t *irq, uint32_t value, void *param)
{
    struct motor *motor = param;
    int mode = step_mode(motor), level = mode == COM_SET;
    (void)irq;
    if (!value) return;
    motor->matched = 1;
    if (mode == COM_PORT) return;
    set_step_pin(motor, mode == COM_TOGGLE ? !motor->pins->out_level[SIM_OUT_STEP] : level);
}

/* Follow the port bit while the compare output is off. */
static void follow_port(struct motor *motor)
{
    if (step_mode(motor) == COM_PORT)
        set_step_pin(motor, BIT(motor->chip->avr->data[PORTB], STEP_BIT));
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

/* Raise a match that simavr has missed, and toggle the port bit as simavr does at each match. */
static avr_cycle_count_t on_match_overdue(avr_t *avr, avr_cycle_count_t when, void *param)
{
    struct motor *motor = param;
    (void)when;
    if (motor->matched) return 0;
    if (step_mode(motor) == COM_TOGGLE) {
        int high = !BIT(avr->data[PORTB], STEP_BIT);
        avr_irq_t *pin = avr_io_getirq(avr, AVR_IOCTL_TIMER_GETIRQ('1'), TIMER_IRQ_OUT_COMP);
        avr_raise_irq(pin, AVR_IOPORT_OUTPUT | (uint32_t)high);
    }
    avr_raise_interrupt(avr, vector_of(avr, TIMER1_COMPA));
    return 0;
}

/* If the instruction in which the timer overflows ends after the match, simavr 1.6 misses the match
 * for a whole round (avr_timer_tov): one of some hundred thousand came 4 ms late. simavr matches one
 * cycle after the count is reached; if it has not matched one cycle later, it has missed it. */
static void on_match_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    struct motor *motor = param;
    uint16_t match = (uint16_t)(value | avr->data[OCR1AL + 1] << 8), count = count_of_timer(avr);
    (void)address;
    motor->matched = 0;
    avr_cycle_timer_cancel(avr, on_match_overdue, motor);
    if (match >= LONGEST_INSTRUCTION || count <= match) return;
    avr_cycle_timer_register(avr, ROUND - count + match + 2u, on_match_overdue, motor);
}

void motor_open(struct motor *motor, struct chip *chip, struct pins *pins)
{
    avr_t *avr = chip->avr;
    motor->chip = chip;
    motor->pins = pins;
    avr_irq_t *match = avr_get_interrupt_irq(avr, TIMER1_COMPA);
    avr_irq_register_notify(match + AVR_INT_IRQ_PENDING, on_step_match, motor);
    avr_irq_t *port = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), IOPORT_IRQ_REG_PORT);
    avr_irq_register_notify(port, on_step_port, motor);
    /* simavr allows second listeners on four registers: these two, and TCCR4A of the bridge. */
    avr_register_io_write(avr, TCCR1A, on_step_mode, motor);
    avr_register_io_write(avr, OCR1AL, on_match_write, motor);
    chip->io.step_size = 1;
    chip->io.steps_per_turn = 12800;
    chip->io.mark_length_steps = 64;
    pins_set(pins, PORT_INDEX, BIT_INDEX, 0);
}

void motor_place(struct motor *motor, int64_t steps)
{
    motor->steps = motor->from = (double)steps;
    motor->stepped = motor->interval = 0;
    motor->matched = 0;
    motor_end(motor);
}

void motor_end(struct motor *motor)
{
    motor->chip->io.drum_steps = (int64_t)floor(motor->steps);
    motor->chip->io.drum_place = position(motor);
}
