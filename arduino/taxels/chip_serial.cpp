// The serial line: a transmit ring for three frames, a small receive ring, both by interrupt.
#include <avr/interrupt.h>
#include <avr/io.h>

#include "chip.h"
#include "plan.h"
#include "ports.h"

namespace {

constexpr uint8_t TX_SIZE = 128;  // three data frames of 33 bytes, and no room for a fourth
constexpr uint8_t TX_MASK = TX_SIZE - 1;
constexpr uint8_t RX_MASK = 31;
constexpr uint8_t LISTEN = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);

uint8_t tx_ring[TX_SIZE];
volatile uint8_t tx_head, tx_tail;
uint8_t rx_ring[RX_MASK + 1];
volatile uint8_t rx_head, rx_tail;

}  // namespace

// 33 times a millisecond: one byte into the shift register, off when the ring is empty. 59 cycles,
// 4 µs.
ISR(USART_UDRE_vect) {
    uint8_t tail = tx_tail;
    UDR0 = tx_ring[tail];
    tail = (tail + 1) & TX_MASK;
    tx_tail = tail;
    if (tail == tx_head) UCSR0B = LISTEN;
}

// A byte has come: into the ring, whose oldest it replaces where it is full. 52 cycles, 3 µs.
ISR(USART_RX_vect) {
    uint8_t head = rx_head;
    rx_ring[head] = UDR0;
    rx_head = (head + 1) & RX_MASK;
}

namespace serial {

void begin() {
    UCSR0A = _BV(U2X0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UBRR0H = 0;
    UBRR0L = UBRR_VALUE;
    UCSR0B = LISTEN;
}

}  // namespace serial

bool serial_send(const uint8_t *bytes, uint8_t size, uint8_t kept_free) {
    uint8_t head = tx_head;
    if (((tx_tail - head - 1) & TX_MASK) < size + kept_free) return false;
    for (; size; size--) {
        tx_ring[head] = *bytes++;
        head = (head + 1) & TX_MASK;
    }
    tx_head = head;
    UCSR0B = LISTEN | _BV(UDRIE0);
    return true;
}

bool serial_receive(uint8_t &byte) {
    uint8_t tail = rx_tail;
    if (tail == rx_head) return false;
    byte = rx_ring[tail];
    rx_tail = (tail + 1) & RX_MASK;
    return true;
}
