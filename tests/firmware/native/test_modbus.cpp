// The Modbus slave, byte by byte: good frames, every exception, torn, merged and random ones.
#include <cstring>
#include <random>
#include <vector>

#include "check.h"
#include "modbus.h"

namespace {

using Bytes = std::vector<uint8_t>;

struct FakeHandler : RegisterHandler {
    void refresh() override { ++refreshed; }
    uint16_t ring_word(uint16_t address) override { return address; }
    bool may_change(Guard guard) const override { return guard == Guard::None || !pressed; }
    bool command(Command command, uint16_t sequence) override {
        last = command;
        last_sequence = sequence;
        return !refuse;
    }
    void written(uint16_t, uint16_t) override { ++writes; }
    Command last = Command::None;
    uint16_t last_sequence = 0;
    int refreshed = 0, writes = 0;
    bool refuse = false, pressed = false;
};

struct Slave {
    FakeHandler handler;
    Bank bank;
    Registers registers{bank, handler};
    Modbus modbus{registers};

    Bytes feed(const Bytes &bytes) {
        Bytes answer;
        for (uint8_t byte : bytes) {
            const uint16_t length = modbus.take(byte);
            answer.insert(answer.end(), modbus.reply(), modbus.reply() + length);
        }
        return answer;
    }
    void silence(int ms = 10) {
        for (int i = 0; i < ms; ++i) modbus.tick();
    }
};

Bytes framed(Bytes body) {
    uint16_t crc = 0xffff;
    for (uint8_t byte : body) crc = Modbus::crc_step(crc, byte);
    body.push_back(static_cast<uint8_t>(crc));
    body.push_back(static_cast<uint8_t>(crc >> 8));
    return body;
}

Bytes body_of(const Bytes &frame) {
    CHECK(frame.size() >= 4);
    if (frame.size() < 4) return {};
    CHECK(framed({frame.begin(), frame.end() - 2}) == frame);
    return {frame.begin(), frame.end() - 2};
}

const Bytes READ_IDENTITY = framed({1, 3, 0, 0, 0, 2});

bool is_exception(const Bytes &frame, uint8_t function, uint8_t code) {
    return frame == framed({1, static_cast<uint8_t>(function | 0x80), code});
}

}  // namespace

TEST(crc_is_that_of_the_standard) {
    // The example of the Modbus serial line specification: 02 07 → 41 12.
    CHECK(framed({2, 7}) == (Bytes{2, 7, 0x41, 0x12}));
}

TEST(reads_registers) {
    Slave slave;
    slave.bank.put(reg::magic, MAGIC);
    slave.bank.put(reg::map_version, MAP_VERSION);
    CHECK(body_of(slave.feed(READ_IDENTITY)) == (Bytes{1, 3, 4, 0x52, 0x47, 0, MAP_VERSION}));
    CHECK_EQUAL(slave.handler.refreshed, 1);
    CHECK_EQUAL(slave.modbus.frames_seen(), 1);
}

TEST(reads_gaps_as_zero_and_the_ring_from_its_handler) {
    Slave slave;
    CHECK(body_of(slave.feed(framed({1, 3, 0, 110, 0, 1}))) == (Bytes{1, 3, 2, 0, 0}));
    CHECK(body_of(slave.feed(framed({1, 3, 1, 127, 0, 1}))) == (Bytes{1, 3, 2, 1, 127}));
}

TEST(writes_one_and_many) {
    Slave slave;
    const Bytes one = framed({1, 6, 0, 68, 0x17, 0x70});
    CHECK(slave.feed(one) == one);
    CHECK_EQUAL(slave.bank.word(reg::speed_set), 6000);
    const Bytes many = framed({1, 16, 0, 68, 0, 2, 4, 0x0f, 0xa0, 0x09, 0xc4});
    CHECK(slave.feed(many) == framed({1, 16, 0, 68, 0, 2}));
    CHECK_EQUAL(slave.bank.word(reg::speed_set), 4000);
    CHECK_EQUAL(slave.bank.word(reg::force_set), 2500);
}

TEST(function_23_writes_before_it_reads) {
    Slave slave;
    const Bytes both = framed({1, 23, 0, 64, 0, 1, 0, 64, 0, 1, 2, 0xab, 0xcd});
    CHECK(body_of(slave.feed(both)) == (Bytes{1, 23, 2, 0xab, 0xcd}));
}

TEST(a_command_is_executed_once_for_each_sequence) {
    Slave slave;
    const Bytes command = framed({1, 16, 0, 65, 0, 2, 4, 0, 7, 0, 9});
    slave.feed(command);
    CHECK(slave.handler.last == Command::Stop);
    CHECK_EQUAL(slave.handler.last_sequence, 9);
    slave.handler.last = Command::None;
    CHECK(slave.feed(command) == framed({1, 16, 0, 65, 0, 2}));
    CHECK(slave.handler.last == Command::None);
}

TEST(exceptions) {
    Slave slave;
    CHECK(is_exception(slave.feed(framed({1, 4, 0, 0, 0, 1})), 4, 1));
    CHECK(is_exception(slave.feed(framed({1, 0x2b, 14, 1, 0})), 0x2b, 1));
    CHECK(is_exception(slave.feed(framed({1, 3, 1, 160, 0, 1})), 3, 2));
    CHECK(is_exception(slave.feed(framed({1, 3, 1, 159, 0, 2})), 3, 2));
    CHECK(is_exception(slave.feed(framed({1, 3, 0xff, 0xff, 0, 2})), 3, 2));
    CHECK(is_exception(slave.feed(framed({1, 6, 0, 16, 0, 1})), 6, 2));
    CHECK(is_exception(slave.feed(framed({1, 6, 0, 115, 0, 0})), 6, 2));
    CHECK(is_exception(slave.feed(framed({1, 3, 0, 0, 0, 0})), 3, 3));
    CHECK(is_exception(slave.feed(framed({1, 3, 0, 0, 0, 126})), 3, 3));
    CHECK(is_exception(slave.feed(framed({1, 6, 0, 68, 0xff, 0xff})), 6, 3));
    CHECK(is_exception(slave.feed(framed({1, 16, 0, 68, 0, 1, 4, 0, 0, 0, 0})), 16, 3));
    CHECK_EQUAL(slave.modbus.exceptions_sent(), 11);
    CHECK_EQUAL(slave.handler.writes, 0);
}

TEST(a_write_is_applied_whole_or_not_at_all) {
    Slave slave;
    const Bytes half = framed({1, 16, 0, 68, 0, 2, 4, 0x0f, 0xa0, 0, 0});
    CHECK(is_exception(slave.feed(half), 16, 3));
    CHECK_EQUAL(slave.bank.word(reg::speed_set), 8000);
    slave.handler.refuse = true;
    const Bytes refused = framed({1, 16, 0, 64, 0, 3, 6, 0, 5, 0, 1, 0, 1});
    CHECK(is_exception(slave.feed(refused), 16, 4));
    CHECK_EQUAL(slave.bank.word(reg::heartbeat), 0);
    CHECK_EQUAL(slave.bank.word(reg::command_sequence), 0);
    CHECK_EQUAL(slave.handler.writes, 0);
}

TEST(every_setting_refuses_what_is_outside_its_bounds) {
    for (const Setting &setting : SETTINGS) {
        Slave slave;
        const bool wide = setting.kind == Kind::U32 || setting.kind == Kind::I32;
        const int64_t lowest = setting.kind == Kind::I16 ? -32768 : wide ? INT32_MIN : 0;
        const int64_t highest = setting.kind == Kind::I16 ? 32767 : wide ? INT32_MAX : 65535;
        for (const int64_t value : {int64_t{setting.low} - 1, int64_t{setting.low},
                                    int64_t{setting.high}, int64_t{setting.high} + 1}) {
            if (value < lowest || value > highest) continue;
            const auto raw = static_cast<uint32_t>(value);
            const uint8_t bytes[4] = {static_cast<uint8_t>(raw >> 24), static_cast<uint8_t>(raw >> 16),
                                      static_cast<uint8_t>(raw >> 8), static_cast<uint8_t>(raw)};
            const bool inside = value >= setting.low && value <= setting.high;
            const Answer answer = slave.registers.write(setting.address, wide ? 2 : 1, bytes + (wide ? 0 : 2));
            CHECK(answer == (inside ? Answer::Ok : Answer::OutOfRange));
        }
    }
}

TEST(defaults_are_inside_their_bounds) {
    Slave slave;
    CHECK(slave.bank.settings_valid());
    CHECK_EQUAL(slave.bank.word(reg::over_force), 14000);
    CHECK_EQUAL(slave.bank.wide(reg::scale_ug_per_count), 2400);
}

TEST(another_unit_is_met_with_silence) {
    Slave slave;
    CHECK(slave.feed(framed({2, 3, 0, 0, 0, 2})).empty());
    CHECK(slave.feed(framed({0, 6, 0, 68, 0x17, 0x70})).empty());
    CHECK_EQUAL(slave.bank.word(reg::speed_set), 8000);
    CHECK(!slave.feed(READ_IDENTITY).empty());
}

TEST(two_frames_in_one_piece_are_both_answered) {
    Slave slave;
    Bytes two = READ_IDENTITY;
    two.insert(two.end(), READ_IDENTITY.begin(), READ_IDENTITY.end());
    const Bytes answers = slave.feed(two);
    CHECK_EQUAL(answers.size(), 18);
}

TEST(a_torn_frame_is_whole_again_while_the_pause_is_short) {
    Slave slave;
    slave.feed({READ_IDENTITY.begin(), READ_IDENTITY.begin() + 3});
    slave.silence(9);
    CHECK_EQUAL(slave.feed({READ_IDENTITY.begin() + 3, READ_IDENTITY.end()}).size(), 9);
}

TEST(silence_forgets_half_a_frame) {
    Slave slave;
    slave.feed({READ_IDENTITY.begin(), READ_IDENTITY.begin() + 5});
    slave.silence();
    CHECK_EQUAL(slave.feed(READ_IDENTITY).size(), 9);
}

TEST(a_bad_crc_is_counted_and_silences_until_a_pause) {
    Slave slave;
    Bytes bad = READ_IDENTITY;
    bad.back() ^= 1;
    CHECK(slave.feed(bad).empty());
    CHECK_EQUAL(slave.modbus.crc_errors(), 1);
    slave.silence();
    CHECK_EQUAL(slave.feed(READ_IDENTITY).size(), 9);
}

TEST(a_request_that_claims_to_be_too_long_is_dropped) {
    Slave slave;
    Bytes endless = {1, 16, 0, 68, 0, 100, 200};
    endless.resize(300, 0);
    CHECK(slave.feed(endless).empty());
    slave.silence();
    CHECK_EQUAL(slave.feed(READ_IDENTITY).size(), 9);
}

TEST(a_damaged_byte_loses_its_frame) {
    Slave slave;
    slave.feed({READ_IDENTITY.begin(), READ_IDENTITY.begin() + 4});
    slave.modbus.poison();
    CHECK(slave.feed({READ_IDENTITY.begin() + 4, READ_IDENTITY.end()}).empty());
    slave.silence();
    CHECK_EQUAL(slave.feed(READ_IDENTITY).size(), 9);
}

TEST(a_million_random_bytes_change_no_register) {
    Slave slave;
    std::mt19937 random(7);
    uint16_t before[SETTINGS_WORDS];
    memcpy(before, slave.bank.settings(), sizeof before);
    for (int i = 0; i < 1000000; ++i) {
        // Half of them begin like a write, so that parsers get far.
        uint8_t byte = static_cast<uint8_t>(random());
        if (random() % 40 == 0) slave.silence(), slave.modbus.take(1), byte = 16;
        slave.modbus.take(byte);
    }
    CHECK(memcmp(before, slave.bank.settings(), sizeof before) == 0);
    slave.silence();
    CHECK_EQUAL(slave.feed(READ_IDENTITY).size(), 9);
}

TEST(mutated_good_frames_never_apply_half) {
    std::mt19937 random(11);
    const Bytes good = framed({1, 16, 0, 68, 0, 2, 4, 0x0f, 0xa0, 0x09, 0xc4});
    for (int i = 0; i < 20000; ++i) {
        Slave slave;
        Bytes frame = good;
        frame[random() % frame.size()] ^= static_cast<uint8_t>(1u << random() % 8);
        slave.feed(frame);
        CHECK_EQUAL(slave.bank.word(reg::speed_set), 8000);
        CHECK_EQUAL(slave.bank.word(reg::force_set), 5000);
    }
}
