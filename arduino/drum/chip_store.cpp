// EEPROM: the boot count and the saved settings, at most one byte a tick because a byte takes
// the chip 3.4 ms. The brain waits for nothing of it.
#include <avr/eeprom.h>

#include "chip.h"
#include "ports.h"
#include "slots.h"

namespace {

constexpr uint16_t BOOT_START = 0, BOOT_STRIDE = 16;
constexpr uint16_t SETTINGS_START_BYTE = 64, SETTINGS_STRIDE = 128;
static_assert(Slots::MAX_BYTES <= SETTINGS_STRIDE, "a slot would reach into the next");

Slots boot_slots(BOOT_START, BOOT_STRIDE, 1);
Slots setting_slots(SETTINGS_START_BYTE, SETTINGS_STRIDE, SETTINGS_WORDS);
uint16_t boots;

void write_next(Slots &slots) {
    uint16_t address;
    const uint8_t byte = slots.next(address);
    eeprom_update_byte(reinterpret_cast<uint8_t *>(address), byte);
}

}  // namespace

namespace store {

void begin() {
    boots = 0;
    boot_slots.load(&boots);
    ++boots;
    boot_slots.begin_save(&boots);
}

void tick() {
    if (!eeprom_is_ready()) return;
    if (boot_slots.saving()) write_next(boot_slots);
    else if (setting_slots.saving()) write_next(setting_slots);
}

uint16_t boot_count() { return boots; }

}  // namespace store

namespace ports {

uint8_t stored_byte(uint16_t address) {
    return eeprom_read_byte(reinterpret_cast<const uint8_t *>(address));
}

SettingsFrom load(uint16_t *words) {
    switch (setting_slots.load(words)) {
        case Slots::Found::Whole: return SettingsFrom::Saved;
        case Slots::Found::Damaged: return SettingsFrom::Damaged;
        default: return SettingsFrom::Defaults;
    }
}

void save(const uint16_t *words) { setting_slots.begin_save(words); }

// A byte of the boot count on its way would make a save wait for the EEPROM.
bool saving() { return boot_slots.saving() || setting_slots.saving(); }

}  // namespace ports
