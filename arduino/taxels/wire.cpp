#include "wire.h"

#include "cobs.h"
#include "crc32.h"

namespace {

uint8_t *put16(uint8_t *at, uint16_t value) {
    *at++ = uint8_t(value);
    *at++ = uint8_t(value >> 8);
    return at;
}

uint8_t *put32(uint8_t *at, uint32_t value) {
    return put16(put16(at, uint16_t(value)), uint16_t(value >> 16));
}

uint8_t *put24(uint8_t *at, uint32_t value) {
    at = put16(at, uint16_t(value));
    *at++ = uint8_t(value >> 16);
    return at;
}

uint8_t close_frame(uint8_t *body, uint8_t size, uint8_t *wire) {
    put32(body + size, crc32(body, size));
    return cobs_encode(body, size + CRC_SIZE, wire);
}

// Four readings of 10 bit fill five bytes, the lowest bits first.
uint8_t *pack4(uint8_t *at, const uint16_t *r) {
    *at++ = uint8_t(r[0]);
    *at++ = uint8_t(r[0] >> 8 | r[1] << 2);
    *at++ = uint8_t(r[1] >> 6 | r[2] << 4);
    *at++ = uint8_t(r[2] >> 4 | r[3] << 6);
    *at++ = uint8_t(r[3] >> 2);
    return at;
}

}  // namespace

uint8_t write_data(const Frame &frame, uint32_t dropped, uint8_t *wire) {
    uint8_t body[DATA_SIZE + CRC_SIZE];
    uint8_t *at = body;
    uint8_t saturated = dropped > DROPPED_MAX ? DROPPED_MAX : uint8_t(dropped);
    *at++ = TYPE_DATA;
    at = put16(at, uint16_t(frame.counter));
    *at++ = uint8_t(frame.flags | saturated << DROPPED_SHIFT);
    constexpr uint8_t LEFT = TAXELS % 4;
    const uint16_t *reading = frame.reading;
    for (; reading != frame.reading + (TAXELS - LEFT); reading += 4) at = pack4(at, reading);
    // The readings that are left, with the edges behind them. Longer code moves the moments at which
    // interrupts meet: see tests/firmware/taxels/test_taxels_long.py.
    if (LEFT > 0) *at++ = uint8_t(reading[0]);
    if (LEFT > 1) *at++ = uint8_t(reading[0] >> 8 | reading[1] << 2);
    if (LEFT > 2) *at++ = uint8_t(reading[1] >> 6 | reading[2] << 4);
    if (LEFT == 0) *at++ = frame.edges;
    if (LEFT == 1) *at++ = uint8_t(reading[0] >> 8 | frame.edges << 2);
    if (LEFT == 2) *at++ = uint8_t(reading[1] >> 6 | frame.edges << 4);
    if (LEFT == 3) *at++ = uint8_t(reading[2] >> 4 | frame.edges << 6);
    if (LEFT == 3) *at++ = uint8_t(frame.edges >> 2);
    return close_frame(body, DATA_SIZE, wire);
}

uint8_t write_status(const Status &status, uint8_t *wire) {
    uint8_t body[STATUS_SIZE + CRC_SIZE];
    uint8_t *at = body;
    *at++ = TYPE_STATUS;
    *at++ = WIRE_VERSION;
    at = put32(at, status.samples);
    at = put32(at, status.dropped);
    at = put16(at, status.late_slots);
    at = put16(at, status.longest_isr_cycles);
    at = put16(at, status.supply_mv);
    *at++ = status.reset_cause;
    at = put16(at, status.boot_count);
    at = put16(at, status.free_stack_bytes);
    at = put16(at, status.idle_permille);
    at = put16(at, status.sync_rises);
    *at++ = status.self_test;
    return close_frame(body, STATUS_SIZE, wire);
}

uint8_t write_identity(uint16_t boot_count, uint8_t reset_cause, uint8_t *wire) {
    uint8_t body[IDENTITY_SIZE + CRC_SIZE];
    uint8_t *at = body;
    *at++ = TYPE_IDENTITY;
    at = put16(at, 0x5247);
    *at++ = WIRE_VERSION;
    *at++ = 2;
    at = put16(at, uint16_t(FIRMWARE_MAJOR << 8 | FIRMWARE_MINOR));
    at = put32(at, BUILD_HASH);
    *at++ = TAXELS;
    at = put16(at, RATE_HZ);
    at = put16(at, boot_count);
    *at++ = reset_cause;
    at = put16(at, SLOT_CYCLES);
    *at++ = SLOTS;
    return close_frame(body, IDENTITY_SIZE, wire);
}

uint8_t write_tested(const SelfTest &test, uint8_t *wire) {
    uint8_t body[TESTED_SIZE + CRC_SIZE];
    uint8_t *at = body;
    *at++ = TYPE_TESTED;
    *at++ = WIRE_VERSION;
    *at++ = test.count;
    *at++ = test.tested;
    *at++ = test.lines_low;
    *at++ = test.lines_high;
    *at++ = test.lines_together;
    *at++ = test.inputs_high;
    *at++ = test.inputs_low;
    *at++ = test.inputs_open;
    *at++ = test.inputs_together;
    at = put24(at, test.silent);
    at = put24(at, test.full);
    *at = 0;  // spare
    return close_frame(body, TESTED_SIZE, wire);
}
