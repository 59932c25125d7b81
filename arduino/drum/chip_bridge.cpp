// Timer 4: the actuator's H-bridge at 4 kHz; ADC0: its potentiometer; its end switches.
#include <avr/io.h>
#include <util/atomic.h>

#include "chip.h"
#include "ports.h"
#include "potentiometer.h"
#include "steady_level.h"
#include "variant.h"

namespace {

constexpr uint16_t TOP = 3999;  // 16 MHz / 4000 = 4 kHz, four counts a permille
constexpr uint8_t FAST_PWM_A = _BV(WGM41);
constexpr uint8_t ADC_CONTROL = _BV(ADEN) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);

Potentiometer potentiometer;
uint8_t ends;  // levels of the end switches, as last read

}  // namespace

namespace bridge {

void begin() {
    PORTH &= ~(pins::PRESS | pins::LIFT | pins::BRIDGE_ON);
    DDRH |= pins::PRESS | pins::LIFT | pins::BRIDGE_ON;
    PORTC |= pins::END_UP | pins::END_DOWN;
    ICR4 = TOP;
    TCCR4A = FAST_PWM_A;
    TCCR4B = _BV(WGM43) | _BV(WGM42) | _BV(CS40);
    ADMUX = _BV(REFS0);
    DIDR0 = _BV(ADC0D);
    ADCSRA = ADC_CONTROL | _BV(ADSC);
}

void cut() {
    PORTH &= ~(pins::PRESS | pins::LIFT | pins::BRIDGE_ON);
    TCCR4A = FAST_PWM_A;
}

void start_reading() {
    ends = steady_level(PINC, pins::END_UP | pins::END_DOWN, ends);
    if (ADCSRA & _BV(ADSC)) return;
    potentiometer.take(ADC);
    ADCSRA = ADC_CONTROL | _BV(ADSC);
}

uint16_t position_um() { return potentiometer.position_um(); }
uint16_t position_raw() { return potentiometer.raw(); }

bool end_up() { return ends & pins::END_UP; }
bool end_down() { return ends & pins::END_DOWN; }

}  // namespace bridge

namespace ports {

void enable_bridge(bool on) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (on && !estop::tripped()) PORTH |= pins::BRIDGE_ON;
        else bridge::cut();
    }
}

// A half bridge at rest is disconnected from the timer, so that it stays low without a spike.
void drive(int16_t permille) {
    const uint16_t counts = static_cast<uint16_t>(permille < 0 ? -permille : permille) * 4;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (!counts || estop::tripped()) {
            TCCR4A = FAST_PWM_A;
        } else if (permille > 0) {
            OCR4A = counts - 1;
            TCCR4A = FAST_PWM_A | _BV(COM4A1);
        } else {
            OCR4B = counts - 1;
            TCCR4A = FAST_PWM_A | _BV(COM4B1);
        }
    }
}

}  // namespace ports
