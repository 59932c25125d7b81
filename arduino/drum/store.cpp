#include "store.h"

#include "ports.h"  // bytes of the EEPROM

void Store::begin() {
    boots_ = 0;
    boot_.load(&boots_);
    ++boots_;
    boot_.begin_save(&boots_);
    uint16_t words[2] = {0, 0};
    hash_.load(words);
    commissioned_ = static_cast<uint32_t>(words[0]) << 16 | words[1];
}

void Store::commission(uint32_t hash) {
    commissioned_ = hash;
    const uint16_t words[2] = {static_cast<uint16_t>(hash >> 16), static_cast<uint16_t>(hash)};
    hash_.begin_save(words);
}

void Store::tick() {
    Slots &slots = boot_.saving() ? boot_ : settings_.saving() ? settings_ : hash_;
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
