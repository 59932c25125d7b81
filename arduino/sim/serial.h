/* The serial cable between host and chip. */
#ifndef RIGCTL_SIM_SERIAL_H
#define RIGCTL_SIM_SERIAL_H

#include "avr_uart.h"
#include "chip.h"

struct serial {
    struct chip *chip;
    avr_uart_t *uart;
    avr_irq_t *input;
    uint8_t queue[SIM_MAX_BYTES * 2]; /* bytes from the host that are not on the wire yet */
    uint32_t head, tail;
    uint64_t next_q16;   /* cycle × 65536 at which the next byte may begin */
    uint64_t wire_free;  /* cycle at which the last byte sent is complete */
    uint64_t rx_raised;  /* cycle at which a received byte raised its interrupt, 0: none */
    int full;            /* the chip's receiver has no room */
};

void serial_open(struct serial *serial, struct chip *chip);
void serial_begin(struct serial *serial);
void serial_restore(struct serial *serial);
uint64_t serial_next(const struct serial *serial);
void serial_run(struct serial *serial, uint64_t now);

#endif
