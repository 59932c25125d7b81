#include "store.h"

namespace {

// A wide number in two words, the higher one first.
uint32_t wide(const uint16_t *words) { return static_cast<uint32_t>(words[0]) << 16 | words[1]; }
uint16_t high(uint32_t value) { return static_cast<uint16_t>(value >> 16); }
uint16_t low(uint32_t value) { return static_cast<uint16_t>(value); }

}  // namespace

void Store::begin() {
    boots_ = 0;
    boot_.load(&boots_);
    ++boots_;
    boot_.begin_save(&boots_);
    uint16_t words[3] = {0, 0, 0};
    place_.load(words);
    kept_place_ = {wide(words), words[2]};
    words[0] = words[1] = 0;
    hash_.load(words);
    commissioned_ = wide(words);
}

void Store::commission(uint32_t hash) {
    commissioned_ = hash;
    const uint16_t words[2] = {high(hash), low(hash)};
    hash_.begin_save(words);
}

void Store::keep_place(const ports::Place &place) {
    kept_place_ = place;
    const uint16_t words[3] = {high(place.hash), low(place.hash), place.contact_um};
    place_.begin_save(words);
}

void Store::tick() {
    Slots &slots = boot_.saving()       ? boot_
                   : settings_.saving() ? settings_
                   : hash_.saving()     ? hash_
                                        : place_;
    if (!slots.saving() || !ports::store_ready()) return;
    uint16_t address;
    const uint8_t byte = slots.next(address);
    ports::store_byte(address, byte);
}

SettingsFrom Store::load(uint16_t *words) const {
    switch (settings_.load(words)) {
        case Slots::Found::Whole: return SettingsFrom::Saved;
        case Slots::Found::Damaged: return SettingsFrom::Damaged;
        default: return SettingsFrom::Defaults;
    }
}
