// The register bank: the words by address, their bounds and their guards.
#ifndef BANK_H
#define BANK_H

#include <stdint.h>

#include "drum_map.h"  // addresses and bounds

class Bank {
  public:
    Bank() { restore_defaults(); }

    uint16_t word(uint16_t address) const { return words_[address]; }
    int32_t wide(uint16_t address) const;
    void put(uint16_t address, uint16_t value) { words_[address] = value; }
    void put_wide(uint16_t address, uint32_t value);
    uint16_t *words_at(uint16_t address) { return &words_[address]; }
    uint16_t *settings() { return &words_[SETTINGS_START]; }
    const uint16_t *tare_places() const { return &words_[reg::tare_place_00]; }

    // True when every one of these words belongs to a setting.
    bool writable(uint16_t address, uint16_t count) const;
    // True when each setting that these words belong to is inside its bounds.
    bool in_bounds(uint16_t address, uint16_t count) const;
    bool settings_valid() const { return in_bounds(SETTINGS_START, SETTINGS_WORDS); }
    // The strictest guard of the settings that differ from the words before.
    Guard guard_of_change(uint16_t address, uint16_t count, const uint16_t *before) const;

    // Sets every setting except heartbeat and command to its default.
    void restore_defaults();

  private:
    uint16_t words_[COUNTERS_END] = {};
};

#endif  // BANK_H
