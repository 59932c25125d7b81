// Drum controller of the rig: an ATmega2560 that turns the drum, holds the contact force and
// answers Modbus. This file only joins the parts; it opens in the Arduino IDE, whose main() and
// timers are not used because main() is defined here.
//
// Interrupts handle a step, a byte or a time stamp and wake the loop below, which does the rest:
//
//     ISR step    → next pulse            ISR byte    → rings of chip_serial
//     ISR ready   → amplifier::ready      ISR tick    → clock::take_ticks
//     ISR e-stop  → outputs off           ISR index   → position of the mark
#include <avr/interrupt.h>
#include <avr/io.h>

#include "chip.h"
#include "drum.h"
#include "variant.h"

static Drum drum;
static uint16_t unsent;  // length of a reply that waits to be sent

static void begin_all() {
    serial::begin();  // first: bytes may come already
    store::begin();
    stepper::begin();
    bridge::begin();
    estop::begin();
    amplifier::begin();
    clock::begin();
    sei();
    health::begin();
    drum.boot(health::watchdog_reset());
}

static void run_tick() {
    bridge::start_reading();
    amplifier::look();
    store::tick();
    Inputs inputs;
    inputs.now_ms = clock::now_ms();
    inputs.position_um = bridge::position_um();
    inputs.position_raw = bridge::position_raw();
    inputs.estop_open = estop::take();
    inputs.end_up = bridge::end_up();
    inputs.end_down = bridge::end_down();
    inputs.index_high = stepper::index_high();
    drum.modbus().tick();
    drum.tick(inputs);
    if (stepper::breathing()) health::kick();
}

static void run_serial() {
    const serial::Received received = serial::take();
    if (received.damaged) drum.modbus().poison();
    unsent = drum.modbus().take(received.byte);
}

static void send_reply() {
    serial::send(drum.modbus().reply(), unsent);
    unsent = 0;
}

static inline bool idle() {
    return !clock::pending() && !amplifier::ready() && !drum.control_due() && !drum.watch_due() &&
           !unsent && !serial::available();
}

int main() {
    begin_all();
    for (;;) {
        // Most interrupts, for example each step, leave no work for this loop.
        cli();
        while (idle()) health::sleep_until_interrupt();
        sei();
        const uint8_t ticks = clock::take_ticks();
        if (ticks > 1) health::count_late(ticks - 1);
        for (uint8_t i = 0; i < ticks; ++i) run_tick();
        // One task a round, so that a tick waits for the longest task at most.
        if (ticks) continue;
        if (amplifier::ready()) drum.sample(amplifier::read());
        else if (drum.control_due()) drum.control_force();
        else if (drum.watch_due()) drum.watch_force();
        else if (unsent) send_reply();
        else if (serial::available()) run_serial();
    }
}
