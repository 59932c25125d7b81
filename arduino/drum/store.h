// What outlives the power: the boot count, the saved settings, the hash of those that the board was
// commissioned with and the place of the last contact, each in slots of their own.
//
// At most one byte is written a tick, because a byte takes the chip 3.4 ms and no caller waits.
#ifndef STORE_H
#define STORE_H

#include <stdint.h>

#include "ports.h"  // the place of a contact
#include "slots.h"  // two slots with a checksum each

class Store {
  public:
    // Counts this boot.
    void begin();
    // Once a millisecond: writes the next byte, if there is one, by ports::store_byte().
    void tick();
    uint16_t boot_count() const { return boots_; }

    // The saved settings; words are left alone where nothing whole was saved.
    SettingsFrom load(uint16_t *words) const;
    void save(const uint16_t *words) { settings_.begin_save(words); }
    // The hash that was last kept, 0 for none.
    uint32_t commissioned() const { return commissioned_; }
    void commission(uint32_t hash);
    // The place that was last kept; its hash is 0 for none.
    const ports::Place &place() const { return kept_place_; }
    void keep_place(const ports::Place &place);
    // A byte of the boot count on its way would make a save wait for the EEPROM.
    bool saving() const {
        return boot_.saving() || settings_.saving() || hash_.saving() || place_.saving();
    }

  private:
    static constexpr uint16_t BOOT_START = 0, BOOT_STRIDE = 16;
    static constexpr uint16_t SETTINGS_START_BYTE = 64, SETTINGS_STRIDE = 128;
    static constexpr uint16_t HASH_START = SETTINGS_START_BYTE + 2 * SETTINGS_STRIDE;
    static constexpr uint16_t HASH_STRIDE = 16;
    static constexpr uint16_t PLACE_START = HASH_START + 2 * HASH_STRIDE, PLACE_STRIDE = 16;
    static_assert(Slots::MAX_BYTES <= SETTINGS_STRIDE, "a slot would reach into the next");

    Slots boot_ = Slots(BOOT_START, BOOT_STRIDE, 1);
    Slots settings_ = Slots(SETTINGS_START_BYTE, SETTINGS_STRIDE, SETTINGS_WORDS);
    Slots hash_ = Slots(HASH_START, HASH_STRIDE, 2);
    Slots place_ = Slots(PLACE_START, PLACE_STRIDE, 3);
    uint16_t boots_ = 0;
    uint32_t commissioned_ = 0;
    ports::Place kept_place_ = {0, 0};
};

#endif  // STORE_H
