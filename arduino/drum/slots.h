// Words that outlive the power, in two slots with a version and a checksum each.
//
// A save goes into the slot that is not the newest, a byte at a time and the checksum last: a
// power loss at any byte leaves the other slot whole. The caller writes
// the bytes; ports::stored_byte() reads them.
#ifndef SLOTS_H
#define SLOTS_H

#include <stdint.h>

#include "drum_map.h"  // how many settings there are

class Slots {
  public:
    static constexpr uint8_t MAX_WORDS = SETTINGS_WORDS;
    static constexpr uint8_t MAX_BYTES = 2 + 2 * MAX_WORDS + 2;
    enum class Found : uint8_t { Nothing, Whole, Damaged };

    // `count` words at `start`, the second slot `stride` bytes behind the first.
    Slots(uint16_t start, uint16_t stride, uint8_t count)
        : start_(start), stride_(stride), count_(count) {}

    // The newest whole slot; words are left alone where there is none.
    Found load(uint16_t *words) const;
    void begin_save(const uint16_t *words);
    bool saving() const { return done_ != size_; }
    // The next byte to write and where; call it while saving.
    uint8_t next(uint16_t &address);

  private:
    uint8_t whole() const { return 2 + 2 * count_; }
    uint16_t checksum(uint16_t address) const;
    bool is_whole(uint16_t address) const;
    bool is_blank() const;
    uint16_t word_at(uint16_t address) const;
    int8_t newest() const;

    uint16_t start_, stride_;
    uint8_t count_;
    uint16_t address_ = 0;
    uint8_t bytes_[MAX_BYTES];
    uint8_t size_ = 0, done_ = 0;
};

#endif  // SLOTS_H
