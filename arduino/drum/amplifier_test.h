// Whether readings of a cell at rest are those of a cell: their noise, and how many of them differ.
#ifndef AMPLIFIER_TEST_H
#define AMPLIFIER_TEST_H

#include <stdint.h>

#include "drum_map.h"  // ring depth

// Data sheet of the HX711, gain 128 at 5 V: a count is 2.3 nV, and the amplifier's own noise is
// 50 nV rms at 10 samples a second and 90 nV at 80, that is 21 and 39 counts. No cell on it is
// quieter. A module whose E- pad is not connected to ground (bogde/HX711, issue 172) and open inputs
// jump by thousands of counts from one sample to the next, again and again; a hand on the drum does
// so seldom. Open excitation, shorted inputs and a wrong gain look like a cell at rest: only a load
// shows them.
class AmplifierTest {
  public:
    static constexpr uint8_t FIRST_SAMPLES = 8, SAMPLES = RING_DEPTH;
    static constexpr float QUIET_COUNTS = 5;
    static constexpr int32_t JUMP_COUNTS = 2500;
    static constexpr uint8_t SAMPLES_PER_VALUE = 4;  // at most, in the mean: of 39 counts it is 1.3

    // The cell may be loaded or moved: begins anew.
    void disturb() { taken_ = 0; }
    // Takes a reading of a cell at rest, which was not among the `taken` readings before it if `fresh`.
    void take(int32_t raw, bool fresh);
    uint8_t taken() const { return taken_; }

    // A first result is known.
    bool known() const { return known_; }
    // The last result is bad.
    bool failed() const { return failed_; }
    uint16_t noise_tenths() const { return noise_tenths_; }
    uint16_t unique() const { return unique_; }

  private:
    void finish();

    float sum_ = 0, sum_of_squares_ = 0;
    int32_t first_ = 0, before_ = 0;
    uint16_t noise_tenths_ = 0;
    uint8_t taken_ = 0, fresh_ = 0, jumps_ = 0, unique_ = 0;
    bool known_ = false, failed_ = false;
};

#endif  // AMPLIFIER_TEST_H
