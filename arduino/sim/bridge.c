/* The actuator's bridge: the duty of the PWM registers, averaged over a slice. */
#include "board.h"

/* Timer 4 of the 2560, whose compare pins PH3 and PH4 drive the bridge. */
enum {
    TCCR4A = 0xa0, TCCR4B = 0xa1, ICR4L = 0xa6, OCR4AL = 0xa8, OCR4BL = 0xaa,
    DDRH = 0x101, PORTH = 0x102, PRESS_BIT = 3, LIFT_BIT = 4,
};

static unsigned timer4_top(const uint8_t *data)
{
    static const unsigned FIXED[4] = {0xffff, 0xff, 0x1ff, 0x3ff};
    if (data[TCCR4B] & 0x10) return data[ICR4L] | data[ICR4L + 1] << 8; /* WGM43 */
    return FIXED[data[TCCR4A] & 3];
}

/* Share of time for which a half bridge is on, by compare output or by port bit. */
static double half_duty(const uint8_t *data, int com_shift, int ocr, int bit)
{
    if (!BIT(data[DDRH], bit)) return 0;
    if (BIT(data[TCCR4A], com_shift + 1) == 0) return BIT(data[PORTH], bit);
    unsigned top = timer4_top(data), on = data[ocr] | data[ocr + 1] << 8;
    /* Fast PWM: high for one count more than the register, of one count more than the top. */
    return top ? (on > top ? 1.0 : (on + 1.0) / (top + 1.0)) : 0;
}

static double bridge_duty(const sim_board *board)
{
    const uint8_t *data = board->avr->data;
    if (!board->pins.out_level[SIM_OUT_BRIDGE] || !BIT(data[DDRH], 5)) return 0;
    return half_duty(data, 6, OCR4AL, PRESS_BIT) - half_duty(data, 4, OCR4BL, LIFT_BIT);
}

/* Integrate the duty up to now, then read the present duty. */
void bridge_changed(sim_board *board)
{
    uint64_t now = board->avr->cycle;
    board->bridge.sum += board->bridge.duty * (double)(now - board->bridge.since);
    board->bridge.since = now;
    board->bridge.duty = bridge_duty(board);
}

static void on_bridge_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    (void)avr, (void)address, (void)value;
    bridge_changed(param);
}

static void on_bridge_change(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)value;
    bridge_changed(param);
}

void bridge_open(sim_board *board)
{
    avr_irq_t *timer = avr_io_getirq(board->avr, AVR_IOCTL_TIMER_GETIRQ('4'), 0);
    avr_irq_t *port = avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ('H'), IOPORT_IRQ_REG_PORT);
    avr_irq_register_notify(timer + TIMER_IRQ_OUT_PWM0, on_bridge_change, board);
    avr_irq_register_notify(timer + TIMER_IRQ_OUT_PWM1, on_bridge_change, board);
    avr_irq_register_notify(port, on_bridge_change, board);
    avr_register_io_write(board->avr, TCCR4A, on_bridge_write, board);
}

void bridge_begin(sim_board *board)
{
    board->bridge.sum = 0;
    board->bridge.since = board->avr->cycle;
}

void bridge_end(sim_board *board)
{
    uint64_t length = board->avr->cycle - board->slice_start;
    bridge_changed(board);
    board->io.drive = length ? board->bridge.sum / (double)length : board->bridge.duty;
}
