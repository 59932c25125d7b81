// Load-cell samples: force from counts, the ring the computer reads, tare, and supervision.
#ifndef LOADCELL_H
#define LOADCELL_H

#include <stdint.h>

#include "amplifier_test.h"  // is it a cell
#include "drum_map.h"        // ring depth
#include "sampling.h"        // rates

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

    // A sample this far from the one before and from the one after it is a spike. Ridges and an
    // approach move the force by less in 12.5 ms.
    static constexpr uint16_t SPIKE_G = 250;
    static constexpr uint8_t RATE_INTERVALS = 8;

    Loadcell() { judge_rate(); }

    void configure(const Sampling &sampling) {
        sampling_ = &sampling;
        judge_rate();
    }
    // Takes a conversion; false while the amplifier still settles.
    bool take(const Conversion &conversion);
    // Once a millisecond; silence is a fault after 2.4 periods.
    void tick(uint32_t now_us);

    // Bits of fault_bits that this sensor sees now.
    uint32_t faults() const;
    bool saturated() const { return saturated_; }
    // Tests the readings since the last call with `at_rest` false; called after each sample.
    void test(bool at_rest);
    const AmplifierTest &test() const { return test_; }
    // Measured, in 0.01 samples a second; 0 before it is known.
    uint16_t rate() const { return rate_; }
    // Samples have come since the boot.
    bool alive() const { return settled_ > SETTLING && !silent_; }
    // Time since the last conversion or the boot.
    uint32_t silent_us(uint32_t now_us) const { return now_us - seen_us_; }

    void set_scale(int32_t tare_counts, int32_t ug_per_count);
    // What the drum's angle adds to the tare, for the next conversion.
    void set_place_tare(int32_t counts) { place_tare_ = counts; }
    int32_t place_tare() const { return place_tare_; }
    // The force for the loop: at the fast rate, a sample that may be a spike waits for the next.
    float force_g() const { return force_g_; }
    // The force of the newest sample.
    float measured_g() const { return grams(raw()); }
    // The newest sample may be a spike.
    bool suspect() const { return suspect_; }
    // The newest sample that is none.
    int32_t steady_raw() const { return steady_raw_; }
    uint16_t spikes() const { return spikes_; }
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
    void weigh() { force_g_ = grams(sampling_->slow ? raw() : steady_raw_); }
    void look_for_spike(int32_t raw);
    void measure_rate(uint32_t ready_us);
    void judge_rate();
    float grams(int32_t raw) const {
        return static_cast<float>(raw - tare_counts_ - place_tare_) * g_per_count_;
    }

    int32_t raw_[RING_DEPTH] = {};
    uint32_t time_us_[RING_DEPTH] = {};
    const Sampling *sampling_ = &sampling::FAST;
    AmplifierTest test_;
    uint32_t seen_us_ = 0, rate_from_us_ = 0, interval_us_ = 0;
    int32_t steady_raw_ = 0, silence_us_ = 0;
    uint16_t rate_ = 0, spikes_ = 0;
    uint8_t intervals_ = 0;
    bool suspect_ = false, seen_ = false, rate_wrong_ = false;
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
