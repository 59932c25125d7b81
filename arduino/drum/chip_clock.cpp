// Timer 3: a tick each millisecond, and the microseconds in between.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "chip.h"
#include "chip_reset.h"
#include "isr_meter.h"
#include "ports.h"

namespace {

constexpr uint16_t COUNTS_PER_MS = 2000;  // 16 MHz / 8

volatile uint32_t milliseconds;
volatile uint32_t whole_us;  // the same times 1000, kept apart because interrupts read it
volatile uint8_t ticks;

}  // namespace

// Each millisecond: counts the time, and looks at the stop. 161 cycles, 10 µs.
ISR(TIMER3_COMPA_vect) {
    const IsrMeter meter;
    milliseconds = milliseconds + 1;
    whole_us = whole_us + 1000;
    ticks = ticks + 1;
    reset::count_ms_in_isr();
    estop::check_in_isr();
}

namespace clock {

void begin() {
    OCR3A = COUNTS_PER_MS - 1;
    TCCR3A = 0;
    TCCR3B = _BV(WGM32) | _BV(CS31);
    TIMSK3 = _BV(OCIE3A);
}

uint8_t take_ticks() {
    uint8_t taken;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        taken = ticks;
        ticks = 0;
    }
    return taken;
}

bool pending() { return ticks != 0; }

uint32_t now_ms() {
    uint32_t now;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { now = milliseconds; }
    return now;
}

// The counter may have wrapped while its interrupt still waits.
uint32_t micros_in_isr() {
    uint32_t whole = whole_us;
    uint16_t counts = TCNT3;
    if ((TIFR3 & _BV(OCF3A)) && counts < COUNTS_PER_MS / 2) whole += 1000;
    return whole + counts / 2;
}

}  // namespace clock

namespace ports {

uint32_t now_us() {
    uint32_t now;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { now = clock::micros_in_isr(); }
    return now;
}

}  // namespace ports
