// Whether the drum rests on the sensor: by the load cell, the end switch and the actuator's way.
#ifndef CONTACT_H
#define CONTACT_H

#include <stdint.h>

#include "contact_watch.h"  // how deep is too deep
#include "force_sensor.h"  // what the cell reads
#include "signals.h"       // position, end switches

class Contact {
  public:
    struct Lift {
        uint32_t ms;            // since it began
        uint16_t clearance_um;  // above the last contact
        bool gentle;            // slower than full speed
    };

    Contact(ForceSensor &sensor, const Signals &signals) : sensor_(sensor), signals_(signals) {}

    // The wires that end a lift changed: what they showed before does not count.
    void forget();
    // A new state begins: the readings without contact are counted again.
    void restart() { free_run_ = 0; }
    // The drum is pressed down from here on.
    void press() { rests_ = Rests::Maybe; }
    void touched();

    // The drum is known to be lifted.
    bool gone() const { return rests_ == Rests::No; }
    // Nothing was pressed since the boot.
    bool unknown() const { return rests_ == Rests::Unknown; }
    // It was pressed down since the boot, and is not known to be lifted.
    bool pressed() const { return rests_ == Rests::Maybe; }
    // The last lift ended before contact was known to be gone.
    bool lift_failed() const { return lift_failed_; }
    void set_gone() { rests_ = Rests::No; }
    void lift_too_long() { lift_failed_ = !gone(); }

    // Looks for signs that contact is gone; not while the drum is pressed down.
    void watch();
    // Takes the newest sample's reading while the drum is not pressed down. `standing` is true where
    // a drum that is lifted stands still, so that it can be weighed.
    void take_reading(bool driver_off, bool standing);

    // Returns whether a lift may end: high enough after this time, and no force is read.
    bool high_enough(bool to_the_top, const Lift &lift) const;
    // Returns whether the last contact is this close below, or is not known.
    bool close(uint16_t zone_um) const;
    // A force was reached: the next approach goes little further than this contact.
    void remember_place() {
        place_um_ = contact_um_;
        place_known_ = signals_.reads_position();
        other_drum_ = false;
    }
    // The place of an earlier boot.
    void expect_place(uint16_t um) {
        place_um_ = um;
        place_known_ = true;
    }
    // Another drum or sensor is mounted.
    void forget_place() {
        place_known_ = false;
        other_drum_ = true;
    }
    bool other_drum() const { return other_drum_; }
    bool place_known() const { return place_known_; }
    uint16_t place_um() const { return place_um_; }
    bool too_deep(uint16_t most_um) const {
        return place_known_ && signals_.reads_position() &&
               ContactWatch::beyond(signals_.position_um(), place_um_, most_um);
    }
    // Where the last contact began, and the actuator's way below it.
    uint16_t contact_um() const { return contact_um_; }
    int32_t depth_um() const { return static_cast<int32_t>(signals_.position_um()) - contact_um_; }

  private:
    enum class Rests : uint8_t { No, Unknown, Maybe };

    bool seems_gone() const;
    bool at_every_top(bool whole) const;
    bool lifted_by(uint16_t um) const {
        return contact_known_ && signals_.position_um() + static_cast<uint32_t>(um) <= contact_um_;
    }

    ForceSensor &sensor_;
    const Signals &signals_;
    uint16_t contact_um_ = 0;
    uint16_t place_um_ = 0;  // the contact at which a force was last reached
    Rests rests_ = Rests::Unknown;
    uint8_t free_run_ = 0;  // readings in a row without contact
    bool contact_known_ = false, place_known_ = false;
    bool lift_failed_ = false;
    bool other_drum_ = false;  // and no force was reached with it
};

#endif  // CONTACT_H
