// HX711: DOUT falls when a conversion is ready; 24 clocks shift it out, one more chooses
// channel A at gain 128 for the next.
//
// A clock that stays high for 60 µs powers the amplifier down, so interrupts are off around
// each high phase, a quarter of a microsecond, and only there. A read takes about 25 µs by itself.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "chip.h"
#include "chip_pins.h"
#include "isr_meter.h"

#pragma GCC optimize("O2")  // also where the IDE builds for size

namespace {

volatile bool offered;
volatile uint32_t offered_us;
uint8_t low_looks;

__attribute__((always_inline)) inline bool data() { return PIND & pins::LOADCELL_DATA; }

// 250 ns high: the amplifier wants 200 ns at least.
__attribute__((always_inline)) inline void pulse() {
    cli();
    PORTE |= pins::LOADCELL_CLOCK;
    __builtin_avr_delay_cycles(2);
    PORTE &= ~pins::LOADCELL_CLOCK;
    sei();
}

__attribute__((always_inline)) inline void shift_bit(uint8_t &byte) {
    pulse();
    byte <<= 1;
    if (data()) byte |= 1;
}

// Written out: a loop would take a quarter longer.
inline uint8_t shift_byte() {
    uint8_t byte = 0;
    shift_bit(byte);
    shift_bit(byte);
    shift_bit(byte);
    shift_bit(byte);
    shift_bit(byte);
    shift_bit(byte);
    shift_bit(byte);
    shift_bit(byte);
    return byte;
}

inline void listen() {
    EIFR = _BV(INTF2);
    EIMSK |= _BV(INT2);
}

}  // namespace

ISR(INT2_vect) {
    const IsrMeter meter;
    EIMSK &= ~_BV(INT2);
    offered_us = clock::micros_in_isr();
    offered = true;
}

namespace amplifier {

void begin() {
    PORTE &= ~pins::LOADCELL_CLOCK;
    DDRE |= pins::LOADCELL_CLOCK;
    PORTD |= pins::LOADCELL_DATA;
    EICRA = (EICRA & ~_BV(ISC20)) | _BV(ISC21);
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { listen(); }
}

// Low for two ticks without an edge: it fell while nobody listened.
void look() {
    low_looks = offered || data() ? 0 : low_looks + 1;
    if (low_looks < 2) return;
    low_looks = 0;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (!offered) {
            EIMSK &= ~_BV(INT2);
            offered_us = clock::micros_in_isr();
            offered = true;
        }
    }
}

bool ready() { return offered; }

Conversion read() {
    const uint8_t high = shift_byte(), middle = shift_byte(), low = shift_byte();
    pulse();
    Conversion conversion;
    conversion.in_step = data();
    const uint32_t bits = static_cast<uint32_t>(high) << 16 | static_cast<uint16_t>(middle << 8 | low);
    conversion.raw = static_cast<int32_t>(bits << 8) >> 8;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        conversion.ready_us = offered_us;
        offered = false;
        listen();
    }
    return conversion;
}

}  // namespace amplifier
