// The register bank: words by address, bounds on writes, and all-or-nothing writes.
#ifndef BANK_H
#define BANK_H

#include <stdint.h>

#include "drum_map.h"  // addresses and bounds

enum class Answer : uint8_t { Ok = 0, NoRegister = 2, OutOfRange = 3, Refused = 4 };

// Who lives behind the registers.
class Owner {
  public:
    // Brings the readable words up to date; called once before each read.
    virtual void refresh() = 0;
    // Words of the load-cell ring, addresses reg::ring_raw and up.
    virtual uint16_t ring_word(uint16_t address) = 0;
    // Whether settings that are guarded so may change now.
    virtual bool may_change(Guard guard) const = 0;
    // A new command_sequence arrived and all settings are in place; false refuses the write.
    virtual bool command(Command command, uint16_t sequence) = 0;
    // Settings were written and hold.
    virtual void written(uint16_t address, uint16_t count) = 0;

  protected:
    ~Owner() = default;
};

class Bank {
  public:
    explicit Bank(Owner &owner) : owner_(owner) { restore_defaults(); }

    Answer check_read(uint16_t address, uint16_t count) const;
    void refresh() { owner_.refresh(); }
    uint16_t read(uint16_t address) const;
    // Applies count big-endian words, or nothing at all.
    Answer write(uint16_t address, uint16_t count, const uint8_t *bytes);

    uint16_t word(uint16_t address) const { return words_[address]; }
    int32_t wide(uint16_t address) const;
    void put(uint16_t address, uint16_t value) { words_[address] = value; }
    void put_wide(uint16_t address, uint32_t value);

    // Every setting except heartbeat and command goes to its value at boot.
    void restore_defaults();
    // True when each stored setting is inside its bounds.
    bool settings_valid() const;
    uint16_t *settings() { return &words_[SETTINGS_START]; }

  private:
    bool writable(uint16_t address, uint16_t count) const;
    bool in_bounds(uint16_t address, uint16_t count) const;
    Answer take(uint16_t address, uint16_t count, const uint16_t *before);
    Guard guard_of_change(uint16_t address, uint16_t count, const uint16_t *before) const;

    Owner &owner_;
    uint16_t words_[COUNTERS_END] = {};
};

#endif  // BANK_H
