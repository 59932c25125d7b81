/* The board's cable: each byte takes its real time in both directions. */
#include "serial.h"

#define BITS_PER_BYTE 10 /* 8N1; simavr counts 11 */
#define QUEUE (SIM_MAX_BYTES * 2)

/* avr_uart.c sets cycles_per_byte on each write of UBRRnL; correct it before each use. */
static uint64_t byte_cycles(struct serial *serial)
{
    avr_uart_t *uart = serial->uart;
    const uint8_t *data = serial->chip->avr->data;
    uint32_t divisor = data[uart->ubrrl.reg] | (uint32_t)(data[uart->ubrrh.reg] & 0x0f) << 8;
    uint32_t per_bit = (divisor + 1) * ((data[uart->u2x.reg] >> uart->u2x.bit) & 1 ? 8 : 16);
    uart->cycles_per_byte = per_bit * BITS_PER_BYTE;
    return uart->cycles_per_byte;
}

/* A byte that the host sends at another rate arrives as some other byte. The framing errors that a chip
 * would often see as well are not simulated, nor what the host makes of the chip's bytes. */
static uint8_t at_rate(struct serial *serial, uint8_t byte)
{
    int64_t chip = (int64_t)byte_cycles(serial) << 16, host = serial->chip->io.host_byte_q16;
    int64_t difference = chip > host ? chip - host : host - chip;
    return host && difference > host / 20 ? (uint8_t)(byte << 1) ^ 0xa5 : byte;
}

static void on_byte(avr_irq_t *irq, uint32_t value, void *param)
{
    struct serial *serial = param;
    sim_io *io = &serial->chip->io;
    uint64_t now = serial->chip->avr->cycle, begin = now > serial->wire_free ? now : serial->wire_free;
    (void)irq;
    serial->wire_free = begin + byte_cycles(serial);
    if (io->tx_count == SIM_MAX_BYTES) {
        io->overflows++;
        return;
    }
    io->tx_cycle[io->tx_count] = serial->wire_free;
    io->tx[io->tx_count++] = value;
}

static void on_room(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)value;
    ((struct serial *)param)->full = 0;
}

static void on_full(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    ((struct serial *)param)->full = value != 0;
}

static void on_received(avr_irq_t *irq, uint32_t value, void *param)
{
    struct serial *serial = param;
    (void)irq;
    if (value && !serial->rx_raised) serial->rx_raised = serial->chip->avr->cycle;
}

static void on_fetched(avr_irq_t *irq, uint32_t value, void *param)
{
    struct serial *serial = param;
    (void)irq;
    if (!value || !serial->rx_raised) return;
    uint64_t waited = serial->chip->avr->cycle - serial->rx_raised;
    serial->rx_raised = 0;
    if (waited > serial->chip->io.rx_latency) serial->chip->io.rx_latency = waited;
}

void serial_open(struct serial *serial, struct chip *chip)
{
    avr_t *avr = chip->avr;
    serial->chip = chip;
    uint32_t flags = 0; /* do not sleep when polled, do not print lines */
    serial->uart = (avr_uart_t *)find_io(avr, "uart"); /* the four of the 2560 are adjacent */
    while (serial->uart->name != '0') serial->uart = (avr_uart_t *)serial->uart->io.next;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_t *irq = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), 0);
    serial->input = irq + UART_IRQ_INPUT;
    avr_irq_register_notify(irq + UART_IRQ_OUTPUT, on_byte, serial);
    avr_irq_register_notify(irq + UART_IRQ_OUT_XON, on_room, serial);
    avr_irq_register_notify(irq + UART_IRQ_OUT_XOFF, on_full, serial);
    avr_irq_register_notify(serial->uart->rxc.irq + AVR_INT_IRQ_PENDING, on_received, serial);
    avr_irq_register_notify(serial->uart->rxc.irq + AVR_INT_IRQ_RUNNING, on_fetched, serial);
}

void serial_restore(struct serial *serial)
{
    serial->full = 0;
    serial->rx_raised = 0;
    serial->wire_free = serial->chip->avr->cycle;
}

void serial_begin(struct serial *serial)
{
    sim_io *io = &serial->chip->io;
    uint64_t now = serial->chip->avr->cycle, from = io->rx_start > now ? io->rx_start : now;
    if (serial->head == serial->tail && serial->next_q16 < from << 16) serial->next_q16 = from << 16;
    for (int i = 0; i < io->rx_count; i++) {
        if ((serial->tail + 1) % QUEUE == serial->head) io->overflows++;
        else serial->queue[serial->tail] = io->rx[i], serial->tail = (serial->tail + 1) % QUEUE;
    }
    io->rx_count = 0;
}

uint64_t serial_next(const struct serial *serial)
{
    return serial->head == serial->tail ? NEVER : (serial->next_q16 + 0xffff) >> 16;
}

/* Pass due bytes to the chip; a byte that arrives while the receiver is full is lost. */
void serial_run(struct serial *serial, uint64_t now)
{
    while (serial->head != serial->tail && serial->next_q16 <= now << 16) {
        uint8_t byte = serial->queue[serial->head];
        serial->head = (serial->head + 1) % QUEUE;
        byte = at_rate(serial, byte);
        if (serial->full) serial->chip->io.rx_overruns++;
        else avr_raise_irq(serial->input, byte);
        serial->next_q16 += serial->chip->io.host_byte_q16;
    }
}
