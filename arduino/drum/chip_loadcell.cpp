// HX711: DOUT falls when a conversion is ready; 24 clocks shift it out, one more chooses
// channel A at gain 128 for the next.
//
// A clock that stays high for 60 µs powers the amplifier down, so interrupts are
// off while it is clocked: twice 6 µs, with a gap between the halves in which pending interrupts
// are served. A read takes 13 µs, and the two longest interrupts fit into its gap.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "chip.h"
#include "isr_meter.h"
#include "variant.h"

#pragma GCC optimize("O2")  // also where the IDE builds for size

namespace {

volatile bool offered;
volatile uint32_t offered_us;
uint8_t low_looks;

__attribute__((always_inline)) inline bool data() { return PIND & pins::LOADCELL_DATA; }

constexpr uint8_t CLOCK_BIT = __builtin_ctz(pins::LOADCELL_CLOCK);
constexpr uint8_t DATA_BIT = __builtin_ctz(pins::LOADCELL_DATA);

// Twelve bits of eight cycles each, 250 ns high and 250 ns low; the amplifier needs 200 ns. A bit is
// valid from 100 ns after the rise to the next rise and is read after the fall.
inline uint16_t shift_half() {
    uint16_t bits = 0;
    asm volatile(
        ".rept 12\n\t"
        "sbi %[port], %[clock]\n\t"
        "lsl %A[bits]\n\t"
        "rol %B[bits]\n\t"
        "cbi %[port], %[clock]\n\t"
        "sbic %[pin], %[data]\n\t"
        "ori %A[bits], 1\n\t"
        ".endr"
        : [bits] "+d"(bits)
        : [port] "I"(_SFR_IO_ADDR(PORTE)), [clock] "I"(CLOCK_BIT),
          [pin] "I"(_SFR_IO_ADDR(PIND)), [data] "I"(DATA_BIT));
    return bits;
}

inline void gain_pulse() {
    PORTE |= pins::LOADCELL_CLOCK;
    __builtin_avr_delay_cycles(2);
    PORTE &= ~pins::LOADCELL_CLOCK;
}

inline void listen() {
    EIFR = _BV(INTF2);
    EIMSK |= _BV(INT2);
}

}  // namespace

// A conversion is ready: its time, and silence until it is read. 171 cycles, 11 µs.
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

// Low for two ticks without an edge: it fell before the interrupt was on.
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
    cli();
    const uint16_t high = shift_half();
    sei();
    asm volatile("nop\n\tnop");  // pending interrupts are served after the first instruction
    cli();
    const uint16_t low = shift_half();
    gain_pulse();
    sei();
    Conversion conversion;
    conversion.in_step = data();
    const uint32_t bits = static_cast<uint32_t>(high) << 12 | low;
    conversion.raw = static_cast<int32_t>(bits << 8) >> 8;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        conversion.ready_us = offered_us;
        offered = false;
        listen();
    }
    return conversion;
}

}  // namespace amplifier
