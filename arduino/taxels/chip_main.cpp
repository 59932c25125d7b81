// The main loop: packs a frame, sends it, hears the host, and sleeps. Interrupts do the rest.
#include <avr/interrupt.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "board.h"
#include "chip_boot.h"
#include "chip_sampling.h"
#include "chip_serial.h"
#include "request.h"
#include "wire.h"

namespace {

const uint8_t SPIN_CYCLES = 8;

uint16_t boots;
uint16_t idle_permille;
uint32_t ring_full;     // frames that found no room in the ring
bool identity_due = true;
bool status_due, test_running;
uint8_t since_status;
RequestParser parser;

uint32_t dropped() { return ring_full + missed_frames(); }

// One frame in a hundred the wait is counted instead of slept: 8 cycles a turn of the loop,
// interrupts excluded because they stop the counting.
uint16_t spin_until_closed()
{
    uint16_t turns = 0;
    __asm__ volatile(
        "1:  lds __tmp_reg__, %1\n"
        "    tst __tmp_reg__\n"
        "    brne 2f\n"
        "    adiw %0, 1\n"
        "    rjmp 1b\n"
        "2:\n"
        : "+w"(turns)
        : "i"(&frame_closed));
    return turns;
}

void sleep_until_closed()
{
    for (;;) {
        cli();
        if (frame_closed) break;
        sleep_enable();
        sei();  // takes effect after the next instruction, so no interrupt slips in between
        sleep_cpu();
        sleep_disable();
    }
    sei();
}

void wait_for_frame()
{
    if (since_status == STATUS_EVERY - 1) {
        uint32_t idle_cycles = uint32_t(spin_until_closed()) * SPIN_CYCLES;
        idle_permille = uint16_t(idle_cycles * 1000 / (uint32_t(SLOTS) * SLOT_CYCLES));
    } else {
        sleep_until_closed();
    }
}

void send_data()
{
    uint8_t wire[WIRE_MAX];
    uint8_t size = write_data(take_frame(), dropped(), wire);
    if (!serial_send(wire, size)) ring_full++;
    if (++since_status == STATUS_EVERY) {
        since_status = 0;
        status_due = true;
    }
}

bool send_status()
{
    Status status;
    uint8_t wire[WIRE_MAX];
    report_sampling(status);
    status.dropped = dropped();
    status.reset_cause = reset_cause();
    status.boot_count = boots;
    status.free_stack_bytes = free_stack_bytes();
    status.idle_permille = idle_permille;
    return serial_send(wire, write_status(status, wire));
}

bool send_identity()
{
    uint8_t wire[WIRE_MAX];
    return serial_send(wire, write_identity(boots, reset_cause(), wire));
}

void take_requests()
{
    uint8_t byte;
    while (serial_receive(byte)) {
        uint8_t type = parser.feed(byte);
        if (type == TYPE_IDENTIFY) identity_due = true;
        if (type == TYPE_SELF_TEST) {
            request_self_test();
            test_running = true;
        }
    }
    if (test_running && self_test_done()) {
        test_running = false;
        status_due = true;
    }
}

// What found no room now is due again with the next frame; data go first.
void send_what_is_due()
{
    if (identity_due) identity_due = !send_identity();
    if (status_due && !identity_due) status_due = !send_status();
}

}  // namespace

int main()
{
    boots = count_boot();
    serial_begin();
    sampling_begin();
    set_sleep_mode(SLEEP_MODE_IDLE);
    wdt_enable(WDTO_60MS);
    sei();
    send_what_is_due();
    for (;;) {
        wait_for_frame();
#ifndef NEVER_KICK_WATCHDOG
        wdt_reset();
#endif
        send_data();
        take_requests();
        look_at_stack();
        send_what_is_due();
    }
}
