// Whether the load cell has felt something since the boot: a finger, or a mass put on and taken off.
//
// A bridge that is broken and yet steady, noisy and plausible reads like a drum that nothing
// touches: only a load shows that there is a cell. The reading has to leave its level by 50 g and
// come back to within 20 g, each for eight samples, while the board drives nothing.
#ifndef FEEL_H
#define FEEL_H

#include <stdint.h>

#include "variant.h"  // counts of a force

class Feel {
  public:
    // The drum moves, or may: its level is another one afterwards.
    void disturb() { based_ = false; }
    // Takes one reading of a board that drives nothing.
    void take(int32_t raw);
    // Something was felt, at a level that is the present zero.
    bool holds(int32_t zero) const { return felt_ && within(zero, level_, SAME_COUNTS); }
    bool felt() const { return felt_; }

  private:
    // Drift and noise of a hand stay within it; a cell whose wires break seldom does.
    static constexpr int32_t SAME_COUNTS = board::counts_of(30);

    static bool within(int32_t raw, int32_t level, int32_t counts) {
        return raw - level <= counts && raw - level >= -counts;
    }
    void rest(int32_t raw);

    int32_t first_ = 0;             // of the readings that are alike
    int32_t base_ = 0, before_ = 0; // the level, and the one before it
    int32_t level_ = 0;             // at which something was felt
    uint8_t alike_ = 0, away_ = 0;  // samples
    bool based_ = false, had_before_ = false, felt_ = false;
};

#endif  // FEEL_H
