#include "loadcell.h"

#include <stdlib.h>

#include "drum_states.h"  // fault numbers
#include "variant.h"      // counts of a force

namespace {

constexpr int32_t FULL_SCALE = 0x7fffff;
constexpr int32_t SPIKE_COUNTS = board::counts_of(Loadcell::SPIKE_G);
constexpr uint32_t bit(Fault fault) { return 1UL << static_cast<uint8_t>(fault); }

}  // namespace

void Loadcell::supervise(const Conversion &conversion) {
    const bool repeats = settled_ && conversion.raw == raw();
    equal_run_ = repeats ? (equal_run_ < 255 ? equal_run_ + 1 : 255) : 0;
    saturated_ = conversion.raw >= FULL_SCALE || conversion.raw <= -FULL_SCALE - 1;
    out_of_step_ = !conversion.in_step;
    if (settled_ > SETTLING && conversion.ready_us - seen_us_ > sampling_->gap_us) ++dropped_;
    measure_rate(conversion.ready_us);
    seen_ = true;
    seen_us_ = conversion.ready_us;
    silent_ = false;
}

bool Loadcell::take(const Conversion &conversion) {
    supervise(conversion);
    if (settled_ < SETTLING) {
        ++settled_;
        return false;
    }
    settled_ = SETTLING + 1;
    ++sequence_;
    raw_[last()] = conversion.raw;
    time_us_[last()] = conversion.ready_us;
    // The end of the range is not a force: the fault is the cell's, not an over-force.
    if (!saturated_) look_for_spike(conversion.raw);
    weigh();
    if (tare_left_) add_to_tare(conversion.raw);
    return true;
}

// A sample that is far off waits for the next one: if that is like the ones before, it was a spike, else
// the force has moved.
void Loadcell::look_for_spike(int32_t raw) {
    const bool first = sequence_ == 1;
    const bool far = !first && labs(raw - steady_raw_) > SPIKE_COUNTS;
    if (suspect_ && !far) ++spikes_;
    suspect_ = far && !suspect_;
    if (!suspect_) steady_raw_ = raw;
}

// Over intervals in a row; one with conversions missing begins anew.
void Loadcell::measure_rate(uint32_t ready_us) {
    const uint32_t interval_us = ready_us - seen_us_;
    const bool whole = seen_ && interval_us / 2 <= interval_us_;
    interval_us_ = interval_us;
    if (whole && ++intervals_ < RATE_INTERVALS) return;
    const uint32_t span_us = ready_us - rate_from_us_;
    constexpr uint32_t TIMES = 100UL * 1000000UL * RATE_INTERVALS;
    if (whole) rate_ = span_us > TIMES / 65535 ? TIMES / span_us : 65535;
    rate_from_us_ = ready_us;
    intervals_ = 0;
    judge_rate();
}

// Where the rate itself is wrong, that is the fault, and the samples still come.
void Loadcell::judge_rate() {
    rate_wrong_ = rate_ && (rate_ < sampling_->low_rate || rate_ > sampling_->high_rate);
    const Sampling &slowest = rate_wrong_ ? sampling::SLOW : *sampling_;
    silence_us_ = static_cast<int32_t>(slowest.silence_us);
}

void Loadcell::test(bool at_rest) {
    if (!at_rest || saturated_) return test_.disturb();
    bool fresh = true;
    for (uint8_t age = 1; age <= test_.taken() && fresh; ++age)
        fresh = ring_raw(static_cast<uint8_t>(sequence_ - age)) != raw();
    test_.take(steady_raw_, fresh);
}

void Loadcell::tick(uint32_t now_us) {
    // Signed: a sample may be newer than the tick's own clock reading.
    if (static_cast<int32_t>(now_us - seen_us_) > silence_us_) {
        if (!silent_ && settled_ > SETTLING) ++dropped_;
        silent_ = true;
    }
}

uint32_t Loadcell::faults() const {
    uint32_t bits = 0;
    if (silent_) bits |= bit(Fault::LoadcellSilent);
    if (saturated_) bits |= bit(Fault::LoadcellSaturated);
    if (equal_run_ >= FROZEN_RUN && !saturated_ && !out_of_step_) bits |= bit(Fault::LoadcellFrozen);
    if (out_of_step_) bits |= bit(Fault::LoadcellDesync);
    if (rate_wrong_) bits |= bit(Fault::LoadcellRate);
    if (test_.failed()) bits |= bit(Fault::LoadcellNoise);
    return bits;
}

void Loadcell::set_scale(int32_t tare_counts, int32_t ug_per_count) {
    tare_counts_ = tare_counts;
    g_per_count_ = static_cast<float>(ug_per_count) * 1e-6f;
    weigh();
}

void Loadcell::begin_tare() {
    tare_left_ = TARE_PAUSE + TARE_SAMPLES;
    tare_sum_ = 0;
}

// Summed as differences from the first sample: 32 differences of a still drum fit 32 bits.
void Loadcell::add_to_tare(int32_t raw) {
    if (tare_left_ > TARE_SAMPLES) {
        --tare_left_;
        return;
    }
    if (tare_left_ == TARE_SAMPLES) tare_first_ = tare_low_ = tare_high_ = raw;
    if (raw < tare_low_) tare_low_ = raw;
    if (raw > tare_high_) tare_high_ = raw;
    tare_sum_ += raw - tare_first_;
    if (--tare_left_ == 0) tare_mean_ = tare_first_ + tare_sum_ / TARE_SAMPLES;
}
