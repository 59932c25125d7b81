#include "talk.h"

#include "ports.h"

namespace {

constexpr uint8_t FOR_DATA = WIRE_MAX;  // the next frame finds room however soon it comes

}  // namespace

uint32_t Talk::dropped() const {
    return ring_full_ + missed_frames();
}

void Talk::send_data(const Frame &frame) {
    uint8_t wire[WIRE_MAX];
    uint8_t size = write_data(frame, dropped(), wire);
    if (!serial_send(wire, size, 0)) ring_full_++;
    if (++since_status_ == STATUS_EVERY) {
        since_status_ = 0;
        status_due_ = true;
    }
}

uint8_t Talk::test_bits() const {
    const SelfTest &test = test_.result();
    return uint8_t((test.count ? TEST_DONE : 0) | (found_fault(test) ? TEST_FOUND : 0) |
                   (test_.running() ? TEST_RUNNING : 0));
}

bool Talk::send_status() const {
    Status status;
    uint8_t wire[WIRE_MAX];
    report_sampling(status);
    status.dropped = dropped();
    status.reset_cause = reset_cause();
    status.boot_count = boots_;
    status.free_stack_bytes = free_stack_bytes();
    status.idle_permille = idle_permille();
    status.supply_mv = test_.supply_mv();
    status.self_test = test_bits();
    return serial_send(wire, write_status(status, wire), 0);
}

bool Talk::send_identity() const {
    uint8_t wire[WIRE_MAX];
    return serial_send(wire, write_identity(boots_, reset_cause(), wire), FOR_DATA);
}

bool Talk::send_tested() const {
    uint8_t wire[WIRE_MAX];
    return serial_send(wire, write_tested(test_.result(), wire), FOR_DATA);
}

void Talk::take_requests() {
    uint8_t byte;
    while (serial_receive(byte)) {
        uint8_t type = parser_.feed(byte);
        if (type == TYPE_IDENTIFY) identity_due_ = true;
        if (type == TYPE_SELF_TEST) test_.begin();
    }
}

// One a frame: a millisecond of wire holds one beside the data, and a flood of requests must not
// keep the loop from its samples. What found no room is due again with the next frame. What the
// host cannot ask for goes first.
void Talk::send_what_is_due() {
    if (status_due_) {
        status_due_ = !send_status();
    } else if (tested_due_) {
        tested_due_ = !send_tested();
    } else if (identity_due_ && send_identity()) {
        identity_due_ = false;
        tested_due_ = test_.result().count != 0;
    }
}

void Talk::begin(uint16_t boots) {
    boots_ = boots;
    test_.begin();
    send_what_is_due();
}

void Talk::take(const Frame &frame) {
    send_data(frame);
    if (test_.next(frame)) tested_due_ = true;
    take_requests();
    send_what_is_due();
}
