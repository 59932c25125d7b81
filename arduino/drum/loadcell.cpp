#include "loadcell.h"

#include "drum_states.h"  // fault numbers
#include "variant.h"      // conversion period

namespace {

constexpr int32_t FULL_SCALE = 0x7fffff;
constexpr uint32_t SILENCE_US = board::LOADCELL_PERIOD_US * 24UL / 10;
constexpr uint32_t GAP_US = board::LOADCELL_PERIOD_US * 18UL / 10;
constexpr uint32_t bit(Fault fault) { return 1UL << static_cast<uint8_t>(fault); }

}  // namespace

void Loadcell::supervise(const Conversion &conversion) {
    const bool repeats = settled_ && conversion.raw == raw();
    equal_run_ = repeats ? (equal_run_ < 255 ? equal_run_ + 1 : 255) : 0;
    saturated_ = conversion.raw >= FULL_SCALE || conversion.raw <= -FULL_SCALE - 1;
    out_of_step_ = !conversion.in_step;
    if (settled_ > SETTLING && conversion.ready_us - seen_us_ > GAP_US) ++dropped_;
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
    if (!saturated_) weigh();
    if (tare_left_) add_to_tare(conversion.raw);
    return true;
}

void Loadcell::tick(uint32_t now_us) {
    // Signed: a sample may be newer than the tick's own clock reading.
    if (static_cast<int32_t>(now_us - seen_us_) > static_cast<int32_t>(SILENCE_US)) {
        if (!silent_ && settled_ > SETTLING) ++dropped_;
        silent_ = true;
    }
}

uint32_t Loadcell::faults() const {
    uint32_t bits = 0;
    if (silent_) bits |= bit(Fault::LoadcellSilent);
    if (saturated_) bits |= bit(Fault::LoadcellSaturated);
    if (equal_run_ >= FROZEN_RUN && !saturated_) bits |= bit(Fault::LoadcellFrozen);
    if (out_of_step_) bits |= bit(Fault::LoadcellDesync);
    return bits;
}

void Loadcell::set_scale(int32_t tare_counts, int32_t ug_per_count) {
    tare_counts_ = tare_counts;
    g_per_count_ = static_cast<float>(ug_per_count) * 1e-6f;
    weigh();
}

void Loadcell::weigh() {
    force_g_ = static_cast<float>(raw() - tare_counts_ - place_tare_) * g_per_count_;
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
