// What the taxel board takes for a request, and what it does not.
#include <cstdlib>
#include <vector>

#include "../native/check.h"
#include "cobs.h"
#include "crc32.h"
#include "request.h"
#include "wire.h"

namespace {

using Bytes = std::vector<uint8_t>;

Bytes request(uint8_t type) {
    uint8_t body[1 + CRC_SIZE] = {type};
    uint32_t crc = crc32(body, 1);
    for (uint8_t i = 0; i < CRC_SIZE; ++i) body[1 + i] = uint8_t(crc >> (8 * i));
    Bytes wire(sizeof body + 2);
    cobs_encode(body, sizeof body, wire.data());
    return wire;
}

Bytes feed(RequestParser &parser, const Bytes &bytes) {
    Bytes found;
    for (uint8_t byte : bytes)
        if (uint8_t type = parser.feed(byte)) found.push_back(type);
    return found;
}

}  // namespace

TEST(both_requests_are_understood) {
    RequestParser parser;
    CHECK(feed(parser, request(TYPE_IDENTIFY)) == Bytes{TYPE_IDENTIFY});
    CHECK(feed(parser, request(TYPE_SELF_TEST)) == Bytes{TYPE_SELF_TEST});
}

TEST(a_type_of_the_board_itself_is_no_request) {
    RequestParser parser;
    CHECK(feed(parser, request(TYPE_DATA)).empty());
}

TEST(every_flipped_bit_is_refused) {
    const Bytes good = request(TYPE_IDENTIFY);
    for (size_t bit = 0; bit < good.size() * 8; ++bit) {
        Bytes bad = good;
        bad[bit / 8] ^= uint8_t(1 << bit % 8);
        RequestParser parser;
        CHECK(feed(parser, bad).empty());
    }
}

TEST(garbage_of_any_length_costs_only_the_request_it_touches) {
    std::srand(3);
    for (int length = 0; length < 300; ++length) {
        RequestParser parser;
        Bytes noise;
        for (int i = 0; i < length; ++i) noise.push_back(uint8_t(std::rand()));
        feed(parser, noise);
        feed(parser, {0});
        CHECK(feed(parser, request(TYPE_IDENTIFY)) == Bytes{TYPE_IDENTIFY});
    }
}
