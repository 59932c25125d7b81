#include "force_sensor.h"

#include <math.h>

void ForceSensor::configure(const Bank &bank) {
    over_force_g_ = bank.word(reg::over_force) * 0.1f;
    tare_by_place_ = false;
    for (uint8_t place = 0; place < TARE_PLACES; ++place)
        if (bank.tare_places()[place]) tare_by_place_ = true;
    tare_counts_ = bank.wide(reg::tare_counts);
    const Sampling &sampling = sampling::of(bank.word(reg::loadcell_slow));
    loadcell_.configure(sampling);
    over_needed_ = sampling.slow ? 1 : 2;
    loadcell_.set_scale(tare_counts_, bank.wide(reg::scale_ug_per_count));
    check_tare();
    check_limits();
}

// The limit of the settings applies in both directions, because with a scale of the wrong sign
// pressing reads as pulling. Without a tare near the board's own zero, counts are not a force.
void ForceSensor::count_over() {
    if (!tare_holds_ || fabsf(loadcell_.measured_g()) <= over_force_g_) over_run_ = 0;
    else if (over_run_ < over_needed_) ++over_run_;
}

// One sample may be a spike: the settings' limit takes two, where the next comes in 12.5 ms. The other
// limit is in raw counts, no setting moves it, and one sample suffices.
void ForceSensor::check_limits() {
    over_force_ = over_run_ >= over_needed_;
    if (!loadcell_.saturated() && zero_.exceeded(loadcell_.raw())) over_force_ = true;
}
