// What the load cell reads while the drum hangs free, as the board itself has seen it.
//
// No register moves it: it is the mean of readings taken while the drum was known to be lifted
// and stood still. The limit that no setting can move is judged from it, in raw counts, and so is
// what a lifted drum reads. The first reading after a boot is believed; a later one only where it
// lies near the one before, or where a person asks for it by name.
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
    // The drum moves, or may: what was begun counts no more.
    void disturb() { left_ = PAUSE + SAMPLES; }
    // One reading of the lifted drum at rest; true when the zero was learned anew by it.
    bool weigh(int32_t raw);
    // A tare of the lifted drum.
    void take(int32_t counts);

    bool known() const { return known_; }
    int32_t counts() const { return counts_; }
    bool near(int32_t raw) const { return known_ && within(raw, board::counts_of(WINDOW_G)); }
    bool free(int32_t raw) const { return known_ && within(raw, board::counts_of(FREE_G)); }
    // Further off than any force that the board lets pass.
    bool exceeded(int32_t raw) const;

  private:
    bool within(int32_t raw, int32_t counts) const {
        const int32_t off = raw - counts_;
        return off <= counts && off >= -counts;
    }

    int32_t counts_ = 0, first_ = 0, sum_ = 0;
    uint8_t left_ = PAUSE + SAMPLES;
    bool known_ = false;
};

#endif  // ZERO_H
