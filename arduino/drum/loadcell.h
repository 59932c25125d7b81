// Load-cell samples: force from counts, the ring the computer reads, tare, and supervision.
#ifndef LOADCELL_H
#define LOADCELL_H

#include <stdint.h>

#include "drum_map.h"  // ring depth

struct Conversion {
    int32_t raw;
    uint32_t ready_us;  // board time at which the amplifier offered it
    bool in_step;       // the amplifier answered the extra gain pulse as it should
};

class Loadcell {
  public:
    // Conversions after a reset that are thrown away: the amplifier's filter settles.
    static constexpr uint8_t SETTLING = 4;
    static constexpr uint8_t TARE_SAMPLES = 32;
    // Samples before the tare: the drum's mass still comes to rest.
    static constexpr uint8_t TARE_PAUSE = 16;
    // So many equal readings in a row mean that the amplifier is frozen.
    static constexpr uint8_t FROZEN_RUN = 8;

    // Takes a conversion; false while the amplifier still settles.
    bool take(const Conversion &conversion);
    // Once a millisecond; silence is a fault after 2.4 periods.
    void tick(uint32_t now_us);

    // Bits of fault_bits that this sensor sees now.
    uint32_t faults() const;
    bool saturated() const { return saturated_; }
    // Samples have come since the boot.
    bool alive() const { return settled_ > SETTLING && !silent_; }

    void set_scale(int32_t tare_counts, int32_t ug_per_count);
    // What the drum's angle adds to the tare, for the next conversion.
    void set_place_tare(int32_t counts) { place_tare_ = counts; }
    int32_t place_tare() const { return place_tare_; }
    float force_g() const { return force_g_; }
    int32_t raw() const { return raw_[last()]; }

    void begin_tare();
    void abandon_tare() { tare_left_ = 0; }
    bool taring() const { return tare_left_ != 0; }
    // Mean of the finished tare; valid once taring() fell back to false.
    int32_t tare_mean() const { return tare_mean_; }
    // Spread of the tare's samples in counts; a drum that swings makes it large.
    int32_t tare_spread() const { return tare_high_ - tare_low_; }

    uint16_t sequence() const { return sequence_; }
    uint32_t time_us() const { return time_us_[last()]; }
    int32_t ring_raw(uint8_t place) const { return raw_[place % RING_DEPTH]; }
    uint32_t ring_time_us(uint8_t place) const { return time_us_[place % RING_DEPTH]; }
    uint16_t dropped() const { return dropped_; }

  private:
    uint8_t last() const { return sequence_ % RING_DEPTH; }
    void supervise(const Conversion &conversion);
    void add_to_tare(int32_t raw);
    void weigh();

    int32_t raw_[RING_DEPTH] = {};
    uint32_t time_us_[RING_DEPTH] = {};
    uint32_t seen_us_ = 0;
    uint16_t sequence_ = 0;
    uint16_t dropped_ = 0;
    uint8_t settled_ = 0;
    uint8_t equal_run_ = 0;
    uint8_t tare_left_ = 0;  // samples of the pause and of the tare itself
    bool silent_ = false, saturated_ = false, out_of_step_ = false;
    int32_t tare_counts_ = 0, place_tare_ = 0, tare_mean_ = 0, tare_low_ = 0, tare_high_ = 0;
    int32_t tare_first_ = 0, tare_sum_ = 0;
    float g_per_count_ = 0, force_g_ = 0;
};

#endif  // LOADCELL_H
