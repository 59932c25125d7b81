/* The board's cable: each byte takes its real time in both directions. */
#include "board.h"

#define BITS_PER_BYTE 10 /* 8N1; simavr counts 11 */
#define QUEUE (SIM_MAX_BYTES * 2)

/* avr_uart.c sets cycles_per_byte on each write of UBRRnL; correct it before each use. */
static uint64_t byte_cycles(sim_board *board)
{
    avr_uart_t *uart = board->serial.uart;
    const uint8_t *data = board->avr->data;
    uint32_t divisor = data[uart->ubrrl.reg] | (uint32_t)(data[uart->ubrrh.reg] & 0x0f) << 8;
    uint32_t per_bit = (divisor + 1) * ((data[uart->u2x.reg] >> uart->u2x.bit) & 1 ? 8 : 16);
    uart->cycles_per_byte = per_bit * BITS_PER_BYTE;
    return uart->cycles_per_byte;
}

static void on_byte(avr_irq_t *irq, uint32_t value, void *param)
{
    sim_board *board = param;
    sim_io *io = &board->io;
    struct serial *s = &board->serial;
    uint64_t now = board->avr->cycle, begin = now > s->wire_free ? now : s->wire_free;
    (void)irq;
    s->wire_free = begin + byte_cycles(board);
    if (io->tx_count == SIM_MAX_BYTES) {
        io->overflows++;
        return;
    }
    io->tx_cycle[io->tx_count] = s->wire_free;
    io->tx[io->tx_count++] = value;
}

static void on_room(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)value;
    ((sim_board *)param)->serial.full = 0;
}

static void on_full(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    ((sim_board *)param)->serial.full = value != 0;
}

static void on_received(avr_irq_t *irq, uint32_t value, void *param)
{
    sim_board *board = param;
    (void)irq;
    if (value && !board->serial.rx_raised) board->serial.rx_raised = board->avr->cycle;
}

static void on_fetched(avr_irq_t *irq, uint32_t value, void *param)
{
    sim_board *board = param;
    struct serial *s = &board->serial;
    (void)irq;
    if (!value || !s->rx_raised) return;
    uint64_t waited = board->avr->cycle - s->rx_raised;
    s->rx_raised = 0;
    if (waited > board->io.rx_latency) board->io.rx_latency = waited;
}

void serial_open(sim_board *board)
{
    avr_t *avr = board->avr;
    struct serial *s = &board->serial;
    uint32_t flags = 0; /* do not sleep when polled, do not print lines */
    s->uart = (avr_uart_t *)find_io(avr, "uart"); /* the four of the 2560 are adjacent */
    while (s->uart->name != '0') s->uart = (avr_uart_t *)s->uart->io.next;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_t *irq = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), 0);
    s->input = irq + UART_IRQ_INPUT;
    avr_irq_register_notify(irq + UART_IRQ_OUTPUT, on_byte, board);
    avr_irq_register_notify(irq + UART_IRQ_OUT_XON, on_room, board);
    avr_irq_register_notify(irq + UART_IRQ_OUT_XOFF, on_full, board);
    avr_irq_register_notify(s->uart->rxc.irq + AVR_INT_IRQ_PENDING, on_received, board);
    avr_irq_register_notify(s->uart->rxc.irq + AVR_INT_IRQ_RUNNING, on_fetched, board);
}

void serial_restore(sim_board *board)
{
    board->serial.full = 0;
    board->serial.rx_raised = 0;
    board->serial.wire_free = board->avr->cycle;
}

void serial_begin(sim_board *board)
{
    struct serial *s = &board->serial;
    sim_io *io = &board->io;
    uint64_t now = board->avr->cycle, from = io->rx_start > now ? io->rx_start : now;
    if (s->head == s->tail && s->next_q16 < from << 16) s->next_q16 = from << 16;
    for (int i = 0; i < io->rx_count; i++) {
        if ((s->tail + 1) % QUEUE == s->head) io->overflows++;
        else s->queue[s->tail] = io->rx[i], s->tail = (s->tail + 1) % QUEUE;
    }
    io->rx_count = 0;
}

uint64_t serial_next(const sim_board *board)
{
    const struct serial *s = &board->serial;
    return s->head == s->tail ? NEVER : (s->next_q16 + 0xffff) >> 16;
}

/* Pass due bytes to the chip; a byte that arrives while the receiver is full is lost. */
void serial_run(sim_board *board, uint64_t now)
{
    struct serial *s = &board->serial;
    while (s->head != s->tail && s->next_q16 <= now << 16) {
        uint8_t byte = s->queue[s->head];
        s->head = (s->head + 1) % QUEUE;
        byte_cycles(board);
        if (s->full) board->io.rx_overruns++;
        else avr_raise_irq(s->input, byte);
        s->next_q16 += board->io.host_byte_q16;
    }
}
