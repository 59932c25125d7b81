// EEPROM: the boot count and the saved settings, each in two slots with a checksum.
//
// A write goes to the older slot, at most one byte a tick because a byte takes the chip 3.4 ms,
// and the checksum comes last: a power loss half-way leaves the other slot as it was.
#include <avr/eeprom.h>
#include <string.h>

#include "chip.h"
#include "modbus.h"
#include "ports.h"

namespace {

constexpr uint16_t BOOT_SLOTS = 0;       // 2 × {count u16, checksum u16}
constexpr uint16_t SETTINGS_SLOTS = 64;  // 2 × SLOT_STRIDE
constexpr uint16_t SLOT_STRIDE = 128;
constexpr uint8_t MAX_WORDS = 40;

// A slot as it lies in the EEPROM: a version that rises with each save, words, checksum.
struct Slot {
    uint16_t version;
    uint16_t words[MAX_WORDS];
};

struct Job {
    uint16_t address;
    uint8_t bytes[2 * MAX_WORDS + 4];
    uint8_t size, done;
};

Job job;
uint16_t boots;

uint16_t checksum(const uint8_t *bytes, uint8_t size) {
    uint16_t crc = 0x1d0f;  // not 0xffff: blank memory must not check
    for (uint8_t i = 0; i < size; ++i) crc = Modbus::crc_step(crc, bytes[i]);
    return crc;
}

bool read_slot(uint16_t address, uint8_t *bytes, uint8_t size) {
    uint16_t stored;
    eeprom_read_block(bytes, reinterpret_cast<const void *>(address), size);
    eeprom_read_block(&stored, reinterpret_cast<const void *>(address + size), sizeof stored);
    return stored == checksum(bytes, size);
}

void begin_job(uint16_t address, const void *bytes, uint8_t size) {
    job.address = address;
    memcpy(job.bytes, bytes, size);
    const uint16_t sum = checksum(job.bytes, size);
    memcpy(job.bytes + size, &sum, sizeof sum);
    job.size = size + sizeof sum;
    job.done = 0;
}

// Reads both slots; returns which holds the newer data, -1 when neither is whole.
int8_t newer_slot(uint16_t start, uint16_t stride, Slot *slot, uint8_t size) {
    Slot other;
    const bool first = read_slot(start, reinterpret_cast<uint8_t *>(slot), size);
    const bool second = read_slot(start + stride, reinterpret_cast<uint8_t *>(&other), size);
    if (second && (!first || static_cast<int16_t>(other.version - slot->version) > 0)) {
        memcpy(slot, &other, size);
        return 1;
    }
    return first ? 0 : -1;
}

uint8_t slot_size(uint8_t count) { return static_cast<uint8_t>(2 + 2 * count); }

}  // namespace

namespace store {

// The count itself is the version: the slot that is not the newest gets the next.
void begin() {
    Slot slot;
    const int8_t newest = newer_slot(BOOT_SLOTS, 4, &slot, 2);
    boots = newest < 0 ? 1 : slot.version + 1;
    begin_job(BOOT_SLOTS + (newest == 0 ? 4 : 0), &boots, sizeof boots);
}

void tick() {
    if (job.done == job.size || !eeprom_is_ready()) return;
    const uint16_t address = job.address + job.done;
    eeprom_update_byte(reinterpret_cast<uint8_t *>(address), job.bytes[job.done]);
    ++job.done;
}

uint16_t boot_count() { return boots; }

}  // namespace store

namespace ports {

bool load(uint16_t *words, uint8_t count) {
    Slot slot;
    if (newer_slot(SETTINGS_SLOTS, SLOT_STRIDE, &slot, slot_size(count)) < 0) return false;
    memcpy(words, slot.words, 2 * count);
    return true;
}

void save(const uint16_t *words, uint8_t count) {
    Slot slot;
    const int8_t newest = newer_slot(SETTINGS_SLOTS, SLOT_STRIDE, &slot, slot_size(count));
    slot.version = newest < 0 ? 1 : slot.version + 1;
    memcpy(slot.words, words, 2 * count);
    begin_job(SETTINGS_SLOTS + (newest == 0 ? SLOT_STRIDE : 0), &slot, slot_size(count));
}

bool saving() { return job.done != job.size; }

}  // namespace ports
