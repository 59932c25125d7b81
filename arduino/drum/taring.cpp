#include "taring.h"

#include <stdlib.h>

#include "ports.h"  // speed of the drum

namespace {

constexpr uint8_t TRIES = 3;                // a drum just lifted still swings
constexpr int32_t MAX_SPREAD_UG = 10000000; // 10 g

}  // namespace

bool Taring::begin(bool forced) {
    ForceSensor &sensor = controller_.sensor();
    if (!controller_.resting() || sensor.loadcell().faults()) return false;
    const bool free = controller_.contact().gone() && sensor.near_zero(sensor.loadcell().raw());
    if (!forced && !free) return false;
    forced_ = forced;
    sensor.loadcell().begin_tare();
    tries_ = TRIES;
    return true;
}

Taring::Progress Taring::tick() {
    if (!controller_.resting()) {
        abandon();
        return Progress::Failed;
    }
    return controller_.sensor().loadcell().taring() ? Progress::Running : finish();
}

Taring::Progress Taring::finish() {
    ForceSensor &sensor = controller_.sensor();
    Loadcell &cell = sensor.loadcell();
    const int64_t spread = static_cast<int64_t>(cell.tare_spread()) *
                           labs(bank_.wide(reg::scale_ug_per_count));
    if (spread > MAX_SPREAD_UG) {
        if (!tries_) return Progress::Failed;
        --tries_;
        cell.begin_tare();
        return Progress::Running;
    }
    const int32_t tare = cell.tare_mean() - cell.place_tare();
    const bool lifted = controller_.contact().gone();
    if (!forced_ && !(lifted && sensor.near_zero(tare))) return Progress::Failed;
    // The zero is a raw reading, as the limit is: tares of places are settings.
    if (lifted) sensor.zero().take(cell.tare_mean());
    if (forced_) controller_.contact().forget_place();
    bank_.put_wide(reg::tare_counts, static_cast<uint32_t>(tare));
    controller_.apply_settings();
    tared_ = true;
    return Progress::Done;
}

void Taring::begin_turn() {
    turn_.begin();
    turning_ = true;
}

void Taring::sample(int32_t raw) {
    if (turning_ && ports::at_speed()) turn_.add(raw, controller_.axis().place_in_turn());
}

Taring::Progress Taring::tick_turn() {
    const State state = controller_.machine().state();
    if (!turning_ || state == State::Position) return Progress::Running;
    turning_ = false;
    if (state != State::Armed) return Progress::Running;  // the turn was stopped
    return take_turn() ? Progress::Done : Progress::Failed;
}

bool Taring::take_turn() {
    ForceSensor &sensor = controller_.sensor();
    if (!turn_.finish() || !sensor.near_zero(turn_.mean())) return false;
    sensor.zero().take(turn_.mean());
    bank_.put_wide(reg::tare_counts, static_cast<uint32_t>(turn_.mean()));
    for (uint8_t place = 0; place < TARE_PLACES; ++place)
        bank_.put(reg::tare_place_00 + place, static_cast<uint16_t>(turn_.at(place)));
    controller_.apply_settings();
    tared_ = true;
    return true;
}
