// EEPROM of the chip, byte by byte; store.h defines its layout.
#include <avr/eeprom.h>

#include "chip.h"
#include "ports.h"
#include "store.h"

namespace {

Store stored;

}  // namespace

namespace store {

void begin() { stored.begin(); }
void tick() { stored.tick(); }
uint16_t boot_count() { return stored.boot_count(); }

}  // namespace store

namespace ports {

uint8_t stored_byte(uint16_t address) {
    return eeprom_read_byte(reinterpret_cast<const uint8_t *>(address));
}

bool store_ready() { return eeprom_is_ready(); }

void store_byte(uint16_t address, uint8_t byte) {
    eeprom_update_byte(reinterpret_cast<uint8_t *>(address), byte);
}

SettingsFrom load(uint16_t *words) { return stored.load(words); }
void save(const uint16_t *words) { stored.save(words); }
bool saving() { return stored.saving(); }
uint32_t commissioned() { return stored.commissioned(); }
void commission(uint32_t hash) { stored.commission(hash); }
Place place() { return stored.place(); }
void keep_place(const Place &place) { stored.keep_place(place); }

}  // namespace ports
