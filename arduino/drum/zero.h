// The load cell's reading of the free drum, as the board itself has measured it.
//
// No register changes it: it is the mean of readings while the drum was known to be lifted and did
// not move. The limit that no setting can move is counted from it, in raw counts. The first reading
// after a boot is accepted; a later one only near the one before, or after TARE_ANYWAY.
#ifndef ZERO_H
#define ZERO_H

#include <stdint.h>

#include "variant.h"  // the cell that the board is built for

class Zero {
  public:
    // Drift, imbalance and another plate stay within this; more is another drum, or a contact.
    static constexpr uint16_t WINDOW_G = 100;
    // Below any force that can be set, above imbalance and noise.
    static constexpr uint16_t FREE_G = 20;
    // The cell still feels the drum's mass coming to rest.
    static constexpr uint8_t PAUSE = 8;
    static constexpr uint8_t SAMPLES = 8;

    void forget() { known_ = false; }
    // The drum moves, or may: discards the readings so far.
    void disturb() { left_ = PAUSE + SAMPLES; }
    // Takes one reading of the lifted drum at rest; true when it completed a new zero.
    bool weigh(int32_t raw);
    // A tare of the lifted drum.
    void take(int32_t counts);

    bool known() const { return known_; }
    int32_t counts() const { return counts_; }
    bool near(int32_t raw) const { return known_ && within(raw, board::counts_of(WINDOW_G)); }
    bool free(int32_t raw) const { return known_ && within(raw, board::counts_of(FREE_G)); }
    // Further off than the drum that an uncommissioned board nudges may be.
    bool loaded(int32_t raw, int32_t counts) const { return known_ && !within(raw, counts); }
    // Nothing further off passes from now on.
    void limit(int32_t counts) { most_counts_ = counts; }
    // Further off than any force that the board lets pass.
    bool exceeded(int32_t raw) const;

  private:
    bool within(int32_t raw, int32_t counts) const {
        const int32_t off = raw - counts_;
        return off <= counts && off >= -counts;
    }

    int32_t most_counts_ = board::MOST_COUNTS;
    int32_t counts_ = 0, first_ = 0, sum_ = 0;
    uint8_t left_ = PAUSE + SAMPLES;
    bool known_ = false;
};

#endif  // ZERO_H
