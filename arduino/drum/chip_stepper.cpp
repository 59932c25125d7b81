// Timer 1: step pulses by the output-compare pin OC1A.
//
// The compare match itself raises and lowers the pin, so an edge is exact to the cycle however
// late the interrupt comes; the interrupt only sets what the next match does:
//
//     match that raises the pin → step counted, sync line moved, fall set HIGH_CYCLES later
//     match that lowers the pin → interval of the next step taken, rise set for it
//     match that does nothing   → a wait longer than the timer, taken in pieces, the pin
//                                 meanwhile low by its port bit
//
// Intervals carry 8 bits of fraction, summed up, so the mean rate is exact to 0.5 ppm. The
// handler must be done before the next match, which is never nearer than HIGH_CYCLES.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "chip.h"
#include "isr_meter.h"
#include "ports.h"
#include "steady_level.h"
#include "variant.h"

#pragma GCC optimize("O2")  // also where the IDE builds for size

namespace {

constexpr uint16_t HIGH_CYCLES = 640;      // 40 µs; at 10,000 steps/s the low part is 60 µs
constexpr uint16_t LONGEST_WAIT = 0x7000;  // below half a round, so that late shows as negative
constexpr uint16_t PIECE = 0x4000;
constexpr uint16_t LATE_MARGIN = 40;       // cycles between setting a match and its coming
constexpr uint8_t PIN_TOGGLES = _BV(COM1A0);
constexpr uint8_t PIN_CLEARS = _BV(COM1A1);
constexpr uint8_t PIN_RESTS = 0;
constexpr uint8_t SILENT_TICKS = 10;       // longest wait between two matches is 2 ms

enum class Next : uint8_t { Rise, Fall, Wait };

StepEngine engine;
Next next;
uint32_t wait;      // cycles still to wait before the rise, after the present piece
uint8_t fraction;   // of a cycle, summed up over steps
volatile bool running;
ports::SyncLine sync_state;
volatile bool sync_fitted = true, sync_inverted, index_inverted;
volatile uint8_t index_level;
volatile uint16_t index_count;
int32_t index_position;

// A match set behind the counter would occur one timer period late.
inline void set_match(uint16_t at) {
    OCR1A = at;
    if (static_cast<int16_t>(at - TCNT1) < static_cast<int16_t>(LATE_MARGIN))
        OCR1A = TCNT1 + LATE_MARGIN;
}

inline void aim_at_rise(uint16_t from, uint32_t left) {
    if (left > LONGEST_WAIT) {
        wait = left - PIECE;
        next = Next::Wait;
        TCCR1A = PIN_RESTS;
        set_match(from + PIECE);
    } else {
        next = Next::Rise;
        TCCR1A = PIN_TOGGLES;
        set_match(from + static_cast<uint16_t>(left));
    }
}

inline void halt() {
    TIMSK1 = 0;
    TCCR1A = PIN_RESTS;
    running = false;
}

// Starts the next interval, of which `over` cycles have passed; the pin is low.
inline void schedule(uint16_t from, uint16_t over) {
    const uint32_t interval = engine.next_interval();
    if (!interval) return halt();
    const uint32_t exact = interval + fraction;
    fraction = static_cast<uint8_t>(exact);
    aim_at_rise(from, (exact >> 8) - over);
}

// An active-high driver has the opposite levels.
inline void put_enable(bool on) {
    if (on == board::STEPPER_ENABLE_HIGH) PORTA |= pins::STEPPER_ENABLE;
    else PORTA &= ~pins::STEPPER_ENABLE;
}

inline void show_sync(bool on) {
    if ((on && sync_fitted) != sync_inverted) PORTA |= pins::SYNC;
    else PORTA &= ~pins::SYNC;
}

inline void move_sync(Mark mark) {
    if (mark == Mark::None) return;
    const bool on = mark == Mark::SyncOn;
    show_sync(on);
    sync_state.high = on;
    if (on) {
        sync_state.rise_us = clock::micros_in_isr();
        ++sync_state.count;
    } else {
        sync_state.fall_us = clock::micros_in_isr();
    }
}

// The mark's wire by three looks. A spike calls the interrupt without a change.
inline bool index_changes() {
    const uint8_t now = steady_level(PINE, pins::INDEX, index_level);
    const bool changed = now != index_level;
    index_level = now;
    return changed;
}

}  // namespace

// A match of the step timer, see above. 394 cycles, 25 µs, where an interval of a ramp is computed.
ISR(TIMER1_COMPA_vect, __attribute__((flatten))) {
    const IsrMeter meter;
    const uint16_t now = OCR1A;
    switch (next) {
        case Next::Rise:
            next = Next::Fall;
            set_match(now + HIGH_CYCLES);
            move_sync(engine.count_step());
            break;
        case Next::Fall: schedule(now, HIGH_CYCLES); break;
        case Next::Wait: aim_at_rise(now, wait); break;
    }
}

// The mark's edges, by three looks; the leading one when going forwards is the trailing one
// backwards. 307 cycles, 19 µs.
ISR(INT4_vect) {
    const IsrMeter meter;
    if (!index_changes()) return;
    const bool at_mark = static_cast<bool>(index_level) != index_inverted;
    if (at_mark == engine.backwards()) return;
    index_position = engine.position();
    index_count = index_count + 1;
}

namespace stepper {

void begin() {
    put_enable(false);
    DDRA |= pins::DIRECTION | pins::STEPPER_ENABLE | pins::SYNC;
    DDRB |= pins::STEP;
    TCCR1A = PIN_RESTS;
    TCCR1B = _BV(CS10);
    EICRB = (EICRB & ~(_BV(ISC41) | _BV(ISC40))) | _BV(ISC40);
    index_changes();
    EIMSK |= _BV(INT4);
}

void cut() {
    halt();
    engine.abandon();
    PORTB &= ~pins::STEP;
    put_enable(false);
    show_sync(false);
    sync_state.high = false;
}

void wire_index(bool inverted) { index_inverted = inverted; }

bool index_high() { return index_level; }

void wire_sync(bool fitted, bool inverted) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        sync_fitted = fitted;
        sync_inverted = inverted;
        show_sync(sync_state.high);
    }
}

bool breathing() {
    static uint16_t last;
    static uint8_t silent;
    uint16_t aim = 0;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { aim = OCR1A; }
    const bool alive = !running || aim != last;
    last = aim;
    silent = alive ? 0 : silent + 1;
    return silent < SILENT_TICKS;
}

}  // namespace stepper

namespace ports {

void enable_stepper(bool on) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (on && !estop::tripped()) put_enable(true);
        else put_enable(false);
    }
}

// The first interval is milliseconds long: far more than a driver wants between the direction
// line and the first step. It is computed before interrupts are off: only the emergency stop may
// come between, and it is checked last.
void start(const Motion &motion) {
    if (motion.backwards) PORTA |= pins::DIRECTION;
    else PORTA &= ~pins::DIRECTION;
    engine.begin(motion);
    const uint32_t first = engine.next_interval();
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (!first || estop::tripped()) return engine.abandon();
        fraction = static_cast<uint8_t>(first);
        running = true;
        // A cut inside a pulse left the compare output high behind the port's back.
        TCCR1A = PIN_CLEARS;
        TCCR1C = _BV(FOC1A);
        TCCR1A = PIN_RESTS;
        TIFR1 = _BV(OCF1A);
        TIMSK1 = _BV(OCIE1A);
        aim_at_rise(TCNT1, first >> 8);
    }
}

void stop_gently() {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        engine.stop();
        if (sync_state.high) move_sync(Mark::SyncOff);
    }
}

void stop_at_once() {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        halt();
        engine.abandon();
        if (sync_state.high) move_sync(Mark::SyncOff);
    }
}

bool moving() { return running; }

bool at_speed() {
    bool result = false;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { result = running && engine.at_speed(); }
    return result;
}

uint32_t step_interval() {
    uint32_t result = 0;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { result = running ? engine.interval() : 0; }
    return result;
}

int32_t position() {
    int32_t result = 0;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { result = engine.position(); }
    return result;
}

void shift_position(int32_t by) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { engine.set_position(engine.position() + by); }
}

SyncLine sync_line() {
    SyncLine result = {0, 0, 0, false};
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { result = sync_state; }
    return result;
}

IndexMark index_mark() {
    IndexMark result = {0, 0};
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        result.position = index_position;
        result.count = index_count;
    }
    return result;
}

}  // namespace ports
