// What the board says and hears: a data frame a millisecond, status, identity, self-tests.
#ifndef TALK_H
#define TALK_H

#include "request.h"           // what the host asks for
#include "self_test_course.h"  // tests, supply
#include "wire.h"              // frames

class Talk {
public:
    // Once after a reset: begins a self-test and says who it is.
    void begin(uint16_t boots);

    // With each frame that was closed.
    void take(const Frame &frame);

    // The next frame to be taken brings a status.
    bool status_comes() const { return since_status_ == STATUS_EVERY - 1; }

private:
    uint32_t dropped() const;
    void send_data(const Frame &frame);
    bool send_status() const;
    bool send_identity() const;
    bool send_tested() const;
    uint8_t test_bits() const;
    void take_requests();
    void send_what_is_due();

    RequestParser parser_;
    SelfTestCourse test_;
    uint32_t ring_full_ = 0;  // frames that found no room in the ring
    uint16_t boots_ = 0;
    uint8_t since_status_ = 0;
    bool identity_due_ = true, status_due_ = false, tested_due_ = false;
};

#endif  // TALK_H
