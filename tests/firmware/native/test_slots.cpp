// Saved words and the power: whichever byte it fails at, what is loaded is old or new, and whole.
#include <array>
#include <cstring>

#include "check.h"
#include "slots.h"

namespace {

constexpr uint16_t START = 64, STRIDE = 128;
constexpr uint8_t COUNT = SETTINGS_WORDS;
constexpr uint8_t SLOT_BYTES = 2 + 2 * COUNT + 2;
std::array<uint8_t, 512> memory;

using Words = std::array<uint16_t, COUNT>;

Slots slots() { return Slots(START, STRIDE, COUNT); }

Words pattern(uint16_t seed) {
    Words words;
    for (uint8_t i = 0; i < COUNT; ++i) words[i] = static_cast<uint16_t>(seed * 257 + i * 31);
    return words;
}

// Saves, and loses the power after so many bytes; `torn` of the next one are garbage bits.
void save(const Words &words, int bytes, uint8_t torn = 0) {
    Slots writer = slots();
    writer.begin_save(words.data());
    uint16_t address = 0;
    while (writer.saving() && bytes-- > 0) {
        const uint8_t byte = writer.next(address);
        memory.at(address) = byte;
    }
    if (torn && writer.saving()) {
        writer.next(address);
        memory.at(address) ^= torn;
    }
}

Slots::Found load(Words &words) { return slots().load(words.data()); }

}  // namespace

namespace ports {

uint8_t stored_byte(uint16_t address) { return memory.at(address); }
bool store_ready() { return true; }
void store_byte(uint16_t address, uint8_t byte) { memory.at(address) = byte; }

}  // namespace ports

TEST(blank_memory_holds_nothing_and_changes_nothing) {
    memory.fill(0xff);
    Words words = pattern(1);
    CHECK(load(words) == Slots::Found::Nothing);
    CHECK(words == pattern(1));
}

TEST(a_save_is_loaded_again_and_the_newest_wins) {
    memory.fill(0xff);
    Words words;
    for (uint16_t n = 1; n < 9; ++n) {
        save(pattern(n), SLOT_BYTES);
        CHECK(load(words) == Slots::Found::Whole);
        CHECK(words == pattern(n));
    }
}

TEST(a_power_loss_at_any_byte_leaves_old_or_new_whole) {
    for (uint8_t torn : {0x00, 0x01, 0xff}) {
        for (int bytes = 0; bytes <= SLOT_BYTES; ++bytes) {
            memory.fill(0xff);
            save(pattern(1), SLOT_BYTES);
            save(pattern(2), SLOT_BYTES);
            save(pattern(3), bytes, torn);
            Words words;
            CHECK(load(words) == Slots::Found::Whole);
            // Torn back to the same bits, the last byte may be the one that completes the slot.
            CHECK(words == (bytes == SLOT_BYTES ? pattern(3) : pattern(2)));
            save(pattern(4), SLOT_BYTES);
            CHECK(load(words) == Slots::Found::Whole);
            CHECK(words == pattern(4));
        }
    }
}

TEST(a_power_loss_in_the_very_first_save_is_no_save) {
    for (int bytes = 1; bytes < SLOT_BYTES; ++bytes) {
        memory.fill(0xff);
        save(pattern(1), bytes);
        Words words = pattern(9);
        CHECK(load(words) != Slots::Found::Whole);
        CHECK(words == pattern(9));
    }
}

TEST(any_flipped_bit_of_both_slots_is_damage) {
    for (int byte = 0; byte < SLOT_BYTES; ++byte) {
        for (int bit = 0; bit < 8; bit += 3) {
            memory.fill(0xff);
            save(pattern(1), SLOT_BYTES);
            save(pattern(2), SLOT_BYTES);
            memory.at(START + STRIDE + byte) ^= static_cast<uint8_t>(1u << bit);
            Words words;
            CHECK(load(words) == Slots::Found::Whole);
            CHECK(words == pattern(1));
            memory.at(START + byte) ^= static_cast<uint8_t>(1u << bit);
            CHECK(load(words) == Slots::Found::Damaged);
        }
    }
}

TEST(versions_may_wrap) {
    memory.fill(0xff);
    Slots count(0, 16, 1);
    uint16_t word = 0, address = 0;
    for (uint32_t n = 1; n <= 65600; ++n) {
        word = static_cast<uint16_t>(n);
        count.begin_save(&word);
        while (count.saving()) {
            const uint8_t byte = count.next(address);
            memory.at(address) = byte;
        }
    }
    word = 0;
    CHECK(count.load(&word) == Slots::Found::Whole);
    CHECK_EQUAL(word, 64);
}
