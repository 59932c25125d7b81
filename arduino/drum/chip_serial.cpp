// USART0 at 115200 baud, 8N1: a ring each way, so that no caller waits.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "chip.h"
#include "drum_map.h"
#include "isr_meter.h"
#include "variant.h"

namespace {

constexpr uint8_t RECEIVE_SIZE = 128;
constexpr uint16_t SEND_SIZE = 512;
constexpr uint16_t DIVISOR = (board::CLOCK_HZ + BAUD * 4) / (BAUD * 8) - 1;

uint8_t received[RECEIVE_SIZE];
volatile uint8_t receive_head, receive_tail;
volatile bool damaged;
uint8_t sending[SEND_SIZE];
volatile uint16_t send_head, send_tail;

}  // namespace

// A byte has come: into the ring. 126 cycles, 8 µs.
ISR(USART0_RX_vect) {
    const IsrMeter meter;
    const uint8_t status = UCSR0A;
    const uint8_t byte = UDR0;
    const uint8_t after = (receive_head + 1) % RECEIVE_SIZE;
    if (status & (_BV(FE0) | _BV(DOR0)) || after == receive_tail) damaged = true;
    if (after == receive_tail) return;
    received[receive_head] = byte;
    receive_head = after;
}

// The transmitter has room: the next byte, or silence. 117 cycles, 7 µs.
ISR(USART0_UDRE_vect) {
    const IsrMeter meter;
    const uint16_t at = send_tail;
    if (at == send_head) {
        UCSR0B &= ~_BV(UDRIE0);
        return;
    }
    UDR0 = sending[at];
    send_tail = (at + 1) % SEND_SIZE;
}

namespace serial {

void begin() {
    UCSR0A = _BV(U2X0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UBRR0 = DIVISOR;
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
}

bool available() { return receive_head != receive_tail; }

Received take() {
    Received result;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        result.damaged = damaged;
        damaged = false;
    }
    result.byte = received[receive_tail];
    receive_tail = (receive_tail + 1) % RECEIVE_SIZE;
    return result;
}

// A reply that does not fit behind the bytes still to send is dropped completely.
void send(const uint8_t *bytes, uint16_t count) {
    uint16_t tail;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { tail = send_tail; }
    uint16_t head = send_head;
    const uint16_t used = (head + SEND_SIZE - tail) % SEND_SIZE;
    if (used + count >= SEND_SIZE) return;
    for (uint16_t i = 0; i < count; ++i) {
        sending[head] = bytes[i];
        head = (head + 1) % SEND_SIZE;
    }
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        send_head = head;
        UCSR0B |= _BV(UDRIE0);
    }
}

}  // namespace serial
