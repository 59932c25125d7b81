#include "store.h"

#include "ports.h"  // bytes of the EEPROM

void Store::begin() {
    boots_ = 0;
    boot_.load(&boots_);
    ++boots_;
    boot_.begin_save(&boots_);
}

void Store::tick() {
    Slots &slots = boot_.saving() ? boot_ : settings_;
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
