// Whether motion and force explain each other while the drum is pressed down, and whether the force
// is steady once it was reached. The bounds are derived in docs/decisions/0040.
//
// A load cell whose excitation is broken is steady, noisy and plausible: only that the rod goes
// deeper and nothing is felt betrays it. Without a potentiometer nothing can be said.
#ifndef CONTACT_WATCH_H
#define CONTACT_WATCH_H

#include <stdint.h>

#include "drum_states.h"  // faults
#include "sampling.h"     // period of a sample

class ContactWatch {
  public:
    struct Sample {
        uint16_t position_um, contact_um;
        int16_t force_dg, set_dg;  // 0.1 g
        bool turning;              // the drum brings deeper and higher places
        bool settled;              // the force is inside the band of the settings
        bool for_setup;            // of a board that may not be commissioned
    };
    // How far below the last contact an approach goes; the set-up's less.
    static constexpr uint16_t BEYOND_UM = 1000, SETUP_BEYOND_UM = 250;

    void configure(const Sampling &sampling) { sampling_ = &sampling; }
    // An approach begins, or the set force has another value.
    void restart();
    // Before contact: not further than this below the last one.
    static bool beyond(uint16_t position_um, uint16_t contact_um, uint16_t most_um);
    // Two samples show less than the lifted drum: the cell feels something else.
    bool pulls(int16_t force_dg, bool for_setup);
    // One sample in contact; Fault::None where motion and force fit.
    Fault check(const Sample &sample);

  private:
    void refer_to(const Sample &sample);

    const Sampling *sampling_ = &sampling::FAST;
    uint16_t from_um_ = 0;     // where the force last rose, or was what it should be
    int16_t from_dg_ = 0;
    uint16_t settled_um_ = 0;  // where it settled
    bool referred_ = false, was_settled_ = false, pulled_ = false;
};

// Share of the last seconds in which a force that was reached is far from its set-point.
class Steadiness {
  public:
    void configure(const Sampling &sampling) { part_samples_ = sampling.part_samples; }
    void restart();
    // One sample; true where more than half of the window was far away.
    bool lost(bool far_away);

  private:
    static constexpr uint8_t PARTS = 8;

    uint8_t far_[PARTS] = {};
    uint8_t part_samples_ = sampling::FAST.part_samples;
    uint8_t sum_ = 0, part_ = 0, in_part_ = 0;
};

#endif  // CONTACT_WATCH_H
