// Frames, checksum and stuffing of the taxel board, on the PC.
#include <cstring>
#include <vector>

#include "../native/check.h"
#include "cobs.h"
#include "crc32.h"
#include "wire.h"

namespace {

using Bytes = std::vector<uint8_t>;

Bytes stuffed(Bytes body) {
    Bytes wire(body.size() + 2);
    CHECK_EQUAL(cobs_encode(body.data(), uint8_t(body.size()), wire.data()), wire.size());
    return wire;
}

// The body of a whole wire frame, its checksum proven and taken off.
Bytes body_of(const uint8_t *wire, uint8_t size) {
    CHECK_EQUAL(wire[size - 1], 0);
    Bytes frame(wire, wire + size - 1);
    frame.resize(cobs_decode(frame.data(), uint8_t(frame.size())));
    CHECK(frame.size() > CRC_SIZE);
    const uint8_t body = uint8_t(frame.size() - CRC_SIZE);
    uint32_t crc = 0;
    for (uint8_t i = 0; i < CRC_SIZE; ++i) crc |= uint32_t(frame[body + i]) << (8 * i);
    CHECK_EQUAL(crc, crc32(frame.data(), body));
    frame.resize(body);
    return frame;
}

uint16_t reading(const Bytes &body, int taxel) {
    uint32_t bits = 0;
    const int from = taxel * 10;
    for (int i = 0; i < 3 && 4 + from / 8 + i < DATA_SIZE; ++i)
        bits |= uint32_t(body[size_t(4 + from / 8 + i)]) << (8 * i);
    return uint16_t(bits >> (from % 8) & 1023);
}

Frame some_frame() {
    Frame frame = {};
    for (uint8_t i = 0; i < TAXELS; ++i) frame.reading[i] = uint16_t((i * 331 + 7) % 1024);
    frame.counter = 0x12345678;
    frame.flags = FLAG_SYNC | FLAG_OVERRUN;
    frame.edges = 0x0b;
    return frame;
}

}  // namespace

TEST(crc32_is_that_of_zlib) {
    const char *digits = "123456789";
    CHECK_EQUAL(crc32(reinterpret_cast<const uint8_t *>(digits), 9), 0xCBF43926u);
    CHECK_EQUAL(crc32(nullptr, 0), 0);
}

TEST(cobs_leaves_no_zero_inside_and_comes_back) {
    for (int pattern = 0; pattern < 256; ++pattern) {
        Bytes body(31);
        for (size_t i = 0; i < body.size(); ++i) body[i] = uint8_t(pattern >> (i % 8) & 1 ? i + 1 : 0);
        Bytes wire = stuffed(body);
        CHECK(std::memchr(wire.data(), 0, wire.size()) == &wire.back());
        const uint8_t size = cobs_decode(wire.data(), uint8_t(wire.size() - 1));
        CHECK(Bytes(wire.begin(), wire.begin() + size) == body);
    }
}

TEST(cobs_refuses_what_runs_past_its_end) {
    Bytes frame = {5, 1, 2};
    CHECK_EQUAL(cobs_decode(frame.data(), 3), 0);
}

TEST(data_frame_holds_every_bit_where_the_reference_says) {
    uint8_t wire[WIRE_MAX];
    const Frame frame = some_frame();
    const uint8_t size = write_data(frame, 3, wire);
    CHECK_EQUAL(size, 33);
    const Bytes body = body_of(wire, size);
    CHECK_EQUAL(body.size(), DATA_SIZE);
    CHECK_EQUAL(body[0], TYPE_DATA);
    CHECK_EQUAL(body[1] | body[2] << 8, 0x5678);
    CHECK_EQUAL(body[3], FLAG_SYNC | FLAG_OVERRUN | 3 << 4);
    for (int i = 0; i < TAXELS; ++i) CHECK_EQUAL(reading(body, i), frame.reading[i]);
    CHECK_EQUAL(body[26] >> 4, 0x0b);
}

TEST(count_of_dropped_frames_saturates) {
    uint8_t wire[WIRE_MAX];
    CHECK_EQUAL(body_of(wire, write_data(some_frame(), 100000, wire))[3] >> 4, 15);
}

TEST(status_and_identity_have_the_sizes_of_the_reference) {
    uint8_t wire[WIRE_MAX];
    Status status = {};
    status.samples = 0x01020304;
    status.self_test = TEST_DONE;
    Bytes body = body_of(wire, write_status(status, wire));
    CHECK_EQUAL(body.size(), STATUS_SIZE);
    CHECK_EQUAL(body[2] | body[5] << 8, 0x0104);
    CHECK_EQUAL(body[25], TEST_DONE);
    body = body_of(wire, write_identity(7, 2, wire));
    CHECK_EQUAL(body.size(), IDENTITY_SIZE);
    CHECK_EQUAL(body[1] | body[2] << 8, 0x5247);
    CHECK_EQUAL(body[14], 7);
    CHECK_EQUAL(body[16], 2);
}

TEST(outcome_of_a_self_test_holds_every_mask) {
    uint8_t wire[WIRE_MAX];
    SelfTest test = SelfTest();
    test.count = 3;
    test.inputs_together = 0x3f;
    test.silent = 0x20001;
    test.full = 0x10000;
    const Bytes body = body_of(wire, write_tested(test, wire));
    CHECK_EQUAL(body.size(), TESTED_SIZE);
    CHECK_EQUAL(body[0], TYPE_TESTED);
    CHECK_EQUAL(body[2], 3);
    CHECK_EQUAL(body[10], 0x3f);
    CHECK_EQUAL(body[11] | body[12] << 8 | body[13] << 16, 0x20001);
    CHECK_EQUAL(body[14] | body[15] << 8 | body[16] << 16, 0x10000);
}
