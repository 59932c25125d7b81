// The load cell's reading at no load over one turn of the lifted drum: a mean, and what each
// sixteenth of the turn adds to it. The weight of an unbalanced drum on the cell depends on its angle.
#ifndef TARE_TURN_H
#define TARE_TURN_H

#include <stdint.h>

#include "drum_map.h"  // places
#include "variant.h"   // steps of a turn

class TareTurn {
  public:
    static constexpr uint16_t PLACE_STEPS = board::STEPS_PER_TURN / TARE_PLACES;

    void begin();
    // Adds a reading at this step of the turn.
    void add(int32_t raw, uint16_t place_steps);
    // False where a part of the turn is missing or is out of a register's range.
    bool finish();

    int32_t mean() const { return mean_; }
    int16_t at(uint8_t place) const { return static_cast<int16_t>(sums_[place]); }

    // What a table adds to the reading at a step of the turn, interpolated between its places.
    static int32_t between(const uint16_t *table, uint16_t place_steps);

  private:
    static constexpr uint8_t LEAST_READINGS = 3;

    int32_t sums_[TARE_PLACES] = {};  // of differences from the first reading
    uint16_t counts_[TARE_PLACES] = {};
    int32_t first_ = 0, mean_ = 0;
    bool begun_ = false;
};

#endif  // TARE_TURN_H
