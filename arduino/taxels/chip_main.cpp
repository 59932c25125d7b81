// The main loop: waits for a frame, kicks the watchdog, has the brain talk. Interrupts do the rest.
#include <avr/interrupt.h>
#include <avr/sleep.h>

#include "chip.h"
#include "chip_reset.h"
#include "plan.h"
#include "ports.h"
#include "talk.h"

namespace {

constexpr uint8_t SPIN_CYCLES = 8;
constexpr uint8_t LOOK_BYTES = 32;  // of the stack, a frame

uint16_t idle;
Talk talk;

// One frame in a hundred the wait is counted instead of slept: 8 cycles a turn of the loop,
// interrupts excluded because they stop the counting.
uint16_t spin_until_closed() {
    uint16_t turns = 0;
    __asm__ volatile(
        "1:  lds __tmp_reg__, %1\n"
        "    tst __tmp_reg__\n"
        "    brne 2f\n"
        "    adiw %0, 1\n"
        "    rjmp 1b\n"
        "2:\n"
        : "+w"(turns)
        : "i"(&sampling::frame_closed));
    return turns;
}

void sleep_until_closed() {
    for (;;) {
        cli();
        if (sampling::frame_closed) break;
        sleep_enable();
        sei();  // takes effect after the next instruction, so no interrupt slips in between
        sleep_cpu();
        sleep_disable();
    }
    sei();
}

void wait_for_frame() {
    if (talk.status_comes()) {
        uint32_t idle_cycles = uint32_t(spin_until_closed()) * SPIN_CYCLES;
        idle = uint16_t(idle_cycles * 1000 / (uint32_t(SLOTS) * SLOT_CYCLES));
    } else {
        sleep_until_closed();
    }
}

}  // namespace

uint16_t idle_permille() {
    return idle;
}

int main() {
    const uint16_t boots = boot::count();
    stack::begin();
    serial::begin();
    sampling::begin();
    set_sleep_mode(SLEEP_MODE_IDLE);
    reset::watch();
    sei();
    talk.begin(boots);
    for (;;) {
        wait_for_frame();
        reset::kick();
        talk.take(sampling::take_frame());
        stack::look(LOOK_BYTES);
    }
}
