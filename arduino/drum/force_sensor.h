// The contact force: the load cell with its tare, its zero, and the limits of the force.
#ifndef FORCE_SENSOR_H
#define FORCE_SENSOR_H

#include <stdint.h>

#include "bank.h"      // scale, tare, limit
#include "feel.h"      // has the cell felt something
#include "loadcell.h"  // samples
#include "zero.h"      // reading of the lifted drum

class ForceSensor {
  public:
    void configure(const Bank &bank);
    // Takes a conversion; `place_tare` is what the drum's angle adds to the tare. Returns false
    // while the amplifier still settles.
    bool take(const Conversion &conversion, int32_t place_tare) {
        loadcell_.set_place_tare(place_tare);
        if (!loadcell_.take(conversion)) return false;
        count_over();
        return true;
    }
    // Compares the newest samples with both limits.
    void check_limits();

    // One reading of the lifted drum at rest.
    void weigh_free() {
        if (loadcell_.suspect()) zero_.disturb();
        else if (zero_.weigh(loadcell_.raw())) check_tare();
    }

    // One reading of a board that drives nothing, or another one.
    void look_for_touch(bool driver_off) {
        if (!driver_off || loadcell_.faults()) feel_.disturb();
        else feel_.take(loadcell_.steady_raw());
    }
    // The cell has felt something since the boot, and reads now what it read then.
    bool feels() const { return zero_.known() ? feel_.holds(zero_.counts()) : feel_.felt(); }

    float force_g() const { return loadcell_.force_g(); }
    bool over_force() const { return over_force_; }
    // The tare is near the zero that the board knows.
    bool tare_holds() const { return tare_holds_; }
    bool tare_by_place() const { return tare_by_place_; }
    bool near_zero(int32_t counts) const { return !zero_.known() || zero_.near(counts); }
    // The cell shows what it showed when the zero was taken.
    bool reads_zero() const { return zero_.near(loadcell_.steady_raw()); }
    // The cell shows a force, as far as its reading can be trusted.
    bool reads_contact() const {
        return zero_.known() && !loadcell_.faults() && !zero_.free(loadcell_.raw());
    }
    bool reads_free() const { return !loadcell_.faults() && zero_.free(loadcell_.raw()); }

    Loadcell &loadcell() { return loadcell_; }
    const Loadcell &loadcell() const { return loadcell_; }
    Zero &zero() { return zero_; }
    const Zero &zero() const { return zero_; }

  private:
    void count_over();
    void check_tare() { tare_holds_ = zero_.near(tare_counts_); }

    Loadcell loadcell_;
    Zero zero_;
    Feel feel_;
    int32_t tare_counts_ = 0;
    float over_force_g_ = 0;
    uint8_t over_run_ = 0;  // samples in a row above the settings' limit
    uint8_t over_needed_ = 1;
    bool over_force_ = false, tare_holds_ = false;
    bool tare_by_place_ = false;  // at least one place of the turn has a tare
};

#endif  // FORCE_SENSOR_H
