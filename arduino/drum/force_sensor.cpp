#include "force_sensor.h"

#include <math.h>

void ForceSensor::configure(const Bank &bank) {
    over_force_g_ = bank.word(reg::over_force) * 0.1f;
    tare_by_place_ = false;
    for (uint8_t place = 0; place < TARE_PLACES; ++place)
        if (bank.tare_places()[place]) tare_by_place_ = true;
    tare_counts_ = bank.wide(reg::tare_counts);
    loadcell_.set_scale(tare_counts_, bank.wide(reg::scale_ug_per_count));
    check_tare();
    check_limits();
}

// The limit of the settings applies in both directions, because with a scale of the wrong sign
// pressing reads as pulling. Without a tare near the board's own zero, counts are not a force. The
// other limit is in raw counts, and no setting moves it.
void ForceSensor::check_limits() {
    over_force_ = tare_holds_ && fabsf(loadcell_.force_g()) > over_force_g_;
    if (!loadcell_.saturated() && zero_.exceeded(loadcell_.raw())) over_force_ = true;
}
