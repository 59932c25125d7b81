/* The actuator's bridge: the duty of the PWM registers, averaged over a slice. */
#include "bridge.h"

#include "avr_timer.h"

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

static double bridge_duty(const struct bridge *bridge)
{
    const uint8_t *data = bridge->chip->avr->data;
    if (!bridge->pins->out_level[SIM_OUT_BRIDGE] || !BIT(data[DDRH], 5)) return 0;
    return half_duty(data, 6, OCR4AL, PRESS_BIT) - half_duty(data, 4, OCR4BL, LIFT_BIT);
}

/* Integrate the duty up to now, then read the present duty. */
void bridge_changed(struct bridge *bridge)
{
    uint64_t now = bridge->chip->avr->cycle;
    bridge->sum += bridge->duty * (double)(now - bridge->since);
    bridge->since = now;
    bridge->duty = bridge_duty(bridge);
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

void bridge_open(struct bridge *bridge, struct chip *chip, const struct pins *pins)
{
    bridge->chip = chip;
    bridge->pins = pins;
    avr_irq_t *timer = avr_io_getirq(chip->avr, AVR_IOCTL_TIMER_GETIRQ('4'), 0);
    avr_irq_t *port = avr_io_getirq(chip->avr, AVR_IOCTL_IOPORT_GETIRQ('H'), IOPORT_IRQ_REG_PORT);
    avr_irq_register_notify(timer + TIMER_IRQ_OUT_PWM0, on_bridge_change, bridge);
    avr_irq_register_notify(timer + TIMER_IRQ_OUT_PWM1, on_bridge_change, bridge);
    avr_irq_register_notify(port, on_bridge_change, bridge);
    avr_register_io_write(chip->avr, TCCR4A, on_bridge_write, bridge);
}

void bridge_begin(struct bridge *bridge)
{
    bridge->sum = 0;
    bridge->since = bridge->chip->avr->cycle;
}

void bridge_end(struct bridge *bridge)
{
    uint64_t length = bridge->chip->avr->cycle - bridge->chip->slice_start;
    bridge_changed(bridge);
    bridge->chip->io.drive = length ? bridge->sum / (double)length : bridge->duty;
}
