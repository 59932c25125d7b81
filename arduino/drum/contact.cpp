#include "contact.h"

#include "variant.h"  // travel

namespace {

constexpr float WHOLE_TRAVEL_MS = board::ACTUATOR_TRAVEL_UM / board::ACTUATOR_MAX_MM_S;
constexpr uint16_t FULL_LIFT_MS = 1.2f * WHOLE_TRAVEL_MS;
constexpr uint16_t GENTLE_LIFT_MS = 1.2f * board::ACTUATOR_TRAVEL_UM / board::GENTLE_LIFT_MM_S;
constexpr uint8_t FREE_READINGS = 8;  // in a row: a coasting rod is at rest by then
constexpr uint16_t GONE_UM = 3000;    // above the last contact: more than ridges and run-out

}  // namespace

void Contact::forget() {
    contact_known_ = place_known_ = false;
    sensor_.zero().forget();
    free_run_ = 0;
    if (gone()) rests_ = Rests::Unknown;
}

void Contact::touched() {
    contact_um_ = signals_.position_um();
    contact_known_ = true;
}

bool Contact::close(uint16_t zone_um) const {
    if (!contact_known_ || !signals_.reads_position()) return true;
    return signals_.position_um() + static_cast<uint32_t>(zone_um) >= contact_um_;
}

// An open wire of the upper switch reads as the upper end. What the cell feels where the potentiometer
// agrees, or without one after a whole lift, is another drum.
bool Contact::at_every_top(bool whole) const {
    return signals_.says_top() && (signals_.reads_position() ? signals_.at_top() : whole);
}

bool Contact::high_enough(bool to_the_top, const Lift &lift) const {
    const bool whole = lift.ms > (lift.gentle ? GENTLE_LIFT_MS : FULL_LIFT_MS);
    if (sensor_.reads_contact()) return at_every_top(whole);
    if (signals_.at_upper_end()) return true;
    if (!signals_.reads_position())
        return whole && (signals_.says_top() || !signals_.fitted(Signal::EndSwitches));
    if (signals_.at_top()) return true;
    return !to_the_top && lifted_by(lift.clearance_um);
}

// By the upper end, by the reading, or by the way above the last contact.
bool Contact::seems_gone() const {
    if (free_run_ >= FREE_READINGS) return true;
    if (sensor_.reads_contact()) return false;
    if (signals_.at_upper_end()) return true;
    return signals_.reads_position() && (signals_.at_top() || lifted_by(GONE_UM));
}

void Contact::watch() {
    if (!gone() && seems_gone()) set_gone();
    if (gone()) lift_failed_ = false;
}

void Contact::take_reading(bool driver_off, bool standing) {
    if (!sensor_.reads_free()) free_run_ = 0;
    else if (free_run_ < FREE_READINGS) ++free_run_;
    if (driver_off) watch();
    if (sensor_.loadcell().faults() || !standing || !gone()) sensor_.zero().disturb();
    else sensor_.weigh_free();
}
