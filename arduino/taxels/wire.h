// The frames of docs/reference/taxel-wire.md: values in, wire bytes out. Knows no register.
#ifndef WIRE_H
#define WIRE_H

#include <stdint.h>

#include "plan.h"       // taxels
#include "self_test.h"  // result

constexpr uint8_t WIRE_VERSION = 2;

constexpr uint8_t TYPE_IDENTIFY = 0x01;   // host → board
constexpr uint8_t TYPE_SELF_TEST = 0x02;  // host → board
constexpr uint8_t TYPE_IDENTITY = 0x10;
constexpr uint8_t TYPE_DATA = 0x11;
constexpr uint8_t TYPE_STATUS = 0x12;
constexpr uint8_t TYPE_TESTED = 0x13;

constexpr uint8_t FLAG_SYNC = 1 << 0;     // level of the sync line when the frame was closed
constexpr uint8_t FLAG_INDEX = 1 << 1;    // an index mark began in this frame
constexpr uint8_t FLAG_LATE = 1 << 2;     // a line had less than 10 µs to settle
constexpr uint8_t FLAG_OVERRUN = 1 << 3;  // a slot was missed
constexpr uint8_t DROPPED_SHIFT = 4;
constexpr uint8_t DROPPED_MAX = 15;

constexpr uint8_t CRC_SIZE = 4;
constexpr uint8_t DATA_SIZE = 4 + (10 * TAXELS + 4 + 7) / 8;  // readings of 10 bit, 4 bit of edges
constexpr uint8_t STATUS_SIZE = 26;
constexpr uint8_t IDENTITY_SIZE = 20;
constexpr uint8_t TESTED_SIZE = 18;
constexpr uint8_t WIRE_MAX = DATA_SIZE + CRC_SIZE + 2;

// One millisecond of samples as it was closed.
struct Frame {
    uint16_t reading[TAXELS];  // 10 bit, taxel order of the wire
    uint32_t counter;          // number of this frame since boot, from 0
    uint8_t flags;             // FLAG_ bits
    uint8_t edges;             // sync rises mod 4 in bits 0–1, index marks mod 4 in bits 2–3
};

// Bits of Status::self_test.
constexpr uint8_t TEST_DONE = 1 << 0;
constexpr uint8_t TEST_FOUND = 1 << 1;    // it found something
constexpr uint8_t TEST_RUNNING = 1 << 2;

struct Status {
    uint32_t samples;
    uint32_t dropped;
    uint16_t late_slots;
    uint16_t longest_isr_cycles;
    uint16_t supply_mv;
    uint8_t reset_cause;
    uint16_t boot_count;
    uint16_t free_stack_bytes;
    uint16_t idle_permille;
    uint16_t sync_rises;
    uint8_t self_test;
};

// Each writes a complete frame, closing zero included, and returns its size.
uint8_t write_data(const Frame &frame, uint32_t dropped, uint8_t *wire);
uint8_t write_status(const Status &status, uint8_t *wire);
uint8_t write_identity(uint16_t boot_count, uint8_t reset_cause, uint8_t *wire);
uint8_t write_tested(const SelfTest &test, uint8_t *wire);

#endif  // WIRE_H
