// The main loop: packs a frame, sends it, hears the host, and sleeps. Interrupts do the rest.
#include <avr/interrupt.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "plan.h"
#include "chip_boot.h"
#include "chip_sampling.h"
#include "chip_serial.h"
#include "chip_test.h"
#include "request.h"
#include "wire.h"

namespace {

const uint8_t SPIN_CYCLES = 8;
const uint8_t FOR_DATA = 16;    // with what leaves the ring meanwhile, room for the next frame

uint16_t boots;
uint16_t idle_permille;
uint32_t ring_full;     // frames that found no room in the ring
bool identity_due = true;
bool status_due, tested_due;
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

void send_data(const Frame &frame)
{
    uint8_t wire[WIRE_MAX];
    uint8_t size = write_data(frame, dropped(), wire);
    if (!serial_send(wire, size, 0)) ring_full++;
    if (++since_status == STATUS_EVERY) {
        since_status = 0;
        status_due = true;
    }
}

uint8_t test_bits()
{
    const SelfTest &test = last_self_test();
    return uint8_t((test.count ? TEST_DONE : 0) | (found_fault(test) ? TEST_FOUND : 0) |
                   (self_test_running() ? TEST_RUNNING : 0));
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
    status.supply_mv = supply_mv();
    status.self_test = test_bits();
    return serial_send(wire, write_status(status, wire), 0);
}

bool send_identity()
{
    uint8_t wire[WIRE_MAX];
    return serial_send(wire, write_identity(boots, reset_cause(), wire), FOR_DATA);
}

bool send_tested()
{
    uint8_t wire[WIRE_MAX];
    return serial_send(wire, write_tested(last_self_test(), wire), FOR_DATA);
}

void take_requests()
{
    uint8_t byte;
    while (serial_receive(byte)) {
        uint8_t type = parser.feed(byte);
        if (type == TYPE_IDENTIFY) identity_due = true;
        if (type == TYPE_SELF_TEST) begin_self_test();
    }
}

// One a frame: a millisecond of wire holds one beside the data, and a flood of requests must not
// keep the loop from its samples. What found no room is due again with the next frame. What the
// host cannot ask for goes first.
void send_what_is_due()
{
    if (status_due) {
        status_due = !send_status();
    } else if (tested_due) {
        tested_due = !send_tested();
    } else if (identity_due && send_identity()) {
        identity_due = false;
        tested_due = last_self_test().count != 0;
    }
}

}  // namespace

int main()
{
    boots = count_boot();
    serial_begin();
    sampling_begin();
    begin_self_test();
    set_sleep_mode(SLEEP_MODE_IDLE);
    wdt_enable(WDTO_60MS);
    sei();
    send_what_is_due();
    for (;;) {
        wait_for_frame();
#ifndef NEVER_KICK_WATCHDOG
        wdt_reset();
#endif
        const Frame &frame = take_frame();
        send_data(frame);
        if (continue_self_test(frame)) tested_due = true;
        take_requests();
        look_at_stack();
        send_what_is_due();
    }
}
